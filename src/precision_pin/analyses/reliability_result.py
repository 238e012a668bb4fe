"""What the reliability analysis found."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.design_points import Form
from precision_pin.analyses.heading import Heading, PoseHeading
from precision_pin.analyses.rare_events import Estimate
from precision_pin.statistics import Specification

__all__ = ["LikelyFailure", "PoseReliability", "ReliabilityResult", "SpecificationReliability"]

Array = NDArray[np.float64]

SCHEMA: Final = "precision-pin/reliability/1"
ASSUMPTIONS: Final = (
    "exact model: the displaced chain multiplied out",
    "FORM and importance sampling in independent standard normal numbers; discs without polar angles",
)


@final
@dataclass(frozen=True, eq=False)
class LikelyFailure:
    """A design point in the terms of the model.

    Attributes
    ----------
    beta, probability
        Reliability index and Φ(-β).
    parameters
        Value of each component there, SI.
    error
        The exact error there, ``(6,)``, m and rad.
    importance
        Share of each draw (correlated ones together) in β², largest first; the sum is 1.
    """

    beta: float
    probability: float
    parameters: Mapping[str, float]
    error: Array
    importance: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the point as the JSON has it."""
        return {
            "beta": self.beta,
            "probability": self.probability,
            "parameters": dict(self.parameters),
            "error": {"position": self.error[:3].tolist(), "attitude": self.error[3:].tolist()},
            "importance": dict(self.importance),
        }


@final
@dataclass(frozen=True, eq=False)
class SpecificationReliability:
    """One specification at one pose.

    Attributes
    ----------
    specification
        The demand.
    estimates
        Of the probability of failure, plain sampling first.
    best
        The one to go by.
    resolved
        Whether it is; otherwise ``best`` is plain sampling, of which only the interval tells.
    form
        The design points.
    failures
        The first of them in the terms of the model.
    disagreements
        One line each.
    """

    specification: Specification
    estimates: tuple[Estimate, ...]
    best: Estimate
    resolved: bool
    form: Form
    failures: tuple[LikelyFailure, ...]
    disagreements: tuple[str, ...]

    @property
    def probability(self) -> float:
        """That the error stays inside the limit."""
        return 1 - self.best.probability

    @property
    def interval(self) -> tuple[float, float]:
        """Of :attr:`probability`."""
        low, high = self.best.interval
        return 1 - high, 1 - low

    @property
    def met(self) -> bool:
        """Whether the lower end of the interval reaches what is required."""
        return self.best.interval[1] <= 1 - self.specification.required

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``spec`` as the JSON has it."""
        return {
            "quantity": self.specification.quantity,
            "limit": self.specification.limit,
            "required": self.specification.required,
            "probability": self.probability,
            "interval": list(self.interval),
            "met": self.met,
            "resolved": self.resolved,
            "failure": {
                "probability": self.best.probability,
                "interval": list(self.best.interval),
                "method": self.best.method,
            },
            "methods": [estimate.to_dict() for estimate in self.estimates],
            "form": {
                "probability": self.form.probability,
                "range": None if self.form.range is None else list(self.form.range),
                "design_points": len(self.form.points),
                "starts": self.form.starts,
                "points": [failure.to_dict() for failure in self.failures],
            },
            "disagreements": list(self.disagreements),
        }


@final
@dataclass(frozen=True, eq=False)
class PoseReliability:
    """All specifications at one pose."""

    pose: PoseHeading
    specifications: tuple[SpecificationReliability, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the pose with its specifications."""
        return {"pose": self.pose.to_dict(), "spec": [entry.to_dict() for entry in self.specifications]}


@final
@dataclass(frozen=True, eq=False)
class ReliabilityResult:
    """Reliability at one or several poses.

    Attributes
    ----------
    heading
        Of what.
    samples, confidence
        Plain samples, and the confidence of every interval.
    poses
        One entry for each.
    warnings
        One line each.
    """

    heading: Heading
    samples: int
    confidence: float
    poses: tuple[PoseReliability, ...]
    warnings: tuple[str, ...] = ()

    @property
    def met(self) -> bool:
        """Whether every specification is met at every pose."""
        return all(entry.met for pose in self.poses for entry in pose.specifications)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as the ``precision-pin/reliability/1`` schema has it, SI units."""
        return self.heading.to_dict(SCHEMA) | {
            "model": "exact",
            "samples": self.samples,
            "confidence": self.confidence,
            "assumptions": list(ASSUMPTIONS),
            "warnings": list(self.warnings),
            "poses": [pose.to_dict() for pose in self.poses],
        }

    def to_json(self) -> str:
        """Return :meth:`to_dict` as text."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)
