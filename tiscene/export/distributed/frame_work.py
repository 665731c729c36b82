# SPDX-License-Identifier: Apache-2.0
"""FrameWork: render an export in shards, each of which is a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tiscene.export.distributed.task_plan import task_size
from tiscene.export.exporter import export, provenance
from tiscene.export.manifest import listed_frames
from tiscene.export.shards import Shard, machine

if TYPE_CHECKING:
    from tiscene.scenario.scenario import Scenario
    from tiscene.stream.stream import Stream


@dataclass(eq=False)
class FrameWork:
    """Renders frames into shards of an export. A worker keeps its stream, so that caches fit the next shard too.

    Attributes:
        source: As of Stream.
        settings: Further arguments of Stream.
        folder: The folder of the export.
        frames: All frames.
        format: As of `export`.
        objects: As of `export`.
        overwrite: As of `export`.
    """

    source: str | Path | Scenario
    settings: Mapping[str, Any]
    folder: Path
    frames: range
    format: str
    objects: str | None
    overwrite: bool
    _stream: Stream | None = field(default=None, init=False)
    _machine: dict[str, str] = field(default_factory=dict, init=False)

    @property
    def count(self) -> int:
        """Number of tasks."""
        return -(-len(self.frames) // task_size(len(self.frames)))

    def shard(self, task: int) -> Shard:
        """Return the shard that a task renders."""
        return Shard(task, self.count, (self.frames.start, self.frames.stop, self.frames.step), self._machine)

    def open(self) -> dict[str, Any]:
        """Make the stream. Returns what its frames depend on."""
        from tiscene.stream.stream import Stream

        self._stream, self._machine = Stream(self.source, **self.settings), machine()
        return provenance(self._stream, self.format, self.objects)

    def run(self, task: int, check: Callable[[], None]) -> None:
        """Render a shard."""
        assert self._stream is not None
        shard = self.shard(task)
        folder = shard.folder(self.folder)
        shard.save(folder)  # first, so that a merge misses the frames of a killed shard
        export(
            self._stream,
            folder,
            format=self.format,
            frames=shard.own_frames,
            objects=self.objects,
            overwrite=self.overwrite,
            pack=False,
            progress=lambda *_: check(),
        )

    def size(self, task: int) -> int:
        """Return the number of frames of a task."""
        return len(self.shard(task).own_frames)

    def steps(self, task: int) -> int:
        """Return the number of frames of a task that are there."""
        return len(listed_frames(self.shard(task).folder(self.folder)))
