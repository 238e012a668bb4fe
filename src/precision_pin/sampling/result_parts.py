"""Parts of a Monte Carlo result: correlations, target precisions, the pose whose errors are subtracted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

from precision_pin.base.array_checks import fix_fields
from precision_pin.draws.space import Space
from precision_pin.robot.approach import approach_entry
from precision_pin.statistics.precision import Precision


@final
@dataclass(frozen=True)
class Correlated:
    """Group of correlated parameters.

    Attributes
    ----------
    parameters
        Names of the parameters.
    scores
        Correlation matrix of their normal scores, as given, row by row.
    pearson
        Correlation matrix of the parameters themselves, which follows from `scores` and the laws.
    """

    parameters: tuple[str, ...]
    scores: tuple[tuple[float, ...], ...]
    pearson: tuple[tuple[float, ...], ...]

    @classmethod
    def all_of(cls, space: Space) -> tuple[Correlated, ...]:
        """Return every correlation of a space."""
        found = []
        for correlation in space.correlations:
            columns = [space.index[name] for name in correlation.names]
            pearson = space.pearson_within(columns)
            found.append(cls(correlation.names, correlation.matrix, tuple(map(tuple, pearson.tolist()))))
        return tuple(found)


@final
@dataclass(frozen=True)
class Until:
    """Target precision, as text, and the precision reached."""

    text: str
    precision: Precision


@final
@dataclass(frozen=True)
class RelativeTo:
    """Pose whose errors are subtracted from those of the same robots.

    Attributes
    ----------
    name, q, approach
        Its name, empty for a pose without one, each joint's value (rad, m), and ``+`` or ``-`` where an approach is given.
    """

    name: str
    q: Mapping[str, float]
    approach: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        fix_fields(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the pose as JSON has it."""
        return {"name": self.name, "q": dict(self.q), **approach_entry(self.approach)}
