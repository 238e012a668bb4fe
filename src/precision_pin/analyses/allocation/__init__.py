"""Allocation of tolerances: the cheapest ones that keep limits of the pose error."""

from functools import partial
from pathlib import Path
from typing import Any

from precision_pin.analyses.declaration import DECIDE, OUTPUT, Asked, Declaration, Files, Job, Option, PagePart


def prepare(request: Asked) -> Job:
    """Return the allocation of a command line's sheet; the new sheet is written if the limits can be kept."""
    from precision_pin.analyses.allocation.allocate import allocate, allocation_steps
    from precision_pin.analyses.allocation.problem import read_problem
    from precision_pin.model.error_model import ErrorModel

    options = request.options
    model = ErrorModel.from_sheet(request.sheet)
    arguments = {name: options[name] for name in ("seed", "seconds", "pareto", "for_samples")}

    def write(result: Any) -> tuple[str, ...]:
        is_missed = options["out"] is not None and not result.feasible
        return ("no sheet is written: no tolerances within their bounds keep the limits",) * is_missed

    def files(result: Any) -> Files:
        from precision_pin.analyses.allocation.allocate import allocated_sheet
        from precision_pin.analyses.allocation.figure import figure

        sheets = {}
        if result.feasible:
            sheets = {"allocated.errors.yaml": allocated_sheet(model, result, Path(options["out"]))}
        return Files({"allocation": figure(result)}, sheets)

    return Job(
        partial(allocate, model, findings=request.sheet.findings, **arguments),
        steps=allocation_steps(read_problem(model, None), max(options["pareto"], 0)),
        what="allocating", unit="steps", stem="allocation", files=files, write=write,
        findings=request.sheet.findings,
    )  # fmt: skip


DECLARATION = Declaration(
    name="allocate",
    function=f"{__name__}.allocate:allocate",
    result=f"{__name__}.allocate:AllocationResult",
    title="Allocation",
    heading="",
    summary="Choose the cheapest tolerances that keep specifications at every pose.",
    description="""Choose the cheapest tolerances that keep specifications at every pose.

    The sheet's allocate: says which tolerances, what they cost and what must be kept. The exit code is 1 where a limit is not
    met.

    Example: precision-pin allocate SHEET.yaml --out cheaper
    """,
    options=(
        *("chain", "datum", "seed", "beyond"),
        Option(
            "--seconds", "seconds", "Time for the choice of grades; then the best found counts, with its gap.", float,
            60.0, "S",
        ),
        Option(
            "--pareto", "pareto",
            "Find N points of the front of cost against accuracy: all limits wider or narrower by a factor.", int, 0, "N",
            is_default_shown=False,
        ),
        Option(
            "--for-samples", "for_samples", "Keep a margin that N samples of analyze will show; 0 for none.", int, 100_000, "N"
        ),
        "json",
        Option(
            "--out", "out", "Write the sheet with the chosen tolerances, a plot and the result there.",
            kind=Path, metavar="DIR",
            group=OUTPUT,
        ),
        "messages",
    ),
    group=DECIDE,
    prepare=prepare,
    files=("allocation.*", "allocated.errors.yaml"),
    is_sampled=False,
    table_name="allocation_table",
    part=PagePart(
        Option("--allocate", "is_allocated", "Choose the tolerances that the sheet's allocate: asks for.", bool),
        place=60, chapter="figure:allocation_chapter", settings=lambda _: {"pareto": 7}, missed="by the allocation",
    ),
    keys={"allocate": "What precision-pin allocate solves: tolerances with their costs, specs, poses."},
    check_sheet="problem:sheet_findings",
)  # fmt: skip
