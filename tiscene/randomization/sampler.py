# SPDX-License-Identifier: Apache-2.0
"""Draw random scenarios from ranges, for `Scenario.sample`.

Each random number depends only on (seed, object, attempt, purpose), by the counter-based generator Philox (Salmon et
al. 2011): one more object, or another range of speeds, changes no other object and no other quantity. Drawn objects are
measured; those outside the ranges are rejected and drawn again. Scenarios are JSON values here.
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
ATTEMPTS = 200  # draws of one object before its ranges are refused
PLACES = 256  # draws of one waypoint per attempt
DECIMALS = 4  # of positions (m) and angles (degrees), so that files stay readable
_TOLERANCE = 1e-9


def sample(
    scene: str | os.PathLike[str], *, seed: int = 0, camera: Camera | str | None = None, **ranges: Any
) -> dict[str, Any]:
    """Draw a scenario.

    Args:
        scene: name or file of the scene.
        seed: 0 to 2^64 - 1.
        camera: the scenario's camera; its pose at the start counts.
        **ranges: fields of `ScenarioRanges`.

    Returns:
        The members `scene`, `objects`, `timings` and `frustum` of a scenario's JSON object.

    Raises:
        ArgumentError: the ranges contradict themselves.
        ScenarioError: nothing in the scene fits the ranges.
    """
    known = [field.name for field in fields(ScenarioRanges)]
    for name in ranges:
        if name not in known:
            nearest = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {nearest[0]!r}?" if nearest else f"there are {', '.join(known)}"
            raise ArgumentError(f"{name}={ranges[name]!r}: no such range; {hint}")
    if isinstance(seed, bool) or not isinstance(seed, Integral) or not 0 <= seed < 2**64:
        raise ArgumentError(f"seed={seed!r}: must be a whole number from 0 to 2^64 - 1")
    limits = ScenarioRanges(**ranges)
    names = sorted(catalog.templates()) if limits.templates is None else limits.templates
    file = catalog.find_scene(scene)
    space, up_axis = _space(file, file.stat().st_mtime_ns, camera, limits.aspect)
    count = _Draws(int(seed), 2**64 - 1).whole("objects", 0, *limits.objects)
    objects: list[dict[str, Any]] = []
    starts: list[tuple[Array, float]] = []
    for number in range(count):
        content, start = _Sampler(limits, names, space, up_axis, _Draws(int(seed), number), number).draw(starts)
        objects.append(content)
        starts.append(start)
    # Bouncing objects that must stay in view need walls.
    walled = limits.in_view[0] == 1.0 and "bounce" in limits.dynamics
    return {
        "scene": os.fspath(scene),
        "objects": objects,
        "timings": {"type": "AllTogether", "wait_time": limits.wait_time},
        "frustum": {"far": limits.depth[1]} if walled else None,
    }


class _Draws:
    """Uniform random numbers of one object, each a pure function of (seed, object, purpose, attempt)."""

    def __init__(self, seed: int, number: int) -> None:
        self._key = np.array([seed, number], np.uint64)

    def uniform(self, what: str, attempt: int, count: int = 1) -> Array:
        """Return `count` numbers in [0, 1)."""
        purpose = int.from_bytes(what.encode()[:8].ljust(8), "little")
        counter = np.array([0, attempt, purpose, 0], np.uint64)
        raw = np.random.Philox(key=self._key, counter=counter).random_raw(count)
        values: Array = (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return values

    def between(self, what: str, attempt: int, low: float, high: float) -> float:
        """Return one number from low to high."""
        return low + (high - low) * float(self.uniform(what, attempt)[0])

    def whole(self, what: str, attempt: int, low: int, high: int) -> int:
        """Return one whole number from low to high, both included."""
        return low + int(self.uniform(what, attempt)[0] * (high - low + 1))


class _Sampler:
    """Draws one object."""

    def __init__(
        self,
        limits: ScenarioRanges,
        names: Sequence[str],
        space: FreeSpace,
        up_axis: str,
        draws: _Draws,
        number: int,
    ) -> None:
        self.limits = limits
        self.space = space
        self.draws = draws
        self.up_axis = up_axis
        self.template = names[draws.whole("template", 0, 0, len(names) - 1)]
        self.kind = limits.dynamics[draws.whole("dynamics", 0, 0, len(limits.dynamics) - 1)]
        self.scale = round(draws.between("scale", 0, *limits.scale), DECIMALS)
        self.radius = _radius(catalog.find_template(self.template), up_axis) * self.scale
        name = Path(self.template).stem if Path(self.template).suffix else self.template
        self.id = f"{name.lower().replace(' ', '_')}_{number}"

    def draw(self, starts: Sequence[tuple[Array, float]]) -> tuple[dict[str, Any], tuple[Array, float]]:
        """Draw the object.

        Args:
            starts: center and radius of each object drawn before, at its start.

        Returns:
            The object's JSON object, and center and radius at its start.
        """
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
        """Return waypoints [n, 3] (one for objects without a path), or the reason why there are none."""
        draws, ranges = self.draws, self.limits
        loop = self.kind in ("linear", "catmull")
        count = draws.whole("waypoints", attempt, *ranges.waypoints) if loop else 1
        seen = round(count * draws.between("in view", attempt, *ranges.in_view))
        hidden = round(seen * draws.between("occluded", attempt, *ranges.occlusion))
        points = []
        for row in range(count):
            wanted = "hidden" if row < hidden else "visible" if row < seen else "out of view"
            place = self._place(wanted, attempt, row)
            if place is None:
                return np.zeros((0, 3)), f"no free point {wanted}"
            points.append(place)
        order = np.argsort(draws.uniform("order", attempt, count))
        return np.array(points)[order], ""

    def _place(self, wanted: str, attempt: int, row: int) -> Array | None:
        """Return a free point that is visible, hidden, or out of view; None if none was found."""
        numbers = self.draws.uniform(f"place{row}", attempt, 3 * PLACES).reshape(PLACES, 3)
        near, far = self.limits.depth
        near = max(near, self.space.camera.near + self.radius)
        if near > far:
            return None
        if wanted == "out of view":
            low, high = self.space.bounds
            points = low + numbers * (high - low)
        else:
            left, top, right, bottom = self.limits.region
            # Uniform in the volume of the cut pyramid.
            depth = np.cbrt(near**3 + numbers[:, 2] * (far**3 - near**3))
            x, y = left + numbers[:, 0] * (right - left), top + numbers[:, 1] * (bottom - top)
            points = self.space.points(x, y, depth)
        points = np.round(points, DECIMALS)
        hidden = self.space.hidden(points)
        in_view = self.space.in_view(points)
        fits = {"out of view": ~in_view, "hidden": hidden, "visible": in_view & ~hidden}[wanted]
        if wanted == "visible":
            return next((point for point in points[fits] if self.space.is_free(point[None], self.radius)[0]), None)
        clear = points[fits][self.space.is_clear(points[fits], self.radius)]
        return clear[0] if len(clear) else None

    def _dynamic(self, points: Array, attempt: int) -> tuple[dict[str, Any], str]:
        """Return the trajectory's JSON object, and the reason why it is rejected or ""."""
        draws, ranges = self.draws, self.limits
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
            lengths, path = _sampled(cls(waypoints, pacing="arc_length"))
        except ValueError:
            return {}, "two waypoints coincide"
        wrong = self._rejection(path, np.diff(lengths, axis=1).reshape(-1))
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

    def _rejection(self, path: Array, lengths: Array) -> str:
        """Return the reason why a path [n, 3], with a length for each point, misses the ranges; "" if it does not."""
        if not self.space.is_free(path, self.radius).all():
            return "its path collides with the scene"
        seen, hidden = self.space.in_view(path), self.space.hidden(path)
        in_view = float(lengths @ seen) / float(lengths.sum())
        low, high = self.limits.in_view
        if not low - _TOLERANCE <= in_view <= high + _TOLERANCE:
            return "in_view is missed"
        low, high = self.limits.occlusion
        occluded = float(lengths @ hidden) / max(float(lengths @ seen), _TOLERANCE)
        if not low - _TOLERANCE <= occluded <= high + _TOLERANCE:
            return "occlusion is missed"
        return ""

    def _rotation(self) -> tuple[float, float, float]:
        """Return a random rotation about the vertical."""
        yaw = round(self.draws.between("yaw", 0, -180.0, 180.0), DECIMALS)
        return (0.0, yaw, 0.0) if self.up_axis == "Y" else (0.0, 0.0, yaw)

    def _object(self, points: Array, dynamic: Mapping[str, Any]) -> dict[str, Any]:
        content = {
            "id": self.id,
            "template": self.template,
            "position": points[0].tolist(),
            "rotation": list(self._rotation()),
            "dynamic": dict(dynamic),
            "frustum_limited": self.limits.in_view[0] == 1.0,
            "scale": [self.scale] * 3,
        }
        if self.limits.life is not None and self.limits.frames is not None:
            length = self.draws.whole("life", 0, *self.limits.life)
            first = self.draws.whole("first", 0, 0, self.limits.frames - length)
            content |= {"first_frame": first, "last_frame": first + length - 1}
        return content


