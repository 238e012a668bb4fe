"""Symmetric laws of one component (fixed, uniform, triangular, arcsine, normal, truncated normal), disc and circle."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.base.written_units import WrittenUnit
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import (
    DEVIATIONS,
    MEAN,
    NUMBER,
    Branch,
    KernelRow,
    Law,
    LawOption,
    SheetForm,
    SheetReader,
    about,
    cumulative,
    mean_beside,
    take_number,
    take_size,
    write_number,
)
from precision_pin.draws.laws.projection import Moments, SymmetricProjection, power_bound
from precision_pin.draws.philox import direction


class SymmetricLaw(Law):
    """A law of one component, symmetric about its mean."""

    mean: float

    @property
    @abstractmethod
    def variance(self) -> float:
        """Variance."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest deviation from the mean, infinite if unbounded."""

    @abstractmethod
    def _deviation_characteristic(self, frequency: Array) -> Array:
        """Return E exp(i t (x - mean)), which is real by symmetry."""

    @property
    def mean_vector(self) -> Array:
        return np.array([self.mean])

    @property
    def covariance(self) -> Array:
        return np.array([[self.variance]])

    def support(self, direction: ArrayLike) -> float:
        """Return h(w) = w·mean + |w|·reach."""
        w = float(np.asarray(direction, dtype=float)[0])
        return w * self.mean + (abs(w) * self.reach if w else 0.0)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        t = np.asarray(frequency, dtype=float)[0]
        return np.exp(1j * t * self.mean) * self._deviation_characteristic(t)


@dataclass(frozen=True)
class HalfWidthLaw(SymmetricLaw):
    """A symmetric law on mean ± half_width; the value of its key in a sheet is the half-width."""

    along: ClassVar[type[SymmetricProjection]]
    divisor: ClassVar[float]
    words: ClassVar[str]
    half_width: float
    mean: float = 0.0

    @property
    def variance(self) -> float:
        return self.half_width**2 / self.divisor

    @property
    def reach(self) -> float:
        return self.half_width

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        return f"{self.words} within {about(self.half_width, self.mean, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        return KernelRow(cast("Branch", self.form.key), np.array([self.mean, self.half_width]))

    def projection(self, weights: Array) -> SymmetricProjection:
        return self.along(abs(float(weights[0])) * self.half_width)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        return self.along(self.half_width).characteristic(frequency).real


@dataclass(frozen=True)
class Fixed(SymmetricLaw):
    """A constant that is a parameter, so that derivatives by it exist.

    Examples:
        >>> print(pp.Fixed(0.085).mean_vector)
        [0.085]
    """

    is_normal: ClassVar[bool] = True
    form: ClassVar = SheetForm(
        "fixed", {"fixed": "85 mm"}, "a number that does not vary, but has a name and a derivative"
    )
    variance: ClassVar = 0.0
    reach: ClassVar = 0.0
    streamed: ClassVar = range(0)
    mean: float

    def __post_init__(self) -> None:
        take_number(self, "mean", "the value of a fixed law")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Fixed:
        return cls(reader.number("fixed"))

    def sample(self, variates: Array) -> Array:
        return np.full_like(variates, self.mean)

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        return f"fixed at {write_number(self.mean, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        return KernelRow("fixed", np.array([self.mean]))

    def _deviation_characteristic(self, frequency: Array) -> Array:
        return np.ones_like(frequency)


class _StraightProjection(SymmetricProjection):
    """A projection whose parameter is its value over the reach."""

    def position(self, s: Array) -> Array:
        return self.reach * s

    def parameter(self, z: Array) -> Array:
        return self.scale_to_reach(z)


