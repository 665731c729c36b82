# SPDX-License-Identifier: Apache-2.0
"""InputTrack: inputs of a material or light that vary over time, by the stage's own time samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import between, interpolated

Described = TypeVar("Described")


@dataclass(frozen=True, eq=False)
class InputTrack:
    """Inputs of one material or light over time.

    Numbers are interpolated linearly between samples, poses as those of instances. Everything else (textures, flags,
    names) keeps the value of a sample until the next one. Before the first and after the last sample, everything stays
    as it is there.

    Attributes:
        row: Row of `SceneDescription.materials`, or of its lights.
        times: float64 [s], increasing, s.
        inputs: Names of fields of `Material` or of the light's class, each with its values at the samples.
        present: Whether a light is on from each sample to the next. (): always.
    """

    row: int
    times: NDArray[np.float64]
    inputs: tuple[tuple[str, tuple[Any, ...]], ...]
    present: tuple[bool, ...] = ()

    def moment(self, seconds: float) -> tuple[int, float]:
        """Return the sample at or before a time, and the position between it and the next one, 0 <= t < 1."""
        return between(self.times, seconds)

    def is_present(self, moment: tuple[int, float]) -> bool:
        """Return whether a light is on at a moment."""
        return not self.present or self.present[moment[0]]

    def applied(self, described: Described, moment: tuple[int, float]) -> Described:
        """Return a material or light with its inputs at a moment."""
        row, t = moment
        values = {
            name: samples[row] if t == 0.0 else mixed(samples[row], samples[row + 1], t)
            for name, samples in self.inputs
        }
        result: Described = replace(described, **values)  # type: ignore[type-var]
        return result

    def values(self, name: str) -> tuple[Any, ...]:
        """Return the samples of an input; () if it does not vary."""
        return dict(self.inputs).get(name, ())

    def mapped(self, name: str, function: Callable[[Any], Any]) -> InputTrack:
        """Return the track with a function applied to the samples of one input, if it varies."""
        changed = [(each, tuple(map(function, samples)) if each == name else samples) for each, samples in self.inputs]
        return replace(self, inputs=tuple(changed))

    def without(self, names: Iterable[str]) -> InputTrack | None:
        """Return the track without some inputs; None if nothing is left of it."""
        names = set(names)
        inputs = tuple(each for each in self.inputs if each[0] not in names)
        return replace(self, inputs=inputs) if inputs or self.present else None

    @classmethod
    def of(
        cls,
        row: int,
        times: NDArray[np.float64],
        samples: list[Any],
        present: tuple[bool, ...] = (),
        excluded: Iterable[str] = (),
    ) -> InputTrack | None:
        """Return the track of a material or light that was read at several times; None if nothing of it varies.

        Args:
            row: Its row.
            times: The times, increasing, s.
            samples: It at each time, all of one class.
            present: Whether it is on from each time to the next; (): always.
            excluded: Names of fields to leave out.
        """
        names = {each.name for each in fields(samples[0])} - set(excluded)
        values = {name: tuple(getattr(each, name) for each in samples) for name in sorted(names)}
        varying = tuple((name, each) for name, each in values.items() if any(_differ(each[0], b) for b in each[1:]))
        present = () if all(present) else present
        return cls(row, times, varying, present) if varying or present else None


def mixed(a: Any, b: Any, t: float) -> Any:
    """Interpolate two values: numbers, and tuples and dataclasses of numbers, linearly, and 4x4 poses.

    Anything else is `a`.
    """
    if isinstance(a, np.ndarray):
        return np.concatenate([interpolated(a[None, :3], b[None, :3], t)[0], a[3:]])
    if isinstance(a, bool) or isinstance(b, bool) or a is b:
        return a
    if isinstance(a, float | int) and isinstance(b, float | int):
        return a + t * (b - a) if isinstance(a, float) or isinstance(b, float) else a
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return tuple(mixed(x, y, t) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type) and type(a) is type(b):
        pairs = {each.name: (getattr(a, each.name), getattr(b, each.name)) for each in fields(a)}
        if any(isinstance(x, str | int) and x != y for x, y in pairs.values()):  # another texture or channel
            return a
        return replace(a, **{name: mixed(x, y, t) for name, (x, y) in pairs.items()})
    return a


def _differ(a: Any, b: Any) -> bool:
    return not np.array_equal(a, b) if isinstance(a, np.ndarray) else bool(a != b)


def by_row(tracks: Iterable[InputTrack]) -> Mapping[int, InputTrack]:
    """Return tracks by their rows."""
    return {track.row: track for track in tracks}
