# SPDX-License-Identifier: Apache-2.0
"""Subdivision surfaces of UsdGeomMesh: adaptive number of levels, boundary rules, face-varying uv, smooth normals.

`subdivide` turns a control mesh into the triangles of its limit surface. The rules of refinement are in
`catmull_clark`; boundary and face-varying options follow OpenSubdiv's documentation.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.skinned_deformation import ControlledSurface, LinearMap, SmoothNormals
from tiscene.usd.geometry.catmull_clark import Cage, Creases, Floats, Ints, limit, refine
from tiscene.usd.geometry.primvar import Topology
from tiscene.usd.geometry.subdivision_maps import limit_map, refine_map
from tiscene.usd.geometry.triangulate import cross, triangulate
from tiscene.usd.geometry.vertex_weld import (
    Attribute,
    WeldedMesh,
    sum_rows,
    unique_rows,
    weld,
    with_position_samples,
)

MAX_LEVELS = 4
MAX_QUADS = 1 << 18
MAX_FLAT_ANGLE = np.radians(8.0)  # between neighboring faces; below it silhouettes look smooth at usual sizes


def subdivide(
    points: NDArray[np.float32],
    topology: Topology,
    creases: Creases,
    visible: NDArray[np.bool_],
    uv: Attribute | None,
    boundary: str = "edgeAndCorner",
    uv_rule: str = "cornersPlus1",
    position_samples: NDArray[np.float32] | None = None,
    levels: int = MAX_LEVELS,
    controlled: bool = False,
) -> WeldedMesh:
    """Return the limit surface as triangles with smooth normals, split along edges that stay sharp.

    Refines until neighboring faces are nearly flat, at most `levels` times. A mesh that would become more than
    MAX_QUADS faces in the first level is not refined; it gets smooth normals.

    Args:
        points: float32 [n, 3], the control points.
        topology: the faces.
        creases: sharp edges and points.
        visible: [faces], False for holes.
        uv: texture coordinates and other values to interpolate, of points or corners; None for none.
        boundary: UsdGeomMesh's interpolateBoundary: "none", "edgeOnly" or "edgeAndCorner".
        uv_rule: UsdGeomMesh's faceVaryingLinearInterpolation, for values of corners.
        position_samples: float32 [s, n, 3], the control points at other times; None for a constant shape.
        levels: how often to refine at most. 0: the faces stay those of the cage, with their points moved to the limit
            surface.
        controlled: whether to return how the control points decide the vertices, too (`WeldedMesh.control`).
    """
    cage, source = _control_cage(topology, creases)
    visible = visible[source]
    if boundary == "none":
        at_boundary = _on_boundary(cage)[cage.indices]
        touches = np.logical_or.reduceat(at_boundary, cage.starts) if len(cage.starts) else visible
        visible = visible & ~touches
    elif boundary == "edgeAndCorner":
        cage = cage.with_boundary_corners_sharp()
    values = points.astype(np.float64)
    uv_cage = uv_values = None
    if uv is not None and uv.per_corner:
        uv = Attribute(uv.values[(topology.counts >= 3)[topology.face_of_corner]], per_corner=True)
        uv_cage, uv_values = _uv_cage(cage, uv.values, uv_rule)
    elif uv is not None:
        values = np.concatenate([values, uv.values], axis=1)
    width = values.shape[1]
    if position_samples is not None:  # all times share the rules, so they are refined side by side
        values = np.concatenate([values, *position_samples.astype(np.float64)], axis=1)
    maps: list[LinearMap] | None = [] if controlled else None
    if len(cage.indices) > MAX_QUADS:  # the cage is already as fine as a refined surface
        return _triangulate_cage(cage, values[:, :3], uv, values[:, width:], visible, source, maps)
    if not levels:
        if maps is not None:
            maps += [refine_map(cage), limit_map(refine(cage, values)[0], cage.points)]
        return _triangulate_cage(cage, *_on_limit(cage, values, uv, width), visible, source, maps)
    for level in range(levels):
        if len(cage.indices) > MAX_QUADS or (level > 1 and _is_flat(cage, values[:, :3])):
            break
        visible, source = visible[cage.face], source[cage.face]
        if maps is not None:
            maps.append(refine_map(cage))
        if uv_cage is not None and uv_values is not None:
            uv_cage, uv_values = refine(uv_cage, uv_values)
        cage, values = refine(cage, values)
    if maps is not None:
        maps.append(limit_map(cage))
    values = limit(cage, values)
    if uv_cage is not None and uv_values is not None:
        uv = Attribute(limit(uv_cage, uv_values)[uv_cage.indices].astype(np.float32), per_corner=True)
    elif uv is not None:
        uv = Attribute(values[:, 3:width].astype(np.float32), per_corner=False)
    return _triangulate_cage(cage, values[:, :3], uv, values[:, width:], visible, source, maps)


def _on_limit(cage: Cage, values: Floats, uv: Attribute | None, width: int) -> tuple[Floats, Attribute | None, Floats]:
    """Return the limit positions of a cage's own points, their texture coordinates, and their samples over time.

    A cage may have faces of any size. The limits of its points are found after one refinement, which keeps them first.
    """
    moved = limit(*refine(cage, values))[: cage.points]
    if uv is not None and not uv.per_corner:
        uv = Attribute(moved[:, 3:width].astype(np.float32), per_corner=False)
    return moved[:, :3], uv, moved[:, width:]


def smooth_levels(points: NDArray[np.float32], topology: Topology) -> int:
    """Return about how often a mesh without creases is refined until neighboring faces are nearly flat.

    Each level halves the angles between neighboring faces.
    """
    cage, _ = _control_cage(topology, Creases.none())
    if len(cage.indices) > MAX_QUADS:
        return 0
    cosine = _cosines(cage, points.astype(np.float64))
    angle = float(np.arccos(np.clip(np.quantile(cosine, 0.1), -1.0, 1.0))) if len(cosine) else 0.0
    most = 1 + math.floor(math.log(MAX_QUADS / len(cage.indices), 4.0))  # refining stops there, as in `subdivide`
    return min(max(2, math.ceil(math.log2(max(angle / MAX_FLAT_ANGLE, 1.0)))), MAX_LEVELS, most)


def _control_cage(topology: Topology, creases: Creases) -> tuple[Cage, Ints]:
    """Return the cage of a mesh, without faces of fewer than three corners, and the mesh's face of each cage face."""
    source = np.flatnonzero(topology.counts >= 3)
    kept = (topology.counts >= 3)[topology.face_of_corner]
    counts, indices = topology.counts[source].astype(np.int64), topology.indices[kept].astype(np.int64)
    point_sharpness = np.zeros(topology.points)
    np.maximum.at(point_sharpness, creases.points, creases.point_sharpness)
    cage = Cage(counts, indices, np.zeros(len(indices)), point_sharpness)
    if len(creases.edges):
        ends = np.sort(creases.edges, axis=1)
        wanted = ends[:, 0] * cage.points + ends[:, 1]
        known = cage.edge_points[:, 0] * cage.points + cage.edge_points[:, 1]
        row = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
        found = known[row] == wanted  # creases that follow no edge of the mesh are ignored
        sharpness = np.zeros(len(known))
        np.maximum.at(sharpness, row[found], creases.edge_sharpness[found])
        cage = Cage(counts, indices, sharpness[cage.edge], point_sharpness)
    return cage, source


