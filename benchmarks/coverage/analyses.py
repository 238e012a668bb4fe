"""How often the intervals and bounds of budget, moments, exact law and worst case hold the truth.

Sums of sliding joints' errors are linear, so that the truth is in closed form; of swinging arms too. Quantiles, and all of the
shipped sheets, come from long runs of plain numpy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Final

import numpy as np

import precision_pin as pp
from benchmarks.coverage.row import Coverage
from precision_pin.analyses.exact_law.exact_law import LEVELS
from precision_pin.analyses.moments.moments import Measured, Method
from precision_pin.analyses.supports import Supports
from precision_pin.base.arrays import Array
from precision_pin.draws import laws
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.urdf import parse
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.statistics.intervals import Estimate

__all__ = ["measure"]

Interval = tuple[float, float] | None
Found = Mapping[str, tuple[float, Interval]]

CLOSED: Final = "closed form"
LONG: Final = "long run of plain numpy"
CONTROL: Final = "a control variate on 1,048,576 other samples"
ROUNDING: Final = 1e-9
LONG_SAMPLES: Final = 4_000_000
HIGH: Final = 0.95
"""Probability of a budget's quantiles."""


def measure(share: float) -> list[Coverage]:
    """Return the coverage of every interval of these analyses.

    Args:
        share: Of the runs: 1 is a thousand budgets and five hundred moments of each small arm, a hundred of each
            shipped sheet.
    """
    runs, few = max(5, round(1000 * share)), max(2, round(100 * share))
    rows = [row for case in BUDGETS for row in _budget(case, runs)]
    rows += [row for case in SWINGS for row in _swinging_budget(case, runs)]
    for sheet in ("4dof", "ur5", "panda", "xarm7"):
        rows += _shipped(sheet, few, long=share > 0.1)
    for case in BUDGETS:
        for method in ("plain", "sobol"):
            rows += _linear_moments(case, method, max(5, runs // 2))
    for reach, method in itertools.product((0.1, 0.3), ("control", "sobol-control", "plain", "sobol")):
        rows += _swinging_moments(reach, method, max(5, runs // 2))
    return [*rows, *_laws(runs), _vertices(few)]


def _tally(case: str, truth: str, runs: int, one: Callable[[int], Found]) -> list[Coverage]:
    counts: dict[str, list[int]] = {}
    for seed in range(runs):
        for name, (value, interval) in one(seed).items():
            count = counts.setdefault(name, [0, 0])
            if interval is not None:
                slack = ROUNDING * max(abs(value), abs(interval[0]))
                count[0] += 1
                count[1] += interval[0] - slack <= value <= interval[1] + slack
    return [Coverage(name, case, truth, runs, given, held) for name, (given, held) in counts.items()]


# arms ----------------------------------------------------------------------------------------------


def _robot(kinds: tuple[str, ...], axis: str, tool: str) -> Chain:
    names = ["base", *(f"link{k}" for k in range(1, len(kinds))), "wrist"]
    parts = [f'<link name="{name}"/>' for name in (*names, "tool")]
    for k, kind in enumerate(kinds):
        parts.append(
            f'<joint name="joint{k + 1}" type="{kind}"><parent link="{names[k]}"/><child link="{names[k + 1]}"/>'
            f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    parts.append(
        f'<joint name="bolt" type="fixed"><parent link="wrist"/><child link="tool"/><origin xyz="{tool}"/></joint>'
    )
    text = f'<robot name="arm">{"".join(parts)}</robot>'
    return Chain.from_robot(parse(text.encode(), "arm.urdf"), tip="tool", gravity=(0, 0, 0))


def _model(chain: Chain, *summed: laws.Law) -> ErrorModel:
    space = Space(tuple(Draw(f"p{k}", law) for k, law in enumerate(summed)))
    offsets = [JointOffset(joint=f"joint{k + 1}", offset=f"p{k}") for k in range(len(summed))]
    return ErrorModel(chain, space, offsets, {"rest": np.zeros(len(summed))})


@dataclass(frozen=True)
class _Linear:
    """Two sliding joints along x: the error is the sum of their offsets, m."""

    name: str
    first: laws.Law
    second: laws.Law

    @property
    def model(self) -> ErrorModel:
        return _model(_robot(("prismatic", "prismatic"), "1 0 0", "0 0 0"), self.first, self.second)

    @property
    def variances(self) -> tuple[float, float]:
        return float(self.first.covariance[0, 0]), float(self.second.covariance[0, 0])


MM: Final = 1e-3
BUDGETS: Final = (
    _Linear("normal", laws.Normal(1 * MM), laws.Normal(0.5 * MM)),
    _Linear("lognormal 20 % and normal", laws.Lognormal(0.2 * MM, 1 * MM), laws.Normal(0.1 * MM)),
    _Linear("lognormal 100 % and normal", laws.Lognormal(1 * MM, 1 * MM), laws.Normal(0.3 * MM)),
    _Linear("lognormal 300 % alone", laws.Lognormal(3 * MM, 1 * MM), laws.Fixed(0.0)),
    _Linear("two-point, 50 %, and normal", laws.TwoPoint(1 * MM), laws.Normal(0.2 * MM)),
    _Linear("two-point, 5 %, and normal", laws.TwoPoint(1 * MM, 0.0, 0.05), laws.Normal(0.2 * MM)),
    _Linear("two-point, 0.001 %, and normal", laws.TwoPoint(1 * MM, 0.0, 1e-5), laws.Normal(0.1 * MM)),
    _Linear("arcsine, twice", laws.Arcsine(1 * MM), laws.Arcsine(0.3 * MM)),
)


def _numbers(law: laws.Law, seed: int) -> Array:
    uniforms = np.random.default_rng([seed, 7]).random((1, LONG_SAMPLES))
    return law.inverse(uniforms)[0]


def _interval(estimate: Estimate | None) -> Interval:
    return None if estimate is None else estimate.interval


# budget --------------------------------------------------------------------------------------------


def _budget(case: _Linear, runs: int) -> list[Coverage]:
    model = case.model
    one, other = case.variances
    first, second = _numbers(case.first, 1), _numbers(case.second, 2)
    whole = float(np.quantile(np.abs(first + second), HIGH))
    mean = float(case.first.mean_vector[0])
    less = float(np.quantile(np.abs(mean + (first - mean) / 2 + second), HIGH))

    def found(seed: int) -> dict[str, tuple[float, Interval]]:
        pose = pp.budget(model, samples=1024, seed=seed).poses[0]
        group, halved, sums = pose.group("p0"), pose.draw("p0").halved, pose.sums["position.x"]
        return {
            "budget: first-order index": (one / (one + other), _interval(group.first["position.x"])),
            "budget: total index": (one / (one + other), _interval(group.total["position.x"])),
            "budget: sum of first-order indices": (1.0, _interval(sums.first)),
            "budget: variance": (one + other, _interval(sums.variance)),
            "budget: 95 % quantile": (whole, _interval(pose.quantile["position.norm"])),
            "budget: quantile, tolerance halved": (less, _interval(halved.quantile["position.norm"])),
            "budget: its change": (less - whole, _interval(halved.change["position.norm"])),
        }

    return _tally(f"{case.name}, 1,024 points", f"{CLOSED}; quantiles: {LONG}", runs, found)


SWINGS: Final = (("uniform", laws.Uniform), ("normal", laws.Normal))


def _swinging_budget(case: tuple[str, Callable[[float], laws.Law]], runs: int) -> list[Coverage]:
    """Return the coverage for two aligned swivels, arm 1 m along x: dx = cos(a + b) - 1 has no first order.

    With c = cos a and s = sin a of either angle alone, E cos a cos b and the like are products: V and the conditional
    variance follow from E c, E c², E s².
    """
    name, law = case
    reach = 0.02
    model = _model(_robot(("revolute", "revolute"), "0 0 1", "1 0 0"), law(reach), law(reach))
    # of cos and cos 2·: uniform ±r, normal σ
    c, double = (
        (math.sin(reach) / reach, math.sin(2 * reach) / (2 * reach))
        if name == "uniform"
        else (math.exp(-(reach**2) / 2), math.exp(-2 * reach**2))
    )
    variance = (1 + double**2) / 2 - c**4
    first = c**2 * ((1 + double) / 2 - c**2)

    def found(seed: int) -> dict[str, tuple[float, Interval]]:
        pose = pp.budget(model, [0.0, 0.0], samples=1024, seed=seed).poses[0]
        group = pose.group("p0")
        return {
            "budget: first-order index": (first / variance, _interval(group.first["position.x"])),
            "budget: total index": (1 - first / variance, _interval(group.total["position.x"])),
            "budget: variance": (variance, _interval(pose.sums["position.x"].variance)),
        }

    return _tally(f"1 - cos of the sum of two {name} angles, 1,024 points", CLOSED, runs, found)


def _shipped(sheet: str, runs: int, *, long: bool) -> list[Coverage]:
    """Return the coverage of budget and moments on a shipped sheet, of the draw with the largest share."""
    model = pp.ErrorModel.load(PAPER_SHEET.parent / f"{sheet}.errors.yaml")
    at = model.at()
    draw = max(pp.budget(model, samples=1024).poses[0].draws, key=lambda line: line.share["position"] or 0.0).name
    rows = at.space.slices[[one.name for one in at.space.draws].index(draw)]
    count = LONG_SAMPLES // 4 if long else LONG_SAMPLES // 40
    layout = sampler.to_arrays(at)
    generator = np.random.default_rng(5)
    parts: list[tuple[Array, Array, Array]] = []
    for _ in range(10):
        x, others = (at.space.inverse(generator.random((at.space.size, count // 10))) for _ in range(2))
        less, changed = x.copy(), x.copy()
        less[rows] = (x[rows] + at.space.mean[rows, None]) / 2
        changed[rows] = others[rows]
        parts.append(tuple(sampler.errors_at(layout, "exact", numbers)[:3] for numbers in (x, less, changed)))  # type: ignore[arg-type]
    errors, halved, mixed = (np.concatenate([part[k] for part in parts], axis=1) for k in range(3))
    variance = float(errors.var(axis=1).sum())
    total = float(((errors - mixed) ** 2).mean(axis=1).sum()) / 2 / variance
    norms = np.linalg.norm(errors, axis=0)
    whole, less_far = float(np.quantile(norms, HIGH)), float(np.quantile(np.linalg.norm(halved, axis=0), HIGH))

    def found(seed: int) -> dict[str, tuple[float, Interval]]:
        pose = pp.budget(model, samples=1024, seed=seed).poses[0]
        line = pose.draw(draw).halved
        return {
            "budget: total index": (total, _interval(pose.group(draw).total["position"])),
            "budget: variance": (variance, _interval(pose.sums["position"].variance)),
            "budget: 95 % quantile": (whole, _interval(pose.quantile["position.norm"])),
            "budget: its change, tolerance halved": (less_far - whole, _interval(line.change["position.norm"])),
        }

    rows_found = _tally(f"{sheet}, 1,024 points", LONG, runs, found)

    precise = pp.moments(model, samples=2**20 if long else 2**14, seed=10**6, method="control").poses[0]
    assert precise.norm_mean is not None
    assert precise.norm_std is not None
    mean, std = float(precise.norm_mean.value[0]), float(precise.norm_std.value[0])

    def moments(method: Method) -> Callable[[int], dict[str, tuple[float, Interval]]]:
        def found(seed: int) -> dict[str, tuple[float, Interval]]:
            pose = pp.moments(model, samples=1024, seed=seed, method=method).poses[0]
            assert pose.norm_mean is not None
            assert pose.norm_std is not None
            return {
                f"moments, {method}: mean of |d|": (mean, pose.norm_mean.interval(0)),
                f"moments, {method}: std of |d|": (std, pose.norm_std.interval(0)),
            }

        return found

    methods: tuple[Method, ...] = ("plain", "sobol")
    return rows_found + [
        row for method in methods for row in _tally(f"{sheet}, 1,024 samples", CONTROL, runs, moments(method))
    ]


# moments -------------------------------------------------------------------------------------------


def _linear_moments(case: _Linear, method: Method, runs: int) -> list[Coverage]:
    model = case.model
    mean = float(case.first.mean_vector[0] + case.second.mean_vector[0])
    variance = sum(case.variances)

    def found(seed: int) -> dict[str, tuple[float, Interval]]:
        pose = pp.moments(model, samples=1024, seed=seed, method=method).poses[0]
        return {
            f"moments, {method}: mean": (mean, pose.mean.interval(0)),
            f"moments, {method}: standard deviation": (math.sqrt(variance), pose.std.interval(0)),
        }

    return _tally(f"{case.name}, 1,024 samples", CLOSED, runs, found)


def _swinging_moments(spread: float, method: Method, runs: int) -> list[Coverage]:
    """Return the coverage for one swivel of normal error, arm 1 m along x: dx = cos θ - 1, dy = sin θ."""
    model = _model(_robot(("revolute",), "0 0 1", "1 0 0"), laws.Normal(spread))
    c, double = math.exp(-(spread**2) / 2), math.exp(-2 * spread**2)

    def found(seed: int) -> dict[str, tuple[float, Interval]]:
        pose = pp.moments(model, [0.0], samples=4096, seed=seed, method=method).poses[0]
        covariance: Measured = pose.covariance
        return {
            f"moments, {method}: mean": (c - 1, pose.mean.interval(0)),
            f"moments, {method}: variance": ((1 - double) / 2, covariance.interval(1, 1)),
            f"moments, {method}: variance of no first order": ((1 + double) / 2 - c**2, covariance.interval(0, 0)),
            f"moments, {method}: covariance": (spread**2 * c, covariance.interval(1, 5)),
        }

    return _tally(f"cos and sin of a normal angle of {spread:g} rad, 4,096 samples", CLOSED, runs, found)


# exact law and worst case --------------------------------------------------------------------------


def _laws(runs: int) -> list[Coverage]:
    """Return how often exact laws of sums of uniform numbers are within their bounds, against rational numbers."""
    generator = np.random.default_rng(11)

    def found(seed: int) -> dict[str, tuple[float, Interval]]:
        widths = 10.0 ** generator.uniform(-2, 0, generator.integers(2, 7))
        model = _model(
            _robot(("prismatic",) * len(widths), "1 0 0", "0 0 0"), *(laws.Uniform(float(width)) for width in widths)
        )
        known = pp.exact_law(model, samples=10_000, seed=seed).poses[0].laws["position.x"]
        assert known.law is not None
        assert known.agreement is not None
        x = float(widths.sum() * generator.uniform(-1, 1))
        off = abs(Fraction(float(known.law.cumulative(np.array([x]))[0])) - _sum_of_uniforms(widths, x))
        inside = all(
            _sum_of_uniforms(widths, value - bound) <= Fraction(level) <= _sum_of_uniforms(widths, value + bound)
            for level, value, bound in zip(LEVELS, known.quantiles, known.quantile_errors, strict=True)
        )
        return {
            "exact law: bound of a cumulative probability": _held(off <= Fraction(known.error)),
            "exact law: bounds of eight quantiles": _held(inside),
            "exact law: band of 10,000 samples, 99.9 %": _held(known.agreement.agrees),
        }

    return _tally("sums of 2 to 6 uniform numbers", "rational arithmetic", max(5, runs // 5), found)


def _held(is_so: bool) -> tuple[float, Interval]:
    return 0.0, (0.0, 0.0) if is_so else (1.0, 1.0)


@lru_cache(maxsize=64)
def _signs(count: int) -> tuple[tuple[int, ...], ...]:
    return tuple(itertools.product((1, -1), repeat=count))


def _sum_of_uniforms(half_widths: Array, x: float) -> Fraction:
    """Return P(sum of uniform numbers of these half-widths ≤ x), exact for the numbers given."""
    widths = [Fraction(float(width)) for width in half_widths]
    total = Fraction(0)
    for signs in _signs(len(widths)):
        reach = Fraction(x) + sum(sign * width for sign, width in zip(signs, widths, strict=True))
        if reach > 0:
            total += math.prod(signs) * reach ** len(widths)
    return total / (math.factorial(len(widths)) * math.prod(2 * width for width in widths))


def _vertices(runs: int) -> Coverage:
    """Return how often 2,000 random vertices, each climbed to a vertex with no better neighbour, stay within the bound."""
    held = 0
    sheets = ("4dof", "ur5", "panda", "xarm7")[:runs]
    prepared = []
    for sheet in sheets:
        model = pp.ErrorModel.load(PAPER_SHEET.parent / f"{sheet}.errors.yaml")
        bound = pp.worst_case(model, samples=1000).poses[0].position.first_order.upper
        at = model.at()
        prepared.append((at.tangent[0][:3], at.tangent[1][:3], Supports.of(at.space, 3.0), bound))
    generator = np.random.default_rng(13)
    for seed in range(runs):
        error, jacobian, supports, bound = prepared[seed % len(sheets)]
        directions = generator.normal(size=(2000, 3))
        for _ in range(10):
            directions = error + supports.points(directions @ jacobian) @ jacobian.T
        held += bool(np.linalg.norm(directions, axis=1).max() <= bound)
    return Coverage("worst case: bound of |d|", "shipped sheets", "random vertices, climbed", runs, runs, held)
