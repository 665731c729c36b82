# SPDX-License-Identifier: Apache-2.0
"""Direct light at a vertex of a path: what a light sample contributes, and the shadow ray that tests it."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec3
from tiscene.render.intersect.surface_interaction import offset_origin
from tiscene.render.lights.intersect import LIGHT_FRONT, power_heuristic, response
from tiscene.scene.lights.light_kinds import MESH
from tiscene.scene.lights.light_table import KIND, SHADOWING, SHADOWLESS


@ti.func
def direct_light(
    lights: Template, sample: Template, scattering: Template, throughput: vec3, depth: ti.i32, mis: ti.i32
) -> vec3:
    """Return the radiance that an unoccluded light sample adds to a path.

    Args:
        lights: LightTables.
        sample: LightSample with a positive density.
        scattering: Scattering towards the sample.
        throughput: Of the path, up to the vertex.
        depth: Number of surfaces on the path, with this one.
        mis: Whether paths that find the light count too, see `lights.intersect`.
    """
    row = sample.row
    direct = throughput * scattering.towards_light.xyz * sample.radiance
    direct *= response(lights.values, row, scattering.diffuse_parts.x, depth) / sample.pdf
    # No BSDF sample finds a light that casts no shadows, nor one whose shadow rays pass meshes.
    weighs = mis != 0 and sample.delta == 0 and not lights.values[row, SHADOWLESS] > 0.0
    if ti.static(lights.with_links):
        weighs = weighs and lights.values[row, SHADOWING] < 0.0
    if weighs:
        direct *= power_heuristic(sample.mis_pdf, scattering.towards_light.w)
    return direct


@ti.func
def shadow_ray(lights: Template, surface: Template, sample: Template):
    """Return the origin, direction and length, m, of the ray from a surface to a light sample."""
    towards = sample.direction
    reach = sample.distance * (1.0 - LIGHT_FRONT)
    start = offset_origin(surface, towards)
    if ti.static(lights.with_meshes):
        if lights.values[sample.row, KIND] == MESH:
            # Triangles of mesh lights are in the BVH: aim from the offset origin at a point just in front of the
            # sampled one.
            aim = surface.position + towards * sample.distance - start
            above = sample.height
            if above.dot(aim) > 0.0:
                above = -1.0 * above
            aim += above
            reach = aim.norm()
            towards = aim / ti.max(reach, 1e-20)
    return start, towards, reach
