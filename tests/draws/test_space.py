"""Where each random number comes from: names, scopes, units; and the laws they follow, with faults planted."""

import math
import re
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy import special

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws import philox
from precision_pin.draws.draw import MOST_POSES, MOST_VISITS, Draw, Scope, occasion
from precision_pin.draws.expressions import Component, Constant
from precision_pin.draws.laws import Circle, Disc, Fixed, JointNormal, Normal, Triangular, TruncatedNormal, Uniform
from precision_pin.draws.space import LabelledSpace, Space
from support import philox_reference
from support.sampling_checks import BLOCK, Sampler, exact_failures, sampling_failures

COVARIANCE = ((1.0, 0.5, 0.1), (0.5, 2.0, 0.3), (0.1, 0.3, 0.5))
EVERY_LAW = Space(
    (
        Draw("fixed", Fixed(-1.5)),
        Draw("uniform", Uniform(2.0, 1.0)),
        Draw("triangular", Triangular(1.0)),
        Draw("normal", Normal(0.5, -3.0)),
        Draw("truncated", TruncatedNormal(1.0, 0.2, 2.5)),
        Draw("disc", Disc(2.0)),
        Draw("circle", Circle(3.0)),
        Draw("joint", JointNormal(COVARIANCE, (1.0, 2.0, 3.0))),
    )
)
TWO = Space((Draw("left", Uniform(1.0, 2.0)), Draw("right", Normal(0.5))))


def test_columns() -> None:
    assert EVERY_LAW.size == 12
    assert EVERY_LAW.components[5:] == ("disc.x", "disc.y", "circle.x", "circle.y", "joint.0", "joint.1", "joint.2")
    assert [EVERY_LAW.index[name] for name in EVERY_LAW.components] == list(range(12))
    assert EVERY_LAW.slices[5:] == (slice(5, 7), slice(7, 9), slice(9, 12))
    np.testing.assert_array_equal(EVERY_LAW.mean, [-1.5, 1, 0, -3, 0.2, 0, 0, 0, 0, 1, 2, 3])
    expected = np.zeros((12, 12))
    truncated = 1 - 2 * 2.5 * math.exp(-(2.5**2) / 2) / math.sqrt(2 * math.pi) / math.erf(2.5 / math.sqrt(2))
    np.fill_diagonal(expected, [0, 4 / 3, 1 / 6, 0.25, truncated, 1, 1, 4.5, 4.5, 0, 0, 0])
    expected[9:, 9:] = COVARIANCE
    np.testing.assert_allclose(EVERY_LAW.covariance, expected, rtol=1e-14)


def test_empty_space() -> None:
    space = Space()
    assert space.sample(0, 0, 5).shape == (0, 5)
    assert space.mean.shape == (0,)
    assert space.covariance.shape == (0, 0)
    assert space.inverse(np.zeros((0, 4))).shape == (0, 4)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2**64 - 1, 0, 20150713, 2**32])
@pytest.mark.parametrize("first", [0, 7, 2**33 - 3])
def test_every_law_against_plain_python(seed: int, first: int) -> None:
    assert exact_failures(EVERY_LAW.sample, EVERY_LAW, seed=seed, units=range(first, first + 12)) == []


def test_box_muller_of_a_pair_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    # the first known answer of Random123: counter and key zero
    u = (2 * (0xE169C58D6627E8D5 >> 12) + 1) / 2**53
    v = (2 * (0x9B00DBD8BC57AC4C >> 12) + 1) / 2**53
    monkeypatch.setattr(philox, "stream_of", lambda name: 0)
    even, odd = Space((Draw("z", Normal(1.0)),)).sample(0, 0, 2)[0]
    assert even == pytest.approx(math.sqrt(-2 * math.log(u)) * math.cos(2 * math.pi * v), rel=1e-15)
    assert odd == pytest.approx(math.sqrt(-2 * math.log(u)) * math.sin(2 * math.pi * v), rel=1e-15)


def test_the_two_units_of_a_pair_share_one_call() -> None:
    space = Space((Draw("u", Uniform(0.5, 0.5)),))
    for pair in range(4):
        expected = philox_reference.pair_of_uniforms(3, philox_reference.stream("u"), 0, pair)
        np.testing.assert_allclose(space.sample(3, 2 * pair, 2)[0], expected, rtol=0, atol=2e-16)


@pytest.mark.parametrize(("first", "count"), [(0, 1), (1, 1), (1, 2), (2, 5), (3, 4), (17, 83), (99, 1), (50, 0)])
def test_any_slice_replays_the_same_bits(first: int, count: int) -> None:
    whole = EVERY_LAW.sample(5, 0, 100)
    np.testing.assert_array_equal(EVERY_LAW.sample(5, first, count), whole[:, first : first + count])


