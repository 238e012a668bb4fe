"""The noise of readings apart from what they share: one block for each station, and blocks of one size are computed together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array

LEVEL: Final = 0.95
"""Probability of the intervals, and of the ellipsoids that left-out readings should be within."""
_AT_ONCE: Final = 512
"""Numbers that are reduced at once, at least."""
_ALONE: Final = 1e-9
"""Fraction of a group's readings left free by the others, below which the group alone determines a combination."""
Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns in readings ``(P, m)``."""


class Block(NamedTuple):
    """Stations ``(S,)`` where b numbers are read, and of these the place in the readings and the whitened row, ``(S, b)``."""

    stations: NDArray[np.intp]
    places: Places
    white: NDArray[np.intp]


def blocks_of(places: Sequence[Places]) -> list[Block]:
    """Return the stations by how many numbers are read there, for the places of these numbers."""
    sizes = np.array([len(rows) for rows, _ in places])
    starts, blocks = np.cumsum(sizes) - sizes, []
    for size in np.unique(sizes).tolist():
        stations = np.flatnonzero(sizes == size)
        rows, columns = np.array([places[k] for k in stations.tolist()]).swapaxes(0, 1)
        blocks.append(Block(stations, (rows, columns), starts[stations, None] + np.arange(size)))
    return blocks


class Precision(NamedTuple):
    """The inverse of D: its rows within stations ``(M, b)``, and place within its station and station of each, ``(M,)``."""

    rows: Array
    place: NDArray[np.intp]
    station: NDArray[np.intp]


class Noise:
    """The covariance D of M numbers at stations, given for each block, ``(S, b, b)``.

    White numbers ``(M, …)`` have those of a station together, readings are ``(R, m, …)``.

    Raises:
        numpy.linalg.LinAlgError: D is singular to rounding.
    """

    def __init__(self, blocks: list[Block], covariances: list[Array]) -> None:
        self._blocks, self._covariances = blocks, covariances
        self._roots = [np.asarray(np.linalg.cholesky(covariance), dtype=float) for covariance in covariances]
        self._count = sum(block.white.size for block in blocks)

    @property
    def covariances(self) -> tuple[Array, ...]:
        """Block of each station in D."""
        order = np.argsort(np.concatenate([block.stations for block in self._blocks]))
        matrices = [matrix for stack in self._covariances for matrix in stack]
        return tuple(matrices[k] for k in order)

    def whiten(self, values: Array) -> Array:
        """Return ``D^(-1/2)`` times readings."""
        white = np.empty((self._count, *values.shape[2:]))
        for block, root in zip(self._blocks, self._roots, strict=True):
            of_block = values[block.places]
            white[block.white] = solve_lower(root, of_block.reshape(*block.white.shape, -1)).reshape(of_block.shape)
        return white

    @property
    def variances(self) -> Array:
        """Variance of each number, ``(M,)``."""
        values = np.empty(self._count)
        for block, covariance in zip(self._blocks, self._covariances, strict=True):
            values[block.white] = np.diagonal(covariance, axis1=1, axis2=2)
        return values

    @cached_property
    def _inverse_roots(self) -> list[Array]:
        return [solve_lower(root, np.broadcast_to(np.eye(root.shape[1]), root.shape)) for root in self._roots]

    def pull(self, white: Array) -> Array:
        """Return ``D^(-1/2)ᵀ`` times white numbers, ``(M, …)``."""
        result = np.empty_like(white)
        for block, inverse in zip(self._blocks, self._inverse_roots, strict=True):
            result[block.white] = np.einsum("sji,sj...->si...", inverse, white[block.white])
        return result

    @property
    def precision(self) -> Precision:
        """The inverse of D."""
        rows = np.zeros((self._count, max(block.white.shape[1] for block in self._blocks)))
        result = Precision(rows, np.empty(self._count, dtype=np.intp), np.empty(self._count, dtype=np.intp))
        for block, inverse in zip(self._blocks, self._inverse_roots, strict=True):
            size = inverse.shape[1]
            result.rows[block.white, :size] = inverse.swapaxes(1, 2) @ inverse
            result.place[block.white], result.station[block.white] = np.arange(size), block.stations[:, None]
        return result


class Reduction(NamedTuple):
    """Whitened columns ``[W | N | Z | … | y]`` of M numbers, reduced to the triangle of their QR factors.

    W ``(M, w)`` are what the numbers share, times independent variables of unit variance. These are eliminated: products of the
    other columns are those with ``(I + W Wᵀ)⁻¹`` between. Numbers in chunks need the memory of one chunk, and keep the digits
    that normal equations would lose.

    Attributes:
        rows: The reduced columns after W, ``(R, c)``, with R at most c.
        nuisances: How many of them are N; the last one is y.
        shared, coupling: Triangle ``(w, w)`` of W over its unit prior, and the rows ``(w, c)`` beside it.
        size: M.
    """

    rows: Array
    nuisances: int
    shared: Array
    coupling: Array
    size: int

    @classmethod
    def of(cls, chunks: Iterable[Array], shared: int, nuisances: int) -> Reduction:
        """Return the reduction of columns that come in chunks ``(m, w + c)``."""
        triangle, pending, size = np.zeros((0, 0)), list[Array](), 0
        for chunk in chunks:
            triangle = triangle if size else np.eye(shared, chunk.shape[1])
            pending.append(chunk)
            size += len(chunk)
            if sum(map(len, pending)) >= _AT_ONCE:
                triangle, pending = np.asarray(np.linalg.qr(np.vstack([triangle, *pending]), mode="r")), []
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, *pending]), mode="r"))
        first, others = np.split(triangle, [shared])
        return cls(others[:, shared:], nuisances, first[:, :shared], first[:, shared:], size)

    @property
    def by_nuisance(self) -> Array:
        """The columns N."""
        return self.rows[:, : self.nuisances]

    @property
    def white(self) -> Array:
        """The column y."""
        return self.rows[:, -1]

    def only(self, columns: NDArray[np.intp]) -> Reduction:
        """Return some of the columns after W, and y."""
        return self._replace(
            rows=self.rows[:, [*columns.tolist(), -1]], coupling=self.coupling[:, [*columns.tolist(), -1]]
        )

    def over(self, coefficients: Array) -> Array:
        """Return ``(w + c, w + n)`` with which whitened columns ``[W | N | …]`` are Q of ``(I + W Wᵀ)⁻¹ - Q Qᵀ``.

        Of this Q the first are of W, and then ``(I + W Wᵀ)⁻¹ [N | …]`` times ``coefficients``, ``(c, n)``.
        """
        inverse, size = np.linalg.inv(self.shared), len(coefficients)
        top = np.hstack([inverse, -inverse @ self.coupling[:, :size] @ coefficients])
        return np.vstack([top, np.hstack([np.zeros((size, len(inverse))), coefficients])])


class SmallGroups(NamedTuple):
    """Covariances ``(G, g, g)`` of left-out groups, and whether the others determine all of each, ``(G,)``."""

    covariances: Array
    is_determined: NDArray[np.bool_]

    @classmethod
    def of(cls, precision: Precision, cells: NDArray[np.intp], through: Array) -> SmallGroups:
        """Return the inverse of D⁻¹ - T Tᵀ of numbers ``(G, g)``, for their rows of T."""
        rows, place, station = precision.rows, precision.place[cells], precision.station[cells]
        blocks = np.where(station[:, :, None] == station[:, None], rows[cells[:, :, None], place[:, None]], 0.0)
        # scaled to each component's precision, since lengths and angles are mixed
        scale = np.sqrt(np.diagonal(blocks, axis1=1, axis2=2))
        scaled = (blocks - through @ through.swapaxes(1, 2)) / (scale[:, :, None] * scale[:, None])
        values, vectors = np.linalg.eigh(scaled)
        # what a group alone determines has no residual
        is_determined = values > _ALONE
        vectors = vectors * is_determined[:, None] / scale[:, :, None]
        covariances = (vectors / np.where(is_determined, values, 1.0)[:, None]) @ vectors.swapaxes(1, 2)
        return cls(covariances, np.asarray(is_determined.all(axis=1)))

    def times(self, values: Array) -> Array:
        """Return the covariances times values ``(G, g, n)``."""
        return self.covariances @ values

    @property
    def variances(self) -> Array:
        """Variance of each number, ``(G, g)``."""
        return np.diagonal(self.covariances, axis1=1, axis2=2)

    def block(self, numbers: NDArray[np.intp]) -> Array:
        """Return the covariances of some numbers of one reading, ``(G, m, m)``."""
        return self.covariances[:, numbers[:, None], numbers]


class LargeGroup(NamedTuple):
    """The same of one group of many numbers, by the columns of T: ``B + X diag(a) Xᵀ``.

    B is the inverse of the group's part of D⁻¹, blocks ``(S, b, b)`` at stations, of numbers at ``places`` ``(S, b)``;
    ``used`` are those that are no padding. X is ``(g, c)``, a ``(c,)``.
    """

    blocks: Array
    places: NDArray[np.intp]
    used: NDArray[np.bool_]
    factors: Array
    weights: Array
    is_determined: NDArray[np.bool_]

    @classmethod
    def of(cls, precision: Precision, cells: NDArray[np.intp], through: Array) -> LargeGroup:
        """Return the inverse of D⁻¹ - T Tᵀ of numbers ``(1, g)``: with ``Bᵀᐟ² T = U s Vᵀ`` it has ``1 - s²`` along U, else 1."""
        starts = np.flatnonzero(np.diff(precision.station[cells[0]], prepend=-1))
        sizes = np.diff(starts, append=cells.shape[1])
        steps = np.arange(sizes.max())
        used = steps < sizes[:, None]
        places = np.where(used, starts[:, None] + steps, 0)
        numbers = cells[0][places]
        rows = precision.rows[numbers[:, :, None], precision.place[numbers][:, None]]
        blocks = np.linalg.inv(np.where(used[:, :, None] & used[:, None], rows, np.eye(steps.size)))
        roots, empty = np.asarray(np.linalg.cholesky(blocks), dtype=float), np.zeros((cells.shape[1], 0))
        plain = cls(blocks, places, used, empty, np.zeros(0), np.ones(1, dtype=bool))
        white = plain.by_blocks(roots.swapaxes(1, 2), through[0])
        squares, vectors = np.linalg.eigh(white.T @ white)
        is_determined = 1 - squares > _ALONE
        weights = np.where(is_determined, 1 / np.where(is_determined, 1 - squares, 1.0), -1 / np.maximum(squares, 0.5))
        factors = plain.by_blocks(roots, white @ vectors)
        return plain._replace(factors=factors, weights=weights, is_determined=np.array([is_determined.all()]))

    def by_blocks(self, matrices: Array, values: Array) -> Array:
        """Return a matrix ``(b, b)`` of each station times its values, of ``(g, n)``."""
        result = np.empty_like(values)
        result[self.places[self.used]] = (matrices @ (values[self.places] * self.used[:, :, None]))[self.used]
        return result

    def times(self, values: Array) -> Array:
        """Return the covariance times values ``(1, g, n)``."""
        through = self.factors @ (self.weights[:, None] * (self.factors.T @ values[0]))
        return (self.by_blocks(self.blocks, values[0]) + through)[None]

    @property
    def variances(self) -> Array:
        """Variance of each number, ``(1, g)``."""
        result = self.factors**2 @ self.weights
        result[self.places[self.used]] += np.diagonal(self.blocks, axis1=1, axis2=2)[self.used]
        return np.maximum(result, 0.0)[None]

    def block(self, numbers: NDArray[np.intp]) -> Array:
        """Return the covariance of some numbers of one reading, ``(1, m, m)``."""
        station = int(np.searchsorted(self.places[:, 0], numbers[0], side="right")) - 1
        at, factors = numbers - self.places[station, 0], self.factors[numbers]
        return (self.blocks[station][at[:, None], at] + self.weights * factors @ factors.T)[None]


def solve_lower(roots: Array, values: Array) -> Array:
    """Return ``root⁻¹ values`` for lower triangular roots ``(S, b, b)`` and values ``(S, b, n)``."""
    result = np.empty_like(values)
    for k in range(roots.shape[1]):
        above = np.einsum("sj,sjn->sn", roots[:, k, :k], result[:, :k])
        result[:, k] = (values[:, k] - above) / roots[:, k, k, None]
    return result
