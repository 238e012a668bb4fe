"""Error budget: contributions of draws, sources and joints to the pose error, and the effect of tighter tolerances.

Closed-form shares of the tangent model and Sobol indices of the exact model agree as far as that is linear. The indices
are from the pick-freeze method, on replicated scrambled Sobol points. First order: Azzini, Mara and Rosati,
Environmental Modelling & Software 144 (2021) 105167, whose noise decreases with the index itself. Total: Jansen,
Computer Physics Communications 117 (1999). Both use two sets of points and their mixtures, as in Saltelli et al., ibid.
181 (2010). For several outputs together, numerators and variances are added first (Gamboa, Janon, Klein and Lagnoux,
2014). Intervals: the points are independent scrambles (Owen, 1995) of one net, and the estimates are smooth functions
of the replicates' means. An index is not given where the points do not resolve its variance or numerator
(:mod:`precision_pin.analyses.replicates`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses import shares as closed_form
from precision_pin.analyses.budget import budget_result
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance, check_request
from precision_pin.analyses.replicates import (
    REPLICATES,
    Estimates,
    Marginals,
    half_widths,
    jackknife,
    law_breaks,
    round_up_samples,
)
from precision_pin.analyses.result import list_warnings
from precision_pin.base.arguments import check_memory, check_number
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, UnknownNameError, add, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.equilibrium import turnover_findings
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.sampling import Progress
from precision_pin.sampling.one_pose import model_at_pose
from precision_pin.sampling.verdict_grounds import exact_findings_at
from precision_pin.statistics import NORMS as NORM_ROWS
from precision_pin.statistics import QUANTITIES, quantity_values
from precision_pin.statistics.intervals import Estimate
from precision_pin.statistics.plan import QUANTITY_WORDS

MARKED: Final = 0.95
"""Probability of the quantile for which the effect of a halved tolerance is given."""


NORMS: Final = tuple(QUANTITIES[row] for row in NORM_ROWS)

SAMPLED: Final = (*closed_form.VECTORS, *QUANTITIES)
_NOTHING: Final = Estimate(0.0, (0.0, 0.0))
_TOGETHER: Final = np.array(
    [
        [float(quantity in closed_form.COMPONENTS and quantity.startswith(vector)) for quantity in QUANTITIES]
        for vector in closed_form.VECTORS
    ]
    + [[float(quantity == other) for other in QUANTITIES] for quantity in QUANTITIES]
)


def list_random_draws(space: Space) -> list[bool]:
    """Return, for each draw, whether it varies."""
    variances = space.block_covariance.variances
    return [bool(variances[rows].any()) for rows in space.slices]


class SampledBudget:
    """Estimates of the exact model at one pose."""

    def __init__(
        self,
        at: PoseModel,
        groups: Sequence[tuple[int, ...]],
        seed: int,
        samples: int,
        confidence: float,
        step: Callable[[int], None],
    ) -> None:
        self.at, self.confidence, self.group_draws = at, confidence, groups
        self.samples, self.step = samples, step
        self.layout = sampler.to_arrays(at)
        size, slices = at.space.size, at.space.slices
        self.random = list_random_draws(at.space)
        points = (
            scrambled_points(2 * size, seed, samples // REPLICATES, lambda: step(0)) if size else np.zeros((0, samples))
        )
        self.points = points[:size]
        # groups that do not vary are not sampled: their indices are zero
        self.sampled = [k for k, group in enumerate(groups) if any(self.random[draw] for draw in group)]
        self.indices = sobol_indices(
            lambda uniforms: quantity_values(self._errors(at.space.inverse(uniforms))),
            self.points,
            points[size:],
            [np.concatenate([np.arange(size)[slices[draw]] for draw in groups[k]]) for k in self.sampled],
            outputs=_TOGETHER,
            smallest=closed_form.ROUNDING**2,
            confidence=confidence,
            breaks=law_breaks(at.space),
        )
        self.x = at.space.inverse(self.points)
        self.norms = self._norms(self.x)
        nodes = Marginals.of(size, samples // REPLICATES, is_net=True, breaks=law_breaks(at.space))
        self.marginals, _ = nodes.evaluate(lambda uniforms: self._norms(at.space.inverse(uniforms)))
        self.nodes = at.space.inverse(self.marginals.uniforms)
        self.known = weighted_quantiles(self.norms, MARKED)
        self.quantiles = _estimates(self.known.estimates(confidence))

    def _errors(self, x: Array) -> Array:
        errors = sampler.errors_at(self.layout, "exact", x)
        # the nodes are few and not counted as progress
        self.step(self.samples if x.shape[1] == self.samples else 0)
        return errors

    def _norms(self, x: Array) -> Array:
        return quantity_values(self._errors(x))[list(NORM_ROWS)]

    def halve(self, draw: int) -> budget_result.Halved:
        """Return the effect of halving a draw's deviation from its mean, with the same random numbers otherwise."""
        rows = self.at.space.slices[draw]
        factors = np.ones(self.at.space.size)
        factors[rows] = 0.5
        std = closed_form.deviations_of(self.at.space.block_covariance.variances_of(self.at.jacobian * factors))
        if not self.random[draw]:
            return budget_result.Halved(
                std, dict(zip(NORMS, self.quantiles, strict=True)), dict.fromkeys(NORMS, _NOTHING)
            )
        halved, unseen = self._norms(self._with_half(self.x, rows)), self._estimate_unseen_change(rows)
        pairs = quantile_changes(halved, self.known, MARKED, self.confidence, unseen)
        values, changes = (dict(zip(NORMS, _estimates(estimates), strict=True)) for estimates in pairs)
        return budget_result.Halved(std, values, changes)

    def _with_half(self, x: Array, rows: slice) -> Array:
        result = x.copy()
        mean = self.at.space.mean[rows, None]
        result[rows] = mean + (x[rows] - mean) / 2
        return result

    def _estimate_unseen_change(self, rows: slice) -> Array:
        """Return the possible change of the norms by halving in regions without points."""
        nodes, weights = self.marginals.outermost(range(rows.start, rows.stop), self.x.shape[1])
        x = self.nodes[:, nodes]
        return np.abs(self._norms(self._with_half(x, rows)) - self._norms(x)) @ weights

    def groups(self, shares: Array, variances: Array) -> tuple[budget_result.Group, ...]:
        """Return indices and closed-form share of every group."""
        names = [draw.name for draw in self.at.space.draws]
        spreads = zip(SAMPLED, self.indices.varies.tolist(), strict=True)
        no_index = {quantity: _NOTHING if spread else None for quantity, spread in spreads}
        result = []
        for k, group in enumerate(self.group_draws):
            closed = closed_form.shares_of(closed_form.group_part(self.at, group, shares), variances)
            first = self._row(self.indices.first, k) if k in self.sampled else no_index
            total = self._row(self.indices.total, k) if k in self.sampled else no_index
            nonlinear = tuple(name for name in closed if _differs(closed[name], first[name], total[name]))
            result.append(budget_result.Group(tuple(names[draw] for draw in group), closed, first, total, nonlinear))
        return tuple(result)

    def sums(self, shares: Array, variances: Array) -> dict[str, budget_result.Sums]:
        """Return the sum checks of every quantity."""
        parts = [closed_form.group_part(self.at, group, shares) for group in self.group_draws]
        closed = closed_form.shares_of(np.sum(parts, axis=0) if parts else np.zeros(6), variances)
        deviations = closed_form.deviations_of(variances)
        first = _by_quantity(self.indices.first_sum)
        variance = _by_quantity(self.indices.variance)
        return {
            key: budget_result.Sums(closed.get(key), first[key], deviations.get(key), variance[key]) for key in SAMPLED
        }

    def _row(self, estimates: Estimates, group: int) -> dict[str, Estimate | None]:
        k = self.sampled.index(group)
        return _by_quantity(Estimates(estimates.value[k], estimates.half_width[k], estimates.replicate_variance[k]))


