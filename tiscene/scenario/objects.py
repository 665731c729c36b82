# SPDX-License-Identifier: Apache-2.0
"""Objects of a scenario and the frustum that bounds them."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any

from dynamics import Dynamic, argument_checks
from tiscene.errors import ScenarioError, scenario_errors
from tiscene.scene.camera import Vector3


@dataclass(frozen=True)
class Object:
    """One object of a template, alive from `first_frame` to `last_frame`.

    id: its name in the scenario, unique. template: a template's name ("Chair 01") or file.
    position: m. rotation: Euler degrees or a quaternion. dynamic: what moves it; None: nothing.
    first_frame, last_frame: both inclusive; None: it stays for ever.
    collide: it meets the stage, other objects and the frustum's walls: what flies bounces off, what follows a path
    slides along until it can return to its path. False: it passes through everything, and everything through it.
    frustum_limited: the walls of the scenario's frustum hold it, if it collides.
    scale: a factor or one for each of its own axes.
    Raises ScenarioError for anything out of range.
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
            object.__setattr__(self, "first_frame", _check_frame(self.first_frame, "first_frame"))
            if self.last_frame is not None:
                object.__setattr__(self, "last_frame", _check_frame(self.last_frame, "last_frame"))
                if self.last_frame < self.first_frame:
                    raise ScenarioError(
                        f"last_frame={self.last_frame} is before first_frame={self.first_frame}; both are inclusive"
                    )
            argument_checks.flag(self.frustum_limited, "frustum_limited")
            argument_checks.flag(self.collide, "collide")
            object.__setattr__(self, "scale", _check_scale(self.scale))

    def alive(self, frame: int) -> bool:
        """Whether it is there at a frame."""
        return self.first_frame <= frame and (self.last_frame is None or frame <= self.last_frame)


@dataclass(frozen=True)
class Frustum:
    """Invisible walls at the sides of the camera's view, its near plane and `far`: objects stay in view.

    far: m from the camera along its axis; -1: the camera's own.
    """

    far: float = -1.0

    def __post_init__(self) -> None:
        with scenario_errors():
            far = argument_checks.number(self.far, "far")
            if far <= 0.0 and far != -1.0:
                raise ScenarioError(f"far={self.far!r}: must be greater than 0, or -1 for the camera's own")
            object.__setattr__(self, "far", far)


def check_dynamic(value: Any, name: str) -> None:
    if not isinstance(value, Dynamic | None):
        hint = " (an instance, not the class)" if isinstance(value, type) else ""
        raise ScenarioError(f"{name}={value!r}: must be a dynamic{hint}, such as CatmullWaypoints(...), or None")


def _check_frame(value: Any, name: str) -> int:
    frame = argument_checks.whole(value, name)
    if frame < 0:
        raise ScenarioError(f"{name}={value!r}: must be 0 or more")
    return frame


def _check_scale(value: Any) -> Vector3:
    one = isinstance(value, Real) and not isinstance(value, bool)
    x, y, z = argument_checks.vector((value,) * 3 if one else value, "scale")
    if min(x, y, z) <= 0.0:
        raise ScenarioError(f"scale={value!r}: must be greater than 0")
    return (x, y, z)
