"""Datums of a sheet: what the errors are counted against."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from precision_pin.base import se3, units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.units import ANGLE, LENGTH
from precision_pin.robot.chain import Chain
from precision_pin.robot.datums import COMPENSATED, NO_DATUM, Datum
from precision_pin.robot.pose_grids import random_poses
from precision_pin.sheet.settings import SettingError, placed

_STARTS_AS_NUMBER: Final = re.compile(r"\s*[-+.]?\.?\d")
_POSE: Final = "Name of a pose."


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")


class TouchEntry(_Entry):
    """Standard deviations of a touch."""

    std: str = Field("0 mm", description="Standard deviation of each coordinate.")
    attitude: str = Field("0 mrad", description="Standard deviation of each angle.")


class PlaceEntry(_Entry):
    """A pose, as an origin in a URDF."""

    xyz: str = Field("0 0 0 mm", description="Its position.")
    rpy: str = Field("0 0 0 deg", description="Its roll, pitch and yaw.")


class PairEntry(_Entry):
    """Standard deviations of a camera's readings."""

    translation: str = Field("0 mm", description="Of each coordinate.")
    rotation: str = Field("0 mrad", description="Of each angle.")


Touch = str | TouchEntry
VisitEntry = str | list[str] | dict[str, str]


class BestFitEntry(_Entry):
    """Alignment of an instrument's readings of the tip, or of a point of the tool, with their nominal positions."""

    poses: list[VisitEntry] | str | None = Field(
        None, description="Poses that are read: names or joint values, or the file of a grid, relative to the sheet."
    )
    random: str | None = Field(None, description="Number of random poses that are read, instead of poses.")
    std: str = Field("0 mm", description="Standard deviation of each coordinate of a reading.")
    point: str | None = Field(
        None, description="Point that is read, in the axes of the robot's tip (default: the tip, or the target)."
    )


class TaughtEntry(_Entry):
    """A pose that the robot is taught; it then moves relative to it."""

    pose: str = Field(description=_POSE)
    touch: Touch = Field("0 mm", description="Standard deviation of the touch.")


class ThreePointsEntry(_Entry):
    """A frame of three touched points."""

    origin: str = Field(description="Pose at its origin.")
    x: str = Field(description="Pose at a point on +x.")
    xy: str = Field(description="Pose at a point in the xy plane, with y above zero.")
    touch: Touch = Field("0 mm", description="Standard deviation of each coordinate of a touch.")


class ToolPivotEntry(_Entry):
    """A tool whose tip is found by holding it on one point."""

    poses: list[VisitEntry] = Field(
        description="Poses, by name or values, with the tip on the point, in different attitudes."
    )
    touch: Touch = Field("0 mm", description="Standard deviation of each coordinate of a touch.")


class EyeToHandEntry(_Entry):
    """A fixed camera, calibrated on a board in the hand, which sees the workpiece."""

    camera: PlaceEntry = Field(description="The camera: in the frame on for hand_eye, in the base for eye_to_hand.")
    board: PlaceEntry = Field(description="The board: in the base for hand_eye, in the frame on for eye_to_hand.")
    on: str = Field(description="Link that carries the camera, or the board.")
    poses: list[VisitEntry] = Field(description="Poses, by name or joint values, from which the board is seen.")
    grasp: PlaceEntry = Field(description="The tip in the workpiece at the task.")
    noise: PairEntry = Field(
        default_factory=lambda: PairEntry(translation="0 mm", rotation="0 mrad"), description="Noise of a view."
    )
    weights: PairEntry | None = Field(
        None, description="Standard deviations that the solver assumes (default: the noise)."
    )


class HandEyeEntry(EyeToHandEntry):
    """A camera in the hand, calibrated on a fixed board, which sees the workpiece from a view."""

    view: str | dict[str, str] = Field(description="Pose from which the workpiece is seen, or one for each task.")


class DatumEntry(_Entry):
    """A datum: one procedure with its settings."""

    best_fit: BestFitEntry | None = None
    taught: TaughtEntry | None = None
    three_points: ThreePointsEntry | None = None
    tool_pivot: ToolPivotEntry | None = None
    hand_eye: HandEyeEntry | None = None
    eye_to_hand: EyeToHandEntry | None = None

    @model_validator(mode="after")
    def _check_number(self) -> DatumEntry:
        if len(self.model_fields_set) != 1:
            raise ValueError(f"a datum is one of {', '.join(type(self).model_fields)} with its settings")
        return self


def read_datum(
    name: str,
    entry: DatumEntry,
    chain: Chain,
    poses: Mapping[str, Array],
    parse: Callable[[Any, Chain], Array],
    grid: Callable[[str, Chain, Mapping[str, Array]], list[Array]],
) -> Datum:
    """Return a datum of a sheet; raise a :class:`SettingError` for an invalid key.

    Args:
        parse, grid: Readers of joint values, and of the poses of a grid's file.
    """
    kind = next(iter(entry.model_fields_set))
    settings = getattr(entry, kind)
    with placed(kind):
        written = getattr(settings, "poses", None) or ()
        with placed("poses"):
            visits = grid(written, chain, poses) if isinstance(written, str) else list(written)
        for number, visit in enumerate(() if isinstance(written, str) else visits):
            if not isinstance(visit, str) or (visit not in poses and _STARTS_AS_NUMBER.match(visit)):
                with placed("poses", number):
                    visits[number] = parse(visit, chain)
        settings = settings.model_copy(update={"poses": visits} if visits else {})
        datum = _MAKERS[kind](name, settings, chain, poses)
        check_datum(datum, chain, poses)
    return datum


