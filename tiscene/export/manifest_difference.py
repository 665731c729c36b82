# SPDX-License-Identifier: Apache-2.0
"""Differences between how a folder was made and how it would be made now, and the arguments that would remove them.

An export into a folder with frames of other settings is refused. The message lists what differs and names the arguments
with which the earlier export can be continued.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# Arguments of `Stream` and `export` whose values a manifest holds under their own names.
_ARGUMENTS = (
    *("format", "buffers", "objects", "width", "height", "fps", "seed", "spp", "max_depth", "relative_error", "clamp"),
    *("pixel_filter", "shutter", "time_code", "variants", "taxonomy", "incremental", "camera"),
)
_SWITCHES = {"denoiser": "denoise", "incremental": "incremental"}  # settings that hold more than True or False


@dataclass(frozen=True)
class Difference:
    """One value that differs.

    Attributes:
        key: The place in the manifest, such as "settings.seed".
        there: The value in the folder's manifest.
        now: The value that was asked for.
    """

    key: str
    there: Any
    now: Any

    def __str__(self) -> str:
        return f"{self.key}: {_shortened(self.there)} there, {_shortened(self.now)} now"


def differences(there: Any, now: Any, key: str = "") -> list[Difference]:
    """Compare two trees of JSON values; return the leaves that differ, sorted by key."""
    if isinstance(there, dict) and isinstance(now, dict):
        found = []
        for name in sorted({*there, *now}):
            found += differences(there.get(name), now.get(name), f"{key}.{name}" if key else name)
        return found
    return [] if there == now else [Difference(key, there, now)]


def cure(found: Sequence[Difference], there: Mapping[str, Any]) -> str:
    """Return a sentence that says how to continue the earlier export.

    Args:
        found: What differs.
        there: The folder's manifest without its frames.
    """
    arguments: dict[str, Any] = {}
    steps: list[str] = []
    for each in found:
        top, name = (*each.key.split("."), "")[:2]
        value = there[top].get(name) if name else each.there
        if top == "tiscene":
            steps.append(f"use tiscene {value}")
        elif top == "file_digests":
            steps.append("restore the files of the scene that have changed since")
        elif name in _SWITCHES:
            arguments[_SWITCHES[name]] = bool(value)
        elif (name or top) in _ARGUMENTS and (name == "variants" or not isinstance(value, dict)):
            arguments[name or top] = value
        elif top == "scenario":
            steps.append("use the scenario of that export")
        elif each.key != "settings.scenario":  # a digest of what is listed under "scenario"
            steps.append("pass the quality of that export")
    if arguments:
        python = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
        options = " ".join(_option(name, value) for name, value in arguments.items())
        steps.insert(0, f"pass {python} ({options})")
    return f"To continue that export, {' and '.join(dict.fromkeys(steps))}. " if steps else ""


def _option(name: str, value: Any) -> str:
    """Return an argument as an option of `tiscene render`; without a value if it is to be left out."""
    option = f"--{name.replace('_', '-')}"
    if isinstance(value, bool):
        return option if value else f"--no-{name}"
    if value is None or value == {}:
        return f"no {'--variant' if name == 'variants' else option}"
    if name == "variants":
        return " ".join(f"--variant '{place}={choice}'" for place, choice in value.items())
    return f"{option} {','.join(map(str, value)) if isinstance(value, list) else value}"


def _shortened(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
