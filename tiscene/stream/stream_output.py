# SPDX-License-Identifier: Apache-2.0
"""StreamOutput: methods of Stream for USD programs, notebooks and point tracks."""

from __future__ import annotations

import os
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.errors import ArgumentError, counted
from tiscene.stream.motion_recording import record_motion
from tiscene.stream.stream_interface import StreamInterface
from tiscene.usd.scenario.bake import write_motion

if TYPE_CHECKING:
    from tiscene.render.integrators.labels.point_pass import SurfacePoints
    from tiscene.render.view import View
    from tiscene.scene.placement import Placement


class StreamOutput:
    """A stream as a USD layer, as a table in a notebook, and points of its surfaces."""

    @runtime.one_thread_at_a_time
    def surface_points(
        self: StreamInterface, placement: Placement, view: View, x: NDArray[np.int64], y: NDArray[np.int64]
    ) -> SurfacePoints:
        """Return the points of surfaces at the centers of pixels, to `follow` them through frames.

        Args:
            placement: the instances, such as `stream.world.state(12).placement`.
            view: the camera at that frame, and the image size.
            x: columns of the pixels, int64 [n].
            y: rows of the pixels, int64 [n].
        """
        return self._renderer.surface_points(placement, view, x, y)

    @runtime.one_thread_at_a_time
    def follow(
        self: StreamInterface, points: SurfacePoints, placement: Placement, view: View
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return where points of surfaces are in another frame, and whether they are hidden there: exactly, by a ray.

        Args:
            points: of `surface_points`.
            placement: the instances at the other frame.
            view: the camera at the other frame, and the image size.

        Returns:
            float64 [n, 2], x and y, px, with pixel centers at halves, also where a point is hidden or out of view;
            bool [n], True where it is not visible.
        """
        return self._renderer.follow(points, placement, view)

    def to_usd(self: StreamInterface, path: str | os.PathLike[str], frames: int | Iterable[int] | None = None) -> None:
        """Write the motion as a USD layer over the scene (.usda, .usdc, .usd), to be played by any USD program.

        Objects are references to their templates, with time samples of pose and visibility. Nothing is rendered.

        Args:
            path: of the layer.
            frames: their number, from 0 on, or their indices; None: all of a finite stream. Time code k is frame k.
        """
        frames = self.frames if frames is None else frames
        if frames is None:
            raise ArgumentError("frames=None: an endless stream cannot be written whole; pass frames=N")
        write_motion(record_motion(self.world, frames), path)

    def _repr_html_(self: StreamInterface) -> str:
        """Return a table for notebooks: scene, size, length, objects and settings. Nothing is rendered."""
        settings = self.render_settings
        objects = ", ".join(f"{each.id} ({each.template})" for each in self.scenario.objects) or "those of the stage"
        length = "endless" if self.frames is None else f"{counted(self.frames, 'frame')}, {self.frames / self.fps:g} s"
        rows: dict[str, Any] = {
            "scene": self.scenario.scene,
            "objects": objects,
            "picture": f"{self.width} × {self.height} px, {self.fps:g} frames/s",
            "length": length,
            "next frame": self.position,
            "buffers": ", ".join(self.buffers),
            "rendering": f"{settings.spp} samples per pixel, {settings.max_depth} segments, seed {self.seed}",
        }
        cells = "".join(
            f'<tr><th style="text-align:left">{name}</th><td style="text-align:left">{escape(str(value))}</td></tr>'
            for name, value in rows.items()
        )
        return f"<b>tiscene.Stream</b><table>{cells}</table>"
