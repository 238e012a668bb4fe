"""The Gaussian copula: what correlation of the numbers follows, what is drawn, what is refused."""

import itertools
import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy import integrate, special, stats

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.correlation import LEAST_EIGENVALUE, Correlation, covariance_of
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import (
    Arcsine,
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
from precision_pin.draws.space import Space
from support.sampling_checks import ALPHA, Sampler, exact_failures, sampling_failures

SLOPES = ((0.0, -1.0), (0.3, -0.2), (0.6, 0.0), (0.9, 0.3), (1.0, 2.0))
GAP = ((0.0, -1.0), (0.2, -0.5), (0.2, 0.1), (0.7, 0.1), (1.0, 2.5))

LAWS: list[Law] = [
    Uniform(0.5, 2.0),
    Triangular(0.5, -1.0),
    Normal(0.5, 3.0),
    TruncatedNormal(0.5, 1.0, 2.0),
    TruncatedNormal(0.5, 1.0, 9.0),
    Lognormal(0.3, 1.0),
    Lognormal(3.0, 1.0),
    Arcsine(0.7, 0.1),
    TwoPoint(0.5, 1.0),
    TwoPoint(0.5, 1.0, 0.1),
    Empirical(SLOPES),
    Empirical(GAP),
]
RHO = [-0.95, -0.3, 0.1, 0.6, 0.999]


def std(law: Law) -> float:
    return math.sqrt(law.covariance[0, 0])


def value(law: Law, z: Array) -> Array:
    """Return the law at normal scores, less its mean."""
    u = np.where(z < 0, special.ndtr(z), 1 - special.ndtr(-z))
    return (law.sample(z[None]) if law.variates == "normal" else law.sample(u[None]))[0] - law.mean_vector[0]


def integral(law: Law, weight: Callable[[Array], Array], *bends: float) -> float:
    """E (x - mean) weight(z), Gauss's rule on panels that close in on the given places and on the law's own."""
    nodes, weights = np.polynomial.legendre.leggauss(30)
    near = [*bends, *special.ndtri(np.array(law.breaks))]
    closing = [place + side * 0.5**k for place in near for side in (-1, 1) for k in range(30)]
    edges = np.unique([*np.linspace(-9, 14, 47), *near, *closing])
    edges = edges[(edges >= -9) & (edges <= 14)]
    total = 0.0
    for a, b in itertools.pairwise(edges):
        z = (a + b) / 2 + (b - a) / 2 * nodes
        total += (b - a) / 2 * float(weights @ (value(law, z) * weight(z) * stats.norm.pdf(z)))
    return total


# ---- the correlation that follows ----


@pytest.mark.fast(3)
@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.parametrize(
    "rho", [-0.3, 0.999, *(pytest.param(rho, marks=pytest.mark.slow) for rho in (-0.95, 0.1, 0.6))]
)
def test_with_a_normal_a_uniform_or_two_points_the_inner_integral_is_closed(law: Law, rho: float) -> None:
    rest = math.sqrt(1 - rho**2)
    wide = math.sqrt(2 - rho**2)
    cases: list[tuple[Law, Callable[[Array], Array]]] = [
        (Normal(2.0, 1.0), lambda z: 2.0 * rho * z),
        (Uniform(2.0, 1.0), lambda z: 2.0 * (2 * special.ndtr(rho * z / wide) - 1)),
        (TwoPoint(2.0), lambda z: 2.0 * (2 * special.ndtr(rho * z / rest) - 1)),
        (TwoPoint(2.0, 5.0, 0.3), lambda z: 4.0 * (special.ndtr((rho * z - special.ndtri(0.7)) / rest) - 0.3)),
    ]
    for other, inner in cases:
        place = special.ndtri(0.7) / rho if isinstance(other, TwoPoint) and other.centre else 0.0
        expected = integral(law, inner, place)
        for pair in ((law, other), (other, law)):
            assert abs(covariance_of(*pair, rho) - expected) < 1e-9 * std(law) * std(other), pair


@pytest.mark.parametrize("rho", RHO)
def test_closed_forms(rho: float) -> None:
    assert covariance_of(Normal(2.0), Normal(3.0, 1.0), rho) == pytest.approx(6 * rho, rel=1e-15)
    # Pearson, 1907
    assert covariance_of(Uniform(1.0), Uniform(2.0, 5.0), rho) * 3 / 2 == pytest.approx(
        6 / math.pi * math.asin(rho / 2), rel=1e-15
    )
    # Sheppard (1899): the chance of equal signs
    assert covariance_of(TwoPoint(1.0), TwoPoint(2.0, 5.0), rho) / 2 == pytest.approx(
        2 / math.pi * math.asin(rho), rel=1e-13
    )
    s, t = (math.sqrt(math.log(1 + spread**2)) for spread in (0.3, 3.0))
    expected = math.exp(rho * s * t) - 1
    assert covariance_of(Lognormal(0.3, 1.0), Lognormal(6.0, 2.0), rho) == pytest.approx(2 * expected, rel=1e-12)
    # a sine of a normal number's Φ, against a normal number: E cos(π(Φ - 1/2)) π φ
    arcsine = integrate.quad(
        lambda z: math.pi * math.cos(math.pi * (stats.norm.cdf(z) - 0.5)) * stats.norm.pdf(z) ** 2, -9, 9
    )[0]
    assert covariance_of(Arcsine(1.0), Normal(1.0), rho) == pytest.approx(rho * arcsine, rel=1e-10)


def hermite(law: Law, count: int) -> Array:
    """E (x - mean) He_k(z)/√k! for k = 0 … count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    edges = np.unique([*np.linspace(-13, 13, 261), *special.ndtri(np.array(law.breaks))])
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    z = (middle[:, None] + half[:, None] * nodes).ravel()
    weighted = (half[:, None] * weights).ravel() * value(law, z) * np.exp(-(z**2) / 4) / (2 * math.pi) ** 0.25
    # with the root of the density in them the polynomials stay below one
    before, now = np.zeros_like(z), np.exp(-(z**2) / 4) / (2 * math.pi) ** 0.25
    result = []
    for k in range(count):
        result.append(float(weighted @ now))
        before, now = now, (z * now - math.sqrt(k) * before) / math.sqrt(k + 1)
    return np.array(result)


SMOOTH = [law for law in LAWS if not isinstance(law, Lognormal)]
PAIRS = list(itertools.combinations_with_replacement(SMOOTH, 2))


@pytest.mark.fast(25)
@pytest.mark.parametrize(("first", "second"), PAIRS, ids=repr)
def test_every_pair_against_mehler_s_series(first: Law, second: Law) -> None:
    powers = np.arange(400)
    for rho in (-0.9, 0.3, 0.9):
        expected = float((hermite_of(first) * hermite_of(second) * rho**powers).sum())
        assert abs(covariance_of(first, second, rho) - expected) < 1e-10 * std(first) * std(second)


@cache
def hermite_of(law: Law) -> Array:
    return hermite(law, 400)


@pytest.mark.slow
def test_two_pairs_by_scipy_s_double_integral() -> None:
    for first, second, rho in ((Triangular(1.0), Arcsine(1.0), 0.5), (TruncatedNormal(1.0), Triangular(1.0), -0.8)):
        rest = math.sqrt(1 - rho**2)

        def integrand(
            n: float, z: float, a: Law = first, b: Law = second, rho: float = rho, rest: float = rest
        ) -> float:
            other = np.array([rho * z + rest * n])
            density = math.exp(-(z * z + n * n) / 2) / (2 * math.pi)
            return float(value(a, np.array([z]))[0] * value(b, other)[0]) * density

        expected = integrate.dblquad(integrand, -6, 6, -6, 6, epsabs=3e-7)[0]
        assert covariance_of(first, second, rho) == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_the_correlation_rises_with_that_of_the_scores_from_bound_to_bound(law: Law) -> None:
    """From the countermonotone to the comonotone pair (Hoeffding, 1940), which is the variance."""
    steps = [-1 + 2e-6, -0.99, -0.5, 0.0, 0.5, 0.99, 1 - 2e-6]
    seen = [covariance_of(law, law, rho) for rho in steps]
    variance = law.covariance[0, 0]
    # of a rare value -0.99 is the countermonotone pair already, to rounding
    assert (np.diff(seen) > -1e-12 * variance).all()
    assert (np.diff(seen[1:]) > 0).all()
    assert covariance_of(law, law, 0.0) == 0.0
    assert seen[-1] == pytest.approx(variance, rel=2e-2)  # jumps: as √(1 - ρ)
    assert seen[-1] < variance
    lowest = integral(law, lambda z: value(law, -z))
    assert seen[0] == pytest.approx(lowest, abs=2e-2 * variance)


def test_pearson_is_never_above_the_scores_correlation() -> None:
    """Among all pairs of laws the normal ones are correlated most (Lancaster, 1957)."""
    for first, second in itertools.combinations(LAWS, 2):
        assert abs(covariance_of(first, second, 0.7)) < 0.7 * std(first) * std(second) * (1 + 1e-12)


def test_many_samples_take_no_longer_than_a_second_or_two() -> None:
    rng = np.random.default_rng(5)
    many = Empirical.from_samples(rng.uniform(-1, 1, 3000))
    # nearly uniform: within three standard errors of the quantiles
    seen = covariance_of(many, Uniform(1.0), 0.6) / (std(many) * std(Uniform(1.0)))
    assert seen == pytest.approx(6 / math.pi * math.asin(0.3), abs=0.01)


# ---- the matrix ----


def test_root_and_mix_are_the_cholesky_root_in_alphabetical_order() -> None:
    matrix = ((1.0, 0.5, -0.2), (0.5, 1.0, 0.3), (-0.2, 0.3, 1.0))
    correlation = Correlation(("c", "a", "b"), matrix)
    assert correlation.order == (1, 2, 0)
    sorted_matrix = np.array([[1, 0.3, 0.5], [0.3, 1, -0.2], [0.5, -0.2, 1]])
    np.testing.assert_allclose(correlation.root, np.linalg.cholesky(sorted_matrix), rtol=0, atol=1e-15)
    mixed = correlation.mix(np.eye(3))
    np.testing.assert_allclose(mixed @ mixed.T, matrix, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(mixed[1], [0, 1, 0])
    # the sum of far numbers is no farther out than one of them can be
    far = correlation.mix(np.array([[8.5], [8.5], [-8.5]]))[:, 0]
    np.testing.assert_allclose(far, [8.6, 8.5, 8.5 * (0.3 - math.sqrt(0.91))], rtol=1e-15)


@pytest.mark.parametrize(
    ("names", "matrix", "reason"),
    [
        (("a",), [[1]], "at least two"),
        ((), [], "at least two"),
        (("a", "a"), [[1, 0.5], [0.5, 1]], "names 'a' twice"),
        (("a", "b"), [[1, 0.5]], r"matrix of a, b has 1 rows of 2 numbers, expected 2 of 2"),
        (("a", "b"), [[1, 0.5], [0.5]], r"has 2 rows of 1 and 2 numbers"),
        (("a", "b", "c"), [[1, 0.5], [0.5, 1]], "expected 3 of 3"),
        (("a", "b"), [[1, 0.5], [0.4, 1]], "correlation of 'a' and 'b' is 0.5 in one place and 0.4 in the other"),
        (("a", "b"), [[1, math.nan], [math.nan, 1]], "correlation matrix must be rows of finite numbers"),
        (("a", "b"), [[1, 0.5], [0.5, 2]], "correlation of 'b' with itself is 2; it must be 1"),
        (("a", "b"), [[1, 1.2], [1.2, 1]], "correlation of 'a' and 'b' is 1.2; it must lie between -1 and 1"),
        (("a", "b"), [[1, -1], [-1, 1]], "one parameter"),
        (
            ("a", "b", "c"),
            [[1, 0.9, 0], [0.9, 1, -0.5], [0, -0.5, 1]],
            # c alone leaves ±√(1 - 0.25) to a and b
            r"eigenvalue -0.0296.*: the 0.9 of 'a' and 'b' contradicts the others, which allow -0.866 to 0.866$",
        ),
        (
            ("a", "b", "c", "d"),
            [[1, 0.1, 0.9, 0.9], [0.1, 1, 0.1, 0.1], [0.9, 0.1, 1, -0.6], [0.9, 0.1, -0.6, 1]],
            "the 0.9 of 'a' and 'c' contradicts the others",
        ),
        (("a", "b"), [[1, 1 - 1e-7], [1 - 1e-7, 1]], "smallest eigenvalue 1e-07, at least 1e-06"),
    ],
)
def test_a_matrix_that_cannot_be_is_refused(names: tuple[str, ...], matrix: list[list[float]], reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        Correlation(names, tuple(map(tuple, matrix)))
    assert "\n" not in str(caught.value)


def test_one_wrong_entry_in_a_large_matrix_is_the_pair_that_is_named() -> None:
    rng = np.random.default_rng(8)
    factors = rng.normal(size=(6, 2))
    matrix = factors @ factors.T + np.diag(0.05 * np.ones(6))
    scale = np.sqrt(np.diag(matrix))
    matrix = matrix / np.outer(scale, scale)
    names = tuple("abcdef")
    np.fill_diagonal(matrix, 1.0)
    matrix = (matrix + matrix.T) / 2
    Correlation(names, tuple(map(tuple, matrix.tolist())))
    pairs = [(i, j) for i, j in itertools.combinations(range(6), 2) if abs(matrix[i, j]) > 0.7]
    assert len(pairs) > 3
    for i, j in pairs:
        wrong = matrix.copy()
        wrong[i, j] = wrong[j, i] = -matrix[i, j]  # a slipped sign
        with pytest.raises(InputError, match=f"of '{names[i]}' and '{names[j]}' contradicts the others, which"):
            Correlation(names, tuple(map(tuple, wrong.tolist())))


def test_where_no_single_entry_is_to_blame_the_one_that_pulls_most_is_named() -> None:
    matrix = np.full((5, 5), -0.5) + 1.5 * np.eye(5)
    matrix[1, 3] = matrix[3, 1] = -0.6
    with pytest.raises(InputError, match=r"the -0\.6 of 'b' and 'd' contradicts the others most"):
        Correlation(tuple("abcde"), tuple(map(tuple, matrix.tolist())))


def test_the_range_that_the_others_leave_is_where_the_determinant_changes_sign() -> None:
    others = [[1, 0.2, 0.9, 0.3], [0.2, 1, 0.1, -0.5], [0.9, 0.1, 1, 0.0], [0.3, -0.5, 0.0, 1]]
    ends = np.roots(np.polyfit([-1, 0, 1], [np.linalg.det(entry(2, 3, x)(np.array(others))) for x in (-1, 0, 1)], 2))
    low, high = sorted(ends)
    for x in (low - 1e-6, high + 1e-6):
        with pytest.raises(InputError, match="not positive definite"):
            Correlation(tuple("abcd"), tuple(map(tuple, entry(2, 3, x)(np.array(others)).tolist())))
    with pytest.raises(
        InputError, match=f"the 0.95 of 'c' and 'd' contradicts the others, which allow {low:.3g} to {high:.3g}"
    ):
        Correlation(tuple("abcd"), tuple(map(tuple, entry(2, 3, 0.95)(np.array(others)).tolist())))


def test_the_least_eigenvalue_is_the_limit() -> None:
    Correlation.pair("a", "b", 1 - 1.01 * LEAST_EIGENVALUE)
    with pytest.raises(InputError, match="positive definite"):
        Correlation.pair("a", "b", 1 - 0.99 * LEAST_EIGENVALUE)


# ---- spaces ----

MATRIX = ((1.0, 0.5, -0.3, 0.2), (0.5, 1.0, 0.1, 0.7), (-0.3, 0.1, 1.0, -0.2), (0.2, 0.7, -0.2, 1.0))
COPULA = Space(
    (
        Draw("u", Uniform(0.5, 2.0)),
        Draw("alone", Normal(1.0)),
        Draw("n", Normal(0.4, -1.0)),
        Draw("disc", Disc(1.0)),
        Draw("t", Triangular(1.0)),
        Draw("l", Lognormal(0.2, 1.0)),
        Draw("cut", TruncatedNormal(1.0, 0.0, 2.5), Scope.VISIT),
        Draw("arc", Arcsine(0.7), Scope.VISIT),
        Draw("side", TwoPoint(0.5, 0.0, 0.3), Scope.POSE),
        Draw("seen", Empirical(SLOPES), Scope.POSE),
    ),
    (
        Correlation(("u", "n", "t", "l"), MATRIX),
        Correlation.pair("cut", "arc", -0.8),
        Correlation.pair("seen", "side", 0.6),
    ),
)


def test_the_covariance_of_a_space_holds_what_follows() -> None:
    index, covariance, pearson = COPULA.index, COPULA.covariance, COPULA.pearson
    assert covariance[index["u"], index["n"]] == covariance_of(Uniform(0.5, 2.0), Normal(0.4, -1.0), 0.5)
    assert covariance[index["l"], index["n"]] == covariance_of(Normal(0.4), Lognormal(0.2, 1.0), 0.7)
    assert covariance[index["alone"], index["n"]] == 0
    np.testing.assert_array_equal(covariance, covariance.T)
    np.testing.assert_allclose(
        np.diag(covariance), [1 / 12, 1, 0.16, 0.25, 0.25, 1 / 6, 0.04, *np.diag(covariance)[7:]]
    )
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(pearson, covariance / np.outer(scale, scale), rtol=0, atol=1e-15)
    assert (np.diag(pearson) == 1).all()
    assert np.linalg.eigvalsh(pearson).min() > 0
    # a normal number and a uniform one: ρ √(3/π)
    assert pearson[index["u"], index["n"]] == pytest.approx(0.5 * math.sqrt(3 / math.pi), rel=1e-12)


def test_what_does_not_vary_is_not_correlated() -> None:
    space = Space((Draw("a", Uniform(0.0)), Draw("b", Normal(1.0))), (Correlation.pair("a", "b", 0.5),))
    np.testing.assert_array_equal(space.pearson, np.eye(2))
    np.testing.assert_array_equal(space.sample(1, 0, 5)[0], np.zeros(5))


def test_identity_gives_normal_laws_the_numbers_they_have_alone() -> None:
    draws = (Draw("a", Normal(2.0, 1.0)), Draw("b", Lognormal(0.3, 1.0)), Draw("c", Normal(1.0)))
    identity = tuple(map(tuple, np.eye(3).tolist()))
    mixed = Space(draws, (Correlation(("c", "a", "b"), identity),))
    np.testing.assert_array_equal(mixed.sample(3, 5, 1000), Space(draws).sample(3, 5, 1000))
    u = np.random.default_rng(3).uniform(size=(3, 500))
    np.testing.assert_array_equal(mixed.inverse(u), Space(draws).inverse(u))


def test_the_first_in_the_alphabet_keeps_its_numbers() -> None:
    draws = (Draw("b", Normal(1.0)), Draw("a", Normal(1.0)))
    mixed, plain = Space(draws, (Correlation.pair("b", "a", 0.6),)).sample(1, 0, 100), Space(draws).sample(1, 0, 100)
    np.testing.assert_array_equal(mixed[1], plain[1])
    np.testing.assert_allclose(mixed[0], 0.6 * plain[1] + 0.8 * plain[0], rtol=0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2**64 - 1])
@pytest.mark.parametrize("first", [0, 7])
def test_copula_against_plain_python(seed: int, first: int) -> None:
    assert exact_failures(COPULA.sample, COPULA, seed=seed, units=range(first, first + 12)) == []


@pytest.mark.parametrize(("first", "count"), [(0, 1), (1, 1), (1, 2), (2, 5), (3, 4), (17, 83), (99, 1), (50, 0)])
def test_any_slice_replays_the_same_bits(first: int, count: int) -> None:
    whole = COPULA.sample(5, 0, 100)
    np.testing.assert_array_equal(COPULA.sample(5, first, count), whole[:, first : first + count])


def test_adding_and_reordering_draws_and_groups_changes_no_other_draw() -> None:
    sampled = COPULA.sample(11, 3, 40)
    turned = Correlation(("t", "u", "l", "n"), tuple(tuple(MATRIX[i][j] for j in (2, 0, 3, 1)) for i in (2, 0, 3, 1)))
    new = (Draw("new", Uniform(1.0)), Draw("aa", Normal(1.0)))
    others = [
        Space(COPULA.draws[::-1], COPULA.correlations),
        Space(COPULA.draws, COPULA.correlations[::-1]),
        Space(COPULA.draws, (turned, *COPULA.correlations[1:])),
        Space((*new, *COPULA.draws[4:], *COPULA.draws[:4]), (Correlation.pair("new", "aa", 0.9), *COPULA.correlations)),
    ]
    for other in others:
        again = other.sample(11, 3, 40)
        for name in COPULA.components:
            np.testing.assert_array_equal(again[other.index[name]], sampled[COPULA.index[name]], err_msg=name)
    fewer = Space(COPULA.draws, COPULA.correlations[1:]).sample(11, 3, 40)
    changed = [name for k, name in enumerate(COPULA.components) if (fewer[k] != sampled[k]).any()]
    assert changed == ["u", "n", "t"]  # "l" is first in the alphabet


def test_scopes_of_correlated_draws() -> None:
    home, visit, pose = (COPULA.sample(1, 0, 50, pose=p, visit=v) for p, v in ((0, 0), (0, 1), (1, 0)))
    for k, name in enumerate(COPULA.components):
        changes = ((visit[k] != home[k]).any(), (pose[k] != home[k]).any())
        expected = {"cut": (True, True), "arc": (True, True), "side": (False, True), "seen": (False, True)}
        assert changes == expected.get(name, (False, False)), name


def test_inverse_goes_through_normal_scores() -> None:
    u = np.random.default_rng(6).uniform(size=(COPULA.size, 50))
    x = COPULA.inverse(u)
    index = COPULA.index
    names = ("l", "n", "t", "u")
    places = [("u", "n", "t", "l").index(name) for name in names]
    root = np.linalg.cholesky(np.array(MATRIX)[np.ix_(places, places)])
    z = dict(zip(names, root @ stats.norm.ppf(u[[index[name] for name in names]]), strict=True))
    np.testing.assert_allclose(x[index["n"]], -1 + 0.4 * z["n"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(x[index["u"]], 1.5 + stats.norm.cdf(z["u"]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(x[index["t"]], stats.triang(0.5, -1, 2).ppf(stats.norm.cdf(z["t"])), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(x[index["alone"]], Space((COPULA.draws[1],)).inverse(u[1:2])[0])


DRAWS = (
    Draw("a", Uniform(1.0)),
    Draw("b", Normal(1.0)),
    Draw("p", Disc(1.0)),
    Draw("j", JointNormal(((1.0, 0.0), (0.0, 1.0)))),
    Draw("r", Rows(((1.0,), (2.0,)), ("x",))),
    Draw("f", Fixed(1.0)),
    Draw("v", Normal(1.0), Scope.VISIT),
    Draw("w", Normal(1.0)),
)


@pytest.mark.parametrize(
    ("pairs", "reason"),
    [
        ([("a", "p")], "'p' draws 2 numbers"),
        ([("j", "a")], "'j' draws 2 numbers"),
        ([("p.x", "a")], "'p.x' is one of the several numbers of 'p'"),
        ([("a", "f")], "'f' is fixed"),
        ([("a", "v")], "'a' is drawn for each unit, 'v' for each visit"),
        ([("a", "b"), ("b", "w")], "'b' is in two correlations"),
        ([("a", "wb")], "no parameter named 'wb'"),
    ],
)
def test_a_correlation_of_what_cannot_be_correlated_is_refused(pairs: list[tuple[str, str]], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        Space(DRAWS, tuple(Correlation.pair(*pair, 0.5) for pair in pairs))


def test_an_unknown_name_is_told_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match="valid: a, b, f, v, w"):
        Space((*DRAWS[:4], *DRAWS[5:]), (Correlation.pair("a", "qqq", 0.5),))


@pytest.mark.parametrize("law", [Rows(((1.0,), (2.0,))), JointNormal(((4.0,),))], ids=["rows", "joint_normal"])
def test_a_law_of_several_numbers_is_not_correlated_even_if_it_has_one(law: Law) -> None:
    """Its number has a name of its own, ``a.0``."""
    correlation = Correlation(("a", "b"), ((1.0, 0.5), (0.5, 1.0)))
    with pytest.raises(
        InputError, match=r"the law of 'a' is made for several numbers, though it has one here \('a.0'\)"
    ):
        Space((Draw("a", law), Draw("b", Normal(1.0))), (correlation,))


def test_including_keeps_the_correlations() -> None:
    assert COPULA.including([Draw("new", Uniform(1.0))]).correlations == COPULA.correlations


# ---- sampling, at an error probability of 1e-6 for each check ----


def scores(space: Space, x: Array, names: tuple[str, ...]) -> Array:
    """Return normal scores of samples, by scipy's distribution functions."""
    frozen = {
        "u": stats.uniform(1.5, 1.0),
        "n": stats.norm(-1.0, 0.4),
        "t": stats.triang(0.5, -1, 2),
        "l": stats.lognorm(math.sqrt(math.log(1.04)), scale=1 / math.sqrt(1.04)),
        "cut": stats.truncnorm(-2.5, 2.5),
        "arc": stats.arcsine(-0.7, 1.4),
    }
    return np.array([stats.norm.ppf(frozen[name].cdf(x[space.index[name]])) for name in names])


def fisher_failures(z: Array, matrix: Array) -> list[str]:
    """Pairs whose correlation is not the matrix's, by Fisher's transformation."""
    limit = stats.norm.isf(ALPHA / 2)
    seen = np.corrcoef(z)
    count = z.shape[1]
    return [
        f"{i}, {j}: {seen[i, j]:.4f}, expected {matrix[i, j]:.4f}"
        for i, j in itertools.combinations(range(len(z)), 2)
        if abs(np.arctanh(seen[i, j]) - np.arctanh(matrix[i, j])) * math.sqrt(count - 3) > limit
    ]


@cache
def kept(seed: int, first: int, count: int) -> Array:
    x = COPULA.sample(seed, first, count)
    x.flags.writeable = False
    return x


@pytest.mark.slow
def test_the_normal_scores_match_the_matrix_asked_for() -> None:
    x = kept(20150713, 0, 1_000_000)
    assert fisher_failures(scores(COPULA, x, ("u", "n", "t", "l")), np.array(MATRIX)) == []
    assert fisher_failures(scores(COPULA, x, ("cut", "arc")), np.array([[1, -0.8], [-0.8, 1]])) == []
    # jointly normal, not only in pairs: Mahalanobis distances
    z = scores(COPULA, x, ("u", "n", "t", "l"))
    squares = (z * np.linalg.solve(np.array(MATRIX), z)).sum(axis=0)
    assert stats.kstest(squares, stats.chi2(4).cdf).pvalue > ALPHA


@pytest.mark.slow
def test_the_reported_pearson_matrix_matches_the_samples() -> None:
    """Each pair by the standard error that the samples' own fourth moments give (the delta method)."""
    x = kept(20150713, 0, 1_000_000)
    deviation = (x - COPULA.mean[:, None]) / np.sqrt(np.diag(COPULA.covariance))[:, None]
    limit = stats.norm.isf(ALPHA / 2)
    for i, j in itertools.combinations(range(COPULA.size), 2):
        r = COPULA.pearson[i, j]
        influence = deviation[i] * deviation[j] - r * (deviation[i] ** 2 + deviation[j] ** 2) / 2
        gap = float(np.corrcoef(deviation[i], deviation[j])[0, 1]) - r
        assert abs(gap) <= limit * float(influence.std()) / 1000, (COPULA.components[i], COPULA.components[j])


@pytest.mark.slow
def test_no_check_finds_fault_with_the_copula_at_1e6_draws() -> None:
    assert sampling_failures(kept, COPULA) == []


OFF = 0.01


def with_matrix(change: Callable[[Array], Array]) -> Sampler:
    """Return a sampler that takes another matrix for the first group."""
    matrix = change(np.array(MATRIX))
    group = Correlation(COPULA.correlations[0].names, tuple(map(tuple, matrix.tolist())))
    return Space(tuple(draw for draw in COPULA.draws if draw.name in group.names), (group,)).sample


def entry(i: int, j: int, value: float) -> Callable[[Array], Array]:
    def change(matrix: Array) -> Array:
        matrix[i, j] = matrix[j, i] = value
        return matrix

    return change


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        entry(0, 1, 0.5 + OFF),
        entry(2, 3, 0.2),
        entry(0, 2, 0.0),
        # the scores' correlation that would give two uniform laws a Pearson correlation of 0.5
        entry(0, 1, 2 * math.sin(math.pi / 12)),
    ],
    ids=["off by 0.01", "sign", "missing", "Pearson"],
)
def test_a_planted_fault_in_the_matrix_is_found(change: Callable[[Array], Array]) -> None:
    x = with_matrix(change)(20150713, 0, 1_000_000)
    alone = Space(tuple(draw for draw in COPULA.draws if draw.name in ("u", "n", "t", "l")))
    assert fisher_failures(scores(alone, x, ("u", "n", "t", "l")), np.array(MATRIX))


@pytest.mark.slow
def test_scores_mixed_by_the_transposed_root_are_found() -> None:
    rng = np.random.default_rng(4)
    n = rng.normal(size=(4, 1_000_000))
    root = np.linalg.cholesky(np.array(MATRIX))
    assert fisher_failures(root @ n, np.array(MATRIX)) == []
    assert fisher_failures(root.T @ n, np.array(MATRIX))
