"""The arm that is left after a calibration: its sources with the laws of what is still uncertain."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.calibration.design import UnitNumbers, model_like
from precision_pin.draws.laws import JointNormal, Law
from precision_pin.draws.space import Draw, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.terms.labelled_sources import with_quantities
from precision_pin.typing import Array

__all__ = ["bounds_of", "remaining_model"]

_UNTOUCHED: Final = 1e-9
"""Change of a mean, variance or correlation, in units of the prior, that counts as none."""


def remaining_model(model: ErrorModel, unit: UnitNumbers, mean: Array, covariance: Array) -> ErrorModel:
    """Return the calibrated arm: numbers that the data told nothing about keep their laws.

    All others are one joint normal draw, ``calibrated``, under their own names; those whose law has bounds within the reach
    of the normal one are cut at them.

    Parameters
    ----------
    model
        The arm before the calibration.
    unit
        Its numbers drawn once for each robot.
    mean, covariance
        Of these numbers after it, ``(U,)`` and ``(U, U)``.
    """
    space = _remaining_space(model.space, unit, mean, covariance)
    return model_like(model, model.chain, with_quantities(space, model.sources, model.labels, model.chain))


def _remaining_space(space: Space, unit: UnitNumbers, mean: Array, covariance: Array) -> Space:
    scaled = (covariance - unit.root @ unit.root.T) / np.outer(unit.std, unit.std)
    moved = np.abs(mean - unit.mean) / unit.std
    changed = (np.abs(scaled).max(axis=1) > _UNTOUCHED) | (moved > _UNTOUCHED)
    names = {name for name, is_changed in zip(unit.names, changed, strict=True) if is_changed}
    touched = {draw.name for draw in space.draws if names & set(draw.components)}
    for correlation in space.correlations:
        if touched & set(correlation.names):
            touched |= set(correlation.names)
    if not touched:
        return space
    members = [draw for draw in space.draws if draw.name in touched]
    wanted = [name for draw in members for name in draw.components]
    position = {name: k for k, name in enumerate(unit.names)}
    matrix, centre = np.zeros((len(wanted), len(wanted))), space.mean[[space.index[name] for name in wanted]].copy()
    known = [k for k, name in enumerate(wanted) if name in position]
    rows = [position[wanted[k]] for k in known]
    matrix[np.ix_(known, known)] = covariance[np.ix_(rows, rows)]
    centre[known] = mean[rows]
    normal = JointNormal(tuple(map(tuple, ((matrix + matrix.T) / 2).tolist())), tuple(centre.tolist()))
    kept = [draw for draw in space.draws if draw.name not in touched]
    law = _clip(normal, [bounds_of(draw.law, k) for draw in members for k in range(draw.law.size)])
    name = _free_name({name for draw in space.draws for name in (draw.name, *draw.components)})
    calibrated = Draw(name, law, names=tuple(wanted))
    others = tuple(one for one in space.correlations if not touched & set(one.names))
    return Space((calibrated, *kept), others)


def bounds_of(law: Law, number: int) -> tuple[float, float]:
    """Return the lowest and highest value of one of a law's numbers, infinite for none."""
    axis = np.eye(law.size)[number]
    return -float(law.support(-axis)), float(law.support(axis))


def _clip(normal: JointNormal, bounds: Sequence[tuple[float, float]]) -> Law:
    """Return the law with those bounds that lie within its reach; the normal law itself if none does."""
    reached = []
    for k, (low, high) in enumerate(bounds):
        first, last = normal.interval(k)
        reached.append((low if first < low else -np.inf, high if last > high else np.inf))
    return dataclasses.replace(normal, bounds=tuple(reached)) if np.isfinite(reached).any() else normal


def _free_name(taken: set[str]) -> str:
    name = "calibrated"
    while name in taken:
        name += "_"
    return name
