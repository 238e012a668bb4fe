"""How much of the variance comes from numbers of each provenance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel

__all__ = ["NOT_STATED", "OriginShares", "origin_shares"]

NOT_STATED: Final = "not stated"
"""Of numbers of which the sheet does not say where they come from."""

OriginShares = Mapping[str, tuple[float, float]]
"""Share in the variance of position and attitude by provenance; their sums are one where the error varies."""


def origin_shares(model: ErrorModel, at: PoseModel) -> OriginShares:
    """Return the shares in the first-order variance, ``Cov(e_k, e)`` summed over the numbers of each provenance.

    Empty where the sheet states no provenance at all.
    """
    if not any(model.origins.values()):
        return {}
    space = at.space
    jacobian = at.jacobian
    spread = space.block_covariance.times(np.ascontiguousarray(jacobian.T))
    by_component = [np.einsum("id,di->d", jacobian[rows], spread[:, rows]) for rows in (slice(0, 3), slice(3, 6))]
    totals = [float(parts.sum()) for parts in by_component]
    found: dict[str, list[float]] = {}
    for column, name in enumerate(space.components):
        sums = found.setdefault(model.origins.get(name, "") or NOT_STATED, [0.0, 0.0])
        for vector, parts in enumerate(by_component):
            if totals[vector] > 0:
                sums[vector] += float(parts[column]) / totals[vector]
    ordered = sorted(found.items(), key=lambda entry: -entry[1][0])
    return {kind: (sums[0], sums[1]) for kind, sums in ordered}
