"""Maps: against single poses, simulation, finite differences, other laws of a norm; statuses, verdicts, files."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.exact_law.number_law import NormalNorm
from precision_pin.analyses.map import map_poses
from precision_pin.analyses.map import map_poses as map_poses_module
from precision_pin.analyses.map.first_order import first_order
from precision_pin.analyses.map.normal_norms import norm_probabilities, norm_quantiles, principal_axes
from precision_pin.analyses.map.table import map_table
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET, shipped_sheets
from precision_pin.robot.pose_set import NO_BRANCH, PoseSet
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.sources import Backlash, Frame, JointOffset
from support.plain_robot import chain_of, joint, link, robot

PAPER = ErrorModel.load(PAPER_SHEET)
UR5 = ErrorModel.load(shipped_sheets()["ur5"])


def around(count: int, seed: int = 4, spread: float = 0.4) -> np.ndarray:
    """Return joint values around the paper's pose, ``(4, P)``."""
    shift = np.random.default_rng(seed).uniform(-spread, spread, (4, count))
    return PAPER.poses["paper"][:, None] + shift


@pytest.mark.slow
@pytest.mark.parametrize("deviations", [(1.0, 1.0, 1.0), (3.0, 1.0, 0.2), (1.0, 1e-3, 0.0), (2.0, 0.0, 0.0)])
def test_quantiles_of_a_norm_are_those_of_the_exact_law(deviations):
    mean = np.array([0.7, -0.4, 1.1]) * 1e-3
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    covariance = turn @ np.diag(np.square(deviations) * 1e-6) @ turn.T
    law = NormalNorm(mean, covariance)
    in_axes = principal_axes(mean[:, None], covariance[:, :, None])
    for level in LEVELS:
        value = norm_quantiles(*in_axes, level)
        assert law.cumulative(value) == pytest.approx([level], abs=1e-6)
        assert norm_probabilities(*in_axes, value) == pytest.approx([level], abs=1e-6)


def test_three_equal_deviations_are_a_noncentral_chi():
    mean, std = np.array([[0.003], [0.0], [0.004]]), 0.002
    value = norm_quantiles(*principal_axes(mean, np.eye(3)[:, :, None] * std**2), 0.95)
    assert value[0] == pytest.approx(std * np.sqrt(stats.ncx2.ppf(0.95, 3, (0.005 / std) ** 2)), rel=1e-7)


@pytest.mark.slow
def test_a_map_is_the_first_order_model_of_each_pose():
    q = around(5)
    made = pp.map_poses(PAPER, q, verify=0)
    for k in range(5):
        error, jacobian = PAPER.at(q[:, k]).tangent
        assert made.mean[:, k] == pytest.approx(error, abs=1e-13)
        covariance = jacobian @ PAPER.space.covariance @ jacobian.T
        assert made.covariance[:, :, k] == pytest.approx(covariance, rel=1e-9, abs=1e-18)
        rms = np.sqrt((error[:3] ** 2).sum() + np.trace(covariance[:3, :3]))
        assert made.rms[0, k] == pytest.approx(rms, rel=1e-9)
    assert made.shares.sum(axis=0) == pytest.approx(np.ones(5))
    written = made.to_dict()
    found = [dict(zip(written["joints"], pose["q"], strict=True)) for pose in written["poses"]]
    assert found == [{f"joint{joint + 1}": q[joint, k] for joint in range(4)} for k in range(5)]


@pytest.mark.slow
def test_the_closed_form_agrees_with_exact_robots():
    # 40,000 robots: standard error of the 95 % quantile about 0.7 %; first order and normal: 2 % in all
    made = pp.map_poses(ErrorModel.load(shipped_sheets()["ur5"]), ["ready", "folded"], samples=40_000, seed=5)
    assert made.sampled.result.quantile[1, 0] == pytest.approx(made.quantile[1, 0], rel=0.02)


def test_covariance_between_poses_by_differences_of_the_exact_model():
    q = around(3, seed=8)
    between = pp.pose_covariance(PAPER, q)
    step = 1e-4 * np.sqrt(np.diag(PAPER.space.covariance))
    slopes = []
    for k in range(3):
        at = PAPER.at(q[:, k])
        moved = PAPER.space.mean[:, None] + np.concatenate([np.diag(step), -np.diag(step)], axis=1)
        errors = at.exact(moved)
        count = len(step)
        slopes.append((errors[:, :count] - errors[:, count:]) / (2 * step))
    for p in range(3):
        for r in range(3):
            expected = slopes[p] @ PAPER.space.covariance @ slopes[r].T
            scale = np.abs(expected).max()
            assert between[p, :, r] == pytest.approx(expected, abs=1e-5 * scale)


