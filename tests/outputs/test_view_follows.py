"""The page in a real browser: its console, its requests, and the state of the scene.

A page takes seconds to open, so that tests share those that are ``kept_open``, and set what they rest on.
"""

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib import colormaps
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from playwright.sync_api import BrowserContext

import precision_pin as pp
from outputs.view_cases import (
    arm_model,
    arm_text,
    composed,
    data_block,
    enlarged,
    floats,
    likeness,
    matrix,
    opened,
    pages,
    simple_page,
)
from precision_pin.base import se3
from precision_pin.pages.view import ViewPose
from precision_pin.pages.view.headline import answers
from precision_pin.pages.view.poses import ellipsoids, link_shares
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import Frame, JointOffset
from precision_pin.statistics.limits import are_inside
from support.browser import Visit, complaints, needs_chromium, outside_requests
from support.sheets import SEVEN_Q, everything, seven_joint_arm

pytestmark = [pytest.mark.slow, needs_chromium]

KINDS = ("cloud", "mean", "inner", "outer", "tip", "frames", "arm", "ghosts", "deflected", "mcpc", "base", "grid")
LIMITS = [pp.specification("0.8 mm @ 95 %"), pp.specification("attitude 2 mrad @ 90 %")]
SAMPLES = 4000
TARGET = "precisionPin.viewer.controls.target"


def kept_open(context: BrowserContext, folder: Path, text: str, fragment: str = "") -> Iterator[Visit]:
    visit = opened(context, folder, text, fragment)
    yield visit
    assert complaints(visit) == outside_requests(visit) == []


@pytest.fixture(scope="module")
def paper():
    model = pp.ErrorModel.load(PAPER_SHEET)
    at = model.at()
    return at, at.exact(model.space.sample(1, 0, 2000))


@pytest.fixture(scope="module")
def paper_visit(browser, paper, tmp_path_factory):
    yield from kept_open(browser, tmp_path_factory.mktemp("paper"), simple_page(*paper))


@pytest.fixture(scope="module")
def three_poses():
    """Every kind of source, three poses, draws of pose scope anew at each."""
    model = everything(seven_joint_arm())
    poses = [SEVEN_Q, tuple(-0.5 * value for value in SEVEN_Q), (0.1,) * 7]
    return [
        ViewPose(at, at.exact(model.space.sample(1, 0, 60, pose=number)), f"pose {number}", number)
        for number, at in enumerate(map(model.at, poses))
    ]


@pytest.fixture(scope="module")
def three_page(three_poses):
    return pages(three_poses)


@pytest.fixture(scope="module")
def three_visit(browser, three_page, tmp_path_factory):
    fragment = "#factor=50&look=tip&pose=2&about=mean"
    yield from kept_open(browser, tmp_path_factory.mktemp("three"), three_page, fragment)


def sampled(folder: Path, *scales: float, arm: str | None = None) -> list[ViewPose]:
    """Return two poses of an arm whose four tolerances are so many times as wide; one law is skewed, one rare."""
    first, second, third, fourth = scales or (1, 1, 1, 1)
    model = arm_model(
        folder,
        arm or arm_text(),
        JointOffset(joint="turn", offset=pp.Normal(0.5e-3 / 3 * first)),
        JointOffset(joint="bend", offset=pp.Uniform(1e-3 * second)),
        Frame(frame="fore", z=pp.Triangular(0.3e-3 * third)),
        Frame(frame="upper", x=pp.Normal(0.1e-3 * fourth, mean=0.2e-3)),
    )
    return [
        ViewPose(at, at.exact(model.space.sample(1, 0, SAMPLES, pose=k)), "pq"[k], k)
        for k, at in enumerate(map(model.at, "pq"))
    ]


@pytest.fixture(scope="module")
def shown(tmp_path_factory) -> list[ViewPose]:
    return sampled(tmp_path_factory.mktemp("sheet"))


