"""Sheets drafted for arms: they run unedited, name everything, and their starting tolerances are what they claim."""

import functools
import math
import re
import string
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from ruamel.yaml import YAML

import precision_pin as pp
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs, resolve_robot
from precision_pin.sheet import read
from precision_pin.sources import catalogue
from precision_pin.writers.scaffold import Survey, general_tolerance, quoted, round_125, scaffold
from support.plain_robot import joint, link, robot

# odd robots have findings, which are not what is tested here
pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")

ARMS = {"panda": "panda_hand_tcp", "tiago": "arm_tool_link", "ur5": "tool0"}
PAPER_ARM = PAPER_SHEET.with_name("4dof.urdf")
Y = (0, 1, 0)


@functools.cache
def chain_of(name: str) -> pp.Chain:
    if name == "paper":
        return pp.Chain.from_urdf(PAPER_ARM, "tool")
    if not example_urdfs():
        pytest.skip("example-robot-data is not installed")
    return pp.Chain.from_urdf(resolve_robot(f"example:{name}"), ARMS[name])


@functools.cache
def text_of(name: str) -> str:
    return scaffold(chain_of(name), str(PAPER_ARM) if name == "paper" else f"example:{name}")


def written(text: str, folder: Path) -> Path:
    path = folder / "drafted.errors.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def toy(folder: Path, *parts: str, name: str = "toy.urdf") -> Path:
    path = folder / name
    path.write_text(robot(*parts), encoding="utf-8")
    return path


def limits(lower: object, upper: object) -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="10" velocity="1"/>'


def turning(name: str, parent: str, child: str, kind: str = "revolute", extra: str = limits(-1, 1), **place) -> str:
    return joint(name, kind, parent, child, extra=extra, **place)


def active(text: str, kind: str) -> list[str]:
    return re.findall(rf"^  - {kind}: .*$", text, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "tiago", "paper"])
def test_the_sheet_of_any_arm_runs_unedited_and_with_its_examples(name: str, tmp_path: Path) -> None:
    chain, text = chain_of(name), text_of(name)
    path = written(text, tmp_path)
    # none of the sheet's own; those about links off the chain are summed up
    assert [f for f in read(path).findings if f.code != "W_OFF_CHAIN" and f not in chain.robot.findings] == []
    model = pp.ErrorModel.load(path)
    for name in ("base", "tip", "joint_names", "locked"):
        assert getattr(model.chain, name) == getattr(chain, name)
    assert model.chain.gravity.tolist() == chain.gravity.tolist()
    assert list(model.poses) == ["start", "far"]
    singular = np.linalg.svd(model.at("start").posture.joint_jacobian, compute_uv=False)
    assert singular[-1] > 0.02 * singular[0]
    draws = model.space.sample(0, 0, 200)
    for pose in model.poses:
        at = model.at(pose)
        assert at.findings("exact") == at.findings("linear") == ()
        error = at.exact(draws)
        assert np.isfinite(error).all()
        assert 0.01e-3 < np.median(np.linalg.norm(error[:3], axis=0)) < 20e-3
    lines = text.splitlines()
    uncommented = [
        re.sub(r"^# (parameters:|  set_up:|  tool_mass:)", r"\1", re.sub(r"^(  )# - ", r"\1- ", line)) for line in lines
    ]
    assert sum(a != b for a, b in zip(lines, uncommented, strict=True)) >= 5
    model = pp.ErrorModel.load(written("\n".join(uncommented), tmp_path))
    assert {"payload", "beam"} <= {source.kind() for source in model.sources}
    assert {"set_up", "tool_mass"} <= set(model.space.components)
    assert np.isfinite(model.at().exact(model.space.sample(0, 0, 10))).all()


@pytest.mark.parametrize("name", ["panda", "paper"])
def test_the_sheet_names_every_joint_and_link_and_marks_every_source(name: str) -> None:
    chain, text = chain_of(name), text_of(name)
    way = chain.robot.path(chain.base, chain.tip)
    for link_name in (chain.base, *(step.child for step in way)):
        assert re.search(rf"^#   link   {re.escape(link_name)}: (no mass|[\d.e-]+ kg)$", text, re.MULTILINE)
    for step in way:
        assert re.search(rf"^#   joint  {re.escape(step.name)}: {step.kind}\b", text, re.MULTILINE)
    for moving in chain.joint_names:
        for kind in ("joint_offset", "axis_install"):
            assert sum(f"joint: {moving}," in line for line in active(text, kind)) == 1
    for still in chain.locked:
        assert re.search(rf"(?<![\w-]){re.escape(still)}(?![\w-])", text)
    lines = [line for line in text.splitlines() if line.startswith("  - ")]
    assert lines
    assert all("    # assumption" in line for line in lines)
    if name == "paper":
        assert scaffold(pp.Chain.from_urdf(PAPER_ARM, "tool"), str(PAPER_ARM)) == text


