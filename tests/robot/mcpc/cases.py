"""Chains, and independent readings of the paper's equations, for the tests of the MCPC adapter."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from precision_pin.robot.mcpc import Mcpc


@dataclass(frozen=True, eq=False)
class StandIn:
    """What the adapter needs of a chain."""

    joint_names: tuple[str, ...]
    placements: np.ndarray
    axes: np.ndarray
    prismatic: np.ndarray


def stand_in(placements, axes, prismatic=None) -> StandIn:
    count = len(axes)
    names = tuple(f"joint{i + 1}" for i in range(count))
    slides = np.zeros(count, dtype=bool) if prismatic is None else np.array(prismatic, dtype=bool)
    return StandIn(names, np.array(placements, dtype=float), np.array(axes, dtype=float).reshape(count, 3), slides)


def pose(xyz=(0, 0, 0), rpy=(0, 0, 0)) -> np.ndarray:
    """Return a URDF <origin>."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    matrix[:3, 3] = xyz
    return matrix


def paper_arm() -> StandIn:
    """Return the chain of 4dof.urdf: the paper's arm (Table 1), all axes z, base at the foot of a_1."""
    placements = [
        pose(),
        pose((0, 0, 0.085), (-np.pi / 2, 0, 0)),
        pose((1.970, 0, 0)),
        pose((1.770, 0, 0)),
        pose((0, 0, -0.274)),
    ]
    return stand_in(placements, np.tile((0, 0, 1), (4, 1)))


def random_pose(generator, reach=1.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=generator).as_matrix()
    matrix[:3, 3] = generator.uniform(-reach, reach, 3)
    return matrix


def random_chain(seed: int) -> StandIn:
    """Return a chain whose next axis is slanted, parallel, antiparallel, crossing or coincident, at random."""
    generator = np.random.default_rng(seed)
    count = int(generator.integers(1, 8))
    axes = Rotation.random(count, random_state=generator).apply((0, 0, 1))
    prismatic = generator.random(count) < 0.3
    placements = [random_pose(generator)]
    for i in range(1, count):
        placements.append(_related(generator, axes[i - 1], axes[i], str(generator.choice(KINDS))))
    placements.append(_related(generator, axes[-1], np.array((0.0, 0, 1)), str(generator.choice(KINDS))))
    return stand_in(placements, axes, prismatic)


KINDS = ("slanted", "parallel", "antiparallel", "crossing", "coincident")


def _related(generator, axis, next_axis, kind) -> np.ndarray:
    matrix = random_pose(generator)
    if kind in ("slanted", "crossing"):
        if kind == "crossing":
            matrix[:3, 3] = 0.4 * axis - 0.7 * (matrix[:3, :3] @ next_axis)
        return matrix
    sign = -1 if kind == "antiparallel" else 1
    turn, _ = Rotation.align_vectors(sign * axis[None], next_axis[None])
    about = Rotation.from_rotvec(axis * generator.uniform(-3, 3))
    matrix[:3, :3] = (about * turn).as_matrix()
    if kind == "coincident":
        matrix[:3, 3] = 0.3 * axis
    return matrix


def random_values(chain, generator) -> np.ndarray:
    return generator.uniform(-3, 3, len(chain.joint_names))


def random_mcpc(seed: int, joints: int) -> Mcpc:
    """Return parameters at random in every cell, β and the offsets included."""
    generator = np.random.default_rng(seed)
    prismatic = generator.random(joints) < 0.4
    return Mcpc(
        joint_names=tuple(f"joint{i + 1}" for i in range(joints)),
        prismatic=prismatic,
        alpha=generator.uniform(-3, 3, joints + 1),
        beta=generator.uniform(-1.3, 1.3, joints + 1),
        x=generator.uniform(-1, 1, joints + 1),
        y=generator.uniform(-1, 1, joints + 1),
        gamma=1.1,
        z=-0.7,
        joint_offset=generator.uniform(-1.5, 1.5, joints),
        joint_shift=np.where(prismatic, 0.2, 0.0),
        base_turn=0.4,
        frame_in_link=np.tile(np.eye(4), (joints + 1, 1, 1)),
    )


# --- the paper's equations 1-3, letter by letter, fit for complex steps ---


def rot(axis: str, angle) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    rows = {
        "x": [[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]],
        "y": [[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]],
        "z": [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    }
    return np.array(rows[axis])


def trans(x, y, z) -> np.ndarray:
    return np.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def literal_links(mcpc: Mcpc, q, errors) -> list[np.ndarray]:
    """Return T_0 … T_n of eqs 1 and 2 with parameter errors added; real or complex, in the order of eq 16."""
    n = len(mcpc.joint_names)
    joint = errors[:n]
    alpha = mcpc.alpha + errors[n : 2 * n + 1]
    beta = mcpc.beta + errors[2 * n + 1 : 3 * n + 2]
    gamma = mcpc.gamma + errors[3 * n + 2]
    x = mcpc.x + errors[3 * n + 3 : 4 * n + 4]
    y = mcpc.y + errors[4 * n + 4 : 5 * n + 5]
    z = mcpc.z + errors[5 * n + 5]
    links = []
    for i in range(n + 1):
        link = np.eye(4)
        if i and mcpc.prismatic[i - 1]:
            link = rot("z", mcpc.joint_offset[i - 1]) @ trans(0, 0, q[i - 1] + mcpc.joint_shift[i - 1] + joint[i - 1])
        elif i:
            link = rot("z", q[i - 1] + mcpc.joint_offset[i - 1] + joint[i - 1])
        link = link @ rot("x", alpha[i]) @ rot("y", beta[i])
        links.append(link @ (trans(x[i], y[i], 0) if i < n else rot("z", gamma) @ trans(x[i], y[i], z)))
    return links


def literal_tip(mcpc: Mcpc, q, errors) -> np.ndarray:
    tip = rot("z", mcpc.base_turn)
    for link in literal_links(mcpc, q, errors):
        tip = tip @ link
    return tip


def six(matrix) -> np.ndarray:
    """Return the ``[d; δ]`` of an error matrix laid out as in eq 5."""
    return np.array([*matrix[:3, 3], matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def displaced_tip(mcpc: Mcpc, q, displacements) -> np.ndarray:
    """Return B·Q_0 V_0 E_0 ⋯ Q_n V_n E_n."""
    tip = rot("z", mcpc.base_turn)
    zero = np.zeros(5 * len(mcpc.joint_names) + 6)
    for link, displacement in zip(literal_links(mcpc, q, zero), displacements, strict=True):
        tip = tip @ link @ displacement
    return tip


# --- Pinocchio ---


def pinocchio_model(chain, placements=None) -> tuple[pin.Model, int]:
    """Return a model of the chain with its tip as an operational frame."""
    placements = chain.placements if placements is None else placements
    model = pin.Model()
    parent = 0
    for i, name in enumerate(chain.joint_names):
        kind = pin.JointModelPrismaticUnaligned if chain.prismatic[i] else pin.JointModelRevoluteUnaligned
        parent = model.addJoint(parent, kind(np.array(chain.axes[i])), pin.SE3(placements[i]), name)
    return model, model.addFrame(pin.Frame("tip", parent, pin.SE3(placements[-1]), pin.FrameType.OP_FRAME))


def pinocchio_tip(chain, q, placements=None) -> np.ndarray:
    model, frame = pinocchio_model(chain, placements)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.asarray(q, dtype=float))
    return data.oMf[frame].homogeneous
