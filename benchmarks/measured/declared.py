"""Declarations of sets of data: those of ``sets.toml``, and a user's own in ``FOLDER/NAME/set.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from precision_pin.base import units
from precision_pin.base.errors import InputError, nearest

FILE: Final = "set.toml"
"""A user's own declaration, beside the data."""
KNOWN: Final[dict[str, dict[str, Any]]] = tomllib.loads(Path(__file__).with_name("sets.toml").read_text("utf-8"))
"""The sets that others published, by name."""
_NOT_TAKEN_OVER: Final = ("folder", "published", "source", "licence", "remark")
"""Keys that say what is true of the published set alone, and which ``like`` does not give to a user's own."""


class MissingSet(Exception):
    """What a set lacks, or is wrong in its declaration; one line each."""


def _read(quantity: units.Quantity, count: int) -> BeforeValidator:
    """Return the validator of numbers with a unit, to SI."""

    def read(text: object) -> object:
        try:
            numbers = units.parse_vector(text, quantity, count=count)
        except InputError as error:
            raise ValueError(error.findings[0].message) from None
        return numbers if count > 1 else numbers[0]

    return BeforeValidator(read)


def _column(column: object) -> object:
    if isinstance(column, bool) or not (isinstance(column, str) or (isinstance(column, int) and column > 0)):
        raise ValueError(f"a column is a name, or its number from 1, not {column!r}")
    return column


def _file(name: str) -> str:
    if not name or Path(name).is_absolute():
        raise ValueError(f"a file is named from the folder of the set, wildcards allowed, not {name!r}")
    return name


def _listed(value: object) -> object:
    return value if isinstance(value, list) else [value]


Column = Annotated[Any, AfterValidator(_column)]
Place = tuple[Column, Column, Column]
Files = Annotated[list[Annotated[str, AfterValidator(_file)]], BeforeValidator(_listed)]
Unit = Literal["rad", "deg", "m", "mm"]
Row = tuple[float, float, float, float]


class Part(BaseModel):
    """A part of a declaration."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Csv(Part):
    """Form of the files; columns of files without a header are given by number, from 1."""

    separator: Literal[",", ";", "\t", " "] = ","
    decimal: Literal[".", ","] = "."
    comment: str = "#"
    header: bool = True

    @model_validator(mode="after")
    def _is_readable(self) -> Csv:
        if self.separator == self.decimal:
            raise ValueError("commas are either between columns or in numbers")
        return self


class Joints(Part):
    """Columns of joint values in the order of the chain: value of the arm = sign · (value of the file) + offset."""

    columns: list[Column] = Field(min_length=1)
    unit: Annotated[list[Unit], BeforeValidator(_listed)]
    sign: list[Literal[1, -1]] = []
    offset: list[float] = []

    @model_validator(mode="after")
    def _are_as_many(self) -> Joints:
        for name, allowed in (("unit", (1,)), ("sign", (0,)), ("offset", (0,))):
            count = len(getattr(self, name))
            if count not in (*allowed, len(self.columns)):
                raise ValueError(f"{count} values of {name} for {len(self.columns)} columns")
        return self


class Targets(Part):
    """Columns ``x y z`` of each target in the instrument's axes, plus or minus a difference."""

    columns: list[Place] = Field(min_length=1)
    unit: Literal["m", "mm"]
    plus: list[Place] = []
    minus: list[Place] = []

    @model_validator(mode="after")
    def _are_as_many(self) -> Targets:
        if self.plus and self.minus:
            raise ValueError("either plus or minus")
        if self.difference and len(self.difference) != len(self.columns):
            raise ValueError(f"{len(self.difference)} differences for {len(self.columns)} targets")
        return self

    @property
    def difference(self) -> list[Place]:
        """Columns of what is added or taken off."""
        return self.plus or self.minus


class Dh(Part):
    """An arm by Denavit and Hartenberg, of joints that turn.

    Attributes:
        table: ``a, alpha, d, theta`` of each joint.
        units: Of lengths and angles in it.
        modified: Whether a and alpha come before the joint, as Craig (1986) writes them, or after it.
        masses: Mass, kg, and centre of mass in the frame of each row, in the table's unit of lengths.
    """

    table: list[Row] = Field(min_length=1)
    units: tuple[Literal["m", "mm"], Literal["rad", "deg"]]
    modified: bool = False
    masses: list[Row] = []

    @model_validator(mode="after")
    def _are_as_many(self) -> Dh:
        if self.masses and len(self.masses) != len(self.table):
            raise ValueError(f"{len(self.masses)} masses for {len(self.table)} joints")
        return self


