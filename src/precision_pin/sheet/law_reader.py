"""Reader of the settings of a law: numbers with units, and files. The law itself defines its settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import Any, final

from precision_pin.base import csv_columns, units
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.draws.draw import Scope
from precision_pin.sheet.text import Path


@final
class SettingError(InputError):
    """Error inside a setting.

    Parameters
    ----------
    below
        Path from the setting down to the error.
    reason
        A message, or the error raised there.
    """

    def __init__(self, below: Path, reason: str | InputError) -> None:
        super().__init__(reason if isinstance(reason, str) else reason.findings)
        self.below = below


@final
class LawReader:
    """Reader of a law's settings, whose numbers all have one quantity; :attr:`unit` is the first unit read.

    Parameters
    ----------
    settings
        The law as a mapping.
    quantities
        Possible quantities of the numbers; each unit that is read narrows them down.
    folder
        The folder that file names are relative to.
    """

    def __init__(self, settings: Mapping[str, Any], quantities: tuple[Quantity, ...], folder: FilePath) -> None:
        self.settings = settings
        self.quantities = quantities
        self.folder = folder
        self.unit = ""

    def value(self, *where: str | int) -> Any:
        """Return the value at a place."""
        value: Any = self.settings
        for key in where:
            value = value[key]
        return value

    def number(self, *where: str | int) -> float:
        """Return the number at a place in SI."""
        value = self.value(*where)
        if isinstance(value, Mapping | list):
            raise SettingError(where, "expected a number with a unit")
        return self._parse(value, where, 1)[0]

    def numbers(self, *where: str | int) -> list[float]:
        """Return the numbers at a place: a list with a unit for each, or text with one unit for all."""
        value = self.value(*where)
        if isinstance(value, list):
            return [self.number(*where, k) for k in range(len(value))]
        if isinstance(value, Mapping):
            raise SettingError(where, "expected numbers with a unit, such as 0.1 0.2 mm")
        return self._parse(value, where, None)

    def half_width(self, *where: str | int) -> float:
        """Return the number at a place, which must not be negative."""
        result = self.number(*where)
        if result < 0:
            raise SettingError(where, "the half-width is negative; a tolerance must be zero or more")
        return result

    def mean(self) -> float:
        """Return the mean, 0 if left out."""
        return self.number("mean") if "mean" in self.settings else 0.0

    def ratio(self, *where: str | int) -> float:
        """Return the number without a unit at a place."""
        try:
            return units.parse(self.value(*where), units.RATIO)
        except InputError as error:
            raise SettingError(where, error) from None

    def scope(self) -> Scope:
        """Return the scope."""
        value = self.settings.get("scope", Scope.UNIT.value)
        try:
            return Scope(value)
        except ValueError:
            allowed = ", ".join(scope.value for scope in Scope)
            raise SettingError(("scope",), f"scope must be one of {allowed}, got {value!r}") from None

    def file(self, *where: str | int) -> csv_columns.Measured:
        """Return the contents of the file at a place, its path relative to the folder."""
        name = self.value(*where)
        if not isinstance(name, str) or not name:
            raise SettingError(where, "expected the name of a CSV file")
        try:
            return csv_columns.read(self.folder / name)
        except InputError as error:
            raise SettingError(where, error) from None

    def column(self, table: csv_columns.Measured, name: str, where: Path) -> tuple[float, ...]:
        """Return a file's column in SI."""
        with self.place_errors(where):
            values = table.column(name, *self.quantities)
        self._narrow(f"1 {table.unit(name)}")
        return values

    def ratio_column(self, table: csv_columns.Measured, name: str, where: Path) -> tuple[float, ...]:
        """Return a file's column of numbers without a unit."""
        with self.place_errors(where):
            return table.column(name, units.RATIO)

    def only(self, where: Path, *keys: str) -> None:
        """Refuse anything but a mapping of these keys at a place; the first key is required."""
        value = self.value(*where)
        if not isinstance(value, Mapping) or not set(value) <= set(keys) or keys[0] not in value:
            raise SettingError(where, f"expected keys with values: {{{', '.join(f'{key}: …' for key in keys)}}}")

    def error(self, where: Path, reason: str) -> SettingError:
        """Return an error at a place."""
        return SettingError(where, reason)

    @contextmanager
    def place_errors(self, where: Path) -> Iterator[None]:
        """Add a place to input errors that have none."""
        try:
            yield
        except SettingError:
            raise
        except InputError as error:
            raise SettingError(where, error) from None

    def _parse(self, value: object, where: Path, count: int | None) -> list[float]:
        try:
            result = units.parse_vector(value, *self.quantities, count=count)
        except InputError as error:
            raise SettingError(where, error) from None
        self._narrow(value)
        return result

    def _narrow(self, value: object) -> None:
        unit = units.split(value)[1]
        self.unit = self.unit or unit
        self.quantities = tuple(quantity for quantity in self.quantities if unit in quantity.units)
