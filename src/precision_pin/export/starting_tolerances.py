"""Starting tolerances and poses for an arm known only by its URDF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import Joint

TRIALS: Final = 64
"""Number of poses tried to find a good first one and the load on every joint."""

WIND_UP: Final = 2e-4
"""Turn of a joint, rad, under the load it is sized for."""

GIVE: Final = 2e-5
"""Shift of a sliding joint, m, under the load it is sized for."""

LEAST_SHARE: Final = 0.1
"""Least load that a joint is sized for, as a share of the largest of its kind: wrists carry payloads, too."""

SHORTEST: Final = 0.5e-3
"""Length below which ISO 2768-1 gives no general tolerance, m."""

_FINE: Final = ((6.0, 0.05), (30.0, 0.1), (120.0, 0.15), (400.0, 0.2), (1000.0, 0.3), (2000.0, 0.5))
_MEDIUM_OF_THE_LONGEST: Final = 2.0
_SMALLEST_TILT: Final = 1e-3


def general_tolerance(length: float) -> tuple[float, str]:
    """Return the permissible deviation ± (m) of a length (m) and its class, ISO 2768-1, table 1.

    Class f (fine); above 2 m, where class f ends, class m (medium), whose ±2 mm for up to 4 m is used beyond, too.
    """
    for longest, deviation in _FINE:
        if length * 1e3 <= longest:
            return deviation * 1e-3, "f"
    return _MEDIUM_OF_THE_LONGEST * 1e-3, "m"


def reach(chain: Chain) -> float:
    """Return the sum of the links' lengths, m; 1 m for a chain whose links have none."""
    return float(np.linalg.norm(chain.placements[:, :3, 3], axis=1).sum()) or 1.0


def round_125(value: float) -> float:
    """Return a positive number rounded to 1, 2 or 5 times a power of ten, the nearest by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    nearest = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(value / power / step)))
    return float(f"{nearest * power:.0e}")


@final
@dataclass(frozen=True, eq=False)
class Survey:
    """Figures of a chain from trial poses.

    Attributes
    ----------
    chain
        The chain.
    trials
        Poses within the limits, ``(T, n)``, in ``units``.
    units
        Of each joint's values: deg or m; rad where a joint's limits coincide, so that its value equals them exactly.
    start, far
        The trial that is best conditioned and, of the others, the one whose tip is farthest from the first joint.
    loads
        Largest torque or force of the weights on every joint, ``(n,)``, N·m or N.
    loadable
        Whether a weight beyond the joint can turn or slide it in some pose, ``(n,)``.
    """

    chain: Chain
    trials: Array
    units: tuple[str, ...]
    start: int
    far: int
    loads: Array
    loadable: NDArray[np.bool_]

    @classmethod
    def of(cls, chain: Chain) -> Survey:
        """Try poses all over the joints' ranges.

        The condition of a pose is the smallest singular value of the joint Jacobian, lengths divided by the reach.
        """
        ranges = [_range(joint) for joint in chain.joints]
        units = tuple(unit for _, _, unit in ranges)
        trials = _trials(ranges)
        to_si = np.array([np.pi / 180 if unit == "deg" else 1.0 for unit in units])
        size = reach(chain)
        columns = np.where(chain.prismatic, size, 1.0)
        rows = np.array([1 / size] * 3 + [1.0] * 3)
        gravity = float(np.linalg.norm(chain.gravity))
        down = chain.gravity / gravity if gravity else np.zeros(3)
        conditions, distances, loads, tilts = [], [], [], []
        for values in trials:
            posture = chain.at(values * to_si)
            scaled = rows[:, None] * posture.joint_jacobian * columns
            # rounded, so that no last bit of another machine decides
            conditions.append(round(float(np.linalg.svd(scaled, compute_uv=False)[-1]), 6))
            distances.append(round(float(np.linalg.norm(posture.pose[:3, 3] - posture.joint_poses[0][:3, 3])), 6))
            loads.append(np.abs(posture.load_torque))
            along = np.abs(posture.joint_axes @ down)
            across = np.linalg.norm(np.cross(posture.joint_axes, down), axis=1)
            tilts.append(np.where(chain.prismatic, along, across))
        start = int(np.argmax(conditions))
        distances[start] = -1.0
        loadable = np.max(tilts, axis=0) > _SMALLEST_TILT
        return cls(chain, trials, units, start, int(np.argmax(distances)), np.max(loads, axis=0), loadable)

    @cached_property
    def design_loads(self) -> Array:
        """The load each joint is sized for, N·m or N, ``(n,)``; 0 where no weight can act on it.

        The largest it meets, at least a tenth of the largest on any joint that turns (or slides) like it.
        """
        result = np.zeros(len(self.chain.joints))
        for kind in (self.chain.prismatic, ~self.chain.prismatic):
            alike = kind & self.loadable
            result[alike] = np.maximum(self.loads[alike], LEAST_SHARE * np.max(self.loads[alike], initial=0.0))
        return result


def _trials(ranges: Sequence[tuple[float, float, str]]) -> Array:
    """Return poses ``(T, n)`` over the joints' ranges: a Kronecker sequence, rounded where limits allow it.

    Its steps are the powers of 1/x with x^(n+1) = x + 1 (Roberts 2018, R-sequence).
    """
    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (len(ranges) + 1))
    steps = root ** -np.arange(1, len(ranges) + 1)
    fractions = (0.5 + np.outer(np.arange(1, TRIALS + 1), steps)) % 1.0
    columns = []
    for (centre, half, _), fraction in zip(ranges, fractions.T, strict=True):
        values = centre + half * (2 * fraction - 1)
        columns.append(np.round(values, _decimals(half)) if half else values)
    return np.array(columns).T


def _range(joint: Joint) -> tuple[float, float, str]:
    """Return centre, half-width and unit of a joint's usable range: at most ±60 deg or ±0.2 m about the middle."""
    lower, upper = (-math.inf, math.inf) if joint.limit is None else (joint.limit.lower, joint.limit.upper)
    slides = joint.kind == "prismatic"
    if lower == upper:
        return lower, 0.0, "m" if slides else "rad"
    most = 0.2 if slides else 60.0
    if not slides:
        lower, upper = math.degrees(lower), math.degrees(upper)
    if not math.isfinite(lower):
        lower = min(-most, upper - 2 * most)
    if not math.isfinite(upper):
        upper = max(most, lower + 2 * most)
    return (lower + upper) / 2, min(0.8 * (upper - lower) / 2, most), "m" if slides else "deg"


def _decimals(half: float) -> int:
    """Return how many decimals keep a value within limits that are a quarter of ``half`` or more away from it."""
    return max(0, math.ceil(-math.log10(half / 4)))
