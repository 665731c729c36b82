# SPDX-License-Identifier: Apache-2.0
"""Small scenes for tests of path tracing, built in code, and a function that renders them."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

from tests.benchmarks.room import static_placement
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import (
    Instance,
    Light,
    Material,
    Mesh,
    RectLight,
    SceneDescription,
    SceneObject,
    Texture,
)
from tiscene.scene.device_scene import DeviceScene

WHITE = (1.0, 1.0, 1.0)


def matte(name: str, color: tuple[float, float, float], **others: object) -> Material:
    """Return a purely Lambertian material."""
    return Material(name, diffuse_color=color, ior=1.0, **others)


def quad(*corners: tuple[float, float, float], material: int = 0) -> Mesh:
    """Return a quadrilateral of two counter-clockwise triangles, with uv 0..1."""
    return Mesh(
        "quad",
        np.array(corners, np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(2, material, np.int32),
        uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32),
    )


def ball(center: tuple[float, float, float], radius: float, material: int = 0, subdivisions: int = 4) -> Mesh:
    """Return a sphere with smooth normals."""
    sphere = trimesh.creation.icosphere(subdivisions, radius=radius)
    return Mesh(
        "ball",
        (sphere.vertices + center).astype(np.float32),
        np.asarray(sphere.faces, np.int32),
        np.full(len(sphere.faces), material, np.int32),
        normals=(sphere.vertices / radius).astype(np.float32),
    )


def described(
    meshes: list[Mesh], materials: list[Material], lights: list[Light] = (), textures: list[Texture] = ()
) -> SceneDescription:
    """Return a scene with one instance of each mesh, at the identity."""
    return SceneDescription(
        "test",
        meshes=tuple(meshes),
        materials=tuple(materials),
        textures=tuple(textures),
        lights=tuple(lights),
        instances=tuple(Instance(row, row, np.eye(4)) for row in range(len(meshes))),
        objects=tuple(SceneObject(f"object_{row}", f"/object_{row}", "object") for row in range(len(meshes))),
    )


def device_scene(description: SceneDescription, traversal: str | None = None) -> DeviceScene:
    """Return the scene on the device, placed."""
    scene = DeviceScene(traversal)
    scene.add(description)
    scene.place(static_placement(description))
    return scene


def render(
    scene: SceneDescription | DeviceScene,
    camera: Camera,
    size: tuple[int, int] = (16, 16),
    *,
    spp: int = 16,
    max_depth: int = 5,
    seed: int = 1,
    frame_index: int = 0,
    batch_size: int | None = None,
    mis: bool = True,
) -> PathImage:
    """Path trace a static scene. Asserts that all samples are finite."""
    if isinstance(scene, SceneDescription):
        scene = device_scene(scene)
    view = View(camera, camera, camera, *size)
    paths = PathPass(scene, *size, batch_size=batch_size)
    image = paths.render(view, frame_index=frame_index, seed=seed, spp=spp, max_depth=max_depth, mis=mis)
    assert paths.nonfinite == 0
    return image


def box(colors: list[tuple[float, float, float]]) -> tuple[list[Mesh], list[Material]]:
    """Return a Cornell box, 2 m wide about the origin and open toward +z, with two blocks.

    Args:
        colors: Of the left wall, the right wall, and everything else.
    """
    a, b = -1.0, 1.0
    walls = [
        quad((a, a, b), (a, a, a), (a, b, a), (a, b, b), material=0),
        quad((b, a, a), (b, a, b), (b, b, b), (b, b, a), material=1),
        quad((a, a, b), (b, a, b), (b, a, a), (a, a, a), material=2),
        quad((a, b, a), (b, b, a), (b, b, b), (a, b, b), material=2),
        quad((a, a, a), (b, a, a), (b, b, a), (a, b, a), material=2),
    ]
    for size, position, angle in (
        ((0.55, 1.2, 0.55), (-0.35, -0.4, -0.3), 0.3),
        ((0.6, 0.6, 0.6), (0.4, -0.7, 0.3), -0.3),
    ):
        block = trimesh.creation.box(size, trimesh.transformations.rotation_matrix(angle, (0, 1, 0)))
        walls.append(
            Mesh(
                "block",
                (block.vertices + position).astype(np.float32),
                np.asarray(block.faces, np.int32),
                np.full(12, 2, np.int32),
            )
        )
    return walls, [matte(name, color) for name, color in zip(("left", "right", "white"), colors, strict=True)]


CORNELL = [(0.63, 0.065, 0.05), (0.14, 0.45, 0.091), (0.725, 0.71, 0.68)]
BOX_CAMERA = Camera.look_at((0.0, 0.0, 3.6), (0.0, 0.0, 0.0), vertical_fov=np.radians(40.0))


def towards(position: tuple[float, float, float], direction: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return a light's matrix: at a position, with -z along a direction."""
    z = -np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.cross((0.1, 0.2, 1.0), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    matrix[:3, 3] = position
    return matrix


CEILING_LAMP = RectLight("lamp", "/lamp", towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0)), (18.0, 15.0, 8.0), 0.6, 0.5)


def lit_box() -> SceneDescription:
    """Return a Cornell box with a rectangular light."""
    meshes, materials = box(CORNELL)
    return described(meshes, materials, [CEILING_LAMP])
