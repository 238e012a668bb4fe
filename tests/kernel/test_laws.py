"""The compiled laws lognormal, arcsine, two-point, empirical, rows, and the copula, against numpy and scipy."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal

import numpy as np
import pytest
from scipy import special, stats

from kernel.cases import from_python, plain_table
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import (
    Arcsine,
    Empirical,
    Law,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.space import Space
from precision_pin.kernel import loops as loops
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from support.sampling_checks import exact_failures, sampling_failures

SLOPES = ((0.0, -1.0), (0.3, -0.2), (0.6, 0.0), (0.9, 0.3), (1.0, 2.0))
GAP = ((0.0, -1.0), (0.2, -0.5), (0.2, 0.1), (0.7, 0.1), (0.9, 2.0), (1.0, 2.5))
MEASURED = ((0.1, -0.3, 5.0), (0.2, 0.4, 4.0), (-0.1, 0.4, 4.5), (0.3, -0.3, 3.0), (0.1, 0.7, 5.0))
MANY = tuple(np.random.default_rng(2).normal(size=1000).tolist())
MATRIX = ((1.0, 0.5, -0.3, 0.2), (0.5, 1.0, 0.1, 0.7), (-0.3, 0.1, 1.0, -0.2), (0.2, 0.7, -0.2, 1.0))

SPACE = Space(
    (
        Draw("lognormal", Lognormal(0.3, 1.0)),
        Draw("u", Uniform(0.5, 2.0)),
        Draw("arcsine", Arcsine(0.7, -0.2), Scope.POSE),
        Draw("two", TwoPoint(0.5, 1.0, 0.3), Scope.VISIT),
        Draw("n", Normal(0.4, -1.0)),
        Draw("gap", Empirical(GAP)),
        Draw("many", Empirical.from_samples(MANY), Scope.VISIT),
        Draw("rows", Rows(MEASURED)),
        Draw("single", Rows(((1.0,), (2.0,), (4.0,))), Scope.POSE),
        Draw("t", Triangular(1.0)),
        Draw("l", Lognormal(0.2, 1.0)),
        Draw("cut", TruncatedNormal(1.0, 0.0, 2.5), Scope.VISIT),
        Draw("arc", Arcsine(0.7), Scope.VISIT),
        Draw("side", TwoPoint(0.5, 0.0, 0.3), Scope.POSE),
        Draw("seen", Empirical(SLOPES), Scope.POSE),
        Draw("alone", Normal(1.0)),
    ),
    (
        Correlation(("u", "n", "t", "l"), MATRIX),
        Correlation.pair("cut", "arc", -0.8),
        Correlation.pair("seen", "side", 0.6),
    ),
)
SAME_BITS = ("two", "gap", "many", "rows", "single")
"""Laws of uniform numbers that need only + - × ÷."""


def layout_of(space: Space) -> SamplerArrays:
    return sampler.to_arrays(plain_table(space, np.zeros((0, 4, 4)), np.zeros((0, 6))))


LAYOUT = layout_of(SPACE)


@pytest.mark.parametrize(
    ("seed", "first", "count", "pose", "visit"),
    [(0, 0, 100_000, 0, 0), (2**64 - 1, 17, 515, 3, 9), (5, 2**33 - 3, 300, 2**20 - 2, 4094), (7, 1, 1, 0, 0)],
)
def test_draws_are_those_of_the_space(seed: int, first: int, count: int, pose: int, visit: int) -> None:
    expected = SPACE.sample(seed, first, count, pose=pose, visit=visit)
    drawn = sampler.sample(LAYOUT, seed, first, count, pose=pose, visit=visit)
    for draw, rows in zip(SPACE.draws, SPACE.slices, strict=True):
        if draw.name in SAME_BITS:
            np.testing.assert_array_equal(drawn[rows], expected[rows], err_msg=draw.name)
        np.testing.assert_allclose(drawn[rows], expected[rows], rtol=0, atol=1e-13, err_msg=draw.name)


@pytest.mark.slow
def test_draws_are_those_of_plain_python() -> None:
    space = Space(tuple(draw for draw in SPACE.draws if draw.name != "many"), SPACE.correlations)
    layout = layout_of(space)
    assert exact_failures(lambda *units: sampler.sample(layout, *units), space, seed=9, units=range(7, 27)) == []


@pytest.mark.slow
def test_no_check_finds_fault_at_1e6_draws() -> None:
    left_out = ("many", "gap")  # values with a probability of their own: not for Kolmogorov's test
    space = Space(tuple(draw for draw in SPACE.draws if draw.name not in left_out), SPACE.correlations)
    layout = layout_of(space)
    assert sampling_failures(lambda *units: sampler.sample(layout, *units), space) == []


@pytest.mark.parametrize(
    "name", ["arcsine", "two", "single.0", "many", "side", "cut", "lognormal", "rows.1", "seen", "n"]
)
def test_scopes_are_honoured(name: str) -> None:
    """The same bits where nothing is drawn again, others where it is, as in numpy."""
    row = SPACE.index[name]
    home, visit, pose, both = (
        sampler.sample(LAYOUT, 1, 0, 64, pose=p, visit=v)[row] for p, v in ((2, 0), (2, 1), (3, 0), (3, 1))
    )
    scope = next(draw.scope for draw in SPACE.draws if name in draw.components)
    assert np.array_equal(home, visit) == (scope is not Scope.VISIT)
    assert np.array_equal(home, pose) == (scope is Scope.UNIT)
    assert np.array_equal(pose, both) == (scope is not Scope.VISIT)


@pytest.mark.slow
def test_samples_stay_between_the_bounds_and_the_bounds_are_the_law_s() -> None:
    drawn = sampler.sample(LAYOUT, 3, 0, 300_000)
    assert (drawn >= LAYOUT.lowest[:, None]).all()
    assert (drawn <= LAYOUT.highest[:, None]).all()
    expected = {
        "arcsine": (-0.9, 0.5), "two": (0.5, 1.5), "gap": (-1.0, 2.5), "many": (min(MANY), max(MANY)),
        "rows.0": (-0.1, 0.3), "rows.1": (-0.3, 0.7), "rows.2": (3.0, 5.0), "single.0": (1.0, 4.0),
        "n": (-1 - 0.4 * 8.6, -1 + 0.4 * 8.6),
        "lognormal": tuple(math.exp(s * 8.6 * math.sqrt(math.log(1.09))) / math.sqrt(1.09) for s in (-1, 1)),
    }  # fmt: skip
    for name, (low, high) in expected.items():
        k = SPACE.index[name]
        assert (LAYOUT.lowest[k], LAYOUT.highest[k]) == pytest.approx((low, high), rel=1e-13), name


def test_any_slice_and_any_number_of_threads_give_the_same_bits() -> None:
    whole = sampler.sample(LAYOUT, 5, 0, 40_000)
    for first, count in ((0, 1), (1, 1), (255, 3), (16_383, 2), (4097, 700)):
        np.testing.assert_array_equal(sampler.sample(LAYOUT, 5, first, count), whole[:, first : first + count])
    with ThreadPoolExecutor(4) as pool:
        parts = list(pool.map(lambda first: sampler.sample(LAYOUT, 5, first, 1250), range(0, 40_000, 1250)))
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), whole)


def test_other_draws_and_groups_change_no_bit() -> None:
    kept = sampler.sample(LAYOUT, 5, 3, 500)
    new = (Draw("aa", Normal(1.0)), Draw("zz", Arcsine(1.0)))
    turned = Correlation(("t", "u", "l", "n"), tuple(tuple(MATRIX[i][j] for j in (2, 0, 3, 1)) for i in (2, 0, 3, 1)))
    groups = (SPACE.correlations[2], turned, SPACE.correlations[1], Correlation.pair("aa", "zz", 0.5))
    other = Space((*new, *SPACE.draws[::-1]), groups)
    again = sampler.sample(layout_of(other), 5, 3, 500)
    for name in SPACE.components:
        np.testing.assert_array_equal(again[other.index[name]], kept[SPACE.index[name]], err_msg=name)


def test_identity_gives_normal_laws_the_numbers_they_have_alone() -> None:
    draws = (Draw("a", Normal(2.0, 1.0)), Draw("b", Lognormal(0.3, 1.0)), Draw("c", Normal(1.0)))
    mixed = Space(draws, (Correlation(("c", "a", "b"), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),))
    np.testing.assert_array_equal(mixed.sample(3, 5, 1000), Space(draws).sample(3, 5, 1000))
    drawn, alone = sampler.sample(layout_of(mixed), 3, 5, 1000), sampler.sample(layout_of(Space(draws)), 3, 5, 1000)
    np.testing.assert_array_equal(drawn[1], alone[1])
    # the compiled sampler multiplies by the standard deviation elsewhere
    np.testing.assert_allclose(drawn, alone, rtol=0, atol=2e-15)


def test_errors_at_given_numbers_beyond_a_law_are_those_of_numpy() -> None:
    space = Space((Draw("l", Lognormal(0.3, 1.0)), Draw("s", TwoPoint(0.01))))
    model = plain_table(space, np.tile(np.eye(4), (2, 1, 1)), np.eye(6)[[0, 5]], tip=np.eye(4))
    layout = sampler.to_arrays(model)
    x = np.array([[0.5, 40.0, -3.0], [0.01, 2.0, -1.0]])
    np.testing.assert_allclose(sampler.errors_at(layout, "exact", x), model.exact(x), rtol=0, atol=1e-13)


def test_the_tangent_covariance_holds_the_correlation() -> None:
    """Two shifts along one axis: the variance of their sum, in the model and over a million compiled samples."""
    space = Space((Draw("a", Uniform(1e-3)), Draw("b", Lognormal(1e-3, 5e-3))), (Correlation.pair("a", "b", 0.8),))
    model = plain_table(space, np.tile(np.eye(4), (2, 1, 1)), np.eye(6)[[0, 0]])
    assert model.covariance[0, 0] == pytest.approx(space.covariance.sum(), rel=1e-14)
    assert space.covariance[0, 1] > 0.4e-6
    drawn = sampler.errors(sampler.to_arrays(model), "linear", 1, 0, 1_000_000)[0]
    deviation = drawn - space.mean.sum()
    error = (deviation**2).std() / 1000
    assert abs((deviation**2).mean() - space.covariance.sum()) < stats.norm.isf(5e-7) * error


# ---- the functions they rest on ----


def ulps(value: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(value - expected) / np.spacing(np.abs(expected))))


def test_the_farthest_score_is_that_of_the_laws() -> None:
    assert loops._FARTHEST == laws.FARTHEST_NORMAL


@pytest.mark.slow
def test_exponential_is_within_two_units_in_the_last_place() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(-690, 690, 20_000), rng.normal(size=20_000), [0.0, -1e-300, 1e-17]])
    x = np.concatenate([x, np.arange(-60, 61) * math.log(2) / 2, (np.arange(-60, 61) + 1e-9) * math.log(2) / 2])
    assert ulps(np.array([*map(from_python(loops.exponential), x)]), np.exp(x)) <= 2
    assert from_python(loops.exponential)(0.0) == 1.0


@pytest.mark.slow
def test_cumulative_equals_scipy_far_into_the_tail() -> None:
    z = np.concatenate([np.linspace(-8.6, 8.6, 17_201), np.geomspace(1e-12, 8.6, 500), -np.geomspace(1e-12, 8.6, 500)])
    seen = np.array([*map(from_python(loops.cumulative), z)])
    # scipy squares a rounded number: 37 ulp of the exponent at the end
    np.testing.assert_allclose(seen, stats.norm.cdf(z), rtol=2e-14)
    lower = z[z < 0][::7]
    power = np.array([float((-(Decimal(value) ** 2) / 2).exp()) for value in lower])
    expected = special.erfcx(-lower / math.sqrt(2)) / 2 * power
    np.testing.assert_allclose(np.array([*map(from_python(loops.cumulative), lower)]), expected, rtol=1e-15)
    assert ulps(seen[z > 0], laws.law.cumulative(z[z > 0])) <= 2
    assert from_python(loops.cumulative)(0.0) == pytest.approx(0.5, rel=2e-16)


# a grid of uniform numbers of the form (2j + 1)/2⁵³, ends included, that is symmetric about one half
INNER = (2 * np.floor(np.linspace(0, 2.0**51, 2001)[1:]) - 1) * 2.0**-53
GRID = np.concatenate([[2.0**-53, 3 * 2.0**-53, 1e6 * 2.0**-52 + 2.0**-53], INNER])
GRID = np.concatenate([GRID, 1 - GRID])


def row_of(function, given, *arguments):
    """Apply a law's loop to given numbers, a tile at a time."""
    result, compiled = np.empty_like(given), from_python(function)
    for begin in range(0, given.size, loops.TILE):
        part = given[begin : begin + loops.TILE]
        w = np.full(loops.STRIDE, 0.5)
        w[: part.size] = part
        compiled(w, np.uint64(0), *arguments)
        result[begin : begin + loops.TILE] = w[: part.size]
    return result


