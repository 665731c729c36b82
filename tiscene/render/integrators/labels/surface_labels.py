# SPDX-License-Identifier: Apache-2.0
"""The kernel that writes the label buffers of surfaces: geometry, identity, motion and materials at each pixel's hit.

Material buffers see through mirrors: where a material is mirror-like, its ray is reflected and traced again. One loop
iteration is one pixel of a queue; no sums over pixels.
"""

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, Template, vec2, vec3
from tiscene.render.bsdfs.material_inputs import (
    Footprint,
    Materials,
    footprint_at,
    is_mirror_like,
    material_at,
    shading_normal,
)
from tiscene.render.integrators.labels.label_kernels import (
    DISPLACEMENT,
    FOCAL_LENGTH,
    ORTHOGRAPHIC,
    SHEAR,
    affine,
    camera_point,
    deformed_point,
    first_camera,
    from_principal_point,
    row_in_frame,
)
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, ray_direction, write_ray
from tiscene.render.intersect.surface_interaction import (
    Geometry,
    object_point_at,
    offset_origin,
    surface_at,
    transform_vector,
)
from tiscene.render.texture_lookup import Textures
from tiscene.render.view import FORWARD, HALF_HEIGHT, RIGHT, TANGENT, UP, view_vector
from tiscene.scene.instance_upload import INFO_CATEGORY_ID, INFO_INSTANCE_ID, INFO_MOVED, INFO_PART
from tiscene.scene.material_table import DIFFUSE, EMISSIVE, FLAGS, MAY_MIRROR, METALLIC, NORMAL, ROUGHNESS, SPECULAR
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

# The buffers that `surface_labels` writes, in the order of its arguments. A buffer's index in `wanted` is OF_<NAME>.
FILTERED_ALBEDO = "filtered_albedo"  # as of a PathImage, mean over the pixel: guides upsampling, and is not a label
MATERIAL_BUFFERS = ("albedo", "roughness", "metallic", FILTERED_ALBEDO)  # of the first surface that is no mirror
SURFACE_BUFFERS = (
    "depth",
    "distance",
    "position",
    "normal",
    "geometric_normal",
    "normal_camera",
    "semantic",
    "instance",
    "part",
    "forward_flow",
    "backward_flow",
    "scene_flow",
    "uv",
    "object_coordinates",
    *MATERIAL_BUFFERS,
)
OF_DEPTH, OF_DISTANCE, OF_POSITION, OF_NORMAL, OF_GEOMETRIC_NORMAL, OF_NORMAL_CAMERA = range(6)
OF_SEMANTIC, OF_INSTANCE, OF_PART, OF_FORWARD_FLOW, OF_BACKWARD_FLOW, OF_SCENE_FLOW = range(6, 12)
OF_UV, OF_OBJECT_COORDINATES, OF_ALBEDO, OF_ROUGHNESS, OF_METALLIC, OF_FILTERED_ALBEDO = range(12, 18)

# Material inputs that decide whether a surface is mirror-like, and where it reflects.
_MIRROR_INPUTS = 1 << ROUGHNESS | 1 << METALLIC | 1 << SPECULAR | 1 << NORMAL


@ti.func
def write2(array: Template, y: ti.i32, x: ti.i32, value: vec2):
    """Write a pixel of a two-channel buffer."""
    for c in ti.static(range(2)):
        array[y, x, c] = value[c]


@ti.func
def write3(array: Template, y: ti.i32, x: ti.i32, value: vec3):
    """Write a pixel of a three-channel buffer."""
    for c in ti.static(range(3)):
        array[y, x, c] = value[c]


@ti.func
def reflection(surface: Template, point: Template, direction: vec3) -> vec3:
    """Reflect a ray by the shading normal, or by the geometric normal if it would go below the surface."""
    n = shading_normal(surface, point, -direction)
    reflected = direction - 2.0 * direction.dot(n) * n
    if reflected.dot(surface.geometric_normal) <= 0.0:
        n = surface.geometric_normal
        reflected = direction - 2.0 * direction.dot(n) * n
    return reflected.normalized()


@ti.func
def image_motion(
    moment: Template, row: ti.i32, triangle: ti.i32, b1: ti.f32, b2: ti.f32, object_point: vec3, towards: vec3,
    image_point: vec2, geometry: Template, instance_motion: Template, camera_motion: Template, first: ti.i32,
) -> vec2:  # fmt: skip
    """Return where a surface point, now at `image_point`, is at another moment, PREVIOUS or NEXT, from there, px."""
    moved_point = deformed_point(geometry, row, triangle, b1, b2, object_point, moment)
    there = camera_point(moment, row, moved_point, towards, instance_motion, camera_motion, first)
    return from_principal_point(there, camera_motion, first + moment) - image_point


