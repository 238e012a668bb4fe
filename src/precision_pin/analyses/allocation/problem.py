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
    changed_model,
    contributions,
    prefix_errors,
    read_cost,
)
from precision_pin.analyses.registry import fitting_specs
from precision_pin.base import units
from precision_pin.base.arguments import shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, UnknownNameError, unheard
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.changes import source_of
from precision_pin.sheet.drawing_tolerances import TOLERANCE_PATTERN
from precision_pin.sheet.reader import Contents, Sheet
from precision_pin.statistics import Specification
from precision_pin.statistics.limits import LIMITED, Limited
from precision_pin.statistics.plan import is_joint, specification

# default bounds of a tolerance, as factors of its value
_RANGE: Final = 100.0
# ratio up to which a default upper bound approaches the widest value of the model
_WITHIN: Final = 1.001
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
    def of(self) -> Limited:
        """The limited components; together, or (worst case) each."""
        return LIMITED["position.norm" if self.is_position else "attitude.norm"]


@dataclass(frozen=True)
class Problem:
    """Tolerances, limits and poses; no poses means all of the sheet's."""

    tolerances: tuple[Tolerance, ...]
    limits: tuple[Specification | Bound, ...]
    poses: tuple[str, ...]


def read_problem(model: ErrorModel, problem: Mapping[str, Any] | None) -> Problem:
    """Return the problem of a mapping or, by default, the sheet; InputError if there is none, or it is wrong."""
    if model.sheet is None or model.sheet.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary, so it has no tolerances to choose")
    contents = model.sheet.contents if problem is None else None
    if problem is None:
        problem = model.sheet.contents.text.data.get("allocate")
        if not problem:
            raise InputError("the sheet has no allocate: with tolerances and specs")
    with _locate(contents):
        if not isinstance(problem, Mapping):
            raise InputError(f"the problem must be a mapping with tolerances and specs, got {shown(problem)}")
        _check_keys(problem, ("tolerances", "specs", "poses", *_BOUNDS), "allocate")
        bounds = [(kind, {kind: problem[kind]}) for kind in _BOUNDS if kind in problem]
        entries = _entries(problem, "tolerances")
        sheet_specs = [] if "specs" in problem else fitting_specs(model.sheet)
        has_list = "specs" in problem or not (sheet_specs or bounds)
        specs = _entries(problem, "specs") if has_list else [spec.text for spec in sheet_specs]
    tolerances, limits = [], []
    for k, entry in enumerate(entries):
        with _locate(contents, "tolerances", k):
            tolerances.append(_tolerance(model, entry, f"tolerances[{k}]"))
    for k, entry in enumerate(specs):
        with _locate(contents, "specs", k):
            limits.append(_limit(entry, f"specs[{k}]"))
    for kind, entry in bounds:
        with _locate(contents, kind):
            limits.append(_limit(entry, kind))
    with _locate(contents, "tolerances"):
        _check_groups(tolerances)
    with _locate(contents, "poses"):
        names = problem.get("poses")
        if names is not None and (not isinstance(names, list | tuple) or not names):
            raise InputError(f"allocate: poses is a list of names of poses, got {shown(names)}")
        poses = tuple(map(str, names or model.poses))
        stray = next((name for name in poses if name not in model.poses), None)
        if stray is not None or not poses:
            raise UnknownNameError("pose", stray or "", model.poses)
    for spec in sheet_specs:
        if spec.poses and not {*poses} <= {*spec.poses}:
            raise InputError(f"allocate: the limit {spec.text} is not for all of its poses; list poses: or specs:")
    return Problem(tuple(tolerances), tuple(limits), poses)


def check_problem(model: ErrorModel, task: Problem) -> None:
    """Raise InputError, as an allocation would at the first pose, for a tolerance that cannot be chosen."""
    assert model.sheet is not None
    try:
        with unheard():
            contributions(model, task.tolerances, task.poses[:1], worst_case=False, advance=lambda _: None)
    except NoScaleError as error:
        with _locate(model.sheet.contents, "tolerances", [t.path for t in task.tolerances].index(error.path)):
            raise no_scale_error(model, error) from None


