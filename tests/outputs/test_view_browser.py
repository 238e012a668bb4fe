"""The page in a real browser: headless Chromium, its console, its requests, and the state of the scene."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from outputs.view_cases import HOSTILE, made_up_errors, simple_page
from precision_pin import se3
from precision_pin.chain import Chain
from precision_pin.examples import PAPER_SHEET, example_urdfs
from precision_pin.model import ErrorModel
from precision_pin.space import Space

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--virtual-time-budget=8000",
    "--window-size=1280,800",
    "--enable-logging=stderr",
)
# what the browser asks for on its own behalf
OWN_HOSTS = re.compile(r"https?://[a-z0-9.-]*\.(google|googleapis|gvt1|gstatic)\.com/")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None and not os.environ.get("CI"), reason="Chromium is not installed; CI installs it"
    ),
]


@dataclass
class Visit:
    """What came of opening a page."""

    document: str
    console: list[str]
    requests: set[str]

    @property
    def state(self) -> dict[str, str]:
        body = re.search(r"<body([^>]*)>", self.document)[1]
        return dict(re.findall(r'data-([a-z-]+)="([^"]*)"', body))

    @property
    def probe(self) -> dict:
        return json.loads(html.unescape(re.search(r'<pre id="probe">(.*?)</pre>', self.document, re.DOTALL)[1]))


def visit(page: Path, *more: str, fragment: str = "") -> Visit:
    log = page.with_suffix(".netlog")
    profile = page.with_suffix(".profile")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", f"--log-net-log={log}", *more, page.as_uri() + fragment]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    console = [
        line for line in done.stderr.splitlines() if "CONSOLE" in line and "GPU stall due to ReadPixels" not in line
    ]
    requests = {url for url in re.findall(r'"url":"(.*?)"', log.read_text("utf-8")) if not OWN_HOSTS.match(url)}
    return Visit(done.stdout, console, requests)


def opened(folder: Path, text: str, fragment: str = "", name: str = "page") -> Visit:
    page = folder / f"{name}.html"
    page.write_text(text, "utf-8")
    return visit(page, "--dump-dom", fragment=fragment)


def screenshot(folder: Path, text: str, fragment: str = "", name: str = "shot") -> np.ndarray:
    page, picture = folder / f"{name}.html", folder / f"{name}.png"
    page.write_text(text, "utf-8")
    visit(page, f"--screenshot={picture}", fragment=fragment)
    return np.asarray(Image.open(picture).convert("RGB"), dtype=int)


def probed(text: str, script: str) -> str:
    """Return a page that runs a test's script at its end; the policy, which would forbid that, is taken out."""
    text = re.sub(r"<meta http-equiv=[^>]*>", "", text, count=1)
    tail = f"""<pre id="probe"></pre><script>
      const result = {{}};
      {script}
      document.getElementById("probe").textContent = JSON.stringify(result);
    </script></body>"""
    head, _, rest = text.rpartition("</body>")
    return head + tail + rest


@pytest.fixture(scope="module")
def paper():
    model = ErrorModel.load(PAPER_SHEET)
    at = model.at()
    return at, at.exact(model.space.sample(1, 0, 2000))


def test_the_page_opens_without_complaint_or_request(tmp_path, paper):
    seen = opened(tmp_path, simple_page(*paper))
    assert seen.state["ready"] == "yes"
    assert seen.console == []
    assert seen.requests == set()
    assert (seen.state["factor"], seen.state["cloud-scale"], seen.state["look"]) == ("20", "20", "arm")
    for text in ("Position error |d|, mm", "Whole arm", "End effector", "N = 2,000"):
        assert text in seen.document


def test_the_address_can_say_how_to_open_the_page(tmp_path, paper):
    seen = opened(tmp_path, simple_page(*paper), fragment="#factor=50&look=tip")
    assert (seen.state["factor"], seen.state["cloud-scale"], seen.state["look"]) == ("50", "50", "tip")
    seen = opened(tmp_path, simple_page(*paper), fragment="#factor=1e9&look=nonsense")
    assert (seen.state["factor"], seen.state["look"]) == ("200", "arm")


def test_the_slider_moves_cloud_and_frames_about_the_nominal_tip(tmp_path, paper):
    at, errors = paper
    script = """
      const slider = document.getElementById("factor");
      const viewer = precisionPin.viewer, THREE = MeshCat.THREE;
      const root = viewer.scene_tree.find(["meshcat"]).object;
      for (const factor of [1, 20, 150]) {
        slider.value = Math.log10(factor);
        slider.dispatchEvent(new Event("input"));
        viewer.scene.updateMatrixWorld(true);
        const inBase = (node) => new THREE.Matrix4().copy(root.matrixWorld).invert().multiply(node.matrixWorld);
        const points = viewer.scene_tree.find(["meshcat", "cloud", "<object>"]).object;
        const place = points.geometry.attributes.position;
        const cloud = [0, 7, 1999].map((k) =>
          new THREE.Vector3().fromBufferAttribute(place, k).applyMatrix4(inBase(points)).toArray());
        const frames = [0, 4].map((k) =>
          inBase(viewer.scene_tree.find(["meshcat", "frames", "frame" + k]).object).toArray());
        const tip = inBase(viewer.scene_tree.find(["meshcat", "tip"]).object).toArray();
        result[factor] = {cloud, frames, tip, says: document.getElementById("factor-text").textContent,
                          example: document.getElementById("example").textContent};
      }
    """
    probe = opened(tmp_path, probed(simple_page(at, errors), script)).probe
    tip = at.posture.pose
    for factor in (1.0, 20.0, 150.0):
        found = probe[f"{factor:g}"]
        for point, k in zip(found["cloud"], (0, 7, 1999), strict=True):
            # three.js keeps positions in single precision
            np.testing.assert_allclose(point, tip[:3, 3] + factor * errors[:3, k], atol=1e-6 * factor)
        for frame, k in zip(found["frames"], (0, 4), strict=True):
            turn = errors[3:, k] * factor
            angle = np.linalg.norm(turn)
            turn *= min(1.0, np.pi / 2 / angle)
            pose = np.array(frame).reshape(4, 4).T
            np.testing.assert_allclose(pose[:3, :3], se3.exp_rotation(turn) @ tip[:3, :3], atol=1e-12)
            np.testing.assert_allclose(pose[:3, 3], tip[:3, 3] + factor * errors[:3, k], atol=1e-12)
        np.testing.assert_allclose(np.array(found["tip"]).reshape(4, 4).T, tip, atol=1e-12)
        assert found["says"] == f"{factor:g}"
        assert f"drawn {factor:g} mm long" in found["example"]


