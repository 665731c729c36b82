# SPDX-License-Identifier: Apache-2.0
"""tiscene: endless, exactly repeatable streams of path-traced, labeled frames from USD scenes.

`Stream` renders a scene or a `Scenario`; `scenes()`, `templates()` and `categories()` list what the catalog
has. Names are imported at first use, so that `import tiscene` is fast and does not start Taichi.

Packages, from the user's side down::

    cli            command line
    export         frames to files
    sailenv        SAILenv's API and wire protocol
    learning       continual learning: supervision, courses, drift, evaluation
    stream         streams of frames: iteration, random access, state
    randomization  random scenarios
    world          state of objects, cameras and lights at each frame
    render         labels, path tracing, incremental rendering, film
    frame          frames, buffers, object tables, events
    scenario       scenarios: objects, timings, edits, files
    usd            USD files to scene descriptions and back
    scene          scene data: on the host, and as device arrays
    device         start-up and memory of Taichi
    catalog        scenes, templates and categories by name
    errors, files

Two packages stand beside this one: `dynamics` simulates motion, `usd_scenes` contains the shipped scenes.
"""

from __future__ import annotations

import os
from typing import Any

try:
    from dynamics.cache_folder import set_cache_folder
    from dynamics.lazy_names import import_name
except ImportError as error:
    import dynamics

    place = getattr(dynamics, "__file__", None) or dynamics
    raise ImportError(
        f"tiscene needs its own package `dynamics`, which {place!r} hides: rename that file or folder"
    ) from error

# Before Taichi is first imported: without these it prints a banner, looks up its newest version on the network, and
# notes in a notebook that it prints there after each kernel.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_ENABLE_PYBUF", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

set_cache_folder()

_MODULES = {
    "AllTogether": "dynamics",
    "Camera": "tiscene.scene.camera",
    "CameraOverride": "tiscene.scenario.overrides",
    "CatmullWaypoints": "dynamics",
    "Clock": "tiscene.learning.clock",
    "Composite": "dynamics",
    "Course": "tiscene.learning.course",
    "DictTimings": "dynamics",
    "DistanceJoint": "tiscene.scenario.joints",
    "FixedJoint": "tiscene.scenario.joints",
    "Frame": "tiscene.frame.frame",
    "Frustum": "tiscene.scenario.objects",
    "Keyframes": "dynamics",
    "LensKeyframes": "tiscene.scene.lens_keyframes",
    "LightMotion": "tiscene.scenario.light_motion",
    "LightOverride": "tiscene.scenario.overrides",
    "Limits": "tiscene.usd.core.limits",
    "LinearWaypoints": "dynamics",
    "LookAt": "dynamics",
    "MaterialOverride": "tiscene.scenario.overrides",
    "Object": "tiscene.scenario.objects",
    "ObjectOverride": "tiscene.scenario.overrides",
    "Orbit": "dynamics",
    "Phase": "tiscene.learning.phase",
    "PrismaticJoint": "tiscene.scenario.joints",
    "RevoluteJoint": "tiscene.scenario.joints",
    "RigidBody": "dynamics",
    "Scenario": "tiscene.scenario.scenario",
    "Stepped": "dynamics",
    "SphericalJoint": "tiscene.scenario.joints",
    "Still": "dynamics",
    "Stream": "tiscene.stream.stream",
    "Supervision": "tiscene.learning.supervision",
    "TisceneError": "tiscene.errors",
    "UniformMovementRandomBounce": "dynamics",
    "WaitUntilComplete": "dynamics",
    "Waypoint": "dynamics",
    "World": "tiscene.world.world",
    "categories": "tiscene.catalog",
    "distributed": "tiscene.export.distributed",
    "evaluate": "tiscene.learning.evaluation",
    "scenes": "tiscene.catalog",
    "templates": "tiscene.catalog",
}
__all__ = ["__version__", *sorted(_MODULES)]
__version__ = "0.2.0.dev0"


def __getattr__(name: str) -> Any:
    return import_name(__name__, _MODULES, name)


def __dir__() -> list[str]:
    return __all__
