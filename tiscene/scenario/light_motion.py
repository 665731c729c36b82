# SPDX-License-Identifier: Apache-2.0
"""LightMotion: trajectory and intensity of a light of the stage, as plain frozen values."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import Dynamic
from dynamics.argument_checks import flag, numbers, set_checked, text, vectors
from tiscene.errors import ScenarioError, counted, scenario_errors

Color = tuple[float, float, float]


@dataclass(frozen=True)
class LightMotion:
    """Trajectory of a light of the stage, and keyframes of its intensity and color.

    Keyframed values are interpolated linearly, and held before the first and after the last time.

    Attributes:
        light: path or name of the light's prim.
        dynamic: trajectory, from the light's authored pose; None: none. Its clock is the stream's time.
        times: keyframe times, s, increasing; each of the following is empty or has one value per time.
        intensity: factors of the authored intensity.
        color: factors of red, green and blue.
        radiance: replaces the authored radiance, linear Rec.709, W/m²/sr (irradiance of a distant light, W/m²).
        repeat: whether to start again at 0 after the last time.

    Raises:
        ScenarioError: a value is invalid.
    """

    light: str
    dynamic: Dynamic | None = None
    times: Sequence[float] = ()
    intensity: Sequence[float] = ()
    color: Sequence[Color] = ()
    radiance: Sequence[Color] = ()
    repeat: bool = False

    def __post_init__(self) -> None:
        with scenario_errors():
            text(self.light, "light")
            if not isinstance(self.dynamic, Dynamic | None):
                raise ScenarioError(f"dynamic={self.dynamic!r}: must be a dynamic, such as Orbit(...), or None")
            set_checked(self, times=numbers, intensity=numbers, color=vectors, radiance=vectors, repeat=flag)
            self._check_values()

    def _check_values(self) -> None:
        times = self.times
        if times and (times[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(times))):
            raise ScenarioError(f"times={times!r}: must begin at 0 or later and increase")
        for name in ("intensity", "color", "radiance"):
            count = len(getattr(self, name))
            if count not in (0, len(times)):
                raise ScenarioError(
                    f"{name}: {counted(count, 'value')} for {counted(len(times), 'time')}; give one for each"
                )
        if min(itertools.chain(self.intensity, *self.color, *self.radiance), default=0.0) < 0.0:
            raise ScenarioError(f"light {self.light!r}: intensity, color and radiance must not be negative")
        if times and not (self.intensity or self.color or self.radiance):
            raise ScenarioError("times: give intensity, color or radiance at these times")

    def radiance_at(self, time: float, own: Color) -> Color:
        """Return the radiance at a time (s) of a light whose authored radiance is `own`."""
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

    def max_radiance(self, own: Color) -> Color:
        """Return an upper bound of `radiance_at` over all times, per channel."""
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
