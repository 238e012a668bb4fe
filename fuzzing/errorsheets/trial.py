"""What must hold of a sheet, whatever it says: refused with its lines, or read as it is meant, with finite errors."""

from __future__ import annotations

import random
import time
import traceback
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from fuzzing.errorsheets.grammar import random_sheet
from fuzzing.errorsheets.mutations import broken
from fuzzing.errorsheets.spelling import respelt, written
from precision_pin.base.errors import InputError, PrecisionPinWarning
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet import Sheet, read
from precision_pin.sheet.text import read_text

__all__ = ["Outcome", "sheet_of", "try_sheet"]

SLOW = 3.0
"""Seconds of processor time that no sheet of this size may take."""
UNITS = 64
POSES = 3
CLOSE = 1e-12
CLOSE_AT_REST = 1e-11
"""Of arms at equilibrium, which is iterated until steps are 1e-13: its derivatives carry some more."""
ROUNDING = 1e-15
"""Errors (m, rad) that are rounding of the arm's size."""
WITHOUT_LINE = ("E_FILE", "E_FILE_KIND", "E_FILE_MISSING", "E_YAML")
"""Findings about a whole file, or about text that ends too soon."""

OTHERWISE = set("%\x85\u2028\u2029\ufeff")
"""Directives, and characters that YAML 1.1, which the other reader reads, takes for line ends or blanks; YAML 1.2 does not."""


@dataclass
class Outcome:
    """What became of a sheet, and what did not hold."""

    accepted: bool = False
    codes: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def sheet_of(seed: int, number: int) -> tuple[bytes, bytes | None, dict[str, str]]:
    """Return a sheet of a run; every fourth one is whole, with another that says the same and its names of parameters."""
    generator = random.Random(f"{seed}/{number}")
    if number % 4:
        return broken(generator), None, {}
    data = random_sheet(generator)
    other, names = respelt(data, generator)
    return written(data).encode(), written(other, generator).encode(), names


def try_sheet(seed: int, number: int, folder: Path) -> Outcome:
    """Read a sheet of a run in a folder that holds what it names, and return what did not hold."""
    text, other, names = sheet_of(seed, number)
    outcome = Outcome()
    start = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", PrecisionPinWarning)  # stretched assumptions are no fault
            model = _read(folder / "sheet.yaml", text, outcome)
            if other is not None:
                _compare(model, _read(folder / "other.yaml", other, outcome), names, outcome)
    except Exception:  # noqa: BLE001 - whatever escapes is what is looked for
        lines = traceback.format_exc().splitlines()
        outcome.problems.append(f"escaped: {lines[-1][:200]} ({_where(lines)})")
    spent = time.process_time() - start
    if spent > SLOW:
        outcome.problems.append(f"slow: {spent:.1f} s")
    return outcome


def _where(lines: list[str]) -> str:
    inside = [line.strip() for line in lines if "precision_pin" in line and line.lstrip().startswith("File")]
    return inside[-1].split("precision_pin/")[-1] if inside else ""


def _read(path: Path, text: bytes, outcome: Outcome) -> ErrorModel | None:
    path.write_bytes(text)
    _compare_text(text, outcome)
    try:
        sheet = read(path)
    except InputError as error:
        outcome.codes += [finding.code for finding in error.findings]
        for finding in error.findings:
            if finding.file is None or (finding.line is None and finding.code not in WITHOUT_LINE):
                outcome.problems.append(f"no place: {finding.code}")
            if len(str(finding).splitlines()) != 1:
                outcome.problems.append(f"several lines: {finding.code}: {str(finding)!r:.200}")
        if not any(finding.severity == "error" for finding in error.findings):
            outcome.problems.append("refused without an error")
        return None
    outcome.accepted = True
    model = ErrorModel.from_sheet(sheet)
    _try_model(model, sheet, outcome)
    return model


