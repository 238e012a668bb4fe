"""Moments against arms whose moments are known: closed forms, quadrature, and plain sampling."""

from __future__ import annotations

import json
import math
import re
import tracemalloc

import numpy as np
import pytest
from scipy import stats

from precision_pin.analyses.moments.moments import Measured, deviations, moments, table
from precision_pin.analyses.moments.moments_control import Control
from precision_pin.base.errors import InputError
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.sampling import monte_carlo
from precision_pin.sources.joint_offset import JointOffset
from support.plain_robot import chain_of, joint, link, robot

SAMPLED = ("control", "sobol", "sobol-control", "plain")
LENGTHS = (0.7, 0.4)
SLACK = 2e-16
"""Rounding of errors of a metre."""


def arm(*draws: Draw, correlations: tuple[Correlation, ...] = (), kind: str = "revolute") -> ErrorModel:
    """Return a stretched arm along x; joint k turns about z (or slides along x) by component k of the draws."""
    space = Space(draws, correlations)
    count = space.size
    names = ["base", *(f"link{k}" for k in range(1, count + 1))]
    parts = [link(name) for name in (*names, "tool")]
    for k in range(count):
        axis = (0, 0, 1) if kind == "revolute" else (1, 0, 0)
        origin = (LENGTHS[k - 1] if k else 0, 0, 0)
        parts.append(joint(f"joint{k + 1}", kind, names[k], names[k + 1], xyz=origin, axis=axis))
    parts.append(joint("flange", "fixed", names[-1], "tool", xyz=(LENGTHS[count - 1], 0, 0)))
    offsets = [JointOffset(joint=f"joint{k + 1}", offset=name) for k, name in enumerate(space.components)]
    return ErrorModel(chain_of(robot(*parts), tip="tool"), space, offsets, {"rest": np.zeros(count)})


def errors_of(angles: np.ndarray) -> np.ndarray:
    """Return the exact errors ``(6, N)`` of the arm that turns, by the textbook, for angles ``(1 or 2, N)``."""
    turned = np.cumsum(angles, axis=0)
    lengths = np.array(LENGTHS[: len(angles)])[:, None]
    result = np.zeros((6, angles.shape[1]))
    result[0] = (lengths * (np.cos(turned) - 1)).sum(axis=0)
    result[1] = (lengths * np.sin(turned)).sum(axis=0)
    result[5] = turned[-1]
    return result


