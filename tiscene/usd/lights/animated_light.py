# SPDX-License-Identifier: Apache-2.0
"""Lights whose inputs, scale or visibility have time samples, as `InputTrack`s.

The pose and the emission of a stage's own lights become a LightMotion of the scenario instead
(`scenario.light_time_samples`). The track of a light that moves within a template holds its poses.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from tiscene.scene.description import Color
from tiscene.scene.input_track import InputTrack
from tiscene.usd.core.keyframes import changes_scale, sample_times
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import AnimatedAncestors, in_seconds
from tiscene.usd.core.transform import is_singular
from tiscene.usd.core.value_times import dense_times, is_time_varying, value_times
from tiscene.usd.lights.light import LightReader
from tiscene.usd.lights.shaping import CAMERA_VISIBILITY

_EMISSION = ("radiance", "irradiance")
_CONSTANT = ("name", "prim_path", "portals")
_OTHERS = (*CAMERA_VISIBILITY, "treatAsPoint", "treatAsLine")


def light_track(
    reader: LightReader,
    row: int,
    prim: Usd.Prim,
    world_from_prim: NDArray[np.float64],
    ancestors: AnimatedAncestors,
    report: StageReport,
    *,
    emission: bool,
) -> InputTrack | None:
    """Return how the inputs, the scale and the visibility of a light vary over time; None if they do not.

    Args:
        reader: has read the light.
        row: row of the light in `reader.lights`.
        prim: the light.
        world_from_prim: its transform, as for `LightReader.add`.
        ancestors: ancestors with animated visibility, the light itself included; movers: those of a template.
        report: says whether the stage plays.
        emission: whether to include the emission: no scenario moves or dims the light.
    """
    if not report.reads_animation:
        return None
    varying = [
        each
        for each in prim.GetAuthoredAttributes()
        if (each.GetName().startswith("inputs:") or each.GetName() in _OTHERS) and is_time_varying(each)
    ]
    times = {time for each in varying for time in value_times(each)}
    moved, grows = sample_times(prim), False
    if ancestors.movers:
        times.update(ancestors.times())
    elif not emission:  # the scenario moves it
        grows = changes_scale(prim, moved) and not is_singular(reader.local_to_world(prim))
        times.update(moved if grows else ())
    moves = grows or bool(ancestors.movers)
    if emission and (varying or moves):  # not linear in exposure, temperature and sizes
        times = set(dense_times(times, prim.GetStage()))
    for hider in ancestors.hiders:
        times.update(UsdGeom.Imageable(hider).GetVisibilityAttr().GetTimeSamples())
    if not times:
        return None
    codes = sorted(times)
    samples, present, light = [], [], reader.lights[row]
    for code in codes:
        other, world = reader.at(Usd.TimeCode(code)), world_from_prim
        if ancestors.movers:
            world = reader.in_meters(ancestors.world(Usd.TimeCode(code), Gf.Matrix4d(1.0)))
        elif grows:
            world = other.local_to_world(prim)
        shown = not is_singular(world)  # what its transform flattens is off
        if shown and (varying or moves):
            other.add(prim, world)
        light = other.lights[0] if other.lights and type(other.lights[0]) is type(light) else light
        samples.append(light)
        present.append(shown and ancestors.is_visible(Usd.TimeCode(code)))
    excluded = (*_CONSTANT, *(() if emission else _EMISSION), *(() if ancestors.movers else ("world_from_light",)))
    return InputTrack.of(row, in_seconds(prim.GetStage(), codes), samples, tuple(present), excluded)


def mesh_emission_over_time(
    reader: LightReader, prim: Usd.Prim, area: float, areas: Mapping[float, float], report: StageReport
) -> list[tuple[float, Color]]:
    """Return the radiance of a mesh light at the time codes at which it is authored; empty if it is constant.

    Args:
        reader: reads lights.
        prim: a gprim with MeshLightAPI.
        area: of its triangles, stage units squared.
        areas: the same by time code, ascending, if the radiance depends on it and it varies.
        report: says whether the stage plays.
    """
    if not report.reads_animation:
        return []
    authored = [each for each in prim.GetAuthoredAttributes() if each.GetName().startswith("inputs:")]
    times = {time for each in authored if is_time_varying(each) for time in value_times(each)}
    result = []
    for time in dense_times({*times, *areas}, prim.GetStage()):
        now = float(np.interp(time, list(areas), list(areas.values()))) if areas else area
        color = reader.at(Usd.TimeCode(time)).mesh_emission(prim, now) if now > 0.0 else None
        if color is not None:
            result.append((time, color))
    return result