def test_every_kind_of_source_and_every_law_is_listed() -> None:
    text = re.sub(r"\n#\s{6,}", " ", text_of("paper"))  # a long line goes on, indented
    for kind in catalogue():
        assert re.search(rf"^#   {kind} {{\w+(, \w+)*}}: \w", text, re.MULTILINE)
    for law in laws_of_sheets():
        assert re.search(rf"^#   {law}: \w", text, re.MULTILINE)


def test_general_tolerances_and_rounding_to_1_2_5() -> None:
    # ISO 2768-1:1989, table 1, class f; from 2000 mm on class m
    for length_mm, deviation_mm, grade in (
        (0.5, 0.05, "f"), (6, 0.05, "f"), (6.01, 0.1, "f"), (30, 0.1, "f"), (30.1, 0.15, "f"), (120, 0.15, "f"),
        (121, 0.2, "f"), (400, 0.2, "f"), (401, 0.3, "f"), (1000, 0.3, "f"), (1001, 0.5, "f"), (2000, 0.5, "f"),
        (2001, 2.0, "m"), (4000, 2.0, "m"),
    ):  # fmt: skip
        deviation, found = general_tolerance(length_mm * 1e-3)
        assert deviation == pytest.approx(deviation_mm * 1e-3, rel=1e-12)
        assert found == grade
    # the limits between 1, 2, 5, 10 are their geometric means: 1.414…, 3.162…, 7.071…
    rounded = {1.41: 1, 1.42: 2, 3.16: 2, 3.17: 5, 7.07: 5, 7.08: 10, 2.04e-5: 2e-5, 99e6: 1e8}
    assert {value: round_125(value) for value in rounded} == rounded


def test_the_paper_arm_has_its_lengths() -> None:
    lines = active(text_of("paper"), "length")
    # Table 1: a_1 = 85, a_2 = 1970, a_4 = 1770, a_1 + a_3 + a_5 = 274 mm
    expected = [("joint2", 85, "0.15"), ("joint3", 1970, "0.5"), ("joint4", 1770, "0.5"), ("tool", 274, "0.2")]
    assert len(lines) == len(expected)
    for line, (name, length, deviation) in zip(lines, expected, strict=True):
        assert f": {name}, parameters: {{uniform: {deviation} mm}}" in line
        assert line.endswith(f", {length} mm")


def test_a_pendulum_winds_up_by_a_fifth_of_a_milliradian(tmp_path: Path) -> None:
    # 2 kg at 0.5 m: 9.81 N·m when level; 2e-4 rad / 9.81 N·m = 2.04e-5 rad/(N·m), rounded 2e-5
    path = toy(tmp_path, link("base"), link("arm", 2.0, (0.5, 0, 0)), turning("swing", "base", "arm", axis=Y))
    text = scaffold(pp.Chain.from_urdf(path), path.name)
    expected = "joint: swing, compliance: {uniform: 4e-6 rad/(N*m), mean: 2e-5 rad/(N*m)}"
    assert [expected in line for line in active(text, "joint_compliance")] == [True]
    at = pp.ErrorModel.load(written(text, tmp_path)).at({"swing": 0.0})
    # turns down about y; the tip is the joint's own link
    assert_allclose(at.tangent[0], [0, 0, 0, 0, 2e-5 * 9.81, 0], atol=1e-15)


def test_a_vertical_slide(tmp_path: Path) -> None:
    # 3 kg: 29.43 N; 2e-5 m / 29.43 N = 6.8e-7 m/N, rounded 5e-7
    lift = turning("lift", "base", "car", "prismatic", limits(0.1, 0.5))
    path = toy(tmp_path, link("base"), link("car", 3.0), lift)
    text = scaffold(pp.Chain.from_urdf(path), path.name)
    assert "  - joint_offset: {joint: lift, offset: {normal: 0.05 mm}, assumed: true}" in text
    assert "joint: lift, compliance: {uniform: 1e-7 m/N, mean: 5e-7 m/N}" in text
    assert "strain wave" not in text
    model = pp.ErrorModel.load(written(text, tmp_path))
    for q in model.poses.values():
        assert 0.1 <= q[0] <= 0.5
    assert_allclose(model.at().tangent[0], [0, 0, -5e-7 * 29.43, 0, 0, 0], atol=1e-18)
    # offset: sigma = 0.05 mm / 3; compliance: 29.43 N × 1e-7 m/N / √3; axis discs do not act along the axis
    sigma = math.hypot(0.05e-3 / 3, 29.43 * 1e-7 / math.sqrt(3))
    assert math.sqrt(model.at().covariance[2, 2]) == pytest.approx(sigma, rel=1e-9)


