# SPDX-License-Identifier: Apache-2.0
"""RigidBody: what a physics engine needs to know of an object that falls, is pushed and comes to rest.

The engine is not part of this package: `tiscene.world.physics` simulates such bodies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dynamics.argument_checks import flag, not_negative, optional, position, positive, rotation, set_checked, vector
from dynamics.dynamic import Dynamic, Vector
from dynamics.errors import ArgumentError


@dataclass(frozen=True)
class RigidBody(Dynamic):
    """A rigid body under gravity and contact forces, from its first frame on; timings do not apply to it.

    Args:
        density: kg/m3, of the convex parts of its shape. It has no effect on the mass if `mass` is given.
        friction: Coefficient of sliding friction; of two bodies in contact, the larger one counts.
        restitution: Speed after a bounce by speed before it, 0 to 0.95.
        velocity: Initial velocity, m/s, world.
        angular_velocity: Initial angular velocity, rad/s, world.
        mass: kg. None: by the density.
        center_of_mass: In the axes of the object, m, whatever its scale. None: that of its shape.
        diagonal_inertia: Moments of inertia about the center of mass, kg m2. None: those of its shape, in proportion
            to the mass.
        principal_axes: Axes of `diagonal_inertia` in those of the object; Euler angles in degrees, or a quaternion.
        starts_asleep: Whether it stays in its place, without its initial velocities, until it is touched by a body that
            moves. It has no effect on bodies that joints hold.

    Raises:
        ArgumentError: A value is out of range, such as moments of inertia that no body has.
    """

    density: float = 500.0
    friction: float = 0.6
    restitution: float = 0.0
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    mass: float | None = None
    center_of_mass: Vector | None = None
    diagonal_inertia: Vector | None = None
    principal_axes: tuple[float, ...] = (0.0, 0.0, 0.0)
    starts_asleep: bool = False

    def __post_init__(self) -> None:
        set_checked(self, density=positive, friction=not_negative, restitution=not_negative)
        set_checked(self, velocity=vector, angular_velocity=vector)
        set_checked(self, mass=optional(positive), center_of_mass=optional(position), principal_axes=rotation)
        set_checked(self, diagonal_inertia=optional(_moments), starts_asleep=flag)
        if self.restitution > 0.95:
            raise ArgumentError(f"restitution={self.restitution!r}: must be from 0 to 0.95")

    @property
    def loop_time(self) -> float:
        return math.inf


def _moments(value: Any, name: str) -> Vector:
    """Return moments of inertia about three axes, of which none is larger than the sum of the others."""
    result = vector(value, name)
    if min(result) <= 0.0:
        raise ArgumentError(f"{name}={value!r}: must be greater than 0")
    if 2.0 * max(result) > sum(result) * (1.0 + 1e-6):
        raise ArgumentError(f"{name}={value!r}: none may be larger than the sum of the others")
    return result
