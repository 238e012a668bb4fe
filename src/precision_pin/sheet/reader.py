"""Reader of a sheet: text, structure, robot and sources; all findings are reported together. Differences of two sheets."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Final, Literal

import numpy as np
from pydantic import ValidationError

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, SheetError, UnknownNameError, nearest, some
from precision_pin.base.files import UnreadableFileError, note_input, read_text_file
from precision_pin.base.written_units import WrittenUnit
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Fixed
from precision_pin.draws.space import Estimates, Extension, LabelledSpace, Space
from precision_pin.robot.chain import Chain, chain_findings
from precision_pin.robot.configurations import Approach
from precision_pin.robot.datums import Datum, check_together
from precision_pin.robot.urdf import Robot
from precision_pin.sheet.chain_entry import Overrides, is_same_arm, parse_pose, parse_poses, read_chain
from precision_pin.sheet.changes import Change, change_text, matches, plain_data, values_at
from precision_pin.sheet.datums import chosen_datums, read_datum
from precision_pin.sheet.measurement import Measurement, only_one, read_measurement
from precision_pin.sheet.pose_grid import read_visits
from precision_pin.sheet.schema import (
    ASSUMED,
    PROVENANCE,
    Document,
    Findings,
    SpecEntry,
    document_model,
    source_model,
    used_quantities,
)
from precision_pin.sheet.settings import NAME, Context, NamedParameter, SettingError, parse_parameter, placed
from precision_pin.sheet.sheet_lint import remark_on_gravity, remark_on_poses, remark_on_sources
from precision_pin.sheet.text import Path, Text, edited_yaml, read_text, written_yaml
from precision_pin.sources import catalogue
from precision_pin.terms.bound_source import BoundSource, labels, load_posture, own_draws
from precision_pin.terms.source import Source, setting_fields

LARGEST_FILE: Final = 4 * 2**20
"""Bytes of a sheet: five times the size of one with the maximum number of entries and short values."""
_MOST_NAMED: Final = 4
"""Parameters that a message about a calibration lists; with values, more would exceed some terminal lines."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet read without error.

    Attributes:
        space: The named draws.
        poses: Named configurations; the first is the default.
        approaches: Direction of the last motion of each joint, for poses with an approach.
        statics: ``"nominal"``: loads at the undeflected pose; ``"equilibrium"``: on the arm at rest under the loads.
        assumed: Positions of the sources marked as assumptions.
        estimates: Result of a calibration, which replaces tolerances.
        measurements: Instruments and set-ups of a calibration.
        datums: Datums by name.
        datum: Names of those against which errors are counted, in the order in which they are found.
        origins: Origin of values, by source label, ``label.setting`` or ``parameters.name``.
        unchanged: The sheet before any :meth:`with_changes`; ``None`` for a sheet without changes.
        beyond_limits: Whether verdicts are also given beyond the URDF's limits of joint values and speeds.
        accepted: Reasons for accepting warnings, by code.
        specs: The limits to judge; their texts are checked where they are used.
    """

    file: str
    chain: Chain
    space: Space
    sources: tuple[Source, ...]
    poses: Mapping[str, Array]
    statics: Literal["nominal", "equilibrium"]
    findings: tuple[Finding, ...]
    assumed: tuple[int, ...] = ()
    approaches: Mapping[str, Approach] = field(default_factory=dict)
    contents: Contents | None = None
    estimates: Estimates | None = None
    measurements: tuple[Measurement, ...] = ()
    datums: Mapping[str, Datum] = field(default_factory=dict)
    datum: tuple[str, ...] = ()
    origins: Mapping[str, Origin] = field(default_factory=dict)
    unchanged: Sheet | None = None
    beyond_limits: bool = False
    accepted: Mapping[str, str] = field(default_factory=dict)
    specs: tuple[SpecEntry, ...] = ()

    @property
    def measurement(self) -> Measurement | None:
        """The only measurement, or ``None``; raises :class:`InputError` if the sheet lists several."""
        return only_one(self.measurements, self.file) if self.measurements else None

    @property
    def whole_space(self) -> Space:
        """The space with the draws of the sources, by the sheet's laws, before any calibration."""
        return self.space.including(own_draws(self.sources, labels(self.sources)))

    def against(self, names: str | list[str] | None) -> Sheet:
        """Return the sheet with errors counted against other datums; see :func:`chosen_datums`."""
        return replace(self, datum=chosen_datums(names, self.datums))

    def with_changes(self, changes: Mapping[str, object]) -> Sheet:
        """Return the sheet with values changed, by the path of :class:`precision_pin.sheet.changes.Change`."""
        if self.contents is None:
            raise InputError("the sheet was not read from a file or a dictionary, so that nothing in it can be changed")
        change_list = [Change(path, plain_data(value, path), path) for path, value in changes.items()]
        return self.contents.read_changed(self, change_list)


