"""``precision-pin reliability``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.common import (
    chain_options,
    chosen_pose,
    echo_data,
    echo_findings,
    find_inputs,
    progress_bar,
    require_writable,
    whole_folder,
    write_text,
)

if TYPE_CHECKING:
    from precision_pin.analyses.reliability_result import ReliabilityResult

__all__ = ["command"]


@click.command("reliability")
@click.argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml]")
@click.option("--pose", "pose_names", multiple=True, metavar="NAME", help="One of the sheet's poses; repeats.")
@click.option("--q", metavar="VALUES", help='Joint values: "-90 3 88 -91 deg", "0.1 m, 10 deg" or "joint1: 10 deg, …".')
@chain_options
@click.option(
    "--spec", "specs", multiple=True, required=True, metavar='"0.5 mm @ 99.73 %"', help="A limit to keep; repeats."
)
@click.option("--samples", type=int, default=100_000, show_default=True, metavar="N", help="Plain samples.")
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="64-bit seed.")
@click.option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@click.option("--out", metavar="DIR", help="Write a plot of each pose (PNG and SVG) and the result there.")
def command(
    inputs: tuple[str, ...],
    pose_names: tuple[str, ...],
    q: str | None,
    tip: str | None,
    base: str | None,
    package_dirs: tuple[str, ...],
    specs: tuple[str, ...],
    samples: int,
    seed: int,
    json_path: str | None,
    out: str | None,
) -> int:
    """Estimate how probable it is that the error exceeds a limit, down to one in ten million and below.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin import kernel
    from precision_pin.analyses.reliability import reliability
    from precision_pin.model import ErrorModel
    from precision_pin.outputs.reliability_report import table
    from precision_pin.run import check_samples
    from precision_pin.sheet import Overrides, read
    from precision_pin.space import check_seed
    from precision_pin.specifications import specification

    check_samples(samples)
    check_seed(seed)
    specifications = [specification(text) for text in specs]
    if json_path is not None and json_path != "-":
        require_writable(Path(json_path))
    if out is not None:
        if not out:
            raise click.UsageError("--out names no folder")
        require_writable(Path(out), folder=True)
    found = find_inputs(inputs, sheet_needed=True)
    assert found.sheet is not None
    sheet = read(found.sheet, overrides=Overrides(found.robot, tip, base, package_dirs))
    echo_findings(sheet.findings)
    error_model = ErrorModel.from_sheet(sheet)
    poses = [chosen_pose(sheet, name, q) for name in pose_names or (None,)]
    if not kernel.is_compiled():
        click.echo("compiling the sampler, once on this machine: about 10 s", err=True)
        kernel.warm_up()
    with progress_bar(samples * len(poses), "sampling") as progress:
        result = reliability(
            error_model, specifications, poses, seed=seed, samples=samples, findings=sheet.findings, progress=progress
        )
    for line in result.warnings[len(sheet.findings) :]:
        click.echo(line, err=True)
    echo_data(result.to_json() if json_path == "-" else table(result))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is not None:
        _write_folder(result, Path(out))
        click.echo(f"wrote {out}: reliability.json, and the methods as PNG and SVG", err=True)
    return 0 if result.met else EXIT_SPEC


def _write_folder(result: ReliabilityResult, folder: Path) -> None:
    from precision_pin.outputs import plots
    from precision_pin.outputs.reliability_report import figure

    with whole_folder(folder) as stage:
        write_text(stage / "reliability.json", result.to_json() + "\n")
        for which in range(len(result.poses)):
            name = "reliability" if len(result.poses) == 1 else f"reliability-{which + 1}"
            plots.save(figure(result, which), stage / name)
