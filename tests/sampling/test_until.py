"""Sampling until the result is precise enough: the point at which it stops, its independence of the workers, and errors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.kernel.sampler import BLOCK
from sampling.cases import MODEL

TARGET = "95 % to 0.03 mm"


def numbers(result: pp.MonteCarloResult) -> dict[str, object]:
    """Return a result without its targets."""
    return {key: value for key, value in result.to_dict().items() if key != "until"}


@pytest.mark.slow
def test_it_stops_at_the_first_look_that_is_precise_enough() -> None:
    found = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET])
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
    assert found.to_dict()["until"] == [
        {
            "target": TARGET,
            "half_width": pytest.approx(norm.half_width(0.95)),
            "tolerance": pytest.approx(3e-5),
            "reached": True,
        }
    ]


@pytest.mark.slow
def test_what_it_finds_is_what_so_many_samples_give() -> None:
    found = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET, "attitude std to 1 %"], seed=3)
    assert numbers(found) == numbers(pp.monte_carlo(MODEL, samples=found.samples, seed=3))
    for threads in (1, 3):
        again = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET, "attitude std to 1 %"], seed=3, threads=threads)
        assert again.to_dict() == found.to_dict()


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_to_the_same_end(tmp_path: Path) -> None:
    whole = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET])
    journal = tmp_path / "run.journal"
    for stop_after in range(1, 4):
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


@pytest.mark.slow
def test_the_sketch_tells_its_own_error() -> None:
    found = pp.monte_carlo(MODEL, samples=300_000, keep_samples=True)
    values = np.linalg.norm(found.errors[:3], axis=0)
    for p in (0.05, 0.5, 0.95, 0.9973):
        gap = abs(found.position.norm.quantile(p) - np.quantile(values, p))
        assert gap <= found.position.norm.quantile_error(p) <= 2e-2 * values.std()
    assert abs(found.position.norm.quantile(0.9973) / np.quantile(values, 0.9973) - 1) < 2e-4