@dataclass(frozen=True, eq=False)
class Contents:
    """The contents of a sheet, from which it can be read again.

    Attributes:
        file: Name of the sheet in messages.
        folder: Base folder of file names.
        kinds, overrides: As for :func:`read`.
        source: The text of the file, without changes; empty for a dictionary.
    """

    text: Text
    file: str
    folder: FilePath
    kinds: tuple[type[Source], ...]
    overrides: Overrides
    source: str = ""

    def written(self, folder: FilePath, **changed: Any) -> str:
        """Return the sheet's text with its comments, some keys changed, the robot's path relative to a folder."""
        data = {**self.text.data, **changed}
        file = self.folder / data["robot"]
        if file.is_file():
            data["robot"] = os.path.relpath(file, folder)
        return edited_yaml(self.source, data) if self.source else written_yaml(data)

    def values_at(self, sheet: Sheet, path: str) -> dict[str, Any]:
        """Return the values that a path of :meth:`read_changed` names, as written, by their full paths."""
        return values_at(self.text, path, sheet.sources, catalogue() | {kind.kind(): kind for kind in self.kinds})

    def read_changed(self, sheet: Sheet, changes: Sequence[Change]) -> Sheet:
        """Return ``sheet``, which was read from these contents, with some values changed."""
        if not changes:
            return sheet
        text = change_text(self.text, changes, sheet.sources, catalogue() | {kind.kind(): kind for kind in self.kinds})
        first = sheet.unchanged or sheet
        # an unchanged arm is not read again from its files
        chain = sheet.chain if is_same_arm(text.data, self.text.data) else None
        changed = _read(replace(self, text=text), first, chain)
        return replace(changed, unchanged=first, beyond_limits=sheet.beyond_limits, datum=sheet.datum)


def read(
    path: str | os.PathLike[str],
    *,
    kinds: Iterable[type[Source]] = (),
    overrides: Overrides | None = None,
    changes: Sequence[Change] = (),
) -> Sheet:
    """Read a sheet and its robot.

    Args:
        kinds: Source classes in addition to those of the package.
        overrides: Robot, tip, base and target instead of the sheet's.
        changes: Values instead of the sheet's, which must be valid without them.
    """
    file = os.fspath(path)
    try:
        source = read_text_file(file, LARGEST_FILE)
        text = read_text(source, file)
    except UnreadableFileError as error:
        raise SheetError([Finding("error", "E_FILE", f"the sheet {error.reason}", file)]) from None
    contents = Contents(text, file, FilePath(file).parent, tuple(kinds), overrides or Overrides(), source)
    return contents.read_changed(_read(contents), changes)


def read_data(data: Mapping[str, object], folder: str | os.PathLike[str], kinds: Iterable[type[Source]] = ()) -> Sheet:
    """Return the sheet of a dictionary: keys and values of the YAML sheet, numbers as numbers or text.

    Args:
        folder: Base folder of the names of the robot and of tables.
        kinds: Source classes in addition to those of the package.
    """
    text = Text(plain_data(data), {}, ())
    return _read(Contents(text, "the sheet", FilePath(folder), tuple(kinds), Overrides()))


