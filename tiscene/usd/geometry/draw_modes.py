# SPDX-License-Identifier: Apache-2.0
"""model:drawMode of UsdGeomModelAPI: models drawn as textured cards.

A mode other than "default" applies to models of kind component, and to prims with model:applyDrawMode. The cards of a
model are authored in the session layer in place of its children, as OpenUSD's imaging shows them: three quadrilaterals
that cross in the center of the model's extent, or the six sides of it. The modes "bounds" and "origin" are lines
without width and are not applied.
"""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade, Vt

from tiscene.usd.core.broken_prims import has_bounds
from tiscene.usd.core.prims import DEFINED, DRAWN_PURPOSES, distinct_prims
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import uninstance

_SIDES = ("Pos", "Neg")
_OPACITY_THRESHOLD = 0.1
_COLOR = (0.18, 0.18, 0.18)  # of models without model:drawModeColor
_GAP = 1e-4  # of the extent, between two crossed cards of one axis
_VALUE_TYPES = Sdf.ValueTypeNames


def apply_draw_modes(stage: Usd.Stage, time: Usd.TimeCode, report: StageReport) -> None:
    """Replace models whose mode is "cards" by their cards; no file changes.

    Args:
        stage: The stage, whose session layer is edited.
        time: When the extents are computed.
        report: Receives the modes that are not applied.
    """
    if not any(map(_has_mode, distinct_prims(stage))):
        return
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        uninstance(stage, lambda: [prim for prim, mode, _ in _drawn_otherwise(stage) if mode == "cards"])
    cache = UsdGeom.BBoxCache(time, DRAWN_PURPOSES, useExtentsHint=True)
    for prim, mode, shows_up_axis in list(_drawn_otherwise(stage)):
        with report.guard(prim):
            fault = "" if mode == "cards" else f"model:drawMode {mode!r} is lines without width"
            if not fault and not has_bounds(prim):
                fault = "the cards of a model with a point instancer that contains itself are not drawn"
            if not fault:
                box = cache.ComputeUntransformedBound(prim).ComputeAlignedBox()
                fault = _fault(prim, box)
            if fault:
                report.omission(prim.GetPath(), f"{fault}: the model itself is drawn")
                continue
            with Usd.EditContext(stage, stage.GetSessionLayer()):
                for child in prim.GetAllChildren():
                    child.SetActive(False)
                hidden = None if shows_up_axis else str(UsdGeom.GetStageUpAxis(stage))
                _author_cards(prim, box, time, hidden)


def _has_mode(prim: Usd.Prim) -> bool:
    return prim.HasAttribute("model:drawMode") and bool(prim.GetAttribute("model:drawMode").HasAuthoredValue())


def _drawn_otherwise(stage: Usd.Stage) -> Iterator[tuple[Usd.Prim, str, bool]]:
    """Yield the outermost prims with another mode than "default": prim, mode, whether cards of the up axis show."""
    pending = [(stage.GetPseudoRoot(), "default", True)]
    while pending:
        prim, mode, shows_up_axis = pending.pop()
        own = prim.GetAttribute("model:drawMode").Get() if prim.HasAttribute("model:drawMode") else None
        mode = mode if own in (None, "inherited") else str(own)
        visibility = prim.GetAttribute("model:cardVisibility").Get()
        shows_up_axis = shows_up_axis if visibility in (None, "inherited") else visibility != "simple"
        if mode != "default" and _is_applied(prim):
            yield prim, mode, shows_up_axis
        else:
            children = reversed(prim.GetFilteredChildren(DEFINED))
            pending += [(child, mode, shows_up_axis) for child in children]


def _is_applied(prim: Usd.Prim) -> bool:
    attribute = prim.GetAttribute("model:applyDrawMode")
    if attribute and attribute.HasAuthoredValue():
        return bool(attribute.Get())
    return bool(Kind.Registry.IsA(Usd.ModelAPI(prim).GetKind(), Kind.Tokens.component))


def _geometry(prim: Usd.Prim) -> str:
    """Return the geometry of a model's cards; USD has no default for prims without the applied schema."""
    return str(UsdGeom.ModelAPI(prim).GetModelCardGeometryAttr().Get() or "cross")


def _fault(prim: Usd.Prim, box: Gf.Range3d) -> str:
    """Return why the cards of a model cannot be drawn; "" if they can."""
    geometry = _geometry(prim)
    if prim.IsA(UsdGeom.Gprim):
        return "the cards of a model that is a gprim are not drawn"
    if geometry not in ("cross", "box"):
        return f"cards of the geometry {geometry!r} are not drawn"
    if box.IsEmpty() or not all(abs(each) < 1e30 for each in (*box.GetMin(), *box.GetMax())):
        return "the cards of a model without an extent are not drawn"
    return ""


