"""Specifications as a user writes them: ``0.5 mm @ 99.73 %``, ``x 0.2 mm``, ``attitude 1 mrad @ 0.99``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from precision_pin import units
from precision_pin.arguments import check_text, shown
from precision_pin.errors import InputError, UnitError, UnknownNameError
from precision_pin.statistics import Specification
from precision_pin.statistics.precision import QUANTITY_WORDS

__all__ = ["DEFAULT_PROBABILITY", "Specifications", "listed_specifications", "specification"]

DEFAULT_PROBABILITY: Final = 0.95
"""What is required where a specification names no probability."""

Specifications = Specification | str | Sequence[Specification | str]
"""Limits as the analyses take them: one or several, each a specification or its text."""

_FORM: Final = re.compile(r"\s*([A-Za-z_][A-Za-z_.]*)?\s*([^@]+?)\s*(?:@\s*(.+?)\s*)?", re.DOTALL)


def specification(text: str) -> Specification:
    """Return the specification that a text states.

    Parameters
    ----------
    text
        ``[QUANTITY] LIMIT [@ PROBABILITY]``. The quantity is position (the default of a length), attitude (the default
        of an angle), a component x, y, z, rx, ry, rz, or a name as in the JSON such as ``position.x``; the limit a
        length or an angle; the probability 95 % if left out.

    Raises
    ------
    InputError
        Not of this form, a limit that is not positive, or a probability outside 0 to 1.
    """
    match = _FORM.fullmatch(check_text("a specification", text, "0.5 mm @ 99.73 %"))
    if match is None:
        raise InputError(f"specification {text!r} is not understood; write it as '0.5 mm @ 99.73 %' or 'x 0.2 mm'")
    word, limit_text, probability_text = match.groups()
    try:
        limit = units.parse(limit_text, units.LENGTH, units.ANGLE)
        required = DEFAULT_PROBABILITY if probability_text is None else units.parse(probability_text, units.RATIO)
    except UnitError as error:
        raise InputError(f"specification {text!r}: {error.findings[0].message}") from None
    is_length = units.split(limit_text)[1] in units.LENGTH.units
    if word is None:
        word = "position" if is_length else "attitude"
    if word not in QUANTITY_WORDS:
        raise UnknownNameError("quantity of a specification", word, QUANTITY_WORDS)
    if QUANTITY_WORDS[word].startswith("position") != is_length:
        raise InputError(f"specification {text!r}: {word} is limited by {'an angle' if is_length else 'a length'}")
    if not limit > 0:
        raise InputError(f"specification {text!r}: the limit must be positive")
    if not 0 < required < 1:
        raise InputError(f"specification {text!r}: the probability must lie above 0 and below 1 (or 100 %)")
    return Specification(QUANTITY_WORDS[word], limit, required)


def listed_specifications(given: Specifications) -> tuple[Specification, ...]:
    """Return specifications one by one, texts among them read.

    Raises
    ------
    InputError
        Something that is neither a specification nor its text, or a text that is none.
    """
    if isinstance(given, Specification | str):
        given = (given,)
    if not isinstance(given, list | tuple):
        raise InputError(f"specifications must be a list of specifications or of texts, got {shown(given)}")
    return tuple(one if isinstance(one, Specification) else specification(one) for one in given)
