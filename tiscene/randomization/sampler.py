# SPDX-License-Identifier: Apache-2.0
"""Scenarios at random, from ranges of difficulty: what `Scenario.sample` draws.

The ranges are the knobs of a stream's visual complexity: how many objects, which, how fast and how much turning, how
long each is there, where in the view, how much of its way it can be seen and how much of that is hidden.

Every number depends on (seed, object, attempt, what it is for) alone, by a counter-based generator: one more object, or
another range of speeds, changes no other object and no other quantity. What is drawn is measured; what does not lie in
the asked ranges is drawn again, and ranges that nothing fits are refused. Scenarios pass through here as JSON values.
"""

from __future__ import annotations

import difflib
import functools
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import CatmullWaypoints, LinearWaypoints, Waypoint
from dynamics.dynamic import LENGTH_STEPS, Pose
from tiscene import catalog
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.ranges import ScenarioRanges
from tiscene.scene.camera import Camera
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template

Array = NDArray[np.float64]
ATTEMPTS = 200  # draws of one object before its ranges are called impossible
PLACES = 256  # draws of one waypoint in an attempt
DECIMALS = 4  # of positions (m) and angles: tenths of a millimeter, and files that can be read
_TOLERANCE = 1e-9


def sample(
    scene: str | os.PathLike[str], *, seed: int = 0, camera: Camera | str | None = None, **ranges: Any
) -> dict[str, Any]:
    """Members of a scenario's JSON object, drawn from ranges: `scene`, `objects`, `timings`, `frustum`.

    camera: what watches, as of a scenario; where it stands at the start counts. ranges: fields of `ScenarioRanges`.
    Raises ArgumentError for ranges that contradict themselves, ScenarioError for ranges that nothing here fits.
    """
    known = [field.name for field in fields(ScenarioRanges)]
    for name in ranges:
        if name not in known:
            nearest = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {nearest[0]!r}?" if nearest else f"there are {', '.join(known)}"
            raise ArgumentError(f"{name}={ranges[name]!r}: no such range; {hint}")
    if isinstance(seed, bool) or not isinstance(seed, Integral) or not 0 <= seed < 2**64:
        raise ArgumentError(f"seed={seed!r}: must be a whole number from 0 to 2^64 - 1")
    difficulty = ScenarioRanges(**ranges)
    names = sorted(catalog.templates()) if difficulty.templates is None else difficulty.templates
    file = catalog.find_scene(scene)
    space, up_axis = _space(file, file.stat().st_mtime_ns, camera, difficulty.aspect)
    count = _Draws(int(seed), 2**64 - 1).whole("objects", 0, *difficulty.objects)
    objects: list[dict[str, Any]] = []
    starts: list[tuple[Array, float]] = []
    for number in range(count):
        content, start = _Sampler(difficulty, names, space, up_axis, _Draws(int(seed), number), number).draw(starts)
        objects.append(content)
        starts.append(start)
    # What must stay in view cannot leave it by bouncing either.
    walled = difficulty.in_view[0] == 1.0 and "bounce" in difficulty.dynamics
    return {
        "scene": os.fspath(scene),
        "objects": objects,
        "timings": {"type": "AllTogether", "wait_time": difficulty.wait_time},
        "frustum": {"far": difficulty.depth[1]} if walled else None,
    }


