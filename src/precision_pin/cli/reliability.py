"""``precision-pin reliability``."""

from __future__ import annotations

from typing import Unpack

import click

from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.analysis_command import Shared, answer, ask, question_options
from precision_pin.cli.common import Command
from precision_pin.cli.progress import compile_sampler, progress_bar

__all__ = ["command"]


@click.command("reliability", cls=Command)
@question_options
@click.option(
    "--spec", "specs", multiple=True, required=True, metavar='"0.5 mm @ 99.73 %"', help="A limit to keep; repeats."
)
@click.option("--samples", type=int, default=100_000, show_default=True, metavar="N", help="Plain samples.")
def command(specs: tuple[str, ...], samples: int, **shared: Unpack[Shared]) -> int:
    """Estimate how probable it is that the error exceeds a limit, down to one in ten million and below.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME.
    """
    from precision_pin.analyses.reliability.reliability import reliability
    from precision_pin.outputs.reliability.figure import figure
    from precision_pin.outputs.reliability.table import table
    from precision_pin.sampling import check_samples
    from precision_pin.statistics.specification import specification

    check_samples(samples)
    specifications = [specification(text) for text in specs]
    question = ask(shared, "reliability")
    known = question.sheet.findings
    compile_sampler(question.model.space)
    with progress_bar(samples * len(question.poses), "sampling") as progress:
        result = reliability(
            question.model,
            specifications,
            question.poses,
            seed=shared["seed"],
            samples=samples,
            findings=known,
            progress=progress,
        )
    new = result.warnings[len(known) :]
    answer(shared, result, "reliability", lambda: table(result), lambda pose: figure(result, pose), new)
    return 0 if result.met else EXIT_SPEC
