# SPDX-License-Identifier: Apache-2.0
"""UsdGeomPointInstancer: transforms, prototypes and ids of its points, at one time code and over time.

Each point becomes an object of the scene. It is identified by its id, whatever its position in the arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from tiscene.errors import counted
from tiscene.scene.description import Matrix
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import NOT_ANIMATED, AnimatedAncestors
from tiscene.usd.core.transform import point_matrices, to_matrix
from tiscene.usd.core.value_times import JUMP, dense_times, value_times
from tiscene.usd.geometry.primvar import array_of, outside
from tiscene.usd.geometry.vertex_weld import unique_rows

_VELOCITIES = ("velocities", "accelerations", "angularVelocities")
_ARRAYS = (
    *("protoIndices", "positions", "orientations", "orientationsf", "scales", "ids", "invisibleIds"),
    *_VELOCITIES,
)


@dataclass(frozen=True, eq=False)
class NestedPoint:
    """A point of an instancer within a prototype.

    Attributes:
        world: float64 4x4 from the point to the space of the outer prototype's parent at the time read, m.
        matrix: float64 4x4 from the point to the instancer's space, m.
        ancestors: animated prims that move or hide the instancer within the outer prototype.
    """

    world: Matrix
    matrix: Matrix
    ancestors: AnimatedAncestors

    def world_at(self, time: Usd.TimeCode, meters: float) -> Matrix:
        """Return `world` at another time code."""
        if not self.ancestors.movers:
            return self.world
        return to_matrix(self.ancestors.world(time, Gf.Matrix4d(1.0)), meters) @ self.matrix


@dataclass(frozen=True, eq=False)
class PrototypePart:
    """A mesh of a prototype.

    Attributes:
        mesh: row of the mesh.
        matrix: float64 4x4 from the prim to the space of the parent of the innermost prototype at the time read, m.
        label: its semantic label, "" for none.
        names: names of its parts.
        collides: whether it is a collider; None: no physics is authored on it.
        is_drawn: False for a collider that is not drawn.
        ancestors: animated prims that move or hide it within the innermost prototype.
        continues: whether it is the shape that the part before has at other times.
        points: the points of instancers within the prototype that it is at, the outermost first; (): not nested.
        of_points: the primvars of color and opacity that points of an instancer farther outside give it; "" for none.
        color: float32 [4], RGB and opacity that a point has given it; NaN for none.
    """

    mesh: int
    matrix: Matrix
    label: str
    names: tuple[str, ...]
    collides: bool | None
    is_drawn: bool = True
    ancestors: AnimatedAncestors = NOT_ANIMATED
    continues: bool = False
    points: tuple[NestedPoint, ...] = ()
    of_points: tuple[str, str] = ("", "")
    color: NDArray[np.float32] = field(default_factory=lambda: np.full(4, np.nan, np.float32))

    def matrix_at(self, time: Usd.TimeCode, meters: float) -> Matrix:
        """Return its float64 4x4 matrix to the space of the outermost prototype's parent at a time code, m."""
        matrix = self.matrix
        if self.ancestors.movers:
            matrix = to_matrix(self.ancestors.world(time, Gf.Matrix4d(1.0)), meters)
        for point in reversed(self.points):
            matrix = point.world_at(time, meters) @ matrix
        return matrix

    def times(self) -> set[float]:
        """Return the time codes at which it moves, appears or vanishes; empty if it never does."""
        return {time for each in self._all_ancestors() for time in each.times()}

    def is_visible(self, time: Usd.TimeCode) -> bool:
        """Return whether it is shown at a time code."""
        return all(each.is_visible(time) for each in self._all_ancestors())

    def _all_ancestors(self) -> tuple[AnimatedAncestors, ...]:
        return (self.ancestors, *(point.ancestors for point in self.points))

    def nested(self, point: NestedPoint, color: NDArray[np.float32], of_points: tuple[str, str]) -> PrototypePart:
        """Return this part as a part of an outer prototype.

        Args:
            point: the inner instancer's point.
            color: of the part, as that point gives it.
            of_points: what is left to points of the outer instancer.
        """
        return replace(self, points=(point, *self.points), color=color, of_points=of_points)