def _read(contents: Contents, unchanged: Sheet | None = None, chain: Chain | None = None) -> Sheet:
    text, file, folder, overrides = contents.text, contents.file, contents.folder, contents.overrides
    findings = Findings(text, file)
    document, wrong_keys = _document(text, findings)
    kinds = catalogue() | {kind.kind(): kind for kind in contents.kinds}
    parameters, unreadable = _parameters(document, findings, used_quantities(tuple(kinds.values())), folder)
    arm_is_known = not wrong_keys & {"robot", "tip", "base", "locked"}
    if chain is None and arm_is_known:
        chain = read_chain(document, findings, overrides, folder)
    slides = {} if chain is None else dict(zip(chain.joint_names, map(bool, chain.prismatic), strict=True))
    context = Context(parameters, slides, folder)
    sources, by_source, invalid = _sources(document, findings, kinds, context, chain)
    draws = tuple(dict.fromkeys(parameter.draw for parameter in parameters.values()))
    space = correlated_space(draws, document.correlations, findings, unreadable)
    if chain is None:
        findings.refuse()
        raise SheetError("the robot could not be read")
    for path, settings in invalid.items():
        # unknown joints of sources with other errors too, so that all errors are reported together
        name = settings.get("joint")
        if isinstance(name, str) and name not in chain.joint_names:
            findings.take(path, UnknownNameError("joint on the chain", name, chain.joint_names))
    poses, approaches = parse_poses(document.poses, findings, chain)
    items = tuple(sources.values())
    names = labels(items)
    extended, source_draws = _try_terms(chain, space, sources, names, poses, approaches, findings)
    estimates = None
    if document.calibrated is not None and document.calibrated != "none" and not findings.found:
        estimates = _estimates(
            document.calibrated, chain.robot, space.including(own_draws(items, names)), folder, findings, unchanged
        )
    entries, measurements = document.measurement, []
    for k, entry in enumerate(entries if isinstance(entries, list) else [] if entries is None else [entries]):
        with findings.taking("measurement", *([k] if isinstance(entries, list) else [])):
            measurements.append(read_measurement(entry, chain))
    datums: dict[str, Datum] = {}
    for name, procedure in document.datums.items():
        with findings.taking("datums", name):
            datums[name] = read_datum(name, procedure, chain, poses, parse_pose, partial(read_visits, folder))
    datum: tuple[str, ...] = ()
    with findings.taking("datum"):
        datum = chosen_datums(document.datum, document.datums)
        check_together([datums[name] for name in datum if name in datums])
    origins = {
        f"{label}.{setting}" if setting else label: origin
        for k, label in zip(sources, names, strict=True)
        for setting, origin in by_source.get(k, {}).items()
    }
    origins |= origins_by_path(document.provenance, [draw.name for draw in draws], names, findings)
    specs = tuple(
        item if isinstance(item, SpecEntry) else SpecEntry.model_validate({"limit": item}) for item in document.specs
    )
    for k, spec in enumerate(specs):
        for name in spec.poses:
            if name not in document.poses:
                findings.take(("specs", k), UnknownNameError("pose", name, document.poses))
    for code, reason in document.accept.items():
        # buckling cannot be accepted
        if not re.fullmatch(r"(?!W_NO_REST$)W_[A-Z_]+", code) or not reason.strip():
            message = f"accept: expected the code of a warning and a reason, got {code!r}: {reason!r}"
            findings.error(("accept", code), message)
    findings.refuse()
    remark_on_sources(document, sources, names, extended, space.draws, source_draws, findings)
    remark_on_poses(document, chain, findings)
    remark_on_gravity(chain, sources, findings)
    all_findings = (*chain_findings(chain), *findings.found)
    warnings = tuple(finding.accepted(document.accept) for finding in all_findings if finding.severity != "error")
    assumed = [k for k, o in by_source.items() if ASSUMED in {origin.kind for origin in o.values()}]
    return Sheet(
        file, chain, space, items, poses, document.statics, warnings,
        tuple(rank for rank, k in enumerate(sources) if k in assumed), approaches=approaches, contents=contents,
        estimates=estimates, measurements=tuple(measurements), origins=origins, accepted=document.accept,
        specs=specs, datums=datums, datum=datum,
    )  # fmt: skip


