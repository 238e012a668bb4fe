"""Distribution of the pose error at one pose, by sampling."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import progress as progress_bar
from precision_pin.base.arguments import check_flag, check_instance, check_items, check_kept, check_whole, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, OutputError, add, warns_at_end
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import check_seed
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import BLOCK, Blocks
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel, origin_shares
from precision_pin.model.verdict_grounds import by_both_models, exact_findings_at, grounds_at
from precision_pin.robot.configurations import ApproachedPose, written_approach
from precision_pin.sampling.blocks import (
    PILOT,
    Work,
    check_samples,
    first_order_skewness,
    packages,
    plan_by_pilot,
    planned,
    reach,
)
from precision_pin.sampling.journal import Journal, check_saving, identity, opened, samples_of
from precision_pin.sampling.result import Correlated, MonteCarloResult, RelativeTo, Until
from precision_pin.sampling.workers import MOST_WORKERS, Submitter, Workers, available_cores, chosen, in_order
from precision_pin.statistics import (
    QUANTITIES,
    Plan,
    Specification,
    State,
    Summary,
    check_confidence,
    finish,
    observe,
    start,
)
from precision_pin.statistics.accumulate import quantity_values
from precision_pin.statistics.plan import Specifications, listed_specifications
from precision_pin.statistics.precision import Precision, Target, reached, target

_LARGEST_SQUARE: Final = 1e75
"""Largest square of errors accepted, m² or rad²: beyond, sums of fourth powers overflow."""

Progress = Callable[[int], None]
"""Function called with the number of samples added since its last call."""


@warns_at_end
def monte_carlo(
    error_model: ErrorModel,
    /,
    q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None,
    *,
    pose: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None,
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
        q, pose: The pose: joint values in chain order, by joint name, or the name of a pose; by default the model's
            first pose. The two arguments are synonyms.
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
    """
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    if pose is not None and q is not None:
        raise InputError("q and pose mean the same; give one of them")
    pose = q if pose is None else pose
    pose = pose if approach is None else ApproachedPose(pose, approach)
    specifications = check_run(samples, seed, model, confidence, specifications)
    until = (until,) if isinstance(until, str) else check_items("until, targets,", until, str)
    findings = check_items("findings", findings, Finding)
    check_flag("keep_samples", keep_samples)
    check_saving(journal, resume, files, tell)
    check_progress(progress)
    if keep_samples:
        if journal is not None:
            raise InputError("a journal holds statistics only; keep_samples is not possible with a journal")
        if until:
            raise InputError("with until the number of samples is not known in advance; keep_samples is not possible")
        check_kept(samples)
    targets = [target(text) for text in until]
    workers = chosen(threads, processes, executor, tasks_under_way)
    at = model_at_pose(error_model, pose)
    layout = sampler.to_arrays(at)
    plan = planned(at, layout, model, int(seed), specifications)
    work = Work(layout, plan, model, int(seed), int(samples), keep_samples, packages())
    state = start(plan)
    with ExitStack() as stack:
        step = stack.enter_context(progress_bar.progress(work.samples)) if progress is True else progress or do_nothing
        kept_in = None
        if journal is not None:
            known = {**identity(work, at.posture, files or {}), "until": "; ".join(until)}
            kept_in, state = stack.enter_context(
                opened(journal, known, state, samples_of(plan), resume=resume, tell=tell or do_nothing)
            )
            if state.count:
                step(state.count)
        sampling = Sampling(work, state, step, kept_in)
        done = False
        try:
            sampling.run(workers, enough=_enough(targets, plan, confidence, tell or do_nothing) if targets else None)
            done = True
        finally:
            workers.close(done=done)
    spread = np.sqrt(np.maximum(np.diag(at.covariance), 0.0))
    summary = finish(plan, sampling.state, confidence, spread=spread)
    if specifications:
        summary = summary.with_grounds(
            grounds_at(error_model, at.posture.q[:, None], both=by_both_models([at], model, int(seed)))
        )
    precisions = [reached(wanted, summary) for wanted in targets]
    found = (
        *at.findings(model), *error_model.statics_findings(at), *exact_findings_at(error_model, at),
        *find_constant_error(summary, findings, "at this pose: all robots have the same error"),
        *find_coarse_bins(summary),
        *(_missed_target(text, one, summary.samples) for text, one in zip(until, precisions, strict=True) if not one.reached),
    )  # fmt: skip
    add(found)
    return result_at(
        error_model, at, pose, summary, work.layout, int(seed), model,
        nominal=at.tangent[0],
        origins=origin_shares(error_model.origins, at),
        until=tuple(Until(text, one) for text, one in zip(until, precisions, strict=True)),
        warnings=tuple(str(finding) for finding in (*findings, *found)),
        errors=sampling.errors,
        findings=findings,
    )  # fmt: skip


