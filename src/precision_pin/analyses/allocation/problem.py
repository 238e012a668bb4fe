"""The problem of an allocation as stated by the sheet's ``allocate:``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from precision_pin.analyses.allocation.tolerances import (
    Cost,
    Grades,
    NoScaleError,
    Tolerance,
    contributions,
    read_cost,
    said_of,
)
from precision_pin.base import units
from precision_pin.base.arguments import shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, UnknownNameError, unheard
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.changes import source_of
from precision_pin.sheet.reader import Contents, Sheet
from precision_pin.sheet.settings import TOLERANCE_PATTERN
from precision_pin.statistics import Specification
from precision_pin.statistics.plan import specification

# default bounds of a tolerance, as factors of its value
_RANGE: Final = 100.0
_KEYS: Final = ("path", "cost", "min", "max", "group")
_BOUNDS: Final = ("rms", "worst_case")
_SIGN: Final = re.compile(TOLERANCE_PATTERN)


@dataclass(frozen=True)
class Bound:
    """A limit of the first-order model: root mean square of a norm, or the largest value of each component."""

    kind: str
    limit: float
    is_position: bool

    @property
    def components(self) -> tuple[int, ...]:
        """Limited components of the error, of six; together, or (worst case) each."""
        return (0, 1, 2) if self.is_position else (3, 4, 5)


@dataclass(frozen=True)
class Problem:
    """Tolerances, limits and poses; no poses means all of the sheet's."""

    tolerances: tuple[Tolerance, ...]
    limits: tuple[Specification | Bound, ...]
    poses: tuple[str, ...]


def read_problem(model: ErrorModel, given: Mapping[str, Any] | None) -> Problem:
    """Return the problem of a mapping or, by default, the sheet; InputError if there is none, or it is wrong."""
    if model.sheet is None or model.sheet.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary, so that it has no tolerances to choose")
    contents = model.sheet.contents if given is None else None
    if given is None:
        given = model.sheet.contents.text.data.get("allocate")
        if not given:
            raise InputError("the sheet has no allocate: with tolerances and specs")
    with _at(contents):
        if not isinstance(given, Mapping):
            raise InputError(f"the problem must be a mapping with tolerances and specs, got {shown(given)}")
        _check_keys(given, ("tolerances", "specs", "poses", *_BOUNDS), "allocate")
        bounds = [(kind, {kind: given[kind]}) for kind in _BOUNDS if kind in given]
        listed = _list(given, "tolerances")
        wanted = [] if bounds and "specs" not in given else _list(given, "specs")
    tolerances, limits = [], []
    for k, entry in enumerate(listed):
        with _at(contents, "tolerances", k):
            tolerances.append(_tolerance(model, entry, f"tolerances[{k}]"))
    for k, entry in enumerate(wanted):
        with _at(contents, "specs", k):
            limits.append(_limit(entry, f"specs[{k}]"))
    for kind, entry in bounds:
        with _at(contents, kind):
            limits.append(_limit(entry, kind))
    with _at(contents, "tolerances"):
        _check_together(tolerances)
    with _at(contents, "poses"):
        names = given.get("poses")
        if names is not None and (not isinstance(names, list | tuple) or not names):
            raise InputError(f"allocate: poses is a list of names of poses, got {shown(names)}")
        poses = tuple(map(str, names or model.poses))
        unknown = next((name for name in poses if name not in model.poses), None)
        if unknown is not None or not poses:
            raise UnknownNameError("pose", unknown or "", model.poses)
    return Problem(tuple(tolerances), tuple(limits), poses)


def check_problem(model: ErrorModel, task: Problem) -> None:
    """Raise InputError, as an allocation would at the first pose, for a tolerance that cannot be chosen."""
    assert model.sheet is not None
    try:
        with unheard():
            contributions(model, task.tolerances, task.poses[:1], worst_case=False, advance=lambda _: None)
    except NoScaleError as error:
        with _at(model.sheet.contents, "tolerances", [one.path for one in task.tolerances].index(error.path)):
            raise unchosen(model, error) from None


@contextmanager
def _at(contents: Contents | None, *path: str | int) -> Iterator[None]:
    """Add file and line to an error about an entry of the sheet's ``allocate:``; ``None`` for another problem."""
    try:
        yield
    except InputError as error:
        line = None if contents is None else contents.text.line(("allocate", *path))
        if contents is None or line is None:
            raise
        raise InputError([replace(one, file=contents.file, line=line) for one in error.findings]) from None


def _check_together(tolerances: Sequence[Tolerance]) -> None:
    """Reject a path that is listed twice, and groups without a common value."""
    paths = [one.path for one in tolerances]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice is not None:
        raise InputError(f"allocate: {twice} is listed twice")
    for group in dict.fromkeys(one.group for one in tolerances if one.group):
        own = [one for one in tolerances if one.group == group]
        shared = common_grades(own)
        if len({one.unit in units.LENGTH.units for one in own}) > 1:
            raise InputError(f"allocate: the group {group} has lengths and angles, which cannot be equal")
        if max(one.low for one in own) > min(one.high for one in own) or (shared is not None and not len(shared)):
            raise InputError(
                f"allocate: no value lies within the bounds and grades of every tolerance of the group {group}"
            )


