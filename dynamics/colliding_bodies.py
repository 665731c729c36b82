# SPDX-License-Identifier: Apache-2.0
"""Input and output of a stepped simulation: colliding bodies (`Mover`), and their state at a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import position
from dynamics.bodies import Body
from dynamics.sphere_proxy import Shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Teleport:
    """A sudden move of a mover to another pose.

    Args:
        frame: Frame at which the mover is at the new pose.
        position: Meters.
        rotation: Unit quaternion (w, x, y, z).
    """

    frame: int
    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


@dataclass(frozen=True)
class Mover:
    """A body that may collide.

    Args:
        body: The body and its trajectory.
        shape: Its proxy spheres; None: it collides with nothing.
        limited: Whether walls hold it.
        first_frame: First frame at which it exists and collides.
        last_frame: Last such frame; None: forever.
        moves: Teleports in the order of their frames. After one, a static body stays there, a body on a path returns to
            its path, and a bouncing body continues from there. A list may grow; see `SteppedSimulation.amend`.

    Raises:
        ArgumentError: For a body that is placed too far away.
    """

    body: Body
    shape: Shape | None = None
    limited: bool = True
    first_frame: int = 0
    last_frame: int | None = None
    moves: Sequence[Teleport] = ()

    def __post_init__(self) -> None:
        position(self.body.position, f"position of {self.body.name!r}")


@dataclass(frozen=True)
class Contact:
    """A contact of a mover on the way from the previous frame.

    Attributes:
        mover: Number of the mover.
        kind: "obstacle", "mover" or "wall".
        other: Number of the instance, mover or wall that it touched.
    """

    mover: int
    kind: str
    other: int


@dataclass(frozen=True, eq=False)
class CollisionState:
    """The movers at one frame.

    Attributes:
        numbers: Ascending numbers of the n movers.
        poses: float64 [n, 7], position (meters) and unit quaternion (w, x, y, z).
        arrivals: The same before the teleports of this frame.
        blocked: bool [n], whether a body on a path was kept from it, or a bouncing body could not move for most of the
            time since the previous frame.
        contacts: Contacts since the previous frame.
    """

    numbers: tuple[int, ...]
    poses: Array
    arrivals: Array
    blocked: NDArray[np.bool_]
    contacts: tuple[Contact, ...]
