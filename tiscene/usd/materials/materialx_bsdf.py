# SPDX-License-Identifier: Apache-2.0
"""MaterialX surfaces (ND_surface) of one BSDF, or of emission alone, as inputs of OpenPBR, which has the same lobes.

Blender writes its Diffuse, Glossy, Glass and Emission shaders so. Layers and mixtures of BSDFs are not read.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Usd, UsdShade

from tiscene.usd.core.shader_network import ShaderConnection, Source, connections_of

OPENPBR = "ND_open_pbr_surface_surfaceshader"
_DIFFUSE = ("ND_oren_nayar_diffuse_bsdf", "ND_burley_diffuse_bsdf")

Inputs = dict[str, ShaderConnection]


def openpbr_inputs(surface: UsdShade.Shader, time: Usd.TimeCode) -> Inputs | None:
    """Return the inputs of OpenPBR that stand for a surface's BSDF and emission; None if nothing does."""
    inputs = _given(connections_of(surface, time))
    bsdf, edf = inputs.get("bsdf"), inputs.get("edf")
    some = bsdf or edf
    if some is None:
        return None
    found = {"base_weight": _constant(some, 0.0), "specular_weight": _constant(some, 0.0)}
    if bsdf is not None:
        lobe = _lobe(bsdf, time)
        if lobe is None:
            return None
        found |= lobe
    if edf is not None:
        if edf.source is None or edf.source.id != "ND_uniform_edf":
            return None
        found["emission_luminance"] = _constant(edf, 1.0)
        found |= _renamed(_given(connections_of(edf.source.shader, time)), {"color": "emission_color"})
    return found | _renamed(inputs, {"opacity": "geometry_opacity", "thin_walled": "geometry_thin_walled"})


def _lobe(bsdf: ShaderConnection, time: Usd.TimeCode) -> Inputs | None:
    """Return the inputs that stand for a BSDF; None for one that is not read."""
    if bsdf.source is None:
        return None
    kind, inputs = bsdf.source.id, _given(connections_of(bsdf.source.shader, time))
    found = _renamed(inputs, {"normal": "geometry_normal"})
    if kind in _DIFFUSE:
        names = {"color": "base_color", "weight": "base_weight", "roughness": "base_diffuse_roughness"}
        return {"base_weight": _constant(bsdf, 1.0)} | found | _renamed(inputs, names)
    roughness, weight = _roughness(inputs, time), inputs.get("weight")
    if roughness is None or (weight is not None and weight.value != 1.0):
        return None
    found |= {"specular_weight": _constant(bsdf, 1.0), "specular_roughness": roughness}
    if kind == "ND_dielectric_bsdf" and _value(inputs, "scatter_mode") == "RT":
        found["transmission_weight"] = _constant(bsdf, 1.0)
        return found | _renamed(inputs, {"ior": "specular_ior", "tint": "transmission_color"})
    source = None if "ior" not in inputs else inputs["ior"].source
    if kind == "ND_conductor_bsdf" and source is not None and source.id == "ND_artistic_ior":
        found |= {"base_weight": _constant(bsdf, 1.0), "base_metalness": _constant(bsdf, 1.0)}
        return found | _renamed(_given(connections_of(source.shader, time)), {"reflectivity": "base_color"})
    return None


def _roughness(inputs: Inputs, time: Usd.TimeCode) -> ShaderConnection | None:
    """Return the roughness whose square is a BSDF's two alphas; None where they are computed or differ."""
    alphas = inputs.get("roughness")
    source: Source | None = None if alphas is None else alphas.source
    if source is not None and source.id == "ND_roughness_anisotropy":
        above = _given(connections_of(source.shader, time))
        return above.get("roughness") if _value(above, "anisotropy", 0.0) == 0.0 else None
    values = np.ravel(0.0 if alphas is None or alphas.value is None else alphas.value)
    if alphas is None or source is not None or (values != values[0]).any():
        return None
    return _constant(alphas, math.sqrt(max(values[0], 0.0)))


def _given(inputs: Inputs) -> Inputs:
    """Return the inputs without those that are declared and have no value."""
    return {name: each for name, each in inputs.items() if each.source is not None or each.value is not None}


def _renamed(inputs: Inputs, names: dict[str, str]) -> Inputs:
    return {new: inputs[old] for old, new in names.items() if old in inputs}


def _constant(connection: ShaderConnection, value: float) -> ShaderConnection:
    return replace(connection, value=value, source=None)


def _value(inputs: Inputs, name: str, default: Any = None) -> Any:
    return inputs[name].value if name in inputs else default
