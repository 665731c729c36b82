"""The inputs of UsdPreviewSurface at a point of a surface: constants or texture lookups, and the normal map."""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.render.textures import lookup, lookup_coarse
from tiscene.scene.material_table import (
    CLEARCOAT,
    CLEARCOAT_ROUGHNESS,
    DIFFUSE,
    EMISSIVE,
    EMITS,
    FLAGS,
    GLASS,
    GLASS_INDEX,
    INPUTS,
    IOR,
    LOOKUP_BIAS,
    LOOKUP_CHANNEL,
    LOOKUP_OF,
    LOOKUP_SCALE,
    LOOKUP_TEXTURE,
    LOOKUP_TRANSFORM,
    METALLIC,
    OPACITY,
    PLAIN,
    ROUGHNESS,
    SPECULAR,
    SPECULAR_WORKFLOW,
    TEXTURED,
    THRESHOLD,
)

vec2 = ti.math.vec2
vec3 = ti.math.vec3
vec4 = ti.math.vec4

_LOOKUP_COLUMN_OF = {column: LOOKUP_OF[name] for name, column in INPUTS}


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


@ti.func
def texture_value(materials: ti.template(), textures: ti.template(), row: ti.i32, uv: vec2, coarse: ti.i32) -> vec4:
    """A row of the lookups at uv: rgb as it is, or one channel four times; scaled and biased. coarse: 1 for the mean of
    the texture thereabouts."""
    transform = LOOKUP_TRANSFORM
    lookups = ti.static(materials.lookups)
    u = lookups[row, transform] * uv.x + lookups[row, transform + 1] * uv.y + lookups[row, transform + 2]
    v = lookups[row, transform + 3] * uv.x + lookups[row, transform + 4] * uv.y + lookups[row, transform + 5]
    texture = ti.cast(lookups[row, LOOKUP_TEXTURE], ti.i32)
    value = vec4(0.0)
    if coarse != 0:
        value = lookup_coarse(textures, texture, vec2(u, v))
    else:
        value = lookup(textures, texture, vec2(u, v))
    for channel in ti.static(range(4)):
        value[channel] = value[channel] * lookups[row, LOOKUP_SCALE + channel] + lookups[row, LOOKUP_BIAS + channel]
    channel = ti.cast(lookups[row, LOOKUP_CHANNEL], ti.i32)
    if channel > 0:
        value = vec4(value.x if channel == 1 else (value.y if channel == 2 else (value.z if channel == 3 else value.w)))
    return value


@ti.func
def material_at(materials: ti.template(), textures: ti.template(), row: ti.i32, uv: vec2):
    """Every input of the material at uv: a MaterialPoint."""
    return material_about(materials, textures, row, uv, 0)


@ti.func
def material_about(materials: ti.template(), textures: ti.template(), row: ti.i32, uv: vec2, coarse: ti.i32):
    """`material_at`, or where coarse is 1, about what it is on the mean near uv. Opacity and bumps stay exact: a mean
    of normals would be a smoother, brighter surface."""
    values = ti.static(materials.values)
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
        glass=ti.max(materials.info[row, GLASS_INDEX], 0),
    )
    if point.flags & TEXTURED:
        for column in range(LOOKUP_OF["diffuse_color"], LOOKUP_OF["normal"] + 1):  # one lookup in the code, not nine
            lookup_row = materials.info[row, column]
            if lookup_row >= 0:
                rough = coarse if column < ti.static(LOOKUP_OF["opacity"]) else 0
                value = texture_value(materials, textures, lookup_row, uv, rough)
                if column == ti.static(_LOOKUP_COLUMN_OF[DIFFUSE]):
                    point.diffuse_color = value.xyz
                elif column == ti.static(_LOOKUP_COLUMN_OF[EMISSIVE]):
                    point.emissive_color = value.xyz
                elif column == ti.static(_LOOKUP_COLUMN_OF[SPECULAR]):
                    point.specular_color = value.xyz
                elif column == ti.static(_LOOKUP_COLUMN_OF[METALLIC]):
                    point.metallic = value.x
                elif column == ti.static(_LOOKUP_COLUMN_OF[ROUGHNESS]):
                    point.roughness = value.x
                elif column == ti.static(_LOOKUP_COLUMN_OF[CLEARCOAT]):
                    point.clearcoat = value.x
                elif column == ti.static(_LOOKUP_COLUMN_OF[CLEARCOAT_ROUGHNESS]):
                    point.clearcoat_roughness = value.x
                elif column == ti.static(_LOOKUP_COLUMN_OF[OPACITY]):
                    point.opacity = value.x
                elif value.xyz.dot(value.xyz) > 1e-8:
                    point.normal = value.xyz.normalized()
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
def shaded_material_at(materials: ti.template(), textures: ti.template(), row: ti.i32, uv: vec2, coarse: ti.i32):
    """`material_about`, as far as light is concerned: of a plain material only the colours are read."""
    values = ti.static(materials.values)
    point = MaterialPoint(normal=vec3(0.0, 0.0, 1.0), flags=materials.info[row, FLAGS])
    if point.flags & PLAIN:
        point.diffuse_color = vec3(values[row, DIFFUSE], values[row, DIFFUSE + 1], values[row, DIFFUSE + 2])
        point.diffuse_color = ti.math.clamp(point.diffuse_color, 0.0, 1.0)
        if point.flags & EMITS:
            point.emissive_color = vec3(values[row, EMISSIVE], values[row, EMISSIVE + 1], values[row, EMISSIVE + 2])
            point.emissive_color = ti.max(point.emissive_color, 0.0)
    else:
        point = material_about(materials, textures, row, uv, coarse)
    return point


@ti.func
def shading_normal(surface: ti.template(), point: ti.template(), wo: vec3) -> vec3:
    """The surface's normal after the normal map, bent where need be so that wo is above it."""
    n = surface.normal
    if point.normal.z < 1.0:
        tangent = surface.dp_du - n * n.dot(surface.dp_du)
        length = tangent.norm()
        if length > 0.0:
            tangent /= length
            bitangent = n.cross(tangent)
            if bitangent.dot(surface.dp_dv) < 0.0:
                bitangent = -bitangent
            side = 1.0 if surface.front != 0 else -1.0  # seen from behind, the bumps are hollows
            n = side * (tangent * point.normal.x + bitangent * point.normal.y) + n * point.normal.z
            n = n.normalized()
    cosine = n.dot(wo)
    if cosine < 0.01:
        n = (n + wo * (0.01 - cosine)).normalized()
    return n


@ti.func
def is_mirror_like(point: ti.template()):
    """Whether one sees other things in it rather than itself: 1 or 0."""
    sharp = point.roughness < 0.15
    clear = (point.flags & GLASS) != 0 and point.opacity < 0.5
    shiny = point.metallic > 0.5
    if point.flags & SPECULAR_WORKFLOW:
        shiny = point.specular_color.min() > 0.5
    return ti.cast(sharp and (clear or shiny), ti.i32)
