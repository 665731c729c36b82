# SPDX-License-Identifier: Apache-2.0
"""The table of textures that materials and lights share: each file once per way of reading it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdShade

from tiscene.scene.color import decode_srgb, encode_srgb
from tiscene.scene.description import FloatArray, Texture
from tiscene.usd.core.package import split_package
from tiscene.usd.core.report import StageReport
from tiscene.usd.materials.image import ImageData, read_picture

Wrap = Literal["repeat", "clamp", "mirror", "black"]
Encoding = Literal["srgb", "raw"]
Affine = tuple[float, float, float, float, float, float]
_BRIGHTEST = 65504.0  # the largest number of half precision
_INSTEAD = "its fallback is used"
_WRAPS = ("repeat", "clamp", "mirror", "black")


class TextureTable:
    """Reads image files and numbers them."""

    def __init__(self, report: StageReport) -> None:
        """What cannot be read is reported, and its place is the caller's to fill."""
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
        instead: str = _INSTEAD,
    ) -> int | None:
        """The row of the texture that `attribute` names; None, which is reported, if it cannot be read.

        color_space: UsdUVTexture's "auto", "sRGB" or "raw". wrap_s, wrap_t: its wrap modes; what a file's own
        metadata would say (useMetadata) is black, as its documentation has it for files that say nothing.
        instead: what happens if it cannot be read.
        """
        path = asset.resolvedPath
        prim_path = attribute.GetPrim().GetPath()
        if not path:
            self._report.omission(prim_path, f"there is no texture @{asset.path}@ ({_where(attribute)}); {instead}")
            return None
        picture = self._read(path, prim_path, instead)
        if picture is None:
            return None
        encoding = self._encoding(color_space, picture, prim_path)
        return self._row(path, picture, encoding, (self._wrap(wrap_s, prim_path), self._wrap(wrap_t, prim_path)))

    def add_udim(
        self, attribute: Usd.Attribute, asset: Sdf.AssetPath, color_space: str, fallback: tuple[float, ...]
    ) -> tuple[int, Affine] | None:
        """The row of a texture that holds all tiles of "wood.<UDIM>.png" side by side, and the map of uv into it.

        Tile 1001 + u + 10 v covers the unit square at (u, v). fallback: the color of tiles between that are not there.
        None, which is reported, if there are no tiles or one cannot be read.
        """
        prim_path = attribute.GetPrim().GetPath()
        tiles = {
            int(number) - 1001: path
            for path, number in UsdShade.UdimUtils.ResolveUdimTilePaths(_anchored(attribute, asset), None)
        }
        if not tiles:
            self._report.omission(prim_path, f"there are no tiles @{asset.path}@ ({_where(attribute)}); {_INSTEAD}")
            return None
        pictures = {tile: self._read(path, prim_path) for tile, path in tiles.items()}
        read = {divmod(tile, 10)[::-1]: picture for tile, picture in pictures.items() if picture is not None}
        if len(read) < len(tiles):
            return None
        low, high = np.min(list(read), axis=0), np.max(list(read), axis=0) + 1
        columns, rows = (high - low).tolist()
        first = next(iter(read.values()))
        encoding = self._encoding(color_space, first, prim_path)
        sheet = ImageData(_sheet(read, low, (columns, rows), fallback, encoding), first.srgb)
        row = self._row(_anchored(attribute, asset), sheet, encoding, ("clamp", "clamp"))
        return row, (1.0 / columns, 0.0, -float(low[0]) / columns, 0.0, 1.0 / rows, -float(low[1]) / rows)

    def add_pixels(self, key: str, name: str, pixels: FloatArray) -> int:
        """The row of an image [h, w, 4] that was made here, once for each key."""
        return self._row(key, ImageData(pixels, srgb=False), "raw", ("repeat", "clamp"), name)

    def _encoding(self, color_space: str, picture: ImageData, prim_path: Any) -> Encoding:
        if color_space not in ("auto", "sRGB", "raw"):
            self._report.omission(prim_path, f"color space {color_space!r} is not known, 'auto' is used")
            color_space = "auto"
        return "srgb" if (picture.srgb if color_space == "auto" else color_space == "sRGB") else "raw"

    def _row(self, path: str, picture: ImageData, encoding: Encoding, wraps: tuple[Wrap, Wrap], name: str = "") -> int:
        key = (path, encoding, *wraps)
        if key not in self._rows:
            self._rows[key] = len(self.textures)
            pixels = picture.pixels
            if encoding == "srgb" and pixels.dtype != np.uint8:  # only 8-bit textures are decoded when they are read
                pixels, encoding = _decoded(np.asarray(pixels, np.float32)), "raw"
            self.textures.append(Texture(name or Path(split_package(path)[-1]).name, pixels, encoding, *wraps))
        return self._rows[key]

    def _read(self, path: str, prim_path: Any, instead: str = _INSTEAD) -> ImageData | None:
        if path not in self._pictures:
            if not self._report.root.contains(path):
                self._report.problem(prim_path, "texture", f"@{path}@ is outside {self._report.root.folder}")
                self._pictures[path] = None
                return None
            try:
                self._pictures[path] = self._finite(read_picture(path), path, prim_path)
            except (OSError, ValueError) as error:
                self._pictures[path] = None
                self._report.omission(prim_path, f"texture @{path}@ cannot be read ({error}); {instead}")
        return self._pictures[path]

    def _finite(self, picture: ImageData, path: str, prim_path: Any) -> ImageData:
        """The picture without what is no finite number: suns too bright for half precision, pixels never written."""
        if picture.pixels.dtype == np.uint8 or np.isfinite(picture.pixels).all():
            return picture
        count = int((~np.isfinite(picture.pixels).all(axis=2)).sum())
        text = f"{count} pixels of texture @{path}@ are not finite: what is endless is {_BRIGHTEST:g}, else 0"
        self._report.omission(prim_path, text)
        pixels = np.nan_to_num(picture.pixels, nan=0.0, posinf=_BRIGHTEST, neginf=0.0)
        return ImageData(np.asarray(pixels, np.float32), picture.srgb)

    def _wrap(self, wrap: str, prim_path: Any) -> Wrap:
        if wrap in _WRAPS:
            return cast(Wrap, wrap)
        if wrap != "useMetadata":
            self._report.omission(prim_path, f"wrap mode {wrap!r} is not known, 'black' is used")
        return "black"


