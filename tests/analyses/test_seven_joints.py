"""Every analysis on a seven-joint arm with correlated and shared draws."""

from __future__ import annotations

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.robot.examples import resolve_robot
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length

Q = (0.2, -0.6, 0.1, -2.2, 0.1, 1.7, 0.8)
STD = 3e-4
CORRELATION = 0.6


@pytest.fixture(scope="module")
def panda() -> pp.ErrorModel:
    """Joint errors correlated one with another (a common calibration), one length error shared by two links."""
    chain = pp.Chain.from_urdf(resolve_robot("example:panda"), tip="panda_hand_tcp")
    matrix = STD**2 * (np.full((7, 7), CORRELATION) + (1 - CORRELATION) * np.eye(7))
    zero = pp.Draw("zero", pp.JointNormal(tuple(map(tuple, matrix.tolist()))))
    cut = pp.Draw("cut", pp.Normal(1e-4))
    sources = [JointOffset(joint=name, offset=f"zero.{k}") for k, name in enumerate(chain.joint_names)]
    sources += [Length(joint=name, parameters=("cut",)) for name in ("panda_joint3", "panda_joint5")]
    return pp.ErrorModel(chain, pp.Space((zero, cut)), sources)


@pytest.fixture(scope="module")
def covariance(panda: pp.ErrorModel) -> np.ndarray:
    """Return the closed form: the joints' columns of the kinematic Jacobian, and the direction of both lengths."""
    posture = panda.chain.at(Q)
    poses = posture.link_poses
    cut = np.zeros(6)
    for joint in (2, 4):
        way = poses[joint][:3, :3] @ panda.chain.placements[joint][:3, 3]
        cut[:3] += way / np.linalg.norm(way)
    joints = posture.joint_jacobian
    matrix = STD**2 * (CORRELATION * np.ones((7, 7)) + (1 - CORRELATION) * np.eye(7))
    return joints @ matrix @ joints.T + 1e-8 * np.outer(cut, cut)


def test_budget(panda: pp.ErrorModel, covariance: np.ndarray) -> None:
    pose = pp.budget(panda, [Q], samples=1024).poses[0]
    assert pose.std["position"] == pytest.approx(np.sqrt(np.trace(covariance[:3, :3])), rel=1e-6)
    assert sum(draw.share["position"] for draw in pose.draws) == pytest.approx(1.0, abs=1e-12)
    assert pose.draw("cut").share["attitude"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_worst_case(panda: pp.ErrorModel) -> None:
    k = 3.0
    at = panda.at(Q)
    pose = pp.worst_case(panda, [Q], k=k, samples=2000).poses[0]
    root = panda.space.draws[0].law.root
    joints, cut = at.jacobian[:, :7] @ root, at.jacobian[:, 7]
    for row, bound in zip(at.jacobian, pose.components, strict=True):
        by_hand = k * np.linalg.norm(row[:7] @ root) + k * 1e-4 * abs(row[7])
        assert bound.high == pytest.approx(by_hand, rel=1e-9, abs=1e-15)
    # along any direction u the bound is k |rootᵀ Jᵀ u| + k σ |u·cut|; a fine set of directions comes close from below
    directions = np.random.default_rng(1).normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    heights = k * np.linalg.norm(directions @ joints[:3], axis=1) + k * 1e-4 * np.abs(directions @ cut[:3])
    assert heights.max() <= pose.position.first_order.upper * (1 + 1e-12)
    assert heights.max() == pytest.approx(pose.position.first_order.lower, rel=1e-3)


@pytest.mark.slow
def test_exact_law(panda: pp.ErrorModel, covariance: np.ndarray) -> None:
    pose = pp.exact_law(panda, [Q], samples=50_000).poses[0]
    sd = np.sqrt(covariance[0, 0])
    law = pose.laws["position.x"]
    assert law.law.quantile(0.975) == pytest.approx(1.959963984540054 * sd, rel=1e-9)
    assert all(entry.agreement is None or entry.agreement.agrees for entry in pose.laws.values())
    assert pose.laws["position.norm"].law is not None  # every draw is normal


@pytest.mark.slow
def test_reliability_agrees_with_the_exact_law(panda: pp.ErrorModel) -> None:
    limit = pp.exact_law(panda, [Q], samples=2000).poses[0].laws["position.norm"].law.quantile(1 - 1e-4)
    specification = pp.specification(f"{limit * 1e3!r} mm @ 99.9 %")
    found = pp.reliability(panda, [specification], [Q], samples=100_000).poses[0].specifications[0]
    low, high = found.interval
    # the exact model and the first-order law differ by far less than these intervals at errors of a millimetre
    assert low < 1 - 1e-4 < high
    assert found.met
