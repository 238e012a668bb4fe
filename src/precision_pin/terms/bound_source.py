"""A source bound to what its settings stand for, and a posture with the loads of such sources."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar, final

from precision_pin.draws.space import LabelledSpace
from precision_pin.robot.chain import Posture
from precision_pin.robot.loads import Factors, Load
from precision_pin.terms.source import Source
from precision_pin.terms.term import Term
from precision_pin.typing import Array

__all__ = ["BoundSource", "load_posture"]

Answer = TypeVar("Answer")


@final
class BoundSource:
    """A source and what its settings stand for; what does not depend on the posture it is asked for once.

    Parameters
    ----------
    source
        The source.
    view
        The space as it sees it.
    """

    def __init__(self, source: Source, view: LabelledSpace) -> None:
        self.source, self.view = source, view
        # asked once: there are thousands of postures
        self._is_same_everywhere = source.depends_on == "chain"
        self._kept: dict[str, tuple[Any, ...]] = {}

    def loads(self, posture: Posture) -> Iterable[Load]:
        """Return its loads at a posture without those of sources."""
        return self._answer("loads", self.source.loads, posture)

    def gravity(self, posture: Posture) -> Iterable[tuple[Array, Factors]]:
        """Return what it adds to gravity at a posture without the loads of sources."""
        return self._answer("gravity", self.source.gravity, posture)

    def terms(self, posture: Posture) -> Iterable[Term]:
        """Return its terms at a posture with all loads."""
        return self._answer("terms", self.source.terms, posture)

    def _answer(
        self, name: str, method: Callable[[Posture, LabelledSpace], Iterator[Answer]], posture: Posture
    ) -> Iterable[Answer]:
        if not self._is_same_everywhere:
            return method(posture, self.view)
        if name not in self._kept:
            self._kept[name] = tuple(method(posture, self.view))
        return self._kept[name]


def load_posture(bare: Posture, sources: Iterable[BoundSource]) -> Posture:
    """Return a posture with what sources hang on it and add to gravity."""
    listed = tuple(sources)
    laden = bare.with_loads([load for source in listed for load in source.loads(bare)])
    return laden.with_tilts([tilt for source in listed for tilt in source.gravity(bare)])
