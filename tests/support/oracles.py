"""What answers are compared with: displaced chains, arms at rest, cantilevers, exact rods, a UR5 in closed form."""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping

import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation

from precision_pin.draws.expressions import Component, Constant, Expression, Operation, Operator
from precision_pin.model.equilibrium import solve_equilibrium
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.places import Place
from precision_pin.terms.term import JointValue, Term
from support.plain_robot import inserted, motion


def value_of(expression: Expression, values: Mapping[str, float]) -> float:
    """Return a formula's value, term by term."""
    if isinstance(expression, Component):
        return values[expression.name]
    if isinstance(expression, Constant):
        return expression.value
    assert isinstance(expression, Operation)
    arguments = [value_of(argument, values) for argument in expression.arguments]
    functions: dict[Operator, Callable[..., float]] = {
        Operator.ADD: lambda a, b: a + b,
        Operator.SUBTRACT: lambda a, b: a - b,
        Operator.MULTIPLY: lambda a, b: a * b,
        Operator.DIVIDE: lambda a, b: a / b,
        Operator.POWER: lambda a, b: a**b,
        Operator.SQRT: np.sqrt,
        Operator.SIN: np.sin,
        Operator.COS: np.cos,
    }
    return float(functions[expression.operator](*arguments))


def displacements(terms: tuple[Term, ...], values: Mapping[str, float]) -> dict[object, np.ndarray]:
    """Return the sum of twist × factors for every target: joint errors ``(1,)``, places ``(6,)``."""
    totals: dict[object, np.ndarray] = {}
    for term in terms:
        product = float(np.prod([value_of(factor, values) for factor in term.factors]))
        totals[term.target] = totals.get(term.target, 0.0) + term.twist * product
    return totals


def displaced_pose(chain: Chain, q, totals: Mapping[object, np.ndarray]) -> np.ndarray:
    """Return the tip, multiplied out link by link."""
    count = len(chain.joints)
    errors = np.zeros(count)
    places: dict[int, list[tuple[tuple[int, int], np.ndarray, np.ndarray]]] = defaultdict(list)
    for target, total in totals.items():
        if isinstance(target, JointValue):
            errors[target.joint] = total[0]
        else:
            assert isinstance(target, Place)
            places[target.link].append((target.order, target.frame, total))
    tip = np.eye(4)
    for i in range(count + 1):
        if i:
            tip = tip @ motion(chain.axes[i - 1], bool(chain.prismatic[i - 1]), q[i - 1] + errors[i - 1])
        for _, frame, total in sorted(places[i], key=lambda entry: entry[0]):
            tip = tip @ frame @ inserted(total) @ np.linalg.inv(frame)
        tip = tip @ chain.placements[i]
    return tip


def virtual_joint_pose(chain: Chain, q, joint_errors, ends, seats) -> np.ndarray:
    """Return the tip by Pinocchio: three virtual slides and a virtual ball joint at every link's end and seat.

    ``ends`` and ``seats`` are ``(n+1, 6)``.
    """
    model = pinocchio.Model()
    values: list[float] = []
    parent, placement = 0, np.eye(4)
    for i in range(len(chain.joints) + 1):
        if i:
            kind = pinocchio.JointModelPrismaticUnaligned if chain.prismatic[i - 1] else None
            kind = kind or pinocchio.JointModelRevoluteUnaligned
            parent = model.addJoint(parent, kind(np.array(chain.axes[i - 1])), pinocchio.SE3(placement), f"q{i}")
            values.append(q[i - 1] + joint_errors[i - 1])
        placement = chain.placements[i]
        for name, error in (("end", ends[i]), ("seat", seats[i])):
            for k, axis in enumerate(np.eye(3)):
                parent = model.addJoint(
                    parent,
                    pinocchio.JointModelPrismaticUnaligned(axis),
                    pinocchio.SE3(placement),
                    f"{name}{i}.{'xyz'[k]}",
                )
                values.append(error[k])
                placement = np.eye(4)
            parent = model.addJoint(
                parent, pinocchio.JointModelSpherical(), pinocchio.SE3.Identity(), f"{name}{i}.turn"
            )
            values.extend(Rotation.from_rotvec(error[3:]).as_quat())
    data = model.createData()
    pinocchio.forwardKinematics(model, data, np.array(values))
    return data.oMi[parent].homogeneous


def settled_errors(model: ErrorModel, q, x) -> np.ndarray:
    """Return the errors ``(6, N)`` of robots with component values ``(d, N)``, each at rest under its own loads."""
    nominal = ErrorModel(model.chain, model.space, model.sources, statics="nominal")
    posture = nominal.at(q).posture
    errors = []
    for column in np.asarray(x, dtype=float).T:
        rest = solve_equilibrium(posture, model.space, model.bound_sources, values=column)
        errors.append(rest.alone(posture, model.space).exact(column[:, None])[:, 0])
    return np.array(errors).T


