"""Map of the pose error over many poses: first order in closed form, or sampled."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from precision_pin.analyses.arguments import check_common
from precision_pin.analyses.budget.shares import source_lines
from precision_pin.analyses.map.first_order import FirstOrder, first_order
from precision_pin.analyses.map.map_result import MapResult, Relative
from precision_pin.analyses.map.map_verdicts import FIRST_ROUND, ROUNDS, Judged, Sampled
from precision_pin.analyses.map.normal_norms import norm_probabilities, norm_quantiles, principal_axes
from precision_pin.analyses.provenance import Pose, Provenance
from precision_pin.base.arguments import check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import add, unheard, warns_at_end
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.memory import check_memory
from precision_pin.base.progress import scaled, steps_to
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.model.verdict_grounds import exact_findings, grounds_at, strained_findings
from precision_pin.robot.approach import ApproachedPose
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import Progress
from precision_pin.sampling.many_poses import MOST_SAMPLES, sample_poses
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.sampling.workers import Submitter
from precision_pin.statistics import Specification
from precision_pin.statistics.plan import Specifications, listed_specifications

VERIFIED: Final = 5
"""Poses that are verified with fresh samples, the worst ones of the closed form."""
VERIFYING_SAMPLES: Final = 20_000
_NORMS: Final = ((0, 1, 2), (3, 4, 5))
_DOUBTED: Final = 0.1
# bytes of a pose beside its moments: names, quantiles and their limits
_REST: Final = 700
# poses whose quantiles and limits are computed between two steps of progress
_AT_ONCE: Final = 2048

PosesGiven = PoseSet | ArrayLike | Mapping[str, ArrayLike] | Sequence[object]


@warns_at_end
def map_poses(
    error_model: ErrorModel,
    /,
    poses: PosesGiven,
    *,
    samples: int | None = None,
    seed: int = 0,
    relative_to: Pose = None,
    specifications: Specifications = (),
    verify: int = VERIFIED,
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
) -> MapResult:
    """Return the law of the pose error at many poses: mean, spread, quantiles, share in specification, dominant source.

    Without ``samples`` the numbers are those of the first-order model (:attr:`PoseModel.tangent`), its error taken as normal,
    in closed form, with bounds that hold whatever the laws. Specifications are judged at every pose with sampled robots of the
    exact model, in rounds of more and more of them where it takes more; the worst poses are then sampled again, with draws of
    their own, since the worst of many poses is a biased choice. With ``samples`` the same robots are sampled at every pose.

    Args:
        error_model: Chain, draws and sources.
        poses: A :class:`precision_pin.robot.pose_set.PoseSet`, such as a grid; or poses as for
            :func:`precision_pin.sample_poses`. Where no joint values are known, every number is NaN.
        samples: Number of built robots to sample at every pose; ``None`` for the closed form alone.
        seed: 64-bit seed.
        relative_to: A pose, by name or joint values, at which each robot is taught: the error relative to that at this
            pose is added.
        specifications: Limits to judge: one or a list, each from :func:`precision_pin.specification` or its text.
        verify: Number of poses, the worst ones, that are sampled to verify them; with 0 nothing is sampled, and no
            specification is judged. Not used with ``samples``.
        confidence: Confidence of every interval, and of the verdict at every pose by itself.
        findings: Warnings to include in the result, such as those of the sheet.
        threads, processes, executor, tasks_under_way: What samples, as in :func:`precision_pin.monte_carlo`; by default
            a thread for each core. It does not change the result.
        journal, resume, files, tell: With ``samples``: file in which finished poses are saved, and what is resumed from
            it, as in :func:`precision_pin.sample_poses`.
        progress: Function called with the number of poses done, then of samples added, since its last call; ``True``
            shows a bar.

    Raises:
        InputError: A wrong argument; no poses, none whose joint values are known, or more than fit into memory; errors
            too large to compute with.
        UnknownNameError: No such pose or joint.
    """
    known = check_common(error_model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    if samples is not None:
        check_whole("the number of samples", samples, 1, MOST_SAMPLES)
    check_whole("verify, a number of poses,", verify, 0, 10_000)
    if journal is not None and samples is None:
        raise InputError("a journal keeps sampled poses; give the number of samples too, or leave the journal out")
    listed = listed_specifications(specifications)
    given = pose_set(error_model, poses)
    lines = source_lines(error_model)
    vectors = list(dict.fromkeys((*_NORMS, *(one.components for one in listed))))
    # what bounds a vector has 25 numbers, what is relative as many as what is not
    moments = len(lines) + 25 * len(vectors) + 42 * (1 if relative_to is None else 2)
    # made in parts beside the joints' frames and Jacobians of all poses, then joined
    needed = 8 * (moments + max(moments, 29 * len(given.q) + 22)) + _REST
    check_memory(float(needed * len(given)), f"a map of {len(given):,} poses", "map fewer of them at a time")
    if not given.known.any():
        counts = ", ".join(f"{count:,} {status}" for status, count in Counter(given.status).items())
        raise InputError(f"none of the {len(given):,} poses has joint values: {counts}")
    reference = None if relative_to is None else error_model.at(relative_to)
    values = given.q[:, given.known]
    labels = given.labels
    known_labels = [label for label, is_known in zip(labels, given.known, strict=True) if is_known]
    approaches = None if given.approaches is None else given.approaches[:, given.known]
    found = (
        *(error_model.chain.collision_notes if given.obstructed else ()),
        *pose_findings(error_model.chain, values, known_labels),
        *exact_findings(error_model, values, approaches),
    )
    judges = samples is None and verify > 0 and bool(listed)
    steps = count_steps(len(given), samples, verify, judged=judges)
    # the worst of the poses judged is a biased choice: it is verified with other robots
    check = int(seed) ^ (1 << 63)
    with steps_to(progress, steps, "steps") as step, unheard():
        count = values.shape[1]
        # half of the steps for the moments of all poses, half for their quantiles and limits
        halves = [scaled(step, count, steps_of) for steps_of in (count // 2, count - count // 2)]
        closed = first_order(error_model, values, approaches, lines, reference, halves[0], vectors)
        arrays = _closed_form(given, closed, vectors, listed, reference, halves[1])
        found = (*found, *_doubts(closed, known_labels))
        result = MapResult(
            provenance=Provenance.of(error_model, seed),
            joints=tuple(error_model.chain.joint_names),
            poses=given,
            specifications=listed,
            judged=Judged.nothing(len(listed), len(given)),
            sources=tuple(line.name for line in lines),
            grounds=grounds_at(error_model, values, known_labels),
            confidence=confidence,
            findings=known,
            warnings=tuple(dict.fromkeys(map(str, (*known, *found)))),
            **arrays,
        )

        def sample(
            chosen: NDArray[np.intp], count: int, of: float, step: Progress, seed: int = check, **options: Any
        ) -> Sampled:
            sampled = sample_poses(
                error_model, approached(given.take(chosen)), samples=count, seed=seed, specifications=listed,
                confidence=of, threads=threads, processes=processes, executor=executor, tasks_under_way=tasks_under_way,
                progress=step, **options,
            )  # fmt: skip
            return Sampled(chosen, replace(sampled, names=tuple(labels[k] for k in chosen)))

        if judges:
            judged = Judged.in_rounds(sample, given.known, len(listed), confidence, step)
            result = replace(result, judged=judged)
        worst = np.array(result.worst_first[:verify], dtype=np.intp)
        if samples is not None:
            every = sample(
                np.flatnonzero(given.known), samples, confidence, step, seed,
                journal=journal, resume=resume, files=files, tell=tell,
            )  # fmt: skip
            result = replace(result, sampled=every, judged=result.judged.taking(every))
        elif len(worst):
            most = max(VERIFYING_SAMPLES, int(result.judged.samples[worst].max()))
            advance = scaled(step, most * len(worst), VERIFYING_SAMPLES * len(worst))
            sampled = sample(worst, most, confidence, advance, seed)
            result = replace(result, sampled=sampled, judged=result.judged.taking(sampled, again=judges))
    # statics are checked where they strain most; each check solves the deflected arm
    highest = result.worst_first[0]
    pose = approached(given.take(np.array([highest])))[0]
    strained = strained_findings(error_model, pose, labels[highest], first_order=samples is None)
    add((*found, *strained))
    return replace(result, warnings=(*result.warnings, *map(str, strained)))


def count_steps(poses: int, samples: int | None, verify: int, *, judged: bool = False) -> int:
    """Return the number of progress steps: a step a pose, then a step a sample or, of what takes more of them, a share of it.

    Args:
        poses, samples, verify: As for `map_poses`.
        judged: Whether there are specifications.
    """
    if samples is not None:
        return poses + poses * samples
    judging = len(ROUNDS) * FIRST_ROUND * poses if judged and verify > 0 else 0
    return poses + judging + min(max(verify, 0), poses) * VERIFYING_SAMPLES


def pose_set(error_model: ErrorModel, poses: PosesGiven) -> PoseSet:
    """Return poses given in any way as a pose set.

    Raises:
        InputError: Wrong joint values, or a pose set of another number of joints.
        UnknownNameError: No such pose or joint.
    """
    if isinstance(poses, PoseSet):
        if len(poses.q) != len(error_model.chain.joints):
            raise InputError(
                f"the pose set has {len(poses.q)} joints, the chain has {len(error_model.chain.joints)}; make it for this chain"
            )
        return poses
    values, names = error_model.configurations(poses)
    return replace(PoseSet.at(error_model.chain, values, names), approaches=error_model.approaches_of(poses, values))


def approached(poses: PoseSet) -> list[Array | ApproachedPose]:
    """Return the poses of a set, each with its approach if it has one, as the model takes them."""
    if poses.approaches is None:
        return list(poses.q.T)
    return [ApproachedPose(*one) for one in zip(poses.q.T, map(tuple, poses.approaches.T.tolist()), strict=True)]


def _closed_form(
    poses: PoseSet,
    closed: FirstOrder,
    vectors: Sequence[tuple[int, ...]],
    specifications: Sequence[Specification],
    reference: PoseModel | None,
    step: Progress,
) -> dict[str, Any]:
    """Return the arrays of a map, NaN where no joint values are known."""
    known = poses.known

    def spread(array: Array) -> Array:
        """Return an array over the known poses as one over all, NaN elsewhere."""
        full = np.full((*array.shape[:-1], len(poses)), np.nan)
        full[..., known] = array
        return full

    count = closed.mean.shape[1]
    levels, chosen = len(LEVELS), [vectors.index(one.components) for one in specifications]
    quantiles, bounds = np.empty((levels, 2, count)), np.empty((levels, 2, 2, count))
    probabilities, limits = np.empty((len(chosen), count)), np.empty((len(chosen), 2, count))
    relative_quantiles = np.empty((levels, 2, closed.relative_mean.shape[1]))
    for first in range(0, count, _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        mean, covariance = closed.mean[:, part], closed.covariance[:, :, part]
        laws, bounded = _laws(mean, covariance), [one.of(part) for one in closed.vectors]
        quantiles[:, :, part] = _quantiles(laws)
        for rank, norm in np.ndindex(levels, 2):
            known_quantile = quantiles[rank, norm, part]
            bounds[rank, norm, :, part] = bounded[norm].quantile_bounds(LEVELS[rank], known_quantile)
        probabilities[:, part] = _probabilities(mean, covariance, laws, specifications)
        for rank, (one, vector) in enumerate(zip(specifications, chosen, strict=True)):
            limits[rank, :, part] = bounded[vector].share_bounds(one.limit)
        if reference is not None:
            of_relative = closed.relative_mean[:, part], closed.relative_covariance[:, :, part]
            relative_quantiles[:, :, part] = _quantiles(_laws(*of_relative))
        step(mean.shape[1])
    relative = None
    if reference is not None:
        moments = spread(closed.relative_mean), spread(closed.relative_covariance)
        relative = Relative(reference.posture.q, *moments, spread(relative_quantiles))
    arrays = {"mean": closed.mean, "covariance": closed.covariance, "shares": closed.shares, "quantile": quantiles}
    arrays |= {"quantile_bounds": bounds, "probability": probabilities, "probability_bounds": limits}
    return {name: spread(values) for name, values in arrays.items()} | {"relative": relative}


def _doubts(closed: FirstOrder, labels: Sequence[str]) -> tuple[Finding, ...]:
    """Return a warning where the laws are so far from normal that the closed form is off by `_DOUBTED` or more."""
    by_laws, as_normal = closed.vectors[0].gamma_quantiles(LEVELS[-1])
    change = by_laws / np.maximum(as_normal, 1e-300) - 1
    doubted = np.abs(change) >= _DOUBTED
    if not doubted.any():
        return ()
    worst = int(np.abs(change).argmax())
    message = (
        f"the tolerances' laws are not normal: at {int(doubted.sum()):,} of {change.size:,} poses the closed form of the map is "
        f"off by {_DOUBTED:.0%} or more of what {LEVELS[-1]:.2%} of robots keep, most at {labels[worst] or f'pose {worst + 1}'}, "
        f"where |d| is some {abs(change[worst]):.0%} {'larger' if change[worst] > 0 else 'smaller'}; rely on what is sampled, "
        "or sample every pose with --samples"
    )
    return (Finding("warning", "W_NORMAL_LAW", message),)


_Laws = tuple[tuple[Array, Array], tuple[Array, Array]]


def _laws(mean: Array, covariance: Array) -> _Laws:
    """Return position and attitude in principal axes."""
    return principal_axes(mean[:3], covariance[:3, :3]), principal_axes(mean[3:], covariance[3:, 3:])


def _quantiles(laws: _Laws) -> Array:
    """Return the quantiles of |d| and |δ| at `LEVELS`, ``(3, 2, P)``."""
    return np.stack([np.stack([norm_quantiles(*law, level) for law in laws]) for level in LEVELS])


def _probabilities(mean: Array, covariance: Array, laws: _Laws, specifications: Sequence[Specification]) -> Array:
    """Return the share inside each specification, ``(S, P)``."""
    poses = mean.shape[1]
    shares = np.zeros((len(specifications), poses))
    for share, one in zip(shares, specifications, strict=True):
        if one.components in _NORMS:
            law = laws[_NORMS.index(one.components)]
            share[:] = norm_probabilities(*law, np.full(poses, one.limit))
        else:
            (row,) = one.components
            share[:] = _inside(mean[row], np.sqrt(np.maximum(covariance[row, row], 0.0)), one.limit)
    return shares


def _inside(mean: Array, std: Array, limit: float) -> Array:
    """Return the probability of a normal number between -limit and limit."""
    safe = np.where(std > 0, std, 1.0)
    inside: Array = special.ndtr((limit - mean) / safe) - special.ndtr((-limit - mean) / safe)
    return np.where(std > 0, inside, (np.abs(mean) <= limit).astype(float))
