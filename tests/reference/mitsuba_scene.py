# SPDX-License-Identifier: Apache-2.0
"""A SceneDescription as a Mitsuba 3 scene, with the same triangles, lights and camera and simple materials."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.camera import Camera
from tiscene.scene.description import (
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    ExtendedLobes,
    Light,
    Material,
    RectLight,
    SceneDescription,
    SphereLight,
    Texture,
    TextureLookup,
)
from tiscene.scene.textures.atlas import linear_pixels


def scene(
    mi: Any,
    description: SceneDescription,
    camera: Camera,
    width: int,
    height: int,
    *,
    max_depth: int,
    spp: int,
    glossy: bool = False,
    guides: bool = False,
) -> Any:
    """Return the Mitsuba scene for its `path` integrator.

    Materials are the diffuse color (also of a texture); glass where opacity is 0; a mask where it is below 1; a white
    metal where metallic is 1; emission. Of extended lobes: smooth sheets, anisotropy, and absorption in glass, for
    which the integrator is `volpath`.

    Args:
        mi: The mitsuba module with its variant set.
        description: The scene.
        camera: The camera.
        width: Pixels.
        height: Pixels.
        max_depth: Maximum path depth; Russian roulette starts at depth 3.
        spp: Samples per pixel.
        glossy: Convert opaque materials to Mitsuba's `principled`, with roughness, metallic, ior and normal maps.
        guides: Add the first hit's albedo and normal as channels 3 to 8 of images.
    """
    absorbs = any(material.lobes and any(material.lobes.absorption) for material in description.materials)
    integrator: dict[str, Any] = {"type": "volpath" if absorbs else "path", "max_depth": max_depth, "rr_depth": 3}
    if guides:
        integrator = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "image": integrator}
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": integrator,
        "sensor": _sensor(mi, camera, width, height, spp),
    }
    for light_row, light in enumerate(description.lights):
        parts[f"light_{light_row}"] = _light(mi, light, description.textures)
    for row, material in enumerate(description.materials):
        corners, normals, uv = _triangles(description, row)
        if len(corners):
            described = _principled if glossy and material.opacity == 1.0 else _bsdf
            bsdf = mi.load_dict(described(mi, material, description.textures))
            parts[f"material_{row}"] = _mesh(mi, f"material_{row}", corners, normals, uv, bsdf, material)
    return mi.load_dict(parts)


def _sensor(mi: Any, camera: Camera, width: int, height: int, spp: int) -> dict[str, Any]:
    matrix = np.eye(4)
    # Mitsuba's camera looks along +z with +x to the left.
    matrix[:3, :3] = camera.axes() * (-1.0, 1.0, -1.0)
    matrix[:3, 3] = camera.position
    lens: dict[str, Any] = {"type": "perspective"}
    if camera.lens_radius > 0.0:
        lens = {
            "type": "thinlens",
            "aperture_radius": camera.lens_radius,
            "focus_distance": camera.focus_distance,
        }
    return lens | {
        "fov": math.degrees(camera.vertical_fov),
        "fov_axis": "y",
        "near_clip": 1e-3,
        "far_clip": 1e5,
        "to_world": mi.ScalarTransform4f(matrix),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "independent", "sample_count": spp},
    }


def _color(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(value) for value in values]}


def _image(mi: Any, texture: Texture, *, mirrored: bool = False, wrap: str = "clamp") -> dict[str, Any]:
    """Return a bitmap whose first row is at v = 0; `mirrored` flips it horizontally."""
    pixels = np.ascontiguousarray(texture.pixels[:, ::-1, :3] if mirrored else texture.pixels[..., :3])
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": texture.encoding == "raw", "wrap_mode": wrap}


def _bsdf(mi: Any, material: Material, textures: tuple[Texture, ...] = ()) -> dict[str, Any]:
    alpha = float(material.roughness) ** 2  # type: ignore[arg-type]
    rough = {"distribution": "ggx", "alpha": alpha} if alpha > 0.0 else {}
    prefix = "rough" if rough else ""
    lobes = material.lobes or ExtendedLobes()
    if lobes.thin_walled:
        return {"type": "thindielectric", "int_ior": material.ior, "ext_ior": 1.0} | {
            "specular_transmittance": _color(lobes.transmission_color)
        }
    if lobes.anisotropy != 0.0:
        aspect = 1.0 - float(lobes.anisotropy)  # type: ignore[arg-type]
        along = alpha * math.sqrt(2.0 / (1.0 + aspect * aspect))
        rough = {"distribution": "ggx", "alpha_u": along, "alpha_v": aspect * along}
    if material.opacity == 0.0:
        return {"type": f"{prefix}dielectric", "int_ior": material.ior, "ext_ior": 1.0, **rough}
    if material.metallic == 1.0:
        bsdf: dict[str, Any] = {"type": f"{prefix}conductor", "material": "none", **rough}
    else:
        color = material.diffuse_color
        painted = isinstance(color, TextureLookup)
        if painted:
            texture = textures[color.texture]  # type: ignore[union-attr]
            reflectance = _image(mi, texture, wrap="repeat" if texture.wrap_s == "repeat" else "clamp")
        else:
            reflectance = _color(color)
        bsdf = {"type": "diffuse", "reflectance": reflectance}
    bsdf = {"type": "twosided", "bsdf": bsdf}
    return bsdf if material.opacity == 1.0 else {"type": "mask", "opacity": material.opacity, "bsdf": bsdf}


# Light that passes a dielectric layer of index 1.5: UsdPreviewSurface attenuates the diffuse lobe by it, Mitsuba's
# `principled` does not.
_BELOW_LAYER = 0.95


def _principled(mi: Any, material: Material, textures: tuple[Texture, ...]) -> dict[str, Any]:
    def value(given: Any, scale: float = 1.0) -> Any:
        if not isinstance(given, TextureLookup):
            return _color(scale * np.array(given)) if isinstance(given, tuple) else float(given)
        texture = textures[given.texture]
        pixels = np.float32(scale) * linear_pixels(texture)
        if given.channel != "rgb":
            pixels = pixels[..., ["rgba".index(given.channel)] * 4]
        raw = Texture(texture.name, pixels, encoding="raw")
        return _image(mi, raw, wrap="repeat" if texture.wrap_s == "repeat" else "clamp")

    bsdf: dict[str, Any] = {
        "type": "principled",
        "base_color": value(material.diffuse_color, _BELOW_LAYER if material.metallic == 0.0 else 1.0),
        "roughness": value(material.roughness),
        "metallic": value(material.metallic),
        "eta": material.ior,
    }
    if material.normal is not None:  # in 0..1, which Mitsuba maps to -1..1
        bsdf = {"type": "normalmap", "normalmap": value(material.normal), "bsdf": bsdf}
    return {"type": "twosided", "bsdf": bsdf}


def _light(mi: Any, light: Light, textures: tuple[Texture, ...] = ()) -> dict[str, Any]:
    def placed(*scale: float) -> Any:
        # Mitsuba's rectangle and disk emit towards +z.
        return mi.ScalarTransform4f(light.world_from_light @ np.diag([scale[0], -scale[1], -1.0, 1.0]))

    place = light.world_from_light[:3, 3]
    black = _bsdf(mi, _BLACK)
    if isinstance(light, DistantLight):
        direction = -light.world_from_light[:3, 2]
        return {"type": "directional", "direction": direction.tolist(), "irradiance": _color(light.irradiance)}
    if isinstance(light, DomeLight):
        if light.texture is None:
            return {"type": "constant", "radiance": _color(light.radiance)}
        pixels = linear_pixels(textures[light.texture])[..., :3] * np.asarray(light.radiance, np.float32)
        return {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(pixels)),
            "to_world": mi.ScalarTransform4f(light.world_from_light),
        }
    if isinstance(light, SphereLight) and light.radius == 0.0:
        return {"type": "point", "position": place.tolist(), "intensity": _color(light.radiance)}
    area: dict[str, Any] = {"type": "area", "radiance": _color(light.radiance)}  # type: ignore[attr-defined]
    if isinstance(light, RectLight):
        if light.texture is not None:
            image = textures[light.texture]
            pixels = linear_pixels(image)[..., :3] * np.asarray(light.radiance, np.float32)
            scaled = Texture(image.name, pixels, encoding="raw")
            area["radiance"] = _image(mi, scaled, mirrored=True)
        transform = placed(0.5 * light.width, 0.5 * light.height)
        return {"type": "rectangle", "to_world": transform, "emitter": area, "bsdf": black}
    if isinstance(light, DiskLight):
        return {"type": "disk", "to_world": placed(light.radius, light.radius), "emitter": area, "bsdf": black}
    if isinstance(light, SphereLight):
        return {"type": "sphere", "center": place.tolist(), "radius": light.radius, "emitter": area, "bsdf": black}
    if isinstance(light, CylinderLight):
        half = 0.5 * light.length * light.world_from_light[:3, 0]
        ends = {"p0": (place - half).tolist(), "p1": (place + half).tolist()}
        return {"type": "cylinder", **ends, "radius": light.radius, "emitter": area, "bsdf": black}
    raise TypeError(type(light).__name__)


_BLACK = Material("black", diffuse_color=(0.0, 0.0, 0.0))


Corners = NDArray[np.float64]


def _triangles(description: SceneDescription, material: int) -> tuple[Corners, Corners | None, Corners | None]:
    """Return corners, normals and texture coordinates of the triangles of one material.

    Returns:
        World-space corners [n, 3, 3]; normals [n, 3, 3] and texture coordinates [n, 3, 2], each None unless every mesh
        has them.
    """
    corners, normals, uv = [np.zeros((0, 3, 3))], [np.zeros((0, 3, 3))], [np.zeros((0, 3, 2))]
    smooth = mapped = True
    for instance in description.instances:
        mesh = description.meshes[instance.mesh]
        chosen = mesh.triangles[mesh.materials == material]
        if len(chosen) == 0:
            continue
        matrix = instance.world_from_object
        corners.append((mesh.positions @ matrix[:3, :3].T + matrix[:3, 3])[chosen])
        if mesh.normals is None:
            smooth = False
        elif smooth:
            there = mesh.normals @ np.linalg.inv(matrix[:3, :3])
            normals.append((there / np.linalg.norm(there, axis=1, keepdims=True))[chosen])
        if mesh.uv is None:
            mapped = False
        elif mapped:
            uv.append(mesh.uv[chosen])
    return np.concatenate(corners), np.concatenate(normals) if smooth else None, np.concatenate(uv) if mapped else None


def _mesh(
    mi: Any, name: str, corners: Corners, normals: Corners | None, uv: Corners | None, bsdf: Any, material: Material
) -> Any:
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    if normals is None:
        properties["face_normals"] = True
    if material.lobes is not None and any(material.lobes.absorption):
        medium = {"type": "homogeneous", "albedo": 0.0, "scale": 100.0} | {
            "sigma_t": _color(0.01 * np.array(material.lobes.absorption))
        }
        properties["interior"] = mi.load_dict(medium)
    if material.emissive_color != (0.0, 0.0, 0.0):
        properties["mesh_emitter"] = mi.load_dict({"type": "area", "radiance": _color(material.emissive_color)})
    count = len(corners)
    kinds = {"has_vertex_normals": normals is not None, "has_vertex_texcoords": uv is not None}
    mesh = mi.Mesh(name, 3 * count, count, properties, **kinds)
    values = mi.traverse(mesh)
    values["vertex_positions"] = corners.astype(np.float32).ravel()
    values["faces"] = np.arange(3 * count, dtype=np.uint32)
    if normals is not None:
        values["vertex_normals"] = normals.astype(np.float32).ravel()
    if uv is not None:
        values["vertex_texcoords"] = ((0.0, 1.0) + uv * (1.0, -1.0)).astype(np.float32).ravel()
    values.update()
    return mesh
