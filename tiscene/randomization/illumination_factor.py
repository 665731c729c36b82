# SPDX-License-Identifier: Apache-2.0
"""The factor "illumination": time of day, and strength, color and direction of each light."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from dynamics.argument_checks import is_number
from tiscene.errors import ScenarioError
from tiscene.randomization.draws import Draws
from tiscene.randomization.factor_ranges import IlluminationRanges
from tiscene.randomization.scene_files import stage_of, variant_sets_of
from tiscene.scenario.overrides import LightOverride, Override
from tiscene.scenario.scenario import Scenario
from tiscene.scene.color import LUMINANCE
from tiscene.scene.light_description import DistantLight, DomeLight

LIGHTING = "lighting"  # the variant set of a scene that has its times of day
ANY = ("*",)
DECIMALS = 4


def with_illumination(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario in another light. Overrides of lights are replaced.

    Args:
        scenario: the scenario.
        value: ranges; a variant of the scene's lighting, such as "night"; a number of stops of exposure compensation;
            None: typical ranges.
        draws: returns the random numbers of a light, by its prim's path; "" for the scene.

    Raises:
        ScenarioError: the scene has no such lighting.
    """
    if isinstance(value, str):
        value = {"lighting": (value,)}
    elif is_number(value):
        value = {"exposure": value}
    ranges = IlluminationRanges.of(value, "illumination")
    if ranges.lighting:
        scenario = replace(scenario, variants=_with_lighting(scenario, ranges, draws("")))
    overrides: list[Override] = [each for each in scenario.overrides if not isinstance(each, LightOverride)]
    neutral = IlluminationRanges(ranges.lighting, exposure=ranges.exposure)
    if ranges != neutral:
        for light in stage_of(scenario).lights:
            overrides.append(_drawn(light.prim_path, isinstance(light, DistantLight | DomeLight), ranges, draws))
    stops = round(draws("").between("exposure", 0, *ranges.exposure), DECIMALS)
    return replace(scenario, overrides=overrides, exposure_compensation=stops)


def _drawn(path: str, is_infinite: bool, ranges: IlluminationRanges, draws: Callable[[str], Draws]) -> LightOverride:
    """Return the override of one light. Only light from infinity changes its direction."""
    own = draws(path)
    low, high = (math.log(each) for each in ranges.strength)
    hue = float(own.uniform("hue", 0)[0])
    color = colorsys.hsv_to_rgb(hue, own.between("color", 0, *ranges.color), 1.0)
    luminance = float(sum(weight * each for weight, each in zip(LUMINANCE, color, strict=True)))
    red, green, blue = (round(each / luminance, DECIMALS) for each in color)
    return LightOverride(
        path,
        intensity=round(math.exp(own.between("strength", 0, low, high)), DECIMALS),
        color=(red, green, blue),
        yaw=round(own.either_side("yaw", ranges.yaw), DECIMALS) if is_infinite else 0.0,
        pitch=round(own.either_side("pitch", ranges.pitch), DECIMALS) if is_infinite else 0.0,
    )


def _with_lighting(scenario: Scenario, ranges: IlluminationRanges, own: Draws) -> Mapping[str, str]:
    """Return the scenario's variants with one of the lighting's."""
    sets = variant_sets_of(scenario)
    keys = [key for key in sets if key.endswith(f"{{{LIGHTING}}}")]
    # That of the whole scene; else those of all its rooms.
    keys = [key for key in keys if key.count("/") == min(each.count("/") for each in keys)]
    if not keys:
        if ranges.lighting == ANY:
            return scenario.variants
        raise ScenarioError(
            f"scene {scenario.scene!r} has no variant set {LIGHTING!r}: give strength and color instead"
        )
    known = sets[keys[0]][1]
    choices = known if ranges.lighting == ANY else ranges.lighting
    for each in choices:
        if each not in known:
            raise ScenarioError(f"scene {scenario.scene!r} has no lighting {each!r}; there are {', '.join(known)}")
    chosen = choices[own.whole("lighting", 0, 0, len(choices) - 1)]
    variants: dict[str, Any] = dict(scenario.variants)
    for key in keys:
        prim = key.partition("{")[0]
        nested = variants.get(prim)
        if isinstance(nested, Mapping):  # the other notation of the same selection
            variants[prim] = {name: each for name, each in nested.items() if name != LIGHTING}
        if chosen in sets[key][1]:
            variants[key] = chosen
    return variants
