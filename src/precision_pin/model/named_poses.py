"""The named poses of an error model, and the limits of joint values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.errors import Finding, InputError
from precision_pin.inputs.arguments import check_mapping
from precision_pin.robot.approach import Approach, ApproachedPose, read_approach
from precision_pin.robot.chain import Chain
from precision_pin.typing import Array

__all__ = ["limit_findings", "read_poses"]


def read_poses(
    chain: Chain, poses: Mapping[str, ArrayLike | Mapping[str, float] | ApproachedPose]
) -> tuple[dict[str, Array], dict[str, Approach]]:
    """Return joint values by the poses' names, and the approaches of those that have one."""
    found, approaches = {}, {}
    for name, q in check_mapping("the poses", poses).items():
        try:
            pose, approach = (q.pose, q.approach) if isinstance(q, ApproachedPose) else (q, ())
            found[name] = chain.configuration(pose)
            if own := read_approach(chain.joint_names, approach):
                approaches[name] = own
        except InputError as error:
            raise InputError(f"pose {name!r}: {error.findings[0].message}") from None
    return found, approaches


def limit_findings(chain: Chain, values: Array) -> tuple[Finding, ...]:
    """Return a warning if poses ``(n, P)`` are outside the joints' limits: their number, and the first of them."""
    outside = chain.configurations.outside(values)
    poses = np.flatnonzero(outside.any(axis=0))
    if not poses.size:
        return ()
    first = int(poses[0])
    joint = chain.joints[int(np.flatnonzero(outside[:, first])[0])]
    message = (
        f"{poses.size:,} of {values.shape[1]:,} poses are outside joint limits, the first of them pose {first}, with the joint "
        f"{joint.name} at {values[chain.joint_index(joint.name), first]:.6g} {'m' if joint.kind == 'prismatic' else 'rad'}"
    )
    return (Finding("warning", "W_JOINT_LIMIT", message, chain.robot.file, joint.line),)
