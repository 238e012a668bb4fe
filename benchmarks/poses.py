"""Time per sample and pose of a UR5 with 36 random parameters, the same robots at P poses: ``python -m benchmarks.poses``.

Everything is on one core. Beside it: one pose after another; the matrix product that the tangent model at P poses needs
anyway, (6 P × 36) times (36 × N) without drawing or statistics; and Pinocchio's loops. Then maps in closed form, the making of
the models at all poses included.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from benchmarks import cases, loops
from benchmarks.tables import Part, Ratio, Table, figure, times
from benchmarks.timing import Work, best_times, nanoseconds
from precision_pin.analyses.map.map_poses import map_poses
from precision_pin.base import se3
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK, MOST_TOGETHER, JoinedTables, observe_norms
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.examples import shipped_sheets
from precision_pin.statistics import Plan

__all__ = ["measure", "measure_maps", "slope", "ur5_at"]

POSES: Final = (1, 8, 64, 1000)
MAPPED: Final = (10, 100, 1000, 5000)
STEADY: Final = 100
"""Poses from which on a map's time is fitted by a power of their number."""
LEAST_MAPPED: Final = 1000.0
"""Poses a second that a map in closed form is to make."""
PRODUCT: Final = 4096
"""Samples of a matrix product, a good size for it."""
MOST_ALONE: Final = 8
"""Poses up to which one after another is timed."""


def ur5_at(angles: NDArray[np.float64]) -> list[PoseModel]:
    """Return the UR5 of :mod:`benchmarks.cases` at joint angles ``(6, P)``, rad."""
    plain = cases.ur5()
    found = []
    for column in angles.T:
        frames, tip = [], np.eye(4)
        for (a, d, alpha), angle in zip(cases.UR5, column, strict=True):
            tip = tip @ se3.pose(se3.rotation_about((0, 0, 1), angle), (0, 0, 0))
            frames.append(tip)
            tip = tip @ se3.pose(se3.rotation_about((1, 0, 0), alpha), (a, 0, d))
        table = replace(plain.table, pose=tip, frames=np.array(frames))
        found.append(PoseModel(plain.posture, plain.space, table, ()))
    return found


@final
@dataclass(frozen=True, eq=False)
class Together:
    """The UR5 at poses that are worked on together."""

    tables: JoinedTables
    plans: Sequence[Plan]

    @classmethod
    def of(cls, models: Sequence[PoseModel]) -> Together:
        """Lay the poses out."""
        plans = [Plan.from_moments(at.error_at_means, at.covariance) for at in models]
        return cls(JoinedTables.of(sampler.to_arrays_at_poses(models)), plans)

    def norms(self, model: sampler.Model, blocks: int) -> None:
        """Draw once, displace at every pose and count what a map needs."""
        observe_norms(self.tables, self.plans, model, 0, 0, blocks)

    def one_at_a_time(self, blocks: int) -> None:
        """Draw, displace and count, one pose after another."""
        for layout, plan in zip(self.tables.layouts, self.plans, strict=True):
            sampler.observe_blocks(layout, plan, "exact", 0, 0, blocks)


def check_agreement(models: Sequence[PoseModel]) -> None:
    """Stop unless the sums over many poses are those of the clear numpy engine.

    Raises:
        SystemExit: A mean differs by more than 1e-12 m or rad.
    """
    plans = [Plan(np.zeros(8), np.ones(8))] * len(models)
    found = observe_norms(sampler.to_arrays_at_poses(models), plans, "exact", 0, 0, 1, samples=1000)
    x = models[0].space.sample(0, 0, 1000)
    for sums, at in zip(found.sums[:, 0], models, strict=True):
        gap = float(np.abs(sums[[1, 2, 3, 5, 6, 7]] / 1000 - at.exact(x).mean(axis=1)).max())
        if not gap < 1e-12:
            raise SystemExit(f"many poses differ from the numpy engine by {gap:.1e}; nothing was timed")


