"""``precision-pin path``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Unpack

import click
from click.core import ParameterSource

from precision_pin.base.errors import Finding, InputError, UnitError
from precision_pin.base.files import whole_folder, write_text
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
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
    model_option,
    pose_options,
    seed_option,
    spec_option,
    target_option,
)
from precision_pin.cli.poses import MOST_ROWS, check_poses, pose_files, read_grid, read_pose_set
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table

if TYPE_CHECKING:
    from precision_pin.analyses.path.path_result import PathResult
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.sheet import Sheet
    from precision_pin.statistics import Specification

SAMPLES: Final = 10_000
_LONG: Final = 2 * 10**9
"""Steps of progress, robots at poses, from which the number of robots is to be chosen by the user: about ten minutes."""
_LOOKED: Final = 3.0
"""Seconds of sampling after which the time of the whole is known."""


class _Options(ChainOptions, PoseOptions):
    """All options."""

    samples: int
    seed: int
    model: Literal["exact", "linear"]
    specs: tuple[str, ...]
    probability: str
    threads: int | None
    json_path: str | None
    out: str | None


@click.command("path", cls=SamplingCommand)
@inputs_argument
@pose_options
@target_option
@chain_options
@sampling_option(
    "--samples",
    type=int,
    default=SAMPLES,
    show_default=True,
    metavar="N",
    help="Number of robots; as many again set the band of the whole path.",
)
@seed_option
@model_option
@spec_option
@click.option(
    "--probability",
    default="95 %",
    show_default=True,
    metavar='"99.73 %"',
    help="Share of the robots that the bands are made for.",
)
@sampling_option("--threads", type=int, metavar="N", help="How many threads sample; all cores if left out.")
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write a plot (PNG and SVG) and the result there.")
@all_warnings_option
@quiet_option
def command(**options: Unpack[_Options]) -> int:
    """Sample the law of the largest error along a path, the same robots at every pose.

    A specification is met if enough robots keep it at every pose. Besides, bands for the error over the path: the quantile at
    each pose, and a band that holds the whole error curve of that share of the robots or more.
    """
    from precision_pin.draws.space import check_seed
    from precision_pin.statistics.plan import specification

    check_poses(options)
    check_seed(options["seed"])
    specifications = [specification(text) for text in options["specs"]]
    probability = _probability(options["probability"])
    outputs = Outputs({"--json": options["json_path"]}, options["out"], ("path.*",))
    outputs.check()
    outputs.refuse_inputs(pose_files(options))
    sheet = read_sheet(options, outputs)
    poses = read_pose_set(sheet, options)
    # late: these take as long to import as all before, and the reading of a large file is to be seen soon
    from precision_pin.analyses.path.path_law import count_steps, path_law
    from precision_pin.analyses.path.table import path_table
    from precision_pin.model.error_model import ErrorModel

    error_model = ErrorModel.from_sheet(sheet)
    if len(poses) < 2:
        message = "a path has two poses or more: --trajectory, --grid, --all-poses, or --pose or --q repeated; analyze is for one"
        raise InputError([Finding("error", "E_POSE", message)])
    compile_sampler(error_model.space, options["model"])
    steps = count_steps(len(poses), max(options["samples"], 0))
    is_default = click.get_current_context().get_parameter_source("samples") is ParameterSource.DEFAULT
    with progress_bar(steps, "sampling") as progress, unwinding():
        result = path_law(
            error_model,
            poses,
            samples=options["samples"],
            seed=options["seed"],
            probability=probability,
            model=options["model"],
            specifications=specifications,
            findings=sheet.findings,
            threads=options["threads"],
            progress=_refusing(progress, len(poses)) if is_default and steps > _LONG else progress,
        )
        raise_if_interrupted()
    echo_warning_lines(result.warnings[len(sheet.findings) :])
    json_path, out = options["json_path"], options["out"]
    if json_path == "-":
        echo_data(result.to_json())
    else:
        echo_table(path_table(result))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is not None:
        from precision_pin.analyses.path.figure import figure
        from precision_pin.sampling.figures import save

        with whole_folder(Path(out)) as stage:
            write_text(stage / "path.json", result.to_json() + "\n")
            save(figure(result), stage / "path")
        echo_note(f"wrote {out}: path.json, path as PNG and SVG")
    return 0 if result.met else EXIT_SPEC


def _refusing(progress: Callable[[int], None], poses: int) -> Callable[[int], None]:
    """Return what takes the steps and, once it is known how long all of them take, refuses a run that nobody asked for."""
    began, done = 0.0, 0

    def advance(count: int) -> None:
        nonlocal began, done
        progress(count)
        if not began:  # before the first poses come many are laid out together
            began = time.monotonic()
            return
        done += count
        passed = time.monotonic() - began
        if passed < _LOOKED:
            return
        minutes = passed / 60 * 2 * poses * SAMPLES / done
        message = (
            f"{poses:,} poses with {SAMPLES:,} robots each take about {minutes:,.0f} minutes here; --samples {SAMPLES // 10} "
            f"takes about {minutes / 10:,.0f}, fewer rows take less, and --samples {SAMPLES} does it all the same"
        )
        raise InputError([Finding("error", "E_USAGE", message)])

    return advance


def _probability(text: str) -> float:
    from precision_pin.base import units

    try:
        # 95 % is 0.95 and not the next number, so that it is one of the levels of the table
        return round(units.parse_probability(text), 12)
    except UnitError as error:
        message = f"--probability {text!r}: {error.findings[0].message}"
        raise InputError([Finding("error", "E_USAGE", message)]) from None


def read_path(sheet: Sheet, file: str) -> PoseSet:
    """Return the poses of a file as for ``--trajectory`` or ``--grid``.

    Raises
    ------
    InputError
        A wrong file.
    """
    from precision_pin.robot.trajectory import read_trajectory

    is_grid = Path(file).suffix in (".yaml", ".yml")
    return read_grid(sheet, file) if is_grid else read_trajectory(file, sheet.chain, MOST_ROWS).poses


def path_of(sheet: Sheet, poses: PoseSet, seed: int, specifications: Sequence[Specification] = ()) -> PathResult:
    """Return the law along a path for a page that shows it; print its warnings."""
    from precision_pin.analyses.path.path_law import count_steps, path_law
    from precision_pin.model.error_model import ErrorModel

    with progress_bar(count_steps(len(poses), SAMPLES), "sampling the path") as progress:
        result = path_law(
            ErrorModel.from_sheet(sheet), poses, samples=SAMPLES, seed=seed, specifications=specifications,
            progress=progress,
        )  # fmt: skip
    echo_warning_lines(result.warnings)
    return result
