"""Terminal table of the worst case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from precision_pin.analyses.collect import milli_interval
from precision_pin.analyses.result import answer_of, subject
from precision_pin.analyses.worst_case.worst_case import (
    SEEN_LEVEL,
    NormBound,
    PoseWorstCase,
    WorstCaseResult,
    bound_milli,
)
from precision_pin.base.errors import some
from precision_pin.render.columns import QUANTITY, Column, text_lines
from precision_pin.render.tables import ROUNDING, milli, symbol, unit
from precision_pin.render.text_table import aligned, limited
from precision_pin.sampling.table import statistic
from precision_pin.statistics.intervals import bound_text

_SEEN: Final = f"{100 * SEEN_LEVEL:g} %"
_UNPROVEN: Final = " (not certified to 1e-9)"
NORM_COLUMNS: Final = (
    *QUANTITY,
    Column("high", bound_milli, text="first order"),
    Column(
        lambda bound: bound_milli(bound.high) + _UNPROVEN * (not bound.first_order.certified),
        report="first-order bound",
    ),
    Column("exact_norm", milli, text="there", report="exact model there"),
    Column("found.norm", milli, text="found", report="largest exact error found"),
    Column("seen.max", milli, text="largest seen", report="largest seen"),
    Column("seen", lambda seen: statistic(seen, SEEN_LEVEL), f"{_SEEN} seen", report=f"{_SEEN} of the samples within"),
    Column("seen", lambda seen: milli_interval(seen, SEEN_LEVEL), report="interval"),
)
"""Columns of the table of |d| and |δ|."""
LISTED: Final = 8
"""Number of draws listed by name, largest contributions first; the rest is one line."""


def table(result: WorstCaseResult) -> str:
    """Return the bounds, the largest exact errors found and sampled, and the contributions; mm and mrad."""
    cuts = f"cut at {result.k:g} standard deviations: {_names(result.cut)}" if result.cut else "every law is bounded"
    provenance = result.provenance
    sizes = [pose.position.first_order.upper for pose in result.poses]
    parts = [answer_of([pose.pose for pose in result.poses], sizes, [*map(_answer, result.poses)])]
    for pose in result.poses:
        lines = [
            subject(provenance, pose.pose),
            f"worst case of {result.draws} draws, {cuts}",
            f"compared with {result.samples:,} samples, seed {provenance.seed}, exact model, statics {provenance.statics}; "
            "errors in base axes",
            "",
            *text_lines(NORM_COLUMNS, (pose.position, pose.attitude)),
            "",
            *text_lines(result.COLUMNS, pose.components),
        ]
        for bound in (pose.position, pose.attitude):
            lines += ["", *_contributions(bound)]
        lines += _describe_excess(pose)
        parts.append("\n".join(lines))
    parts.append(
        "first order: largest error of the tangent model, a bound; there: the exact model at the same parameters;\n"
        "found: the largest error of the exact model found, not a bound; seen: among the samples, not a bound"
    )
    return "\n\n".join(parts)


def _answer(pose: PoseWorstCase) -> str:
    norms = (pose.position, pose.attitude)
    bounds = ", ".join(f"{symbol(bound.quantity)} {bound_milli(bound.high)} {unit(bound.quantity)}" for bound in norms)
    maxima = ", ".join(f"{milli(bound.found.norm)} {unit(bound.quantity)}" for bound in norms)
    return f"at worst, every tolerance at once: {bounds} to first order; exact model: {maxima} found"


def _names(names: Sequence[str]) -> str:
    return some(names, limited(LISTED) or len(names))


def _contributions(bound: NormBound) -> list[str]:
    """Return the contributions of the draws; the heading states whether the bound is certified."""
    maximum = bound.first_order
    if maximum.certified:
        width = 0.0 if maximum.upper == 0 else maximum.upper / maximum.lower - 1
        proof = ", in closed form" if maximum.cells == 0 else ""
        accuracy = f"global within {bound_text(max(width, 1e-12))}{proof}"
    else:
        accuracy = (
            "NOT resolved to 1e-9: the largest first-order error lies between "
            f"{1e3 * maximum.lower:.9g} and {1e3 * maximum.upper:.9g} {unit(bound.quantity)}"
        )
    nominal = "error at the means"
    places = {nominal: "", **{entry.draw: f"at {entry.at}" for entry in bound.contributions}}
    rows = [
        [f"  {name}", unit(bound.quantity), milli(value), places.get(name, "--all lists them")]
        for name, value in listed_contributions(bound, nominal)
    ]
    return [f"contributions to {symbol(bound.quantity)} ({accuracy}):", *aligned(rows)]


def _describe_excess(pose: PoseWorstCase) -> list[str]:
    lines = [
        f"the exact model goes beyond the first-order bound of {symbol(bound.quantity)} by "
        f"{1e3 * (bound.found.norm - bound.first_order.upper):.3g} {unit(bound.quantity)}: "
        "it is not linear over tolerances this large"
        for bound in (pose.position, pose.attitude)
        if bound.exceeded
    ]
    return ["", *lines] if lines else []


def listed_contributions(bound: NormBound, nominal: str) -> list[tuple[str, float]]:
    """Return the error at the means, the largest contributions and the sum of the others."""
    entries = [entry for entry in bound.contributions if abs(entry.value) > ROUNDING]
    count = len(entries) if len(entries) <= LISTED + 1 else limited(LISTED)
    other_values = [] if count is None else [entry.value for entry in entries[count:]]
    remainder = [(f"{len(other_values)} others", sum(other_values))] if other_values else []
    return [(nominal, bound.nominal), *((entry.draw, entry.value) for entry in entries[:count]), *remainder]
