"""Distribution of the pose error at one pose, by sampling."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_items
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import Progress
from precision_pin.draws.draw import Scope
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import BLOCK, Blocks
from precision_pin.model.datum import DatumRecord
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel, origin_shares
from precision_pin.robot.configurations import ApproachedPose, written_approach
from precision_pin.sampling.blocks import (
    PILOT,
    Work,
    check_samples,
    first_order_skewness,
    plan_by_pilot,
    planned,
    reach,
)
from precision_pin.sampling.journal import SAMPLES, Files, identity, samples_of
from precision_pin.sampling.result import Correlated, MonteCarloResult, RelativeTo, Until
from precision_pin.sampling.run import Run, RunSettings, check_common
from precision_pin.sampling.verdict_grounds import (
    LARGEST_SQUARE,
    by_both_models,
    exact_findings_at,
    grounds_at,
    specified_values,
)
from precision_pin.sampling.workers import Submitter
from precision_pin.statistics import (
    QUANTITIES,
    Grounds,
    Plan,
    Specification,
    State,
    Summary,
    finish,
    observe,
    quantile_ranks,
    start,
)
from precision_pin.statistics.plan import Specifications, listed_specifications
from precision_pin.statistics.precision import Precision, Target, reached, target

OnePose = ArrayLike | Mapping[str, float] | ApproachedPose | str | None


@warns_at_end
@takes_datum
def monte_carlo(
    error_model: ErrorModel,
    /,
    q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None,
    *,
    approach: object = None,
    samples: int = 100_000,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    specifications: Specifications = (),
    until: str | Sequence[str] = (),
    keep_samples: bool = False,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    threads: int | None = None,
    processes: int | None = None,
    executor: Submitter | None = None,
    tasks_under_way: int | None = None,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    files: Mapping[str, str | os.PathLike[str]] | None = None,
    progress: Progress | bool | None = None,
    tell: Callable[[str], None] | None = None,
) -> MonteCarloResult:
    """Sample the pose error at one pose (section 4 of Wei, Jia and Chen, 2015).

    On machines of one type the result has the same bits for any workers, and however often the run is stopped and
    resumed. Conditions that strain an assumption, such as joint values outside their limits, are listed in the result's
    ``warnings`` and issued as :class:`precision_pin.base.errors.PrecisionPinWarning`; ``findings`` are not issued
    again.

    Args:
        error_model: Chain, draws and sources.
        q: The pose: joint values in chain order, by joint name, or the name of a pose; by default the model's first.
        approach: Direction in which each joint moved last, as in :class:`precision_pin.ApproachedPose`, ``"joint1 +,
            joint2 -"``; by default that of the pose.
        samples: Number of built robots; with ``until``, the largest number.
        seed: 64-bit seed.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors (eqs 12-17).
        specifications: Limits to count against: one or a list, each from :func:`precision_pin.specification` or its
            text.
        until: Target precision, one or a list, such as ``"95 % to 0.01 mm"`` (see
            :func:`precision_pin.statistics.precision.target`). Sampling ends as soon as all targets are reached. They
            are checked after 1, 2, 4, 8 … blocks of 16,384 samples.
        keep_samples: Keep every error, ``(6, samples)``.
        confidence: Confidence of every interval.
        findings: Warnings to include in the result, such as those of the sheet.
        threads: Number of threads, by default one for each core.
        processes: Number of processes, started for this run, to use instead of threads. They end with this process.
        executor: Executor to use instead of threads: any object with ``submit(function, *arguments)`` that returns a
            future, such as the executors of :mod:`concurrent.futures`, loky, mpi4py and Dask. It is not shut down. See
            also :func:`dask_cluster`.
        tasks_under_way: Number of tasks given to the executor at a time. The default is twice its number of workers, or
            twice the number of cores of this machine if the executor does not state it.
        journal: File in which the state of the run is saved every two seconds to a minute, to resume from. Ctrl-C then
            finishes the running tasks before it ends the run.
        resume: Resume from the journal, if the file exists.
        files: Files that the model was read from besides the URDF, by their names in messages, such as ``{"sheet":
            "arm.errors.yaml"}``. A run is not resumed after one of them has changed.
        progress: Function called after every few blocks; ``True`` shows a bar.
        tell: Function called with one line about the contents of the journal, and about the progress towards ``until``.

    Raises:
        InputError: A wrong number of samples, seed, model, confidence, pose, or workers; errors too large to compute
            with; more samples to keep than fit into memory; workers that fail; a journal that is in use or belongs to
            another run.
        OutputError: The journal cannot be written.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.monte_carlo(model, samples=20_000, specifications="40 mm @ 90 %")
        >>> print(round(1e3 * result.position.norm.quantile(0.95), 1), result.summary.specifications[0].met)
        40.2 True
    """
    run_settings = RunSettings(threads, processes, executor, tasks_under_way, journal, resume, files, progress, tell)
    findings = check_common(error_model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    check_samples(samples, keep_samples=keep_samples)
    specifications = listed_specifications(specifications)
    pose = q if approach is None else ApproachedPose(q, approach)
    until = (until,) if isinstance(until, str) else check_items("until, targets,", until, str)
    if keep_samples and journal is not None:
        raise InputError("a journal holds statistics only; keep_samples is not possible with a journal")
    if keep_samples and until:
        raise InputError("with until the number of samples is not known in advance; keep_samples is not possible")
    targets = [target(text) for text in until]
    at = model_at_pose(error_model, pose)
    layout = sampler.to_arrays(at)
    plan = planned(at, layout, model, int(seed), specifications)
    work = Work(layout, plan, model, int(seed), int(samples), keep_samples)

    def known(files: Files) -> dict[str, str]:
        return {**identity(work, at.posture, files), "until": "; ".join(until)}

    with run_settings.begun(start(plan), samples_of(plan), known, work.samples) as run:
        enough = _enough(targets, plan, confidence, run_settings.report) if targets else None
        errors = sample_blocks(run, work, enough=enough)
    summary = finish(plan, run.state, confidence, first_order=at.covariance)
    precisions = [(text, reached(of, summary)) for text, of in zip(until, targets, strict=True)]
    return _result(
        error_model, at, pose, work, summary, errors, findings,
        lambda: grounds_at(error_model, at.posture.q[:, None], both=by_both_models([at], model, int(seed), specifications)),
        "at this pose: all robots have the same error",
        after=[_missed_target(text, p, summary.samples) for text, p in precisions if not p.reached],
        datum=_datum_at(error_model, at, work),
        nominal=at.tangent[0],
        origins=origin_shares(error_model.origins, at),
        until=tuple(Until(*p) for p in precisions),
    )  # fmt: skip


def _result(
    error_model: ErrorModel,
    at: PoseModel,
    pose: object,
    work: Work | _Pair,
    summary: Summary,
    errors: Array | None,
    known: tuple[Finding, ...],
    grounds: Callable[[], Grounds],
    where: str,
    *,
    before: Sequence[Finding] = (),
    after: Sequence[Finding] = (),
    **more: Any,
) -> MonteCarloResult:
    """Return the result at a pose, completed from the model, and add its warnings.

    Args:
        known: Findings passed in.
        grounds: Returns the grounds of the verdicts, if there are specifications.
        where: End of the warning that the errors do not vary.
        before, after: Warnings in front of those about the samples, and behind.
        more: Fields that depend on the kind of the errors.
    """
    if summary.specifications:
        summary = summary.with_grounds(grounds())
    chain, draws, names = error_model.chain, at.space.draws, work.layout.space.components
    units = sorted({extreme.sample for extreme in (*summary.largest_position, *summary.largest_attitude)})
    new_findings = (
        *at.findings(work.model), *error_model.statics_findings(at), *exact_findings_at(error_model, at), *before,
        *find_constant_error(summary, known, where), *find_coarse_bins(summary), *after,
    )  # fmt: skip
    add(new_findings)
    return MonteCarloResult(
        robot=os.path.basename(chain.robot.file),
        base=chain.base,
        tip=chain.tip_label,
        pose_name=error_model.pose_name(pose),
        q=dict(zip(chain.joint_names, map(float, at.posture.q), strict=True)),
        approach=written_approach(chain.joint_names, at.posture.approach),
        seed=work.seed,
        model=work.model,
        statics=error_model.statics,
        scopes={scope.value: sum(draw.law.size for draw in draws if draw.scope is scope) for scope in Scope},
        sliding_joints=tuple(joint.name for joint in chain.joints if joint.kind == "prismatic"),
        correlations=Correlated.all_of(at.space),
        summary=summary,
        makers={
            unit: dict(zip(names, sampler.sample(work.layout, work.seed, unit, 1)[:, 0].tolist(), strict=True))
            for unit in units
        },
        assumed=error_model.assumed,
        sources=len(error_model.sources),
        warnings=tuple(str(finding) for finding in (*known, *new_findings)),
        errors=errors,
        space=None if errors is None else at.space,
        findings=known,
        **more,
    )


def _datum_at(error_model: ErrorModel, at: PoseModel, work: Work) -> DatumRecord | None:
    """Return what the errors are counted against, with the quantiles of the first robots in base axes."""
    record, count = error_model.datum_record(at), min(work.samples, BLOCK)
    ranks = quantile_ranks(count, 0.95, 0.95)
    if record is None or ranks is None:
        return record
    errors = sampler.errors(sampler.to_arrays(at.in_base_axes), work.model, work.seed, 0, count).reshape(2, 3, -1)
    sizes = np.sort(np.linalg.norm(errors, axis=1))
    quantiles, intervals = np.quantile(sizes, 0.95, axis=1), sizes[:, np.array(ranks) - 1]
    return replace(record, base_axes={"samples": count, "quantile_95": quantiles, "interval": intervals})


def _enough(
    targets: Sequence[Target], plan: Plan, confidence: float, tell: Callable[[str], None]
) -> Callable[[State], bool]:
    """Return a function that checks whether all targets are reached, and otherwise reports the samples needed."""

    def enough(state: State) -> bool:
        summary = finish(plan, state, confidence)
        precisions = [reached(goal, summary) for goal in targets]
        if all(precision.reached for precision in precisions):
            return True
        for goal, precision in zip(targets, precisions, strict=True):
            _check_resolved(goal, precision, summary)
        counts = [precision.needed(state.count) for precision in precisions]
        about = f"about {max(filter(None, counts)):,.3g} are needed" if all(counts) else "more are needed"
        tell(f"{state.count:,} samples are not precise enough yet, {about}")
        return False

    return enough


def _check_resolved(goal: Target, precision: Precision, summary: Summary) -> None:
    """Reject a tolerance below the error of the sketch, which more samples do not reduce."""
    if isinstance(goal.statistic, str):
        return
    error = summary.distribution(goal.quantity).quantile_error(goal.statistic)
    unit = "m" if goal.quantity.startswith("position") else "rad"
    if error is not None and error > precision.tolerance:
        raise InputError(
            f"the {goal.statistic:.6g} quantile of {goal.quantity} is resolved to {error:.2g} {unit} only, the "
            f"target's tolerance is {precision.tolerance:.2g} {unit}; set a larger one, or compute the exact law"
        )


def _missed_target(text: str, precision: Precision, samples: int) -> Finding:
    count = precision.needed(samples)
    about = "" if count is None else f"; about {count:,.3g} are needed"
    return Finding("warning", "W_UNTIL", f"{samples:,} samples do not reach the target {text}{about}")


def model_at_pose(error_model: ErrorModel, q: OnePose) -> PoseModel:
    """Return the model at the pose, after checking that its first-order errors do not overflow."""
    try:
        with np.errstate(over="raise"):
            at = error_model.at(q)
            if np.abs(at.tangent[0]).max() ** 2 + np.abs(at.covariance).max() > LARGEST_SQUARE:
                raise OverflowError
            return at
    except (OverflowError, FloatingPointError):
        raise InputError(
            "the errors at this pose are too large to compute with; the tolerances or loads are far too large"
        ) from None


_COARSE: Final = 0.05
"""Ratio of a quantile's bin error to the standard deviation above which a warning is given."""
_ROUNDING: Final = 1e-14
"""Errors below this value, m or rad, count as rounding."""


