# SPDX-License-Identifier: Apache-2.0
"""RigidBody: what a physics engine needs to know of an object that falls, is pushed and comes to rest.

The engine is not part of this package: `tiscene.world.physics` simulates such bodies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynamics.argument_checks import not_negative, positive, set_checked, vector
from dynamics.dynamic import Dynamic, Vector
from dynamics.errors import ArgumentError


@dataclass(frozen=True)
class RigidBody(Dynamic):
    """A rigid body under gravity and contact forces, from its first frame on; timings do not apply to it.

    Args:
        density: kg/m3, of the convex parts of its shape.
        friction: Coefficient of sliding friction; of two bodies in contact, the larger one counts.
        restitution: Speed after a bounce by speed before it, 0 to 0.95.
        velocity: Initial velocity, m/s, world.
        angular_velocity: Initial angular velocity, rad/s, world.
    """

    density: float = 500.0
    friction: float = 0.6
    restitution: float = 0.0
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        set_checked(self, density=positive, friction=not_negative, restitution=not_negative)
        set_checked(self, velocity=vector, angular_velocity=vector)
        if self.restitution > 0.95:
            raise ArgumentError(f"restitution={self.restitution!r}: must be from 0 to 0.95")

    @property
    def loop_time(self) -> float:
        return math.inf