def test_buttons_and_boxes_do_what_they_say(tmp_path, paper):
    script = """
      const viewer = precisionPin.viewer;
      const click = (id) => document.getElementById(id).click();
      const far = () => viewer.camera.position.distanceTo(viewer.controls.target);
      result.arm = far();
      click("look-tip");
      result.tip = far();
      click("look-arm");
      result.again = far();
      const frames = viewer.scene_tree.find(["meshcat", "frames"]).object;
      click("show-frames");
      result.hidden = !frames.visible;
      click("show-frames");
      result.shown = frames.visible;
      const link = viewer.scene_tree.find(["meshcat", "arm", "link2", "shape0", "<object>"]).object.material;
      click("see-through");
      result.clear = link.opacity;
      click("see-through");
      result.solid = link.opacity;
    """
    probe = opened(tmp_path, probed(simple_page(*paper), script)).probe
    assert probe["tip"] < 0.5 * probe["arm"]
    assert probe["again"] == pytest.approx(probe["arm"], rel=1e-9)
    assert probe["hidden"]
    assert probe["shown"]
    assert (probe["clear"], probe["solid"]) == (0.25, 1)


def test_the_scene_is_drawn_also_in_a_sandboxed_frame(tmp_path, paper):
    text = simple_page(*paper)
    alone = screenshot(tmp_path, text)
    frame = (
        f'<iframe sandbox="allow-scripts" srcdoc="{html.escape(text)}" style="{"border:0;width:100vw;height:100vh"}">'
    )
    framed = screenshot(tmp_path, f"<!DOCTYPE html><body style='margin:0'>{frame}</iframe></body>", name="framed")
    for picture in (alone, framed):
        pane = picture[:, 330:]
        red, green, blue = pane[..., 0], pane[..., 1], pane[..., 2]
        # links 2 and 3 are blue, link 4 orange, the cloud greenish
        assert ((blue > red + 60) & (blue > green + 30)).sum() > 5_000
        assert ((red > blue + 80) & (red > green + 30)).sum() > 500
        assert ((green > red + 40) & (green > blue + 5)).sum() > 100


def test_hostile_text_stays_text(tmp_path, paper):
    text = simple_page(*paper, title=HOSTILE, model_name=HOSTILE, pose_name=HOSTILE, caption=[(HOSTILE, HOSTILE)])
    script = """
      result.images = document.images.length;
      result.title = document.title;
      result.heading = document.querySelector("h1").textContent;
      result.scripts = document.scripts.length;
    """
    seen = opened(tmp_path, probed(text, script))
    assert seen.state["ready"] == "yes"
    assert seen.probe == {"images": 0, "title": HOSTILE, "heading": HOSTILE, "scripts": 5}


@pytest.mark.skipif(not example_urdfs(), reason="example-robot-data is not installed")
@pytest.mark.parametrize(
    ("name", "tip"), [("ur5", "tool0"), ("panda", "panda_hand_tcp"), ("kinova", "j2s6s200_end_effector")]
)
def test_known_arms_are_drawn_complete(tmp_path, name, tip):
    chain = Chain.from_urdf(example_urdfs()[name], tip=tip)
    at = ErrorModel(chain, Space(), []).at(np.linspace(0.5, -0.5, len(chain.joints)))
    script = """
      const viewer = precisionPin.viewer;
      result.box = new MeshCat.THREE.Box3().setFromObject(viewer.scene_tree.find(["meshcat", "arm"]).object);
      result.meshes = 0;
      viewer.scene_tree.find(["meshcat", "arm"]).object.traverse((object) => {
        if (object.isMesh && object.geometry.attributes.position.count > 0) result.meshes += 1;
      });
    """
    text = simple_page(at, made_up_errors(200))
    seen = opened(tmp_path, text)
    assert seen.console == []
    assert seen.requests == set()
    probe = opened(tmp_path, probed(text, script), name="probe").probe
    assert probe["meshes"] >= sum(len(link.visuals) for link in chain.robot.links)
    lowest, highest = (np.array([probe["box"][end][axis] for axis in "xyz"]) for end in ("min", "max"))
    joints = at.posture.link_poses[:, :3, 3] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert (joints >= lowest - 0.02).all()
    assert (joints <= highest + 0.02).all()
    assert (highest - lowest).max() < 2.0
