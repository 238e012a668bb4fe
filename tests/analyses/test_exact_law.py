"""Exact laws against closed forms, reference case R1 and R6, and samples; nothing comes from the code's own output."""

from __future__ import annotations

import itertools
import json
import math
import tracemalloc

import numpy as np
import pytest
from scipy import integrate, special, stats

import precision_pin as pp
from precision_pin.analyses.exact_law.exact_law import LEVELS, exact_law
from precision_pin.analyses.exact_law.figure import figure
from precision_pin.analyses.exact_law.number_law import ConvolvedLaw, NormalNorm, Summand, certified_series
from precision_pin.analyses.exact_law.table import table
from precision_pin.analyses.provenance import listed_poses
from precision_pin.base.errors import InputError
from precision_pin.cli import main
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws.projection import Lines
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.robot.chain import Chain
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from support.plain_robot import chain_of, joint, link, robot

MM = 1e-3
SAMPLES = 20_000
PLANE = (0.8, -0.3)


def slides(*axes: tuple[float, float, float]) -> Chain:
    """Return an arm of sliding joints: its error is the sum of its joints' errors along their axes, exactly."""
    names = ["base", *(f"link{k}" for k in range(1, len(axes))), "tool"]
    parts = [link(name) for name in names]
    for k, axis in enumerate(axes):
        parts.append(joint(f"joint{k + 1}", "prismatic", names[k], names[k + 1], axis=axis))
    return chain_of(robot(*parts), tip="tool")


def sum_along_x(*summed: laws.Law, correlations: tuple[Correlation, ...] = ()) -> ErrorModel:
    chain = slides(*[(1, 0, 0)] * len(summed))
    space = Space(tuple(Draw(f"p{k}", law) for k, law in enumerate(summed)), correlations)
    offsets = [JointOffset(joint=f"joint{k + 1}", offset=f"p{k}") for k in range(len(summed))]
    return ErrorModel(chain, space, offsets, {"rest": np.zeros(len(summed))})


def law_of_x(*summed: laws.Law):
    found = exact_law(sum_along_x(*summed), samples=SAMPLES).poses[0].laws["position.x"]
    assert found.agreement is None or found.agreement.agrees
    return found


# --- reference case R1: z_4 alone is the sum of three uniform numbers of ±0.05 mm ---


def test_r1_tails_of_three_lengths():
    chain = Chain.from_urdf(examples.PAPER_SHEET.parent / "4dof.urdf")
    space = Space(tuple(Draw(name, laws.Uniform(0.05 * MM)) for name in ("a1", "a3", "a5")))
    tool = Length(frame="tool", along="-z of joint4", parameters=("a1", "a3", "a5"))
    model = ErrorModel(chain, space, [tool], {"paper": np.radians([-90, 3, 88, -91])})
    found = exact_law(model, samples=SAMPLES).poses[0].laws["position.x"]
    assert found.contributors == 3
    assert found.error < 1e-12
    for limit, outside in ((0.10, 1 / 24), (0.14, 1 / 3000)):
        ends = found.law.cumulative(np.array([-limit, limit]) * MM)
        assert ends[0] + 1 - ends[1] == pytest.approx(outside, abs=1e-12)
        assert found.law.quantile(outside / 2) == pytest.approx(-limit * MM, abs=1e-12 * MM * 1e3)
    assert found.std == pytest.approx(0.05 * MM, rel=1e-14)
    assert found.agreement.agrees
    assert found.agreement.band == pytest.approx(math.sqrt(math.log(2 / 0.001) / (2 * SAMPLES)), rel=1e-12)


def irwin_hall(n: int, t: float) -> float:
    """P(sum of n uniform numbers on (0, 1) ≤ t)."""
    return sum((-1) ** k * math.comb(n, k) * (t - k) ** n for k in range(int(t) + 1)) / math.factorial(n)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2, 9, *(pytest.param(n, marks=pytest.mark.slow) for n in (3, 4, 6))])
def test_sums_of_equal_uniforms(n):
    found = law_of_x(*[laws.Uniform(0.5)] * n)
    for t in np.linspace(0.1, n - 0.1, 13):
        assert found.law.cumulative(np.array([t - n / 2]))[0] == pytest.approx(irwin_hall(n, t), abs=2e-13)
    assert found.error < 2e-11
    for p, value, error in zip(LEVELS, found.quantiles, found.quantile_errors, strict=True):
        assert irwin_hall(n, value + n / 2) == pytest.approx(p, abs=1e-12)
        assert error < 1e-9


