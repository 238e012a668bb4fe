"""The sheet of a calibrated arm: the original with the name of the calibration's result."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final

from precision_pin.base.errors import InputError, SheetError
from precision_pin.base.input_files import UnreadableFileError, read_text_file
from precision_pin.sheet.text import read_text

_LARGEST: Final = 4 * 2**20
_ROBOT: Final = re.compile(r"^robot[ \t]*:.*\n?", re.MULTILINE)
_KEY: Final = re.compile(r"^calibrated[ \t]*:.*\n?", re.MULTILINE)


def result_name(sheet: str) -> str:
    """Return the name of the result beside a sheet: ``arm.calibration.json`` for ``arm.errors.yaml``."""
    return Path(sheet).name.removesuffix(".yaml").removesuffix(".yml").removesuffix(".errors") + ".calibration.json"


def calibrated_sheet(original: str, new: str) -> str:
    """Return the text of a sheet with the key ``calibrated``; in another folder the robot gets its whole path.

    Parameters
    ----------
    original
        The sheet that the model was read from.
    new
        Where the text will be written.

    Raises
    ------
    InputError
        The folder is another and the sheet names tables, or the key cannot be added.
    """
    folder = Path(original).resolve().parent
    try:
        text = read_text_file(original, _LARGEST)
        data = dict(read_text(text, original).data)
        if folder != Path(new).resolve().parent:
            if _names_tables(data):
                raise InputError(
                    f"the calibrated sheet must be in the folder of {original}, which names tables beside it"
                )
            if not data["robot"].startswith("example:"):
                data["robot"] = str(folder / data["robot"])
                text = _ROBOT.sub(lambda _: f"robot: {json.dumps(data['robot'])}\n", text)
        data["calibrated"] = result_name(new)
        text = _KEY.sub("", text).rstrip("\n") + f"\ncalibrated: {json.dumps(data['calibrated'])}\n"
        is_same = read_text(text, new).data == data
    except UnreadableFileError as error:
        raise InputError(f"{original} {error.reason}") from None
    except SheetError:
        is_same = False
    if not is_same:
        raise InputError(
            f"the key 'calibrated' cannot be added to {original}; write its keys each in a line of its own"
        )
    return text


def _names_tables(data: object) -> bool:
    if isinstance(data, dict):
        return "file" in data or any(map(_names_tables, data.values()))
    return isinstance(data, list) and any(map(_names_tables, data))
