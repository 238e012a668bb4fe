"""Statics on the deflected arm: loads evaluated at the arm's rest state.

``v = G(v, x)`` with v the displacements of all targets, and G the displacements by the terms for parameters x if the
loads act on the arm displaced by v. Displacements are in *slots*: with K targets, the first K slots are displacements
without loads, the second K those by loads, which bend the links.

About the rest state v* at the parameters' means, with A = (I - ∂G/∂v)⁻¹ there,

    v(x) = v* + A (G(v*, x) - v*) + Σ (f - f̄) S_f A Σ (h - h̄) t_h

preserves every term with its factors: 1/k stays 1/k, and products of load and stiffness stay products. The last sum is
the change of the feedback with the parameters: f and h are the products of factors of terms caused by loads, t_h their
twists and S_f the slopes of the twists. The derivative of v(x) at the means equals that of the exact solution; the
neglected terms are of third order.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, InternalError
from precision_pin.draws.expressions import Expression, Program, fix_signs, operations, signs_of
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel, spread_of
from precision_pin.robot.chain import Posture
from precision_pin.robot.places import Deflection, Factors, Place
from precision_pin.terms.bound_source import BoundSource, terms_at
from precision_pin.terms.table import TableLayout, TermTable
from precision_pin.terms.term import JointValue, Target, Term, on_target

SETTLED: Final = 1e-13
"""Change of the displacements (m, rad) below which the arm is at rest: rounding of an arm of metres."""
STEP: Final = 1e-7
"""Step (m, rad) of the differences of G, at which curvature and rounding both cause errors of about 1e-9."""

_NOISE: Final = 1e-8
"""Ratio (1/m, 1/rad) of the slope of a term's twist to the twist below which it is rounding of the differences."""

_PUSH: Final = 1e-6
"""Offset (m, rad) of the start of the search for rest, so that it leaves an unstable rest state."""
_SHRINKS: Final = 0.5
"""Largest ratio of successive changes up to which loads and deflections are computed in turn."""
_MOST_ROUNDS: Final = 100
"""Rounds of loads and deflections: at ratios up to ``_SHRINKS``, 44 reduce a change of 1 m below ``SETTLED``."""
_MOST_CORRECTIONS: Final = 12
"""Corrections by Newton's method in a step of the loads: five double the digits from 0.1 m to rounding."""
_MOST_STEPS: Final = 500
"""Steps of the loads: 15 short ones reach ``_PAST`` buckling loads; a search that needs hundreds does not converge."""
_SMALLEST_STEP: Final = 1e-7
"""Smallest step of the loads, as a fraction of the full loads; 23 halvings without success end the search."""
_SHORT_STEP: Final = 0.1
_PAST: Final = 1.5
"""Step of the loads up to ``_PAST`` times the undeflected arm's buckling load, as a fraction of that load."""
_LONGEST_LEAP: Final = 0.3
_LARGEST_SURPRISE: Final = 0.1
"""Largest displacement (m, rad) in one step of the loads, and its largest difference from the prediction.

Longer steps may pass a stable rest state and reach another one; shorter ones cost time.
"""
_NEAR_BUCKLING: Final = 0.9
"""Growth of a displacement per round of loads above which the rest state is almost unstable."""
# errors: no stable rest state beyond a load, and no rest state at a load
_BUCKLES: Final = (
    "the arm buckles under its loads: beyond {:.3g} times these loads it has no stable rest state, "
    "so equilibrium statics has no solution"
)
_NO_REST: Final = (
    "the arm does not come to rest under its loads: at {} loads it alternates between two states, as if crossing a "
    "backlash or clearance reverses its load; give a wider band"
)
_ROUNDING: Final = 1e-13
"""Relative size of a correction that counts as rounding, for large displacements."""
_NO_WAY: Final = 1e-9
"""Fraction of a place's largest singular value below which its terms do not move it in that direction."""


