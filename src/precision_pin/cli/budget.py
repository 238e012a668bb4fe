"""``precision-pin budget``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from precision_pin.cli.common import (
    chain_options,
    chosen_pose,
    echo_data,
    echo_findings,
    find_inputs,
    require_writable,
    whole_folder,
    write_text,
)
from precision_pin.errors import Finding, InputError

if TYPE_CHECKING:
    from precision_pin.analyses.budget_result import BudgetResult

__all__ = ["command"]


@click.command("budget")
@click.argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml]")
@click.option("--pose", "names", multiple=True, metavar="NAME", help="One of the sheet's poses; repeats.")
@click.option("--q", metavar="VALUES", help="Joint values, as for analyze.")
@chain_options
@click.option(
    "--samples", type=int, default=16_384, show_default=True, metavar="N", help="Points a set: 16 × a power of two."
)
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="64-bit seed.")
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    metavar="QUANTITY",
    help="position, attitude (the default: both), position.norm, position.x, …; repeats.",
)
@click.option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@click.option("--out", metavar="DIR", help="Write bar charts (PNG and SVG) and the result there.")
def command(
    inputs: tuple[str, ...],
    names: tuple[str, ...],
    q: str | None,
    tip: str | None,
    base: str | None,
    package_dirs: tuple[str, ...],
    samples: int,
    seed: int,
    quantities: tuple[str, ...],
    json_path: str | None,
    out: str | None,
) -> None:
    """Show which draw, source and joint causes how much of the spread, and what a halved tolerance would change.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin import kernel
    from precision_pin.analyses.budget import budget, check_points, check_quantities
    from precision_pin.analyses.budget_result import VECTORS
    from precision_pin.model import ErrorModel
    from precision_pin.sheet import Overrides, read
    from precision_pin.space import check_seed

    check_points(samples)
    check_seed(seed)
    check_quantities(quantities)
    if names and q is not None:
        raise InputError([Finding("error", "E_USAGE", "--pose and --q exclude each other")])
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
    poses = list(names) or chosen_pose(sheet, None, q)
    if not kernel.is_compiled():
        click.echo("compiling the sampler, once on this machine: about 10 s", err=True)
        kernel.warm_up()
    result = budget(error_model, poses, seed=seed, samples=samples)
    for line in dict.fromkeys(line for pose in result.poses for line in pose.warnings):
        click.echo(line, err=True)
    if json_path == "-":
        echo_data(result.to_json())
    else:
        from precision_pin.outputs.budget_report import table

        echo_data(table(result, quantities or VECTORS))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is not None:
        files = _write_folder(result, Path(out))
        click.echo(f"wrote {out}: budget.json, {', '.join(files)} as PNG and SVG", err=True)


def _write_folder(result: BudgetResult, folder: Path) -> list[str]:
    from precision_pin.outputs import plots
    from precision_pin.outputs.budget_report import figure

    several = len(result.poses) > 1
    files = [f"budget-{k + 1}" if several else "budget" for k in range(len(result.poses))]
    with whole_folder(folder) as stage:
        write_text(stage / "budget.json", result.to_json() + "\n")
        for k, name in enumerate(files):
            plots.save(figure(result, k), stage / name)
    return files
