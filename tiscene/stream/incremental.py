# SPDX-License-Identifier: Apache-2.0
"""Decide which frames are rendered incrementally: a base image of what never moves, corrected for the movers.

The decision depends on the frame alone: on its view, its lights and what is known to move. It never depends on how many
frames a stream has or which were rendered before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.render.view import View
from tiscene.world.world_state import WorldState


def is_static_view(view: View) -> bool:
    """Return whether the camera stands still around a frame."""
    return view.previous == view.current == view.next


def movers(state: WorldState, *, several_light_groups: bool = True) -> NDArray[np.bool_] | None:
    """Return which instances of a state move; None if its lights are not those of the stream's start.

    Args:
        state: of the world, at the frame to render.
        several_light_groups: whether lights that only change their intensity count as the same lights.
    """
    groups = state.placement.light_groups
    if not state.starting_lights or (not several_light_groups and groups is not None and len(groups.factors) > 1):
        return None
    return state.movers
