"""What one draw adds to one component of the tangent model, as a random number ``z = w·(x - mean)`` of its own.

Each part knows its cumulative law and density in closed form, a smooth parametrisation to integrate along, and a bound of
its characteristic function that never rises: what the truncation of an inversion is certified by.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.exact_law.lognormal_transform import (
    LOGNORMAL_ERROR,
    lognormal_characteristic,
    lognormal_envelope,
)
from precision_pin.draws.laws import (
    FARTHEST_NORMAL,
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Law,
    Lognormal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.laws.law import in_chunks
from precision_pin.inputs.arrays import fix_fields

__all__ = ["Lines", "Part", "part_of"]

Array = NDArray[np.float64]

LARGEST_SCALED_BESSEL: Final = 0.82504
"""No z > 0 has √z |J₁(z)| above this; it is reached at z = 2.166."""


class Part(ABC):
    """A number of zero mean (or, of lines, any mean) along one direction of a law.

    The parametrisation: z = position(s) with the probability weight(s) ds, s from the first to the last of ``breaks``,
    both functions smooth between the breaks.
    """

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """Between which all of it lies."""

    @property
    @abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Ends and kinks of the parameter, rising."""

    @property
    def kinks(self) -> tuple[float, ...]:
        """Values between which the cumulative law is smooth, and no steeper in one place than in another by much."""
        return self.ends

    @abstractmethod
    def cumulative(self, z: Array) -> Array:
        """Return P(number ≤ z)."""

    @abstractmethod
    def density(self, z: Array) -> Array:
        """Return the density; not-a-number where it has none."""

    @abstractmethod
    def position(self, s: Array) -> Array:
        """Return the value at a parameter; never falling."""

    @abstractmethod
    def weight(self, s: Array) -> Array:
        """Return the density of the parameter."""

    @abstractmethod
    def parameter(self, z: Array) -> Array:
        """Return the parameter of a value, any value beyond the ends taken at the end."""

    @abstractmethod
    def envelope(self, frequency: Array) -> Array:
        """Return a bound of |E exp(i ω z)| that never rises with ω."""

    @abstractmethod
    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        """Return E exp(i ω z), from deviations alone: a mean far larger than the spread takes no digits."""

    @property
    def characteristic_error(self) -> float:
        """Bound of the error of :meth:`characteristic`, that of rounding ω apart."""
        return 1e-15

    def within(self, score: float) -> tuple[float, float]:
        """Return ends beyond which lies no more than beyond ± a number of standard deviations of a normal law."""
        del score
        return self.ends

    @property
    def is_bounded(self) -> bool:
        """Whether nothing lies beyond the ends."""
        return True


@dataclass(frozen=True)
class _SymmetricPart(Part):
    reach: float

    @property
    def ends(self) -> tuple[float, float]:
        """Minus and plus the reach."""
        return -self.reach, self.reach

    def _scaled(self, z: Array) -> Array:
        scaled: Array = np.clip(z / self.reach, -1.0, 1.0)
        return scaled

    def _inside(self, z: Array, density: Array) -> Array:
        value: Array = np.where(np.abs(z) < self.reach, density, 0.0)
        return value


@final
@dataclass(frozen=True)
class _UniformPart(_SymmetricPart):
    @property
    def breaks(self) -> tuple[float, ...]:
        return -1.0, 1.0

    def cumulative(self, z: Array) -> Array:
        value: Array = (1 + self._scaled(z)) / 2
        return value

    def density(self, z: Array) -> Array:
        return self._inside(z, np.full_like(z, 0.5 / self.reach))

    def position(self, s: Array) -> Array:
        return self.reach * s

    def weight(self, s: Array) -> Array:
        return np.full_like(s, 0.5)

    def parameter(self, z: Array) -> Array:
        return self._scaled(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return np.sinc(self.reach * frequency / np.pi).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, 1/(a ω)), from sin(a ω)/(a ω)."""
        return _power(1.0, 1.0, self.reach * frequency)


@final
@dataclass(frozen=True)
class _TriangularPart(_SymmetricPart):
    @property
    def breaks(self) -> tuple[float, ...]:
        return -1.0, 0.0, 1.0

    @property
    def kinks(self) -> tuple[float, ...]:
        return -self.reach, 0.0, self.reach

    def cumulative(self, z: Array) -> Array:
        t = self._scaled(z)
        tail = (1 - np.abs(t)) ** 2 / 2
        value: Array = np.where(t > 0, 1 - tail, tail)
        return value

    def density(self, z: Array) -> Array:
        return (1 - np.abs(self._scaled(z))) / self.reach

    def position(self, s: Array) -> Array:
        return self.reach * s

    def weight(self, s: Array) -> Array:
        return 1 - np.abs(s)

    def parameter(self, z: Array) -> Array:
        return self._scaled(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return (np.sinc(self.reach * frequency / (2 * np.pi)) ** 2).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, 4/(a ω)²), the square of a uniform law's of half the reach."""
        return _power(4.0, 2.0, self.reach * frequency)


