"""Stated errors of exact laws, against rational arithmetic, fine quadrature and the exact model."""

from __future__ import annotations

import itertools
import math
import time
from fractions import Fraction

import numpy as np
import pytest
from scipy import special

from precision_pin.analyses.exact_law.exact_law import bound_text, exact_law, quantile_digits
from precision_pin.analyses.exact_law.number_law import ConvolvedLaw
from precision_pin.draws import laws
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws.lognormal import (
    LOGNORMAL_ERROR,
    lognormal_characteristic,
    lognormal_envelope,
)
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.joint_offset import JointOffset
from support.plain_robot import chain_of, joint, link, robot


def slides(count: int) -> Chain:
    """Return sliding joints along x: the error is the sum of the joints' errors."""
    names = ["base", *(f"link{k}" for k in range(1, count)), "tool"]
    parts = [link(name) for name in names]
    for k in range(count):
        parts.append(joint(f"joint{k + 1}", "prismatic", names[k], names[k + 1], axis=(1, 0, 0)))
    return chain_of(robot(*parts), tip="tool")


def law_of_x(*summed: laws.Law):
    space = Space(tuple(Draw(f"p{k}", law) for k, law in enumerate(summed)))
    offsets = [JointOffset(joint=f"joint{k + 1}", offset=f"p{k}") for k in range(len(summed))]
    model = ErrorModel(slides(len(summed)), space, offsets, {"rest": np.zeros(len(summed))})
    return exact_law(model, samples=1000).poses[0].laws["position.x"]


def uniform_sum(half_widths, x: float) -> Fraction:
    """P(sum of uniform numbers of these half-widths ≤ x), exact for the numbers given."""
    widths, count = [Fraction(float(width)) for width in half_widths], len(half_widths)
    total = Fraction(0)
    for signs in itertools.product((1, -1), repeat=count):
        reach = Fraction(float(x)) + sum(sign * width for sign, width in zip(signs, widths, strict=True))
        if reach > 0:
            total += math.prod(signs) * reach**count
    return total / (math.factorial(count) * math.prod(2 * width for width in widths))


@pytest.mark.parametrize(
    ("half_widths", "mean"),
    [
        ((0.3, 0.5, 0.9), 0.0),
        pytest.param((1.0, 1.0, 1.0), 1e3, marks=pytest.mark.slow),
        pytest.param((1.0, 0.1, 0.01, 1e-3), 0.0, marks=pytest.mark.slow),
        pytest.param((1.0,) * 8, 0.0, marks=pytest.mark.slow),
        pytest.param((1, 1, 1, 2e-3, 3e-3), 0, marks=pytest.mark.slow),
    ],
)
def test_the_bound_holds_for_sums_of_uniforms(half_widths, mean):
    """Means much larger than the spread cost no digits: the error is that of the deviations."""
    found = law_of_x(*[laws.Uniform(float(width), mean) for width in half_widths])
    middle = mean * len(half_widths)
    x = middle + np.random.default_rng(0).uniform(-1, 1, 25) * sum(half_widths)
    found_there = found.law.cumulative(x)
    off = [abs(Fraction(float(p)) - uniform_sum(half_widths, v - middle)) for p, v in zip(found_there, x, strict=True)]
    assert max(off) <= found.error < 1e-11
    for p, value, bound in zip((0.00135, 0.95), found.quantiles[::4], found.quantile_errors[::4], strict=True):
        assert uniform_sum(half_widths, value - bound - middle) <= p <= uniform_sum(half_widths, value + bound - middle)


def lognormal_nodes(cv: float, panels: int):
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
    found = law_of_x(laws.Lognormal(cv, 1.0), laws.Normal(0.1 * cv))
    z, weights = lognormal_nodes(cv, 1000)
    x = np.array([*found.quantiles, 1 + 0.3 * cv, 1 + 8 * cv])
    expected = np.array([special.ndtr((value - 1 - z) / (0.1 * cv)) @ weights for value in x])
    assert np.abs(found.law.cumulative(x) - expected).max() <= found.error < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("cv", [0.2, 1.0])
