"""Calibration, compensation, map and path in the 3-D page and the report: what is drawn, and what is said."""

import html
import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses, readings_of
from outputs.report_cases import BLANK
from outputs.view_cases import arm_text, data_block, nodes_of, opened, page_at, pose_model
from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.figure import (
    MOST_DRAWN,
    CalibrationLayer,
    calibration_chapter,
    calibration_figure,
)
from precision_pin.analyses.calibration.table import calibration_table
from precision_pin.analyses.compensation.figure import CompensationLayer, _displaced_arm, _joints, compensation_chapter
from precision_pin.analyses.map.figure import PlacesData
from precision_pin.analyses.path.figure import PathLayer
from precision_pin.base import se3
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.draws.laws import Fixed
from precision_pin.render import figure_style
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sources import JointOffset
from support.browser import complaints, needs_chromium

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")]

PLACE = se3.displacement([2.0, -1.0, 0.5, 0.3, -1.2, 0.8])
ROW = 9
"""Row of the file with the gross error."""


def small_model() -> pp.ErrorModel:
    """Return the paper's arm with joint offsets and lengths that are drawn once, and nothing that changes at each visit."""
    chain = paper_model().chain
    offsets = [JointOffset(joint=name, offset=pp.Normal(1e-3)) for name in chain.joint_names]
    return pp.ErrorModel(chain, pp.Space(), offsets, {"home": [0.0, 0.3, 0.5, -0.3], "work": [0.2, -0.4, 0.9, 0.3]})


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """Return a CSV of 14 readings in the axes of a tracker, one of them 2 mm off, and the calibration with a free base."""
    model, q = small_model(), random_poses(4, 14)
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free")
    readings = readings_of(model, q, measurement, seed=3)
    readings[ROW - 2] += [0.0, 2e-3, 0.0]
    seen = readings @ PLACE[:3, :3].T + PLACE[:3, 3]
    path = tmp_path_factory.mktemp("readings") / "tracker.csv"
    header = ", ".join([*(f"{name} [deg]" for name in model.chain.joint_names), "x [mm]", "y [mm]", "z [mm]"])
    rows = np.hstack([np.degrees(q.T), 1e3 * seen])
    np.savetxt(path, rows, "%.7f", delimiter=", ", header=header, comments="")
    result = pp.calibrate(model, path, measurement)
    return path, result, CalibrationLayer.of(result)


def calibration_page(layer: CalibrationLayer) -> str:
    return page_at(layer.result.original, "home", layers=[layer])


def legend_of(text: str, layer: str) -> str:
    return text.partition(f'aria-label="{layer}"')[2].partition("</section>")[0]


# the lines ---------------------------------------------------------------------------------------


def test_lines_are_the_readings_of_the_file_less_the_target_of_the_calibrated_arm(calibrated):
    """The file is read, and brought to the base, by arithmetic of this test."""
    path, result, layer = calibrated
    lines = path.read_text().splitlines()
    found = layer.settings(1.0)
    points, after = (np.reshape(found[name], (-1, 3)) for name in ("points", "after"))
    assert sorted(found["rows"]) == list(range(2, 16))
    inverse = np.linalg.inv(result.set_up.base)
    for row, point, residual in zip(found["rows"], points, after, strict=True):
        values = [float(text) for text in lines[row - 1].split(",")]
        tip = result.predict(np.radians(values[:4]))
        target = tip[:3, 3] + tip[:3, :3] @ OFF_AXIS
        measured = (inverse @ [*(np.array(values[4:]) / 1e3), 1.0])[:3]
        assert_allclose(point, target, atol=1e-6)
        assert_allclose(residual, measured - target, atol=2e-9)
    # the worst is first, the gross error
    sizes = dict(zip(result.data.lines, np.linalg.norm(result.residuals[:, :3], axis=1), strict=True))
    assert found["rows"] == sorted(sizes, key=lambda line: -sizes[line])
    assert (found["rows"][0], found["gross"]) == (ROW, [0])
    # nothing varies from visit to visit, so that the noise is that of the instrument
    assert_allclose(layer.worst.deviations[1:], layer.worst.sizes[1:] / 20e-6, rtol=1e-6)
    assert layer.worst.deviations[0] == result.gross_errors[0].deviations


