"""Link flexibility, eq 21, by the reference table and by integrals of the bending moment."""

from __future__ import annotations

import itertools
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.chain import Load
from precision_pin.laws import Uniform
from precision_pin.space import LabelledSpace, Space
from support.checks.common import Q7, evaluated, in_base, one_link, same
from support.plain_robot import (
    PlainRobot,
    chain_of,
    joint,
    link,
    random_arm,
    robot,
    unit,
)

LENGTH, EI, GI, EA = 2.0, 8000.0, 1000.0, 1e6


def check_beam(module: ModuleType) -> None:
    _check_beam_cases(module)
    _check_beam_axes(module)
    _check_beam_against_integrals(module)
    _check_beam_settings(module)


# name of the load, its row in [F; M], its size, whether it is spread; then [Δl, w_y, w_z; Δφ, θ_y, θ_z]
BEAM_CASES = (
    ("F_x", 0, 100, False, (2e-4, 0, 0, 0, 0, 0)),
    ("q_x", 0, 7, True, (1.4e-5, 0, 0, 0, 0, 0)),
    ("F_y", 1, 10, False, (0, 1 / 300, 0, 0, 0, 2.5e-3)),
    ("M_z", 5, 5, False, (0, 1.25e-3, 0, 0, 0, 1.25e-3)),
    ("q_y", 1, 7, True, (0, 1.75e-3, 0, 0, 0, 7 / 6000)),
    ("F_z", 2, 10, False, (0, 0, 1 / 300, 0, -2.5e-3, 0)),
    ("M_y", 4, 5, False, (0, 0, -1.25e-3, 0, 1.25e-3, 0)),
    ("q_z", 2, 7, True, (0, 0, 1.75e-3, 0, -7 / 6000, 0)),
    ("M_x", 3, 4, False, (0, 0, 0, 8e-3, 0, 0)),
)


def pure_load(row: int, size: float, spread: bool) -> tuple[tuple[float, float, float], Load]:
    """Return gravity and a load that make one component of the wrench at (or weight along) the tip of the beam alone.

    A mass makes a force; a first moment without mass a moment: s × g.
    """
    gravity, moments = np.zeros(3), np.zeros(4)
    if row < 3:
        gravity[row] = 9.81
        moments[0] = size * (LENGTH if spread else 1) / 9.81
    else:
        weight, arm = {3: (2, 1), 4: (0, 2), 5: (1, 0)}[row]
        gravity[weight] = 9.81
        moments[1 + arm] = size / 9.81
    tip = np.eye(4)
    tip[0, 3] = LENGTH
    return tuple(gravity), Load(1, np.eye(4) if spread else tip, tip[:3, 3], spread, ((moments, ()),))


def _check_beam_cases(module: ModuleType) -> None:
    for name, row, size, spread, expected in BEAM_CASES:
        gravity, load = pure_load(row, size, spread)
        chain = one_link(length=LENGTH, gravity=gravity)
        posture = chain.at([0.0]).with_loads([load])
        beam = module.Beam(link="arm", EI=EI, GI=GI, EA=EA)
        total = sum((term.twist for term in beam.terms(posture, LabelledSpace(Space(), beam.label()))), np.zeros(6))
        np.testing.assert_allclose(total, expected, rtol=1e-13, atol=1e-18, err_msg=name)


def _check_beam_axes(module: ModuleType) -> None:
    """Only EI_z given finite makes the tip deflect along beam y alone, so the axes show."""
    gravity = (0.3, -0.6, 0.8)
    for axis, next_axis, way, roll, expected_z in (
        ((0, 0, 1), (0, 1, 0), (1, 0, 0), 0.0, (0, 0, 1)),
        ((0, 1, 0), (0, 0, 1), (1, 0, 0), 0.0, (0, 1, 0)),
        ((0.6, 0, 0.8), (0, 1, 0), (1, 0, 0), 0.0, (0, 0, 1)),
        ((1, 0, 0), (0, 0, 1), (1, 0, 0), 0.0, (0, 0, 1)),
        ((-1, 0, 0), (0.6, 0.8, 0), (1, 0, 0), 0.0, (0, 1, 0)),
        ((1, 0, 0), (1, 0, 0), (1, 0, 0), 0.0, (0, 1, 0)),
        ((0, 1, 0), (0, 1, 0), (0, 1, 0), 0.0, (0, 0, 1)),
        ((0, 0, 1), (0, 1, 0), (1, 0, 0), np.pi / 2, (0, -1, 0)),
        ((0, 0, 1), (0, 1, 0), (1, 0, 0), 0.3, (0, -np.sin(0.3), np.cos(0.3))),
    ):
        chain = chain_of(
            robot(
                link("base"),
                joint("one", "revolute", "base", "arm", axis=axis),
                link("arm"),
                joint("two", "revolute", "arm", "fore", np.multiply(way, 1.5), (0.4, 0.5, 0.6), _turned(next_axis)),
                link("fore", 2.0),
            ),
            gravity=gravity,
        )
        x, z = np.array(way, dtype=float), np.array(expected_z, dtype=float)
        y = np.cross(z, x)
        beam = module.Beam(link="arm", EI_y=1e18, EI_z=EI, roll=roll)
        at, totals = evaluated(chain, [0.0, 0.0], [beam])
        force = 2.0 * np.array(gravity)
        expected = np.concatenate([y * (force @ y) * 1.5**3 / (3 * EI), z * (force @ y) * 1.5**2 / (2 * EI)])
        same(in_base(at.posture, totals), expected, 1e-14)


