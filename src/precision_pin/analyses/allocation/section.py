"""An allocation as a section of a report: what it costs, the picture, the tolerances, the sources before and after."""

from __future__ import annotations

from precision_pin.analyses.allocation.allocation_result import AllocationResult
from precision_pin.analyses.allocation.figure import figure
from precision_pin.analyses.allocation.table import (
    front_in_words,
    front_rows,
    limit_lines,
    part_rows,
    parts_in_words,
    tolerance_rows,
    verdict_lines,
)
from precision_pin.render.chapter import Chapter
from precision_pin.render.html import Html, items, section, table
from precision_pin.render.svg import figure as inline_figure


def allocation_chapter(result: AllocationResult) -> Chapter:
    """Return the allocation as a chapter."""
    return Chapter("allocation", "Allocation", _section(result), (f"Allocation: {_answer(result)}",))


def _answer(result: AllocationResult) -> str:
    return " ".join(line.strip() for line in verdict_lines(result))


def _section(result: AllocationResult) -> Html:
    picture = inline_figure(
        figure(result),
        "allocation",
        f"Sources before and after: {_answer(result)}",
        "What causes the error at the worst pose, before and after, and the least cost for other limits.",
    )
    listed = [
        ("Tolerances before and after", tolerance_rows(result), (4,)),
        (_capital(parts_in_words(result)), part_rows(result), (4,)),
        *([(_capital(front_in_words(result)), front_rows(result), ())] if result.front else []),
    ]
    tables = [table(caption, rows[0], rows[1:], words=words) for caption, rows, words in listed]
    return section("allocation", "Allocation", items([_answer(result), *limit_lines(result)]), picture, *tables)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
