# SPDX-License-Identifier: Apache-2.0
"""Catmull-Clark subdivision with semi-sharp creases, boundaries and face-varying texture coordinates.

The rules are those that UsdGeomMesh names: Catmull and Clark 1978, creases after DeRose, Kass and Truong 1998 with
uniform sharpness, boundary and face-varying options as OpenSubdiv documents them. Everything works on whole arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.primvar import Topology
from tiscene.usd.geometry.triangulate import cross, triangulate
from tiscene.usd.geometry.vertex_weld import Attribute, WeldedMesh, sum_rows, unique_rows, weld, with_moved

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_LEVELS = 4
MAX_QUADS = 1 << 18
FLAT_ENOUGH = np.radians(8.0)  # between neighboring faces: below it a silhouette shows no corners at usual sizes


@dataclass(frozen=True, eq=False)
class Creases:
    """Sharp edges [k, 2] of points and sharp points [k], with their sharpnesses; inf stays sharp for ever."""

    edges: Ints
    edge_sharpness: Floats
    points: Ints
    point_sharpness: Floats

    @classmethod
    def none(cls) -> Creases:
        return cls(np.empty((0, 2), np.int64), np.empty(0), np.empty(0, np.int64), np.empty(0))


@dataclass(frozen=True, eq=False)
class Cage:
    """A control mesh: counts [faces], indices [corners] of its points, edge_sharpness [corners] of the edge from each
    corner to the next one of its face, point_sharpness [points]."""

    counts: Ints
    indices: Ints
    edge_sharpness: Floats
    point_sharpness: Floats

    @property
    def points(self) -> int:
        return len(self.point_sharpness)

    @cached_property
    def starts(self) -> Ints:
        """The first corner of each face."""
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def face(self) -> Ints:
        """The face of each corner."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def following(self) -> Ints:
        """The next corner around the face of each corner."""
        corner = np.arange(len(self.indices)) + 1
        corner[self.starts + self.counts - 1] = self.starts
        return corner

    @cached_property
    def preceding(self) -> Ints:
        """The previous corner around the face of each corner."""
        corner = np.empty_like(self.following)
        corner[self.following] = np.arange(len(corner))
        return corner

    @cached_property
    def _edges(self) -> tuple[Ints, Ints]:
        ends = np.stack([self.indices, self.indices[self.following]], axis=-1)
        ends.sort(axis=1)
        keys, edge = np.unique(ends[:, 0] * self.points + ends[:, 1], return_inverse=True)
        return np.stack(np.divmod(keys, max(self.points, 1)), axis=-1), edge.reshape(-1)

    @property
    def edge_points(self) -> Ints:
        """The two points of each edge [edges, 2]."""
        return self._edges[0]

    @property
    def edge(self) -> Ints:
        """The edge from each corner to the following one."""
        return self._edges[1]

    @cached_property
    def edge_faces(self) -> Ints:
        """How many faces meet at each edge."""
        return np.bincount(self.edge, minlength=len(self.edge_points))

    @cached_property
    def sharpness(self) -> Floats:
        """Of each edge; those with one face, or more than two, are sharp for ever."""
        sharpness = np.zeros(len(self.edge_points))
        np.maximum.at(sharpness, self.edge, self.edge_sharpness)
        sharpness[self.edge_faces != 2] = np.inf
        return sharpness

    @cached_property
    def incident(self) -> tuple[Ints, Ints, Ints]:
        """Every edge from both its ends: (point, the point at the other end, edge)."""
        a, b = self.edge_points.T
        edge = np.arange(len(a))
        return np.concatenate([a, b]), np.concatenate([b, a]), np.concatenate([edge, edge])

    @cached_property
    def smooth_pairs(self) -> tuple[Ints, Ints]:
        """Corners (c, d) whose edges to the following corner are one smooth edge, seen from its two faces."""
        order = np.argsort(self.edge, kind="stable")
        first = np.cumsum(self.edge_faces) - self.edge_faces
        inner = first[(self.edge_faces == 2) & (self.sharpness <= 0.0)]
        return order[inner], order[inner + 1]

    def with_boundary_corners_sharp(self) -> Cage:
        """Points that only one face uses become sharp: the "edgeAndCorner" rule."""
        uses = np.bincount(self.indices, minlength=self.points)
        sharpness = np.where(uses == 1, np.inf, self.point_sharpness)
        return Cage(self.counts, self.indices, self.edge_sharpness, sharpness)


