"""How often an interval held the truth: one line of what was measured, and the tables made of all of them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

from precision_pin.statistics import clopper_pearson

__all__ = ["LEAST", "Coverage", "as_csv", "as_markdown", "cells"]

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


Cell = tuple[str, str, str, str, str]
"""Table, interval, case, runs, and the lowest share in percent of all sizes and methods: starred if some run gave no
interval, - if none did."""


def cells(rows: Sequence[Coverage]) -> list[Cell]:
    """Return a line for each interval and case; ``"budget, sobol: variance"`` is ``"variance"`` in the table ``"budget"``."""
    found: dict[tuple[str, str, str], list[Coverage]] = {}
    for row in rows:
        table, _, name = row.interval.rpartition(": ")
        found.setdefault((table.partition(",")[0], name, SIZE.sub("", row.case)), []).append(row)
    return [(*key, f"{sum(row.runs for row in same)}", _share(same)) for key, same in found.items()]


def as_csv(parts: Mapping[str, Sequence[Cell]]) -> str:
    """Return the lines of all parts as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(("part", "table", "interval", "case", "runs", "lowest %"))
    writer.writerows((part, *cell) for part, lines in parts.items() for cell in lines)
    return out.getvalue()


def as_markdown(lines: Sequence[Cell]) -> str:
    """Return for each interval its lowest share over the cases and where that is; below it those of 100 % in all cases."""
    shown, whole = ["| interval | cases | lowest | in the case |", "| --- | ---: | ---: | --- |"], list[str]()
    for table, name in dict.fromkeys((table, name) for table, name, *_ in lines):
        same = [(case, share) for one, other, case, _, share in lines if (one, other) == (table, name)]
        title = (f"{table}: {name}" if table else name).replace("|", "\\|")
        case, share = min(same, key=lambda line: float(line[1].strip("*-") or 101))
        if {one.strip("*") for _, one in same} <= {"100.0"}:
            whole.append(title)
        else:
            shown.append(f"| {title} | {len(same)} | {share} | {case.replace('|', chr(92) + '|')} |")
    return "\n".join([*shown, *(["", f"100 % in all cases: {'; '.join(whole)}."] if whole else [])])


def _share(rows: Sequence[Coverage]) -> str:
    given = [row for row in rows if row.given]
    if not given:
        return "-"
    star = "" if all(row.given == row.runs for row in rows) else "*"
    return f"{100 * min(row.share for row in given):.1f}{star}"