def _uv_cage(cage: Cage, uv: NDArray[np.float32], rule: str) -> tuple[Cage, Floats]:
    """Return a cage over the distinct texture coordinates and their values, for face-varying refinement.

    A uv seam is a boundary of that cage. `rule` (faceVaryingLinearInterpolation) says which of its points are sharp.
    """
    first, index = unique_rows([cage.indices, uv])
    sharpness = cage.point_sharpness[cage.indices[first]]
    edge_sharpness = cage.edge_sharpness
    over = Cage(cage.counts, index, edge_sharpness, sharpness)
    values = uv[first].astype(np.float64)
    if rule == "all":
        return Cage(cage.counts, index, np.full_like(edge_sharpness, np.inf), np.full_like(sharpness, np.inf)), values
    if rule == "none":
        return over, values
    on_seam = np.zeros(len(first), dtype=bool)
    on_seam[over.edge_points[over.edge_faces != 2]] = True
    sharp = on_seam & (np.bincount(index, minlength=len(first)) == 1)
    if rule == "boundaries":
        sharp = on_seam
    elif rule in ("cornersPlus1", "cornersPlus2"):
        distinct = np.bincount(cage.indices[first], minlength=cage.points)  # number of values at each point
        sharp |= (distinct >= 3)[cage.indices[first]]
        if rule == "cornersPlus2":  # also seams with a corner on one side, and darts (ends of seams)
            corner_near = np.bincount(cage.indices[first][sharp], minlength=cage.points) > 0
            dart = (distinct == 1)[cage.indices[first]] & on_seam & ~_on_boundary(cage)[cage.indices[first]]
            sharp |= (on_seam & corner_near[cage.indices[first]]) | dart
    return Cage(cage.counts, index, edge_sharpness, np.where(sharp, np.inf, sharpness)), values


