"""The term table: what every engine and analysis reads."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from precision_pin import se3
from precision_pin.chain import Place, Posture
from precision_pin.errors import InternalError
from precision_pin.parameters import Expression, Program
from precision_pin.space import Space
from precision_pin.terms import MOST_FACTORS, JointValue, Target, Term

__all__ = ["TermTable"]

Array = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class TermTable:
    """What every engine and analysis reads: displacements of targets as products of parameters.

    A joint value is a target like any other: its pivot is the joint's frame after it turned, its twist along the axis.

    Attributes
    ----------
    pose
        Nominal tip in the base, ``(4, 4)``.
    targets
        K targets in chain order.
    frames
        Pose of every target in the base, ``(K, 4, 4)``.
    program
        Computes the P parameters from the d components.
    target
        Target of each of the T terms, ``(T,)``.
    twists
        ``[d; δ]`` in the target's axes, ``(T, 6)``.
    factors
        Up to three parameters that multiply it, ``(T, 3)``, -1 for none.
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
        listed = list(terms)
        by_key: dict[tuple[int, int, int, str], Target] = {}
        for term in listed:
            known = by_key.setdefault(_chain_order(term.target), term.target)
            if isinstance(known, Place) and not known.is_same(term.target):
                raise InternalError(f"two different places at one point of the chain: {known}, {term.target}")
        keys = sorted(by_key)
        parameters: dict[Expression, int] = {}
        for term in listed:
            for factor in term.factors:
                parameters.setdefault(factor, len(parameters))
        factors = np.full((len(listed), MOST_FACTORS), -1, dtype=np.intp)
        for row, term in enumerate(listed):
            factors[row, : len(term.factors)] = [parameters[factor] for factor in term.factors]
        return cls(
            pose=posture.pose,
            targets=tuple(by_key[key] for key in keys),
            frames=np.array([_frame(by_key[key], posture) for key in keys]).reshape(-1, 4, 4),
            program=Program.compile(list(parameters), space.index),
            target=np.array([keys.index(_chain_order(term.target)) for term in listed], dtype=np.intp),
            twists=np.array([_twist(term, posture) for term in listed]).reshape(-1, 6),
            factors=factors,
        )

    @cached_property
    def sensitivities(self) -> Array:
        """Derivative of the tip's error to each target's displacement, undisplaced chain, ``(K, 6, 6)``."""
        result = np.zeros((len(self.targets), 6, 6))
        for k, frame in enumerate(self.frames):
            rotation = frame[:3, :3]
            result[k, :3, :3] = result[k, 3:, 3:] = rotation
            result[k, :3, 3:] = se3.skew(frame[:3, 3] - self.pose[:3, 3]) @ rotation
        return result

    def products(self, parameters: Array) -> Array:
        """Return each term's product of factors, ``(T, N)``, for parameters ``(P, N)``."""
        padded = np.concatenate([parameters, np.ones((1, parameters.shape[1]))])
        result: Array = np.prod(padded[self.factors], axis=1)
        return result

    def displacements(self, products: Array) -> Array:
        """Return every target's displacement, ``(K, 6, N)``, for products ``(T, N)``."""
        result = np.zeros((len(self.targets), 6, products.shape[1]))
        for k, twist, product in zip(self.target, self.twists, products, strict=True):
            result[k] += twist[:, None] * product
        return result

    def displacement_slopes(self, mean: Array) -> Array:
        """Return the derivatives ``(K, 6, d)`` of the targets' displacements to the components, at ``(d,)`` values."""
        gradient = np.concatenate([self.program.gradient(mean), np.zeros((1, mean.size))])
        padded = np.append(self.program.evaluate(mean[:, None])[:, 0], 1.0)
        result = np.zeros((len(self.targets), 6, mean.size))
        for k, twist, factors in zip(self.target, self.twists, self.factors, strict=True):
            slope = np.zeros(mean.size)
            for position in range(MOST_FACTORS):
                slope += gradient[factors[position]] * padded[np.delete(factors, position)].prod()
            result[k] += np.outer(twist, slope)
        return result


def _chain_order(target: Target) -> tuple[int, int, int, str]:
    """Return where a target stands on the chain: a joint before all places of the link it moves.

    Places of different sources may have one rank; their names then tell them apart and order them.
    """
    if isinstance(target, JointValue):
        return (target.joint + 1, -1, 0, "")
    return (target.link, *target.order, target.name)


def _frame(target: Target, posture: Posture) -> Array:
    if isinstance(target, JointValue):
        pose: Array = posture.joint_poses[target.joint]
        return pose
    return posture.place_pose(target)


def _twist(term: Term, posture: Posture) -> Array:
    if not isinstance(term.target, JointValue):
        return term.twist
    twist = np.zeros(6)
    rows = slice(0, 3) if posture.chain.prismatic[term.target.joint] else slice(3, 6)
    twist[rows] = posture.chain.axes[term.target.joint] * term.twist[0]
    return twist
