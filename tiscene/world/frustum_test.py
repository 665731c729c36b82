# SPDX-License-Identifier: Apache-2.0
"""Test oriented boxes against a camera's view frustum, by the separating axis theorem."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.camera import Camera

Array = NDArray[np.float64]
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)


def in_view(camera: Camera, aspect: float, boxes: Array, poses: Array) -> NDArray[np.bool_]:
    """Return which boxes intersect a camera's view, in front of the camera; occlusion does not count.

    A box and the view, an infinite pyramid or half of a prism, are convex: they intersect unless an axis separates
    them, a face normal of either or the cross product of an edge of each.

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
    half = camera.half_height(1.0)
    right, up, backward = camera.axes().T
    across, above = camera.image_center(1.0)
    image = np.array(
        [(across + x) * right + (above + y) * up for x in (-aspect * half, aspect * half) for y in (-half, half)]
    )
    # The view begins at the tips and extends along the rays; the normals of its sides point inwards.
    if camera.orthographic_height is None:
        tips, rays = np.zeros((1, 3)), image - backward
        sides = np.cross(rays[[0, 1, 3, 2]], rays[[1, 3, 2, 0]])
        sides *= np.sign(sides @ rays.sum(axis=0))[:, None]
        edges = rays
    else:
        tips, rays = image, -backward[None]
        sides = np.array([right, -right, up, -up, -backward])
        edges = sides[[0, 2, 4]]
    corners = boxes[:, None, 0] + _CORNERS * (boxes[:, None, 1] - boxes[:, None, 0])
    corners = np.einsum("nij,ncj->nci", poses[:, :, :3], corners) + poses[:, None, :, 3] - np.asarray(camera.position)
    inwards = np.einsum("nci,si->ncs", corners, sides) - (tips @ sides.T).min(axis=0)
    result: NDArray[np.bool_] = (inwards > 0.0).all(axis=2).any(axis=1)  # a corner is in view
    # Most others lie beyond one side entirely; only the rest needs the full test.
    left = np.flatnonzero(~result & (inwards >= 0.0).any(axis=1).all(axis=1))
    if len(left):
        box_edges = np.moveaxis(poses[left, :, :3], 2, 1)  # [n, 3, 3], the boxes' axes
        crossed = np.cross(box_edges[:, :, None], edges[None, None]).reshape(len(left), -1, 3)
        axes = np.concatenate([np.broadcast_to(sides, (len(left), *sides.shape)), box_edges, crossed], axis=1)
        result[left] = _not_separated(np.concatenate([axes, -axes], axis=1), tips, rays, corners[left])
    return result


def _not_separated(axes: Array, tips: Array, rays: Array, corners: Array) -> NDArray[np.bool_]:
    """Return for each box whether no axis separates it from the view.

    Args:
        axes: float64 [n, a, 3], of each box.
        tips: float64 [t, 3], where the view begins.
        rays: float64 [r, 3], along which it extends to infinity.
        corners: float64 [n, 8, 3], of each box.
    """
    # Along an axis the view lies below its tips, or is unbounded.
    bounded = (axes @ rays.T <= 1e-9 * np.linalg.norm(axes, axis=2, keepdims=True)).all(axis=2)
    lowest = np.einsum("nai,nci->nac", axes, corners).min(axis=2)
    separated = bounded & (lowest > (axes @ tips.T).max(axis=2))
    result: NDArray[np.bool_] = ~separated.any(axis=1)
    return result