@dataclass(frozen=True, eq=False)
class RestState:
    """The arm at rest under its loads, for a value of every parameter.

    Attributes:
        displacements: v*, of the slots of the table's targets, ``(2K, 6)``.
        feedback: G about v*.
    """

    posture: Posture
    terms: tuple[Term, ...]
    table: TermTable
    displacements: Array
    feedback: Feedback

    @property
    def slots(self) -> NDArray[np.intp]:
        """Slot displaced by each term, ``(T,)``."""
        loaded = np.array([term.loaded for term in self.terms], dtype=np.intp)
        return self.table.target + len(self.table.targets) * loaded

    @property
    def moving(self) -> NDArray[np.bool_]:
        """True for slots that move the tip, ``(2K,)``: all but the slots of bows of links."""
        return np.array([not target.is_bow for target in self.table.targets] * 2, dtype=bool)

    def alone(self, posture: Posture, space: Space) -> PoseModel:
        """Return the model of this arm, at an undisplaced posture."""
        terms = tuple(term for term in self.terms if not term.target.is_bow)
        return PoseModel(posture, space, TermTable.build(posture, space, terms), terms)


def solve_equilibrium(
    posture: Posture, space: Space, sources: Sequence[BoundSource], within: float = SETTLED, values: Array | None = None
) -> RestState:
    """Return the arm at rest under its loads; raise an error only if there is no stable rest state.

    Loads and deflections are computed in turn. If this does not converge quickly, the loads are raised from zero in
    steps, and Newton's method follows the arm.

    Args:
        posture: The undisplaced chain, with all loads.
        sources: All sources of the model.
        within: Change of the displacements (m, rad) per round at which the arm counts as at rest.
        values: Values of the components, ``(d,)`` (default: their means).
    """
    feedback = Feedback(posture, space, sources, space.mean if values is None else values)
    offset = max(_PUSH, 100 * within) * feedback.loaded[:, None]
    current, change = feedback.at_start + offset, np.inf
    for _ in range(_MOST_ROUNDS):
        updated = feedback(current)
        previous, change = change, float(np.abs(updated - current).max(initial=0.0))
        current = updated
        if change < within:
            return feedback.rest_at(current)
        if not change <= _SHRINKS * previous:
            break
    return feedback.rest_at(_follow_loads(feedback, within))


