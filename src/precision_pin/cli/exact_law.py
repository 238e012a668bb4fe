"""``precision-pin exact-law``."""

from __future__ import annotations

from typing import Unpack

import click

from precision_pin.cli.analysis_command import Shared, answer, ask, question_options
from precision_pin.cli.common import Command
from precision_pin.cli.progress import compile_sampler, progress_bar

__all__ = ["command"]


@click.command("exact-law", cls=Command)
@question_options
@click.option("--samples", type=int, default=100_000, show_default=True, metavar="N", help="Samples to compare with.")
def command(samples: int, **shared: Unpack[Shared]) -> None:
    """Compute the law of every component of the first-order error, tails included, without sampling.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin.analyses.exact_law.exact_law import exact_law
    from precision_pin.outputs.exact_law.figure import figure
    from precision_pin.outputs.exact_law.table import table

    question = ask(shared, "exact-law")
    compile_sampler(question.model.space)
    with progress_bar(max(samples, 0) * (1 + len(question.poses)), "sampling") as progress:
        result = exact_law(question.model, question.poses, seed=shared["seed"], samples=samples, progress=progress)
    answer(shared, result, "exact-law", lambda: table(result), lambda pose: figure(result, pose))
