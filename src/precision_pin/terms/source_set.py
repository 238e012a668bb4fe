"""The sources of a model together: their labels and draws, the owners of each draw, and draws in words."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence

from precision_pin.base.errors import InputError
from precision_pin.base.units import PerJoint, Quantity
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.robot.chain import Chain
from precision_pin.terms.source import Source


def labels(sources: Sequence[Source]) -> tuple[str, ...]:
    """Return every source's label.

    Sources with the same label get the suffixes ``#2``, ``#3``, … in the order of their settings (names and directions before
    numbers and laws), so that neither the order of the sources nor, as a rule, another tolerance changes a label.
    """
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
    """Return for each draw the labels of the sources that use it, in the order of the sources."""
    found, rank = number_owners(space, sources, labels), {label: k for k, label in enumerate(labels)}
    return tuple(
        tuple(sorted({label for name in draw.components for label in found[name]}, key=rank.__getitem__))
        for draw in space.draws
    )


def number_owners(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> dict[str, list[str]]:
    """Return for each number of a space the labels of the sources that use it, in the order of the sources."""
    found: dict[str, list[str]] = {name: [] for draw in space.draws for name in draw.components}
    for source, label in zip(sources, labels, strict=True):
        for name in source.numbers(label).keys() & found.keys():
            found[name].append(label)
    return found


def draw_words(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> tuple[str, ...]:
    """Return each draw in words, such as ``tilt of joint2 about z``.

    A draw that the user named keeps its name, followed by its first use in words.
    """
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
    """Return a space whose draws have quantities: from the first source that uses a number, else those they had."""
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
