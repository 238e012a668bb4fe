"""Drift of the pose accuracy while the robot warms up."""

from __future__ import annotations

from typing import Final

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel

HOURS: Final = 8.0
"""Duration of the test; the standard ends it there, or earlier where the drift has become slow."""
_TESTS: Final = 17
"""Times at which AP is measured, the first at the start: every half hour."""


def drift_from_cold(
    error_model: ErrorModel, q: Array, target: Array, robots: int, cycles: int, seed: int
) -> Array | None:
    """Return ``max |AP_0 - AP_t|`` of each robot over a test that starts cold, m, ``(N,)``.

    ``None`` where no error of the sheet changes with time. The arguments are those of
    :func:`precision_pin.analyses.iso9283.approach_figures.approach_figures`; each AP is of as many cycles.
    """
    bound = error_model.bound_sources
    if all(one.source.after(0.0, one.view) is one.source for one in bound):
        return None
    found = []
    for k, seconds in enumerate(np.linspace(0.0, 3600 * HOURS, _TESTS)):
        sources = [one.source.after(float(seconds), one.view) for one in bound]
        model = ErrorModel(error_model.chain, error_model.space, sources, statics=error_model.statics)
        found.append(_accuracy(model, q, target, robots, range(k * cycles, (k + 1) * cycles), seed))
    largest: Array = np.abs(np.array(found[1:]) - found[0]).max(axis=0)
    return largest


def _accuracy(model: ErrorModel, q: Array, target: Array, robots: int, visits: range, seed: int) -> Array:
    """Return AP of each robot, ``(N,)``: how far the barycentre of its visits is from the commanded position."""
    at = model.at(q)
    layout = sampler.to_arrays(at)
    lever = at.posture.pose[:3, :3] @ target
    barycentre = np.zeros((3, robots))
    for visit in visits:
        error = sampler.errors(layout, "exact", seed, 0, robots, visit=visit)
        barycentre += error[:3] + np.einsum("ijn,j->in", se3.exp_rotation(error[3:]), lever) - lever[:, None]
    result: Array = np.sqrt(((barycentre / len(visits)) ** 2).sum(axis=0))
    return result
