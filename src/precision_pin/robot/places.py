"""Places on a chain, positions of the URDF's links on it, the loads that it carries, and its state under load."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_numbers
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.expressions import Expression
from precision_pin.robot.bent_shape import NO_LENGTH, BentShape
from precision_pin.robot.urdf import Joint, Robot

ORDER_START, ORDER_FRAME, ORDER_CUSTOM, ORDER_END, ORDER_SEAT, ORDER_BOW = range(-1, 5)
"""Order of the kinds of places on one chain link; a bow moves only the loads on its link."""

_SAME_POINT: Final = 1e-9
"""Distance (m) up to which two frames count as being at one point."""


@dataclass(frozen=True)
class Place:
    """A point of the chain where a small rigid displacement ``E = Trans(d)·Exp(δ)`` is inserted.

    Places are the same if link, order and name are. Contributions to one place add; displacements of different places
    multiply in the order of ``(link, order)``: a link's start, frames along it, custom places, its end, the seat.
    ``frame`` is its pose in the chain link's axes, ``(4, 4)``.
    """

    link: int
    order: tuple[int, int]
    name: str
    frame: Array = field(compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.frame, np.ndarray) or self.frame.shape != (4, 4) or self.frame.flags.writeable:
            frame = check_numbers(f"the frame of the place {self.name!r}", self.frame, (4, 4))
            object.__setattr__(self, "frame", frame)

    @property
    def is_seat(self) -> bool:
        """True for the seat of the next joint, after the link's end."""
        return self.order[0] == ORDER_SEAT

    @property
    def is_start(self) -> bool:
        """True for the start of a link, directly after the joint before it."""
        return self.order[0] == ORDER_START

    @property
    def is_bow(self) -> bool:
        """True for the middle of a bent link, whose displacement moves neither the tip nor what is beyond the link."""
        return self.order[0] == ORDER_BOW

    @property
    def joint(self) -> int | None:
        """The joint (0-based) whose mounting it displaces: after a seat, or before a link's start."""
        if self.is_seat:
            return self.link
        return self.link - 1 if self.is_start else None

    def is_same(self, other: object) -> bool:
        """Return whether another place is the same, including the frame."""
        return isinstance(other, Place) and self == other and np.array_equal(self.frame, other.frame)

    @classmethod
    def start(cls, link: int, name: str) -> Place:
        """Return the place at a link's start, directly after the joint before it."""
        return cls(link, (ORDER_START, 0), name, np.eye(4))

    @classmethod
    def along(cls, link: int, rank: int, name: str, frame: Array) -> Place:
        """Return the place at a URDF link's frame on the path, by its rank within the chain link."""
        return cls(link, (ORDER_FRAME, rank), f"frame {name}", frame)

    @classmethod
    def far_end(cls, link: int, name: str, frame: Array) -> tuple[Place, Place]:
        """Return the end of a link, which leads to the joint or tip ``name``, and the seat after it."""
        return (
            cls(link, (ORDER_END, 0), f"end of link {link} ({name})", frame),
            cls(link, (ORDER_SEAT, 0), f"seat of link {link} ({name})", frame),
        )

    @classmethod
    def bow(cls, end: Place) -> Place:
        """Return the middle of the link with this end, in the link's axes: see :class:`BentShape`."""
        return cls(end.link, (ORDER_BOW, 0), f"middle of link {end.link}", se3.translation(end.frame[:3, 3] / 2))

    @classmethod
    def custom(cls, link: int, rank: int, name: str, frame: Array) -> Place:
        """Return a source's own place, before the link's end; ``rank`` orders those of one source."""
        return cls(link, (ORDER_CUSTOM, rank), name, frame)