def _differs(closed: float | None, first: Estimate | None, total: Estimate | None) -> bool:
    if first is None or total is None:
        return False
    shares = 0.0 if closed is None else closed
    # difference of a share between closed form and sampling, beyond the interval, above which it counts as
    # nonlinear
    return any(abs(index.value - shares) > 0.01 + index.half_width for index in (first, total))


def _by_quantity(estimates: Estimates) -> dict[str, Estimate | None]:
    return dict(zip(SAMPLED, _estimates(estimates), strict=True))


def _estimates(estimates: Estimates) -> list[Estimate | None]:
    return [
        None
        if np.isnan(value) or np.isnan(half)
        else Estimate(float(value), (float(value - half), float(value + half)))
        for value, half in zip(estimates.value, estimates.half_width, strict=True)
    ]


MOST_NUMBERS: Final = 3e11
"""Largest number of random numbers in a budget."""


@warns_at_end
@takes_datum
def budget(
    model: ErrorModel,
    poses: Poses = None,
    *,
    seed: int = 0,
    samples: int = 16_384,
    confidence: float = 0.95,
    k: float = 3.0,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> budget_result.BudgetResult:
    """Return the error budget at one or several poses.

    Args:
        model: Chain, draws and sources.
        poses: A pose (name, joint values, or None for the first) or a list of poses.
        seed: 64-bit seed of the sampled indices and quantiles.
        samples: Points in each of the two sets of the pick-freeze method, rounded up to 32 independent scrambles of a
            power of two. The exact model is evaluated about ``samples · (2 + 3 · draws)`` times.
        confidence: Confidence of each single interval.
        k: Number of standard deviations at which unbounded laws are cut in the share of the worst case, as in
            :func:`precision_pin.worst_case`.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of evaluations since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong pose, seed, number of samples, confidence or bound; errors too large to compute with.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> largest = pp.budget(model, samples=1024).poses[0].ranked[0]
        >>> print(largest.name, round(largest.share["position"], 2))
        axis_install[joint1].A 0.25
    """
    pose_list, findings = check_request(
        model, poses, seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    samples, rounding = round_up_points(samples)
    add(rounding)
    check_number("k, in standard deviations,", k, "positive and finite", lambda value: value > 0)
    _check_cost(model.space, samples)
    with steps_to(progress, count_steps(model.space, len(pose_list), samples), "robots") as step:
        lines = closed_form.source_lines(model)
        entries = tuple(_at_pose(model, lines, pose, seed, samples, confidence, k, step) for pose in pose_list)
    return budget_result.BudgetResult(
        provenance=Provenance.of(model, seed),
        samples=samples,
        confidence=confidence,
        k=k,
        marked=MARKED,
        poses=entries,
        findings=findings,
        warnings=list_warnings(
            findings, (*map(str, rounding), *(line for entry in entries for line in entry.warnings))
        ),
    )


round_up_points: Final = partial(round_up_samples, smallest=5, largest=13)
"""Return the number of points in a set, 32 times a power of two from 32 to 2¹³, and a warning if it was rounded up."""


def _check_cost(space: Space, samples: int) -> None:
    """Reject a budget that would take hours, quadratic in the number of draws, or too much memory."""
    draws, size = len(space.draws), space.size
    evaluations = samples * (2 + 3 * draws)
    if evaluations * size > MOST_NUMBERS:
        raise InputError(
            f"a budget of {draws:,} draws evaluates the model {evaluations:.2g} times, each time with {size:,} numbers: "
            # approximate speed of a common computer
            f"{evaluations * size:.1g} numbers in all, some {evaluations * size / 6e9:,.0f} min, at most "
            f"{MOST_NUMBERS:.0g} are allowed; ask for fewer samples or merge draws"
        )
    check_memory(64.0 * size * samples, f"a budget of {size:,} numbers", "ask for fewer samples")


def evaluations(space: Space, samples: int) -> int:
    """Return the number of robots that a budget evaluates at a pose."""
    random = list_random_draws(space)
    groups = sum(any(random[draw] for draw in group) for group in closed_form.correlated_groups(space))
    # two sets of points; for each group two more with its numbers exchanged; one unchanged; one for each halved draw
    return samples * (2 + 2 * groups + 1 + sum(random))


def count_steps(space: Space, poses: int, samples: int, **options: object) -> int:
    """Return the number of progress steps of a budget."""
    del options
    return poses * evaluations(space, round_up_points(samples)[0])


def check_quantities(quantities: Sequence[str]) -> tuple[str, ...]:
    """Return the names of quantities in results, such as ``position.x`` for ``x`` and ``dx``.

    Here ``position`` and ``attitude`` are the three components together, ``|d|`` and ``|δ|`` the norms.

    Raises:
        UnknownNameError: A quantity is none of position, attitude, their norms and components.
    """
    for quantity in quantities:
        if quantity not in (*SAMPLED, *QUANTITY_WORDS):
            raise UnknownNameError("quantity", quantity, SAMPLED)
    return tuple(quantity if quantity in SAMPLED else QUANTITY_WORDS[quantity] for quantity in quantities)


def _at_pose(
    error_model: ErrorModel,
    lines: Sequence[closed_form.SourceLine],
    pose: Pose,
    seed: int,
    samples: int,
    confidence: float,
    k: float,
    step: Callable[[int], None],
) -> budget_result.PoseBudget:
    model = model_at_pose(error_model, pose)
    variances = np.diag(model.covariance).copy()
    shares, reach = closed_form.by_draw(model), closed_form.reaches(model, k)
    sampled = SampledBudget(model, closed_form.correlated_groups(model.space), seed, samples, confidence, step)
    halved = [sampled.halve(k) for k in range(len(model.space.draws))]
    findings = *model.findings("exact"), *error_model.statics_findings(model), *turnover_findings(model)
    return budget_result.PoseBudget(
        pose=PoseLabel.of(error_model, pose, model),
        nominal=tuple(map(float, model.tangent[0])),
        std=closed_form.deviations_of(variances),
        quantile=dict(zip(NORMS, sampled.quantiles, strict=True)),
        reach=dict(zip(closed_form.COMPONENTS, map(float, reach.sum(axis=0)), strict=True)),
        draws=tuple(
            budget_result.DrawShare(
                name=draw.name,
                scope=draw.scope.value,
                unbounded=not np.isfinite([draw.law.support(w) for w in model.jacobian[:, columns]]).all(),
                share=closed_form.shares_of(shares[k], variances),
                components=closed_form.component_shares(model, k, variances),
                reach=dict(zip(closed_form.COMPONENTS, reach[k].tolist(), strict=True)),
                worst_case=closed_form.worst_case_shares(reach[k], reach.sum(axis=0)),
                halved=halved[k],
                words=error_model.draw_words[k],
                tolerance=draw.tolerance,
            )
            for k, (draw, columns) in enumerate(zip(model.space.draws, model.space.slices, strict=True))
        ),
        groups=sampled.groups(shares, variances),
        sources=closed_form.source_shares(model, lines, shares, variances),
        places=tuple(
            budget_result.PlaceShare(name, closed_form.shares_of(part, variances))
            for name, part in closed_form.by_place(model, error_model.chain).items()
        ),
        sums=sampled.sums(shares, variances),
        warnings=tuple(map(str, (*findings, *exact_findings_at(error_model, model)))),
    )


_BITS: Final = 30  # of each coordinate; half a unit of the last bit is added, so that no point is 0


@dataclass(frozen=True, eq=False)
class Indices:
    """Sobol indices of G groups of inputs and Q outputs.

    Attributes:
        first, total: ``(G, Q)`` first-order and total indices.
        first_sum: ``(Q,)`` sum of the first-order indices.
        variance: ``(Q,)`` variance; for several outputs together the sum of their variances.
        varies: ``(Q,)`` true if the output varies.
    """

    first: Estimates
    total: Estimates
    first_sum: Estimates
    variance: Estimates
    varies: NDArray[np.bool_]


def scrambled_points(dimension: int, seed: int, points: int, step: Callable[[], None] = lambda: None) -> Array:
    """Return `REPLICATES` independent scrambles of a Sobol net, concatenated.

    The result is ``(dimension, REPLICATES · points)`` inside (0, 1), midpoints of 2³⁰ cells; ``points`` is a power of
    two. ``step`` is called after each replicate.
    """
    # imported here, because it takes half a second and only this function needs it
    from scipy.stats import qmc

    points_of_nets = []
    for k in range(REPLICATES):
        # seed is accepted by every scipy since 1.14; the newer keyword rng is not
        net = qmc.Sobol(dimension, scramble=True, bits=_BITS, seed=np.random.default_rng([seed, k]))
        points_of_nets.append(net.random(points))
        step()
    result: Array = np.concatenate(points_of_nets).T + 0.5**_BITS / 2
    return np.ascontiguousarray(result)


def sobol_indices(
    function: Callable[[Array], Array],
    points: Array,
    other_points: Array,
    groups: Sequence[Sequence[int] | NDArray[np.intp]],
    *,
    outputs: Array | None = None,
    smallest: float = 0.0,
    confidence: float = 0.95,
    breaks: Sequence[tuple[float, ...]] = (),
) -> Indices:
    """Return first-order and total Sobol indices of groups of inputs.

    With A and B two independent sets of points, A' the points A with the inputs of group g from B, and B' the points B
    with those of A: ``S_g V = E[(f(A') - f(A)) (f(B) - f(B'))]/2``, ``T_g V = E[(f(A') - f(A))² + (f(B') - f(B))²]/4``.

    Args:
        function: Function from uniform numbers ``(d, N)`` to values ``(q, N)``.
        points, other_points: A and B, ``(d, REPLICATES · n)``, halves of one set of :func:`scrambled_points`.
        groups: Rows of each group's inputs; groups must be independent of one another.
        outputs: ``(Q, q)`` zeros and ones that select the values of each output; by default each value is an output.
        smallest: Variance up to which the indices of an output are NaN.
        confidence: Confidence of each single interval.
        breaks: Uniform numbers at which the function has jumps or kinks, for each input.
    """
    at_a, at_b = _split(function(points)), _split(function(other_points))
    combinations = np.eye(at_a.shape[0]) if outputs is None else outputs
    middle = (at_a.mean(axis=(1, 2)) + at_b.mean(axis=(1, 2)))[:, None, None] / 2
    variances = combinations @ (((at_a - middle) ** 2 + (at_b - middle) ** 2).mean(axis=2) / 2)
    shape = (len(groups), combinations.shape[0], REPLICATES)
    firsts, totals = np.zeros(shape), np.zeros(shape)
    for k, rows in enumerate(groups):
        change = _split(function(_mix_points(points, other_points, rows))) - at_a
        change_back = at_b - _split(function(_mix_points(other_points, points, rows)))
        firsts[k] = combinations @ (change * change_back).mean(axis=2) / 2
        totals[k] = combinations @ (change**2 + change_back**2).mean(axis=2) / 4

    variance = jackknife(lambda is_used: variances[:, is_used].mean(axis=1), confidence)
    marginals, values = Marginals.of(len(points), at_a.shape[2], is_net=True, breaks=breaks).evaluate(function)
    squares = combinations @ marginals.subtract_means(values) ** 2
    resolved = marginals.resolve(variance, squares, variance.value, confidence)
    member = np.zeros((len(groups), len(points)))
    for k, rows in enumerate(groups):
        member[k, np.asarray(rows)] = 1

    def share(numerators: Array, members: Array) -> Estimates:
        """Return shares; ``members``, ``(…, d)``, is one for numbers that contribute to the numerator, otherwise zero."""

        def statistic(is_used: NDArray[np.bool_]) -> Array:
            denominator = variances[:, is_used].mean(axis=1)
            denominator = np.where(denominator > smallest, denominator, np.nan)
            return numerators[..., is_used].mean(axis=-1) / denominator

        indices = jackknife(statistic, confidence)
        factors = np.moveaxis(members[..., None] - indices.value[..., None, :], -2, 0)
        contributions = squares / variance.value[:, None]
        return marginals.resolve(indices, contributions, np.ones(len(squares)), confidence, factors).where(
            np.isfinite(resolved.value)
        )

    with np.errstate(divide="ignore", invalid="ignore"):
        return Indices(
            first=share(firsts, member),
            total=share(totals, member),
            first_sum=share(firsts.sum(axis=0), member.sum(axis=0)),
            variance=resolved,
            varies=variance.value > smallest,
        )


def _mix_points(points: Array, other_points: Array, rows: Sequence[int] | NDArray[np.intp]) -> Array:
    result = points.copy()
    result[np.asarray(rows)] = other_points[np.asarray(rows)]
    return result


def _split(values: Array) -> Array:
    return values.reshape(values.shape[0], REPLICATES, -1)


_NEGLIGIBLE: Final = 1e-12  # relative weight of an order statistic that is omitted: far below the sampling error
_NEAR: Final = 0.02  # smallest weight on either side of a step that lies at the centre of the window


@dataclass(frozen=True, eq=False)
class Quantiles:
    """Quantiles of several rows of samples.

    Attributes:
        value: ``(rows,)`` quantiles.
        pseudo: ``(REPLICATES, rows)`` pseudo-values of the jackknife.
        steps: ``(rows, m)`` effect of each step between neighbours on the quantile.
        jumps: ``(rows, m)`` true if the step is a jump.
    """

    value: Array
    pseudo: Array
    steps: Array
    jumps: NDArray[np.bool_]

    def __sub__(self, other: Quantiles) -> Quantiles:
        return Quantiles(
            self.value - other.value, self.pseudo - other.pseudo, self.steps - other.steps, self.jumps | other.jumps
        )

    def estimates(self, confidence: float, unseen: Array | float = 0.0) -> Estimates:
        """Return values with intervals, NaN at jumps and gaps."""
        half = half_widths(self.pseudo, confidence) + np.abs(self.pseudo.mean(axis=0) - self.value) + unseen
        rounding = 1e-14 * np.abs(self.steps).sum(axis=1)
        # largest allowed effect of a jump between neighbours on a quantile, relative to its half-width
        smooth = (np.abs(self.steps) * self.jumps).max(axis=1) <= 0.1 * half + rounding
        return Estimates(self.value, half, self.pseudo.var(axis=0, ddof=1)).where(smooth)


def quantiles(samples: Array, probability: float, confidence: float) -> Estimates:
    """Return a quantile of every row of ``(rows, REPLICATES · n)`` with its interval; NaN at jumps and gaps."""
    return weighted_quantiles(samples, probability).estimates(confidence)


def quantile_changes(
    samples: Array, before: Array | Quantiles, probability: float, confidence: float, unseen: Array | float = 0.0
) -> tuple[Estimates, Estimates]:
    """Return a quantile of every row, and its change from the quantile of ``before`` with the same random numbers.

    ``samples`` are ``(rows, REPLICATES · n)``; ``before`` may also be computed quantiles. Intervals are widened by
    ``unseen``, ``(rows,)``, the possible change in regions without samples.
    """
    new_quantiles = weighted_quantiles(samples, probability)
    change = new_quantiles - (before if isinstance(before, Quantiles) else weighted_quantiles(before, probability))
    return new_quantiles.estimates(confidence, unseen), change.estimates(confidence, unseen)


def weighted_quantiles(samples: Array, probability: float) -> Quantiles:
    """Return a quantile of every row with the data for its interval."""
    count = samples.shape[1]
    first, weights = _weights(count, probability)
    start, fewer = _weights(count - count // REPLICATES, probability)
    cumulative = np.cumsum(weights)[:-1]
    pulls = np.minimum(cumulative, 1 - cumulative)
    rows = [_row_quantile(values, first, weights, start, fewer) for values in samples]
    window_values = np.array([row[2] for row in rows])
    distances = np.diff(window_values, axis=1)
    # the distances of neighbours of a smooth law are exponentially distributed, with the median ln 2 times the mean
    centre = distances[:, pulls > _NEAR]
    usual_distance = np.median(centre, axis=1, keepdims=True) / math.log(2)
    return Quantiles(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]).T,
        distances * pulls,
        # ratio of a neighbour distance to the mean that counts as a jump; smooth laws exceed it six times in
        # a million
        distances > 12.0 * usual_distance,
    )


def _row_quantile(values: Array, first: int, weights: Array, start: int, fewer: Array) -> tuple[float, Array, Array]:
    """Return a quantile, its pseudo-values, and the order statistics that it averages."""
    size = values.size // REPLICATES
    order = np.argsort(values, kind="stable")
    window_values = values[order[first : first + weights.size]]
    quantile = float(window_values @ weights)
    replicate = order // size
    # the quantile without one replicate needs the ranks from start on, all of them within this window
    counts = np.bincount(replicate[:start], minlength=REPLICATES)
    window = slice(start, start + fewer.size + size)
    sorted_values, replicates = values[order[window]], replicate[window]
    left_out = np.empty(REPLICATES)
    for k in range(REPLICATES):
        left_out[k] = sorted_values[replicates != k][counts[k] : counts[k] + fewer.size] @ fewer
    return quantile, quantile + (REPLICATES - 1) * (quantile - left_out), window_values


@lru_cache(maxsize=64)
def _weights(count: int, probability: float) -> tuple[int, Array]:
    """Return the rank, from 0, of the first order statistic with a relevant weight, and the weights from there on."""
    shape = (count + 1) * probability, (count + 1) * (1 - probability)
    weights = np.diff(special.betainc(*shape, np.linspace(0.0, 1.0, count + 1)))
    rows = np.flatnonzero(weights > _NEGLIGIBLE * weights.max())
    result: Array = weights[rows[0] : rows[-1] + 1]
    return int(rows[0]), result / result.sum()