class Feedback:
    """G: the displacements by the terms, for fixed parameters, if the loads act on the arm displaced by v.

    Attributes:
        at_start: Displacements by the terms on the undisplaced arm, ``(2K, 6)``.
        loaded: True for the slots displaced by loads, ``(2K,)``.
    """

    def __init__(self, posture: Posture, space: Space, sources: Sequence[BoundSource], values: Array) -> None:
        self._posture, self._space, self._sources, self._values = posture, space, sources, values
        self._table = TermTable.build(posture, space, terms_at(posture, sources))
        # with a deflection of zero, since terms of bent links exist only on deflected arms
        terms = self._terms(np.zeros((2 * len(self._table.targets), 6)))
        self._arrange(terms)
        self._table = self._layout.at(posture, terms)
        self.at_start = self._sum(terms)
        self.loaded = np.zeros(len(self.at_start), dtype=bool)
        self.loaded[self._slots[self._is_loaded]] = True

    def __call__(self, displacements: Array) -> Array:
        """Return G, ``(2K, 6)``, for displacements ``(2K, 6)``."""
        return self._sum(self._terms(displacements))

    def rest_at(self, displacements: Array) -> RestState:
        """Return the arm at rest with these displacements."""
        posture = self._displace(displacements)
        terms = terms_at(posture, self._sources)
        return RestState(posture, terms, TermTable.build(posture, self._space, terms), self._sum(terms), self)

    def list_directions(self, table: TermTable) -> Array:
        """Return the directions in which slots can change, ``(M, 2K, 6)``.

        A slot displaced by loads has one direction for a joint value, six for a place; any other the span of its terms.
        """
        chain, directions, targets = self._posture.chain, [], table.targets
        for slot in range(2 * len(targets)):
            target = targets[slot % len(targets)]
            twists = table.twists[self._slots == slot]
            if not len(twists):
                continue
            if isinstance(target, JointValue):
                axes = np.zeros((1, 6))
                axes[0, slice(0, 3) if chain.prismatic[target.joint] else slice(3, 6)] = chain.axes[target.joint]
            elif self.loaded[slot]:
                axes = np.eye(6)
            else:
                _, sizes, rows = np.linalg.svd(twists, full_matrices=False)
                axes = rows[sizes > _NO_WAY * sizes.max(initial=0.0)]
            for direction in axes:
                directions.append(np.zeros((2 * len(targets), 6)))
                directions[-1][slot] = direction
        return np.array(directions).reshape(-1, 2 * len(targets), 6)

    def term_slopes(self, displacements: Array, directions: Array) -> Array:
        """Return the derivatives of all terms' twists along every direction, ``(T, 6, M)``."""
        posture = self._displace(displacements)
        terms = terms_at(posture, self._sources)
        if not self._layout.fits(terms):
            self._arrange(terms)
        chain, changes = self._posture.chain, []
        twists = self._layout.twists(chain, terms)
        for v in directions:
            after = terms_at(replace(self._displace(displacements + STEP * v), deciding=posture), self._sources)
            if not self._layout.fits(after):
                raise InputError(_NO_REST.format("these"))
            changes.append((self._layout.twists(chain, after) - twists) / STEP)
        slopes = np.moveaxis(np.array(changes), 0, -1)
        noise = _NOISE * np.abs(twists).max(axis=1, initial=0.0)
        return np.where(np.abs(slopes) > noise[:, None, None], slopes, 0.0)

    def slopes(self, term_slopes: Array, directions: Array) -> Array:
        """Return ∂G/∂v of the displacements by loads, ``(M, M)``: component of G by step, along every direction."""
        result = np.zeros((len(self.loaded), 6, len(directions)))
        rows = self._is_loaded
        np.add.at(result, self._slots[rows], self._products[rows, None, None] * term_slopes[rows])
        return np.einsum("mki,kin->mn", directions, result)

    def products(self, terms: tuple[Term, ...]) -> dict[Factors, float]:
        """Return the product of each term's factors, by the factors, for the terms at rest."""
        return {term.factors: float(product) for term, product in zip(terms, self._products, strict=True)}

    @property
    def loaded_directions(self) -> Array:
        """Directions in which displacements by loads can change, ``(M, 2K, 6)``."""
        directions = self.list_directions(self._table)
        return directions[directions[:, self.loaded].any(axis=(1, 2))]

    def _terms(self, displacements: Array) -> tuple[Term, ...]:
        return terms_at(self._displace(displacements), self._sources)

    def _displace(self, displacements: Array) -> Posture:
        return replace(self._posture, deflection=compute_deflection(self._posture, self._table, displacements))

    def _arrange(self, terms: tuple[Term, ...]) -> None:
        """Compute the layout of the terms and all values that depend only on their targets and factors."""
        self._layout = TableLayout.of(terms, self._space)
        padded = np.append(self._layout.program.evaluate(self._values[:, None])[:, 0], 1.0)
        self._products = padded[self._layout.factors].prod(axis=1)
        self._is_loaded = np.array([term.loaded for term in terms], dtype=bool)
        self._slots = self._layout.target + len(self._layout.targets) * self._is_loaded

    def _sum(self, terms: tuple[Term, ...]) -> Array:
        if not self._layout.fits(terms):
            targets = self._layout.targets
            self._arrange(terms)  # for example if a load changes the side of a backlash
            if self._layout.targets != targets:
                raise InternalError("the targets of a source's terms change with the deflection of the arm")
        total = np.zeros((2 * len(self._layout.targets), 6))
        np.add.at(total, self._slots, self._layout.twists(self._posture.chain, terms) * self._products[:, None])
        return total


