"""A map in the 3-D page: where its marks lie, in which colours, and what the legend says."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import precision_pin as pp
from outputs.view_cases import Node, data_block, nodes_of, pages
from precision_pin.analyses.map.figure import PlacesData
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.pages.view import ViewPose
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.pose_set import PoseSet
from support.browser import chromium, complaints, needs_chromium, visited

pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
AWAY = np.array([1.0, 2.0, 3.0])
REACHES = (-0.6, -0.2, 0.3)
"""Of the two places of two branches and a third one, by joint 2."""


@pytest.fixture(scope="module")
def arm():
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
        at = model.at("paper")
    errors = at.exact(at.space.sample(0, 0, 40))
    return (
        found,
        pages([ViewPose(at, errors, "paper")], layers=[PlacesData.of(found)]),
        pages([ViewPose(at, errors, "paper")]),
    )


def centres(node: Node) -> np.ndarray:
    """Return the middles of the marks of a surface, six corners each, ``(M, 3)``."""
    corners = node.object["geometries"][0]["data"]["attributes"]["position"]["array"]
    return np.frombuffer(corners.data, "<f4").reshape(-1, 6, 3).mean(axis=1)


def test_every_place_has_a_mark_coloured_by_its_worst_pose(arm):
    found, text, _ = arm
    marks = {path.rpartition("/")[2]: node for path, node in nodes_of(text).items() if "/map/" in path}
    size = found.quantile[1, 0]
    of_place = {"first": max(size[:2]), "second": size[2]}
    assert set(marks) == {"level0", "level16", "unreached"}
    worst = 0 if of_place["first"] > of_place["second"] else 2
    places = found.poses.position.T
    np.testing.assert_allclose(centres(marks["level16"]), places[[worst]], atol=1e-6)
    np.testing.assert_allclose(centres(marks["level0"]), places[[2 - worst]], atol=1e-6)
    np.testing.assert_allclose(centres(marks["unreached"]), [AWAY], atol=1e-6)
    # light for small, dark for large, as the bar says
    light, dark = (marks[name].object["materials"][0]["color"] for name in ("level0", "level16"))
    assert sum(light.to_bytes(3)) > sum(dark.to_bytes(3))


def test_the_legend_counts_the_places_and_states_the_ends_of_the_scale(arm):
    found, text, without = arm
    assert "2 places, coloured by the worst pose at each; grey: 1 place that is not reached" in text
    ticks = text.partition('aria-label="Map"')[2].partition("</p>")[0]
    sizes = 1e3 * np.array([max(found.quantile[1, 0, :2]), found.quantile[1, 0, 2]])
    shown = [float(tick.partition("<")[0]) for tick in ticks.split("<span>")[1:]]
    np.testing.assert_allclose([shown[0], shown[-1]], sorted(sizes), atol=0.5)  # written in whole mm
    assert "show-map" not in without
    assert (data_block(text, "settings")["layers"], data_block(without, "settings")["layers"]) == ({"map": {}}, {})


@pytest.mark.slow
@needs_chromium
def test_the_box_switches_the_map_off(arm, tmp_path):
    path = tmp_path / "map.html"
    path.write_text(arm[1], "utf-8")
    with chromium(viewport={"width": 800, "height": 480}) as context:
        visit = visited(context, path)
        visit.page.wait_for_selector("body[data-ready=yes]")
        assert visit.page.evaluate("precisionPin.state().seen.map") is True
        visit.page.uncheck("#show-map")
        assert visit.page.evaluate("precisionPin.state().seen.map") is False
        assert complaints(visit) == []
