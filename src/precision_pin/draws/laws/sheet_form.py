"""The form of a law in a sheet, the reader of its settings, and phrases that describe it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.csv_columns import Measured
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.render.display_units import WrittenUnit

Place = tuple[str | int, ...]
"""Path of keys and indices below the mapping of a law."""

NUMBER: Final[Mapping[str, Any]] = {"type": "string", "description": "a number with its unit"}


def object_schema(properties: Mapping[str, Any], *required: str) -> Mapping[str, Any]:
    """Return the JSON schema of a mapping with these keys and no other."""
    return {"type": "object", "properties": properties, "required": list(required), "additionalProperties": False}


DEVIATIONS: Final = object_schema({"std": {}}, "std")
"""JSON schema of a standard deviation under a law's key."""


@final
@dataclass(frozen=True)
class LawOption:
    """A key that is allowed beside a law's own.

    Attributes:
        key: The key.
        meaning: Text for the schema and the documentation; the texts of several laws for one key are joined.
        example: A value that fits the law's example.
        is_ratio: True for a number without a unit.
    """

    key: str
    meaning: str
    example: Any
    is_ratio: bool = False


MEAN: Final = LawOption("mean", "default 0", "1 mm")


@final
@dataclass(frozen=True)
class SheetForm:
    """The form of a law in a sheet.

    Attributes:
        key: The key that names it; empty if no sheet can.
        example: A law as a mapping, with lengths as its numbers.
        meaning: A line for the documentation.
        options: The keys allowed beside the law's own; ``scope`` is allowed beside any.
        schema: JSON schema of the value under the key.
    """

    key: str
    example: Mapping[str, Any]
    meaning: str
    options: tuple[LawOption, ...] = ()
    schema: Mapping[str, Any] = field(default_factory=lambda: NUMBER)


class SheetReader(Protocol):
    """Reader of a law's settings, which are numbers of one quantity; an error names its place in the sheet."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """The law as a mapping."""

    def value(self, *where: str | int) -> Any:
        """Return the value at a place."""

    def number(self, *where: str | int) -> float:
        """Return the number at a place in SI."""

    def numbers(self, *where: str | int) -> list[float]:
        """Return the numbers at a place: a list with a unit for each, or text with one unit for all."""

    def half_width(self, *where: str | int) -> float:
        """Return the number at a place, which must not be negative."""

    def mean(self) -> float:
        """Return the mean, 0 if left out."""

    def ratio(self, *where: str | int) -> float:
        """Return the number without a unit at a place."""

    def file(self, *where: str | int) -> Measured:
        """Return the contents of the file at a place, its path relative to the sheet."""

    def column(self, table: Measured, name: str, where: Place) -> tuple[float, ...]:
        """Return a file's column in SI."""

    def ratio_column(self, table: Measured, name: str, where: Place) -> tuple[float, ...]:
        """Return a file's column of numbers without a unit."""

    def only(self, where: Place, *keys: str) -> None:
        """Refuse anything but a mapping of these keys at a place; the first key is required."""

    def error(self, where: Place, reason: str) -> InputError:
        """Return an error at a place."""

    def place_errors(self, where: Place) -> AbstractContextManager[None]:
        """Add a place to input errors that have none."""


def write_number(value: float, quantity: Quantity | None) -> str:
    """Return a number with a suitable unit."""
    return WrittenUnit.suiting(quantity, [value])(value)


def about(half_width: float, mean: float, quantity: Quantity | None) -> str:
    """Return a half-width as text, with the mean if it is not zero."""
    unit = WrittenUnit.suiting(quantity, [half_width, mean])
    return f"±{unit(half_width)}" + (f" about {unit(mean)}" if mean else "")


def mean_beside(mean: float, quantity: Quantity | None) -> str:
    """Return the phrase for a mean, empty for zero."""
    return f", mean {write_number(mean, quantity)}" if mean else ""


def spread(mean: Array, covariance: Array, quantity: Quantity | None) -> str:
    """Return the phrase for the mean and the standard deviation of one number."""
    std = math.sqrt(float(covariance[0, 0]))
    return f", mean {write_number(float(mean[0]), quantity)}, standard deviation {write_number(std, quantity)}"


def deviations(components: Sequence[str], covariance: Array, quantities: Sequence[Quantity | None]) -> str:
    """Return the phrase for the standard deviations of several numbers."""
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    each = zip(components, stds, quantities, strict=True)
    return "standard deviations " + ", ".join(
        f"{name.removeprefix('.')} {write_number(std, quantity)}" for name, std, quantity in each
    )
