# SPDX-License-Identifier: Apache-2.0
"""What moves, comes and goes on a stage without being a thing of its own: parts of things, points of instancers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from tiscene.scene.animation import InstanceTrack
from tiscene.scene.description import Matrix
from tiscene.usd.core.transform import to_matrix

MOST_TIMES = 10_000  # time codes between which what moves is sampled at every one


@dataclass(frozen=True)
class Inherited:
    """What changes over time among the prims that one gets its place and its visibility from.

    movers: the first that moves, and all below it. base: the world transform of what is above them. hiders: the prims
    whose visibility changes.
    """

    movers: tuple[Usd.Prim, ...] = ()
    base: Gf.Matrix4d | None = None
    hiders: tuple[Usd.Prim, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.movers or self.hiders)

    def below(self, prim: Usd.Prim, above: Gf.Matrix4d, hides: bool) -> Inherited:
        """The same with one more prim, whose parent's world transform is `above`."""
        result = replace(self, hiders=(*self.hiders, prim)) if hides else self
        xformable = UsdGeom.Xformable(prim)
        if not xformable or not (self.movers or xformable.TransformMightBeTimeVarying()):
            return result
        return replace(result, movers=(*self.movers, prim), base=self.base if self.movers else above)

    def times(self) -> list[float]:
        """The time codes at which something of it is authored, and those between; none if nothing changes."""
        times: set[float] = set()
        for prim in self.movers:
            times.update(UsdGeom.Xformable(prim).GetTimeSamples())
        times = set(filled(times))
        for prim in self.hiders:
            times.update(UsdGeom.Imageable(prim).GetVisibilityAttr().GetTimeSamples())
        return sorted(times) if len(times) > 1 else []

    def world(self, time: Usd.TimeCode, otherwise: Gf.Matrix4d) -> Gf.Matrix4d:
        """The world transform of the last mover; the other one if there are none."""
        if self.base is None:
            return otherwise
        world = self.base
        for prim in self.movers:
            xformable = UsdGeom.Xformable(prim)
            local = xformable.GetLocalTransformation(time)
            world = local if xformable.GetResetXformStack() else local * world
        return world

    def shown(self, time: Usd.TimeCode) -> bool:
        """Whether no hider is invisible."""
        invisible = UsdGeom.Tokens.invisible
        return all(UsdGeom.Imageable(prim).GetVisibilityAttr().Get(time) != invisible for prim in self.hiders)


NOTHING = Inherited()


@dataclass(frozen=True, eq=False)
class TransformSamples:
    """An instance at some time codes. matrices: float64 [s, 4, 4], m. present: bool [s]."""

    times: tuple[float, ...]
    matrices: NDArray[np.float64]
    present: NDArray[np.bool_]

    @property
    def changes(self) -> bool:
        """Whether it is ever elsewhere than at first, or gone."""
        return bool((self.matrices != self.matrices[:1]).any()) or not bool(self.present.all())

    @classmethod
    def of(cls, inherited: Inherited, otherwise: Gf.Matrix4d, meters: float) -> TransformSamples | None:
        """Where and when a prim is drawn that inherits this; None if that is always the same."""
        times = inherited.times()
        if not times:
            return None
        codes = [Usd.TimeCode(time) for time in times]
        matrices = np.array([to_matrix(inherited.world(code, otherwise), meters) for code in codes])
        samples = cls(tuple(times), matrices, np.array([inherited.shown(code) for code in codes], bool))
        return samples if samples.changes else None


def filled(times: Iterable[float], most: int = MOST_TIMES) -> list[float]:
    """Time codes, and the whole ones between: what USD interpolates, angles above all, is kept at those.

    most: how far apart the first and the last may be; where they are farther, these alone are.
    """
    every = set(times)
    if len(every) > 1 and max(every) - min(every) <= most:
        every.update(range(math.ceil(min(every)), math.floor(max(every)) + 1))
    return sorted(every)


def in_seconds(stage: Usd.Stage, times: Sequence[float]) -> NDArray[np.float64]:
    """Time codes as seconds since the start of the stage's range."""
    since: NDArray[np.float64] = np.array(times, np.float64) - stage.GetStartTimeCode()
    return since / float(stage.GetTimeCodesPerSecond())


def tracks_of(stage: Usd.Stage, samples: Sequence[TransformSamples | None]) -> tuple[InstanceTrack, ...]:
    """Tracks of instances by their rows; those with the same times share one."""
    rows: dict[tuple[float, ...], list[int]] = {}
    for row, each in enumerate(samples):
        if each is not None and each.changes:
            rows.setdefault(each.times, []).append(row)
    tracks = []
    for times, group in rows.items():
        chosen = [each for row in group if (each := samples[row]) is not None]
        matrices = np.stack([each.matrices[:, :3] for each in chosen], axis=1)
        present = np.stack([each.present for each in chosen], axis=1)
        tracks.append(InstanceTrack(np.array(group, np.int32), in_seconds(stage, times), matrices, present))
    return tuple(tracks)


def moved(tracks: Iterable[InstanceTrack], matrix: Matrix) -> tuple[InstanceTrack, ...]:
    """Tracks in a space that a 4x4 matrix leads to."""
    rotated = (np.einsum("ij,snjk->snik", matrix[:3, :3], track.matrices) for track in tracks)
    result = []
    for track, matrices in zip(tracks, rotated, strict=True):
        matrices[..., 3] += matrix[:3, 3]
        result.append(replace(track, matrices=matrices))
    return tuple(result)
