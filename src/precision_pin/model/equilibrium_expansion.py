"""The terms of an arm at rest under its loads, as functions of the parameters.

About the rest state v* at the parameters' means, with A = (I - ∂G/∂v)⁻¹ there (G: :mod:`precision_pin.model.equilibrium`),

    v(x) = v* + A (G(v*, x) - v*) + Σ (f - f̄) S_f A Σ (h - h̄) t_h

keeps every term with its factors: 1/k stays 1/k, and products of load and stiffness stay products. The last sum is the
change of the feedback itself with the parameters: f and h are the products of factors of terms caused by loads, t_h their
twists and S_f the slopes of these. The derivative of v(x) at the means equals that of the arm solved again; the neglected
terms are of third order.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.draws.expressions import operations
from precision_pin.model.equilibrium import Settled, refuse_buckling
from precision_pin.robot.chain import Posture
from precision_pin.robot.loads import Factors
from precision_pin.robot.places import Place
from precision_pin.terms.term import Target, Term

_MOST_PRODUCTS: Final = 200
"""Largest number of products kept of the last sum, the largest first; it grows with the square of the number of loads."""
_LONGEST_PRODUCT: Final = 32
"""Largest number of operations in such a product."""


def terms_about_rest(settled: Settled) -> tuple[Term, ...]:
    """Return the terms about v*; those not caused by loads are unchanged.

    Parameters
    ----------
    settled
        The arm at rest with every parameter at its mean.

    Raises
    ------
    InputError
        The arm buckles: its rest state is not stable.
    """
    feedback, table = settled.feedback, settled.table
    reacting = np.flatnonzero(feedback.loaded)
    if not reacting.size:
        return settled.terms
    ways = feedback.ways(table)
    term_slopes = feedback.term_slopes(settled.displacements, ways)
    slopes = feedback.slopes(term_slopes, ways)
    refuse_buckling(slopes)
    gain = np.asarray(np.linalg.inv(np.eye(len(ways)) - slopes), dtype=float)
    flat = ways.reshape(len(ways), -1)
    added = flat.T @ (gain - np.eye(len(ways))) @ flat
    slots = len(added) // 6
    sums = _first_order_twists(settled, reacting, added.reshape(slots, 6, slots, 6).transpose(0, 2, 1, 3))
    for slot, twist, factors in _second_order_twists(settled, ways, gain, term_slopes):
        sums[slot, factors] = sums.get((slot, factors), 0.0) + twist
    return (
        *(term for term in settled.terms if not term.loaded),
        *(
            _term(table.targets[slot % len(table.targets)], twist, settled.posture, factors)
            for (slot, factors), twist in sums.items()
        ),
    )


def _first_order_twists(settled: Settled, reacting: NDArray[np.intp], added: Array) -> dict[tuple[int, Factors], Array]:
    """Return the twists of ``G(v*, x) + (A - I)(G(v*, x) - v*)`` in the slots displaced by loads, by their factors.

    ``added`` ``(2K, 2K, 6, 6)`` is A - I: the further displacement in the first slot per displacement in the second.
    """
    sums: dict[tuple[int, Factors], Array] = {}
    for source, twist, term in zip(settled.slots.tolist(), settled.table.twists, settled.terms, strict=True):
        if term.loaded:
            sums[source, term.factors] = sums.get((source, term.factors), 0.0) + twist
        for slot in reacting.tolist():
            key = (slot, term.factors)
            sums[key] = sums.get(key, 0.0) + added[slot, source] @ twist
    for slot in reacting.tolist():
        sums[slot, ()] = sums.get((slot, ()), 0.0) - np.einsum("lij,lj->i", added[slot], settled.displacements)
    return sums


def _second_order_twists(
    settled: Settled, ways: Array, gain: Array, term_slopes: Array
) -> list[tuple[int, Array, Factors]]:
    """Return the last sum multiplied out: slot, twist, factors."""
    table = settled.table
    twists: dict[Factors, Array] = {}
    slopes: dict[tuple[int, Factors], Array] = {}
    for row, (slot, term) in enumerate(zip(settled.slots.tolist(), settled.terms, strict=True)):
        if term.loaded and term.factors:
            share = twists.setdefault(term.factors, np.zeros((2 * len(table.targets), 6)))
            share[slot] += table.twists[row]
            slopes[slot, term.factors] = slopes.get((slot, term.factors), 0.0) + term_slopes[row]
    rank = {factors: k for k, factors in enumerate(twists)}
    mean = settled.feedback.products(settled.terms)
    responses = {factors: gain @ np.einsum("mki,ki->m", ways, twist) for factors, twist in twists.items()}
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
    # in their own order instead of by size, so that the order of terms is the same at every pose
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


def _term(target: Target, displacement: Array, posture: Posture, factors: Factors) -> Term:
    if isinstance(target, Place):
        return Term.of(target, displacement, *factors, loaded=True)
    axis = posture.chain.axes[target.joint]
    rows = slice(0, 3) if posture.chain.prismatic[target.joint] else slice(3, 6)
    return Term.of(target, axis @ displacement[rows], *factors, loaded=True)