@dataclass(frozen=True)
class UniformProjection(_StraightProjection):
    """Projection of a uniform law, or of a sphere (Archimedes)."""

    breaks: ClassVar = (-1.0, 1.0)

    def cumulative(self, z: Array) -> Array:
        return (1 + self.scale_to_reach(z)) / 2

    def density(self, z: Array) -> Array:
        return self.limit_to_reach(z, np.full_like(z, 0.5 / self.reach))

    def weight(self, s: Array) -> Array:
        return np.full_like(s, 0.5)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return np.sinc(self.reach * frequency / np.pi).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, 1/(a ω)), from sin(a ω)/(a ω)."""
        return power_bound(1.0, 1.0, self.reach * frequency)


@dataclass(frozen=True)
class Uniform(HalfWidthLaw):
    """Uniform on mean ± half_width.

    Examples:
        >>> print(pp.Uniform(half_width=3.0, mean=1.0).sample(np.array([[0.0, 0.5, 1.0]])))
        [[-2.  1.  4.]]
    """

    form: ClassVar = SheetForm(
        "uniform", {"uniform": "0.05 mm"}, "equally likely anywhere within mean ± t; σ = t/√3", (MEAN,)
    )
    along: ClassVar = UniformProjection
    divisor: ClassVar = 3
    words: ClassVar = "uniform"

    def sample(self, variates: Array) -> Array:
        return self.mean + self.half_width * (2 * variates - 1)

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return t₁ t₂ 2/π asin(ρ/2) of two uniform numbers (Pearson 1907)."""
        if not isinstance(other, Uniform):
            return None
        return self.half_width * other.half_width * 2 / math.pi * math.asin(correlation / 2)


@dataclass(frozen=True)
class _TriangularProjection(_StraightProjection):
    breaks: ClassVar = (-1.0, 0.0, 1.0)

    @property
    def kinks(self) -> tuple[float, ...]:
        return -self.reach, 0.0, self.reach

    def cumulative(self, z: Array) -> Array:
        t = self.scale_to_reach(z)
        tail = (1 - np.abs(t)) ** 2 / 2
        return np.where(t > 0, 1 - tail, tail)

    def density(self, z: Array) -> Array:
        return (1 - np.abs(self.scale_to_reach(z))) / self.reach

    def weight(self, s: Array) -> Array:
        return 1 - np.abs(s)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return (np.sinc(self.reach * frequency / (2 * np.pi)) ** 2).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, 4/(a ω)²), the square of the bound of a uniform law of half the reach."""
        return power_bound(4.0, 2.0, self.reach * frequency)


@dataclass(frozen=True)
class Triangular(HalfWidthLaw):
    """Symmetric triangle on mean ± half_width.

    Examples:
        >>> print(pp.Triangular(half_width=6.0).covariance)
        [[6.]]
    """

    form: ClassVar = SheetForm(
        "triangular", {"triangular": "0.05 mm"}, "a symmetric triangle on mean ± t; σ = t/√6", (MEAN,)
    )
    along: ClassVar = _TriangularProjection
    divisor: ClassVar = 6
    words: ClassVar = "triangular"
    breaks: ClassVar = (0.5,)
    """Location of the kink of the density."""

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative distribution, from the nearer end."""
        tail = np.minimum(variates, 1 - variates)
        deviation: Array = np.copysign(1 - np.sqrt(2 * tail), variates - 0.5)
        return self.mean + self.half_width * deviation


class SineProjection(SymmetricProjection):
    """A projection whose parameter is an angle."""

    breaks: ClassVar = (-math.pi / 2, math.pi / 2)

    def position(self, s: Array) -> Array:
        return self.reach * np.sin(s)

    def parameter(self, z: Array) -> Array:
        return np.arcsin(self.scale_to_reach(z))


