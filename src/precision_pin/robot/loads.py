"""The weights on a chain, its state under load, and the wrenches of weights by the parameters that multiply them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_numbers
from precision_pin.base.arrays import Array, Fixed
from precision_pin.draws.expressions import Expression
from precision_pin.robot.places import LinkFrame
from precision_pin.robot.urdf import Robot

Factors = tuple[Expression, ...]
"""Parameters whose product multiplies a number; none for a constant."""


Weight = tuple[Iterable[Any], list[tuple[Factors, Any, Any, Any, Any]]]
"""A load in the base: origin of its frame; for each moment, factors, mass and first moment in base axes.

The numbers are Python floats, faster than arrays for sums of three, or arrays over P postures.
"""
_NOTHING: Final = (0.0, 0.0, 0.0, 0.0)


@final
@dataclass(frozen=True, eq=False)
class Load:
    """A weight on the chain.

    Carried by chain link ``link``; ``frame`` ``(4, 4)``, that of its moments, ``attachment`` ``(3,)``, where it acts,
    and ``stretch`` ``(2, 3)`` are in the link's axes. ``along``: the weight of the link's own body, spread evenly along
    it. ``moments``: mass (kg) and first moment (kg·m) ``(4,)`` with the parameters that multiply them, to be added.
    ``stretch``: ends of its part of the link; ``None``: the whole link for a weight ``along`` it, else a point.
    """

    link: int
    frame: Array
    attachment: Array
    along: bool
    moments: tuple[tuple[Array, Factors], ...]
    stretch: Array | None = None

    def __post_init__(self) -> None:
        for name, shape in (("frame", (4, 4)), ("attachment", (3,)), ("stretch", (2, 3))):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, check_numbers(f"{name} of a load", getattr(self, name), shape))
        moments = tuple(
            (check_numbers("mass and first moment of a load", values, (4,)), factors)
            for values, factors in self.moments
        )
        object.__setattr__(self, "moments", moments)


@final
@dataclass(frozen=True, eq=False)
class Deflection(Fixed):
    """A chain under load: links and their far ends, ``(n+1, 4, 4)``, base.

    ``bending`` is the displacement of each far end by the loads, ``[d; δ]`` in the end's axes, ``(n+1, 6)``.
    """

    links: Array
    ends: Array
    bending: Array


def own_loads(robot: Robot, frames: Mapping[str, LinkFrame]) -> tuple[Load, ...]:
    """Return the weights of the URDF's links."""
    loads = []
    for link in robot.links:
        if link.inertial is None or link.inertial.mass == 0:
            continue
        where = frames[link.name]
        moments = link.inertial.mass * np.array([1.0, *link.inertial.com])
        entry = where.entry(link.inertial.com)
        loads.append(Load(where.link, where.frame, entry, where.is_own, ((moments, ()),), where.stretch))
    return tuple(loads)


def wrench_basis(frame: Array, gravity: Array, point: ArrayLike) -> Array:
    """Return force and moment ``(6, 4)`` about a point per unit of a load's mass and first moments, base axes.

    ``F = m g``, ``M = (R s + m (o - point)) × g`` with s the first moment in the load's frame (rotation R, origin o), g
    gravity.
    """
    basis = np.zeros((6, 4))
    basis[:3, 0] = gravity
    basis[3:, 0] = np.cross(frame[:3, 3] - np.asarray(point, dtype=float), gravity)
    basis[3:, 1:] = np.cross(frame[:3, :3].T, gravity).T
    return basis


def weigh(loads: Sequence[Load], link_poses: Array) -> dict[Load, Weight]:
    """Return loads in the base, from the axes of every chain link in the base, ``(n+1, 4, 4[, P])``."""
    if not loads:
        return {}
    if link_poses.ndim == 4:
        return {load: _weigh_at_many(load, link_poses[load.link]) for load in loads}
    frames = link_poses[[load.link for load in loads]] @ np.array([load.frame for load in loads])
    owners = [k for k, load in enumerate(loads) for _ in load.moments]
    moments = np.array([moments for load in loads for moments, _ in load.moments]).reshape(-1, 4)
    turned = (frames[owners, :3, :3] @ moments[:, 1:, None])[:, :, 0]
    rows = iter(np.column_stack([moments[:, 0], turned]).tolist())
    return {
        load: (origin, [(factors, *next(rows)) for _, factors in load.moments])
        for load, origin in zip(loads, frames[:, :3, 3].tolist(), strict=True)
    }


def _weigh_at_many(load: Load, link_poses: Array) -> Weight:
    """Return a load in the base at P postures with its link's axes ``(4, 4, P)``."""
    frame = se3.compose(link_poses, load.frame)
    pieces = []
    for moments, factors in load.moments:
        x, y, z = se3.turn(frame[:3, :3], moments[1:])
        pieces.append((factors, moments[0], x, y, z))
    return frame[:3, 3], pieces


def wrench_on(
    weights: Iterable[Weight], gravity: Array, tilts: Sequence[tuple[Array, Factors]], point: ArrayLike
) -> dict[Factors, Array]:
    """Return the wrench ``(6[, P])`` of weights about a point ``(3[, P])``, base axes, by the parameters.

    ``tilts`` are contributions of sources to gravity: vectors ``(3,)``, base axes, m/s², with their parameters.
    """
    where = np.asarray(point, dtype=float)
    x, y, z = where.tolist() if where.ndim == 1 else where
    # mass and first moment about the point, for each part of gravity and each set of factors
    sums: dict[tuple[int, Factors], tuple[Any, Any, Any, Any]] = {}
    for (o_x, o_y, o_z), pieces in weights:
        for part in range(1 + len(tilts)):
            for factors, mass, s_x, s_y, s_z in pieces:
                m, h_x, h_y, h_z = sums.get((part, factors), _NOTHING)
                sums[part, factors] = (
                    m + mass,
                    h_x + (s_x + mass * (o_x - x)),
                    h_y + (s_y + mass * (o_y - y)),
                    h_z + (s_z + mass * (o_z - z)),
                )
    pulls = [(gravity.tolist(), ()), *((tilt.tolist(), factors) for tilt, factors in tilts)]
    total: dict[Factors, Array] = {}
    for (part, factors), (m, h_x, h_y, h_z) in sums.items():
        (g_x, g_y, g_z), tilting = pulls[part]
        moment = (h_y * g_z - h_z * g_y, h_z * g_x - h_x * g_z, h_x * g_y - h_y * g_x)
        numbers = (m * g_x, m * g_y, m * g_z, *moment)
        wrench = np.array(numbers if where.ndim == 1 else np.broadcast_arrays(*numbers))
        key = (*factors, *tilting)
        total[key] = total[key] + wrench if key in total else wrench
    return total


def torque_on(axis: Array, slides: bool, wrenches: Mapping[Factors, Array]) -> dict[Factors, Any]:
    """Return torque or force of wrenches about a joint's origin on its axis ``(3[, P])``, by their parameters."""
    rows = slice(0, 3) if slides else slice(3, 6)
    if axis.ndim == 2:
        return {factors: np.einsum("ip,ip->p", axis, wrench[rows]) for factors, wrench in wrenches.items()}
    return {factors: float(axis @ wrench[rows]) for factors, wrench in wrenches.items()}
