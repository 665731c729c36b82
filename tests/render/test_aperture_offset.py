# SPDX-License-Identifier: Apache-2.0
"""Aperture offsets of cameras: pictures, labels, flow, boxes, culling and files agree on the shifted image."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

import tiscene as ts
from tests.render.annotations.test_object_measurements import table
from tests.render.label_scenes import PlacedMesh, Stage, crowd, plate, pose, static_view
from tests.usd.helpers import read, read_with_warning, write
from tiscene.errors import ArgumentError
from tiscene.frame.buffers import LABELS
from tiscene.randomization.free_space import FreeSpace
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.description import Material, SceneDescription
from tiscene.usd.read.stage_reader import read_stage
from tiscene.world.frustum_test import in_view

WIDTH, HEIGHT = 64, 48
# 24 px are 1 at a distance of 1; the optical axis is at pixel (31.5 - 12, 23.5 - 6): left of the center, and above it.
CAMERA = ts.Camera((0.0, 0.0, 5.0), vertical_fov=0.5 * math.pi, aperture_offset=(0.5, -0.25))
ORTHOGRAPHIC = ts.Camera((0.0, 0.0, 5.0), orthographic_height=4.8, aperture_offset=(0.5, -0.25))  # 10 px a meter
AXIS = {"perspective": (CAMERA, (19.5, 17.5)), "orthographic": (ORTHOGRAPHIC, (26.5, 21.0))}
BODY = """def Camera "Shifted" {
    %s
    float horizontalAperture = 32
    float verticalAperture = 24
    float horizontalApertureOffset = 6
    float verticalApertureOffset = -3
    float focalLength = 12
    double3 xformOp:translate = (1, 2, 5)
    float3 xformOp:rotateXYZ = (-10, 20, 30)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
def Sphere "S" {
    double radius = 0.3
}
"""


def pixel_centers():
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return np.stack([x, y], axis=-1)


def projected(camera: ts.Camera, points):
    """Project world points [..., 3] by the published pose and K alone."""
    inverse = np.linalg.inv(camera.world_from_camera())
    seen = points @ inverse[:3, :3].T + inverse[:3, 3]
    if camera.orthographic_height is not None:
        seen[..., 2] = 1.0
    image = seen @ camera.intrinsics(WIDTH, HEIGHT).T
    return image[..., :2] / image[..., 2:]


@pytest.mark.parametrize("kind", AXIS)
def test_point_on_the_axis_is_seen_at_the_shifted_pixel(kind):
    """A plate at a depth of 5 m, of 1.26 x 0.86 m about the axis: 6.05 x 4.13 px, or 12.6 x 8.6 px."""
    camera, (x, y) = AXIS[kind]
    stage = Stage([plate(1.26, 0.86)], [PlacedMesh(0, [pose()])], [Material("lamp", emissive_color=(2.0, 1.0, 0.5))])
    view = static_view(camera, WIDTH, HEIGHT)
    labels = stage.render(view, *LABELS)
    half = np.array([1.26, 0.86]) * (0.5 * 24.0 / 5.0 if kind == "perspective" else 5.0)
    across = np.abs(pixel_centers() - (x, y))
    np.testing.assert_array_equal(labels["instance"] == 1, (across < half).all(axis=-1))
    hit = labels["instance"] == 1
    np.testing.assert_allclose(labels["depth"][hit], 5.0, rtol=1e-6)
    offset = labels["position"][hit] - np.array(camera.position)
    np.testing.assert_allclose(
        labels["distance"][hit], np.linalg.norm(offset, axis=-1) if kind == "perspective" else 5.0, rtol=1e-6
    )
    np.testing.assert_allclose(labels["normal_camera"][hit], np.tile((0.0, 0.0, -1.0), (hit.sum(), 1)), atol=1e-6)
    assert not labels["forward_flow"][hit].any()
    hdr = PathPass(stage.scene, WIDTH, HEIGHT).render(view, frame_index=0, seed=1, spp=1, max_depth=2).hdr
    inside, outside = (across < half - 1).all(axis=-1), (across > half + 1).any(axis=-1)
    np.testing.assert_allclose(hdr[inside], np.tile((2.0, 1.0, 0.5), (inside.sum(), 1)), rtol=1e-5)
    assert not hdr[outside].any()
    (row,) = table(stage, view)
    box = [x + 0.5 - half[0], y + 0.5 - half[1], x + 0.5 + half[0], y + 0.5 + half[1]]
    np.testing.assert_allclose(row.amodal_box, box, atol=1e-4)


@pytest.mark.parametrize("kind", AXIS)
def test_positions_flow_and_intrinsics_agree_between_cameras_of_different_offsets(kind):
    camera = AXIS[kind][0]
    before = replace(camera, aperture_offset=(0.4, -0.2), position=(0.1, 0.0, 5.2))
    after = replace(camera, aperture_offset=(0.7, -0.3), rotation=(1.0, 0.01, -0.02, 0.03))
    labels = crowd(60).render(View(before, camera, after, WIDTH, HEIGHT), *LABELS)
    hit = labels["instance"] > 0
    assert hit.mean() > 0.2
    now = pixel_centers()
    np.testing.assert_allclose(projected(camera, labels["position"].astype(float))[hit], now[hit], atol=2e-4)
    moved = labels["position"] + labels["scene_flow"]
    expected = (projected(after, moved.astype(float)) - now)[hit]
    np.testing.assert_allclose(labels["forward_flow"][hit], expected, atol=2e-3)


def test_background_flow_is_that_of_points_at_infinity():
    after = replace(CAMERA, aperture_offset=(0.7, -0.3), rotation=(1.0, 0.01, -0.02, 0.03))
    stage = Stage([plate(0.1, 0.1)], [PlacedMesh(0, [pose((0, 0, 9))])])
    flow = stage.render(View(CAMERA, CAMERA, after, WIDTH, HEIGHT), "forward_flow")["forward_flow"]
    now = pixel_centers()
    rays = (
        np.concatenate([now, np.ones((HEIGHT, WIDTH, 1))], axis=-1) @ np.linalg.inv(CAMERA.intrinsics(WIDTH, HEIGHT)).T
    )
    far = rays @ CAMERA.world_from_camera()[:3, :3].T * 1e9
    np.testing.assert_allclose(flow, projected(after, far) - now, atol=1e-3)


def test_occlusion_uses_the_shifted_image():
    """A point that leaves the shifted image is occluded; the image without the offset would show it."""
    poses = [pose((x, 0.0, 0.0)) for x in (0.0, 0.0, -4.5)]  # 24/5 px a meter: from pixel 19.5 to -2.1
    labels = Stage([plate(0.4, 0.4)], [PlacedMesh(0, poses)]).render(
        static_view(CAMERA, WIDTH, HEIGHT), "instance", "forward_occlusion", "backward_occlusion"
    )
    hit = labels["instance"] == 1
    assert hit.any()
    assert labels["forward_occlusion"][hit].all()
    assert not labels["backward_occlusion"][hit].any()


@pytest.mark.parametrize("kind", AXIS)
def test_culling_agrees_with_the_image(kind):
    camera = AXIS[kind][0]
    random = np.random.default_rng(3)
    points = random.uniform((-6, -6, -5), (8, 6, 4.8), (500, 3))
    pixels = projected(camera, points)
    seen = ((pixels > -0.5) & (pixels < np.array([WIDTH, HEIGHT]) - 0.5)).all(axis=1)
    assert 50 < seen.sum() < 450
    planes = camera.frustum_planes(WIDTH / HEIGHT)
    np.testing.assert_array_equal((points @ planes[:, :3].T + planes[:, 3] >= 0.0).all(axis=1), seen)
    boxes = np.tile([[-1e-6] * 3, [1e-6] * 3], (len(points), 1, 1))
    poses = np.array([pose(point) for point in points])
    np.testing.assert_array_equal(in_view(camera, WIDTH / HEIGHT, boxes, poses), seen)
    space = FreeSpace(SceneDescription("empty"), camera, WIDTH / HEIGHT)
    np.testing.assert_array_equal(space.in_view(points), seen)
    x, y, depth = space.project(points)
    np.testing.assert_allclose(space.points(x, y, depth), points, atol=1e-9)
    np.testing.assert_allclose(np.stack([x * WIDTH, y * HEIGHT], axis=1) - 0.5, pixels, atol=1e-6)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_camera_of_a_stage_projects_as_openusd_does(tmp_path, projection):
    path = write(tmp_path, BODY % f'token projection = "{projection}"', meters=0.1)
    camera = read_stage(path).cameras[0]
    stage = Usd.Stage.Open(str(path))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/Shifted")).GetCamera(0).frustum
    matrix = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))  # in stage units
    device = np.array([matrix.Transform(Gf.Vec3d(*point)) for point in points])
    expected = (device[:, :2] * (0.5, -0.5) + 0.5) * (WIDTH, HEIGHT) - 0.5
    np.testing.assert_allclose(projected(camera, 0.1 * points), expected, atol=1e-4)


def test_conforming_to_another_shape_keeps_the_optical_axis(tmp_path):
    """A square image shows 32 of 12 in both directions, and its center stays 6, -3 of 12 off the axis."""
    camera = read(tmp_path, BODY % "").cameras[0]
    K = camera.intrinsics(20, 20)
    np.testing.assert_allclose(K[0, 0], 20 * 12 / 32)
    np.testing.assert_allclose(K[:2, 2], [9.5 - 0.5 * 7.5, 9.5 - 0.25 * 7.5])


def test_offset_survives_files_of_scenarios(tmp_path):
    turning = replace(CAMERA, dynamic=ts.Orbit((0.0, 0.0, 0.0), period=4.0))
    scenario = ts.Scenario("solid_benchmark", camera=turning)
    for name in ("scenario.json", "scenario.usda"):
        scenario.save(tmp_path / name)
        assert ts.Scenario.load(tmp_path / name).camera.aperture_offset == (0.5, -0.25)
    stage = Usd.Stage.Open(str(tmp_path / "scenario.usda"))
    (prim,) = (each for each in stage.Traverse() if each.HasAttribute("horizontalApertureOffset")
               and each.GetAttribute("horizontalApertureOffset").HasAuthoredValue())  # fmt: skip
    focal = prim.GetAttribute("focalLength").Get()
    assert prim.GetAttribute("horizontalApertureOffset").Get() == pytest.approx(0.5 * focal)


def test_offsets_without_an_image_are_refused(tmp_path):
    description = read_with_warning(
        tmp_path, BODY.replace("Offset = 6", "Offset = 1e+38") % "", "aperture offset of 1e\\+38, -3 is not used"
    )
    assert description.cameras[0].aperture_offset == (0.0, 0.0)
    with pytest.raises(ArgumentError, match=r"aperture_offset=\(1\.0, nan\): must be finite numbers, 2"):
        ts.Camera(aperture_offset=(1.0, math.nan))
