# SPDX-License-Identifier: Apache-2.0
"""A stage where everything moves while the shutter is open: a block that flies and turns, a lamp, and the camera.

Ours goes by scenario, world and shutter. For Mitsuba, which has no motion, everything is put by hand where it is at
moments of that time, and the reference is the mean of many still pictures.
"""

from dataclasses import replace

import mitsuba
import numpy as np
import trimesh
from numpy.typing import NDArray

import tiscene as ts
from tests.reference import mitsuba_scene
from tests.render.path_scenes import described, matte, quad
from tests.render.validation.compare import RUNS, SIZE, SPP, Agreement, Pictures, agreement
from tests.render.validation.stages import CAMERA
from tiscene.render.render_settings import RenderSettings
from tiscene.render.renderer import Renderer
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, Mesh, SceneDescription, SceneObject, SphereLight, Template
from tiscene.scene.device_scene import DeviceScene
from tiscene.stream.shutter import shutter_samples
from tiscene.world.world import World

FPS, FRAME = 25.0, 5
SHUTTER = (-0.25, 1.0)  # frames
DEPTH = 4
# Where things are at frames 0 and 10, between which they go straight: m, and rad about z.
BLOCK = (-2.4, 0.5, 0.2), (2.0, -0.4, 0.5)
TURN = 0.0, 2.6
LAMP = (-1.2, 1.6, 0.6), (1.6, 1.2, 1.2)
EYE = (-0.5, 0.4, 3.6), (0.6, 0.5, 3.2)
MOMENTS = 48  # of a reference picture


def at(ends: tuple[tuple[float, ...], ...], frame: float) -> NDArray[np.float64]:
    """The place at a frame."""
    start, end = np.array(ends)
    return np.asarray(start + (end - start) * frame / 10.0)


def placed(position: NDArray[np.float64], turn: float = 0.0) -> NDArray[np.float64]:
    """A matrix."""
    matrix = trimesh.transformations.rotation_matrix(turn, (0, 0, 1))
    matrix[:3, 3] = position
    return np.asarray(matrix)


def block() -> Mesh:
    """Its two ends are of different colors."""
    shape = trimesh.creation.box((0.9, 0.5, 0.3))
    right = shape.triangles_center[:, 0] > 0.0
    materials = np.where(right, 2, 3).astype(np.int32)
    return Mesh("block", shape.vertices.astype(np.float32), np.asarray(shape.faces, np.int32), materials)


def surroundings(frame: float) -> SceneDescription:
    """A floor, a wall and the lamp."""
    floor = quad((-3.0, -0.8, 3.0), (3.0, -0.8, 3.0), (3.0, -0.8, -3.0), (-3.0, -0.8, -3.0))
    wall = quad((-3.0, -0.8, -1.5), (3.0, -0.8, -1.5), (3.0, 3.0, -1.5), (-3.0, 3.0, -1.5), material=1)
    lamp = SphereLight("lamp", "/lamp", placed(at(LAMP, frame)), (5.0, 4.0, 3.0), 0.5)
    return described([floor, wall], COLORS, [lamp])


COLORS = [
    matte("floor", (0.5, 0.5, 0.5)),
    matte("wall", (0.6, 0.3, 0.2)),
    matte("right", (0.8, 0.8, 0.2)),
    matte("left", (0.1, 0.2, 0.6)),
]


def camera(frame: float) -> Camera:
    """Looking straight ahead."""
    return replace(CAMERA, position=tuple(at(EYE, frame).tolist()), rotation=(1.0, 0.0, 0.0, 0.0))


def path(ends: tuple[tuple[float, ...], ...], turns: tuple[float, float] = (0.0, 0.0)) -> ts.Keyframes:
    """From one place to the other in ten frames."""
    waypoints = [
        ts.Waypoint(place, (0.0, 0.0, float(np.degrees(turn)))) for place, turn in zip(ends, turns, strict=True)
    ]
    return ts.Keyframes((0.0, 10.0 / FPS), waypoints)


def our_pictures(shutter: tuple[float, float] = SHUTTER) -> Pictures:
    """With different seeds."""
    thing = SceneDescription(
        "block", (block(),), tuple(COLORS), instances=(Instance(0, 0, np.eye(4)),), objects=(SceneObject("b", "/b"),)
    )
    scenario = ts.Scenario(
        "stage",
        [ts.Object("block", "Block", dynamic=path(BLOCK, TURN), collide=False)],
        camera=replace(camera(0.0), dynamic=path(EYE)),
        lights=[ts.LightMotion("lamp", dynamic=path(LAMP))],
    )
    world = World(scenario, surroundings(0.0), lambda name: Template(name, "thing", thing), FPS)
    scene = DeviceScene()
    placement = world.state(FRAME).placement
    for description in world.descriptions:
        scene.add(description)
    renderer = Renderer(scene, SIZE, SIZE, RenderSettings(spp=SPP, max_depth=DEPTH, denoise=False))
    view = View(*world.state(FRAME).cameras[0], SIZE, SIZE)
    pictures = []
    for seed in range(RUNS):
        seen = shutter_samples(world, world.state(FRAME), view, shutter, spp=SPP, seed=seed, camera_row=0)
        assert seen is not None
        frame = renderer.render(view, placement, ("hdr",), frame_index=FRAME, seed=seed, exposure=0.0, moments=seen)
        pictures.append(frame["hdr"].mean(axis=2, dtype=np.float64))
    return np.array(pictures)


def mitsuba_pictures() -> Pictures:
    """Each of other moments, one at random in each equal part of the time."""
    mitsuba.set_variant("scalar_rgb")
    random = np.random.default_rng(7)
    opens, closes = SHUTTER
    pictures = []
    for _ in range(RUNS):
        total = np.zeros((SIZE, SIZE))
        for number in range(MOMENTS):
            time = FRAME + opens + (closes - opens) * (number + random.random()) / MOMENTS
            here = surroundings(time)
            pose = placed(at(BLOCK, time), TURN[0] + (TURN[1] - TURN[0]) * time / 10.0)
            here = replace(
                here,
                meshes=(*here.meshes, block()),
                instances=(*here.instances, Instance(2, 0, pose)),
            )
            scene = mitsuba_scene.scene(mitsuba, here, camera(time), SIZE, SIZE, max_depth=DEPTH, spp=4)
            total += np.array(mitsuba.render(scene, spp=4, seed=int(random.integers(1 << 31)))).mean(axis=2) / MOMENTS
        pictures.append(total)
    return np.array(pictures)


def agreement_of_pictures() -> Agreement:
    """Of the blurred pictures."""
    return agreement(our_pictures(), mitsuba_pictures())
