# SPDX-License-Identifier: Apache-2.0
"""Skins of meshes while they are read: their shape at the time read, and how vertices follow their points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import between
from tiscene.scene.skinned_deformation import ControlledSurface, Skin, SkinnedDeformation
from tiscene.usd.core.content import content_digest
from tiscene.usd.geometry.primvar import Topology
from tiscene.usd.geometry.vertex_weld import Attribute, WeldedMesh


def with_normals(skin: Skin, normals: Attribute | None, topology: Topology) -> Skin:
    """Return a skin that moves the authored normals of its mesh too."""
    if normals is None:
        return skin
    points = topology.indices if normals.per_corner else np.arange(topology.points)
    return replace(skin, normals=np.asarray(normals.values, np.float64), normal_points=points.astype(np.int32))


def posed(skin: Skin, normals: Attribute | None, seconds: float) -> tuple[NDArray[np.float32], Attribute | None]:
    """Return the points and the authored normals of a mesh at a time, s."""
    row, t = between(skin.poses.times, seconds)
    points, moved = skin.at(row)
    if t > 0.0:
        later, later_moved = skin.at(row + 1)
        points = points + t * (later - points)
        moved = None if moved is None or later_moved is None else moved + t * (later_moved - moved)
    if normals is not None and moved is not None:
        normals = replace(normals, values=moved.astype(np.float32))
    return points.astype(np.float32), normals


def control_of(surface: WeldedMesh, normals: Attribute | None) -> ControlledSurface:
    """Return how the vertices of a mesh of flat faces follow its points and authored normals."""
    assert surface.point is not None
    assert surface.corner is not None
    points = surface.point.astype(np.int32)
    rows = None
    if normals is not None:
        rows = surface.corner.astype(np.int32) if normals.per_corner else points
    return ControlledSurface((), points, surface.triangles, rows)


def content_of(deformation: SkinnedDeformation) -> bytes:
    """Return a digest that equal skins share. Equal poses are the same object in one process."""
    skin = deformation.skin
    values: list[Any] = [id(skin.poses), skin.points, skin.normals, skin.joints, skin.weights, skin.bind]
    values.append(skin.mesh_from_skeleton)
    if skin.shapes is not None:
        values += [skin.shapes.shape, skin.shapes.point, skin.shapes.offset, skin.shapes.weights]
        values += [] if skin.shapes.normal_offset is None else [skin.shapes.normal_offset]
    return content_digest(values)
