"""Phrases that describe laws, with numbers in suitable units."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.render.display_units import WrittenUnit


def write_number(value: float, quantity: Quantity | None) -> str:
    """Return a number with a suitable unit."""
    return WrittenUnit.suiting(quantity, [value])(value)


def about(half_width: float, mean: float, quantity: Quantity | None) -> str:
    """Return a half-width as text, with the mean if it is not zero."""
    unit = WrittenUnit.suiting(quantity, [half_width, mean])
    return f"±{unit(half_width)}" + (f" about {unit(mean)}" if mean else "")


def mean_beside(mean: float, quantity: Quantity | None) -> str:
    """Return the phrase for a mean, empty for zero."""
    return f", mean {write_number(mean, quantity)}" if mean else ""


def spread(mean: Array, covariance: Array, quantity: Quantity | None) -> str:
    """Return the phrase for the mean and the standard deviation of one number."""
    std = math.sqrt(float(covariance[0, 0]))
    return f", mean {write_number(float(mean[0]), quantity)}, standard deviation {write_number(std, quantity)}"


def deviations(components: Sequence[str], covariance: Array, quantities: Sequence[Quantity | None]) -> str:
    """Return the phrase for the standard deviations of several numbers."""
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    each = zip(components, stds, quantities, strict=True)
    return "standard deviations " + ", ".join(
        f"{name.removeprefix('.')} {write_number(std, quantity)}" for name, std, quantity in each
    )
