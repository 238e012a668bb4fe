"""Arrays of one error model at many poses, with the common work separated.

Draws of unit scope, and formulas of such draws alone, have the same values at every pose; they are evaluated once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Scope, occasion
from precision_pin.kernel import loops
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.draw_arrays import BESIDE
from precision_pin.kernel.loops import Draws, Formulas, Motions, Offsets, Superposition


@final
@dataclass(frozen=True, eq=False)
class JoinedTables:
    """Arrays of one error model at P poses, with the common draws and formulas separated.

    Attributes
    ----------
    layouts
        Arrays of the model at each pose.
    unit_draws, unit_formulas
        Draws and formulas evaluated once for all poses.
    draws, formulas
        Draws and formulas evaluated at each pose.
    scopes
        Scope of each stream of ``draws``.
    superposition, motions
        Arrays of all poses concatenated, in the format of :func:`precision_pin.kernel.loops.run_poses`.
    """

    layouts: tuple[SamplerArrays, ...]
    unit_draws: Draws
    unit_formulas: Formulas
    draws: Draws
    formulas: Formulas
    scopes: tuple[Scope, ...]
    superposition: Superposition
    motions: Motions

    @classmethod
    def of(cls, layouts: Sequence[SamplerArrays]) -> JoinedTables:
        """Join the arrays of one model at several poses.

        Arrays from one call of :func:`precision_pin.kernel.sampler.to_arrays_at_poses` are joined faster.

        Raises
        ------
        InputError
            There are no poses, or their draws, targets or formulas differ.
        """
        if not layouts:
            raise InputError("no poses to sample; give at least one")
        first = layouts[0]
        if not all(is_alike(first, other) for other in layouts[1:]):
            raise InputError(
                "poses that are sampled together must be of one model, with the same draws, targets and formulas"
            )
        varying = _find_varying(first)
        unit_formulas, formulas = _split_formulas(first.formulas, varying)
        return cls(
            layouts=tuple(layouts),
            unit_draws=_select_draws(first.draws, np.setdiff1d(_all_rows(first.draws), varying)),
            unit_formulas=unit_formulas,
            draws=_select_draws(first.draws, varying),
            formulas=formulas,
            scopes=tuple(scope for scope in first.scopes if scope is not Scope.UNIT),
            superposition=_join_superpositions(layouts),
            motions=_join_motions(layouts),
        )

    def words(self, first_pose: int, visit: int) -> Offsets:
        """Return the last counter word of every stream of ``draws`` at every pose, ``(P, streams)``."""
        poses = range(first_pose, first_pose + len(self.layouts))
        occasions = {scope: [occasion(scope, pose, visit) for pose in poses] for scope in dict.fromkeys(self.scopes)}
        columns = [np.zeros((len(poses), 0))] + [np.array(occasions[scope])[:, None] for scope in self.scopes]
        return np.concatenate(columns, axis=1).astype(np.uint64)


def is_alike(one: SamplerArrays, other: SamplerArrays) -> bool:
    """Return whether the arrays of two poses have the same draws and formulas in the same rows."""
    if one.draws is other.draws and one.formulas is other.formulas:
        return True
    pairs = [*zip(one.draws, other.draws, strict=True), *zip(one.formulas, other.formulas, strict=True)]
    return (
        one.rows == other.rows
        and one.targets == other.targets
        and one.space.draws == other.space.draws
        and all(np.array_equal(a, b) for a, b in pairs)
    )


# draws and formulas by scope -----------------------------------------------------------------------------------------


def _find_varying(layout: SamplerArrays) -> Offsets:
    """Return the rows that differ between poses: draws of pose and visit scope, and results computed from them."""
    space = layout.space
    found = {
        component * loops.STRIDE
        for draw, columns in zip(space.draws, space.slices, strict=True)
        if draw.scope is not Scope.UNIT
        for component in range(columns.start, columns.stop)
    } - set(layout.draws.fixed_rows.tolist())
    formulas = layout.formulas
    steps = [
        *zip(formulas.left.tolist(), formulas.right.tolist(), formulas.results.tolist(), strict=True),
        *(
            (*factors, result)
            for factors, result in zip(formulas.product_factors.tolist(), formulas.products.tolist(), strict=True)
        ),
    ]
    for left, right, result in steps:
        if left in found or right in found:
            found.add(result)
    return np.array(sorted(found), dtype=np.uint64)


def _all_rows(draws: Draws) -> Offsets:
    rows = [getattr(draws, name) for name in draws._fields if name.endswith("_rows")]
    return np.unique(np.concatenate(rows))


def _select_draws(draws: Draws, rows: Offsets) -> Draws:
    """Return the draws in the given rows."""
    kept = {name: np.isin(getattr(draws, name), rows) for name in BESIDE}
    chosen = {field: getattr(draws, field)[kept[name]] for name in BESIDE for field in (name, *BESIDE[name])}
    groups = [
        k for k, (begin, _) in enumerate(pairwise(draws.group_starts.tolist())) if draws.group_rows[begin] in rows
    ]
    laws = [k for k, row in enumerate(draws.empirical_rows) if row in rows]
    group_starts, group_rows = _select_runs(draws.group_starts, draws.group_rows, groups)
    line_starts, lines = _select_runs(draws.empirical_starts, draws.empirical, laws)
    parts = {
        **draws._asdict(),
        **chosen,
        "group_starts": group_starts,
        "group_rows": group_rows,
        "group_roots": draws.group_roots[groups],
        "empirical_starts": line_starts,
        "empirical": lines,
    }
    return Draws(**{name: _freeze_copy(part) for name, part in parts.items()})


def _select_runs(starts: Offsets, values: NDArray[Any], chosen: Sequence[int]) -> tuple[Offsets, NDArray[Any]]:
    """Return starts and values of the chosen ones of the runs ``values[starts[k] … starts[k + 1]]``."""
    runs = [values[int(starts[k]) : int(starts[k + 1])] for k in chosen]
    return np.cumsum([0, *map(len, runs)]).astype(np.uint64), np.concatenate([values[:0], *runs])


def _split_formulas(formulas: Formulas, varying: Offsets) -> tuple[Formulas, Formulas]:
    """Return the formulas with the same results at every pose, and the others."""
    steps, products = np.isin(formulas.results, varying), np.isin(formulas.products, varying)
    unit, each = (
        Formulas(
            operators=_freeze_copy(formulas.operators[of_steps]),
            left=_freeze_copy(formulas.left[of_steps]),
            right=_freeze_copy(formulas.right[of_steps]),
            results=_freeze_copy(formulas.results[of_steps]),
            product_factors=_freeze_copy(formulas.product_factors[of_products]),
            products=_freeze_copy(formulas.products[of_products]),
        )
        for of_steps, of_products in ((~steps, ~products), (steps, products))
    )
    return unit, each


def _freeze_copy(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy of an array: to numba a writeable array is another type."""
    own = np.array(array, order="C")
    own.flags.writeable = False
    return own


