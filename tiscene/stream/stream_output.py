# SPDX-License-Identifier: Apache-2.0
"""StreamOutput: methods of Stream for USD programs, notebooks and point tracks."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.errors import ArgumentError
from tiscene.frame.frame import Frame
from tiscene.render.render_settings import RenderSettings
from tiscene.scenario.scenario import Scenario
from tiscene.usd.scenario.bake import write_motion
from tiscene.world.world import World

if TYPE_CHECKING:
    from tiscene.render.view import View
    from tiscene.scene.placement import Placement
    from tiscene.stream.view_renderer import ViewRenderer


class OutputSource(Protocol):
    """What the methods need of a Stream."""

    @property
    def world(self) -> World: ...
    @property
    def scenario(self) -> Scenario: ...
    @property
    def frames(self) -> int | None: ...
    @property
    def fps(self) -> float: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def seed(self) -> int: ...
    @property
    def position(self) -> int: ...
    @property
    def buffers(self) -> tuple[str, ...]: ...
    @property
    def render_settings(self) -> RenderSettings: ...
    @property
    def _renderer(self) -> ViewRenderer: ...
    def __getitem__(self, index: int, /) -> Frame: ...


class StreamOutput:
    """A stream as a USD layer, as a table in a notebook, and the labels of a few of its pixels."""

    @runtime.one_thread_at_a_time
    def label_pixels(
        self: OutputSource, placement: Placement, view: View, buffers: Sequence[str], pixels: NDArray[Any]
    ) -> Mapping[str, NDArray[Any]]:
        """Render label buffers of some pixels of a view: with few pixels much faster than `render_view`.

        Args:
            placement: the instances, such as `stream.world.state(12).placement`; its `since` chooses the frame from
                which `backward_flow` is measured.
            view: the camera at the three times of the placement, and the image size.
            buffers: names of label buffers.
            pixels: bool [h, w], True where the buffers are computed; elsewhere their values are undefined.
        """
        return self._renderer.label_pixels(placement, view, buffers, pixels)

    def to_usd(self: OutputSource, path: str | os.PathLike[str], frames: int | Iterable[int] | None = None) -> None:
        """Write the motion as a USD layer over the scene (.usda, .usdc, .usd), to be played by any USD program.

        Objects are references to their templates, with time samples of pose and visibility. Nothing is rendered.

        Args:
            path: of the layer.
            frames: their number, from 0 on, or their indices; None: all of a finite stream. Time code k is frame k.
        """
        frames = self.frames if frames is None else frames
        if frames is None:
            raise ArgumentError("frames=None: an endless stream cannot be written whole; pass frames=N")
        write_motion(self.world, path, frames)

    def _repr_html_(self: OutputSource) -> str:
        """Return a table for notebooks: scene, size, length, objects and settings. Nothing is rendered."""
        settings = self.render_settings
        objects = ", ".join(f"{each.id} ({each.template})" for each in self.scenario.objects) or "those of the stage"
        length = "endless" if self.frames is None else f"{self.frames} frames, {self.frames / self.fps:g} s"
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
