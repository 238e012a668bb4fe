"""Sampling many poses: one pose at a time, the closed form between poses, threads, verdicts of the worst pose, wrong inputs."""

from __future__ import annotations

import json
from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.monte_carlo.table import poses_table
from precision_pin.base.errors import InputError, PrecisionPinWarning, UnknownNameError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sampling.poses_result import LEVELS, PosesResult, PosesSpecification
from precision_pin.sources import JointOffset
from precision_pin.statistics import Specification, SpecificationResult, quantile_ranks
from sampling.cases import MODEL

JOINTS = MODEL.chain.joint_names
SPECIFICATIONS = (Specification("position.norm", 0.035, 0.9), Specification("attitude.z", 1e-3, 0.5))
Q = np.random.default_rng(2).uniform(-1.5, 1.5, (len(JOINTS), 70))
ARRAYS = [name for name, kind in PosesResult.__annotations__.items() if kind == "Array"]


def offsets(scopes: dict[int, Scope]) -> ErrorModel:
    """Return the paper's arm with random joint offsets, partly common to all poses and partly drawn at each pose."""
    draws = [Draw(f"robot{k}", Normal(3e-3)) for k in range(len(JOINTS))]
    draws += [Draw(f"again{k}", Uniform(3e-3), scope) for k, scope in scopes.items()]
    sources = [
        JointOffset(joint=JOINTS[k], offset=draw.name)
        for k in range(len(JOINTS))
        for draw in draws
        if draw.name.endswith(str(k))
    ]
    return ErrorModel(MODEL.chain, Space(tuple(draws)), sources)


MIXED = offsets({1: Scope.POSE, 2: Scope.VISIT})


@pytest.mark.slow
def test_each_pose_has_the_samples_of_one_pose_alone() -> None:
    # more poses than are worked on together, and a last block that is not full
    samples = BLOCK + 3000
    found = sample_poses(MODEL, Q, samples=samples, seed=3, specifications=SPECIFICATIONS)
    assert found.poses == 70
    for pose in (0, 63, 64, 69):
        alone = pp.monte_carlo(
            MODEL, Q[:, pose], samples=samples, seed=3, specifications=SPECIFICATIONS, keep_samples=True
        )
        errors = alone.errors
        assert errors is not None
        np.testing.assert_allclose(found.mean[:, pose], errors.mean(axis=1), rtol=1e-10, atol=1e-15)
        scale = np.abs(alone.covariance).max()
        np.testing.assert_allclose(found.covariance[:, :, pose], np.cov(errors), rtol=0, atol=1e-10 * scale)
        norms = np.stack([np.linalg.norm(errors[:3], axis=0), np.linalg.norm(errors[3:], axis=0)])
        np.testing.assert_allclose(found.norm_mean[:, pose], norms.mean(axis=1), rtol=1e-10)
        np.testing.assert_allclose(found.norm_std[:, pose], norms.std(axis=1, ddof=1), rtol=1e-8)
        np.testing.assert_allclose(found.norm_max[:, pose], norms.max(axis=1), rtol=1e-14)
        for k, level in enumerate(LEVELS):
            exact = np.quantile(norms, level, axis=1)
            assert (np.abs(found.quantile[k, :, pose] - exact) <= found.quantile_resolution[k, :, pose]).all()
            assert (found.quantile_resolution[k, :, pose] <= 0.13 * found.norm_std[:, pose]).all()
            # the bins only widen the interval between two order statistics, by less than a bin on either side
            ranks = quantile_ranks(samples, level, 0.95)
            assert ranks is not None
            ordered = np.sort(norms, axis=1)
            lower, upper = found.quantile_interval[k, :, :, pose].T
            width = 0.13 * found.norm_std[:, pose]
            assert (lower <= ordered[:, ranks[0] - 1]).all()
            assert (lower >= ordered[:, ranks[0] - 1] - width).all()
            assert (upper >= ordered[:, ranks[1] - 1]).all()
            assert (upper <= ordered[:, ranks[1] - 1] + width).all()
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
def test_any_number_of_threads_gives_the_same_bits() -> None:
    told: list[int] = []
    samples, settings = 3 * BLOCK + 77, {"specifications": SPECIFICATIONS, "progress": told.append}
    one, many = (sample_poses(MIXED, Q[:, :66], samples=samples, threads=n, **settings) for n in (1, 3))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name), err_msg=name)
    assert sum(told) == 2 * 66 * samples
    assert len(told) > 4


