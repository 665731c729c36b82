# SPDX-License-Identifier: Apache-2.0
"""The material table: bound materials and displayColor as rows that meshes refer to.

`MaterialTableBuilder` reads each material once, or once for each combination of the gprim's primvars that the material
depends on. Prims without a readable material get one of their displayColor and displayOpacity, as in Hydra.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdShade

from tiscene.scene.description import VERTEX_COLORS, Color, ColorInput, Material, TextureLookup
from tiscene.scene.input_track import InputTrack
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import shared_path
from tiscene.usd.geometry.display_color import (
    DISPLAY_PRIMVARS,
    constant_primvar,
    constant_times,
    quantize_colors,
    read_element_colors,
    varies_over_surface,
)
from tiscene.usd.geometry.point_primvars import EnclosingInstancers
from tiscene.usd.geometry.primvar import NO_PRIMVARS, PrimvarNames
from tiscene.usd.materials.animated_material import material_times, material_track
from tiscene.usd.materials.preview_surface import NetworkReader
from tiscene.usd.materials.texture import TextureTable
from tiscene.usd.materials.texture_borders import UnwrappedTexture, report_borders

_DEFAULT = Material("default")
_BLACK: Color = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Binding:
    """A material as a gprim or subset uses it.

    Attributes:
        row: row of the material table.
        primvars: the primvars that the material reads per vertex.
        is_display_color: whether it is made of displayColor, for lack of a material.
    """

    row: int
    primvars: PrimvarNames = NO_PRIMVARS
    is_display_color: bool = False


class MaterialTableBuilder:
    """Reads materials into `materials`, each once.

    Args:
        textures: table for the materials' image files.
        time: when to evaluate attributes.
        report: collects problems and omissions.
        instancers: those whose prototypes are being read.

    Attributes:
        materials: the rows read so far.
        tracks: how some of them vary over time.
    """

    def __init__(
        self, textures: TextureTable, time: Usd.TimeCode, report: StageReport, instancers: EnclosingInstancers
    ) -> None:
        self.materials: list[Material] = []
        self.tracks: list[InputTrack] = []
        self._textures = textures
        self._time = time
        self._report = report
        self._instancers = instancers
        self._primvars: dict[Any, tuple[tuple[str, int], ...]] = {}  # of each material's constants: name, width
        self._bindings: dict[Any, Binding | None] = {}
        self._unwrapped: dict[Any, tuple[UnwrappedTexture, ...]] = {}
        self._checked_uses: set[tuple[Any, UnwrappedTexture]] = set()

    def binding(self, prim: Usd.Prim, gprim: Usd.Prim) -> Binding:
        """Return the material bound to a gprim or to a subset of it, else one of its displayColor.

        Bindings are resolved with inheritance and collections, for the purpose preview, then full.

        Args:
            prim: the gprim or the GeomSubset that the binding is authored on.
            gprim: the gprim, whose primvars the material reads.
        """
        api = UsdShade.MaterialBindingAPI(prim)
        previous = None
        for purpose in (UsdShade.Tokens.preview, UsdShade.Tokens.full):
            material, relationship = api.ComputeBoundMaterial(purpose)
            if relationship and not material:
                self._report_unbound(relationship)
            if material and material.GetPath() != previous:
                binding = None
                with self._report.guard(material.GetPrim()):
                    binding = self._read_material(material, prim, gprim)
                if binding is not None:
                    return binding
                previous = material.GetPath()
        return self._of_display_color(gprim)

    def _report_unbound(self, relationship: Usd.Relationship) -> None:
        """Report a binding that names no material. One whose target a reference does not bring along names nothing."""
        for target in relationship.GetForwardedTargets()[-1:]:  # that of a collection names the collection first
            is_there = relationship.GetStage().GetPrimAtPath(target)
            what = "a prim that is no material" if is_there else "a material that does not exist"
            self._report.omission(relationship.GetPrim().GetPath(), f"a binding to {what} is not applied", target)

    def emitter(self, prim: Usd.Prim, radiance: Color, over_time: Sequence[tuple[float, Color]] = ()) -> Binding:
        """Return the material of a mesh light: black with an emission, or the bound one as materialSyncMode says.

        Args:
            prim: the mesh light.
            radiance: emitted radiance of the light, W/(m² sr).
            over_time: the same at time codes, if it varies.
        """
        mode = prim.GetAttribute("light:materialSyncMode").Get(self._time)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.preview)
        bound = None
        if mode in ("materialGlowTintsLight", "independent") and material:
            bound = self.binding(prim, prim)
            if mode != "independent" and self.materials[bound.row].emissive_color == _BLACK:
                text = "the material of a mesh light has no emission, so that it does not tint the light"
                self._report.omission(prim.GetPath(), text)

        def lit(radiance: Color) -> Material:
            if bound is None:
                return Material(prim.GetName(), diffuse_color=_BLACK, emissive_color=radiance)
            own = self.materials[bound.row]
            if own.emissive_color == _BLACK or mode == "independent":
                emissive = _affine_color((1.0, 1.0, 1.0), own.emissive_color, radiance)
            else:
                emissive = _affine_color(radiance, own.emissive_color, _BLACK)
            return replace(own, emissive_color=emissive)

        key = ("emitter", bound, mode if bound else "", radiance, tuple(over_time))
        is_new = key not in self._bindings
        binding = self._row(key, lit(radiance), bound.primvars if bound else NO_PRIMVARS)
        if is_new and over_time:
            colors = {Usd.TimeCode(time): color for time, color in over_time}
            times = [time for time, _ in over_time]
            self._animate(prim, binding.row, times, lambda code: lit(colors[code]))
        return binding

    def _animate(
        self, prim: Usd.Prim, row: int, times: Sequence[float], read: Callable[[Usd.TimeCode], Material | None]
    ) -> None:
        """Add the track of the material in a row, which `read` returns at time codes."""
        if times:
            track = material_track(prim.GetStage(), row, times, read)
            self.tracks += [] if track is None else [track]

    def by_element(self, gprim: Usd.Prim, time: Usd.TimeCode) -> list[tuple[Binding, NDArray[np.int64]]]:
        """Return materials for a gprim whose displayColor or displayOpacity varies, with the elements that use each.

        Elements are faces, points or curves. Empty if neither varies at the time.
        """
        values = read_element_colors(gprim, time, self._report)
        if values is None:
            return []
        colors, groups = quantize_colors(values)
        return [
            (self._display_color((r, g, b), opacity), group)
            for (r, g, b, opacity), group in zip(colors, groups, strict=True)
        ]

    def unseen(self, binding: Binding) -> Binding:
        """Return the same material for a gprim that the camera does not see."""
        key = ("unseen", binding.row)
        is_new = key not in self._bindings
        material = replace(self.materials[binding.row], seen_by_camera=False)
        found = self._row(key, material)
        if is_new:
            self.tracks += [replace(each, row=found.row) for each in self.tracks if each.row == binding.row]
        return replace(binding, row=found.row)

    def _row(
        self, key: Any, material: Material, primvars: PrimvarNames = NO_PRIMVARS, is_display_color: bool = False
    ) -> Binding:
        """Return the binding of this key; append the material if the key is new."""
        if key not in self._bindings:
            self._bindings[key] = Binding(len(self.materials), primvars, is_display_color)
            self.materials.append(material)
        return cast(Binding, self._bindings[key])

    def _of_display_color(self, gprim: Usd.Prim) -> Binding:
        """Return the material of a gprim's displayColor and displayOpacity."""
        of_points = [name for name in DISPLAY_PRIMVARS if self._is_of_points(gprim, name)]
        if of_points or any(
            varies_over_surface(gprim, name, self._time, within_faces=True) for name in DISPLAY_PRIMVARS
        ):
            return self._vertex_colors(gprim, of_points)
        times = constant_times(gprim, DISPLAY_PRIMVARS, self._report)
        if not times:
            return self._display_color(*self._constant_color(gprim, self._time))

        def read_at(code: Usd.TimeCode) -> Material:
            return replace(_of_color(*self._constant_color(gprim, code)), opacity_mode="presence")

        values = tuple(map(read_at, map(Usd.TimeCode, times)))  # instances may inherit different ones
        key = ("displayColor over time", shared_path(gprim), tuple(times), values)
        is_new = key not in self._bindings
        binding = self._row(key, read_at(self._time), is_display_color=True)
        if is_new:
            self._animate(gprim, binding.row, times, read_at)
        return binding

    def _constant_color(self, gprim: Usd.Prim, time: Usd.TimeCode, varying: Iterable[str] = ()) -> tuple[Color, float]:
        """Return the mean displayColor and displayOpacity of a gprim; the defaults of those in `varying`."""
        color, opacity = (
            None if name in varying else constant_primvar(gprim, name, width, time, self._report, report_varying=False)
            for name, width in (("displayColor", 3), ("displayOpacity", 1))
        )
        return cast(Any, color or _DEFAULT.diffuse_color), 1.0 if opacity is None else opacity[0]

    def _is_of_points(self, gprim: Usd.Prim, name: str) -> bool:
        """Return whether points of an instancer give a gprim its displayColor or displayOpacity."""
        return self._instancers.give(gprim, name, is_color=name == "displayColor")

    def _vertex_colors(self, gprim: Usd.Prim, of_points: Collection[str]) -> Binding:
        """Return the material of a mesh whose displayColor or displayOpacity varies within faces, as Hydra draws it.

        One that does not vary is a constant of the material: instances may inherit different ones.

        Args:
            gprim: the mesh, or another gprim in a prototype of an instancer.
            of_points: which of the two its points give.
        """
        varying = [
            name for name in DISPLAY_PRIMVARS if name in of_points or varies_over_surface(gprim, name, self._time)
        ]
        if of_points and constant_times(gprim, set(DISPLAY_PRIMVARS) - set(varying), self._report):
            self._report.frozen(gprim.GetPath(), "a displayColor or displayOpacity beside that of points")
        material, read = _of_color(*self._constant_color(gprim, self._time, varying)), NO_PRIMVARS
        if "displayColor" in varying:
            material = replace(material, diffuse_color=TextureLookup(VERTEX_COLORS))
            read = replace(read, color="displayColor")
        if "displayOpacity" in varying:
            material = replace(material, opacity=TextureLookup(VERTEX_COLORS, "a"), opacity_mode="presence")
            read = replace(read, opacity="displayOpacity")
        return self._row(("displayColor of vertices", material), material, read, is_display_color=True)

    def _display_color(self, color: Color, opacity: float) -> Binding:
        """Return a material of one color, as Hydra draws prims without one; partial opacity is coverage."""
        return self._row(("displayColor", color, opacity), _of_color(color, opacity), is_display_color=True)

    def _read_material(self, material: UsdShade.Material, prim: Usd.Prim, gprim: Usd.Prim) -> Binding | None:
        """Return a material's binding; None, with the reason reported, if none of its surface shaders is supported."""
        path = shared_path(material.GetPrim())
        values = self._primvar_values(gprim, self._primvars.get(path, ()))
        key = (path, values)
        if path not in self._primvars or key not in self._bindings:
            reader = NetworkReader(gprim, self._textures, self._time, self._report, self._instancers)
            read = reader.read(material)
            self._primvars[path] = tuple(reader.constants)
            self._unwrapped[path] = tuple(reader.unwrapped)
            key = (path, self._primvar_values(gprim, reader.constants))
            if read is None:
                self._bindings[key] = None
            else:
                binding = self._row(key, read, reader.primvars)
                self._instancers.report_unapplied(gprim, reader.primvars.uv, reader.primvars.second_uv)
                primvar_times = constant_times(gprim, (name for name, _ in reader.constants), self._report)
                times = material_times(material.GetPrim(), primvar_times, self._report)

                def read_at(code: Usd.TimeCode) -> Material | None:
                    return NetworkReader(gprim, self._textures, code, self._report, self._instancers).read(material)

                self._animate(gprim, binding.row, times, read_at)
        for texture in self._unwrapped[path]:
            use = (shared_path(prim), texture)
            if use not in self._checked_uses:
                self._checked_uses.add(use)
                report_borders(prim, gprim, texture, self._time, self._report)
        self._check_tangents(gprim, self._bindings[key])
        return self._bindings[key]

    def _check_tangents(self, gprim: Usd.Prim, binding: Binding | None) -> None:
        """Report a mesh without texture coordinates, whose u gives anisotropy its direction."""
        lobes = None if binding is None else self.materials[binding.row].lobes
        if binding is None or lobes is None or lobes.anisotropy == 0.0 or not gprim.IsA(UsdGeom.Mesh):
            return
        api = UsdGeom.PrimvarsAPI(gprim)
        named = api.FindPrimvarWithInheritance(binding.primvars.uv or "st")
        others = (each.GetTypeName().role for each in api.GetPrimvarsWithAuthoredValues())
        if not ((named and named.HasAuthoredValue()) or "TextureCoordinate" in others):
            text = "has an anisotropic material and no texture coordinates; its direction differs between triangles"
            self._report.omission(gprim.GetPath(), text)

    def _primvar_values(self, gprim: Usd.Prim, primvars: Iterable[tuple[str, int]]) -> tuple[Any, ...]:
        """Return the gprim's values of the primvars that a material reads as constants: part of the cache key.

        Of those that are animated, the values at all their time codes.
        """
        found: list[Any] = []
        for name, width in primvars:
            if varies_over_surface(gprim, name, self._time):
                found.append("varies")
                continue
            if width != 2 and self._instancers.give(gprim, name, is_color=width != 1):
                found.append("of points")
                continue
            times = constant_times(gprim, (name,), self._report)
            codes = (self._time, *map(Usd.TimeCode, times))
            found.append((*times, *(constant_primvar(gprim, name, width, code, self._report) for code in codes)))
        return tuple(found)


def _of_color(color: Color, opacity: float) -> Material:
    """Return the material of a displayColor and displayOpacity."""
    mode: Literal["transparent", "presence"] = "transparent" if opacity == 1.0 else "presence"
    return Material("displayColor", diffuse_color=color, opacity=opacity, opacity_mode=mode)


def _affine_color(factor: Color, color: ColorInput, summand: Color) -> ColorInput:
    """Return `factor * color + summand`."""
    if isinstance(color, TextureLookup):
        scale = (*(f * s for f, s in zip(factor, color.scale, strict=False)), color.scale[3])
        bias = (*(f * b + s for f, b, s in zip(factor, color.bias, summand, strict=False)), color.bias[3])
        return replace(color, scale=cast(Any, scale), bias=cast(Any, bias))
    r, g, b = (f * c + s for f, c, s in zip(factor, color, summand, strict=True))
    return (r, g, b)
