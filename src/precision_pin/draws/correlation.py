"""Correlation between draws of one component: a Gaussian copula.

The matrix is the correlation of the normal scores. Draw i has the score z_i = Σ_j L_ij n_j and the value F_i⁻¹(Φ(z_i)),
with L L^T the matrix and n_j independent standard normal numbers from the streams of the draws. The distribution of
each draw is unchanged. The Pearson correlation of the values follows from :func:`covariance_of`. (Nelsen, An
Introduction to Copulas, 2nd ed., 2006, section 2.3; Cario and Nelson, 1997, who call the result NORTA.)
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_items, check_number, check_numbers, check_text, shown
from precision_pin.base.arrays import Array, Fixed, returns_read_only
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws import lazy_special
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import FARTHEST_NORMAL, Law

LEAST_EIGENVALUE: Final = 1e-6
"""Matrices with a smaller eigenvalue are rejected: fully dependent parameters are one parameter."""

MOST_TOGETHER: Final = 500
"""Maximum number of parameters in one correlation: 125,000 pairs, whose integrals may take some milliseconds each."""

_MOST_REPAIRED: Final = 40
"""Largest size for which each entry is tried as the only wrong one, to name it in the message; time grows with size⁵."""

_REACH: Final = 9.0
"""Integrals over a normal score end at ±9; the probability beyond is 2e-19."""

# by their panels of a width, products of the laws' smooth parts are integrated to 1e-9 of the standard deviations
_RULES: Final = tuple(
    (*np.polynomial.legendre.leggauss(nodes), shortest, longest)
    for nodes, shortest, longest in ((12, 0.1, math.inf), (4, 0.01, 0.1), (2, 0.0, 0.01))
)
"""Nodes and weights with the shortest and longest panel that they are for, in widths of the density's ridge."""

_ROWS: Final = 64
"""Rows of the double integral summed at once, which bounds the memory."""


