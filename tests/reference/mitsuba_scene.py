"""A SceneDescription as a Mitsuba 3 scene: the same triangles, matte materials, lights and camera."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.camera import Camera
from tiscene.scene.description import (
    DiskLight,
    DistantLight,
    DomeLight,
    Light,
    Material,
    RectLight,
    SceneDescription,
    SphereLight,
)


def scene(
    mi: Any, description: SceneDescription, camera: Camera, width: int, height: int, *, max_depth: int, spp: int
) -> Any:
    """The scene for the `path` integrator. mi: the mitsuba module with its variant set. Russian roulette from depth 3.

    Materials: the diffuse colour; glass where opacity is 0; a perfect mirror where metallic is 1; emission. Constant
    inputs only.
    """
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": 3},
        "sensor": _sensor(mi, camera, width, height, spp),
    }
    for light_row, light in enumerate(description.lights):
        parts[f"light_{light_row}"] = _light(mi, light)
    for row, material in enumerate(description.materials):
        corners, normals = _triangles(description, row)
        if len(corners):
            bsdf = mi.load_dict(_bsdf(material))
            parts[f"material_{row}"] = _mesh(mi, f"material_{row}", corners, normals, bsdf, material)
    return mi.load_dict(parts)


def _sensor(mi: Any, camera: Camera, width: int, height: int, spp: int) -> dict[str, Any]:
    matrix = np.eye(4)
    # Mitsuba's camera looks along +z with +x to the left.
    matrix[:3, :3] = camera.axes() * (-1.0, 1.0, -1.0)
    matrix[:3, 3] = camera.position
    return {
        "type": "perspective",
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


def _bsdf(material: Material) -> dict[str, Any]:
    if material.opacity == 0.0:
        return {"type": "dielectric", "int_ior": material.ior, "ext_ior": 1.0}
    if material.metallic == 1.0:
        return {"type": "twosided", "bsdf": {"type": "conductor", "material": "none"}}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _color(material.diffuse_color)}}


def _light(mi: Any, light: Light) -> dict[str, Any]:
    def placed(*scale: float) -> Any:
        # Mitsuba's rectangle and disk emit towards +z.
        return mi.ScalarTransform4f(light.world_from_light @ np.diag([scale[0], -scale[1], -1.0, 1.0]))

    if isinstance(light, DistantLight):
        direction = -light.world_from_light[:3, 2]
        return {"type": "directional", "direction": direction.tolist(), "irradiance": _color(light.irradiance)}
    if isinstance(light, DomeLight):
        return {"type": "constant", "radiance": _color(light.radiance)}
    area = {"type": "area", "radiance": _color(light.radiance)}  # type: ignore[attr-defined]
    if isinstance(light, RectLight):
        transform = placed(0.5 * light.width, 0.5 * light.height)
        return {"type": "rectangle", "to_world": transform, "emitter": area, "bsdf": _bsdf(_BLACK)}
    if isinstance(light, DiskLight):
        return {"type": "disk", "to_world": placed(light.radius, light.radius), "emitter": area, "bsdf": _bsdf(_BLACK)}
    if isinstance(light, SphereLight):
        centre = light.world_from_light[:3, 3].tolist()
        return {"type": "sphere", "center": centre, "radius": light.radius, "emitter": area, "bsdf": _bsdf(_BLACK)}
    raise TypeError(type(light).__name__)


_BLACK = Material("black", diffuse_color=(0.0, 0.0, 0.0))


def _triangles(description: SceneDescription, material: int) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """World-space corners [n, 3, 3] of the triangles of one material, and their normals if every mesh has some."""
    corners, normals = [np.zeros((0, 3, 3))], [np.zeros((0, 3, 3))]
    smooth = True
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
            normals.append((mesh.normals @ np.linalg.inv(matrix[:3, :3]))[chosen])
    return np.concatenate(corners), np.concatenate(normals) if smooth else None


def _mesh(
    mi: Any, name: str, corners: NDArray[np.float64], normals: NDArray[np.float64] | None, bsdf: Any, material: Material
) -> Any:
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    if normals is None:
        properties["face_normals"] = True
    if material.emissive_color != (0.0, 0.0, 0.0):
        properties["mesh_emitter"] = mi.load_dict({"type": "area", "radiance": _color(material.emissive_color)})
    count = len(corners)
    mesh = mi.Mesh(name, 3 * count, count, properties, has_vertex_normals=normals is not None)
    values = mi.traverse(mesh)
    values["vertex_positions"] = corners.astype(np.float32).ravel()
    values["faces"] = np.arange(3 * count, dtype=np.uint32)
    if normals is not None:
        values["vertex_normals"] = normals.astype(np.float32).ravel()
    values.update()
    return mesh