def common_grades(tolerances: Sequence[Tolerance]) -> Array | None:
    """Return the tolerances that all of a group can have, narrowest first; ``None`` if none of them has grades."""
    listed = [one.grades for one in tolerances if one.grades is not None]
    if not listed:
        return None
    low, high = max(one.low for one in tolerances) * (1 - 1e-9), min(one.high for one in tolerances) * (1 + 1e-9)
    is_shared = [
        all(np.isclose(others, width, rtol=1e-9, atol=0).any() for others in listed[1:]) for width in listed[0]
    ]
    return listed[0][np.array(is_shared, dtype=bool) & (listed[0] >= low) & (listed[0] <= high)]


def _list(given: Mapping[str, Any], key: str) -> list[Any]:
    entries = given.get(key)
    if not isinstance(entries, list | tuple) or not entries:
        raise InputError(f"allocate: {key} must be a list with at least one entry, got {shown(entries)}")
    return list(entries)


def _check_keys(given: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    wrong = next((key for key in given if key not in known), None)
    if wrong is not None:
        raise UnknownNameError(f"key of {where}", str(wrong), known)


def _tolerance(model: ErrorModel, entry: object, where: str) -> Tolerance:
    if not isinstance(entry, Mapping) or "path" not in entry or "cost" not in entry:
        raise InputError(f"allocate: {where}: a tolerance has a path and a cost, got {shown(entry)}")
    _check_keys(entry, _KEYS, where)
    path, text = _chosen(model, str(entry["path"]))
    try:
        return _read(entry, path, text)
    except _NoToleranceError as error:
        raise InputError(f"{error.findings[0].message}{beside(model, path)}") from None


class _NoToleranceError(InputError):
    """The path does not name a positive length or angle."""


def _read(entry: Mapping[str, Any], path: str, text: str) -> Tolerance:
    """Return the tolerance of an entry from its path and its text in the sheet."""
    sign, number = _split(text)
    with said_of(f"allocate: {path}", _NoToleranceError):
        before = units.parse(number, units.LENGTH, units.ANGLE)
    unit = units.split(number)[1]
    quantity = units.LENGTH if unit in units.LENGTH.units else units.ANGLE
    with said_of(f"allocate: {path}"):
        low, high = (units.parse(str(entry[key]), quantity) if key in entry else None for key in ("min", "max"))
    if not before > 0:
        raise _NoToleranceError(
            f"allocate: {path} is {shown(text)} in the sheet; give it a positive value to begin with"
        )
    cost = read_cost(entry["cost"], f"allocate: {path}", quantity, path.rpartition(".")[2])
    least, most = before / _RANGE, before * _RANGE
    if isinstance(cost, Grades):
        least, most = float(cost.widths[0]), float(cost.widths[-1])
    elif cost.kind == "logarithmic":
        most = min(most, cost.numbers[1])
    low = least if low is None else low
    high = most if high is None else high
    if not 0 < low <= high:
        raise InputError(f"allocate: {path}: min must be positive and at most max")
    if isinstance(cost, Cost) and cost.kind == "logarithmic" and high > cost.numbers[1]:
        raise InputError(
            f"allocate: {path}: max must be at most the t_max of its logarithmic cost, which is negative beyond"
        )
    tolerance = Tolerance(path, sign, unit, before, low, high, cost, str(entry.get("group", "")))
    if tolerance.grades is not None and not len(tolerance.grades):
        raise InputError(f"allocate: {path}: none of its grades lies from min to max")
    return tolerance


def _chosen(model: ErrorModel, path: str) -> tuple[str, str]:
    """Return the path of the tolerance that a path refers to, and its text in the sheet."""
    values = values_of(model, path)
    given = list(values.values())
    is_alike, is_source = all(value == given[0] for value in given), source_of(path) == path
    if is_source or not is_alike:
        below = [one for full, value in values.items() for one in _tolerances_below(model, full, value)]
        below = [one for one in below if _can_be_chosen(model, one)]
    else:
        below = _tolerances_below(model, path, given[0])
    own = [one for one in below if one.startswith(path)]
    if len(own) == len(below) == 1 and (is_alike or is_source):
        # a law, or a source, with one tolerance may be named as a whole
        return own[0], next(iter(values_of(model, own[0]).values()))
    if is_alike and not is_source and not below and isinstance(given[0], str):
        return path, given[0]
    working = ", ".join(one for one in dict.fromkeys(below) if _can_be_chosen(model, one))
    if not working:
        said = f"one length or angle is expected; it has no tolerance{beside(model, path)}"
    elif not is_alike and not is_source:
        said = f"its values differ, {shown(given[0])} and others; name each, in one group if they are to be equal: {working}"
    elif not own:
        said = f"it is a parameter, which other sources may share; name its tolerance: {working}"
    else:
        said = f"one length or angle is expected; name one of its tolerances: {working}"
    raise InputError(f"allocate: {path}: {said}")


def values_of(model: ErrorModel, path: str) -> dict[str, Any]:
    """Return the values of the sheet at a path, by their full paths; errors as for ``--set``."""
    sheet = model.sheet
    return {} if sheet is None or sheet.contents is None else sheet.contents.values_at(sheet, path)


def _split(text: str) -> tuple[str, str]:
    """Return the text up to a ±, and the number."""
    sign = _SIGN.search(text)
    end = 0 if sign is None else sign.end()
    return text[:end], text[end:].strip()


def _tolerances_below(model: ErrorModel, path: str, value: object) -> list[str]:
    """Return the paths of positive lengths and angles in a value: for a law its width, for a name the parameter's."""
    if isinstance(value, Mapping):
        widths = [key for key in value if key in laws_of_sheets()]
        entries = [(f"{path}.{key}", value[key]) for key in widths or value]
    elif isinstance(value, list):
        entries = [(f"{path}[{k}]", one) for k, one in enumerate(value)]
    else:
        text = str(value).strip()
        named = _parameter(model, text)
        if named:
            return [] if path.startswith("parameters.") else _tolerances_below(model, *named)
        try:
            return [path] if units.parse(_split(text)[1], units.LENGTH, units.ANGLE) > 0 else []
        except InputError:
            return []
    return [found for below, one in entries for found in _tolerances_below(model, below, one)]


def _parameter(model: ErrorModel, text: str) -> tuple[str, object] | None:
    """Return path and value of the parameter of this name, or of this number; ``None`` for anything else."""
    contents = None if model.sheet is None else model.sheet.contents
    stated = {} if contents is None else contents.text.data.get("parameters") or {}
    name = next((one for one in (text, text.rpartition(".")[0]) if one in stated), None)
    return None if name is None else (f"parameters.{name}", stated[name])


def _can_be_chosen(model: ErrorModel, path: str) -> bool:
    """Return whether the error at the first pose scales with a number of the sheet."""
    try:
        one = _read({"path": path, "cost": {"reciprocal": 1}}, path, next(iter(values_of(model, path).values())))
        with unheard():
            contributions(model, [one], list(model.poses)[:1], worst_case=False, advance=lambda _: None)
    except InputError:
        return False
    return True


def unchosen(model: ErrorModel, error: NoScaleError) -> InputError:
    """Return the error about a tolerance with which the error does not scale, with a remedy."""
    path, sheet = error.path, model.sheet
    if sheet is not None and sheet.estimates is not None and _can_be_chosen(model.with_({"calibrated": "none"}), path):
        return InputError(
            f"allocate: {path} is a tolerance of numbers that the sheet's calibrated: has for this robot; choose it for the next "
            "ones by --set calibrated=none, or tolerances of scope visit or pose, which a calibration leaves"
        )
    return InputError(f"{error.findings[0].message}{beside(model, path)}")


def beside(model: ErrorModel, path: str) -> str:
    """Return, for the end of a message, which tolerances of the same source or parameter can be chosen instead."""
    above = source_of(path) or path.rpartition(".")[0]
    try:
        values = values_of(model, above) if above else {}
    except InputError:
        return ""
    below = [one for full, value in values.items() for one in _tolerances_below(model, full, value)]
    found = [one for one in dict.fromkeys(below) if one != path and _can_be_chosen(model, one)]
    return f"; {' or '.join(found)} can be chosen" if found else f"; nothing of {above} can be chosen" if above else ""


def _limit(entry: object, where: str) -> Specification | Bound:
    """Return a specification, or the bound that ``{rms: LIMIT}`` or ``{worst_case: LIMIT}`` states."""
    if isinstance(entry, Specification):
        return entry
    if isinstance(entry, str):
        return specification(entry)
    if not isinstance(entry, Mapping) or len(entry) != 1 or next(iter(entry)) not in _BOUNDS:
        raise InputError(f"allocate: {where}: a text such as '0.5 mm @ 95 %', or rms: or worst_case: with a limit")
    kind, given = next(iter(entry.items()))
    text = str(given)
    with said_of(f"allocate: {where}"):
        limit = units.parse(text, units.LENGTH, units.ANGLE)
    if not limit > 0:
        raise InputError(f"allocate: {where}: the limit must be positive")
    return Bound(kind, limit, units.split(text)[1] in units.LENGTH.units)


def sheet_findings(sheet: Sheet) -> tuple[Finding, ...]:
    """Return what is wrong with the ``allocate:`` of a sheet."""
    try:
        model = ErrorModel.from_sheet(sheet)
        task = read_problem(model, None)
    except InputError as error:
        return error.findings
    try:
        check_problem(model, task)
    except InputError as error:
        if sheet.estimates is None:
            return error.findings
        # all commands but one read the sheet
        return tuple(replace(one, severity="warning", code="W_ALLOCATE") for one in error.findings)
    return ()
