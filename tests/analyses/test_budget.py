"""Budgets against hand-computed cases, brute force and closed forms of the literature; Shapley and Sobol indices."""

import itertools
import json
import math
import re

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binom

import precision_pin as pp
from precision_pin.analyses import shares
from precision_pin.analyses.budget import budget as budget_module
from precision_pin.analyses.budget.figure import figure
from precision_pin.analyses.budget.table import table
from precision_pin.analyses.replicates import half_widths, jackknife
from precision_pin.analyses.shares import VECTORS, by_draw, by_place, correlated_groups
from precision_pin.base.errors import UnknownNameError
from precision_pin.render.text_table import whole_tables
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_offset import JointOffset
from support.engines import GANTRY
from support.plain_robot import chain_of, joint, link, robot
from support.sheets import SEVEN_Q, everything, seven_joint_arm

CLOSED = (*VECTORS, *(f"{part}.{axis}" for part in ("position", "attitude") for axis in "xyz"))


FEW = 1024


SWING = robot(
    *map(link, ("base", "carriage", "arm", "tool")),
    joint("rail", "prismatic", "base", "carriage", axis=(0, 1, 0)),
    joint("swivel", "revolute", "carriage", "arm", axis=(1, 0, 0)),
    joint("bolt", "fixed", "arm", "tool", (0, 0, -0.5)),
)


@pytest.fixture(scope="module")
def whole():
    return pp.budget(pp.ErrorModel.load(PAPER_SHEET))


@pytest.fixture(scope="module")
def swing_budget():
    """Return that of a rail of uniform 0.1 mm along y and a swivel of σ = 0.1 mrad about x, the tool 0.5 m below."""
    chain = chain_of(SWING, tip="tool", gravity=(0, 0, 0))
    sources = [JointOffset(joint="rail", offset=pp.Uniform(1e-4)), JointOffset(joint="swivel", offset=pp.Normal(1e-4))]
    return pp.budget(pp.ErrorModel(chain, pp.Space(), sources), [0.0, 0.0], samples=16384, k=4.0).poses[0]


def gantry(*sources, space=pp.Space()):  # noqa: B008 - immutable
    return pp.ErrorModel(chain_of(GANTRY, tip="tool", gravity=(0, 0, 0)), space, sources)


@pytest.mark.parametrize("analysis", [pp.monte_carlo, pp.budget, pp.moments])
def test_errors_whose_fourth_powers_overflow_are_refused_by_each_analysis_that_samples(analysis):
    model = gantry(Frame(frame="tool", x=pp.Normal(1e40)))
    with pytest.raises(pp.InputError, match="the errors at this pose are too large to compute with"):
        analysis(model, np.zeros(len(model.chain.joints)), samples=FEW)


def test_shares_by_hand(swing_budget):
    """Δy = r + 0.5 s: variances 1e-8/3 and 0.25e-8, shares 4/7 and 3/7; the rail reaches 0.1 mm, the swivel 4 σ · 0.5 m."""
    rail, swivel = swing_budget.draws
    assert rail.name == "joint_offset[rail].offset"
    for quantity in ("position", "position.y"):
        assert (rail.share[quantity], swivel.share[quantity]) == pytest.approx((4 / 7, 3 / 7), abs=1e-12)
    assert (rail.share["attitude"], swivel.share["attitude"]) == (0.0, pytest.approx(1.0, abs=1e-12))
    assert rail.share["position.x"] is swivel.share["position.x"] is rail.share["attitude.z"] is None
    assert swing_budget.std["position.y"] == pytest.approx(math.sqrt(1e-8 / 3 + 0.25e-8), rel=1e-12)
    assert [one.reach["position.y"] for one in (rail, swivel, swing_budget)] == pytest.approx([1e-4, 2e-4, 3e-4])
    assert [one.worst_case["position.y"] for one in (rail, swivel)] == pytest.approx([1 / 3, 2 / 3], abs=1e-12)
    assert (rail.unbounded, swivel.unbounded) == (False, True)
    # halved; 1.959964: |normal| stays below it with probability 0.95
    assert rail.halved.std["position"] == pytest.approx(math.sqrt(0.25e-8 / 3 + 0.25e-8), rel=1e-12)
    assert swivel.halved.std["attitude.x"] == pytest.approx(0.5e-4, rel=1e-12)
    for one, value in ((rail, 1.959964e-4), (swivel, 0.979982e-4)):
        quantile = one.halved.quantile["attitude.norm"]
        assert abs(quantile.value - value) <= 2 * quantile.half_width
        assert quantile.half_width < 1e-6
    after, before = (one.quantile["position.norm"].value for one in (rail.halved, swing_budget))
    assert rail.halved.change["position.norm"].value == pytest.approx(after - before, abs=1e-18)
    assert rail.halved.change["attitude.norm"].value == 0


