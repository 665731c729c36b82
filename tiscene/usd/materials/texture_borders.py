# SPDX-License-Identifier: Apache-2.0
"""Check for textures that are black because no wrap mode is authored.

UsdUVTexture's wrap modes default to "useMetadata", which is black outside 0..1 for files without wrap metadata. Most
authors do not expect that. `report_borders` names the meshes whose texture coordinates leave 0..1, or UDIM tiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdShade

from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.primvar import array_of, primvar_topology, read_uv

_MARGIN = 1e-3  # coordinates may leave 0..1 by this much, a pixel of a texture of 1000


@dataclass(frozen=True)
class UnwrappedTexture:
    """A texture lookup without an authored wrap mode along at least one axis, or in an image of UDIM tiles.

    Attributes:
        asset: path of the image file as authored.
        uv: the primvar of its coordinates; "" for the default one.
        transform: affine map of the coordinates, row-major 2x3.
        axes: whether the wrap mode of s and of t is missing; both for UDIM tiles.
    """

    asset: str
    uv: str
    transform: tuple[float, float, float, float, float, float]
    axes: tuple[bool, bool]


def report_borders(
    prim: Usd.Prim, gprim: Usd.Prim, texture: UnwrappedTexture, time: Usd.TimeCode, report: StageReport
) -> None:
    """Report a texture if the coordinates of the faces that it is bound to leave its image.

    Args:
        prim: the mesh or the GeomSubset that the material is bound to.
        gprim: the mesh.
        texture: the texture.
        time: when to evaluate attributes.
        report: gets the omission.
    """
    if not gprim.IsA(UsdGeom.Mesh):
        return  # gprims without authored coordinates have generated ones in 0..1
    topology = primvar_topology(gprim, time)
    if not topology.is_consistent():
        return  # reported where the mesh is read
    attribute = read_uv(gprim, texture.uv, topology, time, report)
    if attribute is None:
        return
    uv = attribute.at(topology.indices, np.arange(len(topology.indices))).astype(np.float64)
    uv = uv[_faces(prim, gprim, len(topology.counts), time)[topology.face_of_corner]]
    matrix = np.reshape(texture.transform, (2, 3))
    mapped = (uv @ matrix[:, :2].T + matrix[:, 2])[:, list(texture.axes)]
    if mapped.size and (mapped.min() < -_MARGIN or mapped.max() > 1.0 + _MARGIN):
        text = f"texture @{texture.asset}@ has no wrap mode, so that it is black where texture coordinates leave 0..1"
        if "<UDIM>" in texture.asset:
            text = f"texture coordinates leave the tiles of @{texture.asset}@; the colors of their edges are used"
        report.omission(gprim.GetPath(), text)


def _faces(prim: Usd.Prim, gprim: Usd.Prim, count: int, time: Usd.TimeCode) -> NDArray[np.bool_]:
    """Return which faces [count] a binding applies to: those of its subset, or those outside all subsets."""
    whole = prim == gprim
    subsets = UsdShade.MaterialBindingAPI(gprim).GetMaterialBindSubsets() if whole else [UsdGeom.Subset(prim)]
    chosen = np.full(count, whole)
    for subset in subsets:
        indices = array_of(subset.GetIndicesAttr(), time, np.int64)
        chosen[indices[(indices >= 0) & (indices < count)]] = not whole
    return chosen
