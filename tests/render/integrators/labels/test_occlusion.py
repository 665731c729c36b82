# SPDX-License-Identifier: Apache-2.0
"""Occlusion masks of plates, for which lines of sight are known in closed form."""

import numpy as np
from numpy.typing import NDArray

from tests.render.label_scenes import PlacedMesh, Stage, plate, pose, static_view
from tiscene.render.view import View
from tiscene.scene.camera import Camera

WIDTH, HEIGHT = 160, 120
FOCAL = 100.0
CAMERA = Camera(position=(0.0, 0.0, 0.0), vertical_fov=2 * np.arctan(0.5 * HEIGHT / FOCAL))
MASKS = ("forward_occlusion", "backward_occlusion")


def centers() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pixel coordinates relative to the image center, px right and up."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return x - 0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1) - y


def test_plate_passing_in_front_occludes() -> None:
    # The near plate, 1 m wide at 2 m, steps 0.4 m = 20 px to the right; the far one covers the image and is static.
    near, far = plate(1.0, 1.0), plate(20.0, 20.0)
    stage = Stage(
        [near, far],
        [PlacedMesh(0, [pose((0.4 * time, 0, -2)) for time in (-1, 0, 1)]), PlacedMesh(1, [pose((0, 0, -4))])],
    )
    labels = stage.render(static_view(CAMERA, WIDTH, HEIGHT), *MASKS, "instance")
    right, up = centers()
    now = (np.abs(right) < 25) & (np.abs(up) < 25)
    after = (np.abs(right - 20) < 25) & (np.abs(up) < 25)
    before = (np.abs(right + 20) < 25) & (np.abs(up) < 25)
    np.testing.assert_array_equal(labels["instance"], np.where(now, 1, 2))
    np.testing.assert_array_equal(labels["forward_occlusion"], after & ~now)
    np.testing.assert_array_equal(labels["backward_occlusion"], before & ~now)


def test_points_leaving_the_image_are_occluded() -> None:
    # 1 m wide at 2 m, its right edge 5 px inside the image; it steps 15 px to the right.
    start = (80 - 5 - 25) * 2.0 / FOCAL
    stage = Stage([plate(1.0, 1.0)], [PlacedMesh(0, [pose((start + 0.3 * time, 0, -2)) for time in (-1, 0, 1)])])
    labels = stage.render(static_view(CAMERA, WIDTH, HEIGHT), *MASKS, "instance")
    right, up = centers()
    hit = (right > 25) & (right < 75) & (np.abs(up) < 25)
    np.testing.assert_array_equal(labels["instance"] == 1, hit)
    np.testing.assert_array_equal(labels["forward_occlusion"], ~hit | (right + 15 > 80))
    np.testing.assert_array_equal(labels["backward_occlusion"], ~hit)


def test_absent_instances_are_occluded_and_do_not_occlude() -> None:
    left, right = pose((-1, 0, -2)), pose((1, 0, -2))
    stage = Stage(
        [plate(1.0, 1.0), plate(20.0, 20.0)],
        [
            PlacedMesh(0, [left], present=(True, True, False)),
            PlacedMesh(0, [right], present=(False, True, True)),
            PlacedMesh(1, [pose((0, 0, -4))]),
        ],
    )
    labels = stage.render(static_view(CAMERA, WIDTH, HEIGHT), *MASKS, "instance", "forward_flow")
    np.testing.assert_array_equal(labels["forward_occlusion"], labels["instance"] == 1)
    np.testing.assert_array_equal(labels["backward_occlusion"], labels["instance"] == 2)
    assert not labels["forward_flow"].any()  # flow follows the planned pose


def test_instance_spawned_in_front_occludes() -> None:
    stage = Stage(
        [plate(1.0, 1.0), plate(20.0, 20.0)],
        [PlacedMesh(0, [pose((0, 0, -2))], present=(False, False, True)), PlacedMesh(1, [pose((0, 0, -4))])],
    )
    labels = stage.render(static_view(CAMERA, WIDTH, HEIGHT), *MASKS, "instance")
    right, up = centers()
    assert (labels["instance"] == 2).all()
    np.testing.assert_array_equal(labels["forward_occlusion"], (np.abs(right) < 25) & (np.abs(up) < 25))
    assert not labels["backward_occlusion"].any()


def test_camera_translation_occludes_by_parallax() -> None:
    # A 1 m plate at 2 m before a wall at 4 m; the camera steps 0.48 m to the right. In the new image the plate
    # covers -49..1 px and a wall point moves by 12 px, so old wall pixels x with -49 < x - 12 < 1 lose sight.
    stage = Stage(
        [plate(1.0, 1.0), plate(40.0, 40.0)], [PlacedMesh(0, [pose((0, 0, -2))]), PlacedMesh(1, [pose((0, 0, -4))])]
    )
    after = CAMERA.with_pose((0.48, 0.0, 0.0), CAMERA.rotation)
    labels = stage.render(View(CAMERA, CAMERA, after, WIDTH, HEIGHT), *MASKS, "instance")
    right, up = centers()
    wall = ~((np.abs(right) < 25) & (np.abs(up) < 25))
    hidden = (right - 12 > -49) & (right - 12 < 1) & (np.abs(up) < 25)
    outside = np.where(wall, right - 12, right - 24) < -80
    np.testing.assert_array_equal(labels["forward_occlusion"], (wall & hidden) | outside)
    np.testing.assert_array_equal(labels["backward_occlusion"], np.zeros_like(wall))


def test_grazing_surfaces_do_not_occlude_themselves() -> None:
    # A moving floor at a grazing angle below one degree, before a moving camera: all visible points stay visible.
    turn = (np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0)
    stage = Stage([plate(400.0, 400.0)], [PlacedMesh(0, [pose((0.01 * time, -0.3, 0), turn) for time in (-1, 0, 1)])])
    view = View(*(CAMERA.with_pose((0, 0, 0.05 * time), CAMERA.rotation) for time in (-1, 0, 1)), WIDTH, HEIGHT)
    labels = stage.render(view, *MASKS, "instance", "forward_flow", "backward_flow")
    floor = labels["instance"] == 1
    assert floor.sum() > 8000
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for mask, flow in zip(MASKS, ("forward_flow", "backward_flow"), strict=True):
        place = np.stack([x, y], axis=-1) + labels[flow]
        inside = (place > (-0.5, -0.5)).all(axis=-1) & (place < (WIDTH - 0.5, HEIGHT - 0.5)).all(axis=-1)
        np.testing.assert_array_equal(labels[mask], ~(floor & inside), mask)


def test_background_is_occluded() -> None:
    stage = Stage([plate(1.0, 1.0)], [PlacedMesh(0, [pose((0, 0, 5))])])
    labels = stage.render(static_view(CAMERA, WIDTH, HEIGHT), *MASKS)
    assert labels["forward_occlusion"].all()
    assert labels["backward_occlusion"].all()
