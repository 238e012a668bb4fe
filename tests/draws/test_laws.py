"""Laws against scipy.stats, quadrature and closed forms: quantiles, moments, characteristic functions, ends, refusals."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from precision_pin import (
    Arcsine,
    Circle,
    Disc,
    Draw,
    Empirical,
    Fixed,
    InputError,
    JointNormal,
    Lognormal,
    Normal,
    Rows,
    Space,
    Sphere,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.base.arrays import Array
from precision_pin.draws.laws import FARTHEST_NORMAL, Law
from precision_pin.draws.laws.law import cumulative
from precision_pin.draws.space import LabelledSpace
from support.sampling_checks import MEASURED, SLOPES

QUANTILES = ((0.0, -1.0), (0.2, -0.5), (0.2, 0.1), (0.7, 0.1), (0.9, 2.0), (1.0, 2.5))
"""A gap between -0.5 and 0.1, and 0.1 itself with probability 1/2."""


def lognormal(std: float, mean: float) -> tuple[Law, Any]:
    sigma = math.sqrt(math.log(1 + (std / mean) ** 2))
    return Lognormal(std, mean), stats.lognorm(sigma, scale=mean / math.sqrt(1 + (std / mean) ** 2))


SYMMETRIC: list[tuple[Law, Any]] = [
    (Uniform(0.25, 1.0), stats.uniform(0.75, 0.5)),
    (Uniform(5e-5), stats.uniform(-5e-5, 1e-4)),
    (Triangular(0.25, -1.0), stats.triang(0.5, -1.25, 0.5)),
    (Normal(0.25, 2.0), stats.norm(2.0, 0.25)),
    (TruncatedNormal(0.5, 1.0, 0.1), stats.truncnorm(-0.1, 0.1, 1.0, 0.5)),
    (TruncatedNormal(2.0, 0.0, 3.0), stats.truncnorm(-3.0, 3.0, 0.0, 2.0)),
    (TruncatedNormal(0.1, -1.0, 6.0), stats.truncnorm(-6.0, 6.0, -1.0, 0.1)),
    (Arcsine(0.25, 1.0), stats.arcsine(0.75, 0.5)),
    (Arcsine(5e-5), stats.arcsine(-5e-5, 1e-4)),
]
LOGNORMAL = [lognormal(0.3, 1.0), lognormal(2e-6, 1e-5), lognormal(4.0, 2.0), lognormal(1e-3, 5.0)]
SCALAR = [law for law, _ in (*SYMMETRIC, *LOGNORMAL)]
SCALAR += [TwoPoint(0.5, 2.0, 0.3), TwoPoint(1e-5), Empirical(QUANTILES), Empirical(SLOPES)]
SCALAR += [Empirical.from_samples([0.3, 0.1, 0.9, 0.9, -0.2])]

NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)


def grid() -> Array:
    """Uniform numbers as the generator makes them: the ends, near them, near the middle, and many between."""
    ends = np.array([2.0**-53, 3 * 2.0**-53, 1e-12, 1e-9, 1e-6, 1e-4])
    near = 0.5 - np.array([2.0**-53, 1e-12, 1e-9, 1e-6, 1e-3])
    half = np.concatenate([ends, np.linspace(0.001, 0.499, 2001), near])
    odd = (2 * np.floor(half * 2.0**52) + 1) / 2.0**53
    return np.sort(np.concatenate([odd, 1 - odd]))


def expectation(law: Law, function: Any) -> complex:
    """E function(x), by quadrature over the uniform number on panels that close in on both ends, or the normal one."""
    normal = law.variates == "normal"
    ends = (2.0 ** -np.arange(60, 1, -1), 1 - 2.0 ** -np.arange(1, 53))
    edges = np.linspace(-13, 20, 133) if normal else np.unique(np.concatenate([*ends, law.breaks]))
    middle, half = (edges[1:] + edges[:-1])[:, None] / 2, np.diff(edges)[:, None] / 2
    v = middle + half * NODES
    weights = half * WEIGHTS * (stats.norm.pdf(v) if normal else 1.0)
    return complex((weights * function(law.sample(v.reshape(1, -1))[0].reshape(v.shape))).sum())


# ---- quantiles ----


@pytest.mark.parametrize(("law", "frozen"), SYMMETRIC, ids=[repr(law) for law, _ in SYMMETRIC])
def test_quantiles_equal_scipy_rise_and_are_symmetric_to_the_bit(law: Law, frozen: Any) -> None:
    u = grid()
    seen = law.inverse(u[None])[0]
    # scipy's truncated normal is off by 9e-3 at u = 1 - 1e-16 and k = 8, right in the lower half: reflect that
    expected = np.where(u <= 0.5, frozen.ppf(u), 2 * frozen.mean() - frozen.ppf(1 - u))
    np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-12 * (frozen.std() + abs(frozen.mean())))
    assert (np.diff(seen - frozen.mean()) >= 0).all()
    assert law.inverse(np.array([[0.5]]))[0, 0] == frozen.mean()
    if frozen.mean() == 0:
        np.testing.assert_array_equal(seen, -law.inverse(1 - u[None])[0])
    low, high = frozen.support()
    slack = 4 * np.spacing(abs(frozen.mean()) + high - low) if math.isfinite(high) else 0.0
    assert low - slack <= seen[0] <= seen[-1] <= high + slack


def test_lognormal_quantiles_equal_scipy() -> None:
    for law, frozen in LOGNORMAL:
        u = grid()
        seen = law.inverse(u[None])[0]
        expected = np.where(u < 0.5, frozen.ppf(u), frozen.isf(1 - u))
        np.testing.assert_allclose(seen, expected, rtol=1e-12, err_msg=repr(law))
        assert (np.diff(seen) >= 0).all(), law
        # the median is the exponential of the logarithm's mean
        median = law.mean / math.sqrt(1 + (law.std / law.mean) ** 2)
        assert law.inverse(np.array([[0.5]]))[0, 0] == pytest.approx(median, rel=1e-15), law


def test_quantiles_of_two_points_of_tables_and_of_rows_by_hand() -> None:
    u = np.array([[2.0**-53, 0.3, 0.69999, 0.7 + 1e-15, 0.70001, 1 - 2.0**-53]])
    np.testing.assert_array_equal(TwoPoint(0.5, 2.0, 0.3).sample(u), [[1.5, 1.5, 1.5, 2.5, 2.5, 2.5]])
    u = np.array([[0.0, 0.1, 0.2 - 1e-16, 0.2, 0.5, 0.7, 0.8, 0.95, 1.0]])
    expected = [[-1.0, -0.75, -0.5, 0.1, 0.1, 0.1, 1.05, 2.25, 2.5]]
    np.testing.assert_allclose(Empirical(QUANTILES).sample(u), expected, rtol=0, atol=2e-15)
    # a row is chosen by the first number alone
    u = np.array([[0.0001, 0.1999, 0.2001, 0.5, 0.9999], [0.1] * 5, [0.9] * 5])
    np.testing.assert_array_equal(Rows(MEASURED).sample(u).T, [MEASURED[k] for k in (0, 0, 1, 2, 4)])
    for count in (1, 3, 49, 99_991):
        law = Rows(tuple((float(k),) for k in range(count)))
        assert law.sample(np.array([[2.0**-53, 1 - 2.0**-53]]))[0].tolist() == [0.0, count - 1]


def test_empirical_samples_are_hazen_s_quantiles() -> None:
    for count in (1, 2, 57):
        samples = np.random.default_rng(count).normal(3.0, 2.0, count)
        law, u = Empirical.from_samples(samples), grid()
        expected = np.quantile(samples, u, method="hazen")
        np.testing.assert_allclose(law.sample(u[None])[0], expected, rtol=0, atol=1e-14 * np.abs(samples).max())
        assert law.mean_vector[0] == pytest.approx(samples.mean(), rel=1e-15)
        np.testing.assert_array_equal(law.measured[:, 0], np.sort(samples))
    for open_ended in ((0.0, 1.0, 2.0, 2.0), (1.0, 1.0, 2.0, 3.0)):
        assert Empirical(tuple(zip((0.0, 0.25, 0.75, 1.0), open_ended, strict=True))).measured is None


def test_how_much_too_narrow_few_samples_are_is_as_the_sheets_page_says() -> None:
    """Of n samples ``(n-1)/n``; on lines between them less ``E Σ gap²/6n``, with gaps of order statistics by quadrature."""
    page = (Path(__file__).parents[2] / "docs" / "sheet.md").read_text(encoding="utf-8")
    rows = [
        line.strip("|").split("|")
        for line in page.splitlines()
        if line.startswith(("| samples n", "| σ of", "| true σ"))
    ]
    counts, *printed = ([float(cell) for cell in row[1:]] for row in rows)
    x = np.linspace(-7.0, 7.0, 501)
    below, above, computed = stats.norm.cdf(x)[:, None], stats.norm.sf(x), []
    for n in map(int, counts):
        inside = np.triu((below + above) ** n - below**n - above**n)
        gaps = (2 * inside.sum() - np.trace(inside)) * (x[1] - x[0]) ** 2
        narrow = [math.sqrt((n - 1) / n - lost) for lost in (0.0, gaps / 6 / n)]
        computed.append([*narrow, math.sqrt((n - 1) / stats.chi2.ppf(0.05, n - 1))])
    for row, values, digits in zip(printed, zip(*computed, strict=True), (2, 2, 1), strict=True):
        assert row == [round(value, digits) for value in values]
    samples = np.random.default_rng(1).normal(size=7)
    expected = samples.var() - np.square(np.diff(np.sort(samples))).sum() / 42
    assert Empirical.from_samples(samples).covariance[0, 0] == pytest.approx(expected, rel=1e-14)


# ---- moments and characteristic functions ----


@pytest.mark.parametrize("law", SCALAR, ids=repr)
def test_mean_variance_and_characteristic_function_by_quadrature(law: Law) -> None:
    mean = expectation(law, lambda x: x).real
    variance = expectation(law, lambda x: (x - mean) ** 2).real
    assert law.mean_vector == pytest.approx([mean], rel=1e-13, abs=1e-13 * math.sqrt(variance))
    assert law.covariance == pytest.approx(np.array([[variance]]), rel=1e-12)
    for scaled in (0.0, 1e-9, 0.01, 0.7, -2.0, 9.0):
        if isinstance(law, Lognormal) and scaled > 2:
            continue  # too fast for this quadrature; another test goes along another path
        t = scaled / math.sqrt(variance)
        expected = expectation(law, lambda x, t=t: np.exp(1j * t * x))
        phase = abs(t * mean)  # rounded to 1e-16 of itself
        assert complex(law.characteristic(np.array([t]))) == pytest.approx(expected, abs=2e-12 + 1e-15 * phase)


def test_variance_of_a_truncated_normal_by_quadrature() -> None:
    for k in (1e-3, 0.01, 0.049, 0.05, 0.3, 1.0, 8.0, 40.0):
        weights = WEIGHTS * np.exp(-((k * NODES) ** 2) / 2)
        expected = float(weights @ (k * NODES) ** 2 / weights.sum()) if k < 20 else 1.0
        assert TruncatedNormal(2.0, 5.0, k).covariance[0, 0] == pytest.approx(4 * expected, rel=1e-13), k


@pytest.mark.parametrize("spread", [0.01, 0.5, 1.0, pytest.param(30.0, marks=pytest.mark.slow), 1000.0])
def test_lognormal_characteristic_function_by_a_fine_sum_along_another_path(spread: float) -> None:
    """The definition along the real axis or, of wide laws, where the wave falls fastest: e^{σ(x + ih)} is imaginary."""
    sigma = math.sqrt(math.log(1 + spread**2))
    height = math.pi / (2 * sigma) if sigma > 0.8 else 0.0
    z = np.linspace(-16, 16, 160_001) + 1j * height
    for scaled in (1e-4, 1.0, 60.0, 5000.0):
        if not height and scaled * 2 * sigma * math.exp(8 * sigma) > 1000:
            continue  # the wave is too fast to be summed on the real axis; the cumulants serve narrow laws
        scale = 2.0 / math.sqrt(1 + spread**2)
        wave = np.exp(1j * scaled * scale * np.exp(sigma * z) - z**2 / 2) / math.sqrt(2 * math.pi)
        seen = complex(Lognormal(2 * spread, 2.0).characteristic(np.array([scaled])))
        assert seen == pytest.approx(complex(wave.sum() * 32 / 160_000), abs=1e-12), scaled


def test_lognormal_characteristic_function_of_a_narrow_law_by_cumulants() -> None:
    t = np.linspace(-3e4, 3e4, 13)
    # with w = exp(σ²) = 1 + s², the third cumulant is (w - 1)²(w + 2), the fourth (w - 1)²(w⁴ + 2w³ + 3w² - 6)
    s, w = 1e-4, 1 + 1e-8
    third, fourth = s**4 * (w + 2), 16 * s**6
    expected = np.exp(1j * t - s**2 * t**2 / 2 - 1j * third * t**3 / 6 + fourth * t**4 / 24)
    # the fifth, about 125 s⁸, and the rounding of t·mean
    np.testing.assert_allclose(Lognormal(s, 1.0).characteristic(t[None]), expected, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_characteristic_functions_take_any_shape_and_any_number_of_frequencies() -> None:
    for law in (*SCALAR, Rows(((1.0,), (2.0,)))):
        t = np.linspace(-3, 3, 24).reshape(1, 4, 6) / math.sqrt(law.covariance[0, 0])
        whole = law.characteristic(t)
        assert whole.shape == (4, 6)
        assert complex(whole[1, 2]) == pytest.approx(complex(law.characteristic(t[:, 1, 2])), abs=1e-15)
        np.testing.assert_allclose(whole, law.characteristic(-t).conj(), rtol=0, atol=1e-15)
        assert law.characteristic(np.zeros((1, 0))).shape == (0,)
        many = law.characteristic(np.linspace(0, 1, 1100)[None])
        np.testing.assert_allclose(many[-1], law.characteristic(np.ones((1, 1)))[0], rtol=0, atol=1e-15)
    assert Disc(1.0).characteristic(np.zeros((2, 4, 6))).shape == (4, 6)
    t = np.random.default_rng(3).normal(size=(3, 4, 6)) * 5
    expected = np.mean([np.exp(1j * np.einsum("i,i...->...", row, t)) for row in np.array(MEASURED)], axis=0)
    np.testing.assert_allclose(Rows(MEASURED).characteristic(t), expected, rtol=0, atol=1e-14)


# ---- ends, bends ----

SPREAD = 3 / math.sqrt(2)
INTERVALS: list[tuple[Law, list[tuple[float, float]]]] = [
    (Fixed(2.0), [(2.0, 2.0)]),
    (Uniform(0.5, 2.0), [(1.5, 2.5)]),
    (Triangular(0.5, 2.0), [(1.5, 2.5)]),
    (TruncatedNormal(0.5, 2.0, 3.0), [(0.5, 3.5)]),
    (Normal(0.5, 2.0), [(2.0 - 4.3, 2.0 + 4.3)]),
    (Disc(0.5), [(-0.5, 0.5)] * 2),
    (Circle(0.5), [(-0.5, 0.5)] * 2),
    (Sphere(0.5), [(-0.5, 0.5)] * 3),
    (JointNormal(((4.0, 0.0), (0.0, 1.0)), (1.0, 2.0)), [(1 - 17.2, 1 + 17.2), (2 - 8.6, 2 + 8.6)]),
    (Arcsine(0.5, 2.0), [(1.5, 2.5)]),
    (TwoPoint(0.5, 2.0, 0.9), [(1.5, 2.5)]),
    (Empirical(QUANTILES), [(-1.0, 2.5)]),
    (Rows(MEASURED), [(-0.1, 0.3), (-0.3, 0.7), (3.0, 5.0)]),
    (Lognormal(3.0, 3.0), [tuple(SPREAD * math.exp(end * math.sqrt(math.log(2))) for end in (-8.6, 8.6))]),
]  # type: ignore[list-item]


@pytest.mark.parametrize(("law", "expected"), INTERVALS, ids=[type(law).__name__ for law, _ in INTERVALS])
def test_support_function_is_the_largest_over_the_support(law: Law, expected: list[Any]) -> None:
    """And the interval of each number is what its samples stay between."""
    assert FARTHEST_NORMAL == 8.6
    assert [law.interval(number) for number in range(law.size)] == [pytest.approx(ends, rel=1e-14) for ends in expected]
    if isinstance(law, Normal | JointNormal):
        assert law.support(np.full(law.size, -1e-300)) == math.inf
        assert law.support(np.zeros(law.size)) == 0.0
    elif law.size == 1:
        low, high = expected[0] if not isinstance(law, Lognormal) else (0.0, math.inf)
        for w in (1.0, -1.0, 2.5, -0.01):
            assert law.support(np.array([w])) == pytest.approx(max(w * low, w * high), rel=1e-15)
        assert law.support([0.0]) == 0.0
    elif isinstance(law, Rows):
        w = np.array([1.0, -2.0, 0.1])
        assert law.support(w) == max(float(w @ row) for row in np.array(MEASURED))
    else:
        turns = np.linspace(0, 1, 40001)
        variates = np.array([np.full_like(turns, 1 - 2.0**-53), turns])
        for w in ([1.0, 0.0], [-3.0, 4.0], [0.0, 0.0], [1e-5, -1.0]):
            across = [*w, 0.7 * math.hypot(*w)][: law.size]
            # a sphere at the height at which a direction meets it
            shares = np.full(turns.size, 0.5 + 0.5 * across[-1] / (math.hypot(*across) or 1.0))
            points = law.sample(np.array([*variates, shares])[: law.size])
            assert law.support(across) == pytest.approx(float((np.array(across) @ points).max()), rel=1e-8, abs=1e-18)


def test_a_lognormal_setting_is_positive_though_its_support_begins_at_zero() -> None:
    view = LabelledSpace(Space((Draw("k", Lognormal(0.2, 1.0)), Draw("two", TwoPoint(1.0)))), "beam[link]")
    view.positive("EI", "k")
    with pytest.raises(InputError, match=r"as low as -1 SI\); no mean is given"):
        view.positive("EI", "two")


def test_bends_are_where_the_inverse_jumps_or_bends() -> None:
    bent = (TwoPoint(1.0, 0.0, 0.25), Triangular(1.0), Empirical(QUANTILES))
    assert [law.breaks for law in bent] == [(0.75,), (0.5,), (0.2, 0.7, 0.9)]
    smooth = (Uniform(1.0), Normal(1.0), TruncatedNormal(1.0), Lognormal(1.0, 1.0), Arcsine(1.0))
    assert [law.breaks for law in smooth] == [()] * 5


def test_at_scores_is_the_inverse_at_phi() -> None:
    z = np.linspace(-6, 6, 241)[None]
    for law in (Uniform(1.0), Triangular(2.0), TruncatedNormal(1.0, 0.3), Arcsine(1.0), Empirical(SLOPES)):
        np.testing.assert_allclose(law.at_scores(z), law.inverse(stats.norm.cdf(z)), rtol=0, atol=1e-10)
    np.testing.assert_array_equal(Normal(0.5, 2.0).at_scores(z), 2.0 + 0.5 * z)
    expected = np.log(SPREAD) + z * math.log(2) ** 0.5
    np.testing.assert_allclose(np.log(Lognormal(3.0, 3.0).at_scores(z)), expected)
    # far out, where Φ rounds to one, no law leaves its support
    far = np.array([[-8.6, 8.6]])
    for law in (Uniform(1.0), Triangular(1.0), TruncatedNormal(1.0, 0.0, 9.0), Arcsine(1.0), TwoPoint(1.0)):
        low, high = law.interval(0)
        assert low <= law.at_scores(far)[0, 0] < law.at_scores(far)[0, 1] <= high
    z = np.linspace(-8.6, 8.6, 1721)
    np.testing.assert_allclose(cumulative(z), stats.norm.cdf(z), rtol=4e-15)
    np.testing.assert_allclose(1 - cumulative(z), stats.norm.sf(z), rtol=0, atol=2e-16)


# ---- laws of the plane, joint normal ----


@pytest.mark.parametrize("law", [Disc(0.3), Circle(0.3)])
def test_plane_law_moments_and_characteristic_function(law: Law) -> None:
    # Gauss in the radius, equal steps in the angle; both exact to rounding for smooth functions
    is_disc = isinstance(law, Disc)
    rho, weights = (0.15 * (1 + NODES), WEIGHTS / 2 * (1 + NODES)) if is_disc else (np.array([0.3]), np.ones(1))
    x, y = (np.outer(rho, turn(2 * np.pi * np.arange(256) / 256)) for turn in (np.cos, np.sin))
    np.testing.assert_array_equal(law.mean_vector, [0, 0])
    assert law.components == (".x", ".y")
    square = weights @ (x * x).mean(axis=1)
    np.testing.assert_allclose(law.covariance, square * np.eye(2), rtol=0, atol=1e-15)
    for t in ([0.0, 0.0], [1.0, 0.0], [-3.0, 7.0], [20.0, 60.0], [1e-10, 1e-10]):
        wave = weights @ np.exp(1j * (t[0] * x + t[1] * y)).mean(axis=1)
        assert complex(law.characteristic(t)) == pytest.approx(complex(wave), abs=1e-13)
    u = np.random.default_rng(4).uniform(size=(2, 1000))
    quarters = np.rint(4 * u[1]).astype(int)  # taken off first: 2πu rounds by more than what is asked here
    spin = np.array([1, 1j, -1, -1j])[quarters % 4] * np.exp(2j * np.pi * (u[1] - quarters / 4))
    known = 0.3 * (np.sqrt(u[0]) if is_disc else 1.0) * spin
    np.testing.assert_allclose(law.sample(u), [known.real, known.imag], rtol=0, atol=1e-16)


MATRIX = ((4.0, 1.2, -0.5), (1.2, 1.0, 0.1), (-0.5, 0.1, 0.25))


def test_joint_normal_root_sample_and_characteristic_function() -> None:
    law = JointNormal(MATRIX, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(law.root, np.linalg.cholesky(np.array(MATRIX)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(law.sample(np.eye(3)).T - [1.0, 2.0, 3.0], law.root.T, rtol=0, atol=1e-15)
    np.testing.assert_array_equal([law.mean_vector, *law.covariance], [[1, 2, 3], *MATRIX])
    assert law.components == (".0", ".1", ".2")
    t = np.array([0.3, -0.7, 1.1])
    known = np.exp(1j * t @ [1.0, 2.0, 3.0] - t @ np.array(MATRIX) @ t / 2)
    assert complex(law.characteristic(t)) == pytest.approx(complex(known), abs=1e-14)


def test_joint_normal_may_be_degenerate() -> None:
    for factor in ([[1.0], [2.0], [-3.0]], [[0.0], [1.0], [2.0]], [[1.0, 0.2], [0.3, 1.0], [0.5, 0.7]]):
        c = np.array(factor)
        matrix = c @ c.T
        law = JointNormal(tuple(map(tuple, matrix.tolist())), (1, 2, 3))
        np.testing.assert_allclose(law.root @ law.root.T, matrix, rtol=0, atol=1e-14)
        assert law.support(np.zeros(3)) == 0
    normal = np.cross(c[:, 0], c[:, 1])
    assert law.support(normal) == pytest.approx(normal @ [1, 2, 3], abs=1e-14)
    assert law.support(normal + np.array([1e-6, 0, 0])) == math.inf


# ---- what is refused, what is a constant ----

ROUND: list[Callable[[float], Law]] = [Disc, Circle, Sphere]
SIZES: list[Callable[[float], Law]] = [Uniform, Triangular, Normal, TruncatedNormal, *ROUND, Arcsine, TwoPoint]
WRONG: list[tuple[Callable[[], Law], str]] = [
    *((lambda kind=kind, size=size: kind(size), " of a") for kind in SIZES for size in (-1e-300, math.nan, math.inf)),
    *((lambda kind=kind: kind(1.0, math.nan), " of a") for kind in SIZES if kind not in ROUND),
    (lambda: Fixed(math.inf), "finite"),
    *((lambda k=k: TruncatedNormal(1.0, 0.0, k), "k of a truncated normal") for k in (0.0, -3.0, 1e-9, math.inf)),
    *((lambda k=k: Normal.from_half_width(0.3, k=k), "k") for k in (0.0, -1.0, math.nan, math.inf)),
    (lambda: Lognormal(-1.0, 1.0), "standard deviation of a lognormal"),
    (lambda: Lognormal(1.0, 0.0), "mean of a lognormal law must be positive"),
    (lambda: Lognormal(1.0, math.inf), "mean of a lognormal law must be positive"),
    (lambda: Lognormal(1001.0, 1.0), "at most 1000 times its mean"),
    *((lambda p=p: TwoPoint(1.0, 0.0, p), "probability of a two-point") for p in (0.0, 1.0, math.nan)),
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
    (lambda: JointNormal(()), "square"),
    (lambda: JointNormal(((1.0, 0.0), (0.0,))), "square"),
    (lambda: JointNormal(((1.0, 0.5), (0.4, 1.0))), "symmetric"),
    (lambda: JointNormal(((1.0, 1.1), (1.1, 1.0))), "above 1"),
    # a covariance of tiny numbers is judged by its correlation
    (lambda: JointNormal(((1e-20, 2e-20), (2e-20, 1e-20))), "above 1"),
    (lambda: JointNormal(((-1.0, 0.0), (0.0, 1.0))), "negative"),
    (lambda: JointNormal(((0.0, 1e-12), (1e-12, 1e-12))), "above 1"),
    (lambda: JointNormal(((1.0, 0.9, -0.9), (0.9, 1.0, 0.9), (-0.9, 0.9, 1.0))), "negative eigenvalue"),
    (lambda: JointNormal(((1.0, math.nan), (math.nan, 1.0))), "finite"),
    (lambda: JointNormal(((1.0, 0.0), (0.0, 1.0)), (1.0,)), "mean"),
]


def test_bad_laws_are_refused() -> None:
    for make, reason in WRONG:
        with pytest.raises(InputError, match=reason):
            make()
    JointNormal(((1e-20, 0.5e-20), (0.5e-20, 1e-20)))
    assert Normal.from_half_width(0.3, 1.0) == Normal(0.3 / 3, 1.0)
    assert Normal.from_half_width(0.3, k=2) == Normal(0.15)


CONSTANT = [Fixed(1.5), Lognormal(0.0, 1.5), Empirical.from_samples([1.5, 1.5])]
CONSTANT += [kind(0.0, 1.5) for kind in (Uniform, Triangular, Normal, TruncatedNormal, Arcsine, TwoPoint)]  # type: ignore[call-arg]


@pytest.mark.parametrize("law", CONSTANT, ids=repr)
def test_no_spread_is_a_constant(law: Law) -> None:
    np.testing.assert_array_equal(law.inverse(grid()[None]), np.full((1, grid().size), 1.5))
    assert (law.mean_vector[0], law.covariance[0, 0], law.support([2.0]), law.interval(0)) == (1.5, 0, 3.0, (1.5, 1.5))
    assert complex(law.characteristic([2.0])) == pytest.approx(np.exp(3j), abs=1e-15)


def test_radius_zero_is_the_origin() -> None:
    for law in (kind(0.0) for kind in ROUND):
        np.testing.assert_array_equal(law.sample(np.array([[0.3], [0.4], [0.6]])[: law.size]), np.zeros((law.size, 1)))
        assert complex(law.characteristic([5.0, 1.0, 2.0][: law.size])) == 1


CONSTANT += [kind(0.0, 1.5) for kind in (Uniform, Triangular, Normal, TruncatedNormal, Arcsine, TwoPoint)]  # type: ignore[call-arg]
