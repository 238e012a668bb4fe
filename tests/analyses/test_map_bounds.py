"""Bounds of a map's closed form and verdicts by sampling: against laws worked out by hand, and robots drawn in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.map.law_bounds import LawShapes
from precision_pin.analyses.map.normal_norms import (
    norm_probabilities,
    norm_quantiles,
    norm_tail_bounds,
    norm_tail_quantiles,
)
from precision_pin.analyses.map.table import map_table
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Arcsine, Disc, Law, Lognormal, Normal, TwoPoint, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import shipped_sheets
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.sources import Frame, JointOffset
from support.plain_robot import chain_of, joint, link, robot

pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")

RARE = 0.01
LAWS = {
    "normal": Normal,
    "uniform": lambda s: Uniform(s * 3**0.5),
    "arcsine": lambda s: Arcsine(s * 2**0.5),
    "two_point": TwoPoint,
    "lognormal": lambda s: Lognormal(mean=s, std=s),
    "rare": lambda s: TwoPoint(s / (2 * (RARE * (1 - RARE)) ** 0.5), probability=RARE),
}
"""Laws with a standard deviation."""


def arm(**tool: Law) -> ErrorModel:
    """Return an arm of one joint whose only errors are shifts of its tool, 0.7 m away, along the tool's axes."""
    chain = chain_of(
        robot(
            link("base"), link("upper"), link("tool"),
            joint("shoulder", "revolute", "base", "upper"),
            joint("flange", "fixed", "upper", "tool", (0.7, 0, 0)),
        ),
        tip="tool",
    )  # fmt: skip
    return ErrorModel(chain, Space(), [Frame(frame="tool", **tool)])


def quantiles_by_hand(law: str) -> list[float]:
    """Return the quantiles of |x| at `LEVELS`, x of standard deviation 1."""
    p = np.array(LEVELS)
    centre = TwoPoint(1.0, probability=RARE).half_width / (2 * (RARE * (1 - RARE)) ** 0.5)
    return {
        "normal": stats.halfnorm.ppf(p),
        "uniform": 3**0.5 * p,
        "arcsine": 2**0.5 * np.sin(p * np.pi / 2),
        "two_point": np.ones(3),
        "lognormal": np.exp(np.log(2) ** 0.5 * stats.norm.ppf(p) - np.log(2) / 2),
        "rare": np.full(3, centre),
    }[law].tolist()


@pytest.mark.parametrize("law", LAWS)
def test_bounds_hold_the_quantiles_of_a_single_number_by_hand(law):
    made = pp.map_poses(arm(x=LAWS[law](1e-3)), [[0.0], [1.0]], verify=0)
    for level, expected in enumerate(quantiles_by_hand(law)):
        low, high = 1e3 * made.quantile_bounds[level, 0, :, 1]
        assert low <= expected * (1 + 1e-4)
        assert expected * (1 - 1e-4) <= high


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda"])
@pytest.mark.parametrize("law", LAWS)
def test_bounds_hold_the_exact_quantiles_and_shares_of_an_arm(name, law):
    shipped, count, failed, checked = ErrorModel.load(shipped_sheets()[name]), 10_000, [], 0
    q = np.array(list(shipped.poses.values())[:2]).T
    # two joints that cause most, where the law of the sum is far from normal, and many alike
    for small in (3e-5, 1e-3):
        stds = dict.fromkeys(shipped.chain.joint_names, small) | dict.fromkeys(shipped.chain.joint_names[:2], 1e-3)
        sources = [JointOffset(joint=one, offset=LAWS[law](std)) for one, std in stds.items()]
        model = ErrorModel(shipped.chain, Space(), sources)
        made = pp.map_poses(model, q, verify=0, specifications=["2 mm", "x 1 mm", "5 mm", "x 3 mm"])
        draws = model.space.sample(seed=11, first=0, count=count)
        for pose in range(2):
            errors = model.at(q[:, pose]).exact(draws)
            lengths = np.linalg.norm(errors.reshape(2, 3, count), axis=1)
            # four standard errors of a share: 1 in 16,000 of some 240 comparisons would fail by chance
            for level, norm in np.ndindex(3, 2):
                p = LEVELS[level]
                near = 4 * (p * (1 - p) / count) ** 0.5
                least, most = np.quantile(lengths[norm], [p - near, min(p + near, 1.0)])
                low, high = made.quantile_bounds[level, norm, :, pose]
                checked += 1
                failed += [] if low <= most and least <= high else [(small, pose, p, norm, low, least, most, high)]
            for spec, values in enumerate([lengths[0], np.abs(errors[0])] * 2):
                share = (values <= made.specifications[spec].limit).mean()
                near = 4 * (share * (1 - share) / count) ** 0.5 + 10 / count
                low, high = made.probability_bounds[spec, :, pose]
                checked += 1
                failed += [] if low - near <= share <= high + near else [(small, pose, spec, low, share, high)]
    assert not failed
    assert checked == 40


