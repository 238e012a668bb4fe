"""Many configurations at once: against one at a time, Pinocchio, differences and the potential energy."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
import pinocchio
import pytest

import precision_pin
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.jit import INTERPRETED
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot import posture_loops
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.examples import example_urdfs, shipped_sheets
from precision_pin.sources import Clearance, JointOffset
from precision_pin.terms.source import Source
from precision_pin.terms.term import JointValue, Term
from support.plain_robot import PlainRobot, chain_of, geometric_jacobian, joint, link, motion, random_arm, robot, unit

GRAVITY = (1.5, -2.5, -9.0)
ARM = random_arm(53, prismatic=(3,))
READING = PlainRobot.parse(ARM)
FINGER = {"finger_joint": 0.07}
MIMICKING = ARM.replace(
    "</robot>",
    joint(
        "thumb_joint", "revolute", "link4", "thumb", (0.1, 0, 0), extra='<mimic joint="finger_joint" multiplier="2"/>'
    )
    + link("thumb", 0.6, (0.1, 0.2, 0.3))
    + "</robot>",
)

CHAINS = {
    "slanted axes, a slide, a branch, a finger": chain_of(ARM, tip="tool", gravity=GRAVITY, locked=FINGER),
    "from the tool": chain_of(ARM, base="tool", tip="base", gravity=GRAVITY),
    "from the middle": chain_of(ARM, base="half2", tip="bracket", gravity=GRAVITY),
    "along the finger": chain_of(ARM, base="bracket", tip="finger", gravity=GRAVITY),
    "joints locked on the way": chain_of(ARM, tip="tool", gravity=GRAVITY, locked={"joint2": 0.4, "joint5": -1.1}),
    "a mimic off the way": chain_of(MIMICKING, tip="tool", gravity=GRAVITY, locked={"finger_joint": 0.3}),
    "a payload": chain_of(ARM, tip="tool").with_payload(2.5, (0.1, -0.2, 0.3)).with_payload(0.7, at="half2"),
    "slides only": chain_of(random_arm(5, 3, prismatic=(1, 2, 3)), tip="tool"),
    "no gravity": chain_of(ARM, tip="tool", gravity=(0, 0, 0)),
    "one joint": chain_of(
        robot(link("a"), joint("j", "revolute", "a", "b", (1, 2, 3), axis=(0, -1, 0)), link("b", 1.0))
    ),
}


def values(chain: Chain, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-3.1, 3.1, (len(chain.joints), count))


def compare(chain: Chain, q: np.ndarray) -> None:
    """Compare with one posture at a time, whose statics are Pinocchio's; 1e-12 of the largest number of its kind."""
    many = chain.at_many(q)
    assert len(many) == q.shape[1]
    for k, column in enumerate(q.T):
        one = chain.at(column)
        for name in ("pose", "joint_poses", "joint_axes", "joint_jacobian", "load_torque", "link_wrench"):
            expected, actual = getattr(one, name), getattr(many, name)
            assert actual.shape == (*expected.shape, q.shape[1])
            np.testing.assert_allclose(actual[..., k], expected, rtol=0, atol=1e-12 * max(1, np.abs(expected).max()))


@pytest.mark.fast(4)
@pytest.mark.parametrize("name", CHAINS)
def test_as_one_posture_at_a_time(name):
    compare(CHAINS[name], values(CHAINS[name], 40))


@pytest.mark.parametrize("name", ["ur5", "panda", "kinova", "tiago"])
def test_known_arms_as_one_posture_at_a_time(name):
    tips = {"ur5": "tool0", "panda": "panda_hand_tcp", "kinova": "j2s6s200_end_effector", "tiago": "arm_tool_link"}
    chain = Chain.from_urdf(example_urdfs()[name], tip=tips[name])
    compare(chain, values(chain, 15))


