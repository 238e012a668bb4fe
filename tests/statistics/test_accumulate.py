"""Moments, counts and extremes of the accumulators, against numpy and exact sums on kept samples."""

import math

import numpy as np
import pytest

from precision_pin.base.errors import InputError, InternalError, UnknownNameError
from precision_pin.statistics import QUANTITIES, Plan, Specification, finish, observe, quantity_values, start
from precision_pin.statistics.accumulate import COLUMNS, LARGEST, lane_sums, merge

SPECIFICATIONS = (
    Specification("position.norm", 1.5e-3, 0.5),
    Specification("attitude.x", 1e-3, 0.5),
)
TILE = 1 << 14


def correlated_errors(seed: int, samples: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    mixing = generator.standard_normal((6, 6)) * np.array([1, 1, 1, 2, 2, 2])[:, None] * 5e-4
    return mixing @ generator.standard_normal((6, samples))


def plan_for(errors: np.ndarray, specifications: tuple[Specification, ...] = SPECIFICATIONS) -> Plan:
    return Plan.from_moments(errors.mean(axis=1), np.cov(errors), specifications)


def test_quantities_are_the_norms_and_components_in_the_stated_order() -> None:
    errors = np.array([[3.0], [4.0], [12.0], [2.0], [3.0], [6.0]])
    np.testing.assert_array_equal(quantity_values(errors)[:, 0], [13, 3, 4, 12, 7, 2, 3, 6])
    assert QUANTITIES[0] == "position.norm"
    assert QUANTITIES[4] == "attitude.norm"


def test_moments_extremes_and_counts_equal_numpy_on_kept_samples() -> None:
    errors = correlated_errors(1, 40_000)
    plan = plan_for(errors)
    summary = finish(plan, observe(plan, start(plan), errors))
    values = quantity_values(errors)
    for row, quantity in enumerate(QUANTITIES):
        distribution = summary.distribution(quantity)
        assert distribution.mean == pytest.approx(values[row].mean(), rel=1e-13, abs=1e-18)
        assert distribution.std == pytest.approx(values[row].std(ddof=1), rel=1e-12)
        assert distribution.min == values[row].min()
        assert distribution.max == values[row].max()
    np.testing.assert_allclose(summary.mean, errors.mean(axis=1), rtol=0, atol=1e-18)
    np.testing.assert_allclose(summary.covariance, np.cov(errors), rtol=1e-11, atol=1e-20)
    np.testing.assert_array_equal(summary.covariance, summary.covariance.T)
    inside = [np.mean(values[0] <= 1.5e-3), np.mean(np.abs(values[5]) <= 1e-3)]
    assert [result.probability for result in summary.specifications] == inside


@pytest.mark.slow
def test_moments_keep_twelve_digits_when_the_mean_is_370_deviations_away() -> None:
    samples, deviation, mean = 1_000_000, 1e-4, 370e-4
    errors = np.random.default_rng(2).standard_normal((6, samples)) * deviation + mean
    # the centre is off by a tenth of a deviation, as a planned mean is
    plan = Plan(np.full(8, mean + deviation / 10), np.full(8, deviation))
    summary = finish(plan, observe(plan, start(plan), errors))
    values = quantity_values(errors)
    for quantity in ("position.x", "attitude.z"):
        distribution = summary.distribution(quantity)
        exact_mean, exact_std = exact_moments(values[QUANTITIES.index(quantity)])
        assert distribution.mean == pytest.approx(exact_mean, rel=1e-15)
        assert distribution.std == pytest.approx(exact_std, rel=1e-12)
    plan = Plan(np.full(8, mean * math.sqrt(3)), np.full(8, deviation))
    norm = finish(plan, observe(plan, start(plan), errors)).position.norm
    exact_mean, exact_std = exact_moments(values[0])
    assert norm.mean == pytest.approx(exact_mean, rel=1e-15)
    assert norm.std == pytest.approx(exact_std, rel=1e-12)


def exact_moments(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation by exactly rounded sums of the residuals."""
    mean = math.fsum(values) / values.size
    residuals = values - mean
    remainder = math.fsum(residuals)
    square = math.fsum(residuals * residuals) - remainder**2 / values.size
    return mean + remainder / values.size, math.sqrt(square / (values.size - 1))


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


@pytest.mark.parametrize("seed", range(6))
def test_counts_do_not_depend_on_partition_or_order(seed: int) -> None:
    errors = correlated_errors(4, 5_000)
    plan = plan_for(errors)
    whole = observe(plan, start(plan), errors)
    generator = np.random.default_rng(seed)
    shuffled = errors[:, generator.permutation(errors.shape[1])] if seed % 2 else errors
    cuts = np.sort(generator.integers(0, errors.shape[1], size=generator.integers(1, 12)))
    blocks = [observe(plan, start(plan), part) for part in np.split(shuffled, cuts, axis=1)]
    generator.shuffle(blocks)
    # a random tree of merges, not only from left to right
    while len(blocks) > 1:
        index = int(generator.integers(len(blocks) - 1))
        blocks[index : index + 2] = [merge(blocks[index], blocks[index + 1])]
    (parts,) = blocks
    assert parts.count == whole.count == 5_000
    np.testing.assert_array_equal(parts.sketch, whole.sketch)
    np.testing.assert_array_equal(parts.inside, whole.inside)
    np.testing.assert_array_equal(parts.lowest, whole.lowest)
    np.testing.assert_array_equal(parts.highest, whole.highest)
    np.testing.assert_allclose(parts.sums, whole.sums, rtol=0, atol=1e-15)
    np.testing.assert_allclose(parts.products, whole.products, rtol=0, atol=1e-16)
    np.testing.assert_allclose(parts.norm_squares, whole.norm_squares, rtol=1e-13)


def test_blocks_of_whole_tiles_give_the_same_bits_as_one_block() -> None:
    errors = correlated_errors(5, 3 * TILE + 77)
    plan = plan_for(errors)
    whole = observe(plan, start(plan), errors)
    state = start(plan)
    for begin in range(0, errors.shape[1], TILE):
        state = observe(plan, state, errors[:, begin : begin + TILE])
    for name in ("sums", "products", "norm_squares", "sketch"):
        np.testing.assert_array_equal(getattr(state, name), getattr(whole, name))


def test_the_state_is_of_constant_size_and_is_not_changed_by_observing() -> None:
    errors = correlated_errors(6, 100)
    plan = plan_for(errors)
    empty = start(plan)
    once = observe(plan, empty, errors)
    assert empty.count == 0
    assert not empty.sketch.any()
    assert not empty.sums.any()
    assert once.sketch.shape == (8, COLUMNS)
    assert (once.sketch.sum(axis=1) == 100).all()
    assert observe(plan, once, np.zeros((6, 0))).count == 100


def test_one_sample_and_two() -> None:
    errors = np.array([[1e-3, 2e-3], [0, 0], [0, 1e-3], [0, 0], [0, 0], [1e-4, 3e-4]])
    plan = Plan(np.zeros(8), np.full(8, 1e-3), SPECIFICATIONS)
    one = finish(plan, observe(plan, start(plan), errors[:, :1]))
    assert one.covariance is None
    assert one.position.norm.std is None
    assert one.position.norm.mean == one.position.norm.min == one.position.norm.max == 1e-3
    assert one.position.norm.quantile(0.5) is None
    assert one.position.norm.mode is None
    assert one.position.norm.resolution("mean") is None
    assert one.specifications[0].interval == (pytest.approx(0.025), 1.0)
    assert one.position.norm.to_dict()["std"] is None
    two = finish(plan, observe(plan, start(plan), errors))
    assert two.position.x.std == pytest.approx(5e-4 * math.sqrt(2), rel=1e-12)
    assert two.position.x.mean == pytest.approx(1.5e-3, rel=1e-15)
    assert two.covariance[0, 2] == pytest.approx(5e-7, rel=1e-12)
    assert two.position.y.std == 0.0
    assert not two.covariance[1].any()


def test_a_constant_quantity_has_no_spread_whatever_the_centre() -> None:
    errors = np.full((6, 1000), 0.1)
    plan = Plan(np.full(8, 0.3), np.full(8, 1e-3), skewness=np.zeros((8, 2)))
    summary = finish(plan, observe(plan, start(plan), errors))
    for quantity in QUANTITIES:
        distribution = summary.distribution(quantity)
        value = distribution.min
        assert distribution.std == 0.0
        assert distribution.mean == distribution.max == distribution.mode == value
        assert distribution.quantile(0.95) == value
        assert distribution.quantile_interval(0.95) == (value, value)
        assert distribution.histogram() is None
        assert distribution.resolution("mean") == 6
        assert distribution.std_interval() == (0.0, 0.0)
    assert not summary.covariance.any()


def test_samples_all_alike_do_not_tell_that_others_are_where_nothing_is_known_of_the_laws() -> None:
    errors = np.full((6, 1000), 0.1)
    plan = Plan(np.full(8, 0.3), np.full(8, 1e-3))
    found = finish(plan, observe(plan, start(plan), errors)).position.x
    assert (found.mean_interval(), found.std_interval()) == (None, None)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e200])
def test_values_that_are_not_finite_are_refused_by_name(bad: float) -> None:
    errors = np.zeros((6, 10))
    errors[1, 7] = bad
    plan = Plan(np.zeros(8), np.ones(8))
    with pytest.raises(InternalError, match=r"sample 7 of the block has position\.(y|norm)"):
        observe(plan, start(plan), errors)


def test_wrong_shapes_and_states_are_refused() -> None:
    plan = Plan(np.zeros(8), np.ones(8), SPECIFICATIONS)
    other = Plan(np.zeros(8), np.ones(8))
    with pytest.raises(InternalError, match=r"shape \(6, N\)"):
        observe(plan, start(plan), np.zeros((5, 3)))
    with pytest.raises(InternalError, match="specifications"):
        merge(start(plan), start(other))
    with pytest.raises(InternalError, match="no samples"):
        finish(plan, start(plan))
    with pytest.raises(InternalError, match="specifications"):
        finish(plan, observe(other, start(other), np.zeros((6, 1))))
    with pytest.raises(InternalError, match="eight"):
        Plan(np.zeros(6), np.ones(8))
    with pytest.raises(InternalError, match="not negative"):
        Plan(np.zeros(8), -np.ones(8))
    with pytest.raises(InputError, match="confidence"):
        finish(plan, observe(plan, start(plan), np.zeros((6, 1))), confidence=95)


def test_a_value_at_the_limit_is_inside_and_the_next_float_is_not() -> None:
    limit = 2e-3
    plan = Plan(np.zeros(8), np.ones(8), (Specification("position.x", limit, 0.5),))
    errors = np.zeros((6, 4))
    errors[0] = [limit, -limit, np.nextafter(limit, 1), -np.nextafter(limit, 1)]
    assert observe(plan, start(plan), errors).inside[0] == 2


def test_specifications_say_what_is_allowed() -> None:
    with pytest.raises(UnknownNameError, match=r"position\.x"):
        Specification("position.xx", 1.0, 0.5)
    for limit in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="above 0"):
            Specification("position.x", limit, 0.5)
    for required in (0.0, 1.0, 95.0, math.nan):
        with pytest.raises(InputError, match="below 100 %"):
            Specification("position.x", 1.0, required)


def test_scales_become_powers_of_two_and_are_never_zero() -> None:
    scale = Plan(np.zeros(8), np.array([1e-3, 2.0, 0.7, 0.72, 0, 0, 0, 0])).scale
    np.testing.assert_array_equal(scale, [2.0**-10, 2, 0.5, 1, *[2.0**-30] * 4])
    scale = Plan(np.zeros(8), np.array([4.0, 0, 1, 1, 1, 1e-300, 1, 1])).scale
    np.testing.assert_array_equal(scale, [4, 2.0**-8, 1, 1, 1, 2.0**-40, 1, 1])


def test_planned_norms_are_near_the_true_ones() -> None:
    # isotropic: mean 1.5958, deviation 0.6734; far from zero along x: mean 10.1, deviation 1
    isotropic = Plan.from_moments(np.zeros(6), np.eye(6))
    assert isotropic.centre[0] == pytest.approx(1.5958, rel=0.02)
    assert isotropic.scale[0] in (0.5, 1.0)
    distant = Plan.from_moments(np.array([10.0, 0, 0, 0, 0, 0]), np.eye(6))
    assert distant.centre[0] == pytest.approx(10.1, rel=0.01)
    assert distant.scale[0] == 1.0
    assert Plan.from_moments(np.zeros(6), np.zeros((6, 6))).centre[0] == 0.0


@pytest.mark.parametrize("samples", [1, 7, 5000])
def test_the_largest_are_kept_in_whatever_parts_they_come(samples: int) -> None:
    errors = correlated_errors(3, samples)
    errors[:, -1] = errors[:, 0]  # equal ones: the earlier sample first
    plan = plan_for(correlated_errors(3, 100))
    whole = observe(plan, start(plan), errors)
    in_parts = start(plan)
    for part in np.array_split(errors, 3, axis=1):
        in_parts = observe(plan, in_parts, part)
    for row, values in enumerate((np.linalg.norm(errors[:3], axis=0), np.linalg.norm(errors[3:], axis=0))):
        expected = sorted(range(samples), key=lambda sample: (-values[sample], sample))[:LARGEST]
        found = finish(plan, whole).largest_attitude if row else finish(plan, whole).largest_position
        assert [one.sample for one in found] == expected
        np.testing.assert_allclose([one.value for one in found], values[expected], rtol=1e-15)
    np.testing.assert_array_equal(in_parts.largest, whole.largest)
    np.testing.assert_array_equal(in_parts.largest_units, whole.largest_units)