def test_what_only_a_higher_order_moves_is_flagged(swing_budget):
    """A swivel about x moves the tool by 0.5 (1 - cos s) along z: nothing in first order, all of the variance."""
    swivel = swing_budget.group("joint_offset[swivel].offset")
    assert swivel.share["position.z"] is None
    first = swivel.first["position.z"]
    assert abs(first.value - 1) <= 2 * first.half_width < 0.1
    assert "position.z" in swivel.nonlinear
    assert "position.y" not in swivel.nonlinear
    # variance of s²/4 for s normal: σ⁴/8
    assert swing_budget.sums["position.z"].variance.value == pytest.approx(1e-16 / 8, rel=0.1)


def test_closed_form_and_sampling_agree_on_the_papers_arm(whole):
    paper = whole.poses[0]
    for quantity in CLOSED:
        sums = paper.sums[quantity]
        assert sums.closed == pytest.approx(1.0, abs=1e-12)
        assert abs(sums.first.value - 1) <= 2 * sums.first.half_width + 1e-3
        assert abs(sums.variance.value - sums.std**2) <= 2 * sums.variance.half_width + 2e-3 * sums.std**2
        for lines in (paper.draws, paper.sources, paper.places):
            assert math.fsum(line.share[quantity] for line in lines) == pytest.approx(1.0, abs=1e-12)
        for group in paper.groups:
            for index in (group.first[quantity], group.total[quantity]):
                assert abs(index.value - group.share[quantity]) <= 2 * index.half_width + 2e-3
            assert quantity not in group.nonlinear
    assert paper.sums["position.norm"].closed is None
    assert math.fsum(draw.worst_case["position.z"] for draw in paper.draws) == pytest.approx(1.0, abs=1e-12)


def test_a_fixed_draw_has_no_share_and_a_parameter_belongs_to_what_uses_it():
    draws = {"still": pp.Fixed(2e-3), "rail": pp.Uniform(1e-3), "spot": pp.Disc(1e-3), "idle": pp.Uniform(1.0)}
    space = pp.Space(tuple(pp.Draw(*one) for one in draws.items()))
    sources = [JointOffset(joint="rail", offset="still"), JointOffset(joint="lift", offset=2 * space.parameter("rail"))]
    model = gantry(*sources, space=space)
    found = pp.budget(model, [0.1, 0.2], samples=FEW).poses[0]
    still = found.draw("still")
    assert still.share["position"] == still.worst_case["position.z"] == 0.0
    assert found.draw("rail").share["position"] == 1.0
    group = found.group("still")
    assert group.first["position"].value == group.total["position"].value == group.total["position"].half_width == 0
    assert (still.halved.std, still.halved.quantile) == (found.std, found.quantile)
    assert all(change.value == 0 for change in still.halved.change.values())
    # named like a joint, it is not the joint's
    more = (Frame(link="base", x="spot.x", y="spot.y"), JointOffset(joint="rail", offset=pp.Uniform(1e-4)))
    owned = gantry(*sources, *more, space=space)
    owners = [("joint_offset[rail]",), ("joint_offset[lift]",), ("frame[base]",), (), ("joint_offset[rail]#2",)]
    assert list(owned.owners) == owners
    bare = pp.budget(gantry(), [0.1, 0.2], samples=FEW)
    assert bare.poses[0].draws == bare.poses[0].groups == bare.poses[0].sources == ()
    assert all(sums.closed is None and sums.first is None for sums in bare.poses[0].sums.values())
    json.loads(bare.to_json())


