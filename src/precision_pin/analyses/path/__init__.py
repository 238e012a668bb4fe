"""Law of the largest error along a path, and bands about the whole error curve."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from precision_pin.analyses.declaration import SAMPLING, Asked, Declaration, Job, Option, PagePart
from precision_pin.base.errors import InputError, UnitError

SAMPLES: Final = 10_000
# progress steps (robots at poses), about ten minutes, above which the user must choose the number of robots
_LONG: Final = 2 * 10**9
# seconds of sampling after which the total time can be predicted
_LOOKED: Final = 3.0


def prepare(request: Asked) -> Job:
    """Return the law along the path of a command line."""
    poses, options = request.read_pose_set(), request.options
    # imported late: these take as long as all other imports, and reading a large file should start early
    from precision_pin.analyses.path.path_law import path_law
    from precision_pin.model.error_model import ErrorModel

    model = ErrorModel.from_sheet(request.sheet)
    if len(poses) < 2:
        message = "a path has two poses or more: --trajectory, --grid, --all-poses, or --pose or --q repeated; analyze is for one"
        raise InputError.of("E_POSE", message)
    names = ("samples", "seed", "probability", "model", "threads")
    law = partial(
        path_law, model, poses, **{name: options[name] for name in names}, specifications=options["specs"],
        findings=request.sheet.findings,
    )  # fmt: skip
    steps = 2 * len(poses) * max(options["samples"], 0)

    def run(progress: Callable[[int], None]) -> Any:
        is_refused = "samples" not in request.chosen and steps > _LONG
        return law(progress=_check_duration(progress, len(poses)) if is_refused else progress)

    return Job(run, (model,), steps, is_unwound=True)


def _check_duration(progress: Callable[[int], None], poses: int) -> Callable[[int], None]:
    """Return a progress function that refuses a long run with a default number of robots once its time is known."""
    began, done = 0.0, 0

    def advance(count: int) -> None:
        nonlocal began, done
        progress(count)
        if not began:  # before the first poses come many are laid out together
            began = time.monotonic()
            return
        done += count
        passed = time.monotonic() - began
        if passed < _LOOKED:
            return
        minutes = passed / 60 * 2 * poses * SAMPLES / done
        message = (
            f"{poses:,} poses with {SAMPLES:,} robots each take about {minutes:,.0f} minutes here; --samples {SAMPLES // 10} "
            f"takes about {minutes / 10:,.0f}, fewer rows take less, and --samples {SAMPLES} does it all the same"
        )
        raise InputError.of("E_USAGE", message)

    return advance


def _probability(text: str) -> float:
    from precision_pin.base import units

    try:
        # 95 % is 0.95 and not the next number, so that it is one of the levels of the table
        return round(units.parse_probability(text), 12)
    except UnitError as error:
        message = f"--probability {text!r}: {error.findings[0].message}"
        raise InputError.of("E_USAGE", message) from None


DECLARATION = Declaration(
    name="path",
    function=f"{__name__}.path_law:path_law",
    result=f"{__name__}.path_law:PathResult",
    title="Path",
    heading="",
    summary="Sample the law of the largest error along a path, with bands that hold whole error curves.",
    description="""Sample the law of the largest error along a path, the same robots at every pose.

    A specification is met if enough robots keep it at every pose. Besides, bands for the error over the path: the quantile at
    each pose, and a band that holds the whole error curve of that share of the robots or more.

    Example: precision-pin path example:ur5 --all-poses --spec "5 mm"
    """,
    options=(
        *("poses", "target", "chain"),
        Option(
            "--samples", "samples", "Number of robots; as many again set the band of the whole path.", int, SAMPLES, "N",
            group=SAMPLING,
        ),
        *("seed", "model", "spec"),
        Option(
            "--probability", "probability", "Share of the robots that the bands are made for.", default="95 %",
            metavar='"99.73 %"', read=_probability,
        ),
        Option(
            "--threads", "threads", "How many threads sample; all cores if left out.", int, metavar="N", group=SAMPLING
        ),
        *("json", "plot", "messages"),
    ),
    prepare=prepare,
    files=("path.*",),
    table_name="path_table",
    part=PagePart(
        Option(
            "--path", "path_file",
            "Show a path, a file as for --trajectory or --grid: what 95 % of robots keep at its points and all along it.",
            kind=Path, metavar="FILE",
        ),
        place=20, chapter="figure:path_chapter", layer="figure:PathLayer", poses="path", what="sampling the path",
        missed="along the path",
    ),
)  # fmt: skip
