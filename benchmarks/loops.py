"""What one would write otherwise: loops over Pinocchio, and numpy with the sample axis last.

Each is a function from the UR5's parameters ``(36, N)`` to the errors ``(6, N)``, ``[d; δ]`` in m and rad, base axes:
the tip's displacement and the rotation vector from its nominal orientation to the real one. All of them get their
parameters drawn in bulk by numpy, which is quicker than drawing in the loop.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio

from benchmarks.cases import POSE, UR5
from precision_pin.base.arrays import Array

__all__ = [
    "Errors",
    "numpy_by_hand",
    "plain_loop",
    "rotation_vectors",
    "statistics_with_numpy",
    "tuned_loop",
    "tuned_virtual_joints",
    "virtual_joint_values",
    "virtual_joints",
]

Errors = Callable[[Array], Array]


def link_placement(a: float, d: float, alpha: float) -> pinocchio.SE3:
    """Return the constant transform of a link."""
    return pinocchio.SE3(pinocchio.utils.rotate("x", alpha), np.array([a, 0.0, d]))


def arm() -> tuple[pinocchio.Model, int]:
    """Return the UR5 and its tip's frame number."""
    model = pinocchio.Model()
    parent, placement = 0, pinocchio.SE3.Identity()
    for number, link in enumerate(UR5, 1):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"joint{number}")
        placement = link_placement(*link)
    return model, model.addFrame(pinocchio.Frame("tip", parent, 0, placement, pinocchio.FrameType.OP_FRAME))


def plain_loop(*, copied: bool) -> Errors:
    """Return the loop that one writes first: displace the placements of the model, then ask Pinocchio for the pose.

    Args:
        copied: Displace a new copy of the model, with data of its own, for every sample; otherwise one copy, again and
            again.
    """
    nominal, tip = arm()
    q = np.array(POSE)
    data = nominal.createData()
    pinocchio.forwardKinematics(nominal, data, q)
    pose = pinocchio.updateFramePlacement(nominal, data, tip).copy()

    def errors(x: Array) -> Array:
        model = nominal.copy()
        data = model.createData()
        result = np.empty((6, x.shape[1]))
        for sample, values in enumerate(x.T):
            if copied:
                model = nominal.copy()
                data = model.createData()
            for joint in range(1, 7):
                six = values[6 * joint - 6 : 6 * joint]
                displacement = pinocchio.SE3(pinocchio.exp3(six[3:]), six[:3])
                if joint < 6:
                    model.jointPlacements[joint + 1] = displacement * nominal.jointPlacements[joint + 1]
                else:
                    model.frames[tip].placement = displacement * nominal.frames[tip].placement
            pinocchio.forwardKinematics(model, data, q)
            moved = pinocchio.updateFramePlacement(model, data, tip)
            result[:3, sample] = moved.translation - pose.translation
            result[3:, sample] = pinocchio.log3(moved.rotation @ pose.rotation.T)
        return result

    return errors


def tuned_loop() -> Errors:
    """Return the same with everything taken out of the loop that can be.

    All displaced placements are computed beforehand in bulk, and only copied into the model's own memory in the loop.
    The rotation vectors are computed in bulk afterwards.
    """
    nominal, tip = arm()
    q = np.array(POSE)
    model = nominal.copy()
    data = model.createData()
    placements = [*(model.jointPlacements[joint] for joint in range(2, 7)), model.frames[tip].placement]
    rotations = [placement.rotation for placement in placements]
    translations = [placement.translation for placement in placements]
    fixed = [placement.homogeneous.copy() for placement in placements]
    moved = data.oMf[tip]
    rotation, translation = moved.rotation, moved.translation
    pinocchio.framesForwardKinematics(model, data, q)
    turned, position = rotation.copy(), translation.copy()
    update, run = pinocchio.updateFramePlacement, pinocchio.forwardKinematics

    def errors(x: Array) -> Array:
        count = x.shape[1]
        turns, shifts = [], []
        for k, constant in enumerate(fixed):
            turn = rotation_matrices(x[6 * k + 3 : 6 * k + 6])
            shift = x[6 * k : 6 * k + 3] + np.einsum("ijn,j->in", turn, constant[:3, 3])
            turns.append(np.ascontiguousarray(np.einsum("ijn,jk->nik", turn, constant[:3, :3])))
            shifts.append(np.ascontiguousarray(shift.T))
        # sample by sample: six pairs of what is copied and where to
        targets = list(zip(rotations, turns, strict=True)) + list(zip(translations, shifts, strict=True))
        positions, orientations = np.empty((count, 3)), np.empty((count, 3, 3))
        for sample in range(count):
            for target, values in targets:
                target[...] = values[sample]
            run(model, data, q)
            update(model, data, tip)
            positions[sample] = translation
            orientations[sample] = rotation
        return np.concatenate([(positions - position).T, rotation_vectors(orientations, turned)])

    return errors


