# SPDX-License-Identifier: Apache-2.0
"""The surface models of MaterialX that are read: standard_surface, open_pbr_surface, gltf_pbr, surface_unlit and
UsdPreviewSurface.

They share most of their inputs with UsdPreviewSurface, under other names and with other defaults.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

Named = tuple[str, Any]  # name and default of an input; the name is "" where the model has no such input
_WHITE, _BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class SurfaceModel:
    """Names and defaults of a model's inputs.

    Attributes:
        base: factor of the base color.
        color: base color.
        metallic: metalness.
        roughness: roughness of the specular lobe.
        ior: index of refraction.
        specular: factor of the specular lobe of dielectrics.
        specular_color: its color.
        anisotropy: of the specular lobe.
        rotation: of its direction.
        turns: rotation in turns for each unit of `rotation`.
        tangent: direction of the anisotropy.
        coat: clearcoat.
        coat_roughness: its roughness.
        coat_color: its color.
        coat_ior: its index of refraction.
        coat_darkening: how much darker the base looks for light that the coat reflects back to it.
        coat_normal: its normal.
        sheen: factor of the sheen's color.
        sheen_color: its color.
        sheen_roughness: its roughness.
        emission: factor of the emitted color.
        emissive: emitted color.
        opacity: presence, a number or a color.
        transmission: fraction of the light that is transmitted.
        tint: color of transmission, for each crossing or at a depth.
        depth: distance at which `tint` remains by absorption; 0: none.
        attenuation: color that remains by absorption at a distance, for models that have both colors.
        distance: that distance.
        thin: whether the surface is a sheet.
        thickness: of the solid; 0: the surface is a sheet.
        subsurface: fraction of the diffuse light that scatters below the surface.
        subsurface_color: its color.
        normal: normal map.
        unsupported: inputs without a counterpart, and the values at which they have no effect.
    """

    base: Named = ("", 1.0)
    color: Named = ("", _BLACK)
    metallic: Named = ("", 0.0)
    roughness: Named = ("", 1.0)
    ior: Named = ("", 1.0)
    specular: Named = ("", 1.0)
    specular_color: Named = ("", _WHITE)
    anisotropy: Named = ("", 0.0)
    rotation: Named = ("", 0.0)
    turns: float = 1.0
    tangent: str = ""
    coat: Named = ("", 0.0)
    coat_roughness: Named = ("", 0.0)
    coat_color: Named = ("", _WHITE)
    coat_ior: Named = ("", 1.5)
    coat_darkening: Named = ("", 0.0)
    coat_normal: str = ""
    sheen: Named = ("", 1.0)
    sheen_color: Named = ("", _BLACK)
    sheen_roughness: Named = ("", 0.0)
    emission: Named = ("", 1.0)
    emissive: Named
    opacity: Named
    transmission: Named = ("", 0.0)
    tint: Named = ("", _WHITE)
    depth: Named = ("", 0.0)
    attenuation: Named = ("", _WHITE)
    distance: Named = ("", 0.0)
    thin: Named = ("", 0.0)
    thickness: Named = ("", 0.0)
    subsurface: Named = ("", 0.0)
    subsurface_color: Named = ("", _WHITE)
    normal: str = ""
    unsupported: Mapping[str, Any] = field(default_factory=dict)


MODELS: dict[str, SurfaceModel] = {
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
            "transmission_scatter": 0.0,
            "transmission_dispersion": 0.0,
            "transmission_extra_roughness": 0.0,
            "coat_anisotropy": 0.0,
            "coat_affect_color": 0.0,
            "coat_affect_roughness": 0.0,
            "thin_film_thickness": 0.0,
        },
        specular_color=("specular_color", _WHITE),
        tint=("transmission_color", _WHITE),
        depth=("transmission_depth", 0.0),
        thin=("thin_walled", 0.0),
        sheen=("sheen", 0.0),
        sheen_color=("sheen_color", _WHITE),
        sheen_roughness=("sheen_roughness", 0.3),
        anisotropy=("specular_anisotropy", 0.0),
        rotation=("specular_rotation", 0.0),
        tangent="tangent",
        coat_normal="coat_normal",
        coat_color=("coat_color", _WHITE),
        coat_ior=("coat_IOR", 1.5),
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
            "transmission_scatter": 0.0,
            "transmission_dispersion_scale": 0.0,
            "coat_roughness_anisotropy": 0.0,
            "thin_film_weight": 0.0,
        },
        specular_color=("specular_color", _WHITE),
        tint=("transmission_color", _WHITE),
        depth=("transmission_depth", 0.0),
        thin=("geometry_thin_walled", 0.0),
        sheen=("fuzz_weight", 0.0),
        sheen_color=("fuzz_color", _WHITE),
        sheen_roughness=("fuzz_roughness", 0.5),
        anisotropy=("specular_roughness_anisotropy", 0.0),
        tangent="geometry_tangent",
        coat_normal="geometry_coat_normal",
        coat_color=("coat_color", _WHITE),
        coat_ior=("coat_ior", 1.6),
        coat_darkening=("coat_darkening", 1.0),
    ),
    "ND_gltf_pbr_surfaceshader": SurfaceModel(
        color=("base_color", _WHITE),
        metallic=("metallic", 1.0),
        roughness=("roughness", 1.0),
        ior=("ior", 1.5),
        specular=("specular", 1.0),
        coat=("clearcoat", 0.0),
        coat_roughness=("clearcoat_roughness", 0.0),
        emission=("emissive_strength", 1.0),
        emissive=("emissive", _BLACK),
        opacity=("alpha", 1.0),
        transmission=("transmission", 0.0),
        normal="normal",
        unsupported={"iridescence": 0.0, "dispersion": 0.0},
        specular_color=("specular_color", _WHITE),
        tint=("base_color", _WHITE),
        sheen_color=("sheen_color", _BLACK),
        sheen_roughness=("sheen_roughness", 0.0),
        anisotropy=("anisotropy_strength", 0.0),
        rotation=("anisotropy_rotation", 0.0),
        tangent="tangent",
        coat_normal="clearcoat_normal",
        turns=0.5 / math.pi,
        attenuation=("attenuation_color", _WHITE),
        distance=("attenuation_distance", 0.0),
        thickness=("thickness", 0.0),
    ),
    "ND_surface_unlit": SurfaceModel(  # emits, and reflects nothing
        emission=("emission", 1.0),
        emissive=("emission_color", _WHITE),
        opacity=("opacity", 1.0),
        transmission=("transmission", 0.0),
        unsupported={"transmission_color": _WHITE},
    ),
    "UsdPreviewSurface": SurfaceModel(
        color=("diffuseColor", (0.18, 0.18, 0.18)),
        metallic=("metallic", 0.0),
        roughness=("roughness", 0.5),
        ior=("ior", 1.5),
        coat=("clearcoat", 0.0),
        coat_roughness=("clearcoatRoughness", 0.01),
        emissive=("emissiveColor", _BLACK),
        opacity=("opacity", 1.0),
        normal="normal",
        unsupported={"useSpecularWorkflow": 0.0},
    ),
}
MODELS["ND_surface_unlit_surfaceshader"] = MODELS["ND_surface_unlit"]  # of documents that name no definition
MODELS["ND_standard_surface_surfaceshader_100"] = replace(  # of version 1.0.0
    MODELS["ND_standard_surface_surfaceshader"], base=("base", 0.8), color=("base_color", _WHITE)
)