def test_repeatability_counts_in_standard_deviations():
    """Two readings of one pose: a joint's offset that is new at each visit moves the tip by its lever times its deviation."""
    chain = paper_model().chain
    wide = JointOffset(joint="joint1", offset=pp.Draw("", pp.Normal(1e-3), pp.Scope.VISIT))
    model = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="joint2", offset=pp.Normal(1e-3)), wide])
    q, measurement = np.repeat(random_poses(4, 3), 2, axis=1), pp.Measurement(std=20e-6)
    worst = CalibrationLayer.of(pp.calibrate(model, (q, readings_of(model, q, measurement, seed=1)), measurement)).worst
    for k, row in enumerate(worst.rows):
        slopes = chain.at_columns(q[:, [row]]).joint_jacobian[:3, 0, 0]
        noise = 4e-10 * np.eye(3) + 1e-6 * np.outer(slopes, slopes)
        expected = np.sqrt(worst.after[:, k] @ np.linalg.inv(noise) @ worst.after[:, k])
        assert worst.deviations[k] == pytest.approx(expected, rel=5e-3)


PLANE = ((0.0, 0.0, 0.1), (0.0, 0.6, 0.8))
SOCKETS = ((0.9, 0.2, 0.8), (0.2, 0.9, 1.0))


@pytest.mark.parametrize(
    "measurement",
    [
        pp.Measurement("pose", std=2e-5, target=OFF_AXIS, base="free", target_known=False),
        pp.Measurement("distance", std=2e-5, target=OFF_AXIS, anchor=(3.0, 1.0, 0.5), base="free"),
        pp.Measurement("plane", std=2e-5, target=OFF_AXIS, plane=PLANE, base="free"),
        pp.Measurement("socket", std=2e-5, target=OFF_AXIS, sockets=SOCKETS, base="free"),
    ],
    ids=lambda one: f"{one.kind}-{one.base}",
)
def test_a_residual_is_drawn_along_the_direction_that_is_measured(measurement):
    model, q = small_model(), random_poses(4, 10)
    result = pp.calibrate(model, (q, readings_of(model, q, measurement, seed=2)), measurement)
    worst = CalibrationLayer.of(result).worst
    own = result.residuals[worst.rows]
    assert_allclose(np.linalg.norm(worst.after, axis=0), np.linalg.norm(own[:, :3], axis=1), rtol=1e-5)
    assert_allclose(worst.sizes, np.linalg.norm(own[:, :3], axis=1))
    for k, row in enumerate(worst.rows):
        tip = result.predict(q[:, row])
        target = tip[:3, 3] + tip[:3, :3] @ result.set_up.target
        assert_allclose(worst.points[:, k], target, atol=1e-12)
        if measurement.kind == "distance":
            sight = target - result.set_up.anchor
            along = own[k, 0] * sight / np.linalg.norm(sight)
            distance = np.linalg.norm(sight) + own[k, 0]
            assert result.data.readings[row, 0] == pytest.approx(distance, abs=1e-9)
        elif measurement.kind == "plane":
            along = own[k, 0] * result.set_up.plane[1]
        elif measurement.kind == "socket":
            given = int(np.argmin([np.linalg.norm(np.subtract(one, target)) for one in SOCKETS]))
            along = result.set_up.sockets[given] + result.data.readings[row] - target
        else:
            placed = result.set_up.base
            along = placed[:3, :3].T @ (result.data.readings[row, :3] - placed[:3, 3]) - target
        assert_allclose(worst.after[:, k], along, atol=1e-11)


# what is said ------------------------------------------------------------------------------------


