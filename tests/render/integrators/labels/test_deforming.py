# SPDX-License-Identifier: Apache-2.0
"""Labels of deforming meshes, and refitted BVHs."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.render.label_scenes import ALL_TIMES, PlacedMesh, Stage, mesh_of, plate, pose, static_view
from tests.render.tracing import described, placed, rays_of, scene_of, shape, trace_rays
from tiscene.frame.buffers import LABELS
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.animation import Deformation
from tiscene.scene.camera import Camera
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

WIDTH, HEIGHT, FOCAL = 64, 48, 40.0
CAMERA = Camera(position=(0.0, 0.0, 0.0), vertical_fov=2 * np.arctan(0.5 * HEIGHT / FOCAL))
VIEW = static_view(CAMERA, WIDTH, HEIGHT)
SECONDS = np.array([0.25, 0.5, 0.75])


def stretching(width: float = 2.0, height: float = 1.0):
    """Return a plate that doubles its width about its middle line and comes one meter nearer within one second."""
    still_plate = plate(width, height)
    start = still_plate.positions
    end = start * np.array([2.0, 1.0, 1.0], np.float32) + np.array([0.0, 0.0, 1.0], np.float32)
    return replace(still_plate, deformation=Deformation(np.array([0.0, 1.0]), np.stack([start, end])))


def pixel_of(point):
    """Project world points to px."""
    return np.array([point[..., 0], -point[..., 1]]).transpose(1, 2, 0) / -point[..., 2:] * FOCAL + (31.5, 23.5)


def test_flow_follows_surface_points():
    """Closed form: x scales by 1 + t, z grows by t."""
    stage = Stage([stretching()], [PlacedMesh(0, [pose((0.1, 0.0, -5.0))])])
    stage.scene.place(replace(stage.placement, seconds=SECONDS), ALL_TIMES)
    labels = stage.render(VIEW, *LABELS)
    hit = labels["instance"] > 0
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    depth = 5.0 - 0.5
    at_half = np.stack([(x - 31.5) / FOCAL * depth, (23.5 - y) / FOCAL * depth, np.full(x.shape, -depth)], axis=-1)
    assert hit.sum() == (np.abs(at_half[..., 0] - 0.1) < 1.5)[hit.any(axis=1)].sum()
    np.testing.assert_allclose(labels["depth"][hit], depth, rtol=1e-6)
    for name, seconds in (("forward_flow", 0.75), ("backward_flow", 0.25)):
        then = at_half.copy()
        then[..., 0] = 0.1 + (at_half[..., 0] - 0.1) / 1.5 * (1.0 + seconds)
        then[..., 2] += seconds - 0.5
        np.testing.assert_allclose(labels[name][hit], (pixel_of(then) - np.stack([x, y], axis=-1))[hit], atol=1e-4)
        if name == "forward_flow":
            np.testing.assert_allclose(labels["scene_flow"][hit], (then - at_half)[hit], atol=1e-6)
    np.testing.assert_allclose(labels["position"][hit], at_half[hit], atol=1e-5)


def test_flow_combines_deformation_instance_and_camera_motion():
    """A sphere that grows by deformation equals the same sphere scaled by its instance, before a moving camera."""
    ball = mesh_of(trimesh.creation.icosphere(subdivisions=2, radius=0.5), smooth=True)
    grown = np.stack([ball.positions, ball.positions * np.float32(2.0)])
    growing = replace(ball, deformation=Deformation(np.array([0.0, 1.0]), grown, np.stack([ball.normals] * 2)))
    cameras = [replace(CAMERA, position=(0.1 * time, 0.05 * time, 0.0)) for time in (-1, 0, 1)]
    view = View(*cameras, WIDTH, HEIGHT)
    poses = [pose((0.05 * time, 0.0, -3.0), (1.0, 0.1 * time, 0.0, 0.0)) for time in (-1, 0, 1)]
    scaled = [each @ np.diag([1 + s, 1 + s, 1 + s, 1]) for each, s in zip(poses, SECONDS, strict=True)]
    behind = PlacedMesh(1, [pose((0, 0, -6))])
    one = Stage([growing, plate(20.0, 20.0)], [PlacedMesh(0, poses), behind])
    one.scene.place(replace(one.placement, seconds=SECONDS), ALL_TIMES)
    other = Stage([ball, plate(20.0, 20.0)], [PlacedMesh(0, scaled), behind])
    names = [name for name in LABELS if name not in ("object_coordinates",)]
    got, expected = one.render(view, *names), other.render(view, *names)
    np.testing.assert_array_equal(got["instance"], expected["instance"])
    for name in names:
        near = np.isclose(got[name].astype(float), expected[name].astype(float), atol=2e-5, equal_nan=True)
        assert near.mean() > 0.999, name


def test_occlusion_uses_shape_at_other_time():
    """A strip that grows in front of a static wall occludes at the next frame what it will cover."""
    strip = plate(1.0, 10.0)
    wide = strip.positions * np.array([3.0, 1.0, 1.0], np.float32)
    growing = replace(strip, deformation=Deformation(np.array([0.0, 1.0]), np.stack([strip.positions, wide])))
    stage = Stage(
        [growing, plate(20.0, 20.0)], [PlacedMesh(0, [pose((0, 0, -4))]), PlacedMesh(1, [pose((0, 0, -4.5))])]
    )
    stage.scene.place(replace(stage.placement, seconds=np.array([0.0, 0.0, 1.0])), ALL_TIMES)
    labels = stage.render(VIEW, "instance", "forward_occlusion", "backward_occlusion")
    x = (np.arange(WIDTH) - 31.5) / FOCAL * 4.0
    np.testing.assert_array_equal(labels["instance"][24], np.where(np.abs(x) < 0.5, 1, 2))
    np.testing.assert_array_equal(
        labels["forward_occlusion"][24], ((np.abs(x) > 0.5) & (np.abs(x) < 1.5)) | (np.abs(x) * 3.0 > 31.5 / 10.0 * 4.0)
    )
    assert not labels["backward_occlusion"][24].any()


def test_static_points_of_deforming_mesh_have_zero_flow():
    square = plate(2.0, 2.0)
    end = square.positions.copy()
    end[2:, 1] += 0.5
    rising = replace(square, deformation=Deformation(np.array([0.0, 1.0]), np.stack([square.positions, end])))
    stage = Stage([rising], [PlacedMesh(0, [pose((0, 0, -3))])])
    for seconds in ((0.0, 0.0, 0.0), (2.0, 3.0, 4.0)):
        stage.scene.place(replace(stage.placement, seconds=np.array(seconds)), ALL_TIMES)
        labels = stage.render(VIEW, "instance", "forward_flow", "backward_flow", "scene_flow")
        assert labels["instance"].any()
        assert not any(labels[name].any() for name in ("forward_flow", "backward_flow", "scene_flow"))


@pytest.mark.parametrize("traversal", ["bvh8", "bvh2"])
def test_refitted_bvh_finds_same_hits_as_new_one(traversal):
    """A sphere whose vertices move randomly, in several instances; its triangles begin degenerate."""
    random = np.random.default_rng(3)
    ball = shape(trimesh.creation.icosphere(subdivisions=3))
    displaced = (ball.positions * random.uniform(0.3, 2.0, (len(ball.positions), 1))).astype(np.float32)
    samples = np.stack([np.zeros_like(displaced), displaced, ball.positions])
    deforming = replace(ball, positions=samples[0], deformation=Deformation(np.array([0.0, 1.0, 2.0]), samples))
    matrices = [pose((0, 0, 0)), pose((3, 1, 0), (0.3, 1, 0, 0.2), 0.5)]
    placement = placed([0, 0], matrices)
    rays = rays_of(random.uniform(-6, 6, (2000, 3)), random.normal(size=(2000, 3)))
    scene = scene_of((deforming,), placement, traversal)
    for seconds in (2.0, 0.5, 1.0, 0.0):
        scene.place(replace(placement, seconds=np.array([0.0, seconds, 2.0])), ALL_TIMES)
        still_one = replace(ball, positions=deforming.deformation.at(seconds)[0])
        got, expected = trace_rays(scene, rays), trace_rays(scene_of((still_one,), placement, traversal), rays)
        for name in ("t", "instance", "triangle", "occluded"):
            np.testing.assert_array_equal(getattr(got, name), getattr(expected, name), name)
    assert trace_rays(scene, rays, NEXT).instance.max() == 1
    assert trace_rays(scene, rays, PREVIOUS).instance.max() == -1


def test_labels_do_not_depend_on_earlier_placements():
    made = []
    for order in ((0.1, 0.9, 0.4), (0.4,)):
        stage = Stage([stretching()], [PlacedMesh(0, [pose((0.1, 0.0, -5.0))])])
        for seconds in order:
            times = np.array([seconds - 0.1, seconds, seconds + 0.1])
            stage.scene.place(replace(stage.placement, seconds=times), (CURRENT,) if seconds == 0.9 else ALL_TIMES)
        made.append(stage.render(VIEW, *LABELS))
    for name in LABELS:
        np.testing.assert_array_equal(made[0][name], made[1][name], name)


def test_adding_meshes_does_not_change_deforming_mesh():
    scene = DeviceScene()
    scene.add(described(stretching()))
    placement = replace(placed([0], pose((0, 0, -5))[None]), seconds=SECONDS)
    scene.place(placement)
    before = LabelPass(scene).render(VIEW, ("depth", "forward_flow"))
    scene.add(described(plate(1.0, 1.0)))
    scene.place(placement)
    after = LabelPass(scene).render(VIEW, ("depth", "forward_flow"))
    for name, values in before.items():
        np.testing.assert_array_equal(values, after[name])
