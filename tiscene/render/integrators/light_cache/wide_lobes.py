# SPDX-License-Identifier: Apache-2.0
"""Reflectance for uniform light: what the lobes of a material make of the light in a cell."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3
from tiscene.render.bsdfs.closure import albedo_parts, layer_reflectance, mean_albedo_parts
from tiscene.render.bsdfs.preview_surface_bsdf import closure_at, frame_of, to_frame
from tiscene.scene.material_table import MATTE

WIDE = 0.5  # roughness from which on the specular lobe is treated as if it were diffuse


@ti.func
def wide_reflectance(surface: Template, point: Template, energy: Template, normal: vec3, wo: vec3, whole: ti.i32):
    """Return (reflectance of the wide lobes for uniform light, whether these are all lobes).

    Args:
        surface: VisibleSurface.
        point: MaterialPoint.
        energy: `energy_tables`.
        normal: Shading normal.
        wo: Towards the viewer, unit.
        whole: 1 counts the specular lobe as wide, whatever its roughness.
    """
    reflectance, is_all = point.diffuse_color, True
    if (point.flags & MATTE) == 0:
        c = closure_at(point, energy, to_frame(frame_of(normal), wo), surface.front)
        parts = albedo_parts(energy, c.wo.z, point.roughness)
        mean = mean_albedo_parts(energy, point.roughness)
        below = 1.0 - layer_reflectance(c.layer_f0, c.layer_f90, c.layer_multiple, mean)
        reflectance = c.diffuse * below + c.multiple * (1.0 - mean.x - mean.y)
        others = 1.0 - c.probabilities[0] - c.probabilities[1]
        is_all = (point.roughness >= WIDE or whole != 0) and others < 1e-4
        if is_all:
            reflectance += c.specular * (c.f0 * parts.x + c.f90 * parts.y)
    return reflectance, is_all