def _estimates(
    calibrated: str, robot: Robot, space: Space, folder: FilePath, findings: Findings, unchanged: Sheet | None
) -> Estimates | None:
    """Return the estimates of the sheet's calibration, except numbers that a change has set."""
    with findings.taking("calibrated"):
        data = read_calibration(folder / calibrated, f"calibrated: {calibrated}", robot)
        if "kinematics" not in data:
            message = f"{calibrated} is of a {data['robot']} by name only; let this version of calibrate write it again"
            findings.warning(("calibrated",), message, "W_CALIBRATED_ROBOT")
        estimates = read_estimates(data, calibrated)
        before = space if unchanged is None else unchanged.whole_space
        if edits := estimates.edited(before):
            findings.warning(("calibrated",), _describe_edits(estimates, edits, space), "W_TEXT_MEASURED")
        if unchanged is not None and unchanged.estimates is not None and ("calibrated",) not in findings.text.changes:
            retained, overridden = estimates.without_changed(before, space)
            if overridden:
                findings.warning(("calibrated",), _describe_overridden(estimates, overridden, space), "W_SET_MEASURED")
            if retained is None:
                return None
            estimates = retained
        estimates.remaining_space(space)
        return estimates
    return None


def _describe_overridden(estimates: Estimates, names: Sequence[str], space: Space) -> str:
    std = np.sqrt(np.diag(estimates.covariance))
    rows = [(k, name) for k, name in enumerate(estimates.names) if name in names]
    estimate_texts = [f"{name} {_mean_and_std(space, name, estimates.mean[k], std[k])}" for k, name in rows]
    return (
        "set values replace values measured on this robot (mean ± std): "
        f"{some(estimate_texts, _MOST_NAMED, '; ')}; all other "
        "values stay as measured; --set calibrated=none uses the tolerances, which hold for other robots, for all values"
    )


def _mean_and_std(space: Space, name: str, mean: float, std: float) -> str:
    unit = WrittenUnit.suiting(space.quantity_and_mean(name)[0], [mean, std])
    return f"{mean * unit.per_si:.3g} ± {std * unit.per_si:.2g} {unit.name}"


def _describe_edits(estimates: Estimates, edits: Mapping[str, tuple[float, float]], space: Space) -> str:
    changes = [
        f"{name} {_mean_and_std(space, name, *edit)}, then {_mean_and_std(space, name, *estimates.stated[name])}"
        for name, edit in edits.items()
    ]
    return (
        "tolerances in the sheet differ from those of the calibration (mean ± std): "
        f"{some(changes, _MOST_NAMED, '; ')}; the values measured on this robot remain in use; --set replaces them by a "
        "tolerance, calibrate --set calibrated=none repeats the fit with the new tolerances"
    )


def _document(text: Text, findings: Findings) -> tuple[Document, set[str]]:
    """Return the sheet's contents and its invalid top-level keys; these are omitted, so that reading continues."""
    if not isinstance(text.data, dict):
        findings.error((), "a sheet must begin with 'precision-pin: 1' and contain keys such as robot: and sources:")
        findings.refuse()
    data: dict[str, Any] = {key: value for key, value in text.data.items() if value != ""}
    try:
        return document_model().model_validate(data), set()
    except ValidationError as error:
        findings.take_validation(error, (), document_model())
        locations = [findings.walk((), entry["loc"]) or entry["loc"] for entry in error.errors()]
    placeholders = {"precision-pin": "1", "robot": ""}
    for where in locations:
        top = str(where[0])
        if top in ("poses", "locked") and len(where) > 1:
            data[top] = {key: value for key, value in data[top].items() if key != where[1]}
        else:
            data.pop(top, None)
    return document_model().model_validate(placeholders | data), {str(where[0]) for where in locations}


