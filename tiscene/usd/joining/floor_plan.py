# SPDX-License-Identifier: Apache-2.0
"""RoomPlacement and Opening: where the rooms of a joined stage are, and the passages between them."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import flag, not_negative, number, position, positive, set_checked
from tiscene.scene.camera import Vector3
from tiscene.usd.core.semantics import scene_name


class RoomPlacement(NamedTuple):
    """A room of a joined stage. A plain tuple `(file, position)` is one too.

    Attributes:
        file: the USD stage of the room, or the name of a scene.
        position: where the room's origin is, m.
        yaw: rotation of the room about the up axis, degrees.
        name: name of the room, as in `frame.room`; "": that of the file, or of its folder for `kitchen/scene.usda`.
    """

    file: str | os.PathLike[str]
    position: Vector3 = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    name: str = ""

    @property
    def label(self) -> str:
        """The room's name."""
        return self.name or scene_name(Path(self.file))


@dataclass(frozen=True)
class Opening:
    """A passage through the walls between two rooms: a box out of which everything is cut.

    What is in the box is removed: parts of walls and tiles, a closed door's leaf. Floors are left as they are.

    Attributes:
        position: middle of the passage at the floor, m, in the joined stage.
        width: of the passage, m.
        height: of the passage, m.
        depth: thickness of all walls that the passage goes through, m.
        yaw: direction of the passage about the up axis, degrees; 0: along z (along y where Z is up).
        clearance: how far beyond `depth` the box reaches on both sides, m, to remove handles of doors.
        lined: whether jambs, head and threshold are added to cover the cut.

    Raises:
        ArgumentError: a value is out of range, or of another type.
    """

    position: Vector3
    width: float = 0.90
    height: float = 2.05
    depth: float = 0.45
    yaw: float = 0.0
    clearance: float = 0.09
    lined: bool = True

    def __post_init__(self) -> None:
        set_checked(self, position=position, width=positive, height=positive, depth=positive)
        set_checked(self, yaw=number, clearance=not_negative, lined=flag)

    def world_from_passage(self, up_axis: str) -> NDArray[np.float64]:
        """Return the 4x4 matrix from axes of the passage (x across, y up, z along it) to the stage's, in meters."""
        matrix = np.eye(4)
        matrix[:3, :3] = yaw_matrix(self.yaw, up_axis) @ (np.eye(3) if up_axis == "Y" else _Z_UP)
        matrix[:3, 3] = self.position
        return matrix

    def box(self, up_axis: str) -> NDArray[np.float64]:
        """Return the 4x4 matrix from the cube -1..1 to the box that is cut, in meters."""
        half = np.diag([self.width / 2.0, (self.height - _FLOOR) / 2.0, self.depth / 2.0 + self.clearance, 1.0])
        half[:3, 3] = 0.0, (self.height + _FLOOR) / 2.0, 0.0
        return np.asarray(self.world_from_passage(up_axis) @ half)


_FLOOR = 0.001  # m; what is lower is left as it is, for floors end at 0
_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # from y up to z up


def yaw_matrix(degrees: float, up_axis: str) -> NDArray[np.float64]:
    """Return the 3x3 rotation about the up axis, "Y" or "Z"."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    if up_axis == "Y":
        return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