def refine(cage: Cage, values: Floats) -> tuple[Cage, Floats]:
    """One level: each corner of each face becomes a quadrilateral, in the order of the corners.

    values: [points, c], positions or anything else that is interpolated like them.
    """
    face_point = np.add.reduceat(values[cage.indices], cage.starts, axis=0) / cage.counts[:, None]
    ends = values[cage.edge_points]
    middle = ends.mean(axis=1)
    around = sum_rows(cage.edge, face_point[cage.face], len(middle))
    smooth = (ends.sum(axis=1) + around) / 4.0
    blend = np.clip(cage.sharpness, 0.0, 1.0)[:, None]
    edge_point = np.where(blend >= 1.0, middle, smooth + blend * (middle - smooth))
    child_sharpness = np.maximum(cage.sharpness - 1.0, 0.0)
    child_point_sharpness = np.maximum(cage.point_sharpness - 1.0, 0.0)
    point = _refined_points(cage, values, face_point, middle, child_sharpness, child_point_sharpness)

    edges, faces = len(middle), len(face_point)
    out_edge, in_edge = cage.edge, cage.edge[cage.preceding]
    quads = np.stack(
        [cage.indices, cage.points + out_edge, cage.points + edges + cage.face, cage.points + in_edge], axis=-1
    )
    inner = np.zeros(len(quads))
    child = Cage(
        counts=np.full(len(quads), 4),
        indices=quads.reshape(-1),
        edge_sharpness=np.stack([child_sharpness[out_edge], inner, inner, child_sharpness[in_edge]], axis=-1).reshape(
            -1
        ),
        point_sharpness=np.concatenate([child_point_sharpness, np.zeros(edges + faces)]),
    )
    return child, np.concatenate([point, edge_point, face_point])


def _refined_points(
    cage: Cage, values: Floats, face_point: Floats, middle: Floats, child_edge: Floats, child_point: Floats
) -> Floats:
    """Where the points move. A point whose sharpness runs out within this level lies between both levels' rules."""
    at, other, edge = cage.incident
    valence = np.maximum(np.bincount(at, minlength=cage.points), 1)[:, None]
    uses = np.bincount(cage.indices, minlength=cage.points)[:, None]
    mean_face = sum_rows(cage.indices, face_point[cage.face], cage.points) / np.maximum(uses, 1)
    mean_edge = sum_rows(at, middle[edge], cage.points) / valence
    smooth = (mean_face + 2.0 * mean_edge + (valence - 3.0) * values) / valence
    smooth = np.where(uses == 0, values, smooth)

    def by_rule(edge_sharpness: Floats, point_sharpness: Floats) -> Floats:
        sharp = edge_sharpness[edge] > 0.0
        count = np.bincount(at[sharp], minlength=cage.points)[:, None]
        crease = (6.0 * values + sum_rows(at[sharp], values[other[sharp]], cage.points)) / 8.0
        corner = (count > 2) | (point_sharpness > 0.0)[:, None]
        return np.where(corner, values, np.where(count == 2, crease, smooth))

    now = by_rule(cage.sharpness, cage.point_sharpness)
    edge_ends = ((cage.sharpness > 0.0) & (child_edge <= 0.0))[edge]
    point_ends = (cage.point_sharpness > 0.0) & (child_point <= 0.0)
    count = np.bincount(at[edge_ends], minlength=cage.points) + point_ends
    if not count.any():
        return now
    total = np.bincount(at[edge_ends], cage.sharpness[edge[edge_ends]], minlength=cage.points)
    total = total + np.where(point_ends, cage.point_sharpness, 0.0)  # bincount of nothing is of whole numbers
    weight = np.where(count > 0, np.minimum(total / np.maximum(count, 1), 1.0), 1.0)[:, None]
    later = by_rule(child_edge, child_point)
    return np.asarray(weight * now + (1.0 - weight) * later)


