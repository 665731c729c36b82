# SPDX-License-Identifier: Apache-2.0
"""The inputs of MaterialX surface models that UsdPreviewSurface lacks, as `ExtendedLobes`.

Sources: the definitions of standard_surface, open_pbr_surface and gltf_pbr in MaterialX 1.39, the OpenPBR 1.1
specification, and the glTF extensions KHR_materials_sheen, anisotropy, volume, specular and transmission. The models
measure anisotropy differently; all are turned into that of OpenPBR: the ratio of the alphas, and the mean of their
squares.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Color, ExtendedLobes
from tiscene.usd.materials.materialx_inputs import SurfaceInputs
from tiscene.usd.materials.materialx_models import Named, SurfaceModel
from tiscene.usd.materials.materialx_nodes import is_geometric
from tiscene.usd.materials.materialx_signal import Signal, number
from tiscene.usd.materials.materialx_units import meters_per_unit

Array = NDArray[Any]
_WHITE, _BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
_NEUTRAL = ExtendedLobes()


class ExtendedSurface:
    """Maps the further inputs of one surface shader.

    Args:
        model: name of its model.
        names: names and defaults of the model's inputs.
        values: its inputs.
    """

    def __init__(self, model: str, names: SurfaceModel, values: SurfaceInputs) -> None:
        self._model, self._names, self._values = model, names, values
        self._apply = values.network.baker.apply

    def lobes(self, base: Signal, roughness: Signal) -> tuple[ExtendedLobes | None, Signal]:
        """Return the lobes, None where none has an effect, and the roughness that they need.

        Args:
            base: base color.
            roughness: of the specular lobe, as authored.
        """
        names, values = self._names, self._values
        found: dict[str, Any] = {}
        self._add_specular(found)
        self._add_transmission(found, base)
        self._add_sheen(found)
        self._add_coat(found, base)
        strength = values.signal(names.anisotropy)
        if strength.constant is None or strength.constant[0] != 0.0:
            roughness = self._add_anisotropy(found, strength, roughness)
        lobes = ExtendedLobes(**found)
        return (None if lobes == _NEUTRAL else lobes), roughness

    def metal_color(self, base: Signal) -> Signal:
        """Return the base color times the specular weight, where it is that of metal: OpenPBR's weight scales both."""
        names, values = self._names, self._values
        if self._model != "ND_open_pbr_surface_surfaceshader" or not self._differs(names.specular, 1.0):
            return base
        if not self._differs(names.metallic, 0.0):
            return base
        weights = (values.signal(each).of_width(1) for each in (names.metallic, names.specular))
        factor = self._apply(lambda metal, weight: 1.0 + metal * (weight - 1.0), *weights)
        return values.network.baker.product(factor, base)

    def sheet_color(self, base: Signal) -> Signal:
        """Return the color that a translucent sheet reflects, before what passes is taken off.

        standard_surface transmits the fraction `subsurface`. OpenPBR scatters it, half to each side.
        """
        names, values = self._names, self._values
        if self._model != "ND_open_pbr_surface_surfaceshader":
            return base
        weight, below = values.signal(names.subsurface), values.signal(names.subsurface_color).of_width(3)
        return self._apply(
            lambda color, inner, part: (color * (1.0 - part) + 0.5 * part * inner) / (1.0 - 0.5 * part),
            *(base.of_width(3), below, weight),
        )

    def emission_above_coat(self, emission: Signal) -> Signal:
        """Return the light that a coat of standard_surface or OpenPBR lets out, as at normal incidence."""
        names, values = self._names, self._values
        if emission.is_zero or not names.coat_color[0] or not self._differs(names.coat, 0.0):
            return emission
        ior = self._coat_ior()
        passing = 1.0 - ((ior - 1.0) / (ior + 1.0)) ** 2
        color, weight = values.signal(names.coat_color).of_width(3), values.signal(names.coat).of_width(1)
        factor = self._apply(lambda a, b: 1.0 + b * (passing * a - 1.0), color, weight)
        return values.network.baker.product(factor, emission)

    def ior_below_coat(self, ior: float) -> float:
        """Return the index of refraction of the base: below OpenPBR's coat, relative to the coat's, and 1 or more.

        Args:
            ior: of the base, above 0.
        """
        coat = self._names.coat
        if not self._differs(coat, 0.0) or self._model != "ND_open_pbr_surface_surfaceshader":
            return ior
        weight = float(self._values.network.baker.mean(self._values.signal(coat))[0])
        ratio = ior / self._coat_ior()
        return ior + (max(ratio, 1.0 / ratio) - ior) * weight

    def _coat_ior(self) -> float:
        return max(self._values.mean(self._names.coat_ior), 1.0)

    def _differs(self, named: Named, neutral: Any) -> bool:
        """Return whether an input is authored and has an effect."""
        if not self._values.gives(named[0]):
            return not np.allclose(named[1], neutral)
        signal = self._values.signal(named)
        return signal.constant is None or not bool(np.allclose(signal.constant, neutral))

    def _report_connected(self, name: str, instead: str) -> None:
        """Report an input that is not applied, if it is connected to anything but the mesh's own."""
        values = self._values
        source = values.authored[name].source if name in values.authored else None
        if source is not None and not is_geometric(source.id):
            values.report.omission(values.path, f"{name} is not applied; {instead}")

    def _color(self, named: Named) -> Color:
        r, g, b = np.resize(self._values.constant(named), 3).tolist()
        return (r, g, b)

    def _add_specular(self, found: dict[str, Any]) -> None:
        names, values = self._names, self._values
        if values.signal(names.specular).constant is None:
            found["specular"] = values.float_input(values.signal(names.specular), "specular")
        if not self._differs(names.specular_color, _WHITE):
            return
        metal = values.signal(names.metallic)
        if self._model != "ND_gltf_pbr_surfaceshader" and (metal.constant is None or metal.constant[0] > 0.0):
            text = f"{names.specular_color[0]} is not applied to metal"
            values.report.omission(values.path, text)
        if metal.constant is None or metal.constant[0] < 1.0:
            found["specular_tint"] = values.color_input(values.signal(names.specular_color), "specular_color")

    def _add_transmission(self, found: dict[str, Any], base: Signal) -> None:
        names, values = self._names, self._values
        is_thin = bool(values.constant(names.thin)[0] > 0.5)
        transmits = self._differs(names.transmission, 0.0)
        if names.thickness[0] and transmits:
            is_thin = not self._differs(names.thickness, 0.0)
        if is_thin and self._differs(names.subsurface, 0.0):
            self._add_translucency(found)
        if not transmits:
            return
        found["thin_walled"] = is_thin
        tint = base if names.tint[0] == "base_color" else values.signal(names.tint)
        named, depth = names.attenuation, names.distance
        if not is_thin and values.constant(names.depth)[0] > 0.0:
            named, depth, tint = names.tint, names.depth, number(*_WHITE)
        if not is_thin:
            found["absorption"] = self._absorption(self._color(named), self._meters_of(depth))
        if tint.constant is None or not np.allclose(tint.constant, 1.0):
            found["transmission_color"] = values.color_input(tint, "transmission_color")

    def _absorption(self, color: Color, depth: float) -> Color:
        """Return coefficients, 1/m, by which a color remains at a depth, meters; 0: nothing is absorbed."""
        if depth <= 0.0:
            return _BLACK
        r, g, b = (-math.log(min(max(each, 1e-4), 1.0)) / depth + 0.0 for each in color)
        return (r, g, b)

    def _meters_of(self, distance: Named) -> float:
        """Return a distance in meters: in its own unit if it names one, else in scene units."""
        given = self._values.authored.get(distance[0])
        unit = 1.0 if given is None else meters_per_unit(given.attribute)
        return float(self._values.constant(distance)[0]) * unit

    def _add_translucency(self, found: dict[str, Any]) -> None:
        """Add the subsurface scattering of a sheet: diffuse light that passes it (half of it, in OpenPBR)."""
        names, values = self._names, self._values
        weight = values.signal(names.subsurface)
        if self._model == "ND_open_pbr_surface_surfaceshader":
            weight = values.network.baker.affine(weight, 0.5)
        found["translucency"] = values.float_input(weight, "subsurface")
        found["translucent_color"] = values.color_input(values.signal(names.subsurface_color), "subsurface_color")

    def _add_coat(self, found: dict[str, Any], base: Signal) -> None:
        """Add the coat's color, which holds what the base loses as well, and index of refraction."""
        names, values = self._names, self._values
        if not self._differs(names.coat, 0.0):
            return
        self._report_connected(names.coat_normal, "the coat has the surface's normal")
        color = values.signal(names.coat_color)
        found["coat_ior"] = self._coat_ior()
        if self._differs(names.coat_darkening, 0.0):
            color = self._darkened(color, base, found["coat_ior"])
        if color.constant is None or not np.allclose(color.constant, 1.0):
            found["coat_color"] = values.color_input(color, "coat_color")

    def _darkened(self, color: Signal, base: Signal, ior: float) -> Signal:
        """Return the color of a coat below which the base looks darker, since the coat reflects light back to it.

        With K, the coat's diffuse reflectance from inside, and E, the base's reflectance, the base looks darker by the
        factor (1 - K) / (1 - E K), where 1 - K is (1 - F0) / ior² (OpenPBR 1.1, as in MaterialX's graph). That and the
        coat's color are factors by the coat's weight, each; `ExtendedLobes` has one for both.
        """
        names = self._names
        passing = (1.0 - ((ior - 1.0) / (ior + 1.0)) ** 2) / ior**2

        def one_factor(color: Array, reflectance: Array, weight: Array, strength: Array) -> Array:
            darker = strength * (passing / (1.0 - reflectance * (1.0 - passing)) - 1.0)
            return np.clip(color + darker * (1.0 + weight * (color - 1.0)), 0.0, 1.0)

        weights = (self._values.signal(each).of_width(1) for each in (names.coat, names.coat_darkening))
        return self._apply(one_factor, color.of_width(3), self._base_reflectance(base), *weights)

    def _base_reflectance(self, base: Signal) -> Signal:
        """Return the estimate of the base's reflectance that OpenPBR's darkening takes."""
        names, values = self._names, self._values

        def mixed(base: Array, inner: Array, below: Array, metallic: Array, specular: Array) -> Array:
            dielectric = base + (inner - base) * below
            return np.asarray(np.clip(dielectric + (base * specular - dielectric) * metallic, 0.0, 1.0))

        inner = values.signal(names.subsurface_color).of_width(3)
        weights = (values.signal(each).of_width(1) for each in (names.subsurface, names.metallic, names.specular))
        return self._apply(mixed, base.of_width(3), inner, *weights)

    def _add_sheen(self, found: dict[str, Any]) -> None:
        names, values = self._names, self._values
        if not self._differs(names.sheen, 0.0):
            return
        color = values.product(names.sheen, names.sheen_color)
        if color.is_zero:
            return
        found["sheen_color"] = values.color_input(color, "sheen_color")
        roughness = values.signal(names.sheen_roughness)
        if self._model == "ND_gltf_pbr_surfaceshader":  # whose alpha is the square
            roughness = self._apply(lambda value: value * value, roughness)
        found["sheen_roughness"] = values.float_input(roughness, "sheen_roughness")

    def _add_anisotropy(self, found: dict[str, Any], strength: Signal, roughness: Signal) -> Signal:
        """Add the ratio of the alphas and their direction; return the roughness of the mean of their squares."""
        names, values = self._names, self._values
        self._report_connected(names.tangent, "the direction of u is used")
        ratio, mean = _ALPHAS[self._model]
        operands = (strength.of_width(1), roughness.of_width(1))
        found["anisotropy"] = values.float_input(self._apply(ratio, *operands), "anisotropy")
        if self._differs(names.rotation, 0.0):
            turned = values.network.baker.affine(values.signal(names.rotation), names.turns)
            found["rotation"] = values.float_input(turned, "rotation")
        return roughness if mean is None else self._apply(mean, *operands)


