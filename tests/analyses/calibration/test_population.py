"""Variance components against planted ones, a general maximiser, and the formula of one number."""

import json

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, random_poses
from precision_pin.analyses.calibration import population
from precision_pin.analyses.calibration.population import Evidence, variance_components
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.readings import simulate_readings, stations_of
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import JointOffset, Length
from support.refusals import check_refused

TRACKER = pp.Measurement(std=50e-6, target=OFF_AXIS)


PLANTED = {"joint_offset[joint2].offset": 1.8, "joint_offset[joint3].offset": 0.5, "length[joint4].parameters": 1.0}


def model_of(factors):
    stds = zip(PLANTED, (1e-3, 1e-3, 3e-4), strict=True)
    laws = {name: pp.Normal(std * factors.get(name, 1.0)) for name, std in stds}
    first, second, third = laws.values()
    sources = [JointOffset(joint="joint2", offset=first), JointOffset(joint="joint3", offset=second)]
    sources.append(Length(joint="joint4", along="link", parameters=(third,)))
    return pp.ErrorModel(paper_model().chain, pp.Space(), sources, {"work": [0.2, -0.4, 0.9, 0.3]})


def robots_of(count, poses=6, real=None):
    """Return readings of robots whose tolerances are others than the sheet's, or of a model."""
    real, q = real or model_of(PLANTED), random_poses(4, poses)
    readings = simulate_readings(stations_of(real, q, TRACKER), TRACKER, real, robots=count, seed=0)
    return [(q, readings[:, :, k]) for k in range(count)]


@pytest.mark.slow
def test_planted_tolerances_are_recovered():
    """16 robots by the exact model: each planted factor within its interval, and the sheet's refuted where it is wrong."""
    found = pp.population(model_of({}), robots_of(16, poses=4), TRACKER)
    by_name = {one.names[0]: one for one in found.tolerances}
    assert set(by_name) == set(PLANTED)
    # as wide as an interval of a variance from 16 numbers, whose readings are nearly exact
    wide = np.sqrt(stats.chi2.ppf(0.975, 16) / stats.chi2.ppf(0.025, 16))
    for name, factor in PLANTED.items():
        assert by_name[name].low <= factor <= by_name[name].high
        assert by_name[name].high / by_name[name].low == pytest.approx(wide, rel=0.15)
    assert [by_name[name].agrees for name in PLANTED] == [False, False, True]
    assert found.log_likelihood_ratio > stats.chi2.ppf(0.999, 3)
    assert "W_OTHER_TOLERANCE" in {finding.code for finding in found.findings}
    # two offsets of one joint: only their joint tolerance shows
    joints = (("joint2", 1e-3), ("joint2", 2e-3), ("joint3", 1e-3))
    twice = [JointOffset(joint=name, offset=pp.Normal(std)) for name, std in joints]
    alike = pp.ErrorModel(paper_model().chain, pp.Space(), twice)
    (group,) = pp.population(alike, robots_of(3, 4, alike), TRACKER).groups
    assert set(group.names) == {name for name in alike.space.components if "joint2" in name}


@pytest.mark.slow
def test_calibrations_say_what_their_readings_say(tmp_path):
    """From posterior less prior the same as from the readings; the calibrated numbers themselves are no sample of the law.

    One without prior, and one with a number at the bound of its law, are fitted again.
    """
    model, robots = model_of({}), robots_of(4, poses=3)
    coarse = pp.Measurement(std=2e-3, target=OFF_AXIS)
    results = [pp.calibrate(model, robot, coarse, at=["work"]) for robot in robots]
    one, other = pp.population(model, robots, coarse), pp.population(model, results)
    expected = [each.scale for each in one.tolerances]
    np.testing.assert_allclose([each.scale for each in other.tolerances], expected, rtol=1e-3, atol=1e-3)
    spread = np.std([list(each.posterior.mean.values()) for each in results], axis=0)
    assert (spread / list(results[0].posterior.prior_std.values()) < 0.8 * np.array(expected)).any()
    without = pp.calibrate(model, robots[0], coarse, prior=False)
    (tmp_path / "b.json").write_text(json.dumps(json.loads(results[1].to_json()) | {"at_bounds": ["any"]}))
    again = pp.population(model, [without, tmp_path / "b.json", *robots[2:]], coarse)
    np.testing.assert_allclose([each.scale for each in again.tolerances], expected, rtol=1e-9)
    with pytest.raises(pp.InputError, match=r"b\.json: .* were measured in another way"):
        pp.population(model, [tmp_path / "b.json", without], pp.Measurement())


