# SPDX-License-Identifier: Apache-2.0
"""Points, widths and colors along UsdGeomBasisCurves, sampled along every segment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Curves:
    """The topology of a UsdGeomBasisCurves.

    Attributes:
        counts: int64 [curves], control points of each.
        basis: "linear" or a cubic basis.
        wrap: "nonperiodic", "periodic" or "pinned".
    """

    counts: NDArray[np.int64]
    basis: str
    wrap: str

    def groups(self) -> Iterator[CurveGroup]:
        """Yield the curves of each number of control points."""
        starts = np.cumsum(self.counts) - self.counts
        for count in np.unique(self.counts).tolist():
            ids = np.flatnonzero(self.counts == count)
            yield CurveGroup(self, ids, starts[ids][:, None] + np.arange(count))

    def fit(self, values: Floats) -> bool:
        """Return whether there are as many values as an interpolation needs: see `CurveGroup.sampled`."""
        return len(values) in (1, len(self.counts), self.counts.sum(), self.varying_counts().sum())

    def varying_counts(self) -> NDArray[np.int64]:
        """Return how many values of varying interpolation each curve has, [curves]: one for each end of a segment."""
        if self.basis == "linear":
            return self.counts
        step = 3 if self.basis == "bezier" else 1
        if self.wrap == "periodic":
            return np.asarray(self.counts // step)
        if self.wrap == "pinned" and self.basis != "bezier":
            return self.counts
        return np.asarray(np.maximum((self.counts - 4) // step + 2, 0))


@dataclass(frozen=True, eq=False)
class CurveGroup:
    """Those of a prim's curves that have one number of control points.

    Attributes:
        curves: all of them.
        ids: [c], these among all.
        rows: [c, p], their control points among all.
    """

    curves: Curves
    ids: NDArray[np.int64]
    rows: NDArray[np.int64]

    def along(self, values: Floats) -> Floats | None:
        """Evaluate the curves with the control values [points, k] of all: float64 [c, m, k] at m samples.

        Closed curves repeat their first sample at the end. None if the curves are too short.
        """
        values, wrap = values[self.rows].astype(np.float64), self.curves.wrap
        if self.curves.basis == "linear":
            if values.shape[1] < 2:
                return None
            return np.concatenate([values, values[:, :1]], axis=1) if wrap == "periodic" else values
        control = _segment_controls(values, self.curves.basis, wrap)
        if control is None:
            return None
        t = np.arange(_STEPS + 1) / _STEPS
        weights = np.stack([t**3, t**2, t, np.ones_like(t)], axis=-1) @ BASES[self.curves.basis]
        samples = np.einsum("tq,csqk->cstk", weights, control)
        inner = samples[:, :, :-1].reshape(len(values), -1, values.shape[2])
        return np.concatenate([inner, samples[:, -1:, -1]], axis=1)

    def sampled(self, values: Floats, samples: int) -> Floats:
        """Evaluate widths or colors, which `fit` all curves, at the samples of these.

        Args:
            values: [n, k]: constant (1), uniform (one for each curve), vertex (each control point) or varying (each
                segment end).
            samples: samples m of each curve.

        Returns:
            float64 [c, m, k].
        """
        counts = self.curves.counts
        if len(values) == 1:
            return np.broadcast_to(values.astype(np.float64), (len(self.ids), samples, values.shape[1]))
        if len(values) == len(counts):
            return np.repeat(values[self.ids].astype(np.float64)[:, None], samples, axis=1)
        if len(values) == counts.sum() and (found := self.along(values)) is not None:
            return found
        ends = self.curves.varying_counts()
        start = (np.cumsum(ends) - ends)[self.ids]
        at = values[start[:, None] + np.arange(ends[self.ids[0]])].astype(np.float64)
        if self.curves.wrap == "periodic":
            at = np.concatenate([at, at[:, :1]], axis=1)
        position = np.linspace(0.0, at.shape[1] - 1.0, samples)
        low = np.minimum(position.astype(int), at.shape[1] - 2)
        fraction = (position - low)[:, None]
        return np.asarray(at[:, low] * (1.0 - fraction) + at[:, low + 1] * fraction)

    def unused_points(self) -> int:
        """Return how many points at the end of each curve, of a number that USD does not allow, no segment has."""
        count = int(self.rows.shape[1])
        if self.curves.basis != "bezier":
            return 0
        return count % 3 if self.curves.wrap == "periodic" else (count - 1) % 3
