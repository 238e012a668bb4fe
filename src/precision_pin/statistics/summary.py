"""Summary of the accumulated samples."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from statistics import NormalDist
from typing import ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array, Keys, Record, returns_read_only
from precision_pin.base.errors import InternalError, visible
from precision_pin.statistics.accumulate import State, sketch_edges
from precision_pin.statistics.distribution import Distribution
from precision_pin.statistics.intervals import check_confidence, clopper_pearson
from precision_pin.statistics.limits import moves
from precision_pin.statistics.plan import COMPONENTS, NORMS, QUANTITIES, Plan, Specification, is_joint, quantity_name

NO_SPREAD: Final = 1e-12
"""Differences below this value (m, rad) count as rounding: some thousand roundings of coordinates of metres (2e-16)."""


@dataclass(frozen=True, eq=False)
class VectorDistribution(Record):
    """Distributions of the norm and the components of a three-vector."""

    norm: Distribution
    x: Distribution
    y: Distribution
    z: Distribution


@dataclass(frozen=True)
class Extreme:
    """One of the largest errors: index of its sample, which is the seed's robot, and |d| in m or |δ| in rad."""

    sample: int
    value: float


@dataclass(frozen=True, eq=False)
class Summary(Record):
    """Statistics of the sampled pose error, base axes.

    Attributes:
        position: |d|, dx, dy, dz in m.
        attitude: |δ|, δx, δy, δz in rad.
        mean: ``(6,)`` mean error [d; δ].
        covariance: ``(6, 6)`` sample covariance, divisor N − 1; None for a single sample.
        varying: Which of the eight `QUANTITIES` differ from robot to robot.
        specifications: One result for each specification of the plan.
        largest_position, largest_attitude: The ten (or fewer) samples with the largest |d| and |δ|, descending.
    """

    KEYS: ClassVar[Keys] = (
        *("samples", "confidence", "position", "attitude", "covariance"),
        *("covariance_interval=_covariance_intervals", "spec=specifications"),
    )

    samples: int
    confidence: float
    position: VectorDistribution
    attitude: VectorDistribution
    mean: Array
    covariance: Array | None
    varying: tuple[bool, ...]
    specifications: tuple[SpecificationResult, ...]
    largest_position: tuple[Extreme, ...]
    largest_attitude: tuple[Extreme, ...]

    def with_grounds(self, grounds: Grounds) -> Summary:
        """Return the statistics with these grounds of the verdicts on the specifications."""
        return replace(self, specifications=tuple(replace(result, grounds=grounds) for result in self.specifications))

    @cached_property
    @returns_read_only
    def covariance_interval(self) -> Array | None:
        """Endpoints of the intervals of the covariances, ``(6, 6, 2)``, NaN if not resolved; None for one sample.

        The accumulated statistics only bound the variance of (x - E x)(y - E y), by Cauchy-Schwarz: at most the root of
        the product of the fourth moments minus the square of the covariance. The intervals therefore cover more often
        than stated, the more so the less x and y are correlated; for proportional x and y they equal those of the
        variances.
        """
        if self.covariance is None:
            return None
        parts = [self.distribution(QUANTITIES[row]).moments for row in COMPONENTS]
        intervals = np.full((6, 6, 2), np.nan)
        resolved = [k for k, part in enumerate(parts) if part.variance_interval is not None]
        for i, j in itertools.product(resolved, resolved):
            first, second, covariance = parts[i], parts[j], self.covariance[i, j]
            fourth = math.sqrt(first.fourth_moment * second.fourth_moment)
            spread = math.sqrt(max(fourth - covariance**2, 0.0) / first.samples)
            half = max(first.standard_errors, second.standard_errors) * spread
            half += first.mean_half_width * second.mean_half_width
            intervals[i, j] = first.variance_interval if i == j else (covariance - half, covariance + half)
        return intervals

    def distribution(self, quantity: str) -> Distribution:
        """Return the distribution of a quantity by any of its names, or raise UnknownNameError."""
        vector, part = quantity_name(quantity).split(".")
        return getattr(self.position if vector == "position" else self.attitude, part)

    @property
    def _covariance_intervals(self) -> list[list[list[float] | None]] | None:
        ends = self.covariance_interval
        return None if ends is None else [[None if np.isnan(b).any() else b.tolist() for b in row] for row in ends]


