"""Payload, levelling and warm links: by hand, against arms that carry, lean or are cut into slices."""

from dataclasses import replace
from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Normal, Uniform
from precision_pin.sources.beam import Beam
from precision_pin.sources.bearing_stiffness import BearingStiffness
from precision_pin.sources.force import Force
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.payload import Payload
from precision_pin.terms.term import JointValue
from support.checks.common import Q7, evaluated, in_base, one_link, same, slanted_arm
from support.plain_robot import chain_of, inserted, pose_error, random_arm


def check_payload(module: ModuleType) -> None:
    # hand case: mass and centre both random, on a hinge about y: τ = m g c_x at q = 0
    chain = one_link(axis=(0, 1, 0))
    mass, c_x, c_z, compliance = 1.3, 0.25, -0.1, 2e-4
    source = module.Payload(at="tool", mass=Uniform(0.1, mean=1.0), com=(Uniform(0.3), 0.0, Normal(0.1)))
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


def check_force(module: ModuleType) -> None:
    # hand case: on a hinge about y at height 0, 1 m from the tool: τ_y = z F_x - x F_z + M_y
    chain = one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0))
    flexible = JointCompliance(joint="hinge", compliance=2e-4)
    source = module.Force(
        at="tool",
        force=(Uniform(10.0), 0.0, Normal(5.0, mean=-30.0)),
        moment=(1.0, Uniform(2.0), 3.0),
        point=(0.2, 0.1, 0.3),
    )
    values = {"force[tool].force": 4.0, "force[tool].force[2]": -25.0, "force[tool].moment[1]": 1.5}
    for q in (0.0, 0.6):
        x, z = 1.2 * np.cos(q) + 0.3 * np.sin(q), 0.3 * np.cos(q) - 1.2 * np.sin(q)
        _, totals = evaluated(chain, [q], [source, flexible], values)
        same(totals[JointValue(0)], [2e-4 * (z * 4.0 + x * 25.0 + 1.5)], 1e-15)
        # in axes of the link, the joint feels the same at every angle
        _, totals = evaluated(chain, [q], [replace(source, axes="link"), flexible], values)
        same(totals[JointValue(0)], [2e-4 * (0.3 * 4.0 + 1.2 * 25.0 + 1.5)], 1e-15)
    # any direction: a point of the sphere
    random = module.Force(at="tool", magnitude=Uniform(10.0, mean=50.0), direction="any")
    names = ("magnitude", "direction.x", "direction.y", "direction.z")
    for size, height, turn in ((45.0, 0.6, 1.0), (55.0, -0.8, -2.5)):
        across = np.sqrt(1 - height**2)
        drawn = (size, across * np.cos(turn), across * np.sin(turn), height)
        numbers = {f"force[tool].{name}": value for name, value in zip(names, drawn, strict=True)}
        _, totals = evaluated(chain, [0.0], [random, flexible], numbers)
        same(totals[JointValue(0)], [-2e-4 * size * height], 1e-15)
        _, totals = evaluated(chain, [np.pi / 2], [random, flexible], numbers)
        same(totals[JointValue(0)], [-2e-4 * size * across * np.cos(turn)], 1e-15)
    # anywhere on any arm: a dead force of 2.5 kg of weight is that payload
    text = random_arm(15, prismatic=(4,))
    for where in ("tool", "link3", "half2", "bracket", "finger"):
        bare = chain_of(text, tip="tool")
        carrying = bare.with_payload(2.5, (0.11, -0.07, 0.05), where)
        weight = module.Force(at=where, force=tuple(2.5 * bare.gravity), point=(0.11, -0.07, 0.05))
        for name in bare.joint_names:
            _, by_source = evaluated(bare, Q7, [weight, JointCompliance(joint=name, compliance=1e-3)])
            expected = 1e-3 * carrying.at(Q7).load_torque[bare.joint_index(name)]
            same(by_source[JointValue(bare.joint_index(name))], [expected], 1e-12)


