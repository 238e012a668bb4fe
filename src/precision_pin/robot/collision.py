"""Collision checks: self-collision and keep-out zones (planes and boxes); only module that calls coal.

Collision shapes are those of the URDF, meshes as they are. Link pairs carried by different joints are checked, except a
link and the next one with a shape, and links that touch at joint zero or everywhere. What joints off the chain carry
stands still at their locked values.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Protocol

import coal
import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.robot.mesh_surfaces import MeshReader, UnreadableMeshError, merged
from precision_pin.robot.places import LinkFrame
from precision_pin.robot.postures import alignment
from precision_pin.robot.urdf import Box, Cylinder, Mesh, Robot, Shape, Sphere

if TYPE_CHECKING:
    from precision_pin.robot.collision_loops import Tree
    from precision_pin.robot.configurations import Configurations
    from precision_pin.robot.postures import Postures

Obstruction = Literal["", "collision", "kept out"]
"""Whether an arm hits itself, or enters what it must keep out of; empty where neither."""

_DEEP: Final = 1e-6
"""Depth (m) by which a plane may be passed: a link that lies on it does not hit it."""
_SHARE: Final = 0.1
"""Fraction of the arm's length: if links reach farther below the plate at joint zero, none is assumed."""
_TRIED: Final = 64
"""Poses at which links that always touch are sought."""
_AT_ONCE: Final = 2048  # poses whose link frames are held together
_MIN_POSES_COMPILED: Final = 16
"""Poses of two links from which on compiled code is worth its loading."""
_SLANT: Final = 1e-3  # of gravity to the z axis, rad, above which no plate is assumed


@dataclass(frozen=True)
class KeepOut:
    """A half space or a box that no moving link may enter, in base axes.

    Attributes:
        place: A point of the plane, or the centre of the box, m, ``(3,)``.
        normal: Of a plane: the direction in which the arm may be, of length one; None for a box.
        size: Of a box: its edges along the base axes, m.
    """

    place: tuple[float, ...]
    normal: tuple[float, ...] | None = None
    size: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Obstacles:
    """Obstacles for the poses of an arm, in addition to the arm itself.

    Attributes:
        keep_out: Planes and boxes; None for the plate on which the base stands, if it does.
        package_dirs: Where packages of meshes are searched for.
    """

    keep_out: tuple[KeepOut, ...] | None = None
    package_dirs: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class _Body:
    """A shape: the hull of points, each with a ball and a disc about z around it.

    ``owner`` is its link. ``solid`` is coal's shape. ``placement`` is in the axes of the chain link ``link``; points ``(V, 3)``,
    ``centre`` and ``radius`` of a ball about all, and of a mesh its triangles ``(F, 3, 3)`` and the planes of its hull (normal
    and offset, negative inside; none of a flat one), are in the shape's own. ``is_line``: it has no thickness and is only kept
    out of planes and boxes.
    """

    owner: str
    link: int
    placement: Array
    solid: Any
    points: Array
    ball: float = 0.0
    disc: float = 0.0
    triangles: Array | None = None
    planes: Array | None = None
    is_line: bool = False

    @cached_property
    def tree(self) -> Tree | None:
        """Boxes about its triangles; made when there are many poses to look at."""
        from precision_pin.robot.collision_loops import Tree  # late: numba takes half a second

        return None if self.triangles is None else Tree.of(self.triangles)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        return self.points.min(axis=0), self.points.max(axis=0)

    @cached_property
    def centre(self) -> Array:
        return (self.bounds[0] + self.bounds[1]) / 2

    @cached_property
    def half(self) -> Array:
        """Half the edges of a box about it."""
        rims = np.array([self.disc, self.disc, 0.0]) + self.ball
        return (self.bounds[1] - self.bounds[0]) / 2 + rims

    @cached_property
    def radius(self) -> float:
        return float(np.linalg.norm(self.points - self.centre, axis=1).max()) + self.ball + self.disc

    def lowest(self, frames: Array, normal: Array) -> Array:
        """Return the smallest coordinate along a direction of the base, of the shape at poses ``(P, 4, 4)``."""
        along = np.einsum("pij,i->jp", frames[:, :3, :3], normal)
        heights: Array = (self.points @ along).min(axis=0) - self.ball - self.disc * np.hypot(along[0], along[1])
        return heights + frames[:, :3, 3] @ normal


