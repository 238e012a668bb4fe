"""Global search of the farthest point: bodies with a known farthest point, and bodies sampled in very many directions."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import ortho_group

from precision_pin.analyses.worst_case.convex_bodies import TOLERANCE, farthest, quadratic_bound


class Body:
    """centre + boxes·[-1, 1]ⁿ + ellipsoids: the support function written out, and its gradient."""

    def __init__(self, centre, boxes=(), ellipsoids=()):
        self.centre = np.asarray(centre, dtype=float)
        self.boxes = np.asarray(boxes, dtype=float).reshape(-1, 3)
        self.ellipsoids = [np.asarray(root, dtype=float) for root in ellipsoids]

    def heights(self, u):
        value = u @ self.centre + np.abs(u @ self.boxes.T).sum(axis=1)
        return value + sum(np.linalg.norm(u @ root, axis=1) for root in self.ellipsoids)

    def touch(self, u):
        points = self.centre + np.sign(u @ self.boxes.T) @ self.boxes
        for root in self.ellipsoids:
            seen = u @ root
            length = np.linalg.norm(seen, axis=1, keepdims=True)
            points = points + (seen / np.where(length > 0, length, 1)) @ root.T
        return points

    def bound(self, u):
        return quadratic_bound(self.centre, [*(row[:, None] for row in self.boxes), *self.ellipsoids], u)

    def search(self, **settings):
        return farthest(self.heights, self.touch, self.bound, **settings)

    def search_without_bound(self, **settings):
        return farthest(self.heights, self.touch, **settings)


def unit_directions(seed: int, count: int) -> np.ndarray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def check(found, expected):
    assert found.lower == pytest.approx(expected, rel=1e-12)
    assert expected <= found.upper <= expected * (1 + 1e-9)
    assert found.certified


@pytest.mark.parametrize("seed", range(12))
def test_a_zonotope_reaches_as_far_as_its_farthest_corner(seed):
    generator = np.random.default_rng(seed)
    rows = int(generator.integers(1, 11))
    body = Body(generator.normal(size=3) * (seed % 3), generator.normal(size=(rows, 3)) * generator.uniform(0.01, 3))
    signs = np.array(list(itertools.product((-1, 1), repeat=rows)))
    expected = np.linalg.norm(body.centre + signs @ body.boxes, axis=1).max()
    check(body.search(), expected)
    check(body.search_without_bound(), expected)


@pytest.mark.parametrize("seed", range(6))
def test_an_ellipsoid_reaches_as_far_as_its_largest_singular_value(seed):
    generator = np.random.default_rng(seed)
    turn, other = ortho_group.rvs(3, random_state=seed), ortho_group.rvs(3, random_state=seed + 100)
    axes = np.array([3.0, 2.0, 1.0]) * generator.uniform(0.1, 10)
    body = Body(np.zeros(3), ellipsoids=[turn @ np.diag(axes) @ other])
    check(body.search(), axes[0])
    check(body.search_without_bound(), axes[0])


def test_bodies_of_full_symmetry_are_resolved_in_closed_form():
    ring = np.eye(3)[:, :2]
    for body, expected in (
        (Body(np.zeros(3), ellipsoids=[np.eye(3)]), 1.0),
        (Body((1.0, 2.0, 2.0), ellipsoids=[np.eye(3)]), 4.0),
        (Body(np.zeros(3), ellipsoids=[ring, 2 * ring]), 3.0),
        (Body(np.zeros(3), [(0.0, 0.0, 4.0)], [ring, 2 * ring]), 5.0),
        (Body((3.0, 0.0, 0.0), ellipsoids=[ring]), 4.0),
        (Body((0.0, 0.0, 4.0), ellipsoids=[3 * ring]), 5.0),
        (Body((0.0, 0.0, -2.0)), 2.0),
    ):
        found = body.search()
        check(found, expected)
        assert found.cells == 0


def test_a_body_of_one_point_at_the_origin_reaches_nowhere():
    found = Body(np.zeros(3), [(0.0, 0.0, 0.0)], [np.zeros((3, 2))]).search()
    assert (found.lower, found.upper, found.certified) == (0.0, 0.0, True)


@pytest.mark.fast(1)
@pytest.mark.parametrize("seed", range(10))
def test_no_direction_goes_beyond_the_upper_end(seed):
    generator = np.random.default_rng(seed)
    boxes, discs = generator.normal(size=(15, 3)), [generator.normal(size=(3, 2)) for _ in range(6)]
    body = Body(generator.normal(size=3), boxes, discs)
    found = body.search()
    assert found.certified
    assert found.upper <= found.lower * (1 + TOLERANCE)
    looked_at = body.heights(unit_directions(seed, 200_000)).max()
    assert looked_at <= found.upper
    assert looked_at == pytest.approx(found.lower, rel=1e-3)
    # that far a point of the body does lie
    assert np.linalg.norm(body.touch(found.direction[None])) == pytest.approx(found.lower, rel=1e-9)
    assert found.lower == pytest.approx(body.heights(found.direction[None])[0], rel=1e-15)


@pytest.mark.slow
def test_ascents_from_everywhere_find_no_more_on_a_body_with_very_many_corners():
    generator = np.random.default_rng(4)
    body = Body(np.zeros(3), generator.normal(size=(60, 3)))
    found = body.search()
    points = body.touch(unit_directions(1, 20_000))
    for _ in range(100):
        sizes = np.linalg.norm(points, axis=1)
        points = body.touch(points / sizes[:, None])
    sizes = np.linalg.norm(points, axis=1)
    assert sizes.max() == pytest.approx(found.lower, rel=1e-12)
    # most ascents end lower, at corners of their own
    assert len(np.unique(sizes.round(9))) > 5


def test_a_gap_that_does_not_close_is_reported():
    body = Body(np.zeros(3), ellipsoids=[np.eye(3)])
    found = body.search_without_bound(most_cells=5000)
    assert not found.certified
    assert found.cells <= 5000
    assert found.lower == pytest.approx(1.0, rel=1e-12)
    assert 1.0 + 1e-9 < found.upper < 1.01


@pytest.mark.parametrize("seed", range(20))
def test_the_bound_in_closed_form_is_a_bound_whatever_the_direction(seed):
    generator = np.random.default_rng(seed)
    roots = [generator.normal(size=(3, p)) for p in generator.integers(1, 4, size=5)]
    centre = generator.normal(size=3)
    u = unit_directions(seed, 50_000)
    largest = (u @ centre + sum(np.linalg.norm(u @ root, axis=1) for root in roots)).max()
    for direction in unit_directions(seed + 50, 5):
        assert quadratic_bound(centre, roots, direction) >= largest
    assert quadratic_bound(centre, [], u[0]) == pytest.approx(np.linalg.norm(centre), rel=1e-12)
    assert quadratic_bound(centre, [np.array([[0.0], [0.0], [1.0]])], np.array([1.0, 0.0, 0.0])) == math.inf