@dataclass(frozen=True)
class Correlation:
    """Correlation of several draws of one component.

    Attributes:
        names: The draws.
        matrix: Correlation of their normal scores, row by row.

    Raises:
        InputError: Fewer than two names, a repeated name, or a matrix of another size, not symmetric, without 1 on its
            diagonal or not positive definite. In the last case the message names the pair whose entry needs the
            smallest change; if no single entry suffices, the pair with the lowest C_ij v_i v_j, where v is the
            eigenvector of the smallest eigenvalue.

    Examples:
        >>> draws = (pp.Draw("a1", pp.Normal(1.0)), pp.Draw("a3", pp.Normal(2.0)))
        >>> tied = pp.Correlation(("a1", "a3"), ((1.0, 0.5), (0.5, 1.0)))
        >>> print(pp.Space(draws, (tied,)).covariance)
        [[1. 1.]
         [1. 4.]]
    """

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", check_items("the names of a correlation", self.names, str))
        if not isinstance(self.matrix, tuple | list | np.ndarray) or any(np.ndim(row) != 1 for row in self.matrix):
            raise InputError(f"the correlation matrix must be rows of numbers, got {shown(self.matrix)}")
        size = len(self.names)
        if size < 2:
            raise InputError("a correlation needs at least two parameters")
        if size > MOST_TOGETHER:
            raise InputError(
                f"a correlation of {size:,} parameters is too large, since each pair takes an integral over both laws; "
                f"at most {MOST_TOGETHER} can be correlated together"
            )
        if len(set(self.names)) < size:
            duplicate = next(name for k, name in enumerate(self.names) if name in self.names[:k])
            raise InputError(f"the correlation names {duplicate!r} twice")
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            shape = " and ".join(sorted({str(len(row)) for row in self.matrix}))
            raise InputError(
                f"the correlation matrix of {', '.join(self.names)} has {len(self.matrix)} rows of {shape or 'no'} numbers, "
                f"expected {size} of {size}"
            )
        rows = [check_numbers("the correlation matrix", row, (None,), "rows of finite numbers") for row in self.matrix]
        object.__setattr__(self, "matrix", tuple([tuple(row.tolist()) for row in rows]))
        for (i, a), (j, b) in itertools.combinations(enumerate(self.names), 2):
            upper, lower = self.matrix[i][j], self.matrix[j][i]
            if upper != lower:
                raise InputError(
                    f"the correlation of {a!r} and {b!r} is {upper:g} in one place and {lower:g} in the other"
                )
            if not -1 < upper < 1:
                raise InputError(
                    f"the correlation of {a!r} and {b!r} is {upper:g}; it must lie between -1 and 1 "
                    "(two that always move together are one parameter)"
                )
        for k, name in enumerate(self.names):
            if self.matrix[k][k] != 1:
                raise InputError(f"the correlation of {name!r} with itself is {self.matrix[k][k]:g}; it must be 1")
        matrix = np.array(self.matrix)
        values, vectors = np.linalg.eigh(matrix)
        if values[0] >= LEAST_EIGENVALUE:
            return
        repairs = []
        # the time of each attempt grows with the cube of the size
        for i, j in itertools.combinations(range(len(matrix)), 2) if len(matrix) <= _MOST_REPAIRED else ():
            allowed = _allowed_interval(matrix, i, j)
            if allowed is not None and not allowed[0] < matrix[i, j] < allowed[1]:
                change = min(abs(matrix[i, j] - end) for end in allowed)
                repairs.append(
                    (change, i, j, f"contradicts the others, which allow {allowed[0]:.3g} to {allowed[1]:.3g}")
                )
        if not repairs:
            pull = np.triu(matrix * np.outer(vectors[:, 0], vectors[:, 0]), 1)
            repairs.append((0.0, *divmod(int(np.argmin(pull)), len(matrix)), "contradicts the others most"))
        _, i, j, reason = min(repairs)
        raise InputError(
            f"the correlation matrix of {', '.join(self.names)} is not positive definite (smallest eigenvalue "
            f"{values[0]:.3g}, at least {LEAST_EIGENVALUE:g} is needed): "
            f"the {matrix[i, j]:g} of {self.names[i]!r} and {self.names[j]!r} {reason}"
        )

    @classmethod
    def pair(cls, first: str, second: str, correlation: float) -> Correlation:
        """Return the correlation of two draws."""
        names = (check_text("first of a correlation", first), check_text("second of a correlation", second))
        value = check_number("the correlation of a pair", correlation)
        return cls(names, ((1.0, value), (value, 1.0)))

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Positions of the names in alphabetical order, so that samples do not depend on the order of the names."""
        return tuple(sorted(range(len(self.names)), key=self.names.__getitem__))

    @cached_property
    @returns_read_only
    def root(self) -> Array:
        """Lower-triangular L with L L^T the matrix, in alphabetical order of the names."""
        matrix = np.array(self.matrix)[np.ix_(self.order, self.order)]
        root = np.zeros_like(matrix)
        for k in range(len(self.names)):
            root[k, k] = math.sqrt(matrix[k, k] - (root[k, :k] ** 2).sum())
            for i in range(k + 1, len(self.names)):
                root[i, k] = (matrix[i, k] - (root[i, :k] * root[k, :k]).sum()) / root[k, k]
        return root

    def mix(self, normals: Array) -> Array:
        """Return normal scores ``(m, N)`` for independent normal numbers ``(m, N)``, both in the order of the names.

        Scores are cut off at ±8.6, the largest normal number drawn; fewer than one in 10¹⁶ lie beyond.
        """
        scores = np.empty_like(normals)
        for k, target in enumerate(self.order):
            # summed one after another: the last bits of numpy's matrix product depend on the number of columns
            total = self.root[k, k] * normals[target]
            for j, other in enumerate(self.order[:k]):
                total = total + self.root[k, j] * normals[other]
            scores[target] = np.clip(total, -FARTHEST_NORMAL, FARTHEST_NORMAL)
        return scores


@dataclass(frozen=True, eq=False)
class BlockCovariance(Fixed):
    """Covariance of d components: variances ``(d,)``; columns ``(m,)`` and covariance ``(m, m)`` of dependent groups."""

    variances: Array
    blocks: tuple[tuple[NDArray[np.intp], Array], ...]

    @property
    def dense(self) -> Array:
        """The matrix, ``(d, d)``."""
        return self.within(np.arange(self.variances.size))

    def times(self, vectors: Array) -> Array:
        """Return the matrix times vectors ``(d, n)``."""
        result: Array = self.variances[:, None] * vectors
        for columns, block in self.blocks:
            result[columns] = block @ vectors[columns]
        return result

    def between(self, first: Array, second: Array) -> Array:
        """Return the covariance ``(p, q)`` of linear combinations with slopes ``(p, d)`` and ``(q, d)``."""
        return first @ self.times(second.T)

    def variances_of(self, slopes: Array) -> Array:
        """Return the variances ``(p,)`` of linear combinations with slopes ``(p, d)``."""
        return np.einsum("ij,ji->i", slopes, self.times(slopes.T))

    def within(self, columns: ArrayLike) -> Array:
        """Return the covariance ``(n, n)`` of n of the components."""
        selection = np.asarray(columns, dtype=np.intp)
        result: Array = np.diag(self.variances[selection])
        rows = np.full(self.variances.size, -1, dtype=np.intp)
        rows[selection] = np.arange(selection.size)
        for members, block in self.blocks:
            hits = np.flatnonzero(rows[members] >= 0)
            result[np.ix_(rows[members[hits]], rows[members[hits]])] = block[np.ix_(hits, hits)]
        return result

    def scaled(self, factors: Array) -> BlockCovariance:
        """Return the covariance of the components times factors ``(d,)``."""
        blocks = ((columns, block * np.outer(factors[columns], factors[columns])) for columns, block in self.blocks)
        return BlockCovariance(self.variances * factors**2, tuple(blocks))


def _allowed_interval(matrix: Array, i: int, j: int) -> tuple[float, float] | None:
    """Return the interval of an entry in which the matrix is positive definite, if any."""
    # there the partial correlation of the two, given all others, is between -1 and 1
    others = [k for k in range(len(matrix)) if k not in (i, j)]
    pair = matrix[np.ix_(others, (i, j))]
    other_matrix = matrix[np.ix_(others, others)]
    if others and np.linalg.eigvalsh(other_matrix)[0] <= 0:
        return None
    explained = pair.T @ np.linalg.solve(other_matrix, pair)
    residual_variances = 1 - np.diag(explained)
    if (residual_variances <= 0).any():
        return None
    half_width = math.sqrt(float(residual_variances.prod()))
    return float(explained[0, 1]) - half_width, float(explained[0, 1]) + half_width


@lru_cache(maxsize=1024)
def covariance_of(first: Law, second: Law, correlation: float) -> float:
    """Return the covariance of two components whose normal scores are correlated.

    Normal, uniform (6/π asin(ρ/2), Pearson 1907) and lognormal pairs have closed forms. For other pairs it is the
    double integral of g_1(x) g_2(y) against the bivariate normal density, with g_i = F_i⁻¹ ∘ Φ, by composite
    Gauss-Legendre quadrature. Panels are split at jumps and kinks of a law and are no wider than the density's ridge.
    The error is below 1e-9 of the product of the standard deviations.
    """
    if correlation == 0:
        return 0.0
    closed_form = first.covariance_with(second, correlation)
    if closed_form is not None:
        return closed_form
    # a normal law goes first: its integral is cheaper
    for law, other in sorted(((first, second), (second, first)), key=lambda pair: not pair[0].is_normal):
        integral = law.covariance_by_scores(correlation, partial(_nodes_beyond, other))
        if integral is not None:
            return integral
    width = math.sqrt((1 - correlation) * (1 + correlation))
    x, outer = _nodes(first, width, _REACH)
    y, inner = _nodes(second, width, _REACH)
    # exponent of the density of y given x; exp(y²/2) removes the normal density that _nodes multiplied in
    inner = inner * np.exp(y**2 / 2) / width
    total = 0.0
    for first_row in range(0, x.size, _ROWS):
        rows = slice(first_row, first_row + _ROWS)
        middle = correlation * x[rows]
        near = slice(*np.searchsorted(y, [middle.min() - _REACH * width, middle.max() + _REACH * width]).tolist())
        ridge = np.exp(-(((y[near] - middle[:, None]) / width) ** 2) / 2)
        total += float(outer[rows] @ (ridge * inner[near]).sum(axis=1))
    return total


def _nodes_beyond(law: Law, distance: float) -> tuple[Array, Array]:
    return _nodes(law, 1.0, _REACH + distance)


def _nodes(law: Law, width: float, limit: float) -> tuple[Array, Array]:
    """Return normal scores in ascending order, and (value - mean) × density × weight at each."""
    # panels are split at jumps and kinks of the law, and no wider than `width` or 1
    count = math.ceil(2 * limit / min(width, 1.0))
    bends = lazy_special.ndtri(np.array(law.breaks, dtype=float))
    edges = np.unique(np.concatenate([np.linspace(-limit, limit, count + 1), bends[np.abs(bends) < limit]]))
    begin, length = edges[:-1], np.diff(edges)
    nodes, weights = [], []
    for points, shares, shortest, longest in _RULES:
        is_covered = (length > shortest * width) & (length <= longest * width)
        nodes.append((begin[is_covered, None] + length[is_covered, None] * (points + 1) / 2).ravel())
        weights.append((length[is_covered, None] * shares / 2).ravel())
    z, weight = np.concatenate(nodes), np.concatenate(weights)
    order = np.argsort(z, kind="stable")
    z, weight = z[order], weight[order]
    deviation = law.at_scores(z[None])[0] - law.mean_vector[0]
    return z, deviation * weight * np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)


def check_correlations(draws: Sequence[Draw], correlations: Sequence[Correlation]) -> None:
    """Check that every correlation is between draws that can be correlated.

    Raises InputError for an unknown name, or a draw that is fixed, has several components or a different scope, or is
    in two correlations.
    """
    draws_by_name = {draw.name: draw for draw in draws}
    correlated: set[str] = set()
    for correlation in correlations:
        for name in correlation.names:
            if name not in draws_by_name:
                if owner := next((draw.name for draw in draws if name in draw.components), None):
                    raise InputError(
                        f"{name!r} is one of the several numbers of {owner!r}; a correlation is between draws of one number"
                    )
                raise UnknownNameError(
                    "parameter", name, (draw.name for draw in draws if draw.components == (draw.name,))
                )
            draw, first = draws_by_name[name], draws_by_name[correlation.names[0]]
            if draw.law.size != 1:
                raise InputError(
                    f"{name!r} draws {draw.law.size} numbers; a correlation is between draws of one number"
                )
            if draw.components != (name,):
                raise InputError(
                    f"the law of {name!r} is made for several numbers, though it has one here ({draw.components[0]!r}); "
                    "a correlation is between laws of one number, such as normal or empirical"
                )
            if not draw.law.streamed:
                raise InputError(f"{name!r} is fixed; it cannot be correlated")
            if draw.scope is not first.scope:
                raise InputError(
                    f"{first.name!r} is drawn for each {first.scope.value}, {name!r} for each {draw.scope.value}; "
                    "correlated draws must have one scope"
                )
            if name in correlated:
                raise InputError(f"{name!r} is in two correlations; put all that are correlated with it into one")
            correlated.add(name)
