# SPDX-License-Identifier: Apache-2.0
"""`room_02` with three movers as one description, and what renders it: tiscene, and Mitsuba, exactly so if matte."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import peers
from tests.benchmarks.reference_pictures import Image, Render
from tests.benchmarks.room import still
from tests.reference import mitsuba_scene
from tiscene.cli import demo
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.description import Instance, Material, Mesh, SceneDescription, TextureLookup
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement
from tiscene.stream.stream import Stream

MOVERS = 3


class Room(NamedTuple):
    """description: as it is at a frame. moving: which of the instances of a placement do. placement: of a frame,
    whose rows of meshes are the description's."""

    description: SceneDescription
    moving: NDArray[np.bool_]
    placement: Callable[[int], Placement]


def stream() -> Stream:
    """The room with the first things of the demo, all of its descriptions read."""
    scenario = demo.scenario()
    made = Stream(replace(scenario, objects=scenario.objects[:MOVERS]), fps=demo.FPS, buffers=("depth",))
    made.world.placement(0)
    return made


def room(frame: int, *, matte: bool) -> Room:
    """The room as it is at a frame. matte: of materials the diffuse color alone, and what glows evenly."""
    world = stream().world
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
        moved = [_moved(material, first_texture) for material in description.materials]
        materials += [_matte(material) for material in moved] if matte else moved
    placement = world.placement(frame)
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
        cameras=(world.camera,),
        templates=(),
        colliders=(),
    )
    return Room(room, world.moving(frame), world.placement)


def tiscene(room: SceneDescription, width: int, height: int, depth: int) -> Render:
    """What renders it."""
    scene = DeviceScene()
    scene.add(room)
    scene.place(still(room))
    camera = room.cameras[0]
    view = View(camera, camera, camera, width, height)
    paths = PathPass(scene, width, height)

    def render(spp: int, seed: int) -> tuple[Image, Image, Image]:
        image = paths.render(view, frame_index=0, seed=seed, spp=spp, max_depth=depth)
        return image.hdr, image.albedo, image.normal

    return render


def mitsuba(room: SceneDescription, width: int, height: int, depth: int, *, glossy: bool) -> Render | None:
    """What renders it with Mitsuba's `path` (LLVM), and albedo and normal beside it; None where there is none."""
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


def _moved(material: Material, first_texture: int) -> Material:
    """With lookups in textures that begin at another row. What glows does so evenly: Mitsuba's meshes do."""
    lookups = {
        field.name: replace(value, texture=value.texture + first_texture)
        for field in fields(material)
        if isinstance(value := getattr(material, field.name), TextureLookup) and value.texture >= 0
    }
    if "emissive_color" in lookups:
        return replace(material, **lookups | {"emissive_color": (0.0, 0.0, 0.0)})  # type: ignore[arg-type]
    return replace(material, **lookups)  # type: ignore[arg-type]


def _matte(material: Material) -> Material:
    return Material(
        material.name, material.diffuse_color, emissive_color=material.emissive_color, roughness=1.0, ior=1.0
    )
