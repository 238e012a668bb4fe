"""The poses of a command line: by name, by joint values, all of the sheet's, those of a trajectory or a grid."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from precision_pin.analyses.registry import SPECIFICATIONS, fitting_specs
from precision_pin.base.errors import Finding, InputError, UnknownNameError
from precision_pin.cli.inputs import chosen_pose
from precision_pin.cli.options import NO_SPECS, Options, progress_bar
from precision_pin.cli.terminal import echo_note, echo_warnings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.robot.configurations import ApproachedPose
    from precision_pin.robot.pose_set import PoseSet
    from precision_pin.robot.trajectory import Trajectory
    from precision_pin.sheet import Sheet

MOST_ROWS: Final = 2**20 - 1
"""Default limit of a trajectory or grid, the largest number of poses for draws of pose scope."""


@dataclass(frozen=True, eq=False)
class AskedPose:
    """A pose as for :meth:`precision_pin.model.error_model.ErrorModel.at`; a trajectory's has time or row as name."""

    where: str | NDArray[np.float64] | ApproachedPose | None
    name: str


class AskedPoses(list[AskedPose]):
    """The requested poses in order, with warnings about unreachable poses of a grid that are left out."""

    def __init__(self, poses: Iterable[AskedPose], left_out: tuple[Finding, ...] = ()) -> None:
        super().__init__(poses)
        self.left_out = left_out

    def noted_in(self, sheet: Sheet) -> Sheet:
        """Return a sheet with the warnings about poses that are left out, so that results include them."""
        return replace(sheet, findings=(*sheet.findings, *self.left_out))


def check_poses(options: Options) -> None:
    """Reject two ways to name poses at once, and steps without a trajectory."""
    flags = {"pose_names": "--pose", "all_poses": "--all-poses", "qs": "--q"}
    flags |= {"trajectory": "--trajectory", "grid": "--grid"}
    given = [flag for name, flag in flags.items() if options[name] not in (None, False, ())]
    if len(given) > 1:
        raise InputError.of("E_USAGE", f"{given[0]} and {given[1]} exclude each other")
    if options["steps"] and options["trajectory"] is None:
        raise InputError.of("E_USAGE", "--step needs a --trajectory, between whose rows it puts poses")


def pose_files(options: Options) -> list[str]:
    """Return the files of the poses, which no output may overwrite."""
    return [file for file in (options["trajectory"], options["grid"]) if file is not None]


def read_poses(sheet: Sheet, options: Options, most: int = MOST_ROWS) -> AskedPoses:
    """Return the requested poses, by default the sheet's first; unknown poses of a grid are left out with a warning."""
    poses = _read_poses(sheet, options, most)
    return poses if options["approach"] is None else approach_poses(sheet, poses, options["approach"])


def approach_poses(sheet: Sheet, poses: AskedPoses, approach: str) -> AskedPoses:
    """Return poses with the approach that ``--approach`` asks for."""
    import numpy as np

    from precision_pin.robot.configurations import ApproachedPose

    values = np.column_stack([pose_values(sheet, pose) for pose in poses])
    approached = [
        replace(pose, where=ApproachedPose(pose.where, tuple(directions)))
        for pose, directions in zip(poses, _approaches(sheet, values, approach).T.tolist(), strict=True)
    ]
    return AskedPoses(approached, poses.left_out)


def _approaches(sheet: Sheet, values: NDArray[np.float64], approach: str) -> NDArray[np.int8]:
    import numpy as np

    from precision_pin.robot.configurations import PREVIOUS, approaches_along, read_approach

    if approach == PREVIOUS:
        if values.shape[1] < 2:
            message = "--approach previous is the way from the pose before, and there is one pose; give + or - by joint"
            raise InputError.of("E_POSE", message)
        # an unreached pose of a grid is not on the path
        known = np.isfinite(values[0])
        approaches = np.zeros(values.shape, dtype=np.int8)
        approaches[:, known] = approaches_along(values[:, known])
        return approaches
    try:
        directions = read_approach(sheet.chain.joint_names, approach)
    except InputError as error:
        raise InputError.of("E_POSE", f"--approach: {error.findings[0].message}") from None
    return np.repeat(np.array(directions, dtype=np.int8)[:, None], values.shape[1], axis=1)


