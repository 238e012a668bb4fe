"""The figures of ISO 9283:1998 as formulas over arrays of cycles.

The first axis of every array is the cycle; further axes, such as the robot, are kept. Sums are taken relative to the
first cycle, so that identical cycles have exactly zero scatter.

Limit of RP for many cycles: for normal positions with covariance Λ the distance l from the barycentre has mean m = E|z|
and variance tr Λ - m², so

    RP → m + 3 √(tr Λ - m²).

With z = √Λ g and g split into length and direction, m = E|g| · mean over the sphere of √(λ₁n₁² + λ₂n₂² + λ₃n₃²), and
that mean is Carlson's elliptic integral R_G(λ₁, λ₂, λ₃) (https://dlmf.nist.gov/19.16.E3).

Measured cycles of a test in a CSV file:

    pose, cycle, x [mm], y [mm], z [mm], a [deg], b [deg], c [deg]
    P1, 1, 850.02, -0.01, 600.11, 180.00, 0.01, 90.00

Positions and orientations are in base axes. a, b, c are angles about x, y, z, R = Rot(z, c) Rot(y, b) Rot(x, a);
``rx``, ``ry``, ``rz`` in their place are a rotation vector. Without either only positions are compared.
"""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import elliprg

from precision_pin.base import csv_columns, errors, se3, units
from precision_pin.base.arguments import check_name, check_numbers, shown
from precision_pin.base.arrays import Array, Record, field_names
from precision_pin.base.errors import Finding, InputError, UnknownNameError, add, warns_at_end


def barycentre(values: Array) -> Array:
    """Return the mean over the cycles; exact where all are the same."""
    return values[0] + (values - values[0]).mean(axis=0)


def scatter(values: Array) -> Array:
    """Return three standard deviations over the cycles, divisor n - 1."""
    shifted = values - values[0]
    deviations = shifted - shifted.mean(axis=0)
    return 3 * np.sqrt((deviations * deviations).sum(axis=0) / (len(values) - 1))


def repeatability(positions: Array) -> Array:
    """Return RP = l̄ + 3 S_l of positions ``(n, 3, …)``."""
    shifted = positions - positions[0]
    distances = _norm(shifted - shifted.mean(axis=0), axis=1)
    return distances.mean(axis=0) + scatter(distances)


