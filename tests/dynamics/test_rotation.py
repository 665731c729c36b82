# SPDX-License-Identifier: Apache-2.0
"""Quaternions and Euler angles, against scipy and the definitions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynamics import rotation
from tests.reference import motion

RANDOM = np.random.default_rng(7)
UNIT = Rotation.random(50, random_state=3).as_quat()[:, [3, 0, 1, 2]]


def as_scipy(quaternions: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternions[..., [1, 2, 3, 0]])


def test_euler_angles_rotate_about_fixed_z_then_x_then_y():
    degrees = RANDOM.uniform(-400, 400, (50, 3))
    ours = rotation.quaternion_from_euler(degrees)
    theirs = Rotation.from_euler("zxy", degrees[:, [2, 0, 1]], degrees=True)
    np.testing.assert_allclose(rotation.matrix_from_quaternion(ours), theirs.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(ours, [motion.quaternion_of_euler(each) for each in degrees], atol=1e-15)


@pytest.mark.parametrize(
    ("degrees", "direction"),
    [
        ((90, 0, 0), (0, 1, 0)),  # pitch: looks up
        ((0, 90, 0), (-1, 0, 0)),  # yaw: turns left
        ((0, 0, 90), (0, 0, -1)),  # roll: direction unchanged
        ((30, 90, 0), (-np.cos(np.pi / 6), 0.5, 0)),
    ],
)
def test_euler_angles_point_minus_z_in_documented_direction(degrees, direction):
    turned = rotation.rotate(rotation.quaternion(degrees), (0, 0, -1))
    np.testing.assert_allclose(turned, direction, atol=1e-15)


def test_multiply_conjugate_and_rotate_match_scipy():
    a, b = UNIT[:25], UNIT[25:]
    np.testing.assert_allclose(
        as_scipy(rotation.multiply(a, b)).as_matrix(), (as_scipy(a) * as_scipy(b)).as_matrix(), atol=1e-14
    )
    np.testing.assert_allclose(
        rotation.multiply(a, rotation.conjugate(a)), np.tile([1.0, 0, 0, 0], (25, 1)), atol=1e-15
    )
    vectors = RANDOM.normal(size=(25, 3))
    np.testing.assert_allclose(rotation.rotate(a, vectors), as_scipy(a).apply(vectors), atol=1e-14)
    np.testing.assert_allclose(rotation.matrix_from_quaternion(a), as_scipy(a).as_matrix(), atol=1e-14)


def test_log_is_half_scipys_rotation_vector_and_exp_inverts_it():
    positive = rotation.aligned(UNIT, [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(2 * rotation.log(positive), as_scipy(positive).as_rotvec(), atol=1e-13)
    np.testing.assert_allclose(rotation.exp(rotation.log(positive)), positive, atol=1e-15)
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    assert rotation.log(identity).tolist() == [0.0, 0.0, 0.0]
    assert rotation.exp(np.zeros(3)).tolist() == identity.tolist()


def test_squad_controls_match_shoemakes_formula():
    loop = UNIT[:6]
    expected = [motion.squad_control(loop[i - 1], loop[i], loop[(i + 1) % 6]) for i in range(6)]
    np.testing.assert_allclose(rotation.squad_controls(loop), expected, atol=1e-14)


def test_squad_controls_of_uniform_turn_equal_the_quaternions():
    turn = rotation.quaternion_from_euler([(0, 40 * i, 0) for i in range(9)])
    np.testing.assert_allclose(rotation.squad_controls(turn), turn, atol=1e-15)


def test_quaternion_of_any_length_is_normalized():
    np.testing.assert_allclose(rotation.quaternion((0, 0, 3, 4)), (0, 0, 0.6, 0.8))
