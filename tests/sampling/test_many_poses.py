"""Many poses: one at a time, closed form between poses, verdicts of the worst; planning of bins; runs until precise enough."""

import itertools
import json
import re
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

import precision_pin as pp
from precision_pin.base.errors import InputError, PrecisionPinWarning, UnknownNameError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Empirical, Law, Lognormal, Normal, TwoPoint, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling.blocks import first_order_skewness, planned
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sampling.poses_result import LEVELS, PosesResult, PosesSpecification
from precision_pin.sampling.table import poses_table
from precision_pin.sources import JointOffset
from precision_pin.sources.backlash import Backlash
from precision_pin.statistics import QUANTITIES, Specification, SpecificationResult, quantile_ranks, quantity_values
from sampling.cases import AT, MODEL
from support.checks.common import one_link
from support.plain_robot import PlainRobot, geometric_jacobian

JOINTS = MODEL.chain.joint_names
SPECIFICATIONS = (Specification("position.norm", 0.035, 0.9), Specification("attitude.z", 1e-3, 0.5))
Q = np.random.default_rng(2).uniform(-1.5, 1.5, (len(JOINTS), 70))
ARRAYS = [name for name, kind in PosesResult.__annotations__.items() if kind == "Array"]


STD = 3e-3
ALL = range(len(JOINTS))


def offsets(*drawn: tuple[Any, ...]) -> ErrorModel:
    """Return the paper's arm with joint offsets, each given by its joint's number, its law and, if not a unit's, its scope."""
    draws = tuple(Draw(f"o{k}", *law_and_scope) for k, (_, *law_and_scope) in enumerate(drawn))
    sources = [JointOffset(joint=JOINTS[of[0]], offset=draw.name) for of, draw in zip(drawn, draws, strict=True)]
    return ErrorModel(MODEL.chain, Space(draws), sources)


ONCE = [(k, Normal(STD)) for k in ALL]
AGAIN = (1, Uniform(STD), Scope.POSE)
MIXED = offsets(*ONCE, AGAIN, (2, Uniform(STD), Scope.VISIT))


@pytest.mark.slow
def test_each_pose_has_the_samples_of_one_pose_alone() -> None:
    # more poses than are worked on together, and a last block that is not full
    samples = BLOCK + 3000
    settings = {"samples": samples, "seed": 3, "specifications": SPECIFICATIONS}
    found = sample_poses(MODEL, Q, **settings)
    assert found.poses == 70
    for pose in (0, 63, 64, 69):
        alone = pp.monte_carlo(MODEL, Q[:, pose], keep_samples=True, **settings)
        errors = alone.errors
        np.testing.assert_allclose(found.mean[:, pose], errors.mean(axis=1), rtol=1e-10, atol=1e-15)
        scale = np.abs(alone.covariance).max()
        np.testing.assert_allclose(found.covariance[:, :, pose], np.cov(errors), rtol=0, atol=1e-10 * scale)
        norms = quantity_values(errors)[[0, 4]]
        np.testing.assert_allclose(found.norm_mean[:, pose], norms.mean(axis=1), rtol=1e-10)
        np.testing.assert_allclose(found.norm_std[:, pose], norms.std(axis=1, ddof=1), rtol=1e-8)
        np.testing.assert_allclose(found.norm_max[:, pose], norms.max(axis=1), rtol=1e-14)
        ordered, width = np.sort(norms, axis=1), 0.13 * found.norm_std[:, pose]
        for k, level in enumerate(LEVELS):
            resolution = found.quantile_resolution[k, :, pose]
            assert (np.abs(found.quantile[k, :, pose] - np.quantile(norms, level, axis=1)) <= resolution).all()
            assert (resolution <= width).all()
            # the bins only widen the interval between two order statistics, by less than a bin on either side
            lowest, highest = ordered[:, np.array(quantile_ranks(samples, level, 0.95)) - 1].T
            lower, upper = found.quantile_interval[k, :, :, pose].T
            assert ((lowest - width <= lower) & (lower <= lowest)).all()
            assert ((highest <= upper) & (upper <= highest + width)).all()
        for k, specification in enumerate(alone.summary.specifications):
            assert found.probability[k, pose] == specification.probability
            np.testing.assert_array_equal(found.probability_interval[k, :, pose], specification.interval)


