"""Sources bound to the values of their settings: their loads and terms at postures, and the sources of a model."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar, final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import PerJoint, Quantity
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.loads import Factors, Load
from precision_pin.terms.source import Source
from precision_pin.terms.table import is_alike
from precision_pin.terms.term import Term

Item = TypeVar("Item")


@final
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
        return self._call("loads", self.source.loads, posture)

    def gravity(self, posture: Posture) -> Iterable[tuple[Array, Factors]]:
        """Return the source's contributions to gravity, at a posture without the loads of sources."""
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

    Sources that do not accept many postures at once are evaluated one posture at a time. Returns None where targets,
    factors or loads of sources change between the configurations.

    Args:
        bare: A posture of P configurations, without the loads of sources.
        each: The P postures of one configuration.
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
    """Return the terms of one source at P postures as terms with P twists; None if targets or factors differ."""
    first = made[0]
    if not all(len(terms) == len(first) and all(map(is_alike, first, terms)) for terms in made[1:]):
        return None
    return [
        replace(term, twist=np.stack([terms[row].twist for terms in made], axis=-1)) for row, term in enumerate(first)
    ]


def labels(sources: Sequence[Source]) -> tuple[str, ...]:
    """Return every source's label."""
    # equal labels get the suffixes `#2`, `#3`, … in the order of their settings (names and directions before
    # numbers and laws), so that neither the order of the sources nor, as a rule, another tolerance changes a label
    result = [source.label() for source in sources]
    alike: dict[str, list[int]] = {}
    for k, label in enumerate(result):
        alike.setdefault(label, []).append(k)
    for label, numbers in alike.items():
        if len(numbers) > 1:
            numbers.sort(key=lambda k: _rank(sources[k]))
        for rank, k in enumerate(numbers[1:], start=2):
            result[k] = f"{label}#{rank}"
    return tuple(result)


def _rank(source: Source) -> tuple[str, str]:
    names = {field: value for field, value in source.settings().items() if isinstance(value, str)}
    return repr(names), repr(source)


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
    return tuple(_describe_draw(draw, uses, draw.name in own) for draw in space.draws)


def _describe_draw(draw: Draw, uses: Mapping[str, Sequence[str]], is_unnamed: bool) -> str:
    described = list(dict.fromkeys(use for name in draw.components for use in uses.get(name, ())))
    if not described:
        return draw.name
    if is_unnamed:
        return described[0]
    more = "" if len(described) == 1 else f" and {len(described) - 1} more"
    return f"{draw.name} ({described[0]}{more})"


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
            if note is not None:
                known.setdefault(name, _at_joint(note, is_prismatic))
    return Space(tuple(_set_quantities(draw, known) for draw in space.draws), space.correlations)


def _set_quantities(draw: Draw, known: Mapping[str, Quantity]) -> Draw:
    own = itertools.zip_longest(draw.components, draw.quantities)
    # an equal quantity from the sheet is kept, since it also has the unit in which it was written
    found = tuple(said if known.get(name) in (None, said) else known[name] for name, said in own)
    return dataclasses.replace(draw, quantities=found) if any(found) and found != draw.quantities else draw


def _at_joint(note: Quantity | PerJoint, is_prismatic: bool) -> Quantity:
    if isinstance(note, PerJoint):
        return note.prismatic if is_prismatic else note.revolute
    return note