class _Check(NamedTuple):
    """Two bodies, or a body and a plane, that must stay apart."""

    body: _Body
    other: _Body | KeepOut
    kind: Obstruction
    what: str


class Arm(Protocol):
    """Parts of a chain that a check reads."""

    @property
    def robot(self) -> Robot: ...  # noqa: D102
    @property
    def placements(self) -> Array: ...  # noqa: D102
    @property
    def target_placement(self) -> Array: ...  # noqa: D102
    @property
    def target(self) -> Array: ...  # noqa: D102
    @property
    def gravity(self) -> Array: ...  # noqa: D102
    @property
    def link_frames(self) -> Mapping[str, LinkFrame]: ...  # noqa: D102
    @property
    def joint_names(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def configurations(self) -> Configurations: ...  # noqa: D102
    def at_columns(self, q: Array) -> Postures: ...  # noqa: D102


class CollisionCheck:
    """Bodies that an arm can hit. Made once for an arm; a check takes some 0.05 to 0.5 ms a pose.

    Args:
        arm: The chain.
        obstacles: Bodies that it may hit in addition to itself.

    Attributes:
        notes: What is looked at, assumed and left out, a line each.
    """

    def __init__(self, arm: Arm, obstacles: Obstacles) -> None:
        self._arm = arm
        self.notes: list[str] = []
        bodies = self._read_bodies(obstacles.package_dirs)
        at_zero = self._frames(np.clip(0.0, *arm.configurations.limits)[:, None])
        self._checks: list[_Check] = []
        if obstacles.keep_out is None:
            self._add_plate(bodies, at_zero)
        for number, obstacle in enumerate(obstacles.keep_out or (), 1):
            self._add(obstacle, f"{'box' if obstacle.normal is None else 'plane'} {number} of keep_out", bodies)
        self._add_pairs([body for body in bodies if not body.is_line], at_zero)

    def judge(self, q: Array) -> list[Obstruction]:
        """Return whether the arm hits itself or what is kept clear, at each of P postures ``(n, P)``."""
        return ["" if check is None else check.kind for check in self._search(q)]

    def free(self, q: Array) -> NDArray[np.bool_]:
        """Return a mask ``(P,)`` of the postures ``(n, P)`` at which the arm hits nothing."""
        return np.array([check is None for check in self._search(q)], dtype=bool)

    def reasons(self, q: Array) -> list[str]:
        """Return the hit bodies and the depth at each of P postures ``(n, P)``; empty where nothing does."""
        texts = (
            check and self._describe(check, np.ascontiguousarray(q[:, [k]])) for k, check in enumerate(self._search(q))
        )
        return [text or "" for text in texts]

    def _search(self, q: Array) -> list[_Check | None]:
        checks: list[_Check | None] = []
        for begin in range(0, q.shape[1] if self._checks else 0, _AT_ONCE):
            frames = self._frames(np.ascontiguousarray(q[:, begin : begin + _AT_ONCE]))
            hit = np.full(len(frames[0]), -1)
            placements: dict[_Body, Array] = {}
            for number, check in enumerate(self._checks):
                free = (hit < 0).nonzero()[0]
                if free.size:
                    hit[free[self._hits(check, frames, placements, free)]] = number
            checks += [None if number < 0 else self._checks[number] for number in hit]
        return checks or [None] * q.shape[1]

    def _hits(
        self, check: _Check, frames: Array, placements: dict[_Body, Array], rows: NDArray[np.intp] | slice
    ) -> NDArray[np.bool_]:
        a = self._placements(check.body, frames, placements)[rows]
        if isinstance(check.other, KeepOut):
            normal, place = np.array(check.other.normal), np.array(check.other.place)
            middle = a[:, :3, :3] @ check.body.centre + a[:, :3, 3]
            hit = (place - middle) @ normal + check.body.radius > _DEEP
            candidates = hit.nonzero()[0]
            hit[candidates] = self._depth(check.body, check.other, a[candidates]) > _DEEP
            return np.asarray(hit)
        body, other = check.body, check.other
        b = self._placements(other, frames, placements)[rows]
        gap = (a[:, :3, :3] @ body.centre + a[:, :3, 3]) - (b[:, :3, :3] @ other.centre + b[:, :3, 3])
        hit = np.asarray((gap * gap).sum(axis=1) < (body.radius + other.radius) ** 2)
        candidates = hit.nonzero()[0]
        for compare in (_boxes_meet, _touch):
            if not candidates.size:
                break
            hit[candidates] = is_hit = compare(body, other, a[candidates], b[candidates])
            candidates = candidates[is_hit]
        return hit

    def _placements(self, body: _Body, frames: Array, placements: dict[_Body, Array]) -> Array:
        if body not in placements:
            placements[body] = np.asarray(frames[body.link] @ body.placement)
        return placements[body]

    @staticmethod
    def _depth(body: _Body, plane: KeepOut, frames: Array) -> Array:
        normal = np.array(plane.normal)
        return normal @ np.array(plane.place) - body.lowest(frames, normal)

    def _describe(self, check: _Check, q: Array) -> str:
        frames = self._frames(q)
        if isinstance(check.other, KeepOut):
            bodies = [entry.body for entry in self._checks if entry.other is check.other]
            depths = [float(self._depth(body, check.other, frames[body.link] @ body.placement)[0]) for body in bodies]
            depth, owner = max(zip(depths, (body.owner for body in bodies), strict=True))
            return f"{owner} is {1e3 * depth:.3g} mm beyond {check.what}"
        pose = frames[check.body.link] @ check.body.placement
        other = frames[check.other.link] @ check.other.placement
        shapes = [
            x for body, at in ((check.body, pose), (check.other, other)) for x in (_hull(body), _transform(at[0]))
        ]
        depth = -coal.distance(*shapes, coal.DistanceRequest(), coal.DistanceResult())
        return f"{check.body.owner} hits {check.what}, {1e3 * depth:.3g} mm deep between their convex hulls"

    def _frames(self, q: Array) -> Array:
        """Return the axes of every chain link in the base, ``(n + 1, P, 4, 4)``."""
        joints = np.moveaxis(self._arm.at_columns(q).joint_poses, -1, 1)
        base = np.broadcast_to(np.eye(4), (1, *joints.shape[1:]))
        return np.concatenate([base, joints])

    def _read_bodies(self, package_dirs: Sequence[Path]) -> list[_Body]:
        arm = self._arm
        reader = MeshReader(arm.robot.file, package_dirs)
        bodies, unread = [], []
        for link in arm.robot.links:
            frame = arm.link_frames[link.name]
            for shape in link.collisions:
                try:
                    bodies.append(_body(link.name, frame, shape, reader))
                except UnreadableMeshError as problem:
                    unread.append(str(problem))
        if unread:
            others = f"; and {len(unread) - 1} more" if len(unread) > 1 else ""
            self.notes.append(f"collision shapes that are left out: {unread[0]}{others}")
        names = arm.joint_names
        bare = sorted(set(range(1, len(names) + 1)) - {body.link for body in bodies})
        ends = [*zip(names[1:], arm.placements[1:], strict=False), ("the target", arm.target_placement)]
        for k in bare:
            name, end = ends[k - 1]
            bodies.append(_line(f"the line from {names[k - 1]} to {name}", k, np.zeros(3), end[:3, 3]))
        if len(names) not in bare and arm.target.any():
            point = arm.target_placement[:3, 3]
            bodies.append(_line("the target", len(names), point, point))
        if bare:
            self.notes.append(
                f"no collision shapes on {len(bare)} of {len(names)} moving links: there only the lines between the joints "
                "are kept out of keep_out, and no link hits another"
            )
        return bodies

    def _add(self, obstacle: KeepOut, what: str, bodies: Sequence[_Body]) -> None:
        other: _Body | KeepOut = obstacle
        if obstacle.size is not None:
            shape = Shape(Box(obstacle.size), obstacle.place)  # type: ignore[arg-type]
            other = _body(what, LinkFrame(0, np.eye(4), 0, np.zeros(3)), shape, None)
        self._checks += [_Check(body, other, "kept out", what) for body in bodies if body.link]

    def _add_plate(self, bodies: Sequence[_Body], at_zero: Array) -> None:
        """Keep the arm above the plane under all that stands still, where it seems to stand on one."""
        standing = [body for body in bodies if not body.link]
        down = self._arm.gravity
        if not standing or np.hypot(down[0], down[1]) > _SLANT * abs(down[2]):
            return
        vertical = np.array([0.0, 0.0, 1.0])
        height = min(float(body.lowest(body.placement[None], vertical)[0]) for body in standing)
        plate = KeepOut((0.0, 0.0, height), (0.0, 0.0, 1.0))
        moving = [body for body in bodies if body.link]
        depths = [float(self._depth(body, plate, at_zero[body.link] @ body.placement)[0]) for body in moving]
        plane = f"the plane z = {1e3 * height + 0.0:.4g} mm in base axes, under all that stands still"
        length = float(np.linalg.norm(self._arm.placements[1:, :3, 3], axis=1).sum()) or 1.0
        if max(depths) > _SHARE * length:
            self.notes.append(f"the base is not taken to stand on a plate: at joint zero the arm is below {plane}")
            return
        resting = [body for body, depth in zip(moving, depths, strict=True) if body.link == 1 and depth > _DEEP]
        self._add(plate, "the base plate", [body for body in moving if body not in resting])
        self.notes.append(f"the arm is kept above {plane}; keep_out: says otherwise")

    def _add_pairs(self, bodies: Sequence[_Body], at_zero: Array) -> None:
        low, high = self._arm.configurations.limits
        is_finite = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(is_finite, low, -np.pi), np.where(is_finite, high, np.pi)
        draws = np.random.default_rng(0).random((len(low), _TRIED))
        trial_frames = self._frames(np.ascontiguousarray(low[:, None] + (high - low)[:, None] * draws))
        shaped = {body.owner for body in bodies}
        parents = {joint.child: joint.parent for joint in self._arm.robot.joints}
        left_out: Counter[tuple[str, str]] = Counter()
        for first, second in combinations(bodies, 2):
            if first.link == second.link or _are_neighbours(first.owner, second.owner, parents, shaped):
                continue
            further, nearer = (first, second) if first.link > second.link else (second, first)
            check = _Check(further, nearer, "collision", nearer.owner)
            # most pairs are apart at the first pose tried
            touch_first = self._hits(check, trial_frames[:, :1], {}, slice(None)).all()
            if self._hits(check, at_zero, {}, slice(None)).all() or (
                touch_first and self._hits(check, trial_frames, {}, slice(None)).all()
            ):
                left_out[further.owner, nearer.owner] += 1
            else:
                self._checks.append(check)
        if left_out:
            pairs = ", ".join(" and ".join(pair) for pair in left_out)
            self.notes.append(f"not looked at, since they touch at joint zero or at every pose tried: {pairs}")


def _are_neighbours(first: str, second: str, parents: Mapping[str, str], shaped: set[str]) -> bool:
    """Return whether one link carries the other with no link with a shape in between."""
    for link, holder in ((first, second), (second, first)):
        parent = parents.get(link)
        while parent is not None and parent != holder and parent not in shaped:
            parent = parents.get(parent)
        if parent == holder:
            return True
    return False


def _body(owner: str, frame: LinkFrame, shape: Shape, reader: MeshReader | None) -> _Body:
    placement = frame.frame @ shape.origin
    match shape.geometry:
        case Box(size):
            corners = np.array(np.meshgrid(*[(-edge / 2, edge / 2) for edge in size])).reshape(3, -1).T
            return _Body(owner, frame.link, placement, coal.Box(*size), corners)
        case Cylinder(radius, length):
            end_points = np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]])
            return _Body(owner, frame.link, placement, coal.Cylinder(radius, length), end_points, disc=radius)
        case Sphere(radius):
            return _Body(owner, frame.link, placement, coal.Sphere(radius), np.zeros((1, 3)), ball=radius)
        case Mesh() as mesh:
            assert reader is not None
            surfaces = reader.surfaces(mesh, f"link {owner!r}")
    surface = merged([(surface.vertices, surface.faces) for surface in surfaces])
    vertices, faces = surface.vertices, surface.faces
    solid = coal.BVHModelOBBRSS()
    solid.beginModel(len(faces), len(vertices))
    solid.addVertices(vertices)
    solid.addTriangles(faces.astype(np.int64))
    solid.endModel()
    from scipy.spatial import ConvexHull, QhullError  # late: a third of a second, of arms with meshes alone

    try:
        hull = ConvexHull(vertices)
        points, planes = vertices[hull.vertices], hull.equations
    except QhullError:  # flat
        points, planes = vertices, None
    return _Body(owner, frame.link, placement, solid, points, triangles=vertices[faces], planes=planes)