@contextmanager
def _locate(contents: Contents | None, *path: str | int) -> Iterator[None]:
    """Add file and line to an error about an entry of the sheet's ``allocate:``; ``None`` for another problem."""
    try:
        yield
    except InputError as error:
        line = None if contents is None else contents.text.line(("allocate", *path))
        if contents is None or line is None:
            raise
        raise InputError([replace(finding, file=contents.file, line=line) for finding in error.findings]) from None


def _check_groups(tolerances: Sequence[Tolerance]) -> None:
    """Reject a path that is listed twice, and groups without a common value."""
    paths = [t.path for t in tolerances]
    repeated = next((path for path in paths if paths.count(path) > 1), None)
    if repeated is not None:
        raise InputError(f"allocate: {repeated} is listed twice")
    for group in dict.fromkeys(t.group for t in tolerances if t.group):
        members = [t for t in tolerances if t.group == group]
        shared = common_grades(members)
        quantities = list(dict.fromkeys(t.quantity.name for t in members))
        if len(quantities) > 1:
            names = " and ".join(quantities)
            raise InputError(f"allocate: the group {group} has several quantities, which cannot be equal: {names}")
        if max(t.low for t in members) > min(t.high for t in members) or (shared is not None and not len(shared)):
            raise InputError(
                f"allocate: no value lies within the bounds and grades of every tolerance of the group {group}"
            )


def common_grades(tolerances: Sequence[Tolerance]) -> Array | None:
    """Return the tolerances that all of a group can have, narrowest first; ``None`` if none of them has grades."""
    grids = [tol.grades for tol in tolerances if tol.grades is not None]
    if not grids:
        return None
    low, high = max(tol.low for tol in tolerances) * (1 - 1e-9), min(tol.high for tol in tolerances) * (1 + 1e-9)
    is_shared = [all(np.isclose(values, width, rtol=1e-9, atol=0).any() for values in grids[1:]) for width in grids[0]]
    return grids[0][np.array(is_shared, dtype=bool) & (grids[0] >= low) & (grids[0] <= high)]


def _entries(problem: Mapping[str, Any], key: str) -> list[Any]:
    entries = problem.get(key)
    if not isinstance(entries, list | tuple) or not entries:
        raise InputError(f"allocate: {key} must be a list with at least one entry, got {shown(entries)}")
    return list(entries)


def _check_keys(mapping: Mapping[str, Any], allowed: tuple[str, ...], where: str) -> None:
    wrong = next((key for key in mapping if key not in allowed), None)
    if wrong is not None:
        raise UnknownNameError(f"key of {where}", str(wrong), allowed)


def _tolerance(model: ErrorModel, entry: object, where: str) -> Tolerance:
    if not isinstance(entry, Mapping) or "path" not in entry or "cost" not in entry:
        raise InputError(f"allocate: {where}: a tolerance has a path and a cost, got {shown(entry)}")
    _check_keys(entry, _KEYS, where)
    path, text = _resolve_path(model, str(entry["path"]))
    try:
        tolerance = _read(entry, path, text)
    except _NoToleranceError as error:
        raise InputError(f"{error.findings[0].message}{alternatives(model, path)}") from None
    return _within_model(model, tolerance, is_bounded="max" in entry or tolerance.grades is not None)


def _within_model(model: ErrorModel, tolerance: Tolerance, *, is_bounded: bool) -> Tolerance:
    """Return a tolerance whose upper bound the model admits (a stiffness stays positive): the default one is lowered."""
    rejection = _rejection(model, tolerance, tolerance.high)
    if rejection and is_bounded:
        raise InputError(f"allocate: {tolerance.path}: {tolerance.number(tolerance.high)} is too wide: {rejection}")
    high, rejected = (tolerance.low, tolerance.high) if rejection else (tolerance.high, tolerance.high)
    while rejected > _WITHIN * high:
        middle = float(np.sqrt(high * rejected))
        high, rejected = (high, middle) if _rejection(model, tolerance, middle) else (middle, rejected)
    return replace(tolerance, high=high)