@pytest.mark.parametrize("count", [0, 1, 2, posture_loops.TILE - 1, posture_loops.TILE, 2 * posture_loops.TILE + 3])
def test_any_number_of_poses(count):
    """Tiles that are full, cut short, and none at all."""
    chain = CHAINS["slanted axes, a slide, a branch, a finger"]
    q = values(chain, max(count, 1))
    many, last = chain.at_many(q[:, :count]), chain.at_many(q[:, -1:])
    for name in ("pose", "joint_poses", "joint_jacobian", "load_torque", "link_wrench"):
        found = getattr(many, name)
        assert found.shape[-1] == count
        if count:
            np.testing.assert_array_equal(found[..., -1:], getattr(last, name))


def test_against_pinocchio_called_directly():
    """Pinocchio's own reading of the URDF; its frame is the tip's, its generalised gravity has the other sign."""
    model = pinocchio.buildModelFromXML(ARM)
    model.gravity.linear = np.array(GRAVITY)
    data, frame = model.createData(), model.getFrameId("tool", pinocchio.FrameType.BODY)
    chain = CHAINS["slanted axes, a slide, a branch, a finger"]
    q = values(chain, 20, seed=1)
    many = chain.at_many(q)
    entries = [model.joints[model.getJointId(name)] for name in chain.joint_names]
    columns = [entry.idx_v for entry in entries]
    for k in range(20):
        full = pinocchio.neutral(model)
        full[model.joints[model.getJointId("finger_joint")].idx_q] = FINGER["finger_joint"]
        for entry, value in zip(entries, q[:, k], strict=True):
            full[entry.idx_q : entry.idx_q + entry.nq] = [np.cos(value), np.sin(value)] if entry.nq == 2 else [value]
        pinocchio.computeJointJacobians(model, data, full)
        expected = pinocchio.getFrameJacobian(model, data, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(many.joint_jacobian[:, :, k], expected[:, columns], atol=1e-12)
        torque = pinocchio.computeGeneralizedGravity(model, data, full)
        np.testing.assert_allclose(many.load_torque[:, k], -torque[columns], rtol=1e-9, atol=1e-9)
        still = np.zeros(model.nv)
        pinocchio.rnea(model, data, full, still, still)
        for i, entry in enumerate(entries):
            # what the joint takes, at and in its own frame, turned and shifted to the end of the link before it
            end = (chain.at(q[:, k]).link_poses[i] @ chain.placements[i])[:3]
            own = data.oMi[entry.id]
            force = own.rotation @ -data.f[entry.id].linear
            moment = own.rotation @ -data.f[entry.id].angular + np.cross(own.translation - end[:, 3], force)
            turned = np.concatenate([end[:, :3].T @ force, end[:, :3].T @ moment])
            np.testing.assert_allclose(many.link_wrench[i, :, k], turned, rtol=1e-9, atol=1e-9)


def test_jacobians_against_the_difference_of_poses():
    """Against a second reading of the URDF, by differences that are exact for turns and slides."""
    chain = CHAINS["slanted axes, a slide, a branch, a finger"]
    q = values(chain, 5, seed=2)
    many = chain.at_many(q)
    for k in range(5):
        named = dict(zip(chain.joint_names, q[:, k], strict=True)) | FINGER
        expected = geometric_jacobian(READING, chain.joint_names, "tool", named)
        np.testing.assert_allclose(many.joint_jacobian[:, :, k], expected, atol=1e-13)


@pytest.mark.parametrize(("base", "tip"), [("base", "tool"), ("tool", "base"), ("half2", "bracket")])
def test_torques_against_the_slope_of_the_potential_energy(base, tip):
    chain = chain_of(ARM, base=base, tip=tip, gravity=GRAVITY)
    q = values(chain, 5, seed=3)
    torque = chain.at_many(q).load_torque
    for k in range(5):
        named = dict(chain.locked) | dict(zip(chain.joint_names, q[:, k], strict=True))
        expected = READING.load_torque(chain.joint_names, named, GRAVITY, base)
        np.testing.assert_allclose(torque[:, k], expected, atol=1e-11)


def test_a_pendulum_by_hand():
    """A mass m at the end of a rod l that turns about y: torque m g l cos θ, its end falls by l sin θ."""
    text = robot(link("a"), joint("j", "revolute", "a", "b", axis=(0, 1, 0)), link("b", 2.0, (0.5, 0, 0)))
    angle = np.array([0.0, np.pi / 6, np.pi / 2, np.pi])
    chain = chain_of(text.replace("</robot>", joint("f", "fixed", "b", "t", (0.5, 0, 0)) + link("t") + "</robot>"))
    many = chain.at_many(angle[None])
    np.testing.assert_allclose(many.load_torque[0], 2.0 * 9.81 * 0.5 * np.cos(angle), atol=1e-14)
    np.testing.assert_allclose(many.pose[2, 3], -0.5 * np.sin(angle), atol=1e-15)
    np.testing.assert_allclose(many.joint_jacobian[2, 0], -0.5 * np.cos(angle), atol=1e-15)
    np.testing.assert_allclose(many.link_wrench[0, 2], -2.0 * 9.81, atol=1e-14)


def test_sines_at_every_quarter_turn_and_after_many_turns():
    """A joint at angles where the quarter changes, far out, and where one is brought back to a turn first."""
    axis = unit((1, -2, 0.5))
    chain = chain_of(robot(link("a"), joint("j", "continuous", "a", "b", axis=axis), link("b")))
    quarters = np.arange(-9, 10) * np.pi / 4
    angle = np.concatenate(
        [quarters, np.nextafter(quarters, 9), np.nextafter(quarters, -9), np.geomspace(1e-12, 1e15, 60)]
    )
    angle = np.concatenate([angle, -angle, np.random.default_rng(4).uniform(-1e6, 1e6, 200)])
    poses = chain.at_many(angle[None]).pose
    expected = np.array([motion(axis, False, value) for value in np.arctan2(np.sin(angle), np.cos(angle))])
    np.testing.assert_allclose(poses, np.moveaxis(expected, 0, -1), atol=1e-15)


def test_values_by_name_one_for_all_poses_or_one_for_each():
    chain = CHAINS["joints locked on the way"]
    q = values(chain, 6)
    q[1] = 0.25
    named = dict(zip(chain.joint_names, q, strict=True)) | {chain.joint_names[1]: 0.25}
    np.testing.assert_array_equal(chain.at_many(named).q, q)
    assert len(chain.at_many(dict.fromkeys(chain.joint_names, 0.1))) == 1
    many = chain.at_many(q)
    q[:] = 0.0
    assert many.q[1, 0] == 0.25, "the postures keep values of their own"


@pytest.mark.parametrize(
    ("q", "error", "message"),
    [
        (np.zeros(7), InputError, r"shape \(7,\) for many poses, expected \(7, P\): a row for each of joint1, joint2"),
        (np.zeros((5, 7)), InputError, r"shape \(5, 7\) .*poses are columns, so transpose it"),
        (np.zeros((7, 2, 2)), InputError, r"shape \(7, 2, 2\) for many poses"),
        (np.full((7, 2), np.nan), InputError, "joint values must be finite"),
        ("there", InputError, "joint values must be numbers"),
        ({"joint1": [0.0]}, InputError, "no value for the joints joint2, joint3"),
        ({"elbow": [0.0]}, UnknownNameError, "no joint on the chain named 'elbow'"),
        ({f"joint{k}": np.zeros(2 + k % 2) for k in range(1, 8)}, InputError, "different numbers of values"),
        ({f"joint{k}": np.zeros((2, 2)) for k in range(1, 8)}, InputError, "different numbers of values"),
        ({f"joint{k}": "far" for k in range(1, 8)}, InputError, "joint values of joint1 must be numbers"),
    ],
)
def test_wrong_values_are_refused(q, error, message):
    with pytest.raises(error, match=message):
        chain_of(ARM, tip="tool").at_many(q)


@pytest.mark.filterwarnings("ignore:.*W_SQUARE_POSES")
def test_one_compilation_serves_every_chain_and_any_array():
    for chain in CHAINS.values():
        q = values(chain, 3)
        q.flags.writeable = False
        for given in (q, np.asfortranarray(q), q.astype(np.float32), q.T.tolist()):
            many = chain.at_many(given)
            assert np.isfinite(many.pose).all()
            assert np.isfinite(many.load_torque).all()
    if not INTERPRETED:
        assert len(posture_loops.run.signatures) == 1


PROGRAM = """
import numpy as np
from precision_pin.robot import posture_loops
from precision_pin.base.jit import INTERPRETED
from precision_pin.robot.chain import Chain
chain = Chain.from_urdf("arm.urdf", tip="tool")
many = chain.at_many(np.linspace(-2, 2, 35).reshape(7, 5))
print(np.concatenate([many.pose, many.joint_jacobian[:4, :4], many.link_wrench[:4, :4]]).tobytes().hex())
print(INTERPRETED or sum(posture_loops.run.stats.cache_hits.values()))
"""


def printed(directory: Path, **environment: str) -> list[str]:
    """Run the program on the copy of the package in a directory."""
    settings = {"NUMBA_OPT": "1", **os.environ, "PYTHONPATH": str(directory), **environment}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        cwd=directory,
        env=settings,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    package = Path(precision_pin.__file__).parent
    shutil.copytree(package, tmp_path / "precision_pin", ignore=shutil.ignore_patterns("__pycache__", "robots"))
    (tmp_path / "arm.urdf").write_text(ARM)
    return tmp_path


@pytest.mark.slow
def test_a_cache_is_used_and_a_damaged_one_replaced(copied: Path):
    cache = {"NUMBA_CACHE_DIR": str(copied / "cache")}
    first = printed(copied, **cache)
    assert first[1] == "0"
    (file,) = (copied / "cache").rglob("posture_loops.run-*.nbc")
    file.write_bytes(file.read_bytes()[:20])
    assert printed(copied, **cache)[0] == first[0]
    assert printed(copied, **cache) == [first[0], "1"]


@pytest.mark.slow
def test_without_any_place_for_a_cache_and_as_plain_python(copied: Path):
    first, _ = printed(copied, NUMBA_DISABLE_JIT="1", PYTHONDONTWRITEBYTECODE="1")
    (copied / "precision_pin" / "robot" / "__pycache__").write_text("")
    blocked = str(copied / "arm.urdf")
    second, hits = printed(copied, HOME=blocked, XDG_CACHE_HOME=blocked, PYTHONDONTWRITEBYTECODE="1")
    assert hits == "0"
    one, two = (np.frombuffer(bytes.fromhex(text)) for text in (first, second))
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-12)


