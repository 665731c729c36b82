# SPDX-License-Identifier: Apache-2.0
"""WorldLights: poses and radiance of all lights at each frame, and their groups by intensity."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion, quaternion
from tiscene.errors import LightNotFound, ScenarioError, StageWarning
from tiscene.scenario.light_motion import Color, LightMotion
from tiscene.scene.camera import quaternion_from_matrix
from tiscene.scene.description import DistantLight, DomeLight, Light, SceneDescription
from tiscene.scene.input_track import InputTrack, by_row
from tiscene.scene.lights.light_groups import LightGroups, emission_of, with_emission

Array = NDArray[np.float64]
# Each group needs a base image of its own. From this number on lights are not grouped.
TOO_MANY_GROUPS = 8


def with_light(stage: SceneDescription, templates: Iterable[SceneDescription]) -> SceneDescription:
    """Return a stage with a sky and a sun if neither it nor any template has a light or an emissive material.

    A stage whose lights are all off is dark on purpose.
    """
    if any(not each.is_dark or each.has_lights_off for each in (stage, *templates)):
        return stage
    return replace(stage, lights=_DEFAULT[stage.up_axis])


def warn_if_dark(scene: str, descriptions: Sequence[SceneDescription]) -> None:
    """Warn if the lights of a stage are those of `with_light`, or off; descriptions: the stage, then templates."""
    stage = descriptions[0]
    if all(each.is_dark for each in descriptions):
        text = f"{scene}: all of its lights are off or invisible, so it is dark. Turn one on, or remove them all."
        warnings.warn(StageWarning(text), stacklevel=3)
    elif stage.lights is _DEFAULT[stage.up_axis]:
        text = (
            f"{scene}: there is no light, so a white sky and a sun light it. For another light, add one to the stage "
            "(such as a DomeLight) or spawn a lamp."
        )
        warnings.warn(StageWarning(text), stacklevel=3)


def _default_lights(up_axis: str) -> tuple[Light, ...]:
    """Return a white sky, and a sun from the upper left of the camera that sees a whole stage by default."""
    sky, sun = np.eye(4), np.eye(4)
    sun[:3, :3] = matrix_from_quaternion(quaternion((-50.0, -10.0, 0.0)))
    if up_axis == "Z":
        sun[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) @ sun[:3, :3]
    white, irradiance = (1.0, 1.0, 1.0), (3.0, 3.0, 3.0)
    # No prim of a stage has such a path.
    return DomeLight("Sky", "Sky", sky, white), DistantLight("Sun", "Sun", sun, irradiance, math.radians(3.0))


_DEFAULT = {up_axis: _default_lights(up_axis) for up_axis in ("Y", "Z")}
_NOW, _BRIGHTEST = -1, -2  # cache keys of the stage's lights, in place of an object's row


@dataclass(frozen=True)
class AttachedLight:
    """A light of an object's template, which moves with the object.

    Attributes:
        object: row of the object.
        number: index among the object's lights.
        description: row of the template's description.
        light: the light, in the object's axes.
        track: how its inputs vary over time; None: they do not.
    """

    object: int
    number: int
    description: int
    light: Light
    track: InputTrack | None = None


class WorldLights:
    """The stage's lights, some of them with a LightMotion, and the lights attached to objects.

    Args:
        stage: the stage.
        motions: motions of the stage's lights.

    Raises:
        LightNotFound: a motion names a light that the stage does not have.
        ScenarioError: two motions are of one light, by its name and by its path.
    """

    def __init__(self, stage: SceneDescription, motions: Sequence[LightMotion]) -> None:
        self.stage = stage
        self.motions = [light_row(stage, motion.light) for motion in motions]
        for number, row in enumerate(self.motions):
            if row in self.motions[:number]:
                path = stage.lights[row].prim_path
                raise ScenarioError(f"lights[{number}].light={motions[number].light!r}: {path} has a motion already")
        self._motions = dict(zip(self.motions, motions, strict=True))
        self._rows = {light.prim_path: row for row, light in enumerate(stage.lights)}
        self._replaced: dict[int, Light] = {}
        self._known: dict[tuple[int, int, int], tuple[bytes, Light]] = {}
        self._tracks = by_row(stage.light_tracks)
        self._sampled: dict[tuple[int, int, int], tuple[tuple[int, float], Light]] = {}

    @property
    def has_changes(self) -> bool:
        """Whether a light of the stage moves or varies over time, or `replace_light` was called."""
        return bool(self.motions or self._tracks or self._replaced)

    @property
    def replaced(self) -> dict[int, Light]:
        """The lights of `replace_light`, by row."""
        return dict(self._replaced)

    def replace_light(self, row: int, light: Light) -> None:
        """Replace the stage's light in that row by another of the same kind."""
        self._replaced = dict(sorted((self._replaced | {row: light}).items()))
        for key in ((_NOW, 0, row), (_BRIGHTEST, 0, row)):
            self._known.pop(key, None)

    def poses(self) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
        """Return the authored positions and quaternions of the lights with motions."""
        result: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
        for row in self.motions:
            matrix = self.stage.lights[row].world_from_light
            result.append((tuple(matrix[:3, 3].tolist()), quaternion_from_matrix(matrix[:3, :3])))
        return result

    def at(
        self,
        time: float,
        matrices: Array,
        edited: Callable[[str], Array | None],
        carried: Sequence[AttachedLight],
        objects: Mapping[int, Array],
    ) -> tuple[tuple[int, Light], ...]:
        """Return all lights at a time, each with the row of its description. Unchanged lights are the same objects.

        Args:
            time: s.
            matrices: float64 [m, 4, 4], poses of the lights with motions.
            edited: returns by prim path the 4x4 matrix by which edits moved the object that the prim is part of; None
                if it was removed.
            carried: lights attached to objects.
            objects: poses of live objects of the scenario, 4x4, by row.
        """
        result = []
        moved = dict(zip(self.motions, matrices, strict=True))
        for row, authored in enumerate(self.stage.lights):
            light: Light | None = self._replaced.get(row)
            if light is None:
                light = self._at((_NOW, 0, row), authored, self._tracks.get(row), time)
            by = None if light is None else edited(light.prim_path)
            if light is None or by is None:
                continue
            motion = self._motions.get(row)
            pose, emission = by @ light.world_from_light, emission_of(light)
            if motion is not None:
                pose = pose if motion.dynamic is None else moved[row]
                emission = motion.radiance_at(time, emission)
            result.append((0, self._settled((_NOW, 0, row), light, pose, emission)))
        if len(self._known) > 2 * (2 * len(self.stage.lights) + len(carried)):
            self._known = {key: each for key, each in self._known.items() if key[0] < 0 or key[0] in objects}
            self._sampled = {key: each for key, each in self._sampled.items() if key[0] < 0 or key[0] in objects}
        for each in carried:
            where = objects.get(each.object)
            key = each.object, each.description, each.number
            light = None if where is None else self._at(key, each.light, each.track, time)
            if where is not None and light is not None:
                pose = where @ light.world_from_light
                result.append((each.description, self._settled(key, light, pose, emission_of(light))))
        return tuple(result)

    def _at(self, key: tuple[int, int, int], light: Light, track: InputTrack | None, time: float) -> Light | None:
        """Return a light with its inputs at a time; None if it is off. An unchanged one is the same object."""
        if track is None:
            return light
        moment = track.moment(time)
        if not track.is_present(moment):
            return None
        known = self._sampled.get(key)
        if known is None or known[0] != moment:
            known = self._sampled[key] = moment, track.applied(light, moment)
        return known[1]

    def groups(self, lights: Sequence[tuple[int, Light]]) -> LightGroups:
        """Group the result of `at` by common changes of intensity; a single group if there would be too many."""
        numbers: dict[Any, int] = {}
        steady, group, factors = [], [], []
        for description, light in lights:
            row = self._rows.get(light.prim_path, -1) if description == 0 else -1
            motion = self._motions.get(row)
            number, now, most = 0, emission_of(light), emission_of(light)
            if row in self._replaced or (motion is not None and motion.times):
                way: Any = row
                most = emission_of(self.stage.lights[row])
                if motion is not None and motion.times:
                    most = motion.max_radiance(most)
                    if row not in self._replaced:
                        way = motion.times, motion.intensity, motion.color, motion.radiance, motion.repeat
                r, g, b = (b if b > 0.0 else a for a, b in zip(now, most, strict=True))
                most = r, g, b
                number = numbers.setdefault(way, len(numbers) + 1)
                light = self._settled((_BRIGHTEST, 0, row), light, light.world_from_light, most)
            steady.append((description, light))
            group.append(number)
            factors.append([a / b if b > 0.0 else 0.0 for a, b in zip(now, most, strict=True)])
        if len(numbers) >= TOO_MANY_GROUPS:
            return LightGroups(tuple(lights), (0,) * len(lights), np.ones((1, 3), np.float32))
        of_groups = np.zeros((len(numbers) + 1, 3), np.float32)
        np.maximum.at(of_groups, np.array(group, np.int32), np.array(factors, np.float32).reshape(-1, 3))
        of_groups[0] = 1.0
        return LightGroups(tuple(steady), tuple(group), of_groups)

    def _settled(self, key: tuple[int, int, int], light: Light, pose: Array, emission: Color) -> Light:
        """Return the light with a pose and a radiance; the same object as before if nothing of it has changed."""
        if np.array_equal(pose, light.world_from_light) and emission == emission_of(light):
            return light
        sampled = self._sampled.get((_NOW, *key[1:]) if key[0] < 0 else key)
        moment = (0, 0.0) if sampled is None else sampled[0]
        state = pose.tobytes() + np.array([*emission, *moment]).tobytes()
        known = self._known.get(key)
        if known is None or known[0] != state:
            known = self._known[key] = state, with_emission(replace(light, world_from_light=pose), emission)
        return known[1]


def same_lights(a: LightGroups, b: LightGroups) -> bool:
    """Return whether two groupings hold the same lights, whatever their intensity factors are."""
    pairs = zip(a.lights, b.lights, strict=False)
    return len(a.lights) == len(b.lights) and a.group == b.group and all(_equal(x, y) for x, y in pairs)


def _equal(a: tuple[int, Light], b: tuple[int, Light]) -> bool:
    if a[1] is b[1]:
        return a[0] == b[0]
    names = [field.name for field in fields(a[1])]
    same = type(a[1]) is type(b[1]) and a[0] == b[0]
    return same and all(np.array_equal(getattr(a[1], name), getattr(b[1], name)) for name in names)


def light_row(stage: SceneDescription, name: str) -> int:
    """Return the row of a stage's light by its path or name. Raises LightNotFound."""
    for row, light in enumerate(stage.lights):
        if name in (light.prim_path, light.name):
            return row
    known = [light.prim_path for light in stage.lights]
    raise LightNotFound("light", name, known, f" in scene {stage.name!r}")
