# SPDX-License-Identifier: Apache-2.0
"""Objects of a scenario and the frustum that bounds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from dynamics import Dynamic, RigidBody, Still
from dynamics.argument_checks import flag, index, number, optional, position, rotation, set_checked, text, vector
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
            set_checked(self, id=text, template=text, position=position, rotation=rotation)
            check_dynamic(self.dynamic, "dynamic")
            set_checked(self, first_frame=index, last_frame=optional(index))
            if self.last_frame is not None and self.last_frame < self.first_frame:
                raise ScenarioError(
                    f"last_frame={self.last_frame} is before first_frame={self.first_frame}; both are inclusive"
                )
            set_checked(self, frustum_limited=flag, collide=flag, scale=_scale)

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
            set_checked(self, far=_far)


def path_of(each: Object) -> Dynamic:
    """Return the path that timings apply to; an object without a trajectory, or a rigid body, stands still."""
    return Still() if isinstance(each.dynamic, RigidBody | None) else each.dynamic


def check_dynamic(value: Any, name: str) -> None:
    if not isinstance(value, Dynamic | None):
        hint = " (an instance, not the class)" if isinstance(value, type) else ""
        raise ScenarioError(f"{name}={value!r}: must be a dynamic{hint}, such as CatmullWaypoints(...), or None")


def check_each(value: Any, name: str, kinds: Any, several: str, one: str) -> tuple[Any, ...]:
    """Return a sequence of instances as a tuple.

    Args:
        value: the sequence.
        name: of the argument, for error messages.
        kinds: the class of each, or classes.
        several: what the sequence must be of, for error messages.
        one: what each must be, for error messages.
    """
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ScenarioError(f"{name}={value!r}: must be a sequence of {several}")
    for row, each in enumerate(value):
        if not isinstance(each, kinds):
            raise ScenarioError(f"{name}[{row}]={each!r}: must be {one}")
    return tuple(value)


def _far(value: Any, name: str) -> float:
    far = number(value, name)
    if far <= 0.0 and far != -1.0:
        raise ScenarioError(f"{name}={value!r}: must be greater than 0, or -1 for the camera's own")
    return far


def _scale(value: Any, name: str) -> Vector3:
    one = isinstance(value, Real) and not isinstance(value, bool)
    scale = vector((value,) * 3 if one else value, name)
    if min(scale) <= 0.0:
        raise ScenarioError(f"{name}={value!r}: must be greater than 0")
    return scale
