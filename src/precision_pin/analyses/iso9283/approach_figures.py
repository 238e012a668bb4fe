"""Visits of a pose from several directions: paths along the three base axes, and what errors follow them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from precision_pin.analyses.iso9283.standard_poses import paths_of_approach
from precision_pin.base.arrays import Array
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling.approaches import ApproachErrors, sample_approaches


def approach_figures(
    error_model: ErrorModel, q: Array, target: Array, robots: int, cycles: int, seed: int
) -> ApproachErrors | None:
    """Return the errors of visits over paths along the base axes; ``None`` where no error follows them.

    Parameters
    ----------
    error_model, q
        The model and joint values of the pose, ``(n,)``.
    target
        The measured point in tool axes, m, ``(3,)``.
    robots, cycles, seed
        As for :func:`precision_pin.iso9283`; the cycles are those of each path.
    """
    posture = error_model.at(q).posture
    lever = posture.pose[:3, :3] @ target
    jacobian = error_model.chain.at_columns(q[:, None]).joint_jacobian[:, :, 0].copy()
    jacobian[:3] += np.cross(jacobian[3:], lever, axis=0)
    ways = paths_of_approach(jacobian)
    if not _follows(error_model, q, ways):
        return None
    return sample_approaches(
        error_model, q, approaches=ways, robots=robots, cycles=cycles, seed=seed, target=target
    )  # fmt: skip


def _follows(error_model: ErrorModel, q: Array, ways: Sequence[tuple[int, ...]]) -> bool:
    """Return whether any source's terms are others under another approach."""
    first, *others = [error_model.at(q, approach=way).terms for way in ways]
    return any(
        [term.factors for term in terms] != [term.factors for term in first]
        or any(not np.array_equal(one.twist, other.twist) for one, other in zip(terms, first, strict=True))
        for terms in others
    )
