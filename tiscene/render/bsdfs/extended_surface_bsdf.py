# SPDX-License-Identifier: Apache-2.0
"""The BSDF of materials with extended lobes: UsdPreviewSurface's layers and those of MaterialX and glTF.

Layers from the top: clearcoat, whose color tints what is below; sheen; specular reflection, anisotropic, tinted and
weighted; diffuse reflection, of which a fraction passes to the other side. Of glass, the fraction 1 - opacity is the
boundary of a solid, or a sheet without thickness, with a color. The coat and the sheen attenuate what is below by the
outgoing direction alone, which conserves energy but is not reciprocal. Subsurface scattering of solids is diffuse
reflection of its color.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3
from tiscene.render.bsdfs import anisotropic, anisotropic_diffuse, clearcoat, colored_glass, sheen, translucent
from tiscene.render.bsdfs import preview_surface_bsdf as plain
from tiscene.render.bsdfs.closure import (
    albedo_parts,
    glass_transfer,
    grazing_reflectance,
    layer_reflectance,
    mean_albedo_parts,
    multiple_reflectance,
    normal_reflectance,
)
from tiscene.render.bsdfs.colored_glass import sheet_reflectance, sheet_roughness
from tiscene.render.bsdfs.energy_tables import SMALLEST_ALPHA
from tiscene.render.bsdfs.lobe_inputs import lobe_inputs_at
from tiscene.render.bsdfs.material_inputs import footprint_at
from tiscene.render.bsdfs.preview_surface_bsdf import (
    Lobes,
    Scattering,
    ShadingFrame,
    keep_sides,
    scatter_in,
    to_frame,
)
from tiscene.render.bsdfs.sheen import sheen_albedo
from tiscene.render.sampling import warp
from tiscene.scene.material_table import COATED, EXTENDED, GLASS, SPECULAR_WORKFLOW, THIN

EXTENDED_LOBES = Lobes.of(
    (anisotropic_diffuse, anisotropic, clearcoat, colored_glass, sheen, translucent),
    diffuse=(0, 5),
    transmitting=(3, 5),
)
if TYPE_CHECKING:
    Probabilities: TypeAlias = Any
else:
    Probabilities = ti.types.vector(len(EXTENDED_LOBES.functions), ti.f32)


@ti.dataclass
class ExtendedClosure:
    """Parameters of the lobes; see also `Closure`. Those of a lobe with probability 0 are undefined."""

    wo: vec3
    probabilities: Probabilities  # in the order of EXTENDED_LOBES
    diffuse: vec3
    layer_f0: vec3
    layer_f90: ti.f32
    layer_multiple: vec3
    f0: vec3
    f90: ti.f32
    multiple: vec3
    roughness: ti.f32
    alpha: ti.f32
    alphas: vec2  # along x and y of the frame
    specular: vec3
    coat: ti.f32
    coat_f0: ti.f32
    coat_alpha: ti.f32
    glass: ti.f32
    eta: ti.f32
    ior: ti.f32
    thin: ti.i32  # 1: a sheet without thickness
    sheet: ti.f32  # its reflectance for wo
    sheet_alpha: ti.f32  # of its transmission
    sheet_through: ti.f32  # factor of its transmission
    reflected_color: vec3  # factors of glass
    transmitted_color: vec3
    sheen: vec3
    sheen_roughness: ti.f32
    translucent: vec3  # as `diffuse`


@ti.func
def extended_closure_at(point: Template, lobes: Template, energy: Template, wo: vec3, front: ti.i32):
    """Return the ExtendedClosure of a material for one outgoing direction in the shading frame, wo.z > 0.

    Args:
        point: MaterialPoint.
        lobes: LobeInputs.
        energy: `energy_tables` with the sheen table.
        wo: Unit.
        front: 1 if wo is outside of the solid.
    """
    third = 1.0 / 3.0
    metal = point.metallic
    c = ExtendedClosure(wo=wo, roughness=point.roughness, eta=1.0, ior=point.ior)
    c.alpha = ti.max(point.roughness * point.roughness, SMALLEST_ALPHA)
    c.alphas = anisotropic.alphas_of(point.roughness, lobes.anisotropy)
    layer_f0 = ti.min(normal_reflectance(point.ior) * lobes.specular_tint, 1.0)
    if point.flags & SPECULAR_WORKFLOW:
        layer_f0 = point.specular_color
        metal = 0.0
    layer_f90 = grazing_reflectance(layer_f0) * lobes.specular
    layer_f0 *= lobes.specular
    transmission = 0.0
    if point.flags & GLASS:
        transmission = (1.0 - point.opacity) * (1.0 - metal)

    base = vec3(1.0)  # what the layers above transmit
    if point.flags & COATED:
        parts = albedo_parts(energy, wo.z, point.clearcoat_roughness)
        c.coat_f0 = normal_reflectance(lobes.coat_ior)
        reflected = point.clearcoat * (c.coat_f0 * parts.x + parts.y)
        base = (1.0 - reflected) * (1.0 + point.clearcoat * (lobes.coat_color - 1.0))
        c.coat = point.clearcoat
        c.coat_alpha = ti.max(point.clearcoat_roughness * point.clearcoat_roughness, SMALLEST_ALPHA)
        c.probabilities[2] = reflected
    if lobes.sheen_color.max() > 0.0:
        albedo = sheen_albedo(energy, wo.z, lobes.sheen_roughness)
        c.sheen = base * lobes.sheen_color
        c.sheen_roughness = lobes.sheen_roughness
        c.probabilities[4] = c.sheen.sum() * (third * albedo)
        base *= 1.0 - lobes.sheen_color.max() * albedo

    parts = anisotropic.layer_parts(c, energy, wo)
    mean = mean_albedo_parts(energy, point.roughness)
    c.layer_f0, c.layer_f90 = layer_f0, layer_f90
    c.layer_multiple = multiple_reflectance(layer_f0, layer_f90, mean)
    metal_f90 = grazing_reflectance(point.diffuse_color)
    c.f0 = layer_f0 * (1.0 - metal) + point.diffuse_color * metal
    c.f90 = layer_f90 * (1.0 - metal) + metal_f90 * metal
    opaque = base * (1.0 - transmission)
    c.specular = opaque
    multiple = c.layer_multiple * (1.0 - metal) + multiple_reflectance(point.diffuse_color, metal_f90, mean) * metal
    mean_lost = anisotropic.mean_lost_fraction(c, mean)
    c.multiple = multiple * opaque * (anisotropic.lost_fraction(c, energy, wo) / ti.max(mean_lost, 1e-5))
    below = 1.0 - layer_reflectance(layer_f0, layer_f90, c.layer_multiple, parts)
    mean_below = 1.0 - layer_reflectance(layer_f0, layer_f90, c.layer_multiple, mean)
    entering = opaque * (1.0 - metal) * below / ti.max(mean_below, 1e-5)
    c.diffuse = point.diffuse_color * entering * (1.0 - lobes.translucency)
    c.translucent = lobes.translucent_color * entering * lobes.translucency
    c.probabilities[0] = (c.diffuse * mean_below + c.multiple * mean_lost).sum() * third
    c.probabilities[1] = (c.specular * (c.f0 * parts.x + c.f90 * parts.y)).sum() * third
    c.probabilities[5] = (c.translucent * mean_below).sum() * third

    if transmission > 0.0:
        c.reflected_color = base * transmission
        c.transmitted_color = c.reflected_color * lobes.transmission_color
        c.probabilities[3] = c.reflected_color.sum() * third
        if point.flags & THIN:
            through = sheet_roughness(point.roughness, point.ior)
            through_parts = albedo_parts(energy, wo.z, through)
            c.thin = 1
            c.sheet = sheet_reflectance(wo.z, point.ior)
            c.sheet_alpha = ti.max(through * through, SMALLEST_ALPHA)
            all_parts = albedo_parts(energy, wo.z, point.roughness)
            c.glass = 1.0 / ti.max(all_parts.x + all_parts.y, 0.1)
            c.sheet_through = 1.0 / ti.max(through_parts.x + through_parts.y, 0.1)
        else:
            c.eta = point.ior if front != 0 else 1.0 / point.ior
            c.glass = 1.0 / ti.max(glass_transfer(energy, point.glass, 1 - front, wo.z, point.roughness), 0.1)
    total = c.probabilities.sum()
    if total > 0.0:
        c.probabilities /= total
    else:
        c.probabilities[0] = 1.0
    return c


@ti.func
def tangent_frame(surface: Template, n: vec3, rotation: ti.f32):
    """Return the ShadingFrame about n whose s is the direction of u, rotated towards that of v. rotation: turns."""
    s, t = warp.tangents(n)
    along = surface.dp_du - n * n.dot(surface.dp_du)
    length = along.norm()
    if length > 0.0:
        s = along / length
        t = n.cross(s)
        if t.dot(surface.dp_dv) < 0.0:
            t = -1.0 * t
    turned = warp.circle(rotation)
    return ShadingFrame(s * turned.x + t * turned.y, t * turned.x - s * turned.y, n)


@ti.func
def scatter(
    materials: Template,
    textures: Template,
    surface: Template,
    point: Template,
    energy: Template,
    normal: vec3,
    direction: vec3,
    width: ti.f32,
    key: ti.u32,
    light: vec3,
    u: vec3,
):
    """Evaluate the direction to a light, and sample a direction by the BSDF; of any material.

    Args:
        materials: Materials.
        textures: Textures.
        surface: VisibleSurface.
        point: MaterialPoint.
        energy: `energy_tables` with the sheen table.
        normal: `shading_normal`.
        direction: Of the ray.
        width: Of the ray cone at the surface, m.
        key: Of the random numbers for stochastic filtering.
        light: Towards the light, unit.
        u: Two numbers for the direction, and one that chooses the lobe, in [0, 1).

    Returns:
        Scattering.
    """
    result = Scattering(eta=1.0, diffuse_parts=vec2(1.0))
    wo = -1.0 * direction
    if (point.flags & EXTENDED) == 0:
        result = plain.scatter(surface, point, energy, normal, wo, light, u)
    else:
        lobes = lobe_inputs_at(materials, textures, surface, 0, footprint_at(surface, direction, width, key))
        frame = tangent_frame(surface, normal, lobes.rotation)
        c = extended_closure_at(point, lobes, energy, to_frame(frame, wo), surface.front)
        scatter_in(frame, c, energy, light, u, EXTENDED_LOBES, result)
        keep_sides(result, surface, normal, light)
    return result
