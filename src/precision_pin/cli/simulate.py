"""``precision-pin simulate``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import click

from precision_pin.base.errors import InputError
from precision_pin.base.files import write_text
from precision_pin.cli import options as shared
from precision_pin.cli.analyses import check_shared
from precision_pin.cli.inputs import Outputs, read_sheet
from precision_pin.cli.measurement import measurement_of, measurement_options
from precision_pin.cli.poses import pose_files, read_poses
from precision_pin.cli.terminal import echo_note

_MOST: Final = 100_000
"""Largest number of readings in a file."""


_LONGEST: Final = 1000
"""Largest length of the comment that describes the simulation."""


@click.command("simulate", cls=shared.Command)
@shared.inputs_argument
@measurement_options
@shared.pose_options
@shared.chain_options
@shared.headed_option(
    "--unit", type=int, default=0, show_default=True, metavar="K", help="Number of the robot that is measured."
)
@shared.headed_option(
    "--cycles", type=int, metavar="N", help="Visit each pose N times, and write a file for iso9283 --measured."
)
@shared.seed_option
@shared.output_option("--out", type=shared.FILE, required=True, metavar="FILE.csv", help="The file to write.")
@shared.all_warnings_option
@shared.quiet_option
def command(unit: int, cycles: int | None, out: str, **options: Any) -> None:
    """Write readings of one sampled robot, with the noise of the instrument: a rehearsal without a robot.

    The robot is one of those that analyze samples and export writes with the same --seed: it has all its errors at each
    pose by the exact model, loads and draws for a pose or a visit included. A pose given twice is visited twice.
    calibrate reads the file as it is; with --cycles it is one of measured cycles for iso9283 --measured, in base axes.

    Example: precision-pin simulate --all-poses --unit 5 --out readings.csv
    """
    from precision_pin.analyses.readings import simulate
    from precision_pin.base.arguments import check_whole
    from precision_pin.base.errors import visible
    from precision_pin.draws.draw import MOST_VISITS
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.render.tables import milli

    check_shared(options)
    seed = options["seed"]
    check_whole("--unit", unit, 0, 2**64 - 1, "from 0 to 2^64 - 1")
    if cycles is not None:
        check_whole("--cycles", cycles, 2, MOST_VISITS)
    outputs = Outputs({"--out": out})
    outputs.check(pose_files(options))
    sheet = read_sheet(options, outputs)
    measurement = measurement_of(sheet, options)
    if cycles is not None and measurement.kind not in ("position", "pose"):
        message = f"--cycles are positions or poses, not of the kind {measurement.kind!r}: --kind position"
        raise InputError.of("E_USAGE", message)
    asked = read_poses(sheet, options, _MOST)
    count = len(asked) * (cycles or 1)
    if count > _MOST:
        raise InputError.of("E_USAGE", f"{count:,} readings; at most {_MOST:,} are allowed")
    model = ErrorModel.from_sheet(sheet)
    poses = [pose.name if pose.where is None else pose.where for pose in asked]
    readings = simulate(model, poses, measurement, unit=unit, cycles=cycles or 1, seed=seed)
    readings_text = f"{count:,} reading{'s' if count > 1 else ''}"
    what = readings_text if cycles is None else f"{cycles} cycles at {len(asked):,} poses"
    changed = f" with {', '.join(options['changes'])}" if options["changes"] else ""
    std = measurement.sight or f"{milli(measurement.std, 3)} mm"
    truth = (
        f"{what} of {measurement.kind}, std {std}, of robot {unit} of seed {seed} of "
        f"{os.path.basename(sheet.file)}{changed}"
    )
    comments = [visible(f"simulated: {truth}", _LONGEST)]
    text = readings.to_csv(comments) if cycles is None else readings.to_cycles(cycles, comments)
    write_text(Path(out), text)
    echo_note(f"wrote {out}: {truth}; export --seed {seed} --first {unit} writes this robot as URDF")