@dataclass(frozen=True)
class ArcsineProjection(SineProjection):
    """Projection of an arcsine law, or of a circle."""

    def cumulative(self, z: Array) -> Array:
        return 0.5 + np.arcsin(self.scale_to_reach(z)) / np.pi

    def density(self, z: Array) -> Array:
        inside = np.abs(z) < self.reach
        t = np.where(inside, z / self.reach, 0.0)
        return np.where(inside, 1 / (np.pi * self.reach * np.sqrt((1 - t) * (1 + t))), 0.0)

    def weight(self, s: Array) -> Array:
        return np.full_like(s, 1 / np.pi)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return lazy_special.j0(self.reach * frequency).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, √(2/(π r ω))), since √(πz/2) |J₀(z)| ≤ 1 (Watson, Bessel functions, 15.5)."""
        return power_bound(math.sqrt(2 / math.pi), 0.5, self.reach * frequency)


@dataclass(frozen=True)
class Arcsine(HalfWidthLaw):
    """Arcsine (U-shaped) on mean ± half_width: a sine wave at a random phase (JCGM 101:2008, 6.4.6).

    Examples:
        >>> print(pp.Arcsine(half_width=2.0).covariance)
        [[2.]]
    """

    form: ClassVar = SheetForm(
        "arcsine", {"arcsine": "0.05 mm"}, "a sine wave of amplitude t at a random phase; σ = t/√2", (MEAN,)
    )
    along: ClassVar = ArcsineProjection
    divisor: ClassVar = 2
    words: ClassVar = "arcsine (a sine wave at a random phase)"

    def sample(self, variates: Array) -> Array:
        """Return mean + t sin(π(u - 1/2))."""
        return self.mean + self.half_width * np.sin(np.pi * (variates - 0.5))


SMALLEST_K: Final = 1e-3
"""Smallest k of a truncated normal law: its samples, exact to 1e-16/k of the half-width, then have 13 digits."""


@dataclass(frozen=True)
class TruncatedNormal(SymmetricLaw):
    """Normal of standard deviation ``std`` before truncation, cut off at mean ± k·std.

    Examples:
        >>> print(pp.TruncatedNormal(std=1.0, k=2.0).sample(np.array([[0.0, 0.5, 1.0]])))
        [[-2.  0.  2.]]
    """

    std: float
    mean: float = 0.0
    k: float = 3.0

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a truncated normal law")
        take_number(self, "mean", "the mean of a truncated normal law")
        allowed = f"finite and at least {SMALLEST_K} (below, the law is practically uniform)"
        k = check_number("k of a truncated normal law", self.k, allowed, lambda value: value >= SMALLEST_K)
        object.__setattr__(self, "k", k)

    @property
    def variance(self) -> float:
        """σ² (1 - 2kφ(k) / (2Φ(k) - 1)), as the ratio of the chi-square laws of 3 and 1 at k² (no cancellation)."""
        square = self.k**2 / 2
        return self.std**2 * float(lazy_special.gammainc(1.5, square) / lazy_special.gammainc(0.5, square))

    @property
    def reach(self) -> float:
        """k·σ."""
        return self.k * self.std

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative distribution, symmetrically from the nearer end."""
        tail = np.minimum(variates, 1 - variates)
        cut = lazy_special.ndtr(-self.k)
        score = lazy_special.ndtri(cut + tail * math.erf(self.k / math.sqrt(2)))
        deviation: Array = np.copysign(np.minimum(-score, self.k), variates - 0.5)
        return self.mean + self.std * deviation

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        (quantity,) = quantities
        unit = WrittenUnit.suiting(quantity, [self.std])
        cut = f"cut off at ±{unit(self.k * self.std)}{mean_beside(self.mean, quantity)}"
        return f"normal, standard deviation {unit(self.std)}, {cut}"

    def kernel_row(self) -> KernelRow:
        """Return mean, standard deviation, k, Φ(-k) and Φ(k) - Φ(-k)."""
        numbers = (self.mean, self.std, self.k, lazy_special.ndtr(-self.k), math.erf(self.k / math.sqrt(2)))
        return KernelRow("truncated", np.array(numbers))

    def projection(self, weights: Array) -> _TruncatedProjection:
        return _TruncatedProjection(abs(float(weights[0])) * self.reach, self.k)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        s, k = self.std * frequency, self.k
        faddeeva = lazy_special.wofz((1j * k - s) / math.sqrt(2))
        value: Array = np.exp(-(s**2) / 2) - (np.exp(-(k**2) / 2 - 1j * k * s) * faddeeva).real
        return value / math.erf(k / math.sqrt(2))


