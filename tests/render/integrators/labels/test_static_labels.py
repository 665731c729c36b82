# SPDX-License-Identifier: Apache-2.0
"""The cache of static labels: same bytes as without it, and few pixels traced."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from tests.render.label_scenes import ALL_TIMES, PlacedMesh, Stage, mesh_of, placement_of, plate, pose, static_view
from tiscene.frame.buffers import LABELS
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import Material, Texture, TextureLookup
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement

CAMERA = Camera(position=(0.0, 0.2, 3.0))
VIEW = static_view(CAMERA, 64, 48)
TURNED = (np.cos(0.3), 0.0, np.sin(0.3), 0.0)


def striped() -> Texture:
    """Return a texture with alpha 0 in every other of eight columns."""
    pixels = np.ones((1, 8, 4), np.float32)
    pixels[0, ::2, 3] = 0.0
    return Texture("stripes", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")


class Room(Stage):
    """A static wall, mirror, lattice and ball, and a moving box, lattice and ball."""

    def __init__(self) -> None:
        meshes = [
            plate(9.0, 7.0),
            plate(1.2, 1.2, material=1),
            plate(1.0, 1.5, material=2),
            mesh_of(trimesh.creation.icosphere(subdivisions=2, radius=0.4), smooth=True),
            mesh_of(trimesh.creation.box((0.4, 0.5, 0.3))),
        ]
        lattice = TextureLookup(0, channel="a")
        materials = [
            Material("gray", diffuse_color=(0.3, 0.4, 0.5)),
            Material("mirror", diffuse_color=(0.9, 0.9, 0.9), roughness=0.0, metallic=1.0),
            Material("lattice", opacity=lattice, opacity_threshold=0.5),
        ]
        super().__init__(meshes, [PlacedMesh(0, [pose()])], materials, [striped()])

    def at(self, frame: int, mirror: float = 0.0) -> Placement:
        """Return the placement of a frame, with the mirror moved by `mirror`, m."""
        instances = [
            PlacedMesh(0, [pose((0, 0, -3))], category=1),
            PlacedMesh(1, [pose((1.0 + mirror, 0.3, -1.5), TURNED)], category=2),
            PlacedMesh(2, [pose((-0.8, 0, -1))], category=3),
            PlacedMesh(3, [pose((-1.0, 0.4, -2))], category=4),
            PlacedMesh(4, [self.box(frame + step) for step in (-1, 0, 1)], category=5),
            PlacedMesh(2, [pose((0.3 * np.sin(frame + step), -0.4, 0.2)) for step in (-1, 0, 1)], category=3),
            PlacedMesh(
                3,
                [pose((0.2 * (frame + step), 0.9, -0.5)) for step in (-1, 0, 1)],
                tuple(frame + step in (3, 4, 5) for step in (-1, 0, 1)),
            ),
        ]
        return placement_of(instances, self.meshes)

    def box(self, frame: int) -> NDArray[np.float64]:
        """Return the box's pose: static until frame 3, then it passes close to the camera and behind it."""
        time = max(frame - 3, 0)
        return pose((0.7 - 0.35 * time, 0.0, -0.6 + 0.75 * time), TURNED)


def compare(room: Room, placements: Callable[[int], Placement], frames: int, views: Callable[[int], View]) -> list[int]:
    """Assert that a pass with a cache gives the bytes of new passes; return the pixels that it traced per frame."""
    cached, traced = LabelPass(room.scene), []
    for frame in range(frames):
        room.scene.place(placements(frame), ALL_TIMES)
        ours, theirs = cached.render(views(frame), LABELS), LabelPass(room.scene).render(views(frame), LABELS)
        traced.append(cached.traced_pixels)
        for name in LABELS:
            assert ours[name].tobytes() == theirs[name].tobytes(), (frame, name)
        for array in ours.values():
            array[...] = 0  # the arrays belong to the caller
    return traced