def _follow_loads(feedback: Feedback, within: float) -> Array:
    """Return the displacements of the arm at rest, followed while the loads grow from zero to full size."""
    # With a fraction s of the loads, `z = s g(z)`, z the displacements by loads. A step of s is halved if Newton's
    # method does not converge from the tangent's prediction to a stable rest state nearby.
    directions = feedback.loaded_directions
    path = _Path.at(feedback, directions, 0.0, feedback.at_start, np.zeros(len(directions)))
    first_growth = _growth(path.slopes)
    # an inclined arm bends beyond the buckling load of a straight arm; short steps find this load
    short_step = _SHORT_STEP / first_growth if first_growth >= 1.0 else 1.0
    step = short_step
    for _ in range(_MOST_STEPS):
        fraction = min(1.0, path.fraction + step)
        next_state = None
        with suppress(np.linalg.LinAlgError):
            next_state = path.follow_to(fraction, within)
        if next_state is None and step < _SMALLEST_STEP:
            break
        if next_state is None:
            step = (fraction - path.fraction) / 2
            continue
        path, step = next_state, 2 * step if fraction > _PAST * short_step / _SHORT_STEP else min(2 * step, short_step)
        if first_growth >= 1.0 and fraction * _growth(path.slopes) > _NEAR_BUCKLING:
            raise InputError(_BUCKLES.format(1 / first_growth))
        if fraction == 1.0:
            return path.displacements
    if path.fraction * _growth(path.slopes) > _NEAR_BUCKLING:
        raise InputError(_BUCKLES.format(path.fraction))
    raise InputError(_NO_REST.format(f"{path.fraction:.3g} times the"))


@dataclass(frozen=True, eq=False)
class _Path:
    """An arm at rest under a fraction of its loads.

    Attributes:
        feedback, ways: G, and the M directions in which its loaded targets move.
        share: Fraction of the loads.
        others: Displacements not caused by loads, ``(2K, 6)``.
        moved: z along every direction, ``(M,)``.
        pull, slopes: g(z) along every direction, ``(M,)``, and ∂g/∂z, ``(M, M)``, under all loads.
    """

    feedback: Feedback
    directions: Array
    fraction: float
    others: Array
    z: Array
    pull: Array
    slopes: Array

    @classmethod
    def at(cls, feedback: Feedback, directions: Array, fraction: float, others: Array, z: Array) -> _Path:
        """Return the arm with these displacements, at rest or not."""
        others = np.where(feedback.loaded[:, None], 0.0, others)
        displacements = others + np.einsum("m,mki->ki", z, directions)
        reaction = feedback(displacements)
        slopes = feedback.slopes(feedback.term_slopes(displacements, directions), directions)
        return cls(feedback, directions, fraction, reaction, z, np.einsum("mki,ki->m", directions, reaction), slopes)

    @property
    def displacements(self) -> Array:
        """Displacements of all slots, ``(2K, 6)``."""
        others = np.where(self.feedback.loaded[:, None], 0.0, self.others)
        return others + np.einsum("m,mki->ki", self.z, self.directions)

    def follow_to(self, fraction: float, within: float) -> _Path | None:
        """Return the arm at rest under another fraction of its loads; None if no stable state is near.

        Raises ``LinAlgError`` exactly at buckling.
        """
        guess = self.z + (fraction - self.fraction) * np.linalg.solve(self._stiffness(self.fraction), self.pull)
        if not np.abs(guess - self.z).max() < _LONGEST_LEAP:
            return None
        at = _Path.at(self.feedback, self.directions, fraction, self.others, guess)
        for _ in range(_MOST_CORRECTIONS):
            correction = np.linalg.solve(at._stiffness(fraction), fraction * at.pull - at.z)
            if not np.abs(at.z + correction - guess).max() < _LARGEST_SURPRISE:
                return None
            at = _Path.at(self.feedback, self.directions, fraction, at.others, at.z + correction)
            if np.abs(correction).max() < max(within, _ROUNDING * np.abs(at.z).max()):
                return at if fraction * _growth(at.slopes) < 1.0 else None
        return None

    def _stiffness(self, fraction: float) -> Array:
        return np.eye(len(self.directions)) - fraction * self.slopes


