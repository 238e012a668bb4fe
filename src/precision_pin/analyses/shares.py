"""Closed-form shares of draws, sources and places in the variance and the reach of the first-order model.

Shapley values, the fair division of a joint result among its contributors: Shapley, A value for n-person games (1953);
as shares of a variance: Owen, SIAM/ASA Journal on Uncertainty Quantification 2 (2014); for correlated inputs: Song,
Nelson and Staum, ibid. 4 (2016), Owen and Prieur, ibid. 5 (2017).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.chain import Chain
from precision_pin.statistics import COMPONENTS as COMPONENT_ROWS
from precision_pin.statistics import QUANTITIES
from precision_pin.terms.bound_source import number_owners
from precision_pin.terms.term import JointValue, Target

Key = TypeVar("Key", bound=Hashable)

ROUNDING: Final = 1e-14
"""Largest spread (m, rad) that counts as rounding."""

COMPONENTS: Final = tuple(QUANTITIES[row] for row in COMPONENT_ROWS)


VECTORS: Final = ("position", "attitude")
"""Vectors as quantities: their variance is E|d - E d|², the trace of the covariance."""


Shares = Mapping[str, float | None]
"""Shares by quantity: position, attitude, position.x … attitude.z; None where the quantity does not vary."""


@dataclass(frozen=True)
class SourceShare:
    """Share of a source's own draws, of one draw that several sources (or none) use, or of a part of a joint draw."""

    name: str
    sources: tuple[str, ...]
    draws: tuple[str, ...]
    share: Shares


def correlated_groups(space: Space) -> tuple[tuple[int, ...], ...]:
    """Return the indices of the draws in mutually independent groups, in column order."""
    draw_of = np.repeat(np.arange(len(space.draws)), [draw.law.size for draw in space.draws])
    group_of = list(range(len(space.draws)))
    for columns, matrix in space.block_covariance.blocks:
        scale = np.sqrt(np.diag(matrix))
        # largest correlation that counts as rounding
        linked = np.abs(matrix) > 1e-12 * np.outer(scale, scale)
        for row, column in np.argwhere(np.triu(linked, 1)).tolist():
            group_pair = sorted({group_of[draw_of[columns[row]]], group_of[draw_of[columns[column]]]})
            for k in draw_of[columns].tolist() if len(group_pair) > 1 else ():
                group_of[k] = group_pair[0] if group_of[k] == group_pair[1] else group_of[k]
    groups: dict[int, list[int]] = {}
    for k, group in enumerate(group_of):
        groups.setdefault(group, []).append(k)
    return tuple(map(tuple, groups.values()))


def by_draw(at: PoseModel) -> Array:
    """Return each draw's part of the variances of the tangent model, ``(draws, 6)``: ``J_g Σ_g J_gᵀ``.

    For correlated draws it is the Shapley effect, and NaN in a group of more than twelve of them.
    """
    result = np.full((len(at.space.draws), 6), np.nan)
    for group in correlated_groups(at.space):
        columns = [_columns(at.space, [k]) for k in group]
        union = list(itertools.chain.from_iterable(columns))
        jacobian, covariance = at.jacobian[:, union], at.space.block_covariance.within(union)
        if len(group) == 1:
            result[group[0]] = np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian)
        elif len(group) <= MOST_PLAYERS:
            offsets = np.cumsum([0, *map(len, columns)]).tolist()
            members = [list(range(a, b)) for a, b in itertools.pairwise(offsets)]
            result[list(group)] = shapley_effects(jacobian, covariance, members)
    return result


def by_component(at: PoseModel, draw: int) -> Array | None:
    """Return the parts of one draw's components, ``(size, 6)``; Shapley effects for correlated components.

    None for a single number, for a draw correlated with others, and for more than twelve correlated numbers.
    """
    columns = _columns(at.space, [draw])
    if len(columns) == 1 or next(group for group in correlated_groups(at.space) if draw in group) != (draw,):
        return None
    covariance = at.space.block_covariance.within(columns)
    jacobian = at.jacobian[:, columns]
    if np.array_equal(covariance, np.diag(np.diag(covariance))):
        return (jacobian**2 * np.diag(covariance)).T
    if len(columns) > MOST_PLAYERS:
        return None
    return shapley_effects(jacobian, covariance, [[k] for k in range(len(columns))])


