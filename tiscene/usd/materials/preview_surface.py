# SPDX-License-Identifier: Apache-2.0
"""Shader networks as `Material`s: UsdPreviewSurface after its specification, MaterialX by `materialx_surface`.

Every input becomes a constant, a texture lookup (UsdUVTexture with UsdTransform2d) or a vertex color (primvar readers).
Inputs and nodes that are not supported are reported, with what is used instead.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from tiscene.scene.description import VERTEX_COLORS, ColorInput, FloatInput, Material, TextureLookup
from tiscene.usd.core.color_space import attribute_colors
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import (
    ShaderConnection,
    Source,
    broken_connections,
    connections_of,
    opacity_mode,
    shader_id,
)
from tiscene.usd.geometry.display_color import constant_primvar, varies_over_surface
from tiscene.usd.geometry.point_primvars import EnclosingInstancers
from tiscene.usd.geometry.primvar import NO_PRIMVARS, report_missing_coordinates
from tiscene.usd.materials.materialx_bsdf import SURFACES
from tiscene.usd.materials.materialx_folding import FOLDED, folded_inputs
from tiscene.usd.materials.materialx_inputs import SurfaceInputs
from tiscene.usd.materials.materialx_network import MaterialXNetwork
from tiscene.usd.materials.materialx_signal import Signal, lookup, number, rotation, shift
from tiscene.usd.materials.materialx_surface import MaterialXSurface
from tiscene.usd.materials.surface_shader import surface_shader
from tiscene.usd.materials.texture import IDENTITY, Affine, TextureTable
from tiscene.usd.materials.texture_borders import UnwrappedTexture

_DEFAULT = Material("default")
_DEFAULT_UV = "st"


class NetworkReader:
    """Reads one material's network for one gprim.

    Args:
        gprim: the prim whose primvars the network's primvar readers read.
        textures: table for image files.
        time: when to evaluate attributes.
        report: collects problems and omissions.
        instancers: those whose prototype the gprim is in.

    Attributes:
        constants: name and number of components of the primvars read as constants.
        primvars: names of the primvars read per vertex.
        unwrapped: the textures without an authored wrap mode, and those of UDIM tiles.
    """

    def __init__(
        self,
        gprim: Usd.Prim,
        textures: TextureTable,
        time: Usd.TimeCode,
        report: StageReport,
        instancers: EnclosingInstancers,
    ) -> None:
        self.constants: list[tuple[str, int]] = []
        self.primvars = NO_PRIMVARS
        self.unwrapped: list[UnwrappedTexture] = []
        self._reads_default_uv = False
        self._gprim = gprim
        self._textures = textures
        self._time = time
        self._report = report
        self._instancers = instancers

    def read(self, material: UsdShade.Material) -> Material | None:
        """Return the material; None, with the reason reported, if it has no surface shader that is supported."""
        surface = surface_shader(material, self._time, self._report)
        if surface is None:
            return None
        self._path, self._material = surface.GetPath(), material.GetPrim()
        for attribute, target in broken_connections(surface):
            text = "an input connected to an attribute that does not exist keeps its own value, else its default"
            self._report.omission(attribute.GetPath(), text, target)
        inputs = connections_of(surface, self._time)
        name = shader_id(surface)
        sources = [each.source.id for each in inputs.values() if each.source is not None]
        if name != "UsdPreviewSurface" or any(each.startswith("ND_") for each in sources):
            return self._read_materialx(material, surface, name, inputs)
        displacement = inputs.get("displacement")
        if displacement is not None and (displacement.source or displacement.value):
            self._report.omission(self._path, "displacement is not applied")
        bumps = inputs.get("normal")
        if bumps is not None and bumps.source is not None:  # tangents are of the first uv: it must be the normal map's
            st = connections_of(bumps.source.shader, self._time).get("st")
            self._uv_set(self._coordinates(st)[1])
        return Material(
            name=material.GetPrim().GetName(),
            diffuse_color=self._color(inputs, "diffuseColor", _DEFAULT.diffuse_color),
            emissive_color=self._color(inputs, "emissiveColor", _DEFAULT.emissive_color),
            use_specular_workflow=bool(self._number(inputs, "useSpecularWorkflow", 0)),
            specular_color=self._color(inputs, "specularColor", _DEFAULT.specular_color),
            metallic=self._float(inputs, "metallic", _DEFAULT.metallic),
            roughness=self._float(inputs, "roughness", _DEFAULT.roughness),
            clearcoat=self._float(inputs, "clearcoat", _DEFAULT.clearcoat),
            clearcoat_roughness=self._float(inputs, "clearcoatRoughness", _DEFAULT.clearcoat_roughness),
            opacity=self._float(inputs, "opacity", _DEFAULT.opacity),
            opacity_mode=opacity_mode(inputs),
            opacity_threshold=self._number(inputs, "opacityThreshold", _DEFAULT.opacity_threshold),
            ior=self._ior(inputs, _DEFAULT.ior),
            normal=self._normal(inputs),
            prim_path=str(material.GetPath()),
        )

    def _read_materialx(
        self, material: UsdShade.Material, surface: UsdShade.Shader, name: str, inputs: dict[str, ShaderConnection]
    ) -> Material:
        """Return the material of a MaterialX surface shader."""
        if any(output.HasConnectedSource() for output in material.GetDisplacementOutputs()):
            self._report.omission(material.GetPath(), "displacement is not applied")
        network = MaterialXNetwork(surface.GetPath(), self._textures, self._time, self._report, self._vertex_signal)
        computed: dict[str, Signal] = {}
        if name in SURFACES:
            name = FOLDED
            inputs, computed = folded_inputs(surface, self._time, network, self._report)
        values = SurfaceInputs(surface.GetPath(), inputs, network, self._report, self._uv_set, computed)
        return MaterialXSurface(name, values).material(str(material.GetPrim().GetName()), str(material.GetPath()))

    def _vertex_signal(self, name: str, width: int) -> Signal | None:
        """Return a primvar of a MaterialX network: the vertices' values where it varies, else its constant value."""
        found = self._primvar_value(name, width)
        if isinstance(found, TextureLookup):
            return lookup(VERTEX_COLORS, (3,) if width == 1 else (0, 1, 2))
        return None if found is None else number(*found)

    def _color(self, inputs: dict[str, ShaderConnection], name: str, default: ColorInput) -> ColorInput:
        """Return an input as a color or texture; one number is gray."""
        value = self._value(inputs, name)
        if value is None or isinstance(value, TextureLookup):
            return default if value is None else value
        if len(value) == 1:
            value = value * 3
        return (value[0], value[1], value[2])

    def _float(self, inputs: dict[str, ShaderConnection], name: str, default: FloatInput) -> FloatInput:
        """Return an input as a number or a texture of one channel."""
        value = self._value(inputs, name)
        if value is None:
            return default
        if isinstance(value, TextureLookup):
            return value if value.channel != "rgb" else replace(value, channel="r")
        return value[0]

    def _number(self, inputs: dict[str, ShaderConnection], name: str, default: float) -> float:
        """Return an input that must be a number; textures are reported and replaced by the default."""
        value = self._value(inputs, name)
        if isinstance(value, TextureLookup):
            self._report.omission(self._path, f"{name} cannot come from a texture; {default} is used")
            return default
        return default if value is None else value[0]

    def _ior(self, inputs: dict[str, ShaderConnection], default: float) -> float:
        """Return the index of refraction; one that is not above 0 is reported and replaced by the default."""
        value = self._number(inputs, "ior", default)
        if value > 0.0:
            return value
        self._report.problem(self._path, "ior", f"{value} is not above 0")
        return default

    def _token(self, inputs: dict[str, ShaderConnection], name: str, default: str) -> str:
        connection = inputs.get(name)
        return default if connection is None or connection.value is None else str(connection.value)

    def _normal(self, inputs: dict[str, ShaderConnection]) -> TextureLookup | None:
        """Return the normal map, None for none."""
        value = self._value(inputs, "normal")
        if value is None or isinstance(value, TextureLookup):
            return value
        if value[:2] != (0.0, 0.0):
            self._report.omission(self._path, "a constant normal other than (0, 0, 1) is not applied")
        return None

    def _value(self, inputs: dict[str, ShaderConnection], name: str) -> tuple[float, ...] | TextureLookup | None:
        """Return an input's numbers or its texture; None: use the default."""
        connection = inputs.get(name)
        if connection is None:
            return None
        if connection.source is None:
            values = self._numbers(connection.value, name)
            if values is None or len(values) < 3:
                return values
            return tuple(attribute_colors(connection.attribute, np.array(values)).tolist())
        source = connection.source
        if source.id == "UsdUVTexture":
            return self._texture(source)
        if source.id.startswith("UsdPrimvarReader_"):
            return self._primvar(source)
        text = f"shader {source.id!r} is not supported" if source.id else "a shader without info:id"
        self._report.omission(source.shader.GetPath(), f"{text}; {name} keeps its default")
        return None

    def _numbers(self, value: Any, name: str) -> tuple[float, ...] | None:
        """Return a value as finite numbers; None, with a problem reported, if it is none."""
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

    def _primvar(self, source: Source) -> tuple[float, ...] | TextureLookup | None:
        """Return the value of a primvar reader: numbers, or the vertices' color or opacity where the primvar varies.

        None for a shader of another kind.
        """
        if not source.id.startswith("UsdPrimvarReader_"):
            return None
        inputs = connections_of(source.shader, self._time)
        fallback = inputs.get("fallback")
        width = {"float": 1, "int": 1, "float2": 2, "float4": 4}.get(source.id.removeprefix("UsdPrimvarReader_"), 3)
        value = self._primvar_value(self._token(inputs, "varname", ""), width)
        return value if value is not None else self._numbers(fallback.value if fallback else None, "fallback")

    def _primvar_value(self, name: str, width: int) -> tuple[float, ...] | TextureLookup | None:
        """Return a primvar's value, or the vertices' color or opacity where it varies; None if there is none.

        One that the gprim lacks is the material's own, as in Hydra.
        """
        if (name, width) not in self.constants:
            self.constants.append((name, width))
        field = "opacity" if width == 1 else "color"  # one of each per material; another one becomes its mean
        if width != 2 and getattr(self.primvars, field) in ("", name):
            of_points = self._instancers.give(self._gprim, name, is_color=field == "color")
            if of_points or varies_over_surface(self._gprim, name, self._time):
                self.primvars = replace(self.primvars, **{field: name})
                return TextureLookup(VERTEX_COLORS, "a" if width == 1 else "rgb")
        self._instancers.report_unapplied(self._gprim, name)
        value = constant_primvar(self._gprim, name, width, self._time, self._report)
        return value if value is not None else constant_primvar(self._material, name, width, self._time, self._report)

    def _texture(self, source: Source) -> TextureLookup | tuple[float, ...] | None:
        """Return the lookup of a UsdUVTexture, or its fallback if the image cannot be read."""
        inputs = connections_of(source.shader, self._time)
        fallback = self._four(inputs, "fallback", (0.0, 0.0, 0.0, 1.0))
        bias = self._four(inputs, "bias", (0.0,) * 4)
        file = inputs.get("file")
        row, window, unwrapped = None, IDENTITY, (False, False)
        if file is None or not isinstance(file.value, Sdf.AssetPath) or not file.value.path:
            self._report.omission(source.shader.GetPath(), "a UsdUVTexture without a file; its fallback is used")
        else:
            space = self._token(inputs, "sourceColorSpace", "auto")
            wrap_s, wrap_t = (self._token(inputs, wrap, "useMetadata") for wrap in ("wrapS", "wrapT"))
            if "<UDIM>" in file.value.path:
                found = self._textures.add_udim(file.attribute, file.value, space, fallback)
                row, window = found or (None, IDENTITY)
                unwrapped = (True, True)
            else:
                row = self._textures.add(file.attribute, file.value, space, wrap_s, wrap_t)
                unwrapped = (wrap_s == "useMetadata", wrap_t == "useMetadata")
        channel = source.output if source.output in ("r", "g", "b", "a") else "rgb"
        factor = "" if any(bias) else self._vertex_factor(inputs.get("scale"), channel)
        scale = self._four({} if factor else inputs, "scale", (1.0,) * 4)
        if row is None:
            values = {"r": fallback[:1], "g": fallback[1:2], "b": fallback[2:3], "a": fallback[3:]}
            return values.get(channel, fallback[:3])
        matrix, uv = self._coordinates(inputs.get("st"))
        matrix = np.array([window[:3], window[3:], (0.0, 0.0, 1.0)]) @ matrix
        transform = cast(Affine, tuple(matrix[:2].reshape(-1).tolist()))
        chosen = self._uv_set(uv)
        if file is not None and any(unwrapped):
            self.unwrapped.append(UnwrappedTexture(file.value.path, uv, transform, unwrapped))
        scales, biases = cast(Any, scale), cast(Any, bias)
        return TextureLookup(row, cast(Any, channel), scales, biases, transform, chosen, factor)

    def _vertex_factor(self, scale: ShaderConnection | None, channel: str) -> Literal["", "rgb", "a"]:
        """Return what of the vertices scales a texture: their colors, or an opacity; "" for nothing that varies."""
        value = None if scale is None or scale.source is None else self._primvar(scale.source)
        if not isinstance(value, TextureLookup) or (value.channel == "rgb" and channel != "rgb"):
            return ""
        return "rgb" if value.channel == "rgb" else "a"

    def _uv_set(self, name: str) -> Literal[0, 1]:
        """Return which of the vertices' two uv sets holds a primvar, and claim one for it. "" is the mesh's default."""
        first, second = self.primvars.uv, self.primvars.second_uv
        if not name and not first:
            self._reads_default_uv = True
            return 0
        name = name or _DEFAULT_UV
        if first == name or (not first and (name == _DEFAULT_UV or not self._reads_default_uv)):
            self.primvars = replace(self.primvars, uv=name)
            return 0
        if second not in ("", name):
            text = f"textures read the uv sets {first!r}, {second!r} and {name!r}; {first!r} is used for the third"
            self._report.omission(self._path, text)
            return 0
        self.primvars = replace(self.primvars, second_uv=name)
        return 1

    def _four(self, inputs: dict[str, ShaderConnection], name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return an input of a UsdUVTexture as four numbers, whatever its width.

        One number is repeated; two and three are followed by the default's.
        """
        connection = inputs.get(name)
        if connection is None:
            return default
        value: Any = self._primvar(connection.source) if connection.source else self._numbers(connection.value, name)
        if connection.source and not isinstance(value, tuple):
            path = connection.source.shader.GetPath()
            self._report.omission(path, f"{name} of a texture cannot be read from this shader; {default} is used")
        if not isinstance(value, tuple) or len(value) > 4:
            return default
        return value * 4 if len(value) == 1 else value + default[len(value) :]

    def _coordinates(self, st: ShaderConnection | None) -> tuple[np.ndarray[Any, Any], str]:
        """Return the affine map [3, 3] of a texture's coordinates and the primvar they come from ("": the default)."""
        transform, visited = np.eye(3), set()
        while st is not None and st.source is not None:
            source, path = st.source, st.source.shader.GetPath()
            inputs = connections_of(source.shader, self._time)
            if source.id == "UsdPrimvarReader_float2":
                name = self._token(inputs, "varname", "st")
                fallback = self._missing_coordinates(name, inputs.get("fallback"))
                return (transform, name) if fallback is None else (transform @ _at_point(fallback), "")
            if source.id != "UsdTransform2d" or path in visited:
                fault = "is connected to itself" if path in visited else "is not supported"
                self._report.omission(path, f"shader {source.id!r} {fault}; 'st' is used")
                break
            visited.add(path)
            transform = transform @ self._transform2d(inputs)
            st = inputs.get("in")
        point = None if st is None or st.source is not None else self._numbers(st.value, "st")
        if point is not None and len(point) == 2:  # one point of the image everywhere
            transform = transform @ _at_point(point)
        return transform, ""

    def _missing_coordinates(self, name: str, fallback: ShaderConnection | None) -> tuple[float, ...] | None:
        """Return a primvar reader's fallback if the mesh has not the texture coordinates that it reads."""
        value = None if fallback is None else self._numbers(fallback.value, "fallback")
        if value is None or len(value) != 2 or not self._gprim.IsA(UsdGeom.PointBased):
            return None  # other gprims have generated coordinates
        if (name, 2) not in self.constants:
            self.constants.append((name, 2))
        found = UsdGeom.PrimvarsAPI(self._gprim).FindPrimvarWithInheritance(name)
        if found and found.HasAuthoredValue():
            return None
        report_missing_coordinates(self._gprim, name, value, self._report)
        return value

    def _transform2d(self, inputs: dict[str, ShaderConnection]) -> np.ndarray[Any, Any]:
        """Return the 3x3 matrix of a UsdTransform2d: scale, then rotate counter-clockwise, then translate."""
        scale = self._value(inputs, "scale") or (1.0, 1.0)
        move = self._value(inputs, "translation") or (0.0, 0.0)
        if isinstance(scale, TextureLookup) or isinstance(move, TextureLookup):
            return np.eye(3)
        return shift(*move) @ rotation(self._number(inputs, "rotation", 0.0)) @ np.diag([*scale[:2], 1.0])


def _at_point(point: tuple[float, ...]) -> np.ndarray[Any, Any]:
    """Return the map [3, 3] of all texture coordinates to one point."""
    return np.array([[0, 0, point[0]], [0, 0, point[1]], [0, 0, 1.0]])
