# SPDX-License-Identifier: Apache-2.0
"""Writing of models as USD: geometry as crates, root layers as text, the same bytes in every run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdRender, UsdSemantics, UsdShade, Vt

from usd_scenes.author import primitives
from usd_scenes.author.material_presets import PRESETS, MaterialPreset, without_textures
from usd_scenes.author.model import Model
from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.shapes import sphere


def new_stage(root: str, kind: str | None = None) -> tuple[Usd.Stage, Usd.Prim]:
    """Create a stage in memory, in meters with y up, and its default prim.

    Args:
        root: name of the default prim, an Xform.
        kind: its model kind; None for none.
    """
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    prim = UsdGeom.Xform.Define(stage, f"/{root}").GetPrim()
    if kind is not None:
        Usd.ModelAPI(prim).SetKind(kind)
    stage.SetDefaultPrim(prim)
    return stage, prim


def define_render_settings(stage: Usd.Stage) -> None:
    """Define RenderSettings by which cameras keep their vertical field of view in images of any shape."""
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateAspectRatioConformPolicyAttr(UsdRender.Tokens.adjustApertureWidth)
    stage.SetMetadata("renderSettingsPrimPath", str(settings.GetPath()))


@dataclass(frozen=True)
class Arc:
    """A payload or reference to author.

    Attributes:
        prim: path of the prim that gets it; may contain a variant selection.
        asset: the file, relative to the layer.
        target: path of the prim in it; "" for its default prim.
        payload: whether to author a payload rather than a reference.
    """

    prim: str
    asset: str
    target: str = ""
    payload: bool = True


def save(stage: Usd.Stage, path: Path, arcs: Iterable[Arc] = ()) -> None:
    """Write a stage's root layer with arcs, which are added to a copy: relative paths do not resolve in memory."""
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
    """Define an Xform of kind group, for components."""
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path).GetPrim()).SetKind(Kind.Tokens.group)


def variants(prim: Usd.Prim, name: str, choices: Iterable[str]) -> Iterator[str]:
    """Yield each variant of a new variant set with edits directed into it; select the first one at the end."""
    variant_set = prim.GetVariantSets().AddVariantSet(name)
    every = list(choices)
    for choice in every:
        variant_set.AddVariant(choice)
        variant_set.SetVariantSelection(choice)
        with variant_set.GetVariantEditContext():
            yield choice
    variant_set.SetVariantSelection(every[0])


def label(prim: Usd.Prim, name: str) -> None:
    """Author the semantic class of a prim and its descendants."""
    UsdSemantics.LabelsAPI.Apply(prim, "class").CreateLabelsAttr([name])


def write_geometry(path: Path, models: Iterable[Model], approximation: str) -> None:
    """Write the meshes of models as /Geometry/<model>/<part>, all of them colliders.

    Args:
        path: the file.
        models: the models.
        approximation: collision approximation of the meshes, a token of UsdPhysics.
    """
    stage, _ = new_stage("Geometry")
    for model in models:
        UsdGeom.Xform.Define(stage, f"/Geometry/{model.name}")
        for part in model.parts:
            tile = PRESETS[part.material].tile
            mesh = _define_mesh(stage, f"/Geometry/{model.name}/{part.name}", part.mesh, tile or (1.0, 1.0))
            UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
            UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(approximation)
    save(stage, path)


def write_primitives(path: Path, models: Iterable[Model]) -> None:
    """Write models under the paths of `write_geometry`, with each part an Xform of gprims that approximate its mesh."""
    stage, _ = new_stage("Geometry")
    for model in models:
        UsdGeom.Xform.Define(stage, f"/Geometry/{model.name}")
        for part in model.parts:
            UsdGeom.Xform.Define(stage, f"/Geometry/{model.name}/{part.name}")
            for index, gprim in enumerate(primitives.fit(*(part.proxies or (part.mesh,)))):
                _define_gprim(stage, f"/Geometry/{model.name}/{part.name}/{gprim.kind}{index}", gprim)
    save(stage, path)


