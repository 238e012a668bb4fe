"""Digits of a printed number that the sampling supports.

The last digit printed is the first uncertain one. Its place is the smallest power of ten that is at least a fifth of the
half-width of the number's interval. The digit before it is then certain to half a unit, and rounding moves the number
by less than the half-width. Where the interval is shorter on one side, the rounded number may still lie outside it;
further digits are then printed until it lies inside.

A number whose interval is no wider than rounding is known exactly and printed with a fixed number of digits.
"""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from typing import Final

MOST_DIGITS = 6
"""Digits printed of a number that is known exactly, such as the largest value seen."""

_ROUNDING: Final = 1e-9
"""Below this ratio of interval to number, the number counts as known exactly."""
_EXACT_DIGITS: Final = 5
"""Place of the last digit of an interval without width, counted from the leading digit."""
_FINEST: Final = 17
"""Significant digits of a double."""


def significant_digits(value: float, half_width: float, *, most: int = MOST_DIGITS) -> int:
    """Return how many significant digits of a value its interval supports, from 0 to `most`.

    Args:
        value: The number, in any unit.
        half_width: Half the width of its interval, in the same unit; 0 for a number known exactly.
        most: Largest number of digits.
    """
    if value == 0:
        return most if half_width == 0 else 0
    return max(0, _leading_place(value) - _last_place(value, half_width, most) + 1)


def format_supported(value: float | None, half_width: float | None, *, most: int = MOST_DIGITS) -> str:
    """Return the value with the digits that its interval supports; ``not resolved`` where it has none.

    Args:
        value, half_width: As in `significant_digits`; None where the samples do not resolve the number or its interval.
        most: Largest number of significant digits.
    """
    if value is None or half_width is None:
        return "not resolved"
    if value == 0 and half_width == 0:
        return "0"
    return _format_to_place(value, _last_place(value, half_width, most))


def format_inside(value: float | None, interval: tuple[float, float] | None, *, most: int = MOST_DIGITS) -> str:
    """Return the value with the digits that its interval supports, rounded to a number inside the interval.

    Args:
        value, interval: The number, and an interval that holds it, in any unit; None where the samples do not resolve
            one of them.
        most: Digits of a number that is known exactly.
    """
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
    """Return an end of an interval, or a bound, rounded up or down to significant digits.

    Args:
        end: Finite. Its shortest decimal is rounded, so that 0.3, which is a little less in binary, is kept.
        digits: How many.
        up: The direction: up for an upper end, down for a lower one.
    """
    exact = Decimal(repr(float(end)))
    place = Decimal(1).scaleb(exact.adjusted() - digits + 1)
    return float(exact.quantize(place, ROUND_CEILING if up else ROUND_FLOOR))


def format_interval(low: float, high: float, per_si: float = 1.0) -> tuple[str, str]:
    """Return the ends of an interval with two digits of its width, rounded away from each other.

    Args:
        low, high: The ends.
        per_si: Factor applied first. The product is computed in decimals, so that no end moves inwards.
    """
    ends = [Decimal(end) * Decimal(per_si) for end in (low, high)]
    width = ends[1] - ends[0]
    place = Decimal(1).scaleb(width.adjusted() - 1 if width else ends[1].adjusted() - _EXACT_DIGITS)
    below, above = (end.quantize(place, way) for end, way in zip(ends, (ROUND_FLOOR, ROUND_CEILING), strict=True))
    return f"{below + 0:f}", f"{above + 0:f}"


def format_share(share: float, interval: tuple[float, float], required: float) -> tuple[str, str, str]:
    """Return a share and the ends of its interval in per cent, the ends rounded outwards.

    The texts have as many decimals as the required share, and at least two digits of the interval's width, so that
    they agree with the verdict.

    Args:
        share, interval: The share inside a limit, and an interval that holds it.
        required: The required share.
    """
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
