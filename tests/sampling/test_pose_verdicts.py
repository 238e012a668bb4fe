"""Specifications over several poses: the verdict of every pose alone, the worst pose, JSON and plot."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.monte_carlo.table import poses_table
from precision_pin.base.errors import UnknownNameError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sampling.poses_result import PosesSpecification
from precision_pin.sources import JointOffset
from precision_pin.statistics import Specification, SpecificationResult
from sampling.cases import MODEL

Q = np.random.default_rng(5).uniform(-1.0, 1.0, (len(MODEL.chain.joint_names), 5))
SPECIFICATIONS = ("40 mm", "z 15 mm @ 60 %", "30 mrad @ 99 %", "x 1 m")


def judged(*outcomes: tuple[float, float, float, bool]) -> PosesSpecification:
    results = tuple(
        SpecificationResult("position.norm", 1e-3, 0.9, share, (low, high), varies)
        for share, low, high, varies in outcomes
    )
    return PosesSpecification(results, tuple("abcd"[: len(results)]), tuple(float(k) for k in range(len(results))))


@pytest.mark.slow
def test_every_pose_has_the_verdict_of_that_pose_alone() -> None:
    found = sample_poses(MODEL, Q, samples=3000, seed=4, specifications=SPECIFICATIONS)
    alone = [pp.monte_carlo(MODEL, q, samples=3000, seed=4, specifications=SPECIFICATIONS) for q in Q.T]
    verdicts = set()
    for rank, over_poses in enumerate(found.specification_results):
        expected = [one.summary.specifications[rank] for one in alone]
        assert list(over_poses.results) == expected
        assert over_poses.met is all(one.met for one in expected)
        verdicts.add(over_poses.met)
    assert verdicts == {True, False}
    assert found.met is False
    assert sample_poses(MODEL, Q, samples=500).met is True


def test_the_worst_pose_decides() -> None:
    met, undecided, missed, alike = (
        (0.95, 0.92, 0.97, True),
        (0.9, 0.88, 0.92, True),
        (0.8, 0.78, 0.82, True),
        (1.0, 0.99, 1.0, False),
    )
    assert (judged(met, met).verdict, judged(met, met).met) == ("met", True)
    assert (judged(met, undecided).verdict, judged(met, undecided).worst) == ("undecided", 1)
    assert (judged(undecided, missed, met).verdict, judged(undecided, missed, met).worst) == ("not met", 1)
    # a pose at which no tolerance was tried shows nothing, as alone
    assert (judged(met, alike).verdict, judged(met, alike).met) == ("nothing to judge", False)
    # of the same share the pose with the larger errors
    assert judged(met, met, met).worst == 2


@pytest.mark.slow
def test_a_quantity_that_no_sample_moved_but_the_first_order_does_is_judged() -> None:
    # one sample varies in nothing; the single pose falls back on the first order as well
    found = sample_poses(MODEL, Q[:, :2], samples=1, specifications=["1 m @ 1 %"])
    alone = pp.monte_carlo(MODEL, Q[:, 0], samples=1, specifications=["1 m @ 1 %"])
    assert found.specification_results[0].results[0] == alone.summary.specifications[0]
    still = ErrorModel(MODEL.chain, MODEL.space, [])
    nothing = sample_poses(still, Q[:, :2], samples=50, specifications=["1 m"])
    assert nothing.specification_results[0].verdict == "nothing to judge"
    assert "NOTHING TO JUDGE" in poses_table(nothing)
    assert not nothing.met


@pytest.mark.slow
def test_without_specifications_the_worst_pose_has_the_largest_error() -> None:
    found = sample_poses(MODEL, Q, samples=2000)
    assert found.worst_pose == np.argmax(found.quantile[1, 0])
    assert sample_poses(MODEL, Q, samples=2).worst_pose == np.argmax(sample_poses(MODEL, Q, samples=2).norm_mean[0])
    judging = sample_poses(MODEL, Q, samples=2000, specifications=["1 m", "40 mm"])
    assert judging.worst_pose == np.argmin(judging.probability[1])


def test_json_tells_each_pose_the_worst_and_the_verdict() -> None:
    found = sample_poses(MODEL, list(Q.T), samples=1000, specifications=SPECIFICATIONS)
    data = json.loads(found.to_json())
    for rank, entry in enumerate(data["spec"]):
        assert [pose["probability"] for pose in entry["poses"]] == found.probability[rank].tolist()
        assert [pose["name"] for pose in entry["poses"]] == ["pose 1", "pose 2", "pose 3", "pose 4", "pose 5"]
        assert entry["met"] is all(pose["met"] for pose in entry["poses"])
        if not entry["met"]:
            assert entry["worst_pose"] == f"pose {1 + int(np.argmin(found.probability[rank]))}"
    assert {"quantity", "limit", "required"} <= set(data["spec"][0])


@pytest.mark.slow
def test_the_plot_shows_the_quantiles_the_limit_and_the_poses_that_miss_it() -> None:
    found = sample_poses(MODEL, Q, samples=2000, specifications=["40 mm"])
    missed = [pose for pose, of in enumerate(found.specification_results[0].results) if of.verdict == "not met"]
    assert missed
    figure = Figure()
    axes = figure.subplots()
    assert found.plot(axes=axes) is axes
    lines = [line.get_ydata() for line in axes.get_lines()]
    assert any(np.allclose(line, 1e3 * found.quantile[1, 0]) for line in lines if len(line) == 5)
    assert any(np.allclose(line, [40, 40]) for line in lines if len(line) == 2)
    assert sum(patch.get_x() + 0.5 - 1 in missed for patch in axes.patches) == len(missed)
    made = found.plot("attitude")
    assert isinstance(made, Figure)
    assert sample_poses(MODEL, np.tile(Q, 8), samples=2).plot() is not None
    with pytest.raises(UnknownNameError, match="quantity"):
        found.plot("position.x")


def test_two_specifications_of_one_kind_keep_their_order() -> None:
    two = (Specification("position.norm", 1.0, 0.5), Specification("position.norm", 1e-6, 0.5))
    found = sample_poses(MODEL, Q, samples=300, specifications=two)
    assert [of.met for of in found.specification_results] == [True, False]


@pytest.mark.slow
def test_everywhere_is_the_count_of_robots_that_keep_the_limit_at_all_poses() -> None:
    # more robots than a task has, the last task not full
    samples = 18_000
    largest = np.zeros((2, samples))
    for q in Q.T:
        errors = pp.monte_carlo(MODEL, q, samples=samples, seed=9, keep_samples=True).errors
        assert errors is not None
        largest = np.maximum(largest, [np.linalg.norm(errors[:3], axis=0), np.abs(errors[2])])
    limits = np.quantile(largest, 0.3, axis=1)
    specifications = [
        Specification(f"position.{part}", limit, 0.5) for part, limit in zip(("norm", "z"), limits, strict=True)
    ]
    kept = largest <= limits[:, None]
    found = sample_poses(MODEL, Q, samples=samples, seed=9, specifications=specifications, everywhere=True, threads=2)
    assert found.kept_everywhere == tuple(kept.sum(axis=1))
    alone = sample_poses(MODEL, Q, samples=samples, seed=9, specifications=specifications, everywhere=True, threads=1)
    assert alone.to_json() == found.to_json()
    entry = json.loads(found.to_json())["spec"][0]["everywhere"]
    assert entry["probability"] == kept[0].mean()


def offsets(scope: Scope) -> ErrorModel:
    """Return the paper's arm with one normal offset of its first joint."""
    source = JointOffset(joint=MODEL.chain.joint_names[0], offset="turn")
    return ErrorModel(MODEL.chain, Space((Draw("turn", Normal(1e-3), scope),)), [source])


def test_at_equal_poses_robots_keep_it_at_all_or_none_if_drawn_once_and_independently_if_drawn_anew() -> None:
    same = np.repeat(Q[:, :1], 3, axis=1)
    for scope, power in ((Scope.UNIT, 1), (Scope.POSE, 3)):
        # the turn about its axis is inside a standard deviation for 68.27 % of the draws
        found = sample_poses(
            offsets(scope), same, samples=40_000, specifications=["attitude 1 mrad @ 50 %"], everywhere=True
        )
        of_all = found.specification_results[0].everywhere
        assert of_all is not None
        expected = (2 * stats.norm.cdf(1) - 1) ** power
        assert abs(of_all.probability - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 40_000)
        if scope is Scope.UNIT:
            assert of_all.probability == found.probability[0, 0]
            assert found.met
        else:
            # met at every pose, but not by enough robots at all of them
            assert all(result.met for result in found.specification_results[0].results)
            assert found.specification_results[0].verdict == "not met"
            assert not found.met
