"""Readings of an instrument at a pose: prediction and derivatives.

With the tip's error ``e = [d; δ]`` in base axes at a pose (R, p), a target at t in tool axes, and a base displaced by
``Trans(c)·Exp(ω)`` as seen by the instrument, the target is at

    y = Exp(ω) (p + d + Exp(δ) R t) + c.

A *position* is y; a *pose* is y and the orientation ``Exp(ω) Exp(δ) R Exp(τ)``. The other kinds are measured relative to
a place, which is displaced instead of the base: a *distance* is ``|y - a|`` from an anchor a; a *plane* gives the height
``n·(y - p)`` over a plane with a point p and a unit normal n, zero at contact; a *socket* gives ``y - s`` from the
position s of one of several sockets, zero if the target is in it.

Unknown parameters of the set-up (c, ω, t, τ, those of the place) are nuisance parameters; they are estimated with the
arm, without a prior. For a place they are a shift of a or s, and for a plane its offset along n and two tilts α, β: ``n
∝ n₀ + α t₁ + β t₂`` with unit vectors t in the plane.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from precision_pin.base import se3, units
from precision_pin.base.arguments import (
    check_choice,
    check_flag,
    check_instance,
    check_items,
    check_name,
    check_numbers,
    check_quantities,
    check_quantity,
    shown,
)
from precision_pin.base.arrays import Array, encode
from precision_pin.base.csv_columns import ColumnNames
from precision_pin.base.errors import InputError, UnitError
from precision_pin.base.units import ANGLE, LENGTH
from precision_pin.robot.chain import Chain
from precision_pin.sheet.drift import Drift, DriftEntry
from precision_pin.sheet.settings import SettingError, placed
from precision_pin.sheet.sight import DIRECTIONS, Sight, SightEntry
from precision_pin.sources.payload import Payload

_AXES: Final = ("x", "y", "z")
_POSE_AXES: Final = (*_AXES, "rx", "ry", "rz")
"""Suffixes of the nuisance parameters of a point and of a pose."""


@dataclass(frozen=True)
class Anchor:
    """A fixed point, ``(3,)``, from which distances are measured.

    Common interface of places: ``names`` of their nuisance parameters, in m or without unit; ``read`` returns the
    readings ``(m, N)`` at points ``(3, N)`` for ``parameters`` ``(k, N)``; ``slopes`` returns their derivatives by the
    point ``(m, 3)`` and by the parameters ``(m, k)`` at one point ``(3,)``; ``nominal`` is the nominal point.
    """

    place: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Shift of the anchor."""
        return tuple(f"anchor.{axis}" for axis in _AXES)

    def read(self, point: Array, parameters: Array, nominal: Array) -> Array:
        """Return distances."""
        difference = point - np.array(self.place)[:, None] - parameters
        return np.asarray(np.sqrt((difference**2).sum(axis=0))[None])

    def slopes(self, point: Array, parameters: Array, nominal: Array) -> tuple[Array, Array]:
        """Return derivatives of a distance."""
        difference = point - np.array(self.place) - parameters
        length = float(np.linalg.norm(difference))
        if length == 0.0:
            raise InputError("the target is at the anchor, where the direction of a distance is not defined")
        return difference[None] / length, -difference[None] / length


@dataclass(frozen=True)
class Plane:
    """A plane that the target touches: a point on it and its unit normal, ``(3,)`` each."""

    place: tuple[float, ...]
    normal: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Offset along the normal, and two tilts."""
        return ("plane.offset", "plane.tilt1", "plane.tilt2")

    @property
    def axes(self) -> Array:
        """Normal and two directions in the plane, as columns, ``(3, 3)``."""
        normal = np.array(self.normal)
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        first /= np.linalg.norm(first)
        return np.array([normal, first, np.cross(normal, first)]).T

    def tilted(self, parameters: Array) -> tuple[Array, Array]:
        """Return point and unit normal ``(3,)`` of the plane with nuisance parameters ``(3,)``."""
        normal = self.axes @ np.array([1.0, parameters[1], parameters[2]])
        normal /= np.linalg.norm(normal)
        return np.array(self.place) + parameters[0] * normal, normal

    def read(self, point: Array, parameters: Array, nominal: Array) -> Array:
        """Return heights."""
        difference = self.axes.T @ (point - np.array(self.place)[:, None])
        height = difference[0] + parameters[1] * difference[1] + parameters[2] * difference[2]
        return np.asarray(height / np.sqrt(1 + parameters[1] ** 2 + parameters[2] ** 2) - parameters[0])[None]

    def slopes(self, point: Array, parameters: Array, nominal: Array) -> tuple[Array, Array]:
        """Return derivatives of a height."""
        difference = self.axes.T @ (point - np.array(self.place))
        length = np.sqrt(1 + parameters[1] ** 2 + parameters[2] ** 2)
        by_point = self.axes @ np.array([1.0, parameters[1], parameters[2]]) / length
        height = by_point @ (point - np.array(self.place))
        tilts = (difference[1:] - parameters[1:] * height / length) / length
        return by_point[None], np.array([[-1.0, *tilts]])


@dataclass(frozen=True)
class Sockets:
    """Sockets for the tip, ``(3,)`` each; a pose uses the socket nearest to its nominal target."""

    places: tuple[tuple[float, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Shift of each socket."""
        return tuple(f"socket{k + 1}.{axis}" for k in range(len(self.places)) for axis in _AXES)

    def nearest(self, nominal: Array) -> int:
        """Return the socket of a pose with this nominal target ``(3,)``."""
        return int(np.argmin(np.linalg.norm(np.array(self.places) - nominal, axis=1)))

    def read(self, point: Array, parameters: Array, nominal: Array) -> Array:
        """Return offsets from the socket."""
        k = self.nearest(nominal)
        return np.asarray(point - np.array(self.places[k])[:, None] - parameters[3 * k : 3 * k + 3])

    def slopes(self, point: Array, parameters: Array, nominal: Array) -> tuple[Array, Array]:
        """Return derivatives of an offset."""
        k = self.nearest(nominal)
        by_parameters = np.zeros((3, parameters.size))
        by_parameters[:, 3 * k : 3 * k + 3] = -np.eye(3)
        return np.eye(3), by_parameters


