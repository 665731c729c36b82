# SPDX-License-Identifier: Apache-2.0
"""AnimatedInstances: which parts of a world move, come and go by themselves, as their author animated them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import InstanceTrack
from tiscene.scene.assembly import bounding_box, rigid
from tiscene.scene.description import SceneDescription

Array = NDArray[np.float64]


class AnimatedInstances:
    """Some parts, and the tracks of those that have one. rows: int64, the parts that have."""

    def __init__(self, matrices: Array, tracks: Iterable[tuple[NDArray[np.integer], InstanceTrack]] = ()) -> None:
        """matrices: float64 [p, 3, 4], where the parts are read. tracks: each with the parts that it moves."""
        self._matrices = matrices
        self._tracks = list(tracks)
        self.rows = np.concatenate([np.zeros(0, np.int64), *(rows for rows, _ in self._tracks)])

    def __bool__(self) -> bool:
        return bool(self._tracks)

    def at(self, seconds: float) -> tuple[Array, NDArray[np.bool_]]:
        """The matrices of all parts at a time, and which of them are there."""
        present = np.ones(len(self._matrices), np.bool_)
        if not self._tracks:
            return self._matrices, present
        matrices = self._matrices.copy()
        for rows, track in self._tracks:
            matrices[rows], present[rows] = track.at(seconds)
        return matrices, present

    def over_time(self, rows: NDArray[np.integer]) -> list[tuple[Array, NDArray[np.bool_]]]:
        """The same of some parts, at every time at which one of them is sampled."""
        tracks = [track for own, track in self._tracks if np.isin(own, rows).any()]
        times = sorted({time for track in tracks for time in track.times.tolist()})
        moments = (self.at(time) for time in times)
        return [(matrices[rows], present[rows]) for matrices, present in moments]


def changing(description: SceneDescription) -> NDArray[np.bool_]:
    """Of every instance of a description, whether it changes by itself: it moves, or its mesh deforms."""
    tracked = {row for track in description.tracks for row in track.instances.tolist()}
    deforms = [mesh.deformation is not None for mesh in description.meshes]
    return np.array([deforms[each.mesh] or row in tracked for row, each in enumerate(description.instances)], np.bool_)


def scaled(track: InstanceTrack, scale: Array) -> InstanceTrack:
    """A track of an object that is stretched about its origin by a 4x4 matrix."""
    if np.array_equal(scale, np.eye(4)):
        return track
    return replace(track, matrices=np.einsum("ij,snjk->snik", scale[:3, :3], track.matrices))


def box_over_time(
    description: SceneDescription, meshes: Sequence[int], moments: Sequence[tuple[Array, NDArray[np.bool_]]], own: bool
) -> Array:
    """The box [2, 3] around an object's parts at all moments; own: in the axes of its first part at each."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for matrices, present in moments:
        whole = np.zeros((len(matrices), 4, 4))
        whole[:, :3], whole[:, 3, 3] = matrices, 1.0
        axes = np.linalg.inv(rigid(whole[0])) if own else np.eye(4)
        there = np.flatnonzero(present).tolist()
        if there:
            box = bounding_box(description, [meshes[row] for row in there], [axes @ whole[row] for row in there])
            low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
    return np.stack([low, high])
