"""Tolerances as drawings write them: ±, two limits, classes of ISO 286-1 and general tolerances of ISO 2768-1."""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from precision_pin.base import units
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.units import Quantity

TOLERANCE_PATTERN: Final = r"±|\+/-|\+-"
"""The sign in a tolerance: after a mean or nothing, before the half-width."""
_NUMBER: Final = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_UNIT: Final = r"[^\d\s/+,.-]\S*?"
_NOMINAL: Final = rf"(?:[⌀Øø] ?)?(?P<nominal>[+-]?{_NUMBER}) ?(?P<nominal_unit>{_UNIT})? "
_LIMIT: Final = rf"[+-] ?{_NUMBER}|0(?:\.0*)?"
_LIMITS: Final = re.compile(
    rf"(?:{_NOMINAL})?(?P<first>{_LIMIT}) ?(?P<first_unit>{_UNIT})?"
    rf"(?P<between> ?/ ?| )(?P<second>{_LIMIT}) ?(?P<unit>[^\d\s].*)?"
)
_CLASS: Final = r"(?P<letters>[A-Za-z]{1,2})(?P<grade>01|1[0-8]|\d)"
_STANDARD: Final = r"(?:DIN|EN|ISO|ASME|ANSI|JIS|GB|BS|VDI)\b.*"
_NAMED: Final = re.compile(rf"(?:{_NOMINAL})?(?P<name>{_CLASS}(?: ?/ ?[a-z]{{1,2}}\d+)?|{_STANDARD})")
_GENERAL: Final = re.compile(r"(?:[A-Z]+ )*ISO 2768(?:-1)?[ -]*(?P<letter>[fmcv])")
_FORMS: Final = "±0.1 mm, +0.5/-0.1 mm, 50 mm H7 (a class of ISO 286), IT7 or ISO 2768-m (f, m, c, v)"


class DrawingTolerance(NamedTuple):
    """A tolerance: its half-width and mean as texts with units, the mean empty for 0; and the limits as read, or empty."""

    half_width: str
    mean: str
    limits: str = ""


def is_bare_number(value: object) -> bool:
    """Return whether a value is a number without a unit."""
    try:
        return not units.split(value)[1]
    except InputError:
        return False


def plain_signs(text: str) -> str:
    """Return a text with single spaces and the minus of a keyboard."""
    return " ".join(text.split()).replace("\N{MINUS SIGN}", "-").replace("\N{EN DASH}", "-")


def is_tolerance(value: object, *, is_in_law: bool = False) -> bool:
    """Return whether a value is the text of a tolerance; in a law also a class without a size, such as ``H7``."""
    if not isinstance(value, str):
        return False
    text = plain_signs(value)
    if re.search(TOLERANCE_PATTERN, text) or _match_limits(text):
        return True
    named = _NAMED.fullmatch(text)
    if named is None or is_in_law:
        return named is not None
    return bool(named["nominal"]) or named["letters"] in (None, "IT") or "/" in named["name"]


def read_tolerance(
    value: str, quantities: Sequence[Quantity], size: float | None, robot_size: float | None
) -> DrawingTolerance:
    """Return the tolerance of a text for which :func:`is_tolerance` is true.

    Args:
        quantities: Possible quantities; the tables are of lengths, and ISO 2768 also of angles.
        size: Nominal size of a class, m, of an angle the length of its shorter side; None for that in the text.
        robot_size: Nominal size where neither gives one.

    Raises:
        InputError: A class that the tables do not have, one without a size, two units, or another standard.
    """
    text = plain_signs(value)
    sign = re.search(TOLERANCE_PATTERN, text)
    if sign is not None:
        mean, half_width = text[: sign.start()].strip(), text[sign.end() :].strip()
        if mean and is_bare_number(mean):
            mean = f"{mean} {units.split(half_width)[1]}"
        return DrawingTolerance(half_width, mean, text if mean else "")
    match = _match_limits(text)
    if match is not None:
        written = {unit for unit in (match["first_unit"], match["unit"], match["nominal_unit"]) if unit}
        if len(written) != 1:
            raise InputError(f"the limits in {value!r} need one unit, as in '10 +0.5/-0.1 mm'")
        limits = [Decimal(match[name].replace(" ", "")) for name in ("first", "second")]
        return _between(min(limits), max(limits), written.pop(), Decimal(match["nominal"] or 0))
    named = _NAMED.fullmatch(text)
    assert named is not None
    name, nominal = named["name"], Decimal(named["nominal"] or 0)
    is_length = units.LENGTH in quantities
    if nominal:
        if not named["nominal_unit"]:
            raise InputError(f"the size in {value!r} needs its unit: '{named['nominal']} mm {name}'")
        quantity, unit = (units.LENGTH, "mm") if is_length else (units.ANGLE, "arcmin")
        in_si = units.parse(f"{nominal} {named['nominal_unit']}", quantity)
        nominal = Decimal(f"{in_si / quantity.units[unit]:.12g}")
        size = in_si if is_length and size is None else size
    size = robot_size if size is None else size
    general = _GENERAL.fullmatch(name)
    if general is None and (named["letters"] is None or "/" in name):
        raise InputError(f"{name!r} is not read; a tolerance is written {_FORMS}")
    if not (is_length or (general and units.ANGLE in quantities)):
        raise InputError(f"the class {name} is of lengths; expected a tolerance of {quantities[0].name}")
    if size is None:
        raise InputError(f"the class {name} needs the nominal size, as in {{uniform: {name}, size: 50 mm}}")
    if general is not None:
        width = general_tolerance(general["letter"], size, "length" if is_length else "angle")
        result = _between(-width, width, "mm" if is_length else "arcmin", nominal)
    else:
        lower, upper = class_limits(name, size)
        result = _between(lower / 1000, upper / 1000, "mm", nominal)
    return result._replace(limits=f"{name} of {size * 1e3:.6g} mm, {result.limits}")


