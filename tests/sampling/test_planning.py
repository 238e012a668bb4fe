"""Planning of the bins, quantiles where the first order vanishes; sampling until the result is precise enough."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Empirical, Law, Lognormal, Normal, TwoPoint, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling.blocks import first_order_skewness, planned
from precision_pin.sources import JointOffset
from precision_pin.statistics import QUANTITIES, quantity_values
from sampling.cases import AT, MODEL

JOINTS = MODEL.chain.joint_names
VECTORS = ("position", "attitude")
STRETCHED = ([0, 0, 0, 0], [0, 90, 0, 0], [-90, 0, 0, -90], [-90, 0, 0, 0], [0, -90, 0, 0], [90, 0, 90, 0])
"""Poses of the paper's arm along its axes, degrees: some components are moved by products of offsets alone."""


def offsets(law: Law) -> ErrorModel:
    draws = tuple(Draw(f"o{k}", law) for k in range(len(JOINTS)))
    return ErrorModel(
        MODEL.chain, Space(draws), [JointOffset(joint=JOINTS[k], offset=draw.name) for k, draw in enumerate(draws)]
    )


def values_of(errors: np.ndarray) -> dict[str, np.ndarray]:
    rows = [np.sqrt((errors[:3] ** 2).sum(axis=0)), *errors[:3], np.sqrt((errors[3:] ** 2).sum(axis=0)), *errors[3:]]
    return dict(zip(QUANTITIES, rows, strict=True))


@pytest.mark.fast(2)
@pytest.mark.parametrize("number", range(len(STRETCHED)))
def test_quantiles_are_those_of_the_sorted_samples_where_the_first_order_vanishes(number: int) -> None:
    law = (Normal(1e-3), Uniform(1e-3), Lognormal(1e-3, 1e-3))[number % 3]
    found = pp.monte_carlo(offsets(law), np.radians(STRETCHED[number]), samples=20_000, keep_samples=True)
    assert found.errors is not None
    for quantity, values in values_of(found.errors).items():
        if np.abs(values).max() < 1e-14:
            continue
        distribution = found.summary.distribution(quantity)
        for level in distribution.levels:
            gap = abs(distribution.quantile(level) - np.quantile(values, level))
            assert gap <= distribution.quantile_error(level), (quantity, level)
            # a bin is 1/512 of the distance from the middle, and a lognormal law's quantiles lie ten spreads away
            assert distribution.quantile_error(level) <= 0.03 * values.std(), (quantity, level)
    assert not any("W_BINS" in warning for warning in found.warnings)


@pytest.mark.slow
def test_the_plan_is_decided_by_the_model_and_the_seed_alone():
    layout = sampler.to_arrays(AT)
    plan, again = planned(AT, layout, "exact", 3), planned(AT, layout, "exact", 3)
    np.testing.assert_array_equal(plan.centre, again.centre)
    np.testing.assert_array_equal(plan.scale, again.scale)
    # the middle of the seed's first samples, whatever the run's length
    errors = pp.monte_carlo(MODEL, "paper", samples=512, seed=3, keep_samples=True).errors
    assert errors is not None
    ordered = np.sort(quantity_values(errors), axis=1)
    assert (ordered[:, 250] <= plan.centre).all()
    assert (plan.centre <= ordered[:, 261]).all()
    short, long = (pp.monte_carlo(MODEL, "paper", samples=n, seed=3) for n in (20, 20_000))
    assert short.position.norm.min >= long.position.norm.min


def test_a_run_that_ends_before_the_pilot_fails_is_not_stopped_by_it():
    # an offset of more than half a turn, which is refused, in one robot of 400
    model = offsets(TwoPoint(2.0, 2.0, probability=1 / 400))
    layout = sampler.to_arrays(model.at([0, 0, 0, 0]))
    seed = next(
        seed
        for seed in range(50)
        if (sampler.sample(layout, seed, 0, 512) > 0).any() and not (sampler.sample(layout, seed, 0, 30) > 0).any()
    )
    assert pp.monte_carlo(model, [0, 0, 0, 0], samples=30, seed=seed).samples == 30
    with pytest.raises(pp.InputError, match="half a turn"):
        pp.monte_carlo(model, [0, 0, 0, 0], samples=512, seed=seed)


