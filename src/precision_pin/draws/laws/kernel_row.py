"""The row of a law in the tables of the compiled loops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array

Branch = Literal[
    "fixed",
    "normal",
    "uniform",
    "triangular",
    "truncated",
    "disc",
    "circle",
    "joint",
    "lognormal",
    "arcsine",
    "two_point",
    "empirical",
    "table",
]
"""The loops of ``apply_laws`` in kernel/loops.py; several laws may use one."""


@final
@dataclass(frozen=True, eq=False)
class KernelRow:
    """The row of a law in the tables of the compiled loops.

    Attributes
    ----------
    branch
        The loop that turns its variates into its numbers.
    numbers
        The loop's parameters, ``(n,)``, or a table of them, ``(r, c)``: see :class:`precision_pin.kernel.loops.Draws`.
    intervals
        Bounds of each number in the loop, if they differ from :meth:`~precision_pin.draws.laws.Law.interval`.
    """

    branch: Branch
    numbers: Array
    intervals: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        fix_fields(self)