@pytest.mark.parametrize(("model", "samples"), [("exact", 1), ("linear", 2), ("exact", 40)])
def test_few_samples_resolve_little(model: Any, samples: int) -> None:
    found = sample_poses(MODEL, Q[:, :3], samples=samples, model=model)
    errors = sampler.errors(sampler.to_arrays(MODEL.at(Q[:, 2])), model, 0, 0, samples)
    np.testing.assert_allclose(found.mean[:, 2], errors.mean(axis=1), rtol=1e-10)
    assert np.isnan(found.covariance).all() == (samples == 1)
    assert np.isnan(found.norm_std).all() == (samples == 1)
    # 36 or more of 40 samples lie below the 95 % quantile, and none is sure to lie above it (Wilks: 73 samples do)
    assert np.isnan(found.quantile[1]).all()
    assert np.isnan(found.quantile[0]).all() == (samples < 6)


@pytest.mark.slow
def test_threads_processes_and_an_executor_give_the_same_bits() -> None:
    told: list[int] = []
    samples, settings = BLOCK + 77, {"specifications": SPECIFICATIONS, "progress": told.append}
    with ThreadPoolExecutor(3) as pool:
        workers: list[Any] = [{"threads": 1}, {"threads": 3}, {"processes": 1}, {"executor": pool}]
        one, *others = (sample_poses(MIXED, Q[:, :66], samples=samples, **how, **settings) for how in workers)
        maps = [pp.map_poses(MODEL, Q[:, :5], samples=400, **how).to_json() for how in (workers[0], workers[-1])]
    assert maps[0] == maps[1]
    for other, name in itertools.product(others, ARRAYS):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert sum(told) == 4 * 66 * samples
    assert len(told) > 8


def test_a_group_that_is_done_is_told_of_before_the_next_is_laid_out(monkeypatch: pytest.MonkeyPatch) -> None:
    happened: list[str] = []
    lay_out = sampler.to_arrays_at_poses

    def at_once(function: Any, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*arguments))
        return future

    monkeypatch.setattr(sampler, "to_arrays_at_poses", lambda poses: happened.append("laid out") or lay_out(poses))
    executor = SimpleNamespace(submit=at_once)
    sample_poses(MODEL, Q, samples=100, executor=executor, progress=lambda _: happened.append("told"))
    assert happened == ["laid out", "told"] * 2


def test_poses_do_not_depend_on_those_beside_them_but_for_rounding() -> None:
    together = sample_poses(MIXED, Q[:, :5], samples=500, seed=1)
    np.testing.assert_array_equal(together.mean[:, 0], sample_poses(MIXED, Q[:, :1], samples=500, seed=1).mean[:, 0])
    layouts = sampler.to_arrays_at_poses(list(MIXED.at_columns(Q[:, :5])))
    assert all(layout.draws is layouts[0].draws and layout.formulas is layouts[0].formulas for layout in layouts)
    again = sampler.errors(layouts[4], "exact", 1, 0, 500, pose=4)
    np.testing.assert_allclose(together.mean[:, 4], again.mean(axis=1), rtol=1e-10)


@pytest.mark.filterwarnings("ignore:.*W_SQUARE_POSES")
def test_covariance_between_poses_against_samples() -> None:
    samples, pairs = 40_000, [(0, 1), (2, 3), (1, 1)]
    found = sample_poses(MIXED, Q[:, :4], samples=10, seed=5)
    at = [MIXED.at(q) for q in Q[:, :4].T]
    errors = [sampler.errors(sampler.to_arrays(one), "exact", 5, 0, samples, pose=k) for k, one in enumerate(at)]
    # 99.9 % confidence that all of the numbers compared lie within: Bonferroni over pairs × 36
    factor = stats.norm.ppf(1 - 0.0005 / (len(pairs) * 36))
    for one, other in pairs:
        closed = found.between(one, other)
        sample = np.cov(errors[one], errors[other])[:6, 6:]
        squares = [(part - part.mean(axis=1, keepdims=True)) ** 2 for part in (errors[one], errors[other])]
        spread = np.sqrt(squares[0] @ squares[1].T / samples - sample**2)
        # the tangent leaves out what offsets of 3 mrad do in second order, 1e-5 of the covariance at most
        limit = factor * spread / np.sqrt(samples) + 1e-4 * np.abs(closed).max()
        assert (np.abs(sample - closed) <= limit).all()
    np.testing.assert_allclose(found.between(0, 1), found.between(1, 0).T, rtol=1e-12, atol=1e-20)
    # what is drawn anew at each pose has no part in it, but a part in the pose's own covariance
    np.testing.assert_allclose(found.between(1, 1), at[1].covariance, rtol=1e-12, atol=1e-20)
    all_draws = at[0].jacobian @ MIXED.space.covariance @ at[1].jacobian.T
    assert np.abs(found.between(0, 1) - all_draws).max() > 0.1 * np.abs(all_draws).max()


