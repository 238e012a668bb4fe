"""``precision-pin mcpc``."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import click

from precision_pin.base.errors import Finding, InputError
from precision_pin.cli.inputs import find_inputs, read_inputs
from precision_pin.cli.notes import echo_warnings
from precision_pin.cli.options import Command, chain_options, inputs_argument, output_option, quiet_option
from precision_pin.cli.streams import echo_data
from precision_pin.cli.terminal import echo_table


@click.command("mcpc", cls=Command)
@inputs_argument
@chain_options
@quiet_option
@output_option("--json", "as_json", is_flag=True, help="Print the table as JSON, in rad and m.")
def command(as_json: bool, **arm: Any) -> None:
    """Print the MCPC parameters of a chain, laid out as the paper's Table 1 (degrees and mm).

    Without arguments: the paper's arm.
    """
    from precision_pin.analyses.monte_carlo.table import mcpc_table
    from precision_pin.robot import mcpc, urdf
    from precision_pin.robot.chain import Chain, chain_findings

    found = find_inputs(arm["inputs"], sheet_needed=False)
    if found.sheet is not None:
        sheet = read_inputs(found, arm)
        chain, warnings = sheet.chain, sheet.findings
    else:
        assert found.robot is not None
        if arm["changes"]:
            raise InputError([Finding("error", "E_USAGE", "--set changes a sheet, and none is given")])
        robot = urdf.read(found.robot, package_dirs=arm["package_dirs"])
        chain = Chain.from_robot(robot, arm["tip"], arm["base"])
        warnings = chain_findings(chain)
    echo_warnings(warnings, chain.robot.file)
    table = mcpc.from_chain(chain)
    if as_json:
        rows = [dataclasses.asdict(row) for row in table.table]
        echo_data(json.dumps({"base": chain.base, "tip": chain.tip, "links": rows}, ensure_ascii=False))
    else:
        echo_table(mcpc_table(table), is_answered=True)
