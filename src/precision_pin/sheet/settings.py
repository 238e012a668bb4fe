"""Parser of the text of a setting: a quantity, a law or the name of a parameter. Laws define the settings of a law."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final

from precision_pin.base import csv_columns, units
from precision_pin.base.errors import InputError, UnitError, UnknownNameError, nearest
from precision_pin.base.units import Quantity
from precision_pin.draws.draw import Draw, Scope, Setting
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.draws.laws.law import MEAN, LawOption
from precision_pin.sheet.drawing_tolerances import is_bare_number, is_tolerance, read_tolerance
from precision_pin.sheet.text import Path


class SettingError(InputError):
    """Error inside a setting."""

    def __init__(self, below: Path, reason: str | InputError) -> None:
        super().__init__(reason if isinstance(reason, str) else reason.findings)
        self.below = below


@contextmanager
def placed(*where: str | int) -> Iterator[None]:
    """Add a place to input errors that have none."""
    try:
        yield
    except SettingError:
        raise
    except InputError as error:
        raise SettingError(where, error) from None


class LawReader:
    """Reader of a law's settings, values of one quantity; :attr:`unit` is the first unit read."""

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
        """Return the numbers at a place: a list with a unit each, or text with a common unit."""
        value = self.value(*where)
        if isinstance(value, list):
            return [self.number(*where, k) for k in range(len(value))]
        if isinstance(value, Mapping):
            raise SettingError(where, "expected numbers with a unit, such as 0.1 0.2 mm")
        return self._parse(value, where, None)

    def half_width(self, *where: str | int) -> float:
        """Return the number at a place; raise if negative."""
        result = self.number(*where)
        if result < 0:
            raise SettingError(where, "the half-width is negative; a tolerance must be zero or more")
        return result

    def mean(self) -> float:
        """Return the mean (default: 0)."""
        return self.number("mean") if "mean" in self.settings else 0.0

    def ratio(self, *where: str | int) -> float:
        """Return the unitless number at a place."""
        with placed(*where):
            return units.parse(self.value(*where), units.RATIO)

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
        with placed(*where):
            return csv_columns.read(self.folder / name)

    def column(self, table: csv_columns.Measured, name: str, where: Path) -> tuple[float, ...]:
        """Return a file's column in SI."""
        with placed(*where):
            values = table.column(name, *self.quantities)
        self._narrow(f"1 {table.unit(name)}")
        return values

    def ratio_column(self, table: csv_columns.Measured, name: str, where: Path) -> tuple[float, ...]:
        """Return a file's column of unitless numbers."""
        with placed(*where):
            return table.column(name, units.RATIO)

    def only(self, where: Path, *keys: str) -> None:
        """Raise unless a place holds a mapping of these keys; the first is required."""
        value = self.value(*where)
        if not isinstance(value, Mapping) or not set(value) <= set(keys) or keys[0] not in value:
            raise SettingError(where, f"expected keys with values: {{{', '.join(f'{key}: …' for key in keys)}}}")

    def error(self, where: Path, reason: str) -> SettingError:
        """Return an error at a place."""
        return SettingError(where, reason)

    def place_errors(self, where: Path) -> AbstractContextManager[None]:
        """Add a place to input errors that have none."""
        return placed(*where)

    def _parse(self, value: object, where: Path, count: int | None) -> list[float]:
        with placed(*where):
            result = units.parse_vector(value, *self.quantities, count=count)
        self._narrow(value)
        return result

    def _narrow(self, value: object) -> None:
        unit = units.split(value)[1]
        self.unit = self.unit or unit
        self.quantities = tuple(quantity for quantity in self.quantities if unit in quantity.units)


NAME: Final = re.compile(r"[^\W\d][\w.\[\]#-]*")
"""Name of a parameter: no leading digit, as numbers have, and no spaces or signs; brackets occur in names of draws."""
_HERE: Final = FilePath()
"""The current folder, the default base of file names."""


@dataclass(frozen=True)
class NamedParameter:
    """A draw of the sheet's ``parameters``, and the quantities that fit its unit."""

    draw: Draw
    quantities: tuple[Quantity, ...]


@dataclass(frozen=True)
class Context:
    """Context for validating a source's settings.

    Attributes:
        named: The sheet's parameters, by the names of their components.
        prismatic: Whether each joint is prismatic, by name.
        folder: Base folder of file names.
        size: Nominal size of the source's deviations, m; None if unknown.
    """

    named: Mapping[str, NamedParameter]
    prismatic: Mapping[str, bool]
    folder: FilePath
    size: float | None = None


def parse_number(value: object, quantities: Sequence[Quantity]) -> float:
    """Return a quantity in SI; laws are rejected."""
    if isinstance(value, Mapping) or is_tolerance(value):
        raise InputError("expected a plain quantity, not a law or a tolerance")
    return units.parse(value, *quantities)


