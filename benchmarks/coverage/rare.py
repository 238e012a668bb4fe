"""Intervals of the reliability analysis, on limit states whose probability of failure is known."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, final

import numpy as np
from scipy import integrate, special, stats

import precision_pin as pp
from benchmarks.coverage.row import Coverage
from precision_pin.analyses.reliability.estimates import Estimate, plain_estimate
from precision_pin.analyses.reliability.importance import rare_events
from precision_pin.base.arrays import Array
from precision_pin.draws import laws
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.robot import examples

__all__ = ["CASES", "Case", "estimates_of", "jump", "measure", "of_case"]


RUNS: Final = 1000
FEWER_RUNS: Final = 300
"""Where a run takes long, or another case asks nearly the same."""

ARM_RUNS: Final = 100

SAMPLES: Final = 100_000
CONFIDENCE: Final = 0.95


@final
@dataclass(frozen=True, eq=False)
class Case:
    """A limit state of known probability.

    Attributes:
        name: In words.
        space: Its draws.
        margin: What is left up to failure, for component values ``(d, N)``.
        probability: Of failure.
        truth: Where it comes from.
        runs: Seeds to try.
    """

    name: str
    space: Space
    margin: Callable[[Array], Array]
    probability: float
    truth: str
    runs: int = RUNS


def measure(share: float) -> list[Coverage]:
    """Return the coverage of each method's interval, of the one to go by, and how often that one is far off."""
    rows = [row for case in CASES for row in of_case(case, max(1, round(case.runs * share)))]
    return [*rows, *_of_the_papers_arm(max(1, round(ARM_RUNS * share)))]


def estimates_of(case: Case, seed: int) -> tuple[tuple[Estimate, ...], Estimate, bool]:
    """Return all estimates of one seed, the one to go by, and whether it is resolved."""
    generator = np.random.Generator(np.random.Philox((seed, 7)))
    plain = plain_estimate(int(generator.binomial(SAMPLES, case.probability)), SAMPLES, CONFIDENCE)
    starts = list(2 * generator.standard_normal((8, case.space.size)))
    found = rare_events(case.space, case.margin, starts, plain, seed, CONFIDENCE)
    return found.estimates, found.best, found.resolved


def of_case(case: Case, runs: int) -> list[Coverage]:
    """Return the coverage in one case."""
    return _rows(
        f"{case.name}, P {case.probability:.2g}",
        case.truth,
        case.probability,
        (estimates_of(case, s) for s in range(runs)),
    )


def _rows(
    name: str, truth: str, probability: float, found: Iterator[tuple[Sequence[Estimate], Estimate, bool]]
) -> list[Coverage]:
    held: dict[str, list[bool]] = {"importance sampling": [], "subset simulation": []}
    best, near, runs = list[bool](), list[bool](), 0
    for estimates, chosen, resolved in found:
        runs += 1
        for estimate in estimates[1:]:
            if estimate.resolved:
                held[estimate.method].append(_holds(estimate.interval, probability))
        if resolved:
            low, high = chosen.interval
            best.append(_holds(chosen.interval, probability))
            near.append(_holds((2 * low - high, 2 * high - low), probability))
    counted = {**held, "failure, the one to go by": best, "the same, off by less than its width": near}
    return [Coverage(what, name, truth, runs, len(hits), sum(hits)) for what, hits in counted.items()]


def _holds(interval: tuple[float, float], probability: float) -> bool:
    return interval[0] <= probability * (1 + 1e-12) and probability <= interval[1] * (1 + 1e-12)


# normal numbers ------------------------------------------------------------------------------------------------------


def _normals(count: int) -> Space:
    return Space(tuple(Draw(f"u{k}", laws.Normal(1.0)) for k in range(count)))


def _density(x: float) -> float:
    return math.exp(-(x**2) / 2) / math.sqrt(2 * math.pi)


def _tail(x: float) -> float:
    """Return the share of normal numbers above one; of single numbers scipy's takes a hundred times as long."""
    return math.erfc(x / math.sqrt(2)) / 2


def _plane(beta: float) -> Case:
    return Case(
        "plane in 4 numbers", _normals(4), lambda x: beta - x.sum(axis=0) / 2, float(stats.norm.sf(beta)), "closed form"
    )


def _sphere(size: int, probability: float) -> Case:
    radius = float(stats.chi(size).isf(probability))
    return Case(
        f"norm of {size} equal spreads",
        _normals(size),
        lambda x: radius - np.sqrt((x**2).sum(axis=0)),
        probability,
        "chi law",
    )