def compute_deflection(posture: Posture, table: TermTable, displacements: Array) -> Deflection:
    """Return the state of the chain with all slots displaced by ``displacements``, ``(2K, 6)``."""
    unloaded, by_loads = displacements.reshape(2, -1, 6)
    poses, ends = posture.link_poses.copy(), posture.link_poses @ posture.chain.placements
    moves = np.moveaxis(se3.displacement((unloaded + by_loads).T), -1, 0)
    inverse_frames = np.moveaxis(se3.inverse(np.moveaxis(table.frames, 0, -1)), -1, 0)
    bending = np.zeros((len(poses), 2, 6))
    motions = list(zip(table.targets, table.frames @ moves @ inverse_frames, strict=True))
    for target, bend in zip(table.targets, by_loads, strict=True):
        if isinstance(target, Place) and (target.is_bow or target == posture.chain.end(target.link)):
            bending[target.link, int(target.is_bow)] = (bend.reshape(2, 3) @ target.frame[:3, :3].T).ravel()
    motion = np.eye(4)
    for link in range(len(poses)):
        link_motions = [(target, move) for target, move in motions if _link(target) == link]
        for target, move in link_motions:
            if isinstance(target, JointValue) or target.is_start:
                motion = motion @ move
        poses[link] = motion @ poses[link]
        for target, move in link_motions:
            if isinstance(target, Place) and not (target.is_start or target.is_seat or target.is_bow):
                motion = motion @ move
        ends[link] = motion @ ends[link]
        for target, move in link_motions:
            if isinstance(target, Place) and target.is_seat:
                motion = motion @ move
    return Deflection(poses, ends, bending)


def _link(target: Target) -> int:
    """Return the chain link of a target; for a joint value the link moved by the joint."""
    return target.joint + 1 if isinstance(target, JointValue) else target.link


def _growth(slopes: Array) -> float:
    """Return the growth per round of loads of the fastest growing displacement; unstable from 1 on."""
    return float(np.linalg.eigvals(slopes).real.max(initial=0.0))


_MOST_PRODUCTS: Final = 200
"""Maximum number of products in the last sum, the largest; their number grows with the square of the number of loads."""
_LONGEST_PRODUCT: Final = 32
"""Maximum number of operations in such a product, each of which takes time in every sample."""


def terms_about_rest(state: RestState) -> tuple[Term, ...]:
    """Return the terms about v*; those not caused by loads are unchanged."""
    feedback, table = state.feedback, state.table
    reacting = np.flatnonzero(feedback.loaded & state.moving)
    if not reacting.size:
        return state.terms
    directions = feedback.list_directions(table)
    term_slopes = feedback.term_slopes(state.displacements, directions)
    slopes = feedback.slopes(term_slopes, directions)
    growth = _growth(slopes)
    if growth >= 1.0:
        raise InputError(_BUCKLES.format(1 / growth))
    gain = np.asarray(np.linalg.inv(np.eye(len(directions)) - slopes), dtype=float)
    flat = directions.reshape(len(directions), -1)
    extra_gain = flat.T @ (gain - np.eye(len(directions))) @ flat
    slots = len(extra_gain) // 6
    sums = _first_order_twists(state, reacting, extra_gain.reshape(slots, 6, slots, 6).transpose(0, 2, 1, 3))
    for slot, twist, factors in _second_order_twists(state, directions, gain, term_slopes):
        sums[slot, factors] = sums.get((slot, factors), 0.0) + twist
    terms = [term for term in state.terms if not term.loaded]
    for (slot, factors), twist in sums.items():
        target = table.targets[slot % len(table.targets)]
        terms.append(Term.of(target, on_target(target, state.posture.chain, twist), *factors, loaded=True))
    return tuple(terms)


def _first_order_twists(state: RestState, reacting: NDArray[np.intp], gain: Array) -> dict[tuple[int, Factors], Array]:
    """Return the twists of ``G(v*, x) + (A - I)(G(v*, x) - v*)`` in the slots displaced by loads, by their factors."""
    # `added` `(2K, 2K, 6, 6)` is A - I: the further displacement in the first slot per displacement in the second
    sums: dict[tuple[int, Factors], Array] = {}
    for source, twist, term in zip(state.slots.tolist(), state.table.twists, state.terms, strict=True):
        if term.loaded and not term.target.is_bow:
            sums[source, term.factors] = sums.get((source, term.factors), 0.0) + twist
        for slot in reacting.tolist():
            sums[slot, term.factors] = sums.get((slot, term.factors), 0.0) + gain[slot, source] @ twist
    for slot in reacting.tolist():
        sums[slot, ()] = sums.get((slot, ()), 0.0) - np.einsum("lij,lj->i", gain[slot], state.displacements)
    return sums


