"""The error of a robot at a pose relative to its error at another: samples one at a time, closed form, threads."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.base.errors import InputError, PrecisionPinWarning, UnknownNameError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel.sampler import BLOCK
from precision_pin.sources import JointOffset
from sampling.cases import MODEL

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


def joint_slopes(q: np.ndarray) -> np.ndarray:
    """Return the slopes of the tip's motion to the joints, by differences of nominal poses."""
    step, columns = 1e-6, []
    for joint in range(4):
        moved = [MODEL.chain.at(q + sign * step * np.eye(4)[joint]).pose for sign in (1, -1)]
        turned = (moved[0][:3, :3] - moved[1][:3, :3]) @ MODEL.chain.at(q).pose[:3, :3].T / (2 * step)
        columns.append([*(moved[0][:3, 3] - moved[1][:3, 3]) / (2 * step), turned[2, 1], turned[0, 2], turned[1, 0]])
    return np.array(columns).T


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
    here, there = joint_slopes(P), joint_slopes(Q)
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
