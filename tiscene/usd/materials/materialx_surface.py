# SPDX-License-Identifier: Apache-2.0
"""MaterialX surface models as `Material`s: standard_surface, open_pbr_surface, gltf_pbr and UsdPreviewSurface.

The models share most of their inputs with UsdPreviewSurface, under other names and with other defaults (`MODELS`).
Inputs without a counterpart are reported where they have an effect: `unsupported` of a model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from pxr import UsdShade

from tiscene.scene.description import ColorInput, FloatInput, Material, TextureLookup
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import ShaderConnection
from tiscene.usd.materials.materialx_network import MaterialXNetwork, category_of
from tiscene.usd.materials.materialx_signal import Signal

_WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class SurfaceModel:
    """Names and defaults of a model's inputs: (name, default); None: the model has no such input.

    Attributes:
        base: factor of the base color.
        color: base color.
        metallic: metalness.
        roughness: roughness of the specular lobe.
        ior: index of refraction.
        specular: factor of the specular lobe of dielectrics.
        coat: clearcoat.
        coat_roughness: its roughness.
        emission: factor of the emitted color.
        emissive: emitted color.
        opacity: presence, a number or a color.
        transmission: fraction of the light that is transmitted.
        subsurface: fraction of the diffuse light that scatters below the surface.
        subsurface_color: its color.
        normal: normal map.
        unsupported: inputs without a counterpart, and the values at which they have no effect.
    """

    base: tuple[str, float] | None
    color: tuple[str, Any]
    metallic: tuple[str, float]
    roughness: tuple[str, float]
    ior: tuple[str, float]
    specular: tuple[str, float] | None
    coat: tuple[str, float]
    coat_roughness: tuple[str, float]
    emission: tuple[str, float] | None
    emissive: tuple[str, Any]
    opacity: tuple[str, Any]
    transmission: tuple[str, float] | None
    subsurface: tuple[str, float] | None
    subsurface_color: tuple[str, Any] | None
    normal: str
    unsupported: Mapping[str, Any] = field(default_factory=dict)


MODELS = {
    "ND_standard_surface_surfaceshader": SurfaceModel(
        base=("base", 1.0),
        color=("base_color", (0.8, 0.8, 0.8)),
        metallic=("metalness", 0.0),
        roughness=("specular_roughness", 0.2),
        ior=("specular_IOR", 1.5),
        specular=("specular", 1.0),
        coat=("coat", 0.0),
        coat_roughness=("coat_roughness", 0.1),
        emission=("emission", 0.0),
        emissive=("emission_color", _WHITE),
        opacity=("opacity", _WHITE),
        transmission=("transmission", 0.0),
        subsurface=("subsurface", 0.0),
        subsurface_color=("subsurface_color", _WHITE),
        normal="normal",
        unsupported={
            "diffuse_roughness": 0.0,
            "specular_color": 1.0,
            "specular_anisotropy": 0.0,
            "transmission_color": 1.0,
            "sheen": 0.0,
            "coat_color": 1.0,
            "coat_affect_color": 0.0,
            "thin_film_thickness": 0.0,
            "thin_walled": 0.0,
        },
    ),
    "ND_open_pbr_surface_surfaceshader": SurfaceModel(
        base=("base_weight", 1.0),
        color=("base_color", (0.8, 0.8, 0.8)),
        metallic=("base_metalness", 0.0),
        roughness=("specular_roughness", 0.3),
        ior=("specular_ior", 1.5),
        specular=("specular_weight", 1.0),
        coat=("coat_weight", 0.0),
        coat_roughness=("coat_roughness", 0.0),
        emission=("emission_luminance", 0.0),
        emissive=("emission_color", _WHITE),
        opacity=("geometry_opacity", 1.0),
        transmission=("transmission_weight", 0.0),
        subsurface=("subsurface_weight", 0.0),
        subsurface_color=("subsurface_color", (0.8, 0.8, 0.8)),
        normal="geometry_normal",
        unsupported={
            "base_diffuse_roughness": 0.0,
            "specular_color": 1.0,
            "specular_roughness_anisotropy": 0.0,
            "transmission_color": 1.0,
            "fuzz_weight": 0.0,
            "coat_color": 1.0,
            "thin_film_weight": 0.0,
            "geometry_thin_walled": 0.0,
        },
    ),
    "ND_gltf_pbr_surfaceshader": SurfaceModel(
        base=None,
        color=("base_color", _WHITE),
        metallic=("metallic", 1.0),
        roughness=("roughness", 1.0),
        ior=("ior", 1.5),
        specular=("specular", 1.0),
        coat=("clearcoat", 0.0),
        coat_roughness=("clearcoat_roughness", 0.0),
        emission=("emissive_strength", 1.0),
        emissive=("emissive", (0.0, 0.0, 0.0)),
        opacity=("alpha", 1.0),
        transmission=("transmission", 0.0),
        subsurface=None,
        subsurface_color=None,
        normal="normal",
        unsupported={"specular_color": 1.0, "sheen_color": 0.0, "attenuation_color": 1.0, "iridescence": 0.0},
    ),
    "UsdPreviewSurface": SurfaceModel(
        base=None,
        color=("diffuseColor", (0.18, 0.18, 0.18)),
        metallic=("metallic", 0.0),
        roughness=("roughness", 0.5),
        ior=("ior", 1.5),
        specular=None,
        coat=("clearcoat", 0.0),
        coat_roughness=("clearcoatRoughness", 0.01),
        emission=None,
        emissive=("emissiveColor", (0.0, 0.0, 0.0)),
        opacity=("opacity", 1.0),
        transmission=None,
        subsurface=None,
        subsurface_color=None,
        normal="normal",
        unsupported={"useSpecularWorkflow": 0.0},
    ),
}


class MaterialXSurface:
    """Maps the inputs of one surface shader to a material.

    Args:
        shader: the surface shader.
        model: its model.
        inputs: its authored inputs.
        network: evaluates them.
        report: collects inputs without a counterpart.
        uv_set: returns which uv set of the vertices holds a primvar.
    """

    def __init__(
        self,
        shader: UsdShade.Shader,
        model: SurfaceModel,
        inputs: dict[str, ShaderConnection],
        network: MaterialXNetwork,
        report: StageReport,
        uv_set: Callable[[str], Literal[0, 1]],
    ) -> None:
        self._path = shader.GetPath()
        self._model = model
        self._inputs = inputs
        self._network = network
        self._baker = network.baker
        self._report = report
        self._uv_set = uv_set

    def material(self, name: str, prim_path: str) -> Material:
        """Return the material with a name and path."""
        model = self._model
        normal = self._normal()  # first: tangents are those of the first uv set, which must be the normal map's
        color = self._product(self._signal(model.base), self._required(model.color))
        color = self._with_subsurface(color)
        emissive = self._product(self._signal(model.emission), self._required(model.emissive))
        opacity, mode = self._opacity()
        self._report_unsupported()
        return Material(
            name=name,
            diffuse_color=self._color(color, "base_color"),
            emissive_color=self._color(emissive, "emission"),
            metallic=self._float(self._required(model.metallic), "metallic"),
            roughness=self._float(self._required(model.roughness), "roughness"),
            clearcoat=self._float(self._required(model.coat), "coat"),
            clearcoat_roughness=self._float(self._required(model.coat_roughness), "coat_roughness"),
            opacity=opacity,
            opacity_mode=mode,
            opacity_threshold=self._threshold(),
            ior=self._ior(),
            normal=normal,
            prim_path=prim_path,
        )

    def _signal(self, named: tuple[str, Any] | None) -> Signal | None:
        if named is None:
            return None
        return self._network.value(self._inputs.get(named[0]), named[1])

    def _required(self, named: tuple[str, Any]) -> Signal:
        found = self._signal(named)
        assert found is not None
        return found

    def _mean(self, named: tuple[str, Any] | None, default: float) -> float:
        """Return an input that must be a number; a texture is reported and replaced by its mean."""
        signal = self._signal(named)
        if signal is None or named is None:
            return default
        if signal.constant is None:
            self._report.omission(self._path, f"{named[0]} cannot come from a texture; its mean is used")
        return float(self._baker.mean(signal).mean())

    def _product(self, factor: Signal | None, signal: Signal) -> Signal:
        if factor is None:
            return signal
        for first, second in ((factor, signal), (signal, factor)):
            if first.constant is not None and (found := second.affine(first.constant, np.zeros(1))) is not None:
                return found
        width = max(factor.width, signal.width)
        return self._baker.apply(lambda a, b: a * b, factor.of_width(width), signal.of_width(width))

    def _with_subsurface(self, color: Signal) -> Signal:
        """Return the base color mixed with that of light scattered below the surface, which is drawn as diffuse."""
        weight = self._mean(self._model.subsurface, 0.0)
        if weight <= 0.0 or self._model.subsurface_color is None:
            return color
        self._report.omission(self._path, "subsurface scattering is drawn as diffuse reflection of its color")
        below = self._required(self._model.subsurface_color)
        if weight >= 1.0:
            return below
        return self._baker.apply(lambda a, b: a + (b - a) * weight, color.of_width(3), below.of_width(3))

    def _opacity(self) -> tuple[FloatInput, Literal["transparent", "presence"]]:
        """Return the opacity: presence of the surface, else what is not transmitted."""
        presence = self._required(self._model.opacity)
        if presence.width > 1:  # a color: the renderer has one opacity for all of them
            equal = presence.channels in ((0, 1, 2), (0, 0, 0)) or presence.constant is not None
            presence = (
                presence.select([0]) if equal else self._baker.apply(lambda a: a.mean(-1, keepdims=True), presence)
            )
        transmission = self._mean(self._model.transmission, 0.0)
        if presence.constant is not None and presence.constant[0] >= 1.0:
            return 1.0 - min(max(transmission, 0.0), 1.0), "transparent"
        if transmission > 0.0:
            self._report.omission(self._path, "transmission of a surface that is partly absent is not drawn")
        mode: Literal["transparent", "presence"] = "presence"
        if self._model.transmission is None:  # UsdPreviewSurface: opacity is transmission unless it says otherwise
            mode = "presence" if self._token("opacityMode") == "presence" else "transparent"
        if self._number("alpha_mode", 2.0) == 0.0:  # of gltf_pbr: opaque
            return 1.0, "transparent"
        return self._float(presence, "opacity"), mode

    def _threshold(self) -> float:
        if self._model.transmission is None:
            return self._number("opacityThreshold", 0.0)
        return self._number("alpha_cutoff", 0.5) if self._number("alpha_mode", 0.0) == 1.0 else 0.0

    def _number(self, name: str, default: float) -> float:
        return self._mean((name, default), default) if name in self._inputs else default

    def _token(self, name: str) -> str:
        connection = self._inputs.get(name)
        value = None if connection is None else connection.value
        return {"0": "transparent", "1": "presence"}.get(str(value), str(value))

    def _ior(self) -> float:
        """Return the index of refraction whose reflectance at normal incidence is scaled by the specular weight."""
        ior, weight = self._mean(self._model.ior, 1.5), self._mean(self._model.specular, 1.0)
        if weight == 1.0 or ior <= 0.0 or self._mean(self._model.transmission, 0.0) > 0.0:
            return ior
        root = min(abs((ior - 1.0) / (ior + 1.0)) * max(weight, 0.0) ** 0.5, 0.999)
        return float((1.0 + root) / (1.0 - root))

    def _normal(self) -> TextureLookup | None:
        """Return the normal map; None for none."""
        connection = self._inputs.get(self._model.normal)
        source = None if connection is None else connection.source
        if connection is None or source is None:
            return None
        category, strength = category_of(source.id), 1.0
        if category in ("normalmap", "gltf_normalmap"):
            strength = self._scale_of(source.shader)
        if category not in ("normalmap", "gltf_normalmap", "image", "tiledimage", "UsdUVTexture"):
            text = f"MaterialX node {source.id!r} is not supported as a normal; the mesh's normals are used"
            self._report.omission(source.shader.GetPath(), text)
            return None
        signal = self._network.output(source).of_width(3)
        if signal.constant is not None:
            return None
        is_unit = signal.bias is not None and bool((signal.bias < 0.0).any())  # already within -1..1
        mapped = signal if is_unit else signal.affine(np.full(1, 2.0), np.full(1, -1.0))
        if mapped is None:
            mapped = self._baker.apply(lambda values: 2.0 * values - 1.0, signal)
        if strength != 1.0:
            bent = np.array([strength, strength, 1.0])
            mapped = mapped.affine(bent, np.zeros(1)) or self._baker.apply(lambda values: values * bent, mapped)
        found = self._baker.lookup(mapped, 3, "normal", self._uv_set)
        return found if isinstance(found, TextureLookup) else None

    def _scale_of(self, shader: UsdShade.Shader) -> float:
        value = shader.GetInput("scale").Get() if shader.GetInput("scale") else None
        if value is None:
            return 1.0
        return float(value) if not hasattr(value, "__len__") else float(value[0])

    def _color(self, signal: Signal, name: str) -> ColorInput:
        found = self._baker.lookup(signal, 3, name, self._uv_set)
        if isinstance(found, TextureLookup):
            return found
        r, g, b = found.tolist()
        return (r, g, b)

    def _float(self, signal: Signal, name: str) -> FloatInput:
        found = self._baker.lookup(signal, 1, name, self._uv_set)
        return found if isinstance(found, TextureLookup) else float(found[0])

    def _report_unsupported(self) -> None:
        """Report inputs that have an effect and no counterpart."""
        found = []
        for name, neutral in self._model.unsupported.items():
            if name not in self._inputs:
                continue
            signal = self._network.value(self._inputs[name], neutral)
            if signal is not None and not (signal.constant is not None and np.allclose(signal.constant, neutral)):
                found.append(name)
        if found:
            self._report.omission(self._path, f"MaterialX inputs that are not applied: {', '.join(found)}")
        if "displacement" in self._inputs:
            self._report.omission(self._path, "displacement is not applied")
