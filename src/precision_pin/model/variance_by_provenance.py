"""Where the numbers of a model come from, and how much of the variance comes from those of each provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel
from precision_pin.sheet.provenance import Origin

NOT_STATED: Final = "not stated"
"""Of numbers of which the sheet does not say where they come from."""

OriginShares = Mapping[str, tuple[float, float]]
"""Share in the variance of position and attitude by provenance; their sums are one where the error varies."""


def origins_of_numbers(stated: Mapping[str, Origin], space: Space, owners: Sequence[Sequence[str]]) -> dict[str, str]:
    """Return where each number of a space comes from, by its name; nothing where nothing is stated.

    Parameters
    ----------
    stated
        As `precision_pin.sheet.Sheet.origins`.
    space, owners
        The draws, and the labels of the sources that use each of them.
    """
    kinds = map(partial(_origin, stated), space.draws, owners)
    return {name: kind for draw, kind in zip(space.draws, kinds, strict=True) for name in draw.components}


def _origin(stated: Mapping[str, Origin], draw: Draw, owners: Sequence[str]) -> str:
    """Return where a draw comes from: its own entry of the sheet, else that of its setting, else that of a source."""
    label = next((own for own in owners if draw.name.startswith(f"{own}.")), "")
    setting = draw.name.removeprefix(f"{label}.").partition(".")[0].partition("[")[0] if label else ""
    named = [f"parameters.{draw.name}", f"{label}.{setting}", *owners]
    # a number that several sources use is as sure as the least sure of them says
    kinds = [stated[name].kind for name in named if name in stated]
    if f"parameters.{draw.name}" in stated or (setting and f"{label}.{setting}" in stated):
        return kinds[0]
    return "assumed" if "assumed" in kinds else next(iter(kinds), "")


def origin_shares(origins: Mapping[str, str], at: PoseModel) -> OriginShares:
    """Return the shares in the first-order variance, ``Cov(e_k, e)`` summed over the numbers of each provenance.

    Empty where no provenance is stated.

    Parameters
    ----------
    origins
        As `precision_pin.model.error_model.ErrorModel.origins`.
    at
        The pose.
    """
    if not any(origins.values()):
        return {}
    space = at.space
    jacobian = at.jacobian
    spread = space.block_covariance.times(np.ascontiguousarray(jacobian.T))
    by_component = [np.einsum("id,di->d", jacobian[rows], spread[:, rows]) for rows in (slice(0, 3), slice(3, 6))]
    totals = [float(parts.sum()) for parts in by_component]
    found: dict[str, list[float]] = {}
    for column, name in enumerate(space.components):
        sums = found.setdefault(origins.get(name, "") or NOT_STATED, [0.0, 0.0])
        for vector, parts in enumerate(by_component):
            if totals[vector] > 0:
                sums[vector] += float(parts[column]) / totals[vector]
    ordered = sorted(found.items(), key=lambda entry: -entry[1][0])
    return {kind: (sums[0], sums[1]) for kind, sums in ordered}
