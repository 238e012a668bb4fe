"""Terminal table of the largest error along a path."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.path.path_law import PathResult
from precision_pin.base.errors import shortened, shown, visible
from precision_pin.render.tables import symbol
from precision_pin.render.text_table import aligned, limited, remainder
from precision_pin.sampling.table import demanded, verdict_line
from precision_pin.statistics import format_inside, format_share
from precision_pin.statistics.intervals import format_interval, round_end

_QUANTITIES: Final = (("position.norm", "mm"), ("attitude.norm", "mrad"))
# number of poses up to which all are listed
_MOST_ROWS: Final = 12
# number of poses listed otherwise: those with most of the largest |d|
_WORST_ROWS: Final = 10
_MOST_LETTERS: Final = 24  # of a name in a table row


def path_table(result: PathResult) -> str:
    """Return the answer in words, the quantiles of the largest errors, the bands, and a row for each pose."""
    run, times = result.provenance, result.poses.times
    share = f"{100 * result.probability:.6g} %"
    duration = "" if times is None else f", {float(times[-1] - times[0]):.6g} s"
    lines = [
        headline(result),
        where_line(result),
        *verdict_lines(result),
        "",
        f"{visible(run.arm)}, a path of {len(result.poses):,} poses{duration}",
        f"{result.samples:,} robots, seed {run.seed}, {result.model} model, statics {run.statics}; intervals and digits at "
        f"{result.confidence:.0%} confidence",
        "",
        *aligned(maximum_rows(result)),
        "",
        *band_lines(result),
        "",
        *aligned(pose_rows(result)),
    ]
    lines += remainder(len(result.poses) - len(_list_poses(result)), "poses")
    lines += [
        "",
        f"|d|, |δ|: {share} quantile at the pose; largest here: robots with their largest error of the path there",
    ]
    lines += run.resting_lines
    return "\n".join(lines)


def headline(result: PathResult) -> str:
    """Return the largest error of most robots along the path in a sentence."""
    level = result.probability
    sizes = (
        f"{symbol(name)} {quantile_text(result, k, level)[0]} {unit}" for k, (name, unit) in enumerate(_QUANTITIES)
    )
    return f"largest error along the path: {100 * level:.6g} % of robots within {', '.join(sizes)}"


def where_line(result: PathResult) -> str:
    """Return where most robots have their largest position error in a sentence."""
    label = _label(result, result.worst_pose(0))
    return f"most often at {label}: {100 * float(result.share_of_maximum[0].max()):.3g} % of robots have their largest |d| there"


def verdict_lines(result: PathResult) -> list[str]:
    """Return a line for each specification."""
    samples = "{share} % of robots inside at every pose, interval {low} to {high} %"
    suffixes = {"undecided": ": more samples decide it"}
    return [
        verdict_line(f"spec {demanded(spec)} along the whole path", spec, samples + suffixes.get(spec.verdict, ""))
        for spec in result.specification_results
    ]


def maximum_rows(result: PathResult) -> list[list[str]]:
    """Return the quantiles of the largest errors, headings first."""
    headings = [cell for level in result.levels for cell in (f"{100 * level:.6g} %", "interval")]
    rows = [["largest", "", *headings]]
    for norm, (quantity, unit) in enumerate(_QUANTITIES):
        cells = [cell for level in result.levels for cell in quantile_text(result, norm, level)]
        rows.append([symbol(quantity), unit, *cells])
    # the median's interval is left out: the row must fit a terminal
    return [[*row[:3], *row[4:]] for row in rows]


def band_lines(result: PathResult) -> list[str]:
    """Return a line for the band of the position and of the attitude."""
    lines, share = [], f"{100 * result.probability:.6g} %"
    for norm, (quantity, unit) in enumerate(_QUANTITIES):
        band, pointwise = result.simultaneous(norm), result.pointwise(norm)
        coverage, low, high = format_share(band.coverage, band.coverage_interval, result.probability)
        pointwise_share, *interval = format_share(pointwise.coverage, pointwise.coverage_interval, result.probability)
        limit, alternative = (
            f"{_round_up(band.factor or 0.0, 5)} times the {share} quantiles at every pose",
            "the quantiles themselves",
        )
        if band.factor is None:
            limit = f"{_round_up(1e3 * float(result.band[norm].max()))} {unit} at every pose"
            alternative = f"0, the {share} quantile at every pose"
        lines.append(
            f"{symbol(quantity)}: at least {share} of robots stay below {limit} ({coverage} % of fresh ones, {low} to {high} %), "
            f"{pointwise_share} % ({interval[0]} to {interval[1]} %) below {alternative}"
        )
    return lines


def pose_rows(result: PathResult) -> list[list[str]]:
    """Return the cells of the listed poses, headings first."""
    rows = [["pose", "|d| mm", "band", "largest here", "|δ| mrad", "band", "largest here"]]
    for pose in _list_poses(result):
        cells = [_label(result, pose)]
        for norm in (0, 1):
            low, high = (1e3 * result.curve_interval[:, norm, pose]).tolist()
            cells.append(format_inside(1e3 * float(result.curve[norm, pose]), (low, high), most=5))
            cells.append(_round_up(1e3 * float(result.band[norm, pose])))
            cells.append(f"{100 * float(result.share_of_maximum[norm, pose]):.1f} %")
        rows.append(cells)
    return rows


def quantile_text(result: PathResult, norm: int, probability: float, most: int = 5) -> tuple[str, str]:
    """Return a quantile of the largest |d| or |δ| to at most ``most`` digits, and its interval, mm or mrad."""
    value = result.maximum_quantile(norm, probability)
    if value.value is None or value.interval is None:
        return "-", "-"
    ends = (1e3 * value.interval[0], 1e3 * value.interval[1])
    return format_inside(1e3 * value.value, ends, most=most), " to ".join(format_interval(*value.interval, 1e3))


def _label(result: PathResult, pose: int) -> str:
    label = result.poses.labels[pose]
    return shown(label) if len(label) <= _MOST_LETTERS else shortened(visible(label), _MOST_LETTERS)


def _round_up(value: float, digits: int = 4) -> str:
    """Return the height of a band rounded up, so that the printed value holds as many robots."""
    return f"{round_end(value, digits, up=True):.{digits}g}"


def _list_poses(result: PathResult) -> list[int]:
    """Return the listed poses in order: all, or those where most robots have their largest |d|."""
    poses = range(len(result.poses))
    if len(poses) <= _MOST_ROWS:
        return list(poses)
    shares, curve = result.share_of_maximum[0], result.curve[0]
    return sorted(sorted(poses, key=lambda pose: (-shares[pose], -curve[pose]))[: limited(_WORST_ROWS)])