def parse_setting(value: object, quantities: Sequence[Quantity], context: Context) -> Setting:
    """Return a setting: a number in SI, an unnamed draw, or a parameter's name."""
    parameters = context.named
    law = None if isinstance(value, str) and value.strip() in parameters else as_law(value)
    if law is not None:
        parameter = parse_law("", law, quantities, context.folder, context.size)
        if parameter.draw.law.size != 1:
            raise InputError("a law of several numbers must be named under parameters: and used by component")
        return parameter.draw
    if isinstance(value, str) and NAME.fullmatch(value.strip()):
        name = value.strip()
        if name not in parameters:
            if name[0].isupper() and is_tolerance(name, is_in_law=True):
                raise InputError(f"there is no parameter {name}; the class of ISO 286 is written '50 mm {name}'")
            raise UnknownNameError("parameter", name, parameters)
        if not set(parameters[name].quantities) & set(quantities):
            expected = " or ".join(quantity.name for quantity in quantities)
            actual = " or ".join(quantity.name for quantity in parameters[name].quantities)
            raise UnitError(f"the parameter {name!r} is a {actual}; expected a {expected}")
        return name
    try:
        return units.parse(value, *quantities)
    except UnitError as error:
        if not is_bare_number(value):
            raise
        message = error.findings[0].message
        more = f"with a unit it is a constant, the same in every robot; with ±, as '±{value} UNIT', it is a tolerance"
        raise UnitError(f"{message}; {more}") from None


def as_law(value: object) -> Mapping[str, Any] | None:
    """Return a law as a mapping, a tolerance such as ``±0.02 deg`` as a uniform one; ``None`` for anything else."""
    return value if isinstance(value, Mapping) else {"uniform": value} if is_tolerance(value) else None


def parse_parameter(name: str, value: object, quantities: Sequence[Quantity], folder: FilePath) -> NamedParameter:
    """Return a named parameter: a law, or a tolerance as text."""
    law = as_law(value)
    if law is None:
        raise InputError(
            "expected a law, such as {uniform: 0.1 mm}, or a tolerance, such as ±0.1 mm; write a number that does not vary as "
            f"{{fixed: 0.1 mm}}{units.comma_hint(value)}"
        )
    return parse_law(name, law, quantities, folder)


def parse_law(
    name: str,
    value: Mapping[str, Any],
    quantities: Sequence[Quantity],
    folder: FilePath = _HERE,
    size: float | None = None,
) -> NamedParameter:
    """Return the draw of a law written as a mapping with one law key; file names are relative to the folder.

    ``size`` is the nominal size, m, for a class of ISO 286 or ISO 2768 without one.
    """
    laws = laws_of_sheets()
    law_keys = [key for key in value if key in laws]
    if len(law_keys) != 1:
        fault = f"has {', '.join(law_keys)}" if law_keys else "has none"
        unknown = next((key for key in value if key not in laws and key not in law_options()), None)
        if not law_keys and unknown is not None:
            fault += f" ({unknown!r}: {nearest(unknown, laws)})"
        raise InputError(f"a law needs exactly one of {', '.join(laws)}; this one {fault}")
    key = law_keys[0]
    options = law_options(key)
    for other in value:
        if other != key and other not in options:
            # YAML reads {uniform: 0,05 mm} as {uniform: 0} and a key "05 mm"
            comma = f"{value[key]},{other}" if value[other] in (None, "") else ""
            hint = units.comma_hint(comma) or f": {nearest(other, options)}"
            raise SettingError((other,), f"{other!r} is no setting of the law {key}{hint}")
    value, limits = _with_limits(key, value, quantities, size)
    reader = LawReader(value, tuple(quantities), folder)
    scope = reader.scope()
    law = laws[key].from_sheet(reader)
    draw_quantities = (reader.quantities[0].written_in(reader.unit),) * law.size if len(reader.quantities) == 1 else ()
    return NamedParameter(Draw(name, law, scope, draw_quantities, limits=limits), reader.quantities)


def _with_limits(
    key: str, value: Mapping[str, Any], quantities: Sequence[Quantity], size: float | None
) -> tuple[Mapping[str, Any], str]:
    """Return a law with the tolerance of a drawing replaced by half-width and mean; and its limits, or an empty text."""
    text = value[key]
    if not is_tolerance(text, is_in_law=True) or MEAN not in laws_of_sheets()[key].form.options:
        if SIZE.key in value:
            raise SettingError(
                (SIZE.key,), f"size is that of a class, as in {{uniform: H7, size: 50 mm}}; {text!r} is none"
            )
        return value, ""
    with placed(SIZE.key):
        stated_size = units.parse(value[SIZE.key], units.LENGTH) if SIZE.key in value else None
    with placed(key):
        tolerance = read_tolerance(text, quantities, stated_size, size)
    mean = {"mean": tolerance.mean} if tolerance.mean else {}
    if mean and "mean" in value:
        raise SettingError(("mean",), f"{text!r} gives the mean, {tolerance.mean}; a nominal size stands before it")
    others = {option: entry for option, entry in value.items() if option != SIZE.key}
    return others | {key: tolerance.half_width} | mean, tolerance.limits


SIZE: Final = LawOption("size", "nominal size of a class of ISO 286 or 2768; of an angle its shorter side", "50 mm")
"""Option of every law that is symmetric about its mean."""


def law_options(*keys: str) -> tuple[str, ...]:
    """Return the further keys of laws (default: of all laws), including ``size`` and ``scope``."""
    laws = laws_of_sheets()
    options = [option for key in keys or laws for option in laws[key].form.options]
    return (*dict.fromkeys(option.key for option in options), *([SIZE.key] if MEAN in options else []), "scope")
