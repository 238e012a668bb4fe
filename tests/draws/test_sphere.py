"""Points of a sphere against quadrature, plain numpy and Archimedes, through every analysis that knows a closed form."""

import math

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.reliability.estimates import plain_estimate
from precision_pin.analyses.reliability.form import from_normals
from precision_pin.analyses.reliability.importance import rare_events
from precision_pin.draws.draw import occasion
from support.sampling_checks import pair_of_uniforms, stream

RADIUS = 3.0
DIRECTIONS = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [2 / 7, -3 / 7, 6 / 7], [-0.6, 0, 0.8]])
HEIGHTS, AREAS = np.polynomial.legendre.leggauss(40)
TURNS = 2 * np.pi * np.arange(80) / 80
NODES = RADIUS * np.array(
    [
        np.outer(np.sqrt(1 - HEIGHTS**2), np.cos(TURNS)),
        np.outer(np.sqrt(1 - HEIGHTS**2), np.sin(TURNS)),
        np.outer(HEIGHTS, np.ones(80)),
    ]
).reshape(3, -1)
WEIGHTS = np.repeat(AREAS / 2, 80) / 80
"""Nodes on the sphere and their shares: exact for polynomials up to degree 79."""


def test_moments_and_characteristic_function_by_quadrature():
    law = pp.Sphere(RADIUS)
    assert (law.size, law.components) == (3, (".x", ".y", ".z"))
    np.testing.assert_allclose(law.mean_vector, NODES @ WEIGHTS, rtol=0, atol=1e-14)
    covariance = (WEIGHTS * NODES) @ NODES.T
    np.testing.assert_allclose(covariance, RADIUS**2 / 3 * np.eye(3), rtol=0, atol=1e-13)
    np.testing.assert_allclose(law.covariance, covariance, rtol=0, atol=1e-13)
    scaled = NODES * math.sqrt(3) / RADIUS
    third, fourth, pairs = law.standardised_moments()
    np.testing.assert_allclose(scaled**3 @ WEIGHTS, third, rtol=0, atol=1e-14)
    np.testing.assert_allclose(scaled**4 @ WEIGHTS, fourth, rtol=1e-13)
    mixed = (WEIGHTS * scaled**2) @ (scaled**2).T
    np.testing.assert_allclose(mixed[~np.eye(3, dtype=bool)], pairs, rtol=1e-13)
    # the others of degree three and four, which the closed forms take as zero
    x, y, z = scaled
    others = [x * y * z, x * x * y, z * z * x, x**3 * y, z**3 * x, x * x * y * z, z * z * x * y]
    np.testing.assert_allclose(np.array(others) @ WEIGHTS, 0, atol=1e-13)
    for t in ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 2.0, 0.5], [3.0, 1.0, -4.0], [1e-10, 0.0, 1e-10]):
        wave = WEIGHTS @ np.exp(1j * np.array(t) @ NODES)
        assert complex(law.characteristic(t)) == pytest.approx(complex(wave), abs=1e-13)
    assert law.characteristic(np.ones((3, 2, 5))).shape == (2, 5)


def test_samples_are_those_of_plain_numpy():
    """Angle and height of the second and the third component's streams; unit length, in every scope."""
    for scope, pose, visit in ((pp.Scope.UNIT, 0, 0), (pp.Scope.POSE, 3, 2), (pp.Scope.VISIT, 3, 2)):
        space = pp.Space((pp.Draw("push", pp.Sphere(RADIUS), scope), pp.Draw("beside", pp.Uniform(1.0))))
        x = space.sample(9, 5, 40, pose=pose, visit=visit)[:3]
        np.testing.assert_allclose(np.linalg.norm(x, axis=0), RADIUS, rtol=4e-16)
        word = occasion(scope, pose, visit)
        for k, unit in enumerate(range(5, 45)):
            turn, height = (
                pair_of_uniforms(9, stream(name), word, unit // 2)[unit % 2] for name in ("push.y", "push.z")
            )
            z, angle = 2 * height - 1, 2 * np.pi * turn
            expected = [np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z]
            np.testing.assert_allclose(x[:, k], RADIUS * np.array(expected), rtol=0, atol=1e-14)


@pytest.mark.parametrize("of", ["streams", "normal numbers", "normal numbers facing", "uniform numbers"])
def test_samples_are_uniform_along_every_direction(of):
    """Archimedes, by Kolmogorov and Smirnov at 1e-6 each; and the covariance within 5 standard errors."""
    space, count = pp.Space((pp.Draw("push", pp.Sphere(RADIUS)),)), 200_000
    generator = np.random.default_rng(11)
    match of:
        case "streams":
            x = space.sample(20261129, 0, count)
        case "normal numbers":
            x = from_normals(space, generator.standard_normal((3, count)))
        case "normal numbers facing":
            x = pp.Sphere(RADIUS).facing(DIRECTIONS[3:4]).from_normals(generator.standard_normal((3, count)))
        case _:
            x = space.inverse(generator.random((3, count)))
    for direction in DIRECTIONS:
        along = direction @ x
        assert stats.kstest(along, stats.uniform(-RADIUS, 2 * RADIUS).cdf, method="asymp").pvalue > 1e-6
    # a square has the variance r⁴ (1/5 - 1/9), a product r⁴/15
    errors = RADIUS**2 * np.sqrt(np.where(np.eye(3) > 0, 4 / 45, 1 / 15) / count)
    assert (np.abs(x @ x.T / count - RADIUS**2 / 3 * np.eye(3)) < 5 * errors).all()
    angle = np.arctan2(x[1], x[0]) / (2 * np.pi) + 0.5
    assert stats.kstest(angle, "uniform", method="asymp").pvalue > 1e-6


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_cap_has_its_share_of_the_sphere(direction):
    """P(u > c along a direction) = (1 - c)/2: about z, or where the law faces it, a plane for FORM, however rare."""
    law = pp.Sphere(1.0)
    for sphere, shares in (
        (law, (1e-2, 1e-4, 1e-6) if direction[2] == 1 else (0.1, 1e-2)),
        (law.facing(direction[None]), (1e-6,)),
    ):
        space = pp.Space((pp.Draw("push", sphere),))
        for share in shares:
            limit = 1 - 2 * share

            def margin(x, limit=limit):
                return limit - direction @ x

            failures = int((margin(space.sample(2, 0, 100_000)) < 0).sum())
            found = rare_events(space, margin, [np.ones(3)], plain_estimate(failures, 100_000, 0.999), 0, 0.999)
            for one in found.estimates:
                assert one.interval[0] <= share <= one.interval[1], one
            assert found.estimates[1].resolved
            if direction[2] == 1 or sphere is not law:
                assert found.form.points[0].beta == pytest.approx(stats.norm.isf(share), abs=1e-5)
