# SPDX-License-Identifier: Apache-2.0
"""Animated lights: time samples of UsdLux to light motions of a scenario, and a stream's emission to time samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from tiscene.scene.camera import quaternion_from_matrix
from tiscene.scene.description import Color, Light
from tiscene.scene.lights.light_groups import emission_of
from tiscene.usd.core import schema
from tiscene.usd.core.keyframes import MAX_TIMES, changes_scale, sample_times
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.stage import reading_time
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.core.units import Units
from tiscene.usd.core.value_times import dense_times, value_times
from tiscene.usd.lights.light import LightReader
from tiscene.usd.materials.texture import TextureTable
from tiscene.usd.scenario.motion_schema import read_dynamic

_LINEAR = ("inputs:intensity", "inputs:color")
_NONLINEAR = (  # radiance is not proportional to these; sizes matter where it is normalized, angles always
    *("inputs:exposure", "inputs:colorTemperature"),
    *("inputs:radius", "inputs:width", "inputs:height", "inputs:length", "inputs:angle"),
)


def read_light_motion(prim: Usd.Prim, units: Units, report: StageReport) -> dict[str, Any] | None:
    """Return the animation of a light's pose and radiance as the JSON object of LightMotion; None if it has none.

    Time 0 is the start of the stage's range of time codes.

    Args:
        prim: the light.
        units: unit of length of its stage.
        report: receives problems of its motion.
    """
    stage, pose_times, emission_times = prim.GetStage(), sample_times(prim), _emission_times(prim)
    content: dict[str, Any] = {"light": str(prim.GetPath())}
    if schema.has(prim, schema.MOTION):
        content["dynamic"] = read_dynamic(prim, units, report)
    elif len(pose_times) > 1:
        lights = _lights(prim, pose_times)
        if len(lights) > 1:
            waypoints = [
                {
                    "position": light.world_from_light[:3, 3].tolist(),
                    "rotation": list(quaternion_from_matrix(light.world_from_light[:3, :3])),
                }
                for light in lights.values()
            ]
            seconds = in_seconds(stage, list(lights)).tolist()
            content["dynamic"] = {"type": "Keyframes", "times": seconds, "waypoints": waypoints, "repeat": False}
    if len(emission_times) > 1:
        lights = _lights(prim, emission_times)
        colors = [list(emission_of(light)) for light in lights.values()]
        if any(color != colors[0] for color in colors):
            content |= {"times": in_seconds(stage, list(lights)).tolist(), "radiance": colors}
    if len(content) == 1 or _light(prim, reading_time(stage, None)) is None:  # no light of the stage
        return None
    return content


def _emission_times(prim: Usd.Prim) -> list[float]:
    """Return the time codes of a light's emission samples, and all steps between those of nonlinear inputs."""
    times, stage = set[float](), prim.GetStage()
    for name in (*_LINEAR, *_NONLINEAR):
        samples = value_times(prim.GetAttribute(name))
        times.update(dense_times(samples, stage, MAX_TIMES) if name in _NONLINEAR else samples)
    if changes_scale(prim, moved := sample_times(prim)):  # as other sizes
        times.update(dense_times(moved, stage, MAX_TIMES))
    return sorted(times)


def _lights(prim: Usd.Prim, times: list[float]) -> dict[float, Light]:
    """Return the light at time codes; those before the stage's range are clamped to its start."""
    start = prim.GetStage().GetStartTimeCode()
    result = {}
    for time in sorted({max(time, start) for time in times}):
        light = _light(prim, Usd.TimeCode(time))
        if light is not None:
            result[time] = light
    return result


def _light(prim: Usd.Prim, time: Usd.TimeCode) -> Light | None:
    stage, ignored = prim.GetStage(), StageReport("")
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    reader = LightReader(TextureTable(ignored), time, ignored, meters, str(UsdGeom.GetStageUpAxis(stage)))
    reader.add(prim, reader.local_to_world(prim))
    return reader.lights[0] if reader.lights else None


def write_emission(prim: Usd.Prim, radiance: Mapping[int, Color]) -> None:
    """Author a light's emission as time samples of intensity and color, without exposure or color temperature.

    Args:
        prim: the light.
        radiance: `emission_of` the light by time code.
    """
    attributes = {}
    for name, kind, value in (
        ("intensity", Sdf.ValueTypeNames.Float, 1.0),
        ("exposure", Sdf.ValueTypeNames.Float, 0.0),
        ("color", Sdf.ValueTypeNames.Color3f, Gf.Vec3f(1.0)),
        ("enableColorTemperature", Sdf.ValueTypeNames.Bool, False),
    ):
        attributes[name] = prim.CreateAttribute(f"inputs:{name}", kind, False)
        attributes[name].Clear()
        attributes[name].Set(value)
    one = _light(prim, Usd.TimeCode.Default())
    per_intensity = max(emission_of(one)) if one is not None else 1.0
    for time, color in radiance.items():
        emission = np.array(color) / per_intensity
        intensity = float(emission.max())
        tint = emission / intensity if intensity > 0.0 else np.ones(3)
        attributes["intensity"].Set(intensity, Usd.TimeCode(time))
        attributes["color"].Set(Gf.Vec3f(*tint.tolist()), Usd.TimeCode(time))
