# SPDX-License-Identifier: Apache-2.0
"""Fields of a scenario: the classes that each may hold in a file, and checks of their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import dynamics
from dynamics import Dynamic
from tiscene.errors import ScenarioError
from tiscene.scenario.edits import Despawn, Edit, Move, PlaceCamera, SetFrustumWalls, Spawn
from tiscene.scenario.joints import DistanceJoint, FixedJoint, PrismaticJoint, RevoluteJoint, SphericalJoint
from tiscene.scenario.light_motion import LightMotion
from tiscene.scenario.objects import Frustum, Object, check_dynamic, check_each
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride, ObjectOverride, Override
from tiscene.scenario.serialization import DerivedClasses
from tiscene.scene.camera import Camera
from tiscene.scene.lens_keyframes import LensKeyframes


def classes(*classes: type) -> dict[str, type]:
    return {cls.__name__: cls for cls in classes}


# Trajectories: the library's, and every dataclass that a user derives from `Dynamic`.
_DYNAMICS = DerivedClasses(
    Dynamic,
    classes(
        dynamics.CatmullWaypoints,
        dynamics.Composite,
        dynamics.Keyframes,
        dynamics.LinearWaypoints,
        dynamics.LookAt,
        dynamics.Orbit,
        dynamics.RigidBody,
        dynamics.Still,
        dynamics.UniformMovementRandomBounce,
    ),
)
# Which classes a field holds, by its name; see `serialization.encode`.
FIELDS: dict[str, Mapping[str, type]] = {
    "camera": classes(Camera),
    "dynamic": _DYNAMICS,
    "edits": classes(Despawn, SetFrustumWalls, Move, PlaceCamera, Spawn),
    "frustum": classes(Frustum),
    "joints": classes(DistanceJoint, FixedJoint, PrismaticJoint, RevoluteJoint, SphericalJoint),
    "lens": classes(LensKeyframes),
    "lights": classes(LightMotion),
    "motion": _DYNAMICS,
    "object": classes(Object),
    "objects": classes(Object),
    "overrides": classes(CameraOverride, LightOverride, MaterialOverride, ObjectOverride),
    "parts": _DYNAMICS,
    "timings": classes(dynamics.AllTogether, dynamics.DictTimings, dynamics.WaitUntilComplete),
    "variants": {},
    "waypoints": classes(dynamics.Waypoint),
}


def check_objects(value: Any, name: str) -> tuple[Object, ...]:
    """Return objects as a tuple; their ids differ."""
    objects = check_each(value, name, Object, "Object(id, template, ...)", "an Object(id, template, ...)")
    rows: dict[str, int] = {}
    for row, each in enumerate(objects):
        if each.id in rows:
            raise ScenarioError(f"{name}[{row}].id={each.id!r}: {name}[{rows[each.id]}] has this id already")
        rows[each.id] = row
    return objects


def check_edits(value: Any, name: str) -> tuple[Edit, ...]:
    """Return edits as a tuple."""
    kinds = "a Spawn, Despawn, Move, PlaceCamera or SetFrustumWalls"
    return check_each(value, name, Edit, "Spawn, Despawn, Move, ...", kinds)


def check_variants(value: Any, name: str) -> dict[str, Any]:
    """Return variant selections as a dictionary."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ScenarioError(
            f'{name}={value!r}: must map prims and sets to variants, as {{"/Room{{lighting}}": "night"}}'
        )
    return dict(value)


def check_lights(value: Any, name: str) -> tuple[LightMotion, ...]:
    """Return light motions as a tuple, one per light."""
    motions = check_each(value, name, LightMotion, "LightMotion", "a LightMotion")
    for row, each in enumerate(motions):
        if each.light in [other.light for other in motions[:row]]:
            raise ScenarioError(f"{name}[{row}].light={each.light!r}: it has a motion already")
    return motions


def check_cameras(value: Any, name: str) -> Any:
    """One camera, as it is, or several as a tuple, whose names differ."""
    several = isinstance(value, Sequence) and not isinstance(value, str)
    cameras = tuple(value) if several else (value,)
    if several and (not cameras or not all(isinstance(each, Camera | str) for each in cameras)):
        raise ScenarioError(f"{name}={value!r}: of several each must be a Camera or the name of one on the stage")
    names = [each.name if isinstance(each, Camera) else each for each in cameras]
    for row, each in enumerate(cameras):
        if not isinstance(each, Camera | str | None):
            raise ScenarioError(f"{name}={each!r}: must be a Camera, the name of one on the stage, or None")
        if isinstance(each, Camera):
            check_dynamic(each.dynamic, f"{name}[{row}].dynamic" if several else f"{name}.dynamic")
        if names[row] in names[:row]:
            raise ScenarioError(f"{name}[{row}]: another one is called {names[row]!r} already")
    return cameras if several else value


def check_overrides(value: Any, name: str) -> tuple[Override, ...]:
    """Return overrides as a tuple, one per prim."""
    kinds = "a CameraOverride, LightOverride, MaterialOverride or ObjectOverride"
    overrides = check_each(value, name, Override, "overrides, such as LightOverride(...)", kinds)
    for row, each in enumerate(overrides):
        if any(type(each) is type(other) and each.prim == other.prim for other in overrides[:row]):
            raise ScenarioError(f"{name}[{row}].prim={each.prim!r}: another {type(each).__name__} has it already")
    return overrides
