"""Error budget: contributions of draws, sources and joints to the pose error, and the effect of tighter tolerances.

Closed-form shares of the tangent model and Sobol indices of the exact model agree as far as that is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, final

import numpy as np

from precision_pin.analyses.budget import sobol
from precision_pin.analyses.budget.budget_result import (
    VECTORS,
    BudgetResult,
    DrawShare,
    Estimate,
    Group,
    Halved,
    PlaceShare,
    PoseBudget,
    Sums,
)
from precision_pin.analyses.budget.shares import (
    COMPONENTS,
    ROUNDING,
    SourceLine,
    by_draw,
    by_place,
    component_shares,
    correlated_groups,
    deviations_of,
    group_part,
    reaches,
    shares_of,
    source_lines,
    source_shares,
    worst_case_shares,
)
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance, check_request
from precision_pin.analyses.replicates import REPLICATES, Estimates, Marginals, law_breaks
from precision_pin.analyses.result import list_warnings
from precision_pin.base.arguments import check_memory, check_number, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, UnknownNameError, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.equilibrium import turnover_findings
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.model.verdict_grounds import exact_findings_at
from precision_pin.sampling import Progress
from precision_pin.statistics import NORMS as NORM_ROWS
from precision_pin.statistics import QUANTITIES, quantity_values
from precision_pin.statistics.plan import QUANTITY_WORDS

MARKED: Final = 0.95
"""Probability of the quantile for which the effect of a halved tolerance is given."""

NONLINEAR: Final = 0.01
"""Difference of a share between closed form and sampling, beyond the interval, above which it counts as nonlinear."""

NORMS: Final = tuple(QUANTITIES[row] for row in NORM_ROWS)

SAMPLED: Final = (*VECTORS, *QUANTITIES)
_NOTHING: Final = Estimate(0.0, (0.0, 0.0))
_TOGETHER: Final = np.array(
    [[float(quantity in COMPONENTS and quantity.startswith(vector)) for quantity in QUANTITIES] for vector in VECTORS]
    + [[float(quantity == other) for other in QUANTITIES] for quantity in QUANTITIES]
)


def list_random_draws(space: Space) -> list[bool]:
    """Return, for each draw, whether it varies."""
    variances = space.block_covariance.variances
    return [bool(variances[rows].any()) for rows in space.slices]


@final
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
            sobol.scrambled_points(2 * size, seed, samples // REPLICATES, lambda: step(0))
            if size
            else np.zeros((0, samples))
        )
        self.points = points[:size]
        # groups that do not vary are not sampled: their indices are zero
        self.sampled = [k for k, group in enumerate(groups) if any(self.random[draw] for draw in group)]
        self.indices = sobol.sobol_indices(
            lambda uniforms: quantity_values(self._errors(at.space.inverse(uniforms))),
            self.points,
            points[size:],
            [np.concatenate([np.arange(size)[slices[draw]] for draw in groups[k]]) for k in self.sampled],
            outputs=_TOGETHER,
            smallest=ROUNDING**2,
            confidence=confidence,
            breaks=law_breaks(at.space),
        )
        self.x = at.space.inverse(self.points)
        self.norms = self._norms(self.x)
        self.marginals = Marginals.of(size, samples // REPLICATES, is_net=True, breaks=law_breaks(at.space))
        self.nodes = at.space.inverse(self.marginals.uniforms)
        self.known = sobol.found_quantiles(self.norms, MARKED)
        self.quantiles = _estimates(self.known.estimates(confidence))

    def _errors(self, x: Array) -> Array:
        errors = sampler.errors_at(self.layout, "exact", x)
        # the nodes are few and not counted as progress
        self.step(self.samples if x.shape[1] == self.samples else 0)
        return errors

    def _norms(self, x: Array) -> Array:
        return quantity_values(self._errors(x))[list(NORM_ROWS)]

    def halve_each(self) -> list[Halved]:
        """Return the effect of halving each draw's deviation from its mean, with the same random numbers otherwise."""
        return [self._halve(k) for k in range(len(self.random))]

    def _halve(self, draw: int) -> Halved:
        rows = self.at.space.slices[draw]
        factors = np.ones(self.at.space.size)
        factors[rows] = 0.5
        std = deviations_of(self.at.space.block_covariance.variances_of(self.at.jacobian * factors))
        if not self.random[draw]:
            return Halved(std, dict(zip(NORMS, self.quantiles, strict=True)), dict.fromkeys(NORMS, _NOTHING))
        halved, unseen = self._norms(self._with_half(self.x, rows)), self._estimate_unseen_change(rows)
        found = sobol.quantile_changes(halved, self.known, MARKED, self.confidence, unseen)
        values, changes = (dict(zip(NORMS, _estimates(one), strict=True)) for one in found)
        return Halved(std, values, changes)

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

    def groups(self, shares: Array, variances: Array) -> tuple[Group, ...]:
        """Return indices and closed-form share of every group."""
        names = [draw.name for draw in self.at.space.draws]
        spreads = zip(SAMPLED, self.indices.varies.tolist(), strict=True)
        none = {quantity: _NOTHING if spread else None for quantity, spread in spreads}
        result = []
        for k, group in enumerate(self.group_draws):
            closed = shares_of(group_part(self.at, group, shares), variances)
            first = self._row(self.indices.first, k) if k in self.sampled else none
            total = self._row(self.indices.total, k) if k in self.sampled else none
            nonlinear = tuple(one for one in closed if _differs(closed[one], first[one], total[one]))
            result.append(Group(tuple(names[draw] for draw in group), closed, first, total, nonlinear))
        return tuple(result)

    def sums(self, shares: Array, variances: Array) -> dict[str, Sums]:
        """Return the sum checks of every quantity."""
        parts = [group_part(self.at, group, shares) for group in self.group_draws]
        closed = shares_of(np.sum(parts, axis=0) if parts else np.zeros(6), variances)
        deviations = deviations_of(variances)
        first = _by_quantity(self.indices.first_sum)
        variance = _by_quantity(self.indices.variance)
        return {one: Sums(closed.get(one), first[one], deviations.get(one), variance[one]) for one in SAMPLED}

    def _row(self, estimates: Estimates, group: int) -> dict[str, Estimate | None]:
        k = self.sampled.index(group)
        return _by_quantity(Estimates(estimates.value[k], estimates.half_width[k], estimates.replicate_variance[k]))