def _line(name: str, link: int, begin: Array, end: Array) -> _Body:
    vector = end - begin
    length = float(np.linalg.norm(vector))
    rotation = alignment(vector / length) if length else np.eye(3)
    end_points = np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]])
    solid = coal.Capsule(_DEEP, length)
    return _Body(name, link, se3.pose(rotation, (begin + end) / 2), solid, end_points, is_line=True)


def _boxes_meet(first: _Body, second: _Body, a: Array, b: Array) -> NDArray[np.bool_]:
    """Return whether the boxes about two bodies, along their own axes, overlap along each of these, at P poses of both."""
    rotation = np.einsum("pji,pjk->pik", a[:, :3, :3], b[:, :3, :3])
    apart = b[:, :3, :3] @ second.centre + b[:, :3, 3] - a[:, :3, :3] @ first.centre - a[:, :3, 3]
    offsets = np.einsum("pji,pj->pi", a[:, :3, :3], apart), np.einsum("pji,pj->pi", b[:, :3, :3], apart)
    size = np.abs(rotation)
    return np.asarray(
        (np.abs(offsets[0]) <= first.half + size @ second.half).all(axis=1)
        & (np.abs(offsets[1]) <= second.half + first.half @ size).all(axis=1)
    )


def _touch(first: _Body, second: _Body, poses: Array, other_poses: Array) -> NDArray[np.bool_]:
    hit, is_far = np.zeros((2, len(poses)), dtype=bool)
    if len(poses) >= _MIN_POSES_COMPILED and first.tree is not None and second.tree is not None:
        from precision_pin.robot.collision_loops import proven_apart

        is_far = proven_apart(first.tree, second.tree, np.linalg.inv(poses) @ other_poses)
    request = coal.CollisionRequest()
    for k in (~is_far).nonzero()[0]:
        place_a, place_b = _transform(poses[k]), _transform(other_poses[k])
        hit[k] = coal.collide(first.solid, place_a, second.solid, place_b, request, coal.CollisionResult()) > 0
    # surfaces that do not cross: a body may still lie within a mesh
    for inner, outer, place, other_place in ((first, second, poses, other_poses), (second, first, other_poses, poses)):
        if outer.planes is not None and inner.radius <= outer.radius:
            apart = (~hit).nonzero()[0]
            hit[apart] = _is_within(inner, outer, place[apart], other_place[apart])
    return hit


