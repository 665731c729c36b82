# SPDX-License-Identifier: Apache-2.0
"""StreamPool: streams of several scenarios with the same settings, which share the stages that they have read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream

MAX_STREAMS = 4  # whose device arrays are kept; the least recently used one is closed


class StreamPool:
    """Streams by scenario, for which nothing is compiled again.

    A stage that was read recently is not read again, unless one of its layers or textures has changed.

    Args:
        settings: keyword arguments of `Stream`, without `frames`.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._settings = dict(settings)
        self._first: Stream | None = None
        self._streams: dict[str, Stream] = {}
        self.categories: tuple[str, ...] | None = self._settings.get("categories")

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs to read all stages again, without the progress callback."""
        return {"settings": without_progress(self._settings), "categories": self.categories}

    def __setstate__(self, state: dict[str, Any]) -> None:
        StreamPool.__init__(self, state["settings"])
        self.categories = state["categories"]

    def share_categories(self, scenarios: Iterable[Scenario]) -> tuple[str, ...]:
        """Return the categories whose ids are 1, 2, ... in all streams.

        These are the ones of the settings, else all that occur in some scenarios, in alphabetical order.
        """
        if self.categories is None:
            names: set[str] = set()
            for scenario in scenarios:
                with self._new(scenario) as stream:
                    names |= set(stream.categories.values())
            self.categories = tuple(sorted(names - {""}))
        return self.categories

    def stream(self, key: str, scenario: Scenario) -> Stream:
        """Return the stream of a scenario, made if it is not there.

        Args:
            key: names the scenario; equal keys mean equal scenarios.
            scenario: the scenario.
        """
        stream = self._streams.pop(key, None)
        if stream is None:
            stream = self._new(scenario)
        self._streams[key] = stream
        while len(self._streams) > MAX_STREAMS:
            self._streams.pop(next(iter(self._streams))).close()
        return stream

    def _new(self, scenario: Scenario) -> Stream:
        if self._first is None:
            self._first = Stream(scenario, **self._settings)
            self._first.close()
        self._first._selected_categories = self.categories or None
        stream: Stream = self._first.another(scenario)
        return stream

    def close(self) -> None:
        """Free the memory of all streams. They are made again when they are needed."""
        for stream in self._streams.values():
            stream.close()
        self._streams.clear()


def without_progress(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings without the progress callback, which a copy does not have, as that of a stream."""
    return {name: value for name, value in settings.items() if name != "progress"}