def pose_values(sheet: Sheet, pose: AskedPose) -> NDArray[np.float64]:
    """Return the joint values of a pose without its approach."""
    where = next(iter(sheet.poses)) if pose.where is None else pose.where
    if isinstance(where, str):
        if where not in sheet.poses:
            raise UnknownNameError("pose", where, sheet.poses)
        return sheet.poses[where]
    return where  # type: ignore[return-value]


def _read_poses(sheet: Sheet, options: Options, most: int) -> AskedPoses:
    """Return the poses without the approach of the command line."""
    if options["grid"] is not None:
        return _known_poses(read_grid(sheet, options["grid"], most), options["grid"])
    if options["trajectory"] is not None:
        way = read_way(sheet, options["trajectory"], options, most)
        return AskedPoses(AskedPose(values, name) for values, name in zip(way.values, way.names, strict=True))
    if options["all_poses"] and not sheet.poses:
        raise InputError.of("E_POSE", "the sheet has no poses", sheet.file)
    if options["qs"]:
        return AskedPoses(AskedPose(chosen_pose(sheet, None, q), "") for q in options["qs"])
    wanted = list(sheet.poses) if options["all_poses"] else options["pose_names"] or (None,)
    return AskedPoses(AskedPose(chosen_pose(sheet, name, None), name or next(iter(sheet.poses))) for name in wanted)


def specs_of(sheet: Sheet, options: Options, texts: Sequence[str], check: str = SPECIFICATIONS) -> tuple[str, ...]:
    """Return the limits to judge: those of ``--spec``, or else the sheet's that fit the command and all of its poses."""
    if texts:
        return () if tuple(texts) == NO_SPECS else tuple(texts)
    others = any(map(options.get, ("qs", "trajectory", "grid")))
    named = list(sheet.poses) if options.get("all_poses") else options.get("pose_names") or list(sheet.poses)[:1]
    fitting = fitting_specs(sheet, check)
    left_out = [spec for spec in fitting if spec.poses and (others or not {*named} <= {*spec.poses})]
    for spec in left_out:
        echo_note(f"the sheet's limit {spec.name or spec.text} is not judged: it is for {', '.join(spec.poses)} alone")
    return tuple(spec.text for spec in fitting if spec not in left_out)


def read_pose_set(sheet: Sheet, options: Options, most: int = MOST_ROWS) -> PoseSet:
    """Return the requested poses with their statuses and approaches, by default the sheet's first."""
    poses = _read_pose_set(sheet, options, most)
    approach = options["approach"]
    return poses if approach is None else replace(poses, approaches=_approaches(sheet, poses.q, approach))


def _read_pose_set(sheet: Sheet, options: Options, most: int) -> PoseSet:
    import numpy as np

    from precision_pin.robot.pose_set import PoseSet

    if options["grid"] is not None:
        return read_grid(sheet, options["grid"], most)
    if options["trajectory"] is not None:
        way = read_way(sheet, options["trajectory"], options, most)
        with progress_bar(len(way.rows), "poses", "poses") as step:
            return way.pose_set(step)
    asked = _read_poses(sheet, options, most)
    values = np.column_stack([pose_values(sheet, pose) for pose in asked])
    poses = PoseSet.at(sheet.chain, values, tuple(pose.name for pose in asked))
    approaches = [sheet.approaches.get(pose.name, ()) for pose in asked]
    if not any(approaches):
        return poses
    none = (0,) * len(sheet.chain.joints)
    return replace(poses, approaches=np.array([approach or none for approach in approaches], dtype=np.int8).T)


