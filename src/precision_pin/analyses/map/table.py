"""Terminal table of a map."""

from __future__ import annotations

from typing import Final

import numpy as np

from precision_pin.analyses.map.map_poses import MapResult
from precision_pin.analyses.map.map_verdicts import MapVerdict
from precision_pin.base.errors import shortened, shown, visible
from precision_pin.render.tables import milli
from precision_pin.render.text_table import aligned, limited, remainder
from precision_pin.robot.pose_set import OBSTRUCTED
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.sampling.table import demanded
from precision_pin.statistics import format_share
from precision_pin.statistics.intervals import format_interval

# number of poses up to which all are listed
_MOST_ROWS: Final = 12
# number of poses listed otherwise, worst first
_WORST_ROWS: Final = 10
# number of specifications for whose columns a terminal has room
_MOST_SPECS: Final = 4
_MOST_LETTERS: Final = 17  # of a name in a table row
# smallest fraction resolved by the closed form: its integral is accurate to this
_SMALLEST: Final = 1e-7
_LEVEL: Final = LEVELS.index(0.95)
_UPPER: Final = tuple(enumerate(LEVELS))[1:]


def map_table(result: MapResult) -> str:
    """Return the summary for a designer, worst pose and verdicts, then a row for each of the worst poses."""
    run = result.provenance
    count = len(result.poses)
    rows = worst_rows(result)
    poses = f"{count:,} pose{'' if count == 1 else 's'}"
    lines = [
        *answers(result),
        "",
        f"{visible(run.arm)}, map of {poses}: {result.poses.counts}",
        f"closed form, first order, normal error, statics {run.statics}; {_describe_sampling(result)}",
        "",
        *aligned([list(rows[0]), *(list(row.values()) for row in rows)]),
    ]
    marks = "spec: share inside, * not met, ? undecided; " if result.specifications else ""
    lines += remainder(len(result.worst_first) - len(rows), "poses")
    lines += remainder(len(result.specifications) - len(result.specifications[: limited(_MOST_SPECS)]), "specs")
    lines += [
        "",
        "quantiles of |d| in mm, |δ| in mrad, closed form; limits: of the exact 95 %, whatever the laws;",
        f"sampled: its interval; {marks}cause: of most variance",
    ]
    lines += run.resting_lines
    return "\n".join(lines)


def answers(result: MapResult) -> list[str]:
    """Return the summary: the worst pose, the range over the poses, the verdicts."""
    return [*_worst(result), *(_verdict(result, verdict) for verdict in result.verdicts)]


def worst_rows(result: MapResult) -> list[dict[str, str]]:
    """Return the cells of the worst poses by their headings; of all if they are few."""
    return [_cells(result, pose) for pose in _list_poses(result)]


def _describe_sampling(result: MapResult) -> str:
    if result.sampled is None:
        return "nothing was sampled"
    sampled, judged = result.sampled.result, result.judged.samples
    known = len(result.worst_first)
    is_complete = len(result.sampled.poses) == known
    poses = "every pose" if is_complete else f"the {len(result.sampled.poses):,} worst"
    text = f"{poses} sampled: {sampled.samples:,} robots, seed {sampled.seed}, {result.confidence:.0%} intervals"
    if is_complete or not result.specifications:
        return text
    smallest, largest = int(judged[judged > 0].min()), int(judged.max())
    return f"every pose judged by {smallest:,}{f' to {largest:,}' if largest > smallest else ''} robots, {text}"


def _worst(result: MapResult) -> list[str]:
    worst = result.worst_first[0]
    of_all = result.quantile[_LEVEL, 0, result.poses.known]
    norms = [f"{milli(float(result.quantile[rank, 0, worst]), 4)} mm for {100 * level:.4g} %" for rank, level in _UPPER]
    lines = [f"worst pose {shown(result.poses.labels[worst])}: |d| within {', '.join(norms)} of robots in closed form"]
    sampled = _interval(result, worst, _LEVEL), _interval(result, worst, len(LEVELS) - 1)
    if "-" not in sampled:
        lines[0] += f", {sampled[0]} and {sampled[1]} mm sampled"
    if len(of_all) > 1:
        smallest, middle, largest = (f"{1e3 * value:.4g}" for value in np.quantile(of_all, (0, 0.5, 1)))
        extent = f"{smallest} to {largest} mm, median {middle} mm"
        lines.append(f"95 % of robots within |d| over the poses: {extent}, in closed form")
    if result.relative is not None:
        relative = np.where(result.poses.known, result.relative.quantile[_LEVEL, 0], -1.0)
        pose = int(relative.argmax())
        lines.append(
            f"relative to the reference: 95 % of robots within |d| {1e3 * relative[pose]:.4g} mm at worst "
            f"({shown(result.poses.labels[pose])}), in closed form"
        )
    if result.unknown:
        cause = ", or the arm hits something there," if set(OBSTRUCTED) & set(result.poses.status) else ""
        lines.append(f"{result.unknown:,} of {len(result.poses):,} poses cannot be reached{cause} and are not judged")
    return lines


