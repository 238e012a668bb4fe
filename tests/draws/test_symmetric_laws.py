"""Uniform, triangular and normal laws, discs, circles and joint normals, against scipy.stats, quadrature and closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import integrate, special, stats

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Circle, Disc, Fixed, JointNormal, Law, Normal, Triangular, TruncatedNormal, Uniform

SCALAR: list[tuple[Law, Any]] = [
    (Uniform(0.25, 1.0), stats.uniform(0.75, 0.5)),
    (Uniform(5e-5), stats.uniform(-5e-5, 1e-4)),
    (Triangular(0.25, -1.0), stats.triang(0.5, -1.25, 0.5)),
    (Triangular(3.0), stats.triang(0.5, -3.0, 6.0)),
    (Normal(0.25, 2.0), stats.norm(2.0, 0.25)),
    (Normal(1e-5), stats.norm(0.0, 1e-5)),
    (TruncatedNormal(0.5, 1.0, 0.1), stats.truncnorm(-0.1, 0.1, 1.0, 0.5)),
    (TruncatedNormal(0.5, 0.0, 1.0), stats.truncnorm(-1.0, 1.0, 0.0, 0.5)),
    (TruncatedNormal(2.0, 0.0, 3.0), stats.truncnorm(-3.0, 3.0, 0.0, 2.0)),
    (TruncatedNormal(0.1, -1.0, 6.0), stats.truncnorm(-6.0, 6.0, -1.0, 0.1)),
]
BOUNDED = [(law, frozen) for law, frozen in SCALAR if not isinstance(law, Normal)]
scalar = pytest.mark.parametrize(("law", "frozen"), SCALAR, ids=[repr(law) for law, _ in SCALAR])
bounded = pytest.mark.parametrize(("law", "frozen"), BOUNDED, ids=[repr(law) for law, _ in BOUNDED])

NODES, WEIGHTS = np.polynomial.legendre.leggauss(400)


def grid() -> Array:
    """Uniform numbers as the generator makes them: the ends, near them, near the middle, and many between."""
    ends = np.array([2.0**-53, 3 * 2.0**-53, 1e-12, 1e-9, 1e-6, 1e-4])
    near = 0.5 - np.array([2.0**-53, 1e-12, 1e-9, 1e-6, 1e-3])
    half = np.concatenate([ends, np.linspace(0.001, 0.499, 2001), near])
    odd = (2 * np.floor(half * 2.0**52) + 1) / 2.0**53
    return np.sort(np.concatenate([odd, 1 - odd]))


def expectation(frozen: Any, function: Any) -> float:
    """E function(x), by quadrature of scipy's density between its ends or ten standard deviations."""
    low, high = frozen.support()
    mean, std = frozen.mean(), frozen.std()
    low, high = max(low, mean - 12 * std), min(high, mean + 12 * std)
    total = 0.0
    for a, b in ((low, mean), (mean, high)):
        points = (a + b) / 2 + (b - a) / 2 * NODES
        total += (b - a) / 2 * float(WEIGHTS @ (function(points) * frozen.pdf(points)))
    return total


@scalar
def test_quantiles_on_a_uniform_grid(law: Law, frozen: Any) -> None:
    u = grid()
    seen = law.inverse(u[None])[0]
    # scipy's truncated normal is off by 9e-3 at u = 1 - 1e-16 and k = 8, right in the lower half: reflect that
    expected = np.where(u <= 0.5, frozen.ppf(u), 2 * frozen.mean() - frozen.ppf(1 - u))
    np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-12 * (frozen.std() + abs(frozen.mean())))


@scalar
def test_quantiles_rise_and_are_symmetric_to_the_bit(law: Law, frozen: Any) -> None:
    u = grid()
    centred = law.inverse(u[None])[0] - frozen.mean() if frozen.mean() else law.inverse(u[None])[0]
    assert (np.diff(centred) >= 0).all()
    if frozen.mean() == 0 and not isinstance(law, Normal):
        np.testing.assert_array_equal(centred, -law.inverse(1 - u[None])[0])
    assert law.inverse(np.array([[0.5]]))[0, 0] == frozen.mean()


@bounded
def test_no_sample_leaves_the_support(law: Law, frozen: Any) -> None:
    samples = law.inverse(np.array([[2.0**-53, 0.5, 1 - 2.0**-53]]))[0]
    low, high = frozen.support()
    slack = 4 * np.spacing(abs(frozen.mean()) + high - low)
    assert low - slack <= samples.min()
    assert samples.max() <= high + slack


