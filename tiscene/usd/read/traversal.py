# SPDX-License-Identifier: Apache-2.0
"""StageReader: traverse the prims of a stage and collect meshes, materials, objects, lights and cameras.

Transform, visibility, purpose, label and object are passed down from prim to prim in a `TraversalContext`. While the
prototype of a point instancer is traversed, its meshes are collected as `PrototypePart`s and placed once per point.
"""

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
from tiscene.usd.core.transform import is_singular, range_fault, to_matrix
from tiscene.usd.geometry.deforming import is_time_varying
from tiscene.usd.geometry.skinning import is_unskinned
from tiscene.usd.lights.light import LightReader, is_light
from tiscene.usd.materials.material import Binding, MaterialTableBuilder
from tiscene.usd.materials.texture import TextureTable
from tiscene.usd.read.mesh_table import MeshTable, is_drawable
from tiscene.usd.read.object_builder import StageObject, StageObjectTable, collides, is_rigid_body
from tiscene.usd.read.point_instancer import (
    PointInstances,
    PointSamples,
    PrototypePart,
    instancer_times,
    point_instances,
)
from tiscene.usd.read.stage_camera import read_camera, with_unique_names
from tiscene.usd.read.stage_render_settings import read_render_settings

_DRAWN_PURPOSES = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
_METADATA_TYPES = ("HoudiniLayerInfo",)  # types of prims in which other programs keep their own data
_LOADED = Usd.PrimIsActive & Usd.PrimIsLoaded
DEFINED = Usd.TraverseInstanceProxies(_LOADED & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)
ALSO_ABSTRACT = Usd.TraverseInstanceProxies(_LOADED)  # prototypes and templates may be below a class or an over


@dataclass(frozen=True)
class TraversalContext:
    """What a prim inherits from its ancestors. The default is that of prims at a stage's root.

    Attributes:
        world: world transform, in stage units.
        visible: visibility at the time read; True where it is animated (`animated`).
        purpose: UsdGeomImageable's purpose.
        label: semantic label, "" for none.
        label_is_own: whether the label was authored within the object that the prim is part of.
        owner: the object that the prim is part of; None: not in an object.
        animated: animated ancestors.
    """

    world: Gf.Matrix4d = field(default_factory=lambda: Gf.Matrix4d(1.0))
    visible: bool = True
    purpose: str = UsdGeom.Tokens.default_
    label: str = ""
    label_is_own: bool = False
    owner: StageObject | None = None
    animated: AnimatedAncestors = NOT_ANIMATED

    @property
    def is_drawn(self) -> bool:
        """Whether gprims with this context are drawn. Colliders collide even if they are not."""
        return self.visible and self.purpose in _DRAWN_PURPOSES


