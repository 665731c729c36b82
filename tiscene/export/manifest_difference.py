# SPDX-License-Identifier: Apache-2.0
"""Differences between how a folder was made and how it would be made now, and the arguments that would remove them.

An export into a folder with frames of other settings is refused. The message lists what differs and names the arguments
with which the earlier export can be continued.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# Arguments of `Stream` and `export` whose values a manifest holds under their own names.
_ARGUMENTS = (
    *("format", "buffers", "objects", "width", "height", "fps", "seed", "spp", "max_depth", "relative_error", "clamp"),
    *("pixel_filter", "shutter", "time_code", "variants", "taxonomy", "categories", "subdivision", "camera"),
)
_SWITCHES = {"denoiser": "denoise", "incremental": "incremental"}  # None where the switch is off
_PRESET_ARGUMENTS = ("spp", "max_depth", "denoise", "incremental")  # parts of a quality preset


@dataclass(frozen=True)
class Difference:
    """One value that differs.

    Attributes:
        key: The place in the manifest, such as "settings.seed".
        there: The value in the folder's manifest.
        now: The requested value.
    """

    key: str
    there: Any
    now: Any

    def __str__(self) -> str:
        return f"{self.key}: {_shortened(self.there)} in the folder, {_shortened(self.now)} requested"


def differences(there: Any, now: Any, key: str = "") -> list[Difference]:
    """Return the leaves in which two trees of JSON values differ, sorted by key.

    The digest `settings.scenario` is left out: the contents of `scenario` show the difference.
    """
    if isinstance(there, dict) and isinstance(now, dict):
        found = []
        for name in sorted({*there, *now}):
            found += differences(there.get(name), now.get(name), f"{key}.{name}" if key else name)
        return found
    return [] if there == now or key == "settings.scenario" else [Difference(key, there, now)]


def listing(found: Iterable[object]) -> str:
    """Return each difference on a line of its own, for the end of an error message."""
    return "".join(f"\n  {each}" for each in found)


def cure(found: Sequence[Difference], there: Mapping[str, Any]) -> str:
    """Return a sentence that says how to continue the earlier export.

    Args:
        found: What differs.
        there: The folder's manifest without its frames.
    """
    arguments: dict[str, Any] = {}
    steps: list[str] = []
    quality, scenario = (
        "pass the quality of that export (--quality)",
        "use the scenario of that export, which is another",
    )
    for each in found:
        top, name = (*each.key.split("."), "")[:2]
        value = there[top].get(name) if name else each.there
        if top == "tiscene":
            steps.append(f"use tiscene {value}")
        elif top == "name":
            steps.append("let `tiscene generate` continue its data set")
        elif top == "file_digests" or each.key == "settings.files":
            steps.append("restore the files of the scene that have changed since")
        elif each.key == "settings.lights":
            steps.append("replace its lights as for that export (set_light)")
        elif name in _SWITCHES and (each.there is None or each.now is None):
            arguments[_SWITCHES[name]] = value is not None
        elif top == "scenario" and (name != "variants" if name != "camera" else _has_pose(value, each.now)):
            steps.append(scenario)
        elif (name or top) in _ARGUMENTS:
            arguments[name or top] = value
        else:
            steps.append(quality)
    if quality in steps:
        arguments = {name: value for name, value in arguments.items() if name not in _PRESET_ARGUMENTS}
    if scenario in steps:  # which has its camera and variants
        arguments = {name: value for name, value in arguments.items() if name not in ("camera", "variants")}
    if arguments:
        python = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
        steps.insert(0, f"pass {python} ({_options(arguments)})")
    return f"To continue that export, {' and '.join(dict.fromkeys(steps))}. "


def _has_pose(*cameras: Any) -> bool:
    """Return whether one of some cameras of scenarios, each None, a name, a mapping or a list of these, has a pose."""
    return any(_has_pose(*each) if isinstance(each, list) else isinstance(each, Mapping) for each in cameras)


def _options(arguments: Mapping[str, Any]) -> str:
    """Return arguments as options of `tiscene render`."""
    given, omitted = [], []
    for name, value in arguments.items():
        option = "--variant" if name == "variants" else f"--{name.replace('_', '-')}"
        if name == "variants" and value:
            given += [f"{option} '{place}={variant}'" for place, variant in value.items()]
        elif value is None or value == {}:
            omitted.append(option)
        elif isinstance(value, bool):
            given.append(option if value else f"--no-{name}")
        else:
            given.append(f"{option} {','.join(map(str, value)) if isinstance(value, list) else value}")
    return ", ".join([" ".join(given)] * bool(given) + ["without " + " ".join(omitted)] * bool(omitted))


def _shortened(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
