"""Sampled errors themselves, for pictures; an analysis keeps statistics instead."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.kernel import sampler

if TYPE_CHECKING:
    from precision_pin.model.pose_model import PoseModel
    from precision_pin.sampling import Progress

_CHUNK: Final = 2**14
"""Samples between two progress steps."""


def sample_errors(
    at: PoseModel, samples: int, *, seed: int, model: Literal["exact", "linear"], pose: int, progress: Progress
) -> Array:
    """Return the errors ``(6, samples)``, m and rad, base axes, of the first robots at a pose.

    They are the robots that :func:`precision_pin.monte_carlo` samples with the same seed. ``pose`` numbers the pose for
    draws of pose scope.
    """
    table, chunks = sampler.to_arrays(at), []
    for first in range(0, samples, _CHUNK):
        count = min(_CHUNK, samples - first)
        chunks.append(sampler.errors(table, model, seed, first, count, pose=pose))
        progress(count)
    return np.concatenate(chunks, axis=1)