def test_the_legend_says_the_answer_and_lists_the_worst_readings(calibrated):
    _, result, layer = calibrated
    text = calibration_page(layer)
    legend = legend_of(text, "Calibration")
    assert "The model explains the readings" in legend
    before, after = (f"{1e3 * result.rms(when):.3g} mm" for when in ("before", "after"))
    assert f"Residuals: {before} rms before, {after} after" in legend
    buttons = r'data-reading="(\d+)" aria-pressed="(\w+)">row (\d+): (\S+) mm, \S+ std(.*?)</button>'
    order, pressed, rows, sizes, said = zip(*re.findall(buttons, legend), strict=True)
    assert [*map(int, order)] == [*range(8)]
    assert (pressed, said) == (("true", *["false"] * 7), (", no weight", *[""] * 7))
    assert int(rows[0]) == ROW
    assert sorted(sizes, key=float, reverse=True) == [*sizes]
    assert "all 14 readings" in legend
    numbers = data_block(text, "settings")["layers"]["calibration"]
    assert len(numbers["points"]) == len(numbers["after"]) == len(numbers["before"]) == 3 * 14
    assert any(path.endswith("/calibration/predicted") for path in nodes_of(text))


def test_many_readings_are_few_lines(calibrated):
    """Of 10,000 readings the worst 200 are drawn."""
    _, result, _ = calibrated
    few, count = result.data, 10_000
    chosen = np.arange(count) % len(few)
    scale = np.random.default_rng(0).uniform(0.1, 1.0, (count, 1))
    residuals = result.residuals[chosen] * scale
    lines, none = tuple(range(1, count + 1)), np.zeros(0)
    data = CalibrationData(few.q[:, chosen], few.readings[chosen], none, none, "", lines, few.measurements, ("",))
    all_residuals = dict.fromkeys(("residuals", "residuals_before", "left_out"), residuals)
    set_up = replace(result.set_up, base=None)
    layer = CalibrationLayer.of(replace(result, data=data, gross_errors=(), set_ups=(set_up,), **all_residuals))
    found = layer.settings(1.0)
    assert len(found["rows"]) == MOST_DRAWN
    assert set(found["rows"]) == set(np.argsort(-np.linalg.norm(residuals, axis=1))[:MOST_DRAWN] + 1)
    assert f"the worst {MOST_DRAWN} of 10,000 readings" in layer.legend()
    assert len(json.dumps(found)) < 40_000
    assert 'id="calibration-before">' in layer.legend()


def test_one_reading_without_residual():
    model, q = small_model(), random_poses(4, 1)
    exact = model.chain.at_columns(q).pose[:3, 3].T
    layer = CalibrationLayer.of(pp.calibrate(model, (q, exact), pp.Measurement(std=20e-6)))
    found = layer.settings(1.0)
    assert (found["times"], found["largest"]) == (1.0, 0.0)
    assert np.allclose(found["after"], 0.0, atol=1e-15)
    for words in ("the reading: line", "row 1: 0 mm, 0 std"):
        assert words in layer.legend()
    calibration_page(layer)
    calibration_chapter(layer.result)


# the report --------------------------------------------------------------------------------------