@scalar
def test_mean_and_variance(law: Law, frozen: Any) -> None:
    mean = expectation(frozen, lambda x: x)
    variance = expectation(frozen, lambda x: (x - frozen.mean()) ** 2)
    assert law.mean_vector.shape == (1,)
    assert law.covariance.shape == (1, 1)
    assert law.mean_vector[0] == pytest.approx(mean, rel=1e-12, abs=1e-12 * frozen.std())
    assert law.covariance[0, 0] == pytest.approx(variance, rel=1e-12)


@pytest.mark.parametrize("k", [1e-3, 0.01, 0.049, 0.05, 0.3, 1.0, 3.0, 8.0, 40.0])
def test_variance_of_a_truncated_normal_by_quadrature(k: float) -> None:
    points = k * NODES
    weights = WEIGHTS * np.exp(-(points**2) / 2)
    expected = float(weights @ points**2 / weights.sum()) if k < 20 else 1.0
    assert TruncatedNormal(2.0, 5.0, k).covariance[0, 0] == pytest.approx(4 * expected, rel=1e-13)


@pytest.mark.fast(33)
@scalar
@pytest.mark.parametrize("scaled", [0.0, 1e-9, 0.01, 0.7, -2.0, 9.0, 30.0])
def test_characteristic_function_by_quadrature(law: Law, frozen: Any, scaled: float) -> None:
    t = scaled / frozen.std()
    real = expectation(frozen, lambda x: np.cos(t * x))
    imaginary = expectation(frozen, lambda x: np.sin(t * x))
    assert complex(law.characteristic(np.array([t]))) == pytest.approx(complex(real, imaginary), abs=2e-12)


def test_characteristic_functions_take_any_shape() -> None:
    t = np.linspace(-3, 3, 24).reshape(1, 4, 6)
    for law, _ in SCALAR:
        assert law.characteristic(t).shape == (4, 6)
        # 1e-16 over k = 0.1 of the narrowest truncated normal
        assert complex(law.characteristic(np.array([0.0]))) == pytest.approx(1, abs=3e-15)
    assert Disc(1.0).characteristic(np.zeros((2, 4, 6))).shape == (4, 6)
    assert JointNormal(((1.0, 0.0), (0.0, 1.0))).characteristic(np.zeros((2, 5))).shape == (5,)


@bounded
@pytest.mark.parametrize("w", [1.0, -1.0, 2.5, -0.01, 0.0])
def test_support_function_is_the_largest_over_the_support(law: Law, frozen: Any, w: float) -> None:
    low, high = frozen.support()
    assert law.support(np.array([w])) == pytest.approx(max(w * low, w * high), rel=1e-15, abs=1e-18)


@pytest.mark.parametrize("law", [Normal(1.0, 2.0), Normal.from_half_width(1.0)])
def test_support_function_of_a_normal_is_infinite_but_along_nothing(law: Normal) -> None:
    assert law.support([1.0]) == math.inf
    assert law.support([-1e-300]) == math.inf
    assert law.support([0.0]) == 0.0
    assert Normal(0.0, 2.0).support([3.0]) == 6.0


def test_normal_from_half_width() -> None:
    assert Normal.from_half_width(0.3, 1.0) == Normal(0.3 / 3, 1.0)
    assert Normal.from_half_width(0.3, k=2) == Normal(0.15)
    for k in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError):
            Normal.from_half_width(0.3, k=k)


def test_fixed() -> None:
    law = Fixed(-2.5)
    np.testing.assert_array_equal(law.inverse(np.array([[0.1, 0.9]])), [[-2.5, -2.5]])
    assert law.mean_vector[0] == -2.5
    assert law.covariance[0, 0] == 0
    assert law.support([2.0]) == -5
    assert complex(law.characteristic([2.0])) == pytest.approx(np.exp(-5j), abs=1e-15)


# ---- laws of the plane ----


def polar_expectation(function: Any, radius: float, *, disc: bool) -> complex:
    """E function(x, y): Gauss in the radius, equal steps in the angle; both exact to rounding for smooth functions."""
    angles = 2 * np.pi * np.arange(256) / 256
    if not disc:
        return complex(np.mean(function(radius * np.cos(angles), radius * np.sin(angles))))
    rho = radius * (1 + NODES[:, None]) / 2
    rings = function(rho * np.cos(angles), rho * np.sin(angles)).mean(axis=1)
    return complex((WEIGHTS / 2 * rings) @ (2 * rho[:, 0] / radius))


