"""A base-to-tip chain of a URDF tree, the chain at one configuration, and the warnings about it.

*Chain link* i = 0…n is the rigid part between joint i and joint i+1 (1-based joints; 0 is the base side, n carries the
tip). Its axes are those of joint i's URDF frame after its motion, for link 0 the base link's. Arrays over joints are
0-based: ``axes[0]`` belongs to joint 1.
"""

from __future__ import annotations

import math
import os
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import arguments, se3
from precision_pin.base.arrays import Array, Fixed, read_only, returns_read_only
from precision_pin.base.errors import Finding, InputError, add, shown, warns_at_end
from precision_pin.base.units import ACCELERATION, LENGTH, MASS
from precision_pin.render.html import Table, rendered
from precision_pin.robot.configurations import Configurations
from precision_pin.robot.examples import ELSEWHERE, resolve_robot
from precision_pin.robot.pinocchio_model import PinocchioModel, model_poses
from precision_pin.robot.places import (
    Deflection,
    Factors,
    LinkFrame,
    Load,
    Place,
    Weight,
    link_frames,
    locked_values,
    own_loads,
    torque_on,
    weigh,
    wrench_basis,
    wrench_on,
)
from precision_pin.robot.postures import ChainConstants, Postures, alignment
from precision_pin.robot.urdf import Joint, Robot, ask_for_tip, parse, read, rerooted

if TYPE_CHECKING:
    from precision_pin.robot.collision import CollisionCheck, Obstacles

FARTHEST_TARGET: Final = 1000.0
"""Largest coordinate of a target in the tip's axes, m."""
EARTH: Final = (0.0, 0.0, -9.81)
"""Default gravity, base axes, m/s²."""
_LOOKED: Final = 2000
"""About how many of many poses are checked for collisions."""
_ABOUT_ONE: Final = re.compile(r"""(?:the )?(link|joint) (?:name )?('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")""")
"""Start of a warning about a link or joint, and of each entry of a warning that lists several."""
_OF_A_LOAD: Final = {"W_MASS_LARGE", "W_UNITS"}
"""Warnings about a mass or length, which also matter off the path: the weight of any link loads the arm."""


