"""``precision-pin view``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli import options as shared
from precision_pin.cli.analyses import check_shared
from precision_pin.cli.exit_codes import EXIT_SPEC
from precision_pin.cli.inputs import PageOutput, echo_findings, read_sheet
from precision_pin.cli.options import compile_sampler, progress_bar
from precision_pin.cli.page_parts import part_files, part_options, read_parts
from precision_pin.cli.poses import AskedPose, pose_files, read_poses, specs_of
from precision_pin.cli.terminal import echo_note

if TYPE_CHECKING:
    from precision_pin.pages.view import ViewPose
    from precision_pin.sheet import Sheet
    from precision_pin.statistics import Specification


@click.command("view", cls=shared.SamplingCommand)
@shared.arm_options
@shared.sampling_option(
    "--samples", type=int, default=5_000, show_default=True, metavar="N", help="How many to show at a pose."
)
@shared.seed_option
@shared.model_option
@shared.spec_option
@part_options(layers=True)
@shared.headed_option("--factor", type=float, metavar="K", help="Exaggeration at first; chosen to be seen if left out.")
@shared.output_option(
    "--out",
    type=shared.FILE,
    metavar="PAGE.html",
    help="The page to write, or its folder; served to this machine's browser if left out.",
)
@shared.output_option("--port", type=int, metavar="P", help="Where to serve it; any free port if left out.")
@shared.output_option("--no-browser", is_flag=True, help="Serve it, but open no browser.")
@shared.all_warnings_option
@shared.quiet_option
def command(
    samples: int,
    factor: float | None,
    out: str | None,
    port: int | None,
    no_browser: bool,
    **arm: Any,
) -> int:
    """Show the arm and its sampled errors in 3-D, in a page that needs no network.

    Without arguments: the paper's arm and sheet. Several poses get a slider. With --spec the page says at its top whether
    the limit is kept by the robots it shows, and draws it. Without --out the page is served to this
    machine only, until Ctrl-C, and rebuilt whenever the sheet or the robot changes.

    Example: precision-pin view example:ur5 --spec "4 mm"
    """
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.pages.view import MOST_POINTS, MOST_POSES, check_factor, limits_kept, page
    from precision_pin.sampling import check_samples
    from precision_pin.statistics.plan import listed_specifications

    check_samples(samples)
    check_shared(arm)
    if samples > MOST_POINTS:
        raise InputError(f"--samples {samples} is more than a page can show; at most {MOST_POINTS}")
    if factor is not None:
        check_factor(factor)
    if out is not None and (port is not None or no_browser):
        option = "--no-browser" if port is None else "--port"
        raise InputError.of("E_USAGE", f"{option} is for a page that is served, without --out")
    files = arm["tables"] = [*pose_files(arm), *part_files(arm)]
    target = None if out is None else PageOutput(out, "view.html")
    if target is not None:
        target.check(files)
    verdicts: list[bool] = []

    def read() -> Sheet:
        return read_sheet(arm, None if target is None else target.outputs)

    def page_of(sheet: Sheet) -> str:
        specifications = listed_specifications(specs_of(sheet, arm, arm["specs"]))
        parts = read_parts(sheet, arm, layers=True, seed=arm["seed"])
        results = [(part, part.run()) for part in parts]
        layers = [layer for part, result in results for layer in part.layers(result, ErrorModel.from_sheet(sheet))]
        poses = read_poses(sheet, arm, MOST_POSES)
        if len(poses) > MOST_POSES:
            raise InputError(f"{len(poses)} poses; a page shows at most {MOST_POSES}")
        views, remarks = _sampled(poses, poses.noted_in(sheet), samples, specifications, arm)
        verdicts.append(limits_kept(views, specifications))
        return page(
            views,
            seed=arm["seed"],
            model_name=arm["model"],
            factor=factor,
            package_dirs=arm["package_dirs"],
            points=samples,
            specifications=specifications,
            headline=[line for part, result in results for line in part.headline(result)],
            remarks=remarks,
            layers=layers,
        )

    sheet = read()
    if target is None:
        from precision_pin.pages.view.live import serve

        known = [sheet]
        with unwinding():
            serve(
                lambda: page_of(known.pop() if known else read()),
                [Path(file) for file in (sheet.file, sheet.chain.robot.file, *files)],
                port=port or 0,
                open_browser=not no_browser,
                announce=lambda line: click.echo(line, err=True),
                tick=raise_if_interrupted,
            )
        return 0
    text = page_of(sheet)
    target.write(text)
    echo_note(f"wrote {target.path} ({len(text.encode()) / 1e6:.1f} MB)")
    return 0 if all(verdicts) else EXIT_SPEC


def _sampled(
    poses: Sequence[AskedPose], sheet: Sheet, samples: int, specifications: Sequence[Specification], arm: shared.Options
) -> tuple[list[ViewPose], list[str]]:
    """Return the errors of the same robots at every pose, and the shares that rest on assumptions; print warnings."""
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.pages.view import remarks_on, sample_views

    error_model = ErrorModel.from_sheet(sheet)
    compile_sampler(error_model.space, arm["model"])
    settings = {name: arm[name] for name in ("seed", "model")} | {"specifications": specifications}
    with progress_bar(samples * len(poses), "sampling") as progress:
        asked = [(pose.where, pose.name) for pose in poses]
        views, findings = sample_views(error_model, asked, samples=samples, progress=progress, **settings)
    echo_findings(_gathered(findings))
    return views, remarks_on(error_model, views)


def _gathered(findings: Sequence[tuple[Finding, ...]]) -> list[Finding]:
    """Return a pose's findings; for several poses the first of each code with the number of poses that have one."""
    if len(findings) == 1:
        return list(findings[0])
    first = {finding.code: finding for of_pose in reversed(findings) for finding in reversed(of_pose)}
    poses = Counter(code for of_pose in findings for code in {finding.code for finding in of_pose})
    return [
        replace(finding, message=f"{finding.message} (such a warning at {poses[code]} of {len(findings)} poses)")
        for code, finding in first.items()
    ]
