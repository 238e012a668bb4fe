"""Estimates of a probability of failure by several methods, their intervals, and the choice among them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from scipy import special

from precision_pin.analyses.reliability.form import Form
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.statistics import clopper_pearson
from precision_pin.statistics.intervals import round_end, studentised

LARGEST_VARIATION: Final = 0.3
"""Largest coefficient of variation of a resolved estimate."""

ENOUGH_VARIATION: Final = 0.1
"""Largest coefficient of variation with which plain sampling can decide alone."""

LARGEST_UNKNOWN: Final = 0.1
"""Largest fraction of the probability in strata without an estimate."""

WIDENING: Final = 1.1
"""Factor of intervals of weighted and conditional samples, whose standard errors are estimates themselves."""

SAMPLING: Final = "sampling"
# maximum number of digits of the end of an interval
_MOST_DIGITS: Final = 9
# confidence of the interval of a difference that must contain 0 for two estimates to agree
_AGREEING: Final = 0.99


@dataclass(frozen=True)
class Estimate(Record):
    """Probability of failure with its uncertainty.

    Attributes:
        method: ``"sampling"``, ``"importance sampling"`` or ``"subset simulation"``.
        probability, interval: Probability of failure, and its interval at the stated confidence.
        variation: Coefficient of variation; infinite if no failure occurred.
        evaluations: Number of evaluations of the error model.
        resolved: True if the estimate is reliable; otherwise ``note`` gives the reason.
    """

    KEYS: ClassVar[Keys] = (
        *("method", "probability", "interval", "coefficient_of_variation=variation", "evaluations", "resolved"),
        "note=note?",
    )

    method: str
    probability: float
    interval: tuple[float, float]
    variation: float
    evaluations: int
    resolved: bool
    note: str = ""


@dataclass(frozen=True)
class Verdict:
    """Choice of the estimate to use.

    Attributes:
        best: The estimate.
        resolved: True if it is resolved; otherwise it is plain sampling's, of which only the interval is meaningful.
        reason: Why it is not resolved, or why a narrower interval is not used; else empty.
        contradictions: Contradictions between estimates, one line each.
    """

    best: Estimate
    resolved: bool
    reason: str
    contradictions: tuple[str, ...]


def plain_estimate(failures: int, samples: int, confidence: float, method: str = SAMPLING) -> Estimate:
    """Return the estimate of counted failures with its Clopper-Pearson interval."""
    share = failures / samples
    variation = math.sqrt((1 - share) / failures) if failures else math.inf
    resolved = variation <= LARGEST_VARIATION
    note = "" if resolved else f"not resolved: {failures} failures among {samples:,} samples"
    return Estimate(method, share, clopper_pearson(failures, samples, confidence), variation, samples, resolved, note)


def skewed_interval(mean: float, error: float, skewness: float, count: int, confidence: float) -> tuple[float, float]:
    """Return the interval of a mean of skewed terms (Hall, *J. R. Statist. Soc. B* 54, 1992), widened by a tenth.

    The studentised mean is transformed by a cubic that removes its skewness. The interval is that of a normal variable,
    transformed back. Without skewness it is that of the central limit theorem.
    """
    score = float(special.ndtri((1 + confidence) / 2))
    low, high = (mean - WIDENING * error * float(studentised(z, skewness / math.sqrt(count))) for z in (score, -score))
    return max(0.0, low), min(1.0, high)


def log_normal_interval(values: Array, confidence: float) -> tuple[float, float]:
    """Return the interval of a mean of log-normal values (Cox's method with Student's t, Olsson, 2005), times 1.1."""
    logs = np.log(values)
    count, square = values.size, float(logs.var(ddof=1))
    error = math.sqrt(square / count + square**2 / (2 * (count - 1)))
    half_width = WIDENING * float(special.stdtrit(count - 1, (1 + confidence) / 2)) * error
    middle = float(logs.mean()) + square / 2
    return math.exp(middle - half_width), min(1.0, math.exp(middle + half_width))


def summed(method: str, parts: Sequence[tuple[float, Estimate]], unknown: float, evaluations: int = 0) -> Estimate:
    """Return the sum Σ p_s P_s of a method's estimates in the strata.

    The interval is combined from those of the parts: the squared distances from estimate to end add (Zou and Donner,
    *Statistics in Medicine* 27, 2008). A part with only an upper bound adds to the upper end.
    """
    if len(parts) == 1 and not unknown and not evaluations:
        return parts[0][1]
    resolved_parts = [(share, part) for share, part in parts if part.resolved]
    bounds = unknown + math.fsum(share * part.interval[1] for share, part in parts if not part.resolved)
    probability = math.fsum(share * part.probability for share, part in resolved_parts)
    lower = math.sqrt(math.fsum((share * (part.probability - part.interval[0])) ** 2 for share, part in resolved_parts))
    upper = math.sqrt(math.fsum((share * (part.interval[1] - part.probability)) ** 2 for share, part in resolved_parts))
    squares = ((share * part.probability * part.variation) ** 2 for share, part in resolved_parts if part.probability)
    variation = math.sqrt(math.fsum(squares)) / probability if probability else math.inf
    resolved = bool(probability) and bounds <= LARGEST_UNKNOWN * probability and variation <= LARGEST_VARIATION
    unknown_note = f"not resolved: no estimate for strata of a total probability of {bounds:.2g}"
    note = "" if resolved else next((part.note for _, part in parts if part.note), unknown_note)
    interval = max(0.0, probability - lower), min(1.0, probability + upper + bounds)
    count = evaluations + sum(part.evaluations for _, part in parts)
    return Estimate(method, probability, interval, variation, count, resolved, note)


def agree(first: Estimate, second: Estimate, confidence: float = _AGREEING) -> bool:
    """Return whether two estimates are consistent with the same probability.

    Plain sampling with too few failures to decide alone is compared by its counts: its Clopper-Pearson interval must contain
    the other estimate. For two other estimates, the interval of ln(P₁/P₂) must contain 0, with both taken as log-normal,
    or their intervals overlap, which are wider where counts leave no variation.
    """
    for plain, rare in ((first, second), (second, first)):
        if plain.method == SAMPLING and plain.variation > ENOUGH_VARIATION:
            return plain.interval[0] <= rare.probability <= plain.interval[1]
    if not first.probability or not second.probability:
        return first.probability == second.probability
    if max(first.interval[0], second.interval[0]) <= min(first.interval[1], second.interval[1]):
        return True
    spreads = [math.log1p(estimate.variation**2) for estimate in (first, second)]
    half_width = float(special.ndtri((1 + confidence) / 2)) * math.sqrt(sum(spreads))
    return abs(math.log(first.probability / second.probability)) <= half_width


def judged(estimates: Sequence[Estimate]) -> Verdict:
    """Return the estimate to use.

    Plain sampling that saw enough failures for an estimate of its own is compared with the first of the other resolved
    estimates in the given order, not the one with the smallest stated error, because an estimate that is too low also
    understates its error; the narrower interval is used. Below a coefficient of variation of a tenth, plain sampling
    decides alone unless both others are resolved, as each by itself may miss a region of failures. Where the samples
    contain too few failures for an estimate of their own, two of the others are required. None of them may contradict
    the others or the samples.

    Each pair is compared at 99 %. Where plain sampling could decide alone, a contradiction leaves the verdict to it and
    is reported; there the 99 % apply to all pairs, up to three, together (Bonferroni).
    """
    plain, others = estimates[0], [estimate for estimate in estimates[1:] if estimate.resolved]
    pairs = [(first, second) for k, first in enumerate((plain, *others)) for second in others[k:]]
    decides = plain.variation <= ENOUGH_VARIATION
    confidence = 1 - (1 - _AGREEING) / max(len(pairs), 1) if decides else _AGREEING
    lines = tuple(
        f"{first.method} ({_describe_estimate(first)}) and {second.method} ({_describe_estimate(second)}) disagree"
        for first, second in pairs
        if not agree(first, second, confidence)
    )
    if lines:
        return Verdict(plain, decides, "" if decides else "the methods disagree", lines)
    if plain.resolved:
        best = min([plain, *others[:1]], key=lambda estimate: estimate.interval[1] - estimate.interval[0])
        if decides and best is not plain and len(others) < 2:
            return Verdict(plain, True, f"no second estimate confirms {best.method}'s narrower interval", ())
        return Verdict(best, True, "", ())
    if len(others) < 2:
        reason = f"only {others[0].method} gave an estimate" if others else "no method gave an estimate"
        return Verdict(plain, False, f"{reason}, but two agreeing estimates are needed", ())
    return Verdict(others[0], True, "", ())


def remarks(verdict: Verdict, searched: Form) -> tuple[str, ...]:
    """Return a remark if FORM differs from the best estimate, which is common for curved failure surfaces."""
    best, span = verdict.best, searched.range
    if span is None:
        text = f"FORM's search from {searched.starts} starts led to no design point; {best.method} found failures"
        return (text,) if verdict.resolved and best.interval[0] > 0 else ()
    if span[0] > best.interval[1] or span[1] < best.interval[0]:
        label = f"FORM ({span[0]:.3g})" if span[0] == span[1] else f"FORM ({in_words(span)} for all its design points)"
        return (
            f"{label} assumes a flat failure surface, but it is curved; the estimate to use is {best.method} "
            f"({in_words(best.interval)})",
        )
    return ()


def _describe_estimate(estimate: Estimate) -> str:
    if estimate.method == SAMPLING:
        failures = round(estimate.probability * estimate.evaluations)
        return f"{failures} failures among {estimate.evaluations:,}, {in_words(estimate.interval)}"
    return f"{estimate.probability:.3g}, {in_words(estimate.interval)}"


def in_words(interval: tuple[float, float]) -> str:
    """Return an interval as text with at least three digits; its ends are rounded outwards."""
    low, high = interval
    return f"{rounded(low, interval, down=True)} to {rounded(high, interval)}"


def rounded(end: float, interval: tuple[float, float], *, down: bool = False) -> str:
    """Return an end of an interval rounded outwards, with enough digits that the width does not double."""
    if not end:
        return "0"
    low, high = interval
    leading = math.floor(math.log10(end))
    sufficient = (n for n in range(3, _MOST_DIGITS) if 2 * 10.0 ** (leading - n + 1) <= high - low)
    digits = next(sufficient, _MOST_DIGITS)
    return f"{round_end(end, digits, up=not down):.{digits}g}"
