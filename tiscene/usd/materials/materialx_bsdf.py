# SPDX-License-Identifier: Apache-2.0
"""Networks of BSDFs and EDFs of a MaterialX surface (ND_surface) as lists of weighted lobes.

`mix`, `add`, `multiply` and `layer` become weights of the lobes below them. `materialx_folding` turns the lobes into
one material.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdShade

from tiscene.usd.core.shader_network import ShaderConnection, Source, connections_of
from tiscene.usd.materials.materialx_network import MaterialXNetwork
from tiscene.usd.materials.materialx_signal import Signal, number

Inputs = dict[str, ShaderConnection]
Kind = Literal["diffuse", "sheet", "metal", "glass", "refraction", "schlick", "gloss", "coat", "sheen", "emission"]

SURFACES = ("ND_surface", "ND_surface_surfaceshader")  # the latter of documents that name no definition
OPAQUE: tuple[Kind, ...] = ("diffuse", "sheet", "metal", "glass", "refraction", "schlick")  # hide what is below them
_LEAVES: dict[str, tuple[Kind, Any]] = {  # of an id: kind of lobe; default color
    "ND_oren_nayar_diffuse_bsdf": ("diffuse", (0.18, 0.18, 0.18)),
    "ND_burley_diffuse_bsdf": ("diffuse", (0.18, 0.18, 0.18)),
    "ND_subsurface_bsdf": ("diffuse", (0.18, 0.18, 0.18)),
    "ND_translucent_bsdf": ("sheet", (1.0, 1.0, 1.0)),
    "ND_conductor_bsdf": ("metal", (1.0, 1.0, 1.0)),
    "ND_dielectric_bsdf": ("gloss", (1.0, 1.0, 1.0)),
    "ND_generalized_schlick_bsdf": ("schlick", (1.0, 1.0, 1.0)),
    "ND_sheen_bsdf": ("sheen", (1.0, 1.0, 1.0)),
    "ND_uniform_edf": ("emission", (1.0, 1.0, 1.0)),
    "ND_conical_edf": ("emission", (1.0, 1.0, 1.0)),
    "ND_measured_edf": ("emission", (1.0, 1.0, 1.0)),
}
_BRANCHES = {  # of an id: inputs that are BSDFs or EDFs
    **{f"ND_mix_{kind}": ("bg", "fg") for kind in ("bsdf", "edf")},
    **{f"ND_add_{kind}": ("in1", "in2") for kind in ("bsdf", "edf")},
    **{f"ND_multiply_{kind}": ("in1",) for kind in ("bsdf", "edf")},
    "ND_layer_bsdf": ("top", "base"),
    "ND_layer_vdf": ("top", "base"),
    "ND_generalized_schlick_edf": ("base",),
}
_MEDIA = ("ND_anisotropic_vdf", "ND_absorption_vdf")
_MAX_DEPTH = 64
_TRANSMISSION: dict[Any, Kind] = {"RT": "glass", "T": "refraction"}
_GOLD = (0.183, 0.421, 1.373), (3.424, 2.346, 1.770)  # MaterialX's default index of refraction and extinction


@dataclass(frozen=True, eq=False)
class WeightedLobe:
    """A BSDF or EDF without others below it.

    Attributes:
        kind: what it does.
        weight: its factor, which is its share of the surface as well.
        color: its color, with the factors that are no share.
        roughness: of the microfacets, the sheen or the diffuse reflection.
        ior: index of refraction of a dielectric.
        normal: its authored normal.
    """

    kind: Kind
    weight: Signal
    color: Signal
    roughness: Signal
    ior: Signal
    normal: ShaderConnection | None = None


def unknown_part(surface: UsdShade.Shader, time: Usd.TimeCode) -> str | None:
    """Return the id of the first BSDF or EDF of a surface that is not known; its own if it has none; None: no such."""
    inputs = connections_of(surface, time)
    sources = [each for name in ("bsdf", "edf") if name in inputs and (each := inputs[name].source) is not None]
    if not sources:
        return str(surface.GetShaderId())
    return next((name for each in sources if (name := _unknown(each, time, 0)) is not None), None)


def _unknown(source: Source, time: Usd.TimeCode, depth: int) -> str | None:
    node = _definition(source)
    if node in (*_LEAVES, *_MEDIA):
        return None
    if node not in _BRANCHES or depth > _MAX_DEPTH:
        return source.id
    inputs = connections_of(source.shader, time)
    sources = [each for name in _BRANCHES[node] if name in inputs and (each := inputs[name].source) is not None]
    if not sources:
        return source.id
    return next((name for each in sources if (name := _unknown(each, time, depth + 1)) is not None), None)


def _definition(source: Source) -> str:
    """Return the id of a node's definition: "ND_mix_bsdf" of "ND_mix_BSDF", which documents are read as."""
    name = source.id
    for kind in ("bsdf", "edf", "vdf"):
        name = name.removesuffix(f"_{kind.upper()}") if name.endswith(f"_{kind}_{kind.upper()}") else name
        name = name.replace(f"_{kind.upper()}", f"_{kind}")
    return name.removesuffix("F").removesuffix("C") if name.startswith("ND_multiply_") else name


