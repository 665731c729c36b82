# SPDX-License-Identifier: Apache-2.0
"""SAILenv's scenario classes: the same names, argument order and JSON as in the package `sailenv`.

Positions are in Unity's space, m; rotations are its Euler angles, degrees.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentTypeError


@dataclass
class Vector3:
    """Three numbers. Wherever a vector is expected, any object with [0], [1] and [2] is accepted."""

    x: float
    y: float
    z: float

    @staticmethod
    def from_tuple(tuple: Sequence[float]) -> Vector3:
        """Return the vector of a sequence of three numbers."""
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
        """Return the vector scaled by a number, or the dot product with a vector."""
        if isinstance(other, Vector3):
            return self.x * other.x + self.y * other.y + self.z * other.z
        return Vector3(self.x * other, self.y * other, self.z * other)

    __rmul__ = __mul__


class BaseDataclass:
    """Base of dataclasses that can be written as JSON."""

    def asdict(self) -> dict[str, Any]:
        """Return the fields by name, as JSON values. Raises ArgumentTypeError."""
        kind = type(self).__name__
        names = [each.name for each in fields(self)]  # type: ignore[arg-type]
        return {name: _json_value(getattr(self, name), f"{kind}.{name}") for name in names}


class TypedDataclass(BaseDataclass):
    """Base of dataclasses that SAILenv writes as {"type": ..., "description": {...}}."""

    type_name = ""

    @classmethod
    def get_type(cls) -> str:
        """Return SAILenv's name of the class."""
        return cls.type_name

    def todict(self) -> dict[str, Any]:
        """Return type and description as JSON values."""
        return {"type": self.get_type(), "description": self.asdict()}


class Dynamic(TypedDataclass):
    """Base of trajectories."""


class Timings(TypedDataclass):
    """Base of timings, which decide when objects move."""


def _zero() -> Vector3:
    return Vector3(0.0, 0.0, 0.0)


@dataclass
class Waypoint(BaseDataclass):
    """A pose on a path: m, Euler angles in degrees."""

    position: Any = field(default_factory=_zero)
    rotation: Any = field(default_factory=_zero)


@dataclass
class WaypointsDynamic(Dynamic):
    """A closed path through waypoints.

    Attributes:
        waypoints: The poses on the path.
        total_time: The duration of one loop, s.
    """

    waypoints: list[Waypoint] = field(default_factory=list)
    total_time: float = 10.0


@dataclass
class LinearWaypoints(WaypointsDynamic):
    """A closed path of straight segments."""

    type_name = "linear_waypoints"


@dataclass
class CatmullWaypoints(WaypointsDynamic):
    """A closed Catmull-Rom curve."""

    type_name = "catmull_waypoints"


@dataclass
class UniformMovementRandomBounce(Dynamic):
    """Uniform motion that continues in a random direction, with a random spin, after each collision.

    Attributes:
        start_direction: The first direction.
        speed: m/s.
        angular_speed: The maximum spin, rad/s.
        seed: The seed of the random directions.
    """

    start_direction: Any = field(default_factory=lambda: Vector3(0.0, 0.0, 1.0))
    speed: float = 5.0
    angular_speed: float = 2.0
    seed: int = 42
    type_name = "uniform_movement_random_bounce"


@dataclass
class AllTogetherTimings(Timings):
    """All objects start after `wait_time` seconds."""

    wait_time: float = 1.0
    type_name = "all_together"


@dataclass
class WaitUntilCompleteTimings(Timings):
    """Objects move one after another, each for one loop, with `wait_time` seconds before each."""

    wait_time: float
    type_name = "wait_until_complete"


@dataclass
class DictTimings(Timings):
    """Objects move one after another.

    Attributes:
        times: The duration of each object's motion, s, by its index or id.
    """

    times: dict[Any, float] = field(default_factory=dict)
    type_name = "dict"


@dataclass
class Object(BaseDataclass):
    """An object of a scenario.

    Attributes:
        id: Its name.
        prefab: The name of its template, one of `Agent.spawnable_objects_names`.
        position: m.
        rotation: Euler angles, degrees.
        dynamic: Its trajectory; None for a static object.
        frustum_limited: Whether the walls of the view frustum stop it.
    """

    id: str
    prefab: str
    position: Any
    rotation: Any
    dynamic: Dynamic | None = None
    frustum_limited: bool = True


@dataclass
class Frustum(BaseDataclass):
    """Walls at the sides of the agent's view.

    Attributes:
        spawn: Whether there are walls.
        far_clip_plane: The distance of the far wall, m; -1 for the agent's far plane.
    """

    spawn: bool = True
    far_clip_plane: float = 15.0

    @staticmethod
    def default_frustum() -> Frustum:
        """Return a frustum without walls."""
        return Frustum(False, -1.0)


@dataclass
class Scenario(BaseDataclass):
    """A scenario.

    Attributes:
        scene_name: One of `Agent.scenes`.
        objects: The objects.
        timings: When they move.
        frustum: Walls of the agent's view; True for default walls, False for none.
        physics: Extension of tiscene: whether objects without a dynamic fall and are pushed; None: as the agent says.
    """

    scene_name: str
    objects: list[Object]
    timings: Timings = field(default_factory=AllTogetherTimings)
    frustum: Frustum | bool = field(default_factory=Frustum.default_frustum)
    physics: bool | None = None

    def asdict(self) -> dict[str, Any]:
        """Return the fields by name, as JSON values; without `physics`, unless it is set."""
        content = super().asdict()
        return content if self.physics is not None else {key: each for key, each in content.items() if key != "physics"}

    @property
    def n_objects(self) -> int:
        """The number of objects."""
        return len(self.objects)


def _json_value(value: Any, name: str) -> Any:
    """Return the value of a field as JSON."""
    match value:
        case TypedDataclass():
            return value.todict()
        case BaseDataclass():
            return value.asdict()
        case Vector3():
            return {"x": value.x, "y": value.y, "z": value.z}
        case str() | bool() | int() | float() | None:
            return value
        case Mapping():
            return {str(key): _json_value(item, name) for key, item in value.items()}
    if hasattr(value, "item") and not getattr(value, "shape", None):
        return value.item()  # a NumPy scalar
    try:
        items = iter(value)
    except TypeError as error:
        raise ArgumentTypeError(f"{name}={argument_checks.brief(value)}: is not a value of JSON") from error
    return [_json_value(item, name) for item in items]
