"""The histogram that quantiles are read from, beside keeping all values and numpy's quantile of them."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from benchmarks import cases
from benchmarks.sampler import BLOCKS, run_uncounted
from benchmarks.tables import Part, Ratio, Table, figure
from benchmarks.timing import Work, nanoseconds
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.statistics import QUANTITIES, finish, quantity_values, start
from precision_pin.statistics.accumulate import COLUMNS

__all__ = ["measure"]

LEVEL: Final = 0.9973
_AT_ONCE: Final = 2**18


def measure(quick: bool) -> Part:
    """Compare size, time and error with numpy's quantile on ten million samples (quick: 200,000)."""
    count, turns = (2 * 10**5, 2) if quick else (10**7, 20)
    ready = cases.prepared(cases.ur5())
    state = sampler.observe_blocks(ready.layout, ready.plan, "exact", 0, 0, -(-count // BLOCK), samples=count).add_to(
        start(ready.plan)
    )
    summary = finish(ready.plan, state)
    values = np.empty((8, count))
    for first in range(0, count, _AT_ONCE):
        size = min(_AT_ONCE, count - first)
        values[:, first : first + size] = quantity_values(sampler.errors(ready.layout, "exact", 0, first, size))
    exact = np.quantile(values, LEVEL, axis=1)
    found = np.array([summary.distribution(name).quantile(LEVEL) for name in QUANTITIES], dtype=float)
    error = float(np.abs(found / exact - 1).max())
    norm = values[0, : 10**6]
    samples = BLOCKS * BLOCK
    edges = np.linspace(norm.min(), norm.max(), 201)
    works = {
        "all": Work(partial(ready.sample, "exact", BLOCKS), samples),
        "errors": Work(partial(run_uncounted, ready.layout, "exact", samples), samples),
        "quantile": Work(partial(np.quantile, norm, LEVEL), norm.size),
        "histogram": Work(partial(np.histogram, norm, edges), norm.size),
    }
    cost = nanoseconds(works, turns)
    ours = (cost["all"] - cost["errors"]) / 8
    rows = [
        ("moments and sketch, within the sampler", figure(ours), figure(8 * COLUMNS / 1000), f"{error:.1e}"),
        ("numpy.quantile of all values", figure(cost["quantile"]), figure(8 * count / 1000), "0"),
        ("numpy.histogram with 200 bins, for comparison", figure(cost["histogram"]), figure(8 * 200 / 1000), ""),
    ]
    table = Table(
        f"Quantiles of {count:,} samples of the UR5",
        ("way", "ns per value", "kB per quantity", f"relative error at {100 * LEVEL:.2f} %"),
        rows,
        ("The largest error of the eight quantities, to numpy's quantile of the same samples.",),
        on_page=False,
    )
    ratios = (
        Ratio("numpy.quantile to moments and sketch, time per value", cost["quantile"] / ours),
        Ratio(f"relative error of the sketch at {100 * LEVEL:.2f} %", error),
    )
    return Part((table,), ratios)
