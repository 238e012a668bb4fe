"""Budgets against hand-computed cases, brute force and one another."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import precision_pin as pp
from analyses.test_shapley import by_orders, conditional
from precision_pin.analyses.budget import shapley
from precision_pin.analyses.budget.budget_result import VECTORS
from precision_pin.analyses.budget.shares import by_draw, by_place, correlated_groups
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Disc, Fixed, Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_offset import JointOffset
from support.engines import GANTRY
from support.plain_robot import chain_of
from support.sheets import SEVEN_Q, everything, seven_joint_arm

COMPONENTS = ("position.x", "position.y", "position.z", "attitude.x", "attitude.y", "attitude.z")
CLOSED = (*VECTORS, *COMPONENTS)
FEW = 1024

SWING = """<robot name="swing"><link name="base"/><link name="carriage"/><link name="arm"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="swivel" type="revolute"><parent link="carriage"/><child link="arm"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="bolt" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0 0 -0.5"/></joint>
  <link name="tool"/></robot>"""


@pytest.fixture(scope="module")
def paper() -> ErrorModel:
    return ErrorModel.load(PAPER_SHEET)


@pytest.fixture(scope="module")
def paper_budget(paper):
    return pp.budget(paper).poses[0]


@pytest.fixture(scope="module")
def swing_budget():
    """Return that of a rail of uniform 0.1 mm along y and a swivel of σ = 0.1 mrad about x, the tool 0.5 m below."""
    chain = chain_of(SWING, tip="tool", gravity=(0, 0, 0))
    sources = [JointOffset(joint="rail", offset=Uniform(1e-4)), JointOffset(joint="swivel", offset=Normal(1e-4))]
    return pp.budget(ErrorModel(chain, Space(), sources), [0.0, 0.0], samples=16384, bound_at=4.0).poses[0]


def gantry(*sources, space=Space()) -> ErrorModel:  # noqa: B008 - immutable
    return ErrorModel(chain_of(GANTRY, tip="tool", gravity=(0, 0, 0)), space, sources)


def test_shares_by_hand(swing_budget):
    """Δy = r + 0.5 s: variances 1e-8/3 and 0.25e-8, shares 4/7 and 3/7."""
    rail, swivel = swing_budget.draws
    assert rail.name == "joint_offset[rail].offset"
    for quantity in ("position", "position.y"):
        assert rail.share[quantity] == pytest.approx(4 / 7, abs=1e-12)
        assert swivel.share[quantity] == pytest.approx(3 / 7, abs=1e-12)
    assert (rail.share["attitude"], swivel.share["attitude"]) == (0.0, pytest.approx(1.0, abs=1e-12))
    assert rail.share["position.x"] is swivel.share["position.x"] is rail.share["attitude.z"] is None
    assert swing_budget.std["position.y"] == pytest.approx(math.sqrt(1e-8 / 3 + 0.25e-8), rel=1e-12)


def test_reach_and_share_of_the_worst_case_by_hand(swing_budget):
    """The rail reaches 0.1 mm, the swivel 4 σ · 0.5 m = 0.2 mm."""
    rail, swivel = swing_budget.draws
    assert (rail.reach["position.y"], swivel.reach["position.y"]) == (pytest.approx(1e-4), pytest.approx(2e-4))
    assert (rail.worst_case["position.y"], swivel.worst_case["position.y"]) == (
        pytest.approx(1 / 3, abs=1e-12),
        pytest.approx(2 / 3, abs=1e-12),
    )
    assert (rail.unbounded, swivel.unbounded) == (False, True)
    assert swing_budget.reach["position.y"] == pytest.approx(3e-4)


def test_halved_tolerance_by_hand(swing_budget):
    rail, swivel = swing_budget.draws
    assert rail.halved.std["position"] == pytest.approx(math.sqrt(0.25e-8 / 3 + 0.25e-8), rel=1e-12)
    assert swivel.halved.std["attitude.x"] == pytest.approx(0.5e-4, rel=1e-12)
    # 1.959964: |normal| stays below it with probability 0.95
    for halved, value in ((rail, 1.959964e-4), (swivel, 0.979982e-4)):
        quantile = halved.halved.quantile["attitude.norm"]
        assert abs(quantile.value - value) <= 2 * quantile.half_width
        assert quantile.half_width < 1e-6
    change = rail.halved.change["position.norm"]
    assert change.value == pytest.approx(
        rail.halved.quantile["position.norm"].value - swing_budget.quantile["position.norm"].value, abs=1e-18
    )
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


@pytest.mark.parametrize("count", [20_000, pytest.param(200_000, marks=pytest.mark.slow)])
def test_closed_form_sampling_and_freezing_agree_on_the_papers_arm(paper, paper_budget, count):
    """Freezing each draw at its mean, plain random numbers; tolerance of 5 standard errors of the estimate."""
    at = paper.at()
    layout = sampler.to_arrays(at)
    x = at.space.sample(99, 0, count)

    def variances(values):
        found = sampler.errors_at(layout, "exact", values).var(axis=1)
        return np.array([found[:3].sum(), found[3:].sum(), *found])

    whole = variances(x)
    for draw, rows in zip(at.space.draws, at.space.slices, strict=True):
        frozen = x.copy()
        frozen[rows] = at.space.mean[rows, None]
        freed = 1 - variances(frozen) / whole
        group = paper_budget.group(draw.name)
        for quantity, brute in zip(CLOSED, freed, strict=True):
            share, first, total = group.share[quantity], group.first[quantity], group.total[quantity]
            assert abs(first.value - share) <= 2 * first.half_width + 2e-3
            assert abs(total.value - share) <= 2 * total.half_width + 2e-3
            assert abs(brute - share) <= 5 * math.sqrt(4 * max(share, 1e-6) / count) + 2e-3
        assert not set(group.nonlinear) & set(CLOSED)


def test_sums_of_the_papers_arm(paper_budget):
    for quantity in CLOSED:
        sums = paper_budget.sums[quantity]
        assert sums.closed == pytest.approx(1.0, abs=1e-12)
        assert abs(sums.first.value - 1) <= 2 * sums.first.half_width + 1e-3
        assert abs(sums.variance.value - sums.std**2) <= 2 * sums.variance.half_width + 2e-3 * sums.std**2
        for lines in (paper_budget.draws, paper_budget.sources, paper_budget.places):
            assert math.fsum(line.share[quantity] for line in lines) == pytest.approx(1.0, abs=1e-12)
    assert paper_budget.sums["position.norm"].closed is None
    assert math.fsum(draw.worst_case["position.z"] for draw in paper_budget.draws) == pytest.approx(1.0, abs=1e-12)


def test_sources_and_places_of_the_papers_arm(paper_budget):
    """The length a1 stands in two sources; seats belong to their joint."""
    sources = {line.sources: line for line in paper_budget.sources}
    assert sources["length[joint2]", "length[tool]"].draws == ("a1",)
    assert sources[("length[joint2]",)].draws == ("a0",)
    assert sources[("length[tool]",)].draws == ("a3", "a5")
    names = [place.name for place in paper_budget.places]
    assert names[:3] == ["joint1", "link from joint1 to joint2", "joint2"]
    install = sources[("axis_install[joint1]",)].share
    joint = paper_budget.places[0].share
    # the torque on a vertical axis is zero: all that happens at joint 1 is its installation
    assert all(joint[quantity] == pytest.approx(install[quantity], abs=1e-12) for quantity in CLOSED)


@pytest.mark.slow
def test_lengths_of_the_papers_arm_by_hand():
    """Lengths alone, by finite differences of the exact chain, which is linear in them."""
    paper = ErrorModel.load(PAPER_SHEET)
    lengths = [source for source in paper.sources if source.kind() == "length"]
    named = Space(tuple(draw for draw in paper.space.draws if "[" not in draw.name))
    found = pp.budget(ErrorModel(paper.chain, named, lengths, paper.poses), samples=FEW).poses[0]
    at = ErrorModel(paper.chain, named, lengths, paper.poses).at()
    std = np.array([0.05, 0.05, 0.25, 0.05, 0.25, 0.05]) * 1e-3 / math.sqrt(3)
    steps = np.diag(std)
    parts = (at.exact(steps) - at.exact(-steps)) / 2
    np.testing.assert_allclose(
        [draw.share["position"] for draw in found.draws],
        (parts[:3] ** 2).sum(axis=0) / (parts[:3] ** 2).sum(),
        rtol=1e-9,
    )
    assert all(draw.share["attitude"] is None for draw in found.draws)


def test_a_fixed_draw_has_no_share():
    space = Space((Draw("still", Fixed(2e-3)), Draw("moving", Uniform(1e-3))))
    model = gantry(JointOffset(joint="rail", offset="still"), JointOffset(joint="lift", offset="moving"), space=space)
    found = pp.budget(model, [0.1, 0.2], samples=FEW).poses[0]
    still = found.draw("still")
    assert still.share["position"] == still.worst_case["position.z"] == 0.0
    assert found.draw("moving").share["position"] == 1.0
    group = found.group("still")
    assert group.first["position"].value == group.total["position"].value == group.total["position"].half_width == 0
    assert still.halved.std == found.std
    assert still.halved.quantile == found.quantile
    assert all(change.value == 0 for change in still.halved.change.values())


def test_a_model_without_draws():
    found = pp.budget(gantry(), [0.1, 0.2], samples=FEW).poses[0]
    assert found.draws == found.groups == found.sources == ()
    assert all(sums.closed is None and sums.first is None for sums in found.sums.values())
    json.loads(pp.budget(gantry(), [0.1, 0.2], samples=FEW).to_json())


@pytest.fixture(scope="module")
def seven() -> ErrorModel:
    return everything(seven_joint_arm())


def test_parts_of_the_targets_add_up_to_the_tangent(seven):
    at = seven.at(SEVEN_Q)
    total = np.zeros_like(at.jacobian)
    for part in at.jacobian_parts:
        total[:, part.columns] += part.slopes
    np.testing.assert_allclose(total, at.jacobian, rtol=0, atol=1e-12 * np.abs(at.jacobian).max())


@pytest.mark.slow
def test_seven_joints_with_correlated_and_shared_draws(seven):
    """Sums, sharing, and Shapley effects of the payload's centre against the published form for two inputs."""
    found = pp.budget(seven, SEVEN_Q, samples=4096).poses[0]
    at = seven.at(SEVEN_Q)
    for quantity in CLOSED:
        assert found.sums[quantity].closed == pytest.approx(1.0, abs=1e-12)
        for lines in (found.draws, found.sources, found.places):
            assert math.fsum(line.share[quantity] for line in lines) == pytest.approx(1.0, abs=1e-11)
    shared = {line.draws: line.sources for line in found.sources if len(line.sources) > 1}
    assert shared[("softness",)] == ("joint_compliance[joint1]", "joint_compliance[joint2]")
    assert next(line for line in found.sources if "modulus" in line.draws).sources == ("beam[link2]",)
    centre = found.draw("centre")
    b = at.jacobian[2, [seven.space.index["centre.0"], seven.space.index["centre.1"]]]
    s1, s2 = math.sqrt(1e-4), math.sqrt(2e-4)
    rho = 3e-5 / (s1 * s2)
    expected = (
        b[0] ** 2 * s1**2 * (1 - rho**2 / 2) + b[0] * b[1] * s1 * s2 * rho + b[1] ** 2 * s2**2 * rho**2 / 2
    ) / at.covariance[2, 2]
    assert centre.components["centre.0"]["position.z"] == pytest.approx(expected, rel=1e-9)
    for quantity in CLOSED:
        assert math.fsum(part[quantity] for part in centre.components.values()) == pytest.approx(
            centre.share[quantity], abs=1e-13
        )
    for group in found.groups:
        for quantity in VECTORS:
            first, total = group.first[quantity], group.total[quantity]
            assert first.value <= total.value + 2 * (first.half_width + total.half_width) + 1e-9
            slack = 2 * first.half_width + 0.02
            assert quantity in group.nonlinear or abs(first.value - group.share[quantity]) <= slack