def check_run(
    samples: int, seed: int, model: str, confidence: float, specifications: Specifications
) -> tuple[Specification, ...]:
    """Check the settings of a run at one pose, and return its specifications."""
    check_samples(samples)
    check_seed(seed)
    sampler.stage_of(model)  # type: ignore[arg-type]
    check_confidence(confidence)
    return listed_specifications(specifications)


def result_at(
    error_model: ErrorModel,
    at: PoseModel,
    pose: object,
    summary: Summary,
    layout: SamplerArrays,
    seed: int,
    model: str,
    **found: Any,
) -> MonteCarloResult:
    """Return the result at a pose, completed from the model."""
    chain, draws, names = error_model.chain, at.space.draws, layout.space.components
    units = sorted({one.sample for one in (*summary.largest_position, *summary.largest_attitude)})
    return MonteCarloResult(
        robot=os.path.basename(chain.robot.file),
        base=chain.base,
        tip=chain.tip_label,
        pose_name=error_model.pose_name(pose),
        q=dict(zip(chain.joint_names, map(float, at.posture.q), strict=True)),
        approach=written_approach(chain.joint_names, at.posture.approach),
        seed=seed,
        model=model,
        statics=error_model.statics,
        scopes={scope.value: sum(draw.law.size for draw in draws if draw.scope is scope) for scope in Scope},
        sliding_joints=tuple(joint.name for joint in chain.joints if joint.kind == "prismatic"),
        correlations=Correlated.all_of(at.space),
        summary=summary,
        makers={
            unit: dict(zip(names, sampler.sample(layout, seed, unit, 1)[:, 0].tolist(), strict=True)) for unit in units
        },
        assumed=error_model.assumed,
        sources=len(error_model.sources),
        **found,
    )


def check_progress(progress: object) -> None:
    """Check that progress is a function, a flag or None."""
    if progress is not None and not isinstance(progress, bool) and not callable(progress):
        raise InputError(f"progress must be a function, or True for a bar, got {shown(progress)}")


def _enough(
    targets: Sequence[Target], plan: Plan, confidence: float, tell: Callable[[str], None]
) -> Callable[[State], bool]:
    """Return a function that checks whether all targets are reached, and otherwise reports the samples needed."""

    def enough(state: State) -> bool:
        summary = finish(plan, state, confidence)
        found = [reached(wanted, summary) for wanted in targets]
        if all(one.reached for one in found):
            return True
        for wanted, one in zip(targets, found, strict=True):
            _check_resolved(wanted, one, summary)
        needed = [one.needed(state.count) for one in found]
        about = f"about {max(filter(None, needed)):,.3g} are needed" if all(needed) else "more are needed"
        tell(f"{state.count:,} samples are not precise enough yet, {about}")
        return False

    return enough


def _check_resolved(wanted: Target, found: Precision, summary: Summary) -> None:
    """Reject a tolerance below the error of the sketch, which more samples do not reduce."""
    if isinstance(wanted.statistic, str):
        return
    error = summary.distribution(wanted.quantity).quantile_error(wanted.statistic)
    unit = "m" if wanted.quantity.startswith("position") else "rad"
    if error is not None and error > found.tolerance:
        raise InputError(
            f"the {wanted.statistic:.6g} quantile of {wanted.quantity} is resolved to {error:.2g} {unit} only, the "
            f"target's tolerance is {found.tolerance:.2g} {unit}; set a larger one, or compute the exact law"
        )


def _missed_target(text: str, found: Precision, samples: int) -> Finding:
    needed = found.needed(samples)
    about = "" if needed is None else f"; about {needed:,.3g} are needed"
    return Finding("warning", "W_UNTIL", f"{samples:,} samples do not reach the target {text}{about}")


def model_at_pose(
    error_model: ErrorModel, q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None
) -> PoseModel:
    """Return the model at the pose, after checking that its first-order errors do not overflow."""
    try:
        with np.errstate(over="raise"):
            at = error_model.at(q)
            if np.abs(at.tangent[0]).max() ** 2 + np.abs(at.covariance).max() > _LARGEST_SQUARE:
                raise OverflowError
            return at
    except (OverflowError, FloatingPointError):
        raise InputError(
            "the errors at this pose are too large to compute with; the tolerances or loads are far too large"
        ) from None


