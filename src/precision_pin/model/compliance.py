"""Loads of an arm, the terms caused by loads, and the compliance of the end-effector, by source.

Public interface for analyses of stiffness, which import no source.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arrays import Array, Fixed
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import component_names
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.equilibrium import RestState, solve_equilibrium
from precision_pin.model.pose_model import AT_ONCE, PoseModel
from precision_pin.robot.chain import Posture
from precision_pin.robot.places import Factors, Load
from precision_pin.terms.bound_source import load_posture, load_postures, terms_at, terms_at_many
from precision_pin.terms.table import TableLayout, TermTable
from precision_pin.terms.term import Term, on_target

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from precision_pin.model.error_model import ErrorModel
    from precision_pin.robot.configurations import ApproachedPose

    Pose = ArrayLike | Mapping[str, float] | ApproachedPose | str | None

ARM: Final = "arm"
"""Key of the weights of the URDF's links; no source has this label."""
_WRENCH: Final = tuple(f"load[{part}{axis}]" for part in "FM" for axis in "xyz")
"""Names of the components of a force and a moment at the target, the last of the space."""
_ROWS: Final = tuple(enumerate(_WRENCH))
_TOGETHER: Final = 512
"""Robots at rest evaluated together, each with a matrix of its own."""


def loads_of(model: ErrorModel, q: Pose = None) -> dict[str, tuple[Load, ...]]:
    """Return the loads at a pose: the weights of the URDF's links under :data:`ARM`, those of sources by label.

    Args:
        q: The pose, as for :meth:`~precision_pin.model.error_model.ErrorModel.at`.
    """
    bare = replace(model.at(q).posture, loads=model.chain.loads, tilts=())
    source_loads = {
        label: tuple(source.loads(bare)) for label, source in zip(model.labels, model.bound_sources, strict=True)
    }
    return {ARM: bare.loads, **{label: loads for label, loads in source_loads.items() if loads}}


def loaded_terms(model: ErrorModel, q: Pose = None) -> dict[str, tuple[Term, ...]]:
    """Return the terms caused by loads at a pose, by the label of the elastic source."""
    return _loaded_terms(model, model.at(q).posture)


def compliances_of(model: ErrorModel, q: Pose = None) -> dict[str, Array]:
    """Return the contribution of each elastic source to the compliance of the end-effector at a pose, by label.

    A compliance C ``(6, 6)`` gives the displacement ``[d; δ] = C [f; m]`` of the target, m and rad, by a force and a moment
    on the tip's link, acting at the target, N and N·m, all in base axes. It holds for the undeflected arm, to first
    order, with every parameter at its mean. The sum over the sources is the compliance of the arm.

    Raises:
        InputError: An invalid pose; a formula has no value at the means.
    """
    elastic = Elasticity(model, "nominal").at(q)
    return dict(zip(elastic.labels, elastic.by_source(model.space.mean[:, None])[..., 0], strict=True))


