"""How often the intervals of plain sampling hold the truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, final

import numpy as np
from scipy import stats

from benchmarks.coverage.row import Coverage
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Law, Lognormal, Normal, TwoPoint
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling.blocks import planned
from precision_pin.sampling.table import statistic
from precision_pin.sources import JointOffset
from precision_pin.statistics import (
    Distribution,
    Plan,
    Specification,
    Summary,
    finish,
    observe,
    quantity_values,
    start,
)
from precision_pin.statistics.distribution import COMPONENT_LEVELS, CONTENTS

__all__ = ["measure", "of_law"]


COMPONENT_NAMES: Final = ("position.x", "position.y", "position.z", "attitude.x", "attitude.y", "attitude.z")
PILOT: Final = 512
TRUTH: Final = 4_000_000
"""Samples of the long run from which the truth of a sheet is taken, with a seed of its own."""
TRUTH_SEED: Final = 2**40
RUNS: Final = 10_000
RUNS_OF_SHEETS: Final = 1_000


@final
@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of one quantity.

    Attributes:
        mean, std: Of the law.
        modes: Every place that may be called its mode: one for a law of one peak, several for peaks alike, none where
            the density has none between its ends.
        below: P(value ≤ x).
        before: P(value < x).
    """

    mean: float
    std: float
    modes: tuple[float, ...]
    below: Callable[[float], float]
    before: Callable[[float], float]

    @cached_property
    def quantiles(self) -> dict[float, tuple[float, float]]:
        """The lowest and the highest p-quantile of every p reported, by halving."""
        return {p: (self._edge(p, self.below), self._edge(p, self.before)) for p in COMPONENT_LEVELS}

    def _edge(self, p: float, share: Callable[[float], float]) -> float:
        low, high = self.mean - 1e3 * self.std, self.mean + 1e3 * self.std
        while high - low > 1e-13 * self.std and low < (middle := (low + high) / 2) < high:
            # of a jump exactly as likely as p every value up to the next is a quantile
            past = share(middle) >= p - 1e-15 if share is self.below else share(middle) > p + 1e-15
            low, high = (low, middle) if past else (middle, high)
        return high if share is self.below else low

    def holds_quantile(self, ends: tuple[float, float], p: float) -> bool:
        """Return whether an interval holds a p-quantile, up to rounding."""
        lowest, highest = self.quantiles[p]
        rounding = 1e-12 * self.std
        return ends[1] >= lowest - rounding and ends[0] <= highest + rounding

    def holds_content(self, ends: tuple[float, float], content: float) -> bool:
        """Return whether so much of the law lies between two bounds."""
        return self.below(ends[1]) - self.before(ends[0]) >= content


class Tally:
    """Counts of runs, of intervals given and of intervals that hold the truth, by what they are of."""

    def __init__(self) -> None:
        self.runs, self.given, self.held = Counter[str](), Counter[str](), Counter[str]()

    def add(self, interval: str, *, given: bool, held: bool) -> None:
        """Count one interval."""
        self.runs[interval] += 1
        self.given[interval] += given
        self.held[interval] += given and held

    def add_distribution(self, found: Distribution, truth: Truth) -> None:
        """Count all intervals of one quantity."""
        for name, value in (("mean", truth.mean), ("standard deviation", truth.std)):
            ends = found.interval("std" if name != "mean" else name)
            self.add(name, given=ends is not None, held=ends is not None and _within(value, ends))
        peak = found.interval("mode")
        held = peak is not None and any(_within(one, peak) for one in truth.modes)
        self.add("mode", given=peak is not None, held=held)
        for p in found.levels:
            ends = found.quantile_interval(p)
            held = ends is not None and truth.holds_quantile(ends, p)
            self.add(f"quantile {100 * p:.4g} %", given=ends is not None, held=held)
        for content in CONTENTS:
            ends = found.tolerance_bounds(content)
            held = ends is not None and truth.holds_content(ends, content)
            self.add(f"bounds of {100 * content:.4g} %", given=ends is not None, held=held)
        shown: tuple[str | float, ...] = ("mean", "std", "mode", *found.levels)
        for which in shown:
            ends = found.interval(which)
            held = ends is not None and _within(float(statistic(found, which)), (1e3 * ends[0], 1e3 * ends[1]))
            self.add("digits printed", given=ends is not None, held=held)

    def rows(self, case: str, truth: str) -> list[Coverage]:
        """Return a line for each interval; of quantiles, and of bounds, for the one that holds the truth least often."""
        found = [
            Coverage(interval, case, truth, runs, self.given[interval], self.held[interval])
            for interval, runs in self.runs.items()
        ]
        for kind, together in (("quantile ", "quantiles, the worst"), ("bounds of ", "tolerance bounds, the worst")):
            same = [row for row in found if row.interval.startswith(kind)]
            if same:
                place = found.index(same[0])
                worst = min(same, key=lambda row: (row.share, row.given))
                found = [row for row in found if row not in same]
                found.insert(place, replace(worst, interval=together))
        return found