def arm_of_two(scope: Scope) -> ErrorModel:
    chain = chain_of(
        robot(
            link("base"), link("upper"), link("lower"), link("tool"),
            joint("shoulder", "revolute", "base", "upper"),
            joint("elbow", "revolute", "upper", "lower", (0.4, 0, 0)),
            joint("flange", "fixed", "lower", "tool", (0.3, 0, 0)),
        ),
        tip="tool",
    )  # fmt: skip
    space = Space((Draw("play", Normal(3e-4, mean=1e-4), scope),))
    return ErrorModel(chain, space, [JointOffset(joint="shoulder", offset="play"), Frame(frame="tool", z=Normal(3e-4))])


def test_the_law_relative_to_a_pose_by_hand():
    # turned by 90 degrees the straight arm of 0.7 m swings the other way: e - e' = 0.7 s (-1, 1, 0); the tool's z drops out
    made = pp.map_poses(arm_of_two(Scope.UNIT), [[np.pi / 2, 0.0], [0.0, 0.0]], relative_to=[0.0, 0.0], verify=0)
    assert made.relative.mean[:, 0] == pytest.approx([-7e-5, -7e-5, 0, 0, 0, 0], abs=1e-8)
    expected = (0.7 * 3e-4) ** 2 * np.array([[1, 1], [1, 1]])
    assert made.relative.covariance[:2, :2, 0] == pytest.approx(expected, rel=1e-3)
    assert np.abs(made.relative.covariance[2:, 2:, 0]).max() < 1e-15
    assert np.abs(made.relative.covariance[:, :, 1]).max() < 1e-20  # itself, and nothing is drawn anew
    # drawn at each visit both count: 2 x the variance at the pose itself
    anew = pp.map_poses(arm_of_two(Scope.VISIT), [[0.0, 0.0]], relative_to=[0.0, 0.0], verify=0)
    assert anew.relative.covariance[1, 1, 0] == pytest.approx(2 * (2.1e-4) ** 2, rel=1e-6)


def test_one_pose_from_two_sides_relative_to_itself():
    # a random gap of one robot lies on either flank: e - e' = gap about joint 2, which does not cancel
    gap = Draw("gap", Uniform(3e-5, mean=3e-4))
    loose = ErrorModel(
        PAPER.chain, Space((gap,)), [Backlash(joint="joint2", backlash="gap", band=1000.0)], dict(PAPER.poses)
    )
    up, down = (pp.ApproachedPose("paper", f"joint2 {sign}") for sign in "+-")
    made = pp.map_poses(loose, [up, down], relative_to=up, verify=0).relative
    sampled = pp.relative(loose, down, up, samples=20_000, seed=1).summary
    lever = np.linalg.norm(PAPER.chain.at(PAPER.poses["paper"]).joint_jacobian[:3, 1])
    assert np.sqrt(np.trace(made.covariance[:3, :3, 1])) == pytest.approx(lever * 3e-5 / np.sqrt(3), rel=1e-3)
    assert np.trace(made.covariance[:3, :3, 1]) == pytest.approx(np.trace(sampled.covariance[:3, :3]), rel=0.05)
    assert np.abs(made.covariance[:, :, 0]).max() < 1e-20


def unreached() -> PoseSet:
    known = PoseSet.at(PAPER.chain, around(2), ("near", "far"))
    return PoseSet.joined(
        [
            known,
            PoseSet(np.full((4, 1), np.nan), ("beyond",), ("unreachable",), np.array([NO_BRANCH]), np.zeros((3, 1))),
        ]
    )


@pytest.mark.slow
def test_poses_that_cannot_be_reached_are_not_numbers_and_are_said():
    made = pp.map_poses(PAPER, unreached(), specifications=["1 m"], verify=1)
    assert np.isnan(made.mean[:, 2]).all()
    assert np.isnan(made.quantile[:, :, 2]).all()
    assert made.unknown == 1
    assert sorted(made.worst_first) == [0, 1]
    assert made.met
    text = map_table(made)
    assert "1 unreachable" in text
    assert "1 of 3 poses cannot be reached and are not judged" in text
    assert made.to_dict()["poses"][2]["quantile_position"] == [None, None, None]