class Elasticity:
    """Responses of a model's arm to further loads on the tip's link that act at the target, in base axes, at any pose.

    Friction neither holds a joint nor carries it along: an approach counts for the dead band only.

    Args:
        statics: ``"nominal"`` or ``"equilibrium"`` (default: those of the model).
    """

    def __init__(self, model: ErrorModel, statics: Literal["nominal", "equilibrium"] | None = None) -> None:
        arm = model.bare
        self.statics = statics or arm.statics
        self.model = arm.like(arm.chain, arm.space.including([Draw(name, Uniform(1.0)) for name in _WRENCH]))
        self._last: _Common | None = None

    def at(self, q: Pose = None, values: Array | None = None) -> ElasticPose:
        """Return the elastic arm at a pose, as for :meth:`~precision_pin.model.error_model.ErrorModel.at`.

        Args:
            values: Values of the components ``(d,)`` at whose rest the arm is, with equilibrium statics (default: the means).
        """
        posture = load_posture(self.model.chain.at(self.model.configuration(q)), self.model.bound_sources)
        probe = self._probe(posture)
        if self.statics == "nominal":
            by_label = _loaded_terms(self.model, replace(posture, loads=(probe,), tilts=(), deciding=posture))
            terms, common = self._common(by_label)
            return self._undeflected(posture, common, TermTable.build(posture, self.model.space, terms))
        x = None if values is None else np.append(values, np.zeros(6))
        # a force of zero, so that what no load displaces yet has a slot too
        nothing = self._load(posture, probe.wrenches[:1])
        state = solve_equilibrium(posture.with_loads([nothing]), self.model.space, self.model.bound_sources, values=x)
        directions = state.feedback.list_directions(state.table)
        # the stiffness in pieces is that of the loads without the probe
        deciding = replace(state.posture, loads=posture.loads)
        probed = replace(state.posture, loads=(*posture.loads, probe), deciding=deciding)
        terms, common = self._common(_loaded_terms(self.model, probed))
        table, count = TermTable.build(posture, self.model.space, terms), len(state.table.targets)
        numbers = {target: k for k, target in enumerate(state.table.targets)}
        slots = np.array([numbers[term.target] + count for term in terms], dtype=np.intp)
        moves = np.einsum("mti,ti->tm", directions[:, slots], table.twists)
        loaded = np.array([term.loaded for term in state.terms], dtype=bool)
        slopes = state.feedback.term_slopes(state.displacements, directions)[loaded]
        reactions = np.einsum("mti,tin->tmn", directions[:, state.slots[loaded]], slopes)
        feedback = _Feedback(state.table, loaded, reactions, self._tip_slopes(posture, state, directions))
        return ElasticPose(posture, common, table, moves, feedback)

    def at_many(self, poses: Sequence[Pose]) -> Iterator[ElasticPose]:
        """Yield the elastic arm at poses in order; sources that accept many postures are asked for many at once."""
        for first in range(0, len(poses), AT_ONCE):
            part = poses[first : first + AT_ONCE]
            yield from (self._undeflected_poses(part) if len(part) > 1 else None) or map(self.at, part)

    def _undeflected_poses(self, poses: Sequence[Pose]) -> list[ElasticPose] | None:
        """Return the undeflected arm at poses; None if the sources do not allow to compute many at once."""
        sources, space = self.model.bound_sources, self.model.space
        if self.statics != "nominal":
            return None
        values = np.column_stack([self.model.configuration(pose) for pose in poses])
        stacked, bare = self.model.chain.postures_at(values)
        loaded = load_postures(stacked, bare, sources)
        if loaded is None:
            return None
        probe = self._probe(bare[0])
        stacked, *probed = (replace(at, loads=(probe,), tilts=(), deciding=at) for at in (loaded[0], *loaded[1]))
        by_label = {}
        for label, source in zip(self.model.labels, sources, strict=True):
            terms = terms_at_many(stacked, probed, [source])
            if terms is None:
                return None
            if probed_terms := tuple(term for term in terms if term.loaded and _column(term) >= 0):
                by_label[label] = probed_terms
        terms, common = self._common(by_label)
        tables = TableLayout.of(terms, space).at_many(stacked, terms)
        return [self._undeflected(posture, common, table) for posture, table in zip(loaded[1], tables, strict=True)]

    def _common(self, by_label: Mapping[str, tuple[Term, ...]]) -> tuple[tuple[Term, ...], _Common]:
        """Return the terms that the further load causes, and what is common to poses with alike terms."""
        labels = tuple(label for label, terms in by_label.items() if any(_column(term) >= 0 for term in terms))
        terms = tuple(term for label in labels for term in by_label[label] if _column(term) >= 0)
        if self._last is None or not self._last.layout.fits(terms):
            owner = [k for k, label in enumerate(labels) for term in by_label[label] if _column(term) >= 0]
            columns = [_column(term) for term in terms]
            layout = TableLayout.of(terms, self.model.space)
            self._last = _Common(layout, labels, np.array(owner, dtype=np.intp), np.array(columns, dtype=np.intp))
        return terms, self._last

    def _undeflected(self, posture: Posture, common: _Common, table: TermTable) -> ElasticPose:
        moves = np.einsum("tij,tj->ti", table.sensitivities[table.target], table.twists)
        return ElasticPose(posture, common, table, moves, None)

    def error(self, posture: Posture, wrench: Array | None = None) -> Array:
        """Return the error of the target with every parameter at its mean, under a further force and moment ``(6,)``.

        To first order with nominal statics, else at rest.
        """
        space = self.model.space
        if wrench is not None:
            posture = posture.with_loads([self._load(posture, [(wrench, ())])])
        if self.statics == "equilibrium":
            return solve_equilibrium(posture, space, self.model.bound_sources).alone(posture, space).error_at_means
        terms = terms_at(posture, self.model.bound_sources)
        at = PoseModel(posture, space, TermTable.build(posture, space, terms), terms)
        return at.linear(space.mean[:, None])[:, 0]

    def dead_bands(self, posture: Posture) -> dict[str, tuple[int, float]]:
        """Return the joint (0-based) held by the friction of each source that holds one, and the width of its band.

        The width, rad or m, is that between the two directions in which the joint may have moved last, at the means.
        """
        bands: dict[str, tuple[int, float]] = {}
        space, n = self.model.space, len(self.model.chain.joints)
        for label, source in zip(self.model.labels, self.model.bound_sources, strict=True):
            if not source.source.holds_joint:
                continue
            ends = []
            for direction in (1, -1):
                terms = tuple(source.terms(replace(posture, approach=(direction,) * n)))
                table = TermTable.build(posture, space, terms)
                products = table.products(table.program.evaluate(space.mean[:, None]))[:, 0]
                ends.append(sum(float(term.twist[0] * p) for term, p in zip(terms, products, strict=True)))
                joint = self.model.chain.joint_index(source.source.subject)
            if ends[0] != ends[1]:
                bands[label] = (joint, abs(ends[0] - ends[1]))
        return bands

    def _probe(self, posture: Posture) -> Load:
        """Return a force and a moment at the target, each component a parameter."""
        return self._load(posture, [(np.eye(6)[row], (self.model.space.parameter(name),)) for row, name in _ROWS])

    def _load(self, posture: Posture, wrenches: Sequence[tuple[Array, Factors]]) -> Load:
        chain = posture.chain
        entry = chain.placements[-1][:3, 3]
        return Load(len(chain.joints), chain.target_placement, entry, along=False, moments=(), wrenches=tuple(wrenches))

    def _tip_slopes(self, posture: Posture, state: RestState, directions: Array) -> Array:
        """Return the twist of the tip by steps along directions ``(M, 2K, 6)`` from rest, ``(6, M)``."""
        steps = Space(tuple(Draw(f"step{m}", Uniform(1.0)) for m in range(len(directions))))
        parts: list[tuple[Array, Factors]] = [(state.displacements, ())]
        parts += [(step, (steps.parameter(f"step{m}"),)) for m, step in enumerate(directions)]
        terms = tuple(
            term
            for by_slot, factors in parts
            for target, twist in zip(state.table.targets * 2, by_slot, strict=True)
            if twist.any() and not target.is_bow
            for term in [Term.of(target, on_target(target, posture.chain, twist), *factors)]
        )
        at = PoseModel(posture, steps, TermTable.build(posture, steps, terms), terms)
        slopes = np.array(at.jacobian)
        slopes[3:] = se3.left_jacobian(at.error_at_means[3:]) @ slopes[3:]
        return slopes


