"""Figures of ISO 9283:1998 from measured cycles, and their law over built robots and tests."""

from functools import partial
from pathlib import Path
from typing import Any

from precision_pin.analyses.declaration import (
    INPUTS,
    MEASURE,
    OUTPUT,
    ROBOT,
    Asked,
    Declaration,
    Job,
    Option,
    PagePart,
    reader,
)
from precision_pin.base.errors import InputError

# poses P1 to P5 of the standard in the cube
_IN_CUBE = 5


def check(options: dict[str, Any]) -> None:
    """Reject poses together with the cube."""
    flags = {"--pose": "pose_names", "--q": "qs"}
    flags |= {f"--{name.replace('_', '-')}": name for name in ("all_poses", "trajectory", "grid")}
    pose_flags = [flag for flag, name in flags.items() if options[name]]
    if options["cube"] and pose_flags:
        raise InputError.of("E_USAGE", f"--cube and {pose_flags[0]} exclude each other")


def prepare(request: Asked) -> Job:
    """Return the forecast of a test, compared with measured cycles if there are any."""
    from precision_pin.analyses.iso9283.figures import read_cycles
    from precision_pin.analyses.iso9283.forecast import CYCLES, iso9283
    from precision_pin.analyses.iso9283.result import pose_names
    from precision_pin.base.csv_columns import columns_for
    from precision_pin.model.error_model import ErrorModel

    options, cycles, attained = request.options, request.options["cycles"], None
    model = ErrorModel.from_sheet(request.sheet)
    poses = None if options["cube"] else request.read_pose_set()
    if options["measured"] is not None:
        names = tuple(f"P{rank}" for rank in range(1, _IN_CUBE + 1)) if poses is None else poses.names
        usual = [measurement.columns for measurement in request.sheet.measurements]
        columns = columns_for(options["measured"], options["columns"], options["tables"], usual)
        attained = read_cycles(options["measured"], pose_names(names), columns)
    if cycles is None:
        cycles = CYCLES if attained is None else len(next(iter(attained.values())))
    names_of = ("robots", "seed", "fit_base", "specifications")
    forecast = partial(
        iso9283, model, poses, cycles=cycles, target=options["measured_point"], load=options["load"] or 0.0,
        findings=request.sheet.findings, **{name: options[name] for name in names_of},
    )  # fmt: skip

    def run(progress: Any) -> Any:
        result = forecast(progress=progress)
        return result if attained is None else result.compare(attained)

    return Job(
        run,
        (model,),
        options["robots"] * (_IN_CUBE if poses is None else len(poses)) * cycles,
        what="testing",
        unit="visits",
        is_unwound=True,
        note="searching the largest reachable cube: up to a minute" if options["cube"] else "",
    )


DECLARATION = Declaration(
    name="iso9283",
    function=f"{__name__}.forecast:iso9283",
    result=f"{__name__}.result:Iso9283Result",
    title="ISO 9283",
    heading="",
    summary="Forecast accuracy and repeatability as ISO 9283 measures them; compare with measured cycles.",
    description=f"""Forecast accuracy and repeatability as ISO 9283 measures them, over built robots and over tests.

    The poses P1, P2, … are those given, in their order, or with --cube the standard's five. AD and RD are between
    P2 and P4. With measured cycles of a robot, its figures are compared with the forecast by a test.

    {INPUTS}
    """,
    options=(
        *("poses", "chain", "datum", "messages"),
        Option("--cube", "cube", "The standard's five poses in the largest cube within reach, tool as at the first pose.", bool),
        Option("--robots", "robots", "Built robots, each tested once.", int, 2000, "N"),
        Option("--cycles", "cycles", "Cycles of a test: those measured, else 30.", int, metavar="N"),
        "seed",
        Option(
            "--target", "measured_point", "The measured point in tool axes (default: the tip).", metavar='"X Y Z mm"',
            group=ROBOT,
            read=reader("--target", "0 0 100 mm", lambda units, text: units.parse_vector(text, units.LENGTH, count=3)),
        ),
        Option(
            "--load", "load", "Mass at the target, in addition to the loads of the sheet.", metavar='"M kg"',
            read=reader("--load", "5 kg", lambda units, text: units.parse(text, units.MASS)),
        ),
        Option("--fit-base", "fit_base", "Align the base by the best fit over the poses.", bool),
        Option(
            "--measured", "measured", "Measured cycles of a robot: pose, cycle, x [mm], y [mm], z [mm], angles.",
            kind=Path, metavar="FILE.csv",
        ),
        "beyond",
        Option(
            "--spec", "specifications", "A limit of a figure to judge; repeats.", metavar='"RP 0.1 mm @ 95 %"',
            is_repeated=True, check=f"{__name__}.forecast:listed_limits",
        ),
        "json",
        Option("--out", "out", "Write the plot (PNG and SVG) and the result there.", kind=Path, metavar="DIR", group=OUTPUT),
    ),
    group=MEASURE,
    prepare=prepare,
    check=check,
    reads=("measured",),
    files=("iso9283.*",),
    table_name="iso9283_table",
    part=PagePart(
        Option(
            "--iso9283", "test_at",
            "Forecast a test by ISO 9283, at the poses of the report or in the largest cube within reach.",
            choices=("poses", "cube"),
        ),
        place=50, chapter="figure:iso9283_chapter", poses="page", settings=lambda value: {"cube": value == "cube"},
    ),
)  # fmt: skip
