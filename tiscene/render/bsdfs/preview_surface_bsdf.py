# SPDX-License-Identifier: Apache-2.0
"""The BSDF of UsdPreviewSurface: its lobes, evaluated and sampled together.

Layers from the top: clearcoat; specular reflection with Schlick's Fresnel term; diffuse reflection. Metals have no
diffuse part. Of a glass material (see `material_table`), the fraction 1 - opacity is a colorless dielectric boundary of
the same roughness instead; the mesh encloses a solid into and out of which light refracts by `ior`. A roughness of 0 is
rendered with SMALLEST_ALPHA, so that every direction has a finite density. `energy_tables` conserve energy.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3, vec4
from tiscene.render.bsdfs import clearcoat, diffuse, glass, specular
from tiscene.render.bsdfs.closure import (
    COAT_F0,
    Closure,
    albedo_parts,
    glass_transfer,
    grazing_reflectance,
    layer_reflectance,
    mean_albedo_parts,
    multiple_reflectance,
    normal_reflectance,
)
from tiscene.render.bsdfs.energy_tables import SMALLEST_ALPHA
from tiscene.render.sampling import warp
from tiscene.scene.material_table import COATED, GLASS, MATTE, SPECULAR_WORKFLOW


class Lobe(NamedTuple):
    """Functions of one lobe: sample(closure, u) and evaluate(closure, energy, wi)."""

    sample: Any
    evaluate: Any


class Lobes(NamedTuple):
    """The lobes of a BSDF, known at compile time.

    Attributes:
        functions: Of each lobe. Functions instead of modules: recordings of kernels are keyed by the sources of the
            functions that they name.
        diffuse: Those that lights' diffuse multipliers apply to, by number.
        transmitting: Those that sample directions on the other side.
    """

    functions: tuple[Lobe, ...]
    diffuse: tuple[int, ...]
    transmitting: tuple[int, ...]

    @classmethod
    def of(cls, modules: Sequence[Any], diffuse: tuple[int, ...], transmitting: tuple[int, ...]) -> Self:
        """Return the lobes whose functions are in some modules."""
        return cls(tuple(Lobe(each.sample, each.evaluate) for each in modules), diffuse, transmitting)


# A new lobe is a module, an entry here, and its probability in `closure_at`.
LOBES = Lobes.of((diffuse, specular, clearcoat, glass), diffuse=(0,), transmitting=(3,))


@ti.func
def closure_at(point: Template, energy: Template, wo: vec3, front: ti.i32):
    """Return the Closure of a material for one outgoing direction in the shading frame, wo.z > 0.

    Args:
        point: MaterialPoint.
        energy: `energy_tables`.
        wo: Unit.
        front: 1 if wo is outside of the solid.
    """
    metal = point.metallic
    c = Closure(wo=wo, probabilities=vec4(1.0, 0.0, 0.0, 0.0), roughness=point.roughness, diffuse=point.diffuse_color)
    if (point.flags & MATTE) == 0:
        layer_f0 = vec3(normal_reflectance(point.ior))
        if point.flags & SPECULAR_WORKFLOW:
            layer_f0 = point.specular_color
            metal = 0.0
        transmission = 0.0
        if point.flags & GLASS:
            transmission = (1.0 - point.opacity) * (1.0 - metal)
        base = 1.0
        if point.flags & COATED:
            parts = albedo_parts(energy, wo.z, point.clearcoat_roughness)
            reflected = point.clearcoat * (COAT_F0 * parts.x + parts.y)
            base = 1.0 - reflected
            c.coat, c.coat_f0 = point.clearcoat, COAT_F0
            c.coat_alpha = ti.max(point.clearcoat_roughness * point.clearcoat_roughness, SMALLEST_ALPHA)
            c.probabilities[2] = reflected
        c.alpha = ti.max(point.roughness * point.roughness, SMALLEST_ALPHA)

        parts = albedo_parts(energy, wo.z, point.roughness)
        mean = mean_albedo_parts(energy, point.roughness)
        c.layered = 1
        c.layer_f0 = layer_f0
        c.layer_f90 = grazing_reflectance(layer_f0)
        c.layer_multiple = multiple_reflectance(layer_f0, c.layer_f90, mean)
        c.f0 = layer_f0 * (1.0 - metal) + point.diffuse_color * metal
        metal_f90 = grazing_reflectance(point.diffuse_color)
        c.f90 = c.layer_f90 * (1.0 - metal) + metal_f90 * metal

        opaque = base * (1.0 - transmission)
        c.specular = opaque
        multiple = c.layer_multiple * (1.0 - metal) + multiple_reflectance(point.diffuse_color, metal_f90, mean) * metal
        c.multiple = multiple * (opaque * (1.0 - parts.x - parts.y) / ti.max(1.0 - mean.x - mean.y, 1e-5))
        below = 1.0 - layer_reflectance(layer_f0, c.layer_f90, c.layer_multiple, parts)
        mean_below = 1.0 - layer_reflectance(layer_f0, c.layer_f90, c.layer_multiple, mean)
        c.diffuse = point.diffuse_color * (opaque * (1.0 - metal)) * below / ti.max(mean_below, 1e-5)

        c.probabilities[1] = opaque * (c.f0 * parts.x + c.f90 * parts.y).sum() * (1.0 / 3.0)
        # Approximate albedo of the diffuse lobe for wo.
        c.probabilities[0] = (c.diffuse * mean_below + c.multiple * (1.0 - mean.x - mean.y)).sum() * (1.0 / 3.0)
        if transmission > 0.0:
            inside = 1 - front
            c.eta = point.ior if front != 0 else 1.0 / point.ior
            c.glass = (
                base * transmission / ti.max(glass_transfer(energy, point.glass, inside, wo.z, point.roughness), 0.1)
            )
            c.probabilities[3] = base * transmission
        total = c.probabilities.sum()
        c.probabilities = c.probabilities / total if total > 0.0 else vec4(1.0, 0.0, 0.0, 0.0)
    return c


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3, lobes: Template):
    """Return (f |cos|, density of `sample`) of all lobes for a direction in the shading frame, and what is diffuse.

    The latter is the fraction, 0..1, of f that is from diffuse lobes.
    """
    result, diffuse_part = vec4(0.0), 0.0
    for k in ti.static(range(len(lobes.functions))):
        if c.probabilities[k] > 0.0:
            part = lobes.functions[k].evaluate(c, energy, wi)
            part.w *= c.probabilities[k]
            result += part
            if ti.static(k in lobes.diffuse):
                diffuse_part += part.xyz.sum()
    return result, diffuse_part / ti.max(result.xyz.sum(), 1e-30)


@ti.func
def choose_lobe(c: Template, count: Template, u: ti.f32):
    """Choose one of the first `count` lobes by its probability.

    Args:
        c: Closure.
        count: Number of lobes.
        u: A number in [0, 1).

    Returns:
        The lobe, and another number in [0, 1) that is left of u.
    """
    lobe, rest, low = 0, u, 0.0
    for k in ti.static(range(count)):
        if c.probabilities[k] > 0.0 and u >= low:
            lobe = k
            rest = ti.min((u - low) / c.probabilities[k], 0.99999994)
        low += c.probabilities[k]
    return lobe, rest


@ti.func
def sample(c: Template, u: vec3, lobes: Template) -> vec3:
    """Sample a direction in the shading frame, or zero; u.z chooses the lobe."""
    lobe, rest = choose_lobe(c, ti.static(len(lobes.functions)), u.z)
    wi = vec3(0.0, 0.0, 1.0)
    for k in ti.static(range(len(lobes.functions))):
        if lobe == k:
            wi = lobes.functions[k].sample(c, vec3(u.x, u.y, rest))
            if ti.static(k not in lobes.transmitting):
                # Hits a second microfacet: no sample. The density of glass there would not be that of the sample.
                if wi.z <= 0.0:
                    wi = vec3(0.0)
    return wi


@ti.dataclass
class ShadingFrame:
    """An orthonormal frame; n is the shading normal."""

    s: vec3
    t: vec3
    n: vec3


@ti.func
def frame_of(n: vec3):
    """Return a ShadingFrame about n."""
    s, t = warp.tangents(n)
    return ShadingFrame(s, t, n)


@ti.func
def to_frame(frame: Template, w: vec3) -> vec3:
    """Transform a direction from world space to the frame."""
    return vec3(frame.s.dot(w), frame.t.dot(w), frame.n.dot(w))


@ti.func
def from_frame(frame: Template, w: vec3) -> vec3:
    """Transform a direction from the frame to world space."""
    return frame.s * w.x + frame.t * w.y + frame.n * w.z


@ti.dataclass
class Scattering:
    """Scattering at a path vertex, in world space. Values are (f |cos|, density of sampling the direction)."""

    towards_light: vec4
    direction: vec3  # sampled, in which the path continues
    onward: vec4  # value of that direction
    diffuse_parts: vec2  # fraction of the two values that is from the diffuse lobe, 0..1
    transmits: ti.i32  # 1: the path continues beyond the surface, where the index of refraction is `eta` times as large
    eta: ti.f32


@ti.func
def keep_sides(result: Template, surface: Template, normal: vec3, light: vec3):
    """Remove scattering that contradicts the geometric normal, as interpolated normals may.

    Reflection must not pass through the surface, nor transmission stay on its side.
    """
    if surface.geometric_normal.dot(light) * normal.dot(light) <= 0.0:
        result.towards_light = vec4(0.0)
    if surface.geometric_normal.dot(result.direction) * normal.dot(result.direction) <= 0.0:
        result.onward = vec4(0.0)


@ti.func
def scatter_in(frame: Template, c: Template, energy: Template, light: vec3, u: vec3, lobes: Template, result: Template):
    """Write the Scattering of a closure in its frame to `result`; other arguments as of `scatter`."""
    result.eta = c.eta
    for step in range(2):  # not unrolled, to compile the lobes once
        wi = to_frame(frame, light)
        if step == 1:
            wi = sample(c, u, lobes)
            result.direction = from_frame(frame, wi)
        value, diffuse_part = evaluate(c, energy, wi, lobes)
        if step == 0:
            result.towards_light = value
            result.diffuse_parts.x = diffuse_part
        else:
            result.onward = value
            result.diffuse_parts.y = diffuse_part
            result.transmits = ti.cast(wi.z < 0.0, ti.i32)


@ti.func
def scatter(surface: Template, point: Template, energy: Template, normal: vec3, wo: vec3, light: vec3, u: vec3):
    """Evaluate the direction to a light, and sample a direction by the BSDF.

    Args:
        surface: VisibleSurface.
        point: MaterialPoint.
        energy: `energy_tables`.
        normal: `shading_normal`.
        wo: Towards the previous vertex, unit.
        light: Towards the light, unit.
        u: Two numbers for the direction, and one that chooses the lobe, in [0, 1).

    Returns:
        Scattering.
    """
    frame = frame_of(normal)
    result = Scattering(eta=1.0, diffuse_parts=vec2(1.0))
    if point.flags & MATTE:  # a fast path with the same result
        wi = warp.cosine_hemisphere(u.xy)
        pdf = warp.cosine_hemisphere_pdf(wi)
        result.direction = from_frame(frame, wi)
        result.onward = vec4(point.diffuse_color * pdf, pdf)
        pdf = ti.max(normal.dot(light), 0.0) * warp.INV_PI
        result.towards_light = vec4(point.diffuse_color * pdf, pdf)
    else:
        c = closure_at(point, energy, to_frame(frame, wo), surface.front)
        scatter_in(frame, c, energy, light, u, LOBES, result)
    keep_sides(result, surface, normal, light)
    return result
