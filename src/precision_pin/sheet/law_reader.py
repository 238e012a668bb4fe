"""A law's settings, as a sheet spells them, to the law."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, Final, final

import numpy as np

from precision_pin import units
from precision_pin.draws.laws import (
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Fixed,
    JointNormal,
    Law,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.space import Scope
from precision_pin.errors import InputError
from precision_pin.inputs import csv_columns
from precision_pin.sheet.text import Path
from precision_pin.units import Quantity

__all__ = ["LAWS", "OPTIONS", "LawReader", "SettingError"]


@final
class SettingError(InputError):
    """Something is wrong inside a setting.

    Parameters
    ----------
    below
        Where, from the setting down.
    reason
        A message, or the error met there.
    """

    def __init__(self, below: Path, reason: str | InputError) -> None:
        super().__init__(reason if isinstance(reason, str) else reason.findings)
        self.below = below


@final
class LawReader:
    """Reads a law's settings, all numbers of one quantity, narrowing which it can be.

    Parameters
    ----------
    settings
        The law as a mapping.
    quantities
        What its numbers may be; narrowed as units are read.
    folder
        Where files are looked for.
    """

    def __init__(self, settings: Mapping[str, Any], quantities: tuple[Quantity, ...], folder: FilePath) -> None:
        self.settings = settings
        self.quantities = quantities
        self.folder = folder

    def value(self, *where: str | int) -> Any:
        """Return what stands at a place."""
        value: Any = self.settings
        for key in where:
            value = value[key]
        return value

    def number(self, *where: str | int) -> float:
        """Return the number at a place in SI."""
        value = self.value(*where)
        if isinstance(value, Mapping | list):
            raise SettingError(where, "a number with a unit belongs here")
        return self._parsed(value, where, 1)[0]

    def numbers(self, *where: str | int) -> list[float]:
        """Return the numbers at a place: a list with a unit each, or text with one unit."""
        value = self.value(*where)
        if isinstance(value, list):
            return [self.number(*where, k) for k in range(len(value))]
        if isinstance(value, Mapping):
            raise SettingError(where, "numbers with a unit belong here, such as 0.1 0.2 mm")
        return self._parsed(value, where, None)

    def half_width(self, *where: str | int) -> float:
        """Return the number at a place, which must not be negative."""
        result = self.number(*where)
        if result < 0:
            raise SettingError(where, "the half-width is negative; a tolerance is zero or more")
        return result

    def mean(self) -> float:
        """Return the mean, 0 if left out."""
        return self.number("mean") if "mean" in self.settings else 0.0

    def ratio(self, key: str, default: float) -> float:
        """Return a plain number."""
        if key not in self.settings:
            return default
        try:
            return units.parse(self.settings[key], units.RATIO)
        except InputError as error:
            raise SettingError((key,), error) from None

    def k(self) -> float:
        """Return k, positive."""
        k = self.ratio("k", 3.0)
        if not k > 0:
            raise SettingError(("k",), f"k must be positive, got {self.settings['k']}")
        return k

    def truncated(self) -> bool:
        """Return whether a normal law is cut off."""
        value = str(self.settings.get("truncated", "false")).lower()
        if value not in ("true", "false"):
            raise SettingError(("truncated",), f"truncated must be true or false, got {self.settings['truncated']!r}")
        return value == "true"

    def scope(self) -> Scope:
        """Return the scope."""
        value = self.settings.get("scope", Scope.UNIT.value)
        try:
            return Scope(value)
        except ValueError:
            allowed = ", ".join(scope.value for scope in Scope)
            raise SettingError(("scope",), f"scope must be one of {allowed}, got {value!r}") from None

    def correlation(self, size: int) -> Any:
        """Return the correlation matrix of a joint normal law."""
        rows = self.settings.get("correlation", np.eye(size).tolist())
        if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
            raise SettingError(
                ("correlation",), f"correlation must be {size} rows of {size} plain numbers: [[1, …], …]"
            )
        try:
            matrix = np.array([[units.parse(entry, units.RATIO) for entry in row] for row in rows])
        except (InputError, ValueError):  # no numbers, or rows that are not of one length
            raise SettingError(("correlation",), "correlation must be rows of plain numbers") from None
        if matrix.shape != (size, size) or not (np.diag(matrix) == 1).all() or not (matrix == matrix.T).all():
            raise SettingError(
                ("correlation",),
                f"correlation must be {size} rows of {size} numbers, symmetric, with 1 on the diagonal",
            )
        return matrix

    def file(self, *where: str | int) -> csv_columns.Measured:
        """Return the contents of the file at a place, its path relative to the folder."""
        name = self.value(*where)
        if not isinstance(name, str) or not name:
            raise SettingError(where, "the name of a CSV file belongs here")
        try:
            return csv_columns.read(self.folder / name)
        except InputError as error:
            raise SettingError(where, error) from None

    def column(self, table: csv_columns.Measured, name: str, where: Path) -> tuple[float, ...]:
        """Return a file's column in SI."""
        try:
            values = table.column(name, *self.quantities)
        except InputError as error:
            raise SettingError(where, error) from None
        self._narrow(f"1 {table.unit(name)}")
        return values

    def only(self, where: Path, *keys: str) -> None:
        """Refuse anything but a mapping of these keys at a place, with the first one."""
        value = self.value(*where)
        if not isinstance(value, Mapping) or not set(value) <= set(keys) or keys[0] not in value:
            raise SettingError(where, f"keys with values belong here: {{{', '.join(f'{key}: …' for key in keys)}}}")

    def _parsed(self, value: object, where: Path, count: int | None) -> list[float]:
        try:
            result = units.parse_vector(value, *self.quantities, count=count)
        except InputError as error:
            raise SettingError(where, error) from None
        self._narrow(value)
        return result

    def _narrow(self, value: object) -> None:
        unit = units.split(value)[1]
        self.quantities = tuple(quantity for quantity in self.quantities if unit in quantity.units)


