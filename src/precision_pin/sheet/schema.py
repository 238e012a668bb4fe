"""Schema of a sheet, derived from the source classes: a pydantic model per kind of source; findings at lines."""

from __future__ import annotations

import itertools
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, replace
from functools import cache
from pathlib import Path as FilePath
from typing import Annotated, Any, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    create_model,
)

from precision_pin import sheet_keys
from precision_pin.base.errors import Finding, InputError, SheetError, UnknownNameError, nearest
from precision_pin.base.units import PerEntry, PerJoint, Quantity, parse_vector
from precision_pin.draws.laws import Law, laws_of_sheets
from precision_pin.sheet.datums import DatumEntry
from precision_pin.sheet.drawing_tolerances import is_tolerance
from precision_pin.sheet.measurement import MeasurementEntry
from precision_pin.sheet.settings import (
    NAME,
    SIZE,
    SettingError,
    as_law,
    parse_number,
    parse_setting,
)
from precision_pin.sheet.text import Path, Text
from precision_pin.sources import catalogue
from precision_pin.terms.source import SettingField, Source, setting_fields, setting_meanings, takes_law

ASSUMED: Final = "assumed"
"""Key, allowed in every source, that marks its numbers as assumptions."""
PROVENANCE: Final = "provenance"
"""Key for the origin of numbers: in every source, and at the top level by path."""
_LAW: Final = {"title": "law"}
"""Schema that marks a law in the models; :func:`json_schema` replaces it by a reference."""
_FLAG: Final = [True, False, "true", "false"]
"""Values of a flag: other YAML readers convert it to a boolean, this one keeps text."""


_Measurements = Annotated[
    Annotated[MeasurementEntry, Tag("one")] | Annotated[list[MeasurementEntry], Tag("several")],
    # reports the error of the intended form, not of both
    Discriminator(lambda value: "several" if isinstance(value, list) else "one"),
]


class KeepOutEntry(BaseModel):
    """A half space or a box that no moving link may enter."""

    model_config = ConfigDict(extra="forbid")

    plane: str | None = Field(None, description="Normal of a plane, towards the allowed side, such as '0 0 1'.")
    box: str | None = Field(None, description="Edges of a box along the base axes, such as '800 600 40 mm'.")
    at: str = Field("0 0 0 mm", description="A point of the plane, or the centre of the box, in base axes.")


class SpecEntry(BaseModel):
    """A limit to judge, as ``--spec`` takes it, in parts."""

    model_config = ConfigDict(extra="forbid")

    limit: str = Field(description="The limit, such as '0.5 mm' or '1 mrad'.")
    quantity: str = Field("", description="What is limited, such as x, rx or RP (default: position or attitude).")
    probability: str = Field("", description="Share of the robots to be inside, such as '99 %' (default: 95 %).")
    name: str = Field("", description="Name in messages (default: the text of the limit).")
    poses: list[str] = Field(default_factory=list, description="The only poses at which it is judged (default: all).")

    @property
    def text(self) -> str:
        """The limit as ``--spec`` takes it."""
        return f"{self.quantity} {self.limit}{self.probability and f' @ {self.probability}'}".strip()


_Spec = Annotated[
    Annotated[SpecEntry, Tag("parts")] | Annotated[str, Tag("text")],
    Discriminator(lambda value: "text" if isinstance(value, str) else "parts"),
]


