"""Places and directions in a sheet, and geometry and statics at the seat of a joint, the place of its bearings.

The seat of a joint is its URDF origin frame before its motion, on its parent link in the file, even if the base is
beyond the joint. Vectors at the seat are in the *seat's axes*, rotated such that z is the joint's axis in the file, and
describe the child link relative to the parent link; so they do not depend on the choice of the base.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.draws.laws import Uniform
from precision_pin.robot.chain import Chain, Posture
from precision_pin.terms import (
    Array,
    Dependence,
    Draw,
    Factors,
    InputError,
    LabelledSpace,
    Place,
    Scope,
    Source,
    Term,
    units,
)

PadsOn = Literal["child", "parent"]
"""The link to which the pads of a prismatic joint are fixed."""

_APART: Final = 1e-12
"""Relative difference below which two heights count as equal, to rounding: their difference is a divisor."""


def seat_of(chain: Chain, joint: int) -> tuple[Place, Array]:
    """Return the place of a 0-based joint's seat, and the matrix ``(6, 6)`` to its axes.

    It maps ``[d; δ]`` of the child link relative to the parent link, in the seat's axes, to the place's displacement.
    """
    axes = block_diagonal(chain.axis_alignment(joint))
    if chain.reversed_joints[joint]:
        # the parent link is beyond the joint, hence displaced
        return Place.start(joint + 1, f"seat of {chain.joint_names[joint]}"), -axes
    return chain.seat(joint), axes


def seat_wrench(posture: Posture, joint: int) -> dict[Factors, Array]:
    """Return the wrench ``[F; M]`` (N, N·m) on the child link of a 0-based joint by all loads, by its factors.

    In the seat's axes and about its origin, on the loaded arm. If the base is beyond the joint, it is the reaction to the
    loads beyond.
    """
    beyond = [load for load in posture.loads if load.link > joint]
    backwards = posture.chain.reversed_joints[joint]
    seat = posture.loaded_link_poses[joint + 1] if backwards else posture.loaded_ends[joint]
    wrenches = posture.wrench_on(beyond, seat[:3, 3])
    alignment = posture.chain.axis_alignment(joint) * (-1.0 if backwards else 1.0)
    return {factors: in_axes(seat[:3, :3], alignment, wrench) for factors, wrench in wrenches.items()}


def in_axes(rotation: Array, axes: Array, wrench: Array) -> Array:
    """Return a wrench ``(6[, P])``, base axes, in axes ``(3, 3)`` of a frame rotated by ``(3, 3[, P])``."""
    if rotation.ndim == 2:
        return block_diagonal((rotation @ axes).T) @ wrench
    rotations = np.einsum("ijp,jk->kip", rotation, axes)
    return np.concatenate([se3.turn(rotations, wrench[:3]), se3.turn(rotations, wrench[3:])])


def approach_name(joint: str) -> str:
    """Return the name of :func:`approach_draw`."""
    return f"approach[{joint}]"


def approach_draw(joint: str) -> Draw:
    """Return the draw, shared by the sources of a joint, of how it arrived at a visit: -1 to 1, its direction if known."""
    return Draw(approach_name(joint), Uniform(1.0), Scope.VISIT, (units.RATIO,))


def approach_of(posture: Posture, joint: str, space: LabelledSpace) -> Iterator[tuple[Array, Factors]]:
    """Yield the direction in which a joint moved last as numbers ``([P])`` times parameters, to be added.

    Where it is known, the number is 1 or -1; where not, 1 with the parameter of :func:`approach_draw`.
    """
    direction = np.asarray(posture.direction_of(posture.chain.joint_index(joint)), dtype=float)
    if direction.any():
        yield direction, ()
    if not direction.all():
        yield np.where(direction == 0, 1.0, 0.0), (space.space.parameter(approach_name(joint)),)


def height_above_seat(posture: Posture, joint: int, height: float, pads_on: PadsOn) -> float:
    """Return the height (m) above the seat's origin of a bearing at ``height`` on the axis of a 0-based joint.

    With the pads on the child link, the bearing travels as the joint slides.
    """
    return height + (float(posture.q[joint]) if travels(posture.chain, joint, pads_on) else 0.0)


def travels(chain: Chain, joint: int, pads_on: PadsOn) -> bool:
    """Return whether the pads of a 0-based joint travel along the axis of its seat as it slides."""
    return bool(chain.prismatic[joint]) and pads_on == "child"


def shift_of_point(height: float, other: float) -> Array:
    """Return the seat's displacement ``[d; δ]`` per shift ``(x, y)`` of the axis at a height, ``(6, 2)``.

    The axis is fixed at the ``other`` height: the other point of eqs 18 and 19. By virtual work the transpose gives the
    radial force on a bearing at ``height``, of two bearings, from a wrench on the seat. Raises InputError if the heights
    are equal to rounding.
    """
    if math.isclose(height, other, rel_tol=_APART, abs_tol=0.0):
        raise InputError(f"the span is too small: both bearings are at {height:g} m along the axis")
    share, slope = other / (other - height), 1 / (height - other)
    return np.array([[share, 0], [0, share], [0, 0], [0, -slope], [slope, 0], [0, 0]])


def wrench_at(height: float) -> Array:
    """Return the matrix ``(6, 6)`` from a wrench about the seat's origin to one about the axis point at a height.

    By virtual work the transpose gives the seat's displacement from the displacement of a body clamped at this point.
    """
    shifted = np.eye(6)
    shifted[3, 1], shifted[4, 0] = height, -height
    return shifted


def block_diagonal(rotation: Array) -> Array:
    """Return the matrix ``(6, 6)`` that rotates both halves of a vector by ``(3, 3)``."""
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = rotation
    return result


_SIX: Final = dict(enumerate(("x", "y", "z", "rx", "ry", "rz")))
"""Settings of a displacement, by the row of ``[d; δ]``."""


def deviation_terms(
    source: Source, place: Place, space: LabelledSpace, fields: Mapping[int, str] = _SIX
) -> Iterator[Term]:
    """Yield a term for each non-zero one of six settings: the place's shift and rotation vector, in its own axes."""
    for row, field in fields.items():
        value = space.value(field, getattr(source, field))
        if value != 0.0:
            yield Term.of(place, np.eye(6)[row], value)


