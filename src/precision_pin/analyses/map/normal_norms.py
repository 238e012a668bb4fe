"""Lengths of many normal vectors at once: probabilities and quantiles.

:class:`precision_pin.analyses.exact_law.number_law.NormalNorm` computes the same law for one vector to twelve digits; a
map needs it for thousands. With λ and m the variances and means along the principal axes, ``Q = |v|²`` has the cumulant
generating function ``K(t) = Σ [m² t/(1 - 2λt) - ln(1 - 2λt)/2]``, and ``P(Q > x) = 1/(2πi) ∫ exp(K(t) - t x)/t dt`` on
a path that crosses the real axis between 0 and 1/(2 max λ); crossing it below 0 gives ``-P(Q ≤ x)``. The path is the
parabola of steepest descent from the saddle point ``K'(t) = x`` (Daniels, Annals of Mathematical Statistics 25, 1954;
Rice, SIAM Journal on Scientific and Statistical Computing 1, 1980), moved away from the pole where the two are close.
The integrand falls like a normal density along it, so that the trapezoidal rule converges exponentially.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.base.arrays import Array

_NODES: Final = 32
_STEP: Final = 0.15
_PARAMETER: Final = (np.arange(_NODES) + 0.5)[:, None] * _STEP
# distances of the nodes on half of the path from the real axis, ``(nodes, 1)``, in units of 1/√K''
_ACROSS: Final = np.sinh(_PARAMETER)
_WEIGHTS: Final = np.cosh(_PARAMETER) * (_STEP / np.pi)
# slope to which the parabola flattens: with 1 or more the integrand of a long vector may grow again
_SLOPE: Final = 0.7
# largest distance from the mean, in standard deviations of the vector, at which a probability is computed
_FARTHEST: Final = 40.0
# smallest distance of the path from the pole, in the same units
_FROM_POLE: Final = 1.0
# variance along an axis, relative to the largest, below which the vector is constant along it
_FLAT: Final = 1e-14
_ROUNDS: Final = 3
# relative step after which the next one is at rounding: convergence is quadratic
_CLOSE: Final = 2e-5
_ROUNDING: Final = 1e-28
# largest |s| of an argument of K: there 1 - t/end is exp(-s)
_FAR: Final = 60.0
_MOST_STEPS: Final = 100
_LAST_STEP: Final = 1e-6
# vectors whose integrals are computed together, so that their arrays stay in the processor's cache
_AT_ONCE: Final = 128


def principal_axes(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Return variances and means along the principal axes, ``(3, P)`` each, for ``(3, P)`` and ``(3, 3, P)``."""
    values, vectors = np.linalg.eigh(np.moveaxis(covariance, -1, 0))
    return np.ascontiguousarray(np.maximum(values, 0.0).T), np.einsum("pij,ip->jp", vectors, mean)


def norm_probabilities(variances: Array, means: Array, radii: Array) -> Array:
    """Return P(|v| ≤ r), ``(P,)``, for vectors in principal axes ``(3, P)`` and radii ``(P,)``; errors below 1e-7."""
    law = _Law(variances, means)
    found = law.evaluate(np.maximum(radii**2 - law.constant, 0.0))[0]
    return np.where(law.still, (radii**2 >= law.constant).astype(float), found)


def norm_quantiles(
    variances: Array, means: Array, probability: float | Array, near: tuple[float, Array] | None = None
) -> Array:
    """Return the quantile of |v|, ``(P,)``, for vectors in principal axes ``(3, P)``; relative errors below 1e-5.

    Newton's method in normal scores, from a gamma law with the first two moments of |v|²; ``near`` is a probability
    close to the requested one and its quantiles ``(P,)``, which improve the start.
    """
    law = _Law(variances, means)
    squares, spreads = law.moments
    x = special.gammaincinv(squares**2 / spreads, probability)
    if near is None:
        x *= spreads / squares
    else:
        known = np.maximum(near[1] ** 2 - law.constant, 1e-3 * squares)
        x *= known / special.gammaincinv(squares**2 / spreads, near[0])
    score, going = special.ndtri(probability), np.ones(x.shape, dtype=np.bool_)
    for _ in range(_ROUNDS):
        found, density = law.evaluate(x)
        scores = special.ndtri(np.clip(found, 1e-15, 1 - 1e-15))
        slopes = np.maximum(density, 1e-300) * np.sqrt(2 * np.pi) * np.exp(scores**2 / 2)
        # the score is nearly linear in the logarithm of x far in the tails
        change = np.where(going, np.clip((score - scores) / (slopes * x), -1.0, 1.0), 0.0)
        x = x * np.exp(change)
        going = np.abs(change) >= _CLOSE
        if not going.any():
            break
    return np.sqrt(np.where(law.still, 0.0, x) + law.constant)


