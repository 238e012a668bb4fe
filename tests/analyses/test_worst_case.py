"""Worst case against published numbers, corners by brute force, closed forms, very many directions and the exact model."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from outputs.test_figures import overlaps
from precision_pin.analyses.supports import Supports
from precision_pin.analyses.worst_case.figure import figure
from precision_pin.analyses.worst_case.table import table
from precision_pin.analyses.worst_case.worst_case import bound_milli, farthest, farthest_error, quadratic_bound
from precision_pin.draws.laws import Law
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from support.refusals import check_refused
from support.sheets import PAPER_Q, SEVEN_Q, everything, named, seven_joint_arm


def still_arm():
    """Return the paper's arm without gravity."""
    return pp.Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", gravity=(0, 0, 0))


def parts_of_the_paper(*kinds):
    """Return the paper's arm without gravity, with the sources of some kinds only."""
    loaded = pp.ErrorModel.load(PAPER_SHEET)
    return pp.ErrorModel(still_arm(), named(loaded), [source for source in loaded.sources if source.kind() in kinds])


def space_of(*laws):
    return pp.Space(tuple(pp.Draw(f"x{k}", law) for k, law in enumerate(laws)))


def corners(low, high):
    return np.array(list(itertools.product(*zip(low, high, strict=True)))).T


# --- published and by hand ---
def test_lengths_of_the_paper_reach_half_a_millimetre():
    model = parts_of_the_paper("length")
    pose = pp.worst_case(model, PAPER_Q, samples=1000).poses[0]
    reach = np.array([entry.high for entry in pose.components[:3]])
    np.testing.assert_allclose(reach * 1e3, [0.15, 0.25402, 0.363046], rtol=0, atol=5e-7)
    np.testing.assert_allclose([entry.low for entry in pose.components[:3]], -reach, rtol=0, atol=1e-15)
    assert round(pose.position.first_order.lower * 1e3, 6) == 0.463111
    assert pose.attitude.first_order.upper < 1e-15
    assert not pose.attitude.exceeded


@pytest.mark.slow
def test_four_installed_axes_turn_the_tool_by_eight_milliradians():
    pose = pp.worst_case(parts_of_the_paper("axis_install"), PAPER_Q, samples=1000).poses[0]
    check(pose.attitude.first_order, 8e-3)
    # two points of radius 0.1 mm on every axis, 100 mm apart: 1 mrad each, all along the one common normal
    shares = [entry.value for entry in pose.attitude.contributions]
    np.testing.assert_allclose(shares[:8], 1e-3, rtol=1e-9)
    assert max(shares[8:]) == 0.0


@pytest.mark.filterwarnings("ignore:.*W_NOTHING_VARIES")
def test_without_tolerances_the_worst_case_is_the_error_that_is_there():
    for law in (pp.Fixed(2e-3), pp.Uniform(0.0, mean=2e-3)):
        model = pp.ErrorModel(still_arm(), pp.Space(), [JointOffset(joint="joint1", offset=law)])
        pose = pp.worst_case(model, PAPER_Q, samples=100).poses[0]
        error = model.at(PAPER_Q).exact(np.array([[2e-3]]))[:, 0]
        for bound, part in ((pose.position, error[:3]), (pose.attitude, error[3:])):
            size = np.linalg.norm(part)
            assert bound.first_order.upper == pytest.approx(size, rel=1e-9)
            assert [bound.first_order.lower, bound.exact_norm, bound.found.norm] == pytest.approx([size] * 3, rel=1e-14)
        assert [(entry.low, entry.high) for entry in pose.components] == [(value, value) for value in error]


# --- supports ---
@pytest.mark.parametrize("seed", range(2))
def test_boxes_reach_their_farthest_corner(seed):
    generator = np.random.default_rng(seed)
    t = generator.uniform(0.1, 2, 8)
    space = space_of(
        pp.Uniform(t[0]), pp.Uniform(t[1], mean=5.0), pp.Triangular(t[2]), pp.TruncatedNormal(t[3], k=2.0), pp.TwoPoint(t[4]),
        pp.Uniform(t[5], mean=-1.0), pp.Fixed(3.0), pp.Rows(((-t[6],), (2 * t[6],))),
    )  # fmt: skip
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, space.size))
    high = np.array([t[0], t[1], t[2], 2 * t[3], t[4], t[5], 0.0, 1.5 * t[6]])
    expected = np.linalg.norm(error[:, None] + jacobian @ corners(-high, high), axis=0).max()
    supports = Supports.of(space, 3.0)
    assert supports.cut == ()
    check(farthest_error(error, jacobian, supports), expected)


