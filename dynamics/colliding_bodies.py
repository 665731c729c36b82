# SPDX-License-Identifier: Apache-2.0
"""Movers: bodies that may meet things; and what a stepped simulation says of them at a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.bodies import Body
from dynamics.sphere_proxy import Shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Teleport:
    """A mover is put elsewhere, at once, when a frame is reached. rotation: unit quaternion."""

    frame: int
    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


@dataclass(frozen=True)
class Mover:
    """A body that may meet things.

    shape: its proxy spheres; None: it passes through everything, and nothing meets it.
    limited: whether walls hold it.
    first_frame, last_frame: both inclusive; it meets things only while it is there. None: for ever.
    moves: in the order of their frames. What is Still stays there; what follows a path returns to it; what bounces goes
    on from there.
    """

    body: Body
    shape: Shape | None = None
    limited: bool = True
    first_frame: int = 0
    last_frame: int | None = None
    moves: tuple[Teleport, ...] = ()


@dataclass(frozen=True)
class Contact:
    """Something met something on the way to a frame.

    mover: its row. kind: "obstacle", "mover" or "wall". other: the row of the instance, mover or wall that it met.
    """

    mover: int
    kind: str
    other: int


@dataclass(frozen=True, eq=False)
class CollisionState:
    """All movers at one frame.

    poses: float64 [n, 7], position (m) and unit quaternion (w, x, y, z).
    arrivals: the same before the moves of this frame were done: where everything got to by itself.
    blocked: bool [n]: what follows a path was kept from it, and what bounces could not move for most of the way here.
    contacts: what was met on the way here from the frame before.
    """

    poses: Array
    arrivals: Array
    blocked: NDArray[np.bool_]
    contacts: tuple[Contact, ...]