def test_the_section_has_the_numbers_of_the_json(calibrated, monkeypatch):
    _, result, _ = calibrated
    monkeypatch.setattr(figure_style, "_svg", lambda _: BLANK)  # the test of the page's head draws it
    chapter, found = calibration_chapter(result), json.loads(result.to_json())
    text = html.unescape(re.sub(r"<[^>]+>", " ", chapter.section.text))
    rms = {name: f"{1e3 * value:.3g}" for name, value in found["rms_residual"].items()}
    assert f"Residuals: {rms['before']} mm rms before, {rms['after']} mm after; left-out" in text
    assert f"left-out readings: {rms['left_out']} mm rms" in text
    assert f"chi-square {found['chi_square']:.4g} for {found['degrees_of_freedom']} degrees of freedom" in text
    (gross,) = found["gross_errors"]
    assert f"row {gross['line']}, {1e3 * gross['size']:.3g} mm or {gross['deviations']:.3g} standard deviations" in text
    before, after, floor = (
        1e3 * np.sqrt(np.mean([one[which]["rms_position"] ** 2 for one in found["poses"]]))
        for which in ("before", "after", "floor")
    )
    assert f"2 poses: rms {before:.3g} mm before, {after:.3g} mm after; floor {floor:.3g} mm" in text
    for one in found["poses"]:
        cells = [one[which][f"{what}_position"] for which in ("before", "after") for what in ("rms", "quantile")]
        assert re.search(r"\s+".join([one["name"], *(re.escape(f"{1e3 * cell:.3g}") for cell in cells)]), text)
    for name, (low, high) in found["intervals"]["numbers"].items():
        units = {"mm": 1e3, "mrad": 1e3, "µm": 1e6, "µrad": 1e6, "deg": 180 / np.pi}
        rows = (
            rf"{re.escape(name)}\s+{unit}\s[^[]*?{re.escape(f'{scale * low:.3g}')}\s+{re.escape(f'{scale * high:.3g}')}\s"
            for unit, scale in units.items()
        )
        assert any(re.search(row, text) for row in rows), name
    worst = max(zip(found["lines"], found["residuals"], strict=True), key=lambda pair: np.linalg.norm(pair[1]))
    assert re.search(rf"row {worst[0]}\s+{1e3 * np.linalg.norm(worst[1]):.3g}\s", text)
    assert "base of the robot in the instrument's axes, estimated" in text
    assert "before this calibration" in text


def test_the_head_of_the_page_has_the_verdict_what_is_left_and_what_has_no_weight(calibrated, monkeypatch):
    _, result, _ = calibrated
    named = replace(result, poses=(replace(result.poses[0], name="<img src=x>"),))
    assert "<img" not in CalibrationLayer.of(named).legend() + calibration_chapter(named).section.text
    monkeypatch.setattr(figure_style, "_svg", lambda _: BLANK)
    title = " ".join(calibration_figure(result).get_suptitle().split())
    assert title.endswith(".urdf: the calibration helps; the model explains the readings")
    gain, verdict, share, left, frame, gross = calibration_chapter(result).answers
    assert re.search(r"left-out error \S+ → \S+ mm rms", gain)  # a browser breaks lines within "->"
    assert gain.startswith("Calibration: the calibration helps: left-out error ")
    assert "within their 95 %" in share
    assert verdict.startswith("Calibration: the model explains the readings: chi-square ")
    assert "mm" in left
    assert "mm" in frame
    assert gross.startswith(f"Calibration: 1 reading was given no weight: row {ROW}, ")
    assert calibration_chapter(replace(result, gross_errors=())).answers == (gain, verdict, share, left, frame)
    wrong = replace(result, gross_errors=(), chi_square=1e4)
    assert wrong.verdict == "disagrees"
    head = calibration_chapter(wrong).answers[1]
    assert head.startswith("Calibration: the model does NOT explain the readings: chi-square 1e+04 for ")


def test_a_notebook_shows_the_lines_of_the_table(calibrated):
    _, result, _ = calibrated
    shown = html.unescape(result._repr_html_().removeprefix("<pre>").removesuffix("</pre>"))
    # long sentences go on below
    assert shown.split() == calibration_table(result).split()
    assert max(len(line) for line in shown.splitlines() if "  " not in line.strip()) <= 100


# the JSON ----------------------------------------------------------------------------------------


def test_a_result_is_fitted_again_from_its_file(calibrated):
    """With deviations and groups of the rows, and at two visits of a pose; they are in the file only where given."""
    model, q = plain_model(), random_poses(4, 8)
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS)
    readings = readings_of(model, q, measurement, seed=4)
    std, group = np.linspace(1e-5, 4e-5, 8), np.repeat([1.0, 2.0, 3.0, 4.0], 2)
    first = pp.calibrate(
        model, CalibrationData(q, readings, std, group, "", tuple(range(2, 10))), measurement, at="work"
    )
    stored = json.loads(first.to_json())
    given = stored["data"]
    assert given["joints"] == list(model.chain.joint_names)
    arrays = (np.array(given[name]) for name in ("readings", "std", "group"))
    data = CalibrationData(np.array(given["q"]).T, *arrays, "", tuple(stored["lines"]))
    again = json.loads(pp.calibrate(model, data, measurement, at="work").to_json())
    for name in ("posterior", "residuals", "residuals_left_out", "chi_square", "data"):
        assert again[name] == stored[name]
    found = json.loads(calibrated[1].to_json())
    assert set(found["data"]) == {"joints", "q", "readings"}
    assert found["readings"] == len(found["data"]["readings"]) == 14


