"""One line of the coverage table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from precision_pin.statistics import clopper_pearson

__all__ = ["LEAST", "Coverage", "as_markdown"]

SIZE: Final = re.compile(r", ([\d,]+ (samples|points)|P [\d.e-]+)$")
LEAST: Final = 0.94
"""Coverage that every interval at 95 % confidence must reach, or it must not be given."""


@final
@dataclass(frozen=True)
class Coverage:
    """How often one kind of interval held the truth in one case.

    Attributes:
        interval: What it is about, as the program calls it: ``"standard deviation"``, ``"quantile 99 %"``.
        case: Law, pose and number of samples.
        truth: Where the truth comes from: a closed form, quadrature, a long run of other code.
        runs: Seeds tried.
        given: Runs in which an interval was given; in the others the program says "not resolved".
        held: Runs in which an interval was given and held the truth.
    """

    interval: str
    case: str
    truth: str
    runs: int
    given: int
    held: int

    @property
    def share(self) -> float:
        """Share of the given intervals that hold the truth; 1 where none was given."""
        return self.held / self.given if self.given else 1.0

    @property
    def passes(self) -> bool:
        """Whether at least 94 % hold the truth, up to the scatter of this measurement (99 % confidence)."""
        return not self.given or clopper_pearson(self.held, self.given, 0.98)[1] >= LEAST


def as_markdown(rows: Sequence[Coverage]) -> str:
    """Return the rows as tables: a line for each case, a column for each interval, the lowest share of all sizes and methods.

    Intervals named ``"budget: …"``, or ``"budget, sobol: …"``, make a table of their own under that name. A column of which
    every share is 100 % is named below the table.
    """
    groups: dict[str, list[Coverage]] = {}
    for row in rows:
        groups.setdefault(row.interval.rpartition(": ")[0].partition(",")[0], []).append(row)
    return "\n\n".join(
        (f"**{name[0].upper()}{name[1:]}**\n\n" if name else "") + _table(group) for name, group in groups.items()
    )


def _table(rows: Sequence[Coverage]) -> str:
    cases: dict[str, dict[str, list[Coverage]]] = {}
    for row in rows:
        name = row.interval.rpartition(": ")[2]
        cases.setdefault(SIZE.sub("", row.case), {}).setdefault(name, []).append(row)
    names = list(dict.fromkeys(name for found in cases.values() for name in found))
    cells = [[_cell(found.get(name, [])) for name in names] for found in cases.values()]
    whole = [set(column) <= {"", "100.0", "100.0*"} for column in zip(*cells, strict=True)]
    lines = []
    if not all(whole):
        heads = [_text(name) for name, is_whole in zip(names, whole, strict=True) if not is_whole]
        lines = [f"| case | runs | {' | '.join(heads)} |", f"| --- | ---: |{' ---: |' * len(heads)}"]
        for (case, found), shares in zip(cases.items(), cells, strict=True):
            runs = max(sum(row.runs for row in same) for same in found.values())
            shown = [share for share, is_whole in zip(shares, whole, strict=True) if not is_whole]
            lines.append(f"| {_text(case)} | {runs:,} | {' | '.join(shown)} |")
        lines.append("")
    full = ", ".join(name for name, is_whole in zip(names, whole, strict=True) if is_whole)
    of = "" if lines else f" ({', '.join(cases)}, {max(row.runs for row in rows):,} runs)"
    told = [f"100.0 % everywhere: {full}{of}."] if full else []
    return "\n".join([*lines, " ".join([*told, f"Truth from: {'; '.join(dict.fromkeys(row.truth for row in rows))}."])])


def _text(name: str) -> str:
    return name.replace("|", "\\|")


def _cell(rows: Sequence[Coverage]) -> str:
    """Return the lowest share in percent, starred if some run gave no interval, - if none did."""
    given = [row for row in rows if row.given]
    if not given:
        return "-" if rows else ""
    star = "" if all(row.given == row.runs for row in rows) else "*"
    return f"{100 * min(row.share for row in given):.1f}{star}"