def _parameters(
    document: Document, findings: Findings, quantities: tuple[units.Quantity, ...], folder: FilePath
) -> tuple[dict[str, NamedParameter], tuple[str, ...]]:
    """Return the named parameters by the names of their components, and the names of unreadable ones."""
    # a placeholder replaces an unreadable parameter, so that its uses cause no further findings
    parameters: dict[str, NamedParameter] = {}
    owners: dict[str, str] = {}
    broken: list[str] = []
    for name, law in document.parameters.items():
        path: Path = ("parameters", name)
        if not NAME.fullmatch(name):
            what = "a name is a letter followed by letters, digits and _ . -"
            findings.error(path, f"{name!r} cannot name a parameter: {what}")
            continue
        try:
            parameter = parse_parameter(name, law, quantities, folder)
        except InputError as error:
            findings.take(path, error)
            broken += [name, f"{name}.x", f"{name}.y", *(f"{name}.{k}" for k in range(6))]
            continue
        names = {name, *parameter.draw.components}
        duplicate = next((other for other in sorted(names) if other in owners), None)
        if duplicate is not None:
            findings.error(path, f"the name {duplicate!r} is already used by the parameter {owners[duplicate]!r}")
            continue
        owners |= dict.fromkeys(names, name)
        parameters |= dict.fromkeys(parameter.draw.components, parameter)
    placeholders = {name: NamedParameter(Draw(name, Fixed(0.0)), quantities) for name in broken if name not in owners}
    return parameters | placeholders, tuple(placeholders)


def _sources(
    document: Document, findings: Findings, kinds: Mapping[str, type[Source]], context: Context, chain: Chain | None
) -> tuple[dict[int, Source], dict[int, dict[str, Origin]], dict[Path, Mapping[str, Any]]]:
    """Return readable sources and the origins of their values by position, and the settings of the others by path."""
    sources: dict[int, Source] = {}
    invalid: dict[Path, Mapping[str, Any]] = {}
    origins: dict[int, dict[str, Origin]] = {}
    for k, entry in enumerate(document.sources):
        path: Path = ("sources", k)
        if not isinstance(entry, dict) or len(entry) != 1:
            description = f"this has {len(entry)} keys" if isinstance(entry, dict) else f"this is {str(entry)[:40]!r}"
            findings.error(path, f"a source is one kind with its settings, such as 'length: {{…}}'; {description}")
            continue
        name, settings = next(iter(entry.items()))
        if name not in kinds:
            findings.error((*path, name), f"unknown kind of source {name!r}: {nearest(name, kinds)}", "E_UNKNOWN_KEY")
            continue
        if not isinstance(settings, dict):
            findings.error((*path, name), f"the settings of {name} are missing: {{key: value, …}}")
            continue
        model = source_model(kinds[name])
        fields = tuple(field.alias or key for key, field in model.model_fields.items())
        setting_origins = source_origins(settings, fields, (*path, name), findings)
        if setting_origins:
            origins[k] = setting_origins
        meta_keys = {ASSUMED, PROVENANCE} - set(model.model_fields)
        settings = {key: value for key, value in settings.items() if key not in meta_keys}
        size: float | None = 0.1  # where the robot or the source is refused, no size is missing
        if chain is not None:
            with suppress(InputError):
                size = kinds[name].nominal_size(settings, chain)
        try:
            valid = model.model_validate(settings, context=replace(context, size=size))
        except ValidationError as error:
            findings.take_validation(error, (*path, name), model)
            invalid[*path, name] = settings
            continue
        try:
            source = kinds[name](**{field: getattr(valid, field) for field in model.model_fields})
            numbers = [field.name for field in setting_fields(kinds[name]) if field.may_be_random]
            is_given = any(number in settings or getattr(source, number) for number in numbers)
            if source.deviations and not is_given and not source.own_draws(""):
                raise InputError(f"{name} without a number does nothing; give one or more of {', '.join(numbers)}")
            sources[k] = source
        except InputError as error:
            findings.take((*path, name), error)
            invalid[*path, name] = settings
    return sources, origins, invalid


