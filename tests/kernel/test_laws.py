"""Compiled random numbers: the laws, the copula, and the functions they rest on, against numpy and scipy."""

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from scipy import special, stats

from kernel.cases import EVERY_LAW, from_python, plain_table
from precision_pin.base.errors import InputError
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Operator
from precision_pin.draws.laws import Arcsine, Empirical, Lognormal, Normal, TwoPoint, Uniform
from precision_pin.draws.laws.symmetric import SymmetricLaw
from precision_pin.draws.space import Space
from precision_pin.kernel import loops as loops
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.statistics import accumulate
from precision_pin.statistics.accumulate import LARGEST
from support.sampling_checks import LAW_SPACE

GAP = ((0.0, -1.0), (0.2, -0.5), (0.2, 0.1), (0.7, 0.1), (0.9, 2.0), (1.0, 2.5))
MANY = tuple(np.random.default_rng(2).normal(size=1000).tolist())
SPACE = Space(
    (*LAW_SPACE.draws, Draw("gap", Empirical(GAP)), Draw("many", Empirical.from_samples(MANY), Scope.VISIT)),
    LAW_SPACE.correlations,
)
SAME_BITS = ("fixed", "uniform", "triangular", "modulus", "two", "gap", "many", "rows", "single")
"""Laws of uniform numbers that need only + - × ÷ and roots."""


def layout_of(space: Space) -> SamplerArrays:
    return sampler.to_arrays(plain_table(space, np.zeros((0, 4, 4)), np.zeros((0, 6))))


LAYOUT = layout_of(SPACE)


def test_numbers_repeated_in_the_compiled_file_are_those_of_their_owners() -> None:
    assert loops.LARGEST == LARGEST
    assert (loops._SHIFT, loops._OFFSET, loops._BINS) == (accumulate.SHIFT, accumulate.OFFSET, accumulate.BINS)
    assert loops._FARTHEST == laws.FARTHEST_NORMAL
    named = {name: getattr(loops, f"_{name}") for name in Operator.__members__ if name != "SIGN"}
    assert {**named, "SIGN": loops._SIGNUM} == {operator.name: int(operator) for operator in Operator}


@pytest.mark.parametrize(
    ("seed", "first", "count", "pose", "visit"),
    [(0, 0, 30_000, 0, 0), (2**64 - 1, 17, 515, 3, 9), (5, 2**33 - 3, 300, 2**20 - 2, 4094), (7, 1, 1, 0, 0)],
)
def test_draws_are_those_of_the_space(seed: int, first: int, count: int, pose: int, visit: int) -> None:
    # other draws and groups, and their order, change no bit of a space
    other = Space((Draw("zz", Arcsine(1.0)), *SPACE.draws[::-1]), SPACE.correlations[::-1])
    for space, tolerance in ((EVERY_LAW, 2e-15), (SPACE, 1e-13), (other, 1e-13)):
        expected = space.sample(seed, first, count, pose=pose, visit=visit)
        drawn = sampler.sample(layout_of(space), seed, first, count, pose=pose, visit=visit)
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name in SAME_BITS:
                np.testing.assert_array_equal(drawn[rows], expected[rows], err_msg=draw.name)
            if draw.name == "disc" and space is EVERY_LAW:
                np.testing.assert_allclose(drawn[rows], expected[rows], rtol=3 * 2.0**-52)
            # the numbers are of order one; a sum of three terms of order one rounds to 2e-16
            np.testing.assert_allclose(drawn[rows], expected[rows], rtol=0, atol=tolerance, err_msg=draw.name)


def ulps(value: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(value - expected) / np.spacing(np.abs(expected))))


def test_a_uniform_number_has_the_bits_of_the_space_and_a_normal_one_nearly() -> None:
    uniforms = [Uniform(half_width, mean) for half_width in (0.1, 1e-5 / 3, 1e300) for mean in (0.0, 1e-300, -0.3)]
    scopes = [*Scope] * 3
    draws = [Draw(f"a{k}", law, scope) for k, (law, scope) in enumerate(zip(uniforms, scopes, strict=True))]
    space = Space((*draws, Draw("normal", Normal(1.0))))
    expected = space.sample(3, 5, 20_000, pose=2, visit=7)
    drawn = sampler.sample(layout_of(space), 3, 5, 20_000, pose=2, visit=7)
    np.testing.assert_array_equal(drawn[:-1], expected[:-1])
    assert ulps(drawn[-1], expected[-1]) <= 5