def _rejection(model: ErrorModel, tolerance: Tolerance, value: float) -> str:
    """Return why the model does not admit a value; empty if it does."""
    try:
        with unheard():
            changed_model(model, [tolerance], np.array([value]))
    except InputError as error:
        return error.findings[0].message
    return ""


class _NoToleranceError(InputError):
    """The path does not name a positive number."""


def _read(entry: Mapping[str, Any], path: str, text: str) -> Tolerance:
    """Return the tolerance of an entry from its path and its text in the sheet."""
    sign, number = _split(text)
    with prefix_errors(f"allocate: {path}", _NoToleranceError):
        value = units.parse(number, *units.QUANTITIES)
    unit = units.split(number)[1]
    quantity = units.quantity_of(unit).written_in(unit)
    with prefix_errors(f"allocate: {path}"):
        low, high = (units.parse(str(entry[key]), quantity) if key in entry else None for key in ("min", "max"))
    if not value > 0:
        raise _NoToleranceError(f"allocate: {path} is {shown(text)} in the sheet; give it a positive value first")
    cost = read_cost(entry["cost"], f"allocate: {path}", quantity, path.rpartition(".")[2])
    minimum, maximum = value / _RANGE, value * _RANGE
    if isinstance(cost, Grades):
        minimum, maximum = float(cost.widths[0]), float(cost.widths[-1])
    elif cost.kind == "logarithmic":
        maximum = min(maximum, cost.numbers[1])
    low = minimum if low is None else low
    high = maximum if high is None else high
    if not 0 < low <= high:
        raise InputError(f"allocate: {path}: min must be positive and at most max")
    if isinstance(cost, Cost) and cost.kind == "logarithmic" and high > cost.numbers[1]:
        raise InputError(
            f"allocate: {path}: max must be at most the t_max of its logarithmic cost, which is negative beyond"
        )
    tolerance = Tolerance(path, sign, unit, value, low, high, cost, str(entry.get("group", "")))
    if tolerance.grades is not None and not len(tolerance.grades):
        raise InputError(f"allocate: {path}: none of its grades lies from min to max")
    return tolerance


def _resolve_path(model: ErrorModel, path: str) -> tuple[str, str]:
    """Return the path of the tolerance that a path refers to, and its text in the sheet."""
    values = values_of(model, path)
    texts = list(values.values())
    is_alike, is_source = all(value == texts[0] for value in texts), source_of(path) == path
    if is_source or not is_alike:
        paths = [name for place, value in values.items() for name in _tolerances_below(model, place, value)]
        paths = [name for name in paths if _can_be_chosen(model, name)]
    else:
        paths = _tolerances_below(model, path, texts[0])
    inside = [name for name in paths if name.startswith(path)]
    if len(inside) == len(paths) == 1 and (is_alike or is_source):
        # a law, or a source, with one tolerance may be named as a whole
        return inside[0], next(iter(values_of(model, inside[0]).values()))
    if is_alike and not is_source and not paths and isinstance(texts[0], str):
        return path, texts[0]
    working = ", ".join(name for name in dict.fromkeys(paths) if _can_be_chosen(model, name))
    if not working:
        reason = f"one tolerance is expected; it has none{alternatives(model, path)}"
    elif not is_alike and not is_source:
        reason = f"its values differ, {shown(texts[0])} and others; name each, in one group if they are to be equal: {working}"
    elif not inside:
        reason = f"it is a parameter, which other sources may share; name its tolerance: {working}"
    else:
        reason = f"one tolerance is expected; name one of its tolerances: {working}"
    raise InputError(f"allocate: {path}: {reason}")


def values_of(model: ErrorModel, path: str) -> dict[str, Any]:
    """Return the values of the sheet at a path, by their full paths; errors as for ``--set``."""
    sheet = model.sheet
    return {} if sheet is None or sheet.contents is None else sheet.contents.values_at(sheet, path)


def _split(text: str) -> tuple[str, str]:
    """Return the text up to a ±, and the number."""
    sign = _SIGN.search(text)
    stop = 0 if sign is None else sign.end()
    return text[:stop], text[stop:].strip()


