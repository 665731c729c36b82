# SPDX-License-Identifier: Apache-2.0
"""WorldParts: what a world makes of a scenario with its edits."""

from __future__ import annotations

from dataclasses import dataclass

from tiscene.scenario.edits import EditLog
from tiscene.world.frame_evaluator import FrameEvaluator
from tiscene.world.lights import WorldLights
from tiscene.world.object_registry import ObjectRegistry
from tiscene.world.physics_trajectories import PhysicsTrajectories
from tiscene.world.place_finder import PlaceFinder
from tiscene.world.stage_objects import StageObjects
from tiscene.world.view_history import ViewHistory
from tiscene.world.world_cameras import WorldCameras


@dataclass(frozen=True, eq=False)
class WorldParts:
    """The parts of a world that an edit changes one after another; one that an exception ends spoils them together.

    Attributes:
        log: the edits.
        registry: the objects, as far as no frame changes them.
        stage_objects: the objects of the stage with their edits.
        lights: the lights.
        trajectories: poses of objects, cameras and lights.
        cameras: the cameras.
        view_history: from where objects were seen before.
        evaluator: evaluates frames.
        place_finder: finds free places.
    """

    log: EditLog
    registry: ObjectRegistry
    stage_objects: StageObjects
    lights: WorldLights
    trajectories: PhysicsTrajectories
    cameras: WorldCameras
    view_history: ViewHistory
    evaluator: FrameEvaluator
    place_finder: PlaceFinder