Place = Anchor | Plane | Sockets
"""Reference of a reading."""
Kind = Literal["position", "pose", "distance", "plane", "socket"]
KINDS: Final[tuple[Kind, ...]] = ("position", "pose", "distance", "plane", "socket")
"""Kinds of measurement, those without a place first."""
KIND_SETTINGS: Final = {"attitude_std": "pose", "anchor": "distance", "plane": "plane", "sockets": "socket"}
"""Settings of one kind only, with the kind."""

_NAME: Final = re.compile(r"\w*")
"""Name of a target or base: part of column names and of paths, so no brackets or dots."""
# sum of joints with signs, and one of its terms
_SUM: Final = re.compile(r"\s*[+-]?\s*[^\s+-]\S*(\s+[+-]\s*[^\s+-]\S*)*\s*")
_TERM: Final = re.compile(r"([+-]?)\s*([^\s+-]\S*)")
ESTIMATE: Final = "estimate"
"""A standard deviation that a calibration estimates."""
_LEVER: Final = 0.1
"""Distance (m) between the targets that measure an orientation, by default; angles are the more accurate the longer it is."""


def _first(stack: Array) -> Array:
    return np.moveaxis(stack, -1, 0)


def _skew(vectors: Array) -> Array:
    return _first(se3.skew(vectors.T))


class Linearised(NamedTuple):
    """Readings ``(N, m)``, and their derivatives by the tip's error ``(N, m, 6)`` and the nuisances ``(N, m, k)``."""

    values: Array
    by_error: Array
    by_nuisance: Array


class Slopes(NamedTuple):
    """Derivatives of a reading by the tip's error, ``(m, 6)``, and by the nuisances, ``(m, k)``."""

    error: Array
    nuisances: Array


_KEYS: Final = (
    *("kind", "std", "std_known", "sight", "stands_at", "drift", "attitude_std", "target", "base", "target_known"),
    *("anchor", "plane", "sockets", "visible_from", "facing", "cone", "target_name", "base_name", "load", "nuisances"),
)
"""Keys of the JSON."""
_LOAD: Final = ("at", "mass", "com")
"""Keys of a load in the JSON: the settings of a payload."""


