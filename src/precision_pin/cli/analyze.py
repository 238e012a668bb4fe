"""``precision-pin analyze``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from precision_pin.base.files import whole_folder, write_text
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.analyze_poses import FILES as FILES_OF_POSES
from precision_pin.cli.analyze_poses import PosesJob, analyze_poses, refuse_of_one_pose
from precision_pin.cli.headings import output_option, sampling_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warning_lines, quiet_option
from precision_pin.cli.options import (
    SamplingCommand,
    chain_options,
    inputs_argument,
    model_option,
    pose_options,
    seed_option,
    spec_option,
    target_option,
)
from precision_pin.cli.poses import check_poses, pose_files, read_poses, reference_pose
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table
from precision_pin.cli.workers import check_workers, worker_options, working

if TYPE_CHECKING:
    from precision_pin.sampling.result import MonteCarloResult

FILES = ("analysis.json", "position.*", "attitude.*", "components.*")
"""Files written to a folder."""

MOST_UNTIL = 10**9
"""The most samples until a result is precise enough, where no number is given."""


@click.command("analyze", cls=SamplingCommand)
@inputs_argument
@pose_options
@target_option
@chain_options
@all_warnings_option
@quiet_option
@sampling_option(
    "--samples",
    type=int,
    metavar="N",
    help="Number of robots, 100,000 if left out; with --until the most, 1e9 if left out.",
)
@seed_option
@model_option
@spec_option
@click.option(
    "--spec-everywhere", is_flag=True, help="Of several poses: a robot is inside only if it is at all of them."
)
@click.option(
    "--relative-to",
    metavar="POSE",
    help="Subtract the same robot's errors at this pose: a name, or joint values as in --q.",
)
@click.option(
    "--until", multiple=True, metavar='"95 % to 0.01 mm"', help="Sample until this precision is reached; repeats."
)
@worker_options
@output_option(
    "--all", "is_whole", is_flag=True, help="Print min, max, mode, tolerance bounds, and of many poses every one."
)
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write plots (PNG and SVG) and the result there.")
def command(
    samples: int | None,
    seed: int,
    model: Literal["exact", "linear"],
    specs: tuple[str, ...],
    spec_everywhere: bool,
    relative_to: str | None,
    until: tuple[str, ...],
    is_whole: bool,
    json_path: str | None,
    out: str | None,
    **arm: Any,
) -> int:
    """Sample the pose error of an arm at a pose, or of the same robots at several.

    At several poses a specification is met only if it is met at every one. With --relative-to the errors are those relative to
    another pose of the same robots: taught there, worked here.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME. The result does not
    depend on what samples it: threads, processes or a cluster, at one go or resumed.
    """
    from precision_pin.analyses.monte_carlo.table import analysis_table
    from precision_pin.draws.space import check_seed
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sampling import check_samples, monte_carlo
    from precision_pin.sampling.relative import relative
    from precision_pin.statistics.plan import specification
    from precision_pin.statistics.precision import target

    samples = samples if samples is not None else MOST_UNTIL if until else 100_000
    check_samples(samples)
    for text in until:
        target(text)
    check_seed(seed)
    specifications = [specification(text) for text in specs]
    check_workers(arm)
    if spec_everywhere and not specs:
        raise click.UsageError("--spec-everywhere needs a --spec")
    check_poses(arm)
    if relative_to is not None:
        at_one = {"--until": until, **{f"--{name}": arm[name] for name in ("processes", "dask", "journal")}}
        _refuse_of_relative(
            [option for option, value in at_one.items() if value] + ["--spec-everywhere"] * spec_everywhere
        )
    may_be_several = arm["all_poses"] or pose_files(arm) or max(len(arm["pose_names"]), len(arm["qs"])) > 1
    outputs = Outputs(
        {"--journal": arm["journal"], "--json": json_path}, out, (*FILES, *(FILES_OF_POSES if may_be_several else ()))
    )
    outputs.check()
    outputs.refuse_inputs(pose_files(arm))
    sheet = read_sheet(arm, outputs)
    error_model = ErrorModel.from_sheet(sheet)
    poses = read_poses(sheet, arm)
    sheet = poses.noted_in(sheet)
    if len(poses) > 1:
        for_one = {"--until": bool(until), "--relative-to": relative_to}
        refuse_of_one_pose([option for option, value in for_one.items() if value], len(poses))
        job = PosesJob(samples, seed, model, tuple(specifications), spec_everywhere, arm, is_whole, json_path, out)
        return analyze_poses(error_model, sheet, poses, job)
    where = poses[0].where
    other = reference_pose(sheet, relative_to)
    compile_sampler(error_model.space, model)
    if other is not None:
        with progress_bar(samples, "sampling") as progress, unwinding():
            analysis = relative(
                error_model, where, other, samples=samples, seed=seed, model=model, specifications=specifications,
                findings=sheet.findings, threads=arm["threads"], progress=progress,
            )  # fmt: skip
            raise_if_interrupted()
    else:
        with working(arm) as workers, progress_bar(samples, "sampling") as progress:
            analysis = monte_carlo(
                error_model, where, samples=samples, seed=seed, model=model, specifications=specifications,
                until=until, findings=sheet.findings, files={"sheet": sheet.file}, progress=progress, **workers,
            )  # fmt: skip
    echo_warning_lines(analysis.warnings[len(sheet.findings) :])
    if json_path == "-":
        echo_data(analysis.to_json())
    else:
        echo_table(analysis_table(analysis, is_whole=is_whole), is_answered=True)
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), analysis.to_json() + "\n")
    if out is not None:
        _write_folder(analysis, Path(out))
        echo_note(f"wrote {out}: analysis.json, position, attitude and components as PNG and SVG")
    return 0 if all(result.met for result in analysis.summary.specifications) else EXIT_SPEC


def _refuse_of_relative(options: list[str]) -> None:
    """Refuse options that the relative error does not take."""
    if options:
        raise click.UsageError(f"{options[0]} and --relative-to exclude each other; leave one of them out")


def _write_folder(analysis: MonteCarloResult, folder: Path) -> None:
    from precision_pin.sampling import figures

    with whole_folder(folder) as stage:
        write_text(stage / "analysis.json", analysis.to_json() + "\n")
        for name, figure in figures.figures_of(analysis.summary, analysis.seed, analysis.arm).items():
            figures.save(figure, stage / name)