def test_bounds_of_normal_laws_are_close_and_of_others_wide_enough_to_warn():
    # a shift is exactly linear: what is left is a twentieth of the tail for a remainder
    made = pp.map_poses(arm(x=Normal(1e-4)), [[0.3]], verify=0)
    assert not made.warnings
    assert made.quantile_bounds[1, 0, :, 0] == pytest.approx([stats.halfnorm.ppf(0.95) * 1e-4] * 2, rel=0.02)
    rare = pp.map_poses(arm(x=LAWS["rare"](1e-3), y=Normal(1e-4)), [[0.3]], verify=0)
    assert "W_NORMAL_LAW" in rare.warnings[0]
    assert rare.quantile[2, 0, 0] > 1.4 * rare.quantile_bounds[2, 0, 1, 0]  # the closed form is out of the question


def test_a_law_that_is_mostly_normal_has_close_bounds():
    # by Lindeberg's replacement: a small uniform number beside normal ones, whose other limits are twice as far
    model = arm(x=Normal(1e-3), y=Normal(1e-3))
    offset = JointOffset(joint="shoulder", offset=Uniform(4e-4))
    made = pp.map_poses(ErrorModel(model.chain, Space(), [*model.sources, offset]), [[0.0]], verify=0)
    assert made.quantile_bounds[1, 0, :, 0] == pytest.approx([made.quantile[1, 0, 0]] * 2, rel=0.06)


@pytest.mark.slow
def test_numbers_drawn_together_and_correlated():
    names = ("a", "b")
    space = Space(
        (Draw("a", Uniform(1e-3)), Draw("b", Lognormal(mean=1e-3, std=1e-3)), Draw("c", Disc(1e-3))),
        (pp.Correlation.pair(*names, 0.9),),
    )
    shapes = LawShapes.of(space)
    x = space.sample(0, 0, 400_000) - space.mean[:, None]
    # |w|² of w = x_a u + x_b v: the bound of its variance, with vectors u, v alike
    squares = (x[0] + x[1]) ** 2
    normal = 2 * np.cov(x[:2]).sum() ** 2
    assert squares.var() - normal < shapes.fourth_cumulant[:2].sum()
    assert shapes.groups[0] == shapes.groups[1] != shapes.groups[2]
    assert (np.mean(x**8, axis=1) ** (1 / 8) <= shapes.eighth * 1.001)[[0, 2, 3]].all()


