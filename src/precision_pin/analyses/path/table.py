"""Terminal table of the largest error along a path."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.path.path_law import PathResult
from precision_pin.base.errors import shortened, shown, visible
from precision_pin.render.tables import resting_on, symbol
from precision_pin.render.text_table import aligned
from precision_pin.sampling.table import demanded, verdict_line
from precision_pin.statistics import format_inside, format_share
from precision_pin.statistics.intervals import format_interval, round_end

_QUANTITIES: Final = (("position.norm", "mm"), ("attitude.norm", "mrad"))
# number of poses up to which all are listed
_MOST_ROWS: Final = 12
# number of poses listed otherwise: those with most of the largest |d|
_WORST_ROWS: Final = 10
_MOST_LETTERS: Final = 24


def path_table(result: PathResult) -> str:
    """Return the answer in words, the quantiles of the largest errors, the bands, and a row for each pose."""
    of, times = result.provenance, result.poses.times
    share = f"{100 * result.probability:.6g} %"
    duration = "" if times is None else f", {float(times[-1] - times[0]):.6g} s"
    lines = [
        headline(result),
        where_line(result),
        *verdict_lines(result),
        "",
        f"{visible(of.robot)}: {visible(of.base)} to {visible(of.tip)}, a path of {len(result.poses):,} poses{duration}",
        f"{result.samples:,} robots, seed {of.seed}, {result.model} model, statics {of.statics}; intervals and digits at "
        f"{result.confidence:.0%} confidence",
        "",
        *aligned(maximum_rows(result)),
        "",
        *band_lines(result),
        "",
        *aligned(pose_rows(result)),
    ]
    hidden = len(result.poses) - len(_listed(result))
    lines += [f"and {hidden:,} more poses: --json FILE writes all"] if hidden else []
    lines += [
        "",
        f"|d|, |δ|: {share} quantile at the pose; largest here: robots with their largest error of the path there",
    ]
    lines += resting_on(of.assumed, of.sources, of.origins, of.origins_at)
    return "\n".join(lines)


def headline(result: PathResult) -> str:
    """Return the largest error of most robots along the path in a sentence."""
    share = result.probability
    sizes = (
        f"{symbol(one)} {quantile_text(result, norm, share)[0]} {unit}" for norm, (one, unit) in enumerate(_QUANTITIES)
    )
    return f"largest error along the path: {100 * share:.6g} % of robots within {', '.join(sizes)}"


def where_line(result: PathResult) -> str:
    """Return where most robots have their largest position error in a sentence."""
    where = _label(result, result.worst_pose(0))
    return f"most often at {where}: {100 * float(result.share_of_maximum[0].max()):.3g} % of robots have their largest |d| there"


def verdict_lines(result: PathResult) -> list[str]:
    """Return a line for each specification."""
    samples = "{share} % of robots inside at every pose, interval {low} to {high} %"
    more = {"undecided": ": more samples decide it"}
    return [
        verdict_line(f"spec {demanded(one)} along the whole path", one, samples + more.get(one.verdict, ""))
        for one in result.specification_results
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
        held, low, high = format_share(band.coverage, band.coverage_interval, result.probability)
        below, *ends = format_share(pointwise.coverage, pointwise.coverage_interval, result.probability)
        limit, themselves = (
            f"{_upwards(band.factor or 0.0, 5)} times the {share} quantiles at every pose",
            "the quantiles themselves",
        )
        if band.factor is None:
            limit = f"{_upwards(1e3 * float(result.band[norm].max()))} {unit} at every pose"
            themselves = f"0, the {share} quantile at every pose"
        lines.append(
            f"{symbol(quantity)}: at least {share} of robots stay below {limit} ({held} % of fresh ones, {low} to {high} %), "
            f"{below} % ({ends[0]} to {ends[1]} %) below {themselves}"
        )
    return lines


def pose_rows(result: PathResult) -> list[list[str]]:
    """Return the cells of the listed poses, headings first."""
    rows = [["pose", "|d| mm", "band", "largest here", "|δ| mrad", "band", "largest here"]]
    for pose in _listed(result):
        cells = [_label(result, pose)]
        for norm in (0, 1):
            low, high = (1e3 * result.curve_interval[:, norm, pose]).tolist()
            cells.append(format_inside(1e3 * float(result.curve[norm, pose]), (low, high), most=5))
            cells.append(_upwards(1e3 * float(result.band[norm, pose])))
            cells.append(f"{100 * float(result.share_of_maximum[norm, pose]):.1f} %")
        rows.append(cells)
    return rows


def quantile_text(result: PathResult, norm: int, probability: float, most: int = 5) -> tuple[str, str]:
    """Return a quantile of the largest |d| or |δ| to at most so many digits, and its interval, mm or mrad."""
    one = result.maximum_quantile(norm, probability)
    if one.value is None or one.interval is None:
        return "-", "-"
    ends = (1e3 * one.interval[0], 1e3 * one.interval[1])
    return format_inside(1e3 * one.value, ends, most=most), " to ".join(format_interval(*one.interval, 1e3))


def _label(result: PathResult, pose: int) -> str:
    label = result.poses.labels[pose]
    return shown(label) if len(label) <= _MOST_LETTERS else shortened(visible(label), _MOST_LETTERS)


def _upwards(value: float, digits: int = 4) -> str:
    """Return the height of a band rounded up, so that the printed value holds as many robots."""
    return f"{round_end(value, digits, up=True):.{digits}g}"


def _listed(result: PathResult) -> list[int]:
    """Return the listed poses in order: all, or those where most robots have their largest |d|."""
    poses = range(len(result.poses))
    if len(poses) <= _MOST_ROWS:
        return list(poses)
    shares, curve = result.share_of_maximum[0], result.curve[0]
    return sorted(sorted(poses, key=lambda pose: (-shares[pose], -curve[pose]))[:_WORST_ROWS])
