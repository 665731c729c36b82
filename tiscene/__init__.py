"""tiscene: endless, exactly repeatable streams of path-traced, labelled frames from USD scenes.

Names are imported at first use, so that `import tiscene` is instant and starts no Taichi.

From what a user meets down to the ground::

    cli, commands, sailenv, export        what people run and take away
    stream, frame, frame_range            one frame after another
        loading, waiting                  how a stage comes, and the bar meanwhile
        differential, shutter             how its pictures are made: as differences, blurred
    world                                 where everything is at each frame
        inventory, stage_things, tracks   what there is, what edits did to the stage, what moves by itself
        motion, lighting                  objects and cameras, lights
        witness, in_view, events          what happened
    scenario, edits, light_motion         what is asked for
        scenario_json                     as a file
        sampling, difficulty, free_space  drawn at random
    render                                what is seen
    usd, catalog                          what the files say, and where they are
    scene                                 what the files said, on the host and on the device
    device, camera, errors, arguments, files, srgb

`dynamics`, which moves bodies, and `usd_scenes`, the scenes, are packages beside this one.
"""

from __future__ import annotations

import importlib
import os
from typing import Any

# Taichi prints a banner and asks the network for its newest version unless told not to, before its first import.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

_HOME = {
    "AllTogether": "dynamics",
    "Camera": "tiscene.camera",
    "CatmullWaypoints": "dynamics",
    "Composite": "dynamics",
    "DictTimings": "dynamics",
    "Frame": "tiscene.frame.frame",
    "Frustum": "tiscene.scenario.objects",
    "Keyframes": "dynamics",
    "LightMotion": "tiscene.scenario.light_motion",
    "LinearWaypoints": "dynamics",
    "LookAt": "dynamics",
    "Object": "tiscene.scenario.objects",
    "Orbit": "dynamics",
    "Scenario": "tiscene.scenario.scenario",
    "Stepped": "dynamics",
    "Still": "dynamics",
    "Stream": "tiscene.stream.stream",
    "TisceneError": "tiscene.errors",
    "UniformMovementRandomBounce": "dynamics",
    "WaitUntilComplete": "dynamics",
    "Waypoint": "dynamics",
    "World": "tiscene.world.world",
}
__all__ = ["__version__", *sorted(_HOME)]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tiscene' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
