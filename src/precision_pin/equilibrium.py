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
from precision_pin.errors import InputError
from precision_pin.parameters import Component
from precision_pin.space import Space
from precision_pin.table import TermTable
from precision_pin.terms import Target, Term

__all__ = ["Settled", "settle"]

Array = NDArray[np.float64]
MakeTerms = Callable[[Posture], Sequence[Term]]
"""What the sources say at a posture."""

MOST_ROUNDS: Final = 100
SETTLED: Final = 1e-13
"""Change of the displacements (m, rad) below which the arm is at rest."""
STEP: Final = 1e-6
"""Step (m, rad) of the central differences of G."""


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
    displacements
        v*, by target.
    """

    posture: Posture
    terms: tuple[Term, ...]
    displacements: dict[Target, Array]

    def linearised(self, space: Space, make_terms: MakeTerms) -> tuple[Term, ...]:
        """Return the terms with those that loads cause replaced by v* and its first-order dependence on parameters."""
        table = TermTable.build(self.posture, space, self.terms)
        loaded = TermTable.build(self.posture, space, [term for term in self.terms if term.loaded])
        if not loaded.targets:
            return self.terms
        rows = [table.targets.index(target) for target in loaded.targets]
        size = len(table.targets) * 6
        feedback = np.zeros((size, size))
        direct = np.zeros((size, space.size))
        slopes = loaded.displacement_slopes(space.mean)
        for row, slope in zip(rows, slopes, strict=True):
            direct[6 * row : 6 * row + 6] = slope
        settled = np.array([self.displacements[target] for target in table.targets])
        for column in range(size):
            step = np.zeros_like(settled)
            step.flat[column] = STEP
            ahead, behind = (
                _loaded_displacements(self.posture, table, settled + sign * step, space, make_terms) for sign in (1, -1)
            )
            feedback[:, column] = (ahead - behind).reshape(-1) / (2 * STEP)
        response = np.linalg.solve(np.eye(size) - feedback, direct).reshape(len(table.targets), 6, space.size)
        values = loaded.displacements(loaded.products(loaded.program.evaluate(space.mean[:, None])))[:, :, 0]
        kept = [term for term in self.terms if not term.loaded]
        for target, row, value in zip(loaded.targets, rows, values, strict=True):
            constant = value - response[row] @ space.mean
            kept.append(_term(target, constant, self.posture))
            for name, slope in zip(space.components, response[row].T, strict=True):
                if np.any(slope):
                    kept.append(_term(target, slope, self.posture, Component(name)))
        return tuple(kept)


def settle(posture: Posture, space: Space, make_terms: MakeTerms) -> Settled:
    """Return the arm at rest under its loads, every parameter at its mean.

    Parameters
    ----------
    posture
        The undisplaced chain, with all loads.
    space
        All draws.
    make_terms
        What the sources say at a posture.

    Raises
    ------
    InputError
        The arm does not come to rest: it is too soft for superposition on the deflected arm.
    """
    current = posture
    previous: Array | None = None
    for _ in range(MOST_ROUNDS):
        terms = tuple(make_terms(current))
        table = TermTable.build(current, space, terms)
        displacements = table.displacements(table.products(table.program.evaluate(space.mean[:, None])))[:, :, 0]
        if np.abs(displacements).max(initial=0.0) >= 1.0:
            break
        if previous is not None and np.abs(displacements - previous).max(initial=0.0) < SETTLED:
            return Settled(current, terms, dict(zip(table.targets, displacements, strict=True)))
        previous = displacements
        current = replace(posture, deflection=deflected(posture, table, displacements))
    raise InputError("the arm does not come to rest under its loads: it is too soft for equilibrium statics")


def deflected(posture: Posture, table: TermTable, displacements: Array) -> Array:
    """Return chain links and their far ends with every target displaced, ``(2, n+1, 4, 4)``."""
    poses, ends = posture.link_poses.copy(), posture.link_poses @ posture.chain.placements
    moved = [
        (target, frame @ se3.displacement(displacement) @ se3.inverse(frame))
        for target, frame, displacement in zip(table.targets, table.frames, displacements, strict=True)
    ]
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


def _loaded_displacements(
    posture: Posture, table: TermTable, displacements: Array, space: Space, make_terms: MakeTerms
) -> Array:
    """Return G's loaded part ``(K, 6)`` at the means, with the loads on the arm displaced by ``(K, 6)``."""
    moved = replace(posture, deflection=deflected(posture, table, displacements))
    loaded = TermTable.build(moved, space, [term for term in make_terms(moved) if term.loaded])
    values = loaded.displacements(loaded.products(loaded.program.evaluate(space.mean[:, None])))[:, :, 0]
    result = np.zeros_like(displacements)
    for target, value in zip(loaded.targets, values, strict=True):
        result[table.targets.index(target)] = value
    return result


def _term(target: Target, displacement: Array, posture: Posture, *factors: Component) -> Term:
    if isinstance(target, Place):
        return Term.of(target, displacement, *factors, loaded=True)
    rows = slice(0, 3) if posture.chain.prismatic[target.joint] else slice(3, 6)
    return Term.of(target, posture.chain.axes[target.joint] @ displacement[rows], *factors, loaded=True)
