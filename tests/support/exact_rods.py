"""The paper's arm as geometrically exact rods: an independent answer for its rest under gravity.

Links 2 and 3 are Kirchhoff rods (inextensible, no shear): curvature in the rod's own axes is the moment there divided by
(GI, EI, EI). Link 4 is rigid, joints are torsion springs. A rod is a row of n straight pieces that turn by
``curvature × length`` from one middle to the next, an error of second order in 1/n, which two n take away.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

POSE = np.radians([-90.0, 3.0, 88.0, -91.0])
LENGTHS = (1.97, 1.77)
ROD_MASSES = (1.4, 1.4)
RIGIDITIES = np.array([[4000.0, 8000.0, 8000.0], [1000.0, 8000.0, 8000.0]])
COMPLIANCE = 1e-5


def rods_error(stiffness: float = 1.0, payload: float = 1.0, pieces: int = 20) -> np.ndarray:
    """Return the tool's error ``[d; δ]`` in base axes, all stiffness scaled by a factor, extrapolated in the pieces."""
    position, turn = _at_rest(stiffness, payload, 1, (0.0, 0.0, 0.0))
    errors = []
    for count in (pieces, 2 * pieces):
        moved, turned = _at_rest(stiffness, payload, count, (0.0, 0.0, -9.81))
        errors.append(np.concatenate([moved - position, Rotation.from_matrix(turned @ turn.T).as_rotvec()]))
    return (4 * errors[1] - errors[0]) / 3


def _turn(vector) -> np.ndarray:
    return Rotation.from_rotvec(vector).as_matrix()


def _at_rest(stiffness: float, payload: float, count: int, gravity) -> tuple[np.ndarray, np.ndarray]:
    """Return the tool's position and axes: shape, then moments, then curvatures, in turn until nothing moves."""
    curvatures = np.zeros((2, count, 3))
    joints = np.zeros(4)
    last = np.full(3, np.inf)
    for _ in range(200):
        pivots, axes, middles, frames = [], [], [], []
        turn, here = _turn([0, 0, POSE[0] + joints[0]]), np.zeros(3)
        pivots.append(here)
        axes.append(turn[:, 2])
        here = here + turn @ [0, 0, 0.085]
        turn = turn @ _turn([-np.pi / 2, 0, 0]) @ _turn([0, 0, POSE[1] + joints[1]])
        pivots.append(here)
        axes.append(turn[:, 2])
        for rod in (0, 1):
            step = LENGTHS[rod] / count
            half, whole = _turn(curvatures[rod] * step / 2), _turn(curvatures[rod] * step)
            for k in range(count):
                frame = turn @ half[k]
                middles.append(here + frame[:, 0] * step / 2)
                frames.append(frame)
                here = here + frame[:, 0] * step
                turn = turn @ whole[k]
            turn = turn @ _turn([0, 0, POSE[2 + rod] + joints[2 + rod]])
            pivots.append(here)
            axes.append(turn[:, 2])
        tool = here + turn @ [0, 0, -0.274]
        if np.abs(tool - last).max() < 1e-15:
            break
        last = tool
        # from the tool backwards: mass and first moment of what lies beyond
        mass, first = 3.3 + payload, 3.3 * (here + turn @ [0, 0, -0.137]) + payload * tool
        torques = np.zeros(4)
        torques[3] = axes[3] @ np.cross(first - mass * pivots[3], gravity)
        for rod in (1, 0):
            step, piece = LENGTHS[rod] / count, ROD_MASSES[rod] / count
            for k in reversed(range(count)):
                middle, frame = middles[rod * count + k], frames[rod * count + k]
                beyond, its_first = mass + piece / 2, first + piece / 2 * (middle + frame[:, 0] * step / 4)
                moment = np.cross(its_first - beyond * middle, gravity)
                curvatures[rod, k] = frame.T @ moment / (RIGIDITIES[rod] * stiffness)
                mass, first = mass + piece, first + piece * middle
            torques[rod + 1] = axes[rod + 1] @ np.cross(first - mass * pivots[rod + 1], gravity)
        torques[0] = axes[0] @ np.cross(first - mass * pivots[0], gravity)
        joints = COMPLIANCE / stiffness * torques
    return tool, turn
