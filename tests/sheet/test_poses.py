"""Files of poses: the same grids as in Python, one line for each mistake; poses with the direction of each joint's last move."""

from __future__ import annotations

import math

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet.pose_grid import read_pose_grid

from .conftest import Load


@pytest.fixture(scope="module")
def chain() -> Chain:
    return pp.ErrorModel.load(PAPER_SHEET).chain


PAPER = np.radians([-90, 3, 88, -91])


def solved(tmp_path, chain, text):
    (tmp_path / "grid.yaml").write_text(text)
    grid = read_pose_grid(tmp_path / "grid.yaml", chain, {"paper": PAPER})
    return grid.count, grid.solve(None)


def test_a_grid_over_joint_values(tmp_path, chain):
    text = """
joints:
  joint4: 0 rad
  joint2: [10 deg, 0.5 rad]
  joint1: {from: -90 deg, to: 90 deg, count: 3}
  joint3: 0 30 deg
"""
    count, poses = solved(tmp_path, chain, text)
    assert count == 0
    expected = [
        (a, b, c, 0) for a in (-math.pi / 2, 0, math.pi / 2) for b in (math.pi / 18, 0.5) for c in (0, math.pi / 6)
    ]
    np.testing.assert_allclose(poses.q.T, expected, atol=1e-15)


@pytest.mark.slow
def test_grids_over_places_are_those_of_python(tmp_path, chain):
    down = pp.Orientation.along((0, 0, -1), tool_axis=(1, 0, 0))
    text = """
box: {x: {from: 1 m, to: 2000 mm, count: 2}, y: 30 cm, z: [0.2 m, 0.4 m]}
orientations: [{axis: 0 0 -1, tool_axis: 1 0 0}, any]
branches: all
reference: paper
"""
    count, poses = solved(tmp_path, chain, text)
    places = pp.box_places([1, 2], 0.3, [0.2, 0.4])
    same = pp.place_grid(chain, places, [down, pp.Orientation.free()], branches="all", reference=PAPER)
    assert count == 8
    np.testing.assert_array_equal(poses.q, same.q)
    assert poses.names == same.names
    assert set(poses.status) == {"reached"}
    text = """
plane:
  origin: 2 0 0.3 m
  u: {direction: 0 2 0, values: -400 400 mm}
  v: {direction: 0 0 1, values: 0 mm}
orientations:
  - {pose: paper}
  - {rpy: 0 90 0 deg}
  - {axis: 1 0 0, angles: 2}
"""
    count, poses = solved(tmp_path, chain, text)
    assert count == 8
    np.testing.assert_allclose(poses.position[:, poses.node == 5].T, [[2, 0.4, 0.3]] * 2, atol=1e-15)
    assert [name.split(", ")[1] for name in poses.names[:4]] == [
        "pose paper",
        "rpy 0 90 0°",
        "axis 1 0 0",
        "axis 1 0 0",
    ]


@pytest.mark.slow
def test_random_poses_are_those_of_python(tmp_path, chain):
    text = """
random: {count: 20, seed: 5, box: {x: 1 2 m, y: -1000 1000 mm, z: 0 0.5 m}}
orientations: [any, {axis: 0 0 -1, tool_axis: 1 0 0}]
"""
    count, poses = solved(tmp_path, chain, text)
    kinds = [pp.Orientation.free(), pp.Orientation.along((0, 0, -1), tool_axis=(1, 0, 0))]
    same = pp.random_poses(chain, 20, seed=5, box=[[1, 2], [-1, 1], [0, 0.5]], orientations=kinds)
    assert count == 20
    np.testing.assert_array_equal(poses.q, same.q)
    assert len(solved(tmp_path, chain, "random: {count: 30}")[1]) == 30


BOX = "box: {x: 1 m, y: 0 m, z: 0 m}\n"
JOINTS = "joints:\n  joint1: 0 deg\n  joint2: 0 deg\n  joint3: 0 deg\n"


