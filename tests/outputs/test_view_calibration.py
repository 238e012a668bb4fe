"""A calibration in the 3-D page and in the report: residuals, their order, what is said, what a press marks."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses, readings_of
from outputs.view_cases import data_block, nodes_of, pages
from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.figure import calibration_figure
from precision_pin.analyses.calibration.layer import MOST_DRAWN, CalibrationLayer
from precision_pin.analyses.calibration.section import calibration_chapter
from precision_pin.analyses.calibration.table import calibration_table
from precision_pin.base import se3
from precision_pin.pages.view import ViewPose
from precision_pin.sources import JointOffset
from support.browser import chromium, complaints, needs_chromium, visited

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
def case(tmp_path_factory):
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


def page_of(layer: CalibrationLayer) -> str:
    at = layer.result.original.at("home")
    return pages([ViewPose(at, at.exact(at.space.sample(0, 0, 40)), "home")], layers=[layer])


def legend_of(text: str) -> str:
    return text.partition('aria-label="Calibration"')[2].partition("</section>")[0]


def numbers_of(layer: CalibrationLayer, length: float = 1.0) -> tuple[dict, np.ndarray, np.ndarray]:
    """Return the settings of a layer, its points and its residuals, ``(K, 3)``."""
    found = layer.settings(length)
    return found, np.reshape(found["points"], (-1, 3)), np.reshape(found["after"], (-1, 3))


# the lines ---------------------------------------------------------------------------------------


def test_lines_are_the_readings_of_the_file_less_the_target_of_the_calibrated_arm(case):
    """The file is read, and brought to the base, by arithmetic of this test."""
    path, result, layer = case
    lines = path.read_text().splitlines()
    found, points, after = numbers_of(layer)
    assert sorted(found["rows"]) == list(range(2, 16))
    inverse = np.linalg.inv(result.set_up.base)
    for row, point, residual in zip(found["rows"], points, after, strict=True):
        values = [float(text) for text in lines[row - 1].split(",")]
        tip = result.predict(np.radians(values[:4]))
        target = tip[:3, 3] + tip[:3, :3] @ OFF_AXIS
        measured = (inverse @ [*(np.array(values[4:]) / 1e3), 1.0])[:3]
        np.testing.assert_allclose(point, target, atol=1e-6)
        np.testing.assert_allclose(residual, measured - target, atol=2e-9)


def test_the_worst_reading_is_first(case):
    _, result, layer = case
    sizes = {line: float(np.sqrt(sum(r[:3] ** 2))) for line, r in zip(result.data.lines, result.residuals, strict=True)}
    order = []
    while sizes:  # by brute force: again and again the largest of those that are left
        worst = max(sizes, key=lambda line: sizes[line])
        order.append(worst)
        del sizes[worst]
    assert layer.settings(1.0)["rows"] == order
    assert order[0] == ROW
    assert layer.settings(1.0)["gross"] == [0]
    # nothing varies from visit to visit, so that the noise is that of the instrument
    good = layer.worst.deviations[1:]
    np.testing.assert_allclose(good, layer.worst.sizes[1:] / 20e-6, rtol=1e-6)
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
        pp.Measurement("distance", std=2e-5, target=OFF_AXIS, anchor=(3.0, 1.0, 0.5)),
        pp.Measurement("distance", std=2e-5, target=OFF_AXIS, anchor=(3.0, 1.0, 0.5), base="free"),
        pp.Measurement("plane", std=2e-5, target=OFF_AXIS, plane=PLANE, base="free"),
        pp.Measurement("socket", std=2e-5, target=OFF_AXIS, sockets=SOCKETS, base="free"),
    ],
    ids=lambda one: f"{one.kind}-{one.base}",
)
def test_a_residual_is_drawn_along_the_direction_that_is_measured(measurement):
    model, q = small_model(), random_poses(4, 16)
    result = pp.calibrate(model, (q, readings_of(model, q, measurement, seed=2)), measurement)
    worst = CalibrationLayer.of(result).worst
    own = result.residuals[worst.rows]
    np.testing.assert_allclose(np.linalg.norm(worst.after, axis=0), np.linalg.norm(own[:, :3], axis=1), rtol=1e-5)
    np.testing.assert_allclose(worst.sizes, np.linalg.norm(own[:, :3], axis=1))
    for k, row in enumerate(worst.rows):
        tip = result.predict(q[:, row])
        target = tip[:3, 3] + tip[:3, :3] @ result.set_up.target
        np.testing.assert_allclose(worst.points[:, k], target, atol=1e-12)
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
        np.testing.assert_allclose(worst.after[:, k], along, atol=1e-11)


# what is said ------------------------------------------------------------------------------------


def test_the_legend_says_the_answer_and_lists_the_worst_readings(case):
    _, result, layer = case
    text = page_of(layer)
    legend = legend_of(text)
    assert "The model explains the readings" in legend
    assert (
        f"Residuals: {1e3 * result.rms('before'):.3g} mm rms before, {1e3 * result.rms('after'):.3g} mm after" in legend
    )
    buttons = re.findall(
        r'data-reading="(\d+)" aria-pressed="(\w+)">row (\d+): (\S+) mm, (\S+) std(.*?)</button>', legend
    )
    assert [int(one[0]) for one in buttons] == list(range(8))
    assert [one[1] for one in buttons] == ["true", *["false"] * 7]
    assert int(buttons[0][2]) == ROW
    assert [one[5] for one in buttons] == [", no weight", *[""] * 7]
    sizes = [float(one[3]) for one in buttons]
    assert sizes == sorted(sizes, reverse=True)
    assert "all 14 readings" in legend
    numbers = data_block(text, "settings")["layers"]["calibration"]
    assert len(numbers["points"]) == len(numbers["after"]) == len(numbers["before"]) == 3 * 14
    assert any(path.endswith("/calibration/predicted") for path in nodes_of(text))


def test_many_readings_are_few_lines(case):
    """Of 10,000 readings the worst 200 are drawn."""
    _, result, _ = case
    few, count = result.data, 10_000
    chosen = np.arange(count) % len(few)
    scale = np.random.default_rng(0).uniform(0.1, 1.0, (count, 1))
    residuals = result.residuals[chosen] * scale
    data = CalibrationData(
        few.q[:, chosen],
        few.readings[chosen],
        np.zeros(0),
        np.zeros(0),
        "",
        tuple(range(1, count + 1)),
        few.measurements,
        ("",),
    )
    many = replace(
        result,
        data=data,
        residuals=residuals,
        residuals_before=residuals,
        left_out=residuals,
        gross_errors=(),
        set_ups=(replace(result.set_up, base=None),),
    )
    layer = CalibrationLayer.of(many)
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
    legend = layer.legend()
    assert "the reading: line" in legend
    assert "row 1: 0 mm, 0 std" in legend
    page_of(layer)
    calibration_chapter(layer.result)


def test_names_are_never_markup(case):
    _, result, _ = case
    named = replace(result, poses=(replace(result.poses[0], name="<img src=x>"),))
    assert "<img" not in CalibrationLayer.of(named).legend()
    assert "<img" not in calibration_chapter(named).section.text


# the report --------------------------------------------------------------------------------------


def test_the_section_has_the_numbers_of_the_json(case):
    _, result, _ = case
    chapter, found = calibration_chapter(result), json.loads(result.to_json())
    # readable on a screen of 400 px, on which wider figures scroll sideways
    picture = re.search(r'<div class="pair"><figure.*?viewBox="0 0 ([\d.]+) ', chapter.section.text, re.DOTALL)
    assert picture is not None
    assert float(picture[1]) <= 72 * 85 / 25.4 + 1
    text = html.unescape(re.sub(r"<[^>]+>", " ", chapter.section.text))
    rms = {name: f"{1e3 * value:.3g}" for name, value in found["rms_residual"].items()}
    assert (
        f"Residuals: {rms['before']} mm rms before, {rms['after']} mm after; left-out readings: {rms['left_out']} mm rms"
        in text
    )
    assert f"chi-square {found['chi_square']:.4g} for {found['degrees_of_freedom']} degrees of freedom" in text
    (gross,) = found["gross_errors"]
    assert f"row {gross['line']}, {1e3 * gross['size']:.3g} mm or {gross['deviations']:.3g} standard deviations" in text
    before, after, floor = (
        np.sqrt(np.mean([one[which]["rms_position"] ** 2 for one in found["poses"]]))
        for which in ("before", "after", "floor")
    )
    said = f"2 poses: rms {1e3 * before:.3g} mm before, {1e3 * after:.3g} mm after; floor {1e3 * floor:.3g} mm"
    assert said in text
    for one in found["poses"]:
        cells = [one[which][f"{what}_position"] for which in ("before", "after") for what in ("rms", "quantile")]
        assert re.search(r"\s+".join([one["name"], *(re.escape(f"{1e3 * cell:.3g}") for cell in cells)]), text)
    for name, (low, high) in found["intervals"]["numbers"].items():
        assert re.search(rf"{re.escape(name)}\s[^[]*?{re.escape(f'{low:.3g}')}\s+{re.escape(f'{high:.3g}')}\s", text)
    worst = max(zip(found["lines"], found["residuals"], strict=True), key=lambda pair: np.linalg.norm(pair[1]))
    assert re.search(rf"row {worst[0]}\s+{1e3 * np.linalg.norm(worst[1]):.3g}\s", text)
    assert "base of the robot in the instrument's axes, estimated" in text
    assert "before this calibration" in text


def test_the_head_of_the_page_has_the_verdict_what_is_left_and_what_has_no_weight(case):
    _, result, _ = case
    title = " ".join(calibration_figure(result).get_suptitle().split())
    assert title.endswith(".urdf: the calibration helps; the model explains the readings")
    gain, verdict, share, left, gross = calibration_chapter(result).answers
    assert re.search(r"left-out error \S+ → \S+ mm rms", gain)  # a browser breaks lines within "->"
    assert gain.startswith("Calibration: the calibration helps: left-out error ")
    assert "within their 95 %" in share
    assert verdict.startswith("Calibration: the model explains the readings: chi-square ")
    assert "mm" in left
    assert gross.startswith(f"Calibration: 1 reading was given no weight: row {ROW}, ")
    assert calibration_chapter(replace(result, gross_errors=())).answers == (gain, verdict, share, left)
    wrong = replace(result, gross_errors=(), chi_square=1e4)
    assert wrong.verdict == "disagrees"
    head = calibration_chapter(wrong).answers[1]
    assert head.startswith("Calibration: the model does NOT explain the readings: chi-square 1e+04 for ")


def test_a_notebook_shows_the_lines_of_the_table(case):
    _, result, _ = case
    shown = html.unescape(result._repr_html_().removeprefix("<pre>").removesuffix("</pre>"))
    # long sentences go on below
    assert shown.split() == calibration_table(result).split()
    assert max(len(line) for line in shown.splitlines() if "  " not in line.strip()) <= 100


# the JSON ----------------------------------------------------------------------------------------


def test_a_result_is_fitted_again_from_its_file():
    """With deviations and groups of the rows, and at two visits of a pose."""
    model, q = plain_model(), random_poses(4, 8)
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS)
    readings = readings_of(model, q, measurement, seed=4)
    std, group = np.linspace(1e-5, 4e-5, 8), np.array([1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0])
    first = pp.calibrate(model, CalibrationData(q, readings, std, group, "", tuple(range(2, 10))), measurement)
    stored = json.loads(first.to_json())
    given = stored["data"]
    assert given["joints"] == list(model.chain.joint_names)
    data = CalibrationData(
        np.array(given["q"]).T,
        np.array(given["readings"]),
        np.array(given["std"]),
        np.array(given["group"]),
        "",
        tuple(stored["lines"]),
    )
    again = json.loads(pp.calibrate(model, data, measurement).to_json())
    for name in ("posterior", "residuals", "residuals_left_out", "chi_square", "data"):
        assert again[name] == stored[name]


def test_std_and_group_are_in_the_json_only_where_they_are_given(case):
    _, result, _ = case
    found = json.loads(result.to_json())
    assert set(found["data"]) == {"joints", "q", "readings"}
    assert found["readings"] == len(found["data"]["readings"]) == 14
    np.testing.assert_array_equal(np.array(found["data"]["q"]).T, result.data.q)


# the browser -------------------------------------------------------------------------------------

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


@needs_chromium
def test_a_press_marks_a_reading(case, tmp_path):
    _, _, layer = case
    path = tmp_path / "calibration.html"
    path.write_text(page_of(layer), "utf-8")
    with chromium(viewport={"width": 800, "height": 700}) as context:
        visit = visited(context, path)
        page = visit.page
        page.wait_for_selector("body[data-ready=yes]")
        start = page.evaluate(STATE)
        numbers = data_block(path.read_text("utf-8"), "settings")
        own = numbers["layers"]["calibration"]
        points, after = (np.reshape(own[name], (-1, 3)) for name in ("points", "after"))
        times = float(page.inner_text("#calibration-times").replace(",", ""))
        assert times == own["times"]
        drawn = times * after
        is_whole = np.linalg.norm(drawn, axis=1) <= own["longest"]
        np.testing.assert_allclose(np.array(start["balls"])[is_whole], (points + drawn)[is_whole], atol=1e-5)
        assert start["seen"] == is_whole.tolist()
        assert not is_whole[0]
        assert start["row"] == ROW
        np.testing.assert_allclose(start["at"], points[0], atol=1e-6)
        # by the keyboard
        page.locator('[data-reading="3"]').focus()
        page.keyboard.press("Enter")
        then = page.evaluate(STATE)
        assert (then["row"], then["parts"]) == (own["rows"][3], 2)
        np.testing.assert_allclose(then["at"], points[3], atol=1e-6)
        pressed = page.eval_on_selector_all("[data-reading]", "all => all.map((one) => one.ariaPressed)")
        assert pressed == ["true" if k == 3 else "false" for k in range(8)]
        assert (start["thin"], start["shown"]) == (True, True)
        page.uncheck("#calibration-before")
        page.uncheck("#show-calibration")
        last = page.evaluate(STATE)
        assert (last["thin"], last["shown"]) == (False, False)
        assert complaints(visit) == []
