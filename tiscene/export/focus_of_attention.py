# SPDX-License-Identifier: Apache-2.0
"""A focus of attention over a recording, as the programs of SAILenv's laboratory read it from a file.

The model is the gravitational one of Zanca, Melacci and Gori, "Gravitational Laws of Focus of Attention" (IEEE TPAMI
42(12), 2020): the focus is a particle that details (the gradient of brightness) and motion (the length of flow) attract
like masses in a plane, with friction. Inhibition of return is left out. It is a function of the frames alone.

A line of the file is a frame: row, column (px), their velocities (px/s), and 1 during a saccade, else 0, with commas.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

FRICTION = 3.0  # 1/s
STEPS = 10  # integration steps per frame
MOTION_SHARE = 0.7  # of the mass, in frames with motion
SACCADE_SPEED = 0.5  # mean sides of the image per second
CELL = 8  # px: masses are summed over squares of this size

Line = tuple[float, float, float, float, int]


def focus_path(frames: Iterable[tuple[NDArray[np.uint8], NDArray[np.float32]]], fps: float) -> Iterator[Line]:
    """Yield the focus at each frame: row, column, their velocities, and whether it is in a saccade.

    Args:
        frames: uint8 [h, w, 3] and flow, float32 [h, w, 2], px, in the order of time.
        fps: Frames per second.
    """
    position, velocity = np.zeros(2), np.zeros(2)
    for number, (rgb, flow) in enumerate(frames):
        size = np.array(rgb.shape[:2], np.float64)
        if number == 0:
            position = 0.5 * (size - 1.0)
        places, masses = _masses(rgb, flow)
        step = 1.0 / (fps * STEPS)
        for _ in range(STEPS):
            apart = places - position
            pull = masses / ((apart**2).sum(axis=1) + (0.05 * size.mean()) ** 2)
            force = size.prod() * np.einsum("n,ni->i", pull, apart)
            velocity = (velocity + step * force) / (1.0 + step * FRICTION)
            moved = position + step * velocity
            position = np.clip(moved, 0.0, size - 1.0)
            velocity = np.where(position == moved, velocity, 0.0)
        speed = float(np.sqrt((velocity**2).sum()))
        row, column = position.tolist()
        down, right = velocity.tolist()
        yield row, column, down, right, int(speed > SACCADE_SPEED * size.mean())


def focus_file(lines: Iterable[Line]) -> bytes:
    """Return the lines as the bytes of a file."""
    return "".join(f"{y:.4f},{x:.4f},{vy:.4f},{vx:.4f},{saccade}\n" for y, x, vy, vx, saccade in lines).encode()


def _masses(rgb: NDArray[np.uint8], flow: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places [n, 2], px, and masses [n] of all cells; the masses have the sum 1, or 0 in an empty frame."""
    brightness = rgb.mean(axis=2, dtype=np.float64)
    down, right = np.gradient(brightness) if min(brightness.shape) > 1 else (brightness * 0.0, brightness * 0.0)
    details = _cells(np.hypot(down, right))
    motion = _cells(np.hypot(flow[..., 0], flow[..., 1]).astype(np.float64))
    share = MOTION_SHARE if motion.any() else 0.0
    masses = (1.0 - share) * _normalized(details) + share * _normalized(motion)
    rows, columns = np.indices(masses.shape)
    places = np.stack([rows.ravel(), columns.ravel()], axis=1) * CELL + 0.5 * (CELL - 1)
    return np.minimum(places, np.array(rgb.shape[:2]) - 1.0), masses.ravel()


def _cells(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums over squares of CELL px."""
    height, width = (-(-side // CELL) for side in values.shape)
    padded = np.zeros((height * CELL, width * CELL))
    padded[: values.shape[0], : values.shape[1]] = values
    sums: NDArray[np.float64] = padded.reshape(height, CELL, width, CELL).sum(axis=(1, 3))
    return sums


def _normalized(values: NDArray[np.float64]) -> NDArray[np.float64]:
    total = float(values.sum())
    return values / total if total > 0.0 else values
