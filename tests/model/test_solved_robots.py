"""Robots that find a datum one by one: where they agree with its first-order maps by construction, so they must here."""

import numpy as np

import precision_pin as pp
from precision_pin.robot.examples import resolve_robot

SPIKE = [[0, -70, 95, -115, -90, 0], [-3.5, -69.5, 93, -102.6, -63.8, -41.2], [1.6, -65.7, 83.9, -82.8, -101.4, 56.8]]


def test_a_perfect_robot_finds_its_tool_on_a_spike_with_rounded_poses():
    chain = pp.Chain.from_urdf(resolve_robot("example:ur5"), tip="tool0")
    tips = [chain.at(np.radians(pose)).pose[:3, 3] for pose in SPIKE]
    assert 1e-4 < np.ptp(tips, axis=0).max() < 1e-3
    model = pp.ErrorModel(chain, pp.Space(), [pp.sources.Frame(joint="elbow_joint", rz=pp.Normal(1e-3))])
    at = model.against(pp.Datum.tool_pivot(np.radians(SPIKE))).at(np.radians([5, -65, 95, -120, -88, 15]))
    assert np.abs(at.solved(np.zeros((at.space.size, 1)))).max() < 1e-9


def test_what_cancels_whole_is_no_reason_to_warn():
    """The elbow's axis is level: of its zero nothing is left about z but second order, which no map has."""
    chain = pp.Chain.from_urdf(resolve_robot("example:ur5"), tip="tool0")
    sources = [
        pp.sources.Frame(joint="shoulder_pan_joint", rz=pp.Normal(2e-3)),
        pp.sources.JointOffset(joint="elbow_joint", offset=pp.Normal(5e-4)),
    ]
    mark, work = np.radians([[-10, -70, 100, -120, -90, 10], [5, -65, 95, -120, -88, 15]])
    at = pp.ErrorModel(chain, pp.Space(), sources).against(pp.Datum.taught(mark, 1e-3)).at(work)
    assert at.covariance[5, 5] ** 0.5 < 1e-9
    assert at.findings("exact") == ()
    assert max(at.linearity[key] for key in ("mean", "std", "quantile_95")) < 0.01
