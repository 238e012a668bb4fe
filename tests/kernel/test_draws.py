"""Compiled random numbers: Philox, the laws, and the functions they use."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special, stats

from kernel.cases import COVARIANCE, EVERY_LAW, from_python, plain_table
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Operator
from precision_pin.draws.laws import Circle, Disc, Law, Normal, Triangular, TruncatedNormal, Uniform
from precision_pin.draws.laws.symmetric import SymmetricLaw
from precision_pin.draws.space import Space
from precision_pin.kernel import loops as loops
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.statistics import accumulate
from precision_pin.statistics.accumulate import LARGEST

ALPHA = 1e-6


def layout_of(space: Space) -> SamplerArrays:
    return sampler.to_arrays(plain_table(space, np.zeros((0, 4, 4)), np.zeros((0, 6))))


LAYOUT = layout_of(EVERY_LAW)


def ulps(value: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(value - expected) / np.spacing(np.abs(expected))))


def row_of(function, uniforms, *arguments, rows=1):
    """Apply a law's loop to given uniform numbers, a tile at a time: ``(rows, N)`` → ``(rows, N)``."""
    given = np.asarray(uniforms, dtype=float).reshape(rows, -1)
    result, compiled = np.empty_like(given), from_python(function)
    for begin in range(0, given.shape[1], loops.TILE):
        part = given[:, begin : begin + loops.TILE]
        w = np.full(rows * loops.STRIDE, 0.5)
        w.reshape(rows, -1)[:, : part.shape[1]] = part
        compiled(w, np.uint64(0), *arguments)
        result[:, begin : begin + loops.TILE] = w.reshape(rows, -1)[:, : part.shape[1]]
    return result


def test_numbers_repeated_in_the_compiled_file_are_those_of_their_owners() -> None:
    assert loops.LARGEST == LARGEST
    assert (loops._SHIFT, loops._OFFSET, loops._BINS) == (accumulate.SHIFT, accumulate.OFFSET, accumulate.BINS)
    named = {
        "ADD": loops._ADD, "SUBTRACT": loops._SUBTRACT, "MULTIPLY": loops._MULTIPLY, "DIVIDE": loops._DIVIDE,
        "POWER": loops._POWER, "SQRT": loops._SQRT, "SIN": loops._SIN, "COS": loops._COS, "SIGN": loops._SIGNUM,
    }  # fmt: skip
    assert named == {operator.name: int(operator) for operator in Operator}


@pytest.mark.parametrize(
    ("seed", "first", "count", "pose", "visit"),
    [(0, 0, 700, 0, 0), (2**64 - 1, 17, 515, 3, 9), (5, 2**33 - 3, 300, 2**20 - 2, 4094), (7, 1, 1, 0, 0)],
)
def test_draws_are_those_of_the_space(seed: int, first: int, count: int, pose: int, visit: int) -> None:
    expected = EVERY_LAW.sample(seed, first, count, pose=pose, visit=visit)
    drawn = sampler.sample(LAYOUT, seed, first, count, pose=pose, visit=visit)
    for draw, rows in zip(EVERY_LAW.draws, EVERY_LAW.slices, strict=True):
        if draw.name in ("uniform", "triangular", "modulus", "fixed"):
            np.testing.assert_array_equal(drawn[rows], expected[rows], err_msg=draw.name)
        # the numbers are of order one; a sum of three terms of order one rounds to 2e-16
        np.testing.assert_allclose(drawn[rows], expected[rows], rtol=0, atol=2e-15, err_msg=draw.name)
    np.testing.assert_allclose(
        drawn[EVERY_LAW.slices[4]], expected[EVERY_LAW.slices[4]], rtol=3 * 2.0**-52, err_msg="disc"
    )


@pytest.mark.parametrize("mean", [0.0, 1e-300, -0.3])
def test_a_uniform_number_has_the_bits_of_the_space(mean: float) -> None:
    laws = [Uniform(0.1, mean), Normal(0.1), Uniform(1e-5 / 3, mean), Uniform(1e300, mean)]
    scopes = [Scope.UNIT, Scope.UNIT, Scope.POSE, Scope.VISIT]
    space = Space(tuple(Draw(f"a{k}", *both) for k, both in enumerate(zip(laws, scopes, strict=True))))
    expected = space.sample(3, 5, 20_000, pose=2, visit=7)
    drawn = sampler.sample(layout_of(space), 3, 5, 20_000, pose=2, visit=7)
    np.testing.assert_array_equal(drawn[[0, 2, 3]], expected[[0, 2, 3]])


def test_a_standard_normal_number_is_that_of_the_space_within_rounding() -> None:
    space = Space((Draw("z", Normal(1.0)),))
    expected = space.sample(3, 0, 200_000)
    assert ulps(sampler.sample(layout_of(space), 3, 0, 200_000), expected) <= 5
    assert np.abs(expected).max() < 6


