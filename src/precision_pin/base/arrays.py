"""The type of an array of numbers, as signatures name it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers in double precision, of any shape; docstrings say which."""
