"""Specifications over the poses of a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from precision_pin.statistics import Specification, SpecificationResult
from precision_pin.typing import Array

if TYPE_CHECKING:
    from precision_pin.analyses.map.map_result import Sampled

__all__ = ["MapVerdict", "map_verdicts"]


@final
@dataclass(frozen=True)
class MapVerdict:
    """Verdict on a specification over the poses of a map whose joint values are known.

    Attributes
    ----------
    specification
        The limit and the share of robots required.
    worst
        Number of the pose with the smallest share inside in closed form.
    share
        That share.
    sampled
        Result of the sampled robots at that pose; ``None`` if it was not sampled.
    met_at, judged
        Number of poses at which enough robots are inside, by sampling where a pose was sampled and else in closed form; and of
        those judged.
    """

    specification: Specification
    worst: int
    share: float
    sampled: SpecificationResult | None
    met_at: int
    judged: int

    @property
    def met(self) -> bool:
        """Whether it is met at every pose whose joint values are known, the worst of which were sampled."""
        return self.sampled is not None and self.met_at == self.judged

    def to_dict(self, labels: Sequence[str]) -> dict[str, Any]:
        """Return the entry of ``spec`` in the ``precision-pin/map/1`` schema."""
        of = self.specification
        sampled = self.sampled
        return {
            "quantity": of.quantity,
            "limit": of.limit,
            "required": of.required,
            "met": self.met,
            "worst_pose": labels[self.worst],
            "probability": self.share,
            "sampled": None
            if sampled is None
            else {"probability": sampled.probability, "interval": list(sampled.interval), "met": sampled.met},
            "met_at": self.met_at,
            "judged": self.judged,
        }


def map_verdicts(
    specifications: Sequence[Specification], probability: Array, size: Array, sampled: Sampled | None
) -> tuple[MapVerdict, ...]:
    """Return the verdicts.

    Parameters
    ----------
    specifications, probability
        The specifications, and the shares inside in closed form, ``(S, P)``; NaN where no joint values are known.
    size
        A size of the error at each pose, ``(P,)``, which orders poses with equal shares.
    sampled
        What was sampled.
    """
    made = []
    for rank, one in enumerate(specifications):
        share = probability[rank]
        known = np.isfinite(share)
        met = known & (share >= one.required)
        results: dict[int, SpecificationResult] = {}
        if sampled is not None:
            of_poses = sampled.result.specification_results[rank].results
            results = dict(zip(sampled.poses.tolist(), of_poses, strict=True))
        for pose, result in results.items():
            met[pose] = result.met
        worst = int(np.lexsort((-size, np.where(known, share, np.inf)))[0])
        made.append(MapVerdict(one, worst, float(share[worst]), results.get(worst), int(met.sum()), int(known.sum())))
    return tuple(made)
