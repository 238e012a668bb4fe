"""How many built robots keep a limit at all of several poses: the samples of each pose again, robot by robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from itertools import islice
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.memory import check_memory
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.blocks import BLOCK
from precision_pin.kernel.many_poses import MOST_TOGETHER
from precision_pin.model.error_model import ErrorModel
from precision_pin.statistics import COMPONENTS, NORMS, Specification

_ROBOTS: Final = 4 * BLOCK
"""Robots of a task."""


def count_everywhere(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    specifications: Sequence[Specification],
    model: Literal["exact", "linear"],
    seed: int,
    samples: int,
    pool: Executor,
    step: Callable[[int], object],
) -> tuple[int, ...]:
    """Return how many robots keep each specification at all poses ``(n, P)``.

    Robot k has the draws that it has where each pose is sampled alone, so the counts are the same for any pool.

    Parameters
    ----------
    error_model, values, approaches, specifications, model, seed, samples
        As in :func:`precision_pin.sampling.many_poses.sample_poses`.
    pool
        What the robots are sampled on; threads, which share memory.
    step
        Called with the number of samples made since the last call.

    Raises
    ------
    InputError
        More robots than there is memory for, or errors too large to compute with.
    """
    if not specifications:
        return ()
    check_memory(float(samples * len(specifications)), f"marking {samples:,} robots", "sample fewer of them")
    kept = np.ones((len(specifications), samples), dtype=np.bool_)
    models, first_pose = error_model.at_columns(values, approaches), 0
    while together := list(islice(models, MOST_TOGETHER)):
        layouts = sampler.to_arrays_at_poses(together)

        def mark(first: int, layouts: Sequence[SamplerArrays], first_pose: int) -> int:
            count = min(_ROBOTS, samples - first)
            for pose, layout in enumerate(layouts, start=first_pose):
                errors = sampler.errors(layout, model, seed, first, count, pose=pose)
                kept[:, first : first + count] &= _inside(errors, specifications)
            return count * len(layouts)

        tasks = [pool.submit(mark, first, layouts, first_pose) for first in range(0, samples, _ROBOTS)]
        for task in tasks:
            step(task.result())
        first_pose += len(layouts)
    return tuple(kept.sum(axis=1).tolist())


def _inside(errors: Array, specifications: Sequence[Specification]) -> NDArray[np.bool_]:
    """Return which errors ``(6, N)`` keep each specification, ``(S, N)``."""
    quantities = np.empty((8, errors.shape[1]))
    quantities[list(COMPONENTS)] = np.abs(errors)
    quantities[list(NORMS)] = np.sqrt((errors.reshape(2, 3, -1) ** 2).sum(axis=1))
    rows, limits = zip(*((spec.row, spec.limit) for spec in specifications), strict=True)
    inside: NDArray[np.bool_] = quantities[list(rows)] <= np.array(limits)[:, None]
    return inside
