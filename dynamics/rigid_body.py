# SPDX-License-Identifier: Apache-2.0
"""RigidBody: what a physics engine needs to know of an object that falls, is pushed and comes to rest.

The engine is not part of this package: `tiscene.world.physics` simulates such bodies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynamics import argument_checks
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
        object.__setattr__(self, "density", argument_checks.positive(self.density, "density"))
        for name in ("friction", "restitution"):
            object.__setattr__(self, name, argument_checks.not_negative(getattr(self, name), name))
        for name in ("velocity", "angular_velocity"):
            object.__setattr__(self, name, argument_checks.vector(getattr(self, name), name))
        if self.restitution > 0.95:
            raise ArgumentError(f"restitution={self.restitution!r}: must be from 0 to 0.95")

    @property
    def loop_time(self) -> float:
        return math.inf