@dataclass(frozen=True, eq=False)
class PointInstances:
    """The visible points of an instancer at one time code.

    Attributes:
        prototypes: its prototypes.
        prototype_of_point: int64 [n], index into `prototypes`.
        matrices: float64 [n, 4, 4], from a point to the instancer's space, m.
        ids: int64 [n], authored ids, else indices into the arrays.
        rows: int64 [n], indices into the arrays.
    """

    prototypes: Sequence[Usd.Prim]
    prototype_of_point: NDArray[np.int64]
    matrices: NDArray[np.float64]
    ids: NDArray[np.int64]
    rows: NDArray[np.int64]


def point_instances(
    prim: Usd.Prim, time: Usd.TimeCode, meters_per_unit: float, report: StageReport
) -> PointInstances | None:
    """Read an instancer at a time code; None, with a problem reported, if its arrays do not fit each other."""
    instancer = UsdGeom.PointInstancer(prim)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    prototypes = [prim.GetStage().GetPrimAtPath(target) for target in targets]
    chosen = array_of(instancer.GetProtoIndicesAttr(), time, np.int64)
    ids = array_of(instancer.GetIdsAttr(), time, np.int64)
    fault = _array_fault(instancer, prototypes, targets, chosen, ids, time)
    if fault:
        report.problem(prim.GetPath(), "instancer", fault)
        return None
    matrices = point_matrices(instancer, time).copy()
    if len(matrices) != len(chosen):
        report.problem(prim.GetPath(), "instancer", "USD cannot compute the transforms of its points")
        return None
    matrices[:, :3, 3] *= meters_per_unit
    kept = np.ones(len(chosen), dtype=bool)
    mask = instancer.ComputeMaskAtTime(time)
    if len(mask) == len(chosen):
        kept = np.asarray(mask, dtype=bool)
    invalid = kept & ~np.isfinite(matrices).all(axis=(1, 2))
    if invalid.any():
        first = int(np.flatnonzero(invalid)[0])
        text = f"{counted(int(invalid.sum()), 'point')}, the first at {first}, with a transform that is not finite"
        report.problem(prim.GetPath(), "instancer", text)
        return None
    with np.errstate(invalid="ignore"):  # NaN of masked points
        singular = kept & (np.abs(np.linalg.det(matrices[:, :3, :3])) <= 0.0)
    if singular.any():
        report.omission(prim.GetPath(), "points of a point instancer whose transform is singular are not drawn")
        kept &= ~singular
    if len(np.unique(ids)) < len(ids):
        report.omission(prim.GetPath(), "ids of a point instancer that are not unique are not used")
        ids = ids[:0]
    ids = ids if len(ids) else np.arange(len(chosen))
    return PointInstances(prototypes, chosen[kept], matrices[kept], ids[kept], np.flatnonzero(kept))


def instancer_times(prim: Usd.Prim) -> list[float]:
    """Return the time codes of an instancer's samples and the whole ones between them; empty if it never changes.

    Where points have velocities, these are those of the stage's range as well: they carry points beyond the samples.
    Before a sample that they do not lead to, there is a time for where they have led.
    """
    times = {time for name in _ARRAYS for time in value_times(prim.GetAttribute(name))}
    if not any(prim.GetAttribute(name).GetNumTimeSamples() for name in _VELOCITIES):
        return dense_times(times, prim.GetStage()) if len(times) > 1 else []
    stage, jumps = prim.GetStage(), [time - JUMP for time in sorted(times)[1:] if _jumps(prim, time)]
    if stage.HasAuthoredTimeCodeRange():
        times |= {stage.GetStartTimeCode(), stage.GetEndTimeCode()}
    return sorted({*dense_times(times, stage), *jumps}) if len(times) > 1 else []


