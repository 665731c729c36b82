# SPDX-License-Identifier: Apache-2.0
"""Time-sampled animation of a stage: meshes that deform; instances that move, appear, disappear and change color.

Samples are at increasing times, s. Before the first and after the last sample, everything stays as it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion

_TOLERANCE = 1e-9  # fraction of an interval; a time this near to a sample has the sample's values to the bit


@dataclass(frozen=True, eq=False)
class Deformation:
    """Vertices of a mesh over time, interpolated linearly between samples.

    Attributes:
        times: float64 [s], s.
        positions: float32 [s, n, 3], m.
        normals: float32 [s, n, 3], unit. None: flat shading.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float32]
    normals: NDArray[np.float32] | None = None

    def at(self, seconds: float) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return positions and normals, [n, 3] each; normals are not unit between samples."""
        row, t = between(self.times, seconds)
        positions, normals = self.sample(row)
        if t == 0.0:
            return positions, normals
        later, later_normals = self.sample(row + 1)
        moved: NDArray[np.float32] = positions + np.float32(t) * (later - positions)
        if normals is None or later_normals is None:
            return moved, None
        turned: NDArray[np.float32] = normals + np.float32(t) * (later_normals - normals)
        return moved, turned

    def sample(self, row: int) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return positions [n, 3], m, and unit normals [n, 3] at a sample."""
        return self.positions[row], None if self.normals is None else self.normals[row]

    def corners(self) -> NDArray[np.float32]:
        """Return points [k, 3] whose convex hull holds the mesh at all times."""
        return self.positions.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class InstanceTrack:
    """Transforms of some instances or objects over time: positions are interpolated linearly, rotations by slerp.

    Attributes:
        instances: int32 [n], rows of `SceneDescription.instances`, or of its `objects`.
        times: float64 [s], s.
        matrices: float64 [s, n, 3, 4], m; they replace `world_from_object`.
        present: bool [s, n], whether the instance exists from a sample to the next. Where False, the matrix is
            meaningless.
    """

    instances: NDArray[np.int32]
    times: NDArray[np.float64]
    matrices: NDArray[np.float64]
    present: NDArray[np.bool_]

    def at(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the matrices [n, 3, 4] and presence [n] at a time."""
        row, t = between(self.times, seconds)
        present = self.present[row]
        if t == 0.0:
            return self.matrices[row].copy(), present
        following = np.where(self.present[row + 1, :, None, None], self.matrices[row + 1], self.matrices[row])
        return interpolated(self.matrices[row], following, t), present


@dataclass(frozen=True, eq=False)
class ColorTrack:
    """Colors of some instances over time, interpolated linearly.

    Attributes:
        instances: int32 [n], rows of `SceneDescription.instances`.
        times: float64 [s], s.
        colors: float32 [s, n, 4]; they replace `Instance.color`.
    """

    instances: NDArray[np.int32]
    times: NDArray[np.float64]
    colors: NDArray[np.float32]

    def at(self, seconds: float) -> NDArray[np.float32]:
        """Return the colors [n, 4] at a time."""
        row, t = between(self.times, seconds)
        here: NDArray[np.float32] = self.colors[row]
        return here if t == 0.0 else here + np.float32(t) * (self.colors[row + 1] - here)


def between(times: NDArray[np.float64], seconds: float) -> tuple[int, float]:
    """Return the sample at or before a time, and the position between it and the next one, 0 <= t < 1.

    Args:
        times: Times of the samples, increasing, s.
        seconds: The time, s.
    """
    row = int(np.searchsorted(times, seconds, side="right")) - 1
    if row < 0 or row + 1 >= len(times):
        return (0, 0.0) if row < 0 else (len(times) - 1, 0.0)
    t = float((seconds - times[row]) / (times[row + 1] - times[row]))
    if t > 1.0 - _TOLERANCE:
        return row + 1, 0.0
    return row, t if t > _TOLERANCE else 0.0


def interpolated(a: NDArray[np.float64], b: NDArray[np.float64], t: float) -> NDArray[np.float64]:
    """Interpolate affine maps [n, 3, 4]: the rotation by slerp, everything else linearly.

    Args:
        a: Maps at 0.
        b: Maps at 1.
        t: Position between them, 0..1.
    """
    result: NDArray[np.float64] = a + t * (b - a)
    rotating = np.flatnonzero((a[:, :, :3] != b[:, :, :3]).any(axis=(1, 2)))
    if len(rotating):
        (rotation_a, stretch_a), (rotation_b, stretch_b) = (polar(each[rotating, :, :3]) for each in (a, b))
        p, q = quaternions(rotation_a), quaternions(rotation_b)
        cosine = np.einsum("nc,nc->n", p, q)
        q[cosine < 0.0] *= -1.0
        angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
        sine = np.sin(angle)
        near = sine < 1e-6
        sine[near] = 1.0
        weight_p = np.where(near, 1.0 - t, np.sin((1.0 - t) * angle) / sine)
        weight_q = np.where(near, t, np.sin(t * angle) / sine)
        middle = weight_p[:, None] * p + weight_q[:, None] * q
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        stretch = stretch_a + t * (stretch_b - stretch_a)
        result[rotating, :, :3] = np.einsum("nij,njk->nik", matrix_from_quaternion(middle), stretch)
    return result


def polar(m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the polar decomposition `m = rotation @ stretch` of matrices [..., 3, 3]; stretches are symmetric.

    The rotation of a mirroring matrix is that of its point reflection, so that it follows the object continuously; the
    axis of a mirror is arbitrary.
    """
    left, _, right = np.linalg.svd(m)
    rotation = left @ right
    rotation = np.where(np.linalg.det(rotation)[..., None, None] < 0.0, -rotation, rotation)
    return rotation, np.einsum("...ji,...jk->...ik", rotation, m)


def quaternions(m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit quaternions [n, 4], (w, x, y, z), w >= 0, of rotations [n, 3, 3], from their largest components."""
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    x, y, z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    rows = np.stack(
        [
            np.stack([1 + xx + yy + zz, x, y, z], axis=-1),
            np.stack([x, 1 + xx - yy - zz, xy, xz], axis=-1),
            np.stack([y, xy, 1 - xx + yy - zz, yz], axis=-1),
            np.stack([z, xz, yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=1,
    )
    largest = np.argmax(np.einsum("nii->ni", rows), axis=1)
    chosen = rows[np.arange(len(m)), largest]
    result: NDArray[np.float64] = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    result[result[:, 0] < 0.0] *= -1.0
    return result