def find_constant_error(summary: Summary, known: Sequence[Finding], where: str) -> list[Finding]:
    """Return a warning if the error does not vary, unless the sheet's findings include it."""
    if any(summary.varying) or any(finding.code in ("W_NO_SOURCES", "W_NOTHING_VARIES") for finding in known):
        return []
    message = f"no source makes the error vary {where}, and no specification can be judged"
    return [Finding("warning", "W_NOTHING_VARIES", message)]


def find_coarse_bins(summary: Summary) -> list[Finding]:
    """Return a warning for each quantity with a quantile in too wide a bin for the sampled spread."""
    findings = []
    for quantity in QUANTITIES:
        distribution = summary.distribution(quantity)
        allowed = max(_COARSE * (distribution.std or 0.0), _ROUNDING)
        if (distribution.bin_upper - distribution.bin_lower).max() <= allowed:
            continue
        errors = {level: distribution.quantile_error(level) or 0.0 for level in distribution.levels}
        level = max(errors, key=lambda name: errors[name])
        if errors[level] > allowed:
            unit = "m" if quantity.startswith("position") else "rad"
            message = (
                f"the {100 * level:.4g} % quantile of {quantity} is resolved to {errors[level]:.2g} {unit} only, because rare "
                "errors lie far outside the range that the bins were planned for; its interval is widened accordingly"
            )
            findings.append(Finding("warning", "W_BINS", message))
    return findings


