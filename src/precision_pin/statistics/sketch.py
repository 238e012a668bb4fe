"""Histogram binned by the bits of a float: 512 bins per octave, twenty octaves, both signs.

A value is first centred and scaled, ``v = (value − centre) / scale``. The magnitude |v| falls into bin

- ``0`` below 2⁻¹² (one bin for all smaller magnitudes),
- ``1 + (bits(|v|) >> 43) − OFFSET`` up to 2⁸: the exponent and the top nine bits of the mantissa,
- ``BINS − 1``, the last bin, for all larger magnitudes.

The column of the sketch is ``BINS + bin`` for v ≥ 0 and ``BINS − 1 − bin`` for v < 0, so that columns
ascend with the value. Each step is monotone in the value, rounding included. The rank of a value is therefore
known exactly down to the bin, and two sketches are merged by adding their counts.

Error bound: a bin that contains v is at most ``max(2⁻¹², 2⁻⁹ |v|)`` wide, in units of the scale (the last bin
ends at the smallest or largest value). A value reconstructed inside its bin has at most this error.

The layout follows the float-bits histograms of HdrHistogram and DDSketch (Masson, Rim, Lee 2019, "DDSketch: a fast
and fully-mergeable quantile sketch with relative-error guarantees"), centred on the planned centre.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array

Counts = NDArray[np.int64]

MANTISSA_BITS: Final = 9
LOWEST_EXPONENT: Final = -12
HIGHEST_EXPONENT: Final = 8
SHIFT: Final = 52 - MANTISSA_BITS
"""Shift of a double's bits to the right, leaving exponent and top nine bits of the mantissa."""
OFFSET: Final = (1023 + LOWEST_EXPONENT) << MANTISSA_BITS
"""The shifted bits of 2⁻¹²."""
BINS: Final = 1 + ((HIGHEST_EXPONENT - LOWEST_EXPONENT) << MANTISSA_BITS)
"""Bins on each side of the centre: 10,241."""
COLUMNS: Final = 2 * BINS
"""Columns of a quantity's row of counts."""


def sketch_columns(scaled: Array) -> Counts:
    """Return the column of each centred and scaled value, in an array of the same shape.

    Args:
        scaled: ``v = (value − centre) / scale``, finite.
    """
    shifted = np.abs(scaled).view(np.int64) >> SHIFT
    magnitude_bin = np.minimum(np.maximum(shifted - (OFFSET - 1), 0), BINS - 1)
    return np.where(scaled < 0, BINS - 1 - magnitude_bin, BINS + magnitude_bin)


def sketch_edges() -> Array:
    """Return the ``COLUMNS + 1`` ascending edges of the columns in v; the outermost are infinite."""
    inner = (np.arange(BINS - 1, dtype=np.int64) + OFFSET) << SHIFT
    magnitude = np.concatenate(([0.0], inner.view(np.float64), [np.inf]))
    return np.concatenate((-magnitude[::-1], magnitude[1:]))
