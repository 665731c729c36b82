# SPDX-License-Identifier: Apache-2.0
"""Writing things as USD: geometry as crates, roots as readable text, nothing that changes from run to run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade, Vt

from usd_scenes.author import primitives
from usd_scenes.author.material_presets import LOOKS, MaterialPreset, plain
from usd_scenes.author.model import Model
from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.shapes import sphere


def new_stage(root: str, kind: str | None = None) -> tuple[Usd.Stage, Usd.Prim]:
    """An in-memory stage, meters and y up, whose default prim is the Xform `root`. kind: of a model."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    prim = UsdGeom.Xform.Define(stage, f"/{root}").GetPrim()
    if kind is not None:
        Usd.ModelAPI(prim).SetKind(kind)
    stage.SetDefaultPrim(prim)
    return stage, prim


@dataclass(frozen=True)
class Arc:
    """A composition arc to author at a prim: payload or reference to `target` in the file `asset`."""

    prim: str
    asset: str
    target: str = ""
    payload: bool = True


def save(stage: Usd.Stage, path: Path, arcs: Iterable[Arc] = ()) -> None:
    """Writes the root layer, with arcs added on a copy: on a stage in memory their relative paths would not resolve."""
    layer = Sdf.Layer.CreateAnonymous(path.suffix)
    layer.TransferContent(stage.GetRootLayer())
    for arc in arcs:
        spec = layer.GetPrimAtPath(arc.prim) or Sdf.CreatePrimInLayer(layer, arc.prim)
        if arc.payload:
            spec.payloadList.prependedItems = [Sdf.Payload(arc.asset, arc.target or Sdf.Path.emptyPath)]
        else:
            spec.referenceList.prependedItems = [Sdf.Reference(arc.asset, arc.target or Sdf.Path.emptyPath)]
    path.parent.mkdir(parents=True, exist_ok=True)
    if not layer.Export(str(path)):
        raise OSError(f"{path}: USD could not write this file")


def group(stage: Usd.Stage, path: str) -> None:
    """An Xform that only holds components."""
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path).GetPrim()).SetKind(Kind.Tokens.group)


def variants(prim: Usd.Prim, name: str, choices: Iterable[str]) -> Iterator[str]:
    """Each choice of a new variant set, with what is authored meanwhile going into it; then the first is selected."""
    variant_set = prim.GetVariantSets().AddVariantSet(name)
    every = list(choices)
    for choice in every:
        variant_set.AddVariant(choice)
        variant_set.SetVariantSelection(choice)
        with variant_set.GetVariantEditContext():
            yield choice
    variant_set.SetVariantSelection(every[0])


def label(prim: Usd.Prim, name: str) -> None:
    """The semantic class of a prim and all below it."""
    UsdSemantics.LabelsAPI.Apply(prim, "class").CreateLabelsAttr([name])


def write_geometry(path: Path, things: Iterable[Model], approximation: str) -> None:
    """The meshes of `things` as /Geometry/<thing>/<part> in one crate, all of them colliders.

    approximation: UsdPhysics' token for how a collider stands in for its mesh.
    """
    stage, _ = new_stage("Geometry")
    for thing in things:
        UsdGeom.Xform.Define(stage, f"/Geometry/{thing.name}")
        for part in thing.parts:
            tile = LOOKS[part.look].tile
            mesh = _define_mesh(stage, f"/Geometry/{thing.name}/{part.name}", part.mesh, tile or (1.0, 1.0))
            UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
            UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(approximation)
    save(stage, path)


def write_primitives(path: Path, things: Iterable[Model]) -> None:
    """The things of `write_geometry` under the same paths, each part an Xform of gprims that are close to its mesh."""
    stage, _ = new_stage("Geometry")
    for thing in things:
        UsdGeom.Xform.Define(stage, f"/Geometry/{thing.name}")
        for part in thing.parts:
            UsdGeom.Xform.Define(stage, f"/Geometry/{thing.name}/{part.name}")
            for index, gprim in enumerate(primitives.fit(*(part.stand_ins or (part.mesh,)))):
                _define_gprim(stage, f"/Geometry/{thing.name}/{part.name}/{gprim.kind}{index}", gprim)
    save(stage, path)


def _define_gprim(stage: Usd.Stage, path: str, source: primitives.Gprim) -> None:
    """Its own size but for a cube's, which is scaled: other colliders may not be. An ellipsoid is a mesh."""
    width, height, depth = source.size
    radius = (width + depth) / 4.0
    if source.kind == "Ellipsoid":
        ball = sphere(0.5, 24).scaled(*source.size)
        prim = _define_mesh(stage, path, ball, (1.0, 1.0)).GetPrim()
        UsdPhysics.MeshCollisionAPI.Apply(prim).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
    else:
        prim = stage.DefinePrim(path, source.kind)
    gprim, half = UsdGeom.Gprim(prim), Gf.Vec3f(0.5)
    if source.kind == "Cube":
        UsdGeom.Cube(prim).CreateSizeAttr(1.0)
    elif source.kind == "Sphere":
        half = Gf.Vec3f(radius)
        UsdGeom.Sphere(prim).CreateRadiusAttr(radius)
    elif source.kind in ("Cylinder", "Cone"):
        half = Gf.Vec3f(radius, height / 2.0, radius)
        for name, value in (("axis", UsdGeom.Tokens.y), ("radius", radius), ("height", height)):
            prim.GetAttribute(name).Set(value)
    if source.kind != "Ellipsoid":
        gprim.CreateExtentAttr([-half, half])
    gprim.AddTranslateOp().Set(Gf.Vec3d(*source.center))
    if not np.allclose(source.axes, np.eye(3)):
        turn = Gf.Matrix3d(*map(float, source.axes.T.reshape(-1))).ExtractRotation().GetQuat()
        parts = [round(value, 5) + 0.0 for value in (turn.GetReal(), *turn.GetImaginary())]
        gprim.AddOrientOp().Set(Gf.Quatf(*parts))
    if source.kind == "Cube":
        gprim.AddScaleOp().Set(Gf.Vec3f(*source.size))
    UsdPhysics.CollisionAPI.Apply(prim)


