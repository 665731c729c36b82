# SPDX-License-Identifier: Apache-2.0
"""UniformMovementRandomBounce: straight ahead, and off in a random direction at every collision."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynamics import argument_checks
from dynamics.dynamic import Dynamic, Vector


@dataclass(frozen=True)
class UniformMovementRandomBounce(Dynamic):
    """Flies straight at constant speed, without turning, until it hits something.

    At a hit it goes on in a new direction, uniform in the hemisphere about the normal of the contact, and with a new
    angular velocity, uniform in the ball |w| <= `angular_speed`; directions in which it would run into what it touches
    are drawn again. Random numbers depend on `seed`, the body's name and the number of the hit, and on nothing else.

    speed: m/s. angular_speed: rad/s, most. start_direction: world, of any length. seed: any whole number.
    It never returns to its start, so timings that wait for a loop refuse it.
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