def _uniform(reader: LawReader) -> Law:
    return Uniform(reader.half_width("uniform"), reader.mean())


def _triangular(reader: LawReader) -> Law:
    return Triangular(reader.half_width("triangular"), reader.mean())


def _arcsine(reader: LawReader) -> Law:
    return Arcsine(reader.half_width("arcsine"), reader.mean())


def _fixed(reader: LawReader) -> Law:
    return Fixed(reader.number("fixed"))


def _disc(reader: LawReader) -> Law:
    return Disc(reader.half_width("disc"))


def _circle(reader: LawReader) -> Law:
    return Circle(reader.half_width("circle"))


def _normal(reader: LawReader) -> Law:
    value, k = reader.settings["normal"], reader.k()
    if isinstance(value, Mapping):
        if set(value) != {"std"}:
            raise SettingError(
                ("normal",),
                "normal takes a half-width (normal: 0.1 mm) or a standard deviation (normal: {std: 0.03 mm})",
            )
        std = reader.half_width("normal", "std")
    else:
        std = reader.half_width("normal") / k
    mean, truncated = reader.mean(), reader.truncated()
    if isinstance(value, Mapping) and "k" in reader.settings and not truncated:
        raise SettingError(
            ("k",), "k does nothing here: {std: …} is the standard deviation itself, and nothing is cut off"
        )
    return TruncatedNormal(std, mean, k) if truncated else Normal(std, mean)


def _lognormal(reader: LawReader) -> Law:
    value = reader.settings["lognormal"]
    if not isinstance(value, Mapping) or set(value) != {"std"}:
        raise SettingError(
            ("lognormal",),
            "lognormal takes the standard deviation of the number itself: lognormal: {std: 0.1 mm}, mean: 1 mm",
        )
    if "mean" not in reader.settings:
        raise SettingError(("lognormal",), "lognormal needs a mean: of the number itself, above zero")
    std, mean = reader.half_width("lognormal", "std"), reader.mean()
    if not mean > 0:
        raise SettingError(("mean",), f"the mean of a lognormal law must be above zero, got {reader.settings['mean']}")
    return Lognormal(std, mean)


def _two_point(reader: LawReader) -> Law:
    half_width = reader.half_width("two_point")
    centre = reader.number("centre") if "centre" in reader.settings else 0.0
    probability = reader.ratio("probability", 0.5)
    if not 0 < probability < 1:
        raise SettingError(
            ("probability",), f"probability must lie above 0 and below 1, got {reader.settings['probability']}"
        )
    return TwoPoint(half_width, centre, probability)


def _empirical(reader: LawReader) -> Law:
    value = reader.settings["empirical"]
    if not isinstance(value, Mapping) or len(value) != 1 or not set(value) <= {"samples", "quantiles"}:
        raise SettingError(
            ("empirical",),
            "empirical takes samples (empirical: {samples: 0.1 0.3 0.2 mm}) or quantiles "
            "(empirical: {quantiles: [[0, -0.1 mm], [1, 0.2 mm]]}), in the sheet or as {file: gauge.csv, column: gap}",
        )
    what, given = next(iter(value.items()))
    where: Path = ("empirical", what)
    table = None
    if isinstance(given, Mapping):
        reader.only(where, "file", "column")
        table = reader.file(*where, "file")
    try:
        if what == "samples":
            return Empirical.from_samples(_column(reader, table, where) if table else reader.numbers(*where))
        if table is not None:
            values = _column(reader, table, where, "p")
            shares = LawReader({}, (units.RATIO,), reader.folder).column(table, "p", where)
            return Empirical(tuple(zip(shares, values, strict=True)))
        return Empirical(_pairs(reader, where))
    except SettingError:
        raise
    except InputError as error:
        raise SettingError(where, error) from None


