# SPDX-License-Identifier: Apache-2.0
"""PointInstancerReader: point instancers as objects, one for each point, with the lights of their prototypes.

It is a part of `traversal.StageReader`, which traverses a prototype as it traverses a stage.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from tiscene.scene.description import Matrix
from tiscene.scene.input_track import InputTrack
from tiscene.usd.core.broken_prims import ENDLESS
from tiscene.usd.core.prims import ALSO_ABSTRACT
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import asset_name, direct_label, inherited_label, name_label
from tiscene.usd.core.time_samples import AnimatedAncestors, ColorSamples, TransformSamples
from tiscene.usd.core.transform import from_matrix, range_fault, to_matrix
from tiscene.usd.geometry.point_primvars import EnclosingInstancers, PointPrimvars
from tiscene.usd.lights.animated_light import light_track
from tiscene.usd.lights.light import LightReader
from tiscene.usd.materials.material import MaterialTableBuilder
from tiscene.usd.read.mesh_table import MeshTable
from tiscene.usd.read.object_builder import StageObject, StageObjectTable, is_rigid_body
from tiscene.usd.read.point_instancer import (
    NestedPoint,
    PointInstances,
    PointSamples,
    PrototypePart,
    instancer_times,
    point_instances,
)
from tiscene.usd.read.traversal_context import TraversalContext


class PrototypeLight(NamedTuple):
    """A light in a prototype.

    Attributes:
        prim: the light.
        matrix: its transform in the space of the prototype's parent.
        animated: it and its ancestors that are animated, up to the prototype.
    """

    prim: Usd.Prim
    matrix: Matrix
    animated: AnimatedAncestors


class _Instancer(NamedTuple):
    """An instancer that is being read.

    Attributes:
        prim: the instancer.
        here: its context.
        world: its world transform, m.
        points: its points at the time read.
        primvars: what the points give.
    """

    prim: Usd.Prim
    here: TraversalContext
    world: Matrix
    points: PointInstances
    primvars: PointPrimvars


class PointInstancerReader:
    """Reads point instancers. While the prototype of one is traversed, its parts and lights are collected."""

    _time: Usd.TimeCode
    _taxonomy: str | None
    _report: StageReport
    _meters: float
    _materials: MaterialTableBuilder
    _meshes: MeshTable
    _lights: LightReader
    _objects: StageObjectTable

    def __init__(self) -> None:
        """Start outside of any prototype."""
        self._parts: list[PrototypePart] | None = None  # of the prototype that is traversed, so far
        self._prototype_lights: list[PrototypeLight] = []
        self._light_tracks: list[InputTrack] = []
        self._prototype_root = Sdf.Path.absoluteRootPath
        self._instancers = EnclosingInstancers()
        self._open_instancers: list[Any] = []  # being read: a prototype may not contain its own instancer

    def walk(self, root: Usd.Prim, context: TraversalContext, predicate: Any) -> None:
        """Read a prim and its descendants."""
        raise NotImplementedError

    def _read_instancer(self, prim: Usd.Prim, here: TraversalContext) -> None:
        """Read a point instancer: each point is an object that consists of all meshes of its prototype."""
        if prim.GetPath() in self._open_instancers:
            self._report.problem(prim.GetPath(), "instancer", ENDLESS)
            return
        world = to_matrix(here.world, self._meters)
        if fault := range_fault(world):
            self._report.problem(prim.GetPath(), "transform", fault)
            return
        own_times = instancer_times(prim) if self._report.reads_animation else []
        if own_times and self._parts is not None:
            self._report.frozen(prim.GetPath(), "a point instancer in a prototype of another")
            own_times = []
        instances = self._instances_at(prim, own_times)
        if instances is None:
            return
        used = np.unique(np.concatenate([each.prototype_of_point for each in instances.values()])).tolist()
        if not used:
            self._report.omission(prim.GetPath(), "a point instancer without points")
        primvars = PointPrimvars(prim, self._time, self._report)
        instancer = _Instancer(prim, here, world, instances[self._time], primvars)
        prototypes, lights = {}, {}
        for number in used:
            root = instancer.points.prototypes[number]
            with self._instancers.reading(primvars, prim, root):
                prototypes[number], lights[number] = self._prototype(prim, root, here)
        given = {part.of_points for parts in prototypes.values() for part in parts}
        own_color_times = {time for names in given for time in primvars.times(names)}
        if any(lights.values()) and (own_times or here.animated.movers):
            self._report.frozen(prim.GetPath(), "the place of the lights at the points of an instancer")
        for number in used:
            self._place_lights(instancer, number, lights[number])
        if self._parts is not None:  # the points of an instancer in a prototype are parts of that prototype
            if own_color_times:
                self._report.frozen(prim.GetPath(), "the color of points of an instancer in a prototype of another")
            for number in used:
                self._parts += self._nested(instancer, number, prototypes[number])
            return
        part_times = (time for parts in prototypes.values() for part in parts for time in part.times())
        times = sorted({*own_times, *here.animated.times(), *part_times})
        color_times = sorted({*own_color_times, *times})
        if times:  # else the same points are there at all times
            times = color_times
        instances = self._instances_at(prim, times, instances) or instances
        points = PointSamples.of(list(instances.values()))
        for row, code in enumerate(instances):
            matrix = to_matrix(here.animated.world(code, here.world), self._meters)
            points.matrices[row] = matrix @ points.matrices[row]
        objects: dict[int, StageObject] = {}
        for number in used:
            if prototypes[number]:
                self._place_points(instancer, number, prototypes[number], points, times, color_times, objects)

    def _place_lights(self, instancer: _Instancer, number: int, lights: Sequence[PrototypeLight]) -> None:
        """Add the lights of a prototype, by its number, at each of its points, as they are at the time read."""
        points = instancer.points
        for row in np.flatnonzero(points.prototype_of_point == number) if lights else ():
            point = instancer.world @ points.matrices[row]
            for light, matrix, animated in lights:
                placed = animated.below(from_matrix(point, self._meters), instancer.here.animated.hiders)
                if self._parts is not None:
                    self._prototype_lights.append(PrototypeLight(light, point @ matrix, placed))
                else:
                    suffix = f"[{instancer.prim.GetName()} {points.ids[row]}]"
                    self._add_light(light, point @ matrix, placed, suffix=suffix)

    def _nested(self, instancer: _Instancer, number: int, parts: Sequence[PrototypePart]) -> list[PrototypePart]:
        """Return the parts of the points that show a prototype, by its number, as parts of an outer prototype."""
        points, primvars = instancer.points, instancer.primvars
        rows = np.flatnonzero(points.prototype_of_point == number)
        colors = [primvars.colors(part.of_points, self._time)[points.rows[rows]] for part in parts]
        left = [cast(Any, tuple("" if name in primvars else name for name in part.of_points)) for part in parts]
        own = [np.where(np.isnan(each), part.color, each) for part, each in zip(parts, colors, strict=True)]
        matrices, ancestors = points.matrices[rows], instancer.here.animated
        nested = [NestedPoint(*each, ancestors) for each in zip(instancer.world @ matrices, matrices, strict=True)]
        return [
            part.nested(point, color[row], others)
            for row, point in enumerate(nested)
            for part, color, others in zip(parts, own, left, strict=True)
        ]

    def _add_light(
        self,
        prim: Usd.Prim,
        matrix: Matrix,
        ancestors: AnimatedAncestors,
        *,
        emission: bool = True,
        suffix: str = "",
    ) -> None:
        """Read a light and how it varies over time, unless it is never visible.

        Args:
            prim: the light.
            matrix: its world transform.
            ancestors: its animated ancestors.
            emission: whether to read how its emission varies.
            suffix: appended to its name and path.
        """
        row = len(self._lights.lights)
        self._lights.add(prim, matrix)
        if len(self._lights.lights) == row:
            return
        track = light_track(self._lights, row, prim, matrix, ancestors, self._report, emission=emission)
        shown = (ancestors.is_visible(self._time),) if track is None else track.present
        if shown and not any(shown):  # (): always
            self._lights.lights.pop()
            self._lights.any_off = True
            return
        if track is not None:
            self._light_tracks.append(track)
        self._lights.rename_last(suffix)

    def _instances_at(
        self, prim: Usd.Prim, times: Sequence[float], known: Mapping[Usd.TimeCode, PointInstances] | None = None
    ) -> dict[Usd.TimeCode, PointInstances] | None:
        """Return an instancer's points at the time read, then at others; None, with a problem reported, if invalid.

        Args:
            prim: the instancer.
            times: the other time codes.
            known: points that have been read already.
        """
        result = {}
        for code in (self._time, *(Usd.TimeCode(time) for time in times)):
            found = (known or {}).get(code) or point_instances(prim, code, self._meters, self._report)
            if found is None:
                return None
            result[code] = found
        return result

    def _place_points(
        self,
        instancer: _Instancer,
        number: int,
        parts: Sequence[PrototypePart],
        points: PointSamples,
        times: Sequence[float],
        color_times: Sequence[float],
        objects: dict[int, StageObject],
    ) -> None:
        """Add the points that ever show one prototype.

        Args:
            instancer: the instancer.
            number: of the prototype.
            parts: parts of the prototype.
            points: all points at the time read, then at `times`.
            times: time codes of the animation; empty: static.
            color_times: those of the colors.
            objects: objects of the points so far by id, added to.
        """
        prim, here, root = instancer.prim, instancer.here, instancer.points.prototypes[number]
        colors = [self._colors_of(part, points, color_times, instancer.primvars) for part in parts]
        labels = (
            direct_label(root, self._time, self._taxonomy),
            *(p.label for p in parts),
            inherited_label(root, self._time, self._taxonomy),
        )
        category = next((label for label in labels if label), here.label)
        codes = list(dict.fromkeys([self._time, *(Usd.TimeCode(time) for time in times)]))
        order = [codes.index(Usd.TimeCode(time)) for time in times]
        rows = np.flatnonzero((points.prototype == number).any(axis=0))
        present = points.prototype[:, rows] == number
        present &= np.array([here.animated.is_visible(code) for code in codes])[:, None]
        local = [
            self._meshes.placed(part.mesh, np.array([part.matrix_at(code, self._meters) for code in codes]))
            for part in parts
        ]
        visible = [present & np.array([part.is_visible(code) for code in codes])[:, None] for part in parts]
        name, path, by_name = prim.GetName(), str(prim.GetPath()), name_label(root)
        worlds = [points.matrices[:, rows] @ matrix[:, None] for matrix in local]
        movable, asset = is_rigid_body(root), asset_name(root)
        for row, point in enumerate(points.ids[rows].tolist()):
            pose = points.matrices[:, rows[row]]
            moves = TransformSamples(tuple(times), pose[order], np.ones(len(times), bool)) if times else None
            names = f"{name}[{point}]", f"{path}[{point}]"
            new = StageObject(*names, category, True, by_name, asset, pose[0], moves, movable=movable)
            owner = objects.setdefault(point, new)
            for part, world, shown, color in zip(parts, worlds, visible, colors, strict=True):
                if not part.is_drawn:
                    if not part.continues:
                        self._objects.add_collider(owner, part.mesh, world[0, row], owner.path)
                    continue
                own = None
                if color is not None:
                    own = ColorSamples(color[0, rows[row]], tuple(color_times), color[1:, rows[row]])
                samples = TransformSamples(tuple(times), world[order, row], shown[order, row]) if times else None
                placed = world[0, row], part.names, part.collides
                self._objects.add(owner, part.mesh, *placed, samples, continues=part.continues, color=own)

    def _colors_of(
        self, part: PrototypePart, points: PointSamples, times: Sequence[float], primvars: PointPrimvars
    ) -> NDArray[np.float32] | None:
        """Return the colors of a part at all points at the time read, then at time codes; None if it has no own.

        Returns:
            float32 [1 + times, points, 4].
        """
        if not any(part.of_points):
            return None if np.isnan(part.color).all() else np.tile(part.color, (1 + len(times), len(points.ids), 1))
        codes = list(dict.fromkeys([self._time, *(Usd.TimeCode(time) for time in times)]))
        colors = points.spread([primvars.colors(part.of_points, code) for code in codes])
        colors = np.where(np.isnan(colors), part.color, colors)
        return colors[[0, *(codes.index(Usd.TimeCode(time)) for time in times)]]

    def _prototype(
        self, instancer: Usd.Prim, root: Usd.Prim, outside: TraversalContext
    ) -> tuple[Sequence[PrototypePart], Sequence[PrototypeLight]]:
        """Return the parts and the lights of a prototype, in the space of its parent; `outside`: of its instancer."""
        outer = self._parts, self._prototype_root, self._prototype_lights
        parts, lights = list[PrototypePart](), list[PrototypeLight]()
        self._parts, self._prototype_root, self._prototype_lights = parts, root.GetPath(), lights
        self._open_instancers.append(instancer.GetPath())
        self.walk(root, TraversalContext(purpose=outside.purpose, renders=outside.renders), ALSO_ABSTRACT)
        self._open_instancers.pop()
        self._parts, self._prototype_root, self._prototype_lights = outer
        return parts, lights