def check_datum(datum: Datum, chain: Chain, poses: Mapping[str, Array]) -> None:
    """Raise if poses are unknown or do not determine a datum."""

    def configuration(pose: Any) -> Array:
        if isinstance(pose, str) and pose not in poses:
            raise UnknownNameError("pose", pose, poses)
        return poses[pose] if isinstance(pose, str) else chain.configuration(pose)

    bound = datum.bound(len(chain.joints), configuration)
    chain = chain if bound.place is None else chain.with_target(bound.place)
    frame = chain.placements[-1] if bound.frame is None else chain.link_frame(bound.frame).frame
    link = len(chain.joints) if bound.frame is None else chain.link_frame(bound.frame).link
    postures = [chain.at(configuration(visit)) for visit in bound.visits]
    places = [p.pose if bound.frame is None else se3.compose(p.link_poses[link], frame) for p in postures]
    bound.maps(np.array(places))


def _best_fit(name: str, entry: BestFitEntry, chain: Chain, poses: Mapping[str, Array]) -> Datum:
    if (entry.poses is None) == (entry.random is None):
        raise InputError("a best_fit needs poses: [a, b, c], poses: GRID.yaml, or random: 30")
    std = _number("std", entry.std, LENGTH)
    with placed("point"):
        point = None if entry.point is None else units.parse_vector(entry.point, LENGTH, count=3)
    if entry.poses is not None:
        return Datum.best_fit(entry.poses, std, point=point, name=name)
    with placed("random"):
        count = units.parse(entry.random, units.RATIO)
        if count != int(count) or count < 3:
            raise InputError(f"expected a whole number of poses from 3 on, got {entry.random}")
        return Datum.best_fit(list(random_poses(chain, int(count)).q.T), std, point=point, name=name)


def _taught(name: str, entry: TaughtEntry, chain: Chain, poses: Mapping[str, Array]) -> Datum:
    return Datum.taught(entry.pose, _touch(entry.touch), name=name)


def _three_points(name: str, entry: ThreePointsEntry, chain: Chain, poses: Mapping[str, Array]) -> Datum:
    return Datum.three_points(entry.origin, entry.x, entry.xy, _touch(entry.touch), name=name)


def _tool_pivot(name: str, entry: ToolPivotEntry, chain: Chain, poses: Mapping[str, Array]) -> Datum:
    return Datum.tool_pivot(entry.poses, _touch(entry.touch), name=name)


def _hand_eye(name: str, entry: HandEyeEntry, chain: Chain, poses: Mapping[str, Array]) -> Datum:
    return Datum.hand_eye(entry.poses, entry.view, name=name, **_camera(entry))


def _eye_to_hand(name: str, entry: EyeToHandEntry, chain: Chain, poses: Mapping[str, Array]) -> Datum:
    return Datum.eye_to_hand(entry.poses, name=name, **_camera(entry))


_MAKERS: Final[Mapping[str, Callable[[str, Any, Chain, Mapping[str, Array]], Datum]]] = {
    "best_fit": _best_fit,
    "taught": _taught,
    "three_points": _three_points,
    "tool_pivot": _tool_pivot,
    "hand_eye": _hand_eye,
    "eye_to_hand": _eye_to_hand,
}


def _camera(entry: EyeToHandEntry) -> dict[str, Any]:
    places = {key: _place(key, getattr(entry, key)) for key in ("camera", "board", "grasp")}
    weights = None if entry.weights is None else _pair("weights", entry.weights)
    return {**places, "on": entry.on, "noise": _pair("noise", entry.noise), "weights": weights}


def _place(key: str, entry: PlaceEntry) -> Array:
    with placed(key, "xyz"):
        position = units.parse_vector(entry.xyz, LENGTH, count=3)
    with placed(key, "rpy"):
        angles = units.parse_vector(entry.rpy, ANGLE, count=3)
    return se3.pose(se3.rpy_rotation(angles), position)


def _pair(key: str, entry: PairEntry) -> tuple[float, float]:
    with placed(key):
        return _number("translation", entry.translation, LENGTH), _number("rotation", entry.rotation, ANGLE)


def _touch(entry: Touch) -> dict[str, float]:
    if isinstance(entry, str):
        return {"std": _number("touch", entry, LENGTH)}
    with placed("touch"):
        return {"std": _number("std", entry.std, LENGTH), "attitude": _number("attitude", entry.attitude, ANGLE)}


def _number(key: str, text: str, quantity: units.Quantity) -> float:
    with placed(key):
        value = units.parse(text, quantity)
    if value < 0:
        raise SettingError((key,), f"{key} must be zero or more, got {text}")
    return value


def chosen_datums(names: str | list[str] | None, datums: Collection[str]) -> tuple[str, ...]:
    """Return names of datums in the order in which they are found, from a list or text with commas; ``none`` for none.

    ``compensated`` needs no entry in the sheet.

    Raises:
        UnknownNameError: No such datum.
        InputError: ``none`` beside others.
    """
    listed = names if isinstance(names, list) else [] if names is None else [name.strip() for name in names.split(",")]
    if listed == [NO_DATUM]:
        return ()
    if NO_DATUM in listed:
        raise InputError(f"{NO_DATUM!r} is for base axes and stands alone, got {', '.join(listed)}")
    for name in listed:
        if name not in datums and name != COMPENSATED:
            raise UnknownNameError("datum", name, (*datums, COMPENSATED, NO_DATUM))
    return tuple(listed)