@dataclass(frozen=True)
class _TruncatedProjection(SymmetricProjection):
    k: float

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(np.linspace(-self.k, self.k, 1 + 2 * math.ceil(self.k / 1.5)).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple(self.position(np.array(self.breaks)).tolist())

    @property
    def _inner(self) -> float:
        return math.erf(self.k / math.sqrt(2))

    def cumulative(self, z: Array) -> Array:
        score = self.k * self.scale_to_reach(z)
        return (1 + lazy_special.erf(score / math.sqrt(2)) / self._inner) / 2

    def density(self, z: Array) -> Array:
        return self.limit_to_reach(z, self.weight(self.k * self.scale_to_reach(z)) * self.k / self.reach)

    def position(self, s: Array) -> Array:
        return self.reach / self.k * s

    def weight(self, s: Array) -> Array:
        return np.exp(-(s**2) / 2) / (math.sqrt(2 * math.pi) * self._inner)

    def parameter(self, z: Array) -> Array:
        return self.k * self.scale_to_reach(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return TruncatedNormal(self.reach / self.k, 0.0, self.k).characteristic(frequency[None])

    @property
    def characteristic_error(self) -> float:
        return 2e-15 / self._inner

    def envelope(self, frequency: Array) -> Array:
        """Return the bound of the normal law plus the bound of the removed tails, over P(|z| < k)."""
        # The bound of the tails is the minimum of their probability and their total variation over ω, 4φ(k)/ω. For small
        # k, the total variation of the whole density over ω is smaller.
        omega = np.maximum(self.reach / self.k * frequency, 1e-300)
        height = math.exp(-(self.k**2) / 2) / math.sqrt(2 * math.pi)
        tails = np.minimum(2 * lazy_special.ndtr(-self.k), 4 * height / omega)
        cut = (np.exp(-(omega**2) / 2) + tails) / self._inner
        uncut = 2 / (math.sqrt(2 * math.pi) * self._inner * omega)
        return np.minimum(np.minimum(cut, uncut), 1.0)


@dataclass(frozen=True)
class Normal(SymmetricLaw):
    """Normal of standard deviation ``std``.

    Attributes:
        k: Standard deviations per half-width, if defined by its half-width; else ``None``.

    Examples:
        >>> print(pp.Normal(std=2.0, mean=1.0).sample(np.array([[-1.0, 0.0, 1.0]])))  # of normal scores
        [[-1.  1.  3.]]
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    is_normal: ClassVar[bool] = True
    form: ClassVar = SheetForm(
        "normal",
        {"normal": "0.06 mm"},
        "t is k standard deviations, σ = t/k; `normal: {std: 0.02 mm}` gives σ itself",
        (
            MEAN,
            LawOption("k", "normal: t has the standard deviation t/k; default 3", "2"),
            LawOption("cpk", "normal: t has the standard deviation t/(3 Cpk)", "1.33"),
            LawOption("truncated", "cut a normal law off at its half-width, mean ± k standard deviations", "true"),
        ),
        {"anyOf": [NUMBER, DEVIATIONS]},
    )
    std: float
    mean: float = 0.0
    k: float | None = field(default=None, kw_only=True, compare=False, repr=False)

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a normal law")
        take_number(self, "mean", "the mean of a normal law")
        if self.k is not None:
            check_number("k of a normal law", self.k, "positive and finite", lambda value: value > 0)

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Normal | TruncatedNormal:
        value = reader.settings["normal"]
        given = [key for key in ("k", "cpk") if key in reader.settings]
        if len(given) == 2:
            raise reader.error(("cpk",), "give k or cpk: cpk is k/3")
        k = (3.0 if given == ["cpk"] else 1.0) * reader.ratio(given[0]) if given else 3.0
        if not k > 0:
            raise reader.error((given[0],), f"{given[0]} must be positive, got {reader.settings[given[0]]}")
        is_deviation = isinstance(value, Mapping)
        if is_deviation and set(value) != {"std"}:
            reason = "normal takes a half-width (normal: 0.1 mm) or a standard deviation (normal: {std: 0.03 mm})"
            raise reader.error(("normal",), reason)
        std = reader.half_width("normal", "std") if is_deviation else reader.half_width("normal") / k
        mean, truncated = reader.mean(), str(reader.settings.get("truncated", "false")).lower()
        if truncated not in ("true", "false"):
            raise reader.error(("truncated",), f"truncated must be true or false, got {reader.settings['truncated']!r}")
        if truncated == "true":
            return TruncatedNormal(std, mean, k)
        if is_deviation and given:
            reason = (
                f"{given[0]} has no effect here: {{std: …}} is the standard deviation itself, and nothing is cut off"
            )
            raise reader.error((given[0],), reason)
        return cls(std, mean, k=None if is_deviation else k)

    @classmethod
    def from_half_width(cls, half_width: float, mean: float = 0.0, *, k: float = 3.0) -> Normal:
        """Return the law with a half-width of k standard deviations."""
        allowed = "zero or more and finite"
        half = check_number("the half-width of a normal law", half_width, allowed, lambda value: value >= 0)
        return cls(half / check_number("k", k, "positive and finite", lambda value: value > 0), mean, k=k)

    @property
    def variance(self) -> float:
        return self.std**2

    @property
    def reach(self) -> float:
        """Infinite, unless σ is zero."""
        return math.inf if self.std else 0.0

    def sample(self, variates: Array) -> Array:
        return self.mean + self.std * variates

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return ρ σ₁ σ₂ of two normal numbers."""
        return correlation * self.std * other.std if isinstance(other, Normal) else None

    def covariance_by_scores(self, correlation: float, nodes: Callable[[float], tuple[Array, Array]]) -> float:
        """Return the integral of ρ σ z, its mean at a score z of the other component."""
        z, weighted = nodes(0.0)
        return self.std * correlation * float((weighted * z).sum())

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        (quantity,) = quantities
        mean = mean_beside(self.mean, quantity)
        return f"normal, standard deviation {write_number(self.std, quantity)}{mean}"

    def tolerance(self, quantities: Sequence[Quantity | None]) -> str:
        """Return half-width and standard deviation, ``±0.01° (σ 0.0033°)``; without a half-width ``σ 0.1 mm``."""
        deviation = super().tolerance(quantities)
        if self.k is None or not deviation:
            return deviation
        unit = WrittenUnit.suiting(quantities[0], [self.k * self.std])
        sizes = unit.short(self.k * self.std), f"{self.std * unit.per_si:.2g} {unit.name}"
        return "±{} (σ {})".format(*sizes).replace(" deg", "°")

    def kernel_row(self) -> KernelRow:
        return KernelRow("normal", np.array([self.mean, self.std]))

    def _deviation_characteristic(self, frequency: Array) -> Array:
        return np.exp(-((self.std * frequency) ** 2) / 2)


LARGEST_SCALED_BESSEL: Final = 0.82504
"""Upper bound of √z |J₁(z)| for z > 0, reached at z = 2.166."""


@dataclass(frozen=True)
class RoundLaw(Law):
    """A law of a plane, or of space, that no turn about the origin changes; the value of its key in a sheet is the radius.

    Attributes:
        along: Its projection on any direction, by the radius.
        divisor: Square of the radius over the variance along any axis.
    """

    size: ClassVar = 2
    components: ClassVar[tuple[str, ...]] = (".x", ".y")
    along: ClassVar[type[SymmetricProjection]]
    divisor: ClassVar[float]
    words: ClassVar[str]
    radius: float

    @property
    def mean_vector(self) -> Array:
        return np.zeros(self.size)

    @property
    def covariance(self) -> Array:
        return np.eye(self.size) * self.radius**2 / self.divisor

    def support(self, direction: ArrayLike) -> float:
        return self.radius * math.hypot(*np.asarray(direction, dtype=float))

    def ellipsoid(self, k: float) -> Array:
        """Return the ellipsoid of the disc or ball, for every k."""
        return self.radius * np.eye(self.size)

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        return f"a point uniform {self.words} of radius {write_number(self.radius, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        return KernelRow(cast("Branch", self.form.key), np.array([self.radius]))

    def projection(self, weights: Array) -> SymmetricProjection:
        return self.along(self.radius * math.hypot(*weights))

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the characteristic function of the projection at |t|."""
        return self.along(self.radius).characteristic(np.hypot.reduce(np.asarray(frequency, dtype=float)))


@dataclass(frozen=True)
class _DiscProjection(SineProjection):
    def cumulative(self, z: Array) -> Array:
        t = self.scale_to_reach(z)
        return 0.5 + (t * np.sqrt((1 - t) * (1 + t)) + np.arcsin(t)) / np.pi

    def density(self, z: Array) -> Array:
        t = self.scale_to_reach(z)
        return 2 / (np.pi * self.reach) * np.sqrt((1 - t) * (1 + t))

    def weight(self, s: Array) -> Array:
        return 2 / np.pi * np.cos(s) ** 2

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        t = self.reach * frequency
        safe = np.where(t != 0, t, 1.0)
        return np.where(t != 0, 2 * lazy_special.j1(safe) / safe, 1.0).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, c (r ω)^-3/2), from 2 J₁(z)/z and the largest √z |J₁(z)|."""
        return power_bound(2 * LARGEST_SCALED_BESSEL, 1.5, self.reach * frequency)


@dataclass(frozen=True)
class Disc(RoundLaw):
    """A point uniform over the area of a disc about the origin.

    Examples:
        >>> print(pp.Disc(radius=2.0).covariance)
        [[1. 0.]
         [0. 1.]]
    """

    form: ClassVar = SheetForm(
        "disc", {"disc": "0.1 mm"}, "two numbers `.x`, `.y`: a point uniform over the area of a disc of radius t"
    )
    along: ClassVar = _DiscProjection
    divisor: ClassVar = 4
    words: ClassVar = "over a disc"

    def sample(self, variates: Array) -> Array:
        """Return r √u₀ at the angle 2π u₁."""
        return self.radius * np.sqrt(variates[0]) * direction(variates[1])

    def from_normals(self, normals: Array) -> Array:
        """Return r √(1 - exp(-|z|²/2)) in the direction of z: polar coordinates would jump at an angle."""
        length = np.hypot(*normals)
        unit = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return self.radius * np.sqrt(-np.expm1(-(length**2) / 2)) * unit

    def standardised_moments(self) -> Moments:
        """Return the moments: variance r²/4, E x⁴ = r⁴/8, E x² y² = r⁴/24."""
        return 0.0, 2.0, 2 / 3

    def tolerance(self, quantities: Sequence[Quantity | None]) -> str:
        known_quantities = [quantity for quantity in quantities if quantity is not None and quantity.si]
        return f"radius {write_number(self.radius, known_quantities[0])}" if known_quantities else ""


@dataclass(frozen=True)
class Circle(RoundLaw):
    """A point uniform on a circle about the origin.

    Examples:
        >>> print(pp.Circle(radius=2.0).covariance)
        [[2. 0.]
         [0. 2.]]
    """

    form: ClassVar = SheetForm(
        "circle", {"circle": "0.1 mm"}, "two numbers `.x`, `.y`: a point uniform on a circle of radius t"
    )
    along: ClassVar = ArcsineProjection
    divisor: ClassVar = 2
    words: ClassVar = "on a circle"
    streamed: ClassVar = range(1, 2)
    """The second variate, which gives the angle."""

    def sample(self, variates: Array) -> Array:
        """Return the point at the angle 2π u₁; u₀ is unused, so that a disc replaced by a circle keeps its angles."""
        return self.radius * direction(variates[1])

    def from_normals(self, normals: Array) -> Array:
        """Return the point at the angle 4π Φ(z₁), so that |z₁| below 0.7 covers all angles."""
        angle = 4 * np.pi * cumulative(normals[1])
        return self.radius * np.array([np.cos(angle), np.sin(angle)])

    def standardised_moments(self) -> Moments:
        """Return the moments: variance r²/2, E x⁴ = 3 r⁴/8, E x² y² = r⁴/8."""
        return 0.0, 1.5, 0.5
