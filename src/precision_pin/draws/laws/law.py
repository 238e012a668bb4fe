"""Base class of laws, rows of laws in the tables of the compiled loops, and default methods based on quantiles.

For the defaults, the normal scores from -8.6 to 8.6 are divided into panels, at jumps and kinks of the law and otherwise
evenly. The density in each panel is a Legendre series in the value, whose coefficients are integrals over the scores; no
inversion is needed. The wave exp(iωx) has a Legendre series with spherical Bessel functions as coefficients (Rayleigh),
so that the cost of the characteristic function does not depend on the frequency.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Final, Literal, Protocol, cast

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_memory, check_number, check_numbers, check_whole, shown
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.csv_columns import Measured
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.base.written_units import WrittenUnit
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.projection import (
    FARTHEST_NORMAL,
    LAST_UNIFORM,
    Moments,
    Projection,
    moments_by_quadrature,
    score_panels,
)

Place = tuple[str | int, ...]
"""Path of keys and indices below the mapping of a law."""

NUMBER: Final[Mapping[str, Any]] = {"type": "string", "description": "a number with its unit"}
"""JSON schema of the value under a law's key, for laws of one size."""


def object_schema(properties: Mapping[str, Any], *required: str) -> Mapping[str, Any]:
    """Return the JSON schema of a mapping with these keys and no other."""
    return {"type": "object", "properties": properties, "required": list(required), "additionalProperties": False}


DEVIATIONS: Final = object_schema({"std": {}}, "std")
"""JSON schema of a standard deviation under a law's key."""


@dataclass(frozen=True)
class LawOption:
    """Further key of a law.

    Attributes:
        meaning: Text for schema and documentation; texts of several laws for the same key are joined.
        example: A value that fits the law's example.
    """

    key: str
    meaning: str
    example: Any
    is_ratio: bool = False


MEAN: Final = LawOption("mean", "default 0", "1 mm")
"""Option of every law that is symmetric about its mean."""


@dataclass(frozen=True)
class SheetForm:
    """The form of a law in a sheet.

    Attributes:
        key: The key that names it; empty if sheets cannot name it.
        example: A law as a mapping, with lengths as its values.
        options: Further keys, besides the law's key and ``scope``.
        schema: JSON schema of the value under the key.
    """

    key: str
    example: Mapping[str, Any]
    meaning: str
    options: tuple[LawOption, ...] = ()
    schema: Mapping[str, Any] = field(default_factory=lambda: NUMBER)


class SheetReader(Protocol):
    """Reader of a law's settings, values of one quantity; errors name their place in the sheet."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """The law as a mapping."""

    def value(self, *where: str | int) -> Any:
        """Return the value at a place."""

    def number(self, *where: str | int) -> float:
        """Return the number at a place in SI."""

    def numbers(self, *where: str | int) -> list[float]:
        """Return the numbers at a place: a list with a unit each, or text with a common unit."""

    def half_width(self, *where: str | int) -> float:
        """Return the number at a place; raise if negative."""

    def mean(self) -> float:
        """Return the mean (default: 0)."""

    def ratio(self, *where: str | int) -> float:
        """Return the unitless number at a place."""

    def file(self, *where: str | int) -> Measured:
        """Return the contents of the file at a place, its path relative to the sheet."""

    def column(self, table: Measured, name: str, where: Place) -> tuple[float, ...]:
        """Return a file's column in SI."""

    def ratio_column(self, table: Measured, name: str, where: Place) -> tuple[float, ...]:
        """Return a file's column of unitless numbers."""

    def only(self, where: Place, *keys: str) -> None:
        """Raise unless a place holds a mapping of these keys; the first is required."""

    def error(self, where: Place, reason: str) -> InputError:
        """Return an error at a place."""

    def place_errors(self, where: Place) -> AbstractContextManager[None]:
        """Add a place to input errors that have none."""


def write_number(value: float, quantity: Quantity | None) -> str:
    """Return a number with a suitable unit."""
    return WrittenUnit.suiting(quantity, [value])(value)


def about(half_width: float, mean: float, quantity: Quantity | None) -> str:
    """Return a half-width as text, with the mean if it is not zero."""
    unit = WrittenUnit.suiting(quantity, [half_width, mean])
    return f"±{unit(half_width)}" + (f" about {unit(mean)}" if mean else "")


