"""Pictures of the comparison and of the scaling."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmarks.scaling import Scaling, fitted
from benchmarks.tables import figure

__all__ = ["draw_comparison", "draw_scaling"]

OURS: Final = "#0072b2"
OTHERS: Final = "#b0b0b0"
NUMPY: Final = "#d55e00"
STYLE: Final[Any] = {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False}
DOTS: Final = 200


def draw_comparison(cost: Mapping[str, float], ours: str, path: Path) -> None:
    """Draw ns per sample as bars, the slowest on top, with the ratio to ours behind each."""
    with mpl.rc_context(STYLE):
        picture = Figure(figsize=(7, 0.55 + 0.36 * len(cost)), layout="constrained")
        axes = picture.subplots()
        names = sorted(cost, key=cost.__getitem__)
        axes.barh(names, [cost[name] for name in names], color=[OURS if name == ours else OTHERS for name in names])
        for row, name in enumerate(names):
            words = f"{figure(cost[name])} ns" if name == ours else f"{figure(cost[name] / cost[ours])} ×"
            axes.annotate(words, (cost[name], row), (4, 0), textcoords="offset points", va="center")
        axes.set_xscale("log")
        axes.set_xlim(10, 6 * max(cost.values()))
        axes.set_xlabel("time per sample, one core (ns)")
        axes.tick_params(axis="y", length=0)
        picture.savefig(path, dpi=DOTS)


def draw_scaling(found: Scaling, path: Path) -> None:
    """Draw time and memory against samples, and time per sample against joints and parameters."""
    with mpl.rc_context(STYLE):
        picture = Figure(figsize=(7, 5.6), layout="constrained")
        ((seconds, peaks), (parameters, joints)) = picture.subplots(2, 2)
        for axes, quantity, label in (
            (seconds, lambda run: run.seconds, "processor time (s)"),
            (peaks, lambda run: run.peak / 1e6, "peak memory (MB)"),
        ):
            for name, runs, colour, mark in (
                ("precision-pin", found.sampler, OURS, "o-"),
                ("numpy, all kept", found.numpy, NUMPY, "s-"),
            ):
                axes.plot(list(runs), [quantity(run) for run in runs.values()], mark, color=colour, label=name)
            axes.set(xscale="log", xlabel="samples", ylabel=label)
        seconds.set_yscale("log")
        peaks.set_ylim(bottom=0)
        peaks.legend(frameon=False)
        _line(parameters, found.parameters, "parameters, on 6 joints")
        _line(joints, found.joints, "joints, each with 6 parameters")
        picture.savefig(path, dpi=DOTS)


def _line(axes: Any, costs: Mapping[int, float], label: str) -> None:
    """Draw measured points and the line through them."""
    line = fitted(list(costs), list(costs.values()))
    axes.plot([0, max(costs)], [line.at_zero, line.at_zero + line.slope * max(costs)], color=OTHERS)
    axes.plot(list(costs), list(costs.values()), "o", color=OURS)
    axes.set(xlim=(0, None), ylim=(0, None), xlabel=label, ylabel="time per sample (ns)")
    axes.annotate(f"{figure(line.slope)} ns for each", (0.96, 0.06), xycoords="axes fraction", ha="right")