@pytest.fixture(scope="module")
def kept_limited(browser, shown, tmp_path_factory):
    yield from kept_open(browser, tmp_path_factory.mktemp("limited"), pages(shown, specifications=LIMITS))


@pytest.fixture
def limited(kept_limited):
    """Return the page of two poses with limits, at the first of them and with the tolerances of the sheet."""
    kept_limited.page.fill("#pose", "0")
    kept_limited.page.evaluate("document.getElementById('reset').click()")
    return kept_limited


def state(visit: Visit) -> dict:
    return visit.page.evaluate("precisionPin.state()")


def set_slider(visit: Visit, factor: float) -> None:
    visit.page.locator("#factor").evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }", np.log10(factor)
    )


def picture(visit: Visit) -> np.ndarray:
    """Return what the browser shows beside the panel, ``(height, width, 3)``, once the scene is drawn."""
    visit.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    shot = Image.open(io.BytesIO(visit.page.screenshot()))
    return np.asarray(shot.convert("RGB"), dtype=int)[:, 345:]


def displacements_of(at, x: np.ndarray) -> np.ndarray:
    return at.table.displacements(at.table.products(at.table.program.evaluate(x)))


def body_data(visit: Visit, *names: str) -> list[str | None]:
    return [visit.page.locator("body").get_attribute(f"data-{name}") for name in names]


def test_boxes_show_what_they_name_and_buttons_do_what_they_say(paper_visit):
    visit = paper_visit
    found = state(visit)
    assert (found["factor"], found["pose"], found["playing"]) == (100, 1, False)
    assert {name for name, seen in found["seen"].items() if not seen} == {"ghosts", "deflected", "mcpc", "limit"}
    assert set(found["seen"]) == {*KINDS, "limit"}
    words = visit.page.inner_text("#panel")
    for text in ("Position error |d|, mm", "Whole arm", "End effector", "N = 2,000", "% of the samples inside"):
        assert text in words
    assert not visit.page.is_visible("#pose")
    for name in KINDS:
        visit.page.click(f"#show-{name}")
        # without a limit there is none to show
        assert state(visit)["seen"] == {**found["seen"], name: not found["seen"][name]}
        visit.page.click(f"#show-{name}")

    def far() -> float:
        return visit.page.evaluate(f"precisionPin.viewer.camera.position.distanceTo({TARGET})")

    def opacity() -> float:
        path = "['meshcat', 'arm', 'link2', 'shape0', '<object>']"
        return visit.page.evaluate(f"precisionPin.viewer.scene_tree.find({path}).object.material.opacity")

    set_slider(visit, 20)
    visit.page.click("#look-arm")
    arm = far()
    visit.page.click("#look-tip")
    assert far() < 0.5 * arm
    visit.page.click("#look-arm")
    assert far() == pytest.approx(arm, rel=1e-9)
    set_slider(visit, 100)
    visit.page.check("#see-through")
    assert opacity() == 0.25
    visit.page.uncheck("#see-through")
    assert opacity() == 1


