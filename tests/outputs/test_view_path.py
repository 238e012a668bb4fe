"""A path in the 3-D page: its line, its tubes, what the legend says."""

from __future__ import annotations

import re

import numpy as np
import pytest

import precision_pin as pp
from outputs.view_cases import data_block, nodes_of, pages
from precision_pin.analyses.path.figure import PathLayer
from precision_pin.pages.view import ViewPose
from precision_pin.robot.examples import PAPER_SHEET
from support.browser import chromium, complaints, needs_chromium, visited

pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")


@pytest.fixture(scope="module")
def page():
    """Return the law along five poses of the paper's arm, and its page."""
    model = pp.ErrorModel.load(PAPER_SHEET)
    q = model.configuration("paper")[:, None] + np.outer([0.5, 0.3, -0.2, 0], np.linspace(0, 1, 5))
    found = pp.path_law(model, q, samples=400)
    at = model.at("paper")
    errors = at.exact(at.space.sample(0, 0, 40))
    return found, pages([ViewPose(at, errors, "paper")], layers=[PathLayer.of(found)])


def test_the_line_leads_through_the_points(page):
    found, text = page
    node = next(node for path, node in nodes_of(text).items() if path.endswith("/path/line"))
    data = node.object["geometries"][0]["data"]["attributes"]["position"]["array"]
    ends = np.frombuffer(data.data, "<f4").reshape(-1, 2, 3)
    points = found.poses.position.T
    np.testing.assert_allclose(ends, np.stack([points[:-1], points[1:]], axis=1), atol=1e-6)


def test_the_numbers_are_those_of_the_path(page):
    found, text = page
    numbers = data_block(text, "settings")["layers"]["path"]
    np.testing.assert_allclose(numbers["band"], found.band[0], rtol=1e-6)
    np.testing.assert_allclose(numbers["quantile"], found.curve[0], rtol=1e-6)
    assert numbers["worst"] == found.worst_pose(0)
    legend = text.partition('aria-label="Path"')[2].partition("</section>")[0]
    low, high = found.maximum_quantile(0, 0.95).interval
    numbers = re.search(r"stay within (\S+) mm all .*, interval (\S+) to (\S+) mm at 95 % confidence", legend).groups()
    said, *ends = (1e-3 * float(number) for number in numbers)
    assert ends[0] <= low <= said <= high <= ends[1]
    assert ends == pytest.approx([low, high], rel=0.01)
    assert f"most have their largest error at {found.poses.labels[found.worst_pose(0)]}" in legend


@pytest.mark.slow
def test_colours_do_not_show_the_scatter_of_samples():
    model = pp.ErrorModel.load(PAPER_SHEET)
    q = model.configuration("paper")[:, None] + np.outer([1, 0, 0, 0], np.linspace(0, 1, 4))
    found = pp.path_law(model, q, samples=400)
    scale = PathLayer.of(found).scale
    assert np.ptp(found.curve[0]) < 0.05 * found.curve[0].max()
    assert scale.smallest <= 0.9 * found.curve[0].max()


@pytest.mark.slow
@needs_chromium
def test_the_tubes_are_as_wide_as_the_legend_says(page, tmp_path):
    found, text = page
    path = tmp_path / "path.html"
    path.write_text(text, "utf-8")
    corners = """(mesh) => Array.from(precisionPin.viewer.scene_tree.find(["meshcat", "path"]).object.children
      .filter((one) => one.isMesh && one.geometry.index && one.geometry.attributes.color)[mesh]
      .geometry.attributes.position.array)"""
    with chromium(viewport={"width": 800, "height": 480}) as context:
        visit = visited(context, path)
        visit.page.wait_for_selector("body[data-ready=yes]")
        for times in (1.0, 3.0):
            visit.page.evaluate(
                "(times) => { const f = document.getElementById('factor'); "
                "f.value = Math.log10(times * JSON.parse(document.getElementById('settings').textContent).factor); "
                "f.dispatchEvent(new Event('input')); }",
                times,
            )
            said = float(visit.page.inner_text("#path-times"))
            assert said == pytest.approx(times * data_block(text, "settings")["layers"]["path"]["times"], rel=0.01)
            for mesh, radii in enumerate((found.curve[0], found.band[0])):
                rings = np.reshape(visit.page.evaluate(corners, mesh), (5, 16, 3))
                away = rings - found.poses.position.T[:, None]
                widths = np.linalg.norm(away, axis=2)
                np.testing.assert_allclose(widths, np.tile(said * radii[:, None], 16), rtol=0.01)
                way = found.poses.position.T[2] - found.poses.position.T[0]
                np.testing.assert_allclose(away[1] @ way, 0, atol=1e-3 * widths[1, 0] * np.linalg.norm(way))
        assert complaints(visit) == []
