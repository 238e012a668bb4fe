"""Errors of places, by hand and against the displaced URDF: frame, length, mounting, MCPC, joint offset, covariance, table."""

import itertools
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import mcpc as parameters_of
from precision_pin.terms.term import JointValue
from support.checks.common import NAMES, PLACES, Q7, SIX, RandomArm, evaluated, one_link, same, slanted_arm
from support.plain_robot import chain_of, inserted, joint, link, pose_error, random_arm, robot, unit


def compare_six(kind: type, arm: RandomArm, where: Mapping[str, str], expected) -> None:
    """Compare the tool's error with six large numbers, given as such and as random ones."""
    laws = [Draw(name, Uniform(0.0, mean=value)) for name, value in zip(NAMES, SIX, strict=True)]
    for values, draws, x in ((SIX, [], []), (NAMES, laws, SIX)):
        source = kind(**where, **dict(zip(NAMES, values, strict=True)))
        at, _ = evaluated(arm.chain, arm.q, [source], {}, draws)
        same(at.exact(np.array(x)[:, None])[:, 0], expected, 1e-13)


def check_frame(module: ModuleType) -> None:
    arm = slanted_arm(12, prismatic=(4,))
    for where, kind, place in (
        *PLACES,
        ({"joint": "joint1"}, "joint", "joint1"),
        ({"link": "link2"}, "joint", "joint3"),
        ({"link": "base"}, "joint", "joint1"),
        ({"link": "link7"}, "link", "tool"),
        ({"frame": "link5"}, "link", "link5"),
    ):
        compare_six(module.Frame, arm, where, arm.moved(kind, place, SIX))
        assert [module.Frame(**where, x=1.0).subject] == list(where.values())


def check_length(module: ModuleType) -> None:
    # a hand case: L of two moving links in a plane; q turns link 2's x from base x to base y
    planar = chain_of(
        robot(
            link("base"),
            joint("one", "revolute", "base", "upper"),
            link("upper"),
            joint("two", "revolute", "upper", "lower", (1, 0, 0)),
            link("lower"),
            joint("flange", "fixed", "lower", "tool", (0.5, 0, 0)),
            link("tool"),
        )
    )
    q = np.radians([30, 60])
    length = [
        module.Length(joint="two", parameters=(1e-3,)),
        module.Length(frame="tool", parameters=(-0.3e-3, -0.2e-3)),
    ]
    at, _ = evaluated(planar, q, length)
    expected = 1e-3 * np.array([np.cos(q[0]), np.sin(q[0]) - 0.5, 0, 0, 0, 0])
    same(at.linear(np.zeros((0, 1)))[:, 0], expected, 1e-16)
    same(at.exact(np.zeros((0, 1)))[:, 0], expected, 1e-15)

    # another way: the same robot with the origin moved
    arm = slanted_arm(11)
    reading, chain = arm.reading, arm.chain
    nominal = reading.poses(arm.q)
    for target, along in itertools.product(
        ({"joint": "joint4"}, {"frame": "tool"}, {"joint": "joint1"}),
        ("link", "x of joint2", "-y of joint5", "z of joint7", "axis of joint3", "-axis of joint4"),
    ):
        source = module.Length(**target, along=along, parameters=(0.8e-3, "extra"))
        at, _ = evaluated(chain, arm.q, [source], {}, [Draw("extra", Uniform(1e-3, mean=0.4e-3))])
        moved_joint = target.get("joint", "flange")
        ((parent, origin),) = ((entry.parent, entry.origin) for entry in reading.joints if entry.name == moved_joint)
        start = nominal[parent][:3, :3] @ origin[:3, 3]
        end = nominal[parent][:3, 3] + start
        if along == "link":
            chain_link = {"joint4": "link3", "flange": "link7", "joint1": "base"}[moved_joint]
            direction = unit(end - nominal[chain_link][:3, 3])
        else:
            name = along.split()[-1]
            (child, axis) = next((entry.child, entry.axis) for entry in reading.joints if entry.name == name)
            which = along.lstrip("-").split()[0]
            vector = axis if which == "axis" else np.eye(3)["xyz".index(which)]
            direction = nominal[child][:3, :3] @ vector * (-1 if along.startswith("-") else 1)
        shift = np.eye(4)
        shift[:3, 3] = (nominal[parent][:3, :3] @ origin[:3, :3]).T @ direction * 1.2e-3
        moved = reading.poses(arm.q, displaced={("joint", moved_joint): shift})["tool"]
        same(at.exact([[0.4e-3]])[:, 0], pose_error(moved, nominal["tool"]), 1e-14)
        same(at.exact([[0.4e-3]])[:3, 0], 1.2e-3 * direction, 1e-14)


