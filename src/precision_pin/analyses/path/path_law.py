"""Law of the largest error along a path, and bands for the error over it, for the same robots at every pose.

Every pose is a task whose output depends only on the model, the seed and the pose. Poses are added in order, and no
floating-point numbers are summed. The result is therefore bit-identical for any number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.provenance import PosesGiven, Provenance, approached, pose_set
from precision_pin.analyses.result import AnalysisResult
from precision_pin.base.arguments import check_memory, check_number, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.draws.draw import MOST_POSES, Scope
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import MOST_TOGETHER
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.render.html import Table, rendered
from precision_pin.render.tables import data_frame, interval_columns, milli, quantity_label
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import Progress, available_cores
from precision_pin.sampling.run import check_common
from precision_pin.sampling.verdict_grounds import (
    by_both_models,
    exact_findings,
    grounds_at,
    speed_findings,
    strained_findings,
)
from precision_pin.sampling.workers import in_order
from precision_pin.statistics import COMPONENTS, NORMS, QUANTITIES, SampleLaw, Specification, SpecificationResult
from precision_pin.statistics.intervals import clopper_pearson, quantile_ranks
from precision_pin.statistics.plan import Specifications, listed_specifications, sizes_of
from precision_pin.statistics.sample_law import quantile_of
from precision_pin.statistics.summary import NO_GROUNDS, NO_SPREAD, Grounds, is_varying, with_norms

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


LEVELS: Final = (0.5, 0.95, 0.99, 0.9973)
"""Probabilities of the quantiles of the largest error, in addition to that of the bands."""

_NORMS: Final = ("position", "attitude")


@dataclass(frozen=True)
class MaximumQuantile:
    """Quantile of the largest error along the path, m or rad, and its interval; ``None`` for too few robots."""

    probability: float
    value: float | None
    interval: tuple[float, float] | None


@dataclass(frozen=True)
class Band(Record):
    """Band below a curve, meant to hold the whole error curve of a given fraction of the robots.

    Attributes:
        factor, factor_interval: The band is the quantile at each pose times this factor; for the simultaneous band, the
            upper end of the interval. ``None`` where the quantile is zero at every pose; the band then has one height.
        coverage, coverage_interval: Fraction of N robots, other than those of the curve, that stay below the band at
            every pose, and its Clopper-Pearson interval, which starts at or above the simultaneous band's probability.
    """

    factor: float | None
    factor_interval: tuple[float, float] | None
    coverage: float
    coverage_interval: tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PathResult(AnalysisResult):
    """Law of a robot's largest error along a path of P poses, and bands for its error over them; m and rad.

    Attributes:
        joints, poses: Joints in chain order, and the points of the path.
        samples, model: Number of built robots, N; ``"exact"`` or ``"linear"``.
        probability, confidence: Fraction of the robots that the bands hold; confidence of every interval.
        curve, curve_interval: Quantile of |d| and |δ| at each pose, ``(2, P)``, and interval, ``(2, 2, P)``, lower ends
            first.
        largest: Largest |value| along the path of the eight quantities, position.norm to attitude.z, ``(8, N)``.
        specified: Largest |value| along the path of the quantity of each specification, ``(S, N)``.
        share_of_maximum: Fraction of the robots with their largest |d| and |δ| at a pose, ``(2, P)``.
        factor, factor_interval: Factor from the curve to the simultaneous band, ``(2,)``, and the interval of the
            quantile whose upper end it is, ``(2, 2)``, lower ends first; NaN where the curve is zero.
        band: Height of the simultaneous band of |d| and |δ| at each pose, ``(2, P)``.
        kept_band, kept_pointwise: Number of N fresh robots below the simultaneous band, and below the curve, at every
            pose.
        varies: Whether the quantity of each specification differs from robot to robot at some pose, ``(S,)``.
        specifications: Limits to judge.
        grounds: Why they cannot be judged, and what is taken as exact.
    """

    schema: ClassVar[str] = "precision-pin/path/1"

    KEYS: ClassVar[Keys] = (
        *("*head", "samples", "model", "probability", "confidence", "assumptions", "warnings", "findings"),
        *("maximum=maxima", "band=bands", "spec=specification_results", "met", "poses=curves"),
    )

    joints: tuple[str, ...]
    poses: PoseSet
    samples: int
    model: str
    probability: float
    confidence: float
    curve: Array
    curve_interval: Array
    largest: Array
    specified: Array
    share_of_maximum: Array
    factor: Array
    factor_interval: Array
    band: Array
    kept_band: NDArray[np.int64]
    kept_pointwise: NDArray[np.int64]
    varies: NDArray[np.bool_]
    specifications: tuple[Specification, ...] = ()
    grounds: Grounds = NO_GROUNDS

    @property
    def maximum(self) -> Array:
        """Largest |d| and |δ| along the path of each robot, ``(2, N)``."""
        return self.largest[[QUANTITIES.index(f"{name}.norm") for name in _NORMS]]

    @cached_property
    def _laws(self) -> tuple[SampleLaw, ...]:
        return tuple(SampleLaw(largest, self.confidence, self.levels) for largest in self.maximum)

    @property
    def levels(self) -> tuple[float, ...]:
        """Probabilities of the reported quantiles."""
        return tuple(sorted({*LEVELS, self.probability}))

    def maximum_quantile(self, norm: int, probability: float) -> MaximumQuantile:
        """Return a quantile of the largest |d| (``norm`` 0) or |δ| (1), from its order statistics."""
        law = self._laws[norm]
        return MaximumQuantile(probability, law.resolved_quantile(probability), law.quantile_interval(probability))

    def simultaneous(self, norm: int) -> Band:
        """Return the simultaneous band of |d| (``norm`` 0) or |δ| (1), with its coverage by fresh robots."""
        factor, (low, high), count = (
            float(self.factor[norm]),
            self.factor_interval[:, norm].tolist(),
            int(self.kept_band[norm]),
        )
        return self._band(None, None, count) if np.isnan(factor) else self._band(factor, (low, high), count)

    def pointwise(self, norm: int) -> Band:
        """Return the band of the quantiles at each pose, with the fraction of fresh robots below all of them."""
        return self._band(1.0, None, int(self.kept_pointwise[norm]))

    def _band(self, factor: float | None, interval: tuple[float, float] | None, count: int) -> Band:
        return Band(factor, interval, count / self.samples, clopper_pearson(count, self.samples, self.confidence))

    def worst_pose(self, norm: int = 0) -> int:
        """Return the index of the pose at which most robots have their largest |d| (``norm`` 0) or |δ| (1)."""
        return int(self.share_of_maximum[norm].argmax())

    @cached_property
    def specification_results(self) -> tuple[SpecificationResult, ...]:
        """The fraction of robots that keep each specification at every pose."""
        results = []
        for spec, largest, varies in zip(self.specifications, self.specified, self.varies.tolist(), strict=True):
            count = int(np.count_nonzero(largest <= spec.limit))
            share, interval = count / self.samples, clopper_pearson(count, self.samples, self.confidence)
            row = (spec.quantity, spec.limit, spec.required, share, interval, varies, self.grounds)
            results.append(SpecificationResult(*row))
        return tuple(results)

    @property
    def met(self) -> bool:
        """Whether every specification is met along the whole path; true without any."""
        return all(result.met for result in self.specification_results)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return (
            "the path is its points: nothing is looked at between them",
            "every robot passes all poses; its draws of unit scope are the same at each",
            f"the simultaneous band is the quantile at each pose times one factor, so large that at {self.confidence:.0%} "
            "confidence no fewer robots keep it than stated",
            *(("the path has no times: speeds of the joints are not looked at",) if self.poses.times is None else ()),
        )

    @property
    def maxima(self) -> dict[str, Any]:
        """Law of the largest |d| and |δ| along the path, as in the JSON."""
        entries = {}
        for norm, (name, law) in enumerate(zip(_NORMS, self._laws, strict=True)):
            entries[name] = {
                "min": law.sorted[0],
                "max": law.sorted[-1],
                "quantiles": law.quantiles,
                "quantile_interval": law.intervals,
                "most_often_at": self.poses.labels[self.worst_pose(norm)],
            }
        return entries

    @property
    def bands(self) -> dict[str, Any]:
        """Both bands of |d| and |δ|, as in the JSON."""
        return {
            name: {
                **self.simultaneous(norm).to_dict(),
                "pointwise_coverage": self.pointwise(norm).coverage,
                "pointwise_coverage_interval": self.pointwise(norm).coverage_interval,
            }
            for norm, name in enumerate(_NORMS)
        }

    @property
    def curves(self) -> list[dict[str, Any]]:
        """Values at each pose, as in the JSON."""
        arrays = {"quantile": self.curve, "quantile_interval": self.curve_interval, "band": self.band}
        arrays["share_of_maximum"] = self.share_of_maximum
        errors = [
            {name: {key: array[..., norm, pose] for key, array in arrays.items()} for norm, name in enumerate(_NORMS)}
            for pose in range(len(self.poses))
        ]
        return [{**array, **entry} for array, entry in zip(self.poses.entries(self.joints), errors, strict=True)]

    def to_pandas(self) -> pandas.DataFrame:
        """Return the curves as a data frame, m and rad: a row for each pose, with its time where it has one."""
        rows = []
        for pose, label in enumerate(self.poses.labels):
            columns = {} if self.poses.times is None else {"time": float(self.poses.times[pose])}
            for norm, name in enumerate(_NORMS):
                interval: tuple[float, float] = tuple(self.curve_interval[:, norm, pose].tolist())
                columns |= interval_columns(f"{name}_quantile", float(self.curve[norm, pose]), interval)
                columns[f"{name}_band"] = float(self.band[norm, pose])
                columns[f"{name}_share_of_maximum"] = float(self.share_of_maximum[norm, pose])
            rows.append(((label,), columns))
        return data_frame(["pose"], rows, self.settings())

    @property
    def summary(self) -> str:
        """Text of `repr`."""
        quantile = milli(self.maximum_quantile(0, self.probability).value, 4)
        return (
            f"{len(self.poses):,} poses, {self.samples:,} robots, largest |d| within {quantile} mm for "
            f"{100 * self.probability:.4g} %"
        )

    def _repr_html_(self) -> str:
        rows = []
        for norm, name in enumerate(_NORMS):
            band = self.simultaneous(norm)
            quantiles = [milli(self.maximum_quantile(norm, level).value) for level in self.levels]
            factor = "-" if band.factor is None else f"{band.factor:.4g}"
            largest = f"largest {quantity_label(f'{name}.norm')}"
            rows.append([largest, *quantiles, factor, f"{100 * band.coverage:.2f} %"])
        levels = [f"{100 * level:.6g} %" for level in self.levels]
        run = self.provenance
        return rendered(
            f"{run.arm}, a path of {len(self.poses):,} poses",
            [Table(["", *levels, "factor of the band", "fresh robots inside"], rows)],
            [f"{self.samples:,} robots, seed {run.seed}, {self.model} model, statics {run.statics}", *self.warnings],
        )


# smallest height of the curve that the band is scaled from, m or rad: errors below it are rounding
_ROUNDING: Final = 1e-14


@warns_at_end
@takes_datum
def path_law(
    error_model: ErrorModel,
    /,
    poses: PosesGiven,
    *,
    samples: int = 10_000,
    seed: int = 0,
    probability: float = 0.95,
    model: Literal["exact", "linear"] = "exact",
    specifications: Specifications = (),
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    threads: int | None = None,
    progress: Progress | bool | None = None,
) -> PathResult:
    """Sample the law of a robot's largest error along a path, and bands for its error over the path.

    Every built robot passes all poses. Its draws of unit scope are the same at each; those of pose and visit scope are
    redrawn at each pose, as in :func:`precision_pin.sample_poses`.

    Args:
        error_model: Chain, draws and sources.
        poses: The points of the path, two or more: a :class:`precision_pin.robot.pose_set.PoseSet`, such as that of a
            trajectory, or poses as for :func:`precision_pin.sample_poses`. Nothing is evaluated between these points.
        samples: Number of built robots N. As many again set the factor of the simultaneous band.
        seed: 64-bit seed.
        probability: Fraction of the robots that the bands hold.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors (eqs 12-17).
        specifications: Limits to judge, one or a list, each from :func:`precision_pin.specification` or its text. A
            robot keeps a limit only if it keeps it at all points.
        confidence: Confidence of every interval.
        findings: Warnings to include in the result, such as those of the sheet.
        threads: Number of threads, by default one for each core. It does not change the result.
        progress: Function called with the number of samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong argument; fewer than two poses, one without joint values, or more than fit into memory; too
            few samples for the probability; errors too large to compute with.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> swing = model.configuration("paper")[:, None] + np.outer([1, 0, 0, 0], np.linspace(0, 1, 9))
        >>> result = pp.path_law(model, swing, samples=1000, specifications="70 mm @ 90 %")
        >>> print(result.met, result.maximum.shape)
        True (2, 1000)
    """
    findings = check_common(error_model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    check_whole("the number of samples", samples, 1, 10**9)
    sampler.stage_of(model)
    share = check_number("probability", probability, "above 0 and below 1", lambda limit: 0 < limit < 1)
    limits = listed_specifications(specifications)
    if threads is not None:
        check_whole("threads", threads, 1, 1024)
    if quantile_ranks(int(samples), share, confidence) is None:
        minimum = math.ceil(math.log((1 - confidence) / 2) / math.log1p(-min(share, 1 - share)))
        raise InputError(
            f"{samples:,} samples do not resolve the {100 * share:.10g} % quantile; about {minimum:,} or more do"
        )
    pose_list = _check_poses(error_model, pose_set(error_model, poses))
    count, size, workers = len(pose_list), int(samples), threads or available_cores()
    # numbers kept of each robot, of each robot in every task under way, and of each pose
    check_memory(
        8
        * (
            float(samples) * (8 + len(limits) + 2 + 4 + 4 * workers * (6 + 6 + 8 + len(limits) + 4))
            + len(pose_list) * 40
        ),
        f"{samples:,} robots along {len(pose_list):,} poses",
        "sample fewer robots, or with fewer threads",
    )
    new_findings = (
        *pose_findings(error_model.chain, pose_list.q, pose_list.labels),
        *speed_findings(error_model, pose_list.q, pose_list.times),
        *exact_findings(error_model, pose_list.q, pose_list.approaches),
    )
    add(new_findings)
    observe = partial(
        _observe, samples=size, seed=int(seed), model=model, probability=share, confidence=confidence, limits=limits
    )
    norms, curve, curve_interval = list(NORMS), np.empty((2, count)), np.empty((2, 2, count))
    largest, worst_poses = np.full((8, size), -np.inf), np.zeros((2, size), dtype=np.int64)
    new_sizes, ratios, varies = np.zeros((2, size)), np.zeros((2, size)), np.zeros(len(limits), dtype=np.bool_)
    specified = np.zeros((len(limits), size))
    with steps_to(progress, 2 * count * size) as step:
        layouts = enumerate(_layouts(error_model, pose_list))
        tasks = (partial(observe, *layout, pose) for pose, layout in layouts)
        for pose, at_pose in enumerate(in_order(tasks, workers)):
            # among equal errors the first pose counts
            np.copyto(worst_poses, pose, where=at_pose.sizes[norms] > largest[norms])
            np.maximum(largest, at_pose.sizes, out=largest)
            np.maximum(specified, at_pose.specified, out=specified)
            np.maximum(new_sizes, at_pose.fresh, out=new_sizes)
            np.maximum(ratios, at_pose.ratios, out=ratios)
            curve[:, pose], curve_interval[:, :, pose] = at_pose.curve, at_pose.interval
            varies |= at_pose.varies
            step(2 * size)
    worst = int(curve[0].argmax())
    strained = strained_findings(error_model, approached(pose_list.take(np.array([worst])))[0], pose_list.labels[worst])
    add(strained)
    # a curve of zeros gives the band no shape: it then has the same height at every pose
    shaped = curve.max(axis=1) > _ROUNDING
    sizes = np.where(shaped[:, None], ratios, new_sizes)
    # the curve is from other robots: given the curve these sizes are independent, and the upper end of the interval of
    # their quantile exceeds the required fraction of all robots with the stated confidence (Wilks)
    _, interval = quantile_of(sizes, share, confidence)
    factor = interval[1][:, None]
    models = error_model.at_columns(pose_list.q, pose_list.approaches)
    both = by_both_models(models, model, int(seed), limits, count)
    return PathResult(
        provenance=Provenance.of(error_model, seed),
        joints=tuple(error_model.chain.joint_names),
        poses=pose_list,
        samples=size,
        model=model,
        probability=share,
        confidence=confidence,
        curve=curve,
        curve_interval=curve_interval,
        largest=largest,
        specified=specified,
        share_of_maximum=np.stack([np.bincount(row, minlength=count) for row in worst_poses]) / size,
        factor=np.where(shaped, interval[1], np.nan),
        factor_interval=np.where(shaped, interval, np.nan),
        band=np.where(shaped[:, None], curve * factor, factor),
        kept_band=(sizes <= factor).sum(axis=1),
        kept_pointwise=(ratios <= 1.0).sum(axis=1),
        varies=_varying(error_model, pose_list, varies, limits),
        specifications=limits,
        grounds=grounds_at(error_model, pose_list.q, pose_list.labels, pose_list.times, both if limits else ()),
        findings=findings,
        warnings=tuple(dict.fromkeys(map(str, (*findings, *new_findings, *strained)))),
    )


def _check_poses(error_model: ErrorModel, poses: PoseSet) -> PoseSet:
    if len(poses) < 2:
        raise InputError("a path has two poses or more; the error at one pose is what monte_carlo samples")
    if not poses.known.all():
        first = int(np.flatnonzero(~poses.known)[0])
        raise InputError(
            f"{poses.labels[first]}: no joint values are known ({poses.status[first]}), and a robot passes every point of a path"
        )
    if poses.times is not None and not (np.diff(poses.times) > 0).all():
        first = int(np.flatnonzero(~(np.diff(poses.times) > 0))[0])
        raise InputError(
            f"{poses.labels[first + 1]}: the time {poses.times[first + 1]:.10g} s does not come after the "
            f"{poses.times[first]:.10g} s of the pose before; the times of a path increase"
        )
    is_redrawn = any(draw.scope is not Scope.UNIT for draw in error_model.space.draws)
    if is_redrawn and len(poses) > MOST_POSES:
        raise InputError(f"{len(poses):,} poses; with draws of pose or visit scope at most {MOST_POSES:,} are possible")
    return poses


def _varying(
    error_model: ErrorModel, poses: PoseSet, moving: NDArray[np.bool_], limits: Sequence[Specification]
) -> NDArray[np.bool_]:
    """Return which specified quantities vary, ``(S,)``, also by a rare value that no robot has."""
    varies = moving.copy()
    for at in error_model.at_columns(poses.q, poses.approaches):
        if varies.all():
            break
        varies |= _moved(limits, np.diag(at.covariance) > NO_SPREAD**2, at.posture.tool_axes, at.covariance)
    return varies


def _moved(
    listed: Sequence[Specification], components: NDArray[np.bool_], tool_axes: Array, covariance: Array | None
) -> NDArray[np.bool_]:
    """Return which specified quantities vary, ``(S,)``, given which components do, ``(6,)``, and their covariance."""
    mask = with_norms(components)
    return np.array([is_varying(limit, mask, tool_axes, (covariance,)) for limit in listed], dtype=np.bool_)


def _layouts(error_model: ErrorModel, poses: PoseSet) -> Iterator[tuple[SamplerArrays, Array]]:
    """Yield the model's arrays and the tool axes at each pose; some poses are prepared at a time."""
    models = error_model.at_columns(poses.q, poses.approaches)
    while group := list(islice(models, MOST_TOGETHER)):
        axes = [at.posture.tool_axes for at in group]
        yield from zip(sampler.to_arrays_at_poses(group), axes, strict=True)


