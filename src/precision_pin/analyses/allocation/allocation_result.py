"""Chosen tolerances, their cost and what verifies them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, final

import numpy as np

from precision_pin.analyses.allocation.costs import Tolerance
from precision_pin.analyses.allocation.grades import FrontPoint
from precision_pin.analyses.budget.shares import by_draw, reaches
from precision_pin.analyses.result import AnalysisResult
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.record import Keys, Record
from precision_pin.model.error_model import ErrorModel
from precision_pin.render.notebook import preformatted
from precision_pin.statistics import NO_GROUNDS, Grounds
from precision_pin.statistics.verdicts import Verdict, judge

Basis = Literal["proof", "samples", "normal law"]
"""What a lower bound of the cost rests on."""


@final
@dataclass(frozen=True)
class AllocatedLimit(Record):
    """A limit with the tolerances chosen, at its worst pose.

    Attributes:
        kind: ``"quantile"``, ``"rms"`` or ``"worst_case"``.
        quantity, limit, required: What is limited, m or rad, and the required probability of a quantile.
        aimed: Probability at which the first-order quantile was held, so that the samples show the required one;
            ``None`` where every choice of grades was sampled.
        first_order: Largest value over the poses: quantile, root mean square or worst case of the first-order model.
        worst_pose: The worst pose: by the samples of a quantile, else by the first-order model.
        shadow_price: What the least cost would fall for each m or rad of a wider limit, summed over the poses; ``None``
            if infeasible.
        probability, interval: Share of fresh samples of the exact model inside, and its 95 % interval; ``None`` of a
            limit without probability.
        varies: Whether the quantity differs from robot to robot.
        margin: Probability beyond the required one that the interval keeps, so that as many samples as were asked for
            will show it.
        grounds: What keeps it from being judged, and what it takes as exact.
    """

    KEYS: ClassVar[Keys] = (
        *("kind", "quantity", "limit", "required", "aimed", "first_order", "worst_pose", "shadow_price"),
        *("probability", "interval", "met", "verdict", "margin"),
    )

    kind: str
    quantity: str
    limit: float
    aimed: float | None
    first_order: float
    worst_pose: str
    shadow_price: float | None
    required: float | None = None
    probability: float | None = None
    interval: tuple[float, float] | None = None
    varies: bool = True
    margin: float = 0.0
    grounds: Grounds = NO_GROUNDS

    @property
    def is_kept(self) -> bool:
        """Whether it is kept, whether it may be judged or not."""
        return self._judged == "met"

    @property
    def verdict(self) -> Verdict:
        """That of the interval of the samples; of a limit without probability, whether the first order keeps it."""
        return "not judged" if self.grounds.not_judged else self._judged

    @property
    def met(self) -> bool:
        """True if the verdict is ``"met"``."""
        return self.verdict == "met"

    @property
    def _judged(self) -> Verdict:
        if self.interval is None or self.required is None:
            keeps = self.first_order <= self.limit * (1 + 1e-9)
            return judge(holds=keeps, fails=not keeps)
        low, high = self.interval
        return judge(holds=low >= self.required, fails=high < self.required, varies=self.varies)


def tightest_of(limits: Sequence[AllocatedLimit]) -> int:
    """Return the number of the limit exceeded most by the first order, of those not kept; else of that with the least left."""
    return max(range(len(limits)), key=lambda k: (not limits[k].is_kept, limits[k].first_order / limits[k].limit))


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AllocationResult(AnalysisResult):
    """Cheapest tolerances that keep every limit, or the narrowest ones where none do.

    Attributes:
        tolerances: What was to be chosen, with the values of the sheet.
        after, costs: Chosen tolerances (m, rad) and the cost of each, ``(n,)``.
        shadow_prices: What one held by its upper bound would save for each m or rad more; negative at the lower bound,
            zero between and where it has grades.
        lower_bound: No tolerances that keep the limits, as they are stated, cost less; ``None`` if infeasible, where
            the time for a choice of grades ended before one was found, and where specifications have a law far from
            normal or a norm below 92 %.
        bound_basis: What the lower bound rests on: ``"proof"``, of limits of the first order; ``"samples"``, where
            every cheaper choice of grades was sampled and shown to fail, with 95 % confidence; ``"normal law"``, of
            specifications otherwise: that no other tolerances exceed the normal law of the first order by more than the
            samples show, and that the variances that keep the quantile of a norm form a convex set.
        limits: The limits with the tolerances chosen.
        for_samples: Number of samples that are to show that the specifications are met; 0 for no margin.
        margin_cost: What the margin costs: by samples of the cheapest choice without one, else by the first order;
            ``None`` without margin, and where that is not known.
        parts: What causes the error at the worst pose of the tightest limit, before and after.
        poses: Names of the poses.
        grounds: What keeps the limits from being judged, and what is taken as exact.
        feasible: Whether tolerances within the bounds keep the limits; if not, all numbers are those of the narrowest
            tolerances.
        front: Points of the front of cost against accuracy, if asked for.
    """

    schema: ClassVar[str] = "precision-pin/allocation/1"

    KEYS: ClassVar[Keys] = (
        *("*head", "tolerances=tolerance_entries", "cost", "cost_before", "lower_bound", "lower_bound_is_proven"),
        *("lower_bound_basis=bound_basis", "gap", "for_samples", "margin_cost", "specs=limits", "parts", "poses"),
        *("feasible", "met", "*grounds", "pareto=front", "findings"),
    )

    tolerances: tuple[Tolerance, ...]
    after: Array
    costs: Array
    shadow_prices: Array
    lower_bound: float | None
    bound_basis: Basis
    limits: tuple[AllocatedLimit, ...]
    for_samples: int
    margin_cost: float | None
    parts: ErrorParts
    poses: tuple[str, ...]
    feasible: bool
    front: tuple[FrontPoint, ...] = ()
    grounds: Grounds = NO_GROUNDS

    @property
    def cost(self) -> float:
        """Sum of the costs."""
        return float(self.costs.sum())

    @property
    def cost_before(self) -> float:
        """Sum of the costs of the sheet's tolerances."""
        return float(sum(float(one.cost.at(np.array(one.before))) for one in self.tolerances))

    @property
    def gap(self) -> float | None:
        """Largest share of the cost that could still be saved, the margin's included; ``None`` where limits are not met."""
        if self.lower_bound is None or not self.met:
            return None
        return max(self.cost - self.lower_bound, 0.0) / max(abs(self.cost), 1e-300)

    @property
    def met(self) -> bool:
        """Whether every limit is met; false where a pose is outside joint limits, unless the model is judged there too."""
        return self.feasible and not self.grounds.not_judged and all(one.met for one in self.limits)

    @property
    def tightest(self) -> AllocatedLimit:
        """The limit that is not kept and exceeded most; where all are kept, the one with the least left."""
        return self.limits[tightest_of(self.limits)]

    @property
    def changes(self) -> dict[str, str]:
        """The chosen tolerances by path, as :meth:`ErrorModel.with_` and ``--set`` take them."""
        return {one.path: one.written(value) for one, value in zip(self.tolerances, self.after.tolist(), strict=True)}

    @property
    def lower_bound_is_proven(self) -> bool:
        """Whether the lower bound rests on a proof."""
        return self.bound_basis == "proof"

    @property
    def tolerance_entries(self) -> list[dict[str, Any]]:
        """The tolerances as in the JSON."""
        rows = zip(self.after.tolist(), self.costs.tolist(), self.shadow_prices.tolist(), strict=True)
        return [
            {"path": one.path, "before": one.before, "after": after, "grade": one.grade(after) or None}
            | {"cost": cost, "shadow_price": price}
            for one, (after, cost, price) in zip(self.tolerances, rows, strict=True)
        ]

    def _repr_html_(self) -> str:
        """Return the notebook view: the table of the command."""
        return preformatted(self._output("table:allocation_table")(self))

    @property
    def summary(self) -> str:
        """What `repr` says of the result, beside the arm."""
        return f"{len(self.tolerances)} tolerances, cost {self.cost:.6g}"


