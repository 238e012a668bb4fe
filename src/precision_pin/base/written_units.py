"""Units for display, chosen by the size of the values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from precision_pin.base import units
from precision_pin.base.units import Quantity

# units from large to small: name, how many make one SI unit, smallest number written in it
_LADDERS: Final = {
    units.LENGTH: (("mm", 1e3, 1e-2), ("µm", 1e6, 1e-2), ("nm", 1e9, 0.0)),
    units.ANGLE: (("mrad", 1e3, 0.1), ("µrad", 1e6, 1e-2), ("nrad", 1e9, 0.0)),
    units.ANGULAR_COMPLIANCE: (("rad/(N·m)", 1.0, 0.1), ("mrad/(N·m)", 1e3, 0.1), ("µrad/(N·m)", 1e6, 0.0)),
    units.LINEAR_COMPLIANCE: (("mm/N", 1e3, 0.1), ("µm/N", 1e6, 0.0)),
    units.THERMAL_EXPANSION: (("ppm/K", 1e6, 0.0),),
    units.RELATIVE_LENGTH: (("mm/m", 1e3, 1e-2), ("µm/m", 1e6, 0.0)),
    units.PRESSURE: (("GPa", 1e-9, 0.1), ("MPa", 1e-6, 0.0)),
}


# for figures and scales: from large to small in thousandths
_OF_AXES: Final = {"position": ("m", "mm", "µm", "nm", "pm"), "attitude": ("rad", "mrad", "µrad", "nrad", "prad")}


@dataclass(frozen=True)
class WrittenUnit:
    """A unit for display, of which ``per_si`` make one SI unit."""

    name: str
    per_si: float

    @classmethod
    def suiting(cls, quantity: Quantity | None, sizes: Iterable[float]) -> WrittenUnit:
        """Return the unit in which the quantity was written, or else the unit of its ladder for the largest size (SI)."""
        if quantity is None:
            return cls("SI", 1.0)
        if quantity.written not in ("", quantity.si):  # instead of 1e-6 rad/(N*m): 1 µrad/(N·m)
            return cls(quantity.written.replace("*", "·"), 1 / quantity.units[quantity.written])
        largest = max((abs(size) for size in sizes), default=0.0)
        ladder = _LADDERS.get(quantity, ((quantity.si.replace("*", "·"), 1.0, 0.0),))
        for name, per_si, minimum in ladder:
            if largest * per_si >= minimum or largest == 0:
                return cls(name, per_si)
        return cls(*ladder[-1][:2])

    @classmethod
    def of_axis(cls, quantity: str, size: float) -> WrittenUnit:
        """Return the unit of an axis of a quantity up to a size (SI): mm or mrad for 0.1 to 10,000, else another."""
        ladder = [cls(name, 1000.0**k) for k, name in enumerate(_OF_AXES[quantity.partition(".")[0]])]
        if size == 0:
            return ladder[1]
        if size >= 10.0:
            return ladder[0]
        return next((unit for unit in ladder[1:] if size * unit.per_si >= 0.1), ladder[-1])

    def __call__(self, value: float) -> str:
        """Return a number with the unit."""
        return f"{self.number(value)} {self.name}".rstrip()

    def short(self, value: float) -> str:
        """Return a number of at most four digits with the unit."""
        return f"{value * self.per_si:.4g} {self.name}".rstrip()

    def number(self, value: float) -> str:
        """Return a number without the unit."""
        return f"{value * self.per_si:.6g}"