def test_uniform_and_normal_against_the_closed_form():
    a, sigma, mean = 0.7, 0.2, 0.3
    found = law_of_x(laws.Uniform(a, mean), laws.Normal(sigma))
    x = np.linspace(-1.2, 1.8, 31)

    def primitive(z):
        return z * special.ndtr(z / sigma) + sigma * np.exp(-((z / sigma) ** 2) / 2) / math.sqrt(2 * math.pi)

    expected = (primitive(x - mean + a) - primitive(x - mean - a)) / (2 * a)
    np.testing.assert_allclose(found.law.cumulative(x), expected, atol=1e-13)
    density = (special.ndtr((x - mean + a) / sigma) - special.ndtr((x - mean - a) / sigma)) / (2 * a)
    np.testing.assert_allclose(found.law.density(x), density, atol=1e-12)


def test_normal_draws_alone_are_one_normal_number():
    found = law_of_x(laws.Normal(0.3), laws.Normal(0.4, 1.0), laws.Fixed(0.5))
    assert found.contributors == 1
    x = np.linspace(-1, 4, 11)
    np.testing.assert_allclose(found.law.cumulative(x), stats.norm(1.5, 0.5).cdf(x), rtol=1e-12)
    for p, value in zip(LEVELS, found.quantiles, strict=True):
        assert value == pytest.approx(stats.norm(1.5, 0.5).ppf(p), abs=1e-12)


@pytest.mark.slow
def test_triangle_is_two_uniforms():
    triangle = law_of_x(laws.Triangular(2.0)).law
    both = law_of_x(laws.Uniform(1.0), laws.Uniform(1.0)).law
    x = np.linspace(-2, 2, 41)
    expected = np.where(x < 0, (2 + x) ** 2 / 8, 1 - (2 - x) ** 2 / 8)
    np.testing.assert_allclose(triangle.cumulative(x), expected, atol=1e-15)
    np.testing.assert_allclose(both.cumulative(x), expected, atol=1e-14)
    np.testing.assert_allclose(both.density(x), (2 - np.abs(x)) / 4, atol=1e-14)
    three = law_of_x(laws.Triangular(1.0), laws.Triangular(1.0), laws.Triangular(1.0)).law
    six = [irwin_hall(6, t) for t in (0.5, 1.5, 3.0, 4.2)]
    np.testing.assert_allclose(three.cumulative(np.array([0.5, 1.5, 3.0, 4.2]) - 3.0), six, atol=1e-13)


# --- parts ---

PARTS = {
    "uniform": laws.Uniform(1.0, 0.2),
    "triangular": laws.Triangular(1.2),
    "truncated": laws.TruncatedNormal(0.5, 1.0, 2.0),
    "truncated close": laws.TruncatedNormal(1.0, 0.0, 0.4),
    "arcsine": laws.Arcsine(0.7),
    "disc": laws.Disc(0.9),
    "circle": laws.Circle(1.1),
    "lognormal": laws.Lognormal(0.3, 1.0),
    "two points": laws.TwoPoint(0.4, 0.1, 0.3),
    "empirical": laws.Empirical(((0, -1), (0.3, 0), (0.5, 0.2), (1, 2))),
    "rows": laws.Rows(((0.0, 1.0), (0.5, -1.0), (2.0, 0.25))),
}


def part_and_sample(name: str, count: int = 0, seed: int = 0):
    law = PARTS[name]
    weights = np.array(PLANE)[: law.size] if law.size == 2 else np.array([-0.8])
    uniforms = np.random.default_rng(seed).random((law.size, count))
    return law.projection(weights), weights @ (law.inverse(uniforms) - law.mean_vector[:, None])


@pytest.mark.parametrize("name", PARTS)
def test_a_part_has_the_law_of_its_draw(name):
    part, sampled = part_and_sample(name, 200_000)
    rising = np.sort(sampled)
    shift = 1e-12
    above = np.searchsorted(rising, rising, side="right") / rising.size - part.cumulative(rising + shift)
    below = part.cumulative(rising - shift) - np.searchsorted(rising, rising, side="left") / rising.size
    assert max(above.max(), below.max()) < math.sqrt(math.log(2 / 1e-6) / (2 * rising.size))
    assert part.ends[0] - 1e-12 <= rising[0]
    assert rising[-1] <= part.ends[1] + 1e-12