def reaches(at: PoseModel, k: float) -> Array:
    """Return the reach of each draw in every component, first order, ``(draws, 6)``, m and rad.

    The reach is half the range, ``(h(w) + h(-w))/2`` with h the support function and w the draw's part of a row of J.
    For an unbounded law it is k standard deviations.
    """
    result = np.zeros((len(at.space.draws), 6))
    for row, (draw, columns) in enumerate(zip(at.space.draws, at.space.slices, strict=True)):
        for component, slopes in enumerate(at.jacobian[:, columns]):
            half_width = (draw.law.support(slopes) + draw.law.support(-slopes)) / 2
            if not math.isfinite(half_width):
                half_width = k * math.sqrt(max(float(slopes @ draw.law.covariance @ slopes), 0.0))
            result[row, component] = half_width
    return result


def by_place(at: PoseModel, chain: Chain) -> dict[str, Array]:
    """Return the part of each joint and chain link in the variances, ``(6,)`` from base to tip, as :func:`by_key`.

    The noise of each datum's procedure comes last.
    """
    return by_key(at, lambda target: place_name(target, chain)) | noise_of_datums(at)


def noise_of_datums(at: PoseModel) -> dict[str, Array]:
    """Return the part of the noise of each datum's procedure in the variances, ``(6,)`` by name."""
    if at.datum is None:
        return {}
    parts = {}
    for datum in at.datum.procedures.datums:
        is_own = [name.startswith(f"{datum.label}.") for name in at.space.components]
        noise = np.where(is_own, at.datum.noise, 0.0)
        parts[f"noise of datum {datum.name}"] = np.diag(at.space.block_covariance.between(noise, noise))
    return parts


def by_key(at: PoseModel, key_of: Callable[[Target], Key]) -> dict[Key, Array]:
    """Return the part of each place in the variances, ``(6,)`` keyed by ``key_of``, from base to tip.

    The error is a sum over places, ``e = Σ e_p``. The part of a place is ``Cov(e_p, e)``; it is negative where a number
    that acts at several places has the opposite effect at others. Correlated numbers at different places, such as from
    a calibration, are divided by Shapley effects: numbers that act at the same places are a player, and a player at
    several places divides its gain or loss by correlation evenly among them. With more than twelve players, those of a
    joint and of the link that it moves are neighbours in all orders (:func:`joined_effect_forms`); if that is
    still too many, correlated numbers count as ``Cov(e_p, e)`` too.
    """
    keys = [key_of(target) for target, _ in at.jacobian_parts]
    places = {key: row for row, key in enumerate(dict.fromkeys(keys))}
    moved_links = [0] * len(places)
    slopes = np.zeros((len(places), 6, at.space.size))
    acts = np.zeros((len(places), at.space.size), dtype=bool)
    for key, (target, part) in zip(keys, at.jacobian_parts, strict=True):
        slopes[places[key]][:, part.columns] += part.slopes
        acts[places[key], part.columns] = True
        moved_links[places[key]] = moved_link(target)
    parts = np.zeros((len(places), 6))
    for group in correlated_groups(at.space):
        columns = _columns(at.space, group)
        players: dict[tuple[int, ...], list[int]] = {}
        for k, column in enumerate(columns):
            players.setdefault(tuple(np.flatnonzero(acts[:, column]).tolist()), []).append(k)
        players.pop((), None)
        covariance, jacobian = at.space.block_covariance.within(columns), at.jacobian[:, columns]
        forms = _forms(covariance, players, moved_links) if len(players) > 1 else None
        if forms is None:
            parts += np.einsum("pij,jk,ik->pi", slopes[:, :, columns], covariance, jacobian)
            continue
        for (place_rows, numbers), form in zip(players.items(), forms, strict=True):
            draw_part = covariance[np.ix_(numbers, numbers)] @ jacobian[:, numbers].T
            place_slopes = slopes[np.ix_(place_rows, range(6), [columns[k] for k in numbers])]
            gain = np.einsum("ij,jk,ik->i", jacobian, form, jacobian) - np.einsum(
                "ij,ji->i", jacobian[:, numbers], draw_part
            )
            parts[list(place_rows)] += np.einsum("pij,ji->pi", place_slopes, draw_part) + gain / len(place_rows)
    return {key: parts[row] for key, row in places.items()}


def _forms(covariance: Array, players: Mapping[tuple[int, ...], list[int]], moved_links: Sequence[int]) -> Array | None:
    """Return the effect of each player as a quadratic form of slopes; None where there are too many."""
    if len(players) <= MOST_PLAYERS:
        return effect_forms(covariance, list(players.values()))
    unions: dict[tuple[int, ...], list[int]] = {}
    for player, place_rows in enumerate(players):
        unions.setdefault(tuple(dict.fromkeys(moved_links[place] for place in place_rows)), []).append(player)
    if max(len(unions), *map(len, unions.values())) > MOST_PLAYERS:
        return None
    return joined_effect_forms(covariance, list(players.values()), list(unions.values()))