@pytest.mark.slow
def test_a_map_is_met_only_where_the_worst_was_sampled():
    q = around(3)
    limit = float(pp.map_poses(PAPER, q, verify=0).quantile[1, 0].max())
    wide, narrow = f"{1.05 * limit:.6f} m", f"{0.98 * limit:.6f} m"
    assert pp.map_poses(PAPER, q, specifications=[wide]).met
    assert not pp.map_poses(PAPER, q, specifications=[wide], verify=0).met
    missed = pp.map_poses(PAPER, q, specifications=[narrow, wide])
    assert [verdict.met for verdict in missed.verdicts] == [False, True]
    assert missed.verdicts[0].worst == missed.worst_first[0]
    assert missed.to_dict()["spec"][0]["met_at"] < 3


@pytest.mark.slow
def test_dataset_and_netcdf(tmp_path):
    xarray = pytest.importorskip("xarray")
    made = pp.map_poses(PAPER, unreached(), specifications=["30 mm"], relative_to="paper", verify=1)
    file = tmp_path / "map.nc"
    made.to_netcdf(file)
    with xarray.open_dataset(file) as read:
        assert read["mean"].dims == ("pose", "component")
        assert read["covariance"].shape == (3, 6, 6)
        assert list(read["status"].values) == ["reached", "reached", "unreachable"]
        assert np.array_equal(read["quantile_position"].values, made.quantile[:, 0].T, equal_nan=True)
        assert np.array_equal(read["q"].values, made.poses.q.T, equal_nan=True)
        names = {"rms_position", "rms_attitude", "quantile_attitude", "probability", "dominant_source"}
        assert names <= set(read.variables)


def test_wrong_questions_are_refused():
    nothing = PoseSet(np.full((4, 1), np.nan), ("",), ("unreachable",), np.array([NO_BRANCH]), np.zeros((3, 1)))
    with pytest.raises(InputError, match="none of the 1 poses has joint values: 1 unreachable"):
        pp.map_poses(PAPER, nothing)
    with pytest.raises(InputError, match="the pose set has 2 joints, the chain has 4"):
        pp.map_poses(PAPER, PoseSet.at(arm_of_two(Scope.UNIT).chain, np.zeros((2, 1))))
    made = pp.map_poses(PAPER, around(2), verify=0)
    with pytest.raises(InputError, match=r"a map has the quantiles 0\.5, 0\.95, 0\.9973"):
        made.plot(level=0.9)
    with pytest.raises(InputError, match="no quantity named 'positon'"):
        made.plot("positon")


@pytest.mark.slow
def test_the_estimates_of_memory_are_those_of_a_map_and_its_json(monkeypatch):
    """Bytes of the arrays held at once, and of the JSON as it is made, within a factor of 1.5."""
    said, held = [], []

    def measured(*given):
        closed = first_order(*given)
        vectors = [array for one in closed.vectors for array in vars(one).values()]
        arrays = [array for array in (*vars(closed).values(), *vectors) if isinstance(array, np.ndarray)]
        held.append(sum(array.nbytes for array in arrays))
        return closed

    monkeypatch.setattr(map_poses_module, "first_order", measured)
    monkeypatch.setattr(map_poses_module, "check_memory", lambda needed, *_: said.append(needed))
    for model, options in ((PAPER, {}), (UR5, {"relative_to": "ready", "specifications": ["x 1 mm @ 90 %", "2 mm"]})):
        q = np.repeat(next(iter(model.poses.values()))[:, None], 60, axis=1)
        made = pp.map_poses(model, q, verify=0, **options)
        at = model.chain.at_many(q)
        frames = [at.joint_poses, at.pose, at.joint_jacobian, at.load_torque, at.link_wrench]
        moments, beside = held.pop(), sum(array.nbytes for array in frames)
        # the rest by the growth of a process from 8,000 to 24,000 poses: 3,180 bytes a pose (UR5), 2,770 (paper's arm)
        assert 1 / 1.2 < said.pop() / (moments + max(moments, beside) + 60 * 700) < 1.2
        monkeypatch.setattr(map_poses, "LARGEST_FILE", np.inf)
        monkeypatch.setattr(map_poses, "check_memory", lambda needed, *_: said.append(needed))
        tracemalloc.start()
        text = made.to_json()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert 1 / 1.5 < said.pop() / peak < 1.5
        monkeypatch.setattr(map_poses, "LARGEST_FILE", 1.5 * len(text))
        made.to_json()
        said.clear()
        monkeypatch.setattr(map_poses, "LARGEST_FILE", len(text) / 1.5)
        with pytest.raises(InputError, match=r"JSON of a map of 60 poses is about 0\.0 GB long.*netCDF.* fewer poses"):
            made.to_json()
