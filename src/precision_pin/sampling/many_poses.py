"""Distribution of the pose error at many poses, by sampling the same built robots at all of them.

The poses are processed in groups, each group in tasks of some blocks. The sums of a block depend on error model, seed,
pose and block number only and are added in block order. The result therefore has the same bits for any number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import progress as progress_bar
from precision_pin.base.arguments import check_instance, check_items, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import add, warns_at_end
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.memory import check_memory
from precision_pin.draws.draw import MOST_POSES, Scope
from precision_pin.draws.space import check_seed
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.many_poses import MOST_TOGETHER, JoinedTables, is_alike
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.verdict_grounds import exact_findings, strained_findings
from precision_pin.render.tables import pose_labels
from precision_pin.robot.approach import ApproachedPose
from precision_pin.robot.chain import pose_findings
from precision_pin.sampling import Progress, available_cores, check_progress
from precision_pin.sampling.blocks import Work, packages
from precision_pin.sampling.checkpoint import POSES, PosesDone, start_of_poses
from precision_pin.sampling.journal import Journal, digest, identity, opened
from precision_pin.sampling.one_pose import do_nothing
from precision_pin.sampling.pose_group import PILOTS, Model, PoseGroup, PosesWork
from precision_pin.sampling.poses_result import PosesResult
from precision_pin.sampling.workers import Submitter, Workers, chosen
from precision_pin.statistics import (
    COMPONENTS,
    NORMS,
    Plan,
    Specification,
    check_confidence,
)
from precision_pin.statistics.plan import Specifications, listed_specifications

MOST_SAMPLES: Final = 2**32 - 1
"""Most samples at each pose; the sketches count with 32 bits."""

_STRAINS: Final = ("W_STATICS", "W_DEFLECTION", "W_TURNOVER")
"""Warnings about statics, which a caller may have looked for at every pose."""
_NUMBERS: Final = 73
"""Numbers in the result of a pose, including its name, without the specifications."""
_TASK: Final = 256
"""Blocks times poses in a task, which takes a fraction of a second."""


@warns_at_end
def sample_poses(
    error_model: ErrorModel,
    /,
    q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object] | ApproachedPose,
    *,
    approach: object = None,
    samples: int = 10_000,
    seed: int = 0,
    model: Model = "exact",
    specifications: Specifications = (),
    everywhere: bool = False,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    threads: int | None = None,
    processes: int | None = None,
    executor: Submitter | None = None,
    tasks_under_way: int | None = None,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    files: Mapping[str, str | os.PathLike[str]] | None = None,
    tell: Callable[[str], None] | None = None,
    progress: Progress | bool | None = None,
) -> PosesResult:
    """Sample the pose error of the same built robots at many poses.

    Draws of unit scope are made once for a robot and apply at all poses; those of pose and visit scope are made at each
    pose. Where all draws have unit scope, the samples at every pose are those of :func:`precision_pin.monte_carlo` with
    the same seed. Draws of other scopes depend on the number of the pose, counted from 0.

    Args:
        error_model: Chain, draws and sources.
        q: The poses: an array ``(n, P)`` of joint values (rad, m) in chain order, one column for each pose; a list of
            poses, each a name, joint values in chain order or by name; or a mapping of joint names to P values. A
            square array is read by columns, with a warning where the joint limits do not rule out rows.
        approach: Approach of every pose, as in :class:`precision_pin.ApproachedPose`: ``"previous"``, from the pose
            before it, or the same directions at each. Poses of a list may have their own; by default those of the
            poses' names.
        samples: Number of built robots, at most 2³² - 1.
        seed: 64-bit seed.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors (eqs 12-17).
        specifications: Limits to count against: one or a list, each from :func:`precision_pin.specification` or its
            text.
        everywhere: Whether a specification is met only if enough robots keep it at all poses, each robot at every one
            of them; this samples every pose once more.
        confidence: Confidence of every interval.
        findings: Warnings to include in the result, such as those of the sheet.
        threads, processes, executor, tasks_under_way: What samples, as in :func:`precision_pin.monte_carlo`; by default
            a thread for each core. It does not change the result. Robots are counted ``everywhere`` on threads of this
            process in any case.
        journal, resume, files, tell: File in which finished poses are saved, up to 64 at a time, and what is resumed
            from it, as in :func:`precision_pin.monte_carlo`.
        progress: Function called with the number of samples, of all poses together, added since its last call; ``True``
            shows a bar.

    Raises:
        InputError: A wrong number of samples, seed, model, confidence or workers; a journal of another run; no poses,
            wrong joint values, more than 2²⁰-1 poses where draws have pose or visit scope, or more than fit into
            memory; errors too large to compute with.
        UnknownNameError: No such pose or joint.
    """
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    check_seed(seed)
    check_whole("the number of samples", samples, 1, MOST_SAMPLES)
    known = check_items("findings", findings, Finding)
    check_progress(progress)
    sampler.stage_of(model)
    check_confidence(confidence)
    work = PosesWork(model, int(seed), int(samples), listed_specifications(specifications))
    q = q if approach is None else ApproachedPose(q, approach)
    values, names = _poses(error_model, q, work.specifications)
    approaches = error_model.approaches_of(q, values)
    count = values.shape[1]
    found = (*pose_findings(error_model.chain, values, names), *exact_findings(error_model, values, approaches))
    add(found)
    if resume and journal is None:
        raise InputError("resume needs a journal to resume from")
    workers = chosen(threads, processes, executor, tasks_under_way)
    with ExitStack() as stack:
        total = count * work.samples * (2 if everywhere and work.specifications else 1)
        step = stack.enter_context(progress_bar.progress(total)) if progress is True else progress or do_nothing
        state, kept_in = None, None
        if journal is not None:
            start = start_of_poses(_first_part(error_model, values, approaches, work, confidence), count)
            known_run = _identity(error_model, values, approaches, work, confidence, files or {})
            kept_in, state = stack.enter_context(
                opened(journal, known_run, start, POSES, resume=resume, tell=tell or do_nothing)
            )
            step(state.count * work.samples)
        sampled = _sample(error_model, values, approaches, work, workers, state, kept_in, confidence, step)
        kept = None
        if everywhere:
            pool = stack.enter_context(ThreadPoolExecutor(threads or available_cores()))
            kept = count_everywhere(
                error_model, values, approaches, work.specifications, model, work.seed, work.samples, pool, step
            )
    if not any(finding.code in _STRAINS for finding in known):
        worst = int(sampled.arrays()["norm_mean"][0].argmax())
        own = () if approaches is None else tuple(approaches[:, worst].tolist())
        strained = strained_findings(error_model, ApproachedPose(values[:, worst], own), pose_labels(names)[worst])
        add(strained)
        found = (*found, *strained)
    chain = error_model.chain
    return PosesResult(
        robot=os.path.basename(chain.robot.file),
        base=chain.base,
        tip=chain.tip_label,
        names=names,
        joints=tuple(chain.joint_names),
        q=values,
        approaches=approaches,
        samples=work.samples,
        seed=work.seed,
        model=model,
        statics=error_model.statics,
        confidence=confidence,
        specifications=work.specifications,
        error_model=error_model,
        kept_everywhere=kept,
        warnings=tuple(dict.fromkeys(map(str, (*known, *found)))),
        findings=known,
        **sampled.arrays(),
    )


def _sample(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    work: PosesWork,
    workers: Workers,
    state: PosesDone | None,
    journal: Journal[PosesDone] | None,
    confidence: float,
    step: Callable[[int], object],
) -> PosesDone:
    """Return the statistics of all poses; ``state`` holds those of the first ones, if there are any."""
    under_way: deque[tuple[PoseGroup, Any]] = deque()

    def add_oldest() -> None:
        nonlocal state
        group, future = under_way.popleft()
        found = workers.result(future)
        group.add(found)
        step(found.count * group.poses)
        if group.count == work.samples:
            part = group.to_arrays(confidence)
            state = (state or start_of_poses(part, values.shape[1])).with_part(part)
            if journal is not None:
                journal.save_if_due(state)

    done = False
    try:
        for group, first_block, blocks in _tasks(error_model, values, approaches, work, state.count if state else 0):
            under_way.append((group, workers.submit(group.work, first_block, blocks)))
            # finished tasks are added at once: with few robots, preparing further groups takes longer than sampling
            while under_way and (len(under_way) >= workers.most or workers.is_done(under_way[0][1])):
                add_oldest()
        while under_way:
            add_oldest()
        done = True
    except KeyboardInterrupt as interrupt:
        if journal is not None and state is not None:
            journal.save(state)
            note = f"the journal {journal.name} holds the first {journal.saved:,} of {values.shape[1]:,} poses"
            interrupt.add_note(note)
        raise
    finally:
        # after a failure or an interrupt the running tasks are awaited; each takes a fraction of a second
        workers.close(done=done)
    assert state is not None
    if journal is not None:
        journal.save(state)
    return state


# poses ---------------------------------------------------------------------------------------------------------------


def _poses(
    error_model: ErrorModel,
    q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object] | ApproachedPose,
    specifications: Sequence[Specification],
) -> tuple[Array, tuple[str, ...]]:
    """Return joint values ``(n, P)`` and the poses' names."""
    poses = q.pose if isinstance(q, ApproachedPose) else q
    given, specified = error_model.chain.configurations.count(poses), len(specifications)
    # joint values, and the results twice: once in groups and once concatenated
    numbers = 3 * len(error_model.chain.joints) + 2 * (_NUMBERS + 3 * specified)
    check_memory(8.0 * numbers * given, f"sampling {given:,} poses", "sample fewer of them at a time")
    values, names = error_model.configurations(q)
    if not names:
        raise InputError("no poses to sample; give at least one")
    has_pose_draws = any(draw.scope is not Scope.UNIT for draw in error_model.space.draws)
    if has_pose_draws and len(names) > MOST_POSES:
        raise InputError(f"{len(names):,} poses; with draws of pose or visit scope at most {MOST_POSES:,} are possible")
    return values, names


