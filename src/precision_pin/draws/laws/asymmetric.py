"""Laws of one number that need not be symmetric."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, Literal, cast, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import FARTHEST_NORMAL, Array, Law, in_chunks, take_number, take_rows, take_size
from precision_pin.errors import InputError
from precision_pin.inputs.arguments import check_number, check_numbers
from precision_pin.inputs.arrays import returns_read_only
from precision_pin.inputs.memory import check_memory

__all__ = ["Empirical", "Lognormal", "TwoPoint"]

WIDEST_LOGNORMAL: Final = 1e3
"""Largest standard deviation of a lognormal law, in means."""

_BYTES: Final = 300.0
"""Of memory for each sample of an empirical law, as tuples and as arrays."""

_STEP: Final = 1 / 40
_NODES: Final = _STEP * np.arange(-360, 361)
"""For the characteristic function of a lognormal law, standard deviations from the saddle point."""


class _BoundedLaw(Law):
    """Of one number, between two ends."""

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""

    def support(self, direction: ArrayLike) -> float:
        """Return h(w) = w·highest for w above zero, w·lowest below."""
        w = float(np.asarray(direction, dtype=float)[0])
        return max(w * end for end in self.ends)


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


@final
@dataclass(frozen=True)
class TwoPoint(_BoundedLaw):
    """One of two values, centre - half_width or centre + half_width: a side taken, a sign not known.

    Attributes
    ----------
    half_width
        Half the distance of the two.
    centre
        Halfway between them; the mean only where both are equally likely.
    probability
        Of the upper one.
    """

    half_width: float
    centre: float = 0.0
    probability: float = 0.5

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of a two-point law")
        take_number(self, "centre", "the centre of a two-point law")
        probability = check_number(
            "the probability of a two-point law", self.probability, "above 0 and below 1", lambda value: 0 < value < 1
        )
        object.__setattr__(self, "probability", probability)

    @property
    def ends(self) -> tuple[float, float]:
        """The two values."""
        return self.centre - self.half_width, self.centre + self.half_width

    @property
    def threshold(self) -> float:
        """The uniform number above which the upper value is drawn."""
        return 1 - self.probability

    @property
    def breaks(self) -> tuple[float, ...]:
        """The threshold."""
        return (self.threshold,)

    @property
    def mean_vector(self) -> Array:
        """Centre + t (2p - 1), ``(1,)``."""
        return np.array([self.centre + self.half_width * (2 * self.probability - 1)])

    @property
    def covariance(self) -> Array:
        """4 p (1 - p) t² as ``(1, 1)``."""
        return np.array([[4 * self.probability * (1 - self.probability) * self.half_width**2]])

    def sample(self, variates: Array) -> Array:
        """Return the upper value for u above 1 - p, else the lower one."""
        return self.centre + np.where(variates > self.threshold, self.half_width, -self.half_width)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return (cos(t half_width) + i (2p - 1) sin(t half_width)) exp(i t centre), t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)[0]
        swing = np.cos(t * self.half_width) + 1j * (2 * self.probability - 1) * np.sin(t * self.half_width)
        value: NDArray[np.complex128] = np.exp(1j * t * self.centre) * swing
        return value


@final
@dataclass(frozen=True)
class Empirical(_BoundedLaw):
    """What was measured: a table of quantiles, straight lines between them.

    Attributes
    ----------
    quantiles
        ``(p, x)``: with probability p the number is at most x. From p = 0 to p = 1, neither ever falling. A p that stands
        twice is a gap in which nothing lies; an x that stands twice is a value with a probability of its own.

    Raises
    ------
    InputError
        A table that does not begin at 0, end at 1 and rise.
    """

    quantiles: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        take_rows(self, "quantiles", "the quantiles of an empirical law", 2)
        if len(self.quantiles) < 2:
            raise InputError("an empirical law needs at least two quantiles")
        p, x = self._knots
        if p[0] != 0 or p[-1] != 1:
            raise InputError(
                f"the quantiles of an empirical law go from probability 0 to 1, these from {p[0]:g} to {p[-1]:g}"
            )
        for k in (np.flatnonzero((np.diff(p) < 0) | (np.diff(x) < 0))[:1] + 1).tolist():
            for what, values in (("probability", p), ("value", x)):
                if values[k] < values[k - 1]:
                    raise InputError(
                        f"the quantiles of an empirical law rise, but the {what} {values[k]:g} follows {values[k - 1]:g}"
                    )

    @classmethod
    def from_samples(cls, samples: Iterable[float]) -> Empirical:
        """Return the law of n samples, the k-th smallest being the quantile at (k - 1/2)/n (Hazen).

        The outer half of the smallest and of the largest stays where it is, so that the law has the samples' mean.

        Raises
        ------
        InputError
            No sample, or one that is not finite.
        """
        if isinstance(samples, Iterable) and not isinstance(samples, str | bytes | np.ndarray):
            samples = list(samples)
        x = check_numbers("the samples of an empirical law", samples, (None,), "a list of finite numbers")
        check_memory(_BYTES * x.size, f"an empirical law of {x.size:,} samples", "give fewer, or its quantiles")
        x = np.sort(x)
        if not x.size:
            raise InputError("an empirical law needs at least one sample")
        p = np.concatenate([[0.0], (np.arange(x.size) + 0.5) / x.size, [1.0]])
        return cls(cast("Any", np.column_stack([p, np.concatenate([x[:1], x, x[-1:]])])))

    @property
    def sample_count(self) -> int | None:
        """How many samples the law was made of; None where it is no table that :meth:`from_samples` makes."""
        p, x = self._knots
        count = p.size - 2
        if count < 1 or x[0] != x[1] or x[-1] != x[-2]:
            return None
        return count if np.array_equal(p[1:-1], (np.arange(count) + 0.5) / count) else None

    @cached_property
    @returns_read_only
    def _knots(self) -> tuple[Array, Array]:
        table = np.array(self.quantiles, dtype=float)
        return table[:, 0].copy(), table[:, 1].copy()

    @cached_property
    @returns_read_only
    def segments(self) -> Array:
        """The straight lines ``(s, 4)``: the probability and value at which each begins, its slope, the value at its end."""
        p, x = self._knots
        step = np.diff(p)
        slopes = np.divide(np.diff(x), step, out=np.zeros_like(step), where=step > 0)
        lines: Array = np.column_stack([p[:-1], x[:-1], slopes, x[1:]])[step > 0]
        return lines

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""
        return float(self.segments[0, 1]), float(self.segments[-1, 3])

    @property
    def breaks(self) -> tuple[float, ...]:
        """The probabilities between 0 and 1 at which lines meet."""
        return tuple(self.segments[1:, 0].tolist())

    @property
    def mean_vector(self) -> Array:
        """Mean, ``(1,)``."""
        return np.array([self._shares @ (self.segments[:, 1] + self.segments[:, 3]) / 2])

    @property
    def covariance(self) -> Array:
        """Variance as ``(1, 1)``."""
        a, b = self.segments[:, 1] - self.mean_vector, self.segments[:, 3] - self.mean_vector
        return np.array([[self._shares @ (a * a + a * b + b * b) / 3]])

    def sample(self, variates: Array) -> Array:
        """Return the quantiles at u, by straight lines."""
        begin, value, slope, end = self.segments.T
        k = np.searchsorted(begin, variates, side="right") - 1
        result: Array = np.minimum(value[k] + slope[k] * (variates - begin[k]), end[k])
        return result

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return Σ Δp exp(i t (a + b)/2) sin(t (b - a)/2)/(t (b - a)/2) over the lines from a to b, t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)
        a, b = self.segments[:, 1], self.segments[:, 3]

        def of(part: Array) -> NDArray[np.complex128]:
            line = part[0][:, None]
            value: NDArray[np.complex128] = (
                np.exp(1j * line * ((a + b) / 2)) * np.sinc(line * ((b - a) / (2 * np.pi)))
            ) @ self._shares
            return value

        return in_chunks(of, t, 4 * a.size)

    @cached_property
    def _shares(self) -> Array:
        return np.diff(np.append(self.segments[:, 0], 1.0))
