"""Sources bound to the values of their settings: their loads and terms at postures, and the sources of a model."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, SupportsIndex, overload

import numpy as np

from precision_pin.base.arguments import check_name
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import PerJoint, Quantity
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.places import Factors, Load
from precision_pin.terms.source import Source
from precision_pin.terms.table import is_alike
from precision_pin.terms.term import DifferentFormulas, Term


class BoundSource:
    """A source with its space of values; results that do not depend on the posture are computed once."""

    def __init__(self, source: Source, view: LabelledSpace) -> None:
        self.source, self.view = source, view
        # read only once, because there may be thousands of postures
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

    def _made(self, method: str, posture: Posture) -> Iterable[Any]:
        if not self.is_same_everywhere:
            return getattr(self.source, method)(posture, self.view)
        if method not in self._results:
            self._results[method] = tuple(getattr(self.source, method)(posture, self.view))
        return self._results[method]


class LabelledSources(tuple[Source, ...]):
    """Sources in order, and by label: ``sources[0]`` and ``sources["payload"]``."""

    labels: tuple[str, ...]

    def __new__(cls, sources: Iterable[Source] = (), labels: Iterable[str] = ()) -> LabelledSources:
        """Return sources with their labels."""
        result = super().__new__(cls, sources)
        result.labels = tuple(labels)
        return result

    @overload
    def __getitem__(self, key: SupportsIndex | str, /) -> Source: ...

    @overload
    def __getitem__(self, key: slice, /) -> tuple[Source, ...]: ...

    def __getitem__(self, key: Any, /) -> Any:
        """Return a source by its number or label, or a tuple of sources.

        Raises:
            UnknownNameError: No such label.
        """
        if isinstance(key, str):
            key = self.labels.index(check_name("source", key, self.labels))
        return super().__getitem__(key)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.labels)


def load_posture(bare: Posture, sources: Iterable[BoundSource]) -> Posture:
    """Return a posture with the loads of sources and their contributions to gravity."""
    bound_sources = tuple(sources)
    loaded = bare.with_loads([load for source in bound_sources for load in source.loads(bare)])
    return loaded.with_tilts([tilt for source in bound_sources for tilt in source.gravity(bare)])


def load_postures(
    stacked: Posture, each: Sequence[Posture], sources: Sequence[BoundSource]
) -> tuple[Posture, list[Posture]] | None:
    """Return postures with the loads of sources and their contributions to gravity; None if these may differ.

    Args:
        stacked: A posture of P configurations, without the loads of sources.
        each: The P postures of one configuration.
    """
    if any(source.has_loads and not source.source.accepts_many(stacked.chain) for source in sources):
        return None
    loaded, own = load_posture(stacked, sources), len(stacked.loads)
    return loaded, [bare.with_loads(loaded.loads[own:]).with_tilts(loaded.tilts) for bare in each]


def terms_at(posture: Posture, sources: Iterable[BoundSource]) -> tuple[Term, ...]:
    """Return the terms of sources at a posture with all loads."""
    return tuple(itertools.chain.from_iterable(source.terms(posture) for source in sources))


def terms_at_many(stacked: Posture, each: Sequence[Posture], sources: Sequence[BoundSource]) -> tuple[Term, ...] | None:
    """Return the terms of sources at P configurations, their twists with a last dimension of P.

    Sources that do not accept these postures at once are evaluated one posture at a time. Returns None if targets or
    factors then change between the configurations.

    Args:
        stacked: A posture of P configurations, with all loads.
        each: The P postures of one configuration, with all loads.
    """
    terms: list[Term] = []
    for source in sources:
        if source.source.accepts_many(stacked.chain):
            with suppress(DifferentFormulas):
                terms += tuple(source.terms(each[0] if source.is_same_everywhere else stacked))
                continue
        first, *others = terms_by_pose = [tuple(source.terms(posture)) for posture in each]
        if not all(len(other) == len(first) and all(map(is_alike, first, other)) for other in others):
            return None
        twists = (np.stack([t[row].twist for t in terms_by_pose], axis=-1) for row in range(len(first)))
        terms += [replace(term, twist=twist) for term, twist in zip(first, twists, strict=True)]
    return tuple(terms)


def labels(sources: Sequence[Source]) -> tuple[str, ...]:
    """Return the label of every source."""
    # equal labels get the suffixes `#2`, `#3`, … in the order of their settings (names and directions before
    # numbers and laws), so that neither the order of the sources nor, as a rule, another tolerance changes a label
    result = [source.label() for source in sources]
    positions: dict[str, list[int]] = {}
    for k, label in enumerate(result):
        positions.setdefault(label, []).append(k)

    def rank_of(k: int) -> tuple[str, str]:
        names = {field: value for field, value in sources[k].settings().items() if isinstance(value, str)}
        return repr(names), repr(sources[k])

    for label, numbers in positions.items():
        for rank, k in enumerate(sorted(numbers, key=rank_of)[1:] if len(numbers) > 1 else (), start=2):
            result[k] = f"{label}#{rank}"
    return tuple(result)


def own_draws(sources: Sequence[Source], labels: Sequence[str]) -> list[Draw]:
    """Return the draws of all sources that are used in a model, each named after its source's label."""
    pairs = list(zip(sources, labels, strict=True))
    draws = [draw for source, label in pairs for draw in source.draws(label)]
    names = {draw.name for draw in draws}
    idle = {name for source, label in pairs for name in source.idle_draws(label, names)}
    return [draw for draw in draws if draw.name not in idle]