def read_way(sheet: Sheet, file: str, options: Options, most: int = MOST_ROWS) -> Trajectory:
    """Return the trajectory of a file, with the poses between its rows requested by ``--step``."""
    from precision_pin.base import units
    from precision_pin.robot.trajectory import read_trajectory

    size = os.path.getsize(file) if os.path.isfile(file) else 0
    with progress_bar(size, "reading", "B", 0 if size > 2**20 else 0.7) as progress:
        way = read_trajectory(file, sheet.chain, most, progress, columns_of(sheet, options, file))
    if way.recorder:
        echo_note(f"{file}: read as columns of {way.recorder}")
    kinds = {"time_step": units.TIME, "angle_step": units.ANGLE, "length_step": units.LENGTH}
    steps: dict[str, float] = {}
    for text in options["steps"]:
        kind = ""
        try:
            value = units.parse(text, *kinds.values())
            kind = next(kind for kind, quantity in kinds.items() if units.split(text)[1] in quantity.units)
            if kind in steps:
                raise InputError(f"a second step of {kinds[kind].name}")
            steps[kind] = value
            way.refined(**steps, most=most)
        except InputError as error:
            message = error.findings[0].message.removeprefix(f"{kind}: ")
            raise InputError.of("E_TRAJECTORY", f"--step {text!r}: {message}", file) from None
    return way.refined(**steps, most=most)


def columns_of(sheet: Sheet, options: Options, file: str) -> str:
    """Return what ``--columns`` says of a file, or else the sheet's measurements: :func:`columns_for` of all ``tables``."""
    from precision_pin.base.csv_columns import columns_for

    tables = options.get("tables", ())
    return columns_for(
        file, options.get("columns"), tables, (measurement.columns for measurement in sheet.measurements)
    )


def reference_pose(sheet: Sheet, text: str | None) -> str | NDArray[np.float64] | None:
    """Return the pose of ``--relative-to``: a name, or joint values as for ``--q``."""
    if text is None or text in sheet.poses:
        return text
    try:
        return chosen_pose(sheet, None, text)
    except InputError as error:
        unknown = UnknownNameError("pose", text, sheet.poses).findings[0].message
        message = f"--relative-to: {unknown}; as joint values: {error.findings[0].message.removeprefix('--q: ')}"
        raise InputError.of("E_POSE", message) from None


def read_grid(sheet: Sheet, file: str, most: int = MOST_ROWS) -> PoseSet:
    """Return the poses of a file for ``--grid``, including those without joint values."""
    from precision_pin.sheet.pose_grid import read_pose_grid

    grid = read_pose_grid(file, sheet.chain, sheet.poses)
    with progress_bar(grid.count, "inverse kinematics", "poses") as step:
        poses = grid.solve(step)
    if len(poses) > most:
        raise InputError.of("E_GRID", f"{len(poses):,} poses; at most {most:,} are allowed here", file)
    below = grid.singular_below
    stated = f" (singular: smallest singular value below {below:g})" if "singular" in poses.status else ""
    echo_note(f"{file}: {len(poses):,} poses: {poses.counts}{stated}")
    for note in sheet.chain.collision_notes if poses.obstructed else ():
        echo_note(str(note))
    return poses


def _known_poses(poses: PoseSet, file: str) -> AskedPoses:
    known = poses.known
    if not known.any():
        message = f"no joint values lead to any of the {len(poses):,} poses: {poses.counts}"
        raise InputError.of("E_GRID", message, file)
    known_poses = poses.of(known)
    asked = [AskedPose(values, name) for values, name in zip(known_poses.q.T, known_poses.names, strict=True)]
    if known.all():
        return AskedPoses(asked)
    warning = Finding("warning", "W_UNREACHED", poses.unreached, file)
    echo_warnings([warning])
    return AskedPoses(asked, (warning,))


def read_path(sheet: Sheet, file: str, options: Options) -> PoseSet:
    """Return the poses of a file as for ``--trajectory`` or ``--grid``."""
    is_grid = file.endswith((".yaml", ".yml"))
    return read_grid(sheet, file) if is_grid else read_way(sheet, file, {**options, "steps": ()}).poses
