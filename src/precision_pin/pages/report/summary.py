"""The first screen of the report: the arm with its cloud, verdict, largest causes, what to change, assumptions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from precision_pin.analyses.collect import CauseShare, Results, milli_interval, percent, statistic
from precision_pin.base.arrays import Array
from precision_pin.pages.report.datum import datum_effect
from precision_pin.pages.report.distributions import describe_verdict, specifications, verdict
from precision_pin.pages.view.drawing import Cloud, draw_picture
from precision_pin.pages.view.headline import quantile
from precision_pin.pages.view.scales import middle_of
from precision_pin.render.figure_style import inline_figure
from precision_pin.render.html import Child, Html, element, items, joined, paragraph, section, table
from precision_pin.render.tables import MISSING, absolute, milli, share_in_words, symbol, unit
from precision_pin.statistics import Distribution, SpecificationResult, clopper_pearson, format_share
from precision_pin.statistics.intervals import format_inside
from precision_pin.statistics.plan import is_joint, sizes_of

_LEVEL: Final = 0.95
_MOST_ROBOTS: Final = 100_000
"""Largest number of robots that each row evaluates again: the default number of samples of a report."""


def constant_part(results: Results) -> float:
    """Return the position error with every parameter at its mean, m; 0 where it is a small part of the error."""
    size = float(np.linalg.norm(results.analysis.nominal[:3]))
    norm = results.analysis.position.norm
    return size if size > 0.1 * (norm.resolved_quantile(_LEVEL) or norm.max) else 0.0


def changes(results: Results) -> Html:
    """Return a table of the effect of halving the tolerance of each of the largest causes.

    The quantity is that of the first specification that is not met, of the first one where all are, or |d|.
    """
    judged = sorted(results.analysis.summary.specifications, key=lambda result: result.met)
    specification = judged[0] if judged else None
    quantity = specification.quantity if specification is not None else results.analysis.position.norm.quantity
    vector = "attitude" if quantity.startswith("attitude") else "position"
    causes = [cause for cause in results.rank_causes(vector) if cause.share is not None and cause.share >= 0.01][:5]
    constant = vector == "position" and constant_part(results) > 0
    if not causes and not constant:
        return joined([])
    header = ["change", "share of the variance %", f"{100 * _LEVEL:g} % within [{unit(quantity)}]"]
    limit = f"{milli(specification.limit, 6)} {unit(quantity)}" if specification is not None else ""
    header += [] if specification is None else [f"inside {'all limits' if is_joint(quantity) else limit}"]
    tool_axes = results.at.posture.tool_axes
    rows = [
        [*row, *_outcome(errors, quantity, specification, tool_axes)]
        for row, errors in _changed(results, causes, constant)
    ]
    count = min(results.analysis.samples, _MOST_ROBOTS)
    note = (
        f"The same {count:,} robots with the change, {results.analysis.model} model. Halved: each deviation from the mean is "
        "half as large. Constant part: the error with every parameter at its mean, the same for every robot; compensate "
        "corrects it in the joint values, calibrate measures it."
    )
    caption = f"What to change, and what it brings: {absolute(quantity)}"
    return joined([table(caption, header, rows, last=True), paragraph(note, class_="note")])


def _changed(results: Results, causes: list[CauseShare], constant: bool) -> Iterator[tuple[list[Child], Array]]:
    """Yield the cells that name a change, and the errors ``(6, n)`` with it; all changes together come last."""
    errors, mean = results.errors_with(_MOST_ROBOTS), np.array(results.analysis.nominal)[:, None]
    now = errors([])
    yield ["as it is", ""], now
    if constant:
        yield [f"without the constant part of {milli(constant_part(results), 3)} mm", ""], now - mean
    for entry in causes:
        yield [f"halved: {entry.cause.text}", percent(entry.share)], errors([entry.cause])
    if len(causes) + constant > 1:
        yield ["all of these", ""], errors(entry.cause for entry in causes) - constant * mean


def _outcome(errors: Array, quantity: str, specification: SpecificationResult | None, tool_axes: Array) -> list[Child]:
    values = sizes_of(quantity, errors, tool_axes)
    estimate = quantile(values, _LEVEL)
    size = MISSING if estimate is None else _inside(estimate)
    if specification is None:
        return [size]
    inside = int(np.count_nonzero(values <= specification.limit))
    share, interval = inside / values.size, clopper_pearson(inside, values.size, 0.95)
    result = replace(specification, probability=share, interval=interval)
    text = f"{format_share(share, interval, specification.required)[0]} %, "
    return [size, element("span", text, element("strong", result.verdict, class_="good" if result.met else "bad"))]


def _inside(estimate: tuple[float, tuple[float, float]]) -> str:
    """Return a quantile in mm or mrad with the digits that its interval supports."""
    value, (low, high) = estimate
    return format_inside(1e3 * value, (1e3 * low, 1e3 * high))


_LEVELS: Final = (0.95, 0.9973)


def summary(
    poses: Sequence[Results], answers: Sequence[str] = (), missed: Sequence[str] = (), headline: Sequence[str] = ()
) -> Html:
    """Return the first section: the verdict, for several poses on the worst with a table of all, and what to change.

    The worst pose comes first. ``answers`` are those of the chapters beside the poses; ``missed`` states where else a
    limit is not met. ``headline`` is an answer above the verdict, and the line between the two.
    """
    worst = poses[0]
    above = [
        paragraph(element("strong", line), class_="verdict" if k == 0 else "lead") for k, line in enumerate(headline)
    ]
    words = element("div", *above, verdict(worst, missed), _causes(worst), class_="words")
    judged = worst.analysis.summary.specifications
    parts: list[Child] = [element("div", words, picture(worst), class_="first"), datum_effect(worst)]
    if len(poses) > 1:
        parts.append(_by_pose(poses))
    if answers:
        parts.append(items(answers, "answers"))
    if len(judged) != 1:
        # a single one is in the first sentence
        parts.append(specifications(worst))
    heading = "Verdict" if judged else "Result"
    if len(poses) > 1:
        heading += f", worst of {len(poses)} poses: {name_pose(worst)}"
    return section("verdict", heading, *parts, changes(worst), folded=False)


def name_pose(results: Results) -> str:
    """Return a pose's name, or a phrase where it has none."""
    return results.analysis.pose_name or "joint values of the command line"


