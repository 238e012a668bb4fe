"""The contract's example, each rule that the contract states below it, and the JSON schema of a sheet."""

import functools
import itertools
import json
import math
import re

import jsonschema
import numpy as np
import pytest
from ruamel.yaml import YAML

import precision_pin as pp
from precision_pin import Draw, ErrorModel, InputError, Scope
from precision_pin.draws.laws import Normal, Uniform, laws_of_sheets
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema, parse_pose, read
from precision_pin.sheet.pose_grid import read_pose_grid
from precision_pin.sources import catalogue

CONTRACT = """\
precision-pin: 1
robot: finger.urdf                  # paths are relative to the sheet
tip: tool
gravity: 0 0 -9.81 m/s^2            # base axes; or earth, moon, none
statics: nominal                    # or equilibrium
locked: {finger: 0.04 m}            # joints off the chain
poses:
  paper: -90 3 88 -91 deg           # chain order
  folded: {joint1: 0 deg, joint2: 10 deg, joint3: 90 deg, joint4: 0 deg}
parameters:
  a1: {uniform: 0.05 mm}
  tool_mass: {normal: 0.06 kg, mean: 1 kg, scope: visit}
  a0: {uniform: 0.05 mm}
  a3: {uniform: 0.05 mm}
  a5: {uniform: 0.05 mm}
sources:
  - payload: {at: tool, mass: tool_mass, com: 0 0 0 mm}
  - length: {joint: joint2, along: z of joint1, parameters: [a0, a1]}
  - length: {frame: tool, along: -z of joint4, parameters: [a1, a3, a5]}
  - axis_install: {joint: joint2, radius: 0.1 mm, span: 100 mm}
  - beam: {link: link2, EI: 8000 N*m^2, GI: 4000 N*m^2}
  - joint_compliance: {joint: joint2, compliance: {uniform: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}
"""
HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"


def test_the_example_of_the_contract_loads_as_it_stands(load):
    sheet = load(CONTRACT)
    assert (sheet.chain.tip, sheet.chain.locked, sheet.statics) == ("tool", {"finger": 0.04}, "nominal")
    assert sheet.chain.joint_names == ("joint1", "joint2", "joint3", "joint4")
    np.testing.assert_array_equal(sheet.chain.gravity, [0, 0, -9.81])
    assert list(sheet.poses) == ["paper", "folded"]
    np.testing.assert_allclose(np.degrees([*sheet.poses.values()]), [[-90, 3, 88, -91], [0, 10, 90, 0]], rtol=1e-15)
    draws = {draw.name: draw for draw in sheet.space.draws}
    assert list(draws) == ["a1", "tool_mass", "a0", "a3", "a5"]
    assert draws["a1"] == Draw("a1", Uniform(5e-5), Scope.UNIT)
    assert draws["tool_mass"] == Draw("tool_mass", Normal(0.06 / 3, 1.0), Scope.VISIT)
    kinds = [source.kind() for source in sheet.sources]
    assert kinds == ["payload", "length", "length", "axis_install", "beam", "joint_compliance"]
    assert pp.monte_carlo(ErrorModel.from_sheet(sheet), "folded", samples=100).scopes["visit"] == 1


def test_the_example_of_the_contract_means_what_the_paper_says(write):
    model = ErrorModel.load(write(CONTRACT))
    at, mean = model.at("paper"), model.space.mean[:, None]
    steps = np.where(mean.ravel() == 1e-5, 1e-6, 1e-3)
    slopes = (at.linear(mean + np.diag(steps)) - at.linear(mean)) / steps
    columns = dict(zip(model.space.components, slopes.T, strict=True))
    # reference case R1: d = [-(Δa1 + Δa3 + Δa5), …, Δa0 + Δa1 …] at the paper's pose
    for name, direction in {"a0": [0, 0, 1], "a1": [-1, 0, 1], "a3": [-1, 0, 0], "a5": [-1, 0, 0]}.items():
        np.testing.assert_allclose(columns[name][:3], direction, rtol=0, atol=1e-12)
    # columns of J_I of R1: a turn of joint 2 of C τ with τ = 122 N m of R4
    expected = 121.999783 * np.array([0, 1.872832254, -1.936409424, 1, 0, 0])
    np.testing.assert_allclose(columns["joint_compliance[joint2].compliance"], expected, rtol=2e-8, atol=1e-8)
    names = [f"axis_install[joint2].{point}.{axis}" for point in "AB" for axis in "xy"]
    assert model.space.components[5:] == (*names, "joint_compliance[joint2].compliance")


