"""Worst case against published numbers, corners by brute force, closed forms, very many directions and the exact model."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats
from scipy.stats import ortho_group

import precision_pin as pp
from outputs.test_figures import drawn_texts, overlaps
from precision_pin.analyses.worst_case.figure import figure
from precision_pin.analyses.worst_case.table import table
from precision_pin.analyses.worst_case.worst_case import (
    Supports,
    bound_milli,
    farthest,
    farthest_error,
    quadratic_bound,
)
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import (
    Circle,
    Disc,
    Fixed,
    JointNormal,
    Law,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from support.sheets import PAPER_Q, SEVEN_Q, everything, named, seven_joint_arm

TURNED = ((0.0, 0.0, 0.0), (0.0, 0.6, 0.0))


def still_arm() -> Chain:
    """Return the paper's arm without gravity."""
    return Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", gravity=(0, 0, 0))


def parts_of_the_paper(*kinds: str) -> ErrorModel:
    """Return the paper's arm without gravity, with the sources of some kinds only."""
    loaded = ErrorModel.load(PAPER_SHEET)
    return ErrorModel(still_arm(), named(loaded), [source for source in loaded.sources if source.kind() in kinds])


def space_of(*laws: Law) -> Space:
    return Space(tuple(Draw(f"x{k}", law) for k, law in enumerate(laws)))


def corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.array(list(itertools.product(*zip(low, high, strict=True)))).T


# --- published and by hand ---
def test_lengths_of_the_paper_reach_half_a_millimetre():
    model = parts_of_the_paper("length")
    pose = pp.worst_case(model, PAPER_Q, samples=1000).poses[0]
    reach = np.array([entry.high for entry in pose.components[:3]])
    np.testing.assert_allclose(reach * 1e3, [0.15, 0.25402, 0.363046], rtol=0, atol=5e-7)
    np.testing.assert_allclose([entry.low for entry in pose.components[:3]], -reach, rtol=0, atol=1e-15)
    assert round(pose.position.first_order.lower * 1e3, 6) == 0.463111
    # every corner of the six limits, with the slopes of the paper's equations
    limits = np.array([0.05, 0.05, 0.25, 0.05, 0.25, 0.05]) * 1e-3
    turn = np.radians(3), np.radians(-91) + np.radians(90)  # link 2 leans 3°, link 3 hangs 1° off
    (sine, lean), (cosine, hang) = np.sin(turn), np.cos(turn)
    slopes = np.array([[0, -1, 0, -1, 0, -1], [0, 0, -cosine, 0, -lean, 0], [1, 1, -sine, 0, -hang, 0]])
    every = np.linalg.norm(slopes @ corners(-limits, limits), axis=0)
    assert pose.position.first_order.lower == pytest.approx(every.max(), rel=1e-9)
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
    for law in (Fixed(2e-3), Uniform(0.0, mean=2e-3)):
        model = ErrorModel(still_arm(), Space(), [JointOffset(joint="joint1", offset=law)])
        pose = pp.worst_case(model, PAPER_Q, samples=100).poses[0]
        error = model.at(PAPER_Q).exact(np.array([[2e-3]]))[:, 0]
        for bound, part in ((pose.position, error[:3]), (pose.attitude, error[3:])):
            size = np.linalg.norm(part)
            assert bound.first_order.lower == pytest.approx(size, rel=1e-14)
            assert bound.first_order.upper == pytest.approx(size, rel=1e-9)
            assert bound.exact_norm == bound.found.norm == pytest.approx(size, rel=1e-14)
        for entry, value in zip(pose.components, error, strict=True):
            assert entry.low == entry.high == value


# --- supports ---
@pytest.mark.parametrize("seed", range(2))
def test_boxes_reach_their_farthest_corner(seed):
    generator = np.random.default_rng(seed)
    t = generator.uniform(0.1, 2, 8)
    space = space_of(
        Uniform(t[0]), Uniform(t[1], mean=5.0), Triangular(t[2]), TruncatedNormal(t[3], k=2.0), TwoPoint(t[4]),
        Uniform(t[5], mean=-1.0), Fixed(3.0), Rows(((-t[6],), (2 * t[6],))),
    )  # fmt: skip
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, space.size))
    low = np.array([-t[0], -t[1], -t[2], -2 * t[3], -t[4], -t[5], 0.0, -1.5 * t[6]])
    high = np.array([t[0], t[1], t[2], 2 * t[3], t[4], t[5], 0.0, 1.5 * t[6]])
    expected = np.linalg.norm(error[:, None] + jacobian @ corners(low, high), axis=0).max()
    supports = Supports.of(space, 3.0)
    assert supports.cut == ()
    check(farthest_error(error, jacobian, supports), expected)