# --- error models at many poses ---


def table_of(at: PoseModel) -> dict[str, np.ndarray]:
    table = at.table
    return {"pose": table.pose, "frames": table.frames, "twists": table.twists, "error": at.error_at_means}


def compare_models(
    model: ErrorModel, q: np.ndarray, of_twists: float = 1e-12, relative: float = 0.0
) -> list[PoseModel]:
    """Compare with a model of its own for every pose, which shares nothing with the one before."""
    many = list(model.at_many(q))
    assert len(many) == q.shape[1]
    for at, column in zip(many, q.T, strict=True):
        alone = ErrorModel(model.chain, model.space, model.sources, statics=model.statics)
        expected = alone.at(column)
        np.testing.assert_array_equal(at.posture.q, column)
        assert at.table.targets == expected.table.targets
        assert at.table.program == expected.table.program
        np.testing.assert_array_equal(at.table.factors, expected.table.factors)
        np.testing.assert_array_equal(at.table.target, expected.table.target)
        for name, value in table_of(expected).items():
            tolerance = of_twists if name == "twists" else 1e-12
            np.testing.assert_allclose(table_of(at)[name], value, rtol=relative, atol=tolerance, err_msg=name)
    return many


@pytest.mark.slow
@pytest.mark.parametrize("name", ["4dof", "ur5", "panda"])
@pytest.mark.filterwarnings("ignore:.*W_SQUARE_POSES", "ignore:.*W_JOINT_LIMIT", "ignore:.*W_COLLISION")
def test_shipped_sheets_at_many_poses_as_one_at_a_time(name):
    model = ErrorModel.load(shipped_sheets()[name])
    q = model.configuration()[:, None] + np.random.default_rng(6).normal(size=(len(model.chain.joints), 4))
    many = compare_models(model, q)
    assert all(at.table.program is many[0].table.program for at in many), "one program serves all poses"
    assert np.abs(many[0].table.twists - many[1].table.twists).max() > 1e-9