def test_the_paper_s_sheet_loads_without_a_word():
    sheet = read(PAPER_SHEET)
    assert sheet.findings == ()
    assert [draw.law for draw in sheet.space.draws] == [Uniform(k * 1e-5) for k in (5, 5, 25, 5, 25, 5)]
    assert len(sheet.sources) == 15


def test_gravity(load):
    for text, expected in (
        ("1 -2 3000 mm/s^2", [1e-3, -2e-3, 3.0]),
        ("earth", [0, 0, -9.81]),
        ("moon", [0, 0, -1.62]),
        ("none", [0, 0, 0]),
    ):
        np.testing.assert_allclose(load(HEAD + f"gravity: {text}\n").chain.gravity, expected, rtol=1e-15)


def test_what_may_be_left_out(load):
    for left_out in ("", "tip:\nposes:\nparameters:\nsources:\nlocked:\n"):
        sheet = load(HEAD + left_out)
        assert (sheet.chain.tip, sheet.chain.base) == ("tool", "base")
        np.testing.assert_array_equal(sheet.chain.gravity, [0, 0, -9.81])
        assert (sheet.statics, dict(sheet.poses), sheet.sources, sheet.space.draws) == ("nominal", {}, (), ())


def test_axis_install_by_radius_and_by_diameter(load):
    ways = ("radius: 0.1 mm, span: 100 mm, start: -3 cm", "diameter: 0.2 mm, span: 0.1 m, start: -30 mm")
    one, other = (load(f"{HEAD}sources:\n- axis_install: {{joint: joint2, {way}}}\n").sources[0] for way in ways)
    settings = one.settings()
    assert (settings["radius"], settings["span"], settings["start"]) == (1e-4, 0.1, -0.03)
    assert one.own_draws("x") == other.own_draws("x")


def test_parameters_of_a_length_one_or_several(load):
    for text, expected in (
        ("a", ("a",)),
        ("[a, {uniform: 2 mm}, 3 mm]", ("a", Draw("", Uniform(2e-3)), 3e-3)),
        ("{uniform: 2 mm}", (Draw("", Uniform(2e-3)),)),
    ):
        head = HEAD + "parameters: {a: {uniform: 1 mm}}\nsources:\n"
        settings = load(f"{head}  - length: {{joint: joint3, parameters: {text}}}\n").sources[0].settings()
        assert (settings["parameters"], settings["along"]) == (expected, "link")


def test_ways_to_write_a_pose(load, refuse):
    ways = (
        "-90 3 88 -91 deg",
        "[-0.25 turn, 180 arcmin, 88°, -91 deg]",
        "{joint4: -91 deg, joint3: 88 deg, joint2: 3 deg, joint1: -90 deg}",
    )
    sheet = load(HEAD + "poses:\n" + "".join(f"  p{k}: {text}\n" for k, text in enumerate(ways)))
    np.testing.assert_allclose(np.degrees([*sheet.poses.values()]), [[-90, 3, 88, -91]] * 3, rtol=1e-15)
    # what the command line uses
    np.testing.assert_allclose(parse_pose("1 2 3 4 rad", sheet.chain), [1, 2, 3, 4])
    sliding = "precision-pin: 1\nrobot: finger.urdf\ntip: fingertip\n"
    compliance = "sources: [{joint_compliance: {joint: finger, compliance: 1 um/N}}]\n"
    sheet = load(f"{sliding}poses: {{p: [90 deg, 0 rad, 0 rad, 0 rad, 20 mm]}}\n{compliance}")
    np.testing.assert_allclose(sheet.poses["p"], [math.pi / 2, 0, 0, 0, 0.02], rtol=1e-15)
    assert sheet.sources[0].settings()["compliance"] == 1e-6
    (finding,) = refuse(f"{sliding}poses: {{p: 0 0 0 0 0 deg}}\n")
    assert "revolute and prismatic joints" in finding.message


