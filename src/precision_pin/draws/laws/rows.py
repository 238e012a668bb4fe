"""The law of rows of a table, all equally likely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_items, shown
from precision_pin.base.array_checks import returns_read_only
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import Law, take_rows
from precision_pin.draws.laws.numerics import Moments, cumulants_of, in_chunks, moments_of
from precision_pin.draws.laws.projection import Lines
from precision_pin.draws.laws.sheet_form import SheetForm, SheetReader
from precision_pin.draws.laws.wording import deviations

_FILE: Final[Mapping[str, Any]] = {
    "type": "object",
    "properties": {"file": {"type": "string"}, "columns": {"type": "array"}},
    "required": ["file"],
    "additionalProperties": False,
}
_SCHEMA: Final[Mapping[str, Any]] = {"anyOf": [{"type": "array", "minItems": 1}, _FILE]}


@final
@dataclass(frozen=True)
class Rows(Law):
    """Several numbers that were measured together: the rows of a table, all equally likely.

    Parameters
    ----------
    table
        The rows, all of one length.
    names
        Names of the columns; numbered from 0 if left out.

    Raises
    ------
    InputError
        No rows, rows of different lengths, a number that is not finite, or names that do not fit.
    """

    form: ClassVar = SheetForm(
        "rows",
        {"rows": [["0.1 mm", "0.2 mm"], ["0 mm", "-0.1 mm"]]},
        "several numbers `.0`, `.1`, … that were measured together: one of the rows, all equally likely",
        schema=_SCHEMA,
    )
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
        """Return the law written in a sheet."""
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
                ("rows",),
                "rows takes rows of numbers that belong together, or {file: measured.csv, columns: [a, b]}",
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
        """The number of columns."""
        return len(self.table[0])

    @property
    def components(self) -> tuple[str, ...]:
        """The names, or numbers from 0."""
        return tuple(f".{name}" for name in self.names or range(self.size))

    @property
    def mean_vector(self) -> Array:
        """Mean of the rows, ``(size,)``."""
        mean: Array = self.array.mean(axis=0)
        return mean

    @property
    def covariance(self) -> Array:
        """Covariance ``(size, size)`` of the rows as the whole population: divided by their number, not by one less."""
        centred = self.array - self.mean_vector
        value: Array = centred.T @ centred / len(self.table)
        return value

    def sample(self, variates: Array) -> Array:
        """Return row ⌊u₀ n⌋ of n; the other uniform numbers are not used."""
        chosen = np.floor(variates[0] * len(self.table)).astype(np.intp)
        value: Array = self.array[chosen].T
        return value

    def support(self, direction: ArrayLike) -> float:
        """Return the largest w·x of the rows."""
        return float((self.array @ np.asarray(direction, dtype=float)).max())

    @property
    def cell_edges(self) -> Array:
        """Uniform numbers between which one row is drawn, all equally far apart."""
        edges: Array = np.arange(len(self.table) + 1) / len(self.table)
        return edges

    @property
    def measured(self) -> Array:
        """The rows."""
        return self.array

    @property
    def extreme_points(self) -> Array:
        """The rows, each once."""
        return np.unique(self.array, axis=0)

    def standardised_moments(self) -> Moments | None:
        """Return the moments of a single column; None for several."""
        return None if self.size > 1 else moments_of(self.array[:, 0], self._shares)

    def cumulants(self) -> Array:
        """Return the cumulants of the rows."""
        return cumulants_of(self.array, self._shares)

    @property
    def _shares(self) -> Array:
        return np.full(len(self.array), 1 / len(self.array))

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        rows = len(self.table)
        stds = deviations(self.components, self.covariance, quantities)
        return f"{rows} measured row{'s' if rows > 1 else ''}, all equally likely, {stds}"

    @property
    def streamed(self) -> range:
        """The first variate, which selects the row."""
        return range(1)

    def kernel_row(self) -> KernelRow:
        """Return the rows."""
        return KernelRow("table", self.array)

    def projection(self, weights: Array) -> Lines:
        """Return the projection on weights."""
        values = (self.array - self.mean_vector) @ weights
        return Lines.of(np.full(values.size, 1 / values.size), values, values)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the mean of exp(i t·x) over the rows."""
        t = np.asarray(frequency, dtype=float)
        return in_chunks(lambda part: np.exp(1j * (self.array @ part)).mean(axis=0), t, len(self.table))