@pytest.fixture(scope="module")
def compensated(model):
    """Return the model, the compensation of three poses of the paper's arm, and its layer."""
    q = model.configuration("paper")[:, None] + np.outer([0.5, 0.3, -0.2, 0], [0, 0.5, 1])
    made = pp.compensate(model, q)
    return model, made, CompensationLayer.of(made, model)


def test_the_tips_are_those_of_the_exact_model_and_the_page_says_what_it_draws(compensated):
    model, made, layer = compensated
    pose, before = layer.worst, np.linalg.norm(made.correction.before[:3], axis=0)
    assert pose == before.argmax()
    deflected, commanded, corrected = layer.arms[:, :, -1]
    mean = model.space.mean[:, None]
    assert_allclose(deflected, model.at(made.poses.q[:, pose]).exact(mean)[:3, 0], atol=1e-9)
    assert_allclose(corrected, 0, atol=1e-9)
    at = model.at(made.corrected[:, pose])
    assert_allclose(commanded, at.posture.pose[:3, 3] - made.poses.position[:, pose], atol=1e-12)
    assert_allclose(commanded, -at.exact(mean)[:3, 0], atol=1e-9)
    text = page_at(model, layers=[layer])
    assert f"from {1e3 * before.max():.4g} mm at worst" in legend_of(text, "Compensation")
    lines = data_block(text, "settings")["layers"]["compensation"]["lines"]
    assert len(lines) == 6
    assert all(len(line["points"]) == len(line["moves"]) for line in lines)
    assert any(path.endswith("/compensation/wanted") for path in nodes_of(text))


def test_a_displaced_joint_stays_at_the_end_of_its_displaced_link(tmp_path):
    """A turn by 0.01 rad of the first joint turns every point behind it about that joint's axis."""
    at = pose_model(tmp_path, arm_text(), JointOffset(joint="turn", offset=Fixed(0.01)))
    expected = se3.rotation_about((0, 0, 1), 0.01) @ _joints(at.posture)
    assert_allclose(_displaced_arm(at), expected, atol=1e-12)


def test_a_pose_without_a_correction_is_said(compensated):
    model, _, _ = compensated
    far = model.configuration("paper").copy()
    far[1] = model.chain.configurations.limits[1][1] + 0.1
    made = pp.compensate(model, far[:, None])
    assert made.correction.status == ("limit",)
    chapter = compensation_chapter(made)
    assert chapter.answers == ("Compensation: no pose has a correction: limit",)
    assert CompensationLayer.of(made, model).settings(1.0)["lines"] == []


AWAY = np.array([1.0, 2.0, 3.0])
REACHES = (-0.6, -0.2, 0.3)
"""Of the two places of two branches and a third one, by joint 2."""


