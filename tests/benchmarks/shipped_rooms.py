# SPDX-License-Identifier: Apache-2.0
"""Shipped rooms as one scene description each, rendered by tiscene and Mitsuba; exactly alike if matte."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import peers
from tests.benchmarks.reference_pictures import Image, Render
from tests.benchmarks.room import static_placement
from tests.reference import mitsuba_scene
from tiscene.cli import demo
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.description import Instance, Light, Material, Mesh, SceneDescription, TextureLookup
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement
from tiscene.stream.stream import Stream

ROOMS = ("room_01", "room_02", "room_03")
MOVERS = 3


class Room(NamedTuple):
    """The room at one frame.

    Attributes:
        description: scene data with all instances where they are at that frame.
        moving: bool [n], which instances of a placement are movers.
        placement: function from a frame to its placement, whose mesh rows are those of the description.
    """

    description: SceneDescription
    moving: NDArray[np.bool_]
    placement: Callable[[int], Placement]


def still_room(name: str, *, matte: bool) -> Room:
    """Return a shipped room as it is, seen by its first camera.

    Args:
        name: name of the scene.
        matte: keep only diffuse color and uniform emission of materials.
    """
    return _room(Stream(name, buffers=("depth",)), 0, matte)


def living_room(frame: int, *, matte: bool) -> Room:
    """Return `room_02` with the first MOVERS objects of the demo at a frame.

    Args:
        frame: frame index.
        matte: as of `still_room`.
    """
    scenario = demo.scenario()
    few = replace(scenario, objects=scenario.objects[:MOVERS])
    return _room(Stream(few, fps=demo.FPS, buffers=("depth",)), frame, matte)


def _room(stream: Stream, frame: int, matte: bool) -> Room:
    """Return what a stream shows at a frame."""
    world = stream.world
    world.state(frame)  # loads templates
    meshes: list[Mesh] = []
    materials: list[Material] = []
    textures = list(world.stage.textures)
    for description in world.descriptions:
        first_material, first_texture = len(materials), len(textures)
        if description is world.stage:
            first_texture = 0
        else:
            textures += description.textures
        meshes += [replace(mesh, materials=mesh.materials + first_material) for mesh in description.meshes]
        shifted = [_with_texture_offset(material, first_texture) for material in description.materials]
        materials += [_matte(material) for material in shifted] if matte else shifted
    placement = world.state(frame).placement
    instances = []
    for row in np.flatnonzero(placement.present[1]):
        matrix = np.eye(4)
        matrix[:3] = placement.world_from_object[1, row]
        instances.append(Instance(int(placement.mesh[row]), 0, matrix))
    room = replace(
        world.stage,
        meshes=tuple(meshes),
        materials=tuple(materials),
        textures=tuple(textures),
        instances=tuple(instances),
        lights=tuple(_plain(light) for light in world.stage.lights),
        cameras=(world.camera,),
        templates=(),
        colliders=(),
    )
    return Room(room, world.state(frame).movers, lambda index: world.state(index).placement)


def tiscene(room: SceneDescription, width: int, height: int, depth: int) -> Render:
    """Return a function that renders the room with tiscene."""
    scene = DeviceScene()
    scene.add(room)
    scene.place(static_placement(room))
    camera = room.cameras[0]
    view = View(camera, camera, camera, width, height)
    paths = PathPass(scene, width, height)

    def render(spp: int, seed: int) -> tuple[Image, Image, Image]:
        image = paths.render(view, frame_index=0, seed=seed, spp=spp, max_depth=depth)
        return image.hdr, image.albedo, image.normal

    return render


def mitsuba(room: SceneDescription, width: int, height: int, depth: int, *, glossy: bool) -> Render | None:
    """Return a function that renders the room with Mitsuba's `path` (LLVM).

    Args:
        room: scene data.
        width: px.
        height: px.
        depth: path depth.
        glossy: use Mitsuba's `principled` instead of diffuse materials.

    Returns:
        The function, which also returns albedo and normal of the first hit. None if Mitsuba is not installed.
    """
    mi = peers.mitsuba()
    if mi is None:
        return None
    scene = mitsuba_scene.scene(
        mi, room, room.cameras[0], width, height, max_depth=depth, spp=4, glossy=glossy, guides=True
    )

    def render(spp: int, seed: int) -> tuple[Image, Image, Image]:
        channels = np.array(mi.render(scene, spp=spp, seed=seed), np.float32)
        return channels[..., :3], channels[..., 3:6], channels[..., 6:9]

    return render


def _with_texture_offset(material: Material, first_texture: int) -> Material:
    """Shift a material's texture rows. Textured emission is removed, since Mitsuba's meshes emit uniformly."""
    lookups = {
        field.name: replace(value, texture=value.texture + first_texture)
        for field in fields(material)
        if isinstance(value := getattr(material, field.name), TextureLookup) and value.texture >= 0
    }
    if "emissive_color" in lookups:
        return replace(material, **lookups | {"emissive_color": (0.0, 0.0, 0.0)})  # type: ignore[arg-type]
    return replace(material, **lookups)  # type: ignore[arg-type]


def _plain(light: Light) -> Light:
    """Return a light without what Mitsuba's have not: shaping, and factors for diffuse and glossy reflections."""
    name = "irradiance" if hasattr(light, "irradiance") else "radiance"
    scaled = {name: tuple(light.diffuse * each for each in getattr(light, name))}
    return replace(light, **scaled, diffuse=1.0, specular=1.0, indirect=1.0, shaping=None)  # type: ignore[arg-type]


def _matte(material: Material) -> Material:
    return Material(
        material.name, material.diffuse_color, emissive_color=material.emissive_color, roughness=1.0, ior=1.0
    )
