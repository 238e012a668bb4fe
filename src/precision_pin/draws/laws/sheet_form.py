"""The form of a law in a sheet, and the reader of its settings."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, final

from precision_pin.errors import InputError
from precision_pin.inputs.csv_columns import Measured

__all__ = ["DEVIATIONS", "MEAN", "NUMBER", "LawOption", "Place", "SheetForm", "SheetReader"]

Place = tuple[str | int, ...]
"""Keys and positions from a law's mapping down."""

NUMBER: Final[Mapping[str, Any]] = {"type": "string", "description": "a number with its unit"}
DEVIATIONS: Final[Mapping[str, Any]] = {
    "type": "object",
    "properties": {"std": {}},
    "required": ["std"],
    "additionalProperties": False,
}
"""JSON schemas of what laws take under their key."""


@final
@dataclass(frozen=True)
class LawOption:
    """A key that may stand beside a law's own.

    Attributes
    ----------
    key
        The key.
    meaning
        For the schema and the documentation; what several laws say of one key is put together.
    example
        A value that the law's example takes.
    """

    key: str
    meaning: str
    example: Any


MEAN: Final = LawOption("mean", "default 0", "1 mm")


@final
@dataclass(frozen=True)
class SheetForm:
    """The form of a law in a sheet.

    Attributes
    ----------
    key
        The key that names it; empty where no sheet does.
    example
        A law as a mapping, lengths for numbers.
    meaning
        A line for the documentation.
    options
        The keys that may stand beside the law's own; the scope may beside any.
    schema
        JSON schema of what stands under the key.
    """

    key: str
    example: Mapping[str, Any]
    meaning: str
    options: tuple[LawOption, ...] = ()
    schema: Mapping[str, Any] = field(default_factory=lambda: NUMBER)


class SheetReader(Protocol):
    """Reads a law's settings, numbers of one quantity; what is wrong with one is an error at its place."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """The law as a mapping."""

    def value(self, *where: str | int) -> Any:
        """Return what stands at a place."""

    def number(self, *where: str | int) -> float:
        """Return the number at a place in SI."""

    def numbers(self, *where: str | int) -> list[float]:
        """Return the numbers at a place: a list with a unit each, or text with one unit."""

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
        """Refuse anything but a mapping of these keys at a place, with the first one."""

    def error(self, where: Place, reason: str) -> InputError:
        """Return an error at a place."""

    def place_errors(self, where: Place) -> AbstractContextManager[None]:
        """Give a place to the input errors that have none."""