def _ellipsoid(spreads: tuple[float, float, float], radius: float) -> Case:
    # over directions: the radius is a chi number of 3, so P = mean of its tail at radius/|S n|
    z, weights = special.roots_legendre(200)
    angle = 2 * np.pi * (np.arange(400) + 0.5) / 400
    across = np.sqrt(1 - z**2)[:, None]
    parts = np.array([across * np.cos(angle), across * np.sin(angle), np.broadcast_to(z[:, None], (200, 400))])
    lengths = np.sqrt(((np.array(spreads)[:, None, None] * parts) ** 2).sum(axis=0))
    probability = float((weights / 2) @ stats.chi(3).sf(radius / lengths).mean(axis=1))
    return Case(
        f"norm of spreads {', '.join(map(str, spreads))}",
        _normals(3),
        lambda x: radius - np.sqrt(((np.array(spreads)[:, None] * x) ** 2).sum(axis=0)),
        probability,
        "quadrature over directions",
    )


def _four_branches(near: float, far: float) -> Case:
    root = math.sqrt(2)

    def margin(x: Array) -> Array:
        curved = near + 0.1 * (x[0] - x[1]) ** 2
        across, along = (x[0] - x[1]) / root, (x[0] + x[1]) / root
        value: Array = np.minimum(curved - np.abs(along), far - np.abs(across))
        return value

    inner = integrate.quad(lambda b: 2 * _density(b) * _tail(near + 0.2 * b**2), -far, far, epsabs=0, epsrel=1e-10)[0]
    return Case("four branches", _normals(2), margin, float(2 * stats.norm.sf(far) + inner), "quadrature")


def _parabola(curvature: float) -> Case:
    probability = integrate.quad(
        lambda b: _density(b) * _tail(5 + curvature * b**2), -12, 12, epsabs=0, epsrel=1e-10, limit=200
    )[0]
    return Case(
        f"5 {'+' if curvature > 0 else '-'} {abs(curvature):g} u₁² - u₀",
        _normals(2),
        lambda x: 5 + curvature * x[1] ** 2 - x[0],
        float(probability),
        "quadrature",
    )


def _aside() -> Case:
    shift = np.array([[1.0], [0.0], [0.0]])
    return Case(
        "norm of 3 equal spreads about a mean of one",
        _normals(3),
        lambda x: 6.2 - np.sqrt(((x + shift) ** 2).sum(axis=0)),
        float(stats.ncx2(3, 1).sf(6.2**2)),
        "non-central chi-square law",
    )


def _squares() -> Case:
    return Case(
        "u₀² + u₁², no spread at first order", _normals(2), lambda x: 28 - (x**2).sum(axis=0), math.exp(-14), "chi law"
    )


# laws that jump ------------------------------------------------------------------------------------------------------


def _of_sum(limit: float, spread: float, atoms: Sequence[tuple[float, float]]) -> float:
    """Return P(|a + spread·z| > limit) for atoms (probability, a)."""
    return math.fsum(p * (_tail((limit - a) / spread) + _tail((limit + a) / spread)) for p, a in atoms)


def _sum_margin(limit: float) -> Callable[[Array], Array]:
    return lambda x: limit - np.abs(x.sum(axis=0))


def jump(probability: float) -> Case:
    """Return one length that jumps rarely, and a normal number."""
    space = Space((Draw("jump", laws.TwoPoint(0.5, 0.5, probability)), Draw("z", laws.Normal(0.1))))
    exact = _of_sum(0.6, 0.1, [(1 - probability, 0.0), (probability, 1.0)])
    return Case(f"a jump of probability {probability:g}", space, _sum_margin(0.6), exact, "closed form")


def _two_jumps(probability: float) -> Case:
    draws = [Draw(f"jump{k}", laws.TwoPoint(0.2, 0.2, probability)) for k in range(3)]
    space = Space((*draws, Draw("z", laws.Normal(0.05))))
    exact = _of_sum(
        0.6, 0.05, [(math.comb(3, k) * probability**k * (1 - probability) ** (3 - k), 0.4 * k) for k in range(4)]
    )
    return Case(f"two of three jumps of {probability:g}", space, _sum_margin(0.6), exact, "closed form")


