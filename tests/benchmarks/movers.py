# SPDX-License-Identifier: Apache-2.0
"""Moving objects that several benchmarks have in common."""

from __future__ import annotations

from collections.abc import Sequence

import tiscene as ts


def bouncing_movers(names: Sequence[str] = ("Chair 01", "Pillow 01", "Dish 01")) -> list[ts.Object]:
    """Return bouncing objects of some templates, side by side about the origin."""
    return [
        ts.Object(f"mover_{number}", name, (0.5 * number - 0.5, 0.8, 0.0), dynamic=ts.UniformMovementRandomBounce(0.8))
        for number, name in enumerate(names)
    ]
