"""Exact laws against closed forms, rational arithmetic, quadrature, reference case R6 and samples, not the code's own output."""

import itertools
import json
import math
import time
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
from scipy import integrate, special, stats

import precision_pin as pp
from precision_pin.analyses import number_law
from precision_pin.analyses.exact_law.exact_law import LEVELS, agreement_of, quantile_digits, table
from precision_pin.analyses.exact_law.figure import figure
from precision_pin.analyses.number_law import ConvolvedLaw, NormalLaw, NormalNorm
from precision_pin.analyses.provenance import listed_poses
from precision_pin.draws.laws.lognormal import LOGNORMAL_ERROR, lognormal_characteristic, lognormal_envelope
from precision_pin.draws.laws.projection import Lines
from precision_pin.robot import examples
from precision_pin.statistics.intervals import bound_text
from support.checks.common import one_link
from support.refusals import check_refused
from support.sheets import slides


def normal_norm(mean, covariance, radius, end=400):
    """Return P(|v| ≤ r) by Imhof's integral (Biometrika 48, 419, 1961)."""
    variances, axes = np.linalg.eigh(covariance)
    squares = (axes.T @ mean) ** 2
    scale = variances.max()
    lam, shift, x = variances / scale, squares / scale, radius**2 / scale

    # in pieces on which the sine turns by about a radian
    count, (nodes, weights) = math.ceil(end * (1 + x + shift.sum()) / 2), np.polynomial.legendre.leggauss(16)
    u = (end / count * (np.arange(count)[:, None] + (nodes + 1) / 2)).reshape(-1, 1)
    size = 1 + (lam * u) ** 2
    angle = 0.5 * (np.arctan(lam * u) + shift * u / size).sum(axis=1) - 0.5 * x * u[:, 0]
    falling = (size**0.25).prod(axis=1) * np.exp(0.5 * (shift * lam * u**2 / size).sum(axis=1))
    return 0.5 - end / count / 2 / math.pi * np.tile(weights, count) @ (np.sin(angle) / (u[:, 0] * falling))


SAMPLES = 5000


def sum_along_x(*summed, correlations=()):
    """Return sliding joints along x: the error is the sum of the joints' errors."""
    space = pp.Space(tuple(pp.Draw(f"p{k}", law) for k, law in enumerate(summed)), correlations)
    return slides([(1, 0, 0)] * len(summed), [draw.name for draw in space.draws], space)


def law_of_x(*summed):
    found = pp.exact_law(sum_along_x(*summed), samples=SAMPLES).poses[0].laws["position.x"]
    assert found.agreement is None or found.agreement.agrees
    return found


def test_uniform_and_normal_against_the_closed_form():
    a, sigma, mean = 0.7, 0.2, 0.3
    found = law_of_x(pp.Uniform(a, mean), pp.Normal(sigma))
    x = np.linspace(-1.2, 1.8, 31)

    def primitive(z):
        return z * special.ndtr(z / sigma) + sigma * np.exp(-((z / sigma) ** 2) / 2) / math.sqrt(2 * math.pi)

    expected = (primitive(x - mean + a) - primitive(x - mean - a)) / (2 * a)
    np.testing.assert_allclose(found.law.cumulative(x), expected, atol=1e-13)
    density = (special.ndtr((x - mean + a) / sigma) - special.ndtr((x - mean - a) / sigma)) / (2 * a)
    np.testing.assert_allclose(found.law.density(x), density, atol=1e-12)


# --- parts ---
PARTS = {
    "uniform": pp.Uniform(1.0, 0.2),
    "triangular": pp.Triangular(1.2),
    "truncated": pp.TruncatedNormal(0.5, 1.0, 2.0),
    "truncated close": pp.TruncatedNormal(1.0, 0.0, 0.4),
    "arcsine": pp.Arcsine(0.7),
    "disc": pp.Disc(0.9),
    "circle": pp.Circle(1.1),
    "sphere": pp.Sphere(0.8),
    "lognormal": pp.Lognormal(0.3, 1.0),
    "two points": pp.TwoPoint(0.4, 0.1, 0.3),
    "empirical": pp.Empirical(((0, -1), (0.3, 0), (0.5, 0.2), (1, 2))),
    "rows": pp.Rows(((0.0, 1.0), (0.5, -1.0), (2.0, 0.25))),
}
"""Laws, of which `part_of` takes a component of either sign."""


