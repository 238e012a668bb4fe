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
from precision_pin.space import Draw, Scope, Setting
from precision_pin.units import Quantity

__all__ = ["LAW_KEYS", "OPTION_KEYS", "NamedParameter", "parse_law", "parse_number", "parse_setting"]

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
        No law key or several, an unknown key, or a bad number.
    """
    found = [key for key in value if key in LAW_KEYS]
    if len(found) != 1:
        given = f"has {', '.join(found)}" if found else "has none"
        if not found and value:
            given += f" ({nearest(next(iter(value)), LAW_KEYS)})"
        raise InputError(f"a law needs exactly one of {', '.join(LAW_KEYS)}; this one {given}")
    key = found[0]
    for other in value:
        if other != key and other not in _OPTIONS[key]:
            raise InputError(f"{other!r} is no setting of the law {key}: {nearest(other, _OPTIONS[key])}")
    scope = _scope(value.get("scope", Scope.UNIT.value))
    reader = _Reader(tuple(quantities))
    law = _LAWS[key](reader, value[key], value)
    return NamedParameter(Draw(name, law, scope), reader.quantities)


class _Reader:
    """Reads numbers that must be of one quantity, narrowing which it can be."""

    def __init__(self, quantities: tuple[Quantity, ...]) -> None:
        self.quantities = quantities

    def number(self, value: object) -> float:
        if isinstance(value, Mapping | list):
            raise InputError("a number with a unit belongs here")
        result = units.parse(value, *self.quantities)
        unit = units.split(value)[1]
        self.quantities = tuple(quantity for quantity in self.quantities if unit in quantity.units)
        return result

    def half_width(self, value: object) -> float:
        result = self.number(value)
        if result < 0:
            raise InputError(f"{value} is negative; a tolerance is a half-width of zero or more")
        return result


def _uniform(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    return Uniform(reader.half_width(value), _mean(reader, options))


def _triangular(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    return Triangular(reader.half_width(value), _mean(reader, options))


def _fixed(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    del options
    return Fixed(reader.number(value))


def _disc(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    del options
    return Disc(reader.half_width(value))


def _circle(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    del options
    return Circle(reader.half_width(value))


def _normal(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    k = units.parse(options.get("k", "3"), units.RATIO)
    if not k > 0:
        raise InputError(f"k must be positive, got {options['k']}")
    if isinstance(value, Mapping):
        if set(value) != {"std"}:
            raise InputError(
                "normal takes a half-width (normal: 0.1 mm) or a standard deviation (normal: {std: 0.03 mm})"
            )
        std = reader.half_width(value["std"])
    else:
        std = reader.half_width(value) / k
    mean = _mean(reader, options)
    truncated = str(options.get("truncated", "false")).lower()
    if truncated not in ("true", "false"):
        raise InputError(f"truncated must be true or false, got {options['truncated']!r}")
    return TruncatedNormal(std, mean, k) if truncated == "true" else Normal(std, mean)


def _joint_normal(reader: _Reader, value: object, options: Mapping[str, Any]) -> Law:
    if not isinstance(value, Mapping) or set(value) != {"std"} or not isinstance(value["std"], list):
        raise InputError("joint_normal takes the standard deviations: joint_normal: {std: [0.1 mm, 0.2 mm]}")
    std = np.array([reader.half_width(entry) for entry in value["std"]])
    correlation = options.get("correlation")
    rows = correlation if isinstance(correlation, list) else np.eye(std.size).tolist()
    try:
        matrix = np.array([[float(entry) for entry in row] for row in rows])
    except (TypeError, ValueError):
        raise InputError("correlation must be rows of plain numbers") from None
    if matrix.shape != (std.size, std.size) or not np.allclose(np.diag(matrix), 1):
        raise InputError(f"correlation must be {std.size} rows of {std.size} numbers with 1 on the diagonal")
    means = options.get("mean")
    centre = tuple(reader.number(entry) for entry in means) if isinstance(means, list) else ()
    covariance = matrix * np.outer(std, std)
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


def _mean(reader: _Reader, options: Mapping[str, Any]) -> float:
    return reader.number(options["mean"]) if "mean" in options else 0.0


def _scope(value: object) -> Scope:
    try:
        return Scope(value)
    except ValueError:
        raise InputError(f"scope must be one of {', '.join(scope.value for scope in Scope)}, got {value!r}") from None
