"""A value of a file of poses, with the line on which it stands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, nearest
from precision_pin.base.text_escape import shown
from precision_pin.robot.pose_grids import MOST_POSES
from precision_pin.sheet.text import Path, Text

_LONGEST: Final = 40


@final
@dataclass(frozen=True, eq=False)
class GridEntry:
    """A value of a file.

    Attributes
    ----------
    text
        The file's contents.
    file
        Its name.
    path
        Keys and positions from the top of the file.
    data
        The value there: text, a list, or keys with values.
    """

    text: Text
    file: str
    path: Path
    data: Any

    def wrong(self, message: str) -> InputError:
        """Return the error that says what is wrong with this value."""
        return InputError([Finding("error", "E_GRID", message, self.file, self.text.line(self.path))])

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Give the errors of the body the place of this value, unless they have a place."""
        try:
            yield
        except InputError as error:
            first = error.findings[0]
            if first.code == "E_GRID":
                raise
            raise self.wrong(first.message) from None

    def keys(self, allowed: Sequence[str], expected: str, *, all_needed: bool = False) -> dict[str, GridEntry]:
        """Return the values by key.

        Parameters
        ----------
        allowed
            The keys there may be.
        expected
            What the keys mean, for messages.
        all_needed
            Whether every key must be there.
        """
        if not isinstance(self.data, dict) or not self.data:
            raise self.wrong(f"{self._named}{expected}; got {self._shown}")
        for key in self.data:
            if key not in allowed:
                entry = self._below(key)
                raise entry.wrong(f"unknown key {shown(key, _LONGEST)}: {nearest(key, allowed)}")
        missing = [key for key in allowed if key not in self.data]
        if all_needed and missing:
            raise self.wrong(f"{self._named}{expected}; {', '.join(missing)} missing")
        return {key: self._below(key) for key in self.data}

    def items(self) -> list[GridEntry]:
        """Return the items of a list, or the value itself if it is none."""
        return [self._below(k) for k in range(len(self.data))] if isinstance(self.data, list) else [self]

    def word(self, allowed: tuple[str, ...]) -> str:
        """Return the value, which is one of some words."""
        if self.data not in allowed:
            raise self.wrong(f"{self._named}expected {' or '.join(allowed)}, got {self._shown}")
        return str(self.data)

    def whole(self, least: int, most: int = MOST_POSES) -> int:
        """Return a whole number."""
        digits = self.data if isinstance(self.data, str) else ""
        if not (digits.isascii() and digits.isdigit() and len(digits) < 10 and least <= int(digits) <= most):
            raise self.wrong(f"{self._named}expected a whole number from {least} to {most:,}, got {self._shown}")
        return int(digits)

    def numbers(self, quantity: units.Quantity, count: int, example: str) -> list[float]:
        """Return some numbers with one unit, in SI."""
        if not isinstance(self.data, str):
            raise self.wrong(f"{self._named}expected {count} numbers, such as {example!r}, got {self._shown}")
        return self._parsed(self, quantity, count)

    def values(self, quantity: units.Quantity, example: str) -> Array:
        """Return the values of a coordinate: one or several with one unit, a list, or so many from one to another."""
        if isinstance(self.data, dict):
            unit = example.split()[-1]
            ends = self.keys(
                ("from", "to", "count"),
                f"a range is {{from: {example}, to: 90 {unit}, count: 7}}",
                all_needed=True,
            )
            first, last = (self._parsed(ends[key], quantity, 1)[0] for key in ("from", "to"))
            return np.linspace(first, last, ends["count"].whole(2))
        items = self.items()
        if not items:
            raise self.wrong(f"{self._named}no values; give at least one, such as {example!r}")
        return np.array([value for item in items for value in self._parsed(item, quantity, None)])

    def _parsed(self, entry: GridEntry, quantity: units.Quantity, count: int | None) -> list[float]:
        with entry.naming():
            try:
                return units.parse_vector(entry.data, quantity, count=count)
            except InputError as error:
                raise InputError(f"{entry._named}{error.findings[0].message}") from None

    def _below(self, key: str | int) -> GridEntry:
        return GridEntry(self.text, self.file, (*self.path, key), self.data[key])

    @property
    def _named(self) -> str:
        return "".join(f"{key}: " for key in self.path[-1:] if isinstance(key, str))

    @property
    def _shown(self) -> str:
        if self.data in ("", None):
            return "nothing"
        if isinstance(self.data, str):
            return shown(self.data, _LONGEST)
        return "keys with values" if isinstance(self.data, dict) else "a list"
