# SPDX-License-Identifier: Apache-2.0
"""Scenes for tests of labels: plates, boxes and many random instances, built in code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import Material, Mesh, SceneDescription, Texture
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

ALL_TIMES = (PREVIOUS, CURRENT, NEXT)


def mesh_of(shape: trimesh.Trimesh, material: int = 0, *, smooth: bool = False, uv: bool = False) -> Mesh:
    """Convert a trimesh.

    Args:
        shape: The triangles.
        material: Material of all triangles.
        smooth: Whether to add vertex normals.
        uv: Whether to add texture coordinates, the x and y of the positions.
    """
    positions = np.asarray(shape.vertices, np.float32)
    return Mesh(
        name="mesh",
        positions=positions,
        triangles=np.asarray(shape.faces, np.int32),
        materials=np.full(len(shape.faces), material, np.int32),
        normals=np.asarray(shape.vertex_normals, np.float32) if smooth else None,
        uv=positions[:, :2].copy() if uv else None,
    )


def plate(width: float, height: float, material: int = 0) -> Mesh:
    """Return a rectangle about the origin in the xy plane, facing +z, with uv 0..1."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
    return Mesh(
        name="plate",
        positions=np.pad(corners * (width / 2, height / 2), ((0, 0), (0, 1))).astype(np.float32),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        materials=np.full(2, material, np.int32),
        uv=(corners * 0.5 + 0.5).astype(np.float32),
    )


def pose(position: Sequence[float] = (0, 0, 0), rotation: Sequence[float] = (1, 0, 0, 0), scale: float = 1.0):
    """Return a 3x4 matrix.

    Args:
        position: Translation, m.
        rotation: Quaternion (w, x, y, z), normalized here.
        scale: Uniform scale.
    """
    quaternion = np.asarray(rotation, float) / np.linalg.norm(rotation)
    return np.column_stack([matrix_from_quaternion(tuple(quaternion)) * scale, np.asarray(position, float)])


@dataclass
class PlacedMesh:
    """An instance of a mesh.

    Attributes:
        mesh: Row of the mesh.
        poses: 3x4 matrices at the three times, or one for all.
        present: Whether it is present at each time.
        category: Category id.
        id: Instance id; None: its row + 1.
    """

    mesh: int
    poses: Sequence[NDArray[np.float64]]
    present: tuple[bool, bool, bool] = (True, True, True)
    category: int = 0
    id: int | None = None


def placement_of(instances: Sequence[PlacedMesh], meshes: Sequence[Mesh]) -> Placement:
    """Return the placement of the instances, in order of their ids."""
    boxes = []
    for instance in instances:
        low, high = meshes[instance.mesh].positions.min(axis=0), meshes[instance.mesh].positions.max(axis=0)
        scale = 1.0 / np.maximum(high - low, 1e-6)
        boxes.append(np.column_stack([np.diag(scale), -low * scale]))
    poses = [instance.poses if len(instance.poses) == 3 else [instance.poses[0]] * 3 for instance in instances]
    return Placement(
        mesh=np.array([instance.mesh for instance in instances], np.int32),
        instance_id=np.array([instance.id or row + 1 for row, instance in enumerate(instances)], np.int32),
        category_id=np.array([instance.category for instance in instances], np.int32),
        world_from_object=np.array(poses, float).reshape(-1, 3, 3, 4).transpose(1, 0, 2, 3),
        box_from_object=np.array(boxes).reshape(-1, 3, 4),
        present=np.array([instance.present for instance in instances], bool).reshape(-1, 3).T,
    )


class Stage:
    """A DeviceScene with placed meshes, and its label pass."""

    def __init__(
        self,
        meshes: Sequence[Mesh],
        instances: Sequence[PlacedMesh],
        materials: Sequence[Material] = (),
        textures: Sequence[Texture] = (),
    ) -> None:
        self.meshes = meshes
        self.instances = instances
        self.scene = DeviceScene()
        self.scene.add(
            SceneDescription(
                "test",
                meshes=tuple(meshes),
                materials=tuple(materials) or (Material("gray"),),
                textures=tuple(textures),
            )
        )
        self.placement = placement_of(instances, meshes)
        self.scene.place(self.placement, ALL_TIMES)
        self.labels = LabelPass(self.scene)

    def render(self, view: View, *buffers: str) -> dict[str, NDArray]:
        return self.labels.render(view, buffers)


def static_view(camera: Camera, width: int, height: int) -> View:
    """Return a view with a static camera."""
    return View(camera, camera, camera, width, height)


def crowd(count: int = 240, seed: int = 5) -> Stage:
    """Return a wall and count - 1 moving instances before it, randomly rotated and scaled."""
    random = np.random.default_rng(seed)
    meshes = [
        mesh_of(trimesh.creation.icosphere(subdivisions=2, radius=0.3), smooth=True, uv=True),
        mesh_of(trimesh.creation.box((0.5, 0.3, 0.4))),
        mesh_of(trimesh.creation.torus(0.3, 0.1, major_sections=24, minor_sections=12), smooth=True),
        plate(12.0, 9.0),
    ]
    instances = [PlacedMesh(3, [pose((0, 0, -6))], category=9)]
    for row in range(count - 1):
        start = random.uniform((-4, -3, -5), (4, 3, 3))
        turn, step = random.normal(size=4), random.normal(size=3) * 0.05
        scale = random.uniform(0.5, 1.5)
        poses = []
        for time in (-1, 0, 1):
            nudged = turn + time * 0.03 * random.normal(size=4)
            poses.append(pose(start + time * step, nudged, scale))
        instances.append(PlacedMesh(row % 3, poses, category=1 + row % 3))
    return Stage(meshes, instances)