def _sampled(loop: LinearWaypoints | CatmullWaypoints) -> tuple[Array, Array]:
    """Return arc lengths [n, LENGTH_STEPS + 1] along a loop's segments, and midpoints [n * LENGTH_STEPS, 3]."""
    (track,) = loop.tracks(Pose())
    cubics = track.segments[:, :12].reshape(-1, 4, 3)
    t = (np.arange(LENGTH_STEPS) + 0.5) / LENGTH_STEPS
    powers = t[:, None] ** np.arange(4)
    assert track.lengths is not None  # of pacing="arc_length"
    return track.lengths, np.einsum("tk,nkc->ntc", powers, cubics).reshape(-1, 3)


def _direction(a: float, b: float) -> tuple[float, float, float]:
    """Map two uniform numbers to a unit vector, uniform over the sphere."""
    height, angle = 1.0 - 2.0 * float(a), 2.0 * math.pi * float(b)
    radius = math.sqrt(max(0.0, 1.0 - height * height))
    return (radius * math.cos(angle), radius * math.sin(angle), height)


@functools.lru_cache(maxsize=4)
def _space(file: Path, modified: int, camera: Camera | str | None, aspect: float) -> tuple[FreeSpace, str]:
    """Return the free space before a camera of a scene, and the up axis. `modified` invalidates the cache."""
    stage = read_stage(file)
    watching = camera if isinstance(camera, Camera) else stage.camera(camera)
    return FreeSpace(stage, watching, aspect), stage.up_axis


@functools.lru_cache(maxsize=256)
def _radius(file: Path, up_axis: str) -> float:
    """Return the radius of the ball about a template's origin that encloses it, m."""
    description = read_template(file, up_axis="Y" if up_axis == "Y" else "Z").description
    farthest = 0.0
    for each in description.instances:
        positions = description.meshes[each.mesh].positions
        placed = positions @ each.world_from_object[:3, :3].T + each.world_from_object[:3, 3]
        farthest = max(farthest, float(np.linalg.norm(placed, axis=1).max(initial=0.0)))
    return farthest
