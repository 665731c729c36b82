# SPDX-License-Identifier: Apache-2.0
"""The texture table that materials and lights share.

`TextureTable` decodes each image file once and makes one texture for each combination of file, color space and wrap
modes. The tiles of a UDIM texture become one image. Files that cannot be read are reported; the caller substitutes
something for them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdShade

from tiscene.errors import counted
from tiscene.scene.color import encode_srgb
from tiscene.scene.description import FloatArray, Texture
from tiscene.usd.core.color_space import SRGB, to_linear_rec709
from tiscene.usd.core.package import split_package
from tiscene.usd.core.report import StageReport
from tiscene.usd.materials.image import ImageData, read_picture
from tiscene.usd.materials.materialx_document import DOCUMENT

Wrap = Literal["repeat", "clamp", "mirror", "black"]
Encoding = Literal["srgb", "raw"]
Affine = tuple[float, float, float, float, float, float]
IDENTITY: Affine = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
_HALF_MAX = 65504.0  # largest finite float16
_MAX_SHEET = 1 << 28  # texels of an image of UDIM tiles that are far apart; 1 GiB of 8-bit ones
_MAX_ENLARGED = 2048  # px, of a side of an image whose pixels are blocks
_MAX_BLOCK = 16  # px, of a block
_FALLBACK = "its fallback is used"
_WRAPS = ("repeat", "clamp", "mirror", "black")


class TextureTable:
    """Reads image files into `textures`.

    Args:
        report: collects files that cannot be read.

    Attributes:
        textures: the rows read so far.
    """

    def __init__(self, report: StageReport) -> None:
        self.textures: list[Texture] = []
        self._report = report
        self._pictures: dict[str, ImageData | None] = {}
        self._rows: dict[tuple[str, str, str, str], int] = {}

    def add(
        self,
        attribute: Usd.Attribute,
        asset: Sdf.AssetPath,
        color_space: str,
        wrap_s: str,
        wrap_t: str,
        instead: str = _FALLBACK,
        *,
        mirrored: bool = False,
        enlarged: bool = False,
    ) -> int | None:
        """Read the texture that an attribute names.

        Args:
            attribute: the asset-valued attribute, named in messages.
            asset: its value.
            color_space: UsdUVTexture's sourceColorSpace: "auto", "sRGB" or "raw"; or USD's name of another space.
            wrap_s: UsdUVTexture's wrapS. "useMetadata" is "black": the specification's default for files without
                wrap metadata, which is not read.
            wrap_t: the same for wrapT.
            instead: what is used if the file cannot be read, for the message.
            mirrored: whether left and right of the image are exchanged.
            enlarged: whether its pixels become blocks, so that interpolation leaves them their edges.

        Returns:
            The row of the texture; None, which is reported, if the file is missing or cannot be read.
        """
        path = asset.resolvedPath
        prim_path = attribute.GetPrim().GetPath()
        if not path:
            self._report.omission(
                prim_path, f"there is no texture @{asset.path}@ ({_describe_layer(attribute)}); {instead}"
            )
            return None
        picture = self._read(path, prim_path, instead)
        if picture is None:
            return None
        encoding, name = self._encoding(color_space, picture, prim_path), Path(split_package(path)[-1]).name
        if mirrored:
            path, picture = f"{path} mirrored", ImageData(picture.pixels[:, ::-1], picture.srgb)
        times = min(_MAX_ENLARGED // max(picture.pixels.shape[:2]), _MAX_BLOCK) if enlarged else 1
        if times > 1:
            pixels = picture.pixels.repeat(times, axis=0).repeat(times, axis=1)
            path, picture = f"{path} enlarged", ImageData(pixels, picture.srgb)
        return self._row(path, picture, encoding, (self._wrap(wrap_s, prim_path), self._wrap(wrap_t, prim_path)), name)

    def add_udim(
        self, attribute: Usd.Attribute, asset: Sdf.AssetPath, color_space: str, fallback: tuple[float, ...]
    ) -> tuple[int, Affine] | None:
        """Read the tiles of a UDIM texture such as "wood.<UDIM>.png" into one image.

        Tile 1001 + u + 10 v covers the unit square at (u, v).

        Args:
            attribute: the asset-valued attribute, named in messages.
            asset: its value, with <UDIM> in its path.
            color_space: UsdUVTexture's sourceColorSpace.
            fallback: RGBA of missing tiles between others.

        Returns:
            The row of the texture and the affine map from uv into it; None, which is reported, if there are no tiles
            or one cannot be read.
        """
        prim_path, key = attribute.GetPrim().GetPath(), _anchor_udim_path(attribute, asset)
        tiles = {int(number) - 1001: path for path, number in UsdShade.UdimUtils.ResolveUdimTilePaths(key, None)}
        if not tiles:
            self._report.omission(
                prim_path, f"there are no tiles @{asset.path}@ ({_describe_layer(attribute)}); {_FALLBACK}"
            )
            return None
        pictures = {tile: self._read(path, prim_path) for tile, path in tiles.items()}
        read = {divmod(tile, 10)[::-1]: picture for tile, picture in pictures.items() if picture is not None}
        if len(read) < len(tiles):
            return None
        low, high = np.min(list(read), axis=0), np.max(list(read), axis=0) + 1
        columns, rows = (high - low).tolist()
        first = next(iter(read.values()))
        encoding = self._encoding(color_space, first, prim_path)
        shape = np.max([picture.pixels.shape[:2] for picture in read.values()], axis=0)
        largest = max(_MAX_SHEET, 2 * len(read) * int(shape.prod()))
        fitting = shape
        while columns * rows * int(fitting.prod()) > largest and fitting.max() > 1:
            fitting = np.maximum(fitting // 2, 1)
        if fitting is not shape:
            size = "x".join(map(str, fitting[::-1]))
            text = f"the tiles @{asset.path}@ are far apart, in an area of {columns}x{rows}: each is reduced to {size}"
            self._report.omission(prim_path, text)
        merged = ImageData(_merge_tiles(read, low, (columns, rows), fitting.tolist(), fallback, encoding), first.srgb)
        name = Path(split_package(key)[-1]).name
        if len(read) < columns * rows:  # the fallback is part of the image
            key += f" {fallback}"
        row = self._row(key, merged, encoding, ("clamp", "clamp"), name)
        return row, (1.0 / columns, 0.0, -float(low[0]) / columns, 0.0, 1.0 / rows, -float(low[1]) / rows)

    def add_image(self, key: str, name: str, pixels: NDArray[Any], encoding: Encoding, wraps: tuple[Wrap, Wrap]) -> int:
        """Add a computed image [h, w, 4], once for each key; return its row."""
        return self._row(key, ImageData(pixels, srgb=False), encoding, wraps, name)

    def _encoding(self, color_space: str, picture: ImageData, prim_path: Any) -> str:
        """Return how pixels are encoded, from sourceColorSpace and, for "auto", from the file: see `_row`."""
        if Gf.ColorSpace.IsValid(color_space) and color_space != "raw":
            return color_space
        if color_space not in ("auto", "sRGB", "raw"):
            self._report.omission(prim_path, f"color space {color_space!r} is not known; 'auto' is used")
            color_space = "auto"
        return "srgb" if (picture.srgb if color_space == "auto" else color_space == "sRGB") else "raw"

    def _row(self, path: str, picture: ImageData, encoding: str, wraps: tuple[Wrap, Wrap], name: str) -> int:
        """Return the row of an image with these wrap modes; append it if it is new.

        Its encoding is "srgb", "raw" or a color space by USD's name, which is converted here.
        """
        key = (path, encoding, *wraps)
        if key not in self._rows:
            self._rows[key] = len(self.textures)
            pixels: Any = np.ascontiguousarray(picture.pixels)
            if encoding == "srgb" and pixels.dtype != np.uint8:  # the renderer decodes sRGB of 8-bit textures only
                encoding = SRGB
            if encoding not in ("srgb", "raw"):
                pixels, encoding = _to_linear(pixels, encoding), "raw"
            self.textures.append(Texture(name, pixels, cast(Encoding, encoding), *wraps))
        return self._rows[key]

    def _read(self, path: str, prim_path: Any, instead: str = _FALLBACK) -> ImageData | None:
        """Decode a file, once; None, which is reported, if it cannot be read."""
        if path not in self._pictures:
            if not self._report.root.contains(path):
                self._report.refuse(prim_path, "texture", self._report.root.refusal(path))
                self._pictures[path] = None
                return None
            try:
                self._pictures[path] = self._finite(read_picture(path), path, prim_path)
            except (OSError, ValueError) as error:
                self._pictures[path] = None
                self._report.omission(prim_path, f"texture @{path}@ cannot be read ({error}); {instead}")
        return self._pictures[path]

    def _finite(self, picture: ImageData, path: str, prim_path: Any) -> ImageData:
        """Replace pixels that are not finite, such as suns beyond the range of float16 and pixels never written."""
        if picture.pixels.dtype == np.uint8 or np.isfinite(picture.pixels).all():
            return picture
        count = int((~np.isfinite(picture.pixels).all(axis=2)).sum())
        text = f"{counted(count, 'pixel')} of texture @{path}@ not finite: inf becomes {_HALF_MAX:g}, others 0"
        self._report.omission(prim_path, text)
        pixels = np.nan_to_num(picture.pixels, nan=0.0, posinf=_HALF_MAX, neginf=0.0)
        return ImageData(np.asarray(pixels, np.float32), picture.srgb)

    def _wrap(self, wrap: str, prim_path: Any) -> Wrap:
        """Return a UsdUVTexture wrap mode as ours; unknown ones are reported."""
        if wrap in _WRAPS:
            return cast(Wrap, wrap)
        if wrap != "useMetadata":
            self._report.omission(prim_path, f"wrap mode {wrap!r} is not known; 'black' is used")
        return "black"


def _describe_layer(attribute: Usd.Attribute) -> str:
    """Describe the layer that authors an asset path, to which a relative path is relative."""
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        if spec.layer == attribute.GetStage().GetSessionLayer():
            return "of its cards"
        # The identifier of an anonymous layer has an address, which differs from run to run.
        return f"named in {spec.layer.realPath or spec.layer.customLayerData.get(DOCUMENT) or 'a layer in memory'}"
    return "named nowhere"


def _anchor_udim_path(attribute: Usd.Attribute, asset: Sdf.AssetPath) -> str:
    """Return a path with <UDIM> in it, anchored to the layer that authors it.

    USD anchors a path without "./" only if a file of that very name exists, which a UDIM path never does.
    """
    if asset.resolvedPath:
        return str(asset.resolvedPath)
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        beside = str(spec.layer.ComputeAbsolutePath(f"./{asset.path}"))
        if not os.path.isabs(asset.path) and UsdShade.UdimUtils.ResolveUdimTilePaths(beside, None):
            return beside
        return str(spec.layer.ComputeAbsolutePath(asset.path))
    return str(asset.path)


def _merge_tiles(
    tiles: dict[tuple[int, int], ImageData],
    low: NDArray[np.int64],
    size: tuple[int, int],
    shape: tuple[int, int],
    fallback: tuple[float, ...],
    encoding: str,
) -> NDArray[np.uint8] | FloatArray:
    """Arrange UDIM tiles as one image [h, w, 4], with v increasing upward.

    Args:
        tiles: images by their (u, v); all are resized by nearest neighbor.
        low: (u, v) of the lowest tiles.
        size: columns and rows of tiles.
        shape: height and width of each tile in the result.
        fallback: linear RGBA of missing tiles.
        encoding: encoding of the tiles.
    """
    height, width = shape
    is_float = any(picture.pixels.dtype != np.uint8 for picture in tiles.values())
    empty = np.asarray(fallback, dtype=np.float64)
    if encoding == "srgb":
        empty[:3] = encode_srgb(empty[:3])
    columns, rows = size
    merged = np.empty((rows * height, columns * width, 4), dtype=np.float32 if is_float else np.uint8)
    merged[:] = empty if is_float else np.rint(np.clip(empty, 0.0, 1.0) * 255.0)
    for (u, v), picture in tiles.items():
        pixels = picture.pixels
        if is_float and pixels.dtype == np.uint8:
            pixels = pixels.astype(np.float32) / np.float32(255.0)
        lines = np.arange(height) * pixels.shape[0] // height
        dots = np.arange(width) * pixels.shape[1] // width
        top, left = (rows - 1 - (v - int(low[1]))) * height, (u - int(low[0])) * width
        merged[top : top + height, left : left + width] = pixels[lines[:, None], dots]
    return merged


def _to_linear(pixels: NDArray[np.uint8] | FloatArray, space: str) -> FloatArray:
    """Return pixels [h, w, 4] of a color space as linear floats; alpha is linear already."""
    result = np.array(pixels, np.float32)
    if pixels.dtype == np.uint8:
        result /= np.float32(255.0)
    result[..., :3] = to_linear_rec709(result[..., :3], space)
    return result
