"""What causes the error that a limit holds: parts of the sources before and after an allocation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.budget.shares import by_draw, reaches
from precision_pin.base.arrays import Array
from precision_pin.model.error_model import ErrorModel

MEAN: Final = "constant part"
"""Name of the error with every component at its mean."""
TOGETHER: Final = "correlated draws"
"""Name of more correlated draws than can be told apart."""
_SAME: Final = 1e-9
_DEVIATIONS: Final = 3.0


@final
@dataclass(frozen=True)
class SourcePart:
    """Part of a source.

    Attributes
    ----------
    source
        Label of the source, or of those that share a draw; or `MEAN`.
    before, after
        Root mean square (worst case: largest deviation), m or rad.
    is_chosen
        Whether the allocation chooses any of its tolerances.
    """

    source: str
    before: float
    after: float
    is_chosen: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of the result's JSON."""
        return {"source": self.source, "before": self.before, "after": self.after, "chosen": self.is_chosen}


@final
@dataclass(frozen=True)
class ErrorParts:
    """Parts of the first-order error at the worst pose of the tightest limit, the largest first.

    Attributes
    ----------
    pose, quantity
        Where, and of what: ``position.norm``, ``attitude.x`` and so on.
    kind
        ``"rms"``: squares of the parts add to the mean square; ``"worst_case"``: the parts add.
    sources
        The parts.
    """

    pose: str
    quantity: str
    kind: str
    sources: tuple[SourcePart, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of the result's JSON."""
        return {
            "pose": self.pose,
            "quantity": self.quantity,
            "kind": self.kind,
            "sources": [one.to_dict() for one in self.sources],
        }

    def shares(self) -> list[float]:
        """Return the share of each part in the mean square or the worst case, with the tolerances chosen."""
        powers = [one.after ** (1 if self.kind == "worst_case" else 2) for one in self.sources]
        return [one / (sum(powers) or 1.0) for one in powers]


def error_parts(
    models: Sequence[ErrorModel], pose: str, rows: Sequence[int], quantity: str, *, worst_case: bool
) -> ErrorParts:
    """Return the parts of every source.

    Parameters
    ----------
    models
        The model before, after, and with every tolerance to be chosen changed.
    pose, rows, quantity
        Where, which of the six components together, and their name.
    worst_case
        Whether parts are largest deviations, of one component.
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
