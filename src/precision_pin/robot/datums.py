"""Datums: frames and tools that a robot finds with its own errors, by six procedures, and the arm as it was calibrated.

To first order the error against a datum is ``e = e_B + Σ G_i e_i + Σ H_i n_i``, with the errors ``e_B`` at the task and
``e_i`` at the visits of the procedure, in axes of the nominal base, and new noise ``n_i`` of the procedure. G and H
depend on the nominal poses only. :meth:`Datum.maps` returns them; :meth:`Datum.find` solves the procedure for individual
robots, without linearising.

Helpers: ``X(a→b)`` transports the error of a rigid body from point a to point b; ``Y(R, p→b)`` is the error at b by a
displacement of the place (R, p) in its own axes, ``Trans(x, y, z) · Exp(rx, ry, rz)``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_numbers, check_quantity, check_text, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import ANGLE, LENGTH

NO_DATUM: Final = "none"
"""Name for errors in base axes."""
COMPENSATED: Final = "compensated"
"""Name of the datum :meth:`Datum.compensated`, which every sheet has."""
_FLAT: Final = 1e-6
"""Ratio of singular values below which points lie on a line, or attitudes share an axis; also the least that counts as
a spread at all, m or rad², so that rounding does not."""
_SPIKE: Final = 1e-3
"""Largest distance, m, of nominal tips that are held on one point; larger ones are a mistake in the poses."""
_ALL_WAYS: Final = 6
"""Joints of an arm that can be given any attitude at a place."""
_STEPS: Final = 12
"""Steps of a least-squares fit at most."""
_STILL: Final = 1e-12
"""Step, m and rad, after which a fit has converged."""


def transport(start: Array, end: Array) -> Array:
    """Return X(start→end), ``(6, 6)``, for points ``(3,)``."""
    result = np.eye(6)
    result[:3, 3:] = -se3.skew(end - start)
    return result


def by_place(place: Array, point: Array) -> Array:
    """Return Y(place→point), ``(6, 6)``, for a pose ``(4, 4)`` and a point ``(3,)``."""
    return transport(place[:3, 3], point) @ _turned(place)


def _turned(place: Array) -> Array:
    """Return diag(R, R) of a pose."""
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = place[:3, :3]
    return result


def _padded(blocks: Array) -> Array:
    """Return ``(N, 6, 6)`` for derivatives ``(N, 6, 3)`` by positions alone."""
    return np.concatenate([blocks, np.zeros_like(blocks)], axis=2)


class Robots(Protocol):
    """Individual robots in a procedure; poses ``(4, 4, n)`` for n robots, joint values ``(joints, n)``.

    ``start`` are the nominal joint values of a visit, ``(joints,)``.
    """

    def true(self, visit: int, q: Array) -> Array:
        """Return where a visit's tip or flange truly is, in the datums found so far."""

    def read(self, visit: int, q: Array) -> Array:
        """Return where the controller believes it to be."""

    def jog(self, visit: int, pose: Array) -> Array:
        """Return joint values at which the true pose is as wanted."""

    def touch(self, visit: int, position: Array) -> Array:
        """Return joint values at which the true position is as wanted, and the attitude is believed to be nominal."""

    def commanded(self, visit: int) -> Array:
        """Return the joint values of a visit's nominal pose for every robot."""


@dataclass(frozen=True, eq=False)
class Found:
    """What robots know after a procedure, ``(4, 4, n)`` and ``(3, n)`` for n robots; None for no change.

    Attributes:
        change: To the left of a nominal pose, the pose to which they are sent for it.
        seen: To the left of a true pose, how it is seen.
        tool: By how much the controller's tip differs from the nominal one, tool axes.
    """

    change: Array | None = None
    seen: Array | None = None
    tool: Array | None = None


Pose = Any
"""Name of a pose, joint values, or an approached pose."""

