# SPDX-License-Identifier: Apache-2.0
"""Lights that move or change by time samples, and back: what a stream's lights do, as time samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from tiscene.scene.camera import quaternion_from_matrix
from tiscene.scene.description import Color, DistantLight, Light
from tiscene.usd.core import schema
from tiscene.usd.core.keyframes import MAX_TIMES, sample_times
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import dense_times
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.core.units import Units
from tiscene.usd.lights.light import LightReader
from tiscene.usd.materials.texture import TextureTable
from tiscene.usd.scenario.motion_schema import read_dynamic

_LINEAR = ("inputs:intensity", "inputs:color")
_CURVED = ("inputs:exposure", "inputs:colorTemperature")  # what the light is does not change in proportion to these


def read_light_motion(prim: Usd.Prim, units: Units, report: StageReport) -> dict[str, Any] | None:
    """How a light moves and shines as the JSON object of LightMotion; None if it does neither.

    Time 0 is the start of the stage's range of time codes.
    """
    moves = sample_times(prim)
    shines = _emission_times(prim)
    has_schema = schema.has(prim, schema.MOTION)
    content: dict[str, Any] = {"light": str(prim.GetPath())}
    if has_schema:
        content["dynamic"] = read_dynamic(prim, units, report)
    elif len(moves) > 1:
        lights = _lights(prim, moves)
        if len(lights) > 1:
            waypoints = [
                {
                    "position": light.world_from_light[:3, 3].tolist(),
                    "rotation": list(quaternion_from_matrix(light.world_from_light[:3, :3])),
                }
                for light in lights.values()
            ]
            seconds = _seconds(prim, lights)
            content["dynamic"] = {"type": "Keyframes", "times": seconds, "waypoints": waypoints, "repeat": False}
    if len(shines) > 1:
        lights = _lights(prim, shines)
        colors = [list(emitted(light)) for light in lights.values()]
        if any(color != colors[0] for color in colors):
            content |= {"times": _seconds(prim, lights), "radiance": colors}
    return content if len(content) > 1 else None


def emitted(light: Light) -> Color:
    """The radiance of a light, of a distant one its irradiance."""
    color: Color = light.irradiance if isinstance(light, DistantLight) else light.radiance  # type: ignore[attr-defined]
    return color


def _emission_times(prim: Usd.Prim) -> list[float]:
    """The time codes at which a light's emission is authored; of what changes it otherwise than in proportion, all."""
    times: set[float] = set()
    for name in (*_LINEAR, *_CURVED):
        samples = prim.GetAttribute(name).GetTimeSamples() if prim.HasAttribute(name) else []
        times.update(dense_times(samples, MAX_TIMES) if name in _CURVED else samples)
    return sorted(times)


def _lights(prim: Usd.Prim, times: list[float]) -> dict[float, Light]:
    """The light at time codes from the start of the stage's range on."""
    start = prim.GetStage().GetStartTimeCode()
    result = {}
    for time in sorted({max(time, start) for time in times}):
        light = _light(prim, Usd.TimeCode(time))
        if light is not None:
            result[time] = light
    return result


def _light(prim: Usd.Prim, time: Usd.TimeCode) -> Light | None:
    stage, unheard = prim.GetStage(), StageReport("")
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    reader = LightReader(TextureTable(unheard), time, unheard, meters, str(UsdGeom.GetStageUpAxis(stage)))
    reader.add(prim, to_matrix(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time), meters))
    return reader.lights[0] if reader.lights else None


def _seconds(prim: Usd.Prim, lights: Mapping[float, Light]) -> list[float]:
    stage = prim.GetStage()
    return [(time - stage.GetStartTimeCode()) / stage.GetTimeCodesPerSecond() for time in lights]


def write_emission(prim: Usd.Prim, radiance: Mapping[int, Color]) -> None:
    """Author what a light emits at some time codes: intensity and color, without exposure or temperature."""
    values: dict[str, Any] = {
        "intensity": 1.0,
        "exposure": 0.0,
        "color": Gf.Vec3f(1.0),
        "enableColorTemperature": False,
    }
    types = {"color": Sdf.ValueTypeNames.Color3f, "enableColorTemperature": Sdf.ValueTypeNames.Bool}
    made = {}
    for name, value in values.items():
        kind = types.get(name, Sdf.ValueTypeNames.Float)
        made[name] = prim.CreateAttribute(f"inputs:{name}", kind, False)
        made[name].Clear()
        made[name].Set(value)
    one = _light(prim, Usd.TimeCode.Default())
    per_intensity = max(emitted(one)) if one is not None else 1.0
    for time, color in radiance.items():
        emission = np.array(color) / per_intensity
        intensity = float(emission.max())
        tint = emission / intensity if intensity > 0.0 else np.ones(3)
        made["intensity"].Set(intensity, Usd.TimeCode(time))
        made["color"].Set(Gf.Vec3f(*tint.tolist()), Usd.TimeCode(time))
