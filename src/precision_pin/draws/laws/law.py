"""The base class of all laws, and the row of a law in the tables of the compiled loops."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal, cast, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_number, check_numbers, check_whole, shown
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.memory import check_memory
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.derived import DerivedProjection, mean_and_variance, series_of, straight_lines
from precision_pin.draws.laws.projection import (
    FARTHEST_NORMAL,
    LAST_UNIFORM,
    Moments,
    Projection,
    moments_by_quadrature,
)
from precision_pin.draws.laws.sheet_form import SheetForm, SheetReader, deviations, spread
from precision_pin.render.display_units import WrittenUnit


class Law(ABC):
    """A distribution of one or several numbers.

    :meth:`sample` is all that a law of one number needs; what else there is then follows from its quantiles, and the compiled
    loops draw from straight lines between them. A closed form overrides what follows so.

    Attributes
    ----------
    variates
        The input of :meth:`sample`: ``"uniform"`` on (0, 1) or standard ``"normal"`` numbers.
    form
        Its form in a sheet; without a key if no sheet can name it.
    is_normal
        True if sums of its numbers are normal; also true of numbers that do not vary.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "uniform"
    form: ClassVar[SheetForm] = SheetForm("", {}, "")
    is_normal: ClassVar[bool] = False

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Law:
        """Return the law written in a sheet: the size under its key, and the options that are given, by their names.

        Raises
        ------
        InputError
            A setting is wrong.
        """
        size = reader.half_width(cls.form.key)
        given = [option for option in cls.form.options if option.key in reader.settings]
        options = {option.key: (reader.ratio if option.is_ratio else reader.number)(option.key) for option in given}
        return cls(size, **options)  # type: ignore[call-arg]

    def __post_init__(self) -> None:
        """Check the numbers of a law that sheets can name: the first is its size, zero or more."""
        key = self.form.key.replace("_", "-")
        numbers = [field.name for field in fields(cast("Any", self)) if field.type in ("float", float)] if key else []
        for k, name in enumerate(numbers):
            what = f"the {name.replace('_', '-')} of {'an' if key[0] in 'aeio' else 'a'} {key} law"
            (take_number if k else take_size)(self, name, what)

    @property
    def size(self) -> int:
        """Number of numbers that the law draws together."""
        return 1

    @property
    def components(self) -> tuple[str, ...]:
        """Suffix of each component's name, empty for a single number."""
        return ("",)

    @abstractmethod
    def sample(self, variates: Array) -> Array:
        """Return samples ``(size, N)`` from as many independent variates ``(size, N)``."""

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
        value: NDArray[np.complex128] = np.exp(1j * t * self.mean_vector[0]) * part.characteristic(t)
        return value

    @property
    def streamed(self) -> range:
        """Indices of the variates that :meth:`sample` uses; none for a number that does not vary."""
        return range(self.size)

    def kernel_row(self) -> KernelRow | None:
        """Return the law's row for the compiled loops; None if they have no loop for it."""
        lines = straight_lines(self) if self.size == 1 and self.variates == "uniform" else None
        return None if lines is None else KernelRow("empirical", lines)

    def projection(self, weights: Array) -> Projection | None:
        """Return the law of the number ``w·(x - mean)``, for weights w ``(size,)`` along which the law varies.

        None of a normal law, or if only the characteristic function is known.
        """
        series = None if self.size > 1 or self.is_normal else series_of(self)
        return None if series is None else DerivedProjection(self, float(weights[0]), series)

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words.

        Parameters
        ----------
        quantities
            The quantity of each number; None where it is unknown, and the number is then written in SI.
        """
        name = type(self).__name__
        if self.size > 1:
            return f"{name} of {self.size} numbers, {deviations(self.components, self.covariance, quantities)}"
        return name + spread(self.mean_vector, self.covariance, quantities[0])

    def tolerance(self, quantities: Sequence[Quantity | None]) -> str:
        """Return its range in short: ``±0.3 mm``, ``0 mm to 2 mm``, ``σ 0.1 mm``; empty where no quantity is known.

        Parameters
        ----------
        quantities
            The quantity of each number.
        """
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
        """Return the bounds of a number of the law (0-based) in every sample.

        They are the ends of its support. For a law made from normal numbers they are its values at ±8.6 standard deviations.

        Raises
        ------
        InputError
            The law has no such number.
        """
        check_whole("the index of a number of the law", number, 0, self.size - 1)
        direction = np.zeros(self.size)
        direction[number] = 1.0
        low, high = -self.support(-direction), self.support(direction)
        if self.size > 1 or math.isfinite(high - low):
            return low, high
        farthest = FARTHEST_NORMAL if self.variates == "normal" else float(lazy_special.ndtri(LAST_UNIFORM))
        low, high = self.at_scores(np.array([[-farthest, farthest]]))[0]
        return float(low), float(high)

    @property
    def cell_edges(self) -> Array | None:
        """Uniform numbers from 0 to 1 between which the values are constant or linear; None for other laws."""
        return None

    @property
    def lines(self) -> Array | None:
        """Straight lines ``(k, 4)`` between :attr:`cell_edges`: begin, value there, slope, value at the end; or None."""
        return None

    @property
    def measured(self) -> Array | None:
        """The samples ``(n, size)`` that the law was made from; None if there are none or they are unknown."""
        return None

    @property
    def extreme_points(self) -> Array | None:
        """Points ``(n, size)`` whose convex hull is that of the support; None if no such points are known."""
        return None

    def ellipsoid(self, k: float) -> Array | None:
        """Return the root ``(size, size)`` of the ellipsoid about the mean that contains the law.

        An unbounded law is cut off at k standard deviations. None if the support is no ellipsoid.
        """
        del k
        return None

    def standardised_moments(self) -> Moments | None:
        """Return the moments of its standardised numbers; None if they are unknown or other mixed moments do not vanish."""
        return None if self.size > 1 else moments_by_quadrature(self.at_scores, self.breaks)

    def cumulants(self) -> Array | None:
        """Return the second, third, fourth and sixth cumulant of each number, ``(4, size)``.

        None for a law whose tails are no heavier than a normal law's; it may be treated as normal.
        """
        return None

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return the covariance with a number whose normal score is correlated; None if there is no closed form."""
        del other, correlation
        return None

    def covariance_by_scores(self, correlation: float, nodes: Callable[[float], tuple[Array, Array]]) -> float | None:
        """Return the covariance with another number as an integral over that number's score.

        None if the mean at a given score of the other number is unknown.

        Parameters
        ----------
        correlation
            Of the two normal scores.
        nodes
            Takes a distance beyond the usual range. Returns the scores z of the other number up to there, and
            (value - mean) × density × weight at each.
        """
        del correlation, nodes
        return None

    def from_normals(self, normals: Array) -> Array:
        """Return samples from independent standard normal numbers ``(size, N)``, by the smoothest function available."""
        return self.at_scores(normals)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Uniform numbers between 0 and 1 at which the inverse of a law of one number jumps or bends; none by default."""
        return ()

    @final
    def inverse(self, uniforms: Array) -> Array:
        """Return samples from uniform numbers only (quasi-random points), whatever :attr:`variates` is."""
        return self.sample(uniforms if self.variates == "uniform" else lazy_special.ndtri(uniforms))

    @final
    def at_scores(self, scores: Array) -> Array:
        """Return samples from standard normal numbers only (correlated draws), whatever :attr:`variates` is."""
        return self.sample(scores if self.variates == "normal" else cumulative(scores))


def cumulative(scores: Array) -> Array:
    """Return Φ of normal scores, from the lower tail, so that all engines round alike near 1."""
    tail = lazy_special.ndtr(-np.abs(scores))
    value: Array = np.where(scores > 0, 1 - tail, tail)
    return value


def take_size(law: Law, field: str, what: str, *, zero: bool = True) -> None:
    """Store a field as a float; refuse all but finite numbers of zero or more (above zero without ``zero``).

    Raises
    ------
    InputError
        The field is something else.
    """
    allowed = f"{'zero or more' if zero else 'positive'} and finite"
    size = check_number(what, getattr(law, field), allowed, lambda value: value > 0 or (value == 0 and zero))
    object.__setattr__(law, field, size)


def take_number(law: Law, field: str, what: str) -> None:
    """Store a field as a float; refuse all but finite numbers.

    Raises
    ------
    InputError
        The field is something else.
    """
    object.__setattr__(law, field, check_number(what, getattr(law, field)))


def take_rows(law: Law, field: str, what: str, columns: int | None = None) -> Array:
    """Store a field as tuples of floats and return the array; refuse all but finite numbers in rows of one length.

    Raises
    ------
    InputError
        The field is something else.
    """
    given = getattr(law, field)
    if isinstance(given, list | tuple) and all(isinstance(row, list | tuple) for row in given):
        for k, row in enumerate(given):
            if len(row) != len(given[0]):
                raise InputError(f"row {k + 1} of {what} has {len(row)} numbers, the first has {len(given[0])}")
    rows = "at least one row of " + ("finite numbers" if columns is None else f"{columns} finite numbers")
    table = check_numbers(what, given, (None, columns), rows)
    if not table.size:
        raise InputError(f"{what} must be {rows}, got {shown(given)}")
    # memory of a tuple and a list for each row and an object for each number
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
    "joint",
    "lognormal",
    "arcsine",
    "two_point",
    "empirical",
    "table",
]
"""The loops of ``apply_laws`` in kernel/loops.py; several laws may use one."""


@final
@dataclass(frozen=True, eq=False)
class KernelRow:
    """The row of a law in the tables of the compiled loops.

    Attributes
    ----------
    branch
        The loop that turns its variates into its numbers.
    numbers
        The loop's parameters, ``(n,)``, or a table of them, ``(r, c)``: see :class:`precision_pin.kernel.loops.Draws`.
    intervals
        Bounds of each number in the loop, if they differ from :meth:`~precision_pin.draws.laws.Law.interval`.
    """

    branch: Branch
    numbers: Array
    intervals: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        fix_fields(self)
