# SPDX-License-Identifier: Apache-2.0
"""A mesh that gives light: an instance in which triangles emit, on both sides. First a triangle is chosen by about what
it gives at the point, then a point of it, uniformly. Rays meet it as they meet any surface.

It needs Lights with `geometry` and `materials`; kernels without them sample no meshes.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.bsdfs.material_inputs import Footprint, material_at
from tiscene.render.intersect.surface_interaction import moved_by, row3, surface_at, transform_vector
from tiscene.render.lights.light_sample import header, integer, light_row, no_sample
from tiscene.render.lights.light_sampler import conditional_probability, to_mesh_space
from tiscene.scene.lights.light_table import DISTRIBUTION, FIRST_TRIANGLE, INSTANCE
from tiscene.scene.lights.light_tree import H_END, H_ROWS
from tiscene.scene.material_table import COVERAGE, EMISSIVE, OPACITY
from tiscene.scene.placement import CURRENT


@ti.func
def row_of(lights: Template, instance: ti.i32) -> ti.i32:
    """The row of the light that an instance is, -1 for none."""
    low, high = header(lights.nodes, H_ROWS), header(lights.nodes, H_END)
    while high - low > 1:
        middle = (low + high) // 2
        if integer(lights.values, middle, INSTANCE) <= instance:
            low = middle
        else:
            high = middle
    return low if high > low and integer(lights.values, low, INSTANCE) == instance else -1


@ti.func
def doubled_area(lights: Template, instance: ti.i32, triangle: ti.i32) -> vec3:
    """The normal of a triangle in the world, as long as twice its area."""
    geometry = ti.static(lights.geometry)
    moved = moved_by(geometry.instance_info, instance, CURRENT)
    v0 = row3(geometry.vertex_position, geometry.triangle_vertices[triangle, 0] + moved)
    e1 = row3(geometry.vertex_position, geometry.triangle_vertices[triangle, 1] + moved) - v0
    e2 = row3(geometry.vertex_position, geometry.triangle_vertices[triangle, 2] + moved) - v0
    a = transform_vector(geometry.world_from_instance, CURRENT, instance, e1)
    return a.cross(transform_vector(geometry.world_from_instance, CURRENT, instance, e2))


@ti.func
def emission_at(materials: Template, textures: Template, surface: Template) -> vec3:
    """What a point of a surface emits, times how much of it is there."""
    point = material_at(materials, textures, surface, 1 << EMISSIVE | 1 << OPACITY, Footprint())
    there = point.opacity if point.flags & COVERAGE else 1.0
    return point.emissive_color * there


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, place: ti.i32, origin: vec3, u: vec2):
    """A direction from `origin` to a triangle of the light, by its place: a LightSample."""
    result = no_sample()
    instance = integer(lights.values, row, INSTANCE)
    triangle = light_row(lights.nodes, place)
    root = ti.sqrt(u.x)
    surface = surface_at(
        lights.geometry, instance, triangle, root * (1.0 - u.y), root * u.y, CURRENT, vec3(0.0, 0.0, 1.0)
    )
    offset = surface.position - origin
    distance2 = offset.dot(offset)
    facing = ti.abs(doubled_area(lights, instance, triangle).dot(offset))
    if facing > 0.0 and distance2 > 0.0:
        result.distance = ti.sqrt(distance2)
        result.direction = offset / result.distance
        result.pdf = 2.0 * distance2 * result.distance / facing
        result.radiance = emission_at(lights.materials, textures, surface)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, triangle: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Density of `sample` for a direction that meets a triangle of the light at that distance."""
    at = integer(lights.values, row, DISTRIBUTION) + triangle - integer(lights.values, row, FIRST_TRIANGLE)
    place = ti.cast(lights.distribution[at], ti.i32)
    result = 0.0
    if place > 0:
        _, chance = conditional_probability(lights, place, to_mesh_space(lights, row, origin))
        facing = ti.abs(doubled_area(lights, integer(lights.values, row, INSTANCE), triangle).dot(direction))
        result = chance * 2.0 * distance * distance / ti.max(facing, 1e-20)
    return result