@pytest.mark.parametrize("name", PARTS)
def test_a_part_along_its_parameter(name):
    """The parametrisation carries the whole probability and the part's cumulative law."""
    part, _ = part_and_sample(name)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    total = 0.0
    for a, b in zip(part.breaks, part.breaks[1:], strict=False):
        s = (a + b) / 2 + (b - a) / 2 * nodes
        total += (b - a) / 2 * part.weight(s) @ weights
        if not isinstance(part, Lines):
            assert part.cumulative(part.position(np.array([b])))[0] == pytest.approx(total, abs=1e-12)
            np.testing.assert_allclose(part.parameter(part.position(s)), s, atol=1e-7 * (b - a))
    assert total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("name", PARTS)
def test_envelopes_bound_characteristic_functions_and_never_rise(name):
    part, _ = part_and_sample(name)
    law = PARTS[name]
    weights = np.array(PLANE)[: law.size] if law.size == 2 else np.array([-0.8])
    omega = np.geomspace(1e-2, 1e4, 4000)
    bound = part.envelope(omega)
    assert (np.abs(law.characteristic(weights[:, None] * omega)) <= bound * (1 + 1e-9)).all()
    assert (np.diff(bound) <= 1e-15).all()


@pytest.mark.parametrize("name", [name for name in PARTS if name not in ("two points", "rows")])
def test_densities_are_derivatives(name):
    part, _ = part_and_sample(name)
    z = np.linspace(*np.clip(part.ends, -3, 3), 24)[1:-1]
    step = 1e-6
    slope = (part.cumulative(z + step) - part.cumulative(z - step)) / (2 * step)
    np.testing.assert_allclose(part.density(z), slope, rtol=2e-4, atol=1e-8)


def test_disc_and_circle_from_the_side():
    x = np.linspace(-0.95, 0.95, 9)
    disc, circle = laws.Disc(2.0).projection(np.array([0.3, 0.4])), laws.Circle(2.0).projection(np.array([0.3, 0.4]))
    expected = 0.5 + (x * np.sqrt(1 - x**2) + np.arcsin(x)) / math.pi
    np.testing.assert_allclose(disc.cumulative(x), expected, atol=1e-15)
    np.testing.assert_allclose(circle.cumulative(x), 0.5 + np.arcsin(x) / math.pi, atol=1e-15)


@pytest.mark.parametrize("names", [("disc", "circle"), ("arcsine", "lognormal"), ("uniform", "empirical")])
def test_convolution_either_way_round_and_by_quadrature(names):
    one, other = (part_and_sample(name)[0] for name in names)
    x = np.linspace(one.ends[0] + other.ends[0], min(one.ends[1] + other.ends[1], 3), 23)[1:-1]
    forth, back = (ConvolvedLaw(0.0, *pair).cumulative(x) for pair in ((one, other), (other, one)))
    np.testing.assert_allclose(forth, back, atol=1e-11)
    for value, found in zip(x[::7], forth[::7], strict=True):
        pieces = np.unique(np.clip([one.parameter(np.array([z]))[0] for z in (*one.ends, *(value - np.array(other.kinks)))],
                                   one.breaks[0], one.breaks[-1]))  # fmt: skip
        pieces = np.union1d(pieces, one.breaks)
        total = sum(
            integrate.quad(
                lambda s, value=value: float(
                    other.cumulative(value - one.position(np.array([s])))[0] * one.weight(np.array([s]))[0]
                ),
                a, b, epsabs=1e-12, epsrel=1e-12,
            )[0]
            for a, b in itertools.pairwise(pieces)
        )  # fmt: skip
        assert found == pytest.approx(total, abs=1e-9)


def test_convolution_and_inversion_agree():
    """Two discs both ways: closed form against the series, whose certified error must hold."""
    draws = (laws.Disc(1.0), laws.Disc(0.4))
    weights = np.array([0.6, 0.8])
    parts = [law.projection(weights) for law in draws]
    summands = [
        Summand(part.within, True, part.envelope, lambda omega, law=law: law.characteristic(weights[:, None] * omega))
        for law, part in zip(draws, parts, strict=True)
    ]
    series = certified_series(0.0, 0.0, summands, 1e-6)
    x = np.linspace(-1.5, 1.5, 41)
    difference = np.abs(series.cumulative(x) - ConvolvedLaw.of(0.0, *parts).cumulative(x)).max()
    assert difference <= series.error + 1e-11
    assert series.error < 1e-9


