# SPDX-License-Identifier: Apache-2.0
"""Color spaces that attributes name, and their conversion to linear Rec. 709, in which the renderer computes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd

from tiscene.scene.color import decode_srgb

SRGB, LINEAR = "srgb_rec709_scene", "lin_rec709_scene"
_NAMES = {  # of MaterialX, by those of USD
    "acescg": "lin_ap1_scene",
    "lin_ap1": "lin_ap1_scene",
    "g22_ap1": "g22_ap1_scene",
    "g18_rec709": "g18_rec709_scene",
    "g22_rec709": "g22_rec709_scene",
    "rec709_display": "g24_rec709_scene",
    "adobergb": "g22_adobergb_scene",
    "lin_adobergb": "lin_adobergb_scene",
    "srgb_displayp3": "srgb_p3d65_scene",
    "lin_displayp3": "lin_p3d65_scene",
    **dict.fromkeys(("raw", "data", "identity", "unknown"), LINEAR),
}


def color_space(name: str) -> str:
    """Return USD's name of a color space of USD or MaterialX. Others are sRGB by their name, else linear Rec. 709."""
    lower = name.lower()
    known = _NAMES.get(lower, lower)
    if Gf.ColorSpace.IsValid(known):
        return known
    return SRGB if "srgb" in lower and "lin" not in lower else LINEAR


def to_linear_rec709(colors: NDArray[Any], space: str) -> NDArray[Any]:
    """Return colors [..., 3] of a space, by USD's name, as linear Rec. 709. White stays white; none is below 0."""
    if space == LINEAR:
        return colors
    if space == SRGB:
        return decode_srgb(colors)
    gamma, has_linear_part, matrix = _conversion(space)
    if has_linear_part:
        colors = decode_srgb(colors)
    elif gamma != 1.0:
        colors = np.where(colors > 0.0, np.abs(colors) ** gamma, colors)
    return np.asarray(np.maximum(colors @ matrix.astype(colors.dtype), 0.0))


def attribute_colors(attribute: Usd.Attribute, colors: NDArray[Any]) -> NDArray[Any]:
    """Return an attribute's colors [..., 3 or more] as linear Rec. 709, from its own color space or its prim's.

    A space of ColorSpaceAPI, which prims inherit, holds for attributes of a color type.
    """
    name = str(Usd.ColorSpaceAPI.ComputeColorSpaceName(attribute, None))
    is_color = attribute.HasAuthoredMetadata("colorSpace") or attribute.GetTypeName().role == "Color"
    space = color_space(name) if name and is_color else LINEAR
    if space == LINEAR or colors.shape[-1] < 3:
        return colors
    return np.concatenate([to_linear_rec709(colors[..., :3], space), colors[..., 3:]], axis=-1)


@cache
def _conversion(space: str) -> tuple[float, bool, NDArray[np.float64]]:
    """Return a space's gamma, whether it is linear near 0 as sRGB is, and the matrix for row vectors [3, 3]."""
    source, target = Gf.ColorSpace(space), Gf.ColorSpace(LINEAR)
    rows = [list(target.Convert(source, Gf.Vec3f(*row)).GetRGB()) for row in np.eye(3).tolist()]
    return round(source.GetGamma(), 4), source.GetLinearBias() > 0.0, np.array(rows)