def test_a_joint_normal_law_reaches_k_times_its_largest_singular_value():
    matrix = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]])
    jacobian = np.random.default_rng(1).normal(size=(3, 3))
    space = space_of(pp.JointNormal(tuple(map(tuple, matrix)), (1.0, 2.0, 3.0)))
    for k in (1.0, 3.0, 4.5):
        supports = Supports.of(space, k)
        expected = k * np.sqrt(np.linalg.eigvalsh(jacobian @ matrix @ jacobian.T).max())
        found = farthest_error(np.zeros(3), jacobian, supports)
        assert (found.lower, found.certified) == (pytest.approx(expected, rel=1e-12), True)
        assert supports.cut == ("x0",)
        point = supports.points((found.direction @ jacobian)[None])[0]
        assert point @ np.linalg.inv(matrix) @ point == pytest.approx(k**2, rel=1e-12)


def test_correlated_normal_draws_are_one_joint_normal_law_and_others_keep_their_boxes():
    correlation = pp.Correlation(("b", "a"), ((1.0, -0.8), (-0.8, 1.0)))
    uniforms = pp.Correlation.pair("c", "d", 0.9)
    laws = {"a": pp.Normal(2.0), "c": pp.Uniform(1.0), "b": pp.Normal(0.5, mean=7.0), "d": pp.Uniform(2.0)}
    draws = tuple(pp.Draw(*one) for one in laws.items())
    supports = Supports.of(pp.Space(draws, (correlation, uniforms)), 4.0)
    assert (supports.cut, supports.names) == (("a", "b"), ("c", "d", "b, a"))
    jacobian = np.random.default_rng(6).normal(size=(3, 4))
    matrix = np.array([[4.0, -0.8], [-0.8, 0.25]])  # of a and b
    rim = 4 * np.linalg.cholesky(matrix) @ circle(20_001)
    boxes = corners(np.array([-1.0, -2.0]), np.array([1.0, 2.0]))
    errors = (jacobian[:, [0, 2]] @ rim)[:, :, None] + (jacobian[:, [1, 3]] @ boxes)[:, None]
    found = farthest_error(np.zeros(3), jacobian, supports)
    assert found.lower == pytest.approx(np.linalg.norm(errors, axis=0).max(), rel=1e-7)
    assert found.certified
    point = supports.points((found.direction @ jacobian)[None])[0]
    assert point[[0, 2]] @ np.linalg.inv(matrix) @ point[[0, 2]] == pytest.approx(16.0, rel=1e-12)
    draws = pp.Draw("u", pp.Normal(1e-4)), pp.Draw("v", pp.Normal(1e-4))
    space = pp.Space(draws, (pp.Correlation.pair("u", "v", -0.5),))
    lengths = Length(joint="joint3", along="x of joint2", parameters=("u", "v"))
    result = pp.worst_case(pp.ErrorModel(still_arm(), space, [lengths]), PAPER_Q, samples=500)
    bound = result.poses[0].position  # the sum of two has the variance 2 (1 - 0.5) σ²
    assert bound.first_order.lower == pytest.approx(3e-4, rel=1e-12)
    assert [entry.draw for entry in bound.contributions] == ["u, v"]
    assert "at 0.15 mm, 0.15 mm" in table(result) or "at -0.15 mm, -0.15 mm" in table(result)


def circle(count):
    turn = np.linspace(0, 2 * np.pi, count)
    return np.array([np.cos(turn), np.sin(turn)])


def test_discs_circles_and_rows_reach_their_farthest_points():
    generator = np.random.default_rng(3)
    rows = generator.normal(size=(40, 3))
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, 5))
    away = (rows - rows.mean(axis=0)) @ jacobian[:, 2:].T
    rim = (jacobian[:, :2] @ (0.7 * circle(20_001))).T
    expected = np.linalg.norm(error + rim[:, None] + away[None], axis=2).max()
    for law in (pp.Disc(0.7), pp.Circle(0.7)):
        space = space_of(law, pp.Rows(tuple(map(tuple, rows))))
        supports = Supports.of(space, 3.0)
        found = farthest_error(error, jacobian, supports)
        assert (found.lower, found.certified) == (pytest.approx(expected, rel=1e-7), True)
        for direction in (found.direction, np.zeros(3)):
            point = supports.points((direction @ jacobian)[None])[0]
            # the circle is met on its rim, and the table in a row
            assert np.hypot(*point[:2]) == pytest.approx(0.7, rel=1e-14)
            assert np.abs(rows - rows.mean(axis=0) - point[2:]).sum(axis=1).min() < 1e-14


