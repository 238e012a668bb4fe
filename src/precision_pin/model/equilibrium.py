"""Statics on the deflected arm: loads re-evaluated where the arm comes to rest.

``v = G(v, x)`` with v the displacements of all targets and G what the terms say, for parameters x, when the loads hang on
the arm displaced by v. Displacements are kept in *slots*, two of a target: of K targets the first K hold what no load
causes, the second K what loads cause, which is how links bend.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin import se3
from precision_pin.draws.space import Space
from precision_pin.errors import InputError, InternalError
from precision_pin.robot.chain import Deflection, Factors, Place, Posture
from precision_pin.terms.table import TableLayout, TermTable
from precision_pin.terms.term import JointValue, Target, Term
from precision_pin.typing import Array

__all__ = ["Feedback", "Settled", "refuse_buckling", "settle"]

MakeTerms = Callable[[Posture], Sequence[Term]]
"""Makes the terms of all sources at a posture."""

SETTLED: Final = 1e-13
"""Change of the displacements (m, rad) below which the arm is at rest."""
STEP: Final = 1e-7
"""Step (m, rad) of the differences of G: the smaller its curvature's error, the larger that of rounding, both 1e-9."""

_NOISE: Final = 1e-8
"""Slope (1/m, 1/rad) of a term's twist over the twist, below which it is the rounding of the differences."""

_PUSH: Final = 1e-6
"""Displacement (m, rad) aside from which the search for rest begins, so that it leaves a rest that is not stable."""
_SHRINKS: Final = 0.5
"""Largest ratio of one change to the change before at which loads and deflections are computed in turn."""
_MOST_ROUNDS: Final = 100
_MOST_CORRECTIONS: Final = 12
_MOST_STEPS: Final = 500
_SMALLEST_STEP: Final = 1e-7
"""Of the loads, as a share of what they are."""
_SHORT_STEP: Final = 0.1
"""Of the load at which the undeflected arm buckles, up to one and a half times that."""
_PAST: Final = 1.5
_LONGEST_LEAP: Final = 0.3
_LARGEST_SURPRISE: Final = 0.1
"""Largest displacement (m, rad) in one step of the loads, and difference between the expected one and where it led."""
_NEAR_BUCKLING: Final = 0.9
"""Growth of a displacement from one round of loads to the next above which a rest hardly resists a push."""
_BUCKLES: Final = (
    "the arm buckles under its loads: beyond {:.3g} times these it has no stable rest, "
    "so equilibrium statics has no answer"
)
_TO_AND_FRO: Final = (
    "the arm does not come to rest under its loads: at {} loads it goes to and fro, as where crossing a backlash or "
    "clearance turns its load over; a wider band decides"
)
_ROUNDING: Final = 1e-13
_NO_WAY: Final = 1e-9
"""Share of a place's largest singular value below which its terms do not move it that way."""


@final
@dataclass(frozen=True, eq=False)
class Settled:
    """The arm at rest under its loads, for one value of every parameter.

    Attributes
    ----------
    posture
        The posture with its loads on the deflected arm.
    terms
        The terms there.
    table
        Their table.
    displacements
        v*, of the slots of the table's targets, ``(2K, 6)``.
    feedback
        G about v*.
    """

    posture: Posture
    terms: tuple[Term, ...]
    table: TermTable
    displacements: Array
    feedback: Feedback

    @property
    def slots(self) -> NDArray[np.intp]:
        """The slot that each term displaces, ``(T,)``."""
        loaded = np.array([term.loaded for term in self.terms], dtype=np.intp)
        return self.table.target + len(self.table.targets) * loaded


def settle(
    posture: Posture, space: Space, make_terms: MakeTerms, within: float = SETTLED, values: Array | None = None
) -> Settled:
    """Return the arm at rest under its loads.

    Loads and deflections are computed in turn. Where they do not converge quickly, the loads are raised from nothing in
    steps, and the arm follows by Newton's method: it is refused only where no stable rest is left.

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
    values
        Of the components, ``(d,)``; their means if left out.

    Raises
    ------
    InputError
        The arm buckles before its loads are reached, or goes to and fro.
    """
    feedback = Feedback(posture, space, make_terms, space.mean if values is None else values)
    aside = max(_PUSH, 100 * within) * feedback.loaded[:, None]
    current, change = feedback.at_start + aside, np.inf
    for _ in range(_MOST_ROUNDS):
        following = feedback(current)
        before, change = change, float(np.abs(following - current).max(initial=0.0))
        current = following
        if change < within:
            return feedback.settled(current)
        if not change <= _SHRINKS * before:
            break
    return feedback.settled(_follow_loads(feedback, within))


