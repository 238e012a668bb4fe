"""The contract's example, each rule that the contract states below it, and the JSON schema of a sheet."""

import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest
from numpy.typing import NDArray
from ruamel.yaml import YAML

from precision_pin.base.errors import SheetError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform, laws_of_sheets
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema, parse_pose, read
from precision_pin.sources import catalogue

from .conftest import Load, Refuse, Write

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


def column(model: ErrorModel, name: str, step: float) -> NDArray[np.float64]:
    """Return what a step of one number does to the linear error at the paper's pose."""
    at = model.at("paper")
    x = np.repeat(model.space.mean[:, None], 2, axis=1)
    x[model.space.index[name], 1] += step
    error = at.linear(x)
    return error[:, 1] - error[:, 0]


def test_the_example_of_the_contract_loads_as_it_stands(load: Load) -> None:
    sheet = load(CONTRACT)
    assert sheet.chain.tip == "tool"
    assert sheet.chain.joint_names == ("joint1", "joint2", "joint3", "joint4")
    assert sheet.chain.locked == {"finger": 0.04}
    np.testing.assert_array_equal(sheet.chain.gravity, [0, 0, -9.81])
    assert sheet.statics == "nominal"
    assert list(sheet.poses) == ["paper", "folded"]
    np.testing.assert_allclose(np.degrees(sheet.poses["paper"]), [-90, 3, 88, -91], rtol=1e-15)
    np.testing.assert_allclose(np.degrees(sheet.poses["folded"]), [0, 10, 90, 0], rtol=1e-15)
    draws = {draw.name: draw for draw in sheet.space.draws}
    assert list(draws) == ["a1", "tool_mass", "a0", "a3", "a5"]
    assert draws["a1"] == Draw("a1", Uniform(5e-5), Scope.UNIT)
    assert draws["tool_mass"] == Draw("tool_mass", Normal(0.06 / 3, 1.0), Scope.VISIT)
    kinds = [source.kind() for source in sheet.sources]
    assert kinds == ["payload", "length", "length", "axis_install", "beam", "joint_compliance"]


def test_the_example_of_the_contract_means_what_the_paper_says(write: Write) -> None:
    model = ErrorModel.load(write(CONTRACT))
    # reference case R1: d = [-(Δa1 + Δa3 + Δa5), …, Δa0 + Δa1 …] at the paper's pose
    expected = {"a0": [0, 0, 1], "a1": [-1, 0, 1], "a3": [-1, 0, 0], "a5": [-1, 0, 0]}
    for name, direction in expected.items():
        np.testing.assert_allclose(column(model, name, 1e-3)[:3], 1e-3 * np.array(direction), rtol=0, atol=1e-15)
    # columns of J_I of R1: 1.9e-5 rad more of joint 2, as C τ with τ = 122 N m of R4
    compliance = column(model, "joint_compliance[joint2].compliance", 1e-6)
    turn = 121.999783e-6
    np.testing.assert_allclose(compliance[:3], turn * np.array([0, 1.872832254, -1.936409424]), rtol=2e-8, atol=1e-12)
    np.testing.assert_allclose(compliance[3:], [turn, 0, 0], rtol=1e-8, atol=1e-15)
    names = [f"axis_install[joint2].{point}.{axis}" for point in "AB" for axis in "xy"]
    assert model.space.components[5:] == (*names, "joint_compliance[joint2].compliance")


def test_the_paper_s_sheet_loads_without_a_word() -> None:
    sheet = read(PAPER_SHEET)
    assert sheet.findings == ()
    assert [draw.law for draw in sheet.space.draws] == [Uniform(k * 1e-5) for k in (5, 5, 25, 5, 25, 5)]
    assert len(sheet.sources) == 15


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1 -2 3000 mm/s^2", [1e-3, -2e-3, 3.0]), ("earth", [0, 0, -9.81]), ("moon", [0, 0, -1.62]), ("none", [0, 0, 0])],
)
def test_gravity(load: Load, text: str, expected: list[float]) -> None:
    np.testing.assert_allclose(load(HEAD + f"gravity: {text}\n").chain.gravity, expected, rtol=1e-15)


def test_what_may_be_left_out(load: Load) -> None:
    sheet = load(HEAD)
    assert sheet.chain.tip == "tool"
    assert sheet.chain.base == "base"
    np.testing.assert_array_equal(sheet.chain.gravity, [0, 0, -9.81])
    assert (sheet.statics, dict(sheet.poses), sheet.sources, sheet.space.draws) == ("nominal", {}, (), ())
    empty = load(HEAD + "tip:\nposes:\nparameters:\nsources:\nlocked:\n")
    assert (empty.chain.tip, dict(empty.poses), empty.sources) == ("tool", {}, ())


def test_axis_install_by_radius_and_by_diameter(load: Load) -> None:
    one = load(HEAD + "sources:\n  - axis_install: {joint: joint2, radius: 0.1 mm, span: 100 mm, start: -3 cm}\n")
    other = load(HEAD + "sources:\n  - axis_install: {joint: joint2, diameter: 0.2 mm, span: 0.1 m, start: -30 mm}\n")
    settings = one.sources[0].settings()
    assert (settings["radius"], settings["span"], settings["start"]) == (1e-4, 0.1, -0.03)
    assert one.sources[0].own_draws("x") == other.sources[0].own_draws("x")


