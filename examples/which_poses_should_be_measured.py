"""Which poses should be measured?

Eight of eighteen, for a laser tracker that sees a target on the tool.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
tracker = pp.Measurement("position", std="20 um", target="50 30 20 mm")
candidates = np.random.default_rng(1).uniform(-2, 2, (4, 18))
plan = pp.plan_calibration(model, candidates, 8, tracker)
forecast = pp.forecast_calibration(model, plan.q, tracker)
random = pp.forecast_calibration(model, candidates[:, :8], tracker)

print("measure candidates", *plan.chosen)
print(f"error before {1e3 * plan.rms('before'):.1f} mm, after {1e6 * plan.rms('after'):.0f} um")
print(f"after eight poses at random {1e6 * random.rms('after'):.0f} um")

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
for label, curve in (("chosen", forecast.by_count), ("at random", random.by_count)):
    axes.plot([point.value for point in curve], [1e6 * point.rms_position for point in curve], "o-", label=label)
axes.set(xlabel="measured poses", ylabel="rms error left, µm", ylim=(0, 150))
axes.legend()
figure.savefig("which_poses_should_be_measured.png")
