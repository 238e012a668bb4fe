"""Laws from measurements: quantiles, two points, rows of a table, and joint normal components."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import units
from precision_pin.base.arguments import check_items, check_memory, check_number, check_numbers, check_whole, shown
from precision_pin.base.arrays import Array, returns_read_only
from precision_pin.base.csv_columns import Measured
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.base.written_units import WrittenUnit
from precision_pin.draws.laws.law import (
    DEVIATIONS,
    KernelRow,
    Law,
    LawOption,
    Place,
    SheetForm,
    SheetReader,
    deviations,
    object_schema,
    spread,
    take_number,
    take_rows,
    take_size,
)
from precision_pin.draws.laws.projection import (
    FARTHEST_NORMAL,
    NORMAL_MOMENTS,
    Lines,
    Moments,
    cumulants_of,
    in_chunks,
    moments_of,
    triangular_root,
)

# JSON schemas: a column of a file, and the value under `empirical`
_COLUMN_FILE: Final = object_schema({"file": {"type": "string"}, "column": {"type": "string"}}, "file")
_EMPIRICAL_SCHEMA: Final[Mapping[str, Any]] = {
    "type": "object",
    "properties": {
        "samples": {"anyOf": [{"type": "string"}, {"type": "array"}, _COLUMN_FILE]},
        "quantiles": {"anyOf": [{"type": "array"}, _COLUMN_FILE]},
    },
    "minProperties": 1,
    "maxProperties": 1,
    "additionalProperties": False,
}


class BoundedLaw(Law):
    """A law of one component between two bounds."""

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """The minimum and maximum."""

    def support(self, direction: ArrayLike) -> float:
        """Return h(w) = w·highest for w above zero, w·lowest below."""
        w = float(np.asarray(direction, dtype=float)[0])
        return max(w * end for end in self.ends)


@dataclass(frozen=True)
class Empirical(BoundedLaw):
    """A measured distribution: a table of quantiles with straight lines between them.

    Attributes:
        quantiles: ``(p, x)``: with probability p the value is at most x. From p = 0 to p = 1; neither p nor x ever
            decreases. A repeated p is a gap without values; a repeated x is a discrete value.

    Raises:
        InputError: A table that does not begin at p = 0, end at p = 1 or rise.

    Examples:
        >>> law = pp.Empirical(((0.0, 0.1), (0.5, 0.2), (1.0, 0.6)))
        >>> print(law.sample(np.array([[0.25, 0.5, 0.75]])))
        [[0.15 0.2  0.4 ]]
    """

    form: ClassVar = SheetForm(
        "empirical",
        {"empirical": {"samples": "0.11 0.13 0.12 mm"}},
        "a measured distribution: `samples` or `quantiles`, in the sheet or from a file",
        schema=_EMPIRICAL_SCHEMA,
    )
    quantiles: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        take_rows(self, "quantiles", "the quantiles of an empirical law", 2)
        if len(self.quantiles) < 2:
            raise InputError("an empirical law needs at least two quantiles")
        p, x = self._knots
        if p[0] != 0 or p[-1] != 1:
            raise InputError(
                f"the quantiles of an empirical law must go from probability 0 to 1, these go from {p[0]:g} to {p[-1]:g}"
            )
        for k in np.flatnonzero((np.diff(p) < 0) | (np.diff(x) < 0)).tolist():
            what, values = ("probability", p) if p[k + 1] < p[k] else ("value", x)
            raise InputError(
                f"the quantiles of an empirical law must rise, but the {what} {values[k + 1]:g} follows {values[k]:g}"
            )

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Empirical:
        value = reader.settings["empirical"]
        if not isinstance(value, Mapping) or len(value) != 1 or not set(value) <= {"samples", "quantiles"}:
            raise reader.error(
                ("empirical",),
                "empirical takes samples (empirical: {samples: 0.1 0.3 0.2 mm}) or quantiles "
                "(empirical: {quantiles: [[0, -0.1 mm], [1, 0.2 mm]]}), in the sheet or as {file: gauge.csv, column: gap}",
            )
        key, setting = next(iter(value.items()))
        where: Place = ("empirical", key)
        table = None
        if isinstance(setting, Mapping):
            reader.only(where, "file", "column")
            table = reader.file(*where, "file")
        with reader.place_errors(where):
            if key == "samples":
                return cls.from_samples(_column(reader, table, where) if table else reader.numbers(*where))
            if table is not None:
                values = _column(reader, table, where, "p")
                return cls(tuple(zip(reader.ratio_column(table, "p", where), values, strict=True)))
            return cls(_pairs(reader, where))

    @classmethod
    def from_samples(cls, samples: Iterable[float]) -> Empirical:
        """Return the law of n samples, with the k-th smallest as the quantile at (k - 1/2)/n (Hazen).

        Half of the probability of the smallest and of the largest sample stays at the sample, which preserves the mean.

        Raises:
            InputError: No sample, or one that is not finite.
        """
        if isinstance(samples, Iterable) and not isinstance(samples, str | bytes | np.ndarray):
            samples = list(samples)
        x = check_numbers("the samples of an empirical law", samples, (None,), "a list of finite numbers")
        # memory of each sample, as tuples and as arrays
        check_memory(300.0 * x.size, f"an empirical law of {x.size:,} samples", "give fewer, or its quantiles")
        x = np.sort(x)
        if not x.size:
            raise InputError("an empirical law needs at least one sample")
        p = np.concatenate([[0.0], (np.arange(x.size) + 0.5) / x.size, [1.0]])
        return cls(cast("Any", np.column_stack([p, np.concatenate([x[:1], x, x[-1:]])])))

    @cached_property
    @returns_read_only
    def _knots(self) -> tuple[Array, Array]:
        table = np.array(self.quantiles, dtype=float)
        return table[:, 0].copy(), table[:, 1].copy()

    @cached_property
    @returns_read_only
    def segments(self) -> Array:
        """Straight lines ``(s, 4)``: probability and value at the start, slope, value at the end."""
        p, x = self._knots
        step = np.diff(p)
        slopes = np.divide(np.diff(x), step, out=np.zeros_like(step), where=step > 0)
        return np.column_stack([p[:-1], x[:-1], slopes, x[1:]])[step > 0]

    @property
    def ends(self) -> tuple[float, float]:
        return float(self.segments[0, 1]), float(self.segments[-1, 3])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Probabilities between 0 and 1 at which two lines meet."""
        return tuple(self.segments[1:, 0].tolist())

    @property
    def mean_vector(self) -> Array:
        return np.array([self._shares @ (self.segments[:, 1] + self.segments[:, 3]) / 2])

    @property
    def covariance(self) -> Array:
        a, b = self.segments[:, 1] - self.mean_vector, self.segments[:, 3] - self.mean_vector
        return np.array([[self._shares @ (a * a + a * b + b * b) / 3]])

    def sample(self, variates: Array) -> Array:
        """Return the quantiles at u."""
        begin, value, slope, end = self.segments.T
        k = np.searchsorted(begin, variates, side="right") - 1
        return np.minimum(value[k] + slope[k] * (variates - begin[k]), end[k])

    @property
    def cell_edges(self) -> Array:
        """Probabilities at which the lines begin, and 1."""
        return np.append(self.segments[:, 0], 1.0)

    @property
    def lines(self) -> Array:
        return self.segments

    @property
    def measured(self) -> Array | None:
        """The samples; None if the table is not of the form of :meth:`from_samples`."""
        p, x = self._knots
        count = p.size - 2
        if count < 1 or x[0] != x[1] or x[-1] != x[-2]:
            return None
        return x[1:-1, None] if np.array_equal(p[1:-1], (np.arange(count) + 0.5) / count) else None

    def cumulants(self) -> Array:
        """Return the cumulants of the lines, exactly, by Gauss-Legendre quadrature with four nodes."""
        _, value, _, end = self.segments.T
        nodes, weights = np.polynomial.legendre.leggauss(4)
        middles = (1 + nodes[:, None]) / 2
        values = (value + middles * (end - value)).reshape(-1, 1)
        return cumulants_of(values, (weights[:, None] / 2 * self._shares).ravel())

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        low, high = self.ends
        unit = WrittenUnit.suiting(quantities[0], self.ends)
        statistics_text = spread(self.mean_vector, self.covariance, quantities[0])
        return f"measured: {len(self.quantiles)} quantiles from {unit(low)} to {unit(high)}{statistics_text}"

    def kernel_row(self) -> KernelRow:
        return KernelRow("empirical", self.segments)

    def projection(self, weights: Array) -> Lines:
        w = float(weights[0])
        begins, stops = (w * (self.segments[:, column] - self.mean_vector) for column in (1, 3))
        return Lines.of(self._shares, begins, stops)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return Σ Δp exp(i t (a + b)/2) sin(t (b - a)/2)/(t (b - a)/2) over the lines from a to b, t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)
        a, b = self.segments[:, 1], self.segments[:, 3]

        def of(part: Array) -> NDArray[np.complex128]:
            line = part[0][:, None]
            return (np.exp(1j * line * ((a + b) / 2)) * np.sinc(line * ((b - a) / (2 * np.pi)))) @ self._shares

        return in_chunks(of, t, 4 * a.size)

    @cached_property
    def _shares(self) -> Array:
        return np.diff(self.cell_edges)


