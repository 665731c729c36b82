# SPDX-License-Identifier: Apache-2.0
"""FreePlaces: free places for objects that are spawned in a running stream, found as `Scenario.sample` finds them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tiscene.device import runtime
from tiscene.errors import ScenarioError
from tiscene.randomization.draws import Draws
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.object_placer import ATTEMPTS, ObjectPlacer, tally
from tiscene.randomization.point_pools import PointPools
from tiscene.randomization.ranges import ScenarioRanges
from tiscene.randomization.template_extent import enclosing_radius
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Instance, SceneDescription
from tiscene.world.place_finder import PlaceRequest

SPAWNED = 2**63  # added to the number of a spawned object's draws; those of `Scenario.sample` begin at 0


class FreePlaces:
    """Finds free places in a stage. The place depends on the seed and on the spawned object's number and frame.

    Args:
        stage: the stage.
        seed: of the random numbers.
    """

    def __init__(self, stage: SceneDescription, seed: int) -> None:
        self._stage = stage
        self._seed = seed
        # The latest one, the instances it was made of, and Taichi's session.
        self._space: tuple[FreeSpace, tuple[Instance, ...], object] | None = None

    @runtime.one_thread_at_a_time
    def find(self, request: PlaceRequest) -> Vector3:
        """Return a place where the ball around an object is free, visible from the camera and apart from other objects.

        Raises:
            ArgumentError: the region or the depth is not a range.
            ScenarioError: no place was found.
        """
        ranges = ScenarioRanges(
            dynamics=("still",), region=request.region, depth=request.depth, min_size=0.0,
            aspect=request.aspect,
        )  # fmt: skip
        spec, space = request.spec, self._free_space(request)
        draws = Draws(self._seed, SPAWNED + (spec.first_frame % 2**31 << 32) + request.row % 2**32)
        radius = enclosing_radius(request.description, spec.scale)
        occupied = [(np.array(center), size) for center, size in request.occupied]
        placer = ObjectPlacer(space, ranges, draws, PointPools(space, ranges, draws), radius, 2.0 * radius, occupied)
        found = placer.position()
        if found is None:
            raise ScenarioError(
                f"object {spec.id!r} (template {spec.template!r}, {radius:.2f} m about its origin) fits nowhere at "
                f"frame {spec.first_frame} in region={ranges.region}, depth={ranges.depth}, in {ATTEMPTS} draws: "
                f"{tally(placer.reasons)}. Widen region or depth, turn the camera, or spawn a smaller object"
            )
        x, y, z = found.tolist()
        return x, y, z

    def _free_space(self, request: PlaceRequest) -> FreeSpace:
        """Return the free space before the camera; the scene is kept while the stage's objects stay where they are."""
        session, instances = runtime.session(), (*request.instances, *request.colliders)
        kept = self._space
        if kept is None or kept[2] is not session or not _same(kept[1], instances):
            self._space = None  # frees its arrays first
            stage = replace(self._stage, instances=request.instances, colliders=request.colliders, tracks=(), lights=())
            kept = FreeSpace(stage, request.camera, request.aspect), instances, session
        self._space = kept[0].seen_by(request.camera, request.aspect), *kept[1:]
        return self._space[0]


def _same(a: tuple[Instance, ...], b: tuple[Instance, ...]) -> bool:
    return len(a) == len(b) and all(
        one is other or (one.mesh == other.mesh and np.array_equal(one.world_from_object, other.world_from_object))
        for one, other in zip(a, b, strict=True)
    )