def check_mounting(module: ModuleType) -> None:
    # hinge at 90°, tool 1 m along base y: a base turned by rz = 1 mrad moves it by -1 mm in x
    at, _ = evaluated(one_link(), [np.pi / 2], [module.Mounting(at="base", y=2e-3, rz=1e-3)])
    same(at.linear(np.zeros((0, 1)))[:, 0], [-1e-3, 2e-3, 0, 0, 0, 1e-3], 1e-17)
    # a tool of 1 m tilted on its flange: 1 mrad about y drops it by 1 mm; at the tip it only tilts
    at, _ = evaluated(one_link(), [0.0], [module.Mounting(at="tool", flange="arm", ry=1e-3)])
    same(at.linear(np.zeros((0, 1)))[:, 0], [0, 0, -1e-3, 0, 1e-3, 0], 1e-17)
    at, _ = evaluated(one_link(), [0.0], [module.Mounting(at="tool", ry=1e-3)])
    same(at.linear(np.zeros((0, 1)))[:, 0], [0, 0, 0, 0, 1e-3, 0], 1e-17)
    # any arm, large errors
    arm = slanted_arm(12, prismatic=(4,))
    exact, start = inserted(SIX), arm.tool
    for settings, expected in (
        ({"at": "base"}, pose_error(exact @ start, start)),
        ({"at": "tool"}, pose_error(start @ exact, start)),
        ({"at": "tool", "flange": "tool"}, pose_error(start @ exact, start)),
        ({"at": "tool", "flange": "link7"}, arm.moved("link", "link7", SIX)),
    ):
        compare_six(module.Mounting, arm, settings, expected)
    # before everything else: whatever the arm itself does is moved with it
    bent = module.Mounting(at="tool", flange="link7", x=0.01, ry=0.2)
    based = module.Mounting(at="base", **dict(zip(NAMES, SIX, strict=True)))
    at, _ = evaluated(arm.chain, arm.q, [bent, based])
    tool = arm.reading.poses(arm.q, displaced={("link", "link7"): inserted([0.01, 0, 0, 0, 0.2, 0])})["tool"]
    same(at.exact(np.zeros((0, 1)))[:, 0], pose_error(exact @ tool, start), 1e-13)


def check_mcpc(module: ModuleType) -> None:
    generator = np.random.default_rng(16)
    for seed, sliding in ((16, ()), (17, (2, 5))):
        chain = chain_of(random_arm(seed, prismatic=sliding), tip="tool")
        nominal = parameters_of.from_chain(chain)
        n = len(chain.joints)
        errors = np.concatenate(
            [np.zeros(n), generator.uniform(-0.8, 0.8, 2 * n + 3), generator.uniform(-0.3, 0.3, 2 * n + 3)]
        )
        alpha, beta, gamma, x, y, z = np.split(errors[n:], [n + 1, 2 * n + 2, 2 * n + 3, 3 * n + 4, 4 * n + 5])
        sources = []
        for i, name in enumerate(["base", *(f"link{k}" for k in range(1, n + 1))]):
            last = {"gamma": float(gamma[0]), "z": float(z[0])} if i == n else {}
            sources.append(module.Mcpc(link=name, alpha=alpha[i], beta=beta[i], x=x[i], y=y[i], **last))
        at, _ = evaluated(chain, Q7, sources)
        moved = nominal.perturbed(errors).forward_kinematics(Q7)
        expected = pose_error(moved, nominal.forward_kinematics(Q7))
        same(at.exact(np.zeros((0, 1)))[:, 0], expected, 1e-12)


def check_joint_offset(module: ModuleType) -> None:
    # R5: 1R, L = 1 m along x, θ = 0, Δθ = 1 mrad; the tip runs on a circle
    chain = one_link()
    at, _ = evaluated(chain, [0.0], [module.JointOffset(joint="hinge", offset=1e-3)])
    same(at.exact(np.zeros((0, 1)))[:3, 0], [np.cos(1e-3) - 1, np.sin(1e-3), 0], 1e-15)
    arm = slanted_arm(13, prismatic=(3, 6))
    offsets = np.array([0.1, -0.2, 0.03, 0.15, -0.1, -0.04, 0.2])
    sources = [module.JointOffset(joint=name, offset=Normal(0.1)) for name in arm.chain.joint_names]
    values = {f"joint_offset[{name}].offset": value for name, value in zip(arm.q, offsets, strict=True)}
    at, totals = evaluated(arm.chain, Q7, sources, values)
    assert set(totals) == {JointValue(k) for k in range(7)}
    assert at.space.components == tuple(values)
    moved = arm.reading.poses(dict(zip(arm.q, np.add(Q7, offsets), strict=True)))["tool"]
    same(at.exact(offsets[:, None])[:, 0], pose_error(moved, arm.tool), 1e-13)


