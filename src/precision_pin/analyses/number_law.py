"""Laws of one number by cumulative law and density: normal numbers, single parts, sums and lengths of normal vectors.

Law of a sum of independent parts, as a Fourier series: the characteristic function of a sum is a product. On a support
of length 2L, the density equals its Fourier series (Poisson's summation; Abate and Whitt, Queueing Systems 10, 1992).
With ω_k = kπ/L and φ about the middle c,

    f(c + y) = (1/2L) (1 + 2 Re Σ φ(ω_k) exp(-i ω_k y)),
    F(c + y) = (y + L)/2L + Re Σ (i/kπ) φ(ω_k) (exp(-i ω_k y) - (-1)^k).

For bounded parts the only error is the truncation of the series at K, at most (2/π) Σ_{k>K} |φ(ω_k)|/k, which is
evaluated with monotone bounds of |φ|. Unbounded parts add the probability beyond the chosen ends. A wide lognormal part
has distant ends and a |φ| that decreases slowly; its ends are moved inwards until the series is short enough, at the
cost of a larger error. Rounding is bounded as well: of the characteristic function, of the phases kπy, whose error
grows with k as the coefficients decrease, and of the sums. A cumulative probability at x is the probability at a number
within a few rounding units of x, because x - mean is rounded.

Law of a sum of two independent parts: their convolution, by quadrature.

Length of a normal vector, the root of a generalised chi-square variable: in principal axes the density is a product.
The probability of a ball of radius r about the origin is integrated one axis after another, ``P_m(r) = ∫ f_m(r sin θ)
P_(m-1)(r cos θ) r cos θ dθ``, starting from the normal law ``P_1``. The integrands are analytic, so that Gauss-Legendre
rules converge geometrically; the number of nodes is doubled until the value is stationary. (Imhof's inversion,
Biometrika 48, 1961, gives the same probability by an integral that converges slowly in few dimensions.)

Error bounds of quantiles: with |F̂ - F| ≤ ε, the p-quantile of F lies between those of F̂ at p - ε and p + ε. Where the
law has a density, a width δ of about 2ε divided by the density is tried: F̂(q - δ) ≤ p - ε and F̂(q + δ) ≥ p + ε prove
it. Elsewhere both quantiles of F̂ are computed.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.draws.laws.projection import Lines, Projection

ROUNDING: Final = 1e-14
"""Bound of the rounding error of a cumulative law in closed form."""

FARTHEST: Final = 9.0
"""Number of standard deviations beyond which a normal law is neglected: probability 2.3e-19."""


class NumberLaw(ABC):
    """Law of one number.

    Attributes:
        method: Method of computation, as text.
        error: Bound of the error of :meth:`cumulative`, except the rounding of x.
        cost: Time of a cumulative probability, in units of about 50 ns.
    """

    method: ClassVar[str]
    error: ClassVar[float] = ROUNDING
    cost: ClassVar[float] = 100.0

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """Ends of the law; the probability outside is below the error."""

    @property
    def low(self) -> float:
        """Lower end."""
        return self.ends[0]

    @property
    def high(self) -> float:
        """Upper end."""
        return self.ends[1]

    @abstractmethod
    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), ``(N,)``."""

    @abstractmethod
    def density(self, x: Array) -> Array:
        """Return the density ``(N,)``, NaN where there is none."""

    def quantile(self, p: float) -> float:
        """Return the smallest value with at least this probability at or below it (0 < p < 1), by Brent's method."""

        def excess(x: float) -> float:
            return float(self.cumulative(np.array([x]))[0]) - p

        if excess(self.low) >= 0:
            return self.low
        if excess(self.high) <= 0:
            return self.high
        return optimize.brentq(excess, self.low, self.high, xtol=1e-16 * (self.high - self.low), rtol=1e-15)


@dataclass(frozen=True)
class NormalLaw(NumberLaw):
    """Law of a normal number."""

    mean: float
    std: float
    method: ClassVar[str] = "normal law"

    @property
    def ends(self) -> tuple[float, float]:
        """Nine standard deviations on both sides of the mean."""
        return self.mean - FARTHEST * self.std, self.mean + FARTHEST * self.std

    def cumulative(self, x: Array) -> Array:
        """Return Φ((x - mean)/σ)."""
        return special.ndtr((x - self.mean) / self.std)

    def density(self, x: Array) -> Array:
        """Return φ((x - mean)/σ)/σ."""
        return np.exp(-(((x - self.mean) / self.std) ** 2) / 2) / (math.sqrt(2 * math.pi) * self.std)


