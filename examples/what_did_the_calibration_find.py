"""What did the calibration find?

A built arm, known to the simulation alone, is measured at 15 poses; a tracker's noise is 20 µm.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
rng = np.random.default_rng(0)
q = rng.uniform(-2, 2, (4, 15))
built = model.space.sample(seed=7, first=0, count=1)
tips = np.array([at.posture.pose[:3, 3] + at.exact(built)[:3, 0] for at in model.at_many(q)])
readings = tips + rng.normal(0, 20e-6, tips.shape)

arm = pp.calibrate(model, (q, readings), pp.Measurement("position", std="20 um"))
print(f"the readings and the sheet: {arm.verdict}; the calibration {arm.improvement.verdict}")
print(f"error at new poses {1e3 * arm.improvement.before:.1f} mm before, {1e6 * arm.improvement.after:.0f} um after")
for name in ("a2", "a4"):
    low, high = arm.interval(name)
    truth = built[model.space.index[name], 0]
    print(f"{name}: {1e6 * low:.0f} to {1e6 * high:.0f} um, built with {1e6 * truth:.0f} um")

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
axes.semilogy(1e6 * np.linalg.norm(arm.residuals_before, axis=1), "o", label="before")
axes.semilogy(1e6 * np.linalg.norm(arm.residuals, axis=1), "o", label="after")
axes.set(xlabel="pose", ylabel="residual, µm")
axes.legend()
figure.savefig("what_did_the_calibration_find.png")
