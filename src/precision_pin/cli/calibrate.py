"""``precision-pin calibrate``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

import click

from precision_pin.base.errors import Finding, InputError
from precision_pin.base.files import whole_folder, write_text
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.headings import HeadedOption, output_option, pose_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.measurement import MeasurementOptions, measurement_of, measurement_options, stated_measurement
from precision_pin.cli.notes import all_warnings_option, echo_frozen, echo_note, echo_warnings, quiet_option
from precision_pin.cli.options import (
    ChainOptions,
    Command,
    PoseOptions,
    chain_options,
    describe_excess,
    pose_options,
    seed_option,
    target_option,
)
from precision_pin.cli.poses import check_poses, pose_files, pose_values, read_poses
from precision_pin.cli.progress import progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from precision_pin.analyses.calibration.calibrate import CalibrationResult
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.render.result_io import JsonResult
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.sheet import Sheet
    from precision_pin.sheet.measurement import Measurement

_RANDOM: Final = 50
"""Poses of a forecast where none are given."""
_CANDIDATES: Final = 200
"""Candidates of a plan where none are given."""
_DRAWN: Final = 20
"""Random poses that are drawn for each that the instrument must see."""
_MOST: Final = 10_000
"""The most poses."""


class _Options(ChainOptions, PoseOptions, MeasurementOptions):
    """All options but those that say what is done."""

    population: bool
    means_free: bool
    factory: str | None
    criterion: str | None
    csv_path: str | None
    at_names: tuple[str, ...]
    random: int | None
    no_prior: bool
    urdf: str | None
    sheet_path: str | None
    seed: int
    json_path: str | None
    out: str | None


_fit_option: Final = partial(click.option, cls=HeadedOption, heading="Fit to readings")
_ahead_option: Final = partial(click.option, cls=HeadedOption, heading="Before anything is measured")
_several_option: Final = partial(click.option, cls=HeadedOption, heading="Several robots")
_factory_option: Final = partial(click.option, cls=HeadedOption, heading="Factory calibration")


class _CalibrateCommand(Command):
    data_suffixes = (".csv", ".json")


@click.command("calibrate", cls=_CalibrateCommand)
@click.argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml] [DATA.csv]...")
@_ahead_option("--forecast", is_flag=True, help="What measuring will buy, before anything is measured.")
@_ahead_option("--plan", "count", type=int, metavar="M", help="Choose the M best of many poses to measure.")
@_ahead_option(
    "--criterion",
    type=click.Choice(["task", "D"]),
    help="Of --plan: the position error left at the poses of --at, or the determinant of the information.  [default: task]",
)
@_ahead_option(
    "--csv", "csv_path", metavar="FILE", help="Of --plan: write the chosen poses, as --trajectory reads them."
)
@_ahead_option(
    "--random",
    type=int,
    metavar="N",
    help=f"N random poses within joint limits (of plane and socket: in contact); {_RANDOM}, {_CANDIDATES} for a plan.",
)
@_fit_option("--no-prior", is_flag=True, help="Maximum likelihood: the sheet's tolerances are no prior.")
@_fit_option("--urdf", metavar="FILE", help="Write the calibrated robot as a URDF.")
@_fit_option(
    "--sheet",
    "sheet_path",
    metavar="FILE.yaml",
    help="Write the sheet of the calibrated arm, for every other command, and the result beside it.",
)
@_several_option(
    "--population",
    is_flag=True,
    help="Tolerances from several robots: give readings (CSV) or calibrations (JSON) of each.",
)
@_several_option("--means-free", is_flag=True, help="With --population: the means are estimated too.")
@_factory_option(
    "--factory", metavar="FILE", help="Read UR's factory calibration: calibration.conf, or the YAML for ROS."
)
@measurement_options
@pose_options
@pose_option(
    "--at", "at_names", multiple=True, metavar="NAME", help="A pose of the sheet to judge; all if left out; repeats."
)
@target_option
@chain_options
@seed_option
@output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone.")
@output_option("--out", metavar="DIR", help="Write plots (PNG and SVG) and the result there.")
@all_warnings_option
@quiet_option
def command(forecast: bool, count: int | None, **options: Unpack[_Options]) -> int:
    """Calibrate an arm, in one of three ways.

    \b
    Before:  calibrate SHEET --forecast             what measuring will buy
             calibrate SHEET --plan 20              which poses to measure
    Fit:     calibrate SHEET DATA.csv               the robot that was measured
    Others:  calibrate SHEET --factory FILE         what the factory measured
             calibrate SHEET --population A.csv …   tolerances of many robots

    Before: poses, or candidates, are those given, or random ones. Fit: the exact model is fitted to the readings, with the
    sheet's tolerances as the prior; DATA.csv has a column for each joint and each measured number, with units:
    "joint1 [deg], x [mm], y [mm], z [mm]". With --no-prior the exit code is 1 where the readings do not determine every
    number.
    """  # noqa: D301 - a backspace, which tells click to keep the lines
    from precision_pin.analyses.calibration.data import poses_csv
    from precision_pin.analyses.calibration.forecast import forecast_calibration
    from precision_pin.analyses.calibration.plan import PLAN_STEPS, plan_calibration
    from precision_pin.analyses.calibration.table import calibration_table, forecast_table, plan_table
    from precision_pin.model.error_model import ErrorModel

    robots, options["inputs"] = _split(options["inputs"], several=options["population"])
    data = robots[0] if robots else None
    _check_usage(forecast, count, data, options)
    files = {
        "--json": options["json_path"],
        "--csv": options["csv_path"],
        "--urdf": options["urdf"],
        "--sheet": options["sheet_path"],
    }
    outputs = Outputs(files, options["out"], ("calibration*",))
    outputs.check()
    outputs.refuse_inputs([*filter(None, [*robots, options["factory"]]), *pose_files(options)])
    sheet = read_sheet(options, outputs)
    if options["factory"] is not None:
        _read_factory(sheet, options["factory"], options)
        return 0
    measurement = measurement_of(sheet, options)
    if options["population"]:
        _measure_population(sheet, robots, measurement, options)
        return 0
    model = ErrorModel.from_sheet(sheet)
    at = _task_poses(model, options["at_names"])
    if count is not None:
        poses, sheet = _measured_poses(sheet, options, _CANDIDATES, measurement)
        with progress_bar(PLAN_STEPS, "choosing poses", "steps") as progress:
            plan = plan_calibration(
                model,
                poses,
                count,
                measurement,
                at=at,
                criterion="D" if options["criterion"] == "D" else "task",
                seed=options["seed"],
                findings=sheet.findings,
                progress=progress,
            )
        echo_warnings(plan.findings[len(sheet.findings) :])
        _answer(plan, plan_table, "plan_figure", "calibration-plan", options)
        if options["csv_path"] is not None:
            write_text(Path(options["csv_path"]), poses_csv(model.chain, plan.q))
            echo_note(f"wrote {options['csv_path']}")
        return 0
    if forecast:
        poses, sheet = _measured_poses(sheet, options, _RANDOM, measurement)
        forecast_result = forecast_calibration(model, poses, measurement, at=at, findings=sheet.findings)
        echo_warnings(forecast_result.findings[len(sheet.findings) :])
        _answer(forecast_result, forecast_table, "forecast_figure", "calibration-forecast", options)
        return 0
    assert data is not None
    result = _fit(model, sheet, data, measurement, prior=not options["no_prior"], at=at)
    if options["sheet_path"] is not None:
        _write_sheet(result, sheet.file, options["sheet_path"])
    if options["urdf"] is not None:
        frozen = result.to_urdf(options["urdf"])
        echo_note(f"wrote {options['urdf']}")
        echo_frozen(frozen, "the first pose")
    _answer(result, calibration_table, "calibration_figure", "calibration", options)
    return EXIT_SPEC if options["no_prior"] and not result.identifiability.is_complete else 0


def calibration_of(sheet: Sheet, data: str) -> CalibrationResult:
    """Return the fit of the sheet to readings of its own instrument, for a page that shows it; print its warnings.

    Raises
    ------
    InputError
        The sheet says nothing of an instrument, or the data are wrong.
    """
    from precision_pin.model.error_model import ErrorModel

    measurement = stated_measurement(sheet)
    return _fit(ErrorModel.from_sheet(sheet), sheet, data, measurement, prior=True, at=None)


def _fit(
    model: ErrorModel, sheet: Sheet, data: str, measurement: Measurement, *, prior: bool, at: list[str] | None
) -> CalibrationResult:
    """Return the fit of a model to the readings of a file; print its warnings."""
    from precision_pin.analyses.calibration.calibrate import calibrate

    result = calibrate(model, data, measurement, prior=prior, at=at, findings=sheet.findings)
    echo_warnings(result.findings[len(sheet.findings) :])
    return result


def _read_factory(sheet: Sheet, file: str, options: _Options) -> None:
    """Print what a factory calibration says of a robot, and write what is asked for."""
    from precision_pin.analyses.calibration.factory import ur_calibration
    from precision_pin.analyses.calibration.table import factory_table
    from precision_pin.model.error_model import ErrorModel

    found = ur_calibration(file, ErrorModel.from_sheet(sheet))
    echo_warnings(found.findings)
    if options["urdf"] is not None:
        found.to_urdf(options["urdf"])
        echo_note(f"wrote {options['urdf']}")
    _answer(found, factory_table, None, "calibration-factory", options)


def _measure_population(sheet: Sheet, robots: list[str], measurement: Measurement, options: _Options) -> None:
    """Print the tolerances that several robots show, and write the sheet with them."""
    from precision_pin.analyses.calibration.population import population, population_sheet
    from precision_pin.analyses.calibration.table import population_table
    from precision_pin.model.error_model import ErrorModel

    model = ErrorModel.from_sheet(sheet)
    with progress_bar(len(robots) + len(model.space.draws), "fitting robots", "steps") as progress:
        found = population(
            model,
            robots,
            measurement,
            means="estimated" if options["means_free"] else "sheet",
            findings=sheet.findings,
            progress=progress,
        )
    echo_warnings(found.findings[len(sheet.findings) :])
    path = options["sheet_path"]
    if path is not None:
        write_text(Path(path), population_sheet(found, Path(path).parent))
        echo_note(f"wrote {path}")
    _answer(found, population_table, "population_figure", "calibration-population", options)


def _write_sheet(result: JsonResult, original: str, path: str) -> None:
    """Write the sheet of the calibrated arm, and the result that it names."""
    from precision_pin.analyses.calibration.calibrate import calibrated_sheet, result_name
    from precision_pin.base.files import write_files

    name = str(Path(path).with_name(result_name(path)))
    text = calibrated_sheet(original, path)
    write_files({name: (result.to_json() + "\n").encode(), path: text.encode()})
    echo_note(f"wrote {path} and {name}")


def _split(arguments: tuple[str, ...], *, several: bool) -> tuple[list[str], tuple[str, ...]]:
    """Return the data among the arguments, of one robot or several, and the others."""
    suffixes = (".csv", ".json") if several else (".csv",)
    data = [text for text in arguments if Path(text).suffix.lower() in suffixes]
    inputs = tuple(text for text in arguments if text not in data)
    if len(data) > 1 and not several:
        raise InputError(f"one file of data is expected, got {' '.join(data)}; several robots need --population")
    if len(inputs) > 2:
        raise InputError(describe_excess(inputs))
    return data, inputs


def _check_usage(forecast: bool, count: int | None, data: str | None, options: _Options) -> None:
    check_poses(options)
    chosen = _gives_poses(options)
    ahead = ["--forecast"] * forecast + ["--plan"] * (count is not None)
    if options["means_free"] and not options["population"]:
        raise _usage("--means-free belongs to --population")
    if options["population"]:
        both = [*ahead, *(["--factory"] if options["factory"] is not None else [])]
        poses = chosen or options["random"] is not None
        if both or poses or options["no_prior"] or options["urdf"] is not None or options["at_names"]:
            raise _usage(f"--population takes no {both[0] if both else 'poses, --at, --no-prior or --urdf'}")
        return
    if options["factory"] is not None:
        asked = [*ahead, *(["data"] if data else []), *(["poses"] if chosen or options["random"] is not None else [])]
        if asked or options["sheet_path"] is not None:
            raise _usage(f"--factory takes no {asked[0] if asked else '--sheet'}; it reads what the factory measured")
        return
    if data is None and not ahead:
        raise _usage("nothing to do: give readings (DATA.csv), --forecast, --plan M or --factory FILE")
    if len(ahead) == 2:
        raise _usage("--forecast and --plan exclude each other; a plan has the forecast of its choice")
    if data is not None and ahead:
        raise _usage(f"{ahead[0]} takes no data")
    if options["criterion"] is not None and count is None:
        raise _usage("--criterion belongs to --plan")
    if options["csv_path"] is not None and count is None:
        raise _usage("--csv belongs to --plan")
    if data is not None and (chosen or options["random"] is not None):
        raise _usage("the measured poses are those of the data; --at names poses to judge")
    if chosen and options["random"] is not None:
        raise _usage("--random and given poses exclude each other")
    if data is None and (options["no_prior"] or options["urdf"] is not None or options["sheet_path"] is not None):
        raise _usage("--no-prior, --urdf and --sheet belong to a calibration with data")
    if options["sheet_path"] is not None and options["changes"]:
        raise _usage("--sheet writes the sheet as it is in its file; write what --set changes there first")


def _gives_poses(options: PoseOptions) -> bool:
    return bool(options["pose_names"] or options["all_poses"] or options["qs"] or pose_files(options))


def _usage(message: str) -> InputError:
    return InputError([Finding("error", "E_USAGE", message)])


def _task_poses(model: ErrorModel, names: tuple[str, ...]) -> list[str] | None:
    """Return the poses to judge; refuse names that the sheet has not before any work."""
    for name in names:
        model.configuration(name)
    return list(names) or None


def _measured_poses(sheet: Sheet, options: _Options, count: int, measurement: Measurement) -> tuple[PoseSet, Sheet]:
    """Return the poses that the options give, or random ones, and the sheet with warnings about poses left out."""
    import numpy as np

    from precision_pin.analyses.calibration.contact import contact_poses, seen_poses
    from precision_pin.base.arguments import check_whole
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.robot.random_poses import random_poses

    if _gives_poses(options):
        asked = read_poses(sheet, options, _MOST)
        values = [pose_values(sheet, one) for one in asked]
        names = tuple(one.name for one in asked)
        return PoseSet.at(sheet.chain, np.ascontiguousarray(np.array(values).T), names), asked.noted_in(sheet)
    number = count if options["random"] is None else options["random"]
    check_whole("the number of random poses", number, 1, _MOST)
    if measurement.kind in ("plane", "socket"):
        return contact_poses(sheet.chain, measurement, number, seed=options["seed"]), sheet
    if measurement.seen_from is None:
        return random_poses(sheet.chain, number, seed=options["seed"]), sheet
    seen = seen_poses(sheet.chain, measurement, random_poses(sheet.chain, _DRAWN * number, seed=options["seed"]))
    if seen is None or len(seen) < number:
        found = 0 if seen is None else len(seen)
        raise InputError(
            f"the instrument sees the target at {found} of {_DRAWN * number:,} random poses, fewer than {number:,}"
        )
    return seen.take(np.arange(number)), sheet


def _answer(result: JsonResult, table: Callable[[Any], str], figure: str | None, name: str, options: _Options) -> None:
    """Print a result and write the files that are asked for.

    Raises
    ------
    OutputError
        Something cannot be written.
    """
    json_path, out = options["json_path"], options["out"]
    if json_path == "-":
        echo_data(result.to_json())
    else:
        echo_table(table(result))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is None:
        return
    from precision_pin.analyses.calibration import figure as figures
    from precision_pin.sampling.figures import save

    drawn: Figure | None = None if figure is None else getattr(figures, figure)(result)
    with whole_folder(Path(out)) as stage:
        write_text(stage / f"{name}.json", result.to_json() + "\n")
        if drawn is not None:
            save(drawn, stage / name)
    echo_note(f"wrote {out}: {name}.json{f', {name} as PNG and SVG' if drawn is not None else ''}")
