"""The MCPC parameters of one arm, its forward kinematics and its error Jacobian (eqs 1-17 of the paper)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_numbers, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.render.notebook import Table, rendered

X_AXIS = (1.0, 0.0, 0.0)
Y_AXIS = (0.0, 1.0, 0.0)
Z_AXIS = (0.0, 0.0, 1.0)


@final
@dataclass(frozen=True)
class McpcRow:
    """One row of the parameter table, in the form of the paper's Table 1.

    Attributes
    ----------
    link
        Number i of the chain link, 0..n; the row describes ``T_i``.
    joint
        Name of the joint before this link; None for link 0.
    prismatic
        True if that joint is prismatic.
    turn
        Constant turn about z before α (rad): the base turn for link 0, θ_off,i after joint i.
    shift
        Constant shift along z before α (m): zero unless a prismatic joint has an error.
    alpha, beta, x, y
        The four parameters (rad, rad, m, m).
    gamma, z
        The two further ones of the last link (rad, m); None elsewhere.
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


@final
@dataclass(frozen=True, eq=False)
class Mcpc:
    """The MCPC parameters of a chain of n joints.

    Made by `from_chain`, or directly from numbers. Arrays are copied and made read-only.

    Parameters
    ----------
    joint_names
        The n joints in chain order.
    prismatic
        ``(n,)`` True for each prismatic joint.
    alpha, beta, x, y
        ``(n+1,)`` parameters of links 0..n (rad, rad, m, m).
    gamma, z
        The two further parameters of link n (rad, m).
    joint_offset
        ``(n,)`` θ_off, the constant turn of each joint about its z axis (rad), prismatic joints too.
    joint_shift
        ``(n,)`` constant shift along a prismatic joint's axis (m), zero as extracted.
    base_turn
        Turn of frame 0 about the z axis of the base link (rad): 0 or π/2 as extracted.
    frame_in_link
        ``(n+1, 4, 4)`` constant pose of MCPC frame i *after* ``Q_i``, in the axes of chain link i: joint
        i's URDF frame after it turned, the base link for i = 0 (there it is the base turn).

    Raises
    ------
    InputError
        A parameter has the wrong shape or is not finite.
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
        prismatic.flags.writeable = False
        object.__setattr__(self, "prismatic", prismatic)

    @property
    def joint_count(self) -> int:
        """Number n of joints."""
        return len(self.joint_names)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The 5n+6 names in the order of J_E's columns (eq 16).

        ``theta_1..theta_n`` (``d_i`` where joint i is prismatic), ``alpha_0..alpha_n``,
        ``beta_0..beta_n``, ``gamma_n``, ``x_0..x_n``, ``y_0..y_n``, ``z_n``.
        """
        n = self.joint_count
        links = range(n + 1)
        return (
            *(f"{'d' if is_prismatic else 'theta'}_{i + 1}" for i, is_prismatic in enumerate(self.prismatic)),
            *(f"alpha_{i}" for i in links),
            *(f"beta_{i}" for i in links),
            f"gamma_{n}",
            *(f"x_{i}" for i in links),
            *(f"y_{i}" for i in links),
            f"z_{n}",
        )

    def parameter_indices(self, link: int) -> tuple[int, ...]:
        """Return the positions of the columns of `link_matrix` (same order) among the 5n+6 parameters."""
        n = self.joint_count
        self._check_link(link)
        joint = (link - 1,) if link else ()
        angles = (n + link, 2 * n + 1 + link)
        lengths = (3 * n + 3 + link, 4 * n + 4 + link)
        if link < n:
            return (*joint, *angles, *lengths)
        return (*joint, *angles, 3 * n + 2, *lengths, 5 * n + 5)

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
        if link == 0:
            return np.eye(4)
        turn, shift = self.joint_offset[link - 1], self.joint_shift[link - 1]
        if self.prismatic[link - 1]:
            return axial_motion(turn, shift + value)
        return axial_motion(turn + value, shift)

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Return the tip's pose ``(4, 4)`` in the base link at joint values ``(n,)`` (eq 3).

        Raises
        ------
        InputError
            ``q`` is not n finite numbers.
        """
        values = self._joint_values(q)
        return se3.compose(se3.pose(se3.rotation_about(Z_AXIS, self.base_turn), np.zeros(3)), *self._links(values))

    def link_matrix(self, link: int) -> Array:
        """Return the columns of eq 8 (link i < n) or eq 11 (link n), ``(6, m)``.

        They map parameter errors to the displacement ``[d; δ]`` of frame i+1 in its own axes. Order: θ_i (d_i
        for a prismatic joint; absent for link 0), α_i, β_i, [γ_n,] x_i, y_i[, z_n]. The product of their
        exponentials ``Exp(k_j Δ_j)`` in this order reproduces the perturbed ``T_i`` at any size of Δ.
        """
        self._check_link(link)
        last = link == self.joint_count
        gamma, z = (self.gamma, self.z) if last else (0.0, 0.0)
        sin_alpha, cos_alpha = math.sin(self.alpha[link]), math.cos(self.alpha[link])
        sin_beta, cos_beta = math.sin(self.beta[link]), math.cos(self.beta[link])
        turned = se3.rotation_about(Z_AXIS, gamma).T
        k6 = turned @ (-cos_alpha * sin_beta, sin_alpha, cos_alpha * cos_beta)
        k7 = turned @ (cos_beta, 0.0, sin_beta)
        k8 = turned @ Y_AXIS
        point = np.array([self.x[link], self.y[link], z])
        columns = []
        if link:
            columns.append(_shift(k6) if self.prismatic[link - 1] else _turn(k6, point))
        columns += [_turn(k7, point), _turn(k8, point)]
        if last:
            columns.append(_turn(np.array(Z_AXIS), point))
        columns += [_shift(np.array(X_AXIS)), _shift(np.array(Y_AXIS))]
        if last:
            columns.append(_shift(np.array(Z_AXIS)))
        return np.column_stack(columns)

    def propagation(self, q: ArrayLike) -> Array:
        """Return ``Ad(U_{i+1}⁻¹)`` for i = 0..n, ``(n+1, 6, 6)``: the matrices of eq 15.

        Each maps the displacement of frame i+1, in its own axes, to that of the tip in tip axes:
        ``D_e = Σ Ad(U_{i+1}⁻¹) D_i``.
        """
        poses = self._links(self._joint_values(q))
        to_tip = np.eye(4)
        matrices = []
        for pose in reversed(poses):
            matrices.append(se3.adjoint(se3.inverse(to_tip)))
            to_tip = pose @ to_tip
        return np.array(matrices[::-1])

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J_E ``(6, 5n+6)``: parameter errors to the tip's ``[d; δ]`` in tip axes (eq 16).

        Columns as in `parameter_names`. There is no θ_0. A column of a prismatic joint is d_i.

        Raises
        ------
        InputError
            ``q`` is not n finite numbers.
        """
        result = np.zeros((6, 5 * self.joint_count + 6))
        for link, matrix in enumerate(self.propagation(q)):
            result[:, self.parameter_indices(link)] = matrix @ self.link_matrix(link)
        return result

    def jacobian_base(self, q: ArrayLike) -> Array:
        """Return J_I ``(6, 5n+6)``: parameter errors to the tip's ``[d; δ]`` in base-link axes (eq 17).

        ``J_I = T_s J_E`` with ``T_s = blockdiag(R, R)``, R the tip's rotation. (Not the adjoint of T, which
        would refer d to the base's origin.)

        Raises
        ------
        InputError
            ``q`` is not n finite numbers.
        """
        rotation = self.forward_kinematics(q)[:3, :3]
        in_tip = self.jacobian(q)
        return np.vstack([rotation @ in_tip[:3], rotation @ in_tip[3:]])

    def perturbed(self, parameter_errors: ArrayLike) -> Mcpc:
        """Return the arm with errors ``(5n+6,)`` added to its parameters; exact at any size.

        Δθ goes to the joint offset, Δd to the joint shift. ``frame_in_link`` does not change: each link keeps its own
        axes relative to the MCPC frame at its joint (see `to_placements`).

        Raises
        ------
        InputError
            There are not 5n+6 finite numbers.
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
        """Return the HTML for a notebook: the table in the form of the paper's Table 1, in degrees and mm."""
        rows = []
        for row in self.table:
            turns = [
                _format_value(row.turn, math.degrees(1)),
                *(_format_value(angle, math.degrees(1)) for angle in (row.alpha, row.beta, row.gamma)),
            ]
            joint = "base" if row.joint is None else f"{row.joint} (slides)" if row.prismatic else row.joint
            rows.append(
                [str(row.link), joint, *turns, *(_format_value(length, 1e3) for length in (row.x, row.y, row.z))]
            )
        columns = ("i", "joint", "offset [°]", "α [°]", "β [°]", "γ [°]", "x [mm]", "y [mm]", "z [mm]")
        return rendered(f"MCPC parameters of {self.joint_count} joints", [Table(columns, rows, words=2)])

    def _joint_values(self, q: ArrayLike) -> Array:
        return finite_array("mcpc joint values q", q, (self.joint_count,))

    def _links(self, q: Array) -> list[Array]:
        """Return T_0 … T_n at checked joint values."""
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


def _format_value(value: float | None, factor: float) -> str:
    return "" if value is None else f"{round(factor * value, 6) + 0.0:.9g}"


def tilt(alpha: float, beta: float) -> Array:
    """Return ``Rot(x, α)·Rot(y, β)``, ``(3, 3)``."""
    rotation: Array = se3.rotation_about(X_AXIS, alpha) @ se3.rotation_about(Y_AXIS, beta)
    return rotation


def axial_motion(turn: float, shift: float) -> Array:
    """Return the motion along and about z, ``Rot(z, turn)·Trans(0, 0, shift)``, ``(4, 4)``."""
    return se3.pose(se3.rotation_about(Z_AXIS, turn), (0.0, 0.0, shift))


def tilt_angles(direction: Array) -> tuple[float, float]:
    """Return (α, β) whose ``Rot(x, α)·Rot(y, β)`` brings z onto a direction ``(3,)`` of any length.

    α in (-π, π], β in [-π/2, π/2].
    """
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
