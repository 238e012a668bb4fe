"""Functions of very many frequencies, a part of them at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "in_chunks"]

Array = NDArray[np.float64]

_CHUNK: Final = 2**20


def in_chunks(
    function: Callable[[Array], NDArray[np.complex128]], frequency: Array, width: int
) -> NDArray[np.complex128]:
    """Return a function ``(m, T) → (T,)`` of frequencies ``(m, …)``, called for so few at a time that memory suffices.

    Parameters
    ----------
    function
        Needs about ``width`` numbers for each of its T columns.
    frequency
        ``(m, …)``.
    width
        Numbers in memory for each frequency.
    """
    flat = frequency.reshape(frequency.shape[0], -1)
    step = max(1, _CHUNK // max(width, 1))
    parts = [function(flat[:, first : first + step]) for first in range(0, flat.shape[1], step)]
    return np.concatenate([np.zeros(0, dtype=complex), *parts]).reshape(frequency.shape[1:])
