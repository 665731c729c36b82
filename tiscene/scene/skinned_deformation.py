# SPDX-License-Identifier: Apache-2.0
"""Skinned meshes: rest shapes, joint influences and poses over time, from which vertices are computed on demand.

Linear blend skinning and blend shapes after UsdSkel's documentation. A mesh holds the small tables that a skeleton's
animation consists of, not its vertices at all samples, and meshes of one skeleton share its poses.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.affine_maps import corners_of
from tiscene.scene.animation import Deformation

Floats = NDArray[np.float64]
_FEW_POINTS = 1 << 18  # control points at all samples; they take about 0.1 s
_KEPT = 3  # shapes kept of each mesh: frames k - 1, k and k + 1 share samples


@dataclass(frozen=True, eq=False)
class SkeletonPoses:
    """Poses of a skeleton.

    Attributes:
        times: float64 [s], increasing, s.
        transforms: float64 [s, j, 3, 4], from the bind pose to the pose of each joint, in the skeleton's space, stage
            units. The last joint never moves.
    """

    times: Floats
    transforms: Floats


@dataclass(frozen=True, eq=False)
class BlendShapes:
    """Blend shapes of a mesh, with their inbetween shapes as shapes of their own.

    Attributes:
        shape: int32 [m], the shape that an offset belongs to.
        point: int32 [m], the point that it moves.
        offset: float32 [m, 3], in stage units.
        weights: float32 [s, shapes], at the samples of the poses.
        normal_offset: float32 [m, 3], what is added to the normals at the point. None: nothing.
    """

    shape: NDArray[np.int32]
    point: NDArray[np.int32]
    offset: NDArray[np.float32]
    weights: NDArray[np.float32]
    normal_offset: NDArray[np.float32] | None = None

    def applied(self, points: Floats, row: int) -> Floats:
        """Return points [n, 3] with the shapes of a sample added."""
        weights = self.weights[row][self.shape]
        used = np.flatnonzero(weights)
        if not len(used):
            return points
        moved = weights[used, None].astype(np.float64) * self.offset[used]
        at = self.point[used]
        return points + _sums(moved, at, len(points))


@dataclass(frozen=True, eq=False)
class Skin:
    """The control points of a mesh and what moves them.

    Attributes:
        poses: Of its skeleton.
        points: float64 [n, 3], at rest, in the mesh's space, stage units.
        normals: float64 [q, 3], authored normals at rest. None: none.
        normal_points: int32 [q], the point of each normal.
        joints: int32 [n, k], joints of `poses` that move each point. None: blend shapes alone move the mesh.
        weights: float64 [n, k].
        bind: float64 [3, 4], from the mesh's space to the skeleton's in the bind pose (geomBindTransform).
        mesh_from_skeleton: float64 [1 or s, 3, 4], from the skeleton's space to the mesh's.
        shapes: Blend shapes. None: none.
    """

    poses: SkeletonPoses
    points: Floats
    normals: Floats | None
    normal_points: NDArray[np.int32] | None
    joints: NDArray[np.int32] | None
    weights: Floats | None
    bind: Floats
    mesh_from_skeleton: Floats
    shapes: BlendShapes | None = None

    def at(self, row: int) -> tuple[Floats, Floats | None]:
        """Return the control points [n, 3] and the normals [q, 3] at a sample of the poses, both in the mesh's space.

        Normals are transformed by blended inverse transposes, as USD does, and are not unit.
        """
        points = self.points if self.shapes is None else self.shapes.applied(self.points, row)
        normals = self._shaped_normals(row)
        if self.joints is None or self.weights is None:
            return points, normals
        frame = self.mesh_from_skeleton[min(row, len(self.mesh_from_skeleton) - 1)]
        matrices = _joined(frame, _joined(self.poses.transforms[row], self.bind))
        blended = np.einsum("nk,nkij->nij", self.weights, matrices[self.joints])
        # Whatever the weights sum to, they scale the translation of the joints only.
        blended[:, :, 3] += (1.0 - self.weights.sum(axis=1))[:, None] * frame[:, 3]
        moved = np.einsum("nij,nj->ni", blended[:, :, :3], points) + blended[:, :, 3]
        if normals is None or self.normal_points is None:
            return moved, None
        of_joints = _normal_matrices(matrices[:, :, :3])
        rotations = np.einsum("nk,nkij->nij", self.weights, of_joints[self.joints])
        return moved, np.einsum("nij,nj->ni", rotations[self.normal_points], normals)

    def _shaped_normals(self, row: int) -> Floats | None:
        """Return the normals [q, 3] with the blend shapes of a sample added."""
        shapes = self.shapes
        if self.normals is None or self.normal_points is None or shapes is None or shapes.normal_offset is None:
            return self.normals
        moved = replace(shapes, offset=shapes.normal_offset).applied(np.zeros_like(self.points), row)
        return self.normals + moved[self.normal_points]

    @property
    def _is_small(self) -> bool:
        """Whether computing the points at all samples takes little time."""
        return len(self.points) * len(self.poses.times) <= _FEW_POINTS

    @property
    def _is_convex(self) -> bool:
        """Whether the weights of each point are positive and sum to 1."""
        if self.weights is None:
            return True
        return bool((self.weights >= 0.0).all() and (np.abs(self.weights.sum(axis=1) - 1.0) < 1e-5).all())

    def relative_to(self, center: Floats) -> Skin:
        """Return this skin in a space of the mesh whose origin is this point of the present one, in stage units."""
        bind, frame = self.bind.copy(), self.mesh_from_skeleton.copy()
        bind[:, 3] += bind[:, :3] @ center
        frame[:, :, 3] -= center
        return replace(self, points=self.points - center, bind=bind, mesh_from_skeleton=frame)

    def box(self) -> Floats:
        """Return a box [2, 3] that holds the control points at all samples, in the mesh's space, stage units.

        It is tight for meshes of few points and samples. A skinned point is a convex combination of the places to which
        its joints alone would move it, so that otherwise the box around the boxes that each joint moves holds it.
        """
        if self._is_small or not self._is_convex:
            bare = replace(self, normals=None)
            shapes = (bare.at(row)[0] for row in range(len(self.poses.times)))
            extremes = np.array([(each.min(axis=0), each.max(axis=0)) for each in shapes])
            return np.stack([extremes[:, 0].min(axis=0), extremes[:, 1].max(axis=0)])
        low, high = self.points.copy(), self.points.copy()
        if self.shapes is not None:
            for weights in (self.shapes.weights.min(axis=0), self.shapes.weights.max(axis=0)):
                reach = weights[self.shapes.shape, None].astype(np.float64) * self.shapes.offset
                for bound, part in ((low, np.minimum(reach, 0.0)), (high, np.maximum(reach, 0.0))):
                    np.add.at(bound, self.shapes.point, part)
        if self.joints is None or self.weights is None:
            return np.stack([low.min(axis=0), high.max(axis=0)])
        whole = np.stack([np.full(3, np.inf), np.full(3, -np.inf)])
        for joint in np.unique(self.joints[self.weights > 0.0]).tolist():
            own = ((self.joints == joint) & (self.weights > 0.0)).any(axis=1)
            corners = np.stack([low[own].min(axis=0), high[own].max(axis=0)])
            matrices = _joined(self.mesh_from_skeleton, _joined(self.poses.transforms[:, joint], self.bind))
            center = np.einsum("sij,j->si", matrices[..., :3], corners.mean(axis=0)) + matrices[..., 3]
            half = np.einsum("sij,j->si", np.abs(matrices[..., :3]), 0.5 * (corners[1] - corners[0]))
            whole[0] = np.minimum(whole[0], (center - half).min(axis=0))
            whole[1] = np.maximum(whole[1], (center + half).max(axis=0))
        return whole


@dataclass(frozen=True, eq=False)
class LinearMap:
    """A sparse matrix with a few numbers in each row: new points as weighted sums of old ones.

    Attributes:
        starts: int64 [rows], where each row begins; no row is empty.
        columns: int32 [k].
        weights: float64 [k].
    """

    starts: NDArray[np.int64]
    columns: NDArray[np.int32]
    weights: Floats

    def applied(self, points: Floats) -> Floats:
        """Return the sums [rows, c] of points [n, c]."""
        result: Floats = np.add.reduceat(self.weights[:, None] * points[self.columns], self.starts, axis=0)
        return result


@dataclass(frozen=True, eq=False)
class SmoothNormals:
    """Normals of vertices as sums of the area vectors of the faces around them.

    Attributes:
        faces: int32 [corners], the point of each corner, face after face.
        starts: int64 [f], first corner of each face.
        groups: int32 [corners], smoothing group of each corner.
        vertex_groups: int32 [n], smoothing group of each vertex.
        inwards: Whether the faces are clockwise seen from outside.
    """

    faces: NDArray[np.int32]
    starts: NDArray[np.int64]
    groups: NDArray[np.int32]
    vertex_groups: NDArray[np.int32]
    inwards: bool = False

    def at(self, points: Floats) -> Floats:
        """Return normals [n, 3], of any length."""
        counts = np.diff(self.starts, append=len(self.faces))
        corners: Floats = points[self.faces] - np.repeat(points[self.faces[self.starts]], counts, axis=0)
        following = np.arange(1, len(self.faces) + 1)
        following[self.starts + counts - 1] = self.starts
        facing = np.add.reduceat(np.cross(corners, corners[following]), self.starts, axis=0)
        every: Floats = np.repeat(-facing if self.inwards else facing, counts, axis=0)
        size = int(self.groups.max(initial=-1)) + 1
        result: Floats = _sums(every, self.groups, size)[self.vertex_groups]
        return result


@dataclass(frozen=True, eq=False)
class ControlledSurface:
    """The vertices of a triangle mesh as a function of its control points.

    Attributes:
        maps: Applied one after another to the control points: levels of subdivision, and the limit.
        points: int32 [n], the mapped point of each vertex.
        triangles: int32 [m, 3].
        normals: int32 [n], the authored normal of each vertex. None: none is authored.
        smooth: Normals of a subdivision surface, in place of authored ones.
    """

    maps: tuple[LinearMap, ...]
    points: NDArray[np.int32]
    triangles: NDArray[np.int32]
    normals: NDArray[np.int32] | None = None
    smooth: SmoothNormals | None = None

    def vertices(
        self, points: Floats, normals: Floats | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return positions [n, 3] and unit normals [n, 3] for control points and authored normals."""
        for each in self.maps:
            points = each.applied(points)
        positions = np.ascontiguousarray(points[self.points], np.float32)
        if self.smooth is not None:
            return positions, unit_vectors(self.smooth.at(points), positions, self.triangles)
        if normals is None or self.normals is None:
            return positions, None
        return positions, unit_vectors(normals[self.normals], positions, self.triangles)

    def with_reversed_winding(self, flip_normals: bool) -> ControlledSurface:
        """Return the surface with its triangles reversed, and if `flip_normals` is set its smooth normals too."""
        smooth = self.smooth
        if smooth is not None and flip_normals:
            smooth = replace(smooth, inwards=not smooth.inwards)
        return replace(self, triangles=np.ascontiguousarray(self.triangles[:, ::-1]), smooth=smooth)


