"""Link flexibility, eq 21, by the reference table and by integrals of the bending moment."""

import itertools
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot.places import Load
from support.checks.common import Q7, evaluated, in_base, one_link, same
from support.plain_robot import PlainRobot, chain_of, joint, link, random_arm, robot, unit

LENGTH, EI, GI, EA = 2.0, 8000.0, 1000.0, 1e6


def check_beam(module: ModuleType) -> None:
    _check_beam_cases(module)
    _check_beam_axes(module)
    _check_beam_against_integrals(module)
    _check_beam_own_and_bolted(module)
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


def integrals(loads, spread, length, axes, rigidities) -> np.ndarray:
    """Return the displacement of a cantilever's tip by the unit-load integrals of Mohr, base axes, ``[d; δ]``.

    δ = ∫ C M ds and d = ∫ C M × (tip - s) ds + ∫ N/EA ds, with C = R diag(1/GI, 1/EI_y, 1/EI_z) Rᵀ. ``loads`` are
    (reach, force, moment) about the point of the axis there, ``spread`` (start, stop, force) evenly between two points, or
    one force along the whole; ``rigidities`` those of the whole or (end, rigidities) of its parts; piecewise Gauss, so exact.
    """
    spread = [(0.0, length, spread)] if isinstance(spread, np.ndarray) else spread
    parts = rigidities if isinstance(rigidities[0], tuple) else [(length, rigidities)]
    x = axes[:, 0]
    nodes, weights = np.polynomial.legendre.leggauss(6)
    total = np.zeros(6)
    cuts = {0.0, *(part[0] for part in (*parts, *loads)), *(x for start, stop, _ in spread for x in (start, stop))}
    for start, end in itertools.pairwise(sorted(x for x in cuts if 0 <= x <= length)):
        gi, ei_y, ei_z, ea = next(own for stop, own in parts if start < stop)
        compliance = axes @ np.diag([1 / gi, 1 / ei_y, 1 / ei_z]) @ axes.T
        for node, share in zip(nodes, weights, strict=True):
            s = start + (end - start) * (node + 1) / 2
            moment, force = np.zeros(3), np.zeros(3)
            for begin, stop, push in spread:
                beyond = push * min((stop - s) / (stop - begin), 1.0) if stop > s else np.zeros(3)
                moment = moment + np.cross(x * ((stop + max(s, begin)) / 2 - s), beyond)
                force = force + beyond
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
    """Return the free-body loads on a chain link, (reach, force, moment), and those spread, (start, stop, force), base axes.

    ``names`` maps each link that loads the beam to its reach, to the two ends of the stretch over which the link's own
    body is spread, or to ``(start, stop, "about")`` where another part of the way is spread about its centre of mass, as
    far as it goes to both sides; all clipped to the beam. What has no length there acts at its centre of mass.
    """
    loads, spread = [], []
    for name, (mass, centre) in reading.centres(q, base).items():
        if name not in names:
            continue
        force = mass * np.array(gravity)
        where = names[name]
        if isinstance(where, float):
            loads.append((where, force, np.cross(centre - start - x * where, force)))
            continue
        first, last = sorted(float(np.clip(reach, 0, length)) for reach in where[:2])
        if len(where) == 2 and last > first:
            spread.append((first, last, force))
            continue
        reach = float(x @ (centre - start))
        room = max(min(reach - first, last - reach), 0.0)
        moment = np.cross(centre - start - x * reach, force)
        if room > 1e-9:
            spread.append((reach - room, reach + room, force))
            loads.append((reach, np.zeros(3), moment))
        else:
            reach = float(np.clip(reach, 0, length))
            loads.append((reach, force, np.cross(centre - start - x * reach, force)))
    return loads, spread


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
        names: dict[str, object] = {name: length for name in reading.masses if _chain_link(reading, name) > number}
        names[start_link] = (0.0, length)
        for part, of in (("half2", 2), ("tool", 7)):
            if number == of:
                joined = float(x @ (poses[part][:3, 3] - start))
                names |= {start_link: (0.0, joined), part: (joined, length, "about")}
        if number == 1:
            bolt = next(entry.origin for entry in reading.joints if entry.name == "bolt")
            attached = poses["link1"][:3, :3] @ bolt[:3, 3]
            names["bracket"] = float(np.clip(x @ attached, 0, length))
        if number == 7:
            held = next(entry.origin for entry in reading.joints if entry.name == "finger_joint")
            attached = (poses["tool"] @ held)[:3, 3] - start
            names["finger"] = float(np.clip(x @ attached, 0, length))
        loads, spread = beam_loads(reading, names, "base", q7, gravity, start, x, length)
        gi, ei_y, ei_z, ea = rigidities
        at, totals = evaluated(chain, Q7, [module.Beam(link=subject, EI_y=ei_y, EI_z=ei_z, GI=gi, EA=ea, roll=roll)])
        same(in_base(at.posture, totals), integrals(loads, spread, length, axes, rigidities), 1e-13)


