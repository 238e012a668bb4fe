"""The same robots under several approaches (repeatability, vAP), and at a pose relative to another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.base.errors import InputError, PrecisionPinWarning, UnknownNameError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources.backlash import Backlash
from precision_pin.sources.joint_offset import JointOffset
from sampling.cases import MODEL
from support.checks.common import one_link
from support.plain_robot import PlainRobot, geometric_jacobian

GAP = 1e-3


def hinge(*offsets: Draw) -> ErrorModel:
    """Return a hinge of 1 m about z, which carries no weight, with a gap, and what else turns it."""
    sources = [JointOffset(joint="hinge", offset=offset) for offset in offsets]
    return ErrorModel(one_link(), Space(), [Backlash(joint="hinge", backlash=GAP, band=1.0), *sources])


def test_backlash_alone_by_hand() -> None:
    model = hinge(Draw("zero", Normal(2e-3)))
    found = pp.sample_approaches(model, [0.0], approaches=["hinge +", "hinge -", "hinge +"], robots=50, cycles=4)
    assert found.approaches == ((1,), (-1,), (1,))
    assert found.errors.shape == (3, 4, 6, 50)
    # a robot repeats itself from one side; from both, half of its visits lie a gap away: l is half the chord each time
    chord = 2 * np.sin(GAP / 2)
    np.testing.assert_allclose(found.variation, chord, rtol=1e-11)
    np.testing.assert_allclose(found.unidirectional, 0.0, atol=1e-15)
    two = pp.sample_approaches(model, [0.0], approaches=["hinge +", "hinge -"], robots=50, cycles=4)
    np.testing.assert_allclose(two.bidirectional, chord / 2, rtol=1e-9)
    # behind the drive: below the nominal place after going up
    zero = model.space.sample(0, 0, 50)[model.space.index["zero"]]
    np.testing.assert_allclose(two.errors[0, 0, 1], np.sin(zero - GAP / 2), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_visits_against_the_formulas_of_the_standard() -> None:
    model = hinge(Draw("visit", Uniform(2e-3), Scope.VISIT), Draw("pose", Normal(1e-3), Scope.POSE))
    found = pp.sample_approaches(model, [0.0], approaches=["hinge +", "hinge -"], robots=3, cycles=30, seed=5, number=7)
    at = {sign: model.at([0.0], approach=f"hinge {sign}") for sign in "+-"}
    for robot in range(3):
        clouds = []
        for rank, sign in enumerate("+-"):
            visits = [
                at[sign].exact(model.space.sample(5, robot, 1, pose=7, visit=30 * rank + cycle))[:3, 0]
                for cycle in range(30)
            ]
            clouds.append(np.array(visits))
            np.testing.assert_allclose(found.errors[rank, :, :3, robot], visits, rtol=0, atol=1e-14)
        barycentres = [cloud.mean(axis=0) for cloud in clouds]
        assert found.variation[robot] == pytest.approx(np.linalg.norm(barycentres[0] - barycentres[1]), rel=1e-9)
        for cloud, value in (
            (clouds[0], found.unidirectional[0, robot]),
            (np.concatenate(clouds), found.bidirectional[robot]),
        ):
            lengths = [float(np.linalg.norm(visit - cloud.mean(axis=0))) for visit in cloud]
            mean = sum(lengths) / len(lengths)
            spread = np.sqrt(sum((length - mean) ** 2 for length in lengths) / (len(lengths) - 1))
            assert value == pytest.approx(mean + 3 * spread, rel=1e-9)
    assert (found.bidirectional > found.unidirectional).all()


def test_robots_are_those_that_are_analysed() -> None:
    model = hinge(Draw("zero", Normal(2e-3)))
    found = pp.sample_approaches(model, [0.3], approaches=["hinge +", "hinge -"], robots=20, cycles=2, seed=9)
    alone = pp.monte_carlo(model, [0.3], approach="hinge -", samples=20, seed=9, keep_samples=True)
    np.testing.assert_array_equal(found.errors[1, 0], alone.errors)
    layout = sampler.to_arrays(model.at([0.3], approach="hinge -"))
    np.testing.assert_array_equal(found.errors[1, 1], sampler.errors(layout, "exact", 9, 0, 20, visit=3))


def test_a_measured_point_beside_the_tip_and_robots_from_the_middle() -> None:
    model = hinge(Draw("zero", Normal(2e-3)))
    sides: dict[str, Any] = {"approaches": ["hinge +", "hinge -"], "robots": 5, "cycles": 2}
    found = pp.sample_approaches(model, [0.4], target=(1.0, 0.5, 0.2), first=7, **sides)
    # the point lies sqrt(2² + 0.5²) m from the axis
    np.testing.assert_allclose(found.variation, 2 * np.sin(GAP / 2) * np.hypot(2.0, 0.5), rtol=1e-11)
    all_of_them = pp.sample_approaches(model, [0.4], **{**sides, "robots": 12})
    np.testing.assert_array_equal(found.errors, all_of_them.errors[..., 7:])
    np.testing.assert_array_equal(all_of_them.shifts, all_of_them.errors[:, :, :3])


def test_wrong_inputs_are_told_in_a_line() -> None:
    for settings, message in (
        ({"approaches": ["hinge +"]}, "1 approaches; to compare them, give two or more"),
        ({"approaches": ["hinge +", "hing -"]}, "did you mean 'hinge'"),
        ({"cycles": 1}, "the number of cycles must be a whole number from 2 to 2047, got 1"),
        ({"robots": 0}, "the number of robots"),
        ({"model": "cubic"}, "exact or linear"),
    ):
        with pytest.raises(InputError, match=message):
            pp.sample_approaches(hinge(), [0.0], **{"approaches": ["hinge +", "hinge -"], "robots": 2, **settings})


JOINTS = MODEL.chain.joint_names
P, Q = np.array([0.1, 0.4, 0.8, -0.6]), np.array([-0.5, 0.1, 1.2, 0.3])
STD = 3e-3


def arm(scopes: dict[int, Scope]) -> pp.ErrorModel:
    """Return the paper's arm with joint offsets of every robot, and some that are drawn again."""
    draws = [Draw(f"robot{k}", Normal(STD)) for k in range(4)]
    draws += [Draw(f"again{k}", Uniform(STD), scope) for k, scope in scopes.items()]
    return pp.ErrorModel(
        MODEL.chain,
        Space(tuple(draws)),
        [JointOffset(joint=JOINTS[int(one.name[-1])], offset=one.name) for one in draws],
    )