@final
class Feedback:
    """G: the displacements that the terms say, parameters given, when the loads hang on the arm displaced by v.

    Attributes
    ----------
    at_start
        Displacements that the terms say on the undisplaced arm, ``(2K, 6)``.
    loaded
        Which slots loads displace, ``(2K,)``.
    """

    def __init__(self, posture: Posture, space: Space, make_terms: MakeTerms, values: Array) -> None:
        self._posture, self._space, self._make_terms, self._values = posture, space, make_terms, values
        self._table = TermTable.build(posture, space, make_terms(posture))
        # a deflection of zero, since terms of bent links belong to deflected arms only
        terms = self._terms(np.zeros((2 * len(self._table.targets), 6)))
        self._arrange(terms)
        self._table = self._layout.at(posture, terms)
        self.at_start = self._sum(terms)
        self.loaded = np.zeros(len(self.at_start), dtype=bool)
        self.loaded[self._slots[self._is_loaded]] = True

    def __call__(self, displacements: Array) -> Array:
        """Return G, ``(2K, 6)``, for displacements ``(2K, 6)``."""
        return self._sum(self._terms(displacements))

    def settled(self, displacements: Array) -> Settled:
        """Return the arm at rest where its displacements are known."""
        posture = self._displaced(displacements)
        terms = tuple(self._make_terms(posture))
        table = TermTable.build(posture, self._space, terms)
        return Settled(posture, terms, table, self._sum(terms), self)

    def ways(self, table: TermTable) -> Array:
        """Return the ways in which slots can change, ``(M, 2K, 6)``.

        Of what loads cause, one for a joint value and six for a place; of what they do not, those of its terms.
        """
        chain, ways, targets = self._posture.chain, [], table.targets
        for slot in range(2 * len(targets)):
            target = targets[slot % len(targets)]
            twists = table.twists[self._slots == slot]
            if not len(twists):
                continue
            if isinstance(target, JointValue):
                own = np.zeros((1, 6))
                own[0, slice(0, 3) if chain.prismatic[target.joint] else slice(3, 6)] = chain.axes[target.joint]
            elif self.loaded[slot]:
                own = np.eye(6)
            else:
                _, sizes, rows = np.linalg.svd(twists, full_matrices=False)
                own = rows[sizes > _NO_WAY * sizes.max(initial=0.0)]
            for way in own:
                ways.append(np.zeros((2 * len(targets), 6)))
                ways[-1][slot] = way
        return np.array(ways).reshape(-1, 2 * len(targets), 6)

    def term_slopes(self, displacements: Array, ways: Array) -> Array:
        """Return the derivatives of all terms' twists for a step along every way, ``(T, 6, M)``.

        Raises
        ------
        InputError
            A step takes the load of a backlash or clearance over the edge of its band.
        """
        here = self._terms(displacements)
        chain, changes = self._posture.chain, []
        twists = self._layout.twists(chain, here)
        for way in ways:
            there = self._terms(displacements + STEP * way)
            if not self._layout.fits(there):
                raise InputError(_TO_AND_FRO.format("these"))
            changes.append((self._layout.twists(chain, there) - twists) / STEP)
        slopes = np.moveaxis(np.array(changes), 0, -1)
        noise = _NOISE * np.abs(twists).max(axis=1, initial=0.0)
        return np.where(np.abs(slopes) > noise[:, None, None], slopes, 0.0)

    def slopes(self, term_slopes: Array, ways: Array) -> Array:
        """Return ∂G/∂v of what loads cause, ``(M, M)``: along every way, for a step along every way."""
        result = np.zeros((len(self.loaded), 6, len(ways)))
        rows = self._is_loaded
        np.add.at(result, self._slots[rows], self._products[rows, None, None] * term_slopes[rows])
        slopes: Array = np.einsum("mki,kin->mn", ways, result)
        return slopes

    def products(self, terms: tuple[Term, ...]) -> dict[Factors, float]:
        """Return the product of each term's factors, by the factors, for terms as they are at rest."""
        return {term.factors: float(product) for term, product in zip(terms, self._products, strict=True)}

    @property
    def loaded_ways(self) -> Array:
        """The ways in which what loads cause can change, ``(M, 2K, 6)``."""
        ways = self.ways(self._table)
        return ways[ways[:, self.loaded].any(axis=(1, 2))]

    def _terms(self, displacements: Array) -> tuple[Term, ...]:
        return tuple(self._make_terms(self._displaced(displacements)))

    def _displaced(self, displacements: Array) -> Posture:
        return replace(self._posture, deflection=deflected(self._posture, self._table, displacements))

    def _arrange(self, terms: tuple[Term, ...]) -> None:
        """Compute what depends on the terms' targets and factors only."""
        self._layout = TableLayout.of(terms, self._space)
        padded = np.append(self._layout.program.evaluate(self._values[:, None])[:, 0], 1.0)
        self._products = padded[self._layout.factors].prod(axis=1)
        self._is_loaded = np.array([term.loaded for term in terms], dtype=bool)
        self._slots = self._layout.target + len(self._layout.targets) * self._is_loaded

    def _sum(self, terms: tuple[Term, ...]) -> Array:
        if not self._layout.fits(terms):
            known = self._layout.targets
            self._arrange(terms)  # such as where a load changes the side of a backlash
            if self._layout.targets != known:
                raise InternalError("a source's terms come and go with the deflection of the arm")
        total = np.zeros((2 * len(self._layout.targets), 6))
        np.add.at(total, self._slots, self._layout.twists(self._posture.chain, terms) * self._products[:, None])
        return total


