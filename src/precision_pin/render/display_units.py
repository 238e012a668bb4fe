"""Units in which values read well, colours of error sizes, and round numbers for scales."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.html import escaped

_STOPS: Final = 17


def round_number(value: float) -> float:
    """Return the 1, 2 or 5 times a power of ten that is nearest, by ratio, to a positive value."""
    power = math.floor(math.log10(value))
    candidates = [float(f"{digit}e{exponent}") for exponent in (power, power + 1) for digit in (1, 2, 5)]
    return min(candidates, key=lambda candidate: abs(math.log(candidate / value)))


@dataclass(frozen=True)
class ColourScale:
    """Position error sizes (m) as colours of matplotlib's viridis, light for small, dark for large."""

    # viridis is perceptually uniform and safe for colour-blind readers; its lightest tenth, faint on a light ground, is
    # left out

    smallest: float
    largest: float

    @classmethod
    def of(cls, sizes: ArrayLike) -> ColourScale:
        """Return the scale that spans ``(N,)`` sizes, m."""
        values = np.asarray(sizes, dtype=float)
        smallest, largest = float(values.min()), float(values.max())
        # differences within rounding count as one size
        return cls(smallest if largest - smallest > 1e-9 * largest else largest, largest)

    @property
    def stops(self) -> tuple[str, ...]:
        """CSS colours, evenly spaced from the smallest to the largest size."""
        return _hexadecimal(0.9 * np.linspace(1, 0, _STOPS))

    @property
    def dark_stops(self) -> tuple[str, ...]:
        """CSS colours for a dark ground: dark for small, light for large, without the darkest third."""
        return _hexadecimal(1.0 - 0.7 * np.linspace(1, 0, _STOPS))

    @property
    def unit(self) -> WrittenUnit:
        """The unit of the labels, at least µm."""
        return WrittenUnit.of_axis("position", max(self.largest, 1e-6))

    @property
    def ticks(self) -> tuple[str, ...]:
        """Labels without unit, evenly spaced from the smallest to the largest size; one if these are equal."""
        return self._ticks(self.unit.per_si)

    def _ticks(self, per_metre: float) -> tuple[str, ...]:
        values = np.linspace(self.smallest, self.largest, 5 if self.largest > self.smallest else 1) * per_metre
        step = (self.largest - self.smallest) * per_metre / 4 or self.largest * per_metre / 10
        decimals = min(6, max(0, 1 - math.floor(math.log10(step)))) if step > 0 else 0
        return tuple(f"{value:.{decimals}f}" for value in values)

    def bar(self, per_metre: float | None = None) -> str:
        """Return the colour bar with labels as HTML; in :attr:`unit`, or in a unit of ``per_metre`` per metre."""
        labels = self.ticks if per_metre is None else self._ticks(per_metre)
        ticks = "".join(f"<span>{escaped(tick)}</span>" for tick in labels)
        colours = ", ".join(self.stops)
        return f'<div class="bar" style="background: linear-gradient(to right, {colours})"></div><p class="ticks">{ticks}</p>'


def _hexadecimal(places: ArrayLike) -> tuple[str, ...]:
    """Return viridis colours at places from 0, dark, to 1, light."""
    # imported late: matplotlib costs a third of a second
    from matplotlib import colormaps

    colours = np.rint(255 * colormaps["viridis"](np.asarray(places, dtype=float))[..., :3]).astype(int)
    return tuple(f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colours)
