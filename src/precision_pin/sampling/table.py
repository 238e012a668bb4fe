"""Tables and verdicts of the sampled law for a terminal."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Final

import numpy as np

from precision_pin.base.errors import shown, visible
from precision_pin.model.datum import datum_text
from precision_pin.model.pose_model import origin_shares
from precision_pin.render.tables import ROUNDING, bounded, joint_text, pose_labels, resting_on, symbol, unit
from precision_pin.render.text_table import aligned
from precision_pin.sampling.poses_result import LEVELS, PosesResult, PosesSpecification
from precision_pin.sampling.result import Correlated, MonteCarloResult
from precision_pin.statistics import Distribution, Specification, SpecificationResult, format_inside, format_share
from precision_pin.statistics.distribution import CONTENTS
from precision_pin.statistics.intervals import format_interval

NOTHING_VARIES: Final = "no source of the sheet makes it vary at this pose, so no tolerance was tried"
"""Reason why there is nothing to judge."""


_BRIEF: Final = ("mean", "std", 0.5, 0.95, 0.99, 0.9973)
_COLUMNS: Final = ("mean", "std", "min", "max", "mode", 0.5, 0.95, 0.99, 0.9973)


def analysis_table(analysis: MonteCarloResult, *, is_whole: bool = False) -> str:
    """Return the table of an analysis: error statistics in mm and mrad, with the answer first and last.

    Only the digits that the sampling supports are printed; min and max are the smallest and largest seen.
    """
    return "\n".join([*(_whole(analysis) if is_whole else _brief(analysis)), *_answer(analysis)])


def _brief(analysis: MonteCarloResult) -> list[str]:
    cells = _statistics(analysis, _BRIEF)
    advice = "--all: extremes, mode, tolerance bounds, error at the means" + ", correlations" * bool(
        analysis.correlations
    )
    unresolved = "; - not resolved" * any("-" in row for row in cells)
    return [
        f"{visible(analysis.robot)}: {visible(analysis.base)} to {visible(analysis.tip)}{datum_text(analysis.datum)}, pose "
        + pose_text(analysis.pose_name, analysis.q, analysis.sliding_joints, analysis.approach, is_named=False),
        *_relative(analysis, is_named=False),
        f"{analysis.samples:,} samples, seed {analysis.seed}, {analysis.model} model, statics {analysis.statics}, "
        f"base axes, {analysis.summary.confidence:.0%} confidence",
        f"95 % of robots within {_within(analysis, 0.95)}; 99.73 % within {_within(analysis, 0.9973)}",
        *datum_lines(analysis),
        *map(_verdict, analysis.summary.specifications),
        "",
        *aligned(cells),
        "",
        f"{advice}{unresolved}",
        *resting_on(analysis.assumed, analysis.sources, analysis.origins, is_brief=True),
    ]


def datum_lines(analysis: MonteCarloResult) -> list[str]:
    """Return a line with the 95 % quantiles of |d| against the datum and in base axes, and the effect of the datum."""
    record = analysis.datum
    if record is None or analysis.relative_to is not None:
        return []
    sizes = f"95 % of robots within |d| {statistic(analysis.position.norm, 0.95)} mm"
    if (base := record.base_axes) is not None:
        (value, *_), ((low, high), *_) = 1e3 * base["quantile_95"], 1e3 * base["interval"]
        size = format_inside(value, (low, high), most=5)
        sizes += f"; in base axes {size} mm ({base['samples']:,} of these robots)"
    return [f"{record.procedure_text}: {sizes}" + (f"; {record.effect.text}" if record.effect else "")]


def _answer(analysis: MonteCarloResult) -> list[str]:
    """Return the last lines of the table: each verdict, or the sizes that most robots keep."""
    results = analysis.summary.specifications
    if not results:
        return [f"95 % of robots within {_within(analysis, 0.95)}"]
    return [verdict_line(demanded(result), result, "{share} % inside") for result in results]


def _whole(analysis: MonteCarloResult) -> list[str]:
    pose = pose_text(analysis.pose_name, analysis.q, analysis.sliding_joints, analysis.approach)
    lines = [
        f"{visible(analysis.robot)}: {visible(analysis.base)} to {visible(analysis.tip)}{datum_text(analysis.datum)}, "
        f"pose {pose}",
        *_relative(analysis),
        f"{analysis.samples:,} samples, seed {analysis.seed}, {analysis.model} model, statics {analysis.statics}; "
        "errors in base axes, intervals and digits at "
        f"{analysis.summary.confidence:.0%} confidence",
        "",
        f"95 % of robots within {_within(analysis, 0.95)}; 99.73 % within {_within(analysis, 0.9973)}",
        *datum_lines(analysis),
        *map(_verdict, analysis.summary.specifications),
        "",
        *aligned(_statistics(analysis, _COLUMNS)),
        "",
        "tolerance bounds: so many of all robots lie between them, of |d| and |δ| below, "
        f"{analysis.summary.confidence:.0%} sure",
        *aligned(_rows(analysis, [f"{100 * content:.4g} % of robots" for content in CONTENTS], _bounds)),
        "",
        "min and max are the smallest and largest seen, not bounds; - is not resolved by this many samples",
        f"mode: peak of the histogram smoothed by {_bandwidths(analysis)}",
        "error with every parameter at its mean: "
        f"d = ({', '.join(map(_thousandfold, analysis.nominal[:3]))}) mm, "
        f"δ = ({', '.join(map(_thousandfold, analysis.nominal[3:]))}) mrad",
    ]
    lines += [line for group in analysis.correlations for line in _pairs(group)]
    return [*lines, *resting_on(analysis.assumed, analysis.sources, analysis.origins)]


def _relative(analysis: MonteCarloResult, *, is_named: bool = True) -> list[str]:
    other = analysis.relative_to
    if other is None:
        return []
    label = pose_text(other.name, other.q, analysis.sliding_joints, other.approach, is_named=is_named)
    return [f"relative to the same robots at pose {label}"]


def _within(analysis: MonteCarloResult, level: float) -> str:
    """Return |d| and |δ| within which a fraction of the robots stays, with units."""
    norms = (analysis.position.norm, analysis.attitude.norm)
    return ", ".join(f"{symbol(norm.quantity)} {statistic(norm, level)} {unit(norm.quantity)}" for norm in norms)


def pose_text(
    name: str,
    q: Mapping[str, float],
    sliding_joints: Collection[str],
    approach: Mapping[str, str],
    *,
    is_named: bool = True,
) -> str:
    """Return a pose's name and joint values, in degrees and mm, with the joints' last directions of motion if known."""
    values = joint_text(
        {visible(joint): value for joint, value in q.items()},
        [*map(visible, sliding_joints)],
        {visible(joint): sign for joint, sign in approach.items()},
        is_named=is_named,
    )
    return f"{shown(name)} ({values})" if name else f"({values})"


def _statistics(analysis: MonteCarloResult, columns: Sequence[str | float]) -> list[list[str]]:
    head = [column if isinstance(column, str) else f"{100 * column:.4g} %" for column in columns]
    return _rows(analysis, head, lambda part: [statistic(part, column) for column in columns])


def _rows(analysis: MonteCarloResult, head: list[str], cells: Callable[[Distribution], list[str]]) -> list[list[str]]:
    vectors = (analysis.position, analysis.attitude)
    parts = [part for vector in vectors for part in (vector.norm, vector.x, vector.y, vector.z)]
    return [["", "", *head], *([symbol(part.quantity), unit(part.quantity), *cells(part)] for part in parts)]


def _bounds(part: Distribution) -> list[str]:
    return [tolerance_bounds(part, content) for content in CONTENTS]


def statistic(distribution: Distribution, which: str | float) -> str:
    """Return a statistic (``mean``, ``std``, …, or a quantile's level) in mm or mrad; ``-`` where not resolved."""
    value = distribution.resolved_quantile(which) if isinstance(which, float) else getattr(distribution, which)
    interval = distribution.interval(which)
    if value is None or interval is None:
        return "-"
    # if few robots have an error, the error of the others is rounding
    if max(abs(distribution.min), abs(distribution.max)) < ROUNDING or max(map(abs, (value, *interval))) < ROUNDING:
        return "0"
    return format_inside(1e3 * value, (1e3 * interval[0], 1e3 * interval[1]), most=5)


def tolerance_bounds(distribution: Distribution, content: float) -> str:
    """Return the bounds of a fraction of all units in mm or mrad, rounded outwards; ``-`` where not resolved."""
    bounds = distribution.tolerance_bounds(content)
    if bounds is None:
        return "-"
    if max(abs(distribution.min), abs(distribution.max)) < ROUNDING:
        return "0"
    # to a hundredth of the spread, or five digits if there is none
    size = distribution.std or abs(bounds[1]) / 1000 or 1.0
    place = Decimal(1).scaleb(Decimal(1e3 * size).adjusted() - 2)
    low, high = (
        (Decimal(1000) * Decimal(bound)).quantize(place, rounding)
        for bound, rounding in zip(bounds, (ROUND_FLOOR, ROUND_CEILING), strict=True)
    )
    return f"{high + 0:f}" if distribution.is_norm else f"{low + 0:f} to {high + 0:f}"


def _pairs(group: Correlated) -> list[str]:
    names = [visible(name) for name in group.parameters]
    return [
        f"correlation of {names[i]} and {names[j]}: {group.scores[i][j]:.4g} of the normal scores, "
        f"{group.pearson[i][j]:.4g} of the numbers (Pearson)"
        for i, j in itertools.combinations(range(len(names)), 2)
    ]


def _bandwidths(analysis: MonteCarloResult) -> str:
    parts = []
    for norm in (analysis.position.norm, analysis.attitude.norm):
        width = norm.mode_bandwidth
        parts.append(f"{symbol(norm.quantity)} {'-' if width is None else f'{1e3 * width:.2g} {unit(norm.quantity)}'}")
    return ", ".join(parts)


def demanded(specification: Specification | SpecificationResult) -> str:
    """Return a specification as text, such as ``|d| within 0.5 mm for 95 %``; a large angle in degrees too."""
    of, limit = specification.quantity, specification.limit
    degrees = f" ({math.degrees(limit):.4g} deg)" if of.startswith("attitude") and limit >= 0.1 else ""
    return f"{bounded(of, limit, ' within ')}{degrees} for {100 * specification.required:.10g} %"


def verdict_line(demand: str, result: SpecificationResult, samples: str) -> str:
    """Return a demand with its verdict and the samples' result, a text with ``{share}``, ``{low}`` and ``{high}``."""
    line = f"{demand}: {result.said}"
    if result.verdict == "not judged":
        return line
    if result.verdict == "nothing to judge":
        return f"{line} - {NOTHING_VARIES}"
    share, low, high = format_share(result.probability, result.interval, result.required)
    return f"{line} - {samples.format(share=share, low=low, high=high)}"


def _verdict(result: SpecificationResult) -> str:
    index = f", Cpk {result.cpk:.2f}" if math.isfinite(result.cpk) else ""
    more = ": more samples decide it" if result.verdict == "undecided" else ""
    samples = f"{{share}} % inside, interval {{low}} to {{high}} %{index}{more}"
    return verdict_line(f"spec {demanded(result)}", result, samples)


def _thousandfold(value: float) -> str:
    return f"{1e3 * value if abs(value) > ROUNDING else 0.0:.4g}"


_MOST_ROWS: Final = 8
"""Number of poses up to which all are listed."""
_WORST_ROWS: Final = 6
"""Number of poses listed otherwise, worst first."""


def poses_table(result: PosesResult, *, is_whole: bool = False) -> str:
    """Return a designer's summary of several poses, worst pose and verdicts, then a row for each pose."""
    poses = list(range(result.poses))
    if result.poses > _MOST_ROWS and not is_whole:
        poses = result.worst_first[:_WORST_ROWS]
    left_out = result.poses - len(poses)
    specifications = result.specification_results
    model = result.error_model
    shares = origin_shares(model.origins, next(model.at_columns(result.q[:, [0]])))
    lines = [
        f"{visible(result.robot)}: {visible(result.base)} to {visible(result.tip)}{datum_text(result.datum)}, "
        f"{result.poses:,} poses with the same robots",
        f"{result.samples:,} samples at each, seed {result.seed}, {result.model} model, statics {result.statics}, "
        f"{result.confidence:.0%} confidence",
        _worst(result),
        *_worst_datum(result),
        *(_poses_verdict(result, specification) for specification in specifications),
        "",
        *aligned(_pose_rows(result, poses, is_whole)),
        *([f"and {left_out:,} more poses: --all"] if left_out else []),
        "",
        "quantiles of |d| in mm, shares inside each spec; - is not resolved",
        *resting_on(model.assumed, len(model.sources), shares, pose_labels(result.names)[0], is_brief=not is_whole),
        *([_poses_verdict(result, spec, is_brief=True) for spec in specifications] or [_worst(result)]),
    ]
    return "\n".join(lines)


def _worst(result: PosesResult) -> str:
    phrase = ", ".join(f"{100 * level:.4g} % of robots within |d| {_pose_quantile(result, rank, result.worst_pose)[0]} mm"
                       for rank, level in enumerate(LEVELS[1:], start=1))  # fmt: skip
    return f"worst {_pose_name(result, result.worst_pose)}: {phrase}"


def _worst_datum(result: PosesResult) -> list[str]:
    """Return a line with the effect of the datum at the worst pose."""
    if result.datum is None or (effect := result.datum.effect) is None:
        return []
    sizes = f"std of d {1e3 * effect.with_datum[0]:.3g} mm, in base axes {1e3 * effect.without[0]:.3g} mm, first order"
    return [f"{result.datum.procedure_text}, {_pose_name(result, result.worst_pose)}: {sizes}; {effect.text}"]


def _pose_name(result: PosesResult, pose: int) -> str:
    name = result.names[pose]
    return f"pose {shown(name)}" if name else pose_labels(result.names)[pose]


def _poses_verdict(result: PosesResult, specification: PosesSpecification, *, is_brief: bool = False) -> str:
    worst = specification.results[specification.worst]
    pose = _pose_name(result, specification.worst)
    demand = f"{'' if is_brief else 'spec '}{demanded(worst)} at every pose: {specification.said}"
    if specification.verdict == "not judged":
        return demand
    if specification.verdict == "nothing to judge" and worst.verdict == specification.verdict:
        return f"{demand} - {pose}: {NOTHING_VARIES}"
    share, low, high = format_share(worst.probability, worst.interval, worst.required)
    if is_brief:
        return f"{demand} - worst {pose}, {share} % inside"
    count = sum(entry.met for entry in specification.results)
    suffix = ""
    if specification.everywhere is not None:
        of_all = specification.everywhere
        kept_share, *interval = format_share(of_all.probability, of_all.interval, of_all.required)
        suffix = f"; {kept_share} % of robots keep it at all poses, interval {interval[0]} to {interval[1]} %"
    advice = ": more samples decide it" if specification.verdict == "undecided" else ""
    return (
        f"{demand} - worst {pose}, {share} % inside, interval {low} to {high} %; "
        f"met at {count:,} of {len(specification.results):,} poses{suffix}{advice}"
    )


def _pose_rows(result: PosesResult, poses: Sequence[int], has_intervals: bool) -> list[list[str]]:
    """Return the heading and a row for each pose; the median's interval is left out to fit a terminal."""
    levels = range(len(LEVELS))
    rows, labels = [["pose", "median"]], pose_labels(result.names)
    for level in LEVELS[1:]:
        rows[0] += [f"{100 * level:.4g} %", *["interval"] * has_intervals]
    rows[0] += [f"spec {rank}" for rank in range(1, len(result.specifications) + 1)]
    for pose in poses:
        (median, _), *quantile_pairs = (_pose_quantile(result, rank, pose) for rank in levels)
        results = [specification.results[pose] for specification in result.specification_results]
        shares = [
            f"{format_share(r.probability, r.interval, r.required)[0]} %{'' if r.met else f' {r.verdict}'}"
            for r in results
        ]
        worst = " (worst)" if pose == result.worst_pose else ""
        quantiles = [cell for pair in quantile_pairs for cell in pair[: 1 + has_intervals]]
        rows.append([labels[pose] + worst, median, *quantiles, *shares])
    return rows


def _pose_quantile(result: PosesResult, rank: int, pose: int) -> tuple[str, str]:
    value, (low, high) = float(result.quantile[rank, 0, pose]), result.quantile_interval[rank, 0, :, pose].tolist()
    if np.isnan(value):
        return "-", "-"
    if high < ROUNDING:
        return "0", "[0, 0]"
    below, above = format_interval(low, high, 1e3)
    return format_inside(1e3 * value, (1e3 * low, 1e3 * high), most=5), f"[{below}, {above}]"