def limit(cage: Cage, values: Floats) -> Floats:
    """Where the points of a cage of quadrilaterals end after endless refinement, its sharp edges taken as endless."""
    at, other, edge = cage.incident
    valence = np.bincount(at, minlength=cage.points)[:, None].astype(np.float64)
    neighbors = sum_rows(at, values[other], cage.points)
    opposite = cage.indices[cage.following[cage.following]]
    diagonals = sum_rows(cage.indices, values[opposite], cage.points)
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = (valence**2 * values + 4.0 * neighbors + diagonals) / (valence * (valence + 5.0))
    sharp = cage.sharpness[edge] > 0.0
    count = np.bincount(at[sharp], minlength=cage.points)[:, None]
    crease = (4.0 * values + sum_rows(at[sharp], values[other[sharp]], cage.points)) / 6.0
    corner = (count > 2) | (cage.point_sharpness > 0.0)[:, None] | (valence == 0)
    return np.where(corner, values, np.where(count == 2, crease, smooth))


def subdivide(
    points: NDArray[np.float32],
    topology: Topology,
    creases: Creases,
    drawn: NDArray[np.bool_],
    uv: Attribute | None,
    boundary: str = "edgeAndCorner",
    uv_rule: str = "cornersPlus1",
    moved: NDArray[np.float32] | None = None,
) -> WeldedMesh:
    """The limit surface as triangles with smooth normals, split where edges stay sharp.

    Refines until neighboring faces are nearly flat, at most MAX_LEVELS times; a mesh that would become more than
    MAX_QUADS faces at once stays as it is, with smooth normals. drawn: [faces], False for holes.
    boundary: interpolateBoundary. uv_rule: faceVaryingLinearInterpolation. moved: [s, n, 3], the points at other times.
    """
    cage, source = _control_cage(topology, creases)
    drawn = drawn[source]
    if boundary == "none":
        on_boundary = np.zeros(cage.points, dtype=bool)
        on_boundary[cage.edge_points[cage.edge_faces == 1]] = True
        touches = np.logical_or.reduceat(on_boundary[cage.indices], cage.starts) if len(cage.starts) else drawn
        drawn = drawn & ~touches
    elif boundary == "edgeAndCorner":
        cage = cage.with_boundary_corners_sharp()
    values = points.astype(np.float64)
    uv_cage = uv_values = None
    if uv is not None and uv.per_corner:
        kept = (topology.counts >= 3)[topology.face_of_corner]
        uv_cage, uv_values = _uv_cage(cage, uv.values[kept], uv_rule)
    elif uv is not None:
        values = np.concatenate([values, uv.values], axis=1)
    width = values.shape[1]
    if moved is not None:  # the rules are the same for all: refined side by side
        values = np.concatenate([values, *moved.astype(np.float64)], axis=1)
    dense = len(cage.indices) > MAX_QUADS
    for level in range(MAX_LEVELS):
        if len(cage.indices) > MAX_QUADS:
            break
        if level > 1 and _is_flat(cage, values[:, :3]):
            break
        drawn, source = drawn[cage.face], source[cage.face]
        if uv_cage is not None and uv_values is not None:
            uv_cage, uv_values = refine(uv_cage, uv_values)
        cage, values = refine(cage, values)
    if dense:  # its cage is as fine as a refined surface would be
        return _as_surface(cage, values[:, :3], drawn, source, uv, values[:, width:])
    values = limit(cage, values)
    if uv_cage is not None and uv_values is not None:
        uv = Attribute(limit(uv_cage, uv_values)[uv_cage.indices].astype(np.float32), per_corner=True)
    elif uv is not None:
        uv = Attribute(values[:, 3:width].astype(np.float32), per_corner=False)
    return _as_surface(cage, values[:, :3], drawn, source, uv, values[:, width:])


def _control_cage(topology: Topology, creases: Creases) -> tuple[Cage, Ints]:
    """The cage of a mesh and the mesh's face of each of its faces; faces of fewer than three corners are left out."""
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
        found = known[row] == wanted  # a crease along no edge of the mesh has nothing to sharpen
        sharpness = np.zeros(len(known))
        np.maximum.at(sharpness, row[found], creases.edge_sharpness[found])
        cage = Cage(counts, indices, sharpness[cage.edge], point_sharpness)
    return cage, source


