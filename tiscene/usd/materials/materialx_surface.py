# SPDX-License-Identifier: Apache-2.0
"""MaterialX surface models as `Material`s: standard_surface, open_pbr_surface, gltf_pbr and UsdPreviewSurface.

Inputs without a counterpart are reported where they have an effect: `unsupported` of a model.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from pxr import Sdf

from tiscene.scene.color import LUMINANCE
from tiscene.scene.description import FloatInput, Material, TextureLookup
from tiscene.usd.core.shader_network import ShaderConnection, connections_of, opacity_mode
from tiscene.usd.materials.materialx_inputs import SurfaceInputs
from tiscene.usd.materials.materialx_lobes import ExtendedSurface
from tiscene.usd.materials.materialx_models import MODELS
from tiscene.usd.materials.materialx_nodes import category_of, is_geometric
from tiscene.usd.materials.materialx_signal import Signal, number

_NORMALS = ("normalmap", "gltf_normalmap", "bump", "heighttonormal", "image", "tiledimage", "UsdUVTexture")
_FLAT = (0.5, 0.5, 1.0), (0.0, 0.0, 0.0)  # constant normal maps that give the mesh's normals


class MaterialXSurface:
    """Maps the inputs of one surface shader to a material.

    Args:
        name: of its model, in `MODELS`.
        values: its inputs.
    """

    def __init__(self, name: str, values: SurfaceInputs) -> None:
        self._path = values.path
        self._model = MODELS[name]
        self._values = values
        self._inputs = values.authored
        self._network = values.network
        self._baker = values.network.baker
        self._report = values.report
        self._uv_set = values.uv_set
        self._extended = ExtendedSurface(name.removesuffix("_100"), self._model, values)

    def material(self, name: str, prim_path: str) -> Material:
        """Return the material with a name and path."""
        model = self._model
        normal = self._normal()  # first: tangents are those of the first uv set, which must be the normal map's
        color = self._values.product(model.base, model.color)
        lobes, roughness = self._extended.lobes(color, self._values.signal(model.roughness))
        if lobes is not None and lobes.translucency != 0.0:
            color = self._extended.sheet_color(color)
        else:
            color = self._with_subsurface(color)
        color = self._extended.metal_color(color)
        emissive = self._extended.emission_above_coat(self._values.product(model.emission, model.emissive))
        opacity, mode = self._opacity()
        self._report_unsupported()
        return Material(
            name=name,
            diffuse_color=self._values.color_input(color, "base_color"),
            emissive_color=self._values.color_input(emissive, "emission"),
            metallic=self._values.float_input(self._values.signal(model.metallic), "metallic"),
            roughness=self._values.float_input(roughness, "roughness"),
            clearcoat=self._values.float_input(self._values.signal(model.coat), "coat"),
            clearcoat_roughness=self._values.float_input(self._values.signal(model.coat_roughness), "coat_roughness"),
            opacity=opacity,
            opacity_mode=mode,
            opacity_threshold=self._threshold(),
            ior=self._ior(),
            normal=normal,
            prim_path=prim_path,
            lobes=lobes,
        )

    def _with_subsurface(self, color: Signal) -> Signal:
        """Return the base color mixed with that of light scattered below the surface, which is drawn as diffuse."""
        weight = self._values.mean(self._model.subsurface)
        if weight <= 0.0:
            return color
        self._report.omission(self._path, "subsurface scattering is drawn as diffuse reflection of its color")
        below = self._values.signal(self._model.subsurface_color)
        if weight >= 1.0:
            return below
        return self._baker.apply(lambda a, b: a + (b - a) * weight, color.of_width(3), below.of_width(3))

    def _opacity(self) -> tuple[FloatInput, Literal["transparent", "presence", "transmission"]]:
        """Return the opacity: presence of the surface, else what is not transmitted."""
        presence = self._values.signal(self._model.opacity)
        if self._model.opacity[0] == "alpha" and (self._values.number("alpha_mode", 0.0) == 0.0 or self._is_unmasked()):
            presence = number(1.0)  # of gltf_pbr: opaque
        if presence.width > 1:  # a color; its luminance, as in MaterialX's graphs
            is_gray, color = self._baker.is_gray(presence), presence.of_width(3)
            presence = color.select([0]) if is_gray else self._baker.apply(lambda a: a @ LUMINANCE[:, None], color)
        textured = self._values.signal(self._model.transmission)
        if textured.constant is None and presence.constant is not None:
            if presence.constant[0] < 1.0:
                self._report.omission(self._path, "the surface is transmissive, not partly absent as well")
            solid = self._baker.affine(textured.of_width(1), -1.0, 1.0)
            return self._values.float_input(solid, "transmission"), "transmission"
        transmission = self._values.mean(self._model.transmission)
        if presence.constant is not None and presence.constant[0] >= 1.0:
            return 1.0 - min(max(transmission, 0.0), 1.0), "transparent"
        if transmission > 0.0:
            self._report.omission(self._path, "transmission of a surface that is partly absent is not drawn")
        is_preview = self._model is MODELS["UsdPreviewSurface"]
        return self._values.float_input(presence, "opacity"), opacity_mode(self._inputs) if is_preview else "presence"

    def _is_unmasked(self) -> bool:
        """Return whether a surface of gltf_pbr transmits light, and its mask cuts nothing out."""
        alpha, transmission = (self._values.signal(each) for each in (self._model.opacity, self._model.transmission))
        above = alpha.constant is not None and alpha.constant[0] >= self._values.number("alpha_cutoff", 0.5)
        return bool(not transmission.is_zero and above and self._values.number("alpha_mode", 0.0) == 1.0)

    def _threshold(self) -> float:
        if self._values.number("alpha_mode", 0.0) == 1.0:  # of gltf_pbr
            return 0.0 if self._is_unmasked() else self._values.number("alpha_cutoff", 0.5)
        return self._values.number("opacityThreshold", 0.0)  # of UsdPreviewSurface

    def _ior(self) -> float:
        """Return the index of refraction whose reflectance at normal incidence is scaled by the specular weight."""
        ior = self._values.mean(self._model.ior)
        specular = self._values.signal(self._model.specular)
        weight = 1.0 if specular.constant is None else float(specular.constant[0])
        if ior <= 0.0 or not self._values.signal(self._model.transmission).is_zero:
            return ior
        ior = self._extended.ior_below_coat(ior)
        if weight == 1.0:
            return ior
        root = min(abs((ior - 1.0) / (ior + 1.0)) * max(weight, 0.0) ** 0.5, 0.999)
        return float((1.0 + root) / (1.0 - root))

    def _normal(self) -> TextureLookup | None:
        """Return the normal map; None for none."""
        connection = self._inputs.get(self._model.normal)
        source = None if connection is None else connection.source
        if connection is None or source is None:
            return None
        if is_geometric(source.id):
            return None
        category, strength, path = category_of(source.id), np.ones(2), source.shader.GetPath()
        if category not in _NORMALS:
            text = f"MaterialX node {source.id!r} is not supported as a normal; the mesh's normals are used"
            self._report.omission(path, text)
            return None
        if category in ("normalmap", "bump"):
            inputs = connections_of(source.shader, self._network.time)
            if "space" in inputs and inputs["space"].value not in ("", "tangent"):
                text = "a normal map in another space than that of tangents is not applied; the mesh's normals are used"
                self._report.omission(path, text)
                return None
            self._report_frame(inputs, path)
            if category == "normalmap":
                strength = self._network.numbers(inputs, "scale", (1.0, 1.0))
        signal = self._network.output(source).of_width(3)
        if signal.constant is not None:
            if not any(np.allclose(signal.constant, each, atol=0.01) for each in _FLAT):
                self._report.omission(path, "a constant normal other than (0.5, 0.5, 1) is not applied")
            return None
        mapped = signal if (signal.bias < 0.0).any() else self._baker.affine(signal, 2.0, -1.0)  # within -1..1
        if (strength != 1.0).any():
            mapped = self._baker.affine(mapped, (*strength, 1.0))
        found = self._baker.lookup(mapped, 3, "normal", self._uv_set)
        return found if isinstance(found, TextureLookup) else None

    def _report_frame(self, inputs: Mapping[str, ShaderConnection], path: Sdf.Path) -> None:
        """Report a normal map around another normal or along other tangents than the mesh's."""
        sources = {name: inputs[name].source for name in ("normal", "tangent", "bitangent") if name in inputs}
        names = [name for name, source in sources.items() if source is not None and not is_geometric(source.id)]
        if names:
            self._report.omission(path, f"{' and '.join(names)} of a normal map are not applied; the mesh's are used")

    def _report_unsupported(self) -> None:
        """Report inputs that have an effect and no counterpart."""
        found = []
        for name, neutral in self._model.unsupported.items():
            if not self._values.gives(name):
                continue
            signal = self._values.signal((name, neutral))
            if signal.constant is None or not np.allclose(signal.constant, neutral):
                found.append(name)
        if found:
            self._report.omission(self._path, f"MaterialX inputs that are not applied: {', '.join(found)}")
        if "displacement" in self._inputs:
            self._report.omission(self._path, "displacement is not applied")