def _define_mesh(stage: Usd.Stage, path: str, source: PolygonMesh, tile: tuple[float, float]) -> UsdGeom.Mesh:
    """Rounded to 0.01 mm and 1e-4, so that files do not depend on the last bits of a processor's sine."""
    points = np.round(source.points, 5).astype(np.float32) + np.float32(0.0)
    normals = np.round(source.normals, 4).astype(np.float32) + np.float32(0.0)
    uv = np.round(source.uv / tile, 4).astype(np.float32) + np.float32(0.0)
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(source.counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(source.indices))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, points.min(axis=0))), Gf.Vec3f(*map(float, points.max(axis=0)))])
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
    return mesh


def bind(stage: Usd.Stage, thing: Model, path: str, looks: str) -> None:
    """Materials of a thing's parts, for a prim at `path` that references its geometry; `looks`: where materials are."""
    for part in thing.parts:
        prim = stage.OverridePrim(f"{path}/{part.name}")
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(UsdShade.Material(stage.GetPrimAtPath(f"{looks}/{part.look}")))


def define_looks(stage: Usd.Stage, scope: str, names: Iterable[str], textures: str) -> None:
    """The named looks as materials below `scope`. textures: the folder of texture files as seen from the stage.

    Each has the shaders Surface and Plain; which of them it is made of is for `connect_looks` to say.
    """
    UsdGeom.Scope.Define(stage, scope)
    for name in sorted(set(names)):
        _define_look(stage, f"{scope}/{name}", LOOKS[name], textures)
        _define_plain(stage, f"{scope}/{name}/Plain", plain(LOOKS[name]))


def connect_looks(stage: Usd.Stage, scope: str, names: Iterable[str], shader: str) -> None:
    """Makes the materials below `scope` of their shader "Surface" or "Plain": within an appearance variant, always."""
    for name in sorted(set(names)):
        material = UsdShade.Material(stage.GetPrimAtPath(f"{scope}/{name}"))
        output = UsdShade.Shader(stage.GetPrimAtPath(f"{scope}/{name}/{shader}")).GetOutput("surface")
        material.CreateSurfaceOutput().ConnectToSource(output)


def _define_plain(stage: Usd.Stage, path: str, look: MaterialPreset) -> None:
    surface = UsdShade.Shader.Define(stage, path)
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    for name, color in (("diffuseColor", look.color), ("emissiveColor", look.emission)):
        if color is not None:
            surface.CreateInput(name, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(look.roughness)
    _set_numbers(surface, look)


def _define_look(stage: Usd.Stage, path: str, look: MaterialPreset, textures: str) -> None:
    UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    reader: UsdShade.Shader | None = None

    def texture(node: str, file: str, space: str, scale: float = 1.0) -> UsdShade.Shader:
        nonlocal reader
        if reader is None:
            reader = UsdShade.Shader.Define(stage, f"{path}/Coordinates")
            reader.CreateIdAttr("UsdPrimvarReader_float2")
            reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
            if any(look.shift):
                shifted = UsdShade.Shader.Define(stage, f"{path}/Shift")
                shifted.CreateIdAttr("UsdTransform2d")
                shifted.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
                shifted.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*look.shift))
                shifted.CreateOutput("result", Sdf.ValueTypeNames.Float2)
                reader = shifted
        shader = UsdShade.Shader.Define(stage, f"{path}/{node}")
        shader.CreateIdAttr("UsdUVTexture")
        shader.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"{textures}/{file}")
        shader.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        shader.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        for wrap in ("wrapS", "wrapT"):
            shader.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        if node == "NormalMap":
            shader.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(2.0, 2.0, 2.0, 1.0))
            shader.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(-1.0, -1.0, -1.0, 0.0))
        elif scale != 1.0:
            shader.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(scale, scale, scale, 1.0))
        shader.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        shader.CreateOutput("r", Sdf.ValueTypeNames.Float)
        return shader

    def color_input(name: str, node: str, value: tuple[float, float, float] | str, scale: float = 1.0) -> None:
        entry = surface.CreateInput(name, Sdf.ValueTypeNames.Color3f)
        if isinstance(value, str):
            entry.ConnectToSource(texture(node, value, "sRGB", scale).ConnectableAPI(), "rgb")
        else:
            entry.Set(Gf.Vec3f(*(scale * component for component in value)))

    color_input("diffuseColor", "Color", look.color)
    if look.emission is not None:
        color_input("emissiveColor", "Emission", look.emission, look.emission_scale)
    roughness = surface.CreateInput("roughness", Sdf.ValueTypeNames.Float)
    if isinstance(look.roughness, str):
        roughness.ConnectToSource(texture("Roughness", look.roughness, "raw").ConnectableAPI(), "r")
    else:
        roughness.Set(look.roughness)
    if look.normal is not None:
        entry = surface.CreateInput("normal", Sdf.ValueTypeNames.Normal3f)
        entry.ConnectToSource(texture("NormalMap", look.normal, "raw").ConnectableAPI(), "rgb")
    _set_numbers(surface, look)


def _set_numbers(surface: UsdShade.Shader, look: MaterialPreset) -> None:
    for name, value, default in (
        ("metallic", look.metallic, 0.0),
        ("clearcoat", look.clearcoat, 0.0),
        ("ior", look.ior, 1.5),
        ("opacity", look.opacity, 1.0),
    ):
        if value != default:
            surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
