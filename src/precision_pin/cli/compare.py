"""``precision-pin compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack

import click

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
    model_option,
    pose_options,
    seed_option,
    spec_option,
    target_option,
)
from precision_pin.cli.poses import check_poses, pose_files, read_poses
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table
from precision_pin.robot.examples import PAPER_SHEET

if TYPE_CHECKING:
    from precision_pin.sheet import Sheet

MOST_POSES = 50


class _Options(ChainOptions, PoseOptions):
    """All options."""

    sheets: tuple[str, ...]
    samples: int
    seed: int
    model: Literal["exact", "linear"]
    specs: tuple[str, ...]
    json_path: str | None
    out: str | None


@click.command("compare", cls=SamplingCommand)
@click.argument("sheets", nargs=-1, metavar="A.yaml [B.yaml …]")
@pose_options
@target_option
@chain_options
@sampling_option("--samples", type=int, default=100_000, show_default=True, metavar="N", help="Number of robots.")
@seed_option
@model_option
@spec_option
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write a plot (PNG and SVG) and the result there.")
@all_warnings_option
@quiet_option
def command(**options: Unpack[_Options]) -> int:
    """Compare sheets side by side, with the same robots: laws, verdicts, causes, and what differs in the sheets.

    Draws of the same names have the same random numbers in all of them, so that a difference is one of the sheets. Poses are
    those of the first. A single sheet with --set is compared with itself unchanged; with several sheets --set changes all of
    them. The exit code is 1 if any of them misses a specification.
    """
    from precision_pin.analyses.compare.compare import MOST_MODELS, compare, count_steps
    from precision_pin.analyses.compare.table import comparison_table
    from precision_pin.draws.space import check_seed
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.statistics.plan import specification

    check_seed(options["seed"])
    specifications = [specification(text) for text in options["specs"]]
    check_poses(options)
    given = options["sheets"]
    if len(given) < 2 and not options["changes"]:
        raise click.UsageError("two sheets are needed, A.yaml B.yaml; or one and what --set changes in it")
    if len(given) > MOST_MODELS:
        raise click.UsageError(f"{len(given)} sheets; at most {MOST_MODELS} can be compared")
    outputs = Outputs({"--json": options["json_path"]}, options["out"], ("comparison.*",))
    outputs.check()
    outputs.refuse_inputs(pose_files(options))
    sheets = _read(options, outputs)
    first = next(iter(sheets.values()))
    poses = [pose.where for pose in read_poses(first, options, MOST_POSES)]
    models = {name: ErrorModel.from_sheet(sheet) for name, sheet in sheets.items()}
    for model in models.values():
        compile_sampler(model.space, options["model"])
    findings = tuple(dict.fromkeys(finding for sheet in sheets.values() for finding in sheet.findings))
    steps = count_steps(len(models), len(poses), max(options["samples"], 0))
    with progress_bar(steps, "sampling") as progress, unwinding():
        result = compare(
            models, poses, samples=options["samples"], seed=options["seed"], model=options["model"],
            specifications=specifications, findings=findings, progress=progress,
        )  # fmt: skip
        raise_if_interrupted()
    echo_warning_lines(result.warnings[len(dict.fromkeys(map(str, findings))) :])
    json_path, out = options["json_path"], options["out"]
    if json_path == "-":
        echo_data(result.to_json())
    else:
        echo_table(comparison_table(result))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is not None:
        from precision_pin.analyses.compare.figure import figure
        from precision_pin.sampling.figures import save

        with whole_folder(Path(out)) as stage:
            write_text(stage / "comparison.json", result.to_json() + "\n")
            save(figure(result), stage / "comparison")
        echo_note(f"wrote {out}: comparison.json, comparison as PNG and SVG")
    return 0 if all(result.met(name) for name in result.names) else EXIT_SPEC


def _read(options: _Options, outputs: Outputs) -> dict[str, Sheet]:
    """Return the sheets by the shortest names that tell them apart; a single one unchanged, then changed by ``--set``."""
    given = options["sheets"]
    if len(given) < 2:
        unchanged: _Options = {**options, "inputs": given, "changes": ()}
        changed: _Options = {**options, "inputs": given}
        name = Path(given[0]).name if given else PAPER_SHEET.name
        return {name: read_sheet(unchanged, outputs), f"{name} --set": read_sheet(changed, outputs)}
    names = [Path(text).name for text in given]
    names = names if len(set(names)) == len(names) else list(given)
    if len(set(names)) < len(names):
        raise click.UsageError(f"{next(name for name in names if names.count(name) > 1)} is given twice")
    read = {}
    for name, text in zip(names, given, strict=True):
        own: _Options = {**options, "inputs": (text,)}
        read[name] = read_sheet(own, outputs)
    return read
