# SPDX-License-Identifier: Apache-2.0
"""Animation by time samples within objects: moving parts, points of instancers, groups that appear and vanish.

Whole objects that move become keyframes of a scenario (`keyframes`). All other animation of a stage becomes an
InstanceTrack: transforms and presence of instances over time, from the samples of a prim and of its ancestors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from tiscene.scene.animation import ColorTrack, InstanceTrack
from tiscene.scene.description import Matrix
from tiscene.usd.core.transform import is_singular, to_matrix
from tiscene.usd.core.value_times import JUMP, dense_times, transform_times

_ALWAYS = (-math.inf, math.inf)


@dataclass(frozen=True)
class AnimatedAncestors:
    """The animated prims from which a prim inherits its transform and visibility. False if there are none.

    Attributes:
        movers: the topmost prim with an animated transform, and all prims below it on the way.
        base: world transform of the parent of the first mover, in stage units; None without movers.
        hiders: the prims with animated visibility.
        shown: the first time code at which the prim itself is shown, and the first after.
    """

    movers: tuple[Usd.Prim, ...] = ()
    base: Gf.Matrix4d | None = None
    hiders: tuple[Usd.Prim, ...] = ()
    shown: tuple[float, float] = _ALWAYS

    def __bool__(self) -> bool:
        return bool(self.movers or self.hiders or self.shown != _ALWAYS)

    def with_child(self, prim: Usd.Prim, parent_world: Gf.Matrix4d, hides: bool) -> AnimatedAncestors:
        """Return these ancestors and one of their children.

        Args:
            prim: the child.
            parent_world: world transform of its parent, in stage units.
            hides: whether its visibility is animated.
        """
        result = self.hidden_by(prim) if hides else self
        xformable = UsdGeom.Xformable(prim)
        if not xformable or not (self.movers or xformable.TransformMightBeTimeVarying()):
            return result
        return replace(result, movers=(*self.movers, prim), base=self.base if self.movers else parent_world)

    def hidden_by(self, prim: Usd.Prim) -> AnimatedAncestors:
        """Return these ancestors and another prim with animated visibility."""
        return replace(self, hiders=(*self.hiders, prim))

    def during(self, start: float, end: float) -> AnimatedAncestors:
        """Return these ancestors of a prim that is shown from a time code until before another one."""
        return replace(self, shown=(start, end))

    def below(self, outer: Gf.Matrix4d, hiders: tuple[Usd.Prim, ...]) -> AnimatedAncestors:
        """Return these ancestors of a prototype's prim, where the prototype is at a transform and below hiders."""
        base = None if self.base is None else self.base * outer
        return replace(self, base=base, hiders=(*hiders, *self.hiders))

    def times(self) -> list[float]:
        """Return the time codes of all samples, and the steps between them; empty if nothing changes.

        What moves has one just before it vanishes too, since it would stand still after the last sample it is shown at.
        """
        times: set[float] = set()
        for prim in self.movers:
            times.update(transform_times(UsdGeom.Xformable(prim)))
        times = set(dense_times(times, self.movers[0].GetStage())) if self.movers else times
        for prim in self.hiders:
            visibility = UsdGeom.Imageable(prim).GetVisibilityAttr()
            times.update(samples := visibility.GetTimeSamples())
            hidden = [visibility.Get(time) == UsdGeom.Tokens.invisible for time in samples]
            vanishing = [samples[row] for row in range(1, len(samples)) if hidden[row] and not hidden[row - 1]]
            times.update(time - JUMP for time in vanishing if self.movers)
        for time in filter(math.isfinite, self.shown):
            times.update((time - 1.0, time, *([time - JUMP] if self.movers else [])))
        return sorted(times) if len(times) > 1 else []

    def world(self, time: Usd.TimeCode, static: Gf.Matrix4d) -> Gf.Matrix4d:
        """Return the world transform of the last mover at a time code, or `static` if there are no movers."""
        if self.base is None:
            return static
        world = self.base
        for prim in self.movers:
            xformable = UsdGeom.Xformable(prim)
            local = xformable.GetLocalTransformation(time)
            world = local if xformable.GetResetXformStack() else local * world
        return world

    def is_visible(self, time: Usd.TimeCode) -> bool:
        """Return whether the prim is shown, and none of the hiders invisible, at a time code."""
        invisible = UsdGeom.Tokens.invisible
        if not self.shown[0] <= time.GetValue() < self.shown[1]:
            return False
        return all(UsdGeom.Imageable(prim).GetVisibilityAttr().Get(time) != invisible for prim in self.hiders)