def part_of(name):
    """Return the law of a component less its mean, and the component's direction."""
    law = PARTS[name]
    weights = np.array([-0.8]) if law.size == 1 else np.array([0.8, -0.3, 0.5])[: law.size]
    return law.projection(weights), weights


@pytest.mark.parametrize("name", PARTS)
def test_a_part_has_the_law_of_its_draw(name):
    """By samples; the parametrisation carries the whole probability and the cumulative law, whose slope is the density."""
    (part, weights), law, count = part_of(name), PARTS[name], 200_000
    uniforms = np.random.default_rng(0).random((law.size, count))
    rising, shift = np.sort(weights @ (law.inverse(uniforms) - law.mean_vector[:, None])), 1e-12
    above = np.searchsorted(rising, rising, side="right") / count - part.cumulative(rising + shift)
    below = part.cumulative(rising - shift) - np.searchsorted(rising, rising, side="left") / count
    assert max(above.max(), below.max()) < math.sqrt(math.log(2 / 1e-6) / (2 * count))
    assert part.ends[0] - 1e-12 <= rising[0]
    assert rising[-1] <= part.ends[1] + 1e-12
    nodes, of_nodes = np.polynomial.legendre.leggauss(60)
    total = 0.0
    for a, b in itertools.pairwise(part.breaks):
        s = (a + b) / 2 + (b - a) / 2 * nodes
        total += (b - a) / 2 * part.weight(s) @ of_nodes
        if not isinstance(part, Lines):
            assert part.cumulative(part.position(np.array([b])))[0] == pytest.approx(total, abs=1e-12)
            np.testing.assert_allclose(part.parameter(part.position(s)), s, atol=1e-7 * (b - a))
    assert total == pytest.approx(1.0, abs=1e-12)
    if name not in ("two points", "rows"):
        z, step = np.linspace(*np.clip(part.ends, -3, 3), 24)[1:-1], 1e-6
        slope = (part.cumulative(z + step) - part.cumulative(z - step)) / (2 * step)
        np.testing.assert_allclose(part.density(z), slope, rtol=2e-4, atol=1e-8)


@pytest.mark.parametrize("name", PARTS)
def test_envelopes_bound_characteristic_functions_and_never_rise(name):
    part, weights = part_of(name)
    omega = np.geomspace(1e-2, 1e4, 4000)
    bound = part.envelope(omega)
    assert (np.abs(PARTS[name].characteristic(weights[:, None] * omega)) <= bound * (1 + 1e-9)).all()
    assert (np.diff(bound) <= 1e-15).all()


def test_disc_circle_and_sphere_from_the_side():
    x = np.linspace(-0.95, 0.95, 9)
    disc, circle = pp.Disc(2.0).projection(np.array([0.3, 0.4])), pp.Circle(2.0).projection(np.array([0.3, 0.4]))
    expected = 0.5 + (x * np.sqrt(1 - x**2) + np.arcsin(x)) / math.pi
    np.testing.assert_allclose(disc.cumulative(x), expected, atol=1e-15)
    np.testing.assert_allclose(circle.cumulative(x), 0.5 + np.arcsin(x) / math.pi, atol=1e-15)
    # Archimedes: a slice of a sphere has the area of the cylinder about it
    sphere = pp.Sphere(2.0).projection(np.array([0.2, 0.3, -0.6]))
    np.testing.assert_allclose(sphere.cumulative(0.7 * 2.0 * x), (1 + x) / 2, atol=1e-15)


