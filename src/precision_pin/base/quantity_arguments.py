"""Quantities as arguments of public functions: numbers in SI, or text with a unit, such as ``"0.05 mm"``."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from precision_pin.base.arguments import check_number, check_numbers
from precision_pin.base.arrays import Array
from precision_pin.base.errors import UnitError
from precision_pin.base.units import Quantity, parse_vector

_BEGINS: Final = re.compile(r"\s*[+-]?\.?[0-9]")


def check_quantity(
    what: str,
    value: object,
    quantity: Quantity,
    allowed: str = "finite",
    within: Callable[[float], bool] | None = None,
) -> float:
    """Return one number in SI.

    Args:
        what, value: The argument, in words, and the given value: a number in SI, or text with a unit.
        quantity: What it is.
        allowed, within: As for :func:`~precision_pin.base.arguments.check_number`, without the unit.
    """
    number = _in_si(what, value, quantity)
    shown_unit = f"{allowed}, in {quantity.si} or with a unit"
    if isinstance(number, list):
        raise UnitError(f"{what} must be {shown_unit}, got {len(number)} numbers")
    return check_number(what, number, shown_unit, within)


def check_quantities(
    what: str, values: object, quantity: Quantity, shape: tuple[int | None, ...] | None = None, needs: str = ""
) -> Array:
    """Return numbers in SI as a read-only copy.

    Args:
        what, values: The argument, in words, and the given values: as for
            :func:`~precision_pin.base.arguments.check_numbers`, or with text in place of a number (``"100 mm"``) or of
            a row of numbers (``"0 0 100 mm"``).
        quantity: What they are.
        shape, needs: As for :func:`~precision_pin.base.arguments.check_numbers`.
    """
    return check_numbers(what, _in_si(what, values, quantity), shape, needs)


def _in_si(what: str, value: object, quantity: Quantity) -> object:
    """Return a value with each text in it replaced by its number, or by the list of its numbers; all else as it is.

    Text that does not begin with a number is left, for the check of the numbers to refuse it in words of its own.
    """
    if isinstance(value, list | tuple) and any(isinstance(entry, str | list | tuple) for entry in value):
        return [_in_si(what, entry, quantity) for entry in value]
    if not isinstance(value, str) or not _BEGINS.match(value):
        return value
    try:
        numbers = parse_vector(value, quantity)
    except UnitError as error:
        message = error.findings[0].message
        raise UnitError(f"{what.rstrip(',')}: {message}; a plain number is in {quantity.si}") from None
    return numbers if len(numbers) > 1 else numbers[0]