def draw_owners(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return for each draw the labels of the sources that use it, in source order."""
    owners, rank = number_owners(space, sources, labels), {label: k for k, label in enumerate(labels)}
    return tuple(
        tuple(sorted({label for name in draw.components for label in owners[name]}, key=rank.__getitem__))
        for draw in space.draws
    )


def number_owners(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> dict[str, list[str]]:
    """Return for each component of a space the labels of the sources that use it, in source order."""
    owners: dict[str, list[str]] = {name: [] for draw in space.draws for name in draw.components}
    for source, label in zip(sources, labels, strict=True):
        for name in source.numbers(label).keys() & owners.keys():
            owners[name].append(label)
    return owners


def draw_words(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> tuple[str, ...]:
    """Return the description of each draw, such as ``tilt of joint2 about z``; a name from the sheet comes first."""
    uses: dict[str, list[str]] = {}
    source_draws: set[str] = set()
    for source, label in zip(sources, labels, strict=True):
        for number, place in source.places(label).items():
            # an entry of a list needs no index if it has a name in the sheet
            uses.setdefault(number, []).append(
                source.describe(place if number.startswith(label) else re.sub(r"\[\d+\]$", "", place))
            )
        source_draws.update(draw.name for draw in source.draws(label))
    words = []
    for draw in space.draws:
        descriptions = list(dict.fromkeys(use for name in draw.components for use in uses.get(name, ())))
        more = f" and {len(descriptions) - 1} more" if len(descriptions) > 1 else ""
        text = f"{draw.name} ({descriptions[0]}{more})" if descriptions else draw.name
        words.append(descriptions[0] if descriptions and draw.name in source_draws else text)
    return tuple(words)


def with_quantities(space: Space, sources: Sequence[Source], labels: Sequence[str], chain: Chain) -> Space:
    """Return a space whose draws have quantities: from the first source that uses a component, else unchanged."""
    quantities: dict[str, Quantity] = {}
    for source, label in zip(sources, labels, strict=True):
        joint = source.settings().get("joint")
        is_prismatic = joint in chain.joint_names and bool(chain.prismatic[chain.joint_names.index(joint)])
        try:
            numbers = source.numbers(label)
        except InputError:
            continue  # unknown types of settings
        for name, note in numbers.items():
            if isinstance(note, PerJoint):
                note = note.prismatic if is_prismatic else note.revolute
            if note is not None:
                quantities.setdefault(name, note)
    draws = []
    for draw in space.draws:
        pairs = itertools.zip_longest(draw.components, draw.quantities)
        # an equal quantity from the sheet is kept, since it also has the unit in which it was written
        values = tuple(q if quantities.get(name) in (None, q) else quantities[name] for name, q in pairs)
        draws.append(replace(draw, quantities=values) if any(values) and values != draw.quantities else draw)
    return Space(tuple(draws), space.correlations)