class LobeReader:
    """Reads the lobes of a surface.

    Args:
        network: evaluates the inputs of the BSDFs.
        time: when to read them.

    Attributes:
        notes: what is not applied, each once.
    """

    def __init__(self, network: MaterialXNetwork, time: Usd.TimeCode) -> None:
        self.notes: dict[str, None] = {}
        self._network, self._baker, self._time = network, network.baker, time

    def lobes(self, connection: ShaderConnection | None) -> list[WeightedLobe]:
        """Return the lobes of an input of BSDFs or EDFs; those without weight are left out."""
        source = None if connection is None else connection.source
        if source is None:
            return []
        node, inputs = _definition(source), given(connections_of(source.shader, self._time))
        if node in _MEDIA:
            if not all(self._value(inputs, name, 0.0).is_zero for name in ("absorption", "scattering")):
                self.notes["media inside are left out"] = None
            return []
        if node in _LEAVES:
            weight = self._value(inputs, "weight", 1.0).of_width(1)
            return [] if weight.is_zero else [self._leaf(node, inputs, weight)]
        if node.startswith("ND_mix"):
            weight = self._apply(lambda value: np.clip(value, 0.0, 1.0), self._value(inputs, "mix", 0.0).of_width(1))
            factors = {"bg": self._baker.affine(weight, -1.0, 1.0), "fg": weight}
            parts = {name: factor for name, factor in factors.items() if not factor.is_zero}
            return [x for name, factor in parts.items() for x in self._scaled(self.lobes(inputs.get(name)), factor)]
        first, *others = (self.lobes(inputs.get(name)) for name in _BRANCHES[node])
        if node.startswith("ND_add"):
            return first + others[0]
        if node.startswith("ND_multiply"):
            factor = self._value(inputs, "in2", 1.0)
            return self._scaled(first, factor) if factor.width == 1 else self._colored(first, factor)
        if node.startswith("ND_layer"):
            return self._layered(first, others[0])
        self.notes["emission is uniform"] = None
        return self._colored(first, self._value(inputs, "color0", (1.0, 1.0, 1.0)))

    def _layered(self, top: Sequence[WeightedLobe], base: list[WeightedLobe]) -> list[WeightedLobe]:
        """Return lobes over others: a gloss over what has one is a coat, and what is opaque hides the base."""
        over = [self._as_gloss(each) for each in top]
        opaque = [each.weight for each in over if each.kind in OPAQUE]
        if opaque:
            base = self._scaled(base, self._apply(lambda *parts: np.clip(1.0 - sum(parts), 0.0, 1.0), *opaque))
        if any(each.kind in ("metal", "glass", "schlick", "gloss") for each in base):
            over = [replace(each, kind="coat") if each.kind == "gloss" else each for each in over]
        return over + base

    def _as_gloss(self, lobe: WeightedLobe) -> WeightedLobe:
        """Return a reflectance by its color at normal incidence as that of an index of refraction with a tint."""
        if lobe.kind != "schlick":
            return lobe
        most = min(max(self._baker.largest(lobe.color), 1e-6), 0.998)
        root = most**0.5
        color = self._baker.affine(lobe.color, 1.0 / most)
        return replace(lobe, kind="gloss", color=color, ior=number((1.0 + root) / (1.0 - root)))

    def _leaf(self, node: str, inputs: Inputs, weight: Signal) -> WeightedLobe:
        kind, default = _LEAVES[node]
        name = {"ND_dielectric_bsdf": "tint", "ND_generalized_schlick_bsdf": "color0"}.get(node, "color")
        color = self._conductor(inputs) if kind == "metal" else self._value(inputs, name, default).of_width(3)
        ior = self._value(inputs, "ior", 1.5) if kind == "gloss" else number(1.5)
        if kind in ("metal", "schlick", "gloss"):
            roughness = self._microfacets(inputs)
            if not self._value(inputs, "thinfilm_thickness", 0.0).is_zero:
                self.notes["thin films are left out"] = None
        else:
            roughness = self._value(inputs, "roughness", 0.3 if kind == "sheen" else 0.0)
        if node in ("ND_dielectric_bsdf", "ND_generalized_schlick_bsdf") and "scatter_mode" in inputs:
            kind = _TRANSMISSION.get(inputs["scatter_mode"].value, kind)
        if node == "ND_subsurface_bsdf":
            self.notes["subsurface scattering is drawn as diffuse reflection of its color"] = None
        if node in ("ND_conical_edf", "ND_measured_edf"):
            self.notes["emission is uniform"] = None
        return WeightedLobe(kind, weight, color, roughness.of_width(1), ior.of_width(1), inputs.get("normal"))

    def _conductor(self, inputs: Inputs) -> Signal:
        """Return the reflectance of a metal at normal incidence."""
        source = inputs["ior"].source if "ior" in inputs else None
        if source is not None and source.id.startswith("ND_artistic_ior"):
            above = given(connections_of(source.shader, self._time))
            return self._value(above, "reflectivity", (0.944, 0.776, 0.373)).of_width(3)

        def reflectance(n: NDArray[Any], k: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(((n - 1.0) ** 2 + k * k) / ((n + 1.0) ** 2 + k * k))

        operands = self._value(inputs, "ior", _GOLD[0]), self._value(inputs, "extinction", _GOLD[1])
        return self._apply(reflectance, *(each.of_width(3) for each in operands))

    def _microfacets(self, inputs: Inputs) -> Signal:
        """Return the roughness whose square is the mean of the two alphas."""
        source = inputs["roughness"].source if "roughness" in inputs else None
        if source is not None and source.id.startswith("ND_roughness_anisotropy"):
            above = given(connections_of(source.shader, self._time))
            if not self._value(above, "anisotropy", 0.0).is_zero:
                self.notes["anisotropy is left out"] = None
            return self._value(above, "roughness", 0.0)
        if source is not None and source.id.startswith("ND_roughness_dual"):
            above = given(connections_of(source.shader, self._time))
            return self._value(above, "roughness", (0.0, 0.0)).select([0])
        alphas = self._value(inputs, "roughness", (0.05, 0.05)).of_width(2)
        if alphas.constant is not None and alphas.constant[0] != alphas.constant[1]:
            self.notes["anisotropy is left out"] = None
        return self._apply(lambda value: np.sqrt(np.maximum(value.mean(axis=-1, keepdims=True), 0.0)), alphas)

    def _value(self, inputs: Inputs, name: str, default: Any) -> Signal:
        return self._network.value(inputs.get(name), default)

    def _apply(self, function: Callable[..., NDArray[Any]], *operands: Signal) -> Signal:
        return self._baker.apply(function, *operands)

    def _scaled(self, lobes: list[WeightedLobe], factor: Signal) -> list[WeightedLobe]:
        weighted = [replace(each, weight=self._baker.product(factor.of_width(1), each.weight)) for each in lobes]
        return [each for each in weighted if not each.weight.is_zero]

    def _colored(self, lobes: list[WeightedLobe], factor: Signal) -> list[WeightedLobe]:
        return [replace(each, color=self._baker.product(factor.of_width(3), each.color)) for each in lobes]


def given(inputs: Inputs) -> Inputs:
    """Return the inputs without those that are declared and have no value."""
    return {name: each for name, each in inputs.items() if each.source is not None or each.value is not None}
