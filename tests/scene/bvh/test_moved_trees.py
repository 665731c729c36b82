# SPDX-License-Identifier: Apache-2.0
"""Trees of templates are built once, and have the bytes of a build wherever they are added."""

import numpy as np
import pytest
import trimesh

from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.template_trees import add_meshes_of
from tiscene.scene.description import Mesh, SceneDescription


def mesh_of(shape: trimesh.Trimesh, scale: float = 1.0) -> Mesh:
    triangles = np.array(shape.faces, np.int32)
    materials = np.zeros(len(triangles), np.int32)
    return Mesh("mesh", (scale * np.array(shape.vertices)).astype(np.float32), triangles, materials)


BALL, CUBE = mesh_of(trimesh.creation.icosphere(subdivisions=3)), mesh_of(trimesh.creation.box())
POINT = mesh_of(trimesh.creation.box(), scale=0.0)  # without area: its tree is empty


@pytest.mark.parametrize("layout", ["bvh8", "bvh2"])
def test_template_added_anywhere_has_the_bytes_of_a_build_there(layout: str) -> None:
    template = SceneDescription("template", (BALL, POINT, CUBE, mesh_of(trimesh.creation.cylinder(1.0, 2.0))))
    size = sum(len(mesh.triangles) for mesh in template.meshes)
    for before in ([], [BALL], [CUBE, BALL]):
        added, built, first = Bvh(layout), Bvh(layout), 0
        for mesh in before:
            for tree in (added, built):
                tree.add_mesh(mesh.positions, mesh.triangles, first)
            first += len(mesh.triangles)
        meshes = [mesh.positions for mesh in template.meshes], [mesh.triangles for mesh in template.meshes]
        for _ in range(2):
            found, expected = add_meshes_of(template, added, first, keep=True), built.add_meshes(*meshes, first)
            first += size
            assert [vars(each) | {"box": each.box.tolist()} for each in found] == [
                vars(each) | {"box": each.box.tolist()} for each in expected
            ]
        nodes, blocks = built.used_rows
        assert added.used_rows == (nodes, blocks)
        assert added.nodes.to_numpy()[:nodes].tobytes() == built.nodes.to_numpy()[:nodes].tobytes()
        assert added.leaf_blocks.to_numpy()[:blocks].tobytes() == built.leaf_blocks.to_numpy()[:blocks].tobytes()


def test_template_is_built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    template, calls = SceneDescription("template", (CUBE,)), []
    build = Bvh.add_meshes
    monkeypatch.setattr(Bvh, "add_meshes", lambda *args: (calls.append(args), build(*args))[1])
    for first in (0, 100, 200):
        assert len(add_meshes_of(template, Bvh("bvh8"), first, keep=True)) == 1
    assert len(calls) == 1