def _uv_cage(cage: Cage, uv: NDArray[np.float32], rule: str) -> tuple[Cage, Floats]:
    """The faces over their distinct texture coordinates: a seam is a boundary there, refined by its own rule."""
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
        distinct = np.bincount(cage.indices[first], minlength=cage.points)  # values that meet at each point
        sharp |= (distinct >= 3)[cage.indices[first]]
        if rule == "cornersPlus2":  # also where one side of a seam has a corner, and where a seam ends
            corner_near = np.bincount(cage.indices[first][sharp], minlength=cage.points) > 0
            dart = (distinct == 1)[cage.indices[first]] & on_seam & ~_on_boundary(cage)[cage.indices[first]]
            sharp |= (on_seam & corner_near[cage.indices[first]]) | dart
    return Cage(cage.counts, index, edge_sharpness, np.where(sharp, np.inf, sharpness)), values


def _on_boundary(cage: Cage) -> NDArray[np.bool_]:
    result = np.zeros(cage.points, dtype=bool)
    result[cage.edge_points[cage.edge_faces == 1]] = True
    return result


def _face_normals(cage: Cage, positions: Floats) -> Floats:
    """Area vectors of the faces [faces, 3], by Newell's sum."""
    p = positions[cage.indices]
    p = p - p[cage.starts][cage.face]
    normals: Floats = 0.5 * np.add.reduceat(cross(p, p[cage.following]), cage.starts, axis=0)
    return normals


def _is_flat(cage: Cage, positions: Floats) -> bool:
    """Whether nine of ten pairs of neighboring faces meet at less than FLAT_ENOUGH."""
    normal = _face_normals(cage, positions)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    c, d = cage.smooth_pairs
    if len(c) == 0:
        return True
    cosine = np.einsum("ij,ij->i", normal[cage.face[c]], normal[cage.face[d]])
    return bool(np.quantile(cosine, 0.1) > np.cos(FLAT_ENOUGH))


def _as_surface(
    cage: Cage, positions: Floats, drawn: NDArray[np.bool_], source: Ints, uv: Attribute | None, moved: Floats
) -> WeldedMesh:
    """moved: [points, 3 s], the positions at other times side by side."""
    group = _smoothing_groups(cage)

    def normals_of(positions: Floats) -> Attribute:
        normal = sum_rows(group, _face_normals(cage, positions)[cage.face], int(group.max(initial=-1)) + 1)
        return Attribute(normal[group].astype(np.float32), per_corner=True)

    corners, face = triangulate(positions, cage.counts, cage.indices)
    kept = drawn[face]
    faces = cage.indices, corners[kept], source[face[kept]]
    if not moved.shape[1]:
        return weld(positions.astype(np.float32), *faces, normals_of(positions), uv)
    surface = weld(positions.astype(np.float32), *faces, normals_of(positions), uv, apart=group)
    points = moved.reshape(len(moved), -1, 3).transpose(1, 0, 2)
    return with_moved(surface, points, [normals_of(each) for each in points])


def _smoothing_groups(cage: Cage) -> Ints:
    """A number for each corner, the same for corners of one point that are joined across smooth edges."""
    c, d = cage.smooth_pairs
    # Across an edge seen as c -> next(c) and d -> next(d), c's point is next(d)'s, if the faces wind alike.
    alike = cage.indices[c] != cage.indices[d]
    c_end, d_end = cage.following[c], cage.following[d]
    a = np.concatenate([c, c_end])
    b = np.concatenate([np.where(alike, d_end, d), np.where(alike, d, d_end)])
    label = np.arange(len(cage.indices))
    while True:  # the smallest number spreads; chains halve each time, so this takes few rounds
        smallest = np.minimum(label[a], label[b])
        following = label.copy()
        np.minimum.at(following, a, smallest)
        np.minimum.at(following, b, smallest)
        following = following[following]
        if (following == label).all():
            return np.unique(label, return_inverse=True)[1].reshape(-1)
        label = following
