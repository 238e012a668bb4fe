"""Rigid motions against Pinocchio, scipy's rotations and plain matrices."""

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from precision_pin.base import se3

ANGLES = [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.0499999, 0.05, 0.0500001, 0.25, 1.0, 2.5]
ANGLES += [math.pi - 0.1, math.pi - 1e-4, math.pi - 1e-8, math.pi - 1e-12, math.pi]
DIRECTIONS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [1, 1, 1], [1, -2, 3], [1e-9, 1, 0], [0, 1e-5, -1]], dtype=float
)
DIRECTIONS = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]
VECTORS = np.array([angle * direction for angle in ANGLES for direction in DIRECTIONS])


def random_poses(count, seed):
    generator = np.random.default_rng(seed)
    rotations = Rotation.random(count, rng=generator).as_matrix()
    return [pin.SE3(rotation, generator.normal(size=3)) for rotation in rotations]


def test_exp_against_pinocchio_and_scipy():
    for vector in VECTORS:
        np.testing.assert_allclose(se3.exp_rotation(vector), pin.exp3(vector), rtol=0, atol=1e-15)
    for angle in (3.5, 2 * math.pi, 100.0):  # beyond half a turn
        for direction in DIRECTIONS:
            expected = Rotation.from_rotvec(angle * direction).as_matrix()
            np.testing.assert_allclose(se3.exp_rotation(angle * direction), expected, rtol=0, atol=2e-14)


def test_exp_keeps_the_last_digit_of_small_rotations():
    # the product of 1e-9 and 2e-9, halved, must not vanish against 1
    rotation = se3.exp_rotation([1e-9, 2e-9, 0.0])
    assert rotation[0, 1] == pytest.approx(1e-18, rel=1e-12)
    assert rotation[2, 1] == pytest.approx(1e-9, rel=1e-15)


def test_log_is_the_inverse_of_exp_from_zero_to_half_a_turn():
    for vector in VECTORS:
        # built by scipy, through a quaternion
        back = se3.log_rotation(Rotation.from_rotvec(vector).as_matrix())
        if np.linalg.norm(vector) > math.pi - 1e-14:
            back = back * np.sign(back @ vector)
        np.testing.assert_allclose(back, vector, rtol=0, atol=2e-15)
        assert np.linalg.norm(back) <= math.pi * (1 + 1e-15)


def test_log_of_small_rotations_keeps_relative_accuracy():
    for size in (1e-15, 1e-12, 1e-9, 1e-6, 1e-3):
        vector = size * np.array([1.0, -2.0, 0.5])
        np.testing.assert_allclose(se3.log_rotation(se3.exp_rotation(vector)), vector, rtol=2e-15, atol=0)


def test_log_of_exact_half_turns():
    for axis in np.eye(3):
        turn = se3.log_rotation(2 * np.outer(axis, axis) - np.eye(3))
        np.testing.assert_allclose(np.abs(turn), math.pi * axis, rtol=0, atol=1e-15)


def test_left_jacobian_against_pinocchio():
    # Pinocchio's Jexp3 is the right Jacobian; the left one is that of the opposite vector
    for vector in VECTORS:
        np.testing.assert_allclose(se3.left_jacobian(vector), pin.Jexp3(-vector), rtol=0, atol=1e-14)


def test_left_jacobian_inverse_against_pinocchio():
    # not below 0.2 rad: Pinocchio loses 7e-11 at 1 mrad
    for direction in DIRECTIONS:
        for angle in (0.2, 0.7, 1.5, 2.9):
            expected = pin.Jlog3(pin.exp3(-angle * direction))
            np.testing.assert_allclose(se3.left_jacobian_inverse(angle * direction), expected, rtol=0, atol=1e-13)


def test_left_jacobian_inverse_by_its_series():
    # 1 - K/2 + K²/12 (1 + φ²/60 + φ⁴/2520 + …), K the cross product: Bernoulli's numbers
    for angle in (0.0, 1e-12, 1e-6, 1e-3, 0.04, 0.06, 0.1):
        for direction in DIRECTIONS:
            cross = np.array([np.cross(angle * direction, unit) for unit in np.eye(3)]).T
            share = 1 + angle**2 / 60 + angle**4 / 2520 + angle**6 / 100800
            expected = np.eye(3) - cross / 2 + cross @ cross / 12 * share
            np.testing.assert_allclose(se3.left_jacobian_inverse(angle * direction), expected, rtol=0, atol=1e-15)


