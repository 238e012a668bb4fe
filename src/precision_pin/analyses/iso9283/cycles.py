"""Figures of ISO 9283:1998 of measured cycles: commanded and attained poses of one robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.iso9283.figures import angles_of, barycentre, distance_figures, pose_figures, scatter
from precision_pin.base import se3
from precision_pin.base.arguments import check_name, check_numbers, shown
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import add, warns_at_end
from precision_pin.base.errors import Finding, InputError

_NOT_A_ROTATION: Final = 1e-6
"""Largest entry of R Rᵀ - 1 of a rotation."""
_LARGEST: Final = 1e6
"""Largest coordinate, m: squares of larger ones leave no digits for errors of nanometres."""
_NEAR: Final = 0.1
"""Cosine of b below which a and c of the control are near their singularity: b within 5.7° of ±90°."""


class _Figures:
    """Numbers by name: as attributes, as entries and, by ``dict``, as a dictionary."""

    @classmethod
    def keys(cls) -> tuple[str, ...]:
        """Return the names of the figures."""
        return tuple(field.name for field in fields(cls))  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __getitem__(self, name: str) -> float:
        """Return the figure of a name.

        Raises
        ------
        UnknownNameError
            There is no such figure.
        """
        value: float = getattr(self, check_name("figure", name, self.keys()))
        return value

    def to_dict(self) -> dict[str, float]:
        """Return the figures by their names, m and rad."""
        return {name: self[name] for name in self.keys()}


@final
@dataclass(frozen=True)
class MeasuredPose(_Figures):
    """Accuracy and repeatability of one robot at one pose, m and rad, base axes.

    Attributes
    ----------
    AP
        Distance of the barycentre of the attained positions from the commanded position.
    AP_x, AP_y, AP_z
        Barycentre minus commanded position.
    AP_a, AP_b, AP_c
        Mean angles about x, y and z of the turn from the commanded to the attained orientation.
    RP
        l̄ + 3 S_l, with l the distances of the attained positions from their barycentre.
    RP_a, RP_b, RP_c
        Three standard deviations of the angles; the standard writes ±RP_a.
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


@final
@dataclass(frozen=True)
class MeasuredDistance(_Figures):
    """Accuracy and repeatability of the distance between two poses of one robot, m and rad, base axes.

    Attributes
    ----------
    AD, RD
        Mean distance of the attained positions minus the commanded distance, and three standard deviations of the distance;
        the standard writes ±RD.
    AD_x, AD_y, AD_z, RD_x, RD_y, RD_z
        The same for the distances along the axes, |x₁ - x₂|.
    AD_a, AD_b, AD_c, RD_a, RD_b, RD_c
        The same for the angular distances, |a₁ - a₂|.
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

    The angles a, b, c about the base axes x, y, z are those of R' R_cᵀ = Rot(z, c) Rot(y, b) Rot(x, a), the turn from the
    commanded orientation R_c to the attained R'. Near the commanded orientation they are the rotation about each axis,
    whatever angles the control uses. A warning, ``W_ANGLES``, says where the control's own angles are near their singularity:
    their scatter is then another.

    Parameters
    ----------
    commanded
        Pose ``(4, 4)``, or ``[p; rpy]`` ``(6,)`` in m and rad.
    attained
        Poses of n ≥ 2 cycles, ``(n, 4, 4)`` or ``(n, 6)``.

    Raises
    ------
    InputError
        Another shape, a number that is not finite, a matrix that is no pose, or fewer than two cycles.
    """
    wanted = _read_pose("the commanded pose", commanded)
    cycles = _read_cycles("the attained poses", attained)
    _warn_near_singularity(wanted)
    found = pose_figures(*_deviations(wanted, cycles))
    return MeasuredPose(
        **_named("AP", found.AP, x_y_z=found.AP_xyz, a_b_c=found.AP_abc), **_named("RP", found.RP, a_b_c=found.RP_abc)
    )


@warns_at_end
def iso9283_distance(commanded_pair: ArrayLike, attained_pair: ArrayLike) -> MeasuredDistance:
    """Return accuracy and repeatability of the distance between two poses from measured cycles, ISO 9283:1998.

    The angles of each pose are its commanded ones plus those of :func:`iso9283_of`.

    Parameters
    ----------
    commanded_pair
        The two commanded poses, each ``(4, 4)`` or ``(6,)`` as in :func:`iso9283_of`.
    attained_pair
        The attained poses at each, ``(n, 4, 4)`` or ``(n, 6)``; row j of both is cycle j.

    Raises
    ------
    InputError
        As in :func:`iso9283_of`, other than two poses, or different numbers of cycles.
    """
    names = ("first", "second")
    wanted = [
        _read_pose(f"the {name} commanded pose", one)
        for name, one in zip(names, _two("the commanded poses", commanded_pair), strict=True)
    ]
    cycles = [
        _read_cycles(f"the attained poses at the {name}", one)
        for name, one in zip(names, _two("the attained poses", attained_pair), strict=True)
    ]
    if len({poses.shape[-1] for poses in cycles}) > 1:
        counts = " and ".join(str(poses.shape[-1]) for poses in cycles)
        raise InputError(f"{counts} cycles at the two poses; a distance needs both poses in every cycle")
    for pose in wanted:
        _warn_near_singularity(pose)
    found = distance_figures(wanted[0][:3, 3] - wanted[1][:3, 3], *(poses[:3, 3].T for poses in cycles))
    commanded_angles = angles_of(wanted[0][:3, :3]) - angles_of(wanted[1][:3, :3])
    turned = [_deviations(one, poses)[1] for one, poses in zip(wanted, cycles, strict=True)]
    angles = np.abs(commanded_angles + turned[0] - turned[1])
    change = barycentre(angles) - np.abs(commanded_angles)
    return MeasuredDistance(
        **_named("AD", found.AD, x_y_z=found.AD_xyz, a_b_c=change),
        **_named("RD", found.RD, x_y_z=found.RD_xyz, a_b_c=scatter(angles)),
    )


