"""A source bound to the values of its settings; the loads and the terms of such sources at postures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar, final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.draws.space import LabelledSpace
from precision_pin.robot.chain import Posture
from precision_pin.robot.loads import Factors, Load
from precision_pin.terms.source import Source
from precision_pin.terms.table import is_alike
from precision_pin.terms.term import Term

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

    Attributes
    ----------
    is_same_everywhere
        True if nothing of it depends on the posture.
    """

    def __init__(self, source: Source, view: LabelledSpace) -> None:
        self.source, self.view = source, view
        # read once, because there may be thousands of postures
        self.is_same_everywhere = source.depends_on == "chain"
        self._results: dict[str, tuple[Any, ...]] = {}

    @property
    def has_loads(self) -> bool:
        """True if its class may add weights or change gravity."""
        kind = type(self.source)
        return kind.loads is not Source.loads or kind.gravity is not Source.gravity

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
        if not self.is_same_everywhere:
            return method(posture, self.view)
        if name not in self._results:
            self._results[name] = tuple(method(posture, self.view))
        return self._results[name]


def load_posture(bare: Posture, sources: Iterable[BoundSource]) -> Posture:
    """Return a posture with the loads of sources and their contributions to gravity."""
    listed = tuple(sources)
    loaded = bare.with_loads([load for source in listed for load in source.loads(bare)])
    return loaded.with_tilts([tilt for source in listed for tilt in source.gravity(bare)])


def terms_at_many(bare: Posture, each: Sequence[Posture], sources: Sequence[BoundSource]) -> tuple[Term, ...] | None:
    """Return the terms of sources at P configurations, their twists with a last dimension of P.

    Those of a source that does not accept many postures at once are made at one after another.

    Parameters
    ----------
    bare
        A posture of P configurations, without the loads of sources.
    each
        The P postures of one configuration.
    sources
        The sources.

    Returns
    -------
    tuple[Term, ...] | None
        None where targets or factors change between the configurations, or loads of sources do.
    """
    chain = bare.chain
    alone = [not source.source.accepts_many(chain) for source in sources]
    if any(lonely and source.has_loads for lonely, source in zip(alone, sources, strict=True)):
        return None
    together = load_posture(bare, sources)
    loaded: list[Posture] = []
    terms: list[Term] = []
    for source, lonely in zip(sources, alone, strict=True):
        if not lonely:
            terms += source.terms(each[0] if source.is_same_everywhere else together)
            continue
        loaded = loaded or [load_posture(posture, sources) for posture in each]
        stacked = _stack([tuple(source.terms(posture)) for posture in loaded])
        if stacked is None:
            return None
        terms += stacked
    return tuple(terms)


def _stack(made: Sequence[tuple[Term, ...]]) -> list[Term] | None:
    """Return the terms of one source made at P postures as terms with P twists; None where they are not alike."""
    first = made[0]
    if not all(len(terms) == len(first) and all(map(is_alike, first, terms)) for terms in made[1:]):
        return None
    return [
        replace(term, twist=np.stack([terms[row].twist for terms in made], axis=-1)) for row, term in enumerate(first)
    ]
