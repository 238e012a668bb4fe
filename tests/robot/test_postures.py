"""Many configurations at once: against one at a time, whose statics are Pinocchio's, and as plain Python."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.jit import INTERPRETED
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot import posture_loops
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.examples import shipped_sheets
from precision_pin.sources import Clearance, JointOffset
from precision_pin.terms.source import Source
from precision_pin.terms.term import JointValue, Term
from support.plain_robot import chain_of, joint, link, motion, random_arm, robot, unit

GRAVITY = (1.5, -2.5, -9.0)
ARM = random_arm(53, prismatic=(3,))
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


@pytest.mark.fast(4)
@pytest.mark.parametrize("name", CHAINS)
def test_as_one_posture_at_a_time(name):
    """1e-12 of the largest number of its kind."""
    chain = CHAINS[name]
    q = values(chain, 6)
    many = chain.at_many(q)
    assert len(many) == q.shape[1]
    for k, column in enumerate(q.T):
        one = chain.at(column)
        for part in ("pose", "joint_poses", "joint_axes", "joint_jacobian", "load_torque", "link_wrench"):
            expected, actual = getattr(one, part), getattr(many, part)
            assert actual.shape == (*expected.shape, q.shape[1])
            np.testing.assert_allclose(actual[..., k], expected, rtol=0, atol=1e-12 * max(1, np.abs(expected).max()))


@pytest.mark.parametrize("count", [0, 1, posture_loops.TILE, 2 * posture_loops.TILE + 3])
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
        (np.full((7, 2), np.nan), InputError, "joint values must be finite"),
        ({"joint1": [0.0]}, InputError, "no value for the joints joint2, joint3"),
        ({"elbow": [0.0]}, UnknownNameError, "no joint on the chain named 'elbow'"),
        ({f"joint{k}": np.zeros(2 + k % 2) for k in range(1, 8)}, InputError, "different numbers of values"),
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
import numpy as np, sys
from precision_pin.robot.chain import Chain
many = Chain.from_urdf("arm.urdf", tip="tool").at_many(np.linspace(-2, 2, 35).reshape(7, 5))
print(np.concatenate([many.pose, many.joint_jacobian[:4, :4], many.link_wrench[:4, :4]]).tobytes().hex())
"""


@pytest.mark.slow
def test_the_loops_run_as_plain_python(tmp_path: Path, capsys, monkeypatch):
    (tmp_path / "arm.urdf").write_text(ARM)
    monkeypatch.chdir(tmp_path)
    words = [sys.executable, "-W", "error", "-c", PROGRAM]
    done = subprocess.run(
        words, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, timeout=300, check=True
    )
    exec(compile(PROGRAM, "program", "exec"), {})
    one, two = (np.frombuffer(bytes.fromhex(text)) for text in (done.stdout.decode(), capsys.readouterr().out))
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
    sources = [Peculiar(part) for part in parts]
    model = ErrorModel(CHAINS["slanted axes, a slide, a branch, a finger"], Space(), sources, statics=statics)
    q = values(model.chain, 3, seed=8)
    for at, column in zip(model.at_many(q), q.T, strict=True):
        found = {term.target.joint: float(term.twist[0]) for term in at.terms}
        bent = 2e-3 if statics == "equilibrium" else 1e-3
        assert found == pytest.approx({0: 1e-3 * column[0], 1: bent, 2: 1e-3 * (column[2] + 1)}, abs=1e-12)


def test_a_pose_that_a_source_refuses_is_refused_when_its_turn_comes_and_wrong_ones_at_once():
    model = ErrorModel(CHAINS["a payload"], Space(), [Peculiar("a limit")])
    q = np.zeros((7, 3))
    q[0, 1] = 2.0
    found = model.at_many(q)
    assert len(next(found).terms) == 1
    with pytest.raises(InputError, match="joint1 is too far"):
        next(found)
    with pytest.raises(InputError, match="transpose it"):
        model.at_many(np.zeros((3, 7)))
    assert list(model.at_many(np.zeros((7, 0)))) == []


def test_tables_of_more_poses_than_are_placed_at_once(monkeypatch):
    monkeypatch.setattr("precision_pin.model.error_model.AT_ONCE", 3)
    model = ErrorModel(CHAINS["a payload"], Space(), [JointOffset(joint="joint4", offset=1e-3)])
    q = values(model.chain, 8, seed=9)
    np.testing.assert_array_equal([at.posture.q for at in model.at_many(q)], q.T)
    compare_models(model, q)
