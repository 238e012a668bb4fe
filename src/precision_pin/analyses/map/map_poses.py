"""Map of the pose error over many poses: first order in closed form, or sampled."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.first_order import (
    FirstOrder,
    Vectors,
    first_order,
    norm_probabilities,
    norm_quantiles,
    principal_axes,
)
from precision_pin.analyses.map.map_verdicts import FIRST_ROUND, ROUNDS, Judged, MapVerdict, Sampled, map_verdicts
from precision_pin.analyses.provenance import Pose, PosesGiven, Provenance, approached, pose_set
from precision_pin.analyses.result import AnalysisResult
from precision_pin.analyses.shares import source_lines
from precision_pin.base.arguments import check_memory, check_path, check_whole
from precision_pin.base.arrays import Array, Fixed, Keys
from precision_pin.base.errors import Finding, InputError, add, unheard, warns_at_end
from precision_pin.base.files import write_files
from precision_pin.base.progress import scaled, steps_to
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.html import Table, rendered
from precision_pin.render.result_io import LARGEST_FILE
from precision_pin.render.tables import data_frame, described, milli, optional, percent
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import Progress
from precision_pin.sampling.many_poses import MOST_SAMPLES, sample_poses
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.sampling.run import check_common
from precision_pin.sampling.verdict_grounds import exact_findings, grounds_at, strained_findings
from precision_pin.sampling.workers import Submitter
from precision_pin.statistics import NO_GROUNDS, Grounds, Specification, Verdict
from precision_pin.statistics.limits import LIMITED, Limited
from precision_pin.statistics.plan import Specifications, listed_specifications

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.figure import Figure


_COMPONENTS: Final = ("dx", "dy", "dz", "rx", "ry", "rz")
_NAMES: Final = ("position", "attitude")
_MOST_ROWS: Final = 20  # rows of the notebook's table, the worst poses first
# bytes of a number in the JSON, and of memory while it is written
_WRITTEN, _ENCODING = 40, 250


@dataclass(frozen=True, eq=False)
class Relative(Fixed):
    """Error of each robot minus its error at a reference pose ``q`` ``(n,)``, first order, base axes, m and rad.

    Attributes:
        mean, covariance, quantile: ``(6, P)``, ``(6, 6, P)``, and quantiles of |d| and |δ| at `LEVELS`, ``(3, 2, P)``.
    """

    q: Array
    mean: Array
    covariance: Array
    quantile: Array

    def arrays(self) -> dict[str, tuple[tuple[str, ...], Array]]:
        """Return the values at each pose by name: dimensions, and arrays with the pose as the last axis."""
        return {
            "mean": (("component",), self.mean),
            "covariance": (("component", "component_2"), self.covariance),
            **{f"rms_{name}": ((), rms) for name, rms in zip(_NAMES, _rms(self.mean, self.covariance), strict=True)},
            **{f"quantile_{name}": (("level",), self.quantile[:, norm]) for norm, name in enumerate(_NAMES)},
        }


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class MapResult(AnalysisResult):
    """Law of the pose error at P poses, base axes, m and rad; NaN where no joint values are known.

    Moments, quantiles and fractions inside are those of the first-order model with a normal error; their bounds hold
    for the exact model with any laws. Sampled results are in ``judged`` and ``sampled``.

    Attributes:
        joints, poses: Joints in chain order, and the poses.
        mean, covariance: ``(6, P)`` and ``(6, 6, P)``.
        quantile: Quantiles of |d| and |δ| at `LEVELS`, ``(3, 2, P)``.
        quantile_bounds: Bounds of these quantiles of the exact error, lower ones first, ``(3, 2, 2, P)``.
        specifications, probability: Specifications, and the fraction of robots inside each, ``(S, P)``.
        probability_bounds: Bounds of these fractions, lower ones first, ``(S, 2, P)``.
        judged: Verdict of sampled robots on each specification at each pose.
        sources, shares: Sources (together if they share draws), and their fractions of the position's variance,
            ``(lines, P)``.
        relative: Errors relative to a reference pose; ``None`` without one.
        sampled: The sampled poses: all with known joint values, or the worst ones to verify the closed form.
        confidence: Confidence of the sampled intervals.
        grounds: Why specifications cannot be judged, and what is taken as exact.
    """

    schema: ClassVar[str] = "precision-pin/map/1"

    KEYS: ClassVar[Keys] = (
        *("*head", "samples", "confidence", "relative_to", "assumptions", "warnings", "findings", "levels", "joints"),
        *("sources", "met", "spec=specification_entries", "left_out", "poses=entries", "sampled=sampled_entry"),
    )
    levels: ClassVar = LEVELS

    joints: tuple[str, ...]
    poses: PoseSet
    mean: Array
    covariance: Array
    quantile: Array
    quantile_bounds: Array
    specifications: tuple[Specification, ...]
    probability: Array
    probability_bounds: Array
    judged: Judged
    sources: tuple[str, ...]
    shares: Array
    relative: Relative | None = None
    sampled: Sampled | None = None
    grounds: Grounds = NO_GROUNDS
    confidence: float = 0.95

    @property
    def rms(self) -> Array:
        """Root mean square of |d| and |δ|, ``(2, P)``."""
        return _rms(self.mean, self.covariance)

    @cached_property
    def dominant_source(self) -> tuple[str, ...]:
        """Source with the largest contribution to the variance of the position; empty where it does not vary."""
        if not self.sources:
            return ("",) * len(self.poses)
        shares = np.nan_to_num(self.shares)
        largest = shares.argmax(axis=0)
        return tuple(self.sources[line] if shares[line, pose] > 0 else "" for pose, line in enumerate(largest.tolist()))

    @property
    def worst_first(self) -> list[int]:
        """Indices of the poses whose joint values are known, worst first.

        Poses sampled for verification come first. The order is by verdict, then by the smallest margin of the fraction
        inside, sampled or in closed form; without specifications by the 95 % quantile of |d|, sampled or as bounded.
        """
        return self._worst_first(range(len(self.specifications)))

    def _worst_first(self, ranks: Sequence[int]) -> list[int]:
        rows = list(ranks)
        verified, size = np.zeros(len(self.poses), dtype=bool), self.quantile_bounds[LEVELS.index(0.95), 0, 1].copy()
        if self.sampled is not None:
            verified[self.sampled.poses] = True
            quantile = self.sampled.result.quantile[LEVELS.index(0.95), 0]
            size[self.sampled.poses] = np.where(np.isnan(quantile), size[self.sampled.poses], quantile)
        keys = [-size]
        if rows:
            required = np.array([self.specifications[rank].required for rank in rows])[:, None]
            margin = (self.judged.probability[rows] - required).min(axis=0)
            keys += [(self.probability[rows] - required).min(axis=0), margin, self.judged.order[rows].min(axis=0)]
        known = self.poses.known
        order = np.lexsort((*keys, ~verified))
        return order[known[order]].tolist()

    @property
    def left_out(self) -> dict[str, int]:
        """Numbers of poses, or of random draws of poses, left out because of a collision, by status."""
        return self.poses.obstructed

    @property
    def unknown(self) -> int:
        """Number of poses without joint values, which are not evaluated."""
        return int((~self.poses.known).sum())

    @property
    def met(self) -> bool | None:
        """Whether every specification is met at every pose whose joint values are known; true without specifications.

        Judged by sampled robots; ``None`` if nothing was sampled. False where a pose is outside joint limits, unless
        the model is judged ``beyond_limits``. See :attr:`verdicts`.
        """
        flags = [self._met(verdict) for verdict in self.verdicts]
        return None if None in flags else all(flags)

    def _met(self, verdict: MapVerdict) -> bool | None:
        return verdict.met if self.verdict_of(verdict) == verdict.verdict else False

    def verdict_of(self, verdict: MapVerdict) -> Verdict:
        """Return a verdict, or ``"not judged"`` where a pose is outside joint limits."""
        return "not judged" if self.grounds.not_judged else verdict.verdict

    @property
    def verdicts(self) -> tuple[MapVerdict, ...]:
        """Verdict on each specification over the poses."""
        orders = [self._worst_first([rank]) for rank in range(len(self.specifications))]
        return map_verdicts(
            self.specifications, self.probability, self.probability_bounds, self.judged, orders, self.sampled
        )

    def plot(self, quantity: str = "position", level: float = 0.95) -> Figure:
        """Draw a quantile over the poses: a plane of nodes as a heat map, a box in 3-D, a path or a list as a curve.

        Args:
            quantity: ``"position"`` or ``"attitude"``, for |d| or |δ|.
            level: One of `LEVELS`.

        Raises:
            UnknownNameError: Another quantity.
            InputError: Another level.
        """
        return self._output("figure:figure")(self, quantity, level)

    @property
    def samples(self) -> int | None:
        """Number of robots sampled at the worst pose; ``None`` if nothing was sampled."""
        return None if self.sampled is None else self.sampled.result.samples

    @property
    def relative_to(self) -> dict[str, float] | None:
        """Joint values of the reference pose; ``None`` without one."""
        return None if self.relative is None else dict(zip(self.joints, self.relative.q.tolist(), strict=True))

    @property
    def specification_entries(self) -> list[dict[str, Any]]:
        """Verdicts as in the JSON."""
        return [
            {
                **verdict.entry(self.poses.labels),
                "met": self._met(verdict),
                "verdict": self.verdict_of(verdict),
                "why_not_judged": self.grounds.not_judged or None,
                "taken_as_exact": list(self.grounds.exact),
            }
            for verdict in self.verdicts
        ]

    @property
    def sampled_entry(self) -> dict[str, Any] | None:
        """Sampled results as in the JSON."""
        return self.sampled and {"numbers": self.sampled.poses, **self.sampled.result.to_dict()}

    @property
    def entries(self) -> list[dict[str, Any]]:
        """The poses as in the JSON."""
        poses, arrays, dominant = self.poses, self._arrays(), self.dominant_source
        shares = arrays.pop("shares")[1]
        other = {} if self.relative is None else self.relative.arrays()
        entries = []
        for pose, known in enumerate(poses.entries(self.joints)):
            time = {"time": known.pop("time")} if "time" in known else {}
            entry: dict[str, Any] = known | {
                "q": poses.q[:, pose],
                "position": poses.position[:, pose],
                "status": poses.status[pose],
                "branch": int(poses.branch[pose]),
                **time,
                **{name: values[..., pose] for name, (_, values) in arrays.items()},
                "judged": self.judged.to_dict(pose),
                "dominant_source": dominant[pose] or None,
                "shares": shares[:, pose],
            }
            if other:
                keys = (name for name in other if not name.startswith("rms"))
                entry["relative"] = {name: other[name][1][..., pose] for name in keys}
            entries.append(entry)
        return entries

    def _arrays(self) -> dict[str, tuple[tuple[str, ...], Array]]:
        """Return the values at each pose by name: dimensions, and arrays with the pose as the last axis."""
        rms, level, norms = self.rms, ("level",), dict(enumerate(_NAMES))
        return {
            "mean": (("component",), self.mean),
            "covariance": (("component", "component_2"), self.covariance),
            **{f"rms_{name}": ((), rms[norm]) for norm, name in norms.items()},
            **{f"quantile_{name}": (level, self.quantile[:, norm]) for norm, name in norms.items()},
            **{f"quantile_{name}_bounds": ((*level, "end"), self.quantile_bounds[:, k]) for k, name in norms.items()},
            "probability": (("specification",), self.probability),
            "probability_bounds": (("specification", "end"), self.probability_bounds),
            "shares": (("source",), self.shares),
        }

    def to_json(self) -> str:
        """Return the JSON as text.

        Raises:
            InputError: It would exceed the memory, or be too large to be read again.
        """
        check_json(
            len(self.poses), len(self.joints), len(self.sources), len(self.specifications), self.relative is not None
        )
        return super().to_json()

    def to_pandas(self) -> pandas.DataFrame:
        """Return the map as a data frame, m and rad: a row for each pose."""
        poses, rms, dominant = self.poses, self.rms, self.dominant_source
        specified = [f"inside {limit.quantity} {limit.limit:g}" for limit in self.specifications]
        rows = []
        for pose, label in enumerate(poses.labels):
            columns: dict[str, Any] = dict(zip(self.joints, poses.q[:, pose].tolist(), strict=True))
            columns |= dict(zip("xyz", poses.position[:, pose].tolist(), strict=True))
            columns |= {"status": poses.status[pose], "branch": int(poses.branch[pose])}
            columns |= {f"mean {name}": float(self.mean[row, pose]) for row, name in enumerate(_COMPONENTS)}
            for norm, name in enumerate(_NAMES):
                columns[f"rms {name}"] = float(rms[norm, pose])
                levels = [f"{name} {level:g}" for level in LEVELS]
                columns |= dict(zip(levels, self.quantile[:, norm, pose].tolist(), strict=True))
            columns |= dict(zip(specified, self.probability[:, pose].tolist(), strict=True))
            rows.append(((label,), columns | {"dominant source": dominant[pose]}))
        return data_frame(["pose"], rows, self.settings())

    def to_xarray(self) -> xarray.Dataset:
        """Return the map as a dataset with the dimension ``pose``, m and rad, NaN where unknown.

        Coordinates: ``pose_name``, ``q`` (pose, joint), ``position`` (pose, axis), ``status``, ``branch`` and, for a
        path, ``time``. Variables: ``mean`` (pose, component), ``covariance`` (pose, component, component_2),
        ``rms_position``, ``rms_attitude``, ``quantile_position`` and ``quantile_attitude`` (pose, level),
        ``probability`` (pose, specification), these three with ``…_bounds`` of the further dimension ``end``;
        ``shares`` (pose, source), ``dominant_source``; with a reference the same for the relative error as
        ``relative_…``; from samples ``sampled_quantile_position`` and ``…_attitude`` with ``_lower`` and ``_upper``,
        and from verdicts ``sampled_inside`` likewise.
        """
        poses, variables = self.poses, _over_poses(self._arrays())
        variables["dominant_source"] = ("pose", list(self.dominant_source))
        if self.relative is not None:
            variables |= {f"relative_{name}": row for name, row in _over_poses(self.relative.arrays()).items()}
        variables |= self._sampled_variables()
        coordinates: dict[str, Any] = {
            "pose": np.arange(len(poses)),
            "pose_name": ("pose", poses.labels),
            "q": (("pose", "joint"), poses.q.T),
            "position": (("pose", "axis"), poses.position.T),
            "status": ("pose", list(poses.status)),
            "branch": ("pose", poses.branch.astype(np.int32)),
            "joint": list(self.joints),
            "axis": list("xyz"),
            "component": list(_COMPONENTS),
            "component_2": list(_COMPONENTS),
            "level": list(LEVELS),
            "end": ["lower", "upper"],
            "specification": [f"{s.quantity} {s.limit:g} @ {s.required:g}" for s in self.specifications],
            "source": list(self.sources),
            **({} if poses.times is None else {"time": ("pose", poses.times)}),
        }
        return optional("xarray").Dataset(variables, coordinates, described(self.settings()))

    def _sampled_variables(self) -> dict[str, Any]:
        if self.sampled is None:
            return {}
        result, poses = self.sampled.result, self.sampled.poses
        variables: dict[str, Any] = {}

        def spread(array: Array) -> Array:
            full = np.full((len(self.poses), *array.shape[:-1]), np.nan)
            full[poses] = np.moveaxis(array, -1, 0)
            return full

        for norm, name in enumerate(_NAMES):
            low, high = result.quantile_interval[:, norm, 0], result.quantile_interval[:, norm, 1]
            for end, array in (("", result.quantile[:, norm]), ("_lower", low), ("_upper", high)):
                variables[f"sampled_quantile_{name}{end}"] = (("pose", "level"), spread(array))
        data = self.judged
        for end, array in (("", data.probability), ("_lower", data.interval[:, 0]), ("_upper", data.interval[:, 1])):
            variables[f"sampled_inside{end}"] = (("pose", "specification"), array.T)
        return variables

    def to_netcdf(self, path: str | os.PathLike[str]) -> None:
        """Write :meth:`to_xarray` as a netCDF file, atomically.

        Raises:
            InputError: xarray is not installed.
            OutputError: The file cannot be written.
        """
        write_files({check_path("the path of the map", path): bytes(self.to_xarray().to_netcdf())})

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return (
            "mean, covariance, quantiles and shares inside are those of the first-order model with a normal error; their bounds "
            "hold for the exact model with the laws of the sheet",
            "a verdict is that of sampled robots of the exact model, with its confidence at each pose by itself",
            "shares of sources are Cov(e_k, e) of their part of the position's error; of correlated numbers that are those of "
            "several sources, Shapley effects",
            "the sampled numbers are those of the exact model, the same robots at every pose",
        )

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        worst = float(np.nanmax(self.quantile[LEVELS.index(0.95), 0]))
        return (
            f"{len(self.poses):,} poses, {self.unknown:,} of them without joint values, "
            f"|d| within {1e3 * worst:.4g} mm for 95 % at the worst in closed form"
        )

    def _repr_html_(self) -> str:
        rows = []
        labels, dominant = self.poses.labels, self.dominant_source
        for pose in self.worst_first[:_MOST_ROWS]:
            numbers = [milli(float(self.quantile[rank, norm, pose])) for norm in (0, 1) for rank in range(len(LEVELS))]
            shares = [percent(float(share)) for share in self.probability[:, pose]]
            rows.append([labels[pose], *numbers, *shares, dominant[pose]])
        heads = [f"{100 * level:g} %" for level in LEVELS[1:]]
        specs = [f"spec {rank}" for rank in range(1, len(self.specifications) + 1)]
        columns = ["pose", "median |d| [mm]", *heads, "median |δ| [mrad]", *heads, *specs, "dominant source"]
        run = self.provenance
        title = f"Map of {run.arm}, {len(self.poses):,} poses, the worst first"
        notes = [f"first order, statics {run.statics}; base axes", *self.warnings]
        return rendered(title, [Table(columns, rows)], notes)


def _over_poses(arrays: Mapping[str, tuple[tuple[str, ...], Array]]) -> dict[str, Any]:
    """Return arrays as the variables of a dataset, with the pose as the first axis."""
    return {name: (("pose", *dims), np.moveaxis(values, -1, 0)) for name, (dims, values) in arrays.items()}


def check_json(poses: int, joints: int, sources: int, specifications: int, is_relative: bool) -> None:
    """Raise InputError for a map whose JSON is too large to be made or to be read again."""
    numbers = poses * (71 + joints + sources + 8 * specifications + 54 * is_relative)
    content = f"the JSON of a map of {poses:,} poses"
    instead = "write it as netCDF (--netcdf, to_netcdf), or map fewer poses"
    if _WRITTEN * numbers > LARGEST_FILE:
        size = f"{_WRITTEN * numbers / 1e9:,.1f} GB long; up to {LARGEST_FILE / 1e9:,.1f} GB are read again"
        raise InputError(f"{content} is about {size}; {instead}")
    check_memory(float(_ENCODING * numbers), content, instead)


def _rms(mean: Array, covariance: Array) -> Array:
    squares = mean**2 + np.einsum("iip->ip", covariance)
    return np.sqrt(np.maximum(squares.reshape(2, 3, -1).sum(axis=1), 0.0))


VERIFIED: Final = 5
"""Default number of poses verified with fresh samples, the worst ones in closed form."""
VERIFYING_SAMPLES: Final = 20_000  # new robots at each verified pose
_NORMS: Final = LIMITED["position.norm"], LIMITED["attitude.norm"]
_DOUBTED: Final = 0.1  # relative change of the closed form that causes a warning
# poses whose quantiles and bounds are computed between two progress steps
_AT_ONCE: Final = 2048


@warns_at_end
@takes_datum
def map_poses(
    model: ErrorModel,
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

    Without ``samples`` the numbers are those of the first-order model (:attr:`PoseModel.tangent`) with a normal error,
    in closed form, with bounds that hold for any laws. Specifications are judged at every pose with sampled robots of
    the exact model, in rounds of increasing size where needed. The worst poses are then sampled again with fresh draws,
    since the worst of many poses is a biased choice. With ``samples`` the same robots are sampled at every pose.

    Args:
        model: Chain, draws and sources.
        poses: A :class:`precision_pin.robot.pose_set.PoseSet`, such as a grid; or poses as for
            :func:`precision_pin.sample_poses`. Where no joint values are known, every number is NaN.
        samples: Number of built robots to sample at every pose; ``None`` for the closed form alone.
        seed: 64-bit seed.
        relative_to: A pose, by name or joint values; adds the errors minus those of the same robots there, as
            :func:`precision_pin.relative`.
        specifications: Limits to judge: one or a list, each from :func:`precision_pin.specification` or its text.
        verify: Number of worst poses sampled again; with 0 nothing is sampled or judged. Not used with ``samples``.
        confidence: Confidence of every interval, and of the verdict at each single pose.
        findings: Warnings to include in the result, such as those of the sheet.
        threads, processes, executor, tasks_under_way: Workers, as in :func:`precision_pin.monte_carlo`; by default a
            thread for each core. They do not change the result.
        journal, resume, files, tell: With ``samples``: file in which finished poses are saved, and how to resume from
            it, as in :func:`precision_pin.sample_poses`.
        progress: Called with the poses done, then samples added, since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong argument; no pose with joint values; too little memory; errors too large to compute with.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> poses = pp.joint_grid(model.chain, {"joint1": 0, "joint2": "-30 0 30 deg", "joint3": 1, "joint4": 0})
        >>> result = pp.map_poses(model, poses, verify=0)
        >>> print(poses.names[result.worst_first[0]], (1e3 * result.quantile[1, 0]).round(1))
        -30° [104.7  86.5  46.8]
    """
    findings = check_common(model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    if samples is not None:
        check_whole("the number of samples", samples, 1, MOST_SAMPLES)
    check_whole("verify, a number of poses,", verify, 0, 10_000)
    if journal is not None and samples is None:
        raise InputError("a journal keeps sampled poses; give the number of samples too, or leave the journal out")
    limits = listed_specifications(specifications)
    pose_list = pose_set(model, poses)
    lines = source_lines(model)
    vectors = list(dict.fromkeys((*_NORMS, *(LIMITED[name] for limit in limits for name, _ in limit.parts))))
    _check_size(pose_list, len(lines), len(vectors), is_relative=relative_to is not None)
    if not pose_list.known.any():
        raise InputError(f"none of the {len(pose_list):,} poses has joint values: {pose_list.counts}")
    reference = None if relative_to is None else model.at(relative_to)
    values = pose_list.q[:, pose_list.known]
    labels = pose_list.labels
    known_labels = [label for label, is_known in zip(labels, pose_list.known, strict=True) if is_known]
    approaches = None if pose_list.approaches is None else pose_list.approaches[:, pose_list.known]
    new_findings = (
        *(model.chain.collision_notes if pose_list.obstructed else ()),
        *pose_findings(model.chain, values, known_labels),
        *exact_findings(model, values, approaches),
    )
    judges = samples is None and verify > 0 and bool(limits)
    steps = count_steps(len(pose_list), samples, verify, judged=judges)
    # the worst of the judged poses is a biased choice, so other robots verify it
    check = int(seed) ^ (1 << 63)
    with steps_to(progress, steps, "steps") as step, unheard():
        count = values.shape[1]
        # half of the steps for the moments of all poses, half for their quantiles and bounds
        halves = [scaled(step, count, steps_of) for steps_of in (count // 2, count - count // 2)]
        closed = first_order(model, values, approaches, lines, reference, halves[0], vectors)
        arrays = _closed_form(pose_list, closed, vectors, limits, reference, halves[1])
        new_findings = (*new_findings, *_normality_warnings(closed, known_labels))
        result = MapResult(
            provenance=Provenance.of(model, seed),
            joints=tuple(model.chain.joint_names),
            poses=pose_list,
            specifications=limits,
            judged=Judged.nothing(len(limits), len(pose_list)),
            sources=tuple(line.name for line in lines),
            grounds=grounds_at(model, values, known_labels, unreached=pose_list.unreached),
            confidence=confidence,
            findings=findings,
            warnings=tuple(dict.fromkeys(map(str, (*findings, *new_findings)))),
            **arrays,
        )

        def sample(
            ranks: NDArray[np.intp], count: int, of: float, step: Progress, seed: int = check, **options: Any
        ) -> Sampled:
            sampled = sample_poses(
                model, approached(pose_list.take(ranks)), samples=count, seed=seed, specifications=limits,
                confidence=of, threads=threads, processes=processes, executor=executor, tasks_under_way=tasks_under_way,
                progress=step, **options,
            )  # fmt: skip
            return Sampled(ranks, replace(sampled, names=tuple(labels[k] for k in ranks)))

        if judges:
            judged = Judged.in_rounds(sample, pose_list.known, len(limits), confidence, step)
            result = replace(result, judged=judged)
        worst = np.array(result.worst_first[:verify], dtype=np.intp)
        if samples is not None:
            all_poses = sample(
                np.flatnonzero(pose_list.known), samples, confidence, step, seed,
                journal=journal, resume=resume, files=files, tell=tell,
            )  # fmt: skip
            result = replace(result, sampled=all_poses, judged=result.judged.taking(all_poses))
        elif len(worst):
            robots = max(VERIFYING_SAMPLES, int(result.judged.samples[worst].max()))
            advance = scaled(step, robots * len(worst), VERIFYING_SAMPLES * len(worst))
            sampled = sample(worst, robots, confidence, advance, seed)
            result = replace(result, sampled=sampled, judged=result.judged.taking(sampled, again=judges))
    # statics are checked at the most strained poses; each check solves the deflected arm
    highest = result.worst_first[0]
    pose = approached(pose_list.take(np.array([highest])))[0]
    strained = strained_findings(model, pose, labels[highest], first_order=samples is None)
    add((*new_findings, *strained))
    return replace(result, warnings=(*result.warnings, *map(str, strained)))


def _check_size(poses: PoseSet, sources: int, vectors: int, *, is_relative: bool) -> None:
    """Raise InputError if the map does not fit into memory."""
    # the bounds of a vector have 25 numbers; relative errors have as many as absolute ones
    moments = sources + 25 * vectors + 42 * (1 + is_relative)
    # computed in parts, in addition to the joints' frames and Jacobians of all poses, then joined
    # bytes of a pose without its moments: names, quantiles and their bounds
    needed = 8 * (moments + max(moments, 29 * len(poses.q) + 22)) + 700
    check_memory(float(needed * len(poses)), f"a map of {len(poses):,} poses", "map fewer of them at a time")


def count_steps(poses: int, samples: int | None, verify: int, *, judged: bool = False) -> int:
    """Return the progress steps: one for each pose and each sample, up to a limit; ``judged`` with specifications."""
    if samples is not None:
        return poses + poses * samples
    judging = len(ROUNDS) * FIRST_ROUND * poses if judged and verify > 0 else 0
    return poses + judging + min(max(verify, 0), poses) * VERIFYING_SAMPLES


def _closed_form(
    poses: PoseSet,
    closed: FirstOrder,
    vectors: Sequence[Limited],
    specifications: Sequence[Specification],
    reference: PoseModel | None,
    step: Progress,
) -> dict[str, Any]:
    is_known = poses.known

    def spread(array: Array) -> Array:
        """Return an array over the known poses as one over all, NaN elsewhere."""
        full = np.full((*array.shape[:-1], len(poses)), np.nan)
        full[..., is_known] = array
        return full

    count = closed.mean.shape[1]
    levels = len(LEVELS)
    quantiles, bounds = np.empty((levels, 2, count)), np.empty((levels, 2, 2, count))
    probabilities, limits = np.empty((len(specifications), count)), np.empty((len(specifications), 2, count))
    relative_quantiles = np.empty((levels, 2, closed.relative_mean.shape[1]))
    for first in range(0, count, _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        mean, covariance = closed.mean[:, part], closed.covariance[:, :, part]
        laws, bounded = _laws(mean, covariance), [entry.of(part) for entry in closed.vectors]
        quantiles[:, :, part] = _quantiles(laws)
        for rank, norm in np.ndindex(levels, 2):
            known_quantile = quantiles[rank, norm, part]
            bounds[rank, norm, :, part] = bounded[norm].quantile_bounds(LEVELS[rank], known_quantile)
        of_quantities = dict(zip(vectors, bounded, strict=True))
        for rank, specification in enumerate(specifications):
            probabilities[rank, part], limits[rank, :, part] = _inside(of_quantities, specification)
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


def _normality_warnings(closed: FirstOrder, labels: Sequence[str]) -> tuple[Finding, ...]:
    """Return a warning where laws far from normal change the closed form by `_DOUBTED` or more."""
    by_laws, as_normal = closed.vectors[0].gamma_quantiles(LEVELS[-1])
    change = by_laws / np.maximum(as_normal, 1e-300) - 1
    doubtful = np.abs(change) >= _DOUBTED
    if not doubtful.any():
        return ()
    worst = int(np.abs(change).argmax())
    message = (
        f"the tolerances' laws are not normal: at {int(doubtful.sum()):,} of {change.size:,} poses the closed form of the map is "
        f"off by {_DOUBTED:.0%} or more of what {LEVELS[-1]:.2%} of robots keep, most at {labels[worst] or f'pose {worst + 1}'}, "
        f"where |d| is some {abs(change[worst]):.0%} {'larger' if change[worst] > 0 else 'smaller'}; rely on what is sampled, "
        "or sample every pose with --samples"
    )
    return (Finding("warning", "W_NORMAL_LAW", message),)


_Laws = tuple[tuple[Array, Array], tuple[Array, Array]]


def _laws(mean: Array, covariance: Array) -> _Laws:
    return principal_axes(mean[:3], covariance[:3, :3]), principal_axes(mean[3:], covariance[3:, 3:])


def _quantiles(laws: _Laws) -> Array:
    return np.stack([np.stack([norm_quantiles(*law, level) for law in laws]) for level in LEVELS])


# rotation beyond which the chord of a tilt is not compared with its first-order length, rad
_FARTHEST_TURN: Final = 0.25


def _inside(laws: Mapping[Limited, Vectors], specification: Specification) -> tuple[Array, Array]:
    """Return the probability of normal errors inside, ``(P,)``, and its bounds for any laws, ``(2, P)``.

    Of several limits the probability and its lower bound are those of Bonferroni, the upper bound is that of the least
    kept limit.
    """
    missed, bounds = [], []
    for name, limit in specification.parts:
        of = LIMITED[name]
        law, length = laws[of], of.length(limit)
        if len(of.axes) == 1:
            inside = _normal_fraction(law.mean[0], np.sqrt(np.maximum(law.covariance[0, 0], 0.0)), length)
        else:
            inside = norm_probabilities(*law.axes, np.full(law.mean.shape[1], length))
        low, high = law.share_bounds(length)
        if of.is_tilt:
            # the chord is shorter than the first-order length, by no more than at the farthest turn
            half = _FARTHEST_TURN / 2
            high = law.share_bounds(length * half / math.sin(half))[1]
            high = np.minimum(high + 1 - laws[_NORMS[1]].share_bounds(_FARTHEST_TURN)[0], 1.0)
        missed.append(1 - inside)
        bounds.append((low, high))
    if len(bounds) == 1:
        return inside, np.stack(bounds[0])
    lows, highs = np.array(bounds).swapaxes(0, 1)
    at_least = np.maximum(1 - (1 - lows).sum(axis=0), 0.0)
    return np.maximum(1 - np.sum(missed, axis=0), 0.0), np.stack([at_least, highs.min(axis=0)])


def _normal_fraction(mean: Array, std: Array, limit: float) -> Array:
    safe = np.where(std > 0, std, 1.0)
    fraction: Array = special.ndtr((limit - mean) / safe) - special.ndtr((-limit - mean) / safe)
    return np.where(std > 0, fraction, (np.abs(mean) <= limit).astype(float))
