# SPDX-License-Identifier: Apache-2.0
"""Flow and scene flow against NumPy in double precision: ray-box slabs, rigid motion, projection with K."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from tests.render.label_scenes import PlacedMesh, Stage, crowd, mesh_of, pose, static_view
from tiscene.render.integrators.labels.label_frames import instance_motion
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

WIDTH, HEIGHT = 160, 120
SIZE = np.array([0.9, 0.6, 0.7])
OTHER_TIMES = [("forward_flow", NEXT), ("backward_flow", PREVIOUS)]


def moving_boxes(origin: tuple[float, float, float]) -> Stage:
    """Return nine boxes around `origin` that translate and rotate."""
    random = np.random.default_rng(3)
    instances = []
    for cell in range(9):
        start = np.array([cell % 3 - 1.0, cell // 3 - 1.0, 0.0]) * 1.1 + random.uniform(-0.2, 0.2, 3) + origin
        turn, spin, step = random.normal(size=4), 0.1 * random.normal(size=4), random.uniform(-0.1, 0.1, 3)
        instances.append(PlacedMesh(0, [pose(start + time * step, turn + time * spin, 1.0) for time in (-1, 0, 1)]))
    return Stage([mesh_of(trimesh.creation.box(SIZE))], instances)


def moving_view(origin: tuple[float, float, float]) -> View:
    """Return a view whose camera translates, rotates and zooms."""
    cameras = [
        Camera.look_at(
            tuple(np.array([0.3 + 0.05 * time, 0.4, 4.0 - 0.07 * time]) + origin),
            tuple(np.array([0.02 * time, 0.03 * time, 0.0]) + origin),
            vertical_fov=1.0 + 0.01 * time,
        )
        for time in (-1, 0, 1)
    ]
    return View(*cameras, width=WIDTH, height=HEIGHT)


def pixel_directions(camera: Camera) -> NDArray[np.float64]:
    """Return world directions through the pixel centers, with z = 1 in the camera, [height, width, 3]."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    return pixels @ np.linalg.inv(camera.intrinsics(WIDTH, HEIGHT)).T @ camera.world_from_camera()[:3, :3].T


def projected(camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project world points to px."""
    inverse = np.linalg.inv(camera.world_from_camera())
    seen = (points @ inverse[:3, :3].T + inverse[:3, 3]) @ camera.intrinsics(WIDTH, HEIGHT).T
    return seen[..., :2] / seen[..., 2:]


def points_on_boxes(stage: Stage, view: View, instance: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return where each pixel's ray enters its instance's box, in the box's object space, [height, width, 3]."""
    rows = np.maximum(instance - 1, 0)
    matrices = stage.placement.world_from_object[CURRENT][rows]
    inverse = np.linalg.inv(matrices[..., :3])
    offset = np.asarray(view.current.position) - matrices[..., 3]
    origins = np.einsum("yxij,yxj->yxi", inverse, offset)
    directions = np.einsum("yxij,yxj->yxi", inverse, pixel_directions(view.current))
    planes = [(side * SIZE / 2 - origins) / directions for side in (-1, 1)]
    entry = np.minimum(*planes).max(axis=-1)
    return origins + entry[..., None] * directions


def moved(stage: Stage, time: int, instance: NDArray[np.int32], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform points of boxes to world space at a time."""
    matrices = stage.placement.world_from_object[time][np.maximum(instance - 1, 0)]
    return np.einsum("yxij,yxj->yxi", matrices[..., :3], points) + matrices[..., 3]


def flow_errors(name: str, time: int, origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the errors of a flow buffer at all pixels that show a box, px."""
    stage, view = moving_boxes(origin), moving_view(origin)
    labels = stage.render(view, name, "instance")
    instance = labels["instance"]
    assert len(np.unique(instance)) == 10
    points = points_on_boxes(stage, view, instance)
    here = projected(view.current, moved(stage, CURRENT, instance, points))
    there = projected(view.cameras[time], moved(stage, time, instance, points))
    hit = instance > 0
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    np.testing.assert_allclose(here[hit], np.stack([x, y], axis=-1)[hit], atol=1e-6)  # the reference hits the centers
    assert np.abs(there - here)[hit].max() > 5.0
    return np.abs(labels[name] - (there - here)).max(axis=-1)[hit]


@pytest.mark.parametrize(("name", "time"), OTHER_TIMES)
def test_flow_is_projection_of_moved_point(name: str, time: int) -> None:
    assert flow_errors(name, time, (0.0, 0.0, 0.0)).max() < 2e-4


@pytest.mark.parametrize(("name", "time"), OTHER_TIMES)
def test_flow_is_exact_one_kilometer_from_origin(name: str, time: int) -> None:
    """Ray origins are rounded there (0.06 mm), which affects surfaces at grazing angles only."""
    errors = flow_errors(name, time, (300.0, -20.0, 1000.0))
    assert np.mean(errors < 1e-3) > 0.99
    assert errors.max() < 0.05


@pytest.mark.parametrize(("name", "time"), OTHER_TIMES)
def test_background_flow_is_camera_rotation(name: str, time: int) -> None:
    stage, view = moving_boxes((0.0, 0.0, 0.0)), moving_view((0.0, 0.0, 0.0))
    labels = stage.render(view, name, "instance")
    # Infinitely far: 1e9 m is near enough for a camera that moved by centimeters.
    far = np.asarray(view.current.position) + 1e9 * pixel_directions(view.current)
    expected = projected(view.cameras[time], far) - projected(view.current, far)
    background = labels["instance"] == 0
    assert background.mean() > 0.2
    np.testing.assert_allclose(labels[name][background], expected[background], atol=1e-3)


def test_scene_flow_is_world_displacement() -> None:
    stage, view = moving_boxes((0.0, 0.0, 0.0)), moving_view((0.0, 0.0, 0.0))
    labels = stage.render(view, "scene_flow", "instance")
    instance = labels["instance"]
    points = points_on_boxes(stage, view, instance)
    expected = moved(stage, NEXT, instance, points) - moved(stage, CURRENT, instance, points)
    expected[instance == 0] = 0.0
    np.testing.assert_allclose(labels["scene_flow"], expected, atol=1e-5)


def test_static_objects_before_static_camera_have_zero_flow() -> None:
    stage = crowd(60)
    for instance in stage.instances:
        instance.poses = [instance.poses[-1]] * 3
    stage = Stage(stage.meshes, stage.instances)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), WIDTH, HEIGHT)
    names = ("forward_flow", "backward_flow", "scene_flow")
    for name, flow in stage.render(view, *names).items():
        assert not flow.any(), name


