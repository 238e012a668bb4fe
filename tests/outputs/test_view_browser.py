"""The page in a real browser: its console, its requests, and the state of the scene."""

from __future__ import annotations

import html
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib import colormaps
from PIL import Image
from playwright.sync_api import BrowserContext
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from outputs.view_cases import (
    HOSTILE,
    arm_text,
    composed,
    data_block,
    enlarged,
    floats,
    likeness,
    made_up_errors,
    matrix,
    pages,
    pose_model,
    simple_page,
)
from precision_pin.base import se3
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import ViewPose, script_hashes
from precision_pin.pages.view.poses import ellipsoids
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from support.browser import Visit, chromium, complaints, needs_chromium, outside_requests, visited
from support.sheets import SEVEN_Q, everything, seven_joint_arm

pytestmark = [pytest.mark.slow, needs_chromium]

ZERO = "#about=zero"
KINDS = ("cloud", "mean", "inner", "outer", "tip", "frames", "arm", "ghosts", "deflected", "mcpc", "base", "grid")


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    # small, since software draws
    with chromium(viewport={"width": 800, "height": 480}) as context:
        yield context


@pytest.fixture
def context(browser: BrowserContext) -> Iterator[BrowserContext]:
    yield browser
    for page in browser.pages:
        page.close()


@pytest.fixture(scope="module")
def paper():
    model = ErrorModel.load(PAPER_SHEET)
    at = model.at()
    return at, at.exact(model.space.sample(1, 0, 2000))


@pytest.fixture(scope="module")
def three_poses():
    """Every kind of source, three poses, draws of pose scope anew at each."""
    model = everything(seven_joint_arm())
    poses = [SEVEN_Q, tuple(-0.5 * value for value in SEVEN_Q), (0.1,) * 7]
    return [
        ViewPose(at, at.exact(model.space.sample(1, 0, 60, pose=number)), f"pose {number}", number)
        for number, at in enumerate(map(model.at, poses))
    ]


def opened(context: BrowserContext, folder: Path, text: str, fragment: str = "") -> Visit:
    path = folder / "page.html"
    path.write_text(text, "utf-8")
    visit = visited(context, path.as_uri() + fragment)
    visit.page.wait_for_selector("body[data-ready=yes]", state="attached")
    visit.page.evaluate("document.getElementById('more').open = true")
    return visit


def state(visit: Visit) -> dict:
    return visit.page.evaluate("precisionPin.state()")


def set_slider(visit: Visit, factor: float) -> None:
    visit.page.locator("#factor").evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }", np.log10(factor)
    )


def picture(visit: Visit) -> np.ndarray:
    """Return what the browser shows, ``(height, width, 3)``, once the scene is drawn."""
    visit.page.wait_for_timeout(300)
    return np.asarray(Image.open(io.BytesIO(visit.page.screenshot())).convert("RGB"), dtype=int)


def displacements_of(at, x: np.ndarray) -> np.ndarray:
    return at.table.displacements(at.table.products(at.table.program.evaluate(x)))


def test_the_page_opens_without_complaint_or_request(context, tmp_path, paper):
    visit = opened(context, tmp_path, simple_page(*paper))
    found = state(visit)
    assert (found["factor"], found["pose"], found["playing"]) == (100, 1, False)
    assert {name for name, seen in found["seen"].items() if not seen} == {"ghosts", "deflected", "mcpc", "limit"}
    assert set(found["seen"]) == {*KINDS, "limit"}
    words = visit.page.inner_text("#panel")
    for text in ("Position error |d|, mm", "Whole arm", "End effector", "N = 2,000", "% of the samples inside"):
        assert text in words
    assert not visit.page.is_visible("#pose")
    for name in KINDS:
        visit.page.check(f"#show-{name}")
    # without a limit there is none to show
    assert {name for name, seen in state(visit)["seen"].items() if not seen} == {"limit"}
    visit.page.wait_for_timeout(300)
    assert complaints(visit) == []
    assert outside_requests(visit) == []


def test_the_address_can_say_how_to_open_the_page(context, tmp_path, paper):
    visit = opened(context, tmp_path, simple_page(*paper), fragment="#factor=50&look=tip&pose=7")
    body = visit.page.locator("body")
    assert [body.get_attribute(f"data-{name}") for name in ("factor", "look", "pose")] == ["50", "tip", "1"]
    visit = opened(context, tmp_path, simple_page(*paper), fragment="#factor=1e9&look=nonsense&pose=x")
    body = visit.page.locator("body")
    assert [body.get_attribute(f"data-{name}") for name in ("factor", "look", "pose")] == ["1500", "arm", "1"]