def _first_part(
    error_model: ErrorModel, values: Array, approaches: NDArray[np.int8] | None, work: PosesWork, confidence: float
) -> dict[str, Array]:
    """Return the arrays of the first pose from the first samples alone, which have the types and shapes of a result."""
    few = replace(work, samples=min(work.samples, PILOTS[0]))
    group, first_block, blocks = next(
        _tasks(error_model, values[:, :1], None if approaches is None else approaches[:, :1], few, 0)
    )
    group.add(group.work.observe(first_block, blocks))
    return group.to_arrays(confidence)


def _identity(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    work: PosesWork,
    confidence: float,
    files: Mapping[str, str | os.PathLike[str]],
) -> dict[str, str]:
    """Return all inputs that determine the bits of a run at several poses."""
    ends = sorted({0, values.shape[1] - 1})
    own = None if approaches is None else approaches[:, ends]
    models = list(error_model.at_columns(values[:, ends], own))
    plan = Plan(np.zeros(8), np.ones(8), work.specifications)
    layouts = [sampler.to_arrays(at) for at in models]
    single = Work(layouts[0], plan, work.model, work.seed, work.samples, False, packages())
    urdf = error_model.chain.robot.file
    read_from = {**({"URDF": urdf} if os.path.isfile(urdf) else {}), **files}
    return {
        **{name: text for name, text in identity(single, models[0].posture, read_from).items() if name != "pose"},
        "the list of poses": digest((values, approaches)),
        "the error model at the last pose": digest(layouts[-1]),
        "confidence": repr(confidence),
    }


