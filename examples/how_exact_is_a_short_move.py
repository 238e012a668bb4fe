"""How exact is a short move?

A place is taught, so that its error is in the program; then the tool works some way off.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
distance = np.array([0, 10, 50, 100, 200, 300, 400])
places = np.array([1e-3 * distance - 0.2, np.full(7, 0.5), np.full(7, 0.2)])
poses = pp.place_grid(model.chain, places, pp.Orientation.along((0, 0, -1)))
law = pp.map_poses(model, poses, relative_to=poses.q[:, 0], verify=0)
absolute, move = 1e3 * law.quantile[1, 0], 1e3 * law.relative.quantile[1, 0]

print(f"95 % of the arms are within {absolute[0]:.2f} mm of the taught place")
for millimetres, error in zip(distance[1:], move[1:], strict=True):
    print(f"{millimetres:3d} mm from there: within {error:.2f} mm of where it should be, seen from the taught place")

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
axes.plot(distance, absolute, "o--", label="absolute")
axes.plot(distance, move, "o-", label="relative to the taught place")
axes.set(xlabel="distance, mm", ylabel="95 % quantile of |d|, mm", ylim=(0, None))
axes.legend()
figure.savefig("how_exact_is_a_short_move.png")