# concatenation of poses ----------------------------------------------------------------------------------------------


def _join_entries(parts: Sequence[Superposition | Motions]) -> dict[str, NDArray[Any]]:
    return {
        name: _freeze_copy(np.concatenate([getattr(part, name) for part in parts]))
        for name in ("shift_rows", "shifts", "turn_rows", "turns")
    }


def _join_superpositions(layouts: Sequence[SamplerArrays]) -> Superposition:
    parts = [layout.superposition for layout in layouts]
    before = np.cumsum([(0, 0), *(part.starts[-1] for part in parts)], axis=0).astype(np.uint64)
    starts = [part.starts[:-1] + begin for part, begin in zip(parts, before[:-1], strict=True)]
    return Superposition(**_join_entries(parts), starts=_freeze_copy(np.concatenate([*starts, before[-1:]])))


def _join_motions(layouts: Sequence[SamplerArrays]) -> Motions:
    parts = [layout.motions for layout in layouts]

    def starts(name: str, rows: str) -> Offsets:
        before = np.cumsum([0, *(getattr(part, rows).size for part in parts[:-1])]).astype(np.uint64)
        return np.stack([getattr(part, name) for part in parts]) + before[:, None]

    return Motions(
        **_join_entries(parts),
        shift_starts=_freeze_copy(starts("shift_starts", "shift_rows")),
        turn_starts=_freeze_copy(starts("turn_starts", "turn_rows")),
        arms=_freeze_copy(np.stack([part.arms for part in parts])),
        series=_freeze_copy(np.stack([part.series for part in parts])),
    )
