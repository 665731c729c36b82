# SPDX-License-Identifier: Apache-2.0
"""SavedState: a stream's settings and position as a dict, which is checked before it continues; pickling; copies."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from tiscene.device import runtime
from tiscene.errors import ArgumentError
from tiscene.render.integrators.incremental.base_image_cache import digest_of
from tiscene.scenario.scenario import Scenario
from tiscene.stream.frame_batches import FrameBatches
from tiscene.stream.progress import ProgressBar
from tiscene.stream.render_ahead import RenderAhead
from tiscene.stream.stream_interface import StreamInterface
from tiscene.usd.core.layers import digest

VERSION = 1

# What to do about a setting that differs, by its name.
_CURES = {
    "scenario": "Make the stream from the saved scenario, edits included (stream.scenario.save(...)).",
    "lights": "Call set_light as before the state was taken.",
    "files": "The files of the scene or of a template have changed: restore them, or start again.",
}
_OTHER_CURE = "Pass the saved {0} to Stream(...)."


class SavedState:
    """The methods of a stream for checkpoints, for worker processes, and for further streams."""

    _digest: tuple[int, str, str] | None  # number of edits, and the digests of the scenario and of all files then

    def another(self: StreamInterface, scenario: Scenario) -> Any:
        """Return a stream of another scenario with the same settings, which shares the stages and trees that are kept.

        Raises:
            TisceneError: the scenario, its stage or a template is invalid.
        """
        other = object.__new__(type(self))
        vars(other).update({name: value for name, value in vars(self).items() if name not in ("world", "_renderer")})
        vars(other)["_ahead"] = RenderAhead(vars(self)["_ahead"].count)
        vars(other)["_batches"] = FrameBatches(vars(self)["_batches"].size)
        other.restart(scenario)
        return other

    def __getstate__(self: StreamInterface) -> dict[str, Any]:
        """Return everything except device arrays, which are made anew, the progress callback and the worker process."""
        kept = {name: value for name, value in vars(self).items() if name not in ("world", "_renderer", "_ahead")}
        own = {"_progress": ProgressBar(), "_batches": FrameBatches(kept["_batches"].size)}
        world = {"scenario": self.scenario, "lights": self.world.replaced_lights, "position": self.position}
        return kept | own | world

    def __setstate__(self: StreamInterface, state: dict[str, Any]) -> None:
        scenario, lights, position = (state.pop(name) for name in ("scenario", "lights", "position"))
        vars(self).update(state, _ahead=RenderAhead(0))
        runtime.start(self.arch)
        self.restart(scenario)
        for row, light in lights.items():
            self.world.set_light(row, light)
        self.seek(position)

    def settings(self: StreamInterface) -> dict[str, Any]:
        """Return everything that a frame depends on beside its index, JSON-ready.

        The scenario and the files of its stage and templates are given as SHA-256 digests, and so are the lights of
        `set_light`, if there are any.
        """
        edits = self.world.edit_count
        known = self._digest
        if known is None or known[0] != edits:
            canonical = json.dumps(self.scenario.to_json(), sort_keys=True, separators=(",", ":"))
            scenario = hashlib.sha256(canonical.encode()).hexdigest()
            self._digest = known = edits, scenario, digest(self.file_digests())
        lights = list(self.world.replaced_lights.items())
        return {
            "scenario": known[1],
            "files": known[2],
            "width": self.width,
            "height": self.height,
            "fps": self.fps,
            "seed": self.seed,
            **self.render_settings.to_json(self._cache_bytes),
            "shutter": None if self.shutter is None else list(self.shutter),
            "time_code": self.time_code,
            "taxonomy": self.taxonomy,
            "subdivision": self.stages.subdivision,
            "categories": None if self._selected_categories is None else list(self._selected_categories),
            **({"lights": digest_of(lights).hex()} if lights else {}),
        }

    def state_dict(self: StreamInterface) -> dict[str, Any]:
        """Return the stream's position and settings as JSON-ready values below 1 kB."""
        return {"version": VERSION, "position": self.position, "settings": self.settings()}

    def load_state_dict(self: StreamInterface, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken.

        Raises:
            ArgumentError: the state is of another stream; nothing has changed then.
        """
        check_state(state, self.settings())
        self.seek(state["position"])

    def file_digests(self: StreamInterface) -> dict[str, str]:
        """Return the SHA-256 of every file that the scene and the scenario's templates consist of.

        Returns:
            Digests by path relative to the scene's folder; a template's paths begin with its name and a colon.
        """
        scenario, on_stage = self.scenario, {template.name for template in self.world.stage.templates}
        templates = {history.spec.template for history in scenario.log().histories} - on_stage
        return self.stages.file_digests(scenario.scene, templates)


def check_state(state: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Check that a state is of a stream with the given settings.

    Args:
        state: of `Stream.state_dict`.
        settings: of `Stream.settings`.

    Raises:
        ArgumentError: it is not; the message says how to make the stream that it is of.
    """
    is_state = isinstance(state, Mapping) and isinstance(state.get("settings"), Mapping) and "position" in state
    if not is_state or state.get("version") != VERSION:
        raise ArgumentError(f"this is not a state_dict of this version of tiscene (version {VERSION})")
    saved = state["settings"]
    if different := differences(saved, settings):
        cures = " ".join(dict.fromkeys(_CURES.get(name, _OTHER_CURE.format(name)) for name in different))
        raise ArgumentError(f"the state is of another stream ({', '.join(different.values())}). {cures}")


def differences(saved: Mapping[str, Any], here: Mapping[str, Any]) -> dict[str, str]:
    """Return how settings differ, in words, by the names of those that do; those of a nested mapping one by one."""
    found: dict[str, str] = {}
    for name in {**saved, **here}:
        there, own = saved.get(name), here.get(name)
        if isinstance(there, Mapping) and isinstance(own, Mapping):
            found |= differences(there, own)
        elif there != own:
            found[name] = f"{name}: {there!r} there, {own!r} here"
    return found
