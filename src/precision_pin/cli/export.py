"""``precision-pin export``: robots as they may be built, as URDF files."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from precision_pin.base.errors import Finding, InputError, OutputError, visible
from precision_pin.cli.inputs import Outputs, chosen_pose, echo_findings, read_sheet
from precision_pin.cli.options import (
    FILE,
    Command,
    headed_option,
    one_pose_options,
    output_option,
    progress_bar,
    seed_option,
)
from precision_pin.cli.poses import AskedPose, AskedPoses, approach_poses
from precision_pin.cli.terminal import echo_note

if TYPE_CHECKING:
    from collections.abc import Iterator

    from precision_pin.writers.as_built import AsBuilt

FEW_UNITS: Final = 100
"""Number of units written without an estimate."""
TRIALS: Final = 4
LONG: Final = 10.0
LARGE: Final = 100_000_000
"""Seconds or bytes above which an estimate is printed."""


@click.command("export", cls=Command)
@one_pose_options
@headed_option("--units", type=int, default=1, show_default=True, metavar="N", help="How many robots.")
@headed_option("--first", type=int, default=0, show_default=True, metavar="K", help="Number of the first unit.")
@seed_option
@output_option("--out", type=FILE, required=True, metavar="DIR", help="The folder to write to.")
def command(units: int, first: int, seed: int, out: str, **arm: Any) -> None:
    """Write robots as they may be built, each sampled, as URDF files.

    NAME.unit0000.urdf and so on: the robot's own text with other placements in its joints; and units.csv with the error of
    each at the pose. The units are those that analyze samples. A file holds the errors of the built robot at every pose
    and all errors (loads, draws for a pose or a visit) at the export pose.

    Example: precision-pin export example:ur5 --units 3 --out built
    """
    from precision_pin.draws.space import check_seed
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.writers.as_built import MOST_UNITS, AsBuilt, describe_frozen, write_units

    check_seed(seed)
    if not 1 <= units <= MOST_UNITS:
        raise InputError(f"--units {units}: from 1 to {MOST_UNITS} robots can be written")
    if not 0 <= first <= 2**64 - units:
        raise InputError(f"--first {first}: units {first} to {first + units - 1} do not exist, from 0 to 2^64 - 1")
    folder = Path(out)
    outputs = Outputs(folder=out, names=("units.csv", "*.unit*.urdf"))
    outputs.check()
    sheet = read_sheet(arm, outputs)
    model = ErrorModel.from_sheet(sheet)
    pose = AskedPose(chosen_pose(sheet, arm["pose"], arm["q"]), "")
    if arm["approach"] is not None:
        (pose,) = approach_poses(sheet, AskedPoses([pose]), arm["approach"])
    writer = AsBuilt.prepare(model, pose.where, sheet=Path(sheet.file).name)
    echo_findings((*writer.at.findings("exact"), *model.statics_findings(writer.at)))
    robot = Path(sheet.chain.robot.file)
    echo_findings((*_added(writer), *_lost_meshes(writer, robot.parent, folder)))
    if units > FEW_UNITS:
        _estimate(writer, seed, first, units, folder)
    with progress_bar(units, "writing", "robots") as progress:
        names = write_units(writer, folder, first=first, units=units, seed=seed, progress=progress)
    more = f" to {names[-1]}" if units > 1 else ""
    echo_note(f"wrote {out}: units.csv, {names[0]}{more}")
    name = model.pose_name(pose.where)
    for note in describe_frozen(writer.frozen, f"the pose {visible(name)!r}" if name else "the export pose"):
        echo_note(note)


def _estimate(writer: AsBuilt, seed: int, first: int, units: int, folder: Path) -> None:
    seconds, largest = math.inf, 0
    started = time.perf_counter()
    for built in writer.units(seed, first, TRIALS):
        # the first units also prepare what the others share
        seconds = min(seconds, time.perf_counter() - started)
        largest = max(largest, len(built.text))
        started = time.perf_counter()
    home = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.is_dir())
    disk = os.statvfs(home)
    taken = units * (math.ceil(largest / disk.f_frsize) * disk.f_frsize + 300)  # bytes of a row of the table
    free = disk.f_bavail * disk.f_frsize
    what = f"{units:,} robots take {_size(taken)}"
    if taken > free or (disk.f_files > 0 and disk.f_favail <= units):
        room = f"{_size(free)} are free" if taken > free else f"room for {disk.f_favail:,} files is left"
        message = f"cannot write to the folder {folder}: {what}, and {room}; ask for fewer --units or another disk"
        raise OutputError(message)
    seconds *= units
    if taken >= LARGE or seconds >= LONG:
        duration = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
        echo_note(f"{what} of {_size(free)} that are free, and some {duration}")


def _size(size: float) -> str:
    unit, name = next(((unit, name) for unit, name in ((1e9, "GB"), (1e6, "MB")) if size >= unit), (1e3, "kB"))
    return f"{size / unit:.0f} {name}" if size >= 10 * unit else f"{size / unit:.1f} {name}"


def _added(writer: AsBuilt) -> Iterator[Finding]:
    """Yield a warning for each frame that replaces one of the chain's in the files."""
    chain = writer.at.posture.chain
    for what, name, new in (("tip", chain.tip, writer.tip), ("base", chain.base, writer.base)):
        if new != name:
            message = (
                f"no placement is between {name!r} and the joint next to it, so its own error is written as a fixed "
                f"frame {new!r}; take that as the {what}"
            )
            yield Finding("warning", "W_FRAME_ADDED", message, chain.robot.file)


def _lost_meshes(writer: AsBuilt, old: Path, new: Path) -> Iterator[Finding]:
    """Yield a warning if relative mesh names do not resolve from the new folder."""
    relative = [name for name in writer.original.meshes if "://" not in name and not os.path.isabs(name)]
    lost = [name for name in relative if os.path.isfile(old / name) and not os.path.isfile(new / name)]
    if lost:
        more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
        message = (
            f"mesh names are written as they are, and {lost[0]!r}{more} will not be found from {str(new)!r}: "
            f"copy the meshes there, or write to {str(old)!r}"
        )
        yield Finding("warning", "W_MESH_MISSING", message, writer.at.posture.chain.robot.file)
