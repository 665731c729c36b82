# SPDX-License-Identifier: Apache-2.0
"""EmissiveMeshes: the light trees of the meshes of a scene, kept up to date while materials vary over time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from dynamics.weak_cache import weakly_cached
from tiscene.scene.description import Material, Mesh, SceneDescription
from tiscene.scene.lights.mesh_lights import MeshLight, build_mesh_light, mean_emission


class EmissiveMeshes:
    """The light trees of all meshes of a scene.

    Attributes:
        lights: By row of the mesh; None: nothing of it emits.
        varying: By row of the mesh, whether one of its materials varies over time.
    """

    def __init__(self) -> None:
        self.lights: list[MeshLight | None] = []
        self.varying: list[bool] = []
        self._descriptions: list[tuple[int, SceneDescription]] = []  # with the row of the first mesh
        self._emission: list[NDArray[np.float64]] = []  # mean luminance of each material, by description

    def add(self, description: SceneDescription) -> None:
        """Add the meshes of a description, whose rows continue those of earlier ones."""
        emission, lights = _authored(description)
        self._descriptions.append((len(self.lights), description))
        self._emission.append(emission.copy())
        self.lights += lights
        varying = [track.row for track in description.material_tracks]
        for mesh in description.meshes:
            self.varying.append(bool(varying) and bool(np.isin(mesh.materials, varying).any()))

    def place(self, materials: Iterable[tuple[int, int, Material]]) -> None:
        """Set varying materials, each with the row of its description and its own row in that."""
        changed: dict[int, list[int]] = {}
        for number, row, material in materials:
            emitted = mean_emission(material, self._descriptions[number][1].textures)
            if emitted != self._emission[number][row]:
                self._emission[number][row] = emitted
                changed.setdefault(number, []).append(row)
        for number, rows in changed.items():
            first, description = self._descriptions[number]
            for row, mesh in enumerate(description.meshes, first):
                if self.varying[row] and np.isin(mesh.materials, rows).any():
                    self.lights[row] = _mesh_light(mesh, self._emission[number])

    def of(self, meshes: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Return which meshes emit, given their rows."""
        emits = np.array([light is not None for light in self.lights], bool)
        result: NDArray[np.bool_] = emits[meshes]
        return result

    def ever_of(self, meshes: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Return which meshes emit, or may at another time, given their rows."""
        result: NDArray[np.bool_] = self.of(meshes) | np.array(self.varying, bool)[meshes]
        return result


@weakly_cached
def _authored(description: SceneDescription) -> tuple[NDArray[np.float64], list[MeshLight | None]]:
    """Return the mean luminance of each material, and the light tree of each mesh, as they are authored."""
    emission = np.array([mean_emission(material, description.textures) for material in description.materials])
    return emission, [_mesh_light(mesh, emission) for mesh in description.meshes]


def _mesh_light(mesh: Mesh, emission: NDArray[np.float64]) -> MeshLight | None:
    """Return the light tree of a mesh, given the mean luminance of each material of its description."""
    emitted = emission[mesh.materials] if len(emission) else np.zeros(0)
    return build_mesh_light(mesh, emitted) if emitted.any() else None
