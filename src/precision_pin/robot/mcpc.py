"""MCPC parameters of a serial arm: extraction, error Jacobian, and conversion to and from displacements.

MCPC is the modified complete and parametrically continuous model of Zhuang, Wang and Roth (Robotics and
Computer-Integrated Manufacturing 10(4), 1993) in the form of Wei, Jia and Chen (MATEC Web of Conferences
35, 02013, 2015, DOI 10.1051/matecconf/20153502013), *the paper* below. Its frames exist only in this
package; everything else uses URDF frames.

Conventions
-----------
- SI units. Displacements are ``[d; δ]``, position (m) before rotation vector (rad).
- ``T = B·T_0·T_1⋯T_n`` with ``T_i = Q_i·V_i``, ``Q_0 = I``, ``B = Rot(z, base_turn)``.
- ``Q_i = Rot(z, θ_i + θ_off,i)`` (revolute), ``Q_i = Rot(z, θ_off,i)·Trans(0, 0, d_i)`` (prismatic).
- ``V_i = Rot(x, α_i)·Rot(y, β_i)·Trans(x_i, y_i, 0)`` for i < n (eq 1);
  ``V_n = Rot(x, α_n)·Rot(y, β_n)·Rot(z, γ_n)·Trans(x_n, y_n, z_n)`` (eq 2).

Erratum. The paper writes ``ΔΩ_k = J_k⁻¹ D_k`` (eqs 20, 22). The matrix of one link is 6x5 and has no inverse, at
α = ±90° it even loses rank, and a pseudo-inverse gives results that depend on the unit of length. Four parameters cannot
represent six numbers: the remainder, a motion along and about the next joint's axis, commutes with that joint and is
passed to the next link.

Sign choices: α in (-π, π], β in [-π/2, π/2] (0 after every joint of an extracted model), joint offset in
(-π/2, π/2], γ in (-π, π].
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_choice, check_instance, check_number, check_numbers, check_whole, shown
from precision_pin.base.arrays import Array, read_only
from precision_pin.base.errors import InputError
from precision_pin.render.columns import Column, notebook_table, text_lines
from precision_pin.render.html import rendered
from precision_pin.render.tables import plain

X_AXIS = (1.0, 0.0, 0.0)
Y_AXIS = (0.0, 1.0, 0.0)
Z_AXIS = (0.0, 0.0, 1.0)

RIGID = 1e-9
"""Largest deviation of a given displacement from a rigid motion."""
PARALLEL = 1e-9
"""Angle (rad) below which axes count as parallel when a joint offset is chosen."""
COINCIDENT = 1e-9
"""Distance (m) below which parallel axes count as coincident when a joint offset is chosen."""
NEARLY_SINGULAR = 0.1
"""Smallest |cos β_0| at which the base frame is not turned."""
TIE = 1e-12
"""Offsets this close (rad) to -π/2 become +π/2, so that rounding does not change their sign."""
SAME_CHAIN = 1e-9
"""Largest difference (m, rad) between a chain's placements and those of its MCPC parameters."""


@dataclass(frozen=True)
class McpcRow:
    """One row of the parameter table, in the form of the paper's Table 1.

    Row ``link`` i, 0..n, describes ``T_i``; ``joint`` precedes this link, None for link 0. ``turn`` is the
    constant turn about z before α (rad): the base turn for link 0, θ_off,i after joint i; ``shift`` that along z (m),
    zero unless a prismatic joint has an error. α, β in rad, x, y in m; γ (rad) and z (m) of the last link, else None.
    """

    link: int
    joint: str | None
    prismatic: bool
    turn: float
    shift: float
    alpha: float
    beta: float
    gamma: float | None
    x: float
    y: float
    z: float | None

    @property
    def place(self) -> str:
        """The joint in words."""
        return "base" if self.joint is None else f"{self.joint} (slides)" if self.prismatic else self.joint


_SYMBOLS: Final = {"turn": "offset", "alpha": "α", "beta": "β", "gamma": "γ", "x": "x", "y": "y", "z": "z"}


