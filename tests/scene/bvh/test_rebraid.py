# SPDX-License-Identifier: Apache-2.0
"""Large instances in parts: which they are, and that nothing of them is lost."""

import numpy as np
import trimesh

from tests.render.label_scenes import mesh_of
from tests.render.path_scenes import described, device_scene, matte
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.rebraid import INFO_PARTS, LARGE, MOST_OPENED, PARTS, largest


def test_the_parts_of_a_mesh_hold_all_of_it() -> None:
    trees = Bvh("bvh8")
    ball, square = trimesh.creation.icosphere(subdivisions=3), trimesh.creation.box()
    meshes = [
        trees.add_mesh(shape.vertices.astype(np.float32), shape.faces.astype(np.int32), 0) for shape in (ball, square)
    ]
    lone = trees.add_mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32), 0)
    parts = trees.parts([*meshes, lone])
    assert not parts.entries[2].any()  # one pack: it is entered there
    for row, mesh in enumerate(meshes):
        real = parts.boxes[row][parts.entries[row] != 0]
        assert 2 <= len(real) <= PARTS
        np.testing.assert_allclose(real[:, 0].min(axis=0), mesh.box[0])
        np.testing.assert_allclose(real[:, 1].max(axis=0), mesh.box[1])
    assert not Bvh("bvh2").parts(meshes).entries.any()


def test_only_large_instances_are_taken_apart() -> None:
    sizes = np.linspace(0.01, 1.0, 200)
    boxes = np.concatenate([np.zeros((200, 3)), np.repeat(sizes[:, None], 3, axis=1)], axis=1)
    rows = largest(boxes)
    assert len(rows) == MOST_OPENED
    assert (np.diff(sizes[rows]) < 0.0).all()
    few = largest(boxes[::50])
    assert list(few) == [k for k in (3, 2, 1, 0) if (sizes[::50][k] / sizes[150]) ** 2 > LARGE]


def test_an_instance_says_where_its_parts_are_entered() -> None:
    description = described([mesh_of(trimesh.creation.icosphere(subdivisions=2))], [matte("white", (1.0, 1.0, 1.0))])
    info = device_scene(description, "bvh8").instance_info.to_numpy()
    assert info[0, 0] > 0
    assert info[0, INFO_PARTS] != 0
    assert not device_scene(description, "bvh2").instance_info.to_numpy()[0, INFO_PARTS:].any()