def weighted(errors: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of errors with weights."""
    mean = errors @ weights
    return mean, (errors * weights) @ errors.T - np.outer(mean, mean)


def pairs(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes ``(2, N)`` and weights of two independent numbers."""
    x, y = np.meshgrid(first[0], second[0], indexing="ij")
    return np.stack([x.ravel(), y.ravel()]), np.outer(first[1], second[1]).ravel()


def polar(radii: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes ``(2, N)`` of points whose direction is uniform."""
    angles = np.arange(32) * 2 * np.pi / 32
    points = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)])[:, None]
    return points.reshape(2, -1), np.repeat(weights / 32, 32)


def covered(found: Measured, truth: np.ndarray) -> np.ndarray:
    return np.abs(found.value - truth) <= found.half_width + SLACK


def estimates(pose) -> list[Measured]:
    return [pose.mean, pose.covariance, pose.norm_mean, pose.norm_variance]


# --- one joint, every moment by hand ---
def one_joint(law: str, spread: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return mean, covariance, mean and variance of the norms for an angle that is normal(σ) or uniform(±a)."""
    length = LENGTHS[0]
    if law == "normal":
        cos, cos_double = math.exp(-(spread**2) / 2), math.exp(-2 * spread**2)
        sin_angle, variance = spread**2 * cos, spread**2
    else:
        cos, cos_double = math.sin(spread) / spread, math.sin(2 * spread) / (2 * spread)
        sin_angle, variance = (math.sin(spread) - spread * math.cos(spread)) / spread, spread**2 / 3
    mean = np.array([length * (cos - 1), 0, 0, 0, 0, 0])
    covariance = np.zeros((6, 6))
    covariance[0, 0] = length**2 * ((1 + cos_double) / 2 - cos**2)
    covariance[1, 1] = length**2 * (1 - cos_double) / 2
    covariance[1, 5] = covariance[5, 1] = length * sin_angle
    covariance[5, 5] = variance
    # |d| = 2 l |sin(θ/2)|
    if law == "normal":
        angle = math.sqrt(2 / math.pi) * spread
        z = np.linspace(0, 9, 200_001)
        chord = float(np.trapezoid(2 * np.sin(spread * z / 2) * 2 * stats.norm.pdf(z), z))
    else:
        angle, chord = spread / 2, 4 * (1 - math.cos(spread / 2)) / spread
    norm_mean = np.array([length * chord, angle])
    return mean, covariance, norm_mean, np.array([length**2 * 2 * (1 - cos), variance]) - norm_mean**2


def one_joint_arm(law: str, spread: float) -> ErrorModel:
    return arm(Draw("a", laws.Normal(spread) if law == "normal" else laws.Uniform(spread)))


@pytest.mark.parametrize("law", ["normal", "uniform"])
@pytest.mark.parametrize("method", SAMPLED)
def test_one_joint_by_hand(method, law):
    found = moments(one_joint_arm(law, 0.2), method=method, samples=16 * 1024, seed=1, confidence=0.9999).poses[0]
    # a net over one normal number has all of the error of a fourth power in its two outermost points
    beyond = np.isnan(found.covariance.value)
    assert not beyond.any() or (
        method == "sobol-control" and law == "normal" and np.argwhere(beyond).tolist() == [[0, 0]]
    )
    for estimate, truth in zip(estimates(found), one_joint(law, 0.2), strict=True):
        assert (covered(estimate, truth) | np.isnan(estimate.value)).all()
        if (method, law) == ("control", "uniform"):
            # Student's factor of 31 degrees of freedom, a tenth wider; skewed ones are wider still
            factor = 1.1 * stats.t.ppf(0.99995, 31) * estimate.standard_error
            assert (estimate.half_width >= factor * (1 - 1e-5)).all()
            assert (estimate.half_width <= 1.5 * factor).all()
    assert found.mean.half_width[0] < 1e-3
    np.testing.assert_array_equal(found.covariance.value, found.covariance.value.T)


def test_closed_form_of_one_normal_joint_is_off_by_its_sixth_order():
    """The mean cosine is 1 - σ²/2 + σ⁴/8 - σ⁶/48 …, the variance of the sine σ² - σ⁴ + 2σ⁶/3 …: the σ⁶ are left out.

    Differences in place of derivatives add to these, but less than they are.
    """
    for spread in (0.1, 0.2):
        found = moments(one_joint_arm("normal", spread), method="closed").poses[0]
        mean, covariance, *_ = one_joint("normal", spread)
        length = LENGTHS[0]
        assert found.remainder.order == 4
        assert abs(found.mean.value[0] - mean[0]) < 2 * length * spread**6 / 48
        assert abs(found.covariance.value[1, 1] - covariance[1, 1]) < 2 * length**2 * 2 / 3 * spread**6
        assert found.covariance.value[0, 0] == pytest.approx(length**2 * spread**4 / 2, rel=1e-4)
        # σ⁴/8 of the mean, -σ⁴ of the variance
        assert found.remainder.last_mean[0] == pytest.approx(length * spread**4 / 8, rel=0.02)
        assert found.remainder.last_covariance[1, 1] == pytest.approx(-(length**2) * spread**4, rel=0.02)
        assert (found.norm_mean, found.norm_variance, found.mean.standard_error) == (None, None, None)


# --- two joints, moments by quadrature ---


def _cases(s: float):
    """Return draws, correlations, nodes of quadrature and the order that the closed form leaves out, by name."""
    normal, uniform = (s * Z, GAUSS_NORMAL), (0.3 + s * GAUSS[0], GAUSS[1] / 2)
    radii = (GAUSS[0] + 1) / 2
    z, weights = pairs((Z, GAUSS_NORMAL), (Z, GAUSS_NORMAL))
    mixed = s * np.linalg.cholesky(MATRIX) @ z, weights
    skewed = np.array([-s / 2, 2 * s]), np.array([0.8, 0.2])
    two = (Draw("a", laws.Normal(s)), Draw("b", laws.Normal(2 * s)))
    odd = (Draw("a", laws.TwoPoint(1.25 * s, 0.75 * s, probability=0.2)), Draw("b", laws.Normal(s, 0.2)))
    return {
        "independent": ((two[0], Draw("b", laws.Uniform(s, 0.3))), (), pairs(normal, uniform), 6),
        "disc": ((Draw("p", laws.Disc(s)),), (), polar(s * radii, radii * GAUSS[1]), 6),
        "circle": ((Draw("p", laws.Circle(s)),), (), polar(np.array([s]), np.ones(1)), 6),
        "joint normal": ((Draw("p", laws.JointNormal(MATRIX * s**2)),), (), mixed, 6),
        "correlated normal": (two, (Correlation(("a", "b"), ((1, 0.6), (0.6, 1))),), mixed, 6),
        "skewed": (odd, (), pairs(skewed, (0.2 + normal[0], GAUSS_NORMAL)), 5),
    }


MATRIX = np.array([[1, 1.2], [1.2, 4]])
GAUSS = np.polynomial.legendre.leggauss(24)
Z, GAUSS_NORMAL = np.polynomial.hermite_e.hermegauss(40)
GAUSS_NORMAL = GAUSS_NORMAL / GAUSS_NORMAL.sum()
CASES = list(_cases(1.0))


def case(name: str, spread: float):
    draws, correlations, (nodes, weights), order = _cases(spread)[name]
    return arm(*draws, correlations=correlations), weighted(errors_of(nodes), weights), order


@pytest.mark.parametrize("name", CASES)
def test_closed_form_leaves_out_only_the_next_order(name):
    """Halving the spread divides what is left out by 2⁶, of skewed laws by 2⁵."""
    gaps = []
    for spread in (0.1, 0.05):
        model, (mean, covariance), order = case(name, spread)
        found = moments(model, method="closed").poses[0]
        assert found.remainder.order == 4
        gaps.append((np.abs(found.mean.value - mean).max(), np.abs(found.covariance.value - covariance).max()))
    for wide, narrow in zip(*gaps, strict=True):
        assert wide > 1e-10
        assert math.log2(wide / narrow) == pytest.approx(order, abs=0.35)


@pytest.mark.fast(4)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("method", SAMPLED)
def test_samples_of_two_joints_agree_with_quadrature(method, name):
    model, truth, _ = case(name, 0.1)
    found = moments(model, method=method, samples=16 * 512, seed=3, confidence=0.9999).poses[0]
    for estimate, true in zip((found.mean, found.covariance), truth, strict=True):
        assert covered(estimate, true).all()


@pytest.mark.slow
def test_correlated_draws_that_are_not_normal():
    """A copula of uniform laws: sampled two ways, and the mean's second order from the known covariance."""
    draws = (Draw("a", laws.Uniform(0.02)), Draw("b", laws.Uniform(0.02)))
    model = arm(*draws, correlations=(Correlation(("a", "b"), ((1, 0.7), (0.7, 1))),))
    variance = 0.02**2 / 3
    sum_variance = 2 * variance * (1 + 6 / math.pi * math.asin(0.35))
    closed = moments(model, method="closed").poses[0]
    assert closed.remainder.order == 2
    assert closed.remainder.last_covariance is None
    second = -(LENGTHS[0] * variance + LENGTHS[1] * sum_variance) / 2
    assert closed.mean.value[0] == pytest.approx(second, rel=1e-6)
    assert closed.covariance.value[5, 5] == pytest.approx(sum_variance, rel=1e-9)
    for method in ("control", "sobol", "sobol-control"):
        found = moments(model, method=method, samples=16 * 1024, seed=2, confidence=0.9999).poses[0]
        # what the fourth order adds, σ⁴/8 and so, is below 1e-4 of the second
        assert abs(found.mean.value[0] - second) <= found.mean.half_width[0] + 1e-3 * abs(second)
        assert abs(found.covariance.value[5, 5] - sum_variance) <= found.covariance.half_width[5, 5] + SLACK


# --- intervals ---
@pytest.mark.slow
@pytest.mark.parametrize("method", ["control", "plain"])
def test_intervals_cover_as_often_as_stated_and_nothing_is_biased(method):
    """30 seeds: of each moment, a 95 % interval misses no more often than one of 95 % does, at 1e-5.

    The average of the estimates is within 4.5 of its standard errors (1e-5) of the truth, which a product of means left in
    would not be. The stated standard errors, root mean square, are the estimates' own spread.
    """
    model, truth = one_joint_arm("normal", 0.3), one_joint("normal", 0.3)
    where = [(0, (0,)), (0, (1,)), *((1, pair) for pair in ((0, 0), (0, 1), (1, 1), (1, 5)))]
    where += [(2, (0,)), (2, (1,)), (3, (0,)), (3, (1,))]
    true = np.array([truth[kind][index] for kind, index in where])
    found, stated, hits = [], [], np.zeros(len(where))
    for seed in range(30):
        # what the control leaves of Var(1 - cos θ) is of the sixth order: not resolved by fewer
        samples = 4096 if method == "control" else 1024
        parts = estimates(moments(model, method=method, samples=samples, seed=seed).poses[0])
        found.append([parts[kind].value[index] for kind, index in where])
        stated.append([parts[kind].standard_error[index] for kind, index in where])
        hits += [covered(parts[kind], truth[kind])[index] for kind, index in where]
    assert hits.min() >= stats.binom.ppf(1e-5, 30, 0.95)
    values, errors = np.array(found), np.array(stated)
    spread = values.std(axis=0, ddof=1)
    assert (spread > 0).all()
    assert (np.abs(values.mean(axis=0) - true) <= 4.5 * spread / math.sqrt(30)).all()
    # a spread is known to 13 % from 30 numbers of a normal law, 3.3 times which is allowed
    np.testing.assert_allclose(np.sqrt((errors**2).mean(axis=0)) / spread, 1, atol=0.43)


@pytest.mark.slow
def test_intervals_of_sobol_points_cover_as_often_as_stated(paper):
    """20 seeds on the paper's arm, against 256 times the samples: no fewer hits than of 95 %, at 1e-5."""
    truth = moments(paper, method="control", samples=2**18, seed=10**6).poses[0]
    closed = moments(paper, method="closed").poses[0]
    for one, exact in ((truth.mean, closed.mean), (truth.covariance, closed.covariance)):
        assert (np.abs(one.value - exact.value) <= 2 * one.half_width + SLACK).all()
    found, hits = [], 0
    for seed in range(20):
        pose = moments(paper, method="sobol-control", samples=1024, seed=seed).poses[0]
        parts = ((pose.mean, truth.mean), (pose.covariance, truth.covariance))
        hits = hits + np.concatenate([covered(one, true.value).ravel() for one, true in parts])
        found.append(np.concatenate([one.value.ravel() for one, _ in parts]))
    assert hits.min() >= stats.binom.ppf(1e-5, 20, 0.95)
    values = np.array(found)
    off = np.abs(values.mean(axis=0) - np.concatenate([truth.mean.value, truth.covariance.value.ravel()]))
    known = np.concatenate([truth.mean.standard_error, truth.covariance.standard_error.ravel()])
    assert (off <= 4.5 * np.hypot(values.std(axis=0, ddof=1) / math.sqrt(20), known)).all()


@pytest.mark.slow
def test_control_and_sobol_are_narrower_than_plain_sampling():
    """At 0.02 rad what tangent and products leave, of third order, is σ² √15/6 and so some 1e-3 of the first order."""
    model, errors = arm(Draw("a", laws.Normal(0.02)), Draw("b", laws.Normal(0.02))), {}
    for method in SAMPLED:
        pose = moments(model, "rest", samples=65_536, method=method).poses[0]
        errors[method] = [one.standard_error for one in estimates(pose)]
    for method in ("control", "sobol-control"):
        assert errors[method][0][1] < errors["plain"][0][1] / 300
        assert errors[method][1][1, 1] < errors["plain"][1][1, 1] / 300
        # a mean and a variance that the tangent does not contain: 1 - cos
        assert errors[method][0][0] < errors["plain"][0][0] / 100
        assert errors[method][1][0, 0] < errors["plain"][1][0, 0] / 100
        assert errors[method][2][0] < errors["plain"][2][0] / 2
    assert errors["sobol"][0][1] < errors["plain"][0][1] / 10


@pytest.mark.parametrize("name", CASES)
def test_mean_and_covariance_of_the_control_by_quadrature(name):
    """Whatever its coefficients, the polynomial's own moments are exact; it is close to the error, products included."""
    draws, correlations, (nodes, weights), _ = _cases(0.1)[name]
    control = Control.of(arm(*draws, correlations=correlations).at())
    deviations = control.deviations(nodes)
    mean, covariance = weighted(deviations, weights)
    np.testing.assert_allclose(mean, 0, atol=1e-15)
    np.testing.assert_allclose(control.covariance, covariance, rtol=1e-11, atol=1e-16)
    rest = errors_of(nodes) - deviations - control.mean[:, None]
    tangent_alone = "normal" in name
    assert np.sqrt(rest**2 @ weights).max() < (0.2 if tangent_alone else 0.003)
    assert (control.first.size == 0) == tangent_alone


@pytest.mark.parametrize("method", ["control", "sobol-control"])
def test_of_a_linear_arm_nothing_is_left_to_sample(method):
    """Sliding joints: e = a + b exactly, so mean and covariance are the laws' own and their intervals nothing."""
    model = arm(Draw("a", laws.Uniform(3e-3, 1e-3)), Draw("b", laws.Triangular(6e-3)), kind="prismatic")
    found = moments(model, method=method, samples=1024).poses[0]
    assert found.mean.value[0] == pytest.approx(1e-3, rel=1e-12)
    assert found.covariance.value[0, 0] == pytest.approx(9e-6 / 3 + 36e-6 / 6, rel=1e-12)
    assert found.mean.half_width.max() < 1e-17
    assert found.covariance.half_width.max() < 1e-19
    closed = moments(model, method="closed").poses[0]
    np.testing.assert_allclose(closed.mean.value, found.mean.value, atol=1e-16)
    np.testing.assert_allclose(closed.covariance.value, found.covariance.value, atol=1e-18)
    # where nothing is random the error is the moment, and without a source nothing is
    still, bare = arm(Draw("a", laws.Fixed(0.1))), ErrorModel(model.chain, Space(), [], {"rest": [0.0, 0.0]})
    for one in (method, "plain", "closed"):
        found = moments(still, method=one, samples=1024).poses[0]
        np.testing.assert_allclose(found.mean.value, errors_of(np.array([[0.1]]))[:, 0], atol=1e-15)
        np.testing.assert_allclose(found.covariance.value, 0, atol=1e-18)
        found = moments(bare, method=one, samples=1024).poses[0]
        assert not found.mean.value.any()
        assert not found.covariance.value.any()


# --- the paper's arm ---
@pytest.fixture(scope="module")
def paper() -> ErrorModel:
    return ErrorModel.load(examples.PAPER_SHEET)


def test_plain_sampling_is_that_of_monte_carlo(paper):
    sampled = monte_carlo(paper, samples=16_384, seed=5)
    found = moments(paper, method="plain", samples=16_384, seed=5).poses[0]
    np.testing.assert_allclose(found.mean.value, sampled.summary.mean, rtol=1e-9, atol=1e-15)
    # unbiased both, but for how the products of means are averaged: 1/N of the covariance
    scale = np.sqrt(np.outer(*[np.diag(sampled.covariance)] * 2))
    assert (np.abs(found.covariance.value - sampled.covariance) / scale).max() < 1e-2 / math.sqrt(16_384)
    assert found.norm_mean.value[0] == pytest.approx(sampled.position.norm.mean, rel=1e-12)
    assert found.norm_std.value[1] == pytest.approx(sampled.attitude.norm.std, rel=1e-3)


@pytest.mark.parametrize("method", ["control", "closed"])
def test_result_as_json_table_and_page(paper, method):
    found = moments(paper, samples=1024, method=method)
    read = json.loads(found.to_json())
    assert read["schema"] == "precision-pin/moments/1"
    assert read["samples"] == (0 if method == "closed" else 1024)
    pose = read["poses"][0]
    assert np.array(pose["covariance"]["value"]).shape == (6, 6)
    assert (pose["remainder"] is None) == (method != "closed")
    assert (pose["norm_mean"] is None) == (method == "closed")
    frame = found.to_pandas()
    assert list(frame.columns) == ["mean", "mean_lower", "mean_upper", "std", "std_lower", "std_upper"]
    row = frame.loc[("paper", "position.z")]
    assert row["mean"] == pose["mean"]["value"][2]
    assert row["std"] == pytest.approx(math.sqrt(pose["covariance"]["value"][2][2]))
    assert math.isnan(row["mean_lower"]) == (method == "closed")
    assert math.isnan(frame.loc[("paper", "position.norm"), "mean"]) == (method == "closed")
    page = found._repr_html_()
    assert "|d|" in page
    assert ("±" in page.split("<table>")[1].split("</table>")[0]) == (method != "closed")
    assert method in repr(found)


def test_what_too_few_points_resolve_is_a_dash_and_null():
    rare = Draw("turn", laws.Empirical([[0.0, 0.0], [0.99999, 0.0], [1.0, 0.01]]))
    result = moments(arm(rare), samples=1024, method="sobol")
    assert "nan" not in str(table(result)) + result._repr_html_()
    assert re.search(r"^dy +mm +- +- +- +-$", table(result), re.MULTILINE)
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["poses"][0]["mean"]["value"][1] is None


def test_deviations_of_variances():
    """The interval reaches to the farther of the roots of the variance's ends, √3.8 of 4 ± 0.2; a root has no sign."""
    found = deviations(Measured(np.array([4.0, 1.0, -1.0]), np.array([0.1, 1.0, 1.0]), np.array([0.2, 3.0, 5.0])))
    np.testing.assert_allclose(found.value, [2, 1, 0])
    np.testing.assert_allclose(found.half_width, [2 - math.sqrt(3.8), 1, 2])


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"samples": 1000}, "32 times a power of two"),
        ({"samples": 512}, "32 times a power of two"),
        ({"samples": 2**25}, "32 times a power of two"),
        ({"confidence": 1.0}, "confidence must be above 0 and below 1, got 1.0"),
        ({"method": "sobol_control"}, r"'sobol_control'; did you mean 'sobol-control'"),
    ],
)
def test_wrong_settings_get_one_line(paper, settings, says):
    with pytest.raises(InputError, match=says) as raised:
        moments(paper, **settings)
    assert len(raised.value.findings) == 1


def test_draws_too_wide_for_a_closed_form():
    assert moments(arm(Draw("a", laws.Normal(2.0))), method="closed").poses[0].remainder.order == 4
    with pytest.raises(InputError, match="one standard deviation from the means the exact error does not exist"):
        moments(arm(Draw("a", laws.Normal(3.2))), method="closed")


@pytest.mark.slow
def test_memory_does_not_grow_with_the_samples(paper):
    def peak(samples: int) -> int:
        tracemalloc.start()
        moments(paper, method="sobol-control", samples=samples)
        try:
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(16 * 64)
    assert peak(16 * 8192) < 1.2 * peak(16 * 2048)