@pytest.mark.slow
def test_seven_joints_with_correlated_and_shared_draws():
    found = pp.budget(everything(seven_joint_arm()), SEVEN_Q, samples=FEW).poses[0]
    centre = found.draw("centre")
    for quantity in CLOSED:
        assert found.sums[quantity].closed == pytest.approx(1.0, abs=1e-12)
        for lines in (found.draws, found.sources, found.places):
            assert math.fsum(line.share[quantity] for line in lines) == pytest.approx(1.0, abs=1e-11)
        parts = math.fsum(part[quantity] for part in centre.components.values())
        assert parts == pytest.approx(centre.share[quantity], abs=1e-13)
    shared = {line.draws: line.sources for line in found.sources if len(line.sources) > 1}
    assert shared[("softness",)] == ("joint_compliance[joint1]", "joint_compliance[joint2]")
    assert next(line for line in found.sources if "modulus" in line.draws).sources == ("beam[link2]",)


def test_draws_correlated_by_a_copula():
    """Two normal offsets on one line, ρ = 0.6, and a third by itself: the pair is one group with one Sobol index."""
    rho, s1, s2, s3 = 0.6, 1e-3, 2e-3, 1.5e-3
    draws = pp.Draw("first", pp.Normal(s1)), pp.Draw("alone", pp.Normal(s3)), pp.Draw("second", pp.Normal(s2))
    space = pp.Space(draws, (pp.Correlation.pair("first", "second", rho),))
    first, second = Frame(link="base", x="first"), Frame(frame="tool", x="second")
    model = gantry(first, second, JointOffset(joint="rail", offset="alone"), space=space)
    assert correlated_groups(model.space) == ((0, 2), (1,))
    found = pp.budget(model, [0.0, 0.0], samples=16384, confidence=0.99).poses[0]
    whole = s1**2 + s2**2 + 2 * rho * s1 * s2 + s3**2
    effect = (s1**2 * (1 - rho**2 / 2) + rho * s1 * s2 + s2**2 * rho**2 / 2) / whole
    assert found.draw("first").share["position.x"] == pytest.approx(effect, abs=1e-9)
    assert found.draw("alone").share["position.x"] == pytest.approx(s3**2 / whole, abs=1e-9)
    pair = found.group("second")
    assert (pair.draws, found.draw("first").components) == (("first", "second"), {})
    assert pair.share["position.x"] == pytest.approx(1 - s3**2 / whole, abs=1e-9)
    for index in (pair.first["position.x"], pair.total["position.x"]):
        assert abs(index.value - pair.share["position.x"]) <= index.half_width + 1e-3
    halved = s1**2 / 4 + s2**2 + rho * s1 * s2 + s3**2
    assert found.draw("first").halved.std["position.x"] == pytest.approx(math.sqrt(halved), rel=1e-9)


@pytest.mark.parametrize("most", [12, 3])
def test_correlated_places_agree_with_all_orders(monkeypatch, most):
    """Four correlated numbers along x, of which ``s`` acts at two places; too many players keep joint and link together."""
    monkeypatch.setattr(shares, "MOST_PLAYERS", most)
    std = np.array([1.0, 2.0, 1.5, 3.0]) * 1e-3
    matrix = np.array([[1, 0.7, -0.5, 0.3], [0.7, 1, -0.2, 0.1], [-0.5, -0.2, 1, 0.4], [0.3, 0.1, 0.4, 1]])
    draws = tuple(pp.Draw(name, pp.Normal(one)) for name, one in zip("abcs", std, strict=True))
    space = pp.Space(draws, (pp.Correlation(tuple("abcs"), tuple(map(tuple, matrix))),))
    sources = [Frame(link="base", x="a"), JointOffset(joint="rail", offset="b"), Frame(link="carriage", x="c")]
    sources += [Frame(link="base", x="s"), Frame(link="carriage", x=-0.4 * space.parameter("s"))]
    slopes = np.array([[1.0, 1.0, 1.0, 0.6]])
    covariance = matrix * np.outer(std, std)
    whole = (slopes @ covariance @ slopes.T).item()
    together = (lambda order: abs(order.index(1) - order.index(2)) == 1) if most == 3 else (lambda order: True)
    effects = by_orders(4, lambda known: conditional(slopes, covariance, list(known)), together)
    a, b, c, s = effects[:, 0] / whole
    alone = std[3] ** 2 / whole
    gain = (s - 0.6**2 * alone) / 2
    model = gantry(*sources, space=space)
    found = {name: part[0] / whole for name, part in by_place(model.at([0.0, 0.0]), model.chain).items()}
    expected = {"link from base to rail": a + 0.6 * alone + gain, "rail": b}
    expected["link from rail to lift"] = c - 0.4 * 0.6 * alone + gain
    assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
