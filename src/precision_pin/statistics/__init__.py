"""Constant-memory statistics of the pose error.

A `Plan` holds the centre to subtract and the scale of the bins. `start` returns an empty `State`, `observe`
adds a block of errors ``(6, N)``, `merge` joins two states, and `finish` turns a state into a `Summary`.
The size of the state does not depend on the number of samples. Its counts do not depend on how the samples
are divided into blocks; its sums depend on that by rounding only.

The eight quantities, always in this order: ``position.norm``, ``position.x``, ``.y``, ``.z`` (m),
``attitude.norm``, ``attitude.x``, ``.y``, ``.z`` (rad), components in base axes.
"""

from precision_pin.statistics.accumulate import LARGEST, State, largest_of, merge, observe, quantity_values, start
from precision_pin.statistics.digits import format_inside, format_share, format_supported, significant_digits
from precision_pin.statistics.distribution import Distribution, Histogram
from precision_pin.statistics.intervals import (
    check_confidence,
    clopper_pearson,
    quantile_coverage,
    quantile_ranks,
    tolerance_ranks,
    upper_bound_rank,
)
from precision_pin.statistics.plan import Plan, Specification
from precision_pin.statistics.quantities import COMPONENTS, NORMS, QUANTITIES, quantity_name
from precision_pin.statistics.sketch import BINS, COLUMNS, sketch_columns, sketch_edges
from precision_pin.statistics.summary import NO_SPREAD, Extreme, Summary, VectorDistribution, finish
from precision_pin.statistics.verdicts import NO_GROUNDS, Grounds, SpecificationResult, Verdict, judge

__all__ = [
    "BINS",
    "COLUMNS",
    "COMPONENTS",
    "LARGEST",
    "NORMS",
    "NO_GROUNDS",
    "NO_SPREAD",
    "QUANTITIES",
    "Distribution",
    "Extreme",
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
    "format_supported",
    "judge",
    "largest_of",
    "merge",
    "observe",
    "quantile_coverage",
    "quantile_ranks",
    "quantity_name",
    "quantity_values",
    "significant_digits",
    "sketch_columns",
    "sketch_edges",
    "start",
    "tolerance_ranks",
    "upper_bound_rank",
]
