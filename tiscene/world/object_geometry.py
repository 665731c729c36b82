# SPDX-License-Identifier: Apache-2.0
"""ObjectGeometry: parts, box, animation and lights that all objects of one template and scale share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import ColorTrack, InstanceTrack
from tiscene.scene.assembly import ObjectParts, box_matrices, corners, instance_colors
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Light, Matrix, SceneDescription, bounding_box
from tiscene.scene.input_track import InputTrack, by_row
from tiscene.world.stage_animation import AnimatedInstances, box_over_time, changing, scaled


@dataclass(frozen=True, eq=False)
class ObjectGeometry:
    """A template at a scale, in the axes of its objects.

    Attributes:
        description: row of the template's description.
        parts: its meshes; `owner` is 0.
        box: lowest and highest corner around all parts, m.
        tracks: authored animation of the parts.
        color_tracks: how colors of some parts vary.
        changing: bool [parts], whether a part is animated or deforms.
        lights: its lights.
        light_tracks: how some of them vary over time, by their places in `lights`.
    """

    description: int
    parts: ObjectParts
    box: tuple[Vector3, Vector3]
    tracks: tuple[InstanceTrack, ...]
    color_tracks: tuple[ColorTrack, ...]
    changing: NDArray[np.bool_]
    lights: tuple[Light, ...]
    light_tracks: Mapping[int, InputTrack]

    @classmethod
    def of(cls, description: SceneDescription, row: int, first_mesh: int, scale: Vector3) -> ObjectGeometry:
        """Scale a template about its origin.

        Args:
            description: of the template.
            row: its row.
            first_mesh: row of its first mesh among the meshes of all descriptions.
            scale: factors along its axes. Lights move with it, but keep their size.
        """
        matrix = np.diag([*scale, 1.0])
        own = [matrix @ instance.world_from_object for instance in description.instances]
        meshes = [instance.mesh for instance in description.instances]
        tracks = tuple(scaled(track, matrix) for track in description.tracks)
        if tracks:
            animated = AnimatedInstances(np.array(own)[:, :3], [(track.instances, track) for track in tracks])
            box = box_over_time(description, meshes, animated.over_time(np.arange(len(own))))
        else:
            box = bounding_box(description, meshes, own)
        parts = ObjectParts(
            np.array(meshes, dtype=np.int32) + first_mesh,
            np.zeros(len(meshes), dtype=np.int32),
            np.array([each[:3] for each in own]),
            box_matrices(np.tile(box, (len(own), 1, 1)), np.array(own)),
            np.array([instance.part for instance in description.instances], dtype=np.int32),
            instance_colors(description),
        )
        lights = tuple(
            replace(light, world_from_light=_scaled(light.world_from_light, scale)) for light in description.lights
        )
        light_tracks = by_row(
            each.mapped("world_from_light", lambda pose: _scaled(pose, scale)) for each in description.light_tracks
        )
        colors = description.color_tracks
        return cls(row, parts, corners(box), tracks, colors, changing(description), lights, light_tracks)


def _scaled(pose: Matrix, scale: Vector3) -> Matrix:
    result = pose.copy()
    result[:3, 3] *= scale
    return result
