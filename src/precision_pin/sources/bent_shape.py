"""The shape of a beam under load, and the moments that loads have because of it (P-delta)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array
from precision_pin.robot.chain import Posture

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Gauss-Legendre rule, exact up to degree 9."""
_ALONG: Final = np.array([1.0, 0.0, 0.0])
_NEXT: Final = [1, 2, 0]
_AFTER: Final = [2, 0, 1]


@final
@dataclass(frozen=True, eq=False)
class BentShape:
    """The shape of a cantilever: the cubic through the displacement and rotation of its end.

    One such cubic gives Euler's load of a column with one end free as 2.486 EI/l², where π²/4 = 2.467 is exact (Przemieniecki,
    Theory of Matrix Structural Analysis, 1968, chapter 15).

    Attributes
    ----------
    length
        Length of the beam, m.
    end
        ``[u, w_y, w_z; φ, θ_y, θ_z]`` of its end, beam axes.
    """

    length: float
    end: Array

    @classmethod
    def of(cls, posture: Posture, link: int, axes: Array) -> BentShape | None:
        """Return the shape of a chain link on the deflected arm, None on the undeflected one; ``axes`` as columns."""
        if posture.deflection is None:
            return None
        place = posture.chain.placements[link]
        to_beam = axes.T @ place[:3, :3]
        bending = posture.deflection.bending[link]
        return cls(float(np.linalg.norm(place[:3, 3])), np.concatenate([to_beam @ bending[:3], to_beam @ bending[3:]]))

    def displacement(self, reach: ArrayLike) -> Array:
        """Return the displacements ``(..., 6)`` at places ``reach`` ``(...)`` (m) along the beam, beam axes.

        Places beyond an end move with that end.
        """
        l, along = self.length, np.asarray(reach, dtype=float)  # noqa: E741
        s, beyond = np.clip(along / l, 0.0, 1.0), np.maximum(along - l, 0.0)
        u, w_y, w_z, phi, theta_y, theta_z = self.end
        across, turned = s * s * (3 - 2 * s), l * s * s * (s - 1)
        across_slope, turned_slope = 6 * s * (1 - s) / l, s * (3 * s - 2)
        rows = (
            u * s,
            w_y * across + theta_z * (turned + beyond),
            w_z * across - theta_y * (turned + beyond),
            phi * s,
            theta_y * turned_slope - w_z * across_slope,
            theta_z * turned_slope + w_y * across_slope,
        )
        return np.stack(rows, axis=-1)

    def slope(self, reach: Array) -> Array:
        """Return the rate of rotation along the beam, ``(N, 3)``, rad/m: the shape's twist and curvatures."""
        l, s = self.length, reach / self.length  # noqa: E741
        _, w_y, w_z, phi, theta_y, theta_z = self.end
        bent, straight = 6 * (1 - 2 * s) / l**2, (6 * s - 2) / l
        rows = (np.full_like(s, phi / l), theta_y * straight - w_z * bent, theta_z * straight + w_y * bent)
        return np.stack(rows, axis=-1)

    @property
    def second_order(self) -> Array:
        """The displacement of the end by the rotations along the beam beyond their sum, ``(6,)``, beam axes.

        With θ(x) the rotation, ``δ = -½ ∫ θ × θ' dx`` (rotations do not commute) and ``d = ½ ∫ θ × (θ × e_x) dx``, which
        shortens a bent beam, plus the displacement that δ causes along the beam.
        """
        x, weights = _nodes(0.0, self.length)
        turn = self.displacement(x)[:, 3:]
        total = _at_end(_cross(self.slope(x), turn) / 2, self.length - x, weights)
        total[:3] += weights @ _cross(turn, _cross(turn, _ALONG)) / 2
        return total

    def bending(self, wrench: Array, loaded: tuple[float, float], part: tuple[float, float]) -> Array:
        """Return the further displacement of the beam's end because a load acts on the bent shape, ``(3, 6)``.

        The moment at x is that of the force at its displaced point, ``M + Δr × F``. It bends the section about axes that
        have turned by θ: ``κ = D (M + Δr × F - θ × M) + θ × D M`` to second order, D the flexibilities. One row each for
        unit flexibility about x, y and z, with the others rigid.

        Parameters
        ----------
        wrench
            ``[F; M]``, beam axes: at the point where it acts, or of a weight spread evenly between two points.
        loaded
            Ends of the stretch on which it acts, m along the beam.
        part
            Ends of the part that bends, m along the beam.
        """
        x, weights = _nodes(part[0], min(part[1], loaded[1]))
        begin, stop = np.maximum(loaded[0], x), loaded[1]
        at_point = loaded[0] == stop
        share = np.ones_like(x) if at_point else (stop - begin) / (stop - loaded[0])
        force = share[:, None] * wrench[:3]
        # lever along x only: (a, 0, 0) × F = (0, -a F_z, a F_y)
        lever = (begin + stop) / 2 - x
        moment = np.stack([np.zeros_like(x), -lever * force[:, 2], lever * force[:, 1]], axis=-1)
        if at_point:
            moment = moment + wrench[3:]
        here = self.displacement(x)
        beyond = self.displacement(stop)[:3] if at_point else self._mean_place(begin, stop)
        more = _cross(beyond - here[:, :3], force) - _cross(here[:, 3:], moment)
        about = np.eye(3)[:, None, :]
        return _at_end(
            about * more.T[:, :, None] + _cross(here[:, 3:], about) * moment.T[:, :, None], self.length - x, weights
        )

    def _mean_place(self, begin: Array, stop: float) -> Array:
        """Return the mean displacement of the points between each of N places and ``stop``, ``(N, 3)``."""
        x = (begin[:, None] * (1 - _NODES) + stop * (1 + _NODES)) / 2
        mean: Array = np.einsum("k,nki->ni", _WEIGHTS / 2, self.displacement(x)[..., :3])
        return mean


def _nodes(start: float, stop: float) -> tuple[Array, Array]:
    """Return the nodes of the quadrature along the beam (m), and their weights."""
    half = (stop - start) / 2
    return start + half * (1 + _NODES), half * _WEIGHTS


def _at_end(turn: Array, reach: Array, weights: Array) -> Array:
    """Return the beam end's displacement ``(..., 6)`` by weighted rotations ``(..., N, 3)``, each ``reach`` (m) before it."""
    lever = (weights * reach) @ turn
    zero = np.zeros_like(lever[..., 0])
    return np.concatenate([np.stack([zero, lever[..., 2], -lever[..., 1]], axis=-1), weights @ turn], axis=-1)


def _cross(one: Array, other: Array) -> Array:
    """Return the vector products ``(..., 3)``; for a few vectors faster than numpy's cross."""
    result: Array = one[..., _NEXT] * other[..., _AFTER] - one[..., _AFTER] * other[..., _NEXT]
    return result