@pytest.mark.slow
def test_discrete_laws():
    jumps = law_of_x(laws.TwoPoint(1.0), laws.TwoPoint(0.25))
    np.testing.assert_allclose(jumps.law.cumulative(np.array([-1.26, -1.0, 0.0, 1.0, 1.3])), [0, 0.25, 0.5, 0.75, 1])
    # a jump's place is known although there is no density
    assert abs(jumps.quantiles[0] + 1.25) <= jumps.quantile_errors[0] < 1e-12
    many = law_of_x(laws.TwoPoint(1.0), laws.TwoPoint(0.25), laws.TwoPoint(0.1))
    assert many.law is None
    assert many.reason.startswith("not certified")
    assert many.std == pytest.approx(math.sqrt(1 + 0.25**2 + 0.1**2), rel=1e-14)
    smooth = law_of_x(laws.TwoPoint(1.0), laws.TwoPoint(0.25), laws.Normal(0.1))
    expected = np.mean([stats.norm(c, 0.1).cdf(0.3) for c in (-1.25, -0.75, 0.75, 1.25)])
    assert smooth.law.cumulative(np.array([0.3]))[0] == pytest.approx(expected, abs=1e-12)


def test_draws_that_hardly_matter_do_not_make_it_slow_or_wrong():
    found = law_of_x(laws.Uniform(1.0), laws.Uniform(1e-15), laws.Uniform(1e-14))
    assert found.contributors == 1
    assert found.law.cumulative(np.array([0.5]))[0] == pytest.approx(0.75, abs=1e-12)


# --- norms ---


@pytest.mark.slow
def test_r6_norm_of_an_isotropic_normal_vector():
    sigma = 0.2 * MM
    chain = slides((1, 0, 0), (0, 1, 0), (0, 0, 1))
    sources = [JointOffset(joint=f"joint{k}", offset=laws.Normal(sigma)) for k in (1, 2, 3)]
    found = exact_law(ErrorModel(chain, Space(), sources, {"rest": np.zeros(3)}), samples=SAMPLES).poses[0]
    norm = found.laws["position.norm"]
    for p, value in ((0.5, 1.538172), (0.95, 2.795483), (0.99, 3.368214), (0.9973, 3.762480)):
        assert norm.law.quantile(p) / sigma == pytest.approx(value, abs=5e-7)
        assert norm.law.quantile(p) / sigma == pytest.approx(stats.chi(3).ppf(p), abs=1e-10)
    assert norm.mean / sigma == pytest.approx(1.595769, abs=5e-7)
    assert norm.agreement.agrees
    assert found.laws["attitude.norm"].reason == "does not vary at first order"


def test_norms_against_chi_square_laws():
    shifted = NormalNorm(np.array([3.0, 2.0, 0.0]), np.eye(3))
    r = np.array([0.5, 2.0, 4.0, 6.0])
    np.testing.assert_allclose(shifted.cumulative(r), stats.ncx2.cdf(r**2, 3, 13.0), atol=1e-12)
    np.testing.assert_allclose(shifted.density(r), 2 * r * stats.ncx2.pdf(r**2, 3, 13.0), atol=1e-11)
    plane = NormalNorm(np.array([0.0, 0.0, 0.5]), np.diag([4.0, 4.0, 0.0]))
    expected = 1 - np.exp(-(np.maximum(r**2 - 0.25, 0)) / 8)
    np.testing.assert_allclose(plane.cumulative(r), expected, atol=1e-12)
    line = NormalNorm(np.array([1.0, 0.0, 0.0]), np.diag([4.0, 0.0, 0.0]))
    np.testing.assert_allclose(line.cumulative(r), stats.norm(1, 2).cdf(r) - stats.norm(1, 2).cdf(-r), atol=1e-14)


def imhof(radius: float, variances, means) -> float:
    """P(Q ≤ r²) of Q = Σ λ (z + b)² by Imhof's integral (Biometrika 48, 1961, eq. 3.2)."""
    lam, shift = np.array(variances), np.array(means) ** 2 / np.array(variances)

    def integrand(u):
        theta, size = -(radius**2) * u / 2, u.copy()
        for one, off in zip(lam, shift, strict=True):
            square = (one * u) ** 2
            theta += 0.5 * (np.arctan(one * u) + off * one * u / (1 + square))
            size *= (1 + square) ** 0.25 * np.exp(0.5 * off * square / (1 + square))
        return np.sin(theta) / size

    # pieces of a fraction of a period; beyond 2e4 the integrand is below 1e-10
    nodes, weights = np.polynomial.legendre.leggauss(10)
    ends = np.concatenate([np.linspace(0, 40, 401), np.arange(41, 20_001)])
    middles, halves = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
    total = halves @ (integrand(middles[:, None] + halves[:, None] * nodes) @ weights)
    return 0.5 - total / math.pi