# blocks merged in order -----------------------------------------------------------------------------------------------


def sample_blocks(
    run: Run[State],
    work: Work | _Pair,
    blocks_in_a_task: int | None = None,
    enough: Callable[[State], bool] | None = None,
) -> Array | None:
    """Sample from the state of a run to the end, or to the first passed check, and return the errors if they are kept.

    The checks are made after 1, 2, 4, 8 … blocks whatever the workers.
    """
    errors = np.empty((6, work.samples)) if work.keep_errors else None
    blocks = -(-work.samples // BLOCK)
    if run.state.count:
        run.step(run.state.count)

    def add_blocks(first_block: int, result: Blocks | _PairErrors) -> int:
        begin = run.state.count
        if begin != first_block * BLOCK:
            return 0
        if errors is not None and result.errors is not None:
            errors[:, begin : begin + result.count] = result.errors
        run.state = result.add_to(run.state)
        return result.count

    checks = [] if enough is None else [2**k for k in range((blocks - 1).bit_length())]
    for end in (*checks, blocks):
        first = -(-run.state.count // BLOCK)
        # tasks that keep a worker busy, yet enough of them for regular progress
        size = blocks_in_a_task or min(run.workers.blocks_in_a_task, max(1, (end - first) // 8))
        run.work_off(
            ((block, work.observe, block, min(size, end - block)) for block in range(first, end, size)), add_blocks
        )
        if enough is not None and run.state.count // BLOCK == end and enough(run.state):
            break
    return errors


@warns_at_end
@takes_datum
def relative(
    error_model: ErrorModel,
    /,
    pose: OnePose,
    other: OnePose,
    *,
    samples: int = 100_000,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    specifications: Specifications = (),
    keep_samples: bool = False,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    threads: int | None = None,
    progress: Progress | bool | None = None,
) -> MonteCarloResult:
    """Sample the error of robots at a pose relative to the error of the same robots at another.

    A robot whose program holds its errors at ``other`` works at ``pose`` with e_p - e_q. One that moves relative to the
    frame taught there has d_p - d_q - δ_q × (p_p - p_q) instead: :meth:`precision_pin.Datum.taught`.

    Args:
        error_model: Chain, draws and sources.
        pose, other: The pose p at which the robot works, and the pose q whose errors are subtracted; each as for
            :func:`precision_pin.monte_carlo`.
        samples: Number of built robots.
        seed: 64-bit seed.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors (eqs 12-17).
        specifications: Limits of the relative error to count against, along tool axes those of ``pose``: one or a list,
            each from :func:`precision_pin.specification` or its text.
        keep_samples: Keep every relative error, ``(6, samples)``.
        confidence: Confidence of every interval.
        findings: Warnings to include in the result, such as those of the sheet.
        threads: Number of threads, by default one for each core. It does not change the result.
        progress: Function called with the number of robots added since its last call; ``True`` shows a bar.

    Returns:
        With ``relative_to``; its other fields are those of ``pose`` and of the relative error.

    Raises:
        InputError: A wrong number of samples, seed, model, confidence, pose or threads; errors too large to compute
            with; more samples to keep than fit into memory.
        UnknownNameError: No such pose or joint.

    The components of e_p - e_q are d_p - d_q, the difference of the tip's displacements, and δ_p - δ_q, the difference
    of the rotation vectors; each error is that of the displaced chain against the nominal one at its own pose. Both are
    in base axes, even if the tool turns between the poses.

    Draws of unit scope are those of one robot at both poses, the same numbers as in :func:`precision_pin.monte_carlo`
    with the same seed. Draws of visit scope are independent. So are those of pose scope, unless both poses have the
    same joint values: then they are shared, and what remains is the difference between two visits.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.relative(model, "paper", [-1.5, 0.1, 1.5, -1.6], samples=2000)
        >>> print(round(1e3 * result.position.norm.quantile(0.95)))
        2
    """
    run_settings = RunSettings(threads, progress=progress)
    findings = check_common(error_model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    check_samples(samples, keep_samples=keep_samples)
    limits = listed_specifications(specifications)
    models = model_at_pose(error_model, pose), model_at_pose(error_model, other)
    layouts = sampler.to_arrays(models[0]), sampler.to_arrays(models[1])
    pair = _Pair(*models, *layouts, model, int(seed), int(samples), keep_samples, limits)
    with run_settings.begun(start(pair.plan), SAMPLES, lambda _: {}, pair.samples) as run:
        errors = sample_blocks(run, pair)
    summary = finish(pair.plan, run.state, confidence, first_order=pair.covariance)
    label, joints = error_model.pose_name(other), error_model.chain.joint_names
    state = pair.other.posture

    def grounds() -> Grounds:
        names = (error_model.pose_name(pose) or "the pose", label or "the pose relative to which errors are taken")
        joint_values = np.column_stack([pair.at.posture.q, state.q])
        pairs = (pair, replace(pair, model="exact")) if model == "linear" else ()
        tool_axes = pair.at.posture.tool_axes
        absolute = [specified_values(pair.specifications, variant.errors(0, BLOCK), tool_axes) for variant in pairs]
        return grounds_at(error_model, joint_values, names, both=pairwise(absolute))

    return _result(
        error_model, pair.at, pose, pair, summary, errors, findings, grounds,
        "between these poses: all robots have the same relative error",
        before=_name_pose((*pair.other.findings(model), *error_model.statics_findings(pair.other)), label),
        relative_to=RelativeTo(
            label, dict(zip(joints, map(float, state.q), strict=True)), written_approach(joints, state.approach)
        ),
        datum=error_model.datum_record(pair.at),
        nominal=pair.at.tangent[0] - pair.other.tangent[0],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _PairErrors:
    """Relative errors ``(6, count)`` of consecutive blocks."""

    plan: Plan
    errors: Array

    @property
    def count(self) -> int:
        return self.errors.shape[1]

    def add_to(self, state: State) -> State:
        """Return the state with these errors added."""
        return observe(self.plan, state, self.errors)


@dataclass(frozen=True, eq=False)
class _Pair:
    at: PoseModel
    other: PoseModel
    layout: SamplerArrays
    other_layout: SamplerArrays
    model: Literal["exact", "linear"]
    seed: int
    samples: int
    keep_errors: bool
    specifications: tuple[Specification, ...]

    @cached_property
    def is_same_pose(self) -> bool:
        """Whether both poses have the same joint values, so that draws of pose scope are shared."""
        return bool((self.at.posture.q == self.other.posture.q).all())

    @cached_property
    def shared(self) -> NDArray[np.bool_]:
        """Mask ``(d,)`` of the numbers that a robot shares between the poses."""
        scopes = (Scope.UNIT, Scope.POSE) if self.is_same_pose else (Scope.UNIT,)
        return self.at.space.has_scope(*scopes)

    def errors(self, first: int, count: int) -> Array:
        """Return the relative errors ``(6, count)`` of robots ``first … first + count - 1``."""
        pose, visit = (0, 1) if self.is_same_pose else (1, 0)
        result: Array = sampler.errors(self.layout, self.model, self.seed, first, count)
        result -= sampler.errors(self.other_layout, self.model, self.seed, first, count, pose=pose, visit=visit)
        return result

    @property
    def covariance(self) -> Array:
        """First-order covariance of the relative error, ``(6, 6)``."""
        covariance, mask = self.at.space.block_covariance, self.shared.astype(float)
        difference = self.at.jacobian - self.other.jacobian
        total: Array = covariance.scaled(mask).between(difference, difference)
        for at in (self.at, self.other):
            total = total + covariance.scaled(1.0 - mask).between(at.jacobian, at.jacobian)
        return total

    def observe(self, first_block: int, blocks: int) -> _PairErrors:
        """Return the errors of some blocks."""
        first = first_block * BLOCK
        return _PairErrors(self.plan, self.errors(first, min(blocks * BLOCK, self.samples - first)))

    @cached_property
    def plan(self) -> Plan:
        """Centres and bins, from the first robots of the seed."""
        a, b, shared = self.at.tangent[1], self.other.tangent[1], self.shared
        space = self.at.space
        other_draws = [draw for draw, rows in zip(space.draws, space.slices, strict=True) if not shared[rows].any()]
        # draws that are not shared count at either pose
        columns = np.hstack([np.where(shared, a - b, a), -b[:, ~shared]])
        plan = plan_by_pilot(
            lambda: self.errors(0, PILOT),
            (self.at.error_at_means - self.other.error_at_means, self.covariance),
            reach(self.at, self.layout, np.where(shared, np.abs(a - b), np.abs(a) + np.abs(b))),
            first_order_skewness((*space.draws, *other_draws), columns),
            self.specifications,
        )
        return replace(plan, tool_axes=self.at.posture.tool_axes)


def _name_pose(findings: Sequence[Finding], label: str) -> list[Finding]:
    phrase = f"pose {label!r}, relative to which" if label else "the pose relative to which"
    return [replace(finding, message=f"{phrase} errors are taken: {finding.message}") for finding in findings]