@final
@dataclass(frozen=True)
class _TruncatedPart(_SymmetricPart):
    k: float

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(np.linspace(-self.k, self.k, 1 + 2 * math.ceil(self.k / 1.5)).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple((self.reach / self.k * np.array(self.breaks)).tolist())

    @property
    def _inner(self) -> float:
        return math.erf(self.k / math.sqrt(2))

    def cumulative(self, z: Array) -> Array:
        score = self.k * self._scaled(z)
        value: Array = (1 + special.erf(score / math.sqrt(2)) / self._inner) / 2
        return value

    def density(self, z: Array) -> Array:
        return self._inside(z, self.weight(self.k * self._scaled(z)) * self.k / self.reach)

    def position(self, s: Array) -> Array:
        return self.reach / self.k * s

    def weight(self, s: Array) -> Array:
        value: Array = np.exp(-(s**2) / 2) / (math.sqrt(2 * math.pi) * self._inner)
        return value

    def parameter(self, z: Array) -> Array:
        return self.k * self._scaled(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        law = TruncatedNormal(self.reach / self.k, 0.0, self.k)
        return law.characteristic(frequency[None])

    @property
    def characteristic_error(self) -> float:
        return 2e-15 / self._inner

    def envelope(self, frequency: Array) -> Array:
        """Return the normal law's, and for the tails the less of their probability and total variation over ω, 4φ(k)/ω.

        All over P(|z| < k). Also at most the total variation of the whole density over ω (k small).
        """
        omega = np.maximum(self.reach / self.k * frequency, 1e-300)
        height = math.exp(-(self.k**2) / 2) / math.sqrt(2 * math.pi)
        tails = np.minimum(2 * special.ndtr(-self.k), 4 * height / omega)
        cut = (np.exp(-(omega**2) / 2) + tails) / self._inner
        whole = 2 / (math.sqrt(2 * math.pi) * self._inner * omega)
        bound: Array = np.minimum(np.minimum(cut, whole), 1.0)
        return bound


@final
@dataclass(frozen=True)
class _ArcsinePart(_SymmetricPart):
    @property
    def breaks(self) -> tuple[float, ...]:
        return -math.pi / 2, math.pi / 2

    def cumulative(self, z: Array) -> Array:
        value: Array = 0.5 + np.arcsin(self._scaled(z)) / np.pi
        return value

    def density(self, z: Array) -> Array:
        inside = np.abs(z) < self.reach
        t = np.where(inside, z / self.reach, 0.0)
        value: Array = np.where(inside, 1 / (np.pi * self.reach * np.sqrt((1 - t) * (1 + t))), 0.0)
        return value

    def position(self, s: Array) -> Array:
        value: Array = self.reach * np.sin(s)
        return value

    def weight(self, s: Array) -> Array:
        return np.full_like(s, 1 / np.pi)

    def parameter(self, z: Array) -> Array:
        value: Array = np.arcsin(self._scaled(z))
        return value

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        value: NDArray[np.complex128] = special.j0(self.reach * frequency).astype(complex)
        return value

    def envelope(self, frequency: Array) -> Array:
        """min(1, √(2/(π r ω))), since √(πz/2) |J₀(z)| ≤ 1 (Watson, Bessel functions, 15.5)."""
        return _power(math.sqrt(2 / math.pi), 0.5, self.reach * frequency)


@final
@dataclass(frozen=True)
class _SemicirclePart(_SymmetricPart):
    """A disc seen from the side."""

    @property
    def breaks(self) -> tuple[float, ...]:
        return -math.pi / 2, math.pi / 2

    def cumulative(self, z: Array) -> Array:
        t = self._scaled(z)
        value: Array = 0.5 + (t * np.sqrt((1 - t) * (1 + t)) + np.arcsin(t)) / np.pi
        return value

    def density(self, z: Array) -> Array:
        t = self._scaled(z)
        value: Array = 2 / (np.pi * self.reach) * np.sqrt((1 - t) * (1 + t))
        return value

    def position(self, s: Array) -> Array:
        value: Array = self.reach * np.sin(s)
        return value

    def weight(self, s: Array) -> Array:
        value: Array = 2 / np.pi * np.cos(s) ** 2
        return value

    def parameter(self, z: Array) -> Array:
        value: Array = np.arcsin(self._scaled(z))
        return value

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        t = self.reach * frequency
        safe = np.where(t != 0, t, 1.0)
        return np.where(t != 0, 2 * special.j1(safe) / safe, 1.0).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, c (r ω)^-3/2), from 2 J₁(z)/z and the largest √z |J₁(z)|."""
        return _power(2 * LARGEST_SCALED_BESSEL, 1.5, self.reach * frequency)


@final
@dataclass(frozen=True)
class _LognormalPart(Part):
    """The weight times (x - mean) of a lognormal number."""

    weight_of_number: float
    mean: float
    log_std: float

    @property
    def ends(self) -> tuple[float, float]:
        """What no number drawn exceeds."""
        low, high = self.position(np.array([-FARTHEST_NORMAL, FARTHEST_NORMAL]))
        return float(low), float(high)

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 13).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple(self.position(np.array(self.breaks)).tolist())

    def _number(self, z: Array) -> Array:
        return z / self.weight_of_number + self.mean

    def _score(self, z: Array) -> Array:
        number = np.maximum(self._number(z) / self.mean, 1e-300)
        value: Array = (np.log(number) + self.log_std**2 / 2) / self.log_std
        return value

    def cumulative(self, z: Array) -> Array:
        value: Array = special.ndtr(math.copysign(1.0, self.weight_of_number) * self._score(z))
        return value

    def density(self, z: Array) -> Array:
        number = self._number(z)
        slope = self.log_std * np.maximum(number, 1e-300) * abs(self.weight_of_number)
        value: Array = np.where(number > 0, _normal_density(self._score(z)) / slope, 0.0)
        return value

    def position(self, s: Array) -> Array:
        signed = math.copysign(1.0, self.weight_of_number) * s
        value: Array = self.weight_of_number * self.mean * np.expm1(self.log_std * signed - self.log_std**2 / 2)
        return value

    def weight(self, s: Array) -> Array:
        return _normal_density(s)

    def parameter(self, z: Array) -> Array:
        signed = math.copysign(1.0, self.weight_of_number) * self._score(z)
        value: Array = np.clip(signed, -FARTHEST_NORMAL, FARTHEST_NORMAL)
        return value

    @property
    def is_bounded(self) -> bool:
        return False

    def within(self, score: float) -> tuple[float, float]:
        low, high = self.position(np.array([-score, score]))
        return float(low), float(high)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return lognormal_characteristic(self.weight_of_number * self.mean * frequency, self.log_std)

    @property
    def characteristic_error(self) -> float:
        return LOGNORMAL_ERROR

    def envelope(self, frequency: Array) -> Array:
        """Return the least of 1, V/ω with V, twice its highest value, the total variation of the density, and a table."""
        scale = abs(self.weight_of_number) * self.mean
        height = scale * math.exp(-(self.log_std**2)) * self.log_std
        bound: Array = np.minimum(
            _power(2 / math.sqrt(2 * math.pi), 1.0, height * frequency),
            lognormal_envelope(scale * frequency, self.log_std),
        )
        return bound


@final
@dataclass(frozen=True, eq=False)
class Lines(Part):
    """Uniform pieces and single values: empirical and two-point laws, rows of a table.

    Attributes
    ----------
    shares
        Probability of each piece, ``(s,)``.
    begins, stops
        Where each begins and stops, rising, ``(s,)``; equal for a single value.
    """

    shares: Array
    begins: Array
    stops: Array

    def __post_init__(self) -> None:
        fix_fields(self)

    @classmethod
    def of(cls, shares: Array, begins: Array, stops: Array) -> Lines:
        """Return the pieces in rising order."""
        low, high = np.minimum(begins, stops), np.maximum(begins, stops)
        order = np.lexsort((high, low))
        return cls(shares[order], low[order], high[order])

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""
        return float(self.begins[0]), float(self.stops[-1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """0, 1 and the probabilities at which pieces meet."""
        return (0.0, *np.cumsum(self.shares)[:-1].tolist(), 1.0)

    @property
    def kinks(self) -> tuple[float, ...]:
        """Where pieces begin and stop."""
        return tuple(np.unique(np.concatenate([self.begins, self.stops])).tolist())

    @property
    def has_jumps(self) -> bool:
        """Whether a value has a probability of its own."""
        return bool((self.begins == self.stops).any())

    def cumulative(self, z: Array) -> Array:
        """Return P(number ≤ z)."""
        ahead = z[..., None] - self.begins
        length = self.stops - self.begins
        passed = np.where(length > 0, np.clip(ahead / np.where(length > 0, length, 1.0), 0, 1), ahead >= 0)
        value: Array = passed @ self.shares
        return value

    def density(self, z: Array) -> Array:
        """Return the density; not-a-number where any value has a probability of its own."""
        if self.has_jumps:
            return np.full_like(z, np.nan)
        inside = (z[..., None] >= self.begins) & (z[..., None] < self.stops)
        value: Array = inside @ (self.shares / (self.stops - self.begins))
        return value

    def position(self, s: Array) -> Array:
        """Return the quantile at s."""
        firsts = np.array(self.breaks[:-1])
        k = np.clip(np.searchsorted(firsts, s, side="right") - 1, 0, firsts.size - 1)
        along = np.clip((s - firsts[k]) / self.shares[k], 0, 1)
        value: Array = self.begins[k] + along * (self.stops[k] - self.begins[k])
        return value

    def weight(self, s: Array) -> Array:
        """Return 1."""
        return np.ones_like(s)

    def parameter(self, z: Array) -> Array:
        """Return the cumulative probability."""
        return self.cumulative(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the sum over the pieces."""
        halves, middles = (self.stops - self.begins) / 2, (self.stops + self.begins) / 2

        def of(part: Array) -> NDArray[np.complex128]:
            turned = np.sinc(part.T * halves / np.pi) * np.exp(1j * part.T * middles)
            value: NDArray[np.complex128] = turned @ self.shares
            return value

        return in_chunks(of, frequency[None], 4 * halves.size)

    @property
    def characteristic_error(self) -> float:
        """That of a sum of as many numbers as there are pieces."""
        return 1e-15 + 1.2e-16 * self.shares.size

    def envelope(self, frequency: Array) -> Array:
        """Σ share · min(1, 2/(length ω)): that of each piece, 1 of a single value."""
        lengths = (self.stops - self.begins) / 2
        bounds = np.array([_power(1.0, 1.0, length * frequency) for length in lengths])
        value: Array = np.tensordot(self.shares, bounds, axes=1)
        return np.minimum(value, 1.0)


def part_of(law: Law, weights: Array) -> Part | None:
    """Return what a law that is not normal adds along given weights ``(size,)``, about its mean.

    ``None`` for a law defined elsewhere, of which only the characteristic function is known.
    """
    w = float(weights[0])
    match law:
        case Uniform():
            return _UniformPart(abs(w) * law.half_width)
        case Triangular():
            return _TriangularPart(abs(w) * law.half_width)
        case TruncatedNormal():
            return _TruncatedPart(abs(w) * law.reach, law.k)
        case Arcsine():
            return _ArcsinePart(abs(w) * law.half_width)
        case Circle():
            return _ArcsinePart(law.radius * math.hypot(*weights))
        case Disc():
            return _SemicirclePart(law.radius * math.hypot(*weights))
        case Lognormal():
            return _LognormalPart(w, law.mean, law.log_std)
        case TwoPoint():
            ends = w * (np.array(law.ends) - law.mean_vector)
            return Lines.of(np.array([1 - law.probability, law.probability]), ends, ends)
        case Empirical():
            begins, stops = (w * (law.segments[:, column] - law.mean_vector) for column in (1, 3))
            return Lines.of(np.diff(np.append(law.segments[:, 0], 1.0)), begins, stops)
        case Rows():
            values = (law.array - law.mean_vector) @ weights
            return Lines.of(np.full(values.size, 1 / values.size), values, values)
        case _:
            return None


def _power(factor: float, power: float, z: Array) -> Array:
    """Return min(1, factor z^-power)."""
    value: Array = np.minimum(1.0, factor * np.maximum(z, 1e-300 ** (1 / max(power, 1.0))) ** -power)
    return value


def _normal_density(score: Array) -> Array:
    value: Array = np.exp(-(score**2) / 2) / math.sqrt(2 * math.pi)
    return value