@dataclass(frozen=True)
class Measurement:
    """An instrument and its set-up.

    Lengths and angles are numbers in SI, or text with a unit: ``std="20 um"``, ``target="0 0 100 mm"``.

    Args:
        kind: ``"position"`` of a target (x, y, z), ``"pose"`` (position and attitude), ``"distance"`` from a fixed
            anchor, ``"plane"`` (height over a plane, zero at contact) or ``"socket"`` (the target is put into a
            socket).
        std: Standard deviation of each measured length, m; at contact, of the contact. ``"estimate"``: estimated by the
            calibration. ``{"along": "10 um + 0.3 um/m", "across": "15 um + 6 um/m"}``, of a position or pose: along the
            line of sight and in each direction across it, a constant and a share of the distance; ``sight`` has them then,
            and ``std`` is the root mean square of the three at the base's origin (of the constants, if the place of the
            instrument is estimated). ``"10 um + 0.3 um/m"``, of a distance: a constant and a share of it, in ``sight`` too.
        stands_at: Where the instrument stands in the base, m, for ``along`` and ``across``; by default ``visible_from``,
            or with a free base the origin of the readings' axes.
        drift: ``{"std": "20 um", "every": "1 h"}``, of a position or pose: a random walk of the instrument along each axis,
            its standard deviation after a time or ``"100 readings"``. Before anything is read, ``pace`` is the time from a
            reading to the next, ``fixed`` the number of targets that stand still, read again after ``fixed_every``.
        target: The target in tool axes from the tip, m, independent of the model's target.
        base: ``"known"``: readings are in base axes. ``"free"``: the robot's base in the instrument's axes is unknown
            and estimated; for a distance, a plane and sockets their place, from the given initial values.
        target_known: Whether the target's position on the tool (for a pose, its orientation too) is known; else it is
            estimated.
        attitude_std: Standard deviation of each measured angle of a pose, rad (default: std / 0.1 m, for three targets
            0.1 m apart).
        anchor: Fixed point from which a distance is measured, in the base, m.
        plane: A point on the plane and its normal, in the base, m; required by ``"plane"``.
        sockets: Places of the sockets, in the base, m; required by ``"socket"``. A pose belongs to the socket nearest
            to its nominal target.
        visible_from: Position of the instrument in the base, m, if it must see the target.
        facing: Direction in tool axes in which the target faces, if it must be seen (default: z).
        cone: Largest angle between this direction and the instrument, rad.
        load: Payloads of fixed mass and position during the measurement, instead of the sheet's (default: the sheet's);
            ``()``: none.
        target_name, base_name: In a calibration with several measurements, the name of the target, and of the base (or
            place): measurements with equal names share nuisance parameters. ``target_name`` ``"2"`` reads the columns
            ``x2 y2 z2``.
        columns: Names and units of columns that the header of a data file lacks: ``"q1=joint1 [deg], x1=x [m],
            note=ignore"``; ``"*=[m rad]"`` gives the unit of all lengths and of all angles without one.

    Raises:
        InputError: A setting is invalid.

    Examples:
        >>> tracker = pp.Measurement("position", std="20 um", target="50 30 20 mm")
        >>> print(tracker.target)
        (0.05, 0.03, 0.02)
    """

    kind: Kind = "position"
    std: float = 20e-6
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base: Literal["known", "free"] = "known"
    target_known: bool = True
    attitude_std: float | None = None
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)
    plane: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    sockets: tuple[tuple[float, float, float], ...] = ()
    visible_from: tuple[float, float, float] | None = None
    facing: tuple[float, float, float] | None = None
    cone: float = np.pi / 3
    load: tuple[Payload, ...] | None = None
    target_name: str = ""
    base_name: str = ""
    columns: str = ""
    coupled: Mapping[str, str] | tuple[tuple[str, str], ...] = ()
    std_known: bool = True
    stands_at: tuple[float, float, float] | None = None
    sight: Sight | None = None
    drift: Drift | None = None

    def __post_init__(self) -> None:
        check_choice("the kind of a measurement", self.kind, KINDS)
        check_choice("the base of a measurement", self.base, ("known", "free"))
        check_flag("target_known of a measurement", self.target_known)
        check_flag("std_known of a measurement", self.std_known)
        if isinstance(self.std, str) and self.std == ESTIMATE:
            self._fix("std", type(self).std)
            self._fix("std_known", False)
        sight = Sight.of(self.std) if isinstance(self.std, Mapping) else None
        if isinstance(self.std, str):
            sight = Sight.of_distance(self.std)
        if sight is not None:
            self._fix("sight", sight)
            self._fix("std", type(self).std)
        above, what = "above zero and finite", "std, the standard deviation of a measurement,"
        self._fix("std", check_quantity(what, self.std, LENGTH, above, lambda n: n > 0))
        if self.attitude_std is not None:
            what = "attitude_std of a measurement"
            self._fix("attitude_std", check_quantity(what, self.attitude_std, ANGLE, above, lambda n: n > 0))
        for name in ("target", "anchor"):
            self._fix(name, _point(f"the {name} of a measurement", getattr(self, name)))
        self._check_places()
        self._check_visibility()
        self._check_sight()
        self._check_drift()
        if self.load is not None:
            load = check_items("the load of a measurement", self.load, Payload)
            if any(payload.draws("load") or isinstance(payload.mass, str) for payload in load):
                raise InputError(
                    "the load of a measurement is given by fixed numbers; what varies is a payload of the sheet"
                )
            self._fix("load", load)
        for name in ("target_name", "base_name"):
            if not isinstance(value := getattr(self, name), str) or not _NAME.fullmatch(value):
                raise InputError(f"{name} of a measurement must be letters and digits, got {shown(value)}")
        ColumnNames.parse(
            check_instance("columns of a measurement", self.columns, str, "such as 't=ignore, *=[m rad]'")
        )
        what, sums = "coupled of a measurement", dict(self.coupled) if isinstance(self.coupled, tuple) else self.coupled
        texts = check_items(what, check_instance(what, sums, dict, "{'joint3': 'joint3 - joint2'}").values(), str)
        self._fix("coupled", tuple(zip(sums, texts, strict=True)))
        for name, kind in KIND_SETTINGS.items():
            value = getattr(self, name)
            is_given = any(value) if isinstance(value, tuple) else value is not None
            if is_given and self.kind != kind:
                raise InputError(f"{name} belongs to the measurement of a {kind}, not of a {self.kind}")
            if not is_given and self.kind == kind and name in ("plane", "sockets"):
                raise InputError(f"the measurement of a {kind} needs {name}")

    def _check_places(self) -> None:
        if self.plane is not None:
            if not isinstance(self.plane, tuple | list) or len(self.plane) != 2:
                raise InputError("the plane of a measurement must be a point and a normal")
            point = _point("the point of the plane of a measurement", self.plane[0])
            self._fix("plane", (point, _direction("the normal of the plane of a measurement", self.plane[1])))
        if not isinstance(self.sockets, tuple | list):
            raise InputError("the sockets of a measurement must be a list of points")
        what = "entry {} of the sockets of a measurement"
        self._fix("sockets", tuple(_point(what.format(k), socket) for k, socket in enumerate(self.sockets, 1)))
        if len(set(self.sockets)) < len(self.sockets):
            raise InputError("two sockets of a measurement are at one place")

    def _check_visibility(self) -> None:
        what, limits = "the cone of a measurement", "above zero and at most a half turn"
        self._fix("cone", check_quantity(what, self.cone, ANGLE, limits, lambda n: 0 < n <= np.pi))
        if self.visible_from is None:
            if self.facing is not None or self.cone != type(self).cone:
                name = "cone" if self.facing is None else "facing"
                raise InputError(f"{name} of a measurement needs visible_from: where from the target is seen")
            return
        self._fix("visible_from", _point("visible_from of a measurement", self.visible_from))
        facing = (0.0, 0.0, 1.0) if self.facing is None else self.facing
        self._fix("facing", _direction("facing of a measurement", facing))

    def _check_sight(self) -> None:
        if self.sight is not None:
            check_instance("sight of a measurement", self.sight, Sight, "as std: {along: ..., across: ...} gives it")
        if self.stands_at is not None:
            self._fix("stands_at", _point("stands_at of a measurement", self.stands_at))
        if self.sight is None:
            if self.stands_at is not None:
                raise InputError("stands_at of a measurement needs std: {along: ..., across: ...}")
            return
        if self.kind == "distance" and self.sight.across is None and self.stands_at is None:
            self._fix("std", float(np.sqrt(self.sight.distance_variance(np.linalg.norm(self.anchor)))))
            return
        if self.sight.across is None:
            raise InputError(f"std of a length and a share of the distance belongs to a distance, not to a {self.kind}")
        if self.kind not in ("position", "pose"):
            raise InputError(
                f"std along and across belongs to a position or a pose, not to a {self.kind}; give one std"
            )
        if self.kind == "pose" and self.attitude_std is None:
            raise InputError("std along and across of a pose needs attitude_std, the standard deviation of its angles")
        if self.station is None and self.base == "known":
            raise InputError("std along and across needs stands_at: where the instrument stands, in base axes")
        origin = np.zeros((1, 3)) if self.station is None else -np.array([self.station])
        self._fix("std", float(np.sqrt(np.trace(self.sight.covariance(np.zeros(3), origin)[0]) / 3)))

    def _check_drift(self) -> None:
        if isinstance(self.drift, Mapping):
            self._fix("drift", Drift.of(self.drift))
        if self.drift is None:
            return
        check_instance("drift of a measurement", self.drift, Drift, "{'std': '20 um', 'every': '1 h'}")
        if self.kind not in ("position", "pose"):
            raise InputError(f"drift belongs to the measurement of a position or a pose, not of a {self.kind}")

    @property
    def station(self) -> tuple[float, float, float] | None:
        """Where the instrument stands in the base, m; ``None`` if only the readings tell."""
        return self.visible_from if self.stands_at is None else self.stands_at

    def mixing(self, chain: Chain) -> Array:
        """Return the matrix ``(n, n)`` from the joint columns of a data file to joint values."""
        names, result = chain.joint_names, np.eye(len(chain.joint_names))
        for joint, text in dict(self.coupled).items():
            row = names.index(check_name("joint of coupled", joint, names))
            if not _SUM.fullmatch(text):
                raise InputError(
                    f"coupled: {joint}: such as '{joint} - {names[row - 1]}' is expected, got {shown(text)}"
                )
            result[row] = 0.0
            for sign, name in _TERM.findall(text):
                column = names.index(check_name("joint of coupled", name, names))
                result[row, column] += -1.0 if sign == "-" else 1.0
                if chain.prismatic[column] != chain.prismatic[row]:
                    raise InputError(f"coupled: {joint}: {name} is no {'length' if chain.prismatic[row] else 'angle'}")
        if abs(np.linalg.det(result)) < 0.5:
            raise InputError("coupled: the values of the joints do not follow from those in the columns")
        return result

    def _fix(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def sees(self, pose: Array) -> bool:
        """Return whether the instrument sees the nominal target; only the target's direction can prevent it."""
        if self.visible_from is None or self.facing is None:
            return True
        sight = np.array(self.visible_from) - self._nominal(pose)
        along = float(sight @ pose[:3, :3] @ self.facing)
        return along >= float(np.linalg.norm(sight)) * math.cos(self.cone)

    @cached_property
    def place(self) -> Place | None:
        """Reference of the reading; none for a position or pose."""
        if self.kind == "distance":
            return Anchor(self.anchor)
        if self.plane is not None:
            return Plane(*self.plane)
        return Sockets(self.sockets) if self.sockets else None

    @property
    def size(self) -> int:
        """Number of components per reading."""
        return {"position": 3, "pose": 6, "distance": 1, "plane": 1, "socket": 3}[self.kind]

    @property
    def deviations(self) -> Array:
        """Standard deviation of each component of a reading, ``(m,)``."""
        angle = self.std / _LEVER if self.attitude_std is None else self.attitude_std
        return np.where(np.arange(self.size) < 3, self.std, angle)

    def covariance(self, pose: Array) -> Array:
        """Return the covariance ``(m, m)`` of the instrument where the nominal tip is at ``(4, 4)`` in the base."""
        result = np.diag(self.deviations**2)
        if self.sight is not None and self.kind == "distance":
            return self.sight.distance_variance(np.linalg.norm(self._nominal(pose) - self.anchor)).reshape(1, 1)
        if self.sight is not None:
            if self.station is None:
                raise InputError(
                    "without readings, std along and across needs stands_at: where the instrument stands, in base axes"
                )
            result[:3, :3] = self.sight.covariance(np.array(self.station), self._nominal(pose)[None])[0]
        return result

    def point_covariances(self, points: Array, origin: Array | tuple[float, float, float] | None = None) -> Array:
        """Return the covariances ``(N, 3, 3)`` of points ``(N, 3)`` that the instrument reads, in the axes of its readings, m.

        It stands at ``origin`` in these axes, ``(3,)``, m (default: as far as they tell).
        """
        if origin is None:
            origin = self.station if self.base == "known" else None if self.station else (0.0, 0.0, 0.0)
        if self.sight is None or origin is None:
            return np.tile(self.std**2 * np.eye(3), (len(points), 1, 1))
        return self.sight.covariance(np.array(origin), points)

    @property
    def unknown_deviations(self) -> dict[str, NDArray[np.bool_]]:
        """Masks ``(m,)`` of the components whose standard deviation is estimated, by its name; empty if known."""
        if self.std_known:
            return {}
        is_length = np.arange(self.size) < 3
        angles = {} if self.attitude_std is not None or is_length.all() else {"attitude_std": ~is_length}
        return {"std": is_length, **angles}

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the nuisance parameters: m, or rad for names that begin with r."""
        names: tuple[str, ...] = ()
        if self.base == "free":
            nuisance_names = tuple(f"base.{axis}" for axis in _POSE_AXES) if self.place is None else self.place.names
            names += _named(nuisance_names, self.base_name)
        if not self.target_known:
            nuisance_names = tuple(f"target.{axis}" for axis in (_POSE_AXES if self.kind == "pose" else _AXES))
            names += _named(nuisance_names, self.target_name)
        return names

    @property
    def displaces_base(self) -> bool:
        """Whether the first six nuisance parameters displace the base."""
        return self.base == "free" and self.place is None

    @property
    def sees_apart(self) -> bool:
        """Whether its base or target is found with the arm, so that what it sees errs less than the tip in base axes."""
        return self.displaces_base or not self.target_known

    def view_slopes(self, pose: Array, error: Array, nuisances: Array) -> tuple[Array, Array]:
        """Return how what it sees follows the tip's error ``(6, 6)`` and the nuisances ``(6, k)``, as :meth:`slopes`.

        Seen is the target, if it is not known, else the tip, in axes that a free base shares.
        """
        if self.place is not None or not self.sees_apart:
            return np.eye(6), np.zeros((6, 0))
        values = np.zeros(len(self._view.nuisances))
        values[: nuisances.size] = nuisances
        slopes = self._view.slopes(pose, error, values)
        return slopes.error, slopes.nuisances[:, : nuisances.size]

    @cached_property
    def _view(self) -> Measurement:
        point = (0.0, 0.0, 0.0) if self.target_known else self.target
        return Measurement("pose", base=self.base, target=point, target_known=self.target_known)

    def predict(self, pose: Array, errors: Array, nuisances: Array) -> Array:
        """Return readings ``(m, N)``; for a pose, its position and its rotation from the nominal orientation.

        Args:
            pose: The nominal tip in the base, ``(4, 4)``.
            errors: ``[d; δ]`` of the tip, ``(6, N)``.
            nuisances: ``(k, N)``.
        """
        point, attitude = self._target(pose, errors, nuisances)
        if self.place is not None:
            return self.place.read(point, self.split(nuisances)[0], self._nominal(pose))
        if self.kind == "position":
            return point
        return np.concatenate([point, se3.log_rotation(np.einsum("ijn,kj->ikn", attitude, pose[:3, :3]))])

    def _nominal(self, pose: Array) -> Array:
        return np.asarray(pose[:3, 3] + pose[:3, :3] @ self.target)

    def away(self, pose: Array) -> float:
        """Return the distance of the nominal target from contact with the plane or nearest socket, m; else zero."""
        if self.kind not in ("plane", "socket") or self.place is None:
            return 0.0
        parameters = np.zeros((len(self.place.names), 1))
        nominal = self._nominal(pose)
        return float(np.linalg.norm(self.place.read(nominal[:, None], parameters, nominal)))

    def _target(self, pose: Array, errors: Array, nuisances: Array) -> tuple[Array, Array]:
        """Return position ``(3, N)`` and orientation ``(3, 3, N)`` of the target as seen by the instrument."""
        shift, base_rotation, offset, target_rotation = self.split(nuisances)
        attitude = np.einsum("ijn,jk->ikn", se3.exp_rotation(errors[3:]), pose[:3, :3])
        point = pose[:3, 3, None] + errors[:3] + np.einsum("ijn,jn->in", attitude, offset)
        if target_rotation is not None:
            attitude = np.einsum("ijn,jkn->ikn", attitude, se3.exp_rotation(target_rotation))
        if base_rotation is None:
            return point, attitude
        rotation = se3.exp_rotation(base_rotation)
        return np.einsum("ijn,jn->in", rotation, point) + shift, np.einsum("ijn,jkn->ikn", rotation, attitude)

    def split(self, nuisances: Array) -> tuple[Array, Array | None, Array, Array | None]:
        """Return the base's shift and rotation (or the place's parameters), target ``(3, N)`` and its rotation."""
        samples, base_rotation, target_rotation = nuisances.shape[1], None, None
        first = 3 if self.place is None else len(self.place.names)
        if self.base == "free":
            shift, remaining = nuisances[:first], nuisances[first:]
            if self.place is None:
                base_rotation, remaining = remaining[:3], remaining[3:]
        else:
            shift, remaining = np.zeros((first, samples)), nuisances
        offset = np.array(self.target)[:, None] + np.zeros((1, samples))
        if not self.target_known:
            offset = offset + remaining[:3]
            target_rotation = remaining[3:] if self.kind == "pose" else None
        return shift, base_rotation, offset, target_rotation

    def slopes(self, pose: Array, error: Array, nuisances: Array) -> Slopes:
        """Return the derivatives of a reading at one error ``(6,)``, as :meth:`linearised`."""
        _, by_error, by_nuisance = self.linearised(pose[None], error[None], nuisances)
        return Slopes(by_error[0], by_nuisance[0])

    def linearised(self, poses: Array, errors: Array, nuisances: Array) -> Linearised:
        """Return readings at nominal tips ``(N, 4, 4)``, errors ``(N, 6)`` and nuisance parameters ``(k,)``, and derivatives.

        For an orientation, the derivatives of the rotation vector, in the axes of the reading, of a small further
        rotation.
        """
        count = len(poses)
        shift, base_rotation, offset, target_rotation = self.split(nuisances[:, None])
        turns = np.ascontiguousarray(errors[:, 3:].T)
        nominal, tilt = poses[:, :3, :3], _first(se3.left_jacobian(turns))
        rotation = np.eye(3) if base_rotation is None else se3.exp_rotation(base_rotation[:, 0])
        attitude = _first(se3.exp_rotation(turns)) @ nominal
        arm = attitude @ offset[:, 0]
        inner, attitude = poses[:, :3, 3] + errors[:, :3] + arm, rotation @ attitude
        by_error, parts = np.zeros((count, 6, 6)), [np.zeros((count, 6, 0))]
        by_error[:, :3, :3], by_error[:, 3:, 3:] = rotation, rotation @ tilt
        by_error[:, :3, 3:] = -rotation @ _skew(arm) @ tilt
        if base_rotation is not None:
            by_rotation, by_base = se3.left_jacobian(base_rotation[:, 0]), np.zeros((count, 6, 6))
            by_base[:, :3, :3], by_base[:, 3:, 3:] = np.eye(3), by_rotation
            by_base[:, :3, 3:] = -_skew(inner @ rotation.T) @ by_rotation
            parts.append(by_base)
        if not self.target_known:
            by_target = np.zeros((count, 6, 3 if target_rotation is None else 6))
            by_target[:, :3, :3] = attitude
            if target_rotation is not None:
                by_target[:, 3:, 3:] = attitude @ se3.left_jacobian(target_rotation[:, 0])
            parts.append(by_target)
        by_nuisance = np.concatenate(parts, axis=2)
        if self.place is not None:
            places = list(zip(inner, map(self._nominal, poses), strict=True))
            readings = [self.place.read(point[:, None], shift, at)[:, 0] for point, at in places]
            pairs = [self.place.slopes(point, shift[:, 0], at) for point, at in places]
            by_point, by_place = (np.array(part) for part in zip(*pairs, strict=True))
            of_place = [by_place] if self.base == "free" else []
            by_nuisance = np.concatenate([*of_place, by_point @ by_nuisance[:, :3]], axis=2)
            return Linearised(np.array(readings), by_point @ by_error[:, :3], by_nuisance)
        values = np.zeros((count, self.size))
        values[:, :3] = inner @ rotation.T + shift[:, 0]
        if self.kind == "pose":
            seen = attitude if target_rotation is None else attitude @ se3.exp_rotation(target_rotation[:, 0])
            values[:, 3:] = se3.log_rotation(np.moveaxis(seen @ nominal.swapaxes(1, 2), 0, -1)).T
        return Linearised(values, by_error[:, : self.size], by_nuisance[:, : self.size])

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Return reading minus prediction, both ``(m, N)`` as from :meth:`predict`; for an orientation the rotation."""
        if self.kind != "pose":
            return reading - predicted
        measured, expected = se3.exp_rotation(reading[3:]), se3.exp_rotation(predicted[3:])
        rotation = se3.log_rotation(np.einsum("ijn,kjn->ikn", measured, expected))
        return np.concatenate([reading[:3] - predicted[:3], rotation])

    def to_dict(self) -> dict[str, object]:
        """Return the set-up as in the JSON."""
        converted: dict[str, object] = {
            "attitude_std": float(self.deviations[-1]) if self.kind == "pose" else None,
            "anchor": self.anchor if self.kind == "distance" else None,
            "plane": None if self.plane is None else dict(zip(("point", "normal"), self.plane, strict=True)),
            "cone": None if self.facing is None else self.cone,
            "sight": None if self.sight is None else {name: getattr(self.sight, name) for name in DIRECTIONS},
            "load": None if self.load is None else [{key: getattr(load, key) for key in _LOAD} for load in self.load],
        }
        return {key: encode(converted[key] if key in converted else getattr(self, key)) for key in _KEYS}


