# SPDX-License-Identifier: Apache-2.0
"""UsdLux's ShapingAPI: the factor of a light's radiance by cone, focus and IES profile (see `Shaping`)."""

import math

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.columns import read3
from tiscene.render.lights import cylinder
from tiscene.render.lights.light_kernels import BUILT_IN_KERNELS, LIGHT_KERNELS
from tiscene.render.lights.light_sample import axis, to_light
from tiscene.render.sampling import warp
from tiscene.render.texture_lookup import CLAMP, REPEAT, lookup_wrapped
from tiscene.scene.lights.light_kinds import CYLINDER, DISK, SPHERE
from tiscene.scene.lights.light_table import CONE_COSINE, CONE_EDGE, FOCUS, FOCUS_TINT, KIND, PROFILE, SHAPED


@ti.func
def in_cone(values: Template, row: ti.i32, cosine: ti.f32) -> ti.f32:
    """Return 1 inside the cone, 0 outside, a smoothstep at its edge; cosine: of the angle with the light's -z."""
    result = 1.0
    if cosine < values[row, CONE_EDGE + 2]:
        result = 0.0
        if cosine > values[row, CONE_COSINE]:
            c = ti.math.clamp(cosine, -1.0, 1.0)
            angle = warp.angle_of(vec2(c, ti.sqrt(1.0 - c * c)))
            inner, outer = values[row, CONE_EDGE], values[row, CONE_EDGE + 1]
            t = ti.math.clamp((angle - inner) / ti.max(outer - inner, 1e-6), 0.0, 1.0)
            result = 1.0 - t * t * (3.0 - 2.0 * t)
    return result


@ti.func
def normal_at(values: Template, row: ti.i32, point: vec3, direction: vec3) -> vec3:
    """Return the surface normal of the light at a point of it; of a point light, `direction`."""
    kind = ti.cast(values[row, KIND], ti.i32)
    result = direction
    if kind <= DISK:
        result = -1.0 * axis(values, row, 2)
    elif kind == SPHERE:
        result = (point - axis(values, row, 3)).normalized()
    elif kind == CYLINDER:
        result = cylinder.normal_at(values, row, point)
    for k in ti.static(range(BUILT_IN_KERNELS, len(LIGHT_KERNELS))):
        if ti.static(LIGHT_KERNELS[k].has("normal_at")):
            if kind == LIGHT_KERNELS[k].kind:
                result = LIGHT_KERNELS[k].normal_at(values, row, point)
    return result


@ti.func
def scale(values: Template, textures: Template, row: ti.i32, point: vec3, direction: vec3) -> vec3:
    """Return the factor of the radiance that a point of the light emits in a direction."""
    result = vec3(1.0)
    if values[row, SHAPED] > 0.0:
        result *= in_cone(values, row, -direction.dot(axis(values, row, 2)))
        focus = values[row, FOCUS]
        if focus > 0.0:
            tint = read3(values, row, FOCUS_TINT)
            cosine = ti.min(ti.abs(direction.dot(normal_at(values, row, point, direction))), 1.0)
            result *= tint + (1.0 - tint) * ti.pow(ti.max(cosine, 1e-6), focus)
        profile = ti.cast(values[row, PROFILE], ti.i32)
        if profile >= 0:
            w = to_light(values, row, direction)
            sine = ti.sqrt(w.x * w.x + w.y * w.y)
            azimuth = warp.angle_of(vec2(w.x, w.y) / ti.max(sine, 1e-20))
            polar = warp.angle_of(vec2(-w.z, sine))
            uv = vec2(azimuth * (0.5 / math.pi), 1.0 - polar / math.pi)
            result *= lookup_wrapped(textures, profile, uv, REPEAT, CLAMP).xyz
    return result
