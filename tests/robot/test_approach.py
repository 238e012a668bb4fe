"""The direction of approach: how it is read, and what follows from the poses before."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.robot.approach import approaches_along, read_approach, written_approach

JOINTS = ("base", "upper arm", "wrist")


@pytest.mark.parametrize(
    "approach",
    [
        "base +, wrist -",
        " wrist - ,upper arm 0,  base +1",
        {"wrist": "-", "base": "+"},
        {"wrist": -1, "base": 1.0, "upper arm": 0},
        ["+", "0", "-"],
        (1, 0, -1),
        np.array([1, 0, -1], dtype=np.int8),
        np.array([1.0, 0.0, -1.0]),
        np.array(["+", "0", "-"]),
    ],
)
def test_every_way_to_write_one(approach: Any) -> None:
    found = read_approach(JOINTS, approach)
    assert found == (1, 0, -1)
    assert all(type(sign) is int for sign in found)
    assert written_approach(JOINTS, found) == {"base": "+", "wrist": "-"}


@pytest.mark.parametrize("approach", [(), [], {}])
def test_none(approach: Any) -> None:
    assert not any(read_approach(JOINTS, approach))


@pytest.mark.parametrize(
    ("approach", "message"),
    [
        ("wrst +", "no joint on the chain named 'wrst'; did you mean 'wrist'"),
        ({"elbow": "+"}, "no joint on the chain named 'elbow'"),
        ("wrist up", r"the approach of wrist must be \+, - or 0, got 'up'"),
        ("wrist", "'wrist' is no approach; write a joint and"),
        ("base +, base -", "the approach of the joint 'base' is given twice"),
        ({"base": 2}, "got 2"),
        ({"base": True}, "got True"),
        ({"base": None}, "got None"),
        ({"base": float("nan")}, "got nan"),
        ([1, -1], "2 directions of approach for 3 joints; expected base, upper arm, wrist"),
        (1, "an approach is"),
        (None, "an approach is"),
    ],
)
def test_a_wrong_one_is_told_in_a_line(approach: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_approach(JOINTS, approach)
    assert "\n" not in str(caught.value)


def test_an_unknown_joint_is_an_unknown_name() -> None:
    with pytest.raises(UnknownNameError):
        read_approach(JOINTS, {"elbow": "+"})


def test_from_the_poses_before() -> None:
    q = np.array(
        [
            [0.0, 0.1, 0.1, 0.1, -0.2],
            [1.0, 1.0, 1.0, 0.5, 0.5],
            [0.3, 0.3 + 1e-14, 0.3, 0.3, 0.3],
        ]
    )
    # a joint that rests keeps the direction of its last motion; before the first it is not known
    assert approaches_along(q).tolist() == [[0, 1, 1, 1, -1], [0, 0, 0, -1, -1], [0, 0, 0, 0, 0]]
    assert approaches_along(q[:, :1]).tolist() == [[0], [0], [0]]
