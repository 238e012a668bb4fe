"""Numbers of the report: as many digits as the samples support, intervals rounded outwards."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.monte_carlo import table
from precision_pin.render import tables
from precision_pin.render.tables import ROUNDING
from precision_pin.statistics import Distribution
from precision_pin.statistics.digits import format_interval

MISSING: Final = "–"


def outward(low: float, high: float, per_si: float = 1e3) -> tuple[str, str]:
    """Return the ends of an interval as text, rounded outwards; an interval of rounding errors is 0."""
    if max(abs(low), abs(high)) < ROUNDING:
        return "0", "0"
    return format_interval(low, high, per_si)


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