def _is_within(inner: _Body, outer: _Body, poses: Array, other_poses: Array) -> NDArray[np.bool_]:
    """Return whether a body lies in a mesh whose surface it does not cross, at P poses of both."""
    assert outer.triangles is not None
    assert outer.planes is not None
    is_inside = np.zeros(len(poses), dtype=bool)
    # first one point against the hull, then all: few bodies get so far
    candidates = np.arange(len(poses))
    for points in (inner.points[:1], inner.points):
        place, other_place = poses[candidates], other_poses[candidates]
        local_points = points @ np.swapaxes(place[:, :3, :3], 1, 2) + (place[:, :3, 3] - other_place[:, :3, 3])[:, None]
        local_points = local_points @ other_place[:, :3, :3]
        candidates = candidates[(local_points @ outer.planes[:, :3].T + outer.planes[:, 3]).max(axis=(1, 2)) <= 0]
        if not candidates.size:
            return is_inside
    for k in candidates:
        # winding number: the solid angles under which the triangles are seen (Van Oosterom and Strackee 1983)
        point = (poses[k, :3, :3] @ inner.points[0] + poses[k, :3, 3] - other_poses[k, :3, 3]) @ other_poses[k, :3, :3]
        a, b, c = np.moveaxis(outer.triangles - point, 1, 0)
        sizes = [np.linalg.norm(corner, axis=1) for corner in (a, b, c)]
        flat = np.einsum("fi,fi->f", a, np.cross(b, c))
        round_ = (
            sizes[0] * sizes[1] * sizes[2]
            + np.einsum("fi,fi->f", a, b) * sizes[2]
            + np.einsum("fi,fi->f", b, c) * sizes[0]
            + np.einsum("fi,fi->f", c, a) * sizes[1]
        )
        is_inside[k] = abs(np.arctan2(flat, round_).sum()) > np.pi
    return is_inside


def _hull(body: _Body) -> Any:
    if body.triangles is None:
        return body.solid
    body.solid.buildConvexHull(True, "Qt")
    return body.solid.convex


def _transform(pose: Array) -> Any:
    return coal.Transform3s(pose[:3, :3], pose[:3, 3])