def written_sums(mixing: Array, names: Sequence[str]) -> str:
    """Return a matrix of :meth:`Measurement.mixing` as text of ``coupled``; empty if it only changes signs."""
    if np.array_equal(np.abs(mixing), np.eye(len(names))):
        return ""
    sums = []
    for name, row in zip(names, mixing, strict=True):
        terms = [f"{'-' if row[k] < 0 else '+'} {names[k]}" for k in np.argsort(-row, kind="stable") if row[k]]
        sums += [f"{name}: {' '.join(terms)}".replace(": + ", ": ").replace(": - ", ": -")] * (terms != [f"+ {name}"])
    return ", ".join(sums)


def _named(numbers: tuple[str, ...], name: str) -> tuple[str, ...]:
    """Return ``base.x`` as ``base[name].x``."""
    return tuple(number.replace(".", f"[{name}].") for number in numbers) if name else numbers


def _point(what: str, value: object) -> tuple[float, ...]:
    return tuple(check_quantities(what, value, LENGTH, (3,), "three lengths in m, or with a unit").tolist())


def _direction(what: str, value: object) -> tuple[float, ...]:
    direction = check_numbers(what, value, (3,), "three numbers")
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise InputError(f"{what} is zero")
    return tuple((direction / length).tolist())


class PlaneEntry(BaseModel):
    """A plane that is touched."""

    model_config = ConfigDict(extra="forbid")

    point: str = Field(description="A point on it, such as '300 0 50 mm', in base axes.")
    normal: str = Field(description="Its normal, such as '0 0 1', in base axes.")


