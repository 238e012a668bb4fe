"""What a displaced chain is, written from its definition: places make one E each, joints take scalar errors."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping

import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation

from precision_pin.draws.expressions import Component, Constant, Expression, Operation, Operator
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