def _turned(axis) -> tuple[float, ...]:
    """Return an axis of the arm in the axes of joint two, which stands at rpy (0.4, 0.5, 0.6)."""
    return tuple(Rotation.from_euler("xyz", (0.4, 0.5, 0.6)).inv().apply(axis))


def integrals(loads, weight, length, axes, rigidities) -> np.ndarray:
    """Return the displacement of a cantilever's tip by the unit-load integrals of Mohr, base axes, ``[d; δ]``.

    δ = ∫ C M ds and d = ∫ C M × (tip - s) ds + ∫ N/EA ds, with C = R diag(1/GI, 1/EI_y, 1/EI_z) Rᵀ. ``loads`` are
    (reach, force, moment) about the point of the axis there, ``weight`` is spread; piecewise Gauss, so exact.
    """
    gi, ei_y, ei_z, ea = rigidities
    x = axes[:, 0]
    compliance = axes @ np.diag([1 / gi, 1 / ei_y, 1 / ei_z]) @ axes.T
    nodes, weights = np.polynomial.legendre.leggauss(6)
    total = np.zeros(6)
    cuts = sorted({0.0, length, *(reach for reach, _, _ in loads)})
    for start, end in itertools.pairwise(cuts):
        for node, share in zip(nodes, weights, strict=True):
            s = start + (end - start) * (node + 1) / 2
            moment = np.cross(x * (length - s) / 2, weight * (length - s) / length)
            force = weight * (length - s) / length
            for reach, push, turn in loads:
                if reach > s:
                    moment = moment + turn + np.cross(x * (reach - s), push)
                    force = force + push
            bend = compliance @ moment
            width = share * (end - start) / 2
            total[3:] += width * bend
            total[:3] += width * (np.cross(bend, x * (length - s)) + x * (force @ x) / ea)
    return total


def beam_loads(reading: PlainRobot, names, base: str, q, gravity, start, x, length):
    """Return the free-body loads on a chain link: (reach, force, moment) and its own spread weight, base axes.

    ``names`` maps each link that loads the beam to its reach, or to None where its weight is spread.
    """
    loads, weight = [], np.zeros(3)
    for name, (mass, centre) in reading.centres(q, base).items():
        if name not in names:
            continue
        force = mass * np.array(gravity)
        reach = names[name]
        if reach is None:
            weight = weight + force
        else:
            loads.append((reach, force, np.cross(centre - start - x * reach, force)))
    return loads, weight


