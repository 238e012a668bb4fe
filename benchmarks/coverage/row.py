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
    """Return the rows as a table."""
    lines = [
        "| interval | case | truth from | runs | given | hold the truth |",
        "| --- | --- | --- | ---: | ---: | ---: |",
    ]
    for row in rows:
        share = f"{100 * row.share:.1f} %" if row.given else "not resolved"
        lines.append(f"| {row.interval} | {row.case} | {row.truth} | {row.runs:,} | {row.given:,} | {share} |")
    return "\n".join(lines)