@pytest.mark.slow
def test_samples_stay_between_the_bounds_and_the_bounds_are_the_law_s() -> None:
    drawn = sampler.sample(LAYOUT, 3, 0, 100_000)
    assert (drawn >= LAYOUT.lowest[:, None]).all()
    assert (drawn <= LAYOUT.highest[:, None]).all()
    expected = {
        "arcsine": (-0.9, 0.5), "two": (0.5, 1.5), "gap": (-1.0, 2.5), "many": (min(MANY), max(MANY)),
        "rows.0": (-0.1, 0.3), "single.0": (1.0, 4.0), "n": (-1 - 0.4 * 8.6, -1 + 0.4 * 8.6),
        "lognormal": tuple(math.exp(s * 8.6 * math.sqrt(math.log(1.09))) / math.sqrt(1.09) for s in (-1, 1)),
    }  # fmt: skip
    for name, (low, high) in expected.items():
        k = SPACE.index[name]
        assert (LAYOUT.lowest[k], LAYOUT.highest[k]) == pytest.approx((low, high), rel=1e-13), name


def test_the_tangent_covariance_holds_the_correlation_and_numbers_beyond_a_law_are_served() -> None:
    """Two shifts along one axis: the variance of their sum."""
    space = Space((Draw("a", Uniform(1e-3)), Draw("b", Lognormal(1e-3, 5e-3))), (Correlation.pair("a", "b", 0.8),))
    model = plain_table(space, np.tile(np.eye(4), (2, 1, 1)), np.eye(6)[[0, 0]])
    assert model.covariance[0, 0] == pytest.approx(space.covariance.sum(), rel=1e-14)
    assert space.covariance[0, 1] > 0.4e-6
    space = Space((Draw("l", Lognormal(0.3, 1.0)), Draw("s", TwoPoint(0.01))))
    model = plain_table(space, np.tile(np.eye(4), (2, 1, 1)), np.eye(6)[[0, 5]])
    x = np.array([[0.5, 40.0, -3.0], [0.01, 2.0, -1.0]])
    found = sampler.errors_at(sampler.to_arrays(model), "exact", x)
    np.testing.assert_allclose(found, model.exact(x), rtol=0, atol=1e-13)


# ---- the functions they rest on ----


@pytest.mark.slow
def test_logarithm_exponential_sine_and_cosine_are_within_two_units_in_the_last_place() -> None:
    rng = np.random.default_rng(1)
    u = np.concatenate([rng.random(10_000), 2.0 ** -np.arange(1, 54), 1 - 2.0 ** -np.arange(2, 54)])
    assert ulps(np.array([*map(from_python(loops.logarithm), u)]), np.log(u)) <= 2
    x = np.concatenate([rng.uniform(-690, 690, 10_000), rng.normal(size=10_000), [0.0, -1e-300, 1e-17]])
    x = np.concatenate([x, np.arange(-60, 61) * math.log(2) / 2, (np.arange(-60, 61) + 1e-9) * math.log(2) / 2])
    assert ulps(np.array([*map(from_python(loops.exponential), x)]), np.exp(x)) <= 2
    assert from_python(loops.exponential)(0.0) == 1.0
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
    for seen, right in ((sine, expected.imag), (cosine, expected.real)):
        np.testing.assert_allclose(seen, right, rtol=0, atol=6e-16)
        assert ulps(seen[exact & (seen != 0)], right[exact & (seen != 0)]) <= 2


@pytest.mark.slow
def test_normal_scores_and_their_cumulative_equal_scipy_far_into_the_tail() -> None:
    p = np.concatenate([np.linspace(1e-6, 0.5, 2501), np.geomspace(math.exp(-25), 0.5, 2501)])
    scores = np.array([*map(from_python(loops.normal_score), p)])
    np.testing.assert_allclose(scores, special.ndtri(p), rtol=3e-15, atol=1e-16)
    p = np.geomspace(1e-300, math.exp(-25), 2501)
    scores = np.array([*map(from_python(loops.far_normal_score), p)])
    np.testing.assert_allclose(scores, special.ndtri(p), rtol=3e-15)
    z = np.concatenate([np.linspace(-8.6, 8.6, 8_601), np.geomspace(1e-12, 8.6, 500), -np.geomspace(1e-12, 8.6, 500)])
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