def mean_beside(mean: float, quantity: Quantity | None) -> str:
    """Return the phrase for a mean, empty for zero."""
    return f", mean {write_number(mean, quantity)}" if mean else ""


def spread(mean: Array, covariance: Array, quantity: Quantity | None) -> str:
    """Return the phrase for the mean and the standard deviation of one component."""
    std = math.sqrt(float(covariance[0, 0]))
    return f", mean {write_number(float(mean[0]), quantity)}, standard deviation {write_number(std, quantity)}"


def deviations(components: Sequence[str], covariance: Array, quantities: Sequence[Quantity | None]) -> str:
    """Return the phrase for the standard deviations of several components."""
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    entries = zip(components, stds, quantities, strict=True)
    return "standard deviations " + ", ".join(
        f"{name.removeprefix('.')} {write_number(std, quantity)}" for name, std, quantity in entries
    )


class Law(ABC):
    """Distribution of one or several components.

    A law of one component needs only :meth:`sample`: the other methods follow from its quantiles, and the compiled loops
    draw from straight lines between them. Closed forms override these defaults.

    Attributes:
        variates: The input of :meth:`sample`: ``"uniform"`` on (0, 1) or standard ``"normal"`` numbers.
        form: Form in a sheet; without a key if sheets cannot name it.
        is_normal: True if sums of its components are normal; also true of components that do not vary.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "uniform"
    form: ClassVar[SheetForm] = SheetForm("", {}, "")
    is_normal: ClassVar[bool] = False

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Law:
        """Return the law in a sheet: the size under its key, and options; raise InputError for a wrong setting."""
        size = reader.half_width(cls.form.key)
        items = [option for option in cls.form.options if option.key in reader.settings]
        options = {option.key: (reader.ratio if option.is_ratio else reader.number)(option.key) for option in items}
        return cls(size, **options)  # type: ignore[call-arg]

    def __post_init__(self) -> None:
        """Check the fields of a law with a sheet form: the first is its size, zero or more."""
        key = self.form.key.replace("_", "-")
        numbers = [field.name for field in fields(cast("Any", self)) if field.type in ("float", float)] if key else []
        for k, name in enumerate(numbers):
            what = f"the {name.replace('_', '-')} of {'an' if key[0] in 'aeio' else 'a'} {key} law"
            (take_number if k else take_size)(self, name, what)

    @property
    def size(self) -> int:
        """Dimension of the distribution."""
        return 1

    @property
    def components(self) -> tuple[str, ...]:
        """Suffix of each component's name, empty for a single component."""
        return ("",)

    @abstractmethod
    def sample(self, variates: Array) -> Array:
        """Return samples ``(size, N)`` from independent variates ``(size, N)``."""

    def _check_single(self, what: str) -> None:
        if self.size > 1:
            raise InputError(f"the law {type(self).__name__} of {self.size} numbers does not define its {what}")

    @property
    def mean_vector(self) -> Array:
        """Mean, ``(size,)``."""
        self._check_single("mean")
        return np.array([mean_and_variance(self)[0]])

    @property
    def covariance(self) -> Array:
        """Covariance, ``(size, size)``."""
        self._check_single("covariance")
        return np.array([[mean_and_variance(self)[1]]])

    def support(self, direction: ArrayLike) -> float:
        """Return h(w), the largest w·x over the support, for w ``(size,)``; infinite if unbounded."""
        self._check_single("support function")
        w = float(np.asarray(direction, dtype=float)[0])
        with np.errstate(all="ignore"):
            end = float(self.inverse(np.array([[1.0 if w > 0 else 0.0]]))[0, 0])
        return 0.0 if not w else w * end if math.isfinite(end) else math.inf

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(i t·x) for t ``(size, …)``."""
        self._check_single("characteristic function")
        t = np.asarray(frequency, dtype=float)[0]
        part = self.projection(np.ones(1))
        if part is None:
            raise InputError(f"the samples of the law {type(self).__name__} do not rise with their uniform numbers")
        return np.exp(1j * t * self.mean_vector[0]) * part.characteristic(t)

    @property
    def streamed(self) -> range:
        """Indices of the variates that :meth:`sample` uses; none for a component that does not vary."""
        return range(self.size)

    def kernel_row(self) -> KernelRow | None:
        """Return the law's row for the compiled loops; None if no loop fits."""
        lines = straight_lines(self) if self.size == 1 and self.variates == "uniform" else None
        return None if lines is None else KernelRow("empirical", lines)

    def projection(self, weights: Array) -> Projection | None:
        """Return the distribution of ``w·(x - mean)``, for weights w ``(size,)`` along which the law varies.

        None for a normal law, or if only the characteristic function is known.
        """
        series = None if self.size > 1 or self.is_normal else series_of(self)
        return None if series is None else DerivedProjection(self, float(weights[0]), series)

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return a description of the law, with values in SI if their quantity is None."""
        name = type(self).__name__
        if self.size > 1:
            return f"{name} of {self.size} numbers, {deviations(self.components, self.covariance, quantities)}"
        return name + spread(self.mean_vector, self.covariance, quantities[0])

    def tolerance(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the short text of its range: ``±0.3 mm``, ``0 mm to 2 mm``, ``σ 0.1 mm``; empty without a quantity."""
        quantity = quantities[0] if quantities else None
        if quantity is None or not quantity.si or any(other != quantity for other in quantities):
            return ""
        stds = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        first = np.eye(self.size)[0]
        low, high = self.interval(0)
        # an interval is finite for every law, the support is not
        if not np.isfinite(self.support(first) + self.support(-first)):
            unit = WrittenUnit.suiting(quantity, stds.tolist())
            return f"σ {unit.short(float(stds[0]))}" if np.allclose(stds, stds[0]) else ""
        unit = WrittenUnit.suiting(quantity, [low, high])
        if math.isclose(low + high, 2 * float(self.mean_vector[0]), abs_tol=1e-9 * (high - low)):
            return f"±{unit((high - low) / 2)}"
        return f"{unit(low)} to {unit(high)}"

    def interval(self, number: int) -> tuple[float, float]:
        """Return the bounds of a component of the law (0-based) in every sample.

        The ends of its support, or for a law based on normal variates its values at ±8.6 standard deviations. Raises
        InputError if the law has no such component.
        """
        check_whole("the index of a number of the law", number, 0, self.size - 1)
        direction = np.eye(self.size)[number]
        low, high = -self.support(-direction), self.support(direction)
        if self.size > 1 or math.isfinite(high - low):
            return low, high
        farthest = FARTHEST_NORMAL if self.variates == "normal" else float(lazy_special.ndtri(LAST_UNIFORM))
        low, high = self.at_scores(np.array([[-farthest, farthest]]))[0].tolist()
        return low, high

    @property
    def cell_edges(self) -> Array | None:
        """Uniform numbers from 0 to 1 between which the values are constant or linear; None for other laws."""
        return None

    @property
    def lines(self) -> Array | None:
        """Lines ``(k, 4)`` between :attr:`cell_edges`: begin, value there, slope, value at the end; or None."""
        return None

    @property
    def measured(self) -> Array | None:
        """The measured samples ``(n, size)`` that define the law; None if there are none."""
        return None

    @property
    def extreme_points(self) -> Array | None:
        """Points ``(n, size)`` whose convex hull is that of the support; None if unknown."""
        return None

    def ellipsoid(self, k: float) -> Array | None:
        """Return the root ``(size, size)`` of the ellipsoid that contains the law (unbounded: to k std), or None."""
        return None

    def standardised_moments(self) -> Moments | None:
        """Return the moments of its standardised components; None if unknown or if other mixed moments do not vanish."""
        return None if self.size > 1 else moments_by_quadrature(self.at_scores, self.breaks)

    def cumulants(self) -> Array | None:
        """Return the second, third, fourth and sixth cumulant of each component, ``(4, size)``.

        None if its tails are no heavier than normal, so that it may be treated as normal.
        """
        return None

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return the covariance with a component whose normal score is correlated; None without a closed form."""
        return None

    def covariance_by_scores(self, correlation: float, nodes: Callable[[float], tuple[Array, Array]]) -> float | None:
        """Return the covariance with another component as an integral over the score of that component.

        None if the mean at a given score of the other component is unknown.

        Args:
            correlation: Correlation of the two normal scores.
            nodes: Takes a distance beyond the default range; returns the scores z of the other component in the extended
                range, and (value - mean) × density × weight at each.
        """
        return None

    def from_normals(self, normals: Array) -> Array:
        """Return samples from independent standard normal numbers ``(size, N)``, by the smoothest function."""
        return self.at_scores(normals)

    def facing(self, slopes: Array) -> Law:
        """Return the law with :meth:`from_normals` fit for rare values of the length of ``slopes @ x``, ``(k, size)``."""
        return self

    @property
    def breaks(self) -> tuple[float, ...]:
        """Uniform numbers in (0, 1) at which the inverse of a law of one component has a jump or kink."""
        return ()

    def inverse(self, uniforms: Array) -> Array:
        """Return samples from uniform numbers (quasi-random points), for any :attr:`variates`."""
        return self.sample(uniforms if self.variates == "uniform" else lazy_special.ndtri(uniforms))

    def at_scores(self, scores: Array) -> Array:
        """Return samples from standard normal numbers (correlated draws), for any :attr:`variates`."""
        return self.sample(scores if self.variates == "normal" else cumulative(scores))


def cumulative(scores: Array) -> Array:
    """Return Φ of normal scores, from the lower tail, so that all engines round equally near 1."""
    tail = lazy_special.ndtr(-np.abs(scores))
    return np.where(scores > 0, 1 - tail, tail)


def take_size(law: Law, field: str, what: str, *, zero: bool = True) -> None:
    """Store a field as a float; raise InputError unless finite and zero or more (positive without ``zero``)."""
    allowed = f"{'zero or more' if zero else 'positive'} and finite"
    size = check_number(what, getattr(law, field), allowed, lambda value: value > 0 or (value == 0 and zero))
    object.__setattr__(law, field, size)


def take_number(law: Law, field: str, what: str) -> None:
    """Store a field as a float; raise InputError unless it is a finite number."""
    object.__setattr__(law, field, check_number(what, getattr(law, field)))


def take_rows(law: Law, field: str, what: str, columns: int | None = None) -> Array:
    """Store a field as tuples of floats and return the array; raise InputError unless finite, in rows of equal length."""
    value = getattr(law, field)
    if isinstance(value, list | tuple) and all(isinstance(row, list | tuple) for row in value):
        for k, row in enumerate(value):
            if len(row) != len(value[0]):
                raise InputError(f"row {k + 1} of {what} has {len(row)} numbers, the first has {len(value[0])}")
    rows = "at least one row of " + ("finite numbers" if columns is None else f"{columns} finite numbers")
    table = check_numbers(what, value, (None, columns), rows)
    if not table.size:
        raise InputError(f"{what} must be {rows}, got {shown(value)}")
    # memory of a tuple and a list per row and an object per number
    check_memory((152.0 + 48 * table.shape[1]) * len(table), f"{what}, {table.size:,} numbers,", "give fewer")
    object.__setattr__(law, field, tuple(map(tuple, table.tolist())))
    return table


Branch = Literal[
    "fixed",
    "normal",
    "uniform",
    "triangular",
    "truncated",
    "disc",
    "circle",
    "sphere",
    "joint",
    "lognormal",
    "arcsine",
    "two_point",
    "empirical",
    "table",
]
"""The loops of ``apply_laws`` in kernel/loops.py; several laws may use the same loop."""


@dataclass(frozen=True, eq=False)
class KernelRow(Fixed):
    """The row of a law in the tables of the compiled loops.

    Attributes:
        branch: The loop that converts its variates to its components.
        numbers: The loop's parameters, ``(n,)``, or a table of them, ``(r, c)``: see
            :class:`precision_pin.kernel.loops.Draws`.
        intervals: Bounds of each component in the loop, if they differ from
            :meth:`~precision_pin.draws.laws.Law.interval`.
    """

    branch: Branch
    numbers: Array
    intervals: tuple[tuple[float, float], ...] = ()


_NODES: Final = 24
"""Scores in each panel: exact for polynomials up to degree 47, more than twice the degree of the series."""

_TERMS: Final = 20
"""Terms of the Legendre series in each panel; the last ones bound the error, 1e-12 for smooth densities."""

_SLOW: Final = 10.0
"""Phase across half a panel up to which the wave is summed over the scores; beyond, its Legendre series."""

_NARROW: Final = 1e-7
"""Panel width in standard deviations below which rounding spoils a series; the density counts as constant."""

_LEVELS: Final = 100
_MARGIN: Final = 1.05
"""Levels that cut off a density to bound its characteristic function; margin for the variation within a cell.

