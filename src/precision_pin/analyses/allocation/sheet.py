"""The sheet with the chosen tolerances."""

from __future__ import annotations

from pathlib import Path

from precision_pin.analyses.allocation.allocation_result import AllocationResult
from precision_pin.base.errors import InputError
from precision_pin.model.error_model import ErrorModel


def allocated_sheet(model: ErrorModel, result: AllocationResult, folder: Path) -> str:
    """Return the sheet of a model with the chosen tolerances, without its comments.

    Args:
        model, result: The model that was allocated, and the result.
        folder: Where the sheet will lie; the robot's file is named from there.

    Raises:
        InputError: The model was not read from a sheet.
    """
    changed = model.with_(result.changes).sheet
    if changed is None or changed.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary")
    return changed.contents.written(folder)
