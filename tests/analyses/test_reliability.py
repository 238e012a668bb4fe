"""Reliability against reference case R6, closed forms and laws known exactly, down to 1e-7."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.reliability.estimates import Estimate
from precision_pin.analyses.reliability.figure import figure
from precision_pin.analyses.reliability.form import form
from precision_pin.analyses.reliability.importance import importance_sampling, subset_simulation
from precision_pin.analyses.reliability.reliability import reliability
from precision_pin.analyses.reliability.strata import from_normals
from precision_pin.analyses.reliability.table import table
from precision_pin.cli import main
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.statistics import Specification
from support.sheets import slides

TAIL = -stats.norm.ppf(1e-7)


# --- reference case R6 ---


def test_r6_capacity_minus_load():
    found = form(lambda u: (200 + 20 * u[0]) - (150 + 10 * u[1]), 2, [np.zeros(2), np.ones(2)])
    assert len(found.points) == 1
    point = found.points[0]
    assert point.beta == pytest.approx(2.236068, abs=5e-7)
    assert point.probability == pytest.approx(0.012674, abs=5e-7)
    np.testing.assert_allclose(point.u, [-2, 1], atol=1e-6)
    np.testing.assert_allclose(point.importance, [0.8, 0.2], atol=1e-6)


def test_r6_cantilever():
    def margin(u):
        modulus, force, length, section = 50 + u[0], 1 + u[1], 10 + u[2], 5 + u[3]
        return 3 - force * length**3 / (3 * modulus * section)

    found = form(margin, 4, [np.zeros(4), *(np.eye(4) / 2)])
    assert found.points[0].beta == pytest.approx(1.009255, abs=5e-7)
    assert found.probability == pytest.approx(0.156426, abs=5e-7)
    np.testing.assert_allclose(margin(found.points[0].u), 0, atol=1e-6)


@pytest.mark.slow
def test_r6_capacity_minus_load_as_an_arm():
    """Error x = load - capacity, shifted so that |x| ≤ limit is what fails first: the same β through the whole analysis."""
    model = slides([(1, 0, 0), (-1, 0, 0)], [laws.Normal(0.010, 0.150), laws.Normal(0.020, 0.200)])
    # x = load - capacity has the mean -0.05; |x| above 0.1 is the mirror image, β = 0.05/√(0.01² + 0.02²)
    found = reliability(model, [pp.specification("x 100 mm @ 90 %")], samples=50_000).poses[0].specifications[0]
    assert found.failures[0].beta == pytest.approx(2.236068, abs=5e-7)
    assert found.resolved
    exact = stats.norm.sf(math.sqrt(5)) + stats.norm.sf(3 * math.sqrt(5))
    assert all(e.interval[0] <= exact <= e.interval[1] for e in found.estimates)
    assert found.disagreements == ()
    assert list(found.failures[0].importance.values()) == pytest.approx([0.8, 0.2], abs=1e-6)
    assert found.met


# --- rare events ---


@pytest.mark.parametrize("size", [1, 2, 28])
def test_a_tail_of_one_in_ten_million(size):
    weights = np.ones(size) / math.sqrt(size)

    def margin(u):
        return TAIL - weights @ u

    found = form(margin, size, [np.zeros(size)])
    assert found.probability == pytest.approx(1e-7, rel=1e-6)
    shifted = importance_sampling(margin, size, found.points, seed=1, samples=20_000, confidence=0.999)
    subset = subset_simulation(margin, size, seed=1, samples=2000, confidence=0.999)
    assert (margin(subset.failures) < 0).all()
    for estimate, largest in ((shifted, 0.03), (subset.estimate, 0.3)):
        assert estimate.resolved
        assert estimate.interval[0] <= 1e-7 <= estimate.interval[1]
        assert estimate.variation < largest


def test_failure_on_all_sides_at_one_in_ten_million():
    radius = stats.chi(3).isf(1e-7)

    def margin(u):
        return radius - np.sqrt((u**2).sum(axis=0))

    starts = list(np.random.default_rng(0).normal(size=(20, 3)))
    found = form(margin, 3, starts)
    assert len(found.points) == 20  # every direction is one: nothing is lumped together, and FORM is far off
    assert found.points[0].beta == pytest.approx(radius, rel=1e-6)
    assert found.points[0].probability < 1e-7 / 5
    subset = subset_simulation(margin, 3, seed=2, samples=2000, confidence=0.999).estimate
    assert subset.interval[0] <= 1e-7 <= subset.interval[1]
    shifted = importance_sampling(margin, 3, found.points, seed=2, samples=20_000, confidence=0.999)
    assert shifted.interval[0] <= 1e-7 <= shifted.interval[1]


@pytest.mark.slow
def test_coverage_of_the_intervals():
    """Of 60 seeds at 95 %, at least 51 intervals hold the truth (fewer: probability 1e-3 for a true 95 %)."""

    def margin(u):
        return TAIL - u[0]

    points = form(margin, 4, [np.zeros(4)]).points
    subset = [subset_simulation(margin, 4, seed=s, samples=2000, confidence=0.95).estimate.interval for s in range(60)]
    shifted = [
        importance_sampling(margin, 4, points, seed=s, samples=5000, confidence=0.95).interval for s in range(60)
    ]
    for intervals in (subset, shifted):
        assert sum(low <= 1e-7 <= high for low, high in intervals) >= 51


@pytest.mark.slow
def test_uniform_numbers_in_the_far_tail():
    """Six uniform numbers, Irwin-Hall: |x| above 5 of 6 half-widths are two corners of the cube, 2·0.5⁶/6!."""
    half = 1e-3
    model = slides([(1, 0, 0)] * 6, [laws.Uniform(half)] * 6)
    limit = 5.0 * half  # one half-width, half a width, from the corner
    exact = 2 * 0.5**6 / math.factorial(6)
    found = (
        reliability(model, [Specification("position.x", limit, 0.999)], samples=20_000, confidence=0.999)
        .poses[0]
        .specifications[0]
    )
    rare = [estimate for estimate in found.estimates if estimate.method != "sampling"]
    assert len(rare) == 2
    for estimate in rare:
        assert estimate.resolved
        assert estimate.interval[0] <= exact <= estimate.interval[1]
    assert found.resolved
    assert len(found.form.points) == 2
    assert found.best.method != "sampling"
    assert found.disagreements
    assert "FORM" in found.disagreements[0]


def test_the_norm_of_an_isotropic_cloud():
    """Reference case R6: 99.73 % of an isotropic normal cloud lies within 3.762480 σ."""
    sigma = 1e-4
    model = slides([(1, 0, 0), (0, 1, 0), (0, 0, 1)], [laws.Normal(sigma)] * 3)
    demand = Specification("position.norm", 3.762480 * sigma, 0.99)
    found = reliability(model, [demand], confidence=0.999).poses[0].specifications[0]
    assert len(found.form.points) == found.form.starts >= 26
    for estimate in found.estimates:
        assert estimate.interval[0] <= 0.0027 <= estimate.interval[1]
    assert found.met
    assert found.interval[0] < 0.9973 < found.interval[1]


def test_nothing_found_is_said():
    model = slides([(1, 0, 0)], [laws.Uniform(1e-3)])
    result = reliability(model, [Specification("position.x", 2e-3, 0.95)], samples=1000)
    found = result.poses[0].specifications[0]
    assert not found.resolved
    assert found.best.method == "sampling"
    assert found.best.interval == (0.0, pytest.approx(1 - 0.025 ** (1 / 1000), rel=1e-9))
    assert found.form.points == ()
    assert found.met  # the interval of the samples is enough for 95 %
    # a verdict that is met comes with no alarm; what it rests on is said
    text = table(result)
    assert "MET - P(failure) below 0.00369 by sampling" in text
    assert "NOT" not in text
    assert "the verdict rests on 0 failures among 1,000 samples alone" in text
    assert figure(result).axes
    stricter = replace(found, specification=Specification("position.x", 2e-3, 0.9999))
    assert not stricter.met
    pose = replace(result.poses[0], specifications=(stricter,))
    assert "UNDECIDED - P(failure) not resolved, below 0.00369" in table(replace(result, poses=(pose,)))


def test_what_methods_differ_in_begins_with_what_it_means_for_the_verdict():
    model = slides([(1, 0, 0)], [laws.Uniform(1e-3)])
    result = reliability(model, [Specification("position.x", 2e-3, 0.95)], samples=1000)
    found = result.poses[0].specifications[0]

    def written(*estimates: Estimate) -> str:
        line = "one and another disagree"
        entry = replace(found, estimates=estimates, best=estimates[0], resolved=True, reason="", contradictions=(line,))
        return table(replace(result, poses=(replace(result.poses[0], specifications=(entry,)),)))

    def estimate(method: str, low: float, high: float) -> Estimate:
        return Estimate(method, (low + high) / 2, (low, high), 0.01, 1000, True)

    # 5 % may fail: both intervals lie below it, then one to either side
    text = written(estimate("sampling", 0.010, 0.012), estimate("subset simulation", 0.02, 0.03))
    assert "MET" in text.splitlines()[3]
    assert text.endswith("note: the verdict is the same by every method; one and another disagree")
    text = written(estimate("sampling", 0.010, 0.012), estimate("subset simulation", 0.06, 0.07))
    assert (
        "note: the verdict differs between the methods; the samples' interval, which is always valid, decides;" in text
    )
    assert "DISAGREE" not in text


def test_limits_that_nearly_always_fail():
    model = slides([(1, 0, 0)], [laws.Normal(1e-3, 10e-3)])
    found = reliability(model, [Specification("position.x", 8e-3, 0.95)], samples=5000).poses[0].specifications[0]
    assert found.failures[0].beta == pytest.approx(-2, abs=1e-6)
    assert not found.met
    assert found.best.interval[0] <= stats.norm.sf(-2) <= found.best.interval[1]


# --- standard normal numbers ---


@pytest.mark.parametrize(
    "law",
    [
        laws.Uniform(1.0, 0.3), laws.Triangular(1.0), laws.Normal(0.5, 1.0), laws.TruncatedNormal(0.5, 0.0, 1.5),
        laws.Arcsine(1.0), laws.Disc(2.0), laws.Circle(2.0), laws.Lognormal(0.2, 1.0), laws.TwoPoint(1.0, 0.0, 0.3),
        laws.JointNormal(((1.0, 0.5), (0.5, 2.0))), laws.Rows(((0.0, 1.0), (2.0, -1.0), (1.0, 1.0))),
    ],
    ids=lambda law: type(law).__name__,
)  # fmt: skip
def test_from_normals_keeps_the_law(law):
    space = Space((Draw("p", law),))
    normals = np.random.default_rng(0).standard_normal((law.size, 200_000))
    x = from_normals(space, normals)
    scale = np.sqrt(np.diag(law.covariance))
    np.testing.assert_allclose(x.mean(axis=1), law.mean_vector, atol=6 * scale.max() / math.sqrt(200_000))
    np.testing.assert_allclose(np.cov(x).reshape(law.size, -1), law.covariance, atol=0.02 * scale.max() ** 2)
    for w in np.eye(law.size):
        assert (w @ x).max() <= law.support(w) + 1e-12
    far = from_normals(space, np.full((law.size, 1), 40.0))
    assert np.isfinite(far).all()
    np.testing.assert_array_equal(from_normals(space, np.zeros((law.size, 1))).shape, (law.size, 1))


def test_disc_from_normals_is_uniform_over_its_area():
    x = from_normals(Space((Draw("p", laws.Disc(2.0)),)), np.random.default_rng(1).standard_normal((2, 100_000)))
    share = (x**2).sum(axis=0) / 4
    assert stats.kstest(share, "uniform").pvalue > 1e-6
    assert stats.kstest(np.arctan2(x[1], x[0]) / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-6


@pytest.mark.slow
def test_a_circle_and_a_normal_number():
    """With x = r cos θ + σ z: P(|x| > L) = 2 · mean over θ of Φ((r cos θ - L)/σ)."""
    space = Space((Draw("c", laws.Circle(1e-3)), Draw("z", laws.Normal(1e-3))))
    model = slides([(1, 0, 0), (0, 1, 0), (1, 0, 0)], ["c.x", "c.y", "z"], space)
    demand = Specification("position.x", 5.5e-3, 0.99)
    found = reliability(model, [demand], samples=5000, confidence=0.999).poses[0].specifications[0]
    theta = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    exact = 2 * stats.norm.cdf(np.cos(theta) - 5.5).mean()
    assert found.form.points
    rare = [estimate for estimate in found.estimates if estimate.resolved]
    assert rare
    assert all(entry.interval[0] <= exact <= entry.interval[1] for entry in rare)


def test_correlated_draws_from_normals_and_in_the_importance():
    both = Correlation.pair("a", "b", 0.8)
    space = Space((Draw("a", laws.Normal(1e-3)), Draw("b", laws.Normal(1e-3))), (both,))
    x = from_normals(space, np.random.default_rng(0).standard_normal((2, 100_000)))
    assert np.corrcoef(x)[0, 1] == pytest.approx(0.8, abs=0.01)
    model = slides([(1, 0, 0), (1, 0, 0)], ["a", "b"], space)
    found = reliability(model, [Specification("position.x", 6e-3, 0.9)], samples=5000).poses[0].specifications[0]
    assert found.failures[0].beta == pytest.approx(6 / math.sqrt(2 + 2 * 0.8), rel=1e-6)
    assert found.failures[0].importance == {"a + b": pytest.approx(1.0)}


# --- the paper's arm and the command ---


@pytest.mark.slow
def test_the_papers_arm_deep_in_a_tail_against_the_exact_law():
    """P(|dx| > 18 mm): exact model by two methods beside the first-order law, which needs no sampling."""
    model = ErrorModel.load(examples.PAPER_SHEET)
    demand = Specification("position.x", 0.018, 0.99999)
    found = reliability(model, [demand], samples=20_000, confidence=0.99).poses[0].specifications[0]
    law = pp.exact_law(model, samples=1000).poses[0].laws["position.x"].law
    first_order = 1 - law.cumulative(np.array([0.018]))[0]
    assert 1e-7 < first_order < 1e-5
    assert found.resolved
    for rare in found.estimates[1:]:
        assert rare.resolved
        assert rare.interval[0] * 0.8 <= first_order <= rare.interval[1] * 1.2
    at = model.at()
    x = np.array([found.failures[0].parameters[name] for name in at.space.components])
    error = at.exact(x[:, None])[:, 0]
    assert abs(error[0]) == pytest.approx(0.018, rel=1e-6)
    np.testing.assert_allclose(found.failures[0].error, error, atol=1e-12)
    assert sum(found.failures[0].importance.values()) == pytest.approx(1.0, rel=1e-9)


def test_bad_settings():
    model = slides([(1, 0, 0)], [laws.Normal(1e-3)])
    demand = Specification("position.x", 1e-3, 0.9)
    with pytest.raises(pp.InputError, match="no specification"):
        reliability(model, [])
    for settings in ({"samples": 0}, {"confidence": 1.0}, {"seed": -1}):
        with pytest.raises(pp.InputError):
            reliability(model, [demand], **settings)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_result():
    model = slides([(1, 0, 0)], [laws.Normal(1e-3)])
    demand = [Specification("position.x", 4e-3, 0.9)]
    first, again, other = (reliability(model, demand, seed=s, samples=2000).to_json() for s in (3, 3, 4))
    assert first == again
    assert first != other


@pytest.mark.slow
def test_command(tmp_path, monkeypatch, capsys):
    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["precision-pin", "reliability", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    code, out, _ = run("--spec", "42 mm @ 99 %", "--samples", "20000", "--out", str(tmp_path / "plots"))
    assert code == 0
    assert "|d| within 42 mm for 99 %: MET" in out
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == [
        "reliability.json", "reliability.png", "reliability.svg",
    ]  # fmt: skip
    code, out, _ = run("--spec", "35 mm", "--spec", "x 20 mm", "--samples", "2000", "--json", "-")
    assert code == 1
    data = json.loads(out)
    assert data["schema"] == "precision-pin/reliability/1"
    assert [entry["met"] for entry in data["poses"][0]["spec"]] == [False, True]
    assert data["poses"][0]["spec"][0]["methods"][0]["method"] == "sampling"
    code, out, err = run()
    assert code == 2
    assert "--spec" in err
    code, _, err = run("--spec", "5 apples")
    assert code == 2
    assert "Traceback" not in err