def test_poses_by_name_and_by_joint() -> None:
    by_name = sample_poses(MODEL, ["paper"], samples=100)
    assert (by_name.names, by_name.pose("paper")) == (("paper",), 0)
    values = {name: [value] for name, value in zip(JOINTS, MODEL.poses["paper"], strict=True)}
    by_joint = sample_poses(MODEL, values, samples=100)
    np.testing.assert_array_equal(by_name.mean, by_joint.mean)
    assert by_joint.names == ("",)
    with pytest.raises(UnknownNameError):
        by_joint.pose("paper")


@pytest.mark.slow
def test_as_a_dataset() -> None:
    found = sample_poses(MODEL, Q[:, :3], samples=1000, seed=9, specifications=SPECIFICATIONS)
    data = found.to_xarray()
    assert (dict(data.sizes)["pose"], data.attrs["seed"], data.attrs["samples"]) == (3, "9", "1000")
    assert data["quantile"].sel(probability=0.95, norm="attitude", pose=2) == found.quantile[1, 1, 2]
    assert data["covariance"].sel(component="dx", component_2="rz", pose=1) == found.covariance[0, 5, 1]
    assert data["inside_interval"].sel(end="upper").shape == (2, 3)
    assert "precision-pin" in data.attrs["versions"]
    assert "3 poses" in repr(found)


WRONG: list[tuple[Any, dict[str, Any], str]] = [
    (Q[:, :0], {}, "no poses to sample"),
    ([], {}, "no poses to sample"),
    (["papper"], {}, "papper"),
    (Q[:2], {}, "joint values of shape"),
    (Q.T, {}, "transpose"),
    (np.where(Q > 1.4, np.nan, Q), {}, "must be finite"),
    ({"joint1": [0.0]}, {}, "joint2"),
    (Q, {"samples": 0}, "number of samples"),
    (Q, {"samples": 2**32}, "4294967295"),
    (Q, {"samples": 10.0}, "number of samples"),
    (Q, {"seed": -1}, "seed"),
    (Q, {"threads": 0}, "threads"),
    (Q, {"model": "cubic"}, "exact or linear"),
    (Q, {"confidence": 1.0}, "confidence"),
    ([[0.0] * 4, [0.0] * 3], {}, "pose 1 of the list: 3 joint values"),
    ([[0.0] * 4, [0.0, 0.0, float("nan"), 0.0]], {}, "pose 1 of the list: .*finite"),
    ([[0.0] * 4, [True] * 4], {}, "pose 1 of the list: .*numbers"),
    ([[0.0] * 4, np.zeros((4, 1))], {}, "pose 1 of the list: "),
    ([[0.0] * 4, ["0"] * 4], {}, "pose 1 of the list: .*numbers"),
]


def test_wrong_inputs_are_told_in_a_line() -> None:
    for q, settings, message in WRONG:
        with pytest.raises(InputError, match=message) as caught:
            sample_poses(MODEL, q, **{"samples": 10, **settings})
        assert "\n" not in str(caught.value)
    too_many = "1,048,576 poses; with draws of pose or visit scope at most 1,048,575"
    with pytest.raises(InputError, match=too_many):
        sample_poses(MIXED, np.zeros((len(JOINTS), 2**20)), samples=1)
    found = sample_poses(MODEL, Q[:, :2], samples=3)
    for wrong in (-1, 2, True, 0.5):
        with pytest.raises(InputError, match="number of a pose must be a whole number from 0 to 1"):
            found.between(0, wrong)  # type: ignore[arg-type]


def test_errors_far_too_large() -> None:
    for std, model, message in (
        (1e3, "exact", "180° or more"),
        (1e160, "exact", "180°|too large to compute with"),
        (1e300, "linear", "too large to compute with|not a finite number"),
    ):
        with pytest.raises(InputError, match=message):
            sample_poses(offsets((0, Normal(std))), Q[:, :2], samples=10, model=model)  # type: ignore[arg-type]


@pytest.mark.slow
def test_strained_statics_are_said_of_the_worst_pose() -> None:
    loaded = ErrorModel.load(PAPER_SHEET)
    model = ErrorModel(loaded.chain, loaded.sheet.space, loaded.sources, loaded.poses)
    q = model.configuration()
    with pytest.warns(PrecisionPinWarning, match="W_STATICS: pose 3: loads at the undeflected pose"):
        found = pp.sample_poses(model, [q, q, q + np.array([0, -1.4, 0, 0])], samples=64)
    assert found.norm_mean[0].argmax() == 2
    assert sum("W_STATICS" in line for line in found.warnings) == 1
    # the sheet accepts it: no warning, but the result says so with the reason
    accepted = pp.sample_poses(loaded, [q, q, q + np.array([0, -1.4, 0, 0])], samples=64).warnings
    assert [line for line in accepted if ": note W_STATICS: pose 3: " in line and line.endswith("the undeflected pose")]


