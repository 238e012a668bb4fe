"""Provenance of an analysis, its poses, and the checks of arguments that all analyses share."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.versions import versions
from precision_pin.model.compliance import ElasticPose
from precision_pin.model.datum import DatumRecord, datum_text
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import OriginShares, PoseModel, origin_shares
from precision_pin.render.tables import origins_entry, resting_on
from precision_pin.robot.configurations import ApproachedPose, approach_entry, written_approach
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling.run import check_common

Pose = ArrayLike | Mapping[str, float] | ApproachedPose | str | None
"""Name of a pose, or joint values in chain order or by name, with or without an approach; ``None``: the first pose."""


@dataclass(frozen=True)
class Provenance:
    """Robot, seed and software versions of a result.

    Attributes:
        robot, base, tip: File name of the URDF, and the ends of the chain.
        statics: ``"nominal"`` or ``"equilibrium"``.
        seed: 64-bit seed of all samples; None for an analysis that draws nothing.
        assumed: Labels of the sources that the sheet marks as assumptions.
        sources: Number of sources.
        origins, origins_at: Fraction of the first-order variance of position and attitude by provenance, empty where
            the sheet states none; and the pose where it was computed, the model's first.
        datum: What the errors are counted against; None for base axes.
        versions: Versions of Python and the libraries that computed the result.
    """

    robot: str
    base: str
    tip: str
    statics: str
    seed: int | None
    assumed: tuple[str, ...] = ()
    sources: int = 0
    origins: OriginShares = field(default_factory=dict)
    origins_at: str = ""
    datum: DatumRecord | None = None
    versions: Mapping[str, str] = field(default_factory=versions, compare=False)

    @classmethod
    def of(cls, error_model: ErrorModel, seed: int | None = None) -> Provenance:
        """Return the provenance of a model's analysis."""
        chain = error_model.chain
        arm = (os.path.basename(chain.robot.file), chain.base, chain.tip_label, error_model.statics)
        first = next(iter(error_model.poses), "")
        shares: OriginShares = {}
        if first and any(error_model.origins.values()):
            shares = origin_shares(error_model.origins, next(error_model.at_columns(error_model.poses[first][:, None])))
        seed_number = seed if seed is None else int(seed)
        assumed, datum = error_model.assumed, error_model.datum_record()
        return cls(*arm, seed_number, assumed, len(error_model.sources), shares, first if shares else "", datum)

    @property
    def arm(self) -> str:
        """Robot and ends of the chain as text."""
        return f"{self.robot}: {self.base} to {self.tip}{datum_text(self.datum)}"

    @property
    def resting_lines(self) -> list[str]:
        """Lines of :func:`resting_on`."""
        return resting_on(self.assumed, self.sources, self.origins, self.origins_at)

    def to_dict(self, schema: str) -> dict[str, Any]:
        """Return the first keys of a result's JSON."""
        arm = {"robot": self.robot, "base": self.base, "tip": self.tip, "axes": "base", "datum": self.datum}
        arm |= {"statics": self.statics}
        run = {"seed": self.seed, "assumed": list(self.assumed), **origins_entry(self.origins)}
        return {"schema": schema, "complete": True, **arm, **run, "versions": dict(self.versions)}


@dataclass(frozen=True)
class PoseLabel:
    """Name and joint values of a pose.

    Attributes:
        name: Empty for a pose without a name.
        q: Value of each joint, rad or m.
        sliding_joints: Joints whose values are in m.
        approach: ``+`` or ``-`` for each joint whose last direction of motion is known.
    """

    name: str
    q: Mapping[str, float]
    sliding_joints: tuple[str, ...] = ()
    approach: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, error_model: ErrorModel, pose: Pose, at: PoseModel | ElasticPose) -> PoseLabel:
        """Return the label of a pose."""
        chain = error_model.chain
        return cls(
            error_model.pose_name(pose),
            dict(zip(chain.joint_names, map(float, at.posture.q), strict=True)),
            tuple(joint.name for joint in chain.joints if joint.kind == "prismatic"),
            written_approach(chain.joint_names, at.posture.approach),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the pose as in the JSON."""
        return {"name": self.name, "q": dict(self.q), **approach_entry(self.approach)}


Poses = Pose | Sequence[Pose]
"""One pose or a list of poses."""


def listed_poses(poses: Poses) -> list[Pose]:
    """Return a list of poses: a row of numbers is one pose, any other list contains several."""
    if isinstance(poses, np.ndarray) and poses.ndim > 1:
        raise InputError(
            f"poses in an array of shape {poses.shape}: give a list of poses instead, list(array) for poses in rows, "
            "list(array.T) for poses in columns"
        )
    numbers = isinstance(poses, list | tuple) and all(isinstance(entry, int | float | np.number) for entry in poses)
    is_row = (numbers and len(poses) > 0) or (isinstance(poses, np.ndarray) and poses.ndim == 1 and poses.size > 0)  # type: ignore[arg-type]
    pose_list: list[Pose] = (
        list(poses) if isinstance(poses, list | tuple | np.ndarray) and not is_row else [poses]  # type: ignore[list-item]
    )
    if not pose_list:
        raise InputError("0 poses are given; give at least one, or none for the model's first pose")
    return pose_list


def check_request(error_model: ErrorModel, poses: Poses, **common: Any) -> tuple[list[Pose], tuple[Finding, ...]]:
    """Check the arguments of an analysis at poses; return poses and findings."""
    check_findings = check_common(error_model, **common)
    return listed_poses(poses), check_findings


PosesGiven = PoseSet | ArrayLike | Mapping[str, ArrayLike] | Sequence[object]


def pose_set(error_model: ErrorModel, poses: PosesGiven) -> PoseSet:
    """Return poses given in any form as a pose set.

    Raises:
        InputError: Wrong joint values, or a pose set of another number of joints.
        UnknownNameError: No such pose or joint.
    """
    if isinstance(poses, PoseSet):
        if len(poses.q) != len(error_model.chain.joints):
            raise InputError(
                f"the pose set has {len(poses.q)} joints, the chain has {len(error_model.chain.joints)}; make it for this chain"
            )
        return poses
    values, names = error_model.configurations(poses)
    return replace(PoseSet.at(error_model.chain, values, names), approaches=error_model.approaches_of(poses, values))


def approached(poses: PoseSet) -> list[Array | ApproachedPose]:
    """Return the poses of a set as the model takes them, each with its approach if it has one."""
    if poses.approaches is None:
        return list(poses.q.T)
    return [ApproachedPose(*row) for row in zip(poses.q.T, map(tuple, poses.approaches.T.tolist()), strict=True)]