def test_a_joint_normal_law_reaches_k_times_its_largest_singular_value():
    matrix = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]])
    jacobian = np.random.default_rng(1).normal(size=(3, 3))
    space = space_of(JointNormal(tuple(map(tuple, matrix)), (1.0, 2.0, 3.0)))
    for k in (1.0, 3.0, 4.5):
        supports = Supports.of(space, k)
        expected = k * np.sqrt(np.linalg.eigvalsh(jacobian @ matrix @ jacobian.T).max())
        found = farthest_error(np.zeros(3), jacobian, supports)
        assert found.lower == pytest.approx(expected, rel=1e-12)
        assert found.certified
        assert supports.cut == ("x0",)
        point = supports.points((found.direction @ jacobian)[None])[0]
        assert point @ np.linalg.inv(matrix) @ point == pytest.approx(k**2, rel=1e-12)


def test_correlated_normal_draws_are_one_joint_normal_law_and_others_keep_their_boxes():
    correlation = Correlation(("b", "a"), ((1.0, -0.8), (-0.8, 1.0)))
    uniforms = Correlation.pair("c", "d", 0.9)
    draws = (Draw("a", Normal(2.0)), Draw("c", Uniform(1.0)), Draw("b", Normal(0.5, mean=7.0)), Draw("d", Uniform(2.0)))
    supports = Supports.of(Space(draws, (correlation, uniforms)), 4.0)
    assert supports.cut == ("a", "b")
    assert supports.names == ("c", "d", "b, a")
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
    space = Space((Draw("u", Normal(1e-4)), Draw("v", Normal(1e-4))), (Correlation.pair("u", "v", -0.5),))
    lengths = Length(joint="joint3", along="x of joint2", parameters=("u", "v"))
    result = pp.worst_case(ErrorModel(still_arm(), space, [lengths]), PAPER_Q, samples=500)
    bound = result.poses[0].position  # the sum of two has the variance 2 (1 - 0.5) σ²
    assert bound.first_order.lower == pytest.approx(3e-4, rel=1e-12)
    assert [entry.draw for entry in bound.contributions] == ["u, v"]
    assert "at 0.15 mm, 0.15 mm" in table(result) or "at -0.15 mm, -0.15 mm" in table(result)


def circle(count: int) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, count)
    return np.array([np.cos(turn), np.sin(turn)])


def test_discs_circles_and_rows_reach_their_farthest_points():
    generator = np.random.default_rng(3)
    rows = generator.normal(size=(40, 3))
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, 5))
    away = (rows - rows.mean(axis=0)) @ jacobian[:, 2:].T
    rim = (jacobian[:, :2] @ (0.7 * circle(20_001))).T
    expected = np.linalg.norm(error + rim[:, None] + away[None], axis=2).max()
    for law in (Disc(0.7), Circle(0.7)):
        space = space_of(law, Rows(tuple(map(tuple, rows))))
        supports = Supports.of(space, 3.0)
        found = farthest_error(error, jacobian, supports)
        assert found.lower == pytest.approx(expected, rel=1e-7)
        assert found.certified
        for direction in (found.direction, np.zeros(3)):
            point = supports.points((direction @ jacobian)[None])[0]
            # the circle is met on its rim, and the table in a row
            assert np.hypot(*point[:2]) == pytest.approx(0.7, rel=1e-14)
            assert np.abs(rows - rows.mean(axis=0) - point[2:]).sum(axis=1).min() < 1e-14


