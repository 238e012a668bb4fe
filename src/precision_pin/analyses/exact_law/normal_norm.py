"""Length of a normal vector: the root of a generalised chi-square variable.

In principal axes the density is a product. The probability of a ball of radius r about the origin is integrated one axis
after another, ``P_m(r) = ∫ f_m(r sin θ) P_(m-1)(r cos θ) r cos θ dθ``, starting from the normal law ``P_1``. The integrands
are analytic, so that Gauss-Legendre rules converge geometrically; the number of nodes is doubled until the value is
stationary. (Imhof's inversion, Biometrika 48, 1961, gives the same probability by an integral that converges slowly in few
dimensions.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, final

import numpy as np
from scipy import optimize, special

from precision_pin.analyses.exact_law.quantile_bounds import quantile_bounds
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError

ERROR: Final = 1e-12
"""Error of the cumulative law, ten times the largest change at the last doubling of the nodes."""

_FARTHEST: Final = 9.0
_NODES: Final = 48
_MOST_NODES: Final = 768
_AT_ONCE: Final = 4_000_000
_FLAT: Final = 1e-9


@final
@dataclass(frozen=True, eq=False)
class NormalNorm:
    """Law of |v| for a normal vector v.

    Attributes
    ----------
    centre
        Mean of v, ``(3,)``.
    matrix
        Covariance of v, ``(3, 3)``.
    """

    centre: Array
    matrix: Array

    def __post_init__(self) -> None:
        fix_fields(self)

    @property
    def method(self) -> str:
        """Method of computation, as text."""
        return "generalised chi-square law, by integration over the ball"

    @property
    def error(self) -> float:
        """Bound of the error of :meth:`cumulative`, :data:`ERROR`."""
        return ERROR

    @cached_property
    def _axes(self) -> tuple[Array, Array, float]:
        """Standard deviations and means along the varying principal axes, largest first; length of the constant part."""
        values, vectors = np.linalg.eigh(self.matrix)
        stds, means = np.sqrt(np.maximum(values, 0.0))[::-1], (vectors.T @ self.centre)[::-1]
        varies = stds > _FLAT * stds[0]
        return stds[varies], means[varies], float(np.linalg.norm(means[~varies]))

    @property
    def low(self) -> float:
        """Length of the constant part."""
        return self._axes[2]

    @property
    def high(self) -> float:
        """Upper end, beyond which the probability is below 1e-18."""
        stds, means, still = self._axes
        return math.hypot(float(np.linalg.norm(np.abs(means) + _FARTHEST * stds)), still)

    def cumulative(self, r: Array) -> Array:
        """Return P(|v| ≤ r), ``(N,)``."""
        inner = np.sqrt(np.maximum(r**2 - self._axes[2] ** 2, 0.0))
        return np.clip(self._evaluate(_ball, inner), 0.0, 1.0)

    def density(self, r: Array) -> Array:
        """Return the density of |v|, ``(N,)``."""
        inner = np.sqrt(np.maximum(r**2 - self._axes[2] ** 2, 0.0))
        return self._evaluate(_sphere, inner) * r / np.where(inner > 0, inner, np.inf)

    def quantile(self, p: float) -> float:
        """Return the radius of the ball with this probability, by Brent's method.

        Raises
        ------
        InputError
            Beside the constant part the spread is lost in rounding.
        """

        def excess(r: float) -> float:
            return float(self.cumulative(np.array([r]))[0]) - p

        if self.high - self.low <= 1e-14 * self.high:
            raise InputError(
                f"the constant part of an error is {self.low:.3g} (m or rad), beside which its spread is lost in rounding; "
                "mend the mean of an offset"
            )
        root: float = optimize.brentq(excess, self.low, self.high, xtol=1e-15 * self.high, rtol=1e-14)
        return root

    def quantile_error(self, p: float) -> float:
        """Return the error bound of :meth:`quantile`."""
        return float(quantile_bounds(self, np.array([p]), np.array([self.quantile(p)]))[0])

    @cached_property
    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation of |v|; the mean as ∫ (1 - P) dr."""
        nodes, weights = _rule(256)
        stds, means, still = self._axes
        centre = math.hypot(float(np.linalg.norm(means)), still)
        reach = _FARTHEST * float(np.linalg.norm(stds))
        low, high = max(self.low, centre - reach), min(self.high, centre + reach)
        r = low + (high - low) * (nodes + 1) / 2
        mean = low + float((1 - self.cumulative(r)) @ weights) * (high - low) / 2
        square = float(self.centre @ self.centre + np.trace(self.matrix))
        return mean, math.sqrt(max(square - mean**2, 0.0))

    def _evaluate(self, function: Callable[[Array, Array, Array, int], Array], radii: Array) -> Array:
        """Return a function of radii, with the nodes of each doubled until the value is stationary."""
        stds, means, _ = self._axes
        step = max(1, _AT_ONCE // (2 * _NODES) ** (stds.size - 1))
        if radii.size > step:
            parts = [self._evaluate(function, radii[first : first + step]) for first in range(0, radii.size, step)]
            return np.concatenate(parts)
        nodes = _NODES
        values = function(radii, stds, means, nodes)
        open_ones = np.arange(radii.size)
        while open_ones.size and nodes < _MOST_NODES and stds.size > 1:
            nodes *= 2
            before = values[open_ones]
            values[open_ones] = now = function(radii[open_ones], stds, means, nodes)
            open_ones = open_ones[np.abs(now - before) > ERROR / 10 * np.maximum(1.0, np.abs(now) * stds[0])]
        return values


def _ball(radius: Array, stds: Array, means: Array, nodes: int) -> Array:
    """Return the probability of balls about the origin, ``radius`` of any shape."""
    if stds.size == 1:
        upper, lower = (radius - means[0]) / stds[0], (-radius - means[0]) / stds[0]
        # the difference of the nearer tails, so that distant balls keep their digits
        probability: Array = np.where(
            means[0] > 0,
            special.ndtr(upper) - special.ndtr(lower),
            special.ndtr(-lower) - special.ndtr(-upper),
        )
        return probability
    across, along, weights = _slices(radius, stds[-1], means[-1], nodes)
    values = _density(across, stds[-1], means[-1]) * _ball(along, stds[:-1], means[:-1], nodes) * along
    total: Array = (values * weights).sum(axis=-1)
    return total


def _sphere(radius: Array, stds: Array, means: Array, nodes: int) -> Array:
    """Return the derivative of :func:`_ball` with respect to the radius."""
    if stds.size == 1:
        return _density(radius, stds[0], means[0]) + _density(-radius, stds[0], means[0])
    across, along, weights = _slices(radius, stds[-1], means[-1], nodes)
    values = _density(across, stds[-1], means[-1]) * _sphere(along, stds[:-1], means[:-1], nodes)
    total: Array = radius * (values * weights).sum(axis=-1)
    return total


def _slices(radius: Array, std: float, mean: float, nodes: int) -> tuple[Array, Array, Array]:
    """Return r sin θ, r cos θ and the weights of θ, ``(…, nodes)``, where the normal law is not negligible."""
    safe = np.maximum(radius, 1e-300)
    low = np.arcsin(np.clip((mean - _FARTHEST * std) / safe, -1, 1))
    high = np.arcsin(np.clip((mean + _FARTHEST * std) / safe, -1, 1))
    points, weights = _rule(nodes)
    half = ((high - low) / 2)[..., None]
    theta = ((high + low) / 2)[..., None] + half * points
    return radius[..., None] * np.sin(theta), radius[..., None] * np.cos(theta), half * weights


def _density(x: Array, std: float, mean: float) -> Array:
    value: Array = np.exp(-(((x - mean) / std) ** 2) / 2) / (math.sqrt(2 * math.pi) * std)
    return value


@lru_cache(maxsize=16)
def _rule(nodes: int) -> tuple[Array, Array]:
    points, weights = np.polynomial.legendre.leggauss(nodes)
    return points, weights
