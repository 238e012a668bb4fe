"""A cantilever of Euler-Bernoulli elements, assembled and solved: what beams are checked against."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Piece:
    """A prismatic piece from the clamp on: its end, GI, EI_y, EI_z, EA and weight per length (beam axes)."""

    end: float
    rigidities: tuple[float, float, float, float]
    weight: np.ndarray


def cantilever(pieces: Sequence[Piece], points: Sequence[tuple[float, np.ndarray, np.ndarray]], elements: int = 100):
    """Return the end's displacement ``[d; δ]``; ``points`` are (reach, force, moment), beam axes, SI.

    Nodes stand at the ends of the pieces and where points are loaded; there cubic elements are exact.
    """
    length = pieces[-1].end
    fixed = {0.0, *(piece.end for piece in pieces), *(reach for reach, _, _ in points)}
    even = [k * length / elements for k in range(elements)]
    nodes = sorted(fixed | {x for x in even if min(abs(x - other) for other in fixed) > 0.3 * length / elements})
    stiffness, force = np.zeros((6 * len(nodes),) * 2), np.zeros(6 * len(nodes))
    for k, (start, end) in enumerate(itertools.pairwise(nodes)):
        piece = next(piece for piece in pieces if end <= piece.end)
        rows = slice(6 * k, 6 * k + 12)
        stiffness[rows, rows] += _element(end - start, *piece.rigidities)
        force[rows] += _consistent(piece.weight, end - start)
    for reach, push, turn in points:
        node = nodes.index(reach)
        force[6 * node : 6 * node + 3] += push
        force[6 * node + 3 : 6 * node + 6] += turn
    return np.linalg.solve(stiffness[6:, 6:], force[6:])[-6:]


def _element(h: float, gi: float, ei_y: float, ei_z: float, ea: float) -> np.ndarray:
    k = np.zeros((12, 12))
    for i, value in ((0, ea / h), (3, gi / h)):
        k[i, i] = k[i + 6, i + 6] = value
        k[i, i + 6] = k[i + 6, i] = -value
    for w, t, rigidity, s in ((1, 5, ei_z, h), (2, 4, ei_y, -h)):
        bend = [[12, 6 * s, -12, 6 * s], [6 * s, 4 * h**2, -6 * s, 2 * h**2]]
        bend += [[-12, -6 * s, 12, -6 * s], [6 * s, 2 * h**2, -6 * s, 4 * h**2]]
        rows = [w, t, w + 6, t + 6]
        k[np.ix_(rows, rows)] += rigidity / h**3 * np.array(bend)
    return k


def _consistent(weight: np.ndarray, h: float) -> np.ndarray:
    f = np.zeros(12)
    f[:3] = f[6:9] = weight * h / 2
    f[[5, 11]] = weight[1] * h**2 / 12 * np.array([1, -1])
    f[[4, 10]] = weight[2] * h**2 / 12 * np.array([-1, 1])
    return f


def torsion_constant(width: float, height: float, wall: float, cells: int) -> float:
    """Return J of a rectangular tube by bilinear elements for Prandtl's function, which is constant over the hole.

    ``cells`` square-ish cells through the wall; the walls must be whole parts of the sides. J = 2 ∫ φ dA.
    """
    nx, ny = round(width / wall * cells), round(height / wall * cells)
    dx, dy = width / nx, height / ny
    x, y = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), indexing="ij")
    in_wall = (np.minimum(x, nx - x) < cells) | (np.minimum(y, ny - y) < cells)
    outside = (np.minimum(x, nx - x) == 0) | (np.minimum(y, ny - y) == 0)
    inner = in_wall & ~outside
    number = np.where(outside, -1, 0)
    number[inner] = np.arange(inner.sum())
    number[~in_wall] = inner.sum()
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1).reshape(-1, 4)
    along_x = np.array([[2, -2, -1, 1], [-2, 2, 1, -1], [-1, 1, 2, -2], [1, -1, -2, 2]]) * dy / dx / 6
    along_y = np.array([[2, 1, -1, -2], [1, 2, -2, -1], [-1, -2, 2, 1], [-2, -1, 1, 2]]) * dx / dy / 6
    matrix = np.zeros((inner.sum() + 1,) * 2)
    right = np.zeros(inner.sum() + 1)
    for corner in corners:
        free = corner >= 0
        np.add.at(matrix, np.ix_(corner[free], corner[free]), (along_x + along_y)[np.ix_(free, free)])
        np.add.at(right, corner[free], 2 * dx * dy / 4)
    return float(right @ np.linalg.solve(matrix, right))