@dataclass(frozen=True, eq=False)
class Chain(Fixed):
    """The moving joints and rigid links between a base and a tip.

    Attributes:
        robot: The mechanism, rooted at the base.
        base, tip: Link names.
        joints: The chain's n joints, base to tip.
        locked: Value of every other joint that can move.
        placements: ``(n+1, 4, 4)``: from joint i's frame after its motion (base for i = 0) to joint i+1's origin frame
            before it turns (the tip for i = n).
        link_frames: Position of every URDF link on the chain.
        target: The point that results are about, in the tip's axes, m, ``(3,)``; zero for the tip itself. It carries no
            load.
        gravity: Gravity in base axes, m/s², ``(3,)``.
        loads: The weights of the URDF's links, and payloads.
        obstacles: What poses are checked against, as stated in a sheet; None for no check.
        wraps: Whether angles that are given outside limits are taken by whole turns inside, where these lead there.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> print(chain.joint_names)
        ('joint1', 'joint2', 'joint3', 'joint4')
        >>> print(chain.at([0, 0, 0, 0]).pose[:3, 3])
        [ 3.74  -0.274  0.085]
    """

    robot: Robot
    base: str
    tip: str
    joints: tuple[Joint, ...]
    locked: Mapping[str, float]
    placements: Array
    link_frames: Mapping[str, LinkFrame]
    target: Array
    gravity: Array
    loads: tuple[Load, ...]
    pinocchio: PinocchioModel = field(repr=False)
    obstacles: Obstacles | None = None
    wraps: bool = False

    @classmethod
    def from_urdf(
        cls,
        path: object,
        tip: str | None = None,
        base: str | None = None,
        gravity: Sequence[float] = EARTH,
        locked: Mapping[str, float] | None = None,
    ) -> Chain:
        """Read a URDF strictly and extract the chain from it.

        Args:
            path: The path of the URDF; ``example:NAME`` or ``robot_descriptions:NAME``; its text, which begins with
                ``<``; or a ``yourdfpy.URDF``.
            tip: The end-effector link; by default the only leaf.
            base: The fixed link, which may be any; by default the root.
            gravity: Gravity in the base link's axes, m/s².
            locked: Values (rad or m) at which joints are locked; other joints off the chain are locked at zero, or at
                the limit nearest to it. A mimic joint follows a joint off the chain; if it mimics a joint on the chain,
                it is locked at the value for that joint's zero. A joint on the chain may be locked too.

        Raises:
            UrdfError: The file cannot be used; carries every finding.
            UnknownNameError: No such link or joint.
            InputError: Several leaves and no tip, no moving joint on the chain, or a mimic joint on it.
        """
        return cls.from_robot(_read(path), tip, base, gravity, locked)

    @classmethod
    def from_pinocchio(
        cls,
        model: object,
        urdf: object,
        tip: str | None = None,
        base: str | None = None,
        gravity: Sequence[float] | None = None,
        locked: Mapping[str, float] | None = None,
    ) -> Chain:
        """Extract the chain of a ``pinocchio.Model`` and the URDF that it was built from, as for :meth:`from_urdf`.

        The model may be reduced: joints that it lacks are locked, at zero unless ``locked`` gives a value. Gravity is
        by default the model's, at its neutral configuration. Masses are those of the URDF.

        Raises:
            InputError: As :meth:`from_urdf`; or the model has the tip at another place than the URDF.
        """
        robot = _read(urdf)
        full = cls.from_robot(robot, tip, base, EARTH, locked)
        moving = [name for name in full.joint_names if name in set(getattr(model, "names", ()))]
        lacking = {name: 0.0 for name in full.joint_names if name not in moving}
        down, places = model_poses(model, moving, full.base, full.tip)
        locks = lacking | dict(locked or {})
        chain = cls.from_robot(robot, tip, base, down.tolist() if gravity is None else gravity, locks)
        for values, pose in places:
            if (apart := float(np.abs(chain.at(values).pose - pose).max())) > 1e-6:
                note = f"; joints that the model lacks are locked at {locks}, locked= changes that" if locks else ""
                raise InputError(
                    f"the Pinocchio model has {full.tip!r} {apart:.3g} away (m, or entries of a rotation) from where the URDF "
                    f"has it{note}"
                )
        return chain

    @classmethod
    def from_robot(
        cls,
        robot: Robot,
        tip: str | None = None,
        base: str | None = None,
        gravity: Sequence[float] = EARTH,
        locked: Mapping[str, float] | None = None,
    ) -> Chain:
        """Extract the chain from a robot; see :meth:`from_urdf`."""
        arguments.check_instance("robot", robot, Robot, "as urdf.read returns it")
        down = arguments.check_quantities("gravity", gravity, ACCELERATION, (3,), "three finite numbers, in base axes")
        if locked is not None:
            locked = {
                name: arguments.check_number(f"the value at which {name!r} is locked", value)
                for name, value in arguments.check_mapping("locked joints", locked).items()
            }
        if base is not None:
            robot.link(arguments.check_text("the name of the base link", base))
        if tip is None:
            if len(robot.leaves) != 1:
                raise InputError(ask_for_tip(robot))
            tip = robot.leaves[0]
        robot.link(arguments.check_text("the name of the tip link", tip))
        rooted = rerooted(robot, base) if base is not None and base != robot.root else robot
        joint_path = rooted.path(rooted.root, tip)
        joints = tuple(joint for joint in joint_path if joint.kind != "fixed" and joint.name not in (locked or {}))
        if not joints:
            raise InputError(f"no joint moves between {rooted.root!r} and {tip!r}; choose another base or tip")
        for joint in joints:
            if joint.mimic is not None:
                raise InputError(
                    f"the joint {joint.name!r} on the chain mimics {joint.mimic.joint!r}; lock it at a value"
                )
        locked_at = locked_values(rooted, joints, locked or {})
        frames, placements = link_frames(rooted, tip, joints, locked_at)
        return cls(
            robot=rooted,
            base=rooted.root,
            tip=tip,
            joints=joints,
            locked=locked_at,
            placements=placements,
            link_frames=frames,
            target=np.zeros(3),
            gravity=down,
            loads=own_loads(rooted, frames),
            pinocchio=PinocchioModel.load(rooted, [joint.name for joint in joints], locked_at, tuple(down)),
        )

    @cached_property
    def collision_check(self) -> CollisionCheck | None:
        """Check whether the arm hits itself or its obstacles; None if nothing is checked."""
        if self.obstacles is None:
            return None
        # late: coal takes as long to import as Pinocchio
        from precision_pin.robot.collision import CollisionCheck

        return CollisionCheck(self, self.obstacles)

    @property
    def collision_notes(self) -> tuple[Finding, ...]:
        """Assumptions and omissions of the collision check."""
        notes = () if self.collision_check is None else self.collision_check.notes
        return tuple(Finding("note", "N_COLLISION", note, self.robot.file) for note in notes)

    @cached_property
    def configurations(self) -> Configurations:
        """Reader of joint values of the chain."""
        return Configurations(self.joints, self.wraps)

    @property
    def kinematics(self) -> dict[str, str]:
        """Ends and hash of the robot's joints, by which a result knows its robot again."""
        return {"base": self.base, "tip": self.tip, "hash": self.robot.kinematics(self.base, self.tip)}

    def limited(self, values: Array) -> tuple[Configurations, Array]:
        """Return all joints whose limits a configuration must keep, and their values at configurations ``(n, P)``.

        After the chain's joints: those locked between base and tip, and those that mimic a joint of the chain.
        """
        joints, rows, value_of = [*self.joints], [*values], dict(zip(self.joint_names, values, strict=True))
        joint_path = self.robot.path(self.base, self.tip)
        for joint in self.robot.joints:
            if joint in joint_path and joint.name in self.locked:
                rows.append(np.full(values.shape[1], self.locked[joint.name]))
            elif joint.mimic is not None and joint.mimic.joint in value_of:
                rows.append(joint.mimic.multiplier * value_of[joint.mimic.joint] + joint.mimic.offset)
            joints += [joint] * (len(rows) - len(joints))
        return Configurations(tuple(joints)), np.array(rows)

    def configuration(self, q: ArrayLike | Mapping[str, float]) -> Array:
        """Return joint values ``(n,)`` in chain order, given in that order or by name.

        Raises:
            InputError: Wrong count, missing joint, or a value that is not finite; a prismatic joint beyond 1000 km.
            UnknownNameError: No such joint on the chain.
        """
        return self.configurations.one(q)

    def at(self, q: ArrayLike | Mapping[str, float]) -> Posture:
        """Return the chain at a configuration (rad and m, in chain order or by joint name)."""
        values = self.configuration(q)
        return Posture(self, values, self.pinocchio.joint_poses(values), self.loads)

    @warns_at_end
    def at_many(self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Postures:
        """Return the chain at P configurations at once.

        Args:
            q: An array ``(n, P)``, rad and m, in chain order: poses are columns. Or a list of P poses, each as for
                :meth:`at`. Or a mapping from every joint's name to its P values, or to one value for all poses. A
                square array is ambiguous: it is read as columns, with a warning, unless its rows are outside the
                joints' limits and its columns are not.

        Raises:
            InputError: Another shape, a missing joint, or a value that is not finite; a prismatic joint beyond 1000 km.
            UnknownNameError: No such joint on the chain.
        """
        values = self.configurations.many(q)
        add(self.configurations.doubts(q))
        return self.at_columns(values)

    def at_columns(self, values: Array) -> Postures:
        """Return the chain at checked values ``(n, P)``, as from :attr:`configurations`."""
        return Postures(values, self._constants)

    def postures_at(self, values: Array) -> tuple[Posture, list[Posture]]:
        """Return the chain at checked values ``(n, P)`` as a posture of P configurations, and as P postures of one."""
        many = self.at_columns(values)
        poses = np.ascontiguousarray(np.moveaxis(many.joint_poses, -1, 0))
        each = [Posture(self, many.q[:, k].copy(), poses[k], self.loads) for k in range(len(many))]
        return Posture(self, many.q, many.joint_poses, self.loads), each

    def with_payload(self, mass: float | str, centre: ArrayLike = (0.0, 0.0, 0.0), at: str | None = None) -> Chain:
        """Return the chain with a payload.

        Args:
            mass: kg, or text such as ``"500 g"``.
            centre: Its centre of mass in the frame of the link that carries it, m, or text such as ``"0 0 50 mm"``.
            at: The URDF link that carries it; by default the tip.

        Raises:
            InputError: The mass is negative, or a number is missing or not finite.
            UnknownNameError: The robot has no such link.
        """
        frame = self.link_frame(self.tip if at is None else at)
        needs = "three finite numbers, in m or with a unit"
        lever = arguments.check_quantities("the centre of a payload", centre, LENGTH, (3,), needs)
        mass = arguments.check_quantity(
            "the mass of a payload", mass, MASS, "zero or more and finite", lambda kg: kg >= 0
        )
        moments = ((mass * np.array([1.0, *lever]), ()),)
        load = Load(frame.link, frame.frame, frame.entry(lever), along=False, moments=moments)
        model = self.pinocchio.with_mass(frame.link - 1, frame.frame, mass, lever)
        return replace(self, loads=(*self.loads, load), pinocchio=model)

    def __repr__(self) -> str:
        joints = ", ".join(map(repr, self.joint_names[:8])) + (", …" if len(self.joints) > 8 else "")
        file = os.path.basename(self.robot.file)
        return f"<Chain of {file!r}, {self.base!r} to {self.tip_label!r}: joints {joints}>"

    def _repr_html_(self) -> str:
        """Return the notebook view: the joints with their limits, and the pose of each in the previous joint."""
        locked = ", ".join(f"{name} {value:.6g}" for name, value in self.locked.items())
        return rendered(
            f"{os.path.basename(self.robot.file)}: {self.base} to {self.tip_label}, {len(self.joints)} joints",
            [joint_table(self.joints, self.placements, self.tip)],
            [
                "x y z, roll pitch yaw: pose of a joint's frame in the one before it, for joint values of zero",
                f"gravity {spaced(self.gravity)} m/s², base axes",
                *([f"locked (rad, m): {locked}"] if locked else []),
            ],
        )

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, base to tip."""
        return tuple(joint.name for joint in self.joints)

    @property
    def tip_label(self) -> str:
        """Name of the tip, with the target if there is one."""
        shift = f" + {' '.join(f'{value:.6g}' for value in self.target * 1e3)} mm"
        return self.tip + (shift if self.target.any() else "")

    @cached_property
    @returns_read_only
    def target_placement(self) -> Array:
        """From the last joint's frame after its motion to the target, with the tip's axes, ``(4, 4)``."""
        placement: Array = self.placements[-1].copy()
        if self.target.any():
            # einsum, as the rounding of a matrix product depends on the machine
            placement[:3, 3] += np.einsum("ij,j->i", placement[:3, :3], self.target)
        return placement

    @cached_property
    @returns_read_only
    def axes(self) -> Array:
        """Unit axis of each joint in its own frame, ``(n, 3)``."""
        return np.array([joint.axis for joint in self.joints])

    @cached_property
    @returns_read_only
    def prismatic(self) -> NDArray[np.bool_]:
        """True for each prismatic joint, ``(n,)``."""
        return np.array([joint.kind == "prismatic" for joint in self.joints])

    @cached_property
    @returns_read_only
    def reversed_joints(self) -> NDArray[np.bool_]:
        """True for each joint that the chain passes against the file, because the base is beyond it, ``(n,)``."""
        return np.array([joint.reversed for joint in self.joints])

    @cached_property
    @returns_read_only
    def written_axes(self) -> Array:
        """Unit axis of each joint in its own frame as in the file, ``(n, 3)``; opposite to :attr:`axes` if reversed."""
        return np.array([joint.written_axis for joint in self.joints])

    def with_target(self, point: ArrayLike) -> Chain:
        """Return the chain with another point that results are about, in the tip's axes, m; places and loads stay.

        Raises:
            InputError: Not three finite numbers, or farther than 1000 m from the tip.
        """
        target = arguments.check_numbers("the target", point, (3,), "three finite numbers, m in the tip's axes")
        if not np.abs(target).max() <= FARTHEST_TARGET:
            raise InputError(f"the target must lie within {FARTHEST_TARGET:,.0f} m of the tip along every axis")
        return replace(self, target=target)

    def runs_backwards(self, link: int) -> bool:
        """Return whether a chain link's far end is its own joint in the file, nearer the file's root."""
        if self._link(link) < len(self.joints):
            return bool(self.reversed_joints[link])
        return self.robot.path(self.base, self.tip)[-1].reversed

    def joint_index(self, name: str) -> int:
        """Return a joint's position, 0-based; raise `UnknownNameError` if the chain has no such joint."""
        return self.joint_names.index(arguments.check_name("joint on the chain", name, self.joint_names))

    def link_frame(self, name: str) -> LinkFrame:
        """Return the position of a URDF link on the chain; raise `UnknownNameError` if the robot has no such link."""
        return self.link_frames[arguments.check_name("link", name, self.link_frames)]

    def end(self, link: int) -> Place:
        """Return the place at the far end of chain link 0…n: joint i+1's origin frame before its motion, or the tip."""
        return self._places[self._link(link)][0]

    def seat(self, link: int) -> Place:
        """Return the place of the next joint's seat, after the link's end and in the same frame."""
        return self._places[self._link(link)][1]

    def frame_place(self, name: str) -> Place:
        """Return the place at a URDF link's frame on the path from base to tip; the tip's is the last link's end.

        Raises `InputError` for a link on a branch: moving it does not move the tip.
        """
        frame = self.link_frame(name)
        if frame.path_rank is None:
            path = f"the path from {self.base!r} to {self.tip!r}"
            raise InputError(f"{name!r} is not on {path}: moving it does not move the tip")
        if name == self.tip:
            return self.end(frame.link)
        return Place.along(frame.link, frame.path_rank, name, frame.frame)

    def axis_alignment(self, joint: int) -> Array:
        """Return the smallest rotation of a joint's z onto its axis in the file; for -z half a turn about x."""
        return self._written_alignments[self.joint_number(joint)]

    def joint_number(self, joint: int) -> int:
        """Return a joint's position, 0-based, after a check that it exists."""
        return arguments.check_whole("the number of a joint on the chain", joint, 0, len(self.joints) - 1)

    def _link(self, link: int) -> int:
        return arguments.check_whole("the number of a link of the chain", link, 0, len(self.joints))

    @cached_property
    def _places(self) -> tuple[tuple[Place, Place], ...]:
        far_ends = enumerate(zip((*self.joint_names, self.tip), self.placements, strict=True))
        return tuple(Place.far_end(link, name, frame) for link, (name, frame) in far_ends)

    @cached_property
    def _written_alignments(self) -> tuple[Array, ...]:
        return tuple(read_only(alignment(axis)) for axis in self.written_axes)

    @cached_property
    def _constants(self) -> ChainConstants:
        # only the tip, here the target, depends on the last link's placement
        placements = np.concatenate([self.placements[:-1], self.target_placement[None]])
        aligned = np.array([*(alignment(axis) for axis in self.axes), np.eye(3)])
        before = np.concatenate([np.eye(3)[None], aligned[:-1]]).swapaxes(1, 2)
        carried = np.zeros((len(placements), 4))
        for load in self.loads:
            for moments, _ in load.moments:  # without factors
                rotated = load.frame[:3, :3] @ moments[1:] + moments[0] * load.frame[:3, 3]
                carried[load.link] += [moments[0], *rotated]
        return ChainConstants(
            axes=self.axes,
            slides=np.array(self.prismatic),
            slanted=(aligned[:-1] != np.eye(3)).any(axis=(1, 2)),
            aligned=aligned,
            turns=before @ placements[:, :3, :3] @ aligned,
            arms=(before @ placements[:, :3, 3, None])[:, :, 0].copy(),
            masses=carried[1:, 0].copy(),
            moments=(before[1:] @ carried[1:, 1:, None])[:, :, 0].copy(),
            gravity=np.array(self.gravity),
        )


@dataclass(frozen=True, eq=False)
class Posture:
    """A chain at one configuration, undisplaced; or at P of them, with poses as the last dimension of every array.

    Sources that accept many postures (:meth:`precision_pin.terms.source.Source.accepts_many`) read either.

    Attributes:
        chain: The chain.
        q: Joint values in chain order, ``(n[, P])``.
        joint_poses: Each joint's frame after its motion, in the base, ``(n, 4, 4[, P])``, by Pinocchio, or for many
            postures by compiled loops.
        loads: The loads on the chain: its own weights, and those of sources.
        deflection: The chain under load; ``None`` if the loads act on the undisplaced arm. It moves the loads, not the
            places.
        tilts: Contributions of sources to gravity: vectors ``(3,)``, base axes, m/s², with the parameters that multiply
            them.
        approach: Direction in which each joint moved last: 1, -1, or 0 if unknown, ``([P])`` each; empty without an
            approach.
        deciding: The posture whose loads decide the side of a play, if not this one.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> posture = chain.at([0, 0, 0, 0])
        >>> print(posture.pose[:3, 3])
        [ 3.74  -0.274  0.085]
    """

    chain: Chain
    q: Array
    joint_poses: Array
    loads: tuple[Load, ...]
    deflection: Deflection | None = None
    tilts: tuple[tuple[Array, Factors], ...] = ()
    approach: tuple[Any, ...] = ()
    deciding: Posture | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("q", "joint_poses"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @cached_property
    @returns_read_only
    def link_poses(self) -> Array:
        """Axes of every chain link in the base, ``(n+1, 4, 4[, P])``."""
        base = np.eye(4).reshape(1, 4, 4, *[1] * (self.q.ndim - 1))
        return np.concatenate([np.broadcast_to(base, (1, *self.joint_poses.shape[1:])), self.joint_poses])

    @cached_property
    @returns_read_only
    def loaded_link_poses(self) -> Array:
        """Axes of every chain link in the base, where loads act on it, ``(n+1, 4, 4)``."""
        return self.link_poses if self.deflection is None else self.deflection.links

    @cached_property
    @returns_read_only
    def loaded_ends(self) -> Array:
        """Far end of every chain link in the base, where loads act on it, ``(n+1, 4, 4)``."""
        if self.deflection is not None:
            return self.deflection.ends
        if self.q.ndim == 1:
            return self.link_poses @ self.chain.placements
        return np.einsum("kijp,kjl->kilp", self.link_poses, self.chain.placements)

    @cached_property
    @returns_read_only
    def pose(self) -> Array:
        """Tip, or target if there is one, in the base, ``(4, 4)``."""
        return se3.compose(self.link_poses[-1], self.chain.target_placement)

    @property
    def tool_axes(self) -> Array:
        """Axes of the tip, or target, as columns in the base, ``(3, 3)``."""
        return self.pose[:3, :3]

    @cached_property
    @returns_read_only
    def joint_axes(self) -> Array:
        """Unit axis of every joint in base axes, ``(n, 3[, P])``."""
        return np.einsum("nij...,nj->ni...", self.joint_poses[:, :3, :3], self.chain.axes)

    @cached_property
    @returns_read_only
    def joint_jacobian(self) -> Array:
        """Derivative of the tip's pose by the joint values, base axes at the tip, ``(6, n)``."""
        arms = self.pose[:3, 3] - self.joint_poses[:, :3, 3]
        slide = self.chain.prismatic[:, None]
        linear = np.where(slide, self.joint_axes, np.cross(self.joint_axes, arms))
        return np.concatenate([linear, np.where(slide, 0.0, self.joint_axes)], axis=1).T

    @cached_property
    def load_torque(self) -> Array:
        """Torque (N·m) or force (N) of the weight of robot and chain payload on the joints, ``(n,)``.

        By Pinocchio, minus its generalised gravity (eq 23's τ). Payloads of sources are not included.
        """
        return self._statics[0]

    @cached_property
    @returns_read_only
    def link_wrench(self) -> Array:
        """Force and moment ``(n+1, 6)`` of everything beyond it on each chain link's far end, by Pinocchio.

        At and in the axes of the link's end; zero for the last link, whose own loads count on the link.
        """
        wrenches = np.zeros((len(self.chain.joints) + 1, 6))
        for i, wrench in enumerate(self._statics[1]):
            end = self.link_poses[i] @ self.chain.placements[i]
            rotation = end[:3, :3].T @ self.joint_poses[i][:3, :3]
            shift = end[:3, :3].T @ (self.joint_poses[i][:3, 3] - end[:3, 3])
            force = rotation @ wrench[:3]
            wrenches[i] = np.concatenate([force, rotation @ wrench[3:] + np.cross(shift, force)])
        return wrenches

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Warnings: joint values outside their limits, and locked mimic joints that should follow."""
        findings = []
        values = dict(zip(self.chain.joint_names, self.q, strict=True)) | dict(self.chain.locked)
        file = self.chain.robot.file
        for joint in self.chain.robot.joints:
            mimic = joint.mimic
            if mimic is None or mimic.joint not in self.chain.joint_names:
                continue
            due = mimic.multiplier * values[mimic.joint] + mimic.offset
            if abs(due - values[joint.name]) > 1e-9:
                scale, unit = (1e3, "mm") if joint.kind == "prismatic" else (180 / np.pi, "deg")
                message = (
                    f"joint {joint.name} mimics {mimic.joint}, so it would be at {scale * due:.6g} {unit} here, but it is locked "
                    f"at {scale * values[joint.name]:.6g} {unit}, with the weight beyond it; lock it at another value if that "
                    "matters"
                )
                findings.append(Finding("warning", "W_MIMIC", message, file, joint.line))
        limited, limited_q = self.chain.limited(self.q[:, None])
        for k in np.flatnonzero(limited.outside(limited_q)):
            joint = limited.joints[k]
            assert joint.limit is not None
            scale, unit = (1.0, "m") if joint.kind == "prismatic" else (180 / np.pi, "deg")
            actual, low, high = (f"{scale * x:.6g}" for x in (limited_q[k, 0], joint.limit.lower, joint.limit.upper))
            message = f"joint {joint.name} at {actual} {unit} is outside its limits {low} to {high} {unit}"
            message += limited.wrap_hint(int(k), limited_q)
            findings.append(Finding("warning", "W_JOINT_LIMIT", message, file, joint.line))
        return (*findings, *_collision_findings(self.chain, self.q[:, None], ()))

    def __repr__(self) -> str:
        chain, file = self.chain, os.path.basename(self.chain.robot.file)
        return f"<Posture of {file!r}, {chain.base!r} to {chain.tip_label!r}, at {spaced(self.q)}>"

    def direction_of(self, joint: int) -> Any:
        """Return the direction ``([P])`` in which a joint (0-based) moved last: 1, -1, or 0 if unknown."""
        return (self.approach or (0,) * len(self.chain.joints))[self.chain.joint_number(joint)]

    def with_loads(self, loads: Sequence[Load]) -> Posture:
        """Return the posture with further loads."""
        return replace(self, loads=(*self.loads, *loads)) if loads else self

    def with_tilts(self, tilts: Sequence[tuple[Array, Factors]]) -> Posture:
        """Return the posture with further contributions to gravity."""
        return replace(self, tilts=(*self.tilts, *tilts)) if tilts else self

    def place_pose(self, place: Place) -> Array:
        """Return a place's pose in the base, ``(4, 4[, P])``."""
        return se3.compose(self.link_poses[place.link], place.frame)

    def carrier(self, load: Load) -> Array:
        """Return the axes of a load's chain link in the base, ``(4, 4[, P])``, moved as the bent link is at the load."""
        if self.deflection is None:
            return self.link_poses[load.link]
        return self.deflection.carrier(load, self.chain.placements[load.link])

    def wrench_basis(self, load: Load, point: ArrayLike) -> Array:
        """Return force and moment about a point ``(3,)`` per unit of mass and first moments, ``(6, 4)``, base axes."""
        return wrench_basis(self.carrier(load) @ load.frame, self.chain.gravity, point)

    def wrench_on(self, loads: Sequence[Load], point: ArrayLike) -> dict[Factors, Array]:
        """Return the wrench ``(6[, P])`` of loads about a point, base axes, by the parameters that multiply it."""
        cached = self._weights
        weights = [cached.get(load) or weigh([load], self.carrier)[load] for load in loads]
        return wrench_on(weights, self.chain.gravity, self.tilts, point)

    def torque_on(self, joint: int) -> dict[Factors, Any]:
        """Return the loads' torque or force on a joint (0-based), N·m or N, number or ``(P,)``, by the parameters."""
        joint = self.chain.joint_number(joint)
        if joint not in self._torques:
            outer_loads = [load for load in self.loads if load.link > joint]
            frame = self.loaded_link_poses[joint + 1]
            wrenches = self.wrench_on(outer_loads, frame[:3, 3])
            axis = se3.turn(frame[:3, :3], self.chain.axes[joint])
            self._torques[joint] = torque_on(axis, bool(self.chain.prismatic[joint]), wrenches)
        return dict(self._torques[joint])

    @cached_property
    def _torques(self) -> dict[int, dict[Factors, Any]]:
        """Torques on joints so far: the sources of a joint ask for the same."""
        return {}

    @cached_property
    def _weights(self) -> dict[Load, Weight]:
        return weigh(self.loads, self.carrier)

    @cached_property
    @returns_read_only
    def _statics(self) -> tuple[Array, Array]:
        return self.chain.pinocchio.statics(self.q)


def _read(source: object) -> Robot:
    """Return a robot from a path, a name in another package, the text of a URDF, or a yourdfpy.URDF."""
    if (write := getattr(source, "write_xml_string", None)) is not None:
        return parse(write(), "yourdfpy.URDF")
    if isinstance(source, str | bytes) and source.lstrip()[:1] in ("<", b"<"):
        return parse(source.encode() if isinstance(source, str) else source, "the URDF's text")
    path = arguments.check_path("the path of the URDF", source)
    return read(resolve_robot(path) if path.startswith(ELSEWHERE) else path)


class HasChain(Protocol):
    """An object with a chain, such as an error model."""

    @property
    def chain(self) -> Chain:
        """The chain."""


def chain_of(arm: Chain | HasChain) -> Chain:
    """Return a chain, or that of a model."""
    recipe = "as Chain.from_urdf returns it, or an error model"
    return arguments.check_instance("chain", getattr(arm, "chain", arm), Chain, recipe)


def joint_table(joints: Sequence[Joint], placements: Array, tip: str) -> Table:
    """Return the table of n joints and the tip: limits, and placements ``(n+1, 4, 4)`` in the previous joint."""
    rows: list[tuple[str, ...]] = [
        (joint.name, joint.kind, spaced(np.array(joint.axis)), _limits(joint), *_placement(placement))
        for joint, placement in zip(joints, placements[:-1], strict=True)
    ]
    rows.append((tip, "tip", "", "", *_placement(placements[-1])))
    return Table(("joint", "kind", "axis", "limits", "x y z [mm]", "roll pitch yaw [°]"), rows, words=2)


def _limits(joint: Joint) -> str:
    if joint.limit is None or not np.isfinite((joint.limit.lower, joint.limit.upper)).any():
        return "none"
    factor, unit = (1e3, "mm") if joint.kind == "prismatic" else (math.degrees(1), "°")
    return f"{factor * joint.limit.lower:.6g} to {factor * joint.limit.upper:.6g} {unit}"


def _placement(pose: Array) -> tuple[str, str]:
    """Return a pose's position in mm, and roll, pitch and yaw in degrees; roll is zero at a pitch of ±90°."""
    rotation = pose[:3, :3]
    level = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], level)
    if level > 1e-9:
        roll, yaw = math.atan2(rotation[2, 1], rotation[2, 2]), math.atan2(rotation[1, 0], rotation[0, 0])
    else:
        roll, yaw = 0.0, math.atan2(-rotation[0, 1], rotation[1, 1])
    return spaced(1e3 * pose[:3, 3]), spaced(np.degrees((roll, pitch, yaw)))


