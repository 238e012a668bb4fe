"""Comparison of several error models on the same robots."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from precision_pin.analyses.declaration import DECIDE, SAMPLING, Asked, Declaration, Job, Option, WrongUsageError

_MOST_POSES: Final = 50  # every sheet is sampled at each of them


def name_sheets(options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the sheets by the shortest distinct names; a single one is compared with itself changed by ``--set``."""
    from precision_pin.analyses.compare.compare import MOST_MODELS
    from precision_pin.robot.examples import PAPER_SHEET

    sheets = options["sheets"]
    if len(sheets) < 2 and not options["changes"]:
        raise WrongUsageError("two sheets are needed, A.yaml B.yaml; or one and what --set changes in it")
    if len(sheets) > MOST_MODELS:
        raise WrongUsageError(f"{len(sheets)} sheets; at most {MOST_MODELS} can be compared")
    if len(sheets) < 2:
        name = Path(sheets[0]).name if sheets else PAPER_SHEET.name
        return {name: {"inputs": sheets, "changes": ()}, f"{name} --set": {"inputs": sheets}}
    names = [Path(text).name for text in sheets]
    names = names if len(set(names)) == len(names) else list(sheets)
    if len(set(names)) < len(names):
        raise WrongUsageError(f"{next(name for name in names if names.count(name) > 1)} is given twice")
    return {name: {"inputs": (text,)} for name, text in zip(names, sheets, strict=True)}


def prepare(request: Asked) -> Job:
    """Return the comparison of the sheets of a command line."""
    from precision_pin.analyses.compare.compare import compare, count_steps
    from precision_pin.model.error_model import ErrorModel

    options = request.options
    sheet_poses = request.read_poses(_MOST_POSES)
    poses = [pose.where for pose in sheet_poses]
    models = {name: ErrorModel.from_sheet(sheet_poses.noted_in(sheet)) for name, sheet in request.sheets.items()}
    run = partial(
        compare, models, poses, samples=options["samples"], seed=options["seed"], model=options["model"],
        specifications=options["specs"],
        findings=tuple(dict.fromkeys(finding for sheet in request.sheets.values() for finding in sheet.findings)),
    )  # fmt: skip
    return Job(
        run,
        tuple(models.values()),
        count_steps(len(models), len(poses), max(options["samples"], 0)),
        is_unwound=True,
        stem="comparison",
        is_met=lambda result: all(map(result.met, result.names)),
    )


DECLARATION = Declaration(
    name="compare",
    function=f"{__name__}.compare:compare",
    result=f"{__name__}.compare:ComparisonResult",
    title="Comparison",
    heading="",
    summary="Compare sheets with the same robots: laws, verdicts, causes, and what differs in the sheets.",
    description="""Compare sheets side by side, with the same robots: laws, verdicts, causes, and what differs in the sheets.

    Draws of the same names have the same random numbers in all of them, so that a difference is one of the sheets. Poses are
    those of the first. A single sheet with --set is compared with itself unchanged; with several sheets --set changes all of
    them. The exit code is 1 if any of them misses a specification.

    Example: precision-pin compare A.yaml B.yaml --spec "1 mm"
    """,
    options=(
        *("poses", "target", "chain"),
        Option("--samples", "samples", "Number of robots.", int, 100_000, "N", group=SAMPLING),
        *("seed", "model", "spec", "json", "plot", "messages"),
    ),
    group=DECIDE,
    prepare=prepare,
    sheets=name_sheets,
    arguments=("sheets", "A.yaml [B.yaml …]"),
    files=("comparison.*",),
    table_name="compare:comparison_table",
)