@pytest.mark.parametrize("names", [("disc", "circle"), ("arcsine", "lognormal"), ("uniform", "empirical")])
def test_convolution_either_way_round_and_by_quadrature(names):
    one, other = (part_of(name)[0] for name in names)
    x = np.linspace(one.ends[0] + other.ends[0], min(one.ends[1] + other.ends[1], 3), 23)[1:-1]
    forth, back = (ConvolvedLaw(0.0, *pair).cumulative(x) for pair in ((one, other), (other, one)))
    np.testing.assert_allclose(forth, back, atol=1e-11)
    for value, found in zip(x[::5], forth[::5], strict=True):
        kinks = [one.parameter(np.array([z]))[0] for z in (*one.ends, *(value - np.array(other.kinks)))]
        pieces = np.union1d(np.clip(kinks, one.breaks[0], one.breaks[-1]), one.breaks)

        def inner(s):
            return other.cumulative(value - one.position(np.array([s])))[0] * one.weight(np.array([s]))[0]  # noqa: B023

        parts = [integrate.quad(inner, *ends, epsabs=1e-12, epsrel=1e-12)[0] for ends in itertools.pairwise(pieces)]
        assert found == pytest.approx(sum(parts), abs=1e-9)


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_the_convolution_of_a_sine_wave_with_a_steep_lognormal_number(turned):
    """It was 5e-9 off where 1e-11 was stated; F(x) = E arcsine law of x less the lognormal number."""
    wave, number = pp.Arcsine(0.7).projection(np.ones(1)), pp.Lognormal(0.05, 1.0).projection(np.array([turned]))
    law = ConvolvedLaw.of(0.0, wave, number)
    z, weights = np.polynomial.legendre.leggauss(60)
    edges = np.linspace(-math.pi / 2, math.pi / 2, 400)
    half = np.diff(edges)[:, None] / 2
    angle, x = (edges[:-1, None] + half * (z + 1)).ravel(), np.linspace(-0.8, 0.8, 21)
    expected = [number.cumulative(v - 0.7 * np.sin(angle)) @ (half * weights).ravel() / math.pi for v in x]
    np.testing.assert_allclose(law.cumulative(x), expected, atol=1e-11, rtol=0)
    assert law.error <= 1e-11


@pytest.mark.slow
def test_discrete_laws():
    jumps = law_of_x(pp.TwoPoint(1.0), pp.TwoPoint(0.25))
    np.testing.assert_allclose(jumps.law.cumulative(np.array([-1.26, -1.0, 0.0, 1.0, 1.3])), [0, 0.25, 0.5, 0.75, 1])
    # a jump's place is known although there is no density
    assert abs(jumps.quantiles[0] + 1.25) <= jumps.quantile_errors[0] < 1e-12
    many = law_of_x(pp.TwoPoint(1.0), pp.TwoPoint(0.25), pp.TwoPoint(0.1))
    assert (many.law, many.reason.startswith("not certified")) == (None, True)
    assert many.std == pytest.approx(math.sqrt(1 + 0.25**2 + 0.1**2), rel=1e-14)
    smooth = law_of_x(pp.TwoPoint(1.0), pp.TwoPoint(0.25), pp.Normal(0.1))
    expected = np.mean([stats.norm(c, 0.1).cdf(0.3) for c in (-1.25, -0.75, 0.75, 1.25)])
    assert smooth.law.cumulative(np.array([0.3]))[0] == pytest.approx(expected, abs=1e-12)


def test_draws_that_hardly_matter_do_not_make_it_slow_or_wrong():
    found = law_of_x(pp.Uniform(1.0), pp.Uniform(1e-15), pp.Uniform(1e-14))
    assert found.contributors == 1
    assert found.law.cumulative(np.array([0.5]))[0] == pytest.approx(0.75, abs=1e-12)


# --- norms ---
@pytest.mark.slow
def test_r6_norm_of_an_isotropic_normal_vector():
    sigma = 0.2e-3
    model = slides(np.eye(3), [pp.Normal(sigma)] * 3)
    found = pp.exact_law(model, samples=SAMPLES).poses[0]
    norm = found.laws["position.norm"]
    numbers = [norm.mean, *map(norm.law.quantile, (0.5, 0.95, 0.99, 0.9973))]
    assert np.array(numbers) / sigma == pytest.approx([1.595769, 1.538172, 2.795483, 3.368214, 3.762480], abs=5e-7)
    assert norm.agreement.agrees
    assert found.laws["attitude.norm"].reason == "does not vary at first order"


def test_norms_against_chi_square_laws():
    shifted = NormalNorm(np.array([3.0, 2.0, 0.0]), np.eye(3))
    r = np.array([0.5, 2.0, 4.0, 6.0])
    np.testing.assert_allclose(shifted.cumulative(r), stats.ncx2.cdf(r**2, 3, 13.0), atol=1e-12)
    np.testing.assert_allclose(shifted.density(r), 2 * r * stats.ncx2.pdf(r**2, 3, 13.0), atol=1e-11)
    plane = NormalNorm(np.array([0.0, 0.0, 0.5]), np.diag([4.0, 4.0, 0.0]))
    np.testing.assert_allclose(plane.cumulative(r), 1 - np.exp(-(np.maximum(r**2 - 0.25, 0)) / 8), atol=1e-12)
    line = NormalNorm(np.array([1.0, 0.0, 0.0]), np.diag([4.0, 0.0, 0.0]))
    np.testing.assert_allclose(line.cumulative(r), stats.norm(1, 2).cdf(r) - stats.norm(1, 2).cdf(-r), atol=1e-14)
    # unlike spreads take more than the first nodes, which are 2e-9 off: the stated error is kept
    uneven = NormalNorm(np.array([0.0, 0.03, 0.0]), np.diag(np.square([0.0173, 0.2847, 0.0758])))
    r = np.linspace(*uneven.ends, 5)[1:-1]
    fine = number_law._ball(r, *uneven._axes[:2], 384)
    assert np.abs(uneven.cumulative(r) - fine).max() <= uneven.error
    # three different variances, by Imhof's integral
    mean, covariance = np.array([0.4, -0.3, 0.2]), np.diag([1.0, 0.5, 0.2])
    found = NormalNorm(mean, covariance).cumulative(np.array([0.6, 1.5]))
    assert found == pytest.approx([normal_norm(mean, covariance, radius, 2000) for radius in (0.6, 1.5)], abs=1e-6)


