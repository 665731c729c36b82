# SPDX-License-Identifier: Apache-2.0
"""StreamInterface: a Stream, as the modules that it is made of see it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from tiscene.frame.frame import Frame
from tiscene.render.render_settings import RenderSettings
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stage_cache import StageCache
from tiscene.stream.view_renderer import Pixels, ViewRenderer
from tiscene.world.world import World


class StreamInterface(Protocol):
    """The attributes and methods of a Stream that its mixins, its worker and its loaders use."""

    world: World
    frames: int | None
    fps: float
    width: int
    height: int
    seed: int
    buffers: tuple[str, ...]
    render_settings: RenderSettings
    shutter: tuple[float, float] | None
    time_code: float | None
    taxonomy: str | None
    stages: StageCache
    _cache_bytes: int
    _digest: tuple[int, str, str] | None
    _selected_categories: tuple[str, ...] | None
    _renderer: ViewRenderer

    @property
    def scenario(self) -> Scenario: ...
    @property
    def position(self) -> int: ...
    @property
    def arch(self) -> str | None: ...
    def __getitem__(self, index: int, /) -> Frame: ...
    def settings(self) -> dict[str, Any]: ...
    def restart(self, scenario: Scenario) -> None: ...
    def seek(self, index: int) -> Any: ...
    def file_digests(self) -> dict[str, str]: ...
    def _next(self, pixels: Sequence[Pixels] | None = None) -> Frame: ...