@dataclass(frozen=True, eq=False)
class LinkFrame(Fixed):
    """Position of a URDF link on the chain; branches and locked joints belong to the chain link that carries them.

    ``frame`` ``(4, 4)``, ``attachment`` ``(3,)`` and ``stretch`` ``(2, 3)`` are in the chain link's axes. ``path_rank``
    is its position among the URDF links on the path within the chain link; ``None`` for a branch. ``attachment``: for a
    branch the position on the path of the joint that holds it (its frame in the file, whatever the base is), else its
    own origin. ``stretch``: the ends of its part of the path, from joint to joint, extended over massless links that it
    carries. ``is_own`` marks the chain link's own body: of the links on the path, the one nearest to the file's root,
    the child of the joint that moves it; if that is massless, the next one with mass whose frame is at the same point.
    """

    link: int
    frame: Array
    path_rank: int | None
    attachment: Array
    stretch: Array | None = None
    is_own: bool = False

    def frame_at(self, point: ArrayLike) -> Array:
        """Return the frame ``(4, 4)`` with its origin at a point ``(3,)`` of the URDF link, in the chain link's axes."""
        frame = np.array(self.frame)
        frame[:3, 3] += frame[:3, :3] @ np.asarray(point)
        return frame

    def entry(self, centre: ArrayLike) -> Array:
        """Return where on the chain link, in its axes, a weight acts whose centre is in the URDF link's axes.

        The centre itself for a link on the path; for a branch the point where it leaves the path.
        """
        if self.path_rank is None:
            return self.attachment
        return self.frame[:3, :3] @ np.asarray(centre, dtype=float) + self.frame[:3, 3]