@pytest.mark.slow
def test_equilibrium_at_many_poses_as_one_at_a_time():
    """Its slopes are differences over a step of 1e-7, which makes 1e-9 of a rounding of 1e-16.

    Twists of products of two compliances of 1e-5 are as large as 1e4 and as uncertain as 1e-6, which makes 1e-16 rad.
    """
    paper = ErrorModel.load(shipped_sheets()["4dof"])
    model = ErrorModel(paper.chain, paper.space, paper.sources, statics="equilibrium")
    compare_models(model, paper.configuration()[:, None] + np.array([0.0, 0.4]), of_twists=2e-6, relative=1e-8)


def test_terms_that_come_and_go_with_the_pose():
    """Play that the load takes up at some poses is a random direction at others: other terms, and other factors."""
    play = Clearance(joint="joint2", diametral=(1e-4,), span=0.1, direction="load", band=400.0)
    offset = JointOffset(joint="joint4", offset=Normal(1e-3))
    model = ErrorModel(CHAINS["slanted axes, a slide, a branch, a finger"], Space(), [play, offset])
    many = compare_models(model, values(model.chain, 12, seed=7))
    assert len({len(at.terms) for at in many}) > 1


@final
@dataclass(frozen=True)
class Peculiar(Source):
    """Reads of the posture what its ``part`` names."""

    part: str

    @property
    def subject(self) -> str:
        return self.part

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        match self.part:
            case "joint value":
                yield Term(JointValue(0), posture.q[:1] * 1e-3)
            case "deflection, if any":
                bent = getattr(posture, "deflection", None) is not None
                yield Term(JointValue(1), np.array([2e-3 if bent else 1e-3]), loaded=True)
            case "another posture":
                yield Term(JointValue(2), replace(posture, q=posture.q + 1.0).q[2:3] * 1e-3)
            case "a limit":
                if posture.q[0] > 1.0:
                    raise InputError("joint1 is too far")
                yield Term(JointValue(3), np.array([1e-3]))


