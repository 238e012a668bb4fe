"""Checks of a sampler against the laws it claims to draw from; works on any engine.

A sampler is a function ``(seed, first, count) -> x (d, count)``. Statistical checks hold for each component alone at
error probability `ALPHA`; expected distributions come from scipy.stats and closed forms, not from the package. What a
check can see with N draws: a scale wrong by a share s where 2 s √(N / (κ - 1)) is well above 4.9 (κ the kurtosis), a
mean wrong by a share b of σ where b √N is. 0.2 % of σ therefore takes about 1.6e7 draws (z = 8), not 1e6 (z = 2).

The random numbers of a unit once more, one at a time, in plain Python: written from the papers, not from the package.
Philox4x32-10: Salmon, Moraes, Dror, Shaw, SC11 (2011), section 3.3. The numbering (key, counter words, streams,
occasions) is that of the design's section on random numbers. Laws are inverted by scipy.stats.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from precision_pin.base.arrays import Array
from precision_pin.draws import laws
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.space import Space

Sampler = Callable[[int, int, int], Array]

ALPHA = 1e-6
BLOCK = 2**18
TAILS = (1e-3, 1e-4, 3e-5)
MOST_DUPLICATES = 8
"""Among 1e6 numbers of 52 random bits 1e-4 are expected; rounding adds a few for a cosine."""

SLOPES = ((0.0, -1.0), (0.3, -0.2), (0.6, 0.0), (0.9, 0.3), (1.0, 2.0))
MEASURED = ((0.1, -0.3, 5.0), (0.2, 0.4, 4.0), (-0.1, 0.4, 4.5), (0.3, -0.3, 3.0), (0.1, 0.7, 5.0))
COVARIANCE = ((1.0, 0.5, 0.1), (0.5, 2.0, 0.3), (0.1, 0.3, 0.5))
MATRIX = ((1.0, 0.5, -0.3, 0.2), (0.5, 1.0, 0.1, 0.7), (-0.3, 0.1, 1.0, -0.2), (0.2, 0.7, -0.2, 1.0))
LAW_SPACE = Space(
    (
        Draw("fixed", laws.Fixed(-1.5)),
        Draw("uniform", laws.Uniform(2.0, 1.0)),
        Draw("triangular", laws.Triangular(1.0), Scope.POSE),
        Draw("normal", laws.Normal(0.5, -3.0), Scope.VISIT),
        Draw("truncated", laws.TruncatedNormal(1.0, 0.2, 2.5)),
        Draw("disc", laws.Disc(2.0)),
        Draw("circle", laws.Circle(3.0), Scope.VISIT),
        Draw("joint", laws.JointNormal(COVARIANCE, (1.0, 2.0, 3.0)), Scope.POSE),
        Draw("lognormal", laws.Lognormal(0.3, 1.0)),
        Draw("arcsine", laws.Arcsine(0.7, -0.2), Scope.POSE),
        Draw("two", laws.TwoPoint(0.5, 1.0, 0.3), Scope.VISIT),
        Draw("rows", laws.Rows(MEASURED)),
        Draw("single", laws.Rows(((1.0,), (2.0,), (4.0,))), Scope.POSE),
        Draw("u", laws.Uniform(0.5, 2.0)),
        Draw("n", laws.Normal(0.4, -1.0)),
        Draw("t", laws.Triangular(1.0)),
        Draw("l", laws.Lognormal(0.2, 1.0)),
        Draw("cut", laws.TruncatedNormal(1.0, 0.0, 2.5), Scope.VISIT),
        Draw("arc", laws.Arcsine(0.7), Scope.VISIT),
        Draw("side", laws.TwoPoint(0.5, 0.0, 0.3), Scope.POSE),
        Draw("seen", laws.Empirical(SLOPES), Scope.POSE),
    ),
    (
        Correlation(("u", "n", "t", "l"), MATRIX),
        Correlation.pair("cut", "arc", -0.8),
        Correlation.pair("seen", "side", 0.6),
    ),
)
"""Every law, every scope, and three groups of correlated draws."""


@dataclass(frozen=True)
class Marginal:
    """Distribution of one component: anything of scipy.stats with cdf and ppf, and its moments.

    ``values`` are those of a discrete one, with their probabilities.
    """

    name: str
    law: Any
    mean: float
    std: float
    kurtosis: float
    symmetric: bool = True
    values: tuple[tuple[float, float], ...] = ()

    @classmethod
    def discrete(cls, name: str, values: tuple[tuple[float, float], ...]) -> Marginal:
        mean = math.fsum(p * x for x, p in values)
        second, fourth = (math.fsum(p * (x - mean) ** k for x, p in values) for k in (2, 4))
        return cls(name, None, mean, math.sqrt(second), fourth / second**2, values=values)


def marginals(space: Space) -> Iterator[Marginal]:
    """Yield the expected distribution of each component, by row."""
    for draw in space.draws:
        for k, name in enumerate(draw.components):
            yield _marginal(name, draw.law, k)


def _marginal(name: str, law: laws.Law, k: int) -> Marginal:
    match law:
        case laws.Fixed(mean=mean):
            return Marginal(name, None, mean, 0.0, 0.0)
        case laws.Uniform(half_width=t, mean=mean):
            return Marginal(name, stats.uniform(mean - t, 2 * t), mean, t / math.sqrt(3), 1.8)
        case laws.Triangular(half_width=t, mean=mean):
            return Marginal(name, stats.triang(0.5, mean - t, 2 * t), mean, t / math.sqrt(6), 2.4)
        case laws.Normal(std=std, mean=mean):
            return Marginal(name, stats.norm(mean, std), mean, std, 3.0)
        case laws.TruncatedNormal(std=std, mean=mean, k=cut):
            frozen = stats.truncnorm(-cut, cut, mean, std)
            return Marginal(name, frozen, mean, float(frozen.std()), float(frozen.stats("k")) + 3)
        case laws.Disc(radius=r):
            # a coordinate of a point in a disc follows Wigner's semicircle
            return Marginal(name, stats.semicircular(0, r), 0.0, r / 2, 2.0)
        case laws.Circle(radius=r):
            return Marginal(name, stats.arcsine(-r, 2 * r), 0.0, r / math.sqrt(2), 1.5)
        case laws.JointNormal(matrix=matrix, centre=centre):
            mean = centre[k] if centre else 0.0
            std = math.sqrt(matrix[k][k])
            return Marginal(name, stats.norm(mean, std), mean, std, 3.0)
        case laws.Lognormal(std=std, mean=mean):
            square = math.log(1 + (std / mean) ** 2)
            frozen = stats.lognorm(math.sqrt(square), scale=mean * math.exp(-square / 2))
            kurtosis = math.exp(4 * square) + 2 * math.exp(3 * square) + 3 * math.exp(2 * square) - 3
            return Marginal(name, frozen, mean, std, kurtosis, symmetric=False)
        case laws.Arcsine(half_width=t, mean=mean):
            return Marginal(name, stats.arcsine(mean - t, 2 * t), mean, t / math.sqrt(2), 1.5)
        case laws.TwoPoint(half_width=t, centre=centre, probability=p):
            return Marginal.discrete(name, ((centre - t, 1 - p), (centre + t, p)))
        case laws.Empirical(quantiles=table):
            shares, ends = np.array(table).T
            frozen = stats.rv_histogram((np.diff(shares), ends), density=False)
            kurtosis = float(frozen.stats(moments="k")) + 3
            return Marginal(name, frozen, float(frozen.mean()), float(frozen.std()), kurtosis, symmetric=False)
        case laws.Rows(table=rows):
            column = [row[k] for row in rows]
            counts = tuple((x, column.count(x) / len(column)) for x in sorted(set(column)))
            return Marginal.discrete(name, counts)
    raise AssertionError(law)


def exact_failures(
    sampler: Sampler, space: Space, *, seed: int, units: range, tolerance: float = 1e-12, pose: int = 0, visit: int = 0
) -> list[str]:
    """Compare units with the plain Python reference, to ``tolerance`` of each component's size: sees any fault in them."""
    sampled = sampler(seed, units.start, len(units))
    failures = []
    for column, number in enumerate(units):
        expected = reference_unit(space, seed, number, pose, visit)
        for row, marginal in enumerate(marginals(space)):
            size = abs(marginal.mean) + marginal.std
            if not abs(sampled[row, column] - expected[row]) <= tolerance * size:
                failures.append(f"{marginal.name}: unit {number} is {sampled[row, column]}, expected {expected[row]}")
    return failures