@dataclass(frozen=True, kw_only=True)
class AtPlace(Source):
    """Base class of a source at any place: a joint's seat, the end of a chain link, or the frame of a URDF link.

    Raises:
        InputError: Not exactly one of joint, link and frame.
    """

    depends_on: ClassVar[Dependence] = "chain"
    is_dimensional: ClassVar[bool] = True

    joint: str | None = None
    link: str | None = None
    frame: str | None = None

    def __post_init__(self) -> None:
        if sum(name is not None for name in (self.joint, self.link, self.frame)) != 1:
            raise InputError(f"{self.kind()} needs one of joint:, link: and frame:")

    def place(self, chain: Chain) -> Place:
        """Return the place.

        Raises:
            UnknownNameError: No such joint or link.
            InputError: The frame is not on the path to the tip.
        """
        if self.joint is not None:
            return chain.seat(chain.joint_index(self.joint))
        if self.link is not None:
            return chain.end(chain.link_frame(self.link).link)
        return chain.frame_place(self.frame or "")


_DIRECTION: Final = re.compile(r"(-?)\s*(x|y|z|axis)\s+of\s+(.+)", re.DOTALL)
_AXES: Final = {"x": 0, "y": 1, "z": 2}
"""Text of a direction (sign, letter, name of a joint or the base), and column of a letter."""
_PARALLEL: Final = 1e-9
"""Sine of the angle below which a direction counts as parallel to an axis: above the rounding of angles of a URDF."""


def direction_of(text: str, posture: Posture) -> NDArray[np.float64]:
    """Return the unit vector ``(3[, P])``, base axes, of ``[-]x|y|z|axis of JOINT`` or ``[-]x|y|z of BASE``.

    ``x``, ``y``, ``z`` are the axes of the joint's URDF frame after its motion (its child link's in the file), or of
    the chain's base link; ``axis`` is the joint's axis in the file. The directions in space do not depend on the choice
    of the base.

    Raises:
        InputError: The text has another form.
        UnknownNameError: No such joint on the chain.
    """
    sign, letter, joint = _parse(text, posture.chain)
    if joint is None:
        along = np.eye(3)[_AXES[letter]]
        return np.asarray(-along if sign < 0 else along, dtype=float)
    chain = posture.chain
    is_reversed = bool(chain.reversed_joints[joint])
    if letter == "axis":
        direction = -posture.joint_axes[joint] if is_reversed else posture.joint_axes[joint]
    else:
        # the chain may pass a joint from child to parent: the child link is then before it
        before = se3.compose(posture.link_poses[joint], chain.placements[joint])
        frame = before if is_reversed else posture.joint_poses[joint]
        direction = frame[:3, _AXES[letter]]
    return np.asarray(-direction if sign < 0 else direction, dtype=float)


def is_fixed(text: str, chain: Chain, link: int) -> bool:
    """Return whether a direction, as for :func:`direction_of`, is fixed in a chain link at all joint values."""
    _, letter, joint = _parse(text, chain)
    if joint is None:
        carrier, direction = 0, np.eye(3)[_AXES[letter]]
    elif letter == "axis":
        carrier, direction = joint + 1, chain.axes[joint]
    elif chain.reversed_joints[joint]:
        carrier, direction = joint, chain.placements[joint][:3, _AXES[letter]]
    else:
        carrier, direction = joint + 1, np.eye(3)[_AXES[letter]]
    while carrier != link:
        # forward through the joint after the carrier, or back through the one before it
        is_forward = carrier < link
        crossed = carrier if is_forward else carrier - 1
        rotation = chain.placements[crossed][:3, :3]
        direction = rotation.T @ direction if is_forward else direction
        if not chain.prismatic[crossed] and np.linalg.norm(np.cross(chain.axes[crossed], direction)) > _PARALLEL:
            return False
        direction = direction if is_forward else rotation @ direction
        carrier += 1 if is_forward else -1
    return True


def _parse(text: str, chain: Chain) -> tuple[float, str, int | None]:
    """Return a direction's sign, letter or ``axis``, and joint, None for the base."""
    match = _DIRECTION.fullmatch(text.strip())
    if match is None:
        raise InputError(f"direction {text!r} is not understood; allowed: link, [-]x|y|z of JOINT, [-]axis of JOINT")
    name, sign = match[3].strip(), -1.0 if match[1] else 1.0
    if name == chain.base and name not in chain.joint_names and match[2] != "axis":
        return sign, match[2], None
    return sign, match[2], chain.joint_index(name)
