"""The sampled pose error at several poses as text for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.monte_carlo.table import NOTHING_VARIES, demanded
from precision_pin.base.text_escape import shown, visible
from precision_pin.model.pose_model import origin_shares
from precision_pin.render.tables import ROUNDING, pose_labels, resting_on
from precision_pin.render.text_table import aligned
from precision_pin.sampling.poses_result import LEVELS, PosesResult, PosesSpecification
from precision_pin.statistics import format_inside, format_share
from precision_pin.statistics.digits import format_interval

_MOST_ROWS: Final = 8
"""Poses of which all are listed."""
_WORST_ROWS: Final = 6
"""Poses listed of more than that, the worst first."""


def poses_table(result: PosesResult, *, is_whole: bool = False) -> str:
    """Return what a designer wants to read of several poses: the worst pose and the verdicts, then a row for each pose."""
    listed = list(range(result.poses))
    if result.poses > _MOST_ROWS and not is_whole:
        listed = result.worst_first[:_WORST_ROWS]
    left_out = result.poses - len(listed)
    specifications = result.specification_results
    model = result.error_model
    shares = origin_shares(model.origins, next(model.at_columns(result.q[:, [0]])))
    lines = [
        f"{visible(result.robot)}: {visible(result.base)} to {visible(result.tip)}, {result.poses:,} poses with the same robots",
        f"{result.samples:,} samples at each, seed {result.seed}, {result.model} model, statics {result.statics}, "
        f"{result.confidence:.0%} confidence",
        _worst(result),
        *(_verdict(result, specification) for specification in specifications),
        "",
        *aligned(_rows(result, listed, is_whole)),
        *([f"and {left_out:,} more poses: --all"] if left_out else []),
        "",
        "quantiles of |d| in mm, shares inside each spec; - is not resolved",
        *resting_on(model.assumed, len(model.sources), shares, pose_labels(result.names)[0], is_brief=not is_whole),
        *([_verdict(result, one, is_brief=True) for one in specifications] or [_worst(result)]),
    ]
    return "\n".join(lines)


def _worst(result: PosesResult) -> str:
    within = ", ".join(f"{100 * level:.4g} % of robots within |d| {_quantile(result, rank, result.worst_pose)[0]} mm"
                       for rank, level in enumerate(LEVELS[1:], start=1))  # fmt: skip
    return f"worst {_name(result, result.worst_pose)}: {within}"


def _name(result: PosesResult, pose: int) -> str:
    name = result.names[pose]
    return f"pose {shown(name)}" if name else pose_labels(result.names)[pose]


def _verdict(result: PosesResult, specification: PosesSpecification, *, is_brief: bool = False) -> str:
    worst = specification.results[specification.worst]
    pose = _name(result, specification.worst)
    demand = f"{'' if is_brief else 'spec '}{demanded(worst)} at every pose: {specification.said}"
    if specification.verdict == "not judged":
        return demand
    if specification.verdict == "nothing to judge" and worst.verdict == specification.verdict:
        return f"{demand} - {pose}: {NOTHING_VARIES}"
    share, low, high = format_share(worst.probability, worst.interval, worst.required)
    if is_brief:
        return f"{demand} - worst {pose}, {share} % inside"
    kept = sum(of.met for of in specification.results)
    together = ""
    if specification.everywhere is not None:
        of_all = specification.everywhere
        kept_share, *ends = format_share(of_all.probability, of_all.interval, of_all.required)
        together = f"; {kept_share} % of robots keep it at all poses, interval {ends[0]} to {ends[1]} %"
    more = ": more samples decide it" if specification.verdict == "undecided" else ""
    return (
        f"{demand} - worst {pose}, {share} % inside, interval {low} to {high} %; "
        f"met at {kept:,} of {len(specification.results):,} poses{together}{more}"
    )


def _rows(result: PosesResult, listed: Sequence[int], has_intervals: bool) -> list[list[str]]:
    """Return the heading and a row for each pose; the median's interval is left out, so that the row fits a terminal."""
    levels = range(len(LEVELS))
    rows, labels = [["pose", "median"]], pose_labels(result.names)
    for level in LEVELS[1:]:
        rows[0] += [f"{100 * level:.4g} %", *["interval"] * has_intervals]
    rows[0] += [f"spec {rank}" for rank in range(1, len(result.specifications) + 1)]
    for pose in listed:
        (median, _), *others = (_quantile(result, rank, pose) for rank in levels)
        judged = [specification.results[pose] for specification in result.specification_results]
        shares = [
            f"{format_share(of.probability, of.interval, of.required)[0]} %{'' if of.met else f' {of.verdict}'}"
            for of in judged
        ]
        worst = " (worst)" if pose == result.worst_pose else ""
        quantiles = [cell for pair in others for cell in pair[: 1 + has_intervals]]
        rows.append([labels[pose] + worst, median, *quantiles, *shares])
    return rows


def _quantile(result: PosesResult, rank: int, pose: int) -> tuple[str, str]:
    """Return a quantile of |d| in mm and its interval."""
    value, (low, high) = float(result.quantile[rank, 0, pose]), result.quantile_interval[rank, 0, :, pose].tolist()
    if np.isnan(value):
        return "-", "-"
    if high < ROUNDING:
        return "0", "[0, 0]"
    below, above = format_interval(low, high, 1e3)
    return format_inside(1e3 * value, (1e3 * low, 1e3 * high), most=5), f"[{below}, {above}]"
