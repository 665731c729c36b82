"""Simulation: all bodies and their timings; a time in, poses out."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Rational

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics import check
from dynamics.bodies import Body, columns
from dynamics.clocks import Clocks, Window, exact
from dynamics.closed_form import check_closed_form
from dynamics.motion import evaluate
from dynamics.quadrature import GAUSS
from dynamics.timings import ALWAYS, AllTogether, Timing


class Simulation:
    """Moves bodies. Taichi must run when poses are asked for (with float64, which its CPU and CUDA backends have).

    A pose is a pure function of (bodies, timings, time), and of its own body alone but for the timings' turns: the same
    bits for any number of threads, in any order of asking, with any other bodies beside it.
    """

    def __init__(self, bodies: Sequence[Body], timings: Timing | None = None) -> None:
        """timings: default AllTogether(0). Raises ValueError if they cannot work for these bodies."""
        self.bodies = tuple(bodies)
        self.timings = AllTogether(0.0) if timings is None else timings
        tracks = [
            check_closed_form(body.dynamic, f"bodies[{row}] ({body.name!r}): dynamic").tracks(body.start)
            for row, body in enumerate(self.bodies)
        ]
        self._clocks = Clocks(self._windows(), [exact(body.birth) for body in self.bodies], tracks)
        self._host_columns = (*columns(tracks).arrays(), GAUSS)
        self._columns: list[ti.Ndarray] = []

    def poses(self, time: float | Rational) -> NDArray[np.float64]:
        """Where every body is at `time`, s: float64 [n, 7], position (m) and unit quaternion (w, x, y, z).

        A float stands for the decimal number it prints as; pass Fraction(k, fps) for frame k of a stream. Before its
        birth a body is where it will appear; times before 0 show the world as it starts.
        """
        check.number(time, "time")
        poses = np.zeros((len(self.bodies), 7))
        if self.bodies:
            # Only here, so that a simulation can be made, and its errors seen, before Taichi runs.
            self._columns = self._columns or [_on_device(column) for column in self._host_columns]
            evaluate(*self._columns, self._clocks.parameters(exact(time)), poses)
        return poses

    def _windows(self) -> list[Window]:
        timed = [row for row, body in enumerate(self.bodies) if body.timed]
        windows = [ALWAYS] * len(self.bodies)
        answer = self.timings.windows([(self.bodies[row].name, self.bodies[row].dynamic) for row in timed])
        for row, window in zip(timed, answer, strict=True):
            windows[row] = window
        return windows


def _on_device(column: NDArray[np.float64] | NDArray[np.int32]) -> ti.Ndarray:
    array = ti.ndarray(ti.f64 if column.dtype == np.float64 else ti.i32, column.shape)
    array.from_numpy(np.ascontiguousarray(column))
    return array
