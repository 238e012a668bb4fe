"""Accuracy budgets for robot arms.

From a URDF and a sheet of error sources to the probability distribution of the end-effector's pose error, after Wei,
Jia and Chen (MATEC Web of Conferences 35, 02013, 2015). Names are imported when first used.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # type checkers know the name; importing typing takes a tenth of the time of importing this
if TYPE_CHECKING:
    from typing import Any, Final

    from precision_pin import sources as sources
    from precision_pin.analyses.allocation.allocate import allocate as allocate
    from precision_pin.analyses.budget.budget import budget as budget
    from precision_pin.analyses.calibration.calibrate import calibrate as calibrate
    from precision_pin.analyses.calibration.design import identifiability as identifiability
    from precision_pin.analyses.calibration.forecast import forecast_calibration as forecast_calibration
    from precision_pin.analyses.calibration.plan import plan_calibration as plan_calibration
    from precision_pin.analyses.calibration.population import population as population
    from precision_pin.analyses.calibration.population import ur_calibration as ur_calibration
    from precision_pin.analyses.compare.compare import compare as compare
    from precision_pin.analyses.compensation.compensate import compensate as compensate
    from precision_pin.analyses.exact_law.exact_law import exact_law as exact_law
    from precision_pin.analyses.first_order import pose_covariance as pose_covariance
    from precision_pin.analyses.iso9283.figures import iso9283_distance as iso9283_distance
    from precision_pin.analyses.iso9283.figures import iso9283_of as iso9283_of
    from precision_pin.analyses.iso9283.forecast import iso9283 as iso9283
    from precision_pin.analyses.map.map_poses import map_poses as map_poses
    from precision_pin.analyses.moments.moments import moments as moments
    from precision_pin.analyses.path.path_law import path_law as path_law
    from precision_pin.analyses.reliability.reliability import reliability as reliability
    from precision_pin.analyses.worst_case.worst_case import worst_case as worst_case
    from precision_pin.base.errors import InputError as InputError
    from precision_pin.base.errors import PrecisionPinError as PrecisionPinError
    from precision_pin.base.progress import progress as progress
    from precision_pin.draws.correlation import Correlation as Correlation
    from precision_pin.draws.draw import Draw as Draw
    from precision_pin.draws.draw import Scope as Scope
    from precision_pin.draws.laws import Arcsine as Arcsine
    from precision_pin.draws.laws import Circle as Circle
    from precision_pin.draws.laws import Disc as Disc
    from precision_pin.draws.laws import Empirical as Empirical
    from precision_pin.draws.laws import Fixed as Fixed
    from precision_pin.draws.laws import JointNormal as JointNormal
    from precision_pin.draws.laws import Lognormal as Lognormal
    from precision_pin.draws.laws import Normal as Normal
    from precision_pin.draws.laws import Rows as Rows
    from precision_pin.draws.laws import Triangular as Triangular
    from precision_pin.draws.laws import TruncatedNormal as TruncatedNormal
    from precision_pin.draws.laws import TwoPoint as TwoPoint
    from precision_pin.draws.laws import Uniform as Uniform
    from precision_pin.draws.space import Space as Space
    from precision_pin.model.error_model import ErrorModel as ErrorModel
    from precision_pin.model.error_model import every_frame as every_frame
    from precision_pin.robot import mcpc as mcpc
    from precision_pin.robot.chain import Chain as Chain
    from precision_pin.robot.chain import Posture as Posture
    from precision_pin.robot.configurations import ApproachedPose as ApproachedPose
    from precision_pin.robot.inverse_kinematics import inverse_kinematics as inverse_kinematics
    from precision_pin.robot.pose_grids import Orientation as Orientation
    from precision_pin.robot.pose_grids import box_places as box_places
    from precision_pin.robot.pose_grids import joint_grid as joint_grid
    from precision_pin.robot.pose_grids import place_grid as place_grid
    from precision_pin.robot.pose_grids import plane_places as plane_places
    from precision_pin.robot.pose_grids import random_poses as random_poses
    from precision_pin.robot.postures import Postures as Postures
    from precision_pin.robot.trajectory import read_trajectory as read_trajectory
    from precision_pin.sampling import monte_carlo as monte_carlo
    from precision_pin.sampling.approaches import sample_approaches as sample_approaches
    from precision_pin.sampling.many_poses import sample_poses as sample_poses
    from precision_pin.sampling.one_pose import relative as relative
    from precision_pin.sampling.poses_result import PosesResult as PosesResult
    from precision_pin.sampling.result import MonteCarloResult as MonteCarloResult
    from precision_pin.sheet.measurement import Measurement as Measurement
    from precision_pin.statistics.plan import specification as specification
    from precision_pin.terms.source import Source as Source
    from precision_pin.terms.term import Term as Term

_NAMES: Final = {
    "analyses.allocation.allocate": "allocate",
    "analyses.budget.budget": "budget",
    "analyses.calibration.calibrate": "calibrate",
    "analyses.calibration.design": "identifiability",
    "analyses.calibration.forecast": "forecast_calibration",
    "analyses.calibration.plan": "plan_calibration",
    "analyses.calibration.population": "population ur_calibration",
    "analyses.compare.compare": "compare",
    "analyses.compensation.compensate": "compensate",
    "analyses.exact_law.exact_law": "exact_law",
    "analyses.iso9283.figures": "iso9283_distance iso9283_of",
    "analyses.iso9283.forecast": "iso9283",
    "analyses.first_order": "pose_covariance",
    "analyses.map.map_poses": "map_poses",
    "analyses.moments.moments": "moments",
    "analyses.path.path_law": "path_law",
    "analyses.reliability.reliability": "reliability",
    "analyses.worst_case.worst_case": "worst_case",
    "base.errors": "InputError PrecisionPinError",
    "base.progress": "progress",
    "draws.correlation": "Correlation",
    "draws.draw": "Draw Scope",
    "draws.laws": "Arcsine Circle Disc Empirical Fixed JointNormal Lognormal Normal Rows Triangular "
    "TruncatedNormal TwoPoint Uniform",
    "draws.space": "Space",
    "model.error_model": "ErrorModel every_frame",
    "robot.chain": "Chain Posture",
    "robot.configurations": "ApproachedPose",
    "robot.inverse_kinematics": "inverse_kinematics",
    "robot.pose_grids": "Orientation box_places joint_grid place_grid plane_places random_poses",
    "robot.postures": "Postures",
    "robot.trajectory": "read_trajectory",
    "sampling": "monte_carlo",
    "sampling.approaches": "sample_approaches",
    "sampling.many_poses": "sample_poses",
    "sampling.one_pose": "relative",
    "sampling.poses_result": "PosesResult",
    "sampling.result": "MonteCarloResult",
    "sheet.measurement": "Measurement",
    "statistics.plan": "specification",
    "terms": "Source Term",
}
"""Names of each module, apart by blanks."""
_HOMES: Final = {name: module for module, names in _NAMES.items() for name in names.split()}
_MODULES: Final = {"mcpc": "robot.mcpc", "sources": "sources"}

__all__ = [*sorted(_HOMES), *_MODULES]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{_MODULES[name]}")
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    if not name.startswith("_"):
        registered = importlib.import_module(f"{__name__}.analyses.registry").find_function(name)
        if registered is not None:
            return registered
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def sheet_keys() -> dict[str, str]:
    """Return the keys of a sheet that analyses declare, with their descriptions."""
    keys: dict[str, str] = importlib.import_module(f"{__name__}.analyses.registry").sheet_keys()
    return keys


def __dir__() -> list[str]:
    return sorted(__all__)
