# SPDX-License-Identifier: Apache-2.0
"""Primvars of point instancers of which each point has its own value.

As USD says, the value of a point is as if it were authored at the root of the prototype that the point shows, with
constant interpolation: what is authored on the gprim, or between it and that root, is stronger.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.usd.core.report import StageReport
from tiscene.usd.core.value_times import value_times
from tiscene.usd.geometry.primvar import primvar_topology, read_color, read_primvar

COLOR_AND_OPACITY = slice(0, 3), slice(3, 4)  # columns of the colors of points


class PointPrimvars:
    """The primvars of one instancer of which each point has its own value: all that are not constant.

    Args:
        instancer: the instancer.
        time: time code to read at.
        report: receives primvars that do not fit the points.
    """

    def __init__(self, instancer: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> None:
        self._instancer = instancer
        self._time = time
        self._report = report
        primvars = UsdGeom.PrimvarsAPI(instancer).GetPrimvarsWithAuthoredValues()
        varying = [each for each in primvars if each.GetInterpolation() != UsdGeom.Tokens.constant]
        self._primvars = {str(each.GetPrimvarName()): each for each in varying}
        self._values: dict[tuple[str, bool, Usd.TimeCode], NDArray[np.float32] | None] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._primvars

    def fits(self, name: str, is_color: bool) -> bool:
        """Return whether a primvar has a color or an opacity for each point at the time read; reported if not."""
        return self._read(name, is_color, self._time) is not None

    def colors(self, names: tuple[str, str], time: Usd.TimeCode) -> NDArray[np.float32]:
        """Return RGB and opacity of the points, float32 [n, 4], NaN for what the instancer does not give.

        Args:
            names: the primvars of color and opacity; "" for none.
            time: when to evaluate them.
        """
        result = np.full((primvar_topology(self._instancer, time).points, 4), np.nan, np.float32)
        for name, columns in zip(names, COLOR_AND_OPACITY, strict=True):
            if name in self and (values := self._read(name, columns.start == 0, time)) is not None:
                result[:, columns] = values
        return result

    def times(self, names: tuple[str, str]) -> list[float]:
        """Return the time codes at which the primvars of color and opacity have values; empty if they never change."""
        times: set[float] = set()
        for name in names:
            if name in self and self._report.reads_animation:
                for attribute in (self._primvars[name].GetAttr(), self._primvars[name].GetIndicesAttr()):
                    found = value_times(attribute)
                    times.update(found if len(found) > 1 else ())
        return sorted(times)

    def report_unapplied(self, name: str) -> None:
        """Report a primvar whose values a material reads and cannot get, unless they were reported not to fit."""
        if any(known[0] == name and values is None for known, values in self._values.items()):
            return
        self._report.omission(self._instancer.GetPath(), f"{name} of each point of an instancer is not applied")

    def _read(self, name: str, is_color: bool, time: Usd.TimeCode) -> NDArray[np.float32] | None:
        key = name, is_color, time
        if key not in self._values:
            topology, primvar = primvar_topology(self._instancer, time), self._primvars[name]
            if is_color:
                found = read_color(primvar, topology, time, self._report)
            else:
                found = read_primvar(primvar, 1, topology, time, self._report)
            points = np.arange(topology.points)
            self._values[key] = None if found is None else found.at(points, points)[:, : 3 if is_color else 1]
        return self._values[key]


class _Prototype(NamedTuple):
    primvars: PointPrimvars  # of its instancer
    instancer: Usd.Prim
    root: Sdf.Path


class EnclosingInstancers:
    """The instancers whose prototypes are being read, from outside to inside."""

    def __init__(self) -> None:
        self._open: list[_Prototype] = []

    @contextlib.contextmanager
    def reading(self, primvars: PointPrimvars, instancer: Usd.Prim, root: Usd.Prim) -> Iterator[None]:
        """Enter a prototype of an instancer, by its root."""
        self._open.append(_Prototype(primvars, instancer, root.GetPath()))
        try:
            yield
        finally:
            self._open.pop()

    def source(self, gprim: Usd.Prim, name: str) -> PointPrimvars | None:
        """Return the primvars of the instancer whose points give a gprim its value; None if no points do."""
        prim = gprim
        for each in self._open[::-1]:
            while prim.GetPath().HasPrefix(each.root):
                if UsdGeom.PrimvarsAPI(prim).GetPrimvar(name).HasAuthoredValue():
                    return None
                prim = prim.GetParent()
            if name in each.primvars:
                return each.primvars
            prim = each.instancer
        return None

    def give(self, gprim: Usd.Prim, name: str, *, is_color: bool) -> bool:
        """Return whether points give a gprim a color, or an opacity, by a primvar."""
        source = self.source(gprim, name)
        return source is not None and source.fits(name, is_color)

    def report_unapplied(self, gprim: Usd.Prim, *names: str) -> None:
        """Report those primvars that a material of a gprim reads, that points give it, and that are not applied."""
        for name in names:
            if name and (source := self.source(gprim, name)) is not None:
                source.report_unapplied(name)
