"""A law as the compiled loops take it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

from precision_pin.inputs.arrays import fix_fields
from precision_pin.typing import Array

__all__ = ["Branch", "KernelRow"]

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
    """A law as the compiled loops take it.

    Attributes
    ----------
    branch
        Which loop makes its numbers of its variates.
    numbers
        What the loop takes, ``(n,)``, or a table of it, ``(r, c)``: see :class:`precision_pin.kernel.loops.Draws`.
    intervals
        What each number stays between there, if that is not what :meth:`~precision_pin.draws.laws.Law.interval` says.
    """

    branch: Branch
    numbers: Array
    intervals: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        fix_fields(self)
