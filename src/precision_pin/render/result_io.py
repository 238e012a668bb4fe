"""Results as JSON: to text, to a file, and back."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

from precision_pin.base.arguments import check_path, shown
from precision_pin.base.errors import InputError
from precision_pin.base.files import UnreadableFileError, read_text_file, write_text
from precision_pin.render.html import Table, rendered
from precision_pin.render.tables import data_frame, dataset, pose_labels

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray

LARGEST_FILE: Final = 2**30
"""Bytes; a result of 10,000 poses has about 10^8."""


class JsonResult:
    """A result with a JSON form; ``schema`` is its name, or the common prefix of several."""

    schema: ClassVar[str] = "precision-pin/"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as its schema has it, SI units."""
        raise NotImplementedError

    def to_json(self) -> str:
        """Return :meth:`to_dict` as text; numbers that are not resolved or do not exist are null."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the JSON to a file, whole or not at all."""
        write_text(check_path("the path of the result", path), f"{self.to_json()}\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SavedResult:
        """Read a file written by :meth:`save` or by ``--json`` of a command.

        The file lacks the samples and laws, so the object returned is not an instance of this class, but has the same
        ``to_dict`` and ``to_json``.
        """
        name = check_path("the path of the result", path)
        try:
            text = read_text_file(name, LARGEST_FILE)
        except UnreadableFileError as error:
            raise InputError(f"cannot read {name}: it {error.reason}") from None
        try:
            # JSON knows no NaN and no Infinity, and neither does int
            data = json.loads(text, parse_constant=int)
        except (ValueError, RecursionError):
            raise InputError(f"{name} is no JSON, so no result was saved there") from None
        schema = data.get("schema") if isinstance(data, dict) else None
        if not isinstance(schema, str) or not schema.startswith(cls.schema):
            wanted = f"{cls.schema}…" if cls.schema.endswith("/") else cls.schema
            held = f"of the schema {shown(schema)}" if isinstance(schema, str) else "without a schema"
            raise InputError(f"{name} is {held}; a file of {wanted} is expected")
        return SavedResult(data)


@dataclass(frozen=True, eq=False, repr=False)
class SavedResult(JsonResult):
    """A result read from its JSON: ``saved["poses"]`` and so on, SI units."""

    data: Mapping[str, Any]

    def __getitem__(self, key: str) -> Any:
        return copy.deepcopy(self.data[key])

    def to_dict(self) -> dict[str, Any]:
        """Return what was saved."""
        return copy.deepcopy(dict(self.data))

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line each."""
        return tuple(self.data.get("warnings", ()))

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row of all numbers for each pose, columns named by their keys, with the other keys as ``attrs``."""
        poses = self.data["poses"] if isinstance(self.data.get("poses"), list) else [self.data]
        labels = pose_labels([str(_pose_name(pose)) for pose in poses])
        rows = [
            ((label, keys), {"value": value})
            for label, pose in zip(labels, poses, strict=True)
            for keys, value in _numbers(pose)
        ]
        attributes = {key: value for key, value in self.to_dict().items() if key != "poses"}
        return data_frame(["pose", "entry"], rows, attributes)

    def to_xarray(self) -> xarray.Dataset:
        """Return the numbers of :meth:`to_pandas` as a dataset over pose and entry."""
        return dataset(self.to_pandas())

    def __repr__(self) -> str:
        return f"<SavedResult {self.data.get('schema')}: {self.data.get('robot')!r}, seed {self.data.get('seed')}>"

    def _repr_html_(self) -> str:
        """Return the notebook view: the kind of result and its warnings."""
        rows = [
            [key, str(value)]
            for key, value in self.data.items()
            if isinstance(value, str | int | float) or value is None
        ]
        table = Table(("", ""), rows, words=2)
        return rendered(f"Saved result, {self.data.get('schema')}", [table], list(map(str, self.warnings)))


def _pose_name(entry: Any) -> Any:
    pose = entry.get("pose") if isinstance(entry, dict) else None
    return pose.get("name", "") if isinstance(pose, dict) else ""


def _numbers(value: Any, keys: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number in JSON with its keys, joined by dots; NaN for null."""
    if isinstance(value, dict | list):
        entries = value.items() if isinstance(value, dict) else enumerate(value)
        for key, entry in entries:
            yield from _numbers(entry, f"{keys}.{key}" if keys else str(key))
    elif value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        yield keys, math.nan if value is None else float(value)