def _chain_link(reading: PlainRobot, name: str) -> int:
    """Count the turning joints of the arm between the base and a link."""
    return sum(name in reading.beyond(f"joint{k}") for k in range(1, 8))


def _check_beam_own_and_bolted(module: ModuleType) -> None:
    """Own kilogramme along a metre of EI 8000 N·m², a gripper of 3 kg where it is, whichever link names the beam."""

    def sag(*parts: str, subject: str = "arm", weight: str = "uniform", gravity=(0.0, 0.0, -9.81)) -> np.ndarray:
        text = robot(link("base"), joint("hinge", "revolute", "base", "front", axis=(0, 1, 0)), *parts)
        beam = module.Beam(link=subject, EI=EI, GI=GI, EA=EA, self_weight=weight)
        (total,) = evaluated(chain_of(text, tip="tool", gravity=gravity), [0.0], [beam])[1].values()
        return total

    def weld(parent: str, child: str, x: float) -> str:
        return joint(f"{parent}_{child}", "fixed", parent, child, (x, 0, 0))

    force = np.array([3.0, -2.0, -9.81])
    arm, heavy = link("arm", 1.0, (0.4, 0, 0)), link("gripper", 3.0, (0.0, 0.2, 0.1))
    held = (weld("arm", "gripper", 1.0), heavy, weld("gripper", "tool", 0.0), link("tool"))
    fronts = (
        (link("front"), weld("front", "arm", 0.0), arm),
        (arm.replace("arm", "front"), weld("front", "arm", 0.0), link("arm")),
    )
    expected = np.array([0, 0, -9.81 * (1 / 8 + 3 / 3) / EI, 0, 9.81 * (1 / 6 + 3 / 2) / EI, 0])
    expected[3] = -3 * 9.81 * 0.2 / GI
    for front in fronts:
        for subject in ("front", "arm", "gripper", "tool"):
            same(sag(*front, *held, subject=subject), expected, 1e-15)
    # no mass known of the arm: the gripper is no beam
    same(sag(link("front"), weld("front", "arm", 0.0), link("arm"), *held)[2], -9.81 / EI, 1e-15)
    # a gripper that is a part of the way itself is spread about its centre of mass as far as it goes to both sides
    for centre, room in ((0.1, 0.1), (0.3, 0.1), (-0.05, 0.0), (0.0, 0.0)):
        body = link("gripper", 3.0, (centre, 0.2, 0.1))
        parts = (*fronts[0], weld("arm", "gripper", 0.6), body, weld("gripper", "tool", 0.4), link("tool"))
        total = sag(*parts, gravity=tuple(force))
        reach, turn = 0.6 + centre, np.cross([0, 0.2, 0.1], 3 * force)
        spread, points = [(0.0, 0.6, force)], [(reach, 3 * force, turn)]
        if room:
            spread, points = [*spread, (reach - room, reach + room, 3 * force)], [(reach, np.zeros(3), turn)]
        axes = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]).T
        same(total, integrals(points, spread, 1.0, axes, (GI, EI, EI, EA)), 1e-15)
        by_centre = sag(*parts, weight="centre", gravity=tuple(force))
        points = [(0.4, force, np.zeros(3)), (reach, 3 * force, turn)]
        same(by_centre, integrals(points, [], 1.0, axes, (GI, EI, EI, EA)), 1e-15)


def _check_beam_settings(module: ModuleType) -> None:
    """End stiffnesses, missing rigidities, random rigidities and shared loads."""
    chain = one_link(axis=(0, 1, 0), length=LENGTH, gravity=(0.5, 2.0, -9.81), mass=3.0, com=(1, 0.1, 0))
    chain = chain.with_payload(1.5, (0.0, 0.2, 0.1))

    def displaced(**settings):
        return evaluated(chain, [0.2], [module.Beam(link="arm", **settings)])[1].values()

    (plain,), (by_end,) = (
        displaced(EI=EI, GI=GI),
        displaced(bending_stiffness=EI / LENGTH, torsion_stiffness=GI / LENGTH),
    )
    same(by_end, plain)
    for setting, rows in (({"EI": EI}, (1, 2, 4, 5)), ({"GI": GI}, (3,)), ({"EA": EA}, (0,))):
        (total,) = displaced(**setting)
        assert set(np.flatnonzero(total)) <= set(rows)
        if "EA" not in setting:
            same(total[list(rows)], plain[list(rows)])
    # random rigidity: the displacement goes as its inverse
    for setting, factor in (("EI", 2), ("bending_stiffness", 2 * LENGTH)):
        (total,) = displaced(**{setting: Uniform(100.0, mean=2 * EI)})
        same(total[[1, 2, 4, 5]], plain[[1, 2, 4, 5]] / factor)