def test_unbounded_laws_of_one_number_are_cut_where_a_normal_law_would_be():
    space = space_of(Normal(0.5, mean=2.0), Lognormal(0.3, mean=1.0), Uniform(1.0))
    for k in (1.0, 3.0):
        supports = Supports.of(space, k)
        assert supports.cut == ("x0", "x1")
        low, high = supports.ends
        shape = np.sqrt(np.log1p(0.09))
        law = stats.lognorm(shape, scale=np.exp(-(shape**2) / 2))
        np.testing.assert_allclose(high, [0.5 * k, law.isf(stats.norm.sf(k)) - 1, 1.0], rtol=1e-12)
        np.testing.assert_allclose(low, [-0.5 * k, law.ppf(stats.norm.cdf(-k)) - 1, -1.0], rtol=1e-12)


@dataclass(frozen=True)
class Ball(Law):
    """Points of a ball: known to the package by its support function only."""

    radius: float
    reach: float = 1.0

    @property
    def size(self):
        return 3

    @property
    def components(self):
        return (".x", ".y", ".z")

    def sample(self, variates):
        raise NotImplementedError

    @property
    def mean_vector(self):
        return np.zeros(3)

    def support(self, direction):
        return self.reach * self.radius * float(np.linalg.norm(direction))


@pytest.mark.slow
def test_a_law_of_another_package_counts_by_its_support_function():
    generator = np.random.default_rng(5)
    error, jacobian = generator.normal(size=3), generator.normal(size=(3, 4))
    supports = Supports.of(space_of(Ball(0.3), Uniform(0.2)), 3.0)
    found = farthest_error(error, jacobian, supports)
    same = Supports.of(space_of(JointNormal(tuple(map(tuple, np.eye(3) * 0.01))), Uniform(0.2)), 3.0)
    assert found.lower == pytest.approx(farthest_error(error, jacobian, same).lower, rel=1e-9)
    assert found.certified
    point = supports.points((found.direction @ jacobian)[None])[0]
    assert np.linalg.norm(point[:3]) == pytest.approx(0.3, rel=1e-7)


def test_what_cannot_be_cut_is_refused():
    with pytest.raises(InputError, match="the law of x0 is unbounded"):
        Supports.of(space_of(Ball(0.3, reach=np.inf)), 3.0)
    for k in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="k, where unbounded laws are cut"):
            pp.worst_case(ErrorModel.load(PAPER_SHEET), k=k)


# --- arms ---
def check_pose(model: ErrorModel, result, q, *, bounded: bool):
    """Compare a result with the tangent, with random points of the supports and with the exact model."""
    at, pose = model.at(q), result.poses[0]
    error, jacobian = at.tangent
    for bound, rows in ((pose.position, slice(0, 3)), (pose.attitude, slice(3, 6))):
        assert bound.first_order.certified
        x = np.array([bound.parameters[name] for name in at.space.components])
        reached = error + jacobian @ (x - at.space.mean)
        assert np.linalg.norm(reached[rows]) == pytest.approx(bound.first_order.lower, rel=1e-9)
        farthest_point = bound.first_order.lower * bound.first_order.direction
        np.testing.assert_allclose(reached[rows], farthest_point, rtol=0, atol=1e-5 * np.abs(reached).max())
        total = bound.nominal + sum(entry.value for entry in bound.contributions)
        assert total == pytest.approx(bound.first_order.lower, rel=1e-12)
        np.testing.assert_allclose(at.exact(x[:, None])[:, 0], bound.exact_error, rtol=0, atol=1e-14)
        best = np.array([bound.found.parameters[name] for name in at.space.components])
        np.testing.assert_allclose(at.exact(best[:, None])[:, 0], bound.found.error, rtol=0, atol=1e-14)
        assert np.linalg.norm(bound.found.error[rows]) == pytest.approx(bound.found.norm, rel=1e-13)
        assert bound.found.norm >= bound.exact_norm
        if bounded:
            assert bound.found.norm >= bound.seen.max
    x = model.space.sample(3, 0, 20_000)
    first_order = error[:, None] + jacobian @ (x - model.space.mean[:, None])
    if bounded:
        for row, entry in enumerate(pose.components):
            assert entry.low <= first_order[row].min() < first_order[row].max() <= entry.high
        assert np.linalg.norm(first_order[:3], axis=0).max() < pose.position.first_order.upper
        assert np.linalg.norm(first_order[3:], axis=0).max() < pose.attitude.first_order.upper


