"""The largest cube with edges along the base axes that lies within reach.

A cube with centre c that holds no point u out of reach has at most the edge 2 min |u - c|∞. So the centre is sought for which
this bound is largest, over points known to be out of reach: at first those of a grid. The cube found is looked at on a
lattice. Where points of it are out of reach, the border of the workspace is found between them and the centre, its points are
added to the known ones, and the search goes on. The first cube whose lattice is all within reach is the largest, as far as
lattice and grid see. It is found with a coarse clearance first, which settles where it is, then with a fine one.

Which of thousands of tool poses are within reach: one solution of each, by damped Gauss-Newton steps in compiled code.

:mod:`precision_pin.robot.inverse_kinematics` finds all solutions of a pose, which takes a thousand times as long. The steps
start from the nearest of many known configurations.

An arm of six joints or more keeps the orientation; one of fewer is free to turn the tool. What is found is checked by the
forward kinematics: position to a micrometre, orientation to a microradian, joints inside their limits. What is not found counts
as out of reach: of 4,000 points about a Panda none that inverse kinematics in closed form reaches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from precision_pin.base import se3
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import InputError
from precision_pin.base.jit import cached_entry, call, inline
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_set import PoseSet

Solver = Callable[..., Array]
"""Joint values ``(n, P)`` of points ``(3, P)``, NaN where out of reach; with values to start from, of the branch of these."""

LATTICE: Final = 13
"""Points along an edge of the lattice on which a cube is looked at."""

# points of the grid along an axis
_GRID: Final = 17
# centres along an axis, from which the best is sought
_CENTRES: Final = 45
# of the longest edge of the box, on each side: what the box is known from may miss the border
_MARGIN: Final = 0.05
_STARTS: Final = 24
_PUSHES: Final = 20
_ROUNDS: Final = 200
_HALVINGS: Final = 16
# share of the edge that is kept clear of points out of reach: more than halving leaves open
_COARSE, _FINE = 2e-3, 2e-4
# of cubes whose edges differ by no more the first is taken
_ALIKE, _ALIKE_FINE = 5e-3, 5e-4
# places of more centres around that of the coarse cube, by its edge
_AROUND: Final = np.linspace(-0.02, 0.02, 3)
# smallest edge by the longest of the box; what is smaller slips through the grid
_SMALLEST: Final = 0.02


def largest_cube(solve: Solver, low: Array, high: Array) -> tuple[float, Array]:
    """Return edge and centre ``(3,)`` of the largest cube found; an edge of zero where there is none.

    Args:
        solve: Solutions of points.
        low, high: A box that holds all points within reach, ``(3,)``.
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
    # among centres whose room differs by no more the one farthest along x comes first, or along y, z: most robots
    # have several
    preference = 1 + 1e-2 * along
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
            # most points of the border that are sought in a round
            found = outside[:, :: -(-outside.shape[1] // 80)]
            found = np.column_stack([centre, found]) if np.isnan(start[0]) else _border(solve, centre, start, found)
            blocked = np.concatenate([blocked, found], axis=1)
            room = np.minimum(room, cKDTree(found.T).query(centres.T, p=np.inf)[0])
        else:
            return 0.0, (low + high) / 2
        around: Array = np.array(np.meshgrid(_AROUND, _AROUND, _AROUND, indexing="ij")).reshape(3, -1)
        near = centre[:, None] + edge * around
    return edge, centre


def lattice_of(edge: float, centre: Array) -> Array:
    """Return the points of the lattice over a cube, its corners among them, ``(3, LATTICE³)``."""
    return _grid(centre - edge / 2, centre + edge / 2, LATTICE)


def _faces(edge: float, centre: Array) -> Array:
    # points along an edge of the finer lattice on the faces, where the border of the workspace comes in between
    points = _grid(np.full(3, -1.0), np.ones(3), 37)
    return centre[:, None] + edge / 2 * points[:, np.abs(points).max(axis=0) == 1]


def _grid(low: Array, high: Array, count: int) -> Array:
    lines = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    return np.array(np.meshgrid(*lines, indexing="ij")).reshape(3, -1)


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
    # most branches that are followed towards a point out of reach
    for _ in range(8):
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
    return inside[:, None] + far * ways


PLANES: Final = ("y, rising with x", "y, falling with x", "x, rising with y", "x, falling with y")
"""The four diagonal planes of a cube with horizontal edges: the base axis of these, and how the plane slopes."""
# distance of P2 to P5 from the centre along each axis, by the edge: the standard's 10 % within the cube's corners
_SHARE: Final = 0.4
# velocity of a joint, by that of the fastest, below which it does not move on the last piece of a path
_STILL: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Cube(Record):
    """The cube that a test is made in.

    Attributes:
        side: Length of its edges, m.
        centre: Base axes, m, ``(3,)``.
        plane: Number in `PLANES` of the diagonal plane in which P2 to P5 lie.
    """

    KEYS: ClassVar[Keys] = ("side", "centre", "axes", "plane=plane_name")
    axes: ClassVar[str] = "base"

    side: float
    centre: Array
    plane: int = 0

    @property
    def plane_name(self) -> str:
        """The plane in words."""
        return PLANES[self.plane]

    def points(self) -> Array:
        """Return P1 to P5, ``(3, 5)``: the centre, two points up and two down, P2 opposite P4."""
        along, across = ((1, 0), (1, 0), (0, 1), (0, 1))[self.plane]
        slope = 1 if self.plane % 2 == 0 else -1
        offsets = np.zeros((3, 5))
        offsets[along] = [0, -1, 1, 1, -1]
        offsets[across] = slope * np.array([0, 1, 1, -1, -1])
        offsets[2] = [0, 1, 1, -1, -1]
        return self.centre[:, None] + _SHARE * self.side * offsets


def standard_poses(chain: Chain, reference: Array, target: Array) -> tuple[PoseSet, Cube]:
    """Return P1 to P5 in the largest cube with edges along the base axes that the target reaches.

    The tool keeps the orientation that it has at the reference; an arm of fewer than six joints turns it as it must.

    Args:
        chain: The arm.
        reference: Joint values of the pose that has the orientation, ``(n,)``.
        target: The measured point in tool axes, m.
    """
    tool = ToolPoses(chain, chain.at(reference).pose[:3, :3], target)
    cube, q = _poses_in_cube(tool)
    if chain.collision_check is not None and not chain.collision_check.free(q).all():
        # the same cube by other branches or in another diagonal plane, else the largest one in which the arm hits
        # nothing
        tool = replace(tool, avoids=True)
        for plane in range(len(PLANES)):
            cube = replace(cube, plane=plane)
            q = _follow(tool, cube)
            if not np.isnan(q).any():
                break
        else:
            cube, q = _poses_in_cube(tool)
    return PoseSet.at(chain, q, tuple(f"P{k}" for k in range(1, 6))), cube


def _poses_in_cube(tool: ToolPoses) -> tuple[Cube, Array]:
    """Return the largest cube, and joint values ``(n, 5)`` of the poses in it."""
    centre, radius = tool.ball
    side, middle = largest_cube(tool.solve, centre - radius, centre + radius)
    turned = "with the tool turned as at the first pose" if tool.keeps_orientation else "with the tool turned as it may"
    if not side > 0:
        raise InputError(
            f"no cube is within reach {turned}; name the five poses of the test, P1 to P5, with --pose or --q"
        )
    cube = Cube(side, middle)
    q = _follow(tool, cube)
    if np.isnan(q).any():
        raise InputError(f"not all five poses in the cube are within reach {turned}; name them with --pose or --q")
    return cube, q


def _follow(tool: ToolPoses, cube: Cube) -> Array:
    points = cube.points()
    first = tool.solve(points[:, :1])
    q = tool.solve(points, np.repeat(first, 5, axis=1))
    missed = np.isnan(q[0])
    if missed.any():  # not within Newton's reach from P1
        q[:, missed] = tool.solve(points[:, missed])
    return q


def paths_of_approach(jacobian: Array) -> list[tuple[int, ...]]:
    """Return the directions in which the joints move on straight paths along the three base axes, the tool not turning.

    Args:
        jacobian: Velocity of the target and of the tool's angles by those of the joints, base axes, ``(6, n)``.
    """
    moved = np.linalg.pinv(jacobian if jacobian.shape[1] >= 6 else jacobian[:3])[:, :3]
    size = np.abs(moved).max(axis=0, initial=1e-300)
    signs = np.where(np.abs(moved) > _STILL * size, np.sign(moved), 0.0)
    return [tuple(int(sign) for sign in column) for column in signs.T]


# configurations that steps start from, drawn evenly between the limits
_KNOWN: Final = 40_000
_SEED: Final = 9283
_NEAREST: Final = 10
_NEIGHBOURS: Final = 6
# points found in a call, from which its solutions are starts of later calls
_MANY: Final = 100


@dataclass(frozen=True, eq=False)
class ToolPoses:
    """Joint values for points that the tool takes with one orientation.

    Attributes:
        chain: The arm.
        orientation: Of the tool in the base, ``(3, 3)``.
        target: The point in tool axes that is to be at the points, m.
        avoids: Whether joint values at which the arm hits something count as none.
    """

    chain: Chain
    orientation: Array
    target: Array
    avoids: bool = False

    @property
    def keeps_orientation(self) -> bool:
        """Whether the arm has enough joints for the orientation."""
        return len(self.chain.joints) >= 6

    def solve(self, points: Array, starts: Array | None = None) -> Array:
        """Return joint values ``(n, P)`` for points ``(3, P)``, NaN where none are found.

        Args:
            points: Positions of the target in the base.
            starts: Configurations ``(n, P)`` to start from. Where left out: the solution of the nearest point that an
                earlier call found, then the nearest known configurations, then the solutions of more points nearby.
        """
        if starts is not None:
            return self._allowed(self._descend(points, starts))
        found = np.full((len(self.chain.joints), points.shape[1]), np.nan)
        if self._found:
            found = self._from(points, self._beside(points, 1), found)
        left = np.flatnonzero(np.isnan(found[0]))
        nearest = self._known[0][:, self._nearest(points[:, left])]
        found[:, left] = self._from(points[:, left], nearest[..., :1], found[:, left])
        still = np.isnan(found[0, left])
        found[:, left[still]] = self._from(points[:, left[still]], nearest[:, still, 1:], found[:, left[still]])
        known, left = np.isfinite(found[0]), np.flatnonzero(np.isnan(found[0]))
        if np.count_nonzero(known) >= (_MANY if self._found else _NEIGHBOURS):
            self._found.append((points[:, known], found[:, known]))
            self.__dict__.pop("_found_tree", None)
        if self._found and left.size:
            # a point that was missed beside some that were found is tried again from there
            found[:, left] = self._from(points[:, left], self._beside(points[:, left], _NEIGHBOURS), found[:, left])
        return found

    def _from(self, points: Array, starts: Array, found: Array) -> Array:
        """Return joint values ``(n, P)`` after steps from starts ``(n, P, K)``, those found before where none arrive."""
        count = starts.shape[2]
        arrived = self._allowed(self._descend(np.repeat(points, count, axis=1), starts.reshape(starts.shape[0], -1)))
        arrived = arrived.reshape(starts.shape)
        first = np.argmax(np.isfinite(arrived[0]), axis=1)
        chosen: Array = np.take_along_axis(arrived, first[None, :, None], axis=2)[..., 0]
        return np.where(np.isnan(chosen[:1]), found, chosen)

    def _allowed(self, q: Array) -> Array:
        known = np.flatnonzero(np.isfinite(q[0]))
        if self.avoids and self.chain.collision_check is not None and known.size:
            free = self.chain.collision_check.free(np.ascontiguousarray(q[:, known]))
            q[:, known[~free]] = np.nan
        return q

    def _beside(self, points: Array, count: int) -> Array:
        """Return the solutions ``(n, P, count)`` of the nearest points that were found earlier."""
        tree, q = self._found_tree
        return q[:, tree.query(points.T, k=np.arange(1, count + 1))[1]]

    @cached_property
    def _found(self) -> list[tuple[Array, Array]]:
        """Points and joint values that earlier calls for many points have found."""
        return []

    @cached_property
    def _found_tree(self) -> tuple[cKDTree, Array]:
        points, q = (np.concatenate(parts, axis=1) for parts in zip(*self._found, strict=True))
        return cKDTree(points.T), q

    @property
    def ball(self) -> tuple[Array, float]:
        """Centre and radius of a ball that holds every known position of the target."""
        positions = self._known[1][:, :3]
        middle = (positions.max(axis=0) + positions.min(axis=0)) / 2
        return middle, float(np.abs(positions - middle).max()) * 1.02

    @cached_property
    def _scale(self) -> float:
        """Length that counts as much as a radian, m."""
        return float(np.linalg.norm(self.chain.placements[1:, :3, 3], axis=1).sum()) / 4 or 1.0

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        low, high = self.chain.configurations.limits
        # a full turn is enough of a joint that turns farther
        turns = (high - low >= 2 * np.pi) & ~np.array(self.chain.prismatic)
        return np.where(turns, -np.pi, low), np.where(turns, np.pi, high)

    @cached_property
    def _known(self) -> tuple[Array, Array]:
        """Configurations ``(n, K)``, and position of the target and scaled axes of the tool, ``(K, 3 or 12)``."""
        low, high = self._limits
        q = low[:, None] + (high - low)[:, None] * np.random.default_rng(_SEED).random((low.size, _KNOWN))
        pose = self.chain.at_columns(q).pose
        return q, self._features(pose[:3, 3] + np.einsum("ijn,j->in", pose[:3, :3], self.target), pose[:3, :3])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._known[1])

    def _features(self, positions: Array, rotations: Array) -> Array:
        if not self.keeps_orientation:
            return positions.T.copy()
        return np.concatenate([positions.T, self._scale / np.sqrt(2) * rotations.reshape(9, -1).T], axis=1)

    def _nearest(self, points: Array) -> NDArray[np.int64]:
        turned = np.repeat(self.orientation[:, :, None], points.shape[1], axis=2)
        return self._tree.query(self._features(points, turned), k=_NEAREST)[1]

    def _descend(self, points: Array, begin: Array) -> Array:
        """Return joint values ``(n, P)`` after steps from some, NaN where they do not arrive."""
        scale = self._scale if self.keeps_orientation else 0.0
        return descend(self._arm, self.chain.configurations.limits, self.orientation, scale, points, begin)

    @cached_property
    def _arm(self) -> tuple[Array, Array, Array]:
        """Constant poses up to the point that is to be at the points, axes, and which joints slide."""
        end = self.chain.target_placement @ se3.translation(self.target)
        return np.array([*self.chain.placements[:-1], end]), np.array(self.chain.axes), np.array(self.chain.prismatic)


ARRIVED: Final = 1e-6
"""What may be missing: m, and angles in units of length."""
_ITERATIONS: Final = 30
# rad, and m
_LONGEST_STEP: Final = 0.5
# share of the error that is left after some steps where they lead nowhere
_STALLED: Final = 0.9
_PATIENCE: Final = 6


def descend(
    arm: tuple[Array, Array, Array],
    limits: tuple[Array, Array],
    orientation: Array,
    scale: float,
    points: Array,
    begin: Array,
) -> Array:
    """Return joint values ``(n, P)`` after steps from some, NaN where they do not arrive.

    Args:
        arm: Constant poses ``(n + 1, 4, 4)``, axes ``(n, 3)`` and which joints slide.
        limits: Least and largest joint values.
        orientation: Of the tool in the base.
        scale: Length that counts as much as a radian; 0 where the tool may turn.
        points: Where the tool is to be, ``(3, P)``.
        begin: Joint values to start from, ``(n, P)``.
    """
    q, size = np.array(begin.T, order="C"), 6 if scale > 0 else 3
    found, n = np.full(q.shape, np.nan), q.shape[1]
    scratch = (
        np.zeros((n + 1, 3, 4)), np.zeros((n, 3)), np.zeros((size, n)), np.zeros((size, size + 1)), np.zeros(size), np.zeros(n)
    )  # fmt: skip
    call(_descend, (*arm, *limits, orientation, scale, np.ascontiguousarray(points.T), q, found, *scratch))
    return found.T


@cached_entry
def _descend(
    placements: Array, axes: Array, slides: Any, low: Array, high: Array, orientation: Array, scale: float,
    points: Array, q: Array, found: Array,
    frames: Array, turned: Array, slopes: Array, square: Array, error: Array, step: Array,
) -> None:  # fmt: skip
    n, m = len(axes), len(error)
    for point in range(len(points)):
        here, before = q[point], np.inf
        for iteration in range(_ITERATIONS):
            _go(placements, axes, slides, here, frames, turned)
            tip = frames[n]
            for i in range(3):
                error[i] = points[point, i] - tip[i, 3]
            if m == 6:
                _turn_left(orientation, tip, scale, error)
            size = 0.0
            for i in range(m):
                size += error[i] * error[i]
            size = np.sqrt(size)
            if size < ARRIVED:
                for k in range(n):
                    found[point, k] = here[k]
                break
            if iteration % _PATIENCE == _PATIENCE - 1:
                if size >= _STALLED * before:
                    break
                before = size
            for k in range(n):
                _slope_of(k, frames, turned, slides, tip, scale, slopes)
            _step(slopes, error, size, square, step)
            # a joint that a limit stops is left out: the others reach what it does not, if they can
            held = False
            for k in range(n):
                if (here[k] <= low[k] and step[k] < 0) or (here[k] >= high[k] and step[k] > 0):
                    held = True
                    for i in range(m):
                        slopes[i, k] = 0.0
            if held:
                _step(slopes, error, size, square, step)
            longest = 0.0
            for k in range(n):
                longest = max(longest, abs(step[k]))
            share = min(1.0, _LONGEST_STEP / max(longest, 1e-300))
            for k in range(n):
                here[k] = min(max(here[k] + share * step[k], low[k]), high[k])


@inline
def _go(placements: Array, axes: Array, slides: Any, q: Array, frames: Array, turned: Array) -> None:
    """Put each joint's frame after its motion, and the tip's, into frames ``(n + 1, 3, 4)``, axes in the base beside them."""
    for k in range(len(frames)):
        link, frame = placements[k], frames[k]
        for i in range(3):
            for j in range(4):
                if k == 0:
                    frame[i, j] = link[i, j]
                else:
                    last = frames[k - 1]
                    far = last[i, 3] if j == 3 else 0.0
                    frame[i, j] = last[i, 0] * link[0, j] + last[i, 1] * link[1, j] + last[i, 2] * link[2, j] + far
        if k == len(axes):
            return
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        for i in range(3):
            turned[k, i] = frame[i, 0] * x + frame[i, 1] * y + frame[i, 2] * z
        if slides[k]:
            for i in range(3):
                frame[i, 3] += q[k] * turned[k, i]
            continue
        # rows of the frame's axes about the joint's axis (Rodrigues): R (1 + s K + v K²)
        s, half = np.sin(q[k]), np.sin(q[k] / 2)
        v = 2 * half * half
        for i in range(3):
            a, b, c = frame[i, 0], frame[i, 1], frame[i, 2]
            ka, kb, kc = b * z - c * y, c * x - a * z, a * y - b * x
            frame[i, 0] = a + s * ka + v * (kb * z - kc * y)
            frame[i, 1] = b + s * kb + v * (kc * x - ka * z)
            frame[i, 2] = c + s * kc + v * (ka * y - kb * x)


@inline
def _slope_of(k: Any, frames: Array, turned: Array, slides: Any, tip: Array, scale: float, slopes: Array) -> None:
    """Put the derivative of the tool's place by a joint into its column."""
    x, y, z = turned[k, 0], turned[k, 1], turned[k, 2]
    if slides[k]:
        slopes[0, k], slopes[1, k], slopes[2, k] = x, y, z
        x = y = z = 0.0
    else:
        a, b, c = tip[0, 3] - frames[k, 0, 3], tip[1, 3] - frames[k, 1, 3], tip[2, 3] - frames[k, 2, 3]
        slopes[0, k], slopes[1, k], slopes[2, k] = y * c - z * b, z * a - x * c, x * b - y * a
    if len(slopes) == 6:
        slopes[3, k], slopes[4, k], slopes[5, k] = scale * x, scale * y, scale * z


@inline
def _turn_left(wanted: Array, tip: Array, scale: float, error: Array) -> None:
    """Put the rotation vector from the tip's attitude to the wanted one, base axes, times a length into the error's end."""
    r00 = wanted[0, 0] * tip[0, 0] + wanted[0, 1] * tip[0, 1] + wanted[0, 2] * tip[0, 2]
    r01 = wanted[0, 0] * tip[1, 0] + wanted[0, 1] * tip[1, 1] + wanted[0, 2] * tip[1, 2]
    r02 = wanted[0, 0] * tip[2, 0] + wanted[0, 1] * tip[2, 1] + wanted[0, 2] * tip[2, 2]
    r10 = wanted[1, 0] * tip[0, 0] + wanted[1, 1] * tip[0, 1] + wanted[1, 2] * tip[0, 2]
    r11 = wanted[1, 0] * tip[1, 0] + wanted[1, 1] * tip[1, 1] + wanted[1, 2] * tip[1, 2]
    r12 = wanted[1, 0] * tip[2, 0] + wanted[1, 1] * tip[2, 1] + wanted[1, 2] * tip[2, 2]
    r20 = wanted[2, 0] * tip[0, 0] + wanted[2, 1] * tip[0, 1] + wanted[2, 2] * tip[0, 2]
    r21 = wanted[2, 0] * tip[1, 0] + wanted[2, 1] * tip[1, 1] + wanted[2, 2] * tip[1, 2]
    r22 = wanted[2, 0] * tip[2, 0] + wanted[2, 1] * tip[2, 1] + wanted[2, 2] * tip[2, 2]
    # the unit quaternion by its largest part, as in se3.log_rotation
    trace = r00 + r11 + r22
    if trace >= r00 and trace >= r11 and trace >= r22:
        w, x, y, z = 1 + trace, r21 - r12, r02 - r20, r10 - r01
    elif r00 >= r11 and r00 >= r22:
        w, x, y, z = r21 - r12, 1 + 2 * r00 - trace, r01 + r10, r02 + r20
    elif r11 >= r22:
        w, x, y, z = r02 - r20, r01 + r10, 1 + 2 * r11 - trace, r12 + r21
    else:
        w, x, y, z = r10 - r01, r02 + r20, r12 + r21, 1 + 2 * r22 - trace
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = np.sqrt(x * x + y * y + z * z)
    by = scale * (2 * np.arctan2(sine, w) / sine if sine > 0 else 0.0)
    error[3], error[4], error[5] = by * x, by * y, by * z


@inline
def _step(slopes: Array, error: Array, size: float, square: Array, step: Array) -> None:
    """Put Jᵀ (J Jᵀ + λ 1)⁻¹ e, damped by the square of the error (Sugihara 2011), into a step; by Cholesky's factor."""
    m, n = slopes.shape
    damping = 1e-2 * size * size + 1e-12
    for i in range(m):
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(n):
                total += slopes[i, k] * slopes[j, k]
            for k in range(j):
                total -= square[i, k] * square[j, k]
            # rounding must not make a square negative
            square[i, j] = np.sqrt(max(total, 1e-18)) if i == j else total / square[j, j]
    # the last column: the weights
    for i in range(m):
        total = error[i]
        for k in range(i):
            total -= square[i, k] * square[k, m]
        square[i, m] = total / square[i, i]
    for back in range(m):
        i = m - 1 - back
        total = square[i, m]
        for k in range(i + 1, m):
            total -= square[k, i] * square[k, m]
        square[i, m] = total / square[i, i]
    for k in range(n):
        total = 0.0
        for i in range(m):
            total += slopes[i, k] * square[i, m]
        step[k] = total
