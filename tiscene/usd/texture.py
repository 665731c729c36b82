"""The table of textures that materials and lights share: each file once per way of reading it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, cast

from pxr import Sdf, Usd

from tiscene.scene.description import Texture
from tiscene.usd.image import Picture, read_picture
from tiscene.usd.problems import Report

Wrap = Literal["repeat", "clamp", "mirror", "black"]
_WRAPS = ("repeat", "clamp", "mirror", "black")


class TextureTable:
    """Reads image files and numbers them."""

    def __init__(self, report: Report) -> None:
        self.textures: list[Texture] = []
        self._report = report
        self._pictures: dict[str, Picture | None] = {}
        self._rows: dict[tuple[str, str, str, str], int] = {}

    def add(
        self, attribute: Usd.Attribute, asset: Sdf.AssetPath, color_space: str, wrap_s: str, wrap_t: str
    ) -> int | None:
        """The row of the texture that `attribute` names; None, with a problem reported, if it cannot be read.

        color_space: UsdUVTexture's "auto", "sRGB" or "raw". wrap_s, wrap_t: its wrap modes; what a file's own
        metadata would say (useMetadata) is black, as its documentation has it for files that say nothing.
        """
        path = asset.resolvedPath
        prim_path = attribute.GetPrim().GetPath()
        if "<UDIM>" in asset.path:
            self._report.omission(prim_path, "UDIM textures are not read, the texture's fallback is used")
            return None
        if not path:
            self._report.problem(prim_path, "texture", f"no file @{asset.path}@ ({_where(attribute, asset)})")
            return None
        picture = self._read(path, prim_path)
        if picture is None:
            return None
        if color_space not in ("auto", "sRGB", "raw"):
            self._report.omission(prim_path, f"colour space {color_space!r} is not known, 'auto' is used")
            color_space = "auto"
        srgb = picture.srgb if color_space == "auto" else color_space == "sRGB"
        wraps = [self._wrap(wrap, prim_path) for wrap in (wrap_s, wrap_t)]
        key = (path, "srgb" if srgb else "raw", *wraps)
        if key not in self._rows:
            self._rows[key] = len(self.textures)
            encoding: Literal["srgb", "raw"] = "srgb" if srgb else "raw"
            self.textures.append(Texture(Path(path).name, picture.pixels, encoding, wraps[0], wraps[1]))
        return self._rows[key]

    def _read(self, path: str, prim_path: Any) -> Picture | None:
        if path not in self._pictures:
            try:
                self._pictures[path] = read_picture(path)
            except (OSError, ValueError) as error:
                self._pictures[path] = None
                self._report.problem(prim_path, "texture", f"@{path}@ cannot be read: {error}")
        return self._pictures[path]

    def _wrap(self, wrap: str, prim_path: Any) -> Wrap:
        if wrap in _WRAPS:
            return cast(Wrap, wrap)
        if wrap != "useMetadata":
            self._report.omission(prim_path, f"wrap mode {wrap!r} is not known, 'black' is used")
        return "black"


def _where(attribute: Usd.Attribute, asset: Sdf.AssetPath) -> str:
    """In which layer the path stands, since a relative one is relative to it."""
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        return f"named in {spec.layer.realPath or spec.layer.identifier}"
    return "named nowhere"
