"""The compiled proof that two meshes are apart: boxes about ever fewer triangles, and at last two triangles.

Of one mesh against another at many poses; some ten times as fast as asking coal for each. Only a proof: meshes nearer than
`NEAR`, or that touch, are left to coal. All compiled code of it is in this file, as numba's cache asks for.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.jit import cached_entry, call, inline

NEAR: Final = 1e-6
"""Distance (m) up to which meshes are not proven to be apart: far beyond rounding, and as far as coal's own tolerance."""


class Tree(NamedTuple):
    """Boxes about a mesh's triangles, halved until each holds one; along the mesh's own axes.

    Attributes:
        boxes: Centre and half the edges of each box, the first about all, ``(N, 6)``.
        below: The two boxes within each, ``(N, 2)``; of one triangle -1 and its number.
        triangles: Corners ``(F, 3, 3)``.
    """

    boxes: Array
    below: NDArray[np.int64]
    triangles: Array

    @classmethod
    def of(cls, triangles: Array) -> Tree:
        """Return the tree of triangles ``(F, 3, 3)``, at least one."""
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        order, sizes, node_count = np.arange(len(triangles)), np.array([len(triangles)]), 1
        boxes, below = [], []
        while sizes.size:  # level by level
            starts, node = np.cumsum(sizes) - sizes, np.repeat(np.arange(sizes.size), sizes)
            lower, upper = np.minimum.reduceat(low[order], starts), np.maximum.reduceat(high[order], starts)
            boxes.append(np.hstack([(lower + upper) / 2, (upper - lower) / 2]))
            is_split = sizes > 1
            kids = np.stack([np.full(sizes.size, -1), order[starts]], axis=1)
            kids[is_split] = node_count + np.arange(2 * is_split.sum()).reshape(-1, 2)
            below.append(kids)
            node_count += 2 * int(is_split.sum())
            longest = np.argmax(upper - lower, axis=1)[node]
            order = order[np.lexsort(((low + high)[order, longest], node))][is_split[node]]
            sizes = np.stack([sizes[is_split] // 2, sizes[is_split] - sizes[is_split] // 2], axis=1).ravel()
        return cls(np.concatenate(boxes), np.concatenate(below), np.ascontiguousarray(triangles))


def proven_apart(first: Tree, second: Tree, places: Array) -> NDArray[np.bool_]:
    """Return whether two meshes are shown to be apart, at poses of the second in the first's axes ``(P, 4, 4)``."""
    # of two boxes that overlap one is replaced by two: never more wait than there are levels
    stack = np.zeros((2 + len(first.boxes) + len(second.boxes), 2), dtype=np.int64)
    proven = np.zeros(len(places), dtype=np.bool_)
    call(_prove, (np.ascontiguousarray(places), *first, *second, stack, np.zeros((3, 3)), proven))
    return proven


@cached_entry
def _prove(
    places: Array, boxes: Array, below: Any, triangles: Array,
    other_boxes: Array, other_below: Any, other_triangles: Array, stack: Any, moved: Array, proven: Any,
) -> None:  # fmt: skip
    for pose in range(len(places)):
        place = places[pose]
        stack[0, 0] = stack[0, 1] = 0
        waiting = 1
        while waiting > 0:
            waiting -= 1
            k, j = stack[waiting, 0], stack[waiting, 1]
            if _boxes_apart(place, boxes[k], other_boxes[j]):
                continue
            is_leaf, other_is_leaf = below[k, 0] < 0, other_below[j, 0] < 0
            if is_leaf and other_is_leaf:
                if not _triangles_apart(place, triangles[below[k, 1]], other_triangles[other_below[j, 1]], moved):
                    break
                continue
            size = boxes[k, 3] + boxes[k, 4] + boxes[k, 5]
            other_size = other_boxes[j, 3] + other_boxes[j, 4] + other_boxes[j, 5]
            for side in range(2):
                if other_is_leaf or (not is_leaf and size >= other_size):
                    stack[waiting, 0], stack[waiting, 1] = below[k, side], j
                else:
                    stack[waiting, 0], stack[waiting, 1] = k, other_below[j, side]
                waiting += 1
        else:
            proven[pose] = True


@inline
def _boxes_apart(place: Array, box: Array, other: Array) -> Any:
    """Return whether boxes are apart along an axis of either."""
    x = place[0, 0] * other[0] + place[0, 1] * other[1] + place[0, 2] * other[2] + place[0, 3] - box[0]
    y = place[1, 0] * other[0] + place[1, 1] * other[1] + place[1, 2] * other[2] + place[1, 3] - box[1]
    z = place[2, 0] * other[0] + place[2, 1] * other[1] + place[2, 2] * other[2] + place[2, 3] - box[2]
    for i, along in ((0, x), (1, y), (2, z)):
        reach = box[3 + i] + abs(place[i, 0]) * other[3] + abs(place[i, 1]) * other[4] + abs(place[i, 2]) * other[5]
        if abs(along) > reach + NEAR:
            return True
    for i in range(3):
        reach = other[3 + i] + abs(place[0, i]) * box[3] + abs(place[1, i]) * box[4] + abs(place[2, i]) * box[5]
        if abs(place[0, i] * x + place[1, i] * y + place[2, i] * z) > reach + NEAR:
            return True
    return False


@inline
def _triangles_apart(place: Array, first: Array, second: Array, moved: Array) -> Any:
    """Return whether triangles are apart along a normal of either, or across an edge of both."""
    for k in range(3):
        for i in range(3):
            moved[k, i] = (
                place[i, 0] * second[k, 0] + place[i, 1] * second[k, 1] + place[i, 2] * second[k, 2] + place[i, 3]
            )
    for normals in range(11):
        # each axis at right angles to two edges: of the first, of the second, of both
        if normals == 0:
            a, b, c, d = first, 0, first, 1
        elif normals == 1:
            a, b, c, d = moved, 0, moved, 1
        else:
            a, b, c, d = first, (normals - 2) // 3, moved, (normals - 2) % 3
        b1, d1 = (b + 1) % 3, (d + 1) % 3
        ux, uy, uz = a[b1, 0] - a[b, 0], a[b1, 1] - a[b, 1], a[b1, 2] - a[b, 2]
        vx, vy, vz = c[d1, 0] - c[d, 0], c[d1, 1] - c[d, 1], c[d1, 2] - c[d, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        low = high = nx * first[0, 0] + ny * first[0, 1] + nz * first[0, 2]
        other_low = other_high = nx * moved[0, 0] + ny * moved[0, 1] + nz * moved[0, 2]
        for k in range(1, 3):
            projection = nx * first[k, 0] + ny * first[k, 1] + nz * first[k, 2]
            low, high = min(low, projection), max(high, projection)
            projection = nx * moved[k, 0] + ny * moved[k, 1] + nz * moved[k, 2]
            other_low, other_high = min(other_low, projection), max(other_high, projection)
        gap = max(other_low - high, low - other_high)
        # along any axis, so computed, the gap is real: rounding of the axis itself does no harm
        if gap > 0 and gap * gap > NEAR * NEAR * (nx * nx + ny * ny + nz * nz):
            return True
    return False
