"""The page follows its sliders and the pointer, in a real browser: against runs of changed sheets."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import BrowserContext

from outputs.test_view_browser import opened, picture, set_slider, state
from outputs.view_cases import arm_text, matrix, pages, simple_page
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import ViewPose
from precision_pin.pages.view.headline import answers
from precision_pin.pages.view.poses import ellipsoids
from precision_pin.statistics.plan import specification
from support.browser import Visit, chromium, complaints, needs_chromium

pytestmark = [pytest.mark.slow, needs_chromium]

LIMITS = [specification("0.8 mm @ 95 %"), specification("attitude 2 mrad @ 90 %")]
SAMPLES = 4000


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    with chromium(viewport={"width": 900, "height": 560}) as context:
        yield context


@pytest.fixture
def context(browser: BrowserContext) -> Iterator[BrowserContext]:
    yield browser
    for page in browser.pages:
        page.close()


def sampled(folder: Path, *scales: float) -> ViewPose:
    """Return the samples of a sheet whose four tolerances are so many times as wide; one law is skewed, one rare."""
    first, second, third, fourth = scales
    (folder / "arm.urdf").write_text(arm_text(), "utf-8")
    (folder / "sheet.yaml").write_text(
        f"""precision-pin: 1
robot: arm.urdf
tip: tool
poses: {{p: [0.4 rad, -0.7 rad], q: [-0.4 rad, 0.9 rad]}}
sources:
  - joint_offset: {{joint: turn, offset: {{normal: {0.5 * first} mrad}}}}
  - joint_offset: {{joint: bend, offset: {{uniform: {second} mrad}}}}
  - frame: {{frame: fore, z: {{triangular: {0.3 * third} mm}}}}
  - frame: {{frame: upper, x: {{normal: {{std: {0.1 * fourth} mm}}, mean: 0.2 mm}}}}
