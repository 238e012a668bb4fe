"""``precision-pin report``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, Literal, final

import click

from precision_pin.base.errors import InputError
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.analyses import analysis_of
from precision_pin.cli.headings import output_option, sampling_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.measurement import calibration_of
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warning_lines, quiet_option
from precision_pin.cli.options import (
    Options,
    SamplingCommand,
    chain_options,
    inputs_argument,
    layer_options,
    model_option,
    pose_options,
    seed_option,
    spec_option,
    target_option,
)
from precision_pin.cli.poses import AskedPoses, check_poses, pose_files, read_grid, read_path, read_poses
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.targets import PageOutput

if TYPE_CHECKING:
    from precision_pin.sampling import Progress
    from precision_pin.sheet import Sheet

_FRONT: Final = 7
"""Points of the front of cost against accuracy."""
MOST_POSES: Final = 12
"""The most poses of one page, each with all its analyses."""


@click.command("report", cls=SamplingCommand)
@inputs_argument
@pose_options
@target_option
@chain_options
@all_warnings_option
@quiet_option
@sampling_option("--samples", type=int, default=100_000, show_default=True, metavar="N", help="How many built robots.")
@seed_option
@model_option
@spec_option
@layer_options
@click.option(
    "--iso9283",
    "test_at",
    type=click.Choice(["poses", "cube"]),
    help="Forecast a test by ISO 9283, at the poses of the report or in the largest cube within reach.",
)
@click.option(
    "--allocate", "is_allocated", is_flag=True, help="Choose the tolerances that the sheet's allocate: asks for."
)
@output_option(
    "--full", is_flag=True, help="All sections open, and so on paper too; else the decision only is printed."
)
@output_option("--out", required=True, metavar="FILE.html", help="The page to write; report.html in a folder.")
def command(
    samples: int,
    seed: int,
    model: Literal["exact", "linear"],
    specs: tuple[str, ...],
    map_file: str | None,
    path_file: str | None,
    compensate_file: str | None,
    calibrate_file: str | None,
    test_at: str | None,
    is_allocated: bool,
    full: bool,
    out: str,
    **arm: Any,
) -> int:
    """Write one self-contained page: verdict, distributions, budget, worst case, exact law, 3-D view.

    Several poses are on one page, the worst first; the exit code is 1 if a specification is not met at any of
    them, on the map or along the path. Without arguments: the paper's arm and sheet, from inside the package.
    ROBOT may be example:NAME.
    """
    from precision_pin.draws.space import check_seed
    from precision_pin.sampling import check_samples
    from precision_pin.statistics.plan import specification

    check_samples(samples)
    check_seed(seed)
    specifications = [specification(text) for text in specs]
    check_poses(arm)
    target = PageOutput(out, "report.html")
    target.check()
    beside = (map_file, path_file, compensate_file, calibrate_file)
    target.outputs.refuse_inputs([*pose_files(arm), *(file for file in beside if file is not None)])
    package_dirs = arm["package_dirs"]
    sheet = read_sheet(arm, target.outputs)
    asked = _choose_poses(sheet, arm)
    sheet, poses = asked.noted_in(sheet), [pose.where for pose in asked]
    places = None if map_file is None else read_grid(sheet, map_file)
    way = None if path_file is None else read_path(sheet, path_file)
    amended = None if compensate_file is None else read_path(sheet, compensate_file)
    if is_allocated:
        _check_allocation(sheet)
    from precision_pin.analyses.allocation.allocate import allocate
    from precision_pin.analyses.allocation.section import allocation_chapter
    from precision_pin.analyses.calibration.section import calibration_chapter
    from precision_pin.analyses.collect import collect_poses, count_steps
    from precision_pin.analyses.compensation.section import compensation_chapter
    from precision_pin.analyses.iso9283.section import iso9283_chapter
    from precision_pin.analyses.map.section import map_chapter
    from precision_pin.analyses.path.section import path_chapter
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.pages.report.page import page

    asked_for = sum(one is not None for one in (*beside, test_at)) + is_allocated
    step = _Steps(count_steps(specifications, len(poses)) + asked_for)
    chapters, missed = [], []
    if calibrate_file is not None:
        # first: whether the readings are those of this arm shows in the fit alone
        with step("calibration", 0):
            fitted = calibration_of(sheet, calibrate_file)
    space = ErrorModel.from_sheet(sheet).space
    compile_sampler(space)
    compile_sampler(space, model)
    options: dict[str, tuple[str | None, ...]] = {"--pose": arm["pose_names"], "--q": arm["qs"]}
    files = {"--trajectory": arm["trajectory"], "--grid": arm["grid"], "--map": map_file, "--path": path_file}
    files |= {"--compensate": compensate_file, "--calibrate": calibrate_file}
    options |= {option: (None if file is None else _name(file),) for option, file in files.items()}
    options |= {"--approach": (arm["approach"],)}
    options |= {"--step": arm["steps"]}
    options |= {"--target": (arm.get("target"),)}
    options |= {"--set": arm["changes"]}
    options |= {"--tip": (arm["tip"],), "--base": (arm["base"],)}
    options |= {"--package-dir": tuple(map(_name, package_dirs)), "--samples": (str(samples),), "--seed": (str(seed),)}
    options |= {"--iso9283": (test_at,)}
    options |= {"--model": (model,), "--spec": specs, "--out": ("report.html",)}
    given = [
        word for option, values in options.items() for value in values if value is not None for word in (option, value)
    ]
    given += ["--all-poses"] if arm["all_poses"] else []
    given += ["--beyond-limits"] if arm.get("beyond_limits") else []
    given += ["--allocate"] if is_allocated else []
    given += ["--full"] if full else []
    found = collect_poses(
        sheet,
        poses,
        samples=samples,
        seed=seed,
        model=model,
        specifications=specifications,
        command=["precision-pin", "report", *map(_name, arm["inputs"]), *given],
        package_dirs=package_dirs,
        step=step,
    )
    if places is not None:
        with step("map", 0):
            error_map = analysis_of("map", sheet, places, seed=seed, specs=specifications)
            chapters.append(map_chapter(error_map))
            missed += [] if error_map.met else ["on the map"]
    if way is not None:
        with step("path", 0):
            along = analysis_of("path", sheet, way, "sampling the path", seed=seed, specs=specifications)
            chapters.append(path_chapter(along))
            missed += [] if along.met else ["along the path"]
    if amended is not None:
        with step("compensation", 0):
            corrected = analysis_of("compensate", sheet, amended)
            chapters.append(compensation_chapter(corrected, ErrorModel.from_sheet(sheet)))
    if calibrate_file is not None:
        chapters.append(calibration_chapter(fitted))
    if test_at is not None:
        with step("ISO 9283", 0):
            at = None if test_at == "cube" else [next(iter(sheet.poses)) if pose is None else pose for pose in poses]
            tested = analysis_of("iso9283", sheet, at, seed=seed, cube=at is None)
            chapters.append(iso9283_chapter(tested))
    if is_allocated:
        with step("allocation", 0):
            allocated = allocate(ErrorModel.from_sheet(sheet), seed=seed, pareto=_FRONT)
            chapters.append(allocation_chapter(allocated))
            missed += [] if allocated.met else ["by the allocation"]
    with step("drawing the page", 0):
        html = page(found, chapters, missed=missed, full=full)
    target.write(html)
    echo_warning_lines(line for one in found for line in one.analysis.warnings[len(sheet.findings) :])
    echo_note(f"wrote {target.path} ({len(html.encode()) / 1e6:.1f} MB)")
    met = [result.met for one in found for result in one.analysis.summary.specifications]
    return 0 if all(met) and not missed else EXIT_SPEC


def _check_allocation(sheet: Sheet) -> None:
    """Refuse a sheet that asks for no allocation, before anything long begins."""
    from precision_pin.analyses.allocation.problem import read_problem
    from precision_pin.model.error_model import ErrorModel

    read_problem(ErrorModel.from_sheet(sheet), None)


def _choose_poses(sheet: Sheet, arm: Options) -> AskedPoses:
    once: Options = {**arm, "pose_names": tuple(dict.fromkeys(arm["pose_names"]))}
    poses = read_poses(sheet, once, MOST_POSES)
    if len(poses) > MOST_POSES:
        raise InputError(f"{len(poses)} poses; a report shows at most {MOST_POSES}; analyze takes any number")
    return poses


@final
class _Steps:
    """Says on stderr which step begins, and shows the progress of those that count samples."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._done = 0

    @contextmanager
    def __call__(self, what: str, samples: int) -> Iterator[Progress]:
        self._done += 1
        echo_note(f"{self._done}/{self._total} {what}")
        with progress_bar(samples, what) as progress:
            yield progress


def _name(path: str) -> str:
    """Return a file's or folder's own name; ``example:NAME`` is one."""
    return os.path.basename(os.path.normpath(path))