def arm_of_virtual_joints() -> tuple[pinocchio.Model, int]:
    """Return a UR5 in which each parameter is the value of a joint of its own: three slides, three turns at each joint.

    42 joints, and the tip's frame number.
    """
    model = pinocchio.Model()
    slides = (pinocchio.JointModelPX, pinocchio.JointModelPY, pinocchio.JointModelPZ)
    turns = (pinocchio.JointModelRX, pinocchio.JointModelRY, pinocchio.JointModelRZ)
    parent, placement = 0, pinocchio.SE3.Identity()
    for number, link in enumerate(UR5, 1):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"joint{number}")
        for kind in (*slides, *turns):
            parent = model.addJoint(parent, kind(), pinocchio.SE3.Identity(), f"{kind.__name__}{number}")
        placement = link_placement(*link)
    return model, model.addFrame(pinocchio.Frame("tip", parent, 0, placement, pinocchio.FrameType.OP_FRAME))


def virtual_joint_values(x: Array) -> Array:
    """Return the values ``(N, 42)`` of the joints and virtual joints for parameters ``(36, N)``.

    Three turns about x, y and z are not the turn by the vector; the angles that give it are found in bulk, to second
    order (Baker, Campbell and Hausdorff), which leaves 1e-11 rad here.
    """
    six = x.reshape(6, 6, -1).transpose(2, 0, 1)
    u, v, w = six[:, :, 3], six[:, :, 4], six[:, :, 5]
    q = np.empty((len(six), 6, 7))
    q[:, :, 0] = POSE
    q[:, :, 1:4] = six[:, :, :3]
    q[:, :, 4] = u - v * w / 2
    q[:, :, 5] = v + u * w / 2
    q[:, :, 6] = w - u * v / 2
    return q.reshape(-1, 42)


def virtual_joints() -> Errors:
    """Return a loop over the arm with virtual joints, which leaves all of the chain to Pinocchio."""
    model, tip = arm_of_virtual_joints()
    data = model.createData()
    pinocchio.forwardKinematics(model, data, virtual_joint_values(np.zeros((36, 1)))[0])
    pose = pinocchio.updateFramePlacement(model, data, tip).copy()

    def errors(x: Array) -> Array:
        result = np.empty((6, x.shape[1]))
        for sample, q in enumerate(virtual_joint_values(x)):
            pinocchio.forwardKinematics(model, data, q)
            moved = pinocchio.updateFramePlacement(model, data, tip)
            result[:3, sample] = moved.translation - pose.translation
            result[3:, sample] = pinocchio.log3(moved.rotation @ pose.rotation.T)
        return result

    return errors


def tuned_virtual_joints() -> Errors:
    """Return the same with two calls and two copies left in the loop."""
    model, tip = arm_of_virtual_joints()
    data = model.createData()
    rotation, translation = data.oMf[tip].rotation, data.oMf[tip].translation
    pinocchio.framesForwardKinematics(model, data, virtual_joint_values(np.zeros((36, 1)))[0])
    turned, position = rotation.copy(), translation.copy()
    update, run = pinocchio.updateFramePlacement, pinocchio.forwardKinematics

    def errors(x: Array) -> Array:
        positions, orientations = np.empty((x.shape[1], 3)), np.empty((x.shape[1], 3, 3))
        for sample, q in enumerate(virtual_joint_values(x)):
            run(model, data, q)
            update(model, data, tip)
            positions[sample] = translation
            orientations[sample] = rotation
        return np.concatenate([(positions - position).T, rotation_vectors(orientations, turned)])

    return errors