def moved_link(target: Target) -> int:
    """Return the number of the link at which a target acts: for a joint, the link that it moves."""
    if isinstance(target, JointValue):
        return target.joint + 1
    return target.link if target.joint is None else target.joint + 1


def place_name(target: Target, chain: Chain) -> str:
    """Return the name of the joint for a joint value or seat, otherwise of the chain link of the target."""
    joints = chain.joint_names
    if isinstance(target, JointValue):
        return joints[target.joint]
    if target.joint is not None:
        return joints[target.joint]
    start = joints[target.link - 1] if target.link else chain.base
    end = joints[target.link] if target.link < len(joints) else chain.tip
    return f"link from {start} to {end}"


def _columns(space: Space, draws: Iterable[int]) -> list[int]:
    return [column for k in draws for column in range(space.slices[k].start, space.slices[k].stop)]


def group_part(at: PoseModel, group: tuple[int, ...], shares: Array) -> Array:
    """Return a group's part of the variances, ``(6,)``, as a whole if it is too large for Shapley effects."""
    part: Array = shares[list(group)].sum(axis=0)
    if np.isfinite(part).all():
        return part
    columns = np.concatenate([np.arange(at.space.size)[at.space.slices[draw]] for draw in group])
    jacobian = at.jacobian[:, columns]
    return np.einsum("ij,jk,ik->i", jacobian, at.space.block_covariance.within(columns), jacobian)


def shares_of(parts: Array, variances: Array) -> Shares:
    """Return the shares of components and vectors for parts of the six variances; None where one does not vary."""
    values: list[tuple[str, float, float]] = [
        (vector, float(parts[rows].sum()), float(variances[rows].sum()))
        for vector, rows in zip(VECTORS, (slice(0, 3), slice(3, 6)), strict=True)
    ]
    values += zip(COMPONENTS, map(float, parts), map(float, variances), strict=True)
    return {name: part / total if total > ROUNDING**2 and np.isfinite(part) else None for name, part, total in values}


def component_shares(at: PoseModel, draw: int, variances: Array) -> dict[str, Shares]:
    """Return the shares of the single numbers of a draw, by name; empty where :func:`by_component` returns None."""
    parts = by_component(at, draw)
    if parts is None:
        return {}
    names = at.space.draws[draw].components
    return {name: shares_of(part, variances) for name, part in zip(names, parts, strict=True)}


def worst_case_shares(part: Array, totals: Array) -> Shares:
    """Return a draw's shares of the reaches of the six components; None where the reach is zero."""
    return {
        name: float(value / total) if total > ROUNDING else None
        for name, value, total in zip(COMPONENTS, part, totals, strict=True)
    }


def deviations_of(variances: Array) -> dict[str, float]:
    """Return standard deviations of the components, and for the vectors the root of the sum of their squares."""
    squares = dict(zip(VECTORS, (variances[:3].sum(), variances[3:].sum()), strict=True))
    squares |= dict(zip(COMPONENTS, variances, strict=True))
    return {name: float(np.sqrt(max(square, 0.0))) for name, square in squares.items()}


@dataclass(frozen=True, eq=False)
class SourceLine:
    """Group of draws reported as one source: a source's own draws, a draw that several use, or a part of one.

    Attributes:
        name, sources: Name of the line, and labels of the sources.
        draws, columns: Rows of the draws that belong to it as a whole, and their columns.
        parts: For each draw divided among lines, its row, its columns and this line's form ``(size, size)``, from
            :func:`effect_forms`.
    """

    name: str
    sources: tuple[str, ...]
    draws: list[int]
    columns: list[int]
    parts: list[tuple[int, slice, Array]]


def source_lines(model: ErrorModel) -> tuple[SourceLine, ...]:
    """Return the lines of the sources, in the order of their first draws.

    Draws used by one source are in its line; a draw used by several has its own line. A draw of correlated numbers of
    several sources, such as from a calibration, is divided among the sources, or their joints if there are more than
    twelve.
    """
    space, owners = model.space, number_owners(model.space, model.sources, model.labels)
    uncorrelated = {group[0] for group in correlated_groups(space) if len(group) == 1}
    lines: dict[str, SourceLine] = {}
    for row, (draw, labels, columns) in enumerate(zip(space.draws, model.owners, space.slices, strict=True)):
        groups = _divide_numbers(draw, owners) if len(labels) > 1 and row in uncorrelated else {}
        if len(groups) < 2:
            name = labels[0] if len(labels) == 1 else draw.name
            line = lines.setdefault(name, SourceLine(name, labels, [], [], []))
            line.draws.append(row)
            line.columns.extend(range(columns.start, columns.stop))
            continue
        forms = effect_forms(space.block_covariance.within(_columns(space, [row])), list(groups.values()))
        for (name, numbers), form in zip(groups.items(), forms, strict=True):
            names = tuple(dict.fromkeys(label for k in numbers for label in owners[draw.components[k]]))
            lines.setdefault(name, SourceLine(name, names, [], [], [])).parts.append((row, columns, form))
    return tuple(lines.values())


