"""The noise of readings: its covariance is made of one block for each station, and blocks of one size are computed together.

What all stations share is of low rank: R = D + W Wᵀ with the blocks D. With w = D^(-1/2) W in axes in which wᵀ w is diagonal, and
q² = 1 + wᵀ w, powers of I + w wᵀ are I less or plus ``w diag(c) wᵀ``: c = 1/(q (q + 1)) for -1/2, 1/(q + 1) for 1/2, 1/q² for -1.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array

LEVEL: Final = 0.95
"""Probability of the intervals, and of the ellipsoids that left-out readings should be within."""
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


class Common:
    """The common part of whitened numbers, ``w`` ``(M, k)``: their covariance is I + w wᵀ."""

    def __init__(self, factors: Array) -> None:
        values, vectors = np.linalg.eigh(factors.T @ factors)
        self._w, self._q = factors @ vectors, np.sqrt(1 + np.maximum(values, 0.0))

    def whiten(self, values: Array) -> Array:
        """Return ``(I + w wᵀ)^(-1/2)`` times numbers ``(M, …)``."""
        return values - (self._w / (self._q * (self._q + 1))) @ (self._w.T @ values)

    def colour(self, white: Array) -> Array:
        """Return ``(I + w wᵀ)^(1/2)`` times white numbers: the inverse of :meth:`whiten`."""
        return white + (self._w / (self._q + 1)) @ (self._w.T @ white)

    @property
    def precision_root(self) -> Array:
        """V ``(M, k)`` of ``(I + w wᵀ)⁻¹ = I - V Vᵀ``."""
        return np.asarray(self._w / self._q)


class Noise:
    """The covariance R of M numbers at stations, given for each block, ``(S, b, b)``, and common factors W ``(P, m, k)``.

    White numbers ``(M, …)`` have those of a station together, readings are ``(P, m, …)``.

    Raises:
        numpy.linalg.LinAlgError: R is singular to rounding.
    """

    def __init__(self, shape: tuple[int, ...], blocks: list[Block], covariances: list[Array], common: Array) -> None:
        self._shape, self._blocks, self._covariances, self._factors = shape, blocks, covariances, common
        self._roots = [np.asarray(np.linalg.cholesky(covariance), dtype=float) for covariance in covariances]

    @cached_property
    def covariances(self) -> tuple[Array, ...]:
        """Block of each station in D."""
        return self._by_station(self._covariances)

    @cached_property
    def roots(self) -> tuple[Array, ...]:
        """Lower triangular root of each station's block in D."""
        return self._by_station(self._roots)

    def _by_station(self, stacks: list[Array]) -> tuple[Array, ...]:
        order = np.argsort(np.concatenate([block.stations for block in self._blocks]))
        matrices = [matrix for stack in stacks for matrix in stack]
        return tuple(matrices[k] for k in order)

    def whiten(self, values: Array) -> Array:
        """Return ``R^(-1/2)`` times readings."""
        white = self._by_blocks(values)
        return white if self._common is None else self._common.whiten(white)

    def _by_blocks(self, values: Array) -> Array:
        """Return ``D^(-1/2)`` times readings."""
        white = np.empty((sum(block.white.size for block in self._blocks), *values.shape[2:]))
        for block, root in zip(self._blocks, self._roots, strict=True):
            of_block = values[block.places]
            white[block.white] = solve_lower(root, of_block.reshape(*block.white.shape, -1)).reshape(of_block.shape)
        return white

    @cached_property
    def _common(self) -> Common | None:
        return Common(self._by_blocks(self._factors)) if self._factors.shape[2] else None

    def colour(self, white: Array) -> Array:
        """Return ``R^(1/2)`` times white numbers, as readings: the inverse of :meth:`whiten`."""
        white = white if self._common is None else self._common.colour(white)
        values = np.zeros((*self._shape, *white.shape[1:]))
        for block, root in zip(self._blocks, self._roots, strict=True):
            values[block.places] = np.einsum("sij,sj...->si...", root, white[block.white])
        return values

    @cached_property
    def variances(self) -> Array:
        """Variance of each number, as readings; zero where none was read."""
        values = np.zeros(self._shape)
        for block, root in zip(self._blocks, self._roots, strict=True):
            values[block.places] = (root**2).sum(axis=2) + (self._factors[block.places] ** 2).sum(axis=-1)
        return values

    @cached_property
    def _inverse_roots(self) -> list[Array]:
        return [solve_lower(root, np.broadcast_to(np.eye(root.shape[1]), root.shape)) for root in self._roots]

    def pull(self, white: Array) -> Array:
        """Return ``R^(-1/2)ᵀ`` times white numbers, ``(M, …)``."""
        return self._pull_by_blocks(white if self._common is None else self._common.whiten(white))

    def _pull_by_blocks(self, white: Array) -> Array:
        """Return ``D^(-1/2)ᵀ`` times white numbers."""
        result = np.empty_like(white)
        for block, inverse in zip(self._blocks, self._inverse_roots, strict=True):
            result[block.white] = np.einsum("sji,sj...->si...", inverse, white[block.white])
        return result

    @property
    def precision_root(self) -> Array:
        """V ``(M, k)`` of ``R⁻¹ = D⁻¹ - V Vᵀ``."""
        count = sum(block.white.size for block in self._blocks)
        return np.zeros((count, 0)) if self._common is None else self._pull_by_blocks(self._common.precision_root)

    @property
    def precision(self) -> Precision:
        """The inverse of D."""
        count = sum(block.white.size for block in self._blocks)
        rows = np.zeros((count, max(block.white.shape[1] for block in self._blocks)))
        result = Precision(rows, np.empty(count, dtype=np.intp), np.empty(count, dtype=np.intp))
        for block, inverse in zip(self._blocks, self._inverse_roots, strict=True):
            size = inverse.shape[1]
            result.rows[block.white, :size] = inverse.swapaxes(1, 2) @ inverse
            result.place[block.white], result.station[block.white] = np.arange(size), block.stations[:, None]
        return result


def solve_lower(roots: Array, values: Array) -> Array:
    """Return ``root⁻¹ values`` for lower triangular roots ``(S, b, b)`` and values ``(S, b, n)``."""
    result = np.empty_like(values)
    for k in range(roots.shape[1]):
        above = np.einsum("sj,sjn->sn", roots[:, k, :k], result[:, :k])
        result[:, k] = (values[:, k] - above) / roots[:, k, k, None]
    return result
