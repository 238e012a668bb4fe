"""Files of poses: the same grids as in Python, and one line for each mistake, with its line number."""

from __future__ import annotations

import math

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet.pose_grid import read_pose_grid


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


@pytest.mark.fast(18)
@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "a grid has one of joints, box, plane, random; got nothing"),
        ("- box", 1, "a grid has one of joints, box, plane, random; got a list"),
        ("boxes: {}", 1, "unknown key 'boxes': did you mean 'box'?"),
        ("branches: all", 1, "a grid has one of joints, box, plane, random; this has none"),
        (f"{BOX}joints: {{}}", 1, "this has joints and box"),
        (f"{JOINTS}  joint4: 0 deg\norientations: any", 6, "orientations goes with box or plane, not with joints"),
        (JOINTS, 1, "no values for the joints joint4"),
        (f"{JOINTS}  joint5: 0 deg", 5, "unknown key 'joint5': did you mean"),
        (f"{JOINTS}  joint4: 0 mm", 5, "joint4: 'mm' in '0 mm' is not a unit of angle; allowed: rad"),
        (f"{JOINTS}  joint4: 0", 5, "joint4: '0' has no unit"),
        (f"{JOINTS}  joint4: []", 5, "joint4: no values; give at least one, such as '30 deg'"),
        (f"{JOINTS}  joint4:", 5, "joint4: expected a number with a unit such as '0.1 mm', got ''"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg, count: 1}}", 5, "count: expected a whole number from 2 to 1,048,575"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg, step: 1 deg}}", 5, "unknown key 'step': valid: count, from, to"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg}}", 5, "{from: 30 deg, to: 90 deg, count: 7}; count missing"),
        (f"{JOINTS}  joint4: {{from: 0 deg, to: 9 deg, count: 9999999}}", 5, "count: expected a whole number from 2"),
        ("box: {x: 1 m, y: 1 m}\norientations: any", 1, "box: expected x, y and z, each with its values; z missing"),
        ("box: {x: 1 m, y: 1 m, z: 10 deg}\norientations: any", 1, "z: 'deg' in '10 deg' is not a unit of length"),
        (BOX, 1, "the key 'orientations' is missing; an orientation is any, {rpy: 180 0 0 deg}"),
        (f"{BOX}orientations: []", 2, "no orientations; an orientation is any"),
        (f"{BOX}orientations: down", 2, "orientations: an orientation is any, {rpy: 180 0 0 deg}"),
        (f"{BOX}orientations: {{axis: 0 0 1, rpy: 0 0 0 deg}}", 2, "this has rpy and axis"),
        (f"{BOX}orientations: {{angles: 3}}", 2, "this has none of rpy, axis and pose"),
        (f"{BOX}orientations: {{rpy: 0 0 0 deg, angles: 3}}", 2, "angles goes with axis, not with rpy"),
        (f"{BOX}orientations: {{rpy: 0 0 deg}}", 2, "rpy: '0 0 deg' has 2 numbers, expected 3"),
        (f"{BOX}orientations: {{axis: 0 0 0}}", 2, "the direction has length zero"),
        (f"{BOX}orientations: {{axis: 0 0 1, angles: 0}}", 2, "angles: expected a whole number from 1 to 3,600"),
        (f"{BOX}orientations: {{pose: papr}}", 2, "no pose named 'papr'; did you mean 'paper'?"),
        (f"{BOX}orientations: any\nbranches: worst", 3, "branches: expected nearest or best or all, got 'worst'"),
        (f"{BOX}orientations: any\nreference: 1 2 deg", 3, "2 joint values for 4 joints"),
        ("plane: {origin: 0 0 0 m}\norientations: any", 1, "plane: expected origin, u and v; u, v missing"),
        ("random: {seed: 3}", 1, "random: the key 'count' is missing"),
        ("random: {count: 0}", 1, "count: expected a whole number from 1 to 1,048,575, got '0'"),
        ("random: {count: 5}\nbranches: all", 2, "branches goes with box or plane, not with random"),
        ("random: {count: 5, box: {x: 0 1 m, y: 0 1 m, z: 1 m}}", 1, "z: '1 m' has 1 numbers, expected 2"),
        ("random: {count: 5, box: {x: 0 1 m, y: 0 1 m, z: 1 0 m}}", 1, "the box: its lowest z is above its highest"),
        ("random: {count: 5, box: {x: 8 9 m, y: 0 1 m, z: 0 1 m}}", 1, "only 0 of 10,0"),
        (f"{BOX}orientations: any\nsingular_below: -1", 3, "singular_below: expected zero or more"),
        (f"{BOX}orientations: any\nsingular_below: 1 mm", 3, "singular_below: 'mm' in '1 mm' is not a unit of ratio"),
        ("a: [", 1, "not YAML"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_that_says_where(tmp_path, chain, text, line, message):
    with pytest.raises(InputError) as caught:
        solved(tmp_path, chain, text)
    found = caught.value.findings
    assert len(found) == 1
    assert message in found[0].message
    assert (found[0].file, found[0].line) == (str(tmp_path / "grid.yaml"), line)
    assert found[0].code == ("E_YAML" if "YAML" in message else "E_GRID")