def test_errors_stand_about_the_tip_from_their_mean_and_beside_it_from_zero(paper_visit, paper):
    at, errors = paper
    tip, mean = at.table.pose, errors.mean(axis=1)
    x = at.space.sample(1, 0, 1)
    built, middle = displacements_of(at, x)[:, :, 0], displacements_of(at, at.space.mean[:, None])[:, :, 0]
    visit = paper_visit
    visit.page.check("#show-ghosts")

    def stands(factor: float, from_mean: float, words: str) -> None:
        found = state(visit)
        assert found["factor"] == factor
        expected = tip[:3, 3] + factor * (errors[:3, :10].T - from_mean * mean[:3])
        cloud = matrix(found["cloud"])
        points = np.array(found["points"]).reshape(-1, 3)
        assert_allclose(points @ cloud[:3, :3].T + cloud[:3, 3], expected, atol=1e-6 * factor)
        moved = enlarged(errors[:, 0] - from_mean * mean, factor)
        assert_allclose(matrix(found["frames"][0])[:3, 3], tip[:3, 3] + moved[:3, 3], atol=1e-9)
        assert_allclose(matrix(found["frames"][0])[:3, :3], moved[:3, :3] @ tip[:3, :3], atol=1e-9)
        ghost = composed(at.table.frames, built - from_mean * middle, factor)[-1] @ tip
        assert_allclose(matrix(found["ghosts"][0]["tip"]), ghost, atol=1e-5 * factor)
        assert visit.page.inner_text("#caption-about") == words

    from_mean = "from the mean error, which is 36.8 mm"
    stands(100, 1, from_mean)
    # the headline anew for a change that is none, and as it was
    before = headline(visit)
    assert before[2].startswith("Mean error 36.8 mm")
    visit.page.evaluate("knob = document.getElementById('tolerance0'); knob.step = 'any'; knob.value = 1 + 1e-9")
    visit.page.evaluate("knob.dispatchEvent(new Event('input'))")
    assert visit.page.is_visible("#changed")
    assert headline(visit) == before
    visit.page.click("#reset")
    visit.page.select_option("#about", "zero")
    stands(150, 0, "from zero error")
    assert body_data(visit, "about") == ["zero"]
    visit.page.select_option("#about", "mean")
    stands(100, 1, from_mean)


def test_the_address_says_how_the_page_opens_and_the_slider_enlarges_everything_together(three_visit, three_poses):
    visit = three_visit
    assert body_data(visit, "factor", "look", "pose", "about") == ["50", "tip", "2", "mean"]
    visit.page.select_option("#about", "zero")
    shown = three_poses[1]
    at, errors = shown.pose_model, shown.errors
    tip = at.table.pose
    x = at.space.sample(1, 0, 3, pose=1)
    built, mean = displacements_of(at, x), displacements_of(at, at.space.mean[:, None])[:, :, 0]
    visit.page.check("#show-ghosts")
    visit.page.check("#show-deflected")
    for factor in (1.0, 10.0, 100.0):
        set_slider(visit, factor)
        found = state(visit)
        cloud = matrix(found["cloud"])
        points = np.array(found["points"]).reshape(-1, 3)
        # three.js keeps positions in single precision
        assert_allclose(
            points @ cloud[:3, :3].T + cloud[:3, 3], tip[:3, 3] + factor * errors[:3, :10].T, atol=1e-6 * factor
        )
        assert_allclose(matrix(found["mean"]), cloud, atol=1e-12)
        for numbers, one in zip(found["ellipsoids"], ellipsoids(errors[:3]), strict=True):
            expected = se3.translation(tip[:3, 3]) @ np.diag([factor, factor, factor, 1]) @ one.matrix
            assert_allclose(matrix(numbers), expected, atol=1e-12)
        for unit, numbers in enumerate(found["frames"]):
            moved = enlarged(errors[:, unit], factor)
            expected = se3.pose(moved[:3, :3] @ tip[:3, :3], tip[:3, 3] + moved[:3, 3])
            assert_allclose(matrix(numbers), expected, atol=1e-12)
        drawn = [*found["ghosts"], found["deflected"]]
        for one, moves in zip(drawn, [*np.moveaxis(built, 2, 0), mean], strict=True):
            expected = composed(at.table.frames, moves, factor)[-1] @ tip
            assert_allclose(matrix(one["tip"]), expected, atol=1e-6 * factor)
        assert_allclose(matrix(found["tip"]), tip, atol=1e-12)
        assert visit.page.inner_text("#factor-text") == visit.page.inner_text("#caption-factor") == f"{factor:g}"
        assert f"drawn {factor:g} mm long" in visit.page.inner_text("#example")


