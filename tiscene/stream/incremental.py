# SPDX-License-Identifier: Apache-2.0
"""When a stream's frames are differences to an image of what never moves, and what moves in them."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.incremental.base_image_cache import digest_of
from tiscene.scene.camera import Camera
from tiscene.scene.lights.light_groups import LightGroups
from tiscene.world.world import World

# An image of what never moves takes as long as some 20 frames.
WORTHWHILE_FRAMES = 50


def pays(frames: int | None) -> bool:
    """Whether so many frames (None: without end) are worth an image of what never moves."""
    return frames is None or frames >= WORTHWHILE_FRAMES


def is_fixed(world: World, camera: Camera) -> bool:
    """Whether that is one of the world's own cameras, and it never moves."""
    return any(each.dynamic is None and each == camera for each in world.cameras)


def moving(world: World, frame: int) -> NDArray[np.bool_] | None:
    """Which of the instances at a frame move; None if nothing changes, or if the lights are not those of frame 0 but
    for their brightness.

    One frame at which a lamp that moves stands as at the start counts for nothing: frame 1 must be like it too.
    """
    dimmed = False
    if world.has_dynamic_lights:
        lights = world.light_groups(frame)
        now, dimmed = _digest(lights), len(lights.factors) > 1
        if any(now != _digest(then) for then in world.initial_lights):
            return None
    instances = world.moving(frame)
    return instances if dimmed or instances.any() else None


@functools.lru_cache(maxsize=8)
def _digest(groups: LightGroups) -> bytes:
    """Of the lights but for how bright they are."""
    return digest_of([groups.lights, groups.group])