def _column(reader: SheetReader, table: Measured, where: Place, *others: str) -> tuple[float, ...]:
    """Return the named column, or else the only column besides ``others``."""
    candidates = [name for name in table.names if name not in others]
    name = reader.value(*where).get("column")
    if name is None and len(candidates) != 1:
        raise reader.error(where, f"{table.file} has the columns {', '.join(table.names)}: choose one with column:")
    return reader.column(table, candidates[0] if name is None else str(name), where)


def _pairs(reader: SheetReader, where: Place) -> tuple[tuple[float, float], ...]:
    rows = reader.value(*where)
    if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise reader.error(where, "quantiles must be pairs of a probability and a value: [[0, -0.1 mm], [1, 0.2 mm]]")
    shares = []
    for k, row in enumerate(rows):
        with reader.place_errors((*where, k)):
            shares.append(units.parse(row[0], units.RATIO))
    return tuple((share, reader.number(*where, k, 1)) for k, share in enumerate(shares))


@dataclass(frozen=True)
class TwoPoint(BoundedLaw):
    """Two values, centre - half_width or centre + half_width, such as a clearance taken up on either side.

    Attributes:
        half_width: Half the distance between the values.
        centre: Midpoint; the mean only if both are equally likely.
        probability: Probability of the upper value.

    Examples:
        >>> law = pp.TwoPoint(half_width=0.02, probability=0.25)
        >>> print(law.mean_vector, law.covariance)
        [-0.01] [[0.0003]]
    """

    form: ClassVar = SheetForm(
        "two_point",
        {"two_point": "0.05 mm"},
        "centre - t or centre + t, nothing between; `probability` of the upper one, default 0.5; `centre`, default 0",
        (
            LawOption("centre", "two_point: halfway between the two, default 0", "1 mm"),
            LawOption("probability", "two_point: of the upper one, default 0.5", "0.3"),
        ),
    )
    half_width: float
    centre: float = 0.0
    probability: float = 0.5

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of a two-point law")
        take_number(self, "centre", "the centre of a two-point law")
        probability = check_number(
            "the probability of a two-point law", self.probability, "above 0 and below 1", lambda value: 0 < value < 1
        )
        object.__setattr__(self, "probability", probability)

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> TwoPoint:
        half_width = reader.half_width("two_point")
        centre = reader.number("centre") if "centre" in reader.settings else 0.0
        probability = reader.ratio("probability") if "probability" in reader.settings else 0.5
        if not 0 < probability < 1:
            raise reader.error(
                ("probability",), f"probability must lie above 0 and below 1, got {reader.settings['probability']}"
            )
        return cls(half_width, centre, probability)

    @property
    def ends(self) -> tuple[float, float]:
        return self.centre - self.half_width, self.centre + self.half_width

    @property
    def breaks(self) -> tuple[float, ...]:
        """The uniform number above which the upper value is drawn."""
        return (1 - self.probability,)

    @property
    def mean_vector(self) -> Array:
        """Centre + t (2p - 1), ``(1,)``."""
        return np.array([self.centre + self.half_width * (2 * self.probability - 1)])

    @property
    def covariance(self) -> Array:
        """4 p (1 - p) t² as ``(1, 1)``."""
        return np.array([[4 * self.probability * (1 - self.probability) * self.half_width**2]])

    def sample(self, variates: Array) -> Array:
        """Return the upper value for u above 1 - p, else the lower one."""
        return self.centre + np.where(variates > self.breaks[0], self.half_width, -self.half_width)

    @property
    def cell_edges(self) -> Array:
        return np.array([0.0, *self.breaks, 1.0])

    def cumulants(self) -> Array:
        half, p = self.half_width, self.probability
        return cumulants_of(np.array([[-half], [half]]), np.array([1 - p, p]))

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        low, high = self.ends
        unit = WrittenUnit.suiting(quantities[0], self.ends)
        return f"{unit(low)} or {unit(high)}, the latter with probability {100 * self.probability:.6g} %"

    def kernel_row(self) -> KernelRow:
        return KernelRow("two_point", np.array([self.centre, self.half_width, *self.breaks]))

    def projection(self, weights: Array) -> Lines:
        ends = float(weights[0]) * (np.array(self.ends) - self.mean_vector)
        return Lines.of(np.array([*self.breaks, self.probability]), ends, ends)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return (cos(t half_width) + i (2p - 1) sin(t half_width)) exp(i t centre), t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)[0]
        swing = np.cos(t * self.half_width) + 1j * (2 * self.probability - 1) * np.sin(t * self.half_width)
        return np.exp(1j * t * self.centre) * swing