@pytest.mark.slow
def test_norm_of_three_different_variances_against_imhof():
    law = NormalNorm(np.array([0.4, -0.3, 0.2]), np.diag([1.0, 0.5, 0.2]))
    for radius in (0.6, 1.5):
        assert law.cumulative(np.array([radius]))[0] == pytest.approx(
            imhof(radius, (1, 0.5, 0.2), (0.4, -0.3, 0.2)), abs=1e-6
        )


def test_a_flat_far_vector_does_not_depend_on_axes():
    turn = stats.special_ortho_group.rvs(3, random_state=np.random.default_rng(3))
    centre, stds = np.array([30.0, 1.0, 0.0]), np.array([1.0, 1e-3, 1e-6])
    law = NormalNorm(turn @ centre, turn @ np.diag(stds**2) @ turn.T)
    # to second order |v| = 30 + x + 1/(2·30): so far out the law is that of x
    assert law.quantile(0.5) == pytest.approx(math.sqrt(901), abs=1e-5)
    assert law.quantile(0.99) - law.quantile(0.5) == pytest.approx(stats.norm.ppf(0.99), rel=1e-3)
    r = np.array([29.0, 30.0, 31.5])
    step = 1e-5
    slope = (law.cumulative(r + step) - law.cumulative(r - step)) / (2 * step)
    np.testing.assert_allclose(law.density(r), slope, rtol=1e-6)


# --- models ---


@pytest.mark.slow
def test_the_papers_arm_agrees_with_its_samples():
    model = ErrorModel.load(examples.PAPER_SHEET)
    result = exact_law(model, seed=1)
    for name, found in result.poses[0].laws.items():
        if name.endswith("norm"):
            assert found.law is None
            assert "only of normal draws" in found.reason
            continue
        assert found.agreement.agrees
        assert found.error < 1e-11
        assert max(found.quantile_errors) < 1e-9
    at = model.at()
    names = ("position.x", "position.y", "position.z", "attitude.x", "attitude.y", "attitude.z")
    stds = [result.poses[0].laws[name].std for name in names]
    np.testing.assert_allclose(stds, np.sqrt(np.diag(at.covariance)), rtol=1e-12)


@pytest.mark.slow
def test_the_papers_arm_against_a_million_samples():
    result = exact_law(ErrorModel.load(examples.PAPER_SHEET), samples=1_000_000, seed=5)
    assert result.agrees
    assert result.poses[0].laws["position.x"].agreement.band < 0.002


def test_a_wrong_law_is_noticed():
    """Planted fault: the spread is 3 % off."""
    from precision_pin.analyses.exact_law.exact_law import agreement_of
    from precision_pin.analyses.exact_law.number_law import NormalLaw

    rising = np.sort(np.random.default_rng(0).normal(size=100_000))
    assert agreement_of(NormalLaw(0.0, 1.0), rising, 0.999, 1.0).agrees
    assert not agreement_of(NormalLaw(0.0, 1.03), rising, 0.999, 1.0).agrees


def test_correlated_normal_draws_and_refused_copulas():
    both = Correlation.pair("p0", "p1", 0.6)
    found = exact_law(sum_along_x(laws.Normal(0.3), laws.Normal(0.4), correlations=(both,)), samples=SAMPLES)
    x = found.poses[0].laws["position.x"]
    assert x.std == pytest.approx(math.sqrt(0.09 + 0.16 + 2 * 0.6 * 0.12), rel=1e-12)
    assert x.agreement.agrees
    with pytest.raises(pp.InputError, match=r"'p1' is correlated .* and not normal"):
        exact_law(sum_along_x(laws.Normal(0.3), laws.Uniform(0.4), correlations=(both,)))


def test_joint_normal_draws_count_as_one_with_the_others():
    covariance = ((0.04, 0.01), (0.01, 0.09))
    chain = slides((1, 0, 0), (1, 0, 0), (1, 0, 0))
    space = Space((Draw("pair", laws.JointNormal(covariance)), Draw("u", laws.Uniform(0.5))))
    sources = [JointOffset(joint=f"joint{k + 1}", offset=name) for k, name in enumerate(("pair.0", "pair.1", "u"))]
    found = exact_law(ErrorModel(chain, space, sources, {"rest": np.zeros(3)}), samples=SAMPLES)
    x = found.poses[0].laws["position.x"]
    assert x.contributors == 2
    assert x.std == pytest.approx(math.sqrt(0.15 + 0.25 / 3), rel=1e-12)
    assert x.agreement.agrees


