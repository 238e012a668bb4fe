"""How far does a warm arm drift?

A UR5 of aluminium, which was measured at 20 °C.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
temperatures = np.arange(20, 41, 5)
arms = [model.with_({"thermal.temperature_change": f"{celsius - 20} ± 1 K"}) for celsius in temperatures]

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
for pose in model.poses:
    errors = np.array([arm.at(pose).error_at_means[:3] for arm in arms])
    drift = 1e3 * np.linalg.norm(errors - errors[0], axis=1)
    print(f"{pose}: {drift[-1]:.2f} mm at 40 °C")
    axes.plot(temperatures, drift, "o-", label=pose)
axes.set(xlabel="temperature of the links, °C", ylabel="drift of the tool, mm")
axes.legend()
figure.savefig("how_far_does_a_warm_arm_drift.png")