def test_more_correlated_draws_than_can_be_shared():
    names = [f"d{k}" for k in range(13)]
    matrix = tuple(map(tuple, 0.2 + 0.8 * np.eye(13)))
    space = pp.Space(tuple(pp.Draw(one, pp.Normal(1e-3)) for one in names), (pp.Correlation(tuple(names), matrix),))
    model = gantry(*(Frame(link="base", x=one) for one in names), space=space)
    result = pp.budget(model, [0.0, 0.0], samples=FEW)
    found = result.poses[0]
    assert np.isnan(by_draw(model.at([0.0, 0.0]))).all()
    assert all(draw.share["position"] is None for draw in found.draws)
    assert found.groups[0].share["position"] == pytest.approx(1.0, abs=1e-12)
    assert found.sums["position"].closed == pytest.approx(1.0, abs=1e-12)
    json.loads(result.to_json())


COVARIANCE = np.array([[4.0, 1.2, -0.5, 0.3], [1.2, 1.0, 0.2, 0.0], [-0.5, 0.2, 2.0, 0.9], [0.3, 0.0, 0.9, 3.0]])


SLOPES = np.array([[1.0, -2.0, 0.5, 1.5], [0.0, 3.0, 1.0, -1.0]])


def conditional(slopes, covariance, known):
    """Variance of the outputs less what remains of it once some normal inputs are known (Schur complement)."""
    rest = [k for k in range(covariance.shape[0]) if k not in known]
    left = covariance[np.ix_(rest, rest)]
    if known:
        cross = covariance[np.ix_(rest, known)]
        left = left - cross @ np.linalg.solve(covariance[np.ix_(known, known)], cross.T)
    return np.diag(slopes @ covariance @ slopes.T) - np.diag(slopes[:, rest] @ left @ slopes[:, rest].T)


def by_orders(players, worth, keeps=lambda order: True):
    """Return what the definition says: the mean over all (kept) orders of what a player adds to those before."""
    orders = [order for order in itertools.permutations(range(players)) if keeps(order)]
    gains = np.zeros((players, *np.shape(worth([]))))
    for order in orders:
        for k, player in enumerate(order):
            gains[player] += worth(sorted(order[: k + 1])) - worth(sorted(order[:k]))
    return gains / len(orders)


@pytest.mark.parametrize("groups", [[[0], [1], [2], [3]], [[2], [0, 3], [1]]])
def test_effects_agree_with_the_definition(groups):
    """And forms are the effects of any slopes."""
    expected = by_orders(
        len(groups),
        lambda members: conditional(SLOPES, COVARIANCE, sorted(k for member in members for k in groups[member])),
    )
    np.testing.assert_allclose(shares.shapley_effects(SLOPES, COVARIANCE, groups), expected, rtol=0, atol=1e-12)
    forms = shares.effect_forms(COVARIANCE, groups)
    np.testing.assert_allclose(np.einsum("ij,gjk,ik->gi", SLOPES, forms, SLOPES), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(forms.sum(axis=0), COVARIANCE, rtol=0, atol=1e-12)
    with pytest.raises(pp.InputError, match="at most 12"):
        shares.shapley_values(13, lambda members: np.zeros(()))


@pytest.mark.parametrize("rho", [-0.9, 0.0, 0.35, 1.0])
def test_two_normal_inputs_have_the_published_effects(rho):
    """Owen and Prieur (2017), equation for two inputs; at ρ = 1 the two share evenly."""
    b1, b2, s1, s2 = 1.5, -0.4, 0.7, 2.0
    covariance = np.array([[s1**2, rho * s1 * s2], [rho * s1 * s2, s2**2]])
    common = b1 * b2 * s1 * s2 * rho
    expected = [
        b1**2 * s1**2 * (1 - rho**2 / 2) + common + b2**2 * s2**2 * rho**2 / 2,
        b2**2 * s2**2 * (1 - rho**2 / 2) + common + b1**2 * s1**2 * rho**2 / 2,
    ]
    found = shares.shapley_effects(np.array([[b1, b2]]), covariance, [[0], [1]])[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


A, B = 7.0, 0.1


VARIANCE = 13.844588


FIRST = (0.313905, 0.442411, 0.0)


TOTAL = (0.557589, 0.442411, 0.243684)


def ishigami(uniforms):
    x = -np.pi + 2 * np.pi * uniforms
    return (np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0]))[None]


