# SPDX-License-Identifier: Apache-2.0
"""Points, widths and colors along UsdGeomBasisCurves, sampled along every segment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
_STEPS = 6  # samples of a cubic segment
BASES = {  # basis matrices; rows: powers of t from 3 to 0
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]], float),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]], float) / 6.0,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]], float) / 2.0,
}


def _segment_controls(values: Floats, basis: str, wrap: str) -> Floats | None:
    """Return the four control values [c, segments, 4, k] of each cubic segment of curves [c, n, k]; None: too short."""
    n = values.shape[1]
    if wrap == "periodic":
        segments = n // 3 if basis == "bezier" else n
        step = 3 if basis == "bezier" else 1
        if n < 3:
            return None
        index = (np.arange(segments)[:, None] * step + np.arange(4)) % (segments * step)
        return np.asarray(values[:, index])
    if wrap == "pinned" and basis != "bezier":  # phantom points make the curve reach its ends
        if n < 2:
            return None
        first, last = 2.0 * values[:, :1] - values[:, 1:2], 2.0 * values[:, -1:] - values[:, -2:-1]
        values = np.concatenate([first, values, last], axis=1)
        n += 2
    step = 3 if basis == "bezier" else 1
    segments = (n - 4) // step + 1 if n >= 4 else 0
    if segments < 1:
        return None
    return np.asarray(values[:, np.arange(segments)[:, None] * step + np.arange(4)])


def unused_points(count: int, basis: str, wrap: str) -> int:
    """Return how many points at the end of a curve of `count`, which USD does not allow there, no segment has."""
    if basis != "bezier":
        return 0
    return count % 3 if wrap == "periodic" else (count - 1) % 3


def evaluate(values: Floats, basis: str, wrap: str) -> Floats | None:
    """Evaluate curves with control values [c, n, k] at m samples: [c, m, k]; None if n is too small.

    Closed curves repeat their first sample at the end.
    """
    if basis == "linear":
        if values.shape[1] < 2:
            return None
        return np.concatenate([values, values[:, :1]], axis=1) if wrap == "periodic" else values
    control = _segment_controls(values, basis, wrap)
    if control is None:
        return None
    t = np.arange(_STEPS + 1) / _STEPS
    weights = np.stack([t**3, t**2, t, np.ones_like(t)], axis=-1) @ BASES[basis]
    samples = np.einsum("tq,csqk->cstk", weights, control)
    inner = samples[:, :, :-1].reshape(len(values), -1, values.shape[2])
    return np.concatenate([inner, samples[:, -1:, -1]], axis=1)


def evaluate_values(
    values: Floats,
    rows: NDArray[np.int64],
    curve_ids: NDArray[np.int64],
    counts: NDArray[np.int64],
    basis: str,
    wrap: str,
    samples: int,
) -> Floats | None:
    """Evaluate widths or colors of some curves at their samples.

    Args:
        values: [n, k]: constant (1), uniform (one for each curve), vertex (each control point) or varying (each segment
            end).
        rows: [c, p], the control points of the curves among all.
        curve_ids: [c], the curves among all.
        counts: control points of every curve.
        basis: "linear" or a cubic basis.
        wrap: "nonperiodic", "periodic" or "pinned".
        samples: samples m of each curve.

    Returns:
        float64 [c, m, k]; None if the number of values fits none of these.
    """
    values = values.astype(np.float64)
    if len(values) == 1:
        return np.broadcast_to(values, (len(curve_ids), samples, values.shape[1]))
    if len(values) == len(counts):
        return np.repeat(values[curve_ids][:, None], samples, axis=1)
    if len(values) == counts.sum():
        return evaluate(values[rows], basis, wrap)
    ends = _varying_counts(counts, basis, wrap)
    if len(values) != ends.sum():
        return None
    start = (np.cumsum(ends) - ends)[curve_ids]
    count = int(ends[curve_ids[0]])
    at = values[start[:, None] + np.arange(count)]
    if wrap == "periodic":
        at = np.concatenate([at, at[:, :1]], axis=1)
    position = np.linspace(0.0, at.shape[1] - 1.0, samples)
    low = np.minimum(position.astype(int), at.shape[1] - 2)
    fraction = (position - low)[:, None]
    return np.asarray(at[:, low] * (1.0 - fraction) + at[:, low + 1] * fraction)


def _varying_counts(counts: NDArray[np.int64], basis: str, wrap: str) -> NDArray[np.int64]:
    """Return how many values of varying interpolation each curve has, [curves]."""
    if basis == "linear":
        return counts
    step = 3 if basis == "bezier" else 1
    if wrap == "periodic":
        return np.asarray(counts // step)
    if wrap == "pinned" and basis != "bezier":
        return counts
    return np.asarray(np.maximum((counts - 4) // step + 2, 0))