Levels differ by factors of 1.05 to 1.1; more levels would lower the bound by less than the margin raises it.
"""

_LINE_ERROR: Final = 1e-7
"""Largest distance of the straight lines from the quantile function, in standard deviations."""

_MOST_LINES: Final = 2**17
"""Lines that replace a quantile function: 4 MiB in the tables of the loops; steeper tails are left to numpy."""


@lru_cache(maxsize=256)
def mean_and_variance(law: Law) -> tuple[float, float]:
    """Return mean and variance of a law of one component, to 13 digits of the largest value; more would be rounding."""
    z, weights, _ = score_panels(law.breaks, _NODES)
    values, shares = _values(law, z).ravel(), weights.ravel() / weights.sum()
    mean = float(shares @ values)
    digits = 12 - math.floor(math.log10(float(np.abs(values).max()) or 1.0))
    return round(mean, digits) + 0.0, float(f"{shares @ (values - mean) ** 2:.13g}")


def _values(law: Law, scores: Array) -> Array:
    """Return a law's values at normal scores, limited to the value at the last uniform number, 1 - 2⁻⁵³."""
    if law.variates == "uniform":
        scores = np.minimum(scores, lazy_special.ndtri(LAST_UNIFORM))
    return law.at_scores(scores.reshape(1, -1))[0].reshape(scores.shape)


