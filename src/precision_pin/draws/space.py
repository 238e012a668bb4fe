"""The space of random numbers: draws, their scopes and the stream of each number.

A sample is (unit, pose, visit). Columns are in the order of the draws; the numbers depend on names only, so that adding
or reordering draws changes no other draw.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arguments import check_items, check_memory, check_name, check_number, check_numbers, check_whole
from precision_pin.base.arrays import Array, returns_read_only
from precision_pin.base.errors import InputError
from precision_pin.draws import lazy_special, philox
from precision_pin.draws.correlation import BlockCovariance, Correlation, check_correlations, covariance_of
from precision_pin.draws.draw import MOST_POSES, MOST_VISITS, Draw, Scope, Setting, occasion
from precision_pin.draws.expressions import Component, Expression, Value
from precision_pin.draws.laws import Law

_UNCHECKED: Final = 2**28
"""Bytes below which free memory is not checked: the check would take longer than the sampling."""
_TOGETHER: Final = 2**14
"""Numbers made together; arrays of more leave the processor's cache."""


@final
@dataclass(frozen=True)
class Space:
    """Draws in column order, and their correlations.

    Attributes:
        draws: In column order.
        correlations: Each is between draws of one number with one scope; a draw is in at most one. The random numbers
            depend on names only: neither other draws nor any order changes them.

    Raises:
        InputError: Two different draws, or a draw and a component of another, share a name; or
            :func:`~precision_pin.draws.correlation.check_correlations` refuses a correlation.
    """

    draws: tuple[Draw, ...] = ()
    correlations: tuple[Correlation, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "draws", check_items("the draws of a space", self.draws, Draw))
        correlations = check_items("the correlations of a space", self.correlations, Correlation)
        object.__setattr__(self, "correlations", correlations)
        names: set[str] = set()
        for draw in self.draws:
            _claim_names(draw, names)
        check_correlations(self.draws, correlations)

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Names of the d numbers, in column order."""
        return tuple(name for draw in self.draws for name in draw.components)

    @cached_property
    def index(self) -> dict[str, int]:
        """Column of each component."""
        return {name: k for k, name in enumerate(self.components)}

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Columns of each draw."""
        ends = np.cumsum([0, *(draw.law.size for draw in self.draws)])
        return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))

    @cached_property
    def streams(self) -> tuple[int, ...]:
        """32-bit stream of each component."""
        streams = philox.streams_of(self.components)
        return tuple(streams[name] for name in self.components)

    @property
    def size(self) -> int:
        """Number of components, d."""
        return len(self.components)

    @cached_property
    @returns_read_only
    def mean(self) -> Array:
        """Mean of the components, ``(d,)``."""
        return np.concatenate([np.zeros(0), *(draw.law.mean_vector for draw in self.draws)])

    @cached_property
    def block_covariance(self) -> BlockCovariance:
        """Covariance of the components, in blocks of dependent ones."""
        found = [draw.covariance for draw in self.draws]
        variances = np.concatenate([np.zeros(0), *map(np.diag, found)])
        blocks = [
            (np.arange(columns.start, columns.stop), matrix)
            for matrix, columns in zip(found, self.slices, strict=True)
            if len(matrix) > 1
        ]
        laws = {draw.name: draw.law for draw in self.draws} if self.correlations else {}
        for correlation in self.correlations:
            columns = np.array([self.index[name] for name in correlation.names])
            matrix = np.diag(variances[columns])
            for (i, a), (j, b) in itertools.combinations(enumerate(correlation.names), 2):
                matrix[i, j] = matrix[j, i] = covariance_of(laws[a], laws[b], correlation.matrix[i][j])
            blocks.append((columns, matrix))
        return BlockCovariance(variances, tuple(blocks))

    @cached_property
    @returns_read_only
    def covariance(self) -> Array:
        """Covariance of the components, ``(d, d)``.

        Raises:
            InputError: The matrix would not fit into memory.
        """
        self._check_matrix_memory("covariance")
        return self.block_covariance.dense

    @cached_property
    @returns_read_only
    def pearson(self) -> Array:
        """Pearson correlation of the components, ``(d, d)``; off the diagonal 0 if one does not vary.

        Raises:
            InputError: The matrix would not fit into memory.
        """
        self._check_matrix_memory("correlation")
        return self.pearson_within(range(self.size))

    def pearson_within(self, columns: Sequence[int]) -> Array:
        """Return the Pearson correlation of some components, ``(n, n)``; see :attr:`pearson`."""
        covariance = self.block_covariance.within(columns)
        std = np.sqrt(np.diag(covariance))
        unit = np.where(std > 0, std, 1.0)
        matrix: Array = covariance / np.outer(unit, unit)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    def _check_matrix_memory(self, what: str) -> None:
        check_memory(24.0 * self.size**2, f"the {what} of {self.size:,} numbers", "use block_covariance instead")

    @cached_property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Bounds of each component in every sample; see :meth:`precision_pin.draws.laws.Law.interval`."""
        return tuple(draw.law.interval(k) for draw in self.draws for k in range(draw.law.size))

    def including(self, draws: Sequence[Draw]) -> Space:
        """Return the space with further draws; a draw equal to one of the space is shared."""
        extension = Extension(self)
        extension.add(check_items("the draws", draws, Draw))
        return extension.space()

    def parameter(self, name: str) -> Component:
        """Return the component of a name.

        Raises:
            UnknownNameError: There is no such component.
        """
        return Component(check_name("parameter", name, self.index))

    def sample(self, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0) -> Array:
        """Return the numbers ``(d, count)`` of units ``first … first + count - 1``.

        They are numbered as docs/reproducibility.md says: see :mod:`precision_pin.draws.philox` for the uniforms;
        normal numbers are Box-Muller of a pair (cosine for the even unit, sine for the odd).

        Args:
            seed: 64-bit seed.
            first, count: The units.
            pose, visit: The pose and the visit, 0-based.

        Raises:
            InputError: A seed, unit, pose or visit out of range.
        """
        check_seed(seed)
        seed = int(seed)
        first = check_whole("first, the index of a unit,", first, 0, 2**64 - 1, "from 0 to 2^64 - 1")
        count = check_whole("count", count, 0, 2**64 - first, "of units, the last of them 2^64 - 1 or below")
        check_whole("the pose", pose, 0, MOST_POSES - 1)
        check_whole("the visit", visit, 0, MOST_VISITS - 1)
        self._check_sample_memory(count)
        units = philox.Units(seed, first, count)
        x = np.empty((self.size, count))
        alike: dict[tuple[str, Scope], list[tuple[Law, slice]]] = {}
        for draw, rows in zip(self.draws, self.slices, strict=True):
            if not draw.law.streamed:
                x[rows] = draw.law.mean_vector[:, None]
            elif draw.name not in self._correlated_draws:
                alike.setdefault((draw.law.variates, draw.scope), []).append((draw.law, rows))
        for (variates, scope), listed in alike.items():
            word, make = occasion(scope, pose, visit), units.normals if variates == "normal" else units.uniforms
            step = max(1, _TOGETHER // max(count, 1))
            for laws in (listed[k : k + step] for k in range(0, len(listed), step)):
                made = make([stream for _, rows in laws for stream in self.streams[rows]], word)
                for law, rows in laws:
                    x[rows], made = law.sample(made[: law.size]), made[law.size :]
        for correlation in self.correlations:
            columns = [self.index[name] for name in correlation.names]
            word = occasion(self._correlated_draws[correlation.names[0]].scope, pose, visit)
            self._set_correlated(correlation, units.normals([self.streams[column] for column in columns], word), x)
        return x

    def inverse(self, uniforms: ArrayLike) -> Array:
        """Return the numbers ``(d, N)`` for uniform numbers ``(d, N)``, by the inverse of each law."""
        # large and only read: not copied if already an array
        u = (
            uniforms
            if type(uniforms) is np.ndarray and uniforms.dtype == np.float64
            else check_numbers("uniforms", uniforms)
        )
        if u.ndim != 2 or len(u) != self.size:
            raise InputError(f"uniforms of shape {u.shape}, expected ({self.size}, N)")
        self._check_sample_memory(u.shape[1])
        if u.size and not (u.min() > 0 and u.max() < 1):
            raise InputError("uniforms must lie above 0 and below 1")
        x = np.empty_like(u)
        for draw, rows in zip(self.draws, self.slices, strict=True):
            x[rows] = draw.law.inverse(u[rows])
        for correlation in self.correlations:
            self._set_correlated(
                correlation, lazy_special.ndtri(u[[self.index[name] for name in correlation.names]]), x
            )
        return x

    def _check_sample_memory(self, count: int) -> None:
        needed = 24.0 * self.size * count  # the numbers, and the uniforms they are made from
        if needed > _UNCHECKED:
            check_memory(needed, f"sampling {self.size:,} numbers {count:,} times at once", "sample a part at a time")

    @cached_property
    def _correlated_draws(self) -> dict[str, Draw]:
        names = {name for correlation in self.correlations for name in correlation.names}
        return {draw.name: draw for draw in self.draws if draw.name in names}

    def _set_correlated(self, correlation: Correlation, normals: Array, x: Array) -> None:
        """Set the rows of correlated draws in ``x`` from independent normal numbers."""
        for name, scores in zip(correlation.names, correlation.mix(normals), strict=True):
            x[self.index[name]] = self._correlated_draws[name].law.at_scores(scores[None])[0]


def _claim_names(draw: Draw, taken: set[str]) -> None:
    own = {draw.name, *draw.components}
    for name in own:
        if name in taken or not name:
            raise InputError(f"two random numbers are named {name!r}; every draw needs a name of its own")
    taken |= own


@final
class Extension:
    """Further draws for a space, added group by group; a refused group adds nothing."""

    def __init__(self, space: Space) -> None:
        self._correlations = space.correlations
        self._known = {draw.name: draw for draw in space.draws}
        self._taken = {name for draw in space.draws for name in (draw.name, *draw.components)}

    def add(self, draws: Iterable[Draw]) -> None:
        """Add draws; a draw equal to a known one is shared.

        Raises:
            InputError: A different draw has the name, or it is a component of another draw; none of the draws is added.
        """
        added: dict[str, Draw] = {}
        names: set[str] = set()
        for draw in draws:
            known = self._known.get(draw.name) or added.get(draw.name)
            if known is None:
                _claim_names(draw, names)
                added[draw.name] = draw
            elif known != draw:
                raise InputError(f"the draw {draw.name!r} is given twice with different laws or scopes")
        shared = sorted(names & self._taken)
        if shared:
            raise InputError(f"two random numbers are named {shared[0]!r}; every draw needs a name of its own")
        self._known |= added
        self._taken |= names

    def space(self) -> Space:
        """Return the extended space."""
        return Space(tuple(self._known.values()), self._correlations)


def check_seed(seed: int) -> None:
    """Raise InputError unless a seed is in 0 … 2⁶⁴-1."""
    check_whole("the seed", seed, 0, 2**64 - 1, "from 0 to 2^64 - 1")


_SETTING: Final = "a finite number, the name of a parameter, a law, a draw or a formula"


@final
@dataclass(frozen=True)
class LabelledSpace:
    """The space of one source with label ``kind[subject]``: turns its settings into numbers and expressions."""

    space: Space
    label: str

    def value(self, field: str, setting: Setting) -> Value:
        """Return a setting as a number or an expression; an unnamed law is the draw ``label.field``.

        Raises UnknownNameError for the name of a parameter that does not exist.
        """
        match setting:
            case Expression():
                return setting
            case str():
                return self.space.parameter(setting)
            case Draw(name=name):
                return self.space.parameter(name or f"{self.label}.{field}")
            case Law():
                return self.space.parameter(f"{self.label}.{field}")
            case _:
                return check_number(f"{field} of {self.label}", setting, _SETTING)

    def positive(self, field: str, setting: Setting, *, zero: bool = False) -> Value:
        """Return a setting that must be positive (or zero, if allowed) in every sample; see :meth:`value`.

        Raises InputError if the number, or the lower end of the law's support, is too low. A normal law's mean must lie
        8.6 standard deviations above zero, farther than any sample from it.
        """
        value = self.value(field, setting)
        lowest = self._lowest(value)
        if lowest < 0 or (lowest == 0 and not zero):
            what = "negative" if zero else "zero or negative"
            raise InputError(
                f"{field} of {self.label} can become {what} (as low as {lowest:.6g}); narrow or truncate its law"
            )
        return value

    def _lowest(self, value: Value) -> float:
        """Return the lowest value of a setting in any sample; infinity for a formula, whose range is not checked."""
        if not isinstance(value, Expression):
            return value
        if not isinstance(value, Component):
            return math.inf
        return self.space.intervals[self.space.index[value.name]][0]

    def values(self, field: str, settings: Sequence[Setting]) -> tuple[Value, ...]:
        """Return several settings of one field, named ``field``, ``field[1]``, ``field[2]``, …."""
        return tuple(self.value(entry_name(field, k), setting) for k, setting in enumerate(settings))

    def component(self, name: str) -> Component:
        """Return a component of one of the source's own draws, ``label.name``."""
        return self.space.parameter(f"{self.label}.{name}")


def entry_name(field: str, k: int) -> str:
    """Return the name of the k-th of several values of a field: ``field``, ``field[1]``, ``field[2]``, …."""
    return field if k == 0 else f"{field}[{k}]"