def sampling_failures(sampler: Sampler, space: Space, *, seed: int = 20150713, count: int = 1_000_000) -> list[str]:
    """Return what is wrong with a sampler, one line each; empty if nothing was found."""
    x = np.concatenate([sampler(seed, k, min(BLOCK, count - k)) for k in range(0, count, BLOCK)], axis=1)
    if x.shape != (space.size, count) or not np.isfinite(x).all():
        return [f"shape {x.shape}, expected {(space.size, count)}, or numbers that are not finite"]
    failures = _moment_failures(x, space)
    for row, marginal in enumerate(marginals(space)):
        failures += _marginal_failures(marginal, x[row])
    failures += _dependence_failures(space, x)
    for draw, rows in zip(space.draws, space.slices, strict=True):
        failures += _joint_failures(draw.name, draw.law, x[rows])
    return failures + _replay_failures(sampler, seed, x)


def _moment_failures(x: Array, space: Space) -> list[str]:
    """Mean and variance against the known ones, by z-test."""
    limit, count = stats.norm.isf(ALPHA / 2), x.shape[1]
    failures = []
    for row, marginal in enumerate(marginals(space)):
        if marginal.std == 0:
            continue
        deviation = (x[row] - marginal.mean) / marginal.std
        bias = float(deviation.mean())
        if abs(bias) * math.sqrt(count) > limit:
            failures.append(f"{marginal.name}: the mean is off by {bias:.2%} of sigma")
        if marginal.kurtosis < 1 + 1e-9:
            continue  # two values alike likely: their counts say it all
        excess = float(deviation @ deviation) / count - 1
        if abs(excess) * math.sqrt(count / (marginal.kurtosis - 1)) > limit:
            failures.append(f"{marginal.name}: the variance is off by {excess:.2%}")
    return failures