def test_far_units_can_be_replayed() -> None:
    far = EVERY_LAW.sample(5, 2**40, 10)
    np.testing.assert_array_equal(EVERY_LAW.sample(5, 2**40 + 3, 4), far[:, 3:7])
    assert not np.array_equal(far[3], EVERY_LAW.sample(5, 0, 10)[3])
    assert np.isfinite(TWO.sample(5, 2**64 - 2, 2)).all()


def test_adding_and_reordering_draws_changes_no_other_draw() -> None:
    sampled = EVERY_LAW.sample(11, 3, 9)
    for order in (EVERY_LAW.draws[::-1], (*EVERY_LAW.draws[4:], Draw("new", Normal(1.0)), *EVERY_LAW.draws[:4])):
        other = Space(order)
        again = other.sample(11, 3, 9)
        for name in EVERY_LAW.components:
            np.testing.assert_array_equal(again[other.index[name]], sampled[EVERY_LAW.index[name]], err_msg=name)


def test_a_changed_law_keeps_the_numbers_behind_it() -> None:
    before, after = (Space((Draw("a", Uniform(size)), Draw("b", Normal(1.0)))).sample(1, 0, 50) for size in (1.0, 2.0))
    np.testing.assert_allclose(after[0], 2 * before[0], rtol=1e-15)
    np.testing.assert_array_equal(after[1], before[1])


def test_a_disc_turns_into_a_circle_in_place() -> None:
    disc = Space((Draw("p", Disc(1.0)),)).sample(1, 0, 20)
    circle = Space((Draw("p", Circle(1.0)),)).sample(1, 0, 20)
    np.testing.assert_allclose(disc / np.hypot(*disc), circle, rtol=0, atol=1e-15)


# ---- scopes ----


def test_occasions_are_the_numbers_of_the_design() -> None:
    assert occasion(Scope.UNIT, 5, 7) == 0
    assert [occasion(Scope.POSE, pose, 9) for pose in (0, 1, 2)] == [4096, 8192, 12288]
    assert [occasion(Scope.VISIT, 0, visit) for visit in (0, 1, 4094)] == [4097, 4098, 8191]
    assert occasion(Scope.VISIT, 1, 0) == 8193
    assert occasion(Scope.VISIT, 2**20 - 2, 4094) == 2**32 - 1


def test_no_two_occasions_share_a_number() -> None:
    poses, visits = (0, 1, 2, MOST_POSES - 1), (0, 1, MOST_VISITS - 1)
    numbers = [0, *(occasion(Scope.POSE, pose) for pose in poses)]
    numbers += [occasion(Scope.VISIT, pose, visit) for pose in poses for visit in visits]
    assert len(set(numbers)) == len(numbers)
    assert max(numbers) < 2**32


@pytest.mark.parametrize("scope", list(Scope))
@pytest.mark.parametrize(("pose", "visit"), [(-1, 0), (0, -1), (2**20 - 1, 0), (0, 4095), (2**40, 0)])
def test_pose_or_visit_out_of_range_is_refused(scope: Scope, pose: int, visit: int) -> None:
    with pytest.raises(InputError, match="whole number from 0"):
        occasion(scope, pose, visit)


def test_scopes_say_what_is_drawn_again() -> None:
    space = Space(tuple(Draw(scope.value, Uniform(1.0), scope) for scope in Scope))
    home = space.sample(1, 0, 8)
    visit = space.sample(1, 0, 8, visit=1)
    pose = space.sample(1, 0, 8, pose=1)
    same = [[bool((other[row] == home[row]).all()) for row in range(3)] for other in (visit, pose)]
    assert same == [[True, True, False], [True, False, False]]
    for row, scope in enumerate(Scope):
        number = philox_reference.occasion(scope, 1, 3)
        expected = philox_reference.pair_of_uniforms(1, philox_reference.stream(scope.value), number, 0)
        np.testing.assert_allclose(space.sample(1, 0, 2, pose=1, visit=3)[row], 2 * np.array(expected) - 1, atol=1e-15)


# ---- inverse ----


def test_inverse_takes_every_law_by_its_inverse() -> None:
    u = np.random.default_rng(6).uniform(size=(12, 50))
    x = EVERY_LAW.inverse(u)
    np.testing.assert_array_equal(x[0], np.full(50, -1.5))
    np.testing.assert_allclose(x[1], 1 + 2 * (2 * u[1] - 1), rtol=0, atol=1e-15)
    np.testing.assert_allclose(x[3], -3 + 0.5 * special.ndtri(u[3]), rtol=1e-15)
    np.testing.assert_allclose(np.hypot(x[5], x[6]), 2 * np.sqrt(u[5]), rtol=1e-15)
    root = np.linalg.cholesky(np.array(COVARIANCE))
    np.testing.assert_allclose(x[9:], np.array([[1.0], [2], [3]]) + root @ special.ndtri(u[9:]), rtol=0, atol=1e-14)