def test_the_pose_slider_switches_arm_cloud_ellipsoids_and_caption(three_visit, three_poses, three_page):
    visit = three_visit
    visit.page.select_option("#about", "zero")
    for name in ("ghosts", "deflected", "mcpc"):
        visit.page.check(f"#show-{name}")
    settings = data_block(three_page, "settings")
    for number in (2, 0, 1):
        visit.page.fill("#pose", str(number))
        found, shown, pose = state(visit), three_poses[number], settings["poses"][number]
        posture = shown.pose_model.posture
        assert found["pose"] == number + 1
        assert_allclose(matrix(found["tip"]), posture.pose, atol=1e-12)
        assert_array_equal(found["points"], floats(pose["points"])[:30])
        assert_allclose(matrix(found["cloud"])[:3, 3], posture.pose[:3, 3], atol=1e-12)
        first = ellipsoids(shown.errors[:3])[0]
        assert_allclose(matrix(found["ellipsoids"][0])[:3, :3], found["factor"] * first.matrix[:3, :3], atol=1e-12)
        built = floats(pose["ghosts"][0]).reshape(-1, 6)
        parts, _ = likeness(settings, number, built, found["factor"])
        for part, numbers, ghost in zip(settings["parts"], found["arm"], found["ghosts"][0]["parts"], strict=True):
            assert_allclose(matrix(numbers), posture.link_poses[part["link"]] @ matrix(part["frame"]), atol=1e-12)
            assert_allclose(matrix(ghost), parts[part["name"]], atol=1e-6)
        assert_allclose(matrix(found["mcpc"][-1]), posture.pose, atol=1e-12)
        words = visit.page.inner_text("#panel")
        assert f"Pose pose {number} ({number + 1} of 3)" in words
        assert f"{100 * first.inside:.2f} % of the samples inside" in words
        assert f"{posture.chain.joints[0].name} {np.degrees(posture.q[0]):.5g}°" in words
    # played, the poses go round from this one, the second; here five times as fast
    visit.page.evaluate("usual = setInterval; setInterval = (step, ms) => usual(step, ms / 5); null")
    visit.page.click("#play")
    assert visit.page.inner_text("#play") == "Pause"
    for number in (3, 1):
        visit.page.wait_for_selector(f"body[data-pose='{number}']", state="attached", timeout=5000)
    visit.page.click("#play")
    stopped = state(visit)
    visit.page.wait_for_timeout(300)
    visit.page.evaluate("setInterval = usual; null")
    assert (stopped["playing"], state(visit)["pose"]) == (False, stopped["pose"])


def test_everything_can_be_reached_and_used_by_keyboard(three_visit):
    visit = three_visit
    visit.page.fill("#pose", "0")
    visit.page.uncheck("#show-ghosts")
    reached = []
    for _ in range(60):
        visit.page.keyboard.press("Tab")
        control = visit.page.evaluate(
            "((at) => [at.id || at.parentElement.id, at.labels?.[0]?.innerText || at.innerText])(document.activeElement)"
        )
        if control[0] in reached:
            break
        reached.append(control[0])
        assert control[1].strip() or control[0] == "", control
        if control[0] == "show-ghosts":
            visit.page.keyboard.press("Space")
        if control[0] in ("pose", "factor"):
            visit.page.keyboard.press("ArrowRight")
    expected = {"factor", "about", "pose", "play", "look-arm", "look-tip", "true-scale", "see-through"}
    expected |= {"shares", "more", "robot", "tolerance0", "reset"}
    expected |= {f"show-{name}" for name in KINDS}
    assert expected <= set(reached)
    found = state(visit)
    assert found["seen"]["ghosts"]
    assert found["pose"] == 2


