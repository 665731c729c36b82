# SPDX-License-Identifier: Apache-2.0
"""Motion blur against Mitsuba: a stage in which a block, a light and the camera move while the shutter is open.

tiscene renders a scenario. For Mitsuba, without motion, everything is posed explicitly at sampled times, and the
reference is the mean of many images.
"""

from dataclasses import replace

import mitsuba
import numpy as np
import trimesh
from numpy.typing import NDArray

import tiscene as ts
from tests.reference import mitsuba_scene
from tests.render.path_scenes import described, matte, quad
from tests.render.validation.compare import RUNS, SIZE, SPP, Agreement, Images, agreement
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
# Positions at frames 0 and 10, m, with linear motion between, and rotations about z, rad.
BLOCK = (-2.4, 0.5, 0.2), (2.0, -0.4, 0.5)
TURN = 0.0, 2.6
LAMP = (-1.2, 1.6, 0.6), (1.6, 1.2, 1.2)
EYE = (-0.5, 0.4, 3.6), (0.6, 0.5, 3.2)
TIMES = 48  # sampled times per reference image


def at(ends: tuple[tuple[float, ...], ...], frame: float) -> NDArray[np.float64]:
    """Return the position at a frame."""
    start, end = np.array(ends)
    return np.asarray(start + (end - start) * frame / 10.0)


def placed(position: NDArray[np.float64], turn: float = 0.0) -> NDArray[np.float64]:
    """Return a 4x4 matrix of a position and a rotation about z, rad."""
    matrix = trimesh.transformations.rotation_matrix(turn, (0, 0, 1))
    matrix[:3, 3] = position
    return np.asarray(matrix)


def block() -> Mesh:
    """Return a block whose halves have different colors."""
    shape = trimesh.creation.box((0.9, 0.5, 0.3))
    right = shape.triangles_center[:, 0] > 0.0
    materials = np.where(right, 2, 3).astype(np.int32)
    return Mesh("block", shape.vertices.astype(np.float32), np.asarray(shape.faces, np.int32), materials)


def surroundings(frame: float) -> SceneDescription:
    """Return a floor, a wall and the light at a frame."""
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
    """Return the camera at a frame, looking along -z."""
    return replace(CAMERA, position=tuple(at(EYE, frame).tolist()), rotation=(1.0, 0.0, 0.0, 0.0))


def path(ends: tuple[tuple[float, ...], ...], turns: tuple[float, float] = (0.0, 0.0)) -> ts.Keyframes:
    """Return a linear trajectory of ten frames.

    Args:
        ends: Start and end position, m.
        turns: Rotation about z at both, rad.
    """
    waypoints = [
        ts.Waypoint(place, (0.0, 0.0, float(np.degrees(turn)))) for place, turn in zip(ends, turns, strict=True)
    ]
    return ts.Keyframes((0.0, 10.0 / FPS), waypoints)


def tiscene_images(shutter: tuple[float, float] = SHUTTER) -> Images:
    """Render images with different seeds."""
    template = SceneDescription(
        "block", (block(),), tuple(COLORS), instances=(Instance(0, 0, np.eye(4)),), objects=(SceneObject("b", "/b"),)
    )
    scenario = ts.Scenario(
        "stage",
        [ts.Object("block", "Block", dynamic=path(BLOCK, TURN), collide=False)],
        camera=replace(camera(0.0), dynamic=path(EYE)),
        lights=[ts.LightMotion("lamp", dynamic=path(LAMP))],
    )
    world = World(scenario, surroundings(0.0), lambda name: Template(name, "object", template), FPS)
    scene = DeviceScene()
    placement = world.state(FRAME).placement
    for description in world.descriptions:
        scene.add(description)
    renderer = Renderer(scene, SIZE, SIZE, RenderSettings(spp=SPP, max_depth=DEPTH, denoise=False))
    view = View(*world.state(FRAME).cameras[0], SIZE, SIZE)
    images = []
    for seed in range(RUNS):
        samples = shutter_samples(world, world.state(FRAME), view, shutter, spp=SPP, seed=seed, camera_row=0)
        assert samples is not None
        frame = renderer.render(
            view, placement, ("hdr",), frame_index=FRAME, seed=seed, exposure=0.0, shutter_samples=samples
        )
        images.append(frame["hdr"].mean(axis=2, dtype=np.float64))
    return np.array(images)


def mitsuba_images() -> Images:
    """Render images at times stratified over the shutter interval."""
    mitsuba.set_variant("scalar_rgb")
    random = np.random.default_rng(7)
    opens, closes = SHUTTER
    images = []
    for _ in range(RUNS):
        total = np.zeros((SIZE, SIZE))
        for number in range(TIMES):
            time = FRAME + opens + (closes - opens) * (number + random.random()) / TIMES
            scene_now = surroundings(time)
            pose = placed(at(BLOCK, time), TURN[0] + (TURN[1] - TURN[0]) * time / 10.0)
            scene_now = replace(
                scene_now,
                meshes=(*scene_now.meshes, block()),
                instances=(*scene_now.instances, Instance(2, 0, pose)),
            )
            scene = mitsuba_scene.scene(mitsuba, scene_now, camera(time), SIZE, SIZE, max_depth=DEPTH, spp=4)
            total += np.array(mitsuba.render(scene, spp=4, seed=int(random.integers(1 << 31)))).mean(axis=2) / TIMES
        images.append(total)
    return np.array(images)


def motion_blur_agreement() -> Agreement:
    """Compare the blurred images."""
    return agreement(tiscene_images(), mitsuba_images())
