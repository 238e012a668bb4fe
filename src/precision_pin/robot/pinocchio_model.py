"""The only module that calls Pinocchio: the models it loads, checked against our own reader; kinematics and statics.

A wrong call ends the process by a signal instead of an exception. Pinocchio gets no names from the file, because it
keeps links and joints in one list of frames and refuses a name that occurs twice.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, InternalError
from precision_pin.robot.urdf import Robot, canonical

AGREEMENT = 1e-9
"""Largest difference of Pinocchio from our own reader, relative to the robot's reach and mass."""


@dataclass(frozen=True, eq=False)
class PinocchioModel:
    """Pinocchio's reduced model with the chain's joints only; ``joints`` are their numbers, in chain order."""

    model: Any
    joints: tuple[int, ...]

    @classmethod
    def load(
        cls, robot: Robot, joints: Sequence[str], locked: Mapping[str, float], gravity: Sequence[float]
    ) -> PinocchioModel:
        """Load a robot rooted at the chain's base, compare it with our own reading, and lock the joints off the chain.

        Gravity is in base axes, m/s². Raises `InternalError` if Pinocchio's model differs.
        """
        renamed = _replace_names(robot)
        names = {old.name: new.name for old, new in zip(robot.joints, renamed.joints, strict=True)}
        full = pinocchio.buildModelFromXML(canonical(renamed))
        _verify(full, renamed, [link.name for link in robot.links])
        reference = pinocchio.neutral(full)
        numbers = [full.getJointId(names[name]) for name in locked]
        for number, value in zip(numbers, locked.values(), strict=True):
            reference[full.joints[number].idx_q] = value
        model = pinocchio.buildReducedModel(full, numbers, reference) if numbers else full
        model.gravity.linear = np.asarray(gravity, dtype=float)
        return cls(model, tuple(int(model.getJointId(names[name])) for name in joints))

    def with_mass(self, joint: int, placement: Array, mass: float, centre: ArrayLike) -> PinocchioModel:
        """Return the model with a point mass (kg) added to the body of a chain joint (0-based; -1: the base).

        ``placement`` is the pose of the mass's frame in that joint's frame, ``(4, 4)``; ``centre`` is in the mass's
        frame, m.
        """
        model = self.model.copy()
        inertia = pinocchio.Inertia(mass, np.asarray(centre, dtype=float), np.zeros((3, 3)))
        model.appendBodyToJoint(self.joints[joint] if joint >= 0 else 0, inertia, pinocchio.SE3(placement))
        return PinocchioModel(model, self.joints)

    def joint_poses(self, q: Array) -> Array:
        """Return each chain joint's frame after its motion, in the base, ``(n, 4, 4)``."""
        data = self.model.createData()
        pinocchio.forwardKinematics(self.model, data, self._values(q))
        return np.array([data.oMi[k].homogeneous for k in self.joints]).reshape(-1, 4, 4)

    def statics(self, q: Array) -> tuple[Array, Array]:
        """Return the loads of gravity on the joints ``(n,)``, and on the links' far ends ``(n, 6)``.

        Minus the generalised gravity; force and moment of all beyond joint i+1, at and in its frame after its motion.
        """
        data = self.model.createData()
        zeros = np.zeros(self.model.nv)
        torque = pinocchio.rnea(self.model, data, self._values(q), zeros, zeros)
        columns = [self.model.joints[k].idx_v for k in self.joints]
        wrenches = np.array([-data.f[k].vector for k in self.joints]).reshape(-1, 6)
        return -np.asarray(torque)[columns], wrenches

    def _values(self, q: Array) -> Array:
        values = np.zeros(self.model.nq)
        for k, value in zip(self.joints, q, strict=True):
            values[self.model.joints[k].idx_q] = value
        return values


def model_poses(
    model: Any, joints: Collection[str], base: str, tip: str
) -> tuple[Array, list[tuple[dict[str, float], Array]]]:
    """Return a Pinocchio model's gravity (3,), and its tip at the neutral configuration and one nearby, in the base."""
    if not isinstance(model, pinocchio.Model):
        raise InputError("the model must be a pinocchio.Model")
    for name in (base, tip):
        if not model.existFrame(name):
            raise InputError(f"the Pinocchio model has no frame {name!r}")
    numbers = {name: int(model.getJointId(name)) for name in joints}
    for name, number in numbers.items():
        if model.nvs[number] != 1:
            raise InputError(f"the joint {name!r} of the Pinocchio model is none that turns or slides alone")
    data, samples, gravity = model.createData(), [], np.zeros(3)
    offsets = np.zeros(model.nv)
    for rank, number in enumerate(numbers.values(), 1):
        offsets[model.idx_vs[number]] = 0.1 * rank
    neutral = pinocchio.neutral(model)
    for step in (np.zeros(model.nv), offsets):
        q = pinocchio.integrate(model, neutral, step)
        pinocchio.framesForwardKinematics(model, data, q)
        place = data.oMf[model.getFrameId(base)]
        gravity = place.rotation.T @ model.gravity.linear
        values = {name: float(step[model.idx_vs[number]]) for name, number in numbers.items()}
        samples.append((values, np.array((place.inverse() * data.oMf[model.getFrameId(tip)]).homogeneous)))
    return gravity, samples