def _second_order_twists(
    state: RestState, directions: Array, gain: Array, term_slopes: Array
) -> list[tuple[int, Array, Factors]]:
    """Return the last sum expanded: slot, twist, factors."""
    table = state.table
    twists: dict[Factors, Array] = {}
    slopes: dict[tuple[int, Factors], Array] = {}
    for row, (slot, term) in enumerate(zip(state.slots.tolist(), state.terms, strict=True)):
        if term.loaded and term.factors:
            total = twists.setdefault(term.factors, np.zeros((2 * len(table.targets), 6)))
            total[slot] += table.twists[row]
            if not term.target.is_bow:
                slopes[slot, term.factors] = slopes.get((slot, term.factors), 0.0) + term_slopes[row]
    rank = {factors: k for k, factors in enumerate(twists)}
    mean = state.feedback.products(state.terms)
    responses = {factors: gain @ np.einsum("mki,ki->m", directions, twist) for factors, twist in twists.items()}
    lengths = {factors: sum(operations(factor) + 1 for factor in factors) for factors in twists}
    # a product with too many factors for a term becomes a formula, which takes time in every sample
    pairs = [
        (slot, factors, others)
        for slot, factors in slopes
        for others in responses
        if lengths[factors] + lengths[others] <= _LONGEST_PRODUCT
    ]
    added = [slopes[slot, factors] @ responses[others] for slot, factors, others in pairs]
    sizes = [
        np.linalg.norm(table.sensitivities[slot % len(table.targets)] @ twist) * abs(mean[factors] * mean[others])
        for (slot, factors, others), twist in zip(pairs, added, strict=True)
    ]
    result: list[tuple[int, Array, Factors]] = []
    # in the order of the terms, not by size, so that the order is equal at all poses
    for k in sorted(np.argsort(sizes)[::-1][:_MOST_PRODUCTS].tolist()):
        (slot, factors, others), twist = pairs[k], added[k]
        first, second = sorted((factors, others), key=rank.__getitem__)
        result += [
            (slot, twist, (*first, *second)),
            (slot, -twist * mean[others], factors),
            (slot, -twist * mean[factors], others),
            (slot, twist * mean[factors] * mean[others], ()),
        ]
    return result


_TRIED: Final = 1000
_TRIED_RANKS: Final = ((9, 0.005), (0, 0.02))
"""Test of equilibrium statics on single robots: number of robots; ranks by error, with the allowed difference.

Only the robots of these ranks, the 99 % quantile and the maximum, are solved individually, which takes time.
"""
_NEGLIGIBLE: Final = 1e-9
"""Difference of errors (m, rad) that never causes a warning: a thousandth of the smallest tolerances."""

_LARGEST_TURN: Final = 0.15
"""Rotation of a link's end by loads (rad) that causes a warning: a cantilever's deflection is then wrong by 0.4 %."""


def statics_findings(
    at: PoseModel, statics: Literal["nominal", "equilibrium"], sources: Sequence[BoundSource]
) -> tuple[Finding, ...]:
    """Return the warnings of a pose; see :meth:`precision_pin.model.error_model.ErrorModel.statics_findings`."""
    if not any(term.loaded for term in at.terms):
        return ()
    if statics == "nominal":
        findings = _nominal_findings(at, sources)
    else:
        findings = (*_equilibrium_findings(at, sources), *_resettled_findings(at, sources))
    return (*_bending_findings(at), *findings)


