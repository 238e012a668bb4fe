"""Axis installation, eqs 18 and 19, by hand and by the line that the axis must follow."""

from __future__ import annotations

from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from support.checks.common import MM, evaluated, same
from support.plain_robot import chain_of, inserted, joint, link, robot, unit


def bearing(axis=(0, 0, 1), rpy=(0, 0, 0)) -> Chain:
    """One joint whose seat's axes are the base's."""
    return chain_of(
        robot(link("base"), joint("hinge", "revolute", "base", "arm", (0.2, 0.1, 0.4), rpy, axis), link("arm"))
    )


def check_axis_install(module: ModuleType) -> None:
    chain = bearing()
    points = {"A.x": 0.06 * MM, "A.y": -0.03 * MM, "B.x": -0.02 * MM, "B.y": 0.08 * MM}
    values = {f"axis_install[hinge].{name}": value for name, value in points.items()}
    for start, shift in ((0.0, (0.06, -0.03, 0)), (-0.030, (0.036, 0.003, 0))):
        source = module.AxisInstall(joint="hinge", radius=0.1 * MM, span=0.1, start=start)
        at, totals = evaluated(chain, [0.4], [source], values)
        ((place, total),) = totals.items()
        assert place == chain.seat(0)
        same(total, np.array([*shift, -1.1, -0.8, 0]) * MM, 1e-15)

    # covariance of independent discs (R2), of the seat's displacement: the source's own J Σ Jᵀ
    radius, span = 0.1 * MM, 0.1
    source = module.AxisInstall(joint="hinge", radius=radius, span=span)
    at = ErrorModel(chain, Space(), [source]).at([0.0])
    columns = np.array([term.twist for term in at.terms]).T
    order = [at.space.index[term.factors[0].name] for term in at.terms]
    covariance = columns @ at.space.covariance[np.ix_(order, order)] @ columns.T
    expected = np.zeros((6, 6))
    expected[0, 0] = expected[1, 1] = radius**2 / 4
    expected[3, 3] = expected[4, 4] = radius**2 / (2 * span**2)
    expected[0, 4] = expected[4, 0] = -(radius**2) / (4 * span)
    expected[1, 3] = expected[3, 1] = radius**2 / (4 * span)
    np.testing.assert_allclose(covariance, expected, rtol=1e-12, atol=1e-24)
    by_diameter = module.AxisInstall(joint="hinge", diameter=2 * radius, span=span)
    assert by_diameter.own_draws("x") == source.own_draws("x")

    # the displaced axis passes through A and B, for any axis, to second order in the offsets
    for axis in ((0, 0, 1), (0, 0, -1), (0, 1, 0), tuple(unit((0.3, -0.5, 0.7))), tuple(unit((0.1, 0.2, -0.9)))):
        chain = bearing(axis, (0.4, -0.8, 1.9))
        nominal = np.array(axis, dtype=float)
        normal = np.cross((0, 0, 1.0), nominal)
        sine = float(np.linalg.norm(normal))
        turn = np.diag([1.0, -1, -1]) if axis[2] < 0 else np.eye(3)
        if sine > 0:
            turn = Rotation.from_rotvec(normal / sine * np.arctan2(sine, nominal[2])).as_matrix()
        source = module.AxisInstall(joint="hinge", radius=0.1 * MM, span=0.1, start=0.02)
        _, totals = evaluated(chain, [0.7], [source], values)
        (total,) = totals.values()
        for point, height in (("A", 0.02), ("B", 0.12)):
            passes = turn @ [points[f"{point}.x"], points[f"{point}.y"], height]
            same(inserted(total)[:3, :3] @ (nominal * height) + total[:3], passes, 3e-7)
