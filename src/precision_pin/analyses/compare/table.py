"""Terminal table of a comparison."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.compare.compare import LEVELS, ComparisonResult, Difference, PoseComparison
from precision_pin.analyses.monte_carlo.table import demanded, verdict_line
from precision_pin.base.errors import shortened, shown, visible
from precision_pin.render.tables import milli, resting_on, symbol
from precision_pin.render.text_table import aligned
from precision_pin.sampling.result import MonteCarloResult
from precision_pin.statistics import format_inside
from precision_pin.statistics.intervals import format_interval

_SHOWN: Final = (("position.norm", "mm"), ("attitude.norm", "mrad"))
_MOST_CAUSES: Final = 8
_MOST_DIFFERENCES: Final = 20
_MOST_LETTERS: Final = 30


def comparison_table(result: ComparisonResult) -> str:
    """Return which model is better and by how much, then laws, verdicts, causes, and the differences of the sheets."""
    of = result.provenance
    lines = [
        *(headline(result, rank) for rank in range(1, len(result.names))),
        *_verdicts(result),
        "",
        f"{visible(of.robot)}: {visible(of.base)} to {visible(of.tip)}",
        f"{result.samples:,} robots, the same in all, seed {of.seed}, {result.model} model",
        f"intervals and digits at {result.confidence:.0%} confidence; differences: to {shown(result.names[0])}",
    ]
    for pose in result.poses:
        lines += ["", *_pose(result, pose)]
    for name, changes in zip(result.names[1:], result.sheet_differences, strict=True):
        other = f" has otherwise than {shown(result.names[0])}:" if changes else ": the same sheet"
        lines += ["", f"{shown(name)}{other}"]
        rows = [
            [f"  {shortened(visible(one.path), 50)}", _written(one.before), "->", _written(one.after)]
            for one in changes[:_MOST_DIFFERENCES]
        ]
        lines += aligned(rows) if rows else []
        more = len(changes) - len(rows)
        lines += [f"  and {more:,} more: --json FILE writes all"] if more > 0 else []
    return "\n".join([*lines, *resting_on(of.assumed, of.sources, of.origins, of.origins_at)])


def headline(result: ComparisonResult, rank: int) -> str:
    """Return a sentence that compares a model with the first at the first model's worst pose."""
    pose = result.poses[result.worst_pose()]
    one = pose.differences[rank - 1].quantiles["position.norm"][0.95]
    first, other = (_quantile(pose.laws[k], "position.norm", 0.95) for k in (0, rank))
    names = shown(result.names[0]), shown(result.names[rank])
    where = f" at the worst pose {shown(pose.label.name)}" if len(result.poses) > 1 else ""
    within = f"95 % of robots within |d| {other} mm instead of {first}{where}"
    if one.interval is None:
        return f"{names[1]} against {names[0]}: {within}; the robots are too few to tell the difference"
    if one.value == 0 and one.interval == (0.0, 0.0):
        return f"{names[1]} and {names[0]} do not differ in |d|{where}: 95 % of robots within {first} mm"
    if not one.is_told:
        return f"{names[1]} is not told from {names[0]}: {within}, difference {_signed(one)} mm"
    better = "better" if one.value < 0 else "worse"
    return f"{names[1]} is {better} than {names[0]}: {within}, {_signed(one)} mm"


def _verdicts(result: ComparisonResult) -> list[str]:
    """Return a line for each specification, model and pose where it is judged; with several poses only those missed."""
    lines = []
    for rank, name in enumerate(result.names):
        for pose in result.poses:
            for number, one in enumerate(pose.laws[rank].summary.specifications):
                where = f" at {shown(pose.label.name or 'the pose')}" if len(result.poses) > 1 else ""
                change = "" if rank == 0 else f", {_points(pose.differences[rank - 1].shares[number])}"
                verdict = verdict_line(f"spec {demanded(one)}", one, "{share} % inside, {low} to {high} %")
                lines.append(f"{shown(name)}: {verdict}{where}{change}")
    return lines


def _points(change: Difference) -> str:
    if change.interval is None:
        return f"change {100 * change.value:+.2g} points"
    low, high = (100 * end for end in change.interval)
    return f"change {100 * change.value:+.3g} points ({low:+.3g} to {high:+.3g})"


def _pose(result: ComparisonResult, pose: PoseComparison) -> list[str]:
    title = [f"pose {shown(pose.label.name)}"] if pose.label.name and len(result.poses) > 1 else []
    heads = [f"{100 * level:.4g} %" for level in LEVELS]
    rows = [["", "", "mean", *heads, *(f"change of {head}" for head in heads[1:])]]
    for quantity, unit in _SHOWN:
        for rank, (name, law) in enumerate(zip(result.names, pose.laws, strict=True)):
            of = law.position.norm if quantity.startswith("position") else law.attitude.norm
            cells = [milli(of.mean, 4), *(_quantile(law, quantity, level) for level in LEVELS)]
            by_level = pose.differences[rank - 1].quantiles[quantity] if rank else {}
            cells += [_signed(by_level[level]) if rank else "" for level in LEVELS[1:]]
            label = f"{symbol(quantity)} {unit}" if rank == 0 else ""
            rows.append([label, shortened(visible(name), _MOST_LETTERS), *cells])
    return [*title, *aligned(rows), "", *_causes(result, pose)]


def _causes(result: ComparisonResult, pose: PoseComparison) -> list[str]:
    """Return the largest lines of sources, by their largest contribution to the variance in any model."""
    names = dict.fromkeys(name for variance in pose.variances for name in variance)
    largest = {name: max(variance.get(name, 0.0) for variance in pose.variances) for name in names}
    listed = [name for name in sorted(names, key=lambda name: -largest[name]) if largest[name] > 0][:_MOST_CAUSES]
    head = ["variance of the position, mm²", *(shortened(visible(name), _MOST_LETTERS) for name in result.names)]
    rows = [
        [shortened(visible(name), _MOST_LETTERS), *(_variance(variance.get(name)) for variance in pose.variances)]
        for name in listed
    ]
    total = ["all", *(_variance(sum(variance.values())) for variance in pose.variances)]
    return aligned([head, *rows, total])


def _variance(value: float | None) -> str:
    return "-" if value is None else f"{1e6 * value:.3g}"


def _quantile(law: MonteCarloResult, quantity: str, level: float) -> str:
    of = law.position.norm if quantity.startswith("position") else law.attitude.norm
    value, ends = of.quantile(level), of.quantile_interval(level)
    if value is None or ends is None:
        return "-"
    return format_inside(1e3 * value, (1e3 * ends[0], 1e3 * ends[1]), most=5)


def _signed(one: Difference) -> str:
    if one.interval is None:
        return f"{1e3 * one.value:+.3g}"
    low, high = format_interval(*one.interval, 1e3)
    value = format_inside(1e3 * one.value, (1e3 * one.interval[0], 1e3 * one.interval[1]), most=5)
    sign = "+" if one.value > 0 else ""
    return f"{sign}{value} ({low} to {high})"


def _written(value: str | None) -> str:
    return "-" if value is None else shortened(visible(value), _MOST_LETTERS)