@pytest.mark.parametrize("scope", Scope)
def test_a_scope_repeats_its_numbers_exactly_where_it_should(scope: Scope) -> None:
    layout = layout_of(Space((Draw("a", Normal(1.0), scope),)))
    same_pose = np.array_equal(
        sampler.sample(layout, 1, 0, 50, pose=2, visit=0), sampler.sample(layout, 1, 0, 50, pose=2, visit=1)
    )
    same_unit = np.array_equal(
        sampler.sample(layout, 1, 0, 50, pose=2, visit=0), sampler.sample(layout, 1, 0, 50, pose=3, visit=0)
    )
    assert (same_unit, same_pose) == (scope is Scope.UNIT, scope is not Scope.VISIT)


@pytest.mark.slow
def test_logarithm_and_turned_are_within_two_units_in_the_last_place() -> None:
    u = np.concatenate(
        [np.random.default_rng(1).random(20_000), 2.0 ** -np.arange(1, 54), 1 - 2.0 ** -np.arange(2, 54)]
    )
    assert ulps(np.array([*map(from_python(loops.logarithm), u)]), np.log(u)) <= 2
    quarters = np.concatenate([k / 4 * (1 + s * 2.0 ** -np.arange(8, 52)) for k in (1, 2, 3) for s in (1, -1)])
    eighths = np.concatenate([k / 8 * (1 + s * 2.0 ** -np.arange(8, 52)) for k in (1, 3, 5, 7) for s in (1, -1)])
    turns = np.concatenate([u, quarters, eighths, [0.0, 0.25, 0.5, 0.75, 1.0]])
    sine, cosine = np.transpose([*map(from_python(loops.sine_and_cosine), turns, np.ones(turns.size))])
    # the fractions of a turn beyond the nearest eighth are exact, and small enough for numpy's own rounding of 2πr
    eighth = np.rint(8 * turns)
    rest = 2 * math.pi * (turns - eighth / 8)
    known = np.exp(0.25j * math.pi * eighth)
    known.real[np.isin(eighth % 8, [2, 6])] = known.imag[np.isin(eighth % 8, [0, 4])] = 0
    expected = known * (np.cos(rest) + 1j * np.sin(rest))
    exact = np.isin(eighth % 8, [0, 2, 4, 6])
    np.testing.assert_allclose(sine, expected.imag, rtol=0, atol=6e-16)
    np.testing.assert_allclose(cosine, expected.real, rtol=0, atol=6e-16)
    assert ulps(sine[exact & (sine != 0)], expected.imag[exact & (sine != 0)]) <= 2
    assert ulps(cosine[exact & (cosine != 0)], expected.real[exact & (cosine != 0)]) <= 2


@pytest.mark.slow
def test_normal_scores_equal_scipy_far_into_the_tail() -> None:
    p = np.concatenate([np.linspace(1e-6, 0.5, 5001), np.geomspace(math.exp(-25), 0.5, 5001)])
    scores = np.array([*map(from_python(loops.normal_score), p)])
    np.testing.assert_allclose(scores, special.ndtri(p), rtol=3e-15, atol=1e-16)
    p = np.geomspace(1e-300, math.exp(-25), 5001)
    scores = np.array([*map(from_python(loops.far_normal_score), p)])
    np.testing.assert_allclose(scores, special.ndtri(p), rtol=3e-15)


# a grid of uniform numbers of the form (2j + 1)/2⁵³, ends included, that is symmetric about one half
INNER = (2 * np.floor(np.linspace(0, 2.0**51, 2001)[1:]) - 1) * 2.0**-53
GRID = np.concatenate([[2.0**-53, 3 * 2.0**-53, 1e6 * 2.0**-52 + 2.0**-53], INNER])
GRID = np.concatenate([GRID, 1 - GRID])