class _AtPose(NamedTuple):
    """Observations at a pose.

    Attributes:
        sizes: |value| of the eight quantities of the first N robots, ``(8, N)``.
        specified: |value| of the quantity of each specification, ``(S, N)``.
        curve, interval: Quantile of |d| and |δ| among them, ``(2,)``, and its interval, ``(2, 2)``, lower ends first.
        fresh, ratios: Norms of the other N robots, and these over the quantile, ``(2, N)``.
        varies: Whether the quantity of each specification differs from robot to robot, ``(S,)``.
    """

    sizes: Array
    specified: Array
    curve: Array
    interval: Array
    fresh: Array
    ratios: Array
    varies: NDArray[np.bool_]


def _observe(
    layout: SamplerArrays,
    tool_axes: Array,
    pose: int,
    *,
    limits: Sequence[Specification],
    samples: int,
    seed: int,
    model: Literal["exact", "linear"],
    probability: float,
    confidence: float,
) -> _AtPose:
    try:
        errors = sampler.errors(layout, model, seed, 0, 2 * samples, pose=pose)
    except InputError as error:
        raise InputError(f"pose {pose + 1}: {error.findings[0].message}") from None
    with np.errstate(over="ignore"):
        norms = np.sqrt((errors.reshape(2, 3, -1) ** 2).sum(axis=1))
    if not np.isfinite(norms).all():
        raise InputError(f"pose {pose + 1}: the errors are too large to compute with; the tolerances are far too large")
    first_errors = errors[:, :samples]
    sizes = np.empty((8, samples))
    sizes[list(COMPONENTS)], sizes[list(NORMS)] = np.abs(first_errors), norms[:, :samples]
    specified = np.array([sizes_of(limit.quantity, first_errors, tool_axes) for limit in limits]).reshape(-1, samples)
    covariance = np.cov(first_errors) if samples > 1 else None
    moves = first_errors.max(axis=1) - first_errors.min(axis=1) > NO_SPREAD
    varies = _moved(limits, moves, tool_axes, covariance)
    curve, interval = quantile_of(sizes[list(NORMS)], probability, confidence)
    new_sizes = norms[:, samples:]
    new_ratios = new_sizes / np.maximum(curve, _ROUNDING)[:, None]
    return _AtPose(sizes, specified, curve, interval, new_sizes, new_ratios, varies)
