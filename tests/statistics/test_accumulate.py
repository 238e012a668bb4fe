"""Accumulators and histograms against numpy and exact sums on kept samples; targets and specifications; precision reached."""

import itertools
import math
import time

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.budget.budget import check_quantities
from precision_pin.base.errors import InputError, InternalError, UnknownNameError
from precision_pin.render.tables import symbol
from precision_pin.statistics import (
    QUANTITIES,
    Distribution,
    Plan,
    Specification,
    State,
    Summary,
    finish,
    observe,
    quantity_values,
    start,
)
from precision_pin.statistics.accumulate import BINS, COLUMNS, LARGEST, lane_sums, merge, sketch_columns, sketch_edges
from precision_pin.statistics.plan import quantity_name, specification
from precision_pin.statistics.precision import Precision, Target, reached, target

SPECIFICATIONS = (Specification("position.norm", 1.5e-3, 0.5), Specification("attitude.x", 1e-3, 0.5))


def correlated_errors(seed: int, samples: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    mixing = generator.standard_normal((6, 6)) * np.array([1, 1, 1, 2, 2, 2])[:, None] * 5e-4
    return mixing @ generator.standard_normal((6, samples))


def plan_for(errors: np.ndarray, specifications: tuple[Specification, ...] = SPECIFICATIONS) -> Plan:
    return Plan.from_moments(errors.mean(axis=1), np.cov(errors), specifications)


def seen(plan: Plan, errors: np.ndarray) -> State:
    return observe(plan, start(plan), errors)


def summary_of(plan: Plan, errors: np.ndarray) -> Summary:
    return finish(plan, seen(plan, errors))


def test_quantities_are_the_norms_and_components_in_the_stated_order() -> None:
    errors = np.array([[3.0], [4.0], [12.0], [2.0], [3.0], [6.0]])
    np.testing.assert_array_equal(quantity_values(errors)[:, 0], [13, 3, 4, 12, 7, 2, 3, 6])
    assert (QUANTITIES[0], QUANTITIES[4]) == ("position.norm", "attitude.norm")


def test_moments_extremes_and_counts_equal_numpy_on_kept_samples() -> None:
    errors = correlated_errors(1, 40_000)
    summary = summary_of(plan_for(errors), errors)
    values = quantity_values(errors)
    found = [summary.distribution(quantity) for quantity in QUANTITIES]
    np.testing.assert_allclose([one.mean for one in found], values.mean(axis=1), rtol=1e-13, atol=1e-18)
    np.testing.assert_allclose([one.std for one in found], values.std(axis=1, ddof=1), rtol=1e-12)
    np.testing.assert_array_equal([(one.min, one.max) for one in found], [(row.min(), row.max()) for row in values])
    np.testing.assert_allclose(summary.mean, errors.mean(axis=1), rtol=0, atol=1e-18)
    np.testing.assert_allclose(summary.covariance, np.cov(errors), rtol=1e-11, atol=1e-20)
    np.testing.assert_array_equal(summary.covariance, summary.covariance.T)
    inside = [np.mean(values[0] <= 1.5e-3), np.mean(np.abs(values[5]) <= 1e-3)]
    assert [result.probability for result in summary.specifications] == inside


def test_moments_keep_twelve_digits_when_the_mean_is_370_deviations_away() -> None:
    samples, deviation, mean = 100_000, 1e-4, 370e-4
    errors = np.random.default_rng(2).standard_normal((6, samples)) * deviation + mean
    # the centre is off by a tenth of a deviation, as a planned mean is; that of the norm is farther off
    centre = np.full(8, mean + deviation / 10)
    centre[[0, 4]] = mean * math.sqrt(3)
    summary = summary_of(Plan(centre, np.full(8, deviation)), errors)
    for row in (0, 1, 7):
        distribution, values = summary.distribution(QUANTITIES[row]), quantity_values(errors)[row]
        # by exactly rounded sums of the residuals
        about = math.fsum(values) / samples
        remainder, square = math.fsum(values - about), math.fsum((values - about) ** 2)
        assert distribution.mean == pytest.approx(about + remainder / samples, rel=1e-15)
        variance = (square - remainder**2 / samples) / (samples - 1)
        assert distribution.std == pytest.approx(math.sqrt(variance), rel=1e-12)


def test_lanes_add_in_the_documented_order() -> None:
    row = np.random.default_rng(3).standard_normal(2 * 128 + 16 * 4 + 5)
    order = [span + half + k for span in (0, 128, 256) for half in (0, 1) for k in range(0, 128, 2)]
    lanes = [0.0] * 16
    for place, sample in enumerate(order):
        if sample < row.size:
            lanes[place % 16] += row[sample]
    while len(lanes) > 1:
        half = len(lanes) // 2
        lanes = [lanes[i] + lanes[i + half] for i in range(half)]
    assert lane_sums(row[None])[0] == lanes[0]
    assert lanes[0] == pytest.approx(math.fsum(row), abs=1e-13)


def test_counts_do_not_depend_on_partition_or_order() -> None:
    errors = correlated_errors(4, 5_000)
    plan = plan_for(errors)
    whole = seen(plan, errors)
    generator = np.random.default_rng(1)
    cuts = np.sort(generator.integers(0, errors.shape[1], size=8))
    blocks = [seen(plan, part) for part in np.split(generator.permutation(errors, axis=1), cuts, axis=1)]
    # a random tree of merges, not only from left to right
    while len(blocks) > 1:
        index = int(generator.integers(len(blocks) - 1))
        blocks[index : index + 2] = [merge(blocks[index], blocks[index + 1])]
    (parts,) = blocks
    assert parts.count == whole.count == 5_000
    for name in ("sketch", "inside", "lowest", "highest"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_allclose(parts.sums, whole.sums, rtol=0, atol=1e-15)
    np.testing.assert_allclose(parts.products, whole.products, rtol=0, atol=1e-16)
    np.testing.assert_allclose(parts.norm_squares, whole.norm_squares, rtol=1e-13)


def test_one_sample_and_two() -> None:
    errors = np.array([[1e-3, 2e-3], [0, 0], [0, 1e-3], [0, 0], [0, 0], [1e-4, 3e-4]])
    plan = Plan(np.zeros(8), np.full(8, 1e-3), SPECIFICATIONS)
    one, two = summary_of(plan, errors[:, :1]), summary_of(plan, errors)
    norm = one.position.norm
    unresolved = (norm.std, norm.resolved_quantile(0.5), norm.mode, norm.resolution("mean"), norm.to_dict()["std"])
    assert (one.covariance, *unresolved) == (None,) * 6
    assert norm.mean == norm.min == norm.max == 1e-3
    assert one.specifications[0].interval == (pytest.approx(0.025), 1.0)
    x = two.position.x
    assert (x.mean, x.std, two.position.y.std) == pytest.approx((1.5e-3, 5e-4 * math.sqrt(2), 0), rel=1e-12)
    assert two.covariance[0, 2] == pytest.approx(5e-7, rel=1e-12)
    assert not two.covariance[1].any()


def test_a_constant_quantity_has_no_spread_whatever_the_centre() -> None:
    errors = np.full((6, 1000), 0.1)
    summary = summary_of(Plan(np.full(8, 0.3), np.full(8, 1e-3), skewness=np.zeros((8, 2))), errors)
    for one in map(summary.distribution, QUANTITIES):
        value = one.min
        assert [one.mean, one.max, one.mode, one.quantile(0.95), *one.quantile_interval(0.95)] == [value] * 6
        assert (one.std, one.std_interval(), one.histogram(), one.resolution("mean")) == (0.0, (0.0, 0.0), None, 6)
    assert not summary.covariance.any()
    # where nothing is known of the laws, samples all alike do not tell that others are
    found = summary_of(Plan(np.full(8, 0.3), np.full(8, 1e-3)), errors).position.x
    assert (found.mean_interval(), found.std_interval()) == (None, None)


def test_what_cannot_be_is_refused() -> None:
    plan, other = Plan(np.zeros(8), np.ones(8), SPECIFICATIONS), Plan(np.zeros(8), np.ones(8))
    for bad in (math.nan, math.inf, 1e200):
        errors = np.zeros((6, 10))
        errors[1, 7] = bad
        with pytest.raises(InternalError, match=r"sample 7 of the block has position\.(y|norm)"):
            seen(other, errors)
    one = seen(other, np.zeros((6, 1)))
    for wrong, error, message in (
        (lambda: seen(plan, np.zeros((5, 3))), InternalError, r"shape \(6, N\)"),
        (lambda: merge(start(plan), start(other)), InternalError, "specifications"),
        (lambda: finish(plan, start(plan)), InternalError, "no samples"),
        (lambda: finish(plan, one), InternalError, "specifications"),
        (lambda: Plan(np.zeros(6), np.ones(8)), InternalError, "eight"),
        (lambda: Plan(np.zeros(8), -np.ones(8)), InternalError, "not negative"),
        (lambda: finish(other, one, confidence=95), InputError, "confidence"),
        (lambda: Specification("position.xx", 1.0, 0.5), UnknownNameError, r"position\.x"),
    ):
        with pytest.raises(error, match=message):
            wrong()
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="above 0"):
            Specification("position.x", bad, 0.5)
    for bad in (0.0, 1.0, 95.0, math.nan):
        with pytest.raises(InputError, match="below 100 %"):
            Specification("position.x", 1.0, bad)


def test_a_value_at_the_limit_is_inside_and_the_next_float_is_not() -> None:
    plan = Plan(np.zeros(8), np.ones(8), (Specification("position.x", 2e-3, 0.5),))
    beyond = np.nextafter(2e-3, 1)
    assert seen(plan, np.outer(np.eye(6)[0], [2e-3, -2e-3, beyond, -beyond])).inside[0] == 2


def test_scales_become_powers_of_two_and_are_never_zero() -> None:
    for given, scale in (
        ([1e-3, 2.0, 0.7, 0.72, 0, 0, 0, 0], [2.0**-10, 2, 0.5, 1, *[2.0**-30] * 4]),
        ([4.0, 0, 1, 1, 1, 1e-300, 1, 1], [4, 2.0**-8, 1, 1, 1, 2.0**-40, 1, 1]),
    ):
        np.testing.assert_array_equal(Plan(np.zeros(8), np.array(given)).scale, scale)


def test_planned_norms_are_near_the_true_ones() -> None:
    # isotropic: mean 1.5958, deviation 0.6734; far from zero along x: mean 10.1, deviation 1
    for x, mean, off, scales in ((0, 1.5958, 0.02, (0.5, 1.0)), (10.0, 10.1, 0.01, (1.0,))):
        plan = Plan.from_moments(x * np.eye(6)[0], np.eye(6))
        assert plan.centre[0] == pytest.approx(mean, rel=off)
        assert plan.scale[0] in scales
    assert Plan.from_moments(np.zeros(6), np.zeros((6, 6))).centre[0] == 0.0


def test_of_equal_norms_the_earlier_sample_is_listed_first_in_whatever_parts_they_come() -> None:
    errors = correlated_errors(3, 3 * LARGEST)
    errors[:, -1] = errors[:, 0] = 9.0
    plan = plan_for(errors)
    state = start(plan)
    for part in np.array_split(errors, 3, axis=1):
        state = observe(plan, state, part)
    assert [one.sample for one in finish(plan, state).largest_attitude[:2]] == [0, 3 * LARGEST - 1]
    np.testing.assert_array_equal(state.largest_units, seen(plan, errors).largest_units)


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


def test_columns_lie_between_their_edges_and_are_as_narrow_as_promised() -> None:
    values = np.sort(np.random.default_rng(1).standard_cauchy(20_000))
    columns, edges = sketch_columns(values), sketch_edges()
    assert edges.size == COLUMNS + 1
    assert min(np.diff(edges).min(), 1 + np.diff(columns).min()) > 0
    assert ((edges[columns] <= values) & (values <= edges[columns + 1])).all()
    inner = edges[1:-1]
    nearest = np.minimum(np.abs(inner[:-1]), np.abs(inner[1:]))
    assert (np.diff(inner) <= np.maximum(2.0**-12, 2.0**-9 * nearest)).all()


LAWS = {
    "far from zero": (20_001, lambda g, n: 0.37 + 1e-3 * g.standard_normal(n)),
    "heavy tail": (1500, lambda g, n: 1e-3 * g.standard_t(2, n)),
    "lattice": (1500, lambda g, n: 1e-3 * g.integers(-3, 4, n)),
    "tiny against the plan": (20_001, lambda g, n: 1e-9 * g.standard_normal(n)),
    "huge against the plan": (20_001, lambda g, n: 10 * g.standard_normal(n)),
}


@pytest.mark.parametrize("law", LAWS)
def test_quantiles_and_cumulative_are_those_of_kept_samples_but_for_a_bin(law: str) -> None:
    samples, draw = LAWS[law]
    values = draw(np.random.default_rng(7), samples)
    centre = 0.37 if law == "far from zero" else 0.0
    plan = Plan(np.full(8, centre), np.full(8, 2.0**-10))
    state = seen(plan, np.outer(np.eye(6)[0], values))
    x = finish(plan, state).position.x
    ordered = np.sort(values)
    rounding = 4 * np.finfo(float).eps * (abs(centre) + np.abs(values).max())
    levels = np.array([0.01, 0.05, 0.3, 0.5, 0.77, 0.95, 0.99])
    found = [x.quantile(p) for p in levels]
    assert (np.diff([ordered[0], *found, ordered[-1]]) >= 0).all()
    most = state.sketch[1].max() / samples
    for p, seen_there, expected in zip(levels, found, np.quantile(values, levels), strict=True):
        below = math.floor((samples - 1) * p)
        distance = np.abs(ordered[below : below + 2] - centre).max() * 2**10
        if distance >= 256:
            continue  # beyond the sketch: only the interval is promised there
        assert abs(seen_there - expected) <= max(2.0**-12, 2.0**-9 * distance) * 2**-10 + rounding
        low, high = x.quantile_interval(p)
        assert low <= expected <= high
        point = expected + 1e-7
        assert abs(x.cdf(point) - np.mean(values <= point)) <= most + 1e-12
        inside = np.mean(np.abs(values) <= abs(point))
        assert abs(x.probability_inside(abs(point)) - inside) <= 2 * most + 1e-12
    assert x.cdf(ordered[-1]) == x.probability_inside(np.abs(values).max() + 1) == 1.0
    assert x.cdf(np.nextafter(ordered[0], -100)) == x.probability_inside(-1.0) == 0.0


def test_the_histogram_holds_every_sample_in_as_many_bars_as_sturges_or_freedman_and_diaconis_advise() -> None:
    for samples in (2, 100, 30_000):
        errors = np.random.default_rng(samples).standard_normal((6, samples)) * 1e-3
        y = summary_of(Plan(np.zeros(8), np.full(8, 1e-3)), errors).attitude.y
        histogram = y.histogram()
        assert histogram.density @ np.diff(histogram.edges) == pytest.approx(1.0, abs=1e-12)
        assert (histogram.edges[0], histogram.edges[-1]) == (errors[4].min(), errors[4].max())
        assert histogram.density.min() >= 0
        assert abs(histogram.density.size + 1 - np.histogram_bin_edges(errors[4], "auto").size) <= 1
    bars = y.histogram(20)
    expected, _ = np.histogram(errors[4], bins=bars.edges, density=True)
    np.testing.assert_allclose(bars.density, expected, atol=0.01 * expected.max())


def test_what_a_text_means() -> None:
    for text, quantity, statistic, tolerance, relative in (
        ("95 % to 0.01 mm", "position.norm", 0.95, 1e-5, False),
        ("std to 1 %", "position.norm", "std", 0.01, True),
        ("x95% to 0.01mm", "position.x", 0.95, 1e-5, False),
        ("99 % to 1 deg", "attitude.norm", 0.99, math.pi / 180, False),
        ("rz mean to 20 ppm", "attitude.z", "mean", 2e-5, True),
        ("attitude.y 0.5 to 1e-3 mrad", "attitude.y", 0.5, 1e-6, False),
        ("  position   1e-1\tto  2 mm \n", "position.norm", 0.1, 2e-3, False),
    ):
        found = target(text)
        assert (found.quantity, found.relative) == (quantity, relative), text
        near = statistic if isinstance(statistic, str) else pytest.approx(statistic, rel=1e-15)
        assert (found.statistic, found.tolerance) == (near, pytest.approx(tolerance, rel=1e-15)), text


WRONG_TARGETS = {
    "": "write it as",
    "95 %": "write it as",
    "xmean to 1 mm": "write it as",
    "5 mm to 1 mm": "write it as",
    "mean to 1": "a length, an angle or a share",
    "mean to 1 kg": "'kg' is none of m, cm,",
    "mean to nan mm": "expected a number",
    "mean to 1 2 mm": "2 numbers, expected 1",
    "mean to 0 mm": "tolerance must be positive",
    "0 % to 1 mm": "above 0 and below 1",
    "100 % to 1 mm": "above 0 and below 1",
    "95 to 0.01 mm": "did you mean '95 %'?",
    "95 % to 0.01": "the tolerance 0.01 has no unit",
    "x 95 % to 1 mrad": "the tolerance of x is a length",
    "attitude 95 % to 1 mm": "the tolerance of attitude is an angle",
    "positon 95 % to 1 mm": "'positon'; did you mean 'position'",
}


def of_values(values: np.ndarray, confidence: float = 0.95) -> Distribution:
    """Return the distribution of values seen, each in a bin of its own, of laws known to be no more skewed than that."""
    rising, count = np.sort(values), values.size
    moments, ends = (float(values.mean()), float(values.std(ddof=1))), (float(rising[0]), float(rising[-1]))
    bins = (rising, rising, np.arange(1, count + 1))
    return Distribution("position.x", count, confidence, *moments, *ends, *bins, skewness=(0.0, 0.0))


def reached_by(values: np.ndarray, statistic: float | str, tolerance: float, *, relative: bool = False) -> Precision:
    return reached(Target("position.x", statistic, tolerance, relative), of_values(values))


def test_of_a_mean_it_is_students_standard_errors_and_the_samples_needed_go_with_its_square():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    # Student's quantile; skewness, here that of 400 normal numbers, changes it by less than a hundredth
    half = stats.t(399).ppf(0.975) * values.std(ddof=1) / 20
    found = reached_by(values, "mean", half * 1.01)
    assert found.reached
    assert found.half_width == pytest.approx(half, rel=0.01)
    assert found.needed(400) == 400
    found = reached_by(values, "mean", half / 3)
    assert not found.reached
    assert found.needed(400) == pytest.approx(9 * 400, rel=2e-2)
    assert not reached_by(values, "mean", half * 0.99).reached
    shared = reached_by(values, "mean", 0.05, relative=True)
    assert shared.tolerance == pytest.approx(0.05 * abs(values.mean()))
    assert shared.reached == (half <= 0.05 * abs(values.mean()))


def test_of_a_quantile_it_is_the_farther_order_statistic():
    """Of 1 … 100 the median's 95 % interval is from the 40th to the 61st (David and Nagaraja, table of binomial tails)."""
    values = np.arange(1.0, 101.0)
    tails = stats.binom(100, 0.5)
    assert tails.cdf(39) <= 0.025 < tails.cdf(40)
    assert reached_by(values, 0.5, 10.6).half_width == pytest.approx(50.5 - 40, rel=1e-12)
    assert [reached_by(values, 0.5, tolerance).reached for tolerance in (10.6, 10.4)] == [True, False]


def test_of_a_standard_deviation_it_follows_the_fourth_moment():
    """Of a normal law the standard error of s is σ/√(2N); of a uniform one, with kurtosis 9/5, σ √(0.8/(4N))."""
    generator = np.random.default_rng(2)
    for values, kurtosis in ((generator.normal(size=40_000), 3.0), (generator.uniform(-1, 1, 40_000), 1.8)):
        found = reached_by(values, "std", 0.01, relative=True)
        half = 1.959964 * values.std() * math.sqrt((kurtosis - 1) / 4 / 40_000)
        # a little wider, for tails that the samples may not show
        assert 0.99 * half < found.half_width < 1.06 * half
        assert found.reached


def test_of_a_summary_the_quantity_is_picked():
    errors = np.random.default_rng(3).normal(size=(6, 5000)) * np.array([1, 2, 3, 4, 5, 6])[:, None] * 1e-3
    summary = summary_of(plan_for(errors), errors)
    found = reached(target("rx mean to 1 mrad"), summary)
    assert found.half_width == pytest.approx(1.959964 * errors[3].std(ddof=1) / math.sqrt(5000), rel=2e-3)
    with pytest.raises(InputError, match=r"position\.x, the distribution of position\.norm"):
        reached(target("x mean to 1 mm"), summary.position.norm)


def test_what_is_not_resolved_is_not_reached():
    few = np.arange(20.0)
    for statistic in ("mean", "std", 0.99):
        found = reached_by(few, statistic, 1e9)
        assert (found.half_width, found.reached, found.needed(20)) == (None, False, None)
    assert not reached_by(few, 0.99, 0.5, relative=True).reached
    # what does not vary is
    for relative, value in itertools.product((False, True), (2.0, 0.0)):
        assert reached_by(np.full(100, value), "mean", 1e-9, relative=relative).reached


@pytest.mark.slow
@pytest.mark.parametrize(("statistic", "least"), [("mean", 0.93), ("std", 0.94), (0.95, 0.93)])
def test_stopping_at_doubled_looks_costs_little_coverage(statistic, least):
    """Checks at 512, 1024, … samples of a skewed law: intervals of stopped runs cover less often than the stated 95 %.

    Mean and quantile lose no more than 2 percentage points, a standard deviation, whose interval is wide enough for worse
    tails, no more than 1; where just so much is lost, 200 runs fail with probability 1e-4.
    """
    law, generator, runs = stats.gamma(4.0), np.random.default_rng(6), 200
    truth = {"mean": law.mean(), "std": law.std()}.get(statistic, law.ppf(0.95))
    # the middle of the half-widths at the third look: about half of the runs stop there, those with small spreads
    widths = [of_values(law.rvs(2048, random_state=generator)).half_width(statistic) for _ in range(60)]
    tolerance = float(np.median([width for width in widths if width is not None]))
    hits, stops = 0, set()
    for _ in range(runs):
        values = law.rvs(8192, random_state=generator)
        looks = (of_values(values[: 512 * 2**k]) for k in range(5))
        wanted = Target("position.x", statistic, tolerance, False)
        seen = next(look for look in looks if reached(wanted, look).reached)
        stops.add(seen.samples)
        low, high = seen.interval(statistic)
        hits += low <= truth <= high
    assert len(stops) > 1
    assert hits >= stats.binom.ppf(1e-4, runs, least)


def test_a_limit_may_be_written_in_many_ways() -> None:
    for text in ("z 0.2 mm @ 99 %", "dz ≤ 0.2mm @ 0.99", "position.z<=0.2 mm@99%", " |dz| < 0.2 mm @ 99 % "):
        found = specification(text)
        assert (found.quantity, found.limit, found.required) == ("position.z", pytest.approx(2e-4), pytest.approx(0.99))
    assert specification("1 mm @ 0.0095").required == 0.0095
    assert specification("1 mm @ 1 %").required == 0.01


SLIPS = {
    "1 mm @ 95": "did you mean '95 %'?",
    "1 mm @ 1": "no number of samples shows that all robots are inside",
    "1 mm @ 100 %": "no number of samples shows that all robots are inside",
    "1 mm @ 120": "above 0 and below 1",
    "1 mm @ 0.95 %": "did you mean '95 %'? (or the plain ratio 0.0095)",
    "1 mm @ 0.9973%": "did you mean '99.73 %'?",
    "37 mm @ 100 ppm": "the probability is the share of robots inside; write '99.99 %'",
    "1 mm @ 0.5ppm": "write '99.99995 %'",
    "0.3": "'0.3' has no unit: '0.3 mm' limits the position, '0.3 mrad' the attitude",
    "x 0.3 @ 95 %": "'0.3' has no unit",
    "1 mm @": "write it as",
    "inf mm": "expected a number with a unit",
    "dw 1 mm": "no quantity of a specification named 'dw'",
    "dx 1 mrad": "dx is limited by a length",
    "|δ| 1 mm": "|δ| is limited by an angle",
    "5 rad": "no attitude error is larger than half a turn; did you mean deg, or mrad?",
    "rx 200 deg": "no attitude error is larger than half a turn; did you mean mrad?",
}


def test_slips_get_one_line() -> None:
    for read, slips in ((target, WRONG_TARGETS), (specification, SLIPS)):
        for text, says in slips.items():
            with pytest.raises(InputError) as raised:
                read(text)
            assert says in str(raised.value), text
            assert "\n" not in str(raised.value), text


def test_long_texts_take_no_time() -> None:
    begun, long = time.process_time(), 50_000
    for text in (" " * long + "x", "x" + " " * long + "@", "a." * long + "1", "|" * long, "1 mm" + " " * long + "é"):
        for read in (specification, target):
            with pytest.raises(InputError):
                read(text)
    assert time.process_time() - begun < 2


def test_every_word_is_known_everywhere() -> None:
    errors = correlated_errors(1, 50)
    summary = summary_of(plan_for(errors), errors)
    words = [("position", "|d|"), ("x", "dx"), ("y", "dy"), ("z", "dz")]
    words += [("attitude", "|δ|"), ("rx", "δx"), ("ry", "δy"), ("rz", "δz")]
    for name, others in zip(QUANTITIES, words, strict=True):
        unit = "mm" if name.startswith("position") else "mrad"
        for word in (name, *others, symbol(name)):
            assert quantity_name(word) == name
            assert pp.specification(f"{word} 1 {unit}").quantity == name
            assert target(f"{word} mean to 1 %").quantity == target(f"{word} 95 % to 1 {unit}").quantity == name
            assert Specification(word, 1e-3, 0.9) == Specification(name, 1e-3, 0.9)
            assert summary.distribution(word) is summary.distribution(name)
            # in a budget, position and attitude are all three components together
            assert check_quantities([word]) == (word if word in ("position", "attitude") else name,)
    for word in ("d", "norm", "position.w", "", "Z"):
        for ask in (quantity_name, summary.distribution, lambda word: check_quantities([word])):
            with pytest.raises(pp.InputError, match="quantity"):
                ask(word)