def pose_figures(deviations: Array, angles: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return AP_p, its parts along x, y, z and about them, RP and its angles, m and rad; parts are ``(3, …)``.

    Given are attained minus commanded positions ``(n, 3, …)``, and the angles from the commanded to the attained
    orientation about the base axes, ``(n, 3, …)``.
    """
    accuracy = barycentre(deviations)
    return _norm(accuracy), accuracy, barycentre(angles), repeatability(deviations), scatter(angles)


def distance_figures(commanded: Array, first: Array, second: Array) -> tuple[Array, Array, Array, Array]:
    """Return AD and RD, and both along x, y, z ``(3, …)``, of attained positions ``(n, 3, …)``, m.

    ``commanded`` is the first minus the second commanded position, ``(3,)``.
    """
    differences = first - second
    along = np.abs(differences)
    nominal = np.abs(commanded).reshape((3,) + (1,) * (along.ndim - 2))
    distances = _norm(differences, axis=1)
    accuracy = barycentre(distances) - np.sqrt((commanded * commanded).sum())
    return accuracy, scatter(distances), barycentre(along) - nominal, scatter(along)


def angles_of(rotation: Array) -> Array:
    """Return a, b, c ``(3, …)`` of rotations ``(3, 3, …)`` = Rot(z, c) Rot(y, b) Rot(x, a), b from -π/2 to π/2."""
    a, c = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([a, np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])), c])


def _norm(vectors: Array, axis: int = 0) -> Array:
    return np.sqrt((vectors * vectors).sum(axis=axis))


def fit_to(points: Array, deviations: Array) -> tuple[Array, Array]:
    """Return rotation ``(3, 3, N)`` and residuals of AP_xyz of the best fit of the barycentres to the commanded points.

    The fit minimises the sum of squared distances at the poses over all motions of the base (Kabsch 1976).
    """
    attained = points[:, :, None] + deviations
    centre, target = attained.mean(axis=0), points.mean(axis=0)
    cross = np.einsum("pi,pjn->nij", points - target, attained - centre)
    left_vectors, _, right_vectors = np.linalg.svd(cross)
    # a reflection is not a motion
    left_vectors[:, :, 2] *= np.sign(np.linalg.det(left_vectors) * np.linalg.det(right_vectors))[:, None]
    rotation = np.einsum("nij,njk->ikn", left_vectors, right_vectors)
    aligned = np.einsum("ijn,pjn->pin", rotation, attained - centre) + target[:, None]
    return rotation, aligned - points[:, :, None]


DISTANCE: Final = (1, 3)
"""Indices of the two poses of AD and RD, P2 and P4."""

# E|g| of three independent standard normal numbers
_MEAN_LENGTH: Final = 2 * math.sqrt(2 / math.pi)


def mean_distance(covariances: Array) -> Array:
    """Return E|z| of normal vectors with covariances ``(…, 3, 3)``, which may be singular."""
    values = _eigenvalues(covariances)
    # scaled to the trace: the integral accepts covariances of 1e-12 m², but not products of them
    trace = values.sum(axis=-1)
    shares = values / np.where(trace > 0, trace, 1.0)[..., None]
    return _MEAN_LENGTH * np.sqrt(trace) * elliprg(shares[..., 0], shares[..., 1], shares[..., 2])


def repeatability_limit(covariances: Array) -> Array:
    """Return the limit of RP for many cycles with normal positions of covariances ``(…, 3, 3)``."""
    mean = mean_distance(covariances)
    trace = _eigenvalues(covariances).sum(axis=-1)
    return mean + 3 * np.sqrt(np.maximum(trace - mean * mean, 0.0))


def _eigenvalues(covariances: Array) -> Array:
    return np.maximum(np.linalg.eigvalsh(covariances), 0.0)


# largest entry of R Rᵀ - 1 accepted for a rotation
_NOT_A_ROTATION: Final = 1e-6
# largest coordinate, m: squares of larger ones leave no digits for errors of nanometres
_LARGEST: Final = 1e6
# cosine of b below which the control's a and c are near their singularity: b within 5.7° of ±90°
_NEAR: Final = 0.1


class _Figures(Record):
    """Numbers by name, as attributes and as items; ``dict`` converts them."""

    @classmethod
    def keys(cls) -> tuple[str, ...]:
        """Return the names of the figures."""
        kind: Any = cls
        return field_names(kind)

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __getitem__(self, name: str) -> float:
        return getattr(self, check_name("figure", name, self.keys()))


@dataclass(frozen=True)
class MeasuredPose(_Figures):
    """Accuracy and repeatability of one robot at one pose, m and rad, base axes.

    Attributes:
        AP: Distance of the barycentre of the attained positions from the commanded position.
        AP_x, AP_y, AP_z: Barycentre minus commanded position.
        AP_a, AP_b, AP_c: Mean angles about x, y and z from the commanded to the attained orientation.
        RP: l̄ + 3 S_l, with l the distances of the attained positions from their barycentre.
        RP_a, RP_b, RP_c: Three standard deviations of the angles; the standard writes ±RP_a.
    """

    AP: float
    AP_x: float
    AP_y: float
    AP_z: float
    AP_a: float
    AP_b: float
    AP_c: float
    RP: float
    RP_a: float
    RP_b: float
    RP_c: float


@dataclass(frozen=True)
class MeasuredDistance(_Figures):
    """Accuracy and repeatability of the distance between two poses of one robot, m and rad, base axes.

    Attributes:
        AD, RD: Mean minus commanded distance, and three standard deviations; the standard writes ±RD.
        AD_x, AD_y, AD_z, RD_x, RD_y, RD_z: The same for the distances along the axes, |x₁ - x₂|.
        AD_a, AD_b, AD_c, RD_a, RD_b, RD_c: The same for the angular distances, |a₁ - a₂|.
    """

    AD: float
    AD_x: float
    AD_y: float
    AD_z: float
    AD_a: float
    AD_b: float
    AD_c: float
    RD: float
    RD_x: float
    RD_y: float
    RD_z: float
    RD_a: float
    RD_b: float
    RD_c: float


@warns_at_end
def iso9283_of(commanded: ArrayLike, attained: ArrayLike) -> MeasuredPose:
    """Return accuracy and repeatability at a pose from measured cycles, ISO 9283:1998.

    The angles a, b, c about the base axes x, y, z are those of R' R_cᵀ = Rot(z, c) Rot(y, b) Rot(x, a), the rotation
    from the commanded orientation R_c to the attained R'. Near the commanded orientation they are the rotation about
    each axis, whatever angles the control uses. ``W_ANGLES`` warns where the control's own angles are near their
    singularity, so that their scatter differs.

    Args:
        commanded: Pose ``(4, 4)``, or ``[p; rpy]`` ``(6,)`` in m and rad.
        attained: Poses of n ≥ 2 cycles, ``(n, 4, 4)`` or ``(n, 6)``.

    Raises:
        InputError: Another shape, a number that is not finite, a matrix that is not a pose, or fewer than two cycles.

    Examples:
        >>> commanded, attained = np.zeros(6), np.zeros((4, 6))
        >>> attained[:, 0] = [1e-3, 2e-3, 2e-3, 3e-3]
        >>> figures = pp.iso9283_of(commanded, attained)
        >>> print(round(1e3 * figures.AP, 3), round(1e3 * figures.RP, 3))
        2.0 2.232
    """
    pose = _read_pose("the commanded pose", commanded)
    cycles = _read_cycles("the attained poses", attained)
    _warn_near_singularity(pose)
    accuracy, along, about, repeated, spreads = pose_figures(*_pose_deviations(pose, cycles))
    return MeasuredPose(**_by_name("AP", accuracy, x_y_z=along, a_b_c=about), **_by_name("RP", repeated, a_b_c=spreads))


@warns_at_end
def iso9283_distance(commanded_pair: ArrayLike, attained_pair: ArrayLike) -> MeasuredDistance:
    """Return accuracy and repeatability of the distance between two poses from measured cycles, ISO 9283:1998.

    The angles of each pose are its commanded ones plus those of :func:`iso9283_of`.

    Args:
        commanded_pair: The two commanded poses, each ``(4, 4)`` or ``(6,)`` as in :func:`iso9283_of`.
        attained_pair: The attained poses at each, ``(n, 4, 4)`` or ``(n, 6)``; row j of both is cycle j.

    Raises:
        InputError: As in :func:`iso9283_of`, other than two poses, or different numbers of cycles.

    Examples:
        >>> commanded = np.array([[0.8, 0, 0.5, 0, 0, 0], [0.4, 0, 0.5, 0, 0, 0]])
        >>> attained = commanded[:, None] + [[[0, 0, 0, 0, 0, 0]] * 2, [[-1e-3, 0, 0, 0, 0, 0]] * 2]
        >>> print(round(1e3 * pp.iso9283_distance(commanded, attained).AD, 6))
        1.0
    """
    names = ("first", "second")
    commanded = [
        _read_pose(f"the {name} commanded pose", value)
        for name, value in zip(names, _check_pair("the commanded poses", commanded_pair), strict=True)
    ]
    cycles = [
        _read_cycles(f"the attained poses at the {name}", value)
        for name, value in zip(names, _check_pair("the attained poses", attained_pair), strict=True)
    ]
    if len({poses.shape[-1] for poses in cycles}) > 1:
        counts = " and ".join(str(poses.shape[-1]) for poses in cycles)
        raise InputError(f"{counts} cycles at the two poses; a distance needs both poses in every cycle")
    for pose in commanded:
        _warn_near_singularity(pose)
    accuracy, repeated, along, scattered = distance_figures(
        commanded[0][:3, 3] - commanded[1][:3, 3], *(poses[:3, 3].T for poses in cycles)
    )
    commanded_angles = angles_of(commanded[0][:3, :3]) - angles_of(commanded[1][:3, :3])
    turned = [_pose_deviations(pose, poses)[1] for pose, poses in zip(commanded, cycles, strict=True)]
    angles = np.abs(commanded_angles + turned[0] - turned[1])
    change = barycentre(angles) - np.abs(commanded_angles)
    return MeasuredDistance(
        **_by_name("AD", accuracy, x_y_z=along, a_b_c=change),
        **_by_name("RD", repeated, x_y_z=scattered, a_b_c=scatter(angles)),
    )


def _by_name(figure: str, value: Array, **vectors: Array) -> dict[str, float]:
    """Return a figure and its parts by name: ``AP``, and from ``a_b_c`` ``AP_a``, ``AP_b``, ``AP_c``."""
    figures = {figure: float(value)}
    for axes, vector in vectors.items():
        figures |= {f"{figure}_{axis}": float(part) for axis, part in zip(axes.split("_"), vector, strict=True)}
    return figures


def _pose_deviations(commanded: Array, cycles: Array) -> tuple[Array, Array]:
    """Return attained minus commanded positions and the angles between the orientations, ``(n, 3)`` each."""
    rotations = np.einsum("ijn,kj->ikn", cycles[:3, :3], commanded[:3, :3])
    return (cycles[:3, 3] - commanded[:3, 3, None]).T, angles_of(rotations).T


def _warn_near_singularity(commanded: Array) -> None:
    b = float(angles_of(commanded[:3, :3])[1])
    if math.cos(b) < _NEAR:
        message = (
            f"the commanded orientation has b = {math.degrees(b):.4g} deg, near the singularity of a, b, c at 90 deg: "
            "the scatter of a and c that a control shows there is larger than the scatter about the axes, which is given here"
        )
        add([Finding("warning", "W_ANGLES", message)])


def _check_pair(subject: str, pair: object) -> tuple[object, object]:
    if isinstance(pair, list | tuple | np.ndarray) and len(pair) == 2:
        return pair[0], pair[1]
    raise InputError(f"{subject} must be two, in a list or an array, got {shown(pair)}")


def _read_pose(subject: str, value: object) -> Array:
    numbers = _read_numbers(subject, value, "a pose (4, 4), or position and rpy (6,), in m and rad")
    if numbers.shape == (6,):
        return se3.pose(se3.rpy_rotation(numbers[3:]), numbers[:3])
    if numbers.shape != (4, 4):
        raise InputError(
            f"{subject} must be a pose (4, 4), or position and rpy (6,), got an array of shape {numbers.shape}"
        )
    _check_rigid(subject, numbers[..., None])
    return numbers


def _read_cycles(subject: str, values: object) -> Array:
    numbers = _read_numbers(subject, values, "poses (n, 4, 4), or positions and rpy (n, 6), in m and rad")
    if numbers.shape[1:] not in ((4, 4), (6,)):
        raise InputError(
            f"{subject} must be poses (n, 4, 4), or positions and rpy (n, 6), got an array of shape {numbers.shape}"
        )
    if len(numbers) < 2:
        raise InputError(f"{subject} must be of at least 2 cycles, got {len(numbers)}; the standard has 30")
    if numbers.ndim == 3:
        poses = np.moveaxis(numbers, 0, -1)
        _check_rigid(subject, poses)
        return poses
    roll, pitch, yaw = numbers[:, 3:].T
    about = (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll))
    rotations = [se3.rotation_about(axis, angle) for axis, angle in about]
    return se3.pose(np.einsum("ijn,jkn,kln->iln", *rotations), numbers[:, :3].T)


def _read_numbers(name: str, values: object, needs: str) -> Array:
    numbers = check_numbers(name, values, needs=needs)
    if numbers.size and np.abs(numbers).max() > _LARGEST:
        raise InputError(f"{name} must hold no number beyond {_LARGEST:,.0f} (m, rad), got {np.abs(numbers).max():g}")
    return numbers


def _check_rigid(subject: str, poses: Array) -> None:
    """Reject matrices ``(4, 4, n)`` that are not poses."""
    rotation = poses[:3, :3]
    gaps = np.abs(np.einsum("ijn,kjn->ikn", rotation, rotation) - np.eye(3)[..., None]).max(axis=(0, 1))
    wrong = (gaps > _NOT_A_ROTATION) | (np.linalg.det(np.moveaxis(rotation, -1, 0)) < 0)
    wrong |= np.abs(poses[3] - np.array([0, 0, 0, 1.0])[:, None]).max(axis=0) > _NOT_A_ROTATION
    if wrong.any():
        row = f": row {int(np.flatnonzero(wrong)[0])}" if len(wrong) > 1 else ""
        raise InputError(f"{subject} must be rotation, position in m and a last row 0 0 0 1{row} is not")


_POSITION: Final = ("x", "y", "z")
_TURNS: Final = (("a", "b", "c"), ("rx", "ry", "rz"))
# maximum number of characters of a name that a message quotes
_LONGEST: Final = 40


def read_cycles(path: str | os.PathLike[str], names: Mapping[str, str], columns: str = "") -> dict[str, Array]:
    """Return the attained poses of each pose in the order of the cycles, ``(n, 4, 4)``, or positions ``(n, 3)``.

    ``columns`` names columns as :meth:`precision_pin.base.csv_columns.ColumnNames.parse` reads them.
    """
    axes = ("pose", "cycle", *_POSITION, *sum(_TURNS, ()))
    table = csv_columns.read(path, ("pose",), columns=csv_columns.ColumnNames.parse(columns), known=axes.__contains__)
    if "pose" not in table.texts:
        raise UnknownNameError(f"column in {table.file}", "pose", table.names)
    angle_axes = next((axes for axes in _TURNS if any(axis in table.names for axis in axes)), ())
    for name in table.names:
        if name not in ("cycle", *_POSITION, *angle_axes):
            hint = "; a, b, c and rx, ry, rz exclude each other" if angle_axes and name in sum(_TURNS, ()) else ""
            raise InputError(
                f"{table.file}: the column {errors.shown(name, _LONGEST)} has no meaning; columns are pose, cycle, "
                f"x, y, z and a, b, c or rx, ry, rz{hint}"
            )
    cycles = table.column("cycle", units.RATIO)
    values = np.array([table.column(axis, units.LENGTH) for axis in _POSITION]).T
    if angle_axes:
        angles = np.array([table.column(axis, units.ANGLE) for axis in angle_axes]).T
        # lower case: about the fixed axes x, y, z in this order
        rotation = Rotation.from_euler("xyz", angles) if angle_axes == _TURNS[0] else Rotation.from_rotvec(angles)
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = rotation.as_matrix(), values
        values = poses
    rows: defaultdict[str, dict[float, int]] = defaultdict(dict)
    for row, (label, cycle) in enumerate(zip(table.texts["pose"], cycles, strict=True)):
        if label not in names:
            raise UnknownNameError(f"pose in {table.file}", label, names)
        of_pose = rows[names[label]]
        if cycle in of_pose:
            raise InputError(f"{table.file}: the pose {errors.shown(label, _LONGEST)} has the cycle {cycle:g} twice")
        of_pose[cycle] = row
    numbers_by_pose = {pose: sorted(of_pose) for pose, of_pose in rows.items()}
    first_pose, expected = next(iter(numbers_by_pose.items()))
    for pose, numbers in numbers_by_pose.items():
        if numbers != expected:
            raise InputError(
                f"{table.file}: {pose} has {len(numbers)} cycles and {first_pose} has {len(expected)}, or others: every pose "
                "needs the same cycles"
            )
    return {pose: values[[of_pose[cycle] for cycle in expected]] for pose, of_pose in rows.items()}
