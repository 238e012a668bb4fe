"""``precision-pin budget``."""

from __future__ import annotations

from typing import Unpack

import click

from precision_pin.cli.analysis_command import Shared, answer, ask, question_options
from precision_pin.cli.common import Command
from precision_pin.cli.progress import compile_sampler, progress_bar

__all__ = ["command"]


@click.command("budget", cls=Command)
@question_options
@click.option(
    "--samples", type=int, default=16_384, show_default=True, metavar="N", help="Points a set: 32 × a power of two."
)
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    metavar="QUANTITY",
    help="position, attitude (the default: both), position.norm, position.x, …; repeats.",
)
def command(samples: int, quantities: tuple[str, ...], **shared: Unpack[Shared]) -> None:
    """Show which draw, source and joint causes how much of the spread, and what a halved tolerance would change.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin.analyses.budget.budget import budget, check_points, check_quantities, evaluations
    from precision_pin.analyses.budget.budget_result import VECTORS
    from precision_pin.outputs.budget.figure import figure
    from precision_pin.outputs.budget.table import table

    check_points(samples)
    check_quantities(quantities)
    question = ask(shared, "budget")
    compile_sampler(question.model.space)
    total = len(question.poses) * evaluations(question.model.space, samples)
    with progress_bar(total, "sampling", "robots") as progress:
        result = budget(question.model, question.poses, seed=shared["seed"], samples=samples, progress=progress)
    warnings = dict.fromkeys(line for pose in result.poses for line in pose.warnings)
    answer(
        shared,
        result,
        "budget",
        lambda: table(result, quantities or VECTORS),
        lambda pose: figure(result, pose),
        warnings,
    )