@ti.func
def material_values(
    materials: Template, textures: Template, surface: Template, direction: vec3, footprint_width: ti.f32,
    wanted: Template, follow: ti.i32,
):  # fmt: skip
    """Return albedo, roughness, metallic, filtered albedo, whether the surface is mirror-like, and its reflection."""
    color, rough, metal, filtered_color = vec3(0.0), 0.0, 0.0, vec3(0.0)
    unfiltered = wanted[OF_ALBEDO] | wanted[OF_ROUGHNESS] | wanted[OF_METALLIC]
    inputs = wanted[OF_ALBEDO] << DIFFUSE | wanted[OF_ROUGHNESS] << ROUGHNESS | wanted[OF_METALLIC] << METALLIC
    may_mirror = follow != 0 and (materials.info[surface.material, FLAGS] & MAY_MIRROR) != 0
    if may_mirror:
        inputs |= _MIRROR_INPUTS
    is_mirror, reflected = False, vec3(0.0)
    for filtered in range(2):  # not unrolled: texture lookups compile slowly
        is_needed, reads, footprint = unfiltered != 0 or may_mirror, inputs, Footprint()
        if filtered == 1:
            is_needed = wanted[OF_FILTERED_ALBEDO] != 0 and not is_mirror
            reads = 1 << DIFFUSE | 1 << EMISSIVE
            footprint = footprint_at(surface, direction, footprint_width, ti.u32(0))
        if is_needed:
            material = material_at(materials, textures, surface, reads, footprint)
            if filtered == 1:
                filtered_color = ti.min(material.diffuse_color + material.emissive_color, 1.0)
            else:
                color, rough, metal = material.diffuse_color, material.roughness, material.metallic
                is_mirror = may_mirror and is_mirror_like(material) != 0
                if is_mirror:
                    reflected = reflection(surface, material, direction)
    return color, rough, metal, filtered_color, is_mirror, reflected


