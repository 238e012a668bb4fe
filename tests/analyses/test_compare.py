"""Models side by side: differences in closed form, the coverage of their intervals, differences of sheets."""

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from analyses.test_verdicts import lognormal, quantile_of
from precision_pin.analyses.compare.compare import headline, mean_difference, quantile_difference, share_difference
from precision_pin.robot.examples import PAPER_SHEET
from support.checks.common import one_link
from support.refusals import check_refused

RNG = np.random.default_rng(11)


pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")


def hinge(std, *more):
    """Return an arm of one hinge about z, with a normal offset; the tip is 1 m away."""
    own = pp.sources.JointOffset(joint="hinge", offset=pp.Draw("own", pp.Normal(std)))
    return pp.ErrorModel(one_link(), pp.Space(), [own, *more])


@pytest.mark.slow
def test_a_scaled_tolerance_in_closed_form():
    models = [hinge(1e-4), hinge(1.1e-4)]
    found = pp.compare(models, [0.0], samples=60_000, model="linear", specifications="0.2 mm @ 95 %")
    (pose,) = found.poses
    (pair,) = pose.differences
    # |offset| is half-normal; the same robots, so that each error is 1.1 times the first one
    for level, one in pair.quantiles["attitude.norm"].items():
        expected = 1e-5 * stats.norm.ppf(0.5 + level / 2)
        assert one.interval[0] <= expected <= one.interval[1]
        own = np.diff(pose.laws[0].attitude.norm.quantile_interval(level))[0]
        assert np.diff(one.interval)[0] < 0.7 * own
    share = stats.norm.cdf([2.0, 2 / 1.1]) * 2 - 1
    (inside,) = pair.shares
    assert inside.interval[0] <= share[1] - share[0] <= inside.interval[1]
    assert inside.value == pytest.approx(np.diff([law.summary.specifications[0].probability for law in pose.laws])[0])
    assert pair.means["attitude.z"].value == pytest.approx(0.1 * pose.laws[0].attitude.z.mean)
    assert [sum(variance.values()) for variance in pose.variances] == pytest.approx([1e-8, 1.21e-8])
    assert [found.met(name) for name in found.names] == [result.summary.specifications[0].met for result in pose.laws]
    # a further source leaves the random numbers of the others
    further = pp.sources.JointOffset(joint="hinge", offset=pp.Draw("before", pp.Fixed(2e-4)))
    more = pp.compare({"plain": hinge(1e-4), "more": hinge(1e-4, further)}, [0.0], samples=1000, model="linear")
    (pair,) = more.poses[0].differences
    assert pair.means["attitude.z"].value == pytest.approx(2e-4)
    np.testing.assert_allclose(pair.means["attitude.z"].interval, 2e-4, rtol=1e-9)
    assert [one.value for one in pair.quantiles["attitude.z"].values()] == pytest.approx([2e-4] * 3)


def rare_step(share):
    """Return |z|, and |z| with ten more in this share of the robots."""

    def draw(turns, count):
        size = np.abs(RNG.standard_normal((turns, count)))
        return size, size + 10 * (RNG.random((turns, count)) < share)

    half = stats.halfnorm.cdf
    return draw, half, lambda x: (1 - share) * half(x) + share * half(x - 10)


def two_values(turns, count):
    high = RNG.random((turns, count)) < 0.052
    return 1.0 * high, 2.0 * high


def lognormals(turns, count):
    size = np.exp(np.sqrt(np.log(2)) * RNG.standard_normal((2, turns, count)) - np.log(2) / 2)
    return size[0], 1.1 * size[0]


# two numbers of a robot, and the laws of both
PAIRS = {
    "rare, 0.3 %": rare_step(0.003),
    "rare, at the quantile": rare_step(0.052),
    "two values": (two_values, lambda x: 1.0 if x >= 1 else 0.948, lambda x: 1.0 if x >= 2 else 0.948),
    "lognormal of variation 1": (lognormals, lognormal, lambda x: lognormal(x / 1.1)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PAIRS)
def test_intervals_of_quantiles_cover_the_difference(name):
    draw, *laws = PAIRS[name]
    turns = 50
    pairs = list(zip(*draw(turns, 2000), strict=True))
    for level in (0.5, 0.95):
        first, second = (quantile_of(below, level) for below in laws)
        found = [quantile_difference(one, other, level, 0.95).interval for one, other in pairs]
        held = sum(one is None or one[0] - 1e-11 <= second - first <= one[1] + 1e-11 for one in found)
        assert sum(one is None for one in found) < turns * (name == "two values") + 1
        assert held >= stats.binom.ppf(1e-3, turns, 0.95)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "skewness"), [(5e-4, 44.7), (3e-3, 18.2), (0.05, 4.1)])