@pytest.mark.parametrize(("law", "is_disc"), [(Disc(0.3), True), (Circle(0.3), False)])
def test_plane_law_moments_and_characteristic_function(law: Law, is_disc: bool) -> None:
    np.testing.assert_array_equal(law.mean_vector, [0, 0])
    moments = [[lambda x, y: x * x, lambda x, y: x * y], [lambda x, y: x * y, lambda x, y: y * y]]
    expected = [[polar_expectation(entry, 0.3, disc=is_disc).real for entry in row] for row in moments]
    np.testing.assert_allclose(law.covariance, expected, rtol=0, atol=1e-15)
    for t in ([0.0, 0.0], [1.0, 0.0], [-3.0, 7.0], [20.0, 60.0], [1e-10, 1e-10]):
        wave = polar_expectation(lambda x, y, t=t: np.exp(1j * (t[0] * x + t[1] * y)), 0.3, disc=is_disc)
        assert complex(law.characteristic(t)) == pytest.approx(wave, abs=1e-13)


def test_plane_characteristic_functions_are_bessel_functions() -> None:
    t = np.array([[3.0, 0.0], [4.0, 2.0]])
    s = 2.0 * np.array([5.0, 2.0])
    np.testing.assert_allclose(Disc(2.0).characteristic(t), 2 * special.jv(1, s) / s, rtol=0, atol=1e-15)
    np.testing.assert_allclose(Circle(2.0).characteristic(t), special.jv(0, s), rtol=0, atol=1e-15)


def test_plane_samples_by_complex_numbers() -> None:
    u = np.random.default_rng(4).uniform(size=(2, 1000))
    quarters = np.rint(4 * u[1]).astype(int)  # taken off first: 2πu rounds by more than what is asked here
    spin = np.array([1, 1j, -1, -1j])[quarters % 4] * np.exp(2j * np.pi * (u[1] - quarters / 4))
    disc, circle = 0.3 * np.sqrt(u[0]) * spin, 0.3 * spin
    np.testing.assert_allclose(Disc(0.3).sample(u), [disc.real, disc.imag], rtol=0, atol=1e-16)
    np.testing.assert_allclose(Circle(0.3).sample(u), [circle.real, circle.imag], rtol=0, atol=1e-16)


def test_disc_is_uniform_over_its_area_not_its_radius() -> None:
    u = np.array([[0.25, 0.5, 0.75], [0.1, 0.2, 0.3]])
    np.testing.assert_allclose((Disc(2.0).sample(u) ** 2).sum(axis=0) / 4, u[0], rtol=1e-15)


@pytest.mark.parametrize("law", [Disc(0.3), Circle(0.3)])
def test_plane_support_is_the_farthest_point(law: Law) -> None:
    turns = np.linspace(0, 1, 40001)
    points = law.sample(np.array([np.full_like(turns, 1 - 2.0**-53), turns]))
    for w in ([1.0, 0.0], [-3.0, 4.0], [0.0, 0.0], [1e-5, -1.0]):
        assert law.support(w) == pytest.approx(float((np.array(w) @ points).max()), rel=1e-8, abs=1e-18)
    assert law.support([3.0, -4.0]) == pytest.approx(1.5, rel=1e-15)
    assert law.components == (".x", ".y")
    assert law.size == 2


# ---- joint normal ----

MATRIX = ((4.0, 1.2, -0.5), (1.2, 1.0, 0.1), (-0.5, 0.1, 0.25))