FIVE = np.random.default_rng(5).uniform(-1.0, 1.0, (len(MODEL.chain.joint_names), 5))
JUDGED = ("40 mm", "z 15 mm @ 60 %", "30 mrad @ 99 %", "x 1 m", "x 1 um @ 50 %")


def judged(*outcomes: tuple[float, float, float, bool]) -> PosesSpecification:
    results = tuple(
        SpecificationResult("position.norm", 1e-3, 0.9, share, (low, high), varies)
        for share, low, high, varies in outcomes
    )
    return PosesSpecification(results, tuple("abcd"[: len(results)]), tuple(float(k) for k in range(len(results))))


@pytest.mark.slow
def test_every_pose_has_the_verdict_of_that_pose_alone() -> None:
    found = sample_poses(MODEL, FIVE, samples=3000, seed=4, specifications=JUDGED)
    alone = [pp.monte_carlo(MODEL, q, samples=3000, seed=4, specifications=JUDGED) for q in FIVE.T]
    verdicts = set()
    for rank, (over_poses, entry) in enumerate(zip(found.specification_results, found.to_dict()["spec"], strict=True)):
        expected = [one.summary.specifications[rank] for one in alone]
        assert [pose["probability"] for pose in entry["poses"]] == found.probability[rank].tolist()
        assert [pose["name"] for pose in entry["poses"]] == [f"pose {k}" for k in range(1, 6)]
        assert entry["met"] or entry["worst_pose"] == f"pose {1 + int(np.argmin(found.probability[rank]))}"
        assert list(over_poses.results) == expected
        assert over_poses.met is all(one.met for one in expected)
        verdicts.add(over_poses.met)
    assert verdicts == {True, False}
    assert found.met is False
    assert sample_poses(MODEL, FIVE, samples=500).met is True


def test_the_worst_pose_decides() -> None:
    met, undecided, missed = (0.95, 0.92, 0.97, True), (0.9, 0.88, 0.92, True), (0.8, 0.78, 0.82, True)
    alike = (1.0, 0.99, 1.0, False)
    for outcomes, verdict, worst in (
        ((met, met), "met", 1),
        ((met, undecided), "undecided", 1),
        ((undecided, missed, met), "not met", 1),
        # a pose at which no tolerance was tried shows nothing, as alone
        ((met, alike), "nothing to judge", 1),
        # of the same share the pose with the larger errors
        ((met, met, met), "met", 2),
    ):
        found = judged(*outcomes)
        assert (found.verdict, found.met, found.worst) == (verdict, verdict == "met", worst), verdict


@pytest.mark.slow
def test_a_quantity_that_no_sample_moved_but_the_first_order_does_is_judged() -> None:
    # one sample varies in nothing; the single pose falls back on the first order as well
    found = sample_poses(MODEL, FIVE[:, :2], samples=1, specifications=["1 m @ 1 %"])
    alone = pp.monte_carlo(MODEL, FIVE[:, 0], samples=1, specifications=["1 m @ 1 %"])
    assert found.specification_results[0].results[0] == alone.summary.specifications[0]
    nothing = sample_poses(ErrorModel(MODEL.chain, MODEL.space, []), FIVE[:, :2], samples=50, specifications=["1 m"])
    assert nothing.specification_results[0].verdict == "nothing to judge"
    assert "NOTHING TO JUDGE" in poses_table(nothing)
    assert not nothing.met
    # without specifications the worst pose has the largest error
    found = sample_poses(MODEL, FIVE, samples=2000)
    assert found.worst_pose == np.argmax(found.quantile[1, 0])
    few = sample_poses(MODEL, FIVE, samples=2)
    assert few.worst_pose == np.argmax(few.norm_mean[0])
    judging = sample_poses(MODEL, FIVE, samples=2000, specifications=["1 m", "40 mm"])
    assert judging.worst_pose == np.argmin(judging.probability[1])


