# SPDX-License-Identifier: Apache-2.0
"""Camera: poses, intrinsics, frustum planes, validation."""

import math

import numpy as np
import pytest

from dynamics.rotation import matrix_from_quaternion
from tiscene.errors import ArgumentError
from tiscene.scene.camera import Camera, quaternion_from_matrix


def random_quaternions(count: int) -> np.ndarray:
    quaternions = np.random.default_rng(3).normal(size=(count, 4))
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


def test_quaternion_and_matrix_conversions_are_inverse():
    # Half turns about the axes are where the largest component of the quaternion changes.
    special = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 0.6, 0.8, 0), (0.5, 0.5, 0.5, 0.5)]
    for quaternion in [*special, *random_quaternions(200)]:
        matrix = matrix_from_quaternion(tuple(quaternion))
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
        assert math.isclose(np.linalg.det(matrix), 1.0)
        back = quaternion_from_matrix(matrix)
        assert back[0] >= 0.0
        np.testing.assert_allclose(matrix_from_quaternion(back), matrix, atol=1e-12)


def test_quarter_turn_about_y_turns_left():
    half = math.sqrt(0.5)
    np.testing.assert_allclose(matrix_from_quaternion((half, 0, half, 0)) @ (0, 0, -1), (-1, 0, 0), atol=1e-12)


def test_intrinsics_follow_opencv():
    K = Camera(vertical_fov=math.radians(90.0)).intrinsics(640, 480)
    np.testing.assert_allclose(K, [[240, 0, 319.5], [0, 240, 239.5], [0, 0, 1]])
    # The direction half a pixel above the top row's centers is the upper edge of the view: 45 degrees.
    np.testing.assert_allclose((-0.5 - K[1, 2]) / K[1, 1], -1.0)


def project(camera: Camera, point, width: int, height: int) -> np.ndarray:
    x, y, z = np.linalg.inv(camera.world_from_camera())[:3] @ (*point, 1.0)
    u, v, w = camera.intrinsics(width, height) @ (x, y, z)
    return np.array([u / w, v / w, z])


def test_look_at_centers_the_target_and_keeps_the_horizon_level():
    camera = Camera.look_at((3.0, 2.0, 1.0), (-1.0, 0.5, -2.0))
    distance = np.linalg.norm(np.subtract(camera.position, (-1.0, 0.5, -2.0)))
    np.testing.assert_allclose(project(camera, (-1.0, 0.5, -2.0), 64, 48), (31.5, 23.5, distance))
    assert project(camera, (-1.0, 0.6, -2.0), 64, 48)[1] < 23.5
    assert abs(camera.axes()[1, 0]) < 1e-12, "the horizon is level"


def test_camera_axes_follow_usd_and_opencv():
    camera = Camera(position=(1.0, 2.0, 3.0))
    np.testing.assert_allclose(camera.axes(), np.eye(3))
    np.testing.assert_allclose(camera.world_from_camera() @ (0, 0, 5, 1), (1, 2, -2, 1))
    np.testing.assert_allclose(camera.world_from_camera() @ (0, 1, 0, 1), (1, 1, 3, 1))


def test_frustum_contains_exactly_the_points_in_the_image():
    camera = Camera.look_at((3.0, 2.0, 1.0), (-1.0, 0.5, -2.0), vertical_fov=0.9, near=0.5, far=6.0)
    width, height = 64, 48
    planes = camera.frustum_planes(width / height)
    assert planes.shape == (6, 4)
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1.0)
    points = np.random.default_rng(1).uniform(-6.0, 6.0, (2000, 3))
    inside = (points @ planes[:, :3].T + planes[:, 3] >= 0.0).all(axis=1)
    seen = []
    for point in points:
        u, v, z = project(camera, point, width, height)
        seen.append(0.5 <= z <= 6.0 and -0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5)
    np.testing.assert_array_equal(inside, seen)
    assert 20 < inside.sum() < 1000
    shorter = camera.frustum_planes(width / height, far=2.0)
    np.testing.assert_allclose(shorter[:5], planes[:5])
    np.testing.assert_allclose(planes[5, 3] - shorter[5, 3], 4.0)