class Document(BaseModel):
    """The top level of a sheet."""

    model_config = ConfigDict(extra="forbid", title="precision-pin sheet")

    version: Literal["1"] = Field(alias="precision-pin", description="Version of the sheet's format.")
    robot: str = Field(description="The URDF, relative to the sheet, or example:NAME, or robot_descriptions:NAME.")
    tip: str | None = Field(None, description="The end-effector link (default: the only leaf).")
    base: str | None = Field(None, description="The fixed link (default: the root).")
    target: str | None = Field(
        None,
        description="Point of the results, in the tip's axes, such as '0 0 100 mm' (default: the tip).",
    )
    gravity: str = Field("earth", description="Base axes, such as '0 0 -9.81 m/s^2'; or earth, moon, none.")
    statics: Literal["nominal", "equilibrium"] = Field(
        "nominal",
        description="nominal: loads on the undeflected arm, as in the paper; equilibrium: on the arm at rest under its loads.",
    )
    locked: dict[str, str] = Field(default_factory=dict, description="Values of joints that are locked.")
    limits: dict[str, str] = Field(
        default_factory=dict,
        description="Lowest and highest value of joints, such as '-90 90 deg', within those of the URDF.",
    )
    keep_out: list[KeepOutEntry] | Literal["none"] | None = Field(
        None,
        description="Keep-out zones in base axes, planes and boxes; none: no zone (default: the half space below the plate on "
        "which the base stands).",
    )
    poses: dict[str, str | list[str] | dict[str, str | list[str] | dict[str, str]]] = Field(
        default_factory=dict,
        description="Named joint values: in chain order with one unit, as a list, or by joint; or these as q: with approach:.",
    )
    parameters: dict[str, Any] = Field(default_factory=dict, description="Named laws, to be shared by sources.")
    correlations: list[Any] = Field(
        default_factory=list, description="Correlations of parameters, given for their normal scores."
    )
    sources: list[Any] = Field(default_factory=list, description="Error sources, each under its kind.")
    specs: list[_Spec] = Field(
        default_factory=list,
        description="Limits to judge where --spec is not given: as --spec takes them, or their parts by key.",
    )
    calibrated: str | None = Field(
        None,
        description="JSON of calibrate, relative to the sheet, whose estimates replace tolerances; or none.",
    )
    measurement: _Measurements | None = Field(
        None, description="Instrument and set-up of calibrate, or a list of several; options override it."
    )
    datums: dict[str, DatumEntry] = Field(
        default_factory=dict,
        description="Frames and tools that the robot finds, by name: each one procedure with its settings.",
    )
    datum: str | list[str] | None = Field(
        None,
        description="What errors are counted against: datums in the order in which they are found (default: the base).",
    )
    provenance: dict[str, Any] = Field(
        default_factory=dict,
        description="Origin of values, by path: assumed, data sheet, measured, drawing, or {word: text}.",
    )
    accept: dict[str, str] = Field(
        default_factory=dict,
        description="Warnings of URDF, sheet and statics that are accepted, by code, with the reason; results list them.",
    )


@cache
def document_model() -> type[Document]:
    """Return the pydantic model of a sheet, with the keys that analyses declare."""
    keys: dict[str, Any] = {
        key: (dict[str, Any] | None, Field(None, description=text)) for key, text in sheet_keys().items()
    }
    return create_model("Document", __base__=Document, **keys)


@cache
def source_model(kind: type) -> type[BaseModel]:
    """Return the pydantic model of the settings of a source, or of a part of a setting."""
    meanings = setting_meanings(kind)
    entries: dict[str, Any] = {
        entry.name: (
            _field_type(entry),
            Field(
                ... if entry.default is MISSING else entry.default,
                alias=None if entry.key == entry.name else entry.key,
                description=meanings.get(entry.name),
            ),
        )
        for entry in setting_fields(kind)
    }
    config = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
    return create_model(kind.__name__, __config__=config, __doc__=(kind.__doc__ or "").split("\n")[0], **entries)


def json_schema(kinds: Mapping[str, type[Source]] | None = None) -> dict[str, Any]:
    """Return the JSON schema of a sheet."""
    schema = document_model().model_json_schema(by_alias=True)
    definitions: dict[str, Any] = schema.pop("$defs", {}) | {"law": _law_schema()}
    definitions["MeasurementEntry"]["properties"]["target_known"] |= {"type": ["boolean", "string"], "enum": _FLAG}
    choices = []
    for name, kind in (kinds or catalogue()).items():
        definition = _with_references(source_model(kind).model_json_schema())
        definitions |= definition.pop("$defs", {})
        definition["properties"][ASSUMED] = {"type": ["boolean", "string"], "enum": _FLAG}
        definition["properties"][PROVENANCE] = {"type": ["string", "object"]}
        definitions[name] = definition
        entry = {name: {"$ref": f"#/$defs/{name}"}}
        choices.append({"type": "object", "properties": entry, "required": [name], "maxProperties": 1})
    # other YAML readers read the version as a number
    schema["properties"]["precision-pin"] |= {"const": 1, "type": "integer"}
    schema["properties"]["sources"]["items"] = {"oneOf": choices}
    tolerance = {"type": "string", "pattern": r"±|\+|/ ?-|^-|ISO 2768|\b[A-Za-z]{1,2}\d"}
    schema["properties"]["parameters"]["additionalProperties"] = {"anyOf": [{"$ref": "#/$defs/law"}, tolerance]}
    schema["properties"]["correlations"]["items"] = _correlation_schema()
    schema["$defs"] = definitions
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    return schema