def measure(share: float) -> list[Coverage]:
    """Measure, with this share of the runs."""
    rows = []
    for name in _LAWS:
        often = RUNS if name in _OFTEN else RUNS // 5
        for samples, runs in ((300, RUNS // 10), (1_000, often), (20_000, RUNS // 10)):
            rows += of_law(name, samples, max(12, round(share * runs)))
    for name, at in _models():
        rows += _of_model(name, at, max(4, round(share * RUNS_OF_SHEETS)))
    for name, root, law in _PAIRS:
        rows += _of_pairs(name, root, law, 1_000, max(12, round(share * RUNS)))
    return rows


# laws that numpy draws: six components alike and independent in each run ---------------------------------------------


@final
@dataclass(frozen=True)
class Mixture:
    """Parts of a law, each with its probability; a part is a law of scipy or a value."""

    parts: tuple[tuple[float, Any], ...]

    def draw(self, random: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Return independent samples."""
        shares = np.array([share for share, _ in self.parts])
        which = random.choice(len(shares), size=shape, p=shares) if len(shares) > 1 else np.zeros(shape, dtype=int)
        values = np.empty(shape)
        for k, (_, part) in enumerate(self.parts):
            chosen = which == k
            values[chosen] = part if isinstance(part, float) else part.rvs(int(chosen.sum()), random_state=random)
        return values

    def truth(self, modes: tuple[float, ...]) -> Truth:
        """Return what follows from the parts in closed form."""
        shares = np.array([share for share, _ in self.parts])
        means = np.array([part if isinstance(part, float) else part.mean() for _, part in self.parts])
        variances = np.array([0.0 if isinstance(part, float) else part.var() for _, part in self.parts])
        mean = float(shares @ means)

        def below(x: float) -> float:
            return sum(p * float(part <= x if isinstance(part, float) else part.cdf(x)) for p, part in self.parts)

        def before(x: float) -> float:
            return sum(p * float(part < x if isinstance(part, float) else part.cdf(x)) for p, part in self.parts)

        return Truth(mean, math.sqrt(shares @ (variances + (means - mean) ** 2)), modes, below, before)


def _alone(law: Any) -> Mixture:
    return Mixture(((1.0, law),))


def _lognormal(spread: float) -> tuple[Mixture, tuple[float, ...]]:
    """Return the lognormal law of mean 1 and this standard deviation, and its mode."""
    square = math.log1p(spread**2)
    return _alone(stats.lognorm(math.sqrt(square), scale=math.exp(-square / 2))), (math.exp(-1.5 * square),)


_NORMAL = stats.norm()
_LAWS: Final[dict[str, tuple[Mixture, tuple[float, ...]]]] = {
    "normal": (_alone(_NORMAL), (0.0,)),
    "uniform": (_alone(stats.uniform(-1, 2)), ()),
    "exponential": (_alone(stats.expon()), ()),
    "lognormal 20 %": _lognormal(0.2),
    "lognormal 100 %": _lognormal(1.0),
    "Student, 5 degrees": (_alone(stats.t(5)), (0.0,)),
    "Student, 3 degrees": (_alone(stats.t(3)), (0.0,)),
    "X², one square": (_alone(stats.chi2(1)), ()),
    "X₁² + X₂²": (_alone(stats.chi2(2)), ()),
    "gamma, shape 4": (_alone(stats.gamma(4)), (3.0,)),
    "two values, 50:50": (Mixture(((0.5, -1.0), (0.5, 1.0))), (-1.0, 1.0)),
    "two peaks alike": (Mixture(((0.5, stats.norm(-3)), (0.5, stats.norm(3)))), (-3.0, 3.0)),
    "normal and a jump, 5 %": (Mixture(((0.95, _NORMAL), (0.05, stats.norm(20)))), (0.0,)),
}

_OFTEN: Final = ("normal", "lognormal 20 %", "Student, 5 degrees", "X₁² + X₂²", "two values, 50:50")
"""Laws with the full number of runs; the others have a fifth of it."""


def of_law(name: str, samples: int, runs: int) -> list[Coverage]:
    """Measure one of the laws by its name; six runs at a time."""
    law, modes = _LAWS[name]
    number = list(_LAWS).index(name)
    truth = law.truth(modes)
    limit = abs(truth.mean) + truth.std
    expected = truth.below(limit) - truth.before(-limit)
    tally = Tally()
    specifications = tuple(Specification(quantity, limit, 0.5) for quantity in COMPONENT_NAMES)
    for run in range(-(-runs // 6)):
        random = np.random.default_rng((number, samples, run))
        errors = law.draw(random, (6, samples))
        plan = Plan.from_pilot(quantity_values(errors[:, :PILOT]), np.zeros(6), specifications)
        found = finish(plan, observe(plan, start(plan), errors))
        for quantity in COMPONENT_NAMES:
            tally.add_distribution(found.distribution(quantity), truth)
        for result in found.specifications:
            tally.add("specification", given=True, held=_within(expected, result.interval))
        for i, j in ((0, 1), (2, 3), (4, 5)):
            _add_covariance(tally, "covariance of two", found, i, j, 0.0)
    return tally.rows(f"{name}, {samples:,} samples", "closed form")


def _add_covariance(tally: Tally, interval: str, found: Summary, i: int, j: int, truth: float) -> None:
    assert found.covariance_interval is not None
    ends = found.covariance_interval[i, j]
    given = not np.isnan(ends).any()
    tally.add(interval, given=given, held=given and _within(truth, (float(ends[0]), float(ends[1]))))


_PAIRS: Final = (
    ("normal, correlation 0.9", 0.9, _alone(_NORMAL)),
    ("normal, one the other's double", 1.0, _alone(_NORMAL)),
    ("Student, 5 degrees, correlation 0.9", 0.9, _alone(stats.t(5))),
    ("lognormal 20 %, correlation 0.9", 0.9, _lognormal(0.2)[0]),
)


def _of_pairs(name: str, correlation: float, law: Mixture, samples: int, runs: int) -> list[Coverage]:
    """Measure covariances of pairs, the second number of each being a mixture of the first and of one of its own."""
    tally = Tally()
    variance = law.truth(()).std ** 2
    rest = math.sqrt(1 - correlation**2)
    for run in range(-(-runs // 3)):
        drawn = law.draw(np.random.default_rng((len(name), samples, run)), (2, 3, samples))
        errors = np.empty((6, samples))
        errors[::2], errors[1::2] = drawn[0], 2 * (correlation * drawn[0] + rest * drawn[1])
        plan = Plan.from_pilot(quantity_values(errors[:, :PILOT]), np.zeros(6))
        found = finish(plan, observe(plan, start(plan), errors))
        for i in (0, 2, 4):
            _add_covariance(tally, "covariance of two", found, i, i + 1, 2 * correlation * variance)
    return tally.rows(f"{name}, {samples:,} samples", "closed form")


# arms ----------------------------------------------------------------------------------------------------------------


def _models() -> list[tuple[str, PoseModel]]:
    """Return the shipped sheets, and joint offsets of the paper's arm, stretched along its axes."""
    paper = ErrorModel.load(PAPER_SHEET)
    stretched = np.radians([0.0, 90.0, 0.0, 0.0])
    offset = 1e-3
    found = [
        (name, ErrorModel.load(PAPER_SHEET.parent / f"{name}.errors.yaml").at(None))
        for name in ("4dof", "ur5", "panda", "xarm7")
    ]
    laws: tuple[tuple[str, tuple[Law, ...]], ...] = (
        ("offsets of spreads 1, 0.2, 0.1, stretched", (Normal(1e-3), Normal(2e-4), Normal(1e-4))),
        ("offsets, stretched", (Normal(offset),)),
        ("lognormal offsets of 100 %", (Lognormal(offset, offset),)),
        ("offsets that jump in 1 of 10", (TwoPoint(offset, offset, probability=0.1),)),
        ("offsets that jump in 1 of 1,000", (TwoPoint(offset, offset, probability=1e-3),)),
    )
    for name, kinds in laws:
        draws = tuple(Draw(f"o{k}", kinds[k % len(kinds)]) for k in range(len(paper.chain.joint_names)))
        offsets: Any = JointOffset  # the type checker does not see a source's settings
        sources = [
            offsets(joint=joint, offset=draw.name) for joint, draw in zip(paper.chain.joint_names, draws, strict=True)
        ]
        found.append((name, ErrorModel(paper.chain, Space(draws), sources).at(stretched)))
    return found


def _of_model(name: str, at: PoseModel, runs: int) -> list[Coverage]:
    """Measure an error model at a pose, norms and components apart; the truth is a longer run's of another seed."""
    layout = sampler.to_arrays(at)
    values = quantity_values(sampler.errors(layout, "exact", TRUTH_SEED, 0, TRUTH))
    truths = [_sampled(row, is_norm=k % 4 == 0) for k, row in enumerate(values)]
    parts, norms = Tally(), Tally()
    for seed in range(runs):
        plan = planned(at, layout, "exact", seed)
        found = finish(plan, sampler.observe_blocks(layout, plan, "exact", seed, 0, 1).add_to(start(plan)))
        for row, truth in enumerate(truths):
            quantity = ("position", "attitude")[row // 4] + "." + ("norm", "x", "y", "z")[row % 4]
            distribution = found.distribution(quantity)
            if truth.std > 1e-12:
                (parts if row % 4 else norms).add_distribution(distribution, truth)
    case = f"{name}, {BLOCK:,} samples"
    return [
        *norms.rows(f"norms of {case}", f"{TRUTH:,} samples"),
        *parts.rows(f"components of {case}", f"{TRUTH:,} samples"),
    ]


def _sampled(values: Array, *, is_norm: bool) -> Truth:
    """Return what many samples tell."""
    rising = np.sort(values)

    def below(x: float) -> float:
        return float(np.searchsorted(rising, x, side="right")) / rising.size

    def before(x: float) -> float:
        return float(np.searchsorted(rising, x, side="left")) / rising.size

    return Truth(float(values.mean()), float(values.std()), (_mode(rising, is_norm=is_norm),), below, before)


def _mode(rising: Array, *, is_norm: bool) -> float:
    """Return where many sorted samples lie densest, smoothed by a twentieth of their spread: a bias below a hundredth."""
    low, quarter, three_quarters, high = rising[[int(p * (rising.size - 1)) for p in (0.001, 0.25, 0.75, 0.999)]]
    width = 0.05 * min(float(rising.std()), (three_quarters - quarter) / 1.349 or math.inf)
    low = 0.0 if is_norm else low
    edges = np.linspace(low, high, max(2, min(math.ceil((high - low) / width * 8), 2**20)) + 1)
    counts = np.histogram(rising, edges)[0].astype(float)
    if is_norm:
        counts = np.concatenate([counts[::-1], counts])
    step = edges[1] - edges[0]
    offsets = np.arange(-40, 41) * step
    smooth = np.convolve(counts, np.exp(-0.5 * (offsets / width) ** 2), mode="same")[-(edges.size - 1) :]
    top = int(np.argmax(smooth))
    # the middle one of the samples there, which is the value itself where many are alike
    inside = rising[np.searchsorted(rising, edges[top]) : np.searchsorted(rising, edges[top + 1], side="right")]
    return float(np.median(inside))


def _within(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] <= value <= ends[1]
