"""Many configurations at once: against one at a time, whose statics are Pinocchio's, and as plain Python."""

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.jit import INTERPRETED
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import posture_loops
from precision_pin.robot.chain import Chain, Posture
from precision_pin.sources import Clearance, JointCompliance, JointOffset
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
    "a target": chain_of(ARM, tip="tool").with_target((0.03, -0.08, 0.2)),
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


@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_models_at_many_poses_are_those_at_one(monkeypatch, statics):
    """In parts of three poses; play that the load takes up at some poses is a random direction at others."""
    monkeypatch.setattr("precision_pin.model.error_model.AT_ONCE", 3)
    play = Clearance(joint="joint2", diametral=(1e-4,), span=0.1, direction="load", band=400.0)
    others = [JointOffset(joint="joint4", offset=Normal(1e-3)), JointCompliance(joint="joint1", compliance=1e-6)]
    chain = CHAINS["slanted axes, a slide, a branch, a finger"]
    model = ErrorModel(chain, Space(), [play, *others], statics=statics)
    q = values(chain, 8, seed=7)
    many = list(model.at_many(q))
    assert len({len(at.terms) for at in many}) > 1
    np.testing.assert_array_equal([at.posture.q for at in many], q.T)
    for at, column in zip(many, q.T, strict=True):
        expected = ErrorModel(chain, model.space, model.sources, statics=statics).at(column)
        assert at.table.targets == expected.table.targets
        # slopes at rest are differences over a step of 1e-7, which makes 1e-9 of a rounding of 1e-16
        np.testing.assert_allclose(at.jacobian, expected.jacobian, atol=1e-12 if statics == "nominal" else 1e-8)
        np.testing.assert_allclose(at.error_at_means, expected.error_at_means, atol=1e-12)


@dataclass(frozen=True)
class Limited(Source):
    """Refuses what is beyond a joint value."""

    subject = "limit"

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        if posture.q[0] > 1.0:
            raise InputError("joint1 is too far")
        yield Term(JointValue(3), np.array([1e-3]))


def test_a_pose_that_a_source_refuses_is_refused_when_its_turn_comes_and_wrong_ones_at_once():
    model = ErrorModel(CHAINS["a payload"], Space(), [Limited()])
    q = np.zeros((7, 3))
    q[0, 1] = 2.0
    found = model.at_many(q)
    assert len(next(found).terms) == 1
    with pytest.raises(InputError, match="joint1 is too far"):
        next(found)
    with pytest.raises(InputError, match="transpose it"):
        model.at_many(np.zeros((3, 7)))
    assert list(model.at_many(np.zeros((7, 0)))) == []
