"""Lognormal, arcsine, two-point, empirical laws and rows, against scipy.stats, quadrature and closed forms."""

import itertools
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import integrate, special, stats

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import (
    FARTHEST_NORMAL,
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Fixed,
    JointNormal,
    Law,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.laws.law import cumulative
from precision_pin.draws.space import LabelledSpace, Space
from support.sampling_checks import ALPHA, Sampler, exact_failures, sampling_failures

QUANTILES = ((0.0, -1.0), (0.2, -0.5), (0.2, 0.1), (0.7, 0.1), (0.9, 2.0), (1.0, 2.5))
"""A gap between -0.5 and 0.1, and 0.1 itself with probability 1/2."""

SLOPES = ((0.0, -1.0), (0.3, -0.2), (0.6, 0.0), (0.9, 0.3), (1.0, 2.0))

MEASURED = ((0.1, -0.3, 5.0), (0.2, 0.4, 4.0), (-0.1, 0.4, 4.5), (0.3, -0.3, 3.0), (0.1, -0.3, 5.0))


def lognormal(std: float, mean: float) -> Any:
    sigma = math.sqrt(math.log(1 + (std / mean) ** 2))
    return stats.lognorm(sigma, scale=mean / math.sqrt(1 + (std / mean) ** 2))


LOGNORMAL = [(Lognormal(0.3, 1.0), lognormal(0.3, 1.0)), (Lognormal(2e-6, 1e-5), lognormal(2e-6, 1e-5))]
LOGNORMAL += [(Lognormal(4.0, 2.0), lognormal(4.0, 2.0)), (Lognormal(1e-3, 5.0), lognormal(1e-3, 5.0))]
ARCSINE = [(Arcsine(0.25, 1.0), stats.arcsine(0.75, 0.5)), (Arcsine(5e-5), stats.arcsine(-5e-5, 1e-4))]

NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)


def grid() -> Array:
    """Uniform numbers as the generator makes them: the ends, near them, and many between; symmetric."""
    half = np.concatenate([[2.0**-53, 3 * 2.0**-53, 1e-12, 1e-9, 1e-6], np.linspace(0.001, 0.4999, 2001)])
    odd = (2 * np.floor(half * 2.0**52) + 1) / 2.0**53
    return np.sort(np.concatenate([odd, 1 - odd]))


def expectation(law: Law, function: Any) -> complex:
    """E function(x), by quadrature over the uniform number on panels that close in on both ends, or the normal one."""
    normal = law.variates == "normal"
    if normal:
        edges = np.linspace(-13, 20, 133)
    else:
        edges = np.concatenate([2.0 ** -np.arange(60, 1, -1), 1 - 2.0 ** -np.arange(1, 53), law.breaks])
    total = 0j
    for a, b in itertools.pairwise(np.unique(edges)):
        v = (a + b) / 2 + (b - a) / 2 * NODES
        density = stats.norm.pdf(v) if normal else 1.0
        total += (b - a) / 2 * complex((WEIGHTS * density) @ function(law.sample(v[None])[0]))
    return total


# ---- quantiles ----


@pytest.mark.parametrize(("law", "frozen"), LOGNORMAL)
def test_lognormal_quantiles_equal_scipy(law: Lognormal, frozen: Any) -> None:
    u = grid()
    seen = law.inverse(u[None])[0]
    expected = np.where(u < 0.5, frozen.ppf(u), frozen.isf(1 - u))
    np.testing.assert_allclose(seen, expected, rtol=1e-12)
    assert (np.diff(seen) >= 0).all()
    # the median is the exponential of the logarithm's mean
    assert law.inverse(np.array([[0.5]]))[0, 0] == pytest.approx(
        law.mean / math.sqrt(1 + (law.std / law.mean) ** 2), rel=1e-15
    )


def test_the_logarithm_of_a_lognormal_number_is_normal_by_hand() -> None:
    # s = m: σ² = ln 2, the mean of the logarithm ln m - ln(2)/2
    law = Lognormal(3.0, 3.0)
    z = np.array([[-2.0, 0.0, 1.5]])
    np.testing.assert_allclose(np.log(law.sample(z)), math.log(3) - math.log(2) / 2 + math.sqrt(math.log(2)) * z)
    assert law.variates == "normal"