def test_a_group_that_is_done_is_told_of_before_the_next_is_laid_out(monkeypatch: pytest.MonkeyPatch) -> None:
    happened: list[str] = []
    lay_out = sampler.to_arrays_at_poses

    class AtOnce:
        """Executor that runs a call before it returns the future."""

        def submit(self, function: Any, *arguments: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_result(function(*arguments))
            return future

    def laid_out(poses: Any) -> Any:
        happened.append("laid out")
        return lay_out(poses)

    monkeypatch.setattr(sampler, "to_arrays_at_poses", laid_out)
    sample_poses(MODEL, Q, samples=100, executor=AtOnce(), progress=lambda _: happened.append("told"))
    assert happened == ["laid out", "told"] * 2


def test_a_wrong_pose_of_a_list_is_named() -> None:
    for wrong, message in (
        ([0.0] * 3, "3 joint values"),
        ([0.0, 0.0, float("nan"), 0.0], ".*finite"),
        ([True, True, True, True], ".*numbers"),
        (np.zeros((4, 1)), ""),
        (["0", "0", "0", "0"], ".*numbers"),
    ):
        with pytest.raises(InputError, match=f"pose 1 of the list: {message}"):
            sample_poses(MODEL, [[0.0] * 4, wrong])


def test_poses_do_not_depend_on_those_beside_them_but_for_rounding() -> None:
    together = sample_poses(MIXED, Q[:, :5], samples=500, seed=1)
    alone = sample_poses(MIXED, Q[:, :1], samples=500, seed=1)
    np.testing.assert_array_equal(together.mean[:, 0], alone.mean[:, 0])
    layouts = sampler.to_arrays_at_poses(list(MIXED.at_columns(Q[:, :5])))
    assert all(layout.draws is layouts[0].draws and layout.formulas is layouts[0].formulas for layout in layouts)
    again = sampler.errors(layouts[4], "exact", 1, 0, 500, pose=4)
    np.testing.assert_allclose(together.mean[:, 4], again.mean(axis=1), rtol=1e-10)


@pytest.mark.filterwarnings("ignore:.*W_SQUARE_POSES")
def test_covariance_between_poses_against_samples() -> None:
    samples, pairs = 40_000, [(0, 1), (2, 3), (1, 1)]
    found = sample_poses(MIXED, Q[:, :4], samples=10, seed=5)
    errors = [
        sampler.errors(sampler.to_arrays(MIXED.at(Q[:, pose])), "exact", 5, 0, samples, pose=pose) for pose in range(4)
    ]
    # 99.9 % confidence that all of the numbers compared lie within: Bonferroni over pairs × 36
    factor = stats.norm.ppf(1 - 0.0005 / (len(pairs) * 36))
    for one, other in pairs:
        closed = found.between(one, other)
        sample = np.cov(errors[one], errors[other])[:6, 6:]
        centred = [part - part.mean(axis=1, keepdims=True) for part in (errors[one], errors[other])]
        spread = np.sqrt(np.einsum("in,jn->ij", centred[0] ** 2, centred[1] ** 2) / samples - sample**2)
        # the tangent leaves out what offsets of 3 mrad do in second order, 1e-5 of the covariance at most
        limit = factor * spread / np.sqrt(samples) + 1e-4 * np.abs(closed).max()
        assert (np.abs(sample - closed) <= limit).all()
    np.testing.assert_allclose(found.between(0, 1), found.between(1, 0).T, rtol=1e-12, atol=1e-20)
    # what is drawn anew at each pose has no part in it, but a part in the pose's own covariance
    at = MIXED.at(Q[:, 1])
    np.testing.assert_allclose(found.between(1, 1), at.covariance, rtol=1e-12, atol=1e-20)
    all_draws = MIXED.at(Q[:, 0]).jacobian @ MIXED.space.covariance @ at.jacobian.T
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
    pytest.importorskip("xarray")
    found = sample_poses(MODEL, Q[:, :3], samples=1000, seed=9, specifications=SPECIFICATIONS)
    data = found.to_xarray()
    assert dict(data.sizes)["pose"] == 3
    assert data["quantile"].sel(probability=0.95, norm="attitude", pose=2) == found.quantile[1, 1, 2]
    assert data["covariance"].sel(component="dx", component_2="rz", pose=1) == found.covariance[0, 5, 1]
    assert data["inside_interval"].sel(end="upper").shape == (2, 3)
    assert data.attrs["seed"] == "9"
    assert data.attrs["samples"] == "1000"
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
        (1e3, "exact", "half a turn or more"),
        (1e160, "exact", "half a turn|too large to compute with"),
        (1e300, "linear", "too large to compute with|not a finite number"),
    ):
        far = ErrorModel(MODEL.chain, Space((Draw("a", Normal(std)),)), [JointOffset(joint=JOINTS[0], offset="a")])
        with pytest.raises(InputError, match=message):
            sample_poses(far, Q[:, :2], samples=10, model=model)  # type: ignore[arg-type]


