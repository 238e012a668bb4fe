"""Printed numbers lie inside the intervals of the numbers they stand for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from precision_pin.analyses.monte_carlo.table import statistic, tolerance_bounds
from precision_pin.statistics import Plan, finish, format_inside, observe, quantity_values, start
from precision_pin.statistics.digits import format_interval, round_end
from precision_pin.statistics.distribution import CONTENTS


@pytest.mark.parametrize(
    ("value", "interval", "text"),
    [
        (36.862, (36.850, 36.874), "36.86"),
        # rounding to 36.9 would pass the nearer end: one more digit
        (36.862, (36.7, 36.88), "36.86"),
        (1.4142, (1.4141, 1.52), "1.4142"),
        (-0.0361, (-0.03612, -0.03608), "-0.03610"),
        (0.0, (0.0, 0.3), "0.0"),
        (2.0, (2.0, 2.0), "2.00000"),
        # known better than rounding: printed as exact
        (2 / 3, (2 / 3 - 1e-12, 2 / 3 + 1e-12), "0.666667"),
        # known to eight digits: all of them are printed
        (37.69123456, (37.6912340, 37.6912351), "37.691235"),
        (None, None, "not resolved"),
        (1.0, None, "not resolved"),
    ],
)
def test_digits_are_added_until_the_number_is_inside(value, interval, text) -> None:
    assert format_inside(value, interval) == text
    if interval is not None and interval[1] - interval[0] > 1e-9:
        assert interval[0] <= float(text) <= interval[1]


@pytest.mark.slow
def test_any_number_is_printed_inside_any_interval_that_holds_it() -> None:
    random = np.random.default_rng(1)
    for _ in range(5000):
        value = random.normal() * 10.0 ** random.integers(-6, 7)
        below, above = abs(value) * 10.0 ** random.uniform(-7, 1, 2)
        interval = (value - below, value + above)
        printed = format_inside(value, interval)
        assert interval[0] <= float(printed) <= interval[1], (value, interval)
        # no more digits than needed: one less is outside, or supported by no half of the interval
        digits = len(printed.partition(".")[2])
        if digits and max(below, above) > 5 * 10.0**-digits * (1 + 1e-9):
            assert not interval[0] <= round(value, digits - 1) <= interval[1]


@pytest.mark.slow
@pytest.mark.parametrize("samples", [40, 120, 700, 20_000])
def test_every_cell_of_the_table_lies_in_its_interval_and_bounds_are_rounded_outwards(samples) -> None:
    for seed in range(6):
        random = np.random.default_rng((samples, seed))
        errors = 1e-3 * np.stack([
            random.standard_exponential(samples), random.standard_t(4, samples), random.uniform(-1, 1, samples),
            37 + random.standard_normal(samples), 1e-3 * random.lognormal(0, 1, samples),
            (random.random(samples) < 0.3) / 3,
        ])  # fmt: skip
        plan = Plan.from_pilot(quantity_values(errors[:, :512]), np.zeros(6))
        found = finish(plan, observe(plan, start(plan), errors))
        for vector in (found.position, found.attitude):
            for distribution in (vector.norm, vector.x, vector.y, vector.z):
                for which in ("mean", "std", "mode", *distribution.levels):
                    interval = distribution.interval(which)
                    printed = statistic(distribution, which)
                    assert (printed == "-") == (interval is None)
                    # of two values a quantile is one of them, known exactly: five digits
                    if interval is not None and interval[1] - interval[0] > 1e-9 * abs(interval[1]):
                        assert interval[0] <= 1e-3 * float(printed) <= interval[1]
                for content in CONTENTS:
                    bounds, printed = distribution.tolerance_bounds(content), tolerance_bounds(distribution, content)
                    assert (printed == "-") == (bounds is None)
                    if bounds is not None:
                        ends = [1e-3 * float(end) for end in printed.split(" to ")]
                        tiny = 1e-15 * abs(ends[-1])
                        assert ends[-1] >= bounds[1] - tiny
                        assert ends[-1] - bounds[1] <= max(0.11 * distribution.std, 1e-4 * abs(bounds[1]))
                        assert distribution.is_norm or ends[0] <= bounds[0] + tiny


def test_tolerance_bounds_are_those_of_wilks() -> None:
    """Of N samples the largest is above 95 % of the law with 1 - 0.95^N: 59 for 95 %; for both ends 93."""
    for samples, one_sided, two_sided in ((58, False, False), (59, True, False), (92, True, False), (93, True, True)):
        errors = np.random.default_rng(2).standard_normal((6, samples))
        plan = Plan(np.zeros(8), np.ones(8))
        found = finish(plan, observe(plan, start(plan), errors))
        norm, part = found.position.norm.tolerance_bounds(0.95), found.position.x.tolerance_bounds(0.95)
        assert (norm is not None, part is not None) == (one_sided, two_sided)
        if samples == 59:
            assert norm == (0.0, pytest.approx(found.position.norm.max, rel=1e-12))
        if samples == 93:
            assert part == (pytest.approx(errors[0].min()), pytest.approx(errors[0].max()))
    assert math.isclose(1 - 0.95**59, 0.9515, abs_tol=1e-4)


def test_ends_of_an_interval_are_rounded_outwards():
    """By hand: two digits of the width 0.0468 are thousandths; of an interval of no width five digits are left."""
    assert format_interval(3.8324, 3.8792) == ("3.832", "3.880")
    assert format_interval(-1.0, 1.0) == ("-1.0", "1.0")
    assert format_interval(0.25, 0.25, 2.0) == ("0.500000", "0.500000")
    generator = np.random.default_rng(1)
    for low, width in generator.uniform(0.0, 1.0, (200, 2)):
        below, above = (float(end) for end in format_interval(low, low + width))
        assert below <= low
        assert above >= low + width
        assert above - below <= 1.2 * width


def test_ends_and_bounds_are_rounded_to_digits_in_their_direction():
    """By hand; a decimal such as 0.3 that binary numbers miss is kept."""
    assert round_end(0.04658, 2, up=True) == 0.047
    assert round_end(0.04658, 2, up=False) == 0.046
    assert round_end(-5.104151, 6, up=False) == -5.10416
    assert round_end(-5.104159, 6, up=True) == -5.10415
    assert round_end(9.5e-13, 1, up=True) == 1e-12
    for exact in (0.3, 3e-5, 1e-300, 7.0):
        assert round_end(exact, 1, up=True) == round_end(exact, 1, up=False) == exact
