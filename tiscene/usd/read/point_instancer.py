# SPDX-License-Identifier: Apache-2.0
"""UsdGeomPointInstancer: where its points are, and which prototype each one shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from tiscene.scene.description import Matrix
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import NOT_ANIMATED, AnimatedAncestors, dense_times
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.geometry.primvar import array_of

_ARRAYS = (
    *("protoIndices", "positions", "orientations", "orientationsf", "scales", "ids", "invisibleIds"),
    *("velocities", "accelerations", "angularVelocities"),
)


@dataclass(frozen=True, eq=False)
class Placed:
    """A mesh of a prototype. matrix: from the mesh to the prototype's parent, meters. label: what is said of it.

    names: of its parts. collides: whether it is a collider, None if nothing is said. drawn: False for a collider alone.
    inherited: what of its place changes over time, before `placed` leads on to the prototype's parent.
    """

    mesh: int
    matrix: Matrix
    label: str
    names: tuple[str, ...]
    collides: bool | None
    drawn: bool = True
    inherited: AnimatedAncestors = NOT_ANIMATED
    placed: Matrix | None = None

    def at(self, time: Usd.TimeCode, meters: float) -> Matrix:
        """The matrix at a time."""
        if not self.inherited.movers:
            return self.matrix
        matrix = to_matrix(self.inherited.world(time, Gf.Matrix4d(1.0)), meters)
        return matrix if self.placed is None else self.placed @ matrix

    def within(self, matrix: Matrix) -> Placed:
        """The same in an instance of the prototype that is itself part of another."""
        placed = matrix if self.placed is None else matrix @ self.placed
        return replace(self, matrix=matrix @ self.matrix, placed=placed)


@dataclass(frozen=True, eq=False)
class PointInstances:
    """The visible points of an instancer.

    prototypes: prims. prototype_of_point: int [n]. matrices: float64 [n, 4, 4] to the instancer's space, meters.
    ids: int64 [n], the authored ids, else the points' positions in the arrays.
    """

    prototypes: Sequence[Usd.Prim]
    prototype_of_point: NDArray[np.int64]
    matrices: NDArray[np.float64]
    ids: NDArray[np.int64]


def point_instances(
    prim: Usd.Prim, time: Usd.TimeCode, meters_per_unit: float, report: StageReport
) -> PointInstances | None:
    """Read an instancer at a time; None, with a problem reported, if its arrays contradict each other."""
    instancer = UsdGeom.PointInstancer(prim)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    prototypes = [prim.GetStage().GetPrimAtPath(target) for target in targets]
    chosen = array_of(instancer.GetProtoIndicesAttr(), time, np.int64)
    ids = array_of(instancer.GetIdsAttr(), time, np.int64)
    fault = _fault(instancer, prototypes, targets, chosen, ids, time)
    if fault:
        report.problem(prim.GetPath(), "instancer", fault)
        return None
    transforms = instancer.ComputeInstanceTransformsAtTime(
        time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    matrices = np.asarray(transforms, dtype=np.float64).reshape(-1, 4, 4).transpose(0, 2, 1).copy()
    if len(matrices) != len(chosen):
        report.problem(prim.GetPath(), "instancer", "USD cannot compute the transforms of its points")
        return None
    matrices[:, :3, 3] *= meters_per_unit
    kept = np.ones(len(chosen), dtype=bool)
    mask = instancer.ComputeMaskAtTime(time)
    if len(mask) == len(chosen):
        kept = np.asarray(mask, dtype=bool)
    wrong = kept & ~np.isfinite(matrices).all(axis=(1, 2))
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        text = f"{int(wrong.sum())} points, the first at {first}, have a transform that is not finite"
        report.problem(prim.GetPath(), "instancer", text)
        return None
    with np.errstate(invalid="ignore"):  # of points that are masked
        flat = kept & (np.abs(np.linalg.det(matrices[:, :3, :3])) <= 0.0)
    if flat.any():
        report.omission(prim.GetPath(), "points of a point instancer that are squashed flat are not drawn")
        kept &= ~flat
    if len(np.unique(ids)) < len(ids):
        report.omission(prim.GetPath(), "ids of a point instancer that are not unique are not used")
        ids = ids[:0]
    ids = ids if len(ids) else np.arange(len(chosen))
    return PointInstances(prototypes, chosen[kept], matrices[kept], ids[kept])


def instancer_times(prim: Usd.Prim) -> list[float]:
    """The time codes at which an instancer's arrays are authored, and those between; none if it never changes."""
    times = {time for name in _ARRAYS for time in prim.GetAttribute(name).GetTimeSamples()}
    return dense_times(times) if len(times) > 1 else []


@dataclass(frozen=True, eq=False)
class PointSamples:
    """All the points that an instancer ever has, at some times.

    ids: int64 [n]. prototype: int64 [s, n], -1 where a point is not there. matrices: float64 [s, n, 4, 4] to the
    instancer's space, m; of a point that is not there, those that it had before, or will have first.
    """

    ids: NDArray[np.int64]
    prototype: NDArray[np.int64]
    matrices: NDArray[np.float64]

    @classmethod
    def of(cls, moments: Sequence[PointInstances]) -> PointSamples:
        """From what is there at each time; points in the order in which they appear."""
        every = np.concatenate([np.zeros(0, np.int64), *(moment.ids for moment in moments)])
        distinct, first = np.unique(every, return_index=True)
        order = np.argsort(first)
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        prototype = np.full((len(moments), len(order)), -1, np.int64)
        matrices = np.zeros((len(moments), len(order), 4, 4))
        known = np.zeros(len(order), bool)
        for row, moment in enumerate(moments):
            if row:
                matrices[row] = matrices[row - 1]
            columns = rank[np.searchsorted(distinct, moment.ids)]
            prototype[row, columns] = moment.prototype_of_point
            matrices[row, columns] = moment.matrices
            fresh = columns[~known[columns]]
            matrices[:row, fresh] = matrices[row, fresh]
            known[columns] = True
        return cls(distinct[order], prototype, matrices)


def _fault(
    instancer: UsdGeom.PointInstancer,
    prototypes: Sequence[Usd.Prim],
    targets: Sequence[Any],
    chosen: NDArray[np.int64],
    ids: NDArray[np.int64],
    time: Usd.TimeCode,
) -> str:
    """What contradicts what; "" for nothing."""
    missing = [str(target) for target, prim in zip(targets, prototypes, strict=True) if not prim]
    if missing:
        return f"its prototype <{missing[0]}> does not exist"
    if len(chosen) and not prototypes:
        return "it has no prototypes"
    if len(chosen) and (chosen.min() < 0 or chosen.max() >= len(prototypes)):
        worst = chosen.max() if chosen.max() >= len(prototypes) else chosen.min()
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