def test_a_flat_far_vector_does_not_depend_on_axes():
    turn = stats.special_ortho_group.rvs(3, random_state=np.random.default_rng(3))
    centre, stds = np.array([30.0, 1.0, 0.0]), np.array([1.0, 1e-3, 1e-6])
    law = NormalNorm(turn @ centre, turn @ np.diag(stds**2) @ turn.T)
    # to second order |v| = 30 + x + 1/(2·30): so far out the law is that of x
    assert law.quantile(0.5) == pytest.approx(math.sqrt(901), abs=1e-5)
    assert law.quantile(0.99) - law.quantile(0.5) == pytest.approx(stats.norm.ppf(0.99), rel=1e-3)
    r = np.array([29.0, 30.0, 31.5])
    step = 1e-5
    slope = (law.cumulative(r + step) - law.cumulative(r - step)) / (2 * step)
    np.testing.assert_allclose(law.density(r), slope, rtol=1e-6)


# --- models ---
@pytest.mark.slow
def test_the_papers_arm_agrees_with_its_samples():
    model = pp.ErrorModel.load(examples.PAPER_SHEET)
    result = pp.exact_law(model, seed=1)
    found = result.poses[0].laws
    for name in ("position.norm", "attitude.norm"):
        assert (found[name].law, "only of normal draws" in found[name].reason) == (None, True)
    laws = [found[f"{part}.{axis}"] for part in ("position", "attitude") for axis in "xyz"]
    assert all(law.agreement.agrees and law.error < 1e-11 and max(law.quantile_errors) < 1e-9 for law in laws)
    np.testing.assert_allclose([law.std for law in laws], np.sqrt(np.diag(model.at().covariance)), rtol=1e-12)
    written = json.loads(result.to_json())["poses"][0]["laws"]
    x = written["position.x"]
    assert x["support"][0] < x["quantiles"]["0.00135"] < x["quantiles"]["0.99865"] < x["support"][1]
    assert len(x["curve"]["value"]) == len(x["curve"]["density"])
    assert "not_available" in written["position.norm"]
    assert "|d|: not available" in table(result)
    assert "inversion of the characteristic function" in table(result)


def test_a_wrong_law_is_noticed():
    """Planted fault: the spread is 3 % off."""
    rising = np.sort(np.random.default_rng(0).normal(size=100_000))
    assert agreement_of(NormalLaw(0.0, 1.0), rising, 0.999, 1.0).agrees
    assert not agreement_of(NormalLaw(0.0, 1.03), rising, 0.999, 1.0).agrees


def test_normal_draws_alone_and_correlated_count_as_one_and_copulas_are_refused():
    found = law_of_x(pp.Normal(0.3), pp.Normal(0.4, 1.0), pp.Fixed(0.5))
    assert found.contributors == 1
    x = np.linspace(-1, 4, 11)
    np.testing.assert_allclose(found.law.cumulative(x), stats.norm(1.5, 0.5).cdf(x), rtol=1e-12)
    assert found.quantiles == pytest.approx(stats.norm(1.5, 0.5).ppf(LEVELS), abs=1e-12)
    both = pp.Correlation.pair("p0", "p1", 0.6)
    found = pp.exact_law(sum_along_x(pp.Normal(0.3), pp.Normal(0.4), correlations=(both,)), samples=SAMPLES)
    x = found.poses[0].laws["position.x"]
    assert x.std == pytest.approx(math.sqrt(0.09 + 0.16 + 2 * 0.6 * 0.12), rel=1e-12)
    assert x.agreement.agrees
    space = pp.Space((pp.Draw("pair", pp.JointNormal(((0.04, 0.01), (0.01, 0.09)))), pp.Draw("u", pp.Uniform(0.5))))
    model = slides([(1, 0, 0)] * 3, ("pair.0", "pair.1", "u"), space)
    x = pp.exact_law(model, samples=SAMPLES).poses[0].laws["position.x"]
    assert (x.contributors, x.std) == (2, pytest.approx(math.sqrt(0.15 + 0.25 / 3), rel=1e-12))
    assert x.agreement.agrees
    copula = sum_along_x(pp.Normal(0.3), pp.Uniform(0.4), correlations=(both,))
    check_refused((r"'p1' is correlated .* and not normal", pp.exact_law, copula))