class LoadEntry(BaseModel):
    """A load while the arm is measured."""

    model_config = ConfigDict(extra="forbid")

    at: str = Field(description="The link that carries it.")
    mass: str = Field(description="Its mass, such as '1 kg'.")
    com: str = Field("0 0 0 mm", description="Its centre of mass in that link's frame.")


class MeasurementEntry(BaseModel):
    """Instrument and set-up of a calibration."""

    model_config = ConfigDict(extra="forbid")

    kind: Kind = Field("position", description=f"What is measured: {', '.join(KINDS)}.")
    std: Annotated[
        Annotated[str, Tag("one")] | Annotated[SightEntry, Tag("two")],
        Discriminator(lambda value: "two" if isinstance(value, dict | SightEntry) else "one"),
    ] = Field(
        "0.02 mm",
        description="Standard deviation of a measured length, of a contact; estimate: from the readings; of a distance also "
        "10 um + 0.3 um/m; or, along a line of sight and across it, {along: 10 um + 0.3 um/m, across: 15 um + 6 um/m}.",
    )
    stands_at: str | None = Field(
        None, description="Where the instrument stands, in base axes, if std is along its line of sight and across it."
    )
    drift: DriftEntry | None = Field(
        None, description="A slow motion of the instrument, of a position or pose, such as {std: 20 um, every: 1 h}."
    )
    attitude_std: str | None = Field(
        None, description="Standard deviation of a measured angle of a pose (default: std / 100 mm)."
    )
    target: str = Field("0 0 0 mm", description="The measured point in the tip's axes.")
    target_known: Literal["true", "false"] = Field("true", description="false: its place on the tool is estimated.")
    base: Literal["known", "free"] = Field(
        "known", description="free: the base in the instrument's axes (or anchor, plane, sockets) is estimated."
    )
    anchor: str = Field("0 0 0 mm", description="Origin of distances, in base axes.")
    plane: PlaneEntry | None = Field(None, description="The plane that is touched.")
    sockets: list[str] = Field(default_factory=list, description="Places of the sockets, in base axes.")
    visible_from: str | None = Field(
        None, description="Position of the instrument in base axes, if it must see the target."
    )
    facing: str | None = Field(
        None, description="Direction in the tip's axes in which the target faces (default: 0 0 1, its z)."
    )
    cone: str = Field("60 deg", description="Largest angle between that direction and the instrument.")
    load: list[LoadEntry] | Literal["none"] | None = Field(
        None, description="Loads during the measurement, instead of the payloads; none: no load."
    )
    target_name: str = Field("", description="Name of the target, if there are several: 2 reads the columns x2 y2 z2.")
    base_name: str = Field("", description="Name of the estimated base (or place), if there are several.")
    columns: str = Field(
        "", description="Meaning of the columns of a data file, such as 'q1=joint1 [deg], t=ignore, *=[m rad]'."
    )
    coupled: dict[str, str] = Field(
        default_factory=dict,
        description="Joint values from the columns of a data file: {joint3: joint3 - joint2} if the column is their sum.",
    )


