"""Standard tolerance grades of ISO 286-1:2010, table 1: widths in micrometres by grade and nominal size."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from typing import Final

from precision_pin.base.errors import InputError, UnknownNameError

SIZES: Final = (
    3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500, 630, 800, 1000, 1250, 1600, 2000, 2500, 3150,
)  # fmt: skip
"""Largest nominal size of each step, mm; a step begins above the largest size of the one before."""

GRADES: Final[Mapping[str, tuple[int, ...]]] = {
    "IT5": (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27, 32, 36, 40, 47, 55, 65, 78, 96),
    "IT6": (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40, 44, 50, 56, 66, 78, 92, 110, 135),
    "IT7": (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63, 70, 80, 90, 105, 125, 150, 175, 210),
    "IT8": (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97, 110, 125, 140, 165, 195, 230, 280, 330),
    "IT9": (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155, 175, 200, 230, 260, 310, 370, 440, 540),
    "IT10": (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250, 280, 320, 360, 420, 500, 600, 700, 860),
    "IT11": (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400, 440, 500, 560, 660, 780, 920, 1100, 1350),
    "IT12": (
        100, 120, 150, 180, 210, 250, 300, 350, 400, 460, 520, 570, 630, 700, 800, 900, 1050, 1250, 1500, 1750, 2100,
    ),
}  # fmt: skip
"""Width of the tolerance zone, µm, by step of nominal size."""

LARGEST: Final = SIZES[-1] * 1e-3
"""Largest nominal size of the table, m."""


def grade_width(grade: str, size: float) -> float:
    """Return the width of the tolerance zone, m, of a grade for a nominal size, m.

    Raises
    ------
    UnknownNameError
        Another grade than IT5 to IT12.
    InputError
        A size that is not positive, or beyond the table.
    """
    if grade not in GRADES:
        raise UnknownNameError("ISO 286 grade", grade, tuple(GRADES))
    # a size such as 80 mm belongs to the step that ends with it, whatever its last digit in binary
    rounded = round(size * 1e3, 9)
    if not 0 < rounded <= SIZES[-1]:
        raise InputError(f"a nominal size of ISO 286 is above 0 and at most {SIZES[-1]} mm, got {rounded:g} mm")
    return GRADES[grade][bisect_left(SIZES, rounded)] * 1e-6