def indices(function, dimension, groups, *, seed=0, points=1024, **settings):
    both = budget_module.scrambled_points(2 * dimension, seed, points)
    return budget_module.sobol_indices(function, both[:dimension], both[dimension:], groups, **settings)


def covers(estimates, truth):
    return np.abs(estimates.value - truth) <= estimates.half_width + 1e-6


def test_ishigami_lies_inside_the_stated_intervals():
    found = indices(ishigami, 3, [[0], [1], [2]], confidence=0.99)
    assert covers(found.first, np.array(FIRST)[:, None]).all()
    assert covers(found.total, np.array(TOTAL)[:, None]).all()
    assert covers(found.first_sum, sum(FIRST)).all()
    assert covers(found.variance, VARIANCE).all()
    assert max(found.first.half_width.max(), found.total.half_width.max()) < 0.03


def test_closed_form_of_an_interaction():
    """Y = x1 + x2 x3 of standard normal numbers: V = 2, first order 1/2 0 0, total 1/2 1/2 1/2; as a group 1/2."""

    def function(uniforms):
        x = ndtri(uniforms)
        return (x[0] + x[1] * x[2])[None]

    found = indices(function, 3, [[0], [1], [2], [1, 2]], confidence=0.999)
    assert covers(found.first, np.array([[0.5], [0], [0], [0.5]])).all()
    assert covers(found.total, np.array([[0.5], [0.5], [0.5], [0.5]])).all()
    # of (3u, 4v) together: variances 9/12 and 16/12, shares 0.36 and 0.64, and no difference of first and total
    both = indices(lambda u: np.array([3 * u[0], 4 * u[1]]), 2, [[0], [1]], outputs=np.array([[1.0, 1.0], [1.0, 0.0]]))
    np.testing.assert_allclose(both.first.value, both.total.value, rtol=1e-12)
    np.testing.assert_allclose(both.first.value, [[0.36, 1.0], [0.64, 0.0]], atol=2e-3)
    np.testing.assert_allclose(both.variance.value, [25 / 12, 9 / 12], rtol=1e-3)
    still = indices(lambda u: np.full((1, u.shape[1]), 3.0), 2, [[0], [1]])
    assert np.isnan([still.first.value, still.total.value]).all()
    assert still.variance.value == 0


def test_quantiles_of_known_laws():
    samples = budget_module.scrambled_points(2, 3, 1024)
    scaled = np.array([1.0, 5.0])[:, None]
    value, change = budget_module.quantile_changes(samples * scaled / 2, samples * scaled, 0.95, 0.99)
    np.testing.assert_allclose(value.value, [0.475, 2.375], rtol=1e-3)
    np.testing.assert_allclose(change.value, [-0.475, -2.375], rtol=1e-3)
    assert (np.abs(value.value - [0.475, 2.375]) <= value.half_width).all()
    np.testing.assert_allclose(budget_module.quantiles(samples, 0.95, 0.99).value, 0.95, rtol=1e-3)
    # at a jump they are not resolved: two values, the upper one of probability 0.05, 0.051 and 0.5; beyond it is exact
    for probability, given in ((0.05, False), (0.051, False), (0.5, True)):
        points = budget_module.scrambled_points(1, 1, 32)
        found = budget_module.quantiles(np.where(points > 1 - probability, 1.0, -1.0), 0.95, 0.95)
        assert np.isfinite(found.value[0]) == given
        assert not given or (found.value[0], found.half_width[0]) == (pytest.approx(1.0, abs=1e-14), pytest.approx(0.0))