@pytest.mark.slow
def test_strained_statics_are_said_of_the_worst_pose() -> None:
    loaded = ErrorModel.load(PAPER_SHEET)
    assert loaded.sheet is not None
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
    figure = Figure()
    axes = figure.subplots()
    assert found.plot(axes=axes) is axes
    lines = [line.get_ydata() for line in axes.get_lines()]
    assert any(np.allclose(line, 1e3 * found.quantile[1, 0]) for line in lines if len(line) == 5)
    assert any(np.allclose(line, [40, 40]) for line in lines if len(line) == 2)
    assert sum(patch.get_x() + 0.5 - 1 in missed for patch in axes.patches) == len(missed)
    made = found.plot("attitude")
    width, height = 25.4 * pp.monte_carlo(MODEL, samples=200).plot("components").get_size_inches()
    assert (width, height < width) == (pytest.approx(174), True)
    assert isinstance(made, Figure)
    assert sample_poses(MODEL, np.tile(FIVE, 8), samples=2).plot() is not None
    with pytest.raises(UnknownNameError, match="quantity"):
        found.plot("position.x")


@pytest.mark.slow
def test_everywhere_is_the_count_of_robots_that_keep_the_limit_at_all_poses() -> None:
    # more robots than a task has, the last task not full
    samples = 18_000
    largest = np.zeros((2, samples))
    for q in FIVE.T:
        errors = pp.monte_carlo(MODEL, q, samples=samples, seed=9, keep_samples=True).errors
        assert errors is not None
        largest = np.maximum(largest, [np.linalg.norm(errors[:3], axis=0), np.abs(errors[2])])
    limits = np.quantile(largest, 0.3, axis=1)
    specifications = [
        Specification(f"position.{part}", limit, 0.5) for part, limit in zip(("norm", "z"), limits, strict=True)
    ]
    kept = largest <= limits[:, None]
    found = sample_poses(
        MODEL, FIVE, samples=samples, seed=9, specifications=specifications, everywhere=True, threads=2
    )
    assert found.kept_everywhere == tuple(kept.sum(axis=1))
    entry = json.loads(found.to_json())["spec"][0]["everywhere"]
    assert entry["probability"] == kept[0].mean()


def first_joint(scope: Scope) -> ErrorModel:
    """Return the paper's arm with one normal offset of its first joint."""
    source = JointOffset(joint=MODEL.chain.joint_names[0], offset="turn")
    return ErrorModel(MODEL.chain, Space((Draw("turn", Normal(1e-3), scope),)), [source])


def test_at_equal_poses_robots_keep_it_at_all_or_none_if_drawn_once_and_independently_if_drawn_anew() -> None:
    same = np.repeat(FIVE[:, :1], 3, axis=1)
    for scope, power in ((Scope.UNIT, 1), (Scope.POSE, 3)):
        # the turn about its axis is inside a standard deviation for 68.27 % of the draws
        found = sample_poses(
            first_joint(scope), same, samples=40_000, specifications=["attitude 1 mrad @ 50 %"], everywhere=True
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
