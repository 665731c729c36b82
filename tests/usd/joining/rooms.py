# SPDX-License-Identifier: Apache-2.0
"""Rooms that tests join."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Kind, Usd, UsdGeom, UsdLux, UsdSemantics, Vt

import tiscene as ts
from tiscene.usd import Opening, RoomPlacement

THICK = 0.2  # m, of each wall


def write_room(folder: Path, name: str, *, shape: str = "Mesh", scheme: str = "none", meters: float = 1.0) -> Path:
    """Write a room of 4 x 3 x 4 m about its origin, with a closed door's leaf on its +x wall, and two variants."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    root = UsdGeom.Xform.Define(stage, "/Room").GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
    stage.SetDefaultPrim(root)

    def box(path: str, label: str, low: tuple[float, ...], high: tuple[float, ...]) -> None:
        UsdGeom.Xform.Define(stage, path)
        prim = stage.GetPrimAtPath(path)
        Usd.ModelAPI(prim).SetKind(Kind.Tokens.component)
        UsdSemantics.LabelsAPI.Apply(prim, "class").CreateLabelsAttr([label])
        a, b = np.array(low) / meters, np.array(high) / meters
        if shape == "Cube":
            cube = UsdGeom.Cube.Define(stage, f"{path}/Shape")
            cube.CreateSizeAttr(1.0)
            cube.AddTranslateOp().Set(Gf.Vec3d(*((a + b) / 2.0).tolist()))
            cube.AddScaleOp().Set(Gf.Vec3f(*(b - a).tolist()))
            return
        corners = np.array([[(a, b)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
        faces = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]])
        mesh = UsdGeom.Mesh.Define(stage, f"{path}/Shape")
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(corners.astype(np.float32)))
        mesh.CreateFaceVertexCountsAttr([4] * 6)
        mesh.CreateFaceVertexIndicesAttr(faces.reshape(-1).tolist())
        mesh.CreateSubdivisionSchemeAttr(scheme)
        mesh.CreateExtentAttr([Gf.Vec3f(*a.tolist()), Gf.Vec3f(*b.tolist())])

    t = THICK
    box("/Room/Floor", "floor", (-2, -0.1, -2), (2, 0, 2))
    box("/Room/Ceiling", "ceiling", (-2 - t, 3, -2 - t), (2 + t, 3.1, 2 + t))
    box("/Room/WallRight", "wall", (2, 0, -2), (2 + t, 3, 2))
    box("/Room/WallLeft", "wall", (-2 - t, 0, -2), (-2, 3, 2))
    box("/Room/WallFar", "wall", (-2 - t, 0, -2 - t), (2 + t, 3, -2))
    box("/Room/WallNear", "wall", (-2 - t, 0, 2), (2 + t, 3, 2 + t))
    box("/Room/Door", "door", (1.97, 0.001, -0.445), (1.999, 2.0, 0.445))
    dome = UsdLux.DomeLight.Define(stage, "/Room/Sky")
    portal = UsdLux.PortalLight.Define(stage, "/Room/Portal")
    dome.CreatePortalsRel().AddTarget(portal.GetPath())
    camera = UsdGeom.Camera.Define(stage, "/Room/Main")
    camera.AddTranslateOp().Set(Gf.Vec3d(0.0, 1.2 / meters, 0.0))
    camera.AddRotateYOp().Set(-90.0)
    sets = root.GetVariantSets().AddVariantSet("lighting")
    for variant, intensity in (("day", 1.0), ("night", 0.1)):
        sets.AddVariant(variant)
        sets.SetVariantSelection(variant)
        with sets.GetVariantEditContext():
            dome.CreateIntensityAttr(intensity)
    sets.SetVariantSelection("day")
    path = folder / f"{name}.usda"
    stage.GetRootLayer().Export(str(path))
    return path


def edit(file: Path, change: Callable[[Usd.Stage], object]) -> None:
    """Change a stage and save it."""
    stage = Usd.Stage.Open(str(file))
    change(stage)
    stage.Save()


OPENING = Opening((2.2, 0.0, 0.0), depth=2 * THICK, yaw=90.0)


def two_rooms(folder: Path, **options: Any) -> list[RoomPlacement]:
    """Return a room and its mirror image, which share the wall at x = 2.2."""
    file = write_room(folder, "room", **options)
    return [RoomPlacement(file, name="west"), RoomPlacement(file, (4.4, 0.0, 0.0), 180.0, "east")]


def view(path: Path, **options: Any) -> ts.Frame:
    return ts.Stream(str(path), width=32, height=24, buffers=("instance", "semantic", "depth"), **options)[0]
