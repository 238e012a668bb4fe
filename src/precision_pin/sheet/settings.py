"""A setting's text to what a source takes: a quantity, a law or a parameter's name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin import units
from precision_pin.errors import InputError, UnitError, UnknownNameError, nearest
from precision_pin.laws import Circle, Disc, Fixed, JointNormal, Law, Normal, Triangular, TruncatedNormal, Uniform
from precision_pin.sheet.text import Path
from precision_pin.space import Draw, Scope, Setting
from precision_pin.units import Quantity

__all__ = ["LAW_KEYS", "OPTION_KEYS", "NamedParameter", "SettingError", "parse_law", "parse_number", "parse_setting"]

NAME: Final = re.compile(r"[^\W\d][\w.\[\]#-]*")
LAW_KEYS: Final = ("fixed", "uniform", "normal", "triangular", "disc", "circle", "joint_normal")
OPTION_KEYS: Final = ("mean", "k", "truncated", "correlation", "scope")
_OPTIONS: Final = {
    "fixed": ("scope",),
    "uniform": ("mean", "scope"),
    "normal": ("mean", "k", "truncated", "scope"),
    "triangular": ("mean", "scope"),
    "disc": ("scope",),
    "circle": ("scope",),
    "joint_normal": ("mean", "correlation", "scope"),
}


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
@dataclass(frozen=True)
class NamedParameter:
    """A draw of the sheet's ``parameters``, and the quantities that its unit fits.

    Attributes
    ----------
    draw
        The draw.
    quantities
        What it may be used for.
    """

    draw: Draw
    quantities: tuple[Quantity, ...]


def parse_number(value: object, quantities: Sequence[Quantity]) -> float:
    """Return a quantity in SI, refusing laws.

    Raises
    ------
    InputError
        A law, a name, or a wrong number.
    """
    if isinstance(value, Mapping):
        raise InputError("a plain quantity belongs here, not a law")
    return units.parse(value, *quantities)


def parse_setting(value: object, quantities: Sequence[Quantity], named: Mapping[str, NamedParameter]) -> Setting:
    """Return a setting: a number in SI, an unnamed draw, or a parameter's name.

    Parameters
    ----------
    value
        Text or a law as a mapping.
    quantities
        What may stand here.
    named
        The sheet's parameters by the name of each of their numbers.

    Raises
    ------
    InputError
        Malformed, in the wrong unit, or naming a parameter of another quantity.
    UnknownNameError
        A name that is no parameter.
    """
    if isinstance(value, Mapping):
        parameter = parse_law("", value, quantities)
        if parameter.draw.law.size != 1:
            raise InputError("a law of several numbers must be named under parameters: and used by component")
        return parameter.draw
    if isinstance(value, str) and NAME.fullmatch(value.strip()):
        name = value.strip()
        if name not in named:
            raise UnknownNameError("parameter", name, named)
        if not set(named[name].quantities) & set(quantities):
            wanted = " or ".join(quantity.name for quantity in quantities)
            is_one = " or ".join(quantity.name for quantity in named[name].quantities)
            raise UnitError(f"the parameter {name!r} is a {is_one}, but a {wanted} belongs here")
        return name
    return units.parse(value, *quantities)


def parse_law(name: str, value: Mapping[str, Any], quantities: Sequence[Quantity]) -> NamedParameter:
    """Return the draw of a law written as a mapping with one law key.

    Raises
    ------
    InputError
        No law key or several, an unknown key, or a bad number; a :class:`SettingError` where one key is at fault.
    """
    found = [key for key in value if key in LAW_KEYS]
    if len(found) != 1:
        given = f"has {', '.join(found)}" if found else "has none"
        unknown = next((key for key in value if key not in LAW_KEYS and key not in OPTION_KEYS), None)
        if not found and unknown is not None:
            given += f" ({unknown!r}: {nearest(unknown, LAW_KEYS)})"
        raise InputError(f"a law needs exactly one of {', '.join(LAW_KEYS)}; this one {given}")
    key = found[0]
    for other in value:
        if other != key and other not in _OPTIONS[key]:
            raise SettingError((other,), f"{other!r} is no setting of the law {key}: {nearest(other, _OPTIONS[key])}")
    reader = _Reader(value, tuple(quantities))
    scope = reader.scope()
    law = _LAWS[key](reader)
    return NamedParameter(Draw(name, law, scope), reader.quantities)


@final
class _Reader:
    """Reads a law's settings, all numbers of one quantity, narrowing which it can be."""

    def __init__(self, settings: Mapping[str, Any], quantities: tuple[Quantity, ...]) -> None:
        self.settings = settings
        self.quantities = quantities

    def number(self, *where: str | int) -> float:
        value: Any = self.settings
        for key in where:
            value = value[key]
        if isinstance(value, Mapping | list):
            raise SettingError(where, "a number with a unit belongs here")
        try:
            result = units.parse(value, *self.quantities)
        except InputError as error:
            raise SettingError(where, error) from None
        unit = units.split(value)[1]
        self.quantities = tuple(quantity for quantity in self.quantities if unit in quantity.units)
        return result

    def half_width(self, *where: str | int) -> float:
        result = self.number(*where)
        if result < 0:
            raise SettingError(where, "the half-width is negative; a tolerance is zero or more")
        return result

    def mean(self) -> float:
        return self.number("mean") if "mean" in self.settings else 0.0

    def k(self) -> float:
        if "k" not in self.settings:
            return 3.0
        try:
            k = units.parse(self.settings["k"], units.RATIO)
        except InputError as error:
            raise SettingError(("k",), error) from None
        if not k > 0:
            raise SettingError(("k",), f"k must be positive, got {self.settings['k']}")
        return k

    def truncated(self) -> bool:
        value = str(self.settings.get("truncated", "false")).lower()
        if value not in ("true", "false"):
            raise SettingError(("truncated",), f"truncated must be true or false, got {self.settings['truncated']!r}")
        return value == "true"

    def scope(self) -> Scope:
        value = self.settings.get("scope", Scope.UNIT.value)
        try:
            return Scope(value)
        except ValueError:
            allowed = ", ".join(scope.value for scope in Scope)
            raise SettingError(("scope",), f"scope must be one of {allowed}, got {value!r}") from None

    def correlation(self, size: int) -> Any:
        rows = self.settings.get("correlation", np.eye(size).tolist())
        if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
            raise SettingError(
                ("correlation",), f"correlation must be {size} rows of {size} plain numbers: [[1, …], …]"
            )
        try:
            matrix = np.array([[float(entry) for entry in row] for row in rows])
        except (TypeError, ValueError):
            raise SettingError(("correlation",), "correlation must be rows of plain numbers") from None
        if matrix.shape != (size, size) or not (np.diag(matrix) == 1).all() or not (matrix == matrix.T).all():
            raise SettingError(
                ("correlation",),
                f"correlation must be {size} rows of {size} numbers, symmetric, with 1 on the diagonal",
            )
        return matrix


def _uniform(reader: _Reader) -> Law:
    return Uniform(reader.half_width("uniform"), reader.mean())


def _triangular(reader: _Reader) -> Law:
    return Triangular(reader.half_width("triangular"), reader.mean())


def _fixed(reader: _Reader) -> Law:
    return Fixed(reader.number("fixed"))


def _disc(reader: _Reader) -> Law:
    return Disc(reader.half_width("disc"))


def _circle(reader: _Reader) -> Law:
    return Circle(reader.half_width("circle"))


def _normal(reader: _Reader) -> Law:
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
    mean = reader.mean()
    return TruncatedNormal(std, mean, k) if reader.truncated() else Normal(std, mean)


def _joint_normal(reader: _Reader) -> Law:
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


_LAWS: Final = {
    "fixed": _fixed,
    "uniform": _uniform,
    "normal": _normal,
    "triangular": _triangular,
    "disc": _disc,
    "circle": _circle,
    "joint_normal": _joint_normal,
}
