"""Philox4x32-10 against published vectors and plain integers; streams and their collisions."""

import itertools

import numpy as np
import pytest

from precision_pin.draws import philox
from support import philox_reference

KNOWN_ANSWERS = [  # Random123, kat_vectors, "philox4x32 10"
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]


def words(text: str) -> tuple[int, ...]:
    return tuple(int(word, 16) for word in text.split())


@pytest.mark.parametrize(("counter", "key", "expected"), KNOWN_ANSWERS)
def test_published_vectors(counter: str, key: str, expected: str) -> None:
    column = np.array(words(counter), dtype=np.uint64)[:, None]
    assert tuple(int(word) for word in philox.philox4x32(column, words(key))[:, 0]) == words(expected)
    assert philox_reference.philox_words(words(counter), words(key)) == words(expected)


def test_many_counters_against_plain_integers() -> None:
    counters = np.random.default_rng(3).integers(0, 2**32, size=(4, 200), dtype=np.uint64)
    key = (0x12345678, 0xFEDCBA98)
    seen = philox.philox4x32(counters, key)
    for column in range(counters.shape[1]):
        expected = philox_reference.philox_words(tuple(map(int, counters[:, column])), key)
        assert tuple(map(int, seen[:, column])) == expected


def test_uniform_by_hand_from_the_zero_vector() -> None:
    # seed, stream, occasion and pair zero: the words of the first known answer, the low word of each half first
    even_bits = 0xE169C58D6627E8D5
    odd_bits = 0x9B00DBD8BC57AC4C
    even, odd = philox.uniforms(0, 0, 0, 0, 1)[:, 0]
    assert even == (2 * (even_bits >> 12) + 1) / 2**53
    assert odd == (2 * (odd_bits >> 12) + 1) / 2**53


def test_uniform_by_hand_from_the_word_of_all_ones() -> None:
    # pair 2^64 - 1, stream and occasion 2^32 - 1, seed 2^64 - 1: the second known answer
    even, odd = philox.uniforms(2**64 - 1, 2**32 - 1, 2**32 - 1, 2**64 - 1, 1)[:, 0]
    assert even == (2 * (0x41C83B0E408F276D >> 12) + 1) / 2**53
    assert odd == (2 * (0x6D5451FDA20BC7C6 >> 12) + 1) / 2**53


@pytest.mark.parametrize("seed", [0, 1, 2**32, 2**63 + 12345, 2**64 - 1])
@pytest.mark.parametrize("first_pair", [0, 2**32 - 2, 2**40])
def test_uniforms_against_plain_integers(seed: int, first_pair: int) -> None:
    seen = philox.uniforms(seed, 0xDEADBEEF, 4097, first_pair, 5)
    expected = [philox_reference.pair_of_uniforms(seed, 0xDEADBEEF, 4097, first_pair + k) for k in range(5)]
    np.testing.assert_array_equal(seen, np.array(expected).T)


def test_uniforms_are_never_0_or_1_and_symmetric(monkeypatch: pytest.MonkeyPatch) -> None:
    def corners(counter: np.ndarray, key: tuple[int, int]) -> np.ndarray:
        column = np.array([0, 0, 0xFFFFFFFF, 0xFFFFFFFF], dtype=np.uint64)
        return np.repeat(column[:, None], counter.shape[1], axis=1)

    monkeypatch.setattr(philox, "philox4x32", corners)
    low, high = philox.uniforms(0, 0, 0, 0, 1)[:, 0]
    assert low == 2.0**-53
    assert high == 1 - 2.0**-53
    assert low + high == 1


def test_stream_is_the_start_of_blake2s() -> None:
    # RFC 7693, appendix B: BLAKE2s-256("abc") begins 50 8c 5e 8c
    assert philox.stream_of("abc") == 0x8C5E8C50
    assert philox.stream_of("axis_install[joint2].A.x") == philox_reference.stream("axis_install[joint2].A.x")
    assert philox.stream_of("größe") == philox_reference.stream("größe")


def test_streams_without_collision_are_those_of_the_names() -> None:
    names = [f"a{k}" for k in range(50)]
    assert philox.streams_of(names) == {name: philox_reference.stream(name) for name in names}


def test_collision_is_resolved_whatever_the_order(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed = {"ant": 7, "bee": 7, "cat": 7, "bee#1": 9, "cat#1": 7, "cat#2": 9, "cat#3": 11, "dog": 9, "dog#1": 12}
    monkeypatch.setattr(philox, "stream_of", hashed.__getitem__)
    # ant keeps 7; bee goes to 9; cat tries 7, 9, 11; dog's own 9 is taken by then, so that it goes to 12
    expected = {"ant": 7, "bee": 9, "cat": 11, "dog": 12}
    for order in itertools.permutations(expected):
        assert philox.streams_of(order) == expected


def test_a_name_given_twice_is_one_stream() -> None:
    assert philox.streams_of(["a", "a"]) == {"a": philox_reference.stream("a")}
