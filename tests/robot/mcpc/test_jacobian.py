"""The error model, eqs 1-17 of the paper, against independent readings."""

import numpy as np
import pinocchio as pin
import pytest

from precision_pin.robot import mcpc
from robot.mcpc import cases

ARM_SIZES = (0, 2, 6)


def complex_derivatives(function, size):
    """Return derivatives to rounding: no difference is taken."""
    return [function(1e-30j * np.eye(size)[k]).imag / 1e-30 for k in range(size)]


@pytest.mark.parametrize("joints", ARM_SIZES)
def test_eq1_eq2_eq3_link_poses(joints):
    arm = cases.random_mcpc(joints, joints)
    q = np.random.default_rng(joints).uniform(-3, 3, joints)
    zero = np.zeros(5 * joints + 6)
    for i, link in enumerate(cases.literal_links(arm, q, zero)):
        got = arm.joint_pose(i, q[i - 1] if i else 0.0) @ arm.link_pose(i)
        np.testing.assert_allclose(got, link, rtol=0, atol=2e-15)
    np.testing.assert_allclose(arm.forward_kinematics(q), cases.literal_tip(arm, q, zero), rtol=0, atol=2e-14)


def test_eq16_order_of_the_parameters():
    arm = mcpc.from_chain(cases.stand_in(cases.paper_arm().placements[:3], np.tile((0, 0, 1), (2, 1)), [False, True]))
    assert arm.parameter_names == (
        *("theta_1", "d_2", "alpha_0", "alpha_1", "alpha_2", "beta_0", "beta_1", "beta_2", "gamma_2"),
        *("x_0", "x_1", "x_2", "y_0", "y_1", "y_2", "z_2"),
    )
    names = [tuple(arm.parameter_names[k] for k in arm.parameter_indices(i)) for i in range(3)]
    assert names == [
        ("alpha_0", "beta_0", "x_0", "y_0"),
        ("theta_1", "alpha_1", "beta_1", "x_1", "y_1"),
        ("d_2", "alpha_2", "beta_2", "gamma_2", "x_2", "y_2", "z_2"),
    ]


@pytest.mark.parametrize("joints", ARM_SIZES)
@pytest.mark.parametrize("seed", range(2))
def test_eq8_eq11_columns_are_the_derivatives_of_eqs_1_and_2(joints, seed):
    """T_i⁻¹ ∂T_i/∂p laid out as eq 5. For a prismatic joint k1 takes k6's value and k6 is zero."""
    arm = cases.random_mcpc(seed, joints)
    q = np.random.default_rng(seed).uniform(-3, 3, joints)
    size = 5 * joints + 6
    nominal = cases.literal_links(arm, q, np.zeros(size))
    for i in range(joints + 1):
        inverse = np.linalg.inv(nominal[i])
        derivatives = complex_derivatives(lambda e, i=i: cases.literal_links(arm, q, e)[i], size)
        expected = np.column_stack([cases.six(inverse @ derivatives[k]) for k in arm.parameter_indices(i)])
        np.testing.assert_allclose(arm.link_matrix(i), expected, rtol=0, atol=2e-15)


def test_eq8_by_hand_on_link_1_of_the_paper():
    """α = -90°, y = -a_1: the column of α lifts frame 2 by k2 = x̂ × (0, -a_1, 0) = (0, 0, -a_1)."""
    arm = mcpc.from_chain(cases.paper_arm())
    expected = np.array([
        [0, 0, 0, 1, 0],
        [0, 0, 0, 0, 1],
        [0, -0.085, 0, 0, 0],
        [0, 1, 0, 0, 0],
        [-1, 0, 1, 0, 0],
        [0, 0, 0, 0, 0],
    ])  # fmt: skip
    np.testing.assert_allclose(arm.link_matrix(1), expected, rtol=0, atol=4e-16)


@pytest.mark.parametrize("joints", ARM_SIZES)
@pytest.mark.parametrize("seed", range(2))
def test_eq15_eq16_jacobian_is_the_derivative_of_eq3(joints, seed):
    """Its parts carry a displacement behind a link through all links after it, by Pinocchio's action matrices."""
    arm = cases.random_mcpc(seed, joints)
    q = np.random.default_rng(seed).uniform(-3, 3, joints)
    size = 5 * joints + 6
    inverse = np.linalg.inv(cases.literal_tip(arm, q, np.zeros(size)))
    derivatives = complex_derivatives(lambda e: cases.literal_tip(arm, q, e), size)
    expected = np.column_stack([cases.six(inverse @ derivative) for derivative in derivatives])
    np.testing.assert_allclose(arm.jacobian(q), expected, rtol=0, atol=2e-14)
    behind = np.eye(4)
    for propagation, link in zip(
        arm.propagation(q)[::-1], cases.literal_links(arm, q, np.zeros(size))[::-1], strict=True
    ):
        np.testing.assert_allclose(propagation, pin.SE3(behind).toActionMatrixInverse(), rtol=0, atol=5e-14)
        behind = link @ behind


@pytest.mark.fast(2)
@pytest.mark.parametrize("seed", range(4))
def test_eq17_jacobian_base_by_central_differences_of_the_perturbed_arm(seed):
    """Position p' - p and δ = Log(R'Rᵀ) in base axes. T_s is blockdiag(R, R), not the adjoint of T."""
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    q = cases.random_values(chain, np.random.default_rng(seed))
    step = 1e-5
    columns = []
    for unit in np.eye(len(arm.parameter_names)):
        plus = arm.perturbed(step * unit).forward_kinematics(q)
        minus = arm.perturbed(-step * unit).forward_kinematics(q)
        turn = cases.Rotation.from_matrix(plus[:3, :3] @ minus[:3, :3].T).as_rotvec()
        columns.append(np.concatenate([plus[:3, 3] - minus[:3, 3], turn]) / (2 * step))
    np.testing.assert_allclose(arm.jacobian_base(q), np.column_stack(columns), rtol=0, atol=2e-9)
