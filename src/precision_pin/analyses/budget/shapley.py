"""Shapley values: fair division of a joint result among its contributors.

Source: Shapley, A value for n-person games (1953); as shares of a variance: Owen, SIAM/ASA Journal on Uncertainty
Quantification 2 (2014); for correlated inputs: Song, Nelson and Staum, ibid. 4 (2016), Owen and Prieur, ibid. 5 (2017).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError

MOST_PLAYERS: Final = 12
"""Largest number of players: all 2^n coalitions are evaluated."""

DEPENDENT: Final = 1e-12
"""Eigenvalues of a correlation matrix below this belong to linearly dependent numbers."""

# relative deviation of a number given those before it, above which no eigenvalue can be that small
_INDEPENDENT: Final = 1e-4


def values(players: int, worth: Callable[[tuple[int, ...]], Array]) -> Array:
    """Return the exact Shapley value of each player, ``(n, …)``, from all coalitions; they sum to v(all) - v(none).

    φ_i = Σ over S without i of |S|! (n - |S| - 1)! / n! · (v(S ∪ i) - v(S)).

    Args:
        players: Number of players, n.
        worth: Function v of a coalition (ascending players, possibly empty); its values have one shape.

    Raises:
        InputError: There are more than twelve players.
    """
    if players > MOST_PLAYERS:
        raise InputError(f"{players} players for a Shapley value; at most {MOST_PLAYERS} are allowed")
    result: Array = np.zeros((players, *np.shape(worth(()))))
    for size in range(players + 1):
        # v(S) is used once for each member, as the worth of S without it and with it
        as_member, as_other = (
            1 / (players * math.comb(players - 1, others)) if 0 <= others < players else 0.0
            for others in (size - 1, size)
        )
        for coalition in itertools.combinations(range(players), size):
            value = worth(coalition)
            for player in range(players):
                result[player] += value * (as_member if player in coalition else -as_other)
    return result


def explained(slopes: Array, covariance: Array, known: Sequence[int]) -> Array:
    """Return the covariance ``(m, m)`` of linear outputs that some inputs explain.

    v(S) = w Σ_·S Σ_SS⁺ Σ_S· wᵀ is the covariance of the best linear prediction: Cov(E[y | x_S]) for normal inputs.

    Args:
        slopes: ``(m, d)`` derivatives of the outputs with respect to the inputs.
        covariance: ``(d, d)`` covariance of the inputs; it may be singular.
        known: Columns of the known inputs.
    """
    rows = [k for k in known if covariance[k, k] > 0]
    if not rows:
        return np.zeros((len(slopes),) * 2)
    scale = np.sqrt(np.diag(covariance)[rows])
    cross = slopes @ covariance[:, rows] / scale
    correlation = covariance[np.ix_(rows, rows)] / np.outer(scale, scale)
    try:
        factor = np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        factor = np.zeros((1, 1))
    if factor.diagonal().min() > _INDEPENDENT:
        half = np.linalg.solve(factor, cross.T)  # a tenth of the time of the pseudo-inverse
        return np.asarray(half.T @ half)
    inverse = np.linalg.pinv(correlation, rcond=DEPENDENT, hermitian=True)
    return cross @ inverse @ cross.T


def effects(slopes: Array, covariance: Array, groups: Sequence[Sequence[int]]) -> Array:
    """Return the Shapley effects ``(groups, m)`` of groups of inputs, by columns, on the variances of linear outputs.

    Their sum is the variance explained by all groups. Without correlation between groups they are the variance shares.
    """
    return values(
        len(groups),
        lambda coalition: explained(slopes, covariance, [k for member in coalition for k in groups[member]]).diagonal(),
    )


def effect_forms(covariance: Array, groups: Sequence[Sequence[int]]) -> Array:
    """Return the Shapley effects of groups of inputs as quadratic forms of any output's slopes, ``(groups, d, d)``.

    With form Φ_g, a group's effect on the variance of an output with slopes w is w Φ_g wᵀ; Σ Φ_g is the covariance.
    """
    slopes = np.eye(len(covariance))
    return values(
        len(groups),
        lambda coalition: explained(slopes, covariance, [k for member in coalition for k in groups[member]]),
    )


def joined_effect_forms(covariance: Array, groups: Sequence[Sequence[int]], unions: Sequence[Sequence[int]]) -> Array:
    """Return :func:`effect_forms` averaged only over orders in which the members of a union are neighbours.

    This is the value of Owen, Values of games with a priori unions (1977). Its cost is 2ⁿ with n the number of unions.
    A union is a list of group numbers; every group is in one.
    """
    members = [[k for group in union for k in groups[group]] for union in unions]
    whole = effect_forms(covariance, members)
    result = np.zeros((len(groups), *covariance.shape))
    for number, union in enumerate(unions):

        def worth(some: tuple[int, ...], number: int = number, union: Sequence[int] = union) -> Array:
            if not some:
                return np.zeros(covariance.shape)
            if len(some) == len(union):
                return np.asarray(whole[number])
            part = [k for member in some for k in groups[union[member]]]
            return np.asarray(effect_forms(covariance, [*members[:number], part, *members[number + 1 :]])[number])

        result[list(union)] = values(len(union), worth)
    return result