def do_nothing(_: object) -> None:
    """Ignore the argument."""


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
    found = []
    for quantity in QUANTITIES:
        distribution = summary.distribution(quantity)
        allowed = max(_COARSE * (distribution.std or 0.0), _ROUNDING)
        if (distribution.bin_upper - distribution.bin_lower).max() <= allowed:
            continue
        errors = {level: distribution.quantile_error(level) or 0.0 for level in distribution.levels}
        level = max(errors, key=lambda one: errors[one])
        if errors[level] > allowed:
            unit = "m" if quantity.startswith("position") else "rad"
            message = (
                f"the {100 * level:.4g} % quantile of {quantity} is resolved to {errors[level]:.2g} {unit} only, because rare "
                "errors lie far outside the range that the bins were planned for; its interval is widened accordingly"
            )
            found.append(Finding("warning", "W_BINS", message))
    return found


# blocks merged in order and saved in a journal -----------------------------------------------------------------------


class Sampling:
    """Run from a given state to the last sample."""

    def __init__(
        self, work: Work, state: State, progress: Callable[[int], None], journal: Journal[State] | None
    ) -> None:
        self.state = state
        self.errors: NDArray[np.float64] | None = np.empty((6, work.samples)) if work.keep_errors else None
        self._work = work
        self._progress = progress
        self._journal = journal

    def run(
        self, workers: Workers, blocks_in_a_task: int | None = None, enough: Callable[[State], bool] | None = None
    ) -> None:
        """Sample to the end, or to the first passed check, after 1, 2, 4, 8 … blocks whatever the workers."""
        blocks = self._work.blocks
        checks = [] if enough is None else [2**k for k in range((blocks - 1).bit_length())]
        for end in (*checks, blocks):
            if self._next_block < end:
                self._run_to(end, workers, blocks_in_a_task)
            if enough is not None and self.state.count // BLOCK == end and enough(self.state):
                break
        if self._journal is not None:
            self._journal.save(self.state)

    def _run_to(self, end: int, workers: Workers, blocks_in_a_task: int | None) -> None:
        first = self._next_block
        # tasks that keep a worker busy, yet enough of them for regular progress
        size = blocks_in_a_task or min(workers.blocks_in_a_task, max(1, (end - first) // 8))
        starts, under_way = iter(range(first, end, size)), dict[int, Any]()
        try:
            while self._next_block < end:
                while len(under_way) < workers.most and (start := next(starts, None)) is not None:
                    under_way[start] = workers.submit(self._work, start, min(size, end - start))
                count = self._add_next(workers, under_way)
                if self._journal is not None:
                    self._journal.save_if_due(self.state)
                self._progress(count)
        except KeyboardInterrupt as interrupt:
            if self._journal is not None:
                # a running task that fails now fails again in the resumed run, which reports it
                with suppress(Exception):
                    while self._next_block in under_way:
                        self._add_next(workers, under_way)
                self._journal.save(self.state)
                interrupt.add_note(
                    f"the journal {self._journal.name} holds the first {self._journal.saved:,} of "
                    f"{self._work.samples:,} samples"
                )
            raise
        except OutputError:
            raise
        except Exception:
            if self._journal is not None:
                self._journal.save(self.state)
            raise

    @property
    def _next_block(self) -> int:
        return -(-self.state.count // BLOCK)

    def _add_next(self, workers: Workers, under_way: dict[int, Any]) -> int:
        """Wait for the task that begins with the next block, add its samples, and return how many they are."""
        block, begin = self._next_block, self.state.count
        found: Blocks = workers.result(under_way[block])
        if self.errors is not None and found.errors is not None:
            self.errors[:, begin : begin + found.count] = found.errors
        self.state = found.add_to(self.state)
        del under_way[block]
        return found.count


OnePose = ArrayLike | Mapping[str, float] | ApproachedPose | str | None


@warns_at_end
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

    A robot that is taught at ``other``, where its error enters the program, works at ``pose`` with e_p - e_q.

    Args:
        error_model: Chain, draws and sources.
        pose, other: The pose p at which the robot works, and the pose q whose errors are subtracted; each as for
            :func:`precision_pin.monte_carlo`.
        samples: Number of built robots.
        seed: 64-bit seed.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors (eqs 12-17).
        specifications: Limits of the relative error to count against: one or a list, each from
            :func:`precision_pin.specification` or its text.
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
    """
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    listed = check_run(samples, seed, model, confidence, specifications)
    known = check_items("findings", findings, Finding)
    check_flag("keep_samples", keep_samples)
    if threads is not None:
        check_whole("threads", threads, 1, MOST_WORKERS)
    check_progress(progress)
    if keep_samples:
        check_kept(samples)
    ends = model_at_pose(error_model, pose), model_at_pose(error_model, other)
    pair = _Pair(*ends, sampler.to_arrays(ends[0]), sampler.to_arrays(ends[1]), model, int(seed))
    plan = pair.plan(listed)
    state, kept = start(plan), []
    parts = (partial(pair.errors, first, min(BLOCK, int(samples) - first)) for first in range(0, int(samples), BLOCK))
    with ExitStack() as stack:
        step = stack.enter_context(progress_bar.progress(samples)) if progress is True else progress or do_nothing
        # blocks are added in order, so that the sums do not depend on the threads
        for block in stack.enter_context(closing(in_order(parts, threads or available_cores()))):
            state = observe(plan, state, block)
            if keep_samples:
                kept.append(block)
            step(block.shape[1])
    summary = finish(plan, state, confidence, spread=np.sqrt(np.maximum(np.diag(pair.covariance), 0.0)))
    label = error_model.pose_name(other)
    both = np.column_stack([pair.at.posture.q, pair.other.posture.q])
    names = (error_model.pose_name(pose) or "the pose", label or "the pose relative to which errors are taken")
    grounds = grounds_at(error_model, both, names)
    if model == "linear":
        linear, exact = (np.abs(quantity_values(one.errors(0, BLOCK))) for one in (pair, replace(pair, model="exact")))
        grounds = replace(grounds, both=(linear, exact))
    summary = summary.with_grounds(grounds)
    found = (
        *pair.at.findings(model), *error_model.statics_findings(pair.at),
        *exact_findings_at(error_model, pair.at),
        *_named((*pair.other.findings(model), *error_model.statics_findings(pair.other)), label),
        *find_constant_error(summary, known, "between these poses: all robots have the same relative error"),
        *find_coarse_bins(summary),
    )  # fmt: skip
    add(found)
    joints, approach = error_model.chain.joint_names, pair.other.posture.approach
    return result_at(
        error_model, pair.at, pose, summary, pair.layout, int(seed), model,
        relative_to=RelativeTo(
            label, dict(zip(joints, map(float, pair.other.posture.q), strict=True)), written_approach(joints, approach)
        ),
        nominal=pair.at.tangent[0] - pair.other.tangent[0],
        warnings=tuple(str(finding) for finding in (*known, *found)),
        errors=np.concatenate(kept, axis=1) if keep_samples else None,
        findings=known,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Pair:
    at: PoseModel
    other: PoseModel
    layout: SamplerArrays
    other_layout: SamplerArrays
    model: Literal["exact", "linear"]
    seed: int

    @cached_property
    def is_same_pose(self) -> bool:
        """Whether both poses have the same joint values, so that draws of pose scope are shared."""
        return bool((self.at.posture.q == self.other.posture.q).all())

    @cached_property
    def shared(self) -> NDArray[np.bool_]:
        """Mask ``(d,)`` of the numbers that a robot shares between the poses."""
        scopes = (Scope.UNIT, Scope.POSE) if self.is_same_pose else (Scope.UNIT,)
        draws = self.at.space.draws
        sizes = [draw.law.size for draw in draws]
        return np.repeat(np.array([draw.scope in scopes for draw in draws], dtype=np.bool_), sizes)

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

    def plan(self, specifications: tuple[Specification, ...]) -> Plan:
        """Return centres and bins, from the first robots of the seed."""
        here, there, shared = self.at.tangent[1], self.other.tangent[1], self.shared
        space = self.at.space
        own = [draw for draw, rows in zip(space.draws, space.slices, strict=True) if not shared[rows].any()]
        # draws that are not shared count at either pose
        columns = np.hstack([np.where(shared, here - there, here), -there[:, ~shared]])
        return plan_by_pilot(
            lambda: self.errors(0, PILOT),
            (self.at.error_at_means - self.other.error_at_means, self.covariance),
            reach(self.at, self.layout, np.where(shared, np.abs(here - there), np.abs(here) + np.abs(there))),
            first_order_skewness((*space.draws, *own), columns),
            specifications,
        )


def _named(findings: Sequence[Finding], label: str) -> list[Finding]:
    where = f"pose {label!r}, relative to which" if label else "the pose relative to which"
    return [replace(one, message=f"{where} errors are taken: {one.message}") for one in findings]
