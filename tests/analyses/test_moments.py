"""Moments against arms whose moments are known: closed forms, quadrature, and plain sampling."""

import json
import math
import re
import tracemalloc

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.moments.moments import Measured, deviations, moments, table
from precision_pin.analyses.moments.moments_control import Control
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.robot import examples
from support.plain_robot import chain_of, joint, link, robot
from support.refusals import check_refused

SAMPLED = ("control", "sobol", "sobol-control", "plain")
LENGTHS = (0.7, 0.4, 0.3)
SLACK = 2e-16
"""Rounding of errors of a metre."""


def stretched(count, kind="revolute", axis=(0, 0, 1)):
    """Return a chain along x of ``joint1`` and so on, `LENGTHS` apart."""
    names = ["base", *(f"link{k}" for k in range(1, count + 1)), "tool"]
    parts = [link(name) for name in names]
    for k, (x, own) in enumerate(zip([0.0, *LENGTHS[:count]], [kind] * count + ["fixed"], strict=True)):
        parts.append(joint(f"joint{k + 1}", own, names[k], names[k + 1], (x, 0, 0), axis=axis))
    return chain_of(robot(*parts), tip="tool")


def arm(*draws, correlations=(), kind="revolute"):
    """Return a stretched arm along x; joint k turns about z (or slides along x) by component k of the draws."""
    space = pp.Space(draws, correlations)
    offsets = [pp.sources.JointOffset(joint=f"joint{k + 1}", offset=name) for k, name in enumerate(space.components)]
    chain = stretched(space.size, kind, (0, 0, 1) if kind == "revolute" else (1, 0, 0))
    return pp.ErrorModel(chain, space, offsets, {"rest": np.zeros(space.size)})


def errors_of(angles):
    """Return the exact errors ``(6, N)`` of the arm that turns, by the textbook, for angles ``(1 to 3, N)``."""
    turned = np.cumsum(angles, axis=0)
    lengths = np.array(LENGTHS[: len(angles)])[:, None]
    result = np.zeros((6, angles.shape[1]))
    result[0] = (lengths * (np.cos(turned) - 1)).sum(axis=0)
    result[1] = (lengths * np.sin(turned)).sum(axis=0)
    result[5] = turned[-1]
    return result


def weighted(errors, weights):
    """Return mean and covariance of errors with weights."""
    mean = errors @ weights
    return mean, (errors * weights) @ errors.T - np.outer(mean, mean)


def pairs(first, second):
    """Return the nodes ``(2, N)`` and weights of two independent numbers."""
    x, y = np.meshgrid(first[0], second[0], indexing="ij")
    return np.stack([x.ravel(), y.ravel()]), np.outer(first[1], second[1]).ravel()


def polar(radii, weights):
    """Return nodes ``(2, N)`` of points whose direction is uniform."""
    angles = np.arange(32) * 2 * np.pi / 32
    points = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)])[:, None]
    return points.reshape(2, -1), np.repeat(weights / 32, 32)


def covered(found, truth):
    return np.abs(found.value - truth) <= found.half_width + SLACK


def estimates(pose):
    return [pose.mean, pose.covariance, pose.norm_mean, pose.norm_variance]


# --- one joint, norms too ---
def one_joint(law, spread):
    """Return mean, covariance, mean and variance of the norms for an angle that is normal(σ) or uniform(±a), by quadrature."""
    x, weights = np.polynomial.legendre.leggauss(80)
    z = (x + 1) / 2 * (9 if law == "normal" else 1)  # one side: the norms have a kink in the middle
    weights = weights * (9 / 2 * stats.norm.pdf(z) if law == "normal" else 1 / 4)
    errors, weights = errors_of(spread * np.concatenate([z, -z])[None]), np.tile(weights, 2)
    norms = np.linalg.norm(errors.reshape(2, 3, -1), axis=1)
    return *weighted(errors, weights), norms @ weights, norms**2 @ weights - (norms @ weights) ** 2


def one_joint_arm(law, spread):
    return arm(pp.Draw("a", pp.Normal(spread) if law == "normal" else pp.Uniform(spread)))