def test_draws_correlated_by_a_copula():
    """Two normal offsets on one line, ρ = 0.6, and a third by itself: the pair is one group with one Sobol index."""
    rho, s1, s2, s3 = 0.6, 1e-3, 2e-3, 1.5e-3
    space = Space(
        (Draw("first", Normal(s1)), Draw("alone", Normal(s3)), Draw("second", Normal(s2))),
        (Correlation(("first", "second"), ((1.0, rho), (rho, 1.0))),),
    )
    sources = [
        Frame(link="base", x="first"),
        Frame(frame="tool", x="second"),
        JointOffset(joint="rail", offset="alone"),
    ]
    model = gantry(*sources, space=space)
    assert correlated_groups(model.space) == ((0, 2), (1,))
    found = pp.budget(model, [0.0, 0.0], samples=16384, confidence=0.99).poses[0]
    whole = s1**2 + s2**2 + 2 * rho * s1 * s2 + s3**2
    effect = (s1**2 * (1 - rho**2 / 2) + rho * s1 * s2 + s2**2 * rho**2 / 2) / whole
    assert found.draw("first").share["position.x"] == pytest.approx(effect, abs=1e-9)
    assert found.draw("alone").share["position.x"] == pytest.approx(s3**2 / whole, abs=1e-9)
    assert found.draw("first").components == {}
    pair = found.group("second")
    assert pair.draws == ("first", "second")
    assert pair.share["position.x"] == pytest.approx(1 - s3**2 / whole, abs=1e-9)
    for index in (pair.first["position.x"], pair.total["position.x"]):
        assert abs(index.value - pair.share["position.x"]) <= index.half_width + 1e-3
    halved = s1**2 / 4 + s2**2 + rho * s1 * s2 + s3**2
    assert found.draw("first").halved.std["position.x"] == pytest.approx(math.sqrt(halved), rel=1e-9)


