"""`room_02` with three movers as one description of matte materials, which Mitsuba renders as well as tiscene does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.commands import demo
from tiscene.scene.description import Instance, Material, Mesh, SceneDescription, TextureLookup
from tiscene.stream import Stream

MOVERS = 3


def stream() -> Stream:
    """The room with the first things of the demo, all of its descriptions read."""
    scenario = demo.scenario()
    made = Stream(replace(scenario, objects=scenario.objects[:MOVERS]), fps=demo.FPS, buffers=("depth",))
    made.world.placement(0)
    return made


def matte_room(frame: int) -> tuple[SceneDescription, NDArray[np.bool_]]:
    """The room as it is at a frame, and which of its instances move."""
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
        materials += [_matte(material, first_texture) for material in description.materials]
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
    return room, world.moving(frame)[placement.present[1]]


def _matte(material: Material, first_texture: int) -> Material:
    """The diffuse colour alone, and what glows."""
    color, glow = material.diffuse_color, material.emissive_color
    if isinstance(color, TextureLookup):
        color = replace(color, texture=color.texture + first_texture)
    return Material(
        material.name, color, (0.0, 0.0, 0.0) if isinstance(glow, TextureLookup) else glow, roughness=1.0, ior=1.0
    )
