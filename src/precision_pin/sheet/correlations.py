"""The correlations between the parameters of a sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from precision_pin.base import units
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.sheet.findings import Findings
from precision_pin.sheet.law_reader import SettingError
from precision_pin.sheet.text import Path


def correlated_space(
    draws: Sequence[Draw], entries: Sequence[object], findings: Findings, unread: Sequence[str]
) -> Space:
    """Return the space of the sheet's draws with its correlations; errors in these become findings.

    Parameters
    ----------
    draws
        The sheet's parameters.
    entries
        The entries under ``correlations``.
    findings
        Collector of the errors.
    unread
        Names of parameters that could not be read; a correlation that uses one is left out.
    """
    space = Space(tuple(draws))
    for k, entry in enumerate(entries):
        path: Path = ("correlations", k)
        try:
            correlation = _correlation(entry)
            if not set(correlation.names) & set(unread):
                space = Space(space.draws, (*space.correlations, correlation))
        except InputError as error:
            findings.take(path, error)
    return space


def _correlation(entry: object) -> Correlation:
    if not isinstance(entry, Mapping) or not set(entry) <= {"parameters", "correlation", "matrix"}:
        raise InputError(
            "a correlation is {parameters: [a1, a2], correlation: 0.5}, or of several "
            "{parameters: [a1, a2, a3], matrix: [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]}"
        )
    names = entry.get("parameters")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SettingError(("parameters",), "expected the names of two or more parameters: [a1, a2]")
    if ("correlation" in entry) == ("matrix" in entry):
        raise InputError("a correlation needs either correlation: (of two) or matrix:")
    if "correlation" in entry:
        if len(names) != 2:
            raise SettingError(
                ("parameters",), f"correlation: is for two parameters, these are {len(names)}; use matrix:"
            )
        return Correlation.pair(names[0], names[1], _number(entry["correlation"], ("correlation",)))
    rows = entry["matrix"]
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise SettingError(("matrix",), "expected rows of plain numbers: [[1, 0.5], [0.5, 1]]")
    numbers = [[_number(cell, ("matrix", i, j)) for j, cell in enumerate(row)] for i, row in enumerate(rows)]
    try:
        return Correlation(tuple(names), tuple(map(tuple, numbers)))
    except InputError as error:
        raise SettingError(("matrix",), error) from None


def _number(value: Any, where: Path) -> float:
    if isinstance(value, Mapping | list):
        raise SettingError(where, "expected a plain number")
    try:
        return units.parse(value, units.RATIO)
    except InputError as error:
        raise SettingError(where, error) from None