@pytest.mark.filterwarnings("ignore:.*W_BINS")
def test_a_result_warns_of_quantiles_in_wide_bins():
    """Offsets that jump in one robot of a thousand: a stretched arm's dz is zero or a product of jumps, no pilot tells which."""
    found = pp.monte_carlo(
        offsets(TwoPoint(1e-3, 1e-3, probability=1e-3)), np.radians([0, 90, 0, 0]), samples=200_000, keep_samples=True
    )
    assert found.errors is not None
    warned = [line for line in found.warnings if "W_BINS" in line]
    assert any("position.z" in line for line in warned)
    for level in found.position.z.levels:
        exact = np.quantile(found.errors[2], level)
        low, high = found.position.z.quantile_interval(level)
        assert low <= exact <= high
        assert abs(found.position.z.quantile(level) - exact) <= found.position.z.quantile_error(level)
    assert not any("W_BINS" in line for line in pp.monte_carlo(MODEL, "paper", samples=20_000).warnings)


# tails known from the laws -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "law",
    [
        Lognormal(1.0, 1.0),
        TwoPoint(1.0, 3.0, probability=0.01),
        Empirical(((0.0, 0.0), (0.9, 1.0), (1.0, 7.0))),
        Normal(2),
    ],
    ids=lambda law: type(law).__name__,
)
def test_skewness_of_a_single_number_is_that_of_its_quantiles(law: Law) -> None:
    """By brute force: means over ten thousand million equally likely numbers would be needed; a graded grid does."""
    edges = np.concatenate([np.geomspace(1e-16, 0.5, 20_000), 1 - np.geomspace(0.5, 1e-16, 20_000)])
    edges = np.unique(np.concatenate([[0.0], edges, law.breaks, [1.0]]))
    middles, weights = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    inside = (middles > 0) & (middles < 1)
    values = law.inverse(middles[inside][None])[0]
    weights = weights[inside] / weights[inside].sum()
    z = values - weights @ values
    square = z**2 - weights @ z**2
    expected = [abs(weights @ part**3) / (weights @ part**2) ** 1.5 for part in (z, square)]
    found = first_order_skewness((Draw("a", law),), np.array([[0.0], [-3.0], *[[0.0]] * 4]))
    np.testing.assert_allclose(found[2], expected, rtol=0.02, atol=1e-3)


def test_a_jump_that_no_sample_shows_leaves_the_deviation_unresolved():
    """One robot in 100,000 has an offset of 20 mrad: the samples look normal, and no interval of theirs holds the truth."""
    laws = (Normal(1e-4), TwoPoint(1e-2, 1e-2, probability=1e-5))
    draws = tuple(Draw(f"o{k}", law) for k, law in enumerate(laws))
    sources = [JointOffset(joint=JOINTS[k], offset=draw.name) for k, draw in enumerate(draws)]
    found = pp.monte_carlo(ErrorModel(MODEL.chain, Space(draws), sources), np.radians([0, 45, 0, 0]), samples=3000)
    distributions = [found.summary.distribution(f"{vector}.{axis}") for vector in VECTORS for axis in "xyz"]
    assert any(one.std > 0 and one.std_interval() is None for one in distributions)
    for vector in VECTORS:
        assert found.summary.distribution(f"{vector}.norm").std_interval() is None


TARGET = "95 % to 0.03 mm"


