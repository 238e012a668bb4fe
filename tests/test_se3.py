"""Rigid motions against Pinocchio, scipy's rotations and plain matrices."""

import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from precision_pin.base import se3
from precision_pin.base.arrays import Array

ANGLES = [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.0499999, 0.05, 0.0500001, 0.25, 1.0, 2.5]
ANGLES += [math.pi - 0.1, math.pi - 1e-4, math.pi - 1e-8, math.pi - 1e-12, math.pi]
DIRECTIONS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [1, 1, 1], [1, -2, 3], [1e-9, 1, 0], [0, 1e-5, -1]], dtype=float
)
DIRECTIONS = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]
VECTORS = np.array([angle * direction for angle in ANGLES for direction in DIRECTIONS])


def random_poses(count: int, seed: int) -> list[pin.SE3]:
    generator = np.random.default_rng(seed)
    rotations = Rotation.random(count, rng=generator).as_matrix()
    return [pin.SE3(rotation, generator.normal(size=3)) for rotation in rotations]


def test_exp_against_pinocchio_and_scipy() -> None:
    for vector in VECTORS:
        np.testing.assert_allclose(se3.exp_rotation(vector), pin.exp3(vector), rtol=0, atol=1e-15)
    for angle in (3.5, 2 * math.pi, 100.0):  # beyond half a turn
        for direction in DIRECTIONS:
            expected = Rotation.from_rotvec(angle * direction).as_matrix()
            np.testing.assert_allclose(se3.exp_rotation(angle * direction), expected, rtol=0, atol=2e-14)


def test_exp_keeps_the_last_digit_of_small_rotations() -> None:
    # the product of 1e-9 and 2e-9, halved, must not vanish against 1
    rotation = se3.exp_rotation([1e-9, 2e-9, 0.0])
    assert rotation[0, 1] == pytest.approx(1e-18, rel=1e-12)
    assert rotation[2, 1] == pytest.approx(1e-9, rel=1e-15)


def test_log_is_the_inverse_of_exp_from_zero_to_half_a_turn() -> None:
    for vector in VECTORS:
        # built by scipy, through a quaternion
        back = se3.log_rotation(Rotation.from_rotvec(vector).as_matrix())
        if np.linalg.norm(vector) > math.pi - 1e-14:
            back = back * np.sign(back @ vector)
        np.testing.assert_allclose(back, vector, rtol=0, atol=2e-15)
        assert np.linalg.norm(back) <= math.pi * (1 + 1e-15)


def test_log_of_small_rotations_keeps_relative_accuracy() -> None:
    for size in (1e-15, 1e-12, 1e-9, 1e-6, 1e-3):
        vector = size * np.array([1.0, -2.0, 0.5])
        np.testing.assert_allclose(se3.log_rotation(se3.exp_rotation(vector)), vector, rtol=2e-15, atol=0)


def test_log_of_exact_half_turns() -> None:
    for matrix, axis in ((np.diag([1.0, -1, -1]), 0), (np.diag([-1.0, 1, -1]), 1), (np.diag([-1.0, -1, 1]), 2)):
        expected = np.zeros(3)
        expected[axis] = math.pi
        np.testing.assert_allclose(np.abs(se3.log_rotation(matrix)), expected, rtol=0, atol=1e-15)


def test_log_is_continuous_where_the_largest_component_changes() -> None:
    direction = np.array([1.0, 1.0, 1.0]) / math.sqrt(3)
    for angle in np.linspace(0, math.pi - 1e-6, 400):
        back = se3.log_rotation(se3.exp_rotation(angle * direction))
        np.testing.assert_allclose(back, angle * direction, rtol=0, atol=2e-15)


def test_left_jacobian_against_pinocchio() -> None:
    # Pinocchio's Jexp3 is the right Jacobian; the left one is that of the opposite vector
    for vector in VECTORS:
        np.testing.assert_allclose(se3.left_jacobian(vector), pin.Jexp3(-vector), rtol=0, atol=1e-14)


