"""The normal law."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Literal, final

import numpy as np

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import Law, take_number, take_size
from precision_pin.draws.laws.sheet_form import DEVIATIONS, MEAN, NUMBER, LawOption, SheetForm, SheetReader
from precision_pin.draws.laws.truncated_normal import TruncatedNormal
from precision_pin.draws.laws.wording import mean_beside, write_number
from precision_pin.render.display_units import WrittenUnit

_NOT_NEGATIVE: Final = "zero or more and finite"


@final
@dataclass(frozen=True)
class Normal(SymmetricLaw):
    """Normal of standard deviation ``std``.

    Attributes
    ----------
    k
        Standard deviations in the half-width that it was made from; ``None`` where it was made from ``std``.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    is_normal: ClassVar[bool] = True
    form: ClassVar = SheetForm(
        "normal",
        {"normal": "0.06 mm"},
        "t is k standard deviations, σ = t/k; `normal: {std: 0.02 mm}` gives σ itself",
        (
            MEAN,
            LawOption("k", "normal: t has the standard deviation t/k; default 3", "2"),
            LawOption("truncated", "cut a normal law off at its half-width, mean ± k standard deviations", "true"),
        ),
        {"anyOf": [NUMBER, DEVIATIONS]},
    )
    std: float
    mean: float = 0.0
    k: float | None = field(default=None, kw_only=True, compare=False, repr=False)

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a normal law")
        take_number(self, "mean", "the mean of a normal law")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Normal | TruncatedNormal:
        """Return the law written in a sheet, truncated if the sheet says so."""
        value, k = reader.settings["normal"], _read_k(reader)
        if isinstance(value, Mapping):
            if set(value) != {"std"}:
                raise reader.error(
                    ("normal",),
                    "normal takes a half-width (normal: 0.1 mm) or a standard deviation (normal: {std: 0.03 mm})",
                )
            std = reader.half_width("normal", "std")
        else:
            std = reader.half_width("normal") / k
        mean, truncated = reader.mean(), _read_truncated(reader)
        if isinstance(value, Mapping) and "k" in reader.settings and not truncated:
            raise reader.error(
                ("k",), "k has no effect here: {std: …} is the standard deviation itself, and the law is not truncated"
            )
        return (
            TruncatedNormal(std, mean, k) if truncated else cls(std, mean, k=None if isinstance(value, Mapping) else k)
        )

    @classmethod
    def from_half_width(cls, half_width: float, mean: float = 0.0, *, k: float = 3.0) -> Normal:
        """Return the law whose half-width is k standard deviations."""
        half = check_number("the half-width of a normal law", half_width, _NOT_NEGATIVE, lambda value: value >= 0)
        return cls(half / check_number("k", k, "positive and finite", lambda value: value > 0), mean, k=k)

    @property
    def variance(self) -> float:
        """σ²."""
        return self.std**2

    @property
    def reach(self) -> float:
        """Infinite, unless σ is zero."""
        return math.inf if self.std else 0.0

    def sample(self, variates: Array) -> Array:
        """Return mean + σ z."""
        return self.mean + self.std * variates

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return ρ σ₁ σ₂ of two normal numbers."""
        return correlation * self.std * other.std if isinstance(other, Normal) else None

    def covariance_by_scores(self, correlation: float, nodes: Callable[[float], tuple[Array, Array]]) -> float:
        """Return the integral of ρ σ z, the number's mean at a score z of the other."""
        z, weighted = nodes(0.0)
        return self.std * correlation * float((weighted * z).sum())

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        (quantity,) = quantities
        return f"normal, standard deviation {write_number(self.std, quantity)}{mean_beside(self.mean, quantity)}"

    def tolerance(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the half-width with the standard deviation, ``±0.01° (σ 0.0033°)``; without a half-width ``σ 0.1 mm``."""
        deviation = super().tolerance(quantities)
        if self.k is None or not deviation:
            return deviation
        unit = WrittenUnit.suiting(quantities[0], [self.k * self.std])
        sizes = unit.short(self.k * self.std), f"{self.std * unit.per_si:.2g} {unit.name}"
        return "±{} (σ {})".format(*sizes).replace(" deg", "°")

    def kernel_row(self) -> KernelRow:
        """Return mean and standard deviation."""
        return KernelRow("normal", np.array([self.mean, self.std]))

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = np.exp(-((self.std * frequency) ** 2) / 2)
        return value


def _read_k(reader: SheetReader) -> float:
    k = reader.ratio("k") if "k" in reader.settings else 3.0
    if not k > 0:
        raise reader.error(("k",), f"k must be positive, got {reader.settings['k']}")
    return k


def _read_truncated(reader: SheetReader) -> bool:
    value = str(reader.settings.get("truncated", "false")).lower()
    if value not in ("true", "false"):
        raise reader.error(("truncated",), f"truncated must be true or false, got {reader.settings['truncated']!r}")
    return value == "true"
