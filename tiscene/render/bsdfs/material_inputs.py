# SPDX-License-Identifier: Apache-2.0
"""The inputs of UsdPreviewSurface at a surface point, from constants and textures; the shading normal."""

from typing import NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Floats2, Ints2, Template, vec2, vec3, vec4
from tiscene.render.columns import read3
from tiscene.render.sampling.sobol import mix
from tiscene.render.texture_lookup import lookup, lookup_stochastic, mip_row
from tiscene.scene.material_table import (
    CLEARCOAT,
    CLEARCOAT_ROUGHNESS,
    DIFFUSE,
    EMISSIVE,
    EMITS,
    FIRST_LOOKUP,
    FLAGS,
    GLASS,
    GLASS_INDEX,
    IOR,
    LOOKUP_BIAS,
    LOOKUP_CHANNEL,
    LOOKUP_COUNT,
    LOOKUP_FACTOR,
    LOOKUP_INPUT,
    LOOKUP_SCALE,
    LOOKUP_SCALED_AREA,
    LOOKUP_SET,
    LOOKUP_TEXTURE,
    LOOKUP_TRANSFORM,
    METALLIC,
    MIRROR_METALLIC,
    MIRROR_ROUGHNESS,
    MIRROR_SPECULAR,
    OPACITY,
    PLAIN,
    ROUGHNESS,
    SPECULAR,
    SPECULAR_WORKFLOW,
    TEXTURED,
    THRESHOLD,
    UNIT_NORMAL,
)
from tiscene.scene.textures.atlas import HEIGHT, WIDTH

# Deviations of a mean normal's length from 1 that are due to 8-bit quantization.
_QUANTIZATION_ERROR = 6e-3
ALL_INPUTS = -1
MIN_COSINE = 0.01  # between the adjusted shading normal and the outgoing direction


class Materials(NamedTuple):
    """The arrays of a MaterialTable; a parameter of kernels, see `argument_bundles`."""

    values: Floats2
    info: Ints2
    lookups: Floats2


@ti.dataclass
class MaterialPoint:
    """The inputs of UsdPreviewSurface at one point, clamped to their ranges."""

    diffuse_color: vec3
    emissive_color: vec3
    specular_color: vec3
    metallic: ti.f32
    roughness: ti.f32
    clearcoat: ti.f32
    clearcoat_roughness: ti.f32
    opacity: ti.f32  # after the threshold
    ior: ti.f32
    normal: vec3  # of the normal map, tangent frame, unit
    flags: ti.i32
    glass: ti.i32  # number of the glass energy table


@ti.dataclass
class Footprint:
    """The area of a surface that a texture lookup is filtered over."""

    uv_area: ti.f32  # 0: a point
    u: vec3  # uniform in [0, 1)³, for stochastic filtering


@ti.func
def footprint_at(surface: Template, direction: vec3, width: ti.f32, key: ti.u32):
    """Return the Footprint of a ray cone of a width, m, at the surface. key: hashed to the random numbers."""
    world_per_uv = surface.dp_du.cross(surface.dp_dv).norm()
    cosine = ti.max(ti.abs(surface.normal.dot(direction)), 0.01)
    bits = mix(key)
    u = vec3(ti.cast(bits & 2047, ti.f32), ti.cast((bits >> 11) & 2047, ti.f32), ti.cast(bits >> 22, ti.f32))
    return Footprint(
        uv_area=width * width / ti.max(cosine * world_per_uv, 1e-30),
        u=(u + 0.5) * vec3(1.0 / 2048.0, 1.0 / 2048.0, 1.0 / 1024.0),
    )


