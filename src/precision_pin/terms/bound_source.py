"""Sources bound to the values of their settings: their loads and terms at postures, and the sources of a model."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import PerJoint, Quantity
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.places import Factors, Load
from precision_pin.terms.source import Source
from precision_pin.terms.table import is_alike
from precision_pin.terms.term import Term


class BoundSource:
    """A source with its space of values; results that do not depend on the posture are computed once."""

    def __init__(self, source: Source, view: LabelledSpace) -> None:
        self.source, self.view = source, view
        # read once, because there may be thousands of postures
        self.is_same_everywhere = source.depends_on == "chain"
        self._results: dict[str, tuple[Any, ...]] = {}

    @property
    def has_loads(self) -> bool:
        """Whether its class may add weights or change gravity."""
        kind = type(self.source)
        return kind.loads is not Source.loads or kind.gravity is not Source.gravity

    def loads(self, posture: Posture) -> Iterable[Load]:
        """Return the loads of the source, at a posture without the loads of sources."""
        return self._made("loads", posture)

    def gravity(self, posture: Posture) -> Iterable[tuple[Array, Factors]]:
        """Return the source's contributions to gravity, at a posture without the loads of sources."""
        return self._made("gravity", posture)

    def terms(self, posture: Posture) -> Iterable[Term]:
        """Return the terms of the source, at a posture with all loads."""
        return self._made("terms", posture)

    def _made(self, what: str, posture: Posture) -> Iterable[Any]:
        if not self.is_same_everywhere:
            return getattr(self.source, what)(posture, self.view)
        if what not in self._results:
            self._results[what] = tuple(getattr(self.source, what)(posture, self.view))
        return self._results[what]


def load_posture(bare: Posture, sources: Iterable[BoundSource]) -> Posture:
    """Return a posture with the loads of sources and their contributions to gravity."""
    listed = tuple(sources)
    loaded = bare.with_loads([load for source in listed for load in source.loads(bare)])
    return loaded.with_tilts([tilt for source in listed for tilt in source.gravity(bare)])


def terms_at_many(bare: Posture, each: Sequence[Posture], sources: Sequence[BoundSource]) -> tuple[Term, ...] | None:
    """Return the terms of sources at P configurations, their twists with a last dimension of P.

    Sources that do not accept many postures at once are evaluated one posture at a time. Returns None where targets,
    factors or loads of sources change between the configurations.

    Args:
        bare: A posture of P configurations, without the loads of sources.
        each: The P postures of one configuration.
    """
    alone = [not source.source.accepts_many(bare.chain) for source in sources]
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
        first, *others = made = [tuple(source.terms(posture)) for posture in loaded]
        if not all(len(other) == len(first) and all(map(is_alike, first, other)) for other in others):
            return None
        twists = (np.stack([one[row].twist for one in made], axis=-1) for row in range(len(first)))
        terms += [replace(term, twist=twist) for term, twist in zip(first, twists, strict=True)]
    return tuple(terms)


def labels(sources: Sequence[Source]) -> tuple[str, ...]:
    """Return every source's label."""
    # equal labels get the suffixes `#2`, `#3`, … in the order of their settings (names and directions before
    # numbers and laws), so that neither the order of the sources nor, as a rule, another tolerance changes a label
    result = [source.label() for source in sources]
    alike: dict[str, list[int]] = {}
    for k, label in enumerate(result):
        alike.setdefault(label, []).append(k)

    def rank_of(k: int) -> tuple[str, str]:
        names = {field: value for field, value in sources[k].settings().items() if isinstance(value, str)}
        return repr(names), repr(sources[k])

    for label, numbers in alike.items():
        for rank, k in enumerate(sorted(numbers, key=rank_of)[1:] if len(numbers) > 1 else (), start=2):
            result[k] = f"{label}#{rank}"
    return tuple(result)


def own_draws(sources: Sequence[Source], labels: Sequence[str]) -> list[Draw]:
    """Return the draws of all sources, each named after its source's label."""
    return [draw for source, label in zip(sources, labels, strict=True) for draw in source.draws(label)]


def draw_owners(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return for each draw the labels of the sources that use it, in source order."""
    found, rank = number_owners(space, sources, labels), {label: k for k, label in enumerate(labels)}
    return tuple(
        tuple(sorted({label for name in draw.components for label in found[name]}, key=rank.__getitem__))
        for draw in space.draws
    )


def number_owners(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> dict[str, list[str]]:
    """Return for each number of a space the labels of the sources that use it, in source order."""
    found: dict[str, list[str]] = {name: [] for draw in space.draws for name in draw.components}
    for source, label in zip(sources, labels, strict=True):
        for name in source.numbers(label).keys() & found.keys():
            found[name].append(label)
    return found


def draw_words(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> tuple[str, ...]:
    """Return each draw in words, such as ``tilt of joint2 about z``; a name given by the user comes first."""
    uses: dict[str, list[str]] = {}
    own: set[str] = set()
    for source, label in zip(sources, labels, strict=True):
        for number, place in source.places(label).items():
            # one of several values needs no index if it has its own name
            uses.setdefault(number, []).append(
                source.describe(place if number.startswith(label) else re.sub(r"\[\d+\]$", "", place))
            )
        own.update(draw.name for draw in source.draws(label))
    words = []
    for draw in space.draws:
        described = list(dict.fromkeys(use for name in draw.components for use in uses.get(name, ())))
        more = f" and {len(described) - 1} more" if len(described) > 1 else ""
        named = f"{draw.name} ({described[0]}{more})" if described else draw.name
        words.append(described[0] if described and draw.name in own else named)
    return tuple(words)


def with_quantities(space: Space, sources: Sequence[Source], labels: Sequence[str], chain: Chain) -> Space:
    """Return a space whose draws have quantities: from the first source that uses a number, else unchanged."""
    known: dict[str, Quantity] = {}
    for source, label in zip(sources, labels, strict=True):
        joint = source.settings().get("joint")
        is_prismatic = joint in chain.joint_names and bool(chain.prismatic[chain.joint_names.index(joint)])
        try:
            numbers = source.numbers(label)
        except InputError:
            continue  # the types of its settings cannot be found
        for name, note in numbers.items():
            if isinstance(note, PerJoint):
                note = note.prismatic if is_prismatic else note.revolute
            if note is not None:
                known.setdefault(name, note)
    draws = []
    for draw in space.draws:
        own = itertools.zip_longest(draw.components, draw.quantities)
        # an equal quantity from the sheet is kept, since it also has the unit in which it was written
        found = tuple(said if known.get(name) in (None, said) else known[name] for name, said in own)
        draws.append(replace(draw, quantities=found) if any(found) and found != draw.quantities else draw)
    return Space(tuple(draws), space.correlations)
