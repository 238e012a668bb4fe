"""Does the tool stay on its path?

A straight seam of 60 cm; an arm counts only if it keeps the limit on the whole of it.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
x = np.linspace(-0.3, 0.3, 13)
places = np.array([x, np.full_like(x, 0.5), np.full_like(x, 0.2)])
seam = pp.place_grid(model.chain, places, pp.Orientation.along((0, 0, -1)))
law = pp.path_law(model, seam, samples=3000, specifications="4 mm @ 90 %")

result = law.specification_results[0]
print(f"within 4 mm on the whole seam: {result.probability:.1%} of the arms, {result.verdict}")
print(f"95 % quantile at the worst place alone: {1e3 * law.curve[0].max():.2f} mm")
print(f"95 % quantile of the largest error on the way: {1e3 * law.maximum_quantile(0, 0.95).value:.2f} mm")

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
axes.plot(1e3 * x, 1e3 * law.band[0], label="95 % of arms on the whole seam")
axes.plot(1e3 * x, 1e3 * law.curve[0], "--", label="95 % of arms at each place")
axes.set(xlabel="x, mm", ylabel="|d|, mm", ylim=(3.6, None))
axes.legend(loc="lower center")
figure.savefig("does_the_tool_stay_on_its_path.png")
