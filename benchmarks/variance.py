"""How much less sampling the same answer takes: variance at equal cost, each method against plain sampling.

    python benchmarks/variance.py [--seeds N] [--samples N]

For each quantity the factor (variance of plain sampling × its time) / (variance of the method × its time) over
independent seeds. Of the six means and the 21 entries of the covariance the smallest, the median and the largest factor
are printed, without components that do not vary; then mean and variance of |d| and |δ|, and two quantiles of |d| by
Sobol points. Time is CPU time of the one thread, the best of several turns: of plain sampling that of the compiled
sampler with moments and histograms; of a method that of each further sample (ns). Beside it stands what a call takes
however few there are (ms), much of which plain sampling takes too, to place loads and look for warnings. A variance from
20 seeds is known to a third. Closed forms are compared with the average of the most exact estimates, in parts of the
standard deviation.

The cases: the paper's arm with its sheet; a UR5 with six random displacements at each joint (36 numbers, 15 uniform and
21 normal); the shipped sheet of the UR5, if example-robot-data is installed.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.budget.budget import scrambled_points
from precision_pin.analyses.moments.moments import Method, PoseMoments, moments
from precision_pin.analyses.replicates import REPLICATES
from precision_pin.base.arrays import Array
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import parse
from precision_pin.sources.frame import Frame
from precision_pin.statistics import Plan

METHODS: tuple[Method, ...] = ("control", "sobol", "sobol-control")
LEVELS = (0.95, 0.9973)
UPPER = np.triu_indices(6)
TURNS = 3
FLAT = 1e-14
SHEET = examples.PAPER_SHEET

# UR5 in Denavit and Hartenberg's parameters, as its maker publishes them: a, d (m), α (rad)
UR5 = (
    (0.0, 0.089159, math.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.39225, 0.0, 0.0),
    (0.0, 0.10915, math.pi / 2),
    (0.0, 0.09465, -math.pi / 2),
    (0.0, 0.0823, 0.0),
)
POSE = (0.3, -1.2, 1.4, -1.7, -1.5, 0.4)


@dataclass(frozen=True)
class Numbers:
    """What a seed gave: 6 means, 21 covariances, mean and variance of both norms."""

    mean: Array
    covariance: Array
    norms: Array

    @classmethod
    def of(cls, pose: PoseMoments) -> Numbers:
        """Return the numbers of a result."""
        norms = [one.value for one in (pose.norm_mean, pose.norm_variance) if one is not None]
        return cls(pose.mean.value, pose.covariance.value[UPPER], np.concatenate(norms))


def ur5() -> ErrorModel:
    """Return a UR5 with a random displacement (x, y, z, about x, about y, about z) at each joint."""
    parts, sources = ['<link name="base"/>'], []
    for k in range(7):
        a, d, alpha = UR5[k - 1] if k else (0.0, 0.0, 0.0)
        parent, child = f"link{k}" if k else "base", f"link{k + 1}" if k < 6 else "tool"
        kind = "revolute" if k < 6 else "fixed"
        parts.append(
            f'<link name="{child}"/><joint name="joint{k}" type="{kind}"><origin xyz="{a!r} 0 {d!r}" rpy="{alpha!r} 0 0"/>'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
            '<limit lower="-7" upper="7" effort="1" velocity="1"/></joint>'
        )
    for k in range(6):
        x, y, z, rx, ry, rz = (Uniform(1e-4) if (6 * k + axis) % 12 < 5 else Normal(1e-4) for axis in range(6))
        sources.append(Frame(joint=f"joint{k}", x=x, y=y, z=z, rx=rx, ry=ry, rz=rz))
    robot = parse(f'<robot name="ur5">{"".join(parts)}</robot>'.encode(), "ur5.urdf")
    return ErrorModel(Chain.from_robot(robot, tip="tool", gravity=(0.0, 0.0, 0.0)), Space(), sources, {"pose": POSE})


def timed(work: Callable[[], object]) -> float:
    """Return the CPU time of this thread, the best of several turns."""
    best = math.inf
    for _ in range(TURNS):
        began = time.thread_time()
        work()
        best = min(best, time.thread_time() - began)
    return best


def norms(errors: Array) -> Array:
    """Return |d|."""
    result: Array = np.sqrt((errors[:3] ** 2).sum(axis=0))
    return result


def span(factors: Array) -> str:
    """Return the smallest, the median and the largest."""
    return "  ".join(f"{value:8.1e}" for value in (factors.min(), np.median(factors), factors.max()))


def factors(model: ErrorModel, samples: int, seeds: int) -> Iterator[str]:
    """Yield the lines of one case."""
    at = model.at()
    layout = sampler.to_arrays(at)
    plan = Plan.from_moments(at.error_at_means, at.covariance)
    blocks = max(1, samples // BLOCK)
    plain_time = timed(lambda: sampler.observe_blocks(layout, plan, "exact", 0, 0, blocks)) / (blocks * BLOCK)
    yield f"{at.space.size} random numbers; plain sampling {1e9 * plain_time:.0f} ns a sample, one thread"
    plain = [Numbers.of(moments(model, method="plain", samples=samples, seed=k).poses[0]) for k in range(seeds)]
    spread = np.sqrt(np.diagonal(at.covariance))
    varies = spread > FLAT
    pairs = np.outer(varies, varies)[UPPER]
    yield f"{'':14}{'ns':>7}{'ms':>7}  {'mean: least, median, most':^28}  {'covariance':^28}  |d|: mean, var    |δ|: mean, var"
    best: list[Numbers] = []
    for method in METHODS:
        few, many = (timed(lambda: moments(model, method=method, samples=n)) for n in (samples, 8 * samples))  # noqa: B023
        cost = (many - few) / (7 * samples)
        found = [Numbers.of(moments(model, method=method, samples=samples, seed=k).poses[0]) for k in range(seeds)]
        best = found

        def ratio(name: str, chosen: NDArray[np.bool_] | slice) -> Array:
            before, after = (np.array([getattr(one, name) for one in runs]) for runs in (plain, found))  # noqa: B023
            value: Array = before.var(axis=0)[chosen] / after.var(axis=0)[chosen] * plain_time / cost  # noqa: B023
            return value

        d_mean, turn_mean, d_variance, turn_variance = ratio("norms", slice(None))
        of_mean, of_covariance = span(ratio("mean", varies)), span(ratio("covariance", pairs))
        yield (
            f"{method:14}{1e9 * cost:7.0f}{1e3 * (few - cost * samples):7.0f}  {of_mean}  {of_covariance}  "
            f"{d_mean:.1e} {d_variance:.1e}  {turn_mean:.1e} {turn_variance:.1e}"
        )
    yield from closed(model, best, spread, varies)
    yield from quantiles(model, layout, samples, seeds, plain_time)


def closed(model: ErrorModel, best: list[Numbers], spread: Array, varies: NDArray[np.bool_]) -> Iterator[str]:
    """Yield how far the closed form and the tangent are from the average of the best estimates."""
    began = time.thread_time()
    found = moments(model, method="closed").poses[0]
    cost = time.thread_time() - began
    at = model.at()
    pairs = np.outer(varies, varies)[UPPER]
    scale = np.outer(spread, spread)[UPPER][pairs]
    mean = np.array([one.mean for one in best])
    covariance = np.array([one.covariance for one in best])
    for name, closed_mean, closed_covariance in (
        ("tangent", at.error_at_means, at.covariance),
        (f"closed ({1e3 * cost:.0f} ms)", found.mean.value, found.covariance.value),
    ):
        off = np.abs(mean.mean(axis=0) - closed_mean)[varies] / spread[varies]
        off_covariance = np.abs(covariance.mean(axis=0) - closed_covariance[UPPER])[pairs] / scale
        yield f"{name}: off by at most {off.max():.1e} of a standard deviation, {off_covariance.max():.1e} of a covariance"
    error = (mean.std(axis=0) / math.sqrt(len(best)))[varies] / spread[varies]
    error_covariance = (covariance.std(axis=0) / math.sqrt(len(best)))[pairs] / scale
    yield f"    (the estimates themselves are known to {error.max():.1e} and {error_covariance.max():.1e})"


def quantiles(model: ErrorModel, layout: SamplerArrays, samples: int, seeds: int, plain_time: float) -> Iterator[str]:
    """Yield the factors of quantiles of |d|."""
    space = model.at().space

    def by_sobol(seed: int) -> Array:
        x = space.inverse(scrambled_points(space.size, seed, samples // REPLICATES))
        value: Array = np.quantile(norms(sampler.errors_at(layout, "exact", x)), LEVELS)
        return value

    random = [np.quantile(norms(sampler.errors(layout, "exact", k, 0, samples)), LEVELS) for k in range(seeds)]
    cost = timed(lambda: by_sobol(0)) / samples
    even = [by_sobol(k) for k in range(seeds)]
    ratios = np.var(random, axis=0) / np.var(even, axis=0)
    for level, value in zip(LEVELS, ratios, strict=True):
        yield (
            f"{100 * level:g} % of |d| by Sobol points, {1e9 * cost:.0f} ns: {value:.1f} of the variance at equal samples, "
            f"{value * plain_time / cost:.2f} at equal cost"
        )


def main() -> None:
    """Print every case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=16_384, help="16 times a power of two")
    parser.add_argument("--seeds", type=int, default=20, help="independent runs that the variances come from")
    arguments = parser.parse_args()
    cases: dict[str, Callable[[], ErrorModel]] = {
        "the paper's arm": lambda: ErrorModel.load(SHEET),
        "UR5, six displacements at each joint": ur5,
    }
    if "ur5" in examples.example_urdfs():
        cases["UR5, shipped sheet"] = lambda: ErrorModel.load(SHEET.parent / "ur5.errors.yaml")
    for name, made in cases.items():
        print(f"\n{name}")
        for line in factors(made(), arguments.samples, arguments.seeds):
            print(f"  {line}", flush=True)


if __name__ == "__main__":
    main()