@pytest.mark.parametrize("vector", [[0.3, -0.7, 1.1], [1e-6, 0, 0], [0.03, 0.02, 0.01], [2.0, 1.0, -1.5]])
def test_left_jacobian_by_differences_of_rotations(vector: list[float]) -> None:
    step = 1e-5
    back = Rotation.from_rotvec(vector).inv()
    for k, unit in enumerate(np.eye(3)):
        ahead, behind = (Rotation.from_rotvec(vector + sign * step * unit) for sign in (1, -1))
        slope = ((ahead * back).as_rotvec() - (behind * back).as_rotvec()) / (2 * step)
        np.testing.assert_allclose(se3.left_jacobian(vector)[:, k], slope, rtol=0, atol=1e-10)


def test_left_jacobian_inverse_against_pinocchio() -> None:
    # not below 0.2 rad: Pinocchio loses 7e-11 at 1 mrad
    for direction in DIRECTIONS:
        for angle in (0.2, 0.7, 1.5, 2.9):
            expected = pin.Jlog3(pin.exp3(-angle * direction))
            np.testing.assert_allclose(se3.left_jacobian_inverse(angle * direction), expected, rtol=0, atol=1e-13)


def test_left_jacobian_inverse_by_its_series() -> None:
    # 1 - K/2 + K²/12 (1 + φ²/60 + φ⁴/2520 + …), K the cross product: Bernoulli's numbers
    for angle in (0.0, 1e-12, 1e-6, 1e-3, 0.04, 0.06, 0.1):
        for direction in DIRECTIONS:
            cross = np.array([np.cross(angle * direction, unit) for unit in np.eye(3)]).T
            share = 1 + angle**2 / 60 + angle**4 / 2520 + angle**6 / 100800
            expected = np.eye(3) - cross / 2 + cross @ cross / 12 * share
            np.testing.assert_allclose(se3.left_jacobian_inverse(angle * direction), expected, rtol=0, atol=1e-15)


def test_samples_last_is_the_same_as_one_by_one() -> None:
    values = np.random.default_rng(2).normal(size=(6, 20))
    rotations = se3.exp_rotation(VECTORS.T)
    functions: list[tuple[Callable[[Array], Array], Array]] = [
        (function, VECTORS.T) for function in (se3.exp_rotation, se3.left_jacobian, se3.skew)
    ]
    for function, given in [*functions, (se3.log_rotation, rotations), (se3.displacement, values)]:
        whole = function(given)
        assert whole.shape[-1] == given.shape[-1]
        for k in range(given.shape[-1]):
            np.testing.assert_allclose(whole[..., k], function(given[..., k]), rtol=0, atol=1e-15)
    for samples in (0, 1):
        assert se3.log_rotation(se3.exp_rotation(np.zeros((3, samples)))).shape == (3, samples)
        assert se3.compose(np.eye(4), se3.displacement(np.zeros((6, samples)))).shape == (4, 4, samples)
    a, b = np.random.default_rng(1).normal(size=(2, 3))
    np.testing.assert_allclose(se3.skew(a) @ b, np.cross(a, b), rtol=0, atol=1e-15)


def test_displacement_is_translation_then_rotation() -> None:
    values = np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    expected = pin.SE3(np.eye(3), values[:3]) * pin.SE3(pin.exp3(values[3:]), np.zeros(3))
    np.testing.assert_allclose(se3.displacement(values), expected.homogeneous, rtol=0, atol=1e-15)
    # the exponential of SE(3) is another thing, unless it only turns or only shifts
    assert np.abs(se3.displacement(values) - pin.exp6(pin.Motion(values)).homogeneous).max() > 0.01
    for pure in (values * [1, 1, 1, 0, 0, 0], values * [0, 0, 0, 1, 1, 1]):
        expected = pin.exp6(pin.Motion(pure))
        np.testing.assert_allclose(se3.displacement(pure), expected.homogeneous, rtol=0, atol=1e-15)