def _nominal_findings(at: PoseModel, sources: Sequence[BoundSource]) -> tuple[Finding, ...]:
    spread, negligible = spread_of(at)
    try:
        rest_state = solve_equilibrium(at.posture, at.space, sources, within=1e-3 * negligible)
    except InputError as error:
        # a separate code: accepting that the arm rests elsewhere does not imply accepting that it never rests
        return (Finding("warning", "W_NO_REST", f"{error.findings[0].message}; nominal statics hide it"),)
    gap = float(np.linalg.norm((rest_state.alone(at.posture, at.space).error_at_means - at.error_at_means)[:3]))
    if gap <= negligible:
        return ()
    message = (
        f"loads at the undeflected pose (statics: nominal) put the tip {gap * 1e3:.3g} mm away from that of the arm at "
        f"rest, more than a tenth of the spread of {spread * 1e3:.3g} mm; use statics: equilibrium"
    )
    return (Finding("warning", "W_STATICS", message),)


def _equilibrium_findings(at: PoseModel, sources: Sequence[BoundSource]) -> tuple[Finding, ...]:
    x = at.space.sample(_SEED, 0, _TRIED)
    errors = at.exact(x)
    differences: dict[str, str] = {}
    for rank, allowed in _TRIED_RANKS:
        for rows, label, unit in ((slice(0, 3), "|d|", "mm"), (slice(3, 6), "|δ|", "mrad")):
            sizes = np.linalg.norm(errors[rows], axis=0)
            robot = int(np.argsort(-sizes, kind="stable")[rank])
            try:
                rest_state = solve_equilibrium(at.posture, at.space, sources, values=x[:, robot])
            except InputError as error:
                message = f"of {_TRIED:,} robots the one with {label} {1e3 * sizes[robot]:.3g} {unit} fails: "
                return (Finding("warning", "W_STATICS", message + error.findings[0].message),)
            robot_error = rest_state.alone(at.posture, at.space).exact(x[:, [robot]])[:, 0]
            size = float(np.linalg.norm(robot_error[rows]))
            if abs(sizes[robot] - size) > allowed * size + _NEGLIGIBLE:
                differences[label] = f"{label} {1e3 * sizes[robot]:.4g} {unit} for {1e3 * size:.4g}"
    if not differences:
        return ()
    message = (
        f"stiffness or load vary too much for equilibrium statics: compared with {_TRIED:,} robots solved one by one "
        f"the model gives {' and '.join(differences.values())}"
    )
    return (Finding("warning", "W_STATICS", message),)


def _bending_findings(at: PoseModel) -> tuple[Finding, ...]:
    """Return a warning if loads, at the means, rotate a place too far; it names the place with the largest rotation."""
    loaded = TermTable.build(at.posture, at.space, [term for term in at.terms if term.loaded])
    rotations = loaded.displacements(loaded.products(loaded.program.evaluate(at.space.mean[:, None])))[:, 3:, 0]
    angles = {
        target.name: float(np.linalg.norm(angle))
        for target, angle in zip(loaded.targets, rotations, strict=True)
        if isinstance(target, Place)
    }
    name, angle = max(angles.items(), key=lambda entry: entry[1], default=("", 0.0))
    if angle <= _LARGEST_TURN:
        return ()
    message = (
        f"loads rotate the {name} by {angle:.2g} rad: formulas for small deflections are wrong by about "
        f"{20 * angle**2:.1g} % of the deflection"
    )
    return (Finding("warning", "W_DEFLECTION", message),)


TRIED_SIDES: Final = 4096
"""Robots for counting the fraction with reversed flanks: a fraction of ``_FEWEST`` is four robots."""
_SEED: Final = 0
"""Seed of the robots in tests of the statics: the default seed, so that findings do not depend on options."""
_FEWEST: Final = 1e-3
"""Smallest fraction of robots that triggers a warning; smaller ones do not change quantiles up to 99.73 %."""
MOST_SIDES: Final = 6
"""Maximum number of flanks of which all combinations, 64, are evaluated."""


def fixed_sides(at: PoseModel) -> PoseModel:
    """Return the model with the play of every robot on the side at the means of all parameters."""
    signs = _signs(at)
    return _with_sides(at, dict(zip(signs, _at_means(at, signs), strict=True))) if signs else at


def side_variants(at: PoseModel) -> tuple[PoseModel, ...]:
    """Return the model with every combination of up to six sides; with more sides, only the model at the means."""
    signs = _signs(at)
    if not signs:
        return (at,)
    if len(signs) > MOST_SIDES:
        return (fixed_sides(at),)
    choices = np.stack(np.meshgrid(*[[1.0, -1.0]] * len(signs)), axis=-1).reshape(-1, len(signs))
    return tuple(_with_sides(at, dict(zip(signs, choice.tolist(), strict=True))) for choice in choices)