def test_intervals_of_skewed_replicates_cover():
    """Means of 32 numbers: Student's interval holds that of exponential ones in 92.5 of 100 runs."""
    random = np.random.default_rng(0)
    runs = 4000
    for numbers, mean in (
        (random.exponential(size=(32, runs)), 1.0),
        (random.poisson(0.2, (32, runs)).astype(float), 0.2),
        ((1 - random.random((32, runs))) ** -0.2, 1.25),
        (random.normal(size=(32, runs)), 0.0),
    ):
        held = np.abs(numbers.mean(axis=0) - mean) <= half_widths(numbers, 0.95)
        assert held.sum() >= binom.ppf(1e-4, runs, 0.945)
    numbers = np.random.default_rng(4).normal(size=budget_module.REPLICATES // 2)
    numbers = np.concatenate([numbers, -numbers])
    found = jackknife(lambda used: numbers[used].mean(), 0.95)
    assert found.value == pytest.approx(0.0, abs=1e-15)
    # 2.03951: the 97.5 % quantile of Student's law with 31 degrees of freedom, from a table; a tenth where nothing is skewed
    assert found.half_width == pytest.approx(1.1 * 2.03951 * numbers.std(ddof=1) / math.sqrt(32), rel=1e-4)


def test_lognormal_numbers_whose_tail_no_point_meets_are_not_resolved():
    """A standard deviation of 300 % of the mean: the variance came out within its interval in 59 of 100 runs."""
    found = indices(lambda u: np.exp(1.517 * ndtri(u[:1])), 1, [[0]], points=32)
    for estimate in (found.first, found.total, found.first_sum, found.variance):
        assert np.isnan(estimate.value).all()
    assert found.varies.all()


@pytest.mark.parametrize("size", [10.0, 100.0])
def test_a_rare_value_that_no_point_meets_is_not_overlooked(size):
    """Of probability 1e-5, as large as 10 or 100 standard deviations of the rest: 1/1001 and 1/11 of the variance.

    No point meets it, so that 0 and 1 would be found with no scatter: the first is within the interval that the law
    gives, the second is not resolved.
    """

    def function(u):
        return (np.where(u[0] > 1 - 1e-5, size, 0.0) + ndtri(u[1]))[None]

    both = budget_module.scrambled_points(4, 0, 32)
    found = budget_module.sobol_indices(function, both[:2], both[2:], [[0], [1]], breaks=[(1 - 1e-5,), ()])
    rare = size**2 * 1e-5
    for estimates in (found.first, found.total):
        if size == 10:
            assert covers(estimates, np.array([[rare], [1]]) / (1 + rare)).all()
        else:
            assert np.isnan(estimates.value).all()


def lognormal_and_normal(spread, part):
    """Return y = a x + b z + 0.3 a x z, x lognormal with σ / mean = ``spread``, a² Var x = part; with S, T and V."""
    log = math.sqrt(math.log(1 + spread**2))

    def function(u):
        x, z = (np.exp(log * ndtri(u[0]) - log**2 / 2) - 1) / spread, ndtri(u[1])
        return (math.sqrt(part) * (x + 0.3 * x * z) + math.sqrt(1 - part) * z)[None]

    both = 0.09 * part
    return function, np.array([part, 1 - part, part + both, 1 - part + both, (1 + both) ** 2]) / (1 + both)


@pytest.mark.slow
def test_more_points_resolve_lognormal_numbers_with_intervals_that_cover():
    def found(function, seed, points):
        of = indices(function, 2, [[0], [1]], seed=seed, points=points)
        rows = [(one.value.ravel(), one.half_width.ravel()) for one in (of.first, of.total, of.variance)]
        return np.concatenate(rows, axis=1)

    for spread, part in ((0.3, 1.0), (0.5, 0.5), (0.5, 1.0), (0.7, 1.0), (1.0, 0.2)):
        function, truth = lognormal_and_normal(spread, part)
        values, widths = np.array([found(function, 1, 2**k) for k in range(5, 10)]).swapaxes(0, 1)
        known = np.isfinite(values)
        assert (known[1:] >= known[:-1]).all()
        assert known[-1].all()
        assert (np.abs(values - truth)[known] <= widths[known] + 1e-9).all()
        assert widths[-1, :4].max() < 0.05
    function, truth = lognormal_and_normal(0.5, 0.5)
    runs = np.array([found(function, seed, 64) for seed in range(20)])
    assert np.isfinite(runs).all()
    assert (np.abs(runs[:, 0] - truth) <= runs[:, 1]).sum(axis=0).min() >= binom.ppf(1e-4, 20, 0.95)


@pytest.mark.slow
def test_an_angle_whose_farthest_tail_is_more_than_half_a_turn():
    """A slide y of a ± 0.3 m and a swivel of σ = 0.45 rad, 0.5 m to the tool: shares of 0.5 sin and cos in closed form."""
    sources = [JointOffset(joint="rail", offset=pp.Uniform(0.3)), JointOffset(joint="swivel", offset=pp.Normal(0.45))]
    model = pp.ErrorModel(chain_of(SWING, tip="tool", gravity=(0, 0, 0)), pp.Space(), sources)
    found, square = pp.budget(model, [0.0, 0.0], samples=FEW).poses[0], 0.45**2
    sine = 0.25 * (1 - math.exp(-2 * square)) / 2
    cosine = 0.25 * ((1 + math.exp(-2 * square)) / 2 - math.exp(-square))
    slide = 0.3**2 / 3
    rail, swivel = (group.total for group in found.groups)
    for quantity, turned in (("position", sine + cosine), ("position.y", sine)):
        for part, estimate in ((slide, rail[quantity]), (turned, swivel[quantity])):
            low, high = estimate.interval
            assert low - 1e-6 <= part / (slide + turned) <= high + 1e-6
            assert high - low < 0.1
    sources[1] = JointOffset(joint="swivel", offset=pp.Normal(1.5))
    with pytest.raises(pp.InputError, match="an error rotates a frame by 180°"):
        pp.budget(pp.ErrorModel(model.chain, pp.Space(), sources), [0.0, 0.0], samples=FEW)


def test_points_lie_inside_and_depend_on_the_seed_alone():
    points = budget_module.scrambled_points(5, 2**64 - 1, 64)
    assert points.shape == (5, 64 * budget_module.REPLICATES)
    assert 0 < points.min() < points.max() < 1
    np.testing.assert_array_equal(points, budget_module.scrambled_points(5, 2**64 - 1, 64))
    assert not np.array_equal(points, budget_module.scrambled_points(5, 0, 64))
    split = points.reshape(5, budget_module.REPLICATES, 64)
    # a net: each replicate has one point in every 1/64 of each axis
    assert (np.sort((split * 64).astype(int), axis=2) == np.arange(64)).all()
    assert not np.array_equal(split[:, 0], split[:, 1])


SHEET = """precision-pin: 1
robot: arm.urdf
poses: {flat: 0 deg}
parameters:
  stiff: {uniform: 800 N*m^2, mean: 8000 N*m^2}
  wall: {uniform: 0.1 mm, mean: 3 mm}
  idle: {uniform: 1 mm}
sources:
  - payload: {at: tool, mass: 3 kg}
  - beam: {link: arm, segments: [{fraction: 0.5, EI: stiff}, {EI: {uniform: 400 N*m^2, mean: 4000 N*m^2}}]}
  - beam: {link: base, section: tube, material: steel, segments: [{outer_diameter: 60 mm, wall: wall}]}
  - joint_offset: {joint: hinge, offset: {normal: 0.01 deg}}
"""


def test_a_parameter_named_in_a_segment_belongs_to_its_beam(tmp_path):
    """By hand: w = 3 kg g (l²/EI integrals), z alone moves to first order."""
    parts = (link("base"), joint("hinge", "revolute", "base", "arm", (0.5, 0, 0), axis=(0, 1, 0)), link("arm"))
    (tmp_path / "arm.urdf").write_text(robot(*parts, joint("flange", "fixed", "arm", "tool", (1, 0, 0)), link("tool")))
    (tmp_path / "arm.errors.yaml").write_text(SHEET)
    model = pp.ErrorModel.load(tmp_path / "arm.errors.yaml")
    owners = [("beam[arm]",), ("beam[base]",), (), ("beam[arm]",), ("joint_offset[hinge]",)]
    assert list(model.owners) == owners
    # what a parameter is, is read off the same places
    units = {draw.name: draw.quantities[0].si for draw in model.space.draws}
    assert units["stiff"] == units["beam[arm].segments[1].EI"] == "N*m^2"
    assert units["wall"] == "m"
    found = pp.budget(model, samples=FEW).poses[0]
    stiff, other = (found.draw(name).share["position"] for name in ("stiff", "beam[arm].segments[1].EI"))
    shares = {line.sources: line.share["position"] for line in found.sources}
    assert shares[("beam[arm]",)] == pytest.approx(stiff + other, rel=1e-12)
    near, far = (1 - 0.5**3) / 8000**2 * 800, 0.5**3 / 4000**2 * 400
    assert stiff / other == pytest.approx((near / far) ** 2, rel=1e-9)


@pytest.mark.slow
def test_table_shows_shares_indices_widths_and_sums(whole):
    text = table(whole)
    for line in (
        r"\Aposition: axis_install\[joint1\]\.A, radius 0\.1 mm, causes 25\.\d % of the variance",
        r"^attitude: axis_install\[",
        r"^4dof\.urdf: base to tool, pose 'paper' \(joint1 -90°",
        r"^axis_install\[joint1\]\.A.* radius 0\.1 mm +25\.25 +\d+\.\d+ ± \d+\.\d+ +-?\d+\.\d+ ± \d+\.\d+$",
        r"^sum .* 100\.00$",
        r"first-order Sobol indices: position sum to \d+\.\d+ ± \d+\.\d+ %, attitude sum to ",
        r"^a1: length\[joint2\], length\[tool\]",
        r"^link from joint1 to joint2",
    ):
        assert re.search(line, text, re.MULTILINE), line
    assert "worst case %" not in text
    closed, sampled = re.findall(r"std ([\d.]+)", re.search(r"^position: std .*", text, re.MULTILINE)[0])[:2]
    assert float(sampled) == pytest.approx(float(closed), rel=0.01)
    # components show the worst case and norms no closed form
    text = table(whole, ["position.z", "attitude.norm"])
    for line in ("worst case %", r"^sum +-$", r"attitude\.norm sum to \d+(\.\d+)? ± "):
        assert re.search(line, text, re.MULTILINE), line
    with pytest.raises(UnknownNameError, match=r"position\.z"):
        table(whole, ["position.w"])


@pytest.mark.slow
def test_many_draws_are_cut_and_correlated_ones_have_a_line():
    """31 draws with names in two scripts, two of them correlated; nothing turns."""
    draws = [pp.Draw("a", pp.Normal(1e-3)), pp.Draw("腕", pp.Normal(2e-3))]
    draws += [pp.Draw(f"n{k}", pp.Uniform(1e-4)) for k in range(29)]
    sources = [Frame(link="base", x="a"), Frame(frame="tool", x="腕", z="a")]
    sources += [Frame(link="base", y=f"n{k}") for k in range(29)]
    space = pp.Space(tuple(draws), (pp.Correlation.pair("a", "腕", 0.5),))
    found = pp.budget(gantry(*sources, space=space), [0.1, 0.2], samples=FEW)
    text = table(found)
    with whole_tables(True):
        assert "more: --all" not in table(found)
    for line in (
        "and 21 more: --all",
        r"correlated: a \+ 腕",
        r"^腕 +σ 2 mm +\d+\.\d+ +- ",
        r"^sum +-$",
        "attitude not resolved",
    ):
        assert re.search(line, text, re.MULTILINE), line


@pytest.mark.slow
def test_bars_of_the_figure_are_the_shares_largest_first(whole):
    upper = figure(whole).axes[0]
    groups = sorted(whole.poses[0].groups, key=lambda group: -round(group.share["position"], 9))[:12]
    bars, diamonds = sorted(upper.containers, key=lambda one: not hasattr(one, "patches"))
    shares = [100 * group.share["position"] for group in groups]
    assert [bar.get_width() for bar in bars.patches] == pytest.approx(shares, rel=1e-12)
    totals = [100 * group.total["position"].value for group in groups]
    assert diamonds[0].get_xdata() == pytest.approx(totals, rel=1e-12)
    assert "radius 0.1 mm" in {part for text in upper.texts for part in text.get_text().split("  ")}
    assert next(label.get_text() for label in upper.get_yticklabels()).startswith("axis of joint1, bearing")
