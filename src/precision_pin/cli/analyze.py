"""``precision-pin analyze``, at one pose or at several with the same robots at all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import click

from precision_pin.base.errors import Finding, visible
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli import options as shared
from precision_pin.cli.analyses import check_shared
from precision_pin.cli.exit_codes import EXIT_SPEC
from precision_pin.cli.inputs import Outputs, read_sheet, write_folder
from precision_pin.cli.options import compile_sampler, progress_bar, worker_options, working
from precision_pin.cli.poses import AskedPose, pose_files, read_poses, reference_pose, specs_of
from precision_pin.cli.terminal import echo_note, echo_result, echo_warning_lines, echo_warnings

if TYPE_CHECKING:
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sheet import Sheet

FILES: Final = ("analysis.json", "position.*", "attitude.*", "components.*", "zone.*")
"""Files written to a folder."""


@click.command("analyze", cls=shared.SamplingCommand)
@shared.arm_options
@shared.all_warnings_option
@shared.quiet_option
@shared.sampling_option(
    "--samples",
    type=int,
    metavar="N",
    help="Number of robots, 100,000 if left out; with --until the most, 1e9 if left out.",
)
@shared.seed_option
@shared.model_option
@shared.spec_option
@shared.headed_option(
    "--spec-everywhere", is_flag=True, help="Of several poses: a robot is inside only if it is at all of them."
)
@shared.headed_option(
    "--relative-to",
    metavar="POSE",
    help="Subtract the same robot's errors at this pose, a name or joint values as in --q; a taught frame turns too: --datum.",
)
@shared.headed_option(
    "--until", multiple=True, metavar='"95 % to 0.01 mm"', help="Sample until this precision is reached; repeats."
)
@worker_options
@shared.output_option(
    "--all", "is_whole", is_flag=True, help="Print min, max, mode, tolerance bounds, and of many poses every one."
)
@shared.json_option
@shared.plots_option
def command(samples: int | None, until: tuple[str, ...], **arm: Any) -> int:
    """Sample the pose error of an arm at a pose, or of the same robots at several.

    At several poses a specification is met only if it is met at every one. With --relative-to the errors of the
    same robots at another pose are subtracted; what follows a frame that is taught there and turns is a taught datum.

    Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME. The result does not
    depend on what samples it: threads, processes or a cluster, at one go or resumed.
    """
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.robot.datums import COMPENSATED
    from precision_pin.sampling import check_samples, monte_carlo
    from precision_pin.sampling.one_pose import relative
    from precision_pin.sampling.table import analysis_table
    from precision_pin.statistics.plan import listed_specifications
    from precision_pin.statistics.precision import target

    samples = samples if samples is not None else 10**9 if until else 100_000
    check_samples(samples)
    for text in until:
        target(text)
    check_shared(arm)
    relative_to, out = arm["relative_to"], arm["out"]
    if relative_to is not None:
        at_one = {"--until": until, **{f"--{name}": arm[name] for name in ("processes", "dask", "journal")}}
        at_one["--spec-everywhere"] = arm["spec_everywhere"]
        wrong = next((option for option, value in at_one.items() if value), None)
        if wrong is not None:
            raise click.UsageError(f"{wrong} and --relative-to exclude each other; leave one of them out")
    may_be_several = arm["all_poses"] or pose_files(arm) or max(len(arm["pose_names"]), len(arm["qs"])) > 1
    outputs = Outputs(
        {"--journal": arm["journal"], "--json": arm["json_path"]},
        out,
        (*FILES, *(("poses.json",) if may_be_several else ())),
    )
    outputs.check(pose_files(arm))
    sheet = read_sheet(arm, outputs)
    arm["specs"] = listed_specifications(specs_of(sheet, arm, arm["specs"]))
    if arm["spec_everywhere"] and not arm["specs"]:
        raise click.UsageError("--spec-everywhere needs a --spec")
    poses = read_poses(sheet, arm)
    sheet = poses.noted_in(sheet)
    error_model = ErrorModel.from_sheet(sheet)
    if sheet.estimates is not None and COMPENSATED not in sheet.datum:
        datums = ",".join((*sheet.datum, COMPENSATED))
        echo_note(f"errors of a robot driven by its nominal model; driven by the calibrated one: --datum {datums}")
    if len(poses) > 1:
        for_one = {"--until": until, "--relative-to": relative_to}
        given = [option for option, value in for_one.items() if value]
        if given:
            are = "are" if len(given) > 1 else "is"
            raise click.UsageError(
                f"{' and '.join(given)} {are} for one pose, and {len(poses):,} are given; leave one or the other out"
            )
        return _analyze_poses(error_model, sheet, poses, samples, arm)
    where = poses[0].where
    other = reference_pose(sheet, relative_to)
    compile_sampler(error_model.space, arm["model"])
    asked = {name: arm[name] for name in ("seed", "model")}
    asked |= {"samples": samples, "specifications": arm["specs"], "findings": sheet.findings}
    if other is not None:
        with progress_bar(samples, "sampling") as progress, unwinding():
            analysis = relative(error_model, where, other, threads=arm["threads"], progress=progress, **asked)
            raise_if_interrupted()
    else:
        with working(arm) as workers, progress_bar(samples, "sampling") as progress:
            files = {"sheet": sheet.file}
            analysis = monte_carlo(error_model, where, until=until, files=files, progress=progress, **asked, **workers)
    echo_warning_lines(analysis.warnings[len(sheet.findings) :])
    echo_result(
        analysis, arm["json_path"], lambda: analysis_table(analysis, is_whole=arm["is_whole"]), is_answered=True
    )
    if out is not None:
        from precision_pin.sampling.figures import figures_across, figures_of

        figures = figures_of(analysis.summary, analysis.seed, analysis.arm)
        if other is None:
            of, at = analysis.summary, error_model.at(where)
            drawn = figures_across(at, analysis.arm, of.specifications, of.samples, analysis.seed, arm["model"])
            figures |= drawn
        write_folder(out, "analysis", analysis, figures)
        *names, last = figures
        echo_note(f"wrote {out}: analysis.json, {', '.join(names)} and {last} as PNG and SVG")
    return 0 if all(result.met for result in analysis.summary.specifications) else EXIT_SPEC


def _analyze_poses(
    error_model: ErrorModel, sheet: Sheet, poses: Sequence[AskedPose], samples: int, arm: shared.Options
) -> int:
    """Sample at several poses, print and write the result; returns the exit code."""
    from precision_pin.sampling.many_poses import sample_poses
    from precision_pin.sampling.table import poses_table

    compile_sampler(error_model.space, arm["model"])
    findings = _find(error_model, poses, arm["model"])
    echo_warnings(findings)
    steps = (2 if arm["spec_everywhere"] else 1) * samples * len(poses)
    with working(arm) as workers, progress_bar(steps, "sampling") as progress:
        result = sample_poses(
            error_model, [pose.where for pose in poses], samples=samples, seed=arm["seed"], model=arm["model"],
            specifications=arm["specs"], everywhere=arm["spec_everywhere"],
            findings=(*sheet.findings, *findings), files={"sheet": sheet.file}, progress=progress, **workers,
        )  # fmt: skip
    result = replace(result, names=tuple(pose.name for pose in poses))
    echo_result(result, arm["json_path"], lambda: poses_table(result, is_whole=arm["is_whole"]), is_answered=True)
    if arm["out"] is not None:
        from precision_pin.sampling.figures import figures_across

        figures = {quantity: result.plot(quantity) for quantity in ("position", "attitude")}
        worst = result.worst_pose
        limits = [of.results[worst] for of in result.specification_results]
        where = f"{visible(result.robot, 60)} at the worst pose"
        at = error_model.at(poses[worst].where)
        drawn = figures_across(at, where, limits, samples, result.seed, arm["model"], worst)
        write_folder(arm["out"], "poses", result, figures | drawn)
        and_zone = ", zone at the worst" if drawn else ""
        echo_note(f"wrote {arm['out']}: poses.json, position and attitude over the poses{and_zone} as PNG and SVG")
    return 0 if result.met else EXIT_SPEC


def _find(error_model: ErrorModel, poses: Sequence[AskedPose], model: Any) -> tuple[Finding, ...]:
    """Return the warnings at each pose, as for its analysis; beyond the first 200, those about joint limits."""
    from precision_pin.render.tables import pose_labels
    from precision_pin.sampling.verdict_grounds import MOST_POSES, exact_findings

    findings = []
    for rank, (pose, label) in enumerate(zip(poses, pose_labels([pose.name for pose in poses]), strict=True)):
        if rank < MOST_POSES:
            at = error_model.at(pose.where)
            here = (*at.findings(model), *error_model.statics_findings(at))
        else:
            here = error_model.chain.at(error_model.configuration(pose.where)).findings
        where = f"pose {pose.name!r}" if pose.name else label
        findings += [replace(finding, message=f"{where}: {finding.message}") for finding in here]
        raise_if_interrupted()
    asked = [pose.where for pose in poses]
    values, _ = error_model.configurations(asked)
    return (*findings, *exact_findings(error_model, values, error_model.approaches_of(asked, values)))
