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
"""Points along an edge of the lattice on which a cube is checked."""

# points of the grid along an axis
_GRID: Final = 17
# centres along an axis, from which the best is sought
_CENTRES: Final = 45
# fraction of the longest edge of the box, added on each side, because its samples may miss the border
_MARGIN: Final = 0.05
# best-rated centres from which a cube is pushed
_STARTS: Final = 24
# maximum number of moves of a cube away from the points that block it
_PUSHES: Final = 20
# maximum number of rounds of cube, check and new points out of reach, for each clearance
_ROUNDS: Final = 200
# bisections of a ray to the border: to 2^-16 of its length
_HALVINGS: Final = 16
# fraction of the edge kept clear of unreachable points: more than bisection leaves open
_COARSE, _FINE = 2e-3, 2e-4
# relative difference of edges up to which the first cube is chosen
_ALIKE, _ALIKE_FINE = 5e-3, 5e-4
# offsets of further centres around the coarse cube's centre, relative to its edge
_AROUND: Final = np.linspace(-0.02, 0.02, 3)
# smallest edge relative to the longest of the box; smaller cubes slip through the grid
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
    # among centres of equal room the one farthest along x, then y, z, comes first: most robots have several
    preference = 1 + 1e-2 * along
    edge, near_centres = 0.0, np.zeros((3, 0))
    for clearance, alike in ((_COARSE, _ALIKE), (_FINE, _ALIKE_FINE)):
        for _ in range(_ROUNDS):
            half_edge, centre = _best(blocked, near_centres, centres, room * preference, alike)
            edge = 2 * half_edge * (1 - clearance)
            if edge < _SMALLEST * size:
                return 0.0, (low + high) / 2
            lattice = lattice_of(edge, centre)
            q = solve(lattice)
            start = q[:, lattice.shape[1] // 2]
            unreached = lattice[:, np.isnan(q[0])]
            if clearance == _FINE and not unreached.size:
                faces = _faces(edge, centre)
                unreached = faces[:, np.isnan(solve(faces)[0])]
            if not unreached.size:
                break
            # at most 80 border points per round
            border = unreached[:, :: -(-unreached.shape[1] // 80)]
            border = np.column_stack([centre, border]) if np.isnan(start[0]) else _border(solve, centre, start, border)
            blocked = np.concatenate([blocked, border], axis=1)
            room = np.minimum(room, cKDTree(border.T).query(centres.T, p=np.inf)[0])
        else:
            return 0.0, (low + high) / 2
        around: Array = np.array(np.meshgrid(_AROUND, _AROUND, _AROUND, indexing="ij")).reshape(3, -1)
        near_centres = centre[:, None] + edge * around
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


def _best(blocked: Array, first_centres: Array, centres: Array, rating: Array, alike: float) -> tuple[float, Array]:
    """Return half the edge and the centre of the largest cube that holds no blocked point, from the best of many centres.

    Of those that are alike one from the centres ``near`` is taken, then the preferred one.
    """
    starts = centres[:, np.argsort(-rating, kind="stable")[:_STARTS]]
    local = sorted((_push_cube(blocked, start) for start in first_centres.T), key=lambda cube: -cube[0])
    cubes = [*local, *(_push_cube(blocked, start) for start in starts.T)]
    largest = max(half_edge for half_edge, _ in cubes)
    return next(cube for cube in cubes if cube[0] >= largest * (1 - alike))


def _push_cube(blocked: Array, centre: Array) -> tuple[float, Array]:
    """Return half the edge and the centre of a cube that is pushed away from the points that block it.

    A point blocks on the side where it is farthest from the centre. The points of each side bound a box that holds none, and
    the centre of the box has at least as much room.
    """
    half_edge, best_centre = 0.0, centre
    for _ in range(_PUSHES):
        gaps = blocked - centre[:, None]
        side = np.argmax(np.abs(gaps), axis=0)
        farthest = np.take_along_axis(gaps, side[None], axis=0)[0]
        candidate = float(np.abs(farthest).min())
        if candidate <= half_edge * (1 + 1e-6):
            break
        half_edge, best_centre = candidate, centre
        upper = [gaps[k, (side == k) & (farthest > 0)].min(initial=np.inf) for k in range(3)]
        lower = [gaps[k, (side == k) & (farthest <= 0)].max(initial=-np.inf) for k in range(3)]
        shift = np.add(upper, lower) / 2
        centre = centre + np.where(np.isfinite(shift), shift, 0.0)
    return half_edge, best_centre


def _border(solve: Solver, inner: Array, start: Array, outer: Array) -> Array:
    """Return points ``(3, P)`` out of reach, next to the border, between a point within reach and others out of reach.

    Steps from a solution follow one branch of the inverse kinematics. Where it ends all are asked: what another branch
    reaches is followed from there. `start` is the solution ``(n,)`` of the point within reach.
    """
    rays = outer - inner[:, None]
    near, far = np.zeros(outer.shape[1]), np.ones(outer.shape[1])
    q, ids = np.repeat(start[:, None], outer.shape[1], axis=1), np.arange(outer.shape[1])
    # maximum number of branches followed towards an unreachable point
    for _ in range(8):
        for _ in range(_HALVINGS):
            middle = (near[ids] + far[ids]) / 2
            solutions = solve(inner[:, None] + middle * rays[:, ids], q[:, ids])
            within = np.isfinite(solutions[0])
            near[ids], far[ids] = (np.where(within, middle, near[ids]), np.where(within, far[ids], middle))
            q[:, ids[within]] = solutions[:, within]
        solutions = solve(inner[:, None] + far[ids] * rays[:, ids])
        within = np.isfinite(solutions[0])
        ids = ids[within]
        near[ids], far[ids], q[:, ids] = far[ids], 1.0, solutions[:, within]
        if not ids.size:
            break
    return inner[:, None] + far * rays


PLANES: Final = ("y, rising with x", "y, falling with x", "x, rising with y", "x, falling with y")
"""The four diagonal planes of a cube with horizontal edges: the base axis of these, and how the plane slopes."""
# distance of P2 to P5 from the centre along each axis, by the edge: the standard's 10 % within the cube's corners
_SHARE: Final = 0.4
# velocity of a joint, relative to the fastest, below which it does not move on the last segment of a path
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
        """Name of the plane."""
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
    start = tool.solve(points[:, :1])
    q = tool.solve(points, np.repeat(start, 5, axis=1))
    is_missing = np.isnan(q[0])
    if is_missing.any():  # not within Newton's reach from P1
        q[:, is_missing] = tool.solve(points[:, is_missing])
    return q


def paths_of_approach(jacobian: Array) -> list[tuple[int, ...]]:
    """Return the directions in which the joints move on straight paths along the three base axes, the tool not turning.

    Args:
        jacobian: Velocity of the target and of the tool's angles by those of the joints, base axes, ``(6, n)``.
    """
    velocities = np.linalg.pinv(jacobian if jacobian.shape[1] >= 6 else jacobian[:3])[:, :3]
    size = np.abs(velocities).max(axis=0, initial=1e-300)
    signs = np.where(np.abs(velocities) > _STILL * size, np.sign(velocities), 0.0)
    return [tuple(int(sign) for sign in column) for column in signs.T]


# configurations that steps start from, drawn evenly between the limits
_KNOWN: Final = 40_000
# seed of these configurations, the number of the standard
_SEED: Final = 9283
# nearest known configurations that steps to a point start from
_NEAREST: Final = 10
# nearest solved points from which an unsolved one is retried
_NEIGHBOURS: Final = 6
# minimum number of points solved in a call whose solutions start later calls
_MANY: Final = 100


@dataclass(frozen=True, eq=False)
class ToolPoses:
    """Joint values that place the tool at given points with a fixed orientation.

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
            return self._drop_collisions(self._descend(points, starts))
        q = np.full((len(self.chain.joints), points.shape[1]), np.nan)
        if self._solutions:
            q = self._steps_from(points, self._nearby(points, 1), q)
        gaps = np.flatnonzero(np.isnan(q[0]))
        nearest = self._known[0][:, self._nearest(points[:, gaps])]
        q[:, gaps] = self._steps_from(points[:, gaps], nearest[..., :1], q[:, gaps])
        is_gap = np.isnan(q[0, gaps])
        q[:, gaps[is_gap]] = self._steps_from(points[:, gaps[is_gap]], nearest[:, is_gap, 1:], q[:, gaps[is_gap]])
        is_found, gaps = np.isfinite(q[0]), np.flatnonzero(np.isnan(q[0]))
        if np.count_nonzero(is_found) >= (_MANY if self._solutions else _NEIGHBOURS):
            self._solutions.append((points[:, is_found], q[:, is_found]))
            self.__dict__.pop("_solution_tree", None)
        if self._solutions and gaps.size:
            # retry unsolved points from their neighbours' solutions
            q[:, gaps] = self._steps_from(points[:, gaps], self._nearby(points[:, gaps], _NEIGHBOURS), q[:, gaps])
        return q

    def _steps_from(self, points: Array, starts: Array, fallback: Array) -> Array:
        """Return joint values ``(n, P)`` after steps from starts ``(n, P, K)``, those found before where none arrive."""
        count = starts.shape[2]
        q = self._drop_collisions(self._descend(np.repeat(points, count, axis=1), starts.reshape(starts.shape[0], -1)))
        q = q.reshape(starts.shape)
        first_trial = np.argmax(np.isfinite(q[0]), axis=1)
        solutions: Array = np.take_along_axis(q, first_trial[None, :, None], axis=2)[..., 0]
        return np.where(np.isnan(solutions[:1]), fallback, solutions)

    def _drop_collisions(self, q: Array) -> Array:
        finite = np.flatnonzero(np.isfinite(q[0]))
        if self.avoids and self.chain.collision_check is not None and finite.size:
            is_free = self.chain.collision_check.free(np.ascontiguousarray(q[:, finite]))
            q[:, finite[~is_free]] = np.nan
        return q

    def _nearby(self, points: Array, count: int) -> Array:
        """Return the solutions ``(n, P, count)`` of the nearest points solved earlier."""
        tree, q = self._solution_tree
        return q[:, tree.query(points.T, k=np.arange(1, count + 1))[1]]

    @cached_property
    def _solutions(self) -> list[tuple[Array, Array]]:
        """Solved points and joint values of earlier calls with many points."""
        return []

    @cached_property
    def _solution_tree(self) -> tuple[cKDTree, Array]:
        points, q = (np.concatenate(parts, axis=1) for parts in zip(*self._solutions, strict=True))
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
        # one turn suffices for a joint with a larger range
        is_full_turn = (high - low >= 2 * np.pi) & ~np.array(self.chain.prismatic)
        return np.where(is_full_turn, -np.pi, low), np.where(is_full_turn, np.pi, high)

    @cached_property
    def _known(self) -> tuple[Array, Array]:
        """Configurations ``(n, K)``, with target position and scaled tool axes, ``(K, 3 or 12)``."""
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
        """Constant placements up to the tool point, axes, and mask of prismatic joints."""
        tool = self.chain.target_placement @ se3.translation(self.target)
        return np.array([*self.chain.placements[:-1], tool]), np.array(self.chain.axes), np.array(self.chain.prismatic)


ARRIVED: Final = 1e-6
"""Convergence tolerance: m, angles scaled to lengths."""
# maximum number of steps to a pose
_ITERATIONS: Final = 30
# rad, and m
_LONGEST_STEP: Final = 0.5
# remaining error fraction at which the iteration counts as stalled
_STALLED: Final = 0.9
# steps between two checks that the error still falls
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
    solutions, n = np.full(q.shape, np.nan), q.shape[1]
    scratch = (
        np.zeros((n + 1, 3, 4)), np.zeros((n, 3)), np.zeros((size, n)), np.zeros((size, size + 1)), np.zeros(size), np.zeros(n)
    )  # fmt: skip
    call(_descend, (*arm, *limits, orientation, scale, np.ascontiguousarray(points.T), q, solutions, *scratch))
    return solutions.T


@cached_entry
def _descend(
    placements: Array, axes: Array, slides: Any, low: Array, high: Array, orientation: Array, scale: float,
    points: Array, q: Array, solutions: Array,
    frames: Array, turned: Array, slopes: Array, square: Array, error: Array, step: Array,
) -> None:  # fmt: skip
    n, m = len(axes), len(error)
    for point in range(len(points)):
        joints, previous = q[point], np.inf
        for iteration in range(_ITERATIONS):
            _forward_kinematics(placements, axes, slides, joints, frames, turned)
            tip = frames[n]
            for i in range(3):
                error[i] = points[point, i] - tip[i, 3]
            if m == 6:
                _orientation_error(orientation, tip, scale, error)
            size = 0.0
            for i in range(m):
                size += error[i] * error[i]
            size = np.sqrt(size)
            if size < ARRIVED:
                for k in range(n):
                    solutions[point, k] = joints[k]
                break
            if iteration % _PATIENCE == _PATIENCE - 1:
                if size >= _STALLED * previous:
                    break
                previous = size
            for k in range(n):
                _slope_of(k, frames, turned, slides, tip, scale, slopes)
            _step(slopes, error, size, square, step)
            # a joint at its limit is omitted: the others compensate, if they can
            is_held = False
            for k in range(n):
                if (joints[k] <= low[k] and step[k] < 0) or (joints[k] >= high[k] and step[k] > 0):
                    is_held = True
                    for i in range(m):
                        slopes[i, k] = 0.0
            if is_held:
                _step(slopes, error, size, square, step)
            longest = 0.0
            for k in range(n):
                longest = max(longest, abs(step[k]))
            fraction = min(1.0, _LONGEST_STEP / max(longest, 1e-300))
            for k in range(n):
                joints[k] = min(max(joints[k] + fraction * step[k], low[k]), high[k])


@inline
def _forward_kinematics(placements: Array, axes: Array, slides: Any, q: Array, frames: Array, turned: Array) -> None:
    """Write the moved joint frames and the tip frame to ``frames`` ``(n + 1, 3, 4)``, joint axes in the base to ``turned``."""
    for k in range(len(frames)):
        link, frame = placements[k], frames[k]
        for i in range(3):
            for j in range(4):
                if k == 0:
                    frame[i, j] = link[i, j]
                else:
                    base = frames[k - 1]
                    shift = base[i, 3] if j == 3 else 0.0
                    frame[i, j] = base[i, 0] * link[0, j] + base[i, 1] * link[1, j] + base[i, 2] * link[2, j] + shift
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
    """Write the derivative of the tool pose with respect to a joint to its column."""
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
def _orientation_error(target: Array, tip: Array, scale: float, error: Array) -> None:
    """Write the rotation vector from tip to target orientation, base axes, times a length to the last three entries of error."""
    r00 = target[0, 0] * tip[0, 0] + target[0, 1] * tip[0, 1] + target[0, 2] * tip[0, 2]
    r01 = target[0, 0] * tip[1, 0] + target[0, 1] * tip[1, 1] + target[0, 2] * tip[1, 2]
    r02 = target[0, 0] * tip[2, 0] + target[0, 1] * tip[2, 1] + target[0, 2] * tip[2, 2]
    r10 = target[1, 0] * tip[0, 0] + target[1, 1] * tip[0, 1] + target[1, 2] * tip[0, 2]
    r11 = target[1, 0] * tip[1, 0] + target[1, 1] * tip[1, 1] + target[1, 2] * tip[1, 2]
    r12 = target[1, 0] * tip[2, 0] + target[1, 1] * tip[2, 1] + target[1, 2] * tip[2, 2]
    r20 = target[2, 0] * tip[0, 0] + target[2, 1] * tip[0, 1] + target[2, 2] * tip[0, 2]
    r21 = target[2, 0] * tip[1, 0] + target[2, 1] * tip[1, 1] + target[2, 2] * tip[1, 2]
    r22 = target[2, 0] * tip[2, 0] + target[2, 1] * tip[2, 1] + target[2, 2] * tip[2, 2]
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
    """Write Jᵀ (J Jᵀ + λ 1)⁻¹ e, damped by the squared error (Sugihara 2011), to step, by Cholesky factorisation."""
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
    # the last column holds the weights
    for i in range(m):
        total = error[i]
        for k in range(i):
            total -= square[i, k] * square[k, m]
        square[i, m] = total / square[i, i]
    for count in range(m):
        i = m - 1 - count
        total = square[i, m]
        for k in range(i + 1, m):
            total -= square[k, i] * square[k, m]
        square[i, m] = total / square[i, i]
    for k in range(n):
        total = 0.0
        for i in range(m):
            total += slopes[i, k] * square[i, m]
        step[k] = total
