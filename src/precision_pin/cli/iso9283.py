"""``precision-pin iso9283``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

import click

from precision_pin.base.errors import Finding, InputError, UnitError
from precision_pin.base.files import whole_folder, write_text
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.headings import output_option, robot_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warning_lines, quiet_option
from precision_pin.cli.options import (
    ChainOptions,
    PoseOptions,
    SamplingCommand,
    beyond_limits_option,
    chain_options,
    inputs_argument,
    pose_options,
    seed_option,
)
from precision_pin.cli.poses import check_poses, pose_files, read_pose_set
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table

if TYPE_CHECKING:
    from precision_pin.analyses.iso9283.result import Iso9283Result

_IN_CUBE: Final = 5
FILES: Final = ("iso9283.*",)
"""Files written to a folder."""


class _Arm(ChainOptions, PoseOptions):
    """The arm and the poses."""


@click.command("iso9283", cls=SamplingCommand)
@inputs_argument
@pose_options
@chain_options
@all_warnings_option
@quiet_option
@click.option(
    "--cube",
    is_flag=True,
    help="The standard's five poses in the largest cube within reach, tool as at the first pose.",
)
@click.option(
    "--robots", type=int, default=2000, show_default=True, metavar="N", help="Built robots, each tested once."
)
@click.option("--cycles", type=int, metavar="N", help="Cycles of a test: those measured, else 30.")
@seed_option
@robot_option(
    "--target", "measured_point", metavar='"X Y Z mm"', help="The measured point in tool axes; the tip if left out."
)
@click.option("--load", metavar='"M kg"', help="Mass at the target, beside the loads of the sheet.")
@click.option("--fit-base", is_flag=True, help="Align the base by the best fit over the poses.")
@click.option(
    "--measured", metavar="FILE.csv", help="Measured cycles of a robot: pose, cycle, x [mm], y [mm], z [mm], angles."
)
@beyond_limits_option
@click.option(
    "--spec", "specs", multiple=True, metavar='"RP 0.1 mm @ 95 %"', help="A limit of a figure to judge; repeats."
)
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write the plot (PNG and SVG) and the result there.")
def command(
    cube: bool,
    robots: int,
    cycles: int | None,
    seed: int,
    measured_point: str | None,
    load: str | None,
    fit_base: bool,
    measured: str | None,
    specs: tuple[str, ...],
    json_path: str | None,
    out: str | None,
    **arm: Unpack[_Arm],
) -> int:
    """Forecast accuracy and repeatability as ISO 9283 measures them, over built robots and over tests.

    The poses P1, P2, … are those given, in their order, or with --cube the standard's five. AD and RD are between
    P2 and P4. With measured cycles of a robot, its figures stand beside the forecast, with a test whether they agree.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin.analyses.iso9283.figures import read_cycles
    from precision_pin.analyses.iso9283.forecast import CYCLES, iso9283, listed_limits
    from precision_pin.analyses.iso9283.result import pose_names
    from precision_pin.analyses.iso9283.table import iso9283_table
    from precision_pin.draws.space import check_seed
    from precision_pin.model.error_model import ErrorModel

    check_seed(seed)
    listed_limits(specs)
    check_poses(arm)
    given = [
        option
        for option, value in (
            ("--pose", arm["pose_names"]),
            ("--q", arm["qs"]),
            ("--all-poses", arm["all_poses"]),
            ("--trajectory", arm["trajectory"]),
            ("--grid", arm["grid"]),
        )
        if value
    ]
    if cube and given:
        raise InputError([Finding("error", "E_USAGE", f"--cube and {given[0]} exclude each other")])
    point = None if measured_point is None else _lengths("--target", measured_point, "0 0 100 mm")
    mass = 0.0 if load is None else _mass(load)
    outputs = Outputs({"--json": json_path}, out, FILES)
    outputs.check()
    outputs.refuse_inputs([*pose_files(arm), *([] if measured is None else [measured])])
    sheet = read_sheet(arm, outputs)
    error_model = ErrorModel.from_sheet(sheet)
    poses = None if cube else read_pose_set(sheet, arm)
    names = tuple(f"P{rank}" for rank in range(1, _IN_CUBE + 1)) if poses is None else poses.names
    attained = None if measured is None else read_cycles(measured, pose_names(names))
    if cycles is None:
        cycles = CYCLES if attained is None else len(next(iter(attained.values())))
    compile_sampler(error_model.space)
    if cube:
        echo_note("seeking the largest cube within reach: up to a minute")
    with progress_bar(robots * len(names) * cycles, "testing", "visits") as progress, unwinding():
        result = iso9283(
            error_model, poses, cycles=cycles, robots=robots, seed=seed, target=point, load=mass,
            fit_base=fit_base, specifications=specs, findings=sheet.findings, progress=progress,
        )  # fmt: skip
        raise_if_interrupted()
    if attained is not None:
        result = result.compare(attained)
    echo_warning_lines(result.warnings[len(sheet.findings) :])
    if json_path == "-":
        echo_data(result.to_json())
    else:
        echo_table(iso9283_table(result))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is not None:
        _write_folder(result, Path(out))
        echo_note(f"wrote {out}: iso9283.json, iso9283 as PNG and SVG")
    return 0 if result.met else EXIT_SPEC


def _lengths(option: str, text: str, example: str) -> list[float]:
    """Return three lengths, m.

    Raises
    ------
    InputError
        The option's text is not three lengths with a unit.
    """
    from precision_pin.base import units

    try:
        return units.parse_vector(text, units.LENGTH, count=3)
    except UnitError as error:
        raise _wrong(option, error, example) from None


def _mass(text: str) -> float:
    """Return a mass, kg.

    Raises
    ------
    InputError
        The text is no mass with a unit.
    """
    from precision_pin.base import units

    try:
        return units.parse(text, units.MASS)
    except UnitError as error:
        raise _wrong("--load", error, "5 kg") from None


def _wrong(option: str, error: UnitError, example: str) -> InputError:
    message = f"{option}: {error.findings[0].message}; write it as {example!r}"
    return InputError([Finding("error", "E_USAGE", message)])


def _write_folder(result: Iso9283Result, folder: Path) -> None:
    from precision_pin.analyses.iso9283.figure import figure
    from precision_pin.sampling.figures import save

    with whole_folder(folder) as stage:
        write_text(stage / "iso9283.json", result.to_json() + "\n")
        save(figure(result), stage / "iso9283")
