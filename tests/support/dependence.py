"""Whether a source depends on no more of a posture than it says."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from precision_pin.base import se3
from precision_pin.draws.expressions import Expression
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.places import Deflection, Load, Place
from precision_pin.terms.source import Source
from precision_pin.terms.term import Term

POSES = 6
LOADINGS = 3


def hidden_dependence(source: Source, chain: Chain, space: Space | None = None, seed: int = 0) -> str | None:
    """Return in which way a source depends on more than it says at random configurations and loads; None for none."""
    label, is_alike = source.label(), source.is_alike_everywhere(chain)
    if source.depends_on == "loads" and not is_alike:
        return None
    view = LabelledSpace((space or Space()).including(source.draws(label)), label)
    generator = np.random.default_rng(seed)
    spans = np.where(chain.prismatic, 0.4, 3.0)
    bare = [chain.at(generator.uniform(-spans, spans)) for _ in range(POSES)]
    said = [_all_said(source, posture, _loadings(posture, source, view, generator), view) for posture in bare]
    every = [terms for by_loading, _ in said for terms in by_loading]
    if is_alike and not all(_agree(every[0], terms, 1e-9) for terms in every):
        return "its terms are not alike everywhere"
    if source.depends_on == "loads":
        return None
    if not all(_agree(by_loading[0], terms, 0.0) for by_loading, _ in said for terms in by_loading):
        return "its terms depend on the loads"
    if source.depends_on == "configuration":
        return None
    if not all(_agree(every[0], terms, 0.0) for terms in every):
        return "its terms depend on the configuration"
    if not all(_numbers(said[0][1]) == _numbers(hung) for _, hung in said):
        return "what it hangs on the chain depends on the configuration"
    return None


def _all_said(source: Source, bare: Posture, loadings: Sequence[Posture], view: LabelledSpace):
    terms = [tuple(source.terms(posture, view)) for posture in loadings]
    return terms, (tuple(source.loads(bare, view)), tuple(source.gravity(bare, view)))


def _loadings(
    posture: Posture, source: Source, view: LabelledSpace, generator: np.random.Generator
) -> Iterator[Posture]:
    """Yield a posture with its own loads only, then with weights, another gravity and deflections, all random."""
    laden = posture.with_loads(list(source.loads(posture, view))).with_tilts(list(source.gravity(posture, view)))
    yield laden
    links = len(posture.link_poses)
    for _ in range(LOADINGS):
        weights = [
            Load(link, se3.displacement(generator.normal(size=6)), generator.normal(size=3) / 3, along=False,
                 moments=((generator.normal(size=4), ()),))
            for link in range(links)
        ]  # fmt: skip
        loaded = laden.with_loads(weights).with_tilts([(generator.normal(size=3), ())])
        yield loaded
        bending = generator.normal(size=(links, 2, 6)) / 30
        moved = np.array([se3.displacement(row) for row in generator.normal(size=(links, 6)) / 30])
        ends = moved @ posture.link_poses @ posture.chain.placements
        yield replace(loaded, deflection=Deflection(moved @ posture.link_poses, ends, bending))


def _agree(terms: Sequence[Term], others: Sequence[Term], tolerance: float) -> bool:
    return len(terms) == len(others) and all(
        (one.target.is_same(other.target) if isinstance(one.target, Place) else one.target == other.target)
        and one.factors == other.factors
        and one.loaded == other.loaded
        and (abs(one.twist - other.twist) <= tolerance * (abs(other.twist) + 1e-3 * abs(one.twist).max())).all()
        for one, other in zip(terms, others, strict=True)
    )


def _numbers(part: object) -> object:
    """Return loads and tilts as plain nested tuples."""
    if isinstance(part, Load):
        return _numbers((part.link, part.frame, part.attachment, part.along, part.moments, part.stretch))
    if isinstance(part, np.ndarray):
        return tuple(part.ravel().tolist())
    return tuple(map(_numbers, part)) if isinstance(part, tuple) and not isinstance(part, Expression) else part
