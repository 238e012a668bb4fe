"""Specifications over the poses of a map, judged at every pose by sampled robots."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.base.arrays import Array, Fixed, Keys, Record
from precision_pin.base.progress import scaled
from precision_pin.sampling import Progress
from precision_pin.sampling.poses_result import PosesResult
from precision_pin.statistics import Specification, SpecificationResult, Verdict

ROUNDS: Final = (2_000, 20_000, 200_000)
"""Robots at a pose in each round of sampling. A round samples the poses that are still undecided, the last one only for
specifications that are met or undecided everywhere.
"""
FIRST_ROUND: Final = ROUNDS[0]
# poses sampled at a time
_TOGETHER: Final = 20_000
_WORST_FIRST: Final[tuple[Verdict, ...]] = ("not met", "undecided", "nothing to judge", "met")
_UNDECIDED: Final = _WORST_FIRST.index("undecided")
MET: Final = _WORST_FIRST.index("met")
# nothing was sampled, or the pose is outside joint limits
NOT_JUDGED: Final = len(_WORST_FIRST)


@final
@dataclass(frozen=True, eq=False)
class Sampled:
    """Poses of a map, by index from 0, and their errors sampled with the exact model."""

    poses: NDArray[np.intp]
    result: PosesResult

    @property
    def verdicts(self) -> NDArray[np.intp]:
        """Rank of each verdict, worst first, ``(S, K)``."""
        specs = self.result.specification_results
        codes = [[(*_WORST_FIRST, "not judged").index(result.verdict) for result in spec.results] for spec in specs]
        return np.array(codes, dtype=np.intp).reshape(len(specs), len(self.poses))


@dataclass(frozen=True, eq=False)
class Judged(Fixed):
    """Verdicts of sampled robots on each specification at each of P poses.

    Attributes:
        samples: Robots sampled at each pose, ``(P,)``; 0 where it was not sampled.
        probability, interval: Fraction inside and its interval, ``(S, P)`` and ``(S, 2, P)``; NaN if not sampled.
        order: Rank of each verdict, worst first, ``(S, P)``.
    """

    samples: NDArray[np.intp]
    probability: Array
    interval: Array
    order: NDArray[np.intp]

    @classmethod
    def nothing(cls, specifications: int, poses: int) -> Judged:
        """Return verdicts for poses that were not sampled."""
        return cls(
            np.zeros(poses, dtype=np.intp),
            np.full((specifications, poses), np.nan),
            np.full((specifications, 2, poses), np.nan),
            np.full((specifications, poses), NOT_JUDGED, dtype=np.intp),
        )

    @classmethod
    def in_rounds(
        cls,
        sample: Callable[[NDArray[np.intp], int, float, Progress], Sampled],
        known: NDArray[np.bool_],
        specifications: int,
        confidence: float,
        step: Progress,
    ) -> Judged:
        """Sample poses in rounds of more and more robots, each pose until every specification is decided there.

        The error probability of the verdict at a pose, 1 - confidence, is divided equally among the rounds.

        Args:
            sample: Samples poses of given indices with a number of robots and a confidence; reports its samples.
            known: Poses whose joint values are known, ``(P,)``.
            specifications, confidence: Number of specifications, and the confidence of a verdict.
            step: Receives `FIRST_ROUND` progress steps for each pose in each round, for any number of sampled robots.
        """
        judged = cls.nothing(specifications, known.size)
        of_round = 1 - (1 - confidence) / len(ROUNDS)
        undecided_poses = np.flatnonzero(known)
        for count in ROUNDS:
            advance = scaled(step, count * undecided_poses.size, FIRST_ROUND * known.size)
            for begin in range(0, undecided_poses.size, _TOGETHER):
                chosen = undecided_poses[begin : begin + _TOGETHER]
                judged = judged.taking(sample(chosen, count, of_round, advance))
            undecided = judged.order == _UNDECIDED
            if count == ROUNDS[-2]:
                undecided &= (judged.order > 0).all(axis=1, keepdims=True)
            undecided_poses = undecided_poses[undecided[:, undecided_poses].any(axis=0)]
        return judged

    def taking(self, sampled: Sampled, *, again: bool = False) -> Judged:
        """Return the verdicts after further samples of some poses; verdicts already decided are kept.

        With ``again``, for verifying samples, the worse of both verdicts holds, with the numbers of these samples.
        """
        poses, result, verdicts = sampled.poses, sampled.result, sampled.verdicts
        samples, order = self.samples.copy(), self.order.copy()
        probability, interval = self.probability.copy(), self.interval.copy()
        old = order[:, poses]
        takes = np.isin(old, (_UNDECIDED, NOT_JUDGED)) | again
        samples[poses] = result.samples
        order[:, poses] = np.where(takes, np.minimum(verdicts, old if again else NOT_JUDGED), old)
        probability[:, poses] = np.where(takes, result.probability, probability[:, poses])
        interval[:, :, poses] = np.where(takes[:, None], result.probability_interval, interval[:, :, poses])
        return Judged(samples, probability, interval, order)

    def to_dict(self, pose: int) -> dict[str, Any] | None:
        """Return the verdicts at a pose in the ``precision-pin/map/1`` schema; ``None`` where there are none."""
        if not self.samples[pose] or not len(self.order):
            return None
        return {
            "samples": int(self.samples[pose]),
            "probability": self.probability[:, pose].tolist(),
            "interval": self.interval[:, :, pose].tolist(),
            "verdict": self.verdicts(pose),
        }

    def verdicts(self, pose: int) -> list[Verdict]:
        """Return the verdict on each specification at a pose."""
        return [_name_pose(order) for order in self.order[:, pose].tolist()]


def _name_pose(order: int) -> Verdict:
    return "not judged" if order == NOT_JUDGED else _WORST_FIRST[order]


@dataclass(frozen=True)
class MapVerdict(Record):
    """Verdict on a specification over the poses of a map whose joint values are known.

    Attributes:
        worst: Index of the worst pose: by the sampled robots or, where none were sampled, in closed form.
        share, bounds: Fraction inside at that pose in closed form, and its bounds for any laws.
        sampled: Result of the sampled robots at that pose; ``None`` if it was not sampled.
        verdict: ``"met"`` if met at every pose, ``"not met"`` if not at some, else ``"undecided"`` or ``"nothing to
            judge"``, as at single poses; ``"not judged"`` where nothing was sampled.
        met_at, undecided_at, judged: Number of poses at which it is met, left undecided, and judged.
        most_samples, needed: Most robots sampled at a pose, and about how many would decide every pose, if any.
    """

    KEYS: ClassVar[Keys] = (
        *("quantity=specification.quantity", "limit=specification.limit", "required=specification.required", "met"),
        *("verdict", "worst_pose=worst", "probability=share", "probability_bounds=bounds", "sampled", "met_at"),
        *("undecided_at", "judged", "most_samples", "needed_samples=needed"),
    )

    specification: Specification
    worst: int
    share: float
    bounds: tuple[float, float]
    sampled: SpecificationResult | None
    verdict: Verdict
    met_at: int
    undecided_at: int
    judged: int
    most_samples: int
    needed: int | None

    @property
    def met(self) -> bool | None:
        """Whether it is met at every pose whose joint values are known; ``None`` if nothing was sampled."""
        return None if self.verdict == "not judged" else self.verdict == "met"

    def entry(self, labels: Sequence[str]) -> dict[str, Any]:
        """Return the entry of ``spec`` in the ``precision-pin/map/1`` schema."""
        entry = self.to_dict()
        entry["worst_pose"] = labels[self.worst]
        if self.sampled is not None:
            entry["sampled"] = self.sampled.encoded(("probability", "interval", "met"))
        return entry


def map_verdicts(
    specifications: Sequence[Specification],
    probability: Array,
    bounds: Array,
    judged: Judged,
    worst_first: Sequence[Sequence[int]],
    sampled: Sampled | None,
) -> tuple[MapVerdict, ...]:
    """Return the verdicts.

    ``probability`` and ``bounds`` are closed-form, ``(S, P)`` and ``(S, 2, P)``, NaN for unknown poses; ``worst_first``
    lists the indices of the known poses for each specification; ``sampled`` verifies.
    """
    verdicts = []
    for rank, (specification, order) in enumerate(zip(specifications, worst_first, strict=True)):
        worst, codes = order[0], judged.order[rank, order]
        result = None
        if sampled is not None and worst in sampled.poses:
            of_poses = sampled.result.specification_results[rank].results
            result = of_poses[int(np.flatnonzero(sampled.poses == worst)[0])]
        open_at = np.array(order)[codes == _UNDECIDED]
        verdicts.append(
            MapVerdict(
                specification, worst, float(probability[rank, worst]), tuple(bounds[rank, :, worst].tolist()), result,
                _name_pose(int(codes.min())), int((codes == MET).sum()), open_at.size,
                int((codes < NOT_JUDGED).sum()), int(judged.samples.max()),
                _required_samples(judged.probability[rank, open_at], specification.required),
            )
        )  # fmt: skip
    return tuple(verdicts)


def _required_samples(shares: Array, required: float) -> int | None:
    """Return how many robots would decide each of some fractions, rounded up to two digits; ``None`` beyond 10⁹."""
    if not shares.size:
        return None
    score = float(special.ndtri(0.99))
    with np.errstate(divide="ignore"):
        counts = score**2 * required * (1 - required) / (shares - required) ** 2
    count = max(float(counts.max()), math.log(0.025) / math.log(required))
    if not count < 1e9:
        return None
    place = 10.0 ** max(math.floor(math.log10(count)) - 1, 0)
    return int(math.ceil(count / place) * place)