def _jumps(prim: Usd.Prim, sample: float) -> bool:
    """Return whether points are elsewhere at a sample, at a time code, than velocities have led them, or others."""
    instancer = UsdGeom.PointInstancer(prim)
    before, after = (point_matrices(instancer, Usd.TimeCode(time)) for time in (sample - JUMP, sample))
    close = 1e-5 * np.abs(after).max(initial=0.0)
    return before.shape != after.shape or not np.allclose(before, after, rtol=0.0, atol=close)


@dataclass(frozen=True, eq=False)
class PointSamples:
    """All points that an instancer ever has, at some time codes.

    Attributes:
        ids: int64 [n].
        prototype: int64 [s, n], index of the prototype, -1 where a point does not exist.
        matrices: float64 [s, n, 4, 4], from a point to the instancer's space, m. Where a point does not exist, its
            last transform before, else its first one after.
        rows: int64 [s, n], its index into the instancer's arrays, -1 where a point does not exist.
    """

    ids: NDArray[np.int64]
    prototype: NDArray[np.int64]
    matrices: NDArray[np.float64]
    rows: NDArray[np.int64]

    @classmethod
    def of(cls, instances: Sequence[PointInstances]) -> PointSamples:
        """Return the samples from the visible points at each time code; points are in the order of their appearance."""
        all_ids = np.concatenate([each.ids for each in instances])
        first, column_of_id = unique_rows([all_ids])
        prototype, rows, places = np.full((3, len(instances), len(first)), -1, np.int64)
        ends = np.cumsum([len(each.ids) for each in instances])
        for row, (visible, columns) in enumerate(zip(instances, np.split(column_of_id, ends[:-1]), strict=True)):
            prototype[row, columns], rows[row, columns] = visible.prototype_of_point, visible.rows
            places[row, columns] = np.arange(len(columns))
        return cls(all_ids[first], prototype, _filled(places, [each.matrices for each in instances]), rows)

    def spread(self, values: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
        """Return values of all points at some times, from those of the arrays at each time.

        Args:
            values: float32 [arrays' length, k] at each time code, or at others if the points never change.

        Returns:
            float32 [times, n, k]; where a point does not exist, its last value before, else its first one after.
        """
        return _filled(np.broadcast_to(self.rows, (len(values), len(self.ids))), values)


def _filled(places: NDArray[np.int64], values: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return the values [times, n, ...] of points by their places [times, n] in those of each time.

    Where a point does not exist (-1), it has its last value before, else its first one after.
    """
    result = np.full((*places.shape, *values[0].shape[1:]), np.nan, values[0].dtype)
    known = np.zeros(places.shape[1], bool)
    for time, each in enumerate(values):
        if time:
            result[time] = result[time - 1]
        there = np.flatnonzero(places[time] >= 0)
        result[time, there] = each[places[time, there]]
        new = there[~known[there]]
        result[:time, new] = result[time, new]
        known[there] = True
    return result


def _array_fault(
    instancer: UsdGeom.PointInstancer,
    prototypes: Sequence[Usd.Prim],
    targets: Sequence[Any],
    chosen: NDArray[np.int64],
    ids: NDArray[np.int64],
    time: Usd.TimeCode,
) -> str:
    """Return which arrays of an instancer do not fit each other, "" if all do."""
    missing = [str(target) for target, prim in zip(targets, prototypes, strict=True) if not prim]
    if missing:
        return f"its prototype <{missing[0]}> does not exist"
    if len(chosen) and not prototypes:
        return "it has no prototypes"
    if (worst := outside(chosen, len(prototypes))) is not None:
        return f"protoIndices refer to prototype {worst}, but there are {len(prototypes)} (0-{len(prototypes) - 1})"
    lengths = {
        "positions": len(array_of(instancer.GetPositionsAttr(), time, None, width=3)),
        "orientations": len(array_of(instancer.GetOrientationsAttr(), time, None, width=4)),
        "orientationsf": len(array_of(instancer.GetOrientationsfAttr(), time, None, width=4)),
        "scales": len(array_of(instancer.GetScalesAttr(), time, None, width=3)),
        "ids": len(ids),
    }
    for name, length in lengths.items():
        if length != len(chosen) and (length or name == "positions"):
            return f"{length} {name}, but {len(chosen)} protoIndices"
    return ""
