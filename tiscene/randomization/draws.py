# SPDX-License-Identifier: Apache-2.0
"""Draws: uniform random numbers, each a pure function of (seed, object, purpose, attempt).

By the counter-based generator Philox (Salmon et al., "Parallel Random Numbers: As Easy as 1, 2, 3", 2011). One more
object, or another range of one quantity, changes no other number.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Draws:
    """Uniform random numbers of one object.

    Args:
        seed: 0 to 2^64 - 1.
        number: number of the object.
    """

    def __init__(self, seed: int, number: int) -> None:
        self._key = np.array([seed, number], np.uint64)

    def uniform(self, purpose: str, attempt: int, count: int = 1) -> Array:
        """Return `count` numbers in [0, 1). Of `purpose`, the first eight bytes count."""
        word = int.from_bytes(purpose.encode()[:8].ljust(8), "little")
        counter = np.array([0, attempt, word, 0], np.uint64)
        raw = np.random.Philox(key=self._key, counter=counter).random_raw(count)
        values: Array = (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return values

    def between(self, purpose: str, attempt: int, low: float, high: float) -> float:
        """Return one number from low to high."""
        return low + (high - low) * float(self.uniform(purpose, attempt)[0])

    def whole(self, purpose: str, attempt: int, low: int, high: int) -> int:
        """Return one whole number from low to high, both included."""
        return low + int(self.uniform(purpose, attempt)[0] * (high - low + 1))

    def either_side(self, purpose: str, size: tuple[float, float], attempt: int = 0) -> float:
        """Return a number of random sign whose size lies within a range. Of `purpose`, the first six bytes count."""
        sign = -1.0 if self.uniform(f"{purpose[:6]} -", attempt)[0] < 0.5 else 1.0
        return sign * self.between(purpose, attempt, *size)

    def direction(self, purpose: str, attempt: int) -> tuple[float, float, float]:
        """Return a unit vector, uniform over the sphere."""
        a, b = self.uniform(purpose, attempt, 2).tolist()
        height, angle = 1.0 - 2.0 * a, 2.0 * math.pi * b
        radius = math.sqrt(max(0.0, 1.0 - height * height))
        return (radius * math.cos(angle), radius * math.sin(angle), height)
