# SPDX-License-Identifier: Apache-2.0
"""Surface interactions: position, normals, texture coordinates and derivatives at a hit.

Positions are interpolated from the triangle's vertices instead of origin + t * direction: the error does not grow with
the distance, and the object point is the same at every time.
"""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, Template, vec2, vec3, vec4
from tiscene.scene.instance_upload import (
    HAS_COLORS,
    HAS_NORMALS,
    HAS_UV,
    INFO_COLOR,
    INFO_COLORS,
    INFO_FLAGS,
    INFO_MOVED,
    OWN_COLOR,
    OWN_OPACITY,
)
from tiscene.scene.placement import CURRENT

# Offset of a new ray's origin along the normal, relative to the surface's `magnitude`: about 80 float32 steps.
OFFSET = 1e-5


class Geometry(NamedTuple):
    """The arrays of a DeviceScene that `surface_at` reads; a parameter of kernels, see `argument_bundles`."""

    vertex_position: Floats2
    vertex_normal: Floats2
    vertex_uv: Floats2
    triangle_vertices: Ints2
    triangle_material: Ints1
    instance_info: Ints2
    world_from_instance: Floats3
    instance_from_world: Floats3


def geometry_of(scene: Any, time: int = CURRENT) -> Geometry:
    """Return the arrays of a scene in the order of kernels' parameters: ``kernel(*geometry_of(scene), ...)``.

    Args:
        scene: The DeviceScene.
        time: Of the colors of instances.
    """
    arrays = Geometry(*(getattr(scene, name) for name in Geometry._fields))
    return arrays._replace(instance_info=scene.instances_at(time))


@ti.dataclass
class VisibleSurface:
    """A point of a surface, in world space unless noted. Normals are unit and face the viewer."""

    position: vec3
    object_point: vec3  # in object space
    geometric_normal: vec3  # of the triangle, on the ray's side
    normal: vec3  # shading normal, interpolated, on the same side
    uv: vec2  # 0 if the mesh has none
    second_uv: vec2  # 0 if the mesh has none
    color: vec4  # of the instance, else of the vertices, with opacity; 0 if there are none
    dp_du: vec3  # partial derivatives of the position; neither unit nor of equal length
    dp_dv: vec3
    magnitude: ti.f32  # m, largest absolute coordinate or side of the triangle; rounding errors are in proportion
    material: ti.i32
    front: ti.i32  # 1: the triangle's vertices are counter-clockwise seen from the ray's origin


@ti.func
def load_vec3(array: Template, row: ti.i32) -> vec3:
    """Return the first three columns of a row."""
    return vec3(array[row, 0], array[row, 1], array[row, 2])


@ti.func
def transform_point(matrices: Template, time: ti.i32, row: ti.i32, p: vec3) -> vec3:
    """Transform a point by the 3x4 matrix [time, row] of an array [3, n, 12]."""
    return vec3(
        matrices[time, row, 0] * p.x + matrices[time, row, 1] * p.y + matrices[time, row, 2] * p.z
        + matrices[time, row, 3],
        matrices[time, row, 4] * p.x + matrices[time, row, 5] * p.y + matrices[time, row, 6] * p.z
        + matrices[time, row, 7],
        matrices[time, row, 8] * p.x + matrices[time, row, 9] * p.y + matrices[time, row, 10] * p.z
        + matrices[time, row, 11],
    )  # fmt: skip


@ti.func
def transform_vector(matrices: Template, time: ti.i32, row: ti.i32, v: vec3) -> vec3:
    """Transform a vector by the 3x3 part of the matrix [time, row]."""
    return vec3(
        matrices[time, row, 0] * v.x + matrices[time, row, 1] * v.y + matrices[time, row, 2] * v.z,
        matrices[time, row, 4] * v.x + matrices[time, row, 5] * v.y + matrices[time, row, 6] * v.z,
        matrices[time, row, 8] * v.x + matrices[time, row, 9] * v.y + matrices[time, row, 10] * v.z,
    )


@ti.func
def transform_normal(inverses: Template, time: ti.i32, row: ti.i32, n: vec3) -> vec3:
    """Transform a normal by the transpose of the inverse [time, row]; mirroring keeps it outward. Not normalized."""
    return vec3(
        inverses[time, row, 0] * n.x + inverses[time, row, 4] * n.y + inverses[time, row, 8] * n.z,
        inverses[time, row, 1] * n.x + inverses[time, row, 5] * n.y + inverses[time, row, 9] * n.z,
        inverses[time, row, 2] * n.x + inverses[time, row, 6] * n.y + inverses[time, row, 10] * n.z,
    )


@ti.func
def normalized_or(v: vec3, otherwise: vec3) -> vec3:
    """Return v normalized, or the other vector if v is zero."""
    length = v.norm()
    result = otherwise
    if length > 0.0:
        result = v / length
    return result


@ti.func
def vertex_offset(instance_info: Template, instance: ti.i32, time: ti.i32) -> ti.i32:
    """Return the offset from rows in `triangle_vertices` to a deforming mesh's vertices at a time; 0 for others."""
    return (time + 2) % 3 * instance_info[instance, INFO_MOVED]


@ti.func
def object_point_at(
    vertex_position: Template,
    triangle_vertices: Template,
    triangle: ti.i32,
    b1: ti.f32,
    b2: ti.f32,
    offset: ti.i32,
) -> vec3:
    """Return the point (1-b1-b2, b1, b2) of a triangle in object space. offset: of `vertex_offset`."""
    v0 = load_vec3(vertex_position, triangle_vertices[triangle, 0] + offset)
    e1 = load_vec3(vertex_position, triangle_vertices[triangle, 1] + offset) - v0
    e2 = load_vec3(vertex_position, triangle_vertices[triangle, 2] + offset) - v0
    return v0 + b1 * e1 + b2 * e2