NOT_ANIMATED = AnimatedAncestors()


@dataclass(frozen=True, eq=False)
class TransformSamples:
    """Transform and presence of one instance at some time codes.

    Attributes:
        times: the time codes, ascending.
        matrices: float64 [s, 4, 4], world from instance, meters.
        present: bool [s], whether the instance is visible, and not flattened.
    """

    times: tuple[float, ...]
    matrices: NDArray[np.float64]
    present: NDArray[np.bool_]

    @property
    def changes(self) -> bool:
        """Whether the instance ever moves or vanishes."""
        return bool((self.matrices != self.matrices[:1]).any()) or not bool(self.present.all())

    @classmethod
    def of(
        cls,
        ancestors: AnimatedAncestors,
        static: Gf.Matrix4d,
        meters: float,
        known: dict[float, tuple[Matrix, bool]] | None = None,
    ) -> TransformSamples | None:
        """Return the samples of a prim with these ancestors; None if it never changes.

        Args:
            ancestors: animated ancestors, the prim itself included.
            static: its world transform if none of them moves, in stage units.
            meters: meters per stage unit.
            known: transforms of the prim by time code, and whether they flatten it; added to.
        """
        times = ancestors.times()
        if not times:
            return None
        known = {} if known is None else known
        for time in times:
            if time not in known:
                matrix = to_matrix(ancestors.world(Usd.TimeCode(time), static), meters)
                known[time] = matrix, is_singular(matrix)
        matrices, flat = zip(*(known[time] for time in times), strict=True)
        # What its transform flattens is not drawn.
        visible = [ancestors.is_visible(Usd.TimeCode(t)) and not each for t, each in zip(times, flat, strict=True)]
        samples = cls(tuple(times), np.array(matrices), np.array(visible, bool))
        return samples if samples.changes else None


@dataclass(frozen=True, eq=False)
class ColorSamples:
    """Color of one instance, see `Instance.color`.

    Attributes:
        color: float32 [4], at the time read.
        times: time codes at which it is authored, ascending; empty: it never changes.
        colors: float32 [s, 4], at the times.
    """

    color: NDArray[np.float32]
    times: tuple[float, ...]
    colors: NDArray[np.float32]


def in_seconds(stage: Usd.Stage, times: Sequence[float]) -> NDArray[np.float64]:
    """Return time codes as seconds since the start of the stage's range, float64."""
    elapsed: NDArray[np.float64] = np.array(times, np.float64) - stage.GetStartTimeCode()
    return elapsed / float(stage.GetTimeCodesPerSecond())


def tracks_of(stage: Usd.Stage, samples: Sequence[TransformSamples | None]) -> tuple[InstanceTrack, ...]:
    """Return the tracks of instances; instances with the same times share a track.

    Args:
        stage: gives the time code rate.
        samples: one row per instance; None for a static one.
    """
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


def color_tracks_of(stage: Usd.Stage, samples: Sequence[ColorSamples | None]) -> tuple[ColorTrack, ...]:
    """Return the tracks of instances whose color changes, as `tracks_of` does."""
    rows: dict[tuple[float, ...], list[int]] = {}
    for row, each in enumerate(samples):
        if each is not None and each.colors[1:].tobytes() != each.colors[:-1].tobytes():
            rows.setdefault(each.times, []).append(row)
    tracks = []
    for times, group in rows.items():
        colors = np.stack([each.colors for row in group if (each := samples[row]) is not None], axis=1)
        tracks.append(ColorTrack(np.array(group, np.int32), in_seconds(stage, times), colors))
    return tuple(tracks)


def transformed(tracks: Iterable[InstanceTrack], matrix: Matrix) -> tuple[InstanceTrack, ...]:
    """Return tracks with their transforms multiplied from the left by a 4x4 matrix."""
    result = []
    for track in tracks:
        matrices = np.einsum("ij,snjk->snik", matrix[:3, :3], track.matrices)
        matrices[..., 3] += matrix[:3, 3]
        result.append(replace(track, matrices=matrices))
    return tuple(result)
