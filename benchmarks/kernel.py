"""Time per sample of the compiled sampler, beside the clear numpy engine, in one run on one core.

    python benchmarks/kernel.py [--samples N]

Two cases: the paper's four-joint arm with its shipped sheet, and a UR5 with six random displacements at each joint (36
parameters: 15 uniform, 21 normal). Times are CPU time of the one thread, the best of several turns; moments and the
histograms of all eight quantities are included except where only drawing is timed.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from precision_pin import kernel, kernel_loops, se3
from precision_pin.laws import Normal, Uniform
from precision_pin.model import ErrorModel, PoseModel
from precision_pin.parameters import Component, Program
from precision_pin.space import Draw, Space
from precision_pin.statistics import Plan, observe, start
from precision_pin.table import TermTable

SHEET = Path(__file__).parents[1] / "robots" / "4dof.errors.yaml"
TURNS = 7

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


def ur5() -> PoseModel:
    """Return a UR5 with a random displacement (x, y, z, about x, about y, about z) at each joint."""
    draws = [
        Draw(f"joint{joint}.{axis}", Uniform(1e-4) if (6 * joint + axis) % 12 < 5 else Normal(1e-4))
        for joint in range(6)
        for axis in range(6)
    ]
    space = Space(tuple(draws))
    frames, tip = [], np.eye(4)
    for (a, d, alpha), angle in zip(UR5, POSE, strict=True):
        tip = tip @ se3.pose(se3.rotation_about((0, 0, 1), angle), (0, 0, 0))
        frames.append(tip)
        tip = tip @ se3.pose(se3.rotation_about((1, 0, 0), alpha), (a, 0, d))
    table = TermTable(
        pose=tip,
        targets=(None,) * 6,  # type: ignore[arg-type]
        frames=np.array(frames),
        program=Program.compile([Component(name) for name in space.components], space.index),
        target=np.repeat(np.arange(6), 6),
        twists=np.tile(np.eye(6), (6, 1)),
        factors=np.array([[k, -1, -1] for k in range(36)]),
    )
    posture: Any = None
    return PoseModel(posture, space, table, ())


def nanoseconds(work: Callable[[], object], samples: int) -> float:
    """Return the CPU time per sample, the best of several turns."""
    best = math.inf
    for _ in range(TURNS):
        began = time.thread_time()
        work()
        best = min(best, time.thread_time() - began)
    return best / samples * 1e9


def compare(name: str, at: PoseModel, blocks: int) -> None:
    """Print one case."""
    layout = kernel.compile_table(at)
    plan = Plan.from_moments(
        at.linear(at.space.mean[:, None])[:, 0], np.cov(kernel.errors(layout, "exact", 0, 0, 1000))
    )
    count = kernel.BLOCK
    samples = blocks * count
    # numpy makes one block, which is its best size; the sampler many, as in use
    plain_draw = nanoseconds(lambda: at.space.sample(0, 0, count), count)
    # drawing alone, kept nowhere, has no public name: nobody needs it but this
    units = kernel._Units(0, 0, 0, samples, 0, 0)
    draw = nanoseconds(lambda: kernel._run(layout, kernel_loops.DRAW, units), samples)
    print(f"\n{name}: {at.space.size} parameters, {layout.targets} places and joints, ns per sample")
    print(f"{'':10}{'numpy':>10}{'compiled':>10}{'times':>8}{'of drawing':>12}{'agreement':>12}")
    print(f"{'drawing':10}{plain_draw:10.1f}{draw:10.1f}{plain_draw / draw:8.1f}{1:12.2f}")
    for model, oracle in (("linear", at.linear), ("exact", at.exact)):
        plain = nanoseconds(lambda: observe(plan, start(plan), oracle(at.space.sample(0, 0, count))), count)  # noqa: B023
        compiled = nanoseconds(lambda: kernel.accumulate(layout, plan, model, 0, 0, blocks), samples)  # noqa: B023
        gap = np.abs(oracle(at.space.sample(0, 0, count)) - kernel.errors(layout, model, 0, 0, count)).max()
        print(f"{model:10}{plain:10.1f}{compiled:10.1f}{plain / compiled:8.1f}{compiled / draw:12.2f}{gap:12.1e}")

    def on_threads(threads: int) -> float:
        best = math.inf
        for _ in range(3):
            with ThreadPoolExecutor(threads) as pool:
                began = time.perf_counter()
                list(pool.map(lambda k: kernel.observe_blocks(layout, plan, "exact", 0, k * blocks, blocks), range(4)))
                best = min(best, time.perf_counter() - began)
        return best

    one, two = on_threads(1), on_threads(2)
    print(f"two threads: {one / two:.2f} times one; 1e6 exact samples on one: {one / (4 * samples) * 1e6:.3f} s")


def main() -> None:
    """Print the start-up time and both cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=500_000, help="samples timed at a time")
    blocks = max(1, parser.parse_args().samples // kernel.BLOCK)
    cached = kernel.is_compiled()
    began = time.perf_counter()
    kernel.warm_up()
    print(f"{'loading the sampler from the cache' if cached else 'compiling the sampler'}: ", end="")
    print(f"{time.perf_counter() - began:.2f} s")
    compare("the paper's arm", ErrorModel.load(SHEET).at(), blocks)
    compare("UR5", ur5(), blocks)


if __name__ == "__main__":
    main()
