# SPDX-License-Identifier: Apache-2.0
"""Instances of frames: what kernels read of each, those of several frames one after the other, one upload of all.

Taichi allocates memory on a GPU for each NumPy argument of a kernel, copies it there and back, and frees it. So the
arrays of a frame's instances and the nodes above them travel as one.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2
from tiscene.scene.bvh.rebraid import INFO_PARTS, PARTS
from tiscene.scene.description import Mesh
from tiscene.scene.placement import CURRENT, Placement

# Columns of `DeviceScene.instance_info`; from INFO_PARTS (`bvh.rebraid`) on are the references of the BLAS's parts.
INFO_BLAS, INFO_FIRST_TRIANGLE, INFO_INSTANCE_ID, INFO_CATEGORY_ID, INFO_MESH, INFO_FLAGS = range(6)
INFO_PART, INFO_MOVED, INFO_COLORS, INFO_LINK_CLASS, INFO_COLOR, INFO_COLUMNS = 6, 7, 8, 17, 18, 22
OF_MESH = [INFO_BLAS, INFO_FIRST_TRIANGLE, INFO_FLAGS, INFO_MOVED, INFO_COLORS, INFO_LINK_CLASS]
HAS_NORMALS, HAS_UV, MIRRORED, HAS_COLORS, OWN_COLOR, OWN_OPACITY = 1, 2, 4, 8, 16, 32  # bits of the flags

NO_INSTANCES = Placement(
    mesh=np.zeros(0, np.int32),
    instance_id=np.zeros(0, np.int32),
    category_id=np.zeros(0, np.int32),
    world_from_object=np.zeros((3, 0, 3, 4)),
    box_from_object=np.zeros((0, 3, 4)),
    present=np.zeros((3, 0), bool),
)


def attribute_flags(mesh: Mesh) -> int:
    """Return the flags of a mesh."""
    attributes = (HAS_NORMALS, mesh.normals), (HAS_UV, mesh.uv), (HAS_COLORS, mesh.colors)
    return sum(flag for flag, values in attributes if values is not None)


def info_rows(
    placement: Placement,
    meshes: NDArray[np.int32],
    parts: NDArray[np.int32],
    mirrored: NDArray[np.bool_],
    time: int = CURRENT,
) -> NDArray[np.int32]:
    """Return `DeviceScene.instance_info` of a placement, int32 [n, INFO_COLUMNS].

    Args:
        placement: The instances.
        meshes: int32 [m, 6], the columns OF_MESH of each mesh.
        parts: int32 [m, PARTS], references of the parts of each mesh.
        mirrored: bool [n], whether the transform of an instance mirrors.
        time: Of the colors.
    """
    info = np.zeros((len(placement.mesh), INFO_COLUMNS), np.int32)
    info[:, OF_MESH] = meshes[placement.mesh]
    info[:, INFO_PARTS : INFO_PARTS + PARTS] = parts[placement.mesh]
    info[:, INFO_INSTANCE_ID], info[:, INFO_CATEGORY_ID] = placement.instance_id, placement.category_id
    info[:, INFO_MESH], info[:, INFO_PART] = placement.mesh, 0 if placement.part is None else placement.part
    info[:, INFO_FLAGS] |= np.where(mirrored, MIRRORED, 0)
    if placement.color is not None:
        own = ~np.isnan(placement.color[time])
        info[:, INFO_FLAGS] |= np.where(own[:, 0], OWN_COLOR, 0) | np.where(own[:, 3], OWN_OPACITY, 0)
        info[:, INFO_COLOR : INFO_COLOR + 4] = placement.color[time].view(np.int32)
    return info


def stacked(placements: Sequence[Placement]) -> Placement:
    """Return the instances of several placements one after the other. Lights are those of the first."""
    first = placements[0]
    parts = [np.zeros(len(each.mesh), np.int32) if each.part is None else each.part for each in placements]
    return replace(
        first,
        mesh=np.concatenate([each.mesh for each in placements]),
        instance_id=np.concatenate([each.instance_id for each in placements]),
        category_id=np.concatenate([each.category_id for each in placements]),
        world_from_object=np.concatenate([each.world_from_object for each in placements], axis=1),
        box_from_object=np.concatenate([each.box_from_object for each in placements]),
        present=np.concatenate([each.present for each in placements], axis=1),
        part=np.concatenate(parts),
        color=_stacked_colors(placements),
    )


def _stacked_colors(placements: Sequence[Placement]) -> NDArray[np.float32] | None:
    """Return the colors of the instances of several placements one after the other."""
    if all(each.color is None for each in placements):
        return None
    none = np.full((3, 1, 4), np.nan, np.float32)
    colors = [none.repeat(len(each.mesh), axis=1) if each.color is None else each.color for each in placements]
    return np.concatenate(colors, axis=1)


def upload_packed(
    values: Sequence[NDArray[Any]],
    tree: tuple[NDArray[np.int32], NDArray[np.int32]],
    arrays: Sequence[Any],
    nodes: Any,
) -> None:
    """Write the arrays of instances, and nodes of the layout "bvh2", with one upload and one launch.

    Args:
        values: int32 [n, k] of `instance_info`; float32 of `world_from_instance`, `instance_from_world` and
            `box_from_instance`.
        tree: int32 [m], int32 [m, 16], of `Bvh.take_unwritten`.
        arrays: The device arrays of the values.
        nodes: The device array of the nodes.
    """
    numbers, rows = tree
    packed = np.concatenate([each.view(np.int32).ravel() for each in (*values, numbers, rows)])
    unpack(packed, len(values[0]), len(numbers), *arrays, nodes)


@ti.kernel
def unpack(
    packed: Ints1,
    count: ti.i32,
    node_count: ti.i32,
    info: Ints2,
    world: Floats3,
    inverse: Floats3,
    box: Floats2,
    nodes: Floats2,
):
    """Write consecutive bit patterns into device arrays.

    Args:
        packed: The arrays from `info` to `box`, then the numbers of nodes, then 16 columns of each node.
        count: Number of instances.
        node_count: Number of nodes.
    """
    columns = info.shape[1]
    for i, c in ti.ndrange(count, columns):
        info[i, c] = packed[i * columns + c]
    for time, i, c in ti.ndrange(3, count, 12):
        at = columns * count + (time * count + i) * 12 + c
        world[time, i, c] = ti.bit_cast(packed[at], ti.f32)
        inverse[time, i, c] = ti.bit_cast(packed[at + 36 * count], ti.f32)
    for i, c in ti.ndrange(count, 12):
        box[i, c] = ti.bit_cast(packed[(columns + 72) * count + i * 12 + c], ti.f32)
    for i, c in ti.ndrange(node_count, 16):
        first = (columns + 84) * count
        nodes[packed[first + i], c] = ti.bit_cast(packed[first + node_count + i * 16 + c], ti.f32)