def test_the_tip_and_its_cloud_stay_in_the_window_when_the_pose_changes(limited, shown):
    visit = limited
    visit.page.click("#look-arm")
    script = """(places) => places.map(([x, y, z]) =>
      new MeshCat.THREE.Vector3(x, z, -y).project(precisionPin.viewer.camera).toArray())"""

    def in_window(places):
        projected = np.array(visit.page.evaluate(script, places.T.tolist()))
        return (np.abs(projected[:, :2]) <= 1).all() and (projected[:, 2] < 1).all()

    for number in (1, 0):
        visit.page.fill("#pose", str(number))
        tip = shown[number].pose_model.posture.pose[:3, 3]
        assert in_window(tip[:, None] + state(visit)["factor"] * shown[number].errors[:3])
    # a reader who has come near keeps the tip in sight
    visit.page.click("#look-tip")
    visit.page.evaluate("precisionPin.viewer.controls.dispatchEvent({ type: 'end' }); null")
    visit.page.fill("#pose", "1")
    assert in_window(shown[1].pose_model.posture.pose[:3, [3]])
    visit.page.click("#look-arm")
    visit.page.fill("#pose", "0")


def set_tolerances(visit: Visit, *scales: float) -> None:
    """Set the slider of each tolerance, in the order of `sampled`."""
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


def test_moved_tolerances_are_those_of_a_changed_sheet(limited, tmp_path):
    scales = (0.2, 3.0, 0.5, 2.0)
    visit, before = limited, headline(limited)
    set_tolerances(visit, *scales)
    fresh = sampled(tmp_path, *scales)[0].errors
    found = state(visit)
    size = np.linalg.norm(fresh[:3], axis=0)
    # the very robots, to first order
    points = np.array(found["points"]).reshape(-1, 3)
    assert_allclose(points, fresh[:3, :10].T, atol=5e-3 * size.max())
    one, also, quantile = answers(fresh, LIMITS, np.eye(6))
    shown = headline(visit)
    # robots that were moved, not sampled: no verdict
    assert shown[0].split(":")[0] == f"To first order {one.text.split(':')[0].lower()}"
    assert shown[2].split(":")[0] == f"To first order {also.text.split(':')[0].lower()}"
    assert shown[1].endswith("analyze with --set judges it")
    judged = visit.page.locator("#headline .answer").evaluate_all("(all) => all.map((one) => one.dataset.verdict)")
    assert judged == ["estimate", "estimate", ""]
    for detail, expected in ((shown[1], one.detail), (shown[3], also.detail)):
        assert_allclose(numbers(detail)[:3], numbers(expected)[:3], atol=0.3)
    low, high = numbers(quantile.detail)[:2]
    assert low <= numbers(shown[4])[1] <= high
    assert_allclose(numbers(shown[5])[:2], [low, high], rtol=0.01)
    for given, expected in zip(found["ellipsoids"], ellipsoids(fresh[:3]), strict=True):
        inner = (matrix(given)[:3, :3] / found["factor"]) @ (matrix(given)[:3, :3] / found["factor"]).T
        wanted = expected.matrix[:3, :3] @ expected.matrix[:3, :3].T
        assert_allclose(inner, wanted, atol=0.02 * np.abs(wanted).max())
    assert shown[5].endswith(f"; {found['count']:,} robots")
    assert visit.page.is_visible("#changed")
    assert "first order" in visit.page.inner_text("#changed")
    visit.page.click("#reset")
    assert headline(visit) == before
    assert not visit.page.is_visible("#changed")


def test_limits_along_the_tools_axes_are_counted_for_moved_tolerances_too(browser, shown, tmp_path):
    texts = "0.3 mm lateral @ 60 %", "1 mrad tilt @ 60 %", "all of: 0.4 mm lateral, 0.2 mm axial, 1.2 mrad tilt @ 60 %"
    asked = [pp.specification(text) for text in texts]
    at, errors = shown[0].pose_model, shown[0].errors
    axes = at.posture.pose[:3, :3]
    inside = np.all([are_inside(one.conditions(axes), errors) for one in asked], axis=0)
    assert 0.02 < inside.mean() < 0.98
    visit = opened(browser, tmp_path, pages(shown, specifications=asked))
    assert f"{(~inside).sum():,} of them outside" in visit.page.inner_text("#outside")
    scales = 0.2, 3.0, 0.5, 2.0
    set_tolerances(visit, *scales)
    fresh = sampled(tmp_path, *scales)[0].errors
    expected = answers(fresh, asked, np.eye(6), tool_axes=axes)
    for rank, one in enumerate(expected[:3]):
        text, detail = headline(visit)[2 * rank : 2 * rank + 2]
        assert text.split(":")[0] == f"To first order {one.text.split(':')[0].lower()}"
        assert_allclose(numbers(detail)[:3], numbers(one.detail)[:3], atol=0.3)
    assert complaints(visit) == []