def _try_terms(
    chain: Chain,
    space: Space,
    sources: Mapping[int, Source],
    names: Sequence[str],
    poses: Mapping[str, Array],
    approaches: Mapping[str, Approach],
    findings: Findings,
) -> tuple[Space, list[tuple[Path, Draw]]]:
    """Report invalid joints and links by evaluating all poses; return the space with the sources' draws, and the draws."""
    extension = Extension(space)
    usable: list[tuple[Path, Source, str]] = []
    source_draws: list[tuple[Path, Draw]] = []
    for (k, source), label in zip(sources.items(), names, strict=True):
        path: Path = ("sources", k, source.kind())
        with findings.taking(*path):
            extension.add(draws := source.draws(label))
            usable.append((path, source, label))
            source_draws += [(path, draw) for draw in draws]
    extended = extension.space()
    bound = {path: BoundSource(source, LabelledSpace(extended, label)) for path, source, label in usable}
    postures = [replace(chain.at(q), approach=approaches.get(name, ())) for name, q in poses.items()]
    for posture in postures or [chain.at(np.zeros(len(chain.joints)))]:
        for path, item in tuple(bound.items()):
            try:
                for _ in item.terms(load_posture(posture, [item])):
                    pass
            except InputError as error:
                findings.take(path, error)
                del bound[path]
        bound = {path: item for path, item in bound.items() if item.source.depends_on != "chain"}
    return extended, source_draws


def correlated_space(
    draws: Sequence[Draw], entries: Sequence[object], findings: Findings, unreadable: Sequence[str]
) -> Space:
    """Return the space of the sheet's draws with its correlations, whose errors become findings."""
    space = Space(tuple(draws))
    for k, entry in enumerate(entries):
        with findings.taking("correlations", k):
            correlation = _correlation(entry)
            if not set(correlation.names) & set(unreadable):
                space = Space(space.draws, (*space.correlations, correlation))
    return space


def _correlation(entry: object) -> Correlation:
    if not isinstance(entry, Mapping) or not set(entry) <= {"parameters", "correlation", "matrix"}:
        raise InputError(
            "a correlation is {parameters: [a1, a2], correlation: 0.5}, or of several "
            "{parameters: [a1, a2, a3], matrix: [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]}"
        )
    names = entry.get("parameters")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SettingError(("parameters",), "expected the names of two or more parameters: [a1, a2]")
    if ("correlation" in entry) == ("matrix" in entry):
        raise InputError("a correlation needs either correlation: (of two) or matrix:")
    if "correlation" in entry:
        if len(names) != 2:
            raise SettingError(
                ("parameters",), f"correlation: is for two parameters, these are {len(names)}; use matrix:"
            )
        return Correlation.pair(names[0], names[1], _ratio(entry["correlation"], ("correlation",)))
    rows = entry["matrix"]
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise SettingError(("matrix",), "expected rows of plain numbers: [[1, 0.5], [0.5, 1]]")
    numbers = [[_ratio(cell, ("matrix", i, j)) for j, cell in enumerate(row)] for i, row in enumerate(rows)]
    with placed("matrix"):
        return Correlation(tuple(names), tuple(map(tuple, numbers)))


def _ratio(value: Any, where: Path) -> float:
    if isinstance(value, Mapping | list):
        raise SettingError(where, "expected a plain number")
    with placed(*where):
        return units.parse(value, units.RATIO)


