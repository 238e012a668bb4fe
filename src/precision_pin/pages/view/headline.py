"""The page's answer: whether the limits are kept, or the size of the errors, each with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.written_units import WrittenUnit
from precision_pin.pages.view.scales import middle_of
from precision_pin.render.html import escaped
from precision_pin.render.tables import bounded
from precision_pin.sampling.table import NOTHING_VARIES
from precision_pin.statistics import (
    NO_GROUNDS,
    Grounds,
    Specification,
    SpecificationResult,
    Verdict,
    clopper_pearson,
    quantile_ranks,
)
from precision_pin.statistics.intervals import format_inside, format_interval, format_share
from precision_pin.statistics.limits import are_inside
from precision_pin.statistics.summary import NO_SPREAD, is_varying, with_norms

CONFIDENCE: Final = 0.95
"""Confidence of every interval on the page."""

LEVELS: Final = (0.5, 0.95, 0.9973)
"""Quantiles marked on the colour bar."""

_HEADLINE_LEVEL: Final = 0.95


@dataclass(frozen=True)
class Answer:
    """The answer, its basis, and the verdict on a limit (empty for a size), as plain text that is not yet escaped."""

    text: str
    detail: str
    verdict: Verdict | str = ""


def answers(
    errors: Array,
    specifications: Sequence[Specification],
    covariance: Array,
    grounds: Grounds = NO_GROUNDS,
    tool_axes: Array | None = None,
) -> tuple[Answer, ...]:
    """Return the verdict on each limit, the size of position errors, and a constant part that outweighs their spread.

    ``errors`` are ``[d; δ]`` ``(6, N)``, m and rad; ``covariance`` ``(6, 6)`` is their first-order covariance, and
    ``tool_axes`` ``(3, 3)`` are columns in the base (default: base axes).
    """
    moved = with_norms((np.ptp(errors, axis=1) > NO_SPREAD) | (np.diag(covariance) > NO_SPREAD**2))
    covariances = covariance, np.cov(errors) if errors.shape[1] > 1 else None
    axes = np.eye(3) if tool_axes is None else tool_axes
    varies = [is_varying(specification, moved, axes, covariances) for specification in specifications]
    verdicts = (
        _judge(specification, errors, axes, is_varied, grounds)
        for specification, is_varied in zip(specifications, varies, strict=True)
    )
    results = [*verdicts, _describe_size(errors)]
    middle = middle_of(errors[:3])
    estimate = quantile(np.linalg.norm(errors[:3] - middle[:, None], axis=0), _HEADLINE_LEVEL)
    if estimate is not None and middle.any():
        value, (low, high) = estimate
        within = format_inside(1e3 * value, (1e3 * low, 1e3 * high), most=5)
        text = f"Mean error {mean_size(errors[:3])} mm, the same for every robot"
        results.append(Answer(text, f"95 % of robots within {within} mm of it"))
    return tuple(results)


def quantile(values: Array, level: float) -> tuple[float, tuple[float, float]] | None:
    """Return a quantile of ``(N,)`` values and its distribution-free interval; None where N does not resolve it."""
    ranks = quantile_ranks(values.size, level, CONFIDENCE)
    if ranks is None:
        return None
    ordered = np.sort(values)
    return float(np.quantile(ordered, level)), (float(ordered[ranks[0] - 1]), float(ordered[ranks[1] - 1]))


def limit_text(specification: Specification) -> str:
    """Return a limit as written by the page: ``|d| ≤ 0.5 mm for 99.73 %``."""
    return f"{bounded(specification.quantity, specification.limit)} for {100 * specification.required:.10g} %"


def as_html(answers_of_page: Sequence[Answer]) -> str:
    """Return the answer as HTML, as the page's script also writes it."""
    return "\n".join(
        f"<p class='answer' data-verdict='{answer.verdict}'>{escaped(answer.text)}</p>\n"
        f"<p class='fine'>{escaped(answer.detail)}</p>"
        for answer in answers_of_page
    )


def _judge(specification: Specification, errors: Array, tool_axes: Array, varies: bool, grounds: Grounds) -> Answer:
    is_inside = are_inside(specification.conditions(tool_axes), errors)
    inside = int(np.count_nonzero(is_inside))
    result = SpecificationResult(
        quantity=specification.quantity,
        limit=specification.limit,
        required=specification.required,
        probability=inside / is_inside.size,
        interval=clopper_pearson(inside, is_inside.size, CONFIDENCE),
        varies=varies,
        grounds=grounds,
    )
    text = f"{result.verdict.capitalize()}{result.grounds.taken if result.met else ''}: {limit_text(specification)}"
    if result.verdict == "not judged":
        return Answer(text, result.grounds.why, result.verdict)
    if result.verdict == "nothing to judge":
        return Answer(text, NOTHING_VARIES, result.verdict)
    share, low, high = format_share(result.probability, result.interval, result.required)
    more = "; more samples decide it" if result.verdict == "undecided" else ""
    return Answer(text, f"{share} % inside, interval {low} to {high} %{more}", result.verdict)


def mean_size(positions: Array) -> str:
    """Return the length of the mean of position errors ``(3, N)``, mm, with the digits that N samples support."""
    size = 1e3 * float(np.linalg.norm(positions.mean(axis=1)))
    half = 2e3 * float(np.sqrt(positions.var(axis=1).sum() / positions.shape[1]))
    return format_inside(size, (size - half, size + half), most=3)


def _describe_size(errors: Array) -> Answer:
    sizes = np.linalg.norm(errors[:3], axis=0)
    robots = f"{sizes.size:,} robots" if sizes.size > 1 else "1 robot"
    length = WrittenUnit.of_axis("position", float(sizes.max()))
    if np.ptp(sizes) <= NO_SPREAD:
        return Answer(f"Every robot within {length.short(sizes.max())}", f"{robots}, all alike")
    estimate = quantile(sizes, _HEADLINE_LEVEL)
    if estimate is None:
        return Answer(f"{robots} are too few for the 95 % quantile", "add samples")
    value, ends = estimate
    text = format_inside(length.per_si * value, (length.per_si * ends[0], length.per_si * ends[1]), most=5)
    low, high = format_interval(*ends, length.per_si)
    return Answer(
        f"95 % of robots within {text} {length.name}",
        f"interval {low} to {high} {length.name} at {100 * CONFIDENCE:g} % confidence; {robots}",
    )
