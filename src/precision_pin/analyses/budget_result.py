"""What a budget found."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, final

from precision_pin.analyses.heading import Heading, PoseHeading

__all__ = [
    "SCHEMA",
    "VECTORS",
    "BudgetResult",
    "DrawShare",
    "Estimate",
    "Group",
    "Halved",
    "PlaceShare",
    "PoseBudget",
    "Shares",
    "SourceShare",
    "Sums",
]

SCHEMA: Final = "precision-pin/budget/1"

VECTORS: Final = ("position", "attitude")
"""Quantities of all three components: the variance is E|d - E d|², the trace of the covariance."""

ASSUMPTIONS: Final = (
    "share: closed form, tangent model at the means; of position and attitude: share of the trace of the covariance",
    "share of correlated draws or components: Shapley effects of the linear model",
    "first, total: Sobol indices of the exact model; intervals are for each number by itself",
    "a draw that several sources name is a line of its own among the sources",
    "joints and links: covariance of their part with the whole, negative where one undoes what others do",
    "worst_case: share of the half-width of the first-order range of a component; unbounded laws reach bound_at deviations",
    "halved: the draw's deviation from its mean is halved, all else unchanged; std in closed form, quantile sampled",
)

Shares = Mapping[str, float | None]
"""Shares by quantity: position, attitude, position.x … attitude.z; None where the quantity does not vary."""


@final
@dataclass(frozen=True)
class Estimate:
    """A sampled number with its interval."""

    value: float
    interval: tuple[float, float]

    @property
    def half_width(self) -> float:
        """Half the width of the interval."""
        return (self.interval[1] - self.interval[0]) / 2


@final
@dataclass(frozen=True)
class Halved:
    """What halving one draw's tolerance gives.

    Attributes
    ----------
    std
        New standard deviations, m and rad, closed form; of position and attitude the root of the trace.
    quantile
        New quantile of |d| and |δ|, m and rad, by ``position.norm`` and ``attitude.norm``.
    change
        How much less or more that is, same random numbers.
    """

    std: Mapping[str, float]
    quantile: Mapping[str, Estimate]
    change: Mapping[str, Estimate]


@final
@dataclass(frozen=True)
class DrawShare:
    """One draw's part.

    Attributes
    ----------
    name, scope
        The draw.
    unbounded
        Whether its reach is infinite somewhere, and was taken at ``bound_at`` standard deviations.
    share
        Of the variance, closed form; Shapley effects where draws are correlated.
    components
        The same for each of several numbers drawn together, by name.
    reach
        Half-width of what it does to each component at the most, first order, m and rad.
    worst_case
        Share of the sum of all draws' reaches.
    halved
        What a tolerance half as wide would give.
    """

    name: str
    scope: str
    unbounded: bool
    share: Shares
    components: Mapping[str, Shares]
    reach: Mapping[str, float]
    worst_case: Shares
    halved: Halved


@final
@dataclass(frozen=True)
class Group:
    """Sobol indices of a draw, or of several that are correlated with one another.

    Attributes
    ----------
    draws
        Which.
    share
        Closed form.
    first, total
        Of the exact model, by quantity: the two vectors, norms and components.
    nonlinear
        Quantities of which index and closed form differ by more than one percentage point beside the interval.
    """

    draws: tuple[str, ...]
    share: Shares
    first: Mapping[str, Estimate | None]
    total: Mapping[str, Estimate | None]
    nonlinear: tuple[str, ...]


@final
@dataclass(frozen=True)
class SourceShare:
    """A source's own draws, or one draw that several sources (or none) name."""

    sources: tuple[str, ...]
    draws: tuple[str, ...]
    share: Shares


@final
@dataclass(frozen=True)
class PlaceShare:
    """What happens at a joint or on a chain link."""

    name: str
    share: Shares


@final
@dataclass(frozen=True)
class Sums:
    """The sum checks of one quantity.

    Attributes
    ----------
    closed
        Sum of the closed-form shares: 1 to rounding.
    first
        Sum of the first-order indices: 1 where the exact model has no interactions, less where it has.
    std
        Standard deviation of the tangent model, m or rad.
    variance
        Variance of the exact model, sampled.
    """

    closed: float | None
    first: Estimate | None
    std: float | None
    variance: Estimate


@final
@dataclass(frozen=True)
class PoseBudget:
    """The budget at one pose.

    Attributes
    ----------
    pose
        Which.
    nominal
        Error with every parameter at its mean, ``[d; δ]``.
    std
        Standard deviations of the tangent model, m and rad.
    quantile
        Quantile of |d| and |δ| of the exact model.
    reach
        Half-width of the range of every component, first order.
    draws, groups, sources, places
        Who causes how much.
    sums
        Sum checks by quantity.
    warnings
        One line each.
    """

    pose: PoseHeading
    nominal: tuple[float, ...]
    std: Mapping[str, float]
    quantile: Mapping[str, Estimate]
    reach: Mapping[str, float]
    draws: tuple[DrawShare, ...]
    groups: tuple[Group, ...]
    sources: tuple[SourceShare, ...]
    places: tuple[PlaceShare, ...]
    sums: Mapping[str, Sums]
    warnings: tuple[str, ...]

    def draw(self, name: str) -> DrawShare:
        """Return a draw's line."""
        return next(line for line in self.draws if line.name == name)

    def group(self, name: str) -> Group:
        """Return the group that a draw belongs to."""
        return next(line for line in self.groups if name in line.draws)


@final
@dataclass(frozen=True)
class BudgetResult:
    """Error budgets of a model.

    Attributes
    ----------
    heading
        Of what, with which seed.
    samples, confidence, bound_at, marked
        How it was computed: points in each set, confidence of every interval, standard deviations that unbounded laws
        reach, probability of the quantiles.
    poses
        One budget each.
    """

    heading: Heading
    samples: int
    confidence: float
    bound_at: float
    marked: float
    poses: tuple[PoseBudget, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as the ``precision-pin/budget/1`` schema has it, SI units, base axes."""
        return {
            **self.heading.to_dict(SCHEMA),
            "samples": self.samples,
            "confidence": self.confidence,
            "bound_at": self.bound_at,
            "marked": self.marked,
            "assumptions": list(ASSUMPTIONS),
            "poses": [dataclasses.asdict(one) | {"pose": one.pose.to_dict()} for one in self.poses],
        }

    def to_json(self) -> str:
        """Return :meth:`to_dict` as text; what does not vary or is not resolved is null."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)
