# SPDX-License-Identifier: Apache-2.0
"""Placement: transforms of all instances around one frame, the input of the renderer that changes with each frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Light
from tiscene.scene.lights.light_groups import LightGroups
from tiscene.scene.material_description import Material

PREVIOUS, CURRENT, NEXT = 0, 1, 2  # the frames k-1, k and k+1
MOVERS = 3  # names the tree over the dynamic objects alone, at CURRENT


@dataclass(frozen=True, eq=False)
class Placement:
    """Instances at the frames k-1, k and k+1, in the order of their ids. Times are axis 0 of arrays of shape [3, ...].

    Attributes:
        mesh: int32 [n], rows of the device scene's meshes.
        instance_id: int32 [n], instance label, 1 and up; parts of one object share it.
        category_id: int32 [n], semantic label; 0: none.
        world_from_object: float64 [3, n, 3, 4], m.
        box_from_object: float64 [n, 3, 4], from the mesh's space to its object's bounding box, 0..1.
        present: bool [3, n], whether the instance exists (is spawned, and not despawned yet).
        lights: Lights that are on, each with the row of the description (in the order of `DeviceScene.add`) whose
            textures it reads. None: those of the first description, unchanged.
        part: int32 [n], number of the first of its object's parts that the instance shows. None: 0 for all.
        seconds: float64 [3], the times of the frames, for deforming meshes, s.
        light_groups: The same lights, as static lights with an intensity factor for each group. None if `lights` is.
        materials: Materials that vary over time, each with the row of its description and its own row in that. None:
            none do.
        color: float32 [3, n, 4], RGB and opacity that take the place of those of the mesh's vertices; NaN where they do
            not. None: they never do.
    """

    mesh: NDArray[np.int32]
    instance_id: NDArray[np.int32]
    category_id: NDArray[np.int32]
    world_from_object: NDArray[np.float64]
    box_from_object: NDArray[np.float64]
    present: NDArray[np.bool_]
    lights: tuple[tuple[int, Light], ...] | None = None
    part: NDArray[np.int32] | None = None
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    light_groups: LightGroups | None = None
    materials: tuple[tuple[int, int, Material], ...] | None = None
    color: NDArray[np.float32] | None = None

    @property
    def light_factors(self) -> NDArray[np.float32]:
        """Intensity of each light group, float32 [groups, 3]; without groups, 1 for all lights together."""
        return np.ones((1, 3), np.float32) if self.light_groups is None else self.light_groups.factors

    @property
    def color_varies(self) -> bool:
        """Whether the color of some instance differs between the frames."""
        return self.color is not None and not np.array_equal(self.color[1:], self.color[:-1], equal_nan=True)

    def resembles(self, other: Placement) -> bool:
        """Return whether the instances are another placement's, with the same arrays, but for when they are present."""
        names = "mesh", "instance_id", "category_id", "world_from_object", "box_from_object", "part", "color"
        return all(getattr(self, name) is getattr(other, name) for name in names)

    def since(self, earlier: Placement) -> Placement:
        """Return this placement with PREVIOUS at the time of an earlier one, so that flow spans the frames between.

        Args:
            earlier: Placement of the same scene. Instances that it lacks are not present at that time.
        """
        _, rows, earlier_rows = np.intersect1d(self.keys(), earlier.keys(), return_indices=True)
        world_from_object, present = self.world_from_object.copy(), self.present.copy()
        seconds = np.array(self.seconds, np.float64)
        world_from_object[PREVIOUS, rows] = earlier.world_from_object[CURRENT, earlier_rows]
        present[PREVIOUS] = False
        present[PREVIOUS, rows] = earlier.present[CURRENT, earlier_rows]
        seconds[PREVIOUS] = earlier.seconds[CURRENT]
        color = self.color
        if color is not None and earlier.color is not None:
            color = color.copy()
            color[PREVIOUS, rows] = earlier.color[CURRENT, earlier_rows]
        return replace(self, world_from_object=world_from_object, present=present, seconds=seconds, color=color)

    def keys(self) -> NDArray[np.int64]:
        """Return a number for each instance, int64 [n], by its label and its place among those of that label."""
        order = np.argsort(self.instance_id, kind="stable")
        labels = self.instance_id[order].astype(np.int64)
        keys = np.empty(len(order), np.int64)
        keys[order] = (labels << 32) + np.arange(len(order)) - np.searchsorted(labels, labels)
        return keys

    def rows(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows of instances by their keys, int64 [n]; -1 for those that are not placed."""
        own = self.keys()
        order = np.argsort(own)
        places = np.minimum(np.searchsorted(own[order], keys), len(own) - 1)
        found: NDArray[np.int64] = np.where(own[order[places]] == keys, order[places], -1) if len(own) else keys * 0 - 1
        return found
