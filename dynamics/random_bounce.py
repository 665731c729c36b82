# SPDX-License-Identifier: Apache-2.0
"""UniformMovementRandomBounce: straight flight with a random new direction at every collision.

A `SteppedSimulation` moves such bodies; the collision response is in `dynamics.bounce_response`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynamics import argument_checks
from dynamics.dynamic import Dynamic, Vector


@dataclass(frozen=True)
class UniformMovementRandomBounce(Dynamic):
    """Straight flight at constant speed, without spin until the first hit, with random bounces.

    At a hit the body gets a new direction, uniform over the hemisphere about the contact normal, and a new angular
    velocity, uniform in the ball |w| <= `angular_speed`. Directions into anything it touches are drawn again. Random
    numbers depend only on `seed`, the body's name and the number of the hit. The motion never returns to its start, so
    timings that wait for a loop refuse it.

    Args:
        speed: m/s.
        angular_speed: Largest angular speed, rad/s.
        start_direction: Initial direction, world, of any length.
        seed: Any integer.
    """

    speed: float = 5.0
    angular_speed: float = 2.0
    start_direction: Vector = (0.0, 0.0, 1.0)
    seed: int = 42

    def __post_init__(self) -> None:
        object.__setattr__(self, "speed", argument_checks.not_negative(self.speed, "speed"))
        object.__setattr__(self, "angular_speed", argument_checks.not_negative(self.angular_speed, "angular_speed"))
        object.__setattr__(self, "start_direction", argument_checks.direction(self.start_direction, "start_direction"))
        object.__setattr__(self, "seed", argument_checks.whole(self.seed, "seed"))

    @property
    def loop_time(self) -> float:
        return math.inf
