# SPDX-License-Identifier: Apache-2.0
"""Test oriented boxes against a camera's view frustum, by the separating axis theorem."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.camera import Camera

Array = NDArray[np.float64]
_AFAR = 1e6  # distance of the apex that stands for an orthographic camera, in heights of its view
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)


def in_view(camera: Camera, aspect: float, boxes: Array, poses: Array) -> NDArray[np.bool_]:
    """Return which boxes intersect a camera's view, in front of the camera; occlusion does not count.

    A box and the infinite view pyramid are convex: they intersect unless an axis separates them, a face normal of
    either or the cross product of an edge of each.

    Args:
        camera: the camera.
        aspect: width / height of its image.
        boxes: float64 [n, 2, 3], lowest and highest corners in the boxes' axes, m.
        poses: float64 [n, 3, 4], from the boxes' axes to the world.

    Returns:
        bool [n].
    """
    if not len(boxes):
        return np.zeros(0, np.bool_)
    camera = camera.framed(aspect)
    tangent = math.tan(0.5 * camera.vertical_fov)
    right, up, backward = camera.axes().T
    tip = np.asarray(camera.position)
    if camera.orthographic_height is not None:  # a perspective camera very far away
        tangent = 0.5 / _AFAR
        tip = tip + backward * (_AFAR * camera.orthographic_height)
    across, above = camera.image_center(1.0)
    if camera.orthographic_height is not None:
        tip = tip + across * right + above * up
        across = above = 0.0
    rays = np.array(
        [
            (across + x) * right + (above + y) * up - backward
            for x in (-aspect * tangent, aspect * tangent)
            for y in (-tangent, tangent)
        ]
    )
    sides = np.cross(rays[[0, 1, 3, 2]], rays[[1, 3, 2, 0]])
    sides *= np.sign(sides @ rays.sum(axis=0))[:, None]  # normals point inwards
    corners = boxes[:, None, 0] + _CORNERS * (boxes[:, None, 1] - boxes[:, None, 0])
    corners = np.einsum("nij,ncj->nci", poses[:, :, :3], corners) + poses[:, None, :, 3] - tip
    inwards = np.einsum("nci,si->ncs", corners, sides)
    result: NDArray[np.bool_] = (inwards > 0.0).all(axis=2).any(axis=1)  # a corner is in view
    # Most others lie beyond one side entirely; only the rest needs the full test.
    left = np.flatnonzero(~result & (inwards >= 0.0).any(axis=1).all(axis=1))
    if len(left):
        result[left] = _not_separated(rays, sides, poses[left], corners[left])
    if camera.orthographic_height is not None:
        result &= (corners @ -backward > _AFAR * camera.orthographic_height).any(axis=1)
    return result


def _not_separated(rays: Array, sides: Array, poses: Array, corners: Array) -> NDArray[np.bool_]:
    """Return for each box whether no axis separates it from the view pyramid."""
    edges = np.moveaxis(poses[:, :, :3], 2, 1)  # [n, 3, 3], the boxes' axes
    axes = np.concatenate(
        [
            np.broadcast_to(sides, (len(poses), *sides.shape)),
            edges,
            np.cross(edges[:, :, None], rays[None, None]).reshape(len(poses), -1, 3),
        ],
        axis=1,
    )
    axes = np.concatenate([axes, -axes], axis=1)
    # From its apex, the origin, the pyramid extends to infinity: along an axis it lies below 0, or is unbounded.
    bounded = (axes @ rays.T <= 1e-9 * np.linalg.norm(axes, axis=2, keepdims=True)).all(axis=2)
    lowest = np.einsum("nai,nci->nac", axes, corners).min(axis=2)
    separated = bounded & (lowest > 0.0)
    result: NDArray[np.bool_] = ~separated.any(axis=1)
    return result