def _field_type(entry: SettingField) -> Any:
    """Return the pydantic type of a setting: quantities and laws are read from text, other types are unchanged."""
    part, hint = entry.part, entry.hint
    if part is not None:
        made: Any = Annotated[source_model(part), AfterValidator(_make(part))]
        return tuple[made, ...] if entry.is_list else made
    if FilePath in (hint, *typing.get_args(hint)):
        schema = {"type": "string", "description": "a file, relative to the sheet"}
        return Annotated[Any, BeforeValidator(_read_file), WithJsonSchema(schema)]
    if typing.get_origin(hint) is not Annotated:
        return hint
    bare, *notes = typing.get_args(hint)
    quantities = tuple(note for note in notes if isinstance(note, Quantity | PerJoint | PerEntry))
    if not quantities:
        return hint
    options = typing.get_args(bare) if typing.get_origin(bare) in (types.UnionType, typing.Union) else (bare,)
    list_type = next((option for option in options if typing.get_origin(option) is tuple), None)
    if list_type is not None and not takes_law(list_type):
        levels = 2 if typing.get_origin(typing.get_args(list_type)[0]) is tuple else 1
        read = _reader(lambda value, info: _numbers(value, quantities, levels, info))
        return Annotated[Any, read, WithJsonSchema(_numbers_schema(quantities, levels))]
    if list_type is not None:
        read = _reader(lambda value, info: _settings(value, quantities, info))
        item = _setting_schema(quantities)
        return Annotated[tuple[Any, ...], read, WithJsonSchema({"anyOf": [item, {"type": "array", "items": item}]})]
    if Law in options:
        read = _reader(lambda value, info: _setting(value, quantities, info))
        return Annotated[Any, read, WithJsonSchema(_setting_schema(quantities))]
    read = _reader(lambda value, info: parse_number(value, _quantities(quantities, info)))
    return Annotated[Any, read, WithJsonSchema(_quantity_schema(quantities))]


def _make(part: type) -> Any:
    def make(valid: BaseModel) -> object:
        try:
            return part(**{name: getattr(valid, name) for name in type(valid).model_fields})
        except InputError as error:
            raise SettingReason(error) from None

    return make


Notes = tuple[Quantity | PerJoint | PerEntry, ...]


@cache
def used_quantities(kinds: tuple[type, ...]) -> tuple[Quantity, ...]:
    """Return the quantities of all random settings of the kinds, the possible quantities of named parameters."""
    quantities: dict[Quantity, None] = {}
    for kind in kinds:
        for entry in setting_fields(kind):
            if entry.part is not None:
                quantities |= dict.fromkeys(used_quantities((entry.part,)))
            for note in entry.notes if entry.may_be_random else ():
                quantities |= dict.fromkeys(_either(note))
    return tuple(quantities)


@dataclass(frozen=True)
class StatedNumber:
    """Number in a setting: its possible units, and whether it is random."""

    units: frozenset[str]
    is_random: bool


def stated_numbers(kind: type, settings: Mapping[str, Any]) -> dict[str, StatedNumber]:
    """Return the numbers and laws in the settings of a source, by path; list entries separately."""
    numbers: dict[str, StatedNumber] = {}
    for entry in setting_fields(kind):
        setting = settings.get(entry.key)
        items = enumerate(setting) if isinstance(setting, list) else ()
        values = {f"{entry.key}[{k}]": item for k, item in items} or {entry.key: setting}
        quantities = [quantity for note in entry.notes for quantity in _either(note)]
        for path, value in values.items():
            if entry.part is not None and isinstance(value, dict):
                numbers |= {f"{path}.{below}": item for below, item in stated_numbers(entry.part, value).items()}
            elif quantities and value not in (None, []):
                is_law = as_law(value) is not None
                is_name = isinstance(value, str) and NAME.fullmatch(value.strip()) is not None
                units = frozenset(unit for quantity in quantities for unit in quantity.units)
                numbers[path] = StatedNumber(units, entry.may_be_random and (is_law or is_name))
    return numbers


def _either(note: object) -> tuple[Quantity, ...]:
    if isinstance(note, PerJoint):
        return (note.revolute, note.prismatic)
    if isinstance(note, PerEntry):
        return tuple(dict.fromkeys(note.quantities))
    return (note,) if isinstance(note, Quantity) else ()


