"""``precision-pin allocate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from precision_pin.base.files import whole_folder, write_text
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.headings import output_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warnings, quiet_option
from precision_pin.cli.options import (
    ChainOptions,
    Command,
    beyond_limits_option,
    chain_options,
    inputs_argument,
    seed_option,
)
from precision_pin.cli.progress import progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table

if TYPE_CHECKING:
    from precision_pin.analyses.allocation.allocation_result import AllocationResult
    from precision_pin.model.error_model import ErrorModel


class _Options(ChainOptions):
    """All options."""

    seed: int
    seconds: float
    pareto: int
    for_samples: int
    json_path: str | None
    out: str | None


@click.command("allocate", cls=Command)
@inputs_argument
@chain_options
@seed_option
@beyond_limits_option
@click.option(
    "--seconds",
    metavar="S",
    type=float,
    default=60.0,
    show_default=True,
    help="Time for the choice of grades; then the best found counts, with its gap.",
)
@click.option(
    "--pareto",
    metavar="N",
    type=int,
    default=0,
    help="Find N points of the front of cost against accuracy: all limits wider or narrower by a factor.",
)
@click.option(
    "--for-samples",
    metavar="N",
    type=int,
    default=100_000,
    show_default=True,
    help="Keep a margin that N samples of analyze will show; 0 for none.",
)
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write the sheet with the chosen tolerances, a plot and the result there.")
@all_warnings_option
@quiet_option
def command(**options: Unpack[_Options]) -> int:
    """Choose the cheapest tolerances that keep specifications at every pose.

    The sheet's allocate: says which tolerances, what they cost and what must be kept. The exit code is 1 where a limit is not
    met.
    """
    from precision_pin.analyses.allocation.allocate import allocate, allocation_steps
    from precision_pin.analyses.allocation.problem import read_problem
    from precision_pin.analyses.allocation.table import allocation_table
    from precision_pin.draws.space import check_seed
    from precision_pin.model.error_model import ErrorModel

    check_seed(options["seed"])
    outputs = Outputs({"--json": options["json_path"]}, options["out"], ("allocation.*", "allocated.errors.yaml"))
    outputs.check()
    sheet = read_sheet(options, outputs)
    model = ErrorModel.from_sheet(sheet)
    steps = allocation_steps(read_problem(model, None), max(options["pareto"], 0))
    with progress_bar(steps, "allocating", "steps") as progress:
        result = allocate(
            model,
            seed=options["seed"],
            seconds=options["seconds"],
            pareto=options["pareto"],
            for_samples=options["for_samples"],
            findings=sheet.findings,
            progress=progress,
        )
    echo_warnings(result.findings[len(sheet.findings) :])
    if options["json_path"] == "-":
        echo_data(result.to_json())
    else:
        echo_table(allocation_table(result))
    _write(model, result, options)
    return 0 if result.met else EXIT_SPEC


def _write(model: ErrorModel, result: AllocationResult, options: _Options) -> None:
    """Write the files that are asked for; a sheet only where tolerances keep the limits.

    Raises
    ------
    OutputError
        Something cannot be written.
    """
    json_path, out = options["json_path"], options["out"]
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is None:
        return
    from precision_pin.analyses.allocation.figure import figure
    from precision_pin.analyses.allocation.sheet import allocated_sheet
    from precision_pin.sampling.figures import save

    with whole_folder(Path(out)) as stage:
        write_text(stage / "allocation.json", result.to_json() + "\n")
        save(figure(result), stage / "allocation")
        if result.feasible:
            write_text(stage / "allocated.errors.yaml", allocated_sheet(model, result, Path(out)))
    sheet = ", allocated.errors.yaml" if result.feasible else ""
    echo_note(f"wrote {out}: allocation.json, allocation as PNG and SVG{sheet}")
    if not result.feasible:
        echo_note("no sheet is written: no tolerances within their bounds keep the limits")