@pytest.fixture(scope="module")
def mapped():
    """Return the paper's arm, a map of two places, of one of which two poses are known, and of one out of reach; its page."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionPinWarning)
        model = pp.ErrorModel.load(PAPER_SHEET)
        q = model.configuration("paper")[:, None] + np.outer([0, 1, 0, 0], [*REACHES, 0.0])
        poses = PoseSet.at(model.chain, q)
        hole, position = q.copy(), poses.position.copy()
        hole[:, 3], position[:, 3] = np.nan, AWAY
        # the second pose is said to be at the first one's place, as another branch would be
        position[:, 1] = position[:, 0]
        poses = replace(poses, q=hole, position=position, status=("reached",) * 3 + ("unreachable",))
        found = pp.map_poses(model, poses, verify=0)
    return found, page_at(model, layers=[PlacesData.of(found)]), page_at(model)


def test_every_place_has_a_mark_coloured_by_its_worst_pose_as_the_legend_says(mapped):
    found, text, without = mapped
    marks = {path.rpartition("/")[2]: node.object for path, node in nodes_of(text).items() if "/map/" in path}
    # six corners of a surface each
    centres = {name: positions(mark).reshape(-1, 6, 3).mean(axis=1) for name, mark in marks.items()}
    size = found.quantile[1, 0]
    of_place = max(size[:2]), size[2]
    worst = 0 if of_place[0] > of_place[1] else 2
    places = found.poses.position.T
    expected = {"level16": places[[worst]], "level0": places[[2 - worst]], "unreached": [AWAY]}
    assert centres.keys() == expected.keys()
    for name, where in expected.items():
        assert_allclose(centres[name], where, atol=1e-6, err_msg=name)
    # light for small, dark for large, as the bar says
    light, dark = (marks[name]["materials"][0]["color"] for name in ("level0", "level16"))
    assert sum(light.to_bytes(3)) > sum(dark.to_bytes(3))
    assert "2 places, coloured by the worst pose at each; grey: 1 place that is not reached" in text
    ticks = text.partition('aria-label="Map"')[2].partition("</p>")[0]
    shown = [float(tick.partition("<")[0]) for tick in ticks.split("<span>")[1:]]
    assert_allclose([shown[0], shown[-1]], sorted(1e3 * np.array(of_place)), atol=0.5)  # written in whole mm
    assert "show-map" not in without
    assert (data_block(text, "settings")["layers"], data_block(without, "settings")["layers"]) == ({"map": {}}, {})


def positions(of: dict) -> np.ndarray:
    return np.frombuffer(of["geometries"][0]["data"]["attributes"]["position"]["array"].data, "<f4")


@pytest.fixture(scope="module")
def followed(model):
    """Return the law along five poses of the paper's arm, and its page."""
    q = model.configuration("paper")[:, None] + np.outer([0.5, 0.3, -0.2, 0], np.linspace(0, 1, 5))
    found = pp.path_law(model, q, samples=400)
    return found, page_at(model, layers=[PathLayer.of(found)])


def test_the_line_leads_through_the_points_and_the_numbers_are_those_of_the_path(followed):
    found, text = followed
    node = next(node for path, node in nodes_of(text).items() if path.endswith("/path/line"))
    points = found.poses.position.T
    expected = np.stack([points[:-1], points[1:]], axis=1)
    assert_allclose(positions(node.object).reshape(-1, 2, 3), expected, atol=1e-6)
    numbers = data_block(text, "settings")["layers"]["path"]
    assert_allclose(numbers["band"], found.band[0], rtol=1e-6)
    assert_allclose(numbers["quantile"], found.curve[0], rtol=1e-6)
    assert numbers["worst"] == found.worst_pose(0)
    legend = legend_of(text, "Path")
    low, high = found.maximum_quantile(0, 0.95).interval
    numbers = re.search(r"stay within (\S+) mm all .*, interval (\S+) to (\S+) mm at 95 % confidence", legend).groups()
    said, *ends = (1e-3 * float(number) for number in numbers)
    assert ends[0] <= low <= said <= high <= ends[1]
    assert ends == pytest.approx([low, high], rel=0.01)
    assert f"most have their largest error at {found.poses.labels[found.worst_pose(0)]}" in legend


def test_colours_do_not_show_the_scatter_of_samples(model):
    q = model.configuration("paper")[:, None] + np.outer([1, 0, 0, 0], np.linspace(0, 1, 4))
    found = pp.path_law(model, q, samples=400)
    scale = PathLayer.of(found).scale
    assert np.ptp(found.curve[0]) < 0.05 * found.curve[0].max()
    assert scale.smallest <= 0.9 * found.curve[0].max()


