"""The shape of a bent link, and how much more the link bends because its loads act on that shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arrays import Array

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Gauss-Legendre rule, exact up to degree 9."""
_MEAN_NODES, _MEAN_WEIGHTS = np.polynomial.legendre.leggauss(3)
"""The same up to degree 5."""
_ALONG: Final = np.array([[1, 0, 0, 0, 0], [4, -4, 0, 0, 0]])
_ACROSS: Final = np.array([[0, 3, -2, 0, 0], [0, -1, 1, 0, 0], [0, 16, -32, 16, 0], [0, -8, 32, -40, 16]])
"""Factors of s to s⁵, s = reach / length: for growth of end and bow; for shift and slope of the end and of the bow."""
_POWERS: Final = np.arange(1, 6)  # of s
NO_LENGTH: Final = 1e-9
"""Fraction of a link's length up to which a stretch counts as a point, and what ends short of the end as at the end."""
_NEXT: Final = [1, 2, 0]
_AFTER: Final = [2, 0, 1]


@dataclass(frozen=True, eq=False)
class BentShape:
    """The shape of a cantilever: the polynomials through the displacements and rotations of its middle and end.

    Across the beam they are of degree 5, along it of degree 2. Loads at the end and a weight spread evenly bend it so to
    first order. Vectors are in any axes fixed to its clamp.

    Attributes:
        far_end: Its end, unbent, from the clamp, m, ``(3,)``.
        end: Displacement ``[d; δ]`` of its end by loads, ``(6,)``.
        bow: Displacement of its middle, at half its length, beyond :func:`middle_of` the end's, ``(6,)``.
        shift: Displacement of its end by all causes, m, ``(3,)``: there act the loads beyond it.
    """

    far_end: Array
    end: Array
    bow: Array
    shift: Array

    @cached_property
    def length(self) -> float:
        """Its length, m."""
        return float(np.linalg.norm(self.far_end))

    def turned(self, rotation: Array) -> BentShape:
        """Return the shape in axes to which ``rotation`` ``(3, 3)`` turns vectors."""
        end, bow = ((part.reshape(2, 3) @ rotation.T).ravel() for part in (self.end, self.bow))
        return BentShape(rotation @ self.far_end, end, bow, rotation @ self.shift)

    def displacement(self, reach: ArrayLike) -> Array:
        """Return displacements by loads ``(..., 6)`` at ``reach`` ``(...)`` (m); constant beyond an end."""
        s = np.clip(np.asarray(reach, dtype=float) / self.length, 0.0, 1.0)
        return np.asarray(s[..., None] ** _POWERS @ self._polynomial)

    def mean_displacement(self, start: ArrayLike, stop: ArrayLike) -> Array:
        """Return mean displacements by loads ``(..., 6)`` between ``start`` and ``stop`` ``(...)`` (m)."""
        begin, end = np.asarray(start, dtype=float)[..., None], np.asarray(stop, dtype=float)[..., None]
        x = (begin * (1 - _MEAN_NODES) + end * (1 + _MEAN_NODES)) / 2
        return np.asarray(np.einsum("k,...ki->...i", _MEAN_WEIGHTS / 2, self.displacement(x)))

    def slope(self, reach: Array) -> Array:
        """Return the derivative of the rotation, ``(N, 3)``, rad/m, at places along the beam (m)."""
        s = reach[:, None] / self.length
        return np.asarray(s ** (_POWERS - 1) * _POWERS @ self._polynomial[:, 3:] / self.length)

    @property
    def second_order(self) -> Array:
        """Displacements ``(2, 6)`` of end and middle by the rotations along the beam beyond their sum.

        With θ(x) the rotation, ``δ = -½ ∫ θ × θ' dx`` (rotations do not commute) and ``d = ½ ∫ θ × (θ × e_x) dx``,
        which shortens a bent beam, plus the displacement that δ causes along the beam.
        """
        x, weights = _nodes(0.0, self.length / 2, self.length)
        rotation = self.displacement(x)[:, 3:]
        total = self._integrate(_cross(self.slope(x), rotation) / 2, x, weights)
        shortening = weights[:, None] * _cross(rotation, rotation @ self._across) / 2
        total[:, :3] += shortening.sum(axis=0), shortening[x < self.length / 2].sum(axis=0)
        return total

    def bending(self, wrench: Array, loaded: tuple[float, float], part: tuple[float, float]) -> Array:
        """Return further displacements ``(2, 3, 6)`` of end and middle because a load acts on the bent shape.

        The moment at x is that of the force at its displaced point, ``M + Δr × F``. It bends the section about axes
        turned by θ: ``κ = D (M + Δr × F - θ × M) + θ × D M`` to second order, D the flexibilities. One row each for
        unit flexibility about x, y and z, with the others rigid. Here x, y and z must be those of the sections.

        Args:
            wrench: ``[F; M]``, at its point, or of a weight spread evenly between two points.
            loaded: Ends of the loaded stretch, m along the beam.
            part: Ends of the bending part, m along the beam.
        """
        first, last = part[0], min(part[1], loaded[1])
        x, weights = _nodes(first, *(cut for cut in sorted((loaded[0], self.length / 2)) if first < cut < last), last)
        begin, stop = np.maximum(loaded[0], x), loaded[1]
        at_point = loaded[0] == stop
        share = np.ones_like(x) if at_point else (stop - begin) / (stop - loaded[0])
        force = share[:, None] * wrench[:3]
        moment = (x - (begin + stop) / 2)[:, None] * (force @ self._across)
        if at_point:
            moment = moment + wrench[3:]
        section = self.displacement(x)
        at_end = at_point and stop > (1 - NO_LENGTH) * self.length
        load_point = self.shift if at_end else self.mean_displacement(begin, stop)[..., :3]
        bending_moment = _cross(load_point - section[:, :3], force) - _cross(section[:, 3:], moment)
        about = np.eye(3)[:, None, :]
        curvature = about * bending_moment.T[:, :, None] + _cross(section[:, 3:], about) * moment.T[:, :, None]
        return self._integrate(curvature, x, weights)

    @cached_property
    def _along(self) -> Array:
        return self.far_end / self.length

    @cached_property
    def _across(self) -> Array:
        """Matrix ``(3, 3)`` that makes of a row v the vector product of v and the beam's direction."""
        return se3.skew(self._along)

    @cached_property
    def _polynomial(self) -> Array:
        """Factors of s to s⁵, s = reach / length, in the displacement, ``(5, 6)``."""
        x, parts = self._along, np.array([self.end, self.bow]).reshape(4, 3)
        along = (parts @ x)[:, None] * x
        across = parts - along
        across[1::2] = self.length * across[1::2] @ self._across
        bending_rows = _ACROSS.T @ across
        rotation_rows = np.zeros((5, 3))
        rotation_rows[:4] = bending_rows[1:] * (-_POWERS[1:, None] / self.length) @ self._across
        return np.concatenate([bending_rows + _ALONG.T @ along[::2], rotation_rows + _ALONG.T @ along[1::2]], axis=1)

    def _integrate(self, curvature: Array, x: Array, weights: Array) -> Array:
        """Return displacements ``(2, ..., 6)`` of end and middle by weighted rotations ``(..., N, 3)`` at ``x`` ``(N,)``."""
        lever = np.array([[self.length], [self.length / 2]]) - x
        share = weights * (lever > 0)
        moments = np.tensordot([share * lever, share], curvature, axes=(2, -2))
        return np.concatenate([moments[0] @ self._across, moments[1]], axis=-1)


def middle_of(length: float) -> Array:
    """Return the matrix from the displacement of a cantilever's end to its middle's, for loads at the end, beam axes."""
    result = np.diag([0.5, 0.5, 0.5, 0.5, -0.25, -0.25])
    result[1, 5], result[2, 4] = -length / 8, length / 8
    result[5, 1], result[4, 2] = 1.5 / length, -1.5 / length
    return result


def _nodes(*cuts: float) -> tuple[Array, Array]:
    """Return nodes and weights of the rule between successive cuts, ``(N,)`` each."""
    half = np.diff(cuts)[:, None] / 2
    return (np.array(cuts[:-1])[:, None] + half * (1 + _NODES)).ravel(), (half * _WEIGHTS).ravel()


def _cross(first: Array, second: Array) -> Array:
    """Return vector products ``(..., 3)``; for few vectors faster than numpy's cross."""
    return first[..., _NEXT] * second[..., _AFTER] - first[..., _AFTER] * second[..., _NEXT]
