# SPDX-License-Identifier: Apache-2.0
"""UniformMovementRandomBounce: straight flight with a random new direction at every collision.

A `SteppedSimulation` moves such bodies; the collision response is in `dynamics.bounce_response`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynamics.argument_checks import MAX_POSITION, direction, not_negative, set_checked, whole
from dynamics.dynamic import Dynamic, Vector
from dynamics.errors import ArgumentError


@dataclass(frozen=True)
class UniformMovementRandomBounce(Dynamic):
    """Straight flight at constant speed, without spin until the first hit, with random bounces.

    At a hit the body gets a new direction, uniform over the hemisphere about the contact normal, and a new angular
    velocity, uniform in the ball |w| <= `angular_speed`. Directions into anything it touches are drawn again. Random
    numbers depend only on `seed`, the body's name and the number of the hit. The motion never returns to its start, so
    timings that wait for a loop refuse it.

    Args:
        speed: m/s, at most 1e9.
        angular_speed: Largest angular speed, rad/s.
        start_direction: Initial direction, world, of any length.
        seed: Any integer.
    """

    speed: float = 5.0
    angular_speed: float = 2.0
    start_direction: Vector = (0.0, 0.0, 1.0)
    seed: int = 42

    def __post_init__(self) -> None:
        set_checked(self, speed=not_negative, angular_speed=not_negative, start_direction=direction, seed=whole)
        if self.speed > MAX_POSITION:
            raise ArgumentError(f"speed={self.speed!r}: must be at most {MAX_POSITION:g} m/s")

    @property
    def loop_time(self) -> float:
        return math.inf
