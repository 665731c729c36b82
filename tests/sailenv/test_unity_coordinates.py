# SPDX-License-Identifier: Apache-2.0
"""Conversions between Unity's space and tiscene's, against left-handed rotation matrices."""

import numpy as np
import pytest

from tiscene.sailenv.unity_coordinates import euler_of, flow_of, mirrored, mirrored_euler, quaternion_of
from tiscene.scene.camera import Camera

ANGLES = [(0, 0, 0), (18, -12, 0), (22, 144, 0), (-35, 250, 70), (180 - 30, 10, 180), (89.9, 33, -5)]
MIRROR = np.diag([1.0, 1.0, -1.0])


def unity_matrix(degrees):
    """Return Unity's rotation matrix in its own space: about z, then x, then y.

    A positive angle turns y to z, z to x and x to y, by the same formulas as in a right-handed space.
    """
    (a, b, c), one = np.radians(degrees), np.eye(3)

    def turn(axis, angle):
        matrix = one.copy()
        i, j = (axis + 1) % 3, (axis + 2) % 3
        matrix[[i, j], [i, j]] = np.cos(angle)
        matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
        return matrix

    return turn(1, b) @ turn(0, a) @ turn(2, c)


@pytest.mark.parametrize("degrees", ANGLES)
def test_rotations_are_unitys_mirrored(degrees):
    axes = Camera(rotation=quaternion_of(degrees)).axes()
    np.testing.assert_allclose(axes, MIRROR @ unity_matrix(degrees) @ MIRROR, atol=1e-12)


def test_positive_pitch_looks_down_and_positive_yaw_turns_right():
    def forward(*degrees):
        return mirrored(tuple(-Camera(rotation=quaternion_of(degrees)).axes()[:, 2]))

    np.testing.assert_allclose(forward(0, 0, 0), (0, 0, 1), atol=1e-15)
    assert forward(20, 0, 0)[1] < 0.0
    assert forward(0, 20, 0)[0] > 0.0


def test_quaternion_follows_the_rule_of_sailenvs_documentation():
    """Unity's q_y q_x q_z = (x, y, z, w) becomes (-x, -y, z, w)."""
    pitch, yaw = np.radians((18.0, -12.0)) / 2
    x, y, z, w = np.sin(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch) * np.sin(yaw), 0.0
    w = np.cos(pitch) * np.cos(yaw)
    np.testing.assert_allclose(quaternion_of((18.0, -12.0, 0.0)), (w, -x, -y, z), atol=1e-12)


@pytest.mark.parametrize("degrees", [*ANGLES, (90, 40, 0), (-90, 40, 0)])
def test_euler_angles_reproduce_the_rotation(degrees):
    again = euler_of(quaternion_of(degrees))
    assert all(0.0 <= angle < 360.0 for angle in again)
    np.testing.assert_allclose(
        Camera(rotation=quaternion_of(again)).axes(), Camera(rotation=quaternion_of(degrees)).axes(), atol=1e-6
    )


def test_mirroring_twice_is_the_identity_without_negative_zeros():
    assert mirrored(mirrored((1.0, 2.0, 3.0))) == (1.0, 2.0, 3.0)
    assert mirrored_euler(mirrored_euler((10.0, 20.0, 30.0))) == (10.0, 20.0, 30.0)
    assert str(mirrored((0.0, 0.0, 0.0))) == "(0.0, 0.0, 0.0)"
    assert str(mirrored_euler((0.0, 0.0, 0.0))) == "(0.0, 0.0, 0.0)"


def test_flow_of_has_sailenvs_signs_and_no_negative_zeros():
    motion = np.array([[[3.0, 2.0]]], np.float32)  # p(k) - p(k-1): to the right and down
    flow = flow_of(-motion)
    np.testing.assert_array_equal(flow, [[[-3.0, 2.0]]])
    assert flow.flags.writeable
    assert not np.signbit(flow_of(np.zeros((1, 1, 2), np.float32))).any()
