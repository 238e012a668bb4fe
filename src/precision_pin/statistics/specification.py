"""Specifications as text: ``0.5 mm @ 99.73 %``, ``x 0.2 mm``, ``attitude 1 mrad @ 0.99``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from precision_pin.base import units
from precision_pin.base.arguments import check_text, shown
from precision_pin.base.errors import InputError, UnitError, UnknownNameError
from precision_pin.statistics import Specification
from precision_pin.statistics.quantities import QUANTITY_PATTERN, QUANTITY_WORDS

DEFAULT_PROBABILITY: Final = 0.95
"""Required probability of a specification without one."""

_FORM: Final = re.compile(rf"({QUANTITY_PATTERN})?\s*+(?:(?:<=|<|≤)\s*+)?(\S.*)", re.DOTALL)
_LEAST_PER_CENT: Final = 0.01
"""Smallest probability accepted in per cent; less is probably a ratio written with a per cent sign."""

Specifications = Specification | str | Sequence[Specification | str]
"""One or several limits, each a specification or its text."""


def specification(text: str) -> Specification:
    """Return the specification that a text states.

    Parameters
    ----------
    text
        ``[QUANTITY] LIMIT [@ PROBABILITY]``. The quantity is position (the default of a length), attitude (the default
        of an angle), a component x, y, z, rx, ry, rz, a name of the tables such as ``dx`` or ``|d|``, or a name of the
        JSON such as ``position.x``. It may be followed by ≤. The limit is a length or an angle. The probability is 95 %
        by default.

    Raises
    ------
    InputError
        The text is not of this form, the limit is not positive, or the probability lies outside 0 to 1.
    """
    demand, at, probability_text = (
        part.strip() for part in check_text("a specification", text, "0.5 mm @ 99.73 %").partition("@")
    )
    match = _FORM.fullmatch(demand)
    if match is None or (at and not probability_text):
        raise InputError(f"specification {text!r} is not understood; write it as '0.5 mm @ 99.73 %' or 'x 0.2 mm'")
    word, limit_text = match.groups()
    try:
        unit = units.split(limit_text)[1]
        if not unit:
            raise UnitError(
                f"{limit_text!r} has no unit: '{limit_text} mm' limits the position, '{limit_text} mrad' the attitude"
            )
        limit = units.parse(limit_text, units.LENGTH, units.ANGLE)
        required = _parse_required(probability_text) if at else DEFAULT_PROBABILITY
    except UnitError as error:
        raise InputError(f"specification {text!r}: {error.findings[0].message}") from None
    is_length = unit in units.LENGTH.units
    if word is None:
        word = "position" if is_length else "attitude"
    # the limit applies to the absolute value, which may be written |dx|
    word = word if word in QUANTITY_WORDS else word.strip("|")
    if word not in QUANTITY_WORDS:
        raise UnknownNameError("quantity of a specification", word, QUANTITY_WORDS)
    if QUANTITY_WORDS[word].startswith("position") != is_length:
        raise InputError(f"specification {text!r}: {word} is limited by {'an angle' if is_length else 'a length'}")
    if not limit > 0:
        raise InputError(f"specification {text!r}: the limit must be positive")
    if not is_length and limit >= math.pi:
        meant = "deg, or mrad" if unit == "rad" else "mrad"
        raise InputError(f"specification {text!r}: no attitude error is larger than half a turn; did you mean {meant}?")
    return Specification(QUANTITY_WORDS[word], limit, required)


def _parse_required(text: str) -> float:
    """Return the required probability; one written in per cent and below 1 % is rejected as a probable slip."""
    value = units.parse_probability(text)
    if value < _LEAST_PER_CENT and units.split(text)[1] == "%":
        raise UnitError(
            f"{text} is fewer than one robot in a hundred; did you mean '{100 * units.split(text)[0][0]:g} %'? "
            f"(or the plain ratio {value:g})"
        )
    return value


def listed_specifications(given: Specifications) -> tuple[Specification, ...]:
    """Return a tuple of specifications, the texts among them parsed.

    Raises
    ------
    InputError
        An entry is neither a specification nor a text, or its text is not a specification.
    """
    if isinstance(given, Specification | str):
        given = (given,)
    if not isinstance(given, list | tuple):
        raise InputError(f"specifications must be a list of specifications or of texts, got {shown(given)}")
    return tuple(one if isinstance(one, Specification) else specification(one) for one in given)