def test_three_lognormal_numbers_take_seconds(cv):
    """They took 72 s with a bound of the characteristic function that fell as 1/ω³; compared with 10⁶ plain samples."""
    begin = time.perf_counter()
    found = law_of_x(*[laws.Lognormal(cv, 1.0)] * 3)
    assert time.perf_counter() - begin < 10
    assert found.error < 1e-9
    sigma = math.sqrt(math.log1p(cv**2))
    sampled = np.exp(sigma * np.random.default_rng(3).normal(size=(3, 1_000_000)) - sigma**2 / 2).sum(axis=0)
    below = [(sampled <= value).mean() for value in found.quantiles]
    # five standard deviations of a count
    p = np.array([0.00135, 0.01, 0.05, 0.5, 0.95, 0.99, 0.9973, 0.99865])
    assert (np.abs(below - p) <= 5 * np.sqrt(p * (1 - p) / 1e6)).all()


def test_a_law_that_would_take_too_many_terms_is_refused_at_once_with_the_reason():
    begin = time.perf_counter()
    found = law_of_x(laws.Lognormal(30.0, 1.0), laws.Uniform(1e-4), laws.Uniform(1e-5))
    assert time.perf_counter() - begin < 5
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


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_the_convolution_of_a_sine_wave_with_a_steep_lognormal_number(turned):
    """It was 5e-9 off where 1e-11 was stated; F(x) = E arcsine law of x less the lognormal number."""
    wave, number = laws.Arcsine(0.7).projection(np.ones(1)), laws.Lognormal(0.05, 1.0).projection(np.array([turned]))
    law = ConvolvedLaw.of(0.0, wave, number)
    z, weights = np.polynomial.legendre.leggauss(60)
    edges = np.linspace(-math.pi / 2, math.pi / 2, 400)
    half = np.diff(edges)[:, None] / 2
    angle = (edges[:-1, None] + half * (z + 1)).ravel()
    x = np.linspace(-0.8, 0.8, 21)
    expected = [number.cumulative(v - 0.7 * np.sin(angle)) @ (half * weights).ravel() / math.pi for v in x]
    np.testing.assert_allclose(law.cumulative(x), expected, atol=1e-11, rtol=0)
    assert law.error <= 1e-11


ARM = """<robot name="arm"><link name="base"/><link name="tool"/><joint name="joint1" type="revolute">
  <origin xyz="0 0 0"/><parent link="base"/><child link="link"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint><link name="link"/>
  <joint name="bolt" type="fixed"><parent link="link"/><child link="tool"/><origin xyz="1 0 0"/></joint></robot>"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*use analyze:precision_pin.base.errors.PrecisionPinWarning")
def test_a_law_that_is_not_that_of_the_exact_model_is_said():
    """A link along x turned by θ: dx = cos θ - 1 does not vary at first order, dy = sin θ is nonlinear for ±1.5 rad."""
    chain = chain_of(ARM, tip="tool", gravity=(0, 0, 0))
    wide, narrow = (
        exact_law(ErrorModel(chain, Space(), [JointOffset(joint="joint1", offset=laws.Uniform(reach))]), [0.0]).poses[0]
        for reach in (1.5, 1e-9)
    )
    assert any(line.startswith("dx: does not vary at first order") for line in wide.warnings)
    assert any(line.startswith("dy: ") and "the model is nonlinear" in line for line in wide.warnings)
    assert not any(line.startswith("δz") for line in wide.warnings)
    assert narrow.warnings == ()
    assert wide.to_dict()["warnings"] == list(wide.warnings)


def test_bounds_are_rounded_up_and_quantiles_cut_to_what_is_known():
    assert [bound_text(bound) for bound in (1e-14, 2.1e-14, 9.5e-13, 0.0)] == ["1e-14", "3e-14", "1e-12", "0"]
    assert quantile_digits(12.345678, 1e-12, 6) == 6
    # 12.35 is known to half a unit of the last digit, 12.346 is not
    assert quantile_digits(12.345678, 0.004, 6) == 4
    assert quantile_digits(1.0, 10.0, 6) == 1