# JSON schema of columns of a file
_ROWS_FILE: Final = object_schema({"file": {"type": "string"}, "columns": {"type": "array"}}, "file")


@dataclass(frozen=True)
class Rows(Law):
    """Several numbers measured together: the rows of a table, all equally likely.

    Args:
        table: The rows, of equal length.
        names: Names of the columns (default: numbers from 0).

    Raises:
        InputError: No rows, rows of different lengths, a number that is not finite, or names that do not fit.

    Examples:
        >>> law = pp.Rows(((1.0, 2.0), (3.0, 6.0)))
        >>> print(law.mean_vector, law.covariance)
        [2. 4.] [[1. 2.]
         [2. 4.]]
    """

    form: ClassVar = SheetForm(
        "rows",
        {"rows": [["0.1 mm", "0.2 mm"], ["0 mm", "-0.1 mm"]]},
        "several numbers `.0`, `.1`, … that were measured together: one of the rows, all equally likely",
        schema={"anyOf": [{"type": "array", "minItems": 1}, _ROWS_FILE]},
    )
    streamed: ClassVar = range(1)
    """The first variate, which selects the row."""
    table: tuple[tuple[float, ...], ...]
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        take_rows(self, "table", "a law of rows")
        names = check_items("the names of a law of rows", self.names, str)
        if names and (len(names) != self.size or len(set(names)) != self.size or not all(names)):
            raise InputError(f"a law of rows of {self.size} numbers needs as many different names, got {shown(names)}")
        object.__setattr__(self, "names", names)

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Rows:
        value = reader.settings["rows"]
        if isinstance(value, Mapping):
            reader.only(("rows",), "file", "columns")
            table = reader.file("rows", "file")
            names = value.get("columns", list(table.names))
            if not isinstance(names, list) or not names:
                raise reader.error(("rows", "columns"), "columns must be a list of column names")
            columns = [reader.column(table, str(name), ("rows",)) for name in names]
            return cls(tuple(zip(*columns, strict=True)))
        if not isinstance(value, list) or not value:
            raise reader.error(
                ("rows",), "rows takes rows of numbers that belong together, or {file: measured.csv, columns: [a, b]}"
            )
        rows = tuple(tuple(reader.numbers("rows", k)) for k in range(len(value)))
        for k, row in enumerate(rows):
            if not row or len(row) != len(rows[0]):
                raise reader.error(("rows", k), f"{len(row)} numbers, the first row has {len(rows[0])}")
        return cls(rows)

    @cached_property
    @returns_read_only
    def array(self) -> Array:
        """The rows, ``(rows, size)``."""
        return np.array(self.table, dtype=float)

    @property
    def size(self) -> int:
        return len(self.table[0])

    @property
    def components(self) -> tuple[str, ...]:
        """The names, or numbers from 0."""
        return tuple(f".{name}" for name in self.names or range(self.size))

    @property
    def mean_vector(self) -> Array:
        return self.array.mean(axis=0)

    @property
    def covariance(self) -> Array:
        """Covariance ``(size, size)`` of the rows as the whole population, divisor N."""
        centred = self.array - self.mean_vector
        return centred.T @ centred / len(self.table)

    def sample(self, variates: Array) -> Array:
        """Return row ⌊u₀ n⌋ of n; the other uniform numbers are unused."""
        rows = np.floor(variates[0] * len(self.table)).astype(np.intp)
        return self.array[rows].T

    def support(self, direction: ArrayLike) -> float:
        return float((self.array @ np.asarray(direction, dtype=float)).max())

    @property
    def cell_edges(self) -> Array:
        """Evenly spaced uniform numbers between which the same row is drawn."""
        return np.arange(len(self.table) + 1) / len(self.table)

    @property
    def measured(self) -> Array:
        return self.array

    @property
    def extreme_points(self) -> Array:
        """The distinct rows."""
        return np.unique(self.array, axis=0)

    def standardised_moments(self) -> Moments | None:
        """Return the moments of a single column; None for several."""
        return None if self.size > 1 else moments_of(self.array[:, 0], self._shares)

    def cumulants(self) -> Array:
        return cumulants_of(self.array, self._shares)

    @property
    def _shares(self) -> Array:
        return np.full(len(self.array), 1 / len(self.array))

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        rows = len(self.table)
        stds = deviations(self.components, self.covariance, quantities)
        return f"{rows} measured row{'s' if rows > 1 else ''}, all equally likely, {stds}"

    def kernel_row(self) -> KernelRow:
        return KernelRow("table", self.array)

    def projection(self, weights: Array) -> Lines:
        values = (self.array - self.mean_vector) @ weights
        return Lines.of(self._shares, values, values)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the mean of exp(i t·x) over the rows."""
        t = np.asarray(frequency, dtype=float)
        return in_chunks(lambda part: np.exp(1j * (self.array @ part)).mean(axis=0), t, len(self.table))


@dataclass(frozen=True)
class JointNormal(Law):
    """Several jointly normal numbers.

    Args:
        matrix: Covariance, row by row; symmetric and positive semi-definite.
        centre: Mean (default: zero).
        bounds: Minimum and maximum of each component (infinite if unbounded), from a calibration: samples beyond are
            moved to the bound. Mean, covariance and characteristic function are those without bounds.

    Raises:
        InputError: The matrix is not square, not symmetric or not positive semi-definite, or a bound is not a pair.

    Examples:
        >>> print(pp.JointNormal(((4.0, 1.0), (1.0, 9.0))).covariance)
        [[4. 1.]
         [1. 9.]]
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    is_normal: ClassVar[bool] = True
    form: ClassVar = SheetForm(
        "joint_normal",
        {"joint_normal": {"std": ["0.1 mm", "0.2 mm"]}},
        "several numbers `.0`, `.1`, …, jointly normal; `std` their standard deviations",
        (
            LawOption("mean", "default 0", ["1 mm", "1 mm"]),
            LawOption("correlation", "rows, of joint_normal", [["1", "0.5"], ["0.5", "1"]]),
        ),
        DEVIATIONS,
    )
    matrix: tuple[tuple[float, ...], ...]
    centre: tuple[float, ...] = ()
    bounds: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        covariance = take_rows(self, "matrix", "the (square) covariance of a joint normal law")
        size = len(self.matrix)
        if covariance.shape != (size, size):
            raise InputError("the covariance of a joint normal law must be square")
        centre = check_numbers("the mean of a joint normal law", self.centre, (None,), f"{size} finite numbers")
        if centre.size not in (0, size):
            raise InputError(f"the mean of a joint normal law has {centre.size} numbers, expected {size}")
        object.__setattr__(self, "centre", tuple(centre.tolist()))
        object.__setattr__(self, "bounds", _check_bounds(self.bounds, size))
        scale = np.sqrt(np.maximum(np.diag(covariance), 0))
        slack = 1e-9 * np.outer(scale, scale)
        if (np.abs(covariance - covariance.T) > slack).any():
            raise InputError("the covariance of a joint normal law must be symmetric")
        if (np.abs(covariance) > (1 + 1e-9) * np.outer(scale, scale)).any():
            raise InputError(
                "the covariance of a joint normal law contains a negative variance or a correlation above 1"
            )
        unit = np.where(scale > 0, scale, 1.0)
        lowest = np.linalg.eigvalsh(covariance / np.outer(unit, unit)).min()
        if lowest < -1e-9:
            raise InputError(f"the covariance of a joint normal law has a negative eigenvalue ({lowest:.3g} scaled)")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> JointNormal:
        value = reader.settings["joint_normal"]
        if not (
            isinstance(value, Mapping) and set(value) == {"std"} and isinstance(value["std"], list) and value["std"]
        ):
            raise reader.error(
                ("joint_normal",), "joint_normal takes the standard deviations: joint_normal: {std: [0.1 mm, 0.2 mm]}"
            )
        std = np.array([reader.half_width("joint_normal", "std", k) for k in range(len(value["std"]))])
        centre: tuple[float, ...] = ()
        if "mean" in reader.settings:
            means = reader.settings["mean"]
            if not isinstance(means, list) or len(means) != std.size:
                raise reader.error(
                    ("mean",), f"the mean of this joint_normal must be a list of {std.size} numbers with units"
                )
            centre = tuple(reader.number("mean", k) for k in range(std.size))
        covariance = _correlation(reader, std.size) * np.outer(std, std)
        return cls(tuple(map(tuple, covariance.tolist())), centre)

    @property
    def size(self) -> int:
        return len(self.matrix)

    @property
    def components(self) -> tuple[str, ...]:
        return tuple(f".{k}" for k in range(self.size))

    @property
    def mean_vector(self) -> Array:
        return np.array(self.centre, dtype=float) if self.centre else np.zeros(self.size)

    @property
    def covariance(self) -> Array:
        return np.array(self.matrix, dtype=float)

    @property
    def root(self) -> Array:
        """Lower-triangular L with L Lᵀ the covariance; a dependent component gets a zero column."""
        return triangular_root(self.covariance)

    def sample(self, variates: Array) -> Array:
        """Return mean + L z."""
        value: Array = self.mean_vector[:, None] + self.root @ variates
        return np.clip(value, *np.array(self.bounds).T[:, :, None]) if self.bounds else value

    def support(self, direction: ArrayLike) -> float:
        """Return infinity, or w·mean if the law does not vary along w; with bounds the support of their box."""
        w = np.asarray(direction, dtype=float)
        if self.bounds:
            return float(sum(x * ends[int(x > 0)] for x, ends in zip(w, self.bounds, strict=True) if x))
        rounding = 1e-12 * float(np.abs(w) @ np.sqrt(np.diag(self.covariance)))
        return math.inf if np.abs(self.root.T @ w).max() > rounding else float(w @ self.mean_vector)

    def interval(self, number: int) -> tuple[float, float]:
        """Return mean ± 8.6 σ of the component, within its bounds."""
        check_whole("the index of a number of the law", number, 0, self.size - 1)
        mean, half_width = float(self.mean_vector[number]), FARTHEST_NORMAL * math.sqrt(self.matrix[number][number])
        low, high = self.bounds[number] if self.bounds else (-math.inf, math.inf)
        return max(mean - half_width, low), min(mean + half_width, high)

    def ellipsoid(self, k: float) -> Array:
        """Return the ellipsoid (x - mean)ᵀ Σ⁻¹ (x - mean) = k²."""
        return k * self.root

    def standardised_moments(self) -> Moments:
        return NORMAL_MOMENTS

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        covariance = self.covariance
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        unit = np.where(std > 0, std, 1.0)
        largest = float(np.abs((covariance / np.outer(unit, unit))[~np.eye(self.size, dtype=bool)]).max(initial=0.0))
        correlation_text = f"correlations up to {largest:.3g}" if largest > 1e-12 else "not correlated"
        return f"{self.size} numbers jointly normal, {deviations(self.components, covariance, quantities)}, {correlation_text}"

    def kernel_row(self) -> KernelRow:
        """Return the mean, the root of the covariance and any bounds, row by row."""
        reaches = np.abs(self.root).sum(axis=1) * FARTHEST_NORMAL
        ends = zip((self.mean_vector - reaches).tolist(), (self.mean_vector + reaches).tolist(), strict=True)
        rows = [self.mean_vector, self.root]
        if not self.bounds:
            return KernelRow("joint", np.vstack(rows), tuple(ends))
        intervals = tuple((max(a, low), min(b, high)) for (a, b), (low, high) in zip(ends, self.bounds, strict=True))
        return KernelRow("joint", np.vstack([*rows, np.array(self.bounds).T]), intervals)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return exp(i t·mean - tᵀΣt/2)."""
        t = np.asarray(frequency, dtype=float)
        quadratic = np.einsum("i...,ij,j...->...", t, self.covariance, t)
        return np.exp(1j * np.einsum("i,i...->...", self.mean_vector, t) - quadratic / 2)


def _check_bounds(bounds: object, size: int) -> tuple[tuple[float, float], ...]:
    """Return bounds, perhaps infinite, as pairs of floats."""
    if isinstance(bounds, tuple) and not bounds:
        return ()
    entries = bounds if isinstance(bounds, tuple | list) and len(bounds) == size else ()
    pairs = [pair for pair in entries if isinstance(pair, tuple | list) and len(pair) == 2]
    ends = [end for pair in pairs for end in pair]
    if len(pairs) != size or not all(isinstance(end, float | int) and not math.isnan(end) for end in ends):
        what = f"{size} pairs of a lowest and a highest value, or none"
        raise InputError(f"the bounds of a joint normal law must be {what}, got {shown(bounds)}")
    if any(low > high for low, high in pairs):
        raise InputError(f"a lower bound of a joint normal law is above the higher one: {shown(bounds)}")
    return tuple((float(low), float(high)) for low, high in pairs)


def _correlation(reader: SheetReader, size: int) -> Array:
    where = ("correlation",)
    rows = reader.settings.get("correlation", np.eye(size).tolist())
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise reader.error(where, f"correlation must be {size} rows of {size} plain numbers: [[1, …], …]")
    try:
        matrix = np.array([[units.parse(entry, units.RATIO) for entry in row] for row in rows])
    except (InputError, ValueError):  # not numbers, or rows of different lengths
        raise reader.error(where, "correlation must be rows of plain numbers") from None
    if matrix.shape != (size, size) or not (np.diag(matrix) == 1).all() or not (matrix == matrix.T).all():
        raise reader.error(
            where, f"correlation must be {size} rows of {size} numbers, symmetric, with 1 on the diagonal"
        )
    return matrix
