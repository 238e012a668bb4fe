"""Specifications over several poses: met only if met at every one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, final

from precision_pin.statistics import Grounds, SpecificationResult, Verdict

_WORST_FIRST: Final[tuple[Verdict, ...]] = ("not met", "not judged", "undecided", "nothing to judge", "met")


@final
@dataclass(frozen=True)
class PosesSpecification:
    """Result of a specification over several poses.

    Attributes
    ----------
    results
        At each pose.
    labels
        Of the poses, no two alike.
    largest
        The mean at each pose of the norm that the quantity belongs to, which orders poses with the same share inside.
    everywhere
        The share of robots that keep it at all poses, each robot at every one; ``None`` where that was not asked.
    """

    results: tuple[SpecificationResult, ...]
    labels: tuple[str, ...]
    largest: tuple[float, ...]
    everywhere: SpecificationResult | None = None

    @cached_property
    def worst_first(self) -> list[int]:
        """Numbers of the poses, from 0, the worst first: by verdict, then by the share inside, then by ``largest``."""

        def order(pose: int) -> tuple[int, float, float]:
            result = self.results[pose]
            return _WORST_FIRST.index(result.verdict), result.probability, -self.largest[pose]

        return sorted(range(len(self.results)), key=order)

    @property
    def worst(self) -> int:
        """Number of the worst pose, which decides the verdict."""
        return self.worst_first[0]

    @property
    def verdict(self) -> Verdict:
        """That of the worst pose or, if that is worse, of the robots that keep it at all poses."""
        verdicts = [self.results[self.worst].verdict, *([self.everywhere.verdict] if self.everywhere else [])]
        return min(verdicts, key=_WORST_FIRST.index)

    @property
    def grounds(self) -> Grounds:
        """Those of the first pose that is not judged, else of all."""
        return next((one.grounds for one in self.results if one.grounds.not_judged), self.results[0].grounds)

    @property
    def said(self) -> str:
        """The verdict in capitals, with the reason why there is none, or with what it takes as exact."""
        return self.grounds.said(self.verdict)

    @property
    def met(self) -> bool:
        """Whether the specification is met at every pose and, where asked, by enough robots at all of them."""
        return self.verdict == "met"

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``spec`` in the ``precision-pin/poses/1`` schema."""
        specified = self.results[0]
        of_all = self.everywhere
        asked = of_all and {"probability": of_all.probability, "interval": list(of_all.interval), "met": of_all.met}
        return {
            "quantity": specified.quantity,
            "limit": specified.limit,
            "required": specified.required,
            "met": self.met,
            "verdict": self.verdict,
            **self.grounds.to_dict(),
            **({"everywhere": asked} if asked else {}),
            "worst_pose": self.labels[self.worst],
            "poses": [
                {
                    "name": label,
                    "probability": result.probability,
                    "interval": list(result.interval),
                    "met": result.met,
                    "verdict": result.verdict,
                    "judged": not result.grounds.not_judged,
                }
                for label, result in zip(self.labels, self.results, strict=True)
            ],
        }
