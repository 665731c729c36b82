# SPDX-License-Identifier: Apache-2.0
"""Render the views of agents in the current frame of an environment.

Agents with equal cameras, sizes and backgrounds share buffers. A view depends on the world, on the agent's camera in
this frame and in its last one, and on whether it has walked; not on how long the agent has been there: an agent that
joins late gets the same bytes as one that has stood still.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from tiscene.render.film.tone_map import radiance_shown_as
from tiscene.render.view import SKY, View
from tiscene.sailenv import frame_views
from tiscene.sailenv.agent_camera import AgentCamera, FlowStep
from tiscene.sailenv.category_numbers import CategoryNumbers
from tiscene.sailenv.light_controls import Color8, linear
from tiscene.stream.stream import Stream


class AgentRenderer:
    """Renderer of agents' views of one frame, with its buffers.

    Attributes:
        frame: The frame; -1 for none.
    """

    def __init__(self, frame: int = -1, ambient: Color8 = (0, 0, 0)) -> None:
        """Render nothing.

        Args:
            frame: The frame.
            ambient: The color of the ambient light, 8-bit sRGB.
        """
        self.frame, self._ambient = frame, ambient
        self._buffers: dict[tuple[View, int | None], dict[str, NDArray[Any]]] = {}  # by view and start of the flow

    def render(
        self,
        stream: Stream,
        category_numbers: CategoryNumbers,
        agent: AgentCamera,
        step: FlowStep,
        views: Sequence[str],
        background: Color8 | None,
    ) -> dict[str, NDArray[Any]]:
        """Return views of the frame by name.

        Args:
            stream: The stream of the scene.
            category_numbers: Numbers of its categories.
            agent: The agent whose views are rendered.
            step: The agent's camera in this frame, and in the frame from which its flow is measured.
            views: Keys of `frame_views.VIEWS`.
            background: 8-bit sRGB color of pixels that show no object; None for the sky.
        """
        behind = SKY if background is None else radiance_shown_as(background, stream.exposure)
        view = View(
            step.previous,
            step.current,
            step.current,
            agent.width,
            agent.height,
            self._ambient_radiance(stream.exposure) if any(self._ambient) else (0.0, 0.0, 0.0),
            behind,
            is_dynamic=True,
            walks=agent.walks,
        )
        needed = {buffer for name in views for buffer in frame_views.VIEWS[name].buffers}
        if background is not None and "main" in views:
            needed.add("instance")
        buffers = self._buffers.setdefault((view, step.since), {})
        missing = sorted(needed - set(buffers))
        if missing:
            buffers.update(stream.render_view(self.frame, view, missing, since=step.since).buffers)
        numbers = category_numbers.table(stream.categories)
        result = {name: frame_views.VIEWS[name].convert(buffers, numbers) for name in views}
        if background is not None and "main" in result:
            frame_views.fill_background(result["main"], buffers["instance"], background)
        return result

    def _ambient_radiance(self, exposure: float) -> tuple[float, float, float]:
        """Return the radiance by which a white surface has the ambient color at an exposure."""
        r, g, b = (component * 2.0**-exposure for component in linear(self._ambient))
        return (r, g, b)
