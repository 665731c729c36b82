# SPDX-License-Identifier: Apache-2.0
"""Objects of a scenario and the frustum that bounds them."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any

from dynamics import Dynamic, RigidBody, Still, argument_checks
from tiscene.errors import ScenarioError, scenario_errors
from tiscene.scene.camera import Vector3


@dataclass(frozen=True, slots=True)
class Object:
    """One object of a template, alive from `first_frame` to `last_frame`.

    Attributes:
        id: name in the scenario, unique.
        template: name ("Chair 01") or file of its template, or the path of a prim on the stage, which then moves.
        position: m, world; the authored place of a prim of the stage is not kept.
        rotation: Euler angles (x, y, z), degrees, or a quaternion (w, x, y, z).
        dynamic: trajectory; None: none.
        first_frame: first frame at which it is alive.
        last_frame: last frame at which it is alive; None: for ever.
        frustum_limited: whether the walls of the scenario's frustum hold it, if it collides.
        collide: whether it collides with the stage, other objects and walls. Bouncing objects are reflected; objects on
            paths slide along until they can return to their path. False: it passes through everything.
        scale: one factor, or one per axis of the object.

    Raises:
        ScenarioError: a value is out of range.
    """

    id: str
    template: str
    position: Vector3 = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)
    dynamic: Dynamic | None = None
    first_frame: int = 0
    last_frame: int | None = None
    frustum_limited: bool = True
    collide: bool = True
    scale: float | Vector3 = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        with scenario_errors():
            argument_checks.text(self.id, "id")
            object.__setattr__(self, "template", argument_checks.text(self.template, "template"))
            object.__setattr__(self, "position", argument_checks.vector(self.position, "position"))
            object.__setattr__(self, "rotation", argument_checks.rotation(self.rotation, "rotation"))
            check_dynamic(self.dynamic, "dynamic")
            object.__setattr__(self, "first_frame", argument_checks.integer(self.first_frame, "first_frame", 0))
            if self.last_frame is not None:
                object.__setattr__(self, "last_frame", argument_checks.integer(self.last_frame, "last_frame", 0))
                if self.last_frame < self.first_frame:
                    raise ScenarioError(
                        f"last_frame={self.last_frame} is before first_frame={self.first_frame}; both are inclusive"
                    )
            argument_checks.flag(self.frustum_limited, "frustum_limited")
            argument_checks.flag(self.collide, "collide")
            object.__setattr__(self, "scale", _check_scale(self.scale))

    def alive(self, frame: int) -> bool:
        """Return whether the object is alive at a frame, without regard to edits."""
        return self.first_frame <= frame and (self.last_frame is None or frame <= self.last_frame)


@dataclass(frozen=True)
class Frustum:
    """Invisible walls at the sides of the main camera's view, its near plane and `far`, that keep objects in view.

    Attributes:
        far: distance of the far wall along the camera's axis, m; -1: the camera's far plane.
    """

    far: float = -1.0

    def __post_init__(self) -> None:
        with scenario_errors():
            far = argument_checks.number(self.far, "far")
            if far <= 0.0 and far != -1.0:
                raise ScenarioError(f"far={self.far!r}: must be greater than 0, or -1 for the camera's own")
            object.__setattr__(self, "far", far)


def path_of(each: Object) -> Dynamic:
    """Return the path that timings apply to; an object without a trajectory, or a rigid body, stands still."""
    return Still() if isinstance(each.dynamic, RigidBody | None) else each.dynamic


def check_dynamic(value: Any, name: str) -> None:
    if not isinstance(value, Dynamic | None):
        hint = " (an instance, not the class)" if isinstance(value, type) else ""
        raise ScenarioError(f"{name}={value!r}: must be a dynamic{hint}, such as CatmullWaypoints(...), or None")


def _check_scale(value: Any) -> Vector3:
    one = isinstance(value, Real) and not isinstance(value, bool)
    scale = argument_checks.vector((value,) * 3 if one else value, "scale")
    if min(scale) <= 0.0:
        raise ScenarioError(f"scale={value!r}: must be greater than 0")
    return scale
