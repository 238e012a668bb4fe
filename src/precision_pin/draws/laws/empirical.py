"""The empirical law, a table of quantiles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, cast, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import units
from precision_pin.base.arguments import check_numbers
from precision_pin.base.array_checks import returns_read_only
from precision_pin.base.arrays import Array
from precision_pin.base.csv_columns import Measured
from precision_pin.base.errors import InputError
from precision_pin.base.memory import check_memory
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.bases import BoundedLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import take_rows
from precision_pin.draws.laws.numerics import cumulants_of, in_chunks
from precision_pin.draws.laws.projection import Lines
from precision_pin.draws.laws.sheet_form import Place, SheetForm, SheetReader
from precision_pin.draws.laws.wording import spread
from precision_pin.render.display_units import WrittenUnit

_BYTES: Final = 300.0
"""Memory for each sample, as tuples and as arrays."""

_FILE: Final[Mapping[str, Any]] = {
    "type": "object",
    "properties": {"file": {"type": "string"}, "column": {"type": "string"}},
    "required": ["file"],
    "additionalProperties": False,
}
_SCHEMA: Final[Mapping[str, Any]] = {
    "type": "object",
    "properties": {
        "samples": {"anyOf": [{"type": "string"}, {"type": "array"}, _FILE]},
        "quantiles": {"anyOf": [{"type": "array"}, _FILE]},
    },
    "minProperties": 1,
    "maxProperties": 1,
    "additionalProperties": False,
}


@final
@dataclass(frozen=True)
class Empirical(BoundedLaw):
    """A measured distribution: a table of quantiles with straight lines between them.

    Attributes
    ----------
    quantiles
        ``(p, x)``: with probability p the number is at most x. From p = 0 to p = 1; neither p nor x ever falls. A p given
        twice is a gap without values; an x given twice is a value with a probability of its own.

    Raises
    ------
    InputError
        A table that does not begin at p = 0, end at p = 1 or rise.
    """

    form: ClassVar = SheetForm(
        "empirical",
        {"empirical": {"samples": "0.11 0.13 0.12 mm"}},
        "a measured distribution: `samples` or `quantiles`, in the sheet or from a file",
        schema=_SCHEMA,
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
        for k in (np.flatnonzero((np.diff(p) < 0) | (np.diff(x) < 0))[:1] + 1).tolist():
            for what, values in (("probability", p), ("value", x)):
                if values[k] < values[k - 1]:
                    raise InputError(
                        f"the quantiles of an empirical law must rise, but the {what} {values[k]:g} follows {values[k - 1]:g}"
                    )

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Empirical:
        """Return the law written in a sheet, from samples or quantiles."""
        value = reader.settings["empirical"]
        if not isinstance(value, Mapping) or len(value) != 1 or not set(value) <= {"samples", "quantiles"}:
            raise reader.error(
                ("empirical",),
                "empirical takes samples (empirical: {samples: 0.1 0.3 0.2 mm}) or quantiles "
                "(empirical: {quantiles: [[0, -0.1 mm], [1, 0.2 mm]]}), in the sheet or as {file: gauge.csv, column: gap}",
            )
        what, given = next(iter(value.items()))
        where: Place = ("empirical", what)
        table = None
        if isinstance(given, Mapping):
            reader.only(where, "file", "column")
            table = reader.file(*where, "file")
        with reader.place_errors(where):
            if what == "samples":
                return cls.from_samples(_column(reader, table, where) if table else reader.numbers(*where))
            if table is not None:
                values = _column(reader, table, where, "p")
                return cls(tuple(zip(reader.ratio_column(table, "p", where), values, strict=True)))
            return cls(_pairs(reader, where))

    @classmethod
    def from_samples(cls, samples: Iterable[float]) -> Empirical:
        """Return the law of n samples, with the k-th smallest as the quantile at (k - 1/2)/n (Hazen).

        Half of the probability of the smallest and of the largest sample stays at that sample, which keeps the samples' mean.

        Raises
        ------
        InputError
            No sample, or one that is not finite.
        """
        if isinstance(samples, Iterable) and not isinstance(samples, str | bytes | np.ndarray):
            samples = list(samples)
        x = check_numbers("the samples of an empirical law", samples, (None,), "a list of finite numbers")
        check_memory(_BYTES * x.size, f"an empirical law of {x.size:,} samples", "give fewer, or its quantiles")
        x = np.sort(x)
        if not x.size:
            raise InputError("an empirical law needs at least one sample")
        p = np.concatenate([[0.0], (np.arange(x.size) + 0.5) / x.size, [1.0]])
        return cls(cast("Any", np.column_stack([p, np.concatenate([x[:1], x, x[-1:]])])))

    @property
    def sample_count(self) -> int | None:
        """Number of samples behind the law; None if :meth:`from_samples` would not make this table."""
        p, x = self._knots
        count = p.size - 2
        if count < 1 or x[0] != x[1] or x[-1] != x[-2]:
            return None
        return count if np.array_equal(p[1:-1], (np.arange(count) + 0.5) / count) else None

    @cached_property
    @returns_read_only
    def _knots(self) -> tuple[Array, Array]:
        table = np.array(self.quantiles, dtype=float)
        return table[:, 0].copy(), table[:, 1].copy()

    @cached_property
    @returns_read_only
    def segments(self) -> Array:
        """The straight lines ``(s, 4)``: probability and value at the begin of each, its slope, the value at its end."""
        p, x = self._knots
        step = np.diff(p)
        slopes = np.divide(np.diff(x), step, out=np.zeros_like(step), where=step > 0)
        lines: Array = np.column_stack([p[:-1], x[:-1], slopes, x[1:]])[step > 0]
        return lines

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""
        return float(self.segments[0, 1]), float(self.segments[-1, 3])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Probabilities between 0 and 1 at which two lines meet."""
        return tuple(self.segments[1:, 0].tolist())

    @property
    def mean_vector(self) -> Array:
        """Mean, ``(1,)``."""
        return np.array([self._shares @ (self.segments[:, 1] + self.segments[:, 3]) / 2])

    @property
    def covariance(self) -> Array:
        """Variance as ``(1, 1)``."""
        a, b = self.segments[:, 1] - self.mean_vector, self.segments[:, 3] - self.mean_vector
        return np.array([[self._shares @ (a * a + a * b + b * b) / 3]])

    def sample(self, variates: Array) -> Array:
        """Return the quantiles at u, by straight lines."""
        begin, value, slope, end = self.segments.T
        k = np.searchsorted(begin, variates, side="right") - 1
        result: Array = np.minimum(value[k] + slope[k] * (variates - begin[k]), end[k])
        return result

    @property
    def cell_edges(self) -> Array:
        """Probabilities at which the lines begin, and 1."""
        return np.append(self.segments[:, 0], 1.0)

    @property
    def lines(self) -> Array:
        """The segments."""
        return self.segments

    @property
    def measured(self) -> Array | None:
        """The samples; None if :meth:`from_samples` would not make this table."""
        return np.array(self.quantiles[1:-1], dtype=float)[:, 1:] if self.sample_count is not None else None

    def cumulants(self) -> Array:
        """Return the cumulants of the lines, by Gauss-Legendre quadrature with four nodes, which is exact."""
        begin, value, _, end = self.segments.T
        nodes, weights = np.polynomial.legendre.leggauss(4)
        middles = (1 + nodes[:, None]) / 2
        values = (value + middles * (end - value)).reshape(-1, 1)
        return cumulants_of(values, (weights[:, None] / 2 * np.diff(np.append(begin, 1.0))).ravel())

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        low, high = self.ends
        unit = WrittenUnit.suiting(quantities[0], self.ends)
        far = spread(self.mean_vector, self.covariance, quantities[0])
        return f"measured: {len(self.quantiles)} quantiles from {unit(low)} to {unit(high)}{far}"

    def kernel_row(self) -> KernelRow:
        """Return the straight lines."""
        return KernelRow("empirical", self.segments)

    def projection(self, weights: Array) -> Lines:
        """Return the projection on weights."""
        w = float(weights[0])
        begins, stops = (w * (self.segments[:, column] - self.mean_vector) for column in (1, 3))
        return Lines.of(np.diff(np.append(self.segments[:, 0], 1.0)), begins, stops)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return Σ Δp exp(i t (a + b)/2) sin(t (b - a)/2)/(t (b - a)/2) over the lines from a to b, t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)
        a, b = self.segments[:, 1], self.segments[:, 3]

        def of(part: Array) -> NDArray[np.complex128]:
            line = part[0][:, None]
            value: NDArray[np.complex128] = (
                np.exp(1j * line * ((a + b) / 2)) * np.sinc(line * ((b - a) / (2 * np.pi)))
            ) @ self._shares
            return value

        return in_chunks(of, t, 4 * a.size)

    @cached_property
    def _shares(self) -> Array:
        return np.diff(np.append(self.segments[:, 0], 1.0))


def _column(reader: SheetReader, table: Measured, where: Place, *others: str) -> tuple[float, ...]:
    """Return the named column, or the only one besides ``others``."""
    rest = [name for name in table.names if name not in others]
    name = reader.value(*where).get("column")
    if name is None and len(rest) != 1:
        raise reader.error(where, f"{table.file} has the columns {', '.join(table.names)}: choose one with column:")
    return reader.column(table, rest[0] if name is None else str(name), where)


def _pairs(reader: SheetReader, where: Place) -> tuple[tuple[float, float], ...]:
    rows = reader.value(*where)
    if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise reader.error(where, "quantiles must be pairs of a probability and a value: [[0, -0.1 mm], [1, 0.2 mm]]")
    shares = []
    for k, row in enumerate(rows):
        with reader.place_errors((*where, k)):
            shares.append(units.parse(row[0], units.RATIO))
    return tuple((share, reader.number(*where, k, 1)) for k, share in enumerate(shares))