def locked_values(robot: Robot, joints: Sequence[Joint], locked: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every moving joint that is not on the chain."""
    on_chain = {joint.name for joint in joints}
    other_joints = {joint.name: joint for joint in robot.joints if joint.kind != "fixed" and joint.name not in on_chain}
    for name in locked:
        if name not in other_joints:
            raise UnknownNameError("joint to lock", name, other_joints)
    values: dict[str, float] = {}

    def value_of(name: str) -> float:
        if name in on_chain:
            return 0.0
        if name not in values:
            joint = other_joints[name]
            if name in locked:
                values[name] = locked[name]
            elif joint.mimic is not None:
                values[name] = joint.mimic.multiplier * value_of(joint.mimic.joint) + joint.mimic.offset
            elif joint.limit is not None and joint.kind != "continuous":
                values[name] = float(np.clip(0.0, joint.limit.lower, joint.limit.upper))
            else:
                values[name] = 0.0
        return values[name]

    return {name: value_of(name) for name in other_joints}


def link_frames(
    robot: Robot, tip: str, joints: Sequence[Joint], locked: Mapping[str, float]
) -> tuple[dict[str, LinkFrame], Array]:
    """Return the position of every link, and the placements between the chain's joints."""
    moving = {joint.name: k + 1 for k, joint in enumerate(joints)}
    joint_path = robot.path(robot.root, tip)
    path_links = {robot.root, *(joint.child for joint in joint_path)}
    frames = {robot.root: LinkFrame(0, np.eye(4), 0, np.zeros(3))}
    placements = np.tile(np.eye(4), (len(joints) + 1, 1, 1))
    waiting = list(robot.child_joints(robot.root))
    while waiting:
        joint = waiting.pop()
        parent = frames[joint.parent]
        origin = parent.frame @ joint.origin
        if joint.name in moving:
            placements[moving[joint.name] - 1] = origin
            frames[joint.child] = LinkFrame(moving[joint.name], np.eye(4), 0, np.zeros(3))
        else:
            frame = origin @ joint.motion(locked[joint.name]) if joint.moves else origin
            rank, attachment = None, parent.attachment
            if parent.path_rank is not None and joint.child in path_links:
                rank, attachment = parent.path_rank + 1, frame[:3, 3]
            elif parent.path_rank is not None:
                attachment = parent.frame[:3, 3] if joint.reversed else origin[:3, 3]
            frames[joint.child] = LinkFrame(parent.link, frame, rank, attachment)
        waiting.extend(robot.child_joints(joint.child))
    placements[-1] = frames[tip].frame
    rows = [_Row([robot.root], [])]
    for joint in joint_path:
        if joint.name in moving:
            rows.append(_Row([joint.child], []))
        else:
            rows[-1].names.append(joint.child)
            rows[-1].joints.append(joint)
    for row in rows:
        end_pair = row.ends(frames, placements)
        own_rank = row.own_rank(robot, frames)
        for k, name in enumerate(row.names):
            frames[name] = replace(frames[name], stretch=end_pair[row.weight_ends(robot, k)], is_own=k == own_rank)
    return frames, placements


@dataclass(frozen=True)
class _Row:
    """The URDF links on the path within one chain link, base to tip, and the joints between them."""

    names: list[str]
    joints: list[Joint]

    def ends(self, frames: Mapping[str, LinkFrame], placements: Array) -> Array:
        """Return start of the first link, the joints' positions and end of the last link, ``(len(names) + 1, 3)``."""
        # in the file, the joint that holds a link is at the frame of this link
        holds = [self.names[k] if joint.reversed else self.names[k + 1] for k, joint in enumerate(self.joints)]
        points = [np.zeros(3), *(frames[name].frame[:3, 3] for name in holds)]
        return np.array([*points, placements[frames[self.names[0]].link][:3, 3]])

    def own_rank(self, robot: Robot, frames: Mapping[str, LinkFrame]) -> int:
        """Return the number of the chain link's own body."""
        first = max((k + 1 for k, joint in enumerate(self.joints) if joint.reversed), default=0)
        origins = [frames[name].frame[:3, 3] for name in self.names]
        ranks = [k for k, origin in enumerate(origins) if np.abs(origin - origins[first]).max() <= _SAME_POINT]
        with_mass = [k for k in ranks if robot.link(self.names[k]).mass]
        return min(with_mass, key=lambda k: abs(k - first), default=first)

    def weight_ends(self, robot: Robot, number: int) -> list[int]:
        """Return the ends of a link's weight, extended over massless links that it carries in the file."""

        def weightless(k: int) -> bool:
            return not robot.link(self.names[k]).mass

        start, stop = number, number + 1
        while start > 0 and self.joints[start - 1].reversed and weightless(start - 1):
            start -= 1
        while stop < len(self.names) and not self.joints[stop - 1].reversed and weightless(stop):
            stop += 1
        return [start, stop]


Factors = tuple[Expression, ...]
"""Parameters whose product multiplies a number; none for a constant."""


Weight = tuple[Iterable[Any], list[tuple[Factors, Any, Any, Any, Any]], list[tuple[Factors, Array, Array]]]
"""A load in the base: origin of its frame; for each moment, factors, mass and first moment; for each wrench, factors, the
point on which it acts ``(3[, P])``, and the wrench ``(6[, P])``, all in base axes.

The numbers of a weight are Python floats, faster than arrays for sums of three, or arrays over P postures.
"""
_NOTHING: Final = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Load:
    """A load on the chain: a weight, an applied wrench, one end of a pull, or several of them.

    Carried by chain link ``link``; ``frame`` ``(4, 4)``, that of its moments, ``attachment`` ``(3,)``, where it acts,
    and ``stretch`` ``(2, 3)`` are in the link's axes. ``along``: the weight of the link's own body, spread evenly along
    it. ``moments``: mass (kg) and first moment (kg·m) ``(4,)`` with the parameters that multiply them, to be added.
    ``stretch``: ends of its part of the link; ``None``: the whole link for a weight ``along`` it, else a point.
    ``wrenches``: force and moment (N, N·m) at the frame's origin ``(6,)`` with the parameters that multiply them, to be
    added. With ``turns`` they are in the frame's axes and turn with it (a follower force), else in base axes (a dead one).
    ``pull``: the tension towards a point of another link, of which the frame's origin is one end.
    """

    link: int
    frame: Array
    attachment: Array
    along: bool
    moments: tuple[tuple[Array, Factors], ...]
    stretch: Array | None = None
    wrenches: tuple[tuple[Array, Factors], ...] = ()
    turns: bool = False
    pull: Pull | None = None

    def stretch_along(self, x: Array, length: float) -> tuple[float, float]:
        """Return the ends (m) of its stretch on a link of this direction and length, equal if it has no length."""
        if self.stretch is None:
            return (0.0, length) if self.along else (0.0, 0.0)
        start, stop = sorted(float(min(max(reach, 0.0), length)) for reach in self.stretch @ x)
        return (start, stop) if stop - start > NO_LENGTH * length else (start, start)

    def reach_along(self, x: Array, length: float) -> float:
        """Return where (m) it acts on such a link: at the projection of its attachment, at the end if that is beyond."""
        reach = float(x @ self.attachment)
        return reach if reach < (1 - NO_LENGTH) * length else length

    def half_spread(self, reach: float, x: Array, length: float) -> float:
        """Return how far (m) its stretch on such a link reaches on both sides of its centre at ``reach``."""
        start, stop = self.stretch_along(x, length)
        half_spread = min(reach - start, stop - reach)
        return half_spread if half_spread > NO_LENGTH * length else 0.0

    def __post_init__(self) -> None:
        for name, shape in (("frame", (4, 4)), ("attachment", (3,)), ("stretch", (2, 3))):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, check_numbers(f"{name} of a load", value, shape))
        for name, what, size in (("moments", "mass and first moment", 4), ("wrenches", "force and moment", 6)):
            checked = tuple(
                (check_numbers(f"{what} of a load", values, (size,)), factors)
                for values, factors in getattr(self, name)
            )
            object.__setattr__(self, name, checked)