@pytest.mark.slow
def test_quantiles_on_an_injected_grid_equal_scipy() -> None:
    seen = row_of(loops.arcsine_law, GRID, 0.3, 2.0)
    lower = GRID < 0.5
    np.testing.assert_allclose(seen[lower], stats.arcsine(-1.7, 4.0).ppf(GRID[lower]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(seen[lower] - 0.3, -(seen[~lower] - 0.3), rtol=0, atol=1e-15)
    sigma = math.sqrt(math.log(2))
    seen = row_of(loops.lognormal_law, special.ndtri(GRID), 3.0, sigma, sigma**2 / 2)
    np.testing.assert_allclose(seen[lower], stats.lognorm(sigma, scale=3 / math.sqrt(2)).ppf(GRID[lower]), rtol=1e-12)
    seen = row_of(loops.two_point_law, GRID, 0.3, 2.0, 0.7)
    np.testing.assert_array_equal(seen, np.where(GRID > 0.7, 2.3, -1.7))


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [Empirical(SLOPES), Empirical(GAP), Empirical.from_samples(MANY), Empirical.from_samples([1.5])]
)
def test_empirical_quantiles_on_an_injected_grid_equal_numpy(law: Law) -> None:
    assert isinstance(law, Empirical)
    u = np.concatenate([GRID, law.segments[:, 0], [1.0]])
    padded = np.concatenate([np.full((3, 4), 9.0), law.segments, np.full((2, 4), -9.0)])
    seen = row_of(loops.empirical_law, u, padded, np.uint64(3), np.uint64(3 + len(law.segments)))
    np.testing.assert_array_equal(seen, law.sample(u[None])[0])
    if law.quantiles == SLOPES:
        np.testing.assert_allclose(seen, np.interp(u, *np.array(SLOPES).T), rtol=0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3, 49, 99_991])
