"""The error budget: who causes how much of the spread of the pose error, and what a tighter tolerance would change.

Closed form on the tangent model beside Sobol indices of the exact model; the two agree as far as the model is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.arguments import check_request
from precision_pin.analyses.budget import smooth_quantiles, sobol
from precision_pin.analyses.budget.budget_result import (
    VECTORS,
    BudgetResult,
    DrawShare,
    Estimate,
    Group,
    Halved,
    PlaceShare,
    PoseBudget,
    Shares,
    SourceShare,
    Sums,
)
from precision_pin.analyses.budget.shares import by_component, by_draw, by_place, correlated_groups, reaches
from precision_pin.analyses.marginals import Marginals, law_breaks
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance
from precision_pin.analyses.replicates import REPLICATES, Estimates
from precision_pin.analyses.result import list_warnings
from precision_pin.call_warnings import warns_at_end
from precision_pin.display.progress import steps_to
from precision_pin.draws.space import Space
from precision_pin.errors import Finding, InputError, UnknownNameError
from precision_pin.inputs.arguments import check_number, shown
from precision_pin.inputs.memory import check_memory
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.sampling import Progress
from precision_pin.statistics import COMPONENTS as COMPONENT_ROWS
from precision_pin.statistics import NORMS as NORM_ROWS
from precision_pin.statistics import QUANTITIES, quantity_values
from precision_pin.statistics.quantities import QUANTITY_WORDS
from precision_pin.typing import Array

__all__ = ["budget", "check_points", "check_quantities", "count_steps", "evaluations"]


ROUNDING: Final = 1e-14
"""Spreads (m, rad) up to this are rounding."""

MOST_NUMBERS: Final = 3e11
"""The most random numbers that a budget may take."""

NUMBERS_A_MINUTE: Final = 6e9
"""Roughly, of a usual machine."""

MARKED: Final = 0.95
"""Probability of the quantile that a halved tolerance is judged by."""

NONLINEAR: Final = 0.01
"""Closed form and sampling differ where their shares do by more than this, intervals aside."""

COMPONENTS: Final = tuple(QUANTITIES[row] for row in COMPONENT_ROWS)
NORMS: Final = tuple(QUANTITIES[row] for row in NORM_ROWS)

_SAMPLED: Final = (*VECTORS, *QUANTITIES)
_TOGETHER: Final = np.array(
    [[float(quantity in COMPONENTS and quantity.startswith(vector)) for quantity in QUANTITIES] for vector in VECTORS]
    + [[float(quantity == other) for other in QUANTITIES] for quantity in QUANTITIES]
)


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

    Parameters
    ----------
    error_model
        Chain, draws and sources.
    pose, poses, q
        A pose (a name, joint values, or None for the model's first) or a list of such; three names of one argument.
    seed
        64-bit seed of the sampled indices and quantiles.
    samples
        Points of each of the two sets that pick-freeze starts from: 32 independent scrambles of a power of two. The exact
        model is evaluated about ``samples · (2 + 3 · draws)`` times.
    confidence
        Of every interval, each by itself.
    k, bound_at
        How many standard deviations unbounded laws reach in the share of the worst case, as in
        :func:`precision_pin.worst_case`. Two names of one argument, the second the old one.
    findings
        Warnings to carry along, such as those of the sheet.
    progress
        Told how many evaluations of the model have been made since it was last called, zero while points are prepared;
        ``True`` shows a bar.

    Raises
    ------
    InputError
        A wrong pose, seed, number of samples, confidence or bound; errors too large to compute with.
    """
    chosen, known = check_request(
        error_model, (poses, q, pose), seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    check_points(samples)
    name, k = ("k", k) if bound_at is None else ("bound_at", bound_at)
    check_number(f"{name}, in standard deviations,", k, "positive and finite", lambda value: value > 0)
    _check_cost(error_model.space, samples)
    with steps_to(progress, count_steps(error_model.space, len(chosen), samples), "robots") as step:
        found = tuple(_at_pose(error_model, one, seed, samples, confidence, k, step) for one in chosen)
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
    """Refuse a number of points that is not 32 times a power of two from 32 to 2¹³.

    Raises
    ------
    InputError
        It is not.
    """
    allowed = [REPLICATES << k for k in range(5, 14)]
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples not in allowed:
        raise InputError(
            f"the number of samples must be {REPLICATES} times a power of two from 32 to 2^13 "
            f"({allowed[0]}, {allowed[1]}, … {allowed[-1]}), got {shown(samples)}"
        )


def _check_cost(space: Space, samples: int) -> None:
    """Refuse what would take hours: the model is sampled for each draw, and takes time with each draw.

    Raises
    ------
    InputError
        There are too many draws for so many samples, or too many for the memory.
    """
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
    """Return how many robots a budget at a pose looks at."""
    random = _random_draws(space)
    groups = sum(any(random[draw] for draw in group) for group in correlated_groups(space))
    # two sets of points, those with a group's numbers exchanged, and those with a draw halved beside the plain ones
    return samples * (2 + 2 * groups + 1 + sum(random))


def count_steps(space: Space, poses: int, samples: int, **others: object) -> int:
    """Return how many steps a budget tells of, whatever its other arguments."""
    del others
    return poses * evaluations(space, samples)


def _random_draws(space: Space) -> list[bool]:
    """Return which draws vary."""
    variances = space.block_covariance.variances
    return [bool(variances[rows].any()) for rows in space.slices]


def check_quantities(quantities: Sequence[str]) -> tuple[str, ...]:
    """Return quantities under their names in results: ``position.x`` for ``x`` and ``dx``.

    ``position`` and ``attitude`` are all three components together here, ``|d|`` and ``|δ|`` the norms.

    Raises
    ------
    UnknownNameError
        It is none of position, attitude, their norms and components.
    """
    for quantity in quantities:
        if quantity not in (*_SAMPLED, *QUANTITY_WORDS):
            raise UnknownNameError("quantity", quantity, _SAMPLED)
    return tuple(quantity if quantity in _SAMPLED else QUANTITY_WORDS[quantity] for quantity in quantities)


def _at_pose(
    error_model: ErrorModel,
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
            "the errors at this pose are beyond any number; the tolerances or loads are far too large"
        ) from None
    groups = correlated_groups(at.space)
    shares = by_draw(at)
    sampled = _Sampled(at, groups, seed, samples, confidence, step)
    names = [draw.name for draw in at.space.draws]
    halved = sampled.halved()
    reach = reaches(at, k)
    return PoseBudget(
        pose=PoseLabel.of(error_model, pose, at),
        nominal=tuple(map(float, at.tangent[0])),
        std=_deviations(variances),
        quantile=dict(zip(NORMS, sampled.quantiles, strict=True)),
        reach=dict(zip(COMPONENTS, map(float, reach.sum(axis=0)), strict=True)),
        draws=tuple(
            DrawShare(
                name=name,
                scope=at.space.draws[k].scope.value,
                unbounded=not np.isfinite(
                    [at.space.draws[k].law.support(w) for w in at.jacobian[:, at.space.slices[k]]]
                ).all(),
                share=_shares(shares[k], variances),
                components=_component_shares(at, k, variances),
                reach=dict(zip(COMPONENTS, map(float, reach[k]), strict=True)),
                worst_case=_worst(reach[k], reach.sum(axis=0)),
                halved=halved[k],
            )
            for k, name in enumerate(names)
        ),
        groups=sampled.groups(shares, variances),
        sources=_sources(error_model, shares, variances),
        places=tuple(
            PlaceShare(name, _shares(part, variances)) for name, part in by_place(at, error_model.chain).items()
        ),
        sums=sampled.sums(shares, variances),
        warnings=tuple(str(finding) for finding in (*at.findings("exact"), *error_model.statics_findings(at))),
    )


class _Sampled:
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
        self.layout = sampler.compile_table(at)
        size, slices = at.space.size, at.space.slices
        self.random = _random_draws(at.space)
        points = (
            sobol.scrambled_points(2 * size, seed, samples // REPLICATES, lambda: step(0))
            if size
            else np.zeros((0, samples))
        )
        self.points = points[:size]
        # groups that do not vary need no sampling: their indices are zero
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
        self.known = smooth_quantiles.found_quantiles(self.norms, MARKED)
        self.quantiles = _estimates(self.known.estimates(confidence))

    def _errors(self, x: Array) -> Array:
        errors = sampler.errors_at(self.layout, "exact", x)
        # not the nodes, which are few
        self.step(self.samples if x.shape[1] == self.samples else 0)
        return errors

    def _norms(self, x: Array) -> Array:
        return quantity_values(self._errors(x))[list(NORM_ROWS)]

    def halved(self) -> list[Halved]:
        """Return what halving every draw's deviation from its mean gives, one draw at a time, same numbers otherwise."""
        return [self._halved(k) for k in range(len(self.random))]

    def _halved(self, draw: int) -> Halved:
        rows = self.at.space.slices[draw]
        factors = np.ones(self.at.space.size)
        factors[rows] = 0.5
        variances = self.at.space.block_covariance.variances_of(self.at.jacobian * factors)
        if not self.random[draw]:
            none = Estimate(0.0, (0.0, 0.0))
            return Halved(
                _deviations(variances), dict(zip(NORMS, self.quantiles, strict=True)), dict.fromkeys(NORMS, none)
            )
        values, changes = smooth_quantiles.quantile_changes(
            self._norms(self._with_half(self.x, rows)), self.known, MARKED, self.confidence, self._unseen(rows)
        )
        return Halved(
            _deviations(variances),
            dict(zip(NORMS, _estimates(values), strict=True)),
            dict(zip(NORMS, _estimates(changes), strict=True)),
        )

    def _with_half(self, x: Array, rows: slice) -> Array:
        """Return numbers with half of the deviation in some rows."""
        result = x.copy()
        mean = self.at.space.mean[rows, None]
        result[rows] = mean + (x[rows] - mean) / 2
        return result

    def _unseen(self, rows: slice) -> Array:
        """Return what halving may change of the norms where no point lies."""
        nodes, weights = self.marginals.outermost(range(rows.start, rows.stop), self.x.shape[1])
        x = self.nodes[:, nodes]
        change: Array = np.abs(self._norms(self._with_half(x, rows)) - self._norms(x)) @ weights
        return change

    def groups(self, shares: Array, variances: Array) -> tuple[Group, ...]:
        """Return the indices of every group beside the closed form."""
        names = [draw.name for draw in self.at.space.draws]
        nothing = Estimate(0.0, (0.0, 0.0))
        none = {quantity: nothing if spread else None for quantity, spread in self._spreads().items()}
        result = []
        for k, group in enumerate(self.group_draws):
            closed = _shares(_together(self.at, group, shares), variances)
            first = self._row(self.indices.first, k) if k in self.sampled else none
            total = self._row(self.indices.total, k) if k in self.sampled else none
            result.append(
                Group(
                    draws=tuple(names[draw] for draw in group),
                    share=closed,
                    first=first,
                    total=total,
                    nonlinear=tuple(
                        quantity for quantity in closed if _differs(closed[quantity], first[quantity], total[quantity])
                    ),
                )
            )
        return tuple(result)

    def sums(self, shares: Array, variances: Array) -> dict[str, Sums]:
        """Return the sum checks of every quantity."""
        parts = [_together(self.at, group, shares) for group in self.group_draws]
        closed = _shares(np.sum(parts, axis=0) if parts else np.zeros(6), variances)
        deviations = _deviations(variances)
        first = _named(self.indices.first_sum)
        variance = _named(self.indices.variance)
        result = {}
        for quantity in _SAMPLED:
            result[quantity] = Sums(closed.get(quantity), first[quantity], deviations.get(quantity), variance[quantity])
        return result

    def _row(self, estimates: Estimates, group: int) -> dict[str, Estimate | None]:
        k = self.sampled.index(group)
        return _named(Estimates(estimates.value[k], estimates.half_width[k], estimates.replicate_variance[k]))

    def _spreads(self) -> dict[str, bool]:
        return dict(zip(_SAMPLED, self.indices.varies.tolist(), strict=True))


def _together(at: PoseModel, group: tuple[int, ...], shares: Array) -> Array:
    """Return a group's part of the variances, ``(6,)``; worked out whole where it was too large to be shared."""
    part: Array = shares[list(group)].sum(axis=0)
    if np.isfinite(part).all():
        return part
    columns = np.concatenate([np.arange(at.space.size)[at.space.slices[draw]] for draw in group])
    jacobian = at.jacobian[:, columns]
    whole: Array = np.einsum("ij,jk,ik->i", jacobian, at.space.block_covariance.within(columns), jacobian)
    return whole


def _differs(closed: float | None, first: Estimate | None, total: Estimate | None) -> bool:
    if first is None or total is None:
        return False
    shares = 0.0 if closed is None else closed
    return any(abs(index.value - shares) > NONLINEAR + index.half_width for index in (first, total))


def _shares(parts: Array, variances: Array) -> Shares:
    """Return parts of the six variances as shares, of the components and of both vectors; None where nothing varies."""
    values: list[tuple[str, float, float]] = [
        (vector, float(parts[rows].sum()), float(variances[rows].sum()))
        for vector, rows in zip(VECTORS, (slice(0, 3), slice(3, 6)), strict=True)
    ]
    values += zip(COMPONENTS, map(float, parts), map(float, variances), strict=True)
    return {name: part / whole if whole > ROUNDING**2 and np.isfinite(part) else None for name, part, whole in values}


def _component_shares(at: PoseModel, draw: int, variances: Array) -> dict[str, Shares]:
    parts = by_component(at, draw)
    if parts is None:
        return {}
    names = at.space.draws[draw].components
    return {name: _shares(part, variances) for name, part in zip(names, parts, strict=True)}


def _worst(part: Array, whole: Array) -> Shares:
    return {
        name: float(one / every) if every > ROUNDING else None
        for name, one, every in zip(COMPONENTS, part, whole, strict=True)
    }


def _deviations(variances: Array) -> dict[str, float]:
    """Return standard deviations of the components, and of the vectors the root of the sum of their squares."""
    squares = dict(zip(VECTORS, (variances[:3].sum(), variances[3:].sum()), strict=True))
    squares |= dict(zip(COMPONENTS, variances, strict=True))
    return {name: float(np.sqrt(max(square, 0.0))) for name, square in squares.items()}


def _sources(error_model: ErrorModel, shares: Array, variances: Array) -> tuple[SourceShare, ...]:
    """Return one line for each source with draws of its own and one for each draw that several sources share."""
    lines: dict[tuple[str, ...], list[int]] = {}
    for k, labels in enumerate(error_model.owners):
        name = error_model.space.draws[k].name
        key = labels if len(labels) == 1 else (*labels, name)
        lines.setdefault(key, []).append(k)
    return tuple(
        SourceShare(
            sources=key if len(key) == 1 else key[:-1],
            draws=tuple(error_model.space.draws[k].name for k in rows),
            share=_shares(shares[rows].sum(axis=0), variances),
        )
        for key, rows in lines.items()
    )


def _named(estimates: Estimates) -> dict[str, Estimate | None]:
    return dict(zip(_SAMPLED, _estimates(estimates), strict=True))


def _estimates(estimates: Estimates) -> list[Estimate | None]:
    return [
        None
        if np.isnan(value) or np.isnan(half)
        else Estimate(float(value), (float(value - half), float(value + half)))
        for value, half in zip(estimates.value, estimates.half_width, strict=True)
    ]
