"""How large things are drawn: the arm's size, the exaggeration, and the colours of error sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.robot.chain import Posture
from precision_pin.typing import Array

__all__ = ["DEFAULT_POINTS", "MOST_POINTS", "MOST_POSES", "ColourScale", "arm_length", "default_factor", "round_number"]


DEFAULT_POINTS: Final = 20_000
"""Default number of samples in the cloud."""

MOST_POINTS: Final = 100_000
"""The most it can show, all poses together: larger pages open slowly."""

MOST_POSES: Final = 200
"""The most poses of one page."""

# share of the arm's length that the drawn cloud spans, and that it may stand away from the nominal tip
_SPREAD: Final = 0.07
_OFFSET: Final = 0.3
_STOPS: Final = 17


def arm_length(posture: Posture) -> float:
    """Return the length (m) of the way from base over all joints to the tip; 1 m for an arm that has none."""
    points = np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]])
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return length if length > 1e-9 else 1.0


def round_number(value: float) -> float:
    """Return the number 1, 2 or 5 times a power of ten that is nearest to a positive value in proportion."""
    power = math.floor(math.log10(value))
    candidates = [float(f"{digit}e{exponent}") for exponent in (power, power + 1) for digit in (1, 2, 5)]
    return min(candidates, key=lambda candidate: abs(math.log(candidate / value)))


def default_factor(positions: ArrayLike, length: float) -> float:
    """Return a round exaggeration (1, 2 or 5 times a power of ten, at least 1).

    Parameters
    ----------
    positions
        Position errors ``(3, N)``, m.
    length
        The arm's, m.

    Returns
    -------
    float
        Drawn so, the cloud spans about 7 % of the arm (4.4 to 11 %, by rounding): two standard deviations to either
        side along its widest direction. It is less where the mean error would else stand farther than about 30 % of
        the arm's length away from the nominal tip.
    """
    errors = np.asarray(positions, dtype=float)
    mean = errors.mean(axis=1)
    deviations = np.linalg.svd(errors - mean[:, None], compute_uv=False) / math.sqrt(errors.shape[1])
    wanted = [_SPREAD * length / (4 * deviations[0])] if deviations[0] > 1e-15 * length else []
    offset = float(np.linalg.norm(mean))
    if offset > 1e-15 * length:
        wanted.append(_OFFSET * length / offset)
    return max(1.0, round_number(min(wanted))) if wanted else 1.0


@final
@dataclass(frozen=True)
class ColourScale:
    """Sizes of position errors as colours of matplotlib's viridis, light for small, dark for large.

    Viridis is perceptually uniform and safe for colour-blind readers; its lightest tenth, faint on a light ground, is
    left out.

    Attributes
    ----------
    smallest, largest
        Ends of the scale, m.
    """

    smallest: float
    largest: float

    @classmethod
    def of(cls, sizes: ArrayLike) -> ColourScale:
        """Return the scale from the smallest to the largest of ``(N,)`` sizes, m."""
        values = np.asarray(sizes, dtype=float)
        smallest, largest = float(values.min()), float(values.max())
        # what differs by rounding only has one size
        return cls(smallest if largest - smallest > 1e-9 * largest else largest, largest)

    @property
    def stops(self) -> tuple[str, ...]:
        """The colours as CSS writes them, at equal distances from the smallest to the largest size."""
        colours = np.rint(255 * _viridis(np.linspace(0, 1, _STOPS))).astype(int)
        return tuple(f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colours)

    @property
    def unit(self) -> tuple[str, float]:
        """The unit of the labels, mm, or µm where all sizes are below 0.1 mm, and how many of it make a metre."""
        return ("µm", 1e6) if self.largest < 1e-4 else ("mm", 1e3)

    @property
    def ticks(self) -> tuple[str, ...]:
        """Labels, without the unit, for equal distances from the smallest to the largest size; one if these are equal."""
        per_metre = self.unit[1]
        values = np.linspace(self.smallest, self.largest, 5 if self.largest > self.smallest else 1) * per_metre
        step = (self.largest - self.smallest) * per_metre / 4 or self.largest * per_metre / 10
        decimals = min(6, max(0, 1 - math.floor(math.log10(step)))) if step > 0 else 0
        return tuple(f"{value:.{decimals}f}" for value in values)


def _viridis(shares: ArrayLike) -> Array:
    # imported late: matplotlib costs a third of a second
    from matplotlib import colormaps

    colours: Array = colormaps["viridis"](0.9 * (1 - np.asarray(shares, dtype=float)))[..., :3]
    return colours
