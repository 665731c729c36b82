# SPDX-License-Identifier: Apache-2.0
"""The inputs of extended lobes at a surface point, from constants and textures."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3
from tiscene.render.bsdfs.material_inputs import lookup_value
from tiscene.render.bsdfs.sheen_tables import SMALLEST_ROUGHNESS
from tiscene.render.columns import read3
from tiscene.scene.material_table import (
    ABSORBS,
    ABSORPTION,
    ANISOTROPY,
    COAT_COLOR,
    COAT_IOR,
    EXTENDED_LOOKUP_COUNT,
    FIRST_LOOKUP,
    FLAGS,
    LOOKUP_COUNT,
    LOOKUP_INPUT,
    ROTATION,
    SHEEN,
    SHEEN_ROUGHNESS,
    SPECULAR_TINT,
    SPECULAR_WEIGHT,
    TINT,
    TRANSLUCENCY,
    TRANSLUCENT_COLOR,
)


@ti.dataclass
class LobeInputs:
    """Inputs of `ExtendedLobes` at one point, clamped to their ranges."""

    transmission_color: vec3
    sheen_color: vec3
    sheen_roughness: ti.f32
    anisotropy: ti.f32
    rotation: ti.f32  # turns
    specular: ti.f32
    specular_tint: vec3
    coat_color: vec3
    coat_ior: ti.f32
    translucency: ti.f32
    translucent_color: vec3


@ti.func
def lobe_inputs_at(materials: Template, textures: Template, surface: Template, exact: Template, footprint: Template):
    """Return the LobeInputs of a material with extended lobes; see `filtered_material_at`."""
    values = ti.static(materials.values)
    row = surface.material
    found = LobeInputs(
        transmission_color=read3(values, row, TINT),
        sheen_color=read3(values, row, SHEEN),
        sheen_roughness=values[row, SHEEN_ROUGHNESS],
        anisotropy=values[row, ANISOTROPY],
        rotation=values[row, ROTATION],
        specular=values[row, SPECULAR_WEIGHT],
        specular_tint=read3(values, row, SPECULAR_TINT),
        coat_color=read3(values, row, COAT_COLOR),
        coat_ior=values[row, COAT_IOR],
        translucency=values[row, TRANSLUCENCY],
        translucent_color=read3(values, row, TRANSLUCENT_COLOR),
    )
    first = materials.info[row, FIRST_LOOKUP] + materials.info[row, LOOKUP_COUNT]
    for lookup_row in range(first, first + materials.info[row, EXTENDED_LOOKUP_COUNT]):
        column = ti.cast(materials.lookups[lookup_row, LOOKUP_INPUT], ti.i32)
        value = lookup_value(materials, textures, lookup_row, surface, exact, footprint)
        if column == TINT:
            found.transmission_color = value.xyz
        elif column == SHEEN:
            found.sheen_color = value.xyz
        elif column == SHEEN_ROUGHNESS:
            found.sheen_roughness = value.x
        elif column == ANISOTROPY:
            found.anisotropy = value.x
        elif column == ROTATION:
            found.rotation = value.x
        elif column == SPECULAR_WEIGHT:
            found.specular = value.x
        elif column == SPECULAR_TINT:
            found.specular_tint = value.xyz
        elif column == COAT_COLOR:
            found.coat_color = value.xyz
        elif column == TRANSLUCENCY:
            found.translucency = value.x
        elif column == TRANSLUCENT_COLOR:
            found.translucent_color = value.xyz
    found.transmission_color = ti.math.clamp(found.transmission_color, 0.0, 1.0)
    found.sheen_color = ti.math.clamp(found.sheen_color, 0.0, 1.0)
    found.sheen_roughness = ti.math.clamp(found.sheen_roughness, SMALLEST_ROUGHNESS, 1.0)
    found.anisotropy = ti.math.clamp(found.anisotropy, 0.0, 1.0)
    found.specular = ti.math.clamp(found.specular, 0.0, 1.0)
    found.specular_tint = ti.max(found.specular_tint, 0.0)
    found.coat_color = ti.math.clamp(found.coat_color, 0.0, 1.0)
    found.translucency = ti.math.clamp(found.translucency, 0.0, 1.0)
    found.translucent_color = ti.math.clamp(found.translucent_color, 0.0, 1.0)
    return found


@ti.func
def transmittance(materials: Template, surface: Template, distance: ti.f32) -> vec3:
    """Return the transmittance of the segment that ends at a surface: below 1 if it crossed the surface's own solid.

    distance: m. The law of Beer and Lambert. A segment that ends at another surface inside the solid counts as clear.
    """
    result = vec3(1.0)
    row = surface.material
    if surface.front == 0 and (materials.info[row, FLAGS] & ABSORBS) != 0:
        for c in ti.static(range(3)):
            result[c] = ti.exp(-distance * materials.values[row, ABSORPTION + c])
    return result
