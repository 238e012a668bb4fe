"""Designs of poses: grids over joint values or places with given tool orientations, and poses drawn at random."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import arguments, se3
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.progress import steps_to
from precision_pin.base.units import LENGTH, Quantity
from precision_pin.draws.philox import Units, stream_of
from precision_pin.draws.space import check_seed
from precision_pin.robot.chain import Chain, HasChain, chain_of
from precision_pin.robot.configurations import joint_quantity
from precision_pin.robot.inverse_kinematics import Branches, Task, inverse_kinematics
from precision_pin.robot.pose_set import OBSTRUCTED, PoseSet, chain_length
from precision_pin.robot.postures import alignment

_DECIMALS: Final = 9
"""Decimals of values in names, mm and degrees."""
MOST_POSES: Final = 2**20 - 1
"""Most poses of a grid: draws of pose scope allow no more."""


MOST_ANGLES: Final = 3600  # every tenth of a degree
Z: Final = (0.0, 0.0, 1.0)


def joint_grid(chain: Chain | HasChain, values: Mapping[str, ArrayLike]) -> PoseSet:
    """Return every combination of joint values; the last joint's change fastest.

    Args:
        chain: The arm: a chain, or a model that has one.
        values: Values of each joint by name, rad or m, one or several, or text such as ``"0 30 60 deg"``.

    Raises:
        InputError: A joint is missing or has no values, a number is not finite, or there are more than 1,048,575 poses.
        UnknownNameError: No such joint on the chain.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> poses = pp.joint_grid(chain, {"joint1": 0, "joint2": "0 30 deg", "joint3": 0, "joint4": 0})
        >>> print(poses.names)
        ('0°', '30°')
    """
    chain = chain_of(chain)
    for name in arguments.check_mapping("values", values):
        arguments.check_name("joint on the chain", name, chain.joint_names)
    missing = [name for name in chain.joint_names if name not in values]
    if missing:
        raise InputError(f"no values for the joints {', '.join(missing)}; a joint that is held has one value")
    rows = [_row(joint.name, values[joint.name], joint_quantity(joint)) for joint in chain.joints]
    q = _combinations(rows)
    return PoseSet.at(chain, chain.configurations.many(q), _names(chain, rows, q)).unobstructed(chain)


def check_grid_size(counts: list[int]) -> None:
    """Raise if the product of the counts exceeds 1,048,575 poses."""
    if (total := math.prod(counts)) > MOST_POSES:
        product = f"{' × '.join(map(str, counts))} = {total:,}"
        raise InputError(f"the grid has {product} poses; at most {MOST_POSES:,} are allowed")


def _combinations(rows: list[Array]) -> Array:
    """Return every combination of the rows' values, ``(len(rows), N)``; the last row's change fastest."""
    check_grid_size([len(row) for row in rows])
    return np.array([axis.ravel() for axis in np.meshgrid(*rows, indexing="ij")])


def _row(name: str, values: ArrayLike, quantity: Quantity) -> Array:
    row = np.atleast_1d(arguments.check_quantities(f"values of {name}", values, quantity))
    if row.ndim != 1 or not row.size:
        raise InputError(f"values of {name}: expected one or several numbers, got the shape {row.shape}")
    return row


def _names(chain: Chain, rows: list[Array], q: Array) -> tuple[str, ...]:
    varied = [joint for joint, row in enumerate(rows) if len(row) > 1] or list(range(len(rows)))

    def word(joint: int, value: float) -> str:
        # a grid may miss zero by a last digit
        rounded = round(float(1e3 * value if chain.prismatic[joint] else np.degrees(value)), _DECIMALS) + 0.0
        return f"{rounded:.6g}{' mm' if chain.prismatic[joint] else '°'}"

    labels = [[word(joint, value) for value in q[joint]] for joint in varied]
    return tuple(map(" ".join, zip(*labels, strict=True)))


@dataclass(frozen=True, eq=False)
class Orientation(Fixed):
    """Required attitude of the tool at a place; made by :meth:`given`, :meth:`along` or :meth:`free`.

    Attributes:
        task: What must match: ``pose``, ``axis`` or ``position``.
        rotations: Attitudes of the tip in the base to try, ``(A, 3, 3)``; with ``axis`` and ``position`` a single one.
        tool_axis: The tool axis in the tip's frame.
        label: Its name; empty if any attitude will do.

    Examples:
        >>> down = pp.Orientation.along((0, 0, -1), tool_axis=(1, 0, 0))
        >>> print(down.task, down.label)
        axis axis 0 0 -1
    """

    task: Task
    rotations: Array
    tool_axis: Array
    label: str = ""

    @classmethod
    def given(cls, rotation: ArrayLike, label: str = "") -> Orientation:
        """Return one attitude: a rotation matrix ``(3, 3)``, or roll, pitch and yaw ``(3,)`` in rad, in base axes.

        Raises:
            InputError: Neither, or a matrix that is not a rotation to 1e-9.
        """
        arguments.check_text("the label of an orientation", label)
        values = arguments.check_numbers(
            "the orientation", rotation, needs="a rotation (3, 3), or roll, pitch and yaw (3,)"
        )
        if values.shape == (3,):
            degrees = " ".join(f"{angle:.6g}" for angle in np.degrees(values) + 0.0)
            return cls("pose", se3.rpy_rotation(values)[None], np.array(Z), label or f"rpy {degrees}°")
        if values.shape != (3, 3):
            raise InputError(
                f"the orientation has the shape {values.shape}, expected a rotation (3, 3), or roll, pitch and yaw (3,)"
            )
        if np.abs(values.T @ values - np.eye(3)).max() > 1e-9 or np.linalg.det(values) < 0:
            needs = "its columns must be orthonormal to 1e-9, without mirroring"
            raise InputError(f"the orientation is no rotation: {needs}")
        return cls("pose", values[None], np.array(Z), label or "given")

    @classmethod
    def along(cls, direction: ArrayLike, angles: int | None = None, tool_axis: ArrayLike = Z) -> Orientation:
        """Return a direction of the tool axis in the base, with any angle about it or with some.

        Args:
            direction: Where the tool axis points, ``(3,)``, of any length.
            angles: Number of angles about the tool axis to try, in equal steps of a turn; ``None`` leaves the angle to
                the inverse kinematics.
            tool_axis: The tool axis in the tip's frame, ``(3,)``.

        Raises:
            InputError: A direction of length zero, or a wrong number of angles.
        """
        unit, axis = _direction("the direction", direction), _direction("the tool axis", tool_axis)
        label = "axis " + " ".join(f"{value:.4g}" for value in unit + 0.0)
        # einsum, as the rounding of a matrix product depends on the machine
        upright = np.einsum("ij,kj->ik", alignment(unit), alignment(axis))
        if angles is None:
            return cls("axis", upright[None], axis, label)
        arguments.check_whole("the number of angles about the tool axis", angles, 1, MOST_ANGLES)
        rotations = se3.rotation_about(unit, 2 * np.pi * np.arange(angles) / angles)
        return cls("pose", np.einsum("ija,jk->aik", rotations, upright), axis, label)

    @classmethod
    def free(cls) -> Orientation:
        """Return the orientation that allows any attitude."""
        return cls("position", np.eye(3)[None], np.array(Z))

    @property
    def angle_labels(self) -> tuple[str, ...]:
        """A label for each attitude to try: its angle about the tool axis, empty if there is only one."""
        count = len(self.rotations)
        return ("",) if count == 1 else tuple(f"{360 * k / count:.6g}°" for k in range(count))


def _direction(name: str, value: ArrayLike) -> Array:
    vector = arguments.check_numbers(name, value, (3,), "three finite numbers")
    scaled = vector / max(float(np.abs(vector).max()), 1e-300)
    size = float(np.sqrt((scaled * scaled).sum()))
    if not size > 0:
        raise InputError(f"{name} has length zero; give a direction, such as (0, 0, -1)")
    return scaled / size


def box_places(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
    """Return the points ``(3, N)`` of a grid over a box, from the values of each base coordinate; z changes fastest.

    Values are in m, or text with a unit, such as ``"0 100 200 mm"``.

    Raises:
        InputError: No values, or numbers that are not finite.

    Examples:
        >>> print(pp.box_places(x="0.5 1 m", y=0, z="200 mm"))
        [[0.5 1. ]
         [0.  0. ]
         [0.2 0.2]]
    """
    return _combinations([_row(name, values, LENGTH) for name, values in (("x", x), ("y", y), ("z", z))])


def plane_places(origin: ArrayLike, u: ArrayLike, v: ArrayLike, along_u: ArrayLike, along_v: ArrayLike) -> Array:
    """Return the points ``(3, N)`` of a grid over a plane; those along v change fastest.

    Args:
        origin: A point of the plane in the base, m, ``(3,)``, or text such as ``"400 0 300 mm"``.
        u, v: Perpendicular directions in the plane, in base axes, of any length.
        along_u, along_v: Distances from the origin along either, m, or text such as ``"0 50 100 mm"``.

    Raises:
        InputError: Directions that are not perpendicular, no values, or numbers that are not finite.

    Examples:
        >>> print(pp.plane_places("0 0 200 mm", (1, 0, 0), (0, 1, 0), "0 100 mm", "0 50 mm"))
        [[0.   0.   0.1  0.1 ]
         [0.   0.05 0.   0.05]
         [0.2  0.2  0.2  0.2 ]]
    """
    needs = "three finite numbers, in m or with a unit"
    point = arguments.check_quantities("the origin of the plane", origin, LENGTH, (3,), needs)
    units = []
    for name, values in (("u", u), ("v", v)):
        direction = arguments.check_numbers(f"the direction {name}", values, (3,), "three finite numbers")
        size = float(np.linalg.norm(direction))
        if not 0 < size < np.inf:
            raise InputError(f"the direction {name} of the plane has length {size:g}; give one such as (1, 0, 0)")
        units.append(direction / size)
    if abs(float((units[0] * units[1]).sum())) > 1e-6:
        raise InputError("the directions u and v of the plane are not at right angles")
    first, second = _combinations([_row("u", along_u, LENGTH), _row("v", along_v, LENGTH)])
    return point[:, None] + units[0][:, None] * first + units[1][:, None] * second


def place_grid(
    chain: Chain | HasChain,
    places: ArrayLike,
    orientations: Orientation | Sequence[Orientation],
    *,
    branches: Branches = "nearest",
    reference: ArrayLike | None = None,
    progress: Callable[[int], None] | bool | None = None,
) -> PoseSet:
    """Return the poses that bring the tip to places, by inverse kinematics.

    The poses of one place and orientation, its branches and angles about the tool axis, have the same number in
    :attr:`PoseSet.node`. An unreachable angle is one pose without joint values. :meth:`PoseSet.best_and_worst` compares
    them.

    Args:
        chain: The arm: a chain, or a model that has one.
        places: Points in the base, m, ``(3,)`` or ``(3, N)``, or one as text (``"400 0 300 mm"``), as
            :func:`box_places` and :func:`plane_places` make them.
        orientations: Orientations of the tool at each, one or several.
        branches: Which solutions of the inverse kinematics: ``nearest`` to the reference posture; ``best``, farthest
            from a singularity; ``all``.
        reference: Joint values, rad and m, ``(n,)``; by default zero, or the limit nearest to it.
        progress: Function called with the number of poses solved since its last call; ``True`` shows a bar.

    Raises:
        InputError: No places or orientations, a wrong shape, or a number that is not finite.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> poses = pp.place_grid(chain, "2 0 0.3 m", pp.Orientation.free())
        >>> print(chain.at(poses.q[:, 0]).pose[:3, 3].round(6) + 0)
        [2.  0.  0.3]
    """
    chain = chain_of(chain)
    arguments.check_choice("branches", branches, get_args(Branches))
    points = arguments.check_quantities(
        "the places", places, LENGTH, needs="finite numbers, (3,) or (3, N), m in the base"
    )
    points = points[:, None] if points.ndim == 1 else points
    if points.ndim != 2 or len(points) != 3 or not points.size:
        raise InputError(f"the places have the shape {points.shape}, expected (3,) or (3, N) with at least one place")
    kinds = check_orientations(orientations)
    total = count_wanted(points.shape[1], kinds)
    with steps_to(progress, total, "poses") as step:
        sets = [_at_orientation(chain, points, kind, len(kinds) > 1, branches, reference, step) for kind in kinds]
    return _place_by_place(sets, [len(kind.rotations) for kind in kinds])


def check_orientations(given: Orientation | Sequence[Orientation]) -> tuple[Orientation, ...]:
    """Return one or several orientations as a tuple."""
    kinds = arguments.check_items("orientations", [given] if isinstance(given, Orientation) else given, Orientation)
    if not kinds:
        raise InputError("no orientations; give at least one, such as Orientation.free()")
    return kinds


def count_wanted(places: int, orientations: Sequence[Orientation]) -> int:
    """Return the number of poses for the inverse kinematics; raise if it exceeds the limit of a grid."""
    angles = sum(len(kind.rotations) for kind in orientations)
    check_grid_size([places, angles])
    return places * angles


def _at_orientation(
    chain: Chain,
    points: Array,
    kind: Orientation,
    is_named: bool,
    branches: Branches,
    reference: ArrayLike | None,
    step: Callable[[int], None],
) -> PoseSet:
    """Return the poses at one orientation; a place and an angle about the tool axis are a node."""
    angles = len(kind.rotations)
    target_poses = np.zeros((4, 4, points.shape[1] * angles))
    target_poses[:3, :3] = np.tile(np.moveaxis(kind.rotations, 0, -1), points.shape[1])
    target_poses[:3, 3] = np.repeat(points, angles, axis=1)
    target_poses[3, 3] = 1.0
    names = tuple(
        ", ".join(filter(None, (place, kind.label if is_named else "", angle)))
        for place in _place_names(points)
        for angle in kind.angle_labels
    )
    solutions = inverse_kinematics(
        chain, target_poses, task=kind.task, tool_axis=kind.tool_axis, reference=reference, progress=step
    )
    return solutions.poses(names, branches)


def _place_by_place(sets: Sequence[PoseSet], angles: Sequence[int]) -> PoseSet:
    """Return the poses at several orientations in the order of the places; each place and orientation is a node."""
    node_lists = [poses.node for poses in sets if poses.node is not None]
    enumerated = enumerate(zip(node_lists, angles, strict=True))
    nodes = np.concatenate([node // count * len(sets) + rank for rank, (node, count) in enumerated])
    order = np.argsort(nodes, kind="stable")
    return replace(PoseSet.joined(sets).take(order), node=nodes[order])


def _place_names(points: Array) -> list[str]:
    millimetres = points.T * 1e3 + 0.0
    return [" ".join(f"{value:.6g}" for value in place) + " mm" for place in millimetres]


_FEWEST: Final = 32
_MOST: Final = 256
"""Draws tried together; their number does not change the poses."""
_TRIES: Final = 100
_LEAST_TRIES: Final = 10_000
"""Draws for each wanted pose, and in all at least, after which too few are within reach and box."""


def random_poses(
    chain: Chain | HasChain,
    count: int,
    *,
    seed: int = 0,
    box: ArrayLike | None = None,
    orientations: Orientation | Sequence[Orientation] | None = None,
    progress: Callable[[int], None] | bool | None = None,
) -> PoseSet:
    """Return poses drawn at random, reproducible for a seed; a smaller number is the start of a larger one.

    Without ``orientations`` joint values are drawn evenly between their limits, over a whole turn for a joint without
    limits; with a box those with the tip in it are kept. With ``orientations`` places are drawn evenly over the box,
    each with one of the orientations and of its angles about the tool axis, and with one of the branches that lead
    there. Unreachable places are redrawn, so that the rest lie evenly over the reachable space. So are poses at
    which the arm of a sheet hits itself or what it is kept out of; :attr:`PoseSet.left_out` counts them.

    Args:
        chain: The arm: a chain, or a model that has one.
        count: Number of poses.
        seed: 64-bit seed.
        box: Lowest and highest x, y and z of the tip in the base, m, ``(3, 2)``; with orientations, by default the cube
            about the first joint that holds every place within reach.
        orientations: Orientations of the tool, one or several.
        progress: Function called with the number of poses found since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong number or box, a sliding joint without limits, or too few poses within the box or reach.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> poses = pp.random_poses(chain, 20, seed=1, box=[[1, 3], [-1, 1], [0, 1]])
        >>> print(poses.q.shape, bool(poses.position[0].min() >= 1))
        (4, 20) True
    """
    chain = chain_of(chain)
    arguments.check_whole("the number of poses", count, 1, MOST_POSES)
    check_seed(seed)
    limits = None if box is None else _check_box(box)
    if orientations is None:
        draw = _joint_draws(chain, limits)
    else:
        draw = partial(
            _draw_places, chain, check_orientations(orientations), _reach(chain) if limits is None else limits
        )
    batches: list[PoseSet] = []
    left_out: Counter[str] = Counter()
    missing, tries = count, 0
    with steps_to(progress, count, "poses") as step:
        while missing > 0:
            raise_if_interrupted()
            if tries >= max(_TRIES * count, _LEAST_TRIES):
                hit = ", ".join(f"{number:,} {kind}" for kind, number in left_out.items())
                raise InputError(
                    f"only {count - missing:,} of {tries:,} random poses are within reach and in the box"
                    f"{f' and hit nothing ({hit})' if hit else ''}; make it larger, or ask for fewer than {count:,}"
                )
            size = min(max(2 * missing, _FEWEST), _MOST)
            batch = draw(Units(seed, tries, size))
            tries += size
            if batch is None:
                continue
            left_out.update(status for status in batch.status if status in OBSTRUCTED)
            columns = np.flatnonzero(batch.known)[:missing]
            if columns.size:
                batches.append(batch.take(columns))
                missing -= len(columns)
                step(len(columns))
    poses = PoseSet.joined(batches)
    return replace(poses, names=tuple(f"random {number}" for number in range(1, count + 1)), left_out=dict(left_out))


def _joint_draws(chain: Chain, box: Array | None) -> Callable[[Units], PoseSet | None]:
    """Return what draws joint values between their limits, kept if the tip is in the box."""
    low, high = (limit.copy() for limit in chain.configurations.limits)
    endless = ~np.isfinite(low) | ~np.isfinite(high)
    for joint in np.flatnonzero(endless & chain.prismatic):
        name = chain.joint_names[joint]
        raise InputError(f"the joint {name!r} slides without limits; values of it cannot be drawn")
    low[endless], high[endless] = -np.pi, np.pi

    def draw(units: Units) -> PoseSet | None:
        uniforms = units.uniforms([stream_of(name) for name in chain.joint_names], 0)
        poses = PoseSet.at(chain, low[:, None] + (high - low)[:, None] * uniforms)
        if box is not None:
            is_inside = np.asarray(((poses.position >= box[:, :1]) & (poses.position <= box[:, 1:])).all(axis=0))
            if not is_inside.any():
                return None
            poses = poses.of(is_inside)
        return poses.unobstructed(chain)

    return draw


def _draw_places(chain: Chain, kinds: tuple[Orientation, ...], box: Array, units: Units) -> PoseSet:
    """Return draws of places in a box with one of some orientations; unreachable ones have no joint values."""
    place = units.uniforms([stream_of(f"place {axis}") for axis in "xyz"], 0)
    points = box[:, :1] + (box[:, 1:] - box[:, :1]) * place
    variants = [(rank, angle) for rank, kind in enumerate(kinds) for angle in range(len(kind.rotations))]
    variant_of = (units.uniforms([stream_of("orientation")], 0)[0] * len(variants)).astype(np.intp)
    branch = units.uniforms([stream_of("branch")], 0)[0]
    sets, ranks = [], []
    for rank, kind in enumerate(kinds):
        columns = np.flatnonzero([variants[variant][0] == rank for variant in variant_of])
        if not len(columns):
            continue
        targets = np.zeros((4, 4, len(columns)))
        targets[:3, :3] = np.moveaxis(kind.rotations[[variants[variant_of[k]][1] for k in columns]], 0, -1)
        targets[:3, 3], targets[3, 3] = points[:, columns], 1.0
        solutions = inverse_kinematics(chain, targets, task=kind.task, tool_axis=kind.tool_axis).poses(branches="all")
        assert solutions.node is not None
        # one of the branches that lead to each place
        counts = np.bincount(solutions.node, minlength=len(columns))
        first: NDArray[np.intp] = np.cumsum(counts) - counts
        sets.append(solutions.take(first + (branch[columns] * counts).astype(np.intp)))
        ranks.append(columns)
    return PoseSet.joined(sets).take(np.argsort(np.concatenate(ranks)))


def _check_box(box: ArrayLike) -> Array:
    needs = "lowest and highest x, y and z, in m or with a unit, (3, 2)"
    limits = arguments.check_quantities("the box", box, LENGTH, (3, 2), needs)
    if (limits[:, 0] > limits[:, 1]).any():
        axis = "xyz"[int(np.argmax(limits[:, 0] > limits[:, 1]))]
        raise InputError(f"the box: its lowest {axis} is above its highest")
    return limits


def _reach(chain: Chain) -> Array:
    """Return a cube about the first joint that holds every place within reach, ``(3, 2)``."""
    low, high = chain.configurations.limits
    travel = np.maximum(np.abs(low), np.abs(high))[chain.prismatic].sum()
    if not np.isfinite(travel):
        raise InputError("a joint slides without limits, so that the reach has none; give a box")
    radius = chain_length(chain) + travel + float(np.linalg.norm(chain.target))
    centre = chain.placements[0][:3, 3]
    return np.array([centre - radius, centre + radius]).T
