# SPDX-License-Identifier: Apache-2.0
"""BUFFERS: the registry of per-pixel buffers: name, type, unit and background.

A frame's buffers are numpy arrays [height, width] or [height, width, channels], row 0 at the top. All but `rgb`, `hdr`
and `denoised` are *labels*: values at the first hit of one ray through the pixel's center at the frame's time, never
averaged over a pixel. The label kernels, Frame, the command line and the documentation derive from this table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, BufferNotFound
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS


@dataclass(frozen=True)
class Buffer:
    """One per-pixel output ("arbitrary output variable", AOV, in renderers).

    Attributes:
        name: its name.
        dtype: of the numpy array.
        channels: () for an array [height, width], else the lengths of its further axes.
        unit: "" for none.
        background: value where a ray hits nothing; None where it is computed.
        doc: one sentence for the tables.
        inputs: buffers that `compute` takes.
        compute: makes the array from the arrays of `inputs`, for buffers that are not rendered themselves.
    """

    name: str
    dtype: str
    channels: tuple[int, ...]
    unit: str
    background: float | None
    doc: str
    inputs: tuple[str, ...] = ()
    compute: Callable[..., NDArray[Any]] | None = None

    def shape(self, width: int, height: int) -> tuple[int, ...]:
        """Return the array's shape for an image size."""
        return (height, width, *self.channels)

    def empty(self, width: int, height: int) -> NDArray[Any]:
        """Return a new array for an image size, its values undefined."""
        return np.empty(self.shape(width, height), self.dtype)


RANKS = 6  # objects, or materials, per pixel

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
        Buffer(
            "normal",
            "float32",
            (3,),
            "",
            0.0,
            "Unit shading normal, world: interpolated between vertices, without normal maps, on the side of "
            "`geometric_normal`.",
        ),
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
        Buffer("semantic", "int32", (), "id", 0, "Category id; `frame.categories` names them."),
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


def register_buffer(buffer: Buffer) -> None:
    """Add a buffer that is computed from others, so that streams, exports and the command line know it by its name.

    Args:
        buffer: with `inputs` and `compute`.

    Raises:
        ArgumentError: the name is taken, or the buffer lacks `compute` or names unknown inputs.
    """
    if buffer.name in BUFFERS or not buffer.name.isidentifier():
        raise ArgumentError(f"buffer {buffer.name!r}: the name is taken or not an identifier; choose another")
    if buffer.compute is None or not buffer.inputs:
        raise ArgumentError(f"buffer {buffer.name!r}: give inputs= and compute=")
    buffer_names(buffer.inputs)
    BUFFERS[buffer.name] = buffer


def rendered_buffers(names: Iterable[str]) -> tuple[str, ...]:
    """Return the buffers to render for some buffers: themselves, or the inputs of computed ones."""
    rendered: dict[str, None] = {}
    for name in names:
        buffer = BUFFERS[name]
        rendered |= dict.fromkeys((name,) if buffer.compute is None else rendered_buffers(buffer.inputs))
    return tuple(rendered)


def complete(names: Iterable[str], arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the named buffers, with computed ones made from rendered arrays.

    Args:
        names: buffers to return.
        arrays: the arrays of `rendered_buffers(names)`.
    """
    return {name: _computed(name, arrays) for name in names}


# Not a closure in `complete`: one that calls itself is a reference cycle, which keeps arrays until the next collection.
def _computed(name: str, arrays: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    buffer = BUFFERS[name]
    if buffer.compute is None:
        return arrays[name]
    return buffer.compute(*(_computed(each, arrays) for each in buffer.inputs))


_OCCLUSION_TIME = {"forward_occlusion": NEXT, "backward_occlusion": PREVIOUS}


def times_needed(buffers: Iterable[str]) -> tuple[int, ...]:
    """Return the times of `tiscene.scene.placement` at which the scene must be placed to render some buffers."""
    return tuple(sorted({CURRENT} | {_OCCLUSION_TIME[name] for name in buffers if name in _OCCLUSION_TIME}))


def buffer_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of buffers, each once.

    Raises:
        ArgumentError: not a sequence of names, or an empty one.
        BufferNotFound: an unknown name.
    """
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise ArgumentError(f"buffers={names!r}: must be a sequence of names, such as ('rgb', 'depth')")
    wanted = tuple(names)
    for name in wanted:
        if not isinstance(name, str) or name not in BUFFERS:
            raise BufferNotFound("buffer", name, BUFFERS)
    if not wanted:
        raise ArgumentError("buffers=(): name at least one")
    return tuple(dict.fromkeys(wanted))
