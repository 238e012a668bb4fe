"""Calibration: forecast of the accuracy, selection of poses to measure, and fit of the error model to readings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from precision_pin.analyses.declaration import MEASURE, POSES, Asked, Declaration, Files, Job, Option, PagePart, load
from precision_pin.base.errors import InputError

if TYPE_CHECKING:
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.sheet import Sheet
    from precision_pin.sheet.measurement import Measurement

_POSES: Final = 50
"""Default number of poses of a forecast."""
_CANDIDATES: Final = 200
"""Default number of candidates of a plan."""
_DRAWS: Final = 20
"""Random poses drawn per pose that the instrument must see."""
_MAX_POSES: Final = 10_000
"""Maximum number of poses."""
_AHEAD, _FIT, _SEVERAL = "Before anything is measured", "Fit to readings", "Several robots"


def check(options: dict[str, Any]) -> None:
    """Move the data files from the inputs to ``robots``; raise if options are incompatible."""
    several = options["population"]
    suffixes = (".csv", ".json") if several else (".csv",)
    data = [text for text in options["inputs"] if Path(text).suffix.lower() in suffixes]
    options["robots"], options["inputs"] = data, tuple(text for text in options["inputs"] if text not in data)
    count, is_given = options["count"], _gives_poses(options)
    ahead = ["--forecast"] * options["forecast"] + ["--plan"] * (count is not None)
    has_poses = is_given or options["random"] is not None
    is_map = options["grid"] is not None and options["random"] is None
    is_factory, has_sheet = options["factory"] is not None, options["sheet_path"] is not None
    of_fit = options["no_prior"] or options["urdf"] is not None or bool(options["only"])
    requested = [*ahead, *["data"] * bool(data), *["poses"] * has_poses]
    rules: dict[str, Any] = {
        "--means-free belongs to --population": options["means_free"],
        "nothing to do: give readings (DATA.csv), --forecast, --plan M or --factory FILE": not data and not ahead,
        "--forecast and --plan exclude each other; a plan has the forecast of its choice": len(ahead) == 2,
        f"{ahead[0] if ahead else ''} takes no data": data and ahead,
        "--criterion belongs to --plan": options["criterion"] is not None and count is None,
        "--csv belongs to --plan": options["csv_path"] is not None and count is None,
        "the measured poses are those of the data; --at names poses to judge, --grid places to map": data
        and (has_poses and not is_map),
        "--random and given poses exclude each other": is_given and options["random"] is not None,
        "--urdf-without belongs to --urdf": options["urdf_without"] and options["urdf"] is None,
        "--no-prior, --only, --urdf and --sheet belong to a calibration with data": not data and (of_fit or has_sheet),
        "--sheet writes the sheet as it is in its file; write what --set changes there first": has_sheet
        and options["changes"],
    }
    if several:
        rejected = [*ahead, *["--factory"] * is_factory, "poses, --at, --no-prior, --only or --urdf"]
        is_broken = len(rejected) > 1 or has_poses or of_fit or options["at_names"]
        rules = {f"--population takes no {rejected[0]}": is_broken}
    elif is_factory and not options["means_free"]:
        rejected = [*requested, "--sheet"]
        rules = {f"--factory takes no {rejected[0]}; it reads what the factory measured": requested or has_sheet}
    for message, is_broken in rules.items():
        if is_broken:
            raise InputError.of("E_USAGE", message)


def _gives_poses(options: dict[str, Any]) -> bool:
    return any(options[name] for name in ("pose_names", "all_poses", "qs")) or any(
        options[name] is not None for name in ("trajectory", "grid")
    )


def prepare(request: Asked) -> Job:
    """Return the job of the options: factory, population, plan, forecast or fit."""
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sheet.measurement import only_one

    options, model = request.options, ErrorModel.from_sheet(request.sheet)
    if options["factory"] is not None:
        return _factory(request, model)
    measurements = request.read_measurements()
    if options["population"]:
        return _population(request, model, measurements)
    for name in options["at_names"]:
        model.configuration(name)
    at = list(options["at_names"]) or None
    if options["count"] is None and not options["forecast"]:
        return _fit(request, model, measurements, at)
    ahead = _forecast if options["count"] is None else _plan
    return ahead(request, model, only_one(measurements, request.sheet.file), at)


def check_measured(sheet: Sheet) -> None:
    """Reject a sheet that does not say how the readings of a page were measured."""
    if not sheet.measurements:
        message = "the sheet has no measurement:, which says how the readings of --calibrate were measured"
        raise InputError.of("E_MISSING_KEY", message, sheet.file)


def _job(run: Callable[..., Any], use: str, **settings: Any) -> Job:
    stem, name = f"calibration{use and f'-{use}'}", use or "calibration"
    return Job(run, **{
        "stem": stem,
        "table": lambda result: load(f"{__name__}.table:{name}_table")(result),
        "files": lambda result: Files({stem: load(f"{__name__}.figure:{name}_figure")(result)}),
        "is_met": lambda _: True,
        "is_written_first": True,
        **settings,
    })  # fmt: skip


def _write(path: str | None, write: Callable[[Any], object], result: Any) -> tuple[str, ...]:
    if path is None:
        return ()
    write(result)
    return (f"wrote {path}",)


def _factory(request: Asked, model: ErrorModel) -> Job:
    from precision_pin.analyses.calibration.population import ur_calibration

    path = request.options["urdf"]
    run = partial(ur_calibration, request.options["factory"], model)
    write = partial(_write, path, lambda result: result.to_urdf(path))
    return _job(run, "factory", files=lambda _: Files(), write=write, findings=())


def _population(request: Asked, model: ErrorModel, measurements: tuple[Measurement, ...]) -> Job:
    from precision_pin.analyses.calibration.population import population, population_sheet
    from precision_pin.base.files import write_text

    robots, path = request.options["robots"], request.options["sheet_path"]
    write = partial(_write, path, lambda result: write_text(Path(path), population_sheet(result, Path(path).parent)))
    means: Literal["sheet", "estimated"] = "estimated" if request.options["means_free"] else "sheet"
    run = partial(population, model, robots, measurements, means=means, findings=request.sheet.findings)
    steps = len(robots) + len(model.space.draws)
    return _job(
        run, "population", write=write, steps=steps,
        what="fitting robots", unit="steps", findings=request.sheet.findings,
    )  # fmt: skip


def _plan(request: Asked, model: ErrorModel, measurement: Measurement, at: list[str] | None) -> Job:
    from precision_pin.analyses.calibration.data import poses_csv
    from precision_pin.analyses.calibration.datum_plan import DATUM_PLAN_STEPS, plan_datum
    from precision_pin.analyses.calibration.plan import PLAN_STEPS, plan_calibration
    from precision_pin.base.files import write_text

    options, path, count = request.options, request.options["csv_path"], request.options["count"]
    is_for_datum = options["datum"] is not None and bool(model.datums)
    if is_for_datum and (len(model.datums) > 1 or options["criterion"] is not None):
        raise InputError.of("E_USAGE", "--plan --datum: one datum at a time, and without --criterion")
    poses, sheet = None, request.sheet
    if not is_for_datum or _gives_poses(dict(options)) or options["random"] is not None:
        poses, sheet = _measured_poses(request, model, measurement, _CANDIDATES)
    settings: dict[str, Any] = {"at": at, "seed": options["seed"], "findings": sheet.findings}
    if is_for_datum:
        run: partial[Any] = partial(
            plan_datum, model, model.datums[0], count, poses, measurement=measurement, **settings
        )
    else:
        criterion: Any = options["criterion"] or "task"
        run = partial(plan_calibration, model, poses, count, measurement, criterion=criterion, **settings)
    return _job(
        run, "datum" if is_for_datum else "plan", is_written_first=False, what="choosing poses", unit="steps",
        write=partial(_write, path, lambda result: write_text(Path(path), poses_csv(model.chain, result.q))),
        steps=DATUM_PLAN_STEPS if is_for_datum else PLAN_STEPS, findings=sheet.findings,
        **({"files": lambda _: Files()} if is_for_datum else {}),
    )  # fmt: skip


def _forecast(request: Asked, model: ErrorModel, measurement: Measurement, at: list[str] | None) -> Job:
    from precision_pin.analyses.calibration.forecast import forecast_calibration

    poses, sheet = _measured_poses(request, model, measurement, _POSES)
    run = partial(forecast_calibration, model, poses, measurement, at=at, findings=sheet.findings)
    return _job(run, "forecast", findings=sheet.findings)


def _fit(request: Asked, model: ErrorModel, measurements: tuple[Measurement, ...], at: list[str] | None) -> Job:
    from precision_pin.analyses.calibration.calibrate import calibrate
    from precision_pin.analyses.calibration.calibrated_sheet import FRAME, calibrated_sheet, measured_frame, result_name
    from precision_pin.base.files import write_files
    from precision_pin.render.tables import milli
    from precision_pin.robot.datums import COMPENSATED
    from precision_pin.writers.as_built import describe_frozen

    options, path = request.options, request.options["sheet_path"]
    overrides = None if request.sheet.contents is None else request.sheet.contents.overrides
    if path is not None and overrides is not None and (overrides.robot or overrides.tip or overrides.base):
        hint = "write the robot, tip and base of the options there first"
        if not (overrides.tip or overrides.base):
            hint = (
                "give a sheet that names the robot, without the robot; precision-pin init ROBOT --out SHEET writes one"
            )
        raise InputError(f"--sheet writes the sheet as it is in its file; {hint}")

    def write(result: Any) -> list[str]:
        notes = [finding.message for finding in result.data.findings if finding.severity == "note"]
        if places is not None:
            remaining.append(load(f"{__name__}.remaining:RemainingError").of(result, places))
            notes.append(str(remaining[0]))
        if path is not None:
            name = str(Path(path).with_name(result_name(path)))
            frame = measured_frame(result)
            text = calibrated_sheet(request.sheet.file, path, frame)
            write_files({name: (result.to_json() + "\n").encode(), path: text.encode()})
            notes.append(f"wrote {path} and {name}")
            if frame is not None:
                notes.append(
                    f"datum {FRAME} of {path}: errors in the frame of the readings; --datum none: in base axes"
                )
            driven = COMPENSATED if frame is None else f"{FRAME},{COMPENSATED}"
            notes.append(f"errors of a robot that is driven by the calibrated model: --datum {driven}")
        if options["urdf"] is not None:
            has_loads = not options["urdf_without"]
            frozen = result.to_urdf(options["urdf"], loads=has_loads)
            notes += [f"wrote {options['urdf']}", *describe_frozen(frozen, "the first pose")]
            if frozen or not has_loads:
                error, other = (
                    f"{milli(result.urdf_error(loads=loads), 3)} mm" for loads in (has_loads, not has_loads)
                )
                notes.append(
                    f"at random poses the URDF is {error} rms from the calibrated arm, {'without' if has_loads else 'with'} "
                    f"loads {other}; that arm is {milli(result.rms('left out'), 3)} mm rms from left-out readings"
                )
        return notes

    run = partial(
        calibrate, model, tuple(options["robots"]), measurements, prior=not options["no_prior"], only=options["only"],
        approach=options.get("approach"), at=at, findings=request.sheet.findings,
    )  # fmt: skip
    # the options of a page have neither grid nor approach
    places = None if options.get("grid") is None else request.read_pose_set(_MAX_POSES)
    remaining: list[Any] = []

    def files(result: Any) -> Files:
        figures = {"calibration": load(f"{__name__}.figure:calibration_figure")(result)}
        if remaining:
            figures["calibration-map"] = load(f"{__name__}.remaining:remaining_figure")(result, remaining[0])
        return Files(figures)

    return _job(
        run, "", write=write, files=files, findings=request.sheet.findings,
        is_met=lambda result: not options["no_prior"] or result.identifiability.is_complete,
    )  # fmt: skip


def _measured_poses(request: Asked, model: ErrorModel, measurement: Measurement, count: int) -> tuple[PoseSet, Sheet]:
    """Return the poses of the options, or random ones, and the sheet with warnings about omitted poses."""
    import numpy as np

    from precision_pin.analyses.calibration.forecast import contact_poses, seen_poses
    from precision_pin.base.arguments import check_whole
    from precision_pin.robot.pose_grids import random_poses
    from precision_pin.robot.pose_set import PoseSet

    options, sheet = request.options, request.sheet
    if _gives_poses(dict(options)):
        requested = request.read_poses(_MAX_POSES)
        values, _ = model.configurations([pose.where for pose in requested])
        poses = PoseSet.at(sheet.chain, np.ascontiguousarray(values), tuple(pose.name for pose in requested))
        return poses, requested.noted_in(sheet)
    number = count if options["random"] is None else options["random"]
    check_whole("the number of random poses", number, 1, _MAX_POSES)
    if measurement.kind in ("plane", "socket"):
        return contact_poses(sheet.chain, measurement, number, seed=options["seed"]), sheet
    if measurement.visible_from is None:
        return random_poses(sheet.chain, number, seed=options["seed"]), sheet
    visible = seen_poses(sheet.chain, measurement, random_poses(sheet.chain, _DRAWS * number, seed=options["seed"]))
    if visible is None or len(visible) < number:
        hits, drawn = 0 if visible is None else len(visible), _DRAWS * number
        raise InputError(f"the instrument sees the target at {hits} of {drawn:,} random poses, fewer than {number:,}")
    return visible.take(np.arange(number)), sheet


_ahead, _fit_of = partial(Option, group=_AHEAD), partial(Option, group=_FIT)

DECLARATION = Declaration(
    name="calibrate",
    function=f"{__name__}.calibrate:calibrate",
    result=f"{__name__}.calibrate:CalibrationResult",
    title="Calibration",
    heading="",
    summary="Forecast what measuring an arm will buy, choose poses to measure, or fit the model to readings.",
    description="""Calibrate an arm, in one of three ways.

    \b
    Before:  calibrate SHEET --forecast             what measuring will buy
             calibrate SHEET --plan 20              which poses to measure; with --datum, to find it at
    Fit:     calibrate SHEET DATA.csv               the robot that was measured
    Others:  calibrate SHEET --factory FILE         what the factory measured
             calibrate SHEET --population A.csv …   tolerances of many robots

    Before: poses, or candidates, are those given, or random ones. Fit: the exact model is fitted to the readings, with the
    sheet's tolerances as the prior; DATA.csv has a column for each joint and each measured number, with units:
    "joint1 [deg], x [mm], y [mm], z [mm]", or "x1 [mm], …" of several targets; --columns says what other columns are. Several
    files are one for each measurement that the sheet lists. --grid maps the error that is left, which --out draws. With
    --no-prior the exit code is 1 where the readings do not determine every number.
    """,
    options=(
        _ahead("--forecast", "forecast", "Predict the accuracy after calibration, before measuring.", bool),
        _ahead(
            "--plan", "count", "Choose the M best of many poses to measure, or at which to find --datum.", int, metavar="M"
        ),
        _ahead(
            "--criterion", "criterion",
            "Of --plan: the position error left at the poses of --at, or the determinant of the information.  [default: task]",
            choices=("task", "D"),
        ),
        _ahead(
            "--csv", "csv_path", "Of --plan: write the chosen poses, as --trajectory reads them.", kind=Path, metavar="FILE",
        ),
        _ahead(
            "--random", "random",
            f"N random poses within joint limits (of plane and socket: in contact); {_POSES}, {_CANDIDATES} for a plan.", int,
            metavar="N",
        ),
        _fit_of("--no-prior", "no_prior", "Maximum likelihood: the sheet's tolerances are no prior.", bool),
        _fit_of(
            "--only", "only", "Estimate only the parameters of this kind of source; repeats.", metavar="KIND",
            is_repeated=True,
        ),
        _fit_of("--urdf", "urdf", "Write the calibrated robot as a URDF.", kind=Path, metavar="FILE"),
        _fit_of("--urdf-without", "urdf_without", "Of --urdf: leave out what loads cause.", choices=("loads",)),
        _fit_of(
            "--sheet", "sheet_path",
            "Write the sheet of the calibrated arm, for every other command, and the result next to it.",
            kind=Path, metavar="FILE.yaml",
        ),
        Option(
            "--population", "population",
            "Tolerances from several robots: give readings (CSV) or calibrations (JSON) of each.", bool, group=_SEVERAL,
        ),
        Option("--means-free", "means_free", "With --population: the means are estimated too.", bool, group=_SEVERAL),
        Option(
            "--factory", "factory", "Read UR's factory calibration: calibration.conf, or the YAML for ROS.",
            kind=Path, metavar="FILE",
            group="Factory calibration",
        ),
        *("measurement", "poses"),
        Option(
            "--at", "at_names", "A pose of the sheet to judge (default: all); repeats.", metavar="POSE", is_repeated=True,
            group=POSES,
        ),
        *("target", "chain", "seed", "json", "out", "messages"),
    ),
    group=MEASURE,
    prepare=prepare,
    check=check,
    arguments=("inputs", "[ROBOT.urdf] [SHEET.yaml] [DATA.csv]..."),
    data_suffixes=(".csv", ".json"),
    reads=("robots", "factory"),
    writes=("json_path", "csv_path", "urdf", "sheet_path"),
    files=("calibration*",),
    is_sampled=False,
    part=PagePart(
        Option(
            "--calibrate", "calibrate_file",
            "Fit the sheet to readings, a file as for calibrate with the sheet's measurement:; "
            "show readings against predictions.",
            kind=Path, metavar="DATA.csv",
        ),
        place=40, chapter="figure:calibration_chapter", layer="figure:CalibrationLayer",
        settings=lambda file: {"robots": [file]}, check=check_measured, is_first=True,
        headline="table:page_headline",
    ),
)  # fmt: skip
