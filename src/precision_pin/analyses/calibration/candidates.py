"""Poses that may be measured: random within the joints' limits."""

from __future__ import annotations

from typing import Final

import numpy as np

from precision_pin.draws.space import check_seed
from precision_pin.inputs.arguments import check_whole
from precision_pin.robot.chain import Chain
from precision_pin.typing import Array

__all__ = ["random_poses"]

_UNLIMITED: Final = np.pi
_MOST: Final = 10_000


def random_poses(chain: Chain, count: int, seed: int = 0) -> Array:
    """Return joint values ``(n, count)``, uniform within the limits; a joint without limits turns by ±180 degrees.

    Self-collisions, obstacles and the instrument's view are not checked.
    """
    check_whole("the number of random poses", count, 1, _MOST)
    check_seed(seed)
    low, high = chain.configurations.limits
    low = np.where(np.isfinite(low), low, -_UNLIMITED)
    high = np.where(np.isfinite(high), high, _UNLIMITED)
    # a joint limited on one side only may have the other end beyond half a turn
    low, high = np.minimum(low, high), np.maximum(low, high)
    shares = np.random.default_rng(seed).uniform(size=(count, low.size)).T
    values: Array = low[:, None] + (high - low)[:, None] * shares
    return values