def test_compose_mixes_single_poses_and_samples() -> None:
    singles = [motion.homogeneous for motion in random_poses(3, seed=6)]
    samples = np.stack([motion.homogeneous for motion in random_poses(7, seed=7)], axis=-1)
    others = np.stack([motion.homogeneous for motion in random_poses(7, seed=8)], axis=-1)
    whole = se3.compose(singles[0], samples, singles[1], others, singles[2])
    inverses = se3.inverse(samples)
    for k in range(7):
        expected = singles[0] @ samples[:, :, k] @ singles[1] @ others[:, :, k] @ singles[2]
        np.testing.assert_allclose(whole[:, :, k], expected, rtol=0, atol=5e-15)
        np.testing.assert_allclose(inverses[:, :, k] @ samples[:, :, k], np.eye(4), rtol=0, atol=2e-15)
    np.testing.assert_allclose(se3.compose(*singles), singles[0] @ singles[1] @ singles[2], rtol=0, atol=2e-15)


def test_pose_and_translation_broadcast_samples() -> None:
    rotations = se3.exp_rotation(VECTORS.T)
    positions = np.random.default_rng(3).normal(size=(3, len(VECTORS)))
    one_rotation = se3.pose(rotations[:, :, 50], positions)
    one_position = se3.pose(rotations, positions[:, 4])
    both = se3.pose(rotations, positions)
    for k in (0, 50, 99):
        np.testing.assert_array_equal(one_rotation[:3, :3, k], rotations[:, :, 50])
        np.testing.assert_array_equal(one_rotation[:3, 3, k], positions[:, k])
        np.testing.assert_array_equal(one_position[:3, :3, k], rotations[:, :, k])
        np.testing.assert_array_equal(one_position[:3, 3, k], positions[:, 4])
        np.testing.assert_array_equal(both[:3, :3, k], rotations[:, :, k])
        np.testing.assert_array_equal(both[3, :, k], [0, 0, 0, 1])
    np.testing.assert_array_equal(se3.translation([1, 2, 3])[:3, 3], [1, 2, 3])
    np.testing.assert_array_equal(se3.translation(positions)[:3, 3], positions)


def test_adjoint_against_pinocchio() -> None:
    for motion in random_poses(5, seed=9):
        np.testing.assert_allclose(se3.adjoint(motion.homogeneous), motion.action, rtol=0, atol=1e-15)


def test_rotation_about_an_axis_against_pinocchio() -> None:
    angles = np.array([-7.0, -math.pi, -1e-9, 0.0, 0.3, math.pi / 2, 3.0])
    for direction in DIRECTIONS:
        whole = se3.rotation_about(direction, angles)
        for k, angle in enumerate(angles):
            expected = pin.AngleAxis(float(angle), direction).matrix()
            np.testing.assert_allclose(se3.rotation_about(direction, angle), expected, rtol=0, atol=2e-15)
            np.testing.assert_allclose(whole[:, :, k], expected, rtol=0, atol=2e-15)


def test_rpy_against_pinocchio_and_by_order() -> None:
    for rpy in ([0.1, 0.2, 0.3], [-math.pi / 2, 0, 0], [3.0, -1.5, 2.0], [0, math.pi / 2, 1.0]):
        np.testing.assert_allclose(se3.rpy_rotation(rpy), pin.rpy.rpyToMatrix(np.array(rpy)), rtol=0, atol=1e-15)
    # URDF turns about fixed axes x, y, z in this order: a roll of 90° takes y to z, where the yaw leaves it;
    # it leaves x, which the yaw takes to y
    turned = se3.rpy_rotation([math.pi / 2, 0, math.pi / 2])
    np.testing.assert_allclose(turned @ [0, 1, 0], [0, 0, 1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(turned @ [1, 0, 0], [0, 1, 0], rtol=0, atol=1e-15)