""",
        "utf-8",
    )
    model = ErrorModel.load(folder / "sheet.yaml")
    at = model.at("p")
    return ViewPose(at, at.exact(model.space.sample(1, 0, SAMPLES)), "p")


def set_tolerances(visit: Visit, *scales: float) -> None:
    """Set the slider of each tolerance, in the order of the sheet above."""
    script = """(wanted) => { for (const line of document.querySelectorAll("#sliders li")) {
      const [, scale] = wanted.find(([name]) => line.innerText.includes(name));
      const knob = line.querySelector("input");
      knob.value = scale;
      knob.dispatchEvent(new Event("input"));
    } }"""
    names = ("joint_offset[turn]", "joint_offset[bend]", "[fore].z", "[upper].x")
    visit.page.evaluate(script, [[name, scale] for name, scale in zip(names, scales, strict=True)])


def headline(visit: Visit) -> list[str]:
    return visit.page.locator("#headline p").all_inner_texts()


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text.replace(",", ""))]


@pytest.mark.parametrize("scales", [(2.0, 1.0, 1.0, 1.0), (1.0, 3.0, 0.5, 2.0), (0.2, 0.5, 1.5, 0.5)])
def test_moved_tolerances_are_those_of_a_changed_sheet(context, tmp_path, scales):
    visit = opened(context, tmp_path, pages([sampled(tmp_path, 1, 1, 1, 1)], specifications=LIMITS))
    before = headline(visit)
    set_tolerances(visit, *scales)
    fresh = sampled(tmp_path, *(max(scale, 1e-9) for scale in scales)).errors
    found = state(visit)
    size = np.linalg.norm(fresh[:3], axis=0)
    # the very robots, to first order
    points = np.array(found["points"]).reshape(-1, 3)
    np.testing.assert_allclose(points, fresh[:3, :10].T, atol=5e-3 * size.max())
    one, also, quantile = answers(fresh, LIMITS, np.ones(6))
    shown = headline(visit)
    # robots that were moved, not sampled: no verdict
    assert shown[0].split(":")[0] == f"To first order {one.text.split(':')[0].lower()}"
    assert shown[2].split(":")[0] == f"To first order {also.text.split(':')[0].lower()}"
    assert shown[1].endswith("analyze with --set judges it")
    judged = visit.page.locator("#headline .answer").evaluate_all("(all) => all.map((one) => one.dataset.verdict)")
    assert judged == ["estimate", "estimate", ""]
    for detail, expected in ((shown[1], one.detail), (shown[3], also.detail)):
        np.testing.assert_allclose(numbers(detail)[:3], numbers(expected)[:3], atol=0.3)
    low, high = numbers(quantile.detail)[:2]
    assert low <= numbers(shown[4])[1] <= high
    np.testing.assert_allclose(numbers(shown[5])[:2], [low, high], rtol=0.01)
    for given, expected in zip(found["ellipsoids"], ellipsoids(fresh[:3]), strict=True):
        inner = (matrix(given)[:3, :3] / found["factor"]) @ (matrix(given)[:3, :3] / found["factor"]).T
        wanted = expected.matrix[:3, :3] @ expected.matrix[:3, :3].T
        np.testing.assert_allclose(inner, wanted, atol=0.02 * np.abs(wanted).max())
    assert visit.page.is_visible("#changed")
    assert "first order" in visit.page.inner_text("#changed")
    visit.page.click("#reset")
    assert headline(visit) == before
    assert not visit.page.is_visible("#changed")
    assert complaints(visit) == []


def test_the_script_answers_as_python_does(context, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    visit = opened(context, tmp_path, pages([shown], specifications=LIMITS))
    before = headline(visit)
    # a change that is none: the script computes all anew
    set_tolerances(visit, 1, 1, 1, 1 + 1e-12)
    visit.page.evaluate("document.querySelectorAll('#sliders input').forEach((knob) => { knob.step = 'any'; })")
    set_tolerances(visit, 1, 1, 1, 1 + 1e-9)
    assert visit.page.is_visible("#changed")
    shown = [line.replace("; analyze with --set judges it", "") for line in headline(visit)]
    before = [line.replace("; more samples decide it", "") for line in before]
    assert [line.removeprefix("To first order ").capitalize() for line in shown] == [
        line.capitalize() for line in before
    ]


def test_a_pose_keeps_what_was_chosen(context, tmp_path):
    sampled(tmp_path, 1, 1, 1, 1)
    model = ErrorModel.load(tmp_path / "sheet.yaml")
    places = [model.at(name) for name in "pq"]
    shown = [
        ViewPose(at, at.exact(model.space.sample(1, 0, SAMPLES, pose=k)), "pq"[k], k) for k, at in enumerate(places)
    ]
    visit = opened(context, tmp_path, pages(shown, specifications=LIMITS))
    visit.page.click("#look-tip")
    set_tolerances(visit, 2, 1, 1, 0.5)
    set_slider(visit, 50)
    visit.page.uncheck("#show-inner")
    way = "precisionPin.viewer.camera.position.clone().sub(precisionPin.viewer.controls.target).toArray()"
    before, camera = state(visit), visit.page.evaluate(way)
    start = np.array(visit.page.evaluate("precisionPin.viewer.controls.target.toArray()"))
    visit.page.fill("#pose", "1")
    after = state(visit)
    for name in ("factor", "tolerances", "seen", "looking", "count"):
        assert after[name] == before[name], name
    np.testing.assert_allclose(visit.page.evaluate(way), camera, atol=1e-9)
    # the camera has gone with the end effector
    target = np.array(visit.page.evaluate("precisionPin.viewer.controls.target.toArray()"))
    tips = [at.posture.pose[:3, 3] for at in places]
    way = (tips[1] - tips[0])[[0, 2, 1]] * [1, 1, -1]
    np.testing.assert_allclose(target - start, way, atol=1e-9)


def test_the_limit_is_a_ball_as_large_as_it_says_and_what_is_outside_is_red(context, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    visit = opened(context, tmp_path, pages([shown], specifications=LIMITS[:1]))
    found = state(visit)
    (ball,) = found["limits"]
    expected = np.diag([0.8e-3 * found["factor"]] * 3 + [1.0])
    expected[:3, 3] = shown.pose_model.posture.pose[:3, 3]
    np.testing.assert_allclose(matrix(ball), expected, atol=1e-9)
    outside = np.linalg.norm(shown.errors[:3], axis=0) > 0.8e-3
    assert f"{outside.sum():,} of them outside" in visit.page.inner_text("#outside")
    red = np.abs(np.reshape(found["colours"], (-1, 3)) - np.array([0xD1, 0x33, 0x0A]) / 255).max(axis=1) < 0.01
    np.testing.assert_array_equal(red, outside[:10])


def test_pointing_at_a_sample_tells_its_error_and_at_a_joint_its_name(context, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    visit = opened(context, tmp_path, simple_page(shown.pose_model, shown.errors, factor=200))
    place = """(at) => { const { viewer } = precisionPin; const THREE = MeshCat.THREE;
      const frame = document.getElementById("scene-pane").getBoundingClientRect();
      const seen = new THREE.Vector3(at[0], at[2], -at[1]).project(viewer.camera);
      return [frame.left + frame.width * (0.5 + seen.x / 2), frame.top + frame.height * (0.5 - seen.y / 2)]; }"""
    tip = shown.pose_model.posture.pose[:3, 3]
    farthest = int(np.argmax(np.linalg.norm(shown.errors[:3], axis=0)))
    visit.page.mouse.move(*visit.page.evaluate(place, (tip + 200 * shown.errors[:3, farthest]).tolist()))
    visit.page.wait_for_selector("#hover", state="visible")
    words = visit.page.inner_text("#hover")
    assert words.startswith(
        f"Robot {farthest:,} of seed 1: |d| {1e3 * np.linalg.norm(shown.errors[:3, farthest]):#.3g} mm"
    )
    x = shown.pose_model.space.sample(1, 0, SAMPLES)[:, farthest] - shown.pose_model.space.mean
    moved = np.linalg.norm(shown.pose_model.jacobian[:3] * x, axis=0)
    largest = int(np.argmax(moved))
    assert (
        f"Largest part beyond the mean: {shown.pose_model.space.draws[largest].name}, {1e3 * moved[largest]:#.3g} mm"
        in words
    )
    # the same by keyboard
    visit.page.fill("#robot", str(farthest))
    assert visit.page.inner_text("#robot-text") == words
    shoulder = shown.pose_model.posture.link_poses[1, :3, 3]
    visit.page.mouse.move(*visit.page.evaluate(place, shoulder.tolist()))
    visit.page.wait_for_function("document.getElementById('hover').innerText.startsWith('Joint turn')")


def test_the_rulers_are_as_long_as_they_say(context, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    visit = opened(context, tmp_path, simple_page(shown.pose_model, shown.errors, factor=100))
    visit.page.wait_for_timeout(200)
    lengths = visit.page.evaluate(
        "['error', 'arm'].map((name) => document.getElementById(name + '-ruler').getBoundingClientRect().width)"
    )
    words = [visit.page.inner_text(name) for name in ("#error-length", "#arm-scale")]
    metres = [numbers(word)[0] * {"m": 1, "mm": 1e-3, "µm": 1e-6}[word.split()[1]] for word in words]
    # a piece of that length across the view at the tip, by the camera's own projection
    script = """(at) => { const { viewer } = precisionPin; const THREE = MeshCat.THREE;
      const [start, right] = [new THREE.Vector3(at[0], at[2], -at[1]), new THREE.Vector3()];
      right.setFromMatrixColumn(viewer.camera.matrixWorld, 0);
      const end = start.clone().add(right).project(viewer.camera);
      return document.getElementById("scene-pane").clientWidth * (end.x - start.project(viewer.camera).x) / 2; }"""
    per_metre = visit.page.evaluate(script, shown.pose_model.posture.pose[:3, 3].tolist())
    assert lengths[0] == pytest.approx(100 * metres[0] * per_metre, rel=0.01)
    assert lengths[1] == pytest.approx(metres[1] * per_metre, rel=0.01)
    assert all(40 <= length <= 121 for length in lengths)


def test_links_take_the_colour_of_their_share_and_give_it_back(context, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    visit = opened(context, tmp_path, simple_page(shown.pose_model, shown.errors))
    colours = """() => [0, 1, 2].map((link) => { let colour = null;
      precisionPin.viewer.scene_tree.find(["meshcat", "arm", "chain" + link]).object.traverse(
        (one) => { colour = one.material ? one.material.color.toArray() : colour; });
      return colour; })"""
    before = visit.page.evaluate(colours)
    visit.page.check("#shares")
    during = np.array(visit.page.evaluate(colours))
    from precision_pin.pages.view.tolerances import link_shares

    shares = link_shares(shown.pose_model)
    # stronger is less blue
    assert list(np.argsort(-during[:, 2])) == list(np.argsort(shares))
    assert f"0 to {100 * max(shares):.0f} %" in visit.page.inner_text("#share-scale")
    visit.page.uncheck("#shares")
    assert visit.page.evaluate(colours) == before


def test_the_cloud_is_seen_through_the_arm(context, tmp_path):
    # a block about the tip hides all that is not drawn over it
    (tmp_path / "arm.urdf").write_text(
        arm_text(("", "", '<visual><origin xyz="0.3 0 0"/><geometry><box size="0.5 0.5 0.5"/></geometry></visual>')),
        "utf-8",
    )
    shown = sampled(tmp_path, 1, 1, 1, 1)
    text = simple_page(shown.pose_model, shown.errors, factor=300)
    visit = opened(context, tmp_path, text)
    with_cloud = picture(visit)
    visit.page.uncheck("#show-cloud")
    without = picture(visit)
    assert (np.abs(with_cloud - without).max(axis=-1) > 30)[:, 345:].sum() > 300


def test_on_a_phone_nothing_is_off_the_screen_and_the_settings_unfold(browser, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    with browser.browser.new_context(viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True) as phone:
        visit = opened(phone, tmp_path, pages([shown], specifications=LIMITS))
        assert visit.page.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [390, 390]
        assert not visit.page.is_visible("#panel")
        assert visit.page.locator("#pane").bounding_box()["height"] > 450
        assert visit.page.locator("#headline").bounding_box()["y"] < 100
        visit.page.tap("#open")
        panel, pane = (visit.page.locator(name).bounding_box() for name in ("#panel", "#pane"))
        assert panel["y"] + panel["height"] <= 845
        assert pane["height"] > 200
        assert visit.page.get_attribute("#open", "aria-expanded") == "true"


def test_without_webgl_there_are_a_line_and_a_picture(context, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    path = tmp_path / "page.html"
    path.write_text(simple_page(shown.pose_model, shown.errors), "utf-8")
    page = context.new_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page.goto(path.as_uri())
    assert "no WebGL" in page.inner_text("#problem")
    assert page.locator("#still svg").bounding_box()["height"] > 200
    assert "95 % of robots within" in page.inner_text("header")


def test_in_the_dark_the_scene_is_dark_and_large_errors_are_light(browser, tmp_path):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    seen = {}
    for scheme in ("light", "dark"):
        with browser.browser.new_context(viewport={"width": 900, "height": 560}, color_scheme=scheme) as other:
            visit = opened(other, tmp_path, simple_page(shown.pose_model, shown.errors))
            colours = np.reshape(state(visit)["colours"], (-1, 3)).sum(axis=1)
            seen[scheme] = (
                picture(visit)[:, 345:].mean(),
                colours[np.argsort(np.linalg.norm(shown.errors[:3, :10], axis=0))],
            )
    assert seen["dark"][0] < 70 < 150 < seen["light"][0]
    assert (np.diff(seen["dark"][1]) >= 0).all()
    assert (np.diff(seen["light"][1]) <= 0).all()


def luminance(colour: list[int]) -> float:
    parts = np.array(colour[:3]) / 255
    return float(np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_stand_out_from_their_ground(context, tmp_path, scheme):
    shown = sampled(tmp_path, 1, 1, 1, 1)
    visit = opened(context, tmp_path, pages([shown], specifications=LIMITS))
    set_tolerances(visit, 2, 1, 1, 1)
    visit.page.emulate_media(color_scheme=scheme)
    found = visit.page.evaluate("""() => {
      const parts = (text) => text.match(/\\d+/g).map(Number);
      const ground = parts(getComputedStyle(document.querySelector("header")).backgroundColor);
      const answer = document.querySelector(".answer");
      const colours = ["met", "not met", "undecided", "nothing to judge", ""].map((verdict) => {
        answer.dataset.verdict = verdict;
        return parts(getComputedStyle(answer).color);
      });
      const others = ["#changed", "#outside", ".fine", ".x", ".y", ".z", "h1", "summary", "output"];
      return [ground, [...colours, ...others.map((one) => parts(getComputedStyle(document.querySelector(one)).color))]];
    }""")
    ground, colours = found
    for colour in colours:
        low, high = sorted([luminance(ground), luminance(colour)])
        assert (high + 0.05) / (low + 0.05) >= 4.5, colour