@ti.func
def lookup_value(
    materials: Template,
    textures: Template,
    row: ti.i32,
    surface: Template,
    exact: Template,
    footprint: Template,
):
    """Evaluate one texture lookup of a material.

    Args:
        materials: Materials.
        textures: Textures.
        row: Of `materials.lookups`.
        surface: VisibleSurface.
        exact: Static. 1: interpolate between pixels; 0: read one pixel at random; both from the mipmap level that fits
            the footprint.
        footprint: Footprint.

    Returns:
        rgba, or one channel four times; scaled, biased, and multiplied by the color or opacity of the vertices.
    """
    transform = LOOKUP_TRANSFORM
    lookups = ti.static(materials.lookups)
    uv = surface.uv
    if lookups[row, LOOKUP_SET] > 0.0:
        uv = surface.second_uv
    u = lookups[row, transform] * uv.x + lookups[row, transform + 1] * uv.y + lookups[row, transform + 2]
    v = lookups[row, transform + 3] * uv.x + lookups[row, transform + 4] * uv.y + lookups[row, transform + 5]
    texture = ti.cast(lookups[row, LOOKUP_TEXTURE], ti.i32)
    value = surface.color
    if texture >= 0:
        pixels = textures.info[texture, WIDTH] * textures.info[texture, HEIGHT] * lookups[row, LOOKUP_SCALED_AREA]
        if ti.static(exact):
            value = lookup(textures, mip_row(textures, texture, footprint.uv_area * pixels, 0.0), vec2(u, v))
        else:
            value = lookup_stochastic(textures, texture, vec2(u, v), footprint.uv_area * pixels, footprint.u)
    for channel in ti.static(range(4)):
        value[channel] = value[channel] * lookups[row, LOOKUP_SCALE + channel] + lookups[row, LOOKUP_BIAS + channel]
    channel = ti.cast(lookups[row, LOOKUP_CHANNEL], ti.i32)
    if channel > 0 and channel < UNIT_NORMAL:
        value = vec4(value.x if channel == 1 else (value.y if channel == 2 else (value.z if channel == 3 else value.w)))
    factor = ti.cast(lookups[row, LOOKUP_FACTOR], ti.i32)
    if factor == 1:
        value *= surface.color
    elif factor == 2:
        value *= surface.color.w
    return value


@ti.func
def material_at(materials: Template, textures: Template, surface: Template, inputs: ti.i32, footprint: Template):
    """Return the MaterialPoint with interpolated textures, filtered over a footprint.

    inputs: bits 1 << DIFFUSE etc. of the inputs that are needed; textures of other inputs may be left out.
    """
    return filtered_material_at(materials, textures, surface, 1, footprint, inputs)


@ti.func
def filtered_material_at(
    materials: Template,
    textures: Template,
    surface: Template,
    exact: Template,
    footprint: Template,
    inputs: ti.i32,
):
    """Return `material_at` (exact=1, static), or a one-sample stochastic estimate of it (exact=0)."""
    values = ti.static(materials.values)
    row = surface.material
    point = MaterialPoint(
        diffuse_color=read3(values, row, DIFFUSE),
        emissive_color=read3(values, row, EMISSIVE),
        specular_color=read3(values, row, SPECULAR),
        metallic=values[row, METALLIC],
        roughness=values[row, ROUGHNESS],
        clearcoat=values[row, CLEARCOAT],
        clearcoat_roughness=values[row, CLEARCOAT_ROUGHNESS],
        opacity=values[row, OPACITY],
        ior=values[row, IOR],
        normal=vec3(0.0, 0.0, 1.0),
        flags=materials.info[row, FLAGS],
        glass=materials.info[row, GLASS_INDEX],
    )
    if point.flags & TEXTURED:
        first = materials.info[row, FIRST_LOOKUP]
        shortness = 0.0
        for lookup_row in range(first, first + materials.info[row, LOOKUP_COUNT]):
            column = ti.cast(materials.lookups[lookup_row, LOOKUP_INPUT], ti.i32)
            wanted = True
            if ti.static(exact):
                wanted = inputs & (1 << column) != 0
            if wanted:
                value = lookup_value(materials, textures, lookup_row, surface, exact, footprint)
                if column == DIFFUSE:
                    point.diffuse_color = value.xyz
                elif column == ROUGHNESS:
                    point.roughness = value.x
                elif column == METALLIC:
                    point.metallic = value.x
                elif column == EMISSIVE:
                    point.emissive_color = value.xyz
                elif column == SPECULAR:
                    point.specular_color = value.xyz
                elif column == CLEARCOAT:
                    point.clearcoat = value.x
                elif column == CLEARCOAT_ROUGHNESS:
                    point.clearcoat_roughness = value.x
                elif column == OPACITY:
                    point.opacity = value.x
                elif value.xyz.dot(value.xyz) > 1e-8:
                    length = value.xyz.norm()
                    point.normal = value.xyz / length
                    if ti.cast(materials.lookups[lookup_row, LOOKUP_CHANNEL], ti.i32) == UNIT_NORMAL:
                        shortness = ti.max(1.0 - length - _QUANTIZATION_ERROR, 0.0)
        if ti.static(not exact) and shortness > 0.0:
            # A mean of different normals is shorter than 1. Their variance increases roughness (Toksvig 2005: the
            # variance of slopes adds to alpha squared) and reduces the mean cosine with the light.
            alpha = point.roughness * point.roughness
            point.roughness = ti.sqrt(ti.sqrt(alpha * alpha + 2.0 * shortness / (1.0 - shortness)))
            point.diffuse_color *= 1.0 - shortness
    point.diffuse_color = ti.math.clamp(point.diffuse_color, 0.0, 1.0)
    point.emissive_color = ti.max(point.emissive_color, 0.0)
    point.specular_color = ti.math.clamp(point.specular_color, 0.0, 1.0)
    point.metallic = ti.math.clamp(point.metallic, 0.0, 1.0)
    point.roughness = ti.math.clamp(point.roughness, 0.0, 1.0)
    point.clearcoat = ti.math.clamp(point.clearcoat, 0.0, 1.0)
    point.clearcoat_roughness = ti.math.clamp(point.clearcoat_roughness, 0.0, 1.0)
    point.opacity = ti.math.clamp(point.opacity, 0.0, 1.0)
    threshold = values[row, THRESHOLD]
    if threshold > 0.0:
        point.opacity = 1.0 if point.opacity >= threshold else 0.0
    return point


