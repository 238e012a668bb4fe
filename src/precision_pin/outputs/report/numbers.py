"""Numbers of the report: as many digits as the samples support, intervals rounded outwards."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Final

from precision_pin.display import tables
from precision_pin.display.tables import ROUNDING
from precision_pin.outputs.monte_carlo import table
from precision_pin.statistics import Distribution

__all__ = ["MISSING", "bracketed", "milli_interval", "outward", "percent", "shown", "statistic"]

MISSING: Final = "–"
_DIGITS: Final = 5


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
    return shown(table.statistic(distribution, which))


def percent(share: float | None) -> str:
    """Return a share in per cent."""
    return shown(tables.percent(share))


def shown(cell: str) -> str:
    """Return a cell of a table for a terminal as the report has it."""
    return MISSING if cell == "-" else cell