def _parameter_columns(name: str) -> tuple[Column, Column]:
    """Return the columns of an angle or a length; the notebook has fewer decimals."""
    scale, unit = (1e3, "mm") if name in "xyz" else (math.degrees(1), "°")
    heading = f"{_SYMBOLS[name]} [{unit}]"

    def written(decimals: int) -> Callable[[McpcRow], str]:
        return lambda row: "" if (value := getattr(row, name)) is None else plain(scale * value, decimals)

    return Column(written(9), text=f"{_SYMBOLS[name]} {unit}", report=heading), Column(written(6), notebook=heading)


COLUMNS: Final = (
    Column("link", text="i", notebook="i", report="i"),
    Column("place", text="joint", notebook="joint", report="joint", is_words=True),
    *(column for name in _SYMBOLS for column in _parameter_columns(name)),
)
"""Columns of the table of parameters."""


@dataclass(frozen=True, eq=False)
class Mcpc:
    """The MCPC parameters of a chain of n joints.

    Made by `from_chain`, or directly from numbers. Arrays are copied and made read-only.

    Args:
        joint_names: The n joints in chain order.
        prismatic: ``(n,)`` True for each prismatic joint.
        alpha, beta, x, y: ``(n+1,)`` parameters of links 0..n (rad, rad, m, m).
        gamma, z: The two further parameters of link n (rad, m).
        joint_offset: ``(n,)`` θ_off, the constant turn of each joint about its z axis (rad), prismatic joints too.
        joint_shift: ``(n,)`` constant shift along a prismatic joint's axis (m), zero as extracted.
        base_turn: Turn of frame 0 about the z axis of the base link (rad): 0 or π/2 as extracted.
        frame_in_link: ``(n+1, 4, 4)`` constant pose of MCPC frame i *after* ``Q_i``, in the axes of chain link i: joint
            i's URDF frame after it turned, the base link for i = 0 (there it is the base turn).

    Raises:
        InputError: A parameter has the wrong shape or is not finite.
    """

    joint_names: tuple[str, ...]
    prismatic: NDArray[np.bool_]
    alpha: Array
    beta: Array
    x: Array
    y: Array
    gamma: float
    z: float
    joint_offset: Array
    joint_shift: Array
    base_turn: float
    frame_in_link: Array

    def __post_init__(self) -> None:
        joints = len(self.joint_names)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("alpha", "beta", "x", "y"), (joints + 1,))
        shapes |= {"joint_offset": (joints,), "joint_shift": (joints,), "frame_in_link": (joints + 1, 4, 4)}
        shapes |= {"gamma": (), "z": (), "base_turn": ()}
        for name, shape in shapes.items():
            value = finite_array(f"mcpc {name}", getattr(self, name), shape)
            object.__setattr__(self, name, value if shape else float(value))
        prismatic = np.array(self.prismatic, dtype=bool)
        if prismatic.shape != (joints,):
            raise InputError(f"mcpc prismatic: shape {prismatic.shape} is not ({joints},)")
        object.__setattr__(self, "prismatic", read_only(prismatic))

    @property
    def joint_count(self) -> int:
        """Number n of joints."""
        return len(self.joint_names)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The 5n+6 names in the order of J_E's columns (eq 16).

        ``theta_1..theta_n`` (``d_i`` where joint i is prismatic), ``alpha_0..alpha_n``, ``beta_0..beta_n``,
        ``gamma_n``, ``x_0..x_n``, ``y_0..y_n``, ``z_n``.
        """
        n = self.joint_count
        alpha, beta, x, y = ([f"{name}_{i}" for i in range(n + 1)] for name in ("alpha", "beta", "x", "y"))
        joints = (f"{'d' if is_prismatic else 'theta'}_{i}" for i, is_prismatic in enumerate(self.prismatic, 1))
        return (*joints, *alpha, *beta, f"gamma_{n}", *x, *y, f"z_{n}")

    def parameter_indices(self, link: int) -> tuple[int, ...]:
        """Return the positions of the columns of `link_matrix` (same order) among the 5n+6 parameters."""
        n = self.joint_count
        self._check_link(link)
        positions = (link - 1, n + link, 2 * n + 1 + link, 3 * n + 2, 3 * n + 3 + link, 4 * n + 4 + link, 5 * n + 5)
        left_out = {-1} if link == n else {-1, 3 * n + 2, 5 * n + 5}
        return tuple(position for position in positions if position not in left_out)

    @property
    def table(self) -> tuple[McpcRow, ...]:
        """The n+1 rows of the parameter table, in the form of the paper's Table 1 (SI units)."""
        n = self.joint_count
        return tuple(
            McpcRow(
                link=i,
                joint=self.joint_names[i - 1] if i else None,
                prismatic=bool(self.prismatic[i - 1]) if i else False,
                turn=float(self.joint_offset[i - 1]) if i else self.base_turn,
                shift=float(self.joint_shift[i - 1]) if i else 0.0,
                alpha=float(self.alpha[i]),
                beta=float(self.beta[i]),
                gamma=self.gamma if i == n else None,
                x=float(self.x[i]),
                y=float(self.y[i]),
                z=self.z if i == n else None,
            )
            for i in range(n + 1)
        )

    def link_pose(self, link: int) -> Array:
        """Return ``V_i`` ``(4, 4)``, the constant part of ``T_i`` (eqs 1, 2)."""
        self._check_link(link)
        gamma, z = (self.gamma, self.z) if link == self.joint_count else (0.0, 0.0)
        rotation = tilt(self.alpha[link], self.beta[link]) @ se3.rotation_about(Z_AXIS, gamma)
        return se3.pose(rotation, rotation @ (self.x[link], self.y[link], z))

    def joint_pose(self, link: int, value: float = 0.0) -> Array:
        """Return ``Q_i`` ``(4, 4)`` at a joint value (rad or m); the identity for link 0."""
        self._check_link(link)
        value = check_number("the joint value", value)
        if link == 0:
            return np.eye(4)
        angle, shift = self.joint_offset[link - 1], self.joint_shift[link - 1]
        if self.prismatic[link - 1]:
            return axial_motion(angle, shift + value)
        return axial_motion(angle + value, shift)

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Return the tip's pose ``(4, 4)`` in the base link at joint values ``(n,)`` (eq 3)."""
        values = self._joint_values(q)
        return se3.compose(se3.pose(se3.rotation_about(Z_AXIS, self.base_turn), np.zeros(3)), *self._links(values))

    def link_matrix(self, link: int) -> Array:
        """Return the columns of eq 8 (link i < n) or eq 11 (link n), ``(6, m)``.

        They map parameter errors to the displacement ``[d; δ]`` of frame i+1 in its own axes. Order: θ_i (d_i for a
        prismatic joint; absent for link 0), α_i, β_i, [γ_n,] x_i, y_i[, z_n]. The product of their exponentials
        ``Exp(k_j Δ_j)`` in this order reproduces the perturbed ``T_i`` at any size of Δ.
        """
        self._check_link(link)
        is_last = link == self.joint_count
        gamma, z = (self.gamma, self.z) if is_last else (0.0, 0.0)
        alpha, beta = self.alpha[link], self.beta[link]
        (sin_alpha, cos_alpha), (sin_beta, cos_beta) = ((math.sin(angle), math.cos(angle)) for angle in (alpha, beta))
        rotation = se3.rotation_about(Z_AXIS, gamma).T
        k6 = rotation @ (-cos_alpha * sin_beta, sin_alpha, cos_alpha * cos_beta)
        k7 = rotation @ (cos_beta, 0.0, sin_beta)
        k8 = rotation @ Y_AXIS
        point = np.array([self.x[link], self.y[link], z])
        x_axis, y_axis, z_axis = np.eye(3)
        columns = [_turn(k7, point), _turn(k8, point), _shift(x_axis), _shift(y_axis)]
        if link:
            columns.insert(0, _shift(k6) if self.prismatic[link - 1] else _turn(k6, point))
        if is_last:
            columns[-2:] = [_turn(z_axis, point), *columns[-2:], _shift(z_axis)]
        return np.column_stack(columns)

    def propagation(self, q: ArrayLike) -> Array:
        """Return ``Ad(U_{i+1}⁻¹)`` for i = 0..n, ``(n+1, 6, 6)``: the matrices of eq 15.

        Each maps the displacement of frame i+1, in its own axes, to the tip's in tip axes: ``D_e = Σ Ad(U_{i+1}⁻¹)
        D_i``.
        """
        poses = self._links(self._joint_values(q))
        to_tip = itertools.accumulate(reversed(poses[1:]), lambda after, pose: pose @ after, initial=np.eye(4))
        return np.array([se3.adjoint(se3.inverse(pose)) for pose in to_tip][::-1])

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J_E ``(6, 5n+6)``: parameter errors to the tip's ``[d; δ]`` in tip axes (eq 16).

        Columns as in `parameter_names`. There is no θ_0. A column of a prismatic joint is d_i.
        """
        result = np.zeros((6, 5 * self.joint_count + 6))
        for link, matrix in enumerate(self.propagation(q)):
            result[:, self.parameter_indices(link)] = matrix @ self.link_matrix(link)
        return result

    def jacobian_base(self, q: ArrayLike) -> Array:
        """Return J_I ``(6, 5n+6)``: parameter errors to the tip's ``[d; δ]`` in base-link axes (eq 17).

        ``J_I = T_s J_E`` with ``T_s = blockdiag(R, R)``, R the tip's rotation (not the adjoint of T, which refers d to
        the base's origin).
        """
        rotation, in_tip = self.forward_kinematics(q)[:3, :3], self.jacobian(q)
        return np.vstack([rotation @ in_tip[:3], rotation @ in_tip[3:]])

    def perturbed(self, parameter_errors: ArrayLike) -> Mcpc:
        """Return the arm with errors ``(5n+6,)`` added to its parameters; exact at any size.

        Δθ goes to the joint offset, Δd to the joint shift. ``frame_in_link`` does not change: each link keeps its own
        axes relative to the MCPC frame at its joint (see `to_placements`).
        """
        n = self.joint_count
        errors = self.checked_errors(parameter_errors)
        joint, alpha, beta, gamma, x, y, z = np.split(
            errors, [n, 2 * n + 1, 3 * n + 2, 3 * n + 3, 4 * n + 4, 5 * n + 5]
        )
        return replace(
            self,
            alpha=self.alpha + alpha,
            beta=self.beta + beta,
            x=self.x + x,
            y=self.y + y,
            gamma=self.gamma + float(gamma[0]),
            z=self.z + float(z[0]),
            joint_offset=self.joint_offset + np.where(self.prismatic, 0.0, joint),
            joint_shift=self.joint_shift + np.where(self.prismatic, joint, 0.0),
        )

    def checked_errors(self, parameter_errors: ArrayLike) -> Array:
        """Return parameter errors as a finite ``(5n+6,)`` array, or raise InputError."""
        return finite_array("mcpc parameter errors", parameter_errors, (5 * self.joint_count + 6,))

    def __repr__(self) -> str:
        return f"<Mcpc of {self.joint_count} joints: {', '.join(map(repr, self.joint_names))}>"

    def _repr_html_(self) -> str:
        """Return the notebook view: the table in the form of the paper's Table 1, in degrees and mm."""
        return rendered(f"MCPC parameters of {self.joint_count} joints", [notebook_table(COLUMNS, self.table)])

    def _joint_values(self, q: ArrayLike) -> Array:
        return finite_array("mcpc joint values q", q, (self.joint_count,))

    def _links(self, q: Array) -> list[Array]:
        values = (0.0, *q)
        return [self.joint_pose(i, value) @ self.link_pose(i) for i, value in enumerate(values)]

    def _check_link(self, link: int) -> None:
        check_whole("the number of an mcpc link", link, 0, self.joint_count)