SHOULDER, UPPER, FORE, WRIST_1, WRIST_2, WRIST_3 = 0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823
"""Lengths of a UR5 in the maker's Denavit-Hartenberg table, m."""


def dh(angle: float, offset: float, length: float, twist: float) -> np.ndarray:
    c, s, ct, st = math.cos(angle), math.sin(angle), math.cos(twist), math.sin(twist)
    return np.array(
        [[c, -s * ct, s * st, length * c], [s, c * ct, -c * st, length * s], [0, st, ct, offset], [0, 0, 0, 1]]
    )


def ur5_pose(q) -> np.ndarray:
    """Return the flange of a UR5; the URDF's base is the maker's turned by half a turn."""
    quarter = math.pi / 2
    rows = ((SHOULDER, 0, quarter), (0, -UPPER, 0), (0, -FORE, 0), (WRIST_1, 0, quarter), (WRIST_2, 0, -quarter))
    pose = np.diag([-1.0, -1, 1, 1])
    for angle, row in zip(q, (*rows, (WRIST_3, 0, 0)), strict=True):
        pose = pose @ dh(angle, *row)
    return pose


def ur5_branches(pose) -> list[np.ndarray]:
    """Return the up to eight postures of a UR5 at a flange pose: shoulder left or right, wrist turned or not, elbow up, down."""
    turned = np.diag([-1.0, -1, 1, 1]) @ pose
    (nx, ox, _, px), (ny, oy, _, py) = turned[:2]
    found = []
    wx, wy, _ = turned[:3, 3] - WRIST_3 * turned[:3, 2]
    if math.hypot(wx, wy) < WRIST_1:
        return []
    for shoulder in (1, -1):
        q1 = math.atan2(wy, wx) + shoulder * math.acos(WRIST_1 / math.hypot(wx, wy)) + math.pi / 2
        s, c = math.sin(q1), math.cos(q1)
        cosine = (px * s - py * c - WRIST_1) / WRIST_3
        for wrist in (1, -1) if abs(cosine) <= 1 else ():
            q5 = wrist * math.acos(cosine)
            sine = math.sin(q5)
            q6 = math.atan2((oy * c - ox * s) / sine, (nx * s - ny * c) / sine)
            beyond = dh(q5, WRIST_2, 0, -math.pi / 2) @ dh(q6, WRIST_3, 0, 0)
            plane = np.linalg.inv(dh(q1, SHOULDER, 0, math.pi / 2)) @ turned @ np.linalg.inv(beyond)
            x, y, _ = plane[:3, 3] - WRIST_1 * plane[:3, 1]
            bend = (x * x + y * y - UPPER**2 - FORE**2) / (2 * UPPER * FORE)
            for elbow in (1, -1) if abs(bend) <= 1 else ():
                q3 = elbow * math.acos(bend)
                q2 = math.atan2(-y, -x) - math.atan2(FORE * math.sin(q3), UPPER + FORE * math.cos(q3))
                rest = np.linalg.inv(dh(q2, 0, -UPPER, 0) @ dh(q3, 0, -FORE, 0)) @ plane
                found.append(np.array([q1, q2, q3, math.atan2(rest[1, 0], rest[0, 0]), q5, q6]))
    return found


def torsion_constant(width: float, height: float, wall: float, cells: int) -> float:
    """Return J of a rectangular tube by bilinear elements for Prandtl's function, which is constant over the hole.

    ``cells`` square-ish cells through the wall; the walls must be whole parts of the sides. J = 2 ∫ φ dA.
    """
    nx, ny = round(width / wall * cells), round(height / wall * cells)
    dx, dy = width / nx, height / ny
    x, y = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), indexing="ij")
    in_wall = (np.minimum(x, nx - x) < cells) | (np.minimum(y, ny - y) < cells)
    outside = (np.minimum(x, nx - x) == 0) | (np.minimum(y, ny - y) == 0)
    inner = in_wall & ~outside
    number = np.where(outside, -1, 0)
    number[inner] = np.arange(inner.sum())
    number[~in_wall] = inner.sum()
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1).reshape(-1, 4)
    along_x = np.array([[2, -2, -1, 1], [-2, 2, 1, -1], [-1, 1, 2, -2], [1, -1, -2, 2]]) * dy / dx / 6
    along_y = np.array([[2, 1, -1, -2], [1, 2, -2, -1], [-1, -2, 2, 1], [-2, -1, 1, 2]]) * dx / dy / 6
    matrix = np.zeros((inner.sum() + 1,) * 2)
    right = np.zeros(inner.sum() + 1)
    for corner in corners:
        free = corner >= 0
        np.add.at(matrix, np.ix_(corner[free], corner[free]), (along_x + along_y)[np.ix_(free, free)])
        np.add.at(right, corner[free], 2 * dx * dy / 4)
    return float(right @ np.linalg.solve(matrix, right))