@pytest.mark.parametrize("most", [12, 3])
def test_correlated_places_agree_with_all_orders(monkeypatch, most):
    """Four correlated numbers along x, of which ``s`` acts at two places; too many players keep joint and link together."""
    monkeypatch.setattr(shapley, "MOST_PLAYERS", most)
    std = np.array([1.0, 2.0, 1.5, 3.0]) * 1e-3
    matrix = np.array([[1, 0.7, -0.5, 0.3], [0.7, 1, -0.2, 0.1], [-0.5, -0.2, 1, 0.4], [0.3, 0.1, 0.4, 1]])
    space = Space(
        tuple(Draw(name, Normal(one)) for name, one in zip("abcs", std, strict=True)),
        (Correlation(tuple("abcs"), tuple(map(tuple, matrix))),),
    )
    sources = [
        Frame(link="base", x="a"),
        JointOffset(joint="rail", offset="b"),
        Frame(link="carriage", x="c"),
        Frame(link="base", x="s"),
        Frame(link="carriage", x=-0.4 * space.parameter("s")),
    ]
    slopes = np.array([[1.0, 1.0, 1.0, 0.6]])
    covariance = matrix * np.outer(std, std)
    whole = (slopes @ covariance @ slopes.T).item()
    effects = by_orders(
        4,
        lambda known: conditional(slopes, covariance, list(known)),
        lambda order: most == 12 or abs(order.index(1) - order.index(2)) == 1,
    )
    a, b, c, s = effects[:, 0] / whole
    alone = std[3] ** 2 / whole
    gain = (s - 0.6**2 * alone) / 2
    model = gantry(*sources, space=space)
    found = {name: part[0] / whole for name, part in by_place(model.at([0.0, 0.0]), model.chain).items()}
    expected = {
        "link from base to rail": a + 0.6 * alone + gain,
        "rail": b,
        "link from rail to lift": c - 0.4 * 0.6 * alone + gain,
    }
    assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
