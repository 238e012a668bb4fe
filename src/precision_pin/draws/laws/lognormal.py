"""The lognormal law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import FARTHEST_NORMAL, Array, Law, in_chunks, take_size
from precision_pin.draws.laws.sheet_form import DEVIATIONS, LawOption, SheetForm, SheetReader
from precision_pin.errors import InputError

__all__ = ["Lognormal"]

WIDEST_LOGNORMAL: Final = 1e3
"""Largest standard deviation of a lognormal law, in means."""

_STEP: Final = 1 / 40
_NODES: Final = _STEP * np.arange(-360, 361)
"""For the characteristic function, standard deviations from the saddle point."""


@final
@dataclass(frozen=True)
class Lognormal(Law):
    """The exponential of a normal number: what cannot be negative and errs by a factor, as a stiffness does.

    With mean m and standard deviation s of the number itself, its logarithm has the variance σ² = ln(1 + s²/m²) and the
    mean ln m - σ²/2 (JCGM 101:2008, table 1, and C.3 of Johnson, Kotz and Balakrishnan, chapter 14).

    Attributes
    ----------
    std
        Standard deviation of the number itself.
    mean
        Its mean, above zero.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    form: ClassVar = SheetForm(
        "lognormal",
        {"lognormal": {"std": "0.1 mm"}, "mean": "1 mm"},
        "never negative; `std` and `mean` are those of the number itself, not of its logarithm; `mean` is needed",
        (LawOption("mean", "lognormal: needed", "1 mm"),),
        DEVIATIONS,
    )
    std: float
    mean: float

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a lognormal law")
        take_size(self, "mean", "the mean of a lognormal law", zero=False)
        if not self.std <= WIDEST_LOGNORMAL * self.mean:
            raise InputError(
                f"the standard deviation of a lognormal law is at most {WIDEST_LOGNORMAL:g} times its mean, "
                f"got {self.std!r} and {self.mean!r}"
            )

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Lognormal:
        """Return the law that a sheet has."""
        value = reader.settings["lognormal"]
        if not isinstance(value, Mapping) or set(value) != {"std"}:
            raise reader.error(
                ("lognormal",),
                "lognormal takes the standard deviation of the number itself: lognormal: {std: 0.1 mm}, mean: 1 mm",
            )
        if "mean" not in reader.settings:
            raise reader.error(("lognormal",), "lognormal needs a mean: of the number itself, above zero")
        std, mean = reader.half_width("lognormal", "std"), reader.mean()
        if not mean > 0:
            raise reader.error(
                ("mean",), f"the mean of a lognormal law must be above zero, got {reader.settings['mean']}"
            )
        return cls(std, mean)

    @property
    def log_std(self) -> float:
        """σ, the standard deviation of the logarithm."""
        return math.sqrt(math.log1p((self.std / self.mean) ** 2))

    @property
    def mean_vector(self) -> Array:
        """Mean, ``(1,)``."""
        return np.array([self.mean])

    @property
    def covariance(self) -> Array:
        """Variance as ``(1, 1)``."""
        return np.array([[self.std**2]])

    def sample(self, variates: Array) -> Array:
        """Return m exp(σ z - σ²/2)."""
        value: Array = self.mean * np.exp(self.log_std * variates - self.log_std**2 / 2)
        return value

    def support(self, direction: ArrayLike) -> float:
        """Return infinity above zero, 0 below; w·m where the number does not vary."""
        w = float(np.asarray(direction, dtype=float)[0])
        if not self.std:
            return w * self.mean
        return math.inf if w > 0 else 0.0

    def interval(self, number: int) -> tuple[float, float]:
        """Return m exp(± 8.6 σ - σ²/2)."""
        del number
        low, high = self.sample(np.array([-FARTHEST_NORMAL, FARTHEST_NORMAL]))
        return float(low), float(high)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(i t x), t ``(1, …)``, within 1e-12.

        There is no closed form. The integral over the normal number z is taken along a line parallel to the real axis: at
        the height of the saddle point of its integrand, -W(-i t m σ² exp(-σ²/2))/σ with Lambert's W, or higher, so that
        the integrand neither cancels nor oscillates where it counts. There the trapezoidal rule converges faster than any
        power of its step (Trefethen and Weideman, SIAM Review 56, 2014).
        """
        t = np.asarray(frequency, dtype=float)
        if not self.log_std:
            still: NDArray[np.complex128] = np.exp(1j * t[0] * self.mean)
            return still
        return in_chunks(self._along_saddles, t, 4 * _NODES.size)

    def _along_saddles(self, frequency: Array) -> NDArray[np.complex128]:
        sigma = self.log_std
        scaled = np.abs(frequency[0]) * self.mean * math.exp(-(sigma**2) / 2)
        saddle = -lazy_special.lambertw(-1j * scaled * sigma**2) / sigma
        height = np.maximum(saddle.imag, min(1.0, math.pi / (2 * sigma)))
        centre = -lazy_special.lambertw(scaled * sigma**2 * np.sin(sigma * height)).real / sigma
        z = (centre + 1j * height)[:, None] + _NODES
        integrand = np.exp(1j * scaled[:, None] * np.exp(sigma * z) - z**2 / 2)
        value = integrand.sum(axis=1) * (_STEP / math.sqrt(2 * math.pi))
        result: NDArray[np.complex128] = np.where(frequency[0] < 0, value.conj(), value)
        return result