@pytest.mark.slow
def test_it_stops_at_the_first_look_that_is_precise_enough() -> None:
    found = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET], threads=1)
    looks = found.samples // BLOCK
    assert found.samples == looks * BLOCK
    assert looks & (looks - 1) == 0
    assert looks > 1
    # an interval of a quantile by the law's density: z·√(p (1 - p) / N) / density, here to within a fifth
    norm = found.position.norm
    step = norm.quantile(0.955) - norm.quantile(0.945)
    about = 1.96 * np.sqrt(0.95 * 0.05 / found.samples) * step / 0.01
    # and each end is moved out to the edge of its bin
    low, high = norm.quantile_interval(0.95)
    assert (high - low) / 2 == pytest.approx(about + norm.quantile_error(0.95) / 2, rel=0.2)
    assert norm.half_width(0.95) <= 3e-5
    before = pp.monte_carlo(MODEL, samples=found.samples // 2)
    assert before.position.norm.half_width(0.95) > 3e-5
    told = {"target": TARGET, "half_width": pytest.approx(norm.half_width(0.95)), "tolerance": pytest.approx(3e-5)}
    assert found.to_dict()["until"] == [{**told, "reached": True}]
    known = pp.monte_carlo(MODEL, samples=found.samples).to_dict()
    assert {key: value for key, value in found.to_dict().items() if key != "until"} == known


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_to_the_same_end(tmp_path: Path) -> None:
    whole = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET])
    journal = tmp_path / "run.journal"
    for stop_after in (1, 3):
        seen = 0

        def progress(count: int, stop_after: int = stop_after) -> None:
            nonlocal seen
            seen += count
            if seen >= stop_after * BLOCK:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            pp.monte_carlo(
                MODEL, samples=10**8, until=[TARGET], journal=journal, resume=True, threads=1, progress=progress
            )
    resumed = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET], journal=journal, resume=True)
    assert resumed.to_dict() == whole.to_dict()
    with pytest.raises(InputError, match=r"until was '95 % to 0\.03 mm', is '95 % to 0\.04 mm'"):
        pp.monte_carlo(MODEL, samples=10**8, until=["95 % to 0.04 mm"], journal=journal, resume=True)


@pytest.mark.filterwarnings("ignore:.*W_UNTIL")
def test_samples_that_do_not_suffice_are_told_with_how_many_would() -> None:
    found = pp.monte_carlo(MODEL, samples=3 * BLOCK + 5, until=["mean to 1 um"])
    assert found.samples == 3 * BLOCK + 5
    told = [line for line in found.warnings if "W_UNTIL" in line]
    assert len(told) == 1
    expected = found.samples * (1.96 * found.position.norm.std / np.sqrt(found.samples) / 1e-6) ** 2
    assert float(re.search(r"about (\S+) are needed", told[0])[1]) == pytest.approx(expected, rel=0.01)


def test_what_no_number_of_samples_gives_is_refused() -> None:
    with pytest.raises(InputError, match=r"resolved to \S+ m only, the target.s tolerance is 1e-06 m"):
        pp.monte_carlo(MODEL, samples=10**12, until=["99.73 % to 1 um"])
    with pytest.raises(InputError, match="target 'sometime' is not understood"):
        pp.monte_carlo(MODEL, until=["sometime"])
    with pytest.raises(InputError, match="keep_samples is not possible"):
        pp.monte_carlo(MODEL, until=[TARGET], keep_samples=True)


@pytest.mark.slow
def test_the_units_of_the_largest_errors_can_be_built_again() -> None:
    found = pp.monte_carlo(MODEL, samples=50_000, seed=8)
    at = MODEL.at()
    for vector, rows in (("position", slice(0, 3)), ("attitude", slice(3, 6))):
        entries = found.to_dict()["largest"][vector]
        assert len(entries) == 10
        assert entries[0]["value"] == getattr(found, vector).norm.max
        for entry in entries:
            x = np.array([entry["parameters"][name] for name in at.space.components])
            assert np.linalg.norm(at.exact(x[:, None])[rows]) == pytest.approx(entry["value"], rel=1e-12)
            np.testing.assert_allclose(x, at.space.sample(8, entry["unit"], 1)[:, 0], rtol=1e-13)
