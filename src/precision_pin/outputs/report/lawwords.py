"""Laws in words, their numbers in units that people use."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from precision_pin import units
from precision_pin.draws.laws import (
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Fixed,
    JointNormal,
    Law,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.units import Quantity

__all__ = ["law_in_words"]

_UNKNOWN: Final = "SI"
# units from large to small, each with how many of it make one of SI, and the least number that is written in it
_LADDERS: Final = {
    units.LENGTH: (("mm", 1e3, 1e-2), ("µm", 1e6, 1e-2), ("nm", 1e9, 0.0)),
    units.ANGLE: (("mrad", 1e3, 0.1), ("µrad", 1e6, 1e-2), ("nrad", 1e9, 0.0)),
    units.ANGULAR_COMPLIANCE: (("rad/(N·m)", 1.0, 0.1), ("mrad/(N·m)", 1e3, 0.1), ("µrad/(N·m)", 1e6, 0.0)),
    units.LINEAR_COMPLIANCE: (("mm/N", 1e3, 0.1), ("µm/N", 1e6, 0.0)),
    units.THERMAL_EXPANSION: (("ppm/K", 1e6, 0.0),),
    units.RELATIVE_LENGTH: (("mm/m", 1e3, 1e-2), ("µm/m", 1e6, 0.0)),
    units.PRESSURE: (("GPa", 1e-9, 0.1), ("MPa", 1e-6, 0.0)),
}


@final
@dataclass(frozen=True)
class _Unit:
    """How numbers of a quantity are written."""

    name: str
    per_si: float

    @classmethod
    def suiting(cls, quantity: Quantity | None, sizes: Iterable[float]) -> _Unit:
        """Return the unit in which the largest of these sizes (SI) reads well."""
        if quantity is None:
            return cls(_UNKNOWN, 1.0)
        largest = max((abs(size) for size in sizes), default=0.0)
        ladder = _LADDERS.get(quantity, ((quantity.si.replace("*", "·"), 1.0, 0.0),))
        for name, per_si, least in ladder:
            if largest * per_si >= least or largest == 0:
                return cls(name, per_si)
        return cls(*ladder[-1][:2])

    def __call__(self, value: float) -> str:
        """Return a number with the unit."""
        return f"{self.number(value)} {self.name}".rstrip()

    def number(self, value: float) -> str:
        """Return a number without it."""
        return f"{value * self.per_si:.6g}"


def law_in_words(law: Law, quantities: Sequence[Quantity | None]) -> str:
    """Return what is drawn, in words.

    Parameters
    ----------
    law
        The law.
    quantities
        What each of its numbers is; None where that is not known: SI is then written.
    """
    if law.size > 1:
        return _several(law, quantities)
    quantity = quantities[0]
    match law:
        case Fixed(mean=mean):
            return f"fixed at {_Unit.suiting(quantity, [mean])(mean)}"
        case Uniform(half_width=t, mean=mean):
            return _about("uniform within", t, mean, quantity)
        case Triangular(half_width=t, mean=mean):
            return _about("triangular within", t, mean, quantity)
        case Arcsine(half_width=t, mean=mean):
            return _about("arcsine (a sine wave met at random) within", t, mean, quantity)
        case Normal(std=std, mean=mean):
            unit = _Unit.suiting(quantity, [std])
            return f"normal, standard deviation {unit(std)}{_mean(mean, quantity)}"
        case TruncatedNormal(std=std, mean=mean, k=k):
            unit = _Unit.suiting(quantity, [std])
            return f"normal, standard deviation {unit(std)}, cut off at ±{unit(k * std)}{_mean(mean, quantity)}"
        case Lognormal(std=std, mean=mean):
            return (
                f"lognormal, mean {_Unit.suiting(quantity, [mean])(mean)}, "
                f"standard deviation {_Unit.suiting(quantity, [std])(std)}"
            )
        case TwoPoint(probability=probability):
            low, high = law.ends
            unit = _Unit.suiting(quantity, law.ends)
            return f"{unit(low)} or {unit(high)}, the latter with probability {100 * probability:.6g} %"
        case Empirical():
            low, high = law.ends
            unit = _Unit.suiting(quantity, law.ends)
            return f"measured: {len(law.quantiles)} quantiles from {unit(low)} to {unit(high)}{_spread(law, quantity)}"
        case _:
            return f"{type(law).__name__}{_spread(law, quantity)}"


def _several(law: Law, quantities: Sequence[Quantity | None]) -> str:
    match law:
        case Disc(radius=radius):
            return f"a point uniform over a disc of radius {_Unit.suiting(quantities[0], [radius])(radius)}"
        case Circle(radius=radius):
            unit = _Unit.suiting(quantities[0], [radius])
            return f"a point uniform on a circle of radius {unit(radius)}"
        case JointNormal():
            return f"{law.size} numbers jointly normal, {_deviations(law, quantities)}, {_correlation(law)}"
        case Rows():
            rows = len(law.table)
            return f"{rows} measured row{'s' if rows > 1 else ''}, each as likely, {_deviations(law, quantities)}"
        case _:
            return f"{type(law).__name__} of {law.size} numbers, {_deviations(law, quantities)}"


def _about(words: str, half_width: float, mean: float, quantity: Quantity | None) -> str:
    unit = _Unit.suiting(quantity, [half_width, mean])
    about = f" about {unit(mean)}" if mean else ""
    return f"{words} ±{unit(half_width)}{about}"


def _mean(mean: float, quantity: Quantity | None) -> str:
    return f", mean {_Unit.suiting(quantity, [mean])(mean)}" if mean else ""


def _spread(law: Law, quantity: Quantity | None) -> str:
    mean, std = float(law.mean_vector[0]), math.sqrt(float(law.covariance[0, 0]))
    return f", mean {_Unit.suiting(quantity, [mean])(mean)}, standard deviation {_Unit.suiting(quantity, [std])(std)}"


def _deviations(law: Law, quantities: Sequence[Quantity | None]) -> str:
    stds = np.sqrt(np.maximum(np.diag(law.covariance), 0.0)).tolist()
    written = ", ".join(
        f"{name.removeprefix('.')} {_Unit.suiting(quantity, [std])(std)}"
        for name, std, quantity in zip(law.components, stds, quantities, strict=True)
    )
    return f"standard deviations {written}"


def _correlation(law: Law) -> str:
    covariance = law.covariance
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(std > 0, std, 1.0)
    largest = float(np.abs((covariance / np.outer(unit, unit))[~np.eye(law.size, dtype=bool)]).max(initial=0.0))
    return f"correlations up to {largest:.3g}" if largest > 1e-12 else "not correlated"
