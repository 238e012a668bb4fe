"""The term table, the input of every engine and analysis."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arrays import Array, Fixed, returns_read_only
from precision_pin.base.errors import InputError, InternalError
from precision_pin.draws.expressions import Expression, Program
from precision_pin.draws.space import Space
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.places import Place
from precision_pin.terms.term import MOST_FACTORS, JointValue, Target, Term


@dataclass(frozen=True, eq=False)
class TermTable(Fixed):
    """Displacements of targets as products of parameters.

    Joint values are targets too: the pivot is the joint's frame after its motion, the twist is along the axis.

    Attributes:
        pose: Nominal tip in the base, ``(4, 4)``.
        targets: K targets in chain order.
        frames: Pose of every target in the base, ``(K, 4, 4)``.
        program: Program that computes the P parameters from the d components.
        target: Target of each of the T terms, ``(T,)``.
        twists: ``[d; δ]`` in the target's axes, ``(T, 6)``.
        factors: Up to three parameters that multiply the twist, ``(T, 3)``, -1 for none.
    """

    pose: Array
    targets: tuple[Target, ...]
    frames: Array
    program: Program
    target: NDArray[np.intp]
    twists: Array
    factors: NDArray[np.intp]

    @classmethod
    def build(cls, posture: Posture, space: Space, terms: Iterable[Term]) -> TermTable:
        """Return the table of terms at a posture, in chain order."""
        term_tuple = tuple(terms)
        return TableLayout.of(term_tuple, space).at(posture, term_tuple)

    @cached_property
    @returns_read_only
    def inverse_frames(self) -> Array:
        """Inverses of the frames, ``(K, 4, 4)``."""
        return np.array([se3.inverse(frame) for frame in self.frames]).reshape(-1, 4, 4)

    @cached_property
    @returns_read_only
    def sensitivities(self) -> Array:
        """Derivative ``(K, 6, 6)`` of the tip's error by each target's displacement, for the undisplaced chain."""
        result = np.zeros((len(self.targets), 6, 6))
        for k, frame in enumerate(self.frames):
            rotation = frame[:3, :3]
            result[k, :3, :3] = result[k, 3:, 3:] = rotation
            result[k, :3, 3:] = se3.skew(frame[:3, 3] - self.pose[:3, 3]) @ rotation
        return result

    def products(self, parameters: Array) -> Array:
        """Return the product of factors of each term, ``(T, N)``, for parameters ``(P, N)``."""
        # index -1, for no factor, reads the appended 1
        padded = np.concatenate([parameters, np.ones((1, parameters.shape[1]))])
        return np.prod(padded[self.factors], axis=1)

    def displacements(self, products: Array) -> Array:
        """Return every target's displacement, ``(K, 6, N)``, for products ``(T, N)``."""
        result = np.zeros((len(self.targets), 6, products.shape[1]))
        for k, twist, product in zip(self.target, self.twists, products, strict=True):
            result[k] += twist[:, None] * product
        return result

    def product_slopes(self, mean: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
        """Return the derivatives of the terms' products at ``(d,)`` values, as terms, components and derivatives."""
        gradient = self.program.gradient(mean)
        padded = np.append(self.program.evaluate(mean[:, None])[:, 0], 1.0)
        sizes = np.array([*map(len, gradient), 0], dtype=np.intp)
        begins = np.cumsum(sizes) - sizes
        components = np.array([k for slopes in gradient for k in slopes], dtype=np.intp)
        derivatives = np.array([slope for slopes in gradient for slope in slopes.values()])
        # an entry for every component of every factor, each times the other two factors
        others = np.stack(
            [padded[self.factors[:, k - 2]] * padded[self.factors[:, k - 1]] for k in range(MOST_FACTORS)], axis=1
        )
        counts = sizes[self.factors].ravel()
        entry = np.repeat(np.arange(counts.size), counts)
        slots = begins[self.factors].ravel()[entry] + np.arange(entry.size) - (np.cumsum(counts) - counts)[entry]
        rows, columns, slopes = _sum_entries(
            entry // MOST_FACTORS, components[slots], (derivatives[slots] * others.ravel()[entry])[None], mean.size
        )
        return rows, columns, slopes[0]

    def displacement_slopes(self, mean: Array) -> tuple[SlopeColumns, ...]:
        """Return the derivatives of each target's displacement by the components, at ``(d,)`` values."""
        terms, component, slopes = self.product_slopes(mean)
        targets, component, slopes = _sum_entries(
            self.target[terms], component, self.twists[terms].T * slopes, mean.size
        )
        ends = np.searchsorted(targets, np.arange(len(self.targets) + 1))
        return tuple(SlopeColumns(component[a:b], slopes[:, a:b]) for a, b in itertools.pairwise(ends.tolist()))


@dataclass(frozen=True, eq=False)
class SlopeColumns(Fixed):
    """Derivatives ``(6, m)`` by the components in columns ``(m,)``; all others are zero."""

    columns: NDArray[np.intp]
    slopes: Array


def _sum_entries(
    rows: NDArray[np.intp], columns: NDArray[np.intp], values: Array, width: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return the entries of a matrix sorted by row and column; values ``(n, E)`` of equal place are added in order."""
    keys, number = np.unique(rows * width + columns, return_inverse=True)
    sums = np.array([np.bincount(number, weights=value, minlength=keys.size) for value in values])
    return keys // max(width, 1), keys % max(width, 1), sums


@dataclass(frozen=True, eq=False)
class TableLayout(Fixed):
    """Common part of the tables of a model at different poses: all but twists and frames.

    The tables share its arrays; the sampler recognises the layout by them.

    Attributes:
        targets, program, target, factors: As in :class:`TermTable`.
        links, places: ``(K,)`` chain link of each target, and ``(K, 4, 4)`` the target's pose in its axes.
    """

    terms: tuple[Term, ...]
    targets: tuple[Target, ...]
    program: Program
    target: NDArray[np.intp]
    factors: NDArray[np.intp]
    links: NDArray[np.intp]
    places: Array

    @classmethod
    def of(cls, terms: tuple[Term, ...], space: Space) -> TableLayout:
        """Return the layout of terms."""
        by_key: dict[_Order, Target] = {}
        keys = [_chain_order(term.target) for term in terms]
        for key, term in zip(keys, terms, strict=True):
            first_target = by_key.setdefault(key, term.target)
            if not _is_same(first_target, term.target):
                raise InternalError(f"two different places at one point of the chain: {first_target}, {term.target}")
        order = sorted(by_key)
        numbers = {key: k for k, key in enumerate(order)}
        targets = tuple(by_key[key] for key in order)
        parameters: dict[Expression, int] = {}
        factors = np.full((len(terms), MOST_FACTORS), -1, dtype=np.intp)
        for row, term in enumerate(terms):
            for column, factor in enumerate(term.factors):
                factors[row, column] = parameters.setdefault(factor, len(parameters))
        return cls(
            terms=terms,
            targets=targets,
            program=Program.compile(list(parameters), space.index),
            target=np.array([numbers[key] for key in keys], dtype=np.intp),
            factors=factors,
            links=np.array([key[0] for key in order], dtype=np.intp),
            places=np.array([getattr(target, "frame", np.eye(4)) for target in targets]).reshape(-1, 4, 4),
        )

    def fits(self, terms: tuple[Term, ...]) -> bool:
        """Return whether terms have these targets and factors, in this order."""
        return len(terms) == len(self.terms) and all(map(is_alike, self.terms, terms))

    def twists_at_many(self, chain: Chain, terms: tuple[Term, ...], poses: int) -> Array:
        """Return ``[d; δ]`` in the targets' axes, ``(P, T, 6)``, of terms at P postures that :meth:`fits`."""
        twists = np.zeros((poses, len(terms), 6))
        for row, term in enumerate(terms):
            values = term.twist if term.twist.ndim == 2 else term.twist[:, None]
            if isinstance(term.target, JointValue):
                first = 0 if chain.prismatic[term.target.joint] else 3
                twists[:, row, first : first + 3] = (chain.axes[term.target.joint][:, None] * values).T
            else:
                twists[:, row] = values.T
        return twists

    def twists(self, chain: Chain, terms: tuple[Term, ...]) -> Array:
        """Return ``[d; δ]`` in the targets' axes, ``(T, 6)``, of terms that :meth:`fits`."""
        if any(term.twist.ndim > 1 for term in terms):
            raise InputError(
                "a term at one configuration has one twist, of 6 numbers for a place and 1 for a joint value"
            )
        return self.twists_at_many(chain, terms, 1)[0]

    def at(self, posture: Posture, terms: tuple[Term, ...]) -> TermTable:
        """Return the table at a posture of terms that :meth:`fits`."""
        frames, twists = posture.link_poses[self.links] @ self.places, self.twists(posture.chain, terms)
        return TermTable(posture.pose, self.targets, frames, self.program, self.target, twists, self.factors)

    def at_many(self, posture: Posture, terms: tuple[Term, ...]) -> list[TermTable]:
        """Return the tables at a posture of P configurations, of terms that :meth:`fits`."""
        poses = posture.q.shape[1]
        frames = np.ascontiguousarray(
            np.moveaxis(np.einsum("kijp,kjl->kilp", posture.link_poses[self.links], self.places), -1, 0)
        )
        tips = np.ascontiguousarray(np.moveaxis(posture.pose, -1, 0))
        twists = self.twists_at_many(posture.chain, terms, poses)
        return [
            TermTable(tips[k], self.targets, frames[k], self.program, self.target, twists[k], self.factors)
            for k in range(poses)
        ]


_Order = tuple[int, int, int, str]


def _chain_order(target: Target) -> _Order:
    """Return the sort key of a target along the chain: a joint before all places of the link it moves."""
    # places of different sources may have equal rank, so their names break ties
    if isinstance(target, JointValue):
        return (target.joint + 1, -1, 0, "")
    return (target.link, *target.order, target.name)


def is_alike(first: Term, second: Term) -> bool:
    """Return whether two terms have the same target and factors."""
    return first is second or (first.factors == second.factors and _is_same(first.target, second.target))


def _is_same(first: Target, second: Target) -> bool:
    return first is second or (first.is_same(second) if isinstance(first, Place) else first == second)