def test_unbounded_laws_of_one_number_are_cut_where_a_normal_law_would_be():
    space = space_of(pp.Normal(0.5, mean=2.0), pp.Lognormal(0.3, mean=1.0), pp.Uniform(1.0))
    shape = np.sqrt(np.log1p(0.09))
    law = stats.lognorm(shape, scale=np.exp(-(shape**2) / 2))
    for k in (1.0, 3.0):
        supports = Supports.of(space, k)
        assert supports.cut == ("x0", "x1")
        beyond = [[sign * 0.5 * k, law.ppf(stats.norm.cdf(sign * k)) - 1, sign] for sign in (-1, 1)]
        np.testing.assert_allclose(supports.ends, beyond, rtol=1e-12)


@dataclass(frozen=True)
class Ball(Law):
    """Points of a ball: known to the package by its support function only."""

    radius: float
    size = 3
    components = (".x", ".y", ".z")
    mean_vector = np.zeros(3)
    sample = None

    def support(self, direction):
        return self.radius * float(np.linalg.norm(direction))


@pytest.mark.slow
def test_a_law_of_another_package_counts_by_its_support_function():
    generator = np.random.default_rng(5)
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, 4))
    supports = Supports.of(space_of(Ball(0.3), pp.Uniform(0.2)), 3.0)
    found = farthest_error(error, jacobian, supports)
    same = Supports.of(space_of(pp.JointNormal(tuple(map(tuple, np.eye(3) * 0.01))), pp.Uniform(0.2)), 3.0)
    assert found.lower == pytest.approx(farthest_error(error, jacobian, same).lower, rel=1e-9)
    assert found.certified
    point = supports.points((found.direction @ jacobian)[None])[0]
    assert np.linalg.norm(point[:3]) == pytest.approx(0.3, rel=1e-7)


def test_what_cannot_be_cut_is_refused():
    check_refused(("the law of x0 is unbounded", Supports.of, space_of(Ball(np.inf)), 3.0))
    for k in (0.0, -1.0, np.nan, np.inf):
        check_refused(("k, where unbounded laws are cut", pp.worst_case, pp.ErrorModel.load(PAPER_SHEET)), k=k)


# --- arms ---
def check_pose(model, result, q, *, bounded):
    """Compare a result with the tangent, with random points of the supports and with the exact model."""
    at, pose = model.at(q), result.poses[0]
    error, jacobian = at.tangent
    draws = model.space.sample(3, 0, 20_000)
    first_order = error[:, None] + jacobian @ (draws - model.space.mean[:, None])
    for bound, rows in ((pose.position, slice(0, 3)), (pose.attitude, slice(3, 6))):
        assert bound.first_order.certified
        given = (bound.parameters, bound.found.parameters)
        x, best = (np.array([one[name] for name in at.space.components]) for one in given)
        reached = error + jacobian @ (x - at.space.mean)
        farthest_point = bound.first_order.lower * bound.first_order.direction
        np.testing.assert_allclose(reached[rows], farthest_point, rtol=0, atol=1e-5 * np.abs(reached).max())
        total = bound.nominal + sum(entry.value for entry in bound.contributions)
        assert [np.linalg.norm(reached[rows]), total] == pytest.approx([bound.first_order.lower] * 2, rel=1e-9)
        found = at.exact(np.array([x, best]).T).T
        np.testing.assert_allclose(found, [bound.exact_error, bound.found.error], rtol=0, atol=1e-14)
        assert np.linalg.norm(bound.found.error[rows]) == pytest.approx(bound.found.norm, rel=1e-13)
        assert bound.found.norm >= bound.exact_norm
        if bounded:
            assert bound.found.norm >= bound.seen.max
            assert np.linalg.norm(first_order[rows], axis=0).max() < bound.first_order.upper
    for row, entry in enumerate(pose.components if bounded else ()):
        assert entry.low <= first_order[row].min() < first_order[row].max() <= entry.high