def test_the_slider_enlarges_everything_together(context, tmp_path, three_poses):
    shown = three_poses[0]
    at, errors = shown.pose_model, shown.errors
    tip = at.table.pose
    x = at.space.sample(1, 0, 3)
    built, mean = displacements_of(at, x), displacements_of(at, at.space.mean[:, None])[:, :, 0]
    visit = opened(context, tmp_path, pages([shown], factor=10), ZERO)
    visit.page.check("#show-ghosts")
    visit.page.check("#show-deflected")
    for factor in (1.0, 10.0, 100.0):
        set_slider(visit, factor)
        found = state(visit)
        cloud = matrix(found["cloud"])
        points = np.array(found["points"]).reshape(-1, 3)
        # three.js keeps positions in single precision
        np.testing.assert_allclose(
            points @ cloud[:3, :3].T + cloud[:3, 3], tip[:3, 3] + factor * errors[:3, :10].T, atol=1e-6 * factor
        )
        np.testing.assert_allclose(matrix(found["mean"]), cloud, atol=1e-12)
        for numbers, one in zip(found["ellipsoids"], ellipsoids(errors[:3]), strict=True):
            expected = se3.translation(tip[:3, 3]) @ np.diag([factor, factor, factor, 1]) @ one.matrix
            np.testing.assert_allclose(matrix(numbers), expected, atol=1e-12)
        for unit, numbers in enumerate(found["frames"]):
            moved = enlarged(errors[:, unit], factor)
            expected = se3.pose(moved[:3, :3] @ tip[:3, :3], tip[:3, 3] + moved[:3, 3])
            np.testing.assert_allclose(matrix(numbers), expected, atol=1e-12)
        for unit, ghost in enumerate(found["ghosts"]):
            np.testing.assert_allclose(
                matrix(ghost["tip"]), composed(at.table.frames, built[:, :, unit], factor)[-1] @ tip, atol=1e-6 * factor
            )
        np.testing.assert_allclose(
            matrix(found["deflected"]["tip"]), composed(at.table.frames, mean, factor)[-1] @ tip, atol=1e-6 * factor
        )
        np.testing.assert_allclose(matrix(found["tip"]), tip, atol=1e-12)
        assert visit.page.inner_text("#factor-text") == visit.page.inner_text("#caption-factor") == f"{factor:g}"
        assert f"drawn {factor:g} mm long" in visit.page.inner_text("#example")


def test_errors_stand_about_the_tip_from_their_mean_and_beside_it_from_zero(context, tmp_path, paper):
    at, errors = paper
    tip, mean = at.table.pose, errors.mean(axis=1)
    x = at.space.sample(1, 0, 1)
    built, middle = displacements_of(at, x)[:, :, 0], displacements_of(at, at.space.mean[:, None])[:, :, 0]
    visit = opened(context, tmp_path, simple_page(at, errors))
    visit.page.check("#show-ghosts")

    def stands(factor: float, from_mean: float, words: str) -> None:
        found = state(visit)
        assert found["factor"] == factor
        expected = tip[:3, 3] + factor * (errors[:3, :10].T - from_mean * mean[:3])
        cloud = matrix(found["cloud"])
        points = np.array(found["points"]).reshape(-1, 3)
        np.testing.assert_allclose(points @ cloud[:3, :3].T + cloud[:3, 3], expected, atol=1e-6 * factor)
        moved = enlarged(errors[:, 0] - from_mean * mean, factor)
        np.testing.assert_allclose(matrix(found["frames"][0])[:3, 3], tip[:3, 3] + moved[:3, 3], atol=1e-9)
        np.testing.assert_allclose(matrix(found["frames"][0])[:3, :3], moved[:3, :3] @ tip[:3, :3], atol=1e-9)
        ghost = composed(at.table.frames, built - from_mean * middle, factor)[-1] @ tip
        np.testing.assert_allclose(matrix(found["ghosts"][0]["tip"]), ghost, atol=1e-5 * factor)
        assert visit.page.inner_text("#caption-about") == words

    from_mean = "from the mean error, which is 36.8 mm"
    stands(100, 1, from_mean)
    # the headline anew for a change that is none, and as it was
    before = visit.page.locator("#headline p").all_inner_texts()
    assert before[2].startswith("Mean error 36.8 mm")
    visit.page.evaluate("knob = document.getElementById('tolerance0'); knob.step = 'any'; knob.value = 1 + 1e-9")
    visit.page.evaluate("knob.dispatchEvent(new Event('input'))")
    assert visit.page.is_visible("#changed")
    assert visit.page.locator("#headline p").all_inner_texts() == before
    visit.page.click("#reset")
    visit.page.select_option("#about", "zero")
    stands(150, 0, "from zero error")
    assert visit.page.locator("body").get_attribute("data-about") == "zero"
    visit.page.select_option("#about", "mean")
    stands(100, 1, from_mean)
    assert complaints(visit) == []
    visit = opened(context, tmp_path, simple_page(at, errors), ZERO)
    assert not state(visit)["aboutMean"]


