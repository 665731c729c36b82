# SPDX-License-Identifier: Apache-2.0
"""StageReader: traverse the prims of a stage and collect meshes, materials, objects, lights and cameras.

Transform, visibility, purpose, label and object are passed down from prim to prim in a `TraversalContext`. While the
prototype of a point instancer is traversed, its meshes are collected as `PrototypePart`s and placed once per point.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal, cast

from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSkel

from tiscene.scene.camera import Camera
from tiscene.scene.description import Matrix, SceneDescription, Template
from tiscene.usd.core.keyframes import plays_in_parts
from tiscene.usd.core.prims import DEFINED, DRAWN_PURPOSES, ancestors, is_light, is_light_only, renders
from tiscene.usd.core.report import UNDRAWN, StageReport
from tiscene.usd.core.semantics import direct_label, is_component, is_object_instance, taxonomies_of
from tiscene.usd.core.shown_prims import shows_geometry
from tiscene.usd.core.time_samples import TransformSamples
from tiscene.usd.core.transform import is_singular, range_fault, to_matrix
from tiscene.usd.core.value_times import JUMP, dense_times, is_time_varying
from tiscene.usd.geometry.skinning import report_unskinned
from tiscene.usd.lights.animated_light import mesh_emission_over_time
from tiscene.usd.lights.light import LightReader
from tiscene.usd.materials.material import Binding, MaterialTableBuilder
from tiscene.usd.materials.texture import TextureTable
from tiscene.usd.read.instancer_reader import PointInstancerReader, PrototypeLight
from tiscene.usd.read.mesh_table import MeshTable, is_drawable
from tiscene.usd.read.object_builder import StageObject, StageObjectTable, collides, first_shown, is_rigid_body
from tiscene.usd.read.point_instancer import PrototypePart
from tiscene.usd.read.stage_camera import read_camera, unique_names
from tiscene.usd.read.stage_render_settings import read_render_settings
from tiscene.usd.read.traversal_context import TraversalContext

# How types of prims without a look begin: other programs' own data and behavior, actuators and tendons of robots.
_UNSEEN_TYPES = (
    *("HoudiniLayerInfo", "MjcActuator", "MjcKeyframe", "MjcTendon", "NewtonActuator", "OmniGraph", "RealityKit"),
    *("Preliminary_Action", "Preliminary_Behavior", "Preliminary_Trigger"),
)


class StageReader(PointInstancerReader):
    """Collects a SceneDescription from the prims that it traverses."""

    def __init__(self, stage: Usd.Stage, time: Usd.TimeCode, report: StageReport, taxonomy: str | None = None) -> None:
        """Start with an empty description.

        Args:
            stage: the stage.
            time: time code to read at.
            report: receives problems and omissions.
            taxonomy: taxonomy of the labels; None: the preferred ones.
        """
        super().__init__()
        self.by_name = not taxonomies_of(stage)  # categories of a stage without labels are derived from names
        self._taxonomy = taxonomy
        self.up_axis = cast(Literal["Y", "Z"], str(UsdGeom.GetStageUpAxis(stage)))
        self._stage = stage
        self._time = time
        self._report = report
        self._meters = float(UsdGeom.GetStageMetersPerUnit(stage))
        self._textures = TextureTable(report)
        self._materials = MaterialTableBuilder(self._textures, time, report, self._instancers)
        self._meshes = MeshTable(self._materials, time, report, self._meters, self._instancers)
        self._lights = LightReader(self._textures, time, report, self._meters, self.up_axis)
        self._cameras: list[tuple[Sdf.Path, Camera]] = []
        self._objects = StageObjectTable(stage)
        self._settings = read_render_settings(stage, report)
        self._top = Sdf.Path.absoluteRootPath  # root of the outermost traversal

    def description(self, name: str, templates: tuple[Template, ...] = ()) -> SceneDescription:
        """Return what has been read so far, with a name and templates."""
        cameras = self._settings.main_first(self._cameras, lambda each: each[0])
        names = unique_names([path for path, _ in cameras])
        return SceneDescription(
            name=name,
            meshes=tuple(self._meshes.meshes),
            materials=tuple(self._materials.materials),
            textures=tuple(self._textures.textures),
            instances=self._objects.instances(),
            objects=self._objects.objects(self.by_name),
            lights=tuple(self._lights.lights),
            cameras=tuple(replace(camera, name=names[path]) for path, camera in cameras),
            camera_paths=tuple(str(path) for path, _ in cameras),
            colliders=self._objects.colliders(),
            tracks=self._objects.tracks(),
            color_tracks=self._objects.color_tracks(),
            object_tracks=self._objects.object_tracks(),
            material_tracks=tuple(self._materials.tracks),
            light_tracks=tuple(self._light_tracks),
            up_axis=self.up_axis,
            templates=templates,
            resolution=self._settings.resolution,
            has_lights_off=self._lights.any_off,
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
            with self._report.guard(prim):
                here = self._enter(prim, inherited)
                if self._read(prim, here):
                    pending += [(child, here) for child in reversed(prim.GetFilteredChildren(predicate))]

    def _enter(self, prim: Usd.Prim, inherited: TraversalContext) -> TraversalContext:
        """Return the context of a prim, given that of its parent."""
        if prim.IsPseudoRoot():
            return inherited
        world, visible, purpose, animated = inherited.world, inherited.visible, inherited.purpose, inherited.animated
        shown = inherited.renders
        in_prototype = self._parts is not None  # there the point is the object
        is_object = not in_prototype and (is_component(prim) or (inherited.owner is None and is_object_instance(prim)))
        if prim.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prim)
            visibility = imageable.GetVisibilityAttr()
            hides = False
            if self._report.reads_animation and self._is_animated_by_scenario(prim, inherited, is_object):
                hides = is_light_only(prim) and is_time_varying(visibility)
                animated = replace(animated, movers=(), base=None)
                animated = animated.hidden_by(prim) if hides else animated
            elif self._report.reads_animation:
                hides = is_time_varying(visibility)
                animated = animated.with_child(prim, inherited.world, hides)
            visible = visible and (hides or visibility.Get(self._time) != UsdGeom.Tokens.invisible)
            authored = imageable.GetPurposeAttr()
            if authored.HasAuthoredValue():
                purpose = str(authored.Get())
            shown = renders(prim, inherited.renders)
            self._report_unapplied(prim)
            if prim.IsA(UsdGeom.Xformable):
                xformable = UsdGeom.Xformable(prim)
                local = xformable.GetLocalTransformation(self._time)
                world = local if xformable.GetResetXformStack() else local * inherited.world
        direct = direct_label(prim, self._time, self._taxonomy)
        label, own = direct or inherited.label, bool(direct) or inherited.label_is_own
        owner = inherited.owner
        if is_object:
            own = bool(direct)
            samples = TransformSamples.of(animated, world, self._meters)
            owner = StageObject.of(prim, label, own, to_matrix(world, self._meters), samples)
        if owner is not None and is_rigid_body(prim):
            owner.movable = True
        return TraversalContext(world, visible, purpose, shown, label, own, owner, animated)

    def _report_unapplied(self, prim: Usd.Prim) -> None:
        """Report a renderVisibility without the schema that it belongs to."""
        attribute = prim.GetAttribute("renderVisibility")
        if attribute and not prim.HasAPI(UsdGeom.VisibilityAPI) and attribute.Get() != UsdGeom.Tokens.inherited:
            text = "renderVisibility has no effect without VisibilityAPI: add it to the prim's apiSchemas"
            self._report.omission(prim.GetPath(), text)

    def _is_animated_by_scenario(self, prim: Usd.Prim, inherited: TraversalContext, is_object: bool) -> bool:
        """Return whether a scenario animates a prim, not an instance track: objects, lights and whole templates.

        No scenario holds an object within another one, within an instance of several or below a gprim, a Scope, an
        object in which nothing is drawn, and one whose motion is not that of a rigid whole: they move by tracks.
        """
        if self._parts is not None or prim.GetPath() in self._report.budget.baked_skins:
            return False
        if self._top != Sdf.Path.absoluteRootPath:
            return bool(prim.GetPath() == self._top)
        if is_light_only(prim):
            return True
        is_outermost = (is_object or prim.IsA(UsdGeom.Gprim)) and inherited.owner is None and not prim.IsInstanceProxy()
        if not is_outermost or any(each.IsA(UsdGeom.Gprim) for each in ancestors(prim)):
            return False
        return prim.IsA(UsdGeom.Xformable) and shows_geometry(prim, self._time) and not plays_in_parts(prim)

    def _read(self, prim: Usd.Prim, here: TraversalContext) -> bool:
        """Read one prim and return whether to traverse its children."""
        if prim.IsA(UsdGeom.Camera):
            self._read_camera(prim, here)
            return True
        if prim.IsA(UsdGeom.PointInstancer):
            if here.is_drawn:
                self._read_instancer(prim, here)
            return False
        if not here.is_drawn:
            self._lights.any_off = self._lights.any_off or (is_light(prim) and here.purpose in DRAWN_PURPOSES)
            if is_drawable(prim) and collides(prim):
                self._read_gprim(prim, here)
        elif is_light(prim):
            self._read_light(prim, here)
        elif is_drawable(prim):
            self._read_gprim(prim, here)
        elif not prim.IsA(UsdLux.PortalLight):  # portals are read with their dome light
            self._report_undrawn(prim)
        return True

    def _report_undrawn(self, prim: Usd.Prim) -> None:
        """Report a prim that other renderers draw and this one does not, and one whose type loses its mesh."""
        if prim.IsA(UsdGeom.Xform) and prim.HasAttribute(UsdGeom.Tokens.faceVertexIndices):  # by "Merge Parent Xform"
            text = "prims of type Xform with the faces of a mesh, as Blender writes merged objects that move,"
            self._report.omission(prim.GetPath(), f"{text} {UNDRAWN}")
        kind = prim.GetTypeName()
        if prim.IsA(UsdGeom.Boundable) and not prim.IsA(UsdSkel.Root) and not prim.IsA(UsdSkel.Skeleton):
            self._report.omission(prim.GetPath(), f"prims of type {kind} {UNDRAWN}")
        elif kind and not (kind.startswith(_UNSEEN_TYPES) or prim.GetPrimTypeInfo().GetSchemaType()):
            self._report.omission(prim.GetPath(), f"prims of the unknown type {kind} {UNDRAWN}")

    def _read_camera(self, prim: Usd.Prim, here: TraversalContext) -> None:
        if self._parts is not None:
            self._report.omission(prim.GetPath(), "cameras in a point instancer's prototypes are not read")
            return
        matrix = to_matrix(here.world, self._meters)
        camera = read_camera(prim, matrix, self._time, self._meters, self._report, self._settings)
        if camera is not None:
            self._cameras.append((prim.GetPath(), camera))

    def _read_light(self, prim: Usd.Prim, here: TraversalContext) -> None:
        matrix = to_matrix(here.world, self._meters)
        if is_drawable(prim):
            self._read_mesh_light(prim, here, matrix)
        elif prim.IsA(UsdGeom.Gprim):
            self._report_undrawn(prim)
        elif self._parts is not None:
            self._prototype_lights.append(PrototypeLight(prim, matrix, here.animated))
        else:  # the emission of the stage's own lights is played by the scenario
            self._add_light(prim, matrix, here.animated, emission=self._top != Sdf.Path.absoluteRootPath)

    def _read_mesh_light(self, prim: Usd.Prim, here: TraversalContext, matrix: Matrix) -> None:
        """Read a gprim with MeshLightAPI as a mesh that emits."""
        area = self._meshes.area(prim, matrix[:3, :3])
        emission = self._lights.mesh_emission(prim, area) if area > 0.0 else None
        if emission is not None:
            over_time = mesh_emission_over_time(self._lights, prim, area, self._areas(prim, here), self._report)
            self._read_gprim(prim, here, self._materials.emitter(prim, emission, over_time))

    def _areas(self, prim: Usd.Prim, here: TraversalContext) -> dict[float, float]:
        """Return the area of a mesh light by time code, ascending; empty if it is constant or does not matter."""
        normalize = UsdLux.LightAPI(prim).GetNormalizeAttr()
        if not (normalize.Get(self._time) or is_time_varying(normalize)):
            return {}
        areas = {}
        spans = self._meshes.spans(prim)
        shapes = [time for times in self._meshes.shape_times(prim).values() for time in times]
        shapes += [time for each in spans if each.start > -math.inf for time in (each.start - JUMP, each.start)]
        for time in dense_times((*here.animated.times(), *shapes), self._stage):
            world = to_matrix(here.animated.world(Usd.TimeCode(time), here.world), self._meters)
            areas[time] = self._meshes.area(prim, world[:3, :3], time)
        largest = max(areas.values(), default=0.0)
        return areas if largest - min(areas.values(), default=0.0) > 1e-5 * largest else {}

    def _read_gprim(self, prim: Usd.Prim, here: TraversalContext, emitter: Binding | None = None) -> None:
        shapes = self._meshes.rows(prim, emitter)
        if not shapes:
            return
        if here.is_drawn:
            report_unskinned(prim, self._report)
        matrix = to_matrix(here.world, self._meters)
        over_time = TransformSamples.of(here.animated, here.world, self._meters)
        samples = over_time if self._parts is None else None
        matrix = first_shown(matrix, samples)
        if fault := range_fault(matrix if over_time is None else over_time.matrices):
            self._report.problem(prim.GetPath(), "transform", fault)
        elif is_singular(matrix) and (samples is not None or not here.animated):
            self._report.omission(prim.GetPath(), "geometry that its transform flattens is not drawn")
        elif self._parts is not None:
            names = self._part_names(prim, self._prototype_root)
            for number, (mesh, span) in enumerate(shapes):
                is_solid = collides(prim) if self._meshes.is_initial(prim, span) else False
                animated = here.animated.during(span.start, span.end)
                part = PrototypePart(mesh, matrix, here.label, names, is_solid, here.is_drawn, animated, number > 0)
                self._parts.append(replace(part, of_points=self._meshes.of_points.get(mesh, ("", ""))))
        else:
            owner = here.owner or StageObject.of(prim, here.label, True, matrix, samples)
            if not here.is_drawn:
                if over_time is not None:
                    text = "a collider that moves and is not drawn stays where it is at the time read"
                    self._report.omission(prim.GetPath(), text)
                mesh = shapes[0][0]
                self._objects.add_collider(owner, mesh, self._meshes.placed(mesh, matrix), str(prim.GetPath()))
                return
            owner.movable = owner.movable or (here.owner is None and is_rigid_body(prim))
            if here.label_is_own and not owner.is_labeled:  # the object's category is that of its first labeled part
                owner.category, owner.is_labeled = here.label, True
            names = self._part_names(prim, Sdf.Path(owner.path))
            known: dict[float, tuple[Matrix, bool]] = {}
            for number, (mesh, span) in enumerate(shapes):
                is_solid = collides(prim) if self._meshes.is_initial(prim, span) else False
                shown = samples
                if not span.is_whole:
                    animated = here.animated.during(span.start, span.end)
                    shown = TransformSamples.of(animated, here.world, self._meters, known)
                if shown is not None:
                    shown = replace(shown, matrices=self._meshes.placed(mesh, shown.matrices))
                placed = self._meshes.placed(mesh, matrix)
                self._objects.add(owner, mesh, placed, names, is_solid, shown, continues=number > 0)

    def _part_names(self, prim: Usd.Prim, root: Sdf.Path) -> tuple[str, ...]:
        """Return the names of a gprim's parts, relative to the object or prototype at `root`."""
        path = prim.GetPath()
        relative = prim.GetName() if path == root else str(path.MakeRelativePath(root))
        subsets = self._meshes.subset_names(prim)
        return tuple(f"{relative}/{name}" if name else relative for name in subsets)
