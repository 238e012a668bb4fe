"""A base-to-tip chain of a URDF tree, and the chain at one configuration.

*Chain link* i = 0…n is the rigid part between joint i and joint i+1 (1-based joints; 0 is the base side, n carries
the tip). Its axes are those of joint i's URDF frame after its motion, for link 0 those of the base link. Arrays over
joints are 0-based: ``axes[0]`` belongs to joint 1.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import (
    check_instance,
    check_mapping,
    check_number,
    check_path,
)
from precision_pin.base.array_checks import read_only, returns_read_only
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import add, warns_at_end
from precision_pin.base.errors import Finding
from precision_pin.base.quantity_arguments import check_quantities, check_quantity
from precision_pin.base.units import ACCELERATION, LENGTH, MASS
from precision_pin.render.notebook import rendered
from precision_pin.robot import statics
from precision_pin.robot.approach import Approach
from precision_pin.robot.chain_geometry import ChainGeometry, cut_chain
from precision_pin.robot.configurations import Configurations
from precision_pin.robot.joint_table import joint_table, spaced
from precision_pin.robot.loads import Deflection, Factors, Load, own_loads
from precision_pin.robot.pinocchio_model import PinocchioModel
from precision_pin.robot.places import (
    Place,
)
from precision_pin.robot.postures import ChainConstants, Postures
from precision_pin.robot.urdf import Robot, read

EARTH: Final = (0.0, 0.0, -9.81)
"""Default gravity, base axes, m/s²."""

_NAMED: Final = 8


@final
@dataclass(frozen=True, eq=False)
class Chain(ChainGeometry):
    """The moving joints and rigid links between a base and a tip.

    Attributes
    ----------
    robot, base, tip, joints, locked, placements, link_frames, target
        As in :class:`precision_pin.robot.chain_geometry.ChainGeometry`.
    gravity
        Gravity in base axes, m/s², ``(3,)``.
    loads
        The weights of the URDF's links, and payloads.
    """

    gravity: Array
    loads: tuple[Load, ...]
    pinocchio: PinocchioModel = field(repr=False)

    @classmethod
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        tip: str | None = None,
        base: str | None = None,
        gravity: Sequence[float] = EARTH,
        locked: Mapping[str, float] | None = None,
    ) -> Chain:
        """Read a URDF strictly and extract the chain from it.

        Parameters
        ----------
        path
            The URDF.
        tip
            The end-effector link; the only leaf if left out.
        base
            The fixed link; the root if left out. Any link may be the base.
        gravity
            Gravity in the base link's axes, m/s².
        locked
            Values (rad or m) at which joints are locked; other joints off the chain are locked at zero, or at the limit
            nearest to it. A mimic joint follows a joint off the chain; if it mimics a joint on the chain, it is locked at
            the value for that joint's zero. A joint on the chain may be locked too.

        Raises
        ------
        UrdfError
            The file cannot be used; carries every finding.
        UnknownNameError
            No such link or joint.
        InputError
            Several leaves and no tip, no moving joint on the chain, or a mimic joint on it.
        """
        return cls.from_robot(read(check_path("the path of the URDF", path)), tip, base, gravity, locked)

    @classmethod
    def from_robot(
        cls,
        robot: Robot,
        tip: str | None = None,
        base: str | None = None,
        gravity: Sequence[float] = EARTH,
        locked: Mapping[str, float] | None = None,
    ) -> Chain:
        """Extract the chain from a robot that has been read; see :meth:`from_urdf`."""
        check_instance("robot", robot, Robot, "as urdf.read returns it")
        down = check_quantities("gravity", gravity, ACCELERATION, (3,), "three finite numbers, in base axes")
        if locked is not None:
            locked = {
                name: check_number(f"the value at which {name!r} is locked", value)
                for name, value in check_mapping("locked joints", locked).items()
            }
        cut = cut_chain(robot, tip, base, locked)
        return cls(
            robot=cut.robot,
            base=cut.base,
            tip=cut.tip,
            joints=cut.joints,
            locked=cut.locked,
            placements=cut.placements,
            link_frames=cut.link_frames,
            target=cut.target,
            gravity=down,
            loads=own_loads(cut.robot, cut.link_frames),
            pinocchio=PinocchioModel.load(cut.robot, cut.joint_names, cut.locked, tuple(down)),
        )

    @cached_property
    def configurations(self) -> Configurations:
        """Reader of joint values of the chain."""
        return Configurations(self.joints)

    def configuration(self, q: ArrayLike | Mapping[str, float]) -> Array:
        """Return joint values ``(n,)`` in chain order, given in that order or by name.

        Raises
        ------
        InputError
            Wrong count, missing joint, or a value that is no finite number; a prismatic joint beyond 1000 km.
        UnknownNameError
            No such joint on the chain.
        """
        return self.configurations.one(q)

    def at(self, q: ArrayLike | Mapping[str, float]) -> Posture:
        """Return the chain at a configuration (rad and m, in chain order or by joint name)."""
        values = self.configuration(q)
        return Posture(self, values, self.pinocchio.joint_poses(values), self.loads)

    @warns_at_end
    def at_many(self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Postures:
        """Return the chain at P configurations at once.

        Parameters
        ----------
        q
            An array ``(n, P)``, rad and m, in chain order: poses are columns. Or a list of P poses, each as for :meth:`at`.
            Or a mapping from every joint's name to its P values, or to one value for all poses. A square array is ambiguous:
            it is read as columns, with a warning, unless its rows are outside the joints' limits and its columns are not.

        Raises
        ------
        InputError
            Another shape, a missing joint, or a value that is no finite number; a prismatic joint beyond 1000 km.
        UnknownNameError
            No such joint on the chain.
        """
        values = self.configurations.many(q)
        add(self.configurations.doubts(q))
        return self.at_columns(values)

    def at_columns(self, values: Array) -> Postures:
        """Return the chain at values ``(n, P)`` that :attr:`configurations` read, or some of their columns."""
        return Postures(values, self._constants)

    def with_payload(self, mass: float | str, centre: ArrayLike = (0.0, 0.0, 0.0), at: str | None = None) -> Chain:
        """Return the chain with a payload.

        Parameters
        ----------
        mass
            kg, or text such as ``"500 g"``.
        centre
            Its centre of mass in the frame of the link that carries it, m, or text such as ``"0 0 50 mm"``.
        at
            The URDF link that carries it; the tip if left out.

        Raises
        ------
        InputError
            The mass is negative, or a number is missing or not finite.
        UnknownNameError
            The robot has no such link.
        """
        where = self.link_frame(self.tip if at is None else at)
        lever = check_quantities(
            "the centre of a payload", centre, LENGTH, (3,), "three finite numbers, in m or with a unit"
        )
        mass = check_quantity("the mass of a payload", mass, MASS, "zero or more and finite", lambda kg: kg >= 0)
        moments = ((mass * np.array([1.0, *lever]), ()),)
        load = Load(where.link, where.frame, where.entry(lever), along=False, moments=moments)
        model = self.pinocchio.with_mass(where.link - 1, where.frame, mass, lever)
        return replace(self, loads=(*self.loads, load), pinocchio=model)

    def __repr__(self) -> str:
        joints = ", ".join(map(repr, self.joint_names[:_NAMED])) + (", …" if len(self.joints) > _NAMED else "")
        file = os.path.basename(self.robot.file)
        return f"<Chain of {file!r}, {self.base!r} to {self.tip_label!r}: joints {joints}>"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the joints with their limits, and the pose of each in the one before."""
        still = ", ".join(f"{name} {value:.6g}" for name, value in self.locked.items())
        return rendered(
            f"{os.path.basename(self.robot.file)}: {self.base} to {self.tip_label}, {len(self.joints)} joints",
            [joint_table(self.joints, self.placements, self.tip)],
            [
                "x y z, roll pitch yaw: pose of a joint's frame in the one before it, for joint values of zero",
                f"gravity {spaced(self.gravity)} m/s², base axes",
                *([f"locked (rad, m): {still}"] if still else []),
            ],
        )

    @cached_property
    def _constants(self) -> ChainConstants:
        # of the last link's placement only the tip depends, which is the target there
        placements = np.concatenate([self.placements[:-1], self.target_placement[None]])
        return ChainConstants.of(placements, self.axes, self.prismatic, self._alignments, self.gravity, self.loads)


