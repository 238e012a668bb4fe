"""Standardised uncorrelated numbers that generate the components of a space, with their moments up to the fourth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.laws.projection import NORMAL_MOMENTS
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.pose_model import PoseModel

STEP: Final = 0.5
"""Step of the differences that approximate derivatives, in standard deviations."""

_FLAT: Final = 1e-12


@final
class ErrorAround:
    """Exact error around the means of the components."""

    def __init__(self, at: PoseModel) -> None:
        self._layout = sampler.to_arrays(at)
        self._mean = at.space.mean[:, None]

    def at(self, deviations: Array) -> Array:
        """Return the errors ``(6, N)`` at deviations from the means ``(d, N)``.

        Raises:
            InputError: The error does not exist there.
        """
        try:
            return sampler.errors_at(self._layout, "exact", self._mean + deviations)
        except InputError as error:
            reason = error.findings[0].message.partition(": ")[2]
            raise InputError(
                f"one standard deviation from the means the exact error does not exist ({reason}); "
                "the closed form is not possible for such wide draws"
            ) from None


@final
@dataclass(frozen=True, eq=False)
class Uncorrelated:
    """Numbers ζ with mean 0 and covariance I, of which the components are an affine map.

    Attributes:
        columns: ``(d, K)`` displacement of the components by each number.
        third, fourth: ``(K,)`` third and fourth moments.
        pairs: ``(K, K)`` E ζ_k² ζ_l²; the diagonal is not used.
        known: ``(K,)`` true if the moments up to the fourth are known, and all moments other than these vanish.
    """

    columns: Array
    third: Array
    fourth: Array
    pairs: Array
    known: NDArray[np.bool_]

    @property
    def size(self) -> int:
        """Number of numbers ζ, K."""
        return int(self.columns.shape[1])

    @classmethod
    def of(cls, space: Space) -> Uncorrelated:
        """Return the numbers that generate the components of a space."""
        laws = {draw.name: draw.law for draw in space.draws}
        together = {name for correlation in space.correlations for name in correlation.names}
        groups = [[space.index[name] for name in correlation.names] for correlation in space.correlations]
        moments = [
            NORMAL_MOMENTS if all(laws[name].is_normal for name in correlation.names) else None
            for correlation in space.correlations
        ]
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name not in together:
                groups.append(list(range(rows.start, rows.stop)))
                moments.append(draw.law.standardised_moments())
        columns: list[Array] = []
        third: list[float] = []
        fourth: list[float] = []
        pairs: list[Array] = []
        complete: list[bool] = []
        for group, known in zip(groups, moments, strict=True):
            spread = space.block_covariance.within(group)
            values, vectors = np.linalg.eigh(spread)
            varies = values > _FLAT * max(values.max(), 0.0)
            count = int(varies.sum())
            if not count:
                continue
            moved = np.zeros((space.size, count))
            moved[group] = vectors[:, varies] * np.sqrt(values[varies])
            skewness, kurtosis, across = NORMAL_MOMENTS if known is None else known
            columns.append(moved)
            # the eigenvector of a single number may have a negative sign
            third += [skewness * (np.sign(moved.sum()) if len(group) == 1 else 1.0)] * count
            fourth += [kurtosis] * count
            complete += [known is not None] * count
            pairs.append(np.full((count, count), across))
        size = len(third)
        matrix = np.ones((size, size))
        begin = 0
        for block in pairs:
            matrix[begin : begin + len(block), begin : begin + len(block)] = block
            begin += len(block)
        return cls(
            np.concatenate([np.zeros((space.size, 0)), *columns], axis=1),
            np.array(third, dtype=float),
            np.array(fourth, dtype=float),
            matrix,
            np.array(complete, dtype=bool),
        )
