"""Law of the largest error along a path, and bands for the error over it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.replicates import quantile_of
from precision_pin.analyses.result import AnalysisResult
from precision_pin.base.arrays import Array
from precision_pin.base.record import Keys, Record
from precision_pin.render.notebook import Table, rendered
from precision_pin.render.tables import data_frame, interval_columns, milli, quantity_label
from precision_pin.robot.pose_set import PoseSet
from precision_pin.statistics import (
    NO_GROUNDS,
    QUANTITIES,
    Grounds,
    Specification,
    SpecificationResult,
    clopper_pearson,
)

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

LEVELS: Final = (0.5, 0.95, 0.99, 0.9973)
"""Probabilities of the quantiles of the largest error, besides that of the bands."""

_NORMS: Final = ("position", "attitude")


@final
@dataclass(frozen=True)
class MaximumQuantile:
    """Quantile of the largest error along the path, m or rad.

    Attributes:
        probability: Share of the robots whose largest error is not larger.
        value, interval: The quantile and its distribution-free interval; ``None`` where the robots are too few for one.
    """

    probability: float
    value: float | None
    interval: tuple[float, float] | None


@final
@dataclass(frozen=True)
class Band(Record):
    """Band below a curve that is to hold the whole error curve of a share of the robots.

    Attributes:
        factor, factor_interval: The band is the quantile at each pose times this factor, of the simultaneous band the
            upper end of the interval. ``None`` where the quantile is zero at every pose; the band is then as high at
            all of them.
        coverage, coverage_interval: Share of the N robots other than those of the curve that stay below it at every
            pose, and its Clopper-Pearson interval: the lower end is at least the probability that the simultaneous band
            is made for.
    """

    factor: float | None
    factor_interval: tuple[float, float] | None
    coverage: float
    coverage_interval: tuple[float, float]


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PathResult(AnalysisResult):
    """Law of a robot's largest error along a path of P poses, and bands for its error over them; m and rad.

    Attributes:
        joints, poses: Joints in chain order, and the points of the path.
        samples, model: Number of built robots, N; ``"exact"`` or ``"linear"``.
        probability, confidence: Share of the robots that the bands are made for; confidence of every interval.
        curve, curve_interval: Quantile of |d| and |δ| at each pose, ``(2, P)``, and its interval, ``(2, 2, P)``, lower
            ends first.
        largest: Largest |value| along the path of each of the eight quantities, from position.norm to attitude.z, of
            each robot, ``(8, N)``.
        share_of_maximum: Share of the robots with their largest |d| and |δ| at a pose, ``(2, P)``.
        factor, factor_interval: Factor from the curve to the simultaneous band, ``(2,)``, and the interval of the
            quantile that it is the upper end of, ``(2, 2)``, lower ends first; NaN where the curve is zero.
        band: Height of the simultaneous band of |d| and |δ| at each pose, ``(2, P)``.
        kept_band, kept_pointwise: How many of N fresh robots stay below the simultaneous band, and below the curve
            itself, at every pose, ``(2,)``.
        varies: Whether each of the eight quantities differs from robot to robot at some pose, ``(8,)``.
        specifications: Limits that are judged.
        grounds: What keeps them from being judged, and what is taken as exact.
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
    def _ordered(self) -> Array:
        return np.sort(self.maximum, axis=1)

    @property
    def levels(self) -> tuple[float, ...]:
        """Probabilities of the quantiles that are reported."""
        return tuple(sorted({*LEVELS, self.probability}))

    def maximum_quantile(self, norm: int, probability: float) -> MaximumQuantile:
        """Return a quantile of the largest |d| (``norm`` 0) or |δ| (1), from its order statistics."""
        value, (low, high) = quantile_of(self._ordered[norm][None], probability, self.confidence, is_sorted=True)
        if np.isnan(low[0]):
            return MaximumQuantile(probability, None, None)
        return MaximumQuantile(probability, float(value[0]), (float(low[0]), float(high[0])))

    def simultaneous(self, norm: int) -> Band:
        """Return the simultaneous band of |d| (``norm`` 0) or |δ| (1), with its coverage by fresh robots."""
        factor = float(self.factor[norm])
        if np.isnan(factor):
            return self._band(None, None, int(self.kept_band[norm]))
        low, high = self.factor_interval[:, norm].tolist()
        return self._band(factor, (low, high), int(self.kept_band[norm]))

    def pointwise(self, norm: int) -> Band:
        """Return the band below the quantiles at each pose, with the share of fresh robots that stay below all of them."""
        return self._band(1.0, None, int(self.kept_pointwise[norm]))

    def _band(self, factor: float | None, interval: tuple[float, float] | None, kept: int) -> Band:
        return Band(factor, interval, kept / self.samples, clopper_pearson(kept, self.samples, self.confidence))

    def worst_pose(self, norm: int = 0) -> int:
        """Return the number of the pose at which most robots have their largest |d| (``norm`` 0) or |δ| (1)."""
        return int(self.share_of_maximum[norm].argmax())

    @cached_property
    def specification_results(self) -> tuple[SpecificationResult, ...]:
        """Each specification: the share of robots that keep it at every pose."""
        results = []
        for one in self.specifications:
            kept = int(np.count_nonzero(self.largest[one.row] <= one.limit))
            share, interval = kept / self.samples, clopper_pearson(kept, self.samples, self.confidence)
            found = (one.quantity, one.limit, one.required, share, interval, bool(self.varies[one.row]), self.grounds)
            results.append(SpecificationResult(*found))
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
        return {name: self._maximum(norm) for norm, name in enumerate(_NORMS)}

    def _maximum(self, norm: int) -> dict[str, Any]:
        quantiles = {one: self.maximum_quantile(norm, one) for one in self.levels}
        return {
            "min": self._ordered[norm, 0],
            "max": self._ordered[norm, -1],
            "quantiles": {level: one.value for level, one in quantiles.items()},
            "quantile_interval": {level: one.interval for level, one in quantiles.items()},
            "most_often_at": self.poses.labels[self.worst_pose(norm)],
        }

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
        """What is known at each pose, as in the JSON."""
        arrays = {"quantile": self.curve, "quantile_interval": self.curve_interval, "band": self.band}
        arrays["share_of_maximum"] = self.share_of_maximum
        errors = [
            {name: {key: of[..., norm, pose] for key, of in arrays.items()} for norm, name in enumerate(_NORMS)}
            for pose in range(len(self.poses))
        ]
        return [{**of, **entry} for of, entry in zip(self.poses.entries(self.joints), errors, strict=True)]

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
        """What `repr` says of it."""
        within = milli(self.maximum_quantile(0, self.probability).value, 4)
        return (
            f"{len(self.poses):,} poses, {self.samples:,} robots, largest |d| within {within} mm for "
            f"{100 * self.probability:.4g} %"
        )

    def _repr_html_(self) -> str:
        """Return the notebook view: the law of the largest errors and the bands, mm and mrad."""
        rows = []
        for norm, name in enumerate(_NORMS):
            band = self.simultaneous(norm)
            quantiles = [milli(self.maximum_quantile(norm, level).value) for level in self.levels]
            factor = "-" if band.factor is None else f"{band.factor:.4g}"
            largest = f"largest {quantity_label(f'{name}.norm')}"
            rows.append([largest, *quantiles, factor, f"{100 * band.coverage:.2f} %"])
        levels = [f"{100 * level:.6g} %" for level in self.levels]
        of = self.provenance
        return rendered(
            f"{of.arm}, a path of {len(self.poses):,} poses",
            [Table(["", *levels, "factor of the band", "fresh robots inside"], rows)],
            [f"{self.samples:,} robots, seed {of.seed}, {self.model} model, statics {of.statics}", *self.warnings],
        )
