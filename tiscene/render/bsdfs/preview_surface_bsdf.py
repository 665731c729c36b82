# SPDX-License-Identifier: Apache-2.0
"""UsdPreviewSurface: the lobes that its inputs make (see `inputs`), evaluated and sampled as one.

Layers from the top: clearcoat; specular reflection with Schlick's Fresnel term; then, below it, diffuse reflection.
Metal has no diffuse part. Where the material is glass (see `material_table.flags_of`), 1 - opacity of it is a
dielectric boundary instead, rough as the material is and colorless, of the solid that the mesh encloses: light
refracts in and out by `ior`. A roughness of 0 is a mirror as sharp as a pixel can show (`energy.SMALLEST_ALPHA`), not a
singular one, so that every direction has a finite density. All lobes together reflect what they should: see `energy`.
"""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2, vec3, vec4
from tiscene.render.bsdfs import clearcoat, diffuse, glass, specular
from tiscene.render.bsdfs.closure import (
    COAT_F0,
    Closure,
    glass_transfer,
    grazing_reflectance,
    layer_reflectance,
    mean_reflected_parts,
    multiple_reflectance,
    reflected_parts,
)
from tiscene.render.bsdfs.energy_tables import SMALLEST_ALPHA
from tiscene.render.sampling import warp
from tiscene.scene.material_table import COATED, GLASS, MATTE, SPECULAR_WORKFLOW

# Each has sample(closure, u) and evaluate(closure, energy, wi). A new lobe is a file, a name here and its chance below.
LOBES = (diffuse, specular, clearcoat, glass)


@ti.func
def closure_at(point: Template, energy: Template, wo: vec3, front: ti.i32):
    """The lobes of a material for one outgoing direction in the shading frame, wo.z > 0."""
    metal = point.metallic
    c = Closure(wo=wo, chances=vec4(1.0, 0.0, 0.0, 0.0), roughness=point.roughness, diffuse=point.diffuse_color)
    if (point.flags & MATTE) == 0:
        layer_f0 = vec3(((point.ior - 1.0) / (point.ior + 1.0)) ** 2)
        if point.flags & SPECULAR_WORKFLOW:
            layer_f0 = point.specular_color
            metal = 0.0
        through = 0.0
        if point.flags & GLASS:
            through = (1.0 - point.opacity) * (1.0 - metal)
        base = 1.0
        if point.flags & COATED:
            parts = reflected_parts(energy, wo.z, point.clearcoat_roughness)
            reflected = point.clearcoat * (COAT_F0 * parts.x + parts.y)
            base = 1.0 - reflected
            c.coat = point.clearcoat
            c.coat_alpha = ti.max(point.clearcoat_roughness * point.clearcoat_roughness, SMALLEST_ALPHA)
            c.chances[2] = reflected
        c.alpha = ti.max(point.roughness * point.roughness, SMALLEST_ALPHA)

        parts = reflected_parts(energy, wo.z, point.roughness)
        mean = mean_reflected_parts(energy, point.roughness)
        c.layered = 1
        c.layer_f0 = layer_f0
        c.layer_f90 = grazing_reflectance(layer_f0)
        c.layer_multiple = multiple_reflectance(layer_f0, c.layer_f90, mean)
        c.f0 = layer_f0 * (1.0 - metal) + point.diffuse_color * metal
        metal_f90 = grazing_reflectance(point.diffuse_color)
        c.f90 = c.layer_f90 * (1.0 - metal) + metal_f90 * metal

        opaque = base * (1.0 - through)
        c.specular = opaque
        multiple = c.layer_multiple * (1.0 - metal) + multiple_reflectance(point.diffuse_color, metal_f90, mean) * metal
        c.multiple = multiple * (opaque * (1.0 - parts.x - parts.y) / ti.max(1.0 - mean.x - mean.y, 1e-5))
        below = 1.0 - layer_reflectance(layer_f0, c.layer_f90, c.layer_multiple, parts)
        mean_below = 1.0 - layer_reflectance(layer_f0, c.layer_f90, c.layer_multiple, mean)
        c.diffuse = point.diffuse_color * (opaque * (1.0 - metal)) * below / ti.max(mean_below, 1e-5)

        c.chances[1] = opaque * (c.f0 * parts.x + c.f90 * parts.y).sum() * (1.0 / 3.0)
        # What the diffuse lobe reflects of wo's light, near enough.
        c.chances[0] = (c.diffuse * mean_below + c.multiple * (1.0 - mean.x - mean.y)).sum() * (1.0 / 3.0)
        if through > 0.0:
            inside = 1 - front
            c.eta = point.ior if front != 0 else 1.0 / point.ior
            c.glass = base * through / ti.max(glass_transfer(energy, point.glass, inside, wo.z, point.roughness), 0.1)
            c.chances[3] = base * through
        total = c.chances.sum()
        c.chances = c.chances / total if total > 0.0 else vec4(1.0, 0.0, 0.0, 0.0)
    return c


