"""``precision-pin view``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from precision_pin.cli.common import (
    chain_options,
    chosen_pose,
    echo_findings,
    read_sheet,
    require_writable,
)
from precision_pin.errors import InputError

__all__ = ["command"]

MOST_SHOWN = 100_000


@click.command("view")
@click.argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml]")
@click.option("--pose", metavar="NAME", help="One of the sheet's poses; the first if left out.")
@click.option("--q", metavar="VALUES", help="Joint values, as for analyze.")
@chain_options
@click.option("--samples", type=int, default=5_000, show_default=True, metavar="N", help="How many to show.")
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="64-bit seed.")
@click.option(
    "--model",
    type=click.Choice(["exact", "linear"]),
    default="exact",
    show_default=True,
    help="The displaced chain multiplied out, or superposition.",
)
@click.option("--factor", type=float, metavar="K", help="Exaggeration at first; chosen to be seen if left out.")
@click.option("--out", required=True, metavar="PAGE.html", help="The page to write.")
def command(
    inputs: tuple[str, ...],
    pose: str | None,
    q: str | None,
    tip: str | None,
    base: str | None,
    package_dirs: tuple[str, ...],
    samples: int,
    seed: int,
    model: Literal["exact", "linear"],
    factor: float | None,
    out: str,
) -> None:
    """Write one self-contained page: the arm, the nominal end-effector frame and the cloud of sampled positions.

    Without arguments: the paper's arm and sheet. The page needs no network and no server.
    """
    from precision_pin.model import ErrorModel
    from precision_pin.outputs.view import page, write_page
    from precision_pin.run import check_samples
    from precision_pin.space import check_seed

    check_samples(samples)
    check_seed(seed)
    if samples > MOST_SHOWN:
        raise InputError(f"--samples {samples} is more than a page can show; at most {MOST_SHOWN}")
    target = Path(out)
    require_writable(target)
    sheet = read_sheet(inputs, tip, base, package_dirs)
    error_model = ErrorModel.from_sheet(sheet)
    where = chosen_pose(sheet, pose, q)
    at = error_model.at(where)
    echo_findings((*at.findings(model), *error_model.statics_findings(at)))
    x = at.space.sample(seed, 0, samples)
    errors = at.linear(x) if model == "linear" else at.exact(x)
    html = page(
        at,
        errors,
        title=f"{sheet.chain.robot.name}: {sheet.chain.base} to {sheet.chain.tip}",
        seed=seed,
        model_name=model,
        factor=factor,
        pose_name=error_model.pose_name(where),
        package_dirs=package_dirs,
        points=samples,
    )
    write_page(target, html)
    click.echo(f"wrote {target} ({len(html.encode()) / 1e6:.1f} MB)", err=True)
