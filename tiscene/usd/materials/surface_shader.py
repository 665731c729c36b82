# SPDX-License-Identifier: Apache-2.0
"""surface_shader: which shader of a material's network draws surfaces."""

from __future__ import annotations

from collections.abc import Sequence

from pxr import Usd, UsdShade

from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import shader_id
from tiscene.usd.materials.materialx_bsdf import SURFACES, unknown_part
from tiscene.usd.materials.materialx_models import MODELS

_UNDRAWN = {"volume": "volume", "backsurface": "surface of the back"}  # outputs of materials


def surface_shader(material: UsdShade.Material, time: Usd.TimeCode, report: StageReport) -> UsdShade.Shader | None:
    """Find a shader: of MaterialX in any surface output, else a UsdPreviewSurface there, else one below the material.

    As in Hydra, the output of a renderer's own kind of network comes before the universal one: programs that write
    both, such as Blender, may leave a gray UsdPreviewSurface in the latter.

    Args:
        material: the material.
        time: when to evaluate attributes.
        report: collects what is not drawn, and shaders that are not supported, with what is used instead.
    """
    for output in material.GetOutputs(onlyAuthored=True):
        what = _UNDRAWN.get(output.GetBaseName().rpartition(":")[2])
        if what is not None and output.HasConnectedSource():
            report.omission(material.GetPath(), f"the {what} of a material is not drawn")
    unknown: list[str] = []
    preview: UsdShade.Shader | None = None
    for output in material.GetSurfaceOutputs():
        for attribute in UsdShade.Utils.GetValueProducingAttributes(output):
            shader = UsdShade.Shader(attribute.GetPrim())
            name = shader_id(shader) if shader else ""
            if name == "UsdPreviewSurface":
                preview = preview or shader
            elif name in SURFACES:
                part = unknown_part(shader, time)
                if part is None:
                    return shader
                unknown.append(part)
            elif name in MODELS:
                return shader
            elif preview is None or name.startswith("ND_"):
                unknown.append(name or ("" if shader else str(attribute.GetPrim().GetTypeName())))
    if preview is not None:
        if unknown:
            _report_unsupported(material, unknown, "its UsdPreviewSurface is used", report)
        return preview
    for shader in map(UsdShade.Shader, Usd.PrimRange(material.GetPrim(), Usd.PrimAllPrimsPredicate)):
        if shader and shader_id(shader) == "UsdPreviewSurface":
            _report_unsupported(material, unknown, "its UsdPreviewSurface is used", report)
            return shader
    _report_unsupported(material, unknown, "displayColor is used", report)
    return None


def _report_unsupported(material: UsdShade.Material, names: Sequence[str], instead: str, report: StageReport) -> None:
    """Report what is used instead of the first shader that is not supported; `names` is empty if there is no shader."""
    if names:
        text = f"shader {names[0]!r} is not supported" if names[0] else "a surface shader without info:id"
    elif any(output.GetAttr().GetConnections() for output in material.GetSurfaceOutputs()):
        text = "a material whose surface is connected to an output that does not exist"
    else:
        text = "a material without a surface shader"
    report.omission(material.GetPath(), f"{text}; {instead}")