@pytest.mark.slow
def test_the_papers_arm():
    model = pp.ErrorModel.load(PAPER_SHEET)
    result = pp.worst_case(model, samples=20_000, seed=4)
    assert result.cut == ()
    check_pose(model, result, "paper", bounded=True)
    assert not result.poses[0].position.exceeded
    position, text = result.poses[0].position, table(result)
    assert "goes beyond" not in text
    cells = next(line for line in text.splitlines() if line.startswith("|d|")).split()
    expected = [position.first_order.upper, position.exact_norm, position.found.norm, position.seen.max]
    assert cells[1:6] == ["mm", *(f"{1e3 * value:.6g}" for value in expected)]
    assert text.startswith(f"at worst, every tolerance at once: |d| {cells[2]} mm, ")
    assert f"; exact model: {cells[4]} mm, " in text


@pytest.mark.slow
def test_a_seven_joint_arm_with_correlated_and_shared_draws():
    model = everything(seven_joint_arm())
    result = pp.worst_case(model, SEVEN_Q, samples=20_000, k=4.0)
    assert {"diameter", "centre"} <= set(result.cut)
    assert "modulus" not in result.cut
    check_pose(model, result, SEVEN_Q, bounded=False)
    position = result.poses[0].position
    # the shared rigidity stands in two beams, but once among the contributions and with one value
    assert [entry.draw for entry in position.contributions].count("modulus") == 1
    # this arm sags by 127 mm: the exact model goes farther than its tangent, and the result says so
    assert position.exceeded
    assert result.poses[0].to_dict()["position"]["exact_found"]["exceeds_first_order"] is True
    assert "goes beyond the first-order bound of |d|" in table(result)


def test_where_the_model_bends_the_exact_maximum_is_found_beside_the_bound():
    """Two joints with offsets as large as 0.5 rad: the exact model by hand on a dense grid."""
    chain = still_arm()
    offsets = [JointOffset(joint="joint2", offset=pp.Uniform(0.5)), JointOffset(joint="joint3", offset=pp.Uniform(0.4))]
    bound = pp.worst_case(pp.ErrorModel(chain, pp.Space(), offsets), PAPER_Q, samples=2000).poses[0].position
    nominal = chain.at(PAPER_Q).pose[:3, 3]
    offsets = itertools.product(np.linspace(-0.5, 0.5, 21), np.linspace(-0.4, 0.4, 21))
    tips = [chain.at(np.add(PAPER_Q, (0, *both, 0))).pose[:3, 3] for both in offsets]
    assert bound.found.norm == pytest.approx(np.linalg.norm(np.array(tips) - nominal, axis=1).max(), rel=1e-9)
    assert bound.found.norm != pytest.approx(bound.first_order.lower, rel=1e-3)
    assert bound.found.norm >= bound.seen.max


@pytest.mark.slow
def test_the_json_holds_what_reproduces_it():
    model = pp.ErrorModel.load(PAPER_SHEET)
    data = pp.worst_case(model, samples=3000, seed=5).to_dict()
    assert (data["samples"], data["k"], len(data["assumptions"])) == (3000, 3.0, 3)
    seen = data["poses"][0]["position"]["seen"]
    assert seen["max"] == pp.monte_carlo(model, samples=3000, seed=5).position.norm.max
    low, high = seen["quantile_interval"]["0.9973"]
    assert low <= seen["quantile"]["0.9973"] <= high


def test_printed_bounds_are_rounded_outwards():
    for value, up, text in (
        (0.04657854001, True, "46.5786"), (0.04657854, False, "46.5785"), (-0.005104151, False, "-5.10416"),
        (-0.005104159, True, "-5.10415"), (9.999999e-3, True, "10"), (0.0, True, "0"), (math.nan, False, "-"),
    ):  # fmt: skip
        assert bound_milli(value, up=up) == text