_READ: Final = (
    *("attitude_std", "std", "drift", "target", "anchor", "sockets"),
    *("visible_from", "facing", "cone", "stands_at"),
)
"""Settings of numbers, in reading order: the first error is reported."""
# quantities of settings that are no lengths
_NO_LENGTHS: Final = {
    "attitude_std": ANGLE,
    "cone": ANGLE,
    "facing": units.RATIO,
    "normal": units.RATIO,
    "mass": units.MASS,
}
_SINGLE: Final = ("attitude_std", "std", "cone", "mass")
"""Settings of one number; all others have three."""


def read_measurement(entry: MeasurementEntry, chain: Chain) -> Measurement:
    """Return the measurement of an entry; raise a :class:`SettingError` for an invalid key."""
    plane: Any = entry.plane and tuple(
        _read(("plane", name), getattr(entry.plane, name)) for name in ("point", "normal")
    )
    read = {name: _read((name,), getattr(entry, name)) for name in _READ}
    plain = {name: getattr(entry, name) for name in ("kind", "base", "target_name", "base_name", "columns", "coupled")}
    is_known = entry.target_known == "true"
    measurement = Measurement(**read, **plain, target_known=is_known, plane=plane, load=_read_load(entry, chain))
    with placed("coupled"):
        measurement.mixing(chain)
    return measurement