CarrierOf = Callable[[Load], Array]
"""Function from a load to the axes of the chain link that carries it, in the base, ``(4, 4[, P])``."""


@dataclass(frozen=True, eq=False)
class Pull:
    """A tension T on the line between two points of two chain links, as of a spring.

    ``ends`` are loads without a weight whose frames have these points as origins, and ``tensions`` the parts ``constant +
    slope · L`` of T (N, N/m), L the distance of the points, with the parameters that multiply them, to be added.
    """

    name: str
    ends: tuple[Load, Load]
    tensions: tuple[tuple[float, float, Factors], ...]

    @property
    def loads(self) -> tuple[Load, Load]:
        """Both ends as loads on the chain."""
        first, second = self.ends
        return replace(first, pull=self), replace(second, pull=self)

    def wrenches(self, link: int, carrier_of: CarrierOf) -> list[tuple[Factors, Array, Array]]:
        """Return the wrenches on the end that a chain link carries: factors, point and wrench, as of a :data:`Weight`.

        Both ends have the first one as their point, so that they cancel to the last digit beyond a joint before both.

        Raises:
            InputError: The ends are at one point.
        """
        start, stop = (se3.compose(carrier_of(end), end.frame)[:3, 3] for end in self.ends)
        length = np.sqrt(((stop - start) ** 2).sum(axis=0))
        if np.min(length) <= _SAME_POINT:
            raise InputError(f"{self.name}: its ends are at one point, so its force has no direction")
        direction = (stop - start) / length
        along = np.concatenate([direction if link == self.ends[0].link else -direction, np.zeros_like(direction)])
        return [(factors, start, (constant + slope * length) * along) for constant, slope, factors in self.tensions]