@pytest.mark.parametrize(("law", "frozen"), ARCSINE)
def test_arcsine_quantiles_equal_scipy_and_are_symmetric_to_the_bit(law: Arcsine, frozen: Any) -> None:
    u = grid()
    seen = law.inverse(u[None])[0]
    expected = np.where(u <= 0.5, frozen.ppf(u), 2 * frozen.mean() - frozen.ppf(1 - u))
    np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-12 * (frozen.std() + abs(frozen.mean())))
    if law.mean == 0:
        np.testing.assert_array_equal(seen, -law.inverse(1 - u[None])[0])
    assert law.inverse(np.array([[0.5]]))[0, 0] == law.mean
    assert np.abs(seen - law.mean).max() <= law.half_width * (1 + 1e-15)


def test_an_arcsine_number_is_a_sine_wave_at_a_random_moment() -> None:
    # the sine of equally spaced phases, sorted, are the quantiles at the middles
    phases = 2 * np.pi * (np.arange(2000) + 0.5) / 2000
    middles = (np.arange(2000) + 0.5) / 2000
    np.testing.assert_allclose(Arcsine(0.7).sample(middles[None])[0], np.sort(0.7 * np.sin(phases)), atol=2e-3)


def test_two_point_takes_the_upper_value_above_one_minus_p() -> None:
    law = TwoPoint(0.5, 2.0, 0.3)
    u = np.array([[2.0**-53, 0.3, 0.69999, 0.7 + 1e-15, 0.70001, 1 - 2.0**-53]])
    np.testing.assert_array_equal(law.sample(u), [[1.5, 1.5, 1.5, 2.5, 2.5, 2.5]])
    np.testing.assert_array_equal(TwoPoint(0.5).sample(np.array([[0.4999, 0.5001]])), [[-0.5, 0.5]])


def test_empirical_quantiles_by_hand() -> None:
    law = Empirical(QUANTILES)
    u = np.array([[0.0, 0.1, 0.2 - 1e-16, 0.2, 0.5, 0.7, 0.8, 0.95, 1.0]])
    expected = [[-1.0, -0.75, -0.5, 0.1, 0.1, 0.1, 1.05, 2.25, 2.5]]
    np.testing.assert_allclose(law.sample(u), expected, rtol=0, atol=2e-15)


def test_empirical_quantiles_equal_numpy_interpolation() -> None:
    u = grid()
    p, x = np.array(SLOPES).T
    np.testing.assert_allclose(Empirical(SLOPES).sample(u[None])[0], np.interp(u, p, x), rtol=0, atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 3, 57])
def test_empirical_samples_are_hazen_s_quantiles(count: int) -> None:
    samples = np.random.default_rng(count).normal(3.0, 2.0, count)
    law = Empirical.from_samples(samples)
    u = grid()
    np.testing.assert_allclose(
        law.sample(u[None])[0], np.quantile(samples, u, method="hazen"), rtol=0, atol=1e-14 * np.abs(samples).max()
    )
    assert law.mean_vector[0] == pytest.approx(samples.mean(), rel=1e-15)
    assert law.ends == (samples.min(), samples.max())


def test_a_row_is_chosen_by_the_first_number_alone() -> None:
    law = Rows(MEASURED)
    u = np.array([[0.0001, 0.1999, 0.2001, 0.5, 0.9999], [0.1] * 5, [0.9] * 5])
    np.testing.assert_array_equal(law.sample(u).T, [MEASURED[k] for k in (0, 0, 1, 2, 4)])
    assert law.components == (".0", ".1", ".2")
    assert Rows(MEASURED, ("x", "rx", "z")).components == (".x", ".rx", ".z")


@pytest.mark.parametrize("count", [1, 3, 49, 1000, 99_991])
def test_the_largest_uniform_number_chooses_the_last_row(count: int) -> None:
    law = Rows(tuple((float(k),) for k in range(count)))
    assert law.sample(np.array([[2.0**-53, 1 - 2.0**-53]]))[0].tolist() == [0.0, count - 1]


# ---- moments ----


