"""Which tolerance should be tightened first?"""

from pathlib import Path

import matplotlib.pyplot as plt

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
budget = pp.budget(model, "ready", samples=1024).poses[0]

top = budget.ranked[:6]
for draw in top[:3]:
    change = draw.halved.change["position.norm"]
    print(f"{draw.words} ({draw.tolerance}): {draw.share['position']:.0%} of the variance")
    print(f"  halved, the 95 % quantile changes by {1e3 * change.value:.2f} ± {1e3 * change.half_width:.2f} mm")

figure, axes = plt.subplots(figsize=(4.5, 2.6), layout="constrained")
axes.barh([draw.name for draw in top[::-1]], [100 * draw.share["position"] for draw in top[::-1]])
axes.set_xlabel("share of the variance, %")
figure.savefig("which_tolerance_first.png")
