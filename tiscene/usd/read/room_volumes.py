# SPDX-License-Identifier: Apache-2.0
"""Volumes of rooms on a stage: prims with a label of the taxonomy `room`, such as a Cube of purpose guide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSemantics

from tiscene.scene.room_volume import RoomVolume
from tiscene.usd.core.broken_prims import has_bounds
from tiscene.usd.core.prims import DRAWN_PURPOSES, with_ancestors
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import ROOM, direct_label
from tiscene.usd.core.stage import open_stage, quiet, readable
from tiscene.usd.core.transform import to_matrix

_FLOOR, _CEILING = "floor", "ceiling"


def read_room_volumes(stage: Usd.Stage, time: Usd.TimeCode, report: StageReport) -> tuple[RoomVolume, ...]:
    """Return the volumes of a stage: the bounding box of each labeled prim in its own axes.

    Args:
        stage: the stage.
        time: time code to read at.
        report: receives volumes that cannot be read as problems.
    """
    meters = float(UsdGeom.GetStageMetersPerUnit(stage))
    volumes = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        name = _room_of(prim, time)
        if not name or not prim.IsA(UsdGeom.Boundable):
            continue
        if not has_bounds(prim):
            report.problem(prim.GetPath(), "room volume", "a point instancer in it contains itself")
            continue
        with report.guard(prim):
            extent = UsdGeom.Boundable(prim).ComputeExtent(time)
            if extent:
                low, high = np.array(extent[0], float) * meters, np.array(extent[1], float) * meters
                world = to_matrix(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time), meters)
                half = np.diag([*(high - low) / 2.0, 1.0])
                half[:3, 3] = (low + high) / 2.0
                volumes.append(RoomVolume(name, world @ half))
    return tuple(volumes)


def read_room_files(path: str | Path) -> dict[str, frozenset[Path]]:
    """Return the files that each room of a stage is composed of, by its name: of its volume and of the prims above.

    A room that was placed on the stage by a reference has the file of its own scene among them.

    Raises:
        MissingFile, StageError: the stage cannot be opened.
    """
    found: dict[str, frozenset[Path]] = {}
    with quiet(), readable(path):
        stage = open_stage(path)
        for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
            name = _room_of(prim, Usd.TimeCode.EarliestTime())
            for each in with_ancestors(prim) if name else ():
                layers = [Path(spec.layer.realPath) for spec in each.GetPrimStack() if spec.layer.realPath]
                found[name] = found.get(name, frozenset()).union(layers)
    return found


def _room_of(prim: Usd.Prim, time: Usd.TimeCode) -> str:
    if not prim.HasAPI(UsdSemantics.LabelsAPI, ROOM):
        return ""
    labels = UsdSemantics.LabelsAPI(prim, ROOM).GetLabelsAttr().Get(time)
    return str(labels[0]) if labels else ""


def has_volume(root: Usd.Prim) -> bool:
    """Return whether a prim below `root` is the volume of a room."""
    return any(_room_of(prim, Usd.TimeCode.EarliestTime()) for prim in Usd.PrimRange(root))


def interior(room: Usd.Prim) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper corner of a room's interior, in the room's own axes and units.

    It is the box over all prims labeled "floor", up to the lowest prim labeled "ceiling"; without them, around
    everything.
    """
    cache = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), DRAWN_PURPOSES, useExtentsHint=False)
    inverse = UsdGeom.Xformable(room).GetLocalTransformation().GetInverse()
    boxes: dict[str, list[NDArray[np.float64]]] = {_FLOOR: [], _CEILING: []}
    for prim in Usd.PrimRange(room, Usd.TraverseInstanceProxies()):
        label = direct_label(prim, Usd.TimeCode.EarliestTime(), "class")
        if label in boxes:
            boxes[label].append(_box(cache.ComputeWorldBound(prim), inverse))
    low, high = _box(cache.ComputeWorldBound(room), inverse)
    if boxes[_FLOOR]:
        up = 1 if UsdGeom.GetStageUpAxis(room.GetStage()) == UsdGeom.Tokens.y else 2
        upward = np.array(inverse.TransformDir(Gf.Vec3d(0, 1, 0) if up == 1 else Gf.Vec3d(0, 0, 1)))
        up = int(np.abs(upward).argmax())  # the room may have been turned from another up axis
        mirror = np.where(np.arange(3) == up, np.sign(upward[up]), 1.0)
        floors, ceilings = (np.sort(np.array(boxes[label]) * mirror, axis=1) for label in (_FLOOR, _CEILING))
        whole = np.sort(np.array([low, high]) * mirror, axis=0)
        level = floors[:, 1, up].max()
        top = min((box[0, up] for box in ceilings if box[0, up] > level), default=whole[1, up])
        low, high = floors[:, 0].min(axis=0), floors[:, 1].max(axis=0)
        low[up], high[up] = level, top
        low, high = np.sort([low * mirror, high * mirror], axis=0)
    return low, high


def _box(bound: Gf.BBox3d, inverse: Gf.Matrix4d) -> NDArray[np.float64]:
    """Return the aligned box [2, 3] of a bound in the axes that `inverse` leads to."""
    moved = Gf.BBox3d(bound)
    moved.Transform(inverse)
    aligned = moved.ComputeAlignedRange()
    return np.array([aligned.GetMin(), aligned.GetMax()])


def define_volume(
    stage: Usd.Stage, path: Sdf.Path, low: NDArray[np.float64], high: NDArray[np.float64], name: str
) -> None:
    """Define the volume of a room: a Cube of purpose guide with its name as label."""
    cube = UsdGeom.Cube.Define(stage, path)
    cube.CreatePurposeAttr(UsdGeom.Tokens.guide)
    cube.CreateSizeAttr(1.0)
    cube.CreateExtentAttr([Gf.Vec3f(-0.5), Gf.Vec3f(0.5)])
    cube.AddTranslateOp().Set(Gf.Vec3d(*np.round((low + high) / 2.0, 6).tolist()))
    cube.AddScaleOp().Set(Gf.Vec3f(*np.round(high - low, 6).tolist()))
    UsdSemantics.LabelsAPI.Apply(cube.GetPrim(), ROOM).CreateLabelsAttr([name])