ALL: list[Law] = [
    *(law for law, _ in LOGNORMAL),
    *(law for law, _ in ARCSINE),
    TwoPoint(0.5, 2.0, 0.3),
    TwoPoint(1e-5),
    Empirical(QUANTILES),
    Empirical(SLOPES),
    Empirical.from_samples([0.3, 0.1, 0.9, 0.9, -0.2]),
]


@pytest.mark.parametrize("law", ALL, ids=repr)
def test_mean_and_variance_by_quadrature_of_the_inverse(law: Law) -> None:
    mean = expectation(law, lambda x: x).real
    variance = expectation(law, lambda x: (x - mean) ** 2).real
    rtol = 1e-13
    std = math.sqrt(law.covariance[0, 0])
    assert law.mean_vector.shape == (1,)
    assert law.covariance.shape == (1, 1)
    assert law.mean_vector[0] == pytest.approx(mean, rel=rtol, abs=rtol * std)
    assert law.covariance[0, 0] == pytest.approx(variance, rel=10 * rtol)


@pytest.mark.parametrize(("law", "frozen"), [*LOGNORMAL, *ARCSINE])
def test_mean_and_variance_equal_scipy(law: Law, frozen: Any) -> None:
    assert law.mean_vector[0] == pytest.approx(frozen.mean(), rel=1e-14, abs=1e-20)
    # scipy's lognormal takes exp(σ²) - 1, whose rounding is 1e-16/σ²
    assert law.covariance[0, 0] == pytest.approx(frozen.var(), rel=1e-8)


def test_moments_of_two_points_and_rows_by_hand() -> None:
    assert TwoPoint(0.5, 2.0, 0.3).mean_vector[0] == pytest.approx(0.7 * 1.5 + 0.3 * 2.5, rel=1e-15)
    assert TwoPoint(0.5, 2.0, 0.3).covariance[0, 0] == pytest.approx(0.3 * 0.7, rel=1e-15)
    assert TwoPoint(3.0).covariance[0, 0] == 9
    law = Rows(MEASURED)
    np.testing.assert_allclose(law.mean_vector, np.mean(MEASURED, axis=0), rtol=1e-15)
    np.testing.assert_allclose(law.covariance, np.cov(np.array(MEASURED).T, bias=True), rtol=0, atol=1e-16)


# ---- characteristic functions ----


@pytest.mark.fast(29)
@pytest.mark.parametrize("law", ALL, ids=repr)
@pytest.mark.parametrize("scaled", [0.0, 1e-9, 0.01, 0.7, -2.0, 9.0])
def test_characteristic_function_by_quadrature_of_the_inverse(law: Law, scaled: float) -> None:
    if isinstance(law, Lognormal) and scaled > 2:
        return  # too fast for this quadrature; another test goes along another path
    t = scaled / math.sqrt(law.covariance[0, 0])
    expected = expectation(law, lambda x: np.exp(1j * t * x))
    phase = abs(t * law.mean_vector[0])  # rounded to 1e-16 of itself
    assert complex(law.characteristic(np.array([t]))) == pytest.approx(expected, abs=2e-12 + 1e-15 * phase)


@pytest.mark.fast(16)
@pytest.mark.parametrize("spread", [0.01, 0.1, 0.5, 1.0, 3.0, 30.0, 1000.0])
@pytest.mark.parametrize("scaled", [1e-4, 0.05, 1.0, 4.0, 60.0, 5000.0])
def test_lognormal_characteristic_function_by_a_fine_sum_along_another_path(spread: float, scaled: float) -> None:
    """The definition along the real axis or, of wide laws, where the wave falls fastest: e^{σ(x + ih)} is imaginary."""
    law = Lognormal(2 * spread, 2.0)
    sigma = math.sqrt(math.log(1 + spread**2))
    height = math.pi / (2 * sigma) if sigma > 0.8 else 0.0
    if not height and scaled * 2 * sigma * math.exp(8 * sigma) > 1000:
        pytest.skip("the wave is too fast to be summed on the real axis; the cumulants serve narrow laws")
    z = np.linspace(-16, 16, 160_001) + 1j * height
    scale = 2.0 / math.sqrt(1 + spread**2)
    wave = np.exp(1j * scaled * scale * np.exp(sigma * z) - z**2 / 2) / math.sqrt(2 * math.pi)
    expected = complex(wave.sum() * 32 / 160_000)
    assert complex(law.characteristic(np.array([scaled]))) == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