@pytest.mark.parametrize("law", ["normal", "uniform"])
@pytest.mark.parametrize("method", SAMPLED)
def test_one_joint_by_hand(method, law):
    found = moments(one_joint_arm(law, 0.2), method=method, samples=16 * 1024, seed=1, confidence=0.9999).poses[0]
    # a net over one normal number has all of the error of a fourth power in its two outermost points
    beyond = np.isnan(found.covariance.value)
    is_rare = method == "sobol-control" and law == "normal"
    assert not beyond.any() or (is_rare and np.argwhere(beyond).tolist() == [[0, 0]])
    for estimate, truth in zip(estimates(found), one_joint(law, 0.2), strict=True):
        assert (covered(estimate, truth) | np.isnan(estimate.value)).all()
        if (method, law) == ("control", "uniform"):
            # Student's factor of 31 degrees of freedom, a tenth wider; skewed ones are wider still
            factor = 1.1 * stats.t.ppf(0.99995, 31) * estimate.standard_error
            assert (estimate.half_width >= factor * (1 - 1e-5)).all()
            assert (estimate.half_width <= 1.5 * factor).all()
    assert found.mean.half_width[0] < 1e-3
    np.testing.assert_array_equal(found.covariance.value, found.covariance.value.T)


@pytest.mark.parametrize("method", ["sobol", "plain"])
def test_an_angle_whose_farthest_tail_is_more_than_half_a_turn(method):
    """σ = 0.45 rad: of 1e11 robots one is turned by half a turn."""
    found = moments(one_joint_arm("normal", 0.45), method=method, samples=16 * 1024, seed=1, confidence=0.999).poses[0]
    for estimate, truth in zip(estimates(found), one_joint("normal", 0.45), strict=True):
        assert covered(estimate, truth).all()
    with pytest.raises(pp.InputError, match="an error rotates a frame by 180°"):
        moments(one_joint_arm("normal", 1.5), method=method, samples=16 * 1024)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["sobol", "plain"])
def test_more_samples_resolve_the_variance_of_a_lognormal_slide(method):
    """A standard deviation of half of the mean of 2 mm: the variance is 1 mm²."""
    model, known = arm(pp.Draw("a", pp.Lognormal(1e-3, 2e-3)), kind="prismatic"), []
    for samples in 2 ** np.arange(10, 17):
        found = moments(model, method=method, samples=int(samples)).poses[0]
        known.append(bool(np.isfinite(found.covariance.value[0, 0])))
        assert not known[-1] or abs(found.covariance.value[0, 0] - 1e-6) <= found.covariance.half_width[0, 0]
    assert known == sorted(known)
    assert known[-2:] == [True, True]


def test_the_remainder_of_the_closed_form_is_the_last_order_taken():
    """The mean cosine is 1 - σ²/2 + σ⁴/8 …, the variance of the sine σ² - σ⁴ …; that of the cosine begins with σ⁴/2."""
    found, length = moments(one_joint_arm("normal", 0.1), method="closed").poses[0], LENGTHS[0]
    assert found.covariance.value[0, 0] == pytest.approx(length**2 * 0.1**4 / 2, rel=1e-4)
    assert found.remainder.last_mean[0] == pytest.approx(length * 0.1**4 / 8, rel=0.02)
    assert found.remainder.last_covariance[1, 1] == pytest.approx(-(length**2) * 0.1**4, rel=0.02)
    assert (found.norm_mean, found.norm_variance, found.mean.standard_error) == (None, None, None)


# --- two joints, moments by quadrature ---


def _cases(s):
    """Return draws, correlations, nodes of quadrature and the order that the closed form leaves out, by name."""
    normal, uniform = (s * Z, GAUSS_NORMAL), (0.3 + s * GAUSS[0], GAUSS[1] / 2)
    radii = (GAUSS[0] + 1) / 2
    globe = np.repeat(GAUSS[0], 32), *polar(np.sqrt(1 - GAUSS[0] ** 2), GAUSS[1] / 2)
    z, weights = pairs((Z, GAUSS_NORMAL), (Z, GAUSS_NORMAL))
    mixed = s * np.linalg.cholesky(MATRIX) @ z, weights
    skewed = np.array([-s / 2, 2 * s]), np.array([0.8, 0.2])
    two = (pp.Draw("a", pp.Normal(s)), pp.Draw("b", pp.Normal(2 * s)))
    odd = (pp.Draw("a", pp.TwoPoint(1.25 * s, 0.75 * s, probability=0.2)), pp.Draw("b", pp.Normal(s, 0.2)))
    return {
        "independent": ((two[0], pp.Draw("b", pp.Uniform(s, 0.3))), (), pairs(normal, uniform), 6),
        "disc": ((pp.Draw("p", pp.Disc(s)),), (), polar(s * radii, radii * GAUSS[1]), 6),
        "circle": ((pp.Draw("p", pp.Circle(s)),), (), polar(np.array([s]), np.ones(1)), 6),
        "sphere": ((pp.Draw("p", pp.Sphere(s)),), (), (s * np.vstack(globe[:2]), globe[2]), 6),
        "joint normal": ((pp.Draw("p", pp.JointNormal(MATRIX * s**2)),), (), mixed, 6),
        "correlated normal": (two, (pp.Correlation(("a", "b"), ((1, 0.6), (0.6, 1))),), mixed, 6),
        "skewed": (odd, (), pairs(skewed, (0.2 + normal[0], GAUSS_NORMAL)), 5),
    }