def picture(results: Results) -> Html:
    """Return the arm with its cloud."""
    norm, nominal, errors = results.analysis.position.norm, results.analysis.nominal[:3], results.cloud[:3]
    limits = [result for result in results.analysis.summary.specifications if result.quantity == norm.quantity]
    limit = min(limits, key=lambda result: result.limit, default=None)
    # errors far from zero are drawn relative to the error at the means
    is_apart = bool(middle_of(errors).any())
    if is_apart:
        estimate = quantile(np.linalg.norm(errors - nominal[:, None], axis=0), _LEVEL)
        within, middle = estimate and estimate[0], tuple(nominal.tolist())
        size = estimate and f"{_inside(estimate)} mm"
        phrase = f"errors without the constant part of {milli(constant_part(results), 3)} mm"
    else:
        within, middle = norm.resolved_quantile(_LEVEL), (0.0, 0.0, 0.0)
        size = None if within is None else f"{statistic(norm, _LEVEL)} {unit(norm.quantity)}"
        phrase = "errors"
    cloud = Cloud(errors, within, limit and limit.limit, limit is None or limit.met, middle)
    posture = results.at.posture
    drawn = draw_picture(posture, cloud, [Path(folder) for folder in results.package_dirs])
    parts = [f"{drawn.points:,} sampled robots, {phrase} ×{drawn.factor:g} about the tip (+)"]
    if size is not None:
        parts.append(f"dashed: 95 % within {size}")
    if limit is not None:
        beyond = "not drawn" if is_apart else "outside the picture"
        where = "limit" if drawn.shows_limit else f"{beyond}: the limit"
        parts.append(f"{where} {milli(limit.limit, 6)} {unit(norm.quantity)}")
    tip = ", ".join(milli(value, 5) for value in posture.pose[:3, 3])
    return inline_figure(
        drawn.figure,
        f"{results.prefix}arm",
        f"The arm with {len(posture.q)} joints; the tip without error is at ({tip}) mm in the base; sampled "
        f"positions about it are drawn {drawn.factor:g} times too far away",
        "; ".join(parts) + ".",
        class_="arm",
    )


def causes_in_words(results: Results, vector: str, most: int) -> list[tuple[float, str]]:
    """Return the largest causes as fraction and text."""
    ranked = results.rank_causes(vector)
    return [
        (entry.share, entry.cause.text) for entry in ranked[:most] if entry.share is not None and entry.share >= 5e-4
    ]


def _causes(results: Results) -> Html:
    """Return the largest causes, the error at the means if it is a large part, and how much rests on assumptions."""
    parts: list[Child] = []
    if largest := causes_in_words(results, "position", 3):
        lines = [element("li", element("strong", f"{100 * share:.0f} %"), f" {text}") for share, text in largest]
        parts.append(paragraph("Largest causes, share of the variance of d:", class_="lead"))
        parts.append(element("ul", *lines, class_="causes"))
    size = constant_part(results)
    if size > 0:
        text = f"{milli(size, 3)} mm is the error before anything varies, from mean values and loads."
        parts.append(paragraph(text))
    assumed, sources = results.analysis.assumed, results.analysis.sources
    if assumed:
        # in a calibrated arm a number of an assumed source may be measured
        shares = {kind: position for kind, (position, _) in results.analysis.origins.items()}
        much = (
            f"{share_in_words(shares.get('assumed', 0.0))} of the variance of d rests"
            if any(shares.values())
            else "Rests"
        )
        counted = f"{len(assumed):,} of {sources:,} sources are marked as assumed in the sheet."
        parts.append(paragraph(element("strong", f"{much[0].upper()}{much[1:]} on assumptions: {counted}")))
    return joined(parts)


def _by_pose(poses: Sequence[Results]) -> Html:
    has_verdict = bool(poses[0].analysis.summary.specifications)
    header = ["pose", *(["verdict"] if has_verdict else [])]
    header += [*(f"{100 * level:g} % within [{unit('position')}]" for level in _LEVELS), "largest cause"]
    rows = []
    for results in poses:
        judged = results.analysis.summary.specifications
        norm = results.analysis.position.norm
        cells: list[Child] = [name_pose(results)]
        if judged:
            phrase = judged[0].verdict if len(judged) == 1 else describe_verdict(judged)
            met = all(result.met for result in judged)
            cells.append(element("strong", phrase, class_="good" if met else "bad"))
        cells += [_with_interval(norm, level) for level in _LEVELS]
        largest = causes_in_words(results, "position", 1)
        cells.append("".join(f"{100 * share:.0f} % {text}" for share, text in largest) or MISSING)
        rows.append(cells)
    caption = f"{len(poses)} poses, the worst first: position error {symbol('position.norm')}"
    return element("div", table(caption, header, rows, words=(1, 4) if has_verdict else (3,)), class_="poses")


def _with_interval(norm: Distribution, level: float) -> Child:
    value, interval = statistic(norm, level), milli_interval(norm, level)
    return value if MISSING in (value, interval) else joined([value, " ", element("small", interval)])
