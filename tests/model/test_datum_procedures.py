"""Errors against datums of arms of other shapes: robots simulated one by one, and what must hold for any of them."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from model.robot_by_robot import Robots
from precision_pin import Chain, Draw, ErrorModel, Normal, Scope, Space, Uniform
from precision_pin.draws.expressions import Component
from precision_pin.robot.datums import Datum
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.sources import Frame, JointCompliance, JointOffset, Payload
from support.plain_robot import PlainRobot, chain_of, gantry, joint, link, planar_arm, random_arm, robot

AXES = ("x", "y", "z", "rx", "ry", "rz")
SIZES = np.array([2e-4, 2e-4, 2e-4, 5e-4, 5e-4, 5e-4])
MASS, COM = 1.5, (0.02, -0.03, 0.05)


def scara() -> str:
    """Return two arms that turn in a plane, a quill that slides and turns."""
    names = ("base", "upper", "lower", "quill", "spindle", "tool")
    weights = (
        link("base"),
        *(link(name, 1.0 + k, (0.1, 0.01, 0.02)) for k, name in enumerate(names[1:5])),
        link("tool"),
    )
    return robot(
        *weights,
        joint("j1", "revolute", "base", "upper", (0, 0, 0.4), (0.02, -0.03, 0)),
        joint("j2", "revolute", "upper", "lower", (0.35, 0, 0.05), (-0.01, 0.02, 0)),
        joint("j3", "prismatic", "lower", "quill", (0.3, 0, 0), (3.1, 0.03, 0)),
        joint("j4", "revolute", "quill", "spindle"),
        joint("flange", "fixed", "spindle", "tool", (0.05, 0.02, 0.1)),
    )


@cache
def arm(name: str) -> tuple[ErrorModel, PlainRobot, Any]:
    """Return the model of an arm with gravity, its plain reading, and a random generator for its poses."""
    if name == "panda":
        path = example_urdfs()["panda"]
        text, chain = path.read_text(encoding="utf-8"), Chain.from_urdf(path, "panda_hand_tcp")
    else:
        text = scara() if name == "scara" else random_arm(5, joints={"five": 5, "six": 6}[name])
        chain = chain_of(text, tip="tool")
    names, tip = chain.joint_names, chain.tip
    space = Space((Draw("slip", Normal(5e-5, mean=2e-5), Scope.VISIT), Draw("again", Uniform(5e-5), Scope.POSE)))
    frames = [{"frame": chain.base}, *({"joint": name} for name in names), {"frame": tip}]
    sources = [
        *(Frame(**place, **dict(zip(AXES, map(Normal, SIZES.tolist()), strict=True))) for place in frames),
        JointOffset(joint=names[0], offset=Normal(3e-4, mean=2e-4)),
        JointOffset(joint=names[1], offset="slip"),
        JointOffset(joint=names[-1], offset=Component("slip") * 2 + Component("again")),
        Payload(at=tip, mass=Uniform(0.3, mean=MASS), com=COM),
        *(JointCompliance(joint=name, compliance=Uniform(3e-6, mean=1e-5)) for name in names[:3]),
    ]
    return ErrorModel(chain, space, sources), PlainRobot.parse(text), np.random.default_rng(len(names))


def robots(model: ErrorModel, reading: PlainRobot, x: np.ndarray) -> Robots:
    """Return the robots with components ``(d, n)`` of a model, made of its names alone."""
    names, tip, value = model.chain.joint_names, model.chain.tip, dict(zip(model.space.components, x, strict=True))
    places = {}
    for place in (("link", model.chain.base), *(("joint", name) for name in names), ("link", tip)):
        places[place] = np.array([value[f"frame[{place[1]}].{axis}"] for axis in AXES]).T
    prefixes = [f"datum[{d.name}].{k + 1} " for d in model.datums for k in range(len(d.visits))] + [""]
    held = PlainRobot(reading.joints, {tip: (1.0, np.array(COM))}, reading.root)

    def angles(visit: int, at: np.ndarray) -> np.ndarray:
        values = dict(zip(names, at, strict=True))
        torque, weight = (r.load_torque(names, values, base=model.chain.base) for r in (reading, held))
        errors = np.zeros((x.shape[1], len(names)))
        for k, name in enumerate(names[:3]):
            load = torque[k] + value[f"payload[{tip}].mass"] * weight[k]
            errors[:, k] = value[f"joint_compliance[{name}].compliance"] * load
        slip, again = (value[f"{prefixes[visit]}{draw}"] for draw in ("slip", "again"))
        errors[:, 0] += value[f"joint_offset[{names[0]}].offset"]
        errors[:, 1] += slip
        errors[:, -1] += 2 * slip + again
        return errors

    return Robots(reading, names, tip, places, angles, x.shape[1])


def noise_of(model: ErrorModel, datum: Datum, x: np.ndarray) -> np.ndarray:
    """Return the noise of a datum, ``(M, n, 6)``."""
    value, none = dict(zip(model.space.components, x, strict=True)), np.zeros(x.shape[1])
    names = [[f"datum[{datum.name}].{number} {axis}" for axis in AXES] for number, _ in datum.noise]
    return np.array([[value.get(name, none) for name in row] for row in names]).transpose(0, 2, 1)


def place(generator) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=generator).as_matrix()
    pose[:3, 3] = generator.uniform(-0.4, 0.4, 3)
    return pose


def postures(model: ErrorModel, count: int, seed: int) -> list[np.ndarray]:
    generator, chain = np.random.default_rng(seed), model.chain
    bent = {7: [0, -0.6, 0, -2.0, 0, 1.6, 0.8], 4: [0.4, 1.6, 0.1, 0.4]}
    centre = np.array(bent.get(len(chain.joints), [0.4] * len(chain.joints)))
    return [centre + generator.uniform(-0.7, 0.7, centre.size) for _ in range(count)]


def pivots(model: ErrorModel, count: int, seed: int) -> list[np.ndarray]:
    """Return poses with the tip at one point."""
    first, *others = postures(model, 3 * count, seed)
    target, found = model.chain.at(first).pose[:3, 3], [first]
    for q in others:
        q = first + (0.6 if first.size == 7 else 1.2) * (q - others[0])
        for _ in range(40):
            at = model.chain.at(q)
            q = q + np.linalg.pinv(at.joint_jacobian[:3]) @ (target - at.pose[:3, 3])
        if np.linalg.norm(model.chain.at(q).pose[:3, 3] - target) < 1e-13:
            found.append(q)
    return found[:count]


@cache
def datum(name: str, kind: str, seed: int = 1) -> Datum:
    """Return a datum of an arm, with noise."""
    model, generator = arm(name)[0], np.random.default_rng(seed)
    camera = {key: place(generator) for key in ("camera", "board", "grasp")}
    camera |= {"noise": (1e-4, 2e-4), "weights": (1e-4, 6e-4)}
    camera["on"] = {"panda": "panda_link8", "scara": "spindle", "five": "link5", "six": "link6"}[name]
    several = postures(model, 7, seed)
    if kind == "best_fit":
        return Datum.best_fit(several[:5], 1e-4)
    if kind == "reflector":
        return Datum.best_fit(several[:5], 1e-4, point=(0.06, -0.04, 0.09), name="reflector")
    if kind == "taught":
        return Datum.taught(several[0], {"std": 1e-4, "attitude": 3e-4})
    if kind == "three_points":
        return Datum.three_points(*several[:3], "0.1 mm")
    if kind == "tool_pivot":
        return Datum.tool_pivot(pivots(model, 5, seed), 1e-4)
    return (
        Datum.hand_eye(several[:6], several[6], **camera)
        if kind == "hand_eye"
        else Datum.eye_to_hand(several[:6], **camera)
    )


def carry_out(robots: Robots, model: ErrorModel, x: np.ndarray, task: np.ndarray) -> np.ndarray:
    """Return the errors ``(6, n)`` of robots that carry out the procedures of a model."""
    first = 0
    for entry in model.datums:
        poses, noise = [model.configuration(q) for q in entry.visits], noise_of(model, entry, x)
        if entry.kind == "taught":
            robots.taught(first, poses[0], noise)
        elif entry.kind in ("hand_eye", "eye_to_hand"):
            setting = (entry.on, entry.camera, entry.board, entry.grasp, entry.weights)
            if entry.kind == "hand_eye":
                robots.hand_eye(first, poses[:-1], poses[-1], noise, task, *setting)
            else:
                robots.eye_to_hand(first, poses, noise, task, *setting)
        elif entry.kind == "best_fit":
            robots.best_fit(first, poses, noise, np.zeros(3) if entry.point is None else np.array(entry.point))
        else:
            getattr(robots, entry.kind)(first, poses, noise)
        first += len(poses)
    return robots.errors(task).T


SIMULATED = [
    ("scara", ("best_fit",)), ("panda", ("tool_pivot", "three_points")), ("scara", ("three_points",)),
    ("scara", ("taught",)), ("five", ("three_points", "hand_eye")),
    ("six", ("best_fit", "three_points")), ("six", ("hand_eye",)), ("six", ("three_points", "eye_to_hand")),
    ("six", ("tool_pivot", "taught")), ("scara", ("reflector",)), ("six", ("three_points", "reflector")),
]  # fmt: skip


@pytest.mark.fast(1)
@pytest.mark.parametrize(("name", "kinds"), SIMULATED)
def test_robots_solved_one_by_one_in_another_way(name: str, kinds: Sequence[str]) -> None:
    base, reading, _ = arm(name)
    model = base.against(*(datum(name, kind, seed) for seed, kind in enumerate(kinds, 1)))
    (task,) = postures(model, 1, 77)
    at, x = model.at(task), model.space.sample(4, 0, 2)
    expected = carry_out(robots(model, reading, x), model, x, task)
    # of an arm of fewer joints the position is commanded, with any motion that does not change it
    rows = 6 if len(model.chain.joints) >= 6 else 3
    np.testing.assert_allclose(
        model.procedures.solved(at, x)[:rows], expected[:rows], rtol=0, atol=1e-9 if rows == 6 else 1e-7
    )
    # the model that is sampled differs in second order, most where attitudes of a pivot are few
    size = np.sqrt((expected[:rows] ** 2).mean(axis=1))
    for errors in (at.exact(x), at.linear(x)):
        gap = np.sqrt(((errors[:rows] - expected[:rows]) ** 2).mean(axis=1))
        assert (gap < 0.15 * size + 1e-6).all()
        assert gap.max() > 1e-12


# first order against robots -------------------------------------------------------------------------------------------

CHAINS = [
    ("six", ("tool_pivot", "three_points")), ("six", ("best_fit", "three_points", "taught")),
    ("six", ("three_points", "hand_eye")), ("panda", ("tool_pivot", "best_fit", "eye_to_hand")),
    ("scara", ("best_fit", "three_points")), ("five", ("three_points", "hand_eye")), ("five", ("tool_pivot", "eye_to_hand")),
    ("six", ("reflector",)), ("panda", ("tool_pivot", "reflector")),
]  # fmt: skip


@pytest.mark.fast(3)
@pytest.mark.parametrize(("name", "kinds"), CHAINS)
def test_slopes_of_chains_of_datums(name: str, kinds: Sequence[str]) -> None:
    """Central differences of robots solved one by one, along some directions that hold every draw."""
    base, *_ = arm(name)
    model = base.against(*(datum(name, kind, seed) for seed, kind in enumerate(kinds, 1)))
    at = model.at(postures(model, 1, 77)[0])
    mean = model.space.mean
    deviations = np.sqrt(np.diag(model.space.covariance))
    directions = np.random.default_rng(2).normal(size=(mean.size, 6)) * deviations[:, None]
    step = 1e-3
    # loads bend the arm at the means, which is second order: slopes from there are those of a robot without mean errors
    ends = [at.linear(sign * step * directions) for sign in (1, -1)]
    ahead, behind = (model.procedures.solved(at, sign * step * directions) for sign in (1, -1))
    rows = 6 if len(model.chain.joints) >= 6 else 3
    slopes, expected = (ahead - behind)[:rows] / (2 * step), (ends[0] - ends[1])[:rows] / (2 * step)
    np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


# properties -----------------------------------------------------------------------------------------------------------


def frames(*places: dict[str, str], joints: int = 6, seed: int = 3, scope: Scope = Scope.UNIT) -> ErrorModel:
    """Return a random arm with six free errors at places."""
    chain = chain_of(random_arm(seed, joints=joints), tip="tool")
    names = [[f"{k}{axis}" for axis in AXES] for k in range(len(places))]
    space = Space(tuple(Draw(name, Normal(1e-3), scope) for row in names for name in row))
    return ErrorModel(
        chain, space, [Frame(**p, **dict(zip(AXES, row, strict=True))) for p, row in zip(places, names, strict=True)]
    )


def covariance(model: ErrorModel, *datums: Datum, seed: int = 50) -> np.ndarray:
    return model.against(*datums).at(postures(model, 1, seed)[0]).covariance


@pytest.mark.parametrize("kind", ["best_fit", "taught", "three_points", "hand_eye", "eye_to_hand"])
def test_the_place_of_the_base_vanishes(kind: str) -> None:
    base, found = frames({"frame": "base"}), noiseless(kind)
    model = base.against(found)
    at = model.at(postures(base, 1, 50)[0])
    assert np.abs(at.covariance).max() < 1e-18
    # also in second order
    x = model.space.sample(0, 0, 20)
    assert np.abs(model.procedures.solved(at, x)).max() < 1e-9
    # and the first joint's zero
    zero = ErrorModel(base.chain, Space(), [JointOffset(joint="joint1", offset=Normal(1e-3))])
    assert np.abs(covariance(zero, found)).max() < 1e-18


def noiseless(kind: str, seed: int = 1) -> Datum:
    found = datum("six", kind, seed)
    if kind == "best_fit":
        return Datum.best_fit(found.poses)
    if kind == "taught":
        return Datum.taught(found.pose)
    if kind == "three_points":
        return Datum.three_points(found.origin, found.x, found.xy)
    if kind == "tool_pivot":
        return Datum.tool_pivot(pivots(frames({"frame": "base"}, seed=3), 5, seed))
    camera = {key: getattr(found, key) for key in ("camera", "board", "grasp", "on", "weights")}
    if kind == "hand_eye":
        return Datum.hand_eye(found.poses, *dict(found.views).values(), **camera)
    return Datum.eye_to_hand(found.poses, **camera)


def test_a_pivot_removes_the_shift_of_the_tool_and_cameras_keep_it() -> None:
    tip = frames({"frame": "tool"})
    pivot = noiseless("tool_pivot")
    plain, found = covariance(tip), covariance(tip, pivot)
    assert np.abs(found[:3, :3]).max() < 1e-15
    np.testing.assert_allclose(found[3:, 3:], plain[3:, 3:], rtol=1e-9)
    np.testing.assert_allclose(covariance(tip, noiseless("eye_to_hand"), seed=50), plain, rtol=0, atol=1e-15)
    # nor does it see where the base stands
    base = frames({"frame": "base"})
    np.testing.assert_allclose(covariance(base, pivot), covariance(base), rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", ["hand_eye", "eye_to_hand"])
def test_cameras_do_not_see_the_tool_behind_their_link(kind: str) -> None:
    # a tool that is the same at all visits is absorbed by camera or board; one that moves anew at each is not
    loose = frames({"frame": "tool"}, scope=Scope.VISIT)
    np.testing.assert_allclose(covariance(loose, noiseless(kind)), covariance(loose), rtol=0, atol=1e-15)


def test_the_point_that_is_read_is_that_of_the_robot_whatever_results_are_about() -> None:
    shaken, several = frames({"joint": "joint2"}, {"frame": "tool"}), noiseless("best_fit").poses
    q, point, target = postures(shaken, 1, 50)[0], np.array([0.06, -0.04, 0.09]), [0.1, 0.02, -0.03]
    # a target there is the point, as if it were the tip; from there a rigid body takes the error to another target
    there = (
        ErrorModel(shaken.chain.with_target(point), shaken.space, shaken.sources).against(Datum.best_fit(several)).at(q)
    )
    other = ErrorModel(shaken.chain.with_target(target), shaken.space, shaken.sources)
    carried = np.eye(6)
    lever = there.posture.pose[:3, :3] @ (target - point)
    carried[:3, 3:] = -np.array([[0, -lever[2], lever[1]], [lever[2], 0, -lever[0]], [-lever[1], lever[0], 0]])
    expected = carried @ there.covariance @ carried.T
    found = other.against(Datum.best_fit(several, point=point)).at(q).covariance
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert not np.allclose(other.against(Datum.best_fit(several)).at(q).covariance, expected, rtol=1e-2)


def test_taught_at_the_pose_of_the_task_leaves_visits_and_touch() -> None:
    unit_errors, visit_errors = frames({"joint": "joint2"}), frames({"joint": "joint4"}, scope=Scope.VISIT)
    (task,) = postures(unit_errors, 1, 50)
    touch = Datum.taught(task, {"std": "0.1 mm", "attitude": "0.3 mrad"})
    expected = np.diag(np.repeat([1e-8, 9e-8], 3))
    np.testing.assert_allclose(covariance(unit_errors, touch), expected, rtol=0, atol=1e-18)
    twice = 2 * covariance(visit_errors)
    np.testing.assert_allclose(covariance(visit_errors, touch), twice + expected, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("kind", ["best_fit", "taught", "three_points", "tool_pivot", "hand_eye", "eye_to_hand"])
def test_a_perfect_robot_has_the_noise_that_erring_robots_have_on_top(kind: str) -> None:
    erring = arm("six")[0]
    perfect = ErrorModel(erring.chain, Space(), [])
    noisy = datum("six", kind)
    silent = Datum.tool_pivot(noisy.poses) if kind == "tool_pivot" else noiseless(kind)
    noise = covariance(perfect, noisy)
    assert np.linalg.eigvalsh(noise[:3, :3])[0] > 0
    np.testing.assert_allclose(
        covariance(erring, noisy) - covariance(erring, silent), noise, rtol=0, atol=1e-9 * noise.max() + 1e-16
    )
    assert not covariance(perfect, silent).any()


def split(parts: int) -> str:
    """Return an arm whose links are straight tubes, each in so many parts."""
    text, parent = [link("base")], "base"
    for number in range(1, 7):
        axis = np.eye(3)[number % 3]
        text += [joint(f"joint{number}", "revolute", parent, f"link{number}", (0, 0, 0), (0.3, 0.1 * number, 0), axis)]
        text += [link(f"link{number}")]
        parent = f"link{number}"
        for part in range(parts):
            child = f"link{number}_{part}"
            text += [link(child), joint(f"fix{number}_{part}", "fixed", parent, child, (0.4 / parts, 0, 0.2 / parts))]
            parent = child
    return robot(*text, joint("flange", "fixed", parent, "tool", (0.1, 0.02, 0)), link("tool"))


@pytest.mark.parametrize("kind", ["best_fit", "hand_eye"])
def test_splitting_links_changes_nothing(kind: str) -> None:
    found = []
    for parts in (1, 3):
        chain = chain_of(split(parts), tip="tool")
        sources = [Frame(joint=f"joint{k}", **dict.fromkeys(AXES, Normal(1e-3))) for k in range(1, 7)]
        model = ErrorModel(chain, Space(), [*sources, Frame(frame="tool", x=Normal(1e-3))])
        found.append(covariance(model, noiseless(kind)))
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-12 * found[0].max())


# closed forms by hand -------------------------------------------------------------------------------------------------


def test_best_fit_of_repeated_slides_by_hand() -> None:
    """Four readings at the corners (±a, ±a) of a square, each with its own error of x: mean and turn about z by hand."""
    std, half, x, y = 1e-4, 0.3, 0.5, -0.2
    chain = gantry()
    model = ErrorModel(chain, Space((Draw("slip", Normal(std), Scope.VISIT),)), [JointOffset(joint="x", offset="slip")])
    corners = [[i * half, j * half, 0.1, 0.2] for i in (1, -1) for j in (1, -1)]
    found = model.against(Datum.best_fit(corners, 2e-4)).at([x, y, 0.1, 0.0]).covariance
    fit, turn = 2e-4**2 / 4, 2e-4**2 / (8 * half**2)
    lever = 1 / (16 * half**2)
    np.testing.assert_allclose(found[0, 0], std**2 * (1 + 1 / 4 + y**2 * lever) + fit + turn * y**2, rtol=1e-9)
    np.testing.assert_allclose(found[1, 1], std**2 * x**2 * lever + fit + turn * x**2, rtol=1e-9)
    np.testing.assert_allclose(found[5, 5], std**2 * lever + turn, rtol=1e-9)
    # tilts by noise of z alone: Σ y² = 4 a²
    np.testing.assert_allclose(found[2, 2], fit + 2e-4**2 * (x**2 + y**2) / (4 * half**2), rtol=1e-9)


def test_taught_elbow_by_hand() -> None:
    """The error of the elbow alone at two poses: ε z × (tip - elbow) at each, the shift of one from the other."""
    chain = planar_arm()
    model = ErrorModel(chain, Space(), [JointOffset(joint="elbow", offset=Normal(1e-3))])
    there, here = (0.2, 0.7), (-0.4, 1.5)
    model = model.against(Datum.taught(there))
    lower = [0.5 * np.array([np.cos(sum(q)), np.sin(sum(q))]) for q in (there, here)]
    shift = np.array([-(lower[1] - lower[0])[1], (lower[1] - lower[0])[0]])
    np.testing.assert_allclose(model.at(here).jacobian[:2, 0], shift, rtol=1e-9)


def test_what_is_read_and_built_does_not_depend_on_a_datum():
    """Instruments read in base axes or in their own, and a robot is built as it is: a datum changes neither."""
    model = pp.ErrorModel.load(PAPER_SHEET)
    taught = model.against(pp.Datum.taught("paper"))
    poses = list(pp.random_poses(model.chain, 12, seed=3).q.T)
    instrument = pp.Measurement(std=1e-5)
    one, other = (pp.identifiability(item, poses, instrument) for item in (model, taught))
    assert one.to_dict() == other.to_dict()
    readings = [pp.simulate(item, poses, instrument, unit=2) for item in (model, taught)]
    assert str(readings[0]) == str(readings[1])