@ti.func
def shaded_material_at(
    materials: Template,
    textures: Template,
    surface: Template,
    direction: vec3,
    width: ti.f32,
    key: ti.u32,
):
    """Return the MaterialPoint for shading; of a PLAIN material only colors are read.

    Args:
        materials: Materials.
        textures: Textures.
        surface: VisibleSurface.
        direction: Of the ray.
        width: Of the ray cone at the surface, m.
        key: Of the random numbers for stochastic filtering.
    """
    values = ti.static(materials.values)
    row = surface.material
    point = MaterialPoint(normal=vec3(0.0, 0.0, 1.0), flags=materials.info[row, FLAGS])
    if point.flags & PLAIN:
        point.diffuse_color = read3(values, row, DIFFUSE)
        point.diffuse_color = ti.math.clamp(point.diffuse_color, 0.0, 1.0)
        if point.flags & EMITS:
            point.emissive_color = read3(values, row, EMISSIVE)
            point.emissive_color = ti.max(point.emissive_color, 0.0)
    else:
        footprint = footprint_at(surface, direction, width, key)
        point = filtered_material_at(materials, textures, surface, 0, footprint, ALL_INPUTS)
    return point


@ti.func
def shading_normal(surface: Template, point: Template, wo: vec3) -> vec3:
    """Return the shading normal with the normal map, adjusted so that wo is at least MIN_COSINE above its plane."""
    n = surface.normal
    if point.normal.z < 1.0:
        tangent = surface.dp_du - n * n.dot(surface.dp_du)
        length = tangent.norm()
        if length > 0.0:
            tangent /= length
            bitangent = n.cross(tangent)
            if bitangent.dot(surface.dp_dv) < 0.0:
                bitangent = -1.0 * bitangent
            side = 1.0 if surface.front != 0 else -1.0  # from behind, the normal map is inverted
            n = side * (tangent * point.normal.x + bitangent * point.normal.y) + n * point.normal.z
            n = n.normalized()
    cosine = n.dot(wo)
    if cosine < MIN_COSINE:
        n = (n + wo * (MIN_COSINE - cosine)).normalized()
    return n


@ti.func
def is_mirror_like(point: Template):
    """Return 1 for a surface whose mirror image or transmission is visible rather than its own color, else 0."""
    sharp = point.roughness < MIRROR_ROUGHNESS
    clear = (point.flags & GLASS) != 0 and point.opacity < 0.5
    shiny = point.metallic > MIRROR_METALLIC
    if point.flags & SPECULAR_WORKFLOW:
        shiny = point.specular_color.min() > MIRROR_SPECULAR
    return ti.cast(sharp and (clear or shiny), ti.i32)
