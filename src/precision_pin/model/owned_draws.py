"""Draws of a model by name, with the sources that use them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from precision_pin.base.errors import UnknownNameError
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Law
from precision_pin.render.html import Table, rendered
from precision_pin.render.text_table import aligned


@dataclass(frozen=True)
class OwnedDraw:
    """Law and scope of a draw, and its owners: the labels of the sources that use it."""

    law: Law
    scope: Scope
    owners: tuple[str, ...]


class OwnedDraws(dict[str, OwnedDraw]):
    """Draws of a model by name."""

    COLUMNS: Final = ("draw", "law (SI)", "drawn for each", "used by")

    def __missing__(self, name: object) -> OwnedDraw:
        raise UnknownNameError("draw", str(name), self)

    @property
    def rows(self) -> list[list[str]]:
        """Name, law, scope and owners of each draw as text."""
        return [[name, repr(draw.law), draw.scope.value, ", ".join(draw.owners)] for name, draw in self.items()]

    def __repr__(self) -> str:
        return "\n".join(aligned([list(self.COLUMNS), *self.rows], words=4))

    def _repr_html_(self) -> str:
        return rendered(f"Draws: {len(self)}", [Table(self.COLUMNS, self.rows, words=4)])
