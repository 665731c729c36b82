# SPDX-License-Identifier: Apache-2.0
"""record_motion: what a world shows at some frames, to be written as a USD layer."""

from __future__ import annotations

import itertools
import operator
from collections.abc import Iterable

import numpy as np

from tiscene.errors import ArgumentError
from tiscene.frame.object_table import ObjectState
from tiscene.scene.description import Matrix
from tiscene.usd.core.pose import pose_matrix
from tiscene.usd.scenario.bake import Poses, RecordedMotion, RecordedObject, offset
from tiscene.world.world import World


def record_motion(world: World, frames: int | Iterable[int]) -> RecordedMotion:
    """Record some frames of a world. Each frame's state is computed once and not kept.

    Args:
        world: the world.
        frames: number of frames from 0 on, or their increasing indices.

    Raises:
        ArgumentError: invalid frames.
    """
    numbers = _frame_numbers(frames)
    scenario, log = world.scenario, world.scenario.log()
    initial = {each.prim_path: each for each in world.initial_objects}
    animated = {motion.light for motion in scenario.lights}
    paths = [each.prim_path for each in world.stage.lights if animated & {each.prim_path, each.name}]
    varying = [row for row, camera in enumerate(world.cameras) if camera.lens is not None]
    motion = RecordedMotion(
        scene=scenario.scene,
        variants=scenario.variants,
        stage=world.stage,
        fps=world.fps,
        frames=numbers,
        objects={},
        stage_objects={path: {} for path in log.stage_histories},
        lights={path: {} for path in paths},
        cameras=world.cameras,
        camera_poses=[{} for _ in world.cameras],
        lenses={row: {} for row in varying},
    )
    poses: dict[str, Poses] = {}
    categories: dict[str, str] = {}
    stage_count = len(world.stage.objects)
    for frame in numbers:
        state = world.state(frame)
        for each in state.objects:
            if each.id > stage_count:
                poses.setdefault(each.name, {})[frame] = np.array([*each.position, *each.rotation])
                categories[each.name] = each.category
            elif each.prim_path in motion.stage_objects:
                motion.stage_objects[each.prim_path][frame] = offset(_matrix(initial[each.prim_path]), _matrix(each))
        for light in state.lights:
            if light.prim_path in motion.lights:
                motion.lights[light.prim_path][frame] = light
        for row, camera in enumerate(state.cameras):
            motion.camera_poses[row][frame] = np.array([*camera.current.position, *camera.current.rotation])
        for row, lens in motion.lenses.items():
            lens[frame] = state.cameras[row].current
    for row, history in enumerate(log.histories):
        spec = history.spec
        if spec.id in poses:
            own = poses[spec.id]
            found = motion.objects[spec.id] = RecordedObject(spec.template, spec.scale, categories[spec.id], own)
            for frame, following in itertools.pairwise(numbers):
                if frame in own and following not in own and history.alive(frame, as_of=frame):
                    (found.vanished[frame + 1],) = world.trajectories.arrivals(frame + 1, (row,))
    return motion


def _matrix(each: ObjectState) -> Matrix:
    return pose_matrix(each.position, each.rotation)


def _frame_numbers(frames: int | Iterable[int]) -> list[int]:
    """Return the indices of frames. Raises ArgumentError unless they are integers, 0 or more, increasing, not empty."""
    try:
        numbers = [operator.index(each) for each in frames] if isinstance(frames, Iterable) else list(range(frames))
    except TypeError:
        raise ArgumentError(f"frames={frames!r}: must be a number of frames, or the indices of frames") from None
    if not numbers or numbers[0] < 0 or any(b <= a for a, b in itertools.pairwise(numbers)):
        raise ArgumentError(f"frames={frames!r}: must be at least one frame, 0 or more, and increasing")
    return numbers