def check_strut(module: ModuleType) -> None:
    # hand case: a hinge about -y lifts an arm; A is h above it, B at r on the arm: L² = h² + r² - 2 h r sin q
    chain, h, r = one_link(axis=(0, -1, 0), gravity=(0.0, 0.0, 0.0)), 0.3, 0.5
    flexible = JointCompliance(joint="hinge", compliance=2e-4)
    ends = {
        "from_": module.StrutEnd(link="base", point=(0.0, 0.0, h)),
        "to": module.StrutEnd(link="arm", point=(r, 0.0, 0.0)),
    }
    gas = {"push": Uniform(30.0, mean=300.0), "rate": Uniform(200.0, mean=2e3), "at_length": Uniform(0.01, mean=0.6)}
    spring = {"rate": Uniform(200.0, mean=2e3), "free_length": Uniform(0.01, mean=0.1)}
    for settings, numbers in (
        (gas, (310.0, 1900.0, 0.605)),
        (spring, (2100.0, 0.095)),
        ({"tension": Uniform(30.0, mean=300.0)}, (280.0,)),
    ):
        source = module.Strut(**ends, **settings)
        values = {f"strut[base-arm].{name}": value for name, value in zip(settings, numbers, strict=True)}
        for q in (-0.4, 0.0, 0.6, 2.2):
            length = np.sqrt(h**2 + r**2 - 2 * h * r * np.sin(q))
            first, *others = numbers
            match tuple(settings):
                case ("push", *_):
                    tension = -(first - others[0] * (length - others[1]))
                case ("rate", *_):
                    tension = first * (length - others[0])
                case _:
                    tension = first
            _, totals = evaluated(chain, [q], [source, flexible], values)
            same(totals[JointValue(0)], [2e-4 * tension * h * r * np.cos(q) / length], 1e-14)
    # between any links of any arm: two opposite forces on its ends, on joints, bearings and beams
    arm = slanted_arm(15, prismatic=(4,))
    places = arm.reading.poses(arm.q)
    sources = [JointCompliance(joint=name, compliance=1e-3) for name in arm.chain.joint_names]
    sources += [BearingStiffness(joint=name, radial=1e6, tilt=1e4) for name in ("joint2", "joint4", "joint6")]
    sources += [Beam(link=name, EI=2e3, GI=1e3, EA=1e6) for name in ("link3", "link5")]
    points = (0.1, -0.2, 0.15), (0.05, 0.1, -0.1)
    for links in (("base", "link5"), ("link5", "link3"), ("half2", "tool"), ("bracket", "finger"), ("link3", "base")):
        start, stop = (place_of(places[link], point) for link, point in zip(links, points, strict=True))
        along = (stop - start) / np.linalg.norm(stop - start)
        force = -(300.0 - 2e3 * (np.linalg.norm(stop - start) - 0.6)) * along
        pair = [
            Force(at=links[0], point=points[0], force=tuple(force)),
            Force(at=links[1], point=points[1], force=tuple(-force)),
        ]
        from_, to = (module.StrutEnd(link=link, point=point) for link, point in zip(links, points, strict=True))
        source = module.Strut(from_=from_, to=to, push=300.0, rate=2e3, at_length=0.6)
        _, expected = evaluated(arm.chain, Q7, [*pair, *sources])
        _, totals = evaluated(arm.chain, Q7, [source, *sources])
        assert totals.keys() == expected.keys()
        for target, total in expected.items():
            same(totals[target], total, 1e-12)


def place_of(pose: np.ndarray, point: tuple[float, float, float]) -> np.ndarray:
    """Return a point of a frame in the base."""
    return pose[:3, :3] @ point + pose[:3, 3]


