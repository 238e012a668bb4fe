"""The error model: sources, draws and chain make the term table of a pose; clear numpy evaluates it.

The engines here are the oracle of the compiled kernel. Errors are ``[d; δ]`` of the tip in base axes (m, rad):
``d = p' - p``, ``δ = Log(R' Rᵀ)``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin import se3
from precision_pin.chain import Chain, Place, Posture
from precision_pin.errors import Finding, InputError, InternalError, UnknownNameError
from precision_pin.parameters import Expression, Program
from precision_pin.sheet import Sheet
from precision_pin.sheet import read as read_sheet
from precision_pin.space import LabelledSpace, Space
from precision_pin.terms import MOST_FACTORS, JointValue, Source, Target, Term, labels, own_draws

__all__ = ["ErrorModel", "PoseModel", "TermTable"]

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


@final
@dataclass(frozen=True, eq=False)
class PoseModel:
    """The error model at one pose.

    Attributes
    ----------
    posture
        The undisplaced chain, with all loads.
    space
        Draws in column order.
    table
        The terms.
    """

    posture: Posture
    space: Space
    table: TermTable
    terms: tuple[Term, ...]

    def linear(self, x: ArrayLike) -> Array:
        """Return the errors ``(6, N)`` by superposition (eqs 12-17), for component values ``(d, N)``.

        Σ J_target · twist · product of factors, with J at the undisplaced chain.
        """
        values = self._check(x)
        moved = self.table.displacements(self.table.products(self.table.program.evaluate(values)))
        result: Array = np.einsum("kij,kjn->in", self.table.sensitivities, moved)
        return result

    def exact(self, x: ArrayLike) -> Array:
        """Return the errors ``(6, N)`` of the displaced chain multiplied out, for component values ``(d, N)``.

        ``T' = Π (T_k E_k T_k⁻¹) · T`` over the targets in chain order, T_k their undisplaced poses.

        Raises
        ------
        InputError
            A target turns by π or more, where rotation vectors are no longer unique.
        """
        values = self._check(x)
        moved = self.table.displacements(self.table.products(self.table.program.evaluate(values)))
        motion = np.broadcast_to(np.eye(4)[:, :, None], (4, 4, values.shape[1]))
        for frame, displacement in zip(self.table.frames, moved, strict=True):
            if np.sqrt((displacement[3:] ** 2).sum(axis=0)).max(initial=0.0) >= np.pi:
                raise InputError(
                    "an error turns a place by half a turn or more; the tolerances or loads are far too large"
                )
            inserted = se3.compose(frame, se3.displacement(displacement), se3.inverse(frame))
            motion = se3.compose(motion, inserted)
        tip = self.table.pose[:3, 3]
        shift = np.einsum("ijn,j->in", motion[:3, :3], tip) + motion[:3, 3] - tip[:, None]
        return np.concatenate([shift, se3.log_rotation(motion[:3, :3])])

    @cached_property
    def tangent(self) -> tuple[Array, Array]:
        """First-order model of :meth:`exact` at the components' means: ``(e0 (6,), J (6, d))``.

        Under gravity it is taken on the deflected arm, and differs from :meth:`linear`.
        """
        mean = self.space.mean
        table = self.table
        parameters = table.program.evaluate(mean[:, None])
        moved = table.displacements(table.products(parameters))[:, :, 0]
        error = self.exact(mean[:, None])[:, 0]
        slopes = self._displacement_slopes(parameters[:, 0])
        spatial = np.zeros((6, self.space.size))
        motion = np.eye(4)
        for frame, displacement, slope in zip(table.frames, moved, slopes, strict=True):
            turning = se3.left_jacobian(displacement[3:]) @ slope[3:]
            twist = np.concatenate([slope[:3] + se3.skew(displacement[:3]) @ turning, turning])
            spatial += se3.adjoint(motion @ frame) @ twist
            motion = motion @ frame @ se3.displacement(displacement) @ se3.inverse(frame)
        tip = table.pose[:3, 3] + error[:3]
        jacobian = np.concatenate(
            [spatial[:3] - se3.skew(tip) @ spatial[3:], se3.left_jacobian_inverse(error[3:]) @ spatial[3:]]
        )
        return error, jacobian

    @property
    def jacobian(self) -> Array:
        """Derivative of :meth:`exact` at the components' means, ``(6, d)``."""
        return self.tangent[1]

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the tangent model, ``(6, 6)``: J Σ Jᵀ."""
        return self.jacobian @ self.space.covariance @ self.jacobian.T

    def findings(self, model: str) -> tuple[Finding, ...]:
        """Return the warnings about this pose: limits and, for ``model`` "linear", superposition stretched."""
        if model != "linear" or not self.space.size:
            return self.posture.findings
        mean = self.space.mean[:, None]
        gap = float(np.linalg.norm((self.linear(mean) - self.exact(mean))[:3]))
        spread = float(np.sqrt(np.trace(self.covariance[:3, :3])))
        if gap <= 0.1 * spread or gap <= 1e-9:
            return self.posture.findings
        message = (
            f"with every parameter at its mean, superposition places the tip {gap * 1e3:.3g} mm away from the "
            f"displaced chain, more than a tenth of the spread of {spread * 1e3:.3g} mm; the exact model has no such error"
        )
        return (*self.posture.findings, Finding("warning", "W_SUPERPOSITION", message))

    def _displacement_slopes(self, parameters: Array) -> Array:
        """Return the derivatives ``(K, 6, d)`` of the targets' displacements to the components, at their means."""
        table = self.table
        gradient = np.concatenate([table.program.gradient(self.space.mean), np.zeros((1, self.space.size))])
        padded = np.append(parameters, 1.0)
        result = np.zeros((len(table.targets), 6, self.space.size))
        for k, twist, factors in zip(table.target, table.twists, table.factors, strict=True):
            slope = np.zeros(self.space.size)
            for position in range(MOST_FACTORS):
                others = np.delete(factors, position)
                slope += gradient[factors[position]] * padded[others].prod()
            result[k] += np.outer(twist, slope)
        return result

    def _check(self, x: ArrayLike) -> Array:
        values = np.asarray(x, dtype=float)
        if values.ndim != 2 or values.shape[0] != self.space.size:
            raise InputError(f"x has shape {values.shape}, expected ({self.space.size}, N): rows as in model.space")
        return values


