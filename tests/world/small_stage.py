# SPDX-License-Identifier: Apache-2.0
"""A stage small enough to work its worlds out by hand, and templates for it."""

from dataclasses import replace

import numpy as np

import tiscene as ts
from dynamics.rotation import matrix_from_quaternion, quaternion
from tiscene.errors import TemplateNotFound
from tiscene.scene.description import Instance, Mesh, SceneDescription, SceneObject, Template
from tiscene.world.world import World


def mesh(*corners: tuple[float, float, float]) -> Mesh:
    return Mesh("m", np.array(corners, np.float32), np.zeros((1, 3), np.int32), np.zeros(1, np.int32))


def at(x: float, y: float, z: float, rotation: tuple[float, ...] = (0, 0, 0), scale: float = 1.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_from_quaternion(quaternion(rotation)) * scale
    matrix[:3, 3] = x, y, z
    return matrix


UNIT_CUBE = mesh((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), (0, 0, 0))
FLOOR = mesh((-2, 0, -2), (2, 0, 2), (2, 0, -2))
CHAIR = Template(
    "Chair 01",
    "chair",
    SceneDescription(
        "Chair 01",
        (UNIT_CUBE, FLOOR),
        instances=(Instance(0, 0, at(0, 1, 0)), Instance(0, 0, at(0, 0.5, 0, scale=2.0)), Instance(1, 0, at(0, 0, 0))),
        objects=(SceneObject("chair", "/Chair", "ignored"),),
    ),
)
BALL = Template("Ball", "ball", SceneDescription("Ball", (UNIT_CUBE,), instances=(Instance(0, 0, np.eye(4)),)))
STAGE_BALL = Template("Ball", "toy", BALL.description)
EMPTY = Template("Empty", "nothing", SceneDescription("Empty"))
CATALOG = {"Chair 01": CHAIR, "Ball": BALL, "Empty": EMPTY}
STAGE = SceneDescription(
    "room",
    (FLOOR, UNIT_CUBE),
    # The lamp's two parts do not stand together; the cup has no mesh.
    instances=(
        Instance(1, 1, at(1, 2, 3, (0, 90, 0), 0.5)),
        Instance(0, 0, at(0, 0, 0)),
        Instance(1, 1, at(1, 3, 3)),
    ),
    objects=(SceneObject("Floor", "/Floor", "floor"), SceneObject("Lamp", "/Lamp", "lamp"), SceneObject("Cup", "/Cup")),
    cameras=(ts.Camera(name="Door"), ts.Camera(name="Window", position=(1, 2, 3))),
)
GO = ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), ts.Waypoint((4, 0, 0), (0, 90, 0))], total_time=8.0)


def load(name: str) -> Template:
    if name not in CATALOG:
        raise TemplateNotFound("template", name, CATALOG)
    return CATALOG[name]


def world(*objects: ts.Object, stage: SceneDescription = STAGE, fps: float = 10.0, **others: object) -> World:
    """Nothing collides in it, so that every pose is the path's; tests/world/test_collisions.py is about the others."""
    passing = [replace(each, collide=False) for each in objects]
    return World(ts.Scenario("room", passing, **others), stage, load, fps)