def check_levelling(module: ModuleType) -> None:
    # 2 kg at 0.4 m along x on an upright hinge, which feels no weight until the base's y side is raised by r:
    # then it falls towards -y, the torque is -m g r 0.4
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    flexible = JointCompliance(joint="hinge", compliance=Uniform(1e-5, mean=1e-4))
    values = {"levelling[base].rx": 1e-3, "joint_compliance[hinge].compliance": 1.1e-4}
    at, totals = evaluated(chain, [0.0], [module.Levelling(rx=Normal(1e-3)), flexible], values)
    same(totals[JointValue(0)], [-1.1e-4 * 2 * 9.81 * 1e-3 * 0.4], 1e-18)
    assert at.posture.load_torque[0] == 0
    # raised at the x side nothing pulls sideways; at 90° it is the x side that counts, its raising is -ry
    for q, tilt, torque in ((0.0, {"ry": 1e-3}, 0.0), (np.pi / 2, {"ry": -1e-3}, 1.0), (0.3, {"rz": 0.5}, 0.0)):
        _, totals = evaluated(chain, [q], [module.Levelling(**tilt), replace(flexible, compliance=1e-4)])
        same(totals[JointValue(0)], [torque * 1e-4 * 2 * 9.81 * 1e-3 * 0.4], 1e-16)
    _check_turned_gravity(module)


def _check_turned_gravity(module: ModuleType) -> None:
    """Compare all that loads bend, with mass, centre, stiffness and tilt random, with gravity turned so."""
    text = random_arm(42, prismatic=(4,))
    gravity, tilt = np.array([1.0, -3.0, -9.0]), np.array([0.02, -0.03, 0.05])
    sources = [
        Payload(at="tool", mass=Uniform(0.1, mean=2.0), com=(Uniform(0.1), 0.0, Uniform(0.1))),
        *(JointCompliance(joint=f"joint{k}", compliance=Uniform(1e-6, mean=1e-5)) for k in (1, 4, 6)),
        Beam(link="link2", EI=Uniform(100.0, mean=900.0), GI=400.0, EA=1e5),
    ]
    straight, tilted = (
        chain_of(text, tip="tool", gravity=tuple(each)) for each in (gravity, gravity - np.cross(tilt, gravity))
    )
    levelling = module.Levelling(rx=Normal(0.01), ry=Normal(0.01), rz=Normal(0.01))
    at, _ = evaluated(straight, Q7, [*sources, levelling])
    assert max(len(term.factors) for term in at.terms) == 3
    other, _ = evaluated(tilted, Q7, sources)
    x = other.space.sample(3, 0, 20)
    tilts = {
        f"levelling[base].{name}": np.full(20, value) for name, value in zip(("rx", "ry", "rz"), tilt, strict=True)
    }
    rows = dict(zip(other.space.components, x, strict=True)) | tilts
    y = np.array([rows[name] for name in at.space.components])
    for engine in ("linear", "exact"):
        np.testing.assert_allclose(getattr(at, engine)(y), getattr(other, engine)(x), rtol=0, atol=1e-13)


def check_thermal(module: ModuleType) -> None:
    # an aluminium arm of 1 m, 2 K warmer: 46 µm longer
    chain = one_link()
    source = module.Thermal(link="arm", expansion=23e-6, temperature_change=2.0)
    at, totals = evaluated(chain, [np.pi / 2], [source])
    same(in_base(at.posture, totals), [0, 46e-6, 0, 0, 0, 0], 1e-18)
    # Roark, cantilevers with 1 K over 0.1 m of height: α ΔT l²/(2h) away from the warm side, turned by α ΔT l/h
    source = module.Thermal(link="arm", expansion=12e-6, gradient=1 / 0.1, across="z of hinge")
    at, totals = evaluated(chain, [0.0], [source])
    same(in_base(at.posture, totals), [0, 0, -60e-6, 0, 120e-6, 0], 1e-18)
    for direction in ("y of hinge", "y of base"):
        source = module.Thermal(link="arm", expansion=12e-6, gradient=10.0, across=direction)
        at, totals = evaluated(chain, [0.0], [source])
        same(in_base(at.posture, totals), [0, -60e-6, 0, 0, 0, -120e-6], 1e-18)
    # along the link a gradient bends nothing, from base axes it turns with the joint
    source = module.Thermal(link="arm", expansion=12e-6, gradient=10.0, across="y of base")
    at, totals = evaluated(chain, [np.pi / 2], [source])
    same(in_base(at.posture, totals), np.zeros(6), 1e-18)
    at, totals = evaluated(chain, [np.pi / 3], [source])
    away = 60e-6 * np.cos(np.pi / 3) * np.array([np.sin(np.pi / 3), -np.cos(np.pi / 3), 0])
    same(in_base(at.posture, totals), [*away, 0, 0, -120e-6 * np.cos(np.pi / 3)], 1e-18)
    _check_whole_arm(module)
    _check_slices(module)


