# SPDX-License-Identifier: Apache-2.0
"""Shutter samples: times while the shutter is open, for motion blur.

The open interval is divided into equal parts with one jittered time each (stratified sampling of time, as in
*Physically Based Rendering*). A time is a fraction of a frame in whole ticks, so that poses are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from tiscene.errors import ArgumentError
from tiscene.render.renderer import ShutterSample
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.world.world import World
from tiscene.world.world_state import WorldState

# Placing all instances costs as much as some samples per pixel; more times than these are not distinguished.
MAX_TIMES = 64
TICKS = 4096  # per frame
_KEY = 0x5B07


def shutter_times(value: Any) -> tuple[float, float]:
    """Return the times at which a shutter opens and closes, in frames."""
    try:
        opens, closes = map(float, value)
    except (TypeError, ValueError):
        raise ArgumentError(f"shutter={value!r}: must be two numbers of frames, such as (0, 0.5)") from None
    if not -1.0 <= opens <= closes <= 1.0:
        raise ArgumentError(f"shutter={value!r}: must be -1 <= open <= close <= 1 frames")
    return opens, closes


def shutter_samples(
    world: World,
    state: WorldState,
    view: View,
    shutter: tuple[float, float] | None,
    *,
    spp: int,
    seed: int,
    camera_row: int | None = None,
) -> Iterator[ShutterSample] | None:
    """Return the times at which a frame is sampled while the shutter is open, with the scene at each.

    Args:
        world: the world.
        state: its state at the frame.
        view: the camera at frames k - 1, k and k + 1.
        shutter: opening and closing time, frames relative to the frame; None: as the camera says.
        spp: samples per pixel, distributed over the times.
        seed: of the jitter.
        camera_row: the world's camera whose path the view follows; None: the view's cameras are interpolated.

    Returns:
        The samples, a pure function of the arguments; None if the shutter does not open, or if neither the camera nor
        an object nor a light changes.
    """
    opens, closes = shutter or (view.current.shutter_open, view.current.shutter_close)
    if opens == closes or (view.is_still and not state.has_dynamic_lights and not state.movers.any()):
        return None
    return _samples(world, state.frame, view, opens, closes, spp, seed, camera_row)


def _samples(
    world: World, frame: int, view: View, opens: float, closes: float, spp: int, seed: int, camera_row: int | None
) -> Iterator[ShutterSample]:
    count = min(spp, MAX_TIMES)
    jitter = np.random.default_rng((_KEY, seed, frame)).random(count)
    for number, offset in enumerate(jitter.tolist()):
        shift = Fraction(round(TICKS * (opens + (closes - opens) * (number + offset) / count)), TICKS)
        placement, cameras = world.between(frame, shift)
        camera = _interpolated(view, float(shift)) if camera_row is None else cameras[camera_row]
        samples = spp * (number + 1) // count - spp * number // count
        yield ShutterSample(replace(view, previous=camera, current=camera, next=camera), placement, samples)


def _interpolated(view: View, shift: float) -> Camera:
    """Interpolate a view's camera at a shift of -1..1 frames: position linearly, rotation by normalized lerp."""
    start, end = view.current, view.next if shift > 0.0 else view.previous
    if start == end or not shift:
        return start
    part = abs(shift)
    x, y, z = ((1.0 - part) * np.array(start.position) + part * np.array(end.position)).tolist()
    a, b = np.array(start.rotation), np.array(end.rotation)
    rotation = (1.0 - part) * a + (part if a @ b >= 0.0 else -part) * b
    return start.with_pose((x, y, z), tuple((rotation / np.linalg.norm(rotation)).tolist()))