class _Common:
    """What poses with alike terms share.

    Attributes:
        labels: Labels of the L elastic sources.
        owner: Number of the source of each term, ``(T,)``.
        columns: Component of force and moment that multiplies each term, ``(T,)``.
    """

    def __init__(
        self, layout: TableLayout, labels: tuple[str, ...], owner: NDArray[np.intp], columns: NDArray[np.intp]
    ) -> None:
        self.layout, self.labels, self.owner, self.columns = layout, labels, owner, columns
        self._products: dict[int, tuple[Array, Array]] = {}

    def products(self, table: TermTable, x: Array) -> Array:
        """Return the product of each term's factors per unit of force or moment, ``(T, N)``, for values ``(d, N)``."""
        if id(x) not in self._products:
            values = np.concatenate([x, np.ones((6, x.shape[1]))])
            self._products = dict([*self._products.items()][-1:])  # those of the means and of the robots
            self._products[id(x)] = (x, table.products(table.program.evaluate(values)))
        return self._products[id(x)][1]


@dataclass(frozen=True, eq=False)
class _Feedback(Fixed):
    """Change of the displacements by loads with the displacements, about rest: terms that loads cause, and their slopes.

    ``tip`` is the twist of the tip by a step along each of M directions, ``(6, M)``.
    """

    table: TermTable
    loaded: NDArray[np.bool_]
    reactions: Array
    tip: Array

    def to_tip(self, x: Array) -> Array:
        """Return the twist of the tip by a force along each direction, ``(N, 6, M)``, for values ``(d, N)``."""
        values = np.concatenate([x, np.zeros((6, x.shape[1]))])
        products = self.table.products(self.table.program.evaluate(values))[self.loaded]
        slopes = np.einsum("tn,tij->nij", products, self.reactions)
        return self.tip @ np.linalg.inv(np.eye(slopes.shape[1]) - slopes)