@pytest.mark.slow
def test_the_papers_arm():
    model = ErrorModel.load(PAPER_SHEET)
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
    centre = np.array([position.parameters[name] for name in ("centre.0", "centre.1")]) - (0.05, -0.02)
    matrix = np.array([[1e-4, 3e-5], [3e-5, 2e-4]])
    assert centre @ np.linalg.inv(matrix) @ centre == pytest.approx(16.0, rel=1e-9)
    # this arm sags by 127 mm: the exact model goes farther than its tangent, and the result says so
    assert position.exceeded
    assert result.poses[0].to_dict()["position"]["exact_found"]["exceeds_first_order"] is True
    assert "goes beyond the first-order bound of |d|" in table(result)


def test_where_the_model_bends_the_exact_maximum_is_found_beside_the_bound():
    """Two joints with offsets as large as 0.5 rad: the exact model by hand on a dense grid."""
    chain = still_arm()
    offsets = [JointOffset(joint="joint2", offset=Uniform(0.5)), JointOffset(joint="joint3", offset=Uniform(0.4))]
    bound = pp.worst_case(ErrorModel(chain, Space(), offsets), PAPER_Q, samples=2000).poses[0].position
    nominal = chain.at(PAPER_Q).pose[:3, 3]
    grid = [
        np.linalg.norm(chain.at(np.add(PAPER_Q, (0, a, b, 0))).pose[:3, 3] - nominal)
        for a in np.linspace(-0.5, 0.5, 21)
        for b in np.linspace(-0.4, 0.4, 21)
    ]
    assert bound.found.norm == pytest.approx(max(grid), rel=1e-9)
    assert bound.found.norm != pytest.approx(bound.first_order.lower, rel=1e-3)
    assert bound.found.norm >= bound.seen.max


@pytest.mark.slow
def test_the_json_holds_what_reproduces_it():
    model = ErrorModel.load(PAPER_SHEET)
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


def long_names() -> ErrorModel:
    name = "a_rather_long_name_of_a_parameter_that_was_measured_together_with_another_one"
    space = Space((Draw(name, JointNormal(((1e-6, 0.0), (0.0, 1e-6)))),))
    return ErrorModel(still_arm(), space, [JointOffset(joint="joint1", offset=f"{name}.0")])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_NOTHING_VARIES")
@pytest.mark.parametrize(
    ("build", "samples"),
    [
        (lambda: everything(seven_joint_arm()), 2000),
        (lambda: ErrorModel(still_arm(), Space(), [JointOffset(joint="joint1", offset=Fixed(0.0))]), 100),
        (long_names, 1),
    ],
)
def test_the_picture_is_readable_and_the_text_says_what_was_cut(build, samples):
    model = build()
    result = pp.worst_case(model, SEVEN_Q if len(model.chain.joints) == 7 else np.zeros(4), samples=samples)
    drawn = figure(result)
    assert overlaps(drawn) == []
    texts = drawn_texts(drawn)
    assert len(texts) > 10
    assert min(text.get_fontsize() for text in texts) >= 7
    for box in (text.get_window_extent() for text in texts):
        assert drawn.bbox.x0 <= box.x0 < box.x1 <= drawn.bbox.x1
        assert drawn.bbox.y0 <= box.y0 < box.y1 <= drawn.bbox.y1
    for axes, bound in zip(drawn.axes, (result.poses[0].position, result.poses[0].attitude), strict=True):
        if bound.first_order.lower:
            ends = axes.patches[-1].get_x() + axes.patches[-1].get_width(), sum(bar.get_width() for bar in axes.patches)
            assert ends == pytest.approx([1e3 * bound.first_order.lower] * 2, rel=1e-9)
    (head,) = [line for line in table(result).splitlines() if line.startswith("worst case of")]
    assert ("cut at 3 standard deviations" in head) == bool(result.cut)
    assert all(name in head for name in result.cut)


