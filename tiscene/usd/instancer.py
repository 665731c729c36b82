"""UsdGeomPointInstancer: where its points are, and which prototype each one shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.scene.description import Matrix
from tiscene.usd.primvar import array_of
from tiscene.usd.problems import Report

_ARRAYS = ("protoIndices", "positions", "orientations", "orientationsf", "scales", "ids", "invisibleIds")


@dataclass(frozen=True, eq=False)
class Placed:
    """A mesh of a prototype. matrix: from the mesh to the prototype's parent, metres. label: what is said of it.

    names: of its parts. collides: whether it is a collider, None if nothing is said. drawn: False for a collider alone.
    """

    mesh: int
    matrix: Matrix
    label: str
    names: tuple[str, ...]
    collides: bool | None
    drawn: bool = True


@dataclass(frozen=True, eq=False)
class PointInstances:
    """The visible points of an instancer.

    prototypes: prims. prototype_of_point: int [n]. matrices: float64 [n, 4, 4] to the instancer's space, metres.
    ids: int64 [n], the authored ids, else the points' positions in the arrays.
    """

    prototypes: Sequence[Usd.Prim]
    prototype_of_point: NDArray[np.int64]
    matrices: NDArray[np.float64]
    ids: NDArray[np.int64]


def point_instances(
    prim: Usd.Prim, time: Usd.TimeCode, meters_per_unit: float, report: Report
) -> PointInstances | None:
    """Read an instancer; None, with a problem reported, if its arrays contradict each other."""
    instancer = UsdGeom.PointInstancer(prim)
    changing = [name for name in _ARRAYS if prim.GetAttribute(name).ValueMightBeTimeVarying()]
    if changing:
        report.frozen(prim.GetPath(), f"{', '.join(changing)} of a point instancer")
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    prototypes = [prim.GetStage().GetPrimAtPath(target) for target in targets]
    chosen = array_of(instancer.GetProtoIndicesAttr(), time, np.int64)
    ids = array_of(instancer.GetIdsAttr(), time, np.int64)
    fault = _fault(instancer, prototypes, targets, chosen, ids, time)
    if fault:
        report.problem(prim.GetPath(), "instancer", fault)
        return None
    if len(chosen) == 0:
        report.omission(prim.GetPath(), "a point instancer without points")
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
    wrong = ~np.isfinite(matrices).all(axis=(1, 2)) | (np.abs(np.linalg.det(matrices[:, :3, :3])) <= 0.0)
    if (wrong & kept).any():
        first = int(np.flatnonzero(wrong & kept)[0])
        text = (
            f"{int((wrong & kept).sum())} points, the first at {first}, have a transform that is singular or not finite"
        )
        report.problem(prim.GetPath(), "instancer", text)
        return None
    ids = ids if len(ids) else np.arange(len(chosen))
    return PointInstances(prototypes, chosen[kept], matrices[kept], ids[kept])


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
