from __future__ import annotations

from precision_pin.sources import joint_offset
from support.checks.places import check_joint_offset


def test_the_arm_stands_where_other_joint_values_put_it():
    check_joint_offset(joint_offset)