def test_paths_are_relative_to_the_sheet_not_to_the_caller(write, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert read(write(HEAD)).chain.tip == "tool"


# the JSON schema -----------------------------------------------------------------------------------------------------

WHOLE = """\
precision-pin: 1
robot: 4dof.urdf
parameters:
  a1: ±0.05 mm
  a3: {normal: 0.05 mm}
  a5: {triangular: 0.05 mm}
  c: {lognormal: {std: 1e-6 rad/(N*m)}, mean: 1e-5 rad/(N*m)}
  hum: {arcsine: 5 um}
  side: {two_point: 0.02 mm, centre: 1 mm, probability: 0.3}
  seen: {empirical: {samples: 0.1 0.2 mm}}
  listed: {empirical: {samples: [0.1 mm, 0.2 mm]}}
  filed: {empirical: {samples: {file: single.csv, column: gap}}}
  table: {empirical: {quantiles: [[0, 0.1 mm], [1, 0.2 mm]]}}
  sets: {rows: [[0.1 mm, 0.2 mm], [0.3 mm, 0.4 mm]]}
  taken: {rows: {file: gauge.csv, columns: [gap, shim]}}
  drawn: +0.5/-0.1 mm
  hole: {normal: H7, size: 50 mm, cpk: 1.33}
specs: [0.5 mm @ 99 %, {limit: 1 mrad, quantity: rx, probability: 90 %, name: tilt, poses: []}]
correlations:
  - {parameters: [a1, c], correlation: 0.5}
  - {parameters: [a3, a5], matrix: [[1, 0.5], [0.5, 1]]}
sources:
  - table: {joint: joint2, file: plane.csv, scope: visit}
  - joint_offset: {joint: joint4, offset: ±0.02 deg, assumed: true}
measurement: {kind: plane, plane: {point: 0 0 1 mm, normal: 0 0 1}, target_known: false, load: none}
"""


SCHEMA = functools.cache(json_schema)


def faults(text):
    """Return what the schema says of a sheet as an editor sees it, with the types of YAML."""
    sheet = json.loads(json.dumps(YAML(typ="safe", pure=True).load(text)))
    return list(jsonschema.Draft202012Validator(SCHEMA()).iter_errors(sheet))


@pytest.fixture
def tables(folder):
    (folder / "plane.csv").write_text("x [mm], rz [deg]\n0.1, 0.2\n", encoding="utf-8")
    (folder / "gauge.csv").write_text("gap [um], shim [mm]\n-30, 0.1\n10, 0.3\n", encoding="utf-8")
    (folder / "single.csv").write_text("gap [mm]\n0.3\n0.1\n", encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("tables")
def test_the_schema_passes_what_the_reader_reads(load):
    sheet = load(WHOLE)
    assert len(sheet.space.draws) == 14
    assert len(sheet.space.correlations) == 2
    sockets = "{kind: socket, sockets: [0 0 1 mm], base: free, load: [{at: tool, mass: 1 kg}]}"
    seen = "{visible_from: 2 0 0 m, facing: 0 0 1, cone: 30 deg, target_known: true}"
    sight = "{std: {along: 10 um + 0.3 um/m, across: 15 um}, stands_at: 3 0 1 m}"
    bar = "{kind: distance, std: 10 um + 0.3 um/m, anchor: 1 0 0 m}"
    drift = "{drift: {std: 20 um, every: 1 h, pace: 20 s, fixed: 4, fixed_every: 10 min}}"
    head = WHOLE.partition("measurement:")[0]
    joint = f"{head}  - covariance: {{frame: tool, matrix: {(1e-8 * np.eye(6)).tolist()}}}\n"
    assert len(load(joint).sources) == len(sheet.sources) + 1
    texts = [
        PAPER_SHEET.read_text("utf-8"),
        CONTRACT,
        joint,
        *(f"{head}measurement: {one}" for one in (sockets, seen, sight, bar, drift)),
    ]
    assert [faults(text) for text in [WHOLE, *texts]] == [[]] * 9


@pytest.mark.fast(4)
@pytest.mark.usefixtures("tables")
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("precision-pin: 1", "precision-pin: 2"),
        ("robot: 4dof.urdf", "robot: 4dof.urdf\nstatic: nominal"),
        ("robot: 4dof.urdf", "robot: 4dof.urdf\nstatics: dynamic"),
        ("a1: ±0.05 mm", "a1: 0.05 mm"),
        ("{normal: 0.05 mm}", "{nromal: 0.05 mm}"),
        ("{normal: 0.05 mm}", "{normal: 0.05 mm, uniform: 1 mm}"),
        ("{normal: 0.05 mm}", "{normal: 0.05 mm, scope: day}"),
        ("{std: 1e-6 rad/(N*m)}", "1e-6 rad/(N*m)"),
        ("probability: 0.3", "chance: 0.3"),
        ("samples: 0.1 0.2 mm", "sample: 0.1 0.2 mm"),
        ("{file: single.csv, column: gap}", "{column: gap}"),
        ("columns: [gap, shim]", "columns: gap"),
        ("[a1, c], correlation: 0.5", "[a1], correlation: 0.5"),
        ("[a1, c], correlation: 0.5", "[a1, c]"),
        ("matrix: [[1, 0.5], [0.5, 1]]", "matrix: 0.5"),
        ("- table:", "- tabel:"),
        ("file: plane.csv, ", ""),
        ("file: plane.csv", "file: [plane.csv]"),
        ("joint: joint4, offset", "joint: joint4, ofset"),
        ("±0.02 deg, assumed", "0.02, assumed"),
        ("kind: plane,", "kind: planes,"),
        ("target_known: false", "target_known: perhaps"),
        ("load: none", "load: [{mass: 1 kg}]"),
    ],
)
def test_the_schema_refuses_what_the_reader_refuses(refuse, old, new):
    assert WHOLE.count(old) == 1
    text = WHOLE.replace(old, new)
    assert faults(text)
    assert refuse(text)