def _check_whole_arm(module: ModuleType) -> None:
    """Check that the tip's position grows by the one factor of every length, and nothing turns."""
    chain = chain_of(random_arm(31), tip="tool")
    source = module.Thermal(expansion=Uniform(1e-6, mean=12e-6), temperature_change=Normal(3.0))
    for change, expansion in ((2.0, 11.5e-6), (300.0, 1e-4)):
        values = {"thermal[arm].expansion": expansion, "thermal[arm].temperature_change": change}
        at, _ = evaluated(chain, Q7, [source], values)
        x = np.array([[values[name]] for name in at.space.components])
        expected = np.concatenate([expansion * change * at.posture.pose[:3, 3], np.zeros(3)])
        for error in (at.linear(x), at.exact(x)):
            np.testing.assert_allclose(error[:, 0], expected, rtol=1e-12, atol=1e-14)


def _check_slices(module: ModuleType) -> None:
    """Compare with a link cut into slices, whose fibres grow as their temperatures say."""
    arm = slanted_arm(32, prismatic=(3,))
    chain, reading, q7 = arm.chain, arm.reading, arm.q
    poses = reading.poses(q7)
    expansion, gradient = 3e-8, 2.0  # second order: 1e-15
    for subject, start, place, warm in (
        ("link4", "link4", ("joint", "joint5"), poses["link2"][:3, 0]),
        ("link7", "link7", ("link", "tool"), -poses["link1"][:3, 2]),
        ("base", "base", ("joint", "joint1"), np.array([0.0, 0.0, 1.0])),
    ):
        across = {"link4": "x of joint2", "link7": "-z of joint1", "base": "z of base"}[subject]
        end = chain.placements[chain.link_frame(subject).link]
        local = poses[start][:3, :3].T @ warm
        moved = _grown(end[:3, 3], local * gradient, expansion)
        displaced = np.linalg.inv(end) @ moved @ end
        tip = reading.poses(q7, displaced={place: displaced})["tool"]
        source = module.Thermal(link=subject, expansion=expansion, gradient=gradient, across=across)
        at, _ = evaluated(chain, q7, [source])
        expected = pose_error(tip, poses["tool"])
        assert np.linalg.norm(expected[:3]) > 1e-9
        np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], expected, rtol=0, atol=3e-14)


def _grown(way: np.ndarray, warming: np.ndarray, expansion: float, slices: int = 200) -> np.ndarray:
    """Return the motion, axes of the link, of what the end of a link along ``way`` (from the origin) carries.

    The temperature rises by ``warming`` (K/m) across the link; growth along it cancels about its middle.
    """
    along = way / np.linalg.norm(way)
    warming = warming - along * (along @ warming)
    corners = [np.cross(along, axis) for axis in np.eye(3)]
    # a slice turns so that a corner r moves along the link as the fibre there grows: (δ × r)·along = growth
    rows = [np.cross(corner, along) for corner in corners] + [along]
    length = np.linalg.norm(way) / slices
    growth = [expansion * (warming @ corner) * length for corner in corners] + [0.0]
    turn = np.linalg.lstsq(np.array(rows), np.array(growth), rcond=None)[0]
    motion = np.eye(4)
    for k in range(slices):
        pivot = inserted([*(way * (k + 0.5) / slices), 0, 0, 0])
        motion = motion @ pivot @ inserted([0, 0, 0, *turn]) @ np.linalg.inv(pivot)
    return motion