def spaced(values: Array) -> str:
    """Return numbers separated by spaces, with six digits."""
    return " ".join(f"{round(value, 6) + 0.0:.6g}" for value in values.tolist())


def chain_findings(chain: Chain) -> tuple[Finding, ...]:
    """Return the warnings about a chain's URDF, those about links and joints off the chain in one line."""
    # the warning about several leaves is dropped, since the chain's tip is known
    findings = [finding for finding in chain.robot.findings if finding.code != "W_BRANCHED"]
    joint_path = chain.robot.path(chain.base, chain.tip)
    on_path = _subjects([chain.base, *(joint.child for joint in joint_path)], joint_path)
    # links that a joint of the chain moves
    moved_links = {name for name, frame in chain.link_frames.items() if frame.link > 0}
    loads = _subjects(moved_links, [joint for joint in chain.robot.joints if joint.child in moved_links])

    def concerns_chain(finding: Finding) -> bool:
        # a warning that is about anything else too concerns the chain
        matches = [_ABOUT_ONE.match(text) for text in finding.subjects or (finding.message,)]
        subjects = {f"{match[1]} {match[2]}" for match in matches if match is not None} if all(matches) else set()
        return not subjects or bool(subjects & (on_path | loads if finding.code in _OF_A_LOAD else on_path))

    other_findings = [finding for finding in findings if not concerns_chain(finding)]
    if len(other_findings) < 2:
        return tuple(findings)
    file = chain.robot.file
    counts = Counter(finding.code for finding in other_findings)
    codes = ", ".join(code if count == 1 else f"{count} {code}" for code, count in sorted(counts.items()))
    count_text = f"{len(other_findings)} warnings about links and joints off the chain ({codes})"
    message = f"{count_text}; precision-pin check {shlex.quote(file)} lists them"
    return (*filter(concerns_chain, findings), Finding("warning", "W_OFF_CHAIN", message, file))