@pytest.mark.fast(12)
@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "a grid has one of joints, box, plane, random; got nothing"),
        ("boxes: {}", 1, "unknown key 'boxes': did you mean 'box'?"),
        ("branches: all", 1, "a grid has one of joints, box, plane, random; this has none"),
        (f"{BOX}joints: {{}}", 1, "this has joints and box"),
        (f"{JOINTS}  joint4: 0 deg\norientations: any", 6, "orientations goes with box or plane, not with joints"),
        (JOINTS, 1, "no values for the joints joint4"),
        (f"{JOINTS}  joint4: 0 mm", 5, "joint4: 'mm' in '0 mm' is not a unit of angle; allowed: rad"),
        (f"{JOINTS}  joint4: []", 5, "joint4: no values; give at least one, such as '30 deg'"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg, count: 1}}", 5, "count: expected a whole number from 2 to 1,048,575"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg, step: 1 deg}}", 5, "unknown key 'step': valid: count, from, to"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg}}", 5, "{from: 30 deg, to: 90 deg, count: 7}; count missing"),
        ("box: {x: 1 m, y: 1 m}\norientations: any", 1, "box: expected x, y and z, each with its values; z missing"),
        (BOX, 1, "the key 'orientations' is missing; an orientation is any, {rpy: 180 0 0 deg}"),
        (f"{BOX}orientations: []", 2, "no orientations; an orientation is any"),
        (f"{BOX}orientations: {{axis: 0 0 1, rpy: 0 0 0 deg}}", 2, "this has rpy and axis"),
        (f"{BOX}orientations: {{angles: 3}}", 2, "this has none of rpy, axis and pose"),
        (f"{BOX}orientations: {{rpy: 0 0 0 deg, angles: 3}}", 2, "angles goes with axis, not with rpy"),
        (f"{BOX}orientations: {{axis: 0 0 0}}", 2, "the direction has length zero"),
        (f"{BOX}orientations: {{axis: 0 0 1, angles: 0}}", 2, "angles: expected a whole number from 1 to 3,600"),
        (f"{BOX}orientations: {{pose: papr}}", 2, "no pose named 'papr'; did you mean 'paper'?"),
        (f"{BOX}orientations: any\nbranches: worst", 3, "branches: expected nearest or best or all, got 'worst'"),
        ("plane: {origin: 0 0 0 m}\norientations: any", 1, "plane: expected origin, u and v; u, v missing"),
        (f"{BOX}orientations: any\nreference: 1 2 deg", 3, "2 joint values for 4 joints"),
        ("random: {count: 0}", 1, "count: expected a whole number from 1 to 1,048,575, got '0'"),
        ("random: {seed: 3}", 1, "random: the key 'count' is missing"),
        ("random: {count: 5, box: {x: 0 1 m, y: 0 1 m, z: 1 0 m}}", 1, "the box: its lowest z is above its highest"),
        ("random: {count: 5, box: {x: 8 9 m, y: 0 1 m, z: 0 1 m}}", 1, "only 0 of 10,0"),
        (f"{BOX}orientations: any\nsingular_below: -1", 3, "singular_below: expected zero or more"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_that_says_where(tmp_path, chain, text, line, message):
    with pytest.raises(InputError) as caught:
        solved(tmp_path, chain, text)
    found = caught.value.findings
    assert len(found) == 1
    assert message in found[0].message
    assert (found[0].file, found[0].line) == (str(tmp_path / "grid.yaml"), line)
    assert found[0].code == "E_GRID"


# approaches ----------------------------------------------------------------------------------------------------------

Q = "-90 3 88 -91 deg"
HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("pose", "approach"),
    [
        (f"{{q: {Q}, approach: {{joint2: +, joint4: -}}}}", (0, 1, 0, -1)),
        (f"{{q: {Q}, approach: 'joint2 +, joint4 -'}}", (0, 1, 0, -1)),
        (f"{{q: {Q}, approach: [0, +, 0, -]}}", (0, 1, 0, -1)),
        ("{q: [-90 deg, 3 deg, 88 deg, -91 deg], approach: {joint2: 1, joint4: '-1'}}", (0, 1, 0, -1)),
        ("{q: {joint1: -90 deg, joint2: 3 deg, joint3: 88 deg, joint4: -91 deg}, approach: joint1 -}", (-1, 0, 0, 0)),
        (f"{{q: {Q}, approach: joint1 0}}", None),
        (Q, None),
    ],
)
def test_every_way_to_write_one(load: Load, pose: str, approach: tuple[int, ...] | None) -> None:
    sheet = load(HEAD + f"poses: {{p: {pose}}}\n")
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [-90, 3, 88, -91], rtol=1e-15)
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


def test_joints_named_as_the_keys_are_joints(load: Load, folder) -> None:
    text = (folder / "4dof.urdf").read_text(encoding="utf-8")
    renamed = text.replace('"joint1"', '"q"').replace('"joint2"', '"approach"')
    (folder / "named.urdf").write_text(renamed, encoding="utf-8")
    sheet = load(
        "precision-pin: 1\nrobot: named.urdf\nposes:\n  p: {q: 1 deg, approach: 2 deg, joint3: 3 deg, joint4: 4 deg}\n"
    )
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [1, 2, 3, 4])
    assert sheet.approaches == {}