def test_a_wrist_is_sized_for_a_tenth_of_the_largest_load(tmp_path: Path) -> None:
    # swing carries 10 kg at 1 m: 98.1 N·m; the wrist's own 0.01 kg at 0.01 m is far below 9.81: 2e-4/9.81 → 2e-5
    links = link("base"), link("arm", 10.0, (1, 0, 0)), link("hand", 0.01, (0.01, 0, 0))
    wrist = turning("wrist", "arm", "hand", axis=Y, xyz=(1, 0, 0))
    path = toy(tmp_path, *links, turning("swing", "base", "arm", axis=Y), wrist)
    lines = active(scaffold(pp.Chain.from_urdf(path), path.name), "joint_compliance")
    assert [re.search(r"mean: (\S+)", line)[1] for line in lines] == ["2e-6", "2e-5"]  # type: ignore[index]


def test_joints_that_no_weight_can_move_get_no_compliance(tmp_path: Path) -> None:
    down, unmoved = (0.0, 0.0, -9.81), "  # turn: weight cannot move it in any pose"
    for axis, mass, gravity, said in (
        ((0, 0, 1), 5.0, down, unmoved),
        (Y, 5.0, (0.0, 0.0, 0.0), unmoved),
        (Y, 0.0, down, "no mass beyond it in the URDF"),
    ):
        turn = turning("turn", "base", "table", axis=axis)
        path = toy(tmp_path, link("base"), link("table", mass, (0.3, 0, 0)), turn)
        text = scaffold(pp.Chain.from_urdf(path, gravity=gravity), path.name)
        assert said in text
        assert not active(text, "joint_compliance")
        assert pp.ErrorModel.load(written(text, tmp_path)).at().posture.load_torque.tolist() == [0.0]


@pytest.mark.slow
def test_poses_stay_within_odd_limits(tmp_path: Path) -> None:
    for kind, *ends in (
        ("revolute", -6.28, 6.28),
        ("revolute", 0.3, 0.3),
        ("revolute", 0.123456, 0.1234561),
        ("revolute", "-INF", 0.5),
        ("revolute", 4, "INF"),
        ("prismatic", -3, -2.9999),
        ("prismatic", "-1e300", "1e300"),
    ):
        first = turning("first", "base", "a", kind, limits(*ends), axis=Y)
        second = turning("second", "a", "b", axis=Y, xyz=(0.3, 0, 0))
        path = toy(tmp_path, link("base"), link("a", 1.0), link("b", 1.0, (0.2, 0, 0)), first, second)
        model = pp.ErrorModel.load(written(scaffold(pp.Chain.from_urdf(path), path.name), tmp_path))
        assert list(model.poses) == ["start", "far"]
        for pose in model.poses:
            assert model.at(pose).findings("exact") == (), ends


def test_locked_joints_mimics_and_another_base(tmp_path: Path) -> None:
    follow = limits(-0.04, 0.04) + '<mimic joint="grip" multiplier="-1" offset="0.002"/>'
    path = toy(
        tmp_path,
        *(link(name, 1.0) for name in ("root", "a", "b", "f1", "f2", "f3")),
        turning("j1", "root", "a", axis=Y, xyz=(0, 0, 0.1)),
        turning("j2", "a", "b", axis=Y, xyz=(0.3, 0, 0)),
        turning("grip", "b", "f1", "prismatic", limits(0.01, 0.04), xyz=(0.2, 0, 0)),
        turning("twin", "b", "f2", "prismatic", follow),
        turning("odd", "b", "f3", "prismatic", follow),
    )
    chain = pp.Chain.from_urdf(path, "root", "b", gravity=(1.5, 0, -9.7), locked={"j2": 0.1, "odd": 1 / 3})
    assert chain.joint_names == ("j1",)
    text = scaffold(chain, path.name)
    assert "They follow others (mimic): twin" in text
    assert "  grip: 0.01 m    # prismatic, 0.01 to 0.04 m" in text
    assert "\nbase: b " in text
    again = pp.ErrorModel.load(written(text, tmp_path)).chain
    assert dict(again.locked) == dict(chain.locked)
    assert again.joint_names == ("j1",)
    assert again.gravity.tolist() == [1.5, 0, -9.7]
    assert_array_equal(again.placements, chain.placements)


