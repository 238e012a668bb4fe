"""Which joint costs most?"""

from pathlib import Path

import matplotlib.pyplot as plt

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur10e.errors.yaml")
budget = pp.budget(model, samples=1024).poses[0]

places = {place.name: place.share["position"] for place in budget.places}
joints = {name: places.get(name, 0.0) for name in model.chain.joint_names}
worst = max(joints, key=joints.get)
print(f"{worst} causes {joints[worst]:.0%} of the variance of the position")
print(f"the links between the joints together {1 - sum(joints.values()):.0%}")

figure, axes = plt.subplots(figsize=(4.5, 2.6), layout="constrained")
axes.barh(list(joints), [100 * share for share in joints.values()])
axes.set_xlabel("share of the variance, %")
figure.savefig("which_joint_costs_most.png")