def allocated_sheet(model: ErrorModel, result: AllocationResult, folder: Path) -> str:
    """Return the sheet of a model with the chosen tolerances, without its comments.

    Args:
        model, result: The model that was allocated, and the result.
        folder: Where the sheet will lie; the robot's file is named from there.

    Raises:
        InputError: The model was not read from a sheet.
    """
    changed = model.with_(result.changes).sheet
    if changed is None or changed.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary")
    return changed.contents.written(folder)


MEAN: Final = "constant part"
"""Name of the error with every component at its mean."""
TOGETHER: Final = "correlated draws"
"""Name of more correlated draws than can be told apart."""
_SAME: Final = 1e-9
_DEVIATIONS: Final = 3.0


@final
@dataclass(frozen=True)
class SourcePart(Record):
    """Part of a source.

    Attributes:
        source: Label of the source, or of those that share a draw; or `MEAN`.
        before, after: Root mean square (worst case: largest deviation), m or rad.
        is_chosen: Whether the allocation chooses any of its tolerances.
    """

    KEYS: ClassVar[Keys] = ("source", "before", "after", "chosen=is_chosen")

    source: str
    before: float
    after: float
    is_chosen: bool


@final
@dataclass(frozen=True)
class ErrorParts(Record):
    """Parts of the first-order error at the worst pose of the tightest limit, the largest first.

    Attributes:
        pose, quantity: Where, and of what: ``position.norm``, ``attitude.x`` and so on.
        kind: ``"rms"``: squares of the parts add to the mean square; ``"worst_case"``: the parts add.
        sources: The parts.
    """

    pose: str
    quantity: str
    kind: str
    sources: tuple[SourcePart, ...]

    def shares(self) -> list[float]:
        """Return the share of each part in the mean square or the worst case, with the tolerances chosen."""
        powers = [one.after ** (1 if self.kind == "worst_case" else 2) for one in self.sources]
        return [one / (sum(powers) or 1.0) for one in powers]