def _define_gprim(stage: Usd.Stage, path: str, source: primitives.Gprim) -> None:
    """Define a gprim as a collider: cubes are scaled, others sized, as UsdPhysics requires; ellipsoids are meshes."""
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
    """Define a mesh, rounded to 0.01 mm and 1e-4: files must not depend on the last bits of a processor's sine."""
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


def bind(stage: Usd.Stage, model: Model, path: str, scope: str) -> None:
    """Bind the materials below `scope` to a model's parts, for a prim at `path` that references its geometry."""
    for part in model.parts:
        prim = stage.OverridePrim(f"{path}/{part.name}")
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(UsdShade.Material(stage.GetPrimAtPath(f"{scope}/{part.material}")))


def define_materials(stage: Usd.Stage, scope: str, names: Iterable[str], textures: str) -> None:
    """Define materials, each with the shaders "Surface" and "Plain", which `connect_materials` chooses from.

    Args:
        stage: the stage.
        scope: path of the Scope to define them in.
        names: names in `PRESETS`.
        textures: folder of the texture files, relative to the stage.
    """
    UsdGeom.Scope.Define(stage, scope)
    for name in sorted(set(names)):
        _define_material(stage, f"{scope}/{name}", PRESETS[name], textures)
        _define_plain(stage, f"{scope}/{name}/Plain", without_textures(PRESETS[name]))


def connect_materials(stage: Usd.Stage, scope: str, names: Iterable[str], shader: str) -> None:
    """Connect the materials below `scope` to their shader "Surface" or "Plain", inside a variant of appearance."""
    for name in sorted(set(names)):
        material = UsdShade.Material(stage.GetPrimAtPath(f"{scope}/{name}"))
        output = UsdShade.Shader(stage.GetPrimAtPath(f"{scope}/{name}/{shader}")).GetOutput("surface")
        material.CreateSurfaceOutput().ConnectToSource(output)


def _define_plain(stage: Usd.Stage, path: str, preset: MaterialPreset) -> None:
    """Define the shader of a preset without textures."""
    surface = UsdShade.Shader.Define(stage, path)
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    for name, color in (("diffuseColor", preset.color), ("emissiveColor", preset.emission)):
        if color is not None:
            surface.CreateInput(name, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(preset.roughness)
    _set_numbers(surface, preset)


def _define_material(stage: Usd.Stage, path: str, preset: MaterialPreset, textures: str) -> None:
    """Define a material with its textured shader."""
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
            if any(preset.shift):
                shifted = UsdShade.Shader.Define(stage, f"{path}/Shift")
                shifted.CreateIdAttr("UsdTransform2d")
                shifted.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
                shifted.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*preset.shift))
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

    color_input("diffuseColor", "Color", preset.color)
    if preset.emission is not None:
        color_input("emissiveColor", "Emission", preset.emission, preset.emission_scale)
    roughness = surface.CreateInput("roughness", Sdf.ValueTypeNames.Float)
    if isinstance(preset.roughness, str):
        roughness.ConnectToSource(texture("Roughness", preset.roughness, "raw").ConnectableAPI(), "r")
    else:
        roughness.Set(preset.roughness)
    if preset.normal is not None:
        entry = surface.CreateInput("normal", Sdf.ValueTypeNames.Normal3f)
        entry.ConnectToSource(texture("NormalMap", preset.normal, "raw").ConnectableAPI(), "rgb")
    _set_numbers(surface, preset)


def _set_numbers(surface: UsdShade.Shader, preset: MaterialPreset) -> None:
    """Author the numeric inputs that differ from their defaults."""
    for name, value, default in (
        ("metallic", preset.metallic, 0.0),
        ("clearcoat", preset.clearcoat, 0.0),
        ("ior", preset.ior, 1.5),
        ("opacity", preset.opacity, 1.0),
    ):
        if value != default:
            surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