class StageReader:
    """Collects a SceneDescription from the prims that it traverses."""

    def __init__(self, stage: Usd.Stage, time: Usd.TimeCode, report: StageReport, taxonomy: str | None = None) -> None:
        """Start with an empty description.

        Args:
            stage: the stage.
            time: time code to read at.
            report: receives problems and omissions.
            taxonomy: taxonomy of the labels; None: the preferred ones.
        """
        self.by_name = not taxonomies_of(stage)  # categories of a stage without labels are derived from names
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
        self._cameras: list[tuple[Sdf.Path, Camera]] = []
        self._objects = StageObjectTable(stage)
        self._settings = read_render_settings(stage, report)
        self._top = Sdf.Path.absoluteRootPath  # root of the outermost traversal
        # While the prototype of a point instancer is traversed: its parts so far, and its root.
        self._parts: list[PrototypePart] | None = None
        self._prototype_root = Sdf.Path.absoluteRootPath
        self._open_instancers: list[Any] = []  # being read: a prototype may not contain its own instancer

    def description(self, name: str, templates: tuple[Template, ...] = ()) -> SceneDescription:
        """Return what has been read so far, with a name and templates."""
        return SceneDescription(
            name=name,
            meshes=tuple(self._meshes.meshes),
            materials=tuple(self._materials.materials),
            textures=tuple(self._textures.textures),
            instances=self._objects.instances(),
            objects=self._objects.objects(self.by_name),
            lights=tuple(self._lights.lights),
            cameras=tuple(with_unique_names(self._settings.main_first(self._cameras, lambda each: each[0]))),
            colliders=self._objects.colliders(),
            tracks=self._objects.tracks(),
            up_axis=self.up_axis,
            templates=templates,
            resolution=self._settings.resolution,
        )

    def walk(self, root: Usd.Prim, context: TraversalContext, predicate: Any = DEFINED) -> None:
        """Read a prim and its descendants.

        Args:
            root: the prim.
            context: what it inherits.
            predicate: which children to traverse.
        """
        if self._parts is None:
            self._top = root.GetPath()
        pending = [(root, context)]
        while pending:
            prim, inherited = pending.pop()
            self._report.budget.add_prim()
            with self._report.guard(prim.GetPath()):
                here = self._enter(prim, inherited)
                if self._read(prim, here, predicate):
                    pending += [(child, here) for child in reversed(prim.GetFilteredChildren(predicate))]

    def _enter(self, prim: Usd.Prim, inherited: TraversalContext) -> TraversalContext:
        """Return the context of a prim, given that of its parent."""
        if prim.IsPseudoRoot():
            return inherited
        world, visible, purpose, animated = inherited.world, inherited.visible, inherited.purpose, inherited.animated
        in_prototype = self._parts is not None  # there the point is the object
        is_object = not in_prototype and (is_component(prim) or (inherited.owner is None and is_object_instance(prim)))
        if prim.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prim)
            visibility = imageable.GetVisibilityAttr()
            hides = False
            if self._report.reads_animation and self._is_animated_by_scenario(prim, inherited, is_object):
                animated = replace(animated, movers=(), base=None)
            elif self._report.reads_animation:
                hides = visibility.ValueMightBeTimeVarying()
                animated = animated.with_child(prim, inherited.world, hides)
            visible = visible and (hides or visibility.Get(self._time) != UsdGeom.Tokens.invisible)
            authored = imageable.GetPurposeAttr()
            if authored.HasAuthoredValue():
                purpose = str(authored.Get())
            if prim.IsA(UsdGeom.Xformable):
                xformable = UsdGeom.Xformable(prim)
                local = xformable.GetLocalTransformation(self._time)
                world = local if xformable.GetResetXformStack() else local * inherited.world
        direct = direct_label(prim, self._time, self._taxonomy)
        label, own = direct or inherited.label, bool(direct) or inherited.label_is_own
        owner = inherited.owner
        if is_object:
            own = bool(direct)
            owner = StageObject.of(prim, label, own)
        if owner is not None and is_rigid_body(prim):
            owner.movable = True
        return TraversalContext(world, visible, purpose, label, own, owner, animated)

    def _is_animated_by_scenario(self, prim: Usd.Prim, inherited: TraversalContext, is_object: bool) -> bool:
        """Return whether a scenario animates a prim, not an instance track: objects, lights and whole templates."""
        if self._parts is not None:
            return False
        if self._top != Sdf.Path.absoluteRootPath:
            return bool(prim.GetPath() == self._top)
        return is_object or is_light(prim) or (inherited.owner is None and bool(prim.IsA(UsdGeom.Gprim)))

    def _read(self, prim: Usd.Prim, here: TraversalContext, predicate: Any) -> bool:
        """Read one prim and return whether to traverse its children."""
        if prim.IsA(UsdGeom.Camera):
            self._read_camera(prim, here)
            return True
        lights = is_light(prim)
        if lights and (here.animated.hiders or is_time_varying(UsdGeom.Imageable(prim).GetVisibilityAttr())):
            self._report.frozen(prim.GetPath(), "the visibility of a light")
        if prim.IsA(UsdGeom.PointInstancer):
            if here.is_drawn:
                self._read_instancer(prim, here)
            return False
        if not here.is_drawn:
            if is_drawable(prim) and collides(prim):
                self._read_gprim(prim, here)
            return True
        if prim.IsPseudoRoot():
            return True
        if lights:
            if here.animated.is_visible(self._time):
                self._read_light(prim, here)
        elif is_drawable(prim):
            self._read_gprim(prim, here)
        elif not prim.IsA(UsdLux.PortalLight):  # portals are read with their dome light
            self._report_undrawn(prim)
        return True

    def _report_undrawn(self, prim: Usd.Prim) -> None:
        """Report a prim that other renderers draw and this one does not."""
        kind = prim.GetTypeName()
        if prim.IsA(UsdGeom.Boundable) and not prim.IsA(UsdSkel.Root) and not prim.IsA(UsdSkel.Skeleton):
            self._report.omission(prim.GetPath(), f"prims of type {kind} are not drawn")
        elif kind and kind not in _METADATA_TYPES and prim.GetPrimTypeInfo().GetSchemaType() == Tf.Type.Unknown:
            self._report.omission(prim.GetPath(), f"prims of the unknown type {kind} are not drawn")

    def _read_camera(self, prim: Usd.Prim, here: TraversalContext) -> None:
        if self._parts is not None:
            self._report.omission(prim.GetPath(), "cameras in a point instancer's prototypes are not read")
            return
        matrix = to_matrix(here.world, self._meters)
        camera = read_camera(prim, matrix, self._time, self._meters, self._report, self._settings.policy)
        if camera is not None:
            self._cameras.append((prim.GetPath(), camera))

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
        if here.is_drawn and is_unskinned(prim):
            self._report.omission(prim.GetPath(), "a mesh bound to a skeleton is drawn without its skinning")
        matrix = to_matrix(here.world, self._meters)
        samples = TransformSamples.of(here.animated, here.world, self._meters) if self._parts is None else None
        if fault := range_fault(matrix if samples is None else samples.matrices):
            self._report.problem(prim.GetPath(), "transform", fault)
        elif samples is None and not here.animated and is_singular(matrix):
            self._report.omission(prim.GetPath(), "geometry that its transform flattens is not drawn")
        elif self._parts is not None:
            names = self._part_names(prim, self._prototype_root)
            part = PrototypePart(mesh, matrix, here.label, names, collides(prim), here.is_drawn, here.animated)
            self._parts.append(part)
        elif not here.is_drawn:
            owner = here.owner or StageObject.of(prim, here.label, True)
            self._objects.add_collider(owner, mesh, matrix, str(prim.GetPath()))
        else:
            owner = here.owner or StageObject.of(prim, here.label, True)
            owner.movable = owner.movable or (here.owner is None and is_rigid_body(prim))
            if here.label_is_own and not owner.is_labeled:  # the object's category is that of its first labeled part
                owner.category, owner.is_labeled = here.label, True
            names = self._part_names(prim, Sdf.Path(owner.path))
            self._objects.add(owner, mesh, matrix, names, collides(prim), samples)

    def _part_names(self, prim: Usd.Prim, root: Sdf.Path) -> tuple[str, ...]:
        """Return the names of a gprim's parts, relative to the object or prototype at `root`."""
        path = prim.GetPath()
        relative = prim.GetName() if path == root else str(path.MakeRelativePath(root))
        subsets = self._meshes.subset_names(prim)
        return tuple(f"{relative}/{name}" if name else relative for name in subsets)

    def _read_instancer(self, prim: Usd.Prim, here: TraversalContext) -> None:
        """Read a point instancer: each point is an object that consists of all meshes of its prototype."""
        if prim.GetPath() in self._open_instancers:
            self._report.problem(prim.GetPath(), "instancer", "one of its prototypes contains the instancer itself")
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
        roots = [instances[self._time].prototypes[number] for number in used]
        prototypes = [self._prototype(prim, root, here.purpose) for root in roots]
        if self._parts is not None:  # the points of an instancer in a prototype are parts of that prototype
            found = instances[self._time]
            for number, parts in zip(used, prototypes, strict=True):
                matrices = world @ found.matrices[found.prototype_of_point == number]
                self._parts += [part.nested(matrix) for matrix in matrices for part in parts]
            return
        part_times = (time for parts in prototypes for part in parts for time in part.ancestors.times())
        times = sorted({*own_times, *here.animated.times(), *part_times})
        instances = self._instances_at(prim, times, instances) or instances
        points = PointSamples.of(list(instances.values()))
        for row, code in enumerate(instances):
            matrix = to_matrix(here.animated.world(code, here.world), self._meters)
            points.matrices[row] = matrix @ points.matrices[row]
        objects: dict[int, StageObject] = {}
        for number, root, parts in zip(used, roots, prototypes, strict=True):
            if parts:
                self._place_points(prim, here, root, parts, points, number, times, objects)

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
        prim: Usd.Prim,
        here: TraversalContext,
        root: Usd.Prim,
        parts: Sequence[PrototypePart],
        points: PointSamples,
        number: int,
        times: Sequence[float],
        objects: dict[int, StageObject],
    ) -> None:
        """Add the points that ever show one prototype.

        Args:
            prim: the instancer.
            here: its context.
            root: root of the prototype.
            parts: parts of the prototype.
            points: all points at the time read, then at `times`.
            number: index of the prototype.
            times: time codes of the animation; empty: static.
            objects: objects of the points so far by id, added to.
        """
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
        local = [np.array([part.matrix_at(code, self._meters) for code in codes]) for part in parts]
        visible = [present & np.array([part.ancestors.is_visible(code) for code in codes])[:, None] for part in parts]
        name, path, by_name = prim.GetName(), str(prim.GetPath()), name_label(root)
        worlds = [points.matrices[:, rows] @ matrix[:, None] for matrix in local]
        movable, asset = is_rigid_body(root), asset_name(root)
        for row, point in enumerate(points.ids[rows].tolist()):
            new = StageObject(f"{name}[{point}]", f"{path}[{point}]", category, True, by_name, asset, movable=movable)
            owner = objects.setdefault(point, new)
            for part, world, shown in zip(parts, worlds, visible, strict=True):
                if not part.is_drawn:
                    self._objects.add_collider(owner, part.mesh, world[0, row], owner.path)
                    continue
                samples = TransformSamples(tuple(times), world[order, row], shown[order, row]) if times else None
                self._objects.add(owner, part.mesh, world[0, row], part.names, part.collides, samples)

    def _prototype(self, instancer: Usd.Prim, root: Usd.Prim, purpose: str) -> Sequence[PrototypePart]:
        """Return the parts of a prototype, in the space of its parent."""
        outer, parts = (self._parts, self._prototype_root), list[PrototypePart]()
        self._parts, self._prototype_root = parts, root.GetPath()
        self._open_instancers.append(instancer.GetPath())
        self.walk(root, TraversalContext(purpose=purpose), ALSO_ABSTRACT)
        self._open_instancers.pop()
        self._parts, self._prototype_root = outer
        return parts