def test_samples_last_is_the_same_as_one_by_one():
    values = np.random.default_rng(2).normal(size=(6, 20))
    functions = [(function, VECTORS.T) for function in (se3.exp_rotation, se3.left_jacobian, se3.skew)]
    functions += [(se3.log_rotation, se3.exp_rotation(VECTORS.T)), (se3.displacement, values)]
    for function, given in functions:
        whole = function(given)
        one_by_one = np.stack([function(given[..., k]) for k in range(given.shape[-1])], axis=-1)
        np.testing.assert_allclose(whole, one_by_one, rtol=0, atol=1e-15)
    for samples in (0, 1):
        assert se3.log_rotation(se3.exp_rotation(np.zeros((3, samples)))).shape == (3, samples)
        assert se3.compose(np.eye(4), se3.displacement(np.zeros((6, samples)))).shape == (4, 4, samples)
    a, b = np.random.default_rng(1).normal(size=(2, 3))
    np.testing.assert_allclose(se3.skew(a) @ b, np.cross(a, b), rtol=0, atol=1e-15)


def test_displacement_is_translation_then_rotation():
    values = np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    expected = pin.SE3(np.eye(3), values[:3]) * pin.SE3(pin.exp3(values[3:]), np.zeros(3))
    np.testing.assert_allclose(se3.displacement(values), expected.homogeneous, rtol=0, atol=1e-15)
    # the exponential of SE(3) is another thing, unless it only turns or only shifts
    assert np.abs(se3.displacement(values) - pin.exp6(pin.Motion(values)).homogeneous).max() > 0.01
    for pure in (values * [1, 1, 1, 0, 0, 0], values * [0, 0, 0, 1, 1, 1]):
        expected = pin.exp6(pin.Motion(pure))
        np.testing.assert_allclose(se3.displacement(pure), expected.homogeneous, rtol=0, atol=1e-15)


def test_compose_mixes_single_poses_and_samples():
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


def test_pose_and_translation_broadcast_samples():
    rotations = se3.exp_rotation(VECTORS.T)
    positions = np.random.default_rng(3).normal(size=(3, len(VECTORS)))
    for turns, places in ((rotations[:, :, 50], positions), (rotations, positions[:, 4]), (rotations, positions)):
        made = se3.pose(turns, places)
        np.testing.assert_array_equal(made[:3, :3].T, np.broadcast_to(turns.T, made[:3, :3].T.shape))
        np.testing.assert_array_equal(made[:3, 3].T, np.broadcast_to(places.T, made[:3, 3].T.shape))
        np.testing.assert_array_equal(made[3].T, np.tile([0, 0, 0, 1], (len(VECTORS), 1)))
    np.testing.assert_array_equal(se3.translation([1, 2, 3])[:3, 3], [1, 2, 3])
    np.testing.assert_array_equal(se3.translation(positions)[:3, 3], positions)


def test_adjoint_against_pinocchio():
    for motion in random_poses(5, seed=9):
        np.testing.assert_allclose(se3.adjoint(motion.homogeneous), motion.action, rtol=0, atol=1e-15)


def test_rotation_about_an_axis_against_pinocchio():
    angles = np.array([-7.0, -math.pi, -1e-9, 0.0, 0.3, math.pi / 2, 3.0])
    for direction in DIRECTIONS:
        whole = se3.rotation_about(direction, angles)
        for k, angle in enumerate(angles):
            expected = pin.AngleAxis(float(angle), direction).matrix()
            np.testing.assert_allclose(se3.rotation_about(direction, angle), expected, rtol=0, atol=2e-15)
            np.testing.assert_allclose(whole[:, :, k], expected, rtol=0, atol=2e-15)


def test_rpy_against_pinocchio_and_by_order():
    for rpy in ([0.1, 0.2, 0.3], [-math.pi / 2, 0, 0], [3.0, -1.5, 2.0], [0, math.pi / 2, 1.0]):
        np.testing.assert_allclose(se3.rpy_rotation(rpy), pin.rpy.rpyToMatrix(np.array(rpy)), rtol=0, atol=1e-15)
    # URDF turns about fixed axes x, y, z in this order: a roll of 90° takes y to z, where the yaw leaves it;
    # it leaves x, which the yaw takes to y
    turned = se3.rpy_rotation([math.pi / 2, 0, math.pi / 2])
    np.testing.assert_allclose(turned @ [0, 1, 0], [0, 0, 1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(turned @ [1, 0, 0], [0, 1, 0], rtol=0, atol=1e-15)
