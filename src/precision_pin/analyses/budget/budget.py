"""Error budget: shares of draws, sources and joints in the spread of the pose error, and the effect of tighter tolerances.

The budget has closed-form shares of the tangent model and Sobol indices of the exact model. They agree as far as the model
is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.arguments import check_request
from precision_pin.analyses.budget.budget_result import BudgetResult, DrawShare, PlaceShare, PoseBudget
from precision_pin.analyses.budget.sampled_budget import MARKED, NORMS, SAMPLED, SampledBudget, list_random_draws
from precision_pin.analyses.budget.shares import (
    COMPONENTS,
    SourceLine,
    by_draw,
    by_place,
    component_shares,
    correlated_groups,
    deviations_of,
    reaches,
    shares_of,
    source_lines,
    source_shares,
    worst_case_shares,
)
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance
from precision_pin.analyses.replicates import REPLICATES
from precision_pin.analyses.result import list_warnings
from precision_pin.base.arguments import check_number, shown
from precision_pin.base.call_warnings import warns_at_end
from precision_pin.base.errors import Finding, InputError, UnknownNameError
from precision_pin.base.memory import check_memory
from precision_pin.base.progress import steps_to
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.statics_findings import turnover_findings
from precision_pin.model.verdict_grounds import exact_findings_at
from precision_pin.sampling import Progress
from precision_pin.statistics.quantities import QUANTITY_WORDS

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
        pose, poses, q: A pose (a name, joint values, or None for the model's first) or a list of poses. The three
            arguments are synonyms.
        seed: 64-bit seed of the sampled indices and quantiles.
        samples: Points in each of the two sets of the pick-freeze method: 32 independent scrambles of a power of two.
            The exact model is evaluated about ``samples · (2 + 3 · draws)`` times.
        confidence: Confidence of each interval by itself.
        k, bound_at: Number of standard deviations at which unbounded laws are cut in the share of the worst case, as in
            :func:`precision_pin.worst_case`. The two arguments are synonyms, of which the second is the former name.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of evaluations of the model since its last call, zero while points are
            prepared; ``True`` shows a bar.

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
    """Reject a budget that would take hours, or more memory than there is: the time grows with the square of the draws."""
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
    # two sets of points, two more for each group with its numbers exchanged, one unchanged, and one for each halved draw
    return samples * (2 + 2 * groups + 1 + sum(random))


def count_steps(space: Space, poses: int, samples: int, **others: object) -> int:
    """Return the number of progress steps of a budget."""
    del others
    return poses * evaluations(space, samples)


def check_quantities(quantities: Sequence[str]) -> tuple[str, ...]:
    """Return the names of quantities in results: ``position.x`` for ``x`` and ``dx``.

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