def measure(turns: int) -> Part:
    """Time all numbers of poses, and what they are compared with."""
    random = np.random.default_rng(0)
    models = ur5_at(random.uniform(-np.pi, np.pi, (6, max(POSES))))
    check_agreement(models[:3])
    rows, cost, product = [], {}, {}
    for poses in POSES:
        groups = [Together.of(models[k : min(k + MOST_TOGETHER, poses)]) for k in range(0, poses, MOST_TOGETHER)]
        blocks = max(1, 8 // poses)
        samples = blocks * BLOCK * poses
        jacobian = np.concatenate([at.jacobian for at in models[:poses]])
        x = random.standard_normal((36, PRODUCT))
        out = np.empty((6 * poses, PRODUCT))
        works = {
            "exact": Work(partial(_each, groups, "exact", blocks), samples),
            "linear": Work(partial(_each, groups, "linear", blocks), samples),
            "product": Work(partial(np.matmul, jacobian, x, out), PRODUCT * poses),
        }
        if poses <= MOST_ALONE:
            works["alone"] = Work(partial(groups[0].one_at_a_time, blocks), samples)
        found = nanoseconds(works, turns if poses < max(POSES) else min(turns, 3))
        cost[poses], product[poses] = found, found["product"]
        cells = tuple(figure(found[name]) if name in found else "" for name in ("exact", "linear", "alone", "product"))
        rows.append((f"{poses}", *cells))
    pinocchio = nanoseconds(
        {
            name: Work(partial(loop, cases.draw_with_numpy(random, 500)), 500)
            for name, loop in (
                ("Pinocchio, displaced placements", loops.plain_loop(copied=False)),
                ("Pinocchio, a virtual joint for each parameter", loops.virtual_joints()),
            )
        },
        turns,
    )
    table = Table(
        "A UR5 with 36 random parameters at P poses, one core, ns per sample and pose",
        ("P", "exact", "linear", "one pose at a time", "matrix product alone"),
        rows,
        tuple(f"{name}: {figure(cost)} ns, without drawing." for name, cost in pinocchio.items()),
    )
    loop = min(pinocchio.values())
    ratios = (
        Ratio("one pose at a time to 64 together", cost[MOST_ALONE]["alone"] / cost[64]["exact"]),
        Ratio("exact at 64 poses to the tangent's matrix product", cost[64]["exact"] / product[64]),
        Ratio("Pinocchio's better loop to 64 poses together", loop / cost[64]["exact"]),
    )
    return Part((table,), ratios)


def measure_maps(turns: int) -> Part:
    """Time maps in closed form of every arm in the package, with the term tables of all poses, quantiles and shares."""
    random = np.random.default_rng(1)
    rows, ratios = [], []
    for name, sheet in shipped_sheets().items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionPinWarning)
            # at random poses not every arm comes to rest under its loads
            model = ErrorModel.load(sheet).with_({"statics": "nominal"})
        q = random.uniform(-1.0, 1.0, (len(model.chain.joints), max(MAPPED)))
        works = {poses: Work(partial(_map, model, q[:, :poses]), poses) for poses in MAPPED}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionPinWarning)
            seconds = best_times(works, turns)
        steep = slope([poses for poses in MAPPED if poses >= STEADY], seconds)
        rate = MAPPED[-1] / seconds[MAPPED[-1]]
        cells = tuple(figure(1e6 * seconds[poses] / poses) for poses in MAPPED)
        rows.append((name, f"{len(model.sources)}", *cells, f"{steep:.2f}", figure(rate)))
        ratios.append(Ratio(f"{name}: poses a second of a map", rate, aim=LEAST_MAPPED))
    heads = ("", "sources", *(f"{poses:,}" for poses in MAPPED), "slope", "poses a second")
    note = f"The slope is that of log time over log P from P = {STEADY} on: 1 where a pose costs the same in any map."
    return Part((Table("A map in closed form of P poses, one core, µs a pose", heads, rows, (note,)),), tuple(ratios))


def slope(sizes: Sequence[int], seconds: Mapping[int, float]) -> float:
    """Return the power of the size with which the time grows, by least squares."""
    return float(np.polyfit(np.log(sizes), np.log([seconds[size] for size in sizes]), 1)[0])


def _map(model: ErrorModel, q: NDArray[np.float64]) -> None:
    map_poses(model, q, specifications="1 mm @ 95 %", verify=0)


def _each(groups: Sequence[Together], model: sampler.Model, blocks: int) -> None:
    for group in groups:
        group.norms(model, blocks)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=5, help="turns of each, of which the best counts")
    turns = parser.parse_args().turns
    sampled, mapped = measure(turns), measure_maps(min(turns, 3))
    for part in (sampled, mapped):
        for table in part.tables:
            print(table.as_text())
    for ratio in sampled.ratios:
        print(f"{ratio.name}: {times(ratio.value) if ratio.value else '-'}")


if __name__ == "__main__":
    main()
