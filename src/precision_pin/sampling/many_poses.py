"""Distribution of the pose error at many poses, by sampling the same built robots at all of them.

Poses are processed in groups, each group in tasks of some blocks. The sums of a block depend on error model, seed, pose
and block number only and are added in block order, so that the bits do not depend on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_flag, check_memory, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import Progress
from precision_pin.draws.draw import MOST_POSES, Scope
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.loops import NORM_COLUMNS, SUMS
from precision_pin.kernel.sampler import (
    BLOCK,
    MOST_TOGETHER,
    JoinedTables,
    Model,
    NormBlocks,
    is_alike,
    norm_edges,
    observe_norms,
)
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.tables import pose_labels
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.configurations import ApproachedPose
from precision_pin.sampling.blocks import PicklableReadOnly, Work, check_packages, packages
from precision_pin.sampling.journal import POSES, CompletedPoses, Files, digest, identity
from precision_pin.sampling.poses_result import LEVELS, PosesResult
from precision_pin.sampling.run import RunSettings, check_common
from precision_pin.sampling.verdict_grounds import exact_findings, strained_findings
from precision_pin.sampling.workers import Submitter, available_cores, in_order
from precision_pin.statistics import (
    COMPONENTS,
    NORMS,
    Plan,
    Specification,
    clopper_pearson,
    quantile_ranks,
)
from precision_pin.statistics.limits import are_inside
from precision_pin.statistics.plan import Specifications, listed_specifications

MOST_SAMPLES: Final = 2**32 - 1
"""Most samples at each pose; the sketches count with 32 bits."""

_STRAINS: Final = ("W_STATICS", "W_DEFLECTION", "W_TURNOVER")
"""Warnings about statics, which a caller may have checked at every pose."""
_NUMBERS: Final = 73
"""Numbers in the result of a pose, including its name, without the specifications."""
_TASK: Final = 256
"""Blocks times poses in a task of a fraction of a second."""
_ROBOTS: Final = 4 * BLOCK
"""Robots of a task that counts them at all poses."""


@warns_at_end
@takes_datum
def sample_poses(
    error_model: ErrorModel,
    /,
    poses: ArrayLike | Mapping[str, ArrayLike] | Sequence[object] | ApproachedPose,
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
    pose. If all draws have unit scope, the samples at every pose are those of :func:`precision_pin.monte_carlo` with
    the same seed. Other draws depend on the number of the pose, counted from 0.

    Args:
        error_model: Chain, draws and sources.
        poses: An array ``(n, P)`` of joint values (rad, m) in chain order, one column for each pose; a list of
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
        threads, processes, executor, tasks_under_way: Workers, as in :func:`precision_pin.monte_carlo`; by default a
            thread for each core. They do not change the result. Robots are counted ``everywhere`` on threads of this
            process in any case.
        journal, resume, files, tell: File in which finished poses are saved, up to 64 at a time, and resuming from it,
            as in :func:`precision_pin.monte_carlo`.
        progress: Function called with the number of samples, of all poses together, added since its last call; ``True``
            shows a bar.

    Raises:
        InputError: A wrong number of samples, seed, model, confidence or workers; a journal of another run; no poses,
            wrong joint values, more than 2²⁰-1 poses where draws have pose or visit scope, or more than fit into
            memory; errors too large to compute with.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.sample_poses(model, ["paper", [0, 0, 0, 0]], samples=2000)
        >>> print(result.quantile.shape, (1e3 * result.quantile[1, 0]).round())
        (3, 2, 2) [ 40. 134.]
    """
    run_settings = RunSettings(threads, processes, executor, tasks_under_way, journal, resume, files, progress, tell)
    findings = check_common(error_model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    check_whole("the number of samples", samples, 1, MOST_SAMPLES)
    sampler.stage_of(model)
    limits = listed_specifications(specifications)
    check_flag("everywhere", everywhere)
    work = PosesWork(model, int(seed), int(samples), limits)
    poses = poses if approach is None else ApproachedPose(poses, approach)
    values, names = _poses(error_model, poses, limits)
    approaches = error_model.approaches_of(poses, values)
    pose_work = _Poses(error_model, values, approaches, work)
    count = values.shape[1]
    new_findings = (*pose_findings(error_model.chain, values, names), *exact_findings(error_model, values, approaches))
    add(new_findings)
    steps = count * work.samples * (2 if everywhere and limits else 1)
    beginning = CompletedPoses.start(count, len(limits))
    with run_settings.begun(beginning, POSES, partial(pose_work.identity, confidence), count, steps) as run:
        if run.state.count:
            run.step(run.state.count * work.samples)

        def add_blocks(task: tuple[PoseGroup, int], result: NormBlocks) -> int:
            group, first_block = task
            # after an interrupt a group may be incomplete
            if (group.first_pose, group.count) != (run.state.count, first_block * BLOCK):
                return 0
            group.add(result)
            if group.count == work.samples:
                run.state = run.state.with_part(group.to_arrays(confidence))
            return result.count * group.poses

        run.work_off(pose_work.tasks(run.state.count), add_blocks)
        counts = pose_work.count_everywhere(threads or available_cores(), run.step) if everywhere else None
    arrays = run.state.values
    if not any(finding.code in _STRAINS for finding in findings):
        worst = int(arrays["norm_mean"][0].argmax())
        approach = () if approaches is None else tuple(approaches[:, worst].tolist())
        strained = strained_findings(error_model, ApproachedPose(values[:, worst], approach), pose_labels(names)[worst])
        add(strained)
        new_findings = (*new_findings, *strained)
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
        kept_everywhere=counts,
        warnings=tuple(dict.fromkeys(map(str, (*findings, *new_findings)))),
        findings=findings,
        **arrays,
    )


