"""Where each random number comes from: generator, streams, names, scopes, units; what laws they follow."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from precision_pin import (
    Correlation,
    Disc,
    Draw,
    InputError,
    JointNormal,
    Lognormal,
    Normal,
    Scope,
    Space,
    TwoPoint,
    Uniform,
)
from precision_pin.base.errors import UnknownNameError
from precision_pin.draws import philox
from precision_pin.draws.draw import MOST_POSES, MOST_VISITS, occasion
from precision_pin.draws.expressions import Component, Constant
from precision_pin.draws.space import LabelledSpace
from support import sampling_checks as reference
from support.sampling_checks import COVARIANCE, LAW_SPACE, MATRIX

TWO = Space((Draw("left", Uniform(1.0, 2.0)), Draw("right", Normal(0.5))))


# ---- the generator ----


def test_published_vectors() -> None:
    """Random123, kat_vectors, "philox4x32 10"."""
    for texts in (
        ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ):
        counter, key, expected = (tuple(int(word, 16) for word in text.split()) for text in texts)
        column = np.array(counter, dtype=np.uint64)[:, None]
        assert tuple(philox.philox4x32(column, key)[:, 0].tolist()) == expected
        assert reference.philox_words(counter, key) == expected


def test_a_uniform_and_a_normal_number_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    # pair 2^64 - 1, stream and occasion 2^32 - 1, seed 2^64 - 1: the second known answer
    even, odd = philox.uniforms(2**64 - 1, 2**32 - 1, 2**32 - 1, 2**64 - 1, 1)[:, 0]
    assert even == (2 * (0x41C83B0E408F276D >> 12) + 1) / 2**53
    assert odd == (2 * (0x6D5451FDA20BC7C6 >> 12) + 1) / 2**53
    # Box and Muller of the first: counter and key zero, the low word of each half first
    u, v = ((2 * (bits >> 12) + 1) / 2**53 for bits in (0xE169C58D6627E8D5, 0x9B00DBD8BC57AC4C))
    monkeypatch.setattr(philox, "stream_of", lambda name: 0)
    seen = Space((Draw("z", Normal(1.0)),)).sample(0, 0, 2)[0]
    turn = 2 * math.pi * v
    assert seen.tolist() == pytest.approx(
        [math.sqrt(-2 * math.log(u)) * f(turn) for f in (math.cos, math.sin)], rel=1e-15
    )


def test_uniforms_against_plain_integers() -> None:
    for seed, first in itertools.product((0, 1, 2**32, 2**63 + 12345, 2**64 - 1), (0, 2**32 - 2, 2**40)):
        seen = philox.uniforms(seed, 0xDEADBEEF, 4097, first, 5)
        expected = [reference.pair_of_uniforms(seed, 0xDEADBEEF, 4097, first + k) for k in range(5)]
        np.testing.assert_array_equal(seen, np.array(expected).T)


def test_uniforms_are_never_0_or_1_and_symmetric(monkeypatch: pytest.MonkeyPatch) -> None:
    def corners(counter: np.ndarray, key: tuple[int, int]) -> np.ndarray:
        column = np.array([0, 0, 0xFFFFFFFF, 0xFFFFFFFF], dtype=np.uint64)
        return np.repeat(column[:, None], counter.shape[1], axis=1)

    monkeypatch.setattr(philox, "philox4x32", corners)
    assert philox.uniforms(0, 0, 0, 0, 1)[:, 0].tolist() == [2.0**-53, 1 - 2.0**-53]


def test_stream_is_the_start_of_blake2s() -> None:
    # RFC 7693, appendix B: BLAKE2s-256("abc") begins 50 8c 5e 8c
    assert philox.stream_of("abc") == 0x8C5E8C50
    names = ["a", "a", "größe", "axis_install[joint2].A.x", *(f"a{k}" for k in range(50))]
    assert philox.streams_of(names) == {name: reference.stream(name) for name in names}


def test_collision_is_resolved_whatever_the_order(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed = {"ant": 7, "bee": 7, "cat": 7, "bee#1": 9, "cat#1": 7, "cat#2": 9, "cat#3": 11, "dog": 9, "dog#1": 12}
    monkeypatch.setattr(philox, "stream_of", hashed.__getitem__)
    # ant keeps 7; bee goes to 9; cat tries 7, 9, 11; dog's own 9 is taken by then, so that it goes to 12
    expected = {"ant": 7, "bee": 9, "cat": 11, "dog": 12}
    for order in itertools.permutations(expected):
        assert philox.streams_of(order) == expected
    assert Space(tuple(Draw(name, Uniform(1.0)) for name in ("dog", "ant", "cat", "bee"))).streams == (12, 7, 11, 9)


# ---- spaces ----


def test_columns_mean_and_covariance() -> None:
    index, covariance = LAW_SPACE.index, LAW_SPACE.covariance
    assert LAW_SPACE.components[5:12] == ("disc.x", "disc.y", "circle.x", "circle.y", "joint.0", "joint.1", "joint.2")
    assert [index[name] for name in LAW_SPACE.components] == list(range(LAW_SPACE.size))
    assert LAW_SPACE.slices[5:8] == (slice(5, 7), slice(7, 9), slice(9, 12))
    np.testing.assert_array_equal(LAW_SPACE.mean[:12], [-1.5, 1, 0, -3, 0.2, 0, 0, 0, 0, 1, 2, 3])
    truncated = 1 - 2 * 2.5 * math.exp(-(2.5**2) / 2) / math.sqrt(2 * math.pi) / math.erf(2.5 / math.sqrt(2))
    expected = np.diag([0, 4 / 3, 1 / 6, 0.25, truncated, 1, 1, 4.5, 4.5, 0, 0, 0])
    expected[9:, 9:] = COVARIANCE
    np.testing.assert_allclose(covariance[:12, :12], expected, rtol=1e-14)
    np.testing.assert_array_equal(covariance, covariance.T)
    pearson, scale = LAW_SPACE.pearson, np.sqrt(np.diag(covariance))
    assert (np.diag(pearson) == 1).all()
    varying = np.ix_(scale > 0, scale > 0)
    np.testing.assert_allclose(
        pearson[varying], covariance[varying] / np.outer(scale, scale)[varying], rtol=0, atol=1e-15
    )
    # a normal number and a uniform one: ρ √(3/π); a normal and a lognormal one: ρ σ/√(e^σ² - 1) of the logarithm's σ
    assert pearson[index["u"], index["n"]] == pytest.approx(0.5 * math.sqrt(3 / math.pi), rel=1e-12)
    assert pearson[index["l"], index["n"]] == pytest.approx(0.7 * math.sqrt(math.log(1.04)) / 0.2, rel=1e-12)
    assert covariance[index["uniform"], index["n"]] == 0
    none = Space()
    shapes = [
        found.shape for found in (none.sample(0, 0, 5), none.mean, none.covariance, none.inverse(np.zeros((0, 4))))
    ]
    assert shapes == [(0, 5), (0,), (0, 0), (0, 4)]


@pytest.mark.fast(2)
@pytest.mark.parametrize(
    ("seed", "first", "pose", "visit"),
    [(0, 0, 0, 0), (2**64 - 1, 7, 3, 9), (20150713, 2**33 - 3, 2**20 - 2, 4094), (2**32, 2**40, 0, 1)],
)
def test_every_law_scope_and_group_against_plain_python(seed: int, first: int, pose: int, visit: int) -> None:
    seen = LAW_SPACE.sample(seed, first, 6, pose=pose, visit=visit)
    for number, unit in enumerate(seen.T, start=first):
        expected = reference.reference_unit(LAW_SPACE, seed, number, pose, visit)
        np.testing.assert_allclose(unit, expected, rtol=0, atol=1e-13)


def test_any_slice_replays_the_same_bits() -> None:
    whole = LAW_SPACE.sample(5, 0, 100)
    for first, count in ((0, 1), (1, 1), (1, 2), (2, 5), (17, 83), (99, 1), (50, 0)):
        np.testing.assert_array_equal(LAW_SPACE.sample(5, first, count), whole[:, first : first + count])
    far = LAW_SPACE.sample(5, 2**40, 10)
    np.testing.assert_array_equal(LAW_SPACE.sample(5, 2**40 + 3, 4), far[:, 3:7])
    assert np.isfinite(TWO.sample(5, 2**64 - 2, 2)).all()


def test_adding_and_reordering_draws_and_groups_changes_no_other_draw() -> None:
    sampled = LAW_SPACE.sample(11, 3, 40)
    draws, groups = LAW_SPACE.draws, LAW_SPACE.correlations
    turned = Correlation(("t", "u", "l", "n"), tuple(tuple(MATRIX[i][j] for j in (2, 0, 3, 1)) for i in (2, 0, 3, 1)))
    new = (Draw("new", Uniform(1.0)), Draw("aa", Normal(1.0)))
    others = [
        Space(draws[::-1], groups[::-1]),
        Space(draws, (turned, *groups[1:])),
        Space((*new, *draws[4:], *draws[:4]), (Correlation.pair("new", "aa", 0.9), *groups)),
    ]
    for other in others:
        again = other.sample(11, 3, 40)
        for name in LAW_SPACE.components:
            np.testing.assert_array_equal(again[other.index[name]], sampled[LAW_SPACE.index[name]], err_msg=name)
    fewer = Space(draws, groups[1:]).sample(11, 3, 40)
    changed = [name for k, name in enumerate(LAW_SPACE.components) if (fewer[k] != sampled[k]).any()]
    assert changed == ["u", "n", "t"]  # "l" is first in the alphabet


def test_a_changed_law_keeps_the_numbers_behind_it() -> None:
    laws = (Uniform(1.0), Uniform(2.0), TwoPoint(1.0))
    one, twice, side = (Space((Draw("a", law), Draw("b", Normal(1.0)))).sample(1, 0, 50) for law in laws)
    np.testing.assert_allclose(twice[0], 2 * one[0], rtol=1e-15)
    np.testing.assert_array_equal(side[0], np.sign(one[0]))
    np.testing.assert_array_equal(twice[1], one[1])
    log = np.log(Space((Draw("b", Lognormal(3.0, 3.0)),)).sample(1, 0, 50)[0] / 3)
    np.testing.assert_allclose(log * math.log(2) ** -0.5 + math.log(2) ** 0.5 / 2, one[1], atol=1e-14)
    still = Space((Draw("a", Uniform(0.0)), Draw("b", Normal(1.0))), (Correlation.pair("a", "b", 0.5),))
    np.testing.assert_array_equal(still.pearson, np.eye(2))
    np.testing.assert_array_equal(still.sample(1, 0, 5)[0], np.zeros(5))


def test_occasions_are_the_numbers_of_the_design() -> None:
    assert occasion(Scope.UNIT, 5, 7) == 0
    assert [occasion(Scope.POSE, pose, 9) for pose in (0, 1, 2)] == [4096, 8192, 12288]
    assert [occasion(Scope.VISIT, 0, visit) for visit in (0, 1, 4094)] == [4097, 4098, 8191]
    assert occasion(Scope.VISIT, MOST_POSES - 1, MOST_VISITS - 1) == 2**32 - 1
    for scope in Scope:
        for pose, visit in ((-1, 0), (0, -1), (2**20 - 1, 0), (0, 4095), (2**40, 0)):
            with pytest.raises(InputError, match="whole number from 0"):
                occasion(scope, pose, visit)


def test_inverse_takes_every_law_by_its_inverse_and_groups_through_normal_scores() -> None:
    u = np.random.default_rng(6).uniform(size=(LAW_SPACE.size, 50))
    x, index, score = LAW_SPACE.inverse(u), LAW_SPACE.index, stats.norm.ppf(u)
    np.testing.assert_array_equal(x[0], np.full(50, -1.5))
    np.testing.assert_allclose(x[1], 1 + 2 * (2 * u[1] - 1), rtol=0, atol=1e-15)
    np.testing.assert_allclose(x[3], -3 + 0.5 * score[3], rtol=1e-15)
    np.testing.assert_allclose(np.hypot(x[5], x[6]), 2 * np.sqrt(u[5]), rtol=1e-15)
    joint = np.array([[1.0], [2], [3]]) + np.linalg.cholesky(np.array(COVARIANCE)) @ score[9:12]
    np.testing.assert_allclose(x[9:12], joint, rtol=0, atol=1e-14)
    names = ("l", "n", "t", "u")
    places = [("u", "n", "t", "l").index(name) for name in names]
    root = np.linalg.cholesky(np.array(MATRIX)[np.ix_(places, places)])
    z = dict(zip(names, root @ score[[index[name] for name in names]], strict=True))
    np.testing.assert_allclose(x[index["n"]], -1 + 0.4 * z["n"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(x[index["u"]], 1.5 + stats.norm.cdf(z["u"]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(x[index["t"]], stats.triang(0.5, -1, 2).ppf(stats.norm.cdf(z["t"])), rtol=0, atol=1e-13)


# ---- names and settings ----


def test_names_that_clash_are_refused() -> None:
    for draws in (
        (Draw("a", Uniform(1.0)), Draw("a", Uniform(1.0))),
        (Draw("p", Disc(1.0)), Draw("p.x", Uniform(1.0))),
        (Draw("p.1", Normal(1.0)), Draw("p", JointNormal(COVARIANCE))),
        (Draw("", Uniform(1.0)),),
    ):
        with pytest.raises(InputError, match="name"):
            Space(draws)


def test_including_shares_equal_draws_and_refuses_others() -> None:
    space = TWO.including([Draw("right", Normal(0.5)), Draw("new", Uniform(1.0))])
    assert space.components == ("left", "right", "new")
    assert LAW_SPACE.including([Draw("new", Uniform(1.0))]).correlations == LAW_SPACE.correlations
    for other in (Draw("left", Uniform(3.0, 2.0)), Draw("left", Uniform(1.0, 2.0), Scope.VISIT)):
        with pytest.raises(InputError, match="'left' is given twice"):
            TWO.including([other])


def test_settings_become_numbers_or_components() -> None:
    assert LAW_SPACE.parameter("disc.x") == Component("disc.x")
    for name, told in (("norml", "did you mean 'normal'"), ("disc", r"disc\.x")):
        with pytest.raises(UnknownNameError, match=told):
            LAW_SPACE.parameter(name)
    law, own, other = Uniform(1.0), Component("beam[l].EI"), Component("a1")
    view = LabelledSpace(Space(tuple(Draw(name, law) for name in ("a1", "beam[l].EI", "beam[l].EI[1]"))), "beam[l]")
    given = (2, "a1", law, Draw("", law), Draw("a1", law), Constant(3.0))
    assert [view.value("EI", one) for one in given] == [2.0, other, own, own, other, Constant(3.0)]
    assert view.values("EI", [law, law]) == (own, Component("beam[l].EI[1]"))
    assert view.component("EI") == own
    with pytest.raises(UnknownNameError, match="did you mean 'a1'"):
        view.value("EI", "a11")


def test_bad_seeds_and_units_are_refused() -> None:
    for seed in (-1, 2**64, 1.0, True, "0", None, math.nan):
        with pytest.raises(InputError, match="seed"):
            TWO.sample(seed, 0, 1)  # type: ignore[arg-type]
    for first, count in ((-1, 3), (0, -1), (2**64, 1), (2**64 - 1, 2)):
        with pytest.raises(InputError, match="whole number"):
            TWO.sample(0, first, count)
    for kind in (np.uint8, np.int32, np.uint64):
        np.testing.assert_array_equal(TWO.sample(kind(5), kind(3), kind(4)), TWO.sample(5, 3, 4))


@pytest.mark.slow
def test_draws_follow_their_laws_and_are_independent_of_their_neighbours_and_of_other_draws() -> None:
    """Each check has an error probability of 1e-6; scipy's laws, and correlations that are known by quadrature elsewhere."""
    count, limit = 100_000, stats.norm.isf(5e-7)
    x = LAW_SPACE.sample(20150713, 0, count)
    for name, law in {
        "uniform": stats.uniform(-1, 4),
        "triangular": stats.triang(0.5, -1, 2),
        "normal": stats.norm(-3, 0.5),
        "truncated": stats.truncnorm(-2.5, 2.5, 0.2, 1),
        "arcsine": stats.arcsine(-0.9, 1.4),
        "lognormal": stats.lognorm(math.sqrt(math.log(1.09)), scale=1 / math.sqrt(1.09)),
        "u": stats.uniform(1.5, 1),
        "cut": stats.truncnorm(-2.5, 2.5),
    }.items():
        assert stats.kstest(x[LAW_SPACE.index[name]], law.cdf, method="asymp").pvalue > 1e-6, name
    variance = np.diag(LAW_SPACE.covariance)
    rows = np.flatnonzero(variance)
    scores = (x[rows] - LAW_SPACE.mean[rows, None]) / np.sqrt(variance[rows, None])
    assert np.abs(scores.mean(axis=1)).max() < limit / math.sqrt(count)
    # the largest standard deviation that a product of two normal scores can have is √2
    off = np.abs(scores @ scores.T / count - LAW_SPACE.pearson[np.ix_(rows, rows)])
    assert off[~np.eye(len(rows), dtype=bool)].max() < limit * math.sqrt(2 / count)
    for lag in (1, 2, 256, 1024):
        assert np.abs((scores[:, lag:] * scores[:, :-lag]).mean(axis=1)).max() < limit / math.sqrt(count - lag), lag