# ---- names ----


@pytest.mark.parametrize(
    "draws",
    [
        (Draw("a", Uniform(1.0)), Draw("a", Uniform(1.0))),
        (Draw("p", Disc(1.0)), Draw("p.x", Uniform(1.0))),
        (Draw("p.1", Normal(1.0)), Draw("p", JointNormal(COVARIANCE))),
        (Draw("", Uniform(1.0)),),
    ],
)
def test_names_that_clash_are_refused(draws: tuple[Draw, ...]) -> None:
    with pytest.raises(InputError, match="name"):
        Space(draws)


def test_streams_that_collide_are_parted_whatever_the_order(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed = {"a": 1, "b": 1, "b#1": 2}
    monkeypatch.setattr(philox, "stream_of", hashed.__getitem__)
    draws = (Draw("a", Uniform(1.0)), Draw("b", Uniform(1.0)))
    assert Space(draws).streams == (1, 2)
    assert Space(draws[::-1]).streams == (2, 1)
    x = Space(draws).sample(0, 0, 10)
    assert (x[0] != x[1]).all()


def test_including_shares_equal_draws_and_refuses_others() -> None:
    space = TWO.including([Draw("right", Normal(0.5)), Draw("new", Uniform(1.0))])
    assert space.components == ("left", "right", "new")
    for other in (Draw("left", Uniform(3.0, 2.0)), Draw("left", Uniform(1.0, 2.0), Scope.VISIT)):
        with pytest.raises(InputError, match="'left' is given twice"):
            TWO.including([other])


def test_unknown_parameter_names_the_nearest() -> None:
    assert EVERY_LAW.parameter("disc.x") == Component("disc.x")
    with pytest.raises(UnknownNameError, match="did you mean 'normal'"):
        EVERY_LAW.parameter("norml")
    with pytest.raises(UnknownNameError, match=r"disc\.x"):
        EVERY_LAW.parameter("disc")


def test_settings_become_numbers_or_components() -> None:
    draws = (Draw("a1", Uniform(1.0)), Draw("beam[l].EI", Uniform(1.0)), Draw("beam[l].EI[1]", Uniform(1.0)))
    view = LabelledSpace(Space(draws), "beam[l]")
    assert view.value("EI", 2) == 2.0
    assert view.value("EI", "a1") == Component("a1")
    assert view.value("EI", Uniform(1.0)) == Component("beam[l].EI")
    assert view.value("EI", Draw("", Uniform(1.0))) == Component("beam[l].EI")
    assert view.value("EI", Draw("a1", Uniform(1.0))) == Component("a1")
    assert view.value("EI", Constant(3.0)) == Constant(3.0)
    assert view.values("EI", [Uniform(1.0), Uniform(1.0)]) == (Component("beam[l].EI"), Component("beam[l].EI[1]"))
    assert view.component("EI") == Component("beam[l].EI")
    with pytest.raises(UnknownNameError, match="did you mean 'a1'"):
        view.value("EI", "a11")


# ---- bad calls ----


@pytest.mark.parametrize("seed", [-1, 2**64, 1.0, True, "0", None, math.nan])
def test_bad_seed_is_refused(seed: object) -> None:
    with pytest.raises(InputError, match="seed"):
        TWO.sample(seed, 0, 1)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [np.uint8, np.int32, np.uint32, np.int64, np.uint64])
def test_whole_numbers_of_numpy_are_seeds_and_units_too(kind: type) -> None:
    np.testing.assert_array_equal(TWO.sample(kind(5), kind(3), kind(4)), TWO.sample(5, 3, 4))


@pytest.mark.parametrize(("first", "count"), [(-1, 3), (0, -1), (2**64, 1), (2**64 - 1, 2)])
def test_units_out_of_range_are_refused(first: int, count: int) -> None:
    with pytest.raises(InputError, match="whole number"):
        TWO.sample(0, first, count)


# ---- distributions, at an error probability of 1e-6 for each check ----


@pytest.mark.slow
def test_no_check_finds_fault_with_every_law_at_1e6_draws() -> None:
    assert sampling_failures(EVERY_LAW.sample, EVERY_LAW) == []


@cache
def kept(seed: int, first: int, count: int) -> Array:
    """Return the numbers of TWO, drawn once for all faults."""
    x = TWO.sample(seed, first, count)
    x.flags.writeable = False
    return x


def altered(change: Callable[[Array], Array]) -> Sampler:
    """Return the true sampler with its numbers changed."""
    return lambda seed, first, count: change(kept(seed, first, count))


def wider(x: Array) -> Array:
    return np.array([x[0], 1.01 * x[1]])


def wider_uniform(x: Array) -> Array:
    return np.array([2 + 1.01 * (x[0] - 2), x[1]])


