"""Bearings: axis installation (eqs 18, 19), clearance and flexibility, by hand and by free bodies of any arm."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Circle, Disc, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.axis_install import AxisInstall
from precision_pin.sources.payload import Payload
from support.checks.common import MM, Q7, evaluated, in_base, one_link, same, slanted_arm
from support.plain_robot import PlainRobot, chain_of, inserted, joint, limits, link, pose_error, robot, unit


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


GRAVITY = (1.0, -2.0, -9.0)


def check_clearance(module: ModuleType) -> None:
    _check_upright_hinge(module)
    _check_hanging_beam(module)
    _check_random_directions(module)
    _check_any_arm(module)
    _check_each_robot(module)


def _check_upright_hinge(module: ModuleType) -> None:
    # 2 kg at 0.4 m on an upright hinge, bearings at z = 0 and 100 mm: the weight tips the shaft about +y with 7.848 N·m,
    # so the upper journal is pressed to the load's side with 78.48 N and the lower one away from it
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    for q in (0.0, 0.7):
        ahead = np.array([np.cos(q), np.sin(q), 0])
        tipping = np.array([-np.sin(q), np.cos(q), 0])
        source = module.Clearance(joint="hinge", diametral=(0.02 * MM, 0.06 * MM), axial=0.1 * MM, span=0.1, band=1.0)
        at, totals = evaluated(chain, [q], [source])
        shift = -0.01 * MM * ahead + (0, 0, -0.05 * MM)
        same(totals[chain.seat(0)], [*shift, *(0.04 * MM / 0.1 * tipping)], 1e-15)
        assert at.exact(at.space.mean[:, None])[2, 0] < -0.4 * MM
        # 30 mm below the bearings the axis lies off by the line through both journals
        source = module.Clearance(joint="hinge", diametral=(0.02 * MM, 0.06 * MM), start=0.03, span=0.1, band=1.0)
        _, totals = evaluated(chain, [q], [source])
        same(totals[chain.seat(0)], [*(-0.022 * MM * ahead), *(0.4 * MM * tipping)], 1e-15)


def _check_hanging_beam(module: ModuleType) -> None:
    # a lying hinge with the weight over the bearings' middle: 9.81 N on either, both go down, nothing tips
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0.05, 0))
    source = module.Clearance(joint="hinge", diametral=(0.02 * MM,), span=0.1, band=9.8)
    at, totals = evaluated(chain, [0.0], [source])
    same(in_base(at.posture, totals), [0, 0, -0.01 * MM, 0, 0, 0], 1e-15)
    # just below the band: both journals anywhere
    source = module.Clearance(joint="hinge", diametral=(0.02 * MM,), span=0.1, band=9.82)
    _, totals = evaluated(chain, [0.0], [source])
    same(totals[chain.seat(0)], np.zeros(6), 1e-18)
    # at a third of the span A carries 13.08 N and goes down, B carries 6.54 N, below the band, and lies anywhere
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0.02, 0))
    source = module.Clearance(joint="hinge", diametral=(0.02 * MM,), span=0.06, band=6.6)
    values = {f"clearance[hinge].B.{axis}": value for axis, value in (("x", 0.6), ("y", -0.8))}
    at, totals = evaluated(chain, [0.0], [source], values)
    # aligned axes here: z on y by a quarter turn about -x, so (x, y, z) of the seat are (x, -z, y) of the base
    a, b = np.array([0, 0, -0.01 * MM]), 0.01 * MM * np.array([0.6, 0, 0.8])
    same(in_base(at.posture, totals), [*a, *(np.cross((0, 1, 0), b - a) / 0.06)], 1e-15)


def _check_random_directions(module: ModuleType) -> None:
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    for law, expected in (("circle", Circle(1.0)), ("disc", Disc(1.0))):
        source = module.Clearance(joint="hinge", diametral=(1.0,), span=0.1, direction="random", law=law, scope="pose")
        assert [(draw.law, draw.scope) for draw in source.own_draws("c")] == [(expected, Scope.POSE)] * 2
    # anywhere in the disc: installation errors of half the diameter
    values = {"A.x": 0.6, "A.y": -0.3, "B.x": -0.2, "B.y": 0.8, "side": -0.7}
    settings = {"joint": "hinge", "span": 0.08, "start": -0.03}
    source = module.Clearance(diametral=(0.2 * MM,), direction="random", law="disc", axial=0.3 * MM, **settings)
    _, totals = evaluated(chain, [0.7], [source], {f"clearance[hinge].{key}": value for key, value in values.items()})
    installed = AxisInstall(diameter=0.2 * MM, **settings)
    scaled = {f"axis_install[hinge].{key}": 0.1 * MM * value for key, value in values.items() if key != "side"}
    _, expected = evaluated(chain, [0.7], [installed], scaled)
    same(totals[chain.seat(0)], expected[chain.seat(0)] + [0, 0, -0.7 * 0.15 * MM, 0, 0, 0], 1e-16)
    # of the same spread
    at = ErrorModel(
        chain, Space(), [module.Clearance(diametral=(0.2 * MM,), direction="random", law="disc", **settings)]
    )
    np.testing.assert_allclose(
        at.at([0.7]).covariance, ErrorModel(chain, Space(), [installed]).at([0.7]).covariance, rtol=1e-12, atol=1e-24
    )


def _check_any_arm(module: ModuleType) -> None:
    """Balance the arm beyond the joint on its bearings; lay the axis through the journals by definition."""
    arm = slanted_arm(31, prismatic=(3, 6), gravity=GRAVITY)
    chain, reading, q = arm.chain, arm.reading, arm.q
    for number, name in enumerate(chain.joint_names):
        for pads_on in ("child", "parent"):
            slides = bool(chain.prismatic[number])
            seat, axis, force, moment = free_body(reading, name, q, GRAVITY)
            travel = q[name] if slides and pads_on == "child" else 0.0
            sizes, start, span, axial = (0.07 * MM, 0.03 * MM), -0.02, 0.11, 0.0 if slides else 0.04 * MM
            heights = (start + travel, start + travel + span)
            across = np.linalg.svd(axis[None])[2][1:]
            # two forces across the axis that carry what acts across it
            balance = np.block([[across @ across.T] * 2, [across @ np.cross(h * axis, across).T for h in heights]])
            pressed = np.linalg.solve(balance, np.concatenate([across @ force, across @ moment])).reshape(2, 2)
            shifts = [size / 2 * push / np.linalg.norm(push) for size, push in zip(sizes, pressed, strict=True)]
            # the small motion across the axis that brings both points of it there
            motion = np.block([[np.eye(2), across @ np.cross(across, h * axis).T] for h in heights])
            found = np.linalg.solve(motion, np.concatenate(shifts))
            shift = across.T @ found[:2] + axis * np.sign(axis @ force) * axial / 2
            source = module.Clearance(
                joint=name, diametral=sizes, span=span, start=start, axial=axial, band=1e-3, pads_on=pads_on
            )
            at, totals = evaluated(chain, Q7, [source])
            assert not any(term.factors or term.loaded for term in at.terms)
            same(seat[:3, :3].T @ at.posture.place_pose(chain.seat(number))[:3, :3], np.eye(3))
            same(in_base(at.posture, totals) / MM, np.concatenate([shift, across.T @ found[2:]]) / MM, 1e-11)


def free_body(reading: PlainRobot, name: str, q, gravity):
    """Return a joint's seat, its axis, and the force and moment about the seat's origin of all beyond it, base axes."""
    (entry,) = (entry for entry in reading.joints if entry.name == name)
    seat = reading.poses(q)[entry.parent] @ entry.origin
    force, moment = np.zeros(3), np.zeros(3)
    for body in reading.beyond(name):
        if body in reading.masses:
            mass, centre = reading.centres(q)[body]
            force += mass * np.array(gravity)
            moment += np.cross(centre - seat[:3, 3], mass * np.array(gravity))
    return seat, seat[:3, :3] @ entry.axis, force, moment


def _check_each_robot(module: ModuleType) -> None:
    # a load of 1.5 to 2.5 kg at 0.4 m tips the shaft of an upright hinge in one direction: of each robot as of the mean
    load = Payload(at="tool", mass=Uniform(0.5, mean=2.0), com=(0.4, 0.1, 0.0))
    for band in (1.0, 85.0):
        source = module.Clearance(joint="hinge", diametral=(0.02 * MM,), axial=0.1 * MM, span=0.1, band=band)
        model = ErrorModel(one_link(length=0.0), Space(), [load, source])
        x = model.space.sample(0, 0, 200)
        each = model.at([0.3], approach=[1]).linear(x)
        pressed = 9.81 * x[0] * np.hypot(0.4, 0.1) / 0.1 >= band
        assert 0.2 < pressed.mean() < 0.8 or (band == 1.0 and pressed.all())
        ahead = np.array([np.cos(0.3 + np.arctan2(0.1, 0.4)), np.sin(0.3 + np.arctan2(0.1, 0.4))])
        # the journal at the origin is pushed away from the load, and the shaft hangs on its lower end
        same(each[:2, pressed] / MM, np.broadcast_to(-0.01 * ahead[:, None], (2, pressed.sum())), 1e-12)
        same(np.hypot(*each[:2, ~pressed]) / MM, 0.01, 1e-9)
        heavy = 9.81 * x[0] >= band
        same(each[2] / MM, np.where(heavy, -0.05, 0.05 * x[model.space.index["clearance[hinge].side"]]), 1e-12)


RADIAL, AXIAL, TILT, ROLL = 3e6, 5e6, 2e4, 7e3


WAVES = (("x", np.cos), ("y", np.sin))


def check_run_out(module: ModuleType) -> None:
    chain, a, b, t, height = bearing(), 8e-6, 3e-6, 1e-5, 0.06
    source = module.RunOut(joint="hinge", radial=a, axial=b, tilt=Uniform(1e-6, mean=t), order=2, at_height=height)
    phases = {"radial": 0.4, "axial": -1.0, "tilt": 2.0}
    values = {f"run_out[hinge].{name}_phase.x": np.cos(phase) for name, phase in phases.items()}
    values |= {f"run_out[hinge].{name}_phase.y": np.sin(phase) for name, phase in phases.items()}
    for q in (0.0, 0.7, -2.5):
        _, totals = evaluated(chain, [q], [source], values | {"run_out[hinge].tilt": 1.1e-5})
        ((place, total),) = totals.items()
        assert place == chain.seat(0)
        angles = [2 * q + phases[name] for name in ("radial", "axial", "tilt")]
        tilt = 1.1e-5 * np.array([np.cos(angles[2]), np.sin(angles[2]), 0])
        # the point of the axis at this height is displaced by the radial and axial motion
        shift = np.array([a * np.cos(angles[0]), a * np.sin(angles[0]), b * np.cos(angles[1])])
        same(total[:3] + np.cross(tilt, [0, 0, height]), shift, 1e-19)
        same(total[3:], tilt, 1e-19)
    # E d(θ₁) d(θ₂)ᵀ of a whirl of order 2 between two angles 30° apart (of an independent code)
    model = ErrorModel(chain, Space(), [module.RunOut(joint="hinge", radial=a, order=2)])
    first, second = (model.at([angle]).arm for angle in (0.2, 0.2 + np.pi / 6))
    jacobians = [at.table.displacement_slopes(model.space.mean)[0].slopes[:2] for at in (first, second)]
    cross = jacobians[0] @ model.space.covariance @ jacobians[1].T
    same(cross, [[1.6e-11, 2.7712812921102036e-11], [-2.7712812921102036e-11, 1.6e-11]], 1e-21)
    # with phases of their own x and y do not go together
    apart = ErrorModel(chain, Space(), [module.RunOut(joint="hinge", radial=a, order=1, phases="independent")])
    slopes = apart.at([0.7]).table.displacement_slopes(apart.space.mean)[0].slopes[:2]
    same(slopes @ apart.space.covariance @ slopes.T, np.eye(2) * a**2 / 2, 1e-20)
    phases = {"radial_phase": 0.4, "radial_phase[1]": -1.9, "axial_phase": 1.1}
    values = {f"run_out[hinge].{name}.{part}": wave(phase) for name, phase in phases.items() for part, wave in WAVES}
    source = module.RunOut(joint="hinge", radial=a, axial=b, phases="independent")
    _, totals = evaluated(chain, [0.7], [source], values)
    same(totals[chain.seat(0)][:3], [a * np.cos(1.1), a * np.sin(-1.2), b * np.cos(1.8)], 1e-19)
    # along the axis order 1 is no geometry
    _, totals = evaluated(chain, [0.7], [module.RunOut(joint="hinge", axial=b)], dict([*values.items()][4:]))
    same(totals[chain.seat(0)][:3], [0, 0, b * np.cos(1.8)], 1e-19)


ERRORS = ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX")
RAIL = """\
travel [mm], ECX [urad], EXX [um], EBX [urad], EYX [um], EAX [mrad], EZX [um]
500, 300, 40, -200, 90, 0.5, -70
100, 100, 10, 0, 30, 0.3, -10
-100, -900, -20, 400, -30, -0.1, 50
"""


def measured_rail(travel: float) -> np.ndarray:
    """Return the six errors of RAIL, SI, half way between rows that are further out."""
    rows = {
        -0.1: (-20, -30, 50, -100, 400, -900),
        0.0: (-5, 0, 20, 100, 200, -400),
        0.1: (10, 30, -10, 300, 0, 100),
        0.3: (25, 60, -40, 400, -100, 200),
        0.5: (40, 90, -70, 500, -200, 300),
    }
    return 1e-6 * np.array(rows[travel])


def two_slides(axis=(1.0, 0.0, 0.0)) -> tuple[Chain, Callable[..., np.ndarray]]:
    """Return two slides and a tool, and the tool's pose as a product of matrices with E after the motion of each slide."""
    first, second, tool = (0.1, 0.2, 0.3, 0.4, -0.5, 0.9), (0.05, -0.1, 0.6, -1.2, 0.3, 0.2), (0.2, 0.3, -0.4, 0, 0, 0)
    chain = chain_of(
        robot(
            *(link(name) for name in ("base", "table", "ram", "tool")),
            joint("x", "prismatic", "base", "table", first[:3], first[3:], axis, limits(-0.2, 0.8)),
            joint("y", "prismatic", "table", "ram", second[:3], second[3:], (0, 1, 0), limits(-0.5, 0.5)),
            joint("flange", "fixed", "ram", "tool", tool[:3]),
        )
    )

    def placed(six):
        result = inserted([*six[:3], 0, 0, 0])
        result[:3, :3] = Rotation.from_euler("xyz", six[3:]).as_matrix()
        return result

    def pose(x, y, errors=((0,) * 6, (0,) * 6)):
        one = placed(first) @ inserted([*(x * np.array(axis)), 0, 0, 0]) @ inserted(errors[0])
        return one @ placed(second) @ inserted([0, y, 0, 0, 0, 0]) @ inserted(errors[1]) @ placed(tool)

    return chain, pose


