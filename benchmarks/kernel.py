"""Time per sample of the exact error of a UR5 with 36 random parameters, beside what one would write otherwise.

Everything is on one core, with drawing and with moments and histograms of all eight quantities. What has no generator
or statistics of its own is charged numpy's, in bulk, which is the least they can cost. Before anything is timed, all
have to give the same errors for the same parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, final

import numpy as np

from benchmarks import cases, loops, others
from benchmarks.sampler import BLOCKS, run_uncounted
from benchmarks.tables import Part, Ratio, Table, figure, times
from benchmarks.timing import Work, nanoseconds
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET

__all__ = ["AGREEMENT", "EXACT", "Comparison", "check_agreement", "installed_libraries", "measure", "written_by_hand"]

AGREEMENT: Final = 1e-9
"""Largest difference allowed between two ways, m or rad; the errors are of 1e-4."""

BULK: Final = 4 * BLOCK
EXACT: Final = "precision-pin, exact"
COPIED: Final = "Pinocchio, a displaced copy of the model"
PLAIN: Final = "Pinocchio, displaced placements"
VIRTUAL: Final = "Pinocchio, a virtual joint for each parameter"

LIBRARIES: Final[Mapping[str, Callable[[], others.Other]]] = {
    "Robotics Toolbox, virtual joints": others.robotics_toolbox,
    "OpenTURNS, numpy in its function": others.openturns_function,
    "JAX, vmap and jit": others.jax_compiled,
}


def written_by_hand() -> dict[str, tuple[loops.Errors, int]]:
    """Return what one would write otherwise, and how many samples of it to time at once."""
    return {
        COPIED: (loops.plain_loop(copied=True), 300),
        PLAIN: (loops.plain_loop(copied=False), 500),
        f"{PLAIN}, tuned": (loops.tuned_loop(), 1000),
        VIRTUAL: (loops.virtual_joints(), 2000),
        f"{VIRTUAL}, tuned": (loops.tuned_virtual_joints(), 2000),
        "numpy, the clear engine of this package": (cases.ur5().exact, 4096),
        "numpy, written for this arm": (loops.numpy_by_hand(), 16384),
    }


def installed_libraries() -> tuple[dict[str, others.Other], list[str]]:
    """Return the other libraries' ways, and the names of those not installed."""
    found, missing = {}, []
    for name, make in LIBRARIES.items():
        try:
            found[name] = make()
        except ImportError:
            missing.append(name)
    return found, missing


def check_agreement(ways: Mapping[str, loops.Errors]) -> None:
    """Stop unless all ways, and the compiled sampler, give the same errors for the same parameters.

    Raises:
        SystemExit: One of them differs by more than `AGREEMENT`.
    """
    x = cases.draw_with_numpy(np.random.default_rng(0), 300)
    expected = sampler.errors_at(sampler.to_arrays(cases.ur5()), "exact", x)
    for name, errors in ways.items():
        gap = float(np.abs(errors(x) - expected).max())
        if not gap < AGREEMENT:
            raise SystemExit(f"{name} differs from the compiled sampler by {gap:.1e}; nothing was timed")


@final
@dataclass(frozen=True)
class Comparison:
    """The tables and ratios, and what a picture needs: ns per sample of each way."""

    part: Part
    cost: dict[str, float]


