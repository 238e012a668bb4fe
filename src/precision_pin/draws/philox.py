"""Philox4x32-10, the counter-based random generator, as plain numpy.

Source: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11, 2011. A number depends only on
(seed, stream, occasion, unit): any sample can be computed alone, and the number of threads has no effect.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# constants of the paper: multipliers, Weyl increments of the key (golden ratio and √3 - 1, times 2³²), and ten rounds,
# of which six already pass the BigCrush tests
_MULTIPLIERS: Final = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL: Final = (0x9E3779B9, 0xBB67AE85)
_ROUNDS: Final = 10
_LOW: Final = np.uint64(0xFFFFFFFF)
_HALF: Final = np.uint64(32)
"""Mask and shift of the low and high word of a 64-bit product."""


def philox4x32(counter: NDArray[np.uint64], key: tuple[int, int]) -> NDArray[np.uint64]:
    """Return the four 32-bit words of each counter, ``(4, N)``, as 64-bit numbers; the key is two words below 2³²."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(_ROUNDS):
        first = _MULTIPLIERS[0] * c0
        second = _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (
            (second >> _HALF) ^ c1 ^ np.uint64(k0),
            second & _LOW,
            (first >> _HALF) ^ c3 ^ np.uint64(k1),
            first & _LOW,
        )
        k0 = (k0 + _WEYL[0]) & 0xFFFFFFFF
        k1 = (k1 + _WEYL[1]) & 0xFFFFFFFF
    return np.array([c0, c1, c2, c3])


def stream_of(name: str) -> int:
    """Return the stream of a name: the first 32 bits of its BLAKE2s digest, little-endian."""
    return int.from_bytes(hashlib.blake2s(name.encode()).digest()[:4], "little")


def streams_of(names: Iterable[str]) -> dict[str, int]:
    """Return the stream of every name; all streams differ."""
    # if two names have the same stream, the alphabetically later one is hashed as `name#1`, `name#2`, … until its stream
    # is unused, so that the order of the names never matters
    streams: dict[str, int] = {}
    used_streams: set[int] = set()
    for name in sorted(set(names)):
        stream, attempt = stream_of(name), 0
        while stream in used_streams:
            attempt += 1
            stream = stream_of(f"{name}#{attempt}")
        used_streams.add(stream)
        streams[name] = stream
    return streams


def uniforms(seed: int, stream: int | Sequence[int], occasion: int, first_pair: int, pairs: int) -> NDArray[np.float64]:
    """Return the uniform numbers of units ``2·first_pair … 2·(first_pair + pairs) - 1``.

    Args:
        stream: 32-bit word of each component of a draw; one or S of them.
        occasion: 32-bit word: 0 for unit scope, see :func:`precision_pin.draws.draw.occasion`.
        first_pair, pairs: The pairs of units (even, odd).

    Returns:
        ``(2, pairs)``, or for S streams in turn ``(2, S·pairs)``: row 0 the even units, row 1 the odd ones; each number
        is ``(2j+1)/2⁵³`` with j the top 52 of 64 bits, hence never 0 or 1 and symmetric about one half.
    """
    streams = np.repeat(np.array(stream, dtype=np.uint64), pairs)
    pair_indices = np.arange(first_pair, first_pair + pairs, dtype=np.uint64)
    index = np.resize(pair_indices, streams.size)
    counter = np.array([index & _LOW, index >> _HALF, streams, np.full_like(streams, occasion)])
    words = philox4x32(counter, (seed & 0xFFFFFFFF, seed >> 32))
    bits = np.array([words[0] | (words[1] << _HALF), words[2] | (words[3] << _HALF)])
    top_bits = (bits >> np.uint64(12)).astype(np.float64)
    return (2 * top_bits + 1) * 2.0**-53


def direction(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return cos 2πu and sin 2πu ``(2, N)`` for u in turns, 0 to 1; subtracting whole quarters first is exact."""
    quarters = np.rint(4 * turns)
    angle = 2 * np.pi * (turns - quarters / 4)
    cosine, sine = np.cos(angle), np.sin(angle)
    quadrants = quarters.astype(int) % 4
    return np.array(
        [np.choose(quadrants, [cosine, -sine, -cosine, sine]), np.choose(quadrants, [sine, cosine, -sine, -cosine])]
    )


@dataclass(frozen=True)
class Units:
    """The random numbers of units ``first … first + count - 1``, for a 64-bit seed."""

    seed: int
    first: int
    count: int

    def uniforms(self, streams: Sequence[int], word: int) -> NDArray[np.float64]:
        """Return uniform numbers of S streams ``(S, count)``."""
        return self._in_order(self._pairs(streams, word), len(streams))

    def normals(self, streams: Sequence[int], word: int) -> NDArray[np.float64]:
        """Return normal numbers ``(S, count)``: Box-Muller of each pair, cosine for the even unit, sine for the odd."""
        pairs = self._pairs(streams, word)
        return self._in_order(np.sqrt(-2 * np.log(pairs[0])) * direction(pairs[1]), len(streams))

    def _pairs(self, streams: Sequence[int], word: int) -> NDArray[np.float64]:
        first = self.first // 2
        return uniforms(self.seed, streams, word, first, (self.first + self.count + 1) // 2 - first)

    def _in_order(self, pairs: NDArray[np.float64], streams: int) -> NDArray[np.float64]:
        skipped = self.first % 2
        ordered: NDArray[np.float64] = pairs.T.reshape(streams, pairs.size // max(streams, 1))
        return ordered[:, skipped : skipped + self.count]
