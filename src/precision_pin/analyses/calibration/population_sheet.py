"""The sheet with the tolerances that several robots show."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

from precision_pin.analyses.calibration.population import MeasuredTolerance, Population
from precision_pin.base import units
from precision_pin.base.errors import InputError, UnitError
from precision_pin.base.text_escape import visible
from precision_pin.sheet.settings import TOLERANCE_PATTERN

_WIDTHS: Final = ("uniform", "normal", "triangular", "arcsine", "disc", "circle", "two_point")
"""Laws whose key is a width that their standard deviation is in proportion to."""
_DIGITS: Final = 6


def population_sheet(result: Population, folder: Path) -> str:
    """Return the sheet of the model with the measured tolerances, each with its interval in a comment at the top.

    A law keeps its kind: its width is multiplied by the measured scale. Laws without a width, and those whose scale has no upper
    limit, stay as they are; a comment says so.

    Parameters
    ----------
    result
        The tolerances.
    folder
        Where the sheet will lie; the robot's file is named from there.

    Raises
    ------
    InputError
        The model was not read from a sheet.
    """
    sheet = result.model.sheet
    if sheet is None or sheet.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary")
    changes: dict[str, Any] = {}
    notes = [
        f"measured: {result.robots} robots; tolerances by maximum likelihood, means "
        f"{'estimated too' if result.means == 'estimated' else 'those of the sheet'}",
        f"tolerance: measured over former width, {100 * result.confidence:g} % interval",
    ]
    parameters = {draw.name for draw in sheet.space.draws}
    for one in result.tolerances:
        for name in one.names:
            path = f"parameters.{name}" if name in parameters else name
            found = _scaled(list(sheet.contents.values_at(sheet, path).values()), one) if _has_limit(one) else None
            if found is not None:
                changes[path] = found
            kept = "" if found is not None else "; kept as it was"
            notes.append(f"{visible(name)}: × {one.scale:.3g}, {one.low:.3g} to {one.high:.3g}{kept}")
    notes += [f"{visible(name)}: not shown by any reading; kept as it was" for name in result.unseen]
    changed = result.model.with_(changes).sheet if changes else sheet
    assert changed is not None
    assert changed.contents is not None
    data = dict(changed.contents.text.data)
    if changes:
        measured = {path: {"measured": f"{result.robots} robots"} for path in changes}
        data["provenance"] = {**data.get("provenance", {}), **measured}
    file = changed.contents.folder / data["robot"]
    if file.is_file():
        data["robot"] = os.path.relpath(file, folder)
    writer = YAML()
    writer.width = 120
    text = io.StringIO()
    writer.dump(data, text)
    return "".join(f"# {note}\n" for note in notes) + text.getvalue()


def _has_limit(one: MeasuredTolerance) -> bool:
    return one.scale > 0 and one.high < float("inf")


def _scaled(values: list[Any], one: MeasuredTolerance) -> object:
    """Return a law with its width multiplied, as a sheet has it; ``None`` where it has no width."""
    if len(values) != 1:
        return None
    value = values[0]
    if isinstance(value, str):
        parts = re.split(f"({TOLERANCE_PATTERN})", value, maxsplit=1)
        width = _times(parts[2], one.scale) if len(parts) == 3 else None
        return None if width is None else f"{parts[0].strip()} ± {width}".strip()
    if not isinstance(value, Mapping):
        return None
    key = next((key for key in _WIDTHS if key in value), None)
    if key is None:
        return None
    given = value[key]
    is_std = isinstance(given, Mapping) and set(given) == {"std"}
    width = _times(given["std"] if is_std else given, one.scale)
    return None if width is None else {**value, key: {"std": width} if is_std else width}


def _times(text: object, factor: float) -> str | None:
    try:
        numbers, unit = units.split(text)
    except UnitError:
        return None
    return f"{numbers[0] * factor:.{_DIGITS}g} {unit}" if len(numbers) == 1 else None
