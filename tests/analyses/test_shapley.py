"""Shapley values against their definition over all orders, and closed forms of the literature."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from precision_pin.analyses.budget import shapley
from precision_pin.base.errors import InputError

COVARIANCE = np.array(
    [
        [4.0, 1.2, -0.5, 0.3],
        [1.2, 1.0, 0.2, 0.0],
        [-0.5, 0.2, 2.0, 0.9],
        [0.3, 0.0, 0.9, 3.0],
    ]
)
SLOPES = np.array([[1.0, -2.0, 0.5, 1.5], [0.0, 3.0, 1.0, -1.0]])


def conditional(slopes: np.ndarray, covariance: np.ndarray, known: list[int]) -> np.ndarray:
    """Variance of the outputs less what remains of it once some normal inputs are known (Schur complement)."""
    rest = [k for k in range(covariance.shape[0]) if k not in known]
    left = covariance[np.ix_(rest, rest)]
    if known:
        cross = covariance[np.ix_(rest, known)]
        left = left - cross @ np.linalg.solve(covariance[np.ix_(known, known)], cross.T)
    return np.diag(slopes @ covariance @ slopes.T) - np.diag(slopes[:, rest] @ left @ slopes[:, rest].T)


def by_orders(players: int, worth, keeps=lambda order: True) -> np.ndarray:
    """Return what the definition says: the mean over all (kept) orders of what a player adds to those before."""
    orders = [order for order in itertools.permutations(range(players)) if keeps(order)]
    total = 0.0
    for order in orders:
        gains = np.zeros((players, *np.shape(worth([]))))
        for k, player in enumerate(order):
            gains[player] = worth(sorted(order[: k + 1])) - worth(sorted(order[:k]))
        total = total + gains
    return total / len(orders)


def test_four_correlated_inputs_agree_with_the_definition():
    expected = by_orders(4, lambda known: conditional(SLOPES, COVARIANCE, list(known)))
    found = shapley.effects(SLOPES, COVARIANCE, [[k] for k in range(4)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.sum(axis=0), np.diag(SLOPES @ COVARIANCE @ SLOPES.T), rtol=1e-13)


def test_groups_are_players():
    groups = [[2], [0, 3], [1]]
    expected = by_orders(
        3, lambda members: conditional(SLOPES, COVARIANCE, sorted(k for member in members for k in groups[member]))
    )
    np.testing.assert_allclose(shapley.effects(SLOPES, COVARIANCE, groups), expected, rtol=0, atol=1e-12)


def test_forms_are_the_effects_of_any_slopes():
    groups = [[2], [0, 3], [1]]
    expected = by_orders(
        3, lambda members: conditional(SLOPES, COVARIANCE, sorted(k for member in members for k in groups[member]))
    )
    forms = shapley.effect_forms(COVARIANCE, groups)
    np.testing.assert_allclose(np.einsum("ij,gjk,ik->gi", SLOPES, forms, SLOPES), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(forms.sum(axis=0), COVARIANCE, rtol=0, atol=1e-12)


def test_members_of_a_union_are_neighbours_in_all_orders():
    def keeps(order: tuple[int, ...]) -> bool:
        return abs(order.index(0) - order.index(2)) == 1

    expected = by_orders(4, lambda known: conditional(SLOPES, COVARIANCE, list(known)), keeps)
    forms = shapley.joined_effect_forms(COVARIANCE, [[k] for k in range(4)], [[1], [0, 2], [3]])
    np.testing.assert_allclose(np.einsum("ij,gjk,ik->gi", SLOPES, forms, SLOPES), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rho", [-0.9, 0.0, 0.35, 1.0])
def test_two_normal_inputs_have_the_published_effects(rho):
    """Owen and Prieur (2017), equation for two inputs; at ρ = 1 the two share evenly."""
    b1, b2, s1, s2 = 1.5, -0.4, 0.7, 2.0
    covariance = np.array([[s1**2, rho * s1 * s2], [rho * s1 * s2, s2**2]])
    common = b1 * b2 * s1 * s2 * rho
    expected = [
        b1**2 * s1**2 * (1 - rho**2 / 2) + common + b2**2 * s2**2 * rho**2 / 2,
        b2**2 * s2**2 * (1 - rho**2 / 2) + common + b1**2 * s1**2 * rho**2 / 2,
    ]
    found = shapley.effects(np.array([[b1, b2]]), covariance, [[0], [1]])[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_without_correlation_they_are_the_variance_shares():
    variances = np.array([4.0, 1.0, 0.0, 1e-12])
    found = shapley.effects(SLOPES, np.diag(variances), [[k] for k in range(4)])
    np.testing.assert_allclose(found, (SLOPES**2 * variances).T, rtol=1e-13, atol=1e-15)


def test_the_glove_game():
    """One left and two right gloves; a pair is worth 1 (a textbook's example): 4/6, 1/6, 1/6."""
    found = shapley.values(3, lambda members: np.array(float(0 in members and len(members) > 1)))
    np.testing.assert_allclose(found, [4 / 6, 1 / 6, 1 / 6], rtol=1e-15)


def test_too_many_players_are_refused():
    with pytest.raises(InputError, match="at most 12"):
        shapley.values(13, lambda members: np.zeros(()))
