# SPDX-License-Identifier: Apache-2.0
"""MaterialX nodes by the ids of their definitions: categories and components of outputs."""

from __future__ import annotations

from tiscene.usd.core.shader_network import Source
from tiscene.usd.materials.materialx_noise import NOISES_2D, NOISES_3D
from tiscene.usd.materials.materialx_operations import OPERATIONS

COMPONENTS = {"x": 0, "y": 1, "z": 2, "w": 3, "r": 0, "g": 1, "b": 2, "a": 3}
NOISES = (*NOISES_2D, *NOISES_3D)
SIMPLIFIED = {  # nodes that are drawn as another one
    "hextiledimage": "drawn as a tiledimage",
    "triplanarprojection": "drawn as its filez, by the mesh's texture coordinates",
}
IMAGES = ("image", "tiledimage", "gltf_image", "gltf_colorimage", "gltf_normalmap", "UsdUVTexture", *SIMPLIFIED)
THROUGH = ("convert", "dot", "blur", "constant", "normalmap")  # nodes that pass one input on

_WIDTHS = {"float": 1, "integer": 1, "boolean": 1, "color3": 3, "vector3": 3, "color4": 4, "vector4": 4, "vector2": 2}
_NUMBERS = ("extract", "dotproduct", "magnitude", "distance")  # nodes of one component, whatever the type in their id
_SPECIAL = (
    *(*THROUGH, *NOISES, *IMAGES, "texcoord", "geompropvalue", "geompropvalueuniform", "geomcolor", "place2d"),
    *("rotate2d", "extract", "swizzle", "separate2", "separate3", "separate4", "combine2", "combine3", "combine4"),
    *("switch", "UsdPrimvarReader", "UsdTransform2d", "rotate3d", "heighttonormal", "bump"),
)
_CATEGORIES = sorted({*OPERATIONS, *_SPECIAL}, key=len, reverse=True)


def category_of(shader: str) -> str:
    """Return the category of a node from its id: "multiply" of "ND_multiply_color3FA"; "" for none that is known."""
    name = shader.removeprefix("ND_")
    return next((each for each in _CATEGORIES if name == each or name.startswith(f"{each}_")), "")


def is_geometric(shader: str) -> bool:
    """Return whether a node, by its id, gives the mesh's own normal, tangent or bitangent."""
    return shader.startswith(("ND_normal_", "ND_tangent_", "ND_bitangent_"))


def output_width(source: Source, category: str) -> int:
    """Return the components of a node's output, by the type in its id; 0 if that says nothing."""
    if category.startswith("separate") or category in _NUMBERS:
        return 1
    if category == "normalmap":  # its id has the type of its scale
        return 3
    kinds = source.id.removeprefix("ND_").removeprefix(category).strip("_").split("_")
    named = [_WIDTHS[each.removesuffix("FA")] for each in kinds if each.removesuffix("FA") in _WIDTHS]
    return named[-1] if named else 0