@dataclass(frozen=True, eq=False)
class ElasticPose(Fixed):
    """The compliance of the target at a pose, for robots of any values.

    With nominal statics C = Σ J_e C_e J_eᵀ over the elastic sources at the undeflected pose. At rest C = J (K - K_g)⁻¹ Jᵀ
    with J and K_g at the rest of the mean robot: a robot's stiffnesses and loads enter K and K_g, not where it rests.

    Attributes:
        posture: The undeflected arm with its loads.
        table: Terms caused by the further load.
        moves: Twist of each term, of the tip ``(T, 6)``, or with feedback along M directions, ``(T, M)``.
        feedback: Change of the loads with the displacements; None for nominal statics.
    """

    posture: Posture
    common: _Common
    table: TermTable
    moves: Array
    feedback: _Feedback | None

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the L elastic sources."""
        return self.common.labels

    def by_source(self, x: Array) -> Array:
        """Return the part of each source in the compliance ``(L, 6, 6, N)``, SI, base axes, for values ``(d, N)``."""
        count = len(self.labels)
        return np.array([self._sum(x, self.common.owner == k) for k in range(count)]).reshape(count, 6, 6, x.shape[1])

    def whole(self, x: Array) -> Array:
        """Return the compliance ``(6, 6, N)``, SI, base axes, for values ``(d, N)``."""
        return self._sum(x, np.ones(len(self.moves), dtype=bool))

    def _sum(self, x: Array, rows: NDArray[np.bool_]) -> Array:
        products = self.common.products(self.table, x)
        moved = np.zeros((self.moves.shape[1], 6, x.shape[1]))
        for column in range(6):
            of_column = rows & (self.common.columns == column)
            # sums in a fixed order, unlike products of matrices
            moved[:, column] = np.einsum("tm,tn->mn", self.moves[of_column], products[of_column])
        if self.feedback is None:
            return moved
        parts = (slice(first, first + _TOGETHER) for first in range(0, x.shape[1], _TOGETHER))
        return np.concatenate(
            [np.moveaxis(self.feedback.to_tip(x[:, p]) @ np.moveaxis(moved[..., p], -1, 0), 0, -1) for p in parts],
            axis=-1,
        )


def _column(term: Term) -> int:
    """Return the component of the further force and moment that multiplies a term, 0 to 5; -1 for none."""
    names = {name for factor in term.factors for name in component_names(factor)}
    return next((row for row, name in _ROWS if name in names), -1)


def _loaded_terms(model: ErrorModel, posture: Posture) -> dict[str, tuple[Term, ...]]:
    terms_by_label = {
        label: tuple(term for term in source.terms(posture) if term.loaded)
        for label, source in zip(model.labels, model.bound_sources, strict=True)
    }
    return {label: terms for label, terms in terms_by_label.items() if terms}