def test_backward_flow_inverts_forward_flow() -> None:
    """Where a pixel's point moves to, the next frame's backward flow points back, on the interior of a face."""
    positions = [(0.0, 0.0, -4.0), (0.11, 0.05, -4.0), (0.22, 0.1, -4.0), (0.33, 0.15, -4.0)]
    box = mesh_of(trimesh.creation.box((2.0, 2.0, 0.5)))
    view = static_view(Camera(position=(0.0, 0.0, 0.0)), WIDTH, HEIGHT)
    first, second = (
        Stage([box], [PlacedMesh(0, [pose(position) for position in positions[at : at + 3]])]).render(
            view, "forward_flow", "backward_flow", "instance"
        )
        for at in (0, 1)
    )
    y, x = np.nonzero(first["instance"])
    flow = first["forward_flow"][y, x]
    landed = np.rint(np.stack([x, y], axis=-1) + flow).astype(int)
    back = second["backward_flow"][landed[:, 1], landed[:, 0]]
    on_front = np.abs(flow - np.median(flow, axis=0)).max(axis=1) < 1e-3  # the front face moves as a whole
    assert on_front.sum() > 1000
    interior = on_front & (np.abs(back - np.median(back, axis=0)).max(axis=1) < 1e-3)
    np.testing.assert_allclose(back[interior], -flow[interior], atol=1e-3)


def test_point_moving_behind_camera_has_finite_flow_and_is_occluded() -> None:
    box = mesh_of(trimesh.creation.box((1.0, 1.0, 1.0)))
    poses = [pose((0, 0, z)) for z in (-4.0, -2.0, 3.0)]
    stage = Stage([box], [PlacedMesh(0, poses)])
    labels = stage.render(
        static_view(Camera(position=(0.0, 0.0, 0.0)), WIDTH, HEIGHT), "forward_flow", "forward_occlusion", "instance"
    )
    hit = labels["instance"] == 1
    assert hit.any()
    assert np.isfinite(labels["forward_flow"]).all()
    assert labels["forward_occlusion"][hit].all()


def test_instance_motion_bytes_do_not_depend_on_row() -> None:
    """SIMD sums may round differently at the end of an array."""
    stage = crowd(37)
    same = np.repeat(stage.placement.world_from_object[:, 5:6], 37, axis=1)
    placement = type(stage.placement)(**{**vars(stage.placement), "world_from_object": same})
    rows = instance_motion(placement, moving_view((0.0, 0.0, 0.0)))
    assert all((a[:48] == b[:48]).all() for a, b in pairwise(rows))
