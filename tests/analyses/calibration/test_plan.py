"""The choice of poses against all choices, and its bound."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
from scipy import optimize

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, chain_of, plain_model, random_poses
from precision_pin.analyses.calibration.design import observability
from precision_pin.analyses.calibration.plan import Design, _least, _project

SET_UPS = [
    pp.Measurement(std=20e-6, target=OFF_AXIS),
    pp.Measurement(std=20e-6, target=OFF_AXIS, base="free"),
]


def covariance_of(q: np.ndarray, measurement: pp.Measurement) -> np.ndarray:
    found = pp.forecast_calibration(plain_model(), q, measurement, at=["work"])
    return found.posterior.covariance


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "measurement"), list(zip(("D", "task"), SET_UPS, strict=True)), ids=["D", "task"]
)
def test_the_best_of_all_choices_is_found(criterion: str, measurement: pp.Measurement) -> None:
    """3 of 7 poses: all 35 choices, each by its forecast."""
    model, q = plain_model(), random_poses(4, 7)
    plan = pp.plan_calibration(model, q, 3, measurement, at=["work"], criterion=criterion)  # type: ignore[arg-type]
    losses = {}
    for chosen in itertools.combinations(range(7), 3):
        found = pp.forecast_calibration(model, q[:, chosen], measurement, at=["work"])
        left = found.rms("after") ** 2 - found.rms("floor") ** 2
        std = np.array(list(found.posterior.prior_std.values()))
        losses[chosen] = (
            left if criterion == "task" else np.linalg.slogdet(found.posterior.covariance / np.outer(std, std))[1]
        )
    best = min(losses, key=losses.__getitem__)
    assert losses[plan.chosen] == pytest.approx(losses[best], rel=1e-6)
    value, bound = (plan.value, plan.bound) if criterion == "task" else (-plan.value, -plan.bound)
    assert value == pytest.approx(losses[plan.chosen], rel=1e-5)
    # no choice passes the bound
    assert min(losses.values()) > bound
    assert 0 < plan.random_efficiency <= plan.efficiency <= 1


@pytest.mark.slow
def test_plan_and_forecast_agree_and_a_seed_gives_one_plan() -> None:
    model, q, measurement = plain_model(), random_poses(4, 30), SET_UPS[0]
    one, other = (pp.plan_calibration(model, q, 8, measurement, seed=3) for _ in range(2))
    assert one.to_json() == other.to_json()
    found = pp.forecast_calibration(model, one.q, measurement)
    assert found.rms("after") == pytest.approx(one.rms("after"), rel=1e-9)
    assert found.observability == pytest.approx(one.observability, rel=1e-6)
    assert one.efficiency > 0.9


@pytest.mark.slow
def test_forty_of_two_hundred_poses_in_time_and_certified() -> None:
    """All geometric errors of a UR5 by points: D-efficiency of 0.99, in less than 20 s."""
    chain = chain_of("ur5")
    began = time.perf_counter()
    candidates = random_poses(len(chain.joints), 200)
    measurement = pp.Measurement(target=OFF_AXIS)
    plan = pp.plan_calibration(pp.every_frame(chain), candidates, 40, measurement, criterion="D")
    assert plan.efficiency >= 0.99
    assert time.perf_counter() - began < 20


@pytest.mark.slow
def test_weights_within_limits_by_general_solvers() -> None:
    """The closest weights satisfy the conditions of a minimum, and the least sum of slopes is that of a linear programme."""
    generator = np.random.default_rng(0)
    for _ in range(200):
        count = int(generator.integers(2, 30))
        settled = generator.random(count)
        low, high = (settled < 0.1).astype(float), (settled < 0.9).astype(float)
        total = int(generator.integers(low.sum(), high.sum() + 1))
        wanted = generator.normal(size=count) * generator.choice([0.1, 1, 10])
        weights = _project(wanted, total, low, high)
        assert weights.sum() == pytest.approx(total, abs=1e-9)
        assert ((weights >= low) & (weights <= high)).all()
        # the gradient is one number where neither limit holds, and no less (no more) than that at the lower (upper) one
        away = weights - wanted
        free = (weights > low) & (weights < high)
        if free.any():
            assert np.ptp(away[free]) < 1e-9
            multiplier = away[free][0]
            assert (away[(weights == low) & (low < high)] >= multiplier - 1e-9).all()
            assert (away[(weights == high) & (low < high)] <= multiplier + 1e-9).all()
        slopes = generator.normal(size=count)
        least = _least(slopes, total, low, high)
        best = optimize.linprog(slopes, A_eq=np.ones((1, count)), b_eq=[total], bounds=np.column_stack([low, high]))
        assert slopes @ least == pytest.approx(best.fun, abs=1e-9)


@pytest.mark.parametrize("criterion", ["D", "task"])
def test_one_pose_more_or_less_by_the_loss_itself(criterion: str) -> None:
    generator = np.random.default_rng(1)
    by_z, by_nuisance = generator.normal(size=(9, 3, 5)), generator.normal(size=(9, 3, 2))
    goal = np.diag([1.0, 2.0, 3.0, 0.0, 1.0])
    design = Design.of(by_z, by_nuisance, goal if criterion == "task" else None)
    chosen = np.arange(4)
    here, information = design.loss(design.information(chosen)), design.information(chosen)
    more, less = (design._changes_by_one(information, sign) for sign in (1.0, -1.0))
    for k in range(4, 9):
        assert more[k] == pytest.approx(design.loss(design.information(np.append(chosen, k))) - here, rel=1e-6)
    for k in range(4):
        assert less[k] == pytest.approx(design.loss(design.information(np.delete(chosen, k))) - here, rel=1e-6)


def test_all_candidates_are_chosen_where_all_are_asked_for() -> None:
    plan = pp.plan_calibration(plain_model(), random_poses(4, 5), 5, SET_UPS[0])
    assert plan.chosen == (0, 1, 2, 3, 4)
    assert plan.efficiency == pytest.approx(1.0, abs=1e-9)


def test_too_many_poses_are_refused() -> None:
    with pytest.raises(pp.InputError, match="from 1 to 5, the number of candidates"):
        pp.plan_calibration(plain_model(), random_poses(4, 5), 6, SET_UPS[0])


def test_a_candidate_given_twice_is_refused() -> None:
    q = random_poses(4, 5)
    with pytest.raises(pp.InputError, match="candidates 2 and 6 are one pose"):
        pp.plan_calibration(plain_model(), np.hstack([q, q[:, 1:2]]), 3, SET_UPS[0])


def test_observability_indices_by_hand() -> None:
    found = observability(np.array([4.0, 2.0, 1.0]), 4)
    assert found == pytest.approx({"O1": 1.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 1 / 1.75})