_RESULT_SCHEMA: Final = "precision-pin/calibration/1"
"""``schema`` of the JSON of ``calibrate``; a new number would mark a form that older versions cannot read."""


def read_calibration(path: FilePath, name: str, robot: Robot) -> dict[str, Any]:
    """Return the JSON written by ``calibrate``; messages begin with ``name``. Raises InputError if for another robot."""
    try:
        data = json.loads(read_text_file(path, 64 * 2**20))
    except UnreadableFileError as error:
        raise InputError(f"{name} {error.reason}") from None
    except (ValueError, RecursionError):
        raise InputError(f"{name} is not JSON; calibrate --json writes it") from None
    note_input(path)
    if not isinstance(data, dict) or data.get("schema") != _RESULT_SCHEMA:
        raise InputError(f"{name} is no result of calibrate ({_RESULT_SCHEMA}); calibrate --json writes it")
    check_calibrated_robot(data, name, robot)
    return data


def check_calibrated_robot(data: Mapping[str, Any], name: str, robot: Robot) -> None:
    """Raise InputError if a result of ``calibrate`` belongs to a robot with other joints (in old results: other name)."""
    file, robot_name = os.path.basename(robot.file), str(data.get("robot"))
    try:
        base, tip, digest = (data["kinematics"][key] for key in ("base", "tip", "hash"))
        is_same = robot.kinematics(base, tip) == digest
    except (InputError, KeyError, TypeError):
        is_same = "kinematics" not in data and robot_name == file
    if not is_same:
        reason = "joints and tip are placed otherwise" if robot_name == file else f"it is of {robot_name}"
        raise InputError(f"{name} is not of this {file}: {reason}; calibrate this robot, or give the other one's URDF")


def read_estimates(data: dict[str, Any], file: str) -> Estimates:
    """Return the estimates in the JSON of ``calibrate``; ``file`` is named in messages."""
    try:
        names = tuple(map(str, data["posterior"]["names"]))
        mean = np.array([data["posterior"]["mean"][name] for name in names], dtype=float)
        covariance = np.array(data["posterior"]["covariance"], dtype=float)
        # missing in results of older versions
        stated = {
            str(name): (float(row["mean"]), float(row["std"])) for name, row in (data.get("in_sheet") or {}).items()
        }
        if not covariance.shape == (len(names),) * 2 or not len(set(names)) == len(names) > 0:
            raise ValueError
        if not (np.isfinite(covariance).all() and np.isfinite(mean).all()):
            raise ValueError
    except (AttributeError, KeyError, TypeError, ValueError):
        message = f"calibrated: the estimates in {file} are not complete; let calibrate write it again"
        raise InputError(message) from None
    return Estimates(names, mean, covariance, stated)


MEASURED: Final = "measured"
ORIGINS: Final = ("assumed", "data sheet", MEASURED, "drawing")
"""Possible origins of a value; a calibration sets the third."""
# of messages: a word, and a word with a text
_EXAMPLE: Final = "such as 'provenance: drawing' or 'provenance: {data sheet: \"page 12\"}'"


@dataclass(frozen=True)
class Origin:
    """Origin of a value.

    Attributes:
        kind: One of `ORIGINS`.
        text: Details, such as the page of a data sheet.
    """

    kind: str
    text: str = ""


def read_origin(value: Any) -> Origin:
    """Return the origin stated in a sheet: a word, or a word with a text."""
    word, text = value, ""
    if isinstance(value, dict):
        if len(value) != 1:
            raise InputError(f"one word of {', '.join(ORIGINS)} is expected, {_EXAMPLE}; this has {len(value)} keys")
        word, text = next(iter(value.items()))
    if not isinstance(word, str) or not isinstance(text, str):
        raise InputError(f"a word is expected, {_EXAMPLE}")
    if word not in ORIGINS:
        raise UnknownNameError("provenance", word, ORIGINS)
    return Origin(word, text)


