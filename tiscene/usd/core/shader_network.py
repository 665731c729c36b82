# SPDX-License-Identifier: Apache-2.0
"""Shader networks: the values and sources of a shader's inputs, through node graphs and material interfaces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pxr import Sdf, Usd, UsdShade

# MaterialX names of UsdPreviewSurface's nodes.
_MATERIALX_NAMES = {
    "ND_UsdPreviewSurface_surfaceshader": "UsdPreviewSurface",
    "ND_UsdUVTexture": "UsdUVTexture",
    "ND_UsdUVTexture_22": "UsdUVTexture",
    "ND_UsdUVTexture_23": "UsdUVTexture",
    "ND_UsdTransform2d": "UsdTransform2d",
    "ND_UsdPrimvarReader_vector2": "UsdPrimvarReader_float2",
    "ND_UsdPrimvarReader_vector3": "UsdPrimvarReader_float3",
    "ND_UsdPrimvarReader_float": "UsdPrimvarReader_float",
}


def shader_id(shader: UsdShade.Shader) -> str:
    """Return a shader's info:id, by UsdPreviewSurface's names; else its name in its source asset, or ""."""
    name = str(shader.GetShaderId() or "")
    if not name:
        names = (each for each in shader.GetPrim().GetAttributes() if each.GetName().endswith(":subIdentifier"))
        return next((str(each.Get()) for each in names), "")
    return _MATERIALX_NAMES.get(name, name)


def broken_connections(shader: UsdShade.Shader) -> Iterator[tuple[Usd.Attribute, Sdf.Path]]:
    """Yield the attributes of a shader, and of all that it is connected to, whose source does not exist; the source."""
    pending = [each.GetAttr() for each in shader.GetInputs(onlyAuthored=True)]
    seen = {each.GetPath() for each in pending}
    while pending:
        attribute = pending.pop()
        for target in attribute.GetConnections():
            source = attribute.GetStage().GetAttributeAtPath(target)
            if not source:
                yield attribute, target
                continue
            node = UsdShade.Shader(source.GetPrim())
            found = [each.GetAttr() for each in node.GetInputs(onlyAuthored=True)] if node else [source]
            pending += [each for each in found if each.GetPath() not in seen]
            seen.update(each.GetPath() for each in found)


@dataclass(frozen=True)
class Source:
    """An output of another shader.

    Attributes:
        shader: that shader.
        id: its `shader_id`.
        output: name of the output, such as "rgb".
    """

    shader: UsdShade.Shader
    id: str
    output: str


@dataclass(frozen=True)
class ShaderConnection:
    """Where an input gets its value.

    Attributes:
        attribute: attribute that produces the value.
        value: its value; None if it is the output of a shader.
        source: the output that it is connected to; None if it has a value.
    """

    attribute: Usd.Attribute
    value: Any = None
    source: Source | None = None


def connections_of(shader: UsdShade.Shader, time: Usd.TimeCode) -> dict[str, ShaderConnection]:
    """Return a shader's authored inputs by name, at a time code; inputs without a value or a source are left out."""
    found = {}
    for item in shader.GetInputs(onlyAuthored=True):
        for attribute in UsdShade.Utils.GetValueProducingAttributes(item):
            if attribute.GetName().startswith("outputs:"):
                other = UsdShade.Shader(attribute.GetPrim())
                source = Source(other, shader_id(other), attribute.GetName().removeprefix("outputs:"))
                found[item.GetBaseName()] = ShaderConnection(attribute, source=source)
            else:
                found[item.GetBaseName()] = ShaderConnection(attribute, value=attribute.Get(time))
            break
    return found


def opacity_mode(inputs: Mapping[str, ShaderConnection]) -> Literal["transparent", "presence"]:
    """Return what the opacity of a UsdPreviewSurface is, by its inputs: a token, or a number in MaterialX."""
    mode = inputs["opacityMode"].value if "opacityMode" in inputs else None
    return "presence" if mode in ("presence", 1) else "transparent"