def test_poses_are_one_or_several():
    """In arrays of several elsewhere poses are columns, and in a square one rows and columns cannot be distinguished."""
    one = (None, "paper", [0.1, 0.2], np.zeros(4))
    assert [len(listed_poses(poses)) for poses in (*one, ["a", "b"], [None, {}])] == [1, 1, 1, 1, 2, 2]
    said = r"list\(array\) for poses in rows, list\(array.T\) for poses in columns"
    check_refused((said, listed_poses, np.zeros((3, 4))))


def test_figure_marks_what_is_missing():
    result = pp.exact_law(sum_along_x(pp.Uniform(1.0), pp.TwoPoint(0.3)), samples=1000)
    texts = [text.get_text() for axes in figure(result).axes for text in axes.texts]
    assert any("does not vary" in text for text in texts)


def test_a_spread_that_is_lost_in_rounding_is_refused():
    law = NormalNorm(np.array([0.0, 0.0, 2e13]), np.diag([1e-8, 1e-8, 0.0]))
    check_refused(("its spread is lost in rounding", law.quantile, 0.5))


@pytest.mark.slow
def test_density_of_a_small_norm_is_that_of_the_closed_form_in_little_memory():
    """|v|²/σ² has the noncentral chi-square law; the spread of a robot in m is far below 1."""
    std, centre = 1e-5, 1e-5 * np.array([3.0, -8.0, 5.0])
    law = NormalNorm(centre, std**2 * np.diag([1, 1 + 1e-7, 1 - 1e-7]))
    r = np.linspace(3, 17, 400) * std
    tracemalloc.start()
    found = law.density(r)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    exact = 2 * r / std**2 * stats.ncx2.pdf((r / std) ** 2, 3, float(centre @ centre) / std**2)
    np.testing.assert_allclose(found * std, exact * std, atol=1e-6)
    assert peak < 400e6


def uniform_sum(half_widths, x, number=Fraction):
    """P(sum of uniform numbers of these half-widths ≤ x), exact for the numbers given if computed in fractions."""
    widths, count = [number(float(width)) for width in half_widths], len(half_widths)
    total = number(0)
    for signs in itertools.product((1, -1), repeat=count):
        reach = number(float(x)) + sum(sign * width for sign, width in zip(signs, widths, strict=True))
        if reach > 0:
            total += math.prod(signs) * reach**count
    return total / (math.factorial(count) * math.prod(2 * width for width in widths))


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("half_widths", "mean"),
    [((0.5,), 0), ((0.3, 0.5), 0), ((0.3, 0.5, 0.9), 0), ((1, 1, 1), 1e3), ((1, 0.1, 0.01, 1e-3), 0), ((1,) * 8, 0)],
)
def test_the_bound_holds_for_sums_of_uniforms(half_widths, mean):
    """Means much larger than the spread cost no digits: the error is that of the deviations."""
    found = law_of_x(*[pp.Uniform(float(width), mean) for width in half_widths])
    assert found.contributors == len(half_widths)
    assert found.agreement.band == pytest.approx(math.sqrt(math.log(2 / 0.001) / (2 * SAMPLES)), rel=1e-12)
    middle = mean * len(half_widths)
    x = middle + np.random.default_rng(0).uniform(-1, 1, 25) * sum(half_widths)
    found_there = found.law.cumulative(x)
    off = [abs(Fraction(float(p)) - uniform_sum(half_widths, v - middle)) for p, v in zip(found_there, x, strict=True)]
    assert max(off) <= found.error <= 1e-11
    for p, value, bound in zip(LEVELS, found.quantiles, found.quantile_errors, strict=True):
        assert bound < 1e-9
        assert uniform_sum(half_widths, value - bound - middle) <= p <= uniform_sum(half_widths, value + bound - middle)
        assert found.law.quantile(p) == value


