"""The independent numbers behind the components of a space, standardised, with their moments up to the fourth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.draws.laws import FARTHEST_NORMAL, Circle, Disc, JointNormal, Law, Normal, Rows
from precision_pin.draws.space import Space
from precision_pin.errors import InputError
from precision_pin.kernel import sampler
from precision_pin.model.error_model import PoseModel

__all__ = ["STEP", "ErrorAround", "Uncorrelated"]

Array = NDArray[np.float64]

STEP: Final = 0.5
"""Of differences in place of derivatives, standard deviations."""

_FLAT: Final = 1e-12
_PANELS: Final = 36
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@final
class ErrorAround:
    """The exact error around the means of the components."""

    def __init__(self, at: PoseModel) -> None:
        self._layout = sampler.compile_table(at)
        self._mean = at.space.mean[:, None]

    def at(self, deviations: Array) -> Array:
        """Return the errors ``(6, N)`` at deviations from the means ``(d, N)``.

        Raises
        ------
        InputError
            The error does not exist there.
        """
        try:
            return sampler.errors_at(self._layout, "exact", self._mean + deviations)
        except InputError as error:
            reason = error.findings[0].message.partition(": ")[2]
            raise InputError(
                f"one standard deviation from the means the exact error does not exist ({reason}); "
                "its derivatives are no use for such wide draws"
            ) from None


@final
@dataclass(frozen=True, eq=False)
class Uncorrelated:
    """Numbers ζ of mean 0 and covariance I, of which the components are an affine map.

    Attributes
    ----------
    columns
        ``(d, K)``, what each moves the components by.
    third, fourth
        ``(K,)`` their moments.
    pairs
        ``(K, K)`` E ζ_k² ζ_l²; the diagonal is not used.
    known
        ``(K,)`` whether a number's moments up to the fourth are known, and others than these vanish.
    """

    columns: Array
    third: Array
    fourth: Array
    pairs: Array
    known: NDArray[np.bool_]

    @property
    def size(self) -> int:
        """K."""
        return int(self.columns.shape[1])

    @classmethod
    def of(cls, space: Space) -> Uncorrelated:
        """Return the numbers behind a space's components."""
        laws = {draw.name: draw.law for draw in space.draws}
        together = {name for correlation in space.correlations for name in correlation.names}
        groups = [[space.index[name] for name in correlation.names] for correlation in space.correlations]
        moments = [
            _NORMAL if all(isinstance(laws[name], Normal) for name in correlation.names) else None
            for correlation in space.correlations
        ]
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name not in together:
                groups.append(list(range(rows.start, rows.stop)))
                moments.append(_moments(draw.law))
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
            skewness, kurtosis, across = _NORMAL if known is None else known
            columns.append(moved)
            # an axis of a single number may point downwards
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


_Moments = tuple[float, float, float]
"""E ζ³, E ζ⁴ of standardised numbers and E ζ_k² ζ_l² of two of them."""

_NORMAL: Final[_Moments] = (0.0, 3.0, 1.0)
_DISC: Final[_Moments] = (0.0, 2.0, 2 / 3)
"""Of variance r²/4: E x⁴ = r⁴/8, E x² y² = r⁴/24."""
_CIRCLE: Final[_Moments] = (0.0, 1.5, 0.5)
"""Of variance r²/2: E x⁴ = 3 r⁴/8, E x² y² = r⁴/8."""


def _moments(law: Law) -> _Moments | None:
    """Return the moments of a law; ``None`` where they are not known, or where others than these do not vanish."""
    match law:
        case JointNormal():
            return _NORMAL
        case Disc():
            return _DISC
        case Circle():
            return _CIRCLE
        case _ if law.size > 1:
            return None
        case Rows():
            return _standardised(law.array[:, 0], np.full(len(law.array), 1 / len(law.array)))
        case _:
            # Gauss-Legendre in normal scores, cut where the law jumps or bends
            bends = special.ndtri(np.array(law.breaks, dtype=float))
            bends = bends[np.abs(bends) < FARTHEST_NORMAL]
            edges = np.union1d(np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, _PANELS + 1), bends)
            half = np.diff(edges)[:, None] / 2
            z = (edges[:-1, None] + half * (_NODES + 1)).ravel()
            weights = (half * _WEIGHTS).ravel() * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
            return _standardised(law.at_scores(z[None])[0], weights)


def _standardised(values: Array, weights: Array) -> _Moments:
    """Return moments of single numbers with weights; those of nothing that varies do not matter."""
    deviations = values - weights @ values
    variance = float(weights @ deviations**2)
    if variance <= 0:
        return _NORMAL
    third, fourth = (float(weights @ deviations**power) / variance ** (power / 2) for power in (3, 4))
    return third, fourth, 1.0
