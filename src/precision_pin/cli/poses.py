"""The poses that a command line means: by name, by joint values, all of the sheet's, or those of a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, final

from precision_pin.cli.inputs import chosen_pose
from precision_pin.cli.options import PoseOptions
from precision_pin.errors import Finding, InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.sheet import Sheet

__all__ = ["MOST_ROWS", "AskedPose", "check_poses", "read_pose_set", "read_poses"]

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

    where: str | NDArray[np.float64] | None
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
        No such pose, wrong joint values, a wrong trajectory or one of more than ``most`` poses.
    """
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
