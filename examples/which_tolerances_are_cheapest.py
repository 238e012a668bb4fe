"""Which tolerances are cheapest?

The bearings of four joints: half the tolerance costs twice as much, and 95 % of the arms must keep 37.5 mm.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
joints = model.chain.joint_names
problem = {
    "specs": ["37.5 mm @ 95 %"],
    "tolerances": [{"path": f"axis_install[{joint}].radius", "cost": {"reciprocal": "1 mm"}} for joint in joints],
}
result = pp.allocate(model, problem, for_samples=10_000)

for joint, radius, cost in zip(joints, result.after, result.costs, strict=True):
    print(f"{joint}: ±{1e3 * radius:.3f} mm instead of ±0.1 mm, cost {cost:.0f}")
print(f"together {result.cost:.0f} instead of {result.cost_before:.0f}: {'met' if result.met else 'not met'}")

figure, axes = plt.subplots(figsize=(4.5, 2.2), layout="constrained")
axes.barh(joints, 1e3 * result.after)
axes.axvline(0.1, color="grey", linestyle=":")
axes.set_xlabel("radius of the bearings, mm (dotted: before)")
figure.savefig("which_tolerances_are_cheapest.png")
