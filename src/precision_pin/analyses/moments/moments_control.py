"""Control variate for the exact error: the tangent and the most important products of two numbers.

The tangent alone misses products of numbers of mean zero, such as an amplitude and the sine of a phase. Mean and
covariance of the polynomial are known for any coefficients. Derivatives from differences are therefore accurate enough,
and omitted products increase the variance but cause no bias.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.laws.projection import NORMAL_MOMENTS
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.pose_model import PoseModel

STEP: Final = 0.5
"""Step of the differences that approximate derivatives, in standard deviations."""

_FLAT: Final = 1e-12  # relative variance below which a direction counts as constant: rounding


class ErrorAround:
    """Exact error around the means of the components."""

    def __init__(self, at: PoseModel) -> None:
        self._layout = sampler.to_arrays(at)
        self._mean = at.space.mean[:, None]

    def at(self, deviations: Array) -> Array:
        """Return the errors ``(6, N)`` at deviations ``(d, N)`` from the means; InputError where they do not exist."""
        try:
            return sampler.errors_at(self._layout, "exact", self._mean + deviations)
        except InputError as error:
            reason = error.findings[0].message.partition(": ")[2]
            raise InputError(
                f"one standard deviation from the means the exact error does not exist ({reason}); "
                "the closed form is not possible for such wide draws"
            ) from None


class Uncorrelated(NamedTuple):
    """Numbers ζ with mean 0 and covariance I, of which the components are an affine map.

    Attributes:
        columns: ``(d, K)`` displacement of the components by each number.
        third, fourth: ``(K,)`` third and fourth moments.
        pairs: ``(K, K)`` E ζ_k² ζ_l²; the diagonal is not used.
        known: ``(K,)`` true if the moments up to the fourth are known, and all moments other than these vanish.
    """

    columns: Array
    third: Array
    fourth: Array
    pairs: Array
    known: NDArray[np.bool_]

    @property
    def size(self) -> int:
        """Number of numbers ζ, K."""
        return int(self.columns.shape[1])

    @classmethod
    def of(cls, space: Space) -> Uncorrelated:
        """Return the numbers that generate the components of a space."""
        laws = {draw.name: draw.law for draw in space.draws}
        correlated = {name for correlation in space.correlations for name in correlation.names}
        groups = [[space.index[name] for name in correlation.names] for correlation in space.correlations]
        moments = [
            NORMAL_MOMENTS if all(laws[name].is_normal for name in correlation.names) else None
            for correlation in space.correlations
        ]
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name not in correlated:
                groups.append(list(range(rows.start, rows.stop)))
                moments.append(draw.law.standardised_moments())
        columns: list[Array] = []
        third: list[float] = []
        fourth: list[float] = []
        pairs: list[Array] = []
        complete: list[bool] = []
        for group, shape in zip(groups, moments, strict=True):
            spread = space.block_covariance.within(group)
            values, vectors = np.linalg.eigh(spread)
            varies = values > _FLAT * max(values.max(), 0.0)
            count = int(varies.sum())
            if not count:
                continue
            scaled = np.zeros((space.size, count))
            scaled[group] = vectors[:, varies] * np.sqrt(values[varies])
            skewness, kurtosis, coupling = NORMAL_MOMENTS if shape is None else shape
            columns.append(scaled)
            # the eigenvector of a single number may have a negative sign
            third += [skewness * (np.sign(scaled.sum()) if len(group) == 1 else 1.0)] * count
            fourth += [kurtosis] * count
            complete += [shape is not None] * count
            pairs.append(np.full((count, count), coupling))
        size = len(third)
        matrix = np.ones((size, size))
        begin = 0
        for block in pairs:
            matrix[begin : begin + len(block), begin : begin + len(block)] = block
            begin += len(block)
        return cls(
            np.concatenate([np.zeros((space.size, 0)), *columns], axis=1),
            np.array(third, dtype=float),
            np.array(fourth, dtype=float),
            matrix,
            np.array(complete, dtype=bool),
        )


_LEAST: Final = 1e-10
"""Smallest fraction of the variance of all products for which a product is kept."""

_ROUNDING: Final = 1e-14  # spread (m, rad) that counts as rounding


class Control(NamedTuple):
    """Polynomial in the components x, ``e0 + J ξ + Σ c_p ξ_a(p) ξ_b(p)`` with ξ = x minus its mean.

    Attributes:
        mean, covariance: ``(6,)`` mean and ``(6, 6)`` covariance of the polynomial.
        centre: ``(d,)`` means of the components.
        jacobian: ``(6, d)`` matrix J.
        shift: ``(6,)`` mean of J x and the products.
        used: ``(U,)`` components that occur in products.
        first, second: ``(P,)`` a and b of every product, as rows of ``used``.
        coefficients: ``(6, P)`` coefficients c.
    """

    mean: Array
    covariance: Array
    centre: Array
    jacobian: Array
    shift: Array
    used: NDArray[np.intp]
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    coefficients: Array

    @classmethod
    def of(cls, at: PoseModel) -> Control:
        """Return the control variate of a pose's exact error."""
        numbers = Uncorrelated.of(at.space)
        # a product of two components is a product of two numbers only where each number moves a single component
        usable = np.flatnonzero(numbers.known & (np.count_nonzero(numbers.columns, axis=0) == 1))
        derivatives = None
        # largest number of components for which products are used: their number grows with the square
        if 0 < usable.size <= 256:
            with suppress(InputError):  # draws so wide that the error does not exist at their edge: the tangent alone
                derivatives = _second_derivatives(at, numbers, usable)
        bends = np.zeros((6, usable.size, usable.size)) if derivatives is None else derivatives
        sizes = _variances(numbers, usable, bends)
        totals = np.diagonal(at.covariance) + sizes.sum(axis=(1, 2))
        parts = np.einsum("ikm,i->km", sizes, 1 / np.where(totals > _ROUNDING**2, totals, np.inf))
        # largest number of products kept: 54 numbers have 1,485, of which 200 are relevant
        order = np.argsort(-parts, axis=None, kind="stable")[:512]
        order = order[parts.flat[order] > _LEAST * parts.sum()]
        k, m = np.unravel_index(order, parts.shape)
        terms = bends[:, k, m] * np.where(k == m, 0.5, 1.0)
        k, m = usable[k], usable[m]
        components = np.array([np.flatnonzero(column)[0] for column in numbers.columns.T], dtype=np.intp)
        spread = numbers.columns[components, np.arange(numbers.size)]
        used, rows = np.unique(np.concatenate([components[k], components[m]]), return_inverse=True)
        curved = terms[:, k == m].sum(axis=1)
        return cls(
            mean=at.error_at_means + curved,
            covariance=at.covariance + _beyond_tangent(at.jacobian @ numbers.columns, numbers, k, m, terms),
            centre=at.space.mean,
            jacobian=at.jacobian,
            shift=at.jacobian @ at.space.mean + curved,
            used=used,
            first=rows[: k.size],
            second=rows[k.size :],
            coefficients=terms / (spread[k] * spread[m]),
        )

    def deviations(self, x: Array) -> Array:
        """Return the polynomial minus its mean, ``(6, N)``, for components ``(d, N)``."""
        result = np.empty((6, x.shape[1]))
        work = 6 * max(len(self.centre), self.first.size)
        for columns in thin(x.shape[1], work):
            part = x[:, columns]
            result[:, columns] = self.jacobian @ part - self.shift[:, None]
            if self.first.size:
                centred = part[self.used] - self.centre[self.used, None]
                result[:, columns] += self.coefficients @ (centred[self.first] * centred[self.second])
        return result


