"""The float-bits histogram: its bins, its edges, and the error of the quantiles read from it."""

import math

import numpy as np
import pytest

from precision_pin.statistics import Plan, finish, observe, start
from precision_pin.statistics.accumulate import BINS, COLUMNS, sketch_columns, sketch_edges


def column_by_logarithm(value: float) -> int:
    """Column worked out from exponent and mantissa, without looking at bits."""
    magnitude = abs(value)
    mantissa, exponent = math.frexp(magnitude)
    octave = exponent - 1 + 12
    small = magnitude == 0 or octave < 0
    bin_ = 0 if small else min(1 + 512 * octave + math.floor((2 * mantissa - 1) * 512), BINS - 1)
    return BINS - 1 - bin_ if value < 0 else BINS + bin_


def test_bins_are_512_an_octave_from_2_to_the_minus_12_to_2_to_the_8() -> None:
    assert BINS == 1 + 20 * 512
    generator = np.random.default_rng(0)
    values = generator.choice([-1, 1], 3000) * 2.0 ** generator.uniform(-16, 12, 3000)
    values = np.concatenate((values, [0.0, -0.0, 2**-12, -(2**-12), np.nextafter(2**-12, 0), 1, 256, 1e300, -1e300]))
    expected = [column_by_logarithm(float(value)) for value in values]
    np.testing.assert_array_equal(sketch_columns(values), expected)


def test_columns_ascend_with_the_value_and_lie_between_their_edges() -> None:
    values = np.sort(np.random.default_rng(1).standard_cauchy(20_000))
    columns = sketch_columns(values)
    edges = sketch_edges()
    assert edges.size == COLUMNS + 1
    assert (np.diff(edges) > 0).all()
    assert (np.diff(columns) >= 0).all()
    assert (edges[columns] <= values).all()
    assert (values <= edges[columns + 1]).all()


def test_bins_are_as_narrow_as_promised() -> None:
    edges = sketch_edges()
    inner = edges[1:-1]
    widths = np.diff(inner)
    nearest = np.minimum(np.abs(inner[:-1]), np.abs(inner[1:]))
    assert (widths <= np.maximum(2.0**-12, 2.0**-9 * nearest)).all()


LAWS = {
    "normal": lambda g, n: 2e-3 + 1e-3 * g.standard_normal(n),
    "far from zero": lambda g, n: 0.37 + 1e-3 * g.standard_normal(n),
    "heavy tail": lambda g, n: 1e-3 * g.standard_t(2, n),
    "lognormal": lambda g, n: 1e-3 * g.lognormal(0, 1, n),
    "two lumps": lambda g, n: g.choice([-1e-3, 1e-3], n) + 1e-5 * g.standard_normal(n),
    "lattice": lambda g, n: 1e-3 * g.integers(-3, 4, n),
    "tiny against the plan": lambda g, n: 1e-9 * g.standard_normal(n),
    "huge against the plan": lambda g, n: 10 * g.standard_normal(n),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("samples", [1500, 20_001])
def test_quantiles_differ_from_those_of_kept_samples_by_no_more_than_a_bin(law: str, samples: int) -> None:
    values = LAWS[law](np.random.default_rng(7), samples)
    errors = np.zeros((6, samples))
    errors[0] = values
    centre = 0.37 if law == "far from zero" else 0.0
    plan = Plan(np.full(8, centre), np.full(8, 2.0**-10))
    x = finish(plan, observe(plan, start(plan), errors)).position.x
    ordered = np.sort(values)
    rounding = 4 * np.finfo(float).eps * (abs(centre) + np.abs(values).max())
    for p in (0.01, 0.05, 0.3, 0.5, 0.77, 0.95, 0.99):
        expected = np.quantile(values, p)
        below = math.floor((samples - 1) * p)
        distance = np.abs(ordered[below : below + 2] - centre).max() * 2**10
        bound = max(2.0**-12, 2.0**-9 * distance) * 2**-10
        if distance >= 256:
            continue  # beyond the sketch: only the interval is promised there
        assert abs(x.quantile(p) - expected) <= bound + rounding
        low, high = x.quantile_interval(p)
        assert low <= expected <= high


@pytest.mark.parametrize("law", LAWS)
def test_quantiles_stay_between_the_extremes_and_ascend(law: str) -> None:
    values = LAWS[law](np.random.default_rng(8), 3000)
    errors = np.zeros((6, values.size))
    errors[0] = values
    plan = Plan(np.zeros(8), np.full(8, 2.0**-10))
    x = finish(plan, observe(plan, start(plan), errors)).position.x
    quantiles = [x.quantile(p) for p in np.linspace(0.01, 0.99, 99)]
    assert values.min() <= quantiles[0]
    assert quantiles[-1] <= values.max()
    assert (np.diff(quantiles) >= 0).all()


@pytest.mark.parametrize("law", ["normal", "far from zero", "heavy tail", "lattice"])
def test_the_cumulative_distribution_is_off_by_no_more_than_one_bins_samples(law: str) -> None:
    values = LAWS[law](np.random.default_rng(9), 4000)
    errors = np.zeros((6, values.size))
    errors[0] = values
    centre = 0.37 if law == "far from zero" else 0.0
    plan = Plan(np.full(8, centre), np.full(8, 2.0**-10))
    state = observe(plan, start(plan), errors)
    x = finish(plan, state).position.x
    most = state.sketch[1].max() / values.size
    for point in np.quantile(values, [0.001, 0.2, 0.5, 0.9, 0.999]) + 1e-7:
        assert abs(x.cdf(point) - np.mean(values <= point)) <= most + 1e-12
        inside = np.mean(np.abs(values) <= abs(point))
        assert abs(x.probability_inside(abs(point)) - inside) <= 2 * most + 1e-12
    assert x.cdf(values.max()) == 1.0
    assert x.cdf(np.nextafter(values.min(), -1)) == 0.0
    assert x.probability_inside(10.0) == 1.0
    assert x.probability_inside(-1.0) == 0.0


def test_the_histogram_holds_every_sample() -> None:
    for samples in (2, 5, 100, 30_000):
        errors = np.random.default_rng(samples).standard_normal((6, samples)) * 1e-3
        plan = Plan(np.zeros(8), np.full(8, 1e-3))
        histogram = finish(plan, observe(plan, start(plan), errors)).attitude.y.histogram()
        assert histogram.density @ np.diff(histogram.edges) == pytest.approx(1.0, abs=1e-12)
        assert histogram.edges[0] == errors[4].min()
        assert histogram.edges[-1] == errors[4].max()
        assert (histogram.density >= 0).all()
        assert histogram.density.size <= 100
    bars = finish(plan, observe(plan, start(plan), errors)).attitude.y.histogram(20)
    expected, _ = np.histogram(errors[4], bins=bars.edges, density=True)
    np.testing.assert_allclose(bars.density, expected, atol=0.01 * expected.max())