def test_at_the_true_size_an_arm_as_built_ends_at_its_sample(context, tmp_path, three_poses):
    visit = opened(context, tmp_path, pages(three_poses, factor=1), ZERO)
    visit.page.check("#show-ghosts")
    for number, shown in enumerate(three_poses):
        visit.page.fill("#pose", str(number))
        found = state(visit)
        assert len(found["ghosts"]) == 3
        for unit, ghost in enumerate(found["ghosts"]):
            error, tip = shown.errors[:, unit], shown.pose_model.table.pose
            pose = matrix(ghost["tip"])
            np.testing.assert_allclose(pose[:3, 3], tip[:3, 3] + error[:3], atol=1e-6)
            np.testing.assert_allclose(pose[:3, :3], se3.exp_rotation(error[3:]) @ tip[:3, :3], atol=1e-6)


def test_the_pose_slider_switches_arm_cloud_ellipsoids_and_caption(context, tmp_path, three_poses):
    text = pages(three_poses)
    visit = opened(context, tmp_path, text, ZERO)
    for name in ("ghosts", "deflected", "mcpc"):
        visit.page.check(f"#show-{name}")
    settings = data_block(text, "settings")
    for number in (2, 0, 1):
        visit.page.fill("#pose", str(number))
        found, shown, pose = state(visit), three_poses[number], settings["poses"][number]
        posture = shown.pose_model.posture
        assert found["pose"] == number + 1
        np.testing.assert_allclose(matrix(found["tip"]), posture.pose, atol=1e-12)
        np.testing.assert_array_equal(found["points"], floats(pose["points"])[:30])
        np.testing.assert_allclose(matrix(found["cloud"])[:3, 3], posture.pose[:3, 3], atol=1e-12)
        first = ellipsoids(shown.errors[:3])[0]
        np.testing.assert_allclose(
            matrix(found["ellipsoids"][0])[:3, :3], found["factor"] * first.matrix[:3, :3], atol=1e-12
        )
        built = floats(pose["ghosts"][0]).reshape(-1, 6)
        parts, _ = likeness(settings, number, built, found["factor"])
        for part, numbers, ghost in zip(settings["parts"], found["arm"], found["ghosts"][0]["parts"], strict=True):
            np.testing.assert_allclose(
                matrix(numbers), posture.link_poses[part["link"]] @ matrix(part["frame"]), atol=1e-12
            )
            np.testing.assert_allclose(matrix(ghost), parts[part["name"]], atol=1e-6)
        np.testing.assert_allclose(matrix(found["mcpc"][-1]), posture.pose, atol=1e-12)
        words = visit.page.inner_text("#panel")
        assert f"Pose pose {number} ({number + 1} of 3)" in words
        assert f"{100 * first.inside:.2f} % of the samples inside" in words
        assert f"{posture.chain.joints[0].name} {np.degrees(posture.q[0]):.5g}°" in words
    assert complaints(visit) == []


def test_play_goes_round_and_stops(context, tmp_path, three_poses):
    visit = opened(context, tmp_path, pages(three_poses))
    visit.page.click("#play")
    assert visit.page.inner_text("#play") == "Pause"
    for number in (2, 3, 1):
        visit.page.wait_for_selector(f"body[data-pose='{number}']", state="attached", timeout=5000)
    visit.page.click("#play")
    assert not state(visit)["playing"]
    stopped = state(visit)["pose"]
    visit.page.wait_for_timeout(1300)
    assert state(visit)["pose"] == stopped


