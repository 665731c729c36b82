# SPDX-License-Identifier: Apache-2.0
"""DeviceScene: rows of what was added, placed instances, bounds."""

from dataclasses import replace

import numpy as np
import pytest
import taichi as ti

from tests.render.tracing import described, mesh, placed, random_matrices
from tiscene.errors import ArgumentError
from tiscene.scene.description import Material, Mesh, SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.instance_upload import HAS_NORMALS, HAS_UV, MIRRORED
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

TRIANGLE = mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "triangle")
SQUARE = mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], "square")
EMPTY = mesh([], [], "empty")


def with_attributes(source: Mesh, **others: np.ndarray) -> Mesh:
    return replace(source, **others)


def test_rows_continue_over_several_descriptions() -> None:
    scene = DeviceScene()
    normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    uv = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    first = SceneDescription(
        "stage", meshes=(TRIANGLE, with_attributes(SQUARE, normals=normals)), materials=(Material("a"), Material("b"))
    )
    second = SceneDescription(
        "template",
        meshes=(EMPTY, with_attributes(SQUARE, uv=uv, materials=np.int32([0, 1]))),
        materials=(Material("c"),) * 2,
    )
    assert scene.add(first) == 0
    assert scene.add(second) == 2
    assert len(scene.materials) == 4
    scene.place(placed([0, 1, 2, 3]))
    np.testing.assert_array_equal(
        scene.vertex_position.to_numpy(), np.concatenate([TRIANGLE.positions, SQUARE.positions, SQUARE.positions])
    )
    np.testing.assert_array_equal(scene.vertex_normal.to_numpy()[:, 2], [0] * 3 + [1] * 4 + [0] * 4)
    np.testing.assert_array_equal(scene.vertex_uv.to_numpy()[7:], uv)
    assert not scene.vertex_uv.to_numpy()[:7].any()
    np.testing.assert_array_equal(
        scene.triangle_vertices.to_numpy(), [[0, 1, 2], [3, 4, 5], [3, 5, 6], [7, 8, 9], [7, 9, 10]]
    )
    np.testing.assert_array_equal(scene.triangle_material.to_numpy(), [0, 0, 0, 2, 3])
    info = scene.instance_info.to_numpy()
    np.testing.assert_array_equal(info[:, 1], [0, 1, 3, 3])
    np.testing.assert_array_equal(info[:, 4], [0, 1, 2, 3])
    np.testing.assert_array_equal(info[:, 5], [0, HAS_NORMALS, 0, HAS_UV])


