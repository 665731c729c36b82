# SPDX-License-Identifier: Apache-2.0
"""AnimatedInstances: parts that move, appear and vanish by time samples. ColoredInstances: their colors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.affine_maps import inverted
from tiscene.scene.animation import ColorTrack, InstanceTrack
from tiscene.scene.description import SceneDescription, bounding_box
from tiscene.world.material_animation import emissive_rows, varying_rows

Array = NDArray[np.float64]
_TOLERANCE = 1e-9  # m, and fraction: what rounding changes in where parts are in their objects


class AnimatedInstances:
    """Parts of a world, or its objects, some of which are animated.

    Args:
        matrices: float64 [p, 3, 4], authored matrices of the parts.
        tracks: the animation, each track with the rows of the parts that it moves.

    Attributes:
        authored: the matrices.
        rows: int64, the animated parts.
    """

    def __init__(self, matrices: Array, tracks: Iterable[tuple[NDArray[np.integer], InstanceTrack]] = ()) -> None:
        self.authored = matrices
        self._tracks = list(tracks)
        self.rows = np.concatenate([np.zeros(0, np.int64), *(rows for rows, _ in self._tracks)])

    def __bool__(self) -> bool:
        return bool(self._tracks)

    def at(self, seconds: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return the matrices [p, 3, 4] and the presence [p] of all parts at a time (s)."""
        present = np.ones(len(self.authored), np.bool_)
        if not self._tracks:
            return self.authored, present
        matrices = self.authored.copy()
        for rows, track in self._tracks:
            matrices[rows], present[rows] = track.at(seconds)
        return matrices, present

    def times(self, rows: NDArray[np.integer]) -> list[float]:
        """Return the times, s, ascending, at which one of some parts has a sample."""
        tracks = [track for own, track in self._tracks if np.isin(own, rows).any()]
        return sorted({time for track in tracks for time in track.times.tolist()})

    def over_time(self, rows: NDArray[np.integer]) -> list[tuple[Array, NDArray[np.bool_]]]:
        """Return matrices and presence of some parts at `times`."""
        moments = (self.at(time) for time in self.times(rows))
        return [(matrices[rows], present[rows]) for matrices, present in moments]


class ColoredInstances:
    """Parts of a world, some of which have colors of their own. False if none has.

    Args:
        colors: float32 [p, 4], as of `instance_colors`.
        tracks: how some vary, each with the rows of the parts.
    """

    def __init__(
        self, colors: NDArray[np.float32], tracks: Iterable[tuple[NDArray[np.integer], ColorTrack]] = ()
    ) -> None:
        self._authored = colors
        self._tracks = list(tracks)
        self._is_colored = not np.isnan(colors).all()

    def __bool__(self) -> bool:
        return self._is_colored

    def at(self, seconds: float) -> NDArray[np.float32]:
        """Return the colors [p, 4] of all parts at a time (s)."""
        colors = self._authored.copy()
        for rows, track in self._tracks:
            colors[rows] = track.at(seconds)
        return colors


def changing_within(parts: AnimatedInstances, objects: AnimatedInstances, owner: NDArray[np.int32]) -> list[int]:
    """Return the rows of the objects whose parts move within them, ascending.

    Args:
        parts: the parts.
        objects: the objects.
        owner: int32 [p], row of each part's object.
    """
    rows = np.unique(parts.rows)
    own = owner[rows]
    changed, first = np.zeros(len(rows), np.bool_), None
    for time in parts.times(rows):
        matrices, present = (each[rows] for each in parts.at(time))
        into = inverted(objects.at(time)[0])[0][own]
        now = np.einsum("pij,pjk->pik", into[:, :, :3], matrices)
        now[:, :, 3] += into[:, :, 3]
        first = now if first is None else first
        changed |= present & (np.abs(now - first) > _TOLERANCE * (1.0 + np.abs(first))).any(axis=(1, 2))
    result: list[int] = np.unique(own[changed]).tolist()
    return result


def changing(description: SceneDescription, is_stage: bool = False) -> NDArray[np.bool_]:
    """Return for every instance of a description whether it is animated, deforms, or varies in material or color.

    Args:
        description: a stage or a template.
        is_stage: whether to leave out materials that emit, whose changes count as changes of the stage's lights.
    """
    rows = [*(each.instances for each in description.tracks), *(each.instances for each in description.color_tracks)]
    tracked = {row for each in rows for row in each.tolist()}
    varying = varying_rows(description) - (emissive_rows(description) if is_stage else set())
    changes = [
        mesh.deformation is not None or (bool(varying) and bool(np.isin(mesh.materials, list(varying)).any()))
        for mesh in description.meshes
    ]
    return np.array([changes[each.mesh] or row in tracked for row, each in enumerate(description.instances)], np.bool_)


def scaled(track: InstanceTrack, scale: Array) -> InstanceTrack:
    """Return the track of an object that is scaled about its origin by a 4x4 matrix."""
    if np.array_equal(scale, np.eye(4)):
        return track
    return replace(track, matrices=np.einsum("ij,snjk->snik", scale[:3, :3], track.matrices))


def box_over_time(
    description: SceneDescription,
    meshes: Sequence[int],
    moments: Sequence[tuple[Array, NDArray[np.bool_]]],
    into: Array | None = None,
) -> Array:
    """Return the box [2, 3] around an object's parts over time; zeros if none is ever present.

    Args:
        description: where the meshes are.
        meshes: mesh of each part.
        moments: matrices and presence of the parts at each time.
        into: [moments, 4, 4], into the space of the box at each time; None: the identity.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for moment, (matrices, present) in enumerate(moments):
        whole = np.zeros((len(matrices), 4, 4))
        whole[:, :3], whole[:, 3, 3] = matrices, 1.0
        axes = np.eye(4) if into is None else into[moment]
        there = np.flatnonzero(present).tolist()
        if there:
            box = bounding_box(description, [meshes[row] for row in there], [axes @ whole[row] for row in there])
            low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
    return np.stack([low, high]) if np.isfinite(low).all() else np.zeros((2, 3))