def test_it_is_a_schema_with_every_kind_of_source_and_every_law():
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    text = json.dumps(schema)
    assert json.loads(text) == schema
    assert set(re.findall(r'"\$ref": "#/\$defs/([^"]+)"', text)) <= set(schema["$defs"])
    kinds = {next(iter(choice["properties"])) for choice in schema["properties"]["sources"]["items"]["oneOf"]}
    assert kinds == set(catalogue())
    assert set(laws_of_sheets()) <= set(schema["$defs"]["law"]["properties"])
    assert set(schema["properties"]) == {
        "precision-pin", "robot", "tip", "base", "gravity", "statics", "locked", "poses", "parameters", "sources",
        "correlations", "target", "calibrated", "allocate", "measurement", "provenance", "accept", "limits", "keep_out", "specs",
        "datums", "datum",
    }  # fmt: skip
    assert set(schema["required"]) == {"precision-pin", "robot"}
    assert schema["additionalProperties"] is False


# files of poses: the same grids as in Python, one line for each mistake; poses with the direction of each joint's last move


@pytest.fixture(scope="module")
def chain():
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
    values = ((-math.pi / 2, 0, math.pi / 2), (math.pi / 18, 0.5), (0, math.pi / 6), (0,))
    np.testing.assert_allclose(poses.q.T, list(itertools.product(*values)), atol=1e-15)


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
    kinds = [name.split(", ")[1] for name in poses.names[:4]]
    assert kinds == ["pose paper", "rpy 0 90 0°", "axis 1 0 0", "axis 1 0 0"]


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
        ("random: {count: 5, seed: x}", 1, "seed: expected a whole number from 0 to 999,999,999, got 'x'"),
        ("random: {count: 5, box: {x: 0 1 m, y: 0 1 m, z: 1 0 m}}", 1, "the box: its lowest z is above its highest"),
        ("random: {count: 5, box: {x: 8 9 m, y: 0 1 m, z: 0 1 m}}", 1, "only 0 of 10,0"),
        (f"{BOX}orientations: any\nsingular_below: -1", 3, "singular_below: expected zero or more"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_that_says_where(tmp_path, chain, text, line, message):
    with pytest.raises(InputError) as caught:
        solved(tmp_path, chain, text)
    (found,) = caught.value.findings
    assert message in found.message
    assert (found.file, found.line, found.code) == (str(tmp_path / "grid.yaml"), line, "E_GRID")


# approaches ----------------------------------------------------------------------------------------------------------

Q = "-90 3 88 -91 deg"


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
def test_every_way_to_write_one(load, pose, approach):
    sheet = load(HEAD + f"poses: {{p: {pose}}}\n")
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [-90, 3, 88, -91], rtol=1e-15)
    assert sheet.approaches.get("p") == approach
    model = ErrorModel.from_sheet(sheet)
    for at in (model.at("p"), model.at(), *model.at_many(["p"])):
        assert at.posture.approach == (approach or ())
    # joint values alone have none, and one that is given is taken instead
    assert model.at(sheet.poses["p"]).posture.approach == ()
    assert model.at("p", approach="joint3 -").posture.approach == (0, 0, -1, 0)


def test_from_the_pose_before(load):
    a, b = "a: 0 0 0 0 deg", "b: {q: 10 0 -5 0 deg, approach: previous}"
    sheet = load(f"{HEAD}poses: {{{a}, {b}, c: 0 0 0 1 deg, d: {{q: 0 3 0 1 deg, approach: previous}}}}\n")
    # joint 1 moved last from b to c, joint 3 too
    assert sheet.approaches == {"b": (1, 0, -1, 0), "d": (-1, 1, 1, 1)}


def test_joints_named_as_the_keys_are_joints(load, folder):
    text = (folder / "4dof.urdf").read_text(encoding="utf-8")
    (folder / "named.urdf").write_text(text.replace('"joint1"', '"q"').replace('"joint2"', '"approach"'))
    head = HEAD.replace("4dof", "named")
    sheet = load(f"{head}poses:\n  p: {{q: 1 deg, approach: 2 deg, joint3: 3 deg, joint4: 4 deg}}\n")
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [1, 2, 3, 4])
    assert sheet.approaches == {}
