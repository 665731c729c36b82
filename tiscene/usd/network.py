"""What a shader's inputs are connected to, through node graphs and material interfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pxr import Usd, UsdShade


@dataclass(frozen=True)
class Source:
    """An output of another shader. id: its info:id. output: the name of the output, such as "rgb"."""

    shader: UsdShade.Shader
    id: str
    output: str


@dataclass(frozen=True)
class Connection:
    """An input's source, or else its value and the attribute that holds it."""

    attribute: Usd.Attribute
    value: Any = None
    source: Source | None = None


def connections_of(shader: UsdShade.Shader, time: Usd.TimeCode) -> dict[str, Connection]:
    """The shader's authored inputs by name; those that lead nowhere are left out."""
    found = {}
    for item in shader.GetInputs(onlyAuthored=True):
        for attribute in UsdShade.Utils.GetValueProducingAttributes(item):
            if attribute.GetName().startswith("outputs:"):
                other = UsdShade.Shader(attribute.GetPrim())
                source = Source(other, str(other.GetShaderId() or ""), attribute.GetName().removeprefix("outputs:"))
                found[item.GetBaseName()] = Connection(attribute, source=source)
            else:
                found[item.GetBaseName()] = Connection(attribute, value=attribute.Get(time))
            break
    return found