@ti.kernel
@bundled
def surface_labels(
    queue: Ints1,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    box_from_instance: Floats2,
    triangle_part: Ints1,
    instance_motion: Floats2,
    camera_motion: Floats2,
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    follow: ti.i32,
    mirrored: Ints1,
    mirrored_count: Ints1,
    wanted: Ints1,
    depth: Floats2,
    distance: Floats2,
    position: Floats3,
    normal: Floats3,
    geometric_normal: Floats3,
    normal_camera: Floats3,
    semantic: Ints2,
    instance: Ints2,
    part: Ints2,
    forward_flow: Floats3,
    backward_flow: Floats3,
    scene_flow: Floats3,
    uv: Floats3,
    object_coordinates: Floats3,
    albedo: Floats3,
    roughness: Floats2,
    metallic: Floats2,
    filtered_albedo: Floats3,
    stacked: Template,
) -> ti.i32:
    """Write the label buffers at the hits of the rays in the queue.

    The arguments from `depth` to `filtered_albedo` are the buffers, in the order of SURFACE_BUFFERS, of one pixel where
    not wanted.

    Args:
        instance_motion, camera_motion: See the functions of these names in `label_pass`.
        follow: 1: where a material buffer is wanted and the surface is mirror-like, nothing is written to it and the
            ray is replaced by its reflection and appended to `mirrored`.
        mirrored_count: Scratch, i32 [1].
        wanted: i32 [len(SURFACE_BUFFERS)], 1 for the buffers to write.
        stacked: See `label_kernels.first_camera`.

    Returns:
        The number of reflected rays.
    """
    mirrored_count[0] = 0
    for i in range(count):
        pixel = queue[i]
        x, y = pixel % width, pixel // width
        row = hit_ids[pixel][0]
        first = first_camera(y, height, stacked)
        focal = camera_motion[first + CURRENT, FOCAL_LENGTH]
        # The background of an orthographic camera has no direction per pixel: it only turns with the image.
        ahead = 1.0 - camera_motion[first + CURRENT, ORTHOGRAPHIC]
        down = row_in_frame(y, height, stacked)
        towards = vec3((x - 0.5 * (width - 1)) / focal, (down - 0.5 * (height - 1)) / focal, ahead)
        triangle, b1, b2 = hit_ids[pixel][1], hits[pixel][1], hits[pixel][2]
        object_point = vec3(0.0)
        if row >= 0:
            object_point = object_point_at(geometry.vertex_position, geometry.triangle_vertices, triangle, b1, b2, 0)
        camera_space = camera_point(CURRENT, row, object_point, towards, instance_motion, camera_motion, first)
        image_point = from_principal_point(camera_space, camera_motion, first + CURRENT)

        if wanted[OF_DEPTH]:
            depth[y, x] = camera_space.z if row >= 0 else ti.math.inf
        if wanted[OF_DISTANCE]:
            length = camera_space.z
            if ahead > 0.0:
                shear = vec2(camera_motion[first + CURRENT, SHEAR], camera_motion[first + CURRENT, SHEAR + 1])
                length = vec3(camera_space.xy + shear * camera_space.z, camera_space.z).norm()
            distance[y, x] = length if row >= 0 else ti.math.inf
        if wanted[OF_SEMANTIC]:
            semantic[y, x] = geometry.instance_info[row, INFO_CATEGORY_ID] if row >= 0 else 0
        if wanted[OF_INSTANCE]:
            instance[y, x] = geometry.instance_info[row, INFO_INSTANCE_ID] if row >= 0 else 0
        if wanted[OF_PART]:
            part[y, x] = 1 + geometry.instance_info[row, INFO_PART] + triangle_part[triangle] if row >= 0 else 0
        if wanted[OF_FORWARD_FLOW]:
            write2(forward_flow, y, x, image_motion(
                NEXT, row, triangle, b1, b2, object_point, towards, image_point, geometry, instance_motion,
                camera_motion, first,
            ))  # fmt: skip
        if wanted[OF_BACKWARD_FLOW]:
            write2(backward_flow, y, x, image_motion(
                PREVIOUS, row, triangle, b1, b2, object_point, towards, image_point, geometry, instance_motion,
                camera_motion, first,
            ))  # fmt: skip
        if wanted[OF_SCENE_FLOW]:
            displacement = vec3(0.0)
            if row >= 0:
                moved_point = deformed_point(geometry, row, triangle, b1, b2, object_point, NEXT)
                displacement = affine(instance_motion, row, DISPLACEMENT, moved_point)
                if geometry.instance_info[row, INFO_MOVED] > 0:
                    displacement += transform_vector(
                        geometry.world_from_instance, CURRENT, row, moved_point - object_point
                    )
            write3(scene_flow, y, x, displacement)
        if wanted[OF_OBJECT_COORDINATES]:
            coordinates = vec3(0.0)
            if row >= 0:
                coordinates = ti.math.clamp(affine(box_from_instance, row, 0, object_point), 0.0, 1.0)
            write3(object_coordinates, y, x, coordinates)

        any_material = wanted[OF_ALBEDO] | wanted[OF_ROUGHNESS] | wanted[OF_METALLIC] | wanted[OF_FILTERED_ALBEDO]
        any_normal = wanted[OF_NORMAL] | wanted[OF_GEOMETRIC_NORMAL] | wanted[OF_NORMAL_CAMERA]
        if wanted[OF_POSITION] | any_normal | wanted[OF_UV] | any_material:
            point = vec3(ti.math.nan)
            shading, geometric = vec3(0.0), vec3(0.0)
            texture = vec2(0.0)
            color, rough, metal, filtered_color = vec3(0.0), 0.0, 0.0, vec3(0.0)
            is_mirror, reflected = False, vec3(0.0)
            if row >= 0:
                direction = ray_direction(rays, pixel)
                surface = surface_at(geometry, row, triangle, b1, b2, CURRENT, direction)
                point, texture = surface.position, surface.uv
                shading, geometric = surface.normal, surface.geometric_normal
                if any_material:
                    footprint_width = (
                        2.0 * (view[first + CURRENT, TANGENT] + view[first + CURRENT, HALF_HEIGHT]) / height
                    )
                    if ahead > 0.0:
                        footprint_width *= hits[pixel][0]
                    color, rough, metal, filtered_color, is_mirror, reflected = material_values(
                        materials, textures, surface, direction, footprint_width, wanted, follow
                    )
                    if is_mirror:
                        write_ray(rays, pixel, offset_origin(surface, reflected), reflected, ti.math.inf)
                        mirrored[ti.atomic_add(mirrored_count[0], 1)] = pixel
            if wanted[OF_POSITION]:
                write3(position, y, x, point)
            if wanted[OF_NORMAL]:
                write3(normal, y, x, shading)
            if wanted[OF_GEOMETRIC_NORMAL]:
                write3(geometric_normal, y, x, geometric)
            if wanted[OF_NORMAL_CAMERA]:
                camera = first + CURRENT
                right, up = view_vector(view, camera, RIGHT), view_vector(view, camera, UP)
                forward = view_vector(view, camera, FORWARD)
                write3(normal_camera, y, x, vec3(shading.dot(right), -shading.dot(up), shading.dot(forward)))
            if wanted[OF_UV]:
                write2(uv, y, x, texture)
            if not is_mirror:
                if wanted[OF_ALBEDO]:
                    write3(albedo, y, x, color)
                if wanted[OF_ROUGHNESS]:
                    roughness[y, x] = rough
                if wanted[OF_METALLIC]:
                    metallic[y, x] = metal
                if wanted[OF_FILTERED_ALBEDO]:
                    write3(filtered_albedo, y, x, filtered_color)
    return mirrored_count[0]
