"""Reader of the key ``calibrated:``: the result of a calibration, whose estimates take the place of tolerances."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from precision_pin.base.errors import InputError
from precision_pin.base.input_files import UnreadableFileError, note_input, read_text_file
from precision_pin.draws.estimates import Estimates

_SCHEMA: Final = "precision-pin/calibration/1"
_LARGEST: Final = 64 * 2**20


def read_estimates(file: str, folder: Path) -> Estimates:
    """Return the estimates in the JSON that ``calibrate`` writes.

    Parameters
    ----------
    file
        Its name.
    folder
        Folder that it is relative to.

    Raises
    ------
    InputError
        The file cannot be read, or is no result of a calibration.
    """
    path = folder / file
    try:
        data = json.loads(read_text_file(path, _LARGEST))
    except UnreadableFileError as error:
        raise InputError(f"calibrated: {file} {error.reason}") from None
    except (ValueError, RecursionError):
        raise InputError(f"calibrated: {file} is not JSON; calibrate --json writes it") from None
    note_input(path)
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != _SCHEMA:
        raise InputError(f"calibrated: {file} is no result of calibrate ({_SCHEMA}); calibrate --json writes it")
    found = _estimates(data)
    if found is None:
        raise InputError(f"calibrated: the estimates in {file} are not complete; let calibrate write it again")
    return found


def _estimates(data: dict[str, Any]) -> Estimates | None:
    """Return the estimates of a result; ``None`` where something is missing or no number."""
    try:
        names = tuple(map(str, data["posterior"]["names"]))
        mean = np.array([data["posterior"]["mean"][name] for name in names], dtype=float)
        covariance = np.array(data["posterior"]["covariance"], dtype=float)
    except (KeyError, TypeError, ValueError):
        return None
    size = len(names)
    is_whole = covariance.shape == (size, size) and len(set(names)) == size > 0
    return (
        Estimates(names, mean, covariance)
        if is_whole and np.isfinite(covariance).all() and np.isfinite(mean).all()
        else None
    )