def norm_tail_bounds(variances: Array, means: Array, radii: Array) -> Array:
    """Return the least exp(K(t) - t r²), a bound of P(|v| > r), ``(P,)``; arguments as for `norm_probabilities`."""
    law = _Law(variances, means)
    x = np.minimum(radii**2 - law.constant, law.farthest)
    t = np.maximum(law.saddle(x), 0.0)
    return np.where(law.still, x < 0, np.exp(law.exponent(t) - t * x))


def norm_tail_quantiles(variances: Array, means: Array, tail: float) -> Array:
    """Return the length beyond which the bound of `norm_tail_bounds` is ``tail``, ``(P,)``."""
    law = _Law(variances, means)
    wanted = -np.log(tail)

    def excess(s: Array) -> tuple[Array, Array]:
        t = law.argument(s)
        first, second = law.derivatives(t)
        below = np.maximum(t * first - law.exponent(t), 1e-300)
        return np.log(below / wanted), t * second * (law.end - t) / below

    t = law.argument(_root(excess, np.full(means.shape[1], 1.0), 0.0, _FAR))
    return np.sqrt(np.where(law.still, 0.0, law.derivatives(t)[0]) + law.constant)


def norm_quantile_slopes(mean: Array, covariance: Array, radii: Array) -> Array:
    """Return the derivative of a quantile of |v| with respect to the covariance, ``(3, 3, P)``; zeros for a constant.

    For a change dΣ the quantile, which is ``radii``, changes by the sum of the products of the entries. The probability
    is constant when x = r² changes by ``∫ exp(K - t x) dK/t dt / ∫ exp(K - t x) dt``, with ``dK = t tr(W dΣ) + 2 t² mᵀ
    W dΣ W m`` and ``W = (1 - 2 t Σ)⁻¹``. ``mean``, ``covariance``, ``radii`` are ``(3, P)``, ``(3, 3, P)``, ``(P,)``.
    """
    values, vectors = np.linalg.eigh(np.moveaxis(covariance, -1, 0))
    means = np.einsum("pij,ip->jp", vectors, mean)
    law = _Law(np.ascontiguousarray(np.maximum(values, 0.0).T), means)
    slopes = law.variance_slopes(np.maximum(radii**2 - law.constant, 0.0), means) / (2 * np.maximum(radii, 1e-300))
    return np.asarray(np.einsum("pik,klp,pjl->ijp", vectors, np.where(law.still, 0.0, slopes), vectors))


