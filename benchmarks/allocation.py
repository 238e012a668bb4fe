"""Time and cost of an allocation beside a general optimiser on the same limits, in one run on one core.

    python benchmarks/allocation.py [--tolerances N] [--poses P]

The cheapest of N tolerances of a UR5 that keep a quantile of the position error at P poses, by the package's programme
(exact slopes) and by SciPy's SLSQP as one would call it: the same function for the quantiles, slopes by differences. Then
the whole of ``pp.allocate``: reading the sheet anew with each tolerance changed, solving, sampling. Times are CPU time of this
thread, the best of some turns. It needs the extra ``examples``.
"""

from __future__ import annotations

import argparse
import math
import os
import time
import warnings
from collections.abc import Callable
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy import optimize

import precision_pin as pp
from precision_pin.analyses.allocation.convex_program import Limit, Programme
from precision_pin.analyses.allocation.problem import read_problem
from precision_pin.analyses.allocation.tolerances import Cost, contributions
from precision_pin.base.errors import PrecisionPinWarning

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
AXES = ("x", "y", "z", "rx", "ry", "rz")
TURNS = 3


def cell(tolerances: int, poses: int) -> tuple[pp.ErrorModel, dict[str, Any]]:
    """Return a UR5 with up to 36 tolerances of its joints' places and four of their zeros, and what to choose."""
    generator = np.random.default_rng(3)
    places = {axis: {"uniform": "0.2 mrad" if axis[0] == "r" else "0.1 mm"} for axis in AXES}
    sources: list[dict[str, Any]] = [{"frame": {"joint": f"{joint}_joint", **places}} for joint in JOINTS]
    sources += [{"joint_offset": {"joint": f"{joint}_joint", "offset": {"uniform": "0.1 mrad"}}} for joint in JOINTS]
    angles = generator.uniform(-120, 120, size=(poses, 6))
    sheet = {
        "precision-pin": 1,
        "robot": "example:ur5",
        "tip": "tool0",
        "poses": {f"p{k}": " ".join(f"{angle:.1f}" for angle in row) + " deg" for k, row in enumerate(angles)},
        "sources": sources,
    }
    paths = [f"frame[{joint}_joint].{axis}.uniform" for joint in JOINTS for axis in AXES]
    paths += [f"joint_offset[{joint}_joint].offset.uniform" for joint in JOINTS[:4]]
    prices = generator.uniform(0.5, 3, size=len(paths))
    entries = [
        {"path": path, "cost": {"reciprocal": f"{price:g} {'mrad' if '.r' in path or 'offset' in path else 'mm'}"}}
        for path, price in zip(paths[:tolerances], prices, strict=False)
    ]
    return pp.ErrorModel.from_dict(sheet, "."), {"tolerances": entries, "specs": ["0.5 mm @ 95 %"]}


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU time, the best of some turns, and what was returned."""
    best, found = math.inf, None
    for _ in range(TURNS):
        began = time.thread_time()
        found = work()
        best = min(best, time.thread_time() - began)
    return best, found


def plain(programme: Programme) -> float:
    """Return the least cost by SLSQP with slopes by differences, in tenths of the widths to begin with."""
    start = 0.1 * programme.low * 100
    scale = float(programme.cost_of(start).sum())
    found = optimize.minimize(
        lambda x: float(programme.cost_of(x * start).sum()) / scale,
        np.ones(len(start)),
        bounds=list(zip(programme.low / start, programme.high / start, strict=True)),
        constraints={"type": "ineq", "fun": lambda x: 1 - programme.shares((x * start)[:, None])[0]},
        method="SLSQP",
        options={"maxiter": 1000, "ftol": 1e-10},
    )
    return float(found.fun) * scale


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--tolerances", type=int, default=40, choices=range(1, 41), metavar="N")
    parser.add_argument("--poses", type=int, default=10)
    options = parser.parse_args()
    warnings.simplefilter("ignore", PrecisionPinWarning)
    model, problem = cell(options.tolerances, options.poses)
    task = read_problem(model, problem)
    parts = contributions(model, task.tolerances, task.poses, worst_case=False, advance=lambda _: None)
    limit = Limit(
        "quantile", 0.5e-3, 0.95, (0, 1, 2), parts.mean[:3], parts.covariance[:3, :3], parts.by_tolerance[:, :3, :3]
    )
    costs = [[one.cost] for one in task.tolerances if isinstance(one.cost, Cost)]
    low, high = (np.array([getattr(one, end) for one in task.tolerances]) for end in ("low", "high"))
    programme = Programme(costs, low, high, [limit])
    ours, solution = seconds(programme.solve)
    theirs, cost = seconds(lambda: plain(programme))
    pp.allocate(model, problem)  # compiles what was not yet
    began, whole = time.perf_counter(), time.thread_time()
    pp.allocate(model, problem)
    print(f"{options.tolerances} tolerances, {options.poses} poses, one quantile")
    print(f"programme: {ours:.2f} s, cost {solution.cost:.4f}, gap {1 - solution.lower_bound / solution.cost:.1e}")
    print(
        f"SLSQP with differences: {theirs:.2f} s, {theirs / ours:.0f} times as long, cost {cost / solution.cost:.5f} of ours"
    )
    print(f"pp.allocate: {time.thread_time() - whole:.1f} s of this thread, {time.perf_counter() - began:.1f} s in all")


if __name__ == "__main__":
    main()
