# SPDX-License-Identifier: Apache-2.0
"""The benchmark room: about 500 thousand triangles, 400 instances of 24 meshes, one rectangle light.

It is generated, so that everything that reads no files can be measured on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, Material, Mesh, RectLight, SceneDescription, SceneObject
from tiscene.scene.placement import Placement

WIDTH, HEIGHT, DEPTH = 6.0, 3.0, 5.0  # x, y, z; m
COLORS = {
    "plaster": (0.75, 0.73, 0.70),
    "red": (0.65, 0.20, 0.15),
    "green": (0.20, 0.50, 0.25),
    "parquet": (0.50, 0.35, 0.20),
    "fabric": (0.15, 0.25, 0.60),
    "wood": (0.45, 0.30, 0.18),
    "ceramic": (0.85, 0.85, 0.85),
    "yellow": (0.80, 0.65, 0.15),
    "dark": (0.08, 0.08, 0.09),
}
BOOKS = ("fabric", "yellow", "dark", "red", "green", "ceramic")


def room(balls: int = 0) -> SceneDescription:
    """Return the room, Y up, with a corner at the origin; always the same.

    Args:
        balls: number of additional small balls at random positions.
    """
    builder = _Builder()
    _walls(builder)
    _table_and_chairs(builder)
    _sofa(builder)
    _shelf(builder)
    _small_objects(builder)
    for _ in range(balls):
        builder.start_object("ball")
        position = builder.random.uniform((0.8, 0.1, 0.8), (WIDTH - 0.4, HEIGHT - 0.3, DEPTH - 0.2))
        builder.add("ball", str(builder.random.choice(BOOKS)), position, builder.random.uniform(0.03, 0.07))
    return builder.description()


def static_placement(description: SceneDescription) -> Placement:
    """Return the placement of a scene in which nothing moves. Instance ids are rows of objects plus 1."""
    instances = description.instances
    categories = sorted({each.category for each in description.objects} - {""})
    matrices = np.array([instance.world_from_object[:3] for instance in instances]).reshape(-1, 3, 4)
    return Placement(
        mesh=np.array([instance.mesh for instance in instances], np.int32),
        instance_id=np.array([instance.object + 1 for instance in instances], np.int32),
        category_id=np.array(
            [1 + categories.index(description.objects[i.object].category) for i in instances], np.int32
        ),
        world_from_object=np.repeat(matrices[None], 3, axis=0),
        box_from_object=np.repeat(np.eye(3, 4)[None], len(instances), axis=0),
        present=np.ones((3, len(instances)), bool),
    )


class _Builder:
    """Collects instances. A mesh is made when its shape is first used with a material."""

    def __init__(self) -> None:
        self.shapes = _shapes()
        self.random = np.random.default_rng(7)
        self.meshes: list[Mesh] = []
        self.rows: dict[tuple[str, str], int] = {}
        self.instances: list[Instance] = []
        self.objects: list[SceneObject] = []

    def start_object(self, category: str) -> None:
        """Start a new object that owns the instances added from now on."""
        name = f"{category}_{len(self.objects):03d}"
        self.objects.append(SceneObject(name, f"/Room/{name}", category))

    def add(
        self,
        shape: str,
        color: str,
        position: Sequence[float],
        size: Sequence[float] | float = 1.0,
        turn: float = 0.0,
        pitch: float = 0.0,
    ) -> None:
        """Add an instance.

        Args:
            shape: a key of `_shapes()`.
            color: a key of COLORS.
            position: m.
            size: scale, uniform or per axis.
            turn: rotation about y, rad, after `pitch`.
            pitch: rotation about x, rad.
        """
        matrix = trimesh.transformations.euler_matrix(pitch, turn, 0.0)
        matrix[:3, :3] *= np.broadcast_to(np.asarray(size, np.float64), 3)
        matrix[:3, 3] = position
        key = (shape, color)
        if key not in self.rows:
            self.rows[key] = len(self.meshes)
            positions, triangles = self.shapes[shape]
            materials = np.full(len(triangles), list(COLORS).index(color), np.int32)
            self.meshes.append(Mesh(f"{shape}_{color}", positions, triangles, materials))
        self.instances.append(Instance(self.rows[key], len(self.objects) - 1, matrix))

    def description(self) -> SceneDescription:
        """Return the scene."""
        downwards = trimesh.transformations.rotation_matrix(-0.5 * math.pi, (1, 0, 0))
        downwards[:3, 3] = (3.0, 2.95, 2.4)
        return SceneDescription(
            name="benchmark room",
            meshes=tuple(self.meshes),
            materials=tuple(Material(name, diffuse_color=color, ior=1.0) for name, color in COLORS.items()),
            instances=tuple(self.instances),
            objects=tuple(self.objects),
            lights=(RectLight("Ceiling", "/Room/Ceiling", downwards, (18.0, 18.0, 18.0), 1.6, 1.2),),
            cameras=(Camera.look_at((0.45, 1.75, 0.35), (3.6, 0.7, 3.0), vertical_fov=math.radians(55.0)),),
        )


def _shapes() -> dict[str, tuple[NDArray[np.float32], NDArray[np.int32]]]:
    box = trimesh.creation.box()
    cushion = _subdivided(box, 5)
    cushion.vertices /= (np.abs(2.0 * cushion.vertices) ** 6).sum(axis=1, keepdims=True) ** (1 / 6)  # rounded
    upright = trimesh.transformations.rotation_matrix(-0.5 * math.pi, (1, 0, 0))  # trimesh builds along z
    square = trimesh.Trimesh([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    shapes = {
        "ball": trimesh.creation.icosphere(subdivisions=5),
        "fine_ball": trimesh.creation.icosphere(subdivisions=6),
        "ring": trimesh.creation.torus(1.0, 0.32, major_sections=128, minor_sections=48).apply_transform(upright),
        "post": trimesh.creation.cylinder(radius=1.0, height=1.0, sections=64).apply_transform(upright),
        "bottle": trimesh.creation.capsule(height=1.0, radius=0.3, count=[32, 32]).apply_transform(upright),
        "box": box,
        "board": _subdivided(box, 4),
        "cushion": cushion,
        "square": square,
        "floor": _subdivided(square, 3),
    }
    return {
        name: (np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)) for name, mesh in shapes.items()
    }


def _subdivided(mesh: trimesh.Trimesh, times: int) -> trimesh.Trimesh:
    for _ in range(times):
        mesh = mesh.subdivide()
    return mesh


def _walls(builder: _Builder) -> None:
    quarter = 0.5 * math.pi
    for category, shape, color, position, size, turn, pitch in (
        ("floor", "floor", "parquet", (0, 0, 0), (WIDTH, 1, DEPTH), 0.0, 0.0),
        ("ceiling", "square", "plaster", (0, HEIGHT, DEPTH), (WIDTH, 1, DEPTH), 0.0, 2 * quarter),
        ("wall", "square", "red", (0, HEIGHT, DEPTH), (DEPTH, 1, HEIGHT), quarter, quarter),
        ("wall", "square", "green", (WIDTH, HEIGHT, 0), (DEPTH, 1, HEIGHT), -quarter, quarter),
        ("wall", "square", "plaster", (WIDTH, HEIGHT, DEPTH), (WIDTH, 1, HEIGHT), 2 * quarter, quarter),
        ("wall", "square", "plaster", (0, HEIGHT, 0), (WIDTH, 1, HEIGHT), 0.0, quarter),
    ):
        builder.start_object(category)
        builder.add(shape, color, position, size, turn, pitch)


def _table_and_chairs(builder: _Builder) -> None:
    builder.start_object("table")
    builder.add("board", "wood", (3.0, 0.74, 2.5), (1.6, 0.05, 0.9))
    for x in (2.3, 3.7):
        for z in (2.15, 2.85):
            builder.add("post", "wood", (x, 0.36, z), (0.03, 0.72, 0.03))
    for x, z, turn in ((2.4, 1.7, 0.0), (3.6, 1.7, -0.2), (2.4, 3.3, 3.1), (3.6, 3.3, 3.3)):
        builder.start_object("chair")
        sine, cosine = math.sin(turn), math.cos(turn)
        builder.add("cushion", "fabric", (x, 0.45, z), (0.45, 0.09, 0.45), turn)
        builder.add("board", "wood", (x - 0.22 * sine, 0.8, z - 0.22 * cosine), (0.42, 0.55, 0.04), turn)
        for dx in (-0.18, 0.18):
            for dz in (-0.18, 0.18):
                at = (x + cosine * dx + sine * dz, 0.21, z - sine * dx + cosine * dz)
                builder.add("post", "dark", at, (0.02, 0.42, 0.02))


def _sofa(builder: _Builder) -> None:
    builder.start_object("sofa")
    builder.add("board", "dark", (1.75, 0.2, 4.45), (2.4, 0.25, 0.9))
    for i in range(3):
        builder.add("cushion", "fabric", (1.0 + 0.75 * i, 0.42, 4.35), (0.75, 0.22, 0.8))
        builder.add("cushion", "fabric", (1.0 + 0.75 * i, 0.75, 4.75), (0.75, 0.6, 0.22), 0.0, -0.15)


def _shelf(builder: _Builder) -> None:
    levels = np.linspace(0.2, 2.2, 6)
    builder.start_object("shelf")
    for y in levels:
        builder.add("box", "wood", (5.75, y, 2.5), (0.4, 0.03, 2.4))
    for y in levels[:-1]:
        z = 1.35
        while z < 3.6:
            width, height = builder.random.uniform(0.02, 0.05), builder.random.uniform(0.2, 0.33)
            builder.start_object("book")
            at = (5.72, y + 0.02 + 0.5 * height, z + 0.5 * width)
            color = BOOKS[builder.random.integers(len(BOOKS))]
            builder.add("box", color, at, (0.22, height, 0.95 * width), 0.0, builder.random.uniform(-0.03, 0.03))
            z += width


def _small_objects(builder: _Builder) -> None:
    builder.start_object("vase")
    builder.add("fine_ball", "ceramic", (3.0, 0.92, 2.5), 0.15)
    for i in range(5):
        builder.start_object("fruit")
        builder.add("ball", "yellow" if i % 2 else "red", (2.4 + 0.3 * i, 0.815, 2.3 + 0.1 * (i % 2)), 0.05)
    for _ in range(4):
        builder.start_object("ring")
        at = (builder.random.uniform(0.6, 5.0), 0.08, builder.random.uniform(0.5, 1.2))
        builder.add("ring", "yellow", at, 0.22, builder.random.uniform(0.0, 3.0), builder.random.uniform(-0.2, 0.2))
    for i in range(3):
        builder.start_object("ring")
        builder.add("ring", "ceramic", (0.6, 0.4, 2.0 + 0.6 * i), 0.25, 0.0, 1.5)
    for i in range(4):
        builder.start_object("ball")
        at = (builder.random.uniform(0.5, 5.3), 0.18, builder.random.uniform(0.5, 1.4))
        builder.add("ball", ("red", "green", "ceramic", "yellow")[i], at, 0.18)
    for i in range(6):
        builder.start_object("bottle")
        builder.add("bottle", "ceramic", (4.6 + 0.1 * i, 0.3, 4.3 + 0.1 * (i % 3)), (0.3, 0.6, 0.3))