def test_the_largest_uniform_number_chooses_the_last_row(count: int) -> None:
    table = np.arange(2.0 * count)
    w = np.zeros(2 * loops.STRIDE)
    w[:3] = 2.0**-53, 0.5, 1 - 2.0**-53
    from_python(loops.table_law)(w, np.uint64(0), np.uint64(2), np.uint64(count), np.uint64(0), table)
    assert w[:3].tolist() == [0.0, 2.0 * (count // 2), 2.0 * (count - 1)]
    assert w[loops.STRIDE : loops.STRIDE + 3].tolist() == [1.0, 2.0 * (count // 2) + 1, 2.0 * count - 1]


@pytest.mark.slow
def test_correlate_is_the_mixing_of_numpy() -> None:
    group = SPACE.correlations[0]
    n = np.random.default_rng(4).normal(size=(4, loops.TILE)) * 3
    w = np.zeros((6, loops.STRIDE))
    places = [4, 0, 5, 2]
    w[places, : loops.TILE] = n[list(group.order)]
    rows = np.array([place * loops.STRIDE for place in places], dtype=np.uint64)
    from_python(loops.correlate)(w.reshape(-1), rows, np.pad(group.root, ((0, 2), (0, 2))))
    np.testing.assert_array_equal(w[places, : loops.TILE], group.mix(n)[list(group.order)])
    assert (w[[1, 3]] == 0).all()