class _Draws:
    """Uniform numbers of one object, each a pure function of (seed, object, what for, attempt)."""

    def __init__(self, seed: int, number: int) -> None:
        self._key = np.array([seed, number], np.uint64)

    def uniform(self, what: str, attempt: int, count: int = 1) -> Array:
        """`count` numbers in [0, 1)."""
        purpose = int.from_bytes(what.encode()[:8].ljust(8), "little")
        counter = np.array([0, attempt, purpose, 0], np.uint64)
        raw = np.random.Philox(key=self._key, counter=counter).random_raw(count)
        values: Array = (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return values

    def between(self, what: str, attempt: int, low: float, high: float) -> float:
        """One number from low to high."""
        return low + (high - low) * float(self.uniform(what, attempt)[0])

    def whole(self, what: str, attempt: int, low: int, high: int) -> int:
        """One whole number from low to high, both included."""
        return low + int(self.uniform(what, attempt)[0] * (high - low + 1))


class _Sampler:
    """Draws one object."""

    def __init__(
        self,
        difficulty: ScenarioRanges,
        names: Sequence[str],
        space: FreeSpace,
        up_axis: str,
        draws: _Draws,
        number: int,
    ) -> None:
        self.difficulty = difficulty
        self.space = space
        self.draws = draws
        self.up_axis = up_axis
        self.template = names[draws.whole("template", 0, 0, len(names) - 1)]
        self.kind = difficulty.dynamics[draws.whole("dynamics", 0, 0, len(difficulty.dynamics) - 1)]
        self.scale = round(draws.between("scale", 0, *difficulty.scale), DECIMALS)
        self.radius = _radius(catalog.find_template(self.template), up_axis) * self.scale
        name = Path(self.template).stem if Path(self.template).suffix else self.template
        self.id = f"{name.lower().replace(' ', '_')}_{number}"

    def draw(self, starts: Sequence[tuple[Array, float]]) -> tuple[dict[str, Any], tuple[Array, float]]:
        """An object's JSON object, and the ball where it starts. starts: those of the objects before it."""
        reasons: Counter[str] = Counter()
        for attempt in range(ATTEMPTS):
            points, wrong = self._places(attempt)
            if not wrong and any(np.linalg.norm(points[0] - at) < self.radius + size for at, size in starts):
                wrong = "it would start inside another object"
            dynamic: dict[str, Any] = {"type": "Still"}
            if not wrong and self.kind != "still":
                dynamic, wrong = self._dynamic(points, attempt)
            if not wrong:
                return self._object(points, dynamic), (points[0], self.radius)
            reasons[wrong] += 1
        tally = ", ".join(f"{reason} ({count} times)" for reason, count in reasons.most_common())
        raise ScenarioError(
            f"object {self.id!r} ({self.kind}, {self.radius:.2f} m about its origin) fits nowhere in {ATTEMPTS} draws: "
            f"{tally}. Widen depth, region, in_view or occlusion, or draw from smaller templates"
        )

    def _places(self, attempt: int) -> tuple[Array, str]:
        """Waypoints [n, 3] (one for what needs no more), or why there are none."""
        draws, ranges = self.draws, self.difficulty
        loop = self.kind in ("linear", "catmull")
        count = draws.whole("waypoints", attempt, *ranges.waypoints) if loop else 1
        seen = round(count * draws.between("in view", attempt, *ranges.in_view))
        hidden = round(seen * draws.between("occluded", attempt, *ranges.occlusion))
        points = []
        for row in range(count):
            wanted = "hidden" if row < hidden else "in sight" if row < seen else "out of view"
            place = self._place(wanted, attempt, row)
            if place is None:
                return np.zeros((0, 3)), f"no free place {wanted}"
            points.append(place)
        order = np.argsort(draws.uniform("order", attempt, count))
        return np.array(points)[order], ""

    def _place(self, wanted: str, attempt: int, row: int) -> Array | None:
        """A free point in sight, hidden, or out of view; None if none was found."""
        numbers = self.draws.uniform(f"place{row}", attempt, 3 * PLACES).reshape(PLACES, 3)
        near, far = self.difficulty.depth
        near = max(near, self.space.camera.near + self.radius)
        if near > far:
            return None
        if wanted == "out of view":
            low, high = self.space.bounds
            points = low + numbers * (high - low)
        else:
            left, top, right, bottom = self.difficulty.region
            # Uniform in the volume of the cut pyramid.
            depth = np.cbrt(near**3 + numbers[:, 2] * (far**3 - near**3))
            x, y = left + numbers[:, 0] * (right - left), top + numbers[:, 1] * (bottom - top)
            points = self.space.points(x, y, depth)
        points = np.round(points, DECIMALS)
        hidden = self.space.hidden(points)
        in_view = self.space.in_view(points)
        fits = {"out of view": ~in_view, "hidden": hidden, "in sight": in_view & ~hidden}[wanted]
        if wanted == "in sight":
            return next((point for point in points[fits] if self.space.is_free(point[None], self.radius)[0]), None)
        clear = points[fits][self.space.is_clear(points[fits], self.radius)]
        return clear[0] if len(clear) else None

    def _dynamic(self, points: Array, attempt: int) -> tuple[dict[str, Any], str]:
        """The dynamic's JSON object, or why there is none."""
        draws, ranges = self.draws, self.difficulty
        speed = draws.between("speed", 0, *ranges.speed)
        spin = draws.between("spin", 0, *ranges.angular_speed)
        axis = [round(each, DECIMALS) for each in _direction(*draws.uniform("axis", 0, 2))]
        if self.kind == "bounce":
            direction = [round(each, DECIMALS) for each in _direction(*draws.uniform("heading", attempt, 2))]
            seed = int(draws.uniform("bounces", 0)[0] * 2**31)
            content = {"speed": speed, "angular_speed": spin, "start_direction": direction, "seed": seed}
            return {"type": "UniformMovementRandomBounce"} | content, ""
        cls = LinearWaypoints if self.kind == "linear" else CatmullWaypoints
        waypoints = [Waypoint(tuple(place), self._rotation()) for place in points.tolist()]
        try:
            lengths, way = _way(cls(waypoints, pacing="arc_length"))
        except ValueError:
            return {}, "two waypoints coincide"
        wrong = self._fault(way, np.diff(lengths, axis=1).reshape(-1))
        loop: dict[str, Any] = {
            "type": cls.__name__,
            "waypoints": [{"position": list(each.position), "rotation": list(each.rotation)} for each in waypoints],
            "total_time": float(lengths[-1, -1]) / speed,
            "pacing": "arc_length",
        }
        if spin > 0.0:
            turn = {"type": "Orbit", "period": 2.0 * math.pi / spin, "axis": axis}
            loop = {"type": "Composite", "parts": [loop, turn]}
        return loop, wrong

    def _fault(self, way: Array, lengths: Array) -> str:
        """What of a way [n, 3], with a length for each point of it, is not as asked; "" if all is."""
        if not self.space.is_free(way, self.radius).all():
            return "its way runs into the scene"
        seen, hidden = self.space.in_view(way), self.space.hidden(way)
        in_view = float(lengths @ seen) / float(lengths.sum())
        low, high = self.difficulty.in_view
        if not low - _TOLERANCE <= in_view <= high + _TOLERANCE:
            return "in_view is missed"
        low, high = self.difficulty.occlusion
        occluded = float(lengths @ hidden) / max(float(lengths @ seen), _TOLERANCE)
        if not low - _TOLERANCE <= occluded <= high + _TOLERANCE:
            return "occlusion is missed"
        return ""

    def _rotation(self) -> tuple[float, float, float]:
        """Upright, turned about the vertical by an angle drawn at random."""
        yaw = round(self.draws.between("yaw", 0, -180.0, 180.0), DECIMALS)
        return (0.0, yaw, 0.0) if self.up_axis == "Y" else (0.0, 0.0, yaw)

    def _object(self, points: Array, dynamic: Mapping[str, Any]) -> dict[str, Any]:
        content = {
            "id": self.id,
            "template": self.template,
            "position": points[0].tolist(),
            "rotation": list(self._rotation()),
            "dynamic": dict(dynamic),
            "frustum_limited": self.difficulty.in_view[0] == 1.0,
            "scale": [self.scale] * 3,
        }
        if self.difficulty.life is not None and self.difficulty.frames is not None:
            length = self.draws.whole("life", 0, *self.difficulty.life)
            first = self.draws.whole("first", 0, 0, self.difficulty.frames - length)
            content |= {"first_frame": first, "last_frame": first + length - 1}
        return content


def _way(loop: LinearWaypoints | CatmullWaypoints) -> tuple[Array, Array]:
    """Arc lengths [n, LENGTH_STEPS + 1] of a loop's segments, and the points [n * LENGTH_STEPS, 3] in their middles."""
    (track,) = loop.tracks(Pose())
    cubics = track.segments[:, :12].reshape(-1, 4, 3)
    t = (np.arange(LENGTH_STEPS) + 0.5) / LENGTH_STEPS
    powers = t[:, None] ** np.arange(4)
    assert track.lengths is not None  # of pacing="arc_length"
    return track.lengths, np.einsum("tk,nkc->ntc", powers, cubics).reshape(-1, 3)


def _direction(a: float, b: float) -> tuple[float, float, float]:
    """A unit vector, uniform over the sphere, from two uniform numbers."""
    height, angle = 1.0 - 2.0 * float(a), 2.0 * math.pi * float(b)
    radius = math.sqrt(max(0.0, 1.0 - height * height))
    return (radius * math.cos(angle), radius * math.sin(angle), height)


@functools.lru_cache(maxsize=4)
def _space(file: Path, modified: int, camera: Camera | str | None, aspect: float) -> tuple[FreeSpace, str]:
    """The free space before a camera of a scene, and which axis is up. modified: so that a new file is read."""
    stage = read_stage(file)
    watching = camera if isinstance(camera, Camera) else stage.camera(camera)
    return FreeSpace(stage, watching, aspect), stage.up_axis


@functools.lru_cache(maxsize=256)
def _radius(file: Path, up_axis: str) -> float:
    """Of the ball about a template's origin that holds it, m."""
    description = read_template(file, up_axis="Y" if up_axis == "Y" else "Z").description
    farthest = 0.0
    for each in description.instances:
        positions = description.meshes[each.mesh].positions
        placed = positions @ each.world_from_object[:3, :3].T + each.world_from_object[:3, 3]
        farthest = max(farthest, float(np.linalg.norm(placed, axis=1).max(initial=0.0)))
    return farthest
