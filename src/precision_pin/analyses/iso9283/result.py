"""Result of an ISO 9283 forecast, and its comparison with a measured robot.

If the sheet is right, the measured robot is one more of the N simulated ones, and no ranking of all N + 1 can single it
out. For each figure, let z be the distance from the median, relative to that of the 95 % quantile or, below the median,
of the 5 % quantile. With the largest z of each robot over all figures, the fraction of the N + 1 robots whose largest z
is at least that of the measured one is a test of all figures at once (Westfall and Young 1993, max-T). It is exact for
any laws and dependence of the figures; medians and quantiles are those of all N + 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.iso9283 import figures as formulas
from precision_pin.analyses.iso9283.cube import Cube
from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.result import AnalysisResult
from precision_pin.base import se3
from precision_pin.base.arguments import check_mapping, check_numbers
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import InputError, UnknownNameError, warns_at_end
from precision_pin.render.html import Table, rendered
from precision_pin.render.tables import data_frame, interval_columns, milli, number
from precision_pin.statistics import SampleLaw, SpecificationResult

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


LEVELS: Final = (0.0027, 0.05, 0.5, 0.95, 0.9973)
"""Probabilities of the quantiles in the JSON."""
OF_POSITION: Final = ("AP", "RP", "AP_x", "AP_y", "AP_z")
"""Figures of the position."""
OF_ANGLES: Final = ("AP_a", "AP_b", "AP_c", "RP_a", "RP_b", "RP_c")
"""Figures of the orientation."""
OF_POSE: Final = (*OF_POSITION, *OF_ANGLES, "RP_limit")
"""All figures of a pose; the last is not measured."""
SINGLE: Final = ("AD", "RD", "E", "vAP", "RP_bidirectional", "drift")
"""Figures of a whole test."""


@dataclass(frozen=True, eq=False)
class PoseForecast(Record):
    """Distributions of the figures at a pose, m and rad.

    Attributes:
        label: Name of the pose in the sheet, if any, and its joint values.
        commanded: Commanded pose of the tip in the base, ``(4, 4)``.
        point: Commanded position of the target (by default the tip), ``(3,)``.
        AP, AP_x, AP_y, AP_z, AP_a, AP_b, AP_c: Accuracy |x̄ - x_c|, its components, and mean angles about base axes.
        RP, RP_a, RP_b, RP_c: Repeatability: l̄ + 3 S_l, and three standard deviations of the angles.
        RP_limit: RP of infinitely many cycles, which varies over the robots only.
    """

    KEYS: ClassVar[Keys] = ("*label", "position=point", *OF_POSE)

    label: PoseLabel
    commanded: Array
    point: Array
    AP: SampleLaw
    RP: SampleLaw
    AP_x: SampleLaw
    AP_y: SampleLaw
    AP_z: SampleLaw
    AP_a: SampleLaw
    AP_b: SampleLaw
    AP_c: SampleLaw
    RP_a: SampleLaw
    RP_b: SampleLaw
    RP_c: SampleLaw
    RP_limit: SampleLaw


LEAST: Final = 0.05
"""Probability below which measurement and forecast are reported to differ."""
# m or rad; smaller differences between robots are rounding
_ROUNDING: Final = 1e-9
# difference of two outlying distances, relative above 1, that counts as rounding
_ALIKE: Final = 1e-6
_DISTANCE_POSES: Final = tuple(f"P{pose + 1}" for pose in formulas.DISTANCE)


@dataclass(frozen=True)
class ComparedFigure(Record):
    """A measured figure within its forecast law.

    Attributes:
        pose, name: Pose, empty for AD and RD, and name of the figure.
        value: The measured figure, m or rad.
        below: Fraction of simulated robots with a figure not above it.
        probability: Probability that a robot of the sheet has any compared figure as far out as this.
    """

    KEYS: ClassVar[Keys] = ("pose=pose?", "figure=name", "value", "share_below=below", "probability", "differs")

    pose: str
    name: str
    value: float
    below: float
    probability: float

    @property
    def differs(self) -> bool:
        """Whether it lies outside the forecast of the sheet."""
        return self.probability <= LEAST


@dataclass(frozen=True)
class Comparison(Record):
    """A measured robot compared with the forecast.

    Attributes:
        poses: Figures of each measured pose.
        distance: Figures of the distance of P2 and P4; ``None`` if they were not both measured.
        figures: Every figure that has a forecast.
        cycles, robots: Measured cycles, and simulated robots.
        probability: Probability that a robot of the sheet has a figure as far out as this robot's most outlying one.
    """

    KEYS: ClassVar[Keys] = ("cycles", "poses", "distance", "agrees", "probability", "least_probability", "figures")
    least_probability: ClassVar[float] = LEAST

    poses: Mapping[str, formulas.MeasuredPose]
    distance: formulas.MeasuredDistance | None
    figures: tuple[ComparedFigure, ...]
    cycles: int
    robots: int
    probability: float = 1.0

    @property
    def agrees(self) -> bool | None:
        """Whether no figure lies outside the forecast; ``None`` where the robots are too few to tell."""
        if 1 / (self.robots + 1) > LEAST:
            return None
        return self.probability > LEAST

    @property
    def differing(self) -> tuple[ComparedFigure, ...]:
        """The figures outside the forecast, least probable first."""
        return tuple(sorted((entry for entry in self.figures if entry.differs), key=lambda entry: entry.probability))

    def figure(self, pose: str, name: str) -> ComparedFigure | None:
        """Return a figure; ``None`` if it was not measured."""
        return next((entry for entry in self.figures if (entry.pose, entry.name) == (pose, name)), None)


def pose_names(names: Sequence[str]) -> dict[str, str]:
    """Return P1, P2, … by each accepted name: the name in the sheet (takes precedence), P1, …, and the number."""
    standard = [f"P{number}" for number in range(1, len(names) + 1)]
    aliases = {name[1:]: name for name in standard} | {name: name for name in standard}
    return aliases | {label: name for label, name in zip(names, standard, strict=True) if label}


def _scaled_distances(values: Array) -> Array:
    """Return each value's distance from the median, relative to the 5 or 95 % quantile's distance on its side."""
    low, median, high = np.quantile(values, (0.05, 0.5, 0.95))
    scale = np.where(values < median, median - low, high - median)
    return np.abs(values - median) / np.maximum(scale, _ROUNDING)


def _check_attained(attained: object, forecasts: Mapping[str, PoseForecast], cycles: int) -> dict[str, Array]:
    names = pose_names([at.label.name for at in forecasts.values()])
    cycles_of: dict[str, Array] = {}
    for label, values in check_mapping("the measured cycles", attained).items():
        if label not in names:
            raise UnknownNameError("pose of the forecast", label, names)
        subject = f"the measured cycles at {label}"
        numbers = check_numbers(subject, values, needs="positions (n, 3) or poses (n, 4, 4), m")
        if numbers.shape[1:] not in ((3,), (4, 4)):
            raise InputError(
                f"{subject} must be positions (n, 3) or poses (n, 4, 4), got an array of shape {numbers.shape}"
            )
        if len(numbers) != cycles:
            raise InputError(
                f"{subject} are {len(numbers)}, the forecast has {cycles} cycles; forecast as many as are measured"
            )
        cycles_of[names[label]] = numbers
    if not cycles_of:
        raise InputError("the measured cycles are of no pose; give those of one or more")
    return {pose: cycles_of[pose] for pose in forecasts if pose in cycles_of}


def _as_poses(values: Array, commanded: Array) -> Array:
    """Return poses ``(n, 4, 4)``; positions alone get the commanded orientation, or the one of each row."""
    if values.ndim == 3:
        return values
    poses = np.broadcast_to(commanded, (len(values), 4, 4)).copy()
    poses[:, :3, 3] = values
    return poses


def _fit_base(measured: Mapping[str, Array], forecasts: Mapping[str, PoseForecast]) -> dict[str, Array]:
    """Return the measurements after the best fit of the barycentres to the commanded positions."""
    if len(measured) < len(forecasts):
        raise InputError(
            f"the best fit of the base needs the cycles of all {len(forecasts)} poses, got {len(measured)}"
        )
    points = np.stack([forecasts[pose].point for pose in measured])
    positions = {pose: values if values.ndim == 2 else values[:, :3, 3] for pose, values in measured.items()}
    middles = np.stack([values.mean(axis=0) for values in positions.values()])
    rotation = formulas.fit_to(points, (middles - points)[:, :, None])[0][:, :, 0]
    centre, target = middles.mean(axis=0), points.mean(axis=0)
    fitted = {pose: np.einsum("ij,nj->ni", rotation, of - centre) + target for pose, of in positions.items()}
    for pose, values in measured.items():
        if values.ndim == 3:
            fitted[pose] = _as_poses(fitted[pose], values)
            fitted[pose][:, :3, :3] = np.einsum("ij,njk->nik", rotation, values[:, :3, :3])
    return fitted


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Iso9283Result(AnalysisResult):
    """Law of every figure of ISO 9283:1998 over built robots and tests; base axes, m and rad.

    Attributes:
        cycles, robots: Cycles of a test, and built robots, each tested once.
        confidence: Confidence of each single interval.
        target: The measured point in tool axes, m, ``(3,)``.
        mass: Mass at the target in addition to the sheet's loads, kg.
        fit_base: Whether the barycentres were aligned to the commanded positions by the best fit over the poses.
        poses: By the name in the standard, P1 …
        worst: Each robot's largest AP and RP over the poses.
        AD, RD: Distance accuracy and repeatability between P2 and P4; ``None`` with fewer than four poses.
        E: Exchangeability: largest distance of five robots' barycentres at P1; ``None`` if undetermined.
        vAP: Multi-directional accuracy at P1 along the base axes; ``None`` if no error depends on the direction.
        RP_bidirectional: RP at P1 of the cycles over these three paths together; ``None`` if vAP is.
        drift: max |AP_0 - AP_t| at P1 over eight hours from cold; ``None`` if no thermal source has a time constant.
        cube: The cube found within reach; ``None`` if the poses were given.
        measured: A measured robot compared with the forecast, from :meth:`compare`.
        specifications: The fraction of robots that keep each limit in a test.
        absent: Why a figure is ``None``, by its name.
    """

    schema: ClassVar[str] = "precision-pin/iso9283/1"

    KEYS: ClassVar[Keys] = (
        *("*head", "model", "cycles", "robots", "confidence", "fit_base", "load=mass", "target", "warnings"),
        *("findings", "poses", "worst", *SINGLE, "absent", "spec=specifications", "cube", "measured"),
    )
    model: ClassVar[str] = "exact"

    cycles: int
    robots: int
    confidence: float
    target: Array
    mass: float
    fit_base: bool
    poses: Mapping[str, PoseForecast]
    worst: Mapping[str, SampleLaw]
    AD: SampleLaw | None
    RD: SampleLaw | None
    E: SampleLaw | None
    vAP: SampleLaw | None = None
    RP_bidirectional: SampleLaw | None = None
    drift: SampleLaw | None = None
    cube: Cube | None = None
    measured: Comparison | None = None
    specifications: tuple[SpecificationResult, ...] = ()
    absent: Mapping[str, str] = field(default_factory=dict)

    @property
    def met(self) -> bool:
        """Whether every specification is met; true without any."""
        return all(result.met for result in self.specifications)

    def laws(self) -> Iterator[tuple[str, str, SampleLaw]]:
        """Yield pose, name and law of every figure; the pose is empty for figures of a whole test."""
        for pose, forecast in self.poses.items():
            for name in OF_POSE:
                yield pose, name, getattr(forecast, name)
        for name in SINGLE:
            law = getattr(self, name)
            if law is not None:
                yield "", name, law

    @warns_at_end
    def compare(self, attained: Mapping[str, ArrayLike]) -> Iso9283Result:
        """Return the result with the measured cycles of a robot compared with the forecast, as ``measured``.

        Args:
            attained: Attained positions of the target ``(n, 3)``, or poses ``(n, 4, 4)``, in base axes, m, row j for
                cycle j; by the name of the pose in the sheet, P1, P2, …, or its number as text. Only a best fit needs
                all poses.

        Raises:
            InputError: Another shape, another number of cycles than that of the forecast, or no poses.
            UnknownNameError: A pose that the forecast does not have.
        """
        forecasts, measured = self.poses, _check_attained(attained, self.poses, self.cycles)
        with_angles = all(poses.ndim == 3 for poses in measured.values())
        if self.fit_base:
            measured = _fit_base(measured, forecasts)
        commanded = {pose: se3.pose(forecasts[pose].commanded[:3, :3], forecasts[pose].point) for pose in measured}
        cycled = {pose: _as_poses(values, commanded[pose]) for pose, values in measured.items()}
        figures = {pose: formulas.iso9283_of(commanded[pose], values) for pose, values in cycled.items()}
        names = (*OF_POSITION, *OF_ANGLES) if with_angles else OF_POSITION
        comparisons = [
            (pose, name, of[name], getattr(forecasts[pose], name)) for pose, of in figures.items() for name in names
        ]
        distance = None
        if all(pose in cycled for pose in _DISTANCE_POSES):
            distance = formulas.iso9283_distance(
                *([by[pose] for pose in _DISTANCE_POSES] for by in (commanded, cycled))
            )
            laws = (("AD", self.AD), ("RD", self.RD))
            comparisons += [("", name, distance[name], law) for name, law in laws if law is not None]
        pooled = np.stack([_scaled_distances(np.append(law.values, value)) for _, _, value, law in comparisons])
        largest = np.sort(pooled.max(axis=0))
        # figures that differ only by rounding count as equal
        outlying = pooled[:, -1] * (1 - _ALIKE) - _ALIKE
        robots = comparisons[0][3].values.size
        corrected = 1 - np.searchsorted(largest, outlying, side="left") / (robots + 1)
        compared_figures = tuple(
            ComparedFigure(pose, name, value, float((law.values <= value).mean()), float(probability))
            for (pose, name, value, law), probability in zip(comparisons, corrected, strict=True)
        )
        compared = Comparison(figures, distance, compared_figures, self.cycles, robots, float(corrected.min()))
        return replace(self, measured=compared)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a data frame, m and rad: a row for each pose and figure, the pose empty for AD, RD and E.

        The columns are ``mean``, ``std``, and ``quantile_0.95``, … with ``…_lower`` and ``…_upper``.
        """
        rows = []
        for pose, name, law in self.laws():
            columns = {"mean": law.mean, "std": number(law.std)}
            for level in LEVELS:
                columns |= interval_columns(
                    f"quantile_{level}", law.resolved_quantile(level), law.quantile_interval(level)
                )
            rows.append(((pose, name), columns))
        return data_frame(["pose", "figure"], rows, self.settings())

    def _repr_html_(self) -> str:
        rows = [
            [
                pose,
                *(milli(law.resolved_quantile(p)) for law in (at.AP, at.RP) for p in (0.5, 0.95)),
                milli(at.RP_limit.mean),
            ]
            for pose, at in self.poses.items()
        ]
        columns = ["pose", "AP median [mm]", "AP 95 %", "RP median [mm]", "RP 95 %", "RP of endless cycles, mean"]
        note = f"{self.robots:,} robots, each tested once with {self.cycles} cycles, seed {self.provenance.seed}"
        return rendered(f"ISO 9283 of {self.provenance.arm}", [Table(columns, rows)], [note, *self.warnings])

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        return f"{len(self.poses)} poses, {self.robots:,} robots, {self.cycles} cycles, seed {self.provenance.seed}"