def thin(count: int, work: int) -> Iterator[slice]:
    """Yield slices of columns so narrow that a product with ``work`` multiplications per column stays on one thread."""
    # size of matrix products below which BLAS stays on one thread, which is faster for thin matrices
    step = max(64, (2**18) // max(work, 1))
    return (slice(first, min(first + step, count)) for first in range(0, count, step))


def _second_derivatives(at: PoseModel, numbers: Uncorrelated, usable: NDArray[np.intp]) -> Array:
    """Return f_km of the exact error for k ≤ m and 0 elsewhere, ``(6, K, K)``."""
    exact = ErrorAround(at)
    steps = STEP * numbers.columns[:, usable]
    middle = exact.at(np.zeros((at.space.size, 1)))
    result = np.zeros((6, usable.size, usable.size))
    for k in range(usable.size):
        b = steps[:, k + 1 :]
        a = steps[:, [k]]
        grid = exact.at(np.concatenate([a, -a, a + b, a - b, b - a, -a - b], axis=1))
        result[:, k, k] = (grid[:, 0] + grid[:, 1] - 2 * middle[:, 0]) / STEP**2
        pp, pm, mp, mm = np.split(grid[:, 2:], 4, axis=1)
        result[:, k, k + 1 :] = (pp - pm - mp + mm) / (4 * STEP**2)
    return result


def _variances(numbers: Uncorrelated, usable: NDArray[np.intp], bends: Array) -> Array:
    """Return the variance that each product alone adds to each component, ``(6, K, K)``."""
    weights = numbers.pairs[np.ix_(usable, usable)].copy()
    np.fill_diagonal(weights, (numbers.fourth[usable] - 1) / 4)
    return np.asarray(bends**2 * weights)


def _beyond_tangent(
    first: Array, numbers: Uncorrelated, k: NDArray[np.intp], m: NDArray[np.intp], terms: Array
) -> Array:
    """Return the covariance ``(6, 6)`` that products ``terms ζ_k ζ_m`` add to the covariance of the tangent."""
    squares = np.zeros((6, numbers.size))
    is_square = k == m
    squares[:, k[is_square]] = terms[:, is_square]
    weights = numbers.pairs - 1
    np.fill_diagonal(weights, numbers.fourth - 1)
    products = (first * numbers.third) @ squares.T
    mixed = terms[:, ~is_square]
    result: Array = products + products.T + squares @ weights @ squares.T
    result += (mixed * numbers.pairs[k[~is_square], m[~is_square]]) @ mixed.T
    return result
