"""Joints whose zeros and directions are not those of the URDF: found from few readings, by another library's kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import precision_pin as pp
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.zeros import fit_zeros, refuse_reversed
from precision_pin.base.errors import InputError
from precision_pin.robot.examples import resolve_robot
from precision_pin.sources import AxisInstall, JointOffset

ARM = resolve_robot("example:so101")
TIP = "gripper_frame_link"
BALL = pp.Measurement("position", std="1 mm", target="20 0 0 mm")
STICK = """<robot name="stick"><link name="base"/><link name="tip"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint><link name="arm"/>
  <joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.3 0 0"/></joint></robot>"""


def readings(zeros, signs, seed, count=10):
    """Return joint values as read ``(5, P)`` and places of the ball ``(P, 3)``, 1 mm of noise, by Pinocchio."""
    rng = np.random.default_rng(seed)
    model = pin.buildModelFromUrdf(str(ARM))
    data, frame = model.createData(), model.getFrameId(TIP)
    read = np.radians(rng.uniform(-45, 45, (5, count)))
    places = []
    for values in (np.array(signs)[:, None] * read + np.array(zeros)[:, None]).T:
        pin.framesForwardKinematics(model, data, np.append(values, 0.0))  # the gripper's joint is the last
        places.append(data.oMf[frame].act(np.array([0.02, 0.0, 0.0])) + rng.normal(0, 1e-3, 3))
    return read, np.array(places)


WIDE = pp.Uniform(np.radians(30))


def sheet(offset=WIDE):
    chain = pp.Chain.from_urdf(ARM, TIP)
    offsets = [JointOffset(joint=name, offset=offset) for name in chain.joint_names]
    axes = [AxisInstall(joint=name, radius=0.1e-3, span=0.02) for name in chain.joint_names]
    return pp.ErrorModel(chain, pp.Space(), [*offsets, *axes])


def test_a_reversed_joint_by_hand():
    """Read at -60° … 60°, turned the other way: the best zero is 0 by symmetry, so each reading is 2 L |sin q| away."""
    chain = pp.Chain.from_urdf(STICK, "tip")
    read = np.radians([[-60.0, -30, 0, 30, 60]])
    places = 0.3 * np.vstack([np.cos(-read), np.sin(-read), 0 * read]).T
    given = pp.Measurement("position", std="0.1 mm")
    data = read_data(
        pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="turn", offset=pp.Normal(0.1))]), (read, places), given
    )
    expected = 2 * 0.3 * np.sqrt((np.sin(read) ** 2).mean())
    assert fit_zeros(chain, data, given, np.ones(1)).rms == pytest.approx(expected, rel=1e-6)
    assert fit_zeros(chain, data, given, -np.ones(1)).rms < 1e-9
    with pytest.raises(InputError, match=r"E_REVERSED: turn: .*\(residuals .* instead of 379 mm"):
        refuse_reversed(chain, data, given)


@pytest.mark.parametrize(
    ("signs", "base"),
    [
        ((1, 1, 1, 1, 1), "known"),
        ((1, 1, 1, 1, 1), "free"),
        ((1, 1, -1, 1, 1), "known"),
        ((1, 1, -1, 1, 1), "free"),
        ((1, -1, -1, 1, -1), "known"),
    ],
)
def test_reversed_joints_of_a_printed_arm_are_named(signs, base):
    zeros = np.radians([-12, 17, 8, -20, 14])
    model, given = sheet(), pp.Measurement("position", std="1 mm", target="20 0 0 mm", base=base)
    read, places = readings(zeros, signs, seed=3, count=12)
    if base == "free":
        places = places @ np.array(pin.exp3(np.array([0.2, -0.1, 1.0]))).T + [0.5, -0.2, 0.1]
    data = read_data(model, (read, places), given)
    wrong = [name for name, sign in zip(model.chain.joint_names, signs, strict=True) if sign < 0]
    if wrong:
        with pytest.raises(InputError) as refused:
            refuse_reversed(model.chain, data, given)
        assert refused.value.findings[0].message.startswith(" and ".join(wrong) + ": readings fit far better")
        return
    found = refuse_reversed(model.chain, data, given)
    assert found.rms < 2e-3
    # the zero of the first joint is the turn of a free base, too
    known = slice(0 if base == "known" else 1, None)
    assert np.abs(found.values - zeros)[known].max() < np.radians(3)


def test_only_estimates_one_kind_and_leaves_the_rest_where_it_is():
    zeros = np.radians([-12.0, 17, 8, -20, 14])
    model = sheet()
    arm = pp.calibrate(model, readings(zeros, (1,) * 5, seed=1), BALL, only=["joint_offset"], at=[np.zeros(5)])
    assert arm.posterior.names == tuple(f"joint_offset[{name}].offset" for name in model.chain.joint_names)
    assert [finding.code for finding in arm.findings if finding.code == "W_ONLY"] == ["W_ONLY"]
    assert all(
        low < zero < high for zero, (low, high) in zip(zeros, map(arm.interval, arm.posterior.names), strict=True)
    )
    # the arm that is left: zeros known to a degree or so, axes with the tolerance that they had
    std = dict(zip(arm.model.space.components, np.sqrt(np.diag(arm.model.space.covariance)), strict=True))
    before = dict(zip(model.space.components, np.sqrt(np.diag(model.space.covariance)), strict=True))
    assert all(std[name] < np.radians(2) if name in arm.posterior.names else std[name] == before[name] for name in std)
    with pytest.raises(InputError, match="no kind of source named 'joint_ofset'; did you mean 'joint_offset'"):
        pp.calibrate(model, readings(zeros, (1,) * 5, seed=1), BALL, only=["joint_ofset"])


def test_narrow_tolerances_are_told_that_zeros_alone_explain_the_readings():
    model = sheet(pp.Normal.from_half_width(np.radians(0.02)))
    with pytest.raises(InputError, match=r"E_DATA.*zeros of the joints alone would explain them to .*wide tolerances"):
        pp.calibrate(model, readings(np.radians([-12.0, 17, 8, -20, 14]), (1,) * 5, seed=1), BALL)


@pytest.mark.slow
def test_intervals_of_zeros_cover_the_true_ones():
    """Ten robots, zeros up to ±20°, ten readings each: 50 intervals of 95 %; fewer than 42 cover once in 1,300 tries."""
    rng, inside = np.random.default_rng(0), 0
    for seed in range(10):
        zeros = np.radians(rng.uniform(-20, 20, 5))
        arm = pp.calibrate(sheet(), readings(zeros, (1,) * 5, seed=seed), BALL, only=["joint_offset"], at=[np.zeros(5)])
        inside += sum(
            low < zero < high for zero, (low, high) in zip(zeros, map(arm.interval, arm.posterior.names), strict=True)
        )
    assert inside >= 42
