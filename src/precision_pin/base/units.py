"""Numbers with units: text such as ``"0.05 mm"`` to SI.

Every quantity lists its accepted units; messages name any other. A number without a unit is rejected where a unit is
needed: otherwise millimetres would be read as metres.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from precision_pin.base.errors import UnitError


@dataclass(frozen=True)
class Quantity:
    """A physical quantity.

    Attributes:
        si: The SI unit, ``""`` for a pure number.
        units: Accepted unit → factor to SI.
        written: The unit in which a user wrote a number, or empty; ignored in comparisons.
    """

    name: str
    si: str
    units: Mapping[str, float]
    written: str = field(default="", compare=False)

    def __hash__(self) -> int:
        return hash(self.name)

    def __reduce__(self) -> tuple[object, ...]:
        # a read-only view of a dictionary cannot be pickled; draws sent to workers hold quantities
        return _quantity, (self.name, self.si, dict(self.units), self.written)

    def written_in(self, unit: str) -> Quantity:
        """Return the quantity as written in one of its units."""
        return replace(self, written=unit)


def _quantity(name: str, si: str, units: dict[str, float], written: str = "") -> Quantity:
    return Quantity(name, si, MappingProxyType(units), written)


# unit → factor to SI, exact: the inch and the pound are defined in SI (1959), angles are fractions of a turn
_METRE: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "in": 0.0254}
_RADIAN: Final = {
    "rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "µrad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180,
    "arcmin": math.pi / 10800, "arcsec": math.pi / 648000, "turn": 2 * math.pi,
}  # fmt: skip
_TORQUE: Final = {"N*m": 1.0, "N*mm": 1e-3, "kN*m": 1e3}
_FORCE: Final = {"N": 1.0, "kN": 1e3}

# Quantities of sheets, URDF files and options. Their units are those of data sheets and catalogues of the part; an
# unlisted unit is an error that lists these, since guessing a factor would be worse.
LENGTH: Final = _quantity("length", "m", _METRE)
ANGLE: Final = _quantity("angle", "rad", _RADIAN)
MASS: Final = _quantity("mass", "kg", {"kg": 1.0, "g": 1e-3, "t": 1e3, "lb": 0.45359237})
ACCELERATION: Final = _quantity("acceleration", "m/s^2", {"m/s^2": 1.0, "mm/s^2": 1e-3})
FORCE: Final = _quantity("force or axial rigidity", "N", {**_FORCE, "MN": 1e6})
# EA has the dimension of a force; one quantity, because the unit alone must select it
AXIAL_RIGIDITY: Final = FORCE
TORQUE: Final = _quantity("torque", "N*m", _TORQUE)
BENDING_RIGIDITY: Final = _quantity(
    "bending or torsional rigidity", "N*m^2", {"N*m^2": 1.0, "kN*m^2": 1e3, "N*mm^2": 1e-6, "kN*mm^2": 1e-3}
)
ANGULAR_STIFFNESS: Final = _quantity(
    "angular stiffness",
    "N*m/rad",
    {f"{t}/{a}": f / _RADIAN[a] for t, f in _TORQUE.items() for a in ("rad", "mrad", "deg", "arcmin", "arcsec")},
)
ANGULAR_COMPLIANCE: Final = _quantity(
    "angular compliance", "rad/(N*m)", {f"{a}/({t})": f / g for a, f in _RADIAN.items() for t, g in _TORQUE.items()}
)
LINEAR_STIFFNESS: Final = _quantity(
    "linear stiffness", "N/m", {f"{t}/{a}": f / _METRE[a] for t, f in _FORCE.items() for a in ("m", "mm", "um", "µm")}
)
LINEAR_COMPLIANCE: Final = _quantity(
    "linear compliance", "m/N", {f"{a}/{t}": f / g for a, f in _METRE.items() for t, g in _FORCE.items()}
)
# degC is a difference here, one kelvin: never a temperature above freezing
_KELVIN: Final = ("K", "degC")
TEMPERATURE_DIFFERENCE: Final = _quantity("temperature difference", "K", {"K": 1.0, "mK": 1e-3, "degC": 1.0})
TEMPERATURE_GRADIENT: Final = _quantity(
    "temperature gradient", "K/m", {f"{k}/{a}": 1 / _METRE[a] for k in _KELVIN for a in ("m", "cm", "mm")}
)
THERMAL_EXPANSION: Final = _quantity(
    "thermal expansion",
    "1/K",
    {
        f"{a}{k}{b}": f
        for k in _KELVIN
        for a, b, f in (("1/", "", 1.0), ("ppm/", "", 1e-6), ("um/(m*", ")", 1e-6), ("µm/(m*", ")", 1e-6))
    },
)
# a ratio written with a length, so that 0.1 mm/m is not confused with a share
RELATIVE_LENGTH: Final = _quantity("relative length", "m/m", {f"{a}/m": _METRE[a] for a in ("m", "mm", "um", "µm")})
RATIO: Final = _quantity("ratio", "", {"": 1.0, "%": 1e-2, "ppm": 1e-6})
PRESSURE: Final = _quantity(
    "modulus of elasticity", "Pa", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/m^2": 1.0, "N/mm^2": 1e6}
)
AREA: Final = _quantity("area", "m^2", {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6})
SECOND_MOMENT: Final = _quantity("second moment of area", "m^4", {"m^4": 1.0, "cm^4": 1e-8, "mm^4": 1e-12})
DENSITY: Final = _quantity("density", "kg/m^3", {"kg/m^3": 1.0, "g/cm^3": 1e3})
TIME: Final = _quantity("time", "s", {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "us": 1e-6, "ns": 1e-9})

QUANTITIES: Final = tuple(dict.fromkeys(entry for entry in list(globals().values()) if isinstance(entry, Quantity)))
"""All quantities, in the order above."""


def per_second(quantity: Quantity) -> Quantity:
    """Return the rate of a quantity."""
    rates = {f"{unit}/s": factor for unit, factor in quantity.units.items()}
    return _quantity(f"{quantity.name} per second", f"{quantity.si}/s", rates)


def quantity_of(unit: str) -> Quantity:
    """Return the quantity of a unit, spelled as in the tables."""
    return next(quantity for quantity in QUANTITIES if unit in quantity.units)


LARGEST: Final = 1e50
SMALLEST: Final = 1e-50
"""Range of numbers read, in SI, apart from 0: the square of a product of three is at most 1e300, and no double overflows
below 1.8e308."""

MOST_NAMED: Final = 3
"""Quantities whose units a message lists in full; four would exceed two lines of a terminal."""

_PER_CENT: Final = 100
"""A share of one, in per cent."""
# `split` joins runs of blanks first, so that these patterns take linear time
_NUMBER: Final = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_TEXT: Final = re.compile(rf"\s*({_NUMBER}(?:[\s,]+{_NUMBER})*)\s*(\D.*)?", re.ASCII | re.DOTALL)
# other spellings of the signs in the tables above, as keyboards and data sheets have them
_SPELLINGS: Final = {"·": "*", "⋅": "*", "**": "^", "²": "^2", "³": "^3", "⁴": "^4", "μ": "µ", "Nm": "N*m"}


def split(text: object) -> tuple[list[float], str]:
    """Return the numbers and the unit (spelled as in the tables) of a text."""
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise UnitError(f"expected a number with a unit, got {text!r}")
    # runs of spaces are joined first: the pattern would backtrack over them
    match = _TEXT.fullmatch(" ".join(str(text).split()))
    if match is None or "," in match[1]:
        raise UnitError(f"expected a number with a unit such as '0.1 mm', got {str(text)!r}{comma_hint(text)}")
    number_texts, unit = match[1].split(), (match[2] or "").strip()
    if unit.startswith("/") and len(number_texts) > 1 and number_texts[-1] == "1":
        unit = number_texts.pop() + unit  # 12e-6 1/K
    numbers = [float(number) for number in number_texts]
    if not all(math.isfinite(number) for number in numbers):
        raise UnitError(f"{str(text)!r} is not finite")
    return numbers, _spelled(unit)


@lru_cache(1000)
def _spelled(unit: str) -> str:
    for spelling, spelled in _SPELLINGS.items():
        unit = unit.replace(spelling, spelled)
    return re.sub(r" ?([*/^()]) ?", r"\1", unit)


def comma_hint(text: object) -> str:
    """Return a hint for a message if a text has a decimal comma, such as ``0,05 mm``; else an empty text."""
    with_points, commas = re.subn(r"(?<=\d),(?=\d)", ".", str(text)[:_PER_CENT])
    return f"; decimals have a point: {with_points!r}" if commas and _TEXT.fullmatch(with_points) else ""


def parse(text: object, *quantities: Quantity) -> float:
    """Return one number in SI; as `parse_vector`."""
    return parse_vector(text, *quantities, count=1)[0]


def parse_probability(text: str) -> float:
    """Return a probability, written ``95 %`` or ``0.95``."""
    value = parse(text, RATIO)
    if split(text)[1] == "ppm":
        advice = f"; write '{100 * (1 - value):.10g} %'" if 0 < value < 1 else ""
        raise UnitError(f"ppm is for a share of failures, and the probability is the share of robots inside{advice}")
    if 0 < value < 1:
        return value
    allowed = "the probability must lie above 0 and below 1 (or 100 %)"
    if 1 < value < _PER_CENT and not split(text)[1]:
        raise UnitError(f"{allowed}; did you mean '{text.strip()} %'?")
    if value == 1:
        message = f"{allowed}: no number of samples shows that all robots are inside; ask for less, such as 99.9 %"
        raise UnitError(message)
    raise UnitError(allowed)


def parse_vector(text: object, *quantities: Quantity, count: int | None = None) -> list[float]:
    """Return numbers that share one unit, such as ``"-90 3 88 -91 deg"``, in SI.

    Args:
        text: Numbers separated by spaces, then the unit; without a unit only for a quantity that accepts none.
        quantities: Accepted quantities; the unit selects one of them.
        count: Required number of numbers; any if ``None``.
    """
    numbers, unit = split(text)
    if count is not None and len(numbers) != count:
        raise UnitError(f"{str(text)!r} has {len(numbers)} numbers, expected {count}")
    for quantity in quantities:
        # among many quantities a bare number is a forgotten unit rather than a ratio
        if unit in quantity.units and (unit or len(quantities) <= MOST_NAMED):
            values = [number * quantity.units[unit] for number in numbers]
            if not all(abs(value) <= LARGEST for value in values):
                raise UnitError(f"{str(text)!r} is too large; at most {LARGEST:g} {quantity.si}".rstrip())
            if any(0 < abs(value) < SMALLEST for value in values):
                raise UnitError(f"{str(text)!r} is too small; at least {SMALLEST:g} {quantity.si}, or 0".rstrip())
            return values
    names = " or ".join(quantity.name for quantity in quantities)
    allowed = ", ".join(dict.fromkeys(unit for quantity in quantities for unit in quantity.units))
    if len(quantities) > MOST_NAMED:
        names = "quantity"
        allowed = ", ".join(quantity.si for quantity in quantities if quantity.si) + ", and multiples of these"
    if not unit:
        article = "an" if names[0] in "aeiou" else "a"
        raise UnitError(f"{str(text)!r} has no unit; {article} {names} needs one of: {allowed}")
    hint = ""
    if unit in ("bit", "bits") and ANGLE in quantities:
        hint = "; an encoder of n bit resolves 360 deg / 2^n"
        if numbers[0].is_integer() and 1 <= numbers[0] <= 64:
            n = f"{numbers[0]:.0f}"
            hint = f"; an encoder of {n} bit resolves 360 deg / 2^{n}, so write '{360 / 2 ** numbers[0]:.6g} deg'"
    raise UnitError(f"{unit!r} in {str(text)!r} is not a unit of {names}{hint}; allowed: {allowed}")


@dataclass(frozen=True)
class PerJoint:
    """Quantities of a setting on a revolute joint and on a prismatic joint."""

    revolute: Quantity
    prismatic: Quantity


@dataclass(frozen=True)
class PerEntry:
    """Quantities of the entries of a list, in order."""

    quantities: tuple[Quantity, ...]