def _marginal_failures(marginal: Marginal, x: Array) -> list[str]:
    """Kolmogorov's test, counts in the tails, equal numbers."""
    if marginal.values:
        return _value_failures(marginal, x)
    if marginal.law is None:
        return [] if (x == marginal.mean).all() else [f"{marginal.name}: a fixed number varies"]
    ordered = np.sort(x)
    failures = kolmogorov_failures(marginal.name, marginal.law.cdf(ordered))
    for tail in TAILS:
        for side, seen in (
            ("lower", np.searchsorted(ordered, marginal.law.ppf(tail))),
            ("upper", x.size - np.searchsorted(ordered, _upper_end(marginal, tail), side="right")),
        ):
            chance = 2 * min(stats.binom.cdf(seen, x.size, tail), stats.binom.sf(seen - 1, x.size, tail))
            if chance < ALPHA:
                failures.append(f"{marginal.name}: {seen} in the {side} tail of {tail}, expected {tail * x.size:.0f}")
    duplicates = int((np.diff(ordered) == 0).sum())
    if duplicates > MOST_DUPLICATES:
        failures.append(f"{marginal.name}: {duplicates} numbers come twice")
    return failures


def _upper_end(marginal: Marginal, tail: float) -> float:
    # reflected where it can be: scipy loses digits in some upper tails
    return float(2 * marginal.mean - marginal.law.ppf(tail) if marginal.symmetric else marginal.law.isf(tail))


def _value_failures(marginal: Marginal, x: Array) -> list[str]:
    """Every value as often as it should come, and no other."""
    failures = []
    for value, probability in marginal.values:
        # values that are computed, not stored, may be an ulp off
        seen = int((np.abs(x - value) <= 4e-16 * abs(value)).sum())
        chance = 2 * min(stats.binom.cdf(seen, x.size, probability), stats.binom.sf(seen - 1, x.size, probability))
        if chance < ALPHA:
            failures.append(f"{marginal.name}: {seen} times {value}, expected {probability * x.size:.0f}")
    known = np.array([value for value, _ in marginal.values])
    strange = int((np.abs(x[:, None] - known).min(axis=1) > 4e-16 * np.abs(known).max()).sum())
    return [*failures, f"{marginal.name}: {strange} numbers that are none of its values"] if strange else failures


