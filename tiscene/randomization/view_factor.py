# SPDX-License-Identifier: Apache-2.0
"""The factor "views": pose and lens of the main camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import is_number
from dynamics.rotation import multiply
from tiscene.errors import ScenarioError
from tiscene.randomization.draws import Draws
from tiscene.randomization.factor_ranges import ViewRanges
from tiscene.randomization.scene_collisions import about
from tiscene.randomization.scene_files import free_space_of, stage_of
from tiscene.scenario.overrides import CameraOverride, Override
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera, quaternion_from_matrix

Array = NDArray[np.float64]
ATTEMPTS = 64
MARGIN = 0.12  # m of free space around a camera
DECIMALS = 6


def with_view(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario whose main camera stands elsewhere, looks elsewhere or has another lens.

    Its override is replaced.

    Args:
        scenario: the scenario.
        value: ranges; a Camera; the name of a camera on the stage; a number of degrees by which it is turned to the
            left or right; None: typical ranges.
        draws: returns the random numbers of the camera.

    Raises:
        CameraNotFound: the stage has no camera of that name.
        ScenarioError: the camera moves, or no place within the ranges is free.
    """
    first = scenario.cameras[0]
    if isinstance(value, Camera | str):
        if isinstance(value, str):
            stage_of(scenario).camera(value)
        return _watched(scenario, value)
    if is_number(value):
        value = {"yaw": value}
    ranges = ViewRanges.of(value, "views")
    authored = (first if isinstance(first, Camera) else stage_of(scenario).camera(first)).at(0.0)
    if authored.dynamic is not None:
        raise ScenarioError(f"views: the camera {authored.name!r} moves along a trajectory; give a Camera instead")
    own = draws("")
    position = _position(scenario, authored, ranges, own)
    up = np.asarray(stage_of(scenario).up)
    yaw = math.radians(own.either_side("yaw", ranges.yaw))
    pitch = math.radians(own.either_side("pitch", ranges.pitch))
    turn = about(np.zeros(3), up, yaw, np.zeros(3))[:3, :3]
    tilt = np.array([math.cos(0.5 * pitch), math.sin(0.5 * pitch), 0.0, 0.0])
    turned = multiply(multiply(quaternion_from_matrix(turn), authored.rotation), tilt)
    w, x, y, z = (round(each, DECIMALS) for each in turned.tolist())
    low, high = (math.log(each) for each in ranges.zoom)
    zoom = math.exp(own.between("zoom", 0, low, high))
    fov = 2.0 * math.atan(math.tan(0.5 * authored.vertical_fov) / zoom)
    lens: dict[str, Any] = {} if zoom == 1.0 else {"vertical_fov": round(fov, DECIMALS)}
    for name in ("lens_radius", "focus_distance"):
        if getattr(ranges, name) is not None:
            lens[name] = round(own.between(name, 0, *getattr(ranges, name)), DECIMALS)
    pose: dict[str, Any] = {"position": position, "rotation": (w, x, y, z)}
    if isinstance(first, Camera):
        return _watched(scenario, first.fixed(**pose, **lens))
    camera = stage_of(scenario).camera
    overrides: list[Override] = [
        each
        for each in scenario.overrides
        if not (isinstance(each, CameraOverride) and camera(each.prim or None).name == authored.name)
    ]
    return replace(scenario, overrides=[*overrides, CameraOverride(first or "", **pose, **lens)])


def _watched(scenario: Scenario, camera: Camera | str) -> Scenario:
    """Return a scenario with another main camera."""
    others = [each for each in scenario.cameras[1:] if each is not None]
    return replace(scenario, camera=(camera, *others) if others else camera)


def _position(scenario: Scenario, camera: Camera, ranges: ViewRanges, own: Draws) -> tuple[float, float, float]:
    """Return a position with free space around it, connected to the authored one.

    A camera within the scene's bounds stays within them, or within its view. One that looks at a scene from outside, or
    over a floor without walls, has all around it free that it sees.
    """
    x, y, z = camera.position
    if ranges.shift[1] == 0.0:
        return x, y, z
    space = free_space_of(scenario, camera)
    is_inside = space.is_within_bounds(np.array([camera.position]))[0]
    is_free = space.is_reachable if is_inside else space.sees
    offsets = MARGIN * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    for attempt in range(ATTEMPTS):
        by = own.between("shift", attempt, *ranges.shift) * np.asarray(own.direction("to", attempt))
        place = np.round(np.asarray(camera.position) + by, DECIMALS)
        if is_free(place + offsets).all():
            x, y, z = place.tolist()
            return x, y, z
    raise ScenarioError(
        f"views: none of {ATTEMPTS} places within shift={ranges.shift} m of the camera {camera.name!r} is free; "
        "lower shift"
    )