def test_a_pose_keeps_what_was_chosen(limited, shown):
    visit = limited
    visit.page.click("#look-tip")
    set_tolerances(visit, 2, 1, 1, 0.5)
    set_slider(visit, 50)
    visit.page.uncheck("#show-inner")
    places = f"[precisionPin.viewer.camera.position, {TARGET}].map((one) => one.toArray())"
    before, start = state(visit), np.array(visit.page.evaluate(places))
    visit.page.fill("#pose", "1")
    after = state(visit)
    for name in ("factor", "tolerances", "seen", "looking", "count"):
        assert after[name] == before[name], name
    # the camera has gone with the end effector
    tips = [one.pose_model.posture.pose[:3, 3] for one in shown]
    way = (tips[1] - tips[0])[[0, 2, 1]] * [1, 1, -1]
    assert_allclose(visit.page.evaluate(places) - start, [way, way], atol=1e-9)
    visit.page.check("#show-inner")


def test_the_limit_is_a_ball_as_large_as_it_says_and_what_is_outside_is_red(limited, shown):
    found, errors = state(limited), shown[0].errors
    (ball,) = found["limits"]
    expected = np.diag([0.8e-3 * found["factor"]] * 3 + [1.0])
    expected[:3, 3] = shown[0].pose_model.posture.pose[:3, 3]
    assert_allclose(matrix(ball), expected, atol=1e-9)
    outside = (np.linalg.norm(errors[:3], axis=0) > 0.8e-3) | (np.linalg.norm(errors[3:], axis=0) > 2e-3)
    assert f"{outside.sum():,} of them outside" in limited.page.inner_text("#outside")
    red = np.abs(np.reshape(found["colours"], (-1, 3)) - np.array([0xD1, 0x33, 0x0A]) / 255).max(axis=1) < 0.01
    assert_array_equal(red, outside[:10])


def test_pointing_at_a_sample_tells_its_error_and_at_a_joint_its_name_and_rulers_are_true(limited, shown):
    visit, at, errors = limited, shown[0].pose_model, shown[0].errors
    set_slider(visit, 200)
    visit.page.click("#look-arm")
    place = """(at) => { const { viewer } = precisionPin; const THREE = MeshCat.THREE;
      const frame = document.getElementById("scene-pane").getBoundingClientRect();
      const seen = new THREE.Vector3(at[0], at[2], -at[1]).project(viewer.camera);
      return [frame.left + frame.width * (0.5 + seen.x / 2), frame.top + frame.height * (0.5 - seen.y / 2)]; }"""
    tip = at.posture.pose[:3, 3]
    farthest = int(np.argmax(np.linalg.norm(errors[:3], axis=0)))
    visit.page.mouse.move(*visit.page.evaluate(place, (tip + 200 * errors[:3, farthest]).tolist()))
    visit.page.wait_for_selector("#hover", state="visible")
    words = visit.page.inner_text("#hover")
    assert words.startswith(f"Robot {farthest:,} of seed 1: |d| {1e3 * np.linalg.norm(errors[:3, farthest]):#.3g} mm")
    x = at.space.sample(1, 0, SAMPLES)[:, farthest] - at.space.mean
    moved = np.linalg.norm(at.jacobian[:3] * x, axis=0)
    largest = int(np.argmax(moved))
    name = at.space.draws[largest].name
    assert f"Largest part beyond the mean: {name}, {1e3 * moved[largest]:#.3g} mm" in words
    # the same by keyboard
    visit.page.fill("#robot", str(farthest))
    assert visit.page.inner_text("#robot-text") == words
    shoulder = at.posture.link_poses[1, :3, 3]
    visit.page.mouse.move(*visit.page.evaluate(place, shoulder.tolist()))
    visit.page.wait_for_function("document.getElementById('hover').innerText.startsWith('Joint turn')")
    # the rulers are as long as they say
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
    per_metre = visit.page.evaluate(script, tip.tolist())
    assert lengths == pytest.approx([200 * metres[0] * per_metre, metres[1] * per_metre], rel=0.01)
    assert all(40 <= length <= 121 for length in lengths)