@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_what_a_source_reads_of_the_posture_is_read_at_every_pose(statics):
    parts = ("joint value", "deflection, if any", "another posture")
    model = ErrorModel(
        CHAINS["slanted axes, a slide, a branch, a finger"],
        Space(),
        [Peculiar(part) for part in parts],
        statics=statics,
    )
    q = values(model.chain, 3, seed=8)
    for at, column in zip(model.at_many(q), q.T, strict=True):
        found = {term.target.joint: float(term.twist[0]) for term in at.terms}
        bent = 2e-3 if statics == "equilibrium" else 1e-3
        assert found == pytest.approx({0: 1e-3 * column[0], 1: bent, 2: 1e-3 * (column[2] + 1)}, abs=1e-12)


def test_a_pose_that_a_source_refuses_is_refused_when_its_turn_comes():
    model = ErrorModel(CHAINS["a payload"], Space(), [Peculiar("a limit")])
    q = np.zeros((7, 3))
    q[0, 1] = 2.0
    found = model.at_many(q)
    assert len(next(found).terms) == 1
    with pytest.raises(InputError, match="joint1 is too far"):
        next(found)


def test_wrong_poses_are_refused_at_once():
    model = ErrorModel(CHAINS["a payload"], Space(), [])
    with pytest.raises(InputError, match="transpose it"):
        model.at_many(np.zeros((3, 7)))
    assert list(model.at_many(np.zeros((7, 0)))) == []


def test_tables_of_more_poses_than_are_placed_at_once(monkeypatch):
    monkeypatch.setattr("precision_pin.model.error_model._AT_ONCE", 3)
    model = ErrorModel(CHAINS["a payload"], Space(), [JointOffset(joint="joint4", offset=1e-3)])
    q = values(model.chain, 8, seed=9)
    np.testing.assert_array_equal([at.posture.q for at in model.at_many(q)], q.T)
    compare_models(model, q)