def _where(attribute: Usd.Attribute) -> str:
    """In which layer the path stands, since a relative one is relative to it."""
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        return f"named in {spec.layer.realPath or spec.layer.identifier}"
    return "named nowhere"


def _anchored(attribute: Usd.Attribute, asset: Sdf.AssetPath) -> str:
    """The path with <UDIM> in it, relative to the layer that names it.

    USD takes a path without "./" so only if there is a file of that very name; elsewhere it looks later.
    """
    if asset.resolvedPath:
        return str(asset.resolvedPath)
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        beside = str(spec.layer.ComputeAbsolutePath(f"./{asset.path}"))
        if not os.path.isabs(asset.path) and UsdShade.UdimUtils.ResolveUdimTilePaths(beside, None):
            return beside
        return str(spec.layer.ComputeAbsolutePath(asset.path))
    return str(asset.path)


def _sheet(
    tiles: dict[tuple[int, int], ImageData],
    low: NDArray[np.int64],
    size: tuple[int, int],
    fallback: tuple[float, ...],
    encoding: Encoding,
) -> NDArray[np.uint8] | FloatArray:
    """Tiles by their (u, v) as one image [h, w, 4], those of v = 0 at the bottom. All get the size of the largest."""
    height = max(picture.pixels.shape[0] for picture in tiles.values())
    width = max(picture.pixels.shape[1] for picture in tiles.values())
    is_float = any(picture.pixels.dtype != np.uint8 for picture in tiles.values())
    empty = np.asarray(fallback, dtype=np.float64)
    if encoding == "srgb":
        empty[:3] = encode_srgb(empty[:3])
    columns, rows = size
    sheet = np.empty((rows * height, columns * width, 4), dtype=np.float32 if is_float else np.uint8)
    sheet[:] = empty if is_float else np.rint(np.clip(empty, 0.0, 1.0) * 255.0)
    for (u, v), picture in tiles.items():
        pixels = picture.pixels
        if is_float and pixels.dtype == np.uint8:
            pixels = pixels.astype(np.float32) / np.float32(255.0)
        lines = np.arange(height) * pixels.shape[0] // height
        dots = np.arange(width) * pixels.shape[1] // width
        top, left = (rows - 1 - (v - int(low[1]))) * height, (u - int(low[0])) * width
        sheet[top : top + height, left : left + width] = pixels[lines[:, None], dots]
    return sheet


def _decoded(pixels: FloatArray) -> FloatArray:
    """sRGB floats as linear ones; alpha is linear already."""
    result = pixels.copy()
    result[..., :3] = decode_srgb(result[..., :3])
    return result