def test_lognormal_characteristic_function_by_scipy_s_integration() -> None:
    law, sigma = Lognormal(1.0, 1.0), math.sqrt(math.log(2))
    for t in (0.3, 2.0):
        parts = [
            integrate.quad(
                lambda z, part=part, t=t: part(t * math.exp(sigma * z) / math.sqrt(2)) * stats.norm.pdf(z),
                -9,
                9,
                limit=500,
            )[0]
            for part in (math.cos, math.sin)
        ]
        assert complex(law.characteristic(np.array([t]))) == pytest.approx(complex(*parts), abs=1e-8)


def test_lognormal_characteristic_function_of_a_narrow_law_by_cumulants() -> None:
    law = Lognormal(1e-4, 1.0)
    t = np.linspace(-3e4, 3e4, 13)
    # with w = exp(σ²) = 1 + s², the third cumulant is (w - 1)²(w + 2), the fourth (w - 1)²(w⁴ + 2w³ + 3w² - 6)
    s, w = 1e-4, 1 + 1e-8
    third, fourth = s**4 * (w + 2), 16 * s**6
    expected = np.exp(1j * t - s**2 * t**2 / 2 - 1j * third * t**3 / 6 + fourth * t**4 / 24)
    # the fifth, about 125 s⁸, and the rounding of t·mean
    np.testing.assert_allclose(law.characteristic(t[None]), expected, rtol=0, atol=1e-11)


def test_characteristic_function_of_arcsine_is_bessel_s_and_of_two_points_a_cosine() -> None:
    t = np.linspace(-60, 60, 241)
    np.testing.assert_allclose(Arcsine(0.5).characteristic(t[None]), special.jv(0, 0.5 * t), rtol=0, atol=1e-15)
    np.testing.assert_allclose(TwoPoint(0.5).characteristic(t[None]), np.cos(0.5 * t), rtol=0, atol=1e-15)
    law = TwoPoint(0.5, 2.0, 0.3)
    expected = 0.7 * np.exp(1.5j * t) + 0.3 * np.exp(2.5j * t)
    np.testing.assert_allclose(law.characteristic(t[None]), expected, rtol=0, atol=1e-14)