def lognormal_nodes(cv, panels):
    """Return deviations from the mean 1 and weights, Gauss-Legendre in normal scores."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.linspace(-8.8, 8.8, panels + 1)
    half = np.diff(edges)[:, None] / 2
    z = (edges[:-1, None] + half * (nodes + 1)).ravel()
    sigma = math.sqrt(math.log1p(cv**2))
    density = np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    return np.expm1(sigma * z - sigma**2 / 2), (half * weights).ravel() * density


@pytest.mark.fast(1)
@pytest.mark.parametrize("cv", [0.05, 0.2, 1.0, 2.0])
def test_the_bound_holds_for_a_lognormal_number_with_a_normal_one(cv):
    found = law_of_x(pp.Lognormal(cv, 1.0), pp.Normal(0.1 * cv))
    z, weights = lognormal_nodes(cv, 1000)
    x = np.array([*found.quantiles, 1 + 0.3 * cv, 1 + 8 * cv])
    expected = np.array([special.ndtr((value - 1 - z) / (0.1 * cv)) @ weights for value in x])
    assert np.abs(found.law.cumulative(x) - expected).max() <= found.error < 1e-10


def test_a_law_that_would_take_too_many_terms_is_refused_at_once_with_the_reason():
    begin = time.perf_counter()
    found = law_of_x(pp.Lognormal(30.0, 1.0), pp.Uniform(1e-4), pp.Uniform(1e-5))
    # three lognormal numbers took 72 s with a bound of the characteristic function that fell as 1/ω³
    assert law_of_x(*[pp.Lognormal(1.0, 1.0)] * 3).error < 1e-9
    assert time.perf_counter() - begin < 10
    assert found.law is None
    assert "terms leave an error of" in found.reason
    assert "values with a probability of their own" not in found.reason


@pytest.mark.parametrize("cv", [0.05, 0.5, 3.0])
def test_the_transform_of_a_lognormal_number_by_plain_quadrature(cv):
    """At frequencies where the plain integral does not oscillate beyond its nodes; interpolated ones as single ones."""
    sigma = math.sqrt(math.log1p(cv**2))
    t = np.array([1e-3, 0.1, 1.0, -3.0, 10.0])
    z, weights = lognormal_nodes(cv, 4000)
    inside = np.abs(z) < 50
    expected = np.exp(1j * t[:, None] * z[inside]) @ weights[inside]
    left_out = weights[~inside].sum()
    assert np.abs(lognormal_characteristic(t, sigma) - expected).max() <= LOGNORMAL_ERROR + left_out
    many = np.linspace(0, 40, 9001)
    single = lognormal_characteristic(many[::300], sigma)
    assert np.abs(lognormal_characteristic(many, sigma)[::300] - single).max() <= LOGNORMAL_ERROR
    assert (np.abs(lognormal_characteristic(many, sigma)) <= lognormal_envelope(many, sigma) + 1e-14).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*use analyze:precision_pin.base.errors.PrecisionPinWarning")
def test_a_law_that_is_not_that_of_the_exact_model_is_said():
    """A link along x turned by θ: dx = cos θ - 1 does not vary at first order, dy = sin θ is nonlinear for ±1.5 rad."""
    chain = one_link(gravity=(0, 0, 0))
    hinges = [pp.sources.JointOffset(joint="hinge", offset=pp.Uniform(reach)) for reach in (1.5, 1e-9)]
    wide, narrow = (pp.exact_law(pp.ErrorModel(chain, pp.Space(), [one]), [0.0]).poses[0] for one in hinges)
    assert any(line.startswith("dx: does not vary at first order") for line in wide.warnings)
    assert any(line.startswith("dy: ") and "the model is nonlinear" in line for line in wide.warnings)
    assert not any(line.startswith("δz") for line in wide.warnings)
    assert narrow.warnings == ()
    assert wide.to_dict()["warnings"] == list(wide.warnings)


def test_bounds_are_rounded_up_and_quantiles_cut_to_what_is_known():
    assert [bound_text(bound) for bound in (1e-14, 2.1e-14, 9.5e-13, 0.0)] == ["1e-14", "3e-14", "1e-12", "0"]
    assert quantile_digits(12.345678, 1e-12, 6) == 6
    # 12.35 is known to half a unit of the last digit, 12.346 is not
    assert (quantile_digits(12.345678, 0.004, 6), quantile_digits(1.0, 10.0, 6)) == (4, 1)