@pytest.mark.slow
def test_the_plot_shows_the_quantiles_the_limit_and_the_poses_that_miss_it() -> None:
    found = sample_poses(MODEL, FIVE, samples=2000, specifications=["40 mm"])
    missed = [pose for pose, of in enumerate(found.specification_results[0].results) if of.verdict == "not met"]
    assert missed
    axes = Figure().subplots()
    assert found.plot(axes=axes) is axes
    lines = [line.get_ydata() for line in axes.get_lines()]
    for expected in (1e3 * found.quantile[1, 0], [40, 40]):
        assert any(len(line) == len(expected) and np.allclose(line, expected) for line in lines)
    assert sum(patch.get_x() + 0.5 - 1 in missed for patch in axes.patches) == len(missed)
    assert isinstance(found.plot("attitude"), Figure)
    width, height = 25.4 * pp.monte_carlo(MODEL, samples=200).plot("components").get_size_inches()
    assert (width, height < width) == (pytest.approx(174), True)
    assert sample_poses(MODEL, np.tile(FIVE, 8), samples=2).plot() is not None
    with pytest.raises(UnknownNameError, match="quantity"):
        found.plot("position.x")


@pytest.mark.slow
def test_everywhere_is_the_count_of_robots_that_keep_the_limit_at_all_poses() -> None:
    # more robots than a task has, the last task not full
    settings = {"samples": 18_000, "seed": 9}
    at_poses = [pp.monte_carlo(MODEL, q, keep_samples=True, **settings).errors for q in FIVE.T]
    largest = np.max([np.abs(quantity_values(errors)[[0, 3]]) for errors in at_poses], axis=0)
    limits = np.quantile(largest, 0.3, axis=1)
    kept = largest <= limits[:, None]
    asked = [Specification(name, limit, 0.5) for name, limit in zip(("position.norm", "z"), limits, strict=True)]
    found = sample_poses(MODEL, FIVE, specifications=asked, everywhere=True, threads=2, **settings)
    assert found.kept_everywhere == tuple(kept.sum(axis=1))
    entry = json.loads(found.to_json())["spec"][0]["everywhere"]
    assert entry["probability"] == kept[0].mean()


def test_at_equal_poses_robots_keep_it_at_all_or_none_if_drawn_once_and_independently_if_drawn_anew() -> None:
    same = np.repeat(FIVE[:, :1], 3, axis=1)
    for scope, power in ((Scope.UNIT, 1), (Scope.POSE, 3)):
        # the turn about its axis is inside a standard deviation for 68.27 % of the draws
        asked = {"samples": 40_000, "specifications": ["attitude 1 mrad @ 50 %"], "everywhere": True}
        found = sample_poses(offsets((0, Normal(1e-3), scope)), same, **asked)
        of_all = found.specification_results[0].everywhere
        expected = (2 * stats.norm.cdf(1) - 1) ** power
        assert abs(of_all.probability - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 40_000)
        assert (of_all.probability == found.probability[0, 0]) == (power == 1)
        # met at every pose, but not by enough robots at all of them
        assert all(result.met for result in found.specification_results[0].results)
        assert (found.met, found.specification_results[0].verdict == "met") == (power == 1, power == 1)


STRETCHED = ([0, 0, 0, 0], [0, 90, 0, 0], [-90, 0, 0, -90], [-90, 0, 0, 0], [0, -90, 0, 0], [90, 0, 90, 0])
"""Poses of the paper's arm along its axes, degrees: some components are moved by products of offsets alone."""


@pytest.mark.fast(2)
@pytest.mark.parametrize("number", range(len(STRETCHED)))
def test_quantiles_are_those_of_the_sorted_samples_where_the_first_order_vanishes(number: int) -> None:
    law = (Normal(1e-3), Uniform(1e-3), Lognormal(1e-3, 1e-3))[number % 3]
    model = offsets(*((k, law) for k in ALL))
    found = pp.monte_carlo(model, np.radians(STRETCHED[number]), samples=20_000, keep_samples=True)
    for quantity, values in zip(QUANTITIES, quantity_values(found.errors), strict=True):
        if np.abs(values).max() < 1e-14:
            continue
        distribution = found.summary.distribution(quantity)
        for level in distribution.levels:
            gap = abs(distribution.quantile(level) - np.quantile(values, level))
            assert gap <= distribution.quantile_error(level), (quantity, level)
            # a bin is 1/512 of the distance from the middle, and a lognormal law's quantiles lie ten spreads away
            assert distribution.quantile_error(level) <= 0.03 * values.std(), (quantity, level)
    assert not any("W_BINS" in warning for warning in found.warnings)