@ti.func
def surface_at(
    geometry: Template, instance: ti.i32, triangle: ti.i32, b1: ti.f32, b2: ti.f32, time: ti.i32, direction: vec3
):
    """Return the VisibleSurface at a hit.

    Args:
        geometry: Geometry.
        instance: Row of the instance.
        triangle: Row of the triangle.
        b1: Barycentric coordinate of vertex 1.
        b2: Barycentric coordinate of vertex 2.
        time: PREVIOUS, CURRENT or NEXT.
        direction: Of the ray.
    """
    offset = vertex_offset(geometry.instance_info, instance, time)
    i0 = geometry.triangle_vertices[triangle, 0] + offset
    i1 = geometry.triangle_vertices[triangle, 1] + offset
    i2 = geometry.triangle_vertices[triangle, 2] + offset
    b0 = 1.0 - b1 - b2
    v0 = load_vec3(geometry.vertex_position, i0)
    e1 = load_vec3(geometry.vertex_position, i1) - v0
    e2 = load_vec3(geometry.vertex_position, i2) - v0
    object_point = v0 + b1 * e1 + b2 * e2

    # Outward by the vertices' order first, to put the shading normal on the same side before both are flipped.
    outward = normalized_or(
        transform_normal(geometry.instance_from_world, time, instance, e1.cross(e2)), -1.0 * direction
    )
    normal = outward
    flags = geometry.instance_info[instance, INFO_FLAGS]
    if flags & HAS_NORMALS:
        interpolated = (
            b0 * load_vec3(geometry.vertex_normal, i0)
            + b1 * load_vec3(geometry.vertex_normal, i1)
            + b2 * load_vec3(geometry.vertex_normal, i2)
        )
        normal = normalized_or(transform_normal(geometry.instance_from_world, time, instance, interpolated), outward)
        if normal.dot(outward) < 0.0:
            normal = -1.0 * normal
    front = 1
    geometric_normal = outward
    if outward.dot(direction) > 0.0:
        front = 0
        geometric_normal = -1.0 * outward
        normal = -1.0 * normal

    uv0, uv1, uv2 = vec2(0.0, 0.0), vec2(0.0, 0.0), vec2(0.0, 0.0)
    if flags & HAS_UV:
        uv0 = vec2(geometry.vertex_uv[i0, 0], geometry.vertex_uv[i0, 1])
        uv1 = vec2(geometry.vertex_uv[i1, 0], geometry.vertex_uv[i1, 1])
        uv2 = vec2(geometry.vertex_uv[i2, 0], geometry.vertex_uv[i2, 1])
    uv = b0 * uv0 + b1 * uv1 + b2 * uv2
    second_uv, color = vec2(0.0), vec4(0.0)
    if flags & HAS_COLORS:
        first = geometry.instance_info[instance, INFO_COLORS] - 3 * offset
        for corner in ti.static(range(3)):
            row = first + 3 * ti.Vector([i0, i1, i2])[corner]
            weight = ti.Vector([b0, b1, b2])[corner]
            for c in ti.static(range(2)):
                second_uv[c] += weight * geometry.vertex_uv[row, c]
                color[c] += weight * geometry.vertex_uv[row + 1, c]
                color[2 + c] += weight * geometry.vertex_uv[row + 2, c]
    for c in ti.static(range(4)):
        if flags & ti.static(OWN_COLOR if c < 3 else OWN_OPACITY):
            color[c] = ti.bit_cast(geometry.instance_info[instance, INFO_COLOR + c], ti.f32)
    duv1, duv2 = uv1 - uv0, uv2 - uv0
    determinant = duv1.x * duv2.y - duv1.y * duv2.x
    dp_du, dp_dv = e1, e2  # without a uv map, or with a degenerate one, any two directions in the plane
    if ti.abs(determinant) > 1e-20:
        dp_du = (duv2.y * e1 - duv1.y * e2) / determinant
        dp_dv = (duv1.x * e2 - duv2.x * e1) / determinant

    position = transform_point(geometry.world_from_instance, time, instance, object_point)
    side1 = transform_vector(geometry.world_from_instance, time, instance, e1)
    side2 = transform_vector(geometry.world_from_instance, time, instance, e2)
    sides = ti.max(ti.max(side1, -1.0 * side1), ti.max(side2, -1.0 * side2))
    return VisibleSurface(
        position=position,
        object_point=object_point,
        geometric_normal=geometric_normal,
        normal=normal,
        uv=uv,
        second_uv=second_uv,
        color=color,
        dp_du=transform_vector(geometry.world_from_instance, time, instance, dp_du),
        dp_dv=transform_vector(geometry.world_from_instance, time, instance, dp_dv),
        magnitude=ti.max(ti.max(position, -1.0 * position), sides).max(),
        material=geometry.triangle_material[triangle],
        front=front,
    )


@ti.func
def offset_origin(surface: Template, direction: vec3) -> vec3:
    """Return the origin of a ray that leaves a surface, offset so that it does not hit the surface again."""
    side = 1.0
    if surface.geometric_normal.dot(direction) < 0.0:
        side = -1.0
    return surface.position + surface.geometric_normal * (side * OFFSET * ti.max(surface.magnitude, 0.1))
