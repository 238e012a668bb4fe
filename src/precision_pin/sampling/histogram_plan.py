"""Planning of the centres to subtract and the width of the bins, from the first samples of the seed.

First-order spreads are of no use where they vanish, as along the axis of a stretched arm: there products of errors
dominate. The plan does not depend on the number of samples that follow nor on the workers, so that neither changes a bit
of the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.pose_model import PoseModel
from precision_pin.sampling.skewness import first_order_skewness
from precision_pin.statistics import Plan, Specification, quantity_values

PILOT: Final = 512
"""Number of samples for planning: the first of the seed, even in a shorter run."""

_FARTHEST: Final = 1e100
"""Largest error planned for, m or rad."""


def planned(
    at: PoseModel,
    layout: SamplerArrays,
    model: Literal["exact", "linear"],
    seed: int,
    specifications: Sequence[Specification] = (),
) -> Plan:
    """Return the plan of a run at a pose.

    Parameters
    ----------
    at, layout
        The error model at the pose, and its arrays for the sampler.
    model, seed
        ``"exact"`` or ``"linear"``; 64-bit seed.
    specifications
        Limits to count against.
    """
    _, slopes = at.tangent
    skewness = first_order_skewness(at.space.draws, slopes)
    try:
        pilot = quantity_values(sampler.errors(layout, model, seed, 0, PILOT))
    except InputError:
        # the run reports the invalid sample itself, unless it ends before it
        return replace(Plan.from_moments(at.error_at_means, at.covariance, tuple(specifications)), skewness=skewness)
    plan = Plan.from_pilot(pilot, reach(at, layout, slopes), tuple(specifications))
    return replace(plan, skewness=skewness)


def reach(at: PoseModel, layout: SamplerArrays, slopes: Array) -> Array:
    """Return the approximate largest deviation of each component ``(6,)`` for slopes ``(6, d)`` of the error."""
    with np.errstate(over="ignore", invalid="ignore"):
        farthest = np.maximum(layout.highest - at.space.mean, at.space.mean - layout.lowest)
        largest = (np.abs(slopes) * np.minimum(farthest, _FARTHEST)).sum(axis=1)
    result: Array = np.minimum(np.nan_to_num(largest), _FARTHEST)
    return result