MIXED = arm({1: Scope.POSE, 2: Scope.VISIT})


def test_each_robot_is_the_one_that_the_model_displaces_at_both_poses() -> None:
    found = pp.relative(MIXED, P, Q, samples=300, seed=5, keep_samples=True)
    here, there = (MIXED.space.sample(5, 0, 300, pose=pose) for pose in (0, 1))
    expected = MIXED.at(P).exact(here) - MIXED.at(Q).exact(there)
    np.testing.assert_allclose(found.errors, expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.nominal, 0.0, atol=1e-15)


@pytest.mark.slow
def test_the_covariance_is_that_of_the_difference_of_slopes_and_of_both_visits() -> None:
    samples = 2 * BLOCK
    found = pp.relative(MIXED, P, Q, samples=samples, model="linear", threads=1)
    names = MODEL.chain.joint_names
    reading = PlainRobot.parse(Path(MODEL.chain.robot.file).read_text("utf-8"))
    here, there = (geometric_jacobian(reading, names, "tool", dict(zip(names, q, strict=True))) for q in (P, Q))
    expected = STD**2 * (here - there) @ (here - there).T
    for joint in (1, 2):  # a uniform law of half-width a has the variance a²/3
        expected += STD**2 / 3 * sum(np.outer(slopes[:, joint], slopes[:, joint]) for slopes in (here, there))
    scale = np.sqrt(np.diag(expected))
    covariance = found.covariance
    assert covariance is not None
    # four standard errors of a covariance, which are largest for normal numbers; the slopes are differences
    allowed = 4 * np.sqrt((np.outer(scale, scale) ** 2 + expected**2) / samples)
    assert (np.abs(covariance - expected) <= allowed + 1e-15).all()
    same = pp.relative(MIXED, P, Q, samples=samples, model="linear", threads=3)
    assert found.to_json() == same.to_json()


def test_a_pose_relative_to_itself_leaves_what_two_visits_differ_by() -> None:
    with pytest.warns(PrecisionPinWarning, match="W_NOTHING_VARIES"):
        still = pp.relative(arm({1: Scope.POSE}), P, P, samples=1000)
    assert still.position.norm.max == 0.0
    assert still.attitude.norm.max == 0.0
    visits = pp.relative(MIXED, P, P, samples=4000, keep_samples=True)
    assert visits.errors is not None
    # the tip turns about joint 3 by the difference of two uniform numbers: a triangular law
    turned = np.linalg.norm(visits.errors[3:], axis=0)
    assert stats.kstest(turned / (2 * STD), lambda x: 1 - (1 - np.clip(x, 0, 1)) ** 2).pvalue > 1e-3


@pytest.mark.slow
def test_what_is_counted_said_and_refused() -> None:
    found = pp.relative(
        MODEL, "paper", Q, samples=2000, specifications=["1 mm", "100 mm"], keep_samples=True, confidence=0.9
    )
    assert found.errors is not None
    kept = np.count_nonzero(np.linalg.norm(found.errors[:3], axis=0) <= 1e-3)
    assert found.summary.specifications[0].probability == kept / 2000
    assert found.pose_name == "paper"
    assert found.to_dict()["relative_to"] == {"name": "", "q": dict(zip(JOINTS, Q.tolist(), strict=True))}
    assert "relative to a pose without a name" in repr(found)
    assert "relative_to" not in pp.monte_carlo(MODEL, samples=10).to_dict()
    with pytest.raises(UnknownNameError, match="pose"):
        pp.relative(MODEL, "paper", "home")
    with pytest.raises(InputError, match="threads"):
        pp.relative(MODEL, "paper", Q, threads=0)
