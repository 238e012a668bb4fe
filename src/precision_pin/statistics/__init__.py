"""Constant-memory statistics of the pose error.

A `Plan` holds the centre to subtract and the scale of the bins. `start` returns an empty `State`, `observe` adds a
block of errors ``(6, N)``, and `finish` turns a state into a `Summary`. Counts do not depend on how the samples are
divided into blocks; sums do, by rounding only.

The eight quantities, always in this order: ``position.norm``, ``position.x``, ``.y``, ``.z`` (m), ``attitude.norm``,
``attitude.x``, ``.y``, ``.z`` (rad), components in base axes.
"""

from precision_pin.statistics.accumulate import State, observe, quantity_values, start
from precision_pin.statistics.distribution import Distribution, Histogram
from precision_pin.statistics.intervals import (
    check_confidence,
    clopper_pearson,
    format_inside,
    format_share,
    quantile_ranks,
)
from precision_pin.statistics.plan import COMPONENTS, NORMS, QUANTITIES, Plan, Specification
from precision_pin.statistics.sample_law import SampleLaw
from precision_pin.statistics.summary import (
    NO_GROUNDS,
    NO_SPREAD,
    Grounds,
    SpecificationResult,
    Summary,
    VectorDistribution,
    Verdict,
    finish,
    judge,
)

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
    "SampleLaw",
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