class Declaration(Part):
    """A set of data.

    Attributes:
        robot, instrument: In words; ``{targets}`` stands for the number of different targets.
        fit, judge: Files, wildcards allowed; without the second, groups of the first are left out.
        csv, joints, targets: How they are read.
        arm, dh: ``example:NAME``, or the first URDF that is there; or a table. One of the two.
        tip, base: Ends of the chain, where the URDF has several.
        guess: Where the first target is about, in tip axes, m.
        published: What the publishers had at the poses to judge, mean, m.
        folder: Of the data, if it is not called as the set.
        source, licence, remark: Where it is published, under which licence, and what else is to be said.
    """

    robot: str
    instrument: str
    fit: Files = Field(min_length=1)
    judge: Files = []
    csv: Csv = Csv()
    joints: Joints
    targets: Targets
    arm: Files = []
    dh: Dh | None = None
    tip: str | None = None
    base: str | None = None
    guess: Annotated[tuple[float, float, float], _read(units.LENGTH, 3)] = (0.0, 0.0, 0.0)
    published: Annotated[float, _read(units.LENGTH, 1)] | None = None
    folder: str = ""
    source: str = ""
    licence: str = ""
    remark: str = ""

    @model_validator(mode="after")
    def _is_complete(self) -> Declaration:
        if bool(self.arm) == (self.dh is not None):
            raise ValueError("either arm (example:NAME, or a URDF) or dh (a table) says which arm it is")
        columns = [
            *self.joints.columns,
            *(c for place in self.targets.columns + self.targets.difference for c in place),
        ]
        names = [column for column in columns if isinstance(column, str)]
        if names and not self.csv.header:
            raise ValueError(f"files without a header have columns by number, from 1, not {names[0]!r}")
        return self


_PARTS: Final[Mapping[str, type[Part]]] = {"csv": Csv, "joints": Joints, "targets": Targets, "dh": Dh}


def names(folder: Path) -> list[str]:
    """Return the names of the known sets, and of a user's own in a folder."""
    return [*KNOWN, *sorted({path.parent.name for path in folder.glob(f"*/{FILE}")} - KNOWN.keys())]


def declaration(name: str, folder: Path) -> tuple[Declaration, Path]:
    """Return the declaration of a set, a user's own before a known one, and the folder of its data."""
    path = folder / name / FILE
    own = path.is_file()
    table = _parsed(path) if own else KNOWN[name]
    try:
        declared = Declaration.model_validate(_whole(table, _NOT_TAKEN_OVER if own else ()))
    except ValidationError as error:
        raise MissingSet(*_mistakes(error)) from None
    return declared, path.parent if own else folder / (declared.folder or name)


def _whole(table: Mapping[str, Any], left: Collection[str] = ()) -> dict[str, Any]:
    """Return a table after what it takes over from the known set that it is ``like``, but the keys ``left``."""
    if "like" not in table:
        return dict(table)
    if table["like"] not in KNOWN:
        raise MissingSet(f"{FILE}: like: no known set {table['like']!r}; {nearest(str(table['like']), KNOWN)}")
    arms = {"arm", "dh"} if {"arm", "dh"} & table.keys() else set()
    taken = {key: value for key, value in _whole(KNOWN[table["like"]]).items() if key not in {*left, *arms}}
    return taken | {key: value for key, value in table.items() if key != "like"}


def _parsed(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise MissingSet(f"{FILE}: {error}") from None


def _mistakes(error: ValidationError) -> Iterator[str]:
    """Yield a line for each mistake in a declaration."""
    for entry in error.errors():
        where, last = [str(part) for part in entry["loc"]], str(entry["loc"][-1]) if entry["loc"] else ""
        key = ".".join(where)
        text = entry["msg"].removeprefix("Value error, ")
        if entry["type"] == "missing":
            yield f"{FILE}: the key {key} is missing"
        elif entry["type"] == "extra_forbidden":
            part = _PARTS.get(where[0], Declaration) if len(where) > 1 else Declaration
            yield f"{FILE}: unknown key {key}; {nearest(last, part.model_fields)}"
        else:
            got = "" if entry["type"] == "value_error" else f", got {entry['input']!r}"
            yield f"{FILE}: {f'{key}: ' if key else ''}{text[:1].lower()}{text[1:]}{got}"
