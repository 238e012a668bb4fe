"""What first-order results say of sides of play that turn over with the load of single robots."""

import re

import numpy as np
import pytest
from scipy.stats import norm

import precision_pin as pp
from precision_pin.model.equilibrium import MOST_SIDES, fixed_sides, side_variants, turnover_findings
from support.checks.common import one_link

UP = pp.ApproachedPose([0.0], "hinge +")


pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")


def hinge(band=98.0, gap=1e-3):
    """Return a hinge with a load of 98.1 N·m ± 3.924 N·m, 1 m from the tip."""
    sources = [
        pp.sources.Payload(at="tool", mass=pp.Normal(0.4, mean=10.0)),
        pp.sources.Backlash(joint="hinge", backlash=gap, band=band),
        pp.sources.JointOffset(joint="hinge", offset=pp.Uniform(1e-4)),
    ]
    return pp.ErrorModel(one_link(axis=(0, 1, 0)), pp.Space(), sources)


@pytest.mark.parametrize("band", [92.0, 96.0, 103.0])
def test_the_share_against_the_normal_law(band):
    (found,) = turnover_findings(hinge(band).at(UP))
    assert found.code == "W_TURNOVER"
    share = float(re.search(r"load of ([\d.e+]+) %", found.message)[1]) / 100
    expected = norm.cdf(-abs(98.1 - band) / 3.924)
    assert abs(share - expected) < 5 * np.sqrt(expected / 4096) + 0.05 * expected
    assert "at hinge the load" in found.message
    assert "by up to 1 mm" in found.message


def test_nothing_is_said_where_all_but_a_few_robots_agree():
    for model, pose in ((hinge(), [0.0]), (hinge(83.0), UP), (hinge(), pp.ApproachedPose([0.0], "hinge -"))):
        assert turnover_findings(model.at(pose)) == ()


def test_the_model_with_sides_fixed():
    at = hinge().at(UP)
    x = at.space.sample(0, 0, 100)
    assert np.ptp(at.linear(x)[4]) > 1e-3
    # the mean load of 98.1 N·m is above friction
    np.testing.assert_allclose(fixed_sides(at).linear(x)[4], x[2] + 5e-4, rtol=0, atol=1e-18)
    both = sorted(variant.error_at_means[4] for variant in side_variants(at))
    np.testing.assert_allclose(both, [-5e-4, 5e-4])
    np.testing.assert_array_equal(at.error_at_means, fixed_sides(at).error_at_means)
    np.testing.assert_array_equal(at.jacobian, fixed_sides(at).jacobian)
    plain = hinge().at([0.0])
    assert fixed_sides(plain) is plain


def test_the_worst_case_has_both_flanks():
    # the mean load runs ahead, so that the flank behind is reached by single robots only
    found = pp.worst_case(hinge(), UP, samples=2000).poses[0]
    dz = found.components[2]
    # dz = -1 m times the turn
    assert (dz.low, dz.high) == (pytest.approx(-6e-4, rel=1e-6), pytest.approx(6e-4, rel=1e-6))
    assert dz.seen[0] >= dz.low - 1e-9
    assert dz.seen[1] <= dz.high + 1e-9
    assert found.position.first_order.upper == pytest.approx(6e-4, rel=1e-3)


def test_first_order_results_say_so():
    model = hinge()
    for result in (
        pp.budget(model, UP, samples=1024),
        pp.moments(model, UP, method="closed"),
        pp.exact_law(model, UP, samples=1000),
    ):
        assert any("W_TURNOVER" in line for line in result.warnings)
        assert result.to_dict()["poses"][0]["pose"]["approach"] == {"hinge": "+"}
        assert not any("W_TURNOVER" in line for line in type(result).to_dict(result)["findings"])
    # sampled results need no such line
    assert not any("W_TURNOVER" in line for line in pp.monte_carlo(model, UP, samples=1000).warnings)


def test_closed_moments_do_not_run_across_the_jump():
    at = pp.moments(hinge(), UP, method="closed").poses[0]
    # the turn is ±0.1 mrad about the flank of the mean load
    assert at.mean.value[4] == pytest.approx(5e-4, abs=1e-12)
    assert at.covariance.value[4, 4] == pytest.approx(1e-8 / 3, rel=1e-6)


def test_the_map_says_it_of_its_worst_pose():
    found = pp.map_poses(hinge(96.0), [UP, pp.ApproachedPose([0.05], "hinge +")], verify=0)
    (line,) = (line for line in found.warnings if "W_TURNOVER" in line)
    assert line.count(found.poses.labels[found.worst_first[0]]) == 1


def test_with_very_many_sides_the_worst_case_says_that_it_has_one_of_each():
    sources = [
        pp.sources.Payload(at="tool", mass=pp.TruncatedNormal(0.4, mean=10.0, k=3.0)),
        *(pp.sources.Backlash(joint="hinge", backlash=1e-4, band=98.0 + 0.01 * k) for k in range(MOST_SIDES + 1)),
    ]
    model = pp.ErrorModel(one_link(axis=(0, 1, 0)), pp.Space(), sources)
    assert len(side_variants(model.at(UP))) == 1
    assert any("W_TURNOVER" in line for line in pp.worst_case(model, UP, samples=500).warnings)
