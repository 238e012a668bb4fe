"""What will ISO 9283 show?

Accuracy AP and repeatability RP of 500 arms, each tested with 30 cycles as the standard has it.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
test = pp.iso9283(model, ["ready"], robots=500, cycles=30).poses["P1"]

for name, law in (("AP", test.AP), ("RP", test.RP)):
    low, median, high = (1e3 * law.quantile(level) for level in (0.05, 0.5, 0.95))
    print(f"{name}: median arm {median:.3f} mm, 90 % of the arms {low:.3f} to {high:.3f} mm")

figure, axes = plt.subplots(1, 2, figsize=(4.5, 2.4), layout="constrained")
for panel, name, law in zip(axes, ("AP", "RP"), (test.AP, test.RP), strict=True):
    panel.hist(1e3 * law.values, 30)
    panel.set(xlabel=f"{name}, mm", yticks=[])
axes[0].set_ylabel("arms")
figure.savefig("what_will_iso_9283_show.png")
