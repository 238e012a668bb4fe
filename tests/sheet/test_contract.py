"""The contract's example, and each rule that the contract states below it."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from precision_pin.base.errors import SheetError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Circle, Disc, Fixed, JointNormal, Law, Normal, Triangular, TruncatedNormal, Uniform
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import Sheet, parse_pose, read

from .conftest import Load, Write

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
    assert [draw.law for draw in sheet.space.draws] == [
        Uniform(half_width) for half_width in (5e-5, 5e-5, 2.5e-4, 5e-5, 2.5e-4, 5e-5)
    ]
    assert len(sheet.sources) == 15


def laws(load: Load, *texts: str) -> list[Law]:
    lines = [f"  p{k}: {text}\n" for k, text in enumerate(texts)]
    return [draw.law for draw in load(HEAD + "parameters:\n" + "".join(lines)).space.draws]


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("{fixed: 0.1 mm}", Fixed(1e-4)),
        ("{fixed: -0.1 mm}", Fixed(-1e-4)),
        ("{uniform: 0.05 mm}", Uniform(5e-5)),
        ("{uniform: 0.05 mm, mean: -2 mm}", Uniform(5e-5, -2e-3)),
        ("{triangular: 1 mrad, mean: 1 deg}", Triangular(1e-3, math.pi / 180)),
        ("{normal: 0.3 mm}", Normal(0.3e-3 / 3)),
        ("{normal: 0.3 mm, k: 2}", Normal(0.3e-3 / 2)),
        ("{normal: 0.3 mm, mean: 1 mm, k: 4.5}", Normal(0.3e-3 / 4.5, 1e-3)),
        ("{normal: {std: 0.3 mm}}", Normal(0.3e-3)),
        ("{normal: {std: 0.3 mm}, mean: 1 m}", Normal(0.3e-3, 1.0)),
        ("{normal: 0.3 mm, truncated: true}", TruncatedNormal(0.3e-3 / 3, 0.0, 3.0)),
        ("{normal: 0.3 mm, truncated: True, k: 2}", TruncatedNormal(0.3e-3 / 2, 0.0, 2.0)),
        ("{normal: 0.3 mm, truncated: false}", Normal(0.3e-3 / 3)),
        ("{normal: {std: 0.3 mm}, truncated: true, k: 2.5}", TruncatedNormal(0.3e-3, 0.0, 2.5)),
        ("{disc: 0.1 mm}", Disc(1e-4)),
        ("{circle: 0.1 mm}", Circle(1e-4)),
        ("{joint_normal: {std: [1 mm, 2 mm]}}", JointNormal(((1e-6, 0.0), (0.0, 4e-6)))),
        ("{uniform: 0 mm}", Uniform(0.0)),
    ],
)
def test_laws(load: Load, text: str, law: Law) -> None:
    (seen,) = laws(load, text)
    assert type(seen) is type(law)
    np.testing.assert_allclose(seen.covariance, law.covariance, rtol=1e-14)
    np.testing.assert_allclose(seen.mean_vector, law.mean_vector, rtol=1e-15)
    assert seen.support(np.ones(law.size)) == pytest.approx(law.support(np.ones(law.size)), rel=1e-14)


def test_a_truncated_normal_is_cut_at_its_half_width(load: Load) -> None:
    for k in (1, 2, 3, 6):
        (law,) = laws(load, f"{{normal: 0.3 mm, truncated: true, k: {k}}}")
        assert law.support([1.0]) == pytest.approx(3e-4, rel=1e-15)


def test_joint_normal_with_mean_and_correlation(load: Load) -> None:
    text = "{joint_normal: {std: [1 mm, 2 mm]}, mean: [1 cm, -1 mm], correlation: [[1, -0.5], [-0.5, 1]], scope: pose}"
    (draw,) = load(HEAD + f"parameters:\n  j: {text}\n").space.draws
    np.testing.assert_allclose(draw.law.covariance, [[1e-6, -1e-6], [-1e-6, 4e-6]], rtol=1e-14)
    np.testing.assert_allclose(draw.law.mean_vector, [0.01, -0.001], rtol=1e-15)
    assert draw.components == ("j.0", "j.1")
    assert draw.scope is Scope.POSE


@pytest.mark.parametrize("scope", ["unit", "pose", "visit"])
def test_scopes(load: Load, scope: str) -> None:
    (draw,) = load(HEAD + f"parameters: {{a: {{uniform: 1 mm, scope: {scope}}}}}\n").space.draws
    assert draw.scope is Scope(scope)


def test_components_of_a_law_of_several_numbers_are_used_by_name(load: Load) -> None:
    sheet = load(
        HEAD
        + "parameters: {p: {disc: 0.1 mm}, j: {joint_normal: {std: [1 mm, 1 mm]}}}\n"
        + "sources:\n  - frame: {joint: joint2, x: p.x, y: p.y, z: j.1}\n"
    )
    assert sheet.sources[0].settings()["z"] == "j.1"
    assert sheet.space.components == ("p.x", "p.y", "j.0", "j.1")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0 0 -9.81 m/s^2", [0, 0, -9.81]),
        ("1 -2 3000 mm/s^2", [1e-3, -2e-3, 3.0]),
        ("earth", [0, 0, -9.81]),
        ("moon", [0, 0, -1.62]),
        ("none", [0, 0, 0]),
    ],
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


@pytest.mark.parametrize(
    "text",
    [
        "-90 3 88 -91 deg",
        "[-90 deg, 3 deg, 88 deg, -91 deg]",
        "[-0.25 turn, 180 arcmin, 88°, -91 deg]",
        "{joint4: -91 deg, joint3: 88 deg, joint2: 3 deg, joint1: -90 deg}",
    ],
)
def test_ways_to_write_a_pose(load: Load, text: str) -> None:
    sheet = load(HEAD + f"poses: {{p: {text}}}\n")
    np.testing.assert_allclose(np.degrees(sheet.poses["p"]), [-90, 3, 88, -91], rtol=1e-15)


SLIDING = "precision-pin: 1\nrobot: finger.urdf\ntip: fingertip\n"


def test_a_chain_that_turns_and_slides(load: Load) -> None:
    sheet = load(
        SLIDING
        + "poses: {p: [90 deg, 0 rad, 0 rad, 0 rad, 20 mm]}\n"
        + "sources:\n"
        + "  - joint_compliance: {joint: finger, compliance: 1 um/N}\n"
        + "  - joint_offset: {joint: finger, offset: {uniform: 0.1 mm}}\n"
        + "  - joint_offset: {joint: joint1, offset: {uniform: 0.1 mrad}}\n"
    )
    np.testing.assert_allclose(sheet.poses["p"], [math.pi / 2, 0, 0, 0, 0.02], rtol=1e-15)
    assert sheet.sources[0].settings()["compliance"] == 1e-6


@pytest.mark.parametrize("pose", ["0 0 0 0 0 deg", "0 0 0 0 0.02 m"])
def test_one_unit_for_a_chain_that_turns_and_slides_is_refused(write: Write, pose: str) -> None:
    with pytest.raises(SheetError, match="revolute and prismatic joints"):
        read(write(SLIDING + f"poses: {{p: {pose}}}\n"))


def test_order_of_sources_and_parameters_never_matters(write: Write) -> None:
    model = ErrorModel.load(write(CONTRACT))
    head, parameters, sources = CONTRACT.replace("parameters:\n", "|").replace("sources:\n", "|").split("|")
    turned = ["".join(reversed(part.splitlines(keepends=True))) for part in (parameters, sources)]
    other = ErrorModel.load(write(f"{head}parameters:\n{turned[0]}sources:\n{turned[1]}"))
    rows = [other.space.index[name] for name in model.space.components]
    x, y = model.space.sample(1, 0, 20), other.space.sample(1, 0, 20)
    np.testing.assert_array_equal(y[rows], x)
    difference = other.at("paper").exact(y) - model.at("paper").exact(x)
    assert np.abs(difference).max() < 1e-15


@pytest.mark.filterwarnings(
    "ignore:.*W_(NO_POSES|FEW_SAMPLES|CONSTANT|OFF_CHAIN):precision_pin.base.errors.PrecisionPinWarning"
)
def test_two_sources_of_one_kind_at_one_place_are_told_apart(load: Load, write: Write) -> None:
    text = HEAD + "sources:\n" + "  - joint_offset: {joint: joint1, offset: {uniform: 1 mrad}}\n"
    text += "  - joint_offset: {joint: joint1, offset: {normal: 1 mrad}}\n"
    names = ErrorModel.load(write(text)).space.components
    assert len(names) == 2
    assert set(names) == {"joint_offset[joint1].offset", "joint_offset[joint1]#2.offset"}


def test_paths_are_relative_to_the_sheet_not_to_the_caller(
    write: Write, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = write(HEAD)
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert read(path).chain.tip == "tool"


def test_parse_pose_is_what_the_command_line_uses(load: Load) -> None:
    sheet: Sheet = load(HEAD)
    np.testing.assert_allclose(parse_pose("1 2 3 4 rad", sheet.chain), [1, 2, 3, 4])
