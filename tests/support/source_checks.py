"""One check for every kind of source, against numbers worked by hand and against a second route.

Each takes the module to check, so that the suite can show that it notices a planted fault. Failures are AssertionErrors.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin import mcpc as parameters_of
from precision_pin.chain import Chain, Load, Posture
from precision_pin.laws import Normal, Uniform
from precision_pin.model import ErrorModel
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.space import Draw, LabelledSpace, Space
from precision_pin.terms import JointValue, Source
from support.oracles import displacements
from support.plain_robot import (
    PlainRobot,
    chain_of,
    inserted,
    joint,
    link,
    motion,
    pose_error,
    random_arm,
    robot,
    unit,
)

MM = 1e-3
Q7 = (0.3, -0.7, 1.1, 0.4, -1.3, 0.8, 0.5)


def evaluated(chain: Chain, q, sources: Sequence[Source], values=None, draws: Sequence[Draw] = ()):
    """Displacement of every target, with components as given and the rest at their means."""
    model = ErrorModel(chain, Space(tuple(draws)), sources)
    at = model.at(q)
    means = dict(zip(model.space.components, model.space.mean, strict=True))
    assert set(values or {}) <= set(means), f"{set(values or {}) - set(means)} are no components: {sorted(means)}"
    return at, displacements(at.terms, means | (values or {}))


def in_base(posture: Posture, totals) -> np.ndarray:
    """The displacement of the only place, turned into base axes."""
    ((place, total),) = totals.items()
    turn = posture.place_pose(place)[:3, :3]
    return np.concatenate([turn @ total[:3], turn @ total[3:]])


def same(actual, expected, tolerance=1e-12) -> None:
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)


# --- axis_install: eqs 18, 19 ---


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


# --- length ---


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
    text = random_arm(11)
    reading = PlainRobot.parse(text)
    chain = chain_of(text, tip="tool")
    q7 = dict(zip(chain.joint_names, Q7, strict=True))
    nominal = reading.poses(q7)
    for target, along in itertools.product(
        ({"joint": "joint4"}, {"frame": "tool"}, {"joint": "joint1"}),
        ("link", "x of joint2", "-y of joint5", "z of joint7", "axis of joint3", "-axis of joint4"),
    ):
        source = module.Length(**target, along=along, parameters=(0.8e-3, "extra"))
        at, _ = evaluated(chain, q7, [source], {}, [Draw("extra", Uniform(1e-3, mean=0.4e-3))])
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
        moved = reading.poses(q7, displaced={("joint", moved_joint): shift})["tool"]
        same(at.exact([[0.4e-3]])[:, 0], pose_error(moved, nominal["tool"]), 1e-14)
        same(at.exact([[0.4e-3]])[:3, 0], 1.2e-3 * direction, 1e-14)


# --- frame ---


def check_frame(module: ModuleType) -> None:
    text = random_arm(12, prismatic=(4,))
    reading = PlainRobot.parse(text)
    chain = chain_of(text, tip="tool")
    q7 = dict(zip(chain.joint_names, Q7, strict=True))
    nominal = reading.poses(q7)["tool"]
    six = np.array([0.03, -0.05, 0.02, 0.3, -0.4, 0.25])
    for where, place in (
        ({"joint": "joint1"}, ("joint", "joint1")),
        ({"joint": "joint4"}, ("joint", "joint4")),
        ({"link": "link2"}, ("joint", "joint3")),
        ({"link": "half2"}, ("joint", "joint3")),
        ({"link": "base"}, ("joint", "joint1")),
        ({"link": "link7"}, ("link", "tool")),
        ({"frame": "half2"}, ("link", "half2")),
        ({"frame": "link5"}, ("link", "link5")),
        ({"frame": "tool"}, ("link", "tool")),
    ):
        names = ("x", "y", "z", "rx", "ry", "rz")
        source = module.Frame(**where, **dict(zip(names, map(float, six), strict=True)))
        at, _ = evaluated(chain, q7, [source])
        moved = reading.poses(q7, displaced={place: inserted(six)})["tool"]
        same(at.exact(np.zeros((0, 1)))[:, 0], pose_error(moved, nominal), 1e-13)
        (subject,) = where.values()
        laws = [Draw(name, Uniform(0.0, mean=value)) for name, value in zip(names, six, strict=True)]
        at, _ = evaluated(chain, q7, [module.Frame(**where, **dict(zip(names, names, strict=True)))], {}, laws)
        same(at.exact(six[:, None])[:, 0], pose_error(moved, nominal), 1e-13)
        assert source.subject == subject


# --- joint_offset ---


def check_joint_offset(module: ModuleType) -> None:
    # R5: 1R, L = 1 m along x, θ = 0, Δθ = 1 mrad; the tip runs on a circle
    chain = one_link()
    at, _ = evaluated(chain, [0.0], [module.JointOffset(joint="hinge", offset=1e-3)])
    same(at.exact(np.zeros((0, 1)))[:3, 0], [np.cos(1e-3) - 1, np.sin(1e-3), 0], 1e-15)
    text = random_arm(13, prismatic=(3, 6))
    reading = PlainRobot.parse(text)
    chain = chain_of(text, tip="tool")
    offsets = np.array([0.1, -0.2, 0.03, 0.15, -0.1, -0.04, 0.2])
    sources = [
        module.JointOffset(joint=name, offset=Normal(0.1)) for name, value in zip(chain.joint_names, offsets, strict=True)
    ]
    values = {f"joint_offset[{name}].offset": value for name, value in zip(chain.joint_names, offsets, strict=True)}
    at, totals = evaluated(chain, Q7, sources, values)
    assert set(totals) == {JointValue(k) for k in range(7)}
    assert at.space.components == tuple(values)
    moved = reading.poses(dict(zip(chain.joint_names, np.add(Q7, offsets), strict=True)))["tool"]
    nominal = reading.poses(dict(zip(chain.joint_names, Q7, strict=True)))["tool"]
    same(at.exact(offsets[:, None])[:, 0], pose_error(moved, nominal), 1e-13)


def one_link(kind="revolute", axis=(0, 0, 1), length=1.0, gravity=(0.0, 0.0, -9.81), **mass) -> Chain:
    return chain_of(
        robot(
            link("base"),
            joint("hinge", kind, "base", "arm", (0, 0, 0), (0, 0, 0), axis),
            link("arm", **mass),
            joint("flange", "fixed", "arm", "tool", (length, 0, 0)),
            link("tool"),
        ),
        gravity=gravity,
    )


# --- joint_compliance: eq 23 ---


def check_joint_compliance(module: ModuleType) -> None:
    # 2 kg at 0.4 m on a hinge about y: the load turns it about +y, so the arm droops
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    at, totals = evaluated(chain, [0.0], [module.JointCompliance(joint="hinge", compliance=1e-4)])
    same(totals[JointValue(0)], [1e-4 * 2.0 * 9.81 * 0.4], 1e-15)
    assert at.exact(np.zeros((0, 1)))[2, 0] < 0
    # a vertical slide sinks by C m g
    chain = one_link("prismatic", mass=2.0, com=(0.4, 0, 0))
    _, totals = evaluated(chain, [0.3], [module.JointCompliance(joint="hinge", compliance=1e-6)])
    same(totals[JointValue(0)], [-1e-6 * 2.0 * 9.81], 1e-15)
    # any arm: against the slope of the potential energy
    text = random_arm(14, prismatic=(5,))
    chain = chain_of(text, tip="tool", gravity=(1.0, -2.0, -9.0))
    reading = PlainRobot.parse(text)
    torque = reading.load_torque(
        chain.joint_names, dict(zip(chain.joint_names, Q7, strict=True)), (1.0, -2.0, -9.0)
    )
    for k, name in enumerate(chain.joint_names):
        source = module.JointCompliance(joint=name, compliance=Uniform(1e-6, mean=1e-5))
        component = f"joint_compliance[{name}].compliance"
        _, totals = evaluated(chain, Q7, [source], {component: 1.7e-5})
        same(totals[JointValue(k)] / 1.7e-5, torque[k : k + 1], 1e-11)


# --- payload ---


def check_payload(module: ModuleType) -> None:
    # hand case: mass and centre both random, on a hinge about y: τ = m g c_x at q = 0
    chain = one_link(axis=(0, 1, 0))
    mass, c_x, c_z, compliance = 1.3, 0.25, -0.1, 2e-4
    source = module.Payload(
        at="tool", mass=Uniform(0.1, mean=1.0), com=(Uniform(0.3), 0.0, Normal(0.1))
    )
    flexible = JointCompliance(joint="hinge", compliance=Uniform(1e-4, mean=1e-4))
    values = {
        "payload[tool].mass": mass,
        "payload[tool].com": c_x,
        "payload[tool].com[2]": c_z,
        "joint_compliance[hinge].compliance": compliance,
    }
    for q in (0.0, 0.6):
        at, totals = evaluated(chain, [q], [source, flexible], values)
        arm = (1 + c_x) * np.cos(q) + c_z * np.sin(q)
        same(totals[JointValue(0)], [compliance * mass * 9.81 * arm], 1e-14)
        assert max(len(term.factors) for term in at.terms) == 3
    # anywhere on any arm: the same as a chain that carries it
    text = random_arm(15, prismatic=(4,))
    for where in ("tool", "link3", "half2", "bracket", "finger"):
        settings = {"at": where, "mass": 2.5, "com": (0.11, -0.07, 0.05)}
        bare = chain_of(text, tip="tool")
        carrying = bare.with_payload(2.5, (0.11, -0.07, 0.05), where)
        for name in bare.joint_names:
            flexible = JointCompliance(joint=name, compliance=1e-3)
            _, by_source = evaluated(bare, Q7, [module.Payload(**settings), flexible])
            expected = 1e-3 * carrying.at(Q7).load_torque[bare.joint_index(name)]
            same(by_source[JointValue(bare.joint_index(name))], [expected], 1e-12)


# --- mcpc: eqs 1, 2 ---


def check_mcpc(module: ModuleType) -> None:
    generator = np.random.default_rng(16)
    for seed, sliding in ((16, ()), (17, (2, 5))):
        chain = chain_of(random_arm(seed, prismatic=sliding), tip="tool")
        nominal = parameters_of.from_chain(chain)
        n = len(chain.joints)
        errors = np.concatenate([np.zeros(n), generator.uniform(-0.8, 0.8, 2 * n + 3), generator.uniform(-0.3, 0.3, 2 * n + 3)])
        alpha, beta, gamma, x, y, z = np.split(
            errors[n:], [n + 1, 2 * n + 2, 2 * n + 3, 3 * n + 4, 4 * n + 5]
        )
        sources = []
        for i, name in enumerate(["base", *(f"link{k}" for k in range(1, n + 1))]):
            last = {"gamma": float(gamma[0]), "z": float(z[0])} if i == n else {}
            sources.append(module.Mcpc(link=name, alpha=alpha[i], beta=beta[i], x=x[i], y=y[i], **last))
        at, _ = evaluated(chain, Q7, sources)
        moved = nominal.perturbed(errors).forward_kinematics(Q7)
        expected = pose_error(moved, nominal.forward_kinematics(Q7))
        same(at.exact(np.zeros((0, 1)))[:, 0], expected, 1e-12)


# --- beam: eq 21 ---

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
    """Gravity and a load that make one component of the wrench at (or weight along) the tip of the beam alone.

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
        expected = np.concatenate(
            [y * (force @ y) * 1.5**3 / (3 * EI), z * (force @ y) * 1.5**2 / (2 * EI)]
        )
        same(in_base(at.posture, totals), expected, 1e-14)


