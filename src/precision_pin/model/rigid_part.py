"""Rigid pieces of an arm, and which displacements move them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from precision_pin.base.arrays import Array
from precision_pin.robot.places import ORDER_FRAME
from precision_pin.terms.term import JointValue, Target


@final
@dataclass(frozen=True, eq=False)
class Part:
    """A rigid piece of the drawn arm.

    Attributes:
        name: Of its node below ``arm``.
        link: Chain link that it is on.
        frame: Its pose in the chain link's axes, ``(4, 4)``.
        rank: Position, among the URDF links of the chain link on the way from base to tip, of the one that carries it;
            ``None`` for the tip and what hangs on it.
    """

    name: str
    link: int
    frame: Array
    rank: int | None

    def targets_before(self, targets: Sequence[Target]) -> int:
        """Return how many of the targets, in chain order, move it: the first so many.

        A URDF link's own frame moves it, a custom place or the end of its chain link does not: they move what comes
        after. The tip is moved by all.
        """
        return sum(self._is_moved_by(target) for target in targets)

    def _is_moved_by(self, target: Target) -> bool:
        if self.rank is None:
            return True
        if isinstance(target, JointValue):
            return target.joint < self.link
        return (target.link, *target.order) <= (self.link, ORDER_FRAME, self.rank)
