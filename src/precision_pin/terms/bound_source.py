"""A source bound to the values of its settings, and a posture with the loads of such sources."""

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

Item = TypeVar("Item")


@final
class BoundSource:
    """A source with the values of its settings; results that do not depend on the posture are computed once.

    Parameters
    ----------
    source
        The source.
    view
        The space of the source.
    """

    def __init__(self, source: Source, view: LabelledSpace) -> None:
        self.source, self.view = source, view
        # read once, because there may be thousands of postures
        self._is_same_everywhere = source.depends_on == "chain"
        self._results: dict[str, tuple[Any, ...]] = {}

    def loads(self, posture: Posture) -> Iterable[Load]:
        """Return the loads of the source, at a posture without the loads of sources."""
        return self._call("loads", self.source.loads, posture)

    def gravity(self, posture: Posture) -> Iterable[tuple[Array, Factors]]:
        """Return the contributions of the source to gravity, at a posture without the loads of sources."""
        return self._call("gravity", self.source.gravity, posture)

    def terms(self, posture: Posture) -> Iterable[Term]:
        """Return the terms of the source, at a posture with all loads."""
        return self._call("terms", self.source.terms, posture)

    def _call(
        self, name: str, method: Callable[[Posture, LabelledSpace], Iterator[Item]], posture: Posture
    ) -> Iterable[Item]:
        if not self._is_same_everywhere:
            return method(posture, self.view)
        if name not in self._results:
            self._results[name] = tuple(method(posture, self.view))
        return self._results[name]


def load_posture(bare: Posture, sources: Iterable[BoundSource]) -> Posture:
    """Return a posture with the loads of sources and their contributions to gravity."""
    listed = tuple(sources)
    loaded = bare.with_loads([load for source in listed for load in source.loads(bare)])
    return loaded.with_tilts([tilt for source in listed for tilt in source.gravity(bare)])
