"""Datums where the base is the flange of a second arm, or the table of a positioner: pairs of arms simulated one by one."""

from functools import cache, partial

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from model.test_datum_procedures import AXES, noise_of
from precision_pin import Draw, ErrorModel, Normal, Scope, Space
from precision_pin.robot.datums import Datum
from precision_pin.sources import Frame, JointOffset
from support.plain_robot import PlainRobot, chain_of, inserted, joint, link, pose_error, robot, unit

TIP, TABLE = "right6", "left_table"
PIECE = {"two arms": 6, "positioner": 2}
SLIPPING = ("left_joint2", "right_joint3")
RIGHT = [f"right_joint{k}" for k in range(1, 7)]


def pair(joints: int) -> str:
    """Return an arm of six joints beside a carrier of the workpiece of so many, both with slanted axes."""
    generator = np.random.default_rng(8)
    parts = [link("floor")]
    for side, count in (("left_", joints), ("right", 6)):
        parent = "floor"
        for k in range(1, count + 1):
            xyz, rpy = generator.uniform(-0.4, 0.4, 3), generator.uniform(-3, 3, 3)
            name = f"{side.rstrip('_')}_joint{k}"
            parts += [joint(name, "revolute", parent, f"{side}{k}", xyz, rpy, unit(generator.normal(size=3)))]
            parts += [link(f"{side}{k}")]
            parent = f"{side}{k}"
    table = joint("clamp", "fixed", f"left_{joints}", TABLE, (0.1, 0.05, 0.2), (0.3, 0.1, -0.2))
    return robot(*parts, table, link(TABLE))


@cache
def arms(name: str) -> tuple[ErrorModel, PlainRobot]:
    """Return the model of the right arm's tip in axes of the workpiece's carrier; both sides err."""
    text = pair(PIECE[name])
    chain = chain_of(text, base=TABLE, tip=TIP)
    assert chain.joint_names[: PIECE[name]] == tuple(f"left_joint{k}" for k in range(PIECE[name], 0, -1))
    sources = [Frame(joint=each, **dict.fromkeys(AXES, Normal(1e-3))) for each in chain.joint_names]
    fixed = [each for each in chain.joint_names if each not in SLIPPING]
    sources += [JointOffset(joint=each, offset=Normal(1e-3)) for each in fixed]
    sources += [JointOffset(joint=each, offset=f"slip {each}") for each in SLIPPING]
    slips = tuple(Draw(f"slip {each}", Normal(1e-3), Scope.VISIT) for each in SLIPPING)
    return ErrorModel(chain, Space(slips), sources), PlainRobot.parse(text)


