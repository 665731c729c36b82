"""Material labels: base colour, roughness and metalness of the first surface that is not a mirror."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.render.aovs import AOVS
from tiscene.render.bsdfs.inputs import Materials, is_mirror_like, material_at, shading_normal
from tiscene.render.integrators.label_hits import first_hits
from tiscene.render.integrators.label_kernels import write3
from tiscene.render.ray_arrays import HitIds, Hits, RayArrays, Rays, ray_direction, write_ray
from tiscene.render.surface import (
    FLOATS_1D,
    FLOATS_2D,
    FLOATS_3D,
    INTS_1D,
    INTS_2D,
    Geometry,
    geometry_of,
    offset_origin,
    surface_at,
    vec3,
)
from tiscene.render.textures import Textures
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.material_table import GLASS
from tiscene.scene.placement import CURRENT

MATERIAL_BUFFERS = ("albedo", "roughness", "metallic")
MAX_MIRRORS = 4  # a mirror behind so many others is labelled as itself


class MaterialLabels:
    """The part of the label pass that reads materials. Mirrors are followed by further, still unrandom, rays."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene

    def render(
        self, rays: RayArrays, queue: Any, count: int, width: int, arrays: dict[str, NDArray[Any]]
    ) -> NDArray[np.int32]:
        """Fill the material buffers among `arrays`; return the pixels that show a mirror.

        rays: what the primary rays of the queue met; overwritten.
        """
        outputs = [arrays.get(name, AOVS[name].empty(1, 1)) for name in MATERIAL_BUFFERS]
        wanted = np.array([name in arrays for name in MATERIAL_BUFFERS], np.int32)
        shown = np.zeros(0, np.int32)
        for mirrors in range(MAX_MIRRORS + 1):
            found = np.zeros(1, np.int32)
            material_labels(
                queue,
                count,
                rays.rays,
                rays.hits,
                rays.hit_ids,
                *geometry_of(self.scene),
                *self.scene.materials.arrays(),
                *self.scene.textures.arrays(),
                int(mirrors < MAX_MIRRORS),
                rays.mirrored[mirrors % 2],
                found,
                width,
                wanted,
                *outputs,
            )
            queue, count = rays.mirrored[mirrors % 2], int(found[0])
            if mirrors == 0 and count:
                shown = queue.to_numpy()[:count]
            if count == 0:
                break
            first_hits(self.scene, CURRENT, rays, queue, count)
        return shown


@ti.kernel
def material_labels(
    queue: INTS_1D,
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    vertex_position: FLOATS_2D,
    vertex_normal: FLOATS_2D,
    vertex_uv: FLOATS_2D,
    triangle_vertices: INTS_2D,
    triangle_material: INTS_1D,
    instance_info: INTS_2D,
    world_from_instance: FLOATS_3D,
    instance_from_world: FLOATS_3D,
    material_values: FLOATS_2D,
    material_info: INTS_2D,
    material_lookups: FLOATS_2D,
    texture_info: INTS_2D,
    texture_words: INTS_1D,
    texture_floats: FLOATS_1D,
    follow: ti.i32,
    mirrored: INTS_1D,
    mirrored_count: INTS_1D,
    width: ti.i32,
    wanted: INTS_1D,
    albedo: FLOATS_3D,
    roughness: FLOATS_2D,
    metallic: FLOATS_2D,
):
    """Write the material of what each ray of the queue met, or where `follow` is set and that is a mirror, turn the ray
    into its reflection and put it into the queue `mirrored`."""
    geometry = ti.static(
        Geometry(
            vertex_position,
            vertex_normal,
            vertex_uv,
            triangle_vertices,
            triangle_material,
            instance_info,
            world_from_instance,
            instance_from_world,
        )
    )
    materials = ti.static(Materials(material_values, material_info, material_lookups))
    textures = ti.static(Textures(texture_info, texture_words, texture_floats))
    for i in range(count):
        ray = queue[i]
        x, y = ray % width, ray // width
        row = hit_ids[ray][0]
        color, rough, metal = vec3(0.0), 0.0, 0.0
        mirror = False
        if row >= 0:
            direction = ray_direction(rays, ray)
            surface = surface_at(geometry, row, hit_ids[ray][1], hits[ray][1], hits[ray][2], CURRENT, direction)
            point = material_at(materials, textures, surface)
            color, rough, metal = point.diffuse_color, point.roughness, point.metallic
            mirror = follow != 0 and is_mirror_like(point) != 0 and (point.flags & GLASS) == 0
            if mirror:
                n = shading_normal(surface, point, -direction)
                reflected = direction - 2.0 * direction.dot(n) * n
                if reflected.dot(surface.geometric_normal) <= 0.0:
                    n = surface.geometric_normal
                    reflected = direction - 2.0 * direction.dot(n) * n
                reflected = reflected.normalized()
                origin = offset_origin(surface, reflected)
                write_ray(rays, ray, origin, reflected, ti.math.inf)
                mirrored[ti.atomic_add(mirrored_count[0], 1)] = ray
        if not mirror:
            if wanted[0]:
                write3(albedo, y, x, color)
            if wanted[1]:
                roughness[y, x] = rough
            if wanted[2]:
                metallic[y, x] = metal
