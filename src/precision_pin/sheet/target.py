"""Reader of a target: the point that results are about, off the tip."""

from __future__ import annotations

from typing import Final

from precision_pin.base import units
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import FARTHEST_TARGET
from precision_pin.sheet.law_reader import SettingError

_EXAMPLE: Final = "0 0 100 mm"


def parse_target(text: str) -> list[float]:
    """Return a point in the tip's axes, m, from text such as ``0 0 100 mm``.

    Raises
    ------
    SettingError
        Not three lengths with one unit, or farther from the tip than a target may be.
    """
    try:
        point = units.parse_vector(text, units.LENGTH, count=3)
        if max(map(abs, point)) > FARTHEST_TARGET:
            raise InputError(f"{text!r} is farther than {FARTHEST_TARGET:,.0f} m from the tip")
    except InputError as error:
        message = f"target: {error.findings[0].message}; write it as {_EXAMPLE!r}, in the tip's axes"
        raise SettingError(("target",), InputError(message)) from None
    return point