@pytest.mark.parametrize("has_means", [False, True])
def test_the_likelihood_is_that_of_normal_readings(has_means):
    """Written down with the covariance of all readings of all robots, and maximised without derivatives."""
    generator, truth = np.random.default_rng(3), np.array([0.6, 1.7])
    slopes = generator.normal(size=(5, 6, 2)) * 2
    y = np.einsum("rij,rj->ri", slopes, 0.4 + truth * generator.normal(size=(5, 2))) + generator.normal(size=(5, 6))
    evidence = Evidence(np.einsum("rki,rkj->rij", slopes, slopes), np.einsum("rki,rk->ri", slopes, y))
    found = variance_components(evidence, np.eye(2)[:, :, None] * np.eye(2), has_means=has_means)

    def loss(scales):
        covariances = [np.eye(6) + (h * scales**2) @ h.T for h in slopes]
        value, residuals = 0.0, list(y)
        if has_means:
            total = sum(h.T @ np.linalg.solve(c, h) for h, c in zip(slopes, covariances, strict=True))
            pull = sum(h.T @ np.linalg.solve(c, r) for h, c, r in zip(slopes, covariances, y, strict=True))
            mean = np.linalg.solve(total, pull)
            residuals = [r - h @ mean for h, r in zip(slopes, y, strict=True)]
            value += np.linalg.slogdet(total)[1]
        for c, r in zip(covariances, residuals, strict=True):
            value += np.linalg.slogdet(c)[1] + r @ np.linalg.solve(c, r)
        return float(value)

    best = optimize.minimize(loss, np.ones(2), method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12})
    np.testing.assert_allclose(found.scale, np.abs(best.x), rtol=1e-5)
    assert found.log_likelihood - found.at_sheet == pytest.approx((loss(np.ones(2)) - best.fun) / 2, rel=1e-7)
    # the profile likelihood of the first scale at the ends of its interval
    for end in (found.low[0], found.high[0]):
        profile = optimize.minimize_scalar(lambda s, end=end: loss(np.array([end, s])), bounds=(0, 20))
        assert profile.fun - best.fun == pytest.approx(stats.chi2.ppf(0.95, 1), rel=5e-3)


@pytest.mark.slow
def test_intervals_cover_what_they_say():
    """8 sets of 12 robots with three numbers: 95 % of 24 intervals, within three standard deviations of that count."""
    generator, truth, inside = np.random.default_rng(5), np.array([0.5, 1.3, 2.0]), 0
    for _ in range(8):
        slopes = generator.normal(size=(12, 8, 3)) * np.linspace(1.0, 3.0, 3)
        y = np.einsum("rij,rj->ri", slopes, truth * generator.normal(size=(12, 3))) + generator.normal(size=(12, 8))
        evidence = Evidence(np.einsum("rki,rkj->rij", slopes, slopes), np.einsum("rki,rk->ri", slopes, y))
        found = variance_components(evidence, np.eye(3)[:, :, None] * np.eye(3))
        inside += int(((found.low <= truth) & (truth <= found.high)).sum())
    assert abs(inside / 24 - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 24)


