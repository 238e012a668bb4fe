"""``precision-pin report``."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import click

from precision_pin.base.errors import InputError
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli import options as shared
from precision_pin.cli.analyses import analysis_of
from precision_pin.cli.inputs import PageOutput, read_sheet
from precision_pin.cli.measurement import calibration_of
from precision_pin.cli.options import compile_sampler, progress_bar
from precision_pin.cli.poses import check_poses, pose_files, read_grid, read_path, read_poses
from precision_pin.cli.terminal import echo_note, echo_warning_lines

if TYPE_CHECKING:
    from precision_pin.sampling import Progress

MOST_POSES: Final = 12
"""Largest number of poses of one page, each with all its analyses."""


@click.command("report", cls=shared.SamplingCommand)
@shared.arm_options
@shared.all_warnings_option
@shared.quiet_option
@shared.sampling_option(
    "--samples", type=int, default=100_000, show_default=True, metavar="N", help="How many built robots."
)
@shared.seed_option
@shared.model_option
@shared.spec_option
@shared.layer_options
@click.option(
    "--iso9283",
    "test_at",
    type=click.Choice(["poses", "cube"]),
    help="Forecast a test by ISO 9283, at the poses of the report or in the largest cube within reach.",
)
@click.option(
    "--allocate", "is_allocated", is_flag=True, help="Choose the tolerances that the sheet's allocate: asks for."
)
@shared.output_option(
    "--full", is_flag=True, help="All sections open, and so on paper too; else the decision only is printed."
)
@shared.output_option("--out", required=True, metavar="FILE.html", help="The page to write; report.html in a folder.")
def command(samples: int, seed: int, specs: tuple[str, ...], is_allocated: bool, full: bool, **arm: Any) -> int:
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
    target = PageOutput(arm["out"], "report.html")
    target.check()
    target.outputs.refuse_inputs([*pose_files(arm), *shared.layer_files(arm)])
    sheet = read_sheet(arm, target.outputs)
    asked = read_poses(sheet, {**arm, "pose_names": tuple(dict.fromkeys(arm["pose_names"]))}, MOST_POSES)
    if len(asked) > MOST_POSES:
        raise InputError(f"{len(asked)} poses; a report shows at most {MOST_POSES}; analyze takes any number")
    sheet, poses = asked.noted_in(sheet), [pose.where for pose in asked]
    places = None if arm["map_file"] is None else read_grid(sheet, arm["map_file"])
    files = arm["path_file"], arm["compensate_file"]
    way, amended = (None if file is None else read_path(sheet, file) for file in files)
    from precision_pin.analyses.allocation.allocate import allocate
    from precision_pin.analyses.allocation.figure import allocation_chapter
    from precision_pin.analyses.allocation.problem import read_problem
    from precision_pin.analyses.calibration.figure import calibration_chapter
    from precision_pin.analyses.collect import collect_poses, count_steps
    from precision_pin.analyses.compensation.figure import compensation_chapter
    from precision_pin.analyses.iso9283.figure import iso9283_chapter
    from precision_pin.analyses.map.figure import map_chapter
    from precision_pin.analyses.path.figure import path_chapter
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.pages.report.page import page

    if is_allocated:
        read_problem(ErrorModel.from_sheet(sheet), None)  # rejects a sheet without an allocation before any long work
    test_at = arm["test_at"]
    asked_for = len(shared.layer_files(arm)) + (test_at is not None) + is_allocated
    total = count_steps(specifications, len(poses)) + asked_for
    begun = itertools.count(1)

    @contextmanager
    def step(what: str, samples: int) -> Iterator[Progress]:
        """Report on stderr which step begins, with the progress of those that count samples."""
        echo_note(f"{next(begun)}/{total} {what}")
        with progress_bar(samples, what) as progress:
            yield progress

    chapters, missed = [], []
    if arm["calibrate_file"] is not None:
        # first, because only the fit shows whether the readings are those of this arm
        with step("calibration", 0):
            fitted = calibration_of(sheet, arm["calibrate_file"])
    model = ErrorModel.from_sheet(sheet)
    compile_sampler(model.space)
    compile_sampler(model.space, arm["model"])
    found = collect_poses(
        sheet,
        poses,
        samples=samples,
        seed=seed,
        model=arm["model"],
        specifications=specifications,
        command=["precision-pin", "report", *map(_name, arm["inputs"]), *_given()],
        package_dirs=arm["package_dirs"],
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
            chapters.append(compensation_chapter(analysis_of("compensate", sheet, amended), model))
    if arm["calibrate_file"] is not None:
        chapters.append(calibration_chapter(fitted))
    if test_at is not None:
        with step("ISO 9283", 0):
            at = None if test_at == "cube" else [next(iter(sheet.poses)) if pose is None else pose for pose in poses]
            chapters.append(iso9283_chapter(analysis_of("iso9283", sheet, at, seed=seed, cube=at is None)))
    if is_allocated:
        with step("allocation", 0):
            allocated = allocate(model, seed=seed, pareto=7)
            chapters.append(allocation_chapter(allocated))
            missed += [] if allocated.met else ["by the allocation"]
    with step("drawing the page", 0):
        html = page(found, chapters, missed=missed, full=full)
    target.write(html)
    echo_warning_lines(line for one in found for line in one.analysis.warnings[len(sheet.findings) :])
    echo_note(f"wrote {target.path} ({len(html.encode()) / 1e6:.1f} MB)")
    met = [result.met for one in found for result in one.analysis.summary.specifications]
    return 0 if all(met) and not missed else EXIT_SPEC


_FILES: Final = ("--trajectory", "--grid", "--map", "--path", "--compensate", "--calibrate")
_VALUES: Final = (
    "--pose", "--q", *_FILES, "--approach", "--step", "--target", "--set", "--tip", "--base", "--package-dir",
    "--samples", "--seed", "--iso9283", "--model", "--spec", "--out",
)  # fmt: skip
_FLAGS: Final = ("--all-poses", "--beyond-limits", "--allocate", "--full")


def _given() -> list[str]:
    """Return the options of the running command in a fixed order, files without their folders."""
    context = click.get_current_context()
    values = {option.opts[0]: context.params.get(option.name or "") for option in context.command.params}
    words = []
    for option in _VALUES:
        value = "report.html" if option == "--out" else values[option]
        for one in value if isinstance(value, tuple) else () if value is None else (value,):
            words += [option, _name(one) if option in (*_FILES, "--package-dir") else str(one)]
    return [*words, *(option for option in _FLAGS if values[option])]


def _name(path: str) -> str:
    return os.path.basename(os.path.normpath(path))
