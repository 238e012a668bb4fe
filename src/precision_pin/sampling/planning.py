"""Planning the centres to subtract and the width of bins, from the first samples of the seed.

First-order spreads are no guide where they vanish, as along the axes of a stretched arm: there products of errors decide.
The plan does not depend on how many samples follow nor on what computes them, so that neither does any bit of a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from precision_pin.errors import InputError
from precision_pin.kernel import sampler
from precision_pin.model.pose_model import PoseModel
from precision_pin.sampling.skewness import first_order_skewness
from precision_pin.statistics import Plan, Specification, quantity_values

__all__ = ["PILOT", "planned"]

PILOT: Final = 512
"""Samples that are planned from: the first of the seed, however many the run has."""

_FARTHEST: Final = 1e100
"""No error is planned for that is larger, m or rad."""


def planned(
    at: PoseModel,
    layout: sampler.SamplerArrays,
    model: Literal["exact", "linear"],
    seed: int,
    specifications: Sequence[Specification] = (),
) -> Plan:
    """Return the plan of a run at a pose.

    Parameters
    ----------
    at, layout
        The error model at the pose, and the same laid out.
    model, seed
        ``"exact"`` or ``"linear"``; 64-bit seed.
    specifications
        Limits to count against.
    """
    _, slopes = at.tangent
    skewness = first_order_skewness(at.space, slopes)
    try:
        pilot = quantity_values(sampler.errors(layout, model, seed, 0, PILOT))
    except InputError:
        # the run meets that sample itself, unless it ends before
        return replace(Plan.from_moments(at.error_at_means, at.covariance, tuple(specifications)), skewness=skewness)
    with np.errstate(over="ignore", invalid="ignore"):
        farthest = np.maximum(layout.highest - at.space.mean, at.space.mean - layout.lowest)
        reach = (np.abs(slopes) * np.minimum(farthest, _FARTHEST)).sum(axis=1)
    plan = Plan.from_pilot(pilot, np.minimum(np.nan_to_num(reach), _FARTHEST), tuple(specifications))
    return replace(plan, skewness=skewness)
