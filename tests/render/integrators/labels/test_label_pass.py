# SPDX-License-Identifier: Apache-2.0
"""Each label buffer on surfaces and on the background: values, types, independence of other buffers and threads."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.render.label_scenes import PlacedMesh, Stage, crowd, mesh_of, plate, pose, static_view
from tests.render.tracing import described, mesh, placed
from tiscene.errors import BufferNotFound
from tiscene.frame.buffers import BUFFERS, LABELS
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.labels.surface_labels import FILTERED_ALBEDO
from tiscene.render.intersect.ray_queue import tiled_order
from tiscene.scene.camera import Camera
from tiscene.scene.description import Material, Texture, TextureLookup
from tiscene.scene.device_scene import DeviceScene

WIDTH, HEIGHT = 80, 60
FOCAL = 50.0
CAMERA = Camera(position=(0.0, 0.0, 0.0), vertical_fov=2 * np.arctan(0.5 * HEIGHT / FOCAL))
VIEW = static_view(CAMERA, WIDTH, HEIGHT)
QUARTER_TURN = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)  # about y: +z becomes +x


def test_labels_have_registered_type_shape_and_background() -> None:
    stage = Stage([plate(1.0, 1.0)], [PlacedMesh(0, [pose((0, 0, 5))])])  # behind the camera
    labels = stage.render(VIEW, *LABELS)
    assert list(labels) == list(LABELS)
    for name, array in labels.items():
        buffer = BUFFERS[name]
        assert array.shape == buffer.shape(WIDTH, HEIGHT)
        assert array.dtype == buffer.dtype
        assert array.flags.writeable
        if buffer.background is not None:
            np.testing.assert_array_equal(array, np.full_like(array, buffer.background), name)
    assert not labels["forward_flow"].any()  # the camera is static


def test_part_numbers_add_first_part_of_instance() -> None:
    corners = [[-9, -9, -3], [9, -9, -3], [9, 9, -3], [-9, 9, -3]]
    in_two = replace(mesh(corners, [[0, 1, 2], [0, 2, 3]]), parts=np.array([0, 2], np.int32))
    scene = DeviceScene()
    scene.add(described(in_two, mesh(corners, [[0, 1, 2]])))
    for row, first, values in ((0, 3, [4, 6]), (0, 0, [1, 3]), (1, 1, [0, 2])):
        scene.place(replace(placed([row]), part=np.array([first], np.int32)))
        part = LabelPass(scene).render(VIEW, ("part",))["part"]
        assert part[-1, -1] == values[1 if row else 0]
        assert part[0, 0] == values[0 if row else 1]
    scene.place(placed([0]))
    assert set(np.unique(LabelPass(scene).render(VIEW, ("part",))["part"])) == {1, 3}


def test_empty_scene_is_background() -> None:
    scene = DeviceScene()
    scene.place(scene.placement, (0, 1, 2))
    labels = LabelPass(scene).render(VIEW, LABELS)
    assert not labels["instance"].any()
    assert np.isposinf(labels["depth"]).all()
    assert labels["forward_occlusion"].all()


def test_geometry_labels_of_plate_match_closed_form() -> None:
    stage = Stage([plate(2.0, 1.0)], [PlacedMesh(0, [pose((0.52, 0.25, -2.0))], category=70_000, id=41)])
    labels = stage.render(VIEW, *LABELS)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    right, up = (x - 39.5) * 2.0 / FOCAL, (29.5 - y) * 2.0 / FOCAL  # m, on the plate's plane
    hit = (np.abs(right - 0.52) < 1.0) & (np.abs(up - 0.25) < 0.5)
    assert hit.sum() == 50 * 25
    np.testing.assert_array_equal(labels["instance"], np.where(hit, 41, 0))
    np.testing.assert_array_equal(labels["semantic"], np.where(hit, 70_000, 0))
    np.testing.assert_allclose(labels["depth"], np.where(hit, 2.0, np.inf), rtol=1e-6)
    position = np.stack([right, up, np.full_like(up, -2.0)], axis=-1)
    np.testing.assert_allclose(labels["position"][hit], position[hit], atol=1e-5)
    np.testing.assert_allclose(labels["distance"][hit], np.linalg.norm(position[hit], axis=1), rtol=1e-6)
    for name in ("normal", "geometric_normal"):
        np.testing.assert_allclose(labels[name][hit], np.broadcast_to((0, 0, 1), (hit.sum(), 3)), atol=1e-6)
    np.testing.assert_allclose(labels["normal_camera"][hit], np.broadcast_to((0, 0, -1), (hit.sum(), 3)), atol=1e-6)
    uv = np.stack([(right - 0.52) / 2.0 + 0.5, up - 0.25 + 0.5], axis=-1)
    np.testing.assert_allclose(labels["uv"][hit], uv[hit], atol=1e-5)
    np.testing.assert_allclose(labels["object_coordinates"][hit], np.pad(uv[hit], ((0, 0), (0, 1))), atol=1e-5)


@pytest.mark.parametrize("smooth", [False, True])
def test_normals_face_camera_from_inside_and_in_mirrored_instances(smooth: bool) -> None:
    ball = mesh_of(trimesh.creation.icosphere(subdivisions=3, radius=1.0), smooth=smooth)
    mirrored = pose((0, 0, -3)) * (-1.0, 1.0, 1.0, 1.0)
    outside = Stage([ball], [PlacedMesh(0, [pose((0, 0, -3))])]).render(VIEW, "normal", "position")
    mirror = Stage([ball], [PlacedMesh(0, [mirrored])]).render(VIEW, "normal", "position")
    inside = Stage([ball], [PlacedMesh(0, [pose((0, 0, 0))])]).render(VIEW, "normal", "geometric_normal", "position")
    for labels, center, sign in ((outside, (0, 0, -3), 1.0), (mirror, (0, 0, -3), 1.0), (inside, (0, 0, 0), -1.0)):
        hit = ~np.isnan(labels["position"][..., 0])
        assert hit.any()
        exact = sign * (labels["position"][hit] - center)
        exact /= np.linalg.norm(exact, axis=1, keepdims=True)
        cosine = np.sum(labels["normal"][hit] * exact, axis=1)
        assert cosine.min() > (0.9999 if smooth else 0.98)
        np.testing.assert_allclose(np.linalg.norm(labels["normal"][hit], axis=1), 1.0, atol=1e-6)


def test_material_labels_of_mirrors_are_those_of_reflected_surfaces() -> None:
    materials = [
        Material("red", diffuse_color=(0.8, 0.1, 0.1), roughness=0.7, metallic=0.2),
        Material("mirror", diffuse_color=(0.9, 0.9, 0.9), roughness=0.0, metallic=1.0),
    ]
    # A mirror at 45 degrees in the middle of the view shows a red strip far to the left, outside the view.
    stage = Stage(
        [plate(3.0, 1.0, material=1), plate(40.0, 0.5, material=0), plate(0.5, 0.5, material=0)],
        [
            PlacedMesh(0, [pose((0, 0, -3), (np.cos(-np.pi / 8), 0.0, np.sin(-np.pi / 8), 0.0))]),
            PlacedMesh(1, [pose((-6, 0, -3), QUARTER_TURN)]),
            PlacedMesh(2, [pose((0, 0.9, -3))]),
        ],
        materials,
    )
    labels = stage.render(VIEW, "albedo", "roughness", "metallic", "instance")
    plain = labels["instance"] == 3
    assert plain.any()
    np.testing.assert_allclose(labels["albedo"][plain], np.broadcast_to((0.8, 0.1, 0.1), (plain.sum(), 3)), atol=1e-6)
    np.testing.assert_allclose(labels["roughness"][plain], 0.7, atol=1e-6)
    np.testing.assert_allclose(labels["metallic"][plain], 0.2, atol=1e-6)
    mirror = labels["instance"] == 1
    middle = mirror[30, 30:50].nonzero()[0] + 30
    assert len(middle) == 20
    np.testing.assert_allclose(labels["albedo"][30, middle], np.broadcast_to((0.8, 0.1, 0.1), (20, 3)), atol=1e-6)
    rows = np.flatnonzero(mirror[:, 40])
    assert not labels["albedo"][rows[0], 40].any()  # above the red strip the mirror shows the background
    assert labels["roughness"][rows[0], 40] == 0.0


def test_albedo_follows_texture() -> None:
    pixels = np.zeros((1, 2, 4), np.float32)
    pixels[0, 0], pixels[0, 1] = (1.0, 0.5, 0.0, 1.0), (0.0, 0.5, 1.0, 1.0)
    texture = Texture("two", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")
    stage = Stage(
        [plate(4.0, 4.0)],
        [PlacedMesh(0, [pose((0, 0, -2))])],
        [Material("painted", diffuse_color=TextureLookup(0))],
        [texture],
    )
    albedo = stage.render(VIEW, "albedo")["albedo"]
    np.testing.assert_allclose(albedo[:, :15], np.broadcast_to((1.0, 0.5, 0.0), (HEIGHT, 15, 3)), atol=1e-5)
    np.testing.assert_allclose(albedo[:, -15:], np.broadcast_to((0.0, 0.5, 1.0), (HEIGHT, 15, 3)), atol=1e-5)


def test_filtered_albedo_averages_texels_within_pixel() -> None:
    codes = np.random.default_rng(0).integers(0, 2, (1024, 1024, 1), np.uint8) * 255
    pixels = np.concatenate([np.repeat(codes, 3, axis=2), np.full_like(codes, 255)], axis=2)
    stage = Stage(
        [plate(4.0, 4.0), plate(4.0, 0.8, material=1)],
        [PlacedMesh(0, [pose((0, 0, -2))]), PlacedMesh(1, [pose((0, 0, -1.9))])],
        [Material("noise", diffuse_color=TextureLookup(0)), Material("plain", diffuse_color=(0.2, 0.4, 0.6))],
        [Texture("noise", pixels, encoding="raw")],
    )
    labels = stage.render(VIEW, "albedo", FILTERED_ALBEDO, "instance")
    noise, plain = labels["instance"] == 1, labels["instance"] == 2
    assert labels["albedo"][noise].std() > 0.3
    assert labels[FILTERED_ALBEDO][noise].std() < 0.1
    assert labels[FILTERED_ALBEDO][noise].mean() == pytest.approx(0.5, abs=0.02)
    assert np.array_equal(labels["albedo"][plain], labels[FILTERED_ALBEDO][plain])
    assert np.array_equal(stage.render(VIEW, FILTERED_ALBEDO)[FILTERED_ALBEDO], labels[FILTERED_ALBEDO])


def curtain(rows: int, step: float = 0.0) -> tuple[Stage, np.ndarray]:
    """Return plates 2 m away, one behind the other, whose right halves have opacity 0, before a wall.

    Args:
        rows: Number of plates.
        step: Movement of the wall per frame, m.

    Returns:
        The stage, and the mask of opaque plate pixels [HEIGHT, WIDTH].
    """
    pixels = np.ones((1, 2, 4), np.float32)
    pixels[0, 1, 3] = 0.0
    holes = TextureLookup(0, channel="a")
    instances = [PlacedMesh(0, [pose((0, 0, -2 - 0.01 * row))]) for row in range(rows)]
    instances.append(PlacedMesh(1, [pose((step * time, 0, -4)) for time in (-1, 0, 1)]))
    stage = Stage(
        [plate(2.0, 2.0), plate(40.0, 40.0, material=1)],
        instances,
        [Material("lace", opacity=holes, opacity_threshold=0.5), Material("wall", diffuse_color=(0.1, 0.2, 0.3))],
        [Texture("hole", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")],
    )
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return stage, (np.abs(x - 39.5) < 25) & (np.abs(y - 29.5) < 25) & (x < 40)  # opaque half


@pytest.mark.parametrize("rows", [1, 5])
def test_alpha_rejected_surfaces_are_not_labeled(rows: int) -> None:
    stage, lace = curtain(rows)
    labels = stage.render(VIEW, "instance", "depth", "distance", "albedo")
    np.testing.assert_array_equal(labels["instance"], np.where(lace, 1, rows + 1))
    np.testing.assert_allclose(labels["depth"], np.where(lace, 2.0, 4.0), rtol=1e-6)
    wall = labels["albedo"][~lace]
    np.testing.assert_allclose(wall, np.broadcast_to((0.1, 0.2, 0.3), wall.shape), atol=1e-6)


def test_alpha_rejected_surfaces_do_not_occlude() -> None:
    stage, lace = curtain(3, step=0.4)  # wall points move by 5 px
    occluded = stage.render(VIEW, "forward_occlusion")["forward_occlusion"]
    arrives = np.zeros_like(lace)
    arrives[:, :-5] = lace[:, 5:]
    outside = np.mgrid[:HEIGHT, :WIDTH][1] >= WIDTH - 5
    np.testing.assert_array_equal(occluded, ~lace & (arrives | outside))


def test_buffer_does_not_depend_on_other_requested_buffers() -> None:
    stage = crowd(40)
    view = static_view(Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0)), WIDTH, HEIGHT)
    together = stage.render(view, *LABELS)
    for name in LABELS:
        alone = stage.render(view, name)
        assert list(alone) == [name]
        assert alone[name].tobytes() == together[name].tobytes(), name


def test_image_size_may_change_between_frames() -> None:
    stage = Stage([plate(40.0, 40.0)], [PlacedMesh(0, [pose((0, 0, -2))])])
    for width, height in ((33, 7), (1, 1), (64, 64), (5, 90)):
        labels = stage.render(static_view(CAMERA, width, height), "instance", "forward_occlusion", "albedo")
        assert labels["instance"].shape == (height, width)
        assert (labels["instance"] == 1).all()
        assert not labels["forward_occlusion"].any()


def test_unknown_label_raises_and_suggests() -> None:
    stage = Stage([plate(1.0, 1.0)], [])
    with pytest.raises(BufferNotFound, match="Did you mean 'depth'"):
        stage.render(VIEW, "dept")
    with pytest.raises(BufferNotFound, match="label buffer 'rgb'"):
        stage.render(VIEW, "rgb")
    assert stage.render(VIEW) == {}


@pytest.mark.parametrize(("width", "height"), [(1, 1), (8, 8), (9, 17), (256, 192), (7, 100)])
def test_tiled_order_is_a_permutation(width: int, height: int) -> None:
    order = tiled_order(width, height)
    assert order.dtype == np.int32
    np.testing.assert_array_equal(np.sort(order), np.arange(width * height))


_DIGESTS = """
import hashlib, json, sys, warnings
from tiscene.device import runtime
runtime.start(threads=int(sys.argv[1]))
from tests.render.label_scenes import crowd
from tiscene.scene.camera import Camera
from tiscene.frame.buffers import LABELS
from tiscene.render.view import View
camera = Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0))
view = View(camera, camera, camera.with_pose((1.1, 0.8, 7.5), camera.rotation), 96, 72)
labels = crowd(120).render(view, *LABELS)
print(json.dumps({name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in labels.items()}))
"""


@pytest.mark.slow
def test_bytes_do_not_depend_on_threads() -> None:
    digests = []
    for threads in ("1", "2"):
        done = subprocess.run([sys.executable, "-c", _DIGESTS, threads], capture_output=True, text=True, check=True)
        digests.append(json.loads(done.stdout))
    assert digests[0] == digests[1]
    assert list(digests[0]) == list(LABELS)
