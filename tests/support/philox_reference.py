"""The random numbers of a space, one at a time, in plain Python: written from the papers, not from the package.

Philox4x32-10: Salmon, Moraes, Dror, Shaw, SC11 (2011), section 3.3. The numbering (key, counter words, streams,
occasions) is that of the design's section on random numbers. Laws are inverted by scipy.stats.
"""

from __future__ import annotations

import hashlib
import itertools
import math

import numpy as np
from scipy import stats

from precision_pin.base.arrays import Array
from precision_pin.draws import laws
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space


def philox_words(counter: tuple[int, int, int, int], key: tuple[int, int]) -> tuple[int, int, int, int]:
    """Four 32-bit words of one counter."""
    r0, l0, r1, l1 = counter
    k0, k1 = key
    for round_ in range(10):
        if round_:
            k0, k1 = (k0 + 0x9E3779B9) % 2**32, (k1 + 0xBB67AE85) % 2**32
        high0, low0 = divmod(0xD2511F53 * r0, 2**32)
        high1, low1 = divmod(0xCD9E8D57 * r1, 2**32)
        r0, l0, r1, l1 = high1 ^ l0 ^ k0, low1, high0 ^ l1 ^ k1, low0
    return r0, l0, r1, l1


def pair_of_uniforms(seed: int, stream: int, occasion: int, pair: int) -> tuple[float, float]:
    """Uniform numbers of the even and of the odd unit of a pair."""
    words = philox_words((pair % 2**32, pair // 2**32, stream, occasion), (seed % 2**32, seed // 2**32))
    return tuple((2 * ((low + 2**32 * high) // 2**12) + 1) / 2**53 for low, high in (words[:2], words[2:]))  # type: ignore[return-value]


def stream(name: str) -> int:
    """Stream of a component's name, no collision considered."""
    first, second, third, fourth = hashlib.blake2s(name.encode("utf-8")).digest()[:4]
    return first + 256 * (second + 256 * (third + 256 * fourth))


def occasion(scope: Scope, pose: int, visit: int) -> int:
    """Last word of the counter."""
    return {Scope.UNIT: 0, Scope.POSE: (pose + 1) << 12, Scope.VISIT: ((pose + 1) << 12) + visit + 1}[scope]


def quantile(law: laws.Law, u: float) -> float:
    """Inverse of a scalar law's distribution function, by scipy.stats."""
    match law:
        case laws.Fixed(mean=mean):
            return mean
        case laws.Uniform(half_width=t, mean=mean):
            return float(stats.uniform.ppf(u, mean - t, 2 * t))
        case laws.Triangular(half_width=t, mean=mean):
            return float(stats.triang.ppf(u, 0.5, mean - t, 2 * t))
        case laws.TruncatedNormal(std=std, mean=mean, k=k):
            # scipy loses digits in the upper tail only
            lower = float(stats.truncnorm.ppf(min(u, 1 - u), -k, k, 0.0, std))
            return mean + (lower if u <= 0.5 else -lower)
        case laws.Arcsine(half_width=t, mean=mean):
            lower = float(stats.arcsine.ppf(min(u, 1 - u), -t, 2 * t))
            return mean + (lower if u <= 0.5 else -lower)
        case laws.TwoPoint(half_width=t, centre=centre, probability=probability):
            return centre - t if u <= 1 - probability else centre + t
        case laws.Empirical(quantiles=table):
            for (p, x), (q, y) in itertools.pairwise(table):
                if p <= u < q:
                    return x + (y - x) * (u - p) / (q - p)
            return table[-1][1]
    raise AssertionError(law)


def unit(space: Space, seed: int, number: int, pose: int = 0, visit: int = 0) -> Array:
    """Numbers ``(d,)`` of one unit; correlated ones by a Gaussian copula, made in alphabetical order."""
    values: list[float] = []
    scores: dict[str, float] = {}
    for correlation in space.correlations:
        order = sorted(correlation.names)
        places = [correlation.names.index(name) for name in order]
        root = np.linalg.cholesky(np.array(correlation.matrix)[np.ix_(places, places)])
        word = occasion(next(draw.scope for draw in space.draws if draw.name == order[0]), pose, visit)
        pairs = [pair_of_uniforms(seed, stream(name), word, number // 2) for name in order]
        turn = math.sin if number % 2 else math.cos
        normals = [math.sqrt(-2 * math.log(even)) * turn(2 * math.pi * odd) for even, odd in pairs]
        scores |= dict(zip(order, (root @ np.array(normals)).tolist(), strict=True))
    for draw in space.draws:
        word = occasion(draw.scope, pose, visit)
        pairs = [pair_of_uniforms(seed, stream(name), word, number // 2) for name in draw.components]
        own = [pair[number % 2] for pair in pairs]
        turn = math.sin if number % 2 else math.cos
        normals = [math.sqrt(-2 * math.log(even)) * turn(2 * math.pi * odd) for even, odd in pairs]
        if draw.name in scores:
            normals = [scores[draw.name]]
            own = [stats.norm.cdf(normals[0])]
        match draw.law:
            case laws.Normal(std=std, mean=mean):
                values.append(mean + std * normals[0])
            case laws.Lognormal(std=std, mean=mean):
                sigma = math.sqrt(math.log(1 + (std / mean) ** 2))
                values.append(mean * math.exp(sigma * normals[0]) / math.exp(sigma**2 / 2))
            case laws.Rows(table=rows):
                values += rows[int(own[0] * len(rows))]
            case laws.JointNormal():
                root = np.linalg.cholesky(np.array(draw.law.matrix))
                values += list(draw.law.mean_vector + root @ np.array(normals))
            case laws.Disc(radius=radius):
                z = radius * math.sqrt(own[0]) * complex(math.cos(2 * math.pi * own[1]), math.sin(2 * math.pi * own[1]))
                values += [z.real, z.imag]
            case laws.Circle(radius=radius):
                values += [radius * math.cos(2 * math.pi * own[1]), radius * math.sin(2 * math.pi * own[1])]
            case law:
                values.append(quantile(law, own[0]))
    return np.array(values)