def _check_beam_against_integrals(module: ModuleType) -> None:
    text = random_arm(18)
    reading = PlainRobot.parse(text)
    gravity = (2.0, -3.0, -8.0)
    chain = chain_of(text, tip="tool", gravity=gravity)
    q7 = dict(zip(chain.joint_names, Q7, strict=True))
    poses = reading.poses(q7)
    rigidities = (1500.0, 7000.0, 4000.0, 2e5)
    for number, subject in ((0, "base"), (1, "link1"), (2, "half2"), (4, "link4"), (7, "tool")):
        start_link = "base" if number == 0 else f"link{number}"
        start = poses[start_link][:3, 3]
        end = poses["tool"][:3, 3] if number == 7 else poses[f"link{number + 1}"][:3, 3]
        length = float(np.linalg.norm(end - start))
        x = (end - start) / length
        joint_axis = next(entry.axis for entry in reading.joints if entry.name == f"joint{max(number, 1)}")
        turning = poses[f"link{max(number, 1)}"][:3, :3] @ joint_axis
        z = unit(turning - x * (x @ turning))
        roll = 0.4
        axes = np.array([x, np.cross(z, x), z]).T @ Rotation.from_euler("x", roll).as_matrix()
        names: dict[str, float | None] = {}
        for name in reading.masses:
            carrier = _chain_link(reading, name)
            if carrier > number:
                names[name] = length
            elif carrier == number:
                names[name] = None
        if number == 1:
            bolt = next(entry.origin for entry in reading.joints if entry.name == "bolt")
            attached = poses["link1"][:3, :3] @ bolt[:3, 3]
            names["bracket"] = float(np.clip(x @ attached, 0, length))
        if number == 7:
            held = next(entry.origin for entry in reading.joints if entry.name == "finger_joint")
            attached = (poses["tool"] @ held)[:3, 3] - start
            names["finger"] = float(np.clip(x @ attached, 0, length))
        loads, weight = beam_loads(reading, names, "base", q7, gravity, start, x, length)
        gi, ei_y, ei_z, ea = rigidities
        at, totals = evaluated(chain, Q7, [module.Beam(link=subject, EI_y=ei_y, EI_z=ei_z, GI=gi, EA=ea, roll=roll)])
        same(in_base(at.posture, totals), integrals(loads, weight, length, axes, rigidities), 1e-13)


def _chain_link(reading: PlainRobot, name: str) -> int:
    """Count the turning joints of the arm between the base and a link."""
    return sum(name in reading.beyond(f"joint{k}") for k in range(1, 8))


def _check_beam_settings(module: ModuleType) -> None:
    """End stiffnesses, missing rigidities, random rigidities and shared loads."""
    chain = one_link(axis=(0, 1, 0), length=LENGTH, gravity=(0.5, 2.0, -9.81), mass=3.0, com=(1, 0.1, 0))
    chain = chain.with_payload(1.5, (0.0, 0.2, 0.1))
    _, plain = evaluated(chain, [0.2], [module.Beam(link="arm", EI=EI, GI=GI)])
    stiff = module.Beam(link="arm", bending_stiffness=EI / LENGTH, torsion_stiffness=GI / LENGTH)
    _, by_end = evaluated(chain, [0.2], [stiff])
    same(*by_end.values(), *plain.values())
    for setting, rows in (({"EI": EI}, (1, 2, 4, 5)), ({"GI": GI}, (3,)), ({"EA": EA}, (0,))):
        _, one = evaluated(chain, [0.2], [module.Beam(link="arm", **setting)])
        (total,) = one.values()
        assert set(np.flatnonzero(total)) <= set(rows)
        if "EA" not in setting:
            same(total[list(rows)], next(iter(plain.values()))[list(rows)])
    # a branch that leaves beyond the end counts at the end, one behind the start does not bend the link
    reading = PlainRobot.parse(branched := branches(2.7, -0.4))
    gravity = (1.0, -4.0, -7.0)
    at, totals = evaluated(
        chain_of(branched, tip="tool", gravity=gravity), [0.0], [module.Beam(link="arm", EI=EI, GI=GI, EA=EA)]
    )
    loads, weight = beam_loads(reading, {"far": LENGTH, "near": 0.0}, "base", {}, gravity, 0.0, np.eye(3)[0], LENGTH)
    same(in_base(at.posture, totals), integrals(loads, weight, LENGTH, np.eye(3), (GI, EI, EI, EA)), 1e-14)
    # random rigidity: the displacement goes as its inverse
    random = module.Beam(link="arm", EI=Uniform(100.0, mean=2 * EI), bending_stiffness=None)
    _, halved = evaluated(chain, [0.2], [random])
    same(next(iter(halved.values()))[[1, 2, 4, 5]], next(iter(plain.values()))[[1, 2, 4, 5]] / 2)
    random = module.Beam(link="arm", bending_stiffness=Uniform(100.0, mean=2 * EI))
    _, scaled = evaluated(chain, [0.2], [random])
    same(next(iter(scaled.values()))[[1, 2, 4, 5]], next(iter(plain.values()))[[1, 2, 4, 5]] / 2 / LENGTH)


def branches(*positions: float) -> str:
    """Return a beam along x with two brackets bolted to it."""
    parts = [
        link("base"),
        joint("hinge", "revolute", "base", "arm"),
        link("arm"),
        joint("flange", "fixed", "arm", "tool", (LENGTH, 0, 0)),
        link("tool"),
    ]
    for name, position in zip(("far", "near"), positions, strict=True):
        parts += [joint(f"bolt_{name}", "fixed", "arm", name, (position, 0.2, 0)), link(name, 1.5, (0.3, 0.1, 0.2))]
    return robot(*parts)