@dataclass(frozen=True, eq=False)
class SkinnedDeformation(Deformation):
    """A skinned mesh over time: vertices are computed at samples when they are asked for, and linear in between.

    Attributes:
        skin: What moves the control points.
        surface: The vertices that they control.
        meters: Meters per stage unit.
    """

    positions: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0, 3), np.float32))
    normals: NDArray[np.float32] | None = None
    skin: Skin = field(kw_only=True)
    surface: ControlledSurface = field(kw_only=True)
    meters: float = field(kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_known", {})  # not fields: they are no part of the description
        object.__setattr__(self, "_corners", None)

    def sample(self, row: int) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return positions [n, 3], m, and unit normals [n, 3] at a sample."""
        shapes: dict[int, tuple[NDArray[np.float32], NDArray[np.float32] | None]] = vars(self)["_known"]
        found = shapes.pop(row, None)
        if found is None:
            positions, normals = self.surface.vertices(*self.skin.at(row))
            found = positions * np.float32(self.meters), normals
        shapes[row] = found
        while len(shapes) > _KEPT:
            del shapes[next(iter(shapes))]
        return found

    def corners(self) -> NDArray[np.float32]:
        """Return the corners [8, 3] of a box that holds the mesh at all times."""
        if vars(self)["_corners"] is None:
            corners = corners_of((self.skin.box() * self.meters)[None])[0]
            object.__setattr__(self, "_corners", corners.astype(np.float32))
        found: NDArray[np.float32] = vars(self)["_corners"]
        return found

    def __getstate__(self) -> dict[str, object]:
        return vars(self) | {"_known": {}}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)


def unit_vectors(
    vectors: Floats, positions: NDArray[np.floating], triangles: NDArray[np.integer]
) -> NDArray[np.float32]:
    """Return normals of unit length; those without a length become the mean normals of their triangles, else +z."""
    length = np.linalg.norm(vectors, axis=-1)
    bad = ~(length > 1e-12)
    result: Floats = np.divide(vectors, length[:, None], out=np.zeros(vectors.shape), where=~bad[:, None])
    if bad.any():
        a, b, c = (positions[triangles[:, corner]].astype(np.float64) for corner in range(3))
        facing = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        total = _sums(facing, triangles.reshape(-1), len(positions))[bad]
        size = np.linalg.norm(total, axis=-1)
        total[size <= 0.0], size[size <= 0.0] = (0.0, 0.0, 1.0), 1.0
        result[bad] = total / size[:, None]
    single: NDArray[np.float32] = result.astype(np.float32)
    return single


def _sums(vectors: Floats, at: NDArray[np.integer], count: int) -> Floats:
    """Return the sums [count, 3] of the vectors [n, 3] that belong to each of some places."""
    return np.stack([np.bincount(at, each, minlength=count) for each in vectors.T], axis=-1)


def _joined(a: Floats, b: Floats) -> Floats:
    """Return the products of affine maps [..., 3, 4]: first b, then a."""
    linear = np.einsum("...ij,...jk->...ik", a[..., :3], b[..., :3])
    offset = np.einsum("...ij,...j->...i", a[..., :3], b[..., 3]) + a[..., 3]
    return np.concatenate([linear, offset[..., None]], axis=-1)


def _normal_matrices(m: Floats) -> Floats:
    """Return the inverse transposes of matrices [n, 3, 3]; the cofactors of singular ones."""
    cofactors = np.stack([np.cross(m[:, 1], m[:, 2]), np.cross(m[:, 2], m[:, 0]), np.cross(m[:, 0], m[:, 1])], axis=1)
    determinant = np.einsum("nj,nj->n", m[:, 0], cofactors[:, 0])
    result: Floats = cofactors / np.where(determinant != 0.0, determinant, 1.0)[:, None, None]
    return result