def _gltf_alphas(strength: Array, roughness: Array) -> tuple[Array, Array]:
    alpha = roughness * roughness
    return alpha + (1.0 - alpha) * strength * strength, alpha


def _gltf_ratio(strength: Array, roughness: Array) -> Array:
    along, across = _gltf_alphas(strength, np.maximum(roughness, 0.03))
    return np.asarray(1.0 - across / along)


def _gltf_mean(strength: Array, roughness: Array) -> Array:
    along, across = _gltf_alphas(strength, roughness)
    return np.asarray((0.5 * (along**2 + across**2)) ** 0.25)


def _standard_mean(strength: Array, roughness: Array) -> Array:
    """With q = 1 - strength, the alphas are roughness² over and times the root of q; they are 1 at most."""
    q = 1.0 - np.clip(strength, 0.0, 0.98)
    along = np.minimum(roughness**2 / np.sqrt(q), 1.0)
    return np.asarray((0.5 * (along**2 + roughness**4 * q)) ** 0.25)


def _standard_ratio(strength: Array, roughness: Array) -> Array:
    q = 1.0 - np.clip(strength, 0.0, 0.98)
    along = np.minimum(np.maximum(roughness, 1e-3) ** 2 / np.sqrt(q), 1.0)
    return np.asarray(1.0 - np.maximum(roughness, 1e-3) ** 2 * np.sqrt(q) / along)


# Of each model: functions (strength, roughness) that return 1 - alpha_y / alpha_x and the roughness of the mean of the
# squares; None: the roughness as it is.
_ALPHAS: dict[str, tuple[Any, Any]] = {
    "ND_standard_surface_surfaceshader": (_standard_ratio, _standard_mean),
    "ND_open_pbr_surface_surfaceshader": (
        lambda strength, roughness: np.clip(strength, 0.0, 1.0) + 0.0 * roughness,
        None,
    ),
    "ND_gltf_pbr_surfaceshader": (_gltf_ratio, _gltf_mean),
}
