# SPDX-License-Identifier: Apache-2.0
"""Shapes that are found in the corners of convex hulls, and how they roll."""

import math

import numpy as np
import pytest

pytest.importorskip("mujoco")

from dynamics import RigidBody
from tests.world.physics.fake_physics_world import FakePhysicsWorld, box, pose
from tiscene.world.physics.part_shapes import shape_of

RADIUS, HEIGHT = 0.1, 0.3
AROUND = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
RIM = RADIUS * np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)


def turned(rows, axis):
    """Return points [n, 3] whose first coordinate becomes that along an axis."""
    return np.roll(rows, axis, axis=1)


def prism(axis, ends=(RADIUS, RADIUS)):
    """Return the corners of a cylinder, or of a cone with other radii at its ends."""
    parts = [
        np.insert(RIM * radius / RADIUS, 0, side * HEIGHT, axis=1) for side, radius in zip((-1, 1), ends, strict=True)
    ]
    return turned(np.unique(np.concatenate(parts), axis=0), axis)


def capsule(axis):
    rings = [
        (side * (HEIGHT - RADIUS + RADIUS * math.sin(t)), math.cos(t)) for side in (-1, 1) for t in (0, 0.5, 1, 1.5708)
    ]
    parts = [np.insert(RIM * width, 0, along, axis=1) for along, width in rings]
    return turned(np.concatenate(parts), axis)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("kind", "make"), [("cylinder", prism), ("capsule", capsule)])
def test_round_shape_is_found_along_each_axis(kind, make, axis):
    center = np.array([1.0, 2.0, 3.0])
    shape = shape_of(make(axis) + center, 0.002)
    assert (shape.kind, shape.axis) == (kind, axis)
    np.testing.assert_allclose(shape.center, center)
    np.testing.assert_allclose(np.roll(shape.half, -axis), (HEIGHT, RADIUS, RADIUS), atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_cone_is_a_hull(axis):
    """The engine has no cones."""
    assert shape_of(prism(axis, (RADIUS, 0.0)), 0.002).kind == "hull"
    assert shape_of(prism(axis, (RADIUS, 0.5 * RADIUS)), 0.002).kind == "hull"


@pytest.mark.parametrize("make", [prism, capsule])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_round_body_rolls_down_a_slope_with_the_acceleration_of_its_inertia(make, axis):
    """A hull of 32 sides is slower, and a cylinder about a wrong axis slides or stands."""
    angle = math.radians(10.0)
    part = shape_of(make(axis), 0.002)
    across = {0: (0.0, 90.0, 0.0), 1: (90.0, 0.0, 0.0), 2: (0.0, 0.0, 0.0)}[axis]  # to z
    up = np.array([-math.sin(angle), math.cos(angle), 0.0])
    slope = pose(*(-0.5 * up), (0.0, 0.0, 10.0)), box(20, 0.5, 2)
    simulation = FakePhysicsWorld([(part, pose(*(RADIUS * up), across), RigidBody())], [slope]).simulation()
    if make is prism:
        share = 0.5
    else:  # half-spheres beside a cylinder
        cylinder, ball = 2.0 * (HEIGHT - RADIUS), 4.0 / 3.0 * RADIUS
        share = (0.5 * cylinder + 0.4 * ball) / (cylinder + ball)
    rate = 9.81 * math.sin(angle) / (1.0 + share)
    moved = np.linalg.norm(simulation.frame(50).poses[0, :3] - simulation.frame(0).poses[0, :3])
    assert moved == pytest.approx(0.5 * rate * 2.0**2, rel=0.02)
