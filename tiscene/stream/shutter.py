# SPDX-License-Identifier: Apache-2.0
"""The shutter: the moments at which a picture looks while it is open."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np

from tiscene.render.renderer import ShutterSample
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.world.world import World

# Placing everything takes as long as some paths; more moments than these are not told apart.
MOST_MOMENTS = 64
TICKS = 4096  # of a frame, in which moments are counted
_KEY = 0x5B07


def moments(
    world: World,
    index: int,
    view: View,
    shutter: tuple[float, float] | None = None,
    *,
    spp: int,
    seed: int,
    camera_at: Callable[[Fraction], Camera] | None = None,
) -> Iterator[ShutterSample] | None:
    """Moments at random, one in each of as many equal parts of the time that the shutter is open: `spp` paths in all.

    None if it does not open, or if nothing moves meanwhile: neither the camera, nor anything in the world, nor a light.
    shutter: when it opens and closes, frames from the frame; None: as the camera says. camera_at: the camera by so many
    frames from the frame; by default it goes straight from one camera of the view to the next.
    A pure function of the world and the numbers.
    """
    opens, closes = shutter or (view.current.shutter_open, view.current.shutter_close)
    still = view.previous == view.current == view.next and not world.has_dynamic_lights
    if opens == closes or (still and not world.moving(index).any()):
        return None
    return _moments(world, index, view, opens, closes, spp, seed, camera_at)


def _moments(
    world: World,
    index: int,
    view: View,
    opens: float,
    closes: float,
    spp: int,
    seed: int,
    camera_at: Callable[[Fraction], Camera] | None,
) -> Iterator[ShutterSample]:
    count = min(spp, MOST_MOMENTS)
    chances = np.random.default_rng((_KEY, seed, index)).random(count)
    for number, chance in enumerate(chances.tolist()):
        shift = Fraction(round(TICKS * (opens + (closes - opens) * (number + chance) / count)), TICKS)
        camera = camera_at(shift) if camera_at else _between(view, float(shift))
        samples = spp * (number + 1) // count - spp * number // count
        yield ShutterSample(
            replace(view, previous=camera, current=camera, next=camera), world.placement(index, shift), samples
        )


def _between(view: View, shift: float) -> Camera:
    """The camera of a view by so many frames from now, -1..1."""
    start, end = view.current, view.next if shift > 0.0 else view.previous
    if start == end or not shift:
        return start
    part = abs(shift)
    x, y, z = ((1.0 - part) * np.array(start.position) + part * np.array(end.position)).tolist()
    a, b = np.array(start.rotation), np.array(end.rotation)
    rotation = (1.0 - part) * a + (part if a @ b >= 0.0 else -part) * b
    return start.with_pose((x, y, z), tuple((rotation / np.linalg.norm(rotation)).tolist()))
