# SPDX-License-Identifier: Apache-2.0
"""The inputs of UsdPreviewSurface at a point of a surface: constants or texture lookups, and the normal map."""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3, vec4
from tiscene.render.sampling.sobol import mix
from tiscene.render.texture_lookup import copy_about, lookup, lookup_one
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

# A mean of unit normals this little short of 1 says nothing: it is of 8-bit codes.
_CODE_ERROR = 6e-3
ALL_INPUTS = -1
LEAST_COSINE = 0.01  # of the shading normal with the way that light goes


class Materials(NamedTuple):
    """The arrays of a MaterialTable, bundled inside a kernel."""

    values: Any
    info: Any
    lookups: Any


@ti.dataclass
class MaterialPoint:
    """The inputs of UsdPreviewSurface at one point, in their meaningful ranges."""

    diffuse_color: vec3
    emissive_color: vec3
    specular_color: vec3
    metallic: ti.f32
    roughness: ti.f32
    clearcoat: ti.f32
    clearcoat_roughness: ti.f32
    opacity: ti.f32  # after the threshold
    ior: ti.f32
    normal: vec3  # in the tangent frame, unit
    flags: ti.i32
    glass: ti.i32  # which of the glass energy tables


@ti.dataclass
class Footprint:
    """How much of a surface a path can tell apart."""

    uv_area: ti.f32  # 0: a point
    u: vec3  # uniform numbers that choose among the pixels meant


@ti.func
def footprint_at(surface: Template, direction: vec3, width: ti.f32, key: ti.u32):
    """The Footprint of a cone that is `width` meters wide where it meets the surface."""
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
    """A row of the lookups at a point of a surface: rgb as it is, or one channel four times; scaled and biased.

    exact: 1 for the interpolated value, 0 for one pixel; both of a copy of the texture that fits the footprint.
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
            value = lookup(textures, copy_about(textures, texture, footprint.uv_area * pixels, 0.0), vec2(u, v))
        else:
            value = lookup_one(textures, texture, vec2(u, v), footprint.uv_area * pixels, footprint.u)
    for channel in ti.static(range(4)):
        value[channel] = value[channel] * lookups[row, LOOKUP_SCALE + channel] + lookups[row, LOOKUP_BIAS + channel]
    channel = ti.cast(lookups[row, LOOKUP_CHANNEL], ti.i32)
    if channel > 0 and channel < UNIT_NORMAL:
        value = vec4(value.x if channel == 1 else (value.y if channel == 2 else (value.z if channel == 3 else value.w)))
    return value


@ti.func
def material_at(materials: Template, textures: Template, surface: Template, inputs: ti.i32, footprint: Template):
    """The material at a point of a surface, as its author has it there, or the mean over a footprint: a MaterialPoint.

    inputs: bits 1 << DIFFUSE and so on of those that are wanted; others may be what they are without their textures.
    """
    return material_about(materials, textures, surface, 1, footprint, inputs)


@ti.func
def material_about(
    materials: Template,
    textures: Template,
    surface: Template,
    exact: Template,
    footprint: Template,
    inputs: ti.i32,
):
    """`material_at`, or where exact is 0, what one path sees of the footprint: the mean over paths is right."""
    values = ti.static(materials.values)
    row = surface.material
    point = MaterialPoint(
        diffuse_color=vec3(values[row, DIFFUSE], values[row, DIFFUSE + 1], values[row, DIFFUSE + 2]),
        emissive_color=vec3(values[row, EMISSIVE], values[row, EMISSIVE + 1], values[row, EMISSIVE + 2]),
        specular_color=vec3(values[row, SPECULAR], values[row, SPECULAR + 1], values[row, SPECULAR + 2]),
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
                        shortness = ti.max(1.0 - length - _CODE_ERROR, 0.0)
        if ti.static(not exact) and shortness > 0.0:
            # The mean of different normals is short. Their spread makes a gloss rougher (Toksvig 2005; the variance of
            # the slopes adds to alpha squared), and takes from the cosine with the light.
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
    """The material of a surface as far as light is concerned, for a path that comes as a cone `width` meters wide: of a
    plain material only the colors are read. key: of numbers that choose among pixels."""
    values = ti.static(materials.values)
    row = surface.material
    point = MaterialPoint(normal=vec3(0.0, 0.0, 1.0), flags=materials.info[row, FLAGS])
    if point.flags & PLAIN:
        point.diffuse_color = vec3(values[row, DIFFUSE], values[row, DIFFUSE + 1], values[row, DIFFUSE + 2])
        point.diffuse_color = ti.math.clamp(point.diffuse_color, 0.0, 1.0)
        if point.flags & EMITS:
            point.emissive_color = vec3(values[row, EMISSIVE], values[row, EMISSIVE + 1], values[row, EMISSIVE + 2])
            point.emissive_color = ti.max(point.emissive_color, 0.0)
    else:
        footprint = footprint_at(surface, direction, width, key)
        point = material_about(materials, textures, surface, 0, footprint, ALL_INPUTS)
    return point


@ti.func
def shading_normal(surface: Template, point: Template, wo: vec3) -> vec3:
    """The surface's normal after the normal map, bent where need be so that wo is above it."""
    n = surface.normal
    if point.normal.z < 1.0:
        tangent = surface.dp_du - n * n.dot(surface.dp_du)
        length = tangent.norm()
        if length > 0.0:
            tangent /= length
            bitangent = n.cross(tangent)
            if bitangent.dot(surface.dp_dv) < 0.0:
                bitangent = -1.0 * bitangent
            side = 1.0 if surface.front != 0 else -1.0  # seen from behind, the bumps are hollows
            n = side * (tangent * point.normal.x + bitangent * point.normal.y) + n * point.normal.z
            n = n.normalized()
    cosine = n.dot(wo)
    if cosine < LEAST_COSINE:
        n = (n + wo * (LEAST_COSINE - cosine)).normalized()
    return n


@ti.func
def is_mirror_like(point: Template):
    """Whether one sees other things in it rather than itself: 1 or 0."""
    sharp = point.roughness < MIRROR_ROUGHNESS
    clear = (point.flags & GLASS) != 0 and point.opacity < 0.5
    shiny = point.metallic > MIRROR_METALLIC
    if point.flags & SPECULAR_WORKFLOW:
        shiny = point.specular_color.min() > MIRROR_SPECULAR
    return ti.cast(sharp and (clear or shiny), ti.i32)