def _tolerances_below(model: ErrorModel, path: str, value: object) -> list[str]:
    """Return the paths of positive numbers in a value: for a law its width, for a name the parameter's."""
    if isinstance(value, Mapping):
        widths = [key for key in value if key in laws_of_sheets()]
        entries = [(f"{path}.{key}", value[key]) for key in widths or value]
    elif isinstance(value, list):
        entries = [(f"{path}[{k}]", item) for k, item in enumerate(value)]
    else:
        text = str(value).strip()
        named = _parameter(model, text)
        if named:
            return [] if path.startswith("parameters.") else _tolerances_below(model, *named)
        try:
            return [path] if units.parse(_split(text)[1], *units.QUANTITIES) > 0 else []
        except InputError:
            return []
    return [path_ for below, entry in entries for path_ in _tolerances_below(model, below, entry)]


def _parameter(model: ErrorModel, text: str) -> tuple[str, object] | None:
    """Return path and value of the parameter of this name, or of this number; ``None`` for anything else."""
    contents = None if model.sheet is None else model.sheet.contents
    stated = {} if contents is None else contents.text.data.get("parameters") or {}
    name = next((key for key in (text, text.rpartition(".")[0]) if key in stated), None)
    return None if name is None else (f"parameters.{name}", stated[name])


def _can_be_chosen(model: ErrorModel, path: str) -> bool:
    """Return whether the error at the first pose scales with a number of the sheet."""
    try:
        tolerance = _read({"path": path, "cost": {"reciprocal": 1}}, path, next(iter(values_of(model, path).values())))
        with unheard():
            contributions(model, [tolerance], list(model.poses)[:1], worst_case=False, advance=lambda _: None)
    except InputError:
        return False
    return True


def no_scale_error(model: ErrorModel, error: NoScaleError) -> InputError:
    """Return the error about a tolerance with which the error does not scale, with a remedy."""
    path, sheet = error.path, model.sheet
    if sheet is not None and sheet.estimates is not None and _can_be_chosen(model.with_({"calibrated": "none"}), path):
        return InputError(
            f"allocate: {path} is a tolerance of numbers that the sheet's calibrated: has for this robot; choose it for the next "
            "ones by --set calibrated=none, or tolerances of scope visit or pose, which a calibration leaves"
        )
    return InputError(f"{error.findings[0].message}{alternatives(model, path)}")


def alternatives(model: ErrorModel, path: str) -> str:
    """Return the end of a message: tolerances of the same source or parameter that can be chosen instead."""
    owner = source_of(path) or path.rpartition(".")[0]
    try:
        values = values_of(model, owner) if owner else {}
    except InputError:
        return ""
    paths = [name for place, value in values.items() for name in _tolerances_below(model, place, value)]
    valid = [name for name in dict.fromkeys(paths) if name != path and _can_be_chosen(model, name)]
    return f"; {' or '.join(valid)} can be chosen" if valid else f"; nothing of {owner} can be chosen" if owner else ""


def _limit(entry: object, where: str) -> Specification | Bound:
    """Return a specification, or the bound that ``{rms: LIMIT}`` or ``{worst_case: LIMIT}`` states."""
    if isinstance(entry, str):
        entry = specification(entry)
    if isinstance(entry, Specification):
        if is_joint(entry.quantity):
            raise InputError(f"allocate: {where}: give each limit of '{entry.quantity}' as a specification of its own")
        return entry
    if not isinstance(entry, Mapping) or len(entry) != 1 or next(iter(entry)) not in _BOUNDS:
        raise InputError(f"allocate: {where}: a text such as '0.5 mm @ 95 %', or rms: or worst_case: with a limit")
    kind, limit_ = next(iter(entry.items()))
    text = str(limit_)
    with prefix_errors(f"allocate: {where}"):
        limit = units.parse(text, units.LENGTH, units.ANGLE)
    if not limit > 0:
        raise InputError(f"allocate: {where}: the limit must be positive")
    return Bound(kind, limit, units.split(text)[1] in units.LENGTH.units)


def sheet_findings(sheet: Sheet) -> tuple[Finding, ...]:
    """Return the faults of a sheet's ``allocate:``."""
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
        return tuple(replace(finding, severity="warning", code="W_ALLOCATE") for finding in error.findings)
    return ()
