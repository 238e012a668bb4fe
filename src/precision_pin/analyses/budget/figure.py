"""A budget as a bar chart, and in the report."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from precision_pin.analyses.budget.budget_result import BudgetResult, PoseBudget, scaled
from precision_pin.analyses.budget.causes import rank_causes
from precision_pin.analyses.budget.table import source_name
from precision_pin.analyses.collect import Cause, CauseShare, Results, percent
from precision_pin.analyses.shares import VECTORS, Shares
from precision_pin.base.errors import shortened
from precision_pin.render.draw_distribution import BLACK, SKY
from precision_pin.render.figure_style import DOUBLE_COLUMN, caption, frame, inline_figure, new_figure, style
from precision_pin.render.html import Child, Html, beside, element, items, joined, paragraph, table
from precision_pin.render.tables import MISSING, milli, quantity_label, shown, unit
from precision_pin.statistics.intervals import Estimate

_NAMED: Final = 5  # causes named in the picture's text alternative
# causes with a smaller share of the variance are folded
_NOTHING: Final = 1e-3
_FEW: Final = 4  # small causes up to which none are folded


def content(result: BudgetResult, results: Results) -> list[Child]:
    """Return the chart, a table of the causes for position and one for attitude, and one of sources and places."""
    pose = result.poses[0]
    if not pose.draws:
        return [paragraph("Nothing varies, so there are no shares.")]
    shares = {vector: rank_causes(results.causes, pose, vector) for vector in VECTORS}
    chart = inline_figure(
        draw_bars(result, 0, {vector: [_bar(share) for share in shares[vector]] for vector in VECTORS}),
        f"{results.prefix}budget",
        f"Shares of the variance: {'; '.join(_list_largest(shares[vector], vector) for vector in VECTORS)}",
        "Share of the variance of each tolerance, to first order; diamonds are the total Sobol index of the exact model.",
    )
    tables = [_causes(pose, shares[vector], vector, result.marked) for vector in VECTORS]
    explained = paragraph(
        "Share: of the variance, to first order, in closed form. S1 and ST: first-order and total Sobol index of the exact "
        f"model from {result.samples:,} points a set, seed {result.provenance.seed}, behind ± half of the interval at "
        f"{100 * result.confidence:g} % confidence. Halved: what results if this tolerance alone is halved.",
        class_="note",
    )
    return [chart, *tables, explained, beside(*_shares(pose))]


def _bar(share: CauseShare) -> Bar:
    return Bar(share.cause.words, share.cause.tolerance, share.share, share.total)


def _list_largest(shares: Sequence[CauseShare], vector: str) -> str:
    texts = (f"{share.cause.text} {percent(share.share)} %" for share in shares[:_NAMED])
    return f"of the {vector} error " + ", ".join(texts)


def _causes(pose: PoseBudget, shares: Sequence[CauseShare], vector: str, level: float) -> Html:
    norm = f"{vector}.norm"
    header = [
        *("cause", "tolerance", "drawn per", "share %", "S1 %", "ST %", f"halved: std [{unit(norm)}]"),
        f"change of {100 * level:g} % of {quantity_label(norm)}",
    ]
    large = [share for share in shares if share.rank >= _NOTHING]
    small = [share for share in shares if share.rank < _NOTHING]
    if len(small) <= _FEW:
        large, small = [*large, *small], []
    rows = [_row(pose, share, vector) for share in large]
    empty: list[Child] = [""] * (len(header) - 4)
    if small:
        rows.append([f"{len(small)} more, below", "", "", percent(_sum(small)), *empty])
    for group in pose.groups:
        if len(group.draws) > 1:
            indices = [shown(scaled(group.first[vector], 100, 2)), shown(scaled(group.total[vector], 100, 2))]
            rows.append(
                [f"correlated: {' + '.join(group.draws)}", "", "", percent(group.share.get(vector)), *indices, "", ""]
            )
    sums = pose.sums[vector]
    rows.append(["sum", "", "", percent(sums.closed), shown(scaled(sums.first, 100, 2)), *empty[1:]])
    heading = f"std {milli(pose.std[vector], 5)} {unit(norm)} now"
    main_table = table(f"Causes of the {vector} error ({heading})", header, rows, words=(1, 2), last=True)
    if not small:
        return main_table
    total = f"{len(small)} more causes of less than {100 * _NOTHING:g} % each"
    other_rows = table(f"{total}, {vector} error", header, [_row(pose, share, vector) for share in small], words=(1, 2))
    return joined([main_table, element("details", element("summary", total), other_rows)])


def _row(pose: PoseBudget, entry: CauseShare, vector: str) -> list[Child]:
    change = MISSING
    if len(entry.cause.parts) == 1:
        change_of_norm = pose.draw(entry.cause.names[0]).halved.change[f"{vector}.norm"]
        change = shown(scaled(change_of_norm, 1e3))
    cause = entry.cause
    shares = [percent(entry.share), *(shown(scaled(index, 100, 2)) for index in (entry.first, entry.total))]
    return [_name(cause, pose, vector), cause.tolerance, cause.scope, *shares, shown(milli(entry.halved, 5)), change]


def _name(cause: Cause, pose: PoseBudget, vector: str) -> Child:
    """Return the cell of a cause: its name, with its draws, or the components of a single draw, folded below."""
    parts = [(part.words, pose.draw(part.name).share.get(vector)) for part in cause.parts]
    if len(parts) == 1:
        components = pose.draw(cause.names[0]).components
        parts = [(name, shares.get(vector)) for name, shares in components.items()] if len(components) > 1 else []
    if not parts:
        return cause.words
    lines = (f"{words}: {percent(share)} %" for words, share in parts)
    return element("details", element("summary", cause.words), items(lines, "parts"))


def _sum(shares: Sequence[CauseShare]) -> float | None:
    values = [line.share for line in shares]
    return None if None in values else math.fsum(value for value in values if value is not None)


def _shares(pose: PoseBudget) -> list[Html]:
    sources = [(source_name(line), line.share) for line in pose.sources]
    places = [(place.name, place.share) for place in pose.places]
    by_source = "Sources: shares of the variance; a draw that several sources name has its own line"
    caption = "Joints and links: shares of the variance, negative where one cancels the effect of another's same number"
    return [_fold_lines(by_source, "source", sources), _fold_lines(caption, "joint or link", places)]


def _fold_lines(caption: str, heading: str, lines: Iterable[tuple[str, Shares]]) -> Html:
    def size(line: tuple[str, Shares]) -> float:
        return max(abs(line[1][vector] or 0.0) for vector in VECTORS)

    largest = sorted(lines, key=lambda line: max(line[1][vector] or 0.0 for vector in VECTORS), reverse=True)
    small_lines = [line for line in largest if size(line) < _NOTHING]
    large_lines = [line for line in largest if size(line) >= _NOTHING] if len(small_lines) > _FEW else largest
    header = [heading, *(f"{vector} %" for vector in VECTORS)]

    def rows(part: Iterable[tuple[str, Shares]]) -> list[list[Child]]:
        return [[name, *(percent(share[vector]) for vector in VECTORS)] for name, share in part]

    main_table = table(caption, header, rows(large_lines))
    if len(large_lines) == len(largest):
        return main_table
    text = f"{len(small_lines)} more with less than {100 * _NOTHING:g} % each"
    other_table = element("details", element("summary", text), table(f"{text}: {heading}", header, rows(small_lines)))
    return element("div", main_table, other_table)


MOST_BARS: Final = 12  # of a panel; its title gives number and share of the others


@dataclass(frozen=True)
class Bar:
    """One bar: name, tolerance, share of the variance and total index, as far as they exist."""

    name: str
    tolerance: str
    share: float | None
    total: Estimate | None

    @property
    def length(self) -> float:
        """The length, by which bars are sorted: the share, or the total index where there is none."""
        if self.share is not None:
            return self.share
        return 0.0 if self.total is None else self.total.value


def figure(result: BudgetResult, pose: int = 0) -> Figure:
    """Return shares of the variance as bars, total Sobol indices as diamonds with whiskers, 174 mm wide."""
    return draw_bars(result, pose, {name: _bars(result.poses[pose], name) for name in VECTORS})


def draw(axes: Axes, result: BudgetResult, which: int, quantity: str) -> None:
    """Draw one vector, ``"position"`` or ``"attitude"``, on given axes."""
    with style():
        _draw(axes, _bars(result.poses[which], quantity), quantity)


def draw_bars(result: BudgetResult, pose: int, bars: Mapping[str, Sequence[Bar]]) -> Figure:
    """Return given bars of position and attitude, by vector and largest first, 174 mm wide."""
    rows = max(1, min(MOST_BARS, max(map(len, bars.values()), default=1)))
    with style():
        figure = new_figure(DOUBLE_COLUMN)
        panels = figure.subplots(2, 1)
        for axes, vector in zip(panels, VECTORS, strict=True):
            _draw(axes, bars[vector], vector)
        lines = [
            caption("error budget", result.provenance, result.poses[pose].pose),
            f"N = {result.samples:,} points, seed {result.provenance.seed}, exact model; whiskers: intervals at "
            f"{100 * result.confidence:g} % confidence",
        ]
        frame(figure, panels[:1], "", "\n".join(map(_glyphs, lines)), 32 + 2 * 6.0 * rows, 2)
    return figure


def _bars(pose: PoseBudget, vector: str) -> list[Bar]:
    bars = []
    for group in pose.groups:
        draws = [pose.draw(name) for name in group.draws]
        tolerance = draws[0].tolerance if len(draws) == 1 else ""
        name = " + ".join(draw.words for draw in draws)
        bars.append(Bar(name, tolerance, group.share[vector], group.total[vector]))
    return sorted(bars, key=lambda bar: -round(bar.length, 9))


def _draw(axes: Axes, bars: Sequence[Bar], vector: str) -> None:
    shown_bars, hidden_bars = bars[:MOST_BARS], bars[MOST_BARS:]
    lengths = [100 * bar.length for bar in shown_bars]
    axes.barh(
        range(len(shown_bars)), lengths, height=0.62, color=SKY, label="share of the variance, first order", linewidth=0
    )
    totals = [(row, bar.total) for row, bar in enumerate(shown_bars) if bar.total is not None]
    axes.errorbar(
        [100 * total.value for _, total in totals],
        [row for row, _ in totals],
        xerr=[100 * total.half_width for _, total in totals],
        linestyle="none",
        marker="D",
        markersize=3,
        markerfacecolor="white",
        markeredgecolor=BLACK,
        markeredgewidth=0.6,
        ecolor=BLACK,
        elinewidth=0.6,
        capsize=1.2,
        capthick=0.6,
        label="total Sobol index, exact model",
    )
    right_ends = dict.fromkeys(range(len(shown_bars)), 0.0)
    for row, total in totals:
        right_ends[row] = 100 * (total.value + total.half_width)
    longest = max([*lengths, *right_ends.values(), 1e-9])
    for row, bar in enumerate(shown_bars):
        text = "  ".join(part for part in (_percent(lengths[row], 3), bar.tolerance) if part)
        axes.text(max(lengths[row], right_ends[row]) + 0.012 * longest, row, _glyphs(text), va="center", fontsize=7)
    axes.set_yticks(range(len(shown_bars)), [shortened(_glyphs(bar.name), 48) for bar in shown_bars])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(max(len(shown_bars), 1) - 0.4, -0.6)
    axes.set_xlim(min(0.0, *lengths, 0.0), 1.4 * longest)
    if hidden_bars:
        total_share = f"{_percent(100 * sum(bar.length for bar in hidden_bars), 2)} together"
        axes.set_title(f"{len(hidden_bars)} smaller ones, {total_share}, are not shown", fontsize=7, loc="right")
    axes.set_xlabel(f"share of the variance of the {vector} error [%]")


def _percent(value: float, digits: int) -> str:
    return "under 0.001 %" if 0 < abs(value) < 1e-3 else f"{value:.{digits}g} %"


def _glyphs(name: str) -> str:
    """Return a name with a box for each character that the figures' font lacks."""
    charmap = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(character if ord(character) in charmap else "□" for character in name)