def test_placed_instances_have_identity_and_matrices() -> None:
    scene = DeviceScene()
    scene.add(described(SQUARE))
    random = np.random.default_rng(4)
    matrices = np.stack([random_matrices(random, 5, 10.0) for _ in range(3)])
    placement = replace(
        placed([0] * 5, matrices, box_from_object=random_matrices(random, 5, 1.0)),
        instance_id=np.int32([1, 1, 2, 7, 9]),
        category_id=np.int32([3, 3, 0, 0, 4]),
    )
    scene.place(placement)
    assert scene.placement is placement
    assert scene.instance_count == 5
    info = scene.instance_info.to_numpy()
    np.testing.assert_array_equal(info[:, 2], [1, 1, 2, 7, 9])
    np.testing.assert_array_equal(info[:, 3], [3, 3, 0, 0, 4])
    np.testing.assert_array_equal(info[:, 5], np.where(np.linalg.det(matrices[CURRENT, :, :, :3]) < 0, MIRRORED, 0))
    assert (info[:, 5] == MIRRORED).any()
    forward = scene.world_from_instance.to_numpy().reshape(3, 5, 3, 4)
    np.testing.assert_array_equal(forward, matrices.astype(np.float32))
    square = np.zeros((3, 5, 4, 4))
    square[..., :3, :], square[..., 3, 3] = matrices, 1.0
    inverse = scene.instance_from_world.to_numpy().reshape(3, 5, 3, 4)
    np.testing.assert_allclose(inverse, np.linalg.inv(square)[..., :3, :], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(
        scene.box_from_instance.to_numpy().reshape(5, 3, 4), placement.box_from_object, rtol=1e-6
    )


def test_bounds_contain_exactly_the_present_instances() -> None:
    scene = DeviceScene()
    scene.add(described(SQUARE, EMPTY))
    np.testing.assert_array_equal(scene.bounds, np.zeros((2, 3)))
    matrices = np.zeros((3, 3, 3, 4))
    matrices[..., :3] = np.eye(3)
    matrices[CURRENT, 0, :, 3] = (1, 2, 3)
    matrices[CURRENT, 1:, :, 3] = 100.0
    present = np.ones((3, 3), bool)
    present[CURRENT, 1] = False
    scene.place(placed([0, 0, 1], matrices, present))
    np.testing.assert_allclose(scene.bounds, [[0, 1, 3], [2, 3, 3]], atol=1e-5)
    scene.place(placed([]))
    np.testing.assert_array_equal(scene.bounds, np.zeros((2, 3)))
    assert scene.instance_count == 0


@pytest.mark.parametrize("mirrored", [False, True])
def test_placing_others_of_the_same_instances_is_as_placing_them_anew(mirrored: bool) -> None:
    random = np.random.default_rng(5)
    matrices = np.stack([random_matrices(random, 6, 10.0) for _ in range(3)])
    matrices[:, 1::2, :, 0] *= -1.0  # now none is mirrored
    if mirrored:
        matrices[NEXT, ::2, :, 0] *= -1.0
    all_six = placed([0, 1, 0, 1, 0, 1], matrices)
    parts = [replace(all_six, present=random.random((3, 6)) < 0.5) for _ in range(5)]
    others = replace(all_six, instance_id=np.int32([6, 5, 4, 3, 2, 1]), present=parts[0].present)
    scene = DeviceScene()
    scene.add(described(TRIANGLE, SQUARE))
    for placement in (all_six, *parts, others, replace(others, world_from_object=matrices[:, ::-1].copy()), all_six):
        scene.place(placement, (PREVIOUS, CURRENT, NEXT))
        anew = DeviceScene()
        anew.add(described(TRIANGLE, SQUARE))
        anew.place(placement, (PREVIOUS, CURRENT, NEXT))
        for name in ("instance_info", "world_from_instance", "instance_from_world", "box_from_instance"):
            np.testing.assert_array_equal(getattr(scene, name).to_numpy(), getattr(anew, name).to_numpy(), name)
        np.testing.assert_array_equal(scene.instance_boxes, anew.instance_boxes)
        np.testing.assert_array_equal(scene.bounds, anew.bounds)
    scene.add(described(EMPTY, SQUARE))
    scene.place(all_six)
    assert scene.instance_count == 6


def test_only_requested_times_are_placed() -> None:
    scene = DeviceScene()
    scene.add(described(SQUARE))
    scene.place(placed([0]), times=(PREVIOUS, NEXT))
    assert scene.tlas_root(PREVIOUS) == scene.tlas_root(NEXT)  # nothing moved, so they share a tree
    with pytest.raises(ArgumentError, match="time=1"):
        scene.tlas_root(CURRENT)


@pytest.mark.parametrize("rows", [[0, 1], [-1]])
def test_placing_a_mesh_that_was_not_added_is_refused(rows: list[int]) -> None:
    scene = DeviceScene()
    scene.add(described(SQUARE))
    with pytest.raises(ArgumentError, match="but the last mesh is 0"):
        scene.place(placed(rows))


def test_traversal_layout_follows_the_device() -> None:
    assert DeviceScene().traversal == ("bvh2" if ti.cfg.arch == ti.cuda else "bvh8")
    assert DeviceScene("bvh2").traversal == "bvh2"
    with pytest.raises(ArgumentError, match="traversal='octal'"):
        DeviceScene("octal")