POSE = np.radians([-90.0, 3.0, 88.0, -91.0])
LENGTHS = (1.97, 1.77)
ROD_MASSES = (1.4, 1.4)
RIGIDITIES = np.array([[4000.0, 8000.0, 8000.0], [1000.0, 8000.0, 8000.0]])
COMPLIANCE = 1e-5


def rods_error(stiffness: float = 1.0, payload: float = 1.0, pieces: int = 10) -> np.ndarray:
    """Return the tool's error ``[d; δ]`` in base axes, all stiffness scaled by a factor, extrapolated in the pieces.

    The paper's arm under gravity. Links 2 and 3 are Kirchhoff rods (inextensible, no shear): curvature in the rod's own
    axes is the moment there divided by (GI, EI, EI). Link 4 is rigid, joints are torsion springs. A rod is a row of n
    straight pieces that turn by ``curvature × length`` from one middle to the next, an error of second order in 1/n, which
    two n take away.
    """
    position, turn = _at_rest(stiffness, payload, 1, (0.0, 0.0, 0.0))
    errors = []
    for count in (pieces, 2 * pieces):
        moved, turned = _at_rest(stiffness, payload, count, (0.0, 0.0, -9.81))
        errors.append(np.concatenate([moved - position, Rotation.from_matrix(turned @ turn.T).as_rotvec()]))
    return (4 * errors[1] - errors[0]) / 3


def _turn(vector) -> np.ndarray:
    return Rotation.from_rotvec(vector).as_matrix()


def _at_rest(stiffness: float, payload: float, count: int, gravity) -> tuple[np.ndarray, np.ndarray]:
    """Return the tool's position and axes: shape, then moments, then curvatures, in turn until nothing moves."""
    curvatures = np.zeros((2, count, 3))
    joints = np.zeros(4)
    last = np.full(3, np.inf)
    for _ in range(200):
        pivots, axes, middles, frames = [], [], [], []
        turn, here = _turn([0, 0, POSE[0] + joints[0]]), np.zeros(3)
        pivots.append(here)
        axes.append(turn[:, 2])
        here = here + turn @ [0, 0, 0.085]
        turn = turn @ _turn([-np.pi / 2, 0, 0]) @ _turn([0, 0, POSE[1] + joints[1]])
        pivots.append(here)
        axes.append(turn[:, 2])
        for rod in (0, 1):
            step = LENGTHS[rod] / count
            half, whole = _turn(curvatures[rod] * step / 2), _turn(curvatures[rod] * step)
            for k in range(count):
                frame = turn @ half[k]
                middles.append(here + frame[:, 0] * step / 2)
                frames.append(frame)
                here = here + frame[:, 0] * step
                turn = turn @ whole[k]
            turn = turn @ _turn([0, 0, POSE[2 + rod] + joints[2 + rod]])
            pivots.append(here)
            axes.append(turn[:, 2])
        tool = here + turn @ [0, 0, -0.274]
        if np.abs(tool - last).max() < 1e-15:
            break
        last = tool
        # from the tool backwards: mass and first moment of what lies beyond
        mass, first = 3.3 + payload, 3.3 * (here + turn @ [0, 0, -0.137]) + payload * tool
        torques = np.zeros(4)
        torques[3] = axes[3] @ np.cross(first - mass * pivots[3], gravity)
        for rod in (1, 0):
            step, piece = LENGTHS[rod] / count, ROD_MASSES[rod] / count
            for k in reversed(range(count)):
                middle, frame = middles[rod * count + k], frames[rod * count + k]
                beyond, its_first = mass + piece / 2, first + piece / 2 * (middle + frame[:, 0] * step / 4)
                moment = np.cross(its_first - beyond * middle, gravity)
                curvatures[rod, k] = frame.T @ moment / (RIGIDITIES[rod] * stiffness)
                mass, first = mass + piece, first + piece * middle
            torques[rod + 1] = axes[rod + 1] @ np.cross(first - mass * pivots[rod + 1], gravity)
        torques[0] = axes[0] @ np.cross(first - mass * pivots[0], gravity)
        joints = COMPLIANCE / stiffness * torques
    return tool, turn
