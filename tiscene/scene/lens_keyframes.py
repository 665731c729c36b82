# SPDX-License-Identifier: Apache-2.0
"""LensKeyframes: the lens of a camera over time, for zooms and focus pulls, as plain frozen values."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dynamics.argument_checks import is_series, not_negative, number, numbers, positive, set_checked
from tiscene.errors import ArgumentError, counted
from tiscene.scene.animation import between
from tiscene.scene.input_track import mixed

Pair = tuple[float, float]


def _each(check: Callable[[Any, str], Any]) -> Callable[[Any, str], tuple[Any, ...]]:
    """Return a check of a series whose items pass another check."""

    def checked(value: Any, name: str) -> tuple[Any, ...]:
        if not is_series(value):
            raise ArgumentError(f"{name}={value!r}: must be a sequence, with one value for each time")
        return tuple(check(item, f"{name}[{index}]") for index, item in enumerate(value))

    return checked


def _angle(value: Any, name: str) -> float:
    if not number(value, name) < math.pi:
        raise ArgumentError(f"{name}={value!r}: must lie between 0 and pi radians")
    return positive(value, name)


@dataclass(frozen=True)
class LensKeyframes:
    """Keyframes of a camera's lens, which replace values of the `Camera` that has them.

    Values are interpolated linearly, `vertical_fov` as its focal length is. They are held before the first and after
    the last time. Each field but `times` is empty, or has one value per time.

    Attributes:
        times: Keyframe times, s, on the stream's clock, from 0 on, increasing.
        vertical_fov: Vertical fields of view, rad.
        lens_radius: Radii of the aperture, m.
        focus_distance: Distances of the plane in focus, m.
        aperture_offset: Offsets of the image's center, right and up.
        orthographic_height: Heights of the region that an orthographic camera sees, m.
        aspect: Width / height of the aperture.
        exposure: Stops.
        near: Near planes of the frustum, m.
        far: Far planes, m.
        shutter_open: Frames from the frame's own time.
        shutter_close: The same.

    Raises:
        ArgumentError: A value is invalid.
    """

    times: Sequence[float]
    vertical_fov: Sequence[float] = ()
    lens_radius: Sequence[float] = ()
    focus_distance: Sequence[float] = ()
    aperture_offset: Sequence[Pair] = ()
    orthographic_height: Sequence[float] = ()
    aspect: Sequence[float] = ()
    exposure: Sequence[float] = ()
    near: Sequence[float] = ()
    far: Sequence[float] = ()
    shutter_open: Sequence[float] = ()
    shutter_close: Sequence[float] = ()

    def __post_init__(self) -> None:
        lengths = ("focus_distance", "orthographic_height", "aspect", "near", "far")
        set_checked(self, times=numbers, vertical_fov=_each(_angle), lens_radius=_each(not_negative))
        set_checked(self, aperture_offset=_each(lambda value, name: numbers(value, name, 2)), exposure=numbers)
        set_checked(self, shutter_open=numbers, shutter_close=numbers, **dict.fromkeys(lengths, _each(positive)))
        times = self.times
        if not times or times[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(times)):
            raise ArgumentError(f"times={times!r}: must begin at 0 or later and increase")
        if not self.values:
            raise ArgumentError("times: give values at these times, such as vertical_fov=(0.8, 0.4)")
        for name, values in self.values.items():
            if len(values) != len(times):
                raise ArgumentError(
                    f"{name}: {counted(len(values), 'value')} for {counted(len(times), 'time')}; give one for each"
                )

    @property
    def values(self) -> dict[str, Sequence[Any]]:
        """The values of each field of a camera that has keyframes."""
        own = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "times"}
        return {name: values for name, values in own.items() if values}

    @property
    def zooms(self) -> bool:
        """Whether the field of view of a perspective camera changes."""
        return bool(self.vertical_fov or self.aspect)

    @property
    def moments(self) -> list[dict[str, Any]]:
        """The values at each time, by field of the camera."""
        own = self.values
        return [dict(zip(own, values, strict=True)) for values in zip(*own.values(), strict=True)]

    def at(self, seconds: float) -> dict[str, Any]:
        """Return the values at a time, s, by field of the camera."""
        row, t = between(np.asarray(self.times), seconds)
        return {
            name: values[row] if t == 0.0 else _mixed(name, values[row], values[row + 1], t)
            for name, values in self.values.items()
        }

    def without(self, names: Iterable[str]) -> LensKeyframes | None:
        """Return the keyframes without those of some fields; None if nothing is left of them."""
        dropped = self.values.keys() & set(names)
        if dropped == self.values.keys():
            return None
        return replace(self, **dict.fromkeys(dropped, ())) if dropped else self


def _mixed(name: str, a: Any, b: Any, t: float) -> Any:
    """Return a value between two others, at a part 0..1 of the way."""
    if name == "vertical_fov" and a != b:
        return 2.0 * math.atan(1.0 / mixed(1.0 / math.tan(0.5 * a), 1.0 / math.tan(0.5 * b), t))
    return mixed(a, b, t)