def narrower(x: Array) -> Array:
    return np.array([x[0], 0.99 * x[1]])


def swapped(x: Array) -> Array:
    return x[::-1]


def tail_clipped_at_3_sigma(x: Array) -> Array:
    return np.array([x[0], np.clip(x[1], -1.5, 1.5)])


def upper_tail_folded_at_4_sigma(x: Array) -> Array:
    return np.array([x[0], np.where(x[1] > 2.0, -x[1], x[1])])


def far_tail_dropped_at_4_sigma(x: Array) -> Array:
    return np.array([x[0], np.where(np.abs(x[1]) > 2.0, 0.0, x[1])])


def upper_end_of_the_uniform_missing(x: Array) -> Array:
    return np.array([np.where(x[0] > 3 - 2e-3, x[0] - 1, x[0]), x[1]])


def one_follows_the_other(x: Array) -> Array:
    """Nearly the right laws, but a correlation of 0.01."""
    score = (x[0] - 2) * math.sqrt(3)
    return np.array([x[0], 0.5 * (0.01 * score + math.sqrt(1 - 1e-4) * x[1] / 0.5)])


def skewed(x: Array) -> Array:
    """Mean and variance as they should be."""
    scored = x[1] / 0.5
    bent = scored + 0.02 * (scored**2 - 1)
    return np.array([x[0], 0.5 * bent / math.sqrt(1 + 2 * 0.02**2)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "found"),
    [
        (wider, "right: the variance"),
        (wider_uniform, "left: the variance"),
        (narrower, "right: the variance"),
        (swapped, "left: the mean"),
        (tail_clipped_at_3_sigma, "right: .* tail"),
        (upper_tail_folded_at_4_sigma, "right: .* upper tail"),
        (far_tail_dropped_at_4_sigma, "right: .* tail"),
        (upper_end_of_the_uniform_missing, "left: .* upper tail"),
        (one_follows_the_other, "correlation"),
        (skewed, "right: Kolmogorov"),
    ],
)
def test_planted_fault_is_found_at_1e6_draws(fault: Callable[[Array], Array], found: str) -> None:
    failures = sampling_failures(altered(fault), TWO)
    assert any(re.search(found, failure) for failure in failures), failures


@pytest.mark.slow
def test_repeated_block_is_found() -> None:
    def sampler(seed: int, first: int, count: int) -> Array:
        # units 1024…2047 are those of 0…1023 again
        x = kept(seed, first, count).copy()
        low, high = max(first, 1024), min(first + count, 2048)
        if low < high:
            x[:, low - first : high - first] = TWO.sample(seed, low - 1024, high - low)
        return x

    failures = sampling_failures(sampler, TWO)
    assert "left: 1024 numbers come twice" in failures
    assert "right: 1024 numbers come twice" in failures


@pytest.mark.slow
def test_numbers_that_depend_on_where_a_call_begins_are_found() -> None:
    failures = sampling_failures(lambda seed, first, count: TWO.sample(seed, 0, count), TWO, count=2 * BLOCK)
    assert any("drawn alone differ" in failure for failure in failures)


def test_a_seed_that_is_ignored_is_found() -> None:
    failures = sampling_failures(lambda seed, first, count: TWO.sample(0, first, count), TWO, count=BLOCK)
    assert any("the next seed" in failure for failure in failures)


@pytest.mark.slow
def test_bias_of_0_2_percent_of_the_half_width_is_found_at_1e6_draws() -> None:
    # of a half-width of 3 sigma: z = 6 at 1e6 draws, the limit is 4.9
    failures = sampling_failures(altered(lambda x: x + np.array([[0.0], [0.002 * 1.5]])), TWO)
    assert any(failure.startswith("right: the mean") for failure in failures)


@pytest.mark.slow
def test_bias_of_0_2_percent_of_sigma_is_found_at_2_to_the_24_draws_and_truth_passes() -> None:
    # z = 0.002 √N is 2 at 1e6 draws, invisible at this confidence; 8.2 at 2^24
    shift = 0.002 * np.array([[1 / math.sqrt(3)], [0.5]])
    failures = sampling_failures(lambda *units: TWO.sample(*units) + shift, TWO, moment_count=2**24)
    assert any(failure.startswith("left: the mean") for failure in failures)
    assert any(failure.startswith("right: the mean") for failure in failures)
    assert sampling_failures(TWO.sample, TWO, moment_count=2**24) == []


@pytest.mark.parametrize("fault", [wider, wider_uniform, narrower, swapped, one_follows_the_other, skewed])
def test_the_exact_check_finds_faults_in_a_few_units(fault: Callable[[Array], Array]) -> None:
    assert exact_failures(altered(fault), TWO, seed=1, units=range(10))
    assert exact_failures(altered(lambda x: x + 1e-9), TWO, seed=1, units=range(10))