def row_of(function: Callable[..., Any], given: np.ndarray, *arguments: Any) -> np.ndarray:
    """Apply a law's loop to given numbers, a tile at a time."""
    result, compiled = np.empty_like(given), from_python(function)
    for begin in range(0, given.size, loops.TILE):
        part = given[begin : begin + loops.TILE]
        w = np.full(loops.STRIDE, 0.5)
        w[: part.size] = part
        compiled(w, np.uint64(0), *arguments)
        result[begin : begin + loops.TILE] = w[: part.size]
    return result


def truncated(k: float) -> tuple[float, float, float]:
    return k, special.ndtr(-k), math.erf(k / math.sqrt(2))


@pytest.mark.parametrize(
    ("function", "arguments", "expected"),
    [
        (loops.triangular_law, (0.3, 2.0), stats.triang(0.5, -1.7, 4.0)),
        (loops.truncated_law, (0.3, 2.0, *truncated(3.0)), stats.truncnorm(-3, 3, 0.3, 2.0)),
        pytest.param(loops.truncated_law, (0.0, 1.0, *truncated(9.0)), stats.truncnorm(-9, 9), marks=pytest.mark.slow),
    ],
    ids=["triangular", "truncated", "truncated at nine sigma"],
)
def test_quantiles_on_an_injected_grid_equal_scipy(function, arguments, expected) -> None:
    value = row_of(function, GRID, *arguments)
    # scipy's triangle loses digits near its upper end, so the lower half is compared and the upper mirrored
    lower = GRID < 0.5
    np.testing.assert_allclose(value[lower], expected.ppf(GRID[lower]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(value[lower] - arguments[0], -(value[~lower] - arguments[0]), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_skewed_and_discrete_quantiles_on_an_injected_grid() -> None:
    lower, sigma = GRID < 0.5, math.sqrt(math.log(2))
    seen = row_of(loops.lognormal_law, special.ndtri(GRID), 3.0, sigma, sigma**2 / 2)
    np.testing.assert_allclose(seen[lower], stats.lognorm(sigma, scale=3 / math.sqrt(2)).ppf(GRID[lower]), rtol=1e-12)
    for quantiles in (GAP, Empirical.from_samples([1.5]).quantiles):
        law = Empirical(quantiles)
        u = np.concatenate([GRID, law.segments[:, 0], [1.0]])
        padded = np.concatenate([np.full((3, 4), 9.0), law.segments, np.full((2, 4), -9.0)])
        seen = row_of(loops.empirical_law, u, padded, np.uint64(3), np.uint64(3 + len(law.segments)))
        np.testing.assert_array_equal(seen, law.sample(u[None])[0])
    for count in (1, 3, 49, 99_991):
        table = np.arange(2.0 * count)
        w = np.zeros(2 * loops.STRIDE)
        w[:3] = 2.0**-53, 0.5, 1 - 2.0**-53
        from_python(loops.table_law)(w, np.uint64(0), np.uint64(2), np.uint64(count), np.uint64(0), table)
        assert w[:3].tolist() == [0.0, 2.0 * (count // 2), 2.0 * (count - 1)]
        assert w[loops.STRIDE : loops.STRIDE + 3].tolist() == [1.0, 2.0 * (count // 2) + 1, 2.0 * count - 1]


# ---- what is refused ----


def test_what_is_not_a_seed_a_unit_or_a_known_law_is_refused() -> None:
    layout = layout_of(EVERY_LAW)
    for seed, first, count, pose, message in (
        *((seed, 0, 5, 0, "seed") for seed in (-1, 2**64, 1.5)),
        *((0, *units, 0, "units are numbered from 0") for units in ((-1, 5), (0, -1), (2**63 - 4, 5), (1.0, 5))),
        (0, 0, 5, 2**20, "pose"),
    ):
        with pytest.raises(InputError, match=message):
            sampler.sample(layout, seed, first, count, pose=pose)
    last = sampler.sample(layout, 0, 2**63 - 5, 5)
    np.testing.assert_allclose(last, EVERY_LAW.sample(0, 2**63 - 5, 5), rtol=0, atol=2e-15)
    assert sampler.sample(layout, 0, 0, 0).shape == (EVERY_LAW.size, 0)

    class Strange(SymmetricLaw):
        variates = "normal"
        mean = 0.0
        variance = reach = 1.0
        sample = _deviation_characteristic = lambda self, numbers: numbers

    with pytest.raises(InputError, match="Strange"):
        layout_of(Space((Draw("a", Strange()),)))