def _quantities(notes: Notes, info: ValidationInfo[Any]) -> tuple[Quantity, ...]:
    """Return the quantities that a setting can have at the source's joint."""
    result: list[Quantity] = []
    for note in notes:
        if not isinstance(note, PerJoint):
            result += _either(note)
        else:
            is_prismatic = info.context.prismatic.get(info.data.get("joint", ""))
            result += [note.revolute] if is_prismatic is not True else []
            result += [note.prismatic] if is_prismatic is not False else []
    return tuple(result)


def _reader(read: Callable[[Any, ValidationInfo[Any]], object]) -> BeforeValidator:
    """Return the validator of a function, with its input errors carried through pydantic."""

    def reading(value: object, info: ValidationInfo[Any]) -> object:
        try:
            return read(value, info)
        except InputError as error:
            raise SettingReason(error) from None

    return BeforeValidator(reading)


def _read_file(value: object, info: ValidationInfo[Any]) -> FilePath:
    if not isinstance(value, str) or not value:
        raise ValueError("expected the name of a file")
    return info.context.folder / value


def _setting(value: object, notes: Notes, info: ValidationInfo[Any], below: Path = ()) -> object:
    try:
        return parse_setting(value, _quantities(notes, info), info.context)
    except InputError as error:
        raise SettingReason(error, below) from None


def _settings(value: object, notes: Notes, info: ValidationInfo[Any]) -> tuple[object, ...]:
    if isinstance(value, list):
        return tuple(_setting(entry, notes, info, (k,)) for k, entry in enumerate(value))
    if isinstance(value, str) and len(value.split()) > 2 and not is_tolerance(value):
        return tuple(parse_vector(value, *_quantities(notes, info)))
    return (_setting(value, notes, info),)


def _numbers(
    value: object, notes: Notes, levels: int, info: ValidationInfo[Any], below: Path = ()
) -> tuple[object, ...]:
    """Return a list of plain quantities, or rows of them (``levels`` 2)."""
    per_entry = next((note.quantities for note in notes if isinstance(note, PerEntry)), None)
    try:
        if not isinstance(value, list):
            if levels > 1 or per_entry is not None:
                raise InputError("expected rows of numbers" if levels > 1 else "expected a list of numbers")
            return tuple(parse_vector(value, *_quantities(notes, info)))
        if per_entry is not None and len(value) != len(per_entry):
            raise InputError(f"{len(value)} numbers, expected {len(per_entry)}")
    except InputError as error:
        raise SettingReason(error, below) from None
    if levels > 1:
        return tuple(_numbers(row, notes, levels - 1, info, (*below, k)) for k, row in enumerate(value))
    result = []
    for k, entry in enumerate(value):
        try:
            result.append(parse_number(entry, (per_entry[k],) if per_entry else _quantities(notes, info)))
        except InputError as error:
            raise SettingReason(error, (*below, k)) from None
    return tuple(result)


class SettingReason(ValueError):
    """Carries an error through pydantic; ``below`` is the path from the setting to the error."""

    def __init__(self, error: InputError, below: Path = ()) -> None:
        super().__init__("; ".join(finding.message for finding in error.findings))
        self.below = (*below, *(error.below if isinstance(error, SettingError) else ()))


def _units(notes: Notes) -> str:
    names = [unit or "nothing" for note in notes for quantity in _either(note) for unit in quantity.units]
    return ", ".join(dict.fromkeys(names))


def _quantity_schema(notes: Notes) -> dict[str, Any]:
    bare = any("" in quantity.units for note in notes for quantity in _either(note))
    kind = ["string", "number"] if bare else "string"
    return {"type": kind, "description": f"a number and one of: {_units(notes)}"}


def _setting_schema(notes: Notes) -> dict[str, Any]:
    text = {
        "type": "string",
        "description": f"a number and one of: {_units(notes)}; ± before it or +0.5/-0.1: a tolerance; or a parameter's name",
    }
    return {"anyOf": [text, _LAW]}


def _with_references(schema: Any) -> Any:
    """Return a schema with laws replaced by references, which pydantic cannot write."""
    if isinstance(schema, dict):
        return {"$ref": "#/$defs/law"} if schema == _LAW else {key: _with_references(schema[key]) for key in schema}
    return [_with_references(entry) for entry in schema] if isinstance(schema, list) else schema


