# SPDX-License-Identifier: Apache-2.0
"""Catmull-Clark rules: control cages with semi-sharp creases, one level of refinement, limit positions.

Catmull and Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes" (1978); semi-sharp creases
of uniform sharpness after DeRose, Kass and Truong, "Subdivision surfaces in character animation" (1998). All functions
work on whole arrays. `subdivision` applies them to a UsdGeomMesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.vertex_weld import sum_rows

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Creases:
    """Sharp edges and sharp points of a control mesh.

    Attributes:
        edges: int64 [k, 2], the two points of each sharp edge.
        edge_sharpness: float64 [k], subdivision levels for which an edge stays sharp; inf: always.
        points: int64 [j], sharp points (UsdGeomMesh's corners).
        point_sharpness: float64 [j], as `edge_sharpness`.
    """

    edges: Ints
    edge_sharpness: Floats
    points: Ints
    point_sharpness: Floats

    @classmethod
    def none(cls) -> Creases:
        """Return no creases."""
        return cls(np.empty((0, 2), np.int64), np.empty(0), np.empty(0, np.int64), np.empty(0))


@dataclass(frozen=True, eq=False)
class Cage:
    """A control mesh (cage): topology and sharpness, without positions.

    Attributes:
        counts: int64 [faces], corners of each face.
        indices: int64 [corners], the point of each corner, face after face.
        edge_sharpness: float64 [corners], sharpness of the edge from each corner to the next corner of its face.
        point_sharpness: float64 [points].
    """

    counts: Ints
    indices: Ints
    edge_sharpness: Floats
    point_sharpness: Floats

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.point_sharpness)

    @cached_property
    def starts(self) -> Ints:
        """First corner of each face, [faces]."""
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def face(self) -> Ints:
        """Face of each corner, [corners]."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def following(self) -> Ints:
        """Next corner around the face of each corner, [corners]."""
        corner = np.arange(len(self.indices)) + 1
        corner[self.starts + self.counts - 1] = self.starts
        return corner

    @cached_property
    def preceding(self) -> Ints:
        """Previous corner around the face of each corner, [corners]."""
        corner = np.empty_like(self.following)
        corner[self.following] = np.arange(len(corner))
        return corner

    @cached_property
    def _edges(self) -> tuple[Ints, Ints]:
        """`edge_points` and `edge`."""
        ends = np.stack([self.indices, self.indices[self.following]], axis=-1)
        ends.sort(axis=1)
        keys, edge = distinct(ends[:, 0] * self.points + ends[:, 1])
        return np.stack(np.divmod(keys, max(self.points, 1)), axis=-1), edge

    @property
    def edge_points(self) -> Ints:
        """The two points of each edge, [edges, 2], the lower one first."""
        return self._edges[0]

    @property
    def edge(self) -> Ints:
        """Edge from each corner to the following one, [corners]."""
        return self._edges[1]

    @cached_property
    def edge_faces(self) -> Ints:
        """Number of faces at each edge, [edges]."""
        return np.bincount(self.edge, minlength=len(self.edge_points))

    @cached_property
    def sharpness(self) -> Floats:
        """Sharpness of each edge, [edges]; inf for edges with one face or more than two."""
        sharpness = np.zeros(len(self.edge_points))
        np.maximum.at(sharpness, self.edge, self.edge_sharpness)
        sharpness[self.edge_faces != 2] = np.inf
        return sharpness

    @cached_property
    def incident(self) -> tuple[Ints, Ints, Ints]:
        """Every edge seen from both its ends: (point, other end, edge), each [2 edges]."""
        a, b = self.edge_points.T
        edge = np.arange(len(a))
        return np.concatenate([a, b]), np.concatenate([b, a]), np.concatenate([edge, edge])

    @cached_property
    def smooth_pairs(self) -> tuple[Ints, Ints]:
        """Corners (c, d), each [k], whose edges to the following corner are one smooth edge seen from its two faces."""
        order = np.argsort(self.edge, kind="stable")
        first = np.cumsum(self.edge_faces) - self.edge_faces
        inner = first[(self.edge_faces == 2) & (self.sharpness <= 0.0)]
        return order[inner], order[inner + 1]

    def rules(self, edge_sharpness: Floats, point_sharpness: Floats) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return which `incident` edges are sharp, and which points are corners and on creases; others are smooth."""
        at, _, edge = self.incident
        sharp = edge_sharpness[edge] > 0.0
        count = np.bincount(at[sharp], minlength=self.points)
        corner = (count > 2) | (point_sharpness > 0.0)
        return sharp, corner, ~corner & (count == 2)

    def level_weights(self) -> Floats | None:
        """Return the weight [points] of this level's rules for the old points; the rest is that of the next level's.

        It is below 1 where the sharpness of a point or of its edges runs out within this level. None: 1 everywhere.
        """
        at, _, edge = self.incident
        edge_ends = ((self.sharpness > 0.0) & (self.sharpness <= 1.0))[edge]
        point_ends = (self.point_sharpness > 0.0) & (self.point_sharpness <= 1.0)
        count = np.bincount(at[edge_ends], minlength=self.points) + point_ends
        if not count.any():
            return None
        total = np.bincount(at[edge_ends], self.sharpness[edge[edge_ends]], minlength=self.points)
        total = total + np.where(point_ends, self.point_sharpness, 0.0)  # bincount of an empty array is of integers
        return np.where(count > 0, np.minimum(total / np.maximum(count, 1), 1.0), 1.0)

    def with_boundary_corners_sharp(self) -> Cage:
        """Return the cage with points of only one face made sharp: the "edgeAndCorner" boundary rule."""
        uses = np.bincount(self.indices, minlength=self.points)
        sharpness = np.where(uses == 1, np.inf, self.point_sharpness)
        return Cage(self.counts, self.indices, self.edge_sharpness, sharpness)


def refine(cage: Cage, values: Floats) -> tuple[Cage, Floats]:
    """Subdivide once: each corner of each face becomes a quadrilateral, in the order of the corners.

    Args:
        cage: the control mesh.
        values: float64 [points, c], positions or anything else that is interpolated like them.

    Returns:
        The refined cage and its values: those of the old points, then of the edges, then of the faces.
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
    """Return the old points' new values [points, c], interpolated between the rules of two levels (`level_weights`)."""
    at, other, edge = cage.incident
    valence = np.maximum(np.bincount(at, minlength=cage.points), 1)[:, None]
    uses = np.bincount(cage.indices, minlength=cage.points)[:, None]
    mean_face = sum_rows(cage.indices, face_point[cage.face], cage.points) / np.maximum(uses, 1)
    mean_edge = sum_rows(at, middle[edge], cage.points) / valence
    smooth = (mean_face + 2.0 * mean_edge + (valence - 3.0) * values) / valence
    smooth = np.where(uses == 0, values, smooth)

    def by_rule(edge_sharpness: Floats, point_sharpness: Floats) -> Floats:
        sharp, corner, on_crease = cage.rules(edge_sharpness, point_sharpness)
        crease = (6.0 * values + sum_rows(at[sharp], values[other[sharp]], cage.points)) / 8.0
        return np.where(corner[:, None], values, np.where(on_crease[:, None], crease, smooth))

    now = by_rule(cage.sharpness, cage.point_sharpness)
    weights = cage.level_weights()
    if weights is None:
        return now
    weight = weights[:, None]
    return np.asarray(weight * now + (1.0 - weight) * by_rule(child_edge, child_point))


def limit(cage: Cage, values: Floats) -> Floats:
    """Return the limit values [points, c] of a cage of quadrilaterals; its sharp edges count as infinitely sharp."""
    at, other, _ = cage.incident
    valence = np.bincount(at, minlength=cage.points)[:, None].astype(np.float64)
    neighbors = sum_rows(at, values[other], cage.points)
    opposite = cage.indices[cage.following[cage.following]]
    diagonals = sum_rows(cage.indices, values[opposite], cage.points)
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = (valence**2 * values + 4.0 * neighbors + diagonals) / (valence * (valence + 5.0))
    sharp, corner, on_crease = cage.rules(cage.sharpness, cage.point_sharpness)
    crease = (4.0 * values + sum_rows(at[sharp], values[other[sharp]], cage.points)) / 6.0
    return np.where(corner[:, None] | (valence == 0), values, np.where(on_crease[:, None], crease, smooth))


def distinct(keys: Ints) -> tuple[Ints, Ints]:
    """Return the distinct keys in order, and the number of each key [k] among them, as `np.unique` does.

    A stable sort uses the order that the keys of a mesh have already: it takes a quarter of the time.
    """
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    is_first = np.ones(len(keys), np.bool_)
    np.not_equal(ordered[1:], ordered[:-1], out=is_first[1:])
    place = np.empty(len(keys), np.int64)
    place[order] = np.cumsum(is_first) - 1
    return ordered[is_first], place
