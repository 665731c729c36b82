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
from tiscene.scenario.objects import Frustum, Object, check_dynamic
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride, ObjectOverride, Override
from tiscene.scenario.serialization import DerivedClasses
from tiscene.scene.camera import Camera


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


def check_objects(value: Any) -> tuple[Object, ...]:
    """Return objects as a tuple; their ids differ."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ScenarioError(f"objects={value!r}: must be a sequence of Object(id, template, ...)")
    rows: dict[str, int] = {}
    for row, each in enumerate(value):
        if not isinstance(each, Object):
            raise ScenarioError(f"objects[{row}]={each!r}: must be an Object(id, template, ...)")
        if each.id in rows:
            raise ScenarioError(f"objects[{row}].id={each.id!r}: objects[{rows[each.id]}] has this id already")
        rows[each.id] = row
    return tuple(value)


def check_edits(value: Any) -> tuple[Edit, ...]:
    """Return edits as a tuple."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ScenarioError(f"edits={value!r}: must be a sequence of Spawn, Despawn, Move, ...")
    for row, each in enumerate(value):
        if not isinstance(each, Edit):
            raise ScenarioError(
                f"edits[{row}]={each!r}: must be a Spawn, Despawn, Move, PlaceCamera or SetFrustumWalls"
            )
        if isinstance(each, SetFrustumWalls) and not isinstance(each.frustum, Frustum | None):
            raise ScenarioError(f"edits[{row}].frustum={each.frustum!r}: must be a Frustum or None")
        if isinstance(each, Spawn) and not isinstance(each.object, Object):
            raise ScenarioError(f"edits[{row}].object={each.object!r}: must be an Object(id, template, ...)")
    return tuple(value)


def check_variants(value: Any) -> dict[str, Any]:
    """Return variant selections as a dictionary."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ScenarioError(
            f'variants={value!r}: must map prims and sets to variants, as {{"/Room{{lighting}}": "night"}}'
        )
    return dict(value)


def check_lights(value: Any) -> tuple[LightMotion, ...]:
    """Return light motions as a tuple, one per light."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ScenarioError(f"lights={value!r}: must be a sequence of LightMotion")
    for row, each in enumerate(value):
        if not isinstance(each, LightMotion):
            raise ScenarioError(f"lights[{row}]={each!r}: must be a LightMotion")
        if each.light in [other.light for other in value[:row]]:
            raise ScenarioError(f"lights[{row}].light={each.light!r}: it has a motion already")
    return tuple(value)


def check_cameras(value: Any) -> Any:
    """One camera, as it is, or several as a tuple, whose names differ."""
    several = isinstance(value, Sequence) and not isinstance(value, str)
    cameras = tuple(value) if several else (value,)
    if several and (not cameras or not all(isinstance(each, Camera | str) for each in cameras)):
        raise ScenarioError(f"camera={value!r}: of several each must be a Camera or the name of one on the stage")
    names = [each.name if isinstance(each, Camera) else each for each in cameras]
    for row, each in enumerate(cameras):
        if not isinstance(each, Camera | str | None):
            raise ScenarioError(f"camera={each!r}: must be a Camera, the name of one on the stage, or None")
        if isinstance(each, Camera):
            check_dynamic(each.dynamic, f"camera[{row}].dynamic" if several else "camera.dynamic")
        if names[row] in names[:row]:
            raise ScenarioError(f"camera[{row}]: another one is called {names[row]!r} already")
    return cameras if several else value


def check_overrides(value: Any) -> tuple[Override, ...]:
    """Return overrides as a tuple, one per prim."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ScenarioError(f"overrides={value!r}: must be a sequence of overrides, such as LightOverride(...)")
    for row, each in enumerate(value):
        if not isinstance(each, Override):
            names = "CameraOverride, LightOverride, MaterialOverride or ObjectOverride"
            raise ScenarioError(f"overrides[{row}]={each!r}: must be a {names}")
        if any(type(each) is type(other) and each.prim == other.prim for other in value[:row]):
            raise ScenarioError(f"overrides[{row}].prim={each.prim!r}: another {type(each).__name__} has it already")
    return tuple(value)
