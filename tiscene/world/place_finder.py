# SPDX-License-Identifier: Apache-2.0
"""PlaceFinder: puts objects that are spawned into free places. The search itself is `tiscene.randomization`'s."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dynamics import Body, Simulation
from dynamics.dynamic import ClosedForm
from tiscene.errors import ArgumentError
from tiscene.scenario.objects import Object
from tiscene.scenario.providers import provider
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.description import Collider, Instance, SceneDescription
from tiscene.world.frame_evaluator import FrameEvaluator
from tiscene.world.object_registry import ObjectRegistry
from tiscene.world.stage_objects import StageObjects


@dataclass(frozen=True, eq=False)
class PlaceRequest:
    """A search for a place where an object and its surroundings do not overlap.

    Attributes:
        spec: the object; its position does not count.
        row: its number among all objects of the scenario.
        description: of its template.
        region: part of the image that its origin must lie in: left, top, right, bottom, 0..1.
        depth: nearest and farthest depth of its origin, m.
        camera: the main camera at the object's first frame.
        aspect: width / height of its image.
        instances: the stage's instances at that frame.
        colliders: its invisible colliders.
        occupied: origin and radius, m, of the ball around each other object.
    """

    spec: Object
    row: int
    description: SceneDescription
    region: tuple[float, float, float, float]
    depth: tuple[float, float]
    camera: Camera
    aspect: float
    instances: tuple[Instance, ...]
    colliders: tuple[Collider, ...]
    occupied: tuple[tuple[Vector3, float], ...]


@dataclass(eq=False)
class PlaceFinder:
    """Puts spawned objects into free places of a world.

    Attributes:
        stage: the stage.
        registry: templates and ids of the objects.
        stage_objects: the stage's own objects.
        evaluator: the objects of the scenario at each frame.
        aspect: width / height of the main camera's image.
        seed: of the search.
    """

    stage: SceneDescription
    registry: ObjectRegistry
    stage_objects: StageObjects
    evaluator: FrameEvaluator
    aspect: float
    seed: int

    def placed(
        self, spec: Object, camera: Camera, region: tuple[float, float, float, float], depth: tuple[float, float]
    ) -> Object:
        """Return an object at a free place of its first frame.

        Args:
            spec: the object.
            camera: the main camera at that frame.
            region: as of PlaceRequest.
            depth: as of PlaceRequest.

        Raises:
            ArgumentError: the object's dynamic has its own places, or a range is invalid.
            ScenarioError: no place was found.
        """
        _check_starts_at_position(spec)
        frame = spec.first_frame
        instances, present = self.stage_objects.instances(frame)
        placed = list(itertools.compress(instances, present))
        others = [each for each in self.evaluator.objects(frame) if not each.prim_path]
        request = PlaceRequest(
            spec=spec,
            row=len(self.evaluator.log.histories),
            description=self.registry.template(spec).description,
            region=region,
            depth=depth,
            camera=camera,
            aspect=self.aspect,
            instances=tuple(each for each in placed if not isinstance(each, Collider)),
            colliders=tuple(each for each in placed if isinstance(each, Collider)),
            occupied=tuple((each.position, _ball_radius(each.box)) for each in others),
        )
        return replace(spec, position=self._places.find(request))

    @cached_property
    def _places(self) -> Any:
        return provider("free_places")(self.stage, self.seed)


def _check_starts_at_position(spec: Object) -> None:
    """Raise ArgumentError if an object's dynamic does not start where the object is placed."""
    dynamic = spec.dynamic
    if isinstance(dynamic, ClosedForm):
        places = ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
        starts = [Simulation([Body(dynamic, place)]).poses(0)[0, :3] for place in places]
        if not np.allclose(starts, places, atol=1e-6):
            raise ArgumentError(
                f"free=True, dynamic={type(dynamic).__name__}(...): this dynamic has its own start, wherever the "
                "object is placed; leave free out, or use a dynamic that starts at the object's position, such as "
                "Still, Orbit or UniformMovementRandomBounce"
            )


def _ball_radius(box: tuple[Vector3, Vector3]) -> float:
    """Return the radius of the ball about the origin that encloses a box, m."""
    return float(np.linalg.norm(np.abs(box).max(axis=0)))