def numpy_by_hand() -> Errors:
    """Return the chain multiplied out for all samples at once, the sample axis last."""
    before, links = [], []
    for (a, d, alpha), angle in zip(UR5, POSE, strict=True):
        before.append(pinocchio.utils.rotate("z", angle))
        links.append((pinocchio.utils.rotate("x", alpha), np.array([a, 0.0, d])))
    turned, position = np.eye(3), np.zeros(3)
    for joint, (turn, shift) in zip(before, links, strict=True):
        turned = turned @ joint
        position = position + turned @ shift
        turned = turned @ turn

    def errors(x: Array) -> Array:
        count = x.shape[1]
        # its transpose, so that a constant factor is one product of a small matrix with a large one
        rotation = np.repeat(np.eye(3)[:, :, None], count, axis=2)
        moved = np.zeros((3, count))
        for k, (joint, (turn, shift)) in enumerate(zip(before, links, strict=True)):
            rotation = (joint.T @ rotation.reshape(3, -1)).reshape(3, 3, count)
            error = rotation_matrices(x[6 * k + 3 : 6 * k + 6])
            moved += (rotation * x[6 * k : 6 * k + 3, None]).sum(axis=0)
            rotation = np.stack([sum(error[i, j] * rotation[i] for i in range(3)) for j in range(3)])
            moved += (shift @ rotation.reshape(3, -1)).reshape(3, count)
            rotation = (turn.T @ rotation.reshape(3, -1)).reshape(3, 3, count)
        return np.concatenate([moved - position[:, None], rotation_vectors(rotation.transpose(2, 1, 0), turned)])

    return errors


def rotation_matrices(vectors: Array) -> Array:
    """Return Rodrigues' rotation matrices ``(3, 3, N)`` of rotation vectors ``(3, N)`` that are not zero."""
    x, y, z = vectors
    angle = np.sqrt(x * x + y * y + z * z)
    sine = np.sin(angle) / angle
    rest = 2 * (np.sin(angle / 2) / angle) ** 2
    result = np.empty((3, 3, vectors.shape[1]))
    result[0, 0] = 1 - rest * (y * y + z * z)
    result[1, 1] = 1 - rest * (x * x + z * z)
    result[2, 2] = 1 - rest * (x * x + y * y)
    for i, j, turn, product in (
        (1, 0, sine * z, rest * x * y),
        (0, 2, sine * y, rest * x * z),
        (2, 1, sine * x, rest * y * z),
    ):
        result[i, j] = product + turn
        result[j, i] = product - turn
    return result


def rotation_vectors(orientations: Array, nominal: Array) -> Array:
    """Return the rotation vectors ``(3, N)`` from the nominal orientation to others ``(N, 3, 3)``."""
    turn = orientations @ nominal.T
    vector = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]) / 2
    sine = np.sqrt((vector * vector).sum(axis=0))
    cosine = (turn[:, 0, 0] + turn[:, 1, 1] + turn[:, 2, 2] - 1) / 2
    result: Array = vector * (np.arctan2(sine, cosine) / np.where(sine > 0, sine, 1.0) + (sine == 0))
    return result


def statistics_with_numpy(errors: Array) -> tuple[Array, Array, list[Array]]:
    """Return means, covariance and histograms of the eight quantities: the six components and the two norms."""
    values = np.empty((8, errors.shape[1]))
    values[:6] = errors
    values[6] = np.sqrt((errors[:3] ** 2).sum(axis=0))
    values[7] = np.sqrt((errors[3:] ** 2).sum(axis=0))
    return values.mean(axis=1), np.cov(values), [np.histogram(row, bins=200)[0] for row in values]
