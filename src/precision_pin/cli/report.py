"""``precision-pin report``."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import click

from precision_pin.base.errors import InputError
from precision_pin.cli import options as shared
from precision_pin.cli.analyses import check_shared
from precision_pin.cli.exit_codes import EXIT_SPEC
from precision_pin.cli.inputs import PageOutput, read_sheet
from precision_pin.cli.options import compile_sampler, progress_bar
from precision_pin.cli.page_parts import part_files, part_options, read_parts
from precision_pin.cli.poses import pose_files, read_poses, specs_of
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
@part_options()
@shared.output_option(
    "--full", is_flag=True, help="All sections open, and so on paper too; else the decision only is printed."
)
@shared.output_option(
    "--out", type=shared.FILE, required=True, metavar="FILE.html", help="The page to write; report.html in a folder."
)
def command(samples: int, full: bool, **arm: Any) -> int:
    """Write one self-contained page: verdict, distributions, budget, worst case, exact law, 3-D view.

    Several poses are on one page, the worst first; the exit code is 1 if a specification is not met at any of
    them, on the map or along the path. Without arguments: the paper's arm and sheet, from inside the package.
    ROBOT may be example:NAME.
    """
    from precision_pin.sampling import check_samples
    from precision_pin.statistics.plan import listed_specifications

    check_samples(samples)
    check_shared(arm)
    seed = arm["seed"]
    target = PageOutput(arm["out"], "report.html")
    arm["tables"] = [*pose_files(arm), *part_files(arm)]
    target.check(arm["tables"])
    sheet = read_sheet(arm, target.outputs)
    specifications = listed_specifications(specs_of(sheet, arm, arm["specs"]))
    asked = read_poses(sheet, {**arm, "pose_names": tuple(dict.fromkeys(arm["pose_names"]))}, MOST_POSES)
    if len(asked) > MOST_POSES:
        raise InputError(f"{len(asked)} poses; a report shows at most {MOST_POSES}; analyze takes any number")
    sheet, poses = asked.noted_in(sheet), [pose.where for pose in asked]
    parts = read_parts(sheet, arm, poses, seed=seed, specs=specifications)
    from precision_pin.analyses.collect import collect_poses, count_steps
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.pages.report.page import page

    total = count_steps(specifications, len(poses)) + len(parts)
    begun = itertools.count(1)

    @contextmanager
    def step(what: str, samples: int) -> Iterator[Progress]:
        """Report on stderr which step begins, with the progress of those that count samples."""
        echo_note(f"{next(begun)}/{total} {what}")
        with progress_bar(samples, what) as progress:
            yield progress

    results: dict[str, Any] = {}

    def run_parts(*, first: bool) -> None:
        for part in parts:
            if part.of_page.is_first == first:
                with step(part.name, 0):
                    results[part.name] = part.run()

    run_parts(first=True)
    model = ErrorModel.from_sheet(sheet)
    compile_sampler(model.space)
    compile_sampler(model.space, arm["model"])
    outcomes = collect_poses(
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
    run_parts(first=False)
    chapters = [part.chapter(results[part.name]) for part in parts]
    layers = [layer for part in parts for layer in part.layers(results[part.name], model)]
    missed = [where for part in parts for where in part.missed(results[part.name])]
    headline = [line for part in parts for line in part.headline(results[part.name])]
    with step("drawing the page", 0):
        html = page(outcomes, chapters, layers, missed=missed, headline=headline, full=full)
    target.write(html)
    echo_warning_lines(line for outcome in outcomes for line in outcome.analysis.warnings[len(sheet.findings) :])
    echo_note(f"wrote {target.path} ({len(html.encode()) / 1e6:.1f} MB)")
    met = [result.met for outcome in outcomes for result in outcome.analysis.summary.specifications]
    return 0 if all(met) and not missed else EXIT_SPEC


def _given() -> list[str]:
    """Return the options of the running command as they were given or are by default, files without their folders."""
    context = click.get_current_context()
    words = []
    for option in context.command.params:
        value = context.params.get(option.name or "")
        if not isinstance(option, click.Option) or value in (None, False):
            continue
        flag = option.opts[0]
        if option.is_flag:
            words.append(flag)
            continue
        for given in value if isinstance(value, tuple) else (value,):
            name = _name(given) if isinstance(option.type, click.Path) else str(given)
            words += [flag, "report.html" if flag == "--out" else name]
    return words


def _name(path: str) -> str:
    return os.path.basename(os.path.normpath(path))