def error_parts(
    models: Sequence[ErrorModel], pose: str, rows: Sequence[int], quantity: str, *, worst_case: bool
) -> ErrorParts:
    """Return the parts of every source.

    Args:
        models: The model before, after, and with every tolerance to be chosen changed.
        pose, rows, quantity: Where, which of the six components together, and their name.
        worst_case: Whether parts are largest deviations, of one component.
    """
    before, after, changed = (_parts(one, pose, list(rows), worst_case) for one in models)
    rounding = _SAME * max(before.values())
    found = [
        SourcePart(name, before[name], after[name], abs(changed[name] - before[name]) > rounding)
        for name in before
        if max(before[name], after[name]) > rounding
    ]
    ordered = tuple(sorted(found, key=lambda one: (-one.after, one.source)))
    return ErrorParts(pose, quantity, "worst_case" if worst_case else "rms", ordered)


def _parts(model: ErrorModel, pose: str, rows: list[int], worst_case: bool) -> dict[str, float]:
    at = model.at(pose)
    each: Array = reaches(at, _DEVIATIONS)[:, rows[0]] if worst_case else by_draw(at)[:, rows].sum(axis=1)
    result: dict[str, float] = {}
    for owners, part in zip(model.owners, each.tolist(), strict=True):
        # more than twelve correlated draws have no part each
        name = ", ".join(owners) if np.isfinite(part) else TOGETHER
        result[name] = result.get(name, 0.0) + (part if np.isfinite(part) else 0.0)
    if not worst_case:
        if TOGETHER in result:
            result[TOGETHER] = float(np.diag(at.covariance)[rows].sum()) - sum(result.values())
        result = {name: float(np.sqrt(max(part, 0.0))) for name, part in result.items()}
    return {MEAN: float(np.linalg.norm(at.error_at_means[rows]))} | result