def _column(reader: LawReader, table: csv_columns.Measured, where: Path, *others: str) -> tuple[float, ...]:
    """Return the column named, or the only one beside others."""
    rest = [name for name in table.names if name not in others]
    name = reader.value(*where).get("column")
    if name is None and len(rest) != 1:
        raise SettingError(where, f"{table.file} has the columns {', '.join(table.names)}: say which with column:")
    return reader.column(table, rest[0] if name is None else str(name), where)


def _pairs(reader: LawReader, where: Path) -> tuple[tuple[float, float], ...]:
    rows = reader.value(*where)
    if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise SettingError(where, "quantiles are pairs of a probability and a value: [[0, -0.1 mm], [1, 0.2 mm]]")
    shares = []
    for k, row in enumerate(rows):
        try:
            shares.append(units.parse(row[0], units.RATIO))
        except InputError as error:
            raise SettingError((*where, k), error) from None
    return tuple((share, reader.number(*where, k, 1)) for k, share in enumerate(shares))


def _rows(reader: LawReader) -> Law:
    value = reader.settings["rows"]
    if isinstance(value, Mapping):
        reader.only(("rows",), "file", "columns")
        table = reader.file("rows", "file")
        names = value.get("columns", list(table.names))
        if not isinstance(names, list) or not names:
            raise SettingError(("rows", "columns"), "a list of columns belongs here")
        columns = [reader.column(table, str(name), ("rows",)) for name in names]
        return Rows(tuple(zip(*columns, strict=True)))
    if not isinstance(value, list) or not value:
        raise SettingError(
            ("rows",), "rows takes numbers that belong together, row by row, or {file: measured.csv, columns: [a, b]}"
        )
    rows = tuple(tuple(reader.numbers("rows", k)) for k in range(len(value)))
    for k, row in enumerate(rows):
        if not row or len(row) != len(rows[0]):
            raise SettingError(("rows", k), f"{len(row)} numbers, the first row has {len(rows[0])}")
    return Rows(rows)


def _joint_normal(reader: LawReader) -> Law:
    value = reader.settings["joint_normal"]
    if (
        not isinstance(value, Mapping)
        or set(value) != {"std"}
        or not isinstance(value["std"], list)
        or not value["std"]
    ):
        raise SettingError(
            ("joint_normal",), "joint_normal takes the standard deviations: joint_normal: {std: [0.1 mm, 0.2 mm]}"
        )
    std = np.array([reader.half_width("joint_normal", "std", k) for k in range(len(value["std"]))])
    centre: tuple[float, ...] = ()
    if "mean" in reader.settings:
        means = reader.settings["mean"]
        if not isinstance(means, list) or len(means) != std.size:
            raise SettingError(("mean",), f"the mean of this joint_normal is a list of {std.size} numbers with units")
        centre = tuple(reader.number("mean", k) for k in range(std.size))
    covariance = reader.correlation(std.size) * np.outer(std, std)
    return JointNormal(tuple(map(tuple, covariance.tolist())), centre)


LAWS: Final[Mapping[str, Callable[[LawReader], Law]]] = {
    "fixed": _fixed,
    "uniform": _uniform,
    "normal": _normal,
    "triangular": _triangular,
    "lognormal": _lognormal,
    "arcsine": _arcsine,
    "two_point": _two_point,
    "empirical": _empirical,
    "disc": _disc,
    "circle": _circle,
    "joint_normal": _joint_normal,
    "rows": _rows,
}
"""The reader of every law by its key."""

OPTIONS: Final[Mapping[str, Sequence[str]]] = {
    "fixed": ("scope",),
    "uniform": ("mean", "scope"),
    "normal": ("mean", "k", "truncated", "scope"),
    "triangular": ("mean", "scope"),
    "lognormal": ("mean", "scope"),
    "arcsine": ("mean", "scope"),
    "two_point": ("centre", "probability", "scope"),
    "empirical": ("scope",),
    "disc": ("scope",),
    "circle": ("scope",),
    "joint_normal": ("mean", "correlation", "scope"),
    "rows": ("scope",),
}
"""The keys that may stand beside a law's own."""
