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
    """Return the rows as tables: a line for each case, a column for each interval.

    Intervals named ``"budget: …"`` make a table of their own under that name.
    """
    groups: dict[str, list[Coverage]] = {}
    for row in rows:
        groups.setdefault(row.interval.rpartition(": ")[0], []).append(row)
    return "\n\n".join(
        (f"**{name[0].upper()}{name[1:]}**\n\n" if name else "") + _table(group) for name, group in groups.items()
    )


def _table(rows: Sequence[Coverage]) -> str:
    intervals = list(dict.fromkeys(row.interval for row in rows))
    cases: dict[tuple[str, str, int], dict[str, Coverage]] = {}
    for row in rows:
        cases.setdefault((row.case, row.truth, row.runs), {})[row.interval] = row
    names = [_text(interval.rpartition(": ")[2]) for interval in intervals]
    lines = [f"| case | truth from | runs | {' | '.join(names)} |", f"| --- | --- | ---: |{' ---: |' * len(names)}"]
    for (case, truth, runs), found in cases.items():
        cells = [_cell(found[interval]) if interval in found else "" for interval in intervals]
        lines.append(f"| {_text(case)} | {_text(truth)} | {runs:,} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _text(name: str) -> str:
    return name.replace("|", "\\|")


def _cell(row: Coverage) -> str:
    """Return the share that holds the truth, and of how many intervals where some were not given."""
    if not row.given:
        return "not resolved"
    share = f"{100 * row.share:.1f} %"
    return share if row.given == row.runs else f"{share} of {row.given:,} given"
