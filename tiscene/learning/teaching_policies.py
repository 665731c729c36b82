# SPDX-License-Identifier: Apache-2.0
"""Policies of supervision: which pixels a teacher labels unasked, and when it answers questions.

A policy is a frozen dataclass derived from `Policy`; users write their own in the same way. JSON files refer to it by
the name of its class.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError
from tiscene.frame.frame import Frame
from tiscene.learning.label_ledger import LabelLedger

Pixel = tuple[int, int]


@dataclass(frozen=True)
class Moment:
    """Where a frame stands in its phase.

    Attributes:
        index: number of the frame in its phase, from 0.
        length: number of frames of the phase; None: endless.
        rng: random numbers of this frame, the same at every call.
        moving: instance ids of the objects that move.
    """

    index: int
    length: int | None
    rng: np.random.Generator
    moving: frozenset[int]


class Policy:
    """Which pixels a teacher labels unasked, and when it is silent."""

    def is_silent(self, moment: Moment) -> bool:
        """Return whether the teacher neither speaks nor answers at a frame."""
        return False

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        """Return the pixels (row, column) that the teacher labels unasked."""
        return ()


@dataclass(frozen=True)
class Asked(Policy):
    """Label only what is asked for."""


@dataclass(frozen=True)
class OnePixelPerMovingObject(Policy):
    """Label a random visible pixel of each object that moves. Needs the buffer `instance`."""

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        chosen = []
        for number in sorted(moment.moving):
            rows, columns = np.nonzero(frame.instance == number)
            if len(rows):
                pick = int(moment.rng.integers(len(rows)))
                chosen.append((int(rows[pick]), int(columns[pick])))
        return chosen


@dataclass(frozen=True)
class RandomPixels(Policy):
    """Label `count` random pixels of each frame, drawn without replacement.

    Attributes:
        count: number of pixels, 1 or more.
    """

    count: int = 1

    def __post_init__(self) -> None:
        argument_checks.integer(self.count, "count", 1)

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        width, height = frame.camera.width, frame.camera.height
        drawn = moment.rng.choice(width * height, min(self.count, width * height), replace=False)
        return [(int(pixel) // width, int(pixel) % width) for pixel in drawn]


@dataclass(frozen=True)
class FocusOfAttention(Policy):
    """Label the pixel that a trajectory of fixations points at.

    Attributes:
        fixations: positions (row, column) as fractions of the image's height and width, 0..1.
        hold: number of frames of each fixation. After the last one the first follows.
    """

    fixations: Sequence[tuple[float, float]]
    hold: int = 1

    def __post_init__(self) -> None:
        rows = self.fixations if isinstance(self.fixations, Iterable) else ()
        fixations = tuple(argument_checks.numbers(each, f"fixations[{row}]", 2) for row, each in enumerate(rows))
        if not fixations or not all(0.0 <= part <= 1.0 for each in fixations for part in each):
            raise ArgumentError(f"fixations={self.fixations!r}: must be one or more pairs of fractions from 0 to 1")
        argument_checks.integer(self.hold, "hold", 1)
        object.__setattr__(self, "fixations", fixations)

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        y, x = self.fixations[moment.index // self.hold % len(self.fixations)]
        width, height = frame.camera.width, frame.camera.height
        return [(min(int(y * height), height - 1), min(int(x * width), width - 1))]


@dataclass(frozen=True)
class FollowMovingObjects(Policy):
    """Label the pixel of a focus of attention that stays on one moving object for a while, then moves to another.

    The focus is the visible pixel nearest to the middle of the object's visible pixels; where nothing moves, the center
    of the image. Needs the buffer `instance`.

    Attributes:
        hold: number of frames for which it stays on one object.
    """

    hold: int = 25

    def __post_init__(self) -> None:
        argument_checks.integer(self.hold, "hold", 1)

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        visible = sorted(moment.moving & set(np.unique(frame.instance).tolist()))
        if not visible:
            return [(frame.camera.height // 2, frame.camera.width // 2)]
        places = np.argwhere(frame.instance == visible[moment.index // self.hold % len(visible)])
        nearest = np.argmin(np.square(places - places.mean(axis=0)).sum(axis=1))
        return [(int(places[nearest][0]), int(places[nearest][1]))]


@dataclass(frozen=True)
class Everything(Policy):
    """Label every pixel, or every `step`-th one along both axes; one in the middle of an image below half a step.

    Attributes:
        step: px, 1 or more.
    """

    step: int = 1

    def __post_init__(self) -> None:
        argument_checks.integer(self.step, "step", 1)

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        rows, columns = (_every(self.step, size) for size in (frame.camera.height, frame.camera.width))
        return [(y, x) for y in rows for x in columns]


@dataclass(frozen=True)
class Combined(Policy):
    """Label the pixels of several policies; a policy that is silent adds none.

    Attributes:
        parts: the policies.
    """

    parts: Sequence[Policy]

    def __post_init__(self) -> None:
        if isinstance(self.parts, Policy) or not isinstance(self.parts, Sequence) or not self.parts:
            raise ArgumentError(f"parts={self.parts!r}: must be one or more policies")
        object.__setattr__(
            self, "parts", tuple(check_policy(each, f"parts[{row}]") for row, each in enumerate(self.parts))
        )

    def is_silent(self, moment: Moment) -> bool:
        return all(each.is_silent(moment) for each in self.parts)

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        speaking = [each for each in self.parts if not each.is_silent(moment)]
        return list(dict.fromkeys(pixel for each in speaking for pixel in each.pixels(frame, moment)))


@dataclass(frozen=True)
class _InPartOfPhase(Policy, ABC):
    """Follow another policy in a part of the phase; be silent in the rest.

    Attributes:
        count: number of frames.
        policy: the policy in these frames.
    """

    count: int
    policy: Policy = field(default_factory=OnePixelPerMovingObject)

    def __post_init__(self) -> None:
        argument_checks.integer(self.count, "count", 0)
        check_policy(self.policy, "policy")

    @abstractmethod
    def is_silent(self, moment: Moment) -> bool: ...

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        return self.policy.pixels(frame, moment)


@dataclass(frozen=True)
class FirstFrames(_InPartOfPhase):
    """Follow `policy` in the first `count` frames of a phase; be silent afterwards."""

    def is_silent(self, moment: Moment) -> bool:
        return moment.index >= self.count or self.policy.is_silent(moment)


@dataclass(frozen=True)
class LastFrames(_InPartOfPhase):
    """Follow `policy` in the last `count` frames of a phase, which must have an end; be silent before."""

    def is_silent(self, moment: Moment) -> bool:
        if moment.length is None:
            raise ArgumentError("LastFrames: the stream has no end; make it with frames=N")
        return moment.index < moment.length - self.count or self.policy.is_silent(moment)


@dataclass(frozen=True)
class Recorded(Policy):
    """Label the pixels that a ledger holds, each in its frame.

    Attributes:
        pixels_by_frame: a `Supervision.ledger`, or rows (frame, row, column). Frames count in the stream or the course.
    """

    pixels_by_frame: LabelLedger | Sequence[tuple[int, int, int]]

    def __post_init__(self) -> None:
        given = self.pixels_by_frame
        rows = ((each.frame, each.y, each.x) for each in given) if isinstance(given, LabelLedger) else given
        numbers = check_rows(rows, "pixels_by_frame", ("frame", "row", "column"))
        object.__setattr__(self, "pixels_by_frame", tuple(numbers))

    @cached_property
    def _pixels(self) -> dict[int, list[Pixel]]:
        found: dict[int, list[Pixel]] = {}
        for index, y, x in self.pixels_by_frame:  # type: ignore[misc]  # rows since __post_init__
            found.setdefault(index, []).append((y, x))
        return found

    def pixels(self, frame: Frame, moment: Moment) -> Sequence[Pixel]:
        return self._pixels.get(frame.index, ())


def _every(step: int, size: int) -> range:
    return range(step // 2 if step // 2 < size else size // 2, size, step)


def check_policy(value: Any, name: str) -> Policy:
    """Return `value`, a policy."""
    if not isinstance(value, Policy):
        hint = " (an instance, not the class)" if isinstance(value, type) else ""
        raise ArgumentError(f"{name}={value!r}: must be a policy{hint}, such as OnePixelPerMovingObject()")
    return value


def chosen_pixels(policy: Policy, frame: Frame, moment: Moment) -> list[Pixel]:
    """Return the pixels of a policy, checked: a user's own may return anything."""
    return check_pixel_list(policy.pixels(frame, moment), f"{type(policy).__name__}.pixels")


def check_pixel_list(value: Any, name: str) -> list[Pixel]:
    """Return `value`, pixels (row, column), as whole numbers."""
    return [(y, x) for y, x in check_rows(value, name, ("row", "column"))]


def check_rows(value: Any, name: str, parts: Sequence[str]) -> list[tuple[int, ...]]:
    """Return `value`, rows of whole numbers.

    Args:
        value: an iterable of iterables.
        name: of the argument, for error messages.
        parts: names of the numbers of a row.
    """
    try:
        rows = [tuple(each) for each in value]
    except TypeError:
        rows = [()]
    if any(len(row) != len(parts) for row in rows):
        raise ArgumentTypeError(f"{name}={value!r}: must be rows ({', '.join(parts)}), one for each pixel")
    places, whole = [f"{name}: {part}" for part in parts], argument_checks.whole
    return [tuple(whole(each, place) for each, place in zip(row, places, strict=True)) for row in rows]
