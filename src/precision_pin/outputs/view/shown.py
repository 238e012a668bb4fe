"""Contents of a page at one pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from precision_pin.model.pose_model import PoseModel
from precision_pin.typing import Array

__all__ = ["Shown"]


@final
@dataclass(frozen=True, eq=False)
class Shown:
    """A pose and the errors sampled there.

    Attributes
    ----------
    pose_model
        The model at the pose.
    errors
        Its errors ``(6, N)``, ``[d; δ]`` in base axes, m and rad; those of units 0 to N - 1 where they were sampled.
    name
        The pose's name, for the caption; ``None`` for a pose without one.
    pose
        Number of the pose that the draws of pose scope were made for, as in :meth:`precision_pin.draws.space.Space.sample`.
    """

    pose_model: PoseModel
    errors: Array
    name: str | None = None
    pose: int = 0
