"""The poses that a command line means: by name, by joint values, all of the sheet's, those of a trajectory or a grid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, final

from precision_pin.cli.inputs import chosen_pose
from precision_pin.cli.notes import echo_note, echo_warnings
from precision_pin.cli.options import PoseOptions
from precision_pin.cli.progress import progress_bar
from precision_pin.errors import Finding, InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.sheet import Sheet

__all__ = ["MOST_ROWS", "AskedPose", "AskedPoses", "check_poses", "pose_files", "read_pose_set", "read_poses"]

MOST_ROWS: Final = 2**20 - 1
"""The most poses of a trajectory or a grid where a command sets no lower bound: draws of pose scope can be made at no more."""


@final
@dataclass(frozen=True, eq=False)
class AskedPose:
    """A requested pose.

    Attributes
    ----------
    where
        As :meth:`precision_pin.model.error_model.ErrorModel.at` takes it.
    name
        Its name, or its time or row in a trajectory; empty where it has none.
    """

    where: str | NDArray[np.float64] | None
    name: str


@final
class AskedPoses(list[AskedPose]):
    """The requested poses in order.

    Attributes
    ----------
    left_out
        Warnings about poses of a grid that are not among them, since no joint values lead there.
    """

    def __init__(self, poses: Iterable[AskedPose], left_out: tuple[Finding, ...] = ()) -> None:
        super().__init__(poses)
        self.left_out = left_out

    def noted_in(self, sheet: Sheet) -> Sheet:
        """Return a sheet with the warnings about poses that are left out, so that they get into results."""
        return replace(sheet, findings=(*sheet.findings, *self.left_out))


def check_poses(options: PoseOptions) -> None:
    """Refuse two ways to name poses at once.

    Raises
    ------
    InputError
        More than one is given.
    """
    chosen = {
        "--pose": bool(options["pose_names"]),
        "--all-poses": options["all_poses"],
        "--q": bool(options["qs"]),
        "--trajectory": options["trajectory"] is not None,
        "--grid": options["grid"] is not None,
    }
    given = [option for option, is_given in chosen.items() if is_given]
    if len(given) > 1:
        raise InputError([Finding("error", "E_USAGE", f"{given[0]} and {given[1]} exclude each other")])


def pose_files(options: PoseOptions) -> list[str]:
    """Return the files that hold the poses, which no output may overwrite."""
    return [file for file in (options["trajectory"], options["grid"]) if file is not None]


def read_poses(sheet: Sheet, options: PoseOptions, most: int = MOST_ROWS) -> AskedPoses:
    """Return the poses that the options ask for, the sheet's first where they ask for none.

    Poses of a grid whose joint values are not known are left out, with a warning.

    Raises
    ------
    InputError
        No such pose, wrong joint values, a wrong trajectory or grid, or one of more than ``most`` poses.
    """
    if options["grid"] is not None:
        return _known_poses(_read_grid(sheet, options["grid"], most), options["grid"])
    if options["trajectory"] is not None:
        from precision_pin.cli.trajectory import read_trajectory

        way = read_trajectory(options["trajectory"], sheet.chain, most)
        return AskedPoses(AskedPose(values, name) for values, name in zip(way.values, way.names, strict=True))
    if options["all_poses"] and not sheet.poses:
        raise InputError([Finding("error", "E_POSE", "the sheet has no poses", sheet.file)])
    if options["qs"]:
        return AskedPoses(AskedPose(chosen_pose(sheet, None, q), "") for q in options["qs"])
    wanted = list(sheet.poses) if options["all_poses"] else options["pose_names"] or (None,)
    return AskedPoses(AskedPose(chosen_pose(sheet, name, None), name or next(iter(sheet.poses))) for name in wanted)


def read_pose_set(sheet: Sheet, options: PoseOptions, most: int = MOST_ROWS) -> PoseSet:
    """Return the poses that the options ask for with the status of each, the sheet's first where they ask for none.

    Raises
    ------
    InputError
        As :func:`read_poses`.
    """
    import numpy as np

    from precision_pin.errors import UnknownNameError
    from precision_pin.robot.pose_set import PoseSet

    if options["grid"] is not None:
        return _read_grid(sheet, options["grid"], most)
    if options["trajectory"] is not None:
        from precision_pin.cli.trajectory import read_trajectory

        way = read_trajectory(options["trajectory"], sheet.chain, most)
        return PoseSet.at(sheet.chain, np.ascontiguousarray(way.values.T), way.names, way.times)
    columns = []
    asked = read_poses(sheet, options)
    for pose in asked:
        where = pose.name if pose.where is None else pose.where
        if isinstance(where, str):
            if where not in sheet.poses:
                raise UnknownNameError("pose", where, sheet.poses)
            where = sheet.poses[where]
        columns.append(where)
    names = tuple(pose.name for pose in asked)
    return PoseSet.at(sheet.chain, np.column_stack(columns), names)


def _read_grid(sheet: Sheet, file: str, most: int) -> PoseSet:
    from precision_pin.sheet.pose_grid import read_pose_grid

    grid = read_pose_grid(file, sheet.chain, sheet.poses)
    with progress_bar(grid.count, "inverse kinematics", "poses") as step:
        poses = grid.solve(step)
    if len(poses) > most:
        raise InputError([Finding("error", "E_GRID", f"{len(poses):,} poses; at most {most:,} are allowed here", file)])
    echo_note(f"{file}: {len(poses):,} poses: {_counted(poses.status)}")
    return poses


def _known_poses(poses: PoseSet, file: str) -> AskedPoses:
    """Return the poses with joint values, and a warning about the others.

    Raises
    ------
    InputError
        None has.
    """
    known = poses.known
    if not known.any():
        message = f"no joint values lead to any of the {len(poses):,} poses: {_counted(poses.status)}"
        raise InputError([Finding("error", "E_GRID", message, file)])
    asked = [
        AskedPose(values, name)
        for values, name, is_known in zip(poses.q.T, poses.names, known, strict=True)
        if is_known
    ]
    if known.all():
        return AskedPoses(asked)
    out = poses.of(~known)
    first = f"first {out.names[0]!r}" if len(out) > 1 else repr(out.names[0])
    message = f"{len(out):,} of {len(poses):,} poses are left out: {_counted(out.status)} ({first})"
    warning = Finding("warning", "W_UNREACHED", message, file)
    echo_warnings([warning])
    return AskedPoses(asked, (warning,))


def _counted(statuses: Sequence[str]) -> str:
    return ", ".join(f"{count:,} {status}" for status, count in Counter(statuses).items())