def _try_model(model: ErrorModel, sheet: Sheet, outcome: Outcome) -> None:
    poses: list[Any] = [*sheet.poses]
    for q in poses[:POSES] or [np.zeros(len(sheet.chain.joints))]:
        try:
            at = model.at(q)
            e0, jacobian = at.tangent
            for what, numbers in (
                ("twists", at.table.twists), ("tangent", e0), ("Jacobian", jacobian), ("covariance", at.covariance),
                ("errors", at.exact(model.space.sample(0, 0, UNITS))),
            ):  # fmt: skip
                if not np.isfinite(numbers).all():
                    outcome.problems.append(f"not finite: {what}")
        except InputError as error:
            outcome.codes += [finding.code for finding in error.findings]
            if len(str(error).splitlines()) != 1:
                outcome.problems.append(f"several lines: {str(error)!r:.200}")


def _compare_text(text: bytes, outcome: Outcome) -> None:
    """Compare the plain data with that of another reader of YAML, where both take it."""
    try:
        decoded = text.decode("utf-8-sig")
        ours = read_text(decoded, "sheet.yaml")
        theirs = yaml.load(decoded, getattr(yaml, "CBaseLoader", yaml.BaseLoader))
    except (UnicodeDecodeError, InputError, yaml.YAMLError, ValueError, TypeError, RecursionError):
        return
    if not ours.findings and ours.data != theirs and not OTHERWISE & set(decoded):
        outcome.problems.append(f"read otherwise: {_difference(ours.data, theirs)}")


def _difference(one: Any, other: Any) -> str:
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return next(_difference(one[key], other[key]) for key in one if one[key] != other[key])
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return next(_difference(a, b) for a, b in zip(one, other, strict=True) if a != b)
    return f"{one!r:.80} for {other!r:.80}"


def _compare(one: ErrorModel | None, other: ErrorModel | None, names: dict[str, str], outcome: Outcome) -> None:
    """Compare what two sheets say that say the same."""
    if one is None or other is None:
        if one is not other:
            outcome.problems.append(f"one of two that say the same is refused: {outcome.codes[:3]}")
        return
    where = _columns(one, other, names)
    if where is None:
        outcome.problems.append("other random numbers")
        return
    if list(one.poses) != list(other.poses):
        outcome.problems.append("other poses")
        return
    if one.approaches != other.approaches:
        outcome.problems.append("other approaches")
    spread = np.sqrt(one.space.block_covariance.variances)
    _close("means", one.space.mean, other.space.mean[where], outcome, floor=CLOSE * spread.max(initial=0.0))
    _close("covariance", one.space.covariance, other.space.covariance[np.ix_(where, where)], outcome)
    for name in one.poses:
        _close(f"pose {name}", one.poses[name], other.poses[name], outcome)
        try:
            here, there = one.at(name), other.at(name)
            _close("error at the means", here.error_at_means, there.error_at_means, outcome, floor=ROUNDING)
            close = CLOSE_AT_REST if one.statics == "equilibrium" else CLOSE
            # derivatives times spreads, so that what is rounding of the arm's size is known as that
            _close(
                "Jacobian",
                here.jacobian * spread,
                there.jacobian[:, where] * spread,
                outcome,
                floor=ROUNDING,
                close=close,
            )
        except InputError:
            continue


def _columns(one: ErrorModel, other: ErrorModel, names: dict[str, str]) -> list[int] | None:
    """Return where the second model has the random numbers of the first."""
    found = []
    for name in one.space.components:
        owner, dot, rest = name.partition(".")
        renamed = f"{names[owner]}{dot}{rest}" if owner in names else name
        if renamed not in other.space.index:
            return None
        found.append(other.space.index[renamed])
    return found if len(found) == other.space.size else None


def _close(
    what: str,
    one: NDArray[np.float64],
    other: NDArray[np.float64],
    outcome: Outcome,
    floor: float = 0.0,
    close: float = CLOSE,
) -> None:
    largest = max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0))
    if np.abs(one - other).max(initial=0.0) > max(close * largest, floor):
        outcome.problems.append(f"another {what} by {np.abs(one - other).max() / largest:.1e}")
