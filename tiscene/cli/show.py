# SPDX-License-Identifier: Apache-2.0
"""`tiscene show`: print the size, cameras, lights, objects and templates of a scene."""

from __future__ import annotations

import argparse
import math
import textwrap
from pathlib import Path

import numpy as np

from tiscene import catalog
from tiscene.errors import counted
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.description import DistantLight, Light, SceneDescription
from tiscene.usd.read.stage_reader import read_stage

MAX_NAMES = 8  # names of objects in a line
MAX_WIDTH = 100  # characters of a line of templates


def run(args: argparse.Namespace) -> None:
    """Print the contents of a scene."""
    scenario = _scenario(args.scene)
    path = catalog.find_scene(scenario.scene)
    moved = {each.template for each in scenario.objects if catalog.is_prim_path(each.template)}
    stage = read_stage(path, variants={**scenario.variants, **dict(args.variant)}, extract=moved)
    check_templates(scenario, stage)
    templates = sorted({template.name for template in stage.templates} | set(catalog.templates()))
    low, high = stage.bounds()
    size = " x ".join(f"{length:.2f}" for length in np.subtract(high, low))
    print(f"{stage.name}  {path}")
    print(f"Size: {size} m (x, y, z), {stage.up_axis} up; {counted(triangle_count(stage), 'triangle')}")
    cameras = {name: path for path, name in stage.camera_names.items()} if args.paths else {}
    _section("Cameras", [_camera(camera, cameras.get(camera.name, camera.name)) for camera in stage.cameras])
    _section("Lights", [_light(light, light.prim_path if args.paths else light.name) for light in stage.lights])
    _section("Objects", path_lines(stage) if args.paths else object_lines(stage), len(stage.objects))
    _section("Templates", textwrap.wrap(", ".join(templates), MAX_WIDTH), len(templates))


def stage_file(source: str) -> Path:
    """Return the USD file of a scene, or of the scene of a scenario (.json)."""
    return catalog.find_scene(_scenario(source).scene)


def _scenario(source: str) -> Scenario:
    """Return a scenario (.json), or one of a scene alone."""
    path = catalog.find_scene(source)
    return Scenario.load(path) if path.suffix.lower() == ".json" else Scenario(str(path))


def check_templates(scenario: Scenario, stage: SceneDescription) -> None:
    """Check that there is a template for each object of a scenario that is not a prim of its stage.

    Raises:
        TemplateNotFound, MissingFile: There is none.
    """
    names = {each.spec.template for each in scenario.log().histories}
    for name in sorted(names - {template.name for template in stage.templates}):
        if not catalog.is_prim_path(name):
            catalog.find_template(name, scene=scenario.scene)


def triangle_count(stage: SceneDescription) -> int:
    """Return the number of triangles; those of a mesh count once for each of its instances."""
    return sum(len(stage.meshes[instance.mesh].triangles) for instance in stage.instances)


def _section(title: str, lines: list[str], count: int | None = None) -> None:
    print(f"{title} ({len(lines) if count is None else count}):")
    for line in lines:
        print(f"  {line}")


def _camera(camera: Camera, name: str) -> str:
    position = ", ".join(f"{component:.2f}" for component in camera.position)
    if camera.orthographic_height is not None:
        return f"{name}: at ({position}), orthographic, {camera.orthographic_height:.3g} m high"
    return f"{name}: at ({position}), {math.degrees(camera.vertical_fov):.0f} degrees high"


def _light(light: Light, name: str) -> str:
    kind = type(light).__name__.removesuffix("Light").lower()
    if isinstance(light, DistantLight):
        return f"{name}: {kind}, {max(light.irradiance):.3g} W/m²"
    radiance = getattr(light, "radiance", (0.0, 0.0, 0.0))
    textured = ", textured" if getattr(light, "texture", None) is not None else ""
    return f"{name}: {kind}{textured}, {max(radiance):.3g} W/m²/sr"


def path_lines(stage: SceneDescription) -> list[str]:
    """Return a line for each object with its prim path, name and category."""
    return [f"{each.prim_path}: {each.name}, {each.category or '(no category)'}" for each in stage.objects]


def object_lines(stage: SceneDescription) -> list[str]:
    """Return a line for each category with the names of its first objects."""
    names: dict[str, list[str]] = {}
    for item in stage.objects:
        names.setdefault(item.category or "(no category)", []).append(item.name)
    lines = []
    for category in sorted(names):
        members = sorted(names[category])
        more = [f"and {len(members) - MAX_NAMES} more"] if len(members) > MAX_NAMES else []
        lines.append(f"{category}: {', '.join(members[:MAX_NAMES] + more)}")
    return lines