def _on_boundary(cage: Cage) -> NDArray[np.bool_]:
    """Return whether each point lies on an edge of one face."""
    result = np.zeros(cage.points, dtype=bool)
    result[cage.edge_points[cage.edge_faces == 1]] = True
    return result


def _face_normals(cage: Cage, positions: Floats) -> Floats:
    """Return the area vectors of the faces [faces, 3] by Newell's method."""
    p = positions[cage.indices]
    p = p - p[cage.starts][cage.face]
    normals: Floats = 0.5 * np.add.reduceat(cross(p, p[cage.following]), cage.starts, axis=0)
    return normals


def _is_flat(cage: Cage, positions: Floats) -> bool:
    """Return whether 90 % of the pairs of neighboring faces meet at less than MAX_FLAT_ANGLE."""
    cosine = _cosines(cage, positions)
    return len(cosine) == 0 or bool(np.quantile(cosine, 0.1) > np.cos(MAX_FLAT_ANGLE))


def _cosines(cage: Cage, positions: Floats) -> Floats:
    """Return the cosine of the angle between the faces at each smooth edge [k]."""
    normal = _face_normals(cage, positions)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    c, d = cage.smooth_pairs
    return np.asarray(np.einsum("ij,ij->i", normal[cage.face[c]], normal[cage.face[d]]))


def _triangulate_cage(
    cage: Cage,
    positions: Floats,
    uv: Attribute | None,
    samples: Floats,
    visible: NDArray[np.bool_],
    source: Ints,
    maps: list[LinearMap] | None,
) -> WeldedMesh:
    """Triangulate a refined cage and weld its corners.

    Args:
        cage: the control mesh.
        positions: float64 [points, 3].
        uv: texture coordinates and other values, or None.
        samples: float64 [points, 3 s], the positions at other times side by side; s may be 0.
        visible: [faces], False for holes.
        source: [faces], the authored face of each.
        maps: what made `positions` of the control points; None: they do not move by a skin.
    """
    group = _smoothing_groups(cage)

    def normals_of(positions: Floats) -> Attribute:
        normal = sum_rows(group, _face_normals(cage, positions)[cage.face], int(group.max(initial=-1)) + 1)
        return Attribute(normal[group].astype(np.float32), per_corner=True)

    corners, face = triangulate(positions, cage.counts, cage.indices)
    kept = visible[face]
    faces = cage.indices, corners[kept], source[face[kept]]
    if maps is not None:
        surface = weld(positions.astype(np.float32), *faces, normals_of(positions), uv, split_by=group)
        assert surface.point is not None
        assert surface.corner is not None
        corner_groups = group.astype(np.int32)
        smooth = SmoothNormals(cage.indices.astype(np.int32), cage.starts, corner_groups, corner_groups[surface.corner])
        points = surface.point.astype(np.int32)
        return replace(surface, control=ControlledSurface(tuple(maps), points, surface.triangles, smooth=smooth))
    if not samples.shape[1]:
        return weld(positions.astype(np.float32), *faces, normals_of(positions), uv)
    surface = weld(positions.astype(np.float32), *faces, normals_of(positions), uv, split_by=group)
    sampled = samples.reshape(len(samples), -1, 3).transpose(1, 0, 2)
    return with_position_samples(surface, sampled, [normals_of(each) for each in sampled])


def _smoothing_groups(cage: Cage) -> Ints:
    """Return a group for each corner [corners]: corners of one point connected across smooth edges share one."""
    c, d = cage.smooth_pairs
    # For faces of the same winding, an edge runs c -> next(c) in one and d -> next(d) in the other, with c = next(d).
    same_winding = cage.indices[c] != cage.indices[d]
    c_end, d_end = cage.following[c], cage.following[d]
    a = np.concatenate([c, c_end])
    b = np.concatenate([np.where(same_winding, d_end, d), np.where(same_winding, d, d_end)])
    label = np.arange(len(cage.indices))
    while True:  # connected components by label propagation; pointer jumping halves chains, so it takes few rounds
        smallest = np.minimum(label[a], label[b])
        following = label.copy()
        np.minimum.at(following, a, smallest)
        np.minimum.at(following, b, smallest)
        following = following[following]
        if (following == label).all():
            used = np.zeros(len(label), np.int64)
            used[label] = 1
            return np.asarray((np.cumsum(used) - 1)[label])
        label = following
