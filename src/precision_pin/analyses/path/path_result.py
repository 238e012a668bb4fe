"""Law of the largest error along a path, and bands for the error over it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.provenance import Provenance
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding
from precision_pin.render.notebook import Table, rendered
from precision_pin.render.result_io import JsonResult
from precision_pin.render.tables import data_frame, dataset, milli, symbol
from precision_pin.robot.approach import approach_entry, written_approach
from precision_pin.robot.pose_set import PoseSet
from precision_pin.statistics import (
    NO_GROUNDS,
    QUANTITIES,
    Grounds,
    Specification,
    SpecificationResult,
    clopper_pearson,
    quantile_ranks,
)

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.figure import Figure

LEVELS: Final = (0.5, 0.95, 0.99, 0.9973)
"""Probabilities of the quantiles of the largest error, besides that of the bands."""

_NORMS: Final = ("position", "attitude")


@final
@dataclass(frozen=True)
class MaximumQuantile:
    """Quantile of the largest error along the path, m or rad.

    Attributes
    ----------
    probability
        Share of the robots whose largest error is not larger.
    value, interval
        The quantile and its distribution-free interval; ``None`` where the robots are too few for one.
    """

    probability: float
    value: float | None
    interval: tuple[float, float] | None


@final
@dataclass(frozen=True)
class Band:
    """Band below a curve that is to hold the whole error curve of a share of the robots.

    Attributes
    ----------
    factor, factor_interval
        The band is the quantile at each pose times this factor, of the simultaneous band the upper end of the interval.
        ``None`` where the quantile is zero at every pose; the band is then as high at all of them.
    coverage, coverage_interval
        Share of the N robots other than those of the curve that stay below it at every pose, and its Clopper-Pearson
        interval: the lower end is at least the probability that the simultaneous band is made for.
    """

    factor: float | None
    factor_interval: tuple[float, float] | None
    coverage: float
    coverage_interval: tuple[float, float]


@final
@dataclass(frozen=True, eq=False, repr=False)
class PathResult(JsonResult):
    """Law of a robot's largest error along a path of P poses, and bands for its error over them; m and rad.

    Attributes
    ----------
    provenance
        Robot, seed and software versions.
    joints, poses
        Joints in chain order, and the points of the path.
    samples, model
        Number of built robots, N; ``"exact"`` or ``"linear"``.
    probability, confidence
        Share of the robots that the bands are made for; confidence of every interval.
    curve, curve_interval
        Quantile of |d| and |δ| at each pose, ``(2, P)``, and its interval, ``(2, 2, P)``, lower ends first.
    largest
        Largest |value| along the path of each of the eight quantities, from position.norm to attitude.z, of each robot,
        ``(8, N)``.
    share_of_maximum
        Share of the robots with their largest |d| and |δ| at a pose, ``(2, P)``.
    factor, factor_interval
        Factor from the curve to the simultaneous band, ``(2,)``, and the interval of the quantile that it is the upper end
        of, ``(2, 2)``, lower ends first; NaN where the curve is zero.
    band
        Height of the simultaneous band of |d| and |δ| at each pose, ``(2, P)``.
    kept_band, kept_pointwise
        How many of N fresh robots stay below the simultaneous band, and below the curve itself, at every pose, ``(2,)``.
    varies
        Whether each of the eight quantities differs from robot to robot at some pose, ``(8,)``.
    specifications
        Limits that are judged.
    grounds
        What keeps them from being judged, and what is taken as exact.
    findings, warnings
        Findings passed in, such as those of the sheet; one line each for them and for the warnings of the analysis.
    """

    schema: ClassVar[str] = "precision-pin/path/1"

    provenance: Provenance
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
    findings: tuple[Finding, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        fix_fields(self)

    @property
    def maximum(self) -> Array:
        """Largest |d| and |δ| along the path of each robot, ``(2, N)``."""
        norms: Array = self.largest[[QUANTITIES.index(f"{name}.norm") for name in _NORMS]]
        return norms

    @cached_property
    def _ordered(self) -> Array:
        return np.sort(self.maximum, axis=1)

    @property
    def levels(self) -> tuple[float, ...]:
        """Probabilities of the quantiles that are reported."""
        return tuple(sorted({*LEVELS, self.probability}))

    def maximum_quantile(self, norm: int, probability: float) -> MaximumQuantile:
        """Return a quantile of the largest |d| (``norm`` 0) or |δ| (1), from its order statistics."""
        ranks = quantile_ranks(self.samples, probability, self.confidence)
        if ranks is None:
            return MaximumQuantile(probability, None, None)
        ordered = self._ordered[norm]
        position = (self.samples - 1) * probability
        below = int(position)
        above = min(below + 1, self.samples - 1)
        value = ordered[below] + (position - below) * (ordered[above] - ordered[below])
        return MaximumQuantile(probability, float(value), (float(ordered[ranks[0] - 1]), float(ordered[ranks[1] - 1])))

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
            interval = clopper_pearson(kept, self.samples, self.confidence)
            varies = bool(self.varies[one.row])
            results.append(
                SpecificationResult(
                    one.quantity, one.limit, one.required, kept / self.samples, interval, varies, self.grounds
                )
            )
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

    def plot(self) -> Figure:
        """Draw |d| and |δ| along the path: the quantile at each pose and the simultaneous band."""
        # plots rest on results, not results on plots
        drawn: Figure = import_module("precision_pin.analyses.path.figure").figure(self)
        return drawn

    def to_dict(self) -> dict[str, Any]:
        """Return the result in the ``precision-pin/path/1`` schema, SI units; null where not resolved."""
        return self._head() | {
            "maximum": {name: self._maximum_dict(norm) for norm, name in enumerate(_NORMS)},
            "band": {name: self._band_dict(norm) for norm, name in enumerate(_NORMS)},
            "spec": [result.to_dict() for result in self.specification_results],
            "met": self.met,
            "poses": [self._pose_dict(pose) for pose in range(len(self.poses))],
        }

    def _head(self) -> dict[str, Any]:
        return {
            **self.provenance.to_dict(self.schema),
            "samples": self.samples,
            "model": self.model,
            "probability": self.probability,
            "confidence": self.confidence,
            "assumptions": list(self.assumptions),
            "warnings": list(self.warnings),
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def _maximum_dict(self, norm: int) -> dict[str, Any]:
        quantiles = [self.maximum_quantile(norm, level) for level in self.levels]
        return {
            "min": float(self._ordered[norm, 0]),
            "max": float(self._ordered[norm, -1]),
            "quantiles": {str(one.probability): one.value for one in quantiles},
            "quantile_interval": {
                str(one.probability): None if one.interval is None else list(one.interval) for one in quantiles
            },
            "most_often_at": self.poses.labels[self.worst_pose(norm)],
        }

    def _band_dict(self, norm: int) -> dict[str, Any]:
        band, pointwise = self.simultaneous(norm), self.pointwise(norm)
        return {
            "factor": band.factor,
            "factor_interval": None if band.factor_interval is None else list(band.factor_interval),
            "coverage": band.coverage,
            "coverage_interval": list(band.coverage_interval),
            "pointwise_coverage": pointwise.coverage,
            "pointwise_coverage_interval": list(pointwise.coverage_interval),
        }

    def _pose_dict(self, pose: int) -> dict[str, Any]:
        of = self.poses
        approach = () if of.approaches is None else tuple(of.approaches[:, pose].tolist())
        entry: dict[str, Any] = {
            "name": of.names[pose],
            "q": dict(zip(self.joints, of.q[:, pose].tolist(), strict=True)),
            **approach_entry(written_approach(self.joints, approach)),
            **({} if of.times is None else {"time": float(of.times[pose])}),
        }
        for norm, name in enumerate(_NORMS):
            entry[name] = {
                "quantile": float(self.curve[norm, pose]),
                "quantile_interval": self.curve_interval[:, norm, pose].tolist(),
                "band": float(self.band[norm, pose]),
                "share_of_maximum": float(self.share_of_maximum[norm, pose]),
            }
        return entry

    def to_pandas(self) -> pandas.DataFrame:
        """Return the curves as a data frame, m and rad: a row for each pose, with its time where it has one.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        rows = []
        for pose, label in enumerate(self.poses.labels):
            columns = {} if self.poses.times is None else {"time": float(self.poses.times[pose])}
            for norm, name in enumerate(_NORMS):
                columns |= {
                    f"{name}_quantile": float(self.curve[norm, pose]),
                    f"{name}_quantile_lower": float(self.curve_interval[0, norm, pose]),
                    f"{name}_quantile_upper": float(self.curve_interval[1, norm, pose]),
                    f"{name}_band": float(self.band[norm, pose]),
                    f"{name}_share_of_maximum": float(self.share_of_maximum[norm, pose]),
                }
            rows.append(((label,), columns))
        return data_frame(["pose"], rows, self._head())

    def to_xarray(self) -> xarray.Dataset:
        """Return the curves of :meth:`to_pandas` as a dataset over the poses.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        return dataset(self.to_pandas())

    def __repr__(self) -> str:
        one, of = self.maximum_quantile(0, self.probability), self.provenance
        return (
            f"<PathResult of {of.robot!r}, {of.base!r} to {of.tip!r}: {len(self.poses):,} poses, {self.samples:,} robots, "
            f"largest |d| within {milli(one.value, 4)} mm for {100 * self.probability:.4g} %>"
        )

    def _repr_html_(self) -> str:
        """Return the notebook view: the law of the largest errors and the bands, mm and mrad."""
        rows = []
        for norm, name in enumerate(_NORMS):
            band = self.simultaneous(norm)
            quantiles = [milli(self.maximum_quantile(norm, level).value) for level in self.levels]
            factor = "-" if band.factor is None else f"{band.factor:.4g}"
            unit = ("mm", "mrad")[norm]
            rows.append(
                [f"largest {symbol(f'{name}.norm')} [{unit}]", *quantiles, factor, f"{100 * band.coverage:.2f} %"]
            )
        levels = [f"{100 * level:.6g} %" for level in self.levels]
        of = self.provenance
        return rendered(
            f"{of.robot}: {of.base} to {of.tip}, a path of {len(self.poses):,} poses",
            [Table(["", *levels, "factor of the band", "fresh robots inside"], rows)],
            [f"{self.samples:,} robots, seed {of.seed}, {self.model} model, statics {of.statics}", *self.warnings],
        )
