# SPDX-License-Identifier: Apache-2.0
"""Meshes whose points lie far from the origin of their prim, as programs for buildings and maps write them.

Single precision rounds a point at 100 km to 8 mm. A transform that brings such points back to the world's origin rounds
them again, and surfaces shadow themselves. So these meshes keep their points relative to their own center, and the
transforms of their instances, which are of double precision, take the rest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.vertex_weld import WeldedMesh

# m: points nearer than this are exact enough, and stay as they are authored.
_FAR = 64.0


def far_center(surface: WeldedMesh, meters: float) -> NDArray[np.float64]:
    """Return the point that a mesh's points should be relative to, in stage units; 0 if they are near the origin.

    Args:
        surface: the mesh.
        meters: meters per stage unit.
    """
    samples = surface.positions if surface.position_samples is None else surface.position_samples.reshape(-1, 3)
    low, high = samples.min(axis=0).astype(np.float64), samples.max(axis=0).astype(np.float64)
    center, half = 0.5 * (low + high), 0.5 * (high - low)
    if np.abs(center).max() <= max(_FAR / meters, half.max()):
        return np.zeros(3)
    # A single precision number: differences to nearby points are exact.
    return np.asarray(center, np.float32).astype(np.float64)


def recentered(surface: WeldedMesh, center: NDArray[np.float64]) -> WeldedMesh:
    """Return a mesh with its points at all times relative to a point."""

    def moved(points: NDArray[np.float32]) -> NDArray[np.float32]:
        return (points - center).astype(np.float32)

    samples, skin = surface.position_samples, surface.skin
    return replace(
        surface,
        positions=moved(surface.positions),
        position_samples=None if samples is None else np.stack([moved(each) for each in samples]),
        skin=None if skin is None else skin.relative_to(center),
    )