def test_parameters_of_a_length_one_or_several(load: Load) -> None:
    head = HEAD + "parameters: {a: {uniform: 1 mm}}\nsources:\n"
    for text, expected in (
        ("a", ("a",)),
        ("[a]", ("a",)),
        ("[a, {uniform: 2 mm}, 3 mm]", ("a", Draw("", Uniform(2e-3)), 3e-3)),
        ("{uniform: 2 mm}", (Draw("", Uniform(2e-3)),)),
    ):
        sheet = load(f"{head}  - length: {{joint: joint3, parameters: {text}}}\n")
        assert sheet.sources[0].settings()["parameters"] == expected
        assert sheet.sources[0].settings()["along"] == "link"


def test_ways_to_write_a_pose(load: Load, write: Write) -> None:
    ways = (
        "-90 3 88 -91 deg",
        "[-0.25 turn, 180 arcmin, 88°, -91 deg]",
        "{joint4: -91 deg, joint3: 88 deg, joint2: 3 deg, joint1: -90 deg}",
    )
    sheet = load(HEAD + "poses:\n" + "".join(f"  p{k}: {text}\n" for k, text in enumerate(ways)))
    for values in sheet.poses.values():
        np.testing.assert_allclose(np.degrees(values), [-90, 3, 88, -91], rtol=1e-15)
    # what the command line uses
    np.testing.assert_allclose(parse_pose("1 2 3 4 rad", sheet.chain), [1, 2, 3, 4])
    sliding = "precision-pin: 1\nrobot: finger.urdf\ntip: fingertip\n"
    compliance = "sources: [{joint_compliance: {joint: finger, compliance: 1 um/N}}]\n"
    sheet = load(f"{sliding}poses: {{p: [90 deg, 0 rad, 0 rad, 0 rad, 20 mm]}}\n{compliance}")
    np.testing.assert_allclose(sheet.poses["p"], [math.pi / 2, 0, 0, 0, 0.02], rtol=1e-15)
    assert sheet.sources[0].settings()["compliance"] == 1e-6
    with pytest.raises(SheetError, match="revolute and prismatic joints"):
        read(write(f"{sliding}poses: {{p: 0 0 0 0 0 deg}}\n"))


def test_paths_are_relative_to_the_sheet_not_to_the_caller(
    write: Write, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = write(HEAD)
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert read(path).chain.tip == "tool"


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
correlations:
  - {parameters: [a1, c], correlation: 0.5}
  - {parameters: [a3, a5], matrix: [[1, 0.5], [0.5, 1]]}
sources:
  - table: {joint: joint2, file: plane.csv, scope: visit}
  - joint_offset: {joint: joint4, offset: ±0.02 deg, assumed: true}
measurement: {kind: plane, plane: {point: 0 0 1 mm, normal: 0 0 1}, target_known: false, load: none}
"""


def faults(text: str) -> list[str]:
    """Return what the schema says of a sheet as an editor sees it, with the types of YAML."""
    sheet: Any = YAML(typ="safe", pure=True).load(text)
    validator = jsonschema.Draft202012Validator(json_schema())
    return [error.message for error in validator.iter_errors(json.loads(json.dumps(sheet)))]


@pytest.fixture
def tables(folder) -> None:
    (folder / "plane.csv").write_text("x [mm], rz [deg]\n0.1, 0.2\n", encoding="utf-8")
    (folder / "gauge.csv").write_text("gap [um], shim [mm]\n-30, 0.1\n10, 0.3\n", encoding="utf-8")
    (folder / "single.csv").write_text("gap [mm]\n0.3\n0.1\n", encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("tables")
def test_the_schema_passes_what_the_reader_reads(load: Load) -> None:
    sheet = load(WHOLE)
    assert len(sheet.space.draws) == 12
    assert len(sheet.space.correlations) == 2
    sockets = "{kind: socket, sockets: [0 0 1 mm], base: free, load: [{at: tool, mass: 1 kg}]}"
    seen = "{visible_from: 2 0 0 m, facing: 0 0 1, cone: 30 deg, target_known: true}"
    head = WHOLE.partition("measurement:")[0]
    texts = [PAPER_SHEET.read_text("utf-8"), CONTRACT, WHOLE, *(f"{head}measurement: {one}" for one in (sockets, seen))]
    assert [faults(text) for text in texts] == [[]] * 5


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
def test_the_schema_refuses_what_the_reader_refuses(refuse: Refuse, old: str, new: str) -> None:
    assert WHOLE.count(old) == 1
    text = WHOLE.replace(old, new)
    assert faults(text)
    assert refuse(text)


def test_it_is_a_schema_with_every_kind_of_source_and_every_law() -> None:
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert json.loads(json.dumps(schema)) == schema
    kinds = {next(iter(choice["properties"])) for choice in schema["properties"]["sources"]["items"]["oneOf"]}
    assert kinds == set(catalogue())
    assert {"length", "axis_install", "beam", "joint_compliance", "payload", "frame", "joint_offset", "mcpc"} <= kinds
    assert set(laws_of_sheets()) <= set(schema["$defs"]["law"]["properties"])
    assert set(schema["properties"]) == {
        "precision-pin", "robot", "tip", "base", "gravity", "statics", "locked", "poses", "parameters", "sources",
        "correlations", "target", "calibrated", "allocate", "measurement", "provenance", "accept", "limits", "keep_out",
    }  # fmt: skip
    assert set(schema["required"]) == {"precision-pin", "robot"}
    assert schema["additionalProperties"] is False


def test_every_reference_leads_somewhere() -> None:
    schema = json_schema()

    def references(node: Any) -> set[str]:
        if isinstance(node, dict):
            own = {node["$ref"]} if "$ref" in node else set()
            return own.union(*(references(value) for value in node.values()))
        return set().union(*(references(value) for value in node)) if isinstance(node, list) else set()

    assert {reference.removeprefix("#/$defs/") for reference in references(schema)} <= set(schema["$defs"])
