# SPDX-License-Identifier: Apache-2.0
"""Orthographic cameras: labels, path tracing, culling and sampling without perspective."""

from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.randomization.test_free_space import is_free
from tests.render.annotations.test_object_measurements import table
from tests.render.label_scenes import PlacedMesh, Stage, plate, pose, static_view
from tiscene.errors import ArgumentError
from tiscene.frame.buffers import LABELS
from tiscene.randomization.free_space import FreeSpace
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.description import Instance, Material, SceneDescription, SceneObject
from tiscene.world.frustum_test import in_view

WIDTH, HEIGHT = 64, 48
CAMERA = ts.Camera(position=(0.0, 0.0, 5.0), orthographic_height=4.8)  # 0.1 m a pixel
VIEW = static_view(CAMERA, WIDTH, HEIGHT)


def centers():
    """Return the pixel centers relative to the image center, m right and up."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return (x - 31.5) * 0.1, (23.5 - y) * 0.1


@pytest.mark.parametrize("depth", [0.5, 3.0, 400.0])
def test_plate_size_does_not_depend_on_distance(depth):
    stage = Stage([plate(2.0, 1.0)], [PlacedMesh(0, [pose((0.5, 0.2, 5.0 - depth))])])
    labels = stage.render(VIEW, *LABELS)
    right, up = centers()
    hit = (np.abs(right - 0.5) < 1.0) & (np.abs(up - 0.2) < 0.5)
    np.testing.assert_array_equal(labels["instance"] == 1, hit)
    for name in ("depth", "distance"):
        np.testing.assert_allclose(labels[name][hit], depth, rtol=1e-6)
    position = np.stack([right, up, np.full_like(up, 5.0 - depth)], axis=-1)
    np.testing.assert_allclose(labels["position"][hit], position[hit], atol=1e-4)
    assert not labels["forward_flow"].any()


def test_geometry_behind_camera_is_not_visible():
    stage = Stage([plate(20.0, 20.0)], [PlacedMesh(0, [pose((0, 0, 5.5))])])
    assert not stage.render(VIEW, "instance")["instance"].any()


def test_flow_has_no_perspective():
    """0.1 m are one pixel at any distance. Motion along the axis gives no flow."""
    instances = [
        PlacedMesh(0, [pose((0.1 * step, y + 0.05 * step, z + step)) for step in (-1, 0, 1)])
        for y, z in ((0.0, 3.0), (1.5, -20.0))
    ]
    stage = Stage([plate(6.4, 1.0)], instances)
    labels = stage.render(VIEW, "instance", "forward_flow", "backward_flow")
    for number in (1, 2):
        hit = labels["instance"] == number
        assert hit.sum() > 100
        np.testing.assert_allclose(labels["forward_flow"][hit], np.tile((1.0, -0.5), (hit.sum(), 1)), atol=1e-4)
        np.testing.assert_allclose(labels["backward_flow"][hit], np.tile((-1.0, 0.5), (hit.sum(), 1)), atol=1e-4)


def test_flow_of_translating_and_rolling_camera():
    """Objects at any distance rotate with the image, and so does the background."""
    angle = np.radians(5.0)
    rolled = replace(CAMERA, rotation=(np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)), position=(0.2, 0.0, 6.0))
    stage = Stage([plate(2.0, 3.0)], [PlacedMesh(0, [pose((0.5, 0.2, -2.0))])])
    labels = stage.render(View(CAMERA, CAMERA, rolled, WIDTH, HEIGHT), "instance", "forward_flow")
    right, up = centers()
    hit = labels["instance"] == 1
    for shift, where in ((0.2, hit), (0.0, ~hit)):
        x, y = right - shift, up
        turned = np.stack([np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y], axis=-1)
        moved = (turned - np.stack([right, up], axis=-1)) * (10.0, -10.0)
        np.testing.assert_allclose(labels["forward_flow"][where], moved[where], atol=1e-4)


def test_occlusion_uses_parallel_rays():
    """A plate occludes the wall straight behind it, at any distance."""
    poses = [pose((step * 1.0, 0.0, 3.0)) for step in (0, 0, 1)]
    stage = Stage([plate(1.0, 10.0), plate(30.0, 30.0)], [PlacedMesh(0, poses), PlacedMesh(1, [pose((0, 0, -50))])])
    labels = stage.render(VIEW, "instance", "forward_occlusion")
    right, _ = centers()
    wall = labels["instance"] == 2
    np.testing.assert_array_equal(labels["forward_occlusion"][wall], (np.abs(right - 1.0) < 0.5)[wall])


def test_objects_are_measured_without_perspective():
    stage = Stage([plate(2.0, 1.0)], [PlacedMesh(0, [pose((3.0, 0.2, -30.0))])])

    (row,) = table(stage, VIEW)
    np.testing.assert_allclose(row.amodal_box, (52.0, 17.0, 72.0, 27.0), atol=1e-4)
    assert row.amodal_pixels == 200
    assert row.fraction_in_frame == pytest.approx(0.6)


def test_path_tracing_uses_parallel_rays():
    """An emissive plate has its size at any distance."""
    stage = Stage(
        [plate(2.0, 1.0)],
        [PlacedMesh(0, [pose((0.5, 0.2, -90.0))])],
        [Material("lamp", emissive_color=(2.0, 1.0, 0.5))],
    )
    paths = PathPass(stage.scene, WIDTH, HEIGHT)
    hdr = paths.render(VIEW, frame_index=0, seed=1, spp=4, max_depth=2).hdr
    right, up = centers()
    inside = (np.abs(right - 0.5) < 0.9) & (np.abs(up - 0.2) < 0.4)
    outside = (np.abs(right - 0.5) > 1.1) | (np.abs(up - 0.2) > 0.6)
    np.testing.assert_allclose(hdr[inside], np.tile((2.0, 1.0, 0.5), (inside.sum(), 1)), rtol=1e-5)
    assert not hdr[outside].any()


def test_frustum_planes_form_a_box():
    planes = CAMERA.frustum_planes(WIDTH / HEIGHT)

    def inside(*point):
        return bool((planes[:, :3] @ point + planes[:, 3] >= 0.0).all())

    for z in (4.0, -900.0):
        assert inside(3.19, 2.39, z)
        assert not inside(3.21, 0.0, z)
        assert not inside(0.0, -2.41, z)
    assert not inside(0.0, 0.0, 5.0)


def test_in_view():
    boxes = np.tile([[-0.1] * 3, [0.1] * 3], (5, 1, 1))
    poses = np.array([pose(at) for at in ((3.2, 0, 0), (3.4, 0, 0), (0, 2.45, -900), (0, 2.55, -900), (0, 0, 5.2))])
    assert in_view(CAMERA, WIDTH / HEIGHT, boxes, poses).tolist() == [True, False, True, False, False]


def test_intrinsics_are_pixels_per_meter():
    K = CAMERA.intrinsics(WIDTH, HEIGHT)
    np.testing.assert_allclose(K, [[10, 0, 31.5], [0, 10, 23.5], [0, 0, 1]])


def test_free_space():
    wall = replace(plate(9.0, 9.0), name="wall")
    behind = np.eye(4)
    behind[2, 3] = 9.0
    walls = (Instance(0, 0, np.eye(4)), Instance(0, 0, behind))
    stage = SceneDescription("test", (wall,), (Material("gray"),), instances=walls, objects=(SceneObject("w", "/w"),))
    space = FreeSpace(stage, CAMERA, WIDTH / HEIGHT)
    points = space.points(np.array([0.5, 1.0]), np.array([0.5, 0.0]), np.array([1.0, 4.0]))
    np.testing.assert_allclose(points, [(0, 0, 4), (3.2, 2.4, 1)], atol=1e-12)
    np.testing.assert_allclose(space.project(points), [(0.5, 1.0), (0.5, 0.0), (1.0, 4.0)])
    assert space.in_view(np.array([(3.1, 0, 1), (3.3, 0, 1), (0, 0, 6)])).tolist() == [True, False, False]
    assert is_free(space, np.array([(0, 0, 2.0), (0, 0, 0.2)]), 0.5).tolist() == [True, False]


def test_invalid_orthographic_cameras_raise():
    with pytest.raises(ArgumentError, match=r"orthographic_height=0\.0: must be greater than 0 m"):
        ts.Camera(orthographic_height=0)
    with pytest.raises(ArgumentError, match="an orthographic camera has none"):
        ts.Camera(orthographic_height=1.0, lens_radius=0.1)
