# SPDX-License-Identifier: Apache-2.0
"""Splitting of large instances: which are split, and that their parts are complete."""

import numpy as np
import trimesh

from tests.render.label_scenes import mesh_of
from tests.render.path_scenes import described, device_scene, matte
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.rebraid import INFO_PARTS, MAX_SPLIT, MIN_AREA, PARTS, instances_to_split


def test_parts_of_a_mesh_bound_the_whole_mesh() -> None:
    trees = Bvh("bvh8")
    ball, square = trimesh.creation.icosphere(subdivisions=3), trimesh.creation.box()
    meshes = [
        trees.add_mesh(shape.vertices.astype(np.float32), shape.faces.astype(np.int32), 0) for shape in (ball, square)
    ]
    lone = trees.add_mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32), 0)
    parts = trees.parts([*meshes, lone])
    assert not parts.entries[2].any()  # one leaf block, where rays enter it
    for row, mesh in enumerate(meshes):
        real = parts.boxes[row][parts.entries[row] != 0]
        assert 2 <= len(real) <= PARTS
        np.testing.assert_allclose(real[:, 0].min(axis=0), mesh.box[0])
        np.testing.assert_allclose(real[:, 1].max(axis=0), mesh.box[1])
    assert not Bvh("bvh2").parts(meshes).entries.any()


def test_only_large_instances_are_split() -> None:
    sizes = np.linspace(0.01, 1.0, 200)
    boxes = np.concatenate([np.zeros((200, 3)), np.repeat(sizes[:, None], 3, axis=1)], axis=1)
    rows = instances_to_split(boxes)
    assert len(rows) == MAX_SPLIT
    assert (np.diff(sizes[rows]) < 0.0).all()
    few = instances_to_split(boxes[::50])
    assert list(few) == [k for k in (3, 2, 1, 0) if (sizes[::50][k] / sizes[150]) ** 2 > MIN_AREA]


def test_instance_info_has_references_of_the_parts() -> None:
    description = described([mesh_of(trimesh.creation.icosphere(subdivisions=2))], [matte("white", (1.0, 1.0, 1.0))])
    info = device_scene(description, "bvh8").instance_info.to_numpy()
    assert info[0, 0] > 0
    assert info[0, INFO_PARTS] != 0
    assert not device_scene(description, "bvh2").instance_info.to_numpy()[0, INFO_PARTS:].any()