def _numbers_schema(notes: Notes, levels: int) -> dict[str, Any]:
    lists: dict[str, Any] = {"type": "array", "items": _quantity_schema(notes)}
    if levels > 1:
        return {"type": "array", "items": lists}
    per_entry = any(isinstance(note, PerEntry) for note in notes)
    return lists if per_entry else {"anyOf": [_quantity_schema(notes), lists]}


def _law_schema() -> dict[str, Any]:
    forms = [law.form for law in laws_of_sheets().values()]
    meanings: dict[str, dict[str, None]] = {}
    for option in (SIZE, *(option for form in forms for option in form.options)):
        meanings.setdefault(option.key, {})[option.meaning] = None
    properties: dict[str, Any] = {form.key: dict(form.schema) for form in forms}
    properties |= {key: {"description": "; ".join(meaning)} for key, meaning in meanings.items()}
    properties["scope"] = {"enum": ["unit", "pose", "visit"], "description": "default unit: once for each built robot"}
    return {
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "oneOf": [{"required": [form.key]} for form in forms],
    }


def _correlation_schema() -> dict[str, Any]:
    number = {"type": ["string", "number"]}
    return {
        "type": "object",
        "properties": {
            "parameters": {"type": "array", "items": {"type": "string"}, "minItems": 2},
            "correlation": number | {"description": "of two parameters: the correlation of their normal scores"},
            "matrix": {"type": "array", "items": {"type": "array", "items": number}},
        },
        "required": ["parameters"],
        "additionalProperties": False,
        "oneOf": [{"required": ["correlation"]}, {"required": ["matrix"]}],
    }


_KEYS: Final = 3
"""Keys that a message lists of what has keys."""
# texts of pydantic's types of errors in the words of a sheet
_SHAPES: Final = {
    "dict_type": "expected keys with values, {key: value}",
    "list_type": "expected a list, one entry after each '-'",
    "tuple_type": "expected a list, one entry after each '-'",
    **dict.fromkeys(("bool_parsing", "bool_type"), "expected true or false"),
    **dict.fromkeys(("int_parsing", "int_type"), "expected a whole number"),
    "string_type": "expected one value, a text without brackets, as in: 5 mm, or 0 0 5 mm for a point",
}
_HINTS: Final = {
    **dict.fromkeys(("rectangle", "rectangular", "square"), "; a rectangular tube is a box, a solid bar is general"),
    **dict.fromkeys(("round", "circle", "circular", "cylinder", "solid", "bar"), "; a solid round bar is a rod"),
    **dict.fromkeys(("pipe", "hollow"), "; a round pipe is a tube"),
}
"""Hints for synonyms of allowed words."""
MOST_ERRORS: Final = 100
"""Maximum number of errors listed for a sheet; reading stops beyond, since more have a common cause."""

# one text for pydantic's five errors about the value of a pose
POSE_VALUES: Final = "expected joint values in chain order with one unit, a list of values, or joint names with values"


