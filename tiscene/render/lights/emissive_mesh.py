# SPDX-License-Identifier: Apache-2.0
"""Emissive meshes: instances with triangles that emit on both sides.

A triangle is chosen by its estimated contribution, then a point on it, uniformly in area. Rays hit the triangles as
surfaces of the scene. Needs LightTables with `geometry` and `materials`; kernels without them sample no meshes.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.bsdfs.material_inputs import Footprint, material_at
from tiscene.render.intersect.surface_interaction import OFFSET, load_vec3, surface_at, transform_vector, vertex_offset
from tiscene.render.lights.light_sample import header, integer, light_row, no_sample
from tiscene.render.lights.light_sampler import conditional_probability, to_mesh_space
from tiscene.scene.instance_upload import INFO_FIRST_TRIANGLE
from tiscene.scene.lights.light_table import DISTRIBUTION, INSTANCE
from tiscene.scene.lights.light_tree import H_END, H_ROWS
from tiscene.scene.material_table import COVERAGE, EMISSIVE, OPACITY
from tiscene.scene.placement import CURRENT


@ti.func
def row_of(lights: Template, instance: ti.i32) -> ti.i32:
    """Return the light-table row of an instance, -1 if it does not emit."""
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
    """Return the normal of a triangle in world space, with a length of twice its area."""
    geometry = ti.static(lights.geometry)
    moved = vertex_offset(geometry.instance_info, instance, CURRENT)
    v0 = load_vec3(geometry.vertex_position, geometry.triangle_vertices[triangle, 0] + moved)
    e1 = load_vec3(geometry.vertex_position, geometry.triangle_vertices[triangle, 1] + moved) - v0
    e2 = load_vec3(geometry.vertex_position, geometry.triangle_vertices[triangle, 2] + moved) - v0
    a = transform_vector(geometry.world_from_instance, CURRENT, instance, e1)
    return a.cross(transform_vector(geometry.world_from_instance, CURRENT, instance, e2))


@ti.func
def emission_at(materials: Template, textures: Template, surface: Template) -> vec3:
    """Return the emission of a surface point, times its presence (opacity of opacityMode presence)."""
    point = material_at(materials, textures, surface, 1 << EMISSIVE | 1 << OPACITY, Footprint())
    presence = point.opacity if point.flags & COVERAGE else 1.0
    return point.emissive_color * presence


@ti.func
def sample(lights: Template, textures: Template, row: ti.i32, slot: ti.i32, origin: vec3, u: vec2):
    """Sample a direction from `origin` to the triangle in a slot; returns a LightSample."""
    result = no_sample()
    instance = integer(lights.values, row, INSTANCE)
    triangle = light_row(lights.nodes, slot) + lights.geometry.instance_info[instance, INFO_FIRST_TRIANGLE]
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
        # The height of a hit above the triangle is rounded by the coordinates of both ends of the ray.
        magnitude = ti.max(surface.magnitude, ti.max(origin, -1.0 * origin).max())
        result.height = surface.geometric_normal * (OFFSET * magnitude)
        result.radiance = emission_at(lights.materials, textures, surface)
    return result


@ti.func
def pdf(lights: Template, row: ti.i32, triangle: ti.i32, origin: vec3, direction: vec3, distance: ti.f32) -> ti.f32:
    """Return the density of `sample`, 1/sr, for a ray that hits a triangle of the light at that distance."""
    instance = integer(lights.values, row, INSTANCE)
    number = triangle - lights.geometry.instance_info[instance, INFO_FIRST_TRIANGLE]
    slot = ti.cast(lights.distribution[integer(lights.values, row, DISTRIBUTION) + number], ti.i32)
    result = 0.0
    if slot > 0:
        _, probability = conditional_probability(lights, slot, to_mesh_space(lights, row, origin))
        facing = ti.abs(doubled_area(lights, instance, triangle).dot(direction))
        result = probability * 2.0 * distance * distance / ti.max(facing, 1e-20)
    return result
