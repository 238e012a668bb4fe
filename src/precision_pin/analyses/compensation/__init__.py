"""Compensation of the constant part of the pose error by corrected joint values."""

from functools import partial
from pathlib import Path
from typing import Any

from precision_pin.analyses.declaration import DECIDE, OUTPUT, Asked, Declaration, Files, Job, Option, PagePart
from precision_pin.base.errors import InputError, some

_MOST_NAMED = 10  # poses without a correction named in a note


def prepare(request: Asked) -> Job:
    """Return the compensation of a command line; those of corrected poses are written."""
    from precision_pin.analyses.compensation.compensate import compensate
    from precision_pin.analyses.compensation.table import corrected_csv, uncorrected_poses
    from precision_pin.base.files import write_text
    from precision_pin.model.error_model import ErrorModel

    options, poses = request.options, request.read_pose_set()

    def write(result: Any) -> tuple[str, ...]:
        missing, is_asked = uncorrected_poses(result), options["csv_path"] is not None or options["out"] is not None
        if options["csv_path"] is not None and len(missing) < len(poses):
            write_text(Path(options["csv_path"]), corrected_csv(result, poses.columns))
        end = "" if len(missing) < len(poses) else "; they are not written"
        count = f"{len(missing):,} of {len(poses):,} poses: {some(missing, _MOST_NAMED)}"
        return (f"the corrected joint values lack {count}{end}",) * bool(missing and is_asked)

    def files(result: Any) -> Files:
        from precision_pin.analyses.compensation.figure import figure

        is_any = "corrected" in result.correction.status
        texts = {"corrected.csv": corrected_csv(result, poses.columns)} if is_any else {}
        return Files({"compensation": figure(result)}, texts)

    return Job(
        partial(
            compensate, ErrorModel.from_sheet(request.sheet), poses, mode=options["mode"], weights=options["weights"],
            findings=request.sheet.findings,
        ),
        steps=len(poses), what="correcting", unit="poses", stem="compensation", files=files, write=write,
        is_met=lambda result: result.is_complete,
    )  # fmt: skip


def _weights(text: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 6:
        message = f'--weights: six numbers are expected, such as "1 1 1 0.1 0.1 0.1", got {text!r}'
        raise InputError.of("E_USAGE", message)
    return numbers


DECLARATION = Declaration(
    name="compensate",
    function=f"{__name__}.compensate:compensate",
    result=f"{__name__}.compensate:CompensationResult",
    title="Compensation",
    heading="",
    summary="Correct the constant part of the pose error by other joint values.",
    description="""Correct the constant part of the pose error by other joint values.

    The constant part is the error with every component at its mean: deflection, offsets, what a calibration has found. The
    joint values are found by Newton's method on the arm with its errors. The exit code is 1 where a pose has no correction.

    Example: precision-pin compensate example:ur5 --all-poses --csv q.csv
    """,
    options=(
        Option(
            "--mode", "mode", "Correct the position, or position and attitude.", default="position",
            choices=("position", "pose"),
        ),
        Option(
            "--weights", "weights",
            "With --mode pose: weights of the components, 1/m and 1/rad; the weighted squares are made smallest.",
            metavar='"X Y Z RX RY RZ"', read=_weights,
        ),
        *("poses", "target", "chain"),
        Option(
            "--csv", "csv_path", "Write the corrected joint values there, with the input's columns.", kind=Path, metavar="FILE",
            group=OUTPUT,
        ),
        "json",
        Option(
            "--out", "out", "Write a plot (PNG and SVG), the corrected joint values and the result there.",
            kind=Path, metavar="DIR",
            group=OUTPUT,
        ),
        "messages",
    ),
    group=DECIDE,
    prepare=prepare,
    writes=("csv_path", "json_path"),
    files=("compensation.*", "corrected.csv"),
    is_sampled=False,
    table_name="compensation_table",
    part=PagePart(
        Option(
            "--compensate", "compensate_file",
            "Correct the poses of a file as for --trajectory or --grid in position; show the arm before and after.",
            kind=Path, metavar="FILE",
        ),
        place=30, chapter="figure:compensation_chapter", layer="figure:CompensationLayer", poses="path",
    ),
)  # fmt: skip
