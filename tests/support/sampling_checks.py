"""The random numbers of a unit once more, one at a time, in plain Python: written from the papers, not from the package.

Philox4x32-10: Salmon, Moraes, Dror, Shaw, SC11 (2011), section 3.3. The numbering (key, counter words, streams,
occasions) is that of the design's section on random numbers. Laws are inverted by scipy.stats.
"""

import hashlib
import itertools
import math

import numpy as np
from scipy import stats

from precision_pin.base.arrays import Array
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import (
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Fixed,
    JointNormal,
    Lognormal,
    Normal,
    Rows,
    Sphere,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.space import Space

SLOPES = ((0.0, -1.0), (0.3, -0.2), (0.6, 0.0), (0.9, 0.3), (1.0, 2.0))
MEASURED = ((0.1, -0.3, 5.0), (0.2, 0.4, 4.0), (-0.1, 0.4, 4.5), (0.3, -0.3, 3.0), (0.1, 0.7, 5.0))
COVARIANCE = ((1.0, 0.5, 0.1), (0.5, 2.0, 0.3), (0.1, 0.3, 0.5))
MATRIX = ((1.0, 0.5, -0.3, 0.2), (0.5, 1.0, 0.1, 0.7), (-0.3, 0.1, 1.0, -0.2), (0.2, 0.7, -0.2, 1.0))
LAW_SPACE = Space(
    (
        Draw("fixed", Fixed(-1.5)),
        Draw("uniform", Uniform(2.0, 1.0)),
        Draw("triangular", Triangular(1.0), Scope.POSE),
        Draw("normal", Normal(0.5, -3.0), Scope.VISIT),
        Draw("truncated", TruncatedNormal(1.0, 0.2, 2.5)),
        Draw("disc", Disc(2.0)),
        Draw("circle", Circle(3.0), Scope.VISIT),
        Draw("joint", JointNormal(COVARIANCE, (1.0, 2.0, 3.0)), Scope.POSE),
        Draw("lognormal", Lognormal(0.3, 1.0)),
        Draw("arcsine", Arcsine(0.7, -0.2), Scope.POSE),
        Draw("two", TwoPoint(0.5, 1.0, 0.3), Scope.VISIT),
        Draw("rows", Rows(MEASURED)),
        Draw("single", Rows(((1.0,), (2.0,), (4.0,))), Scope.POSE),
        Draw("u", Uniform(0.5, 2.0)),
        Draw("n", Normal(0.4, -1.0)),
        Draw("t", Triangular(1.0)),
        Draw("l", Lognormal(0.2, 1.0)),
        Draw("cut", TruncatedNormal(1.0, 0.0, 2.5), Scope.VISIT),
        Draw("arc", Arcsine(0.7), Scope.VISIT),
        Draw("side", TwoPoint(0.5, 0.0, 0.3), Scope.POSE),
        Draw("seen", Empirical(SLOPES), Scope.POSE),
        Draw("sphere", Sphere(2.0), Scope.VISIT),
    ),
    (
        Correlation(("u", "n", "t", "l"), MATRIX),
        Correlation.pair("cut", "arc", -0.8),
        Correlation.pair("seen", "side", 0.6),
    ),
)
"""Every law, every scope, and three groups of correlated draws."""


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


def reference_quantile(law: laws.Law, u: float) -> float:
    """Inverse of a scalar law's distribution function, by scipy.stats, which loses digits in some upper tails."""
    lower = min(u, 1 - u)
    match law:
        case laws.Fixed(mean=mean):
            return mean
        case laws.Uniform(half_width=t, mean=mean):
            return float(stats.uniform.ppf(u, mean - t, 2 * t))
        case laws.Triangular(half_width=t, mean=mean):
            return float(stats.triang.ppf(u, 0.5, mean - t, 2 * t))
        case laws.TruncatedNormal(std=std, mean=mean, k=k):
            return mean + math.copysign(float(stats.truncnorm.ppf(lower, -k, k, 0.0, std)), u - 0.5)
        case laws.Arcsine(half_width=t, mean=mean):
            return mean + math.copysign(float(stats.arcsine.ppf(lower, -t, 2 * t)), u - 0.5)
        case laws.TwoPoint(half_width=t, centre=centre, probability=probability):
            return centre - t if u <= 1 - probability else centre + t
        case laws.Empirical(quantiles=table):
            for (p, x), (q, y) in itertools.pairwise(table):
                if p <= u < q:
                    return x + (y - x) * (u - p) / (q - p)
            return table[-1][1]
    raise AssertionError(law)


def reference_unit(space: Space, seed: int, number: int, pose: int = 0, visit: int = 0) -> Array:
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
            case laws.Sphere(radius=radius):
                z, turn = 2 * own[2] - 1, 2 * math.pi * own[1]
                values += [radius * math.sqrt(1 - z * z) * part for part in (math.cos(turn), math.sin(turn))]
                values.append(radius * z)
            case law:
                values.append(reference_quantile(law, own[0]))
    return np.array(values)
