"""Digits of a printed number that the sampling supports.

The last digit printed is the first uncertain one: its place is the smallest power of ten that is at least a fifth of
the interval's half-width. The digit before it is then certain to half a unit, and rounding moves the number by less
than the half-width. If the rounded number lies outside an unsymmetric interval, more digits are printed until it lies
inside. A number whose interval is no wider than rounding is exact and gets a fixed number of digits.
"""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from typing import Final

MOST_DIGITS = 6
"""Digits printed of an exactly known number, such as the largest value seen."""

_ROUNDING: Final = 1e-9
"""Ratio of interval to number below which the number counts as exact."""
_EXACT_DIGITS: Final = 5
"""Place of the last digit of an interval without width, counted from the leading digit."""
_FINEST: Final = 17
"""Significant digits of a double."""


def significant_digits(value: float, half_width: float, *, most: int = MOST_DIGITS) -> int:
    """Return how many significant digits, up to `most`, the interval's half-width (0 if exact) supports."""
    if value == 0:
        return most if half_width == 0 else 0
    return max(0, _leading_place(value) - _last_place(value, half_width, most) + 1)


def format_supported(value: float | None, half_width: float | None, *, most: int = MOST_DIGITS) -> str:
    """Return the value with the digits that its interval supports; ``not resolved`` if either is None."""
    if value is None or half_width is None:
        return "not resolved"
    if value == 0 and half_width == 0:
        return "0"
    return _format_to_place(value, _last_place(value, half_width, most))


def format_inside(value: float | None, interval: tuple[float, float] | None, *, most: int = MOST_DIGITS) -> str:
    """Return the value with the supported digits, rounded to inside the interval; ``not resolved`` without one."""
    if value is None or interval is None:
        return "not resolved"
    half_width = max(value - interval[0], interval[1] - value)
    if half_width <= _ROUNDING * abs(value):
        return format_supported(value, 0.0, most=most)
    place = _last_place(value, half_width, _FINEST)
    finest = _leading_place(value) - _FINEST + 1 if value else place
    while place > finest and not interval[0] <= float(_format_to_place(value, place)) <= interval[1]:
        place -= 1
    return _format_to_place(value, place)


def round_end(end: float, digits: int, *, up: bool) -> float:
    """Return a finite bound rounded up or down to significant digits."""
    # its shortest decimal is rounded, so that 0.3, which is a little less in binary, is kept
    exact = Decimal(repr(float(end)))
    place = Decimal(1).scaleb(exact.adjusted() - digits + 1)
    return float(exact.quantize(place, ROUND_CEILING if up else ROUND_FLOOR))


def format_interval(low: float, high: float, per_si: float = 1.0) -> tuple[str, str]:
    """Return the ends of an interval with two digits of its width, rounded outwards."""
    # the factor `per_si` is applied in decimals, so that no end moves inwards
    ends = [Decimal(end) * Decimal(per_si) for end in (low, high)]
    width = ends[1] - ends[0]
    place = Decimal(1).scaleb(width.adjusted() - 1 if width else ends[1].adjusted() - _EXACT_DIGITS)
    below, above = (end.quantize(place, way) for end, way in zip(ends, (ROUND_FLOOR, ROUND_CEILING), strict=True))
    return f"{below + 0:f}", f"{above + 0:f}"


def format_share(share: float, interval: tuple[float, float], required: float) -> tuple[str, str, str]:
    """Return a share and the ends of its interval in per cent, the ends rounded outwards."""
    # the decimals are those of the required share, and show at least two digits of the interval's width, so that the
    # texts agree with the verdict
    low, high = (Decimal(end) * 100 for end in interval)
    demand = Decimal(f"{100 * required:.10g}").normalize()
    decimals = max(1 - (high - low).adjusted(), -int(demand.as_tuple().exponent), 0)
    place = Decimal(1).scaleb(-decimals)
    inside = (Decimal(share) * 100).quantize(place, ROUND_HALF_EVEN)
    return f"{inside:f}", f"{low.quantize(place, ROUND_FLOOR):f}", f"{high.quantize(place, ROUND_CEILING):f}"


def _format_to_place(value: float, place: int) -> str:
    return f"{round(value, -place) + 0.0:.{max(0, -place)}f}"


def _leading_place(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def _last_place(value: float, half_width: float, most: int) -> int:
    supported = math.ceil(math.log10(half_width / 5)) if half_width > 0 else -math.inf
    shown = _leading_place(value) - most + 1 if value != 0 else -math.inf
    return int(max(supported, shown))