def kolmogorov_failures(name: str, probabilities: Array) -> list[str]:
    """Kolmogorov's test of ordered probabilities, which should be uniform."""
    count = probabilities.size
    steps = np.arange(count + 1) / count
    distance = max((steps[1:] - probabilities).max(), (probabilities - steps[:-1]).max())
    # Massart's bound on the tail of Kolmogorov's statistic: never more often than ALPHA
    limit = math.sqrt(math.log(2 / ALPHA) / (2 * count))
    return [f"{name}: Kolmogorov distance {distance:.5f}, limit {limit:.5f}"] if distance > limit else []


def _dependence_failures(space: Space, x: Array) -> list[str]:
    """Correlation of every pair of components, and of every component with its neighbours in the sequence."""
    expected = list(marginals(space))
    rows = [row for row, marginal in enumerate(expected) if marginal.std > 0]
    scores = np.array([(x[row] - expected[row].mean) / expected[row].std for row in rows])
    known = np.array([[space.covariance[i, j] / (expected[i].std * expected[j].std) for j in rows] for i in rows])
    limit = stats.norm.isf(ALPHA / 2)
    failures = []
    count = x.shape[1]
    seen = scores @ scores.T / count
    for i, row in enumerate(rows):
        for j in range(i):
            # the largest standard deviation that a product of two normal scores can have is √2
            if abs(seen[i, j] - known[i, j]) * math.sqrt(count / 2) > limit:
                names = f"{expected[row].name} and {expected[rows[j]].name}"
                failures.append(f"{names}: correlation {seen[i, j]:.4f}, expected {known[i, j]:.4f}")
        for lag in (1, 2, 256, 1024):
            correlation = float(scores[i, lag:] @ scores[i, :-lag]) / (count - lag)
            if abs(correlation) * math.sqrt(count - lag) > limit:
                failures.append(f"{expected[row].name}: correlation {correlation:.4f} with the unit {lag} before")
    return failures


def _joint_failures(name: str, law: laws.Law, x: Array) -> list[str]:
    match law:
        case laws.Disc(radius=radius):
            return kolmogorov_failures(f"{name}: area", np.sort((x**2).sum(axis=0) / radius**2))
        case laws.Circle(radius=radius):
            off = np.abs(np.hypot(*x) - radius).max()
            return [f"{name}: {off} off the circle"] if off > 1e-15 * radius * 4 else []
        case laws.JointNormal(matrix=matrix):
            deviation = x - law.mean_vector[:, None]
            square = (deviation * np.linalg.solve(np.array(matrix), deviation)).sum(axis=0)
            return kolmogorov_failures(f"{name}: Mahalanobis distance", stats.chi2(len(matrix)).cdf(np.sort(square)))
    return []


def _replay_failures(sampler: Sampler, seed: int, x: Array) -> list[str]:
    """Any slice of units, drawn alone, is what it was in the whole; another seed is something else."""
    failures = []
    for first, count in ((0, 1), (1, 1), (1, 2), (255, 3), (4097, 700), (BLOCK - 1, 2)):
        if first + count <= x.shape[1] and not np.array_equal(sampler(seed, first, count), x[:, first : first + count]):
            failures.append(f"units {first} to {first + count - 1} drawn alone differ")
    other = sampler(seed + 1, 0, 1000)
    varied = [row for row in range(x.shape[0]) if np.unique(x[row, :1000]).size > 100]
    alike = [row for row in varied if (other[row] == x[row, :1000]).any()]
    if alike:
        failures.append(f"the next seed repeats numbers in rows {alike}")
    return failures


# ---- the reference in plain Python ----


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
    """Inverse of a scalar law's distribution function, by scipy.stats."""
    expected = _marginal("", law, 0)
    if isinstance(law, laws.TwoPoint):
        (low, share), (high, _) = expected.values
        return low if u <= share else high
    if expected.law is None:
        return expected.mean
    if not expected.symmetric:
        return float(expected.law.ppf(u))
    # scipy loses digits in some upper tails
    lower = float(expected.law.ppf(min(u, 1 - u)))
    return lower if u <= 0.5 else 2 * expected.mean - lower


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
            case law:
                values.append(reference_quantile(law, own[0]))
    return np.array(values)
