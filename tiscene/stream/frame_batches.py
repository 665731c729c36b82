# SPDX-License-Identifier: Apache-2.0
"""FrameBatches: labels and path-traced light of several frames rendered at once, before they are asked for.

A GPU spends more time on launches than on a small frame. Everything else of a frame, such as denoising, is computed
when the frame is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tiscene.device import runtime
from tiscene.frame.frame import Frame
from tiscene.stream.stream_interface import StreamInterface
from tiscene.stream.view_renderer import Prepared, render_all_cameras
from tiscene.world.world_state import WorldState

MAX_PIXELS = 1 << 22  # of a batch; rays, hits and buffers of a pixel take about 200 bytes


class FrameBatches:
    """World states of frames, and what is rendered of them: frames that are asked for one after the other.

    After a seek or an edit of the world, what was rendered in vain is dropped.

    Args:
        size: frames that are rendered at once, at most; 1: none are rendered before they are asked for.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.clear()

    def clear(self) -> None:
        """Drop everything, since the world has changed."""
        self._made_with: tuple[Any, ...] = ()  # number of edits and replaced lights
        self._ready: dict[int, tuple[WorldState, list[Prepared]]] = {}

    @runtime.one_thread_at_a_time
    def first_of(self, stream: StreamInterface, indices: Sequence[int]) -> Frame:
        """Return the first of some frames; if the stream renders in batches, together with the following ones.

        Args:
            stream: the stream.
            indices: of the frames that will probably be asked for next.
        """
        if self.size == 1:
            return stream[indices[0]]
        renderer, buffers = stream._renderer, stream.buffers
        renderer.check_session()
        state, prepared = self._take(stream, indices)
        return render_all_cameras(renderer, state, buffers, stream.width, stream.height, prepared=prepared)

    def _take(self, stream: StreamInterface, indices: Sequence[int]) -> tuple[WorldState, list[Prepared]]:
        """Return the state of the world at the first of some frames, and what is rendered of it for each camera."""
        made_with = stream.world.edit_count, stream.world.replaced_lights
        if made_with != self._made_with or indices[0] not in self._ready:
            count = max(1, min(self.size, MAX_PIXELS // (stream.width * stream.height)))
            chosen = indices[:count]
            self.clear()
            states = [stream.world.state(index) for index in chosen]
            rendered = stream._renderer.render_batch(states, stream.buffers, stream.width, stream.height)
            self._ready = dict(zip(chosen, rendered, strict=True))
            self._made_with = made_with
        return self._ready.pop(indices[0])