def _named(figure: str, value: Array, **vectors: Array) -> dict[str, float]:
    """Return a figure and its parts by name: ``AP``, and of ``a_b_c`` ``AP_a``, ``AP_b``, ``AP_c``."""
    parts = {
        f"{figure}_{axis}": float(part)
        for axes, vector in vectors.items()
        for axis, part in zip(axes.split("_"), vector, strict=True)
    }
    return {figure: float(value), **parts}


def _deviations(wanted: Array, cycles: Array) -> tuple[Array, Array]:
    """Return attained minus commanded positions and the angles between the orientations, ``(n, 3)`` each."""
    turns = np.einsum("ijn,kj->ikn", cycles[:3, :3], wanted[:3, :3])
    return (cycles[:3, 3] - wanted[:3, 3, None]).T, angles_of(turns).T


def _warn_near_singularity(wanted: Array) -> None:
    b = float(angles_of(wanted[:3, :3])[1])
    if math.cos(b) < _NEAR:
        message = (
            f"the commanded orientation has b = {math.degrees(b):.4g} deg, near the singularity of a, b, c at 90 deg: "
            "the scatter of a and c that a control shows there is larger than that about the axes, which is given here"
        )
        add([Finding("warning", "W_ANGLES", message)])


def _two(what: str, pair: object) -> tuple[object, object]:
    if isinstance(pair, list | tuple | np.ndarray) and len(pair) == 2:
        return pair[0], pair[1]
    raise InputError(f"{what} must be two, in a list or an array, got {shown(pair)}")


def _read_pose(what: str, value: object) -> Array:
    """Return a pose ``(4, 4)``."""
    numbers = _read_numbers(what, value, "a pose (4, 4), or position and rpy (6,), in m and rad")
    if numbers.shape == (6,):
        return se3.pose(se3.rpy_rotation(numbers[3:]), numbers[:3])
    if numbers.shape != (4, 4):
        raise InputError(
            f"{what} must be a pose (4, 4), or position and rpy (6,), got an array of shape {numbers.shape}"
        )
    _check_rigid(what, numbers[..., None])
    return numbers


def _read_cycles(what: str, values: object) -> Array:
    """Return the poses of n cycles, ``(4, 4, n)``."""
    numbers = _read_numbers(what, values, "poses (n, 4, 4), or positions and rpy (n, 6), in m and rad")
    if numbers.shape[1:] not in ((4, 4), (6,)):
        raise InputError(
            f"{what} must be poses (n, 4, 4), or positions and rpy (n, 6), got an array of shape {numbers.shape}"
        )
    if len(numbers) < 2:
        raise InputError(f"{what} must be of at least 2 cycles, got {len(numbers)}; the standard has 30")
    if numbers.ndim == 3:
        poses = np.moveaxis(numbers, 0, -1)
        _check_rigid(what, poses)
        return poses
    roll, pitch, yaw = numbers[:, 3:].T
    turns = (
        se3.rotation_about(axis, angle) for axis, angle in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll))
    )
    first, second, third = turns
    return se3.pose(np.einsum("ijn,jkn,kln->iln", first, second, third), numbers[:, :3].T)


def _read_numbers(what: str, values: object, needs: str) -> Array:
    numbers = check_numbers(what, values, needs=needs)
    if numbers.size and np.abs(numbers).max() > _LARGEST:
        raise InputError(f"{what} must hold no number beyond {_LARGEST:,.0f} (m, rad), got {np.abs(numbers).max():g}")
    return numbers


def _check_rigid(what: str, poses: Array) -> None:
    """Refuse matrices ``(4, 4, n)`` that are no poses."""
    rotation = poses[:3, :3]
    gaps = np.abs(np.einsum("ijn,kjn->ikn", rotation, rotation) - np.eye(3)[..., None]).max(axis=(0, 1))
    wrong = (gaps > _NOT_A_ROTATION) | (np.linalg.det(np.moveaxis(rotation, -1, 0)) < 0)
    wrong |= np.abs(poses[3] - np.array([0, 0, 0, 1.0])[:, None]).max(axis=0) > _NOT_A_ROTATION
    if wrong.any():
        which = f": row {int(np.flatnonzero(wrong)[0])}" if len(wrong) > 1 else ""
        raise InputError(f"{what} must be rotation, position in m and a last row 0 0 0 1{which} is not")
