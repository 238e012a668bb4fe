"""Numbers of the report: as many digits as the samples support, intervals rounded outwards."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from typing import Final

from precision_pin.outputs.text import ROUNDING
from precision_pin.statistics import Distribution, SpecificationResult, format_supported

__all__ = [
    "MISSING",
    "bracketed",
    "inside",
    "milli",
    "milli_interval",
    "outward",
    "percent",
    "statistic",
    "symbol_of",
    "with_half_width",
]

MISSING: Final = "–"
_DIGITS: Final = 5
_SYMBOLS: Final = {"position": ("d", "mm"), "attitude": ("δ", "mrad")}


def symbol_of(quantity: str) -> tuple[str, str]:
    """Return a quantity's symbol and the unit it is printed in."""
    vector, _, part = quantity.partition(".")
    symbol, unit = _SYMBOLS[vector]
    return (f"|{symbol}|" if part in ("norm", "") else f"{symbol}{part}"), unit


def milli(value: float, digits: int = 6) -> str:
    """Return a length or angle in mm or mrad; what is rounding is zero."""
    return f"{1e3 * value:.{digits}g}" if abs(value) > ROUNDING else "0"


def outward(low: float, high: float, per_si: float = 1e3) -> tuple[str, str]:
    """Return the ends of an interval with two digits of its width, rounded away from each other."""
    if max(abs(low), abs(high)) < ROUNDING:
        return "0", "0"
    ends = [Decimal(end) * Decimal(per_si) for end in (low, high)]
    width = ends[1] - ends[0]
    place = Decimal(1).scaleb(width.adjusted() - 1 if width else ends[1].adjusted() - _DIGITS)
    below, above = (
        end.quantize(place, way) for end, way in zip(ends, (ROUND_FLOOR, ROUND_CEILING), strict=True)
    )  # fmt: skip
    return f"{below + 0:f}", f"{above + 0:f}"


def bracketed(low: float, high: float, per_si: float = 1e3) -> str:
    """Return an interval as ``[low, high]``, rounded outwards."""
    return "[{}, {}]".format(*outward(low, high, per_si))


def milli_interval(distribution: Distribution, level: float) -> str:
    """Return the interval of a quantile in mm or mrad."""
    interval = distribution.quantile_interval(level)
    return MISSING if interval is None else bracketed(*interval)


def statistic(distribution: Distribution, which: str | float) -> str:
    """Return a statistic (``mean``, ``std``, …, or a quantile's probability) in mm or mrad, as far as it is resolved."""
    value = distribution.quantile(which) if isinstance(which, float) else getattr(distribution, which)
    half_width = distribution.half_width(which)
    if value is None or half_width is None:
        return MISSING
    if max(abs(distribution.min), abs(distribution.max)) < ROUNDING:
        return "0"
    return format_supported(1e3 * value, 1e3 * half_width, most=_DIGITS)


def inside(result: SpecificationResult) -> tuple[str, str, str]:
    """Return the share inside a limit and the ends of its interval in per cent; what is printed fits the verdict."""
    low, high = (Decimal(end) * 100 for end in result.interval)
    required = Decimal(f"{100 * result.required:.10g}").normalize()
    # as many digits as the demand has, at least two of the interval's width
    decimals = max(1 - (high - low).adjusted(), -int(required.as_tuple().exponent), 0)
    place = Decimal(1).scaleb(-decimals)
    share = (Decimal(result.probability) * 100).quantize(place, ROUND_HALF_EVEN)
    return f"{share:f}", f"{low.quantize(place, ROUND_FLOOR):f}", f"{high.quantize(place, ROUND_CEILING):f}"


def percent(share: float | None) -> str:
    """Return a share in per cent."""
    return MISSING if share is None else f"{round(100 * share, 2) + 0.0:.2f}"


def with_half_width(value: float, half_width: float, factor: float = 100.0) -> str:
    """Return ``value ± half-width`` with two digits of the half-width, three decimals at most."""
    if half_width <= 0:
        return f"{factor * value:.4g}"
    half = Decimal(half_width) * Decimal(factor)
    place = Decimal(1).scaleb(max(min(half.adjusted() - 1, 0), -3))
    return f"{(Decimal(value) * Decimal(factor)).quantize(place) + 0:f} ± {half.quantize(place, ROUND_CEILING):f}"