@final
class ErrorModel:
    """A chain with its error sources.

    Parameters
    ----------
    chain
        The chain.
    space
        The draws that have names of their own (a sheet's ``parameters``).
    sources
        Error sources, in any order. Laws that stand in their settings become draws of the model.
    poses
        Named configurations, the first one the default.

    Attributes
    ----------
    chain, sources, poses
        As given.
    labels
        Each source's label.
    space
        All draws, the named ones first.
    """

    def __init__(
        self,
        chain: Chain,
        space: Space,
        sources: Sequence[Source],
        poses: Mapping[str, ArrayLike | Mapping[str, float]] | None = None,
    ) -> None:
        self.chain = chain
        self.sources = tuple(sources)
        self.labels = labels(self.sources)
        self.space = space.including(own_draws(self.sources, self.labels))
        self.poses = {name: chain.configuration(q) for name, q in (poses or {}).items()}

    @classmethod
    def load(cls, path: str | os.PathLike[str], kinds: Iterable[type[Source]] = ()) -> ErrorModel:
        """Read a sheet and the robot it names.

        Parameters
        ----------
        path
            The YAML sheet.
        kinds
            Source classes beyond those of the package.

        Raises
        ------
        SheetError, UrdfError
            Carry every finding at once.
        """
        return cls.from_sheet(read_sheet(path, kinds=kinds))

    @classmethod
    def from_sheet(cls, sheet: Sheet) -> ErrorModel:
        """Return the model of a sheet already read."""
        return cls(sheet.chain, sheet.space, sheet.sources, sheet.poses)

    def configuration(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> Array:
        """Return joint values in chain order, given so, by joint name, by a pose's name, or as the first pose.

        Raises
        ------
        UnknownNameError
            No such pose or joint.
        InputError
            Wrong joint values, or none given and the model has no poses.
        """
        if q is None:
            if not self.poses:
                raise InputError("the model has no poses; give joint values")
            return next(iter(self.poses.values()))
        if isinstance(q, str):
            if q not in self.poses:
                raise UnknownNameError("pose", q, self.poses)
            return self.poses[q]
        return self.chain.configuration(q)

    def pose_name(self, q: object) -> str:
        """Return the name of the pose that :meth:`configuration` makes of ``q``, empty where it has none."""
        return q if isinstance(q, str) else next(iter(self.poses), "") if q is None else ""

    def at(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> PoseModel:
        """Return the model at a pose; ``q`` as in :meth:`configuration`."""
        posture = self.chain.at(self.configuration(q))
        views = [LabelledSpace(self.space, label) for label in self.labels]
        pairs = list(zip(self.sources, views, strict=True))
        posture = posture.with_loads([load for source, view in pairs for load in source.loads(posture, view)])
        terms = tuple(term for source, view in pairs for term in source.terms(posture, view))
        return PoseModel(posture, self.space, TermTable.build(posture, self.space, terms), terms)


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
