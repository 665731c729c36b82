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

try:
    from dynamics.cache_folder import set_cache_folder
    from dynamics.lazy_names import lazy_names
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
    "dynamics": (
        *("AllTogether", "CatmullWaypoints", "Composite", "DictTimings", "Keyframes", "LinearWaypoints", "LookAt"),
        *("Orbit", "RigidBody", "Stepped", "Still", "UniformMovementRandomBounce", "WaitUntilComplete", "Waypoint"),
    ),
    "tiscene.catalog": ("categories", "scenes", "templates"),
    "tiscene.errors": ("TisceneError",),
    "tiscene.export.distributed": ("distributed",),
    "tiscene.frame.frame": ("Frame",),
    "tiscene.learning.clock": ("Clock",),
    "tiscene.learning.course": ("Course",),
    "tiscene.learning.evaluation": ("evaluate",),
    "tiscene.learning.phase": ("Phase",),
    "tiscene.learning.supervision": ("Supervision",),
    "tiscene.scenario.joints": ("DistanceJoint", "FixedJoint", "PrismaticJoint", "RevoluteJoint", "SphericalJoint"),
    "tiscene.scenario.light_motion": ("LightMotion",),
    "tiscene.scenario.objects": ("Frustum", "Object"),
    "tiscene.scenario.overrides": ("CameraOverride", "LightOverride", "MaterialOverride", "ObjectOverride"),
    "tiscene.scenario.scenario": ("Scenario",),
    "tiscene.scene.camera": ("Camera",),
    "tiscene.scene.lens_keyframes": ("LensKeyframes",),
    "tiscene.stream.stream": ("Stream",),
    "tiscene.usd.core.limits": ("Limits",),
    "tiscene.world.world": ("World",),
}
__version__ = "0.2.0.dev0"
__getattr__, __dir__, __all__ = lazy_names(__name__, _MODULES)
__all__.insert(0, "__version__")