def _replace_names(robot: Robot) -> Robot:
    """Return the robot with names replaced by numbers: ``link000000``, ``joint000000`` … in the order of the names."""
    # URDF readers sort by name, so Pinocchio's joints and sums keep the order of the file's own names
    links, joints = (
        {name: f"{kind}{k:06d}" for k, name in enumerate(sorted((thing.name for thing in elements), key=str.encode))}
        for kind, elements in (("link", robot.links), ("joint", robot.joints))
    )
    renamed = (
        replace(joint, name=joints[joint.name], parent=links[joint.parent], child=links[joint.child])
        for joint in robot.joints
    )
    renamed_links = (replace(link, name=links[link.name]) for link in robot.links)
    return Robot("robot", robot.file, tuple(renamed_links), tuple(renamed))


def _verify(model: Any, robot: Robot, written: Sequence[str]) -> None:
    """Compare names, masses, centres and forward kinematics; a difference is a bug in our canonical form."""
    # `written` are the links' names in the file, for messages
    names = {link.name: name for link, name in zip(robot.links, written, strict=True)}
    moving = [joint for joint in robot.joints if joint.kind != "fixed"]
    if sorted(model.names) != sorted(["universe", *(joint.name for joint in moving)]):
        raise InternalError(f"{robot.file}: Pinocchio loaded the joints {sorted(model.names)[:8]} …")
    values = {joint.name: 0.3 + 0.1 * (k % 7) for k, joint in enumerate(moving)}
    link_poses = robot.link_poses(values)
    length = 1.0 + max(float(np.abs(pose[:3, 3]).max()) for pose in link_poses.values())
    q = pinocchio.neutral(model)
    for name, value in values.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)

    bodies = {joint.child: model.getJointId(joint.name) for joint in moving} | {robot.root: 0}
    moments = {number: np.zeros(4) for number in bodies.values()}
    for link in robot.links:
        if not model.existFrame(link.name, pinocchio.FrameType.BODY):
            raise InternalError(f"{robot.file}: Pinocchio did not load the link {names[link.name]!r}")
        number = model.getFrameId(link.name, pinocchio.FrameType.BODY)
        frame = model.frames[number]
        if np.abs(data.oMf[number].homogeneous - link_poses[link.name]).max() > AGREEMENT * length:
            message = f"places the link {names[link.name]!r} at another pose than the URDF"
            raise InternalError(f"{robot.file}: Pinocchio {message}")
        if link.inertial is not None:
            local = frame.placement.homogeneous
            centre = local[:3, :3] @ np.asarray(link.inertial.com) + local[:3, 3]
            moments[frame.parentJoint] += link.inertial.mass * np.array([1.0, *centre])
        parent = robot.parent_joint(link.name)
        if parent is not None and parent.kind == "fixed":
            fixed = model.frames[model.getFrameId(parent.name, pinocchio.FrameType.FIXED_JOINT)].inertia
            mass, centre = (link.inertial.mass, link.inertial.com) if link.inertial is not None else (0.0, (0.0,) * 3)
            moment = float(np.abs(fixed.mass * fixed.lever - mass * np.array(centre)).max())
            if max(abs(fixed.mass - mass), moment) > AGREEMENT * max(1.0, mass) * length:
                raise InternalError(f"{robot.file}: Pinocchio lost mass of the link {names[link.name]!r}")
    for link_name, number in bodies.items():
        scale, inertia = max(1.0, float(moments[number][0])) * length, model.inertias[number]
        pinocchio_moments = np.array([inertia.mass, *(inertia.mass * inertia.lever)])
        if np.abs(moments[number] - pinocchio_moments).max() > AGREEMENT * scale:
            message = f"lost mass of the link {names[link_name]!r} or one fixed to it"
            raise InternalError(f"{robot.file}: Pinocchio {message}")
