# SPDX-License-Identifier: Apache-2.0
"""Materials and displayColor as rows of one material table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdShade

from tiscene.scene.description import VERTEX_COLORS, Color, ColorInput, Material, TextureLookup
from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.display_color import (
    constant_primvar,
    quantize_colors,
    read_element_colors,
    varies_over_surface,
)
from tiscene.usd.geometry.primvar import NO_PRIMVARS, PrimvarNames
from tiscene.usd.materials.preview_surface import NetworkReader
from tiscene.usd.materials.texture import TextureTable

_DEFAULT = Material("default")


@dataclass(frozen=True)
class Binding:
    """A material as a gprim or subset uses it. row: of the table. primvars: what it reads of the gprim.

    is_display_color: it stands in for a material that is not there.
    """

    row: int
    primvars: PrimvarNames = NO_PRIMVARS
    is_display_color: bool = False


class MaterialTableBuilder:
    """Reads each material once and numbers it."""

    def __init__(self, textures: TextureTable, time: Usd.TimeCode, report: StageReport) -> None:
        self.materials: list[Material] = []
        self._textures = textures
        self._time = time
        self._report = report
        self._primvars: dict[Any, tuple[str, ...]] = {}  # which primvars of the gprim a material's constants read
        self._bindings: dict[Any, Binding | None] = {}

    def binding(self, prim: Usd.Prim, gprim: Usd.Prim) -> Binding:
        """The material bound to a gprim or to a subset of it (inherited and by collections), else its displayColor."""
        api = UsdShade.MaterialBindingAPI(prim)
        previous = None
        for purpose in (UsdShade.Tokens.preview, UsdShade.Tokens.full):
            material, _ = api.ComputeBoundMaterial(purpose)
            if material and material.GetPath() != previous:
                binding = self._of_material(material, gprim)
                if binding is not None:
                    return binding
                previous = material.GetPath()
        return self._of_display_color(gprim)

    def emitter(self, prim: Usd.Prim, radiance: Color) -> Binding:
        """The material of a gprim that is a light: black, unless its materialSyncMode keeps what is bound to it."""
        mode = prim.GetAttribute("light:materialSyncMode").Get(self._time)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.preview)
        if mode not in ("materialGlowTintsLight", "independent") or not material:
            black = Material(prim.GetName(), diffuse_color=(0.0, 0.0, 0.0), emissive_color=radiance)
            return self._row(("emitter", radiance), black)
        bound = self.binding(prim, prim)
        glow = self.materials[bound.row].emissive_color
        dark = glow == (0.0, 0.0, 0.0)
        if dark and mode == "materialGlowTintsLight":
            text = "the material of a mesh light does not glow, and so does not tint its light"
            self._report.omission(prim.GetPath(), text)
        if dark or mode == "independent":
            emissive = _affine_color((1.0, 1.0, 1.0), glow, radiance)
        else:
            emissive = _affine_color(radiance, glow, (0.0, 0.0, 0.0))
        lit = replace(self.materials[bound.row], emissive_color=emissive)
        return self._row(("emitter", bound, mode, radiance), lit, bound.primvars)

    def by_element(self, gprim: Usd.Prim) -> list[tuple[Binding, NDArray[np.int64]]]:
        """Materials for the elements of a gprim whose displayColor or displayOpacity varies; none if neither does."""
        values = read_element_colors(gprim, self._time, self._report)
        if values is None:
            return []
        colors, groups = quantize_colors(values)
        return [
            (self._display_color((r, g, b), opacity), group)
            for (r, g, b, opacity), group in zip(colors, groups, strict=True)
        ]

    def _row(
        self, key: Any, material: Material, primvars: PrimvarNames = NO_PRIMVARS, is_display_color: bool = False
    ) -> Binding:
        if key not in self._bindings:
            self._bindings[key] = Binding(len(self.materials), primvars, is_display_color)
            self.materials.append(material)
        return cast(Binding, self._bindings[key])

    def _of_display_color(self, gprim: Usd.Prim) -> Binding:
        within = [
            name
            for name in ("displayColor", "displayOpacity")
            if varies_over_surface(gprim, name, self._time, within_faces=True)
        ]
        if within:
            return self._colored_vertices("displayOpacity" in within)
        color = self._constant_primvar(gprim, "displayColor", 3, report=False)
        opacity = self._constant_primvar(gprim, "displayOpacity", 1, report=False)
        return self._display_color(cast(Any, color or _DEFAULT.diffuse_color), 1.0 if opacity is None else opacity[0])

    def _colored_vertices(self, opacity: bool) -> Binding:
        """What Hydra shows for a mesh without a material whose colors vary within its faces."""
        name = "displayColor"
        color = Material(name, TextureLookup(VERTEX_COLORS))
        if opacity:
            color = replace(color, opacity=TextureLookup(VERTEX_COLORS, "a"), opacity_mode="presence")
        read = PrimvarNames(color=name, opacity="displayOpacity")
        return self._row(("displayColor of vertices", opacity), color, read, is_display_color=True)

    def _display_color(self, color: Color, opacity: float) -> Binding:
        """What Hydra shows for prims without a material; partial opacity is coverage, as there."""
        mode: Literal["transparent", "presence"] = "transparent" if opacity == 1.0 else "presence"
        material = Material("displayColor", diffuse_color=color, opacity=opacity, opacity_mode=mode)
        return self._row(("displayColor", color, opacity), material, is_display_color=True)

    def _constant_primvar(
        self, gprim: Usd.Prim, name: str, width: int, report: bool = True
    ) -> tuple[float, ...] | None:
        return constant_primvar(gprim, name, width, self._time, self._report, report_varying=report)

    def _of_material(self, material: UsdShade.Material, gprim: Usd.Prim) -> Binding | None:
        """The row of a material; None, with the reason reported, if none of its shaders is known."""
        prim = material.GetPrim()
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        values = self._values(gprim, self._primvars.get(path, ()))
        key = (path, values)
        if path not in self._primvars or key not in self._bindings:
            reader = NetworkReader(gprim, self._textures, self._time, self._report)
            read = reader.read(material)
            self._primvars[path] = tuple(reader.constants)
            key = (path, self._values(gprim, reader.constants))
            if read is None:
                self._bindings[key] = None
            else:
                self._row(key, read, reader.primvars)
        return self._bindings[key]

    def _values(self, gprim: Usd.Prim, names: Iterable[str]) -> tuple[Any, ...]:
        """What a gprim's primvars are as far as a material depends on them."""
        return tuple(
            "varies" if varies_over_surface(gprim, name, self._time) else self._constant_primvar(gprim, name, 3)
            for name in names
        )


def _affine_color(factor: Color, color: ColorInput, summand: Color) -> ColorInput:
    """`factor * color + summand`."""
    if isinstance(color, TextureLookup):
        scale = (*(f * s for f, s in zip(factor, color.scale, strict=False)), color.scale[3])
        bias = (*(f * b + s for f, b, s in zip(factor, color.bias, summand, strict=False)), color.bias[3])
        return replace(color, scale=cast(Any, scale), bias=cast(Any, bias))
    r, g, b = (f * c + s for f, c, s in zip(factor, color, summand, strict=True))
    return (r, g, b)
