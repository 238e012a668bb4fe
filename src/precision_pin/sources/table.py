"""Measured rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Final, Literal

import numpy as np

from precision_pin.base import csv_columns, units
from precision_pin.base.errors import InputError, nearest
from precision_pin.draws.laws import Rows
from precision_pin.sources.places import AtPlace
from precision_pin.terms import Draw, LabelledSpace, Posture, Scope, Term

_COLUMNS: Final = dict.fromkeys(("x", "y", "z"), units.LENGTH) | dict.fromkeys(("rx", "ry", "rz"), units.ANGLE)
"""Quantities of the columns of a displacement ``[d; δ]``, in its order."""


@dataclass(frozen=True, kw_only=True)
class Table(AtPlace):
    """Errors of any place that were measured together: each sample takes one row of a table, all equally likely.

    The place's displacement is ``Trans(x, y, z)·Exp((rx, ry, rz))`` in the place's own axes. A missing column counts as
    zero; displacements by other sources add. No law is fitted and rows are not interpolated (the bootstrap: Efron and
    Tibshirani, An Introduction to the Bootstrap, 1993, chapter 6).

    Attributes:
        joint, link, frame: The place; give one of the three: the seat of a joint (its URDF origin frame before its
            motion; if the base is beyond the joint, the frame of its child link), the end of the chain link that a URDF
            link belongs to (the next joint's origin frame, or the tip), or the frame of a URDF link on the path to the
            tip.
        file: A CSV file with columns among x, y, z, rx, ry, rz, with the unit after each name: ``x [mm], rx [mrad]``.
        scope: How often the errors are drawn: ``unit``, ``pose`` or ``visit``.

    Raises:
        InputError: Not one place; a file that cannot be read, is no table of numbers, or has another column or unit.

    Examples:
        >>> from pathlib import Path
        >>> rows = [[0.1, 0], [-0.1, 0]] * 15
        >>> np.savetxt("seats.csv", rows, delimiter=",", header="x [mm],y [mm]", comments="")
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Table(frame="tool", file=Path("seats.csv"))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.1 0.  0. ]
    """

    words: ClassVar[Mapping[str, str]] = {"row": "measured row of {subject}"}

    file: Path
    scope: Literal["unit", "pose", "visit"] = "unit"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scope not in (scope.value for scope in Scope):
            raise InputError(f"scope: of table must be unit, pose or visit, got {self.scope!r}")
        _ = self._law  # read the file now, so that an error in it is raised here

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the columns as one draw."""
        quantities = tuple(_COLUMNS[name] for name in self._law.names)
        return (Draw(f"{label}.row", self._law, Scope(self.scope), quantities),)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each column."""
        place = self.place(posture.chain)
        for row, name in enumerate(_COLUMNS):
            if name in self._law.names:
                yield Term.of(place, np.eye(6)[row], space.component(f"row.{name}"))

    @cached_property
    def _law(self) -> Rows:
        table = csv_columns.read(self.file)
        for name in table.names:
            if name not in _COLUMNS:
                raise InputError(f"{table.file}: unknown column {name!r}: {nearest(name, _COLUMNS)}")
        columns = [table.column(name, _COLUMNS[name]) for name in table.names]
        return Rows(tuple(zip(*columns, strict=True)), table.names)
