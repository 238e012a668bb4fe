"""Where is the arm least precise?

A UR5 with its tool pointing down, in front of it, 20 cm above the table.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
x, y = np.linspace(0.25, 0.75, 9), np.linspace(-0.5, 0.5, 17)
places = pp.plane_places((0, 0, 0.2), (1, 0, 0), (0, 1, 0), x, y)
poses = pp.place_grid(model.chain, places, pp.Orientation.along((0, 0, -1)))
precision = pp.map_poses(model, poses, verify=0)

worst, best = precision.worst_first[0], precision.worst_first[-1]
error = 1e3 * precision.quantile[1, 0]
for name, pose in (("worst", worst), ("best", best)):
    at_x, at_y = poses.position[:2, pose]
    print(f"{name} at x = {at_x:z.2f} m, y = {at_y:z.2f} m: 95 % of the arms within {error[pose]:.1f} mm")
print(f"{poses.status.count('unreachable')} of {len(poses.status)} places are out of reach")

figure, axes = plt.subplots(figsize=(4.5, 2.6), layout="constrained")
drawn = axes.pcolormesh(y, x, error.reshape(len(x), -1))
axes.set(xlabel="y, m", ylabel="x, m", aspect="equal")
figure.colorbar(drawn, label="95 % quantile, mm")
figure.savefig("where_is_the_arm_least_precise.png")