def test_joint_normal_root_and_sample() -> None:
    law = JointNormal(MATRIX, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(law.root, np.linalg.cholesky(np.array(MATRIX)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(law.root @ law.root.T, MATRIX, rtol=0, atol=1e-15)
    unit = np.eye(3)
    np.testing.assert_allclose(law.sample(unit) - np.array([[1.0], [2.0], [3.0]]), law.root, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(law.mean_vector, [1, 2, 3])
    np.testing.assert_array_equal(law.covariance, MATRIX)
    assert law.components == (".0", ".1", ".2")


def test_joint_normal_covariance_by_the_grid_of_its_inverse() -> None:
    # tensor grid of midpoints in the uniform numbers: crude at the tails, 0.4 % of a variance
    steps = (np.arange(40) + 0.5) / 40
    u = np.array(np.meshgrid(steps, steps, steps)).reshape(3, -1)
    x = JointNormal(MATRIX).inverse(u)
    shrink = float((special.ndtri(steps) ** 2).mean())
    np.testing.assert_allclose(x @ x.T / u.shape[1], shrink * np.array(MATRIX), rtol=0, atol=1e-13)
    assert shrink == pytest.approx(1, abs=0.04)


def test_joint_normal_characteristic_function_along_a_line() -> None:
    t = np.array([0.3, -0.7, 1.1])
    mean, matrix = np.array([1.0, 2.0, 3.0]), np.array(MATRIX)
    line = stats.norm(t @ mean, math.sqrt(t @ matrix @ t))
    ends = (line.mean() - 10 * line.std(), line.mean() + 10 * line.std())
    real = integrate.quad(lambda y: math.cos(y) * line.pdf(y), *ends, epsabs=1e-13)[0]
    imaginary = integrate.quad(lambda y: math.sin(y) * line.pdf(y), *ends, epsabs=1e-13)[0]
    seen = complex(JointNormal(MATRIX, (1.0, 2.0, 3.0)).characteristic(t))
    assert seen == pytest.approx(complex(real, imaginary), abs=1e-12)


@pytest.mark.parametrize(
    "factor",
    [
        [[1.0, 0.2], [0.3, 1.0], [0.5, 0.7]],
        [[1.0], [2.0], [-3.0]],
        [[0.0], [1.0], [2.0]],
        [[0.0, 0.0], [0.0, 0.0]],
    ],
)
def test_joint_normal_may_be_degenerate(factor: list[list[float]]) -> None:
    c = np.array(factor)
    matrix = c @ c.T
    law = JointNormal(tuple(map(tuple, matrix.tolist())), tuple(range(1, len(c) + 1)))
    np.testing.assert_allclose(law.root @ law.root.T, matrix, rtol=0, atol=1e-14)
    if c.shape == (3, 2):
        normal = np.cross(c[:, 0], c[:, 1])
        assert law.support(normal) == pytest.approx(normal @ [1, 2, 3], abs=1e-14)
        assert law.support(normal + np.array([1e-6, 0, 0])) == math.inf
    assert law.support(np.zeros(len(c))) == 0


@pytest.mark.parametrize(
    ("matrix", "centre", "reason"),
    [
        ((), (), "square"),
        (((1.0, 0.0),), (), "square"),
        (((1.0, 0.0), (0.0,)), (), "square"),
        (((1.0, 0.5), (0.4, 1.0)), (), "symmetric"),
        (((1.0, 1.1), (1.1, 1.0)), (), "above 1"),
        (((-1.0, 0.0), (0.0, 1.0)), (), "negative"),
        (((0.0, 1e-12), (1e-12, 1e-12)), (), "above 1"),
        (((1.0, 0.9, -0.9), (0.9, 1.0, 0.9), (-0.9, 0.9, 1.0)), (), "negative eigenvalue"),
        (((1.0, math.nan), (math.nan, 1.0)), (), "finite"),
        (((1.0, 0.0), (0.0, 1.0)), (1.0,), "mean"),
        (((1.0,),), (math.inf,), "finite"),
    ],
)
def test_bad_joint_normal_is_refused(matrix: Any, centre: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        JointNormal(matrix, centre)


def test_a_covariance_of_tiny_numbers_is_judged_by_its_correlation() -> None:
    JointNormal(((1e-20, 0.5e-20), (0.5e-20, 1e-20)))
    with pytest.raises(InputError):
        JointNormal(((1e-20, 2e-20), (2e-20, 1e-20)))


@pytest.mark.parametrize("kind", [Uniform, Triangular, Normal, TruncatedNormal, Disc, Circle])
@pytest.mark.parametrize("size", [-1.0, -1e-300, math.nan, math.inf, -math.inf])
def test_size_that_is_negative_or_not_finite_is_refused(kind: Any, size: float) -> None:
    with pytest.raises(InputError):
        kind(size)


@pytest.mark.parametrize("kind", [Uniform, Triangular, Normal, TruncatedNormal])
@pytest.mark.parametrize("mean", [math.nan, math.inf])
def test_mean_that_is_not_finite_is_refused(kind: Any, mean: float) -> None:
    with pytest.raises(InputError):
        kind(1.0, mean)
    with pytest.raises(InputError):
        Fixed(mean)


@pytest.mark.parametrize("k", [0.0, -3.0, 1e-9, math.nan, math.inf])
def test_k_out_of_range_is_refused(k: float) -> None:
    with pytest.raises(InputError, match="k of a truncated normal"):
        TruncatedNormal(1.0, 0.0, k)


@pytest.mark.parametrize("kind", [Uniform, Triangular, Normal, TruncatedNormal])
def test_size_zero_is_a_constant(kind: Any) -> None:
    law = kind(0.0, 1.5)
    np.testing.assert_array_equal(law.inverse(grid()[None]), np.full((1, grid().size), 1.5))
    assert law.covariance[0, 0] == 0
    assert law.support([2.0]) == 3.0
    assert complex(law.characteristic([2.0])) == pytest.approx(np.exp(3j), abs=1e-15)


@pytest.mark.parametrize("kind", [Disc, Circle])
def test_radius_zero_is_the_origin(kind: Any) -> None:
    law = kind(0.0)
    np.testing.assert_array_equal(law.sample(np.array([[0.3], [0.4]])), [[0.0], [0.0]])
    assert complex(law.characteristic([5.0, 1.0])) == 1
