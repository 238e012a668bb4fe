from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from outputs.view_cases import arm_text, pose_model
from precision_pin.pages.view.scales import arm_length, default_factor, middle_of, view_direction
from precision_pin.render.colour_scale import ColourScale, round_number
from precision_pin.render.display_units import WrittenUnit
from precision_pin.robot.mesh_surfaces import Surface, thinned


def test_arm_length_is_the_way_over_the_joints(tmp_path):
    assert arm_length(pose_model(tmp_path, arm_text()).posture) == pytest.approx(0.2 + 0.5 + 0.3, rel=1e-14)


@pytest.mark.parametrize(
    ("value", "rounded"),
    [(1, 1), (1.4, 1), (1.5, 2), (3.1, 2), (3.2, 5), (7, 5), (7.2, 10), (140, 100), (0.034, 0.05), (99, 100)],
)
def test_round_numbers_are_the_nearest_in_proportion(value, rounded):
    assert round_number(value) == rounded


@pytest.mark.slow
@given(st.floats(1e-6, 1e6))
def test_round_numbers_are_1_2_5_and_near(value):
    rounded = round_number(value)
    assert f"{rounded:e}"[0] in "125"
    assert float(f"{rounded:.0e}") == rounded
    assert abs(np.log(rounded / value)) <= np.log(2.5) / 2 * (1 + 1e-12)


@pytest.fixture(scope="module")
def posture(tmp_path_factory):
    return pose_model(tmp_path_factory.mktemp("arm"), arm_text()).posture


def ball(deviation: float, at: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """Return six points with one standard deviation in every direction."""
    return np.hstack([np.eye(3), -np.eye(3)]) * deviation * np.sqrt(3) + np.array(at)[:, None]


def picture(points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return points ``(N, 3)`` as seen from a direction, ``(N, 2)``: the camera's turn, by its azimuth and elevation."""
    azimuth, elevation = np.arctan2(direction[1], direction[0]), np.arctan2(direction[2], np.hypot(*direction[:2]))
    turned = points @ np.array(
        [[np.cos(azimuth), -np.sin(azimuth), 0], [np.sin(azimuth), np.cos(azimuth), 0], [0, 0, 1]]
    )
    # now the camera looks from +x, raised by the elevation
    up = turned[:, 2] * np.cos(elevation) - turned[:, 0] * np.sin(elevation)
    return np.column_stack([turned[:, 1], up])


@pytest.mark.slow
@given(st.floats(1e-8, 1e-3))
def test_the_cloud_spans_a_fifth_to_a_third_of_the_picture(posture, deviation):
    factor = default_factor(ball(deviation), posture)
    assert float(f"{factor:e}".split("e")[0]) in (1, 1.5, 2, 3, 5, 7)
    joints = np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]])
    seen = picture(joints, view_direction(posture))
    half = 2.5 * factor * deviation
    seen = np.vstack([seen, seen[-1] - half, seen[-1] + half])
    width, height = np.ptp(seen, axis=0) / 0.9
    if factor > 1:
        assert 0.2 <= 2 * half / max(width, 1.2 * height) <= 0.36


def test_the_arm_is_not_lost_beside_a_far_mean(posture):
    # 30 mm away and hardly any spread: at 1000 the cloud would stand 30 m away from the arm of 1 m
    factor = default_factor(ball(1e-5, (0, 0, -0.03)), posture)
    seen = picture(np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]]), view_direction(posture))
    both = np.vstack([seen, seen[-1] + picture(np.array([[0, 0, -0.03 * factor]]), view_direction(posture))])
    size = [max(np.ptp(points[:, 0]), 1.2 * np.ptp(points[:, 1])) for points in (seen, both)]
    assert 10 <= factor <= 50
    assert size[0] > 0.44 * size[1]


def test_errors_are_drawn_from_their_mean_where_it_is_far_larger_than_their_spread():
    direction = np.array([2.0, -1.0, 2.0]) / 3
    spread = np.sqrt(3) * 1e-3  # one standard deviation in each of three directions
    np.testing.assert_array_equal(middle_of(ball(1e-3, tuple(2.9 * spread * direction))), np.zeros(3))
    np.testing.assert_allclose(middle_of(ball(1e-3, tuple(3.1 * spread * direction))), 3.1 * spread * direction)
    # without spread the way from the tip is all there is to see
    np.testing.assert_array_equal(middle_of(np.full((3, 9), 1e-3)), np.zeros(3))