def test_frustum_planes_are_in_the_documented_order():
    left, right, bottom, top, near, far = Camera(position=(0, 0, 0)).frustum_planes(1.5)
    assert left[0] > 0 > right[0]
    assert bottom[1] > 0 > top[1]
    np.testing.assert_allclose(near, (0, 0, -1, -0.1), atol=1e-12)
    np.testing.assert_allclose(far, (0, 0, 1, 1000.0), atol=1e-12)


def test_with_pose_keeps_all_other_attributes():
    camera = Camera(vertical_fov=0.5, exposure=1.5, name="Front")
    moved = camera.with_pose((1, 2, 3), (0, 0, 2, 0))
    assert moved.position == (1.0, 2.0, 3.0)
    assert moved.rotation == (0.0, 0.0, 1.0, 0.0)
    assert (moved.vertical_fov, moved.exposure, moved.name) == (0.5, 1.5, "Front")


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_framing_shows_the_whole_box_and_fills_the_image(up):
    low, high = (-1.0, 0.0, -2.0), (3.0, 1.0, 1.0)
    camera = Camera.framing(low, high, up)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    uvz = np.array([project(camera, corner, 256, 192) for corner in corners])
    assert (uvz[:, 2] > 0).all()
    assert ((uvz[:, :2] >= -0.5) & (uvz[:, :2] <= (255.5, 191.5))).all()
    assert np.ptp(uvz[:, 0]) > 100 or np.ptp(uvz[:, 1]) > 75


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"position": (0.0, math.nan, 0.0)}, "must be finite"),
        ({"position": (0.0, 1e308, 0.0)}, "must be numbers of at most 3.4e"),
        ({"position": {1, 2, 3}}, "must be finite numbers, 3"),
        ({"position": b"abc"}, "must be finite numbers, 3"),
        ({"rotation": (0.0, 0.0, 0.0, 0.0)}, "not a quaternion"),
        ({"rotation": (0.0, 30.0, 0.0)}, r"must be a quaternion \(w, x, y, z\); `Camera.look_at`"),
        ({"vertical_fov": 0.0}, "between 0 and pi"),
        ({"vertical_fov": 60.0}, "between 0 and pi"),
        ({"vertical_fov": "wide"}, "vertical_fov='wide': must be a number"),
        ({"lens_radius": -0.1}, "lens_radius"),
        ({"focus_distance": 0.0}, "focus_distance"),
        ({"near": 2.0, "far": 1.0}, "0 < near < far"),
        ({"far": 10**400}, "must be finite"),
    ],
)
def test_invalid_cameras_are_refused(fields, message):
    with pytest.raises(ArgumentError, match=f"camera 'Front': .*{message}"):
        Camera(name="Front", **fields)


@pytest.mark.parametrize("name", [3, "a\ud800"])
def test_name_must_be_encodable(name):
    with pytest.raises(ArgumentError, match=r"name=.*: must be a string without lone surrogates"):
        Camera(name=name)


def test_look_at_along_up_is_refused():
    with pytest.raises(ArgumentError, match="do not span a plane"):
        Camera.look_at((0, 2, 0), (0, 0, 0))


@pytest.mark.parametrize("places", [("abc", (0, 0, 0)), ((0, 0), (1, 1)), ((0, 0, math.inf), (0, 0, 0))])
def test_look_at_refuses_positions_that_are_not_three_finite_numbers(places):
    with pytest.raises(ArgumentError, match=r"look_at: position=.*: must be finite numbers, 3 of them"):
        Camera.look_at(*places)


def test_camera_with_unhashable_dynamic_is_hashable():
    """Views are cached by their cameras, and a user's dynamic may hold lists."""
    moved = Camera(dynamic=["of a user"])
    assert hash(moved) == hash(Camera())
    assert moved != Camera()
