"""``precision-pin analyze`` at several poses: the same robots at all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, cast, final

import click

from precision_pin.base.errors import Finding
from precision_pin.base.files import whole_folder, write_text
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.notes import echo_note, echo_warnings
from precision_pin.cli.options import Options
from precision_pin.cli.poses import AskedPose
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.terminal import echo_table
from precision_pin.cli.workers import working
from precision_pin.render.tables import pose_labels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sampling.poses_result import PosesResult
    from precision_pin.sheet import Sheet
    from precision_pin.statistics import Specification

FILES: Final = ("poses.json", "position.*", "attitude.*")
"""Files written to a folder."""


@final
@dataclass(frozen=True)
class PosesJob:
    """What to sample at every pose, on what, and where the result is written."""

    samples: int
    seed: int
    model: Literal["exact", "linear"]
    specifications: tuple[Specification, ...]
    everywhere: bool
    on: Options
    is_whole: bool
    json_path: str | None
    out: str | None


def refuse_of_one_pose(options: Sequence[str], poses: int) -> None:
    """Refuse options that are for one pose.

    Raises:
        UsageError: There is one.
    """
    if options:
        are = "are" if len(options) > 1 else "is"
        raise click.UsageError(
            f"{' and '.join(options)} {are} for one pose, and {poses:,} are given; leave one or the other out"
        )


def analyze_poses(error_model: ErrorModel, sheet: Sheet, poses: Sequence[AskedPose], job: PosesJob) -> int:
    """Sample at several poses, print and write the result; returns the exit code."""
    from precision_pin.analyses.monte_carlo.table import poses_table
    from precision_pin.sampling.many_poses import sample_poses

    compile_sampler(error_model.space, job.model)
    found = _find(error_model, poses, job.model)
    echo_warnings(found)
    passes = 2 if job.everywhere else 1
    steps = passes * job.samples * len(poses)
    with working(job.on) as workers, progress_bar(steps, "sampling") as progress:
        result = sample_poses(
            error_model, [pose.where for pose in poses], samples=job.samples, seed=job.seed, model=job.model,
            specifications=job.specifications, everywhere=job.everywhere, findings=(*sheet.findings, *found),
            files={"sheet": sheet.file}, progress=progress, **workers,
        )  # fmt: skip
    result = replace(result, names=tuple(pose.name for pose in poses))
    if job.json_path == "-":
        echo_data(result.to_json())
    else:
        echo_table(poses_table(result, is_whole=job.is_whole), is_answered=True)
    if job.json_path is not None and job.json_path != "-":
        write_text(Path(job.json_path), result.to_json() + "\n")
    if job.out is not None:
        _write_folder(result, Path(job.out))
        echo_note(f"wrote {job.out}: poses.json, position and attitude over the poses as PNG and SVG")
    return 0 if result.met else EXIT_SPEC


def _find(
    error_model: ErrorModel, poses: Sequence[AskedPose], model: Literal["exact", "linear"]
) -> tuple[Finding, ...]:
    """Return the warnings at each pose, as an analysis of it has them; beyond the first 200, those about joint limits."""
    from precision_pin.model.verdict_grounds import MOST_POSES, exact_findings

    found = []
    for rank, (pose, label) in enumerate(zip(poses, pose_labels([pose.name for pose in poses]), strict=True)):
        if rank < MOST_POSES:
            at = error_model.at(pose.where)
            here = (*at.findings(model), *error_model.statics_findings(at))
        else:
            here = error_model.chain.at(error_model.configuration(pose.where)).findings
        where = f"pose {pose.name!r}" if pose.name else label
        found += [replace(finding, message=f"{where}: {finding.message}") for finding in here]
        raise_if_interrupted()
    asked = [pose.where for pose in poses]
    values, _ = error_model.configurations(asked)
    return (*found, *exact_findings(error_model, values, error_model.approaches_of(asked, values)))


def _write_folder(result: PosesResult, folder: Path) -> None:
    from precision_pin.sampling.figures import save

    with whole_folder(folder) as stage:
        write_text(stage / "poses.json", result.to_json() + "\n")
        for quantity in ("position", "attitude"):
            save(cast("Figure", result.plot(quantity)), stage / quantity)