@ti.func
def evaluate(c: Template, energy: Template, wi: vec3) -> vec4:
    """(f |cos|, density of `sample`) of all lobes for a direction in the shading frame."""
    value, _ = evaluate_parted(c, energy, wi)
    return value


@ti.func
def evaluate_parted(c: Template, energy: Template, wi: vec3):
    """`evaluate`, and the part of it that is the diffuse lobe's, 0..1."""
    result, diffuse_part = vec4(0.0), 0.0
    for k in ti.static(range(len(LOBES))):
        if c.chances[k] > 0.0:
            part = LOBES[k].evaluate(c, energy, wi)
            part.w *= c.chances[k]
            result += part
            if ti.static(k == 0):
                diffuse_part = part.xyz.sum()
    return result, diffuse_part / ti.max(result.xyz.sum(), 1e-30)


@ti.func
def sample(c: Template, u: vec3) -> vec3:
    """A direction in the shading frame. u.z chooses the lobe."""
    lobe, rest, low = 0, u.z, 0.0
    for k in ti.static(range(len(LOBES))):
        if c.chances[k] > 0.0 and u.z >= low:
            lobe = k
            rest = ti.min((u.z - low) / c.chances[k], 0.99999994)
        low += c.chances[k]
    wi = vec3(0.0, 0.0, 1.0)
    for k in ti.static(range(len(LOBES))):
        if lobe == k:
            wi = LOBES[k].sample(c, vec3(u.x, u.y, rest))
    return wi


@ti.dataclass
class ShadingFrame:
    """Three unit vectors at right angles; the third is the shading normal."""

    s: vec3
    t: vec3
    n: vec3


@ti.func
def frame_of(n: vec3):
    """Some ShadingFrame about n."""
    s, t = warp.tangents(n)
    return ShadingFrame(s, t, n)


@ti.func
def to_frame(frame: Template, w: vec3) -> vec3:
    """A world direction in the frame."""
    return vec3(frame.s.dot(w), frame.t.dot(w), frame.n.dot(w))


@ti.func
def from_frame(frame: Template, w: vec3) -> vec3:
    """A direction in the frame, in the world."""
    return frame.s * w.x + frame.t * w.y + frame.n * w.z


@ti.dataclass
class Scattering:
    """What becomes of light at a vertex, in the world. Values are (f |cos|, density of sampling the direction)."""

    towards_light: vec4
    direction: vec3  # where the path goes on
    onward: vec4
    diffuse_parts: vec2  # of either value, what the diffuse lobe gives, 0..1
    transmits: ti.i32  # 1: the path goes on beyond the surface, into an index of refraction `eta` times as large
    eta: ti.f32


@ti.func
def scatter(surface: Template, point: Template, energy: Template, normal: vec3, wo: vec3, light: vec3, u: vec3):
    """Evaluate a direction towards a light and sample one by the material: a Scattering.

    normal: `shading_normal`. u: two numbers for the direction, one that chooses the lobe.
    """
    frame = frame_of(normal)
    result = Scattering(eta=1.0, diffuse_parts=vec2(1.0))
    if point.flags & MATTE:  # the lobes below would do the same; most of a room is done by half of the work
        wi = warp.cosine_hemisphere(u.xy)
        pdf = warp.cosine_hemisphere_pdf(wi)
        result.direction = from_frame(frame, wi)
        result.onward = vec4(point.diffuse_color * pdf, pdf)
        pdf = ti.max(normal.dot(light), 0.0) * warp.INV_PI
        result.towards_light = vec4(point.diffuse_color * pdf, pdf)
    else:
        c = closure_at(point, energy, to_frame(frame, wo), surface.front)
        result.eta = c.eta
        for turn in range(2):  # not unrolled: the lobes are there once
            wi = to_frame(frame, light)
            if turn == 1:
                wi = sample(c, u)
                result.direction = from_frame(frame, wi)
            value, diffuse_part = evaluate_parted(c, energy, wi)
            if turn == 0:
                result.towards_light = value
                result.diffuse_parts.x = diffuse_part
            else:
                result.onward = value
                result.diffuse_parts.y = diffuse_part
                result.transmits = ti.cast(wi.z < 0.0, ti.i32)
    # Interpolated normals must not let light through a surface or out of its back.
    if surface.geometric_normal.dot(light) * normal.dot(light) <= 0.0:
        result.towards_light = vec4(0.0)
    if surface.geometric_normal.dot(result.direction) * normal.dot(result.direction) <= 0.0:
        result.onward = vec4(0.0)
    return result