@pytest.mark.fast(1)
@pytest.mark.parametrize(
    ("function", "arguments", "expected"),
    [
        (loops.uniform_law, (0.3, 2.0), stats.uniform(-1.7, 4.0)),
        (loops.triangular_law, (0.3, 2.0), stats.triang(0.5, -1.7, 4.0)),
        (
            loops.truncated_law,
            (0.3, 2.0, 3.0, special.ndtr(-3.0), math.erf(3 / math.sqrt(2))),
            stats.truncnorm(-3, 3, 0.3, 2.0),
        ),
        (
            loops.truncated_law,
            (0.0, 1.0, 9.0, special.ndtr(-9.0), math.erf(9 / math.sqrt(2))),
            stats.truncnorm(-9, 9),
        ),
    ],
    ids=["uniform", "triangular", "truncated", "truncated at nine sigma"],
)
def test_quantiles_on_an_injected_grid_equal_scipy(function, arguments, expected) -> None:
    value = row_of(function, GRID, *arguments)[0]
    # scipy's triangle loses digits near its upper end, so the lower half is compared and the upper mirrored
    lower = GRID < 0.5
    np.testing.assert_allclose(value[lower], expected.ppf(GRID[lower]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(value[lower] - arguments[0], -(value[~lower] - arguments[0]), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_disc_and_circle_on_an_injected_grid() -> None:
    u, v = (grid.ravel() for grid in np.meshgrid(GRID[::41], GRID[::37]))
    x, y = row_of(loops.disc_law, [u, v], 1.5, rows=2)
    np.testing.assert_allclose(np.hypot(x, y), 1.5 * np.sqrt(u), rtol=1e-15)
    np.testing.assert_allclose(x + 1j * y, 1.5 * np.sqrt(u) * np.exp(2j * np.pi * v), rtol=0, atol=3e-15)
    x, y = row_of(loops.circle_law, [u, v], 1.5, rows=2)
    np.testing.assert_allclose(x + 1j * y, 1.5 * np.exp(2j * np.pi * v), rtol=0, atol=3e-15)


@pytest.mark.slow
def test_a_joint_normal_has_the_root_and_mean_of_its_covariance() -> None:
    z = np.random.default_rng(4).normal(size=(3, loops.TILE))
    w = np.zeros((3, loops.STRIDE))
    w[:, : loops.TILE] = z
    k = [draw.name for draw in EVERY_LAW.draws if draw.name in ("joint", "pair")].index("joint")
    from_python(loops.joint_law)(w.reshape(-1), np.uint64(0), np.uint64(3), LAYOUT.draws.joint_roots[k])
    expected = np.array([[0.1], [0.2], [0.3]]) + np.linalg.cholesky(np.array(COVARIANCE)) @ z
    np.testing.assert_allclose(w[:, : loops.TILE], expected, rtol=0, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (Uniform(2.0, 0.3), stats.uniform(-1.7, 4.0)),
        (Triangular(2.0, 0.3), stats.triang(0.5, -1.7, 4.0)),
        (Normal(2.0, 0.3), stats.norm(0.3, 2.0)),
        (TruncatedNormal(2.0, 0.3, 2.0), stats.truncnorm(-2, 2, 0.3, 2.0)),
        (Disc(2.0), stats.semicircular(0, 2.0)),
        (Circle(2.0), stats.arcsine(-2.0, 4.0)),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Law) else "",
)
def test_a_million_draws_follow_the_law(law: Law, expected) -> None:
    drawn = sampler.sample(layout_of(Space((Draw("a", law),))), 20_240_101, 0, 1_000_000)
    for row in drawn:
        assert stats.kstest(row, expected.cdf).pvalue > ALPHA
    # neighbouring units and the two numbers of a draw are independent
    pairs = [(row[::2], row[1::2]) for row in drawn] + [(row[1:-1:2], row[2::2]) for row in drawn]
    if len(drawn) == 2 and not isinstance(law, Circle):
        pairs.append((drawn[0], drawn[1]))
    for a, b in pairs:
        assert stats.pearsonr(a, b).pvalue > ALPHA
        assert stats.pearsonr(np.abs(a - a.mean()), b**2).pvalue > ALPHA or law.size == 2


def test_what_is_not_a_seed_or_a_unit_is_refused() -> None:
    for seed in (-1, 2**64, 1.5):
        with pytest.raises(InputError, match="seed"):
            sampler.sample(LAYOUT, seed, 0, 5)
    for first, count in ((-1, 5), (0, -1), (2**63 - 4, 5), (1.0, 5)):
        with pytest.raises(InputError, match="units are numbered from 0"):
            sampler.sample(LAYOUT, 0, first, count)
    last = sampler.sample(LAYOUT, 0, 2**63 - 5, 5)
    np.testing.assert_allclose(last, EVERY_LAW.sample(0, 2**63 - 5, 5), rtol=0, atol=2e-15)
    with pytest.raises(InputError, match="pose"):
        sampler.sample(LAYOUT, 0, 0, 5, pose=2**20)
    assert sampler.sample(LAYOUT, 0, 0, 0).shape == (EVERY_LAW.size, 0)


def test_an_unknown_law_is_refused_by_name() -> None:
    class Strange(SymmetricLaw):
        variates = "normal"
        mean = 0.0
        variance = reach = 1.0

        def sample(self, variates):
            return variates

        def _deviation_characteristic(self, frequency):
            return frequency

    with pytest.raises(InputError, match="Strange"):
        layout_of(Space((Draw("a", Strange()),)))