def test_everything_can_be_reached_and_used_by_keyboard(context, tmp_path, three_poses):
    visit = opened(context, tmp_path, pages(three_poses))
    reached = []
    for _ in range(40):
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
    expected = {
        "factor",
        "about",
        "pose",
        "play",
        "look-arm",
        "look-tip",
        "true-scale",
        "see-through",
        "shares",
        "more",
        "robot",
    }
    expected |= {"tolerance0", "reset", *(f"show-{name}" for name in KINDS)}
    assert expected <= set(reached)
    found = state(visit)
    assert found["seen"]["ghosts"]
    assert found["pose"] == 2


def test_buttons_and_boxes_do_what_they_say(context, tmp_path, paper):
    visit = opened(context, tmp_path, simple_page(*paper, factor=20))

    def far() -> float:
        return visit.page.evaluate(
            "precisionPin.viewer.camera.position.distanceTo(precisionPin.viewer.controls.target)"
        )

    def opacity() -> float:
        path = "['meshcat', 'arm', 'link2', 'shape0', '<object>']"
        return visit.page.evaluate(f"precisionPin.viewer.scene_tree.find({path}).object.material.opacity")

    arm = far()
    visit.page.click("#look-tip")
    assert far() < 0.5 * arm
    visit.page.click("#look-arm")
    assert far() == pytest.approx(arm, rel=1e-9)
    for name in KINDS:
        before = state(visit)["seen"][name]
        visit.page.click(f"#show-{name}")
        assert state(visit)["seen"][name] is not before
    visit.page.check("#see-through")
    assert opacity() == 0.25
    visit.page.uncheck("#see-through")
    assert opacity() == 1


def test_points_have_the_colours_of_the_bar(context, tmp_path, paper):
    at, errors = paper
    found = state(opened(context, tmp_path, simple_page(at, errors)))
    sizes = np.linalg.norm(errors[:3], axis=0)
    shares = (sizes[:10] - sizes.min()) / np.ptp(sizes)
    # lightest for the smallest, without the lightest tenth of viridis
    expected = colormaps["viridis"](0.9 * (1 - shares))[:, :3]
    np.testing.assert_allclose(np.reshape(found["colours"], (-1, 3)), expected, atol=0.01)


def test_the_screen_shows_the_colour_that_the_bar_says(context, tmp_path):
    # all samples in one place: one dot in the first colour of the bar
    errors = np.tile([[1e-4], [2e-4], [3e-4], [0], [0], [0]], 9)
    text = simple_page(pose_model(tmp_path, arm_text()), errors)
    visit = opened(context, tmp_path, text)
    for name in ("arm", "tip", "frames", "mean", "grid"):
        visit.page.uncheck(f"#show-{name}")
    stop = data_block(text, "settings")["stops"][0]
    colour = [int(stop[k : k + 2], 16) for k in (1, 3, 5)]
    pane = picture(visit)[:, 345:]
    assert (np.abs(pane - colour).max(axis=-1) <= 2).any()


def colours_seen(pane: np.ndarray) -> tuple[int, int, int]:
    red, green, blue = pane[..., 0], pane[..., 1], pane[..., 2]
    # links 2 and 3 are blue, link 4 orange, the cloud greenish
    return (
        int(((blue > red + 60) & (blue > green + 30)).sum()),
        int(((red > blue + 80) & (red > green + 30)).sum()),
        int(((green > red + 40) & (green > blue + 5)).sum()),
    )


def test_the_scene_is_drawn_also_in_a_sandboxed_frame_of_a_strict_page(context, tmp_path, paper):
    text = simple_page(*paper)
    alone = picture(opened(context, tmp_path, text))
    # a frame with srcdoc inherits this policy
    policy = (
        f"default-src 'none'; script-src {' '.join(script_hashes())}; style-src 'unsafe-inline'; img-src data: blob:"
    )
    outer = (
        f'<!DOCTYPE html><meta http-equiv="Content-Security-Policy" content="{policy}"><body style="margin:0">'
        f'<iframe sandbox="allow-scripts" srcdoc="{html.escape(text)}" style="border:0;width:100vw;height:100vh"></iframe>'
    )
    (tmp_path / "framed.html").write_text(outer, "utf-8")
    # drawn by the processor, with other tests beside it; a browser that stalls is asked once more
    for last in (False, True):
        visit = visited(context, tmp_path / "framed.html")
        frame = visit.page.frames[1]
        try:
            frame.wait_for_selector("body[data-ready=yes]", state="attached", timeout=60_000)
        except PlaywrightTimeoutError:
            if last:
                raise
        else:
            break
    frame.check("#show-ghosts")
    frame.uncheck("#show-ghosts")
    for seen in (alone, picture(visit)):
        blue, orange, green = colours_seen(seen[:, 345:])
        assert blue > 1_500
        assert orange > 150
        assert green > 30
    assert complaints(visit) == []
    assert outside_requests(visit) == []


