"""Lighting: which lights there are at each frame, where, and how they shine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.camera import quaternion_from_matrix
from tiscene.errors import LightNotFound
from tiscene.light_motion import Color, LightMotion
from tiscene.scene.description import DistantLight, Light, SceneDescription

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Carried:
    """A light that an object of the scenario carries, since its template has one. object: its row."""

    object: int
    description: int
    light: Light


class Lighting:
    """The stage's lights, some with motions, and those that objects carry."""

    def __init__(self, stage: SceneDescription, motions: Sequence[LightMotion]) -> None:
        """Raises LightNotFound for a motion of a light that the stage has not."""
        self.stage = stage
        self.motions = [_row(stage, motion.light) for motion in motions]
        self._motions = dict(zip(self.motions, motions, strict=True))
        self._known: dict[tuple[int, int, int], tuple[bytes, Light]] = {}

    def poses(self) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
        """Where the lights that have motions stand on the stage: positions and quaternions."""
        result: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
        for row in self.motions:
            matrix = self.stage.lights[row].world_from_light
            result.append((tuple(matrix[:3, 3].tolist()), quaternion_from_matrix(matrix[:3, :3])))
        return result

    def at(
        self,
        time: float,
        matrices: Array,
        thing: Callable[[str], Array | None],
        carried: Sequence[Carried],
        objects: Sequence[Array | None],
    ) -> tuple[tuple[int, Light], ...]:
        """All lights at a time, s, each with the row of its description. One that has not changed is the same object.

        matrices: [m, 4, 4], of the lights with motions. thing: by a prim path, how the thing of the stage that the prim
        is part of has been moved since the beginning, [4, 4]; None if it is gone. objects: by row, where each object of
        the scenario is, None if it is not there.
        """
        result = []
        moved = dict(zip(self.motions, matrices, strict=True))
        for row, light in enumerate(self.stage.lights):
            by = thing(light.prim_path)
            if by is None:
                continue
            motion = self._motions.get(row)
            pose, shines = by @ light.world_from_light, _own(light)
            if motion is not None:
                pose = pose if motion.dynamic is None else moved[row]
                shines = motion.shines(time, shines)
            result.append((0, self._settled((-1, 0, row), light, pose, shines)))
        for number, each in enumerate(carried):
            where = objects[each.object]
            if where is not None:
                key = each.object, each.description, number
                pose = where @ each.light.world_from_light
                result.append((each.description, self._settled(key, each.light, pose, _own(each.light))))
        return tuple(result)

    def _settled(self, key: tuple[int, int, int], light: Light, pose: Array, shines: Color) -> Light:
        """The light with a pose and a radiance: the same object as the last time if nothing is new."""
        if np.array_equal(pose, light.world_from_light) and shines == _own(light):
            return light
        state = pose.tobytes() + np.array(shines).tobytes()
        known = self._known.get(key)
        if known is None or known[0] != state:
            emission: dict[str, Any] = {_emission(light): shines}
            known = self._known[key] = state, replace(light, world_from_light=pose, **emission)
        return known[1]


def _emission(light: Light) -> str:
    """The field that says how much a light shines."""
    return "irradiance" if isinstance(light, DistantLight) else "radiance"


def _own(light: Light) -> Color:
    color: Color = getattr(light, _emission(light))
    return color


def _row(stage: SceneDescription, name: str) -> int:
    for row, light in enumerate(stage.lights):
        if name in (light.prim_path, light.name):
            return row
    known = [light.prim_path for light in stage.lights]
    raise LightNotFound("light", name, known, f" in scene {stage.name!r}")