def grade_width(grade: str, size: float) -> float:
    """Return the width of the tolerance zone, m, of a grade for a nominal size, m.

    Raises:
        UnknownNameError: Another grade than IT01 to IT18.
        InputError: A size that is not positive, or beyond the table.
    """
    return float(_grade(grade, size)) * 1e-6


def class_limits(name: str, size: float) -> tuple[Decimal, Decimal]:
    """Return the lower and the upper limit deviation, µm, of a class such as ``H7`` for a nominal size, m.

    A hole has an upper-case letter, a shaft a lower-case one; ``IT7`` and ``js7`` lie evenly about the nominal size.

    Raises:
        InputError: A class that ISO 286-1 does not have for the size.
    """
    match = re.fullmatch(_CLASS, name)
    assert match is not None
    tables, letters, grade = _tables()["iso286"], match["letters"], match["grade"]
    letter, number, is_hole = letters.lower(), int(grade), letters.isupper()
    width = _grade(f"IT{grade}", size)
    if letters in ("IT", "JS", "js"):
        return -width / 2, width / 2
    rows = tables["j"] if letter == "j" else tables["deviations"]
    values = rows.get(letters + grade if letter == "j" else letter if letters in (letter, letter.upper()) else "", ())
    nearer = _at_size(values, tables["sizes" if len(values) <= len(tables["sizes"]) else "fine_sizes"], size)
    millimetres, is_coarse = size * 1e3, number > 8
    is_barred = millimetres <= 1 and (letter in "ab" or (name[0] == "N" and is_coarse))
    is_barred |= letters == "K" and is_coarse and 3 < millimetres <= 500
    if nearer is None or nearer.is_nan() or is_barred:
        raise InputError(f"there is no class {name} in ISO 286-1 for {millimetres:g} mm")
    if letter == "j":
        return (nearer - width, nearer) if is_hole else (nearer, nearer + width)
    if letter < "j":
        return (nearer, nearer + width) if is_hole else (-nearer - width, -nearer)
    if not is_hole:
        lower = nearer if letter != "k" or 4 <= number <= 7 else Decimal(0)
        return lower, lower + width
    upper = -nearer
    if number <= (8 if letter in "kmn" else 7):
        upper += _at_size(tables["delta"].get(f"IT{grade}", ()), tables["sizes"], size) or 0
    if letter in "kn" and is_coarse and millimetres <= 500:
        upper = Decimal(-4 if letter == "n" and millimetres <= 3 else 0)
    if name == "M6" and 250 < millimetres <= 315:
        upper = Decimal(-9)  # an exception of the standard
    return upper - width, upper


def general_tolerance(letter: str, size: float, kind: str) -> Decimal:
    """Return the half-width of ISO 2768-1 for a size, m: of a ``length``, mm, or an ``angle``, arcmin.

    Raises:
        InputError: A size for which the class has no tolerance.
    """
    table = _tables()["iso2768"][kind]
    value = _at_size(table[letter], table["sizes"], size)
    if value is None or value.is_nan() or size * 1e3 < table["smallest"] or not size > 0:
        raise InputError(f"there is no {kind} tolerance in ISO 2768-{letter} for a size of {size * 1e3:.6g} mm")
    return value


def _match_limits(text: str) -> re.Match[str] | None:
    """Return the match of two limits; without a stroke, both have signs, one of them +, and no nominal size is before."""
    match = _LIMITS.fullmatch(text)
    if match is None or "/" in match["between"]:
        return match
    is_signed = match["first"][0] in "+-" and "+" in match["first"] + match["second"]
    return match if is_signed and not match["nominal"] else None


def _between(lower: Decimal, upper: Decimal, unit: str, nominal: Decimal) -> DrawingTolerance:
    half_width, mean = (upper - lower) / 2, nominal + (upper + lower) / 2
    signed = "/".join(f"{limit:+f}" if limit else "0" for limit in (upper, lower))
    limits = f"±{half_width:f}" if upper == -lower else signed
    about = f"{nominal:f} " if nominal else ""
    return DrawingTolerance(f"{half_width:f} {unit}", f"{mean:f} {unit}" if mean else "", f"{about}{limits} {unit}")


@cache
def _tables() -> Mapping[str, Any]:
    text = Path(__file__).with_name("iso_tolerances.toml").read_text(encoding="utf-8")
    return tomllib.loads(text, parse_float=Decimal)


def _grade(grade: str, size: float) -> Decimal:
    tables = _tables()["iso286"]
    if grade not in tables["grades"]:
        raise UnknownNameError("ISO 286 grade", grade, tuple(tables["grades"]))
    width = _at_size(tables["grades"][grade], tables["sizes"], size)
    if width is None or not size > 0:
        raise InputError(f"ISO 286 has no {grade} for {size * 1e3:.9g} mm; sizes are above 0 and at most 3150 mm")
    return width


def _at_size(values: Sequence[float | Decimal], sizes: Sequence[float], size: float) -> Decimal | None:
    """Return the value for the step of a size, m; None beyond the values."""
    # a size such as 80 mm belongs to the step that ends with it, whatever its binary rounding
    step = bisect_left(sizes, round(size * 1e3, 9))
    return Decimal(values[step]) if step < len(values) else None