STATE = """() => {
  const layer = precisionPin.viewer.scene_tree.find(["meshcat", "calibration"]).object;
  const balls = layer.children.filter((one) => one.isMesh && one.geometry.type === "SphereGeometry");
  const mark = layer.children.find((one) => one.userData.row !== undefined);
  return {
    balls: balls.map((one) => one.position.toArray()), seen: balls.map((one) => one.visible),
    row: mark.userData.row, at: mark.position.toArray(), parts: mark.children.length,
    thin: layer.children.find((one) => one.isLineSegments).visible, shown: layer.visible,
  };
}"""
CORNERS = """(mesh) => Array.from(precisionPin.viewer.scene_tree.find(["meshcat", "path"]).object.children
  .filter((one) => one.isMesh && one.geometry.index && one.geometry.attributes.color)[mesh]
  .geometry.attributes.position.array)"""
BALLS = """() => precisionPin.viewer.scene_tree.find(["meshcat", "compensation"]).object.children
  .filter((one) => one.isMesh && one.geometry.type === "SphereGeometry").map((one) => one.position.toArray())"""


@needs_chromium
def test_layers_are_drawn_as_large_as_the_legend_says_marked_by_a_press_and_switched_off(
    calibrated, compensated, mapped, followed, context, tmp_path
):
    found, compensation = followed[0], compensated[2]
    layers = [calibrated[2], compensation, PlacesData.of(mapped[0]), PathLayer.of(found)]
    text = page_at(compensated[0], layers=layers)
    visit = opened(context, tmp_path, text)
    page, settings = visit.page, data_block(text, "settings")
    own = settings["layers"]["calibration"]
    start = page.evaluate(STATE)
    points, after = (np.reshape(own[name], (-1, 3)) for name in ("points", "after"))
    times = float(page.inner_text("#calibration-times").replace(",", ""))
    assert times == own["times"]
    drawn = times * after
    is_whole = np.linalg.norm(drawn, axis=1) <= own["longest"]
    assert_allclose(np.array(start["balls"])[is_whole], (points + drawn)[is_whole], atol=1e-5)
    assert start["seen"] == is_whole.tolist()
    assert not is_whole[0]
    # by the keyboard
    page.locator('[data-reading="3"]').focus()
    page.keyboard.press("Enter")
    then = page.evaluate(STATE)
    for state, row, reading in ((start, ROW, 0), (then, own["rows"][3], 3)):
        assert state["row"] == row
        assert_allclose(state["at"], points[reading], atol=1e-6)
    assert then["parts"] == 2
    pressed = page.eval_on_selector_all("[data-reading]", "all => all.map((one) => one.ariaPressed)")
    assert pressed == ["true" if k == 3 else "false" for k in range(8)]
    page.uncheck("#calibration-before")
    page.uncheck("#show-calibration")
    last = page.evaluate(STATE)
    assert [one[name] for one in (start, last) for name in ("thin", "shown")] == [True, True, False, False]

    times = float(page.inner_text("#compensation-times"))
    arms = np.reshape(page.evaluate(BALLS), (3, -1, 3)).swapaxes(1, 2)
    assert_allclose(arms, compensation.nominal + times * compensation.arms, atol=1e-5)
    assert page.evaluate("precisionPin.state().seen.map") is True
    page.uncheck("#show-map")
    assert page.evaluate("precisionPin.state().seen.map") is False
    points = found.poses.position.T
    for times in (1.0, 3.0):
        page.evaluate(
            "(value) => { const f = document.getElementById('factor'); f.value = value; f.dispatchEvent(new Event('input')); }",
            np.log10(times * settings["factor"]),
        )
        said = float(page.inner_text("#path-times"))
        assert said == pytest.approx(times * settings["layers"]["path"]["times"], rel=0.01)
        for mesh, radii in enumerate((found.curve[0], found.band[0])):
            away = np.reshape(page.evaluate(CORNERS, mesh), (5, 16, 3)) - points[:, None]
            widths = np.linalg.norm(away, axis=2)
            assert_allclose(widths, np.tile(said * radii[:, None], 16), rtol=0.01)
            way = points[2] - points[0]
            assert_allclose(away[1] @ way, 0, atol=1e-3 * widths[1, 0] * np.linalg.norm(way))
    assert complaints(visit) == []
