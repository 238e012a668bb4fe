"""Terminal table of the reliability."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.reliability.estimates import SAMPLING, in_words, rounded
from precision_pin.analyses.reliability.reliability import METHOD_COLUMNS, ReliabilityResult, SpecificationReliability
from precision_pin.analyses.result import subject
from precision_pin.render.columns import text_lines
from precision_pin.render.text_table import limited, remainder
from precision_pin.sampling.table import NOTHING_VARIES, demanded

LISTED: Final = 6
"""Maximum number of draws and strata listed."""


def table(result: ReliabilityResult) -> str:
    """Return for every specification the verdict, the methods' estimates and differences, and the design point."""
    provenance = result.provenance
    blocks = []
    for entry in result.poses:
        lines = [
            subject(provenance, entry.pose),
            f"exact model, statics {provenance.statics}, seed {provenance.seed}; intervals at {100 * result.confidence:g} % "
            "confidence, base axes",
        ]
        for specification in entry.specifications:
            lines += ["", *_specification_lines(specification)]
        blocks.append("\n".join(lines))
    return "\n\n".join(filter(None, [*blocks, "\n".join(provenance.resting_lines)]))


def _specification_lines(entry: SpecificationReliability) -> list[str]:
    return [
        _verdict(entry),
        *text_lines(METHOD_COLUMNS, entry.estimates),
        *_form_lines(entry),
        *_strata_lines(entry),
        *_unresolved(entry),
        *(f"  note: {line}" for line in entry.comments),
    ]


def _verdict(entry: SpecificationReliability) -> str:
    interval = entry.best.interval
    if entry.verdict == "nothing to judge":
        text = NOTHING_VARIES
    elif entry.resolved:
        text = f"P(failure) {entry.best.probability:.3g} ({in_words(entry.best.interval)}, {entry.best.method})"
    else:
        span = in_words(interval) if interval[0] else f"below {rounded(interval[1], interval)}"
        text = f"P(failure) {span} by sampling" if entry.met else f"P(failure) not resolved, {span}"
    verdict = f"{demanded(entry.specification)}: {entry.said}"
    return verdict if entry.verdict == "not judged" else f"{verdict} - {text}"


def _form_lines(entry: SpecificationReliability) -> list[str]:
    form = entry.form
    if not entry.failures or form.range is None:
        return [f"  FORM  {form.starts} starts led to no design point within 8.2 standard deviations"]
    point = entry.failures[0]
    shares = ", ".join(
        f"{name} {100 * share:.1f} %" for name, share in list(point.importance.items())[: limited(LISTED)]
    )
    others = "".join(
        f"; {line}" for line in remainder(len(point.importance) - (limited(LISTED) or len(point.importance)))
    )
    count = len(form.points)
    union = "" if count == 1 else f"; all together {form.range[1]:.3g} at most if all were flat"
    return [
        f"  FORM  β {point.beta:.6g}, Φ(-β) {point.probability:.3g}; {count} distinct design "
        f"point{'' if count == 1 else 's'} from {form.starts} starts{union}",
        f"  importance  {shares}{others}",
        f"  error at the design point  d = ({_vector_text(point.error[:3])}) mm, δ = ({_vector_text(point.error[3:])}) mrad",
    ]


def _strata_lines(entry: SpecificationReliability) -> list[str]:
    parts = [part for part in entry.strata.parts if part.rare]
    if not parts and not entry.strata.remainder:
        return []
    values = ", ".join(
        f"{' and '.join(part.rare)} {part.probability:.3g}"
        if len(part.combinations) == 1
        else f"{len(part.combinations)} combinations of {', '.join(part.rare)} {part.probability:.3g}"
        for part in parts[: limited(LISTED)]
    )
    count = f", … ({len(parts)} in all: --all)" if limited(LISTED) and len(parts) > LISTED else ""
    tail = f"; not looked at, added to the upper ends: {entry.strata.remainder:.3g}" if entry.strata.remainder else ""
    return [f"  rare values, each searched separately, and their probabilities  {values or 'none'}{count}{tail}"]


def _unresolved(entry: SpecificationReliability) -> list[str]:
    """Return the basis of the verdict where the probability is not resolved, and the reason."""
    if entry.verdict == "nothing to judge" or entry.resolved:
        return []
    plain = next(estimate for estimate in entry.estimates if estimate.method == SAMPLING)
    failures = round(plain.probability * plain.evaluations)
    return [
        f"  the verdict rests on {failures:,} failures among {plain.evaluations:,} samples alone, whose interval always holds; "
        f"not resolved{' below that' if entry.met else ''}: {entry.reason}"
    ]


def _vector_text(vector: NDArray[np.float64]) -> str:
    return ", ".join(f"{1e3 * value:.4g}" for value in vector.tolist())