@final
@dataclass(frozen=True, eq=False)
class Posture:
    """A chain at one configuration, undisplaced; or at P of them, with the dimension of the poses last in every array.

    Sources that accept many postures (:meth:`precision_pin.terms.source.Source.accepts_many`) read either.

    Attributes
    ----------
    chain
        The chain.
    q
        Joint values in chain order, ``(n[, P])``.
    joint_poses
        Each joint's frame after its motion, in the base, ``(n, 4, 4[, P])``, by Pinocchio, or by compiled loops if the
        posture is one of many.
    loads
        The weights on the chain: its own, and those of sources.
    deflection
        The chain under load; ``None`` if the loads act on the undisplaced arm. It moves the loads, not the places.
    tilts
        Contributions of sources to gravity: vectors ``(3,)``, base axes, m/s², with the parameters that multiply them.
    approach
        Direction in which each joint moved last: 1, -1, or 0 where it is not known; empty if no approach is given.
    deciding
        The posture whose loads decide on which side a play is taken up, if that is not this one.
    """

    chain: Chain
    q: Array
    joint_poses: Array
    loads: tuple[Load, ...]
    deflection: Deflection | None = None
    tilts: tuple[tuple[Array, Factors], ...] = ()
    approach: Approach = ()
    deciding: Posture | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("q", "joint_poses"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @cached_property
    @returns_read_only
    def link_poses(self) -> Array:
        """Axes of every chain link in the base, ``(n+1, 4, 4[, P])``."""
        base = (
            np.eye(4)[None]
            if self.q.ndim == 1
            else np.broadcast_to(np.eye(4)[None, :, :, None], (1, 4, 4, self.q.shape[1]))
        )
        return np.concatenate([base, self.joint_poses])

    @cached_property
    @returns_read_only
    def loaded_link_poses(self) -> Array:
        """Axes of every chain link in the base where loads act on it, ``(n+1, 4, 4)``."""
        return self.link_poses if self.deflection is None else self.deflection.links

    @cached_property
    @returns_read_only
    def loaded_ends(self) -> Array:
        """Far end of every chain link in the base where loads act on it, ``(n+1, 4, 4)``."""
        if self.deflection is not None:
            return self.deflection.ends
        if self.q.ndim == 1:
            return self.link_poses @ self.chain.placements
        ends: Array = np.einsum("kijp,kjl->kilp", self.link_poses, self.chain.placements)
        return ends

    @cached_property
    @returns_read_only
    def pose(self) -> Array:
        """Tip in the base, ``(4, 4)``; the target where one is given."""
        return se3.compose(self.link_poses[-1], self.chain.target_placement)

    @cached_property
    @returns_read_only
    def joint_axes(self) -> Array:
        """Unit axis of every joint in base axes, ``(n, 3[, P])``."""
        axes: Array = np.einsum("nij...,nj->ni...", self.joint_poses[:, :3, :3], self.chain.axes)
        return axes

    @cached_property
    @returns_read_only
    def joint_jacobian(self) -> Array:
        """Derivative of the tip's pose with respect to the joint values, base axes at the tip, ``(6, n)``."""
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
            turn = end[:3, :3].T @ self.joint_poses[i][:3, :3]
            shift = end[:3, :3].T @ (self.joint_poses[i][:3, 3] - end[:3, 3])
            force = turn @ wrench[:3]
            wrenches[i] = np.concatenate([force, turn @ wrench[3:] + np.cross(shift, force)])
        return wrenches

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Warnings: joint values outside their limits, and mimic joints that are locked but should follow."""
        found = []
        values = dict(zip(self.chain.joint_names, self.q, strict=True)) | dict(self.chain.locked)
        for joint in self.chain.robot.joints:
            mimic = joint.mimic
            if mimic is None or mimic.joint not in self.chain.joint_names:
                continue
            due = mimic.multiplier * values[mimic.joint] + mimic.offset
            if abs(due - values[joint.name]) > 1e-9:
                message = (
                    f"joint {joint.name} mimics {mimic.joint}, so it would be at {due:.6g} here, but it is locked at "
                    f"{values[joint.name]:.6g}, with the weight beyond it; lock it at another value if that matters"
                )
                found.append(Finding("warning", "W_MIMIC", message, self.chain.robot.file, joint.line))
        outside = self.chain.configurations.outside(self.q[:, None])[:, 0]
        for joint, value, is_outside in zip(self.chain.joints, self.q, outside, strict=True):
            limit = joint.limit
            if limit is not None and is_outside:
                scale, unit = (1.0, "m") if joint.kind == "prismatic" else (180 / np.pi, "deg")
                actual, low, high = (f"{scale * x:.6g}" for x in (value, limit.lower, limit.upper))
                message = f"joint {joint.name} at {actual} {unit} is outside its limits {low} to {high} {unit}"
                found.append(Finding("warning", "W_JOINT_LIMIT", message, self.chain.robot.file, joint.line))
        return tuple(found)

    def __repr__(self) -> str:
        chain, values = self.chain, spaced(self.q)
        return (
            f"<Posture of {os.path.basename(chain.robot.file)!r}, {chain.base!r} to {chain.tip_label!r}, at {values}>"
        )

    def direction_of(self, joint: int) -> int:
        """Return the direction in which a joint (0-based) moved last: 1, -1, or 0 where it is not known."""
        return (self.approach or (0,) * len(self.chain.joints))[self.chain.joint_number(joint)]

    def with_loads(self, loads: Sequence[Load]) -> Posture:
        """Return the posture with further weights."""
        return replace(self, loads=(*self.loads, *loads)) if loads else self

    def with_tilts(self, tilts: Sequence[tuple[Array, Factors]]) -> Posture:
        """Return the posture with further parts of gravity."""
        return replace(self, tilts=(*self.tilts, *tilts)) if tilts else self

    def place_pose(self, place: Place) -> Array:
        """Return a place's pose in the base, ``(4, 4[, P])``."""
        return se3.compose(self.link_poses[place.link], place.frame)

    def wrench_basis(self, load: Load, point: ArrayLike) -> Array:
        """Return force and moment about a point per unit of a load's mass and first moments.

        Parameters
        ----------
        load
            The weight.
        point
            ``(3,)``, base axes, m.

        Returns
        -------
        NDArray
            ``(6, 4)``; see :func:`precision_pin.robot.statics.wrench_basis`.
        """
        return statics.wrench_basis(self.loaded_link_poses[load.link] @ load.frame, self.chain.gravity, point)

    def wrench_on(self, loads: Sequence[Load], point: ArrayLike) -> dict[Factors, Array]:
        """Return the wrench ``(6[, P])`` of loads about a point, base axes, by the parameters that multiply it."""
        known, poses = self._weights, self.loaded_link_poses
        weights = [known.get(load) or statics.weigh([load], poses)[load] for load in loads]
        return statics.wrench_on(weights, self.chain.gravity, self.tilts, point)

    def torque_on(self, joint: int) -> dict[Factors, Any]:
        """Return the torque or force of the loads on a joint (0-based), N·m or N, by the parameters that multiply it.

        Numbers, or arrays ``(P,)``.
        """
        joint = self.chain.joint_number(joint)
        beyond = [load for load in self.loads if load.link > joint]
        frame = self.loaded_link_poses[joint + 1]
        wrenches = self.wrench_on(beyond, frame[:3, 3])
        axis = se3.turn(frame[:3, :3], self.chain.axes[joint])
        return statics.torque_on(axis, bool(self.chain.prismatic[joint]), wrenches)

    @cached_property
    def _weights(self) -> dict[Load, statics.Weight]:
        return statics.weigh(self.loads, self.loaded_link_poses)

    @cached_property
    @returns_read_only
    def _statics(self) -> tuple[Array, Array]:
        return self.chain.pinocchio.statics(self.q)
