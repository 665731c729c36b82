# SPDX-License-Identifier: Apache-2.0
"""Every per-pixel buffer: its name, type, unit and background. Film, kernels, Frame, command line and README read this.

A frame's buffers are numpy arrays [height, width] or [height, width, channels], row 0 at the top. All but `rgb`,
`hdr` and `denoised` are *labels*: what one ray through the pixel's center meets at the frame's time; never averaged
over a pixel.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, BufferNotFound
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS


@dataclass(frozen=True)
class Buffer:
    """One per-pixel output ("arbitrary output variable" in renderers; the public word is buffer).

    dtype: of the numpy array. channels: () for an array [height, width], else the lengths of its further axes.
    unit: "" where there is none.
    background: the value where a ray meets nothing; None where that is computed. doc: one sentence for the tables.
    """

    name: str
    dtype: str
    channels: tuple[int, ...]
    unit: str
    background: float | None
    doc: str

    def shape(self, width: int, height: int) -> tuple[int, ...]:
        """The array's shape for a picture of that size."""
        return (height, width, *self.channels)

    def empty(self, width: int, height: int) -> NDArray[Any]:
        """A new array for a picture of that size, its values not set."""
        return np.empty(self.shape(width, height), self.dtype)


RANKS = 6  # objects, or materials, that are told apart in one pixel

BUFFERS: dict[str, Buffer] = {
    aov.name: aov
    for aov in (
        Buffer("rgb", "uint8", (3,), "", None, "Display sRGB after exposure and tone map."),
        Buffer("hdr", "float32", (3,), "W/m²/sr", None, "Scene-linear Rec.709 radiance, as traced."),
        Buffer(
            "denoised", "float32", (3,), "W/m²/sr", None, "`hdr` after the denoiser, if it is on; `rgb` shows this."
        ),
        Buffer("depth", "float32", (), "m", np.inf, "Distance along the optical axis (z, not ray length)."),
        Buffer("distance", "float32", (), "m", np.inf, "Distance from the camera (ray length)."),
        Buffer("position", "float32", (3,), "m", np.nan, "World position of the surface."),
        Buffer("normal", "float32", (3,), "", 0.0, "Unit shading normal, world, on the side that is seen."),
        Buffer(
            "geometric_normal",
            "float32",
            (3,),
            "",
            0.0,
            "Unit normal of the triangle, world, on the side seen.",
        ),
        Buffer(
            "normal_camera", "float32", (3,), "", 0.0, "Shading normal in camera axes (x right, y down, z forward)."
        ),
        Buffer("albedo", "float32", (3,), "", 0.0, "Base color, linear, of the first surface that is not a mirror."),
        Buffer("roughness", "float32", (), "", 0.0, "Roughness, 0..1, of the first surface that is not a mirror."),
        Buffer("metallic", "float32", (), "", 0.0, "Metalness, 0..1, of the first surface that is not a mirror."),
        Buffer("semantic", "uint16", (), "id", 0, "Category id; `frame.categories` names them."),
        Buffer("instance", "int32", (), "id", 0, "Object id, stable for the whole stream and never reused."),
        Buffer("part", "int32", (), "id", 0, "Part of the object, 1 and up; its row in `frame.objects` names them."),
        Buffer(
            "coverage", "float32", (RANKS, 2), "", 0.0, "Object ids and the part of the pixel each fills, most first."
        ),
        Buffer(
            "material_coverage", "float32", (RANKS, 2), "", 0.0, "The same of materials, named by `frame.materials`."
        ),
        Buffer("forward_flow", "float32", (2,), "px", None, "Where the point will be at frame k+1, minus where it is."),
        Buffer("backward_flow", "float32", (2,), "px", None, "Where the point was at frame k-1, minus where it is."),
        Buffer("forward_occlusion", "bool", (), "", True, "True: the point is not visible at frame k+1."),
        Buffer("backward_occlusion", "bool", (), "", True, "True: the point was not visible at frame k-1."),
        Buffer("scene_flow", "float32", (3,), "m", 0.0, "World displacement of the point to frame k+1."),
        Buffer("uv", "float32", (2,), "", 0.0, "Texture coordinates of the surface; 0 where the mesh has none."),
        Buffer(
            "object_coordinates", "float32", (3,), "", 0.0, "Position in the object's own bounding box, 0..1 an axis."
        ),
    )
}

COLORS = frozenset({"rgb", "hdr", "denoised"})
LABELS = tuple(name for name in BUFFERS if name not in COLORS)

_OCCLUSION_TIME = {"forward_occlusion": NEXT, "backward_occlusion": PREVIOUS}


def times_needed(buffers: Iterable[str]) -> tuple[int, ...]:
    """At which times of `tiscene.scene.placement` the scene must be placed so that those buffers can be rendered."""
    return tuple(sorted({CURRENT} | {_OCCLUSION_TIME[name] for name in buffers if name in _OCCLUSION_TIME}))


def buffer_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names of buffers, each once. Raises ArgumentError, BufferNotFound."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise ArgumentError(f"buffers={names!r}: must be a sequence of names, such as ('rgb', 'depth')")
    wanted = tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in BUFFERS:
            raise BufferNotFound("buffer", name, BUFFERS)
    if not wanted:
        raise ArgumentError("buffers=(): ask for one at least")
    return wanted