@pytest.mark.slow
def test_what_the_samples_do_not_decide_is_neither_met_nor_missed():
    model = arm(x=TwoPoint(0.6e-3, centre=0.6e-3, probability=0.015), y=Normal(1e-4))
    asked = {"specifications": ["x 1 mm @ 98.5 %"], "verify": 1}
    made = pp.map_poses(model, [[0.0], [1.5]], threads=1, **asked)
    (verdict,) = made.verdicts
    assert (verdict.verdict, verdict.met, verdict.met_at, verdict.undecided_at) == ("undecided", False, 1, 1)
    assert verdict.most_samples == made.judged.samples[0] == 200_000
    assert made.judged.samples[1] == 2_000
    assert verdict.needed is None or verdict.needed > 200_000
    text = map_table(made)
    assert ": UNDECIDED - worst 'pose 1'" in text
    assert "met at 1 of 2 poses, undecided at 1 by up to 200,000 robots" in text
    again = pp.map_poses(model, [[0.0], [1.5]], threads=2, **asked)
    assert np.array_equal(again.judged.interval, made.judged.interval)
    assert np.array_equal(again.judged.order, made.judged.order)


def test_nothing_sampled_is_not_judged():
    made = pp.map_poses(arm(x=Normal(1e-4)), [[0.0]], specifications=["1 m"], verify=0)
    assert made.met is None
    assert made.verdicts[0].met is None
    assert ": NOT JUDGED - nothing was sampled" in map_table(made)
    assert made.to_dict()["poses"][0]["judged"] is None
    assert pp.map_poses(arm(x=Normal(1e-4)), [[0.0]], verify=0).met


@pytest.mark.slow
def test_quantiles_and_limits_are_computed_in_view_some_poses_at_a_time(monkeypatch):
    model, steps = arm(x=Normal(1e-4), y=Uniform(2e-4)), []
    asked = {"verify": 0, "specifications": ["0.3 mm", "x 0.2 mm"], "relative_to": [0.1]}
    poses = np.linspace(-1, 1, 7)[None]
    whole = pp.map_poses(model, poses, **asked)
    monkeypatch.setattr("precision_pin.analyses.map.map_poses._AT_ONCE", 2)
    parts = pp.map_poses(model, poses, progress=steps.append, **asked)
    assert sum(steps) == 7
    assert sum(map(bool, steps)) == 5  # the moments of all, then four times up to two poses
    for name in ("quantile", "quantile_bounds", "probability", "probability_bounds"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-12)
    np.testing.assert_allclose(parts.relative.quantile, whole.relative.quantile, rtol=1e-12)


def test_tail_bounds_of_a_normal_vector_by_hand():
    # of k equal variances s² the least exp(K(t) - t r²) is (r²/(k s²))^(k/2) exp(k/2 - r²/(2 s²)), by t = 1/(2 s²) - k/(2 r²)
    s, lengths = 2e-3, np.array([0.5, 1.0, 3.0, 5.0, 9.0])
    for k in (1, 2, 3):
        variances = np.repeat(np.array([s**2] * k + [0.0] * (3 - k))[:, None], 5, axis=1)
        z = lengths**2 / k
        expected = np.where(z > 1, z ** (k / 2) * np.exp(k * (1 - z) / 2), 1.0)
        np.testing.assert_allclose(norm_tail_bounds(variances, 0 * variances, s * lengths), expected, rtol=1e-10)
        radii = norm_tail_quantiles(variances, 0 * variances, 1e-3)
        np.testing.assert_allclose(norm_tail_bounds(variances, 0 * variances, radii), 1e-3, rtol=1e-9)
        np.testing.assert_allclose(
            norm_quantiles(variances, 0 * variances, 0.97, (0.95, s * stats.chi(k).ppf(np.full(5, 0.95)))),
            s * stats.chi(k).ppf(0.97), rtol=1e-7,
        )  # fmt: skip


def test_a_limit_of_any_size_has_a_probability():
    s, lengths = 2e-3, np.array([0.3, 3.0, 20.0, 39.0, 60.0, 1e4, 1e16])
    for k in (1, 2, 3):
        variances = np.repeat(np.array([s**2] * k + [0.0] * (3 - k))[:, None], len(lengths), axis=1)
        found = norm_probabilities(variances, 0 * variances, s * lengths)
        np.testing.assert_allclose(found, stats.chi(k).cdf(lengths), atol=1e-7)
        assert (norm_tail_bounds(variances, 0 * variances, s * lengths)[4:] < 1e-300).all()
