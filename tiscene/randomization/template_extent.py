# SPDX-License-Identifier: Apache-2.0
"""TemplateExtent: the size of a template as a solid, and as it looks in an image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tiscene import catalog
from tiscene.randomization.scene_collisions import transformed
from tiscene.randomization.scene_files import template_of
from tiscene.scene.description import SceneDescription
from tiscene.usd.core.layers import cached_by_layers

Array = NDArray[np.float64]

DIRECTIONS = 32  # in which silhouettes are measured, spread over a hemisphere
ANGLES = 64  # tangents of a silhouette; they make its area up to 5 % too large


@dataclass(frozen=True)
class TemplateExtent:
    """Size of a template at scale 1.

    Attributes:
        radius: radius of the ball about its origin that encloses it, m.
        diameter: diameter of the disk whose area is that of its convex silhouette, averaged over all directions, m.
    """

    radius: float
    diameter: float


def template_extent(template: str, up_axis: str) -> TemplateExtent:
    """Return the extent of a template.

    Args:
        template: its name or file, with or without variants.
        up_axis: "Y" or "Z", the up axis of the stage it is placed in.

    Raises:
        TemplateNotFound, MissingFile, StageError, UnknownName: it cannot be found or read.
    """
    return _extent(catalog.find_template(template), template, up_axis)


@cached_by_layers(1024)
def _extent(file: Path, template: str, up_axis: str) -> TemplateExtent:
    points = _vertices(template_of(template, up_axis))
    radius = float(np.linalg.norm(points, axis=1).max(initial=0.0))
    return TemplateExtent(radius, math.sqrt(4.0 / math.pi * mean_silhouette(points)))


def enclosing_radius(description: SceneDescription, scale: float | Sequence[float]) -> float:
    """Return the radius of the ball about the origin that encloses a template, scaled along its axes, m."""
    return float(np.linalg.norm(_vertices(description) * scale, axis=1).max(initial=0.0))


def _vertices(description: SceneDescription) -> Array:
    """Return the vertices [n, 3] of a template in its own axes, m."""
    return np.concatenate(
        [transformed(description.meshes[each.mesh].positions, each.world_from_object) for each in description.instances]
    )


def mean_silhouette(points: Array) -> float:
    """Return the area of the convex silhouette of points [n, 3], averaged over directions, in squared units."""
    index = np.arange(DIRECTIONS)
    height = (index + 0.5) / DIRECTIONS
    turn = index * math.pi * (3.0 - math.sqrt(5.0))  # Fibonacci lattice
    across = np.sqrt(1.0 - height * height)
    view = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    right = np.cross(view, np.eye(3)[np.abs(view).argmin(axis=1)])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    up = np.cross(view, right)
    step = 2.0 * math.pi / ANGLES
    centered = points - points.mean(axis=0)
    areas = []
    for x, y in zip(right, up, strict=True):
        flat = np.stack([centered @ x, centered @ y], axis=1)
        (xx, xy), (_, yy) = flat.T @ flat
        # Tangents along the long axis bound thin silhouettes closely.
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy) + step * np.arange(ANGLES)
        support = (flat @ np.stack([np.cos(angle), np.sin(angle)])).max(axis=0)
        # Edges of the polygon that the tangents bound.
        edges = (np.roll(support, 1) + np.roll(support, -1) - 2.0 * math.cos(step) * support) / math.sin(step)
        areas.append(0.5 * float(support @ edges))
    return max(0.0, float(np.mean(areas)))