def _verdict(result: MapResult, verdict: MapVerdict) -> str:
    demand = f"spec {demanded(verdict.specification)} at every pose: "
    if result.grounds.not_judged:
        return f"{demand}{result.grounds.said('not judged')}"
    demand += f"{verdict.verdict.upper()}{result.grounds.taken if verdict.met else ''}"
    place = shown(result.poses.labels[verdict.worst])
    if verdict.sampled is None:
        return f"{demand} - nothing was sampled; worst {place}, {_share(verdict.share)} inside in closed form"
    judged = verdict.sampled
    share, low, high = format_share(judged.probability, judged.interval, judged.required)
    text = (
        f"{demand} - worst {place}, {share} % inside, interval {low} to {high} %, {_share(verdict.share)} in closed form; "
        f"met at {verdict.met_at:,} of {verdict.judged:,} poses"
    )
    if not verdict.undecided_at:
        return text
    needed = f"about --samples {verdict.needed} would decide"
    advice = needed if verdict.needed else "too close to what is required to decide"
    return f"{text}, undecided at {verdict.undecided_at:,} by up to {verdict.most_samples:,} robots: {advice}"


def _list_poses(result: MapResult) -> list[int]:
    worst = result.worst_first
    return sorted(worst) if len(worst) <= _MOST_ROWS else worst[: limited(_WORST_ROWS)]


def _cells(result: MapResult, pose: int) -> dict[str, str]:
    """Return the cells of a row by their headings; the least important are omitted to fit a terminal."""
    has_several = len(result.specifications) > 1
    cells = {"pose": shortened(visible(result.poses.labels[pose]), _MOST_LETTERS)}
    if result.relative is None and not result.specifications:
        cells["median"] = _number(result.quantile[0, 0, pose])
    low, high = 1e3 * result.quantile_bounds[_LEVEL, 0, :, pose]
    cells |= {"95 %": _number(result.quantile[_LEVEL, 0, pose]), "limits": f"{low:.3g}-{high:.3g}"}
    cells |= {"sampled": _interval(result, pose, _LEVEL), "99.73 %": _number(result.quantile[-1, 0, pose])}
    cells |= {"|δ| 95 %": _number(result.quantile[_LEVEL, 1, pose])}
    if result.relative is not None:
        cells["relative"] = _number(result.relative.quantile[_LEVEL, 0, pose])
    ranks = range(len(result.specifications[: limited(_MOST_SPECS)]))
    cells |= {f"spec {rank + 1}": _share_inside(result, rank, pose) for rank in ranks}
    if not has_several and (result.relative is None or not result.specifications):
        cells["cause"] = shortened(visible(result.dominant_source[pose]), _MOST_LETTERS) or "-"
    return cells


def _share_inside(result: MapResult, rank: int, pose: int) -> str:
    """Return the sampled fraction inside a specification, marked if it is not met, or that in closed form."""
    if not result.judged.samples[pose]:
        return _share(float(result.probability[rank, pose]))
    judged, verdict = result.judged, result.judged.verdicts(pose)[rank]
    interval = judged.interval[rank, :, pose].tolist()
    required = result.specifications[rank].required
    share = format_share(float(judged.probability[rank, pose]), (interval[0], interval[1]), required)
    return f"{share[0]} %{ {'not met': '*', 'undecided': '?'}.get(verdict, '') }"


def _interval(result: MapResult, pose: int, rank: int) -> str:
    if result.sampled is None or pose not in result.sampled.poses:
        return "-"
    place = int(np.flatnonzero(result.sampled.poses == pose)[0])
    sampled = result.sampled.result
    low, high = sampled.quantile_interval[rank, 0, :, place].tolist()
    return "-" if np.isnan(sampled.quantile[rank, 0, place]) else "[{}, {}]".format(*format_interval(low, high, 1e3))


def _number(value: float) -> str:
    return f"{1e3 * float(value):.4g}"


def _share(share: float) -> str:
    return f"<{100 * _SMALLEST:.5f} %" if share < _SMALLEST else f"{100 * share:.4g} %"
