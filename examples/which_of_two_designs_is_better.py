"""Which of two designs is better?

Better bearings, or lengths cut more finely? Each design is built with the same random numbers.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
designs = {
    "as drawn": model,
    "better bearings": model.with_({"axis_install[*].radius": "0.05 mm"}),
    "finer lengths": model.with_({"parameters.a2": "±0.05 mm", "parameters.a4": "±0.05 mm"}),
}
comparison = pp.compare(designs, "paper", samples=5000, specifications="40 mm @ 95 %")

for name, pair in zip(comparison.names[1:], comparison.poses[0].differences, strict=False):
    change = pair.quantiles["position.norm"][0.95]
    low, high = change.interval
    told = "" if change.is_told else ", no difference that can be told"
    print(f"{name}: 95 % quantile {1e3 * change.value:+.2f} mm ({1e3 * low:+.2f} to {1e3 * high:+.2f}){told}")
print("40 mm kept by:", ", ".join(name for name in comparison.names if comparison.met(name)))

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
for name, law in zip(comparison.names, comparison.poses[0].laws, strict=True):
    bars = law.position.norm.histogram(40)
    axes.stairs(bars.density, 1e3 * bars.edges, label=name)
axes.axvline(40, color="grey", linestyle=":")
axes.set(xlabel="|d|, mm", yticks=[])
axes.legend()
figure.savefig("which_of_two_designs_is_better.png")