@dataclass(frozen=True, eq=False)
class Series(Fixed):
    """Legendre series of the density of a law of one component, about its mean.

    Attributes:
        points, weights: Values and their probabilities, ``(panels, nodes)``.
        low, high: Ends of the panels, ``(panels,)``.
        moments: E of the Legendre polynomials in each panel, ``(panels, terms)``; only the first in a narrow panel.
        cells: Density in cells of ascending values, ``(cells,)``, zero in gaps, infinite at discrete values.
        shares: Probability of each cell, ``(cells,)``.
    """

    points: Array
    weights: Array
    low: Array
    high: Array
    moments: Array
    cells: Array
    shares: Array

    @cached_property
    def half(self) -> Array:
        """Half the length of each panel."""
        return (self.high - self.low) / 2

    @cached_property
    def middle(self) -> Array:
        """Middle of each panel."""
        return (self.high + self.low) / 2

    @cached_property
    def coefficients(self) -> Array:
        """Series ``(panels, terms)`` of the density in each panel, over -1 to 1."""
        return self.moments * (np.arange(_TERMS) + 0.5)

    @cached_property
    def integrals(self) -> Array:
        """Series ``(panels, terms + 1)`` of the probability below a value in each panel."""
        value: Array = np.asarray(legendre.legint(self.coefficients, lbnd=-1, axis=1), dtype=float)
        value[:, 0] += np.cumsum(self.moments[:, 0]) - self.moments[:, 0]
        return value

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Probability above each level of the density, and total variation of the density cut off at the level."""
        finite = self.cells[np.isfinite(self.cells) & (self.cells > 0)]
        levels = np.geomspace(np.median(finite) / 100, finite.max(), _LEVELS) if finite.size else np.zeros(0)
        inverse = np.divide(1.0, self.cells, out=np.zeros_like(self.cells), where=self.cells > 0)
        above = np.array([self.shares @ np.maximum(1 - level * inverse, 0) for level in levels])
        padded = np.concatenate([[0.0], self.cells, [0.0]])
        total_variation = np.array([np.abs(np.diff(np.minimum(padded, level))).sum() for level in levels])
        return above, total_variation * _MARGIN


@lru_cache(maxsize=64)
def series_of(law: Law) -> Series | None:
    """Return the series of a law of one component; None if its samples do not rise with the uniform numbers."""
    z, weights, edges = score_panels(law.breaks, _NODES)
    mean, scale = float(law.mean_vector[0]), math.sqrt(law.covariance[0, 0])
    # slightly inside the panels, because the law may jump at an edge
    cuts = np.linspace(edges[:-1] + 1e-12, edges[1:] - 1e-12, _NODES + 1, axis=1)
    points, values = _values(law, z) - mean, _values(law, cuts) - mean
    # the outermost panels, too narrow to be resolved, hold less probability than rounding errors
    mask = (weights.sum(axis=1) > 1e-13) | (values[:, -1] - values[:, 0] > _NARROW * scale)
    points, weights, cuts, values = (points[mask], weights[mask] / weights[mask].sum(), cuts[mask], values[mask])
    if (np.diff(points.ravel()) < -1e-9 * scale).any():
        return None
    gaps = values[1:, 0] - values[:-1, -1] > 1e-9 * scale
    values[:-1, -1] = np.where(gaps, values[:-1, -1], values[1:, 0])
    low, high = values[:, 0].copy(), values[:, -1].copy()
    half = (high - low) / 2
    wide = half > _NARROW * scale
    positions = np.clip((points - (low + half)[:, None]) / np.where(wide, half, 1.0)[:, None], -1, 1)
    moments = np.einsum("pk,pkn->pn", weights, legendre.legvander(positions, _TERMS - 1))
    moments[~wide, 1:] = 0.0
    shares = np.abs(np.diff(lazy_special.ndtr(-np.abs(cuts)), axis=1))
    shares = np.where((cuts[:, :-1] < 0) & (cuts[:, 1:] > 0), np.diff(lazy_special.ndtr(cuts), axis=1), shares)
    widths = np.diff(values, axis=1)
    cells = np.divide(shares, widths, out=np.full_like(widths, np.inf), where=widths > 0)
    ends = np.append(np.where(gaps, 0.0, cells[:-1, -1]), cells[-1, -1])
    cells, shares = np.column_stack([cells, ends]), np.column_stack([shares, np.zeros(len(shares))])
    return Series(points, weights, low, high, moments, cells.ravel(), shares.ravel())


@dataclass(frozen=True, eq=False)
class DerivedProjection(Projection):
    """Projection of a law of one component by the series of its density."""

    law: Law
    size: float
    series: Series

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of the support, or the outermost values drawn from an unbounded law."""
        mean = float(self.law.mean_vector[0])
        low, high = sorted(self.size * (end - mean) for end in self.law.interval(0))
        return low, high

    @property
    def breaks(self) -> tuple[float, ...]:
        bends = np.sign(self.size) * lazy_special.ndtri(np.array(self.law.breaks, dtype=float))
        even = np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 13)
        return tuple(np.union1d(even, bends[np.abs(bends) < FARTHEST_NORMAL]).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple(self.position(np.array(self.breaks)).tolist())

    def _panels(self, z: Array) -> tuple[Array, NDArray[np.intp], Array]:
        """Return deviations, their panels and their positions in the panels, -1 to 1."""
        x = z / self.size
        k = np.clip(np.searchsorted(self.series.low, x, side="right") - 1, 0, None)
        half = self.series.half[k]
        single = np.where(x >= self.series.low[k], 1.0, -1.0)
        place = np.where(half > 0, (x - self.series.middle[k]) / np.where(half > 0, half, 1.0), single)
        return x, k, np.clip(place, -1, 1)

    def cumulative(self, z: Array) -> Array:
        _, k, place = self._panels(z)
        below = np.clip(legendre.legval(place, np.moveaxis(self.series.integrals[k], -1, 0), tensor=False), 0, 1)
        return np.asarray(below if self.size > 0 else 1 - below, dtype=float)

    def density(self, z: Array) -> Array:
        if self.series.moments[self.series.half == 0, 0].sum() > _NARROW:
            return np.full_like(z, np.nan)
        x, k, place = self._panels(z)
        value = legendre.legval(place, np.moveaxis(self.series.coefficients[k], -1, 0), tensor=False)
        inside = (x >= self.series.low[k]) & (x <= self.series.high[k])
        return np.where(inside, np.maximum(value, 0) / (self.series.half[k] * abs(self.size)), 0.0)

    def position(self, s: Array) -> Array:
        return self.size * (_values(self.law, np.sign(self.size) * s) - self.law.mean_vector[0])

    def weight(self, s: Array) -> Array:
        return np.exp(-(s**2) / 2) / np.sqrt(2 * np.pi)

    def parameter(self, z: Array) -> Array:
        return np.clip(lazy_special.ndtri(self.cumulative(z)), -FARTHEST_NORMAL, FARTHEST_NORMAL)

    @property
    def is_bounded(self) -> bool:
        return bool(np.isfinite(self.law.support([1.0]) + self.law.support([-1.0])))

    def within(self, score: float) -> tuple[float, float]:
        low, high = self.position(np.array([-score, score])).tolist()
        return self.ends if self.is_bounded else (low, high)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        omega = np.asarray(frequency, dtype=float).ravel() * self.size
        value = np.zeros(omega.size, dtype=complex)
        powers = (2 * np.arange(_TERMS) + 1) * 1j ** np.arange(_TERMS)
        narrow = (self.series.moments[:, 1:] == 0).all(axis=1)
        for panel, (half, middle) in enumerate(zip(self.series.half, self.series.middle, strict=True)):
            slow = np.flatnonzero((np.abs(omega) * half < _SLOW) | narrow[panel])
            points, weights = self.series.points[panel], self.series.weights[panel]
            step = max(1, 2**20 // _NODES)
            for batch in (slow[first : first + step] for first in range(0, slow.size, step)):
                value[batch] += np.exp(1j * np.outer(omega[batch], points)) @ weights
            fast = np.setdiff1d(np.arange(omega.size), slow, assume_unique=True)
            z = omega[fast] * half
            previous, bessel = np.cos(z) / z, np.sin(z) / z
            total = np.zeros(fast.size, dtype=complex)
            for n, factor in enumerate(powers * self.series.moments[panel]):
                total += factor * bessel
                previous, bessel = bessel, (2 * n + 1) / z * bessel - previous
            value[fast] += total * np.exp(1j * omega[fast] * middle)
        return value.reshape(np.shape(frequency))

    @property
    def characteristic_error(self) -> float:
        """Error measured against closed forms, plus the size of the last terms."""
        return 1e-12 + 5.0 * float(np.abs(self.series.moments[:, -2:]).sum())

    def envelope(self, frequency: Array) -> Array:
        """Return the minimum over c of P(density above c) + V_c/ω, with V_c the variation of the density cut off at c."""
        omega = abs(self.size) * np.asarray(frequency, dtype=float)
        bound = np.ones_like(omega)
        for above, variation in zip(*self.series.bounds, strict=True):
            bound = np.minimum(bound, above + variation / np.maximum(omega, 1e-200))
        return bound


@lru_cache(maxsize=64)
def straight_lines(law: Law) -> Array | None:
    """Return lines ``(k, 4)`` close to the quantile function of a law: begin, value, slope, end value.

    None if the samples do not rise with the uniform numbers, or more than 131,072 lines would be needed.
    """
    scale = math.sqrt(law.covariance[0, 0])
    edges = np.union1d(np.linspace(0, 1, 257), np.array(law.breaks, dtype=float))
    while True:
        # slightly inside the ends, because the law may jump at an edge; 0 and 1 are never drawn
        u = np.stack([np.nextafter(edges[:-1], 2), (edges[:-1] + edges[1:]) / 2, np.nextafter(edges[1:], -1)])
        begin, middle, end = law.sample(np.clip(u, 1 - LAST_UNIFORM, LAST_UNIFORM).reshape(1, -1))[0].reshape(u.shape)
        is_bent = np.abs(middle - (begin + end) / 2) > _LINE_ERROR * scale
        is_bent &= np.diff(edges) > 2.0**-48
        if not is_bent.any() or edges.size > _MOST_LINES:
            break
        edges = np.union1d(edges, u[1][is_bent])
    rising = np.diff(np.stack([begin, end], axis=1).ravel()) >= -1e-9 * scale
    if is_bent.any() or not rising.all():
        return None
    return np.column_stack([edges[:-1], begin, (end - begin) / np.diff(edges), end])
