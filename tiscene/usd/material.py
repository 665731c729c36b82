"""UsdPreviewSurface networks and displayColor as rows of one material table."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdShade

from tiscene.scene.description import Color, ColorInput, FloatInput, Material, TextureLookup
from tiscene.usd.display_color import constant_primvar, quantized, varying_display
from tiscene.usd.network import Connection, Source, connections_of, shader_id
from tiscene.usd.problems import Report
from tiscene.usd.texture import Affine, TextureTable

_DEFAULT = Material("default")
_IDENTITY: Affine = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Binding:
    """A material as a gprim or subset uses it. row: of the table. uv: the primvar its textures read, "" for any.

    is_display_color: it stands in for a material that is not there.
    """

    row: int
    uv: str = ""
    is_display_color: bool = False


class MaterialTable:
    """Reads each material once and numbers it."""

    def __init__(self, textures: TextureTable, time: Usd.TimeCode, report: Report) -> None:
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
        return self._row(("emitter", bound, mode, radiance), lit, bound.uv)

    def by_element(self, gprim: Usd.Prim) -> list[tuple[Binding, NDArray[np.int64]]]:
        """Materials for the elements of a gprim whose displayColor or displayOpacity varies; none if neither does."""
        values = varying_display(gprim, self._time, self._report)
        if values is None:
            return []
        colors, groups = quantized(values)
        return [
            (self._display_color((r, g, b), opacity), group)
            for (r, g, b, opacity), group in zip(colors, groups, strict=True)
        ]

    def _row(self, key: Any, material: Material, uv: str = "", is_display_color: bool = False) -> Binding:
        if key not in self._bindings:
            self._bindings[key] = Binding(len(self.materials), uv, is_display_color)
            self.materials.append(material)
        return cast(Binding, self._bindings[key])

    def _of_display_color(self, gprim: Usd.Prim) -> Binding:
        color = self._constant_primvar(gprim, "displayColor", 3, report=False)
        opacity = self._constant_primvar(gprim, "displayOpacity", 1, report=False)
        return self._display_color(cast(Any, color or _DEFAULT.diffuse_color), 1.0 if opacity is None else opacity[0])

    def _display_color(self, color: Color, opacity: float) -> Binding:
        """What Hydra shows for prims without a material; partial opacity is coverage, as there."""
        mode: Literal["transparent", "presence"] = "transparent" if opacity == 1.0 else "presence"
        material = Material("displayColor", diffuse_color=color, opacity=opacity, opacity_mode=mode)
        return self._row(("displayColor", color, opacity), material, is_display_color=True)

    def _constant_primvar(
        self, gprim: Usd.Prim, name: str, width: int, report: bool = True
    ) -> tuple[float, ...] | None:
        return constant_primvar(gprim, name, width, self._time, self._report, tell_if_it_varies=report)

    def _of_material(self, material: UsdShade.Material, gprim: Usd.Prim) -> Binding | None:
        """The row of a material; None, with the reason reported, if none of its shaders is known."""
        prim = material.GetPrim()
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        values = tuple(self._constant_primvar(gprim, name, 3) for name in self._primvars.get(path, ()))
        key = (path, values)
        if path not in self._primvars or key not in self._bindings:
            reader = _NetworkReader(self, gprim)
            read = reader.read(material)
            self._primvars[path] = tuple(reader.primvars)
            values = tuple(self._constant_primvar(gprim, name, 3) for name in reader.primvars)
            key = (path, values)
            if read is None:
                self._bindings[key] = None
            else:
                self._row(key, read, reader.uv)
        return self._bindings[key]


class _NetworkReader:
    """Reads one material's network for one gprim."""

    def __init__(self, table: MaterialTable, gprim: Usd.Prim) -> None:
        self.uv = ""
        self.primvars: list[str] = []
        self._table = table
        self._gprim = gprim
        self._time = table._time
        self._report = table._report

    def read(self, material: UsdShade.Material) -> Material | None:
        surface = self._surface(material)
        if surface is None:
            return None
        self._path = surface.GetPath()
        inputs = connections_of(surface, self._time)
        default = _DEFAULT
        displacement = inputs.get("displacement")
        if displacement is not None and (displacement.source or displacement.value):
            self._report.omission(self._path, "displacement is not applied")
        mode = self._token(inputs, "opacityMode", "transparent")
        return Material(
            name=material.GetPrim().GetName(),
            diffuse_color=self._color(inputs, "diffuseColor", default.diffuse_color),
            emissive_color=self._color(inputs, "emissiveColor", default.emissive_color),
            use_specular_workflow=bool(self._number(inputs, "useSpecularWorkflow", 0)),
            specular_color=self._color(inputs, "specularColor", default.specular_color),
            metallic=self._float(inputs, "metallic", default.metallic),
            roughness=self._float(inputs, "roughness", default.roughness),
            clearcoat=self._float(inputs, "clearcoat", default.clearcoat),
            clearcoat_roughness=self._float(inputs, "clearcoatRoughness", default.clearcoat_roughness),
            opacity=self._float(inputs, "opacity", default.opacity),
            opacity_mode=cast(Literal["transparent", "presence"], mode),
            opacity_threshold=self._number(inputs, "opacityThreshold", default.opacity_threshold),
            ior=self._number(inputs, "ior", default.ior),
            normal=self._normal(inputs),
        )

    def _surface(self, material: UsdShade.Material) -> UsdShade.Shader | None:
        """The UsdPreviewSurface of a material, from whichever of its surface outputs has one."""
        unknown: list[str] = []
        for output in material.GetSurfaceOutputs():
            for attribute in UsdShade.Utils.GetValueProducingAttributes(output):
                shader = UsdShade.Shader(attribute.GetPrim())
                name = shader_id(shader) if shader else ""
                if name == "UsdPreviewSurface":
                    if unknown:
                        self._unsupported(material, unknown[0], "its UsdPreviewSurface is used")
                    return shader
                unknown.append(name or str(attribute.GetPrim().GetTypeName()))
        siblings = [UsdShade.Shader(p) for p in Usd.PrimRange(material.GetPrim(), Usd.PrimAllPrimsPredicate)]
        for shader in siblings:
            if shader and shader_id(shader) == "UsdPreviewSurface":
                self._unsupported(material, unknown[0] if unknown else "none", "its UsdPreviewSurface is used")
                return shader
        if unknown:
            self._unsupported(material, unknown[0], "displayColor is used")
        else:
            self._report.omission(material.GetPath(), "a material without a surface shader, displayColor is used")
        return None

    def _unsupported(self, material: UsdShade.Material, name: str, instead: str) -> None:
        self._report.omission(material.GetPath(), f"shader {name!r} is not supported, {instead}")

    def _color(self, inputs: dict[str, Connection], name: str, default: ColorInput) -> ColorInput:
        value = self._value(inputs, name)
        if value is None or isinstance(value, TextureLookup):
            return default if value is None else value
        if len(value) == 1:
            value = value * 3
        return (value[0], value[1], value[2])

    def _float(self, inputs: dict[str, Connection], name: str, default: FloatInput) -> FloatInput:
        value = self._value(inputs, name)
        if value is None:
            return default
        if isinstance(value, TextureLookup):
            return (
                value
                if value.channel != "rgb"
                else TextureLookup(value.texture, "r", value.scale, value.bias, value.uv_transform)
            )
        return value[0]

    def _number(self, inputs: dict[str, Connection], name: str, default: float) -> float:
        value = self._value(inputs, name)
        if isinstance(value, TextureLookup):
            self._report.omission(self._path, f"{name} cannot come from a texture, {default} is used")
            return default
        return default if value is None else value[0]

    def _token(self, inputs: dict[str, Connection], name: str, default: str) -> str:
        connection = inputs.get(name)
        return default if connection is None or connection.value is None else str(connection.value)

    def _normal(self, inputs: dict[str, Connection]) -> TextureLookup | None:
        value = self._value(inputs, "normal")
        if value is None or isinstance(value, TextureLookup):
            return value
        if value[:2] != (0.0, 0.0):
            self._report.omission(self._path, "a constant normal other than (0, 0, 1) is not applied")
        return None

    def _value(self, inputs: dict[str, Connection], name: str) -> tuple[float, ...] | TextureLookup | None:
        """Numbers, a texture, or None for the input's default."""
        connection = inputs.get(name)
        if connection is None:
            return None
        if connection.source is None:
            if connection.attribute.ValueMightBeTimeVarying():
                self._report.frozen(self._path, f"{name} of a material")
            return self._numbers(connection.value, name)
        source = connection.source
        if source.id == "UsdUVTexture":
            return self._texture(source, name)
        if source.id.startswith("UsdPrimvarReader_"):
            return self._primvar(source)
        self._report.omission(
            source.shader.GetPath(), f"shader {source.id!r} is not supported, {name} is left at default"
        )
        return None

    def _numbers(self, value: Any, name: str) -> tuple[float, ...] | None:
        if value is None:
            return None
        try:
            numbers = tuple(float(v) for v in value) if hasattr(value, "__len__") else (float(value),)
        except (TypeError, ValueError):
            self._report.problem(self._path, name, f"{value!r} is not a number")
            return None
        if not all(math.isfinite(v) for v in numbers) or not numbers:
            self._report.problem(self._path, name, f"{value} is not a finite number")
            return None
        return numbers

    def _primvar(self, source: Source) -> tuple[float, ...] | None:
        """A primvar read as a constant: UsdPreviewSurface's inputs come from constants or textures here."""
        inputs = connections_of(source.shader, self._time)
        name = self._token(inputs, "varname", "")
        fallback = inputs.get("fallback")
        if name not in self.primvars:
            self.primvars.append(name)
        width = {"UsdPrimvarReader_float": 1, "UsdPrimvarReader_float2": 2, "UsdPrimvarReader_float4": 4}.get(
            source.id, 3
        )
        value = self._table._constant_primvar(self._gprim, name, width)
        return value if value is not None else self._numbers(fallback.value if fallback else None, "fallback")

    def _texture(self, source: Source, name: str) -> TextureLookup | tuple[float, ...] | None:
        inputs = connections_of(source.shader, self._time)
        fallback = self._four(inputs, "fallback", (0.0, 0.0, 0.0, 1.0))
        scale, bias = self._four(inputs, "scale", (1.0,) * 4), self._four(inputs, "bias", (0.0,) * 4)
        file = inputs.get("file")
        row, window = None, _IDENTITY
        if file is not None and isinstance(file.value, Sdf.AssetPath) and file.value.path:
            space = self._token(inputs, "sourceColorSpace", "auto")
            wrap_s, wrap_t = (self._token(inputs, wrap, "useMetadata") for wrap in ("wrapS", "wrapT"))
            if "<UDIM>" in file.value.path:
                found = self._table._textures.add_udim(file.attribute, file.value, space, fallback)
                row, window = found or (None, _IDENTITY)
            else:
                row = self._table._textures.add(file.attribute, file.value, space, wrap_s, wrap_t)
        channel = source.output if source.output in ("r", "g", "b", "a") else "rgb"
        if row is None:
            values = {"r": fallback[:1], "g": fallback[1:2], "b": fallback[2:3], "a": fallback[3:]}
            return values.get(channel, fallback[:3])
        matrix, uv = self._coordinates(inputs.get("st"))
        transform = _rows(np.array([window[:3], window[3:], (0.0, 0.0, 1.0)]) @ matrix)
        if uv and self.uv and uv != self.uv:
            self._report.omission(self._path, f"textures read both {self.uv!r} and {uv!r}, the first serves for all")
        self.uv = self.uv or uv
        return TextureLookup(row, cast(Any, channel), cast(Any, scale), cast(Any, bias), transform)

    def _four(self, inputs: dict[str, Connection], name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        connection = inputs.get(name)
        value = self._numbers(connection.value, name) if connection and connection.value is not None else None
        return default if value is None or len(value) != 4 else value

    def _coordinates(self, st: Connection | None) -> tuple[np.ndarray[Any, Any], str]:
        """The affine map, 3x3, and the primvar that a texture's coordinates come from."""
        transform = np.eye(3)
        while st is not None and st.source is not None:
            source = st.source
            inputs = connections_of(source.shader, self._time)
            if source.id == "UsdPrimvarReader_float2":
                return transform, self._token(inputs, "varname", "st")
            if source.id != "UsdTransform2d":
                self._report.omission(source.shader.GetPath(), f"shader {source.id!r} is not supported, 'st' is read")
                break
            transform = transform @ self._transform2d(inputs)
            st = inputs.get("in")
        return transform, ""

    def _transform2d(self, inputs: dict[str, Connection]) -> np.ndarray[Any, Any]:
        """Scale, then rotate counter-clockwise by degrees, then translate."""
        angle = math.radians(self._number(inputs, "rotation", 0.0))
        scale = self._value(inputs, "scale") or (1.0, 1.0)
        move = self._value(inputs, "translation") or (0.0, 0.0)
        if isinstance(scale, TextureLookup) or isinstance(move, TextureLookup):
            return np.eye(3)
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c * scale[0], -s * scale[1], move[0]], [s * scale[0], c * scale[1], move[1]], [0, 0, 1]])


def _rows(matrix: np.ndarray[Any, Any]) -> Affine:
    return cast(Affine, tuple(matrix[:2].reshape(-1).tolist()))


def _affine_color(factor: Color, color: ColorInput, summand: Color) -> ColorInput:
    """`factor * color + summand`."""
    if isinstance(color, TextureLookup):
        scale = (*(f * s for f, s in zip(factor, color.scale, strict=False)), color.scale[3])
        bias = (*(f * b + s for f, b, s in zip(factor, color.bias, summand, strict=False)), color.bias[3])
        return replace(color, scale=cast(Any, scale), bias=cast(Any, bias))
    r, g, b = (f * c + s for f, c, s in zip(factor, color, summand, strict=True))
    return (r, g, b)