@pytest.mark.slow
def test_several_poses_and_json():
    model = ErrorModel.load(examples.PAPER_SHEET)
    q = [0.1, 0.2, 0.3, 0.4]
    result = pp.exact_law(model, [None, "paper", q], samples=1000)
    assert [entry.pose.name for entry in result.poses] == ["paper", "paper", ""]
    data = json.loads(result.to_json())
    assert data["schema"] == "precision-pin/exact-law/1"
    assert data["poses"][2]["pose"]["q"] == {f"joint{k + 1}": value for k, value in enumerate(q)}
    x = data["poses"][0]["laws"]["position.x"]
    assert x["support"][0] < x["quantiles"]["0.00135"] < x["quantiles"]["0.99865"] < x["support"][1]
    assert len(x["curve"]["value"]) == len(x["curve"]["density"])
    assert "not_available" in data["poses"][0]["laws"]["position.norm"]
    assert "|d|: not available" in table(result)


@pytest.mark.parametrize(
    ("poses", "count"),
    [
        (None, 1),
        ("paper", 1),
        ([0.1, 0.2], 1),
        (np.zeros(4), 1),
        (["a", "b"], 2),
        ([None, {}], 2),
    ],
)
def test_poses_are_one_or_several(poses, count):
    assert len(listed_poses(poses)) == count


def test_an_array_of_several_poses_is_refused():
    """Elsewhere poses are columns, and in a square array rows and columns cannot be distinguished."""
    with pytest.raises(pp.InputError, match=r"list\(array\) for poses in rows, list\(array.T\) for poses in columns"):
        listed_poses(np.zeros((3, 4)))


def test_bad_settings():
    model = sum_along_x(laws.Uniform(1.0))
    for settings in ({"samples": 10}, {"samples": 1.5}, {"confidence": 1.0}, {"seed": -1}):
        with pytest.raises(pp.InputError):
            exact_law(model, **settings)
    with pytest.raises(pp.InputError, match="0 poses"):
        exact_law(model, [])


def test_figure_marks_what_is_missing():
    result = exact_law(sum_along_x(laws.Uniform(1.0), laws.TwoPoint(0.3)), samples=1000)
    texts = [text.get_text() for axes in figure(result).axes for text in axes.texts]
    assert any("does not vary" in text for text in texts)


# --- the command ---


@pytest.mark.slow
def test_command(tmp_path, monkeypatch, capsys):
    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["precision-pin", "exact-law", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    code, out, err = run("--samples", "2000", "--seed", "3", "--out", str(tmp_path / "plots"))
    assert code == 0
    assert "inversion of the characteristic function" in out
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == [
        "exact-law.json", "exact-law.png", "exact-law.svg",
    ]  # fmt: skip
    assert err.startswith("wrote ")
    code, out, err = run("--samples", "2000", "--json", "-", "--pose", "paper", "--pose", "paper")
    assert code == 0
    assert len(json.loads(out)["poses"]) == 2
    code, out, err = run("--samples", "3")
    assert code == 2
    assert out == ""
    assert "100 to" in err
    code, _, err = run("--pose", "none")
    assert code == 2
    assert "Traceback" not in err


def test_a_spread_that_is_lost_in_rounding_is_refused():
    with pytest.raises(InputError, match="its spread is lost in rounding"):
        NormalNorm(np.array([0.0, 0.0, 2e13]), np.diag([1e-8, 1e-8, 0.0])).quantile(0.5)


@pytest.mark.slow
def test_density_of_a_small_norm_is_that_of_the_closed_form_in_little_memory() -> None:
    """|v|²/σ² has the noncentral chi-square law; the spread of a robot in m is far below 1."""
    std, centre = 1e-5, 1e-5 * np.array([3.0, -8.0, 5.0])
    law = NormalNorm(centre, std**2 * np.diag([1, 1 + 1e-7, 1 - 1e-7]))
    r = np.linspace(3, 17, 400) * std
    tracemalloc.start()
    found = law.density(r)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    exact = 2 * r / std**2 * stats.ncx2.pdf((r / std) ** 2, 3, float(centre @ centre) / std**2)
    np.testing.assert_allclose(found * std, exact * std, atol=1e-6)
    assert peak < 400e6
