"""Conversion of frame displacements to MCPC parameter errors and back, in place of eqs 20 and 22 of the paper.

Erratum. The paper writes ``ΔΩ_k = J_k⁻¹ D_k``. The matrix of one link is 6x5 and has no inverse, at
α = ±90° it even loses rank, and a pseudo-inverse gives results that depend on the unit of length. Four
parameters cannot represent six numbers. The remainder is a motion along and about the next joint's axis,
which commutes with that joint and can therefore be passed to the next link.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_choice, check_instance, check_numbers
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.mcpc.parameters import Mcpc, axial_motion, finite_array, tilt, tilt_angles

RIGID = 1e-9
"""Largest deviation of a given displacement from a rigid motion."""


def parameter_errors(mcpc: Mcpc, displacements: ArrayLike, chart: Literal["complete", "offsets"] = "complete") -> Array:
    """Return the parameter errors ΔΩ ``(5n+6,)`` that move the tip as the given displacements do.

    ``mcpc.perturbed(ΔΩ)`` has the tip of ``Q_0 V_0 E_0 Q_1 V_1 E_1 ⋯ Q_n V_n E_n`` at every q, exactly at
    any size. For each displaced link (α, β, x, y) are solved. The remainder ``Trans(z)·Rot(z, γ)``, along and
    about the next joint's axis, is passed through that joint to the next link; the last link absorbs the rest
    in its six parameters. Replaces eqs 20 and 22.

    Parameters
    ----------
    mcpc
        The nominal arm.
    displacements
        ``E_0 … E_n``, E_i inserted after ``V_i`` (in the axes of frame i+1; E_n: of the tip): poses
        ``(n+1, 4, 4)`` or ``[d; δ]`` ``(n+1, 6)`` in m and rad.
    chart
        ``"complete"``: 4n+6 parameters, every Δθ and Δd zero. ``"offsets"``: the remainder about the next
        axis becomes Δθ_{i+1}, or along it Δd_{i+1} if that joint is prismatic; the other of the two is
        passed on.

    Returns
    -------
    numpy.ndarray
        ΔΩ in the order of `Mcpc.parameter_names`; angles in [-π, π].

    Raises
    ------
    InputError
        Wrong shape, a number that is not finite, a pose that is not rigid, an unknown chart.
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
        turn = math.atan2(about[1, 0], about[0, 0])
        angles = [math.remainder(alpha - mcpc.alpha[i], math.tau), math.remainder(beta - mcpc.beta[i], math.tau)]
        if i == n:
            x, y, z = displaced[:3, :3].T @ displaced[:3, 3]
            errors = [*angles, math.remainder(turn - mcpc.gamma, math.tau), x - mcpc.x[i], y - mcpc.y[i], z - mcpc.z]
            result[list(mcpc.parameter_indices(i)[1 if i else 0 :])] = errors
            break
        x, y, shift = rotation.T @ displaced[:3, 3]
        result[list(mcpc.parameter_indices(i)[1 if i else 0 :])] = [*angles, x - mcpc.x[i], y - mcpc.y[i]]
        if chart == "offsets" and mcpc.prismatic[i]:
            result[i], shift = shift, 0.0
        elif chart == "offsets":
            result[i], turn = turn, 0.0
        carried = axial_motion(turn, shift)
    return result


def frame_displacements(mcpc: Mcpc, parameter_errors: ArrayLike) -> Array:
    """Return displacements ``E_0 … E_n`` ``(n+1, 4, 4)`` that move the tip as the parameter errors do.

    ``E_i = V_i⁻¹·V_i'·S_{i+1}``, with ``S_{i+1}`` the rotation Δθ_{i+1} about (or shift Δd_{i+1} along) the next
    joint's axis: it commutes with that joint, so the error of joint i+1 is at the end of link i. ``S_{n+1} = I``.
    Inserted after ``V_i`` they give the tip of ``mcpc.perturbed(parameter_errors)`` at every q, exactly;
    the bodies between need not lie where the original sources put them. `parameter_errors` in chart
    ``"offsets"`` gives the same errors back.

    Raises
    ------
    InputError
        There are not 5n+6 finite numbers.
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
    """Return the displacements as ``(count, 4, 4)`` rigid motions."""
    what = "mcpc displacements"
    given = check_numbers(what, displacements, needs=f"({count}, 6) or ({count}, 4, 4)")
    if given.shape == (count, 6):
        return np.array([se3.displacement(six) for six in finite_array(what, given, (count, 6))])
    if given.shape != (count, 4, 4):
        raise InputError(f"{what}: shape {given.shape} is not ({count}, 6) or ({count}, 4, 4)")
    poses = finite_array(what, given, (count, 4, 4))
    for i, pose in enumerate(poses):
        rotation = pose[:3, :3]
        rigid = (
            np.abs(rotation.T @ rotation - np.eye(3)).max() < RIGID
            and np.linalg.det(rotation) > 0
            and np.array_equal(pose[3], [0, 0, 0, 1])
        )
        if not rigid:
            raise InputError(f"{what}: number {i} is not a rigid motion (rotation, then last row 0 0 0 1)")
    return poses


def _nearest_tilt(direction: Array, alpha: float, beta: float) -> tuple[float, float]:
    """Return the (α, β) that bring z onto a direction: of the two pairs, the one nearer to the given pair."""
    first = tilt_angles(direction)
    second = (first[0] + math.pi, math.pi - first[1])
    return min(
        (first, second),
        key=lambda pair: abs(math.remainder(pair[0] - alpha, math.tau)) + abs(math.remainder(pair[1] - beta, math.tau)),
    )
