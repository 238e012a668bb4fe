"""``precision-pin compensate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack

import click

from precision_pin.base.errors import Finding, InputError
from precision_pin.base.files import whole_folder, write_text
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.headings import output_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warning_lines, quiet_option
from precision_pin.cli.options import (
    ChainOptions,
    Command,
    PoseOptions,
    chain_options,
    inputs_argument,
    pose_options,
    target_option,
)
from precision_pin.cli.poses import check_poses, pose_files, read_pose_set, read_way
from precision_pin.cli.progress import progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table

if TYPE_CHECKING:
    from precision_pin.analyses.compensation.compensation_result import CompensationResult
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.robot.trajectory import Column
    from precision_pin.sheet import Sheet


class _Options(ChainOptions, PoseOptions):
    """All options."""

    mode: Literal["position", "pose"]
    weights: str | None
    csv_path: str | None
    json_path: str | None
    out: str | None


@click.command("compensate", cls=Command)
@inputs_argument
@click.option(
    "--mode",
    type=click.Choice(["position", "pose"]),
    default="position",
    show_default=True,
    help="Correct the position, or position and attitude.",
)
@click.option(
    "--weights",
    metavar='"X Y Z RX RY RZ"',
    help="With --mode pose: weights of the components, 1/m and 1/rad; the weighted squares are made smallest.",
)
@pose_options
@target_option
@chain_options
@output_option(
    "--csv", "csv_path", metavar="FILE", help="Write the corrected joint values there, with the input's columns."
)
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option(
    "--out", metavar="DIR", help="Write a plot (PNG and SVG), the corrected joint values and the result there."
)
@all_warnings_option
@quiet_option
def command(**options: Unpack[_Options]) -> int:
    """Correct the constant part of the pose error by other joint values.

    The constant part is the error with every component at its mean: deflection, offsets, what a calibration has found. The
    joint values are found by Newton's method on the arm with its errors. The exit code is 1 where a pose has no correction.
    """
    from precision_pin.analyses.compensation.compensate import compensate
    from precision_pin.analyses.compensation.table import compensation_table
    from precision_pin.model.error_model import ErrorModel

    check_poses(options)
    weights = _weights(options["weights"])
    outputs = Outputs(
        {"--csv": options["csv_path"], "--json": options["json_path"]},
        options["out"],
        ("compensation.*", "corrected.csv"),
    )
    outputs.check()
    outputs.refuse_inputs(pose_files(options))
    sheet = read_sheet(options, outputs)
    poses, columns = read_pose_set(sheet, options), _columns(sheet, options)
    with progress_bar(len(poses), "correcting", "poses") as progress:
        result = compensate(
            ErrorModel.from_sheet(sheet),
            poses,
            mode=options["mode"],
            weights=weights,
            findings=sheet.findings,
            progress=progress,
        )
    echo_warning_lines(result.warnings[len(sheet.findings) :])
    if options["json_path"] == "-":
        echo_data(result.to_json())
    else:
        echo_table(compensation_table(result))
    _write(result, columns, options)
    return 0 if result.is_complete else EXIT_SPEC


def compensation_of(model: ErrorModel, poses: PoseSet) -> CompensationResult:
    """Return the compensation of the position for a page that shows it; print its warnings."""
    from precision_pin.analyses.compensation.compensate import compensate

    with progress_bar(len(poses), "correcting", "poses") as progress:
        result = compensate(model, poses, progress=progress)
    echo_warning_lines(result.warnings)
    return result


def _weights(text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 6:
        message = f'--weights: six numbers are expected, such as "1 1 1 0.1 0.1 0.1", got {text!r}'
        raise InputError([Finding("error", "E_USAGE", message)])
    return numbers


def _columns(sheet: Sheet, options: _Options) -> tuple[Column, ...]:
    """Return the columns of the trajectory; none where the poses come from elsewhere."""
    path = options["trajectory"]
    return () if path is None else read_way(sheet, path, options).columns


def _write(result: CompensationResult, columns: tuple[Column, ...], options: _Options) -> None:
    """Write the files that are asked for; corrected joint values only where every pose has them.

    Raises
    ------
    OutputError
        Something cannot be written.
    """
    from precision_pin.analyses.compensation.table import corrected_csv

    csv_path, json_path, out = options["csv_path"], options["json_path"], options["out"]
    corrected = corrected_csv(result, columns) if result.is_complete else None
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if csv_path is not None and corrected is not None:
        write_text(Path(csv_path), corrected)
    if out is not None:
        from precision_pin.analyses.compensation.figure import figure
        from precision_pin.sampling.figures import save

        with whole_folder(Path(out)) as stage:
            write_text(stage / "compensation.json", result.to_json() + "\n")
            save(figure(result), stage / "compensation")
            if corrected is not None:
                write_text(stage / "corrected.csv", corrected)
        echo_note(
            f"wrote {out}: compensation.json, compensation as PNG and SVG{', corrected.csv' if corrected else ''}"
        )
    if corrected is None and (csv_path is not None or out is not None):
        echo_note("the corrected joint values are not written: not every pose has them")
