"""``precision-pin check`` and ``mcpc``, which also accept a URDF without a sheet."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import click

from precision_pin.analyses.registry import declarations, fitting_specs
from precision_pin.base.errors import Finding, InputError
from precision_pin.cli.exit_codes import EXIT_INPUT
from precision_pin.cli.inputs import find_inputs, read_inputs
from precision_pin.cli.options import Command, Options, chain_options, inputs_argument, output_option, quiet_option
from precision_pin.cli.streams import echo_data, wrapped
from precision_pin.cli.terminal import echo_note, echo_table, echo_warnings
from precision_pin.robot.examples import named_briefly

if TYPE_CHECKING:
    from precision_pin.sheet import Sheet


@click.command("check", cls=Command)
@inputs_argument
@chain_options
@quiet_option
@output_option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def command(as_json: bool, **arm: Any) -> int:
    """Check a URDF, or a sheet and the URDF it names, and list every finding with file and line.

    A sheet is tried at each of its poses, as `analyze` would take it; the keys of other commands are read too.

    Exit code 2 if there is an error; warnings alone pass.
    """
    groups: dict[str, list[Finding]] = {"errors": [], "warnings": []}
    for finding in _findings(arm):
        groups.setdefault(f"{finding.severity}s", []).append(finding)
    errors, warnings, notes = groups["errors"], groups["warnings"], groups.get("notes", ())
    if as_json:
        keys = ("code", "message", "file", "line")
        listed = {name: [{key: getattr(item, key) for key in keys} for item in group] for name, group in groups.items()}
        echo_data(json.dumps(listed, ensure_ascii=False))
    else:
        if errors or warnings:
            echo_data("\n".join(wrapped(named_briefly(str(finding)), sys.stdout) for finding in (*errors, *warnings)))
        for note in notes:
            echo_note(str(note))
        if not errors:
            echo_note(f"no errors, {len(warnings)} warning{'' if len(warnings) == 1 else 's'}")
    return EXIT_INPUT if errors else 0


def _findings(arm: Options) -> tuple[Finding, ...]:
    from precision_pin.robot import urdf
    from precision_pin.robot.chain import Chain
    from precision_pin.sheet.sheet_lint import note_on_normal

    findings: tuple[Finding, ...] = ()
    try:
        inputs = find_inputs(arm["inputs"], sheet_needed=False)
        if inputs.sheet is None:
            assert inputs.robot is not None
            if arm["changes"]:
                return (Finding("error", "E_USAGE", "--set changes a sheet, and none is given"),)
            findings = urdf.check(inputs.robot, package_dirs=arm["package_dirs"])
            if (arm["tip"], arm["base"]) != (None, None) and not any(entry.severity == "error" for entry in findings):
                Chain.from_urdf(str(inputs.robot), arm["tip"], arm["base"])
            return findings
        sheet = read_inputs(inputs, arm)
    except InputError as error:
        return findings + error.findings
    note = None if sheet.contents is None else note_on_normal(sheet.contents.text, sheet.file)
    drawn = [draw for draw in sheet.whole_space.draws if draw.limits]
    limits = [f"{draw.name}: {draw.limits}: {draw.law.describe(draw.known_quantities)}" for draw in drawn]
    notes = [*([note] if note else ()), *(Finding("note", "N_LIMITS", text, sheet.file) for text in limits)]
    return (*sheet.findings, *_pose_findings(sheet), *_key_findings(sheet), *notes)


def _pose_findings(sheet: Sheet) -> tuple[Finding, ...]:
    """Return the warnings and errors of an analysis at each pose of the sheet; for very many, joint limits only."""
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sampling.verdict_grounds import MOST_POSES, pose_findings

    model = ErrorModel.from_sheet(sheet)
    varies = not any(finding.code in ("W_NO_SOURCES", "W_NOTHING_VARIES") for finding in sheet.findings)
    return tuple(
        replace(finding, message=f"pose {name!r}: {finding.message}", file=finding.file or sheet.file)
        for rank, (name, q) in enumerate(sheet.poses.items())
        for finding in (pose_findings(model, name, spread=varies) if rank < MOST_POSES else sheet.chain.at(q).findings)
    )


def _key_findings(sheet: Sheet) -> Iterator[Finding]:
    """Yield what analyses find in the keys of the sheet that are theirs."""
    try:
        fitting_specs(sheet)
    except InputError as error:
        yield from error.findings
    stated = {} if sheet.contents is None else sheet.contents.text.data
    for declaration in declarations().values():
        if declaration.check_sheet and not stated.keys().isdisjoint(declaration.keys):
            yield from declaration.output(declaration.check_sheet)(sheet)


@click.command("mcpc", cls=Command)
@inputs_argument
@chain_options
@quiet_option
@output_option("--json", "as_json", is_flag=True, help="Print the table as JSON, in rad and m.")
def mcpc(as_json: bool, **arm: Any) -> None:
    """Print the MCPC parameters of a chain, laid out as the paper's Table 1 (degrees and mm).

    Without arguments: the paper's arm.
    """
    from precision_pin.robot import urdf
    from precision_pin.robot.chain import Chain, chain_findings
    from precision_pin.robot.mcpc import from_chain, mcpc_table

    inputs = find_inputs(arm["inputs"], sheet_needed=False)
    if inputs.sheet is not None:
        sheet = read_inputs(inputs, arm)
        chain, warnings = sheet.chain, sheet.findings
    else:
        assert inputs.robot is not None
        if arm["changes"]:
            raise InputError.of("E_USAGE", "--set changes a sheet, and none is given")
        robot = urdf.read(inputs.robot, package_dirs=arm["package_dirs"])
        chain = Chain.from_robot(robot, arm["tip"], arm["base"])
        warnings = chain_findings(chain)
    echo_warnings(warnings, chain.robot.file)
    table = from_chain(chain)
    if as_json:
        rows = [asdict(row) for row in table.table]
        echo_data(json.dumps({"base": chain.base, "tip": chain.tip, "links": rows}, ensure_ascii=False))
    else:
        echo_table(mcpc_table(table), is_answered=True)
