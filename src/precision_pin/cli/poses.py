"""The poses that a command line means: by name, by joint values, all of the sheet's, or those of a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, final

from precision_pin.cli.inputs import chosen_pose
from precision_pin.cli.options import PoseOptions
from precision_pin.errors import Finding, InputError, UnknownNameError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.robot.approach import ApproachedPose
    from precision_pin.sheet import Sheet

__all__ = ["AskedPose", "approach_poses", "check_poses", "read_poses"]

MOST_ROWS: Final = 2**20 - 1
"""The most poses of a trajectory where a command sets no lower bound: draws of pose scope can be made at no more."""


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

    where: str | NDArray[np.float64] | ApproachedPose | None
    name: str


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
    }
    given = [option for option, is_given in chosen.items() if is_given]
    if len(given) > 1:
        raise InputError([Finding("error", "E_USAGE", f"{given[0]} and {given[1]} exclude each other")])


def read_poses(sheet: Sheet, options: PoseOptions, most: int = MOST_ROWS) -> list[AskedPose]:
    """Return the poses that the options ask for, the sheet's first where they ask for none.

    Raises
    ------
    InputError
        No such pose, wrong joint values, a wrong trajectory or one of more than ``most`` poses, or a wrong approach.
    """
    poses = _read_poses(sheet, options, most)
    return poses if options["approach"] is None else approach_poses(sheet, poses, options["approach"])


def approach_poses(sheet: Sheet, poses: Sequence[AskedPose], approach: str) -> list[AskedPose]:
    """Return poses with the approach that ``--approach`` asks for.

    Raises
    ------
    InputError
        Wrong directions, or an approach from the previous pose of a single one.
    """
    import numpy as np

    from precision_pin.robot.approach import PREVIOUS, ApproachedPose, approaches_along, read_approach

    if approach != PREVIOUS:
        try:
            directions = read_approach(sheet.chain.joint_names, approach)
        except InputError as error:
            message = f"--approach: {error.findings[0].message}"
            raise InputError([Finding("error", "E_POSE", message)]) from None
        return [replace(pose, where=ApproachedPose(pose.where, directions)) for pose in poses]
    if len(poses) < 2:
        message = "--approach previous is the way from the pose before, and there is one pose; give + or - by joint"
        raise InputError([Finding("error", "E_POSE", message)])
    along = approaches_along(np.column_stack([_values(sheet, pose) for pose in poses]))
    return [
        replace(pose, where=ApproachedPose(pose.where, tuple(directions)))
        for pose, directions in zip(poses, along.T.tolist(), strict=True)
    ]


def _values(sheet: Sheet, pose: AskedPose) -> NDArray[np.float64]:
    """Return the joint values of a pose without an approach."""
    if isinstance(pose.where, str):
        if pose.where not in sheet.poses:
            raise UnknownNameError("pose", pose.where, sheet.poses)
        return sheet.poses[pose.where]
    return pose.where  # type: ignore[return-value]


def _read_poses(sheet: Sheet, options: PoseOptions, most: int) -> list[AskedPose]:
    """Return the poses without the approach of the command line."""
    if options["trajectory"] is not None:
        from precision_pin.cli.trajectory import read_trajectory

        way = read_trajectory(options["trajectory"], sheet.chain, most)
        return [AskedPose(values, name) for values, name in zip(way.values, way.names, strict=True)]
    if options["all_poses"] and not sheet.poses:
        raise InputError([Finding("error", "E_POSE", "the sheet has no poses", sheet.file)])
    if options["qs"]:
        return [AskedPose(chosen_pose(sheet, None, q), "") for q in options["qs"]]
    wanted = list(sheet.poses) if options["all_poses"] else options["pose_names"] or (None,)
    return [AskedPose(chosen_pose(sheet, name, None), name or next(iter(sheet.poses))) for name in wanted]