def test_the_plan_is_the_middle_of_the_seed_s_first_samples_whatever_the_length():
    plan = planned(AT, sampler.to_arrays(AT), "exact", 3)
    errors = pp.monte_carlo(MODEL, "paper", samples=512, seed=3, keep_samples=True).errors
    ordered = np.sort(quantity_values(errors), axis=1)
    assert (ordered[:, 250] <= plan.centre).all()
    assert (plan.centre <= ordered[:, 261]).all()
    short, long = (pp.monte_carlo(MODEL, "paper", samples=n, seed=3) for n in (20, 20_000))
    assert short.position.norm.min >= long.position.norm.min


def test_a_run_that_ends_before_the_pilot_fails_is_not_stopped_by_it():
    # an offset of more than half a turn, which is refused, in one robot of 400
    model = offsets(*((k, TwoPoint(2.0, 2.0, probability=1 / 400)) for k in ALL))
    layout = sampler.to_arrays(model.at([0, 0, 0, 0]))
    jumps = ((seed, np.flatnonzero(sampler.sample(layout, seed, 0, 512).any(axis=0))) for seed in range(50))
    seed = next(seed for seed, units in jumps if units.size and units[0] >= 30)
    assert pp.monte_carlo(model, [0, 0, 0, 0], samples=30, seed=seed).samples == 30
    with pytest.raises(pp.InputError, match="180°"):
        pp.monte_carlo(model, [0, 0, 0, 0], samples=512, seed=seed)


@pytest.mark.filterwarnings("ignore:.*W_BINS")
def test_a_result_warns_of_quantiles_in_wide_bins():
    """Offsets that jump in one robot of a thousand: a stretched arm's dz is zero or a product of jumps, no pilot tells which."""
    model = offsets(*((k, TwoPoint(1e-3, 1e-3, probability=1e-3)) for k in ALL))
    found = pp.monte_carlo(model, np.radians([0, 90, 0, 0]), samples=200_000, keep_samples=True)
    assert any("W_BINS" in line and "position.z" in line for line in found.warnings)
    z = found.position.z
    for level, exact in zip(z.levels, np.quantile(found.errors[2], z.levels), strict=True):
        low, high = z.quantile_interval(level)
        assert low <= exact <= high
        assert abs(z.quantile(level) - exact) <= z.quantile_error(level)
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
    model = offsets((0, Normal(1e-4)), (1, TwoPoint(1e-2, 1e-2, probability=1e-5)))
    found = pp.monte_carlo(model, np.radians([0, 45, 0, 0]), samples=3000)
    of = {quantity: found.summary.distribution(quantity) for quantity in QUANTITIES}
    assert any(one.std > 0 and one.std_interval() is None for name, one in of.items() if "norm" not in name)
    assert of["position.norm"].std_interval() is of["attitude.norm"].std_interval() is None


TARGET = "95 % to 0.03 mm"


