"""Comparison of a measured robot with the forecast: where its figures lie among those of the simulated robots.

If the sheet is right, the measured robot is one more of the N simulated ones, and no ranking of all N + 1 can tell it from them.
Of a figure, let z be the distance from the median in units of that of the 95 % quantile from the median, of the 5 % quantile
below it. With the largest z of each robot over all figures, the share of the N + 1 robots whose largest z is not below that of
the measured one is a test of all figures at once (Westfall and Young 1993, max-T). It is exact whatever the figures' laws and
however they depend on one another; medians and quantiles are those of all N + 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.iso9283.cycles import MeasuredDistance, MeasuredPose, iso9283_distance, iso9283_of
from precision_pin.analyses.iso9283.figure_law import FigureLaw
from precision_pin.analyses.iso9283.pose_forecast import OF_ANGLES, OF_POSITION, PoseForecast
from precision_pin.analyses.iso9283.simulation import DISTANCE, fit_to
from precision_pin.base import se3
from precision_pin.base.arguments import check_mapping, check_numbers
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError

LEAST: Final = 0.05
"""Probability below which measurement and forecast are said to differ."""
_ROUNDING: Final = 1e-9
"""m or rad; figures of robots that all have the same differ by less."""
_ALIKE: Final = 1e-6
"""Difference of how far out two figures are, from one up as a share, that is rounding."""
_DISTANCE_POSES: Final = tuple(f"P{pose + 1}" for pose in DISTANCE)


@final
@dataclass(frozen=True)
class ComparedFigure:
    """A measured figure in its forecast law.

    Attributes
    ----------
    pose, name
        Pose, empty for AD and RD, and name of the figure.
    value
        The measured figure, m or rad.
    below
        Share of simulated robots with a figure not above it.
    probability
        Probability that a robot of the sheet has, among all figures compared, one as far out as this.
    """

    pose: str
    name: str
    value: float
    below: float
    probability: float

    @property
    def differs(self) -> bool:
        """Whether it lies outside of what the sheet forecasts."""
        return self.probability <= LEAST

    def to_dict(self) -> dict[str, Any]:
        """Return the figure as in the JSON."""
        return {
            "pose": self.pose or None, "figure": self.name, "value": self.value, "share_below": self.below,
            "probability": self.probability, "differs": self.differs,
        }  # fmt: skip


@final
@dataclass(frozen=True)
class Comparison:
    """A measured robot beside the forecast.

    Attributes
    ----------
    poses
        Figures of each measured pose.
    distance
        Figures of the distance of P2 and P4; ``None`` where they were not both measured.
    figures
        Every figure that has a forecast.
    cycles, robots
        Cycles measured, and simulated robots.
    probability
        Probability that a robot of the sheet has a figure as far out as the one of this robot that lies farthest out.
    """

    poses: Mapping[str, MeasuredPose]
    distance: MeasuredDistance | None
    figures: tuple[ComparedFigure, ...]
    cycles: int
    robots: int
    probability: float = field(default=1.0)

    @property
    def agrees(self) -> bool | None:
        """Whether no figure lies outside of what the sheet forecasts; ``None`` where the robots are too few to see it."""
        if 1 / (self.robots + 1) > LEAST:
            return None
        return self.probability > LEAST

    @property
    def differing(self) -> tuple[ComparedFigure, ...]:
        """The figures outside of what the sheet forecasts, the least probable first."""
        return tuple(sorted((one for one in self.figures if one.differs), key=lambda one: one.probability))

    def figure(self, pose: str, name: str) -> ComparedFigure | None:
        """Return a figure; ``None`` if it was not measured."""
        return next((one for one in self.figures if (one.pose, one.name) == (pose, name)), None)

    def to_dict(self) -> dict[str, Any]:
        """Return ``measured`` of the JSON."""
        return {
            "cycles": self.cycles,
            "poses": {pose: found.to_dict() for pose, found in self.poses.items()},
            "distance": None if self.distance is None else self.distance.to_dict(),
            "agrees": self.agrees,
            "probability": self.probability,
            "least_probability": LEAST,
            "figures": [figure.to_dict() for figure in self.figures],
        }


def pose_names(names: Sequence[str]) -> dict[str, str]:
    """Return P1, P2, … by what a pose may be called: its name in the sheet, which goes first, P1, P2, …, and its number.

    Parameters
    ----------
    names
        The names in the sheet, empty where a pose has none.
    """
    standard = [f"P{number}" for number in range(1, len(names) + 1)]
    known = {name[1:]: name for name in standard} | {name: name for name in standard}
    return known | {own: name for own, name in zip(names, standard, strict=True) if own}


def compare_with(
    forecasts: Mapping[str, PoseForecast],
    distances: Mapping[str, FigureLaw],
    attained: object,
    *,
    cycles: int,
    fit_base: bool,
) -> Comparison:
    """Return measured cycles beside a forecast; see :meth:`precision_pin.analyses.iso9283.result.Iso9283Result.compare`."""
    measured = _read(attained, forecasts, cycles)
    with_angles = all(poses.ndim == 3 for poses in measured.values())
    if fit_base:
        measured = _fitted(measured, forecasts)
    commanded = {pose: _at_point(forecasts[pose]) for pose in measured}
    cycled = {pose: _as_poses(values, commanded[pose]) for pose, values in measured.items()}
    found = {pose: iso9283_of(commanded[pose], values) for pose, values in cycled.items()}
    distance = None
    if all(pose in cycled for pose in _DISTANCE_POSES):
        distance = iso9283_distance(*([by[pose] for pose in _DISTANCE_POSES] for by in (commanded, cycled)))
    listed = [
        (pose, name, values[name], getattr(forecasts[pose], name))
        for pose, values in found.items()
        for name in ((*OF_POSITION, *OF_ANGLES) if with_angles else OF_POSITION)
    ]
    if distance is not None:
        listed += [("", name, distance[name], law) for name, law in distances.items()]
    return _compared(found, distance, listed, cycles)


def _compared(
    found: Mapping[str, MeasuredPose],
    distance: MeasuredDistance | None,
    listed: list[tuple[str, str, float, FigureLaw]],
    cycles: int,
) -> Comparison:
    robots = listed[0][3].values.size
    pooled = np.stack([_far_out(np.append(law.values, value)) for _, _, value, law in listed])
    largest = np.sort(pooled.max(axis=0))
    # figures that are alike but for rounding are equally far out
    own = pooled[:, -1] * (1 - _ALIKE) - _ALIKE
    corrected = 1 - np.searchsorted(largest, own, side="left") / (robots + 1)
    figures = tuple(
        ComparedFigure(pose, name, value, float((law.values <= value).mean()), float(probability))
        for (pose, name, value, law), probability in zip(listed, corrected, strict=True)
    )
    return Comparison(found, distance, figures, cycles, robots, float(corrected.min()))


def _far_out(values: Array) -> Array:
    """Return how far each value is from the median, in units of the distance of the 5 or 95 % quantile on its side."""
    low, median, high = np.quantile(values, (0.05, 0.5, 0.95))
    scale = np.where(values < median, median - low, high - median)
    result: Array = np.abs(values - median) / np.maximum(scale, _ROUNDING)
    return result


def _read(attained: object, forecasts: Mapping[str, PoseForecast], cycles: int) -> dict[str, Array]:
    """Return the measured poses ``(n, 4, 4)`` or positions ``(n, 3)`` by P1 …, in their order."""
    names = pose_names([at.label.name for at in forecasts.values()])
    found: dict[str, Array] = {}
    for given, values in check_mapping("the measured cycles", attained).items():
        if given not in names:
            raise UnknownNameError("pose of the forecast", given, names)
        what = f"the measured cycles at {given}"
        numbers = check_numbers(what, values, needs="positions (n, 3) or poses (n, 4, 4), m")
        if numbers.shape[1:] not in ((3,), (4, 4)):
            raise InputError(
                f"{what} must be positions (n, 3) or poses (n, 4, 4), got an array of shape {numbers.shape}"
            )
        if len(numbers) != cycles:
            raise InputError(
                f"{what} are {len(numbers)}, the forecast has {cycles} cycles; forecast as many as are measured"
            )
        found[names[given]] = numbers
    if not found:
        raise InputError("the measured cycles are of no pose; give those of one or more")
    return {pose: found[pose] for pose in forecasts if pose in found}


def _at_point(forecast: PoseForecast) -> Array:
    """Return the commanded pose at the target."""
    return se3.pose(forecast.commanded[:3, :3], forecast.point)


def _as_poses(values: Array, commanded: Array) -> Array:
    """Return poses ``(n, 4, 4)``; positions alone get the commanded orientation."""
    if values.ndim == 3:
        return values
    poses = np.tile(commanded, (len(values), 1, 1))
    poses[:, :3, 3] = values
    return poses


def _fitted(measured: Mapping[str, Array], forecasts: Mapping[str, PoseForecast]) -> dict[str, Array]:
    """Return what was measured after the best fit of the barycentres to the commanded positions."""
    if len(measured) < len(forecasts):
        raise InputError(
            f"the best fit of the base needs the cycles of all {len(forecasts)} poses, got {len(measured)}"
        )
    points = np.stack([forecasts[pose].point for pose in measured])
    positions = {pose: values if values.ndim == 2 else values[:, :3, 3] for pose, values in measured.items()}
    middles = np.stack([values.mean(axis=0) for values in positions.values()])
    turn = fit_to(points, (middles - points)[:, :, None])[0][:, :, 0]
    centre, wanted = middles.mean(axis=0), points.mean(axis=0)
    found = {}
    for pose, values in measured.items():
        moved = np.einsum("ij,nj->ni", turn, positions[pose] - centre) + wanted
        found[pose] = moved
        if values.ndim == 3:
            found[pose] = values.copy()
            found[pose][:, :3, 3] = moved
            found[pose][:, :3, :3] = np.einsum("ij,njk->nik", turn, values[:, :3, :3])
    return found
