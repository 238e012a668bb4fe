"""A compensation in the 3-D page and in the report: arms, ways, what is said."""

from __future__ import annotations

import numpy as np
import pytest

import precision_pin as pp
from outputs.view_cases import arm_text, data_block, nodes_of, pages
from precision_pin.analyses.compensation.figure import CompensationLayer, _displaced, _joints, compensation_chapter
from precision_pin.base import se3
from precision_pin.draws.laws import Fixed
from precision_pin.draws.space import Space
from precision_pin.pages.view import ViewPose
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.joint_offset import JointOffset
from support.browser import chromium, complaints, needs_chromium, visited

pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")


@pytest.fixture(scope="module")
def case():
    """Return the model, the compensation of three poses of the paper's arm, and its layer."""
    model = pp.ErrorModel.load(PAPER_SHEET)
    q = model.configuration("paper")[:, None] + np.outer([0.5, 0.3, -0.2, 0], [0, 0.5, 1])
    made = pp.compensate(model, q)
    return model, made, CompensationLayer.of(made, model)


def test_the_tips_are_those_of_the_exact_model(case):
    model, made, layer = case
    pose = layer.worst
    assert pose == np.linalg.norm(made.correction.before[:3], axis=0).argmax()
    deflected, commanded, corrected = layer.arms[:, :, -1]
    mean = model.space.mean[:, None]
    np.testing.assert_allclose(deflected, model.at(made.poses.q[:, pose]).exact(mean)[:3, 0], atol=1e-9)
    np.testing.assert_allclose(corrected, 0, atol=1e-9)
    at = model.at(made.corrected[:, pose])
    np.testing.assert_allclose(commanded, at.posture.pose[:3, 3] - made.poses.position[:, pose], atol=1e-12)
    np.testing.assert_allclose(commanded, -at.exact(mean)[:3, 0], atol=1e-9)


def test_a_displaced_joint_stays_at_the_end_of_its_displaced_link(tmp_path):
    """A turn by 0.01 rad of the first joint turns every point behind it about that joint's axis."""
    path = tmp_path / "arm.urdf"
    path.write_text(arm_text(), "utf-8")
    model = pp.ErrorModel(Chain.from_urdf(path, tip="tool"), Space(), [JointOffset(joint="turn", offset=Fixed(0.01))])
    at = model.at([0.4, -0.7])
    expected = se3.rotation_about((0, 0, 1), 0.01) @ _joints(at.posture)
    np.testing.assert_allclose(_displaced(at), expected, atol=1e-12)


def test_the_page_says_what_it_draws(case):
    model, made, layer = case
    at = model.at("paper")
    text = pages([ViewPose(at, at.exact(at.space.sample(0, 0, 40)), "paper")], layers=[layer])
    legend = text.partition('aria-label="Compensation"')[2].partition("</section>")[0]
    before = 1e3 * np.linalg.norm(made.correction.before[:3], axis=0).max()
    assert f"from {before:.4g} mm at worst" in legend
    numbers = data_block(text, "settings")["layers"]["compensation"]
    assert len(numbers["lines"]) == 6
    for line in numbers["lines"]:
        assert len(line["points"]) == len(line["moves"])
    assert any(path.endswith("/compensation/wanted") for path in nodes_of(text))


@pytest.mark.slow
def test_a_pose_without_a_correction_is_said(case):
    model, _, _ = case
    far = model.configuration("paper").copy()
    far[1] = model.chain.configurations.limits[1][1] + 0.1
    made = pp.compensate(model, far[:, None])
    assert made.correction.status == ("limit",)
    chapter = compensation_chapter(made, model)
    assert chapter.answers == ("Compensation: no pose has a correction: limit",)
    assert chapter.layer is not None
    assert chapter.layer.settings(1.0)["lines"] == []


@pytest.mark.slow
@needs_chromium
def test_the_arms_are_drawn_as_large_as_the_legend_says(case, tmp_path):
    model, _, layer = case
    at = model.at("paper")
    path = tmp_path / "compensation.html"
    path.write_text(pages([ViewPose(at, at.exact(at.space.sample(0, 0, 40)), "paper")], layers=[layer]), "utf-8")
    balls = """() => precisionPin.viewer.scene_tree.find(["meshcat", "compensation"]).object.children
      .filter((one) => one.isMesh && one.geometry.type === "SphereGeometry").map((one) => one.position.toArray())"""
    with chromium(viewport={"width": 800, "height": 480}) as context:
        visit = visited(context, path)
        visit.page.wait_for_selector("body[data-ready=yes]")
        times = float(visit.page.inner_text("#compensation-times"))
        found = np.reshape(visit.page.evaluate(balls), (3, -1, 3)).swapaxes(1, 2)
        np.testing.assert_allclose(found, layer.nominal + times * layer.arms, atol=1e-5)
        assert complaints(visit) == []