def _divide_numbers(draw: Draw, owners: Mapping[str, Sequence[str]]) -> dict[str, list[int]]:
    """Return the numbers of a draw by source, or by the brackets in its label; empty if that is too many."""
    for is_by_source in (True, False):
        groups: dict[str, list[int]] = {}
        for k, name in enumerate(draw.components):
            line = name
            if len(owners[name]) == 1:
                (line,) = owners[name]
                place = line.partition("[")[2].rpartition("]")[0]
                line = line if is_by_source or not place else f"{place}, {draw.name}"
            groups.setdefault(line, []).append(k)
        if len(groups) <= MOST_PLAYERS:
            return groups
    return {}


def source_shares(
    at: PoseModel, lines: Sequence[SourceLine], shares: Array, variances: Array
) -> tuple[SourceShare, ...]:
    """Return the shares of the lines of the sources."""
    result = []
    for line in lines:
        part = shares[line.draws].sum(axis=0)
        for _, columns, form in line.parts:
            slopes = at.jacobian[:, columns]
            part = part + np.einsum("ij,jk,ik->i", slopes, form, slopes)
        draws = tuple(at.space.draws[row].name for row in (*line.draws, *(row for row, _, _ in line.parts)))
        result.append(SourceShare(line.name, line.sources, draws, shares_of(part, variances)))
    return tuple(result)


MOST_PLAYERS: Final = 12
"""Largest number of players: all 2^n coalitions are evaluated."""


def shapley_values(players: int, worth: Callable[[tuple[int, ...]], Array]) -> Array:
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
            1 / (players * math.comb(players - 1, count)) if 0 <= count < players else 0.0 for count in (size - 1, size)
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
    # relative deviation of a number given those before it, above which no eigenvalue can be that small
    if factor.diagonal().min() > 1e-4:
        half = np.linalg.solve(factor, cross.T)  # a tenth of the time of the pseudo-inverse
        return np.asarray(half.T @ half)
    # eigenvalues of a correlation matrix below this belong to linearly dependent numbers
    inverse = np.linalg.pinv(correlation, rcond=1e-12, hermitian=True)
    return cross @ inverse @ cross.T


def shapley_effects(slopes: Array, covariance: Array, groups: Sequence[Sequence[int]]) -> Array:
    """Return the Shapley effects ``(groups, m)`` of groups of inputs, by columns, on the variances of linear outputs.

    Their sum is the variance explained by all groups. Without correlation between groups they are the variance shares.
    """
    return shapley_values(
        len(groups),
        lambda coalition: explained(slopes, covariance, [k for member in coalition for k in groups[member]]).diagonal(),
    )


def effect_forms(covariance: Array, groups: Sequence[Sequence[int]]) -> Array:
    """Return the Shapley effects of groups of inputs as quadratic forms of any output's slopes, ``(groups, d, d)``.

    With form Φ_g, a group's effect on the variance of an output with slopes w is w Φ_g wᵀ; Σ Φ_g is the covariance.
    """
    slopes = np.eye(len(covariance))
    return shapley_values(
        len(groups),
        lambda coalition: explained(slopes, covariance, [k for member in coalition for k in groups[member]]),
    )


def joined_effect_forms(covariance: Array, groups: Sequence[Sequence[int]], unions: Sequence[Sequence[int]]) -> Array:
    """Return :func:`effect_forms` averaged only over orders in which the members of a union are neighbours.

    This is the value of Owen, Values of games with a priori unions (1977). Its cost is 2ⁿ with n the number of unions.
    A union is a list of group numbers; every group is in one.
    """
    members = [[k for group in union for k in groups[group]] for union in unions]
    all_forms = effect_forms(covariance, members)
    result = np.zeros((len(groups), *covariance.shape))
    for number, union in enumerate(unions):

        def worth(coalition: tuple[int, ...], number: int = number, union: Sequence[int] = union) -> Array:
            if not coalition:
                return np.zeros(covariance.shape)
            if len(coalition) == len(union):
                return np.asarray(all_forms[number])
            part = [k for member in coalition for k in groups[union[member]]]
            return np.asarray(effect_forms(covariance, [*members[:number], part, *members[number + 1 :]])[number])

        result[list(union)] = shapley_values(len(union), worth)
    return result