class Body:
    """centre + boxes·[-1, 1]ⁿ + ellipsoids: the support function written out, and its gradient."""

    def __init__(self, centre, boxes=(), ellipsoids=()):
        self.centre = np.asarray(centre, dtype=float)
        self.boxes = np.asarray(boxes, dtype=float).reshape(-1, 3)
        self.ellipsoids = [np.asarray(root, dtype=float) for root in ellipsoids]

    def heights(self, u):
        value = u @ self.centre + np.abs(u @ self.boxes.T).sum(axis=1)
        return value + sum(np.linalg.norm(u @ root, axis=1) for root in self.ellipsoids)

    def touch(self, u):
        points = self.centre + np.sign(u @ self.boxes.T) @ self.boxes
        for root in self.ellipsoids:
            seen = u @ root
            length = np.linalg.norm(seen, axis=1, keepdims=True)
            points = points + (seen / np.where(length > 0, length, 1)) @ root.T
        return points

    def bound(self, u):
        return quadratic_bound(self.centre, [*(row[:, None] for row in self.boxes), *self.ellipsoids], u)

    def search(self, *, is_bounded=True, **settings):
        return farthest(self.heights, self.touch, *[self.bound] * is_bounded, **settings)


def unit_directions(seed: int, count: int) -> np.ndarray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def check(found, expected):
    assert found.lower == pytest.approx(expected, rel=1e-12)
    assert expected <= found.upper <= expected * (1 + 1e-9)
    assert found.certified


@pytest.mark.parametrize("seed", range(3))
def test_a_zonotope_reaches_as_far_as_its_farthest_corner(seed):
    generator = np.random.default_rng(seed)
    rows = int(generator.integers(1, 11))
    body = Body(generator.normal(size=3) * (seed % 3), generator.normal(size=(rows, 3)) * generator.uniform(0.01, 3))
    signs = np.array(list(itertools.product((-1, 1), repeat=rows)))
    expected = np.linalg.norm(body.centre + signs @ body.boxes, axis=1).max()
    turn, other = ortho_group.rvs(3, random_state=seed), ortho_group.rvs(3, random_state=seed + 100)
    axes = np.array([3.0, 2.0, 1.0]) * generator.uniform(0.1, 10)
    ellipsoid = Body(np.zeros(3), ellipsoids=[turn @ np.diag(axes) @ other])
    for is_bounded in (True, False):
        check(body.search(is_bounded=is_bounded), expected)
        check(ellipsoid.search(is_bounded=is_bounded), axes[0])


def test_bodies_of_full_symmetry_are_resolved_in_closed_form():
    ring = np.eye(3)[:, :2]
    for body, expected in (
        (Body(np.zeros(3), ellipsoids=[np.eye(3)]), 1.0),
        (Body((1.0, 2.0, 2.0), ellipsoids=[np.eye(3)]), 4.0),
        (Body(np.zeros(3), [(0.0, 0.0, 4.0)], [ring, 2 * ring]), 5.0),
        (Body((3.0, 0.0, 0.0), ellipsoids=[ring]), 4.0),
        (Body((0.0, 0.0, 4.0), ellipsoids=[3 * ring]), 5.0),
        (Body((0.0, 0.0, -2.0)), 2.0),
        (Body(np.zeros(3), [(0.0, 0.0, 0.0)], [np.zeros((3, 2))]), 0.0),
    ):
        found = body.search()
        check(found, expected)
        assert found.cells == 0


@pytest.mark.fast(1)
@pytest.mark.parametrize("seed", range(3))
def test_no_direction_goes_beyond_the_upper_end(seed):
    generator = np.random.default_rng(seed)
    boxes, discs = generator.normal(size=(15, 3)), [generator.normal(size=(3, 2)) for _ in range(6)]
    body = Body(generator.normal(size=3), boxes, discs)
    found = body.search()
    assert found.certified
    looked_at = body.heights(unit_directions(seed, 200_000)).max()
    assert looked_at <= found.upper
    # that far a point of the body does lie
    assert np.linalg.norm(body.touch(found.direction[None])) == pytest.approx(found.lower, rel=1e-9)


def test_a_gap_that_does_not_close_is_reported():
    body = Body(np.zeros(3), ellipsoids=[np.eye(3)])
    found = body.search(is_bounded=False, most_cells=5000)
    assert not found.certified
    assert found.cells <= 5000
    assert found.lower == pytest.approx(1.0, rel=1e-12)
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