def finite_array(what: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return a read-only float copy of the given shape, or raise InputError naming ``what``."""
    array = check_numbers(what, value, needs=f"an array of shape {shape}")
    if array.shape != shape:
        raise InputError(f"{what}: shape {array.shape} is not {shape}")
    return array


def tilt(alpha: float, beta: float) -> Array:
    """Return ``Rot(x, α)·Rot(y, β)``, ``(3, 3)``."""
    return se3.rotation_about(X_AXIS, alpha) @ se3.rotation_about(Y_AXIS, beta)


def axial_motion(angle: float, shift: float) -> Array:
    """Return the motion along and about z, ``Rot(z, turn)·Trans(0, 0, shift)``, ``(4, 4)``."""
    return se3.pose(se3.rotation_about(Z_AXIS, angle), (0.0, 0.0, shift))


def tilt_angles(direction: Array) -> tuple[float, float]:
    """Return α in (-π, π], β in [-π/2, π/2] whose ``Rot(x, α)·Rot(y, β)`` brings z onto a direction ``(3,)``."""
    alpha = half_open(math.atan2(-direction[1], direction[2]))
    return alpha, math.atan2(direction[0], math.hypot(direction[1], direction[2])) + 0.0


def half_open(angle: float) -> float:
    """Return an angle of atan2 in (-π, π]: within rounding (1e-15) of -π it is π. Minus zero becomes zero."""
    return math.pi if angle < -math.pi + 1e-15 else angle + 0.0


def _turn(axis: Array, point: Array) -> Array:
    """Return ``[k × t; k]``: a rotation about an axis through -t, seen at the frame's origin."""
    return np.concatenate([np.cross(axis, point), axis])


def _shift(direction: Array) -> Array:
    return np.concatenate([direction, np.zeros(3)])


def parameter_errors(mcpc: Mcpc, displacements: ArrayLike, chart: Literal["complete", "offsets"] = "complete") -> Array:
    """Return the parameter errors ΔΩ ``(5n+6,)`` that move the tip as the given displacements do.

    ``mcpc.perturbed(ΔΩ)`` has the tip of ``Q_0 V_0 E_0 Q_1 V_1 E_1 ⋯ Q_n V_n E_n`` at every q, exactly at any size. For
    each displaced link (α, β, x, y) are solved. The remainder ``Trans(z)·Rot(z, γ)``, along and about the next joint's
    axis, is passed through that joint to the next link; the last link absorbs the rest in its six parameters. Replaces
    eqs 20 and 22.

    Args:
        mcpc: The nominal arm.
        displacements: ``E_0 … E_n``, E_i inserted after ``V_i`` (in the axes of frame i+1; E_n: of the tip): poses
            ``(n+1, 4, 4)`` or ``[d; δ]`` ``(n+1, 6)`` in m and rad.
        chart: ``"complete"``: 4n+6 parameters, every Δθ and Δd zero. ``"offsets"``: the remainder about the next axis
            becomes Δθ_{i+1}, or along it Δd_{i+1} if that joint is prismatic; the other of the two is passed on.

    Returns:
        ΔΩ in the order of `Mcpc.parameter_names`; angles in [-π, π].

    Raises:
        InputError: Wrong shape, a number that is not finite, a pose that is not rigid, an unknown chart.
    """
    check_instance("mcpc", mcpc, Mcpc, "as mcpc.from_chain returns it")
    check_choice("mcpc chart", chart, ("complete", "offsets"))
    n = mcpc.joint_count
    result = np.zeros(5 * n + 6)
    carried = np.eye(4)
    for i, displacement in enumerate(_poses(displacements, n + 1)):
        displaced = carried @ mcpc.link_pose(i) @ displacement
        alpha, beta = _nearest_tilt(displaced[:3, 2], float(mcpc.alpha[i]), float(mcpc.beta[i]))
        rotation = tilt(alpha, beta)
        about = rotation.T @ displaced[:3, :3]
        angle = math.atan2(about[1, 0], about[0, 0])
        angles = [math.remainder(alpha - mcpc.alpha[i], math.tau), math.remainder(beta - mcpc.beta[i], math.tau)]
        rows = list(mcpc.parameter_indices(i)[1 if i else 0 :])
        if i == n:
            x, y, z = displaced[:3, :3].T @ displaced[:3, 3]
            angle = math.remainder(angle - mcpc.gamma, math.tau)
            result[rows] = [*angles, angle, x - mcpc.x[i], y - mcpc.y[i], z - mcpc.z]
            break
        x, y, shift = rotation.T @ displaced[:3, 3]
        result[rows] = [*angles, x - mcpc.x[i], y - mcpc.y[i]]
        if chart == "offsets" and mcpc.prismatic[i]:
            result[i], shift = shift, 0.0
        elif chart == "offsets":
            result[i], angle = angle, 0.0
        carried = axial_motion(angle, shift)
    return result


def frame_displacements(mcpc: Mcpc, parameter_errors: ArrayLike) -> Array:
    """Return displacements ``E_0 … E_n`` ``(n+1, 4, 4)`` that move the tip as the parameter errors do.

    ``E_i = V_i⁻¹·V_i'·S_{i+1}``, with ``S_{i+1}`` the rotation Δθ_{i+1} about (or shift Δd_{i+1} along) the next
    joint's axis: it commutes with that joint, so the error of joint i+1 is at the end of link i. ``S_{n+1} = I``.
    Inserted after ``V_i`` they give the tip of ``mcpc.perturbed(parameter_errors)`` at every q, exactly; the bodies
    between need not lie where the original sources put them. `parameter_errors` in chart ``"offsets"`` gives the same
    errors back.
    """
    n = check_instance("mcpc", mcpc, Mcpc, "as mcpc.from_chain returns it").joint_count
    errors = mcpc.checked_errors(parameter_errors)
    actual = mcpc.perturbed(errors)
    result = np.empty((n + 1, 4, 4))
    for i in range(n + 1):
        result[i] = se3.inverse(mcpc.link_pose(i)) @ actual.link_pose(i)
        if i < n:
            result[i] @= axial_motion(0.0, errors[i]) if mcpc.prismatic[i] else axial_motion(errors[i], 0.0)
    return result


def _poses(displacements: ArrayLike, count: int) -> Array:
    name = "mcpc displacements"
    poses = check_numbers(name, displacements, needs=f"({count}, 6) or ({count}, 4, 4)")
    if poses.shape == (count, 6):
        return np.array([se3.displacement(six) for six in poses])
    if poses.shape != (count, 4, 4):
        raise InputError(f"{name}: shape {poses.shape} is not ({count}, 6) or ({count}, 4, 4)")
    for i, pose in enumerate(poses):
        rotation = pose[:3, :3]
        is_rotation = np.abs(rotation.T @ rotation - np.eye(3)).max() < RIGID and np.linalg.det(rotation) > 0
        if not is_rotation or not np.array_equal(pose[3], [0, 0, 0, 1]):
            raise InputError(f"{name}: number {i} is not a rigid motion (rotation, then last row 0 0 0 1)")
    return poses


def _nearest_tilt(direction: Array, alpha: float, beta: float) -> tuple[float, float]:
    """Return the (α, β) that bring z onto a direction: of two pairs, the one nearer to the given pair."""
    first = tilt_angles(direction)
    second = (first[0] + math.pi, math.pi - first[1])

    def distance(pair: tuple[float, float]) -> float:
        return abs(math.remainder(pair[0] - alpha, math.tau)) + abs(math.remainder(pair[1] - beta, math.tau))

    return min(first, second, key=distance)


class JointChain(Protocol):
    """The part of a chain's interface that the adapter uses.

    ``placements[i]`` goes from joint i's frame after it turned (the base link for i = 0) to joint i+1's frame before it
    turns (the tip for i = n); ``axes[i]`` is a unit vector in its joint's own frame. The tip's pose is
    ``placements[0]·Q(axes[0], q_0)·placements[1]⋯placements[n]``.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n joints from base to tip."""

    @property
    def placements(self) -> Array:
        """``(n+1, 4, 4)`` constant poses."""

    @property
    def axes(self) -> Array:
        """``(n, 3)`` unit axes."""

    @property
    def prismatic(self) -> NDArray[np.bool_]:
        """``(n,)`` True for each prismatic joint."""


def from_chain(chain: JointChain) -> Mcpc:
    """Return the MCPC parameters of a chain; forward kinematics agrees with the chain's to rounding.

    Frame i+1 has its z axis along axis i+1 and its origin where that axis meets the plane through the origin of frame i
    normal to it. Each joint, prismatic ones too, gets a constant turn θ_off about z that puts the next axis (for the
    last joint: the tip's z) into the local y-z plane; then β_i = 0 for i ≥ 1 and the parametrisation's singularity cos
    β = 0 does not occur. If the next axis is parallel within 1e-9 rad the turn makes y_i = 0; if it coincides, and for
    a parallel tip, it is 0. Link 0 has no joint before it: if |cos β_0| < 0.1 the base frame is first turned by 90°
    about z (``base_turn``). Sign choices: α in (-π, π], offset in (-π/2, π/2]; hence x_i may be negative.

    Args:
        chain: Any chain of revolute and prismatic joints.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> print(pp.mcpc.from_chain(chain).parameter_names[:4])
        ('theta_1', 'theta_2', 'theta_3', 'theta_4')
    """
    if not all(hasattr(chain, name) for name in ("joint_names", "placements", "axes", "prismatic")):
        needs = "joint_names, placements, axes and prismatic, as a Chain has"
        raise InputError(f"chain must have {needs}, got {shown(chain)}")
    joints = len(chain.joint_names)
    placements = np.asarray(chain.placements, dtype=float)
    axes = np.vstack([np.asarray(chain.axes, dtype=float).reshape(joints, 3), Z_AXIS])
    alpha, beta, x, y, offset = (np.zeros(joints + 1) for _ in range(5))
    frames = []

    before_turn = np.eye(4)
    for i in range(joints + 1):
        point, direction = _next_axis(before_turn, placements[i], axes[i])
        if i:
            offset[i] = _offset(point, direction, last=i == joints)
        elif math.hypot(direction[1], direction[2]) < NEARLY_SINGULAR:  # |cos β|
            offset[i] = math.pi / 2
        frame = before_turn @ axial_motion(offset[i], 0.0)
        frames.append(frame)

        point, direction = _next_axis(frame, placements[i], axes[i])
        alpha[i], beta[i] = tilt_angles(direction)
        if i < joints:
            rotation = tilt(alpha[i], beta[i])
            x[i], y[i], _ = rotation.T @ point
            next_frame = se3.pose(rotation, rotation @ (x[i], y[i], 0.0))
            before_turn = se3.inverse(placements[i]) @ frame @ next_frame

    tip = se3.inverse(frames[-1]) @ placements[-1]
    untilted = tilt(alpha[-1], beta[-1]).T @ tip[:3, :3]
    gamma = half_open(math.atan2(untilted[1, 0], untilted[0, 0]))
    rotation = tilt(alpha[-1], beta[-1]) @ se3.rotation_about(Z_AXIS, gamma)
    x[-1], y[-1], z = rotation.T @ tip[:3, 3]
    return Mcpc(
        joint_names=tuple(chain.joint_names),
        prismatic=np.asarray(chain.prismatic, dtype=bool),
        alpha=alpha,
        beta=beta,
        x=x + 0.0,
        y=y + 0.0,
        gamma=gamma,
        z=float(z) + 0.0,
        joint_offset=offset[1:],
        joint_shift=np.zeros(joints),
        base_turn=float(offset[0]),
        frame_in_link=np.array(frames),
    )


def joint_placements(mcpc: Mcpc) -> tuple[Array, Array]:
    """Return placements ``(n+1, 4, 4)`` and axes ``(n, 3)`` of an equivalent chain, all axes z.

    Its joint frames are the MCPC frames (after their constant turn), its forward kinematics
    ``mcpc.forward_kinematics``. To keep a robot's own joint frames use `to_placements`.
    """
    n = check_instance("mcpc", mcpc, Mcpc, "as mcpc.from_chain returns it").joint_count
    placements = np.array([mcpc.link_pose(i) @ (mcpc.joint_pose(i + 1) if i < n else np.eye(4)) for i in range(n + 1)])
    placements[0] = axial_motion(mcpc.base_turn, 0.0) @ placements[0]
    return placements, np.tile(Z_AXIS, (n, 1))


def to_placements(nominal: Mcpc, perturbed: Mcpc, chain: JointChain) -> Array:
    """Return the joint placements ``(n+1, 4, 4)`` of the as-built robot.

    With the chain's own axes they reproduce ``perturbed.forward_kinematics(q)`` at every q. Each link keeps its axes
    relative to the MCPC frame at its joint; an error Δθ or Δd of a joint goes into that joint's placement, so that the
    link beyond it moves too. A placement whose parameters did not change is the chain's own, bit for bit.

    Args:
        nominal: ``from_chain(chain)``.
        perturbed: ``nominal.perturbed(…)``.
        chain: The nominal chain.

    Raises:
        InputError: The chain is not the one that ``nominal`` was extracted from, or ``perturbed`` was not made from it.
    """
    is_same = (
        nominal.joint_names == perturbed.joint_names == tuple(chain.joint_names)
        and nominal.prismatic.tolist() == perturbed.prismatic.tolist() == list(chain.prismatic)
        and nominal.base_turn == perturbed.base_turn
    )
    if not is_same:
        raise InputError("mcpc to_placements: the two parameter sets and the chain do not have the same joints")
    original = np.asarray(chain.placements, dtype=float)
    result = original.copy()
    for i in range(nominal.joint_count + 1):
        expected = _placement(nominal, nominal, i)
        if not np.allclose(expected, original[i], rtol=0.0, atol=SAME_CHAIN):
            raise InputError(f"mcpc to_placements: placement {i} of the chain is not that of the nominal parameters")
        built = _placement(nominal, perturbed, i)
        if not np.array_equal(built, expected):
            result[i] = built
    return result


def _placement(nominal: Mcpc, actual: Mcpc, link: int) -> Array:
    """Return ``F_i V_i S_{i+1} F_{i+1}⁻¹``; F nominal, V and S (the constant part of Q) actual."""
    end: Array = nominal.frame_in_link[link] @ actual.link_pose(link)
    if link == nominal.joint_count:
        return end
    return se3.compose(end, actual.joint_pose(link + 1), se3.inverse(nominal.frame_in_link[link + 1]))


def _next_axis(frame: Array, placement: Array, axis: Array) -> tuple[Array, Array]:
    """Return the next axis in an MCPC frame: the foot of the perpendicular from the origin, and the direction."""
    next_joint = se3.inverse(frame) @ placement
    direction = next_joint[:3, :3] @ axis
    direction = direction / np.linalg.norm(direction)
    origin = next_joint[:3, 3]
    return origin - direction * (direction @ origin), direction


def _offset(point: Array, direction: Array, *, last: bool) -> float:
    """Return the joint's constant turn in (-π/2, π/2]."""
    if math.hypot(direction[0], direction[1]) > PARALLEL:
        return _reduce_to_half_turn(math.atan2(-direction[0], direction[1]))
    if last or math.hypot(point[0], point[1]) <= COINCIDENT:
        return 0.0
    return _reduce_to_half_turn(math.atan2(point[1], point[0]))


def _reduce_to_half_turn(angle: float) -> float:
    """Return the angle modulo π, in (-π/2, π/2]; the signs of α, x and y absorb the half turn, β the rest of a tie."""
    remainder = math.remainder(angle, math.pi)
    return math.pi / 2 if remainder < -math.pi / 2 + TIE else remainder + 0.0


def mcpc_table(mcpc: Mcpc) -> str:
    """Return the MCPC parameters in the layout of the paper's Table 1, in degrees and mm."""
    return "\n".join(text_lines(COLUMNS, mcpc.table))
