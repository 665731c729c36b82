# SPDX-License-Identifier: Apache-2.0
"""MaterialAnimation: the materials of a world that vary over time, by the time samples of its stage and templates."""

from __future__ import annotations

from collections.abc import Sequence

from tiscene.scene.description import Material, SceneDescription

PlacedMaterial = tuple[int, int, Material]


class MaterialAnimation:
    """The varying materials of a stage and its templates.

    Args:
        descriptions: the stage, then the templates; it may grow.
    """

    def __init__(self, descriptions: Sequence[SceneDescription]) -> None:
        self._descriptions = descriptions
        self._known: dict[tuple[int, int], tuple[tuple[int, float], Material]] = {}

    def at(self, seconds: float) -> tuple[PlacedMaterial, ...]:
        """Return the varying materials at a time (s), each with the row of its description and its own row in that.

        Unchanged materials are the same objects as at the last call.
        """
        return tuple(
            (number, track.row, self._material(number, description, place, seconds))
            for number, description in enumerate(self._descriptions)
            for place, track in enumerate(description.material_tracks)
        )

    def _material(self, number: int, description: SceneDescription, place: int, seconds: float) -> Material:
        track, key = description.material_tracks[place], (number, place)
        moment = track.moment(seconds)
        known = self._known.get(key)
        if known is None or known[0] != moment:
            known = self._known[key] = moment, track.applied(description.materials[track.row], moment)
        return known[1]

    @property
    def varies_stage_emission(self) -> bool:
        """Whether any of the stage's emissive materials varies."""
        return bool(emissive_rows(self._descriptions[0]))

    def stage_emission_at(self, seconds: float) -> tuple[PlacedMaterial, ...]:
        """Return the stage's materials whose emission varies, at a time (s)."""
        emissive = emissive_rows(self._descriptions[0])
        return tuple(each for each in self.at(seconds) if each[0] == 0 and each[1] in emissive) if emissive else ()


def varying_rows(description: SceneDescription) -> set[int]:
    """Return the rows of the materials of a description that vary over time."""
    return {track.row for track in description.material_tracks}


def emissive_rows(description: SceneDescription) -> set[int]:
    """Return the rows of the varying materials that are emissive at some time: their changes are changes of light."""
    dark = (0.0, 0.0, 0.0)
    return {
        track.row
        for track in description.material_tracks
        if any(color != dark for color in track.values("emissive_color"))
        or description.materials[track.row].emissive_color != dark
    }