def check_guide(module: ModuleType) -> None:
    # X, Y, Z are the frame's for a joint along x, and the next ones in turn for others; a slanted joint turns those of the
    # nearest about what is normal to both
    turns = {axis: np.roll(np.eye(3), -k, axis=1) for k, axis in enumerate(((1, 0, 0), (0, 1, 0), (0, 0, 1)))}
    turns[0.8, 0.6, 0.0] = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]).T
    turns[0.0, -0.6, 0.8] = np.array([[0, -0.6, 0.8], [1, 0, 0], [0, 0.8, 0.6]]).T
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "rail.csv"
        file.write_text(RAIL, encoding="utf-8")
        for axis, axes in turns.items():
            chain, pose = two_slides(axis)
            for travel in (-0.1, 0.0, 0.1, 0.3, 0.5):
                errors = np.concatenate([axes @ part for part in np.split(measured_rail(travel), 2)])
                at = ErrorModel(chain, Space(), [module.Guide(joint="x", file=file)]).at([travel, 0.2])
                same(at.error_at_means, pose_error(pose(travel, 0.2, (errors, np.zeros(6))), pose(travel, 0.2)), 1e-12)
    # harmonics on both slides, the second along its frame's y; the first over its limits, 1 m
    chain, pose = two_slides()
    tolerances = dict(
        zip(
            ERRORS, ((30e-6, 8e-6), (20e-6, 6e-6), (10e-6, 4e-6), (5e-4, 1e-4), (4e-4, 2e-4), (3e-4, 3e-4)), strict=True
        )
    )
    sources = [
        module.Guide(joint="x", **tolerances, order=(1.0, 3.0)),
        module.Guide(joint="y", EYX=(Uniform(2e-6, mean=20e-6),), length=0.4, short_carriage=True),
        module.Guide(joint="y", EZX=(12e-6,), order=(2.0,), length=0.4, short_carriage=True),
    ]
    model = ErrorModel(chain, Space(), sources)
    phases = dict(zip(ERRORS, np.linspace(-2.0, 2.5, 12).reshape(6, 2), strict=True))
    names = {
        f"guide[x].{name}_phase{suffix}": phases[name][k] for name in ERRORS for k, suffix in enumerate(("", "[1]"))
    }
    labels = dict(zip(("y", "z"), model.labels[1:], strict=True))
    names |= {f"{labels['y']}.EYX_phase": 0.7, f"{labels['z']}.EZX_phase": -1.1}
    values = {
        f"{name}.{part}": wave(phase) for name, phase in names.items() for part, wave in (("x", np.cos), ("y", np.sin))
    }
    values[f"{labels['y']}.EYX"] = 21e-6
    x = np.array([values[name] for name in model.space.components])
    for q in ((0.0, 0.0), (0.35, -0.2), (-0.15, 0.45)):
        first = [
            sum(
                t / 2 * np.sin(2 * np.pi * n * q[0] + phases[name][k])
                for k, (t, n) in enumerate(zip(tolerances[name], (1, 3), strict=True))
            )
            for name in ERRORS
        ]
        angles = 2 * np.pi * q[1] / 0.4 + 0.7, 4 * np.pi * q[1] / 0.4 - 1.1
        straight = 21e-6 / 2 * np.sin(angles[0]), 12e-6 / 2 * np.sin(angles[1])
        slopes = 21e-6 / 2 * 2 * np.pi / 0.4 * np.cos(angles[0]), 12e-6 / 2 * 4 * np.pi / 0.4 * np.cos(angles[1])
        # X is y of the frame, Y its z, Z its x; a rise in Y turns the carriage about Z, a rise in Z about -Y
        second = np.array([straight[1], 0, straight[0], slopes[0], 0, -slopes[1]])
        expected = pose_error(pose(*q, (first, second)), pose(*q))
        same(model.at(q).exact(x[:, None])[:, 0], expected, 1e-12)
    # cov of an error at two travels, a Σ a_n²/2 cos 2πnΔ/L (of an independent code): 6 and 3 µm, orders 1 and 2, 1 m
    model = ErrorModel(chain, Space(), [module.Guide(joint="x", EXX=(12e-6, 6e-6), order=(1.0, 2.0), length=1.0)])
    slopes = {
        lag: model.at([0.05 + lag, 0.0]).table.displacement_slopes(model.space.mean)[0].slopes[0]
        for lag in (0, 0.1, 0.25, 0.5)
    }
    for lag, expected in (
        (0, 4.743416490252569e-06**2),
        (0.1, 1.5952882373436316e-11),
        (0.25, -4.5e-12),
        (0.5, -1.35e-11),
    ):
        same(slopes[0] @ model.space.covariance @ slopes[lag], expected, 1e-21)