@dataclass(frozen=True, eq=False)
class SingleLaw(NumberLaw):
    """Law of a single part."""

    mean: float
    part: Projection
    method: ClassVar[str] = "closed form of one draw"

    @property
    def ends(self) -> tuple[float, float]:
        """The part's ends."""
        return self.mean + self.part.ends[0], self.mean + self.part.ends[1]

    def cumulative(self, x: Array) -> Array:
        """Return the cumulative law of the part."""
        return self.part.cumulative(x - self.mean)

    def density(self, x: Array) -> Array:
        """Return the density of the part."""
        return self.part.density(x - self.mean)


_ROUNDING: Final = 1e-15  # of a quantile, relative to its size and the width of the law


def quantile_bounds(law: NumberLaw, levels: Array, quantiles: Array) -> Array:
    """Return error bounds of quantiles ``(N,)`` of a law at these levels, from the law's own error bound."""
    rounding = _ROUNDING * (np.abs(quantiles) + law.high - law.low)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = 2 * law.error / law.density(quantiles) + rounding
    is_finite = np.isfinite(width)
    safe = np.where(is_finite, width, 0.0)
    proved = is_finite & (law.cumulative(quantiles - safe) <= levels - law.error)
    proved &= law.cumulative(quantiles + safe) >= levels + law.error
    for k in np.flatnonzero(~proved):
        lower = law.quantile(max(levels[k] - law.error, law.error))
        upper = law.quantile(min(levels[k] + law.error, 1 - law.error))
        safe[k] = max(quantiles[k] - lower, upper - quantiles[k], 0.0) + rounding[k]
    return safe


MOST_PIECES: Final = 2000
"""Largest number of pieces of the integral; a sum with more pieces is computed as a series."""