@dataclass(frozen=True, eq=False)
class _Poses:
    """The model at poses ``(n, P)`` with their approaches, and the settings common to all of them."""

    error_model: ErrorModel
    values: Array
    approaches: NDArray[np.int8] | None
    work: PosesWork

    def identity(self, confidence: float, files: Files) -> dict[str, str]:
        """Return all inputs that determine the bits of the run."""
        work = self.work
        models = list(self._models(sorted({0, self.values.shape[1] - 1})))
        plan = Plan(np.zeros(8), np.ones(8), work.specifications)
        layouts = [sampler.to_arrays(at) for at in models]
        single = Work(layouts[0], plan, work.model, work.seed, work.samples)
        return {
            **{name: text for name, text in identity(single, models[0].posture, files).items() if name != "pose"},
            "the list of poses": digest((self.values, self.approaches)),
            "the error model at the last pose": digest(layouts[-1]),
            "confidence": repr(confidence),
        }

    def _models(self, columns: slice | list[int]) -> Iterator[PoseModel]:
        approaches = None if self.approaches is None else self.approaches[:, columns]
        return self.error_model.at_columns(self.values[:, columns], approaches)

    def tasks(self, first_pose: int) -> Iterator[tuple[Any, ...]]:
        """Yield the tasks from a first pose on, with group and first block as key; groups are prepared one at a time."""
        models = self._models(slice(first_pose, None))
        blocks = -(-self.work.samples // BLOCK)
        while together := list(islice(models, MOST_TOGETHER)):
            layouts = sampler.to_arrays_at_poses(together)
            axes = [at.posture.tool_axes for at in together]
            while layouts:
                # a group needs the same formulas at all its poses; they rarely change from pose to pose
                alike = next((k for k, other in enumerate(layouts) if not is_alike(layouts[0], other)), len(layouts))
                group = PoseGroup.with_plans(JoinedTables.of(layouts[:alike]), first_pose, self.work, axes[:alike])
                # at least 16 tasks, so that a single group occupies all threads
                size = min(max(1, _TASK // alike), -(-blocks // 16))
                for first_block in range(0, blocks, size):
                    yield (group, first_block), group.work.observe, first_block, min(size, blocks - first_block)
                first_pose += alike
                layouts, axes = layouts[alike:], axes[alike:]

    def count_everywhere(self, threads: int, step: Callable[[int], object]) -> tuple[int, ...]:
        """Return how many robots keep each specification at all poses."""
        # a robot has the draws that it has where each pose is sampled alone, so the counts do not depend on the threads
        work, specifications = self.work, self.work.specifications
        if not specifications:
            return ()
        check_memory(
            float(work.samples * len(specifications)), f"marking {work.samples:,} robots", "sample fewer of them"
        )
        is_kept = np.ones((len(specifications), work.samples), dtype=np.bool_)

        def mark(first: int, layouts: Sequence[SamplerArrays], first_pose: int, tool_axes: Sequence[Array]) -> int:
            count = min(_ROBOTS, work.samples - first)
            for pose, (layout, axes) in enumerate(zip(layouts, tool_axes, strict=True), start=first_pose):
                errors = sampler.errors(layout, work.model, work.seed, first, count, pose=pose)
                for specification, row in zip(specifications, is_kept, strict=True):
                    row[first : first + count] &= are_inside(specification.conditions(axes), errors)
            return count * len(layouts)

        models, first_pose = self._models(slice(None)), 0
        while group := list(islice(models, MOST_TOGETHER)):
            layouts = sampler.to_arrays_at_poses(group)
            axes = [at.posture.tool_axes for at in group]
            marks = (partial(mark, first, layouts, first_pose, axes) for first in range(0, work.samples, _ROBOTS))
            for count in in_order(marks, threads):
                step(count)
            first_pose += len(layouts)
        return tuple(is_kept.sum(axis=1).tolist())


def _poses(
    error_model: ErrorModel,
    q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object] | ApproachedPose,
    specifications: Sequence[Specification],
) -> tuple[Array, tuple[str, ...]]:
    poses = q.pose if isinstance(q, ApproachedPose) else q
    count, specified = error_model.chain.configurations.count(poses), len(specifications)
    # joint values, and the results twice: once in groups and once concatenated
    numbers = 3 * len(error_model.chain.joints) + 2 * (_NUMBERS + 3 * specified)
    check_memory(8.0 * numbers * count, f"sampling {count:,} poses", "sample fewer of them at a time")
    values, names = error_model.configurations(q)
    if not names:
        raise InputError("no poses to sample; give at least one")
    has_pose_draws = any(draw.scope is not Scope.UNIT for draw in error_model.space.draws)
    if has_pose_draws and len(names) > MOST_POSES:
        raise InputError(f"{len(names):,} poses; with draws of pose or visit scope at most {MOST_POSES:,} are possible")
    return values, names


# groups --------------------------------------------------------------------------------------------------------------

PILOTS: Final = (256, 1024)
"""Samples, the first of the run, for planning first the centres, then the spreads."""


@dataclass(frozen=True)
class PosesWork:
    """Settings of a run common to all poses."""

    model: Model
    seed: int
    samples: int
    specifications: tuple[Specification, ...]


@dataclass(frozen=True, eq=False)
class GroupWork(PicklableReadOnly):
    """Poses sampled together. Can be pickled."""

    tables: JoinedTables
    first_pose: int
    work: PosesWork
    plans: tuple[Plan, ...]
    packages: tuple[tuple[str, str], ...] = field(default_factory=packages)

    def observe(self, first_block: int, blocks: int) -> NormBlocks:
        """Return the statistics of some blocks."""
        check_packages(self.packages)
        work = self.work
        return observe_norms(
            self.tables, self.plans, work.model, work.seed, first_block, blocks,
            samples=work.samples, first_pose=self.first_pose,
        )  # fmt: skip


class PoseGroup:
    """Poses sampled together, and their accumulated statistics."""

    def __init__(self, tables: JoinedTables, first_pose: int, work: PosesWork, plans: Sequence[Plan]) -> None:
        self.poses = len(tables.layouts)
        self.first_pose = first_pose
        self.count = 0
        self.work = GroupWork(tables, first_pose, work, tuple(plans))
        self._centre, self._scale = (np.array([getattr(plan, name) for plan in plans]) for name in ("centre", "scale"))
        self._sums = np.zeros((self.poses, SUMS))
        self._lowest, self._highest = np.full((self.poses, 2), np.inf), np.full((self.poses, 2), -np.inf)
        self._sketch = np.zeros((self.poses, 2, NORM_COLUMNS), dtype=np.uint32)
        self._inside = np.zeros((self.poses, len(work.specifications)), dtype=np.int64)

    @classmethod
    def with_plans(
        cls, tables: JoinedTables, first_pose: int, work: PosesWork, tool_axes: Sequence[Array]
    ) -> PoseGroup:
        """Return a group with centres and spreads planned from the first samples."""
        poses = len(tables.layouts)
        plans = [Plan(np.zeros(8), np.ones(8), work.specifications, tool_axes=axes) for axes in tool_axes]
        for samples in PILOTS:
            pilot = cls(tables, first_pose, replace(work, samples=min(samples, work.samples)), plans)
            pilot.add(pilot.work.observe(0, 1))
            try:
                with np.errstate(over="raise", invalid="raise"):
                    mean, spread = pilot._moments()
            except FloatingPointError:
                raise InputError(
                    f"the errors at poses {first_pose} to {first_pose + poses - 1} are too large to compute with; "
                    "the tolerances or loads are far too large"
                ) from None
            plans = [
                Plan(mean[pose], spread[pose], work.specifications, tool_axes=axes)
                for pose, axes in enumerate(tool_axes)
            ]
        return cls(tables, first_pose, work, plans)

    def add(self, blocks: NormBlocks) -> None:
        """Add blocks, in block order."""
        for block in range(blocks.sums.shape[1]):
            self._sums += blocks.sums[:, block]
        self._lowest = np.minimum(self._lowest, blocks.lowest)
        self._highest = np.maximum(self._highest, blocks.highest)
        self._sketch += blocks.sketch
        self._inside += blocks.inside
        # last, so that after an interrupt the following blocks are rejected
        self.count += blocks.count

    def to_arrays(self, confidence: float) -> dict[str, Array]:
        """Return the group's part of the result's arrays; the last axis is the pose."""
        mean, std = self._moments()
        covariance = np.full((6, 6, self.poses), np.nan)
        if self.count > 1:
            rows, columns = _UPPER
            sums = self._sums[:, COMPONENTS]
            upper = (self._sums[:, 8:29] - sums[:, rows] * sums[:, columns] / self.count) / (self.count - 1)
            covariance[rows, columns] = covariance[columns, rows] = upper.T
            diagonal = np.arange(6)
            covariance[diagonal, diagonal] = np.maximum(covariance[diagonal, diagonal], 0.0)
        cumulative = np.cumsum(self._sketch, axis=2, dtype=np.int64)
        quantiles = (self._quantile(cumulative, level, confidence) for level in LEVELS)
        counts = self._inside.T
        intervals = [[clopper_pearson(count, self.count, confidence) for count in row] for row in counts.tolist()]
        quantile, interval, resolution = map(np.stack, zip(*quantiles, strict=True))
        return {
            "mean": mean[:, COMPONENTS].T,
            "covariance": covariance,
            "norm_mean": mean[:, NORMS].T,
            "norm_std": (std if self.count > 1 else np.full_like(std, np.nan))[:, NORMS].T,
            "norm_max": self._highest.T,
            "quantile": quantile,
            "quantile_interval": interval,
            "quantile_resolution": resolution,
            "probability": counts / self.count,
            "probability_interval": np.moveaxis(np.reshape(intervals, (len(counts), self.poses, 2)), 2, 1),
        }

    def _moments(self) -> tuple[Array, Array]:
        """Return mean and standard deviation (0 for one sample) of the eight quantities, ``(P, 8)``."""
        sums, squares = self._sums[:, :8], np.empty((self.poses, 8))
        squares[:, COMPONENTS] = self._sums[:, 8 + np.flatnonzero(_UPPER[0] == _UPPER[1])]
        squares[:, NORMS] = self._sums[:, 29:]
        variance = np.maximum(squares - sums * sums / self.count, 0.0) / max(self.count - 1, 1)
        return self._centre + sums / self.count, np.sqrt(variance)

    def _quantile(self, cumulative: NDArray[np.int64], level: float, confidence: float) -> tuple[Array, Array, Array]:
        """Return quantiles ``(2, P)``, their intervals ``(2, 2, P)`` and the widths of their bins."""
        # as :meth:`precision_pin.statistics.Distribution.quantile`: linear between the order statistics at rank 1 + (N
        # - 1) p, each placed in its bin by its rank
        ranks = quantile_ranks(self.count, level, confidence)
        if ranks is None:
            unknown = np.full((2, self.poses), np.nan)
            return unknown, np.full((2, 2, self.poses), np.nan), unknown
        position = (self.count - 1) * level
        below = min(int(position), self.count - 1)
        first, lower, upper = self._order_statistic(cumulative, below + 1)
        second, _, second_upper = self._order_statistic(cumulative, min(below + 2, self.count))
        # value - centre was rounded before binning: widen by one unit in the last place on each side
        _, low, _ = self._order_statistic(cumulative, ranks[0])
        _, _, high = self._order_statistic(cumulative, ranks[1])
        low = np.maximum(np.nextafter(low, -np.inf), self._lowest)
        high = np.minimum(np.nextafter(high, np.inf), self._highest)
        quantile = first + (position - below) * (second - first)
        return quantile.T, np.stack([low.T, high.T], axis=1), (np.maximum(upper, second_upper) - lower).T

    def _order_statistic(self, cumulative: NDArray[np.int64], rank: int) -> tuple[Array, Array, Array]:
        """Return estimates of the rank-th smallest norms (from 1), ``(P, 2)``, and the edges of their bins."""
        if rank in (1, self.count):
            extreme = self._lowest if rank == 1 else self._highest
            return extreme, extreme, extreme
        column = (cumulative < rank).sum(axis=2)[..., None]
        counts = np.take_along_axis(self._sketch, column, axis=2)[..., 0].astype(np.int64)
        previous = np.take_along_axis(cumulative, column, axis=2)[..., 0] - counts
        centre, scale = self._centre[:, NORMS], self._scale[:, NORMS]
        lower = np.maximum(centre + _EDGES[column[..., 0]] * scale, self._lowest)
        upper = np.minimum(centre + _EDGES[column[..., 0] + 1] * scale, self._highest)
        return lower + (rank - previous - 0.5) / counts * (upper - lower), lower, upper


_UPPER: Final = np.triu_indices(6)
_EDGES: Final = norm_edges()
