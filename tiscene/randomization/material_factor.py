# SPDX-License-Identifier: Apache-2.0
"""The factor "materials": other colors, roughness and textures, within what is plausible for each kind of material.

A material's inputs show its kind. Wood has textures of color, roughness and normals; fabric of color and normals,
and is rough; plaster is rough, of one color, with a texture of normals; metal is metallic. Textures that show one
picture on the whole of a surface, as paintings do, are of no kind.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynamics.argument_checks import is_number
from tiscene.randomization.draws import Draws
from tiscene.randomization.factor_ranges import MaterialRanges
from tiscene.randomization.scene_files import stage_of, templates_of
from tiscene.scenario.overrides import MaterialOverride, Override
from tiscene.scenario.scenario import Scenario
from tiscene.scene.color import decode_srgb, encode_srgb
from tiscene.scene.description import Color, Material, SceneDescription, TextureLookup

DARKEST, BRIGHTEST = 0.02, 0.85  # base colors of real materials, linear
LEAST_ROUGHNESS = 0.05
ROUGH = 0.75
TINTS = 0.25, 4.0  # factors of a texture's color, at least and at most
HUES = {"wood": 0.1, "metal": 0.05}  # fraction of the drawn turn of the hue that a kind takes; other materials take all
DECIMALS = 4


def with_materials_drawn(scenario: Scenario, value: Any, draws: Callable[[str], Draws]) -> Scenario:
    """Return a scenario with other materials, of the scene and of its objects. Overrides of materials are replaced.

    Args:
        scenario: the scenario.
        value: ranges; a number from 0 to 1, how far materials change; None: typical ranges.
        draws: returns the random numbers of a material, by its prim's path; "" for the scene.
    """
    if is_number(value):
        value = {"color": value, "roughness": 0.5 * value, "swap": value}
    ranges = MaterialRanges.of(value, "materials")
    share = draws("").between("share", 0, *ranges.share)
    swaps = draws("").between("swap", 0, *ranges.swap)
    overrides: list[Override] = [each for each in scenario.overrides if not isinstance(each, MaterialOverride)]
    known = set()
    for description in (stage_of(scenario), *templates_of(scenario).values()):
        pictures = _pictures(description)
        kinds = [_kind(each, row in pictures) for row, each in enumerate(description.materials)]
        for row, material in enumerate(description.materials):
            own = draws(material.prim_path)
            if not _is_plain(material) or material.prim_path in known or own.uniform("chosen", 0)[0] >= share:
                continue
            known.add(material.prim_path)
            like = None
            if kinds[row] and own.uniform("swap", 0)[0] < swaps:
                others = [other for other, kind in enumerate(kinds) if kind == kinds[row] and other != row]
                like = others[own.whole("like", 0, 0, len(others) - 1)] if others else None
            override = _changed(description, row, like, kinds[row], ranges, own)
            if override is not None:
                overrides.append(override)
    return replace(scenario, overrides=overrides)


def _is_plain(material: Material) -> bool:
    """Return whether a material is opaque, does not emit light and is no mirror."""
    return (
        material.prim_path != ""
        and material.opacity == 1.0
        and material.emissive_color == (0.0, 0.0, 0.0)
        and (isinstance(material.roughness, TextureLookup) or material.roughness > LEAST_ROUGHNESS)
    )


def _kind(material: Material, is_picture: bool) -> str:
    """Return the kind of a material: "wood", "fabric", "plaster", "metal", or "" for none."""
    if not _is_plain(material):
        return ""
    textured = isinstance(material.diffuse_color, TextureLookup)
    is_rough = not isinstance(material.roughness, TextureLookup) and material.roughness >= ROUGH
    if isinstance(material.metallic, float) and material.metallic > 0.9 and not textured:
        return "metal"
    if material.normal is None or material.metallic != 0.0 or (textured and is_picture):
        return ""
    if textured and isinstance(material.roughness, TextureLookup):
        return "wood"
    if textured and is_rough:
        return "fabric"
    return "plaster" if is_rough and not textured else ""


def _pictures(description: SceneDescription) -> set[int]:
    """Return the rows of the materials whose texture some mesh shows exactly once."""
    found = set()
    for mesh in description.meshes:
        if mesh.uv is not None:
            for row in np.unique(mesh.materials).tolist():
                uv = mesh.uv[mesh.triangles[mesh.materials == row].reshape(-1)]
                if np.allclose(np.ptp(uv, axis=0), 1.0, atol=1e-3):
                    found.add(row)
    return found


def _changed(
    description: SceneDescription, row: int, like: int | None, kind: str, ranges: MaterialRanges, own: Draws
) -> MaterialOverride | None:
    """Return the override of one material; None if nothing of it changes."""
    material = description.materials[row]
    source = material if like is None else description.materials[like]
    base = _base_color(source, description)
    amount = own.between("color", 0, *ranges.color)
    color, tint = None, (1.0, 1.0, 1.0)
    if base is not None and amount > 0.0:
        target = _shifted(base, amount, HUES.get(kind, 1.0), own)
        if isinstance(source.diffuse_color, TextureLookup):
            ratios = [min(max(b / max(a, 1e-3), TINTS[0]), TINTS[1]) for a, b in zip(base, target, strict=True)]
            tint = _rounded(ratios)
        else:
            color = _rounded(target)
    roughness = None
    by = own.either_side("rough", ranges.roughness)
    if by != 0.0 and not isinstance(source.roughness, TextureLookup):
        roughness = round(min(max(source.roughness + by, LEAST_ROUGHNESS), 1.0), DECIMALS)
    path = None if like is None else source.prim_path
    if path is None and color is None and tint == (1.0, 1.0, 1.0) and roughness is None:
        return None
    return MaterialOverride(material.prim_path, like=path, color=color, tint=tint, roughness=roughness)


def _base_color(material: Material, description: SceneDescription) -> Color | None:
    """Return the mean base color, linear; None for colors of vertices."""
    color = material.diffuse_color
    if not isinstance(color, TextureLookup):
        return color
    if color.texture < 0:
        return None
    texture = description.textures[color.texture]
    pixels = texture.pixels[:: max(1, texture.pixels.shape[0] // 64), :: max(1, texture.pixels.shape[1] // 64), :3]
    values = pixels / 255.0 if pixels.dtype == np.uint8 else pixels.astype(np.float64)
    mean = (decode_srgb(values) if texture.encoding == "srgb" else values).reshape(-1, 3).mean(axis=0)
    red, green, blue = (mean * color.scale[:3] + color.bias[:3]).tolist()
    return (red, green, blue)


def _shifted(base: Color, amount: float, hues: float, own: Draws) -> Color:
    """Return a base color of another hue, lightness and saturation."""
    hue, lightness, saturation = colorsys.rgb_to_hls(*np.clip(encode_srgb(np.array(base)), 0.0, 1.0).tolist())
    a, b, c = own.uniform("shift", 0, 3).tolist()
    hue = (hue + amount * hues * (a - 0.5)) % 1.0
    lightness = lightness * math.exp(amount * (b - 0.5) * 1.4)
    saturation = min(max(saturation + amount * hues * (c - 0.35) * 0.6, 0.0), 0.9)
    red, green, blue = decode_srgb(
        np.array(colorsys.hls_to_rgb(hue, min(max(lightness, 0.05), 0.95), saturation))
    ).tolist()
    scale = min(1.0, BRIGHTEST / max(red, green, blue, 1e-6))
    red, green, blue = (max(each * scale, DARKEST * 0.5) for each in (red, green, blue))
    return (red, green, blue)


def _rounded(values: Sequence[float]) -> Color:
    red, green, blue = (round(each, DECIMALS) for each in values)
    return (red, green, blue)