def test_links_take_the_colour_of_their_share_and_give_it_back(limited, shown):
    colours = """() => [0, 1, 2].map((link) => { let colour = null;
      precisionPin.viewer.scene_tree.find(["meshcat", "arm", "chain" + link]).object.traverse(
        (one) => { colour = one.material ? one.material.color.toArray() : colour; });
      return colour; })"""
    page = limited.page
    before = page.evaluate(colours)
    page.check("#shares")
    during = np.array(page.evaluate(colours))
    shares = link_shares(shown[0].pose_model)
    # stronger is less blue
    assert list(np.argsort(-during[:, 2])) == list(np.argsort(shares))
    assert f"0 to {100 * max(shares):.0f} %" in page.inner_text("#share-scale")
    page.uncheck("#shares")
    assert page.evaluate(colours) == before


def luminance(colour: list[int]) -> float:
    parts = np.array(colour[:3]) / 255
    return float(np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722])


def test_in_the_dark_the_scene_is_dark_large_errors_are_light_and_words_stand_out(limited, shown):
    sizes = np.linalg.norm(np.hstack([one.errors[:3] for one in shown]), axis=0)
    inside = np.argsort(sizes[:10])[: (sizes[:10] <= 0.8e-3).sum()]  # what is outside is red
    assert len(inside) > 4
    seen = {}
    for scheme in ("light", "dark"):
        limited.page.emulate_media(color_scheme=scheme)
        seen[scheme] = (picture(limited).mean(), np.reshape(state(limited)["colours"], (-1, 3))[inside])
        pairs = limited.page.evaluate("""() => {
          const look = (one, name) => getComputedStyle(document.querySelector(one))[name].match(/\\d+/g).map(Number);
          const [ground, panel] = ["header", "#panel"].map((one) => look(one, "backgroundColor"));
          const answer = document.querySelector(".answer");
          const kept = answer.dataset.verdict;
          const colours = ["met", "not met", "undecided", "nothing to judge", ""].map((verdict) => {
            answer.dataset.verdict = verdict;
            return look(".answer", "color");
          });
          answer.dataset.verdict = kept;
          const others = ["#changed", "#outside", ".fine", ".x", ".y", ".z", "h1", "summary", "output"];
          const all = [...colours, ...others.map((one) => look(one, "color"))].map((colour) => [ground, colour]);
          return [[panel, look("#panel", "color")], ...all];
        }""")
        assert (luminance(pairs[0][0]) < 0.05) == (scheme == "dark")
        for ground, colour in pairs:
            low, high = sorted([luminance(ground), luminance(colour)])
            assert (high + 0.05) / (low + 0.05) >= 4.5, (scheme, colour)
    limited.page.emulate_media(color_scheme="light")
    assert seen["dark"][0] < 70 < 150 < seen["light"][0]
    assert (np.diff(seen["dark"][1].sum(axis=1)) >= 0).all()
    # lightest for the smallest, without the lightest tenth of viridis
    shares = (sizes[inside] - sizes.min()) / np.ptp(sizes)
    assert_allclose(seen["light"][1], colormaps["viridis"](0.9 * (1 - shares))[:, :3], atol=0.01)