@pytest.mark.slow
def test_bars_of_the_picture_add_up_to_the_bound_and_the_text_says_what_was_cut():
    result = pp.worst_case(everything(seven_joint_arm()), SEVEN_Q, samples=2000)
    for axes, bound in zip(figure(result).axes, (result.poses[0].position, result.poses[0].attitude), strict=True):
        ends = axes.patches[-1].get_x() + axes.patches[-1].get_width(), sum(bar.get_width() for bar in axes.patches)
        assert ends == pytest.approx([1e3 * bound.first_order.lower] * 2, rel=1e-9)
    (head,) = [line for line in table(result).splitlines() if line.startswith("worst case of")]
    assert "cut at 3 standard deviations" in head
    assert all(name in head for name in result.cut)
    # a long name runs over nothing
    name = "a_rather_long_name_of_a_parameter_that_was_measured_together_with_another_one"
    space = pp.Space((pp.Draw(name, pp.JointNormal(((1e-6, 0.0), (0.0, 1e-6)))),))
    model = pp.ErrorModel(still_arm(), space, [JointOffset(joint="joint1", offset=f"{name}.0")])
    assert overlaps(figure(pp.worst_case(model, np.zeros(4), samples=1))) == []


def unit_directions(seed, count):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def check(found, expected):
    assert found.lower == pytest.approx(expected, rel=1e-12)
    assert expected <= found.upper <= expected * (1 + 1e-9)
    assert found.certified


def test_bodies_of_full_symmetry_are_resolved_in_closed_form():
    ball, ring = pp.JointNormal(tuple(map(tuple, np.eye(3) / 9))), np.eye(3)[:, :2]
    for error, laws, columns, expected in (
        ((0, 0, 0), [ball], np.eye(3), 1.0),
        ((1, 2, 2), [ball], np.eye(3), 4.0),
        ((0, 0, 0), [pp.Disc(1.0), pp.Disc(2.0), pp.Uniform(4.0)], np.hstack([ring, np.eye(3)]), 5.0),
        ((3, 0, 0), [pp.Disc(1.0)], ring, 4.0),
        ((0, 0, 4), [pp.Disc(3.0)], ring, 5.0),
        ((0, 0, -2), [pp.Fixed(1.0)], ring[:, :1], 2.0),
        ((0, 0, 0), [pp.Disc(1.0)], 0 * ring, 0.0),
    ):
        found = farthest_error(np.array(error, dtype=float), columns, Supports.of(space_of(*laws), 3.0))
        check(found, expected)
        assert found.cells == 0


@pytest.mark.fast(1)
@pytest.mark.parametrize("seed", range(3))
def test_no_direction_goes_beyond_the_upper_end(seed):
    generator = np.random.default_rng(seed)
    supports = Supports.of(space_of(*[pp.Uniform(1.0)] * 15, *[pp.Disc(1.0)] * 6), 3.0)
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, 27))
    found = farthest_error(error, jacobian, supports)
    assert found.certified
    u = unit_directions(seed, 200_000)
    boxes, discs = np.split(u @ jacobian, [15], axis=1)
    heights = u @ error + np.abs(boxes).sum(axis=1) + np.hypot(discs[:, ::2], discs[:, 1::2]).sum(axis=1)
    assert heights.max() <= found.upper
    # that far a point of the body does lie
    point = supports.points((found.direction @ jacobian)[None])[0]
    assert np.linalg.norm(error + jacobian @ point) == pytest.approx(found.lower, rel=1e-9)


def test_a_gap_that_does_not_close_is_reported():
    found = farthest(lambda u: np.ones(len(u)), lambda u: u, most_cells=5000)  # a ball
    assert (found.certified, found.lower) == (False, pytest.approx(1.0, rel=1e-12))
    assert found.cells <= 5000
    assert 1.0 + 1e-9 < found.upper < 1.01


@pytest.mark.parametrize("seed", range(5))
def test_the_bound_in_closed_form_is_a_bound_whatever_the_direction(seed):
    generator = np.random.default_rng(seed)
    roots = [generator.normal(size=(3, p)) for p in generator.integers(1, 4, size=5)]
    centre = generator.normal(size=3)
    u = unit_directions(seed, 50_000)
    largest = (u @ centre + sum(np.linalg.norm(u @ root, axis=1) for root in roots)).max()
    for direction in unit_directions(seed + 50, 5):
        assert quadratic_bound(centre, roots, direction) >= largest
    assert quadratic_bound(centre, [], u[0]) == pytest.approx(np.linalg.norm(centre), rel=1e-12)
    assert quadratic_bound(centre, [np.array([[0.0], [0.0], [1.0]])], np.array([1.0, 0.0, 0.0])) == math.inf
