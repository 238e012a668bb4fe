"""How time and memory grow with samples, joints, parameters and threads, and whether they grow in proportion."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np

from benchmarks import cases, memory
from benchmarks.sampler import BLOCKS
from benchmarks.tables import Part, Ratio, Table, figure
from benchmarks.timing import Work, best_times, nanoseconds
from precision_pin.kernel import sampler as kernel
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import monte_carlo
from precision_pin.sampling.workers import available_cores

__all__ = ["Line", "Scaling", "fitted", "measure"]

_JOINTS = (2, 4, 6, 8, 10, 12, 16, 20)
_PARAMETERS = (12, 24, 36, 60, 90, 120, 180, 240)
_JOINTS_OF_ARMS = 6


@final
@dataclass(frozen=True)
class Line:
    """A straight line ``at_zero + slope · x`` through measurements.

    Attributes:
        at_zero, slope: Least squares.
        worst: Largest distance of a measurement from the line, relative to the measurement.
        bend: Slope of a line through the upper half, to that of one through the lower half; 1 is straight.
    """

    at_zero: float
    slope: float
    worst: float
    bend: float


def fitted(x: Sequence[float], y: Sequence[float]) -> Line:
    """Fit a line to at least four points, ascending in x."""
    slope, at_zero = np.polyfit(x, y, 1)
    worst = max(abs(at_zero + slope * a - b) / b for a, b in zip(x, y, strict=True))
    half = len(x) // 2
    lower, upper = (float(np.polyfit(x[part], y[part], 1)[0]) for part in (slice(half + 1), slice(half, None)))
    return Line(float(at_zero), float(slope), float(worst), upper / lower)


@final
@dataclass(frozen=True)
class Scaling:
    """What was measured, for tables and pictures.

    Attributes:
        sampler, numpy: Time and peak memory by number of samples, of `monte_carlo` and of numpy with everything kept.
        joints, parameters: Nanoseconds per sample by how many there are.
        threads: Seconds that passed, by how many threads.
    """

    sampler: dict[int, memory.Spent]
    numpy: dict[int, memory.Spent]
    joints: dict[int, float]
    parameters: dict[int, float]
    threads: dict[int, float]

    def part(self) -> Part:
        """Return tables and ratios."""
        return Part((self._samples(), self._sizes(), self._threads()), self._ratios())

    def _samples(self) -> Table:
        rows = [
            (
                f"{way}, {count:,} samples",
                figure(run.seconds),
                figure(run.seconds / count * 1e9),
                figure(run.peak / 1e6),
            )
            for way, runs in (("monte_carlo", self.sampler), ("numpy", self.numpy))
            for count, run in runs.items()
        ]
        return Table(
            "Samples: the paper's arm, one core, each run in a process of its own",
            ("run", "s", "ns per sample", "peak memory, MB"),
            rows,
            ("Numpy keeps all draws and errors; peak memory includes Python and all libraries.",),
        )

    def _sizes(self) -> Table:
        rows = []
        for name, costs in (("joint with six parameters", self.joints), ("parameter", self.parameters)):
            line = fitted(list(costs), list(costs.values()))
            cells = (f"{min(costs)} to {max(costs)}", figure(line.at_zero), figure(line.slope))
            rows.append((name, *cells, f"{100 * line.worst:.0f} %", f"{line.bend:.2f}"))
        return Table(
            "Joints and parameters: exact, ns per sample on one core, as a straight line",
            (
                "of each further",
                "measured from",
                "at none",
                "for each",
                "farthest off",
                "slope, upper half / lower half",
            ),
            rows,
            (
                f"Parameters on a UR5's {_JOINTS_OF_ARMS} joints; arms of other lengths repeat its links. With the fewest "
                "parameters the joints only shift and do not turn, which costs less.",
            ),
            on_page=False,
        )

    def _threads(self) -> Table:
        rows = [
            (str(count), figure(seconds), figure(self.threads[1] / seconds)) for count, seconds in self.threads.items()
        ]
        return Table(
            "Threads: monte_carlo of the paper's arm, the time that passes",
            ("threads", "s", "times one thread"),
            rows,
            on_page=False,
        )

    def _ratios(self) -> tuple[Ratio, ...]:
        two = self.threads[1] / self.threads[2] if 2 in self.threads else None
        # a further sample's time, over the last step up and over the one before
        counts = sorted(self.sampler)[-3:]
        before, after = np.diff([self.sampler[count].seconds for count in counts]) / np.diff(counts)
        first, last = (self.sampler[end(self.sampler)].peak for end in (min, max))
        return (
            Ratio("two threads to one", two, 1.85),
            Ratio(f"slope over samples, {counts[1]:,} to {counts[2]:,} to the tenfold before", float(after / before)),
            Ratio(f"peak memory of {counts[2]:,} samples to {min(self.sampler):,}", last / first),
            *(
                Ratio(f"slope over {name}, upper half to lower half", fitted(list(costs), list(costs.values())).bend)
                for name, costs in (("joints", self.joints), ("parameters", self.parameters))
            ),
        )


def measure(quick: bool) -> Scaling:
    """Measure all of it."""
    turns = 2 if quick else 20
    counts = [10**k for k in (range(4, 7) if quick else range(5, 9))]
    sampler = {count: _least(memory.SAMPLER, count, 1 if quick or count >= 10**8 else 3) for count in counts}
    bulk = {count: _least(memory.NUMPY, count, 1) for count in ((10**4,) if quick else (10**4, 10**5, 5 * 10**5))}
    chains = {count: cases.chain_of(count, cases.AXES * count) for count in _JOINTS[:: 2 if quick else 1]}
    arms = {count: cases.chain_of(_JOINTS_OF_ARMS, count) for count in _PARAMETERS[:: 2 if quick else 1]}
    works = {}
    for kind, models in (("joints", chains), ("parameters", arms)):
        for count, at in models.items():
            ready = cases.prepared(at)
            works[f"{kind} {count}"] = Work(partial(ready.sample, "exact", BLOCKS), BLOCKS * kernel.BLOCK)
    cost = nanoseconds(works, turns)
    return Scaling(
        sampler=sampler,
        numpy=bulk,
        joints={count: cost[f"joints {count}"] for count in chains},
        parameters={count: cost[f"parameters {count}"] for count in arms},
        threads=_on_threads(2 * 10**5 if quick else 10**7, turns),
    )


def _least(way: str, samples: int, turns: int) -> memory.Spent:
    """Return the least time and memory of several runs."""
    runs = [memory.spent(way, samples) for _ in range(turns)]
    return memory.Spent(min(run.seconds for run in runs), min(run.peak for run in runs))


def _on_threads(samples: int, turns: int) -> dict[int, float]:
    """Return the seconds that pass on 1, 2, 4, … threads and on one for each core."""
    cores = available_cores()
    counts = sorted({*(2**k for k in range(int(math.log2(cores)) + 1)), cores})
    model = ErrorModel.load(PAPER_SHEET)
    works = {count: Work(partial(monte_carlo, model, samples=samples, threads=count), samples) for count in counts}
    return best_times(works, turns, time.perf_counter)
