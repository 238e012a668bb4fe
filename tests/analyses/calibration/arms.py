"""Arms and poses of the calibration's tests."""

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy.linalg

import precision_pin as pp
from precision_pin.analyses.readings import as_measured, simulate_readings, stations_of
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import JointCompliance, JointOffset, Length

OFF_AXIS = (0.05, 0.03, 0.02)


@cache
def paper_model():
    return pp.ErrorModel.load(PAPER_SHEET)


def offsets(law, *more, joints=None):
    """Return the paper's arm with offsets of all joints, or of some, and other sources."""
    sources = [JointOffset(joint=name, offset=law) for name in joints or paper_model().chain.joint_names]
    return pp.ErrorModel(paper_model().chain, pp.Space(), [*sources, *more])


@cache
def plain_model():
    """Return the paper's arm with normal offsets and lengths, a load, and joints that do not stop where they did before."""
    chain = paper_model().chain
    again = {"joint1": (2e-5, pp.Scope.VISIT), "joint2": (2e-5, pp.Scope.VISIT), "joint3": (1e-5, pp.Scope.POSE)}
    sources = [JointOffset(joint=name, offset=pp.Normal(1e-3)) for name in chain.joint_names]
    sources += [JointOffset(joint=name, offset=pp.Draw("", pp.Normal(std), of)) for name, (std, of) in again.items()]
    sources += [Length(joint=name, along="link", parameters=(pp.Normal(3e-4),)) for name in ("joint3", "joint4")]
    sources += [JointCompliance(joint="joint2", compliance=pp.Normal(2e-6, mean=2e-5))]
    return pp.ErrorModel(chain, pp.Space(), sources, {"work": [0.2, -0.4, 0.9, 0.3], "home": [0.0, 0.3, 0.5, -0.3]})


def random_poses(joints, count, seed=0):
    return np.random.default_rng(seed).uniform(-2.2, 2.2, (joints, count))


def readings_of(model, q, measurement, seed=0):
    """Return readings of a simulated robot, attitudes as rotation vectors."""
    stations = stations_of(model, q, measurement)
    found = simulate_readings(stations, measurement, model, seed=seed)[:, :, 0]
    return as_measured(found, stations, measurement)


class Dense(NamedTuple):
    """A problem's readings in one piece: covariance of the noise, and whitened derivatives, further columns and residuals."""

    noise: np.ndarray
    by_z: np.ndarray
    by_nuisance: np.ndarray
    further: np.ndarray
    white: np.ndarray


def dense(problem, z, nuisances, causes=None):
    """Return a problem at z and nuisances in one piece, what readings share included."""
    pairs = list(problem.columns(z, nuisances, causes))
    covariances = [covariance for chunk, _ in pairs for covariance in chunk.noise.covariances]
    columns = np.vstack([problem.flat(*pair) for pair in pairs])
    shared, further = problem.common.size, nuisances.size + problem.unit.columns.size
    noise = scipy.linalg.block_diag(*covariances) + columns[:, :shared] @ columns[:, :shared].T
    white = np.linalg.solve(np.linalg.cholesky(noise), columns[:, shared:])
    by_nuisance, by_number, more, residuals = np.split(white, [nuisances.size, further, -1], axis=1)
    return Dense(noise, by_number / problem.unit.std @ problem.unit.root, by_nuisance, more, residuals[:, 0])
