"""`room_02` with three movers as one description, which Mitsuba renders as well: exactly so in matte materials."""

from __future__ import annotations

from dataclasses import fields, replace

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


def room(frame: int, *, matte: bool) -> tuple[SceneDescription, NDArray[np.bool_]]:
    """The room as it is at a frame, and which of its instances move. matte: of materials the diffuse colour alone, and
    what glows evenly."""
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
    return room, world.moving(frame)[placement.present[1]]


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
