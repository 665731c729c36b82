# SPDX-License-Identifier: Apache-2.0
"""A small world for tests of the engine: boxes and balls above a floor or a slope."""

from fractions import Fraction

import numpy as np

from dynamics import RigidBody
from dynamics.rotation import quaternion
from tiscene.world.physics.joint_tree import PhysicsJoint
from tiscene.world.physics.part_shapes import PartShape
from tiscene.world.physics.physics_model import PhysicsBody, Surroundings
from tiscene.world.physics.rigid_body_simulation import RigidBodySimulation

GRAVITY = (0.0, -9.81, 0.0)


def box(x, y, z):
    half = np.array([x, y, z])
    corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * half
    return PartShape("box", np.zeros(3), half, corners)


def ball(radius):
    return PartShape("sphere", np.zeros(3), np.full(3, radius), np.eye(3) * radius)


def pose(x=0.0, y=0.0, z=0.0, rotation=(0.0, 0.0, 0.0)):
    return np.array([x, y, z, *quaternion(rotation)])


class FakePhysicsWorld:
    """Rigid bodies, and movers with given poses, above static parts.

    Args:
        rigid: (part, pose, RigidBody) of each.
        static: (pose, part) of each.
        movers: (part, function of the time that returns a pose) of each.
        planes: walls, [6, 4].
        life: first and last frame of rigid bodies by number.
        moved: poses by frame and number.
        fps: frames per second.
        joined: (joint, number of the body, number of the other or None, frame, its frame) of each joint.
        filtered: (number of a body, "stage" or "body", number of the other) of what does not collide.
    """

    def __init__(self, rigid, static=(), movers=(), planes=None, life=None, moved=None, fps=25, joined=(), filtered=()):
        self.rigid, self.static, self.movers, self.planes = rigid, static, movers, planes
        self.life, self.moved, self.fps, self.joined = life or {}, moved or {}, fps, joined
        self.filtered = filtered

    def bodies(self, frame):
        count = len(self.rigid)
        here = [n for n in range(count) if self.life.get(n, (0, 10**9))[0] <= frame <= self.life.get(n, (0, 10**9))[1]]
        rigid = [PhysicsBody(n, [self.rigid[n][0]], self.rigid[n][2], True) for n in here]
        return [*rigid, *(PhysicsBody(count + n, [part], None, False) for n, (part, _) in enumerate(self.movers))]

    def joints(self, frame):
        here = {None, *(body.number for body in self.bodies(frame))}
        return [PhysicsJoint(n, *each) for n, each in enumerate(self.joined) if {each[1], each[2]} <= here]

    def filtered_pairs(self, frame):
        return self.filtered

    def surroundings(self, frame):
        placed = [(row, place, [part]) for row, (place, part) in enumerate(self.static)]
        return "always", lambda: Surroundings(placed, GRAVITY)

    def start(self, number):
        return self.rigid[number][1]

    def teleports(self, frame):
        return self.moved.get(frame, {})

    def arrival(self, frame, number):
        return self.movers[number - len(self.rigid)][1](frame / self.fps)

    def mover_poses(self, frame, numbers):
        chosen = [self.movers[number - len(self.rigid)][1] for number in numbers]
        return tuple(np.array([path((frame + step) / self.fps) for path in chosen]) for step in (0, 1))

    def walls(self, time):
        return self.planes

    def places_walls(self, frame):
        return False

    def simulation(self):
        return RigidBodySimulation(self, Fraction(self.fps))


def dropped(height=1.0, radius=0.1, **named):
    """Return a world with a ball above a floor at y = 0."""
    return FakePhysicsWorld([(ball(radius), pose(y=height), RigidBody(**named))], [(pose(y=-0.5), box(5, 0.5, 5))])
