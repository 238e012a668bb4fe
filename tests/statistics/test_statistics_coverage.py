"""How often the intervals hold the truth, over 10,000 fixed seeds."""

import math

import numpy as np
import pytest
from scipy.special import bdtr, gammaincinv, ndtri

from precision_pin.statistics import (
    Plan,
    Specification,
    clopper_pearson,
    finish,
    observe,
    quantile_coverage,
    quantile_ranks,
    start,
)

SEEDS = 10_000
LEAST = 0.945
TOLERANCE = 0.007


def order_statistic_coverage(samples: int, p: float, confidence: float, seeds: int = SEEDS) -> float:
    """Share of seeds whose order statistics enclose the p-quantile of a unit exponential law."""
    values = np.stack([np.random.default_rng(seed).standard_exponential(samples) for seed in range(seeds)])
    values.sort(axis=1)
    lower, upper = quantile_ranks(samples, p, confidence)
    truth = -math.log1p(-p)
    return float(np.mean((values[:, lower - 1] <= truth) & (truth < values[:, upper - 1])))


@pytest.mark.parametrize("p", [0.05, 0.5, 0.95])
def test_order_statistics_enclose_the_quantile_as_often_as_computed(p: float) -> None:
    measured = order_statistic_coverage(150, p, 0.95)
    assert measured >= LEAST
    assert measured == pytest.approx(quantile_coverage(150, p, quantile_ranks(150, p, 0.95)), abs=TOLERANCE)


def test_the_measurement_notices_intervals_that_are_too_short() -> None:
    assert order_statistic_coverage(150, 0.5, 0.92) < LEAST


def clopper_pearson_coverage(samples: int, probability: float, confidence: float) -> float:
    """Exact coverage: the binomial probability of all counts whose interval holds the truth."""
    held = [k for k in range(samples + 1) if _holds(clopper_pearson(k, samples, confidence), probability)]
    mass = bdtr(np.array(held), samples, probability) - np.where(
        np.array(held) > 0, bdtr(np.maximum(np.array(held) - 1, 0), samples, probability), 0
    )
    return float(mass.sum())


def _holds(interval: tuple[float, float], truth: float) -> bool:
    return interval[0] <= truth <= interval[1]


@pytest.mark.parametrize("probability", [0.01, 0.3, 0.95, 0.9973])
def test_clopper_pearson_holds_the_truth_as_often_as_computed(probability: float) -> None:
    samples = 200
    inside = np.array([np.random.default_rng(seed).binomial(samples, probability) for seed in range(SEEDS)])
    held = np.array([_holds(clopper_pearson(k, samples, 0.95), probability) for k in range(samples + 1)])
    measured = float(held[inside].mean())
    assert measured >= LEAST
    assert measured == pytest.approx(clopper_pearson_coverage(samples, probability, 0.95), abs=TOLERANCE)


@pytest.mark.slow
def test_intervals_of_whole_summaries_over_ten_thousand_seeds() -> None:
    """From blocks of errors to intervals: components normal (offset 37 σ), norms chi with three degrees."""
    samples = 200
    levels = {p: float(ndtri(p)) for p in (0.05, 0.5, 0.95)}
    norm_levels = {p: math.sqrt(2 * gammaincinv(1.5, p)) for p in (0.5, 0.95)}
    offset = 37.0
    specifications = (
        Specification("position.norm", norm_levels[0.95], 0.9),
        Specification("attitude.z", offset + levels[0.95], 0.9),
    )
    centre = np.array([1.6, 0, 0, 0, 64, offset, offset, offset])
    plan = Plan(centre, np.ones(8), specifications)
    held: dict[tuple[str, float], int] = {}
    for seed in range(SEEDS):
        errors = np.random.default_rng(seed).standard_normal((6, samples))
        errors[3:] += offset
        summary = finish(plan, observe(plan, start(plan), errors))
        for p, truth in levels.items():
            _count(held, "x", p, summary.position.x.quantile_interval(p), truth)
            _count(held, "δy", p, summary.attitude.y.quantile_interval(p), truth + offset)
        for p, truth in norm_levels.items():
            _count(held, "norm", p, summary.position.norm.quantile_interval(p), truth)
        for result in summary.specifications:
            _count(held, result.quantity, -1, result.interval, 0.95)
    for (name, p), times in held.items():
        computed = (
            clopper_pearson_coverage(samples, 0.95, 0.95)
            if p < 0
            else quantile_coverage(samples, p, quantile_ranks(samples, p, 0.95))
        )
        assert times / SEEDS >= LEAST, (name, p)
        assert times / SEEDS == pytest.approx(computed, abs=TOLERANCE), (name, p)


def _count(
    held: dict[tuple[str, float], int], name: str, p: float, interval: tuple[float, float] | None, truth: float
) -> None:
    assert interval is not None
    held[name, p] = held.get((name, p), 0) + _holds(interval, truth)
