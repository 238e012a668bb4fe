"""Costs against another optimiser on its own formulas, and the slopes of quantiles against differences."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize, special

import precision_pin as pp
from analyses.test_allocation import HALF, slide_model
from precision_pin.analyses.allocation.table import allocation_table
from precision_pin.analyses.exact_law.number_law import NormalNorm
from precision_pin.analyses.map.normal_norms import norm_quantile_slopes

Costs = list[tuple[dict[str, object], Callable[[float], float]]]

MIXED: Costs = [
    ({"exponential": [8, "9 1/mm"]}, lambda t: 8 * np.exp(-9e3 * t)),
    ({"logarithmic": [3, "1 mm"]}, lambda t: 3 * np.log(1e-3 / t)),
    ({"power": ["0.02 mm^1.5", 1.5]}, lambda t: 0.02 * (1e-3 / t) ** 1.5),
]
SQUARED: Costs = [
    ({"squared": "0.01 mm^2"}, lambda t: 0.01 * (1e-3 / t) ** 2),
    ({"reciprocal": "0.3 mm"}, lambda t: 0.3e-3 / t),
    ({"exponential": [5, "6 1/mm"]}, lambda t: 5 * np.exp(-6e3 * t)),
]


def _problem(costs: Costs, specs: list[object], law: str = "uniform", **more: dict[int, str]) -> dict[str, object]:
    entries = [
        {"path": f"parameters.a{k}.{law}", "cost": cost, **{key: by[k] for key, by in more.items() if k in by}}
        for k, (cost, _) in enumerate(costs)
    ]
    return {"tolerances": entries, "specs": specs}


def _least(costs: Costs, excess: Callable[[np.ndarray], np.ndarray], bounds: list[tuple[float, float]]) -> float:
    """Return the least cost in tenths of millimetres, by an interior-point method with differences."""
    found = optimize.minimize(
        lambda x: float(sum(cost(t) for (_, cost), t in zip(costs, x * 1e-4, strict=True))),
        0.3 * np.array(bounds).min(axis=1) / 1e-4 + 0.1,
        bounds=[(low / 1e-4, high / 1e-4) for low, high in bounds],
        constraints=optimize.NonlinearConstraint(lambda x: excess(x * 1e-4), -np.inf, 0),
        method="trust-constr",
        options={"maxiter": 2000, "gtol": 1e-9, "xtol": 1e-11},
    )
    assert excess(found.x * 1e-4).max() < 1e-6
    return float(found.fun)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_root_mean_square_of_three_kinds_of_cost(tmp_path: Path) -> None:
    result = pp.allocate(slide_model(tmp_path), _problem(MIXED, [{"rms": "0.12 mm"}]))
    bounds = [(half / 100, min(100 * half, 1e-3) if k == 1 else 100 * half) for k, half in enumerate(HALF)]
    least = _least(MIXED, lambda t: np.array([(t**2).sum() / 3 / 0.12e-3**2 - 1]), bounds)
    assert result.cost == pytest.approx(least, rel=1e-5)
    assert result.cost <= 1.001 * least
    assert result.gap is not None
    assert result.gap < 1e-6


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_worst_case_with_a_bound_and_a_mean(tmp_path: Path) -> None:
    problem = _problem(SQUARED, [{"worst_case": "0.4 mm"}], max={1: "0.12 mm"})
    result = pp.allocate(slide_model(tmp_path, "xxx", mean="0.05 mm"), problem)
    bounds = [(HALF[0] / 100, 100 * HALF[0]), (HALF[1] / 100, 0.12e-3), (HALF[2] / 100, 100 * HALF[2])]
    least = _least(SQUARED, lambda t: np.array([(t.sum() + 0.05e-3) / 0.4e-3 - 1]), bounds)
    assert result.cost == pytest.approx(least, rel=1e-5)
    assert result.cost <= 1.001 * least
    assert result.after[1] == pytest.approx(0.12e-3)
    assert result.shadow_prices[1] > 0
    wider = pp.allocate(
        slide_model(tmp_path, "xxx", mean="0.05 mm"),
        _problem(SQUARED, [{"worst_case": "0.4 mm"}], max={1: "0.12001 mm"}),
    )
    assert result.cost - wider.cost == pytest.approx(1e-8 * result.shadow_prices[1], rel=1e-3)
    assert f"max, {result.shadow_prices[1] / 1e3:.3g} per mm" in allocation_table(result)
    assert result.gap is not None
    assert result.gap < 1e-6


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_components_at_three_poses(tmp_path: Path) -> None:
    """At an angle θ the x of the tip is cos θ of the first length and sin θ of the second; z is the third."""
    angles = {"a": 0.0, "b": 35.0, "c": 80.0}
    model = slide_model(tmp_path, law="normal", poses={name: f"{angle} deg" for name, angle in angles.items()})
    specs: list[object] = ["x 0.15 mm @ 95 %", "z 0.1 mm @ 99 %"]
    result = pp.allocate(model, _problem(MIXED, specs, law="normal"))
    first, second = (one.aimed for one in result.limits)
    assert first is not None
    assert second is not None
    turns = np.deg2rad(list(angles.values()))
    ways = np.stack([np.cos(turns), np.sin(turns)])

    def excess(t: np.ndarray, first: float = first, second: float = second) -> np.ndarray:
        deviations = np.append(np.sqrt((t[:2] ** 2) @ ways**2), t[2]) / 3
        scores = special.ndtri((1 + np.array([first, first, first, second])) / 2)
        return deviations * scores / np.array([0.15e-3, 0.15e-3, 0.15e-3, 0.1e-3]) - 1

    bounds = [(half / 100, min(100 * half, 1e-3) if k == 1 else 100 * half) for k, half in enumerate(HALF)]
    least = _least(MIXED, excess, bounds)
    assert result.cost == pytest.approx(least, rel=1e-4)
    assert result.cost <= 1.001 * least
    assert result.met
    # the bound is that of the probabilities as stated, less what the samples leave open
    stated = _least(MIXED, lambda t: excess(t, 0.95, 0.99), bounds)
    assert result.lower_bound is not None
    assert 0.97 * stated < result.lower_bound < stated < result.cost
    assert result.bound_basis == "normal law"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_several_limits_with_a_group_and_a_lock(tmp_path: Path) -> None:
    specs: list[object] = ["0.3 mm @ 95 %", {"rms": "0.16 mm"}, {"worst_case": "0.25 mm"}]
    group = {0: "g", 2: "g"}
    problem = _problem(SQUARED, specs, "normal", group=group, min={1: "0.1 mm"}, max={1: "0.1 mm"})
    result = pp.allocate(slide_model(tmp_path, "xyx", law="normal"), problem)
    aimed = result.limits[0].aimed
    assert aimed is not None

    def excess(x: np.ndarray) -> np.ndarray:
        t = np.array([x[0], 0.1e-3, x[0]])
        variances = np.array([t[0] ** 2 + t[2] ** 2, t[1] ** 2, 0.0]) / 9
        inside = NormalNorm(np.zeros(3), np.diag(variances)).cumulative(np.array([0.3e-3]))[0]
        return np.array([aimed - inside, np.sqrt(variances.sum()) / 0.16e-3 - 1, (t[0] + t[2]) / 0.25e-3 - 1])

    widest = optimize.brentq(lambda t: excess(np.array([t])).max(), 1e-6, 1e-3)
    least = sum(cost(t) for (_, cost), t in zip(SQUARED, (widest, 0.1e-3, widest), strict=True))
    assert result.after == pytest.approx([widest, 0.1e-3, widest], rel=1e-5)
    assert result.cost == pytest.approx(least, rel=1e-5)


@pytest.mark.slow
def test_of_a_low_probability_no_bound_is_claimed(tmp_path: Path) -> None:
    result = pp.allocate(slide_model(tmp_path, law="normal"), _problem(MIXED, ["0.15 mm @ 60 %"], law="normal"))
    assert result.lower_bound is None
    assert result.met
    assert "how far above the least is not known" in allocation_table(result)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_a_tolerance_without_effect_is_the_widest(tmp_path: Path) -> None:
    """Nothing of the sheet turns the tip, so that a limit of the attitude leaves every tolerance at its widest."""
    result = pp.allocate(slide_model(tmp_path), _problem(SQUARED, ["1 mrad @ 99 %", {"rms": "1 mrad"}]))
    assert result.after == pytest.approx(100 * HALF)
    # no robot differs from another in its attitude: there is nothing to judge by samples, and a first order of zero is kept
    assert [one.verdict for one in result.limits] == ["nothing to judge", "met"]


@pytest.mark.fast(4)
@pytest.mark.parametrize("rank", [1, 2, 3])
@pytest.mark.parametrize("length", [0.0, 0.5, 4.0])
def test_slopes_of_quantiles_are_differences(rank: int, length: float) -> None:
    """Along changes within the range of the covariance, and for full rank in any direction."""
    rng = np.random.default_rng(10 * rank + int(length))
    root = rng.normal(size=(3, rank))
    mean = root @ rng.normal(size=rank)
    mean *= length / np.linalg.norm(mean)
    covariance = root @ root.T
    change = rng.normal(size=(rank, rank))
    change = root @ (change + change.T) @ root.T

    def quantile(step: float) -> float:
        law = NormalNorm(mean, covariance + step * change)
        return float(
            optimize.brentq(lambda r: law.cumulative(np.array([r]))[0] - 0.95, 1e-3, 99, xtol=1e-13, rtol=1e-13)
        )

    slopes = norm_quantile_slopes(mean[:, None], covariance[:, :, None], np.array([quantile(0)]))[:, :, 0]
    step = 1e-4
    assert float((slopes * change).sum()) == pytest.approx((quantile(step) - quantile(-step)) / (2 * step), rel=1e-5)
