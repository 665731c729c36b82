"""The walk over a stage: which prims draw, where, as part of which thing, and with which materials."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Tf, Usd, UsdGeom, UsdShade

from tiscene.camera import Camera
from tiscene.scene.description import Instance, Mesh, SceneDescription, SceneObject, Template
from tiscene.usd import gprim
from tiscene.usd.camera import read_camera
from tiscene.usd.instancer import Placed, point_instances
from tiscene.usd.label import direct_label, inherited_label, is_component
from tiscene.usd.light import LightReader, is_light
from tiscene.usd.material import Binding, MaterialTable
from tiscene.usd.mesh import read_mesh
from tiscene.usd.problems import Report
from tiscene.usd.surface import Surface
from tiscene.usd.texture import TextureTable
from tiscene.usd.transform import fault, to_matrix

_DRAWN_PURPOSES = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
_LOADED = Usd.PrimIsActive & Usd.PrimIsLoaded
DEFINED = Usd.TraverseInstanceProxies(_LOADED & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)
UNDEFINED_TOO = Usd.TraverseInstanceProxies(_LOADED)  # below a class or an over: prototypes and templates


@dataclass
class _Thing:
    """What will be one SceneObject once something of it is drawn."""

    name: str
    path: str
    category: str
    row: int | None = None


@dataclass(frozen=True)
class Context:
    """What a prim inherits. label_is_own: whether `label` was authored on or below the thing."""

    world: Gf.Matrix4d
    visible: bool = True
    purpose: str = UsdGeom.Tokens.default_
    label: str = ""
    label_is_own: bool = False
    thing: _Thing | None = None
    one_thing: bool = False  # inside a point instance, where nothing has an identity of its own


class StageReader:
    """Collects a SceneDescription from the prims it is shown."""

    def __init__(self, stage: Usd.Stage, time: Usd.TimeCode, report: Report) -> None:
        self.up_axis = cast(Literal["Y", "Z"], str(UsdGeom.GetStageUpAxis(stage)))
        self._stage = stage
        self._time = time
        self._report = report
        self._meters = float(UsdGeom.GetStageMetersPerUnit(stage))
        if not (self._meters > 0.0 and np.isfinite(self._meters)):
            report.problem("/", "stage", f"metersPerUnit is {self._meters}")
            self._meters = 1.0
        self._textures = TextureTable(report)
        self._materials = MaterialTable(self._textures, time, report)
        self._lights = LightReader(self._textures, time, report, self._meters, self.up_axis)
        self._cameras: list[Camera] = []
        self._meshes: list[Mesh] = []
        self._instances: list[Instance] = []
        self._objects: list[SceneObject] = []
        self._surfaces: dict[Any, Surface | None] = {}
        self._mesh_rows: dict[Any, int | None] = {}
        self._rows_by_content: dict[bytes, int] = {}
        self._placed: list[Placed] | None = None  # where a prototype's meshes go while it is being read
        self._inside: list[Any] = []  # the point instancers being read: a prototype may not hold its own instancer

    def description(self, name: str, templates: tuple[Template, ...] = ()) -> SceneDescription:
        """Everything read so far."""
        return SceneDescription(
            name=name,
            meshes=tuple(self._meshes),
            materials=tuple(self._materials.materials),
            textures=tuple(self._textures.textures),
            instances=tuple(self._instances),
            objects=tuple(self._objects),
            lights=tuple(self._lights.lights),
            cameras=tuple(self._cameras),
            up_axis=self.up_axis,
            templates=templates,
        )

    def walk(self, root: Usd.Prim, context: Context, predicate: Any = DEFINED) -> None:
        """Read a prim and everything below it."""
        pending = [(root, context)]
        while pending:
            prim, above = pending.pop()
            here = self._enter(prim, above)
            if self._read(prim, here, predicate):
                pending += [(child, here) for child in reversed(prim.GetFilteredChildren(predicate))]

    def _enter(self, prim: Usd.Prim, above: Context) -> Context:
        """What the prim makes of what it inherits."""
        if prim.IsPseudoRoot():
            return above
        world, visible, purpose = above.world, above.visible, above.purpose
        if prim.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prim)
            visible = visible and imageable.GetVisibilityAttr().Get(self._time) != UsdGeom.Tokens.invisible
            authored = imageable.GetPurposeAttr()
            if authored.HasAuthoredValue():
                purpose = str(authored.Get())
            if prim.IsA(UsdGeom.Xformable):
                world = self._world(UsdGeom.Xformable(prim), above.world)
        label = direct_label(prim, self._time)
        inherited, own = (label, True) if label else (above.label, above.label_is_own)
        thing = above.thing
        if not above.one_thing and (is_component(prim) or (prim.IsInstance() and thing is None)):
            thing = _Thing(prim.GetName(), str(prim.GetPath()), inherited)
            own = bool(label)
        return Context(world, visible, purpose, inherited, own, thing, above.one_thing)

    def _world(self, xformable: UsdGeom.Xformable, above: Gf.Matrix4d) -> Gf.Matrix4d:
        try:
            local = xformable.GetLocalTransformation(self._time)
        except Tf.ErrorException:
            self._report.problem(xformable.GetPath(), "transform", "its xformOpOrder names ops that cannot be read")
            return above
        return local if xformable.GetResetXformStack() else local * above

    def _read(self, prim: Usd.Prim, here: Context, predicate: Any) -> bool:
        """Read one prim; whether its children are to be read."""
        if prim.IsA(UsdGeom.Camera):
            matrix = to_matrix(here.world, self._meters)
            camera = read_camera(prim, matrix, self._time, self._meters, self._report)
            if camera is not None:
                self._cameras.append(camera)
            return True
        drawn = here.visible and here.purpose in _DRAWN_PURPOSES
        if prim.IsA(UsdGeom.PointInstancer):
            if drawn:
                self._read_instancer(prim, here)
            return False
        if not drawn or prim.IsPseudoRoot():
            return True
        if is_light(prim):
            self._read_light(prim, here)
        elif prim.IsA(UsdGeom.Mesh) or str(prim.GetTypeName()) in gprim.TYPES:
            self._read_gprim(prim, here)
        elif prim.IsA(UsdGeom.Gprim):
            self._report.omission(prim.GetPath(), f"prims of type {prim.GetTypeName()} are not drawn")
        elif prim.GetTypeName() and not prim.IsA(Usd.SchemaBase) and not prim.GetPrimTypeInfo().GetSchemaType():
            self._report.omission(prim.GetPath(), f"prims of the unknown type {prim.GetTypeName()} are not drawn")
        return True

    def _read_light(self, prim: Usd.Prim, here: Context) -> None:
        if self._placed is not None:
            self._report.omission(prim.GetPath(), "lights in a point instancer's prototypes are not supported")
        else:
            self._lights.add(prim, to_matrix(here.world, self._meters))

    def _read_gprim(self, prim: Usd.Prim, here: Context) -> None:
        mesh = self._mesh_row(prim)
        if mesh is None:
            return
        if self._placed is not None:
            self._placed.append(Placed(mesh, to_matrix(here.world, self._meters)))
            return
        matrix = to_matrix(here.world, self._meters)
        wrong = fault(matrix)
        if wrong:
            self._report.problem(prim.GetPath(), "transform", wrong)
            return
        thing = here.thing or _Thing(prim.GetName(), str(prim.GetPath()), here.label)
        if here.label_is_own and not thing.category:
            thing.category = here.label
        self._instances.append(Instance(mesh, self._object_row(thing, here), matrix))

    def _object_row(self, thing: _Thing, here: Context) -> int:
        if thing.row is None:
            category = here.label if here.label_is_own and here.label else thing.category
            thing.row = len(self._objects)
            self._objects.append(SceneObject(thing.name, thing.path, category))
        return thing.row

    def _read_instancer(self, prim: Usd.Prim, here: Context) -> None:
        """Each point is one thing, of all the meshes of its prototype."""
        if prim.GetPath() in self._inside:
            self._report.problem(prim.GetPath(), "instancer", "one of its prototypes holds the instancer itself")
            return
        found = point_instances(prim, self._time, self._meters, self._report)
        if found is None:
            return
        prototypes = [self._prototype(prim, target, here) for target in found.prototypes]
        world = to_matrix(here.world, self._meters)
        wrong = fault(world)
        if wrong:
            self._report.problem(prim.GetPath(), "transform", wrong)
            return
        if self._placed is not None:  # an instancer within a prototype: its instances are parts of that prototype
            for point, proto in enumerate(found.prototype_of_point.tolist()):
                for part in prototypes[proto][0]:
                    self._placed.append(Placed(part.mesh, world @ found.matrices[point] @ part.matrix))
            return
        name, path = prim.GetName(), str(prim.GetPath())
        for proto, (parts, label) in enumerate(prototypes):
            points = np.flatnonzero(found.prototype_of_point == proto)
            if not parts or not len(points):
                continue
            first = len(self._objects)
            category = label or here.label
            identities = found.ids[points].tolist()
            self._objects += [SceneObject(f"{name}[{i}]", f"{path}[{i}]", category) for i in identities]
            placed = [world @ found.matrices[points] @ part.matrix for part in parts]
            for row in range(len(points)):
                self._instances += [
                    Instance(part.mesh, first + row, matrices[row])
                    for part, matrices in zip(parts, placed, strict=True)
                ]

    def _prototype(self, instancer: Usd.Prim, root: Usd.Prim, here: Context) -> tuple[Sequence[Placed], str]:
        """A prototype's meshes in the space of its parent, and its label."""
        outer, self._placed = self._placed, []
        self._inside.append(instancer.GetPath())
        context = Context(Gf.Matrix4d(1.0), purpose=here.purpose, thing=_Thing("", "", ""), one_thing=True)
        self.walk(root, context, UNDEFINED_TOO)
        parts, self._placed = self._placed, outer
        self._inside.pop()
        return parts, inherited_label(root, self._time)

    def _mesh_row(self, prim: Usd.Prim) -> int | None:
        """The row of a gprim's mesh with its materials; prims of one prototype, and equal meshes, share a row."""
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        whole = self._materials.binding(prim, prim)
        subsets = self._subsets(prim)
        bindings = [whole, *(binding for binding, _ in subsets)]
        key = (source.GetPath(), tuple(bindings))
        if key in self._mesh_rows:
            return self._mesh_rows[key]
        uv_names = tuple(dict.fromkeys(binding.uv for binding in bindings))
        surface = self._surface(prim, source.GetPath(), uv_names, bindings, subsets)
        row = None if surface is None else self._add_mesh(prim.GetName(), surface, whole, subsets)
        self._mesh_rows[key] = row
        return row

    def _subsets(self, prim: Usd.Prim) -> list[tuple[Binding, NDArray[np.int64]]]:
        """The faces with a material of their own."""
        if not prim.IsA(UsdGeom.Mesh) or not prim.GetFilteredChildren(DEFINED):
            return []
        found = []
        faces = len(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get(self._time) or ())
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
                self._report.omission(subset.GetPath(), "a material for anything but faces is not applied")
                continue
            value = subset.GetIndicesAttr().Get(self._time)
            indices = np.asarray([] if value is None else value, dtype=np.int64)
            if len(indices) and (indices.min() < 0 or indices.max() >= faces):
                worst = indices.max() if indices.max() >= faces else indices.min()
                text = f"refers to face {worst}, but there are {faces} faces (0-{faces - 1})"
                self._report.problem(subset.GetPath(), "subset", text)
                continue
            found.append((self._materials.binding(subset.GetPrim(), prim), indices))
        return found

    def _surface(
        self,
        prim: Usd.Prim,
        source: Any,
        uv_names: tuple[str, ...],
        bindings: Sequence[Binding],
        subsets: Sequence[tuple[Binding, NDArray[np.int64]]],
    ) -> Surface | None:
        """The triangles of a gprim, read once for each prototype."""
        uv_of_face = None
        key: Any = (source, uv_names)
        if len(uv_names) > 1:
            faces = len(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get(self._time) or ())
            uv_of_face = np.full(faces, uv_names.index(bindings[0].uv))
            for binding, indices in subsets:
                uv_of_face[indices] = uv_names.index(binding.uv)
            key = (source, tuple(bindings))
        if key not in self._surfaces:
            if prim.IsA(UsdGeom.Mesh):
                self._surfaces[key] = read_mesh(prim, self._time, self._report, uv_names, uv_of_face)
            else:
                self._surfaces[key] = gprim.read_gprim(prim, self._time, self._report)
        return self._surfaces[key]

    def _add_mesh(
        self, name: str, surface: Surface, whole: Binding, subsets: Sequence[tuple[Binding, NDArray[np.int64]]]
    ) -> int:
        materials = np.full(len(surface.triangles), whole.row, dtype=np.int32)
        if subsets:
            of_face = np.full(int(surface.face.max()) + 1, whole.row, dtype=np.int32)
            for binding, indices in subsets:
                of_face[indices[indices < len(of_face)]] = binding.row
            materials = of_face[surface.face]
        positions = surface.positions * np.float32(self._meters)
        arrays = (positions, surface.triangles, materials, surface.normals, surface.uv)
        digest = hashlib.blake2b(digest_size=16)
        for array in arrays:
            digest.update(b"none" if array is None else np.ascontiguousarray(array).data)
            digest.update(b"|")
        content = digest.digest()
        if content not in self._rows_by_content:
            self._rows_by_content[content] = len(self._meshes)
            self._meshes.append(Mesh(name, positions, surface.triangles, materials, surface.normals, surface.uv))
        return self._rows_by_content[content]


def root_context(stage: Usd.Stage, world: Gf.Matrix4d | None = None) -> Context:
    """What the stage's root prims inherit."""
    return Context(Gf.Matrix4d(1.0) if world is None else world)
