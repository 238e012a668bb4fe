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

Sign choices: α in (-π, π], β in [-π/2, π/2] (0 after every joint of an extracted model), joint offset in
(-π/2, π/2], γ in (-π, π].
"""

from precision_pin.robot.mcpc.displacements import frame_displacements, parameter_errors
from precision_pin.robot.mcpc.extraction import JointChain, from_chain, joint_placements, to_placements
from precision_pin.robot.mcpc.parameters import Mcpc, McpcRow

__all__ = [
    "JointChain",
    "Mcpc",
    "McpcRow",
    "frame_displacements",
    "from_chain",
    "joint_placements",
    "parameter_errors",
    "to_placements",
]
