"""Accuracy budgets for robot arms.

From a URDF and a sheet of error sources to the probability distribution of the end-effector's pose error, after Wei,
Jia and Chen (MATEC Web of Conferences 35, 02013, 2015). Names are imported when first used.

Model: ErrorModel, Chain, Space, Draw, Scope, Correlation, Source, Term, sources, every_frame, specification, Measurement.
Laws: Normal, Uniform, Triangular, TruncatedNormal, Lognormal, Arcsine, TwoPoint, Fixed, Empirical, Rows, Disc, Circle,
Sphere, JointNormal.
Poses: ApproachedPose, Datum, random_poses, joint_grid, place_grid, box_places, plane_places, Orientation, read_trajectory,
inverse_kinematics, Posture, Postures, mcpc.
Understand: monte_carlo, sample_poses, sample_approaches, relative, budget, worst_case, exact_law, reliability, moments,
map_poses, pose_covariance, path_law, stiffness; results MonteCarloResult, PosesResult.
Decide: compare, compensate, allocate.
Write: init, report, view, export, simulate; result Page.
Measure: iso9283, iso9283_of, iso9283_distance, forecast_calibration, plan_calibration, calibrate, population,
ur_calibration, identifiability.
Other: progress, InputError, PrecisionPinError.
"""

from __future__ import annotations

import importlib

import lazy_loader

# the names and their modules stand in __init__.pyi
_load, _, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted({*_names, "mcpc"} - {"sheet_keys"})


def __getattr__(name: str) -> object:
    if name == "mcpc":  # a module that its package does not import
        return importlib.import_module(f"{__name__}.robot.mcpc")
    try:
        return _load(name)
    except AttributeError:
        if name.startswith("_") or name in __all__:
            raise
    registered = importlib.import_module(f"{__name__}.analyses.registry").find_function(name)
    if registered is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return registered


def sheet_keys() -> dict[str, str]:
    """Return the keys of a sheet that analyses declare, with their descriptions."""
    keys: dict[str, str] = importlib.import_module(f"{__name__}.analyses.registry").sheet_keys()
    return keys


def __dir__() -> list[str]:
    return [*__all__]
