"""Which sources displace an arm otherwise at one pose than at another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.draws.expressions import Component, Expression, Operation
from precision_pin.draws.space import LabelledSpace, Scope
from precision_pin.errors import InputError
from precision_pin.model.error_model import ErrorModel, PoseModel
from precision_pin.robot.chain import Posture
from precision_pin.robot.urdf import Joint
from precision_pin.terms.source import Source
from precision_pin.terms.term import Term

__all__ = ["frozen_sources"]

Array = NDArray[np.float64]

PROBES: Final = 8
"""At how many other poses a source is looked at."""


def frozen_sources(model: ErrorModel, at: PoseModel) -> tuple[str, ...]:
    """Return the labels of the sources whose displacements hold at this pose only.

    Those that loads cause or that are drawn for each pose or visit, and those seen to change at a few other poses.
    """
    chain = model.chain
    generator = np.random.default_rng(0)
    low, high = np.array([_range(joint) for joint in chain.joints]).T
    others = [_laden(model, q) for q in generator.uniform(low, high, (PROBES, low.size))]
    scopes = {name: draw.scope for draw in model.space.draws for name in draw.components}
    found = []
    for source, label in zip(model.sources, model.labels, strict=True):
        space = LabelledSpace(model.space, label)
        here = list(source.terms(at.posture, space))
        by_loads = any(term.loaded for term in here)
        by_scope = any(
            scopes[name] is not Scope.UNIT for term in here for factor in term.factors for name in _components(factor)
        )
        if by_loads or by_scope or not all(_same(here, _terms(source, other, space)) for other in others):
            found.append(label)
    return tuple(found)


def _range(joint: Joint) -> tuple[float, float]:
    """Return between which values a joint is tried: within its limits and half a turn, or a metre."""
    most = 1.0 if joint.kind == "prismatic" else np.pi
    if joint.limit is None:
        return -most, most
    low, high = np.clip((joint.limit.lower, joint.limit.upper), -most, most)
    return (low, high) if low < high else (-most, most)


def _components(expression: Expression) -> Iterator[str]:
    if isinstance(expression, Component):
        yield expression.name
    elif isinstance(expression, Operation):
        for argument in expression.arguments:
            yield from _components(argument)


def _laden(model: ErrorModel, q: Array) -> Posture:
    """Return a posture with what the sources hang on it, as `ErrorModel.at` does before any statics."""
    bare = model.chain.at(q)
    pairs = [
        (source, LabelledSpace(model.space, label)) for source, label in zip(model.sources, model.labels, strict=True)
    ]
    loaded = bare.with_loads([load for source, space in pairs for load in source.loads(bare, space)])
    return loaded.with_tilts([tilt for source, space in pairs for tilt in source.gravity(bare, space)])


def _terms(source: Source, posture: Posture, space: LabelledSpace) -> list[Term] | None:
    """Return a source's terms, None where it has none to give at this posture."""
    try:
        return list(source.terms(posture, space))
    except InputError:
        return None


def _same(terms: Sequence[Term], others: Sequence[Term] | None) -> bool:
    return (
        others is not None
        and len(terms) == len(others)
        and all(
            one.target == other.target
            and one.factors == other.factors
            # twists are turned through the posture, which costs the last digits
            and np.allclose(one.twist, other.twist, rtol=1e-9, atol=1e-12 * float(np.abs(one.twist).max()))
            for one, other in zip(terms, others, strict=True)
        )
    )
