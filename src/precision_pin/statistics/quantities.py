"""The eight quantities of a pose error and their names.

Results, JSON, data frames and Python use names such as ``position.z``; tables and figures show the symbol, ``dz``.
Users may write either, or the short form of a specification, ``z``.
"""

from __future__ import annotations

from typing import Final

from precision_pin.base.arguments import check_name
from precision_pin.base.units import ANGLE, LENGTH, Quantity

QUANTITIES: Final = tuple(f"{vector}.{part}" for vector in ("position", "attitude") for part in ("norm", "x", "y", "z"))
"""The eight quantities, in the order of every array's rows."""

NORMS: Final = (0, 4)
"""Rows of the two norms, |d| and |δ|."""

COMPONENTS: Final = (1, 2, 3, 5, 6, 7)
"""Rows of the components, in the order of an error's six numbers [d; δ]."""

# the words of a specification, then the symbols of the tables
_WORDS: Final = ("position x y z attitude rx ry rz", "|d| dx dy dz |δ| δx δy δz")

QUANTITY_WORDS: Final = {
    word: name for words in _WORDS for word, name in zip(words.split(), QUANTITIES, strict=True)
} | {name: name for name in QUANTITIES}
"""Names of quantities that users may give."""

QUANTITY_PATTERN: Final = r"\|[^\s|@]++\||[^\W\d](?:[^\W\d]|\.(?=[^\W\d]))*+"
"""Pattern of a word that may be such a name: no digits, so that a number may follow without a blank."""


def quantity_name(quantity: str) -> str:
    """Return the result name, ``position.z``, of any of its names, or raise UnknownNameError."""
    if isinstance(quantity, str) and quantity in QUANTITY_WORDS:
        return QUANTITY_WORDS[quantity]
    return check_name("quantity", quantity, QUANTITIES)


def si_quantity(quantity: str) -> Quantity:
    """Return angle or length, for the result name of a quantity."""
    return ANGLE if quantity.startswith("attitude") else LENGTH