def test_more_correlated_draws_than_can_be_shared():
    count = 13
    matrix = tuple(tuple(1.0 if i == j else 0.2 for j in range(count)) for i in range(count))
    space = Space(
        tuple(Draw(f"d{k}", Normal(1e-3)) for k in range(count)),
        (Correlation(tuple(f"d{k}" for k in range(count)), matrix),),
    )
    model = gantry(*(Frame(link="base", x=f"d{k}") for k in range(count)), space=space)
    found = pp.budget(model, [0.0, 0.0], samples=FEW).poses[0]
    assert np.isnan(by_draw(model.at([0.0, 0.0]))).all()
    assert all(draw.share["position"] is None for draw in found.draws)
    assert found.groups[0].share["position"] == pytest.approx(1.0, abs=1e-12)
    assert found.sums["position"].closed == pytest.approx(1.0, abs=1e-12)
    json.loads(pp.budget(model, [0.0, 0.0], samples=FEW).to_json())


def test_a_parameter_named_like_a_joint_belongs_to_what_uses_it():
    space = Space((Draw("rail", Uniform(1e-3)), Draw("spot", Disc(1e-3)), Draw("idle", Uniform(1.0))))
    model = gantry(
        JointOffset(joint="rail", offset=Uniform(1e-4)),
        JointOffset(joint="lift", offset=2 * space.parameter("rail")),
        Frame(link="base", x="spot.x", y="spot.y"),
        space=space,
    )
    assert dict(zip((draw.name for draw in model.space.draws), model.owners, strict=True)) == {
        "rail": ("joint_offset[lift]",),
        "spot": ("frame[base]",),
        "idle": (),
        "joint_offset[rail].offset": ("joint_offset[rail]",),
    }


@pytest.mark.slow
def test_same_seed_same_result_and_poses_in_order(paper):
    first = pp.budget(paper, seed=5, samples=FEW)
    other = [-1.0, 0.2, 1.2, -1.0]
    both = pp.budget(paper, ["paper", other], seed=5, samples=FEW)
    assert first.to_dict()["poses"][0] == both.to_dict()["poses"][0]
    assert list(both.poses[1].pose.q.values()) == other
    assert (both.poses[0].pose.name, both.poses[1].pose.name) == ("paper", "")
    assert pp.budget(paper, seed=6, samples=FEW).to_dict()["poses"] != first.to_dict()["poses"]
    parsed = json.loads(first.to_json())
    assert parsed["schema"] == "precision-pin/budget/1"
    assert (parsed["seed"], parsed["samples"], parsed["robot"]) == (5, FEW, "4dof.urdf")
    assert parsed["poses"][0]["groups"][0]["first"]["position"]["interval"]


def test_wrong_settings_are_refused(paper):
    for settings in (
        {"samples": 1000}, {"samples": 16 * 32}, {"samples": True}, {"samples": 16 * 96}, {"confidence": 1.0},
        {"bound_at": 0.0}, {"bound_at": math.inf}, {"seed": -1},
    ):  # fmt: skip
        with pytest.raises(InputError):
            pp.budget(paper, **settings)
    with pytest.raises(UnknownNameError):
        pp.budget(paper, "nowhere")
    with pytest.raises(InputError):
        pp.budget(paper, [])