def check_bearing_stiffness(module: ModuleType) -> None:
    _check_hinges(module)
    _check_two_bearings(module)
    _check_stiff_arm(module)


def _check_hinges(module: ModuleType) -> None:
    # 2 kg at 0.4 m on an upright hinge: 19.62 N down the axis, 7.848 N·m that tip it about +y; the arm droops
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    source = module.BearingStiffness(joint="hinge", radial=RADIAL, axial=AXIAL, tilt=TILT)
    at, totals = evaluated(chain, [0.0], [source])
    same(totals[chain.seat(0)], [0, 0, -19.62 / AXIAL, 0, 7.848 / TILT, 0], 1e-19)
    assert at.exact(np.zeros((0, 1)))[2, 0] < -19.62 / AXIAL
    assert all(term.loaded for term in at.terms)
    # a lying hinge: all radial; what turns it about its axis is the drive's
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    at, totals = evaluated(chain, [0.0], [source])
    same(in_base(at.posture, totals), [0, 0, -19.62 / RADIAL, 0, 0, 0], 1e-19)
    # an upright slide with a carriage: tips and rolls, and leaves the weight to the drive
    chain = one_link("prismatic", mass=2.0, com=(0.4, 0.1, 0.3), gravity=(0.0, -9.81, -9.81))
    source = module.BearingStiffness(joint="hinge", radial=RADIAL, tilt=TILT, roll=ROLL)
    for pads_on, lever in (("child", 0.3), ("parent", 0.5)):
        source = module.BearingStiffness(joint="hinge", radial=RADIAL, tilt=TILT, roll=ROLL, pads_on=pads_on)
        _, totals = evaluated(chain, [0.2], [source])
        # (0.4, 0.1, lever) × (0, -19.62, -19.62) about the pads; the rail's origin lies 0.2 m below those of a carriage
        turn = np.array([19.62 * (lever - 0.1) / TILT, 0.4 * 19.62 / TILT, -0.4 * 19.62 / ROLL])
        shift = np.array([0, -19.62 / RADIAL, 0]) + np.cross(turn, (0, 0, lever - 0.5))
        same(totals[chain.seat(0)], [*shift, *turn], 1e-18)