def turnover_findings(at: PoseModel) -> tuple[Finding, ...]:
    """Return a warning if loads reverse the flank in some robots, which the model at the means ignores."""
    # some: at least one in a thousand of the 4,096 sampled robots
    signs = _signs(at)
    if not signs:
        return ()
    x = at.space.sample(_SEED, 0, TRIED_SIDES)
    flips = Program.compile(signs, at.space.index).evaluate(x) != np.array(_at_means(at, signs))[:, None]
    fraction = float(flips.any(axis=0).mean())
    if fraction < _FEWEST:
        return ()
    reversed_signs = {sign for sign, share in zip(signs, flips.mean(axis=1), strict=True) if share >= _FEWEST}
    names = at.posture.chain.joint_names
    places = {
        names[term.target.joint] if isinstance(term.target, JointValue) else term.target.name
        for term in at.terms
        if reversed_signs & set(signs_of(term.factors))
    }
    shifts = np.linalg.norm((at.linear(x) - fixed_sides(at).linear(x))[:3], axis=0)
    message = (
        f"at {', '.join(sorted(places))} the load of {100 * fraction:.2g} % of robots takes up play on another side than the "
        f"mean load, which moves the tip by up to {1e3 * float(shifts.max()):.3g} mm; first-order results use the side of "
        "the mean load, samples the side of each robot"
    )
    return (Finding("warning", "W_TURNOVER", message),)


def _resettled_findings(at: PoseModel, sources: Sequence[BoundSource]) -> tuple[Finding, ...]:
    """Return a warning if robots solved one by one take up play on other sides than in equilibrium statics."""
    # In equilibrium statics, loads act on the arm at rest under the mean loads, with a robot's deflections to first
    # order. The tested robot is as close to a flank reversal as the closest 1 % of a thousand.
    signs = _signs(at)
    if not signs:
        return ()
    x = at.space.sample(_SEED, 0, _TRIED)
    margins = Program.compile([sign.arguments[0] for sign in signs], at.space.index).evaluate(x)  # type: ignore[attr-defined]
    spreads = margins.std(axis=1, keepdims=True)
    closest = np.abs(margins / np.where(spreads > 0, spreads, np.inf)) + np.where(spreads > 0, 0.0, np.inf)
    robot = int(np.argsort(closest.min(axis=0), kind="stable")[_TRIED // 100 - 1])
    try:
        rest_state = solve_equilibrium(at.posture, at.space, sources, values=x[:, robot])
    except InputError as error:
        message = f"of {_TRIED:,} robots one close to a flank reversal fails: {error.findings[0].message}"
        return (Finding("warning", "W_STATICS", message),)
    rest_signs = _signs(replace(at, terms=rest_state.terms, table=rest_state.table))
    sides, rest_sides = (Program.compile(s, at.space.index).evaluate(x[:, [robot]]) for s in (signs, rest_signs))
    if len(rest_signs) != len(signs) or (sides == rest_sides).all():
        return ()
    message = (
        "the load of each robot changes with its deflection, which equilibrium statics neglects for the side of play: 1 % of "
        "robots or more are on another side than if solved one by one"
    )
    return (Finding("warning", "W_TURNOVER", message),)


def _signs(at: PoseModel) -> list[Expression]:
    return list(dict.fromkeys(sign for term in at.terms for sign in signs_of(term.factors)))


def _at_means(at: PoseModel, signs: list[Expression]) -> list[float]:
    return Program.compile(signs, at.space.index).evaluate(at.space.mean[:, None])[:, 0].tolist()


def _with_sides(at: PoseModel, sides: dict[Expression, float]) -> PoseModel:
    terms = tuple(
        replace(term, factors=tuple(fix_signs(factor, sides) for factor in term.factors)) for term in at.terms
    )
    return replace(at, table=TermTable.build(at.posture, at.space, terms), terms=terms)