def _table_with_an_outlier(rows: int) -> Case:
    values = 0.1 * stats.norm.ppf((np.arange(rows) + 0.5) / rows)
    values[rows // 3] = 1.0
    space = Space((Draw("row", laws.Rows(tuple((float(v),) for v in values))), Draw("z", laws.Normal(0.1))))
    exact = _of_sum(0.9, 0.1, [(1 / rows, float(v)) for v in values])
    return Case(f"a table of {rows:,} rows with an outlier", space, _sum_margin(0.9), exact, "closed form")


def _nearly_a_jump() -> Case:
    law = laws.Empirical(((0.0, -0.1), (0.9999, 0.1), (0.99991, 1.0), (1.0, 1.0)))
    nodes, weights = special.roots_legendre(400)
    exact = 0.0
    for share, low, high in ((0.9999, -0.1, 0.1), (1e-5, 0.1, 1.0), (9e-5, 1.0, 1.0)):
        x = (low + high) / 2 + (high - low) / 2 * nodes
        exact += share * float(weights / 2 @ (stats.norm.sf((0.9 - x) / 0.1) + stats.norm.sf((0.9 + x) / 0.1)))
    space = Space((Draw("q", law), Draw("z", laws.Normal(0.1))))
    return Case("quantiles that rise steeply at 1 - 1e-4", space, _sum_margin(0.9), exact, "quadrature")


def _signs() -> Case:
    space = Space((*(Draw(f"side{k}", laws.TwoPoint(0.1)) for k in range(4)), Draw("z", laws.Normal(0.1))))
    exact = _of_sum(0.85, 0.1, [(math.comb(4, k) / 16, 0.1 * (2 * k - 4)) for k in range(5)])
    return Case("four signs and a normal number", space, _sum_margin(0.85), exact, "closed form")


# bounded and heavy laws ----------------------------------------------------------------------------------------------


def _uniforms() -> Case:
    space = Space(tuple(Draw(f"x{k}", laws.Uniform(1.0)) for k in range(6)))
    # Irwin-Hall: both corners beyond 6 - 2·0.25 of 6 half-widths
    exact = 2 * 0.25**6 / math.factorial(6)
    return Case("six uniform numbers", space, _sum_margin(5.5), exact, "Irwin-Hall law")


def _heavy() -> Case:
    space = Space(
        (Draw("a", laws.Lognormal(0.5, 1.0)), Draw("b", laws.Lognormal(0.5, 1.0)), Draw("z", laws.Normal(0.3)))
    )
    sigma = math.sqrt(math.log1p(0.25))
    law = stats.lognorm(sigma, scale=math.exp(-(sigma**2) / 2))
    nodes, weights = special.roots_legendre(400)
    z = 8.5 * nodes
    first = law.ppf(stats.norm.cdf(z[z < 0])).tolist() + law.isf(stats.norm.sf(z[z >= 0])).tolist()
    total = np.array(first)[:, None] + 0.3 * z
    inner = law.sf(9.0 - total)
    density = 8.5 * weights * stats.norm.pdf(z)
    exact = float(density @ inner @ density)
    return Case("two lognormal numbers and a normal one", space, lambda x: 9.0 - x.sum(axis=0), exact, "quadrature")


def _waves() -> Case:
    space = Space((Draw("a", laws.Arcsine(1.0)), Draw("b", laws.Arcsine(0.5)), Draw("z", laws.Normal(0.1))))
    nodes, weights = special.roots_legendre(400)
    first, second = np.sin(np.pi * nodes / 2), 0.5 * np.sin(np.pi * nodes / 2)
    total = first[:, None] + second
    tails = stats.norm.sf((1.9 - total) / 0.1) + stats.norm.sf((1.9 + total) / 0.1)
    exact = float((weights / 2) @ tails @ (weights / 2))
    return Case("two arcsine numbers and a normal one", space, _sum_margin(1.9), exact, "quadrature")


CASES: Final = (
    _sphere(2, 1e-4), _sphere(3, 1e-7), _ellipsoid((1.0, 0.97, 0.94), 6.0), _four_branches(4.9, 5.1), _squares(),
    jump(5e-5),
    *(
        replace(case, runs=FEWER_RUNS)
        for case in (
            _plane(3.09), _plane(4.26), _plane(5.2), _sphere(3, 1e-3), _sphere(3, 1e-5),
            _ellipsoid((1.0, 0.97, 0.94), 4.6), _ellipsoid((1.0, 0.5, 0.2), 5.2), _aside(), _four_branches(3.0, 3.5),
            _parabola(0.1), _parabola(-0.08), jump(1e-4), jump(1e-6), _two_jumps(1e-3), _table_with_an_outlier(2000),
            _nearly_a_jump(), _signs(), _uniforms(), _heavy(), _waves(),
        )
    ),
)  # fmt: skip


# a real arm ----------------------------------------------------------------------------------------------------------


def _of_the_papers_arm(runs: int) -> list[Coverage]:
    """Measure on the paper's arm; the truth is the mean of other seeds' importance sampling, which has no bias."""
    model = pp.ErrorModel.load(examples.PAPER_SHEET)
    demand = [pp.specification("x 18 mm @ 99.999 %")]
    found = partial(pp.reliability, model, demand, samples=2000)
    others = [
        found(seed=1_000_000 + s).poses[0].specifications[0].estimates[1].probability for s in range(max(40, runs))
    ]

    def results() -> Iterator[tuple[Sequence[Estimate], Estimate, bool]]:
        for seed in range(runs):
            entry = found(seed=seed).poses[0].specifications[0]
            yield entry.estimates, entry.best, entry.resolved

    probability = float(np.mean(others))
    return _rows(
        f"the paper's arm, dx beyond 18 mm, P {probability:.2g}", "mean of other seeds", probability, results()
    )
