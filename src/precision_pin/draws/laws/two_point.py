"""The law of one of two values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.bases import BoundedLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import take_number, take_size
from precision_pin.draws.laws.numerics import cumulants_of
from precision_pin.draws.laws.projection import Lines
from precision_pin.draws.laws.sheet_form import LawOption, SheetForm, SheetReader
from precision_pin.render.display_units import WrittenUnit


@final
@dataclass(frozen=True)
class TwoPoint(BoundedLaw):
    """One of two values, centre - half_width or centre + half_width, such as a clearance taken up on one side.

    Attributes
    ----------
    half_width
        Half the distance between the two.
    centre
        Halfway between them; the mean only where both are equally likely.
    probability
        Probability of the upper one.
    """

    form: ClassVar = SheetForm(
        "two_point",
        {"two_point": "0.05 mm"},
        "centre - t or centre + t, nothing between; `probability` of the upper one, default 0.5; `centre`, default 0",
        (
            LawOption("centre", "two_point: halfway between the two, default 0", "1 mm"),
            LawOption("probability", "two_point: of the upper one, default 0.5", "0.3"),
        ),
    )
    half_width: float
    centre: float = 0.0
    probability: float = 0.5

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of a two-point law")
        take_number(self, "centre", "the centre of a two-point law")
        probability = check_number(
            "the probability of a two-point law", self.probability, "above 0 and below 1", lambda value: 0 < value < 1
        )
        object.__setattr__(self, "probability", probability)

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> TwoPoint:
        """Return the law written in a sheet."""
        half_width = reader.half_width("two_point")
        centre = reader.number("centre") if "centre" in reader.settings else 0.0
        probability = reader.ratio("probability") if "probability" in reader.settings else 0.5
        if not 0 < probability < 1:
            raise reader.error(
                ("probability",), f"probability must lie above 0 and below 1, got {reader.settings['probability']}"
            )
        return cls(half_width, centre, probability)

    @property
    def ends(self) -> tuple[float, float]:
        """The two values."""
        return self.centre - self.half_width, self.centre + self.half_width

    @property
    def threshold(self) -> float:
        """The uniform number above which the upper value is drawn."""
        return 1 - self.probability

    @property
    def breaks(self) -> tuple[float, ...]:
        """The threshold."""
        return (self.threshold,)

    @property
    def mean_vector(self) -> Array:
        """Centre + t (2p - 1), ``(1,)``."""
        return np.array([self.centre + self.half_width * (2 * self.probability - 1)])

    @property
    def covariance(self) -> Array:
        """4 p (1 - p) t² as ``(1, 1)``."""
        return np.array([[4 * self.probability * (1 - self.probability) * self.half_width**2]])

    def sample(self, variates: Array) -> Array:
        """Return the upper value for u above 1 - p, else the lower one."""
        return self.centre + np.where(variates > self.threshold, self.half_width, -self.half_width)

    @property
    def cell_edges(self) -> Array:
        """0, the threshold, 1."""
        return np.array([0.0, self.threshold, 1.0])

    def cumulants(self) -> Array:
        """Return the cumulants of the two values."""
        half, p = self.half_width, self.probability
        return cumulants_of(np.array([[-half], [half]]), np.array([1 - p, p]))

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        low, high = self.ends
        unit = WrittenUnit.suiting(quantities[0], self.ends)
        return f"{unit(low)} or {unit(high)}, the latter with probability {100 * self.probability:.6g} %"

    def kernel_row(self) -> KernelRow:
        """Return centre, half-width and threshold."""
        return KernelRow("two_point", np.array([self.centre, self.half_width, self.threshold]))

    def projection(self, weights: Array) -> Lines:
        """Return the projection on weights."""
        ends = float(weights[0]) * (np.array(self.ends) - self.mean_vector)
        return Lines.of(np.array([1 - self.probability, self.probability]), ends, ends)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return (cos(t half_width) + i (2p - 1) sin(t half_width)) exp(i t centre), t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)[0]
        swing = np.cos(t * self.half_width) + 1j * (2 * self.probability - 1) * np.sin(t * self.half_width)
        value: NDArray[np.complex128] = np.exp(1j * t * self.centre) * swing
        return value