class OnePair:
    """Both arms as built with components by name: what is true of them, and what their controller believes."""

    def __init__(self, model: ErrorModel, reading: PlainRobot, x: np.ndarray) -> None:
        self.names, self.reading = model.chain.joint_names, reading
        self.value = dict(zip(model.space.components, x[:, None], strict=True))
        self.places = {}
        for name in self.names:
            error = inserted(np.array([self.value[f"frame[{name}].{axis}"][0] for axis in AXES]))
            # of a joint between base and floor the child link's frame, whose error moves what lies beyond: the parent
            side, _, number = name.partition("_joint")
            self.places |= (
                {("link", f"left_{number}"): np.linalg.inv(error)} if side == "left" else {("joint", name): error}
            )

    def nominal(self, q: np.ndarray) -> np.ndarray:
        return self.reading.poses(dict(zip(self.names, q, strict=True)), TABLE)[TIP]

    def true(self, q: np.ndarray, prefix: str = "") -> np.ndarray:
        """Return the true pose at a visit, whose draws have a prefix."""
        values = dict(zip(self.names, q, strict=True))
        for name in set(self.names) - {*SLIPPING}:
            values[name] += self.value[f"joint_offset[{name}].offset"][0]
        for name in SLIPPING:
            values[name] += self.value[f"{prefix}slip {name}"][0]
        return self.reading.poses(values, TABLE, self.places)[TIP]

    def moved(self, q: np.ndarray, gap) -> np.ndarray:
        """Return joint values with no gap ``(6,)``; the right arm moves, the carrier stays."""
        right = [self.names.index(name) for name in RIGHT]

        def of(values):
            at = q.copy()
            at[right] = values
            return at

        found = least_squares(lambda values: gap(of(values)), q[right], xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.abs(found.fun).max() < 1e-12
        return of(found.x)

    def to(self, q: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return joint values that the controller takes for a pose."""
        return self.moved(q, lambda at: pose_error(self.nominal(at), pose))


def frame(points) -> np.ndarray:
    x = unit(points[1] - points[0])
    z = unit(np.cross(x, points[2] - points[0]))
    return np.vstack([np.column_stack([x, np.cross(z, x), z, points[0]]), [0, 0, 0, 1]])


def shifted(pose: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return a pose with a shift and a turn about its origin, axes of the base."""
    result = pose.copy()
    result[:3, 3] += by[:3]
    result[:3, :3] = Rotation.from_rotvec(by[3:]).as_matrix() @ pose[:3, :3]
    return result


def error_of(built: OnePair, datum: Datum, noise: np.ndarray, task: np.ndarray) -> np.ndarray:
    """Return the error ``(6,)`` at a task of one pair that carries out a procedure with noise ``(M, 6)``."""
    visits = list(datum.visits)
    places, prefixes = [built.nominal(q) for q in visits], [f"datum[{datum.name}].{k + 1} " for k in range(len(visits))]
    change, motion, goal = np.eye(4), np.eye(4), built.nominal(task)
    if datum.kind == "best_fit":
        read = [built.true(q, prefix)[:3, 3] + n[:3] for q, prefix, n in zip(visits, prefixes, noise, strict=True)]
        nominal = np.array([place[:3, 3] for place in places])
        motion[:3, :3] = Rotation.align_vectors(nominal - nominal.mean(0), read - np.mean(read, 0))[0].as_matrix()
        motion[:3, 3] = nominal.mean(0) - motion[:3, :3] @ np.mean(read, 0)
    elif datum.kind == "taught":
        wanted = shifted(places[0], noise[0])
        q = built.moved(visits[0], lambda at: pose_error(built.true(at, prefixes[0]), wanted))
        change = built.nominal(q) @ np.linalg.inv(places[0])
    else:
        touched = []
        for q, place, prefix, n in zip(visits, places, prefixes, noise, strict=True):

            def gap(at, place=place, prefix=prefix, n=n):
                turn = pose_error(built.nominal(at), place)[3:]
                return np.hstack([built.true(at, prefix)[:3, 3] - place[:3, 3] - n[:3], turn])

            touched.append(built.nominal(built.moved(q, gap))[:3, 3])
        change = frame(touched) @ np.linalg.inv(frame([place[:3, 3] for place in places]))
    return pose_error(motion @ built.true(built.to(task, change @ goal)), goal)


@pytest.mark.parametrize("kind", ["best_fit", "taught", "three_points"])
@pytest.mark.parametrize("name", PIECE)
def test_the_carrier_of_the_workpiece_is_the_base(name: str, kind: str) -> None:
    bare, reading = arms(name)
    generator = np.random.default_rng(5)
    several = list(generator.uniform(-1, 1, (5, len(bare.chain.joints))))
    datum = {
        "best_fit": partial(Datum.best_fit, several[:4], 1e-3),
        "taught": partial(Datum.taught, several[0], {"std": 1e-3, "attitude": 1e-3}),
        "three_points": partial(Datum.three_points, *several[:3], 1e-3),
    }[kind]()
    model, task = bare.against(datum), several[4]
    at = model.at(task)
    for _ in range(2):
        # central differences: what is left is of third order, 6e-6 at a pose near a singularity
        x = 0.003 * np.sqrt(model.space.covariance.diagonal()) * generator.normal(size=model.space.size)
        ends = []
        for sign in (1, -1):
            built = OnePair(model, reading, sign * x)
            ends.append(error_of(built, datum, noise_of(model, datum, sign * x[:, None])[:, 0], task))
        slope = (ends[0] - ends[1]) / 2
        expected = at.linear(x[:, None])[:, 0]
        np.testing.assert_allclose(slope, expected, rtol=0, atol=2e-5 * np.abs(expected).max())
        if kind == "best_fit":  # no joints are searched: single pairs, whole
            np.testing.assert_allclose(model.procedures.solved(at, x[:, None])[:, 0], ends[0], rtol=0, atol=1e-12)
        # the carrier counts
        assert np.abs(expected - at.arm.linear(x[:, None])[:, 0]).max() > 0.05 * np.abs(expected).max()


def test_the_carrier_held_still_cancels() -> None:
    bare, _ = arms("two arms")
    chain, q = bare.chain, np.linspace(-0.6, 0.8, 12)
    held, moved = q.copy(), q.copy()
    held[6:] += 0.3  # the right arm alone goes to the task
    moved[:6] += 0.3
    zeros = ErrorModel(chain, Space(), [JointOffset(joint=f"left_joint{k}", offset=Normal(1e-3)) for k in range(1, 7)])
    taught = zeros.against(Datum.taught(q))
    assert np.abs(taught.at(held).jacobian).max() < 1e-12
    assert np.abs(taught.at(moved).jacobian).max() > 0.1