def _check_two_bearings(module: ModuleType) -> None:
    # an upright shaft on springs of 1e6 N/m at z = -20 and 60 mm, with 19.62 N along x at z = 100 mm and 7.848 N·m about
    # y from the weight, so 9.81 N·m in all: they get (9.81 + 0.02·19.62)/0.08 = 127.53 N above, -107.91 N below
    chain = one_link(mass=2.0, com=(0.4, 0, 0.1), gravity=(9.81, 0.0, -9.81))
    source = module.BearingStiffness(joint="hinge", radial=2e6, tilt=1e6 * 0.08**2 / 2, centre=0.02)
    _, totals = evaluated(chain, [0.0], [source])
    below, above = -107.91e-6, 127.53e-6
    tipped = (above - below) / 0.08
    same(totals[chain.seat(0)], [below + 0.02 * tipped, 0, 0, 0, tipped, 0], 1e-17)


def _check_stiff_arm(module: ModuleType) -> None:
    arm = slanted_arm(32, prismatic=(2, 5), gravity=GRAVITY)
    chain, reading, q = arm.chain, arm.reading, arm.q
    for number, name in enumerate(chain.joint_names):
        slides = bool(chain.prismatic[number])
        _, axis, force, moment = free_body(reading, name, q, GRAVITY)
        along = np.outer(axis, axis)
        across = np.eye(3) - along
        pads_on = "parent" if number == 4 else "child"
        lever = (0.07 + (q[name] if slides and pads_on == "child" else 0.0)) * axis
        settings = {"roll": ROLL, "pads_on": pads_on} if slides else {"axial": AXIAL}
        source = module.BearingStiffness(
            joint=name, radial=Uniform(1e6, mean=RADIAL), tilt=TILT, centre=0.07, **settings
        )
        values = {f"bearing_stiffness[{name}].radial": 3.7e6}
        at, totals = evaluated(chain, Q7, [source], values)
        assert all(term.loaded for term in at.terms)
        turn = across @ (moment - np.cross(lever, force)) / TILT
        shift = across @ force / 3.7e6
        if slides:
            turn = turn + along @ moment / ROLL
        else:
            shift = shift + along @ force / AXIAL
        same(in_base(at.posture, totals) * 1e6, np.concatenate([shift + np.cross(turn, -lever), turn]) * 1e6, 1e-9)
