"""``precision-pin worst-case``."""

from __future__ import annotations

from typing import Unpack

import click

from precision_pin.cli.analysis_command import Shared, answer, ask, question_options
from precision_pin.cli.common import Command
from precision_pin.cli.progress import compile_sampler, progress_bar

__all__ = ["command"]


@click.command("worst-case", cls=Command)
@question_options
@click.option("--k", type=float, default=3.0, show_default=True, help="Cut unbounded laws at k standard deviations.")
@click.option("--samples", type=int, default=100_000, show_default=True, metavar="N", help="Samples shown beside it.")
def command(k: float, samples: int, **shared: Unpack[Shared]) -> None:
    """Bound the pose error if every tolerance does its worst at once.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin.analyses.worst_case.worst_case import worst_case
    from precision_pin.outputs.worst_case.figure import figure
    from precision_pin.outputs.worst_case.table import table
    from precision_pin.sampling import check_samples

    check_samples(samples)
    question = ask(shared, "worst-case")
    known = question.sheet.findings
    compile_sampler(question.model.space)
    with progress_bar(samples * len(question.poses), "sampling") as progress:
        result = worst_case(
            question.model,
            question.poses,
            seed=shared["seed"],
            samples=samples,
            k=k,
            findings=known,
            progress=progress,
        )
    new = result.warnings[len(known) :]
    answer(shared, result, "worst-case", lambda: table(result), lambda pose: figure(result, pose), new)
