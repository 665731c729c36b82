# SPDX-License-Identifier: Apache-2.0
"""What changes over time by itself: meshes that deform, instances that move, come and go.

Samples at given times, s, increasing. Before the first and after the last one everything stays as it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_NEAR = 1e-9  # of the way between two samples: what is so near to one has its values to the bit


@dataclass(frozen=True, eq=False)
class Deformation:
    """Where the vertices of a mesh are over time; between samples they go straight.

    times: float64 [s], s. positions: float32 [s, n, 3], m. normals: float32 [s, n, 3], unit; None for flat shading.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float32]
    normals: NDArray[np.float32] | None = None

    def at(self, seconds: float) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Positions and normals [n, 3]; the normals are not unit between samples."""
        row, share = between(self.times, seconds)
        return _mixed(self.positions, row, share), None if self.normals is None else _mixed(self.normals, row, share)


@dataclass(frozen=True, eq=False)
class InstanceTrack:
    """Where some instances of a description are over time: positions go straight, rotations the shortest way.

    instances: int32 [n], rows of `SceneDescription.instances`. times: float64 [s], s.
    matrices: float64 [s, n, 3, 4], in the place of `Instance.world_from_object`. present: bool [s, n], until the next
    sample; where it is False the matrix has no meaning.
    """

    instances: NDArray[np.int32]
    times: NDArray[np.float64]
    matrices: NDArray[np.float64]
    present: NDArray[np.bool_]

    def at(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Matrices [n, 3, 4] and presence [n]."""
        row, share = between(self.times, seconds)
        present = self.present[row]
        if share == 0.0:
            return self.matrices[row].copy(), present
        following = np.where(self.present[row + 1, :, None, None], self.matrices[row + 1], self.matrices[row])
        return interpolated(self.matrices[row], following, share), present


def between(times: NDArray[np.float64], seconds: float) -> tuple[int, float]:
    """The sample at or before a time, and how much of the way to the next has gone by, 0..1 without 1."""
    row = int(np.searchsorted(times, seconds, side="right")) - 1
    if row < 0 or row + 1 >= len(times):
        return (0, 0.0) if row < 0 else (len(times) - 1, 0.0)
    share = float((seconds - times[row]) / (times[row + 1] - times[row]))
    if share > 1.0 - _NEAR:
        return row + 1, 0.0
    return row, share if share > _NEAR else 0.0


def _mixed(samples: NDArray[np.float32], row: int, share: float) -> NDArray[np.float32]:
    if share == 0.0:
        start: NDArray[np.float32] = samples[row]
        return start
    result: NDArray[np.float32] = samples[row] + np.float32(share) * (samples[row + 1] - samples[row])
    return result


def interpolated(a: NDArray[np.float64], b: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Affine maps [n, 3, 4] between two; of what turns the rotation goes the shortest way, and the stretch straight."""
    result: NDArray[np.float64] = a + share * (b - a)
    turned = np.flatnonzero((a[:, :, :3] != b[:, :, :3]).any(axis=(1, 2)))
    if len(turned):
        (rotation_a, stretch_a), (rotation_b, stretch_b) = (polar(each[turned, :, :3]) for each in (a, b))
        p, q = quaternions(rotation_a), quaternions(rotation_b)
        cosine = np.einsum("nc,nc->n", p, q)
        q[cosine < 0.0] *= -1.0
        angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
        sine = np.sin(angle)
        near = sine < 1e-6
        sine[near] = 1.0
        weight_p = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / sine)
        weight_q = np.where(near, share, np.sin(share * angle) / sine)
        middle = weight_p[:, None] * p + weight_q[:, None] * q
        stretch = stretch_a + share * (stretch_b - stretch_a)
        result[turned, :, :3] = np.einsum("nij,njk->nik", _matrices(middle), stretch)
    return result


def polar(m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotations and symmetric stretches [..., 3, 3] whose products matrices are.

    What is mirrored is turned by the rotation of its point reflection: it is the one that turns as the thing does,
    while which axis a mirror has turned round nobody can tell.
    """
    left, _, right = np.linalg.svd(m)
    rotation = left @ right
    rotation = np.where(np.linalg.det(rotation)[..., None, None] < 0.0, -rotation, rotation)
    return rotation, np.einsum("...ji,...jk->...ik", rotation, m)


def quaternions(m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions [n, 4], (w, x, y, z), of rotations [n, 3, 3], w >= 0: of four equal ones the largest."""
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


def _matrices(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations [n, 3, 3] of quaternions [n, 4], which need not be unit."""
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=1,
    )
