"""``precision-pin map``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from precision_pin.base.files import whole_folder, write_text
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.headings import output_option, sampling_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warning_lines, quiet_option
from precision_pin.cli.options import (
    ChainOptions,
    PoseOptions,
    SamplingCommand,
    chain_options,
    inputs_argument,
    pose_options,
    seed_option,
    spec_option,
    target_option,
)
from precision_pin.cli.poses import check_poses, pose_files, read_pose_set, reference_pose
from precision_pin.cli.progress import progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table
from precision_pin.cli.workers import WorkerOptions, check_workers, worker_options, working

if TYPE_CHECKING:
    from precision_pin.analyses.map.map_result import MapResult
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.sheet import Sheet
    from precision_pin.statistics import Specification


class _Options(ChainOptions, PoseOptions, WorkerOptions):
    """All options."""

    samples: int | None
    verify: int
    relative_to: str | None
    seed: int
    specs: tuple[str, ...]
    netcdf: str | None
    json_path: str | None
    out: str | None


@click.command("map", cls=SamplingCommand)
@inputs_argument
@pose_options
@target_option
@chain_options
@sampling_option(
    "--samples", type=int, metavar="N", help="Sample N robots at every pose; if left out, as many as verdicts take."
)
@click.option(
    "--verify",
    type=int,
    default=5,
    show_default=True,
    metavar="N",
    help="Without --samples: sample the N worst poses once more; 0 samples nothing and judges no --spec.",
)
@click.option(
    "--relative-to",
    metavar="POSE",
    help="Add the error relative to that at a pose where the robot is taught: a name, or joint values as for --q.",
)
@seed_option
@spec_option
@worker_options
@output_option("--netcdf", metavar="FILE.nc", help="Write the map as netCDF, for xarray.")
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write plots (PNG and SVG) and the result there.")
@all_warnings_option
@quiet_option
def command(**options: Unpack[_Options]) -> int:
    """Map the pose error over many poses: quantiles, share in specification, main cause, the worst poses verified.

    The numbers are in closed form, with limits that hold whatever the laws. A specification is judged by robots sampled with
    the exact model at every pose that can be reached, as many as it takes; it is met only if it is met at all of them.
    """
    from precision_pin.draws.space import check_seed
    from precision_pin.statistics.plan import specification

    check_seed(options["seed"])
    specifications = [specification(text) for text in options["specs"]]
    check_poses(options)
    check_workers(options)
    outputs = Outputs(
        {"--journal": options["journal"], "--json": options["json_path"], "--netcdf": options["netcdf"]},
        options["out"],
        ("map.json", "position.*", "attitude.*"),
    )
    outputs.check()
    outputs.refuse_inputs(pose_files(options))
    sheet = read_sheet(options, outputs)
    poses = read_pose_set(sheet, options)
    # late: these take as long to import as all before, and the reading of a large file is to be seen soon
    from precision_pin.analyses.map.map_poses import count_steps, map_poses
    from precision_pin.analyses.map.table import map_table
    from precision_pin.model.error_model import ErrorModel

    reference = reference_pose(sheet, options["relative_to"])
    steps = count_steps(len(poses), options["samples"], options["verify"], judged=bool(specifications))
    with working(options) as workers, progress_bar(steps, "mapping", "steps") as progress:
        result = map_poses(
            ErrorModel.from_sheet(sheet), poses, samples=options["samples"], seed=options["seed"],
            relative_to=reference, specifications=specifications, verify=options["verify"], findings=sheet.findings,
            files={"sheet": sheet.file}, progress=progress, **workers,
        )  # fmt: skip
    echo_warning_lines(result.warnings[len(sheet.findings) :])
    if options["json_path"] == "-":
        echo_data(result.to_json())
    else:
        echo_table(map_table(result))
    _write(result, options)
    return 0 if result.met else EXIT_SPEC


def _write(result: MapResult, options: _Options) -> None:
    """Write the files that are asked for.

    Raises
    ------
    OutputError
        Something cannot be written.
    """
    json_path, netcdf, out = options["json_path"], options["netcdf"], options["out"]
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if netcdf is not None:
        result.to_netcdf(netcdf)
    if out is not None:
        from precision_pin.analyses.map.figure import figure
        from precision_pin.sampling.figures import save

        with whole_folder(Path(out)) as stage:
            write_text(stage / "map.json", result.to_json() + "\n")
            for quantity in ("position", "attitude"):
                save(figure(result, quantity), stage / quantity)
        echo_note(f"wrote {out}: map.json, position and attitude as PNG and SVG")


def map_of(
    sheet: Sheet, poses: PoseSet, seed: int, specifications: Sequence[Specification] = (), verify: int = 0
) -> MapResult:
    """Return the map of poses for a page that shows it; print its warnings.

    Parameters
    ----------
    sheet, poses
        As read.
    seed, specifications, verify
        As for :func:`precision_pin.analyses.map.map_poses.map_poses`.

    Raises
    ------
    InputError
        No pose has joint values.
    """
    from precision_pin.analyses.map.map_poses import count_steps, map_poses
    from precision_pin.model.error_model import ErrorModel

    with progress_bar(
        count_steps(len(poses), None, verify, judged=bool(specifications)), "mapping", "steps"
    ) as progress:
        result = map_poses(
            ErrorModel.from_sheet(sheet),
            poses,
            seed=seed,
            specifications=specifications,
            verify=verify,
            progress=progress,
        )
    echo_warning_lines(result.warnings)
    return result
