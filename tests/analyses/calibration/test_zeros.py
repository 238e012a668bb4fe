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
from precision_pin.sources import AxisInstall, JointOffset, Length

ARM = resolve_robot("example:so101")
TIP = "gripper_frame_link"
BALL = pp.Measurement("position", std="1 mm", target="20 0 0 mm")
STICK = """<robot name="stick"><link name="base"/><link name="upper"/><link name="fore"/><link name="tip"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
  <joint name="bend" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="end" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.2 0 0"/></joint></robot>"""


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
    """Read at -60° … 60° and turned the other way, bend locked: by symmetry the best zero is 0, 2 L |sin q| from each."""
    chain = pp.Chain.from_urdf(STICK, "tip", locked={"bend": 0.0})
    model = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="turn", offset=pp.Normal(0.1))])
    read = np.radians([[-60.0, -30, 0, 30, 60]])
    places = 0.5 * np.vstack([np.cos(-read), np.sin(-read), 0 * read]).T
    given = pp.Measurement("position", std="0.1 mm")
    data = read_data(model, (read, places), (given,))
    expected = 2 * 0.5 * np.sqrt((np.sin(read) ** 2).mean())
    assert fit_zeros(chain, data, given, np.ones(1)).rms == pytest.approx(expected, rel=1e-6)
    assert fit_zeros(chain, data, given, -np.ones(1)).rms < 1e-9
    with pytest.raises(InputError, match=r"E_REVERSED: turn: .*\(residuals .* instead of 632 mm"):
        refuse_reversed(chain, data, given)


@pytest.mark.slow
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
    data = read_data(model, (read, places), (given,))
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


@pytest.mark.slow
def test_only_estimates_one_kind_and_leaves_the_rest_where_it_is():
    """Zeros of the stick's two joints, by the closed form of its points; lengths keep their tolerance."""
    chain = pp.Chain.from_urdf(STICK, "tip")
    zeros = np.radians([15.0, -20.0])
    read = np.radians([[-60.0, -20, 10, 40, 80], [30.0, -40, 60, 10, -70]])
    first, second = (read + zeros[:, None])[0], (read + zeros[:, None]).sum(axis=0)
    places = np.vstack(
        [0.3 * np.cos(first) + 0.2 * np.cos(second), 0.3 * np.sin(first) + 0.2 * np.sin(second), 0 * first]
    ).T
    sources = [
        *(JointOffset(joint=name, offset=WIDE) for name in chain.joint_names),
        Length(joint="bend", along="x of turn", parameters=(pp.Uniform(0.1e-3),)),
        AxisInstall(joint="turn", radius=0.1e-3, span=0.1),
    ]
    model = pp.ErrorModel(chain, pp.Space(), sources)
    given = pp.Measurement("position", std="0.1 mm")
    arm = pp.calibrate(model, (read, places), given, only=["joint_offset"], at=[[0.0, 1.0]])
    names = ("joint_offset[turn].offset", "joint_offset[bend].offset")
    assert arm.posterior.names == names
    assert [arm.posterior.mean[name] for name in names] == pytest.approx(zeros, abs=1e-6)
    assert "W_ONLY" in [finding.code for finding in arm.findings]
    before, after = (
        dict(zip(one.space.components, np.sqrt(np.diag(one.space.covariance)), strict=True))
        for one in (model, arm.model)
    )
    assert all((after[name] < 1e-3) if name in names else (after[name] == before[name]) for name in before)
    with pytest.raises(InputError, match="no kind of source named 'joint_ofset'; did you mean 'joint_offset'"):
        pp.calibrate(model, (read, places), given, only=["joint_ofset"])
    narrow = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="turn", offset=pp.Normal(1e-4))])
    expected = r"E_DATA.*zeros of the joints alone would explain them to .*bend -20°, turn \+15°.*wide tolerances"
    with pytest.raises(InputError, match=expected):
        pp.calibrate(narrow, (read, places), given)


@pytest.mark.slow
def test_intervals_of_zeros_cover_the_true_ones():
    """Six robots, zeros up to ±20°, ten readings each: 30 intervals of 95 %; fewer than 24 cover once in 1,700 tries."""
    rng, inside = np.random.default_rng(0), 0
    for seed in range(6):
        zeros = np.radians(rng.uniform(-20, 20, 5))
        arm = pp.calibrate(sheet(), readings(zeros, (1,) * 5, seed=seed), BALL, only=["joint_offset"], at=[np.zeros(5)])
        inside += sum(
            low < zero < high for zero, (low, high) in zip(zeros, map(arm.interval, arm.posterior.names), strict=True)
        )
    assert inside >= 24
