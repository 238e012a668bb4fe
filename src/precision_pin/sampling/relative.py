"""Distribution of a robot's error at a pose relative to its error at another: taught there, working here."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import progress as progress_bar
from precision_pin.base.arguments import check_flag, check_instance, check_items, check_kept, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.draws.draw import Scope
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.model.verdict_grounds import exact_findings_at, grounds_at
from precision_pin.robot.approach import ApproachedPose, written_approach
from precision_pin.sampling import Progress, available_cores, check_progress, one_pose
from precision_pin.sampling.blocks import PILOT, first_order_skewness, reach
from precision_pin.sampling.result import MonteCarloResult, RelativeTo
from precision_pin.statistics import Plan, finish, observe, quantity_values, start
from precision_pin.statistics.plan import Specifications

MOST_THREADS: Final = 1024

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
    listed = one_pose.check_run(samples, seed, model, confidence, specifications)
    known = check_items("findings", findings, Finding)
    check_flag("keep_samples", keep_samples)
    if threads is not None:
        check_whole("threads", threads, 1, MOST_THREADS)
    check_progress(progress)
    if keep_samples:
        check_kept(samples)
    pair = _Pair(
        one_pose.model_at_pose(error_model, pose), one_pose.model_at_pose(error_model, other), model, int(seed)
    )
    plan = replace(pair.plan, specifications=listed)
    state, kept = start(plan), []
    with ExitStack() as stack:
        step = (
            stack.enter_context(progress_bar.progress(samples)) if progress is True else progress or one_pose.do_nothing
        )
        workers = threads or available_cores()
        pool = ThreadPoolExecutor(workers)
        # after a failure or an interrupt the running blocks are awaited; each takes a fraction of a second
        stack.callback(pool.shutdown, wait=True, cancel_futures=True)
        under_way: deque[Future[Array]] = deque()
        firsts = iter(range(0, int(samples), BLOCK))
        # blocks are added in order, so that the sums do not depend on the threads
        while state.count < samples:
            while len(under_way) < 2 * workers and (first := next(firsts, None)) is not None:
                under_way.append(pool.submit(pair.errors, first, min(BLOCK, int(samples) - first)))
            block = under_way.popleft().result()
            state = observe(plan, state, block)
            if keep_samples:
                kept.append(block)
            step(block.shape[1])
    summary = finish(plan, state, confidence, spread=np.sqrt(np.maximum(np.diag(pair.covariance), 0.0)))
    label = error_model.pose_name(other)
    both = np.column_stack([pair.at.posture.q, pair.other.posture.q])
    names = (error_model.pose_name(pose) or "the pose", label or "the pose relative to which errors are taken")
    summary = summary.with_grounds(grounds_at(error_model, both, names))
    found = (
        *pair.at.findings(model), *error_model.statics_findings(pair.at),
        *exact_findings_at(error_model, pair.at),
        *_named((*pair.other.findings(model), *error_model.statics_findings(pair.other)), label),
        *one_pose.find_constant_error(summary, known, "between these poses: all robots have the same relative error"),
        *one_pose.find_coarse_bins(summary),
    )  # fmt: skip
    add(found)
    joints, approach = error_model.chain.joint_names, pair.other.posture.approach
    return one_pose.result_at(
        error_model, pair.at, pose, summary, pair.layouts[0], int(seed), model,
        relative_to=RelativeTo(
            label, dict(zip(joints, map(float, pair.other.posture.q), strict=True)), written_approach(joints, approach)
        ),
        nominal=pair.at.tangent[0] - pair.other.tangent[0],
        warnings=tuple(str(finding) for finding in (*known, *found)),
        errors=np.concatenate(kept, axis=1) if keep_samples else None,
        findings=known,
    )  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class _Pair:
    at: PoseModel
    other: PoseModel
    model: Literal["exact", "linear"]
    seed: int

    @cached_property
    def layouts(self) -> tuple[SamplerArrays, SamplerArrays]:
        """The arrays of both for the sampler."""
        return sampler.to_arrays(self.at), sampler.to_arrays(self.other)

    @property
    def is_same_pose(self) -> bool:
        """Whether both poses have the same joint values, so that draws of pose scope are shared."""
        return bool((self.at.posture.q == self.other.posture.q).all())

    def errors(self, first: int, count: int) -> Array:
        """Return the relative errors ``(6, count)`` of robots ``first … first + count - 1``."""
        pose, visit = (0, 1) if self.is_same_pose else (1, 0)
        here, there = self.layouts
        result: Array = sampler.errors(here, self.model, self.seed, first, count)
        result -= sampler.errors(there, self.model, self.seed, first, count, pose=pose, visit=visit)
        return result

    @property
    def covariance(self) -> Array:
        """First-order covariance of the relative error, ``(6, 6)``."""
        covariance = self.at.space.block_covariance
        mask = self._shared.astype(float)
        difference = self.at.jacobian - self.other.jacobian
        total: Array = covariance.scaled(mask).between(difference, difference)
        for at in (self.at, self.other):
            total = total + covariance.scaled(1.0 - mask).between(at.jacobian, at.jacobian)
        return total

    @property
    def _shared(self) -> NDArray[np.bool_]:
        """Mask ``(d,)`` of the numbers that a robot shares between the poses."""
        draws = self.at.space.draws
        is_shared = np.array([draw.scope in self._shared_scopes for draw in draws], dtype=np.bool_)
        return np.repeat(is_shared, [draw.law.size for draw in draws])

    @property
    def _shared_scopes(self) -> tuple[Scope, ...]:
        return (Scope.UNIT, Scope.POSE) if self.is_same_pose else (Scope.UNIT,)

    @property
    def plan(self) -> Plan:
        """Centres and bins, from the first robots of the seed."""
        skewness = self._skewness()
        try:
            pilot = quantity_values(self.errors(0, PILOT))
        except InputError:
            # the run itself reports the invalid robot, if it gets that far
            mean = self.at.error_at_means - self.other.error_at_means
            return replace(Plan.from_moments(mean, self.covariance), skewness=skewness)
        here, there = (at.tangent[1] for at in (self.at, self.other))
        slopes = np.where(self._shared, np.abs(here - there), np.abs(here) + np.abs(there))
        plan = Plan.from_pilot(pilot, reach(self.at, self.layouts[0], slopes))
        return replace(plan, skewness=skewness)

    def _skewness(self) -> Array:
        """Return the skewness of the quantities; draws that are not shared count at either pose."""
        space, shared = self.at.space, self._shared
        here, there = (at.tangent[1] for at in (self.at, self.other))
        columns = np.where(shared, here - there, here)
        own = [draw for draw in space.draws if draw.scope not in self._shared_scopes]
        return first_order_skewness((*space.draws, *own), np.hstack([columns, -there[:, ~shared]]))


def _named(findings: Sequence[Finding], label: str) -> list[Finding]:
    where = f"pose {label!r}, relative to which" if label else "the pose relative to which"
    return [replace(one, message=f"{where} errors are taken: {one.message}") for one in findings]
