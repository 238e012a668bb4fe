"""Findings about a model at a pose, before it is sampled."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.model.backlash_sides import turnover_findings
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.approach import ApproachedPose
from precision_pin.statistics import NO_SPREAD

TRIED: Final = 64
"""Robots sampled to find whether errors vary."""
MOST_POSES: Final = 200
"""Poses of a sheet that are tried; of further poses only the joint limits are checked, which is fast."""
MOST_NUMBERS: Final = 500
"""Random numbers up to which the first-order model is checked too, which needs every derivative."""
_LARGEST_SQUARE: Final = 1e75
_SEED: Final = 0


def pose_findings(model: ErrorModel, pose: str, *, spread: bool = True) -> tuple[Finding, ...]:
    """Return the findings that an analysis at a pose would have about the pose itself, errors included.

    Warnings about the range of validity of the statics are left to the analysis, since they concern an assumption of the
    model and no mistake in the sheet. With more than 500 random numbers some robots are sampled in place of the
    first-order check.

    Parameters
    ----------
    model
        The model.
    pose
        The name of the pose.
    spread
        Warn if no error varies.
    """
    try:
        with np.errstate(over="raise"):
            at = model.at(pose)
            found = [*at.findings("exact")]
            if at.space.size <= MOST_NUMBERS and _largest_square(at) > _LARGEST_SQUARE:
                raise OverflowError
            if spread and not _varies(at):
                message = (
                    "no source makes the error vary: all robots have the same error, and no specification can be judged"
                )
                found.append(Finding("warning", "W_NOTHING_VARIES", message))
    except (OverflowError, FloatingPointError):
        message = "the errors are too large to compute with; the tolerances or loads are far too large"
        return (Finding("error", "E_INPUT", message),)
    except InputError as error:
        return error.findings
    return tuple(found)


def strained_findings(
    model: ErrorModel, pose: Array | ApproachedPose, label: str, *, first_order: bool = False
) -> tuple[Finding, ...]:
    """Return the warnings at one pose of many about statics, and if asked for those of first-order results, with its name.

    An analysis of many poses looks at the one with the largest error alone, since each look solves the deflected arm.
    """
    # not model.at, which would warn of joint limits once more
    q, approach = model.configuration(pose)[:, None], model.approach(pose)
    at = next(model.at_columns(q, np.array(approach, dtype=np.int8)[:, None] if approach else None))
    found = (*model.statics_findings(at), *(turnover_findings(at) if first_order else ()))
    return tuple(replace(one, message=f"{label}: {one.message}") for one in found)


def _largest_square(at: PoseModel) -> float:
    return max(float(np.abs(at.error_at_means).max()) ** 2, float(np.abs(at.covariance).max()))


def _varies(at: PoseModel) -> bool:
    """Return whether robots differ, to first order or in a sample."""
    if not at.space.size:
        return False
    if at.space.size <= MOST_NUMBERS and float(np.diag(at.covariance).max()) > NO_SPREAD**2:
        return True
    errors = at.exact(at.space.sample(_SEED, 0, TRIED))
    # with very many numbers the sample may contain no rare value
    return bool(np.ptp(errors, axis=1).max() > NO_SPREAD) or at.space.size > MOST_NUMBERS