def _follow_loads(feedback: Feedback, within: float) -> Array:
    """Return the displacements of the arm at rest, followed while the loads are raised from nothing to what they are.

    With a share s of the loads, ``z = s g(z)``, z the displacements that loads cause. A step of s is halved where Newton's
    method does not lead from the tangent's guess to a stable rest nearby.
    """
    path = _Path.begin(feedback)
    first_growth = _growth(path.slopes)
    # an arm that leans bends past the load at which the straight one buckles: short steps do not miss it on the way
    short = _SHORT_STEP / first_growth if first_growth >= 1.0 else 1.0
    step = short
    for _ in range(_MOST_STEPS):
        share = min(1.0, path.share + step)
        further = path.followed_to(share, within)
        if further is None and step < _SMALLEST_STEP:
            break
        if further is None:
            step = (share - path.share) / 2
            continue
        path, step = further, 2 * step if share > _PAST * short / _SHORT_STEP else min(2 * step, short)
        if first_growth >= 1.0 and share * _growth(path.slopes) > _NEAR_BUCKLING:
            raise InputError(_BUCKLES.format(1 / first_growth))
        if share == 1.0:
            return path.displacements
    if path.share * _growth(path.slopes) > _NEAR_BUCKLING:
        raise InputError(_BUCKLES.format(path.share))
    raise InputError(_TO_AND_FRO.format(f"{path.share:.3g} times the"))