def test_beams_are_named_by_links_of_the_file_with_the_base_beyond_them(tmp_path: Path) -> None:
    pairs = (("root", "a"), ("a", "b"), ("b", "tool"))
    joints = [turning(f"j{k}", *pair, xyz=(0.2, 0, 0)) for k, pair in enumerate(pairs)]
    path = toy(tmp_path, *(link(name, 1.0) for name in ("root", "a", "b")), link("tool"), *joints)
    text = scaffold(pp.Chain.from_urdf(path, "root", "tool"), "toy.urdf")
    assert re.findall(r"# - beam: {link: (\w+),", text) == ["b", "a", "root"]
    # 0.6 m reach, so tubes of 50 mm and 3.125 mm wall: E pi/8 d^3 t = 70 GPa * 1.534e-7 m^4 = 1.07e4 N*m^2
    assert text.count("mean: 1e4 N*m^2}, GI: {uniform: 800 N*m^2, mean: 8e3 N*m^2}") == 3


def test_many_locked_joints_stay_compact() -> None:
    text = text_of("tiago")
    block = text[text.index("locked: {") : text.index("poses:")]
    assert block.count("\n") < 20
    assert all(len(line) <= 120 for line in block.splitlines())


def test_a_pose_of_ones_own(tmp_path: Path) -> None:
    chain = chain_of("paper")
    values = [0.1, -1 / 3, 1e-7, -2.0]
    text = scaffold(chain, str(PAPER_ARM), pose=values)
    assert pp.ErrorModel.load(written(text, tmp_path)).poses["start"].tolist() == values
    with pytest.raises(pp.InputError, match="3 joint values for 4 joints"):
        scaffold(chain, "arm.urdf", pose=values[:3])


@pytest.mark.fast(2)
@pytest.mark.parametrize(
    "name", ["a: b", "# c", "on", "12", "手首", "it's", "&quot;x&quot;", "example:r", "back\\slash"]
)
def test_odd_names_survive(name: str, tmp_path: Path) -> None:
    links = link("base"), link(f"{name}1", 1.0, (0.1, 0, 0)), link(name, 1.0, (0.1, 0, 0)), link(f"{name}3")
    first = turning(name, "base", f"{name}1", axis=Y)
    slide = turning(f"{name}2", f"{name}1", name, "prismatic", xyz=(0.2, 0, 0))
    last = turning(f"{name}3", name, f"{name}3", xyz=(0.2, 0, 0))
    path = toy(tmp_path, *links, first, slide, last, name="an arm #1: it's.urdf")
    chain = pp.Chain.from_urdf(path, chain_tip := name.replace("&quot;", '"'))
    model = pp.ErrorModel.load(written(scaffold(chain, path.name), tmp_path))
    assert (model.chain.tip, model.chain.joint_names) == (chain_tip, chain.joint_names)
    assert dict(model.chain.locked) == dict(chain.locked)
    assert np.isfinite(model.at().exact(model.space.sample(0, 0, 5))).all()


def loaded(text: str, version: str) -> object:
    yaml = YAML(typ="safe", pure=True)
    yaml.version = version  # type: ignore[assignment]
    return yaml.load(text)


NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=30) | st.text(string.printable, max_size=12)


def test_words_and_marks_of_yaml_are_quoted() -> None:
    names = ("null", "no", "Y", "~", "d #e", "- f", "0x1F", "...", "---", "{x}", "[y]", "*z", "!v", "%u", "@t", "s:")
    for name in names:
        assert [loaded(f"tip: {quoted(name)}", version) for version in ("1.1", "1.2")] == 2 * [{"tip": name}]


@pytest.mark.slow
@pytest.mark.parametrize("version", ["1.1", "1.2"])
@given(name=NAMES)
def test_quoting_survives_any_name(version: str, name: str) -> None:
    word = quoted(name)
    assert "\n" not in word
    sources = f"- length: {{joint: {word}, at: {word}}}\n- tip: {word}    # note\n"
    assert loaded(sources, version) == [{"length": {"joint": name, "at": name}}, {"tip": name}]
    assert loaded(f"{word}: 1 m\n", version) == {name: "1 m"}


def test_trial_poses_differ_and_the_start_is_the_best_conditioned() -> None:
    survey = Survey.of(chain_of("ur5"))
    assert len({tuple(row) for row in survey.trials.tolist()}) == len(survey.trials)
    postures = [chain_of("ur5").at(np.radians(row)) for row in survey.trials]
    conditions = [np.linalg.svd(posture.joint_jacobian, compute_uv=False)[-1] for posture in postures]
    # the survey weighs lengths by the reach, here they stand in metres: still among the best tenth
    assert sorted(conditions)[-6] <= conditions[survey.start]
    assert survey.start != survey.far
    shoulder = postures[0].joint_poses[0][:3, 3]
    distances = [np.linalg.norm(posture.pose[:3, 3] - shoulder) for posture in postures]
    distances[survey.start] = 0.0
    assert np.argmax(distances) == survey.far
