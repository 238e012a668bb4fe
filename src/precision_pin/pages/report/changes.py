"""What to change: the error of the same robots with a tolerance halved, or without the constant part."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from precision_pin.analyses.budget.budget_result import BudgetResult, PoseBudget
from precision_pin.analyses.causes import CauseShare, rank_causes
from precision_pin.analyses.collect import Results
from precision_pin.analyses.report_cells import MISSING, percent
from precision_pin.base.arrays import Array
from precision_pin.pages.view.headline import quantile, values_of
from precision_pin.render.html import Child, Html, element, joined, paragraph, table
from precision_pin.render.tables import absolute, milli, unit
from precision_pin.statistics import SpecificationResult, clopper_pearson, format_share
from precision_pin.statistics.digits import format_inside

NOTABLE: Final = 0.1
"""Share of the 95 % quantile from which on the error of the arm without any tolerance is said."""

_LISTED: Final = 5
_LEAST: Final = 0.01
_LEVEL: Final = 0.95
# robots evaluated again for each row
_MOST: Final = 100_000


def constant_part(results: Results) -> float:
    """Return the position error with every parameter at its mean, m; 0 where it is a small part of the error."""
    size = float(np.linalg.norm(results.analysis.nominal[:3]))
    norm = results.analysis.position.norm
    return size if size > NOTABLE * (norm.quantile(_LEVEL) or norm.max) else 0.0


def budget_of(results: Results) -> PoseBudget | None:
    """Return the budget of the pose, if there is one."""
    found = next((result for result in results.found.values() if isinstance(result, BudgetResult)), None)
    return None if found is None else found.poses[0]


def changes(results: Results) -> Html:
    """Return a table of what each of the largest causes brings if its tolerance is halved.

    The quantity is that of the first specification that is not met, of the first one where all are, or |d|.
    """
    given = sorted(results.analysis.summary.specifications, key=lambda one: one.met)
    asked = given[0] if given else None
    quantity = asked.quantity if asked is not None else results.analysis.position.norm.quantity
    vector = quantity.partition(".")[0]
    budget = budget_of(results)
    ranked = [] if budget is None else rank_causes(results.causes, budget, vector)
    causes = [one for one in ranked if one.share is not None and one.share >= _LEAST][:_LISTED]
    constant = vector == "position" and constant_part(results) > 0
    if not causes and not constant:
        return joined([])
    header = ["change", "share of the variance %", f"{100 * _LEVEL:g} % within [{unit(quantity)}]"]
    header += [] if asked is None else [f"inside {milli(asked.limit, 6)} {unit(quantity)}"]
    rows = [[*row, *_outcome(errors, quantity, asked)] for row, errors in _changed(results, causes, constant)]
    count = min(results.analysis.samples, _MOST)
    note = (
        f"The same {count:,} robots with the change, {results.analysis.model} model. Halved: each deviation from the mean is "
        "half as large. Constant part: the error with every parameter at its mean, the same for every robot; compensate "
        "corrects it in the joint values, calibrate measures it."
    )
    caption = f"What to change, and what it brings: {absolute(quantity)}"
    return joined([table(caption, header, rows, last=True), paragraph(note, class_="note")])


def _changed(results: Results, causes: list[CauseShare], constant: bool) -> Iterator[tuple[list[Child], Array]]:
    """Yield the cells that name a change, and the errors ``(6, n)`` with it; all changes together are last."""
    errors, mean = results.errors_with(_MOST), np.array(results.analysis.nominal)[:, None]
    now = errors([])
    yield ["as it is", ""], now
    if constant:
        yield [f"without the constant part of {milli(constant_part(results), 3)} mm", ""], now - mean
    for one in causes:
        yield [f"halved: {one.cause.text}", percent(one.share)], errors([one.cause])
    if len(causes) + constant > 1:
        yield ["all of these", ""], errors(one.cause for one in causes) - constant * mean


def _outcome(errors: Array, quantity: str, asked: SpecificationResult | None) -> list[Child]:
    values = np.abs(values_of(quantity, errors))
    found = quantile(values, _LEVEL)
    size = MISSING if found is None else format_inside(1e3 * found[0], (1e3 * found[1][0], 1e3 * found[1][1]))
    if asked is None:
        return [size]
    kept = int(np.count_nonzero(values <= asked.limit))
    share, interval = kept / values.size, clopper_pearson(kept, values.size, 0.95)
    said = SpecificationResult(quantity, asked.limit, asked.required, share, interval, True)
    text = f"{format_share(share, interval, asked.required)[0]} %, "
    return [size, element("span", text, element("strong", said.verdict, class_="good" if said.met else "bad"))]
