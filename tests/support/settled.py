"""Robots settled one by one: no expansion about the rest of another robot."""

from __future__ import annotations

import numpy as np

from precision_pin.model.equilibrium import settle
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel


def settled_errors(model: ErrorModel, q, x) -> np.ndarray:
    """Return the errors ``(6, N)`` of robots with component values ``(d, N)``, each at rest under its own loads."""
    nominal = ErrorModel(model.chain, model.space, model.sources, statics="nominal")
    posture = nominal.at(q).posture
    errors = []
    for column in np.asarray(x, dtype=float).T:
        rest = settle(posture, model.space, model._make_terms, values=column)
        errors.append(PoseModel(posture, model.space, rest.table, rest.terms).exact(column[:, None])[:, 0])
    return np.array(errors).T