@pytest.mark.slow
def test_it_stops_at_the_first_look_that_is_precise_enough() -> None:
    found = pp.monte_carlo(MODEL, samples=10**8, until=[TARGET], threads=1)
    looks = found.samples // BLOCK
    assert found.samples == looks * BLOCK
    assert looks & (looks - 1) == 0
    assert looks > 1
    half_width = found.position.norm.half_width(0.95)
    assert half_width <= 3e-5
    before = pp.monte_carlo(MODEL, samples=found.samples // 2)
    assert before.position.norm.half_width(0.95) > 3e-5
    told = {
        "target": TARGET,
        "half_width": pytest.approx(half_width),
        "tolerance": pytest.approx(3e-5),
        "reached": True,
    }
    known = pp.monte_carlo(MODEL, samples=found.samples).to_dict()
    assert found.to_dict() == {**known, "until": [told]}


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_to_the_same_end(tmp_path: Path) -> None:
    settings = {"samples": 10**8, "until": [TARGET], "threads": 1}
    saved = {**settings, "journal": tmp_path / "run.journal", "resume": True}
    for stop_after in (1, 3):
        seen = itertools.accumulate(itertools.repeat(1))

        def progress(count: int, seen: Any = seen, stop_after: int = stop_after) -> None:
            if count * next(seen) >= stop_after * BLOCK:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            pp.monte_carlo(MODEL, progress=progress, **saved)
    assert pp.monte_carlo(MODEL, **saved).to_dict() == pp.monte_carlo(MODEL, **settings).to_dict()
    with pytest.raises(InputError, match=r"until was '95 % to 0\.03 mm', is '95 % to 0\.04 mm'"):
        pp.monte_carlo(MODEL, **{**saved, "until": ["95 % to 0.04 mm"]})


@pytest.mark.filterwarnings("ignore:.*W_UNTIL")
def test_samples_that_do_not_suffice_are_told_with_how_many_would() -> None:
    found = pp.monte_carlo(MODEL, samples=3 * BLOCK + 5, until=["mean to 1 um"])
    assert found.samples == 3 * BLOCK + 5
    (told,) = [line for line in found.warnings if "W_UNTIL" in line]
    expected = (1.96 * found.position.norm.std / 1e-6) ** 2
    assert float(re.search(r"about (\S+) are needed", told)[1]) == pytest.approx(expected, rel=0.01)


def test_what_no_number_of_samples_gives_is_refused() -> None:
    for asked, message in (
        (
            {"samples": 10**12, "until": ["99.73 % to 1 um"]},
            r"resolved to \S+ m only, the target.s tolerance is 1e-06 m",
        ),
        ({"until": ["sometime"]}, "target 'sometime' is not understood"),
        ({"until": [TARGET], "keep_samples": True}, "keep_samples is not possible"),
    ):
        with pytest.raises(InputError, match=message):
            pp.monte_carlo(MODEL, **asked)


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


GAP = 1e-3


def hinge(*offsets: Draw) -> ErrorModel:
    """Return a hinge of 1 m about z, which carries no weight, with a gap, and what else turns it."""
    sources = [JointOffset(joint="hinge", offset=offset) for offset in offsets]
    return ErrorModel(one_link(), Space(), [Backlash(joint="hinge", backlash=GAP, band=1.0), *sources])


def test_backlash_alone_by_hand() -> None:
    model = hinge(Draw("zero", Normal(2e-3)))
    found = pp.sample_approaches(model, [0.0], approaches=["hinge +", "hinge -", "hinge +"], robots=50, cycles=4)
    assert found.approaches == ((1,), (-1,), (1,))
    assert found.errors.shape == (3, 4, 6, 50)
    # a robot repeats itself from one side; from both, half of its visits lie a gap away: l is half the chord each time
    chord = 2 * np.sin(GAP / 2)
    np.testing.assert_allclose(found.variation, chord, rtol=1e-11)
    np.testing.assert_allclose(found.unidirectional, 0.0, atol=1e-15)
    sides: dict[str, Any] = {"approaches": ["hinge +", "hinge -"], "robots": 50, "cycles": 4}
    two = pp.sample_approaches(model, [0.0], **sides)
    np.testing.assert_allclose(two.bidirectional, chord / 2, rtol=1e-9)
    np.testing.assert_array_equal(two.shifts, two.errors[:, :, :3])
    # behind the drive: below the nominal place after going up
    zero = model.space.sample(0, 0, 50)[model.space.index["zero"]]
    np.testing.assert_allclose(two.errors[0, 0, 1], np.sin(zero - GAP / 2), rtol=0, atol=1e-15)
    # of the robots from the eighth on, a point that lies sqrt(2² + 0.5²) m from the axis
    point = pp.sample_approaches(model, [0.0], target=(1.0, 0.5, 0.2), first=7, **{**sides, "robots": 43})
    np.testing.assert_allclose(point.variation, chord * np.hypot(2.0, 0.5), rtol=1e-11)
    np.testing.assert_array_equal(point.errors, two.errors[..., 7:])
    turn = point.errors[:, :, 5]
    np.testing.assert_allclose(point.shifts[:, :, 0], 2 * (np.cos(turn) - 1) - 0.5 * np.sin(turn), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_visits_against_the_formulas_of_the_standard() -> None:
    model = hinge(Draw("visit", Uniform(2e-3), Scope.VISIT), Draw("pose", Normal(1e-3), Scope.POSE))
    found = pp.sample_approaches(model, [0.0], approaches=["hinge +", "hinge -"], robots=3, cycles=30, seed=5, number=7)
    at = [model.at([0.0], approach=f"hinge {sign}") for sign in "+-"]
    for robot in range(3):
        visits = np.array(
            [
                at[rank].exact(model.space.sample(5, robot, 1, pose=7, visit=30 * rank + cycle))[:, 0]
                for rank, cycle in np.ndindex(2, 30)
            ]
        )
        np.testing.assert_allclose(found.errors[..., robot].reshape(60, 6), visits, rtol=0, atol=1e-14)
        up, down = visits[:30, :3], visits[30:, :3]
        distance = np.linalg.norm(up.mean(axis=0) - down.mean(axis=0))
        assert found.variation[robot] == pytest.approx(distance, rel=1e-9)
        for cloud, value in ((up, found.unidirectional[0, robot]), (visits[:, :3], found.bidirectional[robot])):
            lengths = np.linalg.norm(cloud - cloud.mean(axis=0), axis=1)
            assert value == pytest.approx(lengths.mean() + 3 * lengths.std(ddof=1), rel=1e-9)
    assert (found.bidirectional > found.unidirectional).all()


def test_wrong_approaches_are_told_in_a_line() -> None:
    for settings, message in (
        ({"approaches": ["hinge +"]}, "1 approaches; to compare them, give two or more"),
        ({"approaches": ["hinge +", "hing -"]}, "did you mean 'hinge'"),
        ({"cycles": 1}, "the number of cycles must be a whole number from 2 to 2047, got 1"),
        ({"robots": 0}, "the number of robots"),
        ({"model": "cubic"}, "exact or linear"),
    ):
        with pytest.raises(InputError, match=message):
            pp.sample_approaches(hinge(), [0.0], **{"approaches": ["hinge +", "hinge -"], "robots": 2, **settings})


HERE, THERE = np.array([0.1, 0.4, 0.8, -0.6]), np.array([-0.5, 0.1, 1.2, 0.3])


def test_each_robot_is_the_one_that_the_model_displaces_at_both_poses() -> None:
    found = pp.relative(MIXED, HERE, THERE, samples=300, seed=5, keep_samples=True)
    here, there = (MIXED.space.sample(5, 0, 300, pose=pose) for pose in (0, 1))
    expected = MIXED.at(HERE).exact(here) - MIXED.at(THERE).exact(there)
    np.testing.assert_allclose(found.errors, expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.nominal, 0.0, atol=1e-15)


@pytest.mark.slow
def test_the_covariance_is_that_of_the_difference_of_slopes_and_of_both_visits() -> None:
    samples = 2 * BLOCK
    found, same = (pp.relative(MIXED, HERE, THERE, samples=samples, model="linear", threads=n) for n in (1, 3))
    reading = PlainRobot.parse(Path(MODEL.chain.robot.file).read_text("utf-8"))
    poses = [dict(zip(JOINTS, q, strict=True)) for q in (HERE, THERE)]
    here, there = (geometric_jacobian(reading, JOINTS, "tool", pose) for pose in poses)
    expected = STD**2 * (here - there) @ (here - there).T
    for joint in (1, 2):  # a uniform law of half-width a has the variance a²/3
        expected += STD**2 / 3 * sum(np.outer(slopes[:, joint], slopes[:, joint]) for slopes in (here, there))
    scale = np.sqrt(np.diag(expected))
    # four standard errors of a covariance, which are largest for normal numbers; the slopes are differences
    allowed = 4 * np.sqrt((np.outer(scale, scale) ** 2 + expected**2) / samples)
    assert (np.abs(found.covariance - expected) <= allowed + 1e-15).all()
    assert found.to_json() == same.to_json()


def test_a_pose_relative_to_itself_leaves_what_two_visits_differ_by() -> None:
    with pytest.warns(PrecisionPinWarning, match="W_NOTHING_VARIES"):
        still = pp.relative(offsets(*ONCE, AGAIN), HERE, HERE, samples=1000)
    assert still.position.norm.max == still.attitude.norm.max == 0.0
    visits = pp.relative(MIXED, HERE, HERE, samples=4000, keep_samples=True)
    # the tip turns about joint 3 by the difference of two uniform numbers: a triangular law
    turned = np.linalg.norm(visits.errors[3:], axis=0)
    assert stats.kstest(turned / (2 * STD), lambda x: 1 - (1 - np.clip(x, 0, 1)) ** 2).pvalue > 1e-3


@pytest.mark.slow
def test_what_is_counted_said_and_refused() -> None:
    asked = {"samples": 2000, "specifications": ["1 mm", "100 mm"], "keep_samples": True, "confidence": 0.9}
    found = pp.relative(MODEL, "paper", THERE, **asked)
    kept = np.count_nonzero(np.linalg.norm(found.errors[:3], axis=0) <= 1e-3)
    assert found.summary.specifications[0].probability == kept / 2000
    assert found.pose_name == "paper"
    assert found.to_dict()["relative_to"] == {"name": "", "q": dict(zip(JOINTS, THERE.tolist(), strict=True))}
    assert "relative to a pose without a name" in repr(found)
    assert "relative_to" not in pp.monte_carlo(MODEL, samples=10).to_dict()
    with pytest.raises(UnknownNameError, match="pose"):
        pp.relative(MODEL, "paper", "home")
    with pytest.raises(InputError, match="threads"):
        pp.relative(MODEL, "paper", THERE, threads=0)
