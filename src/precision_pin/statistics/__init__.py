"""Constant-memory statistics of the pose error.

A `Plan` holds the centre to subtract and the scale of the bins. `start` returns an empty `State`, `observe` adds a
block of errors ``(6, N)``, and `finish` turns a state into a `Summary`. Counts do not depend on how the samples are
divided into blocks; sums do, by rounding only.

The eight quantities, always in this order: ``position.norm``, ``position.x``, ``.y``, ``.z`` (m), ``attitude.norm``,
``attitude.x``, ``.y``, ``.z`` (rad), components in base axes.
"""

from precision_pin.statistics.accumulate import State, observe, quantity_values, start
from precision_pin.statistics.digits import format_inside, format_share
from precision_pin.statistics.distribution import Distribution, Histogram
from precision_pin.statistics.intervals import check_confidence, clopper_pearson, quantile_ranks
from precision_pin.statistics.plan import Plan, Specification
from precision_pin.statistics.quantities import COMPONENTS, NORMS, QUANTITIES
from precision_pin.statistics.summary import NO_SPREAD, Summary, VectorDistribution, finish
from precision_pin.statistics.verdicts import NO_GROUNDS, Grounds, SpecificationResult, Verdict, judge

__all__ = [
    "COMPONENTS",
    "NORMS",
    "NO_GROUNDS",
    "NO_SPREAD",
    "QUANTITIES",
    "Distribution",
    "Grounds",
    "Histogram",
    "Plan",
    "Specification",
    "SpecificationResult",
    "State",
    "Summary",
    "VectorDistribution",
    "Verdict",
    "check_confidence",
    "clopper_pearson",
    "finish",
    "format_inside",
    "format_share",
    "judge",
    "observe",
    "quantile_ranks",
    "quantity_values",
    "start",
]
