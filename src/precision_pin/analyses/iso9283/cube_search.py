"""The largest cube with edges along the base axes that lies within reach.

A cube with centre c that holds no point u out of reach has at most the edge 2 min |u - c|∞. So the centre is sought for which
this bound is largest, over points known to be out of reach: at first those of a grid. The cube found is looked at on a
lattice. Where points of it are out of reach, the border of the workspace is found between them and the centre, its points are
added to the known ones, and the search goes on. The first cube whose lattice is all within reach is the largest, as far as
lattice and grid see. It is found with a coarse clearance first, which settles where it is, then with a fine one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from precision_pin.base.arrays import Array

Solver = Callable[..., Array]
"""Joint values ``(n, P)`` of points ``(3, P)``, NaN where out of reach; with values to start from, of the branch of these."""

LATTICE: Final = 13
"""Points along an edge of the lattice on which a cube is looked at."""
_ON_FACE: Final = 37
"""Points along an edge of the finer lattice on the faces, where the border of the workspace comes in between."""

_GRID: Final = 17
"""Points of the grid along an axis."""
_CENTRES: Final = 45
"""Centres along an axis, from which the best is sought."""
_MARGIN: Final = 0.05
"""Of the longest edge of the box, on each side: what the box is known from may miss the border."""
_STARTS: Final = 24
_PUSHES: Final = 20
_ROUNDS: Final = 200
_BORDERS: Final = 80
"""Most points of the border that are sought in a round."""
_HALVINGS: Final = 16
_BRANCHES: Final = 8
"""Most branches that are followed towards a point out of reach."""
_COARSE, _FINE = 2e-3, 2e-4
"""Share of the edge that is kept clear of points out of reach: more than halving leaves open."""
_PREFERENCE: Final = 1e-2
"""Among centres whose room differs by no more the one farthest along x comes first, or along y, z: most robots have several."""
_ALIKE, _ALIKE_FINE = 5e-3, 5e-4
"""Of cubes whose edges differ by no more the first is taken."""
_NEAR: Final = np.linspace(-0.02, 0.02, 3)
"""Places of more centres around that of the coarse cube, by its edge."""
_SMALLEST: Final = 0.02
"""Smallest edge by the longest of the box; what is smaller slips through the grid."""


def largest_cube(solve: Solver, low: Array, high: Array) -> tuple[float, Array]:
    """Return edge and centre ``(3,)`` of the largest cube found; an edge of zero where there is none.

    Parameters
    ----------
    solve
        Solutions of points.
    low, high
        A box that holds all points within reach, ``(3,)``.
    """
    size = float((high - low).max())
    low, high = low - _MARGIN * size, high + _MARGIN * size
    grid = _grid(low, high, _GRID)
    # the grid's outermost points are beyond the workspace
    at_edge = ((grid <= low[:, None]) | (grid >= high[:, None])).any(axis=0)
    blocked = grid[:, at_edge | np.isnan(solve(grid)[0])]
    centres = _grid(low, high, _CENTRES)
    room: Array = cKDTree(blocked.T).query(centres.T, p=np.inf)[0]
    along = np.array([1.0, 0.1, 0.01]) @ ((centres - low[:, None]) / (high - low)[:, None])
    preference = 1 + _PREFERENCE * along
    edge, near = 0.0, np.zeros((3, 0))
    for clearance, alike in ((_COARSE, _ALIKE), (_FINE, _ALIKE_FINE)):
        for _ in range(_ROUNDS):
            half, centre = _best(blocked, near, centres, room * preference, alike)
            edge = 2 * half * (1 - clearance)
            if edge < _SMALLEST * size:
                return 0.0, (low + high) / 2
            lattice = lattice_of(edge, centre)
            q = solve(lattice)
            start = q[:, lattice.shape[1] // 2]
            outside = lattice[:, np.isnan(q[0])]
            if clearance == _FINE and not outside.size:
                faces = _faces(edge, centre)
                outside = faces[:, np.isnan(solve(faces)[0])]
            if not outside.size:
                break
            found = outside[:, :: -(-outside.shape[1] // _BORDERS)]
            found = np.column_stack([centre, found]) if np.isnan(start[0]) else _border(solve, centre, start, found)
            blocked = np.concatenate([blocked, found], axis=1)
            for point in found.T:
                room = np.minimum(room, np.abs(centres - point[:, None]).max(axis=0))
        else:
            return 0.0, (low + high) / 2
        around: Array = np.array(np.meshgrid(_NEAR, _NEAR, _NEAR, indexing="ij")).reshape(3, -1)
        near = centre[:, None] + edge * around
    return edge, centre


def lattice_of(edge: float, centre: Array) -> Array:
    """Return the points of the lattice over a cube, its corners among them, ``(3, LATTICE³)``."""
    return _grid(centre - edge / 2, centre + edge / 2, LATTICE)


def _faces(edge: float, centre: Array) -> Array:
    """Return the points of a finer lattice that lie on the faces of a cube, ``(3, P)``."""
    points = _grid(np.full(3, -1.0), np.ones(3), _ON_FACE)
    return centre[:, None] + edge / 2 * points[:, np.abs(points).max(axis=0) == 1]


def _grid(low: Array, high: Array, count: int) -> Array:
    lines = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    points: Array = np.array(np.meshgrid(*lines, indexing="ij")).reshape(3, -1)
    return points


def _best(blocked: Array, near: Array, centres: Array, rating: Array, alike: float) -> tuple[float, Array]:
    """Return half the edge and the centre of the largest cube that holds no blocked point, from the best of many centres.

    Of those that are alike one from the centres ``near`` is taken, then the preferred one.
    """
    starts = centres[:, np.argsort(-rating, kind="stable")[:_STARTS]]
    local = sorted((_pushed(blocked, start) for start in near.T), key=lambda cube: -cube[0])
    found = [*local, *(_pushed(blocked, start) for start in starts.T)]
    largest = max(half for half, _ in found)
    return next(cube for cube in found if cube[0] >= largest * (1 - alike))


def _pushed(blocked: Array, centre: Array) -> tuple[float, Array]:
    """Return half the edge and the centre of a cube that is pushed away from the points that block it.

    A point blocks on the side where it is farthest from the centre. The points of each side bound a box that holds none, and
    the centre of the box has at least as much room.
    """
    best, at_best = 0.0, centre
    for _ in range(_PUSHES):
        gaps = blocked - centre[:, None]
        side = np.argmax(np.abs(gaps), axis=0)
        farthest = np.take_along_axis(gaps, side[None], axis=0)[0]
        half = float(np.abs(farthest).min())
        if half <= best * (1 + 1e-6):
            break
        best, at_best = half, centre
        above = [gaps[k, (side == k) & (farthest > 0)].min(initial=np.inf) for k in range(3)]
        below = [gaps[k, (side == k) & (farthest <= 0)].max(initial=-np.inf) for k in range(3)]
        shift = np.add(above, below) / 2
        centre = centre + np.where(np.isfinite(shift), shift, 0.0)
    return best, at_best


def _border(solve: Solver, inside: Array, start: Array, outside: Array) -> Array:
    """Return points ``(3, P)`` out of reach, next to the border, between a point within reach and others out of reach.

    Steps from a solution follow one branch of the inverse kinematics. Where it ends all are asked: what another branch
    reaches is followed from there. `start` is the solution ``(n,)`` of the point within reach.
    """
    ways = outside - inside[:, None]
    near, far = np.zeros(outside.shape[1]), np.ones(outside.shape[1])
    q, left = np.repeat(start[:, None], outside.shape[1], axis=1), np.arange(outside.shape[1])
    for _ in range(_BRANCHES):
        for _ in range(_HALVINGS):
            middle = (near[left] + far[left]) / 2
            found = solve(inside[:, None] + middle * ways[:, left], q[:, left])
            within = np.isfinite(found[0])
            near[left], far[left] = np.where(within, middle, near[left]), np.where(within, far[left], middle)
            q[:, left[within]] = found[:, within]
        found = solve(inside[:, None] + far[left] * ways[:, left])
        within = np.isfinite(found[0])
        left = left[within]
        near[left], far[left], q[:, left] = far[left], 1.0, found[:, within]
        if not left.size:
            break
    border: Array = inside[:, None] + far * ways
    return border