def varying_quantities(state: State, first_order: Array | None = None) -> NDArray[np.bool_]:
    """Return a mask ``(8,)`` of the quantities that vary, in the samples or to first order.

    ``first_order`` ``(6, 6)`` is the first-order covariance of the error; it includes rare values beyond the samples.
    """
    varying: NDArray[np.bool_] = state.highest - state.lowest > NO_SPREAD
    components = varying[list(COMPONENTS)]
    if first_order is not None:
        components = components | (np.sqrt(np.maximum(np.diag(first_order), 0.0)) > NO_SPREAD)
    return varying | with_norms(components)


def with_norms(components: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the eight quantities vary, ``(8, …)``, given which components do, ``(6, …)``.

    A norm counts as varying with its components: errors on a circle have a constant norm.
    """
    varying = np.zeros((8, *components.shape[1:]), dtype=np.bool_)
    varying[list(COMPONENTS)] = components
    varying[list(NORMS)] = components.reshape(2, 3, *components.shape[1:]).any(axis=1)
    return varying


def is_varying(
    specification: Specification, varying: NDArray[np.bool_], tool_axes: ArrayLike, covariances: Sequence[Array | None]
) -> bool:
    """Return whether a specification's quantity varies, given which of the eight do ``(8,)``, and covariances."""
    if specification.row is not None:
        return bool(varying[specification.row])
    conditions = specification.conditions(tool_axes)
    return any(of is not None and moves(conditions, of, NO_SPREAD) for of in covariances)


def finish(plan: Plan, state: State, confidence: float = 0.95, *, first_order: Array | None = None) -> Summary:
    """Return the summary of the accumulated samples.

    Args:
        confidence: Confidence of every interval, between 0 and 1.
        first_order: As for :func:`varying_quantities`.

    Raises:
        InputError: The confidence lies outside 0 to 1.
        InternalError: The state has no samples or belongs to another plan.
    """
    check_confidence(confidence)
    if state.count < 1:
        raise InternalError("no samples to summarise")
    if state.inside.size != len(plan.specifications):
        raise InternalError(f"a state of {state.inside.size} specifications for a plan of {len(plan.specifications)}")
    varying = varying_quantities(state, first_order)
    means = np.clip(plan.centre + state.sums / state.count, state.lowest, state.highest)
    covariance = _covariance(state)
    deviations = None if covariance is None else _deviations(state, covariance)
    edges, columns = sketch_edges(), [np.flatnonzero(counts) for counts in state.sketch]
    distributions = []
    for row, (quantity, occupied) in enumerate(zip(QUANTITIES, columns, strict=True)):
        cumulative = np.cumsum(state.sketch[row, occupied])
        if state.sketch[row].sum() != state.count:
            raise InternalError(f"the sketch of {quantity} holds {state.sketch[row].sum()} of {state.count} samples")
        lowest, highest = float(state.lowest[row]), float(state.highest[row])
        lower, upper = (
            np.clip(plan.centre[row] + plan.scale[row] * edges[ends], lowest, highest)
            for ends in (occupied, occupied + 1)
        )
        std = None if deviations is None else float(deviations[row])
        skewness = float(plan.skewness[row, 0]), float(plan.skewness[row, 1])
        moments = float(means[row]), std, lowest, highest
        distributions.append(
            Distribution(quantity, state.count, confidence, *moments, lower, upper, cumulative, skewness=skewness)
        )
    results = []
    for spec, inside in zip(plan.specifications, state.inside.tolist(), strict=True):
        interval = clopper_pearson(inside, state.count, confidence)
        share, varies = inside / state.count, is_varying(spec, varying, plan.tool_axes, (covariance, first_order))
        results.append(SpecificationResult(spec.quantity, spec.limit, spec.required, share, interval, varies))
    return Summary(
        samples=state.count,
        confidence=confidence,
        position=VectorDistribution(*distributions[:4]),
        attitude=VectorDistribution(*distributions[4:]),
        mean=means[list(COMPONENTS)],
        covariance=covariance,
        varying=tuple(map(bool, varying)),
        specifications=tuple(results),
        largest_position=_extremes(state, 0),
        largest_attitude=_extremes(state, 1),
    )


def _extremes(state: State, row: int) -> tuple[Extreme, ...]:
    pairs = zip(state.largest_units[row].tolist(), state.largest[row].tolist(), strict=True)
    return tuple(Extreme(sample, value) for sample, value in pairs if sample >= 0)


def _covariance(state: State) -> Array | None:
    """Return the sample covariance of the components; rows of constant components are exactly zero."""
    if state.count < 2:
        return None
    components = list(COMPONENTS)
    sums = state.sums[components]
    covariance = (state.products - np.outer(sums, sums) / state.count) / (state.count - 1)
    constant = state.lowest[components] == state.highest[components]
    covariance[constant, :] = 0.0
    covariance[:, constant] = 0.0
    np.fill_diagonal(covariance, np.maximum(np.diagonal(covariance), 0.0))
    return covariance


def _deviations(state: State, covariance: Array) -> Array:
    """Return the ``(8,)`` sample standard deviations."""
    variances = np.zeros(8)
    variances[list(COMPONENTS)] = np.diagonal(covariance)
    norms = list(NORMS)
    squares = state.norm_squares - state.sums[norms] ** 2 / state.count
    constant = state.lowest[norms] == state.highest[norms]
    variances[norms] = np.where(constant, 0.0, np.maximum(squares, 0.0) / (state.count - 1))
    return np.sqrt(variances)


Verdict = Literal["met", "not met", "not judged", "undecided", "nothing to judge"]


def judge(*, holds: bool, fails: bool, varies: bool = True) -> Verdict:
    """Return the verdict on a specification.

    Args:
        holds, fails: Whether the whole interval of the probability is at least the required probability, or below it.
        varies: Whether the quantity differs from robot to robot. If not, no tolerance acts on it, and a value inside
            the limit proves nothing.
    """
    if fails:
        return "not met"
    if not varies:
        return "nothing to judge"
    return "met" if holds else "undecided"


def capability_index(inside: float) -> float:
    """Return Φ⁻¹(P)/3: the Cpk of a normal characteristic with one limit and the fraction P inside it.

    This is a third of the benchmark Z of process capability (Bothe, *Measuring Process Capability*, 1997). It depends
    on the fraction alone, so it applies to any distribution, and to two limits, whose tails are added. 1 is 99.865 %,
    1.33 is 99.9968 %; infinite for a fraction of 0 or 1.
    """
    if not 0 < inside < 1:
        return math.copysign(math.inf, inside - 0.5)
    return NormalDist().inv_cdf(inside) / 3


@dataclass(frozen=True)
class Grounds(Record):
    """Conditions of a verdict other than the samples.

    Attributes:
        not_judged: Reason for no verdict, such as a joint outside its limits; empty if a verdict can be given.
        exact: Sources and parameters whose laws a change of the sheet has replaced by single values.
        both: Absolute values ``(n,)`` of the specified quantities of the same robots by the sampled model and by a better
            one; a result converts them to ``linear``, the text of their difference.
        sampled, better: What they are called in messages.
        decides: Whether the better model gives the verdict where the sampled one is too coarse for it.
        remedy: Option that gives a verdict.
    """

    KEYS: ClassVar[Keys] = ("judged=_judged", "why_not_judged=_reason", "taken_as_exact=exact", "linear_model=linear")

    not_judged: str = ""
    exact: tuple[str, ...] = ()
    both: tuple[Mapping[str, Array], Mapping[str, Array]] | None = field(default=None, compare=False, repr=False)
    linear: str | None = None
    remedy: str = "--beyond-limits gives a verdict"
    sampled: str = "the linear model"
    better: str = "the exact one"
    decides: bool = False

    def of_linear(self, result: SpecificationResult) -> Grounds:
        """Return the grounds of a result of a simpler model, not judged if the better one may give another verdict."""
        assert self.both is not None
        linear, exact = (values[result.quantity] for values in self.both)
        is_inside, gap = linear <= result.limit, float(np.abs(linear - exact).max())
        is_crossing = is_inside != (exact <= result.limit)
        unit = "mrad" if result.quantity.startswith("attitude") else "mm"
        size = f"{gap:.3g} of the limits" if is_joint(result.quantity) else f"{1e3 * gap:.3g} {unit}"
        text = f"{size} from {self.better}, {is_crossing.sum():,} of {is_inside.size:,} robots on the other side"
        # upper bounds of the fractions of robots that leave, or enter, the limits
        leaving, entering = (
            clopper_pearson(int((is_crossing & side).sum()), is_inside.size, 0.95)[1] if gap > NO_SPREAD else 0.0
            for side in (is_inside, ~is_inside)
        )
        low, high = result.interval
        changes = {"met": low - leaving < result.required, "not met": high + entering >= result.required}
        if not changes.get(result.verdict, False):
            return replace(self, both=None, linear=text)
        reason = f"{self.sampled} is up to {text}"
        return replace(self, both=None, linear=text, not_judged=reason, remedy="--model exact judges")

    def said(self, verdict: Verdict) -> str:
        """Return a verdict in capitals, with the reason for no verdict or the tolerances taken as exact."""
        if verdict == "not judged":
            return f"NOT JUDGED: {self.why}"
        return f"{verdict.upper()}{self.taken if verdict == 'met' else ''}"

    @property
    def why(self) -> str:
        """Reason for no verdict, and the option that gives one; empty if a verdict can be given."""
        return f"{self.not_judged}; {self.remedy}" if self.not_judged else ""

    @property
    def taken(self) -> str:
        """Text after the word "met": `` by the linear model …`` or `` with … taken as exact``, or empty."""
        linear = f" by {self.sampled}, up to {self.linear}" if self.linear else ""
        return linear + (f" with {', '.join(map(visible, self.exact))} taken as exact" if self.exact else "")

    @property
    def _judged(self) -> bool:
        return not self.not_judged

    @property
    def _reason(self) -> str | None:
        return self.not_judged or None


NO_GROUNDS: Final = Grounds()
"""For a verdict that rests on the samples alone."""


@final
@dataclass(frozen=True)
class SpecificationResult(Record):
    """Result of a specification: the fraction of samples inside its limit.

    Attributes:
        quantity, limit, required: The specification; several limits at once have their text as quantity, and limit 1.
        probability: Fraction of samples with |quantity| ≤ limit (of several: that keep all), counted exactly; or of the
            robots of a better model, where that decides (:class:`Grounds`).
        interval: Clopper-Pearson interval of the probability.
    """

    KEYS: ClassVar[Keys] = (
        *("quantity", "limit", "required", "probability", "interval", "met", "verdict", "*grounds"),
        *("cpk", "cpk_interval"),
    )

    quantity: str
    limit: float
    required: float
    probability: float
    interval: tuple[float, float]
    varies: bool = True
    grounds: Grounds = NO_GROUNDS

    def __post_init__(self) -> None:
        if self.grounds.both is not None:
            grounds, better = self.grounds.of_linear(self), self.grounds.both[1][self.quantity]
            if self.grounds.decides and grounds.not_judged and not self.grounds.not_judged:
                inside = int((better <= self.limit).sum())
                object.__setattr__(self, "probability", inside / better.size)
                object.__setattr__(self, "interval", clopper_pearson(inside, better.size, 0.95))
                grounds = replace(grounds, not_judged="")
            object.__setattr__(self, "grounds", grounds)

    @property
    def verdict(self) -> Verdict:
        """Verdict on the specification.

        ``"met"`` if the lower endpoint of the interval is at least the required probability, ``"not met"`` if the upper
        endpoint is below it, otherwise ``"undecided"``; ``"nothing to judge"`` if the quantity is inside but does not
        vary; ``"not judged"`` if :attr:`grounds` give a reason, whatever the samples.
        """
        if self.grounds.not_judged:
            return "not judged"
        low, high = self.interval
        return judge(holds=low >= self.required, fails=high < self.required, varies=self.varies)

    @property
    def met(self) -> bool:
        """True if the verdict is ``"met"``."""
        return self.verdict == "met"

    @property
    def said(self) -> str:
        """The verdict in capitals, with the reason for no verdict or the tolerances taken as exact."""
        return self.grounds.said(self.verdict)

    @property
    def cpk(self) -> float:
        """Process capability index of the fraction inside, :func:`capability_index`."""
        return capability_index(self.probability)

    @property
    def cpk_interval(self) -> tuple[float, float]:
        """Interval of :attr:`cpk`."""
        low, high = self.interval
        return capability_index(low), capability_index(high)
