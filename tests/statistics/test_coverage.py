"""Coverage of the intervals over 10,000 fixed seeds."""

import importlib
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import bdtr

from precision_pin.statistics import clopper_pearson, quantile_ranks
from support.sampling_checks import quantile_coverage

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


@pytest.mark.slow
@pytest.mark.parametrize("p", [0.05, 0.5, 0.95])
def test_order_statistics_enclose_the_quantile_as_often_as_computed(p: float) -> None:
    measured = order_statistic_coverage(150, p, 0.95)
    assert measured >= LEAST
    assert measured == pytest.approx(quantile_coverage(150, p, quantile_ranks(150, p, 0.95)), abs=TOLERANCE)


@pytest.mark.slow
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


@pytest.mark.fast(2)
@pytest.mark.parametrize("probability", [0.01, 0.3, 0.95, 0.9973])
def test_clopper_pearson_holds_the_truth_as_often_as_computed(probability: float) -> None:
    samples = 200
    inside = np.array([np.random.default_rng(seed).binomial(samples, probability) for seed in range(SEEDS)])
    held = np.array([_holds(clopper_pearson(k, samples, 0.95), probability) for k in range(samples + 1)])
    measured = float(held[inside].mean())
    assert measured >= LEAST
    assert measured == pytest.approx(clopper_pearson_coverage(samples, probability, 0.95), abs=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "samples", "runs"),
    [
        ("normal", 1000, 600),
        ("lognormal 20 %", 1000, 600),
        ("two values, 50:50", 1000, 300),
        ("two peaks alike", 20_000, 60),
    ],
)
def test_every_interval_of_a_summary_holds_the_truth_or_is_not_given(name, samples, runs, monkeypatch) -> None:
    """As in the documentation's table, with fewer runs: each may fall short of 94 % by chance in one of a hundred tries."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    sampling = importlib.import_module("benchmarks.coverage.sampling")
    rows = sampling.of_law(name, samples, runs)
    assert {row.interval for row in rows} >= {"mean", "standard deviation", "mode", "digits printed", "specification"}
    for row in rows:
        assert row.passes, row
        assert row.interval != "digits printed" or row.held == row.given


def test_the_table_of_coverage_tells_what_was_not_given(monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    row = importlib.import_module("benchmarks.coverage.row")
    rows = [
        row.Coverage("mean", "normal", "closed form", 1000, 1000, 951),
        row.Coverage("mode", "normal", "closed form", 1000, 0, 0),
        row.Coverage("digits", "normal", "closed form", 1000, 10, 10),
        row.Coverage("mean", "heavy, 300 samples", "quadrature", 1000, 1000, 980),
        row.Coverage("mean", "heavy, 1,000 samples", "quadrature", 1000, 40, 39),
        row.Coverage("mean", "tail, P 0.001", "quadrature", 200, 200, 190),
        row.Coverage("mean", "tail, P 1e-07", "quadrature", 100, 100, 96),
        row.Coverage("worst case: bound", "sheets", "vertices", 50, 50, 50),
    ]
    lines = row.cells(rows)
    assert row.as_csv({"Part": lines}).splitlines() == [
        "part,table,interval,case,runs,lowest %",
        "Part,,mean,normal,1000,95.1",
        "Part,,mode,normal,1000,-",
        "Part,,digits,normal,1000,100.0*",
        "Part,,mean,heavy,2000,97.5*",
        "Part,,mean,tail,300,95.0",
        "Part,worst case,bound,sheets,50,100.0",
    ]
    assert row.as_markdown(lines).splitlines()[2:] == [
        "| mean | 3 | 95.0 | tail |",
        "| mode | 1 | - | normal |",
        "",
        "100 % in all cases: digits; worst case: bound.",
    ]
    assert [one.passes for one in rows] == [True] * len(rows)
    assert not row.Coverage("mean", "short", "closed form", 10_000, 10_000, 9_300).passes