class Findings:
    """Collector of findings at the lines of a text."""

    def __init__(self, text: Text, file: str) -> None:
        self.text = text
        self.file = file
        self.found: list[Finding] = list(text.findings)
        self._errors = 0

    def error(self, path: Path, message: str, code: str = "E_SHEET") -> None:
        """Add an error at a path."""
        self._add([Finding("error", code, message, *self._where(path))])

    def warning(self, path: Path, message: str, code: str) -> None:
        """Add a warning at a path."""
        self.found.append(Finding("warning", code, message, *self._where(path)))

    def take(self, path: Path, error: InputError) -> None:
        """Add an error raised for a path, at the line of the key or name at fault."""
        if isinstance(error, SettingError):
            path = (*path, *error.below)
        if isinstance(error, UnknownNameError):
            nested = list(_within(self._value(path), path))
            by_value = (where for where, value in nested if where and value == error.name)
            by_key = (where for where, _ in nested if where and where[-1] == error.name)
            path = next(itertools.chain(by_value, by_key), path)
        self._add([finding.at(*self._where(path)) for finding in error.findings])

    @contextmanager
    def taking(self, *path: str | int) -> Iterator[None]:
        """Convert an input error, which ends the body, to a finding."""
        try:
            yield
        except InputError as error:
            self.take(path, error)

    def take_validation(self, error: ValidationError, path: Path, model: type[BaseModel]) -> None:
        """Add pydantic's errors about the value at a path."""
        reported: set[Path] = set()
        errors = error.errors()
        places = [self.walk(path, entry["loc"]) for entry in errors]
        for entry, where in zip(errors, places, strict=True):
            # pydantic also reports the word allowed instead of a list; omit it if an entry is invalid
            if entry["type"] == "literal_error" and any(p[: len(where)] == where != p for p in places):
                continue
            is_pose = path == () and entry["loc"][0] == "poses" and len(entry["loc"]) > 1
            where = where[:2] if is_pose else where
            key = ".".join(map(str, where[len(path) :])) or str(entry["loc"][-1])
            if entry["type"] == "missing":
                missing = str(entry["loc"][-1])
                meaning = _meaning(model, entry["loc"])
                self.error(where, f"the key {missing!r} is missing{f': {meaning}' if meaning else ''}", "E_MISSING_KEY")
            elif where in reported:
                continue
            elif entry["type"] == "extra_forbidden":
                valid = _keys(model, entry["loc"][:-1])
                self.error(where, f"unknown key {where[-1]!r}: {nearest(str(where[-1]), valid)}", "E_UNKNOWN_KEY")
            else:
                text = entry["msg"].removeprefix("Value error, ")
                message = POSE_VALUES if is_pose else _SHAPES.get(entry["type"], text)
                if entry["type"] == "model_type":
                    keys = [f"{name}: …" for name in _keys(model, entry["loc"])]
                    keys = keys if len(keys) <= _KEYS else [*keys[:_KEYS], "…"]
                    message = f"expected keys with values, {{{', '.join(keys)}}}"
                reason = entry.get("ctx", {}).get("error")
                below = reason.below if isinstance(reason, SettingReason) else ()
                hint = _HINTS.get(str(entry["input"]).strip().lower(), "") if entry["type"] == "literal_error" else ""
                self.error((*where, *below), f"{key}: {message[:1].lower()}{message[1:]}{hint}")
            reported.add(where)

    def walk(self, path: Path, location: Path) -> Path:
        """Return a location of pydantic as a path, without the type names between the keys."""
        value = self._value(path)
        for key in location:
            valid_keys = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
            if key in valid_keys:
                path, value = (*path, key), value[key]
        return path

    def refuse(self) -> None:
        """Raise the findings if they include an error."""
        if not any(finding.severity == "error" for finding in self.found):
            return
        ordered = sorted(dict.fromkeys(self.found), key=lambda finding: (finding.file or "", finding.line or 0))
        errors = [finding for finding in ordered if finding.severity == "error"]
        if len(errors) > MOST_ERRORS:
            last = errors[MOST_ERRORS - 1]
            ordered = ordered[: ordered.index(last) + 1]
            message = f"more than {MOST_ERRORS} errors; these are the first"
            ordered.append(replace(last, code="E_SHEET", message=message))
        raise SheetError(ordered)

    def _where(self, path: Path) -> tuple[str, int | None]:
        """Return the file and line of a path; or the change that set it; or, without lines, the path as text."""
        change = self.text.change(path)
        if change is not None:
            return change, None
        line = self.text.line(path)
        return (self.file, line) if line is not None or not path else (".".join(map(str, path)), None)

    def _add(self, findings: Sequence[Finding]) -> None:
        self.found += findings
        self._errors += sum(finding.severity == "error" for finding in findings)
        if self._errors > MOST_ERRORS:
            self.refuse()

    def _value(self, path: Path) -> Any:
        value = self.text.data
        for key in path:
            value = value[key]
        return value


def _within(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    yield path, value
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from _within(entry, (*path, key))


def _meaning(model: type[BaseModel], location: Path) -> str:
    """Return the description of a key at pydantic's location, or empty."""
    model = _model_at(model, location[:-1])
    fields = [field for name, field in model.model_fields.items() if location[-1] in (name, field.alias)]
    return (fields[0].description or "").removesuffix(".") if fields else ""


def _keys(model: type[BaseModel], location: Path) -> list[str]:
    """Return the keys allowed at pydantic's location below a model."""
    return [field.alias or name for name, field in _model_at(model, location).model_fields.items()]


def _model_at(model: type[BaseModel], location: Path) -> type[BaseModel]:
    for key in location:
        for name, field in model.model_fields.items():
            if key in (name, field.alias):
                model = _inner(field.annotation) or model
                break
    return model


def _inner(hint: object) -> type[BaseModel] | None:
    """Return the model inside a type, such as that of list items."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return hint
    return next(filter(None, map(_inner, typing.get_args(hint))), None)
