"""Arms and poses of the calibration's tests."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import precision_pin as pp
from precision_pin.analyses.calibration.design import stations_of
from precision_pin.analyses.calibration.forecast import as_measured, simulate_readings
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.sources import JointCompliance, JointOffset, Length

OFF_AXIS = (0.05, 0.03, 0.02)
TIPS = {"ur5": "tool0", "panda": "panda_hand_tcp"}


@cache
def paper_model() -> pp.ErrorModel:
    return pp.ErrorModel.load(PAPER_SHEET)


def chain_of(name: str) -> Chain:
    """Return the paper's arm, ``ur5`` or ``panda``; skip the test where example-robot-data is not installed."""
    if name == "paper":
        return paper_model().chain
    found = example_urdfs()
    if name not in found:
        pytest.skip("example-robot-data is not installed")
    return Chain.from_urdf(found[name], TIPS[name], locked={"panda_finger_joint1": 0.0} if name == "panda" else None)


@cache
def plain_model() -> pp.ErrorModel:
    """Return the paper's arm with normal offsets and lengths, a load, and joints that do not stop where they did before."""
    chain = paper_model().chain
    sources: list[pp.Source] = [JointOffset(joint=name, offset=pp.Normal(1e-3)) for name in chain.joint_names]
    sources += [
        JointOffset(joint=name, offset=pp.Draw("", pp.Normal(2e-5), pp.Scope.VISIT)) for name in chain.joint_names[:2]
    ]
    sources += [JointOffset(joint="joint3", offset=pp.Draw("", pp.Normal(1e-5), pp.Scope.POSE))]
    sources += [Length(joint=name, along="link", parameters=(pp.Normal(3e-4),)) for name in ("joint3", "joint4")]
    sources += [JointCompliance(joint="joint2", compliance=pp.Normal(2e-6, mean=2e-5))]
    return pp.ErrorModel(chain, pp.Space(), sources, {"work": [0.2, -0.4, 0.9, 0.3], "home": [0.0, 0.3, 0.5, -0.3]})


def random_poses(joints: int, count: int, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(-2.2, 2.2, (joints, count))


def readings_of(
    model: pp.ErrorModel, q: NDArray[np.float64], measurement: pp.Measurement, seed: int = 0
) -> NDArray[np.float64]:
    """Return readings of a simulated robot, attitudes as rotation vectors."""
    stations = stations_of(model, q, measurement)
    found = simulate_readings(stations, measurement, model, seed=seed)[:, :, 0]
    return as_measured(found, stations, measurement)
