# SPDX-License-Identifier: Apache-2.0
"""Check of a saved state before a stream continues from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tiscene.errors import ArgumentError

VERSION = 1

# What to do about a setting that differs, by its name.
_CURES = {
    "scenario": "Make the stream from the saved scenario, edits included (stream.scenario.save(...)).",
    "files": "The files of the scene or of a template have changed: restore them, or start again.",
}
_OTHER_CURE = "Pass the saved {0} to Stream(...)."


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
    if different := [name for name in settings if saved.get(name) != settings[name]]:
        listing = ", ".join(f"{name}: {saved.get(name)!r} there, {settings[name]!r} here" for name in different)
        cures = " ".join(dict.fromkeys(_CURES.get(name, _OTHER_CURE.format(name)) for name in different))
        raise ArgumentError(f"the state is of another stream ({listing}). {cures}")