@dataclass(frozen=True, eq=False)
class ConvolvedLaw(NumberLaw):
    """Law of two parts, ``F(x) = ∫ F₁(x - z(s)) w(s) ds`` along the parameter of the second.

    The integral is split at every kink of either part. Each piece is computed by the double exponential rule (Takahasi
    and Mori, 1974), which converges in spite of singularities at the ends.
    """

    mean: float
    kept: Projection
    integrated: Projection
    method: ClassVar[str] = "convolution of two draws"
    # error of the double exponential rule, measured on sums with a closed form
    error: ClassVar[float] = 1e-11

    @classmethod
    def of(cls, mean: float, first: Projection, second: Projection) -> ConvolvedLaw:
        """Return the law of two parts; the integral runs along the part with the rougher density."""
        first, integrated = (first, second) if _roughness(first) <= _roughness(second) else (second, first)
        return cls(mean, first, integrated)

    @property
    def pieces(self) -> int:
        """Number of pieces of the integral."""
        return len(self.kept.kinks) + len(self.integrated.breaks) - 1

    @property
    def cost(self) -> float:  # type: ignore[override]
        """Cost of all pieces."""
        return 105.0 * self.pieces

    @property
    def ends(self) -> tuple[float, float]:
        """Sums of the ends."""
        low, high = (self.mean + a + b for a, b in zip(self.kept.ends, self.integrated.ends, strict=True))
        return low, high

    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), the integral of F₁."""
        value = self._integral(self.kept.cumulative, x)
        is_inside = (x >= self.low) & (x < self.high)
        return np.where(is_inside, np.clip(value, 0, 1), np.where(x >= self.high, 1.0, 0.0))

    def density(self, x: Array) -> Array:
        """Return the density, the integral of f₁."""
        return self._integral(self.kept.density, x)

    def _integral(self, function: Callable[[Array], Array], x: Array) -> Array:
        shares, weights = _double_exponential()
        step = max(1, 2_000_000 // (self.pieces * shares.size))
        parts = [np.zeros(0)]
        for first in range(0, x.size, step):
            z = x[first : first + step] - self.mean
            breaks = np.array(self.integrated.breaks)
            cuts = self.integrated.parameter(z[:, None] - np.array(self.kept.kinks))
            edges = np.sort(np.concatenate([cuts, np.broadcast_to(breaks, (z.size, breaks.size))], axis=1), axis=1)
            lengths = np.diff(edges, axis=1)[:, :, None]
            s = edges[:, :-1, None] + lengths * shares
            values = function(z[:, None, None] - self.integrated.position(s)) * self.integrated.weight(s)
            parts.append((values * (lengths * weights)).sum(axis=(1, 2)))
        return np.concatenate(parts)


def _roughness(part: Projection) -> int:
    """Return 2 for lines, 1 for an unbounded density (|φ| decreases slower than 1/ω), 0 otherwise."""
    if isinstance(part, Lines):
        return 2
    far = np.array([2.0**60, 2.0**62]) / max(abs(end) for end in part.ends)
    first, second = part.envelope(far)
    return int(second > 0.3 * first)


def _double_exponential() -> tuple[Array, Array]:
    t = np.arange(-52, 53) / 16
    inner = math.pi / 2 * np.sinh(t)
    shares = special.expit(2 * inner)
    weights = math.pi / 2 * np.cosh(t) / (2 * np.cosh(inner) ** 2) / 16
    return shares, weights / weights.sum()


UNIT: Final = 0.5**53
"""Relative rounding error of a double."""

MOST_TERMS: Final = 2**20
# target of the truncation error, largest number of terms, and standard deviations at which unbounded parts end
_AIMS: Final = (
    (1e-14, 2**15, FARTHEST),
    (1e-12, 2**18, 7.5),
    (1e-10, MOST_TERMS, 6.8),
    (1e-8, MOST_TERMS, 6.2),
    (3e-7, MOST_TERMS, 5.5),
)


@dataclass(frozen=True, eq=False)
class SeriesLaw(Fixed, NumberLaw):
    """Fourier series of a law on its support.

    Attributes:
        middle, half_length: Support: mean + middle ± half_length.
        coefficients: φ(ω_k) about the middle, ``(K + 1,)``; the first is 1.
        truncation, density_truncation: Bounds of the truncation errors of F and f; infinite where unknown.
        beyond: Probability beyond the support.
        rounding: Bound of the rounding of the cumulative law.
    """

    mean: float
    middle: float
    half_length: float
    coefficients: NDArray[np.complex128]
    truncation: float
    density_truncation: float
    beyond: float = 0.0
    rounding: float = ROUNDING

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the support."""
        centre = self.mean + self.middle
        return centre - self.half_length, centre + self.half_length

    @property
    def terms(self) -> int:
        """Number of terms, K."""
        return self.coefficients.size - 1

    @property
    def method(self) -> str:  # type: ignore[override]
        """Inversion of the characteristic function, with the number of terms."""
        return f"inversion of the characteristic function, {self.terms} terms"

    @property
    def error(self) -> float:  # type: ignore[override]
        """Truncation error, probability beyond the support, and rounding."""
        return self.truncation + self.beyond + self.rounding

    @property
    def cost(self) -> float:  # type: ignore[override]
        """Cost of all terms."""
        return 100 + self.terms / 4

    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), the series of F."""
        y = (x - self.mean - self.middle) / self.half_length
        inner = np.clip(y, -1.0, 1.0)
        value: Array = (inner + 1) / 2 + _sum(self._slopes, inner) - self._start
        return np.where(y <= -1, 0.0, np.where(y >= 1, 1.0, np.clip(value, 0.0, 1.0)))

    def density(self, x: Array) -> Array:
        """Return the density, the series of f."""
        y = (x - self.mean - self.middle) / self.half_length
        value = _sum(self._heights, np.clip(y, -1.0, 1.0)) / self.half_length
        return np.where(np.abs(y) < 1, np.maximum(value, 0.0), 0.0)

    @cached_property
    def _slopes(self) -> NDArray[np.complex128]:
        k = np.arange(1, self.terms + 1)
        return _arrange(np.concatenate([[0.0], 1j * self.coefficients[1:] / (np.pi * k)]))

    @cached_property
    def _heights(self) -> NDArray[np.complex128]:
        return _arrange(np.concatenate([[0.5], self.coefficients[1:]]))

    @cached_property
    def _start(self) -> float:
        return float(_sum(self._slopes, np.array([-1.0]))[0])


def _arrange(coefficients: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the coefficients as a table ``(columns, rows)``, k = columns · row + column, padded with zeros."""
    columns = _columns(coefficients.size)
    padded = np.zeros(-(-coefficients.size // columns) * columns, dtype=complex)
    padded[: coefficients.size] = coefficients
    return np.ascontiguousarray(padded.reshape(-1, columns).T)


def _columns(size: int) -> int:
    return 1 << max(0, math.ceil(math.log2(size) / 2))


def _sum(table: NDArray[np.complex128], y: Array) -> Array:
    """Return Re Σ c_k exp(-i k π y), with the powers of exp(-iπy) in two steps to save exponentials."""
    columns, rows = table.shape
    step = max(1, 2_000_000 // (rows + columns))
    parts = [np.zeros(0)]
    for first in range(0, y.size, step):
        step_phase = -1j * np.pi * y[first : first + step, None]
        fine = np.exp(step_phase * np.arange(columns))
        coarse = np.exp(step_phase * (columns * np.arange(rows)))
        parts.append(((fine @ table) * coarse).sum(axis=1).real)
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Bounds of |φ|, and of the truncation error at K terms."""

    envelopes: Sequence[Callable[[Array], Array]]
    std: float
    half_length: float

    @cached_property
    def _octaves(self) -> Array:
        return np.exp2(np.arange(160, dtype=float))

    def bound(self, omega: Array) -> Array:
        with np.errstate(under="ignore", over="ignore"):
            result = np.exp(-((self.std * omega) ** 2) / 2)
            for envelope in self.envelopes:
                result = result * envelope(omega)
        return result

    def truncations(self, terms: int) -> tuple[float, float]:
        """Return the bounds of the truncation errors of F and f, summed over octaves (2^j K, 2^(j+1) K]."""
        omega = terms * np.pi / self.half_length * self._octaves
        with np.errstate(under="ignore", over="ignore"):
            bound = self.bound(omega)
            densities = bound * self._octaves * terms / self.half_length
        return 2 / math.pi * math.log(2) * _sum_converging(bound), _sum_converging(densities)


def _sum_converging(terms: Array) -> float:
    """Return the sum, infinite where the last terms are not negligible."""
    total = float(terms.sum())
    return total * (1 + 1e-9) if terms[-1] <= 1e-15 * total or total < 1e-250 else math.inf


@dataclass(frozen=True, eq=False)
class Summand(Fixed):
    """Independent part of a sum, in the form that the series needs.

    Attributes:
        ends: Function from a number of standard deviations to ends with at most a normal law's tails.
        is_bounded: True if the probability beyond the ends is zero.
        envelope: Function of ω ``(n,)`` that returns a monotone bound of |φ|.
        characteristic: Function of ω ``(n,)`` that returns φ of the deviation from the mean.
        characteristic_error: Bound of the error of φ, except the rounding of ω.
    """

    ends: Callable[[float], tuple[float, float]]
    is_bounded: bool
    envelope: Callable[[Array], Array]
    characteristic: Callable[[Array], NDArray[np.complex128]]
    characteristic_error: float = 1e-15


def certified_series(mean: float, std: float, summands: Sequence[Summand], largest_error: float) -> SeriesLaw | float:
    """Return a law's series with the terms for the largest certified error, else the smallest error reached."""
    for aim, most, score in _AIMS:
        intervals = [summand.ends(min(score, FARTHEST)) for summand in summands]
        low, high = (sum(end[side] for end in intervals) + sign * score * std for side, sign in ((0, -1), (1, 1)))
        half_length = (high - low) / 2
        bounds = _Bounds([summand.envelope for summand in summands], std, half_length)
        terms = 64
        while bounds.truncations(terms)[0] > aim and terms < most:
            terms *= 2
        if bounds.truncations(terms)[0] <= aim:
            break
    truncation, density_truncation = bounds.truncations(terms)
    unbounded = sum(not summand.is_bounded for summand in summands) + (std > 0)
    omitted = float(2 * special.ndtr(-score)) * unbounded
    if truncation + omitted > largest_error:
        return truncation + omitted
    middle = (low + high) / 2
    omega = np.arange(terms + 1, dtype=float) * (np.pi / half_length)
    coefficients = np.exp(-((std * omega) ** 2) / 2 - 1j * omega * middle)
    for summand in summands:
        coefficients *= summand.characteristic(omega)
    rounding = _rounding(bounds.bound(omega[1:]), summands)
    return SeriesLaw(mean, middle, half_length, coefficients, truncation, density_truncation, omitted, rounding)


def _rounding(bounds: Array, summands: Sequence[Summand]) -> float:
    """Return the bound of the rounding of a cumulative law with these bounds of |φ(ω_k)|, k from 1 on.

    The relative error of a phase kπ is a few rounding units, which changes a term φ/kπ by as many units of φ. The
    characteristic functions of the parts add their own errors, and the sums one unit for each term of an inner row.
    """
    k = np.arange(1, bounds.size + 1)
    terms = float((bounds / (np.pi * k)).sum())
    phases = 4.0 * (2 + len(summands))
    functions = sum(summand.characteristic_error for summand in summands)
    sums = _columns(bounds.size + 1) + 16.0
    return (
        UNIT * (8 + 2 * sums * terms + phases * float(bounds.sum())) + functions * (1 + math.log(bounds.size)) / np.pi
    )


ERROR: Final = 1e-12
"""Error of the cumulative law, ten times the largest change at the last doubling of the nodes."""

_NODES: Final = 48  # at first; they are doubled until the values converge
_AT_ONCE: Final = 4_000_000  # values of an integrand in one array, 32 MB
_FLAT: Final = 1e-9  # relative standard deviation below which an axis counts as constant


@dataclass(frozen=True, eq=False)
class NormalNorm(Fixed, NumberLaw):
    """Law of |v| for a normal vector v with mean ``centre`` ``(3,)`` and covariance ``matrix`` ``(3, 3)``."""

    centre: Array
    matrix: Array
    method: ClassVar[str] = "generalised chi-square law, by integration over the ball"
    error: ClassVar[float] = ERROR
    cost: ClassVar[float] = 2e5

    @cached_property
    def _axes(self) -> tuple[Array, Array, float]:
        """Standard deviations and means along varying principal axes, largest first; length of the constant part."""
        values, vectors = np.linalg.eigh(self.matrix)
        stds, means = np.sqrt(np.maximum(values, 0.0))[::-1], (vectors.T @ self.centre)[::-1]
        varies = stds > _FLAT * stds[0]
        return stds[varies], means[varies], float(np.linalg.norm(means[~varies]))

    @property
    def ends(self) -> tuple[float, float]:
        """Length of the constant part, and the length beyond which the probability is below 1e-18."""
        stds, means, still = self._axes
        return still, math.hypot(float(np.linalg.norm(np.abs(means) + FARTHEST * stds)), still)

    def cumulative(self, r: Array) -> Array:
        """Return P(|v| ≤ r), ``(N,)``."""
        inner = np.sqrt(np.maximum(r**2 - self._axes[2] ** 2, 0.0))
        return np.clip(self._evaluate(_ball, inner), 0.0, 1.0)

    def density(self, r: Array) -> Array:
        """Return the density of |v|, ``(N,)``."""
        inner = np.sqrt(np.maximum(r**2 - self._axes[2] ** 2, 0.0))
        # the relative accuracy of a density is that of its height, about 1/σ
        return self._evaluate(_sphere, inner, float(self._axes[0][0])) * r / np.where(inner > 0, inner, np.inf)

    def quantile(self, p: float) -> float:
        """Return the radius of the ball with this probability, by Brent's method.

        Raises:
            InputError: Beside the constant part the spread is lost in rounding.
        """

        def excess(r: float) -> float:
            return float(self.cumulative(np.array([r]))[0]) - p

        if self.high - self.low <= 1e-14 * self.high:
            raise InputError(
                f"the constant part of an error is {1e3 * self.low:.3g} mm or mrad, beside which its spread is lost in rounding; "
                "mend the mean of an offset"
            )
        return optimize.brentq(excess, self.low, self.high, xtol=1e-15 * self.high, rtol=1e-14)

    @cached_property
    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation of |v|; the mean as ∫ (1 - P) dr."""
        nodes, weights = _rule(256)
        stds, means, still = self._axes
        centre = math.hypot(float(np.linalg.norm(means)), still)
        half_width = FARTHEST * float(np.linalg.norm(stds))
        low, high = max(self.low, centre - half_width), min(self.high, centre + half_width)
        r = low + (high - low) * (nodes + 1) / 2
        mean = low + float((1 - self.cumulative(r)) @ weights) * (high - low) / 2
        square = float(self.centre @ self.centre + np.trace(self.matrix))
        return mean, math.sqrt(max(square - mean**2, 0.0))

    def _evaluate(
        self, function: Callable[[Array, Array, Array, int], Array], radii: Array, scale: float = 1.0
    ) -> Array:
        """Return a function of radii, with the nodes doubled for each until the value times ``scale`` is stationary."""
        stds, means, _ = self._axes

        def at(r: Array, nodes: int) -> Array:
            step = max(1, _AT_ONCE // nodes ** (stds.size - 1))
            parts = [function(r[first : first + step], stds, means, nodes) for first in range(0, r.size, step)]
            return np.concatenate(parts) if parts else r

        nodes = _NODES
        values = at(radii, nodes)
        open_ones = np.arange(radii.size)
        while open_ones.size and nodes < 768 and stds.size > 1:
            nodes *= 2
            old = values[open_ones]
            values[open_ones] = new = at(radii[open_ones], nodes)
            open_ones = open_ones[scale * np.abs(new - old) > ERROR / 10 * np.maximum(1.0, scale * np.abs(new))]
        return values


def _ball(radius: Array, stds: Array, means: Array, nodes: int) -> Array:
    """Return the probability of balls about the origin, ``radius`` of any shape."""
    if stds.size == 1:
        upper, lower = (radius - means[0]) / stds[0], (-radius - means[0]) / stds[0]
        # the difference of the closer tails, so that distant balls keep their digits
        return np.where(
            means[0] > 0, special.ndtr(upper) - special.ndtr(lower), special.ndtr(-lower) - special.ndtr(-upper)
        )
    across, along, weights = _slices(radius, stds[-1], means[-1], nodes)
    values = _density(across, stds[-1], means[-1]) * _ball(along, stds[:-1], means[:-1], nodes) * along
    return (values * weights).sum(axis=-1)


def _sphere(radius: Array, stds: Array, means: Array, nodes: int) -> Array:
    """Return the derivative of :func:`_ball` with respect to the radius."""
    if stds.size == 1:
        return _density(radius, stds[0], means[0]) + _density(-radius, stds[0], means[0])
    across, along, weights = _slices(radius, stds[-1], means[-1], nodes)
    values = _density(across, stds[-1], means[-1]) * _sphere(along, stds[:-1], means[:-1], nodes)
    return radius * (values * weights).sum(axis=-1)


def _slices(radius: Array, std: float, mean: float, nodes: int) -> tuple[Array, Array, Array]:
    """Return r sin θ, r cos θ and the weights of θ, ``(…, nodes)``, where the normal law is not negligible."""
    safe = np.maximum(radius, 1e-300)
    low = np.arcsin(np.clip((mean - FARTHEST * std) / safe, -1, 1))
    high = np.arcsin(np.clip((mean + FARTHEST * std) / safe, -1, 1))
    points, weights = _rule(nodes)
    half = ((high - low) / 2)[..., None]
    theta = ((high + low) / 2)[..., None] + half * points
    return radius[..., None] * np.sin(theta), radius[..., None] * np.cos(theta), half * weights


def _density(x: Array, std: float, mean: float) -> Array:
    return np.exp(-(((x - mean) / std) ** 2) / 2) / (math.sqrt(2 * math.pi) * std)


@lru_cache(maxsize=16)
def _rule(nodes: int) -> tuple[Array, Array]:
    points, weights = np.polynomial.legendre.leggauss(nodes)
    return points, weights


_POLE: Final = 0.5 - 1e-9
"""Bracket of the saddlepoint, just inside the poles at 2 w t = 1 (largest weight scaled to 1)."""
_NOTHING: Final = 1e-300
"""Weight that is nothing, and whose pole would be infinite."""


def tail(weights: Array, ratio: float, degrees: float) -> float:
    """Return the probability that ``Σ w χ²`` of one degree each exceeds ``ratio`` times chi-square of ``degrees``.

    A saddlepoint approximation (Kuonen 1999).
    """
    if (scale := float(weights.max())) <= 0:
        return 0.0 if degrees > 0 else 1.0
    w, number = np.append(weights, -ratio) / scale, np.append(np.ones(weights.size), degrees)
    if w.min() >= -_NOTHING:
        return 1.0
    t = optimize.brentq(lambda t: number @ (w / (1 - 2 * w * t)), _POLE / w.min(), _POLE, maxiter=1000)
    exponent, curvature = -number @ np.log1p(-2 * w * t) / 2, 2 * number @ (w / (1 - 2 * w * t)) ** 2
    root, v = np.sign(t) * np.sqrt(max(-2 * exponent, 0.0)), t * np.sqrt(curvature)
    return 0.5 if abs(root) < 1e-3 else float(special.ndtr(-root - np.log(v / root) / root))
