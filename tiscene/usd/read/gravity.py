# SPDX-License-Identifier: Apache-2.0
"""Gravity of a stage, by its PhysicsScene."""

from __future__ import annotations

import math

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from tiscene.scene.camera import Vector3
from tiscene.scene.description import EARTH
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.units import Units


def read_gravity(stage: Usd.Stage, report: StageReport) -> Vector3 | None:
    """Return the gravity of a stage's first PhysicsScene, m/s2; None: it has none, or that of the earth by default."""
    scene = next((UsdPhysics.Scene(prim) for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)), None)
    return None if scene is None else gravity_of(scene, report)


def gravity_of(scene: UsdPhysics.Scene, report: StageReport) -> Vector3 | None:
    """Return the gravity of a PhysicsScene, m/s2; None: that of the earth by default.

    A negative magnitude is that of the earth, and a direction of zeros is down. So are values that are not finite.

    Args:
        scene: the PhysicsScene.
        report: receives values that are not finite.
    """
    stage = scene.GetPrim().GetStage()
    strength = float(str(np.float32(scene.GetGravityMagnitudeAttr().Get())))  # 9.81 in single precision is 9.81
    if strength == math.inf or math.isnan(strength):
        text = f"gravityMagnitude is {strength:g}, which is not finite: that of the earth, {EARTH} m/s2, is used"
        report.omission(scene.GetPath(), text)
        strength = -1.0
    direction = np.array(scene.GetGravityDirectionAttr().Get(), np.float64)
    if not np.isfinite(direction).all():
        text = f"gravityDirection is {tuple(direction.tolist())}, which is not finite: down is used"
        report.omission(scene.GetPath(), text)
        direction = np.zeros(3)
    length = float(np.linalg.norm(direction))
    if strength < 0.0 and length == 0.0:
        return None
    strength = EARTH if strength < 0.0 else Units.of(stage).to_json(strength)
    down = [0.0, -1.0, 0.0] if UsdGeom.GetStageUpAxis(stage) == "Y" else [0.0, 0.0, -1.0]
    x, y, z = (strength * (direction / length if length > 0.0 else np.array(down))).tolist()
    return x, y, z