def _subjects(links: Iterable[str], joints: Iterable[Joint]) -> set[str]:
    return {f"link {shown(name)}" for name in links} | {f"joint {shown(joint.name)}" for joint in joints}


def pose_findings(chain: Chain, values: Array, names: Sequence[str] = ()) -> tuple[Finding, ...]:
    """Return warnings if poses ``(n, P)`` are outside the joints' limits, or if the arm hits something there."""
    findings = _collision_findings(chain, values, names)
    limited, values = chain.limited(values)
    is_outside = limited.outside(values)
    poses = np.flatnonzero(is_outside.any(axis=0))
    if not poses.size:
        return findings
    first = int(poses[0])
    name = (names[first] if names else "") or f"pose {first + 1}"
    k = int(np.flatnonzero(is_outside[:, first])[0])
    joint, hint = limited.joints[k], limited.wrap_hint(k, values[:, [first]])
    message = (
        f"{poses.size:,} of {values.shape[1]:,} poses are outside joint limits, the first of them {name}, with the joint "
        f"{joint.name} at {values[k, first]:.6g} {'m' if joint.kind == 'prismatic' else 'rad'}{hint}"
    )
    return (Finding("warning", "W_JOINT_LIMIT", message, chain.robot.file, joint.line), *findings)


def _collision_findings(chain: Chain, values: Array, names: Sequence[str]) -> tuple[Finding, ...]:
    """Return a warning if the arm hits itself or an obstacle: at how many poses, and what at the first."""
    if chain.collision_check is None:
        return ()
    # only some of many poses: a check takes longer than a first-order analysis
    checked = np.arange(0, values.shape[1], 1 + values.shape[1] // _LOOKED)
    hit = checked[~chain.collision_check.free(np.ascontiguousarray(values[:, checked]))]
    if not hit.size:
        return ()
    first = int(hit[0])
    reason = chain.collision_check.reasons(np.ascontiguousarray(values[:, [first]]))[0]
    name = (names[first] if names else "") or f"pose {first + 1}"
    pose_text = f"{values.shape[1]:,} poses" if checked.size == values.shape[1] else f"{checked.size:,} poses looked at"
    place = "here" if values.shape[1] == 1 else f"at {hit.size:,} of {pose_text}, the first of them {name},"
    return (Finding("warning", "W_COLLISION", f"{place} {reason}", chain.robot.file),)
