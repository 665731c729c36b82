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


def pinhole_moves(view: View) -> bool:
    """Return whether the camera is a pinhole and moves, around a frame or at other times.

    A camera that stops is seen as it was while it moved: nothing else has to be traced first, and the picture does not
    change when it stops.
    """
    is_pinhole = view.current.lens_radius == 0.0 and view.current.orthographic_height is None
    return is_pinhole and (view.roams or bool(view.walks) or not view.rests)


def movers(state: WorldState) -> NDArray[np.bool_] | None:
    """Return which instances of a state move; None if its lights are not those of the stream's start.

    Args:
        state: of the world, at the frame to render.
    """
    return state.movers if state.starting_lights else None