def source_origins(
    settings: Mapping[str, Any], fields: Sequence[str], path: Path, findings: Findings
) -> dict[str, Origin]:
    """Return the origins stated in a source, by setting; under an empty name for all its values."""
    origins: dict[str, Origin] = {}
    if ASSUMED in settings and ASSUMED not in fields:
        mark = settings[ASSUMED]
        if mark not in ("true", "false"):
            findings.error((*path, ASSUMED), f"{ASSUMED} must be true or false, got {str(mark)[:40]!r}")
        elif mark == "true":
            origins[""] = Origin(ASSUMED)
    if PROVENANCE in settings and PROVENANCE not in fields:
        value = settings[PROVENANCE]
        if origins:
            message = f"{ASSUMED} and {PROVENANCE} both state the origin of the values; remove one of them"
            findings.error((*path, PROVENANCE), message)
        by_setting = isinstance(value, dict) and not set(value) & set(ORIGINS) and bool(set(value) & set(fields))
        for name, entry in value.items() if by_setting else [("", value)]:
            with findings.taking(*path, PROVENANCE, *([name] if name else [])):
                if name and name not in fields:
                    raise UnknownNameError("setting", name, fields)
                origins[name] = read_origin(entry)
    return origins


def origins_by_path(
    stated: Mapping[str, Any], names: Sequence[str], labels: Sequence[str], findings: Findings
) -> dict[str, Origin]:
    """Return the origins under the sheet's key ``provenance``, by paths as in ``--set``; ``*`` matches anything."""
    origins: dict[str, Origin] = {}
    paths = [*(f"parameters.{name}" for name in names), *labels]
    for pattern, value in stated.items():
        with findings.taking(PROVENANCE, pattern):
            origin = read_origin(value)
            matching = [name for name in paths if matches(pattern, name)]
            setting = ""
            if not matching:
                label, _, setting = pattern.rpartition(".")
                matching = [name for name in labels if label and matches(label, name)]
            if not matching:
                raise UnknownNameError("parameter or source", pattern, paths)
            origins |= {f"{name}.{setting}" if setting else name: origin for name in matching}
    return origins


@dataclass(frozen=True)
class SheetDifference:
    """A value that differs between two sheets.

    Attributes:
        path: As in ``--set``: ``parameters.a1``, ``axis_install[joint2].radius``; a whole source by its label.
        before, after: As written; ``None`` if a sheet does not have it.
    """

    path: str
    before: str | None
    after: str | None


def sheet_differences(first: Sheet, other: Sheet) -> tuple[SheetDifference, ...]:
    """Return the differences between two sheets, in the order of the first, then new values.

    Values are compared as text: ``0.1 mm`` and ``100 um`` differ. A source in only one sheet is one difference. Sheets
    not read from a file or a dictionary have none.
    """
    if first.contents is None or other.contents is None:
        return ()
    before, after = dict(_values(first)), dict(_values(other))
    paths = dict.fromkeys([*before, *after])
    return tuple(
        SheetDifference(path, before.get(path), after.get(path))
        for path in paths
        if before.get(path) != after.get(path)
    )


def _values(sheet: Sheet) -> Iterator[tuple[str, str]]:
    assert sheet.contents is not None
    data: dict[str, Any] = sheet.contents.text.data
    for key, value in data.items():
        if key == "sources":
            for label, entry in zip(labels(sheet.sources), value, strict=True):
                yield label, "present"
                yield from _flat(label, next(iter(entry.values())))
        # the other keys do not change the error
        elif key in Document.model_fields and key not in ("measurement", "specs"):
            yield from _flat(key, value)


def _flat(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield every text below a value by its path; a list is one text."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _flat(f"{path}.{key}", entry)
    else:
        yield path, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_text(entry)}" for key, entry in value.items()) + "}"
    return "[" + ", ".join(map(_text, value)) + "]" if isinstance(value, list) else str(value)