MATRIX = np.array([[1, 1.2], [1.2, 4]])
GAUSS = np.polynomial.legendre.leggauss(24)
Z, GAUSS_NORMAL = np.polynomial.hermite_e.hermegauss(40)
GAUSS_NORMAL = GAUSS_NORMAL / GAUSS_NORMAL.sum()
CASES = list(_cases(1.0))


def case(name, spread):
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


def test_correlated_draws_that_are_not_normal():
    """A copula of uniform laws: the mean's second order from the known covariance."""
    draws = (pp.Draw("a", pp.Uniform(0.02)), pp.Draw("b", pp.Uniform(0.02)))
    model = arm(*draws, correlations=(pp.Correlation(("a", "b"), ((1, 0.7), (0.7, 1))),))
    variance = 0.02**2 / 3
    sum_variance = 2 * variance * (1 + 6 / math.pi * math.asin(0.35))
    closed = moments(model, method="closed").poses[0]
    assert (closed.remainder.order, closed.remainder.last_covariance) == (2, None)
    second = -(LENGTHS[0] * variance + LENGTHS[1] * sum_variance) / 2
    assert closed.mean.value[0] == pytest.approx(second, rel=1e-6)
    assert closed.covariance.value[5, 5] == pytest.approx(sum_variance, rel=1e-9)


# --- intervals ---


@pytest.mark.slow
def test_control_and_sobol_are_narrower_than_plain_sampling():
    """At 0.02 rad what tangent and products leave, of third order, is σ² √15/6 and so some 1e-3 of the first order."""
    model, errors = arm(pp.Draw("a", pp.Normal(0.02)), pp.Draw("b", pp.Normal(0.02))), {}
    for method in SAMPLED:
        mean, covariance, norm, _ = estimates(moments(model, "rest", samples=65_536, method=method).poses[0])
        y, x = [(mean.standard_error[k], covariance.standard_error[k, k]) for k in (1, 0)]
        errors[method] = np.array([*y, *x, norm.standard_error[0]])
    # of x, 1 - cos, the tangent contains neither mean nor variance
    for method in ("control", "sobol-control"):
        assert (errors[method] < errors["plain"] / [300, 300, 100, 100, 2]).all()
    assert errors["sobol"][0] < errors["plain"][0] / 10


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
    model = arm(pp.Draw("a", pp.Uniform(3e-3, 1e-3)), pp.Draw("b", pp.Triangular(6e-3)), kind="prismatic")
    found = moments(model, method=method, samples=1024).poses[0]
    assert found.mean.value[0] == pytest.approx(1e-3, rel=1e-12)
    assert found.covariance.value[0, 0] == pytest.approx(9e-6 / 3 + 36e-6 / 6, rel=1e-12)
    assert found.mean.half_width.max() < 1e-17
    assert found.covariance.half_width.max() < 1e-19
    closed = moments(model, method="closed").poses[0]
    np.testing.assert_allclose(closed.mean.value, found.mean.value, atol=1e-16)
    np.testing.assert_allclose(closed.covariance.value, found.covariance.value, atol=1e-18)
    # where nothing is random the error is the moment, and without a source nothing is
    still, bare = arm(pp.Draw("a", pp.Fixed(0.1))), pp.ErrorModel(model.chain, pp.Space(), [], {"rest": [0.0, 0.0]})
    for one in (method, "plain", "closed"):
        found = moments(still, method=one, samples=1024).poses[0]
        np.testing.assert_allclose(found.mean.value, errors_of(np.array([[0.1]]))[:, 0], atol=1e-15)
        np.testing.assert_allclose(found.covariance.value, 0, atol=1e-18)
        found = moments(bare, method=one, samples=1024).poses[0]
        assert not found.mean.value.any()
        assert not found.covariance.value.any()


# --- the paper's arm ---
@pytest.fixture(scope="module")
def paper():
    return pp.ErrorModel.load(examples.PAPER_SHEET)


def test_plain_sampling_is_that_of_monte_carlo(paper):
    sampled = pp.monte_carlo(paper, samples=16_384, seed=5)
    found = moments(paper, method="plain", samples=16_384, seed=5).poses[0]
    np.testing.assert_allclose(found.mean.value, sampled.summary.mean, rtol=1e-9, atol=1e-15)
    # unbiased both, but for how the products of means are averaged: 1/N of the covariance
    scale = np.sqrt(np.outer(*[np.diag(sampled.covariance)] * 2))
    assert (np.abs(found.covariance.value - sampled.covariance) / scale).max() < 1e-2 / math.sqrt(16_384)
    assert found.norm_mean.value[0] == pytest.approx(sampled.position.norm.mean, rel=1e-12)
    assert found.norm_std.value[1] == pytest.approx(sampled.attitude.norm.std, rel=1e-3)