def _turned(axis) -> tuple[float, ...]:
    """An axis of the arm in the axes of joint two, which stands at rpy (0.4, 0.5, 0.6)."""
    return tuple(Rotation.from_euler("xyz", (0.4, 0.5, 0.6)).inv().apply(axis))


def integrals(loads, weight, length, axes, rigidities) -> np.ndarray:
    """Displacement of a cantilever's tip by the unit-load integrals of Mohr, base axes, ``[d; δ]``.

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
    """Free-body loads on a chain link: (reach, force, moment) and its own spread weight, base axes.

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
        joint_axis = next(
            entry.axis for entry in reading.joints if entry.name == f"joint{max(number, 1)}"
        )
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
        at, totals = evaluated(
            chain, Q7, [module.Beam(link=subject, EI_y=ei_y, EI_z=ei_z, GI=gi, EA=ea, roll=roll)]
        )
        same(in_base(at.posture, totals), integrals(loads, weight, length, axes, rigidities), 1e-13)


def _chain_link(reading: PlainRobot, name: str) -> int:
    """How many turning joints of the arm stand between the base and a link."""
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
    # random rigidity: the displacement goes as its inverse
    random = module.Beam(link="arm", EI=Uniform(100.0, mean=2 * EI), bending_stiffness=None)
    _, halved = evaluated(chain, [0.2], [random])
    same(next(iter(halved.values()))[[1, 2, 4, 5]], next(iter(plain.values()))[[1, 2, 4, 5]] / 2)
    random = module.Beam(link="arm", bending_stiffness=Uniform(100.0, mean=2 * EI))
    _, scaled = evaluated(chain, [0.2], [random])
    same(next(iter(scaled.values()))[[1, 2, 4, 5]], next(iter(plain.values()))[[1, 2, 4, 5]] / 2 / LENGTH)


CHECKS: dict[str, Callable[[ModuleType], None]] = {
    "axis_install": check_axis_install,
    "beam": check_beam,
    "frame": check_frame,
    "joint_compliance": check_joint_compliance,
    "joint_offset": check_joint_offset,
    "length": check_length,
    "mcpc": check_mcpc,
    "payload": check_payload,
}
