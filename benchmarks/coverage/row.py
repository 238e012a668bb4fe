"""One line of the coverage table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from precision_pin.statistics import clopper_pearson

__all__ = ["LEAST", "Coverage", "as_markdown"]

LEAST: Final = 0.94
"""Coverage that every interval at 95 % confidence must reach, or it must not be given."""


@final
@dataclass(frozen=True)
class Coverage:
    """How often one kind of interval held the truth in one case.

    Attributes
    ----------
    interval
        What it is about, as the program calls it: ``"standard deviation"``, ``"quantile 99 %"``.
    case
        Law, pose and number of samples.
    truth
        Where the truth comes from: a closed form, quadrature, a long run of other code.
    runs
        Seeds tried.
    given
        Runs in which an interval was given; in the others the program says "not resolved".
    held
        Runs in which an interval was given and held the truth.
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
    """Return the rows as a table: a line for each case and a column for each interval, where there are few of these."""
    intervals = list(dict.fromkeys(row.interval for row in rows))
    if len(intervals) > _MOST_COLUMNS:
        return _listed(rows)
    cases: dict[tuple[str, str], dict[str, Coverage]] = {(row.case, row.truth): {} for row in rows}
    for row in rows:
        cases[row.case, row.truth][row.interval] = row
    lines = [
        f"| case | truth from | runs | {' | '.join(intervals)} |",
        f"| --- | --- | ---: |{' ---: |' * len(intervals)}",
    ]
    for (case, truth), found in cases.items():
        runs = next(iter(found.values())).runs
        cells = [_cell(found[interval]) if interval in found else "" for interval in intervals]
        lines.append(f"| {case} | {truth} | {runs:,} | {' | '.join(cells)} |")
    return "\n".join(lines)


_MOST_COLUMNS: Final = 9


def _cell(row: Coverage) -> str:
    """Return the share that holds the truth, and of how many intervals where some were not given."""
    if not row.given:
        return "not resolved"
    return _share(row) if row.given == row.runs else f"{_share(row)} of {row.given:,} given"


def _share(row: Coverage) -> str:
    return f"{100 * row.share:.1f} %"


def _listed(rows: Sequence[Coverage]) -> str:
    lines = [
        "| interval | case | truth from | runs | given | hold the truth |",
        "| --- | --- | --- | ---: | ---: | ---: |",
    ]
    for row in rows:
        share = _share(row) if row.given else "not resolved"
        lines.append(f"| {row.interval} | {row.case} | {row.truth} | {row.runs:,} | {row.given:,} | {share} |")
    return "\n".join(lines)
