"""Errors of one built robot at several poses: their covariance, and the error at one pose relative to another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.map.first_order import jacobians, shared_covariance
from precision_pin.base.arguments import check_instance
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import add, warns_at_end
from precision_pin.base.memory import check_memory
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import limit_findings


@warns_at_end
def pose_covariance(error_model: ErrorModel, poses: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Array:
    """Return the covariance between the errors of one robot at P poses, ``(P, 6, P, 6)``, first order, in closed form.

    ``Cov(e_p, e_q) = J_p Σ_unit J_qᵀ`` with the covariance of the draws of unit scope: a robot's draws of pose and visit scope
    at different poses are independent. For a pose with itself it is ``J Σ Jᵀ`` of all draws. Base axes, m and rad.

    Parameters
    ----------
    error_model
        Chain, draws and sources.
    poses
        As for :func:`precision_pin.sample_poses`.

    Raises
    ------
    InputError
        Wrong poses, or more than fit into memory.
    UnknownNameError
        No such pose or joint.
    """
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    values, _ = error_model.configurations(poses)
    count = values.shape[1]
    check_memory(8.0 * 36 * count**2, f"the covariance between {count:,} poses", "give fewer poses")
    add(limit_findings(error_model.chain, values))
    slopes = np.moveaxis(jacobians(error_model, values, error_model.approaches_of(poses, values)), -1, 0)
    flat = slopes.reshape(6 * count, -1)
    space = error_model.space
    result = shared_covariance(space).between(flat, flat).reshape(count, 6, count, 6)
    for pose, own in enumerate(slopes):
        result[pose, :, pose] = space.block_covariance.between(own, own)
    return result
