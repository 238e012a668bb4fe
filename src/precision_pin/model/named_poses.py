"""The named poses of an error model."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import ArrayLike

from precision_pin.base.arguments import check_mapping
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.approach import Approach, ApproachedPose, read_approach
from precision_pin.robot.chain import Chain


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
