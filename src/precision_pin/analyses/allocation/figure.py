"""Figure and chapter of an allocation: error sources before and after, and cost against accuracy."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.allocation import table as terminal
from precision_pin.analyses.allocation.allocate import AllocationResult
from precision_pin.base.errors import visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.draw_distribution import BLACK, BLUE, VERMILION
from precision_pin.render.figure_style import DOUBLE_COLUMN, frame, inline_figure, new_figure, shortened, style
from precision_pin.render.html import items, section, table
from precision_pin.render.scene import Chapter
from precision_pin.render.tables import symbol

# maximum number of sources in the figure
_MOST_BARS: Final = 12
# part, relative to the largest, below which a source is left out
_LEAST_PART: Final = 0.005
# maximum number of letters of a source's name
_MOST_LETTERS: Final = 30
_WORDS: Final = {"rms": "root mean square", "worst_case": "largest deviation"}


def figure(result: AllocationResult) -> Figure:
    """Return the figure, 174 mm wide: sources before and after, next to the front if there is one."""
    with style():
        drawing = new_figure(DOUBLE_COLUMN)
        panels = list(drawing.subplots(1, 2)) if result.front else [drawing.subplots()]
        bars = _draw_parts(panels[0], result)
        if result.front:
            _draw_front(panels[1], result)
        label = "cheapest tolerances" if result.feasible else "narrowest tolerances, which do not keep the limits"
        title = f"{label}: {visible(result.provenance.robot, 60)} at {terminal.pose_count(result)}"
        parts = result.parts
        caption = f"{_WORDS[parts.kind]} at pose {visible(parts.pose)}, first order"
        if result.front:
            caption += "; cost: all limits wider or narrower by one factor, first order"
        frame(drawing, panels, title, caption, max(28 + 6.5 * bars, 62))
    return drawing


def _draw_parts(axes: Axes, result: AllocationResult) -> int:
    parts = result.parts
    sizes = {part.source: max(part.before, part.after) for part in parts.sources}
    largest = max(sizes.values(), default=0.0)
    entries = [part for part in parts.sources if sizes[part.source] >= _LEAST_PART * largest][:_MOST_BARS]
    hidden = len(parts.sources) - len(entries)
    unit = WrittenUnit.of_axis(parts.quantity, largest)
    places = np.arange(len(entries))
    for shift, colour, label in ((-0.19, VERMILION, "before"), (0.19, BLUE, "after")):
        lengths = np.array([getattr(part, label) for part in entries]) * unit.per_si
        axes.barh(places + shift, lengths, 0.36, color=colour, label=label, linewidth=0)
    names = [shortened(visible(part.source), _MOST_LETTERS) + ("" if part.is_chosen else " *") for part in entries]
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.tick_params(axis="y", length=0)
    notes = ["* not chosen"] if not all(part.is_chosen for part in entries) else []
    notes += [f"{hidden} smaller ones are left out"] if hidden else []
    axes.set_xlabel("\n".join([f"part of {symbol(parts.quantity)} [{unit.name}]", "; ".join(notes)]).rstrip())
    return len(entries)


def _draw_front(axes: Axes, result: AllocationResult) -> None:
    limit = result.tightest
    factors = np.array([point.factor for point in result.front])
    unit = WrittenUnit.of_axis(limit.quantity, limit.limit * float(factors.max()))
    limits = factors * limit.limit * unit.per_si
    costs = [point.cost for point in result.front]
    axes.plot(limits, costs, color=BLUE, marker="o", markersize=2.5, label="least cost")
    if result.feasible:
        place = limit.limit * unit.per_si
        axes.plot([place], [result.cost], color=BLUE, marker="D", markersize=5.5, linestyle="", label="chosen")
    axes.axhline(result.cost_before, color=VERMILION, linestyle="--", label="cost before")
    axes.axvline(limit.limit * unit.per_si, color=BLACK, linestyle=":", linewidth=0.8, label="limit")
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.set_xlabel(f"limit of {symbol(limit.quantity)} [{unit.name}]")
    axes.set_ylabel("cost")


def allocation_chapter(result: AllocationResult) -> Chapter:
    """Return the allocation as a chapter."""
    answer = " ".join(line.strip() for line in terminal.verdict_lines(result))
    picture = inline_figure(
        figure(result),
        "allocation",
        f"Sources before and after: {answer}",
        "What causes the error at the worst pose, before and after, and the least cost for other limits.",
    )
    entries = [
        ("Tolerances before and after", terminal.tolerance_rows(result), (4,)),
        (terminal.parts_in_words(result), terminal.part_rows(result), (4,)),
        *([(terminal.front_in_words(result), terminal.front_rows(result), ())] if result.front else []),
    ]
    tables = [table(text[0].upper() + text[1:], rows[0], rows[1:], words=words) for text, rows, words in entries]
    content = section("allocation", "Allocation", items([answer, *terminal.limit_lines(result)]), picture, *tables)
    return Chapter("allocation", "Allocation", content, (f"Allocation: {answer}",))
