"""Poses of a sheet with the direction in which each joint moved last."""

from __future__ import annotations

import numpy as np
import pytest

from precision_pin.model.error_model import ErrorModel
from sheet.conftest import Load, Refuse

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"
Q = "-90 3 88 -91 deg"
ALL = {"joint1": -90, "joint2": 3, "joint3": 88, "joint4": -91}


@pytest.mark.fast(4)
@pytest.mark.parametrize(
    ("pose", "approach"),
    [
        (f"{{q: {Q}, approach: {{joint2: +, joint4: -}}}}", (0, 1, 0, -1)),
        (f"{{q: {Q}, approach: 'joint2 +, joint4 -'}}", (0, 1, 0, -1)),
        (f"{{q: {Q}, approach: [0, +, 0, -]}}", (0, 1, 0, -1)),
        ("{q: [-90 deg, 3 deg, 88 deg, -91 deg], approach: {joint2: 1, joint4: '-1'}}", (0, 1, 0, -1)),
        ("{q: {joint1: -90 deg, joint2: 3 deg, joint3: 88 deg, joint4: -91 deg}, approach: joint1 -}", (-1, 0, 0, 0)),
        (f"{{q: {Q}}}", None),
        (f"{{q: {Q}, approach: {{}}}}", None),
        (f"{{q: {Q}, approach: joint1 0}}", None),
        (Q, None),
        ("[-90 deg, 3 deg, 88 deg, -91 deg]", None),
    ],
)
def test_every_way_to_write_one(load: Load, pose: str, approach: tuple[int, ...] | None) -> None:
    sheet = load(HEAD + f"poses: {{p: {pose}}}\n")
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [*ALL.values()], rtol=1e-15)
    assert sheet.approaches.get("p") == approach
    model = ErrorModel.from_sheet(sheet)
    assert model.at("p").posture.approach == model.at().posture.approach == (approach or ())
    assert next(model.at_many(["p"])).posture.approach == (approach or ())
    # joint values alone have none, and one that is given is taken instead
    assert model.at(sheet.poses["p"]).posture.approach == ()
    assert model.at("p", approach="joint3 -").posture.approach == (0, 0, -1, 0)


def test_from_the_pose_before(load: Load) -> None:
    text = HEAD + (
        "poses:\n"
        "  a: 0 0 0 0 deg\n"
        "  b: {q: 10 0 -5 0 deg, approach: previous}\n"
        "  c: 0 0 0 1 deg\n"
        "  d: {q: 0 3 0 1 deg, approach: previous}\n"
    )
    sheet = load(text)
    # joint 1 moved last from b to c, joint 3 too
    assert sheet.approaches == {"b": (1, 0, -1, 0), "d": (-1, 1, 1, 1)}


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (f"{{q: {Q}, approach: {{jont2: +}}}}", "no joint on the chain named 'jont2'; did you mean 'joint2'"),
        (f"{{q: {Q}, approach: {{joint2: up}}}}", "the approach of joint2 must be +, - or 0, got 'up'"),
        (f"{{q: {Q}, approach: {{joint2: {{a: +}}}}}}", "joint values"),
        (f"{{q: {Q}, approach: [+, -]}}", "2 directions of approach for 4 joints"),
        (f"{{q: {Q}, approach: joint2 +, joint3 -}}", "unknown key 'joint3 -' beside q: and approach:"),
        (f"{{q: {Q}, approach: previous}}", "the approach is from the previous pose, but this is the first"),
        (f"{{q: {Q}, aproach: previous}}", "unknown key 'aproach' beside q: and approach:"),
        ("{approach: joint2 +}", "approach: needs the joint values as q:"),
        ("{q: {joint1: [1 deg]}, approach: joint2 +}", "joint values"),
        ("{joint1: [1 deg]}", "expected joint values in chain order"),
        ("{q: 1 2 3 deg, approach: joint2 +}", "3 joint values for 4 joints"),
    ],
)
def test_a_wrong_one_is_one_line(refuse: Refuse, pose: str, message: str) -> None:
    (finding,) = refuse(HEAD + f"poses:\n  p: {pose}\n")
    assert message in finding.message
    assert finding.line == 4


def test_joints_named_as_the_keys_are_joints(load: Load, folder) -> None:
    text = (folder / "4dof.urdf").read_text(encoding="utf-8")
    renamed = text.replace('"joint1"', '"q"').replace('"joint2"', '"approach"')
    (folder / "named.urdf").write_text(renamed, encoding="utf-8")
    sheet = load(
        "precision-pin: 1\nrobot: named.urdf\nposes:\n  p: {q: 1 deg, approach: 2 deg, joint3: 3 deg, joint4: 4 deg}\n"
    )
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [1, 2, 3, 4])
    assert sheet.approaches == {}