def only_one(measurements: tuple[Measurement, ...], file: str | None = None) -> Measurement:
    """Return the only measurement of a sheet; raise an :class:`InputError` if there are several."""
    if len(measurements) == 1:
        return measurements[0]
    kinds = [measurement.kind for measurement in measurements]
    kinds_text = ", ".join(f"{kind} ({kinds.count(kind)})" for kind in dict.fromkeys(kinds))
    message = (
        f"the sheet lists {len(kinds)} measurements, but only a fit to data takes more than one: {kinds_text}; select a kind "
        "that is listed once with --kind KIND"
    )
    raise InputError.of("E_USAGE", message, file)


def _read_load(entry: MeasurementEntry, chain: Chain) -> tuple[Payload, ...] | None:
    if entry.load is None:
        return None
    payloads = []
    for k, load in enumerate(() if entry.load == "none" else entry.load):
        try:
            chain.link_frame(load.at)
        except InputError as error:
            raise SettingError(("load", k, "at"), error.findings[0].message) from None
        mass, com = (_read(("load", k, name), getattr(load, name)) for name in ("mass", "com"))
        payloads.append(Payload(at=load.at, mass=mass, com=com))
    return tuple(payloads)


def _read(path: tuple[str | int, ...], text: Any) -> Any:
    """Return the numbers of a setting in SI; for a list, the numbers of each entry."""
    if text is None:
        return None
    if isinstance(text, list):
        return tuple(_read((*path, k), item) for k, item in enumerate(text))
    if isinstance(text, SightEntry):
        with placed("std"):
            Sight.of(text.model_dump())
        return text.model_dump()
    if isinstance(text, DriftEntry):
        with placed("drift"):
            return Drift.of(text.model_dump())
    try:
        return read_setting(next(key for key in reversed(path) if isinstance(key, str)), text)
    except UnitError as error:
        raise SettingError(path, f"{'.'.join(map(str, path))}: {error.findings[0].message}") from None
    except InputError as error:
        raise SettingError(path, error) from None


def read_setting(name: str, text: str) -> Any:
    """Return the number or three numbers of a setting in SI; of ``std`` also words and sums, as they are; raise if invalid."""
    if name == "std" and (text.strip() == ESTIMATE or Sight.of_distance(text) is not None):
        return text.strip()
    if name not in _SINGLE:
        return tuple(units.parse_vector(text, _NO_LENGTHS.get(name, LENGTH), count=3))
    value = units.parse(text, _NO_LENGTHS.get(name, LENGTH))
    if value <= 0 and name.endswith("std"):
        raise InputError(f"{name} must be above zero, got {shown(text)}")
    return value
