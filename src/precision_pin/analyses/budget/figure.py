"""A budget as a bar chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from precision_pin.analyses.budget.budget_result import VECTORS, BudgetResult, Estimate, PoseBudget
from precision_pin.base.text_escape import shortened
from precision_pin.render.draw_distribution import BLACK, SKY
from precision_pin.render.figure_style import DOUBLE_COLUMN, caption, end_figure, new_figure, style

MOST_BARS: Final = 12
MOST_CHARACTERS: Final = 48


@final
@dataclass(frozen=True)
class Bar:
    """One bar: name, tolerance, share of the variance and total index, as far as they exist."""

    name: str
    tolerance: str
    share: float | None
    total: Estimate | None

    @property
    def length(self) -> float:
        """The length, which ranks the bars: the share, or the total index where there is none."""
        if self.share is not None:
            return self.share
        return 0.0 if self.total is None else self.total.value


def figure(result: BudgetResult, pose: int = 0) -> Figure:
    """Return the shares of the variance of position and attitude as bars, largest first, 174 mm wide.

    Diamonds are the total Sobol indices of the exact model, whiskers their intervals.

    Args:
        result: What was found.
        pose: Which of its poses.
    """
    return draw_bars(result, pose, {name: _bars(result.poses[pose], name) for name in VECTORS})


def draw(axes: Axes, result: BudgetResult, which: int, quantity: str) -> None:
    """Draw one vector, ``"position"`` or ``"attitude"``, on given axes."""
    with style():
        _draw(axes, _bars(result.poses[which], quantity), quantity)


def draw_bars(result: BudgetResult, pose: int, bars: Mapping[str, Sequence[Bar]]) -> Figure:
    """Return given bars of position and attitude, 174 mm wide.

    Args:
        result: Of what.
        pose: Which of its poses.
        bars: By vector, the largest first.
    """
    rows = max(1, min(MOST_BARS, max(map(len, bars.values()), default=1)))
    with style():
        made = new_figure(DOUBLE_COLUMN)
        panels = made.subplots(2, 1)
        for axes, vector in zip(panels, VECTORS, strict=True):
            _draw(axes, bars[vector], vector)
        lines = [
            *caption("error budget", result.provenance, result.poses[pose].pose),
            f"N = {result.samples:,} points, seed {result.provenance.seed}, exact model; whiskers: intervals at "
            f"{100 * result.confidence:g} % confidence",
        ]
        end_figure(made, panels[:1], [_shown(line) for line in lines], 42 + 2 * 6.0 * rows)
    return made


def _bars(pose: PoseBudget, vector: str) -> list[Bar]:
    """Return a bar for each draw or group of correlated ones, the largest first."""
    found = []
    for group in pose.groups:
        draws = [pose.draw(name) for name in group.draws]
        tolerance = draws[0].tolerance if len(draws) == 1 else ""
        name = " + ".join(draw.words for draw in draws)
        found.append(Bar(name, tolerance, group.share[vector], group.total[vector]))
    return sorted(found, key=lambda bar: -round(bar.length, 9))


def _draw(axes: Axes, bars: Sequence[Bar], vector: str) -> None:
    """Draw one vector's bars; those that do not fit are left out and counted in the axis's label."""
    shown, hidden = bars[:MOST_BARS], bars[MOST_BARS:]
    lengths = [100 * bar.length for bar in shown]
    axes.barh(
        range(len(shown)), lengths, height=0.62, color=SKY, label="share of the variance, first order", linewidth=0
    )
    totals = [(row, bar.total) for row, bar in enumerate(shown) if bar.total is not None]
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
    ends = dict.fromkeys(range(len(shown)), 0.0)
    for row, total in totals:
        ends[row] = 100 * (total.value + total.half_width)
    longest = max([*lengths, *ends.values(), 1e-9])
    for row, bar in enumerate(shown):
        text = "  ".join(part for part in (f"{lengths[row]:.3g} %", bar.tolerance) if part)
        axes.text(max(lengths[row], ends[row]) + 0.012 * longest, row, _shown(text), va="center", fontsize=7)
    axes.set_yticks(range(len(shown)), [shortened(_shown(bar.name), MOST_CHARACTERS) for bar in shown])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(max(len(shown), 1) - 0.4, -0.6)
    axes.set_xlim(min(0.0, *lengths, 0.0), 1.4 * longest)
    if hidden:
        together = f"{100 * sum(bar.length for bar in hidden):.2g} % together"
        axes.set_title(f"{len(hidden)} smaller ones, {together}, are not shown", fontsize=7, loc="right")
    axes.set_xlabel(f"share of the variance of the {vector} error [%]")


def _shown(name: str) -> str:
    """Return a name with a box for each character that the figures' font lacks."""
    known = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(character if ord(character) in known else "□" for character in name)
