"""Draws in a reader's words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from precision_pin.draws.space import Draw, Space
from precision_pin.terms.source import Source

__all__ = ["draw_words"]


def draw_words(space: Space, sources: Sequence[Source], labels: Sequence[str]) -> tuple[str, ...]:
    """Return what each draw is in a reader's words, such as ``tilt of joint2 about z``.

    A draw with a name of the user's keeps it, followed by what it stands for first.
    """
    uses: dict[str, list[str]] = {}
    own: set[str] = set()
    for source, label in zip(sources, labels, strict=True):
        for number, place in source.places(label).items():
            uses.setdefault(number, []).append(source.describe(place))
        own.update(draw.name for draw in source.draws(label))
    return tuple(_in_words(draw, uses, draw.name in own) for draw in space.draws)


def _in_words(draw: Draw, uses: Mapping[str, Sequence[str]], is_unnamed: bool) -> str:
    described = list(dict.fromkeys(use for name in draw.components for use in uses.get(name, ())))
    if not described:
        return draw.name
    if is_unnamed:
        return described[0]
    more = "" if len(described) == 1 else f" and {len(described) - 1} more"
    return f"{draw.name} ({described[0]}{more})"
