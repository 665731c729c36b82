# SPDX-License-Identifier: Apache-2.0
"""SAILenv's classes that say what happens: its names, its argument order, its JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any


@dataclass
class Vector3:
    """Three numbers. Whatever has [0], [1] and [2] is accepted wherever one is asked for."""

    x: float
    y: float
    z: float

    @staticmethod
    def from_tuple(tuple: Sequence[float]) -> Vector3:
        """The vector of three numbers in a row."""
        return Vector3(tuple[0], tuple[1], tuple[2])

    def __getitem__(self, index: int) -> float:
        return (self.x, self.y, self.z)[index]

    def __len__(self) -> int:
        return 3

    def __iter__(self) -> Iterator[float]:
        return iter((self.x, self.y, self.z))

    def __add__(self, other: float | Sequence[float] | Vector3) -> Vector3:
        a, b, c = (other,) * 3 if isinstance(other, int | float) else (other[0], other[1], other[2])
        return Vector3(self.x + a, self.y + b, self.z + c)

    def __sub__(self, other: float | Sequence[float] | Vector3) -> Vector3:
        a, b, c = (other,) * 3 if isinstance(other, int | float) else (other[0], other[1], other[2])
        return Vector3(self.x - a, self.y - b, self.z - c)

    def __mul__(self, other: float | Vector3) -> Any:
        """By a number: the scaled vector. By a vector: the dot product, a number."""
        if isinstance(other, Vector3):
            return self.x * other.x + self.y * other.y + self.z * other.z
        return Vector3(self.x * other, self.y * other, self.z * other)

    __rmul__ = __mul__


class BaseDataclass:
    """What can be written as JSON values."""

    def asdict(self) -> dict[str, Any]:
        """The fields by name."""
        return {each.name: _plain(getattr(self, each.name)) for each in fields(self)}  # type: ignore[arg-type]


class Described(BaseDataclass):
    """What SAILenv writes as {"type": ..., "description": {...}}."""

    type_name = ""

    @classmethod
    def get_type(cls) -> str:
        """SAILenv's name for the class."""
        return cls.type_name

    def todict(self) -> dict[str, Any]:
        """Type and description."""
        return {"type": self.get_type(), "description": self.asdict()}


class Dynamic(Described):
    """What moves an object."""


class Timings(Described):
    """When objects move."""


def _zero() -> Vector3:
    return Vector3(0.0, 0.0, 0.0)


@dataclass
class Waypoint(BaseDataclass):
    """A pose to pass through: m, Euler degrees."""

    position: Any = field(default_factory=_zero)
    rotation: Any = field(default_factory=_zero)


@dataclass
class WaypointsDynamic(Dynamic):
    """A closed loop through waypoints; total_time: s for all of it."""

    waypoints: list[Waypoint] = field(default_factory=list)
    total_time: float = 10.0


@dataclass
class LinearWaypoints(WaypointsDynamic):
    """Straight from each to the next."""

    type_name = "linear_waypoints"


@dataclass
class CatmullWaypoints(WaypointsDynamic):
    """Along a Catmull-Rom curve."""

    type_name = "catmull_waypoints"


@dataclass
class UniformMovementRandomBounce(Dynamic):
    """Straight on at `speed` m/s; at each hit in a random direction, with a spin of at most `angular_speed` rad/s."""

    start_direction: Any = field(default_factory=lambda: Vector3(0.0, 0.0, 1.0))
    speed: float = 5.0
    angular_speed: float = 2.0
    seed: int = 42
    type_name = "uniform_movement_random_bounce"


@dataclass
class AllTogetherTimings(Timings):
    """Everything starts after `wait_time` seconds."""

    wait_time: float = 1.0
    type_name = "all_together"


@dataclass
class WaitUntilCompleteTimings(Timings):
    """One after another, each for one loop, with `wait_time` seconds before it."""

    wait_time: float
    type_name = "wait_until_complete"


@dataclass
class DictTimings(Timings):
    """One after another, each for so many seconds. times: object (its index, or its id) to seconds."""

    times: dict[Any, float] = field(default_factory=dict)
    type_name = "dict"


@dataclass
class Object(BaseDataclass):
    """An object of a scenario. prefab: what `Agent.spawnable_objects_names` lists."""

    id: str
    prefab: str
    position: Any
    rotation: Any
    dynamic: Dynamic | None = None
    frustum_limited: bool = True


@dataclass
class Frustum(BaseDataclass):
    """Walls at the sides of the agent's view. spawn: whether there are any; far_clip_plane: m, -1: the agent's own."""

    spawn: bool = True
    far_clip_plane: float = 15.0

    @staticmethod
    def default_frustum() -> Frustum:
        """No walls."""
        return Frustum(False, -1.0)


@dataclass
class Scenario(BaseDataclass):
    """What happens in a scene. frustum: True and False are understood as well."""

    scene_name: str
    objects: list[Object]
    timings: Timings = field(default_factory=AllTogetherTimings)
    frustum: Frustum | bool = field(default_factory=Frustum.default_frustum)

    @property
    def n_objects(self) -> int:
        """How many objects there are."""
        return len(self.objects)


def _plain(value: Any) -> Any:
    """A value as JSON holds it."""
    match value:
        case Described():
            return value.todict()
        case BaseDataclass():
            return value.asdict()
        case Vector3():
            return {"x": value.x, "y": value.y, "z": value.z}
        case str() | bool() | int() | float() | None:
            return value
        case Mapping():
            return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "item") and not getattr(value, "shape", None):
        return value.item()  # a scalar of numpy
    return [_plain(item) for item in value]
