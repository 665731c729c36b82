# SPDX-License-Identifier: Apache-2.0
"""The walk over a stage: which prims draw, where, as part of which thing, and with which materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, cast

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdSkel

from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription, Template
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import (
    asset_name,
    direct_label,
    inherited_label,
    is_component,
    is_object_instance,
    name_label,
    taxonomies_of,
)
from tiscene.usd.core.time_samples import NOT_ANIMATED, AnimatedAncestors, TransformSamples
from tiscene.usd.core.transform import range_fault, is_singular, to_matrix
from tiscene.usd.geometry.deforming import is_time_varying
from tiscene.usd.geometry.skinning import is_unskinned
from tiscene.usd.lights.light import LightReader, is_light
from tiscene.usd.materials.material import Binding, MaterialTableBuilder
from tiscene.usd.materials.texture import TextureTable
from tiscene.usd.read.mesh_table import MeshTable, is_drawable
from tiscene.usd.read.object_builder import StageObject, StageObjectTable, collides, is_rigid_body
from tiscene.usd.read.point_instancer import Placed, PointInstances, PointSamples, instancer_times, point_instances
from tiscene.usd.read.stage_camera import read_camera

_DRAWN_PURPOSES = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
_NOTES = ("HoudiniLayerInfo",)  # types of other programs' prims that nobody is meant to see
_LOADED = Usd.PrimIsActive & Usd.PrimIsLoaded
DEFINED = Usd.TraverseInstanceProxies(_LOADED & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)
UNDEFINED_TOO = Usd.TraverseInstanceProxies(_LOADED)  # below a class or an over: prototypes and templates


@dataclass(frozen=True)
class TraversalContext:
    """What a prim inherits; by default, what the prims at a stage's root do.

    visible: at the time read; unless that changes, which `inherited` tells. label_is_own: whether `label` was authored
    within the thing that the prim is part of.
    """

    world: Gf.Matrix4d = field(default_factory=lambda: Gf.Matrix4d(1.0))
    visible: bool = True
    purpose: str = UsdGeom.Tokens.default_
    label: str = ""
    label_is_own: bool = False
    thing: StageObject | None = None
    inherited: AnimatedAncestors = NOT_ANIMATED

    @property
    def drawn(self) -> bool:
        """Whether gprims here are; colliders are in the way all the same."""
        return self.visible and self.purpose in _DRAWN_PURPOSES


class StageReader:
    """Collects a SceneDescription from the prims it is shown."""

    def __init__(self, stage: Usd.Stage, time: Usd.TimeCode, report: StageReport, taxonomy: str | None = None) -> None:
        """taxonomy: of the labels; None for the preferred ones."""
        self.by_name = not taxonomies_of(stage)  # what nobody labeled is what its name says
        self._taxonomy = taxonomy
        self.up_axis = cast(Literal["Y", "Z"], str(UsdGeom.GetStageUpAxis(stage)))
        self._stage = stage
        self._time = time
        self._report = report
        self._meters = float(UsdGeom.GetStageMetersPerUnit(stage))
        self._textures = TextureTable(report)
        self._materials = MaterialTableBuilder(self._textures, time, report)
        self._meshes = MeshTable(self._materials, time, report, self._meters)
        self._lights = LightReader(self._textures, time, report, self._meters, self.up_axis)
        self._cameras: list[Camera] = []
        self._things = StageObjectTable(stage)
        self._parts: list[Placed] | None = None  # where gprims go while they are parts of a prototype
        self._root = Sdf.Path.absoluteRootPath  # of that prototype
        self._top = Sdf.Path.absoluteRootPath  # of what is read
        self._inside: list[Any] = []  # the instancers being read: a prototype may not hold its own instancer

    def description(self, name: str, templates: tuple[Template, ...] = ()) -> SceneDescription:
        """Everything read so far."""
        return SceneDescription(
            name=name,
            meshes=tuple(self._meshes.meshes),
            materials=tuple(self._materials.materials),
            textures=tuple(self._textures.textures),
            instances=self._things.instances(),
            objects=self._things.objects(self.by_name),
            lights=tuple(self._lights.lights),
            cameras=tuple(self._cameras),
            colliders=self._things.colliders(),
            tracks=self._things.tracks(),
            up_axis=self.up_axis,
            templates=templates,
        )

    def walk(self, root: Usd.Prim, context: TraversalContext, predicate: Any = DEFINED) -> None:
        """Read a prim and everything below it."""
        if self._parts is None:
            self._top = root.GetPath()
        pending = [(root, context)]
        while pending:
            prim, above = pending.pop()
            self._report.budget.add_prim()
            with self._report.guard(prim.GetPath()):
                here = self._enter(prim, above)
                if self._read(prim, here, predicate):
                    pending += [(child, here) for child in reversed(prim.GetFilteredChildren(predicate))]

    def _enter(self, prim: Usd.Prim, above: TraversalContext) -> TraversalContext:
        """What the prim makes of what it inherits."""
        if prim.IsPseudoRoot():
            return above
        world, visible, purpose, inherited = above.world, above.visible, above.purpose, above.inherited
        in_prototype = self._parts is not None  # where the point is the thing
        is_thing = not in_prototype and (is_component(prim) or (above.thing is None and is_object_instance(prim)))
        if prim.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prim)
            visibility = imageable.GetVisibilityAttr()
            hides = False
            if self._report.reads_animation and self._moves_alone(prim, above, is_thing):
                inherited = replace(inherited, movers=(), base=None)
            elif self._report.reads_animation:
                hides = visibility.ValueMightBeTimeVarying()
                inherited = inherited.with_child(prim, above.world, hides)
            visible = visible and (hides or visibility.Get(self._time) != UsdGeom.Tokens.invisible)
            authored = imageable.GetPurposeAttr()
            if authored.HasAuthoredValue():
                purpose = str(authored.Get())
            if prim.IsA(UsdGeom.Xformable):
                xformable = UsdGeom.Xformable(prim)
                local = xformable.GetLocalTransformation(self._time)
                world = local if xformable.GetResetXformStack() else local * above.world
        direct = direct_label(prim, self._time, self._taxonomy)
        label, own = direct or above.label, bool(direct) or above.label_is_own
        thing = above.thing
        if is_thing:
            own = bool(direct)
            thing = StageObject.of(prim, label, own)
        if thing is not None and is_rigid_body(prim):
            thing.movable = True
        return TraversalContext(world, visible, purpose, label, own, thing, inherited)

    def _moves_alone(self, prim: Usd.Prim, above: TraversalContext, is_thing: bool) -> bool:
        """Whether moving and hiding a prim is up to a scenario: things and lights, or the whole of a template."""
        if self._parts is not None:
            return False
        if self._top != Sdf.Path.absoluteRootPath:
            return bool(prim.GetPath() == self._top)
        return is_thing or is_light(prim) or (above.thing is None and bool(prim.IsA(UsdGeom.Gprim)))

    def _read(self, prim: Usd.Prim, here: TraversalContext, predicate: Any) -> bool:
        """Read one prim; whether its children are to be read."""
        if prim.IsA(UsdGeom.Camera):
            self._read_camera(prim, here)
            return True
        lights = is_light(prim)
        if lights and (here.inherited.hiders or is_time_varying(UsdGeom.Imageable(prim).GetVisibilityAttr())):
            self._report.frozen(prim.GetPath(), "the visibility of a light")
        if prim.IsA(UsdGeom.PointInstancer):
            if here.drawn:
                self._read_instancer(prim, here)
            return False
        if not here.drawn:
            if is_drawable(prim) and collides(prim):
                self._read_gprim(prim, here)
            return True
        if prim.IsPseudoRoot():
            return True
        if lights:
            if here.inherited.is_visible(self._time):
                self._read_light(prim, here)
        elif is_drawable(prim):
            self._read_gprim(prim, here)
        elif not prim.IsA(UsdLux.PortalLight):  # those are read with the domes that name them
            self._report_undrawn(prim)
        return True

    def _report_undrawn(self, prim: Usd.Prim) -> None:
        """Name what a renderer is expected to draw, but this one does not."""
        kind = prim.GetTypeName()
        if prim.IsA(UsdGeom.Boundable) and not prim.IsA(UsdSkel.Root) and not prim.IsA(UsdSkel.Skeleton):
            self._report.omission(prim.GetPath(), f"prims of type {kind} are not drawn")
        elif kind and kind not in _NOTES and prim.GetPrimTypeInfo().GetSchemaType() == Tf.Type.Unknown:
            self._report.omission(prim.GetPath(), f"prims of the unknown type {kind} are not drawn")

    def _read_camera(self, prim: Usd.Prim, here: TraversalContext) -> None:
        if self._parts is not None:
            self._report.omission(prim.GetPath(), "cameras in a point instancer's prototypes are not read")
            return
        matrix = to_matrix(here.world, self._meters)
        camera = read_camera(prim, matrix, self._time, self._meters, self._report)
        if camera is not None:
            self._cameras.append(camera)

    def _read_light(self, prim: Usd.Prim, here: TraversalContext) -> None:
        if self._parts is not None:
            self._report.omission(prim.GetPath(), "lights in a point instancer's prototypes are not supported")
        elif prim.IsA(UsdGeom.Gprim):
            area = self._meshes.area(prim, to_matrix(here.world, self._meters)[:3, :3])
            emission = self._lights.mesh_emission(prim, area) if area > 0.0 else None
            if emission is not None:
                self._read_gprim(prim, here, self._materials.emitter(prim, emission))
        else:
            self._lights.add(prim, to_matrix(here.world, self._meters))

    def _read_gprim(self, prim: Usd.Prim, here: TraversalContext, emitter: Binding | None = None) -> None:
        mesh = self._meshes.row(prim, emitter)
        if mesh is None:
            return
        if here.drawn and is_unskinned(prim):
            self._report.omission(prim.GetPath(), "a mesh bound to a skeleton is drawn without its skinning")
        matrix = to_matrix(here.world, self._meters)
        samples = TransformSamples.of(here.inherited, here.world, self._meters) if self._parts is None else None
        wrong = range_fault(matrix if samples is None else samples.matrices)
        if wrong:
            self._report.problem(prim.GetPath(), "transform", wrong)
        elif samples is None and not here.inherited and is_singular(matrix):
            self._report.omission(prim.GetPath(), "what its transform squashes flat is not drawn")
        elif self._parts is not None:
            names = self._part_names(prim, self._root)
            placed = Placed(mesh, matrix, here.label, names, collides(prim), here.drawn, here.inherited)
            self._parts.append(placed)
        elif not here.drawn:
            thing = here.thing or StageObject.of(prim, here.label, True)
            self._things.add_collider(thing, mesh, matrix, str(prim.GetPath()))
        else:
            thing = here.thing or StageObject.of(prim, here.label, True)
            thing.movable = thing.movable or (here.thing is None and is_rigid_body(prim))
            if here.label_is_own and not thing.labeled:  # its first labeled part says what the whole is
                thing.category, thing.labeled = here.label, True
            names = self._part_names(prim, Sdf.Path(thing.path))
            self._things.add(thing, mesh, matrix, names, collides(prim), samples)

    def _part_names(self, prim: Usd.Prim, root: Sdf.Path) -> tuple[str, ...]:
        """What a gprim's parts are called within the thing or prototype at `root`."""
        path = prim.GetPath()
        within = prim.GetName() if path == root else str(path.MakeRelativePath(root))
        subsets = self._meshes.subset_names(prim)
        return tuple(f"{within}/{name}" if name else within for name in subsets)

    def _read_instancer(self, prim: Usd.Prim, here: TraversalContext) -> None:
        """Each point is one thing, made of all the meshes of its prototype."""
        if prim.GetPath() in self._inside:
            self._report.problem(prim.GetPath(), "instancer", "one of its prototypes holds the instancer itself")
            return
        world = to_matrix(here.world, self._meters)
        wrong = range_fault(world)
        if wrong:
            self._report.problem(prim.GetPath(), "transform", wrong)
            return
        own_times = instancer_times(prim) if self._report.reads_animation else []
        if own_times and self._parts is not None:
            self._report.frozen(prim.GetPath(), "a point instancer in a prototype of another")
            own_times = []
        moments = self._moments(prim, own_times)
        if moments is None:
            return
        used = np.unique(np.concatenate([each.prototype_of_point for each in moments.values()])).tolist()
        if not used:
            self._report.omission(prim.GetPath(), "a point instancer without points")
        roots = [moments[self._time].prototypes[number] for number in used]
        prototypes = [self._prototype(prim, root, here.purpose) for root in roots]
        if self._parts is not None:  # an instancer in a prototype: its points are parts of that one
            found = moments[self._time]
            for number, parts in zip(used, prototypes, strict=True):
                placed = world @ found.matrices[found.prototype_of_point == number]
                self._parts += [part.within(matrix) for matrix in placed for part in parts]
            return
        inner = (time for parts in prototypes for part in parts for time in part.inherited.times())
        times = sorted({*own_times, *here.inherited.times(), *inner})
        moments = self._moments(prim, times, moments) or moments
        points = PointSamples.of(list(moments.values()))
        for row, code in enumerate(moments):
            matrix = to_matrix(here.inherited.world(code, here.world), self._meters)
            points.matrices[row] = matrix @ points.matrices[row]
        things: dict[int, StageObject] = {}
        for number, root, parts in zip(used, roots, prototypes, strict=True):
            if parts:
                self._place_points(prim, here, root, parts, points, number, times, things)

    def _moments(
        self, prim: Usd.Prim, times: Sequence[float], known: Mapping[Usd.TimeCode, PointInstances] | None = None
    ) -> dict[Usd.TimeCode, PointInstances] | None:
        """An instancer at the time read, then at others; None, with the reason reported, if it is wrong at one."""
        result = {}
        for code in (self._time, *(Usd.TimeCode(time) for time in times)):
            found = (known or {}).get(code) or point_instances(prim, code, self._meters, self._report)
            if found is None:
                return None
            result[code] = found
        return result

    def _place_points(
        self,
        prim: Usd.Prim,
        here: TraversalContext,
        root: Usd.Prim,
        parts: Sequence[Placed],
        points: PointSamples,
        number: int,
        times: Sequence[float],
        things: dict[int, StageObject],
    ) -> None:
        """The points that show one prototype, by its number. things: those of the points so far, by their ids."""
        labels = (
            direct_label(root, self._time, self._taxonomy),
            *(p.label for p in parts),
            inherited_label(root, self._time, self._taxonomy),
        )
        category = next((label for label in labels if label), here.label)
        codes = list(dict.fromkeys([self._time, *(Usd.TimeCode(time) for time in times)]))
        order = [codes.index(Usd.TimeCode(time)) for time in times]
        rows = np.flatnonzero((points.prototype == number).any(axis=0))
        there = points.prototype[:, rows] == number
        there &= np.array([here.inherited.is_visible(code) for code in codes])[:, None]
        own = [np.array([part.at(code, self._meters) for code in codes]) for part in parts]
        shown = [there & np.array([part.inherited.is_visible(code) for code in codes])[:, None] for part in parts]
        name, path, by_name = prim.GetName(), str(prim.GetPath()), name_label(root)
        placed = [points.matrices[:, rows] @ matrix[:, None] for matrix in own]
        movable, asset = is_rigid_body(root), asset_name(root)
        for row, point in enumerate(points.ids[rows].tolist()):
            new = StageObject(f"{name}[{point}]", f"{path}[{point}]", category, True, by_name, asset, movable=movable)
            thing = things.setdefault(point, new)
            for part, world, present in zip(parts, placed, shown, strict=True):
                if not part.drawn:
                    self._things.add_collider(thing, part.mesh, world[0, row], thing.path)
                    continue
                samples = TransformSamples(tuple(times), world[order, row], present[order, row]) if times else None
                self._things.add(thing, part.mesh, world[0, row], part.names, part.collides, samples)

    def _prototype(self, instancer: Usd.Prim, root: Usd.Prim, purpose: str) -> Sequence[Placed]:
        """A prototype's meshes in the space of its parent."""
        outer, parts = (self._parts, self._root), list[Placed]()
        self._parts, self._root = parts, root.GetPath()
        self._inside.append(instancer.GetPath())
        self.walk(root, TraversalContext(purpose=purpose), UNDEFINED_TOO)
        self._inside.pop()
        self._parts, self._root = outer
        return parts
