# SPDX-License-Identifier: Apache-2.0
"""What holds for a whole stage and rooms contradict each other in: gravity, which prims collide, the scenario."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdPhysics

from tiscene.errors import StageError, StageWarning
from tiscene.scene.description import EARTH
from tiscene.usd.core import schema
from tiscene.usd.core.report import StageReport, outer_level
from tiscene.usd.read.gravity import gravity_of
from tiscene.usd.read.object_builder import collides


def check_conflicts(rooms: Mapping[str, Usd.Prim], file: str) -> None:
    """Warn of rooms that fall or collide otherwise than alone; two scenarios are an error.

    Args:
        rooms: the rooms by name, in their order.
        file: name of the joined stage in messages.

    Raises:
        StageError: two rooms have a scenario, of which a stage plays one.
    """
    found = {name: list(Usd.PrimRange(room)) for name, room in rooms.items()}
    scenarios = [name for name, prims in found.items() if any(schema.has(each, schema.SCENARIO) for each in prims)]
    if len(scenarios) > 1:
        text = f"the rooms {', '.join(scenarios)} have a scenario each (TisceneScenarioAPI), and a stage has one"
        raise StageError(file, [f"{text}: remove it from the others"])
    scenes = {
        name: next((UsdPhysics.Scene(each) for each in prims if each.IsA(UsdPhysics.Scene)), None)
        for name, prims in found.items()
    }
    first = next((name for name, scene in scenes.items() if scene), None)
    if first is None:
        return
    gravity = _gravity(scenes[first])
    others = [name for name, scene in scenes.items() if scene and not np.allclose(_gravity(scene), gravity)]
    if others:
        _warn(file, f"the gravity of the room {first} counts, which is another one than in {', '.join(others)}")
    without = [name for name, scene in scenes.items() if not scene and any(map(_loses_collisions, found[name]))]
    if without:
        text = f"{', '.join(without)} has no PhysicsScene, unlike the room {first}, whose gravity counts"
        _warn(file, f"{text}: prims of it without PhysicsCollisionAPI collide with nothing")


def _gravity(scene: UsdPhysics.Scene) -> NDArray[np.float64]:
    up = 1 if UsdGeom.GetStageUpAxis(scene.GetPrim().GetStage()) == UsdGeom.Tokens.y else 2
    unused = StageReport("")  # reading the joined stage names values that are not finite
    return np.array(gravity_of(scene, unused) or -EARTH * np.eye(3)[up])


def _loses_collisions(prim: Usd.Prim) -> bool:
    """Return whether a prim collides only where a stage has no PhysicsScene."""
    return prim.IsA(UsdGeom.Gprim) and collides(prim) is None


def _warn(file: str, text: str) -> None:
    warnings.warn(StageWarning(f"{file}: {text}"), stacklevel=outer_level())
