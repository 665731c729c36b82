# SPDX-License-Identifier: Apache-2.0
"""Objects made of several meshes: tables of their parts, bounding boxes, merging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.affine_maps import with_origin
from tiscene.scene.animation import polar
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Matrix, SceneDescription, SceneObject

MIN_EXTENT = 1e-4  # m, of an object's bounding box along each axis, so that the transform into the box is invertible


@dataclass(frozen=True, eq=False)
class ObjectParts:
    """Meshes of objects, one row for each, object after object.

    Attributes:
        mesh: int32 [p], row of the mesh.
        owner: int32 [p], row of the object.
        matrix: float64 [p, 3, 4], from the mesh's space to the object's, m.
        box_from_mesh: float64 [p, 3, 4], from the mesh's space to 0..1 in the bounding box of the whole object.
        number: int32 [p], number of the first of the object's named parts that the mesh shows.
        color: float32 [p, 4], see `Instance.color`; NaN for none.
    """

    mesh: NDArray[np.int32]
    owner: NDArray[np.int32]
    matrix: Matrix
    box_from_mesh: Matrix
    number: NDArray[np.int32]
    color: NDArray[np.float32]


def joined(parts: Sequence[ObjectParts]) -> ObjectParts:
    """Concatenate tables."""
    none = np.zeros(0, np.int32)
    empty = ObjectParts(none, none, np.zeros((0, 3, 4)), np.zeros((0, 3, 4)), none, np.zeros((0, 4), np.float32))
    columns = zip(*(vars(each).values() for each in (empty, *parts)), strict=True)
    return ObjectParts(*map(np.concatenate, columns))


def instance_colors(description: SceneDescription) -> NDArray[np.float32]:
    """Return the colors of all instances, float32 [n, 4]; NaN for none."""
    result = np.full((len(description.instances), 4), np.nan, np.float32)
    for row, each in enumerate(description.instances):
        if each.color is not None:
            result[row] = each.color
    return result


def rigid(matrices: Matrix) -> Matrix:
    """Return the rotations (see `polar`) and translations of matrices [..., 4, 4]."""
    result = np.zeros(matrices.shape)
    result[..., :3, :3] = polar(matrices[..., :3, :3])[0]
    result[..., :3, 3] = matrices[..., :3, 3]
    result[..., 3, 3] = 1.0
    return result


def object_matrices(description: SceneDescription) -> Matrix:
    """Return the authored transforms of all objects: [n, 4, 4]. Their poses are these without scale (`rigid`)."""
    result = np.tile(np.eye(4), (len(description.objects), 1, 1))
    for each in reversed(description.instances):
        if description.objects[each.object].world_from_object is None:
            result[each.object] = with_origin(each.world_from_object, description.meshes[each.mesh].origin)
    for row, whole in enumerate(description.objects):
        if whole.world_from_object is not None:
            result[row] = whole.world_from_object
    return result


def box_matrices(boxes: Matrix, matrices: Matrix) -> Matrix:
    """Return the transforms from meshes to their objects' boxes, 0..1: [p, 3, 4]. Flat objects lie at 0.5.

    Args:
        boxes: [p, 2, 3], bounding boxes in the objects' spaces, m.
        matrices: [p, 4, 4], from the meshes' spaces to the objects'.
    """
    extent = np.maximum(boxes[:, 1] - boxes[:, 0], MIN_EXTENT)
    unit = np.zeros((len(boxes), 4, 4))
    unit[:, range(3), range(3)], unit[:, 3, 3] = 1.0 / extent, 1.0
    unit[:, :3, 3] = 0.5 - 0.5 * (boxes[:, 0] + boxes[:, 1]) / extent
    result: Matrix = (unit @ matrices)[:, :3]
    return result


def corners(box: Matrix) -> tuple[Vector3, Vector3]:
    """Return the lowest and highest corner of a box [2, 3] as tuples."""
    (a, b, c), (d, e, f) = box.tolist()
    return (a, b, c), (d, e, f)


def as_one(description: SceneDescription, name: str, prim_path: str, category: str, asset: str) -> SceneDescription:
    """Return a description in which all objects are merged into one; its parts are theirs, in order."""
    first, names = [], list[str]()
    for each in description.objects:
        first.append(len(names))
        parts = [part if part.split("/")[0] == each.name else f"{each.name}/{part}" for part in each.parts]
        names += parts or [each.name]
    if len(description.objects) == 1:
        names = list(description.objects[0].parts)
    instances = tuple(replace(each, object=0, part=first[each.object] + each.part) for each in description.instances)
    colliders = tuple(replace(each, object=0) for each in description.colliders)
    movable = any(each.movable for each in description.objects)
    whole = SceneObject(name, prim_path, category, tuple(names) if len(names) > 1 else (), movable, asset)
    objects = (whole,) if description.objects else ()
    return replace(description, instances=instances, objects=objects, colliders=colliders, object_tracks=())