def test_hostile_text_stays_text(context, tmp_path, paper):
    shown = [ViewPose(*paper, HOSTILE), ViewPose(*paper, f"{HOSTILE}2")]
    text = pages(shown, title=HOSTILE, model_name=HOSTILE, caption=[(HOSTILE, HOSTILE)])
    visit = opened(context, tmp_path, text)
    visit.page.fill("#pose", "1")
    assert visit.page.inner_text("#pose-text") == f"{HOSTILE}2 (2 of 2)"
    assert visit.page.evaluate("[document.images.length, document.scripts.length]") == [0, 4]
    assert (visit.page.title(), visit.page.inner_text("h1")) == (HOSTILE, HOSTILE)
    assert complaints(visit) == []


@pytest.mark.parametrize("width", [600, 1280])
def test_the_panel_stands_beside_or_below_the_pane_and_is_as_wide_as_its_words(context, tmp_path, three_poses, width):
    visit = opened(context, tmp_path, pages(three_poses))
    visit.page.set_viewport_size({"width": width, "height": 800})
    if width == 600:
        assert not visit.page.is_visible("#panel")
        visit.page.click("#open")
    pane, panel = (visit.page.locator(name).bounding_box() for name in ("#pane", "#panel"))
    if width == 600:
        assert pane["y"] + pane["height"] <= panel["y"] + 1
        assert panel["width"] == pane["width"] == width
    else:
        assert panel["x"] + panel["width"] <= pane["x"] + 1
    wide, room = visit.page.evaluate("[panel.scrollWidth, panel.clientWidth]")
    assert wide <= room
    canvas = visit.page.locator("#pane canvas").bounding_box()
    assert canvas["width"] == pytest.approx(pane["width"], abs=1)


def test_in_the_dark_the_panel_is_dark_and_legible(context, tmp_path, paper):
    visit = opened(context, tmp_path, simple_page(*paper))
    script = "(name) => getComputedStyle(document.getElementById('panel'))[name].match(/\\d+/g).map(Number)"
    for scheme, dark in (("light", False), ("dark", True)):
        visit.page.emulate_media(color_scheme=scheme)
        ground, text = (np.mean(visit.page.evaluate(script, name)) for name in ("backgroundColor", "color"))
        assert bool(ground < 60) is dark
        assert bool(text > 200) is dark


@pytest.mark.filterwarnings("ignore:.*W_JOINT_LIMIT")
@pytest.mark.skipif(not example_urdfs(), reason="example-robot-data is not installed")
@pytest.mark.parametrize(
    ("name", "tip"), [("ur5", "tool0"), ("panda", "panda_hand_tcp"), ("kinova", "j2s6s200_end_effector")]
)
def test_known_arms_are_drawn_complete(context, tmp_path, name, tip):
    chain = Chain.from_urdf(example_urdfs()[name], tip=tip)
    at = ErrorModel(chain, Space(), []).at(np.linspace(0.5, -0.5, len(chain.joints)))
    visit = opened(context, tmp_path, simple_page(at, made_up_errors(200)))
    found = visit.page.evaluate("""() => {
      const arm = precisionPin.viewer.scene_tree.find(["meshcat", "arm"]).object;
      let meshes = 0;
      arm.traverse((object) => {
        if (object.isMesh && object.geometry.attributes.position.count > 0) meshes += 1;
      });
      const box = new MeshCat.THREE.Box3().setFromObject(arm);
      return { meshes, min: box.min.toArray(), max: box.max.toArray() };
    }""")
    assert complaints(visit) == []
    assert outside_requests(visit) == []
    assert found["meshes"] >= sum(len(link.visuals) for link in chain.robot.links)
    lowest, highest = np.array(found["min"]), np.array(found["max"])
    joints = at.posture.link_poses[:, :3, 3] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert (joints >= lowest - 0.02).all()
    assert (joints <= highest + 0.02).all()
    assert (highest - lowest).max() < 2.0
