"""Verdicts on specifications, and their grounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import ClassVar, Final, Literal, final

from precision_pin.base.errors import visible
from precision_pin.base.record import Keys, Record

Verdict = Literal["met", "not met", "not judged", "undecided", "nothing to judge"]


def judge(*, holds: bool, fails: bool, varies: bool = True) -> Verdict:
    """Return the verdict on a specification.

    Args:
        holds, fails: Whether the whole interval of the probability is at least the required probability, or below it.
        varies: Whether the quantity differs from robot to robot. If not, no tolerance acts on it, and being inside
            proves nothing.
    """
    if fails:
        return "not met"
    if not varies:
        return "nothing to judge"
    return "met" if holds else "undecided"


def capability_index(inside: float) -> float:
    """Return Φ⁻¹(P)/3: the Cpk of a normal characteristic with one limit and the fraction P inside it.

    This is a third of the benchmark Z of process capability (Bothe, *Measuring Process Capability*, 1997). It depends
    on the fraction alone, so it applies to any law, and to two limits, whose tails are added. 1 is 99.865 %, 1.33 is
    99.9968 %; infinite for a fraction of 0 or 1.
    """
    if not 0 < inside < 1:
        return math.copysign(math.inf, inside - 0.5)
    return NormalDist().inv_cdf(inside) / 3


@final
@dataclass(frozen=True)
class Grounds(Record):
    """What a verdict rests on besides the samples.

    Attributes:
        not_judged: Why nothing is judged, such as a joint outside its limits; empty if a verdict can be given.
        exact: Sources and parameters whose laws a change of the sheet has replaced by single values.
    """

    KEYS: ClassVar[Keys] = ("judged=_judged", "why_not_judged=_reason", "taken_as_exact=exact")

    not_judged: str = ""
    exact: tuple[str, ...] = ()

    def said(self, verdict: Verdict) -> str:
        """Return a verdict in capitals, with the reason for not judging or with what it takes as exact."""
        if verdict == "not judged":
            return f"NOT JUDGED: {self.why}"
        return f"{verdict.upper()}{self.taken if verdict == 'met' else ''}"

    @property
    def why(self) -> str:
        """Why nothing is judged, and how to judge all the same; empty if a verdict can be given."""
        return f"{self.not_judged}; --beyond-limits judges all the same" if self.not_judged else ""

    @property
    def taken(self) -> str:
        """Text after the word "met": `` with … taken as exact``, or empty."""
        return f" with {', '.join(map(visible, self.exact))} taken as exact" if self.exact else ""

    @property
    def _judged(self) -> bool:
        return not self.not_judged

    @property
    def _reason(self) -> str | None:
        return self.not_judged or None


NO_GROUNDS: Final = Grounds()
"""For a verdict that rests on the samples alone."""


@final
@dataclass(frozen=True)
class SpecificationResult(Record):
    """Result of a specification: the fraction of samples inside its limit.

    Attributes:
        quantity, limit, required: The specification.
        probability: Fraction of samples with |quantity| ≤ limit, counted exactly.
        interval: Clopper-Pearson interval of the probability.
    """

    KEYS: ClassVar[Keys] = (
        *("quantity", "limit", "required", "probability", "interval", "met", "verdict", "*grounds"),
        *("cpk", "cpk_interval"),
    )

    quantity: str
    limit: float
    required: float
    probability: float
    interval: tuple[float, float]
    varies: bool = True
    grounds: Grounds = NO_GROUNDS

    @property
    def verdict(self) -> Verdict:
        """Verdict on the specification.

        ``"met"`` if the lower end of the interval is at least the required probability, ``"not met"`` if the upper end
        is below it, otherwise ``"undecided"``; ``"nothing to judge"`` if the quantity is inside but does not vary;
        ``"not judged"`` where :attr:`grounds` give a reason, whatever the samples say.
        """
        if self.grounds.not_judged:
            return "not judged"
        low, high = self.interval
        return judge(holds=low >= self.required, fails=high < self.required, varies=self.varies)

    @property
    def met(self) -> bool:
        """True if the verdict is ``"met"``."""
        return self.verdict == "met"

    @property
    def said(self) -> str:
        """The verdict in capitals, with the reason for not judging or with what it takes as exact."""
        return self.grounds.said(self.verdict)

    @property
    def cpk(self) -> float:
        """Process capability index of the fraction inside, :func:`capability_index`."""
        return capability_index(self.probability)

    @property
    def cpk_interval(self) -> tuple[float, float]:
        """Interval of :attr:`cpk`."""
        low, high = self.interval
        return capability_index(low), capability_index(high)
