"""Procedures that find datums, carried out by robots one at a time in numpy and scipy, from the text and not the package.

Poses are ``(n, 4, 4)`` for n robots. A robot's links and joints are displaced by its own errors; its controller knows the
nominal arm, the tool it has found, and how its frame lies. Loads are those of the nominal arm at the nominal pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from support.plain_robot import PlainRobot, inserted

Array = np.ndarray
ROUNDS = 7


def turned(rotvec: Array) -> Array:
    """Return rotation matrices ``(..., 3, 3)`` of rotation vectors."""
    return Rotation.from_rotvec(rotvec.reshape(-1, 3)).as_matrix().reshape(*rotvec.shape[:-1], 3, 3)


def rotvec(matrix: Array) -> Array:
    return Rotation.from_matrix(matrix).as_rotvec()


def placed(rotation: Array, position: Array) -> Array:
    result = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], position.shape[:-1]), 4, 4))
    result[..., :3, :3], result[..., :3, 3], result[..., 3, 3] = rotation, position, 1.0
    return result


def difference(true: Array, nominal: Array) -> Array:
    """Return [p' - p, Log(R' Rᵀ)], ``(n, 6)``."""
    turn = rotvec(true[:, :3, :3] @ np.swapaxes(nominal[..., :3, :3], -1, -2))
    return np.hstack([true[:, :3, 3] - nominal[..., :3, 3], turn])


@dataclass
class Robots:
    """n robots.

    Attributes:
        reading: The nominal robot.
        names: Its joints from base to tip.
        tip: The tip's link.
        places: Errors ``(n, 6)`` of ("joint", name) before it turns, or ("link", name) at its frame.
        angles: Errors ``(n, joints)`` of joint values at a visit, by the number of the visit and its nominal joint values.
    """

    reading: PlainRobot
    names: Sequence[str]
    tip: str
    places: Mapping[tuple[str, str], Array]
    angles: Callable[[int, Array], Array]
    count: int
    frame: Array = field(init=False)
    seen: Array = field(init=False)
    tool: Array = field(init=False)
    is_new: bool = False

    def __post_init__(self) -> None:
        parents = {entry.child: entry for entry in self.reading.joints}
        path, link = [], self.tip
        while link in parents:
            path.insert(0, parents[link])
            link = parents[link].parent
        self.path = path
        self.displaced = {place: np.stack([inserted(e) for e in errors]) for place, errors in self.places.items()}
        self.frame, self.seen = (np.repeat(np.eye(4)[None], self.count, axis=0) for _ in range(2))
        self.tool = np.zeros((self.count, 3))

    def links(self, q: Array, errors: Array | None = None) -> tuple[dict[str, Array], list[tuple[Array, Array, bool]]]:
        """Return the pose of each link and the axis and place of each joint, nominal or with a visit's joint errors."""
        one = np.eye(4)
        places = self.displaced if errors is not None else {}
        values = q if errors is None else q + errors
        pose = np.repeat(one[None], self.count, axis=0) @ places.get(("link", self.reading.root), one)
        poses, axes = {self.reading.root: pose}, []
        for entry in self.path:
            pose = pose @ entry.origin @ places.get(("joint", entry.name), one)
            if entry.kind != "fixed":
                value, slides = values[:, self.names.index(entry.name)], entry.kind == "prismatic"
                axes.append((pose[:, :3, :3] @ entry.axis, pose[:, :3, 3], slides))
                shift = value[:, None] * entry.axis
                turn = np.broadcast_to(np.eye(3), (self.count, 3, 3)) if slides else turned(shift)
                pose = pose @ placed(turn, shift if slides else np.zeros((self.count, 3)))
            pose = pose @ places.get(("link", entry.child), one)
            poses[entry.child] = pose
        return poses, axes

    def nominal(self, q: Array, on: str) -> Array:
        return self.links(np.repeat(q[None], self.count, axis=0))[0][on][0]

    def true(self, visit: int, at: Array, q: Array, on: str) -> Array:
        """Return where a frame truly is, as the instrument sees it."""
        return self.seen @ self.links(q, self.angles(visit, at))[0][on]

    def believed(self, q: Array, on: str) -> Array:
        """Return where the controller believes it to be, in its frame."""
        pose = np.linalg.inv(self.frame) @ self.links(q)[0][on]
        return pose @ placed(np.eye(3), self.tool) if on == self.tip else pose

    def reach(self, q: Array, now: Callable[[Array], Array], wanted: Array, on: str) -> Array:
        """Return joint values at which a pose is as wanted; its position alone for fewer than six joints."""
        rows = 6 if len(self.names) >= 6 else 3
        q = np.repeat(q[None], self.count, axis=0) if q.ndim == 1 else q
        for _ in range(ROUNDS):
            links, axes = self.links(q)
            tip = links[on][:, :3, 3]
            columns = []
            for axis, place, slides in axes:
                if slides:
                    columns.append(np.hstack([axis, 0 * axis]))
                else:
                    columns.append(np.hstack([np.cross(axis, tip - place), axis]))
            # joints beyond the frame do not move it
            columns += [np.zeros((self.count, 6))] * (len(self.names) - len(columns))
            slopes = np.stack(columns, axis=2)[:, :rows]
            q = q - (np.linalg.pinv(slopes) @ difference(now(q), wanted)[:, :rows, None])[..., 0]
        return q

    def command(self, at: Array, on: str) -> Array:
        """Return the joint values by which the controller goes to the nominal pose of ``at``."""
        q = np.repeat(at[None], self.count, axis=0)
        wanted = self.nominal(at, on)
        return self.reach(q, lambda q: self.believed(q, on), wanted, on) if self.is_new else q

    def touch(self, visit: int, at: Array, position: Array) -> Array:
        """Return joint values that bring the true tip to a position, in what the controller believes the attitude."""

        def now(q: Array) -> Array:
            return placed(self.believed(q, self.tip)[:, :3, :3], self.true(visit, at, q, self.tip)[:, :3, 3])

        wanted = placed(self.nominal(at, self.tip)[:3, :3], position)
        return self.reach(self.command(at, self.tip), now, wanted, self.tip)

    def errors(self, at: Array, visit: int = -1) -> Array:
        return difference(self.true(visit, at, self.command(at, self.tip), self.tip), self.nominal(at, self.tip))

    # procedures ------------------------------------------------------------------------------------------------------

    def best_fit(self, first: int, poses: Sequence[Array], noise: Array, point: Array) -> None:
        """Align readings of a point of the tool with nominal ones; ``noise`` is ``(visits, n, 6)`` here and below."""
        held = np.append(point, 1.0)
        nominal = np.array([(self.nominal(q, self.tip) @ held)[:3] for q in poses])
        tips = [self.true(first + k, q, self.command(q, self.tip), self.tip) for k, q in enumerate(poses)]
        seen = [(tip @ held)[:, :3] for tip in tips]
        readings = np.stack([points + noise[k, :, :3] for k, points in enumerate(seen)], axis=1)
        for k, points in enumerate(readings):
            fit, _ = Rotation.align_vectors(nominal - nominal.mean(axis=0), points - points.mean(axis=0))
            motion = placed(fit.as_matrix(), nominal.mean(axis=0) - fit.apply(points.mean(axis=0)))
            self.seen[k] = motion @ self.seen[k]
        self.is_new = True

    def taught(self, first: int, at: Array, noise: Array) -> None:
        nominal = self.nominal(at, self.tip)
        wanted = placed(turned(noise[0, :, 3:]) @ nominal[:3, :3], nominal[:3, 3] + noise[0, :, :3])
        if len(self.names) < 6:
            there = self.believed(self.touch(first, at, wanted[:, :3, 3]), self.tip)
            self.frame = self.frame @ placed(np.eye(3), there[:, :3, 3] - nominal[:3, 3])
        else:
            q = self.command(at, self.tip)
            q = self.reach(q, lambda q: self.true(first, at, q, self.tip), wanted, self.tip)
            self.frame = self.frame @ self.believed(q, self.tip) @ np.linalg.inv(nominal)
        self.is_new = True

    def three_points(self, first: int, poses: Sequence[Array], noise: Array) -> None:
        nominal = [self.nominal(q, self.tip)[:3, 3] for q in poses]
        points = [
            self.believed(self.touch(first + k, q, nominal[k] + noise[k, :, :3]), self.tip)[:, :3, 3]
            for k, q in enumerate(poses)
        ]
        change = [self._axes(*three) @ np.linalg.inv(self._axes(*nominal)) for three in zip(*points, strict=True)]
        self.frame = self.frame @ np.stack(change)
        self.is_new = True

    @staticmethod
    def _axes(origin: Array, on_x: Array, in_xy: Array) -> Array:
        q, r = np.linalg.qr(np.column_stack([on_x - origin, in_xy - origin]))
        x, y = (q * np.sign(np.diag(r))).T
        return placed(np.column_stack([x, y, np.cross(x, y)]), origin)

    def tool_pivot(self, first: int, poses: Sequence[Array], noise: Array) -> None:
        touches = []
        for k, q in enumerate(poses):
            there = self.touch(first + k, q, self.nominal(q, self.tip)[:3, 3] + noise[k, :, :3])
            touches.append(self.believed(there, self.tip))
        for k, seats in enumerate(np.stack(touches, axis=1)):
            # R t - c = -p for the change t of the tool and the point c
            matrix = np.vstack([np.hstack([seat[:3, :3], -np.eye(3)]) for seat in seats])
            self.tool[k] += np.linalg.lstsq(matrix, -seats[:, :3, 3].ravel(), rcond=None)[0][:3]
        self.is_new = True

    def hand_eye(self, first, poses, view, noise, task, on, camera, board, grasp, weights) -> None:
        """Calibrate a camera on the hand by views of a fixed board, and look at the workpiece from a view."""
        workpiece = self.nominal(task, self.tip) @ np.linalg.inv(grasp)
        views, believed = [], []
        for k, q in enumerate([*poses, view]):
            values = self.command(q, on)
            seen = np.linalg.inv(self.true(first + k, q, values, on) @ camera) @ (
                board if k < len(poses) else workpiece
            )
            views.append(placed(turned(noise[k, :, 3:]) @ seen[:, :3, :3], seen[:, :3, 3] + noise[k, :, :3]))
            believed.append(self.believed(values, on))
        for k in range(self.count):
            hands, sights = [b[k] for b in believed], [v[k] for v in views]

            def residuals(x: Array, hands: list[Array] = hands, sights: list[Array] = sights) -> Array:
                eye, target = camera @ inserted(x[:6]), board @ inserted(x[6:])
                pairs = list(zip(hands[:-1], sights[:-1], strict=True))
                return self._weighed(
                    [np.linalg.inv(hand) @ target for hand, _ in pairs], [eye @ s for s in sights[:-1]], weights
                )

            eye = camera @ inserted(self._least(residuals)[:6])
            self.frame[k] = self.frame[k] @ hands[-1] @ eye @ sights[-1] @ np.linalg.inv(workpiece)
        self.is_new = True

    def eye_to_hand(self, first, poses, noise, task, on, camera, board, grasp, weights) -> None:
        """Calibrate a fixed camera by views of a board in the hand, and look at the workpiece."""
        workpiece = self.nominal(task, self.tip) @ np.linalg.inv(grasp)
        values = [self.command(q, on) for q in poses]
        boards = [self.true(first + k, q, v, on) @ board for k, (q, v) in enumerate(zip(poses, values, strict=True))]
        boards.append(np.repeat(workpiece[None], self.count, axis=0))
        views = [np.linalg.inv(camera) @ b for b in boards]
        views = [
            placed(turned(n[:, 3:]) @ v[:, :3, :3], v[:, :3, 3] + n[:, :3]) for v, n in zip(views, noise, strict=True)
        ]
        believed = [self.believed(v, on) for v in values]
        for k in range(self.count):
            hands, sights = [b[k] for b in believed], [v[k] for v in views]

            def residuals(x: Array, hands: list[Array] = hands, sights: list[Array] = sights) -> Array:
                eye, held = camera @ inserted(x[:6]), board @ inserted(x[6:])
                return self._weighed([hand @ held for hand in hands], [eye @ sight for sight in sights[:-1]], weights)

            eye = camera @ inserted(self._least(residuals)[:6])
            self.frame[k] = self.frame[k] @ eye @ sights[-1] @ np.linalg.inv(workpiece)
        self.is_new = True

    @staticmethod
    def _weighed(some: Sequence[Array], others: Sequence[Array], weights: tuple[float, float]) -> Array:
        pairs = difference(np.stack(some), np.stack(others))
        return (pairs / np.repeat(weights, 3)).ravel()

    @staticmethod
    def _least(residuals: Callable[[Array], Array]) -> Array:
        scales = np.repeat([1e-4, 1e-3, 1e-4, 1e-3], 3)
        found = least_squares(
            lambda x: residuals(x * scales), np.zeros(12), "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        return found.x * scales
