# SPDX-License-Identifier: Apache-2.0
"""Several frames traced in one wavefront have the bytes of frames traced one by one."""

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.room import static_placement
from tests.render.path_scenes import ball, described, matte, quad, towards
from tiscene.render.integrators.path.path_frames import PathFrames
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import DomeLight, Material, SceneDescription, SphereLight
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement

SIZE = 13, 7  # paths of a frame are no multiple of the lanes in which camera rays are made
SAMPLING = {"seed": 5, "spp": 3, "max_depth": 4}
INDICES = (7, 8, 9, 30, 2)
LAMP = SphereLight("lamp", "/lamp", towards((0.5, 1.6, 1.0), (0.0, -1.0, 0.0)), (9.0, 8.0, 7.0), 0.2)
UNUSED = Material("unused", emissive_color=(1.0, 1.0, 1.0))
LIGHTS = [LAMP, DomeLight("sky", "/sky", np.eye(4), (0.4, 0.5, 0.6))]


def scene_of(*materials: Material) -> SceneDescription:
    """Return a floor and two balls, which have two materials each in turn.

    A material that no mesh has emits light: then all scenes here need the same variant of the shading kernel.
    """
    floor = quad((-3, -1, 3), (3, -1, 3), (3, -1, -3), (-3, -1, -3))
    balls = ball((-0.6, 0.0, 0.0), 0.6, 1, 2), ball((0.7, 0.0, 0.3), 0.5, 2, 2)
    return described([floor, *balls], [matte("floor", (0.5, 0.6, 0.7)), *materials, UNUSED], LIGHTS)


CUTOUT = scene_of(Material("lace", diffuse_color=(0.9, 0.2, 0.1), opacity=0.4), Material("glass", opacity=1.0, ior=1.5))
EMISSIVE = scene_of(matte("red", (0.8, 0.1, 0.1)), Material("lamp", emissive_color=(1.0, 2.0, 3.0)))
PLAIN = scene_of(
    matte("red", (0.8, 0.1, 0.1)), Material("mirror", diffuse_color=(0.9,) * 3, metallic=1.0, roughness=0.1)
)


def frame(description: SceneDescription, number: int) -> tuple[View, Placement]:
    """Return view and placement of a frame: balls move, one is absent at times, the camera moves and zooms."""
    placement = static_placement(description)
    world = placement.world_from_object.copy()
    world[:, 1, :3, 3] += (0.1 * number, 0.2, -0.1 * number)
    present = placement.present.copy()
    present[:, 2] = number % 3 != 1
    if number == 4:
        present[:] = False
    fov = 0.9 + 0.1 * number
    camera = Camera(position=(0.1 * number, 0.4, 3.0), vertical_fov=fov, lens_radius=0.02 * number, focus_distance=2.5)
    return View(camera, camera, camera, *SIZE), replace(placement, world_from_object=world, present=present)


def scene(description: SceneDescription, layout: str = "bvh8") -> DeviceScene:
    made = DeviceScene(layout)
    made.add(description)
    return made


def one_by_one(description: SceneDescription, options: dict[str, object]) -> list[PathImage]:
    device = scene(description)
    paths = PathPass(device, *SIZE, **options)
    images = []
    for number, index in enumerate(INDICES):
        view, placement = frame(description, number)
        device.place(placement)
        images.append(paths.render(view, frame_index=index, **SAMPLING))
    return images


@pytest.mark.parametrize(
    ("description", "options", "layout"),
    [(PLAIN, {"pixel_filter": "box"}, "bvh8"), (CUTOUT, {"pixel_filter": "mitchell", "clamp": 20.0}, "bvh2")],
    ids=["plain", "cutout"],
)
def test_frames_at_once_have_the_bytes_of_single_frames(
    description: SceneDescription, options: dict[str, object], layout: str
) -> None:
    expected = one_by_one(description, options)
    frames = PathFrames(scene(description, layout), *SIZE, **options)
    views, placements = zip(*(frame(description, number) for number in range(len(INDICES))), strict=True)
    for count in (5, 2):
        found = frames.render_frames(views[:count], placements[:count], INDICES[:count], **SAMPLING)
        assert len(found) == count
        for ours, theirs in zip(found, expected, strict=False):
            for name in ("hdr", "albedo", "normal"):
                np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    assert len({image.hdr.tobytes() for image in expected}) == len(INDICES)


def test_batches_of_paths_limit_the_frames_at_once() -> None:
    views, placements = zip(*(frame(PLAIN, number) for number in range(5)), strict=True)
    paths = SIZE[0] * SIZE[1] * SAMPLING["spp"]
    small = PathFrames(scene(PLAIN), *SIZE, batch_size=2 * paths + 5)
    expected = one_by_one(PLAIN, {})
    for ours, theirs in zip(small.render_frames(views, placements, INDICES, **SAMPLING), expected, strict=True):
        np.testing.assert_array_equal(ours.hdr, theirs.hdr)
    smaller = PathFrames(scene(PLAIN), *SIZE, batch_size=2 * paths - 1)
    assert smaller.render_frames(views, placements, INDICES, **SAMPLING) is None


def test_frames_that_share_no_arrays_are_left_to_be_rendered_one_by_one() -> None:
    (view, placement), (other, _) = frame(PLAIN, 0), frame(PLAIN, 1)
    frames = PathFrames(scene(PLAIN), *SIZE)

    def rendered(views: tuple[View, ...], placements: tuple[Placement, ...]) -> object:
        return frames.render_frames(views, placements, INDICES[: len(views)], **SAMPLING)

    assert rendered((view, other), (placement, placement)) is not None
    assert rendered((view,), (placement,)) is None
    assert rendered((view, other), (placement, replace(placement, lights=((0, LAMP),)))) is None
    assert rendered((view, replace(other, background=(0.0, 0.0, 0.0))), (placement, placement)) is None
    frames = PathFrames(scene(EMISSIVE), *SIZE)
    assert rendered((view, other), (placement, placement)) is not None
    for wrong in (frame(EMISSIVE, 4)[1], replace(placement, world_from_object=placement.world_from_object + 0.1)):
        assert rendered((view, other), (placement, wrong)) is None


def test_frames_without_emissive_materials_are_rendered_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(PathFrames, "_render_stack", lambda self, views, *_: calls.append(len(views)) or [])
    frames = PathFrames(scene(replace(PLAIN, materials=PLAIN.materials[:-1])), *SIZE)
    (view, placement), (other, second) = frame(PLAIN, 0), frame(PLAIN, 1)
    frames.render_frames((view, other), (placement, replace(second, mesh=second.mesh[::-1])), INDICES[:2], **SAMPLING)
    assert calls == [2]


def test_light_of_meshes_that_stay_is_shared() -> None:
    device, numbers = scene(EMISSIVE), (0, 2, 3)
    views, placements = zip(*(frame(EMISSIVE, number) for number in numbers), strict=True)
    found = PathFrames(scene(EMISSIVE), *SIZE).render_frames(views, placements, numbers, **SAMPLING)
    paths = PathPass(device, *SIZE)
    for image, number, view, placement in zip(found, numbers, views, placements, strict=True):
        device.place(placement)
        expected = paths.render(view, frame_index=number, **SAMPLING)
        np.testing.assert_array_equal(image.hdr, expected.hdr)