@final
@dataclass(frozen=True, eq=False)
class _Path:
    """An arm at rest under a share of its loads.

    Attributes
    ----------
    feedback, ways
        G, and the M ways in which its loaded targets move.
    share
        Of the loads.
    others
        Displacements that no load causes, ``(2K, 6)``.
    moved
        z along every way, ``(M,)``.
    pull, slopes
        g(z) along every way, ``(M,)``, and ∂g/∂z, ``(M, M)``, under all loads.
    """

    feedback: Feedback
    ways: Array
    share: float
    others: Array
    moved: Array
    pull: Array
    slopes: Array

    @classmethod
    def begin(cls, feedback: Feedback) -> _Path:
        """Return the arm without its loads."""
        ways = feedback.loaded_ways
        return cls.at(feedback, ways, 0.0, feedback.at_start, np.zeros(len(ways)))

    @classmethod
    def at(cls, feedback: Feedback, ways: Array, share: float, others: Array, moved: Array) -> _Path:
        """Return the arm with displacements, whether or not it rests there."""
        others = np.where(feedback.loaded[:, None], 0.0, others)
        displacements = others + np.einsum("m,mki->ki", moved, ways)
        reaction = feedback(displacements)
        slopes = feedback.slopes(feedback.term_slopes(displacements, ways), ways)
        return cls(feedback, ways, share, reaction, moved, np.einsum("mki,ki->m", ways, reaction), slopes)

    @property
    def displacements(self) -> Array:
        """Of all slots, ``(2K, 6)``."""
        others = np.where(self.feedback.loaded[:, None], 0.0, self.others)
        displacements: Array = others + np.einsum("m,mki->ki", self.moved, self.ways)
        return displacements

    def followed_to(self, share: float, within: float) -> _Path | None:
        """Return the arm at rest under another share of its loads, none where no stable rest is near the tangent's guess."""
        try:
            return self._corrected(share, within)
        except np.linalg.LinAlgError:  # just where it buckles
            return None

    def _corrected(self, share: float, within: float) -> _Path | None:
        guess = self.moved + (share - self.share) * np.linalg.solve(self._stiffness(self.share), self.pull)
        if not np.abs(guess - self.moved).max() < _LONGEST_LEAP:
            return None
        at = _Path.at(self.feedback, self.ways, share, self.others, guess)
        for _ in range(_MOST_CORRECTIONS):
            correction = np.linalg.solve(at._stiffness(share), share * at.pull - at.moved)
            if not np.abs(at.moved + correction - guess).max() < _LARGEST_SURPRISE:
                return None
            at = _Path.at(self.feedback, self.ways, share, at.others, at.moved + correction)
            if np.abs(correction).max() < max(within, _ROUNDING * np.abs(at.moved).max()):
                return at if share * _growth(at.slopes) < 1.0 else None
        return None

    def _stiffness(self, share: float) -> Array:
        return np.eye(len(self.ways)) - share * self.slopes


def deflected(posture: Posture, table: TermTable, displacements: Array) -> Deflection:
    """Return where the chain stands with all slots displaced, ``(2K, 6)``."""
    unloaded, by_loads = displacements.reshape(2, -1, 6)
    poses, ends = posture.link_poses.copy(), posture.link_poses @ posture.chain.placements
    moves = np.moveaxis(se3.displacement((unloaded + by_loads).T), -1, 0)
    back = np.moveaxis(se3.inverse(np.moveaxis(table.frames, 0, -1)), -1, 0)
    bending = np.zeros((len(poses), 6))
    moved = list(zip(table.targets, table.frames @ moves @ back, strict=True))
    for target, share in zip(table.targets, by_loads, strict=True):
        if isinstance(target, Place) and target == posture.chain.end(target.link):
            bending[target.link] = share
    motion = np.eye(4)
    for link in range(len(poses)):
        own = [(target, move) for target, move in moved if _link(target) == link]
        for target, move in own:
            if isinstance(target, JointValue) or target.is_start:
                motion = motion @ move
        poses[link] = motion @ poses[link]
        for target, move in own:
            if isinstance(target, Place) and not target.is_start and not target.is_seat:
                motion = motion @ move
        ends[link] = motion @ ends[link]
        for target, move in own:
            if isinstance(target, Place) and target.is_seat:
                motion = motion @ move
    return Deflection(poses, ends, bending)


def _link(target: Target) -> int:
    """Return the chain link that a target belongs to: of a joint value the one that the joint moves."""
    return target.joint + 1 if isinstance(target, JointValue) else target.link


def _growth(slopes: Array) -> float:
    """Return by how much the fastest growing displacement grows from one round of loads to the next; unstable from 1 on."""
    return float(np.linalg.eigvals(slopes).real.max(initial=0.0))


def refuse_buckling(slopes: Array) -> None:
    """Raise an error where a rest is not stable, for ∂G/∂v there.

    Raises
    ------
    InputError
        The arm buckles.
    """
    growth = _growth(slopes)
    if growth >= 1.0:
        raise InputError(_BUCKLES.format(1 / growth))
