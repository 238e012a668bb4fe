"""The space of random components: draws, their scopes and the stream of each component.

A sample is (unit, pose, visit). Columns are in the order of the draws; values depend on names only, so that adding or
reordering draws changes no other draw.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_items, check_memory, check_name, check_number, check_numbers, check_whole
from precision_pin.base.arrays import Array, returns_read_only
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special, philox
from precision_pin.draws.correlation import BlockCovariance, Correlation, check_correlations, covariance_of
from precision_pin.draws.draw import MOST_POSES, MOST_VISITS, Draw, Scope, Setting, occasion
from precision_pin.draws.expressions import Component, Expression, Value
from precision_pin.draws.laws import JointNormal, Law
from precision_pin.draws.laws.law import write_number

_UNCHECKED: Final = 2**28
"""Bytes below which free memory is not checked: 256 MiB fit on any machine, and the check takes almost 1 ms."""
_TOGETHER: Final = 2**14
"""Random numbers generated together; larger arrays exceed the processor's cache."""


@dataclass(frozen=True)
class Space:
    """Draws in column order, and their correlations.

    Attributes:
        draws: In column order.
        correlations: Each is between draws of one component with equal scope; a draw is in at most one. Values depend
            on names only: neither other draws nor any order changes them.

    Raises:
        InputError: Two different draws, or a draw and a component of another, share a name; or
            :func:`~precision_pin.draws.correlation.check_correlations` rejects a correlation.

    Examples:
        >>> space = pp.Space((pp.Draw("pin", pp.Disc(2.0)), pp.Draw("gap", pp.Uniform(3.0))))
        >>> print(space.components, space.sample(seed=0, first=0, count=5).shape)
        ('pin.x', 'pin.y', 'gap') (3, 5)
        >>> print(space.covariance)
        [[1. 0. 0.]
         [0. 1. 0.]
         [0. 0. 3.]]
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
        """Names of the d components, in column order."""
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

    def has_scope(self, *scopes: Scope) -> NDArray[np.bool_]:
        """Return whether each component is drawn for one of some scopes, ``(d,)``."""
        chosen = np.array([draw.scope in scopes for draw in self.draws], dtype=np.bool_)
        return np.repeat(chosen, [draw.law.size for draw in self.draws])

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
        """Covariance of the components, in blocks of dependent components."""
        covariances = [draw.covariance for draw in self.draws]
        variances = np.concatenate([np.zeros(0), *map(np.diag, covariances)])
        blocks = [
            (np.arange(columns.start, columns.stop), matrix)
            for matrix, columns in zip(covariances, self.slices, strict=True)
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
        """Pearson correlation of the components, ``(d, d)``; 0 off the diagonal for components that do not vary.

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

    def quantity_and_mean(self, name: str) -> tuple[Quantity | None, float]:
        """Return the quantity of a component, None if unknown, and its mean."""
        draw = next(draw for draw in self.draws if name in draw.components)
        k = draw.components.index(name)
        return draw.known_quantities[k], float(draw.law.mean_vector[k])

    def sample(self, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0) -> Array:
        """Return the components ``(d, count)`` of units ``first … first + count - 1``.

        Numbering as in docs/reproducibility.md: see :mod:`precision_pin.draws.philox` for the uniforms; normal numbers
        are Box-Muller of a pair (cosine for the even unit, sine for the odd).

        Args:
            seed: 64-bit seed.
            first, count: The units.
            pose, visit: The pose and the visit, 0-based.

        Raises:
            InputError: A seed, unit, pose or visit out of range.
        """
        seed = check_seed(seed)
        first = check_whole("first, the index of a unit,", first, 0, 2**64 - 1, "from 0 to 2^64 - 1")
        count = check_whole("count", count, 0, 2**64 - first, "of units, the last of them 2^64 - 1 or below")
        check_whole("the pose", pose, 0, MOST_POSES - 1)
        check_whole("the visit", visit, 0, MOST_VISITS - 1)
        self._check_sample_memory(count)
        units = philox.Units(seed, first, count)
        x = np.empty((self.size, count))
        groups: dict[tuple[str, Scope], list[tuple[Law, slice]]] = {}
        for draw, rows in zip(self.draws, self.slices, strict=True):
            if not draw.law.streamed:
                x[rows] = draw.law.mean_vector[:, None]
            elif draw.name not in self._correlated_draws:
                groups.setdefault((draw.law.variates, draw.scope), []).append((draw.law, rows))
        for (variates, scope), members in groups.items():
            word, make = occasion(scope, pose, visit), units.normals if variates == "normal" else units.uniforms
            step = max(1, _TOGETHER // max(count, 1))
            for laws in (members[k : k + step] for k in range(0, len(members), step)):
                base_variates = make([stream for _, rows in laws for stream in self.streams[rows]], word)
                for law, rows in laws:
                    x[rows], base_variates = law.sample(base_variates[: law.size]), base_variates[law.size :]
        for correlation in self.correlations:
            columns = [self.index[name] for name in correlation.names]
            word = occasion(self._correlated_draws[correlation.names[0]].scope, pose, visit)
            self._set_correlated(correlation, units.normals([self.streams[column] for column in columns], word), x)
        return x

    def inverse(self, uniforms: ArrayLike) -> Array:
        """Return the components ``(d, N)`` for uniform numbers ``(d, N)``, by the inverse of each law."""
        # large and only read: not copied if already an array
        is_array = type(uniforms) is np.ndarray and uniforms.dtype == np.float64
        u = cast("Array", uniforms) if is_array else check_numbers("uniforms", uniforms)
        if u.ndim != 2 or len(u) != self.size:
            raise InputError(f"uniforms of shape {u.shape}, expected ({self.size}, N)")
        self._check_sample_memory(u.shape[1])
        if u.size and not (u.min() > 0 and u.max() < 1):
            raise InputError("uniforms must lie above 0 and below 1")
        x = np.empty_like(u)
        for draw, rows in zip(self.draws, self.slices, strict=True):
            x[rows] = draw.law.inverse(u[rows])
        for correlation in self.correlations:
            independent = u[[self.index[name] for name in correlation.names]]
            self._set_correlated(correlation, lazy_special.ndtri(independent), x)
        return x

    def _check_sample_memory(self, count: int) -> None:
        needed = 24.0 * self.size * count  # the components, and the variates from which they are computed
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


def _claim_names(draw: Draw, used_names: set[str]) -> None:
    draw_names = {draw.name, *draw.components}
    for name in draw_names:
        if name in used_names or not name:
            raise InputError(f"two random numbers are named {name!r}; every draw needs a unique name")
    used_names |= draw_names


class Extension:
    """Further draws for a space, added group by group; a rejected group adds nothing."""

    def __init__(self, space: Space) -> None:
        self._correlations = space.correlations
        self._known = {draw.name: draw for draw in space.draws}
        self._taken = {name for draw in space.draws for name in (draw.name, *draw.components)}

    def add(self, draws: Iterable[Draw]) -> None:
        """Add draws; a draw equal to a known one is shared.

        Raises:
            InputError: A different draw has the name, or it is a component of another draw; none of the draws is added.
        """
        new_draws: dict[str, Draw] = {}
        names: set[str] = set()
        for draw in draws:
            existing = self._known.get(draw.name) or new_draws.get(draw.name)
            if existing is None:
                _claim_names(draw, names)
                new_draws[draw.name] = draw
            elif existing != draw:
                raise InputError(f"the draw {draw.name!r} is given twice with different laws or scopes")
        duplicates = sorted(names & self._taken)
        if duplicates:
            raise InputError(f"two random numbers are named {duplicates[0]!r}; every draw needs a unique name")
        self._known |= new_draws
        self._taken |= names

    def space(self) -> Space:
        """Return the extended space."""
        return Space(tuple(self._known.values()), self._correlations)


def check_seed(seed: int) -> int:
    """Return a seed as an integer; raise InputError unless it is in 0 … 2⁶⁴-1."""
    return check_whole("the seed", seed, 0, 2**64 - 1, "from 0 to 2^64 - 1")


@dataclass(frozen=True)
class LabelledSpace:
    """The space of one source with label ``kind[subject]``: converts its settings to numbers and expressions."""

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
                allowed = "a finite number, the name of a parameter, a law, a draw or a formula"
                return check_number(f"{field} of {self.label}", setting, allowed)

    def positive(self, field: str, setting: Setting, *, zero: bool = False) -> Value:
        """Return a setting that must be positive (or zero, if allowed) in every sample; see :meth:`value`.

        Raises InputError if the number, or the lower end of the law's support, is too low. The mean of a normal law must
        be 8.6 standard deviations above zero, farther than any sample is from it.
        """
        value = self.value(field, setting)
        lowest, _ = self.interval(value)
        if lowest < 0 or (lowest == 0 and not zero):
            reason = ""
            if isinstance(value, Component):
                quantity, mean = self.space.quantity_and_mean(value.name)
                remedy = "narrow or truncate its law" if mean else "no mean is given; write mean: with the size"
                reason = f" (as low as {write_number(lowest, quantity)}); {remedy}"
            raise InputError(f"{field} of {self.label} can become {'negative' if zero else 'zero or negative'}{reason}")
        return value

    def interval(self, value: Value) -> tuple[float, float]:
        """Return the minimum and maximum over all samples; an empty interval for a formula, which is not checked."""
        if not isinstance(value, Expression):
            return value, value
        if not isinstance(value, Component):
            return math.inf, -math.inf
        return self.space.intervals[self.space.index[value.name]]

    def values(self, field: str, settings: Sequence[Setting]) -> tuple[Value, ...]:
        """Return several settings of one field, named ``field``, ``field[1]``, ``field[2]``, …."""
        return tuple(self.value(entry_name(field, k), setting) for k, setting in enumerate(settings))

    def component(self, name: str) -> Component:
        """Return a component of a draw that the source defines, ``label.name``."""
        return self.space.parameter(f"{self.label}.{name}")


def entry_name(field: str, k: int) -> str:
    """Return the name of the k-th of several values of a field: ``field``, ``field[1]``, ``field[2]``, …."""
    return field if k == 0 else f"{field}[{k}]"


_UNTOUCHED: Final = 1e-9
"""Largest change of a mean, variance or correlation, in units of the prior, that counts as rounding of the fit."""


def held_at_mean(draw: Draw) -> Draw:
    """Return a draw with the same names, fixed at its mean."""
    mean = tuple(draw.law.mean_vector.tolist())
    law = JointNormal(tuple((0.0,) * len(mean) for _ in mean), mean)
    return dataclasses.replace(draw, law=law, names=draw.components)


@dataclass(frozen=True, eq=False)
class Estimates:
    """Mean and covariance of components of a space after a calibration, SI.

    Attributes:
        stated: Mean and standard deviation of each component in the calibrated sheet; empty if unknown.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array
    stated: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def remaining_space(self, space: Space) -> Space:
        """Return the space of the calibrated arm; parameters that the data do not inform keep their prior.

        The others form one joint normal draw, ``calibrated``, and keep their names. A component whose prior has bounds
        within the range of the normal distribution is clipped to them, unless a combination with others is known, which
        clipping would falsify. No component crosses a zero that its prior does not cross. Raises InputError if a name is
        not that of a component drawn once per robot.
        """
        scopes = {name: draw.scope for draw in space.draws for name in draw.components}
        for name in self.names:
            if scopes[check_name("component", name, scopes)] is not Scope.UNIT:
                raise InputError(f"{name} is not drawn once for each robot")
        updated = self._touched(space)
        if not updated:
            return space
        members = [draw for draw in space.draws if draw.name in updated]
        names = [name for draw in members for name in draw.components]
        position = {name: k for k, name in enumerate(self.names)}
        matrix, centre = np.zeros((len(names), len(names))), space.mean[[space.index[name] for name in names]].copy()
        estimated = [k for k, name in enumerate(names) if name in position]
        rows = [position[names[k]] for k in estimated]
        matrix[np.ix_(estimated, estimated)] = self.covariance[np.ix_(rows, rows)]
        centre[estimated] = self.mean[rows]
        normal = JointNormal(tuple(map(tuple, ((matrix + matrix.T) / 2).tolist())), tuple(centre.tolist()))
        unchanged = (draw for draw in space.draws if draw.name not in updated)
        law = _clip(normal, [bounds_of(draw.law, k) for draw in members for k in range(draw.law.size)])
        used_names = {name for draw in space.draws for name in (draw.name, *draw.components)}
        name = "calibrated"
        while name in used_names:
            name += "_"
        correlations = tuple(correlation for correlation in space.correlations if not updated & set(correlation.names))
        return Space((Draw(name, law, names=tuple(names)), *unchanged), correlations)

    def without_changed(self, before: Space, after: Space) -> tuple[Estimates | None, tuple[str, ...]]:
        """Return the estimates without changed draws (None if none remain), and the changed names that were estimated."""
        draws_after = {draw.name: draw for draw in after.draws}
        changed = {name for draw in before.draws if draws_after.get(draw.name) != draw for name in draw.components}
        retained = [k for k, name in enumerate(self.names) if name not in changed]
        if len(retained) == len(self.names):
            return self, ()
        updated = self._touched(before)
        informed = {name for draw in before.draws if draw.name in updated for name in draw.components}
        replaced = tuple(name for name in self.names if name in changed & informed)
        if not retained:
            return None, replaced
        names = tuple(self.names[k] for k in retained)
        return Estimates(names, self.mean[retained], self.covariance[np.ix_(retained, retained)]), replaced

    def edited(self, space: Space) -> dict[str, tuple[float, float]]:
        """Return the new mean and standard deviation of each component if they differ from the stated ones."""
        edits = {}
        stds = np.sqrt(space.block_covariance.variances)
        for name, (mean, std) in self.stated.items():
            column = space.index.get(name)
            current = (mean, std) if column is None else (float(space.mean[column]), float(stds[column]))
            if max(abs(current[0] - mean), abs(current[1] - std)) > _UNTOUCHED * max(std, abs(mean)):
                edits[name] = current
        return edits

    def learned(self, space: Space) -> tuple[str, ...]:
        """Return the components whose variance in the original space the data reduced by at least half."""
        columns = np.array([space.index[name] for name in self.names], dtype=np.intp)
        before = space.block_covariance.variances[columns]
        return tuple(itertools.compress(self.names, np.diag(self.covariance) <= 0.5 * before))

    def _touched(self, space: Space) -> set[str]:
        columns = np.array([space.index[name] for name in self.names], dtype=np.intp)
        prior = space.block_covariance.within(columns)
        std = np.sqrt(np.diag(prior))
        std = np.where(std > 0, std, 1.0)
        scaled = (self.covariance - prior) / np.outer(std, std)
        mean_changes = np.abs(self.mean - space.mean[columns]) / std
        changed = (np.abs(scaled).max(axis=1) > _UNTOUCHED) | (mean_changes > _UNTOUCHED)
        names = set(itertools.compress(self.names, changed))
        updated = {draw.name for draw in space.draws if names & set(draw.components)}
        for correlation in space.correlations:
            if updated & set(correlation.names):
                updated |= set(correlation.names)
        return updated


def bounds_of(law: Law, number: int) -> tuple[float, float]:
    """Return the bounds of a component of a law, infinite if unbounded."""
    axis = np.eye(law.size)[number]
    return -float(law.support(-axis)), float(law.support(axis))


def _clip(normal: JointNormal, bounds: Sequence[tuple[float, float]]) -> Law:
    """Return the law with the bounds within its range; the normal law itself if there is none."""
    # A component of which a combination with others is known is not clipped: that would falsify the combination. But a
    # component with a prior on one side of zero, such as a stiffness, stays there: it is clipped half way from its bound
    # to zero, a value that the normal distribution hardly reaches.
    std = np.sqrt(np.diag(normal.covariance))
    unit = np.where(std > 0, std, 1.0)
    correlation = normal.covariance / np.outer(unit, unit)
    np.fill_diagonal(correlation, 1.0)
    free_fractions = 1 / np.sqrt(np.diag(np.linalg.inv(correlation + _UNTOUCHED * np.eye(len(unit)))))
    active_bounds = []
    for k, (low, high) in enumerate(bounds):
        first, last = normal.interval(k)
        if free_fractions[k] <= 0.5:  # of its standard deviation remains if all others are known: it depends on them
            low, high = (low / 2 if low >= 0 else -np.inf), (high / 2 if high <= 0 else np.inf)
        active_bounds.append((low if first < low else -np.inf, high if last > high else np.inf))
    return dataclasses.replace(normal, bounds=tuple(active_bounds)) if np.isfinite(active_bounds).any() else normal
