# SPDX-License-Identifier: Apache-2.0
"""MaterialX's image nodes as texture lookups: those of the standard library, of glTF and of UsdPreviewSurface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Sdf

from tiscene.usd.core.color_space import LINEAR, SRGB, color_space
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.shader_network import ShaderConnection, Source
from tiscene.usd.materials.materialx_baker import Baker
from tiscene.usd.materials.materialx_nodes import COMPONENTS, SIMPLIFIED, output_width
from tiscene.usd.materials.materialx_signal import Coordinates, Floats, Signal, lookup, placement, shift
from tiscene.usd.materials.materialx_units import meters_per_unit
from tiscene.usd.materials.texture import TextureTable

PLACE = (("pivot", (0.0, 0.0)), ("scale", (1.0, 1.0)), ("rotate", (0.0,)), ("offset", (0.0, 0.0)))  # of place2d
_WRAPS = {"periodic": "repeat", "clamp": "clamp", "mirror": "mirror", "constant": "black"}
_FOUR_CHANNELS = ("UsdUVTexture", "gltf_colorimage")  # nodes of several outputs
_FACTORS = {"UsdUVTexture": ("scale",), "gltf_image": ("factor",), "gltf_colorimage": ("color", "geomcolor")}
_SIZES = ("realworldimagesize", "realworldtilesize")
_IGNORED = ("layer", "framerange")  # inputs of images: one of several pictures in a file, and a sequence of files


@dataclass(frozen=True, eq=False)
class ImageNode:
    """Reads one image node.

    Attributes:
        category: one of IMAGES.
        source: its output.
        inputs: its inputs.
        value: returns the value of an input, or its default.
        numbers: returns the same, of an input that must be constant.
        baker: computes what is no lookup.
        textures: table for image files.
        report: collects what is not applied.
    """

    category: str
    source: Source
    inputs: dict[str, ShaderConnection]
    value: Callable[[ShaderConnection | None, Any], Signal]
    numbers: Callable[[dict[str, ShaderConnection], str, tuple[float, ...]], Floats]
    baker: Baker
    textures: TextureTable
    report: StageReport

    def signal(self) -> Signal:
        """Return the lookup; the node's default where it has no image that can be read."""
        path, category = self.source.shader.GetPath(), self.category
        width = 4 if category in _FOUR_CHANNELS else output_width(self.source, category) or 3
        channels = tuple(range(width))
        if category in _FOUR_CHANNELS:
            named = self.source.output.removeprefix("out")
            channels = (COMPONENTS[named],) if named in COMPONENTS else (0, 1, 2)
        preview = category == "UsdUVTexture"
        default = self.value(self.inputs.get("fallback" if preview else "default"), (0.0,) * width)
        fallback = default.of_width(width).select(channels)
        file = self.inputs.get("filez" if category == "triplanarprojection" else "file")
        if category in SIMPLIFIED:
            self.report.omission(path, f"MaterialX node {category!r} is {SIMPLIFIED[category]}")
        if file is None or not isinstance(file.value, Sdf.AssetPath) or not file.value.path:
            self.report.omission(path, "an image node without a file; its default is used")
            return fallback
        if ignored := [name for name in _IGNORED if name in self.inputs and self.inputs[name].value]:
            self.report.omission(path, f"{' and '.join(ignored)} of an image are not applied")
        coordinates = self._coordinates()
        space = self._token("sourceColorSpace") if preview else ""
        space = space or _color_space(file, preview or "color" in self.source.id)
        if "<UDIM>" in file.value.path:
            missing = self.baker.mean(default.of_width(4)) if width == 4 else (*self.baker.mean(default), 1.0)
            tiles = self.textures.add_udim(file.attribute, file.value, space, tuple(np.resize(missing, 4).tolist()))
            row, window = tiles or (None, None)
            if window is not None:
                coordinates = coordinates.mapped(np.array([window[:3], window[3:], (0.0, 0.0, 1.0)]))
        else:
            wraps = self._wrap("u"), self._wrap("v")
            closest = self._token("filtertype") == "closest"
            row = self.textures.add(file.attribute, file.value, space, *wraps, "its default is used", enlarged=closest)
        if row is None:
            return fallback
        texture = self.textures.textures[row]
        found = replace(lookup(row, channels), coordinates=coordinates, wraps=(texture.wrap_s, texture.wrap_t))
        return self._scaled(found if preview else self._bordered(found, fallback), width, channels)

    def _bordered(self, image: Signal, fallback: Signal) -> Signal:
        """Return an image that is the node's default outside of the image, where that is not repeated."""
        if "black" not in image.wraps or fallback.constant is None or fallback.is_zero:
            return image
        return replace(self.baker.apply(lambda values: values, image), border=fallback.constant)

    def _scaled(self, image: Signal, width: int, channels: tuple[int, ...]) -> Signal:
        """Return an image times the factors of its node, plus its bias."""
        summand = np.zeros(1)
        if self.category == "UsdUVTexture":
            summand = self.baker.mean(self.value(self.inputs.get("bias"), 0.0).of_width(width).select(channels))
        for name in _FACTORS.get(self.category, ()):
            factor = self.value(self.inputs.get(name), 1.0).of_width(width).select(channels)
            if factor.constant is None:
                tinted = None if summand.any() else image.tinted(factor)
                image = tinted or self.baker.apply(lambda a, b: a * b + summand, image, factor)
            else:
                image = self.baker.affine(image, factor.constant, summand)
        return image

    def _coordinates(self) -> Coordinates:
        at = self.value(self.inputs.get("st" if self.category == "UsdUVTexture" else "texcoord"), None)
        coordinates = self.baker.coordinates(at)
        if coordinates is None:
            text = "texture coordinates that are no affine map of the mesh's are not supported; the mesh's own are used"
            self.report.omission(self.source.shader.GetPath(), text)
            coordinates = Coordinates()
        if self.category in ("tiledimage", "hextiledimage"):
            return self._tiled(coordinates)
        return self._placed(coordinates) if self.category.startswith("gltf") else coordinates

    def _tiled(self, coordinates: Coordinates) -> Coordinates:
        """Return the coordinates of a tiledimage: times its tiling, minus its offset."""
        tiling = self.numbers(self.inputs, "uvtiling" if self.category == "tiledimage" else "tiling", (1.0, 1.0))
        offset = self.numbers(self.inputs, "uvoffset", (0.0, 0.0))
        world, tile = (self.numbers(self.inputs, name, (1.0, 1.0)) for name in _SIZES)
        scale = tile / np.where(world == 0.0, 1.0, world) * (self._meters(_SIZES[1]) / self._meters(_SIZES[0]))
        return coordinates.mapped(np.diag([*scale, 1.0]) @ shift(*-offset) @ np.diag([*tiling, 1.0]))

    def _meters(self, name: str) -> float:
        """Return the unit of a size, in meters."""
        given = self.inputs.get(name)
        return meters_per_unit(self.source.shader.GetIdAttr() if given is None else given.attribute)

    def _placed(self, at: Coordinates) -> Coordinates:
        """Return the coordinates of glTF's image nodes: place2d with the inverse of their scale, turn and offset."""
        pivot, scale, rotate, offset = (
            self.numbers(self.inputs, name, (0.0, 1.0) if name == "pivot" else default) for name, default in PLACE
        )
        order = 1.0 if "color4" in self.source.id else 0.0
        if self.category != "gltf_colorimage":  # whose graph does not pass it on
            order = self.numbers(self.inputs, "operationorder", (order,))[0]
        scale, offset = 1.0 / np.where(scale == 0.0, 1.0, scale), offset * (-1.0, 1.0)
        return at.mapped(placement(pivot, scale, -rotate, offset, order == 1.0))

    def _token(self, name: str) -> str:
        connection = self.inputs.get(name)
        return "" if connection is None or connection.value is None else str(connection.value)

    def _wrap(self, axis: str) -> str:
        mode = self._token(f"{axis}addressmode") or self._token({"u": "wrapS", "v": "wrapT"}[axis])
        return _WRAPS.get(mode, mode) or "repeat"


def _color_space(file: ShaderConnection, is_color: bool) -> str:
    """Return the color space of an image node's file, as `TextureTable.add` names it: vectors are raw."""
    name = file.attribute.GetColorSpace()
    if not name:
        return "auto" if is_color else "raw"
    space = color_space(name)
    if space == SRGB:
        return "sRGB"
    return space if is_color and space != LINEAR else "raw"