def _differs(closed: float | None, first: Estimate | None, total: Estimate | None) -> bool:
    if first is None or total is None:
        return False
    shares = 0.0 if closed is None else closed
    return any(abs(index.value - shares) > NONLINEAR + index.half_width for index in (first, total))


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

NUMBERS_A_MINUTE: Final = 6e9
"""Approximate speed of a common computer."""


@warns_at_end
def budget(
    error_model: ErrorModel,
    /,
    pose: Poses = None,
    *,
    poses: Poses = None,
    q: Poses = None,
    seed: int = 0,
    samples: int = 16_384,
    confidence: float = 0.95,
    k: float = 3.0,
    bound_at: float | None = None,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> BudgetResult:
    """Return the error budget at one or several poses.

    Args:
        error_model: Chain, draws and sources.
        pose, poses, q: A pose (name, joint values, or None for the first) or a list of poses; they are synonyms.
        seed: 64-bit seed of the sampled indices and quantiles.
        samples: Points in each of the two sets of the pick-freeze method: 32 independent scrambles of a power of two.
            The exact model is evaluated about ``samples · (2 + 3 · draws)`` times.
        confidence: Confidence of each single interval.
        k, bound_at: Number of standard deviations at which unbounded laws are cut in the share of the worst case, as in
            :func:`precision_pin.worst_case`. The second is the former name of the first.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of evaluations since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong pose, seed, number of samples, confidence or bound; errors too large to compute with.
    """
    chosen, known = check_request(
        error_model, (poses, q, pose), seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    check_points(samples)
    name, k = ("k", k) if bound_at is None else ("bound_at", bound_at)
    check_number(f"{name}, in standard deviations,", k, "positive and finite", lambda value: value > 0)
    _check_cost(error_model.space, samples)
    with steps_to(progress, count_steps(error_model.space, len(chosen), samples), "robots") as step:
        lines = source_lines(error_model)
        found = tuple(_at_pose(error_model, lines, one, seed, samples, confidence, k, step) for one in chosen)
    return BudgetResult(
        provenance=Provenance.of(error_model, seed),
        samples=int(samples),
        confidence=confidence,
        k=k,
        marked=MARKED,
        poses=found,
        findings=known,
        warnings=list_warnings(known, (line for entry in found for line in entry.warnings)),
    )


def check_points(samples: int) -> None:
    """Check that the number of points is 32 times a power of two from 32 to 2¹³."""
    allowed = [REPLICATES << k for k in range(5, 14)]
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples not in allowed:
        raise InputError(
            f"the number of samples must be {REPLICATES} times a power of two from 32 to 2^13 "
            f"({allowed[0]}, {allowed[1]}, … {allowed[-1]}), got {shown(samples)}"
        )


def _check_cost(space: Space, samples: int) -> None:
    """Reject a budget that would take hours, quadratic in the number of draws, or too much memory."""
    draws, size = len(space.draws), space.size
    evaluations = samples * (2 + 3 * draws)
    if evaluations * size > MOST_NUMBERS:
        raise InputError(
            f"a budget of {draws:,} draws evaluates the model {evaluations:.2g} times, each time with {size:,} numbers: "
            f"{evaluations * size:.1g} numbers in all, some {evaluations * size / NUMBERS_A_MINUTE:,.0f} min, at most "
            f"{MOST_NUMBERS:.0g} are allowed; ask for fewer samples or merge draws"
        )
    check_memory(64.0 * size * samples, f"a budget of {size:,} numbers", "ask for fewer samples")


def evaluations(space: Space, samples: int) -> int:
    """Return the number of robots that a budget evaluates at a pose."""
    random = list_random_draws(space)
    groups = sum(any(random[draw] for draw in group) for group in correlated_groups(space))
    # two sets of points; for each group two more with its numbers exchanged; one unchanged; one for each halved draw
    return samples * (2 + 2 * groups + 1 + sum(random))


def count_steps(space: Space, poses: int, samples: int, **others: object) -> int:
    """Return the number of progress steps of a budget."""
    del others
    return poses * evaluations(space, samples)


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
    lines: Sequence[SourceLine],
    pose: Pose,
    seed: int,
    samples: int,
    confidence: float,
    k: float,
    step: Callable[[int], None],
) -> PoseBudget:
    try:
        with np.errstate(over="raise"):
            at = error_model.at(pose)
            variances = np.diag(at.covariance).copy()
    except (OverflowError, FloatingPointError):
        raise InputError(
            "the errors at this pose are too large to compute with; the tolerances or loads are far too large"
        ) from None
    shares, reach = by_draw(at), reaches(at, k)
    sampled = SampledBudget(at, correlated_groups(at.space), seed, samples, confidence, step)
    halved = sampled.halve_each()
    found = *at.findings("exact"), *error_model.statics_findings(at), *turnover_findings(at)
    return PoseBudget(
        pose=PoseLabel.of(error_model, pose, at),
        nominal=tuple(map(float, at.tangent[0])),
        std=deviations_of(variances),
        quantile=dict(zip(NORMS, sampled.quantiles, strict=True)),
        reach=dict(zip(COMPONENTS, map(float, reach.sum(axis=0)), strict=True)),
        draws=tuple(
            DrawShare(
                name=draw.name,
                scope=draw.scope.value,
                unbounded=not np.isfinite([draw.law.support(w) for w in at.jacobian[:, columns]]).all(),
                share=shares_of(shares[k], variances),
                components=component_shares(at, k, variances),
                reach=dict(zip(COMPONENTS, reach[k].tolist(), strict=True)),
                worst_case=worst_case_shares(reach[k], reach.sum(axis=0)),
                halved=halved[k],
                words=error_model.draw_words[k],
                tolerance=draw.tolerance,
            )
            for k, (draw, columns) in enumerate(zip(at.space.draws, at.space.slices, strict=True))
        ),
        groups=sampled.groups(shares, variances),
        sources=source_shares(at, lines, shares, variances),
        places=tuple(
            PlaceShare(name, shares_of(part, variances)) for name, part in by_place(at, error_model.chain).items()
        ),
        sums=sampled.sums(shares, variances),
        warnings=tuple(map(str, (*found, *exact_findings_at(error_model, at)))),
    )
