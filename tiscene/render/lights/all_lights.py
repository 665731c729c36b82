"""The kinds of light as one: sampling a light, meeting it. A new kind is a file and a name in LIGHTS."""

import taichi as ti

from tiscene.render.lights import cylinder, disk, distant, dome, point, rect, shaping, sphere
from tiscene.render.lights.choice import chance_of
from tiscene.render.lights.light_sample import no_sample
from tiscene.scene.light_table import KIND, SHAPED

vec2 = ti.math.vec2
vec3 = ti.math.vec3

# In the order of the kinds in tiscene.scene.light_table. Each has sample, pdf, intersect, emitted.
LIGHTS = (rect, disk, sphere, cylinder, point, distant, dome)


@ti.func
def sample(lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, u: vec2):
    """A direction to the light of that row: a LightSample. The chance of the row is not in its pdf."""
    result = no_sample()
    kind = ti.cast(lights.values[row, KIND], ti.i32)
    for k in ti.static(range(len(LIGHTS))):
        if kind == k:
            result = LIGHTS[k].sample(lights, textures, row, origin, u)
    if lights.values[row, SHAPED] > 0.0 and result.pdf > 0.0:
        met = origin + result.direction * result.distance
        result.radiance *= shaping.scale(lights.values, textures, row, met, -result.direction)
    return result


@ti.func
def pdf(lights: ti.template(), row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Density of choosing the row and of its `sample`, for a direction that meets it."""
    result = 0.0
    kind = ti.cast(lights.values[row, KIND], ti.i32)
    for k in ti.static(range(len(LIGHTS))):
        if kind == k:
            result = LIGHTS[k].pdf(lights, row, origin, direction, distance)
    if result > 0.0:
        result *= chance_of(lights, row, origin)
    return result


@ti.func
def intersect(lights: ti.template(), row: ti.i32, origin: vec3, direction: vec3) -> ti.f32:
    """Distance to the light of that row, +inf for a miss."""
    result = ti.math.inf
    kind = ti.cast(lights.values[row, KIND], ti.i32)
    for k in ti.static(range(len(LIGHTS))):
        if kind == k:
            result = LIGHTS[k].intersect(lights, row, origin, direction)
    return result


@ti.func
def emitted(
    lights: ti.template(), textures: ti.template(), row: ti.i32, origin: vec3, direction: vec3, distance: ti.f32
) -> vec3:
    """Radiance from the light of that row along a ray that meets it."""
    result = vec3(0.0)
    kind = ti.cast(lights.values[row, KIND], ti.i32)
    for k in ti.static(range(len(LIGHTS))):
        if kind == k:
            result = LIGHTS[k].emitted(lights, textures, row, origin, direction, distance)
    if lights.values[row, SHAPED] > 0.0:
        result *= shaping.scale(lights.values, textures, row, origin + direction * distance, -direction)
    return result
