# SPDX-License-Identifier: Apache-2.0
"""Write what `python -m tests.gpu` needs: `python -m tests.gpu.bake [FOLDER]`.

Three scenes as arrays (`room_02` with three movers, the benchmark room, a closed sphere with a light) with labels and
colors as the CPU renders them, less than 12 MB together. Needs OpenUSD; reading them back needs taichi and numpy only.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from tests.benchmarks.room import room, static_placement
from tests.benchmarks.shipped_rooms import living_room
from tests.gpu.baked_scene import FOLDER_NAME, SPHERE, BakedScene, bake
from tiscene.device import runtime
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, Material, Mesh, SceneDescription, SceneObject, SphereLight

FRAMES = 8
LARGEST_TEXTURE = 128  # px


def scenes() -> Iterator[BakedScene]:
    """Bake the scenes one after the other."""
    living = living_room(0, matte=False)
    placements = tuple(living.placement(frame) for frame in range(FRAMES))
    yield bake("room_02", living.description, living.description.cameras[0], placements, living.moving, LARGEST_TEXTURE)
    yield _still("benchmark_room", room())
    yield _still(SPHERE, sphere())


def sphere() -> SceneDescription:
    """Return a closed white sphere around a small light, seen from inside."""
    mesh = trimesh.creation.icosphere(subdivisions=6, radius=1.0)
    shell = Mesh(
        "shell",
        np.asarray(mesh.vertices, np.float32),
        np.asarray(mesh.faces, np.int32),
        np.zeros(len(mesh.faces), np.int32),
    )
    return SceneDescription(
        SPHERE,
        meshes=(shell,),
        materials=(Material("white", diffuse_color=(0.5, 0.5, 0.5), ior=1.0),),
        lights=(SphereLight("bulb", "/bulb", np.eye(4), (10.0, 10.0, 10.0), 0.05),),
        instances=(Instance(0, 0, np.eye(4)),),
        objects=(SceneObject("shell", "/shell", "shell"),),
        cameras=(Camera(position=(0.3, 0.2, 0.5)),),
    )


def _still(name: str, description: SceneDescription) -> BakedScene:
    placement = static_placement(description)
    moving = np.zeros(len(placement.mesh), bool)
    return bake(name, description, description.cameras[0], (placement,), moving, LARGEST_TEXTURE)


def main(folder: Path = Path(FOLDER_NAME)) -> None:
    """Bake the scenes into a folder and print the sizes of the files."""
    runtime.start("cpu")
    folder.mkdir(parents=True, exist_ok=True)
    total = 0
    for scene in scenes():
        path = scene.save(folder)
        total += path.stat().st_size
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB", flush=True)
    print(f"{total / 1e6:.1f} MB")


if __name__ == "__main__":
    main(*(Path(each) for each in sys.argv[1:2]))