@dataclass(frozen=True, eq=False)
class Deflection(Fixed):
    """A chain under load: links and their far ends, ``(n+1, 4, 4)``, base.

    ``bending`` is the displacement by the loads of each far end, and each :class:`BentShape`'s bow, ``[d; δ]`` in the
    link's axes, ``(n+1, 2, 6)``.
    """

    links: Array
    ends: Array
    bending: Array

    def shape(self, link: int, far_end: Array) -> BentShape:
        """Return the shape of a link in its axes, where its unbent far end is at ``far_end`` ``(3,)``."""
        displacement = self.links[link, :3, :3].T @ (self.ends[link, :3, 3] - self.links[link, :3, 3])
        end, bow = self.bending[link]
        return BentShape(far_end, end, bow, displacement - far_end)

    def carrier(self, load: Load, placement: Array) -> Array:
        """Return the axes of a load's link in the base, moved as the link's shape is where the load acts, ``(4, 4)``.

        A load on the link's end, or beyond it, moves with the end, a spread load as its stretch does in the mean.
        """
        base, far_end = self.links[load.link], placement[:3, 3]
        length = float(np.linalg.norm(far_end))
        x = far_end / (length or 1.0)
        start, stop = load.stretch_along(x, length)
        if not load.along or stop == start:
            reach = load.reach_along(x, length)
            if reach == length and not load.along:
                return self.ends[load.link] @ se3.inverse(placement)
            half_spread = load.half_spread(reach, x, length)
            start, stop = reach - half_spread, reach + half_spread
        if length == 0.0 or not self.bending[load.link].any():
            return base
        displacement = self.shape(load.link, far_end).mean_displacement(start, stop)
        point = se3.translation(x * (start + stop) / 2)
        return se3.compose(base, point, se3.displacement(displacement), se3.inverse(point))


def own_loads(robot: Robot, frames: Mapping[str, LinkFrame]) -> tuple[Load, ...]:
    """Return the weights of the URDF's links."""
    loads = []
    for frame, inertial in [(frames[link.name], link.inertial) for link in robot.links]:
        if inertial is not None and inertial.mass != 0:
            moments = ((inertial.mass * np.array([1.0, *inertial.com]), ()),)
            entry = frame.entry(inertial.com)
            loads.append(Load(frame.link, frame.frame, entry, frame.is_own, moments, frame.stretch))
    return tuple(loads)


def wrench_basis(frame: Array, gravity: Array, point: ArrayLike) -> Array:
    """Return force and moment ``(6, 4)`` about a point per unit of a load's mass and first moments, base axes.

    ``F = m g``, ``M = (R s + m (o - point)) × g`` with s the first moment in the load's frame (rotation R, origin o), g
    gravity.
    """
    basis = np.zeros((6, 4))
    basis[:3, 0] = gravity
    basis[3:, 0] = np.cross(frame[:3, 3] - np.asarray(point, dtype=float), gravity)
    basis[3:, 1:] = np.cross(frame[:3, :3].T, gravity).T
    return basis


def weigh(loads: Sequence[Load], carrier_of: CarrierOf) -> dict[Load, Weight]:
    """Return loads in the base."""
    if not loads:
        return {}
    carriers = [carrier_of(load) for load in loads]
    if carriers[0].ndim == 3:
        return {load: _weigh_at_many(load, carrier, carrier_of) for load, carrier in zip(loads, carriers, strict=True)}
    frames = np.array(carriers) @ np.array([load.frame for load in loads])
    owners = [k for k, load in enumerate(loads) for _ in load.moments]
    moments = np.array([moments for load in loads for moments, _ in load.moments]).reshape(-1, 4)
    rotated = (frames[owners, :3, :3] @ moments[:, 1:, None])[:, :, 0]
    rows = iter(np.column_stack([moments[:, 0], rotated]).tolist())
    return {
        load: (
            frame[:3, 3].tolist(),
            [(factors, *next(rows)) for _, factors in load.moments],
            _apply(load, frame, carrier_of),
        )
        for load, frame in zip(loads, frames, strict=True)
    }


