# SPDX-License-Identifier: Apache-2.0
"""Materials whose inputs have time samples, as `InputTrack`s.

A material is read again at each time code at which one of its inputs is authored. Between them its numbers are
interpolated linearly, which is exact for UsdPreviewSurface; other networks are read at every step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from pxr import Sdf, Usd, UsdShade

from tiscene.scene.description import Material
from tiscene.scene.input_track import InputTrack
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import shader_id
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.core.value_times import dense_times, is_time_varying, value_times

MAX_FILES = 64  # different image files of one animated texture
_LINEAR_NODES = ("", "UsdPreviewSurface", "UsdUVTexture", "UsdTransform2d")
_CHILDREN = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


def material_times(material: Usd.Prim, primvar_times: Iterable[float], report: StageReport) -> list[float]:
    """Return the time codes at which to read a material; empty if it is constant, or cannot be played.

    Args:
        material: the Material, whose whole network is below it.
        primvar_times: time codes of the primvars that it reads.
        report: says whether the stage plays; receives a texture of too many files.
    """
    if not report.reads_animation:
        return []
    varying, linear = [], True
    for prim in Usd.PrimRange(material, _CHILDREN):
        node = shader_id(UsdShade.Shader(prim)) if prim.IsA(UsdShade.Shader) else ""
        linear = linear and (node in _LINEAR_NODES or node.startswith("UsdPrimvarReader"))
        for attribute in prim.GetAuthoredAttributes():
            if not (attribute.GetName().startswith("inputs:") and is_time_varying(attribute)):
                continue
            if attribute.GetTypeName() == Sdf.ValueTypeNames.Asset:
                files = len({attribute.Get(time) for time in attribute.GetTimeSamples()})
                if files > MAX_FILES:
                    text = f"a texture of {files} files over time (limit {MAX_FILES})"
                    report.frozen(prim.GetPath(), text)
                    continue
            linear = linear and attribute.GetBaseName() != "rotation"
            varying.append(attribute)
    times = {*primvar_times, *(time for each in varying for time in value_times(each))}
    return sorted(times) if linear else dense_times(times, material.GetStage())


def material_track(
    stage: Usd.Stage, row: int, times: Sequence[float], read: Callable[[Usd.TimeCode], Material | None]
) -> InputTrack | None:
    """Return how a material varies over time; None if it does not.

    Args:
        stage: gives the rate of time codes.
        row: row of the material.
        times: the time codes to read it at.
        read: returns the material at a time code; None: it cannot be read then, and the sample is left out.
    """
    found = [(time, material) for time in times if (material := read(Usd.TimeCode(time))) is not None]
    if len(found) < 2:
        return None
    codes, samples = zip(*found, strict=True)
    return InputTrack.of(row, in_seconds(stage, codes), list(samples))
