"""Parser of the text of a setting: a quantity, a law or a parameter's name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final, final

from precision_pin.base import units
from precision_pin.base.errors import InputError, UnitError, UnknownNameError, nearest
from precision_pin.base.units import Quantity
from precision_pin.draws.draw import Draw, Setting
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.sheet.law_reader import LawReader, SettingError

NAME: Final = re.compile(r"[^\W\d][\w.\[\]#-]*")
TOLERANCE_PATTERN: Final = r"±|\+/-|\+-"
"""The sign in a tolerance written as text: a mean or nothing before it, the half-width after it."""

_HERE: Final = FilePath()


@final
@dataclass(frozen=True)
class NamedParameter:
    """A draw of the sheet's ``parameters``, and the quantities that have its unit.

    Attributes
    ----------
    draw
        The draw.
    quantities
        The quantities it can be used for.
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
    if isinstance(value, Mapping) or tolerance_law(value) is not None:
        raise InputError("expected a plain quantity, not a law or a tolerance")
    return units.parse(value, *quantities)


def parse_setting(
    value: object, quantities: Sequence[Quantity], named: Mapping[str, NamedParameter], folder: FilePath
) -> Setting:
    """Return a setting: a number in SI, an unnamed draw, or a parameter's name.

    Parameters
    ----------
    value
        Text, such as ``0.1 mm``, ``±0.1 mm`` or ``a1``, or a law as a mapping.
    quantities
        The quantities allowed for the setting.
    named
        The sheet's parameters by the name of each of their numbers.
    folder
        The folder that file names are relative to.

    Raises
    ------
    InputError
        Malformed, in the wrong unit, or naming a parameter of another quantity.
    UnknownNameError
        A name that is no parameter.
    """
    law = value if isinstance(value, Mapping) else tolerance_law(value)
    if law is not None:
        parameter = parse_law("", law, quantities, folder)
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
            raise UnitError(f"the parameter {name!r} is a {is_one}; expected a {wanted}")
        return name
    try:
        return units.parse(value, *quantities)
    except UnitError as error:
        if not _is_bare_number(value):
            raise
        message = error.findings[0].message
        more = f"with a unit it is a constant, the same in every robot; with ±, as '±{value} UNIT', it is a tolerance"
        raise UnitError(f"{message}; {more}") from None


def _is_bare_number(value: object) -> bool:
    try:
        return not units.split(value)[1]
    except UnitError:
        return False


def tolerance_law(value: object) -> dict[str, str] | None:
    """Return the uniform law of a tolerance such as ``±0.02 deg`` or ``1 ± 0.05 kg``; ``None`` for anything else."""
    if not isinstance(value, str):
        return None
    sign = re.search(TOLERANCE_PATTERN, value)
    if sign is None:
        return None
    mean, half_width = value[: sign.start()].strip(), value[sign.end() :].strip()
    if not mean:
        return {"uniform": half_width}
    if _is_bare_number(mean):
        mean = f"{mean} {units.split(half_width)[1]}"
    return {"uniform": half_width, "mean": mean}


def parse_parameter(name: str, value: object, quantities: Sequence[Quantity], folder: FilePath) -> NamedParameter:
    """Return a named parameter: a law, or a tolerance as text.

    Raises
    ------
    InputError
        Neither, or as :func:`parse_law`.
    """
    law = value if isinstance(value, Mapping) else tolerance_law(value)
    if law is None:
        raise InputError(
            "expected a law, such as {uniform: 0.1 mm}, or a tolerance, such as ±0.1 mm; write a number that does not vary as "
            f"{{fixed: 0.1 mm}}{units.comma_hint(value)}"
        )
    return parse_law(name, law, quantities, folder)


def parse_law(
    name: str, value: Mapping[str, Any], quantities: Sequence[Quantity], folder: FilePath = _HERE
) -> NamedParameter:
    """Return the draw of a law written as a mapping with one law key; file names are relative to the folder.

    Raises
    ------
    InputError
        No law key or several, an unknown key, or a bad number; a :class:`SettingError` where one key is at fault.
    """
    laws = laws_of_sheets()
    found = [key for key in value if key in laws]
    if len(found) != 1:
        given = f"has {', '.join(found)}" if found else "has none"
        unknown = next((key for key in value if key not in laws and key not in law_options()), None)
        if not found and unknown is not None:
            given += f" ({unknown!r}: {nearest(unknown, laws)})"
        raise InputError(f"a law needs exactly one of {', '.join(laws)}; this one {given}")
    key = found[0]
    options = law_options(key)
    for other in value:
        if other != key and other not in options:
            # {uniform: 0,05 mm} is {uniform: 0} and a key "05 mm"
            comma = f"{value[key]},{other}" if value[other] in (None, "") else ""
            hint = units.comma_hint(comma) or f": {nearest(other, options)}"
            raise SettingError((other,), f"{other!r} is no setting of the law {key}{hint}")
    reader = LawReader(value, tuple(quantities), folder)
    scope = reader.scope()
    law = laws[key].from_sheet(reader)
    known = (reader.quantities[0].written_in(reader.unit),) * law.size if len(reader.quantities) == 1 else ()
    return NamedParameter(Draw(name, law, scope, known), reader.quantities)


def law_options(*keys: str) -> tuple[str, ...]:
    """Return the keys allowed beside those of some laws, of all laws if none is given; ``scope`` is always allowed."""
    laws = laws_of_sheets()
    own = [option.key for key in keys or laws for option in laws[key].form.options]
    return (*dict.fromkeys(own), "scope")
