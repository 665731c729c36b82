# SPDX-License-Identifier: Apache-2.0
"""Anchors: the points whose panoramas a walking camera shows.

Anchors are the points of a lattice whose spacing follows from how far away surfaces are, so that a camera sees from
an anchor nearby almost what it sees from its own center. The choice depends on the frame alone.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.labels.first_hits import center_hits, first_hits
from tiscene.render.intersect.ray_queue import RayArrays, RayWave
from tiscene.render.view import View
from tiscene.scene.camera import Vector3
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

DISTANCE_PER_SPACING = 4.0  # least median distance of surfaces, in spacings of the lattice
MAX_SPACING = 0.5  # m
CLEARANCE = 0.02  # m between a point of a lattice and what is behind it: points on walls do not serve
PROBE_SPACING = 1.0  # m, of the light probes of anchors
STEPS_PER_SPACING = 4.0  # frames at least that see the same anchor while a camera moves
_GRID = (16, 12)  # rays that measure distances: along a row and a column of the image
_REST = 1.0 / 1024.0  # speed along an axis, in spacings per frame, up to which the camera rests along it
_FINE = 1.0 / 64.0  # spacing of anchors along such an axis, in spacings


def walks(view: View) -> bool:
    """Return whether the camera walks, around the frame or at other times, so that an anchor serves it."""
    return bool(view.walks) or len({camera.position for camera in view.cameras}) > 1


class Anchors:
    """Chooses anchors in a scene.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self._scene = scene
        self._grid, self._sight = RayArrays(), RayWave()

    def nearest(self, view: View) -> Vector3 | None:
        """Return the anchor that serves a view, in the scene that is placed.

        A camera that never walks has its anchor at its center. Any other has the nearest of those lattice points around
        it that it sees, while it stands as well. Along an axis along which it does not walk, anchors are where it is,
        but for rounding.

        Returns:
            The anchor, world, m; None if the camera moves too fast, or sees no anchor while it walks. Where it walks
            close to surfaces, anchors are farther apart than they should be, rather than too many.
        """
        if not walks(view):
            return view.current.position
        before, here, after = (np.array(camera.position) for camera in view.cameras)
        past, planned = np.abs(here - before), np.abs(after - here)
        least = float(max(np.linalg.norm(past), STEPS_PER_SPACING * np.linalg.norm(planned)))
        if least > MAX_SPACING:
            return None
        spacing = self._spacing(view, least)
        steps = np.maximum(past, planned)
        places: list[tuple[float, ...]] = []
        for axis, (at, step) in enumerate(zip(here.tolist(), steps.tolist(), strict=True)):
            if axis not in view.walks and step <= _REST * spacing:
                fine = _FINE * spacing
                places.append((round(at / fine) * fine,))
            else:
                places.append(_around(at, spacing))
        rests = view.current.position if not steps.any() else None
        return self._nearest_seen(view.current.position, places) or rests

    def center_of_probe(self, anchor: Vector3) -> Vector3:
        """Return where the light probe of an anchor's panorama is, in the scene that is placed.

        It is the nearest of the points of a coarse lattice that the anchor sees, so that anchors share probes.
        """
        return self._nearest_seen(anchor, [_around(at, PROBE_SPACING) for at in anchor]) or anchor

    def _nearest_seen(self, here: Vector3, along: list[tuple[float, ...]]) -> Vector3 | None:
        """Return the nearest point that is seen from here, of those with some coordinates along each axis."""
        points = sorted(set(itertools.product(along[0], along[1], along[2])), key=lambda at: (math.dist(at, here), at))
        return next(itertools.compress(points, self._sees(np.array(here), np.array(points))), None)

    def _spacing(self, view: View, least: float) -> float:
        """Return the spacing of the lattice, m: a power of two, and at least so much."""
        width, height = _GRID
        rays = center_hits(self._scene, replace(view, width=width, height=height), self._grid)
        distance = float(np.median(rays.hits.to_numpy()[:, 0]))
        largest = min(max(distance, 1e-3) / DISTANCE_PER_SPACING, MAX_SPACING)
        return 2.0 ** max(math.floor(math.log2(largest)), math.ceil(math.log2(max(least, 1e-6))))

    def _sees(self, eye: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return for each point whether nothing is between it and the eye, nor close behind it, bool [n]."""
        rays = self._sight.reserved(len(points))
        values = np.zeros((*rays.rays.shape, 8), np.float32)
        values[: len(points), :3] = eye
        values[: len(points), 4:7] = ways = points - eye
        lengths = np.linalg.norm(ways, axis=1)
        values[: len(points), 7] = 1.0 + CLEARANCE / np.maximum(lengths, CLEARANCE)
        rays.rays.from_numpy(values)
        first_hits(self._scene, CURRENT, rays, rays.queue, len(points))
        seen: NDArray[np.bool_] = (rays.hit_ids.to_numpy()[: len(points), 0] < 0) | (lengths == 0.0)
        return seen


def _around(at: float, spacing: float) -> tuple[float, float]:
    """Return the multiples of a spacing below and above a number."""
    return math.floor(at / spacing) * spacing, math.ceil(at / spacing) * spacing
