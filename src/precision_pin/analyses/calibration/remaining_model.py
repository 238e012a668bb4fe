"""The arm that is left after a calibration: its sources with the laws of what is still uncertain."""

from __future__ import annotations

from precision_pin.analyses.calibration.design import UnitNumbers, model_like
from precision_pin.draws.estimates import Estimates
from precision_pin.model.error_model import ErrorModel
from precision_pin.terms.labelled_sources import with_quantities
from precision_pin.typing import Array

__all__ = ["remaining_model"]


def remaining_model(model: ErrorModel, unit: UnitNumbers, mean: Array, covariance: Array) -> ErrorModel:
    """Return the calibrated arm.

    Parameters
    ----------
    model
        The arm before the calibration.
    unit
        Its numbers drawn once for each robot.
    mean, covariance
        Of these numbers after it, ``(U,)`` and ``(U, U)``.
    """
    space = Estimates(unit.names, mean, covariance).remaining_space(model.space)
    return model_like(model, model.chain, with_quantities(space, model.sources, model.labels, model.chain))
