"""How a light of the stage moves and shines, as plain frozen values."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import Dynamic, check

Color = tuple[float, float, float]


@dataclass(frozen=True)
class LightMotion:
    """A light of the stage whose pose is given by a dynamic, and its colour and intensity by keyframes.

    light: its prim's path, or its name. dynamic: what moves it from where it stands; None: nothing. Its clock is the
    stream's time, as a camera's is.
    times: s, increasing; one for each of the following, where they are given. Values are linear between, and held
    before the first and after the last. intensity: factors of the light's own. color: factors of red, green and blue.
    radiance: takes the place of the light's own, linear Rec.709, W/m²/sr (of a distant light W/m²).
    repeat: start again at 0 after the last time.
    """

    light: str
    dynamic: Dynamic | None = None
    times: Sequence[float] = ()
    intensity: Sequence[float] = ()
    color: Sequence[Color] = ()
    radiance: Sequence[Color] = ()
    repeat: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.light, str) or not self.light:
            raise TypeError(f"light={self.light!r}: must be the path or the name of a light on the stage")
        if not isinstance(self.dynamic, Dynamic | None):
            raise TypeError(f"dynamic={self.dynamic!r}: must be a dynamic, such as Orbit(...), or None")
        count = len(tuple(self.times))
        times = check.numbers(self.times, "times", count)
        if times and (times[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(times))):
            raise ValueError(f"times={self.times!r}: must begin at 0 or later and increase")
        object.__setattr__(self, "times", tuple(times))
        object.__setattr__(
            self, "intensity", tuple(check.numbers(self.intensity, "intensity", self._count("intensity")))
        )
        for name in ("color", "radiance"):
            self._count(name)
            colors = tuple(check.vector(each, f"{name}[{row}]") for row, each in enumerate(getattr(self, name)))
            object.__setattr__(self, name, colors)
        if min(itertools.chain(self.intensity, *self.color, *self.radiance), default=0.0) < 0.0:
            raise ValueError(f"light {self.light!r}: intensity, color and radiance must not be negative")
        if self.times and not (self.intensity or self.color or self.radiance):
            raise ValueError("times: give intensity, color or radiance at these times")
        check.flag(self.repeat, "repeat")

    def _count(self, name: str) -> int:
        """How many values of one kind there must be."""
        count = len(tuple(getattr(self, name)))
        if count not in (0, len(self.times)):
            raise ValueError(f"{name}: {count} values for {len(self.times)} times; give one for each")
        return count

    def shines(self, time: float, own: Color) -> Color:
        """The radiance at a time, s, of a light whose own is `own`."""
        if not self.times:
            return own
        if self.repeat and self.times[-1] > 0.0:
            time = time % self.times[-1]
        radiance = np.asarray(own, np.float64)
        if self.radiance:
            radiance = self._at(time, self.radiance)
        if self.color:
            radiance = radiance * self._at(time, self.color)
        if self.intensity:
            radiance = radiance * np.interp(time, self.times, self.intensity)
        r, g, b = radiance.tolist()
        return (r, g, b)

    def brightest(self, own: Color) -> Color:
        """The most that `shines` ever gives of each colour, or more than that."""
        radiance = np.max(self.radiance, axis=0) if self.radiance else np.asarray(own, np.float64)
        if self.color:
            radiance = radiance * np.max(self.color, axis=0)
        if self.intensity:
            radiance = radiance * max(self.intensity)
        r, g, b = radiance.tolist()
        return (r, g, b)

    def _at(self, time: float, colors: Sequence[Color]) -> NDArray[np.float64]:
        values: Any = [np.interp(time, self.times, channel) for channel in zip(*colors, strict=True)]
        return np.array(values)