def test_characteristic_function_of_rows_is_the_mean_over_them() -> None:
    t = np.random.default_rng(3).normal(size=(3, 4, 6)) * 5
    expected = np.mean([np.exp(1j * np.einsum("i,i...->...", row, t)) for row in np.array(MEASURED)], axis=0)
    np.testing.assert_allclose(Rows(MEASURED).characteristic(t), expected, rtol=0, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("law", ALL, ids=repr)
def test_characteristic_functions_take_any_shape_and_any_number_of_frequencies(law: Law) -> None:
    t = np.linspace(-3, 3, 24).reshape(1, 4, 6) / math.sqrt(law.covariance[0, 0])
    whole = law.characteristic(t)
    assert whole.shape == (4, 6)
    assert complex(whole[1, 2]) == pytest.approx(complex(law.characteristic(t[:, 1, 2])), abs=1e-15)
    np.testing.assert_allclose(whole, law.characteristic(-t).conj(), rtol=0, atol=1e-15)
    assert law.characteristic(np.zeros((1, 0))).shape == (0,)
    many = law.characteristic(np.linspace(0, 1, 5000)[None])
    np.testing.assert_allclose(many[-1], law.characteristic(np.ones((1, 1)))[0], rtol=0, atol=1e-15)


# ---- support, bends, intervals ----


@pytest.mark.parametrize("w", [1.0, -1.0, 2.5, -0.01, 0.0])
def test_support_is_the_largest_over_the_ends(w: float) -> None:
    cases: list[tuple[Law, float, float]] = [
        (Arcsine(0.5, 2.0), 1.5, 2.5),
        (TwoPoint(0.5, 2.0, 0.9), 1.5, 2.5),
        (Empirical(QUANTILES), -1.0, 2.5),
        (Empirical.from_samples([3.0, 1.0, 2.0]), 1.0, 3.0),
        (Rows(((1.0,), (3.0,), (2.0,))), 1.0, 3.0),
    ]
    for law, low, high in cases:
        assert law.support(np.array([w])) == pytest.approx(max(w * low, w * high), rel=1e-15)
    assert Lognormal(0.3, 1.0).support([w]) == (math.inf if w > 0 else 0.0)
    assert Lognormal(0.0, 3.0).support([w]) == 3.0 * w


def test_support_of_rows_is_that_of_the_farthest_row() -> None:
    w = np.array([1.0, -2.0, 0.1])
    assert Rows(MEASURED).support(w) == max(float(w @ row) for row in np.array(MEASURED))


INTERVALS: list[tuple[Law, list[tuple[float, float]]]] = [
    (Fixed(2.0), [(2.0, 2.0)]),
    (Uniform(0.5, 2.0), [(1.5, 2.5)]),
    (Triangular(0.5, 2.0), [(1.5, 2.5)]),
    (TruncatedNormal(0.5, 2.0, 3.0), [(0.5, 3.5)]),
    (Normal(0.5, 2.0), [(2.0 - 4.3, 2.0 + 4.3)]),
    (Disc(0.5), [(-0.5, 0.5)] * 2),
    (Circle(0.5), [(-0.5, 0.5)] * 2),
    (JointNormal(((4.0, 0.0), (0.0, 1.0)), (1.0, 2.0)), [(1 - 17.2, 1 + 17.2), (2 - 8.6, 2 + 8.6)]),
    (TwoPoint(0.5, 2.0), [(1.5, 2.5)]),
    (Empirical(QUANTILES), [(-1.0, 2.5)]),
    (Rows(MEASURED), [(-0.1, 0.3), (-0.3, 0.4), (3.0, 5.0)]),
    (
        Lognormal(3.0, 3.0),
        [
            (
                3 / math.sqrt(2) * math.exp(-8.6 * math.log(2) ** 0.5),
                3 / math.sqrt(2) * math.exp(8.6 * math.log(2) ** 0.5),
            )
        ],
    ),
]


@pytest.mark.parametrize(("law", "expected"), INTERVALS, ids=[type(law).__name__ for law, _ in INTERVALS])
def test_interval_is_what_samples_stay_between(law: Law, expected: list[Any]) -> None:
    assert FARTHEST_NORMAL == 8.6
    for number, bounds in enumerate(expected):
        assert law.interval(number) == pytest.approx(tuple(bounds), rel=1e-14)


def test_a_lognormal_setting_is_positive_though_its_support_begins_at_zero() -> None:
    view = LabelledSpace(Space((Draw("k", Lognormal(0.2, 1.0)), Draw("two", TwoPoint(1.0)))), "beam[link]")
    view.positive("EI", "k")
    with pytest.raises(InputError, match="as low as -1"):
        view.positive("EI", "two")


def test_bends_are_where_the_inverse_jumps_or_bends() -> None:
    assert TwoPoint(1.0, 0.0, 0.25).breaks == (0.75,)
    assert Triangular(1.0).breaks == (0.5,)
    assert Empirical(QUANTILES).breaks == (0.2, 0.7, 0.9)
    for law in (Uniform(1.0), Normal(1.0), TruncatedNormal(1.0), Lognormal(1.0, 1.0), Arcsine(1.0)):
        assert law.breaks == ()


def test_at_scores_is_the_inverse_at_phi() -> None:
    z = np.linspace(-6, 6, 241)[None]
    for law in (Uniform(1.0), Triangular(2.0), TruncatedNormal(1.0, 0.3), Arcsine(1.0), Empirical(SLOPES)):
        np.testing.assert_allclose(law.at_scores(z), law.inverse(stats.norm.cdf(z)), rtol=0, atol=1e-10)
    np.testing.assert_array_equal(Normal(0.5, 2.0).at_scores(z), 2.0 + 0.5 * z)
    np.testing.assert_allclose(
        np.log(Lognormal(3.0, 3.0).at_scores(z)), np.log(3 / math.sqrt(2)) + z * math.log(2) ** 0.5
    )
    # far out, where Φ rounds to one, no law leaves its support
    far = np.array([[-8.6, 8.6]])
    for law in (Uniform(1.0), Triangular(1.0), TruncatedNormal(1.0, 0.0, 9.0), Arcsine(1.0), TwoPoint(1.0)):
        low, high = law.interval(0)
        assert low <= law.at_scores(far)[0, 0] < law.at_scores(far)[0, 1] <= high


def test_cumulative_of_scores_is_that_of_scipy() -> None:
    z = np.linspace(-8.6, 8.6, 1721)
    np.testing.assert_allclose(cumulative(z), stats.norm.cdf(z), rtol=4e-15)
    np.testing.assert_allclose(1 - cumulative(z), stats.norm.sf(z), rtol=0, atol=2e-16)


# ---- what is refused ----


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Lognormal(-1.0, 1.0), "standard deviation of a lognormal"),
        (lambda: Lognormal(math.nan, 1.0), "standard deviation of a lognormal"),
        (lambda: Lognormal(1.0, 0.0), "mean of a lognormal law must be positive"),
        (lambda: Lognormal(1.0, -1.0), "mean of a lognormal law must be positive"),
        (lambda: Lognormal(1.0, math.inf), "mean of a lognormal law must be positive"),
        (lambda: Lognormal(1001.0, 1.0), "at most 1000 times its mean"),
        (lambda: Arcsine(-1.0), "half-width of an arcsine"),
        (lambda: Arcsine(1.0, math.nan), "mean of an arcsine"),
        (lambda: TwoPoint(-1.0), "half-width of a two-point"),
        (lambda: TwoPoint(1.0, math.inf), "centre of a two-point"),
        *((lambda p=p: TwoPoint(1.0, 0.0, p), "probability of a two-point") for p in (0.0, 1.0, -0.1, math.nan)),
        (lambda: Empirical(((0.0, 1.0),)), "at least two quantiles"),
        (lambda: Empirical(((0.0, 1.0), (0.9, 2.0))), "from probability 0 to 1, these go from 0 to 0.9"),
        (lambda: Empirical(((0.1, 1.0), (1.0, 2.0))), "from 0.1 to 1"),
        (lambda: Empirical(((0.0, 1.0), (0.5, 0.9), (1.0, 2.0))), "the value 0.9 follows 1"),
        (lambda: Empirical(((0.0, 1.0), (0.5, 1.0), (0.4, 2.0), (1.0, 2.0))), "the probability 0.4 follows 0.5"),
        (lambda: Empirical(((0.0, 1.0), (1.0, math.inf))), "finite numbers"),
        (lambda: Empirical.from_samples([]), "at least one sample"),
        (lambda: Empirical.from_samples([1.0, math.nan]), "list of finite numbers"),
        (lambda: Rows(()), "at least one row"),
        (lambda: Rows(((),)), "at least one row"),
        (lambda: Rows(((1.0, 2.0), (1.0,))), "row 2 of a law of rows has 1 numbers, the first has 2"),
        (lambda: Rows(((1.0, math.nan),)), "finite numbers"),
        (lambda: Rows(((1.0, 2.0),), ("x",)), "as many different names"),
        (lambda: Rows(((1.0, 2.0),), ("x", "x")), "as many different names"),
    ],
)
def test_bad_laws_are_refused(make: Callable[[], Law], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        make()


@pytest.mark.parametrize(
    "law", [Lognormal(0.0, 1.5), Arcsine(0.0, 1.5), TwoPoint(0.0, 1.5), Empirical.from_samples([1.5, 1.5])]
)
def test_no_spread_is_a_constant(law: Law) -> None:
    np.testing.assert_array_equal(law.inverse(grid()[None]), np.full((1, grid().size), 1.5))
    assert law.covariance[0, 0] == 0
    assert law.support([2.0]) == 3.0
    assert complex(law.characteristic([2.0])) == pytest.approx(np.exp(3j), abs=1e-15)
    assert law.interval(0) == (1.5, 1.5)


# ---- sampling, at an error probability of 1e-6 for each check ----

EACH = Space(
    (
        Draw("lognormal", Lognormal(0.3, 1.0)),
        Draw("arcsine", Arcsine(0.7, -0.2)),
        Draw("two", TwoPoint(0.5, 1.0, 0.3)),
        Draw("side", TwoPoint(1.0), Scope.VISIT),
        Draw("empirical", Empirical(SLOPES), Scope.POSE),
        Draw("rows", Rows(MEASURED)),
        Draw("plain", Uniform(1.0)),
    )
)


@pytest.mark.fast(4)
@pytest.mark.parametrize("seed", [0, 20150713, 2**64 - 1])
@pytest.mark.parametrize("first", [0, 7, 2**33 - 3])
def test_every_law_against_plain_python(seed: int, first: int) -> None:
    assert exact_failures(EACH.sample, EACH, seed=seed, units=range(first, first + 12)) == []


@pytest.mark.slow
def test_no_check_finds_fault_at_1e6_draws() -> None:
    assert sampling_failures(EACH.sample, EACH) == []


@pytest.mark.slow
def test_every_row_comes_as_often_as_any_other() -> None:
    x = Space((EACH.draws[5],)).sample(3, 0, 1_000_000)
    np.testing.assert_array_equal(x[:, :1000], EACH.sample(3, 0, 1000)[EACH.slices[5]])
    expected = {row: MEASURED.count(row) / len(MEASURED) for row in MEASURED}
    counts = {row: int((x == np.array(row)[:, None]).all(axis=0).sum()) for row in expected}
    assert sum(counts.values()) == 1_000_000
    for row, count in counts.items():
        assert count > 0
        assert stats.binomtest(count, 1_000_000, expected[row]).pvalue > ALPHA


FEW = Space(
    (
        Draw("l", Lognormal(0.3, 1.0)),
        Draw("a", Arcsine(1.0)),
        Draw("t", TwoPoint(1.0, 0.0, 0.3)),
        Draw("e", Empirical(SLOPES)),
    )
)


@cache
def kept(seed: int, first: int, count: int) -> Array:
    x = FEW.sample(seed, first, count)
    x.flags.writeable = False
    return x


def altered(row: int, change: Callable[[Array], Array]) -> Sampler:
    def sampler(seed: int, first: int, count: int) -> Array:
        x = kept(seed, first, count).copy()
        x[row] = change(x[row])
        return x

    return sampler


@pytest.mark.slow
@pytest.mark.parametrize(
    ("row", "fault"),
    [
        (0, lambda x: 1.01 * x),  # the mean taken for the median: 4 %
        (0, lambda x: 1 + 0.3 * (np.log(x) + 0.043) / 0.2936),  # normal instead
        (1, lambda x: np.sin(np.pi / 2 * 2 / np.pi * np.arcsin(x) * 0.99)),
        (1, lambda x: 2 / np.pi * np.arcsin(x)),  # uniform instead
        (2, lambda x: -x),
        (2, lambda x: np.where(x > 0, 1.001, x)),
        (2, lambda x: np.where((x < 0) & (np.arange(x.size) % 200 == 0), 1.0, x)),  # 0.5 % of the lower ones
        (3, lambda x: np.where(x > 1.9, 1.9, x)),
        (3, lambda x: x + 0.005),
    ],
    ids=["scale", "normal", "narrow", "uniform", "swapped", "off", "share", "clipped", "shifted"],
)
def test_a_planted_fault_in_a_law_is_found_at_1e6_draws(row: int, fault: Callable[[Array], Array]) -> None:
    failures = sampling_failures(altered(row, fault), FEW)
    assert any(failure.startswith(f"{FEW.components[row]}:") for failure in failures), failures


@pytest.mark.slow
def test_the_true_sampler_of_the_few_passes() -> None:
    assert sampling_failures(kept, FEW) == []


def test_a_changed_law_keeps_the_numbers_behind_it() -> None:
    laws = (Uniform(1.0), TwoPoint(1.0))
    before, after = (Space((Draw("a", law), Draw("b", Normal(1.0)))).sample(1, 0, 50) for law in laws)
    np.testing.assert_array_equal(np.sign(before[0]), after[0])
    lognormal = Space((Draw("b", Lognormal(3.0, 3.0)),)).sample(1, 0, 50)[0]
    np.testing.assert_allclose(
        np.log(lognormal / 3) * math.log(2) ** -0.5 + math.log(2) ** 0.5 / 2, before[1], atol=1e-14
    )