def _tasks(
    error_model: ErrorModel, values: Array, approaches: NDArray[np.int8] | None, work: PosesWork, first_pose: int
) -> Iterator[tuple[PoseGroup, int, int]]:
    """Yield each group of poses from a first one on with the blocks to observe; groups are prepared one at a time."""
    models = error_model.at_columns(values[:, first_pose:], None if approaches is None else approaches[:, first_pose:])
    blocks = -(-work.samples // BLOCK)
    while together := list(islice(models, MOST_TOGETHER)):
        layouts = sampler.to_arrays_at_poses(together)
        while layouts:
            # one group needs the same formulas at all its poses, which may change from pose to pose but rarely do
            alike = next((k for k, other in enumerate(layouts) if not is_alike(layouts[0], other)), len(layouts))
            group = PoseGroup.with_plans(JoinedTables.of(layouts[:alike]), first_pose, work)
            # at least 16 tasks, so that a single group occupies all threads
            size = min(max(1, _TASK // alike), -(-blocks // 16))
            for first_block in range(0, blocks, size):
                yield group, first_block, min(size, blocks - first_block)
            first_pose += alike
            layouts = layouts[alike:]


_ROBOTS: Final = 4 * BLOCK
"""Robots of a task."""


def count_everywhere(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    specifications: Sequence[Specification],
    model: Literal["exact", "linear"],
    seed: int,
    samples: int,
    pool: Executor,
    step: Callable[[int], object],
) -> tuple[int, ...]:
    """Return how many robots keep each specification at all poses ``(n, P)``.

    Robot k has the draws that it has where each pose is sampled alone, so the counts are the same for any pool.
    """
    if not specifications:
        return ()
    check_memory(float(samples * len(specifications)), f"marking {samples:,} robots", "sample fewer of them")
    kept = np.ones((len(specifications), samples), dtype=np.bool_)
    models, first_pose = error_model.at_columns(values, approaches), 0
    while together := list(islice(models, MOST_TOGETHER)):
        layouts = sampler.to_arrays_at_poses(together)

        def mark(first: int, layouts: Sequence[SamplerArrays], first_pose: int) -> int:
            count = min(_ROBOTS, samples - first)
            for pose, layout in enumerate(layouts, start=first_pose):
                errors = sampler.errors(layout, model, seed, first, count, pose=pose)
                kept[:, first : first + count] &= _inside(errors, specifications)
            return count * len(layouts)

        tasks = [pool.submit(mark, first, layouts, first_pose) for first in range(0, samples, _ROBOTS)]
        for task in tasks:
            step(task.result())
        first_pose += len(layouts)
    return tuple(kept.sum(axis=1).tolist())


def _inside(errors: Array, specifications: Sequence[Specification]) -> NDArray[np.bool_]:
    """Return which errors ``(6, N)`` keep each specification, ``(S, N)``."""
    quantities = np.empty((8, errors.shape[1]))
    quantities[list(COMPONENTS)] = np.abs(errors)
    quantities[list(NORMS)] = np.sqrt((errors.reshape(2, 3, -1) ** 2).sum(axis=1))
    rows, limits = zip(*((spec.row, spec.limit) for spec in specifications), strict=True)
    return quantities[list(rows)] <= np.array(limits)[:, None]
