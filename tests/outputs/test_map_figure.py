"""Layouts of a map's picture: list, path, plane and space, with what is not reached."""

from __future__ import annotations

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.analyses.map.figure import figure, layout_of
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.pose_set import PoseSet

PAPER = ErrorModel.load(PAPER_SHEET)
CHAIN = PAPER.chain
SIDEWAYS = pp.Orientation.along((0, 0, -1), tool_axis=(1, 0, 0))


def placed(**box) -> PoseSet:
    return pp.place_grid(CHAIN, pp.box_places(**box), SIDEWAYS)


LINE = placed(x=np.linspace(1.0, 2.6, 30), y=0.3, z=0.3)
PLANE = placed(x=np.linspace(0.5, 4.0, 6), y=[0.0, 0.4, 0.8, 1.2, 1.6], z=0.3)
SPACE = placed(x=[1.0, 2.0, 3.0], y=[0.0, 0.4, 0.8], z=[0.1, 0.3, 0.5])
TIMED = PoseSet.at(CHAIN, PAPER.poses["paper"][:, None] + np.linspace(0, 0.2, 9), times=np.linspace(0, 2, 9))
LISTED = PoseSet.at(CHAIN, PAPER.poses["paper"][:, None] + np.linspace(0, 0.2, 3), ("one", "two", "three"))


@pytest.mark.parametrize(
    ("poses", "kind", "axes"),
    [
        (LINE, "path", ("x [mm]",)),
        (PLANE, "plane", ("x [mm]", "y [mm]")),
        (SPACE, "space", ("x [mm]", "y [mm]", "z [mm]")),
        (TIMED, "path", ("time [s]",)),
        (LISTED, "list", ("pose, in the order given",)),
    ],
)
def test_the_layout_follows_the_places(poses, kind, axes):
    layout = layout_of(poses, np.arange(len(poses)))
    assert (layout.kind, layout.names) == (kind, axes)


@pytest.mark.slow
def test_a_heat_map_shows_the_value_of_each_place():
    made = pp.map_poses(PAPER, PLANE, verify=1, specifications=["20 mm"])
    drawn = figure(made)
    (mesh,) = drawn.axes[0].collections[:1]
    field = np.ma.filled(mesh.get_array().reshape(5, 6), np.nan)
    x, y = np.linspace(500, 4000, 6), np.array([0, 400, 800, 1200, 1600])
    for pose in range(len(PLANE)):
        column, row = (
            np.abs(x - 1e3 * PLANE.position[0, pose]).argmin(),
            np.abs(y - 1e3 * PLANE.position[1, pose]).argmin(),
        )
        shown, value = field[row, column], 1e3 * made.quantile[1, 0, pose]
        assert shown == pytest.approx(value) or (np.isnan(shown) and np.isnan(value))
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert labels == ["not reached", "specification not met"]


@pytest.mark.slow
def test_of_several_branches_the_worst_is_drawn():
    poses = pp.place_grid(CHAIN, pp.box_places(x=[1.0, 1.5, 2.0], y=[0.2, 0.6], z=0.3), SIDEWAYS, branches="all")
    made = pp.map_poses(PAPER, poses, verify=0)
    drawn = np.ma.filled(figure(made, "attitude").axes[0].collections[0].get_array(), np.nan).ravel()
    worst = [1e3 * made.quantile[1, 1, poses.node == node].max() for node in range(6)]
    assert np.sort(drawn) == pytest.approx(np.sort(worst))


@pytest.mark.slow
@pytest.mark.parametrize("poses", [LINE, SPACE, TIMED, LISTED])
def test_every_layout_is_drawn(poses, tmp_path):
    figure(pp.map_poses(PAPER, poses, verify=0, relative_to="paper")).savefig(tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 10_000
