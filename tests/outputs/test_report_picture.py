"""The picture of the arm: hidden surfaces, shading, camera, enlargement, the same bytes each time."""

from __future__ import annotations

import dataclasses
import io
import itertools

import numpy as np
import pytest

from precision_pin.base import se3
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view.drawing import Cloud, draw_picture
from precision_pin.pages.view.raster import Camera, Triangles, draw_triangles
from precision_pin.robot.examples import PAPER_SHEET

RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
FRONT = Camera(0.0, 0.0)


@pytest.fixture(scope="module")
def at():
    return ErrorModel.load(PAPER_SHEET).at()


def image_of(triangles: Triangles, half: float = 1.0, pixels: int = 80) -> np.ndarray:
    seen = FRONT.project(triangles.corners)
    return draw_triangles(seen, triangles.colours, np.array([-half, -half]), 2 * half / pixels, (pixels, pixels))


def covered(image: np.ndarray) -> float:
    """Return the area that is not transparent, as a share of the image."""
    return float(image[:, :, 3].mean()) / 255


def test_shapes_cover_the_area_that_geometry_gives_them():
    ball = Triangles()
    ball.sphere(("ball",), 0.5, RED, np.eye(4))
    assert covered(image_of(ball)) == pytest.approx(np.pi * 0.25 / 4, rel=0.03)
    box = Triangles()
    box.box(("box",), (3.0, 0.8, 0.5), RED, np.eye(4))
    assert covered(image_of(box)) == pytest.approx(0.4 / 4, rel=0.03)
    rod = Triangles()
    rod.rod(("rod",), (0.0, -0.5, -0.5), (0.0, 0.5, 0.5), 0.05, RED)
    assert covered(image_of(rod)) == pytest.approx(0.1 * np.sqrt(2) / 4, rel=0.05)


def test_what_is_nearer_hides_what_is_behind_it_whatever_the_order():
    for order in (1, -1):
        shapes = [(-1.0, BLUE), (1.0, RED)][::order]
        drawn = Triangles()
        for x, colour in shapes:  # the viewer stands at large x
            drawn.place((colour,), se3.pose(np.eye(3), (x, 0.0, 0.0)))  # type: ignore[arg-type]
            drawn.box((colour, "box"), (0.1, 1.0, 1.0), colour, np.eye(4))  # type: ignore[arg-type]
        red, _, blue, seen = image_of(drawn)[40, 40].astype(int)
        assert seen == 255
        assert red > blue + 60


def test_nodes_stand_on_those_above_them():
    drawn = Triangles()
    drawn.place(("arm",), se3.pose(se3.rotation_about((0.0, 0.0, 1.0), np.pi / 2), (1.0, 2.0, 3.0)))
    drawn.place(("arm", "link"), se3.pose(np.eye(3), (0.5, 0.0, 0.0)))
    drawn.box(("arm", "link", "box"), (0.2, 0.2, 0.2), RED, se3.pose(np.eye(3), (0.0, 0.0, 1.0)))
    # x of arm is y of the root
    assert drawn.corners.reshape(-1, 3).mean(axis=0) == pytest.approx([1.0, 2.5, 4.0])


def test_long_thin_and_far_triangles_cost_no_more_than_they_show():
    drawn = Triangles()
    drawn.surface(("s",), [[0, -900.0, 0], [0, 900.0, 0.1], [0, 900.0, -0.1]], [[0, 1, 2]], RED, np.eye(4))
    drawn.surface(("t",), [[0, 50.0, 0], [0, 60.0, 0.1], [0, 60.0, -0.1]], [[0, 1, 2]], RED, np.eye(4))
    drawn.surface(("u",), [[0, 0.0, 0], [0, 0.0, 0], [0, 0.0, 0]], [[0, 1, 2]], RED, np.eye(4))
    assert 0 < covered(image_of(drawn)) < 0.2
    assert covered(image_of(Triangles())) == 0


def test_the_camera_is_a_right_handed_frame_with_the_base_upright():
    for azimuth in (0.3, 2.0, 5.0):
        axes = Camera(azimuth, 0.4).axes
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1)
        assert axes[0, 2] == 0
        assert axes[1, 2] > 0


@pytest.mark.slow
def test_the_cloud_fills_a_fair_part_of_the_picture_and_the_limit_has_room(at):
    generator = np.random.default_rng(3)
    errors = 1e-3 * generator.standard_normal((3, 2000))
    arm = 2.5  # m, about what the paper's arm is wide
    for scale in (1e-3, 0.03, 1.0, 40.0):
        picture = draw_picture(at.posture, Cloud(scale * errors))
        width = picture.factor * scale * 1e-3 * 2 * 2.33  # 98 % of a normal law
        assert picture.factor >= 1
        if picture.factor > 1:
            assert 0.15 * arm < width < 0.5 * arm
    near = draw_picture(at.posture, Cloud(errors, 2.8e-3, 6e-3))
    far = draw_picture(at.posture, Cloud(errors, 2.8e-3, 1.0))
    assert near.shows_limit
    assert not far.shows_limit
    assert draw_picture(at.posture, Cloud(0 * errors)).factor == 1
    # drawn from an error far away, the cloud is as large as it is about zero; a limit is about zero
    moved = Cloud(errors + np.reshape([36e-3, 0.0, 0.0], (3, 1)), 2.8e-3, 42e-3, True, (36e-3, 0.0, 0.0))
    from_mean = draw_picture(at.posture, moved)
    assert from_mean.factor == draw_picture(at.posture, Cloud(errors, 2.8e-3)).factor
    assert not from_mean.shows_limit


@pytest.mark.slow
@pytest.mark.parametrize(("middle", "limit"), [(0.0, 4e-3), (36e-3, 42e-3), (36e-3, 60e-3), (0.0, 2e-3)])
def test_the_texts_of_a_picture_do_not_overlap(at, middle, limit):
    """A limit about a cloud far from the tip reaches down to the scale of the errors."""
    errors = 1e-3 * np.random.default_rng(3).standard_normal((3, 500)) + [[middle], [0.0], [0.0]]
    made = draw_picture(at.posture, Cloud(errors, middle + 2.8e-3, limit)).figure
    made.canvas.draw()
    boxes = {text.get_text(): text.get_window_extent() for text in made.axes[0].texts}
    assert len(boxes) >= 5
    pairs = itertools.combinations(boxes, 2)
    assert [(one, other) for one, other in pairs if boxes[one].overlaps(boxes[other])] == []


@pytest.mark.slow
def test_the_same_picture_has_the_same_bytes(at):
    def drawn() -> bytes:
        stream = io.BytesIO()
        cloud = Cloud(1e-3 * np.random.default_rng(1).standard_normal((3, 300)), 2.8e-3, 2e-3, False)
        draw_picture(at.posture, cloud).figure.savefig(stream, format="png", metadata={"Software": None})
        return stream.getvalue()

    assert drawn() == drawn()


def test_the_arm_stands_out_from_light_and_dark_paper():
    for shade in (0.0, 1.0):
        drawn = Triangles()
        drawn.sphere(("ball",), 0.8, (shade, shade, shade, 1.0), np.eye(4))
        middle = image_of(drawn)[30:50, 30:50, :3].astype(float)
        assert 20 < middle.mean() < 235


@pytest.mark.slow
def test_a_posture_alone_is_enough(at):
    posture = dataclasses.replace(at.posture)
    assert draw_picture(posture, Cloud(np.zeros((3, 1)))).points == 1