def test_the_cloud_is_seen_through_the_arm_in_the_colours_of_the_bar(context, tmp_path):
    # a block about the tip hides all that is not drawn over it
    block = '<visual><origin xyz="0.3 0 0"/><geometry><box size="0.5 0.5 0.5"/></geometry></visual>'
    shown = sampled(tmp_path, arm=arm_text(("", "", block)))[0]
    # the smallest error is that of many samples, and apart from the others: a dot in the first colour of the bar
    errors = shown.errors.copy()
    errors[:3] += 8e-4 * np.sign(errors[:3])
    errors[:, :9] = 0
    text = simple_page(shown.pose_model, errors, factor=300)
    visit = opened(context, tmp_path, text)
    with_cloud = picture(visit)
    visit.page.uncheck("#show-cloud")
    without = picture(visit)
    assert (np.abs(with_cloud - without).max(axis=-1) > 30).sum() > 300
    visit.page.check("#show-cloud")
    for name in ("arm", "tip", "frames", "mean", "inner", "outer", "grid"):
        visit.page.uncheck(f"#show-{name}")
    stop = data_block(text, "settings")["stops"][0]
    colour = [int(stop[k : k + 2], 16) for k in (1, 3, 5)]
    assert (np.abs(picture(visit) - colour).max(axis=-1) <= 2).any()


def test_the_cloud_is_seen_through_meshes_without_ghosts_of_the_arm(context, tmp_path):
    model = pp.ErrorModel.load(PAPER_SHEET.with_name("ur5.errors.yaml"))
    at = model.at()
    visit = opened(context, tmp_path, simple_page(at, at.exact(model.space.sample(0, 0, 5000))))

    def dots():
        with_cloud = picture(visit)
        visit.page.uncheck("#show-cloud")
        without = picture(visit)
        visit.page.check("#show-cloud")
        return (np.abs(with_cloud - without).max(axis=-1) > 30).sum()

    visit.page.uncheck("#show-inner")
    over_the_arm = dots()
    visit.page.uncheck("#show-arm")
    assert over_the_arm > 0.95 * dots()


def test_on_a_phone_nothing_is_off_the_screen_and_the_settings_unfold(browser, tmp_path, shown):
    options = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}
    with browser.browser.new_context(**options, color_scheme="dark") as phone:
        # an address that can be followed in part
        text = pages(shown[:1], specifications=LIMITS)
        visit = opened(phone, tmp_path, text, "#factor=1e9&look=nonsense&pose=x")
        largest = data_block(text, "settings")["largest"]
        assert body_data(visit, "factor", "look", "pose") == [f"{largest:g}", "arm", "1"]
        assert visit.page.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [390, 390]
        assert not visit.page.is_visible("#panel")
        assert visit.page.locator("#pane").bounding_box()["height"] > 450
        assert visit.page.locator("#headline").bounding_box()["y"] < 100
        visit.page.tap("#open")
        panel, pane = (visit.page.locator(name).bounding_box() for name in ("#panel", "#pane"))
        assert panel["y"] + panel["height"] <= 845
        assert pane["height"] > 200
        assert visit.page.get_attribute("#open", "aria-expanded") == "true"
        scene = Image.open(io.BytesIO(visit.page.locator("#scene-pane").screenshot()))
        assert np.asarray(scene.convert("RGB")).mean() < 70  # opened in the dark


def test_without_webgl_there_are_a_line_and_a_picture(context, tmp_path, shown):
    path = tmp_path / "page.html"
    path.write_text(simple_page(shown[0].pose_model, shown[0].errors), "utf-8")
    page = context.new_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page.goto(path.as_uri())
    assert "no WebGL" in page.inner_text("#problem")
    assert page.locator("#still svg").bounding_box()["height"] > 200
    assert "95 % of robots within" in page.inner_text("header")
