"""Blocks of samples: their statistics, and the addition to a state.

Units are sampled in *blocks* of `BLOCK`. Each block has its own sums, which depend on the error model, the seed and the
block's number only. Added in block order (`Blocks.add_to`) they give the same bits for any distribution of the blocks over
calls, threads or machines of one type, and the same bits as :func:`precision_pin.statistics.observe`. The size of a block
must therefore not change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.kernel.loops import ATOM
from precision_pin.statistics import State, largest_of

BLOCK: Final = ATOM
"""Units in a block, 16,384."""

MOST_UNITS: Final = 2**63
"""Number of units that signed integers of 64 bits can index."""

# the sketch counts with 32 bits: with more samples in a call a bin could overflow
_MOST_BLOCKS_IN_A_CALL: Final = 2**32 // BLOCK - 1
_UPPER: Final = np.triu_indices(6)


@final
@dataclass(frozen=True, eq=False)
class Blocks:
    """Sums, extremes, bins and counts of consecutive blocks.

    Attributes
    ----------
    count
        Number of samples.
    lowest, highest
        ``(8,)`` smallest and largest value of each quantity.
    sums
        ``(blocks, 31)`` sums of each block: of (value - centre) of the eight quantities, of the products of two
        components' (value - centre) (upper triangle of 6 × 6, by rows), and of the squared (value - centre) of the norms.
    sketch
        ``(8, COLUMNS)`` counts, see :mod:`precision_pin.statistics.sketch`.
    inside
        ``(S,)`` samples inside each specification.
    largest, largest_units
        ``(2, LARGEST)`` largest |d| and |δ|, and the units with these errors, see
        :class:`precision_pin.statistics.State`.
    errors
        ``(6, count)`` the errors themselves, or None if they are not kept.
    """

    count: int
    lowest: Array
    highest: Array
    sums: Array
    sketch: NDArray[np.uint32]
    inside: NDArray[np.int64]
    largest: Array
    largest_units: NDArray[np.int64]
    errors: Array | None

    def add_to(self, state: State) -> State:
        """Return the state with these blocks added; in block order, the bits do not depend on the grouping."""
        before = np.concatenate([state.sums, state.products[_UPPER], state.norm_squares])
        # one block after another: np.sum would add pairwise
        sums = np.add.accumulate(np.vstack([before, self.sums]), axis=0)[-1]
        products = np.empty((6, 6))
        products[_UPPER] = products.T[_UPPER] = sums[8:29]
        largest, units = largest_of(state.largest, state.largest_units, self.largest, self.largest_units)
        return State(
            count=state.count + self.count,
            lowest=np.minimum(state.lowest, self.lowest),
            highest=np.maximum(state.highest, self.highest),
            sums=sums[:8],
            products=products,
            norm_squares=sums[29:],
            sketch=state.sketch + self.sketch,
            inside=state.inside + self.inside,
            largest=largest,
            largest_units=units,
        )


def check_blocks(first_block: int, blocks: int, samples: int | None) -> tuple[int, int]:
    """Return the first unit and the number of units of some blocks, in a run of the given number of samples.

    Raises
    ------
    InputError
        The blocks are outside the run, or too many for one call.
    """
    first = int(first_block) * BLOCK
    end = min(first + int(blocks) * BLOCK, MOST_UNITS)
    count = (end if samples is None else min(end, int(samples))) - first
    if first_block < 0 or not 0 < blocks <= _MOST_BLOCKS_IN_A_CALL or count <= 0:
        raise InputError(
            f"blocks {first_block} to {first_block + blocks - 1} of {samples} samples: from block 0, "
            f"1 to {_MOST_BLOCKS_IN_A_CALL} blocks in a call, none beyond the last sample"
        )
    return first, count