def _weigh_at_many(load: Load, carrier: Array, carrier_of: CarrierOf) -> Weight:
    """Return a load in the base at P postures with its link's axes ``(4, 4, P)``."""
    frame = se3.compose(carrier, load.frame)
    rotated = [(moments[0], se3.turn(frame[:3, :3], moments[1:]), factors) for moments, factors in load.moments]
    weights = [(factors, mass, x, y, z) for mass, (x, y, z), factors in rotated]
    return frame[:3, 3], weights, _apply(load, frame, carrier_of)


def _apply(load: Load, frame: Array, carrier_of: CarrierOf) -> list[tuple[Factors, Array, Array]]:
    """Return the wrenches of a load as of a :data:`Weight`, with its frame in the base, ``(4, 4[, P])``."""
    rotation, point = frame[:3, :3], frame[:3, 3]
    many = (slice(None), *[None] * (frame.ndim - 2))
    if load.turns:
        applied = [
            (factors, point, np.concatenate([se3.turn(rotation, wrench[:3]), se3.turn(rotation, wrench[3:])]))
            for wrench, factors in load.wrenches
        ]
    else:
        applied = [(factors, point, wrench[many]) for wrench, factors in load.wrenches]
    return applied if load.pull is None else applied + load.pull.wrenches(load.link, carrier_of)


def wrench_on(
    weights: Sequence[Weight], gravity: Array, tilts: Sequence[tuple[Array, Factors]], point: ArrayLike
) -> dict[Factors, Array]:
    """Return the wrench ``(6[, P])`` of loads about a point ``(3[, P])``, base axes, by the parameters.

    ``tilts`` are contributions of sources to gravity: vectors ``(3,)``, base axes, m/s², with their parameters.
    """
    coordinates = np.asarray(point, dtype=float)
    x, y, z = coordinates.tolist() if coordinates.ndim == 1 else coordinates
    # mass and first moment about the point, for each part of gravity and each set of factors
    sums: dict[tuple[int, Factors], tuple[Any, Any, Any, Any]] = {}
    for (o_x, o_y, o_z), pieces, _ in weights:
        for part in range(1 + len(tilts)):
            for factors, mass, s_x, s_y, s_z in pieces:
                m, h_x, h_y, h_z = sums.get((part, factors), _NOTHING)
                sums[part, factors] = (
                    m + mass,
                    h_x + (s_x + mass * (o_x - x)),
                    h_y + (s_y + mass * (o_y - y)),
                    h_z + (s_z + mass * (o_z - z)),
                )
    pulls = [(gravity.tolist(), ()), *((tilt.tolist(), factors) for tilt, factors in tilts)]
    total: dict[Factors, Array] = {}
    for (part, factors), (m, h_x, h_y, h_z) in sums.items():
        (g_x, g_y, g_z), tilting = pulls[part]
        moment = (h_y * g_z - h_z * g_y, h_z * g_x - h_x * g_z, h_x * g_y - h_y * g_x)
        numbers = (m * g_x, m * g_y, m * g_z, *moment)
        wrench = np.array(numbers if coordinates.ndim == 1 else np.broadcast_arrays(*numbers))
        key = (*factors, *tilting)
        total[key] = total[key] + wrench if key in total else wrench
    for _, _, wrenches in weights:
        for factors, place, wrench in wrenches:
            lever = np.cross(place - coordinates, wrench[:3], axis=0)
            moved = np.concatenate(np.broadcast_arrays(wrench[:3], wrench[3:] + lever))
            total[factors] = total[factors] + moved if factors in total else moved
    return total


def torque_on(axis: Array, slides: bool, wrenches: Mapping[Factors, Array]) -> dict[Factors, Any]:
    """Return torque or force of wrenches about a joint's origin on its axis ``(3[, P])``, by their parameters."""
    rows = slice(0, 3) if slides else slice(3, 6)
    if axis.ndim == 2:
        return {factors: np.einsum("ip,ip->p", axis, wrench[rows]) for factors, wrench in wrenches.items()}
    return {factors: float(axis @ wrench[rows]) for factors, wrench in wrenches.items()}
