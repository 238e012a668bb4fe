"""Statics on the deflected arm: loads re-evaluated where the arm comes to rest.

``v = G(v)`` with v the displacements of all targets at the parameters' means and G what the terms say when the loads
hang on the arm displaced by v. The settled v* becomes constant terms; its derivative to the parameters of the loaded
terms, ``(I - ∂G/∂v)⁻¹ ∂G/∂x``, becomes first-order terms. Products of load and stiffness errors are left out: they are
of second order in the tolerances.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin import se3
from precision_pin.chain import Place, Posture
from precision_pin.errors import InputError, InternalError
from precision_pin.parameters import Component
from precision_pin.space import Space
from precision_pin.table import TermTable
from precision_pin.terms import JointValue, Target, Term

__all__ = ["Settled", "settle"]

Array = NDArray[np.float64]
MakeTerms = Callable[[Posture], Sequence[Term]]
"""What the sources say at a posture."""

MOST_ROUNDS: Final = 100
SETTLED: Final = 1e-13
"""Change of the displacements (m, rad) below which the arm is at rest."""
STEP: Final = 1e-7
"""Step (m, rad) of the differences of G: the smaller its curvature's error, the larger that of rounding, both 1e-9."""


@final
@dataclass(frozen=True, eq=False)
class Settled:
    """The arm at rest under its loads, every parameter at its mean.

    Attributes
    ----------
    posture
        The posture with its loads on the deflected arm.
    terms
        The terms there.
    table
        Their table.
    displacements
        v*, of the table's targets, ``(K, 6)``.
    """

    posture: Posture
    terms: tuple[Term, ...]
    table: TermTable
    displacements: Array

    def linearised(self, space: Space, make_terms: MakeTerms) -> tuple[Term, ...]:
        """Return the terms with those that loads cause replaced by v* and its first-order dependence on parameters.

        Raises
        ------
        InputError
            The arm buckles: a push would move it on.
        """
        loaded = TermTable.build(self.posture, space, [term for term in self.terms if term.loaded])
        if not loaded.targets:
            return self.terms
        values = _at_means(loaded, space)
        rows = [self.table.targets.index(target) for target in loaded.targets]
        ways = _ways(loaded.targets, self.posture)

        def reaction(step: Array) -> Array:
            moved = self.displacements.copy()
            moved[rows] += step
            posture = replace(self.posture, deflection=deflected(self.posture, self.table, moved))
            table = TermTable.build(posture, space, [term for term in make_terms(posture) if term.loaded])
            if table.targets != loaded.targets:
                raise InternalError("a source's terms come and go with the deflection of the arm")
            return _at_means(table, space)

        # from v* itself: the loads of ``values`` hang on the arm of the round before
        settled = reaction(np.zeros_like(values))
        changes = np.array([reaction(STEP * way) - settled for way in ways]) / STEP
        feedback = np.einsum("mki,nki->mn", ways, changes)
        if np.linalg.eigvals(feedback).real.max() >= 1.0:
            raise InputError(
                "the arm buckles under its loads: it has no stable rest, so equilibrium statics has no answer"
            )
        direct = np.einsum("mki,kid->md", ways, loaded.displacement_slopes(space.mean))
        response = np.einsum("mki,md->kid", ways, np.linalg.solve(np.eye(len(ways)) - feedback, direct))
        kept = [term for term in self.terms if not term.loaded]
        for target, value, slopes in zip(loaded.targets, values, response, strict=True):
            kept.append(_term(target, value - slopes @ space.mean, self.posture))
            for name, slope in zip(space.components, slopes.T, strict=True):
                if np.any(slope):
                    kept.append(_term(target, slope, self.posture, Component(name)))
        return tuple(kept)


def settle(posture: Posture, space: Space, make_terms: MakeTerms, within: float = SETTLED) -> Settled:
    """Return the arm at rest under its loads, every parameter at its mean.

    Parameters
    ----------
    posture
        The undisplaced chain, with all loads.
    space
        All draws.
    make_terms
        What the sources say at a posture.
    within
        Change of the displacements (m, rad) from one round to the next that is small enough.

    Raises
    ------
    InputError
        The arm does not come to rest: it is too soft for superposition on the deflected arm.
    """
    current = posture
    previous = np.zeros((0, 6))
    for _ in range(MOST_ROUNDS):
        terms = tuple(make_terms(current))
        table = TermTable.build(current, space, terms)
        displacements = _at_means(table, space)
        if np.abs(displacements).max(initial=0.0) >= 1.0:
            break
        same = previous.shape == displacements.shape
        if same and np.abs(displacements - previous).max(initial=0.0) < within:
            return Settled(current, terms, table, displacements)
        previous = displacements
        current = replace(posture, deflection=deflected(posture, table, displacements))
    raise InputError("the arm does not come to rest under its loads: it is too soft for equilibrium statics")


def deflected(posture: Posture, table: TermTable, displacements: Array) -> Array:
    """Return chain links and their far ends with every target displaced, ``(2, n+1, 4, 4)``."""
    poses, ends = posture.link_poses.copy(), posture.link_poses @ posture.chain.placements
    moves = np.moveaxis(se3.displacement(displacements.T), -1, 0)
    back = np.moveaxis(se3.inverse(np.moveaxis(table.frames, 0, -1)), -1, 0)
    moved = list(zip(table.targets, table.frames @ moves @ back, strict=True))
    motion = np.eye(4)
    for link in range(len(poses)):
        inside: list[tuple[Place, Array]] = []
        for target, move in moved:
            if isinstance(target, Place):
                inside += [(target, move)] if target.link == link else []
            elif target.joint == link - 1:
                motion = motion @ move
        poses[link] = motion @ poses[link]
        for place, move in inside:
            if not place.is_seat:
                motion = motion @ move
        ends[link] = motion @ ends[link]
        for place, move in inside:
            if place.is_seat:
                motion = motion @ move
    return np.array([poses, ends])


def _at_means(table: TermTable, space: Space) -> Array:
    """Return the targets' displacements ``(K, 6)`` with every parameter at its mean."""
    return table.displacements(table.products(table.program.evaluate(space.mean[:, None])))[:, :, 0]


def _ways(targets: Sequence[Target], posture: Posture) -> Array:
    """Return the ways in which targets can move, ``(M, K, 6)``: one for a joint value, six for a place."""
    ways = []
    for k, target in enumerate(targets):
        own = np.eye(6)
        if isinstance(target, JointValue):
            axis = posture.chain.axes[target.joint]
            own = np.concatenate([axis, np.zeros(3)] if posture.chain.prismatic[target.joint] else [np.zeros(3), axis])[
                None
            ]
        for way in own:
            ways.append(np.zeros((len(targets), 6)))
            ways[-1][k] = way
    return np.array(ways)


def _term(target: Target, displacement: Array, posture: Posture, *factors: Component) -> Term:
    if isinstance(target, Place):
        return Term.of(target, displacement, *factors, loaded=True)
    rows = slice(0, 3) if posture.chain.prismatic[target.joint] else slice(3, 6)
    return Term.of(target, posture.chain.axes[target.joint] @ displacement[rows], *factors, loaded=True)