def compared(turns: int) -> Comparison:
    """Compare the compiled sampler with everything else."""
    by_hand = written_by_hand()
    libraries, missing = installed_libraries()
    check_agreement({name: errors for name, (errors, _) in by_hand.items()})
    check_agreement({name: other.errors for name, other in libraries.items()})
    random = np.random.default_rng(1)
    ready = cases.prepared(cases.ur5())
    ours = BLOCKS * BLOCK
    works = {EXACT: Work(partial(ready.sample, "exact", BLOCKS), ours)}
    for name, (errors, count) in by_hand.items():
        works[name] = Work(partial(errors, cases.draw_with_numpy(random, count)), count)
    for name, other in libraries.items():
        count = 1000 if other.sampled is None else 16384
        call = partial(other.errors, cases.draw_with_numpy(random, count))
        works[name] = Work(call if other.sampled is None else partial(other.sampled, count), count)
    some = by_hand["numpy, written for this arm"][0](cases.draw_with_numpy(random, BULK))
    works["drawing"] = Work(partial(cases.draw_with_numpy, random, BULK), BULK)
    works["statistics"] = Work(partial(loops.statistics_with_numpy, some), BULK)
    cost = nanoseconds(works, turns)
    drawing, statistics = cost.pop("drawing"), cost.pop("statistics")
    for name in cost:
        if name != EXACT:
            draws_itself = name in libraries and libraries[name].sampled is not None
            cost[name] += statistics + (0.0 if draws_itself else drawing)
    ordered = sorted(cost, key=cost.__getitem__, reverse=True)
    rows = [(name, figure(cost[name]), "1" if name == EXACT else times(cost[name] / cost[EXACT])) for name in ordered]
    table = Table(
        "A UR5 with 36 random parameters, one core",
        ("way", "ns per sample", "to precision-pin"),
        [*rows, *((name, "not installed", "") for name in missing)],
        (
            f"Numpy's drawing of {figure(drawing)} ns and its statistics of {figure(statistics)} ns per sample are "
            "included where a way has none of its own.",
        ),
    )
    by_numpy = min(cost[name] for name in cost if name.startswith("numpy"))
    ratios = (
        Ratio("Pinocchio with displaced copies to precision-pin", cost[COPIED] / cost[EXACT], 900),
        Ratio("Pinocchio with displaced placements to precision-pin", cost[PLAIN] / cost[EXACT]),
        Ratio("Pinocchio with displaced placements, tuned, to precision-pin", cost[f"{PLAIN}, tuned"] / cost[EXACT]),
        Ratio("Pinocchio with virtual joints to precision-pin", cost[VIRTUAL] / cost[EXACT], 80),
        Ratio("Pinocchio with virtual joints, tuned, to precision-pin", cost[f"{VIRTUAL}, tuned"] / cost[EXACT]),
        Ratio("numpy, the better of two, to precision-pin", by_numpy / cost[EXACT]),
    )
    return Comparison(Part((table,), ratios), cost)


def stages(turns: int) -> Part:
    """Take the compiled sampler apart."""
    arms = {
        "the paper's arm": ErrorModel.load(PAPER_SHEET).at(),
        "UR5": cases.ur5(),
        "UR5, 100 terms, 20 of them products": cases.with_products(),
    }
    works = {}
    for arm, at in arms.items():
        ready = cases.prepared(at)
        samples = BLOCKS * BLOCK
        works[f"{arm}: draw"] = Work(partial(run_uncounted, ready.layout, "draw", samples), samples)
        works[f"{arm}: linear"] = Work(partial(ready.sample, "linear", BLOCKS), samples)
        works[f"{arm}: exact"] = Work(partial(ready.sample, "exact", BLOCKS), samples)
    cost = nanoseconds(works, turns)
    rows = []
    for arm, at in arms.items():
        draw, linear, exact = (cost[f"{arm}: {stage}"] for stage in ("draw", "linear", "exact"))
        sizes = (str(at.space.size), str(len(at.table.twists)), str(len(at.table.targets)))
        rows.append(
            (arm, *sizes, figure(draw), figure(linear), figure(exact), f"{exact / draw:.2f}", f"{exact / linear:.2f}")
        )
    table = Table(
        "Inside the compiled sampler, ns per sample on one core",
        ("arm", "parameters", "terms", "targets", "drawing", "linear", "exact", "exact / drawing", "exact / linear"),
        rows,
        ("Drawing counts nothing; linear and exact include drawing, moments and histograms.",),
    )
    many = cost["UR5, 100 terms, 20 of them products: exact"]
    ratios = (
        Ratio("exact to its own random numbers", cost["UR5: exact"] / cost["UR5: draw"], 1.7, at_most=True),
        Ratio("exact to linear", cost["UR5: exact"] / cost["UR5: linear"], 1.25, at_most=True),
        Ratio("100 terms with 20 products to 36 plain ones", many / cost["UR5: exact"], 1.2, at_most=True),
    )
    return Part((table,), ratios)


def measure(quick: bool) -> Comparison:
    """Measure both."""
    turns = 2 if quick else 40
    found, inside = compared(turns), stages(turns)
    return Comparison(Part(found.part.tables + inside.tables, found.part.ratios + inside.ratios), found.cost)