STD = (1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 3e-3)
CORRELATION = np.eye(6)
CORRELATION[1, 5] = CORRELATION[5, 1] = 0.5
CORRELATION[0, 2] = CORRELATION[2, 0] = -0.25


def rows(matrix) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in matrix)


def check_covariance(module: ModuleType) -> None:
    # at the hinge with the tip 1 m along x: y of the tip is y + 1 m · rz, z of the tip z - 1 m · ry
    by_std = module.Covariance(joint="hinge", std=STD, correlation=rows(CORRELATION))
    (draw,) = by_std.draws("covariance[hinge]")
    assert draw.name == "covariance[hinge].error"
    assert draw.scope is Scope.UNIT
    same(draw.law.covariance[1, 5], 0.5 * 2e-4 * 3e-3, 1e-18)
    same(np.sqrt(np.diag(draw.law.covariance)), STD, 1e-15)
    for source in (by_std, module.Covariance(joint="hinge", matrix=rows(CORRELATION * np.outer(STD, STD)))):
        at, _ = evaluated(one_link(), [0.0], [source])
        covariance = at.covariance
        same(covariance[0, 0], 1e-8, 1e-18)
        same(covariance[1, 1], 4e-8 + 2 * 0.5 * 2e-4 * 3e-3 + 9e-6, 1e-17)
        same(covariance[2, 2], 9e-8 + 4e-6, 1e-17)
        same(covariance[0, 2], -0.25 * 1e-4 * 3e-4, 1e-18)
        same(covariance[1, 5], 0.5 * 2e-4 * 3e-3 + 9e-6, 1e-17)
        same(covariance[3:, 3:], np.diag([1e-6, 4e-6, 9e-6]), 1e-17)
    # every place, any size
    arm = slanted_arm(12, prismatic=(4,))
    for where, kind, place in PLACES:
        at, _ = evaluated(arm.chain, arm.q, [module.Covariance(**where, std=STD, mean=SIX)])
        same(at.space.mean, SIX, 1e-15)
        same(at.exact(np.array(SIX)[:, None])[:, 0], arm.moved(kind, place, SIX), 1e-13)


PLANE = "y [mm], rz [mrad]\n1, 2\n-1, 0\n# a remark\n\n3, 1\n-3, -3\n"
ALL = "rz [deg],x [mm],ry [mrad],z [m],y [um],rx [rad]\n10,30,-400,0.02,-50000,0.3\n"


def check_table(module: ModuleType) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "plane.csv").write_text(PLANE, encoding="utf-8")
        (folder / "all.csv").write_text(ALL, encoding="utf-8")
        # at the hinge with the tip 1 m along x: y of the tip is y + 1 m · rz, row by row
        source = module.Table(joint="hinge", file=folder / "plane.csv")
        (draw,) = source.draws("table[hinge]")
        assert draw.components == ("table[hinge].row.y", "table[hinge].row.rz")
        assert draw.scope is Scope.UNIT
        same(draw.law.mean_vector, [0, 0], 1e-18)
        same(draw.law.covariance, [[5e-6, 3.5e-6], [3.5e-6, 3.5e-6]], 1e-17)
        model = ErrorModel(one_link(), Space(), [source])
        tips = model.at([0.0]).linear(model.space.sample(1, 0, 200))
        rows = np.unique(np.round(tips[[1, 5]] * 1e3, 9), axis=1)
        same(rows, [[-6, -1, 3, 4], [-3, 0, 2, 1]], 1e-9)
        same(tips[[0, 2, 3, 4]], 0.0, 1e-18)
        # every column, every place, any size
        arm = slanted_arm(12, prismatic=(4,))
        six = np.array([*SIX[:5], np.radians(10)])
        for where, kind, place in PLACES:
            at, _ = evaluated(arm.chain, arm.q, [module.Table(**where, file=folder / "all.csv")])
            same(at.space.mean, six[[5, 0, 4, 2, 1, 3]], 1e-15)
            same(at.exact(at.space.sample(3, 0, 1))[:, 0], arm.moved(kind, place, six), 1e-13)