def _author_cards(prim: Usd.Prim, box: Gf.Range3d, time: Usd.TimeCode, hidden: str | None) -> None:
    """Define the cards of a model as children of its prim.

    Args:
        prim: The model.
        box: Its extent.
        time: When its textures are read.
        hidden: The axis without cards, "Y" or "Z"; None: all have cards.
    """
    color = Gf.Vec3f(UsdGeom.ModelAPI(prim).GetModelDrawModeColorAttr().Get(time) or _COLOR)
    crossed = _geometry(prim) == "cross"
    textures: dict[str, str] = {}
    for name in (f"{axis}{side}" for axis in "XYZ" for side in _SIDES):
        attribute = prim.GetAttribute(f"model:cardTexture{name}")
        asset = attribute.Get(time)
        if asset is not None and asset.path:
            textures[name] = asset.resolvedPath or _anchored(attribute, asset.path)
    for number, axis in enumerate("XYZ"):
        own = [f"{axis}{side}" for side in _SIDES if f"{axis}{side}" in textures]
        if axis == hidden or (textures and not own):
            continue
        # Both sides of a card are drawn, so that one card is enough for two sides with one texture.
        for name in (own or [f"{axis}Pos"]) if crossed else [f"{axis}{side}" for side in _SIDES]:
            shown = name if name in textures or not own else own[0]
            side = 1.0 if name.endswith("Pos") else 0.0
            if crossed:
                side = 0.5 + (side - 0.5) * _GAP * (len(own) - 1 if own else 0)
            _author_card(prim, name, box, number, side, shown, textures.get(shown), color)


def _anchored(attribute: Usd.Attribute, path: str) -> str:
    """Return a path relative to the layer that authors it as an absolute one."""
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        return str(spec.layer.ComputeAbsolutePath(path))
    return path


def _author_card(
    prim: Usd.Prim,
    name: str,
    box: Gf.Range3d,
    axis: int,
    side: float,
    shown: str,
    texture: str | None,
    color: Gf.Vec3f,
) -> None:
    """Define one card.

    Args:
        prim: The model.
        name: Of the side, such as "XPos".
        box: The model's extent.
        axis: Number of the axis that the card is perpendicular to.
        side: Where along this axis of the extent it is, 0..1.
        shown: The side whose texture it has.
        texture: The file; None: the color.
        color: Of cards without a texture, and where the file cannot be read.
    """
    first, second = (each for each in range(3) if each != axis)
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    points, coordinates = [], []
    for a, b in corners:
        place = [0.0, 0.0, 0.0]
        place[axis], place[first], place[second] = side, a, b
        points.append([low + part * size for low, part, size in zip(box.GetMin(), place, box.GetSize(), strict=True)])
        coordinates.append(_coordinates(shown, a, b))
    card = UsdGeom.Mesh.Define(prim.GetStage(), prim.GetPath().AppendChild(f"Card{name}"))
    card.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    card.CreateFaceVertexCountsAttr([4])
    card.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    card.CreatePointsAttr(Vt.Vec3fArray([Gf.Vec3f(*point) for point in points]))
    primvar = UsdGeom.PrimvarsAPI(card).CreatePrimvar("st", _VALUE_TYPES.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    primvar.Set(Vt.Vec2fArray([Gf.Vec2f(*each) for each in coordinates]))
    material = _author_material(card.GetPrim(), texture, color)
    UsdShade.MaterialBindingAPI.Apply(card.GetPrim()).Bind(material, UsdShade.Tokens.strongerThanDescendants)


def _coordinates(side: str, a: float, b: float) -> tuple[float, float]:
    """Return the texture coordinates of a point of a side's texture.

    Args:
        side: The side, such as "XPos".
        a: Place along the first of the other two axes, 0..1.
        b: Place along the second.
    """
    if side in ("XPos", "YNeg", "ZPos"):
        return a, b
    return (a, 1.0 - b) if side == "ZNeg" else (1.0 - a, b)


def _author_material(card: Usd.Prim, texture: str | None, color: Gf.Vec3f) -> UsdShade.Material:
    stage, path = card.GetStage(), card.GetPath()
    material = UsdShade.Material.Define(stage, path.AppendChild("Material"))
    surface = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    diffuse = surface.CreateInput("diffuseColor", _VALUE_TYPES.Color3f)
    diffuse.Set(color)
    if texture is not None:
        reader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Coordinates"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", _VALUE_TYPES.String).Set("st")
        image = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Texture"))
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", _VALUE_TYPES.Asset).Set(Sdf.AssetPath(texture))
        image.CreateInput("fallback", _VALUE_TYPES.Float4).Set(Gf.Vec4f(*color, 1.0))
        for wrap in ("wrapS", "wrapT"):
            image.CreateInput(wrap, _VALUE_TYPES.Token).Set("clamp")
        image.CreateInput("st", _VALUE_TYPES.Float2).ConnectToSource(reader.CreateOutput("result", _VALUE_TYPES.Float2))
        diffuse.ConnectToSource(image.CreateOutput("rgb", _VALUE_TYPES.Float3))
        opacity = surface.CreateInput("opacity", _VALUE_TYPES.Float)
        opacity.ConnectToSource(image.CreateOutput("a", _VALUE_TYPES.Float))
        surface.CreateInput("opacityThreshold", _VALUE_TYPES.Float).Set(_OPACITY_THRESHOLD)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", _VALUE_TYPES.Token))
    return material