Maps = Callable[[Array, int], tuple[Array, Array]]
"""G and H for a task ``(4, 4)`` with the number of its view."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Datum(ABC):
    """A datum found by the robot.

    Attributes:
        name: Its name in results.
        kind: Name of the procedure.
        moves_tool: True if it changes the tool, and nothing else; a flange is then not affected.
        is_commanded: True if the robot is sent to other poses; an arm of fewer than six joints keeps its attitude then.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> taught = pp.Datum.taught([-1.5, 0.1, 1.5, -1.6], "0.1 mm")
        >>> std = [np.sqrt(one.at("paper").covariance[0, 0]) for one in (model, model.against(taught))]
        >>> print(std[1] < std[0] / 2)
        True
    """

    name: str
    kind: ClassVar[str]
    moves_tool: ClassVar[bool] = False
    is_commanded: ClassVar[bool] = True

    def __post_init__(self) -> None:
        name = check_text("the name of a datum", self.name, "fixture")
        is_reserved = name == NO_DATUM or (name == COMPENSATED and self.kind != COMPENSATED)
        if not name.strip() or not name.isprintable() or "," in name or is_reserved:
            raise InputError(
                f"{shown(name)} is not a name of a datum; give a word without commas, other than {NO_DATUM} and {COMPENSATED}"
            )

    @property
    def frame(self) -> str | None:
        """Link whose error counts at the visits, without the errors of what it carries; None for the tip."""
        return None

    @property
    def place(self) -> Array | None:
        """Point whose error counts at the visits, in the axes of the robot's tip, ``(3,)``, m; None for the tip."""
        return None

    @property
    @abstractmethod
    def visits(self) -> tuple[Pose, ...]:
        """Poses of the procedure."""

    @property
    @abstractmethod
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """Name and standard deviations ``(6,)`` of each draw of the procedure's noise."""

    @property
    def label(self) -> str:
        """Name in a budget."""
        return f"datum[{self.name}]"

    @abstractmethod
    def maps(self, places: Array) -> Maps:
        """Return the maps of G ``(V, 6, 6)`` and H ``(M, 6, 6)`` of visits at nominal places ``(V, 4, 4)``.

        Raises:
            InputError: The places do not determine the datum.
        """

    @abstractmethod
    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return what each robot knows after its procedure with noise ``(M, 6, n)``, for a task ``(4, 4)``."""

    def bound(self, joints: int, configuration: Callable[[Any], Array]) -> Datum:
        """Return the datum for an arm of some joints, with the joint values of named poses that it needs."""
        return self

    def view_of(self, q: Array) -> int:
        """Return the number of the view of a task with joint values ``(joints,)``."""
        return 0

    def frames(self, places: Array) -> dict[str, Array]:
        """Return the nominal frames of the datum, ``(4, 4)`` in the base by name, for visits at places ``(V, 4, 4)``."""
        return {}

    # constructors --------------------------------------------------------------------------------------------------

    @staticmethod
    def best_fit(
        poses: Sequence[Pose], std: object = 0.0, *, point: ArrayLike | None = None, name: str = "best_fit"
    ) -> Datum:
        """Return the frame in which an instrument's readings of a point of the tool fit its nominal positions best.

        Args:
            poses: Poses of the readings, at least three: names, joint values or approached poses.
            std: Standard deviation of each coordinate of a reading, m, or text such as ``"0.02 mm"``.
            point: The point that is read, such as a reflector, in the tip's axes, m, ``(3,)``, whatever the results
                are about; default: the tip, or the target.
            name: Name in results.

        Raises:
            InputError: Fewer than three poses; a negative number; not a point.

        Examples:
            >>> model = pp.ErrorModel.load("4dof.errors.yaml")
            >>> poses = [[0, 0, 0, 0], [0.5, 0.2, 0.4, 0], [-0.5, -0.3, 0.8, 0.2], [1, 0.1, 0.9, 0.5]]
            >>> cell = pp.Datum.best_fit(poses, "0.02 mm")
            >>> print(model.against(cell).at("paper").covariance.shape)
            (6, 6)
        """
        place = None if point is None else tuple(check_numbers("the point of a best_fit", point, (3,)).tolist())
        return BestFit(name=name, poses=_listed(poses, 3), std=_std(std), point=place)

    @staticmethod
    def taught(pose: Pose, touch: object = 0.0, *, turns: bool | None = None, name: str = "taught") -> Datum:
        """Return the datum of a robot that is taught at a pose and then moves relative to it.

        Args:
            pose: The pose at which it is taught.
            touch: Standard deviation of each coordinate, m, or ``{"std": …, "attitude": …}``.
            turns: Whether the attitude is taught too; by default for arms of six joints or more.
            name: Name in results.

        Raises:
            InputError: A negative number.
        """
        return Taught(name=name, pose=pose, touch=_touch(touch), turns=turns)

    @staticmethod
    def compensated(*, turns: bool | None = None) -> Datum:
        """Return the calibrated arm as datum: its controller takes out the error with every draw at its mean.

        As with :func:`precision_pin.compensate`, or with the URDF of the calibrated arm, to second order of the errors.

        Args:
            turns: Whether the attitude is taken out too; by default for arms of six joints or more.

        Examples:
            >>> model = pp.ErrorModel.load("4dof.errors.yaml")
            >>> at = model.against(pp.Datum.compensated()).at("paper")
            >>> print(np.abs(at.error_at_means[:3]).max() < 1e-15, np.abs(model.at("paper").error_at_means).max() > 8e-3)
            True True
        """
        return Compensated(name=COMPENSATED, turns=turns)

    @staticmethod
    def three_points(origin: Pose, x: Pose, xy: Pose, touch: object = 0.0, *, name: str = "three_points") -> Datum:
        """Return the frame of three touched points: its origin, a point on +x, a point in the xy plane with y > 0.

        Args:
            origin, x, xy: Poses at which the tip touches them.
            touch: Standard deviation of each coordinate of a touch, m.
            name: Name in results.

        Raises:
            InputError: A negative number.
        """
        return ThreePoints(name=name, origin=origin, x=x, xy=xy, touch=_touch(touch))

    @staticmethod
    def tool_pivot(poses: Sequence[Pose], touch: object = 0.0, *, name: str = "tool_pivot") -> Datum:
        """Return the tool whose tip was found by holding it on one point in several attitudes.

        Args:
            poses: At least three poses with the tip at one point and different attitudes.
            touch: Standard deviation of each coordinate of a touch, m.
            name: Name in results.

        Raises:
            InputError: Fewer than three poses; a negative number.
        """
        return ToolPivot(name=name, poses=_listed(poses, 3), touch=_touch(touch))

    @staticmethod
    def hand_eye(
        poses: Sequence[Pose],
        view: Pose | Mapping[str, Pose],
        *,
        camera: Array,
        board: Array,
        grasp: Array,
        on: str,
        noise: Sequence[float] = (0.0, 0.0),
        weights: Sequence[float] | None = None,
        name: str = "hand_eye",
    ) -> Datum:
        """Return the datum of a camera in the hand, calibrated on a fixed board, that sees the workpiece from a view.

        Args:
            poses: At least three poses from which the board is seen.
            view: Pose from which the workpiece is seen; or one for each named task.
            camera, board, grasp: ``(4, 4)`` camera in the frame ``on``; board in the base; tip in the workpiece at the
                task.
            on: Link that carries the camera.
            noise: Standard deviations of translation, m, and rotation, rad, of each coordinate of a view.
            weights: Those that the solver assumes; by default the noise.
            name: Name in results.

        Raises:
            InputError: Fewer than three poses; a negative number; not a pose.
        """
        views = dict(view) if isinstance(view, Mapping) else {None: view}
        shared = _camera(camera, board, grasp, noise, weights)
        return HandEye(name=name, poses=_listed(poses, 3), on=on, views=tuple(views.items()), **shared)

    @staticmethod
    def eye_to_hand(
        poses: Sequence[Pose],
        *,
        camera: Array,
        board: Array,
        grasp: Array,
        on: str,
        noise: Sequence[float] = (0.0, 0.0),
        weights: Sequence[float] | None = None,
        name: str = "eye_to_hand",
    ) -> Datum:
        """Return the datum of a fixed camera, calibrated on a board in the hand, that sees the workpiece.

        Args:
            poses: At least three poses in which the board is seen.
            camera, board, grasp: ``(4, 4)`` camera in the base; board in the frame ``on``; tip in the workpiece at the
                task.
            on: Link that carries the board.
            noise, weights, name: As for :meth:`hand_eye`.

        Raises:
            InputError: Fewer than three poses; a negative number; not a pose.
        """
        return EyeToHand(name=name, poses=_listed(poses, 3), on=on, **_camera(camera, board, grasp, noise, weights))


@dataclass(frozen=True, kw_only=True, eq=False)
class BestFit(Datum):
    """Best-fit alignment of readings of the tip, or of a point of the tool."""

    kind: ClassVar[str] = "best_fit"
    is_commanded: ClassVar[bool] = False
    poses: tuple[Pose, ...]
    std: float
    point: tuple[float, ...] | None = None

    @property
    def place(self) -> Array | None:
        """The point that is read."""
        return None if self.point is None else np.array(self.point)

    @property
    def visits(self) -> tuple[Pose, ...]:
        """Poses of the readings."""
        return self.poses

    @property
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """Noise of each reading."""
        return _numbered(len(self.poses), np.repeat([self.std, 0.0], 3))

    def maps(self, places: Array) -> Maps:
        """Return the maps: with c the mean of the points, r_i = p_i - c, S = Σ (|r_i|² I - r_i r_iᵀ)."""
        points = places[:, :3, 3]
        centre = points.mean(axis=0)
        arms = points - centre
        _check_spread(self, arms)
        inertia = (arms**2).sum() * np.eye(3) - arms.T @ arms
        turns = np.array([np.linalg.solve(inertia, se3.skew(arm)) for arm in arms])
        fit = np.concatenate([np.broadcast_to(np.eye(3) / len(arms), turns.shape), turns], axis=1)
        fit = _padded(fit)

        def at(task: Array, view: int) -> tuple[Array, Array]:
            maps = -transport(centre, task[:3, 3]) @ fit
            return maps, maps

        return at

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return the rigid motion that fits the readings best (Kabsch)."""
        readings = [robots.true(k, robots.commanded(k))[:3, 3] + noise[k, :3] for k in range(len(places))]
        return Found(seen=_fitted(np.array(readings), places[:, :3, 3]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Taught(Datum):
    """A pose to which the robot was jogged."""

    kind: ClassVar[str] = "taught"
    pose: Pose
    touch: tuple[float, float]
    turns: bool | None = None

    @property
    def visits(self) -> tuple[Pose, ...]:
        """The pose."""
        return (self.pose,)

    @property
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """Noise of the touch."""
        return (("touch", np.repeat(self.touch if self.turns else (self.touch[0], 0.0), 3)),)

    def maps(self, places: Array) -> Maps:
        """Return the maps: -X and X from the taught to the worked point, or the shift alone."""

        def at(task: Array, view: int) -> tuple[Array, Array]:
            shift = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
            moved = (transport(places[0, :3, 3], task[:3, 3]) if self.turns else shift)[None]
            return -moved, moved

        return at

    def bound(self, joints: int, configuration: Callable[[Any], Array]) -> Datum:
        """Return the datum with the attitude taught too, unless stated, by an arm of six joints or more."""
        if self.turns and joints < _ALL_WAYS:
            raise InputError(
                f"datum {self.name}: an arm of {joints} joints cannot be taught an attitude; leave turns out"
            )
        return self if self.turns is not None else replace(self, turns=joints >= _ALL_WAYS)

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return the relative motion."""
        wanted = _displaced(places[0], noise[0])
        taught = robots.read(0, robots.jog(0, wanted) if self.turns else robots.touch(0, wanted[:3, 3]))
        if self.turns:
            return Found(se3.compose(taught, se3.inverse(places[0])))
        return Found(se3.translation(taught[:3, 3] - places[0, :3, 3, None]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Compensated(Datum):
    """The arm with every draw at its mean, as a controller knows it that compensates its error."""

    kind: ClassVar[str] = COMPENSATED
    turns: bool | None = None

    @property
    def visits(self) -> tuple[Pose, ...]:
        """No poses."""
        return ()

    @property
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """No noise."""
        return ()

    def maps(self, places: Array) -> Maps:
        """Return maps of no visits."""
        return lambda task, view: (np.zeros((0, 6, 6)), np.zeros((0, 6, 6)))

    def bound(self, joints: int, configuration: Callable[[Any], Array]) -> Datum:
        """Return the datum with the attitude taken out too, unless stated, by an arm of six joints or more."""
        return self if self.turns is not None else replace(self, turns=joints >= _ALL_WAYS)

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return nothing: the error at the means is subtracted by the model."""
        return Found()


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreePoints(Datum):
    """A frame of three touched points."""

    kind: ClassVar[str] = "three_points"
    origin: Pose
    x: Pose
    xy: Pose
    touch: tuple[float, float]

    @property
    def visits(self) -> tuple[Pose, ...]:
        """Poses at the three points."""
        return self.origin, self.x, self.xy

    @property
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """Noise of the three touches."""
        return tuple((name, np.repeat([self.touch[0], 0.0], 3)) for name in ("origin", "x", "xy"))

    def maps(self, places: Array) -> Maps:
        """Return the maps, with a = |X - O|, b = (Y - O)·x and c = (Y - O)·y."""
        _check_spread(self, places[:, :3, 3] - places[:, :3, 3].mean(axis=0))
        frame = _frame(places[:, :3, 3, None])[:, :, 0]
        x, y, z = frame[:3, :3].T
        origin, along, beside = places[:, :3, 3]
        a, b, c = np.linalg.norm(along - origin), (beside - origin) @ x, (beside - origin) @ y
        turn_x = (np.outer(z, y) - np.outer(y, z)) / a - b / (a * c) * np.outer(x, z)
        turn_y = np.outer(x, z) / c
        turns = np.array([-(turn_x + turn_y), turn_x, turn_y])
        shifts = np.array([np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))])
        displaced = _padded(np.concatenate([shifts, turns], axis=1))

        def at(task: Array, view: int) -> tuple[Array, Array]:
            maps = transport(origin, task[:3, 3]) @ displaced
            return -maps, maps

        return at

    def frames(self, places: Array) -> dict[str, Array]:
        """Return the frame of the three points."""
        return {"frame": _frame(places[:, :3, 3, None])[:, :, 0]}

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return the frame of the points as read when touched."""
        touches = [robots.touch(k, places[k, :3, 3, None] + noise[k, :3]) for k in range(3)]
        points = np.array([robots.read(k, q)[:3, 3] for k, q in enumerate(touches)])
        change = se3.compose(_frame(points), se3.inverse(_frame(places[:, :3, 3, None])[:, :, 0]))
        return Found(change)


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolPivot(Datum):
    """A tool whose tip was found on a point."""

    kind: ClassVar[str] = "tool_pivot"
    moves_tool: ClassVar[bool] = True
    poses: tuple[Pose, ...]
    touch: tuple[float, float]

    @property
    def visits(self) -> tuple[Pose, ...]:
        """Poses on the point."""
        return self.poses

    @property
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """Noise of each touch."""
        return _numbered(len(self.poses), np.repeat([self.touch[0], 0.0], 3))

    def maps(self, places: Array) -> Maps:
        """Return the maps: the tip found is off by τ = A⁻¹ Σ D_iᵀ (d_i - n_i), D_i = R_i - R̄, A = Σ D_iᵀ D_i."""
        tips = places[:, :3, 3]
        spread = float(np.linalg.norm(tips - tips.mean(axis=0), axis=1).max())
        if spread > _SPIKE:
            raise InputError(
                f"datum {self.name}: the tip must be at one point in all poses of a tool_pivot; they are up to "
                f"{1e3 * spread:.3g} mm from their mean"
            )
        different = places[:, :3, :3] - places[:, :3, :3].mean(axis=0)
        square = np.einsum("nji,njk->ik", different, different)
        values = np.linalg.eigvalsh(square)
        if not values[0] > _FLAT * max(values[-1], _FLAT):
            raise InputError(f"datum {self.name}: the attitudes of a tool_pivot need at least two axes of rotation")
        offsets = np.linalg.solve(square, different.swapaxes(1, 2))

        def at(task: Array, view: int) -> tuple[Array, Array]:
            maps = np.zeros((len(places), 6, 6))
            maps[:, :3, :3] = task[:3, :3] @ offsets
            return -maps, maps

        return at

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return the tip found: the change of its offset that brings the readings nearest to one point."""
        spike = places[:, :3, 3].mean(axis=0)[:, None]  # one point, also where rounded poses miss it nominally
        reached = [robots.touch(k, spike + noise[k, :3]) for k in range(len(places))]
        read = np.array([robots.read(k, q) for k, q in enumerate(reached)])
        turns = read[:, :3, :3] - read[:, :3, :3].mean(axis=0)
        tips = read[:, :3, 3] - read[:, :3, 3].mean(axis=0)
        square, right = np.einsum("kjin,kjmn->nim", turns, turns), np.einsum("kjin,kjn->ni", turns, tips)
        return Found(tool=-np.linalg.solve(square, right[..., None])[..., 0].T)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Camera(Datum):
    """A camera calibrated by views of a board, which then sees the workpiece."""

    poses: tuple[Pose, ...]
    on: str
    camera: Array = field(repr=False)
    board: Array = field(repr=False)
    grasp: Array = field(repr=False)
    std: tuple[float, float]
    weights: tuple[float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_text("on, the link that carries camera or board,", self.on, "tool0")

    @property
    def frame(self) -> str:
        """The link that carries camera or board."""
        return self.on

    @property
    def noise(self) -> tuple[tuple[str, Array], ...]:
        """Noise of each view of the board, and of each of the workpiece."""
        return _numbered(len(self.poses) + self.views_of_workpiece, np.repeat(self.std, 3))

    @property
    def views_of_workpiece(self) -> int:
        """Number of views of the workpiece."""
        return 1

    def _solver(self, slopes: Array) -> Array:
        """Return K_i ``(N, 6, 6)``: the first unknown of least squares with slopes B_i ``(N, 6, 12)``."""
        weight = np.repeat(1 / np.square(self.weights), 3)
        weighted = slopes.swapaxes(1, 2) * weight
        square = (weighted @ slopes).sum(axis=0)
        scale = np.sqrt(np.diag(square))
        values = np.linalg.eigvalsh(square / np.outer(scale, scale))
        if not values[0] > _FLAT**2 * values[-1]:
            raise InputError(f"datum {self.name}: the poses do not determine the camera; turn the hand about two axes")
        inverse: Array = np.linalg.solve(square / np.outer(scale, scale), np.eye(12)) / np.outer(scale, scale)
        return (inverse @ weighted)[:, :6]

    def _solve(self, count: int, predict: Callable[[Array, Array], tuple[Array, Array]]) -> Array:
        """Return the camera ``(4, 4, n)`` of n robots by Gauss-Newton.

        Args:
            predict: Returns residuals ``(N, 6, n)`` and slopes ``(N, 6, 12, n)`` for camera and board, by displacements of
                both in their axes.
        """
        first, second = (np.repeat(pose[:, :, None], count, axis=2) for pose in (self.camera, self.board))
        weight = np.repeat(1 / np.square(self.weights), 3)
        for _ in range(_STEPS):
            residuals, slopes = predict(first, second)
            square = np.einsum("kirn,i,kisn->nrs", slopes, weight, slopes)
            right = np.einsum("kirn,i,kin->nr", slopes, weight, residuals)
            scale = np.sqrt(np.einsum("nrr->nr", square))
            square /= scale[:, :, None] * scale[:, None]
            step = -np.linalg.solve(square, (right / scale)[..., None])[..., 0] / scale
            first = se3.compose(first, se3.displacement(step[:, :6].T))
            second = se3.compose(second, se3.displacement(step[:, 6:].T))
            if np.abs(step).max() < _STILL:
                break
        return first


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEye(_Camera):
    """Camera on the flange, board fixed: AX = YB by least squares over both unknowns."""

    kind: ClassVar[str] = "hand_eye"
    views: tuple[tuple[Any, Pose], ...]

    @property
    def visits(self) -> tuple[Pose, ...]:
        """Poses that see the board, then those that see the workpiece."""
        return (*self.poses, *(pose for _, pose in self.views))

    @property
    def views_of_workpiece(self) -> int:
        """Number of views of the workpiece."""
        return len(self.views)

    def maps(self, places: Array) -> Maps:
        """Return the maps, from flanges ``(V, 4, 4)``."""
        count, board = len(self.poses), self.board[:3, 3]
        cameras = places @ self.camera
        slopes = np.array([np.hstack([by_place(camera, board), -_turned(self.board)]) for camera in cameras[:count]])
        solver = self._solver(slopes)
        by_errors = np.array(
            [gain @ transport(place[:3, 3], board) for gain, place in zip(solver, places, strict=False)]
        )
        by_noise = np.array([-gain @ _turned(camera) for gain, camera in zip(solver, cameras, strict=False)])

        def at(task: Array, view: int) -> tuple[Array, Array]:
            seen = count + view
            workpiece = task @ se3.inverse(self.grasp)
            to_tip = transport(workpiece[:3, 3], task[:3, 3])
            by_camera = to_tip @ by_place(cameras[seen], workpiece[:3, 3])
            gains, noise = np.zeros((2, len(places), 6, 6))
            gains[:count], noise[:count] = by_camera @ by_errors, by_camera @ by_noise
            gains[seen] = -to_tip @ transport(places[seen, :3, 3], workpiece[:3, 3])
            noise[seen] = to_tip @ _turned(cameras[seen])
            return gains, noise

        return at

    def frames(self, places: Array) -> dict[str, Array]:
        """Return the board, and the camera at each view of the workpiece."""
        views = enumerate(places[len(self.poses) :], start=1)
        return {"board": self.board, **{f"camera at view {number}": place @ self.camera for number, place in views}}

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return the workpiece as it is seen with the calibrated camera."""
        count = len(self.poses)
        numbers = (*range(count), count + view)
        flanges = [robots.true(k, robots.commanded(k)) for k in numbers]
        reads = [robots.read(k, robots.commanded(k)) for k in numbers]
        workpiece = task @ se3.inverse(self.grasp)
        targets = [*[self.board] * count, workpiece]
        views = [
            _displaced(se3.compose(se3.inverse(se3.compose(flange, self.camera)), target), view_noise)
            for flange, target, view_noise in zip(flanges, targets, noise[list(numbers)], strict=True)
        ]

        def predict(camera: Array, board: Array) -> tuple[Array, Array]:
            cameras = [se3.compose(read, camera) for read in reads[:count]]
            boards = [se3.compose(place, seen) for place, seen in zip(cameras, views, strict=False)]
            residuals = np.array([_difference(place, board) for place in boards])
            slopes = [
                np.concatenate([_by_places(p, b[:3, 3]), -_turned_all(board)], 1)
                for p, b in zip(cameras, boards, strict=True)
            ]
            return residuals, np.array(slopes)

        camera = self._solve(noise.shape[2], predict)
        change = se3.compose(reads[-1], camera, views[-1], se3.inverse(workpiece))
        return Found(change)

    def bound(self, joints: int, configuration: Callable[[Any], Array]) -> Datum:
        """Return the datum with the joint values of the tasks instead of their names."""
        views = tuple((configuration(task) if task is not None else None, pose) for task, pose in self.views)
        return replace(self, views=views)

    def view_of(self, q: Array) -> int:
        """Return the number of the view of a task."""
        for k, (task, _) in enumerate(self.views):
            if task is None or np.allclose(task, q, rtol=0, atol=1e-9):
                return k
        raise InputError(f"datum {self.name}: no view is given for this task; give view: a pose, or one for each task")


@dataclass(frozen=True, kw_only=True, eq=False)
class EyeToHand(_Camera):
    """Camera fixed, board on the flange."""

    kind: ClassVar[str] = "eye_to_hand"

    @property
    def visits(self) -> tuple[Pose, ...]:
        """Poses in which the board is seen."""
        return self.poses

    def maps(self, places: Array) -> Maps:
        """Return the maps, from flanges ``(V, 4, 4)``."""
        boards = places @ self.board
        slopes = np.array([np.hstack([by_place(self.camera, board[:3, 3]), -_turned(board)]) for board in boards])
        solver = self._solver(slopes)
        triples = zip(solver, places, boards, strict=True)
        by_errors = np.array([-gain @ transport(place[:3, 3], board[:3, 3]) for gain, place, board in triples])
        by_noise = -solver @ _turned(self.camera)

        def at(task: Array, view: int) -> tuple[Array, Array]:
            workpiece = task @ se3.inverse(self.grasp)
            to_tip = transport(workpiece[:3, 3], task[:3, 3])
            by_camera = to_tip @ by_place(self.camera, workpiece[:3, 3])
            return by_camera @ by_errors, np.array([*(by_camera @ by_noise), to_tip @ _turned(self.camera)])

        return at

    def frames(self, places: Array) -> dict[str, Array]:
        """Return the camera, and the board at its first pose."""
        return {"camera": self.camera, "board at the first pose": places[0] @ self.board}

    def find(self, robots: Robots, places: Array, noise: Array, task: Array, view: int) -> Found:
        """Return the workpiece as it is seen with the calibrated camera."""
        workpiece = task @ se3.inverse(self.grasp)
        flanges = [robots.true(k, robots.commanded(k)) for k in range(len(places))]
        reads = [robots.read(k, robots.commanded(k)) for k in range(len(places))]
        boards = [*(se3.compose(flange, self.board) for flange in flanges), workpiece]
        views = [
            _displaced(se3.compose(se3.inverse(self.camera), board), view_noise)
            for board, view_noise in zip(boards, noise, strict=True)
        ]

        def predict(camera: Array, board: Array) -> tuple[Array, Array]:
            seen = [se3.compose(camera, view) for view in views[:-1]]
            believed = [se3.compose(read, board) for read in reads]
            residuals = np.array([_difference(place, other) for place, other in zip(seen, believed, strict=True)])
            slopes = [
                np.concatenate([_by_places(camera, place[:3, 3]), -_turned_all(other)], 1)
                for place, other in zip(seen, believed, strict=True)
            ]
            return residuals, np.array(slopes)

        camera = self._solve(noise.shape[2], predict)
        change = se3.compose(camera, views[-1], se3.inverse(workpiece))
        return Found(change)


def check_together(datums: Sequence[Datum]) -> None:
    """Raise if datums, in the order in which they are found, do not go together."""
    names = [datum.name for datum in datums]
    if len(set(names)) < len(names):
        raise InputError(f"two datums have the same name, got {', '.join(map(repr, names))}; give each one of its own")
    for datum in [datum for datum in datums if datum.visits][:-1]:
        if datum.frame is not None:
            raise InputError(f"datum {datum.name}: a camera sees one workpiece; give it as the last datum")


# poses of many robots ------------------------------------------------------------------------------------------------


def _displaced(place: Array, values: Array) -> Array:
    """Return poses of a place ``(4, 4[, n])`` shifted and turned about its origin by ``(6, n)``, base axes."""
    rotation = se3.compose(se3.exp_rotation(values[3:]), place[:3, :3])
    return se3.pose(rotation, place[:3, 3].reshape(3, -1) + values[:3])


def _difference(place: Array, other: Array) -> Array:
    """Return ``[d; δ]`` ``(6, n)`` by which a place differs from another, base axes."""
    turn = se3.log_rotation(np.einsum("ij...,kj...->ik...", place[:3, :3], other[:3, :3]))
    return np.concatenate([place[:3, 3] - other[:3, 3], turn])


def _turned_all(place: Array) -> Array:
    """Return diag(R, R) of poses, ``(6, 6, n)``."""
    result = np.zeros((6, 6, place.shape[2]))
    result[:3, :3] = result[3:, 3:] = place[:3, :3]
    return result


def _by_places(place: Array, point: Array) -> Array:
    """Return Y(place→point), ``(6, 6, n)``, for poses ``(4, 4, n)`` and points ``(3, n)``."""
    result = _turned_all(np.broadcast_to(place, (4, 4, point.shape[1])))
    lever = point - place[:3, 3]
    for column in range(3):
        axis = result[3:, 3 + column]
        result[:3, 3 + column] = np.cross(axis, lever, axis=0)
    return result


def _frame(points: Array) -> Array:
    """Return frames ``(4, 4, n)`` of three points ``(3, 3, n)``: origin, on +x, in the xy plane."""
    x = points[1] - points[0]
    x = x / np.linalg.norm(x, axis=0)
    z = np.cross(x, points[2] - points[0], axis=0)
    z = z / np.linalg.norm(z, axis=0)
    return se3.pose(np.stack([x, np.cross(z, x, axis=0), z], axis=1), points[0])


def _fitted(readings: Array, points: Array) -> Array:
    """Return the motions ``(4, 4, n)`` that bring readings ``(N, 3, n)`` nearest to points ``(N, 3)`` (Kabsch)."""
    centre, seen = points.mean(axis=0), readings.mean(axis=0)
    square = np.einsum("ki,kjn->nij", points - centre, readings - seen)
    left, _, right = np.linalg.svd(square)
    left[..., 2] *= np.linalg.det(left @ right)[:, None]
    rotation = np.moveaxis(left @ right, 0, -1)
    return se3.pose(rotation, centre[:, None] - np.einsum("ijn,jn->in", rotation, seen))


# arguments -----------------------------------------------------------------------------------------------------------


def _numbered(count: int, std: Array) -> tuple[tuple[str, Array], ...]:
    return tuple((str(k + 1), std) for k in range(count))


def _check_spread(datum: Datum, arms: Array) -> None:
    """Raise if points, relative to their mean, lie on a line."""
    sizes = np.linalg.svd(arms, compute_uv=False)
    if not sizes[1] > _FLAT * max(sizes[0], _FLAT):
        raise InputError(
            f"datum {datum.name}: the points of a {datum.kind} lie on a line; a frame needs three that do not"
        )


def _listed(poses: object, least: int) -> tuple[Pose, ...]:
    if isinstance(poses, str) or not isinstance(poses, Iterable):
        raise InputError(f"the poses of a datum must be a list of names or joint values, got {shown(poses)}")
    listed = tuple(poses)
    if len(listed) < least:
        raise InputError(f"{len(listed)} poses for a datum; give at least {least}")
    return listed


def _std(value: object, what: str = "the noise of a datum") -> float:
    return check_quantity(what, value, LENGTH, "zero or more and finite", lambda number: number >= 0)


def _touch(value: object) -> tuple[float, float]:
    """Return the standard deviations of position and attitude."""
    if isinstance(value, Mapping):
        if not set(value) <= {"std", "attitude"}:
            raise InputError(f"the touch of a datum has the keys std and attitude, got {shown(value)}")
        attitude = check_quantity(
            "the attitude of a touch", value.get("attitude", 0.0), ANGLE, "zero or more and finite", lambda n: n >= 0
        )
        return _std(value.get("std", 0.0)), attitude
    return _std(value), 0.0


def _camera(camera: object, board: object, grasp: object, noise: object, weights: object) -> dict[str, Any]:
    places = {}
    for name, value in (("camera", camera), ("board", board), ("grasp", grasp)):
        place = check_numbers(f"the pose of the {name}", value, (4, 4))
        is_rotation = (
            np.abs(place[:3, :3] @ place[:3, :3].T - np.eye(3)).max() < 1e-6 and np.linalg.det(place[:3, :3]) > 0
        )
        if not is_rotation or not np.array_equal(place[3], [0, 0, 0, 1]):
            raise InputError(f"the pose of the {name} is not a rotation with a translation, (4, 4)")
        places[name] = place
    std = check_numbers(
        "the noise of a camera", noise, (2,), "standard deviations of translation, m, and rotation, rad"
    )
    assumed = (
        std if weights is None else check_numbers("the weights of a camera", weights, (2,), "two standard deviations")
    )
    if (std < 0).any():
        raise InputError("the noise of a camera must be zero or more")
    if not (assumed > 0).all():
        raise InputError("without noise of translation and rotation, give the weights of the solver, m and rad")
    return {**places, "std": tuple(std.tolist()), "weights": tuple(assumed.tolist())}
