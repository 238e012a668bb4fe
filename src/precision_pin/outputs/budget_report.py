"""A budget as text and as a bar chart."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from precision_pin.analyses.budget import check_quantities
from precision_pin.analyses.budget_result import (
    VECTORS,
    BudgetResult,
    DrawShare,
    Estimate,
    Group,
    PoseBudget,
    SourceShare,
)
from precision_pin.outputs.drawing import BLACK, BLUE, SKY
from precision_pin.outputs.plots import DOUBLE_COLUMN, MILLIMETRES_PER_INCH, new_figure, style
from precision_pin.outputs.text import aligned, pose_text

__all__ = ["figure", "table"]

MOST_LINES: Final = 20
MOST_BARS: Final = 12
MOST_CHARACTERS: Final = 48
MOST_DECIMALS: Final = 3


def table(result: BudgetResult, quantities: Sequence[str] = VECTORS) -> str:
    """Return the budget of every pose: per cent, mm and mrad, half-widths of intervals behind ±.

    Parameters
    ----------
    result
        What was found.
    quantities
        One block each: ``position``, ``attitude``, ``position.norm``, ``position.x``, …

    Raises
    ------
    UnknownNameError
        No such quantity.
    """
    check_quantities(quantities)
    lines = []
    for pose in result.poses:
        lines += _heads(result, pose)
        for quantity in quantities:
            lines += ["", _headline(result, pose, quantity), *aligned(_draw_rows(pose, quantity))]
        shown = list(dict.fromkeys(quantity for quantity in quantities if not quantity.endswith(".norm"))) or [*VECTORS]
        lines += ["", *aligned(_share_rows("source", shown, ((_source(s), s.share) for s in pose.sources)))]
        lines += ["", *aligned(_share_rows("joint or link", shown, ((p.name, p.share) for p in pose.places)))]
        lines += ["", *_notes(result, pose, quantities), ""]
    return "\n".join(lines).rstrip()


def figure(result: BudgetResult, pose: int = 0) -> Figure:
    """Return bars of the first-order and total Sobol indices of position and attitude, largest first, 174 mm wide.

    Diamonds are the closed-form shares; whiskers the intervals.

    Parameters
    ----------
    result
        What was found.
    pose
        Which of its poses.
    """
    found = result.poses[pose]
    bars = max(1, min(MOST_BARS, len(found.groups)))
    with style():
        made = new_figure(DOUBLE_COLUMN)
        panels = made.subplots(2, 1)
        for axes, vector in zip(panels, VECTORS, strict=True):
            _bars(axes, found, vector)
        name = _shown(found.pose.name)
        made.suptitle(f"Error budget{f', pose {name!r}' if name else ''}")
        made.legend(
            *panels[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=3,
            frameon=False,
            title=f"exact model, {result.samples:,} points, seed {result.heading.seed}; "
            f"intervals at {100 * result.confidence:g} % confidence",
        )
        made.set_size_inches(DOUBLE_COLUMN / MILLIMETRES_PER_INCH, (42 + 2 * 6.0 * bars) / MILLIMETRES_PER_INCH)
    return made


# text --------------------------------------------------------------------------------------------


def _heads(result: BudgetResult, pose: PoseBudget) -> list[str]:
    of = result.heading
    return [
        f"{of.robot}: {of.base} to {of.tip}, pose {pose_text(pose.pose.name, pose.pose.q, pose.pose.sliding_joints)}",
        f"exact model at {result.samples:,} points a set, seed {of.seed}, statics {of.statics}; base axes; "
        f"± half of an interval at {100 * result.confidence:g} % confidence",
        "share: of the variance, closed form, first order; S1, ST: first-order and total Sobol index; "
        "halved: this tolerance alone",
    ]


def _headline(result: BudgetResult, pose: PoseBudget, quantity: str) -> str:
    sums = pose.sums[quantity]
    unit = _unit(quantity)
    parts = []
    if sums.std is not None:
        parts.append(f"std {1e3 * sums.std:.5g} {unit} in closed form")
    sampled = math.sqrt(max(sums.variance.value, 0.0))
    if sampled > 0:
        half = sums.variance.half_width / (2 * sampled)
        parts.append(f"std {_with_width(1e3 * sampled, 1e3 * half, 6)} {unit} sampled")
    norm = f"{quantity.partition('.')[0]}.norm"
    if quantity in (*VECTORS, norm):
        marked = pose.quantile[norm]
        width = _with_width(1e3 * marked.value, 1e3 * marked.half_width, 6)
        parts.append(f"{100 * result.marked:g} % of {_symbol(quantity)} within {width} {unit}")
    return f"{quantity}: {'; '.join(parts)}"


def _draw_rows(pose: PoseBudget, quantity: str) -> list[list[str]]:
    vector = quantity.partition(".")[0]
    norm = f"{vector}.norm"
    component = quantity not in (*VECTORS, norm)
    unit = _unit(quantity)
    header = ["draw", "drawn per", "share %", "S1 %", "ST %"]
    header += ["worst case %"] if component else []
    header += [f"halved: std {unit}"] if quantity != norm else []
    header += [f"its change of the quantile {unit}"] if not component else []
    draws = sorted(pose.draws, key=lambda draw: _rank(pose, draw, quantity), reverse=True)
    rows = [header]
    for draw in draws[:MOST_LINES]:
        group = pose.group(draw.name)
        alone = len(group.draws) == 1
        row = [draw.name, draw.scope, _share(draw.share.get(quantity))]
        row += _indices(group, quantity) if alone else ["-", "-"]
        row += [_share(draw.worst_case.get(quantity))] if component else []
        row += [f"{1e3 * draw.halved.std[quantity]:.5g}"] if quantity != norm else []
        if not component:
            change = draw.halved.change[norm]
            row.append(_with_width(1e3 * change.value, 1e3 * change.half_width, MOST_DECIMALS, signed=True))
        rows.append(row)
    empty = [""] * (len(header) - 5)
    if len(draws) > MOST_LINES:
        rest = [draw.share.get(quantity) for draw in draws[MOST_LINES:]]
        together = None if None in rest else math.fsum(share for share in rest if share is not None)
        rows.append([f"{len(rest)} more", "", _share(together), "", "", *empty])
    for group in pose.groups:
        if len(group.draws) > 1:
            name = " + ".join(group.draws)
            rows.append(
                [f"correlated: {name}", "", _share(group.share.get(quantity)), *_indices(group, quantity), *empty]
            )
    sums = pose.sums[quantity]
    rows.append(["sum", "", _share(sums.closed), _percent(sums.first), "", *empty])
    return rows


def _rank(pose: PoseBudget, draw: DrawShare, quantity: str) -> float:
    share = draw.share.get(quantity)
    if share is not None:
        return share
    total = pose.group(draw.name).total[quantity]
    return -1.0 if total is None else total.value


def _share_rows(
    heading: str, quantities: Sequence[str], lines: Iterable[tuple[str, Mapping[str, float | None]]]
) -> list[list[str]]:
    sorted_lines = sorted(lines, key=lambda line: line[1][quantities[0]] or 0.0, reverse=True)
    rows = [[heading, "", *(f"{quantity} %" for quantity in quantities)]]
    rows += [
        [name, "", *(_share(share[quantity]) for quantity in quantities)] for name, share in sorted_lines[:MOST_LINES]
    ]
    if len(sorted_lines) > MOST_LINES:
        rows.append([f"{len(sorted_lines) - MOST_LINES} more", "", *("" for _ in quantities)])
    return rows


def _source(line: SourceShare) -> str:
    if len(line.sources) == 1:
        return line.sources[0]
    return f"{line.draws[0]}: {', '.join(line.sources) if line.sources else 'no source'}"


def _notes(result: BudgetResult, pose: PoseBudget, quantities: Sequence[str]) -> list[str]:
    notes = [
        "a draw that several sources name is a line of its own; a joint's or link's share is its covariance with the whole"
    ]
    if any(quantity in group.nonlinear for group in pose.groups for quantity in quantities):
        notes.append("*: share and index are more than one percentage point apart; the exact model is not linear here")
    if any(draw.unbounded for draw in pose.draws) and set(quantities) - {*VECTORS, "position.norm", "attitude.norm"}:
        notes.append(f"worst case: unbounded laws are cut off at {result.bound_at:g} standard deviations")
    return notes


def _indices(group: Group, quantity: str) -> list[str]:
    mark = "*" if quantity in group.nonlinear else ""
    return [_percent(group.first[quantity]), _percent(group.total[quantity]) + mark]


def _share(share: float | None) -> str:
    return "-" if share is None else f"{round(100 * share, 2) + 0.0:.2f}"


def _percent(estimate: Estimate | None) -> str:
    if estimate is None:
        return "-"
    return _with_width(100 * estimate.value, 100 * estimate.half_width, MOST_DECIMALS)


def _with_width(value: float, half_width: float, most: int, *, signed: bool = False) -> str:
    """Return ``value ± half-width`` with two digits of the half-width, rounded up, or ``most`` decimals."""
    if half_width <= 0:
        return "0" if value == 0 else f"{value:.{most}g}"
    decimals = min(most, max(0, 1 - math.floor(math.log10(half_width))))
    above = math.ceil(half_width * 10**decimals * (1 - 1e-12)) / 10**decimals
    return f"{round(value, decimals) + 0.0:{'+' if signed else ''}.{decimals}f} ± {above:.{decimals}f}"


def _unit(quantity: str) -> str:
    return "mm" if quantity.startswith("position") else "mrad"


def _symbol(quantity: str) -> str:
    return "|d|" if quantity.startswith("position") else "|δ|"


# figure ------------------------------------------------------------------------------------------


def _bars(axes: Axes, pose: PoseBudget, vector: str) -> None:
    """Draw one vector's bars; the indices of what does not fit are left out and counted in the axis's label."""
    ranked = sorted(pose.groups, key=lambda group: _largest(group, vector), reverse=True)
    shown = ranked[:MOST_BARS]
    for offset, which, colour, label in (
        (-0.2, "first", BLUE, "first-order index"),
        (0.2, "total", SKY, "total index"),
    ):
        found = [getattr(group, which)[vector] for group in shown]
        axes.barh(
            [row + offset for row in range(len(shown))],
            [0.0 if one is None else 100 * one.value for one in found],
            xerr=[0.0 if one is None else 100 * one.half_width for one in found],
            height=0.36,
            color=colour,
            label=label,
            error_kw={"elinewidth": 0.6, "capsize": 1.2, "capthick": 0.6},
        )
    axes.plot(
        [100 * (group.share[vector] or 0.0) for group in shown],
        range(len(shown)),
        linestyle="none",
        marker="D",
        markersize=3,
        markerfacecolor="white",
        markeredgecolor=BLACK,
        markeredgewidth=0.6,
        label="closed form, first order",
    )
    axes.set_yticks(range(len(shown)), [_shortened(_shown(" + ".join(group.draws))) for group in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    left_out = len(ranked) - len(shown)
    more = f" ({left_out} smaller ones not shown)" if left_out else ""
    axes.set_xlabel(f"share of the variance of the {vector} error [%]{more}")


def _largest(group: Group, vector: str) -> float:
    total = group.total[vector]
    return -1.0 if total is None else total.value


def _shortened(name: str) -> str:
    return name if len(name) <= MOST_CHARACTERS else f"{name[: MOST_CHARACTERS - 1]}…"


def _shown(name: str) -> str:
    """Return a name with a box for what the font of the figures does not have."""
    known = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(character if ord(character) in known else "□" for character in name)
