"""Sampled pose error at many poses, as arrays over the poses; a specification is met only if met at every one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arguments import check_name, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding
from precision_pin.base.versions import versions
from precision_pin.draws.draw import Scope
from precision_pin.model.datum import DatumRecord
from precision_pin.model.error_model import ErrorModel
from precision_pin.render.html import Table, rendered
from precision_pin.render.result_io import JsonResult
from precision_pin.render.tables import data_frame, described, interval_columns, milli, optional, pose_labels
from precision_pin.robot.configurations import approach_entry, written_approach
from precision_pin.sampling.verdict_grounds import by_both_models, grounds_at_each, largest_of_both
from precision_pin.statistics import (
    COMPONENTS,
    NORMS,
    QUANTITIES,
    Grounds,
    Specification,
    SpecificationResult,
    Verdict,
    clopper_pearson,
)
from precision_pin.statistics.summary import NO_SPREAD, is_varying, with_norms

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WORST_FIRST: Final[tuple[Verdict, ...]] = ("not met", "not judged", "undecided", "nothing to judge", "met")


@dataclass(frozen=True)
class PosesSpecification(Record):
    """Result of a specification over several poses.

    Attributes:
        labels: Of the poses, no two alike.
        largest: Mean of the quantity's norm at each pose, which orders poses with the same fraction inside.
        everywhere: Fraction of robots that keep it at all poses; ``None`` if not requested.
    """

    KEYS: ClassVar[Keys] = (
        *("quantity=_first.quantity", "limit=_first.limit", "required=_first.required", "met", "verdict", "*grounds"),
        *("*_everywhere", "worst_pose=_worst_label", "poses=_poses"),
    )

    results: tuple[SpecificationResult, ...]
    labels: tuple[str, ...]
    largest: tuple[float, ...]
    everywhere: SpecificationResult | None = None

    @cached_property
    def worst_first(self) -> list[int]:
        """Numbers of the poses, from 0, the worst first: by verdict, fraction inside, then ``largest``."""

        def order(pose: int) -> tuple[int, float, float]:
            result = self.results[pose]
            return _WORST_FIRST.index(result.verdict), result.probability, -self.largest[pose]

        return sorted(range(len(self.results)), key=order)

    @property
    def worst(self) -> int:
        """Number of the worst pose, which decides the verdict."""
        return self.worst_first[0]

    @property
    def verdict(self) -> Verdict:
        """Verdict at the worst pose or, if worse, for the robots that keep it at all poses."""
        verdicts = [self.results[self.worst].verdict, *([self.everywhere.verdict] if self.everywhere else [])]
        return min(verdicts, key=_WORST_FIRST.index)

    @property
    def grounds(self) -> Grounds:
        """Grounds of the first pose that is not judged, else of all."""
        return next((result.grounds for result in self.results if result.grounds.not_judged), self.results[0].grounds)

    @property
    def said(self) -> str:
        """The verdict in capitals, with the reason for not judging or with what it takes as exact."""
        return self.grounds.said(self.verdict)

    @property
    def met(self) -> bool:
        """Whether it is met at every pose and, if requested, by enough robots at all of them."""
        return self.verdict == "met"

    @property
    def _first(self) -> SpecificationResult:
        return self.results[0]

    @property
    def _everywhere(self) -> dict[str, Any]:
        of_all = self.everywhere
        return {"everywhere": of_all.encoded(("probability", "interval", "met"))} if of_all else {}

    @property
    def _worst_label(self) -> str:
        return self.labels[self.worst]

    @property
    def _poses(self) -> list[dict[str, Any]]:
        return [
            {
                "name": label,
                **result.encoded(("probability", "interval", "met", "verdict")),
                "judged": not result.grounds.not_judged,
            }
            for label, result in zip(self.labels, self.results, strict=True)
        ]


LEVELS: Final = (0.5, 0.95, 0.9973)
"""Probabilities of the quantiles."""
POSE_ARRAYS: Final = {
    "mean": (6,), "covariance": (6, 6), "norm_mean": (2,), "norm_std": (2,), "norm_max": (2,),
    "quantile": (len(LEVELS), 2), "quantile_interval": (len(LEVELS), 2, 2), "quantile_resolution": (len(LEVELS), 2),
    "probability": (0,), "probability_interval": (0, 2),
}  # fmt: skip
"""Arrays of a result whose last axis is the pose, in the order of JSON and journal: their other axes, 0 for one of as many
entries as there are specifications."""

_COMPONENTS: Final = ("dx", "dy", "dz", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False, repr=False)
class PosesResult(Record, JsonResult):
    """Distribution of the pose error at P poses, base axes, m and rad.

    Every built robot is sampled at all poses: its draws of unit scope are the same at each pose.

    Attributes:
        robot, base, tip: The URDF and the ends of the chain.
        names: Names of the poses, empty for a pose without one.
        joints, q: Joints in chain order, and their values ``(n, P)``, rad or m.
        approaches: Direction in which each joint moved last, ``(n, P)``: 1, -1, or 0 if unknown; ``None`` if no pose
            has an approach.
        samples, seed, model, statics: Settings of the run: built robots, 64-bit seed, ``"exact"`` or ``"linear"``,
            ``"nominal"`` or ``"equilibrium"``.
        confidence: Confidence of every interval.
        mean: ``(6, P)`` mean of ``[d; δ]``.
        covariance: ``(6, 6, P)`` sample covariance, divisor N - 1; NaN for one sample.
        norm_mean, norm_std, norm_max: ``(2, P)`` mean, standard deviation and largest sampled value of |d| and |δ|.
        quantile, quantile_interval: ``(3, 2, P)`` and ``(3, 2, 2, P)``, lower ends first: quantiles of |d| and |δ| at
            `LEVELS`, and distribution-free intervals, widened by the resolution of the sketch. NaN if there are too few
            samples for an interval.
        quantile_resolution: ``(3, 2, P)`` width of the sketch's bin at the quantile: the largest difference from the
            samples' own quantile.
        specifications: Specifications whose samples are counted.
        probability, probability_interval: ``(S, P)`` and ``(S, 2, P)``: fraction of the samples inside, and its
            Clopper-Pearson interval.
        kept_everywhere: How many robots keep each specification at all poses; ``None`` if not requested.
        warnings: One line each: the findings, then the warnings of the analysis.
        findings: Findings passed in, such as those of the sheet.
        versions: Versions of Python and the libraries that computed the result.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.sample_poses(model, ["paper", [0, 0, 0, 0]], samples=2000)
        >>> print(result.mean.shape, result.covariance.shape)
        (6, 2) (6, 6, 2)
    """

    schema: ClassVar[str] = "precision-pin/poses/1"
    complete: ClassVar[bool] = True
    axes: ClassVar[str] = "base"
    levels: ClassVar[tuple[float, ...]] = LEVELS

    KEYS: ClassVar[Keys] = (
        *(
            "schema",
            "complete",
            "robot",
            "base",
            "tip",
            "axes",
            "datum",
            "samples",
            "seed",
            "model",
            "statics",
            "confidence",
        ),
        *("versions", "warnings", "findings", "levels", "spec=specification_results", "poses=_entries"),
    )

    robot: str
    base: str
    tip: str
    names: tuple[str, ...]
    joints: tuple[str, ...]
    q: Array
    samples: int
    seed: int
    model: str
    statics: str
    confidence: float
    mean: Array
    covariance: Array
    norm_mean: Array
    norm_std: Array
    norm_max: Array
    quantile: Array
    quantile_interval: Array
    quantile_resolution: Array
    specifications: tuple[Specification, ...]
    probability: Array
    probability_interval: Array
    error_model: ErrorModel = field(repr=False)
    approaches: NDArray[np.int8] | None = None
    kept_everywhere: tuple[int, ...] | None = None
    warnings: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    versions: Mapping[str, str] = field(default_factory=versions, init=False)

    @cached_property
    def datum(self) -> DatumRecord | None:
        """What the errors are counted against, with the linearity at the worst pose; None for base axes."""
        if not self.error_model.datums:
            return None
        return self.error_model.datum_record(next(self.error_model.at_columns(self.q[:, [self.worst_pose]])))

    @property
    def poses(self) -> int:
        """Number of poses, P."""
        return int(self.q.shape[1])

    @property
    def std(self) -> Array:
        """Standard deviations of the components, ``(6, P)``."""
        return np.sqrt(np.diagonal(self.covariance).T)

    @property
    def met(self) -> bool:
        """Whether all specifications are met, at every pose and, if requested, by enough robots at all poses."""
        return all(result.met for result in self.specification_results)

    @property
    def worst_first(self) -> list[int]:
        """Numbers of the poses, from 0, the worst first.

        By the first specification that is not met, or the first if all are; without specifications by the 95 % quantile
        of |d|, or by its mean if there are too few samples.
        """
        results = self.specification_results
        if results:
            return next((result for result in results if not result.met), results[0]).worst_first
        quantile = self.quantile[LEVELS.index(0.95), 0]
        size = self.norm_mean[0] if np.isnan(quantile).any() else quantile
        return [int(pose) for pose in np.argsort(-size, kind="stable")]

    @property
    def worst_pose(self) -> int:
        """Number of the worst pose, the first of :attr:`worst_first`."""
        return self.worst_first[0]

    @cached_property
    def specification_results(self) -> tuple[PosesSpecification, ...]:
        """Each specification over all poses, judged at each as for a single pose."""
        labels, varying = tuple(pose_labels(self.names)), self._varying()
        models = self.error_model.at_columns(self.q, self.approaches)
        sampled = self.model if self.specifications else ""
        both = by_both_models(models, sampled, self.seed, self.specifications, self.poses)
        grounds = grounds_at_each(self.error_model, self.q, labels, both)
        of_all = next((entry for entry in grounds if entry.not_judged), grounds[0])
        of_all = replace(of_all, both=largest_of_both(entry.both for entry in grounds if entry.both is not None))

        def judged(
            rank: int, share: float, interval: tuple[float, float], varies: object, on: Grounds
        ) -> SpecificationResult:
            spec = self.specifications[rank]
            return SpecificationResult(spec.quantity, spec.limit, spec.required, share, interval, bool(varies), on)

        results = []
        for rank, spec in enumerate(self.specifications):
            shares = self.probability[rank].tolist()
            intervals = map(tuple, self.probability_interval[rank].T.tolist())
            at_each = zip(shares, intervals, varying[rank], grounds, strict=True)
            everywhere = None
            if self.kept_everywhere is not None:
                count = self.kept_everywhere[rank]
                interval = clopper_pearson(count, self.samples, self.confidence)
                everywhere = judged(rank, count / self.samples, interval, varying[rank].any(), of_all)
            largest = tuple(self.norm_mean[int(spec.quantity.startswith("attitude"))].tolist())
            results.append(
                PosesSpecification(tuple(judged(rank, *entry) for entry in at_each), labels, largest, everywhere)
            )
        return tuple(results)

    def _varying(self) -> NDArray[np.bool_]:
        """Return which specified quantities vary at each pose, ``(S, P)``, in the samples or to first order."""
        tool_axes = self.error_model.chain.at_columns(self.q).pose[:3, :3]
        varying = self._moved(np.nan_to_num(self.covariance), tool_axes)
        alike = np.flatnonzero(~varying.all(axis=0))
        approaches = None if self.approaches is None else self.approaches[:, alike]
        for pose, at in zip(alike, self.error_model.at_columns(self.q[:, alike], approaches), strict=True):
            varying[:, [pose]] |= self._moved(at.covariance[:, :, None], tool_axes[:, :, [pose]])
        return varying

    def _moved(self, covariances: Array, tool_axes: Array) -> NDArray[np.bool_]:
        """Return which specified quantities vary, ``(S, P)``, by covariances ``(6, 6, P)``."""
        spread = np.sqrt(np.maximum(np.diagonal(covariances).T, 0.0))
        masks, poses = with_norms(spread > NO_SPREAD), range(covariances.shape[2])
        moved = [
            [is_varying(spec, masks[:, pose], tool_axes[:, :, pose], (covariances[:, :, pose],)) for pose in poses]
            for spec in self.specifications
        ]
        return np.array(moved, dtype=np.bool_).reshape(len(moved), len(poses))

    def plot(self, quantity: str = "position", *, axes: Axes | None = None) -> Axes | Figure:
        """Draw the median and the 95 and 99.73 % quantiles over the poses, with the specified limits.

        Args:
            quantity: ``"position"`` or ``"attitude"``, for |d| or |δ|.
            axes: Matplotlib axes to draw on; ``None`` makes a figure with title, legend and caption.

        Returns:
            The axes given, or the new figure, which a notebook shows and ``savefig`` writes.

        Raises:
            UnknownNameError: Another quantity.
        """
        # late: matplotlib takes half a second to import
        return import_module("precision_pin.sampling.figures").plot_poses(self, quantity, axes)

    def between(self, one: int, other: int) -> Array:
        """Return the covariance ``(6, 6)`` between a robot's errors at two poses, from the tangent model.

        ``Cov(e_p, e_q) = J_p Σ_unit J_qᵀ`` with the covariance of the draws of unit scope alone: other draws are
        independent at different poses. For a pose with itself it is ``J Σ Jᵀ`` of all draws.

        Args:
            one, other: Numbers of the poses, from 0.

        Raises:
            InputError: There is no such pose.
        """
        one, other = (check_whole("the number of a pose", pose, 0, self.poses - 1) for pose in (one, other))
        space = self.error_model.space
        covariance = space.block_covariance
        if one != other:
            covariance = covariance.scaled(space.has_scope(Scope.UNIT).astype(float))
        first, second = (
            self.error_model.at(self.q[:, pose], approach=self._approach(pose)).jacobian for pose in (one, other)
        )
        return covariance.between(first, second)

    def _approach(self, pose: int) -> tuple[int, ...]:
        return () if self.approaches is None else tuple(self.approaches[:, pose].tolist())

    def pose(self, name: str) -> int:
        """Return the number of the pose with a name.

        Raises:
            UnknownNameError: No pose has this name.
        """
        return self.names.index(check_name("pose", name, [label for label in self.names if label]))

    @property
    def _entries(self) -> list[dict[str, Any]]:
        return [
            {
                "pose": {
                    "name": name,
                    "q": dict(zip(self.joints, self.q[:, pose].tolist(), strict=True)),
                    **approach_entry(written_approach(self.joints, self._approach(pose))),
                },
                **{key: getattr(self, key)[..., pose] for key in POSE_ARRAYS},
            }
            for pose, name in enumerate(self.names)
        ]

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad: a row for each pose and quantity.

        Components have the columns ``mean`` and ``std``. Norms have these, ``max``, and ``quantile_0.5``, … with
        ``…_lower`` and ``…_upper``.

        Raises:
            InputError: pandas is not installed.
        """
        labels = pose_labels(self.names)
        rows = [
            ((label, quantity), self._columns(pose, quantity))
            for pose, label in enumerate(labels)
            for quantity in QUANTITIES
        ]
        return data_frame(["pose", "quantity"], rows, self._head)

    def _columns(self, pose: int, quantity: str) -> dict[str, float]:
        row = QUANTITIES.index(quantity)
        if row in COMPONENTS:
            component = COMPONENTS.index(row)
            return {"mean": float(self.mean[component, pose]), "std": float(self.std[component, pose])}
        norm = NORMS.index(row)
        columns = {key: float(getattr(self, f"norm_{key}")[norm, pose]) for key in ("mean", "std", "max")}
        for rank, level in enumerate(LEVELS):
            low, high = self.quantile_interval[rank, norm, :, pose].tolist()
            columns |= interval_columns(f"quantile_{level}", float(self.quantile[rank, norm, pose]), (low, high))
        return columns

    def to_xarray(self) -> xarray.Dataset:
        """Return the result as a dataset, m and rad, NaN where not resolved.

        All variables have the dimension ``pose``, numbered from 0, with the coordinate ``pose_name``. Further
        dimensions: ``joint`` for ``q``, and for ``approach`` where a pose has one; ``component`` (dx … rz) for ``mean``
        and ``std``, and ``component_2`` as well for ``covariance``; ``norm`` (position, attitude) for ``norm_mean``,
        ``norm_std`` and ``norm_max``; ``probability`` and ``norm`` for ``quantile`` and ``quantile_resolution``, and
        ``end`` (lower, upper) as well for ``quantile_interval``; ``specification`` for ``inside``, and ``end`` as well
        for ``inside_interval``. The attributes give the settings of the run.

        Raises:
            InputError: xarray is not installed.
        """
        dimensions = {
            "q": ("joint",),
            "mean": ("component",),
            "std": ("component",),
            "covariance": ("component", "component_2"),
            **dict.fromkeys(("norm_mean", "norm_std", "norm_max"), ("norm",)),
            "quantile": ("probability", "norm"),
            "quantile_interval": ("probability", "norm", "end"),
            "quantile_resolution": ("probability", "norm"),
        }
        variables: dict[str, Any] = {name: ((*dims, "pose"), getattr(self, name)) for name, dims in dimensions.items()}
        variables["inside"] = (("specification", "pose"), self.probability)
        variables["inside_interval"] = (("specification", "end", "pose"), self.probability_interval)
        if self.approaches is not None:
            variables["approach"] = (("joint", "pose"), self.approaches)
        coordinates: dict[str, Any] = {
            "pose": np.arange(self.poses),
            "pose_name": ("pose", list(self.names)),
            "joint": list(self.joints),
            "component": list(_COMPONENTS),
            "component_2": list(_COMPONENTS),
            "norm": ["position", "attitude"],
            "probability": list(LEVELS),
            "end": ["lower", "upper"],
            "specification": [f"{spec.quantity} {spec.limit:g} @ {spec.required:g}" for spec in self.specifications],
        }
        return optional("xarray").Dataset(variables, coordinates, described(self._head))

    @property
    def _head(self) -> dict[str, Any]:
        return self.encoded(self.KEYS[: self.KEYS.index("levels")])

    def _repr_html_(self) -> str:
        """Return the notebook view: the norms at every pose, mm and mrad."""
        rows = [
            [
                label,
                *(
                    milli(value)
                    for norm in (0, 1)
                    for value in (self.norm_mean[norm, pose], *self.quantile[1:, norm, pose])
                ),
            ]
            for pose, label in enumerate(pose_labels(self.names))
        ]
        levels = [f"{100 * level:g} %" for level in LEVELS[1:]]
        columns = ["pose", "mean |d| [mm]", *levels, "mean |δ| [mrad]", *levels]
        note = f"{self.samples:,} samples at each pose, seed {self.seed}, {self.model} model, statics {self.statics}; base axes"
        title = f"Pose error of {self.robot}: {self.base} to {self.tip}, {self.poses:,} poses"
        return rendered(title, [Table(columns, rows)], [note, *self.warnings])

    def __repr__(self) -> str:
        worst = self.quantile[1, 0]
        phrase = "" if np.isnan(worst).all() else f", |d| within {1e3 * np.nanmax(worst):.4g} mm for 95 % at the worst"
        return (
            f"<PosesResult of {self.robot!r}, {self.base!r} to {self.tip!r}: {self.poses:,} poses, "
            f"{self.samples:,} samples at each, seed {self.seed}, {self.model} model{phrase}>"
        )