@pytest.mark.parametrize("method", ["control", "closed"])
def test_result_as_json_table_and_page(paper, method):
    found, is_closed = moments(paper, samples=1024, method=method), method == "closed"
    read = json.loads(found.to_json())
    (pose,) = read["poses"]
    assert (read["samples"], np.shape(pose["covariance"]["value"])) == (0 if is_closed else 1024, (6, 6))
    assert (pose["remainder"] is None, pose["norm_mean"] is None) == (not is_closed, is_closed)
    frame = found.to_pandas()
    assert list(frame.columns) == ["mean", "mean_lower", "mean_upper", "std", "std_lower", "std_upper"]
    row = frame.loc[("paper", "position.z")]
    expected = pose["mean"]["value"][2], pose["covariance"]["value"][2][2]
    assert (row["mean"], row["std"] ** 2) == pytest.approx(expected)
    missing = [row["mean_lower"], frame.loc[("paper", "position.norm"), "mean"]]
    assert np.isnan(missing).tolist() == [is_closed] * 2
    shown = found._repr_html_().split("<table>")[1].split("</table>")[0]
    assert ("|d|" in shown, "±" in shown) == (True, not is_closed)
    assert method in repr(found)


def test_what_too_few_points_resolve_is_a_dash_and_null():
    rare = pp.Draw("turn", pp.Empirical([[0.0, 0.0], [0.99999, 0.0], [1.0, 0.01]]))
    result = moments(arm(rare), samples=1024, method="sobol")
    assert "nan" not in str(table(result)) + result._repr_html_()
    assert re.search(r"^dy +mm +- +- +- +-$", table(result), re.MULTILINE)
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["poses"][0]["mean"]["value"][1] is None


def test_deviations_of_variances():
    """The interval reaches to the farther of the roots of the variance's ends, √3.8 of 4 ± 0.2; a root has no sign."""
    found = deviations(Measured(np.array([4.0, 1.0, -1.0]), np.array([0.1, 1.0, 1.0]), np.array([0.2, 3.0, 5.0])))
    np.testing.assert_allclose(found.value, [2, 1, 0])
    np.testing.assert_allclose(found.half_width, [2 - math.sqrt(3.8), 1, 2])


def test_wrong_settings_are_refused(paper):
    for says, settings in (
        ("number of samples must be a whole number from 1 to 16777216", {"samples": 2**25}),
        ("number of samples must be a whole number from 1 to 16777216", {"samples": 0}),
        ("confidence must be above 0 and below 1, got 1.0", {"confidence": 1.0}),
        (r"'sobol_control'; did you mean 'sobol-control'", {"method": "sobol_control"}),
    ):
        check_refused((says, moments, paper), **settings)


@pytest.mark.parametrize("analysis", [moments, pp.budget])
def test_numbers_of_samples_are_rounded_up_and_said(analysis):
    """32 replicates, each of 32 samples or of another power of two."""
    model = arm(pp.Draw("a", pp.Normal(1e-3)))
    for samples, rounded in ((1, 1024), (1025, 2048)):
        with pytest.warns(PrecisionPinWarning, match="rounded up") as issued:
            result = analysis(model, samples=samples)
        (line,) = [str(warning.message) for warning in issued]
        assert (
            line
            == f"precision-pin: warning W_SAMPLES: {samples:,} samples are rounded up to {rounded:,}: 32 times a power of two"
        )
        assert line in result.warnings
        expected = analysis(model, samples=rounded)
        assert result.samples == expected.samples == rounded
        assert result.to_dict() | {"warnings": []} == expected.to_dict()


def test_draws_too_wide_for_a_closed_form():
    assert moments(arm(pp.Draw("a", pp.Normal(2.0))), method="closed").poses[0].remainder.order == 4
    with pytest.raises(pp.InputError, match="one standard deviation from the means the exact error does not exist"):
        moments(arm(pp.Draw("a", pp.Normal(3.2))), method="closed")


@pytest.mark.slow
def test_memory_does_not_grow_with_the_samples(paper):
    def peak(samples):
        tracemalloc.start()
        moments(paper, method="sobol-control", samples=samples)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    moments(paper, method="sobol-control", samples=16 * 64)
    assert peak(16 * 8192) < 1.2 * peak(16 * 64)
