# SPDX-License-Identifier: Apache-2.0
"""Objects made of several meshes: their parts side by side, and the boxes around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import polar
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Matrix, SceneDescription, SceneObject, mesh_boxes

# m: how thick a flat object's box counts, so that the way into it can be turned round.
LEAST_EXTENT = 1e-4


@dataclass(frozen=True, eq=False)
class ObjectParts:
    """Meshes of objects, one row each, object after object.

    mesh: int32 [p]. owner: int32 [p], row of the object. matrix: float64 [p, 3, 4], places the mesh.
    box_from_mesh: float64 [p, 3, 4], to 0..1 in the box around the whole object. number: int32 [p], of the first of the
    object's named parts that the mesh shows.
    """

    mesh: NDArray[np.int32]
    owner: NDArray[np.int32]
    matrix: Matrix
    box_from_mesh: Matrix
    number: NDArray[np.int32]


def joined(parts: Sequence[ObjectParts]) -> ObjectParts:
    """All parts in one table."""
    none = np.zeros(0, np.int32)
    nothing = ObjectParts(none, none, np.zeros((0, 3, 4)), np.zeros((0, 3, 4)), none)
    every = [nothing, *parts]
    return ObjectParts(
        np.concatenate([each.mesh for each in every]),
        np.concatenate([each.owner for each in every]),
        np.concatenate([each.matrix for each in every]),
        np.concatenate([each.box_from_mesh for each in every]),
        np.concatenate([each.number for each in every]),
    )


def rigid(matrices: Matrix) -> Matrix:
    """The rotations of matrices [..., 4, 4] (see `polar`), with their translations."""
    result = np.zeros(matrices.shape)
    result[..., :3, :3] = polar(matrices[..., :3, :3])[0]
    result[..., :3, 3] = matrices[..., :3, 3]
    result[..., 3, 3] = 1.0
    return result


def bounding_box(description: SceneDescription, meshes: Sequence[int], matrices: Sequence[Matrix]) -> Matrix:
    """[2, 3]: the box around the vertices of `meshes`, each mapped by its 4x4 matrix; zeros if there are none."""
    every = mesh_boxes(description.meshes, meshes, np.array(matrices).reshape(-1, 4, 4))
    low, high = every[:, 0].min(axis=0, initial=np.inf), every[:, 1].max(axis=0, initial=-np.inf)
    return np.stack([low, high]) if np.isfinite(low).all() else np.zeros((2, 3))


def box_matrices(boxes: Matrix, matrices: Matrix) -> Matrix:
    """[p, 3, 4]: from each mesh, by its matrix [p, 4, 4], to 0..1 in its box [p, 2, 3]. What is flat lies at 0.5."""
    extent = np.maximum(boxes[:, 1] - boxes[:, 0], LEAST_EXTENT)
    unit = np.zeros((len(boxes), 4, 4))
    unit[:, range(3), range(3)], unit[:, 3, 3] = 1.0 / extent, 1.0
    unit[:, :3, 3] = 0.5 - 0.5 * (boxes[:, 0] + boxes[:, 1]) / extent
    result: Matrix = (unit @ matrices)[:, :3]
    return result


def corners(box: Matrix) -> tuple[Vector3, Vector3]:
    """The lowest and the highest corner of a box [2, 3]."""
    (a, b, c), (d, e, f) = box.tolist()
    return (a, b, c), (d, e, f)


def as_one(description: SceneDescription, name: str, prim_path: str, category: str, asset: str) -> SceneDescription:
    """The same with all its objects made one, whose parts are theirs, one after another."""
    first, names = [], list[str]()
    for each in description.objects:
        first.append(len(names))
        inner = [part if part.split("/")[0] == each.name else f"{each.name}/{part}" for part in each.parts]
        names += inner or [each.name]
    if len(description.objects) == 1:
        names = list(description.objects[0].parts)
    instances = tuple(replace(each, object=0, part=first[each.object] + each.part) for each in description.instances)
    colliders = tuple(replace(each, object=0) for each in description.colliders)
    movable = any(each.movable for each in description.objects)
    whole = SceneObject(name, prim_path, category, tuple(names) if len(names) > 1 else (), movable, asset)
    objects = (whole,) if description.objects else ()
    return replace(description, instances=instances, objects=objects, colliders=colliders)