def test_cached_labels_equal_new_pass() -> None:
    room = Room()
    traced = compare(room, room.at, 9, lambda frame: VIEW)
    whole = VIEW.width * VIEW.height
    partial = [count for count in traced if count < whole]
    assert len(partial) >= 4  # not the first frames, and not while the box is around the camera
    assert min(partial) < 0.4 * whole


def test_images_kept_on_the_device_give_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The layout of GPUs, whose label kernels write arrays in the device's memory that travel as one."""
    room = Room()
    made = DeviceScene.__init__
    monkeypatch.setattr(DeviceScene, "__init__", lambda self, *_, **options: made(self, "bvh2", **options))
    kept = Room()
    labels, sizes = LabelPass(kept.scene), []
    for frame in range(6):
        for each in (room, kept):
            each.scene.place(each.at(frame), ALL_TIMES)
        names = LABELS if frame != 4 else ("depth", "coverage", "backward_occlusion")
        expected, found = LabelPass(room.scene).render(VIEW, names), labels.render(VIEW, names)
        sizes.append(labels.traced_pixels)
        for name in names:
            assert found[name].dtype == expected[name].dtype
            assert found[name].tobytes() == expected[name].tobytes(), (frame, name)
        for array in found.values():
            array[...] = 0  # the arrays belong to the caller
    assert min(sizes) < 0.4 * VIEW.width * VIEW.height  # some frames are drawn over the image of what is static


def test_frame_without_movers_traces_no_pixel() -> None:
    room = Room()
    labels = LabelPass(room.scene)
    static = room.at(0)
    static = replace(static, present=static.present & (np.arange(7) < 4))
    traced = []
    for _ in range(4):
        room.scene.place(static, ALL_TIMES)
        labels.render(VIEW, LABELS)
        traced.append(labels.traced_pixels)
    whole = VIEW.width * VIEW.height
    assert traced == [whole, whole, 0, 0]  # the image, then the cached image of static instances, then nothing


def test_static_objects_may_start_moving_and_cameras_may_alternate() -> None:
    room = Room()
    other = static_view(Camera(position=(0.5, 0.2, 3.0)), 64, 48)
    compare(room, lambda frame: room.at(0, mirror=0.3 * max(frame - 4, 0)), 8, lambda frame: (VIEW, other)[frame % 2])


def test_moving_camera_is_not_cached() -> None:
    room = Room()
    labels = LabelPass(room.scene)
    room.scene.place(room.at(0), ALL_TIMES)
    moved = View(CAMERA, CAMERA, CAMERA.with_pose((0.1, 0.2, 3.0), CAMERA.rotation), 64, 48)
    for _ in range(3):
        labels.render(moved, ("instance", "forward_flow"))
        assert labels.traced_pixels == 64 * 48


def test_later_frames_may_request_more_buffers() -> None:
    room = Room()
    labels = LabelPass(room.scene)
    for frame, names in enumerate([("instance",), ("instance",), ("depth", "albedo"), LABELS, ("forward_occlusion",)]):
        room.scene.place(room.at(frame), ALL_TIMES)
        ours, theirs = labels.render(VIEW, names), LabelPass(room.scene).render(VIEW, names)
        assert list(ours) == list(names)
        assert all(ours[name].tobytes() == theirs[name].tobytes() for name in names)


def test_added_objects_are_labeled() -> None:
    room = Room()
    labels = LabelPass(room.scene)
    before = room.at(0)
    fewer = Placement(*(getattr(before, name)[:6] for name in ("mesh", "instance_id", "category_id")),
                      before.world_from_object[:, :6], before.box_from_object[:6], before.present[:, :6])  # fmt: skip
    for placement in (fewer, fewer, fewer, room.at(4), room.at(4)):
        room.scene.place(placement, ALL_TIMES)
        ours, theirs = labels.render(VIEW, LABELS), LabelPass(room.scene).render(VIEW, LABELS)
        assert all(ours[name].tobytes() == theirs[name].tobytes() for name in LABELS)