def test_intervals_of_means_cover_the_difference_or_are_not_given(share, skewness):
    # the skewness of a two-point law, (1 - 2 p)/√(p (1 - p))
    assert skewness == pytest.approx((1 - 2 * share) / np.sqrt(share * (1 - share)), abs=0.1)
    turns, count = 1000, 2000
    first = np.zeros(count)
    found = [mean_difference(first, 1.0 * (RNG.random(count) < share), 0.95, skewness).interval for _ in range(turns)]
    assert sum(one is None or one[0] <= share <= one[1] for one in found) >= stats.binom.ppf(1e-3, turns, 0.95)
    assert any(one is not None for one in found) == (skewness < 0.4 * np.sqrt(count))


@pytest.mark.slow
def test_models_that_differ_in_a_rare_draw_are_not_told_to_be_alike():
    rare = pp.sources.JointOffset(joint="hinge", offset=pp.Draw("rare", pp.TwoPoint(1e-3, 1e-3, 1e-6)))
    found = pp.compare([hinge(1e-4), hinge(1e-4, rare)], [0.0], samples=2000, model="linear")
    (pair,) = found.poses[0].differences
    assert pair.means["attitude.z"].value == 0  # no robot of 2,000 has it; of all robots the mean is 2e-9 off
    assert pair.means["attitude.z"].interval is None
    low, high = pair.quantiles["attitude.norm"][0.95].interval
    assert low < 0 < high
    assert "do not differ" not in headline(found, 1)
    alike = pp.compare([hinge(1e-4), hinge(1e-4)], [0.0], samples=200, model="linear")
    assert "do not differ" in headline(alike, 1)
    for by_level in alike.poses[0].differences[0].quantiles.values():
        assert all((one.value, one.is_told) == (0, False) for one in by_level.values())
    assert repr(alike).startswith("<ComparisonResult of A, B: 1 poses, 200 robots")
    values = RNG.standard_normal((2, 90))
    assert quantile_difference(*values, 0.95, 0.95).interval is None
    assert mean_difference(values[0, :1], values[1, :1], 0.95).interval is None


@pytest.mark.slow
@pytest.mark.parametrize(("count", "gained", "lost"), [(300, 0.02, 0.0), (300, 0.45, 0.45), (2000, 0.003, 0.001)])
def test_intervals_of_shares_cover_whatever_changes_sides(count, gained, lost):
    turns = 1000
    held = 0
    for up, down, _ in RNG.multinomial(count, [gained, lost, 1 - gained - lost], turns):
        first, other = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        other[:up] = first[up : up + down] = True
        low, high = share_difference(first, other, 0.95).interval
        held += low <= gained - lost <= high
    assert held >= stats.binom.ppf(1e-3, turns, 0.95)
    assert count == 2000 or gained < 0.4 or held <= stats.binom.ppf(1 - 1e-3, turns, 0.975)


@pytest.mark.slow
def test_what_differs_in_the_sheets():
    model = pp.ErrorModel.load(PAPER_SHEET)
    other = model.with_({"axis_install[joint2].radius": "0.2 mm", "parameters.a1": "±0.1 mm", "statics": "equilibrium"})
    found = pp.compare({"old": model, "new": other}, "paper", samples=200)
    written = {one.path: (one.before, one.after) for one in found.sheet_differences[0]}
    assert written["axis_install[joint2].radius"] == ("0.1 mm", "0.2 mm")
    assert written["statics"] == ("nominal", "equilibrium")
    assert any(path.startswith("parameters.a1") for path in written)
    assert len(written) <= 4
    data = found.to_dict()
    assert [one["path"] for one in data["sheets"]["new"]] == list(written)
    assert data["poses"][0]["models"]["new"]["position"]["norm"]["mean"] > 0


def test_what_cannot_be_compared():
    two, said = [hinge(1e-4), pp.ErrorModel.load(PAPER_SHEET)], "B has the joints joint1, joint2, joint3, joint4, A has"
    check_refused(("1 model; 2 to 8 can be compared", pp.compare, two[:1]), (said, pp.compare, two, [0.0]))
