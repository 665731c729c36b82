# SPDX-License-Identifier: Apache-2.0
"""Parts of objects and their bounding boxes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tiscene.scene.assembly import MIN_EXTENT, ObjectParts, box_matrices, corners, joined, rigid
from tiscene.scene.description import Mesh, SceneDescription, bounding_box


def placed(rotation: object, scale: object, translation: object = (1, 2, 3)) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation @ np.diag(scale)
    matrix[:3, 3] = translation
    return matrix


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 0.1, 30), (1e-6, 1e-6, 1e-6)])
def test_rigid_part_of_a_scaled_matrix_is_its_rotation(scale):
    rotation = Rotation.from_euler("xyz", (20, 50, -130), degrees=True).as_matrix()
    found = rigid(placed(rotation, scale))
    np.testing.assert_allclose(found, placed(rotation, (1, 1, 1)), atol=1e-14)


def test_rigid_part_of_a_mirroring_matrix_is_a_rotation():
    found = rigid(placed(np.eye(3), (1, -2, 1)))
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-15)


def description(*points: object) -> SceneDescription:
    meshes = [
        Mesh("m", np.array(each, np.float32).reshape(-1, 3), *[np.zeros((0, 3), np.int32)] * 2) for each in points
    ]
    return SceneDescription("d", tuple(meshes))


def test_bounding_box_contains_all_transformed_vertices():
    two = description([(0, 0, 0), (1, 2, 3)], [(1, 1, 1)])
    box = bounding_box(two, [0, 1, 0], [np.eye(4), placed(np.eye(3), (1, 1, 1), (-5, 0, 0)), np.diag([1, -1, 1, 1.0])])
    assert box.tolist() == [[-4, -2, 0], [1, 2, 3]]
    assert corners(box) == ((-4, -2, 0), (1, 2, 3))
    assert bounding_box(description([]), [0], [np.eye(4)]).tolist() == [[0, 0, 0], [0, 0, 0]]


def test_box_coordinates_are_0_to_1_and_invertible_for_flat_objects():
    box = np.array([[-1.0, 2.0, 0.0], [3.0, 2.0, 1.0]])
    (matrix,) = box_matrices(box[None], np.diag([2.0, 1, 1, 1])[None])
    np.testing.assert_allclose(matrix @ (-0.5, 2, 0, 1), (0, 0.5, 0))
    np.testing.assert_allclose(matrix @ (1.5, 2, 1, 1), (1, 0.5, 1))
    assert np.linalg.det(matrix[:, :3]) == pytest.approx(2 / 4 / MIN_EXTENT)


def test_joined_keeps_the_order_and_accepts_no_tables():
    def part(mesh: int) -> ObjectParts:
        row, matrix = np.zeros(1, np.int32), np.ones((1, 3, 4))
        return ObjectParts(row + mesh, row, matrix, matrix, row + 2 * mesh, np.full((1, 4), mesh, np.float32))

    assert joined([part(3), part(1)]).mesh.tolist() == [3, 1]
    assert joined([part(3), part(1)]).number.tolist() == [6, 2]
    assert joined([]).matrix.shape == (0, 3, 4)
    assert joined([]).mesh.dtype == np.int32