class _Law:
    """Law of |v|² minus its constant part, for vectors in principal axes ``(3, P)``."""

    def __init__(self, variances: Array, means: Array) -> None:
        largest = variances.max(axis=0)
        squares = means**2
        self.still = largest <= _ROUNDING * np.maximum(1.0, squares.sum(axis=0))
        flat = variances <= _FLAT * largest
        self.constant = np.where(flat | self.still, squares, 0.0).sum(axis=0)
        # where nothing varies, any law will do
        self._variances = np.where(self.still, 1.0, np.where(flat, 0.0, variances))
        self._squares = np.where(self.still | flat, 0.0, squares)
        self.end = 1 / (2 * self._variances.max(axis=0))
        # farther out the probability vanishes, and the saddle is indistinguishable from the pole
        most = np.sqrt(self._squares.sum(axis=0)) + _FARTHEST * np.sqrt(self._variances.sum(axis=0))
        self.farthest = most**2

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean and variance, ``(P,)``."""
        first = (self._variances + self._squares).sum(axis=0)
        return first, (2 * self._variances * (self._variances + 2 * self._squares)).sum(axis=0)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return probability and density at ``x`` ``(P,)``."""
        x = np.minimum(x, self.farthest)
        saddle = self._crossing(x)
        density, beyond = np.empty((2, len(x)))
        for first in range(0, len(x), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            path, values = self._integrand(x, saddle, part)
            density[part] = values.imag.sum(axis=0)
            beyond[part] = (values / path).imag.sum(axis=0)
        probability: Array = np.clip(np.where(saddle[0] > 0, 1 - beyond, -beyond), 0.0, 1.0)
        return probability, density

    def variance_slopes(self, x: Array, means: Array) -> Array:
        """Return the derivative of the quantile ``x`` by the covariance in principal axes, ``(3, 3, P)``."""
        path, values = self._integrand(x, self._crossing(x), slice(None))
        wide = 1 / (1 - 2 * self._variances[:, None] * path)
        turned = means[:, None] * wide
        rates = 2 * path * turned[:, None] * turned[None] + np.eye(3)[:, :, None, None] * wide
        return np.asarray((values * rates).imag.sum(axis=2) / values.imag.sum(axis=0))

    def _integrand(
        self, x: Array, saddle: tuple[Array, Array, Array], part: slice
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the nodes of the path through a saddle from `_crossing` and the weighted integrand, ``(nodes, P)``."""
        crossing, second, third = (of[part] for of in saddle)
        width = 1 / np.sqrt(second)
        bend = third * width / (6 * second)
        flattening = 1 / np.sqrt(1 + (bend * _ACROSS / _SLOPE) ** 2)
        path, rates = np.empty((2, _NODES, len(width)), dtype=np.complex128)
        path.real, path.imag = crossing + width * bend * _ACROSS**2 * flattening, width * _ACROSS
        rates.real = width * bend * _ACROSS * _WEIGHTS * flattening * (1 + flattening**2)
        rates.imag = width * _WEIGHTS
        return path, self._transformed(path, x[part], part) * rates

    def argument(self, s: Array) -> Array:
        """Return the argument of K at which K' increases with s, from 0 to infinity."""
        return self.end * -np.expm1(-s)

    def saddle(self, x: Array) -> Array:
        """Return the argument at which the derivative of K is x, ``(P,)``."""
        least = self.derivatives(self.argument(np.full(x.shape, -_FAR)))[0]
        wanted = np.log(np.maximum(x, least))

        def excess(s: Array) -> tuple[Array, Array]:
            t = self.argument(s)
            first, second = self.derivatives(t)
            return np.log(first) - wanted, second * (self.end - t) / first

        # with equal variances and no means this is the solution
        start = wanted - np.log(self.derivatives(np.zeros(x.shape))[0])
        return self.argument(_root(excess, np.clip(start, -_FAR, _FAR), -_FAR, _FAR))

    def _crossing(self, x: Array) -> tuple[Array, Array, Array]:
        """Return where the path crosses the real axis, and the second and third derivative of K there."""
        t = self.saddle(x)
        away = _FROM_POLE / np.sqrt(self.derivatives(t)[1])
        left = (t < 0) | (2 * away > self.end)
        t = np.where(np.abs(t) >= away, t, np.where(left, -away, away))
        return t, self.derivatives(t)[1], self.third_derivative(t)

    def _transformed(self, t: NDArray[np.complex128], x: Array, part: slice) -> NDArray[np.complex128]:
        """Return exp(K(t) - t x) at ``t`` ``(nodes, P)`` in the upper half plane."""
        left = 1 - 2 * self._variances[:, None, part] * t
        pair = left[0] * left[1]
        product = pair * left[2]
        # each factor turns by 0 to -π, so the partial products give the branch of the square root; logarithms are
        # slower
        root = np.where((pair.imag > 0) | (product.imag > 0), -1.0, 1.0) * np.sqrt(product)
        return np.exp((self._squares[:, None, part] * t / left).sum(axis=0) - t * x) / root

    def exponent(self, t: Array) -> Array:
        """Return K at real ``t`` ``(P,)`` below its end."""
        left = 1 - 2 * self._variances * t
        return (self._squares * t / left - np.log(left) / 2).sum(axis=0)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of K at real ``t`` ``(P,)`` below its end."""
        over = 1 / (1 - 2 * self._variances * t)
        small, large = self._variances * over, self._squares * over * over
        return (small + large).sum(axis=0), (2 * small * (small + 2 * large)).sum(axis=0)

    def third_derivative(self, t: Array) -> Array:
        """Return the third derivative of K at real ``t`` ``(P,)`` below its end."""
        over = 1 / (1 - 2 * self._variances * t)
        small = self._variances * over
        return (8 * small * small * (small + 3 * self._squares * over * over)).sum(axis=0)


def _root(function: Callable[[Array], tuple[Array, Array]], start: Array, least: float, most: float) -> Array:
    """Return the zero ``(P,)`` of an increasing function of values and slopes, to about 1e-12.

    Newton's method, with bisection where that would leave the bracket or is slower.
    """
    at, low, high = start, np.full(start.shape, least), np.full(start.shape, most)
    last = high - low
    for _ in range(_MOST_STEPS):
        values, slopes = function(at)
        low, high = np.where(values <= 0, at, low), np.where(values >= 0, at, high)
        change = -values / np.maximum(slopes, 1e-300)
        newton = (at + change >= low) & (at + change <= high) & (2 * np.abs(change) <= last)
        # after a small step the next one would be as small as its square
        change = np.where(last < _LAST_STEP, 0.0, np.where(newton, change, (low + high) / 2 - at))
        at, last = at + change, np.abs(change)
        if last.max(initial=0.0) < _LAST_STEP:
            break
    return at
