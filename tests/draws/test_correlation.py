"""The Gaussian copula: what correlation of the numbers follows, what is drawn, what is refused."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from scipy import special

from precision_pin import (
    Arcsine,
    Correlation,
    Disc,
    Draw,
    Empirical,
    Fixed,
    InputError,
    JointNormal,
    Lognormal,
    Normal,
    Rows,
    Scope,
    Space,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.base.arrays import Array
from precision_pin.draws.correlation import LEAST_EIGENVALUE, covariance_of
from precision_pin.draws.laws import Law

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


def std(law: Law) -> float:
    return math.sqrt(law.covariance[0, 0])


def value(law: Law, z: Array) -> Array:
    """Return the law at normal scores, less its mean."""
    u = np.where(z < 0, special.ndtr(z), 1 - special.ndtr(-z))
    return (law.sample(z[None]) if law.variates == "normal" else law.sample(u[None]))[0] - law.mean_vector[0]


# ---- the correlation that follows ----


@pytest.mark.parametrize("rho", [-0.95, -0.3, 0.1, 0.6, 0.999])
def test_closed_forms(rho: float) -> None:
    s, t = (math.sqrt(math.log(1 + spread**2)) for spread in (0.3, 3.0))
    for first, second, expected, off in (
        (Normal(2.0), Normal(3.0, 1.0), 6 * rho, 1e-15),
        # Pearson, 1907
        (Uniform(1.0), Uniform(2.0, 5.0), 2 / 3 * 6 / math.pi * math.asin(rho / 2), 2e-15),
        # Sheppard (1899): the chance of equal signs
        (TwoPoint(1.0), TwoPoint(2.0, 5.0), 2 * 2 / math.pi * math.asin(rho), 1e-13),
        (Lognormal(0.3, 1.0), Lognormal(6.0, 2.0), 2 * (math.exp(rho * s * t) - 1), 1e-12),
        # the mean of a lognormal number beyond a normal score's quantile: its density is shifted by ρ s
        (Lognormal(0.3, 1.0), TwoPoint(2.0, 5.0, 0.3), 4 * (special.ndtr(rho * s - special.ndtri(0.7)) - 0.3), 1e-13),
    ):
        assert covariance_of(first, second, rho) == pytest.approx(expected, rel=off)


@cache
def hermite(law: Law, count: int = 400) -> Array:
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


@pytest.mark.slow
def test_every_pair_against_mehler_s_series() -> None:
    powers = np.arange(400)
    for number, (first, second) in enumerate(itertools.combinations_with_replacement(LAWS, 2)):
        rho = (-0.9, 0.3, 0.9)[number % 3]
        expected = float((hermite(first) * hermite(second) * rho**powers).sum())
        assert abs(covariance_of(first, second, rho) - expected) < 1e-10 * std(first) * std(second), (first, second)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS[6:10:3], ids=repr)
def test_the_correlation_rises_with_that_of_the_scores_from_bound_to_bound(law: Law) -> None:
    """From the countermonotone to the comonotone pair (Hoeffding, 1940), which is the variance."""
    steps = [-1 + 2e-6, -0.99, 0.0, 0.99, 1 - 2e-6]
    seen = [covariance_of(law, law, rho) for rho in steps]
    variance = law.covariance[0, 0]
    # of a rare value -0.99 is the countermonotone pair already, to rounding
    assert (np.diff(seen) > -1e-12 * variance).all()
    assert (np.diff(seen[1:]) > 0).all()
    assert covariance_of(law, law, 0.0) == 0.0
    assert seen[-1] == pytest.approx(variance, rel=2e-2)  # jumps: as √(1 - ρ)
    assert seen[-1] < variance
    u = (np.arange(100_000) + 0.5)[None] / 100_000
    lowest = np.mean(law.inverse(u) * law.inverse(1 - u)) - law.mean_vector[0] ** 2
    assert seen[0] == pytest.approx(lowest, abs=2e-2 * variance)


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


def rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.array(matrix, dtype=float).tolist()))


def entry(matrix: Array, i: int, j: int, value: float) -> tuple[tuple[float, ...], ...]:
    """Return the rows of a matrix with another number for a pair."""
    changed = np.array(matrix, dtype=float)
    changed[i, j] = changed[j, i] = value
    return rows(changed)


def test_a_matrix_that_cannot_be_is_refused() -> None:
    for names, matrix, reason in (
        ("a", [[1]], "at least two"),
        ("aa", [[1, 0.5], [0.5, 1]], "names 'a' twice"),
        ("ab", [[1, 0.5]], r"matrix of a, b has 1 rows of 2 numbers, expected 2 of 2"),
        ("ab", [[1, 0.5], [0.5]], r"has 2 rows of 1 and 2 numbers"),
        ("ab", [[1, 0.5], [0.4, 1]], "correlation of 'a' and 'b' is 0.5 in one place and 0.4 in the other"),
        ("ab", [[1, math.nan], [math.nan, 1]], "correlation matrix must be rows of finite numbers"),
        ("ab", [[1, 0.5], [0.5, 2]], "correlation of 'b' with itself is 2; it must be 1"),
        ("ab", [[1, 1.2], [1.2, 1]], "correlation of 'a' and 'b' is 1.2; it must lie between -1 and 1"),
        ("ab", [[1, -1], [-1, 1]], "one parameter"),
        # c alone leaves ±√(1 - 0.25) to a and b
        (
            "abc",
            [[1, 0.9, 0], [0.9, 1, -0.5], [0, -0.5, 1]],
            r"eigenvalue -0.0296.*: the 0.9 of 'a' and 'b' contradicts the others, which allow -0.866 to 0.866$",
        ),
        ("ab", entry(np.eye(2), 0, 1, 1 - 0.99 * LEAST_EIGENVALUE), "smallest eigenvalue 9.9e-07, at least 1e-06"),
        # where no single entry is to blame the one that pulls most is named
        ("abcde", entry(1.5 * np.eye(5) - 0.5, 1, 3, -0.6), r"the -0\.6 of 'b' and 'd' contradicts the others most"),
    ):
        with pytest.raises(InputError, match=reason) as caught:
            Correlation(tuple(names), tuple(map(tuple, matrix)))
        assert "\n" not in str(caught.value)
    Correlation.pair("a", "b", 1 - 1.01 * LEAST_EIGENVALUE)


def test_the_range_that_the_others_leave_is_where_the_determinant_changes_sign() -> None:
    others = np.array([[1, 0.2, 0.9, 0.3], [0.2, 1, 0.1, -0.5], [0.9, 0.1, 1, 0.0], [0.3, -0.5, 0.0, 1]])
    determinants = [np.linalg.det(np.array(entry(others, 2, 3, x))) for x in (-1, 0, 1)]
    low, high = sorted(np.roots(np.polyfit([-1, 0, 1], determinants, 2)))
    allowed = f"the 0.95 of 'c' and 'd' contradicts the others, which allow {low:.3g} to {high:.3g}"
    for x, reason in ((low - 1e-6, "not positive definite"), (high + 1e-6, "not positive definite"), (0.95, allowed)):
        with pytest.raises(InputError, match=reason):
            Correlation(tuple("abcd"), entry(others, 2, 3, x))


def test_a_correlation_of_what_cannot_be_correlated_is_refused() -> None:
    laws = {"a": Uniform(1.0), "b": Normal(1.0), "p": Disc(1.0), "j": JointNormal(rows(np.eye(2)))}
    laws |= {"r": Rows(((1.0,), (2.0,)), ("x",)), "f": Fixed(1.0), "w": Normal(1.0)}
    draws = (*(Draw(name, law) for name, law in laws.items()), Draw("v", Normal(1.0), Scope.VISIT))
    for pairs, reason in (
        (["ap"], "'p' draws 2 numbers"),
        (["ja"], "'j' draws 2 numbers"),
        ([("p.x", "a")], "'p.x' is one of the several numbers of 'p'"),
        # its number has a name of its own
        (["ar"], r"the law of 'r' is made for several numbers, though it has one here \('r.x'\)"),
        (["af"], "'f' is fixed"),
        (["av"], "'a' is drawn for each unit, 'v' for each visit"),
        (["ab", "bw"], "'b' is in two correlations"),
        ([("a", "qqq")], "no parameter named 'qqq'; valid: a, b, f, v, w"),
    ):
        with pytest.raises(InputError, match=reason):
            Space(draws, tuple(Correlation.pair(*pair, 0.5) for pair in pairs))