def test_means_are_found_and_cost_a_degree_of_freedom():
    """One number read with a variance of 1e-4: the textbooks' variances less that, about the known mean and the sample's."""
    values = np.random.default_rng(1).normal(0.7, 1.4, 9)
    precise = 1e4
    evidence = Evidence(np.full((9, 1, 1), precise), (precise * values)[:, None])
    known, estimated = (variance_components(evidence, np.ones((1, 1, 1)), has_means=has) for has in (False, True))
    assert known.scale[0] == pytest.approx(np.sqrt((values**2).mean() - 1 / precise), rel=1e-5)
    assert estimated.scale[0] == pytest.approx(np.sqrt(values.var(ddof=1) - 1 / precise), rel=1e-5)
    assert estimated.means[0] == pytest.approx(values.mean(), rel=1e-5)


def test_widths_of_a_sheet_are_multiplied_in_every_spelling(tmp_path):
    """By hand: 0.02° × 1.5, ±0.3 mm × 0.5, entries of lists; what has no upper limit is kept."""
    file = tmp_path / "arm.errors.yaml"
    file.write_text(
        f"precision-pin: 1\nrobot: {PAPER_SHEET.with_name('4dof.urdf')}\ntip: tool\nposes: {{work: 10 20 30 40 deg}}\nsources:\n"
        "  - joint_offset: {joint: joint2, offset: {normal: {std: 0.02 deg}}}\n"
        "  - joint_offset: {joint: joint3, offset: {normal: 0.06 deg}}\n"
        "  - length: {joint: joint4, along: link, parameters: ±0.3 mm}\n"
        "  - joint_offset: {joint: joint4, offset: {normal: {std: 0.05 deg}}}\n"
        "  - length: {joint: joint3, along: link, parameters: [{uniform: 0.2 mm}, ±0.1 mm]}\n"
        "  - length: {joint: joint2, along: link, parameters: [±0.4 mm]}\n"
    )
    model = pp.ErrorModel.load(file)
    names = list(model.space.components)
    factors = zip(names, (1.5, 2.0, 0.5, 3.0, 2.0, 5.0, 0.25), (2.0, 3.0, 1.0, np.inf, 3.0, 6.0, 1.0), strict=True)
    measured = population.MeasuredTolerance
    tolerances = tuple(measured((one,), (one,), scale, 0.1, high, 1.0, (0.0,)) for one, scale, high in factors)
    of = Provenance.of(model, 0)
    found = population.Population(
        provenance=of, robots=3, means="sheet", confidence=0.95, tolerances=tolerances, unseen=(), groups=(),
        log_likelihood_ratio=0.0, model=model, findings=(),
    )  # fmt: skip
    file.write_text(population.population_sheet(found, tmp_path))
    text = file.read_text()
    assert "std: 0.03 deg" in text
    std = np.sqrt(np.diag(pp.ErrorModel.load(file).space.covariance))
    widths = np.array([0.15e-3, 0.4e-3, 0.5e-3, 0.1e-3]) / np.sqrt(3)
    expected = [np.radians(0.03), np.radians(0.12 / 3), widths[0], np.radians(0.05), *widths[1:]]
    np.testing.assert_allclose(std, expected, rtol=1e-12)


@pytest.mark.slow
def test_misuse_is_refused_in_one_line(tmp_path):
    model, (robot, _) = model_of({}), robots_of(2, poses=3)
    result = pp.calibrate(model, robot, TRACKER)
    (tmp_path / "a.json").write_text(json.dumps({"schema": "other"}))
    other = model_of({"joint_offset[joint2].offset": 2.0})
    for wrong, message in (
        ([robot], "at least two robots"),
        ([result, tmp_path / "a.json"], "is no result of calibrate"),
        ([result, tmp_path / "b.json"], "b.json does not exist"),
        ([pp.calibrate(other, robot, TRACKER), result], "its prior is not that of this sheet"),
    ):
        check_refused((message, pp.population, model, wrong, TRACKER))