def test_a_cloud_is_seen_from_a_wide_side(posture):
    # all errors lie along the usual line of sight: the camera turns until they are seen, and a round cloud turns nothing
    usual = view_direction(posture)
    level = usual * [1, 1, 0] / np.linalg.norm(usual[:2])
    line = np.random.default_rng(1).normal(size=500) * 1e-4 * level[:, None]
    turned = view_direction(posture, line)
    across = [np.ptp(picture(line.T, direction)[:, 0]) for direction in (usual, turned)]
    assert across[1] > 0.4 * np.ptp(np.linalg.norm(line, axis=0)) > across[0]
    np.testing.assert_array_equal(view_direction(posture, ball(1e-4)), usual)


def test_the_default_factor_never_shrinks_and_stands_zeros(posture):
    assert default_factor(ball(0.5), posture) == 1
    assert default_factor(np.zeros((3, 5)), posture) == 1
    assert default_factor(np.full((3, 1), 0.01 / np.sqrt(3)), posture) > 1


def test_ticks_have_units_and_enough_digits():
    assert ColourScale(0.0, 1e-3).unit == WrittenUnit("mm", 1e3)
    assert ColourScale(0.0, 1e-3).ticks == ("0.00", "0.25", "0.50", "0.75", "1.00")
    assert ColourScale(30e-3, 30.004e-3).ticks == ("30.0000", "30.0010", "30.0020", "30.0030", "30.0040")
    assert ColourScale(0.0, 8e-6).unit == WrittenUnit("µm", 1e6)
    assert ColourScale(0.0, 8e-6).ticks == ("0.0", "2.0", "4.0", "6.0", "8.0")
    assert ColourScale(0.4, 0.8).ticks == ("400", "500", "600", "700", "800")
    assert ColourScale(0.0, 0.0).ticks == ("0",)
    assert ColourScale.of([0.02, 0.02 + 1e-16]).ticks == ("20.0",)


def test_thinning_keeps_the_shape():
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.5)
    whole = Surface(np.asarray(ball.vertices), np.asarray(ball.faces), None)
    (reduced,) = thinned([whole], 1.0, most_faces=5000)
    assert 500 < len(reduced.faces) <= 5000
    assert reduced.faces.max() < len(reduced.vertices)
    radii = np.linalg.norm(reduced.vertices, axis=1)
    assert radii.min() > 0.48
    assert radii.max() <= 0.5 + 1e-12
    corners = reduced.vertices[reduced.faces]
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.125, rel=0.02)


def test_small_meshes_are_only_freed_of_doubled_corners():
    import trimesh

    block = trimesh.creation.box((0.1, 0.2, 0.3))
    soup = Surface(np.asarray(block.triangles).reshape(-1, 3), np.arange(36).reshape(12, 3), (1, 0, 0, 1))
    (joined,) = thinned([soup], 1.0)
    assert (len(joined.vertices), len(joined.faces), joined.colour) == (8, 12, (1, 0, 0, 1))
    found = {tuple(np.round(corner, 12)) for corner in joined.vertices}
    assert found == {tuple(np.round(corner, 12)) for corner in block.vertices}


@pytest.mark.parametrize("size", [1e-3, 1e-2])
def test_triangles_that_do_not_hang_together_are_never_thinned_to_none(size):
    generator = np.random.default_rng(5)
    corners = generator.uniform(-0.5, 0.5, (20_000, 1, 3)) + generator.normal(0, size, (20_000, 3, 3))
    heap = Surface(corners.reshape(-1, 3), np.arange(60_000).reshape(-1, 3), None)
    same = Surface(np.tile([[0.0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]], (20_000, 1)), heap.faces, None)
    for soup in (heap, same):
        dust = Surface(1e-9 * np.eye(3), np.array([[0, 1, 2]]), None)
        reduced, gone, box = thinned([soup, dust, replace(dust, vertices=np.eye(3))], 1.0, most_faces=1000)
        assert len(gone.faces) == 0
        assert 200 < len(reduced.faces) <= 1000
        assert len(reduced.vertices) <= 3000
        assert reduced.faces.max() < len(reduced.vertices)
        np.testing.assert_allclose(np.ptp(reduced.vertices, axis=0), np.ptp(soup.vertices, axis=0), atol=0.2)
        assert len(box.faces) == 1
